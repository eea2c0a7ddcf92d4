"""Where pairs of patches meet: on the sides of either, and in slices between."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.query.crossings import NEAR, inside
from limitsurf.query.pairing import SLACK, Pairs, Parts, longest
from limitsurf.query.polynomials import Form, line_values, lines
from limitsurf.query.records import Rows

Array = NDArray[Any]

_STEPS = 30  # of Newton's method, at most
_FINE = 26  # halvings of a side and a patch that Newton's method does not take
_CROWD = 48  # parts of a side at once: more, and it lies in the other surface
_ON = 2.0**-43  # residuals of what is a place of both


@dataclass(slots=True)
class Meets(Rows):
    """Places (N,) of pairs, at (s, t) of both patches, (N, 4), in space (N, 3)."""

    pair: Array
    place: Array
    point: Array


@dataclass(slots=True)
class _Lines(Rows):
    """Parts of sides (Q,), from `low` to `high`, and of patches, as frames in these."""

    side: Array
    low: Array
    high: Array
    curve: Array  # (Q, d + 1, 3)
    points: Array  # (Q, n, 3)
    frame: Array  # (Q, 3, 2)


def on_sides(a: Parts, b: Parts, pairs: Pairs) -> Meets:
    """All places at which sides of one patch meet the other."""
    found = []
    for one, two, of, other in ((a, b, pairs.a, pairs.b), (b, a, pairs.b, pairs.a)):
        curves = of.points[:, one.form.edges]  # (P, c, d + 1, 3)
        c = len(one.form.ends)
        pair = np.repeat(np.arange(len(pairs)), c)
        curve = curves.reshape(len(pair), *curves.shape[2:])
        side, x, spot = _crossings(curve, two, other.points, pair)
        ends = one.form.ends
        k = side % c
        start = ends[k]
        own = start + x[:, None] * (ends[(k + 1) % c] - start)
        both = [own, spot] if one is a else [spot, own]
        found.append((pair[side], np.concatenate(both, axis=1)))
    pair, place = (np.concatenate(x) for x in zip(*found, strict=True))
    point = _values(a.form, pairs.a.points[pair], place[:, :2], 0)[:, 0]
    return Meets(pair, place, point)


def _values(form: Form, points: Array, spot: Array, order: int) -> Array:
    """Points and derivatives (Q, k, 3) at places (Q, 2)."""
    if not len(points):
        return np.zeros((0, (order + 1) * (order + 2) // 2, 3))
    return np.asarray(np.matmul(form.values(spot[:, 0], spot[:, 1], order), points))


def _crossings(curve: Array, other: Parts, points: Array, patch: Array) -> tuple[Array, ...]:
    """Where curves (N, d + 1, 3) meet patches: numbers of curves, x along them, and (s, t)."""
    n, degree, form = len(curve), curve.shape[1] - 1, other.form
    whole = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    frame = np.broadcast_to(whole, (n, 3, 2)).copy()
    todo = _Lines(np.arange(n), np.zeros(n), np.ones(n), curve, points[patch], frame)
    found = []
    for step in range(_FINE + 1):
        low, high = todo.points.min(axis=1) - SLACK, todo.points.max(axis=1) + SLACK
        keep = (todo.curve.min(axis=1) <= high) & (low <= todo.curve.max(axis=1))
        todo = todo[keep.all(axis=1)]
        if not len(todo):
            break
        back, known = _inverse(todo, degree, form)
        c, p = np.matmul(todo.curve, back), np.matmul(todo.points, back)
        spare = SLACK * np.abs(back).sum(axis=1)
        there = (c.min(axis=1) <= p.max(axis=1) + spare) & (p.min(axis=1) <= c.max(axis=1) + spare)
        keep = there.all(axis=1) | ~known
        todo = todo[keep]
        back, known, c, p = (x[keep] for x in (back, known, c, p))
        along = np.matmul(lines(degree)[0][1], c) - [1.0, 0.0, 0.0]
        off = (along**2).sum(axis=2).max(axis=1, initial=0)
        for k in (1, 2):
            slope = -np.matmul(form.derivatives[k], p) - np.eye(3)[k]
            off += (slope**2).sum(axis=2).max(axis=1, initial=0)
        single = known & (off <= NEAR**2)
        crowd = np.bincount(todo.side, minlength=n)[todo.side] > _CROWD
        last = single | (step == _FINE)
        found.append(_solved(todo[last & ~crowd | single], degree, other))
        todo = _halved(todo[~last & ~crowd], degree, form)
    if not found:
        return np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros((0, 2))
    return tuple(np.concatenate(x) for x in zip(*found, strict=True))


def _inverse(todo: _Lines, degree: int, form: Form) -> tuple[Array, Array]:
    """What row vectors are multiplied by to be in units of mean derivatives (Q, 3, 3), if known."""
    along = np.matmul(lines(degree)[0][1], todo.curve).mean(axis=1)
    slopes = np.matmul(form.derivatives[None, 1:3], todo.points[:, None]).mean(axis=2)
    rows = np.concatenate([along[:, None], -slopes], axis=1)
    volume = np.abs(np.linalg.det(rows))
    known = volume > 1e-9 * np.sqrt((rows**2).sum(axis=2)).prod(axis=1)
    return np.linalg.inv(np.where(known[:, None, None], rows, np.eye(3))), known


def _halved(todo: _Lines, degree: int, form: Form) -> _Lines:
    """Halves of the curves, or of the patches where these are larger."""
    size = [np.ptp(x, axis=1).max(axis=1) for x in (todo.curve, todo.points)]
    first = size[0] >= size[1]
    parts, other = todo[first], todo[~first]
    n = len(parts)
    curve = np.matmul(lines(degree)[1], parts.curve[:, None]).reshape(2 * n, degree + 1, 3)
    middle = (parts.low + parts.high) / 2
    low = np.stack([parts.low, middle], axis=1).ravel()
    high = np.stack([middle, parts.high], axis=1).ravel()
    side, points, frame = (np.repeat(x, 2, axis=0) for x in (parts.side, parts.points, parts.frame))
    one = _Lines(side, low, high, curve, points, frame)
    n, way = len(other), longest(form, other.points)
    points = np.matmul(form.halves[way], other.points[:, None])
    frame = np.matmul(form.frames[way], other.frame[:, None, 1:])
    frame[:, :, 0] += other.frame[:, None, 0]
    side, low, high = (np.repeat(x, 2) for x in (other.side, other.low, other.high))
    curve = np.repeat(other.curve, 2, axis=0)
    two = _Lines(
        side, low, high, curve, points.reshape(2 * n, form.size, 3), frame.reshape(-1, 3, 2)
    )
    return _Lines.joined([one, two])


def _solved(todo: _Lines, degree: int, other: Parts) -> tuple[Array, Array, Array]:
    """The places of those that have one, by Newton's method."""
    form, n = other.form, len(todo)
    x, spot = np.full(n, 0.5), np.broadcast_to(form.ends.mean(axis=0), (n, 2)).copy()
    slope = lines(degree)[0][1]
    best = np.full((n, 4), np.inf)
    rows = np.broadcast_to(np.eye(3), (n, 3, 3)).copy()
    active = np.arange(n)
    for _ in range(_STEPS):
        if not len(active):
            break
        basis = line_values(degree, x[active])
        at = np.matmul(basis[:, None], todo.curve[active])[:, 0]
        along = np.matmul((basis @ slope)[:, None], todo.curve[active])[:, 0]
        value = _values(form, todo.points[active], spot[active], 1)
        off = at - value[:, 0]
        rows[active] = np.stack([along, -value[:, 1], -value[:, 2]], axis=1)
        most = np.abs(off).max(axis=1)
        better = most < best[active, 3]
        best[active[better]] = np.column_stack([x[active], spot[active], most])[better]
        step = -np.matmul(off[:, None], np.linalg.pinv(rows[active], rcond=1e-13))[:, 0]
        x[active] = np.clip(x[active] + step[:, 0], -0.5, 1.5)
        spot[active] = np.clip(spot[active] + step[:, 1:], -0.5, 1.5)
        active = active[(np.abs(step).max(axis=1) > 2.0**-51) & (most > 0)]
    x, spot = best[:, 0], best[:, 1:3]
    rim = 2.0**-48 + SLACK * np.abs(np.linalg.pinv(rows, rcond=1e-13)).sum(axis=(1, 2))
    rim = np.minimum(rim, 2.0**-20)
    sides = np.array(other.lattice.edges, dtype=float) @ np.stack([np.ones(n), *spot.T])
    hit = (best[:, 3] <= _ON) & (x >= -rim) & (x <= 1 + rim) & (sides.min(axis=0) >= -rim)
    todo, x, spot = todo[hit], np.clip(x[hit], 0, 1), spot[hit]
    spot = np.stack(inside(other.lattice, *spot.T), axis=1)
    place = todo.low + x * (todo.high - todo.low)
    spot = todo.frame[:, 0] + np.matmul(spot[:, None], todo.frame[:, 1:])[:, 0]
    return todo.side, place, spot


