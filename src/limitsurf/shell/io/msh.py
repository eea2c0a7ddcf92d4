"""Cages from Gmsh's own files, ``.msh``, of versions 2.2 and 4.1, as text and binary."""

from __future__ import annotations

import re
from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.checks import MeshError
from limitsurf.cage.mesh import Mesh
from limitsurf.shell.io.losses import Losses
from limitsurf.shell.io.polygons import IntArray, mesh_of
from limitsurf.shell.io.statements import Statements

# of each type of element the number of its nodes, and what it is
_TYPES = {
    1: (2, "lines"), 2: (3, ""), 3: (4, ""), 4: (4, "tetrahedra"), 5: (8, "hexahedra"),
    6: (6, "prisms"), 7: (5, "pyramids"), 8: (3, "lines"), 9: (6, ""), 10: (9, ""),
    11: (10, "tetrahedra"), 12: (27, "hexahedra"), 13: (18, "prisms"), 14: (14, "pyramids"),
    15: (1, "points"), 16: (8, ""), 17: (20, "hexahedra"), 18: (15, "prisms"),
    19: (13, "pyramids"), 20: (9, ""), 21: (10, ""), 26: (4, "lines"), 27: (5, "lines"),
    28: (6, "lines"), 29: (20, "tetrahedra"), 36: (16, ""), 92: (64, "hexahedra"),
}  # fmt: skip
_CORNERS = {2: 3, 3: 4, 9: 3, 10: 4, 16: 4, 20: 3, 21: 3, 36: 4}  # of elements that are faces
_VOLUMES = {"tetrahedra", "hexahedra", "prisms", "pyramids"}
GROUP = "group"
_HEAD = re.compile(
    rb"\s*(?:\$Comments.*?\$EndComments\s*)?\$MeshFormat\s+(\S+)\s+(\d)\s+(\d+)[^\n]*\n(.{4})",
    re.DOTALL,
)


def parse(name: str, data: bytes, *, strict: bool = False) -> Mesh:
    """The cage of the triangles and quadrilaterals of a file; its name is for messages."""
    losses = Losses(name, strict)
    version, binary, order = _format(name, data)
    sections = _Sections(name, data, binary, order)
    groups: dict[int, int] | None = None
    try:
        if version == "2.2":
            tags, points = _nodes_2(sections)
            elements = _elements_2(sections)
        else:
            groups = _entities(sections)
            tags, points = _nodes_4(sections)
            elements = _elements_4(sections)
    except (ValueError, IndexError, KeyError, OverflowError) as error:
        if isinstance(error, MeshError):
            raise
        reason = f"{type(error).__name__}: {error}"[:200]
        raise MeshError(f"{name}: truncated or broken: {reason}") from None
    return _mesh(name, losses, tags, points, elements, groups, sections.names())


def _format(name: str, data: bytes) -> tuple[str, bool, str]:
    """The version of a file, whether it is binary, and in which order bytes are."""
    head = _HEAD.match(data)
    if head is None:
        raise MeshError(
            f"{name}: need $MeshFormat at the start: this is no .msh file of Gmsh 2 to 4"
        )
    version, binary = head[1].decode("latin-1"), head[2] == b"1"
    if version not in ("2.2", "4.1") or (binary and version == "4.1" and head[3] != b"8"):
        text = f"{name}: got version {version} of .msh, need 2.2 or 4.1: open it in Gmsh, and save"
        raise MeshError(f"{text} it with Mesh.MshFileVersion = 4.1, or by gmsh -save")
    order = "<" if not binary or int.from_bytes(head[4], "little") == 1 else ">"
    return version, binary, order


