"""Curves where two surfaces meet."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.checks import count, users_level
from limitsurf.engine.protocol import threads
from limitsurf.query.crossings import inside
from limitsurf.query.index import Cells, checked_surface
from limitsurf.query.pairing import Pairs, Parts, simple_pairs
from limitsurf.query.records import Polylines, Rows
from limitsurf.query.sections import scaled_tolerance, sources
from limitsurf.query.slices import Meets, Slices, on_sides
from limitsurf.query.tracing import Spans, chained
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_SAME = 2.0**-31  # nodes that are nearer, in the unit of the search, are one
_JOINED = 2.0**-24  # ends that are nearer are joined
_REACH = 64  # so many times the size of what is undecided is where curves may end at it


@dataclass(frozen=True, eq=False, repr=False)
class IntersectionCurves(Polylines):
    """Curves where two surfaces meet, as `intersect_surfaces` finds them.

    Attributes
    ----------
    offsets : (n + 1,) int64
        The points of curve k are numbers ``offsets[k]`` to ``offsets[k + 1]``, exclusive, in order.
    closed : (n,) bool
        Whether a curve goes on from its last point to its first. Others end at a boundary of
        either surface, or where surfaces touch.
    point : (m, 3) float64
        ``a.evaluate(face, u, v)``; that of the other surface is the same, up to rounding.
    face : (m,) int64
        Limit faces of `a`; of points that several share, one of these.
    u, v : (m,) float64
    other_face : (m,) int64
        Limit faces of `b`.
    other_u, other_v : (m,) float64

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> wall = ls.Mesh([[0, 0.3, -1], [1, 0.3, -1], [1, 0.3, 1], [0, 0.3, 1]], [[0, 1, 2, 3]])
    >>> ls.intersect_surfaces(ls.LimitSurface(square), ls.LimitSurface(wall))
    IntersectionCurves(1 curve of ... points, 0 closed)
    """

    offsets: Array
    closed: Array
    point: Array
    face: Array
    u: Array
    v: Array
    other_face: Array
    other_u: Array
    other_v: Array


def intersect_surfaces(
    a: LimitSurface,
    b: LimitSurface,
    *,
    tolerance: float | None = None,
    channel: str | None = None,
    workers: int = 1,
) -> IntersectionCurves:
    """The curves where two surfaces cross: all of them, also loops inside of one face of each.

    Parameters
    ----------
    a, b : LimitSurface
        Of float64 points, (n_vertices, 3); of any schemes.
    tolerance : float, optional
        How far polylines may be from the curves, in the units of the points. By default 1e-4 of the
        longest side of the box of `a`.
    channel : str, optional
        A face-varying channel of three columns, of both, taken instead of the points.
    workers : int
        Threads, as for `LimitSurface.evaluate`; answers do not depend on it.

    Returns
    -------
    IntersectionCurves
        Curves go along the cross product of the normal of `a` and that of `b`: of surfaces of
        inconsistent orientation, as most of each says.

    Warns
    -----
    UserWarning
        Where surfaces touch or coincide, so that it is not decided how they meet: with a place.
        Curves end near there, within 1e-4 of the size, unless just two do.

    Raises
    ------
    TypeError
        For what is not a surface, a surface of exact points, a tolerance that is not a number.
    ValueError
        For points of another shape, or that are not finite, a tolerance that is not above 0.

    Notes
    -----
    Cells of both are parted until normals of each pair are apart: then curves in a pair go one way,
    and planes across that way meet them once at most, so that there is no loop. Where curves enter
    and leave is found by subdivision and Newton's method, and the polylines are refined until
    what is seen of the curve between two points is nearer than `tolerance`: that is a measure, not
    a bound. Points are on both surfaces within 1e-12 of the larger one. Curves shorter than 1e-9 of
    it may be missed. Around special corners cells are on rings, down to 1e-10 of the size or 40
    rings; curves that pass nearer go straight through there. ``derivations/intersections.py``
    derives this, after Sederberg and Meyers, Loop detection in surface patch intersections (1988).

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> ball = ls.LimitSurface(ls.Mesh(points, quads))
    >>> moved = ball.with_points(ball.points + [0.3, 0.2, 0.1])
    >>> found = ls.intersect_surfaces(ball, moved)
    >>> found.closed.tolist()
    [True]
    >>> there = moved.evaluate(found.other_face, found.other_u, found.other_v)
    >>> bool(abs(found.point - there).max() < 1e-12)
    True
    """
    a, b = checked_surface(a, channel), checked_surface(b, channel)
    n = threads(workers)
    both = Cells.of(a, n), Cells.of(b, n)
    scaled = scaled_tolerance(both[0], tolerance)
    power = min(x.power for x in both)
    scaled = max(float(np.ldexp(scaled, power - both[0].power)), 2.0**-44)
    one, two = (Parts(x, power) for x in both)
    pairs, left, corners = simple_pairs(one, two)
    crossing = _Crossing(one, two, pairs)
    spans = crossing.joined(left, corners)
    if len(left):
        _warn(left, power)
    return _found(a, b, crossing, spans, scaled, workers)


def _warn(left: Pairs, power: int) -> None:
    """Say where it is undecided how surfaces meet."""
    k = int(np.minimum(left.of_a.size, left.of_b.size).argmin())
    lower = np.maximum(left.of_a.lower[k], left.of_b.lower[k])
    upper = np.minimum(left.of_a.upper[k], left.of_b.upper[k])
    place = ", ".join(f"{x:.6g}" for x in np.ldexp((lower + upper) / 2, -power).tolist())
    warnings.warn(
        f"the surfaces touch, or coincide, near ({place}), and it is undecided how they meet: "
        f"{count(len(left), 'pair')} of parts; curves may end there",
        stacklevel=users_level(),
    )


@dataclass(slots=True)
class _Spans(Rows):
    """Parts of curves (S,): entries at both ends, (S, 2); whether they run along a side."""

    ends: Array
    run: Array


class _Crossing:
    """Nodes of the curves of pairs, and spans between these."""

    def __init__(self, a: Parts, b: Parts, pairs: Pairs) -> None:
        self.pairs = pairs
        self.slices = Slices(a, b, pairs)
        self.entries = on_sides(a, b, pairs)
        self.node = _together(self.entries.point, _SAME)
        spans = self._between()
        if spans.run.any() and self._more(spans):
            spans = self._between()
        self.spans = self._once(spans)

    def _between(self) -> _Spans:
        """Entries next to each other along a pair, if the curve between is in both patches."""
        entries, node, slices = self.entries, self.node, self.slices
        height = slices.along(entries.pair, entries.point)
        order = np.lexsort([height, entries.pair])
        # of each pair each node once
        first = np.unique(np.stack([entries.pair[order], node[order]]), axis=1, return_index=True)
        order = order[np.sort(first[1])]
        ends = np.stack([order[:-1], order[1:]], axis=1)
        ends = ends[entries.pair[ends[:, 0]] == entries.pair[ends[:, 1]]]
        pair = entries.pair[ends[:, 0]]
        guess, middle = entries.place[ends].mean(axis=1), height[ends].mean(axis=1)
        at, known = slices.at(pair, middle, guess)
        within, run = slices.sides(at)
        keep = known & within
        return _Spans(ends[keep], run[keep])

    def _more(self, spans: _Spans) -> bool:
        """Ends of spans along sides become entries of all spans that they are on, if of any."""
        from scipy.spatial import cKDTree

        runs = spans.ends
        point = self.entries.point
        a, b = point[runs[:, 0]], point[runs[:, 1]]
        size = np.sqrt(((b - a) ** 2).sum(axis=1))
        tips = spans.ends[spans.run].ravel()
        nodes = tips[np.unique(self.node[tips], return_index=True)[1]]
        lists = cKDTree(point[nodes]).query_ball_point((a + b) / 2, size)
        owner = np.repeat(np.arange(len(runs)), [len(x) for x in lists])
        if not len(owner):
            return False
        which = nodes[np.concatenate([np.asarray(x, dtype=np.int64) for x in lists])]
        pair = self.entries.pair[runs[owner, 0]]
        low, high, own = (self.slices.along(pair, x) for x in (a[owner], b[owner], point[which]))
        share = (own - low) / (high - low)
        keep = (share > 0) & (share < 1)
        keep &= (self.node[which][:, None] != self.node[runs[owner]]).all(axis=1)
        owner, which, pair, own, share = (x[keep] for x in (owner, which, pair, own, share))
        ends = self.entries.place[runs[owner]]
        guess = ends[:, 0] + share[:, None] * (ends[:, 1] - ends[:, 0])
        at, known = self.slices.at(pair, own, guess)
        keep = known & (np.abs(at.point - point[which]).max(axis=1) <= _SAME)
        self.entries = Meets.joined([self.entries, at[keep]])
        self.node = np.concatenate([self.node, self.node[which[keep]]])
        return bool(keep.any())

    def _once(self, spans: _Spans) -> _Spans:
        """Spans along sides, which several pairs have, once."""
        runs = np.flatnonzero(spans.run)
        both = np.sort(self.node[spans.ends[runs]], axis=1)
        first = np.unique(both, axis=0, return_index=True)[1] if len(runs) else runs
        keep = ~spans.run
        keep[runs[first]] = True
        return spans[keep]

    def joined(self, left: Pairs, corners: Pairs) -> Spans:
        """All spans, also those through what is undecided, of no pair (-1)."""
        ends = self.node[self.spans.ends]
        pair = self.entries.pair[self.spans.ends[:, 0]]
        turned = [
            np.sign(np.linalg.det(x.frame[:, 1:]))[pair] for x in (self.pairs.a, self.pairs.b)
        ]
        more = self._through(ends, left, corners)
        none = np.zeros(len(more))
        a, b = np.concatenate([ends, more]).T
        sign = np.concatenate([turned[0] * turned[1], none])
        leaf = np.concatenate([pair, none.astype(np.int64) - 1])
        flat = np.zeros((len(a), 2))
        return Spans(a, b, sign, leaf, flat, flat, np.zeros(len(a)))

    def _through(self, ends: Array, left: Pairs, corners: Pairs) -> Array:
        """Nodes (n, 2) at which two curves end that go on in each other."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components
        from scipy.spatial import cKDTree

        nodes, which = np.unique(self.node, return_index=True)
        degree = np.bincount(ends.ravel(), minlength=len(nodes))
        tips = nodes[degree == 1]
        if len(tips) < 2:
            return np.zeros((0, 2), dtype=np.int64)
        point = self.entries.point[which[tips]]
        tree = cKDTree(point)
        edges = [tree.query_pairs(_JOINED, output_type="ndarray").reshape(-1, 2)]
        total = len(tips)
        for some, reach in ((left, _REACH), (corners, 4)):
            if not len(some):
                continue
            size = np.minimum(some.of_a.size, some.of_b.size)
            small = np.where((some.of_a.size <= some.of_b.size)[:, None], 1.0, 0.0)
            middle = small * (some.of_a.lower + some.of_a.upper) / 2
            middle += (1 - small) * (some.of_b.lower + some.of_b.upper) / 2
            lists = tree.query_ball_point(middle, reach * size + _JOINED)
            number = total + np.repeat(np.arange(len(some)), [len(x) for x in lists])
            near = np.concatenate([np.asarray(x, dtype=np.int64) for x in lists])
            edges.append(np.stack([near, number], axis=1))
            total += len(some)
        a, b = np.concatenate(edges).T
        graph = coo_array((np.ones(len(a)), (a, b)), shape=(total, total))
        label = connected_components(graph, directed=False)[1][: len(tips)]
        times = np.bincount(label, minlength=total)
        order = np.argsort(label, kind="stable")
        pairs = order[times[label[order]] == 2].reshape(-1, 2)
        return np.asarray(tips[pairs])


