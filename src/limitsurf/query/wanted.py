"""What is asked of polygons on a surface, and how far parts of it are from that."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import memory
from limitsurf.query.camera import Sight, View

Array = NDArray[Any]

LOST = 2.0**-46  # what rounding takes, of the largest coordinate

_PART = 1000  # bytes that a part takes, at least, while it is made
_MOST = 16.0  # what excess is worth where there is no bound yet


@dataclass(frozen=True)
class Wanted:
    """What is asked of polygons, in the units of the points; inf if nothing.

    Attributes
    ----------
    chord : float
        Largest distance from the surface; in pixels, if there is a view.
    edge : float
        Longest edge.
    most : float
        Number of triangles.
    angle : float
        Largest angle between normals, in radians.
    view : View or Sight, optional
        The latter in the units of cells.
    """

    chord: float = math.inf
    edge: float = math.inf
    most: float = math.inf
    angle: float = math.inf
    view: View | Sight | None = None

    @property
    def turning(self) -> bool:
        """Whether angles matter."""
        return self.angle < math.inf

    @property
    def sight(self) -> Sight | None:
        """The view, in the units of cells."""
        return self.view if isinstance(self.view, Sight) else None

    def scaled(self, power: int) -> Wanted:
        """The same where points are multiplied by a power of 2, less what rounding takes."""
        scaled: dict[str, Any] = {}
        if isinstance(self.view, View):
            scaled["view"] = self.view.scaled(power)
        for name in ("edge",) if scaled else ("chord", "edge"):
            asked = float(np.ldexp(getattr(self, name), power))
            if not asked > 4 * LOST:
                least = float(np.ldexp(8 * LOST, -power))
                raise ValueError(
                    f"{name} must be at least {least:.3g} where coordinates are so large, as "
                    f"float64 is rounded, got {getattr(self, name):.3g}"
                )
            scaled[name] = asked - LOST
        return replace(self, **scaled)

    def excess(self, corners: Array, seen: Array) -> Array:
        """How far parts are from it but for angles, 1 or less where it is reached: (L,).

        Of corners (L, c, 3), and how far the surface is from polygons, -1 where nobody looks.
        """
        found = seen / self.chord
        if self.view is not None:
            found = np.minimum(found, _MOST)
        if self.edge < math.inf:
            long = (longest(corners) / self.edge) ** 2
            found = np.where(seen < 0, 0, np.maximum(found, long))
        return np.asarray(found)

    def turned(self, turn: Array) -> Array:
        """How far angles (L,) are from it in the same way; NaN counts as nothing."""
        found = np.where(turn < math.pi / 2, (turn / self.angle) ** 2, _MOST)
        return np.where(np.isnan(turn), 0, found)

    def check(self, n: int, about: float = 0.0, triangles: int | None = None) -> None:
        """Refuse n parts, of which there will be about so many, if they are too many."""
        found = n if triangles is None else triangles
        if found > self.most or about > 64 * self.most:
            some = triangles if triangles is not None else f"some {max(2 * n, about):.3g}"
            raise ValueError(
                f"that takes {some} triangles, more than max_triangles={self.most:.0f}: "
                "allow for more of them, or for a larger error"
            )
        needed = max(n, int(min(about / 64, 1e15)))
        memory.refuse_beyond(needed, _PART, "polygons", "allow for a larger error")


def longest(corners: Array) -> Array:
    """Longest side or diagonal of polygons (L, c, 3)."""
    a, b = np.triu_indices(corners.shape[1], 1)
    return np.asarray(np.sqrt(((corners[:, a] - corners[:, b]) ** 2).sum(axis=2)).max(axis=1))
