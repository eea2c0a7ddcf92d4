"""Compiled tangents and curvature of scattered queries: directions, and what does not scale.

Neither depends on how parameters are scaled, nor curvature on how they are turned: derivatives are
those in parameters of a patch, or around special corners of a piece there, where powers of the
eigenvalues that they fall by are taken out. ``derivations/curvature.py`` derives what is done.

Rounding errors are bounded from the largest size of a control point. Where these bounds leave
something open the true ones are asked, in splines, or the query is left to the reference.
"""

from __future__ import annotations

from math import copysign, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels.doubt import NOISE, SCALED
from limitsurf._kernels.evaluation import (
    FAR,
    FIRST,
    KIND,
    LANES,
    MODES,
    PAIRS,
    QUERIES,
    ROW,
    ROWS,
    SECOND,
    SIZE,
    STEP,
    TINY,
    TURN,
    TURNS,
    Patches,
    Points,
    Room,
    Tables,
    control_points,
    patches_of,
    points_of,
    powered,
    scale_by_two,
    tables_of,
)
from limitsurf._kernels.finding import finder
from limitsurf._kernels.jit import bits, combination, inlined, lean, outlined

Array = NDArray[Any]

_TERMS = np.arange(6)  # in the order of `LimitSurface.jet`
_FIRST_ORDER = _TERMS[1:3].copy()
_FLAT = 1e-6  # curvature times size, as in `reference.honest`
# Part of a result that bounds of its errors are to stay below in two cases. The first coefficient
# that bends a form may be errors alone, which the reference leaves out: at most this is what that
# changes. And refined points around special corners, where they cancel each other, know fewer
# digits than eigenfunctions do, which are 0 where they should be.
_CERTAIN = 2.0**-36
# a coordinate in other axes has errors of at most sqrt(3) times those of the given ones
_TURNED = 1.75
# power of the ratio of two eigenvalues below which products of several may leave float64's range
_LEAST_SECOND, _LEAST_THIRD = 2.0**-300, 2.0**-900
# places in the room of a form: its three entries, their noise, its axis, the unit normal
_FORM, _DOUBT, _AXIS, _NORMAL = 0, 3, 4, 8

_sum3, _sum6 = combination(3), combination(6)


@inlined
def _exponent(x: float) -> int:
    """The power of two that a positive number lies below, that of the least normal one if less."""
    n: int = bits(x)
    return max(n >> 52, 1) - 1022


