"""Special corners at which many faces meet: rings refined recursively, instead of eigenbases.

With K control points a patch, of which the ring is a part that grows with N, and N patches around
a vertex of N faces, eigenbases would cost N^2. But all these patches share one ring, and a step of
refinement maps it to a ring of the same kind at the cost of N (`Ring`). Of a single patch a few
control points and what three points of the next ring are is enough to refine it (`ring_grids`),
down to the regular piece that holds a query. The vertex stands at 0 and units are powers of two, so
that all digits are kept at any depth. The outer control points of a patch forget where they began
by an eighth with every step, while rings fall by less than a half: where they did not matter
`_WINDOW` steps before, they begin there (``derivations/wide_rings.py``).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf import basis, ring_grids, tables
from limitsurf._kernels import reference as kernels
from limitsurf.patches import SharedRings
from limitsurf.ring_grids import Layout, sharp_sides

if TYPE_CHECKING:
    from limitsurf.tables import RingMasks

Array = NDArray[Any]
Order: TypeAlias = tuple[int, int]

# steps after which outer points have forgotten where they began, and how many binary digits of the
# ring must remain of its size before that
_WINDOW, _DIGITS = 40, 80
_EVERY = 64  # every so many steps of a deep ring are kept
_ENDS = (0, -1), (-1, 0)  # the edge along u, and along v, where it is sharp, and the other end
_AHEAD = (3, 1), (1, 3)  # places of outer points that continue these edges


@dataclass(frozen=True)
class Ring:
    """Rings of one kind after some steps of refinement, relative to the vertex.

    Attributes
    ----------
    edges, faces : (R, d, edges), (R, d, faces)
        Edge neighbours and face corners, in units of ``2**exponent``.
    step : (R, d)
        From the vertex before to this one, in the units before.
    exponent : (R,)
    shift : (R,)
        How much of it is of the last step.
    size : (R,)
        The exponent, or where all points are at the vertex one far below all others.
    """

    edges: Array
    faces: Array
    step: Array
    exponent: Array
    shift: Array
    size: Array

    @classmethod
    def of(cls, edges: Array, faces: Array) -> Ring:
        """Rings of the cage."""
        none = np.zeros(len(edges), dtype=np.int64)
        return cls(edges, faces, np.zeros(edges.shape[:2]), none, none, none).scaled()

    def refined(self, masks: RingMasks) -> Ring:
        """One step."""
        w, kind = masks.weights, masks.sector.kind
        E, around, faces = self.edges, self.faces, self.faces.shape[2] > 0
        edges = w.end * E
        if faces:
            around = w.corner * (_before(E, masks) + around + _after(E, masks))
        if masks.sector.open:
            before, after = (around, around[:, :, 1:]) if faces else (E, E[:, :, 2:])
            edges[:, :, 1:-1] += w.face * (before[:, :, : after.shape[2]] + after)
            edges[:, :, [0, -1]] = w.half * E[:, :, [0, -1]]
        else:
            after = around if faces else np.roll(E, -1, axis=2)
            edges += w.face * (np.roll(around if faces else E, 1, axis=2) + after)
        step = np.zeros(E.shape[:2])
        if kind == "dart":
            edges[:, :, 0] = w.half * E[:, :, 0]
        if kind in ("interior", "dart"):
            step = w.edge * E.sum(axis=2) + w.around * around.sum(axis=2)
        elif kind == "crease":
            step = w.beside * (E[:, :, 0] + E[:, :, -1])
        edges -= step[:, :, None]
        around = around - step[:, :, None]
        return Ring(edges, around, step, self.exponent, self.shift, self.size).scaled()

    def scaled(self) -> Ring:
        """A ring in units in which the largest coordinate is in [1/2, 1); 0 stays."""
        parts = self.edges, self.faces
        largest = np.max([np.abs(x).max(axis=(1, 2), initial=0) for x in parts], axis=0)
        shift = np.frexp(largest)[1].astype(np.int64)
        edges, faces = (kernels.scale_by_two(x, -shift[:, None, None]) for x in parts)
        exponent = self.exponent + shift
        size = np.where(largest == 0, -(1 << 40), exponent)
        return Ring(edges, faces, self.step, exponent, shift, size)

    def limit(self, masks: RingMasks) -> Array:
        """The limit of the vertex, relative to it, (R, d)."""
        edges, faces = masks.limit
        return np.asarray((self.edges * edges).sum(axis=2) + (self.faces * faces).sum(axis=2))


def _before(edges: Array, masks: RingMasks) -> Array:
    return edges[..., :-1] if masks.sector.open else edges


def _after(edges: Array, masks: RingMasks) -> Array:
    return edges[..., 1:] if masks.sector.open else np.roll(edges, -1, axis=-1)


@dataclass(frozen=True)
class Place:
    """Where queries are: like `basis.CornerPlace`, with the refined points that they depend on.

    Attributes
    ----------
    corner, away : (n,), (q - n,)
        The queries at the corner itself, and the others; what follows is about these.
    local : basis.CornerPlace
    points : (q - n, K, d)
        Control points of the regular piece relative to the vertex, in units of ``2**exponent``.
    exponent : (q - n,)
    limit : (q - n, d)
        The limit of the corner, relative to the vertex, in these units.
    sharp : (2, q - n) bool
        Whether the side t = 0, and s = 0, of the piece is sharp.
    masks : RingMasks
    """

    corner: Array
    away: Array
    local: basis.CornerPlace
    points: Array
    exponent: Array
    limit: Array
    sharp: Array
    masks: RingMasks

    def __getitem__(self, here: Array) -> Place:
        """The places of some queries away from the corner, as if there were no others."""
        points, exponent, limit = (x[here] for x in (self.points, self.exponent, self.limit))
        near = self.corner[:0], self.away[here], self.local[here]
        return Place(*near, points, exponent, limit, self.sharp[:, here], self.masks)

    def derivatives(self, nu: Order) -> Array:
        """The derivatives themselves, (q - n, d), in units of ``2**exponent``."""
        found = ring_grids.weights(self.masks, self.local, self.sharp, nu)
        return np.asarray(np.matmul(found[:, None], self.points)[:, 0])


@dataclass(frozen=True)
class _Kept:
    """What is kept of some rings, (R,): few of their steps, and the sizes of all."""

    rings: Array
    steps: dict[int, Ring]
    sizes: dict[int, Array]


class RingValues:
    """Values around special corners of one kind of many faces.

    Parameters
    ----------
    masks : RingMasks
    rings : SharedRings
    outer : (patches, n) int
        Outer control points.
    high, low : (n_points, d)
        Control points as unevaluated sums.
    """

    def __init__(
        self, masks: RingMasks, rings: SharedRings, outer: Array, high: Array, low: Array
    ) -> None:
        self._masks, self._rings, self._outer = masks, rings, outer
        self._high, self._low = high, low
        around = self._relative(rings.points, np.arange(len(rings.points)))
        parts = (around[:, part] for part in tables.orbits(masks.sector.lattice))
        self._first = Ring.of(*(np.ascontiguousarray(x.swapaxes(1, 2)) for x in parts))
        self._kept = _Kept(np.zeros(0, dtype=np.int64), {}, {})

    # ------------------------------------------------------------------ rings, step by step

    def _kept_of(self, rings: Array) -> _Kept:
        """What is known of some rings: of those that were asked for last, or of the cage."""
        kept = self._kept
        if not np.array_equal(rings, kept.rings):
            first = self._first
            parts = first.edges, first.faces, first.step, first.exponent, first.shift, first.size
            begin = Ring(*(x[rings] for x in parts))
            self._kept = kept = _Kept(rings, {0: begin}, {0: begin.size})
        return kept

    def _walk(self, kept: _Kept, start: int) -> Iterator[tuple[int, Ring]]:
        """Steps of some rings from one on, for ever."""
        level = max(k for k in list(kept.steps) if k <= start)
        state = kept.steps[level]
        while True:
            if level >= start:
                yield level, state
            state, level = state.refined(self._masks), level + 1
            kept.sizes[level] = state.size
            if level % _EVERY == 0:
                kept.steps[level] = state

    def _starts(self, kept: _Kept, which: Array, row: Array, level: Array) -> Array:
        """The step at which each patch may begin without outer points; 0 is with them."""
        start = np.asarray(np.maximum(level - _WINDOW, 0))
        most = int(level.max())
        if not start.any():
            return start
        if most not in kept.sizes:
            next(self._walk(kept, most))
        sizes = np.array([kept.sizes[k] for k in range(most + 1)])  # (steps, rings): powers of two
        # what outer points owe to a step is an eighth with each later one: the largest by now
        owed = np.maximum.accumulate(sizes + 3 * np.arange(most + 1)[:, None], axis=0)
        own = self._relative(self._outer[row], self._rings.ring[row])
        outer = np.frexp(np.abs(own).max(axis=(1, 2), initial=0))[1]
        owing = np.maximum(owed[start, which], outer) - 3 * level
        return np.asarray(np.where(owing < sizes[level, which] - _DIGITS, start, 0))

    def _relative(self, ids: Array, ring: Array) -> Array:
        """Control points (n, k) relative to the vertices of rings (n,): (n, k, d)."""
        vertex = self._rings.points[ring, :1]
        high, low = self._high, self._low
        return np.asarray(high[ids] - high[vertex] + (low[ids] - low[vertex]))

    def _refined(self, row: Array, level: Array) -> tuple[Array, Array, Array]:
        """5 x 5 refined points of patches at their levels (A, 5, 5, d), exponents and limits."""
        d = self._high.shape[1]
        rings, which = np.unique(self._rings.ring[row], return_inverse=True)
        position = self._rings.position[row]
        fine = np.empty((len(row), 5, 5, d))
        exponent, limit = np.empty(len(row), dtype=np.int64), np.empty((len(row), d))
        kept = self._kept_of(rings)
        start = self._starts(kept, which, row, level)
        active, grid = np.zeros(0, dtype=np.int64), np.zeros((0, 4, 4, d))
        walk = self._walk(kept, int(start.min()))
        step, state = next(walk)
        while True:
            new = np.flatnonzero(start == step)
            if len(new):
                outer = self._outer_points(row[new], state, which[new], step)
                more = self._grid(state, which[new], position[new], outer)
                active, grid = np.concatenate([active, new]), np.concatenate([grid, more])
            following, after = next(walk)
            points = self._finer(after, which[active], position[active], grid)
            done = level[active] == step
            fine[active[done]] = points[done]
            exponent[active[done]] = after.exponent[which[active[done]]]
            if done.any():
                limit[active[done]] = after.limit(self._masks)[which[active[done]]]
            active, grid = active[~done], points[~done][:, :4, :4]
            step, state = following, after
            if not len(active):
                later = start[start >= step]
                if not len(later):
                    return fine, exponent, limit
                if later.min() > step:
                    walk = self._walk(kept, int(later.min()))
                    step, state = next(walk)

    def _grid(self, state: Ring, ring: Array, position: Array, outer: Array) -> Array:
        """Control points (A, 4, 4, d) of patches of rings, in their units."""
        return ring_grids.first(self._masks, state.edges, state.faces, outer, ring, position)

    def _finer(self, after: Ring, ring: Array, position: Array, grid: Array) -> Array:
        """Refined points (A, 5, 5, d) of patches, in the units of their rings after this step."""
        own = after.edges, ring, after.step[ring], after.shift[ring]
        return ring_grids.refined(self._masks, position, grid, *own)

    def _outer_points(self, row: Array, state: Ring, which: Array, step: int) -> Array:
        """Outer points of patches relative to the vertex, in the units of their rings."""
        if step:
            return np.zeros((len(row), self._outer.shape[1], self._high.shape[1]))
        points = self._relative(self._outer[row], self._rings.ring[row])
        return kernels.scale_by_two(points, -state.exponent[which][:, None, None])

    # ------------------------------------------------------------------ whole rings

    def limits(self, row: Array) -> Array:
        """Limits of the corners of patches, relative to their vertices, (A, d)."""
        return np.asarray(self.vertices[2][self._rings.ring[row]])

    def refined(self, row: Array, level: Array) -> Array:
        """5 x 5 refined points of patches, relative to the limit of the corner, (A, 5, 5, d).

        They are those after `level` + 1 steps, (A,), of which the three regular pieces consist.
        """
        fine, exponent, limit = self._refined(row, level)
        return kernels.scale_by_two(fine - limit[:, None, None], exponent[:, None, None, None])

    def levels(self) -> Iterator[tuple[Array, Array, Array]]:
        """Refined points of all patches (patches, 5, 5, d), one level after the other.

        They are relative to the vertex; with its limit (rings, d), also relative to it, and the
        largest coordinate of the control points before (rings,).
        """
        ring, position, state = self._rings.ring, self._rings.position, self._first
        outer = self._outer_points(np.arange(len(ring)), state, ring, 0)
        grid = self._grid(state, ring, position, outer)
        while True:
            # the vertex moves by all of the ring
            size = np.abs(np.concatenate([state.edges, state.faces], 2)).max((1, 2), initial=0)
            np.maximum.at(size, ring, np.abs(grid).max(axis=(1, 2, 3), initial=0))
            size = kernels.scale_by_two(size, state.exponent)
            state = state.refined(self._masks)
            fine = self._finer(state, ring, position, grid)
            grid = fine[:, :4, :4]
            unit = np.ldexp(1.0, state.exponent)[:, None]
            yield fine * unit[ring, None, None], state.limit(self._masks) * unit, size

    @property
    def vertices(self) -> tuple[Array, Array, Array]:
        """The vertices of rings, high and low, and their limits relative to them, (R, d) each."""
        at = self._rings.points[:, 0]
        limit = kernels.scale_by_two(self._first.limit(self._masks), self._first.exponent[:, None])
        return self._high[at], self._low[at], limit

    def extent(self, row: Array, level: int) -> tuple[Array, Array]:
        """Bounds (A, d) of all points that patches depend on after some steps, at least one.

        Relative to the limit of the corner.
        """
        grid, exponent, limit = self._refined(row, np.full(len(row), level - 1))
        rings, which = np.unique(self._rings.ring[row], return_inverse=True)
        _, state = next(self._walk(self._kept_of(rings), level))
        grid = grid[:, :4, :4].reshape(len(row), 16, -1)
        around = np.concatenate([state.edges, state.faces], axis=2)
        bounds = (
            [find(around, axis=2)[which], find(grid, axis=1), 0 * limit]
            for find in (np.min, np.max)
        )
        least, most = (
            kernels.scale_by_two(find(found, axis=0) - limit, exponent[:, None])
            for find, found in zip((np.min, np.max), bounds, strict=True)
        )
        return least, most

    # ------------------------------------------------------------------ queries

    def place(self, row: Array, s: Array, t: Array, turn: Array) -> Place:
        """Where queries of patches are."""
        local = basis.CornerPlace.of(s, t, turn, self._masks.sector.lattice)
        corner, away = np.flatnonzero(local.level < 0), np.flatnonzero(local.level >= 0)
        local = local[away]
        # patches and levels, each once; there are fewer than 2**11 levels
        found, query = np.unique(
            row[away].astype(np.int64) << 11 | local.level, return_inverse=True
        )
        patch, level = found >> 11, found & ((1 << 11) - 1)
        fine, exponent, limit = (
            self._refined(patch, level)
            if len(patch)
            else (np.zeros((0, 5, 5, self._high.shape[1])), level, np.zeros((0, 1)))
        )
        j, i = (x[local.piece] for x in Layout.of(self._masks).pieces)
        points = fine[query[:, None], j, i]
        sharp = ring_grids.sharp_pieces(self._masks, self._rings.position[row[away]], local)
        scale = exponent[query], limit[query]
        return Place(corner, away, local, points, *scale, sharp, self._masks)

    def derivatives(
        self, row: Array, s: Array, t: Array, turn: Array, depth: Array, orders: Sequence[Order]
    ) -> list[Array]:
        """Derivatives (q, d) in (u, v) of the limit face, which is `depth` halvings above."""
        place, position = self.place(row, s, t, turn), self._rings.position[row]
        vertex = self._rings.points[self._rings.ring[row], 0]
        start, lattice = self.limits(row), self._masks.sector.lattice
        inner = np.full(len(row), -1)
        inner[place.away] = np.arange(len(place.away))
        result = []
        for nu in orders:

            def rows(choice: Order, here: Array) -> Array:
                given = row[here], position[here], s[here], t[here]
                return self._derivative(place, inner[here], *given, choice)

            found = basis.turned_rows(lattice, nu, turn, rows)
            if not sum(nu):
                found = found + (self._low[vertex] + start) + self._high[vertex]
            else:
                found = kernels.scale_by_two(found, (depth * sum(nu))[:, None])
            result.append(found)
        return result

    def _derivative(
        self, place: Place, inner: Array, row: Array, position: Array, s: Array, t: Array, nu: Order
    ) -> Array:
        """A derivative (n, d) in (s, t) of patches; positions are relative to limits of corners.

        `inner` (n,) are numbers of these queries among those of the place that are away from
        corners, -1 at these.
        """
        found, order, masks = np.zeros((len(row), self._high.shape[1])), sum(nu), self._masks
        away = np.flatnonzero(inner >= 0)
        own = place[inner[away]]
        value, exponent = own.derivatives(nu), own.exponent
        if order == 0:
            value -= own.limit
        exponent = exponent + order * (own.local.level + 1)
        found[away] = kernels.scale_by_two(value, exponent[:, None])
        if order:
            found[inner < 0] = at_corners(masks, position[inner < 0], nu)[:, None]
            on = np.flatnonzero(on_curve(masks, position, s, t, nu))
            found[on] = self._along_curve(row[on], s[on], t[on], nu)
        return found

    def _along_curve(self, row: Array, s: Array, t: Array, nu: Order) -> Array:
        """Derivatives of positive order along a sharp side of a sector, (n, d)."""
        axis, ring, first = int(nu[0] == 0), self._rings.ring[row], self._first
        near, far = _ENDS[axis]
        back, ahead = first.edges[ring, :, far], first.edges[ring, :, near]
        outer = self._outer_points(row, first, ring, 0)[:, _ahead(self._masks, axis)]
        weights = _curve_weights(self._masks, (s, t)[axis], sum(nu))[:, :, None]
        value = weights[:, 0] * back + weights[:, 2] * ahead + weights[:, 3] * outer
        return np.asarray(kernels.scale_by_two(value, first.exponent[ring][:, None]))

    def directions(self, row: Array, place: Place) -> tuple[Array, Array]:
        """Vectors along d/ds and d/dt, (2, q, d), and what their rounding errors are, (2, q, 1)."""
        found = np.zeros((2, len(row), self._high.shape[1]))
        error = np.ones((2, len(row), 1))
        # points have the errors of the ring, whose size is 1, but those on sharp sides of their own
        sizes = np.maximum(np.abs(place.points).max(axis=2, initial=0), 1)
        for side, on in zip(place.sharp, ring_grids.on_sides(self._masks), strict=True):
            where = np.flatnonzero(side)[:, None], on
            sizes[where] = np.abs(place.points[where]).max(axis=(1, 2), initial=0)[:, None]
        for axis, nu in enumerate(((1, 0), (0, 1))):
            weights = ring_grids.weights(self._masks, place.local, place.sharp, nu)
            found[axis, place.away] = np.matmul(weights[:, None], place.points)[:, 0]
            error[axis, place.away] = (np.abs(weights) * sizes).sum(axis=1, keepdims=True)
            at = row[place.corner]
            found[axis, place.corner], error[axis, place.corner] = self._corner_directions(at, axis)
        return found, error

    def _corner_directions(self, row: Array, axis: int) -> tuple[Array, Array]:
        """Limits of the directions along a side, (n, d), and their errors, (n, 1)."""
        masks, rings, first = self._masks, self._rings, self._first
        sector, faces = masks.sector, masks.sector.faces
        ring, edge = rings.ring[row], rings.position[row] + axis
        waves, sizes = self._waves(ring)
        share = np.ones((len(row), len(waves)))
        if sector.kind in ("interior", "dart"):
            angle = 2 * np.pi * ((edge % faces) / faces)
            share = np.stack([np.cos(angle), np.sin(angle)], axis=1)[:, : len(waves)]
        if sector.kind == "dart" and len(waves):
            # the odd wave is the slower one, and vanishes on the line of the sharp edge
            on = (2 * edge) % faces == 0
            share[:, 0] = np.where(on, np.sign(share[:, 0]), 0)
            share[:, 1] = np.where(on, 0, share[:, 1])
        found = np.einsum("qw,wqd->qd", share, waves)
        error = np.einsum("qw,w->q", np.abs(share), sizes)[:, None]
        if not len(waves):
            found[:] = np.nan
        if sector.open:
            sharp = np.flatnonzero((edge == 0) | (edge == faces))
            r, near = ring[sharp], np.where(edge[sharp] == 0, 0, -1)
            ahead, back = first.edges[r, :, near], first.edges[r, :, -1 - near]
            found[sharp] = ahead - (back if sector.kind == "crease" else 0)
            error[sharp] = 2
        return found, error

    def _waves(self, ring: Array) -> tuple[Array, Array]:
        """Coefficients of the slowest waves (n, q, d) of rings, and the sums of weights, (n,)."""
        edges, faces = self._masks.waves
        used, which = np.unique(ring, return_inverse=True)
        first = self._first
        E, F = first.edges[used], first.faces[used]
        waves = [
            (E * e).sum(axis=2) + (F * f).sum(axis=2) for e, f in zip(edges, faces, strict=True)
        ]
        shape = len(edges), len(used), E.shape[1]
        found = np.array(waves).reshape(shape)[:, which]
        return found, np.abs(edges).sum(axis=1) + np.abs(faces).sum(axis=1)

    def normals(self, row: Array, place: Place) -> Array:
        """Unit normals (q, 3)."""
        (along, across), error = self.directions(row, place)
        noise, other = basis.NOISE * error
        result = kernels.unit_normals(along, across, (noise, other))
        if len(at := place.corner):
            result[at] = np.nan
            if self._masks.has_normal:
                (x, y), sizes = self._waves(self._rings.ring[row[at]])
                noise = basis.NOISE * sizes[:, None, None] * np.ones((1, len(at), 1))
                result[at] = kernels.unit_normals(x, y, (noise[0], noise[1]))
        return result

    def is_flat(self, row: Array, normal: Array) -> Array:
        """Whether all control points lie in the plane of a normal (n, 3), up to rounding, (n,)."""
        ring = self._rings.ring[row]
        used, which = np.unique(ring, return_inverse=True)
        _, first = np.unique(which, return_index=True)
        around = np.concatenate([self._first.edges[used], self._first.faces[used]], axis=2)
        own = self._outer_points(row, self._first, ring, 0)
        high = np.abs(np.einsum("rd,rdk->rk", normal[first], around)).max(axis=1)
        beyond = np.abs(np.einsum("qd,qkd->qk", normal, own)).max(axis=1)
        size = np.maximum(np.abs(own).max(axis=(1, 2)), 1)
        return np.asarray(np.maximum(high[which], beyond) <= basis.NOISE * size)


def is_convex(masks: RingMasks) -> bool:
    """Whether all refined points are convex combinations."""
    w = masks.weights
    smooth = (w.own, w.edge, w.around) if masks.sector.kind in ("interior", "dart") else ()
    others = w.corner, w.end, w.face, w.half, w.beside, 1 - 2 * w.beside
    return bool(min(*others, *smooth) >= 0)


def on_curve(masks: RingMasks, position: Array, s: Array, t: Array, nu: Order) -> Array:
    """Whether queries ask for a derivative along a sharp side of a sector that they are on, (n,).

    There the limit is one piece of a cubic spline, and has these at the corner too; elsewhere the
    slowest wave falls by more than a half, and leaves none at the corner.
    """
    if min(nu) > 0 or not masks.sector.open:
        return np.zeros(len(position), dtype=bool)
    axis = int(nu[0] == 0)
    return np.asarray(sharp_sides(masks, position)[axis] & ((t, s)[axis] == 0))


def at_corners(masks: RingMasks, position: Array, nu: Order) -> Array:
    """Derivatives at corners (n,), where they are not `on_curve`: 0 if they vanish around, or NaN.

    Along a sharp side pieces are those of a curve, whose degree may be less than theirs.
    """
    gone = np.full(len(position), masks.spline.vanishes(nu))
    if min(nu) == 0 and max(nu) >= len(masks.spline.curve):
        gone |= sharp_sides(masks, position)[int(nu[0] == 0)]
    return np.where(gone, 0.0, np.nan)


def _curve_weights(masks: RingMasks, x: Array, order: int) -> Array:
    """Weights (n, 4) of points of a sharp side; at a corner the first is a reflection."""
    return (
        ring_grids.reflected(x, order)
        if masks.sector.kind == "corner"
        else kernels.cubic_weights(x, order)
    )


def _ahead(masks: RingMasks, axis: int) -> int:
    """Which outer point continues the edge along u, or along v."""
    return masks.sector.lattice.outer.index(_AHEAD[axis])


def columns(sector: tables.Sector, position: int) -> tuple[Array, tables.Sector]:
    """Where the control points of a face stand among those of a shared ring and all outer ones.

    Also the sector of the face, in whose order they are.
    """
    turns = 0 if sector.open or sector.kind == "dart" else position
    own = replace(sector, position=position - turns)
    ring, lattice = np.arange(sector.ring), sector.lattice
    if turns:
        ring[1:] = 1 + (ring[1:] - 1 + len(lattice.orbits) * turns) % (sector.ring - 1)
    outer = sector.ring + np.array([lattice.outer.index(place) for place in own.outer])
    return np.concatenate([ring, outer]), own


def weights(masks: RingMasks, position: Array, s: Array, t: Array, turn: Array, nu: Order) -> Array:
    """Weights (q, K) of control points for a derivative in (s, t) of patches.

    K counts a shared ring, then all outer points. The steps of refinement, transposed: weights are
    those of points relative to the vertex, which at the end takes what is missing.
    """
    edges, faces = (len(x) for x in masks.limit)
    rows = _Rows(np.zeros((len(position), edges)), np.zeros((len(position), faces)))
    outer = np.zeros((len(position), len(masks.sector.lattice.outer)))
    order, local = sum(nu), basis.CornerPlace.of(s, t, turn, masks.sector.lattice)
    curve = on_curve(masks, position, s, t, nu) & (order > 0)
    level = np.where(curve, -1, local.level)
    away = level >= 0
    if order == 0:
        rows.edges[away] -= masks.limit[0]
        rows.faces[away] -= masks.limit[1]
    else:
        rows.edges[~away] = at_corners(masks, position[~away], nu)[:, None]
        rows.edges[curve] = 0
        _set_curves(masks, (s, t)[int(nu[0] == 0)], nu, np.flatnonzero(curve), rows, outer)
    b = ring_grids.weights(masks, local, ring_grids.sharp_pieces(masks, position, local), nu)
    _descend(masks, position, level, local.piece, b, rows, outer)
    if not order:
        return _with_vertex(masks, rows, outer)
    result = _columns(masks, rows.edges, rows.faces, outer)
    exponent = np.where(away, order * (level + 1), 0)
    result[:, 1:] = kernels.scale_by_two(result[:, 1:], exponent[:, None])
    result[:, 0] = -result[:, 1:].sum(axis=1)
    return result


def piece_weights(
    masks: RingMasks, position: Array, level: Array, piece: Array, combined: Array
) -> Array:
    """Weights (q, K), as those of `weights`, of combinations of a piece's 16 control points.

    Of the regular pieces of faces after some halvings towards the corner, `combined` (q, 16).
    """
    edges, faces = masks.limit
    shape = len(position), 1
    rows = _Rows(np.tile(-edges, shape), np.tile(-faces, shape))
    outer = np.zeros((len(position), len(masks.sector.lattice.outer)))
    _descend(masks, position, level, piece, combined, rows, outer)
    return _with_vertex(masks, rows, outer)


def _descend(
    masks: RingMasks,
    position: Array,
    level: Array,
    piece: Array,
    b: Array,
    rows: _Rows,
    outer: Array,
) -> None:
    """Add what the control points of pieces (q, 16) take from rings and outer points."""
    fine, (j, i) = np.zeros((len(position), 5, 5)), Layout.of(masks).pieces
    fine[np.arange(len(b))[:, None], j[piece], i[piece]] = b
    for step in range(int(level.max(initial=-1)), -1, -1):
        here = np.flatnonzero(level >= step)
        some = _Rows(rows.edges[here], rows.faces[here])
        some, grid = some.coarser(masks, position[here], fine[here])
        if step:
            fine[here] = 0
            fine[here, :4, :4] = grid
        else:
            outer[here] += some.gathered(masks, position[here], grid)
        rows.edges[here], rows.faces[here] = some.edges, some.faces


def _with_vertex(masks: RingMasks, rows: _Rows, outer: Array) -> Array:
    """Weights (q, K) in positions from those of points relative to the limit of the vertex."""
    edges, faces = masks.limit
    result = _columns(masks, rows.edges + edges, rows.faces + faces, outer)
    result[:, 0] = 1 - result[:, 1:].sum(axis=1)
    return result


def _columns(masks: RingMasks, edges: Array, faces: Array, outer: Array) -> Array:
    """Weights (q, K) in the order of control points, but for the vertex."""
    ring = masks.sector.ring
    result = np.empty((len(outer), ring + outer.shape[1]))
    for part, found in zip(tables.orbits(masks.sector.lattice), (edges, faces), strict=True):
        result[:, :ring][:, part] = found
    result[:, ring:] = outer
    return result


@dataclass(frozen=True)
class _Rows:
    """Weights of the points of rings relative to the vertex, (q, edges) and (q, faces)."""

    edges: Array
    faces: Array

    def coarser(self, masks: RingMasks, position: Array, fine: Array) -> tuple[_Rows, Array]:
        """Those one step before, and of 4 x 4 control points, (q, 4, 4).

        `fine` (q, 5, 5) are weights of refined points of a patch: `Ring.refined`, transposed.
        """
        w, kind = masks.weights, masks.sector.kind
        edges = self.edges.copy()
        grid, total = ring_grids.coarser(masks, position, fine, edges)
        step = -(total + edges.sum(axis=1) + self.faces.sum(axis=1))[:, None]
        smooth = edges.copy()
        sharp = {"dart": [0], "crease": [0, -1], "corner": [0, -1]}.get(kind, [])
        smooth[:, sharp] = 0
        around, result = self.faces, w.end * smooth
        if around.shape[1]:
            around = around + w.face * (_before(smooth, masks) + _after(smooth, masks))
        elif masks.sector.open:
            result[:, :-1] += w.face * smooth[:, 1:]
            result[:, 1:] += w.face * smooth[:, :-1]
        else:
            result += w.face * (np.roll(smooth, 1, axis=1) + np.roll(smooth, -1, axis=1))
        if kind in ("interior", "dart"):
            around = around + w.around * step
            result += w.edge * step
        result[:, sharp] += w.half * edges[:, sharp]
        if kind == "crease":
            result[:, sharp] += w.beside * step
        if not around.shape[1]:
            return _Rows(result, around), grid
        if masks.sector.open:
            result[:, :-1] += w.corner * around
            result[:, 1:] += w.corner * around
        else:
            result += w.corner * (around + np.roll(around, 1, axis=1))
        return _Rows(result, w.corner * around), grid

    def gathered(self, masks: RingMasks, position: Array, grid: Array) -> Array:
        """Add what 4 x 4 control points take from the ring; return that of outer ones, (q, n)."""
        return ring_grids.gathered(masks, position, grid, self.edges, self.faces)


def _set_curves(
    masks: RingMasks, x: Array, nu: Order, here: Array, rows: _Rows, outer: Array
) -> None:
    """Weights of derivatives at x (q,) along sharp sides of sectors, of the queries `here`."""
    back, _, ahead, beyond = _curve_weights(masks, x[here], sum(nu)).T
    axis = int(nu[0] == 0)
    near, far = _ENDS[axis]
    rows.edges[here, near], rows.edges[here, far] = ahead, back
    outer[here, _ahead(masks, axis)] = beyond
