"""Checks of what a cage is made from: errors say what was wrong, where, and what is needed."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from numbers import Integral, Rational
from typing import Any, TypeAlias, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf import masked
from limitsurf.cage.connectivity import Connectivity
from limitsurf.cage.faces import Faces, IntArray, equal_sizes
from limitsurf.numbers import Numbers

FacesLike: TypeAlias = Faces | ArrayLike | Sequence[ArrayLike] | tuple[ArrayLike, ArrayLike]
Channel: TypeAlias = tuple[NDArray[Any], IntArray, str]

INTERPOLATION = ("none", "corners_only", "corners_plus1", "corners_plus2", "boundaries", "all")

T = TypeVar("T")


class MeshError(ValueError):
    """A broken cage; the message names the first culprit and says how many more there are.

    ``culprits`` holds what it is about, as pairs such as ``("face", 3)`` or ``("crease", (0, 1))``.

    Examples
    --------
    >>> import limitsurf as ls
    >>> try:
    ...     ls.Mesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 7]])
    ... except ls.MeshError as error:
    ...     print(error.culprits)
    (('face', 0),)
    """

    culprits: tuple[tuple[str, Any], ...] = ()


def users_level() -> int:
    """The `stacklevel`, for a warning of the caller, of the first line outside of the package."""
    level, frame = 1, sys._getframe(1)
    package = __name__.partition(".")[0]
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] == package:
        level, frame = level + 1, frame.f_back
    return level


def count(n: int, noun: str) -> str:
    """So many things by name, such as "1 face" and "2 vertices"."""
    return f"{n} {noun if n == 1 else noun.replace('vertex', 'vertice') + 's'}"


def check(broken: ArrayLike, describe: Callable[[int], tuple[Any, ...]]) -> None:
    """Raise if any is true; ``describe`` gives the message and the culprits for the first one."""
    found = np.flatnonzero(broken)
    if len(found):
        message, *culprits = describe(int(found[0]))
        error = MeshError(message + (f"; {len(found) - 1} more like it" if len(found) > 1 else ""))
        error.culprits = tuple(culprits)
        raise error


def choice(value: T, name: str, allowed: tuple[T, ...]) -> T:
    """The value of an argument, which must be one of those allowed."""
    if value not in allowed:
        raise ValueError(f"{name}: got {value!r}, need one of {', '.join(map(repr, allowed))}")
    return value


def complete(values: T, what: str) -> T:
    """The values, none of which may be masked."""
    wrong = masked.refusal(values, what)
    if wrong:
        raise MeshError(wrong)
    return values


def units(value: Any) -> float | None:
    """A length in metres, or None."""
    if value is None:
        return None
    number = isinstance(value, (int, float, np.integer, np.floating, Rational))
    if not number or isinstance(value, bool) or not 0 < value < math.inf:
        raise ValueError(f"units: got {value!r}, need a positive number of metres, or None")
    return float(value)


def numbers(values: Numbers, row: str, prefix: str = "", gaps: bool = False) -> NDArray[Any]:
    """A copy of coordinates as float64 or objects; messages call an entry a ``row``.

    All are finite, or NaN if there may be gaps.
    """
    values = complete(values, f"{prefix}coordinates")
    try:
        array = np.array(values)
    except ValueError as error:
        raise MeshError(f"{prefix}coordinates do not form an array: {error}") from None
    if array.ndim == 0 or len(array) == 0:
        raise MeshError(f"{prefix}need at least one {row}, got coordinates of shape {array.shape}")
    need = f"{prefix}coordinates must be real numbers"
    if array.dtype.kind not in "iufO":
        raise TypeError(f"{need}, got an array of {array.dtype}")
    if array.dtype == object:
        wrong = np.frompyfunc(_is_no_number, 1, 1)(array).astype(bool)
        if wrong.any():
            raise TypeError(f"{need}, got {array[wrong][0]!r}")
        infinite = np.frompyfunc(_is_infinite_float, 1, 1)(array).astype(bool)
        if gaps:
            infinite &= (array == array).astype(bool)
    else:
        array = array.astype(np.float64, copy=False)
        infinite = np.isinf(array) if gaps else ~np.isfinite(array)
        if not infinite.any():
            return array
    check(
        infinite.reshape(len(array), -1).any(axis=1),
        lambda i: (f"{prefix}{row} {i}: coordinate {array[infinite][0]} is not finite",),
    )
    return array


def _is_no_number(value: Any) -> bool:
    return value is None or isinstance(value, (str, bytes, bool, complex, Sequence))


def _is_infinite_float(value: Any) -> bool:
    return isinstance(value, (float, np.floating)) and not math.isfinite(value)


def checked_integer(name: str, value: Any, least: int | None = None) -> int:
    """The value of an argument, which must be an integer, at least so large."""
    whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not whole or (least is not None and value < least):
        need = "" if least is None else f" >= {least}"
        raise ValueError(f"{name} must be an integer{need}, got {value!r}")
    return int(value)


def checked_number(
    name: str,
    value: Any,
    *,
    above: float | None = None,
    least: float | None = None,
    below: float | None = None,
) -> float:
    """The value of an argument, which must be a number, not NaN, and within bounds.

    A `below` of infinity asks for finite ones.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise TypeError(f"{name} must be a number, got {type(value).__name__}")
    try:
        number = float(value)
    except OverflowError:
        digits = 1 + int(int(value).bit_length() * math.log10(2))
        raise ValueError(
            f"{name} must be a number that float64 holds, got an integer of some {digits} digits"
        ) from None
    need = []
    if above is not None:
        need.append((number > above, f"above {above:g}"))
    if least is not None:
        need.append((number >= least, f"{least:g} or more"))
    if below is not None:
        finite = math.isinf(below)
        within = math.isfinite(number) if finite else number < below
        need.append((within, "finite" if finite else f"below {below:g}"))
    if math.isnan(number) or not all(right for right, _ in need):
        wanted = " and ".join(text for _, text in need) or "no NaN"
        raise ValueError(f"{name} must be {wanted}, got {value}")
    return number


