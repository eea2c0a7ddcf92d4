"""Compiled search for what is nearest to points: boxes by distance, and cells halved.

Decided as in `query.nearest`, which is the reference: of a point and a cell, the Bernstein
coefficients of the squared distance D bound it from below, say towards which side it falls, and
whether it is convex; then a projected Newton's method finds its only least place. What that does
not settle within a budget, and what may lie at special corners beyond all cells, is left to who
calls: `derivations/closest.py` has the tests and why they hold.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels.jit import inlined, lean, outlined
from limitsurf._kernels.traversal import Hierarchy, Shape

Array = NDArray[Any]

_WIDTH = 4  # children of a box
_SETTLED = 1e-7  # steps of Newton's method after which the next may be none: it is looked at
_STEPS = 24  # of Newton's method, at most
_HALVINGS = 44  # of a cell, one after the other, at most
_BUDGET = 400  # cells of a point, and as many more as cells whose boxes are near
_MORE = 12
_SORTED = 64  # boxes that wait: if there are more, what came last is looked at first
_STACK = 128  # boxes that wait: no more than 3 for each level, and cells
_SPARE = 0.125  # by which squares of chords are more than what D falls by as the surface bends
_LEVEL = 2.0**-50  # slopes of D that are none: rounding
KNOWN, DOUBT, FULL = 0, 1, 2  # of a point: answered, left to who calls, or to be asked again


class Squares(NamedTuple):
    """Squared distances from cells of n coefficients: polynomials of m, of twice the degree."""

    starts: Array  # (m + 1,) int64: where the products of each of them begin
    pairs: Array  # (p, 2) int64: coefficients that are multiplied
    shares: Array  # (p,)
    first: Array  # (2, k, 2) int64: those whose differences are d/ds and d/dt
    second: Array  # (2, l, 3) int64: the same of d2/ds2 and d2/dt2
    mixed: Array  # (q, 4) int64: and of d2/dsdt
    ratio: float  # by which multiples of mixed differences are more
    inward: Array  # (c, 2) int64: for each side, the derivative into the domain (2: both), its sign
    squared: Array  # (c,) int64: the coefficients at corners
    corners: Array  # (c,) int64: the same of cells
    ends: Array  # (c, 2): where corners are
    sides: Array  # (c, 3): a + b s + c t, which are 0 on sides
    rims: Array  # (c, 2 d + 1) int64: coefficients along sides
    exponents: Array  # (n, 2) int64
    times: Array  # (n,): integers that polynomials begin with


class Corners(NamedTuple):
    """What remains at special corners (R,): more rings of c cells, and what is beyond those.

    The first of two bounds is of all, the other of what is beyond.
    """

    limits: Array  # (R, 3)
    spans: Array  # (2, R, k, 3): products with another vector bound how far it goes along that
    rest: Array  # (2, R): and this times its length
    points: Array  # (R, c, n, 3): relative to limits
    frames: Array  # (R, c, 4): where corner 0 of a cell is in what remains, and its size


class Limits(NamedTuple):
    """What counts as equal; as `query.nearest` has it."""

    same: float
    lost: float
    place: float
    far: float


class Room(NamedTuple):
    """Where a search keeps what waits."""

    nodes: Array  # (_STACK, 2) int64
    keys: Array  # (_STACK,): how far they are, squared
    cells: Array  # (_STACK, n, 3)
    bases: Array  # (_STACK, 3)
    places: Array  # (_STACK, 3, 2)
    depth: Array  # (_STACK,) int64
    work: Array  # (n, 3)
    squares: Array  # (m,)
    own: Array  # (136,): of Newton's method
    state: Array  # (4,): best distance, rest of the budget, the least and what is lost
    total: Array  # (1,) int64: feet

    @classmethod
    def of(cls, size: int, squares: int) -> Room:
        """For cells of so many coefficients, and so many of polynomials of twice their degree."""
        whole = np.int64
        return cls(
            np.empty((_STACK, 2), dtype=whole), np.empty(_STACK), np.empty((_STACK, size, 3)),
            np.empty((_STACK, 3)), np.empty((_STACK, 3, 2)), np.empty(_STACK, dtype=whole),
            np.empty((size, 3)), np.empty(squares), np.zeros(136), np.zeros(4),
            np.zeros(1, dtype=whole),
        )  # fmt: skip


@inlined
def _reach(best: float, same: float) -> float:
    """Distances up to which places count: what rounding may have done is added."""
    reach: float = best + same * (1 + best)
    return reach


@outlined
def _add(
    room: Room, out: Array, q: int, leaf: int, place: Array, gap: Array, off: float, every: bool,
    same: float,
) -> None:  # fmt: skip
    """A foot at ``place[0:2]`` of a leaf's domain, ``gap[0:3]`` away."""
    k = room.total[0]
    distance = np.sqrt(gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2])
    if not distance <= _reach(room.state[0], same):
        return
    if not every:
        room.state[0] = min(room.state[0], distance)
    if k < len(out):
        out[k, 0], out[k, 1] = place[0], place[1]
        out[k, 2], out[k, 3], out[k, 4], out[k, 5] = distance, off, q, leaf
    room.total[0] = k + 1


