"""Files that are lists of polygons and no more: PLY, OFF.

VTK reads PLY in single precision, and stops the process where a file is truncated; trimesh cuts
the polygons of PLY and OFF into triangles; plyfile (GPL) cannot be asked of all who use this
library. So they are read here.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from limitsurf.mesh import Mesh, MeshError
from limitsurf.shell.obj import Statements
from limitsurf.shell.polygons import IntArray, mesh_of

if TYPE_CHECKING:
    from limitsurf.query import Polygons

# --- PLY

# names of number types, old and new
_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2"},
    **{"int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8"},
    **{"float32": "f4", "float64": "f8"},
}
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}
_FACES = ("vertex_indices", "vertex_index")
_BLOCK = 1 << 16  # bytes, or words of text, where rows of an element are sought at a time
_TEXTURE = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))


def parse_ply(name: str, data: bytes, *, strict: bool = False) -> Mesh:
    """The cage of a PLY file; texture coordinates of its vertices are the channel "uv"."""
    with np.errstate(invalid="ignore"):  # NaN is refused below
        values = _Ply(name, data).values
    found = [names for names in _TEXTURE if all(("vertex", n) in values for n in names)]
    for n in "xyz":
        if ("vertex", n) not in values:
            raise MeshError(f"{name}: need elements 'vertex' with the properties x, y, z")
    lists = [values["face", n] for n in _FACES if ("face", n) in values]
    if not lists or not isinstance(lists[0], tuple):
        raise MeshError(f"{name}: need elements 'face' with a list, the property vertex_indices")
    points = np.stack([values["vertex", n] for n in "xyz"], axis=1)
    uv = np.stack([values["vertex", n] for n in found[0]], axis=1) if found else None
    sizes, indices = lists[0]
    return mesh_of(points, sizes, indices, uv, merge=uv is not None)


class _Ply:
    """The elements of a PLY file by name and property.

    Attributes
    ----------
    values : {(element, property): (n,) or (sizes (n,), values (k,))}
        Numbers, float64 or int64, and lists of them.
    """

    def __init__(self, name: str, data: bytes) -> None:
        self.name = name
        self.values: dict[tuple[str, str], Any] = {}
        end = re.search(rb"^end_header[ \t]*\r?\n", data, re.MULTILINE)
        if not re.match(rb"ply[ \t]*\r?\n", data):
            self.fail("need 'ply' on the first line, this is no PLY file")
        if end is None:
            self.fail("need a header that ends with 'end_header'")
        elements = self._header(data[: end.start()].decode("latin-1"))
        self._body = data[end.end() :]
        self._at = 0
        if not self.order:
            try:
                self._numbers = np.array(self._body.split(), dtype=np.float64)
            except ValueError as error:
                self.fail(f"after the header: {error}")
        for element, count, properties in elements:
            self._read(element, count, properties)

    def fail(self, message: str) -> NoReturn:
        raise MeshError(f"{self.name}: {message}")

    def _header(self, header: str) -> list[tuple[str, int, list[tuple[str, ...]]]]:
        """Name, number and properties, (type, name) or (count type, type, name), of elements."""
        elements: list[tuple[str, int, list[tuple[str, ...]]]] = []
        order = None
        for number, line in enumerate(header.splitlines()[1:], 2):
            match line.split():
                case ["format", str(kind), "1.0"] if kind in _ORDERS:
                    order = _ORDERS[kind]
                case ["element", str(name), str(count)] if re.fullmatch(r"\d{1,15}", count):
                    elements.append((name, int(count), []))
                case ["property", str(kind), str(name)] if kind in _TYPES and elements:
                    elements[-1][2].append((_TYPES[kind], name))
                case ["property", "list", str(size), str(kind), str(name)] if (
                    _TYPES.get(size, "f")[0] in "iu" and kind in _TYPES and elements
                ):
                    elements[-1][2].append((_TYPES[size], _TYPES[kind], name))
                case [] | ["comment" | "obj_info", *_]:
                    pass
                case _:
                    need = "format, element, property or comment"
                    self.fail(f"line {number}: got {line[:60]!r}, need {need}")
        if order is None:
            self.fail(f"need one of the formats {', '.join(_ORDERS)} 1.0")
        self.order = order
        return elements

    def _take(self, kind: str, at: IntArray) -> NDArray[Any]:
        """The numbers of a type at some places: bytes, or words of text."""
        if not self.order:
            return self._numbers[at]
        dtype = np.dtype(self.order + kind)
        body, length = self._body, max(len(self._body) - dtype.itemsize + 1, 0)
        return np.ndarray((length,), dtype, body, strides=(1,))[at]

    def _read(self, element: str, count: int, properties: list[tuple[str, ...]]) -> None:
        """All rows of an element, which may have lists of any length."""
        end = len(self._body) if self.order else len(self._numbers)
        width = {kind: np.dtype(kind).itemsize if self.order else 1 for kind in _TYPES.values()}

        def ends(start: IntArray) -> IntArray:
            """Where rows end that start at some places; -1 where they are not whole."""
            at = start.copy()
            for kind, *rest in properties:
                whole = (at >= 0) & (at + width[kind] <= end)
                at[~whole] = -1
                if len(rest) == 2:
                    number = self._take(kind, at[whole])
                    number = np.where((number >= 0) & (number <= end), number, end + 1)
                    at[whole] += number.astype(np.int64) * width[rest[0]]
                at[whole] += width[kind]
            at[at > end] = -1
            return at

        start, length = np.full(min(count, 1), self._at), 0
        if count and properties:
            length = int(ends(start)[0]) - self._at
        if length > 0 and count * length <= end - self._at:
            start = self._at + length * np.arange(count)  # as if all had the lists of the first
        if (properties and len(start) < count <= end - self._at) or (
            ends(start) != start + length
        ).any():
            start = self._rows(ends, count, end)
        last = ends(start[-1:])
        if properties and (len(start) < count or (last < 0).any()):
            self.fail(f"the file ends amid its {count} elements {element!r}: it is truncated")
        at = start
        for kind, *rest in properties:
            number = self._take(kind, at)
            at = at + width[kind]
            if len(rest) == 1:
                self.values[element, rest[0]] = number.astype(np.float64)
                continue
            size = number.astype(np.int64)
            place = np.arange(size.sum()) - np.repeat(np.cumsum(size) - size, size)
            listed = self._take(rest[0], np.repeat(at, size) + place * width[rest[0]])
            whole = (listed == np.rint(listed)) & (np.abs(listed) < 2.0**62)
            listed = np.where(whole, listed, -1)
            self.values[element, rest[1]] = size, listed.astype(np.int64)
            at = at + size * width[rest[0]]
        if len(start):
            self._at = int(last[0])

    def _rows(self, ends: Any, count: int, end: int) -> IntArray:
        """The starts of rows of different lengths, or of those that are whole.

        A row may start at any place of a block: they are found by doubling, one block at a time.
        """
        found, at = [np.zeros(0, dtype=np.int64)], self._at
        while count and 0 <= at < end:
            length = min(_BLOCK, end - at)
            after = ends(at + np.arange(length)) - at  # of the row at each place
            after = np.append(np.where((after < 0) | (after > length), length, after), length)
            start = np.zeros(1, dtype=np.int64)
            while len(start) < count and start[-1] < length:
                start = np.concatenate([start, after[start]])
                after = after[after]
            start = at + start[start < length][:count]
            found.append(start)
            count -= len(start)
            at = int(ends(start[-1:])[0])
        return np.concatenate(found)


def ply(shape: Polygons) -> Iterator[bytes]:
    """The bytes of a PLY file, of polygons that have one normal and one "uv" per point."""
    columns = [("x", "<f8"), ("y", "<f8"), ("z", "<f8")]
    values = [shape.points]
    if len(shape.normals):
        columns += [("nx", "<f4"), ("ny", "<f4"), ("nz", "<f4")]
        values.append(shape.normals)
    if "uv" in shape.channels:
        columns += [("s", "<f8"), ("t", "<f8")]
        values.append(shape.channels["uv"][0])
    rows = np.empty(len(shape.points), dtype=columns)
    for (column, _), numbers in zip(columns, np.concatenate(values, axis=1).T, strict=True):
        rows[column] = numbers
    names = {"<f8": "double", "<f4": "float"}
    count, width = ("uchar", 1) if shape.sizes.max() < 256 else ("int", 4)
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(rows)}",
        *(f"property {names[kind]} {column}" for column, kind in columns),
        f"element face {len(shape.sizes)}",
        f"property list {count} int vertex_indices",
        "end_header\n",
    ]
    # of each face its size, then its vertices
    data = np.empty(width * len(shape.sizes) + 4 * len(shape.indices), dtype=np.uint8)
    is_size = np.zeros(len(data), dtype=bool)
    start = 4 * shape.offsets[:-1] + width * np.arange(len(shape.sizes))
    is_size[start[:, None] + np.arange(width)] = True
    data[is_size] = shape.sizes.astype(f"<i{width}" if width > 1 else "u1").view(np.uint8)
    data[~is_size] = shape.indices.astype("<i4").view(np.uint8)
    yield "\n".join(lines).encode()
    yield rows.tobytes()
    yield data.tobytes()


# --- OFF


def parse_off(name: str, data: bytes, *, strict: bool = False) -> Mesh:
    """The cage of an OFF file; colours and whatever else follows coordinates are ignored."""
    file = Statements(name, data)
    if not len(file.n_words) or not re.fullmatch(r"(ST)?C?N?OFF", file.words(0)[0]):
        raise MeshError(f"{name}: need 'OFF' on the first line, in text: this is no such file")
    # the numbers of vertices, faces and edges may be on the first line
    joined = file.n_words[0] > 1
    head = 0 if joined else 1
    if len(file.n_words) <= head or file.n_words[head] - joined < 2:
        raise MeshError(f"{name}: need the numbers of vertices and faces after 'OFF'")
    words = file.first[head] + joined + np.arange(2)
    counts = file.numbers(words, "the numbers of vertices and faces", integers=True)
    n_vertices, n_faces = counts.ravel().tolist()
    if min(n_vertices, n_faces) < 0 or head + 1 + n_vertices + n_faces > len(file.n_words):
        raise MeshError(
            f"{name}: need {n_vertices} lines of vertices and {n_faces} of faces, got "
            f"{len(file.n_words) - head - 1}: the file is truncated"
        )
    vertices = head + 1 + np.arange(n_vertices)
    faces = head + 1 + n_vertices + np.arange(n_faces)
    short = vertices[file.n_words[vertices] < 3]
    if len(short):
        file.fail(short[0], f"got {file.n_words[short[0]]} numbers, need three coordinates")
    words = (file.first[vertices][:, None] + np.arange(3)).ravel()
    points = file.numbers(words, "a finite number").reshape(-1, 3)
    sizes = file.numbers(file.first[faces], "the number of its vertices", integers=True).ravel()
    short = np.flatnonzero((sizes < 3) | (sizes >= file.n_words[faces]))
    if len(short):
        need = "the number of its vertices, three or more, and these"
        file.fail(faces[short[0]], f"got a face of size {sizes[short[0]]}, need {need}")
    place = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    words = np.repeat(file.first[faces] + 1, sizes) + place
    return mesh_of(points, sizes, file.numbers(words, "a vertex", integers=True).ravel())


def off(shape: Polygons) -> Iterator[bytes]:
    """The bytes of an OFF file, of points and polygons."""
    before = np.insert(shape.indices, shape.offsets[:-1], shape.sizes).astype(object)
    starts = shape.offsets[:-1] + np.arange(len(shape.sizes))
    space = np.full(len(before), " ", dtype=object)
    space[starts] = "\n"
    yield f"OFF\n{len(shape.points)} {len(shape.sizes)} 0\n".encode()
    yield "\n".join(map("{!r} {!r} {!r}".format, *shape.points.T.tolist())).encode()
    yield ("".join(map("{}{}".format, space.tolist(), before.tolist())) + "\n").encode()
