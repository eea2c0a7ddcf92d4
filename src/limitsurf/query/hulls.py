"""How far polynomials are from triangles, by hulls of their coefficients there.

That takes longer than second derivatives, and is nearer to the truth: pieces may slide along the
triangle wherever they like.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.pieces import bernstein
from limitsurf.query.chords import distance, ways
from limitsurf.query.polynomials import Form

Array = NDArray[Any]

_PORTION = 512  # triangles at once

# shares of the middles of sides, and of that of all, where polynomials tend to be farthest
_LOOK = np.array([[0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [1 / 3, 1 / 3, 1 / 3]])


class Hulls:
    """Distances of polynomials from triangles with corners on them.

    Parameters
    ----------
    form : Form
    """

    def __init__(self, form: Form) -> None:
        self._form = form

    def whole(self, points: Array, most: float) -> Array:
        """Bounds (L,) on parts (L, n, 3), cut by whichever diagonal; inf where above `most`."""
        form = self._form
        found, good = np.zeros(len(points)), np.arange(len(points))
        for way in ways(len(form.ends)):
            at = form.ends[way]
            s, t = (_LOOK @ at).T
            look = form.values(s, t, 0)[:, 0]
            matrix = _parted(form, tuple(way))
            for start in range(0, len(good), _PORTION):
                some = good[start : start + _PORTION]
                triangle = points[some][:, form.corners[way]]
                found[some] = np.maximum(
                    found[some], _bounded(matrix, look, points[some], triangle, most)
                )
            good = good[found[good] <= most]
        return np.where(found <= most, found, np.inf)

    def cut(self, points: Array, at: Array, triangles: Array, most: float) -> Array:
        """The same of one triangle each, of corners (T, 3, 2) in parameters and (T, 3, 3)."""
        form, found = self._form, np.full(len(points), np.inf)
        shares, matrix = _divided(form)
        for start in range(0, len(points), _PORTION):
            some = slice(start, start + _PORTION)
            values = []
            for weights in (_LOOK, shares):
                s, t = np.matmul(weights, at[some]).reshape(-1, 2).T
                basis = form.values(s, t, 0)[:, 0].reshape(-1, len(weights), form.size)
                values.append(np.matmul(basis, points[some] - triangles[some, :1]))
            triangle = triangles[some] - triangles[some, :1]
            far = distance(values[0], triangle).max(axis=1, initial=0)
            good = np.flatnonzero(far <= most)
            hull = np.matmul(matrix, values[1][good])
            far[good] = distance(hull, triangle[good]).max(axis=1, initial=0)
            found[some] = np.where(far <= most, far, np.inf)
        return found


def _bounded(matrix: Array, look: Array, points: Array, triangle: Array, most: float) -> Array:
    """Bounds (L,) for one triangle of parts, of what is found on it first."""
    origin = triangle[:, :1]
    found = distance(np.matmul(look, points - origin), triangle - origin).max(axis=1, initial=0)
    good = np.flatnonzero(found <= most)
    hull = np.matmul(matrix, points[good] - origin[good])
    found[good] = distance(hull, triangle[good] - origin[good]).max(axis=1, initial=0)
    return np.asarray(found)


@lru_cache(maxsize=64)
def _parted(form: Form, way: tuple[int, ...]) -> Array:
    """Onto coefficients on the quarters of a triangle between corners of the domain."""
    return on_triangle(form, form.ends[list(way)])[0]


@lru_cache(maxsize=32)
def _divided(form: Form) -> tuple[Array, Array]:
    """Shares (k, 3) of places in any triangle, and a matrix (4 k, k) from values there.

    Onto the coefficients on its quarters.
    """
    exponents, shares = _places(2 * form.degree)
    own = np.linalg.inv(bernstein.polynomials(exponents, *shares[:, 1:].T))
    ends = np.array([[0.0, 0], [1, 0], [0, 1]])
    found = []
    for corners in _quarters(*ends):
        there = bernstein.polynomials(exponents, *(shares @ np.array(corners)).T)
        found.append(own @ there @ own)
    return shares, np.concatenate(found)


def _places(degree: int) -> tuple[Array, Array]:
    """Exponents (k, 2) of polynomials of a degree in triangles, and shares (k, 3) of places."""
    steps = range(degree + 1)
    exponents = np.array([(i, j) for j in steps for i in steps if i + j <= degree])
    return exponents, np.column_stack([degree - exponents.sum(axis=1), exponents]) / degree


def _quarters(p: Array, q: Array, r: Array) -> tuple[tuple[Array, Array, Array], ...]:
    """The corners of the quarters of a triangle."""
    a, b, c = (q + r) / 2, (r + p) / 2, (p + q) / 2
    return (p, c, b), (c, q, a), (b, a, r), (a, b, c)


def on_triangle(form: Form, ends: Array) -> tuple[Array, Array]:
    """Onto coefficients of a polynomial on squares in a triangle of corners (3, 2).

    They are of twice the degree: in four triangles like it, and in it.
    """
    exponents, shares = _places(2 * form.degree)
    own = bernstein.polynomials(exponents, *shares[:, 1:].T)
    found = []
    for corners in (*_quarters(*ends), tuple(ends)):
        there = bernstein.polynomials(form.exponents, *(shares @ np.array(corners)).T)
        found.append(np.linalg.solve(own, there))
    return np.concatenate(found[:4]), found[4]
