"""Basis functions of a patch: (patch kind, s, t, derivative) to weights of its control points.

A regular patch is a bicubic B-spline. Around an extraordinary corner at (0, 0) the limit is

    x(s, t) = b(S, T) P A' A^n C,    A^n = V J^n V^-1,

where (S, T) are the parameters within the regular piece P that holds (s, t) after n halvings
towards the corner, b are the bicubic B-spline weights, A' is one more step of refinement and C are
the control points (Stam 1998, section 4; ``derivations/eigenstructure.py``). In float64 the powers
of the eigenvalues are taken relative to the subdominant one and the common scale is kept apart, so
that every n costs the same and nothing overflows before the result does. Rationals, whose field
does not hold the eigenvalues, take n steps of A instead.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from math import lcm
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels import reference as kernels
from limitsurf.tables import EigenTable, RationalTable

Array = NDArray[Any]


@dataclass(frozen=True)
class CornerPlace:
    """Where queries lie around an extraordinary corner; see `kernels.split_corner`."""

    level: Array
    piece: Array
    S: Array
    T: Array

    @classmethod
    def of(cls, s: Array, t: Array, turn: Array) -> CornerPlace:
        """Locate (s, t) in patches turned by `turn` corners against their limit face."""
        # lines between pieces belong to the side nearer corner 0 of the limit face; s grows
        # against u or v where the patch is turned by 2 or 3 corners, t by 1 or 2
        against_s, against_t = (turn == 2) | (turn == 3), (turn == 1) | (turn == 2)
        return cls(*kernels.split_corner(s, t, against_s, against_t))

    @classmethod
    def at(cls, piece: int, S: float, T: float) -> CornerPlace:
        """One place in a piece at level 0."""
        return cls(np.array([0]), np.array([piece]), np.array([S]), np.array([T]))

    def __getitem__(self, here: Array) -> CornerPlace:
        """The places of some queries, by mask or index."""
        return CornerPlace(self.level[here], self.piece[here], self.S[here], self.T[here])


@dataclass(frozen=True)
class EigenWeights:
    """Weights in terms of eigencoefficients c = V^-1 C, scaled: ``2**exponent * (rows @ c[1:])``.

    To a position (`with_limit`) the coefficient c[0], the limit of the corner, is added.
    """

    rows: Array
    exponent: Array
    with_limit: bool


@dataclass(frozen=True)
class EigenPowers:
    """J^n divided by the n-th power of its eigenvalue number `lead`, for each query.

    All eigenvalues before the lead, but the first, are taken to have coefficients 0.

    Attributes
    ----------
    lead : int
    level : (Q,)
        n, 0 at the corner itself.
    diagonal : (Q, K - 1)
        Powers of the ratios of the eigenvalues after the first.
    chained : (Q, chains)
        The entries beside the diagonal, ``n ratio^(n - 1) / eigenvalue[lead]``.
    """

    lead: int
    level: Array
    diagonal: Array
    chained: Array

    @classmethod
    def of(cls, table: EigenTable, place: CornerPlace, lead: int = 1) -> EigenPowers:
        """Powers at the levels of `place`."""
        levels, which = np.unique(np.maximum(place.level, 0), return_inverse=True)
        high, low = _ratios(table, lead)
        heads = table.chains - 1
        before = kernels.power(high[heads], low[heads], np.maximum(levels - 1, 0))
        chained = levels[:, None] * before / table.eigenvalues[0, lead]
        return cls(lead, levels[which], kernels.power(high, low, levels)[which], chained[which])


@lru_cache(maxsize=1024)
def _ratios(table: EigenTable, lead: int) -> Array:
    """Ratios of the eigenvalues after the first to number `lead`, high and low, (2, K - 1).

    Zero for those before the lead.
    """
    exact = [Fraction(h) + Fraction(x) for h, x in table.eigenvalues.T.tolist()]
    ratios = [x / exact[lead] if k >= lead else Fraction(0) for k, x in enumerate(exact)][1:]
    high = [float(x) for x in ratios]
    return np.array([high, [float(x - Fraction(h)) for x, h in zip(ratios, high, strict=True)]])


@lru_cache(maxsize=1024)
def _piece_differences(table: EigenTable, nu: tuple[int, int]) -> Array:
    """B-spline control points of the `nu`-th derivatives of the eigenfunctions on their pieces.

    (3, (4 - j) (4 - i), K - 1) for nu = (i, j), each piece without the constant eigenfunction.
    Differences that are 0 but for rounding are made 0: powers of 2 would amplify them.
    """
    pieces = table.pieces[:, :, 1:].reshape(3, 4, 4, -1)
    noise = 32 * np.finfo(float).eps * np.abs(pieces).max(axis=(0, 1, 2))
    differences = np.diff(np.diff(pieces, n=nu[0], axis=2), n=nu[1], axis=1)
    return np.where(np.abs(differences) > noise, differences, 0).reshape(3, -1, pieces.shape[-1])


def eigen_weights(
    table: EigenTable, place: CornerPlace, powers: EigenPowers, nu: tuple[int, int]
) -> EigenWeights:
    """The `nu`-th derivative in (s, t) around an extraordinary corner, in float64.

    At the corner itself a derivative of positive order is 0 if all its terms vanish in the limit,
    else NaN.
    """
    order = sum(nu)
    rows = _eigen_rows(table, place, powers, nu)
    high, low = table.eigenvalues[:, powers.lead].tolist()
    mantissa, exponent = kernels.scaled_power(high, low, powers.level)
    rows *= mantissa[:, None]
    exponent = exponent + order * (powers.level + 1)
    rows[place.level < 0] = 0.0 if order == 0 or vanishes_at_corner(table, nu) else np.nan
    return EigenWeights(rows, exponent, order == 0)


def eigen_tangents(
    table: EigenTable, place: CornerPlace, powers: EigenPowers
) -> tuple[EigenWeights, EigenWeights]:
    """First derivatives in s and t up to a common positive factor: their directions.

    At the corner itself they are the limits along the edges t = 0 and s = 0, which are those of
    the subdominant eigenfunctions; NaN where there is no tangent plane.
    """
    corner = place.level < 0
    # the common factor, a power of the leading eigenvalue, is positive but for odd powers of a
    # negative one
    negative = (powers.level % 2 == 1) & (table.eigenvalues[0, powers.lead] < 0)
    result = []
    for nu, end in (((1, 0), CornerPlace.at(0, 1.0, 0.0)), ((0, 1), CornerPlace.at(2, 0.0, 1.0))):
        rows = _eigen_rows(table, place, powers, nu)
        rows[negative] *= -1
        rows[corner] = 0.0 if table.smooth else np.nan
        if table.smooth:
            rows[corner, :2] = _eigen_rows(table, end, EigenPowers.of(table, end), nu)[:, :2]
        result.append(EigenWeights(rows, np.zeros(len(rows), dtype=np.int64), False))
    return result[0], result[1]


def _eigen_rows(
    table: EigenTable, place: CornerPlace, powers: EigenPowers, nu: tuple[int, int]
) -> Array:
    """Derivatives in (S, T) of the eigenfunctions after the first, times `powers`, (Q, K - 1)."""
    if max(nu) > 3:
        return np.zeros_like(powers.diagonal)
    along = kernels.spline_weights(place.S, 3 - nu[0])
    across = kernels.spline_weights(place.T, 3 - nu[1])
    b = across[:, :, None] * along[:, None, :]
    b = b.reshape(len(b), b.shape[1] * b.shape[2])
    rows = np.empty_like(powers.diagonal)
    for piece, differences in enumerate(_piece_differences(table, nu)):
        here = place.piece == piece
        rows[here] = b[here] @ differences
    heads = table.chains - 1
    linked = rows[:, heads - 1] * powers.chained
    rows *= powers.diagonal
    rows[:, heads] += linked
    return rows


def vanishes_at_corner(table: EigenTable, nu: tuple[int, int]) -> bool:
    """Whether a derivative of positive order tends to 0 at the corner for all control points.

    It scales as (2^order lambda)^n; beyond order 3 in one parameter it is 0 everywhere.
    """
    return max(nu) > 3 or bool(2 ** sum(nu) * np.abs(table.eigenvalues[0, 1:]).max() < 1)


def eigen_coefficients(table: EigenTable, points: Array) -> Array:
    """Coefficients V^-1 C of control points (P, K, d) in the eigenbasis, (P, K, d)."""
    ring = 2 * table.valence + 1
    waves = table.frequency, table.parity, table.left, table.half_turn
    modes = kernels.ring_coefficients(points[:, :ring], *waves)
    outer = np.matmul(table.outer, points[:, ring:]) - np.matmul(table.links, modes)
    return np.asarray(np.concatenate([modes, outer], axis=1)[:, table.order])


def control_weights(table: EigenTable, weights: EigenWeights) -> Array:
    """Weights of the eigencoefficients in terms of the control points, (Q, K)."""
    ring = 2 * table.valence + 1
    rows = np.zeros((len(weights.rows), table.size))
    rows[:, table.order[1:]] = weights.rows
    modes, outer = rows[:, :ring], rows[:, ring:]
    waves = table.frequency, table.parity, table.left, table.half_turn, table.valence
    around = kernels.ring_weights(modes - outer @ table.links, *waves)
    result = np.concatenate([around, outer @ table.outer], axis=1)
    result = kernels.scale_by_two(result, weights.exponent[:, None])
    return np.asarray(result + table.limit_mask if weights.with_limit else result)


def rational_weights(
    table: RationalTable, place: CornerPlace, nu: tuple[int, int], at_corner: Any
) -> Array:
    """Weights (Q, K) of control points around an extraordinary corner, as Fractions.

    Every level costs one sparse integer row-vector product. `at_corner` is the value that a
    derivative takes at the corner itself.
    """
    size = 2 * table.valence + 8
    b = kernels.bicubic_weights(place.S, place.T, nu)
    # integers over one denominator per query: far faster than Fractions
    unit = np.array([lcm(*(w.denominator for w in row)) for row in b], dtype=object)
    rows = np.zeros((len(b), size + 9), dtype=object)
    for piece in range(3):
        here = np.flatnonzero(place.piece == piece)
        for k, row in enumerate(table.pieces[piece]):
            rows[here, row] += _integers(b[here, k] * unit[here])
    starts = np.searchsorted(table.columns, np.arange(size))
    rows = np.add.reduceat(rows[:, table.rows] * table.numerators, starts, axis=1)
    square = table.rows < size
    sources, values = table.rows[square], table.numerators[square]
    starts = np.searchsorted(table.columns[square], np.arange(size))
    for done in range(int(place.level.max(initial=0))):
        going = np.flatnonzero(place.level > done)
        rows[going] = np.add.reduceat(rows[going][:, sources] * values, starts, axis=1)
    # (not ** on the array: a Fraction to the power of an array falls back to floats)
    step = Fraction(2 ** sum(nu), table.denominator)
    scale = np.array([step ** (max(n, 0) + 1) for n in place.level.tolist()], dtype=object)
    weights = rows * (scale / unit)[:, None]
    own, neighbour, across = table.limit_mask
    mask = [own, *[neighbour, across] * table.valence, *[Fraction(0)] * 7]
    weights[place.level < 0] = at_corner if sum(nu) else np.array(mask, dtype=object)
    return np.asarray(weights)


# Fractions that are whole to Python integers, which NumPy must not turn into machine ones
_integers = np.frompyfunc(int, 1, 1)
