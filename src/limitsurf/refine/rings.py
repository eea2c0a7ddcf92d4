"""Rings of faces around semi-sharp vertices, each refined by itself until nothing is sharp.

A refined point at a vertex depends on the ring of faces around it alone, and so do all of the
refined ring. Where these faces close up around a vertex, refinement leaves their number and order
as they are: only the sharpness of the vertex and of its edges falls. So rings of equal size are
refined together, without the meshes in between.
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
    """The n rings around some semi-sharp vertices, of N faces each.

    Attributes
    ----------
    rules : Rules
    fans : (n,) int
        Which of the `Sectors` they are.
    vertices : (n, 1 + 2 N) int
        Those of the mesh: the vertex, then counter-clockwise its neighbours e_j and the corners c_j
        beyond, face j being v, e_j, c_j, e_(j + 1).
    edges : (n, N)
        The sharpness of the edges at the vertex; finite.
    own : (n,)
        That of the vertex; finite.
    """

    rules: Rules
    fans: Array
    vertices: Array
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
        for N in np.flatnonzero(np.bincount(sizes)).tolist():
            here = some[sizes == N]
            corners = fans.corners[fans.offsets[here][:, None] + np.arange(N)]
            edges, own = sharpness.half_edges[corners], sharpness.vertices[fans.vertex[here]]
            yield cls(rules, here, sectors.ring("interior", N, here), edges, own)

    def rows(self, masks: Array) -> Array:
        """Weights (m, n, 1 + 2 N) of the rings in what `masks` (m, 1 + 2 N) give in the limit."""
        from limitsurf._kernels import refinement

        (n, N), scheme = self.edges.shape, self.rules.scheme
        _, centre, vertices, across = rounded_masks(self.rules, (4,), N, (N,))
        _, half, crease = tables.rule_weights(scheme, numbers.FLOAT64)
        weights = np.concatenate([centre[:1], vertices[N], across[1:], half, crease[1:]])
        result, room = np.empty((len(masks), n, 1 + 2 * N)), np.empty((2, 1 + 2 * N))
        given = np.ascontiguousarray(masks), self.edges, self.own
        refinement.ring_rows(*given, weights, room, result)
        return result
