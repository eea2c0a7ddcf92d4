"""Regular pieces: what a scheme makes of a regular lattice, as exact polynomials.

The schemes that are here make box splines (de Boor, Hoellig and Riemenschneider, "Box splines",
Springer 1993). A box spline is given by its directions alone: those of the bicubic B-spline are the
two of the square lattice, four times each; those of the quartic one of Loop the three edges of the
triangular lattice, twice each. That of Doo and Sabin, the biquadratic B-spline, has the control
point of a place in the middle of the face there. Fewer directions make splines of degree 1. All
else follows:

* pieces, by the recurrence of de Boor and Hoellig (1982): for n directions X, and with t_r such
  that ``x = sum t_r r`` over them, ``(n - 2) B_X(x) = sum t_r B_(X - r)(x) + (1 - t_r)
  B_(X - r)(x - r)``, down to two directions, whose spline is constant on their parallelogram;
* the masks of one step: the coefficients of ``2^(2 - n) prod (1 + z^r)``;
* curves: what is the same all along v is a spline in u, summed over the points along v.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from itertools import combinations
from math import factorial

import numpy as np
from numpy.typing import NDArray

from limitsurf.caching import cached_property

Vector = tuple[int, int]
Point = tuple[float, float]
Matrix = tuple[tuple[Fraction, ...], ...]


@dataclass(frozen=True)
class Spline:
    """A box spline on the integer lattice, centred at its control points.

    Attributes
    ----------
    name : str
        What it is called in messages.
    directions : tuple of vectors
        Integer vectors, each as often as it counts, equal ones together.
    inside : (float, float)
        Any point inside the face of which it is told, whose corner 0 is at the origin.
    """

    name: str
    directions: tuple[Vector, ...]
    inside: Point

    @cached_property
    def _weights(self) -> dict[Vector, dict[Vector, Fraction]]:
        """Coefficients by exponents, of each control point that has influence, by its place."""
        ends = [sorted(axis) for axis in zip(*_sums(self.directions), strict=True)]
        low, (width, height) = (ends[0][0], ends[1][0]), (e[-1] - e[0] for e in ends)
        found = _integrals(self.directions, low, (width, height), self.inside)
        scale, (a, b) = factorial(len(self.directions) - 2), self._centre
        weights: dict[Vector, dict[Vector, Fraction]] = {}
        for y, x, j, i in np.argwhere(found.transpose(1, 0, 3, 2))[::-1].tolist():
            place = 1 + a - low[0] - x, 1 + b - low[1] - y
            weights.setdefault(place, {})[i, j] = Fraction(int(found[x, y, i, j]), scale)
        return weights

    @property
    def _centre(self) -> Vector:
        return sum(x for x, _ in self.directions) // 2, sum(y for _, y in self.directions) // 2

    @property
    def template(self) -> tuple[Vector, ...]:
        """Places of the control points of a face whose corner 0 is at (1, 1), by j, then i."""
        return tuple(self._weights)

    @property
    def is_product(self) -> bool:
        """Whether it is a product of splines in u and in v."""
        return len(set(self.directions)) == 2

    @cached_property
    def exponents(self) -> tuple[Vector, ...]:
        """Exponents (i, j) of the monomials ``s^i t^j`` of a piece, by j, then i."""
        total = len(self.directions) - 2
        most = total, total
        if self.is_product:
            most = self.directions.count((1, 0)) - 1, self.directions.count((0, 1)) - 1
        degrees = range(most[0] + 1), range(most[1] + 1)
        return tuple((i, j) for j in degrees[1] for i in degrees[0] if i + j <= total)

    @cached_property
    def degree(self) -> int:
        """The highest power of s, or of t, in a piece."""
        return max(max(powers) for powers in self.exponents)

    @cached_property
    def cubic(self) -> bool:
        """Whether pieces are products of those of the cubic B-spline in s and in t."""
        return Counter(self.directions) == {(1, 0): 4, (0, 1): 4}

    def vanishes(self, nu: Vector) -> bool:
        """Whether the derivative of this order is 0 in all pieces."""
        return all(i < nu[0] or j < nu[1] for i, j in self.exponents)

    @cached_property
    def pieces(self) -> Matrix:
        """Coefficients of the monomials by control point, (exponents, template)."""
        columns = self._weights.values()
        return tuple(
            tuple(column.get(powers, Fraction(0)) for column in columns)
            for powers in self.exponents
        )

    @cached_property
    def curve(self) -> Matrix:
        """Coefficients of the powers of s by control point of what is the same along v."""
        places = sorted({i for i, _ in self.template})
        degree = max(i for i, j in self.exponents if j == 0)
        rows = [[Fraction(0)] * len(places) for _ in range(degree + 1)]
        for (place, _), weight in self._weights.items():
            for (power, other), x in weight.items():
                if other == 0:
                    rows[power][place - places[0]] += x
        return tuple(tuple(row) for row in rows if any(row))

    def stencil(self, refined: Vector) -> dict[Vector, Fraction]:
        """Weights of the control points in a refined one, whose place counts halves of theirs."""
        share = Fraction(4, 2 ** len(self.directions))
        (a, b), (c, d) = refined, self._centre
        return {
            ((a + c - x) // 2, (b + d - y) // 2): share * count
            for (x, y), count in _sums(self.directions).items()
            if (a + c - x) % 2 == (b + d - y) % 2 == 0
        }

    def curve_stencil(self, refined: int) -> dict[int, Fraction]:
        """Weights of control points that are the same along v in a refined one, by their places."""
        sums: dict[int, Fraction] = {}
        for (i, _), weight in self.stencil((refined, 0)).items():
            sums[i] = sums.get(i, Fraction(0)) + weight
        return sums


def _sums(directions: tuple[Vector, ...]) -> Counter[Vector]:
    """How often each vector is a sum of some of the directions."""
    sums: Counter[Vector] = Counter({(0, 0): 1})
    for a, b in directions:
        sums.update({(x + a, y + b): count for (x, y), count in sums.items()})
    return sums


@lru_cache(maxsize=64)
def _integrals(
    directions: tuple[Vector, ...], low: Vector, shape: Vector, inside: Point
) -> NDArray[np.int64]:
    """Polynomials of a box spline on faces, times ``(n - 2)!``: integers (*shape, n - 1, n - 1).

    Those of the faces whose corner 0 is at ``low + (x, y)``, in coordinates from there.
    """
    n = len(directions)
    result = np.zeros((*shape, n - 1, n - 1), dtype=np.int64)
    x, y = np.indices(shape) + np.reshape(low, (2, 1, 1))
    spanning = ((k, m) for k, m in combinations(sorted(set(directions)), 2) if _area(k, m))
    first, second = next(spanning, ((0, 0), (0, 0)))
    area = _area(first, second)
    if not area:  # zero almost everywhere
        return result
    # of t_r with (u, v) = sum t_r r: the factors of u and v, which are integers as the edges of
    # faces are directions
    shares = {
        first: (second[1] // area, -second[0] // area),
        second: (-first[1] // area, first[0] // area),
    }
    if n == 2:
        at = [p * (x + inside[0]) + q * (y + inside[1]) for p, q in shares.values()]
        result[..., 0, 0] = np.all([(share > 0) & (share < 1) for share in at], axis=0)
        return result
    for r in sorted(set(directions)):
        k, (p, q) = directions.index(r), shares.get(r, (0, 0))
        near = _integrals(directions[:k] + directions[k + 1 :], low, shape, inside)
        far = np.roll(near, r, axis=(0, 1))
        step = near - far
        result[..., :-1, :-1] += directions.count(r) * far
        result[..., :-1, :-1] += (p * x + q * y)[..., None, None] * step
        result[..., 1:, :-1] += p * step
        result[..., :-1, 1:] += q * step
    return result


def _area(r: Vector, s: Vector) -> int:
    return r[0] * s[1] - r[1] * s[0]


BILINEAR = Spline("bilinear spline", ((1, 0),) * 2 + ((0, 1),) * 2, (1 / 2, 1 / 2))
LINEAR = Spline("linear spline", ((1, 0), (0, 1), (-1, 1)), (1 / 3, 1 / 3))
BICUBIC = Spline("bicubic B-spline", ((1, 0),) * 4 + ((0, 1),) * 4, (1 / 2, 1 / 2))
BIQUADRATIC = Spline("biquadratic B-spline", ((1, 0),) * 3 + ((0, 1),) * 3, (1 / 2, 1 / 2))
QUARTIC = Spline(
    "quartic box spline", ((1, 0),) * 2 + ((0, 1),) * 2 + ((-1, 1),) * 2, (1 / 3, 1 / 3)
)
