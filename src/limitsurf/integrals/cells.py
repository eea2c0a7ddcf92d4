"""Bezier cells of limit faces about a point in their midst, and ring after ring at corners."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.engine.packing import one_by_one
from limitsurf.patches import NO_LIMIT
from limitsurf.pieces.beyond import Beyond
from limitsurf.pieces.cells import cut
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_RINGS = 1000  # around a corner, at most


class Cells:
    """Cells of some limit faces, of float64 points.

    Attributes
    ----------
    scheme : Scheme
    origin : (3,)
        A point in the midst of the control points on which the limit faces depend.
    power : int
        Points are multiplied by 2 to this power, so that all are within about 1 of the origin.
    face : (C,) int64
        Limit faces of all cells but those at special corners.
    points : (C, n, 3)
        Bernstein coefficients, relative to the origin and scaled.
    cell_origin, size : (C, 2)
        Where cells lie, as in `BezierPatches`.
    beyond : Beyond
        What is at special corners, from ring 0 on, of the same points.
    corner_face : (R,) int64
        Limit faces of these.
    """

    def __init__(self, surface: LimitSurface, faces: Array, workers: int) -> None:
        topology, points = surface.topology, surface.points
        used = used_vertices(surface, faces)
        own = points[used]
        least, most = (
            f(axis=0, initial=0) if not len(own) else f(axis=0) for f in (own.min, own.max)
        )
        self.origin = least / 2 + most / 2
        half = (most / 2 - least / 2).max(initial=0)
        self.power = -int(np.frexp(half)[1]) if half else 0
        scaled = np.zeros(points.shape)
        # a power of two beyond what float64 has takes two steps
        first = int(np.clip(self.power, -1000, 1000))
        scaled[used] = np.ldexp(
            np.ldexp(own, first) - np.ldexp(self.origin, first), self.power - first
        )
        self.scheme = topology.rules.scheme
        depth = np.zeros(len(faces), dtype=np.int64)
        divided = one_by_one(workers)
        found = cut(topology.patches, self.scheme, scaled, faces, depth, False, divided)
        self.face, self.cell_origin, self.size = found.face, found.origin, found.size
        self.points = found.points.reshape(len(found), len(found.exponents), 3)
        self.beyond = Beyond(topology.patches, self.scheme, scaled, faces, depth)
        self.corner_face = found.rest.face


def used_vertices(surface: LimitSurface, faces: Array) -> Array:
    """Vertices of those limit faces that have a limit, and of the faces around these."""
    mesh, limit_faces = surface.mesh, surface.limit_faces
    known = faces[surface.patches.codes[faces] != NO_LIMIT]
    face = np.zeros(mesh.n_faces, dtype=bool)
    face[limit_faces.face[known]] = True
    vertex = np.zeros(mesh.n_vertices, dtype=bool)
    for _ in range(2):
        vertex[mesh.indices[face[mesh.corner_face]]] = True
        face[mesh.corner_face[vertex[mesh.indices]]] = True
    return np.flatnonzero(vertex)


def over_rings(
    beyond: Beyond, which: Array, visit: Callable[[Array, Array], Array], part: float
) -> None:
    """Visit the rings around some special corners, the outermost first.

    `visit` gets the numbers of corners (C,) and the Bernstein coefficients (C, k, n, 3) of the
    cells of a ring around each, and returns the sizes (C,) of what they add. The rings of a corner
    end with the first whose size is below a `part` of the largest.
    """
    most = np.zeros(len(which))
    for ring in range(_RINGS):
        if not len(which):
            break
        size = visit(which, beyond.cells(which, np.full(len(which), ring)).points)
        most = np.maximum(most, size)
        going = size > part * most
        which, most = which[going], most[going]
