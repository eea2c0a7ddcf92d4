"""Plain-array functions that import nothing of the library and may be called from any room.

`reference` is vectorised NumPy and runs on any number type; `rationals` is exact arithmetic in
NumPy. The other modules are compiled with Numba, for float64 and integers; importing one loads
Numba, so callers ask `answer`, or `compiled`, first.

That is decided by cost. Kernels in `available` are loaded and compiled, and answer everything.
Others are loaded, which takes half a second, once NumPy would have spent as much on all that this
process was asked: so nobody waits twice as long as need be. They are loaded only where all that
might be needed is in the cache on disk. Where it is not, a process in the background compiles it;
if there can be none, this one does, for work that takes NumPy longer.
"""

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from importlib import import_module
from typing import Any

from limitsurf._kernels import background
from limitsurf._kernels.locks import preparing as preparing

VARIABLE = "LIMITSURF_ENGINE"
CHOICES = ("auto", "reference", "compiled")
# what kernels are for, in the order in which they are compiled: meshes, and by the shape of faces
# derivatives and normals, weights, tangents and curvature, and derivatives beyond the second; last
# searches of surfaces, and schemes that are evaluated by steps
MESHES, WEIGHTS, CURVATURE, HIGHER = "meshes", "-weights", "-curvature", "-higher"
SEARCHES, STEPWISE = "searches", "stepwise"
_PARTS = "", WEIGHTS, CURVATURE, HIGHER
KINDS = (
    *("quads", MESHES, *(f"quads{part}" for part in _PARTS[1:])),
    *(f"triangles{part}" for part in _PARTS),
    *(SEARCHES, STEPWISE),
)
# kinds whose kernels answer whatever is asked; reading it is cheap enough for every query
available: set[str] = set()

# seconds, of a processor for which the costs that callers state are right
_LOADING = 0.5
_COMPILING = 20.0
_AGAIN = 0.25  # between two looks at the cache
_MODULES = (
    *("coefficients", "connectivity", "evaluation", "grids", "refinement", "rows"),
    "step_points",
)
# whose kernels evaluate patches that are the box spline of these directions
_SHAPES = {
    "quads": ((1, 0),) * 4 + ((0, 1),) * 4,
    "triangles": ((1, 0),) * 2 + ((0, 1),) * 2 + ((-1, 1),) * 2,
}
_CORNER = 5e-8  # seconds that NumPy takes for one, in a pass over a mesh
_spent = 0.0  # seconds that NumPy has taken for what kernels might have done
_next: dict[str, float] = {}  # when to look for a kind in the cache again
_loaded = False
_choice: ContextVar[str | None] = ContextVar("_choice", default=None)


def named(engine: str | None) -> str:
    """The choice that an argument, or where it is None the environment, makes.

    Examples
    --------
    >>> from limitsurf import _kernels
    >>> _kernels.named("reference")
    'reference'
    """
    given, name = engine, "engine"
    if given is None:
        given, name = os.environ.get(VARIABLE) or "auto", f"the environment variable {VARIABLE}"
    if given not in CHOICES:
        raise ValueError(f"{name} must be one of {', '.join(map(repr, CHOICES))}, got {given!r}")
    return given


def answer(kind: str, seconds: float) -> bool:
    """Whether kernels of this kind do what would take NumPy so many seconds."""
    return kind in available or _pays(kind, seconds)


def compiled(corners: int, passes: float = 1) -> bool:
    """Whether kernels do so many passes over the corners of a mesh.

    Examples
    --------
    >>> from limitsurf import _kernels
    >>> with _kernels.chosen("reference"):
    ...     _kernels.compiled(10**9)
    False
    """
    choice = _choice.get() or named(None)
    if choice == "reference":
        return False
    if choice == "compiled":
        return load()
    return answer(MESHES, corners * passes * _CORNER)


@contextmanager
def chosen(choice: str) -> Iterator[None]:
    """Have meshes done by "reference" (NumPy), "compiled" (kernels) or "auto" for a while.

    So that a surface has the same digits however it was made.
    """
    token = _choice.set(choice)
    try:
        yield
    finally:
        _choice.reset(token)


def load() -> bool:
    """Import all kernels, before anybody uses one; False where Numba is told not to compile."""
    global _loaded
    if not _loaded and not _disabled():
        with preparing:
            for name in _MODULES:
                import_module(f"{__name__}.{name}")
            _loaded = True
    return _loaded


def shape(directions: tuple[tuple[int, int], ...]) -> str | None:
    """The shape of the faces of surfaces whose regular patches are that box spline, if known."""
    if _disabled():
        return None
    return next((name for name, own in _SHAPES.items() if sorted(own) == sorted(directions)), None)


def evaluating(shape: str) -> Any:
    """The kernels that evaluate surfaces of such faces: modules with equal names.

    One is imported when first asked for; ask while `preparing`.
    """
    return import_module(f"{__name__}.{shape}")


def searching(name: str) -> Any:
    """The kernels that search surfaces, or take steps, by module; ask while `preparing`."""
    return import_module(f"{__name__}.{name}")


def compiles() -> bool:
    """Whether there may be kernels at all: not where Numba is told not to compile."""
    return not _disabled()


def _pays(kind: str, seconds: float) -> bool:
    """Account for a call; whether kernels answer it, since loading them would have paid."""
    global _spent
    before, _spent = _spent, _spent + seconds
    if _spent < _LOADING / 3 or _disabled():
        return False
    if before < _LOADING / 3:
        background.prepare()
    if _spent < _LOADING:
        return False
    if time.monotonic() < _next.get(kind, 0):
        return False
    with preparing:
        if kind not in available and (_read(kind) or _in_haste(kind)):
            available.add(kind)
        _next[kind] = time.monotonic() + _AGAIN
    return kind in available


def _read(kind: str) -> bool:
    """Load kernels of a kind if all of them are in the cache."""
    if not background.marked():
        return False
    load()
    from limitsurf._kernels import jit

    return jit.complete(kind)


def _in_haste(kind: str) -> bool:
    """Whether kernels are to be compiled as they are called, since nobody else does it."""
    return not background.begin(kind) and _spent >= _COMPILING and load()


def _disabled() -> bool:
    """Whether Numba is told to leave Python as it is, which intrinsics do not survive."""
    numba = sys.modules.get("numba")
    if numba is not None and hasattr(numba, "config"):
        return bool(numba.config.DISABLE_JIT)
    return os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")
