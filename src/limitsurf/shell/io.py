"""Cages from and to OBJ files, USD files and PyVista."""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Iterable, Iterator
from itertools import chain
from typing import Any, NoReturn, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf.mesh import INTERPOLATION, Mesh, MeshError
from limitsurf.shell.files import replacing

__all__ = ["from_pyvista", "read", "to_pyvista", "write"]

IntArray: TypeAlias = NDArray[np.int64]
Path: TypeAlias = str | os.PathLike[str]

USD_SUFFIXES = (".usd", ".usda", ".usdc")

# The tags that hold a choice: our name of it, and the meanings of the argument as they are read
# by OpenSubdiv's regression/common/far_utils.h (GetSdcOptions); there 1 is edge_and_corner and
# 2 edge_only, unlike in Sdc's enumeration. Its older hbr_utils.h gives "smoothtriangles" integers.
CHOICES: dict[str, tuple[str, dict[Any, str]]] = {
    "interpolateboundary": ("boundary", {0: "none", 1: "edge_and_corner", 2: "edge_only"}),
    "creasemethod": ("creasing", {"normal": "uniform", "chaikin": "chaikin"}),
    "smoothtriangles": (
        "triangles",
        {"catmark": "catmull-clark", "smooth": "smooth", 1: "catmull-clark", 2: "smooth"},
    ),
    "facevaryinginterpolateboundary": ("uv", dict(enumerate(INTERPOLATION))),
}
TAGS = {
    "crease": "'crease 2/1/0 a b sharpness', or more pairs and as many sharpnesses or one",
    "corner": "'corner 1/1/0 vertex sharpness', or more vertices and as many sharpnesses or one",
    "hole": "'hole 1/0/0 face', or more faces",
    # Our own: OpenSubdiv passes over tags that it does not know.
    "scheme": "'scheme 0/0/1 name'",
} | {
    tag: f"'{tag} {'1/0/0' if 0 in meanings else '0/0/1'} x', x of {', '.join(map(str, meanings))}"
    for tag, (_, meanings) in CHOICES.items()
}
# A tag of the time before OpenSubdiv 3, of which nothing is left there.
OBSOLETE = "facevaryingpropagatecorners"

# Statements of the format that have no bearing on a cage.
IGNORED = frozenset(
    b"vn vp g o s l p mg usemtl mtllib usemap maplib lod bevel c_interp d_interp shadow_obj "
    b"trace_obj ctech stech cstype deg bmat step curv curv2 surf parm trim hole scrv sp end con "
    b"call csh bsp bzp cdc cdp res".split()
)
SPACE = np.isin(np.arange(256), list(b" \t\n\v\f"))  # (256,) bool, by byte
VERTEX, TEXTURE, FACE, TAG, OTHER = range(5)


