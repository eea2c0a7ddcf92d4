"""Sharp edges, across which a function jumps: level sets run along them where its signs differ.

The sides of limit faces at sharp edges are not joined, so the level sets of both sides end there.
Each strand of an edge, which is one of its sides, has a sign between any two of these ends; it
changes at every end. The level set of what jumps is, besides, where strands differ in sign: so what
ends on one strand goes on along the edge. ``derivations/silhouettes.py`` derives this.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.connectivity import Connectivity
from limitsurf.query.index import Cells
from limitsurf.query.leaves import TOUCH, Leaves, Pieces
from limitsurf.query.normals import OfNormals
from limitsurf.query.records import numbered
from limitsurf.query.tracing import Adjacency, Network, Nodes, OnLines, Spans
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_SAME = 2.0**-40  # of an edge: ends that are no farther apart are one
_SAMPLES = 9  # of the bend of an edge


@dataclass(frozen=True)
class _Sides:
    """Sharp sides of limit faces, (B,): which, and where they lie on edges.

    `line` numbers edges that have two strands or more, `strand` is which strand of its edge, `base`
    and `scale` are as in `OnLines`, `ends` (B, 2) are the numbers of the corners.
    """

    face: Array
    side: Array
    line: Array
    strand: Array
    base: Array
    scale: Array
    ends: Array


class Borders:
    """The sharp sides of a surface, and what is joined across all others."""

    def __init__(self, surface: LimitSurface) -> None:
        self._surface, self._lattice = surface, surface.topology.lattice
        whole, sharp = Adjacency.of(surface), surface.topology.sharp_sides
        self.adjacency = _parted(surface, whole, sharp)
        corners = np.array(self._lattice.corners, dtype=float)
        n = len(whole.face)
        faces, uv = np.arange(n), np.broadcast_to(corners, (n, *corners.shape))
        on, own = (OnLines(self._lattice, x, faces, uv) for x in (whole, self.adjacency))
        vertex, which = on.vertices()
        keys = [which[..., 1].ravel(), which[..., 0].ravel(), vertex.ravel()]
        number, first = numbered(keys)
        self._corner = number.reshape(n, -1)
        self._place = Nodes(first // len(corners), corners[first % len(corners)])
        self._sides = self._found(on, own, sharp)
        self.touched = np.zeros(len(first), dtype=bool)
        self.touched[self._sides.ends] = True

    def _found(self, on: OnLines, own: OnLines, sharp: Array) -> _Sides:
        face, side = np.nonzero(sharp)
        middle = self._surface.normal(face, *self._along(face, side, np.full(len(face), 0.5)).T)
        there = np.isfinite(middle).all(axis=1) | ~np.isin(face, self._holes())
        face, side = face[there], side[there]
        line, strand = on.line[face, side], own.line[face, side]
        number, first = numbered([strand, line])
        line_of = line[first]
        start = np.flatnonzero(np.append(True, line_of[1:] != line_of[:-1])[: len(line_of)])
        each = np.diff(np.append(start, len(line_of)))
        index = np.arange(len(line_of)) - np.repeat(start, each)
        kept = np.repeat(each >= 2, each)[number]
        face, side, number = face[kept], side[kept], number[kept]
        line, strand = np.unique(line[kept], return_inverse=True)[1], index[number]
        c = self._corner.shape[1]
        ends = np.stack([self._corner[face, side], self._corner[face, (side + 1) % c]], axis=1)
        return _Sides(face, side, line, strand, on.base[face, side], on.scale[face, side], ends)

    def _holes(self) -> Array:
        holes = self._surface.mesh.holes
        return np.flatnonzero(np.isin(self._surface.limit_faces.face, holes))

    def _along(self, face: Array, side: Array, x: Array) -> Array:
        """Places (n, 2) on sides of limit faces."""
        ends = np.array(self._lattice.corners, dtype=float)
        a, b = ends[side], ends[(side + 1) % len(ends)]
        return np.asarray(a + x[:, None] * (b - a))

    def finish(self, network: Network, cells: Cells, scalar: OfNormals, turned: bool) -> None:
        """Keep of a network what counts, and add what is along sharp edges.

        Curves go the other way if they are `turned`.
        """
        wanted = _Wanted(self._surface, network, scalar)
        spans, leaves = network.spans, network.leaves
        spans = spans[wanted.nodes(spans.a, spans.b)]
        if len(self._sides.face):
            known = len(network.nodes.face)
            places, to = self._joined(network)
            both = zip(_pair(network.nodes), places, strict=True)
            network.nodes = Nodes(*(np.concatenate(x) for x in both))
            more, rows = self._spans(network, scalar, wanted, to, known)
            more.leaf += len(leaves)
            network.leaves = self._with_sides(leaves, cells, rows)
            spans = Spans.joined([spans, more])
            spans.a, spans.b = to[spans.a], to[spans.b]
        if turned:
            spans.sign = -spans.sign
        network.spans = spans[spans.a != spans.b]

    def _joined(self, network: Network) -> tuple[tuple[Array, Array], Array]:
        """The corners of limit faces as nodes, and which nodes (n + k,) are among these."""
        known = len(network.nodes.face)
        to = np.arange(known + len(self.touched))
        face, uv = network.nodes.face, network.nodes.uv
        for k, corner in enumerate(np.array(self._lattice.corners, dtype=float)):
            here = np.flatnonzero((uv == corner).all(axis=1))
            number = self._corner[face[here], k]
            there = self.touched[number]
            to[here[there]] = known + number[there]
        return _pair(self._place), to

    def _spans(
        self, network: Network, scalar: OfNormals, wanted: _Wanted, to: Array, known: int
    ) -> tuple[Spans, Array]:
        """Spans along edges, of which `leaf` numbers the sides (r,) that are also given.

        Nodes that are one by `to` are more of them then.
        """
        sides = self._sides
        crossed = self._crossed(network, wanted)  # side, x
        line, strand = sides.line[crossed[0]], sides.strand[crossed[0]]
        at = sides.base[crossed[0]] + sides.scale[crossed[0]] * crossed[1]
        reference = self._reference(scalar, line, strand, at)
        # on each edge all crossings, and all ends of sides, in order
        none = np.full(2 * len(sides.face), -1)
        every = [
            np.concatenate([line, np.repeat(sides.line, 2)]),
            np.concatenate([at, (sides.base[:, None] + sides.scale[:, None] * [0, 1]).ravel()]),
            np.concatenate([strand, none]),
            np.concatenate([to[crossed[2]], known + sides.ends.ravel()]),
        ]
        order = np.lexsort(every[1::-1])
        line, at, strand, node = (x[order] for x in every)
        ahead = line[1:] == line[:-1]
        near = np.append(False, ahead & (at[1:] - at[:-1] <= _SAME))
        group = np.cumsum(~near) - 1
        best = np.lexsort([np.where(node >= known, 0, 1), group])
        chosen = node[best[np.append(True, np.diff(group[best]) > 0)]]
        to[node] = chosen[group]
        to[:] = to[to]
        middle = np.append(at[:-1] + at[1:], 0.0) / 2
        differ, first, above = self._signs(reference, line, strand, middle, scalar.odd)
        last = np.flatnonzero(np.append(ahead & (np.diff(group) > 0), False) & differ)
        return self._along_edges(line, at, to[node], last, first, above)

    def _crossed(self, network: Network, wanted: _Wanted) -> tuple[Array, Array, Array]:
        """Sides that level sets end on, where on these, and the nodes."""
        leaf, uv, side, node = network.crossings
        face = network.leaves.cells.face[leaf]
        c = self._corner.shape[1]
        number = np.full(c * len(self._corner), -1)
        number[c * self._sides.face + self._sides.side] = np.arange(len(self._sides.face))
        found = np.where(side >= 0, number[c * face + side], -1)
        some = np.flatnonzero(found >= 0)
        some = some[wanted.nodes(node[some], node[some])]
        ends = np.array(self._lattice.corners, dtype=float)
        a, b = ends[side[some]], ends[(side[some] + 1) % c]
        x = ((uv[some] - a) * (b - a)).sum(axis=1) / ((b - a) ** 2).sum(axis=1)
        return found[some], x, node[some]

    def _reference(self, scalar: OfNormals, line: Array, strand: Array, at: Array) -> Array:
        """Of each line and strand what `_signs` needs, (lines, strands, 5).

        Whether it is above, 1 or 0, after how many of its crossings; from where to where it goes,
        and whether upward, 1 or -1. The first is -1 where there is no strand, or no normal.
        """
        sides = self._sides
        shape = int(sides.line.max(initial=-1)) + 1, int(sides.strand.max(initial=-1)) + 1
        keys, place = np.unique(sides.line * shape[1] + sides.strand, return_inverse=True)
        low = np.minimum(sides.base, sides.base + sides.scale)
        high = low + np.abs(sides.scale)
        span = np.stack([np.full(len(keys), np.inf), np.full(len(keys), -np.inf)])
        np.minimum.at(span[0], place, low)
        np.maximum.at(span[1], place, high)
        key = np.concatenate([line * shape[1] + strand, keys, keys])
        at = np.concatenate([at, *span])
        order = np.lexsort([at, key])
        key, at = key[order], at[order]
        gap = np.append(np.where(key[1:] == key[:-1], at[1:] - at[:-1], -1.0), -1.0)
        best = np.lexsort([-gap, key])
        best = best[np.append(True, np.diff(key[best]) > 0)]
        middle = at[best] + gap[best] / 2
        after = best - np.flatnonzero(np.append(True, np.diff(key) > 0))  # (one of these is low)
        holds = (middle[place] >= low) & (middle[place] <= high)
        which = np.full(len(keys), -1)
        which[place[holds]] = np.flatnonzero(holds)
        x = (middle - sides.base[which]) / sides.scale[which]
        face = sides.face[which]
        above, fine = scalar.at_places(self._surface, face, self._along(face, sides.side[which], x))
        found = np.full((shape[0] * shape[1], 5), -1.0)
        way = np.sign(sides.scale[which])
        found[keys] = np.stack([np.where(fine, above, -1), after, *span, way], axis=1)
        return found.reshape(*shape, 5)

    @staticmethod
    def _signs(
        reference: Array, line: Array, strand: Array, middle: Array, odd: bool
    ) -> tuple[Array, Array, Array]:
        """Whether strands differ after each of what is in order on lines, up to the next.

        And which is the first of them, and whether it is above. `middle` is where they are looked
        at. What is `odd` has another sign where faces on both sides go round another way.
        """
        start = np.flatnonzero(np.append(True, np.diff(line) > 0)[: len(line)])
        each = np.diff(np.append(start, len(line)))
        first, above, differ = (np.full(len(line), x) for x in (-1, -1, 0))
        for k in range(reference.shape[1]):
            total = np.cumsum(strand == k)
            before = np.repeat(total[start] - (strand[start] == k), each)
            own, after, low, high, way = reference[line, k].T
            there = (own >= 0) & (low <= middle) & (middle <= high)
            sign = own.astype(np.int64) ^ ((total - before - after.astype(np.int64)) & 1)
            new = there & (first < 0)
            first[new], above[new] = k, sign[new]
            turned = odd & (way == reference[line, np.maximum(first, 0), 4]) & (first != k)
            differ |= there & ((sign ^ turned) != above)
        return differ > 0, first, above

    def _along_edges(
        self, line: Array, at: Array, node: Array, last: Array, first: Array, above: Array
    ) -> tuple[Spans, Array]:
        """Spans from some of what is in order on edges to the next."""
        sides = self._sides
        a, b = at[last], at[last + 1]
        # a side of the first strand, of which one or two make the edge
        low = np.minimum(sides.base, sides.base + sides.scale)
        size = int(sides.strand.max(initial=0)) + 1
        key = 4.0 * (sides.line * size + sides.strand) + low
        order = np.argsort(key)
        wanted = 4.0 * (line[last] * size + first[last]) + (a + b) / 2
        which = order[np.searchsorted(key[order], wanted, side="right") - 1]
        base, scale = sides.base[which], sides.scale[which]
        face, side = sides.face[which], sides.side[which]
        start, end = (self._along(face, side, np.clip((x - base) / scale, 0, 1)) for x in (a, b))
        sign = np.sign(scale) * np.where(above[last], 1, -1)
        rows, number = np.unique(which, return_inverse=True)
        none = np.zeros(len(which))
        found = Spans(node[last], node[last + 1], sign, number, start, end, none)
        return found, rows

    def _with_sides(self, leaves: Leaves, cells: Cells, rows: Array) -> Leaves:
        """Leaves, and limit faces that stand for their sides."""
        face, side = self._sides.face[rows], self._sides.side[rows]
        n, own = len(rows), leaves.cells
        bend = np.ldexp(self._bend(face, side), cells.power)
        frame = np.tile([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], (n, 1, 1))
        values, points = (np.zeros((n, *x.shape[1:])) for x in (own.values, own.points))
        more = Pieces(np.zeros(n, dtype=np.int64), face, frame, values, points)
        return Leaves(
            Pieces.joined([own, more]),
            np.append(leaves.kind, np.full(n, TOUCH)),
            np.append(leaves.bend, bend),
            np.concatenate([leaves.corners, np.zeros((n, leaves.corners.shape[1]))]),
            np.append(leaves.special, np.full(n, -1)),
        )

    def _bend(self, face: Array, side: Array) -> Array:
        """Of the curves along sides the second derivative, (n,): its largest at some places.

        It is linear between vertices where the curve is a spline of degree 3.
        """
        n = len(face)
        x = np.tile((np.arange(_SAMPLES) + 0.5) / _SAMPLES, n)
        x[::_SAMPLES], x[_SAMPLES - 1 :: _SAMPLES] = 2.0**-20, 1 - 2.0**-20
        face, side = np.repeat(face, _SAMPLES), np.repeat(side, _SAMPLES)
        jet = self._surface.jet(face, *self._along(face, side, x).T, order=2)
        ends = np.array(self._lattice.corners, dtype=float)
        du, dv = (ends[(side + 1) % len(ends)] - ends[side]).T[..., None]
        second = jet[2, 0] * du * du + 2 * jet[1, 1] * du * dv + jet[0, 2] * dv * dv
        size = np.nan_to_num(np.sqrt((second**2).sum(axis=1)), posinf=0)
        return np.asarray(size.reshape(n, _SAMPLES).max(axis=1, initial=0))


class _Wanted:
    """Which nodes are of the level set that is sought."""

    def __init__(self, surface: LimitSurface, network: Network, scalar: OfNormals) -> None:
        nodes = network.nodes
        used = np.zeros(len(nodes.face), dtype=bool)
        for ends in (network.spans.a, network.spans.b, network.crossings[3]):
            used[ends] = True
        here = np.flatnonzero(used)
        self._counts = np.zeros(len(used), dtype=bool)
        self._counts[here] = scalar.counts(surface, nodes.face[here], nodes.uv[here])

    def nodes(self, a: Array, b: Array) -> Array:
        """Whether one of both is."""
        return np.asarray(self._counts[a] | self._counts[b])


def _pair(nodes: Nodes) -> tuple[Array, Array]:
    return nodes.face, nodes.uv


def _parted(surface: LimitSurface, whole: Adjacency, sharp: Array) -> Adjacency:
    """What is joined across sides that are not sharp."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    mesh, size = surface.mesh, sharp.shape[1]
    n = len(whole.face)
    if surface.topology.rules.scheme.local:
        sizes, indices = np.full(n, size), np.arange(size * n)
        apart = Connectivity(size * n, sizes, indices)
        faces = np.arange(n), np.full(n, -1)
        return Adjacency(apart, *faces, apart.corner_edge, apart.edges)
    if not sharp.any():
        return whole
    # half-edges that are sharp: sides of whole faces, the first of others
    cut = np.zeros(mesh.n_corners, dtype=bool)
    first = mesh.offsets[whole.face]
    here = whole.corner < 0
    cut[first[here, None] + np.arange(size)] = sharp[here]
    cut[first[~here] + whole.corner[~here]] = sharp[~here, 0]
    half = np.flatnonzero((mesh.twin >= 0) & ~cut)
    twin, after = mesh.twin[half], mesh.next_corner
    pairs = np.concatenate([half, after[half]]), np.concatenate([after[twin], twin])
    graph = coo_array((np.ones(len(pairs[0])), pairs), shape=(mesh.n_corners,) * 2)
    count, label = connected_components(graph, directed=False)
    # in the order of the vertices, so that edges go the same way
    vertex = np.empty(count, dtype=np.int64)
    vertex[label] = mesh.indices
    rank = np.empty(count, dtype=np.int64)
    rank[np.argsort(vertex, kind="stable")] = np.arange(count)
    indices = rank[label]
    cage = Connectivity(count, mesh.sizes, indices)
    # (both sides of a crease between two darts have the same ends)
    edge, more = cage.corner_edge.copy(), np.flatnonzero(cut)
    edge[more] = len(cage.edges) + np.arange(len(more))
    both = np.sort(np.stack([indices[more], indices[after[more]]], axis=1), axis=1)
    ends = np.concatenate([cage.edges, both])
    return Adjacency(cage, whole.face, whole.corner, edge, ends)
