"""Joining vertices of a cage that are at one place."""

from __future__ import annotations

import math
import warnings
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.checks import MeshError, users_level
from limitsurf.cage.faces import IntArray
from limitsurf.cage.mesh import CHOICES, Mesh, valid_mesh
from limitsurf.shell.io.losses import Losses
from limitsurf.shell.io.polygons import close, distinct, renumbered_holes, sound_faces

Merge: TypeAlias = bool | float | None


def merged(mesh: Mesh, tolerance: float = 0.0) -> Mesh:
    """A cage whose vertices at one place are one vertex.

    Many files repeat vertices, one for each face or along seams: there the cage falls apart, and
    its limit surface has a boundary at every such edge. Vertices of no face are joined like others.
    Channels stay as they are: seams of texture coordinates remain seams.

    Parameters
    ----------
    mesh : Mesh
    tolerance : float
        Vertices that are no farther apart are joined, and so are chains of them; the first keeps
        its place. 0 joins vertices with equal coordinates.

    Returns
    -------
    Mesh
        The mesh itself if no two vertices are that close. Of creases and corners that become one
        the largest sharpness remains. Corners of a face that become one are one corner.

    Raises
    ------
    ValueError
        A tolerance that is negative or no number; one above 0 with points that are not float64.
    MeshError
        If no face is left.
    MemoryError
        A tolerance by which too many pairs of vertices are close.

    Warns
    -----
    UserWarning
        Of faces that lose corners, and of those that are left out since fewer than three remain.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[0, 0], [1, 0], [1, 1], [0, 1], [1, 0], [2, 0], [2, 1], [1, 1]]
    >>> apart = ls.Mesh(points, [[0, 1, 2, 3], [4, 5, 6, 7]])
    >>> ls.merged(apart)
    Mesh(6 vertices, 7 edges, 2 faces {4: 2}, 6 boundary vertices)
    """
    losses = Losses("merged", strict=False)
    found = joined(mesh, tolerance, losses)
    losses.warn(2)
    return found


def checked(merge: Merge) -> float | None:
    """The tolerance that an argument `merge` asks for; None if nothing is to be joined."""
    if merge is None or (isinstance(merge, bool | np.bool_) and not merge):
        return None
    tolerance: Any = 0.0 if isinstance(merge, bool | np.bool_) else merge
    if not isinstance(tolerance, (int, float, np.integer, np.floating)) or not (
        0 <= tolerance < math.inf
    ):
        raise ValueError(f"merge: got {merge!r}, need True or a distance that is not negative")
    return float(tolerance)


def joined(mesh: Mesh, tolerance: float, losses: Losses) -> Mesh:
    """What `merged` returns, telling `losses` of faces that change."""
    tolerance = checked(tolerance) or 0.0
    if tolerance and mesh.points.dtype != np.float64:
        raise ValueError("a tolerance is for points of float64: round them first")
    flat = mesh.points.reshape(mesh.n_vertices, -1)
    first, number = close(flat, tolerance) if tolerance else distinct(flat)
    if len(first) == mesh.n_vertices:
        return mesh
    indices = number[mesh.indices]
    faces, kept = sound_faces(mesh.sizes, indices, losses)
    if not faces.any():
        raise MeshError(f"merge: within {tolerance:g} no face has 3 corners left that differ")
    sizes = np.bincount(mesh.corner_face[kept], minlength=mesh.n_faces)[faces]
    found = Mesh(mesh.points[first], (sizes, indices[kept]))
    edges, sharpness = mesh.creases
    edges = np.sort(number[edges], axis=1)
    there = found.edge_numbers(edges).clip(max=found.n_edges - 1)
    held = (found.edges[there] == edges).all(axis=1)
    creases = _largest(there[held], sharpness[held])
    return valid_mesh(
        Mesh,
        found.points,
        found.connectivity,
        creases=(found.edges[creases[0]], creases[1]),
        corners=_largest(number[mesh.corners[0]], mesh.corners[1]),
        holes=renumbered_holes(mesh.holes, faces),
        channels={n: (values, rows[kept], how) for n, (values, rows, how) in mesh.channels.items()},
        face_data={name: values[faces] for name, values in mesh.face_data.items()},
        **{name: getattr(mesh, name) for name in CHOICES},
    )


def _largest(keys: IntArray, values: NDArray[Any]) -> tuple[IntArray, NDArray[Any]]:
    """Keys, each once, and the largest of their values."""
    order = np.argsort(keys, kind="stable")
    found, start = np.unique(keys[order], return_index=True)
    return found, np.maximum.reduceat(values[order], start) if len(keys) else values


def apart(mesh: Mesh) -> int:
    """How many boundary edges lie on another one, end on end, with their faces on either side.

    Those of copies at one place have theirs on the same side, and are left alone. A hash of
    coordinates tells at once of most cages that there are none.
    """
    if mesh.points.dtype != np.float64 or mesh.points.ndim != 2:
        return 0
    bits = (mesh.points + 0.0).view(np.uint64)  # -0 is 0
    odd = np.random.default_rng(0).integers(2**63, size=bits.shape[1], dtype=np.uint64) * 2 + 1
    key = (bits * odd).sum(axis=1, dtype=np.uint64)
    ordered = np.sort(key)
    twice = ordered[1:][ordered[1:] == ordered[:-1]]
    if not len(twice):
        return 0
    corner = mesh.edge_corners[mesh.boundary_edge, 0]
    ends = np.stack([mesh.indices[corner], mesh.indices[mesh.next_corner[corner]]], axis=1)
    ends = ends[np.isin(key[ends], twice).all(axis=1)]
    if not len(ends):
        return 0
    _, place = distinct(mesh.points[ends.ravel()])
    start, end = place.reshape(-1, 2).T
    pairs = np.stack([np.minimum(start, end), np.maximum(start, end)], axis=1)
    _, number = np.unique(pairs, axis=0, return_inverse=True)
    number = number.reshape(-1)
    both = (np.bincount(number, start < end) > 0) & (np.bincount(number, start > end) > 0)
    return int(both[number].sum())


def warn_if_apart(name: str, mesh: Mesh) -> None:
    """Warn of edges that meet but are not joined."""
    number = apart(mesh)
    if number:
        total = int(mesh.boundary_edge.sum())
        text = f"{name}: {number} of {total} boundary edges lie on another one, with vertices of "
        text += "their own: join them by merge=True, or --merge 0"
        warnings.warn(text, stacklevel=users_level())
