"""Rings of faces around semi-sharp vertices, each refined by itself until nothing is sharp.

A refined point at a vertex depends on the ring of faces around it alone, and so do all of the
refined ring. Where these faces close up around a vertex, refinement leaves their number and order
as they are: only the sharpness of the vertex and of its edges falls. So rings of equal size are
refined together, without the meshes in between. Sums are those of the refinement of whole meshes
by kernels, in the same order: results are equal to the last digit.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from limitsurf import _kernels, numbers, tables
from limitsurf.refine.stages import rounded_masks
from limitsurf.rules import PENDING, Rules, Sectors

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Rings:
    """The n rings around some semi-sharp vertices, of N faces each, at a level of refinement.

    Attributes
    ----------
    rules : Rules
    fans : (n,) int
        Which of the `Sectors` they are.
    vertices : (n, 1 + 2 N) int
        Those of the mesh: the vertex, then counter-clockwise its neighbours e_j and the corners c_j
        beyond, face j being v, e_j, c_j, e_(j + 1).
    first : (n, N) int
        Which corner of its face the vertex is.
    faces : (n, N) int
        The faces in the order of the mesh.
    ends : (2, n, N) int
        The edges at the vertex in the order of `Sharpness.ends`, here and in all refinements.
    edges : (n, N)
        The sharpness of the edges at the vertex; finite.
    own : (n,)
        That of the vertex; finite.
    """

    rules: Rules
    fans: Array
    vertices: Array
    first: Array
    faces: Array
    ends: Array
    edges: Array
    own: Array

    @classmethod
    def of(cls, sectors: Sectors, rules: Rules, wanted: Array) -> Iterator[Self]:
        """Those of the `wanted` fans that are to be refined in this way, by number of faces."""
        sharpness, mesh, fans = sectors.sharpness, sectors.mesh, sectors.fans
        fit = sharpness.exact is None and not sharpness.number.exact and not sharpness.far
        if not (fit and rules.scheme.lattice.face_points) or mesh.connectivity.repeats:
            return
        sizes, own = fans.sizes[wanted], sharpness.vertices[fans.vertex[wanted]]
        alone = mesh.vertex_faces[fans.vertex[wanted]] == sizes
        fit = (sectors.kind[wanted] == PENDING) & fans.closed[wanted] & alone
        some = wanted[fit & (sizes <= tables.MOST_FACES) & ~tables.is_infinite(own)]
        if not len(some) or not _kernels.compiled(int(fans.sizes[some].sum()), 100):
            return
        sizes = fans.sizes[some]
        for N in np.unique(sizes).tolist():
            here = some[sizes == N]
            vertices = sectors.ring("interior", N, here)
            ascending = np.sort(vertices, axis=1)
            here = here[(ascending[:, 1:] != ascending[:, :-1]).all(axis=1)]
            if len(here):
                yield cls._of_size(sectors, rules, here, N)

    @classmethod
    def _of_size(cls, sectors: Sectors, rules: Rules, fans: Array, N: int) -> Self:
        """Those of closed fans of N faces."""
        sharpness, mesh = sectors.sharpness, sectors.mesh
        corners = sectors.fans.corners[sectors.fans.offsets[fans][:, None] + np.arange(N)]
        before = np.roll(corners, 1, axis=1)
        # edges that begin at the vertex come before others, in the mesh and in what it becomes
        edge, S = sharpness.edge_at(corners), len(sharpness.edge_sharpness)
        turned = np.stack([corners > mesh.twin[corners], corners > before])
        return cls(
            rules,
            fans,
            sectors.ring("interior", N, fans),
            corners - mesh.connectivity.first(mesh.corner_face[corners]),
            np.argsort(corners, axis=1),
            np.argsort(edge + S * turned, axis=2, kind="stable"),
            sharpness.half_edges[corners],
            sharpness.vertices[sectors.fans.vertex[fans]],
        )

    def limits(self, points: Array) -> Array:
        """Limits (n, d) of their vertices, from the points of the mesh."""
        from limitsurf._kernels import refinement

        N, scheme = self.edges.shape[1], self.rules.scheme
        _, centre, vertices, across = rounded_masks(self.rules, (4,), N, (N,))
        _, (half,), (_, beside) = tables.rule_weights(scheme, numbers.FLOAT64)
        limit = tables.limit_mask(scheme, "interior", N, numbers.FLOAT64)
        weights = centre, vertices[N], np.array([across[1], half, beside]), limit
        around = self.vertices, self.first, self.faces, self.ends
        sharp = self.edges.copy(), self.own.copy()
        d = points.shape[1]
        result, room = np.empty((len(self.own), d)), np.empty((2, 1 + 2 * N, d))
        refinement.ring_limits(np.ascontiguousarray(points), *around, *sharp, weights, room, result)
        return result

    def rows(self, masks: Array) -> Array:
        """Weights (m, n, 1 + 2 N) of the rings in what `masks` (m, 1 + 2 N) give in the limit.

        Where all that is sharp in the mesh is so by whole numbers.
        """
        from limitsurf._kernels import refinement

        n, N = self.edges.shape
        number = numbers.FLOAT64
        edge, half, (own, along) = tables.rule_weights(self.rules.scheme, number)
        weights = (
            tables.corner_weights(self.rules.scheme, np.array([4]), number),
            tables.vertex_weights(self.rules.scheme, np.array([N]), number)[0],
            np.array([own / 2 + own / 2, along]),
            np.array([*edge, *half]),
        )
        beside = 1 + 2 * np.argsort(self.vertices[:, 1::2], axis=1)
        later = np.concatenate([np.zeros((n, 1), np.int64), beside, 2 + 2 * self.faces], axis=1)
        order = np.stack([np.argsort(self.vertices, axis=1), later])
        around = self.first, np.argsort(self.faces, axis=1), self.faces, self.ends
        room = np.empty(1 + 3 * N), np.empty((2, 1 + 3 * N), np.int64)
        result = np.empty((len(masks), n, 1 + 2 * N))
        given = np.ascontiguousarray(masks), order, *around, self.edges, self.own, weights
        refinement.ring_rows(*given, *room, result)
        return result
