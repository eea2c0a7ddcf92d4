"""The search for crossings of rays and cells: cells are halved until each is crossed at most once.

A ray's *plane* is that of two coordinates of space when it is sheared along the ray onto the
coordinate plane across its largest direction: there the ray is the origin, and a cell is a map of
two parameters to two coordinates of which the zeros are sought. Divided by its mean derivative the
map is near the identity on small cells; where no derivative is farther from it than `NEAR`,
Newton's method, clamped to the cell, finds the only zero or says that there is none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from limitsurf.query.index import Cells
from limitsurf.query.records import Rows, taken
from limitsurf.scheme.lattice import Lattice

Array = NDArray[Any]

# what rounding may do to coordinates, of the largest: neighbours meet up to this
SLACK = 2.0**-46
# parts of the surface that are places
_POINT = 2.0**-45
NEAR = 0.3  # how far derivatives are from the identity, at most, where Newton's method contracts
_STEPS, _ALONG = 40, 6  # of Newton's method, at most, and along sides
TIED = 2.0**-19  # depths within which hits may be one
_BATCH = 1 << 13  # pairs that are in memory at once
_AHEAD = 8  # rings that are made at once, at most
_DEEPEST = 160  # rings, where nothing bounds what remains
_SMALLEST = 2.0**-300  # parts of limit faces that are halved no more
TIE = 2.0**-38  # depths of hits of which the smallest limit face is to be known
# of so many cells of a ray at once none is halved that is smaller, if the area that its mean
# derivatives span is less, of the product of their lengths; and none after so many halvings for
# each cell that the ray meets
_CROWD, _TINY, _CURVE, _BUDGET = 64, 2.0**-8, 1e-3, 1024
_CROWDED = 1 << 20  # rays and boxes that are in memory at once, but for those of one ray
WIDE = 2.0**100  # of boxes that bound nothing
BLUR = 2.0**-20  # along rays, within which hits may be one at most
_LONGEST = 2.0**400  # coordinates of which the squares are numbers


@dataclass(slots=True)
class Hits(Rows):
    """Where rays cross cells, (n,), some of them more than once, on neighbours.

    `depth` is in the unit of the index along the largest direction; `blur` how well it is known;
    `sign` 1 where the ray leaves through the front, -1 where it enters, 0 where it touches or
    nothing is known. `rim` says that it is on the rim of a cell, `touch` that it does not cross.
    """

    ray: Array
    face: Array
    u: Array
    v: Array
    depth: Array
    t: Array
    blur: Array
    sign: Array
    rim: Array
    touch: Array

    @classmethod
    def none(cls) -> Self:
        """No hits."""
        whole, real, flag = np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0, dtype=bool)
        return cls(whole, whole, real, real, real, real, real, whole, flag, flag)


@dataclass(slots=True)
class Rays(Rows):
    """Rays in the unit of an index, sheared.

    Attributes
    ----------
    axes : (Q, 3) int
        The coordinates of the plane, then that of the largest direction: cyclic.
    slope : (Q, 2)
        What the ray goes in the plane for each unit along the largest direction.
    start : (Q, 2)
        Where it is in the plane after the shear.
    along : (Q,)
        The largest coordinate of directions, in [1/2, 1) but for the sign.
    origin : (Q,)
        Of the ray along its largest direction.
    power : (Q,)
        ``t`` is in units of 2 to this power.
    least, most : (Q,)
        Of t, as given.
    """

    axes: Array
    slope: Array
    start: Array
    along: Array
    origin: Array
    power: Array
    least: Array
    most: Array

    @classmethod
    def of(cls, power: int, origins: Array, directions: Array, least: Array, most: Array) -> Self:
        """Those of finite origins and directions (Q, 3), which are not zero."""
        size = np.frexp(np.abs(directions).max(axis=1, initial=0))[1]
        with np.errstate(over="ignore", under="ignore", invalid="ignore"):
            way = np.ldexp(directions, -size[:, None])
            start = np.clip(np.ldexp(origins, power), -(2.0**1000), 2.0**1000)
            main = np.abs(way).argmax(axis=1)
            axes = (main[:, None] + np.array([1, 2, 0])) % 3
            way, start = (np.take_along_axis(x, axes, axis=1) for x in (way, start))
            along, origin = way[:, 2], start[:, 2]
            slope = way[:, :2] / along[:, None]
            # what rounding took, as origins may be far away
            rest = -_lost(slope, along[:, None], way[:, :2]) / along[:, None]
            plane = slope * origin[:, None]
            off = start[:, :2] - plane
            plane = off - _lost(slope, origin[:, None], plane) - rest * origin[:, None]
            plane = np.where(np.abs(origin[:, None]) < _LONGEST, plane, off)
        return cls(axes, slope, plane, along, origin, -(size + power), least, most)

    def sheared(self, ray: Array, points: Array) -> Array:
        """Points (P, n, 3) of the unit of the index as rays (P,) see them: plane, then depth."""
        found = np.take_along_axis(points, self.axes[ray][:, None], axis=2)
        found[..., :2] -= self.slope[ray][:, None] * found[..., 2:] + self.start[ray][:, None]
        return np.asarray(found)

    def time(self, ray: Array, depth: Array) -> Array:
        """Parameters t of depths, (P,) or (P, n)."""
        shape = (-1, *[1] * (depth.ndim - 1))
        with np.errstate(over="ignore", under="ignore"):
            z = (depth - self.origin[ray].reshape(shape)) / self.along[ray].reshape(shape)
            return np.asarray(np.ldexp(z, self.power[ray].reshape(shape)))

    def in_range(self, ray: Array, low: Array, high: Array, best: Array) -> Array:
        """Whether depths between `low` and `high` (P,) may be of t that count."""
        low, high = low - TIE, high + TIE
        first, last = np.sort(self.time(ray, np.stack([low, high], axis=1)), axis=1).T
        return np.asarray((last >= self.least[ray]) & (first <= best[ray]))


def _lost(a: Array, b: Array, product: Array) -> Array:
    """``a * b - product`` where `product` is near it, by halves of digits (Dekker 1971)."""
    halves = []
    for x in (a, b):
        big = x * 134217729.0
        high = big - (big - x)
        halves.append((high, x - high))
    (a1, a2), (b1, b2) = halves
    return np.asarray(((a1 * b1 - product) + a1 * b2 + a2 * b1) + a2 * b2)


@dataclass(slots=True)
class _Pairs(Rows):
    """Rays and cells: coefficients (n, 3) in the plane of the ray and along it.

    ``(u, v) = frame[0] + s frame[1] + t frame[2]``.
    """

    ray: Array  # (P,)
    face: Array
    points: Array  # (P, n, 3)
    frame: Array  # (P, 3, 2)


@dataclass(slots=True)
class _Rests(Rows):
    """Rays and what remains at special corners from a ring on, (R,)."""

    ray: Array
    which: Array
    ring: Array


@dataclass(slots=True)
class _Kind:
    """What hits are: `blur`, `sign`, `rim`, (n,), and `touch`, as `Hits` has them."""

    blur: Array
    sign: Array
    rim: Array
    touch: Any = False


class Crossings:
    """A search for crossings of rays (Q,): of `every` one, or of what may be the first.

    With `any_` no more than one is sought.
    """

    def __init__(self, index: Cells, rays: Rays, every: bool, any_: bool = False) -> None:
        self._index, self._rays, self._every, self._any = index, rays, every, any_
        self._form, self._lattice = index.form, index.lattice
        self.best = rays.most.copy()
        self._found = [Hits.none()]
        self._cells: list[_Pairs] = []
        self._corners: list[_Rests] = []
        # cells that were met, and that were halved
        self._met, self._halved = np.zeros((2, len(rays)), dtype=np.int64)

    def run(self) -> Hits:
        """All crossings that may count."""
        parts = [np.arange(len(self._rays))]
        while parts:
            some = parts.pop()
            near = self._near(some)
            if near is None:
                half = len(some) // 2
                parts += [some[half:], some[:half]]
            else:
                self._search(*near)
        return Hits.joined(self._found)

    def _search(self, ray: Array, leaf: Array) -> None:
        """Crossings with cells and corners (P,)."""
        n = len(self._index.points)
        for start in reversed(range(0, len(ray), _BATCH)):
            r, k = ray[start : start + _BATCH], leaf[start : start + _BATCH]
            cell, corner = np.flatnonzero(k < n), np.flatnonzero(k >= n)
            if len(cell):
                self._push_cells(r[cell], k[cell])
            if len(corner):
                rests = _Rests(r[corner], k[corner] - n, np.zeros(len(corner), dtype=np.int64))
                self._corners.append(rests)
            while self._cells or self._corners:
                if self._cells:
                    self._one_batch(taken(self._cells, _BATCH))
                else:
                    self._beyond(taken(self._corners, _BATCH // 16))

    # ------------------------------------------------------------------ boxes

    def _near(self, some: Array) -> tuple[Array, Array] | None:
        """Rays and leaves whose boxes they may cross: the first of each ray first.

        None if these are too many at once.
        """
        rays, levels = self._rays, self._index.levels
        ray = np.repeat(some, len(levels[0][0]))
        node = np.tile(np.arange(len(levels[0][0])), len(some))
        first = np.zeros(0)
        for depth, (lower, upper) in enumerate(levels):
            if depth:
                node, ray = self._index.children(node, ray, depth - 1)
            if len(ray) > _CROWDED and len(some) > 1:
                return None
            box = [np.clip(x[node], -WIDE, WIDE)[:, None] for x in (lower, upper)]
            low, high = (np.take_along_axis(x, rays.axes[ray][:, None], axis=2)[:, 0] for x in box)
            middle, half = (low + high) / 2, (high - low) / 2 + SLACK
            slope = rays.slope[ray]
            off = middle[:, :2] - slope * middle[:, 2:] - rays.start[ray]
            keep = (np.abs(off) <= half[:, :2] + np.abs(slope) * half[:, 2:]).all(axis=1)
            across = slope[:, 0] * off[:, 1] - slope[:, 1] * off[:, 0]
            wide = np.abs(slope[:, 0]) * half[:, 1] + np.abs(slope[:, 1]) * half[:, 0]
            keep &= np.abs(across) <= wide + SLACK
            keep &= rays.in_range(ray, low[:, 2], high[:, 2], self.best)
            first = np.where(rays.along[ray] > 0, low[:, 2], -high[:, 2])[keep]
            ray, node = ray[keep], node[keep]
        # the nearest of each ray, then the next of each
        order = np.lexsort((first, ray))
        ray, node = ray[order], node[order]
        if not self._every and len(ray):
            start = np.searchsorted(ray, ray)
            order = np.argsort(np.arange(len(ray)) - start, kind="stable")
            ray, node = ray[order], node[order]
        return ray, self._index.order[node]

    def _push_cells(self, ray: Array, cell: Array) -> None:
        index = self._index
        self._met += np.bincount(ray, minlength=len(self._met))
        points = self._rays.sheared(ray, index.points[cell])
        self._cells.append(_Pairs(ray, index.face[cell], points, index.frames(cell)))

    # ------------------------------------------------------------------ special corners

    def _beyond(self, rests: _Rests) -> None:
        """What remains at special corners: more rings of cells, or the corner itself."""
        rays, beyond, index = self._rays, self._index.beyond, self._index
        tip = rays.sheared(rests.ray, beyond.limits[rests.which][:, None])[:, 0]
        # a vector in space of which the product with others is what they go towards the ray
        towards = np.zeros((len(rests), 3))
        way = tip[:, :2].copy()
        size = np.sqrt((way**2).sum(axis=1, keepdims=True))
        way = np.divide(way, size, out=np.zeros_like(way), where=size > 0)
        slope = rays.slope[rests.ray]
        both = np.column_stack([way, -(way * slope).sum(axis=1)])
        np.put_along_axis(towards, rays.axes[rests.ray], both, axis=1)
        far, along = beyond.reach(rests.which, rests.ring, towards)
        keep = size[:, 0] <= np.minimum(along, 2 * far) + SLACK
        keep &= rays.in_range(rests.ray, tip[:, 2] - far, tip[:, 2] + far, self.best)
        rests, tip, far, size = rests[keep], tip[keep], far[keep], size[keep, 0]
        done = (far <= _POINT / 2) | (rests.ring >= _DEEPEST)
        at = done & (size <= 2 * _POINT)
        if at.any():
            some = rests[at]
            leaf = some.which + len(index.points)
            ends = self._form.ends[beyond.corner(some.which)]
            places = index.origin[leaf] + index.size[leaf] * ends
            n, face = len(some), index.face[leaf]
            blur = np.full(n, 4 * _POINT)
            kind = _Kind(blur, np.zeros(n), np.ones(n), ~beyond.is_smooth[some.which])
            self._add(some.ray, face, places, tip[at, 2], kind)
        self._rings(rests[~done])

    def _rings(self, rests: _Rests) -> None:
        """Cells of the next rings at corners."""
        if not len(rests):
            return
        beyond, index = self._index.beyond, self._index
        more = np.minimum(rests.ring + 1, _AHEAD)
        self._corners.append(_Rests(rests.ray, rests.which, rests.ring + more))
        step = np.arange(int(more.sum())) - np.repeat(np.cumsum(more) - more, more)
        ray, which = (np.repeat(x, more) for x in (rests.ray, rests.which))
        # (many rays may ask for the same)
        ring = np.repeat(rests.ring, more) + step
        _, first, same = np.unique(
            which * (_DEEPEST + _AHEAD) + ring, return_index=True, return_inverse=True
        )
        found = beyond.cells(which[first], ring[first])
        leaf, pieces = which + len(index.points), found.points.shape[1]
        frame = index.ring_frames(which, found.origin[same], found.size[same])
        ray = np.repeat(ray, pieces)
        self._met += np.bincount(ray, minlength=len(self._met))
        points = found.points[same] + beyond.limits[which][:, None, None]
        points = self._rays.sheared(ray, points.reshape(len(ray), -1, 3))
        face = np.repeat(index.face[leaf], pieces)
        self._cells.append(_Pairs(ray, face, points, frame.reshape(-1, 3, 2)))

    # ------------------------------------------------------------------ cells

    def _one_batch(self, pairs: _Pairs) -> None:
        """Leave out what rays miss; find the zeros of what is simple, and halve the rest."""
        low, high = pairs.points.min(axis=1), pairs.points.max(axis=1)
        keep = ((low[:, :2] <= SLACK) & (high[:, :2] >= -SLACK)).all(axis=1)
        keep &= self._rays.in_range(pairs.ray, low[:, 2], high[:, 2], self.best)
        pairs = pairs[np.flatnonzero(keep)]
        form, n = self._form, self._form.size
        x = np.ascontiguousarray(pairs.points[..., :2].swapaxes(1, 2))  # (P, 2, n)
        means = form.derivatives[1:3].mean(axis=1)
        mean = (x.reshape(-1, n) @ means.T).reshape(-1, 2, 2).swapaxes(1, 2)  # (P, derivative, 2)
        # along the longer of both derivatives, and across it
        longer = (mean**2).sum(axis=2).argmax(axis=1)
        way = mean[np.arange(len(mean)), longer]
        size = np.sqrt((way**2).sum(axis=1, keepdims=True))
        way = np.where(size > 0, way / np.where(size > 0, size, 1), [1.0, 0.0])
        across = x[:, 1] * way[:, :1] - x[:, 0] * way[:, 1:]
        along = x[:, 0] * way[:, :1] + x[:, 1] * way[:, 1:]
        keep = _has_zero(across, SLACK) & _has_zero(along, SLACK)
        back, known = _inverse(mean)
        own = np.matmul(back.swapaxes(1, 2), x)
        spare = SLACK * np.abs(back).sum(axis=1)
        for k in (0, 1):
            keep &= ~known | _has_zero(own[:, k], spare[:, k])
        tiny = np.abs(pairs.frame[:, 1:]).max(axis=(1, 2)) < _SMALLEST
        flat = (np.abs(across).max(axis=1, initial=0) <= SLACK) | tiny
        flat |= self._crowded(pairs, keep & ~flat, mean)
        some = np.flatnonzero(keep & flat)
        self._touch(pairs[some], way[some])
        some = np.flatnonzero(keep & ~flat)
        known, back = known[some], back[some]
        single = known & (self._bend(own[some]) <= NEAR**2)
        self._newton(pairs[some[single]], back[single])
        self._halve(pairs[some[~single]])

    def _crowded(self, pairs: _Pairs, which: Array, mean: Array) -> Array:
        """Which cells of rays with very many are halved no more: small ones, mere curves."""
        found = which & (self._halved > _BUDGET * self._met)[pairs.ray]
        crowd = np.bincount(pairs.ray[which], minlength=len(self._met)) > _CROWD + 4 * self._met
        some = np.flatnonzero(which & crowd[pairs.ray])
        some = some[np.abs(pairs.frame[some, 1:]).max(axis=(1, 2)) < _TINY]
        du, dv = mean[some, 0], mean[some, 1]
        det = np.abs(du[:, 0] * dv[:, 1] - du[:, 1] * dv[:, 0])
        both = np.sqrt((du**2).sum(axis=1) * (dv**2).sum(axis=1))
        found[some] |= det <= _CURVE * both
        return found

    def _bend(self, own: Array) -> Array:
        """Bounds (P,) of squares of how far derivatives of maps (P, 2, n) are from the identity."""
        n = self._form.size
        slopes = own.reshape(-1, n) @ self._form.derivatives[1:3].reshape(-1, n).T
        slopes = slopes.reshape(len(own), 2, 2, n)  # (P, coordinate, derivative, n)
        for k in (0, 1):
            slopes[:, k, k] -= 1
        slopes *= slopes
        return np.asarray((slopes[:, 0] + slopes[:, 1]).max(axis=2).sum(axis=1))

    def _newton(self, pairs: _Pairs, back: Array) -> None:
        """The zeros of cells that have one at most."""
        if not len(pairs):
            return
        form = self._form
        plane = np.matmul(pairs.points[..., :2], back)
        s, t = (np.full(len(pairs), x) for x in form.ends.mean(axis=0))
        active = np.arange(len(pairs))
        last = np.full(len(pairs), np.inf)
        for _ in range(_STEPS):
            g = np.matmul(form.values(s[active], t[active], 1), plane[active])
            ds, dt = _step(g)
            before = s[active], t[active]
            s[active], t[active] = inside(self._lattice, s[active] + ds, t[active] + dt)
            moved = np.maximum(np.abs(s[active] - before[0]), np.abs(t[active] - before[1]))
            settled = (moved <= 2.0**-51) | ((moved <= 1e-11) & (moved >= 0.5 * last[active]))
            last[active] = moved
            active = active[~settled]
            if not len(active):
                break
        s, t = self._on_sides(pairs, s, t)
        x = np.matmul(form.values(s, t, 1), pairs.points)
        value, du, dv = x[:, 0], x[:, 1], x[:, 2]
        hit = np.flatnonzero(np.abs(value[:, :2]).max(axis=1) <= 2 * SLACK)
        s, t, value, du, dv = (y[hit] for y in (s, t, value, du, dv))
        pairs, back = pairs[hit], back[hit]
        det = du[:, 0] * dv[:, 1] - du[:, 1] * dv[:, 0]
        rim = SLACK * 8 * np.abs(back).sum(axis=(1, 2))  # in s and t
        sides = np.array(self._lattice.edges, dtype=float) @ np.stack([np.ones(len(s)), s, t])
        on = sides.min(axis=0) <= rim
        blur = 4 * SLACK + 0.5 * rim * (np.abs(du[:, 2]) + np.abs(dv[:, 2]))
        frame = pairs.frame
        uv = frame[:, 0] + s[:, None] * frame[:, 1] + t[:, None] * frame[:, 2]
        area = frame[:, 1, 0] * frame[:, 2, 1] - frame[:, 1, 1] * frame[:, 2, 0]
        sign = np.sign(det) * np.sign(area) * np.sign(self._rays.along[pairs.ray])
        kind = _Kind(np.minimum(blur, BLUR), sign, on)
        self._add(pairs.ray, pairs.face, uv, value[:, 2], kind)

    def _on_sides(self, pairs: _Pairs, s: Array, t: Array) -> tuple[Array, Array]:
        """The nearest places to rays on the sides that Newton's method ended on, but at no zero.

        Where derivatives are about parallel a zero that rounding moved across a side is far from
        where it ends there.
        """
        edges = np.array(self._lattice.edges, dtype=float)
        for edge in edges:
            some = np.flatnonzero(edge[0] + edge[1] * s + edge[2] * t <= 2.0**-50)
            if not len(some):
                continue
            plane, best = pairs.points[some, :, :2], np.full(len(some), np.inf)
            x, y = s[some], t[some]
            for _ in range(_ALONG):
                g = np.matmul(self._form.values(x, y, 1), plane)
                off = np.abs(g[:, 0]).max(axis=1)
                better = off < best
                s[some[better]], t[some[better]] = x[better], y[better]
                best = np.minimum(off, best)
                if (best <= SLACK).all():
                    break
                along = g[:, 1] * edge[2] - g[:, 2] * edge[1]
                square = (along**2).sum(axis=1)
                scale = -(along * g[:, 0]).sum(axis=1) / np.where(square > 0, square, np.inf)
                x, y = inside(self._lattice, x + scale * edge[2], y - scale * edge[1])
        return s, t

    def _touch(self, pairs: _Pairs, way: Array) -> None:
        """Places of cells that are a curve, or a point, as rays see them."""
        if not len(pairs):
            return
        form = self._form
        along = np.matmul(pairs.points[..., :2], way[:, :, None])
        s, t = (np.full(len(pairs), x) for x in form.ends.mean(axis=0))
        for _ in range(_STEPS * 4):  # (where the way out of the domain is barred it is slow)
            g = np.matmul(form.values(s, t, 1), along)[..., 0]
            if (np.abs(g[:, 0]) <= SLACK).all():
                break
            square = g[:, 1] ** 2 + g[:, 2] ** 2
            scale = np.where(square > 0, -g[:, 0] / np.where(square > 0, square, 1), 0)
            s, t = inside(self._lattice, s + scale * g[:, 1], t + scale * g[:, 2])
        x = np.matmul(form.values(s, t, 1), pairs.points)
        hit = np.flatnonzero(np.abs(x[:, 0, :2]).max(axis=1) <= 2 * SLACK)
        frame = pairs.frame[hit]
        uv = frame[:, 0] + s[hit, None] * frame[:, 1] + t[hit, None] * frame[:, 2]
        depth = x[hit, 0, 2]
        span = np.abs(x[hit, 1:, 2]).sum(axis=1)
        blur = np.clip(span, 4 * SLACK, BLUR)
        # a part of the surface that is a place says nothing of the sort
        touch = np.ptp(pairs.points[hit, :, 2], axis=1) > TIE
        kind = _Kind(blur, np.zeros(len(hit)), np.ones(len(hit)), touch)
        self._add(pairs.ray[hit], pairs.face[hit], uv, depth, kind)

    def _halve(self, pairs: _Pairs) -> None:
        """Halves of cells, across the side that is longer as rays see it."""
        if not len(pairs):
            return
        form, count = self._form, len(pairs)
        x = pairs.points[..., :2]
        if len(form.ends) == 3:
            net = x[:, form.edges]  # (P, 3, d + 1, 2)
            span = (np.diff(net, axis=2) ** 2).sum(axis=3).max(axis=2)
        else:
            n = form.degree + 1
            net = x.reshape(count, n, n, 2)
            span = np.stack(
                [(np.diff(net, axis=1 + k) ** 2).sum(axis=3).max(axis=(1, 2)) for k in (0, 1)],
                axis=1,
            )
        way = span.argmax(axis=1)
        points = np.matmul(form.halves[way], pairs.points[:, None])
        frame = np.matmul(form.frames[way], pairs.frame[:, None, 1:])
        frame[:, :, 0] += pairs.frame[:, None, 0]
        shapes = (2 * count, *points.shape[2:]), (2 * count, 3, 2)
        self._halved += np.bincount(pairs.ray, minlength=len(self._halved))
        ray, face = np.repeat(pairs.ray, 2), np.repeat(pairs.face, 2)
        self._cells.append(_Pairs(ray, face, points.reshape(shapes[0]), frame.reshape(shapes[1])))

    def _add(self, ray: Array, face: Array, places: Array, depth: Array, kind: _Kind) -> None:
        """Hits at places (n, 2), if their t is one that counts."""
        time = self._rays.time(ray, depth)
        k = np.flatnonzero((time >= self._rays.least[ray]) & (time <= self._rays.most[ray]))
        if not len(k):
            return
        if not self._every:
            np.minimum.at(self.best, ray[k], time[k])
        if self._any:
            self.best[ray[k]] = -np.inf
        u, v = inside(self._lattice, *places[k].T)  # but for rounding
        sign, rim = kind.sign[k].astype(np.int64), kind.rim[k].astype(bool)
        known = depth[k], time[k], kind.blur[k], sign, rim, np.broadcast_to(kind.touch, len(ray))[k]
        self._found.append(Hits(ray[k], face[k], u, v, *known))


def inside(lattice: Lattice, s: Array, t: Array) -> tuple[Array, Array]:
    """The nearest places of the domain."""
    if lattice.sloped:
        over = np.maximum(s + t - 1, 0) / 2
        edge = over > 0
        along = np.clip(s - over, 0, 1)
        s, t = np.where(edge, along, s), np.where(edge, 1 - along, t)
    return np.clip(s, 0, 1), np.clip(t, 0, 1)


def _has_zero(values: Array, spare: Any) -> Array:
    """Whether values (P, n) lie on both sides of zero, or as near as that."""
    return np.asarray((values.min(axis=1) <= spare) & (values.max(axis=1) >= -spare))


def _step(g: Array) -> tuple[Array, Array]:
    """Newton's steps (ds, dt) for a value and two derivatives (P, 3, 2)."""
    value, du, dv = g[:, 0], g[:, 1], g[:, 2]
    det = du[:, 0] * dv[:, 1] - du[:, 1] * dv[:, 0]
    ds = (dv[:, 0] * value[:, 1] - dv[:, 1] * value[:, 0]) / det
    dt = (du[:, 1] * value[:, 0] - du[:, 0] * value[:, 1]) / det
    return ds, dt


def _inverse(mean: Array) -> tuple[Array, Array]:
    """What row vectors are multiplied by to be in units of two derivatives (P, 2, 2), if known."""
    det = mean[:, 0, 0] * mean[:, 1, 1] - mean[:, 0, 1] * mean[:, 1, 0]
    known = np.abs(det) > 1e-12 * (mean**2).sum(axis=(1, 2))
    adjugate = np.empty_like(mean)
    adjugate[:, 0, 0], adjugate[:, 1, 1] = mean[:, 1, 1], mean[:, 0, 0]
    adjugate[:, 0, 1], adjugate[:, 1, 0] = -mean[:, 0, 1], -mean[:, 1, 0]
    return adjugate / np.where(known, det, 1.0)[:, None, None], known
