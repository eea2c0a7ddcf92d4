"""Numbers for spectra: integers in units of 2**-BITS, and exact rational elimination.

About 96 digits: deterministic on every machine, and fast enough that valence 360 takes seconds.
"""

from __future__ import annotations

from fractions import Fraction
from math import lcm
from typing import Any

import mpmath
import numpy as np
from mpmath.libmp import to_fixed as fixed_point

BITS = 320
# a context of our own: the precision of mpmath.mp belongs to the user, in all threads at once
mp = mpmath.MPContext()
mp.prec = BITS + 64
# Two computed eigenvalues, or a numerator and zero, that agree to this are equal: 60 of 96 digits
EQUAL = mp.mpf(10) ** -60

Fixed = np.ndarray[Any, np.dtype[np.object_]]


class UnsupportedSpectrum(ValueError):  # noqa: N818  (users catch it by this name)
    """Masks that do not converge, complex eigenvalues, or Jordan blocks that are not handled."""


def diverging(place: str, faces: int, eigenvalue: Any) -> UnsupportedSpectrum:
    """The error that says where refinement has no limit, and of which eigenvalue."""
    value = complex(eigenvalue)
    text = f"{value.real:.10g}" + (f" {value.imag:+.10g}i" if value.imag else "")
    return UnsupportedSpectrum(
        f"the masks do not converge at {place}: an eigenvalue other than 1 has modulus >= 1, "
        f"{text}; change the scheme's vertex({faces})"
    )


def null_space(matrix: list[list[Fraction]]) -> list[list[Fraction]]:
    """Basis of the null space of a rational matrix, in reduced echelon form."""
    columns = len(matrix[0])
    rows = [row for row in reduced(matrix) if any(row)]
    pivots = [next(j for j, x in enumerate(row) if x) for row in rows]
    basis = []
    for free in sorted(set(range(columns)) - set(pivots)):
        vector = [Fraction(j == free) for j in range(columns)]
        for row, pivot in zip(rows, pivots, strict=True):
            vector[pivot] = -row[free]
        basis.append(vector)
    return basis


def reduced(matrix: list[list[Fraction]]) -> list[list[Fraction]]:
    """Reduced row echelon form."""
    rows = [list(row) for row in matrix]
    done = 0
    for column in range(len(rows[0])):
        pivot = next((i for i in range(done, len(rows)) if rows[i][column]), None)
        if pivot is None:
            continue
        rows[done], rows[pivot] = rows[pivot], rows[done]
        rows[done] = [x / rows[done][column] for x in rows[done]]
        for i, row in enumerate(rows):
            if i != done and row[column]:
                rows[i] = [x - row[column] * y for x, y in zip(row, rows[done], strict=True)]
        done += 1
        if done == len(rows):
            break
    return rows


def to_mpf(x: Any) -> Any:
    """A Fraction, or an algebraic number of sympy, to all digits of `mp`."""
    if isinstance(x, Fraction):
        return mp.mpf(x.numerator) / x.denominator
    return mp.mpf(x.evalf(mp.dps + 10)._mpf_)


def to_fixed(values: Any) -> Fixed:
    """Integers nearest below the values, in units of 2**-BITS, in an object array."""

    def one(x: Any) -> int:
        if isinstance(x, Fraction):
            return (x.numerator << BITS) // x.denominator
        x = to_mpf(x) if hasattr(x, "evalf") else mp.mpf(x)
        return int(fixed_point(x._mpf_, BITS))

    array = np.array(values, dtype=object)
    flat = [one(x) for x in array.ravel()]
    result = np.empty(len(flat), dtype=object)
    result[:] = flat
    return np.asarray(result.reshape(array.shape))


def product(left: Fixed, right: Fixed) -> Fixed:
    """The product of two matrices."""
    return np.asarray(left.dot(right) >> BITS)


def combine(row: dict[int, Any], vectors: dict[int, Fixed], length: int) -> Fixed:
    """Sparse row times those vectors that there are, (length,); sums of rational terms exactly."""
    items = [(k, w) for k, w in row.items() if k in vectors]
    known = [(k, w) for k, w in items if isinstance(w, Fraction)]
    scale = lcm(*(w.denominator for _, w in known))
    total = np.zeros(length, dtype=object)
    for k, w in known:
        total += int(w * scale) * vectors[k]
    total = total // scale
    for k, w in items if len(known) < len(items) else ():
        if not isinstance(w, Fraction):
            total += vectors[k] * to_fixed([w])[0] >> BITS
    return np.asarray(total)
