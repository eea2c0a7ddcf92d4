"""Cubic B-splines fitted to polylines, such as sections of a surface, within a tolerance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf import html
from limitsurf.cad.chains import Chains, Kind
from limitsurf.cage.checks import checked_number
from limitsurf.cage.mesh import Mesh
from limitsurf.fem.checks import reals
from limitsurf.query.index import checked_surface
from limitsurf.query.records import Polylines
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_DEGREE = 3
_RELATIVE = 1e-4  # tolerances that nobody chose, of the longest side of a curve's box
_CORNER = 30.0  # degrees
_SETTLE = 3  # times that parameters are moved to feet, for each set of knots
_PERIODS = 4  # spans of a closed curve, at least
_CROWDED = 0.75  # knots to a point, from which on splines wave between points: it goes through all
_EACH, _FINEST = 8, 512  # places along a side of a surface, at first and at most
_BETWEEN = 4  # times as many that say how far off a spline is
_CUBIC = 1e-13  # of a curve: what is so near to a cubic is one
_COLLAPSED = 1e-13  # of the cage: edges so short are points
_SAME = 2.0**-44  # of a curve: points so near to the one before say nothing
_SEEDS, _TRIED = 8, 4  # places of a span from which feet are sought, and how many are tried
_RIDGE = 1e-15  # of the normal equations: what no point tells stays small


@dataclass(frozen=True, eq=False, repr=False)
class SplineCurves:
    """Cubic B-spline curves, made by `fit_curve`.

    Attributes
    ----------
    knots : (K,) float64
        Of all curves, one after the other: clamped, each inner one once, but three times at
        corners. They are lengths along the polyline, from 0 on, or count the sides of a surface.
    points : (C, d) float64
        Control points of all curves; of one curve four fewer than knots.
    knot_offsets, point_offsets : (n + 1,) int64
        Knots of curve k are numbers ``knot_offsets[k]`` to ``knot_offsets[k + 1]``, exclusive.
    closed : (n,) bool
        Whether a curve ends where it begins; if there is no corner, with equal first and second
        derivatives.
    deviation : (n,) float64
        The largest distance of the curve from a point of the polyline: at most this. Of curves of
        a surface, from places that are four times as dense as those that it was fitted to.

    Examples
    --------
    >>> import limitsurf as ls
    >>> ls.fit_curve([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    SplineCurves(1 curve of 4 control points, 0 closed, deviation at most 0)
    """

    knots: Array
    points: Array
    knot_offsets: Array
    point_offsets: Array
    closed: Array
    deviation: Array
    degree: int = _DEGREE

    def __len__(self) -> int:
        return len(self.closed)

    def __getitem__(self, curve: int) -> tuple[Array, Array]:
        """Knots and control points of one curve."""
        n = len(self)
        if not -n <= curve < n:
            raise IndexError(f"curve {curve} is out of range, need 0 to {n - 1}")
        curve %= n
        knots = self.knots[self.knot_offsets[curve] : self.knot_offsets[curve + 1]]
        return knots, self.points[self.point_offsets[curve] : self.point_offsets[curve + 1]]

    @property
    def domain(self) -> Array:
        """First and last parameter of each curve, (n, 2)."""
        ends = np.stack([self.knot_offsets[:-1], self.knot_offsets[1:] - 1], axis=1)
        return np.asarray(self.knots[ends].reshape(-1, 2))

    def evaluate(self, curve: ArrayLike, t: ArrayLike, *, nu: int = 0) -> Array:
        """Points of curves, or derivatives of order `nu`.

        Parameters
        ----------
        curve : int or array_like
            Numbers of curves; they broadcast with `t`.
        t : array_like
            Parameters in the `domain` of the curve; NaN gives NaN.
        nu : int
            0 to 3.

        Returns
        -------
        ndarray, shape (..., d)

        Raises
        ------
        IndexError
            For a curve that does not exist.
        ValueError
            For a parameter outside of its domain.

        Examples
        --------
        >>> import limitsurf as ls
        >>> line = ls.fit_curve([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
        >>> line.evaluate(0, [0.5, 2.0]).round(12).tolist()
        [[0.5, 0.0], [2.0, 0.0]]
        """
        from scipy.interpolate import BSpline

        which, at = np.broadcast_arrays(np.asarray(curve), reals("t", t))
        if which.size and which.dtype.kind not in "iu":
            raise TypeError(f"curve must be integers, got {which.dtype}")
        flat, place = which.ravel().astype(np.int64), at.ravel()
        if wrong := flat[(flat < 0) | (flat >= len(self))].tolist():
            raise IndexError(f"curve {wrong[0]} is out of range, need 0 to {len(self) - 1}")
        low, high = self.domain[flat].reshape(-1, 2).T
        outside = np.flatnonzero((place < low) | (place > high))
        if len(outside):
            k = outside[0]
            raise ValueError(
                f"t = {place[k]} is outside of the domain of curve {flat[k]}, "
                f"[{low[k]:g}, {high[k]:g}]"
            )
        found = np.empty((len(flat), self.points.shape[1]))
        for one in np.unique(flat):
            here = flat == one
            knots, points = self[int(one)]
            found[here] = BSpline(knots, points, _DEGREE)(place[here], nu=nu)
        return found.reshape(*which.shape, self.points.shape[1])

    def _repr_html_(self) -> str:
        columns = {
            "control points": np.diff(self.point_offsets),
            "closed": self.closed,
            "deviation": self.deviation,
        }
        return html.table(columns, repr(self))

    def __repr__(self) -> str:
        n, most = len(self), float(f"{self.deviation.max(initial=0):.3g}")
        what = f"{n} curve{'s' * (n != 1)} of {len(self.points)} control points"
        said = f"{what}, {int(self.closed.sum())} closed, deviation at most {most:g}"
        return f"{type(self).__name__}({said})"


class _Spline(NamedTuple):
    knots: Array
    points: Array
    deviation: float


def fit_curve(
    curves: ArrayLike | Sequence[ArrayLike] | Polylines | Mesh | LimitSurface,
    *,
    tolerance: float | None = None,
    closed: bool | Sequence[bool] | None = None,
    corner_angle: float = _CORNER,
    edges: Kind | None = None,
) -> SplineCurves:
    """Cubic B-spline curves through points, or along the sharp edges of a surface.

    They have as few knots as a tolerance takes.

    Parameters
    ----------
    curves : (n, d) array_like, sequence of these, Curves, Mesh or LimitSurface
        Points in order along a curve, in any dimension; several such curves; what `section`,
        `contour`, `silhouette` or `intersect_surfaces` found; or a surface (that of a Mesh is its
        limit surface), of which the curves are its boundaries, then its infinitely sharp creases,
        each from one end or branch to the next.
    tolerance : float, optional
        How far a spline may be from a point, in the units of the points. By default 1e-4 of the
        longest side of the box around each curve.
    closed : bool or sequence of bool, optional
        Whether curves go on from their last point to the first. By default as `Curves` say; of
        points, those that end where they begin.
    corner_angle : float
        Degrees between 0 and 180. Where a polyline turns by more, its curve has a corner there,
        through which it goes; elsewhere it has continuous second derivatives.
    edges : {"boundary", "crease"}, optional
        Which curves of a surface; by default both.

    Returns
    -------
    SplineCurves
        In the order of the curves. Open ones go through their first and last point, in their
        direction; closed ones of points with corners begin at the first of these.

    Raises
    ------
    TypeError
        For points that are no real numbers.
    ValueError
        For fewer than two different points, some that are not finite (it says which), a tolerance
        that is not above 0, and another number of `closed`; for `closed` of a surface, `edges` of
        points, and surfaces of dual schemes, whose limit faces have no sides along edges of cages.

    Notes
    -----
    Least squares of distances: parameters start as lengths along the polyline, and are moved to the
    nearest places of the spline (Hoschek, "Intrinsic parametrization for approximation", Computer
    Aided Geometric Design 1988); where a point is too far away, its span of knots gets one more, at
    the middle one of its points. In the end, or where points do not allow more, every point is
    gone through. Between points nothing is known: the polyline itself is off by its own tolerance.
    Curves of a surface are taken at more and more places until what is between these is within the
    tolerance as well; `deviation` is then what four times as many places have. Most sharp curves
    are splines of the cage by themselves, one span to an edge: these are taken as they are, where
    that takes no more control points.

    Examples
    --------
    >>> import numpy as np
    >>> import limitsurf as ls
    >>> angle = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    >>> circle = ls.fit_curve(np.stack([np.cos(angle), np.sin(angle)], axis=1), closed=True,
    ...                       tolerance=1e-4)
    >>> bool(circle.deviation[0] <= 1e-4), len(circle.points) < 20
    (True, True)
    """
    if edges not in (None, "boundary", "crease"):
        raise ValueError(f"edges must be 'boundary', 'crease' or None, got {edges!r}")
    angle = checked_number("corner_angle", corner_angle, above=0, below=180)
    if tolerance is not None:
        tolerance = checked_number("tolerance", tolerance, above=0, below=np.inf)
    if isinstance(curves, (Mesh, LimitSurface)):
        if closed is not None:
            raise ValueError("closed is of points: of the curves of a surface it is known")
        found, loops = _of_surface(curves, edges, tolerance, np.deg2rad(angle))
    else:
        if edges is not None:
            raise ValueError("edges are those of a surface: give one, or leave them out")
        lines, loops = _polylines(curves, closed)
        found = [
            _curve(line, loop, tolerance, np.deg2rad(angle))
            for line, loop in zip(lines, loops, strict=True)
        ]
    width = found[0].points.shape[1] if found else 3
    counts = np.array([(len(one.knots), len(one.points)) for one in found], dtype=np.int64)
    offsets = np.zeros((len(found) + 1, 2), dtype=np.int64)
    np.cumsum(counts.reshape(-1, 2), axis=0, out=offsets[1:])
    return SplineCurves(
        np.concatenate([np.zeros(0), *(one.knots for one in found)]),
        np.concatenate([np.zeros((0, width)), *(one.points for one in found)]),
        offsets[:, 0],
        offsets[:, 1],
        np.array(loops, dtype=bool),
        np.array([one.deviation for one in found], dtype=float),
    )


def _of_surface(
    given: Mesh | LimitSurface, kind: Kind | None, tolerance: float | None, angle: float
) -> tuple[list[_Spline], list[bool]]:
    """Splines along boundaries and creases of a surface, and whether they are closed."""
    surface = checked_surface(LimitSurface(given) if isinstance(given, Mesh) else given)
    if surface.topology.lattice.dual:
        name = surface.topology.rules.scheme.name
        raise ValueError(
            f"limit faces of scheme {name!r} have no sides along edges of the cage: give points of "
            "its boundary"
        )
    chains = Chains(surface, kind)
    used = surface.points[surface.mesh.vertex_faces > 0] / 2
    extent = 2 * float(np.ptp(used, axis=0).max(initial=0)) if len(used) else 0.0
    found: list[_Spline] = []
    loops: list[bool] = []
    for k, loop in enumerate(chains.closed.tolist()):
        each = _EACH
        dense = chains.points(k, _BETWEEN * each)
        if not np.isfinite(dense).all():
            raise ValueError(f"curve {k} of the surface has points that are not finite")
        side = float((dense.max(axis=0) / 2 - dense.min(axis=0) / 2).max()) * 2
        if side <= _COLLAPSED * extent:
            continue
        most = _RELATIVE * side if tolerance is None else tolerance
        while True:
            (line,), (shut,) = _polylines(dense[::_BETWEEN], bool(loop))
            one = _curve(line, shut, most, angle)
            one = one._replace(deviation=_distance(one, dense))
            each *= 2
            if one.deviation <= most or each > _FINEST:
                break
            dense = chains.points(k, _BETWEEN * each)
        exact = _exact(chains.points(k, _EACH), dense)
        found.append(exact if exact and len(exact.points) <= len(one.points) else one)
        loops.append(shut)
    return found, loops


def _exact(points: Array, dense: Array) -> _Spline | None:
    """The spline that a curve with `_EACH` points along each side is, one span to a side.

    None if it is no cubic between them. Where sides do not meet with two equal derivatives the
    knot counts three times.
    """
    from scipy.interpolate import BSpline, PPoly, make_interp_spline

    middle = points.min(axis=0) / 2 + points.max(axis=0) / 2
    power = int(np.frexp(np.ptp(points / 2, axis=0).max())[1]) + 1
    scaled = np.ldexp(points - middle, -power)
    sides = np.arange(len(points) // _EACH)[:, None] * _EACH + np.arange(_EACH + 1)
    powers = (np.arange(_EACH + 1) / _EACH)[:, None] ** np.arange(_DEGREE, -1, -1)
    coefficients = np.matmul(np.linalg.pinv(powers), scaled[sides])  # (sides, 4, d)
    if np.abs(powers @ coefficients - scaled[sides]).max() > _CUBIC:
        return None
    breaks = np.arange(len(sides) + 1.0)
    curve = PPoly(coefficients.transpose(1, 0, 2), breaks)
    before, after = coefficients[:-1], coefficients[1:]
    jumps = (3 * before[:, 0] + 2 * before[:, 1] + before[:, 2] - after[:, 2],
             3 * before[:, 0] + before[:, 1] - after[:, 1])  # fmt: skip
    smooth = np.abs(np.concatenate(jumps, axis=1)).max(axis=1) <= _CUBIC
    inner = np.repeat(breaks[1:-1], np.where(smooth, 1, _DEGREE))
    clamp = np.ones(_DEGREE + 1)
    knots = np.concatenate([0 * clamp, inner, breaks[-1] * clamp])
    means = np.lib.stride_tricks.sliding_window_view(knots[1:-1], _DEGREE).mean(axis=1)
    control = make_interp_spline(means, curve(means), _DEGREE, t=knots).c
    control[[0, -1]] = scaled[[0, -1]]
    at = np.linspace(0, len(sides), len(dense))
    gap = BSpline(knots, control, _DEGREE)(at) - np.ldexp(dense - middle, -power)
    away = float(np.sqrt((gap**2).sum(axis=1)).max())
    control = np.ldexp(control, power) + middle
    return _Spline(knots, control, float(np.ldexp(away, power))) if away <= _CUBIC else None


def _distance(one: _Spline, points: Array) -> float:
    """The largest distance of points (n, d) from a spline."""
    from scipy.interpolate import BSpline
    from scipy.spatial import cKDTree

    spline = BSpline(one.knots, one.points, _DEGREE)
    low, high = one.knots[0], one.knots[-1]
    breaks = np.unique(one.knots)
    seeds = breaks[:-1, None] + np.diff(breaks)[:, None] * np.arange(_SEEDS) / _SEEDS
    seeds = np.append(seeds.ravel(), high)
    at = spline(seeds)
    scale = 2.0 ** -float(np.frexp(np.abs(points - points[0]).max())[1])
    k = min(_TRIED, len(seeds))  # some, as at corners a place knows one side alone
    _, near = cKDTree((at - points[0]) * scale).query((points - points[0]) * scale, k=k)
    t, points = seeds[near.ravel()], np.repeat(points, k, axis=0)
    least = np.full(len(points), np.inf)
    for _ in range(_SETTLE + 3):
        gap, way = (points - spline(t)) * scale, spline(t, nu=1) * scale
        least = np.minimum(least, np.sqrt((gap**2).sum(axis=1)))
        square = (way**2).sum(axis=1)
        bent = square - (gap * spline(t, nu=2) * scale).sum(axis=1)
        with np.errstate(all="ignore"):
            step = (gap * way).sum(axis=1) / np.where(bent > 0.1 * square, bent, square)
        t = np.clip(t + np.nan_to_num(step), low, high)
    return float(least.reshape(-1, k).min(axis=1).max() / scale)


def _polylines(given: Any, closed: Any) -> tuple[list[Array], list[bool]]:
    """Points of each curve, without those that repeat the one before, and whether it is closed."""
    if isinstance(given, Polylines):
        known: Any = given
        lines = np.split(known.point, known.offsets[1:-1]) if len(known) else []
        loops = known.closed.tolist() if closed is None else closed
    else:
        several = isinstance(given, (list, tuple)) and len(given) and np.ndim(given[0]) == 2
        each = given if several else [given]
        lines = [reals(f"points of curve {k}", x) for k, x in enumerate(each)]
        loops = closed
    if isinstance(loops, (bool, np.bool_)) or loops is None:
        loops = [loops] * len(lines)
    if len(loops) != len(lines):
        raise ValueError(f"closed must be one for each of {len(lines)} curves, got {len(loops)}")
    widths = {x.shape[-1] if x.ndim == 2 else -1 for x in lines}
    if -1 in widths or len(widths) > 1 or 0 in widths:
        shapes = ", ".join(str(x.shape) for x in lines[:4])
        raise ValueError(f"points of curves must be of shape (n, d) with one d, got {shapes}")
    found: list[tuple[Array, bool]] = []
    for k, (line, loop) in enumerate(zip(lines, loops, strict=True)):
        wrong = np.flatnonzero(~np.isfinite(line).all(axis=1))
        if len(wrong):
            what = f"point {wrong[0]} of curve {k}"
            raise ValueError(f"points must be finite, got {line[wrong[0]]} as {what}")
        if len(line):
            half = line / 2
            least = _SAME * float(np.ptp(half, axis=0).max())
            keep = np.append(True, (np.abs(np.diff(half, axis=0)) > least).any(axis=1))
            line, half = line[keep], half[keep]
            back = bool((np.abs(half[0] - half[-1]) <= least).all())
        ends = len(line) > (2 if loop else 3) and back
        if ends:
            line = line[:-1] if loop is not False else line
            loop = True if loop is None else loop
        if len(line) < 2:
            raise ValueError(f"curve {k} has fewer than two different points")
        found.append((line, bool(loop) and len(line) > 2))
    return [x for x, _ in found], [x for _, x in found]


def _curve(line: Array, closed: bool, tolerance: float | None, angle: float) -> _Spline:
    """The spline of one polyline."""
    low, high = line.min(axis=0), line.max(axis=0)
    power = int(np.frexp((high / 2 - low / 2).max())[1])
    middle = low / 2 + high / 2
    scaled = np.ldexp(line - middle, -power)
    most = _RELATIVE * float(np.ptp(scaled, axis=0).max())
    if tolerance is not None:
        most = float(np.ldexp(tolerance, -power))
    corners = _corners(scaled, closed, angle)
    if closed and not len(corners):
        parts = [_Piece(np.concatenate([scaled, scaled[:1]]), True).within(most)]
    else:
        if closed:
            scaled = np.roll(scaled, -corners[0], axis=0)
            scaled = np.concatenate([scaled, scaled[:1]])
            corners = corners - corners[0]
        cuts = np.unique(np.concatenate([[0], corners, [len(scaled) - 1]]))
        parts = [
            _Piece(scaled[a : b + 1], False).within(most)
            for a, b in zip(cuts[:-1].tolist(), cuts[1:].tolist(), strict=True)
        ]
    knots, points, start = [np.zeros(_DEGREE + 1)], [parts[0].points[:1]], 0.0
    for one in parts:
        # what two pieces share, the end of one and the start of the next, is there once
        knots.append(start + one.knots[_DEGREE + 1 : -_DEGREE - 1])
        points.append(one.points[1:])
        start += one.knots[-1]
        knots.append(np.full(_DEGREE, start))
    knots.append(np.full(1, start))
    deviation = max(one.deviation for one in parts)
    if np.frexp(start)[1] + power > np.finfo(float).maxexp:
        raise ValueError(
            f"a curve is {start:.3g} times 2 ** {power} long, which float64 cannot hold: scale it "
            "down"
        )
    return _Spline(
        np.ldexp(np.concatenate(knots), power),
        np.ldexp(np.concatenate(points), power) + middle,
        float(np.ldexp(deviation, power)),
    )


def _corners(points: Array, closed: bool, angle: float) -> Array:
    """Points (n,) at which a polyline turns by more than an angle."""
    before, after = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
    size = np.sqrt((before**2).sum(axis=1) * (after**2).sum(axis=1))
    turned = (before * after).sum(axis=1) < np.cos(angle) * size
    if not closed:
        turned[[0, -1]] = False
    return np.flatnonzero(turned)


class _Piece:
    """A part of a polyline (n, d) without corners, and a spline that comes closer to it.

    Where it is closed, its last point is its first one.
    """

    def __init__(self, points: Array, closed: bool) -> None:
        self._points, self._closed = points, closed
        steps = np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1))
        self._along = np.concatenate([[0.0], np.cumsum(steps)])
        self._length = float(self._along[-1])

    def within(self, most: float) -> _Spline:
        """A spline that is at most so far from each point."""
        if len(self._points) == 2:  # noise is corners throughout: as many of these as points
            knots = np.repeat([0.0, self._length], _DEGREE + 1)
            share = np.linspace(0, 1, _DEGREE + 1)[:, None]
            return _Spline(knots, (1 - share) * self._points[0] + share * self._points[1], 0.0)
        spans = _PERIODS if self._closed else 1
        if len(self._points) <= max(spans, _DEGREE):
            return self._through()
        t = self._along
        at = np.round(np.linspace(0, len(t) - 1, spans + 1)).astype(np.int64)
        breaks = t[at]
        while True:
            t, points, away = self._settled(breaks, self._along)
            if away.max() <= most:
                return self._clamped(breaks, points, float(away.max()))
            finer = self._finer(breaks, self._along, away > most)
            if finer is None or len(finer) > _CROWDED * len(t):
                return self._through()
            breaks = finer

    # ------------------------------------------------------------------ one set of knots

    def _knots(self, breaks: Array) -> Array:
        """Clamped ones, or those of a periodic spline, from its ends."""
        if not self._closed:
            return np.concatenate([[0.0] * _DEGREE, breaks, [self._length] * _DEGREE])
        before, after = breaks[-_DEGREE - 1 : -1] - self._length, breaks[1 : _DEGREE + 1]
        return np.concatenate([before, breaks, after + self._length])

    def _settled(self, breaks: Array, t: Array) -> tuple[Array, Array, Array]:
        """Parameters, control points and distances, after parameters were moved to feet."""
        knots = self._knots(breaks)
        best: tuple[Array, Array, Array] | None = None
        for _ in range(_SETTLE):
            points = self._least_squares(knots, t)
            away = self._away(knots, points, t)
            if best is None or away.max() < best[2].max():
                best = t, points, away
            t = self._feet(knots, points, t)
            away = self._away(knots, points, t)
            if away.max() < best[2].max():
                best = t, points, away
        assert best is not None
        return best

    def _least_squares(self, knots: Array, t: Array) -> Array:
        """Control points of the spline that is nearest at given parameters."""
        from scipy.interpolate import BSpline
        from scipy.sparse import eye_array
        from scipy.sparse.linalg import splu, spsolve

        rows = BSpline.design_matrix(t, knots, _DEGREE).tocsc()
        if self._closed:
            n = rows.shape[1] - _DEGREE
            own = rows[:, :n].tolil()
            own[:, :_DEGREE] += rows[:, n:]
            rows, targets = own.tocsc()[:-1], self._points[:-1]
        else:
            ends = self._points[[0, -1]]
            targets = self._points[1:-1] - rows[1:-1][:, [0, -1]] @ ends
            rows = rows[1:-1, 1:-1]
        if rows.shape[0] == rows.shape[1]:
            found = splu(rows).solve(targets)
            return np.concatenate([found, found[:_DEGREE]])
        square = (rows.T @ rows).tocsc()
        ridge = _RIDGE * square.diagonal().max() * eye_array(square.shape[0], format="csc")
        found = spsolve((square + ridge).tocsc(), rows.T @ targets).reshape(-1, targets.shape[1])
        if self._closed:
            return np.concatenate([found, found[:_DEGREE]])
        return np.concatenate([ends[:1], found, ends[1:]])

    def _away(self, knots: Array, points: Array, t: Array) -> Array:
        from scipy.interpolate import BSpline

        gap = BSpline(knots, points, _DEGREE)(t) - self._points
        return np.asarray(np.sqrt((gap**2).sum(axis=1)))

    def _feet(self, knots: Array, points: Array, t: Array) -> Array:
        """Parameters moved by a step of Newton's method, in the order they were in."""
        from scipy.interpolate import BSpline

        spline = BSpline(knots, points, _DEGREE)
        gap, first, second = self._points - spline(t), spline(t, nu=1), spline(t, nu=2)
        square = (first**2).sum(axis=1)
        bent = square - (gap * second).sum(axis=1)
        with np.errstate(all="ignore"):
            step = (gap * first).sum(axis=1) / np.where(bent > 0.1 * square, bent, square)
        half = np.minimum(np.diff(t, prepend=t[0]), np.diff(t, append=t[-1])) / 2.5
        new = t + np.clip(np.nan_to_num(step), -half, half)
        new[0], new[-1] = 0.0, self._length
        return np.asarray(new)

    @staticmethod
    def _finer(breaks: Array, t: Array, far: Array) -> Array | None:
        """Breaks with one more in each span that has a point too far away and room for it."""
        span = np.clip(np.searchsorted(breaks, t, side="right") - 1, 0, len(breaks) - 2)
        wanted = np.unique(span[far])
        first, last = (np.searchsorted(span, wanted, side=side) for side in ("left", "right"))
        room = last - first >= 2
        if not room.any():
            return None
        low, high = first[room], last[room]
        middle = (low + high) // 2
        new = (t[middle - 1] + t[middle]) / 2
        return np.asarray(np.sort(np.concatenate([breaks, new])))

    def _clamped(self, breaks: Array, points: Array, away: float) -> _Spline:
        """The same spline by clamped knots."""
        from scipy.interpolate import BSpline, make_interp_spline

        if not self._closed:
            return _Spline(self._knots(breaks), points, away)
        periodic = BSpline(self._knots(breaks), points, _DEGREE)
        knots = np.concatenate([[0.0] * _DEGREE, breaks, [self._length] * _DEGREE])
        means = np.lib.stride_tricks.sliding_window_view(knots[1:-1], _DEGREE).mean(axis=1)
        means[[0, -1]] = 0.0, self._length
        found = make_interp_spline(means, periodic(means), _DEGREE, t=knots).c
        found[-1] = found[0]
        return _Spline(knots, found, away)

    def _through(self) -> _Spline:
        """The spline through all points."""
        from scipy.interpolate import make_interp_spline

        t, points = self._along, self._points
        degree = min(len(points) - 1, _DEGREE)
        if self._closed:
            found = self._clamped(t, self._least_squares(self._knots(t), t), 0.0)
        else:
            spline = make_interp_spline(t, points, degree)
            found = _Spline(spline.t, spline.c, 0.0)
        if degree < _DEGREE:  # a line or a parabola, as a cubic
            at = np.linspace(0, self._length, _DEGREE + 1)
            knots = np.repeat([0.0, self._length], _DEGREE + 1)
            found = _Spline(knots, make_interp_spline(at, spline(at), _DEGREE, t=knots).c, 0.0)
        found.points[[0, -1]] = points[[0, -1]]
        away = self._away(found.knots, found.points, t)
        return found._replace(deviation=float(away.max()))
