"""Places on the surface of the vertices of its cage."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.surface import LimitSurface

Array = NDArray[Any]


def vertex_places(surface: LimitSurface) -> tuple[Array, Array, Array]:
    """Limit face, u and v of each vertex of a face with a limit, in the order of vertices."""
    mesh, faces, lattice = surface.mesh, surface.limit_faces, surface.topology.lattice
    if lattice.dual:
        raise ValueError(
            f"vertices have no places on surfaces of scheme {surface.topology.rules.scheme.name!r}:"
            " use project"
        )
    corner = np.arange(mesh.n_corners)
    owner = mesh.corner_face
    within = corner - mesh.offsets[owner]
    whole = faces.corner[faces.first[owner]] < 0
    face = faces.first[owner] + np.where(whole, 0, within)
    place = np.array(lattice.corners, dtype=float)[np.where(whole, within, 0)]
    known = np.flatnonzero(surface.patches.with_limit[face])
    found = np.full(mesh.n_vertices, -1)
    found[mesh.indices[known][::-1]] = known[::-1]
    corner = found[found >= 0]
    return face[corner], place[corner, 0], place[corner, 1]
