"""Tensor product splines of one degree, evaluated together, and where limit faces are in them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_PLACES = 1 << 14  # at once
# (u, v) of the corner of a square that is turned by so many quarters: origin, along u, along v
_TURNS = np.array([
    [[0, 0], [1, 0], [0, 1]], [[1, 0], [0, 1], [-1, 0]],
    [[1, 1], [-1, 0], [0, -1]], [[0, 1], [0, -1], [1, 0]],
])  # fmt: skip


@dataclass(frozen=True, eq=False)
class Splines:
    """Flat arrays of knots and control points, and where those of each begin.

    Attributes
    ----------
    degree : (int, int)
    counts : (n, 2) int
    knots_u, knots_v, points
        As in `BSplineFaces`.
    first_u, first_v, first : (n + 1,) int
    """

    degree: tuple[int, int]
    counts: Array
    knots_u: Array
    knots_v: Array
    points: Array
    first_u: Array
    first_v: Array
    first: Array

    @classmethod
    def of(
        cls, degree: tuple[int, int], counts: Array, knots_u: Array, knots_v: Array, points: Array
    ) -> Splines:
        """Those of flat arrays."""
        p, q = degree
        sizes = counts[:, 0] + p + 1, counts[:, 1] + q + 1, counts.prod(axis=1)
        first = (np.concatenate([[0], np.cumsum(size)]) for size in sizes)
        return cls(degree, counts, knots_u, knots_v, points, *first)

    def jet(self, face: Array, u: Array, v: Array, order: int) -> list[Array]:
        """Values (Q, d), and with order 1 derivatives along u and along v, of checked places (Q,).

        At a knot the derivatives are those of the piece above it.
        """
        found = [np.empty((len(face), self.points.shape[1])) for _ in range(1 + 2 * order)]
        for start in range(0, len(face), _PLACES):
            some = slice(start, start + _PLACES)
            which, (p, q) = face[some], self.degree
            one = self._line(self.knots_u, self.first_u[which], self.counts[which, 0], p, u[some])
            two = self._line(self.knots_v, self.first_v[which], self.counts[which, 1], q, v[some])
            rows = (one[0][:, None] + np.arange(p + 1)) * self.counts[which, 1, None]
            rows += self.first[which, None] + two[0][:, None]
            net = self.points[rows[:, :, None] + np.arange(q + 1)]
            for out, a, b in zip(found, (1, 2, 1), (1, 1, 2), strict=False):
                across = np.matmul(two[b][:, None, None], net)[:, :, 0]
                out[some] = np.matmul(one[a][:, None], across)[:, 0]
        return found

    @staticmethod
    def _line(
        knots: Array, first: Array, count: Array, degree: int, x: Array
    ) -> tuple[Array, Array, Array]:
        """The first function (Q,) that counts at x, values (Q, degree + 1) and derivatives."""
        low, high = np.full(len(x), degree), count.copy()  # the interval from knot low on
        while (high - low > 1).any():
            middle = (low + high) // 2
            above = x >= knots[first + middle]
            low, high = np.where(above, middle, low), np.where(above, high, middle)
        at = first + low
        values, slopes = np.ones((len(x), 1)), np.zeros((len(x), 1))
        for k in range(1, degree + 1):
            right = knots[at[:, None] + np.arange(1, k + 1)]
            left = knots[at[:, None] + np.arange(1 - k, 1)]
            share = values / (right - left)
            grown = np.zeros((len(x), k + 1))
            grown[:, :-1] = (right - x[:, None]) * share
            grown[:, 1:] += (x[:, None] - left) * share
            if k == degree:
                slopes = np.zeros((len(x), k + 1))
                slopes[:, :-1] = -k * share
                slopes[:, 1:] += k * share
            values = grown
        return low - degree, values, slopes


@dataclass(frozen=True, eq=False)
class Layout:
    """Where limit faces are in faces: all as in `BSplineFaces`.

    Attributes
    ----------
    grid, limit_faces, turns, origin, size
    triangles : bool
        Whether faces are parts of limit faces.
    """

    grid: Array
    limit_faces: Array
    turns: Array
    origin: Array
    size: Array
    triangles: bool


def located(faces: Layout, limit_face: Array, place: Array) -> tuple[Array, Array, Array]:
    """Faces (Q,), u and v there, of checked places (Q, 2) on limit faces."""
    first = np.concatenate([[0], np.cumsum(faces.grid.prod(axis=1))])
    owner = np.repeat(np.arange(len(faces.grid)), np.diff(first))
    order = np.argsort(faces.limit_faces, kind="stable")
    keys = faces.limit_faces[order]
    begin, end = (np.searchsorted(keys, limit_face, side) for side in ("left", "right"))
    found = np.full(len(limit_face), -1)
    x = np.full(place.shape, np.nan)
    known = np.flatnonzero(end > begin)
    if not faces.triangles:
        cell = order[begin[known]]
        face = owner[cell]
        base, along, across = _TURNS[faces.turns[cell]].swapaxes(0, 1)
        from_base = place[known] - base
        own = np.stack([(from_base * along).sum(1), (from_base * across).sum(1)], axis=1)
        i, j = np.divmod(cell - first[face], faces.grid[face, 1])
        found[known], x[known] = face, own + np.stack([i, j], axis=1)
        return found, x[:, 0], x[:, 1]
    # a triangle is cut into parts: the one in which a place is deepest
    most = int((end - begin).max(initial=0))
    best = np.full(len(limit_face), -np.inf)
    for k in range(most):
        here = np.flatnonzero(begin + k < end)
        part = order[begin[here] + k]
        own = (place[here] - faces.origin[part]) / faces.size[part]
        inside = np.minimum(own.min(axis=1), 1 - own.sum(axis=1))
        better = inside > best[here]
        some = here[better]
        best[some], found[some], x[some] = inside[better], part[better], own[better]
    np.clip(x, 0, 1, out=x)
    return found, x[:, 0], x[:, 1]


def unturned(origin: Array, size: Array, turn: Array) -> tuple[Array, Array]:
    """Boxes (n, 2) of limit faces, as seen from their corners `turn` (n,)."""
    base, along, across = _TURNS[turn].swapaxes(0, 1)
    ends = []
    for at in (origin, origin + size):
        ends.append(np.stack([((at - base) * x).sum(axis=1) for x in (along, across)], axis=1))
    low = np.minimum(*ends)
    return low, np.maximum(*ends) - low


def on_limit_faces(faces: Layout, face: Array, place: Array) -> tuple[Array, Array]:
    """Limit faces (Q,) and places there (Q, 2) of places (Q, 2) of faces (Q,)."""
    first = np.cumsum(faces.grid.prod(axis=1)) - faces.grid.prod(axis=1)
    if faces.triangles:
        found = faces.origin[face] + faces.size[face] * place
        return faces.limit_faces[first[face]], np.clip(found, 0, 1)
    step = np.minimum(np.floor(np.nan_to_num(place)).astype(np.int64), faces.grid[face] - 1)
    cell = first[face] + step[:, 0] * faces.grid[face, 1] + step[:, 1]
    base, along, across = _TURNS[faces.turns[cell]].swapaxes(0, 1)
    own = place - step
    return faces.limit_faces[cell], base + own[:, :1] * along + own[:, 1:] * across