@outlined
def _form(jet: Array, errors: Array, ratio: float, bent: Array) -> None:
    """A second fundamental form, see `reference.shape_operators`, into `bent`.

    Derivatives, in rows of `LANES` of `jet` in the order of `LimitSurface.jet`, have coordinates
    x, y and z, of which y and z are in units `ratio` times that of x; `errors` bounds those of
    each. Entries have the units of y / x^2, 1 / x and 1 / y. The noise bounds the errors of each of
    the entries, in all in these units.
    """
    x0, x1, x2 = jet[LANES], jet[LANES + 1], jet[LANES + 2]
    y0, y1, y2 = jet[2 * LANES], jet[2 * LANES + 1], jet[2 * LANES + 2]
    turn = x0 * x0 + ratio * ratio * (x1 * x1 + x2 * x2) < y0 * y0 + ratio * ratio * (
        y1 * y1 + y2 * y2
    )
    sign, s, t, ss, tt = 1.0, LANES, 2 * LANES, 3 * LANES, 5 * LANES
    if turn:  # a quarter: s' = t, t' = -s
        x0, x1, x2, y0, y1, y2 = y0, y1, y2, -x0, -x1, -x2
        sign, s, t, ss, tt = -1.0, t, s, tt, ss
    st = 4 * LANES
    u1, u2, v1, v2 = ratio * x1, ratio * x2, ratio * y1, ratio * y2
    e = x0 * x0 + u1 * u1 + u2 * u2
    slope = (x0 * y0 + u1 * v1 + u2 * v2) / e
    c0, c1, c2 = x1 * y2 - x2 * y1, x2 * y0 - x0 * y2, x0 * y1 - x1 * y0
    n0 = ratio * c0
    square = n0 * n0 + c1 * c1 + c2 * c2
    d = sqrt(square)
    m11 = c0 * jet[ss] + c1 * jet[ss + 1] + c2 * jet[ss + 2]
    m12 = sign * (c0 * jet[st] + c1 * jet[st + 1] + c2 * jet[st + 2])
    m22 = c0 * jet[tt] + c1 * jet[tt + 1] + c2 * jet[tt + 2]
    bent[_FORM] = m11 / (d * e)
    bent[_FORM + 1] = (m12 - slope * m11) / square
    bent[_FORM + 2] = (m22 - slope * (2 * m12 - slope * m11)) * e / (d * square)
    scale = 1 / sqrt(e)
    bent[_AXIS], bent[_AXIS + 1], bent[_AXIS + 2] = x0 * scale, u1 * scale, u2 * scale
    scale = 1 / d
    bent[_NORMAL], bent[_NORMAL + 1], bent[_NORMAL + 2] = n0 * scale, c1 * scale, c2 * scale

    x0, x1, x2, y0, y1, y2 = abs(x0), abs(x1), abs(x2), abs(y0), abs(y1), abs(y2)
    u1, u2, v1, v2 = abs(u1), abs(u2), abs(v1), abs(v2)
    c0, c1, c2, size = abs(c0), abs(c1), abs(c2), abs(ratio)
    a0, a1, a2 = errors[s], errors[s + 1], errors[s + 2]
    b0, b1, b2 = errors[t], errors[t + 1], errors[t + 2]
    e0 = x1 * b2 + x2 * b1 + a1 * y2 + a2 * y1
    e1 = x2 * b0 + x0 * b2 + a2 * y0 + a0 * y2
    e2 = x0 * b1 + x1 * b0 + a0 * y1 + a1 * y0
    tilt = x0 * b0 + y0 * a0 + size * (u1 * b1 + u2 * b2 + v1 * a1 + v2 * a2)
    tilt /= e
    n11 = c0 * errors[ss] + c1 * errors[ss + 1] + c2 * errors[ss + 2]
    n11 += e0 * abs(jet[ss]) + e1 * abs(jet[ss + 1]) + e2 * abs(jet[ss + 2])
    n12 = c0 * errors[st] + c1 * errors[st + 1] + c2 * errors[st + 2]
    n12 += e0 * abs(jet[st]) + e1 * abs(jet[st + 1]) + e2 * abs(jet[st + 2])
    n22 = c0 * errors[tt] + c1 * errors[tt + 1] + c2 * errors[tt + 2]
    n22 += e0 * abs(jet[tt]) + e1 * abs(jet[tt + 1]) + e2 * abs(jet[tt + 2])
    slope, m11, m12 = abs(slope), abs(m11), abs(m12)
    n22 += slope * (2 * n12 + slope * n11) + 2 * tilt * (m12 + slope * m11)
    n12 += slope * n11 + tilt * m11
    bound = max(n11 / (d * e) * size, n12 / square)
    bent[_DOUBT] = max(bound, n22 * e / (d * square) / size)


@inlined
def _independent(jet: Array, errors: Array) -> bool:
    """Whether first derivatives are, whatever the rounding errors; see ``doubt.py``."""
    x = max(abs(jet[LANES]), abs(jet[LANES + 1]), abs(jet[LANES + 2]))
    y = max(abs(jet[2 * LANES]), abs(jet[2 * LANES + 1]), abs(jet[2 * LANES + 2]))
    noise, other = errors[LANES], errors[2 * LANES]
    if not (x > noise and y > other and x < np.inf and y < np.inf):
        return False
    a, b = 1 / x, 1 / y
    a0, a1, a2 = jet[LANES] * a, jet[LANES + 1] * a, jet[LANES + 2] * a
    b0, b1, b2 = jet[2 * LANES] * b, jet[2 * LANES + 1] * b, jet[2 * LANES + 2] * b
    c0, c1, c2 = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
    doubt = SCALED * (noise * a + other * b)
    independent: bool = c0 * c0 + c1 * c1 + c2 * c2 > doubt * doubt
    return independent


