"""Points and weights on a square or triangle, and Bernstein polynomials at them.

A rule of n points per direction is exact for polynomials of degree 2 n - 1 in each of the two
parameters of a square. On a triangle, of which one corner is blown up to a side, it is exact for
those of total degree 2 n - 2: the blow-up multiplies by one power.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import numbers
from limitsurf._kernels import reference as kernels
from limitsurf.pieces import bernstein
from limitsurf.pieces.bernstein import Bernstein

if TYPE_CHECKING:
    from limitsurf.scheme.scheme import Scheme

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Rule:
    """A rule on the domain of cells, with Q points.

    Attributes
    ----------
    s, t, weights : (Q,)
        Of float64; or Fractions, whose weights then may be negative.
    values : (3, Q, n)
        Bernstein polynomials at the points, and their derivatives by s and by t.
    """

    s: Array
    t: Array
    weights: Array
    values: Array

    @classmethod
    @lru_cache(maxsize=64)
    def of(cls, scheme: Scheme, points: int, exact: bool = False) -> Rule:
        """That of so many points per direction: Gauss's, or equidistant ones if it is exact.

        The latter integrate as high degrees as Gauss's do, with twice as many points.
        """
        form = Bernstein.of(scheme, True)
        nodes, weights = _equidistant(2 * points) if exact else _gauss(points)
        a, b = (x.ravel() for x in np.meshgrid(nodes, nodes, indexing="ij"))
        weight = np.multiply.outer(weights, weights).ravel()
        if not bernstein.is_tensor(form.exponents):
            weight, b = weight * (1 - a), b * (1 - a)
        # rounded once
        rational = numbers.RATIONAL.array
        values = _polynomials(scheme, form, rational(a), rational(b))
        return cls(a, b, weight, values if exact else values.astype(float))

    def jets(self, points: Array) -> tuple[Array, Array, Array]:
        """Values and derivatives (C, Q, d) by s and by t of cells (C, n, d)."""
        count = len(self.weights)
        found = np.matmul(self.values.reshape(3 * count, -1), points)
        return found[:, :count], found[:, count : 2 * count], found[:, 2 * count :]


def moments_rule(scheme: Scheme, factors: int, exact: bool = False) -> Rule:
    """A rule that is exact for products of so many positions, of which two are derived.

    Products of k positions of degree d have degree k d - 1 in each parameter of squares, where one
    of the derivatives takes one away, and k d - 2 in total on triangles.
    """
    return Rule.of(scheme, -(-factors * scheme.spline.degree // 2), exact)


def _gauss(points: int) -> tuple[Array, Array]:
    """Nodes and weights on [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(points)
    return (1 + x) / 2, w / 2


@lru_cache(maxsize=16)
def _equidistant(points: int) -> tuple[Array, Array]:
    """Rational nodes and weights on [0, 1], exact for degrees below `points`."""
    nodes = [Fraction(k + 1, points + 1) for k in range(points)]
    weights = []
    for k, x in enumerate(nodes):
        product = [Fraction(1)]  # coefficients of powers, lowest first
        for j, y in enumerate(nodes):
            if j != k:
                higher, lower = [Fraction(0), *product], [*product, Fraction(0)]
                product = [(p - y * q) / (x - y) for p, q in zip(higher, lower, strict=True)]
        weights.append(sum(c / (i + 1) for i, c in enumerate(product)))
    return numbers.RATIONAL.array(nodes), numbers.RATIONAL.array(weights)


def _polynomials(scheme: Scheme, form: Bernstein, s: Array, t: Array) -> Array:
    """Bernstein polynomials and their first derivatives at (s, t), exact, (3, Q, n)."""
    exponents = np.array(scheme.spline.exponents)
    # powers in Bernstein polynomials have integer coefficients
    inverse = np.rint(np.linalg.inv(form.from_powers.astype(float))).astype(int).astype(object)
    (i, j), degree = exponents.T, int(exponents.max())
    along, across = kernels.monomials(s, degree), kernels.monomials(t, degree)
    powers = np.stack(
        [
            along[:, i] * across[:, j],
            i * along[:, np.maximum(i - 1, 0)] * across[:, j],
            j * along[:, i] * across[:, np.maximum(j - 1, 0)],
        ]
    )
    found: Array = powers @ inverse
    return found
