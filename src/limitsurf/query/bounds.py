"""Boxes that hold limit faces, or parts of them, as tight as is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf import html
from limitsurf.cage.checks import checked_number
from limitsurf.cage.mesh import Mesh
from limitsurf.engine.orders import checked_order
from limitsurf.engine.protocol import Request, threads
from limitsurf.query.index import Cells, checked_surface
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_SPLITS = 12  # rings around corners that are partly in a range, where no tolerance is asked for
_SLACK = 2.0**-48  # of a cell: what is so near to a line counts as on both sides of it
_MOST = 200  # halvings for a tolerance, at most
_LOST = 2.0**-49  # what rounding takes, of the largest coordinate


@dataclass(frozen=True, eq=False, repr=False)
class Bounds:
    """Boxes, made by `bounds`: each holds what it is of, rounding included.

    Attributes
    ----------
    lower, upper : (..., 3) float64
        inf and -inf where there is nothing: on faces without a limit.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> ls.bounds(ls.LimitSurface(square))
    Bounds(1 box)
    """

    lower: Array
    upper: Array

    def _repr_html_(self) -> str:
        ends = {name: html.rows(getattr(self, name), 1) for name in ("lower", "upper")}
        return html.table(ends, repr(self))

    def __repr__(self) -> str:
        n = self.lower.size // 3
        return f"Bounds({n} box{'es' * (n != 1)})"


def bounds(
    surface: LimitSurface | Mesh,
    face: ArrayLike | None = None,
    u: ArrayLike | None = None,
    v: ArrayLike | None = None,
    *,
    nu: tuple[int, int] = (0, 0),
    tolerance: float | None = None,
    channel: str | None = None,
    workers: int = 1,
) -> Bounds:
    """Boxes along the axes that hold limit faces, or ranges of u and v on them.

    They are bounds, not estimates: hulls of control points, tightened by halving.

    Parameters
    ----------
    surface : LimitSurface or Mesh
        Of float64 points, (n_vertices, 3). Of a mesh it is ``LimitSurface(mesh)``.
    face : array_like of int, optional
        Limit faces, (...); all by default.
    u, v : array_like, optional
        Ranges (..., 2), least and most, which broadcast with `face`; in triangles what of them is
        on the face. All of the face by default.
    nu : (int, int)
        Order of the derivative in u and in v to bound, instead of the position. The box of a range
        that touches a special corner is infinite: there it may have none, or grow without bounds.
    tolerance : float, optional
        By how much a box may be too large on each side, in the units of the points. By default as
        much as it is after little work: for whole faces the hulls of their cells.
    channel : str, optional
        A face-varying channel of three columns, to bound instead of the points.
    workers : int
        Threads that make the cells, if there are none yet.

    Returns
    -------
    Bounds
        Of the shape of `face` (and ranges).

    Raises
    ------
    IndexError, TypeError, ValueError
        For faces out of range, ranges that are none or outside of the face, a tolerance that is
        not above 0, and surfaces that have no points (n, 3) in float64.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> cube = ls.LimitSurface(ls.Mesh(points, quads))
    >>> top = ls.bounds(cube, 5, tolerance=1e-6)
    >>> top.lower.round(4).tolist(), top.upper.round(4).tolist()
    ([0.1952, 0.1952, 0.75], [0.8048, 0.8048, 0.9198])
    """
    if isinstance(surface, Mesh):
        surface = LimitSurface(surface)
    surface = checked_surface(surface, channel)
    index = Cells.of(surface, threads(workers))
    order = checked_order(nu)
    if tolerance is not None:
        tolerance = checked_number("tolerance", tolerance, above=0)
    ranges = [_range(name, x) for name, x in (("u", u), ("v", v))]
    asked = np.arange(len(surface.limit_faces)) if face is None else np.asarray(face)
    shape = np.broadcast_shapes(asked.shape, *(x.shape[:-1] for x in ranges))
    asked = np.broadcast_to(asked, shape).ravel()
    both = np.stack([np.broadcast_to(x, (*shape, 2)) for x in ranges])
    low, high = both.reshape(2, -1, 2).transpose(2, 1, 0)
    request = Request.of(asked, 0.0, 0.0, False, 1)
    request.check(len(surface.limit_faces), surface.topology.lattice)
    work = _Boxes(index, low, high, order, tolerance)
    work.run(request.face.astype(np.int64), len(surface.limit_faces))
    return Bounds(work.lower.reshape(*shape, 3), work.upper.reshape(*shape, 3))


def _range(name: str, given: ArrayLike | None) -> Array:
    """Least and most of a parameter, (..., 2)."""
    if given is None:
        return np.array([0.0, 1.0])
    found = np.asarray(given, dtype=float)
    if found.ndim == 0 or found.shape[-1] != 2:
        raise ValueError(f"{name} must be ranges (..., 2), least and most, got shape {found.shape}")
    bad = ~((found[..., 0] >= 0) & (found[..., 0] <= found[..., 1]) & (found[..., 1] <= 1))
    if bad.any():
        first = found[bad][0].tolist()
        raise ValueError(f"{name} must be ranges within [0, 1], least first, got {first}")
    return found


class _Boxes:
    """Boxes (B, 3) of ranges `low` to `high` (B, 2), halved until they are tight."""

    def __init__(
        self, index: Cells, low: Array, high: Array, order: tuple[int, int],
        tolerance: float | None,
    ) -> None:  # fmt: skip
        self._index, self._low, self._high, self._order = index, low, high, order
        self._form = index.form
        # in the unit of the index
        self._tolerance = None if tolerance is None else float(np.ldexp(tolerance, index.power))
        self.lower, self.upper = np.full((2, len(low), 3), np.inf)
        self.upper[:] = -np.inf
        self._inner = self.lower.copy(), self.upper.copy()  # of points that are on the surface
        self._lost = np.full(len(low), _LOST)  # what rounding may have taken

    def run(self, face: Array, n_faces: int) -> None:
        """Find the boxes of ranges on limit faces (B,), of so many that there are."""
        index, n = self._index, len(self._index.points)
        by_face = np.argsort(index.face, kind="stable")
        counts = np.bincount(index.face, minlength=n_faces)
        start = np.cumsum(counts) - counts
        each = counts[face]
        box = np.repeat(np.arange(len(face)), each)
        step = np.arange(len(box)) - np.repeat(np.cumsum(each) - each, each)
        leaf = by_face[start[face[box]] + step]
        corner = leaf >= n
        frame, cell = index.frames(leaf), ~corner
        at = leaf[cell]
        points = self._derived(box[cell], index.points[at], index.size[at])
        self._cells(*self._clipped(box[cell], points, frame[cell]))
        self._corners(box[corner], leaf[corner] - n)
        power, lost = -index.power, self._lost[:, None]
        with np.errstate(over="ignore"):
            self.lower, self.upper = (
                np.ldexp(np.nextafter(x, way), power)
                for x, way in ((self.lower - lost, -np.inf), (self.upper + lost, np.inf))
            )

    def _derived(self, box: Array, points: Array, size: Array) -> Array:
        """Coefficients of the derivative in u and v of cells (n, ., 3) of sizes (n, 2)."""
        steep = (2 * self._form.degree / np.abs(size)) ** self._order
        np.maximum.at(self._lost, box, _LOST * steep.prod(axis=1))
        _, s, t, *_ = self._form.derivatives
        for matrix, times, axis in ((s, self._order[0], 0), (t, self._order[1], 1)):
            for _ in range(times):
                points = np.matmul(matrix, points) / size[:, axis, None, None]
        return points

    def _add(self, box: Array, lower: Array, upper: Array, inner: bool = False) -> None:
        to = self._inner if inner else (self.lower, self.upper)
        np.minimum.at(to[0], box, lower)
        np.maximum.at(to[1], box, upper)

    def _loose(self, box: Array, lower: Array, upper: Array) -> Array:
        """Whether bounds (n, 3) of parts are beyond what boxes reach, (n,), by too much."""
        if self._tolerance is None:
            return np.zeros(len(box), dtype=bool)
        reach = self._tolerance / 2
        below, above = self._inner
        loose = (lower < below[box] - reach) | (upper > above[box] + reach)
        return np.asarray(loose.any(axis=1))

    def _where(self, box: Array, frame: Array) -> tuple[Array, Array]:
        """Whether cells are within their ranges, and whether they meet these, (n,) each."""
        ends = frame[:, :1] + np.matmul(self._form.ends, frame[:, 1:])
        low, high = self._low[box], self._high[box]
        least, most = ends.min(axis=1), ends.max(axis=1)
        within = ((least >= low) & (most <= high)).all(axis=1)
        return within, ((most >= low) & (least <= high)).all(axis=1)

    def _clipped(self, box: Array, points: Array, frame: Array) -> tuple[Array, Array, Array]:
        """The parts of cells that are in their ranges."""
        within, meets = self._where(box, frame)
        partly = np.flatnonzero(meets & ~within)
        if not len(partly):
            return box[within], points[within], frame[within]
        own = frame[partly]
        cut, parts = self._parts(box[partly], own)
        new = np.matmul(self._form.part(parts), points[partly[cut]])
        there = np.matmul(parts, own[cut, 1:])
        there[:, 0] += own[cut, 0]
        return (
            np.concatenate([box[within], box[partly[cut]]]),
            np.concatenate([points[within], new]),
            np.concatenate([frame[within], there]),
        )

    def _parts(self, box: Array, frame: Array) -> tuple[Array, Array]:
        """What of cells is in their ranges: of which cell, and frames (n, 3, 2) in it."""
        which, parts = np.arange(len(box)), np.tile([[0.0, 0], [1, 0], [0, 1]], (len(box), 1, 1))
        size = np.stack([frame[:, 1, 0], frame[:, 2, 1]], axis=1)
        first, last = ((x[box] - frame[:, 0]) / size for x in (self._low, self._high))
        first, last = np.minimum(first, last), np.maximum(first, last)
        if not self._index.lattice.sloped:
            first, last = np.clip(first, 0, 1), np.clip(last, 0, 1)
            parts[:, 0] = first
            parts[:, 1, 0], parts[:, 2, 1] = (last - first).T
            return which, parts
        corners = parts.copy()
        for axis in (0, 1):
            for bound, sign in ((first, 1), (last, -1)):
                side = sign * (corners[..., axis] - bound[which, axis][:, None])
                keep, corners = _beyond(side, corners)
                which = which[keep]
        parts = corners.copy()
        parts[:, 1:] -= corners[:, :1]
        return which, parts

    def _cells(self, box: Array, points: Array, frame: Array) -> None:
        """Cells, halved as long as it counts."""
        form = self._form
        for _ in range(_MOST):
            if not len(box):
                return
            lower, upper = points.min(axis=1), points.max(axis=1)
            ends = points[:, form.corners]
            for k in range(len(form.ends)):
                self._add(box, ends[:, k], ends[:, k], inner=True)
            more = self._loose(box, lower, upper)
            # (nothing is tighter than rounding)
            more &= (upper - lower).max(axis=1) > 8 * self._lost[box]
            self._add(box[~more], lower[~more], upper[~more])
            box, points, frame = self._halves(box[more], points[more], frame[more])
        self._add(box, points.min(axis=1), points.max(axis=1))

    def _halves(self, box: Array, points: Array, frame: Array) -> tuple[Array, Array, Array]:
        """Both halves of cells, across their longest side in u and v."""
        form = self._form
        ends = np.matmul(form.ends, frame[:, 1:])
        a, b = form.across.T
        way = ((ends[:, a] - ends[:, b]) ** 2).sum(axis=2).argmax(axis=1)
        found = np.matmul(form.halves[way], points[:, None])
        frames = np.matmul(form.frames[way], frame[:, None, 1:])
        frames[:, :, 0] += frame[:, None, 0]
        shape = points.shape[1:]
        return np.repeat(box, 2), found.reshape(-1, *shape), frames.reshape(-1, 3, 2)

    def _corners(self, box: Array, which: Array) -> None:
        """What remains at special corners, ring by ring as long as it counts."""
        index, beyond = self._index, self._index.beyond
        leaf = which + len(index.points)
        ring = 0
        while len(box):
            origin, size = index.origin[leaf], index.size[leaf]
            half = np.ldexp(1.0, -ring)
            frame = np.zeros((len(box), 3, 2))
            ends = self._form.ends[beyond.corner(which)]
            frame[:, 0] = origin + size * ends * (1 - half)
            frame[:, 1, 0], frame[:, 2, 1] = (size * half).T
            within, meets = self._where(box, frame)
            box, which, leaf, within = (x[meets] for x in (box, which, leaf, within))
            at = origin[meets] + size[meets] * ends[meets]
            on = ((at >= self._low[box]) & (at <= self._high[box])).all(axis=1)
            if any(self._order):
                deep = on | (ring >= _MOST)
                endless = np.full((int(deep.sum()), 3), np.inf)
                self._add(box[deep], -endless, endless)
                box, which, leaf = box[~deep], which[~deep], leaf[~deep]
                self._ring(box, which, ring)
                ring += 1
                continue
            limit, axes = beyond.limits[which], np.eye(3)
            rings = np.full(len(box), ring)
            reach = np.stack(
                [beyond.reach(which, rings, np.tile(x, (len(box), 1)))[1] for x in axes], axis=1
            )
            lower, upper = limit - reach, limit + reach
            self._add(box[on], limit[on], limit[on], inner=True)
            if self._tolerance is None:
                more = ~within & (ring < _SPLITS)
            else:
                more = self._loose(box, lower, upper) & (ring < _MOST)
            if self._tolerance is None and ring == 0:
                # as tight as the hulls that the index has
                lower = np.maximum(lower, index.lower[leaf])
                upper = np.minimum(upper, index.upper[leaf])
            self._add(box[~more], lower[~more], upper[~more])
            box, which, leaf = box[more], which[more], leaf[more]
            if len(box):
                self._ring(box, which, ring)
            ring += 1

    def _ring(self, box: Array, which: Array, ring: int) -> None:
        """The cells of a ring around special corners."""
        index = self._index
        found = index.beyond.cells(which, np.full(len(which), ring))
        pieces, frame = found.points.shape[1], index.ring_frames(which, found.origin, found.size)
        points = index.beyond.limits[which][:, None, None] + found.points
        boxes = np.repeat(box, pieces)
        points, frame = points.reshape(-1, self._form.size, 3), frame.reshape(-1, 3, 2)
        _, meets = self._where(boxes, frame)
        boxes, points, frame = boxes[meets], points[meets], frame[meets]
        if any(self._order):
            points = self._derived(
                boxes, points, np.stack([frame[:, 1, 0], frame[:, 2, 1]], axis=1)
            )
        self._cells(*self._clipped(boxes, points, frame))


def _beyond(side: Array, corners: Array) -> tuple[Array, Array]:
    """What of triangles (n, 3, 2) is on one side of a line: of which, and triangles (m, 3, 2).

    `side` (n, 3) is how far their corners are on that side.
    """
    inside = side >= -_SLACK
    count = inside.sum(axis=1)
    whole = np.flatnonzero(count == 3)
    cut = np.flatnonzero((count > 0) & (count < 3))
    # the corner that is alone comes first
    alone = np.where(count[cut] == 1, inside[cut].argmax(axis=1), inside[cut].argmin(axis=1))
    turn = (alone[:, None] + np.arange(3)) % 3
    f, x = np.take_along_axis(side[cut], turn, 1), corners[cut[:, None], turn]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.clip(np.nan_to_num(f[:, :1] / (f[:, :1] - f[:, 1:])), 0, 1)[..., None]
    p, q = (x[:, :1] + share * (x[:, 1:] - x[:, :1])).swapaxes(0, 1)
    one, two = count[cut] == 1, count[cut] == 2
    pieces = [
        (whole, corners[whole]),
        (cut[one], np.stack([x[:, 0], p, q], axis=1)[one]),
        (cut[two], np.stack([p, x[:, 1], x[:, 2]], axis=1)[two]),
        (cut[two], np.stack([p, x[:, 2], q], axis=1)[two]),
    ]
    return np.concatenate([k for k, _ in pieces]), np.concatenate([y for _, y in pieces])