@inlined
def _product_jet(x: Array, squares: Squares, degree: int, own: Array) -> None:
    """As `_jet`, of products of polynomials of s and of t, from powers: line by line."""
    step = 1 if squares.exponents[1, 0] == 1 else degree + 1
    across = degree + 2 - step
    for i in range(degree + 1):
        k, c = degree - i, squares.times[i * step]
        for a, g, to in ((34 + i, 66 + k, 98 + i), (50 + i, 82 + k, 116 + i)):
            own[to] = c * own[a] * own[g]
            own[to + 6] = c * (i * own[a - 1] * own[g] - k * own[a] * own[g - 1])
            second = i * (i - 1) * own[a - 2] * own[g] - 2 * i * k * own[a - 1] * own[g - 1]
            own[to + 12] = c * (second + k * (k - 1) * own[a] * own[g - 2])
    for axis in range(3):
        f0 = f1 = f2 = f3 = f4 = f5 = 0.0
        for j in range(degree + 1):
            a0 = a1 = a2 = 0.0
            for i in range(degree + 1):
                y = x[j * across + i * step, axis]
                a0, a1, a2 = a0 + own[98 + i] * y, a1 + own[104 + i] * y, a2 + own[110 + i] * y
            v0, v1, v2 = own[116 + j], own[122 + j], own[128 + j]
            f0, f1, f2 = f0 + v0 * a0, f1 + v0 * a1, f2 + v1 * a0
            f3, f4, f5 = f3 + v0 * a2, f4 + v1 * a1, f5 + v2 * a0
        own[axis], own[3 + axis], own[6 + axis] = f0, f1, f2
        own[9 + axis], own[12 + axis], own[15 + axis] = f3, f4, f5


@outlined
def _jet(x: Array, squares: Squares, s: float, t: float, sloped: bool, own: Array) -> None:
    """Value, d/ds, d/dt, d2/ds2, d2/dsdt and d2/dt2 of a cell, three coordinates each.

    They go to ``own[0:18]``; powers, of which those of negative exponents are 0, to ``own[32:]``,
    and of quads the polynomials of s and of t, with two derivatives each, to ``own[98:]``.
    """
    degree = squares.rims.shape[1] // 2
    r, q = (1 - s - t, 1.0) if sloped else (1 - s, 1 - t)
    for k in range(4):
        own[32 + 16 * k] = own[33 + 16 * k] = 0.0
        own[34 + 16 * k] = 1.0
    for k in range(35, 35 + degree):
        own[k], own[16 + k] = own[k - 1] * s, own[15 + k] * t
        own[32 + k], own[48 + k] = own[31 + k] * r, own[47 + k] * q
    if not sloped:
        _product_jet(x, squares, degree, own)
        return
    for k in range(18):
        own[k] = 0.0
    for m in range(len(squares.times)):
        i, j, c = squares.exponents[m, 0], squares.exponents[m, 1], squares.times[m]
        k = degree - i - j
        a, b, g = 34 + i, 50 + j, 66 + k
        s0, t0, r0 = own[a], own[b], own[g]
        s1, t1, r1 = i * own[a - 1], j * own[b - 1], k * own[g - 1]
        s2, t2 = i * (i - 1) * own[a - 2], j * (j - 1) * own[b - 2]
        r2 = k * (k - 1) * own[g - 2]
        w0 = c * s0 * t0 * r0
        w1, w2 = c * t0 * (s1 * r0 - s0 * r1), c * s0 * (t1 * r0 - t0 * r1)
        w3 = c * t0 * (s2 * r0 - 2 * s1 * r1 + s0 * r2)
        w4 = c * (s1 * t1 * r0 - s1 * t0 * r1 - s0 * t1 * r1 + s0 * t0 * r2)
        w5 = c * s0 * (t2 * r0 - 2 * t1 * r1 + t0 * r2)
        for axis in range(3):
            y = x[m, axis]
            own[axis] += w0 * y
            own[3 + axis] += w1 * y
            own[6 + axis] += w2 * y
            own[9 + axis] += w3 * y
            own[12 + axis] += w4 * y
            own[15 + axis] += w5 * y


