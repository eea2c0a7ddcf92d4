"""All kernels at once: what compiles them for later calls and processes."""

from __future__ import annotations

import errno
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from limitsurf import _kernels, disk_cache
from limitsurf._kernels import background
from limitsurf.cage.mesh import Mesh
from limitsurf.refine import refined
from limitsurf.surface import LimitSurface


def precompile() -> None:
    """Compile all kernels now, or load them, and use them for calls of any size from now on.

    For services, and for images of containers, that are to be fast from the first call on. The
    first time on a machine this takes a minute of one processor, later about a second: what is
    compiled is kept in a cache directory, ``LIMITSURF_CACHE_DIR`` or else the user's, which is used
    only if nobody but the user, root and the owner of the installed package may write it. Who does
    not call this has kernels compiled in the background as soon as much is asked for. Where
    ``NUMBA_DISABLE_JIT`` is set nothing happens.

    Examples
    --------
    >>> import limitsurf as ls
    >>> ls.precompile()  # doctest: +SKIP
    """
    compile_kinds(_kernels.KINDS)


def kept_kernels(directory: str | None) -> tuple[str, list[int]]:
    """Precompile into a cache directory, or else the usual one; it, and the sizes of all kernels.

    Raises
    ------
    OSError
        If they are not all there afterwards.
    """
    if directory is not None:
        disk_cache.make_for_all(Path(directory))
        os.environ["LIMITSURF_CACHE_DIR"] = directory
    place = disk_cache.cache_directory()
    precompile()
    if not _kernels.available:
        raise OSError(errno.EPERM, "NUMBA_DISABLE_JIT is set: nothing is compiled", str(place))
    from limitsurf._kernels import jit

    if not all(map(jit.complete, _kernels.KINDS)):
        raise OSError(errno.EACCES, "no kernels can be kept there", str(place))
    return str(place), [(place / name).stat().st_size for name in jit.used]


def compile_kinds(kinds: tuple[str, ...]) -> None:
    """Compile or load kernels of these kinds, one after the other, and write down what there is."""
    if not _kernels.load():
        return
    from limitsurf._kernels import jit

    for kind in kinds:
        with _kernels.chosen("compiled"):
            _CALLS[kind]()
        jit.mark(kind)
        _kernels.available.add(kind)


def _meshes() -> None:
    """Everything that is done with meshes, quads or others, on triangles or not."""
    for scheme, mesh in (("catmull-clark", _box()), ("catmull-clark", _open()), ("loop", _solid())):
        uv = mesh.points[:, :2], mesh.indices, "boundaries"
        mesh = Mesh(mesh.points, mesh.faces, creases=mesh.creases, channels={"uv": uv})
        fine, _ = refined(mesh, 2, operator=True, scheme=scheme)
        for found in (fine, refined(fine)):
            found.limit_points, found.limit_normals, found.edges  # noqa: B018
        surface = LimitSurface(mesh, scheme=scheme, engine="compiled")
        surface.of_channel("uv")


def _quads() -> None:
    """Evaluation on quads."""
    _evaluate(_box(), "catmull-clark")


def _triangles() -> None:
    """Evaluation on triangles."""
    _evaluate(_solid(), "loop")


_CALLS: dict[str, Callable[[], None]] = {
    "meshes": _meshes,
    "quads": _quads,
    "triangles": _triangles,
}


def _evaluate(mesh: Mesh, scheme: str) -> None:
    surface = LimitSurface(refined(mesh, scheme=scheme), scheme=scheme, engine="compiled")
    face = np.arange(len(surface.limit_faces))
    u = np.linspace(0, 0.5, 5)
    for places in (0.25, u):
        surface.jet(face[:, None], places, places)
        surface.normal(face[:, None], places, places)
    surface.tangents(face, 0.25, 0.25)
    surface.curvature(face, 0.25, 0.25)
    surface.weights(face, 0.25, 0.25)


def _box() -> Mesh:
    points = [[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)]
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return Mesh(points, quads, creases={(0, 1): 3.0})


def _open() -> Mesh:
    """Without a face, and with one of another size."""
    box = _box()
    faces = [*box.faces.tolist()[:4], [0, 2, 6], [0, 6, 4]]
    return Mesh(box.points, faces, creases={(0, 1): 1.5})


def _solid() -> Mesh:
    points = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
    faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    return Mesh(np.array(points, dtype=float), faces, creases={(0, 2): 1.5})


def main() -> None:
    """Compile in the background: least urgent of all, and not where another process does so."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # removing what is unfinished
    if hasattr(os, "nice"):
        os.nice(19)
    first = sys.argv[1:]
    rest = [kind for kind in _kernels.KINDS if kind not in first]
    with disk_cache.alone(background.lock(), 0) as alone:
        if alone:
            compile_kinds((*first, *rest))


if __name__ == "__main__":
    main()
