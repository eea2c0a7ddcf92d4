"""What is particular to surfaces of triangles: quartic box splines, and special corners.

`quads` has functions and numbers of the same names; see ``evaluation.evaluator``. What the turn of
a packed patch is there, is an orientation here, as in ``scheme/lattice.py``: 0 to 2 are turns, and
3 more if the cell of the patch is turned by half a turn against its limit face, as the middle child
of a triangle is against it.
"""

from __future__ import annotations

import sys
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels.curvature import shapers
from limitsurf._kernels.doubt import NOISE
from limitsurf._kernels.evaluation import (
    LANES,
    NEVER,
    ROWS,
    TINY,
    TURN,
    TURNS,
    Patches,
    Tables,
    crossed,
    evaluator,
    halvings,
    scale_by_two,
)
from limitsurf._kernels.grids import gridder
from limitsurf._kernels.higher import deriver
from limitsurf._kernels.jit import gathered, inlined, of_bits, polynomials
from limitsurf._kernels.rows import writers

Array = NDArray[Any]

POINTS, OWN = 12, 4  # control points of a regular patch, and which of them all are relative to
MONOMIALS = 15  # of a piece
DEGREES = (4, 3, 2, 1, 0)  # in s beside each power of t
# places of the control points of a patch, and of those of the three pieces around a special corner:
# the children at corners 1 and 2, and the middle one, which is turned by half a turn
_TEMPLATE = [(i, j) for j, row in enumerate(("123", "0123", "012", "01")) for i in map(int, row)]
_PIECES = [
    *((1 + i, j) for i, j in _TEMPLATE),
    *((i, 1 + j) for i, j in _TEMPLATE),
    *((3 - i, 3 - j) for i, j in _TEMPLATE),
]
_PLACES = sorted(set(_PIECES))
MIDDLE = 2  # the piece that is turned by half a turn
REFINED = len(_PLACES)  # points of these pieces
PIECES = np.array([_PLACES.index(place) for place in _PIECES], dtype=np.int32)
BLOCK, AROUND = 0, PIECES[:0]  # no patches share rings

_SLACK = 4 * 2.0**-52  # by how much u + v may be above 1
_UNIT = 1 / 12  # of the weights below, which are polynomials over integers
# gradients in (u, v) of s and t by orientation, and whether s, t and s + t grow towards corner 0 of
# the limit face, as bits by orientation
_TURNS = [((1, 0), (0, 1)), ((0, 1), (-1, -1)), ((-1, -1), (1, 0))]
_GRADIENTS = np.array([*_TURNS, *(((-a, -b), (-c, -d)) for (a, b), (c, d) in _TURNS)])
_DOWN_S, _DOWN_T, _DOWN_BOTH = (
    sum(1 << k for k, x in enumerate(down) if x)
    for down in (*(_GRADIENTS.sum(axis=2) < 0).T, _GRADIENTS.sum(axis=(1, 2)) < 0)
)
# derivatives in (u, v) from those in (s, t), both in the order of `LimitSurface.jet`
TURNED = np.zeros((6, 6, 6))
TURNED[:, 0, 0] = 1
TURNED[:, 1:3, 1:3] = _GRADIENTS.transpose(0, 2, 1)
for _k, (_i, _j) in enumerate(((0, 0), (0, 1), (1, 1)), start=3):
    _first, _second = _GRADIENTS[:, :, _i].T, _GRADIENTS[:, :, _j].T
    TURNED[:, _k, 3] = _first[0] * _second[0]
    TURNED[:, _k, 4] = _first[0] * _second[1] + _first[1] * _second[0]
    TURNED[:, _k, 5] = _first[1] * _second[1]

_gathered1, _gathered3, _gathered6 = (gathered(POINTS, OWN, count) for count in (1, 3, 6))
_gathered_sized = gathered(POINTS, OWN, 3, sized=True)
_gathered_bent = gathered(POINTS, OWN, 6, sized=True)
_polynomials0, _polynomials1, _polynomials2 = (polynomials(order, DEGREES) for order in range(3))