@inlined
def _off(own: Array) -> float:
    """How long the part of a vector ``own[20:23]`` is in the plane of two others."""
    a0, a1, a2, b0, b1, b2 = own[3], own[4], own[5], own[6], own[7], own[8]
    size = np.sqrt(a0 * a0 + a1 * a1 + a2 * a2)
    size = 1 / size if size > 0 else 0.0
    a0, a1, a2 = a0 * size, a1 * size, a2 * size
    along = a0 * b0 + a1 * b1 + a2 * b2
    b0, b1, b2 = b0 - along * a0, b1 - along * a1, b2 - along * a2
    size = np.sqrt(b0 * b0 + b1 * b1 + b2 * b2)
    size = 1 / size if size > 0 else 0.0
    p = a0 * own[20] + a1 * own[21] + a2 * own[22]
    g = (b0 * own[20] + b1 * own[21] + b2 * own[22]) * size
    return float(np.sqrt(p * p + g * g))


@outlined
def _newton(
    x: Array, base: Array, squares: Squares, side: int, sloped: bool, settled: float, own: Array
) -> bool:  # fmt: skip
    """The least place of a convex D in the closed domain, or on a side of it, if that settles.

    ``own[18:20]`` are s and t, ``own[20:23]`` is from the point to there, and ``own[3:9]`` has
    derivatives. Where D rises inwards from a side that the search is on, it goes along it.
    A step below ``settled`` is the last one where the next would be nothing if they went on to
    fall as squares do: of that callers make sure.
    """
    s = t = 1 / 3 if sloped else 0.5
    last, done = np.inf, False
    count = len(squares.sides)
    if side >= 0:
        end = (side + 1) % count
        s = 0.5 * (squares.ends[side, 0] + squares.ends[end, 0])
        t = 0.5 * (squares.ends[side, 1] + squares.ends[end, 1])
    for _ in range(_STEPS):
        _jet(x, squares, s, t, sloped, own)
        w0, w1, w2 = base[0] + own[0], base[1] + own[1], base[2] + own[2]
        own[20], own[21], own[22], own[18], own[19] = w0, w1, w2, s, t
        if done:
            return last <= max(settled, 1e-9)
        g1, g2 = w0 * own[3] + w1 * own[4] + w2 * own[5], w0 * own[6] + w1 * own[7] + w2 * own[8]
        h11 = own[3] * own[3] + own[4] * own[4] + own[5] * own[5]
        h11 += w0 * own[9] + w1 * own[10] + w2 * own[11]
        h12 = own[3] * own[6] + own[4] * own[7] + own[5] * own[8]
        h12 += w0 * own[12] + w1 * own[13] + w2 * own[14]
        h22 = own[6] * own[6] + own[7] * own[7] + own[8] * own[8]
        h22 += w0 * own[15] + w1 * own[16] + w2 * own[17]
        det = h11 * h22 - h12 * h12
        ds, dt = (h12 * g2 - h22 * g1) / det, (h12 * g1 - h11 * g2) / det
        one, other = side, -1
        for k in range(0 if side >= 0 else count):
            if squares.sides[k, 0] + squares.sides[k, 1] * s + squares.sides[k, 2] * t <= 0:
                one, other = k, one
        if one >= 0:
            a, b = squares.sides[one, 1], squares.sides[one, 2]
            leaves = a * ds + b * dt < 0
            along = side >= 0 or leaves or a * g1 + b * g2 > 0
            if other >= 0:  # at a corner, where it may fall along one side, or both, or neither
                c, e = squares.sides[other, 1], squares.sides[other, 2]
                turn = 1.0 if c * b - e * a > 0 else -1.0
                first, second = turn * (b * g1 - a * g2), turn * (c * g2 - e * g1)
                along = leaves or c * ds + e * dt < 0
                if first >= 0 and second >= 0:
                    ds, dt, along = 0.0, 0.0, False
                elif second < first:
                    a, b = c, e
            if along:
                scale = (a * g2 - b * g1) / (b * b * h11 - 2 * a * b * h12 + a * a * h22)
                ds, dt = scale * b, -scale * a
        p, g = s, t
        s, t = s + ds, t + dt
        if sloped:
            over = s + t - 1
            if over > 0:
                s = min(max(s - over / 2, 0.0), 1.0)
                t = 1 - s
        s, t = min(max(s, 0.0), 1.0), min(max(t, 0.0), 1.0)
        moved = max(abs(s - p), abs(t - g))
        done = moved <= 2.0**-50 or (moved <= 1e-10 and moved >= 0.5 * last)
        # (each step is a multiple of the square of that before)
        done = done or (moved <= settled and moved * moved * moved <= 2.0**-52 * last * last)
        last = moved
        if not moved <= 1:
            return False
    return False


