"""The search for what is nearest: cells are halved until each has one foot, or none that counts.

Of a point and a cell, ``D = |x - q|^2`` is a polynomial. Its Bernstein coefficients bound it from
below, so that cells that are too far fall out; where they say that D falls towards a side, its foot
is on that side; where they say that D is convex, Newton's method finds its foot. Cells are taken
relative to one of their own points: what is far away does not swamp what differs in a cell.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from limitsurf.query.index import Cells
from limitsurf.query.polynomials import Form, line_values, lines, products
from limitsurf.query.records import Rows, taken

Array = NDArray[Any]

_EPS = 2.0**-52
# what sums of products of coefficients lose, of the largest: some 40 terms
LOST = 64 * _EPS
# distances that are told apart, of the largest coordinate
SAME = 2.0**-49
# of cells that are farther than this, of their size, feet are told by coefficients of D: next to
# a cell what rounding took of D, of the square of its size, is much of the distance
FAR = 0.25
# parts of the surface that are places: a foot there is known to this
POINT = 2.0**-46
_BATCH = 1 << 13  # pairs that are in memory at once
_AHEAD = 8  # rings that are made at once, at most
_STEPS = 24  # of Newton's method, at most
# of so many cells of a query none is halved that is smaller, and where the determinant of second
# derivatives of D is less, of the product of two of them, or one of these less, of the other
_CROWD, _TINY, _CURVE, _FLAT = 64, 2.0**-8, 0.05, 1e-3
# after so many cells of a query these are halved across their longer side in parameters, so that
# second derivatives of D are about constant in them: a surface that is thin has long valleys of D
_THIN = 1 << 10
# of each query so many cells are looked at before what is left open may be more than SAME, and
# that many again for each doubling
_BUDGET = 1 << 11
_DEEPEST = 160  # rings, where nothing bounds what remains


@dataclass(slots=True)
class Feet(Rows):
    """Places that may be the nearest ones, (n,): of a query, on a limit face, how far.

    `off` is by how much a foot would move if it could leave its cell, or is not one at all.
    """

    query: Array
    face: Array
    u: Array
    v: Array
    distance: Array
    off: Array

    @classmethod
    def none(cls) -> Self:
        """No feet."""
        whole, real = np.zeros(0, dtype=np.int64), np.zeros(0)
        return cls(whole, whole, real, real, real, real)


@dataclass(slots=True)
class _Pairs(Rows):
    """Queries and cells, or curves: points (n, 3) relative to one that is `base` from the query.

    ``(u, v) = frame[0] + s frame[1] + t frame[2]``; of curves ``frame[0] + s frame[1]``.
    """

    query: Array  # (P,)
    face: Array
    base: Array  # (P, 3)
    points: Array  # (P, n, 3)
    frame: Array  # (P, 3, 2) or (P, 2, 2)

    def halved(self, halves: Array, frames: Array) -> _Pairs:
        """Both halves (., 2, n, n) of all, relative to their own first point."""
        count, n = len(self), self.points.shape[1]
        points = np.matmul(halves, self.points[:, None]).reshape(2 * count, n, 3)
        frame = np.matmul(frames, self.frame[:, None, 1:])  # (P, 2, k, 2)
        frame[:, :, 0] += self.frame[:, None, 0]
        first = points[:, :1].copy()
        return _Pairs(
            np.repeat(self.query, 2),
            np.repeat(self.face, 2),
            np.repeat(self.base, 2, axis=0) + first[:, 0],
            points - first,
            frame.reshape(2 * count, -1, 2),
        )


@dataclass(slots=True)
class _Rests(Rows):
    """Queries and what remains at special corners from a ring on, (R,)."""

    query: Array
    which: Array
    ring: Array


@dataclass(slots=True)
class _Nodes:
    """Queries and boxes of one level of the hierarchy, (N,)."""

    query: Array
    node: Array
    level: int

    def __len__(self) -> int:
        return len(self.query)


class Search:
    """A search for what is nearest to points (Q, 3), at most `within` (Q,) away.

    With `every` all feet within these distances are sought, not the nearest ones.
    """

    def __init__(self, index: Cells, points: Array, within: Array, every: bool) -> None:
        self._index, self._points, self._every = index, points, every
        self._form = index.form
        self._lattice = index.lattice
        self.best = within.copy()
        self._nearest = self._reach(within)  # of the places that are kept
        self._found: list[Feet] = []
        self._looked = np.zeros(len(points), dtype=np.int64)  # at how many cells
        self._nodes: list[_Nodes] = []
        # what is yet to be looked at: cells, what is beyond them at corners, sides of cells
        self._pending: tuple[list[_Pairs], list[_Rests], list[_Pairs]] = ([], [], [])

    def run(self) -> Feet:
        """All places that may be the nearest ones, or are as near up to rounding."""
        index = self._index
        if not self._every:
            self._seed()
        first, every = index.levels[0][0], np.arange(len(self._points))
        for start in range(0, len(every), _BATCH):
            some = every[start : start + _BATCH]
            node = np.tile(np.arange(len(first)), len(some))
            self._nodes.append(_Nodes(np.repeat(some, len(first)), node, 0))
        cells, corners, sides = self._pending
        # (boxes are opened when little else is pending, so that memory does not grow with pairs)
        while self._nodes or cells or corners or sides:
            ready = sum(map(len, cells)) >= _BATCH // 2
            if sum(map(len, sides)) >= _BATCH:
                self._curves(taken(sides, _BATCH))
            elif not ready and sum(map(len, corners)) >= _BATCH:
                self._corners(taken(corners, _BATCH // 16))
            elif not ready and self._nodes:
                self._open(self._nodes.pop())
            elif cells:
                self._cells(taken(cells, _BATCH))
            elif corners:
                self._corners(taken(corners, _BATCH // 16))
            else:
                self._curves(taken(sides, _BATCH))
        return Feet.joined([Feet.none(), *self._found])

    def _open(self, nodes: _Nodes) -> None:
        """Boxes that are near enough: those in them, or the cells and corners that they are of."""
        index, level = self._index, nodes.level
        lower, upper = index.levels[level]
        query, node = nodes.query, nodes.node
        if len(node) > _BATCH:
            self._nodes.append(_Nodes(query[_BATCH:], node[_BATCH:], level))
            query, node = query[:_BATCH], node[:_BATCH]
        at = self._points[query]
        gap = np.maximum(np.maximum(lower[node] - at, at - upper[node]), 0)
        near = np.einsum("qd,qd->q", gap, gap) <= self._reach(self.best[query]) ** 2
        query, node = query[near], node[near]
        if level + 1 < len(index.levels):
            node, query = index.children(node, query, level)
            if len(node):
                self._nodes.append(_Nodes(query, node, level + 1))
            return
        leaf = index.order[node]
        corner = leaf >= len(index.points)
        self._push_cells(query[~corner], leaf[~corner])
        if corner.any():
            which = leaf[corner] - len(index.points)
            rests = _Rests(query[corner], which, np.zeros(len(which), dtype=np.int64))
            self._pending[1].append(rests)

    def _reach(self, best: Array) -> Array:
        """Distances up to which places count: what rounding may have done is added."""
        return best + SAME * (1 + best)

    def _seed(self) -> None:
        """Distances to some points of the surface, from the nearest middle of a cell on."""
        tree, middle = self._index.middles
        if tree is None:
            return
        _, cell = tree.query(self._points)
        s, t = (np.full(len(cell), x) for x in middle)
        for _ in range(3):
            w = self._form.values(s, t)
            x = np.matmul(w, self._index.points[cell])
            gap = x[:, 0] - self._points
            np.minimum(self.best, np.sqrt((gap**2).sum(axis=1)), out=self.best)
            step = _newton(gap, x)
            s, t = self._inside(s + step[0], t + step[1])
        x = np.matmul(self._form.values(s, t, 0), self._index.points[cell])[:, 0]
        np.minimum(self.best, np.sqrt(((x - self._points) ** 2).sum(axis=1)), out=self.best)

    def _inside(self, s: Array, t: Array) -> tuple[Array, Array]:
        """Places put into the domain."""
        s, t = np.clip(np.nan_to_num(s, nan=0.5), 0, 1), np.clip(np.nan_to_num(t, nan=0.5), 0, 1)
        if self._lattice.sloped:
            over = np.maximum(s + t - 1, 0) / 2
            s, t = np.clip(s - over, 0, 1), np.clip(t - over, 0, 1)
            t = np.minimum(t, 1 - s)
        return s, t

    def _push_cells(self, query: Array, cell: Array) -> None:
        index = self._index
        points = index.points[cell]
        first = points[:, :1].copy()
        base = first[:, 0] - self._points[query]
        self._push(_Pairs(query, index.face[cell], base, points - first, index.frames(cell)))

    def _push(self, pairs: _Pairs) -> None:
        if len(pairs):
            cells, _, sides = self._pending
            (cells if pairs.frame.shape[1] == 3 else sides).append(pairs)

    def _add(self, pairs: _Pairs, which: Array, places: Array, gap: Array, off: Array) -> None:
        """Places (n, 2) of pairs as feet; `gap` (n, 3) is from the query to them."""
        distance = np.sqrt((gap**2).sum(axis=1))
        query = pairs.query[which]
        if not self._every:
            np.minimum.at(self.best, query, distance)
        near = distance <= self._reach(self.best[query])
        if not self._every:
            # (what is known may be of a place that nobody keeps: the nearest one stays)
            near |= distance <= self._nearest[query]
            np.minimum.at(self._nearest, query, distance)
        k = np.flatnonzero(near)
        u, v = places[k].T
        self._found.append(Feet(query[k], pairs.face[which][k], u, v, distance[k], off[k]))

    # ------------------------------------------------------------------ special corners

    def _corners(self, rests: _Rests) -> None:
        """What remains at special corners: more rings of cells, or the corner itself."""
        query, which, ring = rests.query, rests.which, rests.ring
        beyond, index = self._index.beyond, self._index
        base = beyond.limits[which] - self._points[query]
        square = (base**2).sum(axis=1)
        far, along = beyond.reach(which, ring, base)
        if not self._every:
            np.minimum.at(self.best, query, np.sqrt(square))
        least = np.maximum(
            np.maximum(square - 2 * along, np.maximum(np.sqrt(square) - far, 0) ** 2), 0
        )
        keep = np.flatnonzero(least <= self._reach(self.best[query]) ** 2)
        query, which, ring, base, far = (x[keep] for x in (query, which, ring, base, far))
        leaf = which + len(index.points)
        done = (far <= POINT / 2) | (ring >= _DEEPEST)
        if done.any():
            some = np.flatnonzero(done)
            ends = self._form.ends[beyond.corner(which[some])]
            places = index.origin[leaf[some]] + index.size[leaf[some]] * ends
            off = self._tangential(which[some], base[some])
            frame = np.zeros((len(some), 3, 2))
            none = np.zeros((len(some), 1, 3))
            at = _Pairs(query[some], index.face[leaf[some]], base[some], none, frame)
            self._add(at, np.arange(len(some)), places, base[some], off)
        query, which, ring, base, leaf = (x[~done] for x in (query, which, ring, base, leaf))
        if not len(query):
            return
        # more and more rings at a time
        more = np.minimum(ring + 1, _AHEAD)
        self._pending[1].append(_Rests(query, which, ring + more))
        step = np.arange(int(more.sum())) - np.repeat(np.cumsum(more) - more, more)
        query, which, base, leaf = (np.repeat(x, more, axis=0) for x in (query, which, base, leaf))
        ring = np.repeat(ring, more) + step
        found = beyond.cells(which, ring)
        pieces = found.points.shape[1]
        frame, n = index.ring_frames(which, found.origin, found.size), self._form.size
        pairs = _Pairs(
            np.repeat(query, pieces),
            np.repeat(index.face[leaf], pieces),
            np.repeat(base, pieces, axis=0),
            found.points.reshape(-1, n, 3),
            frame.reshape(-1, 3, 2),
        )
        # those that are farther than the corner itself say so best relative to it
        if not self._every:
            low, _, lost = self._differences(pairs)
            pairs = pairs[low <= lost]
        first = pairs.points[:, :1].copy()
        pairs.base, pairs.points = pairs.base + first[:, 0], pairs.points - first
        self._push(pairs)

    def _tangential(self, which: Array, base: Array) -> Array:
        """How far the feet of queries are from corners, in their tangent planes, about."""
        a, b = self._index.beyond.tangents(which)
        off = np.where(self._index.beyond.is_smooth[which], in_plane(base, a, b), 0)
        return np.asarray(off)

    # ------------------------------------------------------------------ cells and curves

    def _differences(self, pairs: _Pairs) -> tuple[Array, Array, Array]:
        """Bounds (P,) from below of D - |base|^2, its coefficients (P, m), what rounding took."""
        x, w = pairs.points, pairs.base
        n = x.shape[1]
        if pairs.frame.shape[1] == 3:
            means = products(self._lattice, self._form.degree)
        else:
            means = lines(self._form.degree)[2]
        gram = np.matmul(x, (x + 2 * w[:, None]).swapaxes(1, 2)).reshape(len(x), n * n)
        found = gram @ means
        size = np.sqrt((x**2).sum(axis=2).max(axis=1))
        lost = LOST * size * (size + 2 * np.sqrt((w**2).sum(axis=1)))
        return found.min(axis=1), found, lost

    def _alive(self, pairs: _Pairs, low: Array, lost: Array) -> tuple[Array, Array]:
        """Which of them may yet be as near as what is known, and are these far (`FAR`)."""
        base = (pairs.base**2).sum(axis=1)
        least = np.sqrt(np.maximum(base * (1 - 4 * _EPS) + low - lost, 0))
        keep = np.flatnonzero(least <= self._reach(self.best[pairs.query]))
        size = np.sqrt((pairs.points[keep] ** 2).sum(axis=2).max(axis=1, initial=0))
        return keep, least[keep] >= FAR * size

    def _ends(self, pairs: _Pairs, corners: Array) -> _Pairs:
        """Those of which hulls may be near enough; their corners may be nearer than what is known.

        A hull is as far as its points are along a direction: that of the nearest corner here.
        """
        gap = pairs.points[:, corners] + pairs.base[:, None]
        square = (gap**2).sum(axis=2)
        k = square.argmin(axis=1)
        every = np.arange(len(k))
        nearest, way = np.sqrt(square[every, k]), gap[every, k]
        if not self._every:
            np.minimum.at(self.best, pairs.query, nearest)
        along = np.matmul(pairs.points, way[:, :, None])[:, :, 0].min(axis=1)
        along += (pairs.base * way).sum(axis=1)
        lost = LOST * nearest * (1 + nearest)
        return pairs[np.flatnonzero(along - lost <= nearest * self._reach(self.best[pairs.query]))]

    def _cells(self, pairs: _Pairs) -> None:
        form = self._form
        pairs = self._ends(pairs, form.corners)
        low, d, lost = self._differences(pairs)
        keep, far = self._alive(pairs, low, lost)
        pairs, low, d, lost = pairs[keep], low[keep], d[keep], lost[keep]
        keep = self._worth(pairs, low, form.corners)
        pairs, low, d, lost, far = pairs[keep], low[keep], d[keep], lost[keep], far[keep]
        twice = Form.of(self._lattice, 2 * form.degree)
        keep = self._at_corner(pairs, d[:, twice.corners], np.where(far, lost, -np.inf), low)
        pairs, d, lost, far = pairs[keep], d[keep], lost[keep], far[keep]
        if not len(pairs):
            return
        m = twice.size
        every = (d @ twice.derivatives[1:].transpose(2, 0, 1).reshape(m, -1)).reshape(-1, 5, m)
        scale = lost[:, None] * twice.degree
        rest = np.ones(len(pairs), dtype=bool)
        # falling towards a side: its foot is there
        for k, (a, b) in enumerate(form.inward.tolist()):
            slope = (a * every[:, 0] + b * every[:, 1]).min(axis=1)
            side = np.flatnonzero(rest & far & (slope >= -scale[:, 0]))
            if len(side):
                rest[side] = False
                self._push(self._side(pairs, side, k))
        bent = every[:, [2, 4]].min(axis=2)
        mixed = np.abs(every[:, 3]).max(axis=1)
        more = lost * twice.degree**2
        convex = (bent > more[:, None]).all(axis=1)
        convex &= np.prod(np.maximum(bent - more[:, None], 0), axis=1) > (mixed + more) ** 2
        convex &= rest
        self._newton(pairs, np.flatnonzero(convex))
        self._halve(pairs[rest & ~convex])

    def _worth(self, pairs: _Pairs, low: Array, corners: Array) -> Array:
        """Which cells are worth halving; the others, of queries with very many, are settled.

        Those can be nearer than what is known by a small share of the distance alone.
        """
        self._looked += np.bincount(pairs.query, minlength=len(self.best))
        times = self._looked[pairs.query] // _BUDGET
        if not times.any():
            return np.arange(len(pairs))
        base = (pairs.base**2).sum(axis=1)
        least = np.sqrt(np.maximum(base + low, 0))
        most = self.best[pairs.query]
        if self._every:
            gap = pairs.points[:, corners] + pairs.base[:, None]
            most = np.sqrt((gap**2).sum(axis=2).min(axis=1))
        spare = np.ldexp(SAME * (1 + most), np.minimum(times, 60))
        left = (times > 0) & (most - least <= spare)
        self._settle(pairs[left])
        return np.flatnonzero(~left)

    def _at_corner(self, pairs: _Pairs, at: Array, lost: Array, low: Array) -> Array:
        """Those that are left if those are taken whose foot is a corner, or that are a point.

        With D at their corners (P, c), and what it may fall short of that.
        """
        form = self._form
        k = at.argmin(axis=1)
        every = np.arange(len(pairs))
        small = (pairs.points**2).sum(axis=2).max(axis=1) <= POINT**2
        done = (at[every, k] - low <= lost) | small
        which = np.flatnonzero(done)
        if len(which):
            near = k[which]
            gap = pairs.base[which] + pairs.points[which, form.corners[near]]
            ends = form.ends[near]
            frame = pairs.frame[which]
            places = frame[:, 0] + np.matmul(ends[:, None], frame[:, 1:])[:, 0]
            off = self._off(pairs, which, ends[:, 0], ends[:, 1])
            self._add(pairs, which, places, gap, off)
        return np.flatnonzero(~done)

    def _off(self, pairs: _Pairs, which: Array, s: Array, t: Array) -> Array:
        """How far feet would move in the tangent planes at places of cells, (n,)."""
        x = np.matmul(self._form.values(s, t)[:, :3], pairs.points[which])
        return in_plane(x[:, 0] + pairs.base[which], x[:, 1], x[:, 2])

    def _side(self, pairs: _Pairs, which: Array, k: int) -> _Pairs:
        """Sides of cells as curves."""
        form = self._form
        start, end = form.ends[k], form.ends[(k + 1) % len(form.ends)]
        points = pairs.points[which][:, form.edges[k]]
        first = points[:, :1].copy()
        frame = pairs.frame[which]
        ends = frame[:, :1] + np.matmul(np.stack([start, end]), frame[:, 1:])
        ends[:, 1] -= ends[:, 0]
        base = pairs.base[which] + first[:, 0]
        return _Pairs(pairs.query[which], pairs.face[which], base, points - first, ends)

    def _newton(self, pairs: _Pairs, which: Array) -> None:
        """Feet of convex cells: inside, or on their sides."""
        if not len(which):
            return
        form, some = self._form, pairs[which]
        middle = form.ends.mean(axis=0)
        s, t = (np.full(len(which), x) for x in middle)
        last = np.full(len(which), np.inf)
        active = np.arange(len(which))
        for _ in range(_STEPS):
            x = np.matmul(form.values(s[active], t[active]), some.points[active])
            ds, dt = _newton(x[:, 0] + some.base[active], x)
            s[active] = np.clip(s[active] + ds, -0.5, 1.5)
            t[active] = np.clip(t[active] + dt, -0.5, 1.5)
            size = np.maximum(np.abs(ds), np.abs(dt))
            settled = (size <= 4 * _EPS) | ((size <= 1e-10) & (size >= 0.5 * last[active]))
            last[active] = size
            active = active[~settled]
            if not len(active):
                break
        settled = last <= 1e-9
        places = np.stack([np.ones(len(s)), s, t])
        sides = np.array([[a, b, c] for a, b, c in self._lattice.edges], dtype=float)
        inside = settled & (sides @ places >= -1e-13).all(axis=0)
        outside = settled & (sides @ places < -1e-13).any(axis=0)
        s, t = self._inside(s, t)
        here = np.flatnonzero(inside)
        if len(here):
            x = np.matmul(form.values(s[here], t[here])[:, :3], some.points[here])
            gap = x[:, 0] + some.base[here]
            st = np.stack([s[here], t[here]], axis=1)
            frame = some.frame[here]
            uv = frame[:, 0] + np.matmul(st[:, None], frame[:, 1:])[:, 0]
            self._add(some, here, uv, gap, in_plane(gap, x[:, 1], x[:, 2]))
        there = np.flatnonzero(outside)
        for k in range(len(form.ends) if len(there) else 0):
            self._push(self._side(some, there, k))
        self._halve(some[~settled])

    def _halve(self, pairs: _Pairs) -> None:
        """Halves of cells, across their longer side; no more of very many small ones."""
        if len(pairs) > _CROWD:
            crowd = np.bincount(pairs.query, minlength=len(self.best))[pairs.query] > _CROWD
            crowd &= np.abs(pairs.frame[:, 1:]).max(axis=(1, 2)) < _TINY
            crowd[crowd] = self._is_curve(pairs[crowd])
            self._settle(pairs[crowd])
            pairs = pairs[~crowd]
        if not len(pairs):
            return
        form = self._form
        ends = pairs.points[:, form.corners]
        a, b = form.across.T
        if len(form.ends) == 3:
            span = ((ends[:, a] - ends[:, b]) ** 2).sum(axis=2)
        else:
            n = form.degree + 1
            net = pairs.points.reshape(len(pairs), n, n, 3)
            span = np.stack(
                [
                    (np.diff(net, axis=1 + axis) ** 2).sum(axis=3).max(axis=(1, 2))
                    for axis in (0, 1)
                ],
                axis=1,
            )
        thin = np.flatnonzero(self._looked[pairs.query] > _THIN)
        at = np.matmul(form.ends, pairs.frame[thin, 1:])
        span[thin] = ((at[:, a] - at[:, b]) ** 2).sum(axis=2)
        way = span.argmax(axis=1)
        self._push(pairs.halved(form.halves[way], form.frames[way]))

    def _is_curve(self, pairs: _Pairs) -> Array:
        """Whether squared distances in cells change along one direction alone, (n,)."""
        s, t = (np.full(len(pairs), x) for x in self._form.ends.mean(axis=0))
        x = np.matmul(self._form.values(s, t), pairs.points)
        gap, du, dv = x[:, 0] + pairs.base, x[:, 1], x[:, 2]
        first, mixed, second = (
            (p * q).sum(axis=1) + (gap * x[:, k]).sum(axis=1)
            for p, q, k in ((du, du, 3), (du, dv, 4), (dv, dv, 5))
        )
        both = np.abs(first * second)
        small, large = np.sort(np.abs([first, second]), axis=0)
        along = (np.abs(first * second - mixed**2) <= _CURVE * both) | (small <= _FLAT * large)
        return np.asarray(along)

    def _settle(self, pairs: _Pairs) -> None:
        """Feet of cells of a surface that is a mere curve, on all of which a point has feet."""
        s, t = (np.full(len(pairs), x) for x in self._form.ends.mean(axis=0))
        for _ in range(_STEPS if len(pairs) else 0):
            x = np.matmul(self._form.values(s, t), pairs.points)
            ds, dt = _newton(x[:, 0] + pairs.base, x)
            s, t = self._inside(s + ds, t + dt)
        if len(pairs):
            x = np.matmul(self._form.values(s, t)[:, :3], pairs.points)
            gap, st = x[:, 0] + pairs.base, np.stack([s, t], axis=1)
            uv = pairs.frame[:, 0] + np.matmul(st[:, None], pairs.frame[:, 1:])[:, 0]
            self._add(pairs, np.arange(len(pairs)), uv, gap, in_plane(gap, x[:, 1], x[:, 2]))

    def _curves(self, pairs: _Pairs) -> None:
        degree = self._form.degree
        derivatives, halves, _, twice = lines(degree)
        pairs = self._ends(pairs, np.array([0, degree]))
        low, d, lost = self._differences(pairs)
        keep, far = self._alive(pairs, low, lost)
        pairs, low, d, lost = pairs[keep], low[keep], d[keep], lost[keep]
        if not len(pairs):
            return
        at = d[:, [0, -1]]
        k = at.argmin(axis=1)
        small = (pairs.points**2).sum(axis=2).max(axis=1) <= POINT**2
        done = (far & (at[np.arange(len(k)), k] - low <= lost)) | small
        which = np.flatnonzero(done)
        self._on_curve(pairs, which, k[which].astype(float))
        bent = (d @ twice[2].T).min(axis=1)
        convex = ~done & (bent > lost * (2 * degree) ** 2)
        which = np.flatnonzero(convex)
        if len(which):
            some, x, before = pairs[which], np.full(len(which), 0.5), np.zeros(len(which))
            stacked = derivatives.transpose(1, 0, 2).reshape(degree + 1, -1)
            active = np.arange(len(which))
            for _ in range(_STEPS):
                weights = (line_values(degree, x[active]) @ stacked).reshape(len(active), 3, -1)
                c = np.matmul(weights, some.points[active])
                gap = c[:, 0] + some.base[active]
                slope = (gap * c[:, 1]).sum(axis=1)
                step = -slope / ((c[:, 1] ** 2).sum(axis=1) + (gap * c[:, 2]).sum(axis=1))
                before[active] = x[active]
                x[active] = np.clip(x[active] + np.nan_to_num(step), 0, 1)
                active = active[np.abs(x[active] - before[active]) > 4 * _EPS]
                if not len(active):
                    break
            settled = np.abs(x - before) <= 1e-9
            self._on_curve(pairs, which[settled], x[settled])
            convex[which[~settled]] = False
        rest = pairs[~done & ~convex]
        if len(rest):
            frames = np.array([[[0.0], [0.5]], [[0.5], [0.5]]])
            self._push(rest.halved(halves[None], frames[None]))

    def _on_curve(self, pairs: _Pairs, which: Array, x: Array) -> None:
        """Feet on the sides of cells."""
        if not len(which):
            return
        values = line_values(self._form.degree, x)
        gap = np.matmul(values[:, None], pairs.points[which])[:, 0] + pairs.base[which]
        frame = pairs.frame[which]
        places = frame[:, 0] + x[:, None] * frame[:, 1]
        self._add(pairs, which, places, gap, np.full(len(which), np.nan))


def _newton(gap: Array, x: Array) -> tuple[Array, Array]:
    """Steps (ds, dt) of Newton's method for D, of Gauss's where that is not convex."""
    g1, g2 = ((gap * x[:, k]).sum(axis=1) for k in (1, 2))
    a, b, c = ((x[:, i] * x[:, j]).sum(axis=1) for i, j in ((1, 1), (1, 2), (2, 2)))
    e, f, h = ((gap * x[:, k]).sum(axis=1) for k in (3, 4, 5))
    full = (a + e > 0) & ((a + e) * (c + h) > (b + f) ** 2)
    a, b, c = (np.where(full, m + n, m) for m, n in ((a, e), (b, f), (c, h)))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        det = a * c - b * b
        ds, dt = (b * g2 - c * g1) / det, (b * g1 - a * g2) / det
        # the shortest step where all along a line are as good
        flat = det <= 1e-12 * a * c
        ds, dt = (np.where(flat, -g / (a + c), x) for g, x in ((g1, ds), (g2, dt)))
    bad = ~(np.isfinite(ds) & np.isfinite(dt))
    return np.where(bad, 0, ds), np.where(bad, 0, dt)


def in_plane(gap: Array, a: Array, b: Array) -> Array:
    """Lengths of the parts of vectors (n, 3) in the planes of two others; along one if parallel."""
    with np.errstate(divide="ignore", invalid="ignore"):
        a = a / np.sqrt((a**2).sum(axis=1, keepdims=True))
        a = np.nan_to_num(a)
        b = b - (a * b).sum(axis=1, keepdims=True) * a
        b = np.nan_to_num(b / np.sqrt((b**2).sum(axis=1, keepdims=True)))
    return np.asarray(np.hypot((gap * a).sum(axis=1), (gap * b).sum(axis=1)))
