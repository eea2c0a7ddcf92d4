"""Cells parted until the level set of a function in each is a graph, a side, or next to nothing.

Signs are those of the function plus `SHIFT`: what is 0 up to rounding counts as above. So a level
set is the border of what is below, and is one of curves, also where the function vanishes on lines
or faces.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.pieces.bernstein import children
from limitsurf.query.index import Cells
from limitsurf.query.polynomials import Form
from limitsurf.query.records import Rows
from limitsurf.query.scalars import Scalar

Array = NDArray[Any]

# functions are about 1 in size: what is taken for 0; by how much a cell must be off to count as
# so; what differs by rounding, also between cells that share a side
SHIFT = 2.0**-48
_CLEAR = 2.0**-50
# cells on which a function is no more are not parted: which curves join there is undecided (so much
# more than the shift that curves which meet are not told apart by it)
FLOOR = 2.0**-42
GRAPH_S, GRAPH_T, TOUCH, KNOT, CORNER = range(5)
_POINTS = 16  # of a curve in a cell, at most, unless its slope is about constant there
_DEEP = 40  # rings around special corners: beyond, float64 cannot tell parameters near 1 apart
# cells smaller than the tolerance that may be undecided at once; and any at all, besides some for
# each cell that is met at first: more come of lines along which the level set only touches
_CROWD, _MOST, _EACH = 1 << 11, 1 << 13, 8


@dataclass(slots=True)
class Pieces(Rows):
    """Cells of limit faces and a function on them: ``(u, v) = frame[0] + s frame[1] + t frame[2]``.

    `level` numbers the level that was taken from `values`.
    """

    level: Array  # (P,)
    face: Array
    frame: Array  # (P, 3, 2)
    values: Array  # (P, m)
    points: Array  # (P, n, 3)

    def ways(self, form: Form) -> Array:
        """Which way cells are halved: across the longest side, (P,)."""
        at, there = self.points[:, form.corners], form.ends @ self.frame[:, 1:]
        a, b = form.across.T
        # (in space, and by parameters where a side is but a point)
        span = ((at[:, a] - at[:, b]) ** 2).sum(axis=2)
        span += 2.0**-60 * ((there[:, a] - there[:, b]) ** 2).sum(axis=2)
        return np.asarray(span.argmax(axis=1))

    def parted(self, frames: Array, values: Array, points: Array) -> Pieces:
        """The k parts of all, by frames (P or 1, k, 3, 2) and matrices onto their coefficients."""
        k = frames.shape[1]
        n = k * len(self)
        frame = np.matmul(frames, self.frame[:, None, 1:])
        frame[:, :, 0] += self.frame[:, None, 0]
        own = np.matmul(values, self.values[:, None, :, None])
        return Pieces(
            np.repeat(self.level, k),
            np.repeat(self.face, k),
            frame.reshape(n, 3, 2),
            own.reshape(n, self.values.shape[1]),
            np.matmul(points, self.points[:, None]).reshape(n, *self.points.shape[1:]),
        )


@dataclass(slots=True)
class Leaves:
    """Cells that a level set may meet, and what it is in each, (L,).

    Attributes
    ----------
    cells : Pieces
        What remains at special corners comes last, without values and points.
    kind : (L,) int
        GRAPH_S and GRAPH_T: of s or of t. TOUCH: nothing is above, all 0 is on the sides. KNOT: it
        is undecided. CORNER: what remains at a special corner.
    bend : (L,)
        Bounds of second derivatives of the curve by s or t, of the sides of TOUCH.
    corners : (L, c)
        Values at the corners.
    special : (L,) int
        Number of the special corner, or -1.
    """

    cells: Pieces
    kind: Array
    bend: Array
    corners: Array
    special: Array

    def __len__(self) -> int:
        return len(self.kind)


class Parting:
    """The search for the leaves of levels (J,) of a function; `tolerance` is that of curves."""

    def __init__(self, cells: Cells, scalar: Scalar, levels: Array, tolerance: float) -> None:
        self._cells, self._scalar, self._levels = cells, scalar, levels
        self._tolerance = tolerance
        self._form, self._own = cells.form, scalar.form
        self._most = _MOST
        self._quarters: tuple[Array, Array, Array] | None = None
        self._leaves: list[tuple[Pieces, Array, Array]] = []
        self._last: list[tuple[Array, Array, Array]] = []  # special corners: level, which, ring

    def run(self) -> Leaves:
        """All leaves."""
        pending = self._first()
        self._most = _MOST + _EACH * len(pending)
        level, which = self._corners()
        ring = 0
        while len(pending) or len(level):
            level, which, more = self._ring(level, which, ring)
            pending = self._judged(Pieces.joined([pending, *more]))
            ring += 1
        return self._joined()

    def _first(self) -> Pieces:
        values, cells = self._scalar.of_cells(), self._cells
        least, most = values.min(axis=1), values.max(axis=1)
        level, cell = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
        for number, height in enumerate(self._levels):
            there = least - height + SHIFT <= _CLEAR
            cell.append(np.flatnonzero(there & (most - height + SHIFT >= -_CLEAR)))
            level.append(np.full(len(cell[-1]), number))
        c, j = (np.concatenate(x) for x in (cell, level))
        above = values[c] - self._levels[j, None]
        return Pieces(j, cells.face[c], cells.frames(c), above, cells.points[c])

    def _corners(self) -> tuple[Array, Array]:
        """Levels and numbers of all special corners, (M,) each."""
        n, count = len(self._levels), len(self._cells.beyond)
        return np.repeat(np.arange(n), count), np.tile(np.arange(count), n)

    def _ring(self, level: Array, which: Array, ring: int) -> tuple[Array, Array, list[Pieces]]:
        """The cells of a ring around those special corners beyond which the level set may be."""
        if not len(level):
            return level, which, []
        rings = np.full(len(which), ring)
        value = self._scalar.at_corners(which) - self._levels[level]
        reach = self._scalar.reach(which, rings)
        near = np.abs(value + SHIFT) <= reach + _CLEAR
        ends = near & ((reach + np.abs(value) <= FLOOR) | (ring >= _DEEP))
        self._last.append((level[ends], which[ends], rings[ends]))
        on = near & ~ends
        level, which, rings, reach = level[on], which[on], rings[on], reach[on]
        if not len(level):
            return level, which, []
        found = self._beyond(level, which, rings)
        # of what nothing bounds a ring tells
        size = np.abs(found.values).reshape(len(level), -1).max(axis=1)
        ends = np.isinf(reach) & (size <= FLOOR)
        self._last.append((level[ends], which[ends], rings[ends]))
        more = found[np.repeat(~ends, len(found) // len(level))]
        return level[~ends], which[~ends], [more]

    def _beyond(self, level: Array, which: Array, ring: Array) -> Pieces:
        cells = self._cells
        leaf = which + len(cells.points)
        found = cells.beyond.cells(which, ring)
        values = self._scalar.of_rings(which, ring, found) - self._levels[level, None, None]
        count = found.points.shape[1]
        frame = cells.ring_frames(which, found.origin, found.size)
        points = found.points + cells.beyond.limits[which][:, None, None]
        return Pieces(
            np.repeat(level, count),
            np.repeat(cells.face[leaf], count),
            frame.reshape(-1, 3, 2),
            values.reshape(-1, values.shape[2]),
            points.reshape(-1, *points.shape[2:]),
        )

    def _judged(self, cells: Pieces) -> Pieces:
        """What is to be looked at again: the parts of those that are no leaves."""
        f = cells.values
        least, most = f.min(axis=1), f.max(axis=1)
        meets = (least + SHIFT <= _CLEAR) & (most + SHIFT >= -_CLEAR)
        cells, least, most = cells[meets], least[meets], most[meets]
        if not len(cells):
            return cells
        f = cells.values
        whole = _sides_decided(f[:, self._own.edges])
        box = cells.points.max(axis=1) - cells.points.min(axis=1)
        small = np.sqrt((box**2).sum(axis=1)) <= self._tolerance
        second = np.diff(cells.points[:, self._form.edges], n=2, axis=2)
        degree = self._form.degree
        side = np.sqrt((second**2).sum(axis=3)).max(axis=(1, 2), initial=0) * degree * (degree - 1)
        touch = whole & (most <= SHIFT / 2)
        way, bend, graph = self._graphs(cells, small)
        graph &= whole
        kind = np.where(touch, TOUCH, way)
        bend = np.where(touch, side, bend)
        open_ = ~(touch | graph)
        knot = open_ & (np.maximum(most, -least) <= FLOOR)
        if (open_ & small).sum() > _CROWD:
            knot |= open_ & small
        if (open_ & ~knot).sum() > self._most:
            knot |= open_
        kind[knot] = KNOT
        leaf = touch | graph | knot
        self._leaves.append((cells[leaf], kind[leaf], bend[leaf]))
        return self._parts(cells[open_ & ~knot])

    def _parts(self, cells: Pieces) -> Pieces:
        """Halves of squares; of triangles the four that are like them, so that lines stay few."""
        form, own = self._form, self._own
        if not self._cells.lattice.sloped:
            way = cells.ways(form)
            return cells.parted(form.frames[way], own.halves[way], form.halves[way])
        if self._quarters is None:
            lattice = self._cells.lattice
            frames, of_values = children(lattice, own.exponents)
            of_points = children(lattice, form.exponents)[1]
            self._quarters = frames[None], of_values[None], of_points[None]
        return cells.parted(*self._quarters)

    def _graphs(self, cells: Pieces, small: Array) -> tuple[Array, Array, Array]:
        """Whether level sets are graphs of s or t, (P,), bounds of their second derivatives.

        And whether it is either, with few points or about as many as it takes.
        """
        own, form = self._own, self._form
        slopes = np.matmul(own.derivatives[1:], cells.values.T)  # (5, m, P)
        s, t, *seconds = np.abs(slopes).max(axis=1)
        x = np.matmul(form.derivatives[None, 1:], cells.points[:, None])  # (P, 5, n, 3)
        xs, xt, *bends = np.sqrt((x**2).sum(axis=3)).max(axis=2).T
        found, clear, even = np.empty((3, 2, len(cells)))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for way in (0, 1):
                across = slopes[1 - way]
                least = np.maximum(across.min(axis=0), -across.max(axis=0))
                along, most, x_across = ((s, t, xt), (t, s, xs))[way]
                aa, mixed, cc = seconds[:: 1 - 2 * way]
                xa, xmixed, xc = bends[:: 1 - 2 * way]
                ratio = along / least
                turn = (aa + 2 * mixed * ratio + cc * ratio**2) / least
                bound = xa + 2 * xmixed * ratio + xc * ratio**2 + x_across * turn
                found[way] = np.where(least > 0, np.nan_to_num(bound, nan=np.inf), np.inf)
                clear[way] = least
                even[way] = (most <= 2 * least) & (along <= 2 * least)
        way = found.argmin(axis=0)
        every = np.arange(len(cells))
        # (where neither is: that in which it is so up to rounding)
        way = np.where(np.isinf(found.min(axis=0)), clear.argmax(axis=0), way)
        bend, clear, even = (z[way, every] for z in (found, clear, even))
        few = bend <= 8 * self._tolerance * _POINTS**2
        ready = (clear > 0) & np.isfinite(bend) & (few | (even > 0))
        tiny = small & (clear >= -_CLEAR)
        return way, np.where(small, 0, bend), ready | tiny

    def _joined(self) -> Leaves:
        """All leaves, those at special corners last."""
        cells, form = self._cells, self._form
        ends = [np.concatenate(x) for x in zip(*self._last, strict=True)] if self._last else []
        level, which, ring = ends or np.zeros((3, 0), dtype=np.int64)
        leaf = which + len(cells.points)
        far, half = form.ends[cells.beyond.corner(which)], np.ldexp(1.0, -ring)[:, None]
        frame = np.zeros((len(which), 3, 2))
        frame[:, 0] = cells.origin[leaf] + cells.size[leaf] * far * (1 - half)
        frame[:, 1, 0], frame[:, 2, 1] = (cells.size[leaf] * half).T
        none = np.zeros((len(which), self._own.size)), np.zeros((len(which), form.size, 3))
        last = Pieces(level, cells.face[leaf], frame, *none)
        parts = [x[0] for x in self._leaves]
        every = Pieces.joined([*parts, last])
        kind = np.concatenate([*(x[1] for x in self._leaves), np.full(len(which), CORNER)])
        bend = np.concatenate([*(x[2] for x in self._leaves), np.zeros(len(which))])
        count = len(every) - len(which)
        corners = every.values[:, self._own.corners]
        if len(which):
            corners[count:] = self._rims(last, which, ring)
        special = np.concatenate([np.full(count, -1), cells.beyond.corner(which)])
        return Leaves(every, kind, bend, corners, special)

    def _rims(self, last: Pieces, which: Array, ring: Array) -> Array:
        """Values (M, c) at the corners of what remains at special corners: those of its ring."""
        form, corner = self._form, self._cells.beyond.corner(which)
        found = self._beyond(last.level, which, ring)
        at = found.frame[:, :1] + np.matmul(form.ends, found.frame[:, 1:])
        at = at.reshape(len(which), -1, 2)
        values = found.values[:, self._own.corners].reshape(len(which), -1)
        own = last.frame[:, :1] + np.matmul(form.ends, last.frame[:, 1:])
        near = np.abs(own[:, :, None] - at[:, None]).sum(axis=3).argmin(axis=2)
        rims = np.take_along_axis(values, near, axis=1)
        there = np.arange(len(which))
        rims[there, corner] = self._scalar.at_corners(which) - self._levels[last.level]
        return rims


def _sides_decided(values: Array) -> Array:
    """Whether each side of cells, coefficients (P, c, d + 1), has at most one change of sign."""
    above = values + SHIFT
    step = np.diff(values, axis=2)
    low, high = above.min(axis=2) >= -_CLEAR, above.max(axis=2) <= _CLEAR
    rises, falls = step.min(axis=2) >= -_CLEAR, step.max(axis=2) <= _CLEAR
    return np.asarray((low | high | rises | falls).all(axis=1))
