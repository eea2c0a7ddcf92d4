"""What files and other libraries hold of cages and tessellations: polygons, normals, "uv"."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf.mesh import Mesh

if TYPE_CHECKING:
    from limitsurf.query import Polygons, Tessellation

IntArray: TypeAlias = NDArray[np.int64]

# formats that have units and an up axis, which polygons are scaled and turned to
OWN_MEASURES = (".glb", ".gltf", ".dae", ".3mf")


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
    """The channel that is texture coordinates: "uv", or else "st" as USD calls it, of (k, 2)."""
    found = [n for n in ("uv", "st") if n in x.channels and x.channels[n][0].shape[1:] == (2,)]
    return found[0] if found else None


def polygons(x: Mesh | Tessellation, *, uv: bool = True) -> Polygons:
    """A cage or tessellation with finite normals, its texture coordinates the one channel "uv".

    A cage has no normals.

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
        raise TypeError(f"need a Mesh or a Tessellation, got {type(x).__name__}")
    name = texture(x) if uv else None
    kept = {}
    if name is not None:
        values, where, *_ = x.channels[name]
        kept["uv"] = values.astype(np.float64), where
    return Polygons(points, x.sizes, x.indices, normals, rows, kept)


def warn_of_loss(
    name: str, kind: str, x: Mesh | Tessellation, *, uv: bool, tags: bool = False
) -> None:
    """Warn of all that a file of polygons, texture coordinates or tags cannot hold."""
    kept = texture(x) if uv else None
    lost = [f"channel {name!r}" for name in x.channels if name != kept]
    if isinstance(x, Mesh) and not tags:
        counts = {"creases": x.creases[0], "corners": x.corners[0], "holes": x.holes}
        lost = [what for what, found in counts.items() if len(found)] + lost
        choices = ("boundary", "creasing", "triangles")
        lost += [choice for choice in choices if getattr(x, choice) is not None]
        lost += ["scheme"] if x.scheme not in (None, "none", "catmull-clark") else []
    if kind not in OWN_MEASURES:
        lost += [f"units ({x.units:g} m)"] if x.units is not None else []
        lost += [f"up axis ({x.up})"] if x.up is not None else []
    if lost:
        text = f"{name}: a file of type {kind} cannot hold everything, left out: "
        warnings.warn(text + ", ".join(lost), stacklevel=3 if tags else 4)


def warn_of_cuts(name: str, kind: str, x: Mesh | Tessellation) -> None:
    """Warn of faces of a cage that a file of triangles cannot hold."""
    cut = int((x.sizes > 3).sum()) if isinstance(x, Mesh) else 0
    if cut:
        text = f"{name}: a file of type {kind} holds triangles only: faces of more than 3 corners, "
        text += f"{cut} of {len(x.sizes)}, are cut, which changes the limit surface of the cage"
        warnings.warn(text, stacklevel=4)


def warn_of_rounding(
    name: str,
    kind: str,
    x: Mesh | Tessellation,
    points: NDArray[np.float64],
    kept: NDArray[Any],
    stacklevel: int,
) -> None:
    """Warn of points (V, 3) that differ, but not as a file keeps them, `kept` (V, 3)."""
    first, number = merged(kept)
    apart = np.abs(points - points[first[number]]).max(axis=1)
    # where pieces of a surface touch, points differ by the rounding of their evaluation
    ulps = 0 if isinstance(x, Mesh) else 4
    lost = points[apart > ulps * np.finfo(np.float64).eps * np.abs(points).max()]
    if len(lost):
        count = len(merged(lost)[0])
        text = f"{name}: {count} of {len(first) + count} distinct points become equal to others, "
        text += f"rounded as in a file of type {kind}: .obj, .ply and .vtp keep float64"
        warnings.warn(text, stacklevel=stacklevel)


def merged(points: NDArray[Any]) -> tuple[IntArray, IntArray]:
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


def mesh_of(
    points: NDArray[Any],
    sizes: NDArray[Any],
    indices: NDArray[Any],
    uv: NDArray[Any] | None = None,
    *,
    merge: bool = False,
    **tags: Any,
) -> Mesh:
    """A cage of polygons; `uv` (V, 2), by point, becomes the channel "uv".

    With `merge`, points of equal coordinates become one, and triangles that have one of them twice
    after that are dropped: formats that keep texture coordinates or normals by point repeat points
    where these have a seam.
    """
    sizes, indices = np.asarray(sizes, np.int64), np.asarray(indices, np.int64)
    rows = indices
    if merge and len(points) and len(indices) and 0 <= indices.min() <= indices.max() < len(points):
        first, number = merged(np.asarray(points))
        if len(first) < len(points):
            points, indices = points[first], number[indices]
            if (sizes == 3).all():
                a, b, c = indices.reshape(-1, 3).T
                kept = np.repeat((a != b) & (b != c) & (c != a), 3)
                sizes, indices, rows = sizes[kept[::3]], indices[kept], rows[kept]
    if uv is not None:
        tags["channels"] = {"uv": (uv, rows, "corners_plus1"), **tags.get("channels", {})}
    return Mesh(points, (sizes, indices), **tags)


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