def integers(values: Any, what: str) -> IntArray:
    """A copy of ``values`` as int64; an empty list, whose type numpy cannot know, passes."""
    values = complete(values, what)
    try:
        array = np.array(values)
    except ValueError as error:
        raise MeshError(f"{what} do not form an array: {error}") from None
    kind, flat = array.dtype.kind, array.ravel()
    if kind == "O" and all(isinstance(x, Integral) and not isinstance(x, bool) for x in flat):
        large: Any = [x for x in flat if not -(2**63) <= x < 2**63]
    elif array.size and kind not in "iu":
        raise TypeError(f"{what} must be integers, got {array.dtype} such as {flat[0]}")
    else:
        large = flat[flat >= 2**63][:1] if array.dtype == np.uint64 else ()
    if len(large):
        raise MeshError(f"{what}: got {large[0]}, which is beyond any that there can be, 2^63 - 1")
    return array.astype(np.int64, copy=False)


def face_arrays(faces: FacesLike) -> tuple[IntArray, IntArray]:
    """``sizes`` and ``indices`` from any of the ways to give faces."""
    if isinstance(faces, Faces):
        faces = faces.sizes, faces.indices
    elif not isinstance(faces, np.ndarray) and hasattr(faces, "__array__"):  # as tables of pandas
        faces = np.asarray(faces)
    if isinstance(faces, np.ndarray) and faces.dtype != object:
        if faces.ndim != 2:
            raise MeshError(f"faces: got an array of shape {faces.shape}, need (n_faces, k)")
        indices = integers(faces, "vertex indices of faces").reshape(-1)
        sizes = equal_sizes(len(faces), faces.shape[1])
    elif isinstance(faces, tuple) and len(faces) == 2 and not isinstance(faces[0], tuple):
        sizes = integers(faces[0], "face sizes")
        indices = integers(faces[1], "vertex indices of faces")
        _check_pair(sizes, indices)
    else:
        try:
            rows = list(cast(Sequence[Sequence[int]], faces))
            if any(isinstance(row, np.ma.MaskedArray) for row in rows):
                rows = [complete(x, f"vertices of face {f}") for f, x in enumerate(rows)]
            sizes = np.array(list(map(len, rows)), dtype=np.int64)
            indices = integers(list(chain.from_iterable(rows)), "vertex indices of faces")
        except TypeError as error:
            raise TypeError(
                "faces: need an (m, k) integer array, a list of index sequences or a pair "
                f"(sizes, indices); {error}"
            ) from None
        if indices.ndim != 1:
            raise MeshError("faces: need index sequences, got sequences nested deeper")
    if len(sizes) == 0:
        raise MeshError("need at least one face, got none")
    return sizes, indices


def check_sizes(sizes: IntArray) -> None:
    """Every face has three or more corners."""
    check(
        sizes < 3,
        lambda f: (f"face {f} has {count(sizes[f], 'corner')}, need at least 3", ("face", f)),
    )


