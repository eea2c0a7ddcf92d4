"""Normals that are one where they meet."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

# two unit normals this close, in each coordinate, are one: far above their rounding (1e-12, more
# where derivatives almost vanish), far below any crease to be seen, and what float32 tells apart
_SAME_NORMAL = 1e-6


def sides(point: Array, normals: Array, n_points: int) -> tuple[Array, Array]:
    """Number equal normals (S, 3) at the same point (S,) alike: (S,), and one of each number.

    NaN counts as one more normal.
    """
    number = np.empty(len(point), dtype=np.int64)
    leaders: list[Array] = []
    count, leader, rest = 0, np.empty(n_points, dtype=np.int64), np.arange(len(point))
    while len(rest):
        # at each point the first one left, and all that equal it
        leader[point[rest[::-1]]] = rest[::-1]
        ahead = leader[point[rest]]
        same = np.ones(len(rest), dtype=bool)
        for x in normals.T:
            a, b = x[rest], x[ahead]
            same &= (np.abs(a - b) <= _SAME_NORMAL) | (np.isnan(a) & np.isnan(b))
        first = rest[ahead == rest]
        number[first] = count + np.arange(len(first))
        number[rest[same]] = number[ahead[same]]
        leaders.append(first)
        count, rest = count + len(first), rest[~same]
    return number, np.concatenate([np.zeros(0, dtype=np.int64), *leaders])
