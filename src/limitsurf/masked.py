"""Masked arrays: what is masked is missing, and is not taken for the number that lies under it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def may_be_masked(*values: Any) -> bool:
    """Whether any entry of any of them may be masked.

    Examples
    --------
    >>> import numpy as np
    >>> from limitsurf.masked import may_be_masked
    >>> may_be_masked([1, 5], 3), may_be_masked(0, [np.ma.masked, 1])
    (False, True)
    """
    for x in values:
        if isinstance(x, np.ma.MaskedArray):
            return True
        if isinstance(x, (list, tuple)) and any(isinstance(y, np.ma.MaskedArray) for y in x):
            return True
    return False


def unmasked(values: Any) -> tuple[Array, Array | None]:
    """An ordinary array with 0 where entries are masked, and where they are; None if none is.

    Examples
    --------
    >>> import numpy as np
    >>> from limitsurf.masked import unmasked
    >>> [x.tolist() for x in unmasked(np.ma.masked_greater([1, 5], 3))], unmasked([1, 5])[1]
    ([[1, 0], [False, True]], None)
    """
    if not may_be_masked(values):
        return np.asarray(values), None
    if isinstance(values, (list, tuple)):
        values = np.ma.stack([np.ma.asarray(x) for x in values])
    mask: Array = np.ma.getmaskarray(values)
    return np.asarray(values.filled(0)), mask if mask.any() else None


def refusal(values: Any, what: str) -> str | None:
    """What to say of the first masked entry where nothing may be missing; None if none is masked.

    Examples
    --------
    >>> import numpy as np
    >>> from limitsurf.masked import refusal
    >>> refusal(np.ma.masked_greater([1, 5], 3), "holes")
    'holes: the entry at index 1 is masked; fill it, or leave out what lacks it'
    """
    try:
        mask = unmasked(values)[1] if may_be_masked(values) else None
    except ValueError:  # arrays of different shapes, of which others complain
        return None
    if mask is None:
        return None
    place = ", ".join(map(str, np.argwhere(mask)[0].tolist()))
    more = int(mask.sum()) - 1
    where = (f" at index {place}" if place else "") + " is masked"
    where += f" ({more} more like it)" if more else ""
    return f"{what}: the entry{where}; fill it, or leave out what lacks it"
