"""Ghost faces beyond the rims of a mesh that is cut along its sharp creases."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.mesh import CHOICES, Mesh
from limitsurf.fem.sectors import Sectors

Array = NDArray[Any]


def rows_of(numbers: Array, n: int, values: Any = 1.0) -> Any:
    """A matrix whose rows have one entry each."""
    from scipy.sparse import csr_array

    m = len(numbers)
    data = np.broadcast_to(np.asarray(values, dtype=float), m).copy()
    return csr_array((data, np.asarray(numbers), np.arange(m + 1)), shape=(m, n))


def spread(numbers: Array, n: int) -> Any:
    """A matrix (n, m) that puts rows where numbers say."""
    return rows_of(numbers, n).T.tocsr()


class Ghosts:
    """The ghost faces of a mesh that is cut: their vertices are behind the copies of those inside.

    Attributes
    ----------
    sides : (S,) int
        Half-edges beyond which there are ghost faces.
    of_side : (S, 2) int
        Ghosts beyond their start and end, counted from 0.
    base, inner : (G,) int
        Copies: of the vertex that a ghost is beyond, and the one across.
    beside : list of (G,) int
        Copies on which rules for a ghost depend.
    out, into : (K,) int
        Of each regular corner of one face: the side that starts there and the one that ends there,
        counted in `sides`. What is beyond them are the last K ghosts.
    """

    def __init__(self, mesh: Mesh, sectors: Sectors) -> None:
        after, before, copy = mesh.next_corner, mesh.previous_corner, sectors.copy
        size = sectors.size
        sides = sectors.sides
        sides = sides[(size[copy[sides]] > 0) | (size[copy[after[sides]]] > 0)]
        start, end = copy[sides], copy[after[sides]]
        here = np.arange(len(sides))
        leaving, arriving = np.full((2, len(sectors.vertex)), -1)
        leaving[start], arriving[end] = here, here
        last = leaving[end]
        alone = size[end] != 2
        last[alone] = len(sides) + np.arange(alone.sum())
        self.sides, self.start, self.end = sides, start, end
        self.of_side = np.stack([here, last], axis=1)
        self.base = np.concatenate([start, end[alone]])
        self.inner = np.concatenate([copy[before[sides]], copy[after[after[sides[alone]]]]])
        self.corner = np.flatnonzero(size == 1)
        self.out, self.into = leaving[self.corner], arriving[self.corner]
        self.count = len(self.base) + len(self.corner)
        self.beyond = len(self.base) + np.arange(len(self.corner))
        self.beside = [self.base]
        self.across = copy[after[after[sides[self.out]]]]  # of the face of such a corner

    def faces(self, first: int) -> Array:
        """The vertices (S + K, 4) of ghost faces, of which ghosts are counted from a number on."""
        one, other = (first + x for x in self.of_side.T)
        return np.concatenate(
            [
                np.stack([self.end, self.start, one, other], axis=1),
                np.stack(
                    [self.corner, other[self.into], first + self.beyond, one[self.out]], axis=1
                ),
            ]
        )

    def reflected(self, n: int) -> Any:
        """Ghosts (G, n) as reflections of the copies, by which limits stay what they are."""
        from scipy.sparse import vstack

        p, q = self.end[self.out], self.start[self.into]
        edges = 2 * rows_of(self.base, n) - rows_of(self.inner, n)
        last = (
            4 * rows_of(self.corner, n)
            - 2 * (rows_of(p, n) + rows_of(q, n))
            + rows_of(self.across, n)
        )
        return vstack([edges, last], format="csr")


def cut(mesh: Mesh, sectors: Sectors, ghosts: Any) -> Mesh:
    """The mesh cut into its sectors, with ghost faces, which are holes; of (n, 1) zeros."""
    n = len(sectors.vertex)
    edges, sharpness = mesh.creases
    corners = mesh.edge_corners[mesh.edge_numbers(edges)]
    kept = (corners >= 0).all(axis=1)
    kept &= ~(sectors.creased[edges].all(axis=1) & _parted(mesh, sectors, corners))
    ends = corners[kept][:, 0]
    pairs = np.stack([sectors.copy[ends], sectors.copy[mesh.next_corner[ends]]], axis=1)
    vertices, of_vertices = mesh.corners
    inside = ~np.isin(vertices, sectors.vertex[sectors.size > 0])
    beyond = ghosts.faces(n)
    return Mesh(
        np.zeros((n + ghosts.count, 1)),
        (
            np.concatenate([mesh.sizes, np.full(len(beyond), beyond.shape[1])]),
            np.concatenate([sectors.copy, beyond.ravel()]),
        ),
        creases=(pairs, sharpness[kept]),
        corners=(vertices[inside], of_vertices[inside]),
        holes=np.concatenate([mesh.holes, mesh.n_faces + np.arange(len(beyond))]),
        **{name: getattr(mesh, name) for name in CHOICES},
    )


def _parted(mesh: Mesh, sectors: Sectors, corners: Array) -> Array:
    """Whether edges (k, 2) have other copies of vertices on both sides."""
    copy, after = sectors.copy, mesh.next_corner
    ends = np.sort(np.stack([copy[corners], copy[after[corners]]], axis=2), axis=2)
    return np.asarray((ends[:, 0] != ends[:, 1]).any(axis=1))
