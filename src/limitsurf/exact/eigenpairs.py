"""Eigenvectors of a sparse matrix with simple eigenvalues, from those in float64 to all digits.

With ``Z`` approximate eigenvectors and ``l_j`` eigenvalues in float64, and ``x_j`` the vector that
is known so far, the residual ``r = A x_j - l_j x_j`` and ``d = Z^-1 r`` tell what is missing:
``l_j`` grows by ``d_j``, and ``x_j`` by ``sum d_i / (l_j - l_i) z_i`` over all other i. Residuals
alone need all digits, and of a sparse matrix they cost little; what is missing is wanted to few
digits, and float64 will do. Every round adds nearly as many digits as float64 has, less those that
close eigenvalues take. Derived in ``derivations/sectors.py``, section 8.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from limitsurf.exact.fixed import Fixed, Precision, UnsupportedSpectrum

_FLOAT = 60  # binary digits of numbers that become float64
_SMALL = 128  # columns of matrices that one thread multiplies sooner
_NOISE = 40  # binary digits of what rounding can leave beside eigenvalues that are close

Array = np.ndarray[Any, np.dtype[Any]]


@dataclass(frozen=True)
class Approximate:
    """Eigenvectors in float64, columns, that of a complex pair with positive imaginary part first.

    Attributes
    ----------
    values, vectors : (n,), (n, n) complex
    pairs : list of int
        Where pairs begin.
    """

    values: Array
    vectors: Array
    pairs: list[int]

    @classmethod
    def of(cls, matrix: Array) -> Approximate:
        """Those of a matrix, by size of the eigenvalues."""
        found, vectors = np.linalg.eig(matrix)
        # (a pair that is taken for real values, or the reverse, does not converge below)
        real = np.abs(found.imag) < 1e-9
        order = sorted(np.flatnonzero(real | (found.imag > 0)), key=lambda k: -abs(found[k]))
        values: list[complex] = []
        columns: list[Array] = []
        pairs: list[int] = []
        for k in order:
            if real[k]:
                values.append(complex(found[k].real))
                columns.append(vectors[:, k].real.astype(complex))
            else:
                pairs.append(len(values))
                values += [found[k], found[k].conj()]
                columns += [vectors[:, k], vectors[:, k].conj()]
        return cls(np.array(values), np.array(columns).T, pairs)


def eigenpairs(
    matrix: Sequence[Sequence[Any]], at: Precision
) -> tuple[list[Any], Fixed, Fixed, list[int]]:
    """Eigenvalues, right and left eigenvectors of a matrix with simple eigenvalues, and pairs.

    The real and the imaginary part of the vectors of a complex pair stand in two columns, or rows,
    such that both matrices are inverse. ZeroDivisionError or LinAlgError where two eigenvalues are
    equal.
    """
    near = Approximate.of(np.array([[float(x) for x in row] for row in matrix]))
    if len(near.pairs) > 1:
        raise UnsupportedSpectrum("a dart with more than one complex pair of eigenvalues")
    A, pairs = at.to_fixed(matrix), near.pairs
    real, imaginary, X = _improved(A, near, at)
    dual = Approximate(near.values, np.linalg.inv(near.vectors).T, pairs)
    _, _, Y = _improved(A.T, dual, at)
    inverse = Y.T.copy()
    for k in set(range(len(X))) - {k for p in pairs for k in (p, p + 1)}:
        inverse[k] = (inverse[k] << at.bits) // (inverse[k].dot(X[:, k]) >> at.bits)
    for p in pairs:
        # w . z = 1; of its real and imaginary part 2 Re w and -2 Im w are the inverse
        x, y, r, s = X[:, p], X[:, p + 1], inverse[p], inverse[p + 1]
        c, d = (r.dot(x) - s.dot(y)) >> at.bits, (r.dot(y) + s.dot(x)) >> at.bits
        norm = c * c + d * d
        inverse[p], inverse[p + 1] = (
            2 * ((r * c + s * d << at.bits) // norm),
            -2 * ((s * c - r * d << at.bits) // norm),
        )
    # the last digits are rounding: 0, 1/4, 1/2 and 1 come out exactly
    real, imaginary = (((x + (1 << 15)) >> 16) << 16 for x in (real, imaginary))
    parts = (at.mp.ldexp(at.mp.mpf(int(x)), -at.bits) for x in (*real, *imaginary))
    flat = list(parts)
    values: list[Any] = flat[: len(X)]
    for p in pairs:
        turn = flat[len(X) + p]
        values[p], values[p + 1] = at.mp.mpc(values[p], turn), at.mp.mpc(values[p], -turn)
    return values, X, inverse, pairs


def _improved(A: Fixed, near: Approximate, at: Precision) -> tuple[Fixed, Fixed, Fixed]:
    """Eigenvalues, real and imaginary part, and right eigenvectors, all to all digits."""
    Z, pairs = near.vectors, near.pairs
    firsts, seconds = pairs, [p + 1 for p in pairs]
    rows = [[(k, w) for k, w in enumerate(row) if w] for row in A.tolist()]
    values, Z_inverse = near.values, np.linalg.inv(Z)
    gap = values[None, :] - values[:, None]
    np.fill_diagonal(gap, np.inf)
    if not np.abs(gap).all():
        raise ZeroDivisionError
    start = Z.real.copy()
    start[:, seconds] = Z[:, firsts].imag
    real, imaginary, X = at.to_fixed(values.real), at.to_fixed(values.imag), at.to_fixed(start)
    for _ in range(20 + at.bits // 20):
        residual = np.array([sum(w * X[k] for k, w in row) for row in rows], dtype=object)
        residual -= X * real
        residual[:, firsts] += X[:, seconds] * imaginary[firsts]
        residual[:, seconds] -= X[:, firsts] * imaginary[firsts]
        residual >>= at.bits
        shift = _sizes(residual)
        for p in pairs:
            shift[p] = shift[p + 1] = max(shift[p], shift[p + 1])
        small = np.ldexp((residual >> shift).astype(float), -_FLOAT).astype(complex)
        small[:, firsts] += 1j * small[:, seconds]
        small[:, seconds] = small[:, firsts].conj()
        missing = _product(Z_inverse, small)
        turned = _product(Z, missing / gap)
        added = turned.real
        added[:, seconds] = turned[:, firsts].imag
        own = missing.diagonal()
        real = real + _fixed(own.real, shift)
        imaginary = imaginary + _fixed(own.imag, shift)
        real[seconds], imaginary[seconds] = real[firsts], -imaginary[firsts]
        added = _fixed(added, shift)
        X = X + added
        if np.abs(added).max() < 1 << _NOISE:
            return real, imaginary, X
    raise ZeroDivisionError


def _product(left: Array, right: Array) -> Array:
    """The product of two matrices; threads, which wait for each other, for large ones alone."""
    if len(left) > _SMALL:
        return np.asarray(left @ right)
    return np.asarray(np.einsum("ij,jk->ik", left, right))


def _sizes(columns: Fixed) -> Fixed:
    """How far columns are to be shifted to the right to be of `_FLOAT` binary digits, (n,)."""
    most = np.abs(columns).max(axis=0)
    return np.array([max(int(x).bit_length() - _FLOAT, 0) for x in most], dtype=object)


def _fixed(numbers: Array, shift: Fixed) -> Fixed:
    """Numbers, shifted back."""
    mantissa, exponent = np.frexp(numbers)
    whole = np.ldexp(mantissa, _FLOAT).astype(np.int64).astype(object)
    power = exponent.astype(object) + shift
    return np.asarray(
        np.where(power < 0, whole >> np.maximum(-power, 0), whole << np.maximum(power, 0))
    )
