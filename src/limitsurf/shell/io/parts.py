"""Meshes of a scene, each at one or many places, as one mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.checks import Channel, MeshError
from limitsurf.cage.connectivity import Connectivity
from limitsurf.cage.faces import IntArray
from limitsurf.cage.mesh import Mesh, valid_mesh
from limitsurf.shell.io.losses import Losses, joined_channels, listed

Array: TypeAlias = NDArray[Any]

OBJECT = "object"  # what the names of parts are called among the data of faces
LONGEST = 255  # letters of a name that each face keeps
MIXED = "mixed"  # the scheme of a mesh whose parts have several
# what holds where a part leaves a choice open
DEFAULTS = {
    "scheme": "catmull-clark",
    "boundary": "edge_and_corner",
    "triangles": "catmull-clark",
    "creasing": "uniform",
}


@dataclass(frozen=True)
class Part:
    """All copies of a mesh, each at its place, one after the other.

    Attributes
    ----------
    path : str
        What messages call it.
    mesh : Mesh
        With all choices of the part; points, faces, tags and channels are of one copy.
    points : (n V, 3) float64
    source : (n, H) int
        The corner of the mesh that each corner of a copy is: others where faces are turned around.
    """

    path: str
    mesh: Mesh
    points: NDArray[np.float64]
    source: IntArray

    @classmethod
    def of(cls, path: str, mesh: Mesh, is_left_handed: bool, matrices: Array) -> Part:
        """A mesh at some places, the matrices (n, 4, 4) of which its points are multiplied with.

        Faces of a mesh that is left-handed, or mirrored, are turned around and keep their first
        corner.

        Raises
        ------
        MeshError
            Points that are not finite in their places.
        """
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused
            turned = (np.linalg.slogdet(matrices[:, :3, :3])[0] < 0) != is_left_handed
            points = mesh.points
            if len(matrices) > 1:
                points = (points @ matrices[:, :3, :3] + matrices[:, 3:, :3]).reshape(-1, 3)
            elif (matrices[0] != np.eye(4)).any():
                points = points @ matrices[0, :3, :3] + matrices[0, 3, :3]
        broken = np.flatnonzero(~np.isfinite(points).all(axis=1))
        if len(broken):
            worst = points[broken[0]][~np.isfinite(points[broken[0]])][0]
            more = f"; {len(broken) - 1} more like it" if len(broken) > 1 else ""
            vertex = broken[0] % mesh.n_vertices
            raise MeshError(f"vertex {vertex}: coordinate {worst} is not finite in its place{more}")
        corner = np.arange(mesh.n_corners)
        source = np.broadcast_to(corner, (len(matrices), len(corner)))
        if turned.any():
            source = np.where(turned[:, None], reversed_corners(mesh.sizes), corner)
        return cls(path, mesh, points, source)

    @property
    def copies(self) -> int:
        """How many there are."""
        return len(self.source)

    @property
    def sizes(self) -> IntArray:
        """Of all faces."""
        return np.tile(self.mesh.sizes, self.copies)

    @property
    def indices(self) -> IntArray:
        """Vertices of all corners."""
        return self.shifted(self.mesh.indices[self.source], self.mesh.n_vertices)

    def shifted(self, numbers: IntArray, each: int) -> IntArray:
        """Numbers (n, ...) of vertices or faces of every copy, where one has so many of them."""
        shift = np.arange(self.copies).reshape(-1, *[1] * (numbers.ndim - 1))
        moved: IntArray = numbers + each * shift
        return moved.reshape(-1, *numbers.shape[2:])

    def tags(self) -> dict[str, Any]:
        """Creases, corners and holes of all copies."""

        def tiled(numbers: IntArray, each: int) -> IntArray:
            return self.shifted(np.broadcast_to(numbers, (self.copies, *numbers.shape)), each)

        mesh, n = self.mesh, self.mesh.n_vertices
        return {
            "creases": (tiled(mesh.creases[0], n), np.tile(mesh.creases[1], self.copies)),
            "corners": (tiled(mesh.corners[0], n), np.tile(mesh.corners[1], self.copies)),
            "holes": tiled(mesh.holes, mesh.n_faces),
        }

    def data(self, name: str, like: Array) -> Array:
        """Data of the faces of all copies; where it has none, "", 0 or NaN as others are."""
        own = self.mesh.face_data.get(name)
        shape = (self.mesh.n_faces, *like.shape[1:])
        if own is None or own.shape != shape or (own.dtype.kind == "U") != (like.dtype.kind == "U"):
            own = np.full(shape, np.nan if like.dtype.kind == "f" else like.dtype.type())
        return np.concatenate([own] * self.copies)

    def channels(self) -> dict[str, Channel]:
        """The channels of all copies, which share their values."""
        return {
            name: (values, rows[self.source].ravel(), mode)
            for name, (values, rows, mode) in self.mesh.channels.items()
        }


def merged(parts: Sequence[Part], losses: Losses, **others: Any) -> Mesh:
    """One mesh of all parts, in their order; `others` is what else ``Mesh`` takes.

    Choices that hold for a whole mesh are left open where parts differ, which is damage; but for
    the scheme, which is "mixed" then and makes no surface, so that nothing is lost.
    """
    first_vertex = [0, *accumulate(len(part.points) for part in parts)]
    first_face = [0, *accumulate(part.copies * part.mesh.n_faces for part in parts)]
    tags = [part.tags() for part in parts]

    def joined(name: str) -> tuple[IntArray, Array]:
        keys = [tag[name][0] + first for tag, first in zip(tags, first_vertex, strict=False)]
        return np.concatenate(keys), np.concatenate([tag[name][1] for tag in tags])

    holes = [tag["holes"] + first for tag, first in zip(tags, first_face, strict=False)]
    indices = [part.indices + first for part, first in zip(parts, first_vertex, strict=False)]
    points = np.concatenate([part.points for part in parts])
    sizes = np.concatenate([part.sizes for part in parts])
    return valid_mesh(
        Mesh,
        points,
        Connectivity(len(points), sizes, np.concatenate(indices)),
        creases=joined("creases"),
        corners=joined("corners"),
        holes=np.concatenate(holes),
        channels=joined_channels(
            [(part.path, part.sizes, part.channels()) for part in parts], losses
        ),
        face_data=_joined_data(parts),
        **{name: _agreed(name, parts, losses) for name in DEFAULTS},
        **others,
    )


def _joined_data(parts: Sequence[Part]) -> dict[str, Array]:
    """Data of the faces of all parts, in the form that they have in the first with such data."""
    likes: dict[str, Array] = {}
    for part in parts:
        likes = {**part.mesh.face_data, **likes}
    found = {
        name: np.concatenate([part.data(name, like) for part in parts])
        for name, like in likes.items()
    }
    if len(parts) > 1 and OBJECT not in found:
        counts = [part.copies * part.mesh.n_faces for part in parts]
        found[OBJECT] = np.repeat(_titles([part.path for part in parts]), counts)
    return found


def _titles(paths: Sequence[str]) -> Array:
    """The last names of paths, or whole paths where several have one; the end of long ones."""
    by_name: dict[str, set[str]] = {}
    for path in paths:
        by_name.setdefault(path.rpartition("/")[2], set()).add(path)
    names = (path.rpartition("/")[2] for path in paths)
    pairs = zip(names, paths, strict=True)
    return np.array([(n if len(by_name[n]) == 1 else path)[-LONGEST:] for n, path in pairs])


def _agreed(option: str, parts: Sequence[Part], losses: Losses) -> Any:
    """What parts have chosen, None if none has or they differ."""
    found: dict[Any, list[str]] = {}
    for part in parts:
        value = getattr(part.mesh, option) or DEFAULTS[option]
        found.setdefault(value, []).append(part.path)
    if len(found) > 1:
        each = ", ".join(f"{value!r} ({listed(paths)})" for value, paths in found.items())
        text = f"its meshes differ in {option}: {each}: choose one for all"
        if option == "scheme":
            losses.note(option, "", f'{text}, scheme="catmull-clark", or read a part, prim="PATH"')
            return MIXED
        text += f', such as {option}="{next(iter(found))}", or read a part, prim="PATH"'
        losses.add(option, "", text, f"{DEFAULTS[option]!r} unless chosen")
        return None
    (value,) = found
    return value if any(getattr(part.mesh, option) for part in parts) else None


def reversed_corners(sizes: IntArray) -> IntArray:
    """The order of corners that turns every face around and keeps its first corner."""
    offset, size = np.repeat([np.cumsum(sizes) - sizes, sizes], sizes, axis=1)
    position = np.arange(len(offset)) - offset
    order: IntArray = offset + -position % size
    return order