class Slices:
    """The curves of pairs of patches, by planes across their directions."""

    def __init__(self, a: Parts, b: Parts, pairs: Pairs) -> None:
        self.a, self.b, self._pairs = a, b, pairs
        self.direction = pairs.direction
        sine = np.cross(pairs.of_a.normal, pairs.of_b.normal)
        sine = np.maximum(np.sqrt((sine**2).sum(axis=1)), 1e-9)
        dual = [np.sqrt((x.dual**2).sum(axis=(1, 2))) for x in (pairs.of_a, pairs.of_b)]
        # how far rounding moves places, in s and t
        self._rim = np.minimum(2.0**-48 + 4 * SLACK * (dual[0] + dual[1]) / sine, 2.0**-20)

    def along(self, pair: Array, point: Array) -> Array:
        """Where points lie along the directions of pairs."""
        return np.asarray((self.direction[pair] * point).sum(axis=1))

    def at(self, pair: Array, height: Array, guess: Array) -> tuple[Meets, Array]:
        """Where the curves of pairs have heights, (Q,), and whether Newton's method gets there."""
        place, n = guess.copy(), len(pair)
        point, best = np.zeros((n, 3)), np.full(n, np.inf)
        active = np.arange(n)
        for _ in range(_STEPS):
            if not len(active):
                break
            own = pair[active]
            x = _values(self.a.form, self._pairs.a.points[own], place[active, :2], 1)
            y = _values(self.b.form, self._pairs.b.points[own], place[active, 2:], 1)
            way = self.direction[own]
            off = np.concatenate([x[:, 0] - y[:, 0], np.zeros((len(own), 1))], axis=1)
            off[:, 3] = (x[:, 0] * way).sum(axis=1) - height[active]
            matrix = np.zeros((len(own), 4, 4))
            matrix[:, :2, :3], matrix[:, 2:, :3] = x[:, 1:], -y[:, 1:]
            matrix[:, :2, 3] = np.matmul(x[:, 1:], way[:, :, None])[..., 0]
            point[active], best[active] = x[:, 0], np.abs(off).max(axis=1)
            singular = np.linalg.det(matrix) == 0
            matrix[singular] = np.eye(4)
            step = -np.linalg.solve(matrix.swapaxes(1, 2), off[..., None])[..., 0]
            on = (np.abs(step).max(axis=1) > 4 * self._rim[own]) | (best[active] > _ON / 8)
            on &= (best[active] > 0) & ~singular
            moved = active[on]
            place[moved] = np.clip(place[moved] + step[on], -0.5, 1.5)
            active = moved
        return Meets(pair, place, point), best <= _ON

    def sides(self, found: Meets) -> tuple[Array, Array]:
        """Whether places are in both patches, and on a side of either, (Q,)."""
        rim = self._rim[found.pair]
        least = []
        for k, parts in enumerate((self.a, self.b)):
            spot = found.place[:, 2 * k : 2 * k + 2].T
            edges = np.array(parts.lattice.edges, dtype=float)
            least.append((edges @ np.stack([np.ones(len(found)), *spot])).min(axis=0))
        both = np.minimum(*least)
        return both >= -rim, both <= rim

    def fine(
        self, pair: Array, ends: Array, points: Array, tolerance: float
    ) -> tuple[Array, Meets]:
        """Places between ends (S, 2, 4), at points (S, 2, 3), until chords are near the curves.

        With the numbers of the spans; in order along each.
        """
        number = np.arange(len(pair))
        heights = [self.along(pair, points[:, k]) for k in (0, 1)]
        spans: Any = number, *heights, ends[:, 0], ends[:, 1], points[:, 0], points[:, 1]
        none = np.zeros(0, dtype=np.int64)
        found = [(none, np.zeros(0), Meets(none, np.zeros((0, 4)), np.zeros((0, 3))))]
        for _ in range(40):
            number, low, high, a, b, p, q = spans
            if not len(number):
                break
            chord = q - p
            square = np.maximum((chord**2).sum(axis=1), 2.0**-120)
            far = np.zeros(len(number))
            for share in (0.25, 0.75, 0.5):  # (the middle is what is kept)
                height = low + share * (high - low)
                at, _ = self.at(pair[number], height, a + share * (b - a))
                off = at.point - p
                part = (off * chord).sum(axis=1) / square
                off = off - part[:, None] * chord
                far = np.maximum(far, np.sqrt((off**2).sum(axis=1)))
            # (off the curve between them by a part of what is seen)
            more = far > 0.9 * tolerance
            middle, height = at[more], height[more]
            found.append((number[more], height, middle))
            left = [x[more] for x in (number, low, high, a, b, p, q)]
            number, low, high, a, b, p, q = left
            halves = [
                (number, low, height, a, middle.place, p, middle.point),
                (number, height, high, middle.place, b, middle.point, q),
            ]
            spans = [np.concatenate(x) for x in zip(*halves, strict=True)]
        number, height, meets = (
            np.concatenate([x[0] for x in found]),
            np.concatenate([x[1] for x in found]),
            Meets.joined([x[2] for x in found]),
        )
        order = np.lexsort([height, number])
        return number[order], meets[order]
