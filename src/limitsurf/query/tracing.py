"""Leaves joined to curves: what is on a side that cells share is found once, for all of them.

The sides of cells lie on lines: the edges of the cage, the lines between limit faces of a face, and
those inside of limit faces. All ends of sides part a line into segments. A curve crosses a segment
where the signs at its ends differ, once; so each cell is crossed an even number of times, and
curves do not end but on the boundary of the surface.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import memory
from limitsurf.cage.connectivity import Connectivity
from limitsurf.query.leaves import CORNER, KNOT, SHIFT, TOUCH, Leaves
from limitsurf.query.polynomials import Form
from limitsurf.query.records import Rows, numbered
from limitsurf.surface import LimitSurface

if TYPE_CHECKING:
    from limitsurf.scheme.lattice import Lattice

Array = NDArray[Any]

_STEPS = 64  # of the search for a root, at most: halvings are
_EPS = 2.0**-53
_ON = 2.0**-45  # a place where the function is no more is on the curve


@dataclass(slots=True)
class Nodes:
    """Places where curves enter cells: on limit faces (N,), at (u, v) (N, 2)."""

    face: Array
    uv: Array


@dataclass(slots=True)
class Spans(Rows):
    """Parts of curves between two nodes, (S,), inside of a leaf or on its side.

    `sign` is 1 where what is above is on the left from node `a` to `b`, -1 on the right, 0 unknown.
    A span goes in the leaf from (s, t) `start` to `end`; along them, by steps of equal length in
    s or t as the leaf is a graph of. `bend` is as in `Leaves`.
    """

    a: Array
    b: Array
    sign: Array
    leaf: Array
    start: Array  # (S, 2)
    end: Array
    bend: Array


@dataclass(frozen=True)
class Adjacency:
    """Which sides of limit faces are one: those of the same edges of a cage.

    Limit face k is face ``face[k]`` of the cage, or its part at ``corner[k]`` if that is not -1.
    Half-edges (C,) are on edges ``edge``, which have the vertices ``ends`` (E, 2), the lower first.
    """

    cage: Connectivity
    face: Array
    corner: Array
    edge: Array
    ends: Array

    @classmethod
    def of(cls, surface: LimitSurface) -> Adjacency:
        """That of a surface whose function is continuous."""
        faces, cage = surface.limit_faces, surface.mesh.connectivity
        return cls(cage, faces.face, faces.corner, cage.corner_edge, cage.edges)


class Network:
    """The nodes and spans of the leaves of a surface.

    The function is the same on both sides of what `adjacency` says is one; elsewhere curves end.
    """

    def __init__(
        self, surface: LimitSurface, leaves: Leaves, form: Form, own: Form, adjacency: Adjacency
    ) -> None:
        self._surface, self.leaves, self._form, self._own = surface, leaves, form, own
        self._adjacency = adjacency
        self._sides()
        self._signs()
        self._cross()
        parts = [self._graphs(), self._touching(), self._knots()]
        spans = Spans.joined(parts)
        self.spans = spans[spans.a != spans.b]

    # ------------------------------------------------------------------ sides and vertices

    def _sides(self) -> None:
        """Segments of all sides: `_leaf`, `_side`, `_segment` and `_from`, `_to` along the side."""
        cells, ends = self.leaves.cells, self._form.ends
        count, c = len(cells), len(self._form.ends)
        self._uv = cells.frame[:, :1] + np.matmul(ends, cells.frame[:, 1:])  # (L, c, 2)
        on = OnLines(self._surface.topology.lattice, self._adjacency, cells.face, self._uv)
        self._on_side = on.of_faces
        uv = np.stack([self._uv, np.roll(self._uv, -1, axis=1)], axis=2)  # (L, c, 2, 2)
        line, value, along = on.sides(uv)  # (L, c), (L, c), (L, c, 2)
        line = line + on.count * cells.level[:, None]
        vertex, which = on.vertices()
        vertex = vertex + on.total * cells.level[:, None]
        keys = [which[..., 1].ravel(), which[..., 0].ravel(), vertex.ravel()]
        number, self._first = numbered(keys)
        self._vertex = number.reshape(count, c)
        both = np.stack([self._vertex, np.roll(self._vertex, -1, axis=1)], axis=2)
        lines = [np.repeat(x.ravel(), 2) for x in (value, line)]
        point, first = numbered([along.ravel(), *lines])
        self.at = along.ravel()[first]  # where points lie on their lines
        self._of_point = both.ravel()[first]  # and which vertices they are
        point = point.reshape(-1, 2)
        low, high = point.min(axis=1), point.max(axis=1)
        each = high - low
        owner = np.repeat(np.arange(len(each)), each)
        step = np.arange(len(owner)) - np.repeat(np.cumsum(each) - each, each)
        self._segment = low[owner] + step
        self._leaf, self._side = owner // c, owner % c
        ends_at = along.reshape(-1, 2)[owner]
        length = ends_at[:, 1] - ends_at[:, 0]
        part = np.stack([self.at[self._segment], self.at[self._segment + 1]], axis=1)
        self._along = (part - ends_at[:, :1]) / length[:, None]  # by the direction of the line
        self._length = np.abs(length)

    def _signs(self) -> None:
        """Whether vertices are above, or 0 up to rounding; the nodes that they are."""
        cells, first = self.leaves.cells, self._first
        value = self.leaves.corners.ravel()[first]
        self._above = value + SHIFT >= 0
        self._zero = np.abs(value) <= SHIFT
        face = np.repeat(cells.face, len(self._form.ends))[first]
        self.nodes = Nodes(face, self._uv.reshape(-1, 2)[first])

    def _cross(self) -> None:
        """Nodes of the segments that a curve crosses: `_node` and `_spot`, (s, t), of entries."""
        ends = self._of_point[self._segment], self._of_point[self._segment + 1]
        entry = np.flatnonzero(self._above[ends[0]] != self._above[ends[1]])
        self._entry = entry
        above = np.where(self._above[ends[0][entry]], ends[0][entry], ends[1][entry])
        at_vertex = self._zero[above]
        kind = self.leaves.kind[self._leaf[entry]]
        # of the cells that share a segment one says where: no corner, the smallest, the first
        keys = [self._leaf[entry], self._length[entry], kind == CORNER, self._segment[entry]]
        order = np.lexsort(keys)
        segment = self._segment[entry][order]
        new = np.append(True, segment[1:] != segment[:-1])[: len(segment)]
        group = np.cumsum(new) - 1
        chosen = order[new]
        place, face, uv = self._roots(entry[chosen])
        number = np.empty(len(entry), dtype=np.int64)
        number[order] = group
        vertices = len(self.nodes.face)
        node = np.where(at_vertex, above, vertices + number)
        # all nodes of what is known of a special corner alone are that corner
        alone = np.flatnonzero((kind == CORNER)[chosen])
        if len(alone):
            leaf = self._leaf[entry[chosen[alone]]]
            corner = self._vertex[leaf, self.leaves.special[leaf]]
            moved = np.arange(len(chosen)) + vertices
            moved[alone] = corner
            node = np.where(at_vertex, above, moved[number])
        self._node = node
        first = self._of_point[self._segment[entry]]
        x = np.where(first == above, *self._along[entry].T)
        free = np.flatnonzero(~at_vertex)
        own, source = entry[free], entry[chosen][number[free]]
        low, high = self._along[source].T
        part = (place[number[free]] - low) / (high - low)
        low, high = self._along[own].T
        x[free] = low + part * (high - low)
        side = self._side[entry]
        ends_at = self._form.ends
        to = ends_at[(side + 1) % len(ends_at)]
        self._spot = ends_at[side] + x[:, None] * (to - ends_at[side])
        self.nodes.face = np.concatenate([self.nodes.face, face])
        self.nodes.uv = np.concatenate([self.nodes.uv, uv])

    @property
    def crossings(self) -> tuple[Array, Array, Array, Array]:
        """All places where leaves (n,) are entered: (u, v) there, sides of limit faces, nodes.

        Sides are -1 inside of limit faces.
        """
        leaf = self._leaf[self._entry]
        side = self._on_side[leaf, self._side[self._entry]]
        return leaf, self._placed(leaf, self._spot), side, self._node

    def _roots(self, entry: Array) -> tuple[Array, Array, Array]:
        """Where along their sides entries are crossed, (n,), with limit faces and (u, v)."""
        leaf, side, cells = self._leaf[entry], self._side[entry], self.leaves.cells
        a, b = self._form.ends[side], np.roll(self._form.ends, -1, axis=0)[side]
        place = roots(self._own, cells.values[leaf], a, b - a, *self._along[entry].T)
        spot = a + place[:, None] * (b - a)
        return place, cells.face[leaf], self._placed(leaf, spot)

    def _placed(self, leaf: Array, spot: Array) -> Array:
        """The (u, v) of places (s, t) in leaves, (n, 2)."""
        frame = self.leaves.cells.frame[leaf]
        return np.asarray(frame[:, 0] + np.matmul(spot[:, None], frame[:, 1:])[:, 0])

    # ------------------------------------------------------------------ spans

    def _graphs(self) -> Spans:
        """Those across graphs: crossings in order, two and two."""
        leaf = self._leaf[self._entry]
        some = np.flatnonzero(self.leaves.kind[leaf] < TOUCH)
        way = self.leaves.kind[leaf[some]]
        along = self._spot[some, way]
        order = some[np.lexsort([self._spot[some, 1 - way], along, leaf[some]])]
        a, b = order[0::2], order[1::2]
        own = leaf[a]
        cells, way = self.leaves.cells, self.leaves.kind[own]
        # what is above is on the left of s where the function rises along t, and of -t along s
        slope = np.matmul(self._own.derivatives[1:3], cells.values[own].T).sum(axis=1)  # (2, S)
        rises = slope[1 - way, np.arange(len(own))]
        sign = np.where(way == 0, np.sign(rises), -np.sign(rises))
        start, end, bend = self._spot[a], self._spot[b], self.leaves.bend[own]
        return Spans(self._node[a], self._node[b], sign, own, start, end, bend)

    def _touching(self) -> Spans:
        """Those on sides along which all is 0, if it is below on one side alone."""
        a, b = self._of_point[self._segment], self._of_point[self._segment + 1]
        some = np.flatnonzero(
            (self.leaves.kind[self._leaf] == TOUCH) & self._above[a] & self._above[b]
        )
        segment = self._segment[some]
        odd = np.bincount(segment, minlength=len(self._of_point))[segment] % 2 == 1
        some = some[odd]
        segment, which = np.unique(self._segment[some], return_index=True)
        some = some[which]
        leaf, side = self._leaf[some], self._side[some]
        ends = self._form.ends[side], np.roll(self._form.ends, -1, axis=0)[side]
        low, high = self._along[some].T
        # what is below is on the left as one goes around a cell
        sign = np.where(low < high, -1.0, 1.0)
        start, end = (ends[0] + x[:, None] * (ends[1] - ends[0]) for x in (low, high))
        return Spans(a[some], b[some], sign, leaf, start, end, self.leaves.bend[leaf])

    def _knots(self) -> Spans:
        """From the middle of what is undecided to all curves that end there, or between two."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        leaves = self.leaves
        knot = np.flatnonzero(leaves.kind >= KNOT)
        vertex, c = self._vertex[knot], len(self._form.ends)
        size = len(knot), len(self._above)
        pairs = np.repeat(np.arange(len(knot)), c), len(knot) + vertex.ravel()
        graph = coo_array((np.ones(len(pairs[0])), pairs), shape=(sum(size), sum(size)))
        label = np.full(len(leaves), -1)
        label[knot] = connected_components(graph, directed=False)[1][: len(knot)]
        group = label[self._leaf[self._entry]]
        segment = self._segment[self._entry]
        inner = np.bincount(segment[group >= 0], minlength=len(self._of_point))
        out = np.flatnonzero((group >= 0) & (inner[segment] % 2 == 1))
        # (what meets a knot twice at a vertex goes on there without it)
        pair = group[out] * (1 + int(self._node.max(initial=0))) + self._node[out]
        _, which, times = np.unique(pair, return_index=True, return_counts=True)
        out = out[which[times % 2 == 1]]
        group, node = group[out], self._node[out]
        count = np.bincount(group, minlength=len(knot) + 1)
        middle = self._middles(knot, label, count, group, node)
        center = middle[group]
        own = self._leaf[self._entry[out]]
        star = center >= 0
        # two curves that meet are one
        through = np.flatnonzero(~star & (count[group] == 2))
        a = np.concatenate([node[star], node[through[0::2]]])
        b = np.concatenate([center[star], node[through[1::2]]])
        leaf = np.concatenate([own[star], own[through[0::2]]])
        none = np.zeros((len(a), 2))
        return Spans(a, b, np.zeros(len(a)), leaf, none, none, np.zeros(len(a)))

    def _middles(self, knot: Array, label: Array, count: Array, group: Array, node: Array) -> Array:
        """Nodes where the curves of knots meet, by their labels; -1 where two go on."""
        leaves = self.leaves
        found = np.full(len(count), -1)
        # of many the first, unless there is a better one
        first = np.unique(group, return_index=True)
        many = count[first[0]] > 2
        found[first[0][many]] = node[first[1][many]]
        corner = knot[leaves.kind[knot] == CORNER]
        vertex = self._vertex[corner, leaves.special[corner]]
        exact = np.abs(leaves.corners[corner, leaves.special[corner]]) <= _ON
        special = np.full(len(count), -1)
        special[label[corner[exact]][::-1]] = vertex[exact][::-1]
        plain = knot[leaves.kind[knot] == KNOT]
        plain = plain[(count[label[plain]] > 2) & (special[label[plain]] < 0)]
        spot, settled = self._level_places(plain)
        at, which = np.unique(label[plain[settled]], return_index=True)
        leaf = plain[settled][which]
        n = len(self.nodes.face)
        self.nodes.face = np.concatenate([self.nodes.face, leaves.cells.face[leaf]])
        uv = self._placed(leaf, spot[settled][which])
        self.nodes.uv = np.concatenate([self.nodes.uv, uv])
        found[at] = n + np.arange(len(at))
        return np.where(special >= 0, special, found)

    def _level_places(self, leaf: Array) -> tuple[Array, Array]:
        """Where functions on leaves have no slope, (n, 2), and whether that is inside."""
        s, t = np.broadcast_to(self._form.ends.mean(axis=0), (len(leaf), 2)).T
        values = self.leaves.cells.values[leaf]
        size = np.abs(values).max(axis=1, initial=0)
        if not len(leaf):
            return np.zeros((0, 2)), np.zeros(0, dtype=bool)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for _ in range(8):
                x = np.matmul(self._own.values(s, t), values[:, :, None])[:, 1:, 0]
                fs, ft, ss, st, tt = x.T
                det = ss * tt - st * st
                s = np.clip(s - (tt * fs - st * ft) / det, -1, 2)
                t = np.clip(t - (ss * ft - st * fs) / det, -1, 2)
        spot = np.stack([s, t], axis=1)
        one = np.stack([np.ones(len(s)), s, t], axis=1) @ np.array(self._sides_of_domain()).T
        inside = np.isfinite(spot).all(axis=1) & (one >= -1e-3).all(axis=1)
        spot = np.clip(np.nan_to_num(spot), 0, 1)
        round_ = np.round(spot)
        spot = np.where(np.abs(spot - round_) < 1e-3, round_, spot)
        x = np.matmul(self._own.values(spot[:, 0], spot[:, 1], 0), values[:, :, None])[:, 0, 0]
        return spot, inside & (np.abs(x) <= _ON) & (size > 0)

    def _sides_of_domain(self) -> Any:
        return self._surface.topology.lattice.edges

    # ------------------------------------------------------------------ points along spans

    def points(self, tolerance: float) -> tuple[Array, Nodes]:
        """Offsets (S + 1,) and places between the nodes of all spans, from a to b."""
        spans, leaves = self.spans, self.leaves
        step = spans.end - spans.start
        kind = leaves.kind[spans.leaf]
        way = np.where(kind == TOUCH, np.abs(step[:, 1]) > np.abs(step[:, 0]), kind == 1)
        way = way.astype(np.int64)
        every = np.arange(len(spans))
        length = np.abs(step[every, way])
        parts = np.ceil(length * np.sqrt(spans.bend / (8 * tolerance)))
        total = float(parts.sum())
        if not total < 2**62:
            total = 2.0**62
        memory.refuse_beyond(int(total), 200, "points of curves", "choose a larger tolerance")
        each = np.maximum(parts.astype(np.int64) - 1, 0)
        owner = np.repeat(every, each)
        number = 1 + np.arange(len(owner)) - np.repeat(np.cumsum(each) - each, each)
        share = (number / (each[owner] + 1))[:, None]
        spot = spans.start[owner] + share * step[owner]
        graph = np.flatnonzero(kind[owner] < TOUCH)
        across = 1 - way[owner[graph]]
        rows = np.arange(len(graph))
        start, direction = spot[graph].copy(), np.zeros((len(graph), 2))
        guess = start[rows, across]
        start[rows, across] = 0
        direction[rows, across] = 1
        sloped = self._surface.topology.lattice.sloped
        high = 1 - start[rows, 1 - across] if sloped else np.ones(len(graph))
        values = leaves.cells.values[spans.leaf[owner[graph]]]
        x = roots(self._own, values, start, direction, np.zeros(len(graph)), high, guess)
        spot[graph] = start + x[:, None] * direction
        leaf = spans.leaf[owner]
        places = Nodes(leaves.cells.face[leaf], self._placed(leaf, spot))
        return np.concatenate([[0], np.cumsum(each)]), places