@outlined
def _halve(room: Room, shape: Shape, top: int) -> None:
    """Cell number `top` that waits becomes two, the nearer one last, relative to their points."""
    x, base, work, n = room.cells[top], room.bases[top], room.work, room.work.shape[0]
    lines, way, widest, first = shape.lines, 0, -1.0, 0
    length = lines.shape[2]
    for w in range(len(lines)):
        widest_here = ahead = 0.0
        for i in range(lines.shape[1]):
            for j in range(length - 1):
                if lines[w, i, j + 1] < 0:
                    break
                a, b = lines[w, i, j], lines[w, i, j + 1]
                square = 0.0
                for axis in range(3):
                    p, g = x[a, axis], x[b, axis]
                    square += (g - p) * (g - p)
                    ahead += (g - p) * (g + p + 2 * base[axis])
                widest_here = max(widest_here, square)
        if widest_here > widest:
            way, widest, first = w, widest_here, 1 if ahead > 0 else 0
    for k in range(n):
        for axis in range(3):
            work[k, axis] = x[k, axis]
    for axis in range(2):
        o, s, t = room.places[top, 0, axis], room.places[top, 1, axis], room.places[top, 2, axis]
        for half in range(2):
            place = room.places[top + (half ^ first)]
            for k in range(3):
                a, b = shape.frames[way, half, k, 0], shape.frames[way, half, k, 1]
                place[k, axis] = a * s + b * t + (o if k == 0 else 0.0)
    one, other = room.cells[top + first], room.cells[top + 1 - first]
    for i in range(lines.shape[1]):
        many = length
        while lines[way, i, many - 1] < 0:
            many -= 1
        for axis in range(3):
            for level in range(many):
                a = lines[way, i, 0]
                one[shape.halves[way, 0, i, level], axis] = work[a, axis]
                for j in range(many - 1 - level):
                    a, b = lines[way, i, j], lines[way, i, j + 1]
                    work[a, axis] = 0.5 * (work[a, axis] + work[b, axis])
            for j in range(many):
                a = lines[way, i, j]
                other[shape.halves[way, 1, i, j], axis] = work[a, axis]
    room.depth[top] += 1
    room.depth[top + 1] = room.depth[top]
    for axis in range(3):
        begin = base[axis]
        for k in range(top, top + 2):
            shift = room.cells[k, 0, axis]
            room.bases[k, axis] = begin + shift
            for m in range(n):
                room.cells[k, m, axis] -= shift