def _check_pair(sizes: IntArray, indices: IntArray) -> None:
    """Sizes of faces, and as many indices; one size after the other, since sums may wrap."""
    need = "need two 1-d arrays with sum(sizes) == len(indices) (two faces are a list)"
    if sizes.ndim != 1 or indices.ndim != 1:
        shapes = f"{sizes.shape} and {indices.shape}"
        raise MeshError(f"faces as a pair (sizes, indices): got shapes {shapes}; {need}")
    check_sizes(sizes)
    check(
        sizes > len(indices),
        lambda f: (f"face {f} has {sizes[f]} corners, of {len(indices)} indices", ("face", f)),
    )
    if sizes.sum() != len(indices):
        raise MeshError(
            f"faces as a pair (sizes, indices): sum(sizes) = {sizes.sum()}, len(indices) = "
            f"{len(indices)}; {need}"
        )


def sharpness(values: Any, what: str, names: IntArray) -> NDArray[Any]:
    """Validated sharpness, float64 or objects, one for each of ``names``, numbers or pairs."""
    array = np.array(complete(values, f"sharpness of {what}s"))
    array = np.zeros(0) if array.shape == (0,) else array
    if array.shape != (len(names),):
        raise MeshError(f"{what}s: got sharpness of shape {array.shape}, need ({len(names)},)")
    if array.dtype.kind not in "iufO":
        raise TypeError(f"{what}s: sharpness must be real numbers, got {array.dtype}")
    if array.dtype != object:
        array = array.astype(np.float64, copy=False)
    else:
        wrong = [x for x in array if not isinstance(x, (Rational, float, np.floating, np.integer))]
        if wrong:
            raise TypeError(
                f"{what}s: sharpness must be Fractions, ints or floats, got {wrong[0]!r}"
            )
    check(
        ~(array >= 0).astype(bool),  # so is NaN
        lambda i: (
            f"{what} {named(names[i])}: sharpness {array[i]} is not in [0, inf]",
            (what, named(names[i])),
        ),
    )
    return array


def named(number: IntArray) -> int | tuple[int, ...]:
    """A vertex or face, or the vertices of an edge, for messages."""
    return tuple(number.tolist()) if number.ndim else int(number)


def tagged(given: Any, what: str) -> tuple[Any, Any]:
    """Keys and sharpness of a mapping or a pair."""
    if given is None:
        return (), ()
    if isinstance(given, Mapping):
        return list(given), list(given.values())
    if isinstance(given, (tuple, list)) and len(given) == 2:
        return given[0], given[1]
    raise TypeError(f"{what}s: need a mapping or a pair of arrays, got {type(given).__name__}")


def check_range(indices: IntArray, what: str, end: int) -> None:
    """All indices are less than ``end``."""
    if indices.ndim != 1:
        raise MeshError(f"{what}s: got indices of shape {indices.shape}, need (n,)")
    check(
        (indices < 0) | (indices >= end),
        lambda i: (
            f"{what} {indices[i]} is out of range, need 0 to {end - 1}",
            (what, named(indices[i])),
        ),
    )


def distinct_order(keys: IntArray, what: str, names: IntArray) -> IntArray:
    """The order that sorts ``keys``, of which no two may be equal."""
    order = np.argsort(keys, kind="stable")

    def twice(i: int) -> tuple[Any, ...]:
        name = named(names[order[i + 1]])
        return f"{what} {name} is given more than once", (what, name)

    check(np.diff(keys[order]) == 0, twice)
    return order


def check_faces(cage: Connectivity) -> None:
    """Every face has three or more corners, at vertices that exist."""
    check_sizes(cage.sizes)

    def missing(h: int) -> tuple[Any, ...]:
        face, vertex = int(cage.corner_face[h]), cage.indices[h]
        reason = "negative" if vertex < 0 else "out of range"
        need = f"need 0 to {cage.n_vertices - 1}"
        return f"face {face}: vertex index {vertex} is {reason}, {need}", ("face", face)

    if cage.indices.min() < 0 or cage.indices.max() >= cage.n_vertices:
        check((cage.indices < 0) | (cage.indices >= cage.n_vertices), missing)


