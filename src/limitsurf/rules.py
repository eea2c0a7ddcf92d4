"""Which subdivision rule applies where: options, and the sharpness of edges and vertices."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from limitsurf import tables
from limitsurf._kernels import reference as kernels
from limitsurf.mesh import Fans, Mesh
from limitsurf.topology import MeshPart

if TYPE_CHECKING:
    from limitsurf.exact.scheme import Scheme

Array = NDArray[Any]

# rules of vertices, see exact/creases.py
SMOOTH, DART, CREASE, CORNER = range(4)
# fans of no kind, see Sectors
PENDING, ASTRAY = -1, -2


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

    Attributes
    ----------
    mesh : Mesh
    half_edges : (n_corners,)
        Sharpness of each corner's half-edge, the same on all sides of an edge; float64 or exact.
    vertices : (n_vertices,)
    tagged_half_edges, tagged_vertices : bool
        Where the sharpness comes from tags.
    chaikin : bool
    """

    mesh: Mesh
    half_edges: Array
    vertices: Array
    tagged_half_edges: Array
    tagged_vertices: Array
    chaikin: bool

    @classmethod
    def of(cls, mesh: Mesh, rules: Rules, dtype: Any) -> Sharpness:
        """The sharpness of a cage; a refined mesh carries its own."""
        known = getattr(mesh, "_sharpness", None)
        if isinstance(known, Sharpness) and mesh._rules == rules:  # type: ignore[attr-defined]
            return known.typed(mesh, dtype)
        # rules change where a sharpness reaches 0: rounding must not decide it
        given = mesh.creases[1], mesh.corners[1]
        averaged = rules.creasing == "chaikin" and len(given[0]) > 0
        if averaged or object in [x.dtype for x in given]:
            dtype = np.dtype(object)
        edges, vertices = (_typed(np.zeros(n), dtype) for n in (mesh.n_edges, mesh.n_vertices))
        tagged = mesh.edge_numbers(mesh.creases[0])
        edges[tagged] = _typed(mesh.creases[1], dtype)
        edges[mesh.edge_corners[:, 1] < 0] = np.inf
        vertices[mesh.corners[0]] = _typed(mesh.corners[1], dtype)
        vertices[_pinned(mesh, rules)] = np.inf
        # on a boundary only an infinite tag means anything, see Rules.loose_vertices
        tagged_edges = np.zeros(mesh.n_edges, dtype=bool)
        inner = mesh.edge_corners[tagged, 1] >= 0
        tagged_edges[tagged] = inner | tables.is_infinite(mesh.creases[1])
        tagged_vertices = np.zeros(mesh.n_vertices, dtype=bool)
        tagged_vertices[mesh.corners[0]] = True
        return cls(
            mesh,
            edges[mesh.corner_edge],
            vertices,
            tagged_edges[mesh.corner_edge],
            tagged_vertices,
            rules.creasing == "chaikin",
        )

    def typed(self, mesh: Mesh, dtype: Any) -> Self:
        """The same on a copy of the mesh, at least as exact as another number type."""
        if self.half_edges.dtype == object:
            return replace(self, mesh=mesh)
        half_edges, vertices = _typed(self.half_edges, dtype), _typed(self.vertices, dtype)
        return replace(self, mesh=mesh, half_edges=half_edges, vertices=vertices)

    @cached_property
    def edges(self) -> Array:
        """Sharpness by edge: shape (n_edges,)."""
        return np.asarray(self.half_edges[self.mesh.edge_corners[:, 0]])

    @cached_property
    def _ends(self) -> tuple[Array, Array, Array, Array]:
        """Sharp edges (S,), twice; their ends, first and second; sharpness; that of the halves."""
        sharp = np.flatnonzero(self.edges > 0)
        vertex = self.mesh.edges[sharp].T.ravel()
        sharpness = np.tile(self.edges[sharp], 2)
        after = self._halves(np.tile(sharp, 2), vertex, sharpness)
        return np.tile(sharp, 2), vertex, sharpness, after

    def _halves(self, number: Array, vertex: Array, sharpness: Array) -> Array:
        """Sharpness of the halves of sharp edges (2 S,) at their ends."""
        after = sharpness
        if self.chaikin:
            share = tables.chaikin_weights(sharpness.dtype)[1]
            soft = ~tables.is_infinite(sharpness)
            total = self._sum(vertex[soft], sharpness[soft])
            others = np.bincount(vertex[soft], minlength=len(total))[vertex] - 1
            averaged = np.flatnonzero(soft & (others > 0))
            rest = total[vertex[averaged]] - sharpness[averaged]
            after = sharpness.copy()
            # exactly what it was where all are equal
            after[averaged] += share * (rest / others[averaged] - sharpness[averaged])
        return np.asarray(np.maximum(after - 1, 0))

    def halves(self, number: Array, vertex: Array) -> Array:
        """Sharpness of the halves of some edges at one of their ends, (n,)."""
        return np.asarray(self._by_end[(vertex != self.mesh.edges[number, 0]).astype(int), number])

    @cached_property
    def _by_end(self) -> Array:
        """Sharpness of the first and the second half of every edge, (2, n_edges)."""
        number, vertex, _, after = self._ends
        result = _typed(np.zeros((2, self.mesh.n_edges)), self.half_edges.dtype)
        result[(vertex != self.mesh.edges[number, 0]).astype(int), number] = after
        return result

    def _sum(self, vertex: Array, values: Array) -> Array:
        """Values summed by vertex, (n_vertices,)."""
        total = _typed(np.zeros(self.mesh.n_vertices), values.dtype)
        np.add.at(total, vertex, values)
        return total

    @cached_property
    def rule(self) -> Array:
        """Rule of each vertex: shape (n_vertices,)."""
        return self._rule(self.vertices, np.ones(len(self._ends[0]), dtype=bool))

    def _rule(self, vertices: Array, sharp: Array) -> Array:
        counts = np.bincount(self._ends[1][sharp], minlength=len(vertices))
        return np.where(vertices > 0, CORNER, np.minimum(counts, CORNER))

    @cached_property
    def transitions(self) -> tuple[Array, Array, Array]:
        """Rule of each vertex and of its child, and the share of the first, all (n_vertices,)."""
        _, vertex, sharpness, after = self._ends
        later = np.maximum(self.vertices - 1, 0)
        child = self._rule(later, after > 0)
        # the mean of what falls to zero
        fallen = (after == 0) & (sharpness > 0)
        total = self._sum(vertex[fallen], sharpness[fallen])
        count = np.bincount(vertex[fallen], minlength=len(total))
        own = (self.vertices > 0) & (later == 0)
        total[own] += self.vertices[own]
        count[own] += 1
        one = tables.one(sharpness.dtype)[0]
        share = np.minimum(total / np.maximum(count, 1), one)
        # smooth and darts never change
        share = np.where((self.rule == child) | (self.rule <= DART), one, share)
        return self.rule, child, share

    @cached_property
    def vertex_masks(self) -> tuple[Array, Array, Array]:
        """Shares of the three masks in each vertex point.

        The shares of the smooth and the corner mask, both (n_vertices,), and, as an array (2 S,)
        for the ends of the sharp edges, those of the crease mask that runs along the edge.
        """
        _, vertex, sharpness, after = self._ends
        parent, child, share = self.transitions
        one = tables.one(sharpness.dtype)[0]
        rest = one - share
        smooth = np.where(parent <= DART, one, np.where(child <= DART, rest, 0 * one))
        corner = np.where(parent == CORNER, share, 0 * one)
        corner = corner + np.where((child == CORNER) & (parent != CORNER), rest, 0 * one)
        along = np.where(parent[vertex] == CREASE, share[vertex], 0 * one)
        stays = (after > 0) & (child[vertex] == CREASE) & (parent[vertex] == CORNER)
        along = along + np.where(stays, rest[vertex], 0 * one)
        return smooth, corner, along

    @cached_property
    def straight(self) -> Array:
        """Sharpness of the crease through each vertex, 0 unless it is one on both sides: (V,)."""
        _, vertex, sharpness, _ = self._ends
        result = _typed(np.zeros(self.mesh.n_vertices), sharpness.dtype)
        through = (self.rule == CREASE)[vertex]
        result[vertex[through]] = sharpness[through]  # one of the two
        differ = through & (sharpness != result[vertex])
        result[vertex[differ]] = 0
        return result

    @cached_property
    def edge_masks(self) -> Array:
        """Share of the midpoint in each edge point, the rest being smooth: shape (n_edges,)."""
        number, _, sharpness, after = self._ends
        half = len(number) // 2
        one = tables.one(sharpness.dtype)[0]
        both = (after[:half] > 0) & (after[half:] > 0)
        result = _typed(np.zeros(self.mesh.n_edges), sharpness.dtype)
        result[number[:half]] = np.where(both, one, np.minimum(sharpness[:half], one))
        return result

    @cached_property
    def unsettled(self) -> Array:
        """Vertices that are semi-sharp or at the end of a semi-sharp edge, (n_vertices,) bool."""
        result = (self.vertices > 0) & ~tables.is_infinite(self.vertices)
        _, vertex, sharpness, _ = self._ends
        result[vertex[~tables.is_infinite(sharpness)]] = True
        return np.asarray(result, dtype=bool)

    @property
    def sharp_ends(self) -> tuple[Array, Array]:
        """Sharp edges, twice, (2 S,), and their ends, first and second, (2 S,)."""
        return self._ends[0], self._ends[1]

    def children(self, mesh: Mesh) -> Self:
        """The sharpness of the refined mesh."""
        coarse = self.mesh
        # by child corner: corner to midpoint, to face point, to midpoint before, to corner
        edge, tail = coarse.corner_edge, coarse.indices
        leaving = self.halves(edge, tail)
        before = coarse.previous_corner
        arriving = self.halves(edge[before], tail)
        nothing = _typed(np.zeros(coarse.n_corners), leaving.dtype)
        half_edges = np.stack([leaving, nothing, nothing, arriving], axis=1).ravel()
        tags = self.tagged_half_edges
        no = np.zeros_like(tags)
        tagged = np.stack([tags, no, no, tags[before]], axis=1).ravel()
        vertices = _typed(np.zeros(mesh.n_vertices), self.vertices.dtype)
        vertices[: coarse.n_vertices] = np.maximum(self.vertices - 1, 0)
        tagged_vertices = np.zeros(mesh.n_vertices, dtype=bool)
        tagged_vertices[: coarse.n_vertices] = self.tagged_vertices
        return replace(
            self,
            mesh=mesh,
            half_edges=half_edges,
            vertices=vertices,
            tagged_half_edges=tagged & (half_edges > 0),
            tagged_vertices=tagged_vertices & (vertices > 0),
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
        return replace(
            self,
            mesh=part.mesh,
            half_edges=self.half_edges[part.corners],
            vertices=self.vertices[part.vertices],
            tagged_half_edges=self.tagged_half_edges[part.corners],
            tagged_vertices=self.tagged_vertices[part.vertices],
        )

    def tags(self) -> dict[str, tuple[Array, Array]]:
        """What comes from tags, as ``creases`` and ``corners`` of a mesh."""
        h = np.flatnonzero(self.tagged_half_edges)
        ends = np.sort(
            np.stack([self.mesh.indices[h], self.mesh.indices[self.mesh.next_corner[h]]]), 0
        )
        edges, place = np.unique(ends.T, axis=0, return_index=True)
        v = np.flatnonzero(self.tagged_vertices)
        return {
            "creases": (edges, self.half_edges[h[place]]),
            "corners": (v, self.vertices[v]),
        }


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
        Index into `tables.KINDS`; `PENDING` while something semi-sharp is at the vertex, `ASTRAY`
        where the vertex follows a crease that other faces lie along.
    """

    mesh: Mesh
    twin: Array
    fans: Fans
    kind: Array

    @classmethod
    def of(cls, sharpness: Sharpness) -> Sectors:
        """Part the faces at each vertex."""
        mesh = sharpness.mesh
        cut = tables.is_infinite(sharpness.half_edges)
        twin = np.where(cut, -1, mesh.twin)
        fans = mesh.fans if np.array_equal(twin, mesh.twin) else Fans.of(mesh, twin)
        settled = ~sharpness.unsettled
        rule = sharpness.rule[fans.vertex]
        kinds = [tables.KINDS.index(name) for name in ("interior", "dart", "crease", "corner")]
        kind = np.array(kinds)[rule]
        kind[(rule == CORNER) & fans.closed] = tables.KINDS.index("cone")
        kind[~settled[fans.vertex]] = PENDING
        # at the crease of a fin there can be fans that do not lie between its two edges
        sharp = mesh.edges[tables.is_infinite(sharpness.edges)].ravel()
        ends = np.bincount(sharp, minlength=mesh.n_vertices)
        crease = (ends == 2) & ~tables.is_infinite(sharpness.vertices)
        first, last = fans.corners[fans.offsets[:-1]], fans.corners[fans.offsets[1:] - 1]
        loop = mesh.corner_edge[first] == mesh.corner_edge[mesh.previous_corner[last]]
        kind[crease[fans.vertex] & (fans.closed | loop)] = ASTRAY
        return cls(mesh, twin, fans, kind)

    @cached_property
    def regular(self) -> Array:
        """Fans around which the surface is a bicubic spline, reflected at sharp edges: (n_fans,).

        Four smooth faces, two along a crease, or one in a corner.
        """
        faces = np.zeros(len(tables.KINDS), dtype=np.int64)
        for kind, number in (("interior", 4), ("crease", 2), ("corner", 1)):
            faces[tables.KINDS.index(kind)] = number
        return np.asarray((self.kind >= 0) & (self.fans.sizes == faces[self.kind]))

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

        Those of closed fans begin at the face `start`.
        """
        mesh = self.mesh
        turns = (np.asarray(start)[..., None] + np.arange(faces)) % faces
        h = self.fans.corners[self.fans.offsets[fans][:, None] + turns]
        after = mesh.next_corner[h]
        pairs = np.stack([mesh.indices[after], mesh.indices[mesh.next_corner[after]]], axis=-1)
        parts = [self.fans.vertex[fans][:, None], pairs.reshape(len(fans), 2 * faces)]
        if kind in ("crease", "corner"):
            parts.append(mesh.indices[mesh.previous_corner[h[:, -1:]]])
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