@inlined
def _hull(x: Array, base: Array, nearest: float, w0: float, w1: float, w2: float) -> float:
    """Nearest times the distance of a hull along the way to a point of it, from below."""
    low = np.inf
    for k in range(len(x)):
        low = min(low, x[k, 0] * w0 + x[k, 1] * w1 + x[k, 2] * w2)
    along: float = low + base[0] * w0 + base[1] * w1 + base[2] * w2
    return along


@outlined
def _near(x: Array, base: Array, corners: Array, room: Room, every: bool, limits: Limits) -> bool:
    """Whether a hull may be near enough; a corner of it may be nearer than what is known."""
    nearest = np.inf
    w0 = w1 = w2 = 0.0
    for k in range(len(corners)):
        c = corners[k]
        g0, g1, g2 = base[0] + x[c, 0], base[1] + x[c, 1], base[2] + x[c, 2]
        square = g0 * g0 + g1 * g1 + g2 * g2
        if square < nearest:
            nearest, w0, w1, w2 = square, g0, g1, g2
    nearest = np.sqrt(nearest)
    if not every:
        room.state[0] = min(room.state[0], nearest)
    along = _hull(x, base, nearest, w0, w1, w2) - limits.lost * nearest * (1 + nearest)
    alive: bool = along <= nearest * _reach(room.state[0], limits.same)
    return alive


@outlined
def _square(x: Array, base: Array, squares: Squares, limits: Limits, room: Room) -> float:
    """Coefficients of D less that of the first point, and the largest point squared.

    ``room.state[2:4]`` are the least of them and what rounding took.
    """
    d, work = room.squares, room.own
    size = 0.0
    for k in range(len(x)):
        y0, y1, y2 = x[k, 0], x[k, 1], x[k, 2]
        size = max(size, y0 * y0 + y1 * y1 + y2 * y2)
        work[32 + k] = y0 * base[0] + y1 * base[1] + y2 * base[2]
    low = np.inf
    for c in range(len(squares.starts) - 1):
        total = 0.0
        for p in range(squares.starts[c], squares.starts[c + 1]):
            a, b = squares.pairs[p, 0], squares.pairs[p, 1]
            value = x[a, 0] * x[b, 0] + x[a, 1] * x[b, 1] + x[a, 2] * x[b, 2]
            total += squares.shares[p] * (value + work[32 + a] + work[32 + b])
        d[c] = total
        low = min(low, total)
    span = np.sqrt(size)
    ww = base[0] * base[0] + base[1] * base[1] + base[2] * base[2]
    room.state[2], room.state[3] = low, limits.lost * span * (span + 2 * np.sqrt(ww))
    return size


@outlined
def _falls(d: Array, squares: Squares, lost: float, sloped: bool) -> int:
    """The first side towards which D falls everywhere; -1 where there is none."""
    low0 = low1 = low2 = np.inf
    high0 = high1 = high2 = -np.inf
    for k in range(squares.first.shape[1]):
        p = d[squares.first[0, k, 1]] - d[squares.first[0, k, 0]]
        g = d[squares.first[1, k, 1]] - d[squares.first[1, k, 0]]
        low0, high0, low1, high1 = min(low0, p), max(high0, p), min(low1, g), max(high1, g)
        if sloped:
            low2, high2 = min(low2, p + g), max(high2, p + g)
    for k in range(len(squares.inward)):
        which, sign = squares.inward[k, 0], squares.inward[k, 1]
        if which == 0:
            slope = low0 if sign > 0 else -high0
        elif which == 1:
            slope = low1 if sign > 0 else -high1
        else:
            slope = low2 if sign > 0 else -high2
        if slope >= -lost:
            return k
    return -1


@inlined
def _bent(d: Array, squares: Squares, side: int, lost: float) -> bool:
    """Whether D is convex along a side."""
    least = np.inf
    for k in range(2, squares.rims.shape[1]):
        a, b, c = squares.rims[side, k - 2], squares.rims[side, k - 1], squares.rims[side, k]
        least = min(least, d[a] - 2 * d[b] + d[c])
    bent: bool = least > 4 * lost
    return bent


