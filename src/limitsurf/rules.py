"""Which subdivision rule applies where: options, and the sharpness of edges and vertices."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from limitsurf import tables
from limitsurf._kernels import reference as kernels
from limitsurf.caching import cached_property
from limitsurf.mesh import Fans, Mesh
from limitsurf.topology import MeshPart

if TYPE_CHECKING:
    from limitsurf.exact.scheme import Scheme

Array = NDArray[Any]

# rules of vertices, see exact/creases.py
SMOOTH, DART, CREASE, CORNER = range(4)
# a fan of no kind, see Sectors
PENDING = -1


@dataclass(frozen=True)
class Rules:
    """Which scheme applies to a mesh, and how at boundaries, creases and triangles."""

    scheme: Scheme
    boundary: str
    creasing: str
    triangles: str

    @classmethod
    def resolve(
        cls,
        mesh: Mesh,
        scheme: str | Scheme | None = None,
        boundary: str | None = None,
        creasing: str | None = None,
        triangles: str | None = None,
    ) -> Rules:
        """Options from the arguments, else from the mesh, else the defaults; all are checked."""
        given = {"boundary": boundary, "creasing": creasing, "triangles": triangles}
        allowed = {
            "boundary": ("edge_and_corner", "edge_only", "none"),
            "creasing": ("uniform", "chaikin"),
            "triangles": ("catmull-clark", "smooth"),
        }
        chosen = {}
        for option, values in allowed.items():
            value = next(
                x for x in (given[option], getattr(mesh, option), values[0]) if x is not None
            )
            if value not in values:
                raise ValueError(f"{option} must be one of {', '.join(values)}, got {value!r}")
            chosen[option] = value
        named = scheme if scheme is not None else mesh.scheme
        rules = cls(tables.find_scheme("catmull-clark" if named is None else named), **chosen)
        if rules.triangles == "smooth" and rules.scheme.smooth_triangle is None:
            raise ValueError(f'scheme {rules.scheme.name!r} has no triangle rule "smooth"')
        return rules

    def loose_vertices(self, mesh: Mesh) -> Array:
        """Vertices that have no limit: on untagged boundaries under "none", (n_vertices,) bool."""
        result = np.zeros(mesh.n_vertices, dtype=bool)
        if self.boundary == "none":
            loose = mesh.boundary_edge.copy()
            edges, sharpness = mesh.creases
            loose[mesh.edge_numbers(edges[tables.is_infinite(sharpness)])] = False
            result[mesh.edges[loose]] = True
        return result

    def without_limit(self, mesh: Mesh) -> Array:
        """Faces that are holes, tagged or by boundary "none", (n_faces,) bool."""
        result = np.zeros(mesh.n_faces, dtype=bool)
        result[mesh.holes] = True
        if self.boundary == "none":
            result[mesh.corner_face[self.loose_vertices(mesh)[mesh.indices]]] = True
        return result


@dataclass(frozen=True, eq=False)
class Sharpness:
    """Sharpness at one level of refinement, and what follows from it.

    It lists what is sharp: S edges, by the n half-edges at all their sides, and M vertices. Those
    that are tagged with 0 may be among them. All others have sharpness 0.

    Attributes
    ----------
    mesh : Mesh
    sides : (n,) int
        Half-edges.
    edge : (n,) int
        Which of the S edges each is a side of.
    edge_sharpness : (S,)
        Float64 or exact.
    edge_tagged : (S,) bool
        Where the sharpness comes from tags.
    vertex : (M,) int
        Ascending.
    vertex_sharpness, vertex_tagged : (M,)
    chaikin : bool
    """

    mesh: Mesh
    sides: Array
    edge: Array
    edge_sharpness: Array
    edge_tagged: Array
    vertex: Array
    vertex_sharpness: Array
    vertex_tagged: Array
    chaikin: bool

    @classmethod
    def of(cls, mesh: Mesh, rules: Rules, dtype: Any) -> Sharpness:
        """The sharpness of a cage; a refined mesh carries its own."""
        known = getattr(mesh, "_sharpness", None)
        if isinstance(known, Sharpness) and mesh._rules == rules:  # type: ignore[attr-defined]
            return known.typed(mesh, dtype)
        # rules change where a sharpness reaches 0: rounding must not decide it
        (ends, creases), (vertices, corners) = mesh.creases, mesh.corners
        averaged = rules.creasing == "chaikin" and len(creases) > 0
        if averaged or object in [creases.dtype, corners.dtype]:
            dtype = np.dtype(object)
        marked = mesh.twin < 0
        numbers = mesh.edge_numbers(ends) if len(ends) else np.zeros(0, np.int64)
        if len(ends):
            tagged = np.zeros(mesh.n_edges, dtype=bool)
            tagged[numbers] = True
            marked |= tagged[mesh.corner_edge]
        sides = np.flatnonzero(marked)
        if len(ends) or (len(sides) and mesh.separate[sides].any()):
            key = mesh.corner_edge[sides]
        else:
            pairs = mesh.indices[np.stack([sides, mesh._after(sides)])]
            key = pairs.min(axis=0) * mesh.n_vertices + pairs.max(axis=0)
        unique, edge = np.unique(key, return_inverse=True)
        is_open = np.zeros(len(unique), dtype=bool)
        is_open[edge[mesh.twin[sides] < 0]] = True
        place = np.searchsorted(unique, numbers)
        edge_sharpness = _typed(np.zeros(len(unique)), dtype)
        edge_sharpness[place] = _typed(creases, dtype)
        edge_sharpness[is_open] = np.inf
        # on a boundary only an infinite tag means anything, see Rules.loose_vertices
        edge_tagged = np.zeros(len(unique), dtype=bool)
        edge_tagged[place] = ~is_open[place] | tables.is_infinite(creases)
        pinned = np.flatnonzero(_pinned(mesh, rules))
        vertex = np.union1d(vertices, pinned)
        place = np.searchsorted(vertex, vertices)
        vertex_sharpness = _typed(np.zeros(len(vertex)), dtype)
        vertex_sharpness[place] = _typed(corners, dtype)
        vertex_sharpness[np.searchsorted(vertex, pinned)] = np.inf
        vertex_tagged = np.zeros(len(vertex), dtype=bool)
        vertex_tagged[place] = True
        chaikin = rules.creasing == "chaikin"
        edges = sides, edge, edge_sharpness, edge_tagged
        return cls(mesh, *edges, vertex, vertex_sharpness, vertex_tagged, chaikin)

    def typed(self, mesh: Mesh, dtype: Any) -> Self:
        """The same on a copy of the mesh, at least as exact as another number type."""
        if self.edge_sharpness.dtype == object:
            return replace(self, mesh=mesh)
        edges, vertices = (_typed(x, dtype) for x in (self.edge_sharpness, self.vertex_sharpness))
        return replace(self, mesh=mesh, edge_sharpness=edges, vertex_sharpness=vertices)

    def __getstate__(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @cached_property
    def half_edges(self) -> Array:
        """Sharpness by half-edge: shape (n_corners,)."""
        result = _typed(np.zeros(self.mesh.n_corners), self.edge_sharpness.dtype)
        result[self.sides] = self.edge_sharpness[self.edge]
        return result

    @cached_property
    def edges(self) -> Array:
        """Sharpness by edge: shape (n_edges,)."""
        result = _typed(np.zeros(self.mesh.n_edges), self.edge_sharpness.dtype)
        result[self.mesh.corner_edge[self.sides]] = self.edge_sharpness[self.edge]
        return result

    @cached_property
    def vertices(self) -> Array:
        """Sharpness by vertex: shape (n_vertices,)."""
        result = _typed(np.zeros(self.mesh.n_vertices), self.vertex_sharpness.dtype)
        result[self.vertex] = self.vertex_sharpness
        return result

    @cached_property
    def first(self) -> Array:
        """The lowest side of each edge, (S,)."""
        result = np.full(len(self.edge_sharpness), self.mesh.n_corners)
        np.minimum.at(result, self.edge, self.sides)
        return result

    @cached_property
    def _ends(self) -> tuple[Array, Array, Array, Array]:
        """Edges of positive sharpness, twice, (2 S,): their tails by `first`, then their heads.

        Which of the edges, the place of the vertex in `concerned`, their sharpness, and that of
        their halves there.
        """
        sharp = np.flatnonzero(self.edge_sharpness > 0)
        place = self._places[1]
        edge, place = np.tile(sharp, 2), place[len(place) - 2 * len(sharp) :]
        sharpness = self.edge_sharpness[edge]
        return edge, place, sharpness, self._halves(edge, place, sharpness)

    @cached_property
    def _pairs(self) -> Array:
        """Tails and heads of the edges of positive sharpness, (2, S)."""
        first = self.first[self.edge_sharpness > 0]
        return np.stack([self.mesh.indices[h] for h in (first, self.mesh._after(first))])

    @property
    def concerned(self) -> Array:
        """Vertices that are sharp or at the end of a sharp edge, ascending: shape (K,)."""
        return self._places[0]

    @cached_property
    def _places(self) -> tuple[Array, Array]:
        """`concerned`, and the places in there of the sharp vertices, then of `sharp_ends`."""
        sharp = self.vertex[self.vertex_sharpness > 0]
        return _numbered(np.concatenate([sharp, self._pairs.ravel()]), self.mesh.n_vertices)

    @cached_property
    def _own(self) -> Array:
        """Sharpness of the vertices that are concerned: shape (K,)."""
        result = _typed(np.zeros(len(self.concerned)), self.vertex_sharpness.dtype)
        sharp = self.vertex_sharpness[self.vertex_sharpness > 0]
        result[self._places[1][: len(sharp)]] = sharp
        return result

    def _halves(self, edge: Array, place: Array, sharpness: Array) -> Array:
        """Sharpness of the halves of sharp edges at their ends, all (2 S,) as in `_ends`."""
        after = sharpness
        if self.chaikin:
            share = tables.chaikin_weights(sharpness.dtype)[1]
            soft = ~tables.is_infinite(sharpness)
            total = self._sum(place[soft], sharpness[soft])
            others = np.bincount(place[soft], minlength=len(total))[place] - 1
            averaged = np.flatnonzero(soft & (others > 0))
            rest = total[place[averaged]] - sharpness[averaged]
            after = sharpness.copy()
            # exactly what it was where all are equal
            after[averaged] += share * (rest / others[averaged] - sharpness[averaged])
        return np.asarray(np.maximum(after - 1, 0))

    @cached_property
    def _by_side(self) -> tuple[Array, Array]:
        """Sharpness of the halves of each side's edge, at its tail and at its head: (n,) each."""
        edge, _, _, after = self._ends
        halves = _typed(np.zeros((2, len(self.edge_sharpness))), after.dtype)
        halves[:, edge[: len(edge) // 2]] = after.reshape(2, -1)
        other = (self.mesh.indices[self.sides] != self.mesh.indices[self.first[self.edge]]) * 1
        return halves[other, self.edge], halves[1 - other, self.edge]

    @cached_property
    def halves(self) -> Array:
        """Sharpness of the halves of every half-edge, at its tail and its head: (2, n_corners)."""
        result = _typed(np.zeros((2, self.mesh.n_corners)), self.edge_sharpness.dtype)
        result[:, self.sides] = self._by_side
        return result

    def _sum(self, place: Array, values: Array) -> Array:
        """Values summed by place in `concerned`, (K,)."""
        total = _typed(np.zeros(len(self.concerned)), values.dtype)
        np.add.at(total, place, values)
        return total

    @cached_property
    def rule(self) -> Array:
        """Rule of each vertex: shape (n_vertices,)."""
        result = np.full(self.mesh.n_vertices, SMOOTH)
        result[self.concerned] = self.transitions[0]
        return result

    def _rule(self, own: Array, sharp: Array) -> Array:
        counts = np.bincount(self._ends[1][sharp], minlength=len(own))
        return np.where(own > 0, CORNER, np.minimum(counts, CORNER))

    @cached_property
    def transitions(self) -> tuple[Array, Array, Array]:
        """Rule of the `concerned` vertices and their children, and the share of the first: (K,)."""
        _, place, sharpness, after = self._ends
        later = np.maximum(self._own - 1, 0)
        parent, child = self._rule(self._own, sharpness > 0), self._rule(later, after > 0)
        # the mean of what falls to zero
        fallen = after == 0
        total = self._sum(place[fallen], sharpness[fallen])
        count = np.bincount(place[fallen], minlength=len(total))
        own = (self._own > 0) & (later == 0)
        total[own] += self._own[own]
        count[own] += 1
        one = tables.one(sharpness.dtype)[0]
        share = np.minimum(total / np.maximum(count, 1), one)
        # smooth and darts never change
        share = np.where((parent == child) | (parent <= DART), one, share)
        return parent, child, share

    @cached_property
    def vertex_masks(self) -> tuple[Array, Array, Array]:
        """Shares of the three masks in the points of `concerned` vertices.

        The shares of the smooth and the corner mask, both (K,), and, as an array (2 S,) for the
        `sharp_ends`, those of the crease mask that runs along the edge.
        """
        _, place, sharpness, after = self._ends
        parent, child, share = self.transitions
        one = tables.one(sharpness.dtype)[0]
        rest = one - share
        smooth = np.where(parent <= DART, one, np.where(child <= DART, rest, 0 * one))
        corner = np.where(parent == CORNER, share, 0 * one)
        corner = corner + np.where((child == CORNER) & (parent != CORNER), rest, 0 * one)
        along = np.where(parent[place] == CREASE, share[place], 0 * one)
        stays = (after > 0) & (child[place] == CREASE) & (parent[place] == CORNER)
        along = along + np.where(stays, rest[place], 0 * one)
        return smooth, corner, along

    @cached_property
    def codes(self) -> tuple[Array, Array]:
        """Numbers for finite sharpness from 1 on; -1 is infinite, and 0 none.

        Of half-edges, (n_corners,); and of the creases through vertices, (n_vertices,): those that
        come in and go on with the same sharpness.
        """
        _, found = np.unique(self.edge_sharpness, return_inverse=True)
        code = np.where(tables.is_infinite(self.edge_sharpness), -1, found + 1)
        code[self.edge_sharpness == 0] = 0
        by_corner = np.zeros(self.mesh.n_corners, dtype=np.int64)
        by_corner[self.sides] = code[self.edge]
        edge, place, *_ = self._ends
        crease = np.zeros(len(self.concerned), dtype=np.int64)
        ends = code[edge]
        crease[place] = ends  # one of the two
        crease[self.transitions[0] != CREASE] = 0
        crease[place[ends != crease[place]]] = 0
        by_vertex = np.zeros(self.mesh.n_vertices, dtype=np.int64)
        by_vertex[self.concerned] = crease
        return by_corner, by_vertex

    @cached_property
    def edge_masks(self) -> Array:
        """Share of the midpoint in the point of each of `sharp_edges`, the rest being smooth."""
        _, _, sharpness, after = self._ends
        half = len(sharpness) // 2
        one = tables.one(sharpness.dtype)[0]
        both = (after[:half] > 0) & (after[half:] > 0)
        return np.asarray(np.where(both, one, np.minimum(sharpness[:half], one)))

    @cached_property
    def unsettled(self) -> Array:
        """Vertices that are semi-sharp or at the end of a semi-sharp edge, (n_vertices,) bool."""
        _, place, sharpness, _ = self._ends
        soft = (self._own > 0) & ~tables.is_infinite(self._own)
        soft[place[~tables.is_infinite(sharpness)]] = True
        result = np.zeros(self.mesh.n_vertices, dtype=bool)
        result[self.concerned[soft]] = True
        return result

    def beside(self, vertices: Array) -> Array:
        """The two neighbours along the crease of vertices at two infinitely sharp edges, (n, 2)."""
        infinite = np.tile(tables.is_infinite(self.edge_sharpness[self.edge_sharpness > 0]), 2)
        here, there = (ends[infinite] for ends in self.sharp_ends)
        order = np.argsort(here, kind="stable")
        first = np.searchsorted(here[order], vertices)
        return np.asarray(there[order[first[:, None] + [0, 1]]])

    @property
    def sharp_vertices(self) -> Array:
        """Vertices that are sharp or at the end of a sharp edge, (n_vertices,) bool."""
        result = np.zeros(self.mesh.n_vertices, dtype=bool)
        result[self.concerned] = True
        return result

    @property
    def sharp_edges(self) -> Array:
        """A side of each edge of positive sharpness: shape (S,)."""
        return np.asarray(self.first[self.edge_sharpness > 0])

    @property
    def sharp_ends(self) -> tuple[Array, Array]:
        """The vertices at the ends of `sharp_edges` and those at the other end.

        Tails, then heads, (2 S,).
        """
        return self._pairs.ravel(), self._pairs[::-1].ravel()

    def children(self, mesh: Mesh) -> Self:
        """The sharpness of the refined mesh."""
        coarse = self.mesh
        at_tail, at_head = self._by_side
        tail, head = coarse.indices[self.sides], coarse.indices[self.first[self.edge]]
        # child h goes from corner to midpoint, to face point, to midpoint before, to corner
        sides = np.concatenate([4 * self.sides, 4 * coarse._after(self.sides) + 3])
        edge = np.concatenate([2 * self.edge + (tail != head), 2 * self.edge + (tail == head)])
        sharpness = np.concatenate([at_tail, at_head])
        kept = np.flatnonzero(sharpness > 0)
        halves, edge = _numbered(edge[kept], 2 * len(self.edge_sharpness))
        half_sharpness = np.empty(len(halves), dtype=sharpness.dtype)
        half_sharpness[edge] = sharpness[kept]
        later = np.maximum(self.vertex_sharpness - 1, 0)
        stay = np.flatnonzero(later > 0)
        return replace(
            self,
            mesh=mesh,
            sides=sides[kept],
            edge=edge,
            edge_sharpness=half_sharpness,
            edge_tagged=self.edge_tagged[halves // 2],
            vertex=self.vertex[stay],
            vertex_sharpness=later[stay],
            vertex_tagged=self.vertex_tagged[stay],
        )

    def neighbours(self, corners: Array) -> Array:
        """All corners whose sharpness matters for points at some, (n_corners,) bool.

        Those at the same vertices; and, under "chaikin", at the vertices of all their faces, since
        both halves of an edge decide its point.
        """
        mesh = self.mesh
        for step in range(1 + self.chaikin):
            if step:
                corners = np.logical_or.reduceat(corners, mesh.offsets[:-1])[mesh.corner_face]
            touched = np.zeros(mesh.n_vertices, dtype=bool)
            touched[mesh.indices[corners]] = True
            corners = touched[mesh.indices]
        return corners

    def part(self, part: MeshPart) -> Self:
        """The sharpness of a part of the mesh."""
        inside, sides = _found(part.corners, self.sides)
        edges, edge = _numbered(self.edge[inside], len(self.edge_sharpness))
        here, vertex = _found(part.vertices, self.vertex)
        return replace(
            self,
            mesh=part.mesh,
            sides=sides,
            edge=edge,
            edge_sharpness=self.edge_sharpness[edges],
            edge_tagged=self.edge_tagged[edges],
            vertex=vertex,
            vertex_sharpness=self.vertex_sharpness[here],
            vertex_tagged=self.vertex_tagged[here],
        )

    def tags(self) -> dict[str, tuple[Array, Array]]:
        """What comes from tags, as ``creases`` and ``corners`` of a mesh."""
        tagged = np.flatnonzero(self.edge_tagged)
        h = self.first[tagged]
        pairs = self.mesh.indices[np.stack([h, self.mesh._after(h)])]
        key = pairs.min(axis=0) * self.mesh.n_vertices + pairs.max(axis=0)
        key, place = np.unique(key, return_index=True)
        edges = np.stack(np.divmod(key, self.mesh.n_vertices), axis=1)
        vertices = self.vertex_tagged
        return {
            "creases": (edges, self.edge_sharpness[tagged[place]]),
            "corners": (self.vertex[vertices], self.vertex_sharpness[vertices]),
        }


def _numbered(values: Array, most: int) -> tuple[Array, Array]:
    """The distinct ones of integers below `most`, ascending, and the place of each among them."""
    present = np.zeros(most, dtype=bool)
    present[values] = True
    distinct = np.flatnonzero(present)
    place = np.empty(most, dtype=np.int64)  # by and large untouched
    place[distinct] = np.arange(len(distinct))
    return distinct, place[values]


def _found(members: Array, wanted: Array) -> tuple[Array, Array]:
    """Which of `wanted` are among the ascending `members`, and where in them."""
    place = np.searchsorted(members, wanted)
    inside = np.flatnonzero(np.append(members, -1)[place] == wanted)
    return inside, place[inside]


# by rule of the vertex, where its fan is not closed
_KINDS = np.array([tables.KINDS.index(name) for name in ("interior", "dart", "crease", "corner")])

# the number of faces of regular fans by kind, 0 for kinds that never are
_REGULAR = np.array([{"interior": 4, "crease": 2, "corner": 1}.get(k, 0) for k in tables.KINDS])


@dataclass(frozen=True, eq=False)
class Sectors:
    """What the faces at each vertex form between infinitely sharp edges.

    Attributes
    ----------
    mesh : Mesh
    twin : (n_corners,) int
        The half-edge across, -1 also where an edge is infinitely sharp.
    fans : Fans
        The sectors, each a fan of faces.
    kind : (n_fans,) int
        Index into `tables.KINDS`; `PENDING` while something semi-sharp is at the vertex.
    sharpness : Sharpness
    """

    mesh: Mesh
    twin: Array
    fans: Fans
    kind: Array
    sharpness: Sharpness

    @classmethod
    def of(cls, sharpness: Sharpness) -> Sectors:
        """Part the faces at each vertex."""
        mesh = sharpness.mesh
        infinite = tables.is_infinite(sharpness.edge_sharpness)
        twin = mesh.twin
        cut = sharpness.sides[infinite[sharpness.edge]]
        cut = cut[twin[cut] >= 0]
        if len(cut):
            twin = twin.copy()
            twin[cut] = -1
        fans = Fans.of(mesh, twin) if len(cut) else mesh.fans
        rule = sharpness.rule[fans.vertex]
        kind = _KINDS[rule]
        kind[(rule == CORNER) & fans.closed] = tables.KINDS.index("cone")
        # at a crease of non-manifold edges not all fans lie between its two edges
        crease = np.flatnonzero(rule == CREASE)
        if len(crease):
            kind[crease[fans.closed[crease]]] = tables.KINDS.index("pendant")
            crease = crease[~fans.closed[crease]]
            first, last = (
                fans.corners[fans.offsets[crease]],
                fans.corners[fans.offsets[crease + 1] - 1],
            )
            loop = mesh.corner_edge[first] == mesh.corner_edge[mesh.previous_corner[last]]
            kind[crease[loop]] = tables.KINDS.index("flap")
        kind[sharpness.unsettled[fans.vertex]] = PENDING
        return cls(mesh, twin, fans, kind, sharpness)

    @cached_property
    def regular(self) -> Array:
        """Fans around which the surface is a bicubic spline, reflected at sharp edges: (n_fans,).

        Four smooth faces, two along a crease, or one in a corner.
        """
        return np.asarray((self.kind >= 0) & (self.fans.sizes == _REGULAR[self.kind]))

    def groups(self, fans: Array) -> Iterator[tuple[str, int, Array]]:
        """The given fans by kind and number of faces: kind, number, fans."""
        if len(fans) == 0:
            return
        key = np.stack([self.kind[fans], self.fans.sizes[fans]])
        unique, which = np.unique(key, axis=1, return_inverse=True)
        order = np.argsort(which, kind="stable")
        parts = np.split(fans[order], np.cumsum(np.bincount(which.ravel()))[:-1])
        for (kind, faces), members in zip(unique.T.tolist(), parts, strict=True):
            yield tables.KINDS[kind], faces, members

    def ring(self, kind: str, faces: int, fans: Array, start: Array | int = 0) -> Array:
        """Vertices of fans of one kind and size, (n, R), ordered as in ``exact/matrices.py``.

        Those of closed fans begin at the face `start`. In the place of the point halfway between
        its neighbours on the crease that carries a vertex stand both of these, last.
        """
        mesh = self.mesh
        turns = (np.asarray(start)[..., None] + np.arange(faces)) % faces
        h = self.fans.corners[self.fans.offsets[fans][:, None] + turns]
        after = mesh.next_corner[h]
        pairs = np.stack([mesh.indices[after], mesh.indices[mesh.next_corner[after]]], axis=-1)
        parts = [self.fans.vertex[fans][:, None], pairs.reshape(len(fans), 2 * faces)]
        sector = tables.Sector(kind, faces)
        if sector.open:
            parts.append(mesh.indices[mesh.previous_corner[h[:, -1:]]])
        if sector.carried:
            parts.append(self.sharpness.beside(self.fans.vertex[fans]))
        return np.concatenate(parts, axis=1)


def _typed(sharpness: Array, dtype: Any) -> Array:
    """A copy as float64, or as Fractions; from INFINITE on infinite, which is a float always."""
    if dtype == object:
        infinite = tables.is_infinite(sharpness)
        result = kernels.exact(np.where(infinite, 0, sharpness))
    else:
        result = sharpness.astype(float)
        infinite = tables.is_infinite(result)
    result[infinite] = np.inf
    return np.asarray(result)


def _pinned(mesh: Mesh, rules: Rules) -> Array:
    """Vertices of a cage that are infinitely sharp without a tag, (n_vertices,) bool."""
    faces = mesh.vertex_faces
    odd = mesh.nonmanifold_vertex
    pinned = np.zeros(mesh.n_vertices, dtype=bool)
    if odd.any():
        edges = np.bincount(mesh.edges.ravel(), minlength=mesh.n_vertices)
        crossings = np.bincount(
            mesh.edges[mesh.nonmanifold_edge].ravel(), minlength=mesh.n_vertices
        )
        fin = (crossings == 2) & ~mesh.boundary_vertex & (faces > edges)
        pinned = odd & ~fin
    if rules.boundary == "edge_and_corner":
        pinned |= faces == 1
    return np.asarray(pinned)
