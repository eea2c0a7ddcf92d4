"""Creases where the faces of a cage meet at an angle."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.mesh import Mesh


def creases_by_angle(
    mesh: Mesh, degrees: float, *, sharpness: float = math.inf
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Edges at which two faces turn by more than an angle, as creases for `Mesh.with_tags`.

    The normal of a face is that of its area, whether it is plane or not (Newell's). Faces without
    area and edges that are not of two faces make no creases; the latter are sharp by themselves.

    Parameters
    ----------
    mesh : Mesh
        Points of shape (n_vertices, 3), or (n_vertices, 2).
    degrees : float
        The angle between the normals, from 0 to 180.
    sharpness : float
        Of all these creases.

    Returns
    -------
    edges : (c, 2) int64
    sharpness : (c,) float64

    Raises
    ------
    ValueError
        For an angle outside [0, 180], a sharpness outside [0, inf], or points of another shape.

    Examples
    --------
    >>> import limitsurf as ls
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> cube = ls.Mesh([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], quads)
    >>> cube.with_tags(creases=ls.creases_by_angle(cube, 30))
    Mesh(8 vertices, 12 edges, 6 faces {4: 6}, interior valences {3: 8}, 12 creases)
    """
    if not 0 <= degrees <= 180:
        raise ValueError(f"degrees must be in [0, 180], got {degrees!r}")
    if not sharpness >= 0:
        raise ValueError(f"sharpness must be in [0, inf], got {sharpness!r}")
    if mesh.points.shape[1:] not in ((2,), (3,)):
        raise ValueError(f"got points of shape {mesh.points.shape}, need (n_vertices, 3)")
    points = np.zeros((mesh.n_vertices, 3))
    points[:, : mesh.points.shape[1]] = mesh.points.astype(np.float64)
    normals = _normals(mesh, points)
    corners = mesh.edge_corners
    inner = np.flatnonzero(corners[:, 1] >= 0)
    one, other = normals[mesh.corner_face[corners[inner]]].swapaxes(0, 1)
    sine = np.linalg.norm(np.cross(one, other), axis=1)
    cosine = np.einsum("ij,ij->i", one, other)
    wide = np.degrees(np.arctan2(sine, cosine)) > degrees
    edges = mesh.edges[inner[wide]]
    return edges, np.full(len(edges), float(sharpness))


def _normals(mesh: Mesh, points: NDArray[np.float64]) -> NDArray[Any]:
    """Unit normals of faces (n_faces, 3), 0 where there is none."""
    first = points[mesh.indices[mesh.offsets[:-1]]][mesh.corner_face]
    arms = points[mesh.indices] - first
    size = np.maximum.reduceat(np.abs(arms).max(axis=1), mesh.offsets[:-1])[mesh.corner_face]
    with np.errstate(invalid="ignore", divide="ignore"):  # faces in one point have no normal
        arms = np.nan_to_num(arms / size[:, None])
    areas = np.add.reduceat(np.cross(arms, arms[mesh.next_corner]), mesh.offsets[:-1], axis=0)
    length = np.linalg.norm(areas, axis=1, keepdims=True)
    return np.asarray(np.divide(areas, length, out=np.zeros_like(areas), where=length > 0))
