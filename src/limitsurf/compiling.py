"""All kernels at once: what compiles them for later calls and processes."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import numpy as np

from limitsurf import _kernels, disk_cache
from limitsurf.cage.mesh import Mesh
from limitsurf.engine.choice import Answers, topology_of
from limitsurf.engine.protocol import JET, Request
from limitsurf.engine.topology import Topology
from limitsurf.options import Rules
from limitsurf.query.crossings import Rays
from limitsurf.query.index import Cells
from limitsurf.query.nearby import approached
from limitsurf.query.traversal import followed, kernels_for
from limitsurf.refine import refined
from limitsurf.scheme.scheme import Scheme
from limitsurf.surface import LimitSurface
from limitsurf.tables import SCHEMES


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
        if kind == _kernels.SEARCHES:
            _search()
        if kind == _kernels.STEPWISE:
            _step()
        if kind == _kernels.MESHES:
            _use_steps()
        for scheme in SCHEMES.with_pieces.values():
            shape = _kernels.shape(scheme.spline.directions)
            if kind == _kernels.MESHES and not scheme.lattice.dual:  # they need no others
                _use_meshes(scheme)
            elif shape and kind.startswith(shape):
                _evaluate(scheme, kind.removeprefix(shape))
        jit.mark(kind)
        _kernels.available.add(kind)


def _use_meshes(scheme: Scheme) -> None:
    """Everything that is done with meshes, of faces of one size or of several."""
    with _kernels.chosen("compiled"):
        for mesh in _samples(scheme):
            uv = mesh.points[:, :2], mesh.indices, "boundaries"
            mesh = Mesh(mesh.points, mesh.faces, creases=mesh.creases, channels={"uv": uv})
            fine, _ = refined(mesh, 2, operator=True, scheme=scheme)
            for found in (fine, refined(fine)):
                found.limit_points, found.limit_normals, found.edges  # noqa: B018
            refined(mesh.with_points(mesh.points[:, 0])).limit_points  # noqa: B018
            LimitSurface(mesh, scheme=scheme, engine="compiled").of_channel("uv")


def _use_steps() -> None:
    """What is done with meshes by schemes without polynomial pieces alone."""
    mesh = _samples(SCHEMES.with_pieces["loop"])[0]
    with _kernels.chosen("compiled"):
        for scheme in SCHEMES.values():
            if not scheme.has_pieces:
                for points in (mesh.points, mesh.points[:, 0]):
                    refined(Mesh(points, mesh.faces), 2, scheme=scheme)


def _evaluate(scheme: Scheme, part: str) -> None:
    """A part of evaluation by kernels, of a mesh that needs none."""
    with _kernels.chosen("reference"):
        mesh = refined(_samples(scheme)[0], scheme=scheme)
    topology = Topology(mesh, Rules.resolve(mesh, scheme), "reference")
    kernels = Answers(topology, mesh, "compiled").compiled
    face = np.arange(len(topology.limit_faces))[:, None]
    for places in (0.25, np.linspace(0, 0.5, 5)):
        request = Request.of(face, places, places, exact=False, workers=1)
        if part == _kernels.WEIGHTS:
            kernels.weights(request, JET)
        elif part == _kernels.CURVATURE:
            kernels.tangents(request, 3)
            kernels.curvatures(request)
        elif part == _kernels.HIGHER:
            kernels.derivatives(request, [(3, 0)])
        else:
            kernels.derivatives(request, JET)
            kernels.normals(request)


def _search() -> None:
    """Searches by kernels, of a surface that needs none otherwise."""
    mesh = _samples(next(iter(SCHEMES.values())))[0]
    cells = Cells.of(LimitSurface(mesh, engine="reference"))
    kernels = kernels_for("compiled", cells, 1)
    if kernels is not None:
        origin, way, bounds = np.full((1, 3), -1.0), np.ones((1, 3)), np.array([[0.0], [np.inf]])
        followed(kernels, Rays.of(cells.power, origin, way, *bounds), "first")
        approached(kernels, origin, np.ones(1), False)


def _step() -> None:
    """Evaluation by steps, of surfaces that need no kernels otherwise."""
    mesh = _samples(SCHEMES.with_pieces["loop"])[0]
    mesh = Mesh(mesh.points, mesh.faces)
    with _kernels.chosen("reference"):
        for scheme in SCHEMES.values():
            if not scheme.has_pieces:
                topology = topology_of(mesh, Rules.resolve(mesh, scheme), "compiled")
                request = Request.of(0, 0.3, 0.3, exact=False, workers=1)
                Answers(topology, mesh, "compiled").reference.derivatives(request, [(0, 0)])


def _samples(scheme: Scheme) -> list[Mesh]:
    """Cages with a crease: a closed one, and an open one with other faces if there may be any."""
    if scheme.lattice.face_size == 3:
        octahedron = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
        faces = [[a, b, 4] for a, b in ((0, 2), (2, 1), (1, 3), (3, 0))]
        faces += [[b, a, 5] for a, b, _ in faces]
        return [Mesh(octahedron.astype(float), faces, creases={(0, 2): 1.5})]
    points = [[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)]
    cube = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    cut = [*cube[:4], [0, 2, 6], [0, 6, 4]]
    return [Mesh(points, faces, creases={(0, 1): s}) for faces, s in ((cube, 3.0), (cut, 1.5))]


def compile_first(kind: str) -> None:
    """Compile all kernels, those of a kind first."""
    compile_kinds((kind, *(other for other in _kernels.KINDS if other != kind)))
