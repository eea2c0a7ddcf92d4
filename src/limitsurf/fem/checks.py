"""Numbers that users give to forms and shells."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def reals(name: str, given: Any) -> NDArray[np.float64]:
    """An array of float64; a TypeError for what is no real number, a ValueError for ragged rows."""
    try:
        found = np.asarray(given)
    except ValueError:
        raise ValueError(f"{name}: rows of different lengths do not form an array") from None
    if found.dtype.kind in "biuf":
        return found.astype(float)
    try:
        if found.dtype.kind == "O":  # Fractions, for one
            return found.astype(float)
    except (TypeError, ValueError):
        pass
    raise TypeError(f"{name} must be real numbers, got an array of {found.dtype}")


def power_of_two(values: Array, axis: tuple[int, ...]) -> NDArray[np.float64]:
    """The largest power of two up to the greatest size along axes, which are kept; 1 where it is 0.

    To divide by it changes exponents alone: what is squared afterwards is in the middle of their
    range, whatever the units.
    """
    most = np.abs(values).max(axis=axis, keepdims=True, initial=0)
    exponent = np.frexp(np.where(np.isfinite(most), most, 0))[1]
    return np.where(most > 0, np.ldexp(1.0, exponent - 1), 1.0)