@outlined
def _convex(d: Array, squares: Squares, lost: float) -> bool:
    """Whether D is."""
    ss = tt = np.inf
    for k in range(squares.second.shape[1]):
        a, b, c = squares.second[0, k, 0], squares.second[0, k, 1], squares.second[0, k, 2]
        ss = min(ss, d[a] - 2 * d[b] + d[c])
        a, b, c = squares.second[1, k, 0], squares.second[1, k, 1], squares.second[1, k, 2]
        tt = min(tt, d[a] - 2 * d[b] + d[c])
    more = 4 * lost
    if not (ss > more and tt > more):
        return False
    st = 0.0
    for k in range(len(squares.mixed)):
        a, b = squares.mixed[k, 0], squares.mixed[k, 1]
        c, e = squares.mixed[k, 2], squares.mixed[k, 3]
        st = max(st, abs(d[e] - d[b] - d[c] + d[a]))
    st = (st + more) * squares.ratio
    convex: bool = (ss - more) * (tt - more) > st * st
    return convex


@outlined
def _cells(
    room: Room, shape: Shape, squares: Squares, limits: Limits, sloped: bool, every: bool,
    q: int, leaf: int, out: Array,
) -> bool:  # fmt: skip
    """Feet on the first cell that waits, and on its parts; whether the budget was enough."""
    own, cells = room.own, 1
    while cells > 0:
        cells -= 1
        room.state[1] -= 1
        if room.state[1] < 0:
            return False
        x, base, place = room.cells[cells], room.bases[cells], room.places[cells]
        if not _near(x, base, squares.corners, room, every, limits):
            continue
        size = _square(x, base, squares, limits, room)
        low, lost = room.state[2], room.state[3]
        ww = base[0] * base[0] + base[1] * base[1] + base[2] * base[2]
        least = np.sqrt(max(ww * (1 - 2.0**-50) + low - lost, 0.0))
        if not least <= _reach(room.state[0], limits.same):
            continue
        d, best, at = room.squares, 0, np.inf
        for k in range(len(squares.squared)):
            if d[squares.squared[k]] < at:
                best, at = k, d[squares.squared[k]]
        far = least * least >= limits.far * limits.far * size
        if (far and at - low <= lost) or size <= limits.place * limits.place:
            s, t = squares.ends[best, 0], squares.ends[best, 1]
            _jet(x, squares, s, t, sloped, own)
            c = squares.corners[best]
            for axis in range(3):
                own[20 + axis] = base[axis] + x[c, axis]
            own[18], own[19] = s, t
        else:
            side = _falls(d, squares, lost, sloped) if far else -1
            convex = _bent(d, squares, side, lost) if side >= 0 else _convex(d, squares, lost)
            if not (convex and _newton(x, base, squares, side, sloped, 0.0, own)):
                if room.depth[cells] >= _HALVINGS or cells + 2 > _STACK:
                    return False
                _halve(room, shape, cells)
                cells += 2
                continue
        off, s, t = _off(own), own[18], own[19]
        own[18] = place[0, 0] + s * place[1, 0] + t * place[2, 0]
        own[19] = place[0, 1] + s * place[1, 1] + t * place[2, 1]
        _add(room, out, q, leaf, own[18:20], own[20:23], off, every, limits.same)
    return True


@outlined
def _rises(squares: Squares, own: Array) -> float:
    """By how much half of D may fall along a unit of parameters from a place in the domain."""
    w0, w1, w2, s, t = own[20], own[21], own[22], own[18], own[19]
    g1, g2 = w0 * own[3] + w1 * own[4] + w2 * own[5], w0 * own[6] + w1 * own[7] + w2 * own[8]
    one, other = -1, -1
    for k in range(len(squares.sides)):
        if squares.sides[k, 0] + squares.sides[k, 1] * s + squares.sides[k, 2] * t <= 0:
            one, other = k, one
    steep = np.sqrt(g1 * g1 + g2 * g2)
    if one < 0:
        return float(steep)
    a, b = squares.sides[one, 1], squares.sides[one, 2]
    if other < 0:
        size = np.sqrt(a * a + b * b)
        along, inward = (a * g2 - b * g1) / size, min((a * g1 + b * g2) / size, 0.0)
        return float(np.sqrt(along * along + inward * inward))
    c, e = squares.sides[other, 1], squares.sides[other, 2]
    turn = 1.0 if c * b - e * a > 0 else -1.0
    if turn * (b * g1 - a * g2) >= 0 and turn * (c * g2 - e * g1) >= 0:
        return 0.0
    return float(steep)


