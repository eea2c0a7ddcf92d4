"""Faces that are still to be covered by patches, at one level of refinement."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.mesh import Mesh
from limitsurf.rules import Sharpness
from limitsurf.topology import MeshPart, corners_of

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Level:
    """Faces of a mesh that are still to be covered by patches.

    Attributes
    ----------
    sharpness : Sharpness
    numbers : (n_corners,) int
        The control point at each corner of the mesh.
    faces : (n,) int
    slot : (n,) int
        The place of each face in the codes; of the first limit face of an n-gon.
    turn : (n,) int
        At which corner of the domain of the limit face, or of the part of one, the first corner of
        the face lies.
    """

    sharpness: Sharpness
    numbers: Array
    faces: Array
    slot: Array
    turn: Array

    @property
    def mesh(self) -> Mesh:
        """The mesh of the faces."""
        return self.sharpness.mesh

    @property
    def points(self) -> Array:
        """The control points at the vertices, (n_vertices,) int32."""
        result = np.empty(self.mesh.n_vertices, dtype=np.int32)
        result[self.mesh.indices] = self.numbers
        return result

    def of_faces(self, which: Array) -> Level:
        """The level with some of the faces alone."""
        faces, slot, turn = self.faces[which], self.slot[which], self.turn[which]
        return replace(self, faces=faces, slot=slot, turn=turn)

    def part(self) -> Level:
        """The level on that part of the mesh on which patches and children of the faces depend."""
        wanted = np.zeros(self.mesh.n_corners, dtype=bool)
        wanted[corners_of(self.mesh, self.faces)[0]] = True
        near = MeshPart.of(self.mesh, self.sharpness.neighbours(wanted))
        sharpness, numbers = self.sharpness.part(near), self.numbers[near.corners]
        faces = np.searchsorted(near.faces, self.faces)
        return replace(self, sharpness=sharpness, numbers=numbers, faces=faces)
