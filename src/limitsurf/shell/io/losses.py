"""What files have that cannot be kept: cleaned tags, points and channels, and a word about it."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.checks import Channel, MeshError
from limitsurf.cage.faces import IntArray
from limitsurf.cage.mesh import Mesh, valid_mesh

Array: TypeAlias = NDArray[Any]
LISTED = 3  # places that a warning names, beside the first one


class LocatedError(MeshError):
    """A MeshError whose message begins with the file and the place in it."""


class Losses:
    """What is left out of a file or mended: an error at once if strict, else one warning a kind.

    Parameters
    ----------
    name : str
        That of the file.
    strict : bool

    Examples
    --------
    >>> from limitsurf.shell.io.losses import Losses
    >>> losses = Losses("cage.obj", strict=False)
    >>> for line in 7, 9:
    ...     losses.add("crease", f"line {line}", "the mesh has no such edge")
    >>> losses.messages()
    ['cage.obj, line 7: the mesh has no such edge: left out; 1 more like it: line 9']
    """

    def __init__(self, name: str, strict: bool) -> None:
        self.name, self.strict = name, strict
        self._found: dict[str, list[tuple[str, str]]] = {}

    def add(self, kind: str, where: str, message: str, done: str = "left out") -> None:
        """Note damage at a line or path, "" for the whole file; MeshError if strict.

        Of each kind the first message is said, with what was done, and where there are more.
        """
        if self.strict:
            raise LocatedError(_located(self.name, where, message))
        self.note(kind, where, f"{message}: {done}")

    def note(self, kind: str, where: str, message: str) -> None:
        """Note what is no damage, and never an error."""
        self._found.setdefault(kind, []).append((where, message))

    def left_out(self, what: Sequence[str]) -> None:
        """Note what the file has and a cage has no place for."""
        if what:
            self.note("left out", "", f"a cage has no place for all, left out: {', '.join(what)}")

    def messages(self) -> list[str]:
        """One for each kind, in the order in which they were found."""
        said = []
        for (where, message), *others in self._found.values():
            text = _located(self.name, where, message)
            if others:
                places = ", ".join(place for place, _ in others[:LISTED] if place)
                more = ", ..." if len(others) > LISTED else ""
                text += f"; {len(others)} more like it: {places}{more}"
            said.append(text)
        return said

    def warn(self, stacklevel: int) -> None:
        """Warn of all that was found; `stacklevel` is that of `warnings.warn`, seen from here."""
        for message in self.messages():
            warnings.warn(message, stacklevel=stacklevel + 1)


def _located(name: str, where: str, message: str) -> str:
    return f"{name}, {where}: {message}" if where else f"{name}: {message}"


def listed(names: Sequence[str]) -> str:
    """How many there are, and the first ones, such as "5: /a, /b, /c, ..."."""
    more = ", ..." if len(names) > LISTED else ""
    return f"{len(names)}: {', '.join(names[:LISTED])}{more}"


def finite_points(points: Array, indices: IntArray, lost: Callable[[IntArray, str], None]) -> Array:
    """Points (V, ...) of which those that no face uses are finite.

    Where they are not, they are put where the first vertex of the first face is: `lost` is told
    their numbers, and why, a text to follow the first of them. What faces use stays as it is.
    """
    if not np.issubdtype(points.dtype, np.floating) or not len(indices):
        return points
    broken = np.asarray(~np.isfinite(points).reshape(len(points), -1).all(axis=1))
    if broken.any() and 0 <= indices.min() <= indices.max() < len(points):
        broken[indices] = False
        number = np.flatnonzero(broken)
        if len(number):
            points = points.copy()
            points[number] = points[indices[0]]
            lost(number, " is not finite, but in no face")
    return points


def tagged(
    mesh: Mesh,
    lost: Callable[[str, IntArray, str], None],
    *,
    creases: tuple[Array, Array] | None = None,
    corners: tuple[Array, Array] | None = None,
    holes: Array | None = None,
    **others: Any,
) -> Mesh:
    """The mesh with those of the tags that are sound; of several for one thing, the last one.

    Parameters
    ----------
    mesh : Mesh
        Without tags.
    lost : callable
        Is told of the others: "crease", "corner" or "hole"; the edges (n, 2), vertices (n,) or
        faces (n,), as given; and what is wrong, a text to follow the name of the first of them.
    creases, corners : (edges (c, 2) or vertices (c,), sharpness (c,)), optional
    holes : (n,) int, optional
    **others
        What else ``Mesh`` takes, which must be right.
    """

    def kept(what: str, names: IntArray, sharpness: Array, wrong: Array, reason: str) -> IntArray:
        """Rows of what is neither wrong nor of no sharpness, the last ones of each name."""
        unsharp = ~(wrong | np.asarray(sharpness >= 0, dtype=bool))  # so is NaN
        if wrong.any():
            lost(what, names[wrong], reason)
        if unsharp.any():
            value = sharpness[unsharp][0]
            lost(what, names[unsharp], f": sharpness {value} is not in [0, inf]")
        rows = np.flatnonzero(~(wrong | unsharp))
        _, first = np.unique(names[rows][::-1], axis=0, return_index=True)
        return np.sort(rows[len(rows) - 1 - first])

    tags: dict[str, Any] = {}
    if creases is not None and len(creases[0]):
        edges, sharpness = np.sort(np.asarray(creases[0], np.int64), axis=1), np.asarray(creases[1])
        inside = (edges[:, 0] >= 0) & (edges[:, 1] < mesh.n_vertices)
        number = mesh.edge_numbers(np.where(inside[:, None], edges, 0)).clip(max=mesh.n_edges - 1)
        missing = ~inside | (mesh.edges[number] != edges).any(axis=1)
        rows = kept("crease", edges, sharpness, missing, ": the mesh has no such edge")
        tags["creases"] = edges[rows], sharpness[rows]
    if corners is not None and len(corners[0]):
        vertices, sharpness = np.asarray(corners[0], np.int64), np.asarray(corners[1])
        outside = (vertices < 0) | (vertices >= mesh.n_vertices)
        need = f" is out of range, need 0 to {mesh.n_vertices - 1}"
        rows = kept("corner", vertices, sharpness, outside, need)
        tags["corners"] = vertices[rows], sharpness[rows]
    if holes is not None and len(holes):
        faces = np.asarray(holes, np.int64)
        need = f" is out of range, need 0 to {mesh.n_faces - 1}"
        outside = (faces < 0) | (faces >= mesh.n_faces)
        tags["holes"] = faces[kept("hole", faces, np.zeros(len(faces)), outside, need)]
    return valid_mesh(Mesh, mesh.points, mesh.connectivity, **tags, **others)


def first_of(names: IntArray) -> tuple[str, str]:
    """The first of some edges, vertices or faces, and how many more there are, for a message.

    Examples
    --------
    >>> import numpy as np
    >>> from limitsurf.shell.io.losses import first_of
    >>> first_of(np.array([[0, 7], [1, 9]]))
    ('(0, 7)', '; 1 more like it')
    """
    first = names[0].tolist()
    more = f"; {len(names) - 1} more like it" if len(names) > 1 else ""
    return str(tuple(first) if isinstance(first, list) else first), more


def with_gaps(values: Array, rows: IntArray) -> tuple[Array, IntArray]:
    """Values (k, ...) of a channel and the rows of all corners, where -1 stands for no value.

    These take one more value, NaN, all of them the same.
    """
    if not (rows < 0).any():
        return values, rows
    nothing = np.full((1, *values.shape[1:]), np.nan)
    return np.concatenate([values, nothing]), np.where(rows < 0, len(values), rows)


def joined_channels(
    parts: Sequence[tuple[str, IntArray, Mapping[str, Channel]]], losses: Losses
) -> dict[str, Channel]:
    """The channels of several parts that become one mesh, in their order.

    What a part lacks is NaN there, at all its corners, which is noted. Where parts disagree about
    the numbers of a value, the majority of corners decides, and others lack it; about the
    interpolation likewise, and it holds for others too: that is damage.

    Parameters
    ----------
    parts : sequence of (where, sizes (n_faces,), channels)
        A line or path for messages, the sizes of the faces, and as ``Mesh.channels``.
    losses : Losses
    """
    names = dict.fromkeys(name for _, _, channels in parts for name in channels)
    joined = {}
    for name in names:
        shape = _majority(name, "numbers of a value", parts, lambda c: c[0].shape[1:], losses)
        mode = _majority(name, "interpolation", parts, lambda c: c[2], losses)
        values, rows, start = [], [], 0
        absent, lacking = 0, []
        for where, sizes, channels in parts:
            found = channels.get(name)
            n_corners = int(sizes.sum())
            if found is None or found[0].shape[1:] != shape:
                rows.append(np.full(n_corners, -1))
                absent += len(sizes)
                lacking.append(where)
                continue
            values.append(found[0])
            rows.append(found[1] + start)
            start += len(found[0])
        joined[name] = (*with_gaps(np.concatenate(values), np.concatenate(rows)), mode)
        if absent:
            total = sum(len(sizes) for _, sizes, _ in parts)
            text = f"channel {name!r}: {absent} of {total} faces have none, and are NaN there"
            losses.note(f"gaps {name}", "", f"{text} ({listed(lacking)})")
    return joined


def _majority(
    name: str,
    what: str,
    parts: Sequence[tuple[str, IntArray, Mapping[str, Channel]]],
    ask: Callable[[Channel], Any],
    losses: Losses,
) -> Any:
    """What is so for most corners, of the first parts if there are as many of others."""
    weight: dict[Any, int] = {}
    first: dict[Any, str] = {}
    for where, sizes, channels in parts:
        if name in channels:
            value = ask(channels[name])
            weight[value] = weight.get(value, 0) + int(sizes.sum())
            first.setdefault(value, where)
    chosen = max(weight, key=lambda value: weight[value])
    for value in weight:
        if value != chosen:
            losses.add(
                f"{what} of {name}",
                first[value],
                f"channel {name!r}: {what}: got {value!r}, but {chosen!r} in {first[chosen]}",
                "left out" if what != "interpolation" else f"{chosen!r} holds for all",
            )
    return chosen
