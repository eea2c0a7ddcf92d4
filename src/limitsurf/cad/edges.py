"""What patches of neighbouring limit faces make of the edge between them: gaps, and angles."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.query.chords import length
from limitsurf.query.polynomials import line_values
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_PLACES = 1 << 18  # at once


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


def across(
    surface: LimitSurface,
    half: Array,
    ways: Array,
    lines: Array,
    degree: int,
    evaluate: Callable[..., Array],
    normal: Callable[..., Array],
) -> tuple[Array, Array]:
    """Gaps and angles along edges (e,) and spokes (k,): bounds of gaps, and both found.

    (3, e + k), and the limit faces (e + k, 2) on both sides where they begin. Between `lines`,
    from 0 to 1 along edges, both sides are polynomials of a degree.
    """
    steps = np.arange(degree + 1) / degree
    s = (lines[:-1, None] + np.diff(lines)[:, None] * steps).ravel()
    solve = np.linalg.inv(line_values(degree, steps))
    total = len(half) + len(ways)
    found, faces = np.zeros((3, total)), np.zeros((total, 2), dtype=np.int64)
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
        step = (one - other).reshape(len(some), len(lines) - 1, degree + 1, 3)
        here[1] = length(step).max(axis=(1, 2), initial=0)
        # what rounding takes from values is in the step already
        here[0] = length(np.matmul(solve, step)).max(axis=(1, 2), initial=0)
        one, other = (normal(*place) for place in known)
        angle = 2 * np.arctan2(length(one - other), length(one + other))
        here[2] = np.nan_to_num(angle).reshape(len(some), -1).max(axis=1, initial=0)
    return found, faces
