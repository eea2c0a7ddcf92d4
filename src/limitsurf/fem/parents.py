"""Faces and edges of a cage in the mesh of a space on it, which is refined and has ghost faces."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.selection import selected
from limitsurf.refine import refined

if TYPE_CHECKING:
    from limitsurf.cage.mesh import Mesh
    from limitsurf.surface import LimitSurface

Array = NDArray[Any]


class Refined(Protocol):
    """What is asked of a space."""

    cage: LimitSurface
    refined_surface: LimitSurface
    levels: int


def parent_faces(space: Refined) -> Array:
    """The face of the cage that each face of the space's mesh is in; -1 if without a limit.

    A ValueError for refined spaces of schemes whose finer faces are on several coarser ones.
    """
    scheme = space.refined_surface.topology.rules.scheme
    if scheme.lattice.dual and space.levels:
        raise ValueError(
            f"faces of a cage that is refined by scheme {scheme.name!r} are on several of those "
            "before: give one value for all, or a space with levels=0"
        )
    fine, faces = _followed(space, None)
    found = np.full(space.refined_surface.mesh.n_faces, -1)
    found[faces] = fine.face_data["parent"]
    return found


def traced_sides(space: Refined, edges: Array) -> Array:
    """Corners of the space's mesh that sides begin at, of edges (k, 2) of the cage."""
    space.cage.limit_faces.at_edge(edges)  # complains of what is no edge
    fine, faces = _followed(space, edges)
    corner = fine.edge_corners[fine.edge_numbers(fine.creases[0])][:, 0]
    of = fine.corner_face[corner]
    return space.refined_surface.mesh.offsets[faces[of]] + corner - fine.offsets[of]


def _followed(space: Refined, edges: Array | None) -> tuple[Mesh, Array]:
    """The refined faces of the cage that have a limit, and which of the space's mesh they are.

    Edges are followed as creases, faces by data that they carry.
    """
    cage, surface = space.cage, space.refined_surface
    whole, there = (x.patches.with_limit[x.limit_faces.first] for x in (cage, surface))
    mesh = cage.mesh.with_points(np.zeros((cage.mesh.n_vertices, 1)))
    tags: dict[str, Any] = {"creases": None, "corners": None, "holes": None, "channels": None}
    if edges is not None:
        tags["creases"] = edges, np.full(len(edges), np.inf)
    parents = {"parent": np.arange(mesh.n_faces)}
    mesh = mesh.with_tags(**tags, face_data=parents, **cage.rules)
    fine = refined(selected(mesh, whole), space.levels)
    return fine, np.flatnonzero(there)
