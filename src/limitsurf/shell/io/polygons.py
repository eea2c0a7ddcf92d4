"""What files and other libraries hold of cages and tessellations: polygons, normals, "uv"."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Container, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf import memory
from limitsurf.cage.checks import MeshError, users_level
from limitsurf.cage.mesh import CHOICES, Mesh
from limitsurf.scheme import SCHEMES
from limitsurf.scheme.scheme import Scheme
from limitsurf.shell.io.losses import Losses, finite_points, tagged, with_gaps

if TYPE_CHECKING:
    from limitsurf.query import Polygons, Tessellation
    from limitsurf.surface import LimitSurface

IntArray: TypeAlias = NDArray[np.int64]
INTERPOLATED = "corners_plus1"  # how channels are interpolated of which a file does not say it

# formats that have units and an up axis, which polygons are scaled and turned to
OWN_MEASURES = (".obj", ".glb", ".gltf", ".dae", ".3mf")


def float_points(mesh: Mesh) -> NDArray[np.float64]:
    """A copy of the points in space as float64, (n_vertices, 3).

    Raises
    ------
    ValueError
        Points of another shape, or too large.
    """
    if mesh.points.shape[1:] != (3,):
        raise ValueError(f"got points of shape {mesh.points.shape}, need (n_vertices, 3)")
    try:
        points: NDArray[np.float64] = mesh.points.astype(np.float64)
    except OverflowError as error:
        raise ValueError(f"a coordinate is beyond float64: {error}") from None
    return points


def texture(x: Mesh | Tessellation) -> str | None:
    """The channel that is texture coordinates, of values (k, 2).

    "uv", or else "st" as USD calls it, or else the only one of that shape.
    """
    pairs = [name for name, channel in x.channels.items() if channel[0].shape[1:] == (2,)]
    found = [name for name in ("uv", "st") if name in pairs] or pairs
    return found[0] if found and (found[0] in ("uv", "st") or len(pairs) == 1) else None


def polygons(x: Mesh | Tessellation, *, uv: bool = True, every: bool = False) -> Polygons:
    """A cage or tessellation with finite normals, its texture coordinates the one channel "uv".

    A cage has no normals. With `every`, other channels are kept too, by their own names.

    Raises
    ------
    ValueError
        Points that are not of shape (n_vertices, 3), or no polygon.
    TypeError
        What is neither a cage nor a tessellation.
    """
    from limitsurf.query import Polygons, Tessellation

    if isinstance(x, Mesh):
        points, normals, rows = float_points(x), np.zeros((0, 3)), np.zeros(0, dtype=np.int64)
    elif isinstance(x, Tessellation):
        if not len(x.sizes):
            raise ValueError("the tessellation has no polygon: no face has a limit")
        points, normals, rows = x.points, _finite_normals(x), x.normal_indices
    else:
        raise no_polygons(x)
    name = texture(x) if uv else None
    kept = {}
    if every:
        kept = {k: (v, rows) for k, (v, rows, *_) in x.channels.items() if k not in (name, "uv")}
    if name is not None:
        values, where, *_ = x.channels[name]
        kept["uv"] = values.astype(np.float64), where
    return Polygons(points, x.sizes, x.indices, normals, rows, kept, face_data=x.face_data)


def no_polygons(x: Any) -> TypeError:
    """What to say of anything that is neither a cage nor a tessellation."""
    advice = ""
    if type(x).__name__ == "LimitSurface":
        advice = ": its cage is surface.mesh, polygons on it are ls.tessellate(surface, n)"
    if type(x).__name__ == "BezierExtraction":
        advice = ": operators are written as .npz"
    return TypeError(f"need a Mesh or a Tessellation, got {type(x).__name__}{advice}")


def tessellated(x: Any, n: int | None, *, every: bool = False) -> Any:
    """A surface as n x n polygons a face, 8 x 8 if nothing is said; all else as it is.

    It has the channel that is texture coordinates, or all with `every`.
    """
    from limitsurf.query import tessellate
    from limitsurf.surface import LimitSurface

    if isinstance(x, LimitSurface):
        name = texture(x.mesh)
        wanted = [*x.mesh.channels] if every else [] if name is None else [name]
        channels = known_channels(x, wanted)
        return tessellate(x, 8 if n is None else n, channels=channels)
    if n is not None:
        raise ValueError(f"n is for a LimitSurface, got {type(x).__name__}")
    return x


def known_channels(surface: LimitSurface, names: Sequence[str]) -> list[str]:
    """Those of some channels that the scheme has a rule for; a warning of the others."""
    found = []
    for name in names:
        try:
            surface.of_channel(name)
        except ValueError as error:
            warnings.warn(f"left out: {error}", stacklevel=users_level())
        else:
            found.append(name)
    return found


def warn_of_loss(
    name: str,
    kind: str,
    x: Mesh | Tessellation,
    *,
    uv: bool,
    every: bool = False,
    normals: bool = True,
    loose: bool = True,
    tags: bool = False,
    data: Container[str] = (),
) -> None:
    """Warn of all that a file cannot hold.

    `uv`, `every`, `normals`, `loose` and `tags` say whether it holds texture coordinates, all
    channels, normals, vertices of no face, and the tags of a cage with its choices; `data` which
    data of faces.
    """
    kept = texture(x) if uv else None
    lost = []
    scheme = x.scheme if isinstance(x, Mesh) else None
    own = isinstance(scheme, Scheme) and scheme.name not in SCHEMES
    if isinstance(x, Mesh) and not tags:
        counts = {"creases": x.creases[0], "corners": x.corners[0], "holes": x.holes}
        lost = [what for what, found in counts.items() if len(found)]
    elif not isinstance(x, Mesh) and not normals and len(x.normals):
        lost = ["normals"]
    lost += [
        f"channel {name!r}" for name in x.channels if name != kept and not (every and name != "uv")
    ]
    lost += [f"data of faces {name!r}" for name in x.face_data if name not in data]
    if kept not in (None, "uv", "st"):
        lost.append(f"the name of channel {kept!r}")
    if isinstance(x, Mesh) and not tags:
        lost += [what for what in CHOICES[1:4] if getattr(x, what) is not None]
        lost += ["scheme"] if x.scheme not in (None, "none", "catmull-clark") and not own else []
        if kept is not None and x.channels[kept][2] != INTERPOLATED:
            lost.append(f"the interpolation of channel {kept!r}")
    if isinstance(scheme, Scheme) and own:
        lost.append(f"scheme {scheme.name!r}, which is your own: give it as scheme= again")
    if kind not in OWN_MEASURES:
        lost += [f"units ({x.units:g} m)"] if x.units is not None else []
        lost += [f"up axis ({x.up})"] if x.up is not None else []
    if isinstance(x, Mesh) and not loose:
        unused = int((x.vertex_faces == 0).sum())
        lost += [f"vertices of no face ({unused})"] if unused else []
    if lost:
        text = f"{name}: a file of type {kind} cannot hold everything, left out: "
        warnings.warn(text + ", ".join(lost), stacklevel=users_level())


def without_gaps(name: str, kind: str, shape: Polygons) -> Polygons:
    """Polygons with zeros for texture coordinates that are NaN, which is warned of.

    It is for files that hold texture coordinates of all faces or none.
    """
    if "uv" not in shape.channels:
        return shape
    values, rows = shape.channels["uv"]
    missing = np.isnan(values).any(axis=1)
    if not missing[rows].any():
        return shape
    faces = int(np.logical_or.reduceat(missing[rows], shape.offsets[:-1]).sum())
    text = f"{name}: a file of type {kind} holds texture coordinates of all faces or none: "
    text += f"{_faces(faces, len(shape.sizes))} without get zeros"
    warnings.warn(text, stacklevel=users_level())
    kept = {"uv": (np.where(missing[:, None], 0, values), rows)}
    return replace(shape, channels=kept)


def warn_of_cuts(name: str, kind: str, x: Mesh | Tessellation) -> None:
    """Warn of faces of a cage that a file of triangles cannot hold."""
    cut = int((x.sizes > 3).sum()) if isinstance(x, Mesh) else 0
    if cut:
        text = f"{name}: a file of type {kind} holds triangles only: faces of more than 3 corners, "
        text += f"{cut} of {len(x.sizes)}, are cut, which changes the limit surface of the cage"
        warnings.warn(text, stacklevel=users_level())


def warn_of_rounding(
    name: str,
    kind: str,
    x: Mesh | Tessellation,
    points: NDArray[np.float64],
    kept: NDArray[Any],
) -> None:
    """Warn of points (V, 3) that differ, but not as a file keeps them, `kept` (V, 3)."""
    first, number = distinct(kept)
    apart = np.abs(points - points[first[number]]).max(axis=1)
    # where pieces of a surface touch, points differ by the rounding of their evaluation
    ulps = 0 if isinstance(x, Mesh) else 4
    lost = points[apart > ulps * np.finfo(np.float64).eps * np.abs(points).max()]
    if len(lost):
        count = len(distinct(lost)[0])
        text = f"{name}: {count} of {len(first) + count} distinct points become equal to others, "
        text += f"rounded as in a file of type {kind}: .obj, .ply and .vtp keep float64"
        warnings.warn(text, stacklevel=users_level())


def distinct(points: NDArray[Any]) -> tuple[IntArray, IntArray]:
    """The first of all equal points (V, 3) in order, and the place in these of each point (V,)."""
    order = np.lexsort(points.T)
    ordered = points[order]
    new = np.append(True, (ordered[1:] != ordered[:-1]).any(axis=1))
    first = order[new]  # sorting keeps the order of equal ones
    number = np.empty(len(points), dtype=np.int64)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    number[order] = rank[np.cumsum(new) - 1]
    return np.sort(first), number


def close(points: NDArray[np.float64], tolerance: float) -> tuple[IntArray, IntArray]:
    """As `distinct`, of points (V, d) no farther apart than that, and of chains of such points."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    n, what = len(points), ("pairs of close vertices", "choose a smaller tolerance")
    # those in one cell of such a grid are close: where they are many, counting them takes long
    with np.errstate(over="ignore", invalid="ignore"):
        cell = np.floor(points / (tolerance / max(points.shape[1], 1) ** 0.5))
    _, crowd = np.unique(cell, axis=0, return_counts=True)
    memory.refuse_beyond(int((crowd * (crowd - 1) // 2).sum()), 48, *what)
    tree = KDTree(points)
    memory.refuse_beyond(int(tree.count_neighbors(tree, tolerance)), 48, *what)
    ends = tree.query_pairs(tolerance, output_type="ndarray").T
    graph = coo_array((np.ones(ends.shape[1], dtype=bool), tuple(ends)), shape=(n, n))
    _, label = connected_components(graph, directed=False)
    _, first, number = np.unique(label, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(first), dtype=np.int64)
    rank[order] = np.arange(len(first))
    return first[order], rank[number]


def face_number(face: int) -> str:
    """The place of a face in a file where it has no line."""
    return f"face {face}"


def mesh_of(
    points: NDArray[Any],
    sizes: NDArray[Any],
    indices: NDArray[Any],
    losses: Losses,
    *,
    uv: NDArray[Any] | None = None,
    rows: NDArray[Any] | None = None,
    interpolation: str = INTERPOLATED,
    merge: bool = False,
    place: Callable[[int], str] = face_number,
    lost_tags: Callable[[str, IntArray, str], None] | None = None,
    **tags: Any,
) -> Mesh:
    """A cage of polygons; `uv` becomes the channel "uv", with the rows (C,) of corners.

    Without rows it is by point; a row of -1, or a value that is not finite, is none. What is left
    out or mended is told to `losses`, with the place of the first face. With `lost_tags` the tags
    are of a file, as for `losses.tagged`, which tells it of those that do not fit.

    With `merge`, points of equal coordinates become one: formats that keep texture coordinates or
    normals by point repeat points where these have a seam. A corner like the one before it is left
    out, one at the same point with other texture coordinates stays, but in merged triangles.
    """
    points = np.asarray(points)
    sizes, indices = np.asarray(sizes, np.int64), np.asarray(indices, np.int64)
    rows = indices if rows is None or uv is None else np.asarray(rows, np.int64)
    if merge and len(points) and _in_range(indices, points):
        first, number = distinct(points)
        if len(first) < len(points):
            points, indices = points[first], number[indices]
    if len(sizes) and not (sizes.min() >= 0 and sizes.sum() == len(indices)):
        return Mesh(points, (sizes, indices))  # which says what is wrong
    faces, kept = sound_faces(sizes, _corners(sizes, indices, rows, merge), losses, place)
    if len(faces) and not faces.any():
        text = "need a face of 3 corners or more that differ, got none"
        raise MeshError(f"{losses.name}: {text}, the first is {place(0)}")
    if not kept.all() or not faces.all():
        face = np.repeat(np.arange(len(sizes)), sizes)[kept]
        sizes = np.bincount(face, minlength=len(faces))[faces]
        indices, rows = indices[kept], rows[kept]
        place = _renumbered(place, np.flatnonzero(faces))
        tags["face_data"] = {
            name: _kept(values, faces) for name, values in (tags.get("face_data") or {}).items()
        }
        if tags.get("holes") is not None:
            tags["holes"] = renumbered_holes(tags["holes"], faces)

    def lost(vertices: IntArray, why: str) -> None:
        more = f"; {len(vertices) - 1} more like it" if len(vertices) > 1 else ""
        losses.add("points", "", f"vertex {vertices[0]}{why}{more}", "put where another one is")

    if len(indices) and not _in_range(indices, points):
        return Mesh(points, (sizes, indices))  # which says what is wrong
    points = finite_points(points, indices, lost)
    if uv is not None and len(uv) and len(indices) and rows.max() < len(uv):
        values, found = textured(uv, rows, sizes, losses, place)
        if (found < len(uv)).any():
            channels = {"uv": (values, found, interpolation)}
            tags["channels"] = {**channels, **tags.get("channels", {})}
    if lost_tags is None:
        return Mesh(points, (sizes, indices), **tags)
    return tagged(Mesh(points, (sizes, indices)), lost_tags, **tags)


def _corners(sizes: IntArray, indices: IntArray, rows: IntArray, merge: bool) -> IntArray:
    """Numbers (C,) of corners, different for different vertices or texture coordinates."""
    if rows is indices:
        return indices
    folded = np.repeat((sizes == 3) & merge, sizes)  # triangles have one corner at a vertex
    return indices * (int(rows.max(initial=0)) + 2) + np.where(folded, 0, rows + 1)


def _in_range(indices: IntArray, points: NDArray[Any]) -> bool:
    """Whether there are indices, and all of them of points."""
    return len(indices) > 0 and bool(0 <= indices.min() <= indices.max() < len(points))


def _kept(values: Any, faces: NDArray[np.bool_]) -> Any:
    """Values of the faces that stay; as they are if they are not of all, which `Mesh` says."""
    array = np.asarray(values)
    return array[faces] if array.shape[:1] == faces.shape else values


def renumbered_holes(holes: Any, kept: NDArray[np.bool_]) -> IntArray:
    """Holes as the faces that are kept are numbered; those that are no faces stay as they are."""
    holes = np.asarray(holes, np.int64)
    there = (holes >= 0) & (holes < len(kept))
    number = np.where(kept, np.cumsum(kept) - 1, -1)[np.where(there, holes, 0)]
    found: IntArray = np.where(there, number, holes)[~there | (number >= 0)]
    return found


def _renumbered(place: Callable[[int], str], number: IntArray) -> Callable[[int], str]:
    return lambda face: place(int(number[face]))


def sound_faces(
    sizes: IntArray, indices: IntArray, losses: Losses, place: Callable[[int], str] = face_number
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """The faces (F,) and corners (C,) that stay: no corner like the one before, three to a face.

    A last corner that repeats the first, as in "1 2 3 4 1", is like the one before that.
    """
    kept = np.ones(len(indices), dtype=bool)
    filled = np.flatnonzero(sizes)
    left = np.zeros_like(sizes)
    if len(filled):
        first = (np.cumsum(sizes) - sizes)[filled]  # corner of each face that has some
        kept[1:] = indices[1:] != indices[:-1]
        kept[first] = True
        last = np.maximum.reduceat(np.where(kept, np.arange(len(indices)), 0), first)
        kept[last[(indices[last] == indices[first]) & (last != first)]] = False
        left[filled] = np.add.reduceat(kept.astype(np.int64), first)
    faces: NDArray[np.bool_] = np.asarray(left >= 3)
    again, small = np.flatnonzero(faces & (left < sizes)), np.flatnonzero(~faces)
    for kind, found, what, done in (
        ("repeated", again, "a corner twice in succession", "read without the repetition"),
        ("small", small, "less than 3 corners that differ", "left out"),
    ):
        if len(found):
            text = f"{_faces(len(found), len(sizes))} with {what}"
            losses.add(kind, place(int(found[0])), text, done)
    return faces, kept & np.repeat(faces, sizes)


def _faces(number: int, total: int) -> str:
    return f"{number} of {total} face{'' if total == 1 else 's'}"


def textured(
    values: NDArray[Any],
    rows: IntArray,
    sizes: IntArray,
    losses: Losses,
    place: Callable[[int], str] = face_number,
) -> tuple[NDArray[np.float64], IntArray]:
    """Texture coordinates (k + 1, 2) and rows (C,), where a row may be -1: it has none.

    A face with a corner that has none, or one that is not finite, has none at all corners: the
    last value, NaN.
    """
    values = np.array(values, dtype=np.float64)
    start = np.cumsum(sizes) - sizes
    broken = ~np.isfinite(values).all(axis=1)
    values[broken] = np.nan
    used = np.where(rows >= 0, broken[rows], False)
    without = np.logical_or.reduceat(rows < 0, start)
    infinite = np.logical_or.reduceat(used, start)
    if infinite.any():
        text = f"{_faces(infinite.sum(), len(sizes))} with texture coordinates that are not finite"
        losses.add("uv", place(int(infinite.argmax())), text, "NaN there")
    if (without | infinite).all():
        if (rows >= 0).any():
            losses.left_out(["texture coordinates, which all faces lack at some corner"])
        return values, np.full(len(rows), len(values))
    if without.any():
        text = (
            f"{_faces(without.sum(), len(sizes))} without texture coordinates, which are NaN there"
        )
        losses.note("no uv", place(int(without.argmax())), text)
    return with_gaps(values, np.where(np.repeat(without | infinite, sizes), -1, rows))


def strips(sizes: IntArray, indices: IntArray) -> IntArray:
    """The triangles of triangle strips, as positions among their corners: (t, 3).

    A negative index ends a strip, and another begins. Triangles with a vertex twice, by which
    strips are joined, are none.
    """
    number = np.arange(len(indices))
    begin = np.zeros(len(indices), dtype=bool)
    begin[(np.cumsum(sizes) - sizes)[sizes > 0]] = True
    begin[1:] |= indices[:-1] < 0
    start = np.maximum.accumulate(np.where(begin, number, 0))
    third = number[(number - start >= 2) & (indices >= 0)]
    odd = (third - start[third]) % 2
    triangles: IntArray = np.stack([third - 2 + odd, third - 1 - odd, third], axis=1)
    a, b, c = indices[triangles].T
    distinct: IntArray = triangles[(a != b) & (b != c) & (c != a)]
    return distinct


def _finite_normals(x: Tessellation) -> NDArray[np.float64]:
    """Normals, with those of the polygons around, by area, where there is none."""
    missing = np.asarray(np.isnan(x.normals).any(axis=1))
    if not missing.any():
        return x.normals
    triangles = x.triangles
    triangles = triangles[missing[x.normal_indices[triangles]].any(axis=1)]
    rows = x.normal_indices[triangles]  # (T, 3)
    a, b, c = x.points[x.indices[triangles]].transpose(1, 0, 2)
    sides = np.stack([b - a, c - a])[:, :, None]  # (2, T, 1, 3)
    # exactly scaled around each normal: products of large lengths overflow, of small ones vanish
    size = np.zeros(len(x.normals))
    np.maximum.at(size, rows, np.abs(sides).max(axis=(0, 3)))
    sides = np.ldexp(sides, -np.frexp(size)[1][rows][:, :, None])
    sums = np.zeros_like(x.normals)
    np.add.at(sums, rows, np.cross(*sides))
    sums = sums[missing]
    largest = np.abs(sums).max(axis=1, keepdims=True)
    sums /= np.where(largest > 0, largest, 1)
    # nothing is known of a point amid polygons without area
    sums[largest[:, 0] == 0] = [0, 0, 1]
    normals = x.normals.copy()
    normals[missing] = sums / np.linalg.norm(sums, axis=1, keepdims=True)
    return normals