class _Sections:
    """The parts of a file between ``$Name`` and ``$EndName``, as streams of numbers."""

    def __init__(self, name: str, data: bytes, binary: bool, order: str) -> None:
        self.name, self.data, self.binary, self.order = name, data, binary, order
        self.at, self.values = 0, np.zeros(0)

    def content(self, title: str, needed: bool = True) -> bytes:
        """The bytes of a section."""
        start = self.data.find(b"$" + title.encode())
        end = self.data.find(b"$End" + title.encode(), start)
        if start < 0 or end < 0:
            if not needed:
                return b""
            what = f"${title}" if start < 0 else f"$End{title}: the file is truncated"
            raise MeshError(f"{self.name}: need {what}")
        return self.data[self.data.index(b"\n", start) + 1 : end]

    def open(self, title: str, needed: bool = True) -> bool:
        """Begin with a section; whether it is there."""
        self.at, found = 0, self.content(title, needed)
        if self.binary:
            self.bytes = found
        else:
            self.values = np.array(found.split(), dtype=np.float64)
        return bool(found)

    def take(self, count: int, kind: str) -> NDArray[Any]:
        """The next numbers, of a kind that a binary file has them in: "i4", "u8" or "f8"."""
        if self.binary:
            size = np.dtype(kind).itemsize
            if not 0 <= count <= (len(self.bytes) - self.at) // size:
                raise ValueError(f"a section ends before {count} numbers more")
            found = np.frombuffer(self.bytes, self.order + kind, count, self.at)
            self.at += count * size
        else:
            if not 0 <= count <= len(self.values) - self.at:
                raise ValueError(f"a section ends before {count} numbers more")
            found = self.values[self.at : self.at + count]
            self.at += count
        return found.astype(np.float64 if kind == "f8" else np.int64)

    def line(self) -> int:
        """The number that stands on a line of its own, as text in a binary file too."""
        if not self.binary:
            return int(self.take(1, "i4")[0])
        end = self.bytes.index(b"\n", self.at)
        number, self.at = int(self.bytes[self.at : end]), end + 1
        return number

    def names(self) -> dict[int, str]:
        """The names of groups of faces, by their numbers."""
        text = self.content("PhysicalNames", needed=False).decode(errors="replace")
        found = re.findall(r'(?m)^\s*2\s+(\d+)\s+"(.*)"', text)
        return {int(number): title for number, title in found}


# numbers (n, k) of nodes by the type of element, and (n,) of the group or the entity of each
_Elements = list[tuple[int, IntArray, IntArray]]


def _nodes_2(file: _Sections) -> tuple[IntArray, NDArray[np.float64]]:
    file.open("Nodes")
    count = file.line()
    if not file.binary:
        rows = file.take(4 * count, "f8").reshape(-1, 4)
        return rows[:, 0].astype(np.int64), rows[:, 1:]
    kind = np.dtype([("tag", file.order + "i4"), ("x", file.order + "f8", 3)])
    nodes = np.frombuffer(file.bytes, kind, count, file.at)
    return nodes["tag"].astype(np.int64), nodes["x"].astype(np.float64)


def _elements_2(file: _Sections) -> _Elements:
    found: _Elements = []
    if file.binary:
        file.open("Elements")
        left = file.line()
        while left > 0:
            kind, count, n_tags = file.take(3, "i4").tolist()
            width = 1 + n_tags + _TYPES[kind][0]
            rows = file.take(count * width, "i4").reshape(count, width)
            found.append((kind, rows[:, 1 + n_tags :], rows[:, 1] if n_tags else 0 * rows[:, 0]))
            left -= max(count, 1)
        return found
    lines = Statements(file.name, file.content("Elements"))
    statements = np.arange(1, len(lines.n_words))  # but for their number
    if len(statements) and lines.n_words[1:].min() < 4:
        raise ValueError("an element of fewer than four numbers")
    words = lines.numbers(np.arange(lines.first[-1])).astype(np.int64)
    first, length = lines.first[statements], lines.n_words[statements]
    kinds, n_tags = words[first + 1], words[first + 2]
    forms, at = np.unique(np.stack([kinds, n_tags, length], 1), axis=0, return_index=True)
    for kind, tags, width in forms[np.argsort(at)].tolist():
        if 3 + tags + _TYPES[kind][0] != width:
            raise ValueError(f"an element of type {kind} and {tags} tags has {width} numbers")
        some = first[(kinds == kind) & (n_tags == tags) & (length == width)]
        nodes = words[some[:, None] + 3 + tags + np.arange(_TYPES[kind][0])]
        found.append((kind, nodes, words[some + 3] if tags else 0 * some))
    return found


