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


def eigen_powers(table: EigenTable, place: CornerPlace) -> tuple[Array, Array, Array]:
    """J^n over the n-th power of the subdominant eigenvalue, for each query.

    Returns
    -------
    diagonal : (Q, K - 1)
        Powers of the ratios of the eigenvalues after the first.
    chained : (Q, chains)
        ``n ratio^(n - 1) / subdominant``: the entries beside the diagonal.
    level : (Q,)
        n, 0 at the corner itself.
    """
    levels, which = np.unique(np.maximum(place.level, 0), return_inverse=True)
    high, low = table.ratios[:, 1:]
    diagonal = kernels.power(high, low, levels)[which]
    heads = table.chains - 1
    before = kernels.power(high[heads], low[heads], np.maximum(levels - 1, 0))
    chained = (levels[:, None] * before / table.eigenvalues[0, 1])[which]
    return diagonal, chained, levels[which]


def eigen_weights(
    table: EigenTable, place: CornerPlace, powers: tuple[Array, Array, Array], nu: tuple[int, int]
) -> EigenWeights:
    """The `nu`-th derivative in (s, t) around an extraordinary corner, in float64.

    At the corner itself a derivative of positive order is 0 if all its terms vanish in the limit,
    else NaN.
    """
    _, _, level = powers
    order = sum(nu)
    rows, corner = _eigen_rows(table, place, powers, nu)
    high, low = table.eigenvalues[:, 1].tolist()
    mantissa, exponent = kernels.scaled_power(high, low, level)
    rows = rows * mantissa[:, None]
    exponent = exponent + order * (level + 1)
    if corner.any():
        rows[corner] = 0.0 if order == 0 or vanishes_at_corner(table, nu) else np.nan
    return EigenWeights(rows, exponent, order == 0)


def eigen_tangents(
    table: EigenTable, place: CornerPlace, powers: tuple[Array, Array, Array]
) -> tuple[EigenWeights, EigenWeights]:
    """First derivatives in s and t up to a common positive factor: their directions.

    At the corner itself they are the limits along the edges t = 0 and s = 0, which are those of
    the subdominant eigenfunctions; NaN where there is no tangent plane.
    """
    result = []
    for nu, piece, S, T in (((1, 0), 0, 1.0, 0.0), ((0, 1), 2, 0.0, 1.0)):
        rows, corner = _eigen_rows(table, place, powers, nu)
        if corner.any():
            rows[corner] = 0.0 if table.smooth else np.nan
            weights = kernels.bicubic_weights(np.array([S]), np.array([T]), nu)
            if table.smooth:
                rows[corner, :2] = weights @ table.pieces[piece][:, 1:3]
        result.append(EigenWeights(rows, np.zeros(len(rows), dtype=np.int64), False))
    return result[0], result[1]


def _eigen_rows(
    table: EigenTable, place: CornerPlace, powers: tuple[Array, Array, Array], nu: tuple[int, int]
) -> tuple[Array, Array]:
    """Derivatives in (S, T) times `powers`, (Q, K - 1); and which queries are at the corner."""
    diagonal, chained, _ = powers
    b = kernels.bicubic_weights(place.S, place.T, nu)
    rows = np.empty_like(diagonal)
    for piece in range(3):
        here = place.piece == piece
        rows[here] = b[here] @ table.pieces[piece][:, 1:]
    heads = table.chains - 1
    linked = rows[:, heads - 1] * chained
    rows *= diagonal
    rows[:, heads] += linked
    return rows, place.level < 0


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
            rows[here, row] += [int(w) for w in b[here, k] * unit[here]]
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
