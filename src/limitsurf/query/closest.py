"""Closest points on a surface, and all feet of points within a distance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf import html, numbers
from limitsurf.cage.checks import checked_number
from limitsurf.engine.packing import over_chunks
from limitsurf.engine.protocol import threads
from limitsurf.integrals.checks import refuse_open
from limitsurf.query.crossings import inside
from limitsurf.query.index import Cells, checked_surface
from limitsurf.query.nearby import search
from limitsurf.query.nearest import POINT, SAME, Feet, in_plane
from limitsurf.query.sides import (
    Shared,
    around_vertex,
    beside_edge,
    falls_nearby,
    shared,
    sides,
)
from limitsurf.query.traversal import kernels_for
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_CHUNK = 1 << 13  # points that are searched for at once
_FAR = 24  # points farther away than 2^24 of the largest coordinate are drawn nearer
_LEVEL = 2.0**-30  # cosines at which a surface is level: rounding, seen from a vertex nearby
_STEEP = 2.0**-8  # and at which it is steep: no vertex that is smooth, and almost a foot
_ALIKE = 1e-7  # parameters of feet that are one, where Newton's method ended in several cells
_POLISHED = 4  # times that feet are moved, at most
_STAYS = 2.0**-38  # a foot that would move by less, of the largest coordinate, is one by itself


@dataclass(frozen=True, eq=False, repr=False)
class ClosestPoints:
    """Places of a surface that are nearest to points, made by `closest_point`.

    Attributes
    ----------
    point : (..., 3) float64
        ``surface.evaluate(face, u, v)``.
    distance : (...)
        From the point asked for; negative inside if signs were asked for.
    face : (...) int64
        Limit faces; -1 where nothing was found.
    u, v : (...) float64
    normal : (..., 3) float64
        ``surface.normal(face, u, v)``.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> ls.closest_point(ls.LimitSurface(square), [[0.5, 0.5, 2.0], [0.25, 0.5, -1.0]])
    ClosestPoints(2 points)
    """

    point: Array
    distance: Array
    face: Array
    u: Array
    v: Array
    normal: Array

    def _repr_html_(self) -> str:
        flat = {name: html.rows(getattr(self, name)) for name in ("face", "u", "v", "distance")}
        return html.table({**flat, "point": html.rows(self.point, 1)}, repr(self))

    def __repr__(self) -> str:
        n = self.distance.size
        return f"{type(self).__name__}({n} point{'s' * (n != 1)})"


def closest_point(
    surface: LimitSurface,
    points: ArrayLike,
    *,
    signed: bool = False,
    max_distance: float = np.inf,
    channel: str | None = None,
    workers: int = 1,
) -> ClosestPoints:
    """The places of a surface that are nearest to points: of all places on it, to float64.

    Parameters
    ----------
    surface : LimitSurface
        Of float64 points, (n_vertices, 3).
    points : (..., 3) array_like
    signed : bool
        Whether distances are to be negative inside. The surface must be closed, with consistent
        orientation.
    max_distance : float
        Nothing farther away is sought, which is faster.
    channel : str, optional
        A face-varying channel of three columns, to search instead of the points.
    workers : int
        Threads, as for `LimitSurface.evaluate`; answers do not depend on it. (They may depend in
        their last digits, within what is said of distances, on what else is asked with a point.)

    Returns
    -------
    ClosestPoints
        Arrays of the shape of `points` without its last axis. Where nothing is within
        `max_distance` the face is -1, the distance inf, and the rest NaN; for points that are not
        finite the distance is NaN as well. Of several places equally far, up to rounding, that on
        the smallest limit face, of these that of the smallest v, then u.

    Raises
    ------
    TypeError
        For points that are not real numbers, and for a surface of exact ones.
    ValueError
        For points of another shape; for a surface that bounds nothing where signs are asked for,
        with the first edge that says so.

    Notes
    -----
    Distances are within 1e-13 of the largest coordinate of the points that the surface depends on.
    Limit faces are cut into Bezier cells (`SurfaceIndex`), which are the surface exactly; around
    special corners their rings go as deep as it takes. Cells are halved until the Bernstein
    coefficients of the squared distance say that they are too far, or have one foot, which Newton's
    method finds; so nothing nearer is missed.
    (Where faces are squeezed into a curve, along which there are feet without end, small cells are
    left to Newton's method alone; where they are 1000 times as long as wide, or more, distances
    may be off by 1e-8.) A point that is as far from many places, as the centre of a
    ball, costs more: from 2000 cells of one point on, its cells that cannot be nearer by more than
    rounding are left to Newton's method as well, and for every 2000 more by twice that. So a
    search ends, and what it found is nearest up to that, 2e-12 after 20 000 cells.

    Compiled kernels search, if the surface has them (`LimitSurface.engine`), and NumPy for points
    whose feet they do not settle: next to special corners, or about as far from very many places.

    A sign is that of the side of the foot: of its normal, of the sum of both normals on an edge, of
    the normals around a vertex by their angles (Baerentzen and Aanaes 2005); points on the surface,
    up to rounding, are outside. All this is derived in
    ``derivations/closest.py``.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> found = ls.closest_point(ls.LimitSurface(square), [[0.25, 0.5, 2.0], [3.0, 0.5, 0.0]])
    >>> found.distance.round(12).tolist(), found.u.round(12).tolist()
    ([2.0, 2.0], [0.25, 1.0])
    """
    surface = checked_surface(surface, channel)
    cells = Cells.of(surface, threads(workers))
    if signed:
        refuse_open(surface, "inside and outside need")
    asked = _asked(points)
    most = checked_number("max_distance", max_distance, least=0)
    flat = asked.reshape(-1, 3)
    scaled = _scaled(cells, flat)
    kernels = kernels_for(surface.engine, cells, len(flat))
    shape = asked.shape[:-1]
    face = np.full(len(flat), -1, dtype=np.int64)
    u, v = np.full((2, len(flat)), np.nan)

    def work(part: slice) -> None:
        here = part.start + np.flatnonzero(np.isfinite(scaled[part]).all(axis=1))
        within = np.full(len(here), _ldexp(most, cells.power))
        found = search(kernels, cells, scaled[here], within, False)
        found = found[_chosen(surface, cells, found, scaled[here])]
        _polish(surface, cells, found, scaled[here])
        at = here[found.query]
        face[at], u[at], v[at] = found.face, found.u, found.v

    for _ in over_chunks(len(flat), threads(workers), work, _CHUNK):
        pass
    known = np.flatnonzero(face >= 0)
    point, normal = np.full((2, len(flat), 3), np.nan)
    distance = np.where(np.isfinite(flat).all(axis=1), np.inf, np.nan)
    places = face[known], u[known], v[known]
    point[known] = surface.evaluate(*places, workers=workers)
    normal[known] = surface.normal(*places, workers=workers)
    distance[known] = _lengths(flat[known] - point[known])
    beyond = np.flatnonzero(distance > most)
    face[beyond], distance[beyond] = -1, np.inf
    for x in (u, v, point, normal):
        x[beyond] = np.nan
    if signed:
        known = np.flatnonzero(face >= 0)
        distance[known] *= sides(
            surface, cells, flat[known], (face[known], u[known], v[known]),
            point[known], normal[known],
        )  # fmt: skip
    distance, face, u, v = (x.reshape(shape)[()] for x in (distance, face, u, v))
    point, normal = (x.reshape(*shape, 3) for x in (point, normal))
    return ClosestPoints(point, distance, face, u, v, normal)


@dataclass(frozen=True, eq=False, repr=False)
class FeetOfPoints:
    """Feet of points on a surface, made by `feet`: a run for each point, the nearest first.

    Attributes
    ----------
    offsets : (n + 1,) int64
        The feet of point k are numbers ``offsets[k]`` to ``offsets[k + 1]``, exclusive.
    point, normal : (m, 3) float64
    distance, u, v : (m,) float64
    face : (m,) int64
        As in `ClosestPoints`.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> ls.feet(ls.LimitSurface(square), [[0.5, 0.5, 2.0]], within=3.0)
    FeetOfPoints(1 foot of 1 point)
    """

    offsets: Array
    point: Array
    distance: Array
    face: Array
    u: Array
    v: Array
    normal: Array

    def _repr_html_(self) -> str:
        columns = {name: getattr(self, name) for name in ("face", "u", "v", "distance", "point")}
        return html.table({"foot of point": html.runs(self.offsets), **columns}, repr(self))

    def __repr__(self) -> str:
        m, n = len(self.face), len(self.offsets) - 1
        what = f"{m} {'foot' if m == 1 else 'feet'} of {n} point{'s' * (n != 1)}"
        return f"{type(self).__name__}({what})"


def feet(
    surface: LimitSurface,
    points: ArrayLike,
    *,
    within: float,
    channel: str | None = None,
    workers: int = 1,
) -> FeetOfPoints:
    """All places within a distance from which a surface goes away from points on all sides.

    These are the feet of perpendiculars at which the distance is smallest nearby, and places on
    boundaries, creases and vertices where it is.

    Parameters
    ----------
    surface : LimitSurface
        Of float64 points, (n_vertices, 3).
    points : (n, 3) array_like
    within : float
        Feet farther away are left out.
    channel : str, optional
        A face-varying channel of three columns, to search instead of the points.
    workers : int
        Threads, as for `LimitSurface.evaluate`; answers do not depend on it.

    Returns
    -------
    FeetOfPoints
        Those of each point by distance, each once: on the smallest of the limit faces that share
        it. Points that are not finite have none.

    Raises
    ------
    TypeError, ValueError
        As `closest_point` does.

    Examples
    --------
    Both sides of a sheet that is folded over:

    >>> import limitsurf as ls
    >>> fold = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [1, 1, 1], [0, 1, 1],
    ...                 [1, 0, 1], [0, 0, 1]], [[0, 1, 2, 3], [3, 2, 4, 5], [5, 4, 6, 7]])
    >>> found = ls.feet(ls.LimitSurface(fold), [[0.5, 0.25, 0.5]], within=1.0)
    >>> found.offsets.tolist(), found.face.tolist()
    ([0, 2], [0, 2])
    """
    surface = checked_surface(surface, channel)
    cells = Cells.of(surface, threads(workers))
    asked, most = _asked(points), checked_number("within", within, least=0)
    if asked.ndim != 2:
        raise ValueError(f"points must be of shape (n, 3), got {asked.shape}")
    scaled = _scaled(cells, asked)
    kernels = kernels_for(surface.engine, cells, len(asked))

    def work(part: slice) -> Feet:
        here = part.start + np.flatnonzero(np.isfinite(scaled[part]).all(axis=1))
        reach = np.full(len(here), _ldexp(most, cells.power))
        found = search(kernels, cells, scaled[here], reach, True)
        found = _local(surface, cells, found, scaled[here])
        found.query = here[found.query]
        return found

    parts = over_chunks(len(asked), threads(workers), work, _CHUNK)
    found = Feet.joined([Feet.none(), *parts])
    places = found.face, found.u, found.v
    point = surface.evaluate(*places, workers=workers).reshape(-1, 3)
    distance = _lengths(asked[found.query] - point)
    order = np.lexsort((found.u, found.v, found.face, distance, found.query))
    order = order[distance[order] <= most]
    counts = np.bincount(found.query[order], minlength=len(asked))
    face, u, v = (x[order] for x in places)
    normal = surface.normal(face, u, v, workers=workers).reshape(-1, 3)
    offsets = np.concatenate([[0], np.cumsum(counts)])
    return FeetOfPoints(offsets, point[order], distance[order], face, u, v, normal)


def _local(surface: LimitSurface, cells: Cells, feet: Feet, points: Array) -> Feet:
    """Those feet from which the surface goes away on all sides, each once."""
    most = _STAYS * (1 + feet.distance)
    stays = _off(surface, cells, feet, points) <= most
    _snap(surface, cells, feet, stays)
    around = shared(surface, feet.face, feet.u, feet.v)
    if len(around.owner):
        # on sides: if it does so in all limit faces there
        goes = np.ones(len(feet.query), dtype=bool)
        edge, vertex = np.flatnonzero(~around.corner), np.flatnonzero(around.corner)
        query = points[feet.query[around.owner]]
        falls = (
            beside_edge(surface, cells, around.some(edge), query[edge]) > most[around.owner[edge]]
        )
        goes[around.owner[edge][falls]] = False
        low, high = np.zeros((2, len(feet.query)))
        slopes = around_vertex(surface, cells, around.some(vertex), query[vertex])
        np.minimum.at(low, around.owner[vertex], slopes.min(axis=1, initial=0))
        np.maximum.at(high, around.owner[vertex], slopes.max(axis=1, initial=0))
        at = np.unique(around.owner[vertex])
        goes[at] = (low[at] >= -_LEVEL) & (stays[at] | (high[at] > _STEEP))
        own = np.unique(around.owner)
        stays[own] = goes[own]
    _leave_saddles(surface, cells, feet, points, around, stays)
    if len(around.owner):
        # all of the same place are the one on the smallest limit face
        order = np.lexsort((around.u, around.v, around.face, around.owner))
        owner, first = np.unique(around.owner[order], return_index=True)
        for array, values in ((feet.face, around.face), (feet.u, around.u), (feet.v, around.v)):
            array[owner] = values[order[first]]
    feet = feet[np.flatnonzero(stays)]
    feet = feet[_once(feet)]
    return feet[_apart(surface, cells, feet)]


def _leave_saddles(
    surface: LimitSurface, cells: Cells, feet: Feet, points: Array, around: Shared, stays: Array
) -> None:
    """Of feet beside vertices, in `stays`, those from which the distance falls some way are not."""
    inner = stays.copy()
    inner[around.owner[around.corner]] = False
    own, sides_ = np.flatnonzero(inner), inner[around.owner]
    owner = np.concatenate([own, around.owner[sides_]])
    face, u, v = (
        np.concatenate([getattr(feet, x)[own], getattr(around, x)[sides_]])
        for x in ("face", "u", "v")
    )
    distance = feet.distance[owner]
    few, rounding = _STAYS * (1 + distance), 4 * SAME * (1 + distance)
    falls = falls_nearby(surface, cells, (face, u, v), points[feet.query[owner]], few, rounding)
    stays[owner[falls]] = False


def _apart(surface: LimitSurface, cells: Cells, feet: Feet) -> Array:
    """Feet, less those beside sides that others on a smaller limit face across are too."""
    edges = np.array(cells.lattice.edges, dtype=float)
    place = np.stack([np.ones(len(feet.u)), feet.u, feet.v])
    on = (edges @ place).min(axis=0, initial=np.inf) <= _ALIKE
    which = np.flatnonzero(on)
    point = surface.evaluate(feet.face[which], feet.u[which], feet.v[which]).reshape(-1, 3)
    order = np.lexsort((feet.face[which], feet.distance[which], feet.query[which]))
    which, point = which[order], np.ldexp(point[order], cells.power)
    again = np.zeros(len(which), dtype=bool)
    cage = surface.limit_faces.face[feet.face[which]]
    for step in range(1, len(which)):
        a, b = which[:-step], which[step:]
        near = feet.query[a] == feet.query[b]
        near &= feet.distance[b] - feet.distance[a] <= 4 * SAME * (1 + feet.distance[a])
        if not near.any():
            break
        near &= np.abs(point[:-step] - point[step:]).max(axis=1) <= 16 * _STAYS
        near &= feet.face[a] != feet.face[b]
        near[near] = _touch(surface, cage[:-step][near], cage[step:][near])
        # (the later in this order is not always that on the larger face)
        later = feet.face[b] > feet.face[a]
        again[step:] |= near & later
        again[:-step] |= near & ~later
    drop = np.zeros(len(feet.u), dtype=bool)
    drop[which[again]] = True
    return np.flatnonzero(~drop)


def _touch(surface: LimitSurface, one: Array, other: Array) -> Array:
    """Whether faces of the cage (n,) have vertices in common with others, or are the same."""
    mesh = surface.mesh
    known = np.sort(mesh.indices * mesh.n_faces + mesh.corner_face)
    each = mesh.sizes[one]
    owner = np.repeat(np.arange(len(one)), each)
    step = np.arange(len(owner)) - np.repeat(np.cumsum(each) - each, each)
    key = mesh.indices[mesh.offsets[one][owner] + step] * mesh.n_faces + other[owner]
    there = known[np.minimum(np.searchsorted(known, key), len(known) - 1)] == key
    return np.bincount(owner[there], minlength=len(one)) > 0


def _snap(surface: LimitSurface, cells: Cells, feet: Feet, level: Array) -> None:
    """Put feet that are vertices, but for rounding, on these; more so where a surface is level."""
    ends = cells.form.ends
    place = np.stack([feet.u, feet.v], axis=1)
    gap = np.abs(place[:, None] - ends).max(axis=2)
    near = np.flatnonzero(gap.min(axis=1, initial=np.inf) <= _ALIKE)
    end = ends[gap[near].argmin(axis=1)]
    face = feet.face[near]
    both = surface.evaluate(face, *place[near].T) - surface.evaluate(face, *end.T)
    reach = np.where(level[near], 16 * _STAYS, POINT)
    same = np.abs(np.ldexp(both, cells.power)).max(axis=1, initial=0) <= reach
    feet.u[near[same]], feet.v[near[same]] = end[same].T


def _once(feet: Feet) -> Array:
    """One of the feet that are the same place of a limit face, up to rounding."""
    order = np.lexsort((feet.u, feet.v, feet.distance, feet.face, feet.query))
    some = feet[order]
    u, v = some.u, some.v
    again = np.zeros(len(order), dtype=bool)
    for step in range(1, len(order)):
        a, b = slice(None, -step), slice(step, None)
        same = (some.query[a] == some.query[b]) & (some.face[a] == some.face[b])
        same &= np.abs(some.distance[a] - some.distance[b]) <= 4 * SAME * (1 + some.distance[a])
        if not same.any():
            break
        again[b] |= same & (np.abs(u[a] - u[b]) + np.abs(v[a] - v[b]) <= _ALIKE)
    return np.asarray(order[~again])


def _chosen(surface: LimitSurface, cells: Cells, feet: Feet, points: Array) -> Array:
    """Which feet are the answers, one for each query that has any."""
    nearest = np.full(len(points), np.inf)
    np.minimum.at(nearest, feet.query, feet.distance)
    near = nearest[feet.query]
    tied = np.flatnonzero(feet.distance <= near + SAME * (1 + near))
    several = np.bincount(feet.query[tied], minlength=len(points))[feet.query[tied]] > 1
    off = np.zeros(len(tied))
    off[several] = _off(surface, cells, feet[tied[several]], points)
    # what would be nearer still beyond its side is not a foot, if there is one
    moves = off > _STAYS * (1 + near[tied])
    u, v = feet.u[tied], feet.v[tied]
    order = np.lexsort((u, v, feet.face[tied], moves, feet.query[tied]))
    _, first = np.unique(feet.query[tied][order], return_index=True)
    return np.asarray(tied[order[first]])


def _polish(surface: LimitSurface, cells: Cells, feet: Feet, points: Array) -> None:
    """Move feet a little along parameters, where that is nearer, as Gauss's method says.

    In slivers derivatives are about parallel, by 1e-6 beside some corners. What differs from that
    is all that squared distances tell both parameters apart by, and next to rounding: Newton's
    method ends anywhere along a valley, and off a side of the domain when it is put back there.
    """
    which = np.flatnonzero(_off(surface, cells, feet, points) > SAME)
    for _ in range(_POLISHED if len(which) else 0):
        face, u, v = feet.face[which], feet.u[which], feet.v[which]
        jet = surface.jet(face, u, v, order=1)
        x, a, b = (np.ldexp(jet[nu].reshape(-1, 3), cells.power) for nu in ((0, 0), (1, 0), (0, 1)))
        gap, best = x - points[feet.query[which]], np.stack([u, v])
        least = (gap**2).sum(axis=1)
        for s, t in ((1, 0), (0, 1), (1, -1)):
            way = s * a + t * b
            with np.errstate(all="ignore"):
                step = -(gap * way).sum(axis=1) / (way**2).sum(axis=1)
            step = np.where(np.abs(step) <= _ALIKE, step, 0)  # (not where there is no derivative)
            p, q = inside(cells.lattice, u + s * step, v + t * step)
            there = np.ldexp(surface.evaluate(face, p, q).reshape(-1, 3), cells.power)
            square = ((there - points[feet.query[which]]) ** 2).sum(axis=1)
            nearer = square < least
            least = np.where(nearer, square, least)
            best = np.where(nearer, [p, q], best)
        feet.u[which], feet.v[which] = best
        which = which[(best != [u, v]).any(axis=0)]


def _off(surface: LimitSurface, cells: Cells, feet: Feet, points: Array) -> Array:
    """By how much feet would move if they could leave their limit face, (n,)."""
    off = feet.off.copy()
    unknown = np.flatnonzero(np.isnan(off))
    if len(unknown):
        places = feet.face[unknown], feet.u[unknown], feet.v[unknown]
        jet = surface.jet(*places, order=1)
        x, a, b = (np.nan_to_num(np.ldexp(jet[nu], cells.power)) for nu in ((0, 0), (1, 0), (0, 1)))
        off[unknown] = in_plane(x - points[feet.query[unknown]], a, b)
    return off


def _asked(points: ArrayLike) -> Array:
    """Points (..., 3) in float64."""
    given = np.asarray(points)
    if given.dtype == numbers.RATIONAL.dtype or given.dtype.kind not in "iuf":
        raise TypeError(f"points must be real numbers in float64, got {given.dtype}")
    if given.ndim == 0 or given.shape[-1] != 3:
        raise ValueError(f"points must be of shape (..., 3), got {given.shape}")
    return given.astype(float, copy=False)


def _scaled(cells: Cells, points: Array) -> Array:
    """Points (n, 3) in the unit of an index; what is far away beyond measure is drawn nearer."""
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        size = np.abs(points).max(axis=1, initial=0, keepdims=True)
        power = np.frexp(size)[1] + cells.power
        near = np.minimum(power, _FAR)
        found = np.ldexp(points, cells.power - (power - near))
    found[~np.isfinite(points).all(axis=1)] = np.nan
    return np.asarray(found)


def _ldexp(value: float, power: int) -> float:
    with np.errstate(over="ignore", under="ignore"):
        return float(np.ldexp(value, power))


def _lengths(vectors: Array) -> Array:
    """Lengths (n,) of vectors, also where squares would overflow or vanish."""
    power = np.frexp(np.abs(vectors).max(axis=1, initial=0))[1]
    power = np.where(np.abs(power) < 400, 0, power)
    with np.errstate(over="ignore", under="ignore"):
        scaled = np.ldexp(vectors, -power[:, None])
        return np.asarray(np.ldexp(np.sqrt((scaled**2).sum(axis=1)), power))
