"""The Bernstein form of polynomial pieces: what is particular to squares and to bicubic splines.

Control points of a regular patch, powers of a piece's parameters and turns of the domain all come
as matrices onto Bernstein coefficients; the rest of the room multiplies by them and knows neither
the degree nor the number of corners.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from math import comb, factorial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import numbers
from limitsurf._kernels import reference as kernels

Array = NDArray[Any]

DEGREE = 3
CORNERS = 4
# Bernstein coefficients of a piece, i along u and j along v, in C order
SHAPE = (DEGREE + 1, DEGREE + 1)
SIZE = SHAPE[0] * SHAPE[1]
# the control point of a regular patch at its corner (0, 0)
NEAR = 5
# lower left corners of the regular pieces that a halving towards (0, 0) leaves, in their own size
PIECES = np.array([(1, 0), (1, 1), (0, 1)])


@dataclass(frozen=True, eq=False)
class Bernstein:
    """Matrices onto the Bernstein coefficients (16) of a piece, in float64 or exact.

    Attributes
    ----------
    from_controls : (16, 16)
        From the control points of a regular patch.
    from_powers : (16, 16)
        From the coefficients of the powers of its parameters, in the order of `EigenTable.pieces`.
    """

    from_controls: Array
    from_powers: Array

    @classmethod
    def of(cls, exact: bool) -> Bernstein:
        """Those of a number type."""
        controls, powers = _lines(exact)
        return cls(_tensor(controls, controls), _tensor(powers, powers))


def strips(polynomials: Array) -> Array:
    """Bernstein coefficients (n, 16, 16) of strips from control points.

    `polynomials` (n, 4, 4) are the splines across them, as in `StripTables.pieces`.
    """
    controls, powers = _lines(numbers.type_of(polynomials).exact)
    return _tensor(controls, powers @ polynomials)


def turned(turn: Array) -> Array:
    """Which coefficients of patches turned by so many corners are those of the domain, (n, 16)."""
    return _TURNED[turn]


def turned_squares(origin: Array, size: Array, turn: Array) -> tuple[Array, Array]:
    """Where rectangles of patches turned by so many corners lie in the domain, origin and size.

    All (..., 2), and (...) turns: s = v and t = 1 - u at one, s = 1 - u and t = 1 - v at two,
    s = 1 - v and t = u at three.
    """
    if not turn.any():
        return origin, size
    (s, t), (a, b) = np.moveaxis(origin, -1, 0), np.moveaxis(size, -1, 0)
    u = np.choose(turn, [s, 1 - t - b, 1 - s - a, t])
    v = np.choose(turn, [t, s, 1 - t - b, 1 - s - a])
    odd = turn % 2 == 1
    sizes = np.where(odd, b, a), np.where(odd, a, b)
    return np.stack([u, v], axis=-1), np.stack(sizes, axis=-1)


@lru_cache(maxsize=2)
def _lines(exact: bool) -> tuple[Array, Array]:
    """Bernstein coefficients of a cubic from its control points and from its powers, (4, 4)."""
    every = range(DEGREE + 1)
    # the k-th power of t has the coefficients C(i, k) / C(3, k)
    powers = np.array([[Fraction(comb(i, k), comb(DEGREE, k)) for k in every] for i in every])
    at_zero = numbers.RATIONAL.array([0])
    controls = powers @ np.stack(
        [kernels.cubic_weights(at_zero, k)[0] / factorial(k) for k in every]
    )
    return (controls, powers) if exact else (controls.astype(float), powers.astype(float))


def _tensor(along: Array, across: Array) -> Array:
    """Coefficients (..., 16) by i and j from values of index ``4 j + i``."""
    both = along[..., :, None, None, :] * across[..., None, :, :, None]
    return np.asarray(both.reshape(*both.shape[:-4], SIZE, SIZE))


def _turns() -> Array:
    number = np.arange(SIZE).reshape(SHAPE)  # by S and T
    # by u and v: S = v, T = 1 - u; S = 1 - u, T = 1 - v; S = 1 - v, T = u
    grids = number, number.T[::-1], number[::-1, ::-1], number.T[:, ::-1]
    return np.stack([grid.reshape(-1) for grid in grids])


_TURNED = _turns()
