"""Limit faces as clamped B-spline faces, exact but for one cell at each special corner."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf import html
from limitsurf.caching import cached_property
from limitsurf.cad import nets, splines
from limitsurf.cad.caps import CapErrors, Caps, depths_within
from limitsurf.cad.merging import merged_faces, whole_faces
from limitsurf.cad.poles import Depths, Poles
from limitsurf.cad.splines import Layout
from limitsurf.cage.checks import checked_integer, users_level
from limitsurf.engine.protocol import Request
from limitsurf.numbers import type_of
from limitsurf.pieces.cells import BezierPatches
from limitsurf.scheme.lattice import Lattice
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_DEPTH, _DEEPEST = 8, 40
_FACES = 1024  # at once


@dataclass(frozen=True, eq=False, repr=False)
class BSplineFaces:
    """B-spline faces that are a limit surface, or near it, made by `bspline_faces`.

    Face k is the tensor product spline of `degree` with its part of `knots_u`, `knots_v` and
    `points`. Knots are clamped: they begin and end with ``degree + 1`` equal ones, so that the
    edges are the splines of the outer rows of control points, and corners are these themselves.

    Attributes
    ----------
    surface : LimitSurface
        What they were made of; of the channel, if one was asked for.
    degree : (int, int)
        Along u and along v, of all faces.
    counts : (n, 2) int64
        Control points along u and along v.
    knots_u, knots_v : (k,) float64
        Face after face; face k has ``counts[k, 0] + degree[0] + 1`` along u. Multiples of powers of
        1/2, exact.
    points : (m, d) float64
        Control points, face after face; of each those along v follow each other.
    grid : (n, 2) int64
        How many limit faces lie side by side along u and along v. Face k has the parameters
        [0, grid[k, 0]] x [0, grid[k, 1]].
    limit_faces : (l,) int64
        The limit faces of each face, ``grid.prod(axis=1)`` of them, those along v one after the
        other.
    turns : (l,) int64
        Which corner of each of these limit faces is at the low u and low v of its square.
    origin, size : (n, 2) float64
        Where faces lie in limit faces of triangles: (u, v) of the limit face are
        ``origin + size * (u, v)`` of the face. Otherwise 0 and 1.
    exact : (n,) bool
        Whether a face is the limit itself.
    trims : (3, 2) int64, or None
        Of triangles: the corners of the part of each face's square that counts, below its diagonal,
        counter-clockwise. Beyond it the polynomial goes on, the surface does not.
    depths : (n_limit_faces, 4) or (n_limit_faces, 3) int64
        How small the cells at special corners of limit faces are: 2^-depth of an edge of the cage.
        -1 at other corners.
    smooth : (n_limit_faces, 4) or (n_limit_faces, 3) bool
        Around which special corners faces share tangent planes, as ``poles="g1"`` asks.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> cube = ls.LimitSurface(ls.Mesh(points, quads))
    >>> faces = ls.bspline_faces(cube, depth=4)
    >>> faces
    BSplineFaces(6 faces of degree (3, 3), 0 exact)
    >>> faces[0].points.shape
    (11, 11, 3)
    """

    surface: LimitSurface
    degree: tuple[int, int]
    counts: NDArray[np.int64]
    knots_u: NDArray[np.float64]
    knots_v: NDArray[np.float64]
    points: NDArray[np.float64]
    grid: NDArray[np.int64]
    limit_faces: NDArray[np.int64]
    turns: NDArray[np.int64]
    origin: NDArray[np.float64]
    size: NDArray[np.float64]
    exact: NDArray[np.bool_]
    trims: NDArray[np.int64] | None
    depths: NDArray[np.int64]
    smooth: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.counts)

    def _repr_html_(self) -> str:
        columns = {name: getattr(self, name) for name in ("counts", "grid", "exact")}
        return html.table({"face": np.arange(len(self)), **columns}, repr(self))

    def __repr__(self) -> str:
        n = len(self)
        of = f"{n} face{'s' * (n != 1)} of degree {self.degree}, {int(self.exact.sum())} exact"
        return f"{type(self).__name__}({of})"

    def __getitem__(self, face: int) -> BSplineFace:
        k = checked_integer("face", face, -len(self))
        if k >= len(self):
            raise IndexError(f"face {k} is out of range of {len(self)} faces")
        k %= len(self)
        u, v, at = self.splines.first_u[k], self.splines.first_v[k], self.splines.first[k]
        (m, n), (p, q) = self.counts[k].tolist(), self.degree
        net = self.points[at : at + m * n].reshape(m, n, -1)
        return BSplineFace(
            self.degree, self.knots_u[u : u + m + p + 1], self.knots_v[v : v + n + q + 1], net
        )

    @cached_property
    def splines(self) -> splines.Splines:
        """The same as what evaluates them."""
        known = self.degree, self.counts, self.knots_u, self.knots_v, self.points
        return splines.Splines.of(*known)

    @cached_property
    def layout(self) -> Layout:
        """The same as what says where limit faces are."""
        known = self.grid, self.limit_faces, self.turns, self.origin, self.size
        return Layout(*known, self.trims is not None)

    @cached_property
    def cap_errors(self) -> tuple[Array, CapErrors]:
        """The faces that are not exact, one to each special corner, and the errors there."""
        poles = Poles.of(self.surface)
        depth = self.depths[poles.face, poles.corner]
        caps = Caps(self.surface, poles, bool(self.smooth.any()))
        errors = caps.errors(np.arange(len(depth)), depth)
        if self.trims is not None:
            return np.flatnonzero(~self.exact), errors
        none = np.zeros((len(depth), 2))
        return splines.located(self.layout, poles.face, none)[0], errors

    @property
    def deviation(self) -> Array:
        """How far each face is from the limit at the same parameters, at most, (n,): proved.

        0 where it is exact. `ls.deviation` says more.
        """
        return self._largest(self.cap_errors[1].parametric)

    @property
    def angle(self) -> Array:
        """How far normals of each face are from those of the limit, at most, (n,), in degrees."""
        return np.degrees(self._largest(self.cap_errors[1].angle))

    def _largest(self, values: Array) -> Array:
        found = np.zeros(len(self))
        np.maximum.at(found, self.cap_errors[0], values)
        return found

    def evaluate(self, face: ArrayLike, u: ArrayLike, v: ArrayLike) -> Array:
        """Points of faces at (u, v), (..., d); arguments broadcast.

        Parameters
        ----------
        face : array_like of int
        u, v : array_like
            In the faces' own parameters, [0, grid]. Those of triangles may be anywhere in the
            square.

        Raises
        ------
        IndexError, TypeError, ValueError
            For a face or parameters out of range.

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
        >>> faces = ls.bspline_faces(ls.LimitSurface(square))
        >>> faces.evaluate(0, 0.25, 0.5).round(12).tolist()
        [0.25, 0.5, 0.0]
        """
        shape, which, x, y = self._places(face, u, v)
        found = self.splines.jet(which, x, y, 0)[0]
        return np.asarray(found.reshape(*shape, self.points.shape[1]))

    def normal(self, face: ArrayLike, u: ArrayLike, v: ArrayLike) -> Array:
        """Unit normals (..., 3), as `evaluate`; NaN where derivatives are dependent.

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
        >>> abs(ls.bspline_faces(ls.LimitSurface(square)).normal(0, 0.25, 0.5)).tolist()
        [0.0, 0.0, 1.0]
        """
        if self.points.shape[1] != 3:
            raise ValueError(f"normals are of points in space, these have {self.points.shape[1]}")
        shape, which, x, y = self._places(face, u, v)
        _, du, dv = self.splines.jet(which, x, y, 1)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            du, dv = (d / np.abs(d).max(axis=1, keepdims=True) for d in (du, dv))
            cross = np.cross(du, dv)
            return np.asarray((cross / np.linalg.norm(cross, axis=1)[:, None]).reshape(*shape, 3))

    def of(self, limit_face: ArrayLike, u: ArrayLike, v: ArrayLike) -> tuple[Array, Array, Array]:
        """Where places of the limit surface are: faces, and u and v there.

        Parameters
        ----------
        limit_face : array_like of int
        u, v : array_like
            As in `LimitSurface.evaluate`; arguments broadcast.

        Returns
        -------
        face, u, v : arrays
            -1 and NaN on limit faces without a face.

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
        >>> ls.bspline_faces(ls.LimitSurface(square)).of(0, 0.25, 0.5)
        (array(0), array(0.25), array(0.5))
        """
        request = Request.of(limit_face, u, v, False, 1)
        lattice = self.surface.topology.lattice
        request.check(len(self.surface.limit_faces), lattice)
        shape = np.broadcast_shapes(np.shape(limit_face), np.shape(u), np.shape(v))
        place = np.stack([np.ravel(request.u), np.ravel(request.v)], axis=1).astype(float)
        found, x, y = splines.located(self.layout, np.ravel(request.face).astype(np.int64), place)
        return found.reshape(shape), x.reshape(shape), y.reshape(shape)

    def on_surface(self, face: ArrayLike, u: ArrayLike, v: ArrayLike) -> tuple[Array, Array]:
        """Limit faces (Q,) and u and v there (Q, 2) of places of faces, flat; the way back of `of`.

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
        >>> ls.bspline_faces(ls.LimitSurface(square)).on_surface(0, 0.25, 0.5)
        (array([0]), array([[0.25, 0.5 ]]))
        """
        _, which, x, y = self._places(face, u, v)
        return splines.on_limit_faces(self.layout, which, np.stack([x, y], axis=1))

    def _places(self, face: Any, u: Any, v: Any) -> tuple[Any, Array, Array, Array]:
        which, x, y = np.broadcast_arrays(face, np.asarray(u, float), np.asarray(v, float))
        if which.dtype.kind not in "iu":
            raise TypeError(f"faces must be integers, got {which.dtype}")
        shape, n = which.shape, len(self)
        which, x, y = which.ravel().astype(np.int64), x.ravel(), y.ravel()
        bad = np.flatnonzero((which < 0) | (which >= n))
        if len(bad):
            raise IndexError(f"face {which[bad[0]]} is out of range of {n} faces")
        for name, at, axis in (("u", x, 0), ("v", y, 1)):
            most = self.grid[which, axis]
            bad = np.flatnonzero((at < 0) | (at > most))
            if len(bad):
                k = bad[0]
                raise ValueError(f"{name} = {at[k]} is not in [0, {most[k]}] of face {which[k]}")
        return shape, which, x, y


@dataclass(frozen=True, eq=False)
class BSplineFace:
    """One of `BSplineFaces`.

    Attributes
    ----------
    degree : (int, int)
    knots_u, knots_v : (k,) float64
    points : (nu, nv, d) float64
        ``points[i, j]``: i counts along u, j along v.
    """

    degree: tuple[int, int]
    knots_u: Array
    knots_v: Array
    points: Array


def bspline_faces(
    surface: LimitSurface,
    *,
    tolerance: float | None = None,
    depth: int | None = None,
    merge: bool = True,
    poles: str = "g0",
    g1_angle: float | None = None,
    channel: str | None = None,
    workers: int = 1,
) -> BSplineFaces:
    """Limit faces as clamped B-spline faces: the surface itself, but for one cell at each pole.

    A limit face is C^(degree - 1) inside, and polynomial on pieces that end at special corners. Its
    spline has knots at the lines between pieces, graded by halves towards each special corner, down
    to one cell. All control points but the one at the corner follow from the pieces around, by
    blossoming; that one is the limit of the corner.

    Parameters
    ----------
    surface : LimitSurface
        Of float64 points (n_vertices, d).
    tolerance : float, optional
        How far a face may be from the limit at the same parameters, at most: cells at each special
        corner are as small as it takes. It is proved, not sampled.
    depth : int, optional
        The cells at special corners measure 2^-depth of an edge of the cage; 8 by default, and
        more where faces are split further. Counted so, it is the same cell from all faces around.
    merge : bool
        Whether rectangles of limit faces become one face each: of those that are faces of the cage,
        across edges that are not infinitely sharp, with special corners at their own corners alone.
        Lines are cut straight on from special corners and from all corners around three faces,
        those first that join two of them, as many as cross none of each other. A face takes all
        knots of its rows; where that is many more control points than two faces take, it is two.
        None meets itself: tubes and tori are cut along seams. Not in schemes of triangles, of
        degree 1, and of channels; with "g1" without faces that share tangent planes at poles.
    poles : {"g0", "g1"}
        With "g1" faces around a pole share tangent planes along all edges between them, and that of
        the limit at the pole. There cells have other pieces, with a line of knots in the middle;
        knots there and where cells end are double, the face C^1. In Catmull and Clark's scheme, at
        vertices within the surface without creases and at middles of faces, of three faces and
        more; others stay as they are, and a warning says how many.
    g1_angle : float, optional
        By how many degrees normals may jump across smooth edges at most; cells at special corners
        are as small as it takes. Proved: normals are within half of it of those of the limit. With
        "g1" it is of the poles that stay as they are.
    channel : str, optional
        A face-varying channel of the mesh, to give the faces of instead of the points.
    workers : int
        Threads, as for `bezier_patches`.

    Returns
    -------
    BSplineFaces
        One to each limit face that has a limit (holes are left out), or rectangle of them, in
        order. In schemes of
        triangles one to each polynomial piece, since lines of three directions are none of a
        tensor product: a polynomial over a square, of which the half below the diagonal counts.

    Raises
    ------
    TypeError
        For what is no surface of float64 points.
    ValueError
        For a depth out of range, or less than faces are split, a tolerance below rounding, one or
        an angle that the smallest cells do not reach, for an unknown channel, other `poles`, and
        for "g1" of points that are not in space.
    RuntimeWarning
        For poles that stay "g0" where "g1" was asked for, with their number.

    Notes
    -----
    Faces without special corners are equal to ``surface.evaluate`` to rounding, 1e-15 of the size,
    and so are others outside of the cells at special corners. There the spline has the limit of
    the corner, and derivatives up to the order ``degree - 1`` in common with the surface on the
    other sides of the cell. Neighbours have the same edge curve, to rounding: the curve in such a
    cell follows from that beside it on the edge alone. Their knots on it differ where one is split
    further than the other.

    With "g1", faces f and g on both sides of an edge that begins at a pole of N faces satisfy
    ``f_v + g_u = c(t) f_t`` there, with ``c(t) = 2 cos(2 pi / N) (1 - 2 t)^2`` up to the middle of
    the cell, and 0 beyond: ``derivations/g1_caps.py``, after Peters and Fan, "On the complexity of
    smooth spline surfaces from quad meshes", 2010.

    Derived in ``derivations/spline_faces.py``, after Ramshaw, "Blossoming: a connect-the-dots
    approach to splines", DEC SRC report 19, 1987.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> cube = ls.LimitSurface(ls.Mesh(points, quads))
    >>> faces = ls.bspline_faces(cube, depth=3)
    >>> faces[0].knots_u[3:-3].tolist()
    [0.0, 0.125, 0.25, 0.5, 0.75, 0.875, 1.0]
    >>> bool(abs(faces.evaluate(0, 0.3, 0.4) - cube.evaluate(0, 0.3, 0.4)).max() < 1e-14)
    True
    """
    if not isinstance(surface, LimitSurface):
        raise TypeError(f"bspline_faces needs a LimitSurface, got {type(surface).__name__}")
    found = surface.of_channel(channel)
    if type_of(found.points).exact:
        raise TypeError("bspline_faces needs float64 points: Fractions have bezier_patches")
    if found.points.ndim != 2:
        raise ValueError(f"bspline_faces needs points (n, d), got {found.points.shape}")
    if poles not in ("g0", "g1"):
        raise ValueError(f'poles must be "g0" or "g1", got {poles!r}')
    if poles == "g1" and found.points.shape[1] != 3:
        raise ValueError('poles="g1" needs points in space, (n_vertices, 3)')
    ends = Poles.of(found)
    asked = tolerance is not None or g1_angle is not None or poles == "g1"
    caps = Caps(found, ends, poles == "g1") if asked else None
    faces = np.flatnonzero(found.patches.with_limit)
    depths = _chosen(found, ends, caps, tolerance, depth, g1_angle)
    smooth = _smooth(ends, caps, depths)
    deep = ends.at_depths(found, depths + smooth.there)
    parts: list[_Alike] = []
    if merge and channel is None and _is_merged(found):
        whole = whole_faces(found)
        whole[ends.face[smooth.there]] = False
        parts.extend(_merged(found, np.flatnonzero(whole), deep, workers))
        faces = np.setdiff1d(faces, np.concatenate([faces[:0], *(x.cells.ravel() for x in parts)]))
    for depth_ in np.unique(deep.most[faces]).tolist():
        alike = faces[deep.most[faces] == depth_]
        for start in range(0, len(alike), _FACES):
            some = alike[start : start + _FACES]
            for pieces in deep.pieces(some, workers):
                parts.extend(_made(found, pieces, some, smooth))
    each = np.zeros(deep.each.shape, dtype=bool)
    each[ends.face, ends.corner] = smooth.there
    return _joined(found, parts, deep.each - each, each)


@dataclass(frozen=True, eq=False)
class _Smooth:
    """Caps that share tangent planes: as `SmoothCaps`, and the number of each special corner.

    `row` is (n_limit_faces, corners).
    """

    there: Array
    ring: Array
    inner: Array
    row: Array


def _smooth(poles: Poles, caps: Caps | None, depth: Array) -> _Smooth:
    """Those of all special corners, (r,), with cells of some depths."""
    r, row = len(poles.face), np.full((len(poles.half), len(poles.corners)), -1)
    row[poles.face, poles.corner] = np.arange(r)
    made = None if caps is None else caps.smooth(np.arange(r), depth)
    if made is None:
        none = np.zeros((r, 0))
        return _Smooth(np.zeros(r, dtype=bool), none, none, row)
    left = len(np.unique(poles.pole[~made.there]))
    if left:
        warnings.warn(
            f"{left} pole{'s' * (left > 1)} of {len(np.unique(poles.pole))} cannot share tangent "
            'planes and stay "g0": those on creases and boundaries, of fewer than three faces, '
            "without a normal, or of another scheme than Catmull and Clark's",
            RuntimeWarning,
            stacklevel=users_level(),
        )
    return _Smooth(made.there, made.ring, made.inner, row)


def _is_merged(surface: LimitSurface) -> bool:
    """Whether faces are smooth enough across edges to be one, and rectangles."""
    spline = surface.topology.rules.scheme.spline
    return not surface.topology.lattice.sloped and int(np.max(spline.exponents)) > 1


def _chosen(
    surface: LimitSurface, poles: Poles, caps: Caps | None, tolerance: Any, depth: Any, angle: Any
) -> Array:
    """Depths (r,) of special corners that are asked for, checked."""
    if depth is not None:
        if tolerance is not None or angle is not None:
            raise ValueError("give a depth, or a tolerance and g1_angle, not both")
        depth = checked_integer("depth", depth, 0)
        if depth > _DEEPEST:
            raise ValueError(
                f"depth must be 0 to {_DEEPEST}, got {depth}: knots beyond are too close together"
            )
        if depth < poles.least:
            raise ValueError(
                f"depth must be at least {poles.least} for this surface, whose faces are split as "
                f"far around special corners, got {depth}"
            )
        return np.full(len(poles.face), depth)
    if caps is None or (tolerance is None and angle is None):
        return np.full(len(poles.face), max(_DEPTH, poles.least))
    size = float(np.abs(surface.points[surface.mesh.indices]).max(initial=0))
    least = 2.0**-44 * size
    if tolerance is not None and not least < tolerance < np.inf:
        raise ValueError(f"tolerance must be above {least:.3g}, for rounding, got {tolerance}")
    if angle is not None and not 0 < angle <= 180:
        raise ValueError(f"g1_angle must be above 0 and at most 180 degrees, got {angle}")
    if angle is not None and surface.points.shape[1] != 3:
        raise ValueError("g1_angle needs points in space, (n_vertices, 3)")
    turn = None if angle is None else float(np.radians(angle)) / 2  # on both sides of an edge
    return depths_within(caps, poles, tolerance, turn, max(_DEEPEST, poles.least))


@dataclass(frozen=True, eq=False)
class _Alike:
    """Faces with the same knots.

    Attributes
    ----------
    face, part : (m,) int
        The limit face of each, and which of its parts.
    knots : (array, array)
    points : (m, nu * nv, d)
    origin, size : (m, 2)
    exact : (m,) bool
    grid : (int, int)
    cells, turns : (m, l)
        As `limit_faces` and `turns` of `BSplineFaces`.
    """

    face: Array
    part: Array
    knots: tuple[Array, Array]
    points: Array
    origin: Array
    size: Array
    exact: Array
    grid: tuple[int, int]
    cells: Array
    turns: Array


def _made(
    surface: LimitSurface, pieces: BezierPatches, faces: Array, smooth: _Smooth
) -> Iterator[_Alike]:
    """Faces of some limit faces from their pieces."""
    lattice, degree = surface.topology.lattice, pieces.degree
    n, d = len(pieces.exponents), surface.points.shape[1]
    points, limits = pieces.points.reshape(-1, n, d), _limits(surface, pieces)
    make = nets.caps if lattice.sloped else nets.net
    rows = smooth.row[pieces.rest.face, pieces.rest.corner]
    for cut in nets.alike(pieces, faces, smooth.there[rows]):
        m, c, r = len(cut.faces), len(cut.origin), len(cut.corner)
        own = faces[cut.faces]
        known = points[cut.cells].reshape(m, c * n, d)
        if r:
            known = np.concatenate([known, limits[cut.rest]], axis=1)
        capped = smooth.there[rows[cut.rest[0]]] if r else np.zeros(0, dtype=bool)
        if capped.any():
            parts = known[:, : c * n].reshape(m, c, n, d), known[:, c * n :]
            made = _capped(cut, lattice, degree, parts, smooth, capped, rows[cut.rest])
        elif r or (c > 1 and not lattice.sloped):
            flat = known.swapaxes(0, 1).reshape(-1, m * d)
            made = (make(cut, lattice, degree) @ flat).reshape(-1, m, d).swapaxes(0, 1)
        elif not lattice.sloped:
            made = known
        if not lattice.sloped:
            u, v = (nets.clamped(x, degree) for x in nets.breaks(cut, capped))
            none = np.zeros((m, 2))
            whole = np.full(m, r == 0)
            yield _Alike(
                own,
                0 * own,
                (u, v),
                made,
                none,
                none + 1,
                whole,
                (1, 1),
                own[:, None],
                0 * own[:, None],
            )
            continue
        every = known[:, : c * n].reshape(m, c, n, d)
        if r:
            every = np.concatenate([every, made.reshape(m, r, n, d)], axis=1)
        square = nets.square_of_triangle(degree)
        net = np.matmul(square, every).reshape(m * (c + r), -1, d)
        line = nets.clamped(np.array([0.0, 1.0]), degree)
        origin = np.tile(np.concatenate([cut.origin, cut.rest_origin]), (m, 1))
        size = np.tile(np.concatenate([cut.size, cut.rest_size]), (m, 1))
        whole = np.tile(np.arange(c + r) < c, m)
        part = np.tile(np.arange(c + r), m)
        own = np.repeat(own, c + r)
        cells = own[:, None]
        yield _Alike(own, part, (line, line), net, origin, size, whole, (1, 1), cells, 0 * cells)


def _capped(
    cut: nets.Cut,
    lattice: Lattice,
    degree: int,
    known: tuple[Array, Array],
    smooth: _Smooth,
    capped: Array,
    rows: Array,
) -> Array:
    """Control points (m, k, d) where tangent planes are shared at corners `capped` (r,).

    From the pieces (m, c, n, d) and limits (m, r, d); `rows` (m, r) are numbers of corners.
    """
    (every, limits), (m, c, n, d) = known, known[0].shape
    every, r = every.copy(), len(capped)
    rest = np.concatenate([every.reshape(m, c * n, d), limits], axis=1)
    rest = rest.swapaxes(0, 1).reshape(-1, m * d)
    rest = (nets.caps(cut, lattice, degree) @ rest).reshape(r, n, m, d)
    for k in np.flatnonzero(capped).tolist():
        own, to = rows[:, k], limits[:, k, None]
        rest[k] = (to + smooth.inner[own]).swapaxes(0, 1)
        for piece, at in enumerate(nets.around(cut, lattice, k)):
            every[:, at] = to + smooth.ring[own, piece]
    flat = np.concatenate([
        every.reshape(m, c * n, d).swapaxes(0, 1), rest.reshape(r * n, m, d)
    ]).reshape(-1, m * d)  # fmt: skip
    made = nets.of_pieces(cut, degree, capped) @ flat
    return np.asarray(made.reshape(-1, m, d).swapaxes(0, 1))


def _merged(surface: LimitSurface, faces: Array, depths: Depths, workers: int) -> Iterator[_Alike]:
    """Faces over rectangles of limit faces."""
    for x in merged_faces(surface, faces, depths, workers):
        face, none = x.cells[:, 0], np.zeros((len(x.cells), 2))
        whole = np.full(len(face), x.exact)
        yield _Alike(
            face, 0 * face, x.knots, x.points, none, none + 1, whole, x.grid, x.cells, x.turns
        )


def _joined(
    surface: LimitSurface, parts: list[_Alike], depths: Array, smooth: Array
) -> BSplineFaces:
    """All faces in the order of the limit faces."""
    lattice = surface.topology.lattice
    spline = surface.topology.rules.scheme.spline
    degree = int(np.max(spline.exponents))
    d = surface.points.shape[1]
    none = np.zeros(0, dtype=np.int64)
    face = np.concatenate([none, *(x.face for x in parts)])
    order = np.lexsort([np.concatenate([none, *(x.part for x in parts)]), face])
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    counts = np.zeros((len(face), 2), dtype=np.int64)
    ends = np.cumsum([0, *(len(x.face) for x in parts)])
    ranks = [rank[a:b] for a, b in pairwise(ends)]
    for x, here in zip(parts, ranks, strict=True):
        counts[here] = [len(knots) - degree - 1 for knots in x.knots]
    sizes = *(counts + degree + 1).T, counts.prod(axis=1)
    firsts = [np.cumsum(size) - size for size in sizes]
    knots = [np.empty(int(size.sum())) for size in sizes[:2]]
    points = np.empty((int(sizes[2].sum()), d))
    for x, here in zip(parts, ranks, strict=True):
        for flat, first, values in zip(knots, firsts, x.knots, strict=False):
            flat[first[here, None] + np.arange(len(values))] = values
    origin, size = (
        np.concatenate([np.zeros((0, 2)), *(getattr(x, name) for x in parts)])[order]
        for name in ("origin", "size")
    )
    exact = np.concatenate([none.astype(bool), *(x.exact for x in parts)])[order]
    grid = np.ones((len(face), 2), dtype=np.int64)
    for x, here in zip(parts, ranks, strict=True):
        grid[here] = x.grid
    first = np.cumsum(grid.prod(axis=1)) - grid.prod(axis=1)
    cells, turns = np.empty((2, int(grid.prod(axis=1).sum())), dtype=np.int64)
    for x, here in zip(parts, ranks, strict=True):
        at = first[here, None] + np.arange(x.cells.shape[1])
        cells[at], turns[at] = x.cells, x.turns
    for here in reversed(ranks):  # each is freed before the next, so that none is there twice
        net = parts.pop().points
        m, k = net.shape[:2]
        if (np.diff(here) == 1).all():
            start = firsts[2][here[0]]
            points[start : start + m * k].reshape(m, k, d)[:] = net
        else:
            points[firsts[2][here, None] + np.arange(k)] = net
    trims = np.array([(0, 0), (1, 0), (0, 1)]) if lattice.sloped else None
    return BSplineFaces(
        surface, (degree, degree), counts, knots[0], knots[1], points, grid, cells, turns, origin,
        size, exact, trims, depths, smooth,
    )  # fmt: skip


def _limits(surface: LimitSurface, pieces: BezierPatches) -> Array:
    """Limits (r, d) of special corners."""
    rest = pieces.rest
    corner = np.array(surface.topology.lattice.corners)[rest.corner]
    u, v = (rest.origin + rest.size * corner).T
    return np.asarray(surface.evaluate(rest.face, u, v))
