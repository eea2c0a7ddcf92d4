"""A part of a cage: some of its faces, with all that belongs to them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf.cage.checks import MeshError
from limitsurf.cage.connectivity import Connectivity
from limitsurf.cage.mesh import CHOICES, Mesh, valid_mesh

_LISTED = 8  # values that an error names


def selected(mesh: Mesh, faces: Mapping[str, Any] | ArrayLike) -> Mesh:
    """A cage of some faces of another, chosen by their numbers or by what they belong to.

    The part is a cage by itself: where it is cut off, it has a boundary, so there its limit surface
    differs from that of the whole. To keep that surface, evaluate the whole one on these faces.

    Parameters
    ----------
    mesh : Mesh
    faces : mapping {name: value or values}, (n_faces,) bool, or sequence of int
        Data of faces, such as ``{"group": "lid"}`` or ``{"material": ["steel", "brass"]}``: those
        that have one of the values; of several names, for each of them. Or which faces, or their
        numbers.

    Returns
    -------
    Mesh
        The faces in their order, the vertices that they have in theirs, and tags, channels and data
        of these.

    Raises
    ------
    ValueError
        Data that the cage has not, or a value that no face has.
    TypeError
        What is neither a mapping nor an array of integers or booleans.
    IndexError
        A number that is of no face, or a mask of another length.
    MeshError
        If there is no face left.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]]
    >>> data = {"group": ["left", "right"]}
    >>> mesh = ls.Mesh(points, [[0, 1, 4, 3], [1, 2, 5, 4]], face_data=data)
    >>> ls.selected(mesh, {"group": "right"}).points.tolist()
    [[1.0, 0.0], [2.0, 0.0], [1.0, 1.0], [2.0, 1.0]]
    """
    kept = _mask(mesh, faces)
    if not kept.any():
        raise MeshError("no face is selected")
    corners = kept[mesh.corner_face]
    indices = mesh.indices[corners]
    is_used = np.zeros(mesh.n_vertices, dtype=bool)
    is_used[indices] = True
    number = np.cumsum(is_used) - 1
    has_edge = np.zeros(mesh.n_edges, dtype=bool)
    has_edge[mesh.corner_edge[corners]] = True
    edges, sharpness = mesh.creases
    creased = has_edge[mesh.edge_numbers(edges)]
    vertices, of_vertices = mesh.corners
    channels = {}
    for name, (values, rows, how) in mesh.channels.items():
        found, place = np.unique(rows[corners], return_inverse=True)
        channels[name] = values[found], place.reshape(-1), how
    return valid_mesh(
        Mesh,
        mesh.points[is_used],
        Connectivity(int(is_used.sum()), mesh.sizes[kept], number[indices]),
        creases=(number[edges[creased]], sharpness[creased]),
        corners=(number[vertices[is_used[vertices]]], of_vertices[is_used[vertices]]),
        holes=(np.cumsum(kept) - 1)[mesh.holes[kept[mesh.holes]]],
        channels=channels,
        face_data={name: values[kept] for name, values in mesh.face_data.items()},
        **{name: getattr(mesh, name) for name in CHOICES},
    )


def _mask(mesh: Mesh, faces: Any) -> NDArray[np.bool_]:
    """Which faces are chosen (n_faces,)."""
    mask = np.ones(mesh.n_faces, dtype=bool)
    if isinstance(faces, Mapping):
        for name, wanted in faces.items():
            mask &= _with_values(mesh, name, wanted)
        return mask
    chosen = np.asarray(faces)
    if chosen.size == 0:
        return np.zeros(mesh.n_faces, dtype=bool)
    if chosen.dtype.kind not in "biu":
        need = "a mapping such as {'group': 'lid'}, a mask or numbers of faces"
        raise TypeError(f"faces: need {need}, got {type(faces).__name__} of {chosen.dtype}")
    if chosen.dtype.kind == "b":
        if chosen.shape != mask.shape:
            raise IndexError(f"faces: got a mask of shape {chosen.shape}, need {mask.shape}")
        return chosen
    wrong = chosen[(chosen < 0) | (chosen >= mesh.n_faces)]
    if wrong.size:
        raise IndexError(f"face {wrong.flat[0]} is out of range, need 0 to {mesh.n_faces - 1}")
    mask[:] = False
    mask[chosen] = True
    return mask


def _with_values(mesh: Mesh, name: str, wanted: Any) -> NDArray[np.bool_]:
    """Which faces have one of some values."""
    if name not in mesh.face_data:
        known = ", ".join(map(repr, mesh.face_data)) or "none"
        raise ValueError(f"there is no data of faces {name!r}: the cage has {known}")
    data = mesh.face_data[name]
    if data.ndim > 1:
        raise ValueError(f"data of faces {name!r} are rows of numbers: give a mask of faces")
    mask = np.zeros(mesh.n_faces, dtype=bool)
    values = [wanted] if isinstance(wanted, str) or np.ndim(wanted) == 0 else wanted
    for value in values:
        found = data == value if isinstance(value, str) == (data.dtype.kind == "U") else mask[:0]
        if not np.any(found):
            there = np.unique(data).tolist()
            known = ", ".join(map(repr, there[:_LISTED])) + (", ..." if there[_LISTED:] else "")
            raise ValueError(f"no face has {name} {value!r}: they have {known}")
        mask |= found
    return mask
