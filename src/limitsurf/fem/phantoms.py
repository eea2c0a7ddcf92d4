"""Ends that are free where they can be: phantom points as unknowns beyond boundaries and creases.

Faces all of whose corners on rims are regular are those of a cage that is cut along its creases and
extended by ghost faces. The others are as they were, and ghosts that reach them are reflections. On
creases functions have one value from both sides (``derivations/elements.py``, 1).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.caching import cached_property
from limitsurf.cage.mesh import Mesh
from limitsurf.fem.ends import ghosts_of, trimmed
from limitsurf.fem.ghosts import cut, rows_of, spread
from limitsurf.fem.joining import joined
from limitsurf.fem.places import vertex_places
from limitsurf.fem.sectors import Sectors
from limitsurf.fem.triangle_ghosts import TriangleGhosts
from limitsurf.options import Rules
from limitsurf.refine import refined
from limitsurf.surface import LimitSurface

Array = NDArray[Any]


class Phantoms:
    """Functions of one level with phantom points, as functions of a cage in parts.

    The unknowns are values at the vertices of the mesh, then those of phantom points.

    Attributes
    ----------
    mesh : Mesh
        Without ghosts.
    surface : LimitSurface
        Of the cage in parts.
    extraction : csr_array, (n_vertices, n)
        From unknowns to the vertices of `surface`.
    parent, level : (n_faces,) int
        Of faces of `surface`: the face of the cage they are in, -1 without a limit, and 0.
    own : (n_corners,) int
        Corners of `mesh` that those of faces with a limit of `surface` are.
    """

    def __init__(self, mesh: Mesh, sectors: Sectors) -> None:
        self.mesh, self.sectors = mesh, sectors
        self.ghosts = ghosts_of(mesh, sectors)
        limit = ~Rules.resolve(mesh).without_limit(mesh)
        bad = sectors.irregular[sectors.copy]
        self.natural = limit & (np.bincount(mesh.corner_face, bad, mesh.n_faces) > 0)
        self.free = limit & ~self.natural
        self._choose()

    @property
    def n(self) -> int:
        """Number of unknowns."""
        return self.mesh.n_vertices + self._count

    @property
    def trivial(self) -> bool:
        """Whether there are no phantom points."""
        return not self._count

    def _choose(self) -> None:
        """Number unknowns: which ghosts are free, and how they are told."""
        s, g, mesh = self.sectors, self.ghosts, self.mesh
        near = np.zeros(len(s.vertex), dtype=bool)
        near[s.copy[self.natural[mesh.corner_face]]] = True
        own = s.creased[s.vertex[g.corner]]
        here = np.stack([g.beyond, g.of_side[g.out, 0], g.of_side[g.into, 1]])
        while True:
            tied = np.zeros(g.count, dtype=bool)
            tied[g.of_side[near[g.start] | near[g.end]]] = True
            tied[g.beyond] = near[g.corner]
            whole = own & ~tied[here].any(axis=0)
            partly = own & ~whole & ~near[g.corner]
            if not partly.any():
                break
            near[g.corner[partly]] = True  # values there are of all ghosts around
        edge, last = np.flatnonzero(~tied[: len(g.base)]), np.flatnonzero(~tied[g.beyond] & ~own)
        creased, alone = s.creased[s.vertex[g.base[edge]]], s.size[g.base[edge]] == 1
        self.plain = np.concatenate([edge[~creased], g.beyond[last]])
        self.across = edge[creased & ~alone]
        self.pointed = np.flatnonzero(whole)
        self._along()
        self._count = sum(map(len, (self.plain, self.across, self.pointed, self.along)))

    def _along(self) -> None:
        """Which curves of creases and boundaries that end at free corners have phantom points."""
        g, mesh = self.ghosts, self.mesh
        side = np.stack([g.out, g.into], axis=1)
        edge = mesh.corner_edge[g.sides[side]]
        key = 2 * edge + (mesh.edges[edge][..., 0] == self.sectors.vertex[g.corner][:, None])
        found, place = np.unique(key[self.pointed], return_inverse=True)
        place = place.reshape(-1, 2)
        sides = np.bincount(mesh.corner_edge[self.sectors.sides], minlength=mesh.n_edges)
        good = np.bincount(place.ravel(), minlength=len(found)) == sides[found // 2]
        number = np.where(good, np.cumsum(good) - 1, -1)
        self.of_pointed = number[place]  # (pointed, 2): of the curves out of a corner and into it
        ends = np.stack([g.end[g.out], g.start[g.into]], axis=1)[self.pointed]
        self.next_on = self.sectors.vertex[ends]
        self.along = np.zeros(int(good.sum()), dtype=np.int64)  # one of (pointed, 2) for each
        there = self.of_pointed.ravel() >= 0
        self.along[self.of_pointed.ravel()[there]] = np.flatnonzero(there)

    @cached_property
    def _starts(self) -> Array:
        """Where unknowns of each kind begin."""
        sizes = [self.mesh.n_vertices, *map(len, (self.plain, self.across, self.pointed))]
        return np.cumsum(sizes)

    @cached_property
    def extended(self) -> Mesh:
        """The mesh cut along creases and with ghosts, of (n, 1) zeros."""
        return cut(self.mesh, self.sectors, self.ghosts)

    @cached_property
    def controls(self) -> Any:
        """From unknowns to the vertices of `extended`."""
        from scipy.sparse import diags_array, vstack

        s, g, n, m = self.sectors, self.ghosts, self.n, len(self.sectors.vertex)
        base, inner = g.base[self.across], g.inner[self.across]
        begin = self._starts
        phantom = rows_of(begin[1] + np.arange(len(base)), n)
        bend = phantom - 2 * rows_of(s.vertex[base], n) + rows_of(s.vertex[inner], n)
        copies = rows_of(s.vertex, n) - spread(base, m) @ bend / 6
        corner = g.corner[self.pointed]
        own = rows_of(begin[2] + np.arange(len(corner)), n)
        value = rows_of(s.vertex[corner], n)
        copies = copies + spread(corner, m) @ (own - value)
        ghosts = g.reflected(m) @ copies + spread(self.across, g.count) @ bend
        curve = [self._curved(k) for k in (0, 1)]
        at = [g.of_side[g.out[self.pointed], 0], g.of_side[g.into[self.pointed], 1]]
        for where, along in zip(at, curve, strict=True):
            ghosts = ghosts + spread(where, g.count) @ (6 * (value - own) - along)
        kept = np.ones(g.count)
        kept[self.plain] = kept[g.beyond[self.pointed]] = 0
        plain = rows_of(begin[0] + np.arange(len(self.plain)), n)
        ghosts = diags_array(kept) @ ghosts + spread(self.plain, g.count) @ plain
        found = vstack([copies, ghosts], format="csr")
        rest = 36 * value - self._sums(beyond=False) @ found
        found = found + spread(m + g.beyond[self.pointed], m + g.count) @ rest
        found.eliminate_zeros()
        return found.tocsr()

    def _curved(self, k: int) -> Any:
        """Second differences at the ends of curves out of free corners (0) or into them (1)."""
        from scipy.sparse import diags_array

        which, n = self.of_pointed[:, k], self.n
        there = (which >= 0).astype(float)
        phantom = rows_of(self._starts[3] + np.maximum(which, 0), n)
        value = rows_of(self.sectors.vertex[self.ghosts.corner[self.pointed]], n)
        return diags_array(there) @ (phantom - 2 * value + rows_of(self.next_on[:, k], n))

    def _sums(self, beyond: bool) -> Any:
        """36 times values at free corners, from the vertices of `extended`."""
        g, m = self.ghosts, len(self.sectors.vertex)
        here = self.pointed
        into, out = g.into[here], g.out[here]
        n = m + g.count
        parts = [
            (16, g.corner[here]),
            (4, m + g.of_side[into, 1]),
            (1, m + g.of_side[into, 0]),
            (4, m + g.of_side[out, 0]),
            (1, m + g.of_side[out, 1]),
            (4, g.end[out]),
            (4, g.start[into]),
            (1, g.across[here]),
        ]
        if beyond:
            parts.append((1, m + g.beyond[here]))
        found = sum(k * rows_of(x, n) for k, x in parts)
        return found.tocsr()

    @cached_property
    def reading(self) -> Any:
        """From the vertices of `extended` to unknowns, of functions that are of this space."""
        from scipy.sparse import diags_array, vstack

        s, g, m = self.sectors, self.ghosts, len(self.sectors.vertex)
        n = m + g.count
        nodes = np.flatnonzero(s.creased[s.vertex[g.base]] & (s.size[g.base] == 2))
        base = g.base[nodes]
        bend = rows_of(m + nodes, n) - 2 * rows_of(base, n) + rows_of(g.inner[nodes], n)
        count = self.mesh.n_vertices
        values = rows_of(np.arange(count), n)
        for where, rows in (
            (s.vertex[base], rows_of(base, n) + bend / 6),
            (s.vertex[g.corner[self.pointed]], self._sums(beyond=True) / 36),
        ):
            one, first = np.unique(where, return_index=True)
            kept = np.ones(count)
            kept[one] = 0
            values = diags_array(kept) @ values + spread(one, count) @ rows.tocsr()[first]
        values = values.tocsr()
        of = np.full(g.count, -1)
        of[nodes] = np.arange(len(nodes))
        across = bend.tocsr()[of[self.across]]
        across = across + 2 * values[s.vertex[g.base[self.across]]]
        across = across - values[s.vertex[g.inner[self.across]]]
        corner = g.corner[self.pointed]
        value = values[s.vertex[corner]]
        ends = []
        for k, node in ((0, g.of_side[g.out, 0]), (1, g.of_side[g.into, 1])):
            node = node[self.pointed]
            own = rows_of(corner, n)
            first_on = own + (rows_of(m + node, n) - 2 * own + rows_of(g.inner[node], n)) / 6
            ends.append(6 * (value - first_on) + 2 * value - values[self.next_on[:, k]])
        both = vstack(ends, format="csr")
        which, curve = np.divmod(self.along, 2)
        parts = [values, rows_of(m + self.plain, n), across, rows_of(corner, n)]
        parts.append(both[curve * len(self.pointed) + which])
        return vstack(parts, format="csr")

    @cached_property
    def _natural(self) -> Any:
        """Phantom points of functions without second derivatives across rims."""
        from scipy.sparse import vstack

        s, g, n = self.sectors, self.ghosts, self.mesh.n_vertices
        plain = (g.reflected(len(s.vertex)) @ rows_of(s.vertex, n))[self.plain]
        base, inner = (s.vertex[x[self.across]] for x in (g.base, g.inner))
        value = s.vertex[g.corner[self.pointed]]
        which = self.along // 2
        along = 2 * rows_of(value[which], n) - rows_of(self.next_on.ravel()[self.along], n)
        parts = [plain, 2 * rows_of(base, n) - rows_of(inner, n), rows_of(value, n), along]
        return vstack(parts, format="csr")

    def prolonged(self, values: Any) -> Any:
        """Unknowns from what is at the vertices of the mesh, sparse or not."""
        more = self._natural @ values
        if isinstance(values, np.ndarray):
            return np.concatenate([values, more])
        from scipy.sparse import vstack

        return vstack([values, more], format="csr")

    # ------------------------------------------------------------------ from level to level

    def next_from(self, finer: Phantoms, operator: Any) -> Any:
        """The matrix from unknowns to those of the space of one level more.

        The finer mesh tells by data of its faces which children they are of those of this one; the
        operator is from the vertices of the mesh to those of the finer one.
        """
        from scipy.sparse import diags_array, vstack

        fine, step = refined(self.extended, 1, operator=True)
        g, s, mesh = finer.ghosts, finer.sectors, finer.mesh
        child = mesh.face_data["child"]
        m = len(s.vertex)
        source = np.full(m + g.count, -1)
        from_corner = fine.offsets[child][mesh.corner_face]
        within = np.arange(mesh.n_corners) - mesh.offsets[mesh.corner_face]
        source[s.copy] = fine.indices[from_corner + within]
        if isinstance(g, TriangleGhosts):
            source[m:] = g.in_refined(fine, from_corner + within)
        else:
            self._sources(finer, fine, child, source)
        spoilt = self._spoilt(fine)
        good = (source >= 0) & ~spoilt[source]
        for vertices in g.beside:
            good[m : m + len(g.base)] &= good[vertices]
        good[m + g.beyond] &= good[g.corner]
        natural = operator @ rows_of(np.arange(self.mesh.n_vertices), self.n)
        copies = natural[s.vertex]
        natural_all = vstack([copies, g.reflected(m) @ copies], format="csr")
        own = (step @ self.controls)[np.maximum(source, 0)]
        keep = good.astype(float)
        found = diags_array(keep) @ own + diags_array(1 - keep) @ natural_all
        result = (finer.reading @ found).tocsr()
        fine_vertex = np.zeros(mesh.n_vertices, dtype=bool)
        fine_vertex[s.vertex[good[:m]]] = True
        weak = np.ones(finer.n)
        weak[: mesh.n_vertices] = fine_vertex
        stay = spread(np.arange(mesh.n_vertices), finer.n) @ natural
        result = diags_array(weak) @ result + diags_array(1 - weak) @ stay
        result.eliminate_zeros()
        return result.tocsr()

    def _sources(self, finer: Phantoms, fine: Mesh, child: Array, source: Array) -> None:
        """Which vertices of the refined extended mesh the ghosts of the finer one are."""
        g, own, mesh = finer.ghosts, self.ghosts, self.mesh
        m = len(finer.sectors.vertex)
        n, n_sides = mesh.n_corners, len(own.sides)
        of_side = np.full(n + 1, -1)
        of_side[own.sides] = np.arange(n_sides)
        face = finer.mesh.corner_face[g.sides]
        within = g.sides - finer.mesh.offsets[face]
        # children are as many as corners: their sides 0 and 3 are halves of those of their parent
        first = within == 0
        side = np.where(first, child[face], mesh.previous_corner[child[face]])
        ghost = of_side[np.where(first | (within == 3), side, n)]
        there = np.flatnonzero(ghost >= 0)
        # a ghost face begins at the end of its side, so that its child 1 is at the start
        which = n + 4 * ghost[there] + first[there]
        at = fine.indices[fine.offsets[which][:, None] + np.arange(4)]
        place = np.where(first[there][:, None], [1, 2], [2, 3])
        source[m + g.of_side[there]] = np.take_along_axis(at, place, axis=1)
        number = np.full(n_sides + 1, -1)
        number[own.out] = np.arange(len(own.corner))
        corners = np.where(first[g.out], number[ghost[g.out]], -1)
        there = np.flatnonzero(corners >= 0)
        which = n + 4 * (n_sides + corners[there])
        source[m + g.beyond[there]] = fine.indices[fine.offsets[which] + 2]

    def _spoilt(self, fine: Mesh) -> Array:
        """Vertices of the refined extended mesh that are not where their rims are irregular."""
        mesh, s = self.mesh, self.sectors
        start, end = s.copy[s.sides], s.copy[mesh.next_corner[s.sides]]
        found = np.zeros(fine.n_vertices, dtype=bool)
        at = fine.offsets[_children(mesh, s.sides)]  # the child at the start of each side
        found[fine.indices[at[s.irregular[start]]]] = True
        found[fine.indices[at[s.irregular[start] | s.irregular[end]] + 1]] = True
        last = fine.offsets[_children(mesh, mesh.next_corner[s.sides])]
        found[fine.indices[last[s.irregular[end]]]] = True
        return found

    # ------------------------------------------------------------------ as a cage in parts

    def build(self, parent: Array, engine: Any) -> None:
        """Make the surface, for which parents of the faces of the mesh are known."""
        from scipy.sparse import vstack

        extended, mesh = self.extended, self.mesh
        more = extended.n_faces - mesh.n_faces
        parts, rows, own = [], [], []
        for whole, elements, matrix in (
            (extended, np.concatenate([self.free, np.zeros(more, dtype=bool)]), self.controls),
            (mesh, self.natural, rows_of(np.arange(mesh.n_vertices), self.n)),
        ):
            if not elements.any():
                continue
            known = np.full(whole.n_faces, -1)
            known[: mesh.n_faces] = np.where(elements[: mesh.n_faces], parent, -1)
            tagged = whole.with_points(np.zeros((whole.n_vertices, 1))).with_tags(
                holes=np.flatnonzero(~elements),
                face_data={"parent": known, "own": np.arange(whole.n_faces)},
            )
            part, operator = trimmed(tagged, Rules.resolve(tagged))
            parts.append(part)
            rows.append(matrix if operator is None else operator @ matrix)
            old = part.face_data["own"]
            corner = np.where(old < mesh.n_faces, whole.offsets[old], -1)[part.corner_face]
            within = np.arange(part.n_corners) - part.offsets[part.corner_face]
            kept = elements[old][part.corner_face]
            own.append(np.where(kept, corner + within, -1))
        self.extraction = vstack(rows, format="csr")
        self.own = np.concatenate(own)
        self.parent = np.concatenate([part.face_data["parent"] for part in parts])
        self.level = np.zeros(len(self.parent), dtype=np.int64)
        points = self.extraction @ self.prolonged(mesh.points)
        self.surface = LimitSurface(joined(parts).with_points(points), engine=engine)

    def placed(self, corners: Array) -> Array:
        """Corners of the surface's mesh, from those of `mesh` that are of faces with a limit."""
        found = np.full(self.mesh.n_corners, -1)
        known = np.flatnonzero(self.own >= 0)
        found[self.own[known]] = known
        return np.asarray(found[corners])

    def places(self, refined_surface: LimitSurface) -> tuple[Array, Array, Array]:
        """Limit face of the surface, u and v of each vertex of the mesh of a face with a limit."""
        face, u, v = vertex_places(refined_surface)
        faces, before = self.surface.limit_faces, refined_surface.limit_faces
        of_mesh = before.face[face]
        of_surface = self.surface.mesh.corner_face[self.placed(self.mesh.offsets[of_mesh])]
        return faces.first[of_surface] + face - before.first[of_mesh], u, v


def _children(mesh: Mesh, corners: Array) -> Array:
    """The faces of a refined mesh at corners of the faces of another: the first are at these."""
    lattice = Rules.resolve(mesh).scheme.lattice
    more = len(lattice.children) - lattice.face_size
    return np.asarray(corners + more * mesh.corner_face[corners])
