"""Polynomials on squares and triangles by their Bernstein coefficients: what searches need.

All as matrices of a lattice and a degree, so that whoever searches knows neither.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import comb
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels import reference as kernels
from limitsurf.pieces import bernstein

if TYPE_CHECKING:
    from limitsurf.scheme.lattice import Lattice

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Form:
    """What is done with n coefficients of polynomials of a degree.

    Attributes
    ----------
    exponents : (n, 2) int
    degree : int
    derivatives : (6, n, n)
        Onto the coefficients, of the same degree, of the value, of d/ds, d/dt, d2/ds2, d2/dsdt and
        d2/dt2; integers.
    corners : (c,) int
        The coefficients at the corners of the domain, which are values there.
    edges : (c, degree + 1) int
        Those along each edge, from corner k to the next.
    ends : (c, 2)
        Where the corners are.
    inward : (c, 2)
        A direction from each edge into the domain.
    halves : (w, 2, n, n)
        Onto the coefficients of both halves, for each of the w ways to halve the domain.
    frames : (w, 2, 3, 2)
        Of the halves: their corner 0, and their s and t in the domain.
    across : (w, 2) int
        The corners between which each way halves.
    """

    exponents: Array
    degree: int
    derivatives: Array
    corners: Array
    edges: Array
    ends: Array
    inward: Array
    halves: Array
    frames: Array
    across: Array

    @classmethod
    @lru_cache(maxsize=32)
    def of(cls, lattice: Lattice, degree: int) -> Form:
        """That of the domain of a lattice."""
        exponents = _exponents(lattice, degree)
        s, t = _derivatives(exponents)
        parts = np.eye(len(s)), s, t, s @ s, s @ t, t @ t
        i, j = exponents.T
        sides = np.array(lattice.edges)
        ends = np.array(lattice.corners, dtype=float)
        edges = []
        for (a, b, c), corner in zip(sides, ends, strict=True):
            on = np.flatnonzero(a * degree + b * i + c * j == 0)
            far = np.abs(exponents[on] - degree * corner).sum(axis=1)
            edges.append(on[np.argsort(far)])
        edge = np.array(edges)
        frames, across = _halvings(lattice)
        inward = sides[:, 1:].astype(float)
        known = exponents, degree, np.stack(parts), edge[:, 0], edge, ends, inward
        n, halves = len(s), bernstein.blossoms(exponents, frames.reshape(-1, 3, 2))
        return cls(*known, halves.reshape(*frames.shape[:2], n, n), frames, across)

    @property
    def size(self) -> int:
        """Number n of coefficients."""
        return len(self.exponents)

    def part(self, frames: Array) -> Array:
        """Onto the coefficients in parts of the domain, (Q, n, n), of frames (Q, 3, 2)."""
        return bernstein.parts(self.exponents, frames)

    def values(self, s: Array, t: Array, order: int = 2) -> Array:
        """Weights (Q, k, n) of values and derivatives up to an order at (s, t): k is 1, 3 or 6."""
        basis = bernstein.polynomials(self.exponents, s, t)
        if order == 0:
            return basis[:, None]
        parts = self.derivatives[: (order + 1) * (order + 2) // 2]
        found = basis @ parts.transpose(1, 0, 2).reshape(self.size, -1)
        return found.reshape(len(basis), len(parts), self.size)


@lru_cache(maxsize=32)
def products(lattice: Lattice, degree: int, other: int | None = None) -> Array:
    """Coefficients of products, (n * k, m): of the n * k products of coefficients of two factors.

    The degree of the second is that of the first unless it is given, that of the product their sum.
    All entries are positive, and those of a column sum to one: a mean of products.
    """
    more = degree if other is None else other
    factor, second, product = (_exponents(lattice, d) for d in (degree, more, degree + more))
    number = {tuple(place): k for k, place in enumerate(product.tolist())}
    weights, others, total = (multiples(x) for x in (factor, second, product))
    found = np.zeros((len(factor), len(second), len(product)))
    for a, one in enumerate(factor):
        for b, two in enumerate(second):
            k = number[tuple((one + two).tolist())]
            found[a, b, k] = weights[a] * others[b] / total[k]
    return found.reshape(-1, len(product))


@lru_cache(maxsize=32)
def lines(degree: int) -> tuple[Array, Array, Array, Array]:
    """For curves: derivatives (3, n, n), halves (2, n, n), products (n * n, m), derivatives there.

    The last are (3, m, m), of degree 2 * `degree`.
    """
    n, m = degree + 1, 2 * degree + 1
    halves = np.zeros((2, n, n))
    for k in range(n):
        for i in range(k + 1):
            halves[0, k, i] = comb(k, i) / 2**k
            halves[1, degree - k, degree - i] = comb(k, i) / 2**k
    product = np.zeros((n, n, m))
    for a in range(n):
        for b in range(n):
            share = comb(degree, a) * comb(degree, b) / comb(2 * degree, a + b)
            product[a, b, a + b] = share
    both = []
    for size in (n, m):
        d = np.zeros((size, size))
        for k in range(size):
            d[k, k] += k - (size - 1 - k)
            if k:
                d[k, k - 1] -= k
            if k < size - 1:
                d[k, k + 1] += size - 1 - k
        both.append(np.stack([np.eye(size), d, d @ d]))
    return both[0], halves, product.reshape(-1, m), both[1]


def line_values(degree: int, x: Array) -> Array:
    """Bernstein polynomials (Q, n) of curves."""
    counts = np.array([comb(degree, i) for i in range(degree + 1)], dtype=float)
    along, back = (kernels.monomials(y, degree) for y in (x, 1 - x))
    return np.asarray(counts * along * back[:, ::-1])


def _exponents(lattice: Lattice, degree: int) -> Array:
    """I and j of the coefficients, in the order of `Bernstein.exponents`."""
    steps = range(degree + 1)
    if lattice.sloped:
        return np.array([(i, j) for j in steps for i in steps if i + j <= degree])
    return np.array([(i, j) for i in steps for j in steps])


def multiples(exponents: Array) -> Array:
    """The integers that Bernstein polynomials begin with."""
    degree = int(exponents.max())
    if bernstein.is_tensor(exponents):
        return np.array([comb(degree, i) * comb(degree, j) for i, j in exponents.tolist()])
    return np.array([comb(degree, i + j) * comb(i + j, j) for i, j in exponents.tolist()])


def _derivatives(exponents: Array) -> tuple[Array, Array]:
    """Onto the coefficients of d/ds and d/dt, of the same degree: integers, (n, n) each."""
    degree, n = int(exponents.max()), len(exponents)
    number = {tuple(place): k for k, place in enumerate(exponents.tolist())}
    found = np.zeros((2, n, n))
    for k, place in enumerate(exponents.tolist()):
        for axis in (0, 1):
            row = found[axis, k]
            step = np.array([1 - axis, axis])
            if bernstein.is_tensor(exponents):
                i, last = place[axis], degree - place[axis]
                terms = [(i, step, 0 * step), (last, 0 * step, step)]  # (times, back, ahead)
            else:
                other, rest = np.array([axis, 1 - axis]), degree - sum(place)
                terms = [
                    (place[axis], step, 0 * step),
                    (place[1 - axis], other, step - other),
                    (rest, 0 * step, step),
                ]
            for times, back, ahead in terms:
                if times:
                    row[number[tuple((place + ahead).tolist())]] += times
                    row[number[tuple((place - back).tolist())]] -= times
    return found[0], found[1]


def _halvings(lattice: Lattice) -> tuple[Array, Array]:
    """Frames (w, 2, 3, 2) of halves, and the ends (w, 2) of an edge that each way halves."""
    if not lattice.sloped:
        whole = [[0, 0], [1, 0], [0, 1]]
        frames = np.array([[whole, whole], [whole, whole]], dtype=float)
        for axis in (0, 1):
            frames[axis, :, 1 + axis, axis] = 0.5
            frames[axis, 1, 0, axis] = 0.5
        return frames, np.array([[0, 1], [0, 3]])
    corners = np.array(lattice.corners, dtype=float)
    found = []
    for k in range(3):
        a, b, c = corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]
        middle = (a + b) / 2
        found.append([[c, a - c, middle - c], [c, middle - c, b - c]])
    return np.array(found), np.array([[0, 1], [1, 2], [2, 0]])
