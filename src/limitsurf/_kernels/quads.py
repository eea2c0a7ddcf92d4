"""What is particular to surfaces of quads: bicubic patches, and what lies around special corners.

`triangles` has functions and numbers of the same names; see ``evaluation.evaluator``.
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
    KIND,
    LANES,
    NEVER,
    ROW,
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
from limitsurf._kernels.jit import bicubic, inlined, of_bits, polynomials
from limitsurf._kernels.rows import writers

Array = NDArray[Any]

POINTS, OWN = 16, 5  # control points of a regular patch, and which of them all are relative to
MONOMIALS = 16  # of a piece
DEGREES = (3, 3, 3, 3)  # in s beside each power of t
MIDDLE = -1  # the piece that is turned by half a turn: none
REFINED = 25  # points of the pieces around a special corner, 5 x 5
_PIECES = [(j + y, i + x) for x, y in ((1, 0), (1, 1), (0, 1)) for j in range(4) for i in range(4)]
# Around a vertex at which patches share a ring each face has some of the 5 x 5 points: the vertex,
# those on the side along u, and those inside, by j and i. Where all are, from the face before on:
BLOCK = 13  # points of a face
PLACES = np.array([
    [-1, 1, 4, 7, 10], [40, 13, 14, 15, 16], [30, 27, 17, 18, 19], [31, 28, 20, 21, 22],
    [32, 29, 23, 24, 25],
])  # fmt: skip
# the grids of the three pieces (right, diagonal, up) among refined points, and among those of faces
PIECES = np.array([5 * j + i for j, i in _PIECES], dtype=np.int32)
AROUND = np.array([PLACES[place] for place in _PIECES], dtype=np.int32)
# which derivative in patch parameters each one is, by turn mod 2; and its sign, by turn
TURNED = np.array([[0, 1, 2, 3, 4, 5], [0, 2, 1, 5, 4, 3]])
SIGN = np.array([
    [1.0, 1, 1, 1, 1, 1], [1, -1, 1, 1, -1, 1], [1, -1, -1, 1, 1, 1], [1, 1, -1, 1, -1, 1],
])  # fmt: skip

_bicubic0, _bicubic1, _bicubic2 = (bicubic(order) for order in range(3))
_bicubic_sized, _bicubic_bent = bicubic(1, sized=True), bicubic(2, sized=True)
_polynomials0, _polynomials1, _polynomials2 = (polynomials(order, DEGREES) for order in range(3))


@inlined
def located(face: int, s: float, t: float, patches: Patches) -> tuple[int, int, float, float, bool]:
    """Packed patch (-1 if there is none) of a query, its depth, parameters; whether in range."""
    if face < 0 or face >= patches.n_faces:
        return -1, 0, s, t, False
    if not (0 <= s <= 1 and 0 <= t <= 1):
        outside = (isfinite(s) and not 0 <= s <= 1) or (isfinite(t) and not 0 <= t <= 1)
        return -1, 0, s, t, not outside
    code, depth = patches.info[face], 0
    while code <= -2:
        s, t = 2 * s, 2 * t
        child = patches.n_faces + 4 * (-2 - code)
        if s > 1:
            s -= 1
            child += 1
        if t > 1:
            t -= 1
            child += 2
        code = patches.info[child]
        depth += 1
    return code, depth, s, t, True


@inlined
def turned(s: float, t: float, turn: int) -> tuple[float, float]:
    """Parameters in a patch that is turned against its limit face."""
    x, y = (t, s) if turn & 1 else (s, t)
    return 1 - x if turn >= 2 else x, 1 - y if turn == 1 or turn == 2 else y


@inlined
def place_around(s: float, t: float, turn: int) -> tuple[int, int, float, float]:
    """Level (-1 at the corner), piece and parameters in it of (s, t) around a special corner."""
    # lines between pieces belong to the side nearer corner 0 of the limit face
    ks = halvings(s, turn >= 2)
    kt = halvings(t, turn == 1 or turn == 2)
    level = min(ks, kt)
    if level >= NEVER:
        return -1, 0, 0.0, 0.0
    # (no branches: where a random query lies cannot be foreseen)
    S = scale_by_two(s, level + 1) - (ks == level)
    T = scale_by_two(t, level + 1) - (kt == level)
    return level, 1 + (ks > level) - (kt > level), S, T


@inlined
def cubic_weights(t: float, order: int, at: int, weights: Array) -> None:
    """Weights of the four control points of a cubic piece, derivatives 0 to `order` in rows."""
    s = 1 - t
    # sums of products of non-negative numbers: no cancellation
    weights[at] = s * s * s / 6
    weights[at + 1] = (1 + 3 * s * (1 + s * t)) / 6
    weights[at + 2] = (1 + 3 * t * (1 + s * t)) / 6
    weights[at + 3] = t * t * t / 6
    if order > 0:
        weights[at + 4] = -s * s / 2
        weights[at + 5] = -t * (1 + 3 * s) / 2
        weights[at + 6] = s * (1 + 3 * t) / 2
        weights[at + 7] = t * t / 2
    if order > 1:
        weights[at + 8] = s
        weights[at + 9] = 3 * t - 2
        weights[at + 10] = 1 - 3 * t
        weights[at + 11] = t


@inlined
def strip_weights(
    t: float, order: int, up: bool, pieces: Array, first: int, depth: int, at: int, weights: Array
) -> None:
    """Weights of four points across a semi-sharp crease, derivatives 0 to `order` in rows."""
    k = min(halvings(t, up), depth)
    level = min(k + 1, depth)
    T = scale_by_two(t, level)
    if k < depth:
        T -= 1
    for j in range(4):
        p = (first + k) * 16 + j
        a, b, c, d = pieces[p], pieces[p + 4], pieces[p + 8], pieces[p + 12]
        weights[at + j] = a + T * (b + T * (c + T * d))
        if order > 0:
            weights[at + 4 + j] = scale_by_two(b + T * (2 * c + T * (3 * d)), level)
        if order > 1:
            weights[at + 8 + j] = scale_by_two(2 * c + 6 * d * T, 2 * level)


@inlined
def spline_weights(s: float, t: float, order: int, weights: Array) -> None:
    """Weights of a regular patch, as `spline` takes them: along s, then along t."""
    cubic_weights(s, order, 0, weights)
    cubic_weights(t, order, 4 * order + 4, weights)


@inlined
def _quadratic_weights(t: float, order: int, at: int, weights: Array) -> None:
    """As `cubic_weights`, of a quadratic spline with a knot at 1/2 between four points."""
    # (no branches: where a random query lies cannot be foreseen)
    upper = t > 0.5
    x, begin, step, sign = t, at, 1, 1.0
    if upper:
        x, begin, step, sign = 1 - t, at + 3, -1, -1.0
    near, far = 0.5 - x, 0.5 + x
    weights[begin] = near * near / 2
    weights[begin + step] = 0.5 + near * far
    weights[begin + 2 * step] = far * far / 2
    weights[begin + 3 * step] = 0.0
    if order > 0:
        begin += 4
        weights[begin] = -sign * near
        weights[begin + step] = -sign * 2 * x
        weights[begin + 2 * step] = sign * far
        weights[begin + 3 * step] = 0.0
    if order > 1:
        begin += 4
        weights[begin] = 1.0
        weights[begin + step] = -2.0
        weights[begin + 2 * step] = 1.0
        weights[begin + 3 * step] = 0.0


@inlined
def halved_weights(s: float, t: float, order: int, weights: Array) -> None:
    """As `spline_weights`, of a quad amid others of a dual scheme."""
    _quadratic_weights(s, order, 0, weights)
    _quadratic_weights(t, order, 4 * order + 4, weights)


@inlined
def patch_weights(
    code: int, s: float, t: float, order: int, patches: Patches, weights: Array
) -> None:
    """Weights of a patch that has no special corner, strips included."""
    if patches.halves:
        halved_weights(s, t, order, weights)
    elif code >> KIND == 1:
        cubic_weights(s, order, 0, weights)
        row, turn = code & ROW, code >> TURN & TURNS
        row -= len(patches.ids) // 16 - len(patches.strips)
        first, depth = patches.strips[row, 0], patches.strips[row, 1]
        up = turn == 1 or turn == 2
        pieces = patches.strip_pieces
        strip_weights(t, order, up, pieces, first, depth, 4 * order + 4, weights)
    else:
        spline_weights(s, t, order, weights)


@inlined
def piece_of(code: int, s: float, t: float, patches: Patches) -> tuple[int, float, float, int, int]:
    """The polynomial that a spline is at a place: its number, parameters in it, halvings of both.

    The first is that of regular patches, then come those of strips; of a dual scheme there are
    four, the upper halves first, along s, then along t.
    """
    if patches.halves:
        right, above = s > 0.5, t > 0.5
        return 3 - right - 2 * above, 2 * s - right, 2 * t - above, 1, 1
    if code >> KIND != 1:
        return 0, s, t, 0, 0
    row, turn = (code & ROW) - len(patches.ids) // 16 + len(patches.strips), code >> TURN & TURNS
    first, depth = patches.strips[row, 0], patches.strips[row, 1]
    k = min(halvings(t, turn == 1 or turn == 2), depth)
    level = min(k + 1, depth)
    return 1 + first + k, s, scale_by_two(t, level) - (k < depth), 0, level


@inlined
def spline(
    order: int, sized: bool, points: Array, ids: Array, at: int, base: int, channel: int,
    weights: Array, found: Array,
) -> None:  # fmt: skip
    """Derivatives up to an order of a bicubic patch, relative to its control point 5."""
    if sized:
        _bicubic_sized(points, ids, at, base, channel, weights, found)
    elif order == 0:
        _bicubic0(points, ids, at, base, channel, weights, found)
    elif order == 1:
        _bicubic1(points, ids, at, base, channel, weights, found)
    else:
        _bicubic2(points, ids, at, base, channel, weights, found)


@inlined
def bent_spline(
    points: Array, ids: Array, at: int, base: int, weights: Array, found: Array
) -> None:
    """As `spline` of order 2, of the first channels, sized."""
    _bicubic_bent(points, ids, at, base, 0, weights, found)


@inlined
def sizes_of_weights(weights: Array, order: int, sums: Array) -> None:
    """Sums of the sizes of the weights of a patch, for derivatives of order 1 up to an order."""
    for m in range(1, order + 1):
        for n in range(m + 1):
            i, j = 4 * (m - n), 4 * (order + 1 + n)
            along = abs(weights[i]) + abs(weights[i + 1])
            along += abs(weights[i + 2]) + abs(weights[i + 3])
            across = abs(weights[j]) + abs(weights[j + 1])
            across += abs(weights[j + 2]) + abs(weights[j + 3])
            sums[m * (m + 1) // 2 + n] = along * across


@inlined
def spline_normal(weights: Array, found: Array, error: float, out: Array, query: int) -> bool:
    """As `crossed` of a patch, from its weights, sums of order 1 and errors of its points."""
    reach = max(found[3 * LANES], found[3 * LANES + 1], found[3 * LANES + 2]) + error
    reach = reach * NOISE + TINY
    values = slopes = rises = steep = 0.0
    for j in range(4):
        values += abs(weights[j])
        slopes += abs(weights[4 + j])
        rises += abs(weights[8 + j])
        steep += abs(weights[12 + j])
    return crossed(found, reach * slopes * rises, reach * values * steep, out, query)


@inlined
def eigenfunctions(
    order: int, kind: int, piece: int, S: float, T: float, tables: Tables, rows: Array
) -> None:
    """Derivatives up to an order of the eigenfunctions on a piece."""
    at, n = (kind * 3 + piece) * 16 * rows.shape[1], tables.kinds[kind, ROWS]
    if order == 0:
        _polynomials0(tables.pieces, at, n, S, T, rows)
    elif order == 1:
        _polynomials1(tables.pieces, at, n, S, T, rows)
    else:
        _polynomials2(tables.pieces, at, n, S, T, rows)


@inlined
def write(
    order: int, found: Array, which: Array, turn: int, piece: int, mantissa: float, exponent: int,
    step: int, out: Array, query: int, channel: int,
) -> None:  # fmt: skip
    """Write derivatives up to an order in patch parameters as such in those of the limit face.

    Those of order o > 0 are multiplied by mantissa 2^(exponent + o step).
    """
    first, second = exponent + step, exponent + 2 * step if order > 1 else 0
    slope = bend = 1.0
    deep = min(first, second) < -1000 or max(first, second) > 1000
    if not deep and order > 0:
        slope = mantissa * of_bits((first + 1023) << 52)
        bend = mantissa * of_bits((second + 1023) << 52)
    lanes = min(LANES, out.shape[2] - channel)
    for j in range(len(which)):
        term = TURNED[turn & 1, which[j]]
        sign = SIGN[turn, which[j]]
        factor = (1.0 if term == 0 else slope if term < 3 else bend) * sign
        at = LANES * term
        if deep and term:
            e = first if term < 3 else second
            for c in range(lanes):
                x = found[at + c] * mantissa * sign
                out[j, query, channel + c] = scale_by_two(x, e)
        elif lanes == 3:
            out[j, query, channel] = found[at] * factor
            out[j, query, channel + 1] = found[at + 1] * factor
            out[j, query, channel + 2] = found[at + 2] * factor
        else:
            for c in range(lanes):
                out[j, query, channel + c] = found[at + c] * factor


@inlined
def spline_rows(
    code: int, depth: int, s: float, t: float, order: int, terms: Array, patches: Patches,
    along: Array, weights: Array,
) -> None:  # fmt: skip
    """Weights (terms, 1, ...) of the control points of a spline in derivatives up to an order.

    `along` is room.
    """
    turn = code >> TURN & TURNS
    patch_weights(code, s, t, 2, patches, along)
    for o in range(len(terms)):
        term = terms[o]
        own = (term > 0) + (term > 2)
        here, sign = TURNED[turn & 1, term], SIGN[turn, term]
        # derivatives (0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)
        j = 2 if here == 5 else 1 if here == 2 or here == 4 else 0
        first, second = 4 * (own - j), 4 * (3 + j)
        factor = scale_by_two(sign, own * depth)
        for y in range(4):
            across = along[second + y] * factor
            for x in range(4):
                weights[o, 0, 4 * y + x] = across * along[first + x]


@inlined
def chosen(rows: Array, n: int, turn: int, piece: int, term: int, found: Array) -> float:
    """One derivative in the limit face, of some in a patch, up to a sign, which is returned."""
    here = TURNED[turn & 1, term]
    for k in range(n):
        found[k] = rows[here, k]
    sign: float = SIGN[turn, term]
    return sign


_shape = sys.modules[__name__]
scattered, gridded = evaluator(_shape), gridder(_shape)
lengths, fill = writers(_shape)
tangents, curved = shapers(_shape)
higher = deriver(_shape)
