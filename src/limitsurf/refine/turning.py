"""Limits and parents of meshes that are refined by turning edges, see ``thirds.py``."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import _kernels, numbers, tables
from limitsurf._kernels import reference as kernels
from limitsurf.cage.connectivity import Connectivity, read_only
from limitsurf.cage.mesh import Mesh
from limitsurf.numbers import NumberType
from limitsurf.options import Rules
from limitsurf.refine.operators import multiplied, sparse_operator
from limitsurf.refine.stages import irrational
from limitsurf.refine.thirds import Thirds

Array = NDArray[Any]

# faces around boundary vertices of which the limit has a tangent plane, derivations/sqrt3.py
_SMOOTH = range(1, 6)
_FIXED = range(1, 3)


def limits(step: Thirds, rules: Rules, points: Array) -> Array:
    """Limits of the vertices, (n_vertices, d), from their points; NaN at unused ones."""
    number, mesh = numbers.type_of(points), step.mesh
    result = points.copy()
    inner = np.flatnonzero(step.interior)
    share = tables.shares(rules.scheme, mesh.vertex_faces[inner], number)
    share = 3 * share / (1 + 3 * share)
    tail, head = mesh.indices, mesh.indices[mesh.next_corner]
    spoke = np.flatnonzero(step.interior[tail])
    ones, every = number.full(len(spoke), number.one), np.arange(len(spoke))
    gathered = sparse_operator(tail[spoke], every, ones, (mesh.n_vertices, len(spoke)))
    sums = np.asarray(gathered @ (points[head[spoke]] - points[tail[spoke]]))
    valence = number.array(mesh.vertex_faces[inner])
    result[inner] += sums[inner] * (share / valence)[:, None]
    at, one, other = step.rim
    weight = curve_limit(rules, number)
    result[at] += ((points[one] - points[at]) + (points[other] - points[at])) * weight
    result[mesh.vertex_faces == 0] = np.nan
    return result


@lru_cache(maxsize=64)
def curve_limit(rules: Rules, number: NumberType) -> Any:
    """What each neighbour on the boundary has in the limit of a boundary vertex."""
    (_, beside), (_, along, beyond) = tables.curve_weights(rules.scheme, numbers.RATIONAL)
    # of the even mode: differences of both neighbours from the vertex keep `kept` and lose `lost`
    kept = along + beyond - 2 * beside
    share: Any = number.array(beside / (1 - kept))[()]
    return share


def limit_normals(step: Thirds, rules: Rules, points: Array, rounded: bool) -> Array:
    """Unit limit normals at the corners, (n_corners, 3); NaN where there is none."""
    fans = step.fans
    found = np.full((len(fans.vertex), 3), np.nan)
    after, before = step.mesh.next_corner, step.mesh.previous_corner
    errors = kernels.largest(points)[:, 0] * rounded
    open_ = ~fans.closed
    for k in np.unique(fans.sizes).tolist():
        own = fans.sizes == k
        for which in (own & fans.closed, own & open_):
            fan = np.flatnonzero(which)
            masks = tangent_masks(rules, k, bool(fans.closed[fan].all()))
            smooth = step.interior | step.smooth
            for fixed, pair in zip((False, True), masks, strict=True):
                some = fan[smooth[fans.vertex[fan]] != fixed]
                if pair is None or not len(some):
                    continue
                corner = fans.corners[fans.offsets[some][:, None] + np.arange(k)]
                ring = [step.mesh.indices[after[corner]]]
                if open_[some[0]]:
                    ring.append(step.mesh.indices[before[corner[:, -1:]]])
                vertex = fans.vertex[some]
                around = np.concatenate([vertex[:, None], *ring], axis=1)
                steps = points[around] - points[vertex][:, None]
                noise = np.abs(steps).max(axis=2) + errors[around]
                along, across = (np.einsum("j,qjd->qd", mask, steps) for mask in pair)
                bounds = [kernels.NOISE * (noise @ np.abs(mask))[:, None] for mask in pair]
                found[some] = kernels.unit_normals(along, across, (bounds[0], bounds[1]))
    return found[fans.fan]


@lru_cache(maxsize=1024)
def tangent_masks(rules: Rules, faces: int, closed: bool) -> tuple[Array | None, Array | None]:
    """Both tangent masks (2, ring) of a vertex amid so many faces, and of one that stays."""
    if closed:
        if faces < 3:
            return None, None
        turn = np.arange(faces) * (2 * np.pi / faces)
        return np.stack([np.append(0, np.cos(turn)), np.append(0, np.sin(turn))]), None
    ends = np.zeros((2, faces + 2))
    ends[0, 1], ends[1, -1] = 1, 1
    smooth = ends.copy()
    smooth[0, -1] = -1
    smooth[1] = across(rules, faces) if faces in _SMOOTH else np.nan
    return (
        smooth if faces in _SMOOTH else None,
        ends if faces in _FIXED else None,
    )


def across(rules: Rules, faces: int) -> Array:
    """The mask of the direction into the surface at a boundary vertex of k faces, (k + 2,).

    The sine wave once along the spokes, and what of the curve makes it an eigenvector. Of one face
    the curve bounds both sides, and what is left of it, second differences, leads inwards.
    """
    if faces == 1:
        return np.array([-2.0, 1.0, 1.0])
    (own, beside), (near, along, beyond) = (
        x.astype(float) for x in tables.curve_weights(rules.scheme, numbers.RATIONAL)
    )
    wave = np.sin(np.arange(1, faces) * (np.pi / faces))
    value = 4 / 9 * np.cos(np.pi / (2 * faces)) ** 2
    matrix = np.array([[own - value, 2 * near], [beside, along + beyond - value]])
    vertex, end = np.linalg.solve(matrix, [-5 / 9 * wave.sum(), -wave[0] / 9])
    return np.concatenate([[vertex, end], wave, [end]])


def parents(
    steps: Sequence[Thirds], limit_face: Array, uv: Array, levels: int, without: Array
) -> tuple[Array, Array, Array]:
    """Limit face and parameters of each vertex after so many steps.

    Known are those of the corners of the cage, and its steps; `without` tells which of its faces
    have no limit.
    """
    face, uv = limit_face[::3], uv.reshape(-1, 3, 2)
    faces, V = steps[0].mesh.indices.reshape(-1, 3), steps[0].mesh.n_vertices
    for step in steps[: levels // 2]:
        uv = _thirds(uv).reshape(-1, 3, 2)
        face, without = np.repeat(face, 9), np.repeat(without, 9)
        faces, V = step.whole_faces, step.n_whole
    found, at = np.full(V, -1), np.full((V, 2), np.nan)
    for some in (np.flatnonzero(without)[::-1], np.flatnonzero(~without)[::-1]):
        # the last to be written stays
        corners = faces[some].ravel()
        found[corners] = np.repeat(face[some], 3)
        at[corners] = uv[some].reshape(-1, 2)
    if levels % 2:
        found, at = np.append(found, face), np.concatenate([at, uv.mean(axis=1)])
    return found, at[:, 0], at[:, 1]


def _thirds(uv: Array) -> Array:
    """Parameters of the corners of nine faces each, (F, 9, 3, 2), from (F, 3, 2)."""
    after, before = np.roll(uv, -1, axis=1), np.roll(uv, 1, axis=1)
    tail, head = (2 * uv + after) / 3, (uv + 2 * after) / 3
    back = (2 * uv + before) / 3
    middle = np.repeat(uv.mean(axis=1)[:, None], 3, axis=1)
    kinds = (uv, tail, back), (tail, head, middle), (tail, middle, back)
    return np.concatenate([np.stack(corners, axis=2) for corners in kinds], axis=1)


def corners_of_halves(half: Thirds) -> Array:
    """For each corner after the first step one at the same vertex after both, on its side."""
    corner, inner = np.arange(len(half.twin)), half.twin >= 0
    face, k = np.divmod(corner, 3)
    tail = 3 * (9 * face + k)
    middle = 3 * (9 * face + 3) + 2
    across = np.where(inner, middle[half.twin], tail[half.mesh.next_corner])
    return np.stack([tail, across, middle], axis=1).ravel()


def steps(mesh: Mesh, rules: Rules, levels: int) -> list[Thirds]:
    """What so many steps begin from, two each; of none that of the mesh."""
    found = [Thirds.of(mesh, rules)]
    while len(found) < (levels + 1) // 2:
        found.append(found[-1].child)
    return found


def faces_after(steps: Sequence[Thirds], levels: int) -> Connectivity:
    """The mesh after so many steps."""
    last = steps[-1]
    if not levels:
        return last.mesh
    return last.half if levels % 2 else last.whole


def refined(
    steps: Sequence[Thirds], levels: int, rules: Rules, points: Array, total: Any = None
) -> tuple[Array, Any]:
    """Points (n, d) after so many steps, and their operator, if that so far is given."""
    number = numbers.type_of(points)
    corners = steps[0].mesh.n_corners * sum(3**level for level in range(levels))
    # an edge from a vertex to itself has one point where kernels look for two
    plain = total is None and not number.exact and not steps[0].mesh.repeats
    if plain and _kernels.compiled(corners, 10):
        points = read_only(points)
        for level in range(levels):
            step = steps[level // 2]
            take = step.second_points if level % 2 else step.first_points
            points = take(rules, points)
        return points, None
    for level in range(levels):
        matrix = operator(steps[level // 2], bool(level % 2), rules, number)
        points = np.asarray(matrix @ points)
        total = None if total is None else multiplied(matrix, total, False)
    return points, total


def operator(step: Thirds, second: bool, rules: Rules, number: NumberType) -> Any:
    """The operator of a step; a TypeError that says where masks are not to be had."""
    try:
        return step.second(rules, number) if second else step.first(rules, number)
    except TypeError:
        middles = 3 + (step.twin >= 0).reshape(-1, 3).sum(axis=1)
        valence = np.where(step.interior, step.mesh.vertex_faces, 6)
        for name, counts in (("vertex", valence), ("the middle of face", middles)):
            for which in np.unique(counts, return_index=True)[1].tolist():
                try:
                    tables.shares(rules.scheme, counts[[which]], number)
                except TypeError:
                    what = f"{name} {which} has valence {counts[which]}"
                    raise TypeError(irrational(what, rules)) from None
        raise
