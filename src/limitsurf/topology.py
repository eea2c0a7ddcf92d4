"""Meshes made from meshes, as integers: children, parts, and the numbering of limit faces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.mesh import Mesh

Array = NDArray[Any]


def child_faces(mesh: Mesh) -> Array:
    """Quads of the refined mesh by corner of `mesh`, (n_corners, 4); see `refined`."""
    V, E = mesh.n_vertices, mesh.n_edges
    edge = V + mesh.corner_edge
    return np.stack(
        [mesh.indices, edge, V + E + mesh.corner_face, edge[mesh.previous_corner]], axis=1
    )


def child_mesh(mesh: Mesh, points: Array) -> Mesh:
    """The refined mesh on given points, its twins known without sorting edges."""
    after, before, twin = mesh.next_corner, mesh.previous_corner, mesh.twin
    entering = twin[before]  # across the edge that ends at the corner
    # half-edges of child h: corner to midpoint, to face point, to midpoint before, to corner
    twins = np.stack(
        [
            np.where(twin < 0, -1, 4 * after[twin] + 3),
            4 * after + 2,
            4 * before + 1,
            np.where(entering < 0, -1, 4 * entering),
        ],
        axis=1,
    ).ravel()
    # no corner of a child is repeated, but the halves of an edge from a vertex to itself are alike
    loop = mesh.indices == mesh.indices[after]
    separate = np.zeros((mesh.n_corners, 4), dtype=bool)
    separate[:, 0], separate[:, 3] = loop, loop[before]
    sizes, indices = np.full(mesh.n_corners, 4), child_faces(mesh).ravel()
    connectivity = {"twin": twins, "separate": separate.ravel()}
    return Mesh._from_valid(points, sizes, indices, connectivity)


@dataclass(frozen=True, eq=False)
class MeshPart:
    """Some faces of a mesh as a mesh of their own, with what they were.

    Attributes
    ----------
    mesh : Mesh
        Its points are `vertices`.
    wanted : (n_corners of the whole,) bool
        The corners whose faces they are.
    faces, corners, vertices : int arrays, ascending
    """

    mesh: Mesh
    wanted: Array
    faces: Array
    corners: Array
    vertices: Array

    @classmethod
    def of(cls, mesh: Mesh, wanted: Array) -> MeshPart:
        """The faces that have one of the wanted corners (n_corners,) bool."""
        faces = np.logical_or.reduceat(wanted, mesh.offsets[:-1])
        corners = faces[mesh.corner_face]
        vertices, indices = np.unique(mesh.indices[corners], return_inverse=True)
        known = {"separate": mesh.separate[corners]}
        part = Mesh._from_valid(vertices, mesh.sizes[faces], indices, known)
        return cls(part, wanted, np.flatnonzero(faces), np.flatnonzero(corners), vertices)


def first_limit_face(mesh: Mesh) -> Array:
    """First limit face of each face and, last, their number, (n_faces + 1,)."""
    return np.concatenate([[0], np.cumsum(np.where(mesh.sizes == 4, 1, mesh.sizes))])


@dataclass(frozen=True)
class LimitFaces:
    """The limit faces of a mesh: one for a quad, n for an n-gon, in the order of its corners.

    Attributes
    ----------
    face : (n_limit_faces,) int
        Face of the mesh that each belongs to.
    corner : (n_limit_faces,) int
        Its corner of an n-gon; -1 for quads.
    first : (n_faces,) int
        First limit face of each face.
    """

    face: Array
    corner: Array
    first: Array

    @classmethod
    def of(cls, mesh: Mesh) -> LimitFaces:
        """Number the limit faces of `mesh`."""
        first = first_limit_face(mesh)
        face = np.repeat(np.arange(mesh.n_faces), np.diff(first))
        corner = np.where(mesh.sizes[face] == 4, -1, np.arange(len(face)) - first[face])
        return cls(face, corner, first[:-1])

    def __len__(self) -> int:
        return len(self.face)