def read(path: Path, *, prim: str | None = None) -> Mesh:
    """Read a cage from an OBJ file or a USD file.

    **OBJ.** Positions ``v`` (three coordinates; a weight or a colour after them is ignored), faces
    ``f`` of any size with positive or negative indices, and OpenSubdiv's tags ``t`` (crease,
    corner, hole, interpolateboundary, creasemethod, smoothtriangles,
    facevaryinginterpolateboundary) are read. Texture coordinates ``vt`` become the channel "uv"
    where every face corner has one, with the interpolation of its tag or "corners_plus1". Normals,
    groups, materials, lines and free-form statements are ignored. Of tags given twice the last one
    holds. Where there is no tag for the boundary it is left open, as None: OpenSubdiv's own readers
    then take "edge_only".

    **USD** (with ``pip install "limitsurf[usd]"``). All meshes that are shown (visible, neither
    proxy nor guide) become one, disconnected, in the order of the stage, as all objects of an OBJ
    file do. Every mesh stands where its transforms put it in the world, at its earliest time; the
    stage's unit and up axis change nothing. Faces of a mesh that is left-handed or mirrored are
    turned around, keeping their first corner. Creases, corners, holes and the attributes
    ``subdivisionScheme``, ``interpolateBoundary`` and ``triangleSubdivisionRule`` are read; where a
    file has none of the latter they are left open, as None: USD's defaults are those of
    ``LimitSurface``. The scheme is kept by name, also "loop", "bilinear" and "none" (a mere polygon
    mesh); to subdivide such a mesh by Catmull-Clark all the same, name that scheme to
    ``LimitSurface``. Of an edge that is creased twice the last sharpness holds.

    Primvars of floats and vectors become channels by the same name, ``primvars:st`` the channel
    "st": "faceVarying" ones with the interpolation of ``faceVaryingLinearInterpolation`` (where
    they are not indexed, every face corner has a value of its own); "vertex" ones with "none",
    which is as smooth as the points; "varying" ones, which are linear, with "all". Other primvars,
    normals, materials, subsets, point instancers and skeletons are ignored. Of several meshes the
    choices must agree, and the channels are kept that all of them have.

    Parameters
    ----------
    path : str or os.PathLike
        A file with the suffix ``.obj``, ``.usd``, ``.usda``, ``.usdc`` or ``.usdz``, in upper or
        lower case.
    prim : str, optional
        Of a USD file, the path of one prim such as "/World/hand": only it, if it is a mesh, or
        else the meshes below it are read.

    Returns
    -------
    Mesh

    Raises
    ------
    MeshError
        Anything malformed, with path, line or prim, and what was expected; all that ``Mesh``
        refuses; a USD file without a mesh, or with meshes whose choices differ.
    ValueError
        An unknown suffix; a prim that does not exist, or one of an OBJ file.
    OSError
        A file that cannot be read.
    ImportError
        A USD file without the package usd-core.

    Warns
    -----
    UserWarning
        A statement or a tag of an OBJ file that is not known, and therefore ignored, with its line;
        anything that USD warns of, such as a reference to a file that does not exist.

    Examples
    --------
    >>> import limitsurf as ls, pathlib, tempfile
    >>> text = "v 0 0 0\\nv 1 0 0\\nv 1 1 0\\nv 0 1 0\\nf 1 2 3 4\\nt corner 1/1/0 0 2.5"
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "square.obj")
    ...     length = path.write_text(text)
    ...     ls.read(path)
    Mesh(4 vertices, 4 edges, 1 face {4: 1}, 4 boundary vertices, 1 corner)
    """
    name = os.fsdecode(path)
    with open(name, "rb") as file:
        if _suffix(name, (".obj", *USD_SUFFIXES, ".usdz")) != ".obj":
            from limitsurf.shell import usd

            return usd.read(name, prim)
        if prim is not None:
            raise ValueError(f"{name}: got prim {prim!r}, but an OBJ file has none")
        return _parse(_Statements(name, file.read()))


def write(path: Path, mesh: Mesh) -> None:
    """Write a cage to an OBJ or USD file, which ``read`` reads back as an equal mesh.

    The file appears whole or not at all.

    **OBJ.** Coordinates are written as the shortest decimals that give the same float64; exact ones
    (Fractions and their like) are rounded to float64 first. Tags are written as OpenSubdiv's, the
    channel "uv" as texture coordinates, a scheme's name as a tag of our own, ``t scheme 0/0/1``.

    **USD.** The mesh is the prim ``/mesh``; ``.usda`` is text, ``.usdc`` and ``.usd`` are binary.
    Points, sharpness and the values of channels are rounded to float32, which is what USD keeps
    them in: the mesh read back is equal up to that. Channels become primvars by the same name.
    USD knows "uniform" creasing alone: another one is kept in custom data, where ``read`` finds it
    but other programs do not.

    Parameters
    ----------
    path : str or os.PathLike
        A file name with the suffix ``.obj``, ``.usd``, ``.usda`` or ``.usdc``.
    mesh : Mesh
        Points of shape (n_vertices, 3).

    Raises
    ------
    ValueError
        An unknown suffix; points that are not of shape (n_vertices, 3) or too large for the
        format; and what the format has no place for. OBJ: a scheme that is no name, a channel
        other than "uv" or not of two numbers. USD: a scheme other than "catmull-clark", "loop",
        "bilinear" and "none"; channels with a name that is no identifier, of shapes other than
        (k,), (k, 2), (k, 3) and (k, 4), or with seams of different interpolation.
    OSError
        A file that cannot be written.
    ImportError
        A USD file without the package usd-core.

    Examples
    --------
    >>> import limitsurf as ls, pathlib, tempfile
    >>> triangle = ls.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], boundary="edge_only")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     ls.write(pathlib.Path(folder, "triangle.obj"), triangle)
    ...     ls.read(pathlib.Path(folder, "triangle.obj")) == triangle
    True
    """
    if _suffix(os.fsdecode(path), (".obj", *USD_SUFFIXES)) != ".obj":
        from limitsurf.shell import usd

        usd.write(path, mesh)
        return
    statements = _statements(mesh)
    with replacing(path, "w") as file:
        file.writelines(statements)


