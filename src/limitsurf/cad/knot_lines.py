"""Where rectangles are better cut, so that not all of their rows have knots that few take."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cad import nets

Array = NDArray[Any]
Box = tuple[int, int, int, int]

# what a cut has to spare: as many control points as a face's entities take of a STEP file, and
# this share of those of the rectangle
_FACE, _SHARE = 128, 0.2


def apart(cut: nets.Cut, grid: tuple[int, int], degree: int) -> list[Box]:
    """Boxes (low and high along u, along v) that a rectangle of limit faces is better cut into.

    Again and again where it spares most, along one line or the two next to both ends; where that
    is too little for more faces, it stays whole.
    """
    lines = _Lines(cut, degree)
    found, pending = [], [(0, grid[0], 0, grid[1])]
    while pending:
        box = pending.pop()
        count = lines.count(box)
        best, spared = [box], 0.0
        for parts in lines.cuts(box):
            more = count - sum(map(lines.count, parts)) - _FACE * (len(parts) - 1)
            if more > spared and more >= _SHARE * count - _FACE:
                best, spared = parts, more
        if len(best) == 1:
            found.append(box)
        else:
            pending.extend(best)
    return sorted(found)


class _Lines:
    """Lines within limit faces of a rectangle, and which rows or columns of these they are in."""

    def __init__(self, cut: nets.Cut, degree: int) -> None:
        self.degree = degree
        low = np.concatenate([cut.origin, cut.rest_origin])
        high = low + np.concatenate([cut.size, cut.rest_size])
        face = np.floor(low)
        self.at, self.used = [], []
        for axis in (0, 1):
            ends = np.concatenate([low[:, axis], high[:, axis]])
            row = np.tile(face[:, 1 - axis].astype(np.int64), 2)
            inner = ends != np.floor(ends)
            lines, which = np.unique(ends[inner], return_inverse=True)
            used = np.zeros((int(face[:, 1 - axis].max(initial=0)) + 1, len(lines)), dtype=bool)
            used[row[inner], which] = True
            self.at.append(lines)
            self.used.append(used)

    def _within(self, box: Box, axis: int) -> Array:
        """Which lines are in which row, of those across a box along an axis."""
        (a, b), (c, d) = (box[:2], box[2:]) if axis == 0 else (box[2:], box[:2])
        first, last = np.searchsorted(self.at[axis], [a, b])
        return self.used[axis][c:d, first:last]

    def count(self, box: Box) -> int:
        """Control points of a spline over a box."""
        counts = [int(self._within(box, axis).any(axis=0).sum()) for axis in (0, 1)]
        u, v = box[1] - box[0], box[3] - box[2]
        return (u + counts[0] + self.degree) * (v + counts[1] + self.degree)

    def cuts(self, box: Box) -> list[list[Box]]:
        """Ways to cut a box: at the best place along each axis, and next to both ends."""
        found = []
        for axis in (0, 1):
            low, high = box[2 * axis : 2 * axis + 2]
            n = high - low
            if n == 1:
                continue

            def part(a: int, b: int, axis: int = axis) -> Box:
                return (*box[:2], a, b) if axis else (a, b, *box[2:])

            across = self._within(box, 1 - axis)
            along = np.asarray(self._within(box, axis).any(axis=0))
            first = np.searchsorted(self.at[axis], low)
            place = self.at[axis][first : first + len(along)][along]
            inner = np.searchsorted(place, np.arange(low + 1, high))
            below = np.logical_or.accumulate(across)[:-1].sum(axis=1)
            above = np.logical_or.accumulate(across[::-1])[::-1][1:].sum(axis=1)
            width = box[3 - 2 * axis] - box[2 - 2 * axis] + self.degree
            step = np.arange(1, n)
            cost = (width + below) * (step + inner + self.degree)
            cost += (width + above) * (n - step + len(place) - inner + self.degree)
            at = low + 1 + int(cost.argmin())
            found.append([part(low, at), part(at, high)])
            if n > 2:
                found.append([part(low, low + 1), part(low + 1, high - 1), part(high - 1, high)])
        return found


def within(cut: nets.Cut, grid: tuple[int, int], box: Box) -> tuple[nets.Cut, Array]:
    """The part of rectangles within a box, and which of their limit faces it has."""
    every = np.arange(grid[0] * grid[1]).reshape(grid)
    inside = every[box[0] : box[1], box[2] : box[3]].ravel()
    if len(inside) == every.size:
        return cut, inside
    low, high = np.array([box[0], box[2]]), np.array([box[1], box[3]])
    one, other = (
        np.flatnonzero(((x >= low) & (x < high)).all(axis=1)) for x in (cut.origin, cut.rest_origin)
    )
    found = replace(
        cut, cells=cut.cells[:, one], rest=cut.rest[:, other], origin=cut.origin[one] - low,
        size=cut.size[one], rest_origin=cut.rest_origin[other] - low,
        rest_size=cut.rest_size[other], corner=cut.corner[other],
    )  # fmt: skip
    return found, inside
