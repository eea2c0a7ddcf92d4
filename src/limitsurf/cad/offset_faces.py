"""Offsets of limit surfaces as clamped B-spline faces that meet along their edges."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import factorial
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from limitsurf.cad.bspline import BSplineFaces
from limitsurf.cad.edges import inner_edges, places
from limitsurf.cad.nets import clamped, square_of_triangle
from limitsurf.cad.offset_bounds import bounds
from limitsurf.cad.poles import Poles
from limitsurf.cad.splines import Splines
from limitsurf.refine import refined
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_SHARE = 1e-4  # of the size of the surface: the tolerance where none is given
_MOST = 1 << 22  # control points
_DEEPEST = 24  # halvings towards a pole
_MARGIN = 1.5  # between places more may be found than at them
_TURN = 1e-6  # of normals across an edge, in radians: more is a crease


@dataclass(frozen=True, eq=False, repr=False)
class OffsetFaces(BSplineFaces):
    """B-spline faces of an offset, made by `OffsetSurface.bspline_faces`.

    A record as `BSplineFaces`, so that `to_brep` and `write` take it; `surface` is the one that it
    is an offset of (refined once if faces are not all quadrilaterals), `exact` is False. Faces are
    interpolants, at places that a shared edge has on both sides: their edges are equal to rounding.

    Attributes
    ----------
    distance : float
        Of the offset.
    along_normal : (n,) float64
        How far each face is from the offset, as found: the part of the difference at the same
        parameters that is along the normal, and what the part across it makes of a sphere of
        radius abs(distance), or the whole difference if that is less.
    parametric : (n,) float64
        The largest difference at the same parameters, as found.
    turned : (n,) float64
        The largest angle between normals at the same parameters, in degrees, as found. Where the
        offset folds back they are opposite.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> ls.offset(ls.LimitSurface(square), 0.5).bspline_faces()
    OffsetFaces(1 face of degree (3, 3), 0 exact)
    """

    distance: float = 0.0
    along_normal: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    parametric: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    turned: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))

    @property
    def cap_errors(self) -> NoReturn:
        """There are none: these faces are not near the limit surface."""
        raise ValueError(
            "faces of an offset are not those of its surface: their own fields deviation, "
            "parametric and angle say how far they are from the offset"
        )

    @cached_property
    def bounds(self) -> Array:
        """How far each face is from the offset, at most, (n,): what `along_normal` never exceeds.

        Proved, by Bernstein coefficients of the differences, for schemes of quadrilaterals; inf
        where surfaces have no normal, or there is none that is known to hold. It takes longer than
        to make the faces, and is computed once, when it is asked for.

        Raises
        ------
        ValueError
            For schemes of triangles.

        Notes
        -----
        With the difference w from the surface to the face at the same parameters: squares of the
        length of w, and products with both derivatives of the surface, are polynomials, which
        their coefficients bound; so do those of the cross product of derivatives its length from
        below. ``derivations/offsets.py``, section 5; what remains at poles is bounded by
        eigenfunctions, as in ``derivations/spline_faces.py``.

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
        >>> faces = ls.offset(ls.LimitSurface(square), 0.5).bspline_faces()
        >>> bool(faces.bounds.max() < 1e-12)
        True
        """
        if self.trims is not None:
            raise ValueError(
                "no bounds for offsets of schemes of triangles: along_normal says what was found"
            )
        if not len(self):
            return np.zeros(0)
        n = int(self.counts[0, 0])
        net = self.points.reshape(len(self), n, n, 3)
        return bounds(self.surface, self.limit_faces, net, self.knots_u[: n + 4], self.distance)

    @property
    def deviation(self) -> Array:
        """How far each face is from the offset, as found, (n,): `along_normal`."""
        return self.along_normal

    @property
    def angle(self) -> Array:
        """How far normals are from those of the offset, as found, in degrees, (n,): `turned`."""
        return self.turned


def offset_faces(
    surface: LimitSurface, distance: float, tolerance: float | None, workers: int
) -> OffsetFaces:
    """Those of an offset at a distance, within a tolerance as far as can be found."""
    _refuse_creases(surface)
    if (surface.limit_faces.corner >= 0).any():
        fine = refined(surface.mesh, 1, **surface.rules)
        surface = LimitSurface(fine, **surface.rules, engine=surface.engine)
    used = surface.points[surface.mesh.indices]
    size = float(np.ptp(used, axis=0).max(initial=0)) if len(used) else 1.0
    wanted = _SHARE * size if tolerance is None else tolerance
    least = 2.0**-44 * max(size, abs(distance))
    if wanted <= least and len(used) and size:
        raise ValueError(f"tolerance must be above {least:.3g}, for rounding, got {wanted}")
    sloped = surface.topology.lattice.sloped
    halvings, depth = (1, 0) if sloped else (0, 4 if len(Poles.of(surface).face) else 0)
    before = np.inf
    while True:
        every = _Triangles(surface, halvings) if sloped else _Squares(surface, halvings, depth)
        found, at_pole = _made(surface, every, distance, workers)
        worst = float(found.along_normal.max(initial=0))
        if _MARGIN * worst <= wanted:
            return found
        deeper = at_pole and depth < _DEEPEST
        more = every.size if deeper else 4 * every.size
        if more > _MOST:
            raise ValueError(
                f"the offset is not within {wanted:.3g} by {_MOST} control points but within "
                f"{min(worst, before):.3g}: ask for a larger tolerance"
            )
        before = min(worst, before)
        halvings, depth = (halvings, depth + 3) if deeper else (halvings + 1, depth)


def _refuse_creases(surface: LimitSurface) -> None:
    half = inner_edges(surface)
    s = np.tile([0.25, 0.5, 0.75], (len(half), 1))
    one = surface.normal(*places(surface, half, s))
    two = surface.normal(*places(surface, surface.mesh.twin[half], 1 - s))
    apart = np.linalg.norm(one - two, axis=-1).max(axis=1, initial=0)
    bad = np.flatnonzero(apart > _TURN)
    if len(bad):
        mesh, at = surface.mesh, half[bad[0]]
        face = mesh.corner_face[at]
        first = mesh.offsets[face]
        ends = mesh.indices[at], mesh.indices[first + (at - first + 1) % mesh.sizes[face]]
        raise ValueError(
            f"both sides of an offset do not meet along sharp edges: that of vertices {ends[0]} "
            f"and {ends[1]} is the first of {len(bad)}; fit() gives a cage that is mitred there"
        )


class _Squares:
    """Cubic splines over limit faces that are squares: places to meet, and their nets."""

    def __init__(self, surface: LimitSurface, halvings: int, depth: int) -> None:
        self.face = np.flatnonzero(surface.patches.with_limit)
        graded = np.ldexp(1.0, -np.arange(1, depth + 1))
        even = np.linspace(0, 1, 2**halvings + 1)
        self.lines = np.unique(np.concatenate([even, graded, 1 - graded]))
        self.knots = clamped(self.lines, 3)
        self.count = len(self.knots) - 4
        at = (self.knots[1:-3] + self.knots[2:-2] + self.knots[3:-1]) / 3
        self.u, self.v = (x.ravel() for x in np.meshgrid(at, at, indexing="ij"))
        line = np.zeros(1, dtype=np.int64)
        one = Splines.of(
            (3, 0), np.array([[self.count, 1]]), self.knots, np.array([0.0, 1.0]),
            np.eye(self.count),
        )  # fmt: skip
        values = one.jet(np.repeat(line, self.count), at, np.zeros(self.count), 0)[0]
        self.inverse = np.linalg.inv(values)
        self.degree, self.size = 3, len(self.face) * self.count**2
        self.origin = np.zeros((len(self.face), 2))
        self.scale = self.origin + 1
        step = np.diff(self.lines)
        between = (self.lines[:-1, None] + step[:, None] * [0.23, 0.61]).ravel()
        # splines are farthest off close to poles
        ends = step[0] * np.array([0.004, 0.03, 0.07, 0.25, 0.38, 0.66])
        between = np.sort(np.concatenate([between, ends, 1 - ends]))
        self.test_u, self.test_v = (x.ravel() for x in np.meshgrid(between, between))
        cell = np.ldexp(1.0, -depth)
        near = np.minimum(self.test_u, 1 - self.test_u), np.minimum(self.test_v, 1 - self.test_v)
        self.at_corner = (np.maximum(*near) < 2 * cell) & (depth > 0)

    def net(self, values: Array) -> Array:
        """Control points (n, count^2, 3) from values at places."""
        grid = values.reshape(len(values), self.count, self.count, 3)
        return np.asarray(np.einsum("ik,fklc,jl->fijc", self.inverse, grid, self.inverse))


class _Triangles:
    """Quartic polynomials over even parts of limit faces that are triangles."""

    def __init__(self, surface: LimitSurface, halvings: int) -> None:
        n = 2**halvings
        i, j = (x.ravel() for x in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
        low, high = i + j < n, i + j < n - 1
        start = np.stack([i, j], axis=1)
        origin = np.concatenate([start[low], start[high] + 1]) / n
        scale = np.repeat([1.0, -1.0], [low.sum(), high.sum()])[:, None] * np.ones(2) / n
        faces = np.flatnonzero(surface.patches.with_limit)
        self.face = np.repeat(faces, len(origin))
        self.origin, self.scale = (np.tile(x, (len(faces), 1)) for x in (origin, scale))
        places_ = np.array([(i, j) for j in range(5) for i in range(5 - j)])
        self.u, self.v = (places_ / 4).T
        ways = [factorial(4) // (factorial(i) * factorial(j) * factorial(4 - i - j))
                for i, j in places_.tolist()]  # fmt: skip
        rest = 1 - self.u - self.v
        i, j = places_.T
        values = np.array(ways) * self.u[:, None] ** i * self.v[:, None] ** j
        values = values * rest[:, None] ** (4 - i - j)
        self.matrix = square_of_triangle(4) @ np.linalg.inv(values)
        self.knots = clamped(np.array([0.0, 1.0]), 4)
        self.count, self.degree, self.size = 5, 4, 25 * len(self.face)
        self.test_u = np.array([0.3, 0.13, 0.6, 0.15, 0.42, 0.4])
        self.test_v = np.array([0.3, 0.15, 0.15, 0.6, 0.13, 0.42])
        self.at_corner = np.zeros(6, dtype=bool)

    def net(self, values: Array) -> Array:
        """Control points (n, 25, 3) from values at places."""
        return np.asarray(np.matmul(self.matrix, values))


def _made(
    surface: LimitSurface, every: _Squares | _Triangles, d: float, workers: int
) -> tuple[OffsetFaces, bool]:
    """Faces, and whether they are worst at a pole."""
    face = every.face
    values = _points(surface, face, every, every.u, every.v, d, workers)[0]
    bad = np.argwhere(np.isnan(values).any(axis=2))
    if len(bad):
        at = bad[0]
        raise ValueError(
            f"limit face {face[at[0]]} has no normal at (u, v) = ({every.u[at[1]]:.6g}, "
            f"{every.v[at[1]]:.6g}), and no offset there"
        )
    n, m = len(face), every.count
    net = every.net(values).reshape(-1, 3)
    lattice = surface.topology.lattice
    trims = np.array([(0, 0), (1, 0), (0, 1)]) if lattice.sloped else None
    counts, knots = np.full((n, 2), m), np.tile(every.knots, n)
    one, none = np.ones((n, 2), dtype=np.int64), np.zeros(n, dtype=np.int64)
    depths = np.full((len(surface.limit_faces), len(lattice.corners)), -1)
    known = (
        surface, (every.degree, every.degree), counts, knots, knots, net, one, face, none,
        every.origin, every.scale, np.zeros(n, dtype=bool), trims, depths, depths >= 0,
    )  # fmt: skip
    made = BSplineFaces(*known)
    u, v = every.test_u, every.test_v
    true, normal = _points(surface, face, every, u, v, d, workers)
    which = np.arange(n)[:, None]
    away = made.evaluate(which, u, v) - true
    whole = np.linalg.norm(away, axis=2)
    along = np.abs((away * normal).sum(axis=2))
    if d:
        along = np.minimum(along + (whole**2 - along**2).clip(0) / (2 * abs(d)), whole)
    cosine = (made.normal(which, u, v) * normal).sum(axis=2)
    turned = np.degrees(np.arccos(np.clip(np.nan_to_num(cosine, nan=1.0), -1, 1)))
    at_pole = bool(along.size and every.at_corner[np.argmax(along.max(axis=0))])
    measures = (x.max(axis=1, initial=0) for x in (along, whole, turned))
    return OffsetFaces(*known, d, *measures), at_pole


def _points(
    surface: LimitSurface,
    face: Array,
    every: _Squares | _Triangles,
    u: Array,
    v: Array,
    distance: float,
    workers: int,
) -> tuple[Array, Array]:
    """Points of the offset and normals (n, q, 3) at places (q,) of faces."""
    at = every.origin[:, None] + every.scale[:, None] * np.stack([u, v], axis=1)
    at = np.clip(at, 0, 1)
    x, y = at[..., 0], at[..., 1]
    where = np.broadcast_to(face[:, None], x.shape)
    normal = surface.normal(where, x, y, workers=workers)
    return surface.evaluate(where, x, y, workers=workers) + distance * normal, normal