def from_pyvista(dataset: Any, **tags: Any) -> Mesh:
    """A cage of the polygons of a PyVista ``PolyData`` or ``UnstructuredGrid``.

    Vertex cells and lines are ignored, and so are data arrays. Faces that only touch are joined
    nowhere: merge their points first with ``dataset.clean()``.

    Parameters
    ----------
    dataset : pyvista.PolyData or pyvista.UnstructuredGrid
        Polygons of any size; a grid must have no other cells.
    **tags
        Creases, corners and all else that ``Mesh`` takes besides points and faces.

    Returns
    -------
    Mesh

    Raises
    ------
    MeshError
        Polygons that ``Mesh`` refuses.
    TypeError
        Another type of dataset.
    ValueError
        Triangle strips, or cells of a grid that are no polygons.
    ImportError
        PyVista is not installed.

    Examples
    --------
    >>> import limitsurf as ls, pyvista
    >>> ls.from_pyvista(pyvista.Cube().clean())
    Mesh(8 vertices, 12 edges, 6 faces {4: 6}, interior valences {3: 8})
    """
    pyvista = _pyvista()
    if isinstance(dataset, pyvista.PolyData):
        if dataset.n_strips:
            raise ValueError("the dataset has triangle strips, need polygons: call .triangulate()")
        cells = dataset.GetPolys()
    elif isinstance(dataset, pyvista.UnstructuredGrid):
        polygons = (5, 7, 9)  # VTK_TRIANGLE, VTK_POLYGON, VTK_QUAD
        others = np.flatnonzero(~np.isin(dataset.celltypes, polygons))
        if len(others):
            kind = pyvista.CellType(dataset.celltypes[others[0]]).name
            raise ValueError(
                f"cell {others[0]} is a {kind}, need polygons only: call .extract_surface()"
            )
        cells = dataset.GetCells()
    else:
        raise TypeError(
            f"need a pyvista.PolyData or UnstructuredGrid, got {type(dataset).__name__}: "
            "datasets of pyvista become PolyData by .extract_surface()"
        )
    sizes = np.diff(pyvista.convert_array(cells.GetOffsetsArray()))
    indices = pyvista.convert_array(cells.GetConnectivityArray())
    return Mesh(dataset.points, (sizes, indices), **tags)


def to_pyvista(mesh: Mesh) -> Any:
    """The cage as a ``pyvista.PolyData``: its points and faces, without tags and channels.

    Parameters
    ----------
    mesh : Mesh
        Points of shape (n_vertices, 3); exact ones are rounded to float64.

    Returns
    -------
    pyvista.PolyData

    Raises
    ------
    ValueError
        Points of another shape.
    ImportError
        PyVista is not installed.

    Examples
    --------
    >>> import limitsurf as ls
    >>> ls.to_pyvista(ls.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])).n_cells
    1
    """
    cells = np.insert(mesh.indices, mesh.offsets[:-1], mesh.sizes)  # size, vertices, size, ...
    return _pyvista().PolyData(_float_points(mesh), cells)


def _pyvista() -> Any:
    try:
        import pyvista
    except ImportError as error:
        raise ImportError("PyVista is needed: pip install limitsurf[plot]") from error
    return pyvista


