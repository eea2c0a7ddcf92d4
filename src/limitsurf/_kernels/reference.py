"""Reference kernels: vectorised NumPy that runs on float64 and on object arrays of exact numbers.

Shapes: Q queries, K control points of a patch, d channels of the points.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels.doubt import NOISE as NOISE
from limitsurf._kernels.doubt import TINY as TINY
from limitsurf._kernels.doubt import UNIT
from limitsurf.numbers import FAR, type_of

Array = NDArray[Any]


def spline_weights(t: Array, degree: int) -> Array:
    """Weights (Q, degree + 1) of the control points of a uniform B-spline piece, t in [0, 1].

    Sums of products of non-negative numbers (de Boor 1978, chapter X): no cancellation.
    """
    weights = (1 + 0 * t)[:, None]  # ones of their type
    for p in range(1, degree + 1):
        raised = np.zeros((len(t), p + 1), dtype=t.dtype)
        for k in range(p):
            raised[:, k] += (k + 1 - t) * weights[:, k]
            raised[:, k + 1] += (p - 1 - k + t) * weights[:, k]
        weights = raised / p
    return weights


def cubic_weights(t: Array, order: int) -> Array:
    """Weights (Q, 4) of the four control points of a cubic piece, `order`-th derivative in t."""
    if order > 3:
        return np.asarray(0 * spline_weights(t, 3))
    weights = spline_weights(t, 3 - order)
    for _ in range(order):
        # the derivative is the spline of one degree less whose control points are differences
        above = np.zeros((len(t), 1), dtype=t.dtype)
        weights = np.concatenate([above, weights], 1) - np.concatenate([weights, above], 1)
    return weights


def bicubic_weights(u: Array, v: Array, nu: tuple[int, int]) -> Array:
    """Weights (Q, 16) of a bicubic patch, control point ``4 j + i``: i along u, j along v."""
    along = cubic_weights(u, nu[0])
    across = cubic_weights(v, nu[1])
    return np.asarray((across[:, :, None] * along[:, None, :]).reshape(len(u), 16))


def power(high: Array, low: Array, n: Array) -> Array:
    """``(high + low) ** n`` for integers n >= 0, shape (n, k), to an ulp or two at any n.

    Callers keep ``|high| <= 1``; the first-order term in `low` removes the error n * eps that
    rounding the base would cause.
    """
    exponent = n[:, None].astype(float)
    with np.errstate(under="ignore"):
        relative = np.divide(low, high, out=np.zeros_like(low), where=high != 0)
        return np.asarray(high**exponent * (1 + exponent * relative))


def scaled_power(high: float, low: float, n: Array) -> tuple[Array, Array]:
    """``(high + low) ** n`` as mantissas (n,), below 1, and powers of two (n,), however small."""
    mantissa, exponent = np.frexp(high)
    if mantissa * mantissa < 0.5:
        mantissa, exponent = mantissa * 2, exponent - 1
    # |mantissa| in [0.7, 1.42): its 1100th power is within range
    low = np.ldexp(low, -exponent)
    power, more = np.frexp(mantissa**n * (1 + n * (low / mantissa)))
    return power, exponent * n + more


def split_corner(s: Array, t: Array, up_s: Array, up_t: Array) -> tuple[Array, Array, Array, Array]:
    """Find the regular piece around the corner (0, 0) that holds each (s, t), in any number type.

    After ``level`` halvings towards the corner, (s, t) lies in one of three pieces: 0 (s > 1/2),
    1 (both), 2 (t > 1/2). On the line between two pieces the one with larger s (or t) is taken
    where `up_s` (`up_t`) is true, else the other.

    Returns
    -------
    level, piece : (Q,) int64
        -1 and 0 at the corner itself.
    S, T : (Q,)
        Parameters within the piece, in [0, 1], exact.
    """
    number = type_of(s)
    ks, kt = number.halvings(s, up_s), number.halvings(t, up_t)
    level = np.minimum(ks, kt)
    high_s, high_t = ks == level, kt == level
    corner = level == FAR
    level = np.where(corner, 0, level)
    S, T = number.scaled(s, level + 1), number.scaled(t, level + 1)
    S = np.where(high_s & ~corner, S - 1, S)
    T = np.where(high_t & ~corner, T - 1, T)
    piece = np.where(corner, 0, np.where(high_s, np.where(high_t, 1, 0), 2))
    return np.where(corner, -1, level), piece, S, T


def split_flipped_corner(
    s: Array, t: Array, up_s: Array, up_t: Array, up: Array
) -> tuple[Array, Array, Array, Array]:
    """Find the regular piece of a triangle around the corner (0, 0) that holds each (s, t).

    As `split_corner`, but after ``level`` halvings s + t is above 1/2, and of the three pieces
    0 (s > 1/2), 1 (t > 1/2) and 2, amid the others, the last is turned by half a turn. On the line
    s + t = 1/2 between two levels the one farther from the corner is taken where `up` is true.
    """
    number = type_of(s)
    # where the sum is rounded to a power of two what rounding took from it tells the side
    total, error = two_sum(s, t)
    level = number.halvings(total, np.where(error == 0, up, error > 0))
    corner = level == FAR
    level = np.where(corner, 0, level)
    S, T = number.scaled(s, level + 1), number.scaled(t, level + 1)
    first, second = ((x > 1) | ((x == 1) & near) for x, near in ((S, up_s), (T, up_t)))
    # where rounding took both beyond 1/2, the first
    piece = np.where(corner | first, 0, np.where(second, 1, 2))
    S = np.choose(piece, [np.where(corner, S, S - 1), S, 1 - S])
    T = np.choose(piece, [T, T - 1, 1 - T])
    return np.where(corner, -1, level), piece, S, T


def coordinates(u: Array, v: Array, sides: Sequence[tuple[int, int, int]]) -> list[Array]:
    """The values (Q,) of `Lattice.sides`, of any number type; none is below 0 by rounding.

    Parameters on the edge of a triangle, where u + v is 1 but for their rounding, stay there; and
    1 - u - v is rounded once, so that what is on a line between pieces is so from every corner.
    """
    found = [u, v]
    for _, b, c in sides[2:]:
        if b and c:
            large, small = np.maximum(u, v), np.minimum(u, v)
            with np.errstate(invalid="ignore"):  # where one is infinite
                rest = 1 - large
                rest = (rest - small) + ((1 - rest) - large)
                found.append(np.maximum(rest, 0 * rest))  # (a zero of its type)
        else:
            found.append(1 - (u if b else v))
    return found


def barycentric_monomials(s: Array, t: Array, exponents: Sequence[tuple[int, int, int]]) -> Array:
    """``(1 - s - t)^i s^j t^k`` for each of the exponents (i, j, k), (Q, exponents)."""
    degree = max(map(sum, exponents))
    rest = 1 - np.maximum(s, t) - np.minimum(s, t)
    powers = np.stack([monomials(x, degree) for x in (rest, s, t)])
    i, j, k = np.transpose(exponents)
    return np.asarray(powers[0][:, i] * powers[1][:, j] * powers[2][:, k])


def split_strip(t: Array, depth: Array, up: Array) -> tuple[Array, Array, Array]:
    """Find the piece of a strip that holds each t: piece (Q,), parameter in it, its level.

    Piece k < depth is the upper half after k halvings towards t = 0; the last piece, of number
    `depth`, is what then is left. On a line between two the upper one is taken where `up`.
    """
    number = type_of(t)
    k = np.minimum(number.halvings(t, up), depth)
    level = np.minimum(k + 1, depth)
    T = number.scaled(t, level)
    return k, np.where(k < depth, T - 1, T), level


def monomials(x: Array, degree: int) -> Array:
    """Powers 0 to `degree` of x (Q,), (Q, degree + 1)."""
    powers = np.empty((len(x), degree + 1), dtype=x.dtype)
    powers[:, 0] = 1 + 0 * x  # ones of their type
    for k in range(degree):
        powers[:, k + 1] = powers[:, k] * x
    return powers


def scale_by_two(x: Array, n: Array) -> Array:
    """``x * 2 ** n`` for integers n (Q,), exact up to underflow and overflow (inf)."""
    return type_of(x).scaled(x, n)


def ring_coefficients(
    ring: Array, frequency: Array, parity: Array, left: Array, half_turn: Array
) -> Array:
    """Coefficients (P, modes, d) of ring points (P, ring, d) in a Fourier eigenbasis.

    Point 0 is the vertex, then come edge neighbour j at angle (j - 1/2) theta and, if there are
    any, face corner j at j theta, theta = 2 pi frequency / N. A mode has `left` weights
    (modes, 3 or 2) for vertex, edges and faces, times the cosine (parity 0) or sine. `half_turn`
    (2, N // 2 + 1) holds the cosine and sine of theta / 2 by frequency.
    """
    turn = (half_turn[0] + 1j * half_turn[1])[:, None]
    stride = left.shape[1] - 1
    sine = (parity == 1)[:, None]
    result = np.zeros((len(ring), len(left), ring.shape[2]))
    for k in range(1, 1 + stride):
        waves = np.fft.rfft(ring[:, k::stride], axis=1)
        waves = (waves * turn if k == 1 else waves)[:, frequency]
        result += np.where(sine, -waves.imag, waves.real) * left[:, k, None]
    return np.asarray(result + ring[:, :1] * left[:, :1])


def ring_weights(
    rows: Array, frequency: Array, parity: Array, left: Array, half_turn: Array, valence: int
) -> Array:
    """Weights (Q, ring) of ring points from weights (Q, modes) of their coefficients.

    The transpose of `ring_coefficients`.
    """
    stride = left.shape[1] - 1
    result = np.empty((len(rows), stride * valence + 1))
    result[:, 0] = rows @ left[:, 0]
    # conjugate amplitudes by frequency; a real transform counts those between 0 and N / 2 twice
    last = valence // 2
    factor = np.where(parity == 1, -1j, 1) * valence
    factor = np.where((frequency == 0) | (2 * frequency == valence), factor, factor / 2)
    turn = half_turn[0] - 1j * half_turn[1]
    for k, phase in ((1, turn), (2, np.ones(last + 1)))[:stride]:
        amplitude = np.zeros((last + 1, len(rows)), dtype=complex)
        np.add.at(amplitude, frequency, (rows * (left[:, k] * factor)).T)
        result[:, k::stride] = np.fft.irfft(amplitude.T * phase, n=valence, axis=1)
    return result


def differences(
    indptr: Array, columns: Array, values: Array, high: Array, low: Array, own: Array
) -> Array:
    """Sparse rows times points, each row formed relative to a point of its own, (rows, d).

    Points are unevaluated sums high + low; row r gives the sum of
    ``values * (point - point[own[r]])``: no digits are lost far from the origin, nor among points
    that are close to each other.
    """
    if not len(columns):
        return np.zeros((len(indptr) - 1, high.shape[1]))
    near = np.repeat(own, np.diff(indptr))
    terms = values[:, None] * (high[columns] - high[near] + (low[columns] - low[near]))
    return np.asarray(np.add.reduceat(terms, indptr[:-1], axis=0))


def errors(operators: Sequence[Any], high: Array, low: Array) -> Array:
    """Bounds (n, d) of what rounding did to points high + low, in units of `NOISE`.

    The first are given, and exact; the others come from those before them by sparse operators, as
    `differences` from the first point of each row.
    """
    found = np.zeros_like(high)
    done = len(high) - sum(operator.shape[0] for operator in operators)
    for operator in operators:
        starts, columns, counts = operator.indptr[:-1], operator.indices, np.diff(operator.indptr)
        near, sums = columns[starts], []
        for x in (high, low):
            terms = x.take(columns, axis=0)
            terms -= x.take(near, axis=0).repeat(counts, axis=0)
            sums.append(terms)
        far = np.abs(sums[0] + sums[1])
        if counts.max(initial=0) > 16:  # sums of more terms have larger errors
            far *= np.maximum(counts / 16, 1).repeat(counts)[:, None]
        far += found.take(columns, axis=0)
        far *= np.abs(operator.data)[:, None]
        found[done : done + len(counts)] = np.add.reduceat(far, starts)
        done += len(counts)
    return found


def balance(points: Array) -> int:
    """The power of two by which coordinates are multiplied so that none of their sums overflow.

    Nor do products with rounding errors underflow where all of them are tiny. 0 in general: within
    2^-900 and 2^1000 there is room for both.
    """
    size = np.abs(points).max(initial=0)
    exponent = int(np.frexp(size)[1])
    return 0 if size == 0 or -900 <= exponent <= 1000 else (960 if exponent > 0 else 0) - exponent


def two_sum(a: Array, b: Array) -> tuple[Array, Array]:
    """The rounded sum and its rounding error, exactly (Knuth 1969)."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


def largest(vectors: Array) -> Array:
    """The largest absolute value of the components of vectors (..., d), (..., 1)."""
    result = np.zeros((*vectors.shape[:-1], 1))
    for k in range(vectors.shape[-1]):  # rows are too short for a reduction along them
        np.maximum(result, np.abs(vectors[..., k : k + 1]), out=result)
    return result


def unit(vectors: Array, noise: Array) -> Array:
    """Vectors (Q, d) scaled to length 1; NaN where no component exceeds `noise` (Q, 1)."""
    with np.errstate(all="ignore"):
        # largest component first: neither overflow nor underflow in the squares
        size = largest(vectors)
        vectors = vectors / np.where(size > noise, size, np.nan)
        return np.asarray(vectors / np.sqrt((vectors * vectors).sum(axis=-1, keepdims=True)))


def unit_normals(along: Array, across: Array, noise: tuple[Array, Array]) -> Array:
    """Unit vectors (Q, 3) along the cross products: the rule of when a normal is in doubt.

    `noise`, two of (Q, 1), bounds the rounding errors of the vectors' components, from the sizes of
    what was added up to them, not of what is left. NaN where within these the vectors might be
    dependent: errors of unit vectors are at most sqrt(3) < 2 times as large, relative to the
    largest component; see ``doubt.py``.
    """
    with np.errstate(all="ignore"):
        angle = sum(n / largest(x) for x, n in zip((along, across), noise, strict=True))
    cross = np.cross(unit(along, noise[0]), unit(across, noise[1]))
    return unit(cross, UNIT * np.asarray(angle))


def shape_operators(
    first: Array, second: Array, ratios: Array, errors: Array | None = None
) -> tuple[Array, Array, Array]:
    """Second fundamental forms in orthonormal frames of tangent planes, and these frames' x-axes.

    Coordinates have units a1, a2, b of their own, so that what falls by different powers towards a
    corner is never added up: `ratios` are a2 / a1, b / a1 and b / a2. Of the frame (q1, q2), q1 is
    along d/ds or d/dt, whichever is longer, and q1 x q2 along d/ds x d/dt;
    ``derivations/curvature.py``.

    Parameters
    ----------
    first : (2, Q, 3)
        d/ds and d/dt.
    second : (3, Q, 3)
        d2/ds2, d2/dsdt, d2/dt2.
    ratios : (3, Q)
    errors : (5, Q, 3), optional
        Bounds of the rounding errors of all these derivatives.

    Returns
    -------
    (3, Q)
        w11 in units of b / a1^2, w12 of b / (a1 a2), w22 of b / a2^2.
    (3, Q)
        Bounds of their rounding errors, as far as they come from `errors`.
    (Q, 3)
        q1 in these coordinates, all in units of a1.
    """
    one = np.ones_like(ratios[0])
    lengths = np.stack([one, ratios[0], ratios[1]], axis=1)  # (Q, 3) of the coordinates, by a1
    areas = np.stack([ratios[1], ratios[2], one], axis=1)  # of cross products, by a1 a2
    with np.errstate(all="ignore"):
        square = ((first * lengths) ** 2).sum(axis=2)  # (2, Q)
        turn = square[0] < square[1]  # a quarter: s' = t, t' = -s
        ds, dt = np.where(turn[:, None], first[::-1] * [[[1]], [[-1]]], first)
        dss, dst, dtt = np.where(turn[:, None], second[::-1] * [[[1]], [[-1]], [[1]]], second)
        along, across = ds * lengths, dt * lengths
        e = np.maximum(square[0], square[1])
        slope = (along * across).sum(axis=1) / e
        cross = np.cross(ds, dt)
        d = np.sqrt(((cross * areas) ** 2).sum(axis=1))
        m11, m12, m22 = ((cross * x).sum(axis=1) for x in (dss, dst, dtt))
        forms = [
            m11 / (d * e),
            (m12 - slope * m11) / d**2,
            (m22 - slope * (2 * m12 - slope * m11)) * e / d**3,
        ]
        bounds = np.zeros((3, len(e)))
        if errors is not None:
            # of the determinants, and of the slope, whose terms may cancel
            es, et = np.where(turn[:, None], errors[1::-1], errors[:2])
            ess, est, ett = np.where(turn[:, None], errors[:1:-1], errors[2:])
            wrong = sum(
                np.abs(x[:, i] * y[:, j])
                for x, y in ((ds, et), (es, dt))
                for i, j in (([1, 2, 0], [2, 0, 1]), ([2, 0, 1], [1, 2, 0]))
            )
            n11, n12, n22 = (
                (np.abs(cross) * y + wrong * np.abs(x)).sum(axis=1)
                for x, y in ((dss, ess), (dst, est), (dtt, ett))
            )
            tilt = ((np.abs(along) * et + es * np.abs(across)) * lengths).sum(axis=1) / e
            sizes = np.abs([slope, m11, m12])
            bounds = np.array([
                n11 / (d * e),
                (n12 + sizes[0] * n11 + tilt * sizes[1]) / d**2,
                (n22 + sizes[0] * (2 * n12 + sizes[0] * n11)
                 + 2 * tilt * (sizes[2] + sizes[0] * sizes[1])) * e / d**3,
            ])  # fmt: skip
        return np.array(forms), bounds, along / np.sqrt(e)[:, None]


def honest(form: Array, noise: Array, size: Array) -> Array:
    """Second fundamental forms (3, Q) of patches of some size (Q,), but where errors outweigh them.

    There they are 0 if what the errors might hide, too, is flat beside the size, else NaN.
    """
    doubt = ~(np.abs(form).max(axis=0) > noise.max(axis=0)) & ~np.isnan(form).any(axis=0)
    with np.errstate(all="ignore"):
        flat = noise.max(axis=0) * size <= _FLAT
    return np.where(doubt, np.where(flat, 0.0, np.nan), form)


_FLAT = 1e-6  # curvature times size


def principal(form: Array, axis: Array, normal: Array) -> Array:
    """Principal curvatures k1 >= k2, mean, Gaussian, directions d1 and d2 = n x d1, (Q, 10).

    Of second fundamental forms (3, Q) = w11, w12, w22 in frames (q1, n x q1).
    """
    w11, w12, w22 = form
    with np.errstate(all="ignore"):
        mean, half = w11 / 2 + w22 / 2, w11 / 2 - w22 / 2
        spread = np.hypot(half, w12)
        gaussian = w11 * w22 - w12 * w12
        # the larger by size first: the other one is the quotient, without cancellation
        large = mean + np.where(mean < 0, -spread, spread)
        small = np.where(large == 0, 0.0, gaussian / large)
        k1, k2 = np.where(mean < 0, small, large), np.where(mean < 0, large, small)
        angle = np.arctan2(w12, half)[:, None] / 2
        d1 = np.cos(angle) * axis + np.sin(angle) * np.cross(normal, axis)
    values = np.stack([k1, k2, mean, gaussian], axis=1)
    return np.concatenate([values, d1, np.cross(normal, d1)], axis=1)