@inlined
def located(face: int, s: float, t: float, patches: Patches) -> tuple[int, int, float, float, bool]:
    """Packed patch (-1 if there is none) of a query, its depth, parameters; whether in range.

    Parameters are those of its cell; in what is returned the turn is an orientation.
    """
    if face < 0 or face >= patches.n_faces:
        return -1, 0, s, t, False
    beyond = max(s, t) - 1 + min(s, t)
    if not (s >= 0 and t >= 0 and beyond <= 0):
        if not (isfinite(s) and isfinite(t)):
            outside = (isfinite(s) and s < 0) or (isfinite(t) and t < 0)
            return -1, 0, s, t, not outside
        if s < 0 or t < 0 or beyond > _SLACK:
            return -1, 0, s, t, False
        if s > t:
            s = 1 - t
        else:
            t = 1 - s
    code, depth, flipped = patches.info[face], 0, False
    while code <= -2:
        # on lines between children the one nearer corner 0 of the limit face is taken
        first = s > 0.5 or (flipped and s == 0.5)
        second = t > 0.5 or (flipped and t == 0.5)
        third = max(s, t) - 0.5 + min(s, t)  # its sign is exact
        lowest = third < 0 or (not flipped and third == 0)
        child = patches.n_faces + 4 * (-2 - code)
        s, t = 2 * s, 2 * t
        if first:
            s -= 1
            child += 1
        elif second:
            t -= 1
            child += 2
        elif not lowest:
            s, t = 1 - s, 1 - t
            flipped = not flipped
            child += 3
        code = patches.info[child]
        depth += 1
    if flipped and code >= 0:
        code += 3 << TURN
    return code, depth, s, t, True


@inlined
def turned(s: float, t: float, turn: int) -> tuple[float, float]:
    """Parameters in a patch of some orientation from those in its cell."""
    large = max(s, t)
    rest = 1 - large
    rest = max((rest - min(s, t)) + ((1 - rest) - large), 0.0)  # rounded once
    if turn >= 3:
        turn -= 3
    return (s if turn == 0 else t if turn == 1 else rest), (
        t if turn == 0 else rest if turn == 1 else s
    )


@inlined
def place_around(s: float, t: float, turn: int) -> tuple[int, int, float, float]:
    """Level (-1 at the corner), piece and parameters in it of (s, t) around a special corner."""
    # lines between pieces belong to the side nearer corner 0 of the limit face
    total = s + t
    lost = min(s, t) - (total - max(s, t))  # where this tells the side, it does
    level = halvings(total, lost > 0 or (lost == 0 and _DOWN_BOTH >> turn & 1 == 1))
    if level >= NEVER:
        return -1, 0, 0.0, 0.0
    # (no branches: where a random query lies cannot be foreseen)
    S, T = scale_by_two(s, level + 1), scale_by_two(t, level + 1)
    first = S > 1 or (S == 1 and _DOWN_S >> turn & 1 == 1)
    second = not first and (T > 1 or (T == 1 and _DOWN_T >> turn & 1 == 1))
    middle = not (first or second)
    S, T = (1 - S if middle else S - first), (1 - T if middle else T - second)
    return level, 2 * middle + second, S, T