@inlined
def _largest(bent: Array) -> float:
    """Of the entries of a form; NaN if one of them is."""
    x, y, z = abs(bent[_FORM]), abs(bent[_FORM + 1]), abs(bent[_FORM + 2])
    largest: float = max(x, y, z) + 0 * (x + y + z)
    return largest


@outlined
def _principal(bent: Array, exponent: int, sign: float, out: Array, query: int) -> None:
    """Principal, mean and Gaussian curvatures and directions, see `reference.principal`.

    Curvatures are times 2^exponent, directions times `sign`.
    """
    w11, w12, w22 = bent[_FORM], bent[_FORM + 1], bent[_FORM + 2]
    largest = _largest(bent)
    if largest > 0:  # neither overflow nor underflow in squares
        more = _exponent(largest)
        w11, w12 = scale_by_two(w11, -more), scale_by_two(w12, -more)
        w22 = scale_by_two(w22, -more)
        exponent += more
    mean, half = (w11 + w22) / 2, (w11 - w22) / 2
    spread, gaussian = sqrt(half * half + w12 * w12), w11 * w22 - w12 * w12
    # the larger by size first: the other one is the quotient, without cancellation
    large = mean - spread if mean < 0 else mean + spread
    small = gaussian / large if large != 0 else 0.0
    k1, k2 = (small, large) if mean < 0 else (large, small)
    # half the angle of (half, w12): of two vectors along it the one without cancellation
    x, y = spread + half, w12
    if half < 0:
        x, y = abs(w12), copysign(spread - half, w12)
    if spread > 0:
        scale = sign / sqrt(x * x + y * y)
        x, y = x * scale, y * scale
    else:
        x, y = sign + 0 * mean, 0 * mean
    out[query, 0], out[query, 1] = scale_by_two(k1, exponent), scale_by_two(k2, exponent)
    out[query, 2], out[query, 3] = (
        scale_by_two(mean, exponent),
        scale_by_two(gaussian, 2 * exponent),
    )
    n0, n1, n2 = bent[_NORMAL], bent[_NORMAL + 1], bent[_NORMAL + 2]
    a0, a1, a2 = bent[_AXIS], bent[_AXIS + 1], bent[_AXIS + 2]
    b0, b1, b2 = n1 * a2 - n2 * a1, n2 * a0 - n0 * a2, n0 * a1 - n1 * a0
    out[query, 4], out[query, 5], out[query, 6] = x * a0 + y * b0, x * a1 + y * b1, x * a2 + y * b2
    out[query, 7], out[query, 8], out[query, 9] = x * b0 - y * a0, x * b1 - y * a1, x * b2 - y * a2


@inlined
def _unit(out: Array, k: int, query: int, width: int, noise: float) -> bool:
    """Make vectors of `width` channels unit ones; False if one might be noise."""
    for start in range(0, out.shape[2], width):
        largest = total = 0.0
        for c in range(start, start + width):
            largest = max(largest, abs(out[k, query, c]))
        if not (largest > noise and largest < np.inf):
            return False
        scale = 1 / largest
        for c in range(start, start + width):
            x = out[k, query, c] * scale
            total += x * x
        scale /= sqrt(total)
        for c in range(start, start + width):
            out[k, query, c] *= scale
    return True