def roots(
    form: Form,
    values: Array,
    start: Array,
    direction: Array,
    low: Array,
    high: Array,
    guess: Array | None = None,
) -> Array:
    """Where polynomials (n, m) change their sign along lines, between `low` and `high` (n,).

    By Newton's method, by halving where that leaves what encloses the root. Where there is no
    change, the end at which they are less in size.
    """
    n = len(values)
    if not n:
        return np.zeros(0)

    def at(x: Array, which: Any, order: int = 0) -> Array:
        s, t = (start[which] + x[:, None] * direction[which]).T
        return np.asarray(np.matmul(form.values(s, t, order), values[which][:, :, None])[..., 0])

    every = slice(None)
    first, last = at(low, every)[:, 0], at(high, every)[:, 0]
    found = np.where(np.abs(first) <= np.abs(last), low, high)
    active = np.flatnonzero((first < 0) != (last < 0))
    active = active[(first[active] != 0) & (last[active] != 0)]
    a, b, rises = low[active], high[active], last[active] > 0
    x = (a + b) / 2 if guess is None else guess[active]
    with np.errstate(divide="ignore", invalid="ignore"):
        if guess is None:
            f, g = first[active], last[active]
            x = a - (b - a) * f / (g - f)
        for _ in range(_STEPS):
            if not len(active):
                break
            x = np.where((x > np.minimum(a, b)) & (x < np.maximum(a, b)), x, (a + b) / 2)
            f, ds, dt = at(x, active, 2)[:, :3].T
            slope = ds * direction[active, 0] + dt * direction[active, 1]
            below = (f < 0) == rises
            a, b = np.where(below, x, a), np.where(below, b, x)
            new = x - f / slope
            found[active] = x
            scale = np.maximum(np.abs(low[active]), np.abs(high[active]))
            on = (np.abs(new - x) > 4 * _EPS * scale) & (np.abs(b - a) > 2 * _EPS * scale)
            on &= f != 0
            done = ~on & (np.abs(new - x) <= np.abs(b - a))
            # a last step, if it stays inside
            inside = done & (new > np.minimum(a, b)) & (new < np.maximum(a, b))
            found[active[inside]] = new[inside]
            active, a, b, rises, x = (z[on] for z in (active, a, b, rises, new))
    return found


