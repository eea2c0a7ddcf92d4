"""What answers depend on besides the points: patches, tables and their packed form, made once.

Surfaces of one cage with different points share one `Topology`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import _kernels, numbers, tables
from limitsurf.caching import cached_property
from limitsurf.cage.mesh import Mesh
from limitsurf.engine.groups import Groups
from limitsurf.engine.monomials import holding
from limitsurf.engine.packing import Packing
from limitsurf.patches import PatchTable, patch_table
from limitsurf.rules import Rules, Sharpness
from limitsurf.topology import LimitFaces

Array = NDArray[Any]


class Topology:
    """A cage and its rules, whatever its points.

    Parameters
    ----------
    mesh : Mesh
    rules : Rules
    choice : str
        Who does what depends on the mesh: "auto", "reference" or "compiled".
    patches : PatchTable, optional
        Those of the cage, if they are known.

    Attributes
    ----------
    mesh : Mesh
        The cage with points of no channels.
    lattice : Lattice
    limit_faces : LimitFaces
    patches : PatchTable
    groups : Groups
        Queries by kind of patch, in float64.
    """

    def __init__(
        self, mesh: Mesh, rules: Rules, choice: str, patches: PatchTable | None = None
    ) -> None:
        self.rules, self.lattice, self.choice = rules, rules.scheme.lattice, choice
        self.limit_faces = LimitFaces.of(mesh, self.lattice)
        if patches is None:
            with _kernels.chosen(choice):
                patches = patch_table(mesh, rules, numbers.FLOAT64)
        self.patches = patches
        self.mesh = mesh.with_points(np.zeros((mesh.n_vertices, 0)))
        self.groups = Groups(self.patches, rules.scheme, numbers.FLOAT64)

    def prepare(self) -> None:
        """Refuse masks that do not converge."""
        self.groups.kinds  # noqa: B018

    @property
    def with_limit(self) -> Array:
        """Which limit faces have a limit, (n_limit_faces,) bool."""
        return self.patches.with_limit

    @cached_property
    def exact_groups(self) -> Groups:
        """Queries by kind of patch, in Fractions."""
        patches = self.patches.typed(self.mesh, self.rules, numbers.RATIONAL)
        return Groups(patches, self.rules.scheme, numbers.RATIONAL)

    @cached_property
    def own_vertices(self) -> Array:
        """A vertex of the cage at each limit face."""
        return self.mesh.indices[self.mesh.offsets[self.limit_faces.face]]

    @cached_property
    def shape(self) -> str | None:
        """Which compiled kernels there are for the patches, if any."""
        return _kernels.shape(holding(self.rules.scheme.spline).directions)

    @property
    def packing(self) -> Packing:
        """Patches and tables as compiled kernels want them."""
        found: Packing | None = self.__dict__.get("_packing")
        if found is None:
            with _kernels.preparing:
                found = self.__dict__.get("_packing")
                if found is None:
                    _kernels.load()
                    groups = self.groups
                    given = self.rules.scheme, groups.tables, *groups.strips, self.own_vertices
                    self.__dict__["_packing"] = found = Packing(self.patches, *given)
        return found

    @cached_property
    def sharp_sides(self) -> Array:
        """Whether the sides of limit faces, each from a corner to the next, stay sharp, (n, sides).

        Where faces depend on their own corners alone, all do.
        Of a quad those at v = 0, u = 1, v = 1, u = 0, of a triangle at v = 0, u + v = 1, u = 0.
        """
        mesh, faces, size = self.mesh, self.limit_faces, self.lattice.face_size
        if self.rules.scheme.local:
            return np.ones((len(faces), size), dtype=bool)
        sharpness = Sharpness.of(mesh, self.rules, numbers.FLOAT64)
        sharp = np.zeros(mesh.n_corners, dtype=bool)
        sharp[sharpness.sides] = tables.is_infinite(sharpness.edge_sharpness)[sharpness.edge]
        whole = faces.corner < 0
        first = mesh.offsets[faces.face] + np.where(whole, 0, faces.corner)
        sides = np.zeros((len(faces), size), dtype=bool)
        sides[whole] = sharp[first[whole, None] + np.arange(size)]
        # only those at the corner are on edges of an n-gon
        sides[~whole, 0] = sharp[first[~whole]]
        sides[~whole, -1] = sharp[mesh.previous_corner[first[~whole]]]
        return sides

    @cached_property
    def sharp_corners(self) -> Array:
        """Whether the corners of limit faces are at `sharp_sides`, even of others, (n, corners)."""
        mesh, faces, size = self.mesh, self.limit_faces, self.lattice.face_size
        result = self.sharp_sides | np.roll(self.sharp_sides, 1, axis=1)
        # vertices of the cage: all corners of a whole face, the first of another limit face
        first = mesh.offsets[faces.face] + np.maximum(faces.corner, 0)
        own = (faces.corner < 0)[:, None] | (np.arange(size) == 0)
        vertex = mesh.indices[(first[:, None] + np.arange(size) * (faces.corner < 0)[:, None])[own]]
        touched = np.zeros(mesh.n_vertices, dtype=bool)
        touched[vertex[result[own]]] = True
        result[own] |= touched[vertex]
        return result
