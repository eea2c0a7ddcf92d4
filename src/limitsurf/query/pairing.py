"""Pairs of cells of two surfaces, parted until they meet in one slice after the other at most once.

``derivations/intersections.py`` derives when that is so.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.query.crossings import NEAR
from limitsurf.query.index import Cells
from limitsurf.query.records import Rows

Array = NDArray[Any]

SLACK = 2.0**-46  # what differs by rounding, in the unit of the search
_FINE = 40  # halvings: pairs of which one had so many are not parted
_DEEP = 40  # rings around special corners: beyond, float64 cannot tell parameters near 1 apart
_POINT = 2.0**-34  # what remains of a special corner is a point if it is smaller
_CROWD, _EACH = 1 << 12, 8  # undecided pairs at once, at most, and some for each pair met at first
_SHARE = 0.75  # of the angle between surfaces that their bends may take, at most


@dataclass(slots=True)
class Patches(Rows):
    """Cells of limit faces, (P,): ``(u, v) = frame[0] + s frame[1] + t frame[2]``.

    Or what remains at special corners `which` from a ring on, of which the points tell the box. Of
    cells `ring` counts halvings.
    """

    face: Array
    frame: Array  # (P, 3, 2)
    points: Array  # (P, n, 3)
    which: Array  # -1 for cells
    ring: Array


@dataclass(slots=True)
class Shapes(Rows):
    """How patches lie in space, (P,).

    `dual` (P, 2, 3) are the vectors whose products with mean derivatives are 1 and 0; normals are
    within `angle` of `normal` where a patch is `flat`: about a parallelogram.
    """

    lower: Array
    upper: Array
    size: Array
    dual: Array
    normal: Array
    angle: Array
    flat: Array


class Parts:
    """The patches of one surface, in a unit: points of the cage times 2 to the `power`."""

    def __init__(self, cells: Cells, power: int) -> None:
        self.cells, self.form, self.lattice = cells, cells.form, cells.lattice
        self._shift = power - cells.power
        self.levels = [self._scaled(x) for x in cells.levels] if len(cells.face) else []

    def _scaled(self, boxes: tuple[Array, Array]) -> tuple[Array, Array]:
        lower, upper = (np.ldexp(x, self._shift) for x in boxes)
        return lower - SLACK, upper + SLACK

    def leaves(self, leaf: Array) -> Patches:
        """Those of leaves of the index."""
        cells = self.cells
        count = len(cells.points)
        which = np.where(leaf >= count, leaf - count, -1)
        points = np.empty((len(leaf), self.form.size, 3))
        whole = which < 0
        points[whole] = cells.points[leaf[whole]]
        points[~whole] = cells.lower[leaf[~whole], None]
        points[~whole, 1] = cells.upper[leaf[~whole]]
        points = np.ldexp(points, self._shift)
        ring = np.zeros(len(leaf), dtype=np.int64)
        return Patches(cells.face[leaf], cells.frames(leaf), points, which, ring)

    def parted(self, patches: Patches) -> tuple[Patches, Array]:
        """All parts of patches, and of which they are."""
        rest = patches.which >= 0
        whole, corner = np.flatnonzero(~rest), np.flatnonzero(rest)
        parts, owner = [], []
        if len(whole):
            parts.append(self._halves(patches[whole]))
            owner.append(np.repeat(whole, 2))
        if len(corner):
            parts += self._rings(patches[corner])
            owner += [np.repeat(corner, len(self.lattice.pieces)), corner]
        if not parts:
            return patches, np.zeros(0, dtype=np.int64)
        return Patches.joined(parts), np.concatenate(owner)

    def _halves(self, patches: Patches) -> Patches:
        """Halves across the longer side."""
        form, n = self.form, len(patches)
        way = longest(form, patches.points)
        points = np.matmul(form.halves[way], patches.points[:, None])
        frame = np.matmul(form.frames[way], patches.frame[:, None, 1:])
        frame[:, :, 0] += patches.frame[:, None, 0]
        known = patches.face, patches.which, patches.ring + 1
        face, which, ring = (np.repeat(x, 2) for x in known)
        shape = points.shape[2:]
        return Patches(face, frame.reshape(-1, 3, 2), points.reshape(2 * n, *shape), which, ring)

    def _rings(self, patches: Patches) -> list[Patches]:
        """The cells of the next rings around special corners, and what remains then."""
        cells, which, ring = self.cells, patches.which, patches.ring
        found = cells.beyond.cells(which, ring)
        count = found.points.shape[1]
        frame = cells.ring_frames(which, found.origin, found.size).reshape(-1, 3, 2)
        limit = cells.beyond.limits[which]
        points = found.points + limit[:, None, None]
        points = np.ldexp(points.reshape(-1, *points.shape[2:]), self._shift)
        none = np.full(len(frame), -1)
        first = Patches(np.repeat(patches.face, count), frame, points, none, none * 0)
        box = patches.points.copy()
        far, _ = cells.beyond.reach(which, ring + 1, np.zeros((len(which), 3)))
        limit, far = np.ldexp(limit, self._shift), np.ldexp(far, self._shift)[:, None] + SLACK
        lower, upper = box.min(axis=1), box.max(axis=1)
        box[:] = np.maximum(lower, limit - far)[:, None]
        box[:, 1] = np.minimum(upper, limit + far)
        return [first, Patches(patches.face, patches.frame, box, which, ring + 1)]

    def shapes(self, patches: Patches) -> Shapes:
        """How patches lie in space."""
        points = patches.points
        lower, upper = points.min(axis=1), points.max(axis=1)
        size = np.sqrt(((upper - lower) ** 2).sum(axis=1))
        slopes = np.matmul(self.form.derivatives[None, 1:3], points[:, None])  # (P, 2, n, 3)
        mean = slopes.mean(axis=2)
        gram = np.matmul(mean, mean.swapaxes(1, 2))
        det = gram[:, 0, 0] * gram[:, 1, 1] - gram[:, 0, 1] ** 2
        known = (det > 1e-12 * gram[:, 0, 0] * gram[:, 1, 1]) & (patches.which < 0)
        inverse = np.stack([gram[:, 1, 1], -gram[:, 0, 1], -gram[:, 0, 1], gram[:, 0, 0]], axis=1)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            inverse = inverse.reshape(-1, 2, 2) / det[:, None, None]
            dual = np.matmul(inverse, mean)
            normal = np.cross(mean[:, 0], mean[:, 1])
            normal /= np.sqrt((normal**2).sum(axis=1))[:, None]
            along = np.einsum("pdnk,pek->pdne", slopes, dual) - np.eye(2)[:, None]
            bend = np.sqrt((along**2).sum(axis=3).max(axis=2).sum(axis=1))
            off = np.einsum("pdnk,pk->pdn", slopes, normal)
            rise = np.sqrt((np.abs(off).max(axis=2) ** 2).sum(axis=1)) / (1 - bend)
            angle = np.arctan(rise * np.sqrt((dual**2).sum(axis=(1, 2))))
        flat = known & (bend <= NEAR)
        dual, normal = (np.where(flat[:, None, None], dual, 0), np.where(flat[:, None], normal, 0))
        angle = np.where(flat, angle, 4.0)
        return Shapes(lower, upper, size, dual, normal, angle, flat)


@dataclass(slots=True)
class Pairs(Rows):
    """Patches of both surfaces that may meet, (P,): those of a and b, and how they lie."""

    a: Patches
    b: Patches
    of_a: Shapes
    of_b: Shapes

    @classmethod
    def of(cls, a: Parts, b: Parts, both: tuple[Patches, Patches]) -> Pairs:
        """Those of patches of the same numbers."""
        return cls(*both, a.shapes(both[0]), b.shapes(both[1]))

    @property
    def direction(self) -> Array:
        """Along the curves: unit vectors across both normals, (P, 3)."""
        found = np.cross(self.of_a.normal, self.of_b.normal)
        return np.asarray(found / np.sqrt((found**2).sum(axis=1))[:, None])

    @classmethod
    def joined(cls, parts: Any) -> Pairs:
        """All pairs of some, one after the other."""
        columns = zip(*((x.a, x.b, x.of_a, x.of_b) for x in parts), strict=True)
        return cls(*(x[0].joined(x) for x in columns))


def longest(form: Any, points: Array) -> Array:
    """Which way patches (P, n, 3) are halved: across the longest side, (P,)."""
    at = points[:, form.corners]
    a, b = form.across.T
    span = ((at[:, a] - at[:, b]) ** 2).sum(axis=2)
    if len(form.ends) == 4:  # of both opposite sides
        span += ((at[:, [3, 1]] - at[:, [2, 2]]) ** 2).sum(axis=2)
    return np.asarray(span.argmax(axis=1))


def met(a: Parts, b: Parts) -> tuple[Array, Array]:
    """Leaves of both indices whose boxes meet, (P,) each."""
    none = np.zeros(0, dtype=np.int64)
    if not (a.levels and b.levels):
        return none, none
    first = len(a.levels[0][0]), len(b.levels[0][0])
    node = [np.repeat(np.arange(first[0]), first[1]), np.tile(np.arange(first[1]), first[0])]
    level = [0, 0]
    while True:
        (low, high), (least, most) = a.levels[level[0]], b.levels[level[1]]
        there = (low[node[0]] <= most[node[1]]) & (least[node[1]] <= high[node[0]])
        node = [x[there.all(axis=1)] for x in node]
        left = [len(x.levels) - 1 - k for x, k in zip((a, b), level, strict=True)]
        if not any(left):
            return a.cells.order[node[0]], b.cells.order[node[1]]
        k = int(left[1] > left[0])
        which = np.arange(len(node[k]))
        node[k], which = (a, b)[k].cells.children(node[k], which, level[k])
        node[1 - k] = node[1 - k][which]
        level[k] += 1


def simple_pairs(a: Parts, b: Parts) -> tuple[Pairs, Pairs, Pairs]:
    """Pairs in which surfaces cross; that are undecided; that are undecided at special corners."""
    leaf, other = met(a, b)
    pairs = Pairs.of(a, b, (a.leaves(leaf), b.leaves(other)))
    most = _CROWD + _EACH * len(leaf)
    found, left, corners = [pairs[:0]], [pairs[:0]], [pairs[:0]]
    while len(pairs):
        pairs = pairs[_meeting(pairs)]
        simple = _is_simple(pairs)
        found.append(pairs[simple])
        pairs = pairs[~simple]
        x, y = pairs.of_a, pairs.of_b
        rest = (pairs.a.which >= 0) | (pairs.b.which >= 0)
        point = np.zeros(len(pairs), dtype=bool)
        for one, shape in ((pairs.a, x), (pairs.b, y)):
            point |= (one.which >= 0) & ((shape.size <= _POINT) | (one.ring >= _DEEP))
        corners.append(pairs[point])
        fine = np.maximum(pairs.a.ring, pairs.b.ring) >= _FINE
        small = ~point & ~rest & (fine | (np.minimum(x.size, y.size) <= SLACK))
        if (~point).sum() > most:
            small = ~point
        left.append(pairs[small])
        pairs = _parted(a, b, pairs[~(point | small)])
    return Pairs.joined(found), Pairs.joined(left), Pairs.joined(corners)


def _meeting(pairs: Pairs) -> Array:
    """Whether no plane of a few parts hulls, (P,)."""
    x, y = pairs.of_a, pairs.of_b
    keep = ((x.lower <= y.upper + SLACK) & (y.lower <= x.upper + SLACK)).all(axis=1)
    across = np.cross(x.normal, y.normal)
    cells = (pairs.a.which < 0) & (pairs.b.which < 0)
    for way in (x.normal, y.normal, across):
        one = np.einsum("pnk,pk->pn", pairs.a.points, way)
        two = np.einsum("pnk,pk->pn", pairs.b.points, way)
        apart = one.min(axis=1) > two.max(axis=1) + SLACK
        apart |= two.min(axis=1) > one.max(axis=1) + SLACK
        keep &= ~(apart & cells)
    return np.asarray(keep)


def _is_simple(pairs: Pairs) -> Array:
    """Whether all tangents of curves go one way: normals are apart, (P,)."""
    x, y = pairs.of_a, pairs.of_b
    cosine = np.minimum(np.abs((x.normal * y.normal).sum(axis=1)), 1)
    between = np.arccos(cosine)
    return np.asarray(x.flat & y.flat & (x.angle + y.angle <= _SHARE * between) & (between > 1e-7))


def _parted(a: Parts, b: Parts, pairs: Pairs) -> Pairs:
    """The parts of pairs: of the patch that bends more, or is no cell, or of both."""
    x, y = pairs.of_a, pairs.of_b
    bends = np.where(x.flat, x.angle, 4.0), np.where(y.flat, y.angle, 4.0)
    alike = np.minimum(*bends) >= 0.5 * np.maximum(*bends)
    first = (bends[0] >= bends[1]) & ~alike | alike & (x.size >= 0.6 * y.size)
    second = (bends[1] > bends[0]) & ~alike | alike & (y.size >= 0.6 * x.size)
    one, owner = _with_parts(a, pairs.a, first)
    two, of = _with_parts(b, pairs.b[owner], second[owner])
    return Pairs.of(a, b, (one[of], two))


def _with_parts(parts: Parts, patches: Patches, which: Array) -> tuple[Patches, Array]:
    """Patches, some of them in parts, and of which they are."""
    some, rest = np.flatnonzero(which), np.flatnonzero(~which)
    if not len(some):
        return patches, rest
    found, owner = parts.parted(patches[some])
    return Patches.joined([patches[rest], found]), np.concatenate([rest, some[owner]])
