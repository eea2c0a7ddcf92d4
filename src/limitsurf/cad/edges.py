"""What patches of neighbouring limit faces make of the edge between them: gaps, and angles."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limitsurf.query.angles import between
from limitsurf.query.deviation import length
from limitsurf.query.polynomials import line_values
from limitsurf.query.polynomials import lines as on_lines
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_PLACES = 1 << 18  # at once
# how often stretches are halved until bounds of angles are within a factor of what is found
_SPLIT, _NEAR = 6, 1.25
_FLOOR = 2.0**-26  # radians
_ROUNDED = 2.0**-46  # of cross products


def inner_edges(surface: LimitSurface) -> Array:
    """Half-edges (e,), one of each pair with limit faces on both sides."""
    mesh, ends = surface.mesh, surface.limit_faces
    there = np.ones(mesh.n_faces, dtype=bool)
    there[ends.face[~surface.patches.with_limit]] = False
    twin = mesh.twin
    own = np.arange(mesh.n_corners)
    here = (twin > own) & there[mesh.corner_face]
    here[here] = there[mesh.corner_face[twin[here]]]
    return np.flatnonzero(here)


def places(surface: LimitSurface, half: Array, s: Array) -> tuple[Array, Array, Array]:
    """Limit faces, u and v at s (e, q) along half-edges (e,), from 0 to 1."""
    mesh, ends = surface.mesh, surface.limit_faces
    corners = np.array(surface.topology.lattice.corners, dtype=float)
    face = mesh.corner_face[half]
    first, size = ends.first[face], mesh.sizes[face]
    corner = half - mesh.offsets[face]
    whole = ends.corner[first] < 0
    at = np.where(whole, corner, 0) % len(corners)
    start, end = corners[at], corners[(at + 1) % len(corners)]
    u, v = np.moveaxis(start[:, None] + s[..., None] * (end - start)[:, None], 2, 0)
    late = ~whole[:, None] & (s > 0.5)
    split = np.broadcast_to(~whole[:, None], s.shape)
    here = np.where(whole, first, first + corner)[:, None] * np.ones(s.shape, dtype=np.int64)
    following = np.broadcast_to((first + (corner + 1) % size)[:, None], s.shape)
    here = np.where(late, following, here)
    u = np.where(late, 0, np.where(split, 2 * s, u))
    v = np.where(late, 2 - 2 * s, np.where(split, 0, v))
    return here, u, v


def spokes(surface: LimitSurface) -> Array:
    """Half-edges (k,) of n-gons that have a limit: one for each way from a middle to the middle."""
    mesh, ends = surface.mesh, surface.limit_faces
    there = np.zeros(mesh.n_faces, dtype=bool)
    there[ends.face[(ends.corner >= 0) & surface.patches.with_limit]] = True
    return np.flatnonzero(there[mesh.corner_face])


def _spoke_places(surface: LimitSurface, half: Array, s: Array, back: bool) -> Any:
    """Limit faces, u and v at s (q,) on spokes (k,), from one side or from the other."""
    mesh, ends = surface.mesh, surface.limit_faces
    corner = mesh.next_corner[half] if back else half
    face = ends.first[mesh.corner_face[half]] + corner - mesh.offsets[mesh.corner_face[half]]
    at = np.tile(s, (len(half), 1))
    here = face[:, None] * np.ones(at.shape, dtype=np.int64)
    return (here, at, np.ones_like(at)) if back else (here, np.ones_like(at), at)


class Sides(NamedTuple):
    """What patches are at places (Q,) of limit faces, on one side of edges.

    Attributes
    ----------
    point, normal : (Q, 3)
    origin : (Q, 3) or float
        What points are relative to.
    point_error : (Q,) or float
        What rounding does to points.
    along, across : (Q, 3), optional
        Derivatives that are polynomials as the points are, and whose cross products are normals.
    error : (2, Q), optional
        What rounding does to these, each.
    """

    point: Array
    normal: Array | None
    origin: Array | float = 0.0
    point_error: Array | float = 0.0
    along: Array | None = None
    across: Array | None = None
    error: Array | None = None


def across(
    surface: LimitSurface,
    half: Array,
    ways: Array,
    lines: Array,
    degree: int,
    evaluate: Callable[..., Sides],
) -> tuple[Array, Array]:
    """Gaps and angles along edges (e,) and spokes (k,): bounds of both, and what is found.

    (4, e + k): a bound of gaps, gaps, angles, and a bound of these, pi without derivatives; and the
    limit faces (e + k, 2) on both sides where they begin. Between `lines`, from 0 to 1 along edges,
    both sides are polynomials of a degree.
    """
    # within each stretch, as derivatives may jump where it ends
    steps = (np.arange(degree + 1) + 0.5) / (degree + 1)
    s = (lines[:-1, None] + np.diff(lines)[:, None] * steps).ravel()
    solve = np.linalg.inv(line_values(degree, steps))
    total = len(half) + len(ways)
    found, faces = np.zeros((4, total)), np.zeros((total, 2), dtype=np.int64)
    each = max(1, _PLACES // len(s))
    parts = [(False, half, k) for k in range(0, len(half), each)]
    parts += [(True, ways, k) for k in range(0, len(ways), each)]
    for spoke, all_, start in parts:
        some = all_[start : start + each]
        sides = [(some, s, False), (surface.mesh.twin[some], 1 - s, True)]
        known = [
            _spoke_places(surface, some, s, back) if spoke
            else places(surface, h, np.tile(x, (len(h), 1))) for h, x, back in sides
        ]  # fmt: skip
        begin = start + spoke * len(half)
        here = found[:, begin : begin + len(some)]
        faces[begin : begin + len(some)] = np.stack([x[0][:, 0] for x in known], axis=1)
        one, other = (evaluate(*place) for place in known)
        shape = len(some), len(lines) - 1, degree + 1, 3
        step = (one.origin - other.origin) + (one.point - other.point)
        step = step.reshape(shape)
        net = length(np.matmul(solve, step))
        off = np.broadcast_to(one.point_error + other.point_error, len(some) * len(s))
        off = off.reshape(len(some), -1).max(axis=1, initial=0)
        here[0] = net.max(axis=(1, 2), initial=0) + off
        ends = net[..., [0, -1]].max(axis=(1, 2), initial=0)
        here[1] = np.maximum(ends, length(step).max(axis=(1, 2), initial=0))
        if one.normal is not None and other.normal is not None:
            angle = _angle(one.normal, other.normal).reshape(len(some), -1)
            here[2:] = np.nan_to_num(angle).max(axis=1, initial=0), np.full(len(some), np.pi)
        else:
            here[2:] = _angles(one, other, shape, solve)
    return found, faces


def _angle(one: Array, other: Array) -> Array:
    """Angles between unit vectors (..., 3)."""
    return np.asarray(2 * np.arctan2(length(one - other), length(one + other)))


def _angles(one: Sides, other: Sides, shape: tuple[int, ...], solve: Array) -> Array:
    """Angles between normals of both sides, found and their bounds, (2, e).

    Both are polynomials on each stretch; stretches whose bounds are not near are halved.
    """
    e, stretches, n, _ = shape
    product, halves = on_lines(n - 1)[2], on_lines(2 * n - 2)[1]
    nets, noise = [], np.zeros((2, e * stretches))
    for k, side in enumerate((one, other)):
        assert side.along is not None
        assert side.across is not None
        assert side.error is not None
        du, dv = (np.matmul(solve, x.reshape(-1, n, 3)) for x in (side.along, side.across))
        far = np.abs(side.error).reshape(2, -1, n).max(axis=2) * np.abs(solve).sum(axis=1).max()
        size = [length(x).max(axis=1, initial=0) for x in (du, dv)]
        # of one size, that nothing overflows
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            du, dv = (x / y[:, None, None] for x, y in zip((du, dv), size, strict=True))
            noise[k] = 2 * (far / np.stack(size)).sum(axis=0) + _ROUNDED
        nets.append(_crossed(product, du, dv))
    found = np.zeros((2, e))
    owner = np.repeat(np.arange(e), stretches)
    (a, b), (p, q) = nets, noise
    for step in range(_SPLIT + 1):
        known = np.isfinite(a).all(axis=(1, 2)) & np.isfinite(b).all(axis=(1, 2))
        bound = np.where(known, between(a, p, b, q)[0], np.pi)
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y = (z[:, [0, -1]] / length(z[:, [0, -1]])[..., None] for z in (a, b))
        np.maximum.at(found[0], owner, np.nan_to_num(_angle(x, y)).max(axis=1))
        near = np.maximum(_NEAR * found[0][owner], _FLOOR)
        open_ = known & (bound > np.maximum(near, found[1][owner])) & (step < _SPLIT)
        np.maximum.at(found[1], owner[~open_], bound[~open_])
        if not open_.any():
            break
        owner = np.repeat(owner[open_], 2)
        p, q = np.repeat(p[open_], 2), np.repeat(q[open_], 2)
        a, b = (np.matmul(halves, x[open_][:, None]).reshape(-1, x.shape[1], 3) for x in (a, b))
    return found


def _crossed(product: Array, du: Array, dv: Array) -> Array:
    """Coefficients (L, m, 3) of cross products of polynomials (L, n, 3) on lines."""
    pairs = np.cross(du[:, :, None], dv[:, None]).reshape(len(du), -1, 3)
    return np.asarray(np.matmul(product.T, pairs))
