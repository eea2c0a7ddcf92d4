"""Which subdivision rule applies where: the sharpness of edges and vertices, and sectors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from functools import lru_cache
from math import lcm
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf import numbers, tables
from limitsurf._kernels.rationals import Digits, Objects, counting, integers, rationals
from limitsurf.caching import cached_property
from limitsurf.cage.connectivity import Fans
from limitsurf.cage.mesh import Mesh, kept
from limitsurf.numbers import NumberType
from limitsurf.options import Rules as Rules
from limitsurf.topology import MeshPart, child_halves, without_points

if TYPE_CHECKING:
    from limitsurf.scheme.lattice import Lattice

Array = NDArray[Any]
Rationals: TypeAlias = Digits | Objects

# rules of vertices, see exact/creases.py
SMOOTH, DART, CREASE, CORNER = range(4)
# a fan of no kind, see Sectors
PENDING = -1


class RuledMesh(Mesh):
    """A mesh with the rules that it was made by: what is sharp is known, whatever its tags say.

    Attributes
    ----------
    rules : Rules
    origin : (Sharpness, bool)
        Its sharpness, or (True) that of the mesh which it is the refinement of.
    channel_meshes : {name: RuledMesh}
        The values of its channels.
    """

    rules: Rules
    origin: tuple[Sharpness, bool]
    channel_meshes: Mapping[str, RuledMesh] = MappingProxyType({})

    @cached_property
    def sharpness(self) -> Sharpness:
        """The sharpness of its edges and vertices."""
        known, coarser = self.origin
        return known.children(self, self.rules.scheme.lattice) if coarser else known


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
        Float64: 0, or infinite, only where the sharpness is.
    edge_tagged : (S,) bool
        Where the sharpness comes from tags.
    vertex : (M,) int
        Ascending.
    vertex_sharpness, vertex_tagged : (M,)
    chaikin : bool
    far : bool
        Whether the point of an edge depends on all that is sharp at both of its ends.
    number : NumberType
        Of the masks.
    exact : (rationals, rationals) or None
        What the finite sharpnesses of the edges (S,) and of the vertices (M,) are, where float64
        may not hold them; masks are then exact, or rounded once. 0 for infinite ones.
    linear : bool
        Whether all edges and vertices are sharp, those that refinement makes included: only of
        values of channels.
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
    far: bool
    number: NumberType
    exact: tuple[Rationals, Rationals] | None
    linear: bool

    @classmethod
    def of(cls, mesh: Mesh, rules: Rules, number: NumberType, exact: bool = False) -> Sharpness:
        """The sharpness of a cage; a refined mesh carries its own."""
        if isinstance(mesh, RuledMesh) and mesh.rules == rules:
            return mesh.sharpness.typed(mesh, number, exact)
        # in a copy: what is derived from it is not kept, as long as nobody needs it
        known = kept(mesh, "sharpness", rules, lambda: cls._of_tags(mesh, rules))
        return known.typed(mesh, number, exact)

    @classmethod
    def _of_tags(cls, mesh: Mesh, rules: Rules) -> Sharpness:
        """The sharpness of a cage, which does not hold on to its points."""
        # rules change where a sharpness reaches 0: rounding must not decide it
        (ends, creases), (vertices, corners) = mesh.creases, mesh.corners
        exact = rules.creasing == "chaikin" and len(creases) > 0
        exact |= numbers.common(creases, corners).exact
        marked = mesh.twin < 0
        tagged_edges = mesh.edge_numbers(ends) if len(ends) else np.zeros(0, np.int64)
        if len(ends):
            tagged = np.zeros(mesh.n_edges, dtype=bool)
            tagged[tagged_edges] = True
            marked |= tagged[mesh.corner_edge]
        sides = np.flatnonzero(marked)
        if len(ends) or (len(sides) and mesh.separate[sides].any()):
            key = mesh.corner_edge[sides]
        else:
            pairs = mesh.indices[np.stack([sides, mesh.connectivity.after(sides)])]
            key = pairs.min(axis=0) * mesh.n_vertices + pairs.max(axis=0)
        unique, edge = np.unique(key, return_inverse=True)
        is_open = np.zeros(len(unique), dtype=bool)
        is_open[edge[mesh.twin[sides] < 0]] = True
        place = np.searchsorted(unique, tagged_edges)
        edge_sharpness, edge_exact = _sharpness(creases, place, is_open, exact)
        # on a boundary only an infinite tag means anything, see Rules.loose_vertices
        edge_tagged = np.zeros(len(unique), dtype=bool)
        edge_tagged[place] = ~is_open[place] | tables.is_infinite(creases)
        pinned = np.flatnonzero(_pinned(mesh, rules))
        vertex = np.union1d(vertices, pinned)
        place = np.searchsorted(vertex, vertices)
        is_pinned = np.isin(vertex, pinned)
        vertex_sharpness, vertex_exact = _sharpness(corners, place, is_pinned, exact)
        vertex_tagged = np.zeros(len(vertex), dtype=bool)
        vertex_tagged[place] = True
        return cls(
            without_points(mesh),
            sides,
            edge,
            edge_sharpness,
            edge_tagged,
            vertex,
            vertex_sharpness,
            vertex_tagged,
            rules.creasing == "chaikin",
            rules.creasing == "chaikin" or callable(rules.scheme.edge),
            numbers.FLOAT64,
            None if edge_exact is None or vertex_exact is None else (edge_exact, vertex_exact),
            linear=False,
        )

    def typed(self, mesh: Mesh, number: NumberType, exact: bool = False) -> Self:
        """Sharpness of a copy of the mesh, at least as exact as another number type."""
        if self.exact or not (exact or number.exact):
            return replace(self, mesh=mesh, number=number)
        edges, vertices = (
            rationals(np.where(tables.is_infinite(x), 0, x))
            for x in (self.edge_sharpness, self.vertex_sharpness)
        )
        return replace(self, mesh=mesh, number=number, exact=(edges, vertices))

    def __getstate__(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @cached_property
    def half_edges(self) -> Array:
        """Sharpness by half-edge: shape (n_corners,)."""
        result = np.zeros(self.mesh.n_corners)
        result[self.sides] = self.edge_sharpness[self.edge]
        return result

    @cached_property
    def edges(self) -> Array:
        """Sharpness by edge: shape (n_edges,)."""
        result = np.zeros(self.mesh.n_edges)
        result[self.mesh.corner_edge[self.sides]] = self.edge_sharpness[self.edge]
        return result

    @cached_property
    def vertices(self) -> Array:
        """Sharpness by vertex: shape (n_vertices,)."""
        result = np.zeros(self.mesh.n_vertices)
        result[self.vertex] = self.vertex_sharpness
        return result

    def at(self, corners: Array) -> Array:
        """Finite sharpness of some half-edges, (n,): float64, or Fractions where that rounds."""
        if self.exact is None:
            return self.half_edges[corners]
        edge = self.edge_at(corners)
        exact = self.exact[0].take(edge)
        if not self.number.exact:
            rounded = self.edge_sharpness[edge]
            twice = rationals(rounded)
            if not (twice - exact).positive.any() and not (exact - twice).positive.any():
                return np.asarray(rounded)
        return exact.fractions()

    @cached_property
    def first(self) -> Array:
        """The lowest side of each edge, (S,)."""
        result = np.full(len(self.edge_sharpness), self.mesh.n_corners)
        np.minimum.at(result, self.edge, self.sides)
        return result

    @cached_property
    def _incident(self) -> tuple[Array, Array]:
        """Edges of positive sharpness, twice, (2 S,): their tails by `first`, then their heads.

        Which of the edges, and the place of the vertex in `concerned`.
        """
        sharp = np.flatnonzero(self.edge_sharpness > 0)
        place = self._places[1]
        return np.tile(sharp, 2), place[len(place) - 2 * len(sharp) :]

    @cached_property
    def ends(self) -> tuple[Array, Array, Array, Array]:
        """The `_incident` edges, their sharpness, and that of their halves there: (2 S,) each."""
        edge, place = self._incident
        return edge, place, self.edge_sharpness[edge], self.halves[0]

    @cached_property
    def _pairs(self) -> Array:
        """Tails and heads of the edges of positive sharpness, (2, S)."""
        first = self.first[self.edge_sharpness > 0]
        return np.stack(
            [self.mesh.indices[h] for h in (first, self.mesh.connectivity.after(first))]
        )

    @property
    def concerned(self) -> Array:
        """Vertices that are sharp or at the end of a sharp edge, ascending: shape (K,)."""
        return self._places[0]

    @cached_property
    def _places(self) -> tuple[Array, Array]:
        """`concerned`, and the places in there of the sharp vertices, then of `sharp_ends`."""
        sharp = self.vertex[self.vertex_sharpness > 0]
        return numbered(np.concatenate([sharp, self._pairs.ravel()]), self.mesh.n_vertices)

    @cached_property
    def _own(self) -> tuple[Array, Array]:
        """Sharpness of the vertices that are concerned, and of their children: shape (K,) each."""
        sharp = np.flatnonzero(self.vertex_sharpness > 0)
        result = np.zeros((2, len(self.concerned)))
        place = self._places[1][: len(sharp)]
        result[:, place] = self.vertex_sharpness[sharp], self._later[0][sharp]
        return result[0], result[1]

    @cached_property
    def _later(self) -> tuple[Array, Rationals | None]:
        """Sharpness of the children of the M vertices, and what it is exactly: (M,)."""
        if self.exact is None:
            return np.maximum(self.vertex_sharpness - 1, 0), None
        later = self.exact[1] - _ones(len(self.vertex))
        return _rounded(later, tables.is_infinite(self.vertex_sharpness)), later

    @cached_property
    def halves(self) -> tuple[Array, Rationals | None]:
        """Sharpness of the halves of sharp edges at their ends, and what it is exactly.

        All (2 S,) as in `ends`.
        """
        edge, place = self._incident
        if self.exact is None:
            return np.maximum(self.edge_sharpness[edge] - 1, 0), None
        infinite = tables.is_infinite(self.edge_sharpness[edge])
        soft = np.flatnonzero(~infinite)
        after = self.exact[0].take(edge[soft])
        if self.chaikin and len(soft):
            after = _averaged(after, numbered(place[soft], len(self.concerned))[1])
        after = (after - _ones(len(soft))).spread(soft, len(edge))
        return _rounded(after, infinite), after

    def edge_at(self, corners: Array) -> Array:
        """Which of the S edges some half-edges are sides of."""
        edge = np.zeros(self.mesh.n_corners, dtype=np.int64)
        edge[self.sides] = self.edge
        return edge[corners]

    def halves_at(self, corners: Array, heads: Array) -> Array:
        """Places in `ends` of the halves of sharp half-edges at their tails, or `heads` (bool)."""
        edge = self.edge_at(corners)
        sharp = self.edge_sharpness > 0
        turned = self.mesh.indices[corners] != self.mesh.indices[self.first[edge]]
        return np.asarray((np.cumsum(sharp) - 1)[edge] + sharp.sum() * (turned != heads))

    @cached_property
    def rule(self) -> Array:
        """Rule of each vertex: shape (n_vertices,)."""
        result = np.full(self.mesh.n_vertices, SMOOTH)
        result[self.concerned] = self._rules[0]
        return result

    @cached_property
    def _rules(self) -> tuple[Array, Array]:
        """Rule of the `concerned` vertices and of their children: (K,)."""
        _, place, _, after = self.ends
        own, later = self._own
        counts = np.bincount(place, minlength=len(own))  # at edges that are all sharp
        parent = np.where(own > 0, CORNER, np.minimum(counts, CORNER))
        if after.all() and ((own > 0) == (later > 0)).all():
            return parent, parent
        counts = np.bincount(place[after > 0], minlength=len(own))
        return parent, np.where(later > 0, CORNER, np.minimum(counts, CORNER))

    @cached_property
    def shares(self) -> tuple[Array, Any, Any]:
        """How the rules of vertices change.

        Which of the `concerned` vertices have children of another rule, the share of their own rule
        in their points, and the rest: both float64, or exact if sharpness is. Smooth vertices and
        darts never change.
        """
        edge, place, sharpness, after = self.ends
        (parent, child), (own, later) = self._rules, self._own
        if parent is child:
            nothing = np.zeros(0) if self.exact is None else _ones(0)
            return np.zeros(0, dtype=np.int64), nothing, nothing
        changing = np.flatnonzero((parent != child) & (parent > DART))
        # the mean of what falls to zero
        number = np.full(len(parent), -1)
        number[changing] = np.arange(len(changing))
        ends = np.flatnonzero((after == 0) & (number[place] >= 0))
        at = number[place[ends]]
        count = np.bincount(at, minlength=len(changing))
        falling = np.flatnonzero((own[changing] > 0) & (later[changing] == 0))
        count[falling] += 1
        if self.exact is None:
            total = np.zeros(len(changing))
            np.add.at(total, at, sharpness[ends])
            total[falling] += own[changing[falling]]
            share = np.minimum(total / np.maximum(count, 1), 1)
            return changing, share, 1 - share
        edges, vertices = self.exact
        at_vertex = np.searchsorted(self.vertex, self.concerned[changing[falling]])
        sums = edges.take(edge[ends]).summed(at, len(changing))
        sums = sums + vertices.take(at_vertex).spread(falling, len(changing))
        rest = _ones(len(changing)) - sums.over(np.maximum(count, 1))
        return changing, _ones(len(changing)) - rest, rest

    @cached_property
    def vertex_masks(self) -> tuple[Array, Array, Array]:
        """Shares of the three masks in the points of `concerned` vertices.

        The shares of the smooth and the corner mask, both (K,), and, as an array (2 S,) for the
        `sharp_ends`, those of the crease mask that runs along the edge.
        """
        _, place, _, after = self.ends
        (parent, child), (changing, *shares) = self._rules, self.shares
        one, zero = self.number.one, self.number.zero
        if not len(changing):
            smooth = np.where(parent <= DART, one, zero)
            corner = np.where(parent == CORNER, one, zero)
            return smooth, corner, np.where((parent == CREASE)[place], one, zero)
        share, rest = (self.number.full(len(parent), x) for x in (one, zero))
        share[changing], rest[changing] = map(self._numbers, shares)
        smooth = np.where(parent <= DART, one, np.where(child <= DART, rest, zero))
        corner = np.where(parent == CORNER, share, zero)
        corner = corner + np.where((child == CORNER) & (parent != CORNER), rest, zero)
        along = np.where(parent[place] == CREASE, share[place], zero)
        stays = (after > 0) & (child[place] == CREASE) & (parent[place] == CORNER)
        along = along + np.where(stays, rest[place], zero)
        return smooth, corner, along

    def _numbers(self, values: Any) -> Array:
        """Numbers of masks, rounded if they are exact and masks are not."""
        if isinstance(values, np.ndarray):
            return values
        return np.asarray(values.fractions() if self.number.exact else values.floats())

    @cached_property
    def codes(self) -> tuple[Array, Array]:
        """Numbers for finite sharpness from 1 on; -1 is infinite, and 0 none.

        Of half-edges, (n_corners,); and of the creases through vertices, (n_vertices,): those that
        come in and go on with the same sharpness.
        """
        if self.exact is None:
            _, found = np.unique(self.edge_sharpness, return_inverse=True)
        else:
            found = self.exact[0].codes()
        code = np.where(tables.is_infinite(self.edge_sharpness), -1, found + 1)
        code[self.edge_sharpness == 0] = 0
        by_corner = np.zeros(self.mesh.n_corners, dtype=np.int64)
        by_corner[self.sides] = code[self.edge]
        edge, place = self._incident
        crease = np.zeros(len(self.concerned), dtype=np.int64)
        ends = code[edge]
        crease[place] = ends  # one of the two
        crease[self._rules[0] != CREASE] = 0
        crease[place[ends != crease[place]]] = 0
        by_vertex = np.zeros(self.mesh.n_vertices, dtype=np.int64)
        by_vertex[self.concerned] = crease
        return by_corner, by_vertex

    @cached_property
    def edge_masks(self) -> Array:
        """Share of the midpoint in the point of each of `sharp_edges`, the rest being smooth."""
        edge, _, sharpness, after = self.ends
        half = len(sharpness) // 2
        one = self.number.one
        falling = np.flatnonzero((after[:half] == 0) | (after[half:] == 0))
        own = sharpness[falling]
        if self.number.exact and self.exact:
            own = self.exact[0].take(edge[falling]).fractions()
        result = self.number.full(half, one)
        result[falling] = np.minimum(own, one)
        return result

    @cached_property
    def unsettled(self) -> Array:
        """Vertices that are semi-sharp or at the end of a semi-sharp edge, (n_vertices,) bool."""
        _, place, sharpness, _ = self.ends
        own = self._own[0]
        soft = (own > 0) & ~tables.is_infinite(own)
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

    def children(self, mesh: Mesh, lattice: Lattice) -> Self:
        """The sharpness of the refined mesh."""
        coarse = self.mesh
        edge, _, _, after = self.ends
        # the halves of edge e are 2 e, at the tail of its first side, and 2 e + 1
        kept = np.full(2 * len(self.edge_sharpness), -1)
        number = (2 * edge.reshape(2, -1) + [[0], [1]]).ravel()
        kept[number] = np.where(after > 0, np.arange(len(after)), -1)
        halves = np.flatnonzero(kept >= 0)
        ends = kept[halves]
        kept[halves] = np.arange(len(halves))
        turned = coarse.indices[self.sides] != coarse.indices[self.first[self.edge]]
        half = np.concatenate([2 * self.edge + turned, 2 * self.edge + ~turned])
        sides = np.concatenate(child_halves(coarse.connectivity, self.sides, lattice))
        sharp = np.flatnonzero(kept[half] >= 0)
        later, exact = self._later[0], None
        stay = np.flatnonzero(later > 0)
        if self.halves[1] is not None and self._later[1] is not None:
            exact = self.halves[1].take(ends), self._later[1].take(stay)
        return replace(
            self,
            mesh=mesh,
            sides=sides[sharp],
            edge=kept[half[sharp]],
            edge_sharpness=after[ends],
            edge_tagged=self.edge_tagged[halves // 2],
            vertex=self.vertex[stay],
            vertex_sharpness=later[stay],
            vertex_tagged=self.vertex_tagged[stay],
            exact=exact,
        )

    def neighbours(self, corners: Array) -> Array:
        """All corners whose sharpness matters for points at some, (n_corners,) bool.

        Those at the same vertices; and at the vertices of all their faces where both ends of an
        edge decide its point: by its halves under "chaikin", or by masks that depend on them.
        """
        mesh = self.mesh
        for step in range(1 + self.far):
            if step:
                corners = np.logical_or.reduceat(corners, mesh.offsets[:-1])[mesh.corner_face]
            touched = np.zeros(mesh.n_vertices, dtype=bool)
            touched[mesh.indices[corners]] = True
            corners = touched[mesh.indices]
        return corners

    def part(self, part: MeshPart) -> Self:
        """The sharpness of a part of the mesh."""
        inside, sides = _found(part.corners, self.sides)
        edges, edge = numbered(self.edge[inside], len(self.edge_sharpness))
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
            exact=self.exact and (self.exact[0].take(edges), self.exact[1].take(here)),
        )

    def tags(self) -> dict[str, tuple[Array, Array]]:
        """What comes from tags, as ``creases`` and ``corners`` of a mesh."""
        tagged = np.flatnonzero(self.edge_tagged)
        h = self.first[tagged]
        pairs = self.mesh.indices[np.stack([h, self.mesh.connectivity.after(h)])]
        key = pairs.min(axis=0) * self.mesh.n_vertices + pairs.max(axis=0)
        key, place = np.unique(key, return_index=True)
        edges = np.stack(np.divmod(key, self.mesh.n_vertices), axis=1)
        vertices = self.vertex_tagged
        return {
            "creases": (edges, self._tags(0, self.edge_sharpness, tagged[place])),
            "corners": (self.vertex[vertices], self._tags(1, self.vertex_sharpness, vertices)),
        }

    def _tags(self, which: int, sharpness: Array, wanted: Array) -> Array:
        """Some sharpness of edges (0) or vertices (1): float64, or, if that rounds, objects."""
        if self.exact is None:
            return sharpness[wanted]
        sharpness = sharpness[wanted].astype(object)
        soft = ~tables.is_infinite(sharpness)
        sharpness[soft] = self.exact[which].take(wanted).take(soft).fractions()
        return sharpness


def numbered(values: Array, most: int) -> tuple[Array, Array]:
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
    lattice : Lattice
    """

    mesh: Mesh
    twin: Array
    fans: Fans
    kind: Array
    sharpness: Sharpness
    lattice: Lattice

    @classmethod
    def of(cls, sharpness: Sharpness, lattice: Lattice) -> Sectors:
        """Part the faces at each vertex."""
        mesh = sharpness.mesh
        infinite = tables.is_infinite(sharpness.edge_sharpness)
        twin = mesh.twin
        cut = sharpness.sides[infinite[sharpness.edge]]
        cut = cut[twin[cut] >= 0]
        if len(cut):
            twin = twin.copy()
            twin[cut] = -1
        fans = Fans.of(mesh.connectivity, twin) if len(cut) else mesh.fans
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
        return cls(mesh, twin, fans, kind, sharpness, lattice)

    @property
    def shared(self) -> Array:
        """Whether the patches at a sector share its ring (`tables.is_shared`), (n_fans,) bool."""
        many = self.fans.sizes > tables.MOST_FACES
        return np.asarray(many & _sharing(self.lattice)[self.kind]) if many.any() else many

    @cached_property
    def regular(self) -> Array:
        """Fans around which the surface is the spline, reflected at sharp edges: (n_fans,) bool.

        As many smooth faces as are around a regular vertex, half of them along a crease, or a
        quarter, if there is one, in a corner; one in a corner where all edges stay sharp, which no
        refinement would part from the others. (Elsewhere second derivatives may vanish at it, and
        keep their digits next to a special corner alone.)
        """
        valence = self.lattice.valence
        corner = 1 if self.sharpness.linear else valence / 4
        faces = {"interior": valence, "crease": valence / 2, "corner": corner}
        wanted = np.array([faces.get(kind, 0) for kind in tables.KINDS])
        return np.asarray((self.kind >= 0) & (self.fans.sizes == wanted[self.kind]))

    def groups(self, fans: Array) -> Iterator[tuple[str, int, Array]]:
        """The given fans by kind and number of faces: kind, number, fans."""
        if len(fans) == 0:
            return
        sizes = self.fans.sizes[fans]
        most = 1 + int(sizes.max())
        key = self.kind[fans] * most + sizes
        order = np.argsort(key, kind="stable")
        key = key[order]
        first = np.flatnonzero(np.diff(key, prepend=key[0] - 1))
        parts = np.split(fans[order], first[1:])
        for code, members in zip(key[first].tolist(), parts, strict=True):
            kind, faces = divmod(code, most)
            yield tables.KINDS[kind], faces, members

    def ring(self, kind: str, faces: int, fans: Array, start: Array | int = 0) -> Array:
        """Vertices of fans of one kind and size, (n, R), ordered as in ``exact/matrices.py``.

        Those of closed fans begin at the face `start`. In the place of the point halfway between
        its neighbours on the crease that carries a vertex stand both of these, last.
        """
        mesh = self.mesh
        turns = (np.asarray(start)[..., None] + np.arange(faces)) % faces
        h = self.fans.corners[self.fans.offsets[fans][:, None] + turns]
        beside, after = [], h
        for _ in self.lattice.orbits:
            after = mesh.next_corner[after]
            beside.append(mesh.indices[after])
        around = np.stack(beside, axis=-1).reshape(len(fans), len(beside) * faces)
        parts = [self.fans.vertex[fans][:, None], around]
        sector = tables.Sector(kind, faces, lattice=self.lattice)
        if sector.open:
            parts.append(mesh.indices[mesh.previous_corner[h[:, -1:]]])
        if sector.carried:
            parts.append(self.sharpness.beside(self.fans.vertex[fans]))
        return np.concatenate(parts, axis=1)


