"""Limits and tangents at places as rows over the vertices of a cage, or of a refined one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.mesh import Mesh
from limitsurf.refine import refined, tangent_rows
from limitsurf.surface import LimitSurface

if TYPE_CHECKING:
    from limitsurf.scheme.scheme import Scheme

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Level:
    """A cage after some refinements, by the rules that it is tagged with, and places on it.

    Attributes
    ----------
    surface : LimitSurface
    operator : csr_array or None
        From the vertices of the cage that was given; None for that cage itself.
    face, u, v : (m,)
        Places, on limit faces of this surface.
    """

    surface: LimitSurface
    operator: Any
    face: Array
    u: Array
    v: Array

    @property
    def mesh(self) -> Mesh:
        """The cage."""
        return self.surface.mesh

    def finer(self) -> Level:
        """The next level, of the same places."""
        found, step = self._step()
        return found if self.operator is None else replace(found, operator=step @ self.operator)

    def _step(self) -> tuple[Level, Any]:
        """The next level, with the operator from this one."""
        mesh, step = refined(self.mesh, 1, operator=True)
        return Level(LimitSurface(mesh), step, *self._children()), step

    def _children(self) -> tuple[Array, Array, Array]:
        """The places on limit faces of the refined cage."""
        mesh, faces, scheme = self.mesh, self.surface.limit_faces, self._scheme
        lattice = scheme.lattice
        each = mesh.sizes if lattice.face_points else np.full(mesh.n_faces, len(lattice.children))
        first = np.cumsum(each) - each
        owner, corner = faces.face[self.face], faces.corner[self.face]
        origin, inverse = child_maps(scheme)
        own = np.stack([self.u, self.v], axis=1)
        local = np.einsum("cij,qcj->qci", inverse, own[:, None] - origin)
        inside = np.minimum.reduce(
            [a + b * local[:, :, 0] + c * local[:, :, 1] for a, b, c in lattice.edges]
        )
        child = np.argmax(inside, axis=1)
        whole = corner < 0
        found = np.where(whole[:, None], local[np.arange(len(child)), child], own)
        child = np.where(whole, child, corner)
        return first[owner] + child, found[:, 0], found[:, 1]

    @property
    def _scheme(self) -> Scheme:
        return self.surface.topology.rules.scheme

    def chosen(self, which: Array) -> Level:
        """Some of the places."""
        return replace(self, face=self.face[which], u=self.u[which], v=self.v[which])

    def limits(self) -> Any:
        """Rows (m, n) onto the limits of the places; NaN where there is none."""
        return self.surface.weights(self.face, self.u, self.v)

    def tangents(self) -> tuple[Any, Array]:
        """Rows (2 m, n) onto two tangent vectors at each place, all first ones first.

        Each row has the sum 1 of moduli. Also whether a place has them, (m,) bool.
        """
        from scipy.sparse import csr_array, diags_array, vstack

        m, scheme = len(self.face), self._scheme
        at_vertex = np.zeros(m, dtype=bool)
        if not (scheme.local or scheme.lattice.dual):
            finer, step = self._step()
            corners = np.array(scheme.lattice.corners, dtype=float)
            here = (finer.u[:, None] == corners[:, 0]) & (finer.v[:, None] == corners[:, 1])
            at_vertex = here.any(axis=1)
        known = np.ones(m, dtype=bool)
        found = self.chosen(~at_vertex)
        rows = vstack(self.surface.weights(found.face, found.u, found.v, nu=[(1, 0), (0, 1)]))
        order = [np.flatnonzero(~at_vertex)]
        parts = [csr_array(rows)]
        if at_vertex.any():
            which = np.flatnonzero(at_vertex)
            corner = len(corners) * finer.face[which] + here[which].argmax(axis=1)
            of_finer, there = tangent_rows(finer.mesh, finer.surface.topology.rules, corner)
            parts.append((of_finer @ step).tocsr())
            order.append(which)
            known[which] = there
        place = np.concatenate([np.concatenate([x, m + x]) for x in order])
        both = vstack(parts, format="csr")[np.argsort(place)]
        size = np.asarray(abs(both).sum(axis=1)).ravel()
        good = np.isfinite(size) & (size > 0)
        known &= good[:m] & good[m:]
        both.data[~np.isfinite(both.data)] = 0
        return (diags_array(np.where(good, 1 / np.where(good, size, 1), 0)) @ both).tocsr(), known


def at_vertices(surface: LimitSurface) -> Level:
    """The places of all vertices, -1 and NaN of those without a limit."""
    cage = refined(surface.mesh, 0)
    return Level(surface, None, cage.parent_face, cage.parent_u, cage.parent_v)


@lru_cache(maxsize=32)
def child_maps(scheme: Scheme) -> tuple[Array, Array]:
    """Origins (c, 2) of the faces that a step makes of one, and matrices (c, 2, 2) into each.

    Of a place (u, v) on the face, ``inverse @ ((u, v) - origin)`` is that on its child.
    """
    corners = scheme.lattice.corners
    one = Mesh(np.zeros((len(corners), 1)), [list(range(len(corners)))], boundary="edge_only")
    fine = refined(one, 1, scheme=scheme)
    at = np.stack([fine.parent_u, fine.parent_v], axis=1)
    at = at[fine.indices.reshape(-1, len(corners))]
    maps = np.stack([at[:, 1] - at[:, 0], at[:, -1] - at[:, 0]], axis=2)
    return at[:, 0], np.linalg.inv(maps)