def _suffix(name: str, known: tuple[str, ...]) -> str:
    suffix = os.path.splitext(name)[1]
    if suffix.lower() not in known:
        raise ValueError(f"{name}: unknown suffix {suffix!r}, need one of {', '.join(known)}")
    return suffix.lower()


def _float_points(mesh: Mesh) -> NDArray[np.float64]:
    """A copy of the points in space as float64."""
    if mesh.points.shape[1:] != (3,):
        raise ValueError(f"got points of shape {mesh.points.shape}, need (n_vertices, 3)")
    try:
        points: NDArray[np.float64] = mesh.points.astype(np.float64)
    except OverflowError as error:
        raise ValueError(f"a coordinate is beyond float64: {error}") from None
    return points


def _statements(mesh: Mesh) -> Iterator[str]:
    """The text of an OBJ file, piece by piece; what cannot be written raises before the first."""
    points = _float_points(mesh)
    for name, (values, _, _) in mesh.channels.items():
        if name != "uv" or values.shape[1:] != (2,):
            raise ValueError(
                f"channel {name!r} of shape {values.shape}: an OBJ file holds one, 'uv', of (k, 2)"
            )
    scheme = mesh.scheme
    if scheme is not None and not (isinstance(scheme, str) and re.fullmatch(r"[\w.+-]+", scheme)):
        raise ValueError(f"scheme: an OBJ file holds a name of one word, got {scheme!r}")
    corners: Iterable[Any] = (mesh.indices + 1).tolist()
    texture: Iterable[str] = ()
    options = {"boundary": mesh.boundary, "creasing": mesh.creasing, "triangles": mesh.triangles}
    if "uv" in mesh.channels:
        values, rows, options["uv"] = mesh.channels["uv"]
        texture = map("vt {!r} {!r}\n".format, *_floats(values.T))
        corners = map("{}/{}".format, corners, (rows + 1).tolist())
    before = np.full(mesh.n_corners, " ", dtype=object)
    before[mesh.offsets[:-1]] = "\nf "
    edges, edge_sharpness = mesh.creases
    vertices, vertex_sharpness = mesh.corners
    return chain(
        map("v {!r} {!r} {!r}\n".format, *points.T.tolist()),
        texture,
        map("{}{}".format, before.tolist(), corners),
        ["\n"],
        map("t crease 2/1/0 {} {} {!r}\n".format, *edges.T.tolist(), _floats(edge_sharpness)),
        map("t corner 1/1/0 {} {!r}\n".format, vertices.tolist(), _floats(vertex_sharpness)),
        map("t hole 1/0/0 {}\n".format, mesh.holes.tolist()),
        (_choice(tag, options[name]) for tag, (name, _) in CHOICES.items() if options.get(name)),
        () if scheme is None else [f"t scheme 0/0/1 {scheme}\n"],
    )


def _floats(values: NDArray[Any]) -> list[Any]:
    floats: list[Any] = values.astype(np.float64).tolist()
    return floats


def _choice(tag: str, value: str | None) -> str:
    argument = next(given for given, meaning in CHOICES[tag][1].items() if meaning == value)
    counts = "1/0/0" if isinstance(argument, int) else "0/0/1"
    return f"t {tag} {counts} {argument}\n"


