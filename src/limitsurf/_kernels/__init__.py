"""Plain-array functions that import nothing of the library and may be called from any room.

`reference` is vectorised NumPy and runs on any number type; `rationals` is exact arithmetic in
NumPy. The other modules are compiled with Numba, for float64 and integers; importing one loads
Numba, so callers ask `compiled` first.
"""

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

_PAYS = 100_000  # queries, or corners of faces: about a tenth of a second in NumPy
_MODULES = ("coefficients", "connectivity", "evaluation", "grids", "refinement", "rows")
_always = False
_loaded = False

# Held while something is made on first use: modules imported, kernels compiled, surfaces packed. A
# fork waits for it, since its child has no thread that would ever finish; the locks are always
# taken in this order.
preparing = threading.RLock()
locks: list[Any] = [preparing]


def _before_fork() -> None:
    for lock in locks:
        lock.acquire()


def _after_fork() -> None:
    for lock in reversed(locks):
        lock.release()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(
        before=_before_fork, after_in_parent=_after_fork, after_in_child=_after_fork
    )


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
    if not _always and items < _PAYS:
        return False
    _load()
    return True


def _load() -> None:
    """Import all kernels, before anybody uses one."""
    global _loaded
    if not _loaded:
        with preparing:
            for name in _MODULES:
                import_module(f"{__name__}.{name}")
            _loaded = True


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