@outlined
def _alone(
    room: Room, squares: Squares, limits: Limits, sloped: bool, q: int, leaf: int, bend: Array,
    out: Array,
) -> bool:  # fmt: skip
    """Whether the first cell that waits is settled at once, its least place being kept if near.

    ``bend`` (3,) has bounds of a cell in parameters of which the mean derivatives are of length 1,
    and at right angles: of its second derivatives, of the least square of chords to these
    parameters, and of these parameters to its own.
    """
    x, base, own = room.cells[0], room.bases[0], room.own
    if not _near(x, base, squares.corners, room, False, limits):
        return True
    if not _newton(x, base, squares, -1, sloped, _SETTLED, own):
        return False
    w = np.sqrt(own[20] * own[20] + own[21] * own[21] + own[22] * own[22])
    room.state[0] = min(room.state[0], w)
    if not w * bend[0] <= bend[1] - _SPARE:
        return False
    if not _rises(squares, own) * bend[2] <= _LEVEL:
        return False
    _add(room, out, q, leaf, own[18:20], own[20:23], _off(own), False, limits.same)
    return True


@inlined
def _apart(boxes: Array, node: int, p0: float, p1: float, p2: float) -> float:
    """The squared distance of a box."""
    g0 = max(max(boxes[node, 0] - p0, p0 - boxes[node, 3]), 0.0)
    g1 = max(max(boxes[node, 1] - p1, p1 - boxes[node, 4]), 0.0)
    g2 = max(max(boxes[node, 2] - p2, p2 - boxes[node, 5]), 0.0)
    apart: float = g0 * g0 + g1 * g1 + g2 * g2
    return apart


@inlined
def _wait(nodes: Array, keys: Array, begin: int, k: int, level: int, node: int, key: float) -> None:
    """A box waits, as the k-th, and finds its place from `begin` on: the nearest last."""
    while k > begin and keys[k - 1] < key:
        keys[k], nodes[k, 0], nodes[k, 1] = keys[k - 1], nodes[k - 1, 0], nodes[k - 1, 1]
        k -= 1
    keys[k], nodes[k, 0], nodes[k, 1] = key, level, node


@inlined
def _begin(room: Room, points: Array, l0: float, l1: float, l2: float) -> None:
    """A cell is the first that waits; its points are relative to one that is l from the point."""
    f0, f1, f2 = points[0, 0], points[0, 1], points[0, 2]
    cell, base, place = room.cells[0], room.bases[0], room.places[0]
    for k in range(len(points)):
        cell[k, 0], cell[k, 1], cell[k, 2] = (
            points[k, 0] - f0, points[k, 1] - f1, points[k, 2] - f2,
        )  # fmt: skip
    base[0], base[1], base[2] = f0 + l0, f1 + l1, f2 + l2
    place[0, 0], place[0, 1] = 0.0, 0.0
    place[1, 0], place[1, 1], place[2, 0], place[2, 1] = 1.0, 0.0, 0.0, 1.0
    room.depth[0] = 0
    room.state[1] += _MORE


@inlined
def _least(corners: Corners, bound: int, r: int, w0: float, w1: float, w2: float) -> float:
    """How far what remains at a special corner is, from below; the corner is w from the point."""
    square = w0 * w0 + w1 * w1 + w2 * w2
    size = np.sqrt(square)
    far, spans = corners.rest[bound, r], corners.spans[bound, r]
    along = far * size
    for k in range(len(spans)):
        a, b, c = spans[k, 0], spans[k, 1], spans[k, 2]
        far += np.sqrt(a * a + b * b + c * c)
        along += abs(a * w0 + b * w1 + c * w2)
    near = max(size - far, 0.0)
    return float(np.sqrt(max(square - 2 * along, near * near)))


