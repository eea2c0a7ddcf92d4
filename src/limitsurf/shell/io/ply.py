"""Cages and tessellations from and to PLY files.

VTK reads PLY in single precision, and stops the process where a file is truncated; trimesh cuts
polygons into triangles; plyfile (GPL) cannot be asked of all who use this library. So it is read
here.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.checks import MeshError
from limitsurf.cage.mesh import Mesh
from limitsurf.shell.io.losses import Losses
from limitsurf.shell.io.polygons import IntArray, mesh_of, strips

if TYPE_CHECKING:
    from limitsurf.query import Polygons

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


def parse(name: str, data: bytes, *, strict: bool = False) -> Mesh:
    """The cage of a PLY file; texture coordinates of corners or vertices are the channel "uv"."""
    losses = Losses(name, strict)
    with np.errstate(invalid="ignore"):  # NaN is refused below
        file = _Ply(name, data)
    values = file.values
    for number, line in file.unknown:
        losses.add("header", f"line {number}", f"got {line[:60]!r}, which is unknown", "ignored")
    for n in "xyz":
        if ("vertex", n) not in values or isinstance(values["vertex", n], tuple):
            raise MeshError(f"{name}: need elements 'vertex' with the properties x, y, z")
    points = np.stack([values.pop(("vertex", n)) for n in "xyz"], axis=1)
    sizes, indices = _faces(name, values)
    uv, rows = _texture(values, sizes, indices, losses)
    losses.left_out(_others(values))
    mesh = mesh_of(points, sizes, indices, losses, uv=uv, rows=rows, merge=uv is not None)
    losses.warn(3)
    return mesh


def vertices(name: str, data: bytes) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """Points (n, 3) of a PLY file, which may have no faces, and normals (n, 3) if it has any."""
    with np.errstate(invalid="ignore"):
        values = _Ply(name, data).values

    def columns(names: Sequence[str]) -> NDArray[np.float64] | None:
        found = [values.get(("vertex", n)) for n in names]
        whole = [x for x in found if isinstance(x, np.ndarray)]
        return np.stack(whole, axis=1) if len(whole) == len(names) else None

    points = columns("xyz")
    if points is None:
        raise MeshError(f"{name}: need elements 'vertex' with the properties x, y, z")
    return points, columns(["nx", "ny", "nz"])


def _faces(name: str, values: dict[tuple[str, str], Any]) -> tuple[IntArray, IntArray]:
    """Sizes and vertices of the faces, and of the triangles of strips, which are taken out."""
    found = []
    for element in "face", "tristrips":
        lists = [values.pop((element, n)) for n in _FACES if (element, n) in values]
        lists = [given for given in lists if isinstance(given, tuple)]
        if not lists:
            continue
        sizes, given = lists[0]
        whole = (given == np.rint(given)) & (np.abs(given) < 2.0**62)
        indices = np.where(whole, given, -1 if element == "face" else -2).astype(np.int64)
        if element == "face":
            found.append((sizes, indices))
            continue
        ends = (indices == -1) | (indices == 2**32 - 1)
        corners = indices[strips(sizes, np.where(ends, -1, np.maximum(indices, 0)))]
        wrong = indices[~ends & (indices < 0)]
        if len(wrong):
            raise MeshError(f"{name}: got index {wrong[0]} in a triangle strip, need 0 or more")
        found.append((np.full(len(corners), 3), corners.ravel()))
    if not found:
        need = "elements 'face' or 'tristrips' with a list, the property vertex_indices"
        raise MeshError(f"{name}: need {need}")
    sizes, indices = (np.concatenate(each) for each in zip(*found, strict=True))
    return sizes, indices


def _texture(
    values: dict[tuple[str, str], Any], sizes: IntArray, indices: IntArray, losses: Losses
) -> tuple[NDArray[np.float64] | None, IntArray | None]:
    """Texture coordinates (k, 2), and of each corner the row, or -1: those of corners come first.

    None without some; without rows they are of vertices.
    """
    by_point = [pair for pair in _TEXTURE if all(("vertex", n) in values for n in pair)]
    of_corners = values.pop(("face", "texcoord"), None)
    if isinstance(of_corners, tuple) and of_corners[0].any():
        counts, numbers = of_corners
        counts = np.append(counts, np.zeros(len(sizes) - len(counts), np.int64))  # none in strips
        fit = counts == 2 * sizes
        wrong = np.flatnonzero(~fit & (counts > 0))
        if len(wrong):
            text = f"got {counts[wrong[0]]} texture coordinates, need {2 * sizes[wrong[0]]}, two "
            text += "for each corner"
            text += f"; {len(wrong) - 1} more like it" if len(wrong) > 1 else ""
            losses.add("texcoord", f"face {wrong[0]}", text)
        numbers = numbers[np.repeat(fit, counts)].reshape(-1, 2).astype(np.float64)
        rows = np.full(len(indices), -1)
        rows[np.repeat(fit, sizes)] = np.arange(len(numbers))
        return (numbers, rows) if len(numbers) else (None, None)
    if not by_point:
        return None, None
    return np.stack([values.pop(("vertex", n)) for n in by_point[0]], axis=1), None


def _others(values: dict[tuple[str, str], Any]) -> list[str]:
    """What there is besides, by name."""
    others: dict[str, list[str]] = {}
    for element, n in values:
        others.setdefault(element, []).append(n)
    vertex = others.get("vertex", [])
    vertex[:] = [n for n in vertex if n not in ("nx", "ny", "nz")]  # the surface has its own
    said = []
    for element, names in others.items():
        if element not in ("vertex", "face", "tristrips"):
            said.append(f"elements {element!r}")
        elif names:
            said.append(f"of {element} {', '.join(names)}")
    return said


class Elements:
    """Rows of numbers and lists, as PLY files have them: elements by name and property.

    Attributes
    ----------
    order : {"<", ">", ""}
        Of bytes; "" is text.
    values : {(element, property): (n,) or (sizes (n,), values (k,))}
        Numbers, float64, and lists of them, of their own type.
    """

    def __init__(
        self,
        name: str,
        body: bytes,
        order: str,
        elements: list[tuple[str, int, list[tuple[str, ...]]]],
    ) -> None:
        self.name, self.order = name, order
        self.values: dict[tuple[str, str], Any] = {}
        self._body = body
        self._at = 0
        if not order:
            try:
                self._numbers = np.array(body.split(), dtype=np.float64)
            except ValueError as error:
                self.fail(f"after the header: {error}")
        for element, count, properties in elements:
            self._read(element, count, properties)

    def fail(self, message: str) -> NoReturn:
        """Refuse the file."""
        raise MeshError(f"{self.name}: {message}")

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
            self.values[element, rest[1]] = size, listed
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


class _Ply(Elements):
    """The elements of a PLY file, and unknown lines of its header, (number, text)."""

    def __init__(self, name: str, data: bytes) -> None:
        self.name = name
        self.unknown: list[tuple[int, str]] = []
        end = re.search(rb"^end_header[ \t]*(\r\n|\n|\r(?!\n))", data, re.MULTILINE)
        if not re.match(rb"ply[ \t]*[\r\n]", data):
            self.fail("need 'ply' on the first line, this is no PLY file")
        if end is None:
            self.fail("need a header that ends with 'end_header'")
        order, elements = self._header(data[: end.start()].decode("latin-1"))
        super().__init__(name, data[end.end() :], order, elements)

    def _header(self, header: str) -> tuple[str, list[tuple[str, int, list[tuple[str, ...]]]]]:
        """The order of bytes, and of elements name, number and properties.

        These are (type, name), or (count type, type, name) of a list.
        """
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
                case ["format" | "element" | "property", *_]:
                    need = "format, element, property or comment"
                    self.fail(f"line {number}: got {line[:60]!r}, need {need}")
                case _:
                    self.unknown.append((number, line))
        if order is None:
            self.fail(f"need one of the formats {', '.join(_ORDERS)} 1.0")
        return order, elements


def content(shape: Polygons) -> Iterator[bytes]:
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