class OnLines:
    """On which lines the corners and sides of cells lie: `uv` (L, c, 2) on limit faces (L,).

    Attributes
    ----------
    line, base, scale : (L, c)
        Of each side of the limit face its line; where there x is that goes from 0 to 1 along the
        side from corner k to the next: ``base + scale * x``.
    of_faces : (L, c)
        On which side of its limit face each side of a cell lies, or -1.
    """

    def __init__(self, lattice: Lattice, adjacency: Adjacency, face: Array, uv: Array) -> None:
        mesh, self._edges = adjacency.cage, adjacency.ends
        self._mesh, self._face, self._uv = mesh, face, uv
        edges, self._ends = np.array(lattice.edges), np.array(lattice.corners)
        c = len(self._ends)
        number, self._cage = adjacency.corner[face], adjacency.face[face]
        first = mesh.offsets[self._cage][:, None]
        whole = number < 0
        half = first + np.where(whole[:, None], np.arange(c), 0)
        before = np.zeros_like(half)
        if not whole.all():  # their sides: half an edge, two lines inside of the face, half an edge
            part = np.flatnonzero(~whole)
            own = first[part, 0] + number[part]
            previous = mesh.previous_corner[own]
            half[part] = np.stack([own, own, previous, previous], axis=1)
            before[part] = [0, 1, 1, 0]
        start, end = mesh.indices[half], mesh.indices[mesh.next_corner[half]]
        turned = start > end
        scale = np.where(turned, -1.0, 1.0)
        base = np.where(turned, 1.0, 0.0)
        if not whole.all():
            # along the half-edge by x / 2, or (1 + x) / 2
            scale[part] /= 2
            base[part, 3] += scale[part, 3]
            scale[part, 1:3] = [1, -1]
            base[part, 1:3] = [0, 1]
        # (a n-gon's corner 3 comes before its corner 0, along the previous half-edge)
        self.line = np.where(before == 1, len(self._edges) + half, adjacency.edge[half])
        self.scale, self.base = scale, base
        n = len(adjacency.face)
        self._first_line = n
        self._first_end = n + len(self._edges) + mesh.n_corners
        self.total = self._first_end + mesh.n_vertices + mesh.n_faces
        self.count = self.total + 3 * n
        place = np.concatenate([np.ones((*uv.shape[:2], 1)), uv], axis=2)
        self._on = np.matmul(place, edges.T) == 0  # (L, c, sides of limit faces)
        self._both = self._on & np.roll(self._on, -1, axis=1)
        self.of_faces = np.where(self._both.any(axis=2), self._both.argmax(axis=2), -1)

    def _along(self, side: Any, uv: Array) -> Array:
        """Where places (L, ..., 2) lie along sides of limit faces, by the lines of these."""
        a, b = self._ends[side], self._ends[(side + 1) % len(self._ends)]
        x = (uv - a) @ (b - a) / ((b - a) @ (b - a))
        shape = (-1, *(1,) * (x.ndim - 1))
        return np.asarray(
            self.base[:, side].reshape(shape) + self.scale[:, side].reshape(shape) * x
        )

    def sides(self, uv: Array) -> tuple[Array, Array, Array]:
        """Lines (L, c) of sides from `uv[:, :, 0]` to `uv[:, :, 1]`, and where these ends lie."""
        (u0, v0), (u1, v1) = uv[:, :, 0].transpose(2, 0, 1), uv[:, :, 1].transpose(2, 0, 1)
        # inside of a limit face: u, v, or u + v is the same
        kind = np.where(u0 == u1, 0, np.where(v0 == v1, 1, 2))
        value = np.where(kind == 0, u0, np.where(kind == 1, v0, u0 + v0))
        along = np.where((kind == 0)[..., None], uv[..., 1], uv[..., 0])
        line = self.total + 3 * self._face[:, None] + kind
        for side in range(len(self._ends)):
            on = self._both[:, :, side]
            line = np.where(on, self._first_line + self.line[:, side, None], line)
            value = np.where(on, 0.0, value)
            along = np.where(on[..., None], self._along(side, uv), along)
        return line, value, along

    def vertices(self) -> tuple[Array, Array]:
        """Numbers (L, c) of what corners lie on, and where there, (L, c, 2)."""
        mesh = self._mesh
        number = np.broadcast_to(self._face[:, None], self._uv.shape[:2])
        where = self._uv
        inner = np.zeros(number.shape, dtype=bool)  # on a line inside of a face
        taken = np.zeros(number.shape, dtype=bool)
        for side in range(len(self._ends)):
            line = self.line[:, side, None]
            x = self._along(side, self._uv)
            spoke = line >= len(self._edges)
            end = (x == 0) | (x == 1)
            on = self._on[:, :, side] & (~taken | inner)
            # ends of edges are vertices, lines end in the middle of the face
            ends = np.minimum(line, len(self._edges) - 1)
            vertex = np.where(x == 1, self._edges[ends, 1], self._edges[ends, 0])
            middle = mesh.n_vertices + self._cage[:, None]
            at_end = self._first_end + np.where(spoke, middle, vertex)
            ends_there = end & (~spoke | (x == 1))
            found = np.where(ends_there, at_end, self._first_line + line)
            number = np.where(on, found, number)
            there = np.stack([np.where(ends_there, 0, x), np.zeros_like(x)], axis=2)
            where = np.where(on[..., None], there, where)
            inner = np.where(on, spoke & ~(x == 1), inner)
            taken |= self._on[:, :, side]
        return number, where