@outlined
def _corner(
    room: Room, shape: Shape, squares: Squares, corners: Corners, limits: Limits, sloped: bool,
    every: bool, q: int, r: int, leaf: int, w0: float, w1: float, w2: float, out: Array,
) -> float:  # fmt: skip
    """Feet on the rings of a special corner that is w from the point: how far the rest is.

    That is from below; less than 0 if the budget was not enough.
    """
    if not every:
        room.state[0] = min(room.state[0], np.sqrt(w0 * w0 + w1 * w1 + w2 * w2))
    if not _least(corners, 0, r, w0, w1, w2) <= _reach(room.state[0], limits.same):
        return np.inf
    for c in range(corners.points.shape[1]):
        _begin(room, corners.points[r, c], w0, w1, w2)
        place = room.places[0]
        place[0, 0], place[0, 1] = corners.frames[r, c, 0], corners.frames[r, c, 1]
        place[1, 0], place[2, 1] = corners.frames[r, c, 2], corners.frames[r, c, 3]
        if not _cells(room, shape, squares, limits, sloped, every, q, leaf, out):
            return -1.0
    return _least(corners, 1, r, w0, w1, w2)


@lean
def approach(
    tree: Hierarchy, shape: Shape, squares: Squares, corners: Corners, bends: Array,
    limits: Limits, points: Array, within: Array, sloped: bool, every: bool, room: Room, out: Array,
    left: Array,
) -> int:  # fmt: skip
    """Write down what may be nearest to points (Q, 3), at most `within` (Q,) away; how many.

    Or with `every` all feet within these distances. `left` (Q,) says of which not all that counts
    is known: they have none. Rows of `out` (H, 6) are s and t in the leaf, the distance, how far a
    foot would move if it could leave its cell, NaN where nobody knows, the point, and the leaf.
    """
    levels, size = len(tree.starts) - 1, len(tree.points)
    room.total[0] = 0
    for q in range(len(points)):
        begin, p0, p1, p2 = room.total[0], points[q, 0], points[q, 1], points[q, 2]
        room.state[0], room.state[1] = within[q], _BUDGET
        doubt, waits, known = np.inf, 0, True
        level, first, last = -1, tree.starts[0], tree.starts[1]
        while known:
            # the boxes in one, among those that wait
            reach = _reach(room.state[0], limits.same)
            at = waits if waits > _SORTED else 0
            for node in range(first, last):
                apart = _apart(tree.boxes, node, p0, p1, p2)
                if apart <= reach * reach:
                    _wait(room.nodes, room.keys, at, waits, level + 1, node, apart)
                    waits += 1
            first = last
            if waits == 0:
                break
            waits -= 1
            level, node = room.nodes[waits, 0], room.nodes[waits, 1]
            if not room.keys[waits] <= reach * reach:
                continue
            if level + 1 < levels:
                first = tree.starts[level + 1] + _WIDTH * (node - tree.starts[level])
                last = min(first + _WIDTH, tree.starts[level + 2])
                continue
            leaf = tree.order[node - tree.starts[level]]
            if leaf < size:
                _begin(room, tree.points[leaf], -p0, -p1, -p2)
                if not every:
                    most = (bends[leaf, 1] - _SPARE) / bends[leaf, 0]
                    if (
                        most > 0
                        and room.keys[waits] <= most * most
                        and _alone(room, squares, limits, sloped, q, leaf, bends[leaf], out)
                    ):
                        continue
                known = _cells(room, shape, squares, limits, sloped, every, q, leaf, out)
                continue
            r = leaf - size
            w0, w1, w2 = (
                corners.limits[r, 0] - p0, corners.limits[r, 1] - p1, corners.limits[r, 2] - p2,
            )  # fmt: skip
            least = _corner(
                room, shape, squares, corners, limits, sloped, every, q, r, leaf, w0, w1, w2, out
            )
            doubt, known = min(doubt, least), least >= 0
        reach = _reach(room.state[0], limits.same)
        if not known or doubt <= reach:
            left[q], room.total[0] = DOUBT, begin
        elif room.total[0] > len(out):
            left[q], room.total[0] = FULL, begin
        else:
            end, total = room.total[0], begin
            for k in range(begin, end):
                if out[k, 2] <= reach:
                    for j in range(6):
                        out[total, j] = out[k, j]
                    total += 1
            room.total[0] = total
            if total == begin and room.state[0] < within[q]:
                left[q] = DOUBT  # what is near is of a place that was not kept
    return int(room.total[0])
