"""Cages and tessellations from and to OBJ files, with OpenSubdiv's tags."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.checks import INTERPOLATION, MeshError
from limitsurf.cage.mesh import Mesh
from limitsurf.scheme import SCHEMES
from limitsurf.scheme.scheme import Scheme
from limitsurf.shell.io.losses import Losses, first_of
from limitsurf.shell.io.polygons import INTERPOLATED, IntArray, mesh_of, polygons, texture
from limitsurf.shell.io.statements import (
    FACE,
    OTHER,
    TAG,
    TEXTURE,
    VERTEX,
    Statements,
    is_space,
    shortened,
)

if TYPE_CHECKING:
    from limitsurf.query import Tessellation

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
    "units": "'units 0/1/0 x', x metres, more than 0",
    "up": "'up 0/0/1 x', x of y, z",
} | {
    tag: f"'{tag} {'1/0/0' if 0 in meanings else '0/0/1'} x', x of {', '.join(map(str, meanings))}"
    for tag, (_, meanings) in CHOICES.items()
}
# A tag of the time before OpenSubdiv 3, of which nothing is left there.
OBSOLETE = "facevaryingpropagatecorners"

# Statements that say what faces after them belong to: the name of that, as data of faces.
NAMES = {b"o": "object", b"g": "group", b"usemtl": "material"}
# Statements of the format that have no place in a cage, and what they are about; of normals, ""
# here, nothing is said: those of the surface are its own.
LEFT_OUT = {
    keyword: what
    for what, keywords in (
        ("", b"vn g o usemtl"),
        ("files of materials", b"mtllib usemap maplib"),
        ("smoothing groups", b"s"),
        ("lines", b"l"),
        ("points", b"p"),
        (
            "free-form curves and surfaces",
            b"vp cstype deg bmat step curv curv2 surf parm trim hole scrv sp end con mg bsp bzp "
            b"cdc cdp res ctech stech",
        ),
        ("display attributes", b"lod bevel c_interp d_interp shadow_obj trace_obj"),
        ("other files", b"call csh"),
    )
    for keyword in keywords.split()
}
_AT_ONCE = 1 << 14  # lines or corners that are put into a text together
_NAMES = 1 << 26  # bytes that the names of all faces may take, beside those in proportion to a file


def statements(x: Mesh | Tessellation) -> Iterator[str]:
    """The text of an OBJ file, piece by piece; what cannot be written raises before the first."""
    tags = _tag_statements(x) if isinstance(x, Mesh) else []
    shape = polygons(x)
    uv, place = shape.channels.get("uv", (np.zeros((0, 2)), None))
    columns, forms = [shape.indices + 1], ["%d"]
    missing: NDArray[np.bool_] = np.asarray(np.isnan(uv).any(axis=1))
    if place is not None:
        lacking = np.repeat(np.logical_or.reduceat(missing[place], shape.offsets[:-1]), shape.sizes)
        # faces without texture coordinates
        columns.append(np.where(lacking, 0, np.cumsum(~missing)[place]))
        uv = uv[~missing]
        forms = ["%d/%d", "%d%.0s"] if lacking.any() else ["%d/%d"]
    if len(shape.normals):
        columns.append(shape.normal_indices + 1)
        forms = [f"{form}/%d" if "/" in form else f"{form}//%d" for form in forms]
    before = np.full(len(shape.indices), " ", dtype=object)
    before[shape.offsets[:-1]] = _before_faces(x)
    form = np.array(forms, dtype=object)[lacking.astype(int) if len(forms) > 1 else 0]
    return chain(
        _lines("v %r %r %r\n", shape.points),
        _lines("vt %r %r\n", uv),
        _lines("vn %r %r %r\n", shape.normals),
        _corners(before + form, np.stack(columns, axis=1)),
        ["\n"],
        tags,
        () if x.units is None else [f"t units 0/1/0 {x.units!r}\n"],
        () if x.up is None else [f"t up 0/0/1 {x.up}\n"],
    )


def _lines(form: str, rows: NDArray[np.float64]) -> Iterator[str]:
    """Rows (n, k), each a line of a form that has k places."""
    for i in range(0, len(rows), _AT_ONCE):
        part = rows[i : i + _AT_ONCE]
        yield form * len(part) % tuple(part.ravel().tolist())


def _corners(forms: NDArray[Any], rows: IntArray) -> Iterator[str]:
    """Corners (n, k), each in a form of its own (n,) with k places."""
    for i in range(0, len(rows), _AT_ONCE):
        form = "".join(forms[i : i + _AT_ONCE].tolist())
        yield form % tuple(rows[i : i + _AT_ONCE].ravel().tolist())


def named(x: Mesh | Tessellation) -> list[str]:
    """Data of faces that are names of the format."""
    return [n for n in NAMES.values() if n in x.face_data and x.face_data[n].dtype.kind == "U"]


def _before_faces(x: Mesh | Tessellation) -> Any:
    """What stands before the corners of each face: names where they change, and the keyword.

    It is a part of a form, where % is doubled.
    """
    before = np.full(len(x.sizes), "\n", dtype=object)
    for keyword, name in NAMES.items():
        if name not in named(x):
            continue
        values = x.face_data[name]
        for i in np.flatnonzero(values != np.append("", values[:-1])).tolist():
            text = str(values[i])
            if " ".join(text.split()) != text or {"#", "\\"} & set(text):
                need = "names without #, \\ and white space but single blanks"
                raise ValueError(f"{name} {text!r} of face {i}: an OBJ file holds {need}")
            name_line = f"{keyword.decode()} {text}".replace("%", "%%").rstrip()
            before[i] += f"{name_line}\n"
    return before + "f "


def _tag_statements(mesh: Mesh) -> Iterator[str]:
    """OpenSubdiv's tags, and ours, of a cage."""
    scheme = mesh.scheme
    if isinstance(scheme, Scheme):  # of the library's, or one's own, which files cannot hold
        scheme = scheme.name if scheme.name in SCHEMES else None
    if scheme is not None and not (isinstance(scheme, str) and re.fullmatch(r"[\w.+-]+", scheme)):
        raise ValueError(f"scheme: an OBJ file holds a name of one word, got {scheme!r}")
    options: dict[str, str | None] = {
        "boundary": mesh.boundary,
        "creasing": mesh.creasing,
        "triangles": mesh.triangles,
    }
    name = texture(mesh)
    if name is not None:
        options["uv"] = mesh.channels[name][2]
    edges, edge_sharpness = mesh.creases
    vertices, vertex_sharpness = mesh.corners
    return chain(
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


def parse(name: str, data: bytes, *, strict: bool = False) -> Mesh:
    """The cage of the bytes of a file; its name is for messages."""
    file, losses = Statements(name, data), Losses(name, strict)
    unknown = _unknown_statements(file)
    left_out: dict[str, IntArray] = {}
    points = _coordinates(file, VERTEX, 3, left_out)
    faces = file.of(FACE)
    if len(points) == 0 or len(faces) == 0:
        if len(unknown):
            text = " ".join(file.words(int(unknown[0])))
            file.fail(unknown[0], f"got {shortened(text)}, need a statement of an OBJ file")
        missing = "vertex, 'v x y z'" if len(points) == 0 else "face, 'f 1 2 3'"
        raise MeshError(f"{file.name}: need at least one {missing}, got none up to the last line")
    sizes = file.n_words[faces] - 1
    vertex, uv, has_uv = _corner_indices(file, faces)
    statement = np.repeat(faces, sizes)  # (H,)
    indices, wrong = _resolved(file, vertex, statement, VERTEX)
    if wrong.any():
        i = int(wrong.argmax())
        file.fail(statement[i], _out_of_range(file, vertex, statement, VERTEX, i))
    _check_points(file, points, indices)
    tags = _Tags(file, losses)
    texture, rows = _texture(file, losses, statement, np.where(has_uv, uv, 0), has_uv)
    if len(texture) and not has_uv.any():
        left_out["texture coordinates of no face"] = file.of(TEXTURE)
    mesh = mesh_of(
        points,
        sizes,
        indices,
        losses,
        uv=texture,
        rows=rows,
        interpolation=tags.options.pop("uv", INTERPOLATED),
        place=lambda face: file.place(faces[face]),
        lost_tags=tags.lost,
        face_data=_names_of_faces(file, faces, losses),
        **tags.arrays(),
        **tags.options,
    )
    _tell(file, losses, unknown, left_out)
    losses.warn(3)
    return mesh


def _names_of_faces(
    file: Statements, faces: IntArray, losses: Losses
) -> dict[str, NDArray[np.str_]]:
    """What faces belong to, "" before the first statement that says it, by its name."""
    others = file.of(OTHER)
    keywords, found = _keywords(file, others), {}
    for keyword, name in NAMES.items():
        at = others[keywords == keyword]
        known = np.searchsorted(at, faces)
        if known.any():
            names = ["", *map(file.label, at.tolist())]
            if 4 * max(map(len, names)) * len(faces) > max(_NAMES, 64 * len(file.text)):
                longest = max(names, key=len)
                text = f"got the {name} {shortened(longest)} of {len(longest)} letters: "
                losses.add(
                    name, file.place(at[0]), text + f"long ones {name}s take too much memory"
                )
                continue
            found[name] = np.array(names)[known]
    return found


def _unknown_statements(file: Statements) -> IntArray:
    """The statements whose keyword is none of the format."""
    others = file.of(OTHER)
    return others[~np.isin(_keywords(file, others), list(LEFT_OUT))]


def _keywords(file: Statements, statements: IntArray) -> NDArray[np.bytes_]:
    """The first 16 bytes of keywords: (n,)."""
    heads = file.text[file.head[statements, None] + np.arange(16)]  # (n, 16)
    heads[np.cumsum(is_space(heads), axis=1) > 0] = 0
    keywords: NDArray[np.bytes_] = heads.view("S16").ravel()
    return keywords


def _tell(
    file: Statements, losses: Losses, unknown: IntArray, left_out: dict[str, IntArray]
) -> None:
    """Note what is unknown, and what has no place in a cage, such as in `left_out`."""
    if len(unknown):
        names = dict.fromkeys(shortened(file.words(i)[0]) for i in unknown[:1000].tolist())
        count = f"{len(unknown)} statement{'s' if len(unknown) > 1 else ''}"
        text = f"{count} of unknown kinds, {_listed(list(names))}"
        losses.add("unknown", file.place(unknown[0]), text, "ignored")
    others = file.of(OTHER)
    keywords = _keywords(file, others)
    found: dict[str, list[IntArray]] = {what: [at] for what, at in left_out.items()}
    for keyword in np.unique(keywords).tolist():
        at = others[keywords == keyword]
        if keyword == b"s":  # "off" or 0 is no group
            argument = file.text[file.start[file.first[at] + (file.n_words[at] > 1)]]
            at = at[~np.isin(argument, list(b"so0"))]
        if LEFT_OUT.get(keyword):
            found.setdefault(LEFT_OUT[keyword], []).append(at)
    said = []
    for what, places in found.items():
        at = np.sort(np.concatenate(places))
        if len(at):
            count = f"{len(at)} line{'s' if len(at) > 1 else ''}"
            said.append(f"{what} ({count}, first {file.line(at[0])})")
    losses.left_out(said)


def _listed(names: list[str]) -> str:
    return ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")


def _coordinates(
    file: Statements, kind: int, columns: int, lost: dict[str, IntArray]
) -> NDArray[np.float64]:
    """The first numbers of all statements of a kind, filled up with zeros: (n, columns).

    What else vertices have is noted in `lost`.
    """
    statements = file.of(kind)
    counts = file.n_words[statements] - 1
    least = 3 if kind == VERTEX else 1
    odd = np.flatnonzero(counts < least)
    if len(odd):
        what = "a vertex" if kind == VERTEX else "a texture coordinate"
        text = f"got {what} of {counts[odd[0]]} numbers, need {least} or more"
        file.fail(statements[odd[0]], text)
    rows = np.zeros((len(statements), columns))
    first = file.first[statements] + 1
    for count in range(least, columns + 1):
        alike = np.flatnonzero(np.minimum(counts, columns) == count)
        words = (first[alike, None] + np.arange(count)).ravel()
        rows[alike, :count] = file.numbers(words).reshape(-1, count)
    if kind == VERTEX:
        weight = np.flatnonzero(counts == 4)
        values = file.numbers_or_none(first[weight] + 3)
        heavy = weight if values is None else weight[values != 1]
        lost["weights of vertices"] = statements[heavy]
        lost["colours of vertices"] = statements[counts > 4]
    return rows


def _check_points(file: Statements, points: NDArray[np.float64], indices: IntArray) -> None:
    """Refuse a point of a face that is not finite."""
    wrong: NDArray[np.bool_] = ~np.isfinite(points)
    bad = indices[np.asarray(wrong.any(axis=1))[indices]]
    if len(bad):
        vertex = bad.min()
        word = file.first[file.of(VERTEX)[vertex]] + 1 + wrong[vertex].argmax()
        file.fail_at(int(word), "a finite number")


def _corner_indices(
    file: Statements, faces: IntArray
) -> tuple[IntArray, IntArray, NDArray[np.bool_]]:
    """Vertex and texture index of every face corner as in the file, and whether it has the latter.

    A corner is v, v/vt, v//vn or v/vt/vn, where a slash may stand at the end.
    """
    need = "integers as v, v/vt, v//vn or v/vt/vn"
    words = file.arguments(faces)  # (H,)
    low, high = file.start[words], file.end[words]
    slash = np.append(np.flatnonzero(file.text == ord("/")), [len(file.text)] * 3)
    if len(slash) == 3:
        vertex = file.integers_between(words, low, high, need)
        return vertex, np.zeros_like(vertex), np.zeros(len(vertex), dtype=bool)
    number = np.searchsorted(slash, low)
    one, two, three = (np.minimum(slash[number + i], high) for i in range(3))
    if (three < high).any():
        file.fail_at(int(words[(three < high).argmax()]), need)
    found = [file.integers_between(words, low, one, need)]
    for begin, end in (one + 1, two), (two + 1, high):  # of a normal it is but checked
        there = np.flatnonzero(begin < end)
        values = np.zeros_like(low)
        values[there] = file.integers_between(words[there], begin[there], end[there], need)
        found.append(values)
    return found[0], found[1], one + 1 < two


def _resolved(
    file: Statements, given: IntArray, statement: IntArray, kind: int
) -> tuple[IntArray, NDArray[np.bool_]]:
    """Indices from 0 of the file's from 1, or from -1 downwards for the last before the face.

    And which of them are of nothing.
    """
    resolved, count = given - 1, np.count_nonzero(file.kind == kind)
    backwards = np.flatnonzero(given < 0)
    if len(backwards):
        counted = np.cumsum(file.kind == kind)  # (S,)
        resolved[backwards] = counted[statement[backwards]] + given[backwards]
    return resolved, (resolved < 0) | (resolved >= count)


def _out_of_range(file: Statements, given: IntArray, statement: IntArray, kind: int, i: int) -> str:
    """What is wrong with an index."""
    n, before = len(file.of(kind)), int((file.of(kind) < statement[i]).sum())
    what = "vertex" if kind == VERTEX else "texture coordinate"
    need = f"need 1 to {n}, or -{before} to -1 for those before the face"
    return f"got {what} index {given[i]}, {need if n else 'but have none'}"


def _texture(
    file: Statements,
    losses: Losses,
    statement: IntArray,
    given: IntArray,
    has_uv: NDArray[np.bool_],
) -> tuple[NDArray[np.float64], IntArray]:
    """Texture coordinates (k, 2), and of each corner (H,) the row, or -1 without one."""
    if not (file.kind == TEXTURE).any() and not has_uv.any():
        return np.zeros((0, 2)), np.full(len(given), -1)
    try:
        values = _coordinates(file, TEXTURE, 2, {})
    except MeshError as error:
        where, _, text = str(error).removeprefix(f"{file.name}, ").partition(": ")
        losses.add("vt", where, text, "all texture coordinates are left out")
        return np.zeros((0, 2)), np.full(len(given), -1)
    rows, wrong = _resolved(file, given, statement, TEXTURE)
    wrong &= has_uv
    if wrong.any():
        i = int(wrong.argmax())
        more = f"; {wrong.sum() - 1} more like it" if wrong.sum() > 1 else ""
        text = f"{_out_of_range(file, given, statement, TEXTURE, i)}{more}"
        losses.add("vt index", file.place(statement[i]), text)
    return values, np.where(has_uv & ~wrong, rows, -1)


class _Tags:
    """OpenSubdiv's tags, ``t name integers/floats/strings`` and so many arguments of each kind.

    Of several tags on one edge, vertex or face, or for one choice, the last one holds, as there.
    """

    def __init__(self, file: Statements, losses: Losses) -> None:
        self.file, self.losses = file, losses
        self.marked: dict[str, dict[Any, float]] = {"crease": {}, "corner": {}, "hole": {}}
        self.options: dict[str, Any] = {}
        self.statement: dict[tuple[str, Any], int] = {}  # by ("crease", edge) and the like
        unknown: dict[str, int] = {}  # where each unknown tag is first
        for statement in file.of(TAG).tolist():
            _, *words = file.words(statement)
            name = words[0] if words else ""
            if not words:
                losses.add("t", file.place(statement), "got 't', need the name of a tag after it")
            elif name in TAGS:
                try:
                    self.add(statement, name, *_arguments(words))
                except (ValueError, LookupError, OverflowError):
                    text = f"got tag {shortened(' '.join(words))}, need {TAGS[name]}"
                    losses.add(f"t {name}", file.place(statement), text)
            elif name != OBSOLETE:
                unknown.setdefault(shortened(name), statement)
        if unknown:
            first = next(iter(unknown.values()))
            count = f"{len(unknown)} tag{'s' if len(unknown) > 1 else ''}"
            text = f"{count} of unknown kinds, {_listed(list(unknown))}"
            losses.add("unknown tags", file.place(first), text, "ignored")

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
        elif name == "up":
            (self.options[name],) = {"y", "z"}.intersection(strings)
        elif name == "units":
            (metres,) = floats
            if not 0 < metres < np.inf:
                raise ValueError
            self.options[name] = metres
        elif strings or (name == "hole" and floats):
            raise ValueError
        else:
            keys: list[Any] = integers
            if name == "crease":
                keys = [(min(pair), max(pair)) for pair in np.reshape(integers, (-1, 2)).tolist()]
            sharpness = np.broadcast_to([0.0] if name == "hole" else floats, len(keys)).tolist()
            self.marked[name].update(zip(keys, sharpness, strict=True))
            self.statement.update(((name, key), statement) for key in keys)

    def arrays(self) -> dict[str, Any]:
        """Creases, corners and holes as `mesh_of` takes them."""
        names = {kind: np.array(list(marks), dtype=np.int64) for kind, marks in self.marked.items()}
        values = {kind: np.array(list(marks.values())) for kind, marks in self.marked.items()}
        return {
            "creases": (names["crease"].reshape(-1, 2), values["crease"]),
            "corners": (names["corner"], values["corner"]),
            "holes": names["hole"],
        }

    def lost(self, kind: str, names: IntArray, why: str) -> None:
        """Take note of tags that do not fit the mesh."""
        first, more = first_of(names)
        key = tuple(names[0].tolist()) if kind == "crease" else int(names[0])
        text = f"{kind} {first}{why}{more} (counting from 0)"
        self.losses.add(f"{kind} {why}", self.file.place(self.statement[kind, key]), text)


def _arguments(words: list[str]) -> tuple[list[int], list[float], list[str]]:
    """The integers, floats and strings of a tag, given its name, their counts and themselves."""
    n, m, k = map(int, words[1].split("/"))
    given = words[2:]
    if min(n, m, k) < 0 or len(given) != n + m + k:
        raise ValueError
    integers = np.array(list(map(int, given[:n])), dtype=np.int64)
    return integers.tolist(), list(map(float, given[n : n + m])), given[n + m :]