def shapers(shape: Any) -> tuple[Any, Any]:
    """The kernels `tangents` and `curved`, for faces of a shape."""
    size, own_point, shared, middle = shape.POINTS, shape.OWN, shape.BLOCK, shape.MIDDLE
    around, kept, *_ = control_points(shape)
    _locate, _ask, _controls = finder(shape)
    spline, patch_weights, write = shape.spline, shape.patch_weights, shape.write
    sizes_of_weights, spline_rows = shape.sizes_of_weights, shape.spline_rows
    eigenfunctions, bent_spline = shape.eigenfunctions, shape.bent_spline

    @inlined
    def _block(code: int, tables: Tables, width: int) -> tuple[int, int]:
        """Where the coefficients of a special patch begin, and what it knows beside them."""
        kind = code >> KIND
        n = tables.kinds[kind, ROWS]
        block = (tables.kinds[kind, MODES] + (code & ROW) * (n + 3)) * width
        return block, block + (n + 2) * width

    @inlined
    def _error(code: int, place: int, patches: Patches, tables: Tables, points: Points) -> float:
        """What rounding did to control points of a spline at most, times 1 / NOISE."""
        error = 0.0
        if code >> KIND > 1 and shared and tables.kinds[code >> KIND, MODES] < 0:
            error = points.fine[around(code, place, tables)[1] + 2, 0]
        elif code >> KIND > 1:
            # rows that refine have sums of at most 3, where points are reflected
            _, known = _block(code, tables, points.high.shape[1])
            error = 3 * points.modes[known + 2]
        elif code >> FAR & 1:
            at, inner = (code & ROW) * size, len(points.high)
            for j in range(at, at + size):
                number = np.int64(patches.ids[j]) - inner
                if number >= 0:
                    error = max(error, points.errors[number])
        return error

    @inlined
    def _spline_tangents(
        k: int, query: int, patches: Patches, tables: Tables, points: Points, out: Array,
        width: int, room: Room,
    ) -> bool:  # fmt: skip
        code, place, d, reach = room.codes[k], room.places[k], out.shape[2], 0.0
        found, turn = room.found, code >> TURN & TURNS
        if code >> FAR & 1 and d != 3:
            return False  # (errors of control points are known of three channels alone)
        patch_weights(code, room.s[k], room.t[k], 1, patches, room.weights)
        for channel in range(0, d, LANES):
            grid, numbers, at, base, column = _controls(
                code, place, channel, patches, tables, points, room
            )
            spline(1, True, grid, numbers, at, base, column, room.weights, found)
            for c in range(LANES):
                reach = max(reach, found[3 * LANES + c])
            write(1, found, _FIRST_ORDER, turn, place & 3, 1.0, 0, 0, out, query, channel)
        sizes_of_weights(room.weights, 1, found)
        noise = (reach + _error(code, place, patches, tables, points)) * NOISE + TINY
        noise *= found[1] + found[2]
        if code >> KIND > 1 and tables.kinds[code >> KIND, MODES] >= 0:
            noise /= _CERTAIN
        return _unit(out, 0, query, width, noise) and _unit(out, 1, query, width, noise)

    @inlined
    def _special_tangents(
        k: int, query: int, patches: Patches, tables: Tables, points: Points, out: Array,
        width: int, room: Room,
    ) -> bool:  # fmt: skip
        code, place = room.codes[k], room.places[k]
        found, rows, modes = room.found, room.rows, points.modes
        kind, turn, level, wide = code >> KIND, code >> TURN & TURNS, (place >> 2) - 1, 0
        if tables.kinds[kind, MODES] < 0 or level < 0 or (code >> FAR & 1 and out.shape[2] != 3):
            return False
        wide = points.high.shape[1]
        block, known = _block(code, tables, wide)
        if modes[known + 1] != 1:
            return False
        n, noise = tables.kinds[kind, ROWS], 0.0
        eigenfunctions(1, kind, place & 3, room.s[k], room.t[k], tables, rows)
        powered(kind, FIRST, level, 3, tables, rows)
        for j in range(n):
            noise += (abs(rows[1, j]) + abs(rows[2, j])) * tables.sizes[kind, j]
        noise *= NOISE * modes[known + 2]
        sign = tables.mantissas[kind, level % STEP] * tables.mantissas[kind, STEP + level // STEP]
        for channel in range(0, out.shape[2], LANES):
            _sum3(rows, n, modes, block + wide + channel, wide, found)
            sign = copysign(1.0, sign)
            write(1, found, _FIRST_ORDER, turn, place & 3, sign, 0, 0, out, query, channel)
        return _unit(out, 0, query, width, noise) and _unit(out, 1, query, width, noise)

    @lean
    def tangents(
        face: Array, u: Array, v: Array, words: Array, width: int, out: Array, start: int,
        rest: Array, room: Room,
    ) -> int:  # fmt: skip
        """Unit vectors along d/du and d/dv, of `width` channels each, into ``out[0]``, ``out[1]``.

        Arguments and what is returned are as for `evaluator`.
        """
        patches, tables, points = patches_of(words), tables_of(words), points_of(words)
        left = 0
        for begin in range(0, len(face), QUERIES):
            count = min(QUERIES, len(face) - begin)
            if not _locate(face, u, v, begin, count, patches, room):
                return -1
            for k in range(count):
                _ask(k, count, room, patches, tables, points)
                query, code = start + begin + k, room.codes[k]
                if code < 0:
                    for c in range(out.shape[2]):
                        out[0, query, c] = out[1, query, c] = np.nan
                    continue
                given = k, query, patches, tables, points, out, width, room
                done, special = False, code >> KIND > 1
                known = special and tables.kinds[code >> KIND, MODES] >= 0
                if not special or 0 < room.places[k] >> 2 <= kept(code, tables):
                    done = _spline_tangents(*given)
                if known and not done:
                    done = _special_tangents(*given)
                if not done:
                    rest[left] = query
                    left += 1
        return left

    @outlined
    def _thorough(
        code: int, s: float, t: float, factor: float, patches: Patches, tables: Tables,
        points: Points, rounding: Array, room: Room, errors: Array, weights: Array,
    ) -> None:  # fmt: skip
        """True bounds of the errors of derivatives of a spline over control points, as they are."""
        grid, numbers, at, base, _ = _controls(code, 0, 0, patches, tables, points, room)
        own, first = base + np.int64(numbers[at + own_point]), (code & ROW) * size
        plain = code & ~(TURNS << TURN)
        for term in range(1, 6):
            one = _TERMS[term : term + 1]
            spline_rows(plain, 0, s, t, 2, one, patches, room.weights, weights)
            for c in range(3):
                total = 0.0
                for j in range(size):
                    x = abs(grid[base + np.int64(numbers[at + j]), c] - grid[own, c])
                    extra = np.int64(patches.ids[first + j]) - len(points.high)
                    if extra >= 0:
                        x += rounding[extra, c]
                    total += abs(weights[0, 0, j]) * x
                errors[LANES * term + c] = NOISE * factor * total

    @inlined
    def _bent_spline(
        k: int, query: int, patches: Patches, tables: Tables, points: Points, rounding: Array,
        out: Array, room: Room, mine: Array,
    ) -> bool:  # fmt: skip
        code, place, found, weights = room.codes[k], room.places[k], room.found, room.weights
        errors, bent, s, t = mine[0, 0], mine[1, 0], room.s[k], room.t[k]
        patch_weights(code, s, t, 2, patches, weights)
        grid, numbers, at, base, _ = _controls(code, place, 0, patches, tables, points, room)
        bent_spline(grid, numbers, at, base, weights, found)
        extent = max(found[6 * LANES], found[6 * LANES + 1], found[6 * LANES + 2])
        extent += _error(code, place, patches, tables, points)
        sizes_of_weights(weights, 2, bent)
        # first derivatives of about 1: neither overflow nor underflow in products
        largest = 0.0
        for c in range(3):
            largest = max(largest, abs(found[LANES + c]), abs(found[2 * LANES + c]))
        if not 0 < largest < np.inf:
            return False
        exponent = -_exponent(largest)
        factor = scale_by_two(1.0, exponent)
        noise = (extent * NOISE + TINY) * factor
        for j in range(1, 6):
            for c in range(3):
                found[LANES * j + c] *= factor
                errors[LANES * j + c] = noise * bent[j]
        if not _independent(found, errors):
            return False
        _form(found, errors, 1.0, bent)
        size_of_form = _largest(bent)
        # (where there are no eigenfunctions the reference also has refined points alone)
        eigen = code >> KIND > 1 and tables.kinds[code >> KIND, MODES] >= 0
        if eigen and not _CERTAIN * size_of_form > bent[_DOUBT]:
            return False
        if code >> KIND <= 1 and not size_of_form > bent[_DOUBT]:
            if not size_of_form < np.inf:
                return False
            _thorough(code, s, t, factor, patches, tables, points, rounding, room, errors, mine[2:])
            _form(found, errors, 1.0, bent)
            if not size_of_form > bent[_DOUBT]:
                value = 0.0 if bent[_DOUBT] * (extent * factor) <= _FLAT else np.nan
                bent[_FORM] = bent[_FORM + 1] = bent[_FORM + 2] = value
        if not (size_of_form < np.inf and bent[_DOUBT] < np.inf):
            return False
        sign = -1.0 if code >> KIND > 1 and place & 3 == middle else 1.0
        _principal(bent, exponent, sign, out, query)
        return True

    @inlined
    def _bent_special(
        k: int, query: int, patches: Patches, tables: Tables, points: Points, rounding: Array,
        out: Array, room: Room, mine: Array,
    ) -> bool:  # fmt: skip
        """See `basis.eigen_curvatures`; the third coordinate has the unit of the second.

        Of the points' coefficients those of the first two eigenfunctions span the first two axes,
        so that they have no third coordinate, whose power of an eigenvalue is another.
        """
        code, place, found, rows = room.codes[k], room.places[k], room.found, room.rows
        errors, bent, modes, wide = mine[0, 0], mine[1, 0], points.modes, points.high.shape[1]
        kind, level, n = code >> KIND, (place >> 2) - 1, tables.kinds[code >> KIND, ROWS]
        if tables.kinds[kind, MODES] < 0 or tables.kinds[kind, SIZE] < 3 or level < 0:
            return False
        for p in range(tables.kinds[kind, PAIRS]):
            if tables.pairs[kind, p] < 2:
                return False
        block, known = _block(code, tables, wide)
        low, high = level % STEP, STEP + level // STEP
        ratio = tables.ratios[kind, FIRST, low, 1] * tables.ratios[kind, FIRST, high, 1]
        third = tables.ratios[kind, SECOND, low, 2] * tables.ratios[kind, SECOND, high, 2]
        if not (abs(ratio) > _LEAST_SECOND and abs(third) > _LEAST_THIRD and modes[known] > 0):
            return False
        power = -_exponent(modes[known])
        factor = scale_by_two(1.0, power)
        noise = _TURNED * NOISE * modes[known + 2] * factor
        # axes along both coefficients
        c0, c1, c2 = modes[block + wide], modes[block + wide + 1], modes[block + wide + 2]
        c0, c1, c2 = c0 * factor, c1 * factor, c2 * factor
        first = sqrt(c0 * c0 + c1 * c1 + c2 * c2)
        at = block + 2 * wide
        x0, x1, x2 = modes[at] * factor, modes[at + 1] * factor, modes[at + 2] * factor
        if not first > 2 * noise * tables.sizes[kind, 0]:
            return False
        a0, a1, a2 = c0 / first, c1 / first, c2 / first
        slant = x0 * a0 + x1 * a1 + x2 * a2
        b0, b1, b2 = x0 - slant * a0, x1 - slant * a1, x2 - slant * a2
        more = b0 * a0 + b1 * a1 + b2 * a2  # twice, for the sake of rounding
        b0, b1, b2 = b0 - more * a0, b1 - more * a1, b2 - more * a2
        second = sqrt(b0 * b0 + b1 * b1 + b2 * b2)
        if not second > 4 * noise * tables.sizes[kind, 1]:
            return False
        b0, b1, b2 = b0 / second, b1 / second, b2 / second
        n0, n1, n2 = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0

        eigenfunctions(2, kind, place & 3, room.s[k], room.t[k], tables, rows)
        for j in range(1, 6):
            bent[j] = rows[j, 0]
        powered(kind, SECOND, level, 6, tables, rows)
        for j in range(1, 6):
            errors[LANES * j] = rows[j, 1]
            rows[j, 0] = rows[j, 1] = 0.0
        _sum6(rows, n, modes, block + wide, wide, found)
        at = block + 3 * wide
        height = (modes[at] * n0 + modes[at + 1] * n1 + modes[at + 2] * n2) * factor
        certain = 1.0 if abs(height) > noise * tables.sizes[kind, 2] else _CERTAIN
        tall = noise * tables.sizes[kind, 1]
        for j in range(1, 6):
            total = 0.0
            for m in range(2, n):
                total += abs(rows[j, m]) * tables.sizes[kind, m]
            at, one, other = LANES * j, bent[j], errors[LANES * j]
            x0, x1, x2 = found[at] * factor, found[at + 1] * factor, found[at + 2] * factor
            found[at] = x0 * a0 + x1 * a1 + x2 * a2 + slant * other
            found[at] = found[at] * ratio + first * one
            found[at + 1] = x0 * b0 + x1 * b1 + x2 * b2 + second * other
            found[at + 2] = x0 * n0 + x1 * n1 + x2 * n2
            errors[at + 2] = total * noise
            errors[at + 1] = errors[at + 2] + abs(other) * tall
            errors[at] = abs(ratio) * errors[at + 1] + abs(one) * noise * tables.sizes[kind, 0]
        _form(found, errors, ratio, bent)
        bent[_FORM] *= abs(ratio)
        bent[_FORM + 2] /= abs(ratio)
        size_of_form = _largest(bent)
        if not (certain * size_of_form > bent[_DOUBT] and size_of_form < np.inf):
            return False
        # in terms of the points; normals are along d/ds x d/dt, whatever the signs of powers
        x0, x1, x2 = bent[_AXIS], bent[_AXIS + 1], bent[_AXIS + 2]
        bent[_AXIS] = x0 * a0 + x1 * b0 + x2 * n0
        bent[_AXIS + 1] = x0 * a1 + x1 * b1 + x2 * n1
        bent[_AXIS + 2] = x0 * a2 + x1 * b2 + x2 * n2
        x0, x1, x2 = bent[_NORMAL], bent[_NORMAL + 1], bent[_NORMAL + 2]
        sign = copysign(1.0, ratio)
        x0, x1, x2 = sign * x0, sign * x1, sign * x2
        bent[_NORMAL] = x0 * a0 + x1 * b0 + x2 * n0
        bent[_NORMAL + 1] = x0 * a1 + x1 * b1 + x2 * n1
        bent[_NORMAL + 2] = x0 * a2 + x1 * b2 + x2 * n2
        mantissa = tables.mantissas[kind, low] * tables.mantissas[kind, high]
        bent[_FORM] /= mantissa
        bent[_FORM + 1] /= mantissa
        bent[_FORM + 2] /= mantissa
        power -= tables.exponents[kind, low] + tables.exponents[kind, high]
        _principal(bent, power, -1.0 if place & 3 == middle else 1.0, out, query)
        return True

    @lean
    def curved(
        face: Array, u: Array, v: Array, words: Array, rounding: Array, mine: Array, out: Array,
        start: int, rest: Array, room: Room,
    ) -> int:  # fmt: skip
        """Curvatures k1, k2, mean and Gaussian, and directions d1 and d2, into out (Q, 10).

        rounding (extras, 3) bounds what rounding did to control points beyond the cage, times
        1 / NOISE; mine (3, 1, 6 `LANES`) is room. The others, and what is returned, are as for
        `evaluator`.
        """
        patches, tables, points = patches_of(words), tables_of(words), points_of(words)
        left = 0
        for begin in range(0, len(face), QUERIES):
            count = min(QUERIES, len(face) - begin)
            if not _locate(face, u, v, begin, count, patches, room):
                return -1
            for k in range(count):
                _ask(k, count, room, patches, tables, points)
                query, code = start + begin + k, room.codes[k]
                if code < 0:
                    for c in range(10):
                        out[query, c] = np.nan
                    continue
                given = k, query, patches, tables, points, rounding, out, room, mine
                done, special = False, code >> KIND > 1
                known = special and tables.kinds[code >> KIND, MODES] >= 0
                if not special or 0 < room.places[k] >> 2 <= kept(code, tables):
                    done = _bent_spline(*given)
                if known and not done:
                    done = _bent_special(*given)
                if not done:
                    rest[left] = query
                    left += 1
        return left

    return tangents, curved