def _together(points: Array, distance: float) -> Array:
    """Numbers of points (n, 3), one for those that are near each other."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    if not len(points):
        return np.zeros(0, dtype=np.int64)
    a, b = cKDTree(points).query_pairs(distance, output_type="ndarray").reshape(-1, 2).T
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(len(points),) * 2)
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _found(
    a: LimitSurface, b: LimitSurface, crossing: _Crossing, spans: Spans, tolerance: float,
    workers: int,
) -> IntersectionCurves:  # fmt: skip
    """The curves of spans, with places in between."""
    entries = crossing.entries
    n = len(crossing.spans)
    ends = crossing.spans.ends
    pair = entries.pair[ends[:, 0]]
    number, inner = crossing.slices.fine(pair, entries.place[ends], entries.point[ends], tolerance)
    offsets = np.zeros(len(spans) + 1, dtype=np.int64)
    np.cumsum(np.bincount(number, minlength=len(spans)), out=offsets[1:])
    nodes, first = np.unique(crossing.node, return_index=True)
    chains = chained(spans, np.zeros(len(spans), dtype=np.int64), len(nodes))
    source, found = sources(spans, len(nodes), offsets, chains)
    assert n == (spans.leaf >= 0).sum()
    places = Meets.joined([entries[first], inner])[source]
    known = []
    for k, (parts, patches) in enumerate(
        ((crossing.slices.a, crossing.pairs.a), (crossing.slices.b, crossing.pairs.b))
    ):
        s, t = inside(parts.lattice, *places.place[:, 2 * k : 2 * k + 2].T)
        spot = np.stack([s, t], axis=1)
        frame = patches.frame[places.pair]
        uv = frame[:, 0] + np.matmul(spot[:, None], frame[:, 1:])[:, 0]
        u, v = inside(parts.lattice, *uv.T)
        known += [patches.face[places.pair], u, v]
    face, u, v, *other = known
    point = a.evaluate(face, u, v, workers=workers).reshape(-1, 3)
    return IntersectionCurves(found, chains[3], point, face, u, v, *other)
