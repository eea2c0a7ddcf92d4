"""Cages side by side, as the parts of one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.mesh import CHOICES, Mesh

Array = NDArray[Any]


def joined(meshes: list[Mesh]) -> Mesh:
    """Cages as the parts of one, without data of faces."""
    vertices, faces = (
        np.cumsum([0, *(getattr(mesh, name) for mesh in meshes[:-1])])
        for name in ("n_vertices", "n_faces")
    )

    def shifted(arrays: list[Array], by: Array) -> Array:
        return np.concatenate([x + n for x, n in zip(arrays, by, strict=True)])

    def rows(arrays: list[Array]) -> Array:
        return np.concatenate(arrays)

    creases, corners = [mesh.creases for mesh in meshes], [mesh.corners for mesh in meshes]
    return Mesh(
        rows([mesh.points for mesh in meshes]),
        (rows([mesh.sizes for mesh in meshes]), shifted([m.indices for m in meshes], vertices)),
        creases=(shifted([x[0] for x in creases], vertices), rows([x[1] for x in creases])),
        corners=(shifted([x[0] for x in corners], vertices), rows([x[1] for x in corners])),
        holes=shifted([mesh.holes for mesh in meshes], faces),
        **{name: getattr(meshes[0], name) for name in CHOICES},
    )
