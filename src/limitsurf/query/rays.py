"""Where rays hit a surface, and what it has inside."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from limitsurf import html, numbers
from limitsurf.cage.checks import count
from limitsurf.engine.packing import over_chunks
from limitsurf.engine.protocol import threads
from limitsurf.integrals.checks import refuse_open
from limitsurf.query.crossings import TIED, Crossings, Hits, Rays
from limitsurf.query.index import Cells, checked_surface
from limitsurf.query.sides import covered
from limitsurf.query.traversal import followed, kernels_for
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_CHUNK, _MANY = 1 << 12, 1 << 15  # rays that are followed at once, by NumPy and by kernels
_ALIKE = 1e-7  # parameters of hits that are one, where several cells have it
_TOUCHES = 2.0**-16  # the same where rays touch: the root of what rounding does, and more
_CLEAR = 2.0**-38  # depths that are known better are of rays that do not graze
_ON = 2.0**-44  # points that are nearer, of the largest coordinate, are on a surface
# how many rays beside one that seems to touch are tried; how far they are from it, and how far
# along it what they hit counts, at most and at least: of curvature 1 it is the root of twice that
_BESIDE, _ASIDE, _AROUND, _CLOSE = 4, 2.0**-40, 2.0**-12, 2.0**-18
_DRAWS = 24  # directions of rays from points whose side is sought


@dataclass(frozen=True, eq=False, repr=False)
class RayHits:
    """First hits of rays on a surface, made by `intersect`.

    Attributes
    ----------
    hit : (...) bool
    t : (...) float64
        ``origin + t * direction`` is where the ray hits; inf where it does not.
    face : (...) int64
        Limit faces; -1 where nothing was hit.
    u, v : (...) float64
    point : (..., 3) float64
        ``surface.evaluate(face, u, v)``.
    normal : (..., 3) float64
        ``surface.normal(face, u, v)``: not turned towards the ray.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> ls.intersect(ls.LimitSurface(square), [[0.5, 0.5, 2.0], [0.5, 3, 2]], [0.0, 0, -1])
    RayHits(2 rays, 1 hit)
    """

    hit: Array
    t: Array
    face: Array
    u: Array
    v: Array
    point: Array
    normal: Array

    def _repr_html_(self) -> str:
        flat = {name: html.rows(getattr(self, name)) for name in ("hit", "t", "face", "u", "v")}
        ends = {name: html.rows(getattr(self, name), 1) for name in ("point", "normal")}
        return html.table({**flat, **ends}, repr(self))

    def __repr__(self) -> str:
        hits = int(np.count_nonzero(self.hit))
        return f"RayHits({count(self.hit.size, 'ray')}, {count(hits, 'hit')})"


@dataclass(frozen=True, eq=False, repr=False)
class AllRayHits:
    """All hits of rays on a surface, made by `intersect_all`: a run for each ray, by t.

    Attributes
    ----------
    offsets : (n + 1,) int64
        The hits of ray k are numbers ``offsets[k]`` to ``offsets[k + 1]``, exclusive.
    multiplicity : (m,) int64
        1 where the ray crosses the surface, 2 where it touches it.
    t, u, v : (m,) float64
    face : (m,) int64
    point, normal : (m, 3) float64
        As in `RayHits`.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> ls.intersect_all(ls.LimitSurface(square), [[0.5, 0.5, 2.0]], [[0.0, 0, -1]])
    AllRayHits(1 hit of 1 ray)
    """

    offsets: Array
    t: Array
    face: Array
    u: Array
    v: Array
    point: Array
    normal: Array
    multiplicity: Array

    def _repr_html_(self) -> str:
        names = ("t", "face", "u", "v", "multiplicity", "point", "normal")
        columns = {name: getattr(self, name) for name in names}
        return html.table({"hit of ray": html.runs(self.offsets), **columns}, repr(self))

    def __repr__(self) -> str:
        rays = count(len(self.offsets) - 1, "ray")
        return f"AllRayHits({count(len(self.t), 'hit')} of {rays})"


def intersect(
    surface: LimitSurface,
    origins: ArrayLike,
    directions: ArrayLike,
    *,
    t_min: ArrayLike = 0.0,
    t_max: ArrayLike = np.inf,
    channel: str | None = None,
    workers: int = 1,
) -> RayHits:
    """The first places where rays hit a surface: of the limit itself, to float64.

    Parameters
    ----------
    surface : LimitSurface
        Of float64 points, (n_vertices, 3).
    origins, directions : (..., 3) array_like
        They broadcast. Directions need not be of length 1: t counts them.
    t_min, t_max : array_like
        Hits count from one to the other, both included: one for all rays, or one for each. With
        `t_max` 1 and a direction from one point to another this is the segment between them.
    channel : str, optional
        A face-varying channel of three columns, to search instead of the points.
    workers : int
        Threads, as for `LimitSurface.evaluate`; answers do not depend on it.

    Returns
    -------
    RayHits
        Arrays of the shape of the rays. What hits nothing, or is not finite, has False, inf, -1 and
        NaN. A hit on a side that limit faces share is on the smallest of them.

    Raises
    ------
    TypeError
        For what is not real numbers, and for a surface of exact ones.
    ValueError
        For other shapes, a direction of zero, or bounds that are NaN.

    Notes
    -----
    The ray passes within 1e-13 of the largest coordinate of each `point`, and t is right within
    that over the cosine between ray and normal. Limit faces are cut into Bezier cells
    (`SurfaceIndex`), which are the surface exactly; around special corners their rings go as deep
    as it takes. Cells are halved until a ray misses the hull of their coefficients, or a bound on
    their derivatives says that it crosses at most once, which Newton's method then finds: no hit is
    missed, also on sides. Where a ray touches the surface its place is known to some 1e-7 of the
    size alone, as a double root is. (Where very many small cells are mere curves as a ray sees
    them, they are left to Newton's method alone; and so is what is left of a ray after 1024
    halvings for each cell that it meets.) Where a ray runs along the surface, in a flat face, each
    cell has one of the places. All this is derived in ``derivations/rays.py``.

    Compiled kernels follow rays, if the surface has them (`LimitSurface.engine`), and NumPy those
    that touch or pass special corners; so do answers agree but for their last digits.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> found = ls.intersect(ls.LimitSurface(square), [0.25, 0.5, 2.0], [0.0, 0.0, -4.0])
    >>> bool(found.hit), float(found.t), round(float(found.u), 12), round(float(found.v), 12)
    (True, 0.5, 0.25, 0.5)
    """
    surface = checked_surface(surface, channel)
    asked = _Asked.of(origins, directions, t_min, t_max)
    n, workers = len(asked), threads(workers)
    cells = Cells.of(surface, workers)
    hits = _followed(surface, cells, asked, workers, "first")
    order = np.lexsort((hits.t, hits.ray))
    ray, first = np.unique(hits.ray[order], return_index=True)
    hits = hits[order[first]]
    hit, face = np.zeros(n, dtype=bool), np.full(n, -1, dtype=np.int64)
    t, u, v = np.full(n, np.inf), *np.full((2, n), np.nan)
    point, normal = np.full((2, n, 3), np.nan)
    places = hits.face, hits.u, hits.v
    hit[ray], t[ray], face[ray], u[ray], v[ray] = True, hits.t, *places
    point[ray] = surface.evaluate(*places, workers=workers)
    normal[ray] = surface.normal(*places, workers=workers)
    hit, t, face, u, v = (x.reshape(asked.shape)[()] for x in (hit, t, face, u, v))
    point, normal = (x.reshape(*asked.shape, 3) for x in (point, normal))
    return RayHits(hit, t, face, u, v, point, normal)


def intersect_all(
    surface: LimitSurface,
    origins: ArrayLike,
    directions: ArrayLike,
    *,
    t_min: ArrayLike = 0.0,
    t_max: ArrayLike = np.inf,
    channel: str | None = None,
    workers: int = 1,
) -> AllRayHits:
    """All places where rays hit a surface, in order along each ray.

    Parameters
    ----------
    surface : LimitSurface
        Of float64 points, (n_vertices, 3).
    origins, directions : (n, 3) array_like
        They broadcast.
    t_min, t_max : array_like
    workers : int
        As for `intersect`.

    Returns
    -------
    AllRayHits
        Each hit once, also on sides and at vertices that limit faces share: on the smallest of
        them. Where a ray touches the surface, and a hit stands for two, `multiplicity` is 2: also
        on an edge, or at a vertex, beside which rays hit an even number of times.

    Raises
    ------
    TypeError, ValueError
        As `intersect` does.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> ball = ls.LimitSurface(ls.Mesh(points, quads))
    >>> found = ls.intersect_all(ball, [[0.5, 0.5, 2.0], [2, 2, 2]], [[0.0, 0, -1], [-1, -1, -1]])
    >>> found.offsets.tolist(), found.t.round(4).tolist()
    ([0, 2, 4], [1.0802, 1.9198, 1.25, 1.75])
    """
    surface = checked_surface(surface, channel)
    asked = _Asked.of(origins, directions, t_min, t_max)
    if len(asked.shape) != 1:
        raise ValueError(f"rays must be of shape (n, 3), got {(*asked.shape, 3)}")
    workers = threads(workers)
    cells = Cells.of(surface, workers)
    hits = _followed(surface, cells, asked, workers, "every")
    hits = hits[np.lexsort((hits.face, hits.t, hits.ray))]
    _settle(surface, cells, asked, hits)
    offsets = np.concatenate([[0], np.cumsum(np.bincount(hits.ray, minlength=len(asked)))])
    places = hits.face, hits.u, hits.v
    point = surface.evaluate(*places, workers=workers).reshape(-1, 3)
    normal = surface.normal(*places, workers=workers).reshape(-1, 3)
    return AllRayHits(offsets, hits.t, *places, point, normal, 1 + hits.touch)


def occluded(
    surface: LimitSurface,
    origins: ArrayLike,
    directions: ArrayLike,
    *,
    t_min: ArrayLike = 0.0,
    t_max: ArrayLike = np.inf,
    channel: str | None = None,
    workers: int = 1,
) -> NDArray[np.bool_]:
    """Whether rays hit a surface at all, which is known sooner than where.

    Parameters
    ----------
    surface : LimitSurface
        Of float64 points, (n_vertices, 3).
    origins, directions : (..., 3) array_like
    t_min, t_max : array_like
    channel : str, optional
    workers : int
        As for `intersect`.

    Returns
    -------
    array of bool, (...)
        The same as ``intersect(...).hit``.

    Raises
    ------
    TypeError, ValueError
        As `intersect` does.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> ls.occluded(ls.LimitSurface(square), [[0.5, 0.5, 2], [0.5, 2, 2]], [0.0, 0, -1]).tolist()
    [True, False]
    """
    surface = checked_surface(surface, channel)
    asked = _Asked.of(origins, directions, t_min, t_max)
    workers = threads(workers)
    cells = Cells.of(surface, workers)
    found = np.zeros(len(asked), dtype=bool)
    found[_followed(surface, cells, asked, workers, "any").ray] = True
    return np.asarray(found.reshape(asked.shape)[()])


def contains(
    surface: LimitSurface, points: ArrayLike, *, channel: str | None = None, workers: int = 1
) -> NDArray[np.bool_]:
    """Whether points are inside a closed surface, or on it.

    Parameters
    ----------
    surface : LimitSurface
        Of float64 points, (n_vertices, 3): closed, with consistent orientation.
    points : (..., 3) array_like
    channel : str, optional
        A face-varying channel of three columns, to search instead of the points.
    workers : int
        Threads, as for `LimitSurface.evaluate`; answers do not depend on it.

    Returns
    -------
    array of bool, (...)
        Whether the surface goes around the point, any number of times but 0; True for those on it,
        up to rounding; False for those that are not finite.

    Raises
    ------
    TypeError, ValueError
        As `winding_number` does.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> ball = ls.LimitSurface(ls.Mesh(points, quads))
    >>> ls.contains(ball, [[0.5, 0.5, 0.5], [0.1, 0.1, 0.1]]).tolist()
    [True, False]
    """
    number, on = _wound(checked_surface(surface, channel), points, workers)
    return np.asarray((np.nan_to_num(number) != 0) | on)


def winding_number(
    surface: LimitSurface, points: ArrayLike, *, channel: str | None = None, workers: int = 1
) -> NDArray[np.float64]:
    """How many times a closed surface goes around points.

    Parameters
    ----------
    surface : LimitSurface
        Of float64 points, (n_vertices, 3): closed, with consistent orientation.
    points : (..., 3) array_like
    channel : str, optional
        A face-varying channel of three columns, to search instead of the points.
    workers : int
        Threads, as for `LimitSurface.evaluate`; answers do not depend on it.

    Returns
    -------
    float64 array, (...)
        Whole numbers: 0 outside, 1 inside of a surface with counter-clockwise faces as seen from
        outside, -1 if it is turned inside out, others where parts overlap. On the surface that of
        one of the sides. NaN for points that are not finite.

    Raises
    ------
    TypeError
        For points that are not real numbers, and for a surface of exact ones.
    ValueError
        For points of another shape; for a surface that is not closed or not consistently oriented,
        with the first edge that says so.

    Notes
    -----
    Crossings of a ray are counted by their sides. A ray that passes near a side of a cell or grazes
    the surface is drawn again in another direction: always the same ones, so that answers are too.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> ball = ls.LimitSurface(ls.Mesh(points, quads))
    >>> ls.winding_number(ball, [[0.5, 0.5, 0.5], [0.1, 0.1, 0.1]]).tolist()
    [1.0, 0.0]
    """
    return _wound(checked_surface(surface, channel), points, workers)[0]


def _wound(surface: LimitSurface, points: ArrayLike, workers: int) -> tuple[Array, Array]:
    """Winding numbers of points (..., 3), and whether they are on the surface."""
    asked = _vectors("points", points)
    refuse_open(surface, "inside and outside need")
    workers = threads(workers)
    cells = Cells.of(surface, workers)
    flat = asked.reshape(-1, 3)
    rest = np.flatnonzero(np.isfinite(flat).all(axis=1))
    found, on = np.full(len(flat), np.nan), np.zeros(len(flat), dtype=bool)
    with np.errstate(over="ignore", under="ignore"):
        near = float(np.ldexp(_ON, -cells.power))
    for draw in range(_DRAWS):
        way = np.random.default_rng(draw).normal(size=3)
        way /= np.sqrt((way**2).sum())
        some = flat[rest]
        bounds = np.broadcast_to([[-near], [np.inf]], (2, len(rest)))
        rays = _Asked((len(rest),), some, np.broadcast_to(way, some.shape), *bounds)
        hits = _followed(surface, cells, rays, workers, "every")
        here = np.bincount(hits.ray[np.abs(hits.t) <= near], minlength=len(rest)) > 0
        ahead = hits[np.flatnonzero(hits.t > 0)]
        found[rest] = np.bincount(ahead.ray, ahead.sign, minlength=len(rest))
        on[rest] |= here
        doubt = ahead.rim | ahead.touch | (ahead.blur > _CLEAR) | (ahead.sign == 0)
        again = np.bincount(ahead.ray[doubt], minlength=len(rest)) > 0
        rest = rest[again & ~here]
        if not len(rest):
            break
    else:  # (as where faces are squeezed into curves)
        found[rest] = np.round(covered(surface, flat[rest]))
    return found.reshape(asked.shape[:-1])[()], on.reshape(asked.shape[:-1])[()]


@dataclass(frozen=True)
class _Asked:
    """Rays as they are asked for: their shape, then (n, 3) and bounds (n,)."""

    shape: tuple[int, ...]
    origins: Array
    directions: Array
    least: Array
    most: Array

    @classmethod
    def of(
        cls,
        origins: ArrayLike,
        directions: ArrayLike,
        t_min: ArrayLike,
        t_max: ArrayLike,
    ) -> _Asked:
        """Those of a call, checked."""
        start, way = _vectors("origins", origins), _vectors("directions", directions)
        zero = np.argwhere((way == 0).all(axis=-1))
        if len(zero):
            where = f" {tuple(zero[0].tolist())}" if zero.shape[1] > 1 else ""
            where = f" {int(zero[0, 0])}" if zero.shape[1] == 1 else where
            more = f" ({len(zero) - 1} more like it)" if len(zero) > 1 else ""
            raise ValueError(f"direction{where} is zero{more}: rays need a direction")
        try:
            shape = np.broadcast_shapes(start.shape, way.shape)[:-1]
        except ValueError:
            raise ValueError(
                f"origins and directions must broadcast, got {start.shape} and {way.shape}"
            ) from None
        bounds = []
        for name, given in (("t_min", t_min), ("t_max", t_max)):
            value = _real(name, given)
            if np.isnan(value).any():
                raise ValueError(f"{name} must not be NaN")
            try:
                bounds.append(np.broadcast_to(value, shape).ravel())
            except ValueError:
                raise ValueError(
                    f"{name} must be a number or of the shape of the rays, {shape}, got "
                    f"{value.shape}"
                ) from None
        start, way = (np.broadcast_to(x, (*shape, 3)).reshape(-1, 3) for x in (start, way))
        return cls(shape, start, way, *bounds)

    def __len__(self) -> int:
        return len(self.origins)

    def some(self, which: Array) -> _Asked:
        """Some of them, (k,)."""
        parts = self.origins, self.directions, self.least, self.most
        return _Asked((len(which),), *(x[which] for x in parts))

    def rays(self, cells: Cells, part: slice) -> tuple[Rays, Array]:
        """Those of a part that can be followed, in the unit of an index, and which these are."""
        start, way = self.origins[part], self.directions[part]
        known = np.isfinite(start).all(axis=1) & np.isfinite(way).all(axis=1)
        here = part.start + np.flatnonzero(known)
        bounds = self.least[here], self.most[here]
        return Rays.of(cells.power, self.origins[here], self.directions[here], *bounds), here


def _real(name: str, given: ArrayLike) -> Array:
    """An array of real numbers in float64."""
    values = np.asarray(given)
    if values.dtype == numbers.RATIONAL.dtype or values.dtype.kind not in "iuf":
        raise TypeError(f"{name} must be real numbers in float64, got {values.dtype}")
    return values.astype(float, copy=False)


def _vectors(name: str, given: ArrayLike) -> Array:
    """Vectors (..., 3) in float64."""
    values = _real(name, given)
    if values.ndim == 0 or values.shape[-1] != 3:
        raise ValueError(f"{name} must be of shape (..., 3), got {values.shape}")
    return values


def _followed(surface: LimitSurface, cells: Cells, asked: _Asked, workers: int, what: str) -> Hits:
    """Hits of rays, each once: every one, the first and some of the others, or any."""
    kernels = kernels_for(surface.engine, cells, len(asked))

    def work(part: slice) -> Hits:
        rays, here = asked.rays(cells, part)
        known, left = Hits.none(), np.arange(len(rays))
        if kernels is not None:
            known, left = followed(kernels, rays, what)
        if len(left):
            some = rays[left]
            search = Crossings(cells, some, what == "every", what == "any")
            hits = search.run()
            if what == "first":  # what was found before it
                low, high = hits.depth - TIED, hits.depth + TIED
                hits = hits[np.flatnonzero(some.in_range(hits.ray, low, high, search.best))]
            hits.ray = left[hits.ray]
            known = Hits.joined([known, hits])
        if what != "any":
            known = _once(surface, known)
        known.ray = here[known.ray]
        return known

    chunk = _CHUNK if kernels is None else _MANY
    return Hits.joined([Hits.none(), *over_chunks(len(asked), workers, work, chunk)])


def _once(surface: LimitSurface, hits: Hits) -> Hits:
    """Each of hits that cells share once; `touch` are those of which it is not known otherwise."""
    hits = hits[np.lexsort((hits.u, hits.v, hits.face, hits.depth, hits.ray))]
    n = len(hits.ray)
    one, other = np.concatenate([_on_rims(surface, hits), _in_faces(hits)], axis=1)
    known = coo_array((np.ones(len(one)), (one, other)), shape=(n, n))
    count, group = connected_components(known) if len(one) else (n, np.arange(n))
    # on a rim that no neighbour has: at a boundary, or where the ray touches
    hits.touch = hits.touch | (hits.rim & (np.bincount(group, minlength=count) == 1)[group])
    if not len(one):
        return hits
    front, back, rim, touch = (
        np.bincount(group, x, minlength=count) > 0
        for x in (hits.sign > 0, hits.sign < 0, hits.rim, hits.touch)
    )
    blur = np.zeros(count)
    np.maximum.at(blur, group, hits.blur)
    order = np.lexsort((hits.u, hits.v, hits.face, group))
    _, first = np.unique(group[order], return_index=True)
    hits = hits[order[first]]
    hits.sign, hits.rim, hits.blur = front.astype(np.int64) - back, rim, blur
    hits.touch = touch | (front & back)
    return hits


def _settle(surface: LimitSurface, cells: Cells, asked: _Asked, hits: Hits) -> None:
    """Whether rays that seem to touch do: those on both sides hit an even number of times there.

    A ray crosses at a vertex though it sees faces from both sides, where these wind around it; a
    face that is as thin as rounding is no curve.
    """
    rest = np.flatnonzero(hits.touch)
    for draw in range(_BESIDE):
        doubt = [rest[:0]]
        turn = 1 + 2.4 * draw
        step = np.ldexp(_ASIDE, 4 * draw) * np.array([np.cos(turn), np.sin(turn)])
        for part in np.split(rest, range(_CHUNK, len(rest), _CHUNK)):
            counts = [_beside(surface, cells, asked, hits, part, x) for x in (step, -step)]
            odd = np.logical_or(*((count >= 0) & (count % 2 == 1) for count in counts))
            known = odd | np.logical_and(*(count >= 0 for count in counts))
            hits.touch[part[odd]] = False
            doubt.append(part[~known])
        rest = np.concatenate(doubt)


def _beside(
    surface: LimitSurface, cells: Cells, asked: _Asked, hits: Hits, which: Array, step: Array
) -> Array:
    """How often rays by a step (2,) beside those of hits (k,) hit, near there; -1 if in doubt.

    What else the rays of the hits hit there counts as well: so it does not matter.
    """
    rays = asked.some(hits.ray[which]).rays(cells, slice(0, len(which)))[0]
    rays.start += step
    depth, own = hits.depth[which], np.arange(len(which))
    far, near = (
        np.sort(rays.time(own, depth[:, None] + [-x, x]), axis=1).T for x in (_AROUND, _CLOSE)
    )
    rays.least = np.maximum(far[0], np.minimum(rays.least, near[0]))
    rays.most = np.minimum(far[1], np.maximum(rays.most, near[1]))
    found = _once(surface, Crossings(cells, rays, True).run())
    count = np.bincount(found.ray, minlength=len(which))
    doubt = np.bincount(found.ray, found.touch, minlength=len(which)) > 0
    first, last = np.searchsorted(hits.ray, [hits.ray[which], hits.ray[which] + 1])
    for k in range(int((last - first).max(initial=0))):
        other = np.minimum(first + k, last - 1)
        here = (first + k < last) & (other != which)
        here &= np.abs(hits.depth[other] - depth) <= _AROUND
        count[here] += 1
        doubt |= here & hits.touch[other]
    return np.where(doubt, -1, count)


def _on_rims(surface: LimitSurface, hits: Hits) -> Array:
    """Hits (2, m) that are one if others are: on rims, at a depth, of faces that share a vertex.

    (Depths that are the same, within what is known of each, are intervals that overlap: of those
    of a vertex each is joined to the one before, not to all.)
    """
    mesh, rim = surface.mesh, np.flatnonzero(hits.rim)
    face = surface.limit_faces.face[hits.face[rim]]
    each = mesh.sizes[face]
    step = np.arange(int(each.sum())) - np.repeat(np.cumsum(each) - each, each)
    vertex = mesh.indices[np.repeat(mesh.offsets[face], each) + step]
    owner = np.repeat(rim, each)
    begin = hits.depth[owner] - hits.blur[owner]
    order = np.lexsort((begin, vertex, hits.ray[owner]))
    owner, vertex, begin = owner[order], vertex[order], begin[order]
    end, ray = hits.depth[owner] + hits.blur[owner], hits.ray[owner]
    new = np.ones(len(owner), dtype=bool)
    new[1:] = (ray[1:] != ray[:-1]) | (vertex[1:] != vertex[:-1])
    # the farthest end so far, of this ray and vertex
    rank = np.empty(len(end), dtype=np.int64)
    rank[by_end := np.argsort(end, kind="stable")] = np.arange(len(end))
    last = np.maximum.accumulate(np.cumsum(new) * len(end) + rank) % max(len(end), 1)
    joined = 1 + np.flatnonzero(~new[1:] & (begin[1:] <= end[by_end][last[:-1]]))
    return np.stack([owner[joined - 1], owner[joined]])


def _in_faces(hits: Hits) -> Array:
    """Hits (2, m) that are one: at a depth, in a limit face, at about one place of that.

    Those that are on rims, both, are known as such.
    """
    order = np.lexsort((hits.depth, hits.face, hits.ray))
    ray, face = hits.ray[order], hits.face[order]
    new = np.ones(len(order), dtype=bool)
    new[1:] = (ray[1:] != ray[:-1]) | (face[1:] != face[:-1])
    number = np.cumsum(new) - 1
    order = order[(np.bincount(number, ~hits.rim[order]) > 0)[number]]
    n, step = len(order), 1
    at, pairs = np.arange(n - 1), [np.zeros((2, 0), dtype=np.int64)]
    while len(at):
        one, other = order[at], order[at + step]
        close = (hits.ray[one] == hits.ray[other]) & (hits.face[one] == hits.face[other])
        close &= hits.depth[other] - hits.depth[one] <= hits.blur[one] + hits.blur[other]
        at, one, other = at[close], one[close], other[close]
        most = np.where(hits.touch[one] | hits.touch[other], _TOUCHES, _ALIKE)
        gap = np.maximum(np.abs(hits.u[one] - hits.u[other]), np.abs(hits.v[one] - hits.v[other]))
        pairs.append(np.stack([one, other])[:, gap <= most])
        step += 1
        at = at[at + step < n]
    return np.concatenate(pairs, axis=1)
