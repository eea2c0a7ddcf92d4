"""Cages and tessellations from and to OFF files, of which trimesh would make triangles."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.checks import MeshError
from limitsurf.cage.mesh import Mesh
from limitsurf.shell.io.losses import Losses
from limitsurf.shell.io.ply import Elements
from limitsurf.shell.io.polygons import IntArray, mesh_of
from limitsurf.shell.io.statements import Statements

if TYPE_CHECKING:
    from limitsurf.query import Polygons

# How an OFF file begins: textures, colours, normals, a fourth coordinate, another dimension. The
# keyword may be missing, or stand before the first number without a space.
_OFF = re.compile(r"(?P<st>ST)?(?P<c>C)?(?P<n>N)?(?P<w>4)?(?P<d>n)?OFF(?=\d*$)")


def parse(name: str, data: bytes, *, strict: bool = False) -> Mesh:
    """The cage of an OFF file, in text or binary; its texture coordinates are the channel "uv"."""
    losses = Losses(name, strict)
    line = re.match(rb"\s*(\w*OFF)[ \t]+BINARY[ \t]*\r?\n", data)
    if line is not None:
        shape = _Off(name, line[1].decode(), losses)
        mesh = shape.of_elements(data[line.end() :])
    else:
        mesh = _text(name, Statements(name, data), losses)
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
        found = Elements(self.name, body[4 * counts :], ">", elements).values
        rows = np.stack([found["vertex", str(i)] for i in range(width)], axis=1)
        sizes, indices = found["face", "vertices"]
        self.left_out(self.colours, bool(found["face", "colours"][0].any()))
        uv = rows[:, -2:] if self.uv else None
        rows = rows[:, : self.n_coordinates]
        return self.mesh(rows, sizes, indices.astype(np.int64), uv=uv, merge=self.uv)


def _text(name: str, file: Statements, losses: Losses) -> Mesh:
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
        shape.check_dimension(int(file.integers(words[:1], "a dimension")[0]))
        words = words[1:]
    counts = file.integers(words, "the numbers of vertices and faces")
    n_vertices, n_faces = counts.tolist()
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
    rows = file.numbers(words).reshape(-1, need)
    sizes = file.integers(file.first[faces], "the number of its vertices")
    short = np.flatnonzero((sizes < 0) | (sizes >= file.n_words[faces]))
    if len(short):
        text = "the number of its vertices, and these"
        file.fail(faces[short[0]], f"got a face of size {sizes[short[0]]}, need {text}")
    place = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    words = np.repeat(file.first[faces] + 1, sizes) + place
    indices = file.integers(words, "a vertex")
    uv = _texture(file, shape, vertices)
    least = need + 3 * shape.normals + 2 * (uv is not None)
    coloured = bool((file.n_words[vertices] > least).any())
    shape.left_out(coloured, bool((file.n_words[faces] > sizes + 1).any()))
    return shape.mesh(
        rows, sizes, indices, uv=uv, merge=uv is not None, place=lambda f: file.place(faces[f])
    )


def _texture(file: Statements, shape: _Off, vertices: IntArray) -> NDArray[np.float64] | None:
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


def content(shape: Polygons) -> Iterator[bytes]:
    """The bytes of an OFF file, of points and polygons."""
    before = np.insert(shape.indices, shape.offsets[:-1], shape.sizes).astype(object)
    starts = shape.offsets[:-1] + np.arange(len(shape.sizes))
    space = np.full(len(before), " ", dtype=object)
    space[starts] = "\n"
    yield f"OFF\n{len(shape.points)} {len(shape.sizes)} 0\n".encode()
    yield "\n".join(map("{!r} {!r} {!r}".format, *shape.points.T.tolist())).encode()
    yield ("".join(map("{}{}".format, space.tolist(), before.tolist())) + "\n").encode()
