"""Where offsets of limit surfaces fold back, or come nearer than their distance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import html
from limitsurf.cad.poles import Poles
from limitsurf.cage.checks import checked_integer
from limitsurf.query.closest import closest_point
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_ZOOMS = 4  # each to 3/5 of a cell on either side
_RINGS = 40  # halvings towards a pole
_SHALLOW = 8  # of these, where what is found is the face's, not the pole's
_NEARER = 1e-6  # of the distance, or the size if that is less: what a search leaves
_ROUNDING = 1e-14  # of the distance


@dataclass(frozen=True, eq=False, repr=False)
class Folds:
    """Where an offset is singular, made by `OffsetSurface.folds`.

    Attributes
    ----------
    least : (n_limit_faces,) float64
        The least factor 1 - d k of each limit face that was found, k a principal curvature that is
        positive towards the normal. The offset is regular where it is positive, and folds back
        where it is negative. NaN on faces without a limit.
    u, v : (n_limit_faces,) float64
        Where.
    singular : (s,) int64
        Limit faces with a factor that is not positive.
    pole, limit_face, corner : (r,) int64
        Poles of the surface at which curvature diverges, each as a corner of a limit face, so
        often as faces have it; `pole` is a vertex, or the middle of face k: n_vertices + k.
    radius : (r,) float64
        How far from the pole, on that limit face, abs(d k) is 1/2 or more: there the offset is
        rounded off to curvature -1 / d at the pole, or folds back. Where it is far below what
        counts, as it often is, that can be left alone; `any` does.
    turns : (r,) bool
        Whether it folds back there, and is only C0 at the pole; else it is C1.
    near_face : (m,) int64
    near_u, near_v : (m,) float64
    clearance : (m,) float64
        Places whose points of the offset are nearer to the surface than abs(d), and how near: of
        the offset, what intersects itself, and what lies beyond.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> ls.offset(ls.LimitSurface(square), 2.0).folds()
    Folds(0 singular limit faces, 0 places too near, 0 poles)
    """

    least: NDArray[np.float64]
    u: NDArray[np.float64]
    v: NDArray[np.float64]
    singular: NDArray[np.int64]
    pole: NDArray[np.int64]
    limit_face: NDArray[np.int64]
    corner: NDArray[np.int64]
    radius: NDArray[np.float64]
    turns: NDArray[np.bool_]
    near_face: NDArray[np.int64]
    near_u: NDArray[np.float64]
    near_v: NDArray[np.float64]
    clearance: NDArray[np.float64]

    @property
    def any(self) -> bool:
        """Whether anything was found that folds back or is too near, what poles do not counted."""
        return bool(len(self.singular) or len(self.near_face))

    def __repr__(self) -> str:
        n, m = len(self.singular), len(self.near_face)
        found = f"{n} singular limit face{'s' * (n != 1)}, {m} place{'s' * (m != 1)} too near"
        return f"{type(self).__name__}({found}, {len(np.unique(self.pole))} poles)"

    def _repr_html_(self) -> str:
        columns = {name: getattr(self, name) for name in ("least", "u", "v")}
        return html.table({"limit face": np.arange(len(self.least)), **columns}, repr(self))


def folds_of(surface: LimitSurface, distance: float, samples: int, workers: int) -> Folds:
    """Those of the offset at a distance, from so many samples a side."""
    samples = checked_integer("samples", samples, 1)
    faces = np.flatnonzero(surface.patches.with_limit)
    sloped = surface.topology.lattice.sloped
    u, v = _inside(samples, sloped)
    n = len(surface.limit_faces)
    least, at = np.full(n, np.nan), np.full((2, n), np.nan)
    if len(faces):
        factor = _factor(surface, faces[:, None], u, v, distance, workers)
        best = np.argmin(factor, axis=1)
        least[faces] = factor[np.arange(len(faces)), best]
        at[:, faces] = u[best], v[best]
        _zoom(surface, faces, least, at, 1 / samples, distance, workers)
    poles = _poles(surface, distance, least, at, workers)
    near = _near(surface, faces, u, v, distance, workers)
    singular = np.flatnonzero(least <= 0)
    return Folds(least, at[0], at[1], singular, *poles, *near)


def _inside(samples: int, sloped: bool) -> tuple[Array, Array]:
    """Places in a limit face, none on its edges."""
    line = (np.arange(samples) + 0.5) / samples
    u, v = (x.ravel() for x in np.meshgrid(line, line, indexing="ij"))
    if sloped:
        u = u * 1.0
        v = v * (1 - u)
    return u, v


def _factor(
    surface: LimitSurface, face: Array, u: Array, v: Array, distance: float, workers: int
) -> Array:
    """The less of both factors 1 - d k; inf where there are none."""
    bent = surface.curvature(face, u, v, workers=workers)
    with np.errstate(invalid="ignore", over="ignore"):
        both = (1 - distance * np.asarray(k) for k in (bent.k1, bent.k2))
        found = np.minimum(*both)
    return np.asarray(np.where(np.isnan(found), np.inf, found))


def _zoom(
    surface: LimitSurface,
    faces: Array,
    least: Array,
    at: Array,
    step: float,
    distance: float,
    workers: int,
) -> None:
    """Seek lower factors around the best places so far, in place."""
    i, j = (x.ravel() for x in np.meshgrid(np.arange(-2, 3), np.arange(-2, 3)))
    for _ in range(_ZOOMS):
        step *= 0.3
        u = np.clip(at[0, faces, None] + step * i, 0, 1)
        v = np.clip(at[1, faces, None] + step * j, 0, 1)
        if surface.topology.lattice.sloped:
            v = np.minimum(v, 1 - u)
        factor = _factor(surface, faces[:, None], u, v, distance, workers)
        best = np.argmin(factor, axis=1)
        rows = np.arange(len(faces))
        better = factor[rows, best] < least[faces]
        here = faces[better]
        least[here] = factor[rows, best][better]
        at[:, here] = u[rows, best][better], v[rows, best][better]


def _poles(
    surface: LimitSurface, distance: float, least: Array, at: Array, workers: int
) -> tuple[Array, Array, Array, Array, Array]:
    """Poles where curvature diverges, and how far from them it counts; enters what folds there."""
    ends = Poles.of(surface)
    base = ends.corners[ends.corner].astype(float)
    corners = ends.corners.astype(float)
    following = corners[(ends.corner + 1) % len(corners)] - base
    previous = corners[(ends.corner - 1) % len(corners)] - base
    share = np.array([0.125, 0.3125, 0.5, 0.6875, 0.875])
    toward = following[:, None] * (1 - share)[:, None] + previous[:, None] * share[:, None]
    scale = np.ldexp(1.0, -np.arange(1, _RINGS))[:, None, None, None]
    place = base[:, None] + scale * toward  # (rings, poles, rays, 2)
    face = np.broadcast_to(ends.face[:, None], place.shape[:-1])
    bent = surface.curvature(face, place[..., 0], place[..., 1], workers=workers)
    dk = distance * np.stack([bent.k1, bent.k2])
    with np.errstate(invalid="ignore", over="ignore"):
        size = np.nanmax(np.abs(dk), axis=(0, 3), initial=0.0)  # (rings, poles)
        signed = np.nanmax(dk, axis=(0, 3), initial=-np.inf)
    # curvature is of the order (mu / lambda^2)^n: it diverges if it still grows at depth
    known = size[16] > 0
    grows = known & (size[24] > 1.02 * size[16]) & (size[16] > 1.02 * size[8])
    points = surface.evaluate(face, place[..., 0], place[..., 1], workers=workers)
    centre = surface.evaluate(ends.face, base[:, 0], base[:, 1], workers=workers)
    away = np.linalg.norm(points - centre[:, None], axis=-1).max(axis=2)
    radius = _radius(size, away)
    turns = grows & (signed[24] > 1.02 * signed[16]) & (signed[16] > 0)
    lowest = 1 - signed[:_SHALLOW].max(axis=0, initial=0.0)
    best = least.copy()
    np.fmin.at(best, ends.face, lowest)
    lower = np.flatnonzero((lowest == best[ends.face]) & (lowest < least[ends.face]))
    at[:, ends.face[lower]] = base[lower].T
    least[:] = best
    kept = np.flatnonzero(grows)
    return ends.pole[kept], ends.face[kept], ends.corner[kept], radius[kept], turns[kept]


def _radius(size: Array, away: Array) -> Array:
    """How far from poles (r,) abs(d k) is 1/2, from that and distances of rings (n, r)."""
    found = np.where(size >= 0.5, away, 0.0).max(axis=0, initial=0.0)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        # beyond the last ring curvature goes on as a power of the distance
        power = np.log(size[32] / size[24]) / np.log(away[32] / away[24])
        beyond = away[32] * (0.5 / size[32]) ** (1 / power)
    return np.asarray(np.where(found > 0, found, beyond))


def _near(
    surface: LimitSurface, faces: Array, u: Array, v: Array, distance: float, workers: int
) -> tuple[Array, Array, Array, Array]:
    """Places whose points of the offset have the surface nearer than its distance."""
    face = np.repeat(faces, len(u))
    u, v = np.tile(u, len(faces)), np.tile(v, len(faces))
    if not distance or not len(face):
        none = np.zeros(0)
        return np.zeros(0, dtype=np.int64), none, none, none
    normal = surface.normal(face, u, v, workers=workers)
    points = surface.evaluate(face, u, v, workers=workers) + distance * normal
    known = np.isfinite(points).all(axis=1)
    face, u, v, points = face[known], u[known], v[known], points[known]
    found = closest_point(surface, points, workers=workers).distance
    size = float(np.ptp(surface.points[surface.mesh.indices], axis=0).max())
    least = _NEARER * min(size, abs(distance)) + _ROUNDING * abs(distance)
    near = found < abs(distance) - least
    return face[near], u[near], v[near], found[near]