@inlined
def spline_weights(s: float, t: float, order: int, weights: Array) -> None:
    """Weights of the control points of a quartic box spline, times 12.

    Derivatives up to an order in rows of 12, in the order of `LimitSurface.jet`. With a, b and c
    the barycentric coordinates, a third of the control points are the corners, a third opposite to
    them across an edge, and the others follow each corner along the two edges there.
    """
    a, b, c = 1 - s - t, s, t
    # by corner: its distance from the opposite edge and the product of the others' coordinates
    x, y, z = b + c, c + a, a + b
    p, q, r = b * c, c * a, a * b
    xx, yy, zz = x * x, y * y, z * z
    aa, bb, cc = a * a, b * b, c * c
    f, g, h = 6 * a + xx, 6 * b + yy, 6 * c + zz
    weights[0] = aa * a * (a + 2 * b)
    weights[3] = aa * a * (a + 2 * c)
    weights[2] = bb * b * (b + 2 * a)
    weights[6] = bb * b * (b + 2 * c)
    weights[10] = cc * c * (c + 2 * a)
    weights[11] = cc * c * (c + 2 * b)
    weights[9] = xx * x * (x + 2 * a) + 2 * p * (xx + p)
    weights[7] = yy * y * (y + 2 * b) + 2 * q * (yy + q)
    weights[1] = zz * z * (z + 2 * c) + 2 * r * (zz + r)
    u, v, w = a * (1 + x), b * (1 + y), c * (1 + z)
    weights[4] = 6 * u * u + xx * x * (x + 8 * a) + 2 * p * (f + p)
    weights[5] = 6 * v * v + yy * y * (y + 8 * b) + 2 * q * (g + q)
    weights[8] = 6 * w * w + zz * z * (z + 8 * c) + 2 * r * (h + r)
    if order > 0:
        weights[12] = -2 * aa * (a + 3 * b)
        weights[24] = -2 * aa * (2 * a + 3 * b)
        weights[15] = -2 * aa * (2 * a + 3 * c)
        weights[27] = -2 * aa * (a + 3 * c)
        weights[14] = 2 * bb * (b + 3 * a)
        weights[26] = -2 * bb * b
        weights[18] = 2 * bb * (2 * b + 3 * c)
        weights[30] = 2 * bb * b
        weights[22] = -2 * cc * c
        weights[34] = 2 * cc * (c + 3 * a)
        weights[23] = 2 * cc * c
        weights[35] = 2 * cc * (2 * c + 3 * b)
        # derivatives by x and by p, and so on
        k, m, n = 2 * (xx + 2 * p), 2 * (yy + 2 * q), 2 * (zz + 2 * r)
        u, v, w = (
            2 * x * (x * (1 + 2 * a) + 2 * p),
            2 * y * (y * (1 + 2 * b) + 2 * q),
            2 * z * (z * (1 + 2 * c) + 2 * r),
        )
        weights[21], weights[33] = u + k * c, u + k * b
        weights[19], weights[31] = -v - m * c, m * (a - c)
        weights[13], weights[25] = n * (a - b), -w - n * b
        k, m, n = 2 * (f + 2 * p), 2 * (g + 2 * q), 2 * (h + 2 * r)
        u, v, w = (
            4 * (x * f + p * (2 + a)),
            4 * (y * g + q * (2 + b)),
            4 * (z * h + r * (2 + c)),
        )
        weights[16], weights[28] = k * c - u, k * b - u
        weights[17], weights[29] = v - m * c, m * (a - c)
        weights[20], weights[32] = n * (a - b), w - n * b
    if order > 1:
        weights[36], weights[48], weights[60] = 12 * r, 6 * a * (a + 2 * b), 12 * a * z
        weights[39], weights[51], weights[63] = 12 * a * y, 6 * a * (a + 2 * c), 12 * q
        weights[38], weights[50], weights[62] = 12 * r, -6 * bb, 0.0
        weights[42], weights[54], weights[66] = 12 * b * x, 6 * bb, 0.0
        weights[46], weights[58], weights[70] = 0.0, -6 * cc, 12 * q
        weights[47], weights[59], weights[71] = 0.0, 6 * cc, 12 * c * x
        # second derivatives by x, those by p are 4; then derivatives by p
        u, v, w = 12 * x * a + 4 * p, 12 * y * b + 4 * q, 12 * z * c + 4 * r
        k, m, n = 2 * (xx + 2 * p), 2 * (yy + 2 * q), 2 * (zz + 2 * r)
        weights[45] = u + 8 * x * c + 4 * cc
        weights[57] = u + 4 * x * x + 4 * p + k
        weights[69] = u + 8 * x * b + 4 * bb
        weights[43] = v + 8 * y * c + 4 * cc
        weights[55] = 4 * y * (c - a) - 4 * c * (a - c) - m
        weights[67] = 4 * (a - c) * (a - c) - 2 * m
        weights[37] = 4 * (a - b) * (a - b) - 2 * n
        weights[49] = 4 * z * (b - a) - 4 * b * (a - b) - n
        weights[61] = w + 8 * z * b + 4 * bb
        u, v, w = (
            24 * (x - a) - 12 * xx + 4 * p,
            24 * (y - b) - 12 * yy + 4 * q,
            24 * (z - c) - 12 * zz + 4 * r,
        )
        k, m, n = 2 * (f + 2 * p), 2 * (g + 2 * q), 2 * (h + 2 * r)
        weights[40] = u - 8 * (2 + a) * c + 4 * cc
        weights[52] = u - 4 * (2 + a) * x + 4 * p + k
        weights[64] = u - 8 * (2 + a) * b + 4 * bb
        weights[41] = v - 8 * (2 + b) * c + 4 * cc
        weights[53] = 4 * (2 + b) * (a - c) - 4 * c * (a - c) - m
        weights[65] = 4 * (a - c) * (a - c) - 2 * m
        weights[44] = 4 * (a - b) * (a - b) - 2 * n
        weights[56] = 4 * (2 + c) * (a - b) - 4 * b * (a - b) - n
        weights[68] = w - 8 * (2 + c) * b + 4 * bb