@lru_cache(maxsize=16)
def _sharing(lattice: Lattice) -> Array:
    """Whether patches at so many faces share a ring, by kind of sector: (kinds,) bool."""
    sectors = (tables.Sector(name, tables.MOST_FACES + 1, 0, lattice) for name in tables.KINDS)
    return np.array([tables.is_shared(sector) for sector in sectors])


def _sharpness(
    tags: Array, place: Array, infinite: Array, exact: bool
) -> tuple[Array, Rationals | None]:
    """Sharpness (n,) from tags at some places: float64 and, if wanted, what it is exactly.

    From INFINITE on it is infinite, and where it is so whatever the tags are: (n,) bool.
    """
    sharp = tables.is_infinite(tags)
    infinite = infinite.copy()
    infinite[place[sharp]] = True
    soft = np.flatnonzero(~infinite[place])
    if exact:
        found = rationals(tags[soft]).spread(place[soft], len(infinite))
        return _rounded(found, infinite), found
    result = np.where(infinite, np.inf, 0.0)
    result[place[soft]] = tags[soft]
    return result, None


def _rounded(exact: Rationals, infinite: Array) -> Array:
    """Sharpness as float64, which is 0, or infinite, only where it is."""
    result = np.where(infinite, np.inf, 0.0)
    some = np.flatnonzero(exact.positive)
    least, most = np.nextafter([0.0, tables.INFINITE], [1.0, 0.0])
    result[some] = exact.take(some).floats().clip(least, most)
    return result


def _ones(n: int) -> Digits:
    return integers(np.ones(n, dtype=np.int64))


def _averaged(sharpness: Rationals, place: Array) -> Rationals:
    """Sharpness at the ends of edges averaged with that of the others in the same places."""
    share = Fraction(tables.chaikin_weights(numbers.RATIONAL)[1])
    total = sharpness.summed(place, int(place.max()) + 1).take(place)
    others = np.bincount(place)[place] - 1
    common = lcm(1, *np.unique(others[others > 0]).tolist())
    others = counting(others, common * share.denominator)
    # over the common number of others: alone an edge keeps what it has
    shared = share.numerator * (others > 0)
    part = shared * (common // np.maximum(others, 1))
    own = common * (share.denominator - shared)
    averaged = sharpness.times(own) + (total - sharpness).times(part)
    return averaged.per(common * share.denominator)


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
