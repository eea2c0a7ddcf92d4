"""Ghost triangles beyond the boundaries of a mesh of triangles.

Beyond a side from b to c of a triangle (b, c, i) is the ghost ``b + c - i``; beyond a sharp corner
c of one triangle (c, p, q) are ``2 c - p`` and ``2 c - q`` as well. Around boundary vertices of
three triangles, and such corners, six are together (``derivations/elements.py``, 1).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.mesh import Mesh
from limitsurf.fem.ghosts import rows_of
from limitsurf.fem.sectors import Sectors

Array = NDArray[Any]


class TriangleGhosts:
    """The ghost faces of a mesh of triangles; with the attributes of `ghosts.Ghosts`.

    Of each regular corner of one face `corner`, `out` and `into` have two entries, for each of the
    ghosts beyond it.

    Attributes
    ----------
    sides : (S,) int
        Half-edges beyond which there are ghosts.
    of_side : (S, 2) int
        The ghost beyond each, twice.
    base, inner : (S,) int
        Copies: of the vertex where a side starts, and the one across it.
    beside : list of (S,) int
        Copies on which rules for a ghost depend: both ends of its side.
    """

    def __init__(self, mesh: Mesh, sectors: Sectors) -> None:
        after, copy, size = mesh.next_corner, sectors.copy, sectors.size
        sides = sectors.sides
        sides = sides[(size[copy[sides]] > 0) | (size[copy[after[sides]]] > 0)]
        here = np.arange(len(sides))
        self.sides, self.start, self.end = sides, copy[sides], copy[after[sides]]
        leaving, arriving = np.full((2, len(sectors.vertex)), -1)
        leaving[self.start], arriving[self.end] = here, here
        self.of_side = np.stack([here, here], axis=1)
        self.base, self.inner = self.start, copy[mesh.previous_corner[sides]]
        self.beside = [self.start, self.end]
        self.corner = np.repeat(np.flatnonzero(size == 1), 2)
        self.out, self.into = leaving[self.corner], arriving[self.corner]
        self.beyond = len(sides) + np.arange(len(self.corner))
        self.across = self.end[self.out]
        self.count = len(sides) + len(self.corner)
        single = np.flatnonzero(size > 1)
        self._around = np.stack([leaving[single], arriving[single]])

    def faces(self, first: int) -> Array:
        """The vertices (n, 3) of ghost faces, of which ghosts are counted from a number on."""
        out, into = self._around
        fans = np.stack([self.start[out], first + into, first + out], axis=1)
        corner = self.corner[::2]
        out, into = self.out[::2], self.into[::2]
        one, other = first + self.beyond.reshape(-1, 2).T  # beyond p, and beyond q
        turns = [first + into, one, other, first + out]
        return np.concatenate(
            [
                np.stack([self.end, self.start, first + self.of_side[:, 0]], axis=1),
                fans,
                *(np.stack([corner, turns[k], turns[k + 1]], axis=1) for k in range(3)),
            ]
        )

    def reflected(self, n: int) -> Any:
        """Ghosts (G, n) as reflections of the copies, by which limits stay what they are."""
        from scipy.sparse import vstack

        edges = rows_of(self.start, n) + rows_of(self.end, n) - rows_of(self.inner, n)
        first = np.arange(len(self.corner)) % 2 == 0
        of = np.where(first, self.end[self.out], self.start[self.into])
        return vstack([edges, 2 * rows_of(self.corner, n) - rows_of(of, n)], format="csr")

    def in_refined(self, fine: Mesh, corners: Array) -> Array:
        """Vertices of a refined extended mesh that the ghosts are; -1 where it has none.

        `corners` are those of the refined mesh that corners of the mesh of these ghosts are.
        """

        def beyond(half: Array) -> Array:
            twin = np.where(half >= 0, fine.twin[half], -1)
            return np.asarray(twin)

        def vertex(half: Array) -> Array:
            return np.where(half >= 0, fine.indices[fine.previous_corner[half]], -1)

        def around(half: Array) -> Array:
            return np.where(half >= 0, fine.next_corner[half], -1)

        side = beyond(corners[self.sides])
        found = np.full(self.count, -1)
        found[: len(self.sides)] = vertex(side)
        last = beyond(around(side[self.out[::2]]))  # beyond the side that leaves a corner
        found[self.beyond[1::2]] = vertex(last)
        found[self.beyond[::2]] = vertex(beyond(around(last)))
        return found
