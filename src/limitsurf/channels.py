"""Face-varying channels: a second topology over the same faces, refined by the same rules.

A *value* is what a channel has at a vertex in some of its faces: a pair (vertex, row of the
channel). The mesh of the values has the faces and corners of the cage; where two faces disagree
about an edge, at either end, it has a *seam*, and each side a boundary of its own. Boundaries,
seams and infinitely sharp edges are infinitely sharp; other creases keep the sharpness of the cage.
Which values stay where they are, the interpolation mode decides, once and for all in the cage
(`_pinned`); these are OpenSubdiv's "face-varying linear interpolation" modes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import numbers, tables
from limitsurf._kernels.rationals import Digits, integers
from limitsurf.caching import cached_property
from limitsurf.cage.checks import INTERPOLATION
from limitsurf.cage.connectivity import Connectivity, read_only
from limitsurf.cage.mesh import Mesh, kept, valid_mesh
from limitsurf.rules import CORNER, SMOOTH, Rationals, RuledMesh, Rules, Sharpness, numbered
from limitsurf.scheme.lattice import Lattice
from limitsurf.topology import MeshPart, child_mesh, child_vertices, without_points

Array = NDArray[Any]

# rules of boundaries by which a dual scheme continues values beyond seams, by how a channel is
# interpolated; others hold values where it has no rule for them
_DUAL_BOUNDARY = {"none": "edge_only", "corners_only": "edge_and_corner"}
# those that only say where values are to stay, as they do anyway under schemes that interpolate
_KEPT = "none", "corners_only", "corners_plus1", "corners_plus2"


class ChannelMesh(RuledMesh):
    """The values of a channel as a mesh with sharpness of its own.

    Attributes
    ----------
    base : Rules
        Of the mesh; `rules` are those by which the values are refined.
    """

    base: Rules

    def __getstate__(self) -> dict[str, Any]:
        return {**super().__getstate__(), "origin": (self.sharpness, False)}

    @classmethod
    def of(cls, mesh: Mesh, name: str, rules: Rules) -> ChannelMesh:
        """The mesh of the values of a channel, made once; a refined mesh carries its own."""
        if isinstance(mesh, RuledMesh):
            carried = mesh.channel_meshes.get(name)
            if isinstance(carried, ChannelMesh) and carried.base == rules:
                return carried
        return kept(mesh, f"channel {name}", rules, lambda: cls._made(mesh, name, rules))

    @classmethod
    def _made(cls, mesh: Mesh, name: str, rules: Rules) -> ChannelMesh:
        """The mesh of the values of a channel of a cage."""
        if name not in mesh.channels:
            listed = ", ".join(map(repr, mesh.channels)) or "none"
            raise ValueError(f"the mesh has no channel {name!r}; it has {listed}")
        rows, corner_rows, mode = mesh.channels[name]
        dual = rules.scheme.lattice.dual or rules.scheme.turns_edges
        if not knows_mode(rules, mode):
            known = _known_modes(rules)
            raise ValueError(
                f"scheme {rules.scheme.name!r} has no rule for channel {name!r}, which is "
                f"interpolated as {mode!r}: it knows {', '.join(map(repr, known))}; "
                "give it as one of these, or leave it out, mesh.with_tags(channels=None)"
            )
        if mesh.connectivity.compiled:
            from limitsurf._kernels import connectivity

            vertex, row, value = connectivity.values(corner_rows, *mesh.connectivity.around[:2])
        else:
            key, value = np.unique(mesh.indices * len(rows) + corner_rows, return_inverse=True)
            vertex, row = np.divmod(key, len(rows))
        holes = np.flatnonzero(rules.without_limit(mesh))
        cage = {"separate": mesh.separate, "repeats": mesh.connectivity.repeats}
        faces = Connectivity(len(row), mesh.sizes, value, **cage)
        result = valid_mesh(cls, rows[row], faces, holes=holes)
        # what boundary="none" leaves without a limit are holes here: seams leave nothing
        result.base, result.rules = rules, replace(rules, boundary="edge_only")
        if dual:  # seams are boundaries, as there are any
            result.rules = replace(rules, boundary=_DUAL_BOUNDARY[mode])
            result.origin = (
                Sharpness.of(without_points(result), result.rules, numbers.FLOAT64),
                False,
            )
            return result
        geometry = Sharpness.of(mesh, rules, numbers.FLOAT64, exact=True)
        # meshes that nothing else holds on to
        geometry = replace(geometry, mesh=without_points(mesh))
        sharpness = _sharpness(geometry, rules, without_points(result), vertex, mode)
        result.origin = sharpness, False
        return result

    def refined(
        self, mesh: Mesh, values: Array, sharpness: Sharpness, coarser: bool, holes: Array
    ) -> ChannelMesh:
        """A channel on a refinement of the mesh, which has these holes.

        The sharpness may be that of the next `coarser` mesh.
        """
        result = valid_mesh(type(self), values, mesh.connectivity)
        result.holes = read_only(holes)
        result.base, result.rules, result.origin = self.base, self.rules, (sharpness, coarser)
        return result


def knows_mode(rules: Rules, mode: str) -> bool:
    """Whether a scheme has rules for channels that are interpolated like this."""
    return mode in _known_modes(rules)


def _known_modes(rules: Rules) -> tuple[str, ...]:
    # schemes without rules for sharp edges whose curves do not keep their points
    if rules.scheme.lattice.dual or rules.scheme.turns_edges:
        return tuple(_DUAL_BOUNDARY)
    return INTERPOLATION if rules.scheme.has_pieces else _KEPT


@dataclass(frozen=True, eq=False)
class ChannelSharpness(Sharpness):
    """Sharpness of the values of a channel.

    Attributes
    ----------
    geometry : Sharpness
        That of the mesh, which has the same corners. Halves of edges get theirs from it: under
        "chaikin" it is averaged over all edges at a vertex, whatever the seams.
    followers : (n, 2) int
        Values that are sharp as long as another one at their vertex is, and these.
    """

    geometry: Sharpness
    followers: Array

    @cached_property
    def halves(self) -> tuple[Array, Rationals | None]:
        """Sharpness of the halves of sharp edges at their ends: tails first, then heads."""
        edge, _ = self._incident
        head = np.repeat([False, True], len(edge) // 2)
        after = self.edge_sharpness[edge]
        soft = np.flatnonzero(~tables.is_infinite(after))
        there = self.geometry.halves_at(self.first[edge[soft]], head[soft])
        halves, exact = self.geometry.halves
        assert exact is not None
        after[soft] = halves[there]
        return after, exact.take(there).spread(soft, len(edge))

    def children(self, mesh: Mesh, lattice: Lattice) -> ChannelSharpness:
        """The sharpness of the refined mesh."""
        coarse = self.geometry.mesh
        finer = child_mesh(coarse, np.zeros(child_vertices(coarse.connectivity, lattice)), lattice)
        geometry = self.geometry.children(finer, lattice)
        children = replace(super().children(mesh, lattice), geometry=geometry)
        if self.linear:
            edges, vertices = np.full(mesh.n_edges, np.inf), np.full(mesh.n_vertices, np.inf)
            return replace(
                children,
                sides=np.arange(mesh.n_corners),
                edge=mesh.corner_edge,
                edge_sharpness=edges,
                edge_tagged=np.zeros(mesh.n_edges, dtype=bool),
                vertex=np.arange(mesh.n_vertices),
                vertex_sharpness=vertices,
                vertex_tagged=np.zeros(mesh.n_vertices, dtype=bool),
                exact=(_zeros(mesh.n_edges), _zeros(mesh.n_vertices)),
            )
        return children.following()

    def neighbours(self, corners: Array) -> Array:
        """All corners at the vertices of some, (n_corners,) bool."""
        return self.geometry.neighbours(corners)

    def part(self, part: MeshPart) -> ChannelSharpness:
        """The sharpness of a part of the mesh."""
        geometry = self.geometry.part(MeshPart.of(self.geometry.mesh, part.wanted))
        inside = np.isin(self.followers, part.vertices).all(axis=1)
        followers = np.searchsorted(part.vertices, self.followers[inside])
        return replace(super().part(part), geometry=geometry, followers=followers)

    def following(self) -> ChannelSharpness:
        """With the vertex sharpness that keeps followers sharp for as long as they should be.

        A follower is released together with its leader, by the same share; but one step later,
        and at once, while a crease along the seam itself is still decaying, as in OpenSubdiv.
        """
        if not len(self.followers):
            return self
        follower, leader = self.followers.T
        # those that are not concerned are smooth and stay so
        parent, child = np.full((2, self.mesh.n_vertices), SMOOTH)
        parent[self.concerned], child[self.concerned] = self._rules
        there = self.geometry
        decaying = np.zeros(there.mesh.n_vertices, dtype=bool)
        _, place, _, after = there.ends
        decaying[there.concerned[place[(after > 0) & ~tables.is_infinite(after)]]] = True
        at = np.zeros(self.mesh.n_vertices, dtype=np.int64)
        at[self.mesh.indices] = there.mesh.indices
        stays = child[leader] == CORNER
        released = (parent[leader] == CORNER) & ~stays
        late = decaying[at[follower]]
        # one that stays has a sharpness of 2, one that is released that share
        longer, now = follower[stays | (released & late)], released & ~late
        changing, share, _ = self.shares
        shared = np.searchsorted(self.concerned[changing], leader[now])
        kept = np.flatnonzero(~np.isin(self.vertex, follower))
        assert self.exact is not None
        parts = [
            (self.vertex[kept], self.vertex_sharpness[kept], self.exact[1].take(kept)),
            (longer, np.full(len(longer), 2.0), integers(np.full(len(longer), 2))),
            (follower[now], share.take(shared).floats(), share.take(shared)),
        ]
        vertex, place = np.unique(np.concatenate([x for x, _, _ in parts]), return_inverse=True)
        ends = np.cumsum([len(x) for x, _, _ in parts])[:-1]
        sharpness, exact = np.zeros(len(vertex)), _zeros(len(vertex))
        for (_, floats, rest), where in zip(parts, np.split(place, ends), strict=True):
            sharpness[where] = floats
            exact = exact + rest.spread(where, len(vertex))
        return replace(
            self,
            vertex=vertex,
            vertex_sharpness=sharpness,
            vertex_tagged=np.zeros(len(vertex), dtype=bool),
            exact=(self.exact[0], exact),
        )


def _sharpness(
    geometry: Sharpness, rules: Rules, values: Mesh, vertex: Array, mode: str
) -> ChannelSharpness:
    """The sharpness of the values of a channel of a cage, value k being at ``vertex[k]``."""
    assert geometry.exact is not None
    linear = mode == "all"
    half_edges = geometry.half_edges.copy()
    half_edges[(values.twin < 0) | linear] = np.inf
    sides = np.flatnonzero(half_edges > 0)
    known, edge = numbered(values.corner_edge[sides], values.n_edges)
    side = values.edge_corners[known, 0]
    edges = half_edges[side]
    soft = np.flatnonzero(~tables.is_infinite(edges))
    there = geometry.edge_at(side[soft])
    edges_exact = geometry.exact[0].take(there).spread(soft, len(edges))
    vertices = geometry.vertices[vertex]
    pinned, followers = _pinned(geometry, values, vertex, mode)
    vertices[pinned] = np.inf
    sharp = np.flatnonzero(vertices > 0)
    soft = np.flatnonzero(~tables.is_infinite(vertices[sharp]))
    there = np.searchsorted(geometry.vertex, vertex[sharp[soft]])
    vertices_exact = geometry.exact[1].take(there).spread(soft, len(sharp))
    return ChannelSharpness(
        values,
        sides=sides,
        edge=edge,
        edge_sharpness=edges,
        edge_tagged=np.zeros(len(edges), dtype=bool),
        vertex=sharp,
        vertex_sharpness=vertices[sharp],
        vertex_tagged=np.zeros(len(sharp), dtype=bool),
        chaikin=geometry.chaikin,
        far=geometry.far,
        number=numbers.FLOAT64,
        exact=(edges_exact, vertices_exact),
        geometry=geometry,
        followers=followers,
        linear=linear,
    ).following()


def _zeros(n: int) -> Digits:
    """As many zeros."""
    return integers(np.zeros(n, dtype=np.int64))


def _pinned(geometry: Sharpness, values: Mesh, vertex: Array, mode: str) -> tuple[Array, Array]:
    """Values that stay where they are, (n_values,) bool, and the followers (n, 2) among others."""
    mesh, n = geometry.mesh, len(vertex)
    if mode == "all":
        return np.ones(n, dtype=bool), np.zeros((0, 2), dtype=np.int64)

    def count(ends: Array, size: int = n) -> Array:
        return np.bincount(ends.ravel(), minlength=size)

    # a seam: an edge of the mesh that is several edges of values
    number = mesh.corner_edge[values.edge_corners[:, 0]]  # edges of the mesh by edges of values
    seam = count(number, mesh.n_edges) > 1
    inside = (values.edge_faces > 1) & ~seam[number]
    infinite = tables.is_infinite(geometry.edges)
    sharp = np.flatnonzero(inside & (geometry.edges > 0)[number])
    hard, soft = (
        count(values.edges[sharp[infinite[number[sharp]] == which]]) > 0 for which in (True, False)
    )
    broken = count(values.edges[values.edge_faces == 1]) != 2
    faces = count(values.indices)
    number_here = count(vertex, mesh.n_vertices)[vertex]  # values at the same vertex
    on_seam = np.zeros(mesh.n_vertices, dtype=bool)
    on_seam[mesh.edges[seam]] = True
    special = on_seam[vertex] | (number_here > 1)
    if mode == "boundaries":
        special |= mesh.boundary_vertex[vertex]
    if mode != "none":
        special |= mesh.vertex_faces[vertex] == 1

    def either(values_with: Array) -> Array:
        return (count(vertex[values_with], mesh.n_vertices) > 0)[vertex]

    lone = (faces == 1) & (mode != "none")
    pinned = hard | broken | lone | mesh.nonmanifold_vertex[vertex]
    pinned |= tables.is_infinite(geometry.vertices[vertex]) | (mode == "boundaries")
    pair = number_here == 2
    if mode in ("corners_plus1", "corners_plus2"):
        pinned |= (number_here > 2) | (pair & either(hard | broken))
    if mode == "corners_plus2":
        pinned |= pair & either(faces == 1)
        pinned |= (number_here == 1) & ~mesh.boundary_vertex[vertex]
    pinned &= special
    followers = np.zeros((0, 2), dtype=np.int64)
    if mode in ("corners_plus1", "corners_plus2"):
        free = special & pair & ~pinned & (geometry.vertices[vertex] == 0)
        follower = np.flatnonzero(free & ~soft & either(free & soft))
        # values are numbered by vertex: the other of two is next to it
        other = np.where(np.append(vertex[1:], -1)[follower] == vertex[follower], 1, -1)
        followers = np.stack([follower, follower + other], axis=1)
    return pinned, followers
