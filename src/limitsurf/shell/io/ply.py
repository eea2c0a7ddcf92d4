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
from limitsurf.shell.io.losses import Losses
from limitsurf.shell.io.obj import Statements
from limitsurf.shell.io.polygons import IntArray, mesh_of, strips

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
    sizes, indices = _ply_faces(name, values)
    uv, rows = _ply_texture(values, sizes, indices, losses)
    losses.left_out(_ply_others(values))
    mesh = mesh_of(points, sizes, indices, losses, uv=uv, rows=rows, merge=uv is not None)
    losses.warn(3)
    return mesh


def _ply_faces(name: str, values: dict[tuple[str, str], Any]) -> tuple[IntArray, IntArray]:
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


def _ply_texture(
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


def _ply_others(values: dict[tuple[str, str], Any]) -> list[str]:
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


class _Elements:
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


class _Ply(_Elements):
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


# How an OFF file begins: textures, colours, normals, a fourth coordinate, another dimension. The
# keyword may be missing, or stand before the first number without a space.
_OFF = re.compile(r"(?P<st>ST)?(?P<c>C)?(?P<n>N)?(?P<w>4)?(?P<d>n)?OFF(?=\d*$)")


def parse_off(name: str, data: bytes, *, strict: bool = False) -> Mesh:
    """The cage of an OFF file, in text or binary; its texture coordinates are the channel "uv"."""
    losses = Losses(name, strict)
    line = re.match(rb"\s*(\w*OFF)[ \t]+BINARY[ \t]*\r?\n", data)
    if line is not None:
        shape = _Off(name, line[1].decode(), losses)
        mesh = shape.of_elements(data[line.end() :])
    else:
        mesh = _off_text(name, Statements(name, data), losses)
    losses.warn(3)
    return mesh


class _Off:
    """What the keyword of an OFF file says of its vertices."""

    def __init__(self, name: str, keyword: str, losses: Losses) -> None:
        found = _OFF.match(keyword)
        if found is None:
            raise MeshError(f"{name}: need 'OFF' on the first line: this is no such file")
        self.name, self.keyword, self.losses = name, keyword[: found.end()], losses
        self.any_dimension = found["d"] is not None
        self.n_coordinates = 3 + (found["w"] is not None)  # the last one divides the others
        self.normals, self.colours, self.uv = (found[x] is not None for x in ("n", "c", "st"))

    def check_dimension(self, dimension: int) -> None:
        if dimension != 3:
            need = "need points of three coordinates"
            raise MeshError(f"{self.name}: {need}, got {self.keyword!r} of {dimension}")

    def mesh(
        self, rows: NDArray[np.float64], sizes: IntArray, indices: IntArray, **more: Any
    ) -> Mesh:
        """A mesh of vertices, (V, n_coordinates), and faces."""
        with np.errstate(divide="ignore", invalid="ignore"):
            points = rows[:, :3] / rows[:, 3:] if self.n_coordinates > 3 else rows
        return mesh_of(points, sizes, indices, self.losses, **more)

    def left_out(self, colours: bool, colours_of_faces: bool) -> None:
        found = {"colours of vertices": colours, "colours of faces": colours_of_faces}
        self.losses.left_out([what for what, there in found.items() if there])

    def of_elements(self, body: bytes) -> Mesh:
        """The mesh of the bytes after the first line: 32 bits a number, the highest first."""
        counts = 3 + self.any_dimension
        head = np.frombuffer(body[: 4 * counts].ljust(4 * counts, b"\xff"), ">i4")
        if len(body) < 4 * counts or head[-3:-1].min() < 0:
            raise MeshError(
                f"{self.name}: need the numbers of vertices and faces after the keyword"
            )
        if self.any_dimension:
            self.check_dimension(int(head[0]))
        width = self.n_coordinates + 3 * self.normals + 4 * self.colours + 2 * self.uv
        columns: list[tuple[str, ...]] = [("f4", str(i)) for i in range(width)]
        lists: list[tuple[str, ...]] = [("i4", "i4", "vertices"), ("i4", "f4", "colours")]
        elements = [
            ("vertex", int(head[-3]), columns),
            ("face", int(head[-2]), lists),
        ]
        found = _Elements(self.name, body[4 * counts :], ">", elements).values
        rows = np.stack([found["vertex", str(i)] for i in range(width)], axis=1)
        sizes, indices = found["face", "vertices"]
        self.left_out(self.colours, bool(found["face", "colours"][0].any()))
        uv = rows[:, -2:] if self.uv else None
        rows = rows[:, : self.n_coordinates]
        return self.mesh(rows, sizes, indices.astype(np.int64), uv=uv, merge=self.uv)


def _off_text(name: str, file: Statements, losses: Losses) -> Mesh:
    """The mesh of a text."""
    first = file.words(0) if len(file.n_words) else [""]
    bare = len(first) == 3 and all(re.fullmatch(r"\d+", word) for word in first)
    shape = _Off(name, "OFF" if bare else first[0], losses)
    words = np.arange(2 + shape.any_dimension) + (not bare)
    if len(shape.keyword) < len(first[0]) and not bare:  # "OFF8 6 12"
        file.start = file.start + np.where(np.arange(len(file.start)) == 0, len(shape.keyword), 0)
        words -= 1
    if words[-1] >= file.first[-1]:
        raise MeshError(f"{name}: need the numbers of vertices and faces after 'OFF'")
    if shape.any_dimension:
        shape.check_dimension(int(file.numbers(words[:1], "a dimension", integers=True)[0, 0]))
        words = words[1:]
    counts = file.numbers(words, "the numbers of vertices and faces", integers=True)
    n_vertices, n_faces = counts.ravel().tolist()
    head = int(np.searchsorted(file.first, words[-1], side="right"))  # statements before vertices
    if min(n_vertices, n_faces) < 0 or head + n_vertices + n_faces > len(file.n_words):
        raise MeshError(
            f"{name}: need {n_vertices} lines of vertices and {n_faces} of faces, got "
            f"{len(file.n_words) - head}: the file is truncated"
        )
    vertices = head + np.arange(n_vertices)
    faces = head + n_vertices + np.arange(n_faces)
    need = shape.n_coordinates
    short = vertices[file.n_words[vertices] < need]
    if len(short):
        text = f"got {file.n_words[short[0]]} numbers, need {'three' if need == 3 else need}"
        file.fail(short[0], f"{text} coordinates")
    words = (file.first[vertices][:, None] + np.arange(need)).ravel()
    rows = file.numbers(words, "a finite number").reshape(-1, need)
    sizes = file.numbers(file.first[faces], "the number of its vertices", integers=True).ravel()
    short = np.flatnonzero((sizes < 0) | (sizes >= file.n_words[faces]))
    if len(short):
        text = "the number of its vertices, and these"
        file.fail(faces[short[0]], f"got a face of size {sizes[short[0]]}, need {text}")
    place = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    words = np.repeat(file.first[faces] + 1, sizes) + place
    indices = file.numbers(words, "a vertex", integers=True).ravel()
    uv = _off_texture(file, shape, vertices)
    least = need + 3 * shape.normals + 2 * (uv is not None)
    coloured = bool((file.n_words[vertices] > least).any())
    shape.left_out(coloured, bool((file.n_words[faces] > sizes + 1).any()))
    return shape.mesh(
        rows, sizes, indices, uv=uv, merge=uv is not None, place=lambda f: file.place(faces[f])
    )


def _off_texture(file: Statements, shape: _Off, vertices: IntArray) -> NDArray[np.float64] | None:
    """The last two numbers of all vertices, if the keyword promises them."""
    if not shape.uv:
        return None
    need = shape.n_coordinates + 3 * shape.normals + 2
    short = vertices[file.n_words[vertices] < need]
    last = file.first[vertices + 1][:, None] - [2, 1]
    values = None if len(short) else file.numbers_or_none(last.ravel())
    if values is None:
        place = file.place(short[0]) if len(short) else ""
        text = f"need {need} numbers or more of each vertex for texture coordinates"
        shape.losses.add("uv", place, text)
        return None
    return values.reshape(-1, 2)


def off(shape: Polygons) -> Iterator[bytes]:
    """The bytes of an OFF file, of points and polygons."""
    before = np.insert(shape.indices, shape.offsets[:-1], shape.sizes).astype(object)
    starts = shape.offsets[:-1] + np.arange(len(shape.sizes))
    space = np.full(len(before), " ", dtype=object)
    space[starts] = "\n"
    yield f"OFF\n{len(shape.points)} {len(shape.sizes)} 0\n".encode()
    yield "\n".join(map("{!r} {!r} {!r}".format, *shape.points.T.tolist())).encode()
    yield ("".join(map("{}{}".format, space.tolist(), before.tolist())) + "\n").encode()
