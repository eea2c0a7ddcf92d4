"""Plain-array functions that import nothing of the library and may be called from any room.

`reference` is vectorised NumPy and runs on any number type. The other modules are compiled with
Numba, for float64 and integers; importing one loads Numba, so callers ask `compiled` first.
"""

_PAYS = 100_000  # queries, or corners of faces: about a tenth of a second in NumPy
_always = False


def compiled(items: int) -> bool:
    """Whether to use compiled kernels for so many queries, or corners of faces.

    Loading them takes half a second, compiling them seconds the first time on a machine: small
    calls are sooner done by NumPy. It depends on the size of a call alone, so that equal calls have
    equal results, to the last digit.

    Examples
    --------
    >>> from limitsurf import _kernels
    >>> _kernels.compiled(10_000_000)
    True
    """
    return _always or items >= _PAYS


def always() -> None:
    """Use compiled kernels for calls of any size from now on."""
    global _always
    _always = True
