"""What a number is: float64, or Fractions in object arrays.

The rooms ask a `NumberType` for what differs between them, and nothing else; another type is one
more instance. Sums, products and quotients of exact numbers are exact, and they have no roots.

>>> from limitsurf import numbers
>>> numbers.common([0.5, 1.0], [2]).name
'float64'
>>> numbers.RATIONAL.array([0.5, 2]).tolist()
[Fraction(1, 2), Fraction(2, 1)]
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from fractions import Fraction
from numbers import Rational
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

Array = NDArray[Any]
# what a call takes for numbers, of which lists may be nested and mixed: numbers as they are, those
# that are exact, any
Real: TypeAlias = np.floating[Any] | np.integer[Any]
Plain: TypeAlias = "float | Real | NDArray[Real] | Sequence[Plain]"
Exact: TypeAlias = "Fraction | NDArray[np.object_] | Sequence[Exact]"
Numbers: TypeAlias = "ArrayLike | Fraction | Sequence[Numbers]"


FAR = np.int64(1 << 40)  # more halvings than any number that is not 0 has


class NumberType(ABC):
    """A type of numbers, as elements of arrays.

    Attributes
    ----------
    name : str
    dtype : dtype
        Of arrays of such numbers.
    exact : bool
        Whether sums, products and quotients are; then there are no roots.
    one, zero
        As elements of arrays.
    """

    name: str
    dtype: np.dtype[Any]
    exact: bool
    one: Any
    zero: Any

    @abstractmethod
    def array(self, values: Any) -> Array:
        """Numbers as an array of this type; what is not exact here is rounded once."""

    @abstractmethod
    def finite(self, values: Array) -> Array:
        """Which numbers are finite, a bool array of their shape."""

    @abstractmethod
    def halvings(self, values: Array, up: Array) -> Array:
        """Largest k >= 0 with 2^k x <= 1 (< 1 where `up`, unless x is 1); `FAR` for x = 0; (Q,)."""

    @abstractmethod
    def scaled(self, values: Array, n: Array) -> Array:
        """``x * 2 ** n`` for integers n (Q,), exact up to underflow and overflow (inf)."""

    def full(self, shape: int | tuple[int, ...], value: Any) -> Array:
        """An array of one number."""
        return np.full(shape, value, dtype=self.dtype)

    def __repr__(self) -> str:
        return f"<numbers of type {self.name}>"


class _Float64(NumberType):
    name, dtype, exact = "float64", np.dtype(float), False
    one, zero = 1.0, 0.0

    def array(self, values: Any) -> Array:
        return np.asarray(values).astype(float, copy=False)

    finite = staticmethod(np.isfinite)  # type: ignore[assignment]

    def halvings(self, values: Array, up: Array) -> Array:
        mantissa, exponent = np.frexp(values)
        k = np.where((mantissa == 0.5) & ~up, 1 - exponent, -exponent).astype(np.int64)
        k[values == 0] = FAR
        return np.maximum(k, 0)

    def scaled(self, values: Array, n: Array) -> Array:
        with np.errstate(over="ignore", under="ignore"):
            return np.ldexp(values, np.clip(n, -(10**8), 10**8).astype(np.int32))


class _Rational(NumberType):
    name, dtype, exact = "Fraction", np.dtype(object), True
    one, zero = Fraction(1), Fraction(0)

    def array(self, values: Any) -> Array:
        array = np.asarray(values)
        if array.dtype != self.dtype:
            array = array.astype(object)
        flat = [x if type(x) is Fraction else _rational(x) for x in array.ravel().tolist()]
        result = np.empty(len(flat), dtype=object)
        result[:] = flat
        return result.reshape(array.shape)

    def finite(self, values: Array) -> Array:
        return np.asarray(values == values, dtype=bool)  # infinities have become NaN

    def halvings(self, values: Array, up: Array) -> Array:
        # -log2 from numerator and denominator, then corrected by one exactly
        k = np.array([_floor_log2(1 / y) if y else FAR for y in values], dtype=np.int64)
        ones = [bool(y) and y * 2 ** int(j) == 1 for y, j in zip(values, k, strict=True)]
        return np.maximum(k - (np.array(ones, dtype=bool) & up), 0)

    def scaled(self, values: Array, n: Array) -> Array:
        return np.asarray(values * np.array([Fraction(2) ** int(k) for k in n], dtype=object))


FLOAT64: NumberType = _Float64()
RATIONAL: NumberType = _Rational()


def type_of(what: Array | DTypeLike | NumberType) -> NumberType:
    """The type of the numbers of an array, or that an array of such a dtype has."""
    if isinstance(what, NumberType):
        return what
    dtype = what.dtype if isinstance(what, np.ndarray) else np.dtype(what)
    return RATIONAL if dtype == RATIONAL.dtype else FLOAT64


def common(*arrays: Any) -> NumberType:
    """The type of what is computed from several arrays: exact if any is of exact numbers."""
    exact = any(type_of(np.asarray(x)).exact for x in arrays)
    return RATIONAL if exact else FLOAT64


def _rational(x: Any) -> Any:
    if isinstance(x, (Rational, np.integer)):
        return Fraction(int(x)) if isinstance(x, np.integer) else Fraction(x)
    if isinstance(x, (float, np.floating)):
        return Fraction(float(x)) if np.isfinite(x) else float("nan")
    raise TypeError(
        f"numbers of type {type(x).__name__} are not supported: give Fractions, ints or floats"
    )


def _floor_log2(x: Fraction) -> int:
    k = x.numerator.bit_length() - x.denominator.bit_length()
    return k if x >= Fraction(2) ** k else k - 1
