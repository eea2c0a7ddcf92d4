"""Plain-array functions that import nothing of the library and may be called from any room.

`reference` is vectorised NumPy and runs on any number type; `rationals` is exact arithmetic in
NumPy. The other modules are compiled with Numba, for float64 and integers; importing one loads
Numba, so callers ask `compiled` first.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from limitsurf._kernels.locks import preparing as preparing

_PAYS = 100_000  # queries, or corners of faces: about a tenth of a second in NumPy
_MODULES = ("coefficients", "connectivity", "evaluation", "grids", "refinement", "rows")
# whose kernels evaluate patches that are the box spline of these directions
_SHAPES = {
    "quads": ((1, 0),) * 4 + ((0, 1),) * 4,
    "triangles": ((1, 0),) * 2 + ((0, 1),) * 2 + ((-1, 1),) * 2,
}
_always = False
_loaded = False


def compiled(items: int) -> bool:
    """Whether to use compiled kernels for so many queries, or corners of faces.

    Loading them takes half a second, compiling them seconds the first time on a machine: small
    calls are sooner done by NumPy. It depends on the size of a call alone, so that equal calls have
    equal results, to the last digit.

    Examples
    --------
    >>> from limitsurf import _kernels
    >>> _kernels.compiled(100_000)
    True
    """
    if not pays(items):
        return False
    load()
    return True


def pays(items: int) -> bool:
    """Whether a call of this size is large enough for kernels, without loading them."""
    return _always or items >= _PAYS


def load() -> None:
    """Import all kernels, before anybody uses one."""
    global _loaded
    if not _loaded:
        with preparing:
            for name in _MODULES:
                import_module(f"{__name__}.{name}")
            _loaded = True


def shape(directions: tuple[tuple[int, int], ...]) -> str | None:
    """The shape of the faces of surfaces whose regular patches are that box spline, if known."""
    return next((name for name, own in _SHAPES.items() if sorted(own) == sorted(directions)), None)


def evaluating(shape: str) -> Any:
    """The kernels that evaluate surfaces of such faces: modules with equal names.

    One is imported when first asked for; ask while `preparing`.
    """
    return import_module(f"{__name__}.{shape}")


def connects() -> bool:
    """Whether compiled connectivity has been used, so that nothing is to be loaded for it."""
    if not _loaded:
        return False
    from limitsurf._kernels import connectivity

    dispatcher: Any = connectivity._around
    return bool(dispatcher.signatures)


def always() -> None:
    """Use compiled kernels for calls of any size from now on."""
    global _always
    _always = True


@contextmanager
def numpy_only() -> Iterator[None]:
    """Use NumPy for calls of any size for a while."""
    global _always, _PAYS
    before = _always, _PAYS
    _always, _PAYS = False, sys.maxsize
    try:
        yield
    finally:
        _always, _PAYS = before
