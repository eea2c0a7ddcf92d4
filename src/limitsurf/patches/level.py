"""Faces that are still to be covered by patches, at one level of refinement."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.mesh import Mesh
from limitsurf.numbers import NumberType
from limitsurf.patches.points import Rows, rows_of
from limitsurf.refine import stage_rows
from limitsurf.rules import Rules, Sharpness
from limitsurf.scheme.lattice import Lattice
from limitsurf.topology import (
    MeshPart,
    child_mesh,
    children_of,
    corners_of,
)

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

    @classmethod
    def first(cls, cage: Mesh, rules: Rules, number: NumberType, limit_faces: Array) -> Level:
        """All faces of a cage that have limits, from their first limit faces on."""
        faces = np.flatnonzero(~rules.without_limit(cage))
        sharpness, turn = Sharpness.of(cage, rules, number), np.zeros(len(faces), dtype=np.int8)
        return cls(sharpness, cage.indices, faces, limit_faces[faces], turn)

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

    def rows(self, rules: Rules, n_points: int) -> list[Rows]:
        """The control points that refinement makes, in turn, from number `n_points` on."""
        # points of the mesh, then its face points, then its vertex and edge points, all numbered
        sharpness = self.sharpness
        face_points, stage = stage_rows(self.mesh, rules, sharpness, sharpness.number)
        F, others = face_points.shape[0], stage.shape[0] - face_points.shape[0]
        own = self.points
        points = np.concatenate([own, n_points + np.arange(F, dtype=np.int32)])
        return [rows_of(face_points, own), rows_of(stage, points, others)]

    def refined(self, lattice: Lattice, n_points: int, n_codes: int) -> Level:
        """The children of the faces on the refined mesh, whose `rows` begin at `n_points`.

        Those of faces of the lattice become parts of splits, whose codes begin at `n_codes`; the
        limit faces of other polygons go straight to their children.
        """
        mesh, F = self.mesh, self.mesh.n_faces * lattice.face_points
        others = mesh.n_vertices + mesh.n_edges
        new = n_points + np.concatenate([F + np.arange(others), np.arange(F)])
        children = child_mesh(mesh, np.arange(len(new)), lattice)
        child, corner, middle = _children(mesh, self.faces, lattice)
        count, size = len(lattice.children), lattice.face_size
        sizes = mesh.sizes[self.faces]
        each = sizes + count - size
        whole = np.repeat(sizes == size, each)
        before = np.repeat(self.turn, each)
        turn = np.where(middle, before, (before + corner) % size)
        part = np.array(lattice.parts)[np.where(middle, corner, turn)]
        # only the first level has other polygons: there their slot is the first limit face
        slot = np.repeat(self.slot, each) + corner
        splits = np.arange((sizes == size).sum())
        slot[whole] = n_codes + np.repeat(count * splits, count) + part[whole]
        turn = np.where(whole, turn, 0).astype(np.int8)
        inner = self.sharpness.children(children, lattice)
        return Level(inner, new[children.indices], child, slot, turn)


def _children(mesh: Mesh, faces: Array, lattice: Lattice) -> tuple[Array, Array, Array | bool]:
    """Children of faces in the refined mesh, which of each they are, whether in the middle."""
    if lattice.face_points:
        return *corners_of(mesh, faces), False
    count = len(lattice.children)
    corner = np.tile(np.arange(count), len(faces))
    middle = corner >= lattice.face_size
    return children_of(mesh, faces, lattice), corner, middle
