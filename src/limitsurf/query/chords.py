"""How far a surface is from triangles with corners on it: ``derivations/tessellation.py``."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def triangles_error(
    bent: Array, loose: Array, at: Array, points: Array, along: Array | None = None
) -> Array:
    """How far a surface is from triangles, at most: (...,).

    Parameters
    ----------
    bent, loose : (..., 3, 3), (..., 3)
        Second derivatives, as in `Parts`.
    at : (..., 3, 2)
        Corners of the triangles in the parameters of these.
    points : (..., 3, 3)
        The surface there.
    along : (..., 3), optional
        Unit vectors: how far it is across these, from the places in triangles that the bound
        without them is of.
    """
    turned = [1, 2, 0]
    steps, edges = at[..., turned, :] - at, points[..., turned, :] - points
    s, t = steps[..., None, 0], steps[..., None, 1]
    curve = s * s * bent[..., None, 0, :] + 2 * s * t * bent[..., None, 1, :]
    curve = curve + t * t * bent[..., None, 2, :]
    curve = curve - slide(curve, edges)
    if along is not None:
        ray = along[..., None, :]
        curve = curve - (curve * ray).sum(axis=-1, keepdims=True) * ray
    alone = length(curve).max(axis=-1)
    mixed = length(curve + curve.sum(axis=-2, keepdims=True)).max(axis=-1) / 3
    width = np.ptp(at, axis=-2)
    s, t = width[..., 0], width[..., 1]
    rest = s * s * loose[..., 0] + 2 * s * t * loose[..., 1] + t * t * loose[..., 2]
    return np.asarray((np.maximum(alone, mixed) + rest) / 8)


def slide(curve: Array, along: Array) -> Array:
    """The part of second differences along edges that moves no point out of a triangle."""
    with np.errstate(invalid="ignore", divide="ignore"):
        share = (curve * along).sum(axis=-1) / (along * along).sum(axis=-1)
    return np.asarray(np.clip(np.nan_to_num(share), -2, 2)[..., None] * along)


def polygon_error(
    ends: Array, bent: Array, loose: Array, corners: Array, along: Array | None = None
) -> Array:
    """The same of parts cut by whichever diagonal, (L,)."""
    which = ways(len(ends))
    at, points = ends[which], corners[:, which]
    ray = None if along is None else along[:, None]
    found = triangles_error(bent[:, None], loose[:, None], at, points, ray)
    return np.asarray(found.max(axis=1))


def ways(size: int) -> list[list[int]]:
    """Corners of all triangles that polygons of three or four may be cut into."""
    return [[0, 1, 2]] if size == 3 else [[0, 1, 2], [0, 2, 3], [0, 1, 3], [1, 2, 3]]


def distance(points: Array, triangle: Array) -> Array:
    """Distances (M, k) of points (M, k, 3) from triangles (M, 3, 3), the first corner at 0."""
    a, b = triangle[:, 1], triangle[:, 2]
    aa, ab, bb = ((x * y).sum(axis=1) for x, y in ((a, a), (a, b), (b, b)))
    pa, pb = np.matmul(points, a[:, :, None])[..., 0], np.matmul(points, b[:, :, None])[..., 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        scale = (1 / (aa * bb - ab * ab))[:, None]
        s = (bb[:, None] * pa - ab[:, None] * pb) * scale
        t = (aa[:, None] * pb - ab[:, None] * pa) * scale
        inside = (s >= 0) & (t >= 0) & (s + t <= 1)
        c = b - a
        shares = [
            (pa / aa[:, None], a, 0 * a),
            (pb / bb[:, None], b, 0 * a),
            ((pb - pa - (ab - aa)[:, None]) / (c * c).sum(axis=1)[:, None], c, a),
        ]
    s, t = np.where(inside, s, 0)[..., None], np.where(inside, t, 0)[..., None]
    best = ((points - s * a[:, None] - t * b[:, None]) ** 2).sum(axis=2)
    for share, side, start in shares:
        share = np.clip(np.nan_to_num(share), 0, 1)[..., None]
        away = points - start[:, None] - share * side[:, None]
        best = np.minimum(best, (away**2).sum(axis=2))
    return np.asarray(np.sqrt(best))


def length(x: Array) -> Array:
    """Of vectors (..., 3) that are about 1, or do not matter."""
    return np.asarray(np.sqrt((x * x).sum(axis=-1)))
