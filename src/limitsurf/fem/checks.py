"""Numbers that users give to forms and shells."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from limitsurf.surface import LimitSurface

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


def refuse_dual(surface: LimitSurface) -> None:
    """Refuse graded spaces of schemes whose finer faces are on several coarser ones."""
    if surface.topology.lattice.dual:
        raise ValueError(
            "graded spaces need schemes by which faces are split, so that finer ones are in them, "
            f"which {surface.topology.rules.scheme.name!r} does not: use levels="
        )


def checked_where(where: ArrayLike | None, n_faces: int) -> NDArray[np.int64]:
    """How many levels more on each face of the cage."""
    if where is None:
        return np.zeros(n_faces, dtype=np.int64)
    found = np.asarray(where)
    if found.shape != (n_faces,) or found.dtype.kind not in "biu" or (found < 0).any():
        raise ValueError(
            f"where must be ({n_faces},) booleans, or numbers of levels not below 0, one for each "
            f"face of the cage, got {found.dtype} of shape {found.shape}"
        )
    return found.astype(np.int64)