halved_weights = spline_weights  # (there are no dual schemes of triangles)


@inlined
def patch_weights(
    code: int, s: float, t: float, order: int, patches: Patches, weights: Array
) -> None:
    """Weights of a patch that is a spline, as all are that have no special corner."""
    spline_weights(s, t, order, weights)


@inlined
def piece_of(code: int, s: float, t: float, patches: Patches) -> tuple[int, float, float, int, int]:
    """The polynomial that a spline is at a place, always the same, as in `quads`."""
    return 0, s, t, 0, 0


@inlined
def spline(
    order: int, sized: bool, points: Array, ids: Array, at: int, base: int, channel: int,
    weights: Array, found: Array,
) -> None:  # fmt: skip
    """Derivatives up to an order of a regular patch, relative to its control point 4."""
    if sized:
        _gathered_sized(points, ids, at, base, channel, weights, _UNIT, found)
    elif order == 0:
        _gathered1(points, ids, at, base, channel, weights, _UNIT, found)
    elif order == 1:
        _gathered3(points, ids, at, base, channel, weights, _UNIT, found)
    else:
        _gathered6(points, ids, at, base, channel, weights, _UNIT, found)


@inlined
def bent_spline(
    points: Array, ids: Array, at: int, base: int, weights: Array, found: Array
) -> None:
    """As `spline` of order 2, of the first channels, sized."""
    _gathered_bent(points, ids, at, base, 0, weights, _UNIT, found)


@inlined
def sizes_of_weights(weights: Array, order: int, sums: Array) -> None:
    """Sums of the sizes of the weights of a patch, at most, for derivatives up to an order."""
    # these are means of differences of two control points, and of differences of such
    sums[1] = sums[2] = 2.0
    if order > 1:
        sums[3] = sums[4] = sums[5] = 4.0


@inlined
def spline_normal(weights: Array, found: Array, error: float, out: Array, query: int) -> bool:
    """As `crossed` of a patch, from its weights, sums of order 1 and errors of its points."""
    reach = max(found[3 * LANES], found[3 * LANES + 1], found[3 * LANES + 2]) + error
    # a derivative is a mean of differences of two control points
    reach = 2 * (reach * NOISE + TINY)
    return crossed(found, reach, reach, out, query)


