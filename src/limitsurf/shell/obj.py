"""Cages and tessellations from and to OBJ files, with OpenSubdiv's tags."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from itertools import chain
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from limitsurf.mesh import INTERPOLATION, Mesh, MeshError
from limitsurf.shell.polygons import IntArray, polygons, texture

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


def statements(x: Mesh | Tessellation) -> Iterator[str]:
    """The text of an OBJ file, piece by piece; what cannot be written raises before the first."""
    tags = _tag_statements(x) if isinstance(x, Mesh) else []
    shape = polygons(x)
    uv, place = shape.channels.get("uv", (np.zeros((0, 2)), None))
    normal = shape.normal_indices if len(shape.normals) else None
    columns = [(rows + 1).tolist() for rows in (shape.indices, place, normal) if rows is not None]
    form = "{}//{}" if place is None and normal is not None else "/".join(["{}"] * len(columns))
    before = np.full(len(shape.indices), " ", dtype=object)
    before[shape.offsets[:-1]] = "\nf "
    return chain(
        map("v {!r} {!r} {!r}\n".format, *shape.points.T.tolist()),
        map("vt {!r} {!r}\n".format, *uv.T.tolist()),
        map("vn {!r} {!r} {!r}\n".format, *shape.normals.T.tolist()),
        map(f"{{}}{form}".format, before.tolist(), *columns),
        ["\n"],
        tags,
    )


def _tag_statements(mesh: Mesh) -> Iterator[str]:
    """OpenSubdiv's tags, and ours, of a cage."""
    scheme = mesh.scheme
    if scheme is not None and not (isinstance(scheme, str) and re.fullmatch(r"[\w.+-]+", scheme)):
        raise ValueError(f"scheme: an OBJ file holds a name of one word, got {scheme!r}")
    options = {"boundary": mesh.boundary, "creasing": mesh.creasing, "triangles": mesh.triangles}
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


class Statements:
    """The bytes of a text file, cut by vectorised scans into statements, and these into words.

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


def parse(name: str, data: bytes, *, strict: bool = False) -> Mesh:
    """The cage of the bytes of a file; its name is for messages."""
    file = Statements(name, data)
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


def _unknown_keywords(file: Statements) -> dict[str, int]:
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
    file: Statements, kind: int, columns: int, allowed: tuple[int, ...]
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
    file: Statements, faces: IntArray
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
    file: Statements, given: IntArray, statement: IntArray, kind: int, what: str
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

    def __init__(self, file: Statements) -> None:
        self.marked: dict[str, dict[Any, float]] = {"crease": {}, "corner": {}, "hole": {}}
        self.options: dict[str, Any] = {}
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