def chained(spans: Spans, number: Array, n_nodes: int) -> tuple[Array, Array, Array, Array]:
    """Spans in order along curves, with offsets (n + 1,), (S,), whether backwards, and closed (n,).

    Curves end at nodes that do not join two spans. They go so that what is above is on the left of
    most of their spans. Those of small `number` (S,) come first.
    """
    count = len(spans)
    if not count:
        none = np.zeros(0, dtype=np.int64)
        return np.zeros(1, dtype=np.int64), none, none.astype(bool), none.astype(bool)
    n = 2 * count
    dart = np.arange(n)  # each span, then each backwards
    tail = np.concatenate([spans.a, spans.b])
    head, back = np.roll(tail, count), np.roll(dart, count)
    degree = np.bincount(tail, minlength=n_nodes)
    order = np.argsort(tail, kind="stable")
    first = np.cumsum(degree) - degree
    # before a dart: the other one that leaves its tail, backwards
    pair = order[np.minimum(first[tail] + 1, n - 1)] + order[first[tail]]
    joined = degree[tail] == 2
    before = np.where(joined, back[np.where(joined, pair - dart, dart)], dart)
    steps = n.bit_length()
    least, way = dart, before
    for _ in range(steps):
        least, way = np.minimum(least, least[way]), way[way]
    cycle = joined[way]  # no end was met: these begin at their least dart
    start = (before == dart) | (cycle & (least == dart))
    to = np.where(start, dart, before)
    rank = (~start).astype(np.int64)
    for _ in range(steps):
        rank, to = rank + rank[to], to[to]
    vote = np.bincount(to, np.concatenate([spans.sign, -spans.sign]), minlength=n)
    least = np.full(n, n)
    np.minimum.at(least, to, dart % count)
    forward = np.zeros(n, dtype=bool)
    forward[to[:count]] |= least[to[:count]] == dart[:count]
    keep = (vote > 0) | ((vote == 0) & forward)
    kept = np.flatnonzero(keep[to])
    # curves in the order of their first spans
    kept = kept[np.lexsort([rank[kept], least[to[kept]], number[kept % count]])]
    new = np.flatnonzero(rank[kept] == 0)
    offsets = np.append(new, len(kept))
    closed = tail[kept[new]] == head[kept[offsets[1:] - 1]]
    return offsets, kept % count, kept >= count, closed