def _entities(file: _Sections) -> dict[int, int]:
    """The first group of each surface that has one."""
    groups: dict[int, int] = {}
    if not file.open("Entities", needed=False):
        return groups
    counts = file.take(4, "u8").tolist()
    for dimension, count in enumerate(counts):
        for _ in range(count):
            tag = int(file.take(1, "i4")[0])
            file.take(6 if dimension else 3, "f8")
            physical = file.take(int(file.take(1, "u8")[0]), "i4")
            if dimension == 2 and len(physical):
                groups[tag] = abs(int(physical[0]))
            if dimension:
                file.take(int(file.take(1, "u8")[0]), "i4")
    return groups


def _nodes_4(file: _Sections) -> tuple[IntArray, NDArray[np.float64]]:
    file.open("Nodes")
    tags, points = [np.zeros(0, np.int64)], [np.zeros((0, 3))]
    for _ in range(int(file.take(4, "u8")[0])):
        dimension, _, parametric = file.take(3, "i4").tolist()
        count = int(file.take(1, "u8")[0])
        width = 3 + (dimension if parametric else 0)
        tags.append(file.take(count, "u8"))
        points.append(file.take(count * width, "f8").reshape(count, width)[:, :3])
    return np.concatenate(tags), np.concatenate(points)


def _elements_4(file: _Sections) -> _Elements:
    file.open("Elements")
    found: _Elements = []
    for _ in range(int(file.take(4, "u8")[0])):
        _, entity, kind = file.take(3, "i4").tolist()
        count, width = int(file.take(1, "u8")[0]), 1 + _TYPES[kind][0]
        rows = file.take(count * width, "u8").reshape(count, width)
        found.append((kind, rows[:, 1:], np.full(count, entity)))
    return found


def _mesh(
    name: str,
    losses: Losses,
    tags: IntArray,
    points: NDArray[np.float64],
    elements: _Elements,
    groups: dict[int, int] | None,
    titles: dict[int, str],
) -> Mesh:
    """The faces among elements, and what of all else is told."""
    others = Counter({what: 0 for _, what in _TYPES.values() if what})
    for kind, nodes, _ in elements:
        others[_TYPES[kind][1]] += len(nodes)
    faces = [(kind, nodes[:, : _CORNERS[kind]], x) for kind, nodes, x in elements
             if kind in _CORNERS]  # fmt: skip
    said = [f"{what} ({n})" for what, n in others.items() if what and n]
    if not faces:
        besides = f"; it has {', '.join(said)}" if said else ""
        volume = any(others[what] for what in _VOLUMES)
        how = ": save the faces of its surface, by a physical group of them" if volume else ""
        raise MeshError(f"{name}: need triangles or quadrilaterals, found none{besides}{how}")
    curved = sum(len(nodes) for kind, nodes, _ in faces if kind not in (2, 3))
    losses.left_out(said + [f"nodes between corners ({curved} faces)"] * bool(curved))
    corners = np.concatenate([nodes.ravel() for _, nodes, _ in faces])
    order = np.argsort(tags, kind="stable")
    place = np.searchsorted(tags[order], corners).clip(max=max(len(tags) - 1, 0))
    if not len(tags) or (tags[order][place] != corners).any():
        wrong = corners[tags[order][place] != corners] if len(tags) else corners
        raise MeshError(f"{name}: a face has node {wrong[0]}, which is not among its nodes")
    used, indices = np.unique(order[place], return_inverse=True)
    sizes = np.concatenate([np.full(len(nodes), nodes.shape[1]) for _, nodes, _ in faces])
    numbers = np.concatenate([x for *_, x in faces])
    if groups is not None:  # by way of entities
        known, which = np.unique(numbers, return_inverse=True)
        numbers = np.array([groups.get(tag, 0) for tag in known.tolist()])[which.reshape(-1)]
    data = {}
    if numbers.any():
        known, which = np.unique(np.abs(numbers), return_inverse=True)
        texts = [titles.get(n, str(n) if n else "") for n in known.tolist()]
        data[GROUP] = np.array(texts)[which.reshape(-1)]
    mesh = mesh_of(points[used], sizes, indices.reshape(-1), losses, face_data=data)
    losses.warn(3)
    return mesh