class _Statements:
    """The bytes of an OBJ file, cut by vectorised scans into statements, and these into words.

    A statement is a line that is not empty, with all lines that continue it.
    """

    def __init__(self, name: str, data: bytes) -> None:
        self.name = name
        data = data.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        data = re.sub(rb"#[^\n]*", b"", data)
        data = re.sub(rb"\\[ \t]*\n", b"\v", data)  # white space that still counts as a line
        self.text = np.frombuffer(data + b"\n" * 16, dtype=np.uint8)  # padded for looking ahead
        space = SPACE[self.text]
        is_start = ~space
        is_start[1:] &= space[:-1]
        words = np.flatnonzero(is_start)
        line_ends = np.flatnonzero(self.text == ord("\n"))
        first = np.searchsorted(words, np.append(0, line_ends))
        filled = np.flatnonzero(np.diff(first))
        self.start = np.append(words, len(self.text))  # (W + 1,) first byte of each word
        self.first = np.append(first[filled], len(words))  # (S + 1,) first word of each statement
        self.n_words = np.diff(self.first)  # (S,)
        self.head = words[first[filled]]  # (S,) first byte of each keyword
        a, b, c = (self.text[self.head + i] for i in range(3))
        kind = np.full(len(filled), OTHER, dtype=np.int8)
        for letter, known in ("v", VERTEX), ("f", FACE), ("t", TAG):
            kind[(a == ord(letter)) & SPACE[b]] = known
        kind[(a == ord("v")) & (b == ord("t")) & SPACE[c]] = TEXTURE
        self.kind = kind  # (S,)

    def of(self, kind: int) -> IntArray:
        """The statements of a kind, in order."""
        return np.flatnonzero(self.kind == kind)

    def arguments(self, statements: IntArray) -> IntArray:
        """The words of the statements but for their keywords, in order."""
        counts = self.n_words[statements] - 1
        shift = self.first[statements] + 1 - (np.cumsum(counts) - counts)
        words: IntArray = np.arange(counts.sum()) + np.repeat(shift, counts)
        return words

    def words(self, statement: int) -> list[str]:
        """The words of a statement, keyword first, as text."""
        low, high = self.start[self.first[[statement, statement + 1]]]
        text = self.text[low:high].tobytes()
        return [word.decode(errors="backslashreplace") for word in text.split()]

    def line(self, statement: int) -> int:
        """The line of the file, from 1, on which a statement starts."""
        before = self.text[: self.head[statement]]
        return int(np.isin(before, list(b"\n\v")).sum()) + 1

    def fail(self, statement: int, message: str) -> NoReturn:
        raise MeshError(f"{self.name}, line {self.line(statement)}: {message}")

    def numbers(
        self, words: IntArray, need: str, each: int = 1, integers: bool = False
    ) -> NDArray[Any]:
        """``each`` numbers, separated by slashes if integers, of every word: (n, each).

        A word that is not so raises an error with what the file needs.
        """
        values = self._numbers(words, each, integers)
        if values is not None:
            return values
        while len(words) > 1:  # bisection for the first bad word
            half = words[: len(words) // 2]
            words = half if self._numbers(half, each, integers) is None else words[len(half) :]
        statement = int(np.searchsorted(self.first, words[0], side="right")) - 1
        bad = self.words(statement)[words[0] - self.first[statement]]
        self.fail(statement, f"got {_shortened(bad)}, need {need}")

    def _numbers(self, words: IntArray, each: int, integers: bool) -> NDArray[Any] | None:
        """As ``numbers``, but None for a bad word."""
        if len(words) == 0:
            return np.empty((0, max(each, 1)), dtype=np.int64 if integers else np.float64)
        low, high = words[0], words[-1] + 1
        chosen = np.zeros(high - low, dtype=bool)
        chosen[words - low] = True
        text = self.text[self.start[low] : self.start[high]]
        text = text[np.repeat(chosen, np.diff(self.start[low : high + 1]))]
        if integers:
            # Of the text between slashes at most one number is read: a sign stands only before it.
            text[text == ord("/")] = ord(" ")
            sign = np.flatnonzero((text == ord("-")) | (text == ord("+")))
            before, after = text[sign - 1], text[sign + 1]
            if not (
                ((sign == 0) | SPACE[before]) & (after >= ord("0")) & (after <= ord("9"))
            ).all():
                return None
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", DeprecationWarning)  # bad text, in numpy 1
                values = np.fromstring(
                    text.tobytes(), np.int64 if integers else np.float64, sep=" "
                )
        except (ValueError, DeprecationWarning):
            return None
        if len(values) != each * len(words) or not np.isfinite(values).all():
            return None
        return values.reshape(-1, each)


def _parse(file: _Statements) -> Mesh:
    ignored = _unknown_keywords(file)
    points = _coordinates(file, VERTEX, 3, (3, 4, 6, 7))
    texture = _coordinates(file, TEXTURE, 2, (1, 2, 3))
    faces = file.of(FACE)
    if len(points) == 0 or len(faces) == 0:
        missing = "vertex, 'v x y z'" if len(points) == 0 else "face, 'f 1 2 3'"
        raise MeshError(f"{file.name}: need at least one {missing}, got none up to the last line")
    sizes = file.n_words[faces] - 1
    small = np.flatnonzero(sizes < 3)
    if len(small):
        file.fail(faces[small[0]], f"got a face of {sizes[small[0]]} corners, need three or more")
    vertex, uv, has_uv = _corner_indices(file, faces)
    statement = np.repeat(faces, sizes)  # (H,)
    indices = _resolved(file, vertex, statement, VERTEX, "vertex")
    uv_indices = _resolved(file, uv[has_uv], statement[has_uv], TEXTURE, "texture coordinate")
    tags = _Tags(file)
    interpolation = tags.options.pop("uv", "corners_plus1")
    channels = {"uv": (texture, uv_indices, interpolation)} if has_uv.all() else {}
    try:
        mesh = Mesh(
            points,
            (sizes, indices),
            creases=tags.marked["crease"],
            corners=tags.marked["corner"],
            holes=list(tags.marked["hole"]),
            channels=channels,
            **tags.options,
        )
    except MeshError as error:
        culprits = [
            faces[key] if kind == "face" else tags.statement[kind, key]
            for kind, key in error.culprits
        ]
        lines = ", ".join(str(file.line(culprit)) for culprit in culprits)
        where = f", line{'s' if len(culprits) > 1 else ''} {lines}" if culprits else ""
        raise MeshError(f"{file.name}{where}: {error} (counting from 0)") from None
    for what, first in (ignored | tags.ignored).items():
        line = file.line(first)
        warnings.warn(f"{file.name}, line {line}: {what} is unknown and ignored", stacklevel=3)
    return mesh


def _unknown_keywords(file: _Statements) -> dict[str, int]:
    """Where each unknown keyword is first; an error for what is no keyword at all."""
    others = file.of(OTHER)
    heads = file.text[file.head[others, None] + np.arange(16)]  # (n, 16)
    heads[np.cumsum(SPACE[heads], axis=1) > 0] = 0
    names, first = np.unique(heads.view("S16").ravel(), return_index=True)
    unknown = [
        (int(others[i]), name)
        for i, name in zip(first.tolist(), names.tolist(), strict=True)
        if name not in IGNORED
    ]
    for statement, name in sorted(unknown):
        if not re.fullmatch(rb"[A-Za-z_]\w*", name):
            text = " ".join(file.words(statement))
            file.fail(statement, f"got {_shortened(text)}, need a statement of an OBJ file")
    return {f"statement {name.decode()!r}": statement for statement, name in unknown}


def _shortened(text: str) -> str:
    return repr(text if len(text) <= 40 else text[:40] + "...")


def _coordinates(
    file: _Statements, kind: int, columns: int, allowed: tuple[int, ...]
) -> NDArray[np.float64]:
    """The first numbers of all statements of a kind, filled up with zeros: (n, columns)."""
    statements = file.of(kind)
    counts = file.n_words[statements] - 1
    odd = np.flatnonzero(~np.isin(counts, allowed))
    if len(odd):
        what = "a vertex" if kind == VERTEX else "a texture coordinate"
        need = f"{', '.join(map(str, allowed[:-1]))} or {allowed[-1]}"
        file.fail(statements[odd[0]], f"got {what} of {counts[odd[0]]} numbers, need {need}")
    rows = np.zeros((len(statements), columns))
    for count in np.unique(counts):
        alike = np.flatnonzero(counts == count)
        values = file.numbers(file.arguments(statements[alike]), "a finite number")
        rows[alike, :count] = values.reshape(-1, count)[:, :columns]
    return rows


def _corner_indices(
    file: _Statements, faces: IntArray
) -> tuple[IntArray, IntArray, NDArray[np.bool_]]:
    """Vertex and texture index of every face corner as in the file, and whether it has the latter.

    Corners written in the same of the four ways are converted together.
    """
    words = file.arguments(faces)  # (H,)
    slash = np.flatnonzero(file.text == ord("/"))
    double = slash[:-1][np.diff(slash) == 1]
    low, high = file.start[words], file.start[words + 1]
    slashes = np.searchsorted(slash, high) - np.searchsorted(slash, low)
    doubles = np.searchsorted(double, high) - np.searchsorted(double, low)
    vertex, texture = np.zeros((2, len(words)), dtype=np.int64)
    usual = (slashes <= 2) & (doubles <= 1)
    form = np.where(usual, slashes + 3 * doubles, -1)
    for this, each in (0, 1), (1, 2), (2, 3), (5, 2), (-1, 0):  # v, v/vt, v/vt/vn, v//vn, other
        alike = np.flatnonzero(form == this)
        need = "integers as v, v/vt, v//vn or v/vt/vn"
        values = file.numbers(words[alike], need, each, integers=True)
        vertex[alike] = values[:, 0]
        if this in (1, 2):
            texture[alike] = values[:, 1]
    return vertex, texture, (form == 1) | (form == 2)


def _resolved(
    file: _Statements, given: IntArray, statement: IntArray, kind: int, what: str
) -> IntArray:
    """Indices from 0 of the file's from 1, or from -1 downwards for the last before the face."""
    counted = np.cumsum(file.kind == kind)  # (S,)
    before = counted[statement]
    resolved = np.where(given < 0, before + given, given - 1)
    wrong = np.flatnonzero((resolved < 0) | (resolved >= counted[-1]))
    if len(wrong):
        i, n = wrong[0], counted[-1]
        need = f"need 1 to {n}, or -{before[i]} to -1 for those before the face"
        file.fail(statement[i], f"got {what} index {given[i]}, {need if n else 'but have none'}")
    return resolved


class _Tags:
    """OpenSubdiv's tags, ``t name integers/floats/strings`` and so many arguments of each kind.

    Of several tags on one edge, vertex or face, or for one choice, the last one holds, as there.
    """

    def __init__(self, file: _Statements) -> None:
        self.marked: dict[str, dict[Any, float]] = {"crease": {}, "corner": {}, "hole": {}}
        self.options: dict[str, str] = {}
        self.statement: dict[tuple[str, Any], int] = {}  # by ("crease", edge) and the like
        self.ignored: dict[str, int] = {}  # where each unknown tag is first
        for statement in file.of(TAG).tolist():
            _, *words = file.words(statement)
            if not words:
                file.fail(statement, "got 't', need the name of a tag after it")
            name = words[0]
            if name in TAGS:
                try:
                    self.add(statement, name, *_arguments(words))
                except (ValueError, LookupError, OverflowError):
                    got = _shortened(" ".join(words))
                    file.fail(statement, f"got tag {got}, need {TAGS[name]}")
            elif name != OBSOLETE:
                self.ignored.setdefault(f"tag {name!r}", statement)

    def add(
        self,
        statement: int,
        name: str,
        integers: list[int],
        floats: list[float],
        strings: list[str],
    ) -> None:
        """Take one tag; a ValueError or LookupError says that its arguments are not right."""
        if name in CHOICES:
            option, meanings = CHOICES[name]
            (given,) = integers + strings
            self.options[option] = meanings[given]
        elif name == "scheme":
            (self.options[name],) = strings
        elif strings or (name == "hole" and floats):
            raise ValueError
        else:
            keys: list[Any] = integers
            if name == "crease":
                keys = [(min(pair), max(pair)) for pair in np.reshape(integers, (-1, 2)).tolist()]
            sharpness = np.broadcast_to([0.0] if name == "hole" else floats, len(keys)).tolist()
            self.marked[name].update(zip(keys, sharpness, strict=True))
            self.statement.update(((name, key), statement) for key in keys)


def _arguments(words: list[str]) -> tuple[list[int], list[float], list[str]]:
    """The integers, floats and strings of a tag, given its name, their counts and themselves."""
    n, m, k = map(int, words[1].split("/"))
    given = words[2:]
    if min(n, m, k) < 0 or len(given) != n + m + k:
        raise ValueError
    integers = np.array(list(map(int, given[:n])), dtype=np.int64)
    return integers.tolist(), list(map(float, given[n : n + m])), given[n + m :]
