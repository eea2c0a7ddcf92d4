"""Which side of a closed surface points are on, and which limit faces share a place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from limitsurf.patches import NO_LIMIT
from limitsurf.query.index import Cells
from limitsurf.query.nearest import SAME
from limitsurf.query.tessellation import tessellate
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_NEAR = 2.0**-16  # of a face: as far from a vertex a cone stands for the faces around it
_WAYS = 16  # in which distances are compared around a place
_SPOKES = 8  # triangles of such a cone in each face
_CLEAR = 1e-9  # cosines that say on which side of a plane something is
_SEGMENTS = 16  # of faces, where a side is told by the solid angle that they cover
_AT_ONCE = 1 << 16  # triangles times points that are in memory at once

_triangles: WeakKeyDictionary[LimitSurface, Array] = WeakKeyDictionary()  # (3, n, 3)


@dataclass(frozen=True, eq=False)
class Shared:
    """Limit faces around places on their sides: places of the queries `owner` (n,) once more."""

    owner: Array
    face: Array
    u: Array
    v: Array
    corner: Array  # whether it is a vertex of the cage, or the middle of a face

    def some(self, which: Array) -> Shared:
        """Some of them."""
        parts = (self.owner, self.face, self.u, self.v, self.corner)
        return Shared(*(x[which] for x in parts))


def shared(surface: LimitSurface, face: Array, u: Array, v: Array) -> Shared:
    """All limit faces that places (Q,) on sides of limit faces belong to; none for others."""
    lattice, mesh = surface.topology.lattice, surface.mesh
    corner = surface.limit_faces.corner[face]
    first = mesh.offsets[surface.limit_faces.face[face]]
    own, half, along = [], [], []
    ends = np.array(lattice.corners, dtype=float)
    for k, (a, b, c) in enumerate(lattice.edges):
        step = ends[(k + 1) % len(ends)] - ends[k]
        on = a + b * u + c * v == 0
        at = (np.stack([u, v], axis=1) - ends[k]) @ step / (step @ step)
        here = np.flatnonzero(on & (corner < 0))
        own.append(here)
        half.append(first[here] + k)
        along.append(at[here])
        if k in (0, len(ends) - 1):  # the sides of a limit face of an n-gon on edges of the cage
            here = np.flatnonzero(on & (corner >= 0))
            h = first[here] + corner[here]
            own.append(here)
            half.append(h if k == 0 else mesh.previous_corner[h])
            along.append(at[here] / 2 if k == 0 else (1 + at[here]) / 2)
    owner, h, x = (np.concatenate(y) for y in (own, half, along))
    vertex = (x == 0) | (x == 1)
    parts = [_beside(surface, owner[~vertex], h[~vertex], x[~vertex])]
    at_vertex, which = np.unique(owner[vertex], return_index=True)
    h, x = h[vertex][which], x[vertex][which]
    here = mesh.indices[np.where(x == 0, h, mesh.next_corner[h])]
    parts.append(_around(surface, at_vertex, here))
    parts.append(_within(surface, face, u, v))
    joined = {n: np.concatenate([getattr(p, n) for p in parts]) for n in Shared.__annotations__}
    return Shared(**joined)


def _within(surface: LimitSurface, face: Array, u: Array, v: Array) -> Shared:
    """Limit faces of a face of the cage at places on the lines between them, and in its middle."""
    mesh, limit_faces = surface.mesh, surface.limit_faces
    number, cage = limit_faces.corner[face], limit_faces.face[face]
    n, first = mesh.sizes[cage], limit_faces.first[cage]
    inside = (number >= 0) & (u > 0) & (v > 0)
    line = np.flatnonzero(inside & ((u == 1) != (v == 1)))
    x = np.where(u == 1, v, u)[line]
    one = (number - (u < 1))[line] % n[line]
    owner, other = np.repeat(line, 2), np.stack([one, (one + 1) % n[line]], axis=1).ravel()
    ends = np.ones(len(x))
    at = np.stack([np.stack([ends, x], axis=1), np.stack([x, ends], axis=1)], axis=1).reshape(-1, 2)
    middle = np.flatnonzero(inside & (u == 1) & (v == 1))
    each = n[middle]
    every = np.arange(each.sum()) - np.repeat(np.cumsum(each) - each, each)
    middle = np.repeat(middle, each)
    owner = np.concatenate([owner, middle])
    found = first[owner] + np.concatenate([other, every])
    us, vs = np.concatenate([at, np.ones((len(middle), 2))]).T
    return Shared(owner, found, us, vs, np.arange(len(owner)) >= len(at))


def _beside(surface: LimitSurface, owner: Array, half: Array, x: Array) -> Shared:
    """Limit faces at places `x` along half-edges, and along the others of their edges."""
    mesh = surface.mesh
    edge = mesh.corner_edge
    order = np.argsort(edge, kind="stable")
    counts = np.bincount(edge, minlength=mesh.n_edges)
    start = np.cumsum(counts) - counts
    each = counts[edge[half]]
    number = np.repeat(np.arange(len(half)), each)
    step = np.arange(len(number)) - np.repeat(np.cumsum(each) - each, each)
    other = order[start[edge[half[number]]] + step]
    turned = mesh.indices[other] != mesh.indices[half[number]]
    place = np.where(turned, 1 - x[number], x[number])
    return _placed(surface, owner[number], other, place, np.zeros(len(other), dtype=bool))


def _around(surface: LimitSurface, owner: Array, vertex: Array) -> Shared:
    """Limit faces around vertices of the cage."""
    mesh = surface.mesh
    order = np.argsort(mesh.indices, kind="stable")
    counts = np.bincount(mesh.indices, minlength=mesh.n_vertices)
    start = np.cumsum(counts) - counts
    each = counts[vertex]
    number = np.repeat(np.arange(len(vertex)), each)
    step = np.arange(len(number)) - np.repeat(np.cumsum(each) - each, each)
    corner = order[start[vertex[number]] + step]
    every = np.ones(len(corner), dtype=bool)
    return _placed(surface, owner[number], corner, np.zeros(len(corner)), every)


def _placed(surface: LimitSurface, owner: Array, half: Array, x: Array, corner: Array) -> Shared:
    """Places `x` along half-edges as those of limit faces."""
    mesh, limit_faces, lattice = surface.mesh, surface.limit_faces, surface.topology.lattice
    cage = mesh.corner_face[half]
    first, k = limit_faces.first[cage], half - mesh.offsets[cage]
    whole = limit_faces.corner[first] < 0
    ends = np.array(lattice.corners, dtype=float)
    number = k % len(ends)
    place = ends[number] + x[:, None] * (ends[(number + 1) % len(ends)] - ends[number])
    late = x > 0.5
    part = np.where(late, np.stack([0 * x, 2 * (1 - x)]), np.stack([2 * x, 0 * x])).T
    place = np.where(whole[:, None], place, part)
    part_face = first + np.where(late, (k + 1) % mesh.sizes[cage], k)
    face = np.where(whole, first, part_face)
    known = surface.patches.codes[face] != NO_LIMIT
    u, v = place[known].T
    return Shared(owner[known], face[known], u, v, corner[known])


def spokes(surface: LimitSurface, around: Shared) -> Array:
    """Points (n, k + 1, 3) around places in their limit faces, nearby, counter-clockwise."""
    lattice = surface.topology.lattice
    inside = np.linspace(0, 1, _SPOKES + 1)
    frames = np.array(lattice.turns, dtype=float)  # (c, 3, 2)
    here = np.stack([around.u, around.v], axis=1)
    corner = np.abs(here[:, None] - frames[:, 0]).sum(axis=2).argmin(axis=1)
    at, along, across = frames[corner].swapaxes(0, 1)
    steps = (1 - inside)[:, None] * along[:, None] + inside[:, None] * across[:, None]
    exact = (here == at).all(axis=1)
    place = here[:, None] + np.where(exact[:, None, None], _NEAR * steps, 0)
    face = np.broadcast_to(around.face[:, None], place.shape[:2])
    return np.asarray(surface.evaluate(face, place[..., 0], place[..., 1]))


def beside_edge(surface: LimitSurface, cells: Cells, around: Shared, points: Array) -> Array:
    """How far feet on edges would move along the edge, or into the limit face, (n,).

    `points` (n, 3) are in the unit of the index.
    """
    jet = surface.jet(around.face, around.u, around.v, order=1)
    x, du, dv = (
        np.nan_to_num(np.ldexp(jet[nu], cells.power).reshape(-1, 3))
        for nu in ((0, 0), (1, 0), (0, 1))
    )
    gap, lattice = x - points, cells.lattice
    place = np.stack([np.ones(len(x)), around.u, around.v])
    edges = np.array(lattice.edges, dtype=float)
    inward = edges[(edges @ place).argmin(axis=0), 1:]
    along = np.stack([-inward[:, 1], inward[:, 0]], axis=1)
    step, into = (du * way[:, :1] + dv * way[:, 1:] for way in (along, inward))
    with np.errstate(divide="ignore", invalid="ignore"):
        step = np.nan_to_num(step / np.sqrt((step**2).sum(axis=1, keepdims=True)))
        into = into - (into * step).sum(axis=1, keepdims=True) * step
        into = np.nan_to_num(into / np.sqrt((into**2).sum(axis=1, keepdims=True)))
    away = np.abs((gap * step).sum(axis=1)), -(gap * into).sum(axis=1)
    return np.asarray(np.maximum(*away))


def falls_nearby(
    surface: LimitSurface,
    cells: Cells,
    places: tuple[Array, Array, Array],
    points: Array,
    few: Array,
    rounding: Array,
) -> Array:
    """Whether distances to points (n, 3) fall on some way from places in their limit faces, (n,).

    By more than `few` (n,) times the way; half of squared distances by more than `rounding` also.
    """
    face, u, v = places
    turn = np.pi * np.arange(_WAYS) / (_WAYS / 2)
    ways = np.round(np.stack([np.cos(turn), np.sin(turn)], axis=1), 9)
    to = np.stack([u, v], axis=1)[:, None] + _NEAR * ways
    edges = np.array(cells.lattice.edges)
    one = np.concatenate([np.ones((*to.shape[:2], 1)), to], axis=2)
    own, way = np.nonzero((one @ edges.T >= 0).all(axis=2))
    start, end = (
        np.ldexp(surface.evaluate(face[k], x, y).reshape(-1, 3), cells.power)
        for k, x, y in ((slice(None), u, v), (own, *to[own, way].T))
    )
    arm, gap = end - start[own], (start - points)[own]
    more = (arm * (gap + arm / 2)).sum(axis=1)
    falls = more < -few[own] * np.sqrt((arm**2).sum(axis=1)) - rounding[own]
    return np.bincount(own[falls], minlength=len(face)) > 0


def around_vertex(surface: LimitSurface, cells: Cells, around: Shared, points: Array) -> Array:
    """Cosines (n, k) between the way from a point to a vertex and ways on from there.

    More where these turn away from the point, up to where they end.
    """
    foot = np.ldexp(surface.evaluate(around.face, around.u, around.v), cells.power)
    arm = np.ldexp(spokes(surface, around), cells.power) - foot.reshape(-1, 1, 3)
    gap = foot.reshape(-1, 3) - points
    # half of what is added to squared distances
    more = (arm * (gap[:, None] + arm / 2)).sum(axis=2)
    with np.errstate(invalid="ignore", divide="ignore"):
        lengths = np.sqrt((gap**2).sum(axis=1))[:, None] * np.sqrt((arm**2).sum(axis=2))
        return np.asarray(np.nan_to_num(more / lengths))


def sides(
    surface: LimitSurface,
    cells: Cells,
    points: Array,
    places: tuple[Array, Array, Array],
    foot: Array,
    normal: Array,
) -> Array:
    """1 outside and -1 inside for points (Q, 3) with these feet.

    By the normal of the foot; on edges by the sum of those of both sides, at vertices by the sum of
    those of a cone of narrow triangles, each times its angle (Baerentzen and Aanaes, "Signed
    distance computation using the angle weighted pseudonormal", IEEE TVCG 2005). Where these say
    nothing, by the solid angle that the surface covers. What is on the surface is outside.
    """
    direction = np.nan_to_num(normal)
    around = shared(surface, *places)
    if len(around.owner):
        direction[around.owner] = 0
        edge = ~around.corner
        beside = around.face[edge], around.u[edge], around.v[edge]
        np.add.at(direction, around.owner[edge], np.nan_to_num(surface.normal(*beside)))
        at = np.flatnonzero(around.corner)
        if len(at):
            some = around.some(at)
            np.add.at(direction, some.owner, _cone(spokes(surface, some), foot[some.owner]))
    away = points - foot
    size = np.abs(away).max(axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        away = np.nan_to_num(away / size)
        lengths = [np.sqrt((x**2).sum(axis=1)) for x in (away, direction)]
        cosine = (away * direction).sum(axis=1) / (lengths[0] * lengths[1])
    side = np.where(cosine < 0, -1.0, 1.0)
    on = np.ldexp(size[:, 0], cells.power) <= SAME
    side[on] = 1
    doubt = np.flatnonzero(~(np.abs(cosine) > _CLEAR) & ~on)
    if len(doubt):
        side[doubt] = np.where(np.abs(covered(surface, points[doubt])) > 0.5, -1.0, 1.0)
    return side


def _cone(rim: Array, tip: Array) -> Array:
    """Sums (n, 3) of the normals of triangles between a tip (n, 3) and its rim, by their angles."""
    arm = rim - tip[:, None]
    with np.errstate(invalid="ignore", divide="ignore"):
        arm = arm / np.abs(arm).max(axis=2, keepdims=True)
        arm = arm / np.sqrt((arm**2).sum(axis=2, keepdims=True))
        cross = np.cross(arm[:, :-1], arm[:, 1:])
        sine = np.sqrt((cross**2).sum(axis=2, keepdims=True))
        cosine = (arm[:, :-1] * arm[:, 1:]).sum(axis=2, keepdims=True)
        return np.asarray(np.nan_to_num(cross / sine * np.arctan2(sine, cosine)).sum(axis=1))


def covered(surface: LimitSurface, points: Array) -> Array:
    """How many times a surface goes around points (Q, 3), by the solid angle of triangles on it."""
    if surface not in _triangles:
        pieces = tessellate(surface, _SEGMENTS, normals=False)
        _triangles[surface] = np.moveaxis(pieces.points[pieces.indices[pieces.triangles]], 1, 0)
    corners = _triangles[surface]
    found = np.empty(len(points))
    step = max(_AT_ONCE // max(corners.shape[1], 1), 1)
    for start in range(0, len(points), step):
        part = slice(start, start + step)
        a, b, c = corners[:, None] - points[part, None]
        la, lb, lc = (np.sqrt((x**2).sum(axis=2)) for x in (a, b, c))
        volume = (a * np.cross(b, c)).sum(axis=2)
        below = la * lb * lc + (a * b).sum(2) * lc + (b * c).sum(2) * la + (c * a).sum(2) * lb
        found[part] = np.arctan2(volume, below).sum(axis=1) / (2 * np.pi)
    return found
