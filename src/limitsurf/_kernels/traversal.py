"""Compiled search for where rays cross Bezier cells: box after box, cell after cell, no waiting.

A ray is seen along itself: two coordinates across it, in which it is the origin, and its depth. A
cell is a map of two parameters to the first two, of which the zeros are sought: it is halved until
its derivatives are near one matrix, and then Newton's method finds its only zero. What that does
not settle within a budget, and what lies at special corners beyond all cells, is left to who calls:
`derivations/rays.py` has the tests and why they hold.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels.jit import inlined, lean, outlined

Array = NDArray[Any]

_WIDTH = 4  # children of a box
_STEPS = 24  # of Newton's method, at most
_HALVINGS = 44  # of a cell, one after the other, at most
_BUDGET = 600  # cells of a ray, and as many more as boxes of cells that it meets times this
_MORE = 24
_PARALLEL = 8  # times slack, and how near derivatives are to parallel, that a side may hide
_STACK = 128  # boxes that wait: no more than 3 for each level, and cells
FIRST, ANY, EVERY = 0, 1, 2  # what is asked for


class Hierarchy(NamedTuple):
    """Cells in boxes."""

    boxes: Array  # (boxes, 6): lower and upper corners, of all, ..., of the leaves
    starts: Array  # (levels + 1,) int64: where those of a level begin
    order: Array  # (leaves,) int64: cells, and from there on what remains at special corners
    points: Array  # (cells, n, 3)
    frames: Array  # (cells, 4): where corner 0 of a cell is in its limit face, and its size


class Shape(NamedTuple):
    """Polynomials by n coefficients: which of these do what."""

    lower: Array  # (m, 4) int64: the coefficients around each of the polynomials of a degree less
    powers: Array  # (m, 4) int64: exponents of the four factors of these
    times: Array  # (m,): integers that they begin with
    pairs: Array  # (2, k, 2) int64: coefficients whose differences are those of a derivative
    lines: Array  # (ways, l, d + 1) int64: coefficients along the lines that are halved, or -1
    halves: Array  # (ways, 2, l, d + 1) int64: which of the halves' their halves are
    frames: Array  # (ways, 2, 3, 2): of the halves in the domain


class Lines(NamedTuple):
    """Rays (Q,), sheared."""

    axes: Array  # (Q, 3) int64: the coordinates across, then that along
    slope: Array  # (Q, 2)
    start: Array  # (Q, 2)
    along: Array  # (Q, 3): the largest coordinate of directions, factors of t twice
    origin: Array  # (Q,)
    bounds: Array  # (Q, 4): least and most depth, which are wide, least and most t


class Limits(NamedTuple):
    """What counts as equal; as `query.crossings` has it."""

    slack: float
    near: float
    tied: float
    blur: float


class Room(NamedTuple):
    """Where a search keeps what waits."""

    nodes: Array  # (_STACK, 2) int64
    keys: Array  # (_STACK,)
    cells: Array  # (_STACK, n, 3)
    places: Array  # (_STACK, 3, 2)
    depth: Array  # (_STACK,) int64
    work: Array  # (n, 3)
    own: Array  # (64,)

    @classmethod
    def of(cls, size: int) -> Room:
        """For cells of so many coefficients."""
        return cls(
            np.empty((_STACK, 2), dtype=np.int64), np.empty(_STACK), np.empty((_STACK, size, 3)),
            np.empty((_STACK, 3, 2)), np.empty(_STACK, dtype=np.int64), np.empty((size, 3)),
            np.zeros(64),
        )  # fmt: skip


@outlined
def _newton(x: Array, shape: Shape, sloped: bool, room: Room, slack: float) -> int:
    """The zero of a cell that has one at most: s, t, value and derivatives in `room.own`.

    0 if there is none, 1 if there is one, 2 if nobody knows: where derivatives are about parallel,
    a zero that rounding moved across a side is far from where the search is held there.

    ``own[0:2]`` are s and t, ``own[2:11]`` value, d/ds and d/dt, of three coordinates each;
    own[16:48] has powers.
    """
    own, degree = room.own, shape.lines.shape[2] - 1
    s = t = 1 / 3 if sloped else 0.5
    last = np.inf
    done = False
    for step in range(_STEPS + 1):
        r = 1 - s - t if sloped else 1 - s
        q = 1.0 if sloped else 1 - t
        own[16], own[24], own[32], own[40] = 1.0, 1.0, 1.0, 1.0
        for k in range(1, degree):
            own[16 + k] = own[15 + k] * s
            own[24 + k] = own[23 + k] * (t if sloped else r)
            own[32 + k] = own[31 + k] * (r if sloped else t)
            own[40 + k] = own[39 + k] * q
        a0 = a1 = a2 = b0 = b1 = b2 = c0 = c1 = c2 = d0 = d1 = d2 = 0.0
        for m in range(len(shape.times)):
            w = shape.times[m] * own[16 + shape.powers[m, 0]] * own[24 + shape.powers[m, 1]]
            w *= own[32 + shape.powers[m, 2]] * own[40 + shape.powers[m, 3]]
            k = shape.lower[m, 0]
            a0, a1, a2 = a0 + w * x[k, 0], a1 + w * x[k, 1], a2 + w * x[k, 2]
            k = shape.lower[m, 1]
            b0, b1, b2 = b0 + w * x[k, 0], b1 + w * x[k, 1], b2 + w * x[k, 2]
            k = shape.lower[m, 2]
            c0, c1, c2 = c0 + w * x[k, 0], c1 + w * x[k, 1], c2 + w * x[k, 2]
            k = shape.lower[m, 3]
            d0, d1, d2 = d0 + w * x[k, 0], d1 + w * x[k, 1], d2 + w * x[k, 2]
        if sloped:
            f0, f1, f2 = (
                r * a0 + s * b0 + t * c0,
                r * a1 + s * b1 + t * c1,
                r * a2 + s * b2 + t * c2,
            )
            u0, u1, u2 = b0 - a0, b1 - a1, b2 - a2
            v0, v1, v2 = c0 - a0, c1 - a1, c2 - a2
        else:
            f0 = (r * a0 + s * b0) * q + (r * c0 + s * d0) * t
            f1 = (r * a1 + s * b1) * q + (r * c1 + s * d1) * t
            f2 = (r * a2 + s * b2) * q + (r * c2 + s * d2) * t
            u0, u1, u2 = (
                (b0 - a0) * q + (d0 - c0) * t, (b1 - a1) * q + (d1 - c1) * t,
                (b2 - a2) * q + (d2 - c2) * t,
            )  # fmt: skip
            v0, v1, v2 = (
                (c0 - a0) * r + (d0 - b0) * s, (c1 - a1) * r + (d1 - b1) * s,
                (c2 - a2) * r + (d2 - b2) * s,
            )  # fmt: skip
        u0, u1, u2 = u0 * degree, u1 * degree, u2 * degree
        v0, v1, v2 = v0 * degree, v1 * degree, v2 * degree
        if done or step == _STEPS:
            break
        det = u0 * v1 - u1 * v0
        ds, dt = (v0 * f1 - v1 * f0) / det, (u1 * f0 - u0 * f1) / det
        p, g = s, t
        s, t = s + ds, t + dt
        if sloped:
            over = s + t - 1
            if over > 0:
                s = min(max(s - over / 2, 0.0), 1.0)
                t = 1 - s
        s, t = min(max(s, 0.0), 1.0), min(max(t, 0.0), 1.0)
        moved = max(abs(s - p), abs(t - g))
        done = moved <= 2.0**-51 or (moved <= 1e-11 and moved >= 0.5 * last)
        last = moved
    own[0], own[1] = s, t
    own[2], own[3], own[4] = f0, f1, f2
    own[5], own[6], own[7] = u0, u1, u2
    own[8], own[9], own[10] = v0, v1, v2
    off, side = max(abs(f0), abs(f1)), min(s, t)
    if off <= 2 * slack:
        return 1
    side = min(side, 1 - s - t) if sloped else min(side, min(1 - s, 1 - t))
    det = abs(u0 * v1 - u1 * v0)
    longest = np.sqrt((u0 * u0 + u1 * u1) * (v0 * v0 + v1 * v1))
    # (not if nothing is a number either)
    return 0 if side > 2.0**-50 or off * det > _PARALLEL * slack * (det + longest) else 2


@outlined
def _halve(room: Room, shape: Shape, top: int, sign: float) -> None:
    """Cell number `top` that waits becomes two, the nearer one last."""
    x, work, n = room.cells[top], room.work, room.work.shape[0]
    lines, way, widest = shape.lines, 0, -1.0
    length = lines.shape[2]
    for w in range(len(lines)):
        widest_here = 0.0
        for i in range(lines.shape[1]):
            for j in range(length - 1):
                if lines[w, i, j + 1] < 0:
                    break
                a, b = lines[w, i, j], lines[w, i, j + 1]
                p, q = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1]
                widest_here = max(widest_here, p * p + q * q)
        if widest_here > widest:
            way, widest = w, widest_here
    for k in range(n):
        work[k, 0], work[k, 1], work[k, 2] = x[k, 0], x[k, 1], x[k, 2]
    y, total = room.cells[top + 1], 0.0
    for i in range(lines.shape[1]):
        many = length
        while lines[way, i, many - 1] < 0:
            many -= 1
        for level in range(many):
            a = lines[way, i, 0]
            to = shape.halves[way, 0, i, level]
            x[to, 0], x[to, 1], x[to, 2] = work[a, 0], work[a, 1], work[a, 2]
            total += work[a, 2]
            for j in range(many - 1 - level):
                a, b = lines[way, i, j], lines[way, i, j + 1]
                work[a, 0] = 0.5 * (work[a, 0] + work[b, 0])
                work[a, 1] = 0.5 * (work[a, 1] + work[b, 1])
                work[a, 2] = 0.5 * (work[a, 2] + work[b, 2])
        for j in range(many):
            a, to = lines[way, i, j], shape.halves[way, 1, i, j]
            y[to, 0], y[to, 1], y[to, 2] = work[a, 0], work[a, 1], work[a, 2]
            total -= work[a, 2]
    here, there = room.places[top], room.places[top + 1]
    o0, o1 = here[0, 0], here[0, 1]
    s0, s1, t0, t1 = here[1, 0], here[1, 1], here[2, 0], here[2, 1]
    for k in range(3):
        a, b = shape.frames[way, 0, k, 0], shape.frames[way, 0, k, 1]
        here[k, 0], here[k, 1] = a * s0 + b * t0, a * s1 + b * t1
        a, b = shape.frames[way, 1, k, 0], shape.frames[way, 1, k, 1]
        there[k, 0], there[k, 1] = a * s0 + b * t0, a * s1 + b * t1
    here[0, 0], here[0, 1] = here[0, 0] + o0, here[0, 1] + o1
    there[0, 0], there[0, 1] = there[0, 0] + o0, there[0, 1] + o1
    room.depth[top] += 1
    room.depth[top + 1] = room.depth[top]
    if sign * total < 0:  # the first is nearer
        for k in range(n):
            for axis in range(3):
                x[k, axis], y[k, axis] = y[k, axis], x[k, axis]
        for k in range(3):
            for axis in range(2):
                here[k, axis], there[k, axis] = there[k, axis], here[k, axis]


@inlined
def _meets(
    boxes: Array, node: int, lines: Lines, q: int, slack: float, low: float, high: float
) -> float:
    """The least depth, by its sign, of a box that a ray meets between two depths; else inf."""
    a, b, c = lines.axes[q, 0], lines.axes[q, 1], lines.axes[q, 2]
    z0, z1 = boxes[node, c], boxes[node, 3 + c]
    if z1 < low or z0 > high:
        return np.inf
    sx, sy = lines.slope[q, 0], lines.slope[q, 1]
    z, hz = 0.5 * (z0 + z1), 0.5 * (z1 - z0) + slack
    x0, x1, y0, y1 = boxes[node, a], boxes[node, 3 + a], boxes[node, b], boxes[node, 3 + b]
    x, y = (
        0.5 * (x0 + x1) - sx * z - lines.start[q, 0],
        0.5 * (y0 + y1) - sy * z - lines.start[q, 1],
    )
    hx, hy = 0.5 * (x1 - x0) + slack, 0.5 * (y1 - y0) + slack
    if abs(x) > hx + abs(sx) * hz or abs(y) > hy + abs(sy) * hz:
        return np.inf
    if abs(sx * y - sy * x) > abs(sx) * hy + abs(sy) * hx + slack:
        return np.inf
    least: float = z0 if lines.along[q, 0] > 0 else -z1
    return least


@inlined
def _simple(x: Array, shape: Shape, slack: float, own: Array) -> int:
    """Whether a map of coefficients x has a zero: 0 no, 1 one at most, 2 nobody knows.

    Sizes of the inverse of its mean derivative are left in ``own[12:14]``.
    """
    n, degree, count = len(x), shape.lines.shape[2] - 1, shape.pairs.shape[1]
    a0 = a1 = b0 = b1 = 0.0
    for k in range(count):
        i, j = shape.pairs[0, k, 0], shape.pairs[0, k, 1]
        a0, a1 = a0 + (x[j, 0] - x[i, 0]), a1 + (x[j, 1] - x[i, 1])
        i, j = shape.pairs[1, k, 0], shape.pairs[1, k, 1]
        b0, b1 = b0 + (x[j, 0] - x[i, 0]), b1 + (x[j, 1] - x[i, 1])
    scale = degree / count
    a0, a1, b0, b1 = a0 * scale, a1 * scale, b0 * scale, b1 * scale
    det = a0 * b1 - a1 * b0
    if not abs(det) > 1e-12 * (a0 * a0 + a1 * a1 + b0 * b0 + b1 * b1):
        return 2
    # onto units of the mean derivatives
    m00, m01, m10, m11 = b1 / det, -b0 / det, -a1 / det, a0 / det
    low0 = low1 = np.inf
    high0 = high1 = -np.inf
    for k in range(n):
        p, q = m00 * x[k, 0] + m01 * x[k, 1], m10 * x[k, 0] + m11 * x[k, 1]
        low0, high0 = min(low0, p), max(high0, p)
        low1, high1 = min(low1, q), max(high1, q)
    spare0, spare1 = slack * (abs(m00) + abs(m01)), slack * (abs(m10) + abs(m11))
    if low0 > spare0 or high0 < -spare0 or low1 > spare1 or high1 < -spare1:
        return 0
    own[12], own[13] = spare0, spare1
    bend0 = bend1 = 0.0
    for k in range(count):
        i, j = shape.pairs[0, k, 0], shape.pairs[0, k, 1]
        p, q = (x[j, 0] - x[i, 0]) * degree, (x[j, 1] - x[i, 1]) * degree
        p, q = m00 * p + m01 * q - 1, m10 * p + m11 * q
        bend0 = max(bend0, p * p + q * q)
        i, j = shape.pairs[1, k, 0], shape.pairs[1, k, 1]
        p, q = (x[j, 0] - x[i, 0]) * degree, (x[j, 1] - x[i, 1]) * degree
        p, q = m00 * p + m01 * q, m10 * p + m11 * q - 1
        bend1 = max(bend1, p * p + q * q)
    own[14] = bend0 + bend1
    return 1


@inlined
def _settled(own: Array, sloped: bool, limits: Limits, lines: Lines, q: int, real: Array) -> bool:
    """Whether the zero of a cell counts; depth, t, blur, sign and rim go to ``real[2:]``."""
    s, t = own[0], own[1]
    det = own[5] * own[9] - own[6] * own[8]
    rim = 8 * (own[12] + own[13])
    side = min(s, t)
    side = min(side, 1 - s - t) if sloped else min(side, min(1 - s, 1 - t))
    z = own[4]
    time = (z - lines.origin[q]) / lines.along[q, 0] * lines.along[q, 1] * lines.along[q, 2]
    if not (time >= lines.bounds[q, 2] and time <= lines.bounds[q, 3]):
        return False
    real[2], real[3] = z, time
    real[4] = min(4 * limits.slack + 0.5 * rim * (abs(own[7]) + abs(own[10])), limits.blur)
    real[5] = det * lines.along[q, 0]
    real[6] = 1.0 if side <= rim else 0.0
    return True


@lean
def traverse(
    tree: Hierarchy, shape: Shape, lines: Lines, limits: Limits, sloped: bool, what: int,
    room: Room, ray: Array, cell: Array, real: Array, left: Array,
) -> int:  # fmt: skip
    """Write down where rays cross cells; the number of crossings.

    `left` (Q,) is set to 1 for those rays of which not all that counts is known: they have none.
    Hits have their ray and cell, (H,) int64, and real (H, 7): u, v, depth, t, how well depth is
    known, the sign of what the ray sees, and whether it is on the rim of a cell. Of what is asked,
    the first, any or every one, others that are as near may be among them.
    """
    levels, total, size = len(tree.starts) - 1, 0, len(tree.points)
    n = room.work.shape[0]
    for q in range(len(lines.origin)):
        begin, sign = total, 1.0 if lines.along[q, 0] > 0 else -1.0
        low, high, best = lines.bounds[q, 0], lines.bounds[q, 1], np.inf
        doubt, budget, waits = np.inf, _BUDGET, 0
        over = False
        for node in range(tree.starts[0], tree.starts[1]):
            key = _meets(tree.boxes, node, lines, q, limits.slack, low, high)
            if key < np.inf:
                room.nodes[waits, 0], room.nodes[waits, 1], room.keys[waits] = 0, node, key
                waits += 1
        while waits > 0:
            # the nearest of what came last
            waits -= 1
            level, node, key = room.nodes[waits, 0], room.nodes[waits, 1], room.keys[waits]
            if what != EVERY and key > best + limits.tied:
                continue
            if level + 1 < levels:
                first = tree.starts[level + 1] + _WIDTH * (node - tree.starts[level])
                end, at = min(first + _WIDTH, tree.starts[level + 2]), waits
                for child in range(first, end):
                    key = _meets(tree.boxes, child, lines, q, limits.slack, low, high)
                    if key < np.inf:
                        k = waits
                        while k > at and room.keys[k - 1] < key:
                            room.keys[k] = room.keys[k - 1]
                            room.nodes[k, 0], room.nodes[k, 1] = (
                                room.nodes[k - 1, 0], room.nodes[k - 1, 1],
                            )  # fmt: skip
                            k -= 1
                        room.nodes[k, 0], room.nodes[k, 1] = level + 1, child
                        room.keys[k] = key
                        waits += 1
                continue
            leaf = tree.order[node - tree.starts[level]]
            if leaf >= size:
                doubt = min(doubt, key)
                continue
            a, b, c = lines.axes[q, 0], lines.axes[q, 1], lines.axes[q, 2]
            sx, sy, x0, y0 = (
                lines.slope[q, 0], lines.slope[q, 1], lines.start[q, 0], lines.start[q, 1],
            )  # fmt: skip
            for k in range(n):
                z = tree.points[leaf, k, c]
                room.cells[0, k, 0] = tree.points[leaf, k, a] - (sx * z + x0)
                room.cells[0, k, 1] = tree.points[leaf, k, b] - (sy * z + y0)
                room.cells[0, k, 2] = z
            place = room.places[0]
            place[0, 0], place[0, 1] = 0.0, 0.0
            place[1, 0], place[1, 1], place[2, 0], place[2, 1] = 1.0, 0.0, 0.0, 1.0
            room.depth[0] = 0
            cells = 1
            budget += _MORE
            while cells > 0:
                cells -= 1
                budget -= 1
                if budget < 0:
                    over = True
                    break
                x = room.cells[cells]
                low0 = low1 = low2 = np.inf
                high0 = high1 = high2 = -np.inf
                for k in range(n):
                    low0, high0 = min(low0, x[k, 0]), max(high0, x[k, 0])
                    low1, high1 = min(low1, x[k, 1]), max(high1, x[k, 1])
                    low2, high2 = min(low2, x[k, 2]), max(high2, x[k, 2])
                if low0 > limits.slack or high0 < -limits.slack:
                    continue
                if low1 > limits.slack or high1 < -limits.slack or high2 < low or low2 > high:
                    continue
                simple = _simple(x, shape, limits.slack, room.own)
                if simple == 0:
                    continue
                if simple == 1 and room.own[14] <= limits.near * limits.near:
                    zero = _newton(x, shape, sloped, room, limits.slack)
                    if zero == 2:
                        doubt = min(doubt, low2 if sign > 0 else -high2)
                    if zero != 1:
                        continue
                    if total == len(ray):
                        over = True
                        break
                    if not _settled(room.own, sloped, limits, lines, q, real[total]):
                        continue
                    place = room.places[cells]
                    s, t = room.own[0], room.own[1]
                    area = place[1, 0] * place[2, 1] - place[1, 1] * place[2, 0]
                    du, dv = tree.frames[leaf, 2], tree.frames[leaf, 3]
                    p = place[0, 0] + s * place[1, 0] + t * place[2, 0]
                    g = place[0, 1] + s * place[1, 1] + t * place[2, 1]
                    real[total, 0] = tree.frames[leaf, 0] + p * du
                    real[total, 1] = tree.frames[leaf, 1] + g * dv
                    real[total, 5] *= area * du * dv
                    ray[total], cell[total] = q, leaf
                    best = min(best, sign * real[total, 2])
                    total += 1
                    if what == ANY:
                        waits = cells = 0
                    elif what == FIRST:
                        if sign > 0:
                            high = min(high, best + limits.tied)
                        else:
                            low = max(low, -best - limits.tied)
                    continue
                if room.depth[cells] >= _HALVINGS:
                    doubt = min(doubt, low2 if sign > 0 else -high2)
                    continue
                _halve(room, shape, cells, sign)
                cells += 2
            if over:
                break
        if what == ANY and total > begin:
            continue
        if over or (doubt < np.inf and (what == EVERY or doubt <= best + limits.tied)):
            left[q] = 1
            total = begin
        elif what == FIRST:
            end, total = total, begin
            for k in range(begin, end):
                if sign * real[k, 2] <= best + limits.tied:
                    ray[total], cell[total] = ray[k], cell[k]
                    for j in range(7):
                        real[total, j] = real[k, j]
                    total += 1
    return total
