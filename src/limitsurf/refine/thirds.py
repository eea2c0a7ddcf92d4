"""Refinement by the scheme of Kobbelt: two steps cut every triangle into nine.

The first step makes a point in the middle of each face, joins it to the corners, and turns each
edge of two faces to join their middles; boundaries rest. The second does the same to what came of
it, and cuts boundary edges into three, instead of the faces on them into three: so the edges of the
mesh are all cut into thirds. Derived in ``derivations/sqrt3.py``.

After two steps there are the vertices, the middles of faces, then two points on each edge, in the
order of ``mesh.edges``: the one near its first end, and the one near its second. After one step
there are the first two of these.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from limitsurf import tables
from limitsurf.caching import cached_property
from limitsurf.cage import checks
from limitsurf.cage.connectivity import Connectivity, Fans
from limitsurf.cage.mesh import Mesh
from limitsurf.numbers import FLOAT64, NumberType
from limitsurf.options import Rules
from limitsurf.refine.operators import channel_groups, sparse_operator

Array = NDArray[Any]

# rows, columns and values of entries
Entries = tuple[Array, Array, Array]


@dataclass(frozen=True, eq=False)
class Thirds:
    """What two steps make of a mesh of triangles.

    Attributes
    ----------
    mesh : Connectivity
        That which is refined.
    twin : (n_corners,) int
    valence : (n_vertices,) int
        Numbers of faces at interior vertices.
    doubled : bool
        Whether edges join the same vertices, now or later.
    interior, smooth : (n_vertices,) bool
        Amid faces, and on a boundary that it follows; others stay where they are.
    """

    mesh: Connectivity
    twin: Array
    valence: Array
    doubled: bool
    interior: Array
    smooth: Array

    @classmethod
    def of(cls, mesh: Mesh, rules: Rules) -> Self:
        """Those of a mesh: vertices of several fans stay, and lone corners if they are to."""
        checks.distinct_corners(mesh.connectivity, rules.scheme.name)
        fans, n = mesh.fans, mesh.n_vertices
        alone = np.bincount(fans.vertex, minlength=n) == 1
        interior, smooth = np.zeros((2, n), dtype=bool)
        interior[fans.vertex[fans.closed]] = True
        follows = ~fans.closed
        if rules.boundary == "edge_and_corner":
            follows &= fans.sizes > 1
        smooth[fans.vertex[follows]] = True
        return cls.among(mesh.connectivity, interior & alone, smooth & alone)

    @classmethod
    def among(cls, mesh: Connectivity, interior: Array, smooth: Array) -> Self:
        """Those of faces where it is known which vertices are in the interior, and smooth."""
        fans = mesh.fans
        doubled = mesh.parallel or bool((fans.closed & (fans.sizes == 2)).any())
        return cls(mesh, mesh.twin, mesh.vertex_faces, doubled, interior, smooth)

    @property
    def fans(self) -> Fans:
        """What surrounds its vertices."""
        return self.mesh.fans

    @property
    def n_whole(self) -> int:
        """Number of points after both steps."""
        return self.n_half + 2 * self.mesh.n_edges

    @property
    def n_half(self) -> int:
        """Number of points after the first step."""
        return self.mesh.n_vertices + self.mesh.n_faces

    @cached_property
    def _corners(self) -> tuple[Array, Array, Array]:
        """Vertex of each corner, of the next and of the one before, (n_corners,)."""
        faces = self.mesh.indices.reshape(-1, 3)
        return faces.ravel(), np.roll(faces, -1, axis=1).ravel(), np.roll(faces, 1, axis=1).ravel()

    @cached_property
    def near(self) -> tuple[Array, Array]:
        """Points on the edge from each corner to the next, near that and near the next."""
        tail, head, _ = self._corners
        first = self.n_half + 2 * self.mesh.corner_edge
        return first + (tail > head), first + (tail < head)

    @cached_property
    def _compiled(self) -> tuple[Array, Array]:
        """`whole_faces` and `whole_twin`, by a kernel."""
        from limitsurf._kernels import step_points

        faces, twin = np.empty((2, 9 * len(self.twin)), dtype=np.int64)
        known = self.mesh.indices, self.twin, self.mesh.corner_edge, self.mesh.n_vertices
        step_points.third_faces(*known, faces, twin)
        return faces.reshape(-1, 3), twin

    @cached_property
    def whole_faces(self) -> Array:
        """Faces after both steps, (9 n_faces, 3), nine from each face.

        Three at its corners, three amid its edges, three between its middle and these.
        """
        if self.mesh.compiled:
            return self._compiled[0]
        corner, _, _ = self._corners
        tail, head = self.near
        back = self._before(head)
        middle = self.mesh.n_vertices + np.repeat(np.arange(self.mesh.n_faces), 3)
        faces = [(corner, tail, back), (tail, head, middle), (tail, middle, back)]
        return np.concatenate([np.stack(f, 1).reshape(-1, 3, 3) for f in faces], 1).reshape(-1, 3)

    @cached_property
    def half_faces(self) -> Array:
        """Faces after the first step, (n, 3), three from each face: from the corner of each on.

        That at an edge of two faces lies on both.
        """
        tail, head, _ = self._corners
        middle = self.mesh.n_vertices + np.arange(len(tail)) // 3
        inner = self.twin >= 0
        across = np.where(inner, middle[self.twin], head)
        return np.stack([tail, across, middle], axis=1)

    @cached_property
    def whole_twin(self) -> Array:
        """Half-edges that run along those of `whole_faces` in the other direction, -1 for none."""
        if self.mesh.compiled:
            return self._compiled[1]
        corner, inner = np.arange(len(self.twin)), self.twin >= 0
        face, k = np.divmod(corner, 3)
        after, last = 3 * face + (k + 1) % 3, 3 * face + (k + 2) % 3
        # of each corner: the first half-edges of the faces at it, at the next edge, inside
        at, amid, inside = (3 * (9 * face + 3 * kind + k) for kind in range(3))
        twin = np.empty(27 * len(self.twin) // 3, dtype=np.int64)
        twin[at] = np.where(inner, at[after[self.twin]] + 2, -1)
        twin[at + 2] = np.where(inner[last], at[self.twin[last]], -1)
        twin[amid] = np.where(inner, amid[self.twin], -1)
        twin[at + 1], twin[inside + 2] = inside + 2, at + 1
        twin[inside], twin[amid + 2] = amid + 2, inside
        twin[inside + 1], twin[amid + 1] = amid[last] + 1, inside[after] + 1
        return twin

    @cached_property
    def half_twin(self) -> Array:
        """The same of `half_faces`."""
        corner, inner = np.arange(len(self.twin)), self.twin >= 0
        face, k = np.divmod(corner, 3)
        after, last = 3 * face + (k + 1) % 3, 3 * face + (k + 2) % 3
        twin = np.empty(3 * len(corner), dtype=np.int64)
        twin[::3] = np.where(inner, 3 * after[self.twin] + 2, -1)
        twin[1::3] = np.where(inner, 3 * self.twin + 1, 3 * after + 2)
        twin[2::3] = np.where(inner[last], 3 * self.twin[last], 3 * last + 1)
        return twin

    @cached_property
    def half(self) -> Connectivity:
        """The mesh after the first step."""
        return self._connected(self.n_half, self.half_faces, self.half_twin)

    @cached_property
    def whole(self) -> Connectivity:
        """The mesh after both steps."""
        return self._connected(self.n_whole, self.whole_faces, self.whole_twin)

    def _connected(self, n: int, faces: Array, twin: Array) -> Connectivity:
        """A refined mesh; amid two faces two edges join the same vertices, which twins tell."""
        sizes = np.full(len(faces), 3)
        if self.doubled:
            ends = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
            table = edge_table(ends, twin)
            known: dict[str, Any] = {"twin": twin, "edge_table": table, "parallel": True}
            return Connectivity(n, sizes, faces.ravel(), repeats=False, **known)
        return Connectivity(n, sizes, faces.ravel(), twin=twin, repeats=False)

    def _before(self, values: Array) -> Array:
        """Values of the corners before, (n_corners,)."""
        return np.roll(values.reshape(-1, 3), 1, axis=1).ravel()

    @cached_property
    def rim(self) -> tuple[Array, Array, Array]:
        """Smooth boundary vertices, and both neighbours of each along the boundary."""
        tail, head, _ = self._corners
        one, other = np.full((2, self.mesh.n_vertices), -1)
        sides = np.flatnonzero(self.twin < 0)
        one[tail[sides]], other[head[sides]] = head[sides], tail[sides]
        at = np.flatnonzero(self.smooth)
        return at, one[at], other[at]

    # ---------------------------------------------------------------- masks

    def first(self, rules: Rules, number: NumberType) -> Any:
        """The points after the first step as rows over the vertices."""
        V, F = self.mesh.n_vertices, self.mesh.n_faces
        tail, head, _ = self._corners
        inner = np.flatnonzero(self.interior)
        stay = np.flatnonzero(~self.interior)
        own, each = _masks(rules, self.valence, inner, number)
        spoke = np.flatnonzero(self.interior[tail])
        share = number.full(V, number.zero)
        share[inner] = each
        third = number.full(3 * F, number.one) / 3
        parts = [
            (inner, inner, own),
            (stay, stay, number.full(len(stay), number.one)),
            (tail[spoke], head[spoke], share[tail[spoke]]),
            (V + np.arange(3 * F) // 3, tail, third),
        ]
        return _operator(parts, (V + F, V))

    def second(self, rules: Rules, number: NumberType) -> Any:
        """The points after both steps as rows over those after the first."""
        V, F = self.mesh.n_vertices, self.mesh.n_faces
        parts = [
            *self._old(rules, number),
            *self._middles(rules, number),
            *self._edges(rules, number),
        ]
        return _operator(parts, (self.n_whole, V + F))

    def _old(self, rules: Rules, number: NumberType) -> list[Entries]:
        """Entries of vertices: of interior ones neighbours are the middles around them."""
        V, (tail, _, _) = self.mesh.n_vertices, self._corners
        inner = np.flatnonzero(self.interior)
        own, each = _masks(rules, self.valence, inner, number)
        share = number.full(V, number.zero)
        share[inner] = each
        spoke = np.flatnonzero(self.interior[tail])
        stay = np.flatnonzero(~self.interior & ~self.smooth)
        return [
            (inner, inner, own),
            (tail[spoke], V + spoke // 3, share[tail[spoke]]),
            (stay, stay, number.full(len(stay), number.one)),
        ]

    def _middles(self, rules: Rules, number: NumberType) -> list[Entries]:
        """Entries of middles of faces: neighbours are the corners, and middles across edges."""
        V, F = self.mesh.n_vertices, self.mesh.n_faces
        tail, _, _ = self._corners
        inner = self.twin >= 0
        valence = 3 + inner.reshape(-1, 3).sum(axis=1)
        every = np.arange(F)
        own, each = _masks(rules, valence, every, number)
        face = np.arange(3 * F) // 3
        side = np.flatnonzero(inner)
        return [
            (V + every, V + every, own),
            (V + face, tail, each[face]),
            (V + face[side], V + self.twin[side] // 3, each[face[side]]),
        ]

    def _edges(self, rules: Rules, number: NumberType) -> list[Entries]:
        """Entries of points on edges: inside the middles of small faces, else on the curve."""
        V = self.mesh.n_vertices
        tail, _, _ = self._corners
        near, _ = self.near
        side = np.flatnonzero(self.twin >= 0)
        third = number.full(len(side), number.one) / 3
        parts = [(near[side], x, third) for x in (tail[side], V + side // 3)]
        parts.append((near[side], V + self.twin[side] // 3, third))
        for rows, columns, weights in self._curves(rules, number):
            parts += [
                (rows, x, number.full(len(rows), w)) for x, w in zip(columns, weights, strict=True)
            ]
        return parts

    def _curves(
        self, rules: Rules, number: NumberType
    ) -> Iterator[tuple[Array, tuple[Array, ...], tuple[Any, ...]]]:
        """Points on boundaries: rows, and columns and weights of their entries."""
        (vertex, beside), (own_weight, along, beyond) = tables.curve_weights(rules.scheme, number)
        at, one, two = self.rim
        yield at, (at, one, two), (vertex, beside, beside)
        # of an edge of three faces and more all say the same
        rim = np.flatnonzero(self.twin < 0)
        rim = rim[np.unique(self.mesh.corner_edge[rim], return_index=True)[1]]
        other = np.full((2, self.mesh.n_vertices), -1)
        other[0, at], other[1, at] = one, two
        tail, head, _ = self._corners
        points = self.n_half + 2 * self.mesh.corner_edge[rim]
        tail, head = tail[rim], head[rim]
        near, far = points + (tail > head), points + (tail < head)
        for point, own, towards, k in ((near, tail, head, 1), (far, head, tail, 0)):
            smooth = self.smooth[own]
            here, there = own[smooth], towards[smooth]
            yield point[smooth], (here, there, other[k, here]), (own_weight, along, beyond)
            # the neighbour beyond a corner is the mirror image of the one before
            columns = own[~smooth], towards[~smooth]
            yield point[~smooth], columns, (own_weight + 2 * beyond, along - beyond)

    # ---------------------------------------------------------------- float64 points, by kernels

    def first_points(self, rules: Rules, points: Array) -> Array:
        """The points (n_half, d) after the first step."""
        from limitsurf._kernels import step_points

        result = np.empty((self.n_half, points.shape[1]))
        shares = self._shares(rules)
        for first, channels in channel_groups(points.shape[1]):
            step_points.centred(points, self.mesh.indices, shares, first, channels, result)
        return result

    def second_points(self, rules: Rules, points: Array) -> Array:
        """The points (n_whole, d) after both steps, from those after the first."""
        from limitsurf._kernels import step_points

        result = np.empty((self.n_whole, points.shape[1]))
        counts = np.arange(3, 7)
        middles = tables.shares(rules.scheme, counts, FLOAT64) / counts
        known = self.mesh.indices, self.twin, self.mesh.corner_edge, self._shares(rules), middles
        for first, channels in channel_groups(points.shape[1]):
            step_points.cut_into_thirds(points, *known, first, channels, result)
        for rows, columns, weights in self._curves(rules, FLOAT64):
            parts = zip(columns, weights, strict=True)
            result[rows] = sum(points[x] * w for x, w in parts)
        return result

    def _shares(self, rules: Rules) -> Array:
        """What each neighbour has in a new vertex, 0 where it stays."""
        kinds, kind = np.unique(np.where(self.interior, self.valence, 0), return_inverse=True)
        share = np.zeros(len(kinds))
        some = kinds > 0
        share[some] = tables.shares(rules.scheme, kinds[some], FLOAT64) / kinds[some]
        return np.asarray(share[kind])

    @cached_property
    def child(self) -> Thirds:
        """The same of the mesh after both steps."""
        mesh, finer = self.mesh, self.whole
        middles, sides = np.ones(mesh.n_faces, dtype=bool), np.zeros((2, mesh.n_edges), dtype=bool)
        sides[0, mesh.corner_edge[self.twin >= 0]] = True
        sides[1] = mesh.boundary_edge
        interior = np.concatenate([self.interior, middles, np.repeat(sides[0], 2)])
        smooth = np.concatenate([self.smooth, ~middles, np.repeat(sides[1], 2)])
        valence = np.concatenate([self.valence, np.full(len(interior) - len(self.valence), 6)])
        return Thirds(finer, finer.twin, valence, self.doubled, interior, smooth)


def edge_table(ends: tuple[Array, Array], twin: Array) -> tuple[Array, Array, Array]:
    """Edges, their numbers by half-edge, and their half-edges, where twins tell which are one.

    Half-edges without a twin share an edge with all others like them between the same vertices.
    """
    corner = np.arange(len(twin))
    own = np.where(twin < 0, -1, np.minimum(corner, twin))
    rows = np.stack([np.minimum(*ends), np.maximum(*ends), own], axis=1)
    edges, first, number = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return edges[:, :2], number.reshape(-1), np.stack([first, twin[first]], axis=1)


def _operator(parts: list[Entries], shape: tuple[int, int]) -> Any:
    rows, columns, values = (np.concatenate(x) for x in zip(*parts, strict=True))
    return sparse_operator(rows, columns, values, shape)


def _masks(rules: Rules, faces: Array, which: Array, number: NumberType) -> tuple[Array, Array]:
    """Weights of some vertices amid so many faces, and of each neighbour; in their new points."""
    valences = faces[which]
    share = tables.shares(rules.scheme, valences, number)
    return number.one - share, share / number.array(valences)
