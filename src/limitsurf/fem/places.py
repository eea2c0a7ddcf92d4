"""Places on the surface of the vertices of its cage."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.surface import LimitSurface

Array = NDArray[Any]


def vertex_places(surface: LimitSurface, which: Array | None = None) -> tuple[Array, Array, Array]:
    """Limit face, u and v of each vertex of a face with a limit, in the order of vertices.

    Or of some of them, told by booleans (n_vertices,).
    """
    mesh, faces = surface.mesh, surface.limit_faces
    if surface.topology.lattice.dual:
        raise ValueError(
            f"vertices have no places on surfaces of scheme {surface.topology.rules.scheme.name!r}:"
            " use project"
        )
    limit = surface.patches.with_limit[faces.first]
    known = np.flatnonzero(limit[mesh.corner_face])
    found = np.full(mesh.n_vertices, -1)
    found[mesh.indices[known][::-1]] = known[::-1]
    return faces.along(found[(found >= 0) if which is None else (found >= 0) & which], 0.0)