@inlined
def eigenfunctions(
    order: int, kind: int, piece: int, S: float, T: float, tables: Tables, rows: Array
) -> None:
    """Derivatives up to an order of the eigenfunctions on a piece."""
    at, n = (kind * 3 + piece) * MONOMIALS * rows.shape[1], tables.kinds[kind, ROWS]
    if order == 0:
        _polynomials0(tables.pieces, at, n, S, T, rows)
    elif order == 1:
        _polynomials1(tables.pieces, at, n, S, T, rows)
    else:
        _polynomials2(tables.pieces, at, n, S, T, rows)


@inlined
def _oriented(turn: int, piece: int) -> int:
    """Orientation of a piece around a special corner: the middle one is turned by half a turn."""
    if piece == 2:
        return turn - 3 if turn >= 3 else turn + 3
    return turn


@inlined
def write(
    order: int, found: Array, which: Array, turn: int, piece: int, mantissa: float, exponent: int,
    step: int, out: Array, query: int, channel: int,
) -> None:  # fmt: skip
    """Write derivatives up to an order in patch parameters as such in those of the limit face.

    Those of order o > 0 are multiplied by mantissa 2^(exponent + o step).
    """
    turn = _oriented(turn, piece)
    first, second = exponent + step, exponent + 2 * step if order > 1 else 0
    slope = bend = 1.0
    deep = min(first, second) < -1000 or max(first, second) > 1000
    if not deep and order > 0:
        slope = mantissa * of_bits((first + 1023) << 52)
        bend = mantissa * of_bits((second + 1023) << 52)
    lanes = min(LANES, out.shape[2] - channel)
    for j in range(len(which)):
        term = which[j]
        if term == 0:
            for c in range(lanes):
                out[j, query, channel + c] = found[c]
        elif term < 3:
            x, y = TURNED[turn, term, 1], TURNED[turn, term, 2]
            for c in range(lanes):
                # (infinities that are not to be added stay away)
                total = x * found[LANES + c] if x != 0 else 0.0
                total += y * found[2 * LANES + c] if y != 0 else 0.0
                if deep:
                    total = scale_by_two(total * mantissa, first)
                else:
                    total *= slope
                out[j, query, channel + c] = total
        else:
            x, y, z = TURNED[turn, term, 3], TURNED[turn, term, 4], TURNED[turn, term, 5]
            for c in range(lanes):
                total = x * found[3 * LANES + c] if x != 0 else 0.0
                total += y * found[4 * LANES + c] if y != 0 else 0.0
                total += z * found[5 * LANES + c] if z != 0 else 0.0
                if deep:
                    total = scale_by_two(total * mantissa, second)
                else:
                    total *= bend
                out[j, query, channel + c] = total


@inlined
def spline_rows(
    code: int, depth: int, s: float, t: float, order: int, terms: Array, patches: Patches,
    along: Array, weights: Array,
) -> None:  # fmt: skip
    """Weights (terms, 1, ...) of the control points of a spline in derivatives up to an order.

    `along` is room.
    """
    turn = code >> TURN & TURNS
    spline_weights(s, t, order, along)
    for o in range(len(terms)):
        term = terms[o]
        own = (term > 0) + (term > 2)
        factor = scale_by_two(_UNIT, own * depth)
        for k in range(POINTS):
            total = 0.0
            for j in range(own + 1):
                here = own * (own + 1) // 2 + j
                total += TURNED[turn, term, here] * along[here * POINTS + k]
            weights[o, 0, k] = total * factor


@inlined
def chosen(rows: Array, n: int, turn: int, piece: int, term: int, found: Array) -> float:
    """One derivative in the limit face, of some in a patch, up to a sign, which is 1."""
    turn = _oriented(turn, piece)
    own = (term > 0) + (term > 2)
    first = own * (own + 1) // 2
    for k in range(n):
        total = 0.0
        for j in range(first, first + own + 1):
            factor = TURNED[turn, term, j]
            if factor != 0:
                total += factor * rows[j, k]
        found[k] = total
    return 1.0


_shape = sys.modules[__name__]
scattered, gridded = evaluator(_shape), gridder(_shape)
lengths, fill = writers(_shape)
tangents, curved = shapers(_shape)
higher = deriver(_shape)
