"""Numbers for spectra: integers in units of 2**-bits, and exact rational elimination.

By default of 320 bits, about 96 digits: deterministic on every machine, and fast enough that
valence 360 takes seconds.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from functools import lru_cache
from math import lcm
from typing import Any

import mpmath
import numpy as np
from mpmath.libmp import to_fixed as fixed_point

BITS = 320  # of numbers of which nothing else is said

Fixed = np.ndarray[Any, np.dtype[np.object_]]


class UnsupportedSpectrum(ValueError):  # noqa: N818  (users catch it by this name)
    """Masks that do not converge, complex eigenvalues, or Jordan blocks that are not handled."""


def diverging(place: str, faces: int, eigenvalue: Any, mask: str = "vertex") -> UnsupportedSpectrum:
    """The error that says where refinement has no limit, and of which eigenvalue."""
    return UnsupportedSpectrum(
        f"the masks do not converge at {place}: an eigenvalue other than 1 has modulus >= 1, "
        f"{in_words(eigenvalue)}; change the scheme's {mask}({faces})"
    )


def in_words(eigenvalue: Any) -> str:
    """A real or complex number in ten digits."""
    value = complex(eigenvalue)
    return f"{value.real:.10g}" + (f" {value.imag:+.10g}i" if value.imag else "")


@contextmanager
def named(scheme: str) -> Iterator[None]:
    """Have errors that say what is wrong with a spectrum say of which scheme."""
    try:
        yield
    except UnsupportedSpectrum as error:
        start = f"scheme {scheme!r}: "
        if str(error).startswith(start):
            raise
        raise UnsupportedSpectrum(start + str(error)) from None


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


class Precision:
    """How exact numbers are that are not rational, and what is computed with them.

    Attributes
    ----------
    bits : int
        Fixed numbers are integers in units of ``2**-bits``.
    mp : MPContext
        For numbers with an exponent, of 64 more bits. One of our own: the precision of `mpmath.mp`
        belongs to the user, in all threads at once.
    equal : mpf
        Two computed eigenvalues, or a numerator and zero, that agree to this are equal: to 60
        digits of 96. Derived in ``derivations/analysis.py``, section 5.
    """

    def __init__(self, bits: int) -> None:
        self.bits = bits
        self.mp = mpmath.MPContext()
        self.mp.prec = bits + 64
        self.equal = self.mp.mpf(10) ** -(bits * 3 // 16)

    @staticmethod
    @lru_cache(maxsize=16)
    def of(bits: int) -> Precision:
        """The one of so many bits."""
        return Precision(bits)

    def to_mpf(self, x: Any) -> Any:
        """A Fraction, or an algebraic number of sympy, to all digits of `mp`."""
        if isinstance(x, Fraction):
            return self.mp.mpf(x.numerator) / x.denominator
        return self.mp.mpf(_digits(x, self.mp.dps + 10))

    def to_fixed(self, values: Any) -> Fixed:
        """Integers nearest below the values, in an object array."""
        bits = self.bits

        def one(x: Any) -> int:
            if isinstance(x, Fraction):
                return (x.numerator << bits) // x.denominator
            x = self.to_mpf(x) if hasattr(x, "evalf") else self.mp.mpf(x)
            return int(fixed_point(x._mpf_, bits))

        array = np.array(values, dtype=object)
        flat = [one(x) for x in array.ravel()]
        result = np.empty(len(flat), dtype=object)
        result[:] = flat
        return np.asarray(result.reshape(array.shape))

    def product(self, left: Fixed, right: Fixed) -> Fixed:
        """The product of two matrices."""
        return np.asarray(left.dot(right) >> self.bits)

    def combine(self, row: dict[int, Any], vectors: dict[int, Fixed], length: int) -> Fixed:
        """Sparse row times those vectors that there are, (length,); rational terms exactly."""
        items = [(k, w) for k, w in row.items() if k in vectors]
        known = [(k, w) for k, w in items if isinstance(w, Fraction)]
        scale = lcm(*(w.denominator for _, w in known))
        total = np.zeros(length, dtype=object)
        for k, w in known:
            total += int(w * scale) * vectors[k]
        total = total // scale
        for k, w in items if len(known) < len(items) else ():
            if not isinstance(w, Fraction):
                total += vectors[k] * self.to_fixed([w])[0] >> self.bits
        return np.asarray(total)

    def is_noise(self, x: int) -> bool:
        """Whether nothing but rounding can be left of a number: less than half of its digits."""
        return abs(x) >> (self.bits // 2) == 0


@lru_cache(maxsize=4096)
def _digits(x: Any, digits: int) -> Any:
    """An algebraic number of sympy as mpmath has it; masks have few of them, in many places."""
    return x.evalf(digits)._mpf_


STANDARD = Precision.of(BITS)
mp, EQUAL, to_mpf, to_fixed = STANDARD.mp, STANDARD.equal, STANDARD.to_mpf, STANDARD.to_fixed
product = STANDARD.product