def distinct_corners(cage: Connectivity, scheme: str) -> None:
    """No triangle has a vertex twice: what is around it would not be told apart by faces."""
    if not cage.repeats:
        return
    corners = cage.indices.reshape(-1, 3)

    def wrong(face: int) -> tuple[Any, ...]:
        listed = ", ".join(map(str, corners[face].tolist()))
        text = f"face {face} has a vertex twice ({listed}): scheme {scheme!r} needs"
        return f"{text} three different ones; leave the face out", ("face", face)

    check((np.diff(np.sort(corners, axis=1), axis=1) == 0).any(axis=1), wrong)


def crease_tags(cage: Connectivity, given: Any) -> tuple[IntArray, NDArray[Any]]:
    """Edges (c, 2), rows ascending and in order, and their sharpness, from a mapping or a pair."""
    keys, values = tagged(given, "crease")
    ends = integers(keys, "vertices of creases") if len(keys) else np.zeros((0, 2), dtype=np.int64)
    if ends.ndim != 2 or ends.shape[1] != 2:
        raise MeshError(f"creases: got edges of shape {ends.shape}, need (c, 2)")
    names = ends
    sharp = sharpness(values, "crease", names)
    if len(names) == 0:
        return ends, sharp
    ends = np.sort(ends, axis=1)
    edge = cage.edge_numbers(ends).clip(max=cage.n_edges - 1)
    check(
        (cage.edges[edge] != ends).any(axis=1),
        lambda i: (
            f"crease {named(names[i])}: the mesh has no such edge",
            ("crease", named(names[i])),
        ),
    )
    order = distinct_order(edge, "crease", names)
    return ends[order], sharp[order]


def corner_tags(cage: Connectivity, given: Any) -> tuple[IntArray, NDArray[Any]]:
    """Vertices, ascending, and their sharpness, from a mapping or a pair."""
    keys, values = tagged(given, "corner")
    vertices = integers(keys, "vertices of corners")
    check_range(vertices, "corner", cage.n_vertices)
    sharp = sharpness(values, "corner", vertices)
    order = distinct_order(vertices, "corner", vertices)
    return vertices[order], sharp[order]


def hole_tags(cage: Connectivity, given: Any) -> IntArray:
    """Faces, ascending."""
    faces = integers(() if given is None else given, "holes")
    check_range(faces, "hole", cage.n_faces)
    return faces[distinct_order(faces, "hole", faces)]


def channel(cage: Connectivity, name: str, given: Any) -> Channel:
    """Values, a row of them for each corner, and how they are interpolated."""
    if not isinstance(given, (tuple, list)) or len(given) != 3:
        raise TypeError(f"channel {name!r}: need (values, face_indices, interpolation)")
    values = numbers(given[0], "row", f"channel {name!r}: ", gaps=True)
    rows = integers(given[1], f"channel {name!r}: face_indices")
    if rows.shape != (cage.n_corners,):
        raise MeshError(
            f"channel {name!r}: got face_indices of shape {rows.shape}, need ({cage.n_corners},)"
        )

    def missing(h: int) -> tuple[Any, ...]:
        face = int(cage.corner_face[h])
        need = f"need 0 to {len(values) - 1}"
        return f"channel {name!r}: face {face} has index {rows[h]}, {need}", ("face", face)

    check((rows < 0) | (rows >= len(values)), missing)
    interpolation = choice(given[2], f"channel {name!r}: interpolation", INTERPOLATION)
    return values, rows, interpolation


def face_data(cage: Connectivity, name: Any, given: Any) -> NDArray[Any]:
    """A copy of values, one for each face or a row of numbers for each; texts as such."""
    if not isinstance(name, str):
        raise TypeError(f"face_data: names must be texts, got {name!r}")
    try:
        values = np.array(complete(given, f"face_data {name!r}"))
    except ValueError as error:
        raise MeshError(f"face_data {name!r}: values do not form an array: {error}") from None
    if values.dtype == object and all(isinstance(x, str) for x in values.ravel()):
        values = values.astype(str)
    if values.dtype.kind not in "biufU":
        raise TypeError(f"face_data {name!r}: need numbers or texts, got {values.dtype}")
    if values.dtype.kind == "f" and values.dtype.itemsize not in (4, 8):
        values = values.astype(np.float64)
    of_numbers = values.ndim == 2 and values.shape[1] > 0 and values.dtype.kind != "U"
    if not (values.ndim == 1 or of_numbers) or len(values) != cage.n_faces:
        need = f"need ({cage.n_faces},), a number or text a face, or ({cage.n_faces}, k) numbers"
        raise MeshError(f"face_data {name!r}: got shape {values.shape}, {need}")
    return values
