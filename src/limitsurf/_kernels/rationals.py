"""Exact arithmetic on many rational numbers >= 0 at once, in NumPy.

Rounding must not decide whether a sharpness has reached 0. `Digits` are integers over one common
denominator, written in digits of 30 bits: columns of machine integers instead of one object for
each number. `Objects` do the same with Fractions, where a common denominator would be too long.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import lcm
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.numbers import RATIONAL, type_of

Array = NDArray[Any]

_BITS = 30
_MASK = (1 << _BITS) - 1
_LONGEST = 2048  # bits of a denominator up to which digits are faster than Fractions


def rationals(values: Array) -> Digits | Objects:
    """The rationals that finite floats >= 0, or Fractions, are; (n,)."""
    if type_of(values).exact:
        values = RATIONAL.array(values)
        unit = 1
        for denominator in {x.denominator for x in values.tolist()}:
            unit = lcm(unit, denominator)
            if unit.bit_length() > _LONGEST:
                return Objects(values)
        whole = np.empty(len(values), dtype=object)
        whole[:] = [x.numerator * (unit // x.denominator) for x in values.tolist()]
        return Digits(_digits(whole), unit)
    return _of_floats(values)


def _of_floats(values: Array) -> Digits:
    mantissa, exponent = np.frexp(values)
    whole = (mantissa * 2.0**53).astype(np.int64)
    zeros = np.frexp((whole & -whole).astype(float))[1] - 1  # at the end, in binary
    places = np.where(whole > 0, 53 - exponent - zeros, 0)
    power = max(0, int(places.max(initial=0)))
    top = max(0, int(exponent.max(initial=0)) + power)
    rest, rows = values, []
    for j in range(top // _BITS, -1, -1):
        # the leading bits of what is left: nothing is rounded
        digit = np.floor(np.ldexp(rest, power - _BITS * j))
        rest = rest - np.ldexp(digit, _BITS * j - power)
        rows.append(digit.astype(np.int64))
    return Digits(_trimmed(np.array(rows[::-1])), 1 << power)


@dataclass(frozen=True, eq=False)
class Digits:
    """Rational numbers >= 0 with one denominator.

    Attributes
    ----------
    digits : (L, n) int64
        In [0, 2^30), lowest first: number k is ``sum(digits[j, k] * 2**(30 j)) / unit``.
    unit : int
    """

    digits: Array
    unit: int

    def __len__(self) -> int:
        return int(self.digits.shape[1])

    def take(self, places: Array) -> Digits:
        """The numbers at some places, (m,)."""
        return Digits(self.digits[:, places], self.unit)

    def spread(self, places: Array, n: int) -> Digits:
        """The numbers at distinct places of n, all others 0."""
        digits = np.zeros((len(self.digits), n), dtype=np.int64)
        digits[:, places] = self.digits
        return Digits(digits, self.unit)

    def summed(self, places: Array, n: int) -> Digits:
        """The sums of the numbers by place, (n,)."""
        # of less than 2^23 terms each: exact
        rows = [np.bincount(places, weights=x, minlength=n) for x in self.digits]
        digits = np.array(rows).astype(np.int64)
        return Digits(_trimmed(_carried(digits, len(digits) + 1)), self.unit)

    def times(self, factors: Array) -> Digits:
        """The numbers times integers >= 0, (n,)."""
        return Digits(_product(self.digits, _digits(factors)), self.unit)

    def over(self, divisors: Array) -> Digits:
        """The numbers divided by positive integers, (n,)."""
        common = lcm(1, *np.unique(divisors).tolist())
        return self.times(common // counting(divisors, common)).per(common)

    def per(self, divisor: int) -> Digits:
        """The numbers divided by a positive integer."""
        return Digits(self.digits, self.unit * divisor)

    def __add__(self, other: Digits | Objects) -> Digits | Objects:
        if isinstance(other, Objects):
            return Objects(self.fractions() + other.values)
        one, two, unit = _common(self, other)
        return Digits(_trimmed(_carried(one + two, len(one) + 1)), unit)

    def __sub__(self, other: Digits | Objects) -> Digits | Objects:
        """Differences; 0 instead of negative ones."""
        if isinstance(other, Objects):
            return Objects(self.fractions()) - other
        one, two, unit = _common(self, other)
        digits = _carried(one - two, len(one))
        digits[:, digits[-1] < 0] = 0
        return Digits(_trimmed(digits), unit)

    @property
    def positive(self) -> Array:
        """Whether numbers are not 0, (n,) bool."""
        return np.asarray(self.digits.any(axis=0))

    def fractions(self) -> Array:
        """As an object array of Fractions."""
        result = np.empty(len(self), dtype=object)
        result[:] = [Fraction(x, self.unit) for x in self._integers().tolist()]
        return result

    def _integers(self) -> Array:
        whole = np.zeros(len(self), dtype=object)
        for row in self.digits[::-1]:
            whole = whole * (1 << _BITS) + row.astype(object)
        return whole

    def floats(self) -> Array:
        """As float64, correctly rounded (but for those next to 0, without all bits)."""
        odd = self.unit // (self.unit & -self.unit)
        power = self.unit.bit_length() - odd.bit_length()
        divisors = _small_factors(odd)
        if divisors is None:
            return np.array([x / self.unit for x in self._integers().tolist()], dtype=float)
        # zeros at the end, so that quotients have 60 bits and more
        more = (odd.bit_length() + 62) // _BITS + 1
        digits = np.concatenate([np.zeros((more, len(self)), np.int64), self.digits])
        inexact = np.zeros(len(self), dtype=bool)
        for divisor in divisors:
            rest = np.zeros(len(self), dtype=np.int64)
            for row in digits[::-1]:
                rest <<= _BITS
                rest |= row
                np.divmod(rest, divisor, out=(row, rest))
            inexact |= rest != 0
        mantissa, exponent = _rounded(digits, inexact)
        return np.asarray(np.ldexp(mantissa, exponent - (power + _BITS * more)))

    def codes(self) -> Array:
        """Numbers for the numbers: equal ones have equal codes, (n,)."""
        order = np.lexsort(self.digits)
        there = self.digits[:, order]
        new = (there[:, 1:] != there[:, :-1]).any(axis=0)
        result = np.empty(len(self), dtype=np.int64)
        result[order] = np.concatenate([[0], np.cumsum(new)])[: len(self)]
        return result


@dataclass(frozen=True, eq=False)
class Objects:
    """What `Digits` are, as an object array of Fractions (n,)."""

    values: Array

    def __len__(self) -> int:
        return len(self.values)

    def take(self, places: Array) -> Objects:
        """The numbers at some places, (m,)."""
        return Objects(self.values[places])

    def spread(self, places: Array, n: int) -> Objects:
        """The numbers at distinct places of n, all others 0."""
        values = np.full(n, Fraction(0), dtype=object)
        values[places] = self.values
        return Objects(values)

    def summed(self, places: Array, n: int) -> Objects:
        """The sums of the numbers by place, (n,)."""
        total = np.full(n, Fraction(0), dtype=object)
        np.add.at(total, places, self.values)
        return Objects(total)

    def times(self, factors: Array) -> Objects:
        """The numbers times integers >= 0, (n,)."""
        return Objects(self.values * factors.astype(object))

    def over(self, divisors: Array) -> Objects:
        """The numbers divided by positive integers, (n,)."""
        return Objects(self.values / divisors.astype(object))

    def per(self, divisor: int) -> Objects:
        """The numbers divided by a positive integer."""
        return Objects(self.values / Fraction(divisor))

    def __add__(self, other: Digits | Objects) -> Objects:
        return Objects(self.values + other.fractions())

    def __sub__(self, other: Digits | Objects) -> Objects:
        """Differences; 0 instead of negative ones."""
        rest = np.maximum(self.values - other.fractions(), np.array(Fraction(0), dtype=object))
        return Objects(rest)

    @property
    def positive(self) -> Array:
        """Whether numbers are not 0, (n,) bool."""
        return np.asarray(self.values != 0, dtype=bool)

    def fractions(self) -> Array:
        """The array."""
        return self.values

    def floats(self) -> Array:
        """As float64, correctly rounded."""
        return self.values.astype(float)

    def codes(self) -> Array:
        """Numbers for the numbers: equal ones have equal codes, (n,)."""
        return np.asarray(np.unique(self.values, return_inverse=True)[1])


def counting(numbers: Array, largest: int) -> Array:
    """Integers as such that products up to `largest` do not overflow."""
    return numbers.astype(np.int64 if largest < 1 << 62 else object)


def integers(numbers: Array) -> Digits:
    """Integers >= 0, (n,), of machine size or Python's own."""
    return Digits(_digits(numbers), 1)


def _digits(whole: Array) -> Array:
    """The digits of integers >= 0."""
    rows = [whole & _MASK]
    while (whole := whole >> _BITS).any():
        rows.append(whole & _MASK)
    return np.array([row.astype(np.int64) for row in rows])


def _carried(digits: Array, length: int) -> Array:
    """Digits in [0, 2^30), but for the last, which has the sign, from sums or differences."""
    result = np.zeros((length, digits.shape[1]), dtype=np.int64)
    result[: len(digits)] = digits
    for j in range(length - 1):
        result[j + 1] += result[j] >> _BITS
        result[j] &= _MASK
    return result


def _trimmed(digits: Array) -> Array:
    """Without digits that are 0 in all numbers."""
    while len(digits) > 1 and not digits[-1].any():
        digits = digits[:-1]
    return digits


def _product(one: Array, other: Array) -> Array:
    """The digits of products."""
    if len(one) < len(other):
        one, other = other, one
    length = len(one) + len(other)
    width = max(one.shape[1], other.shape[1]) if min(one.shape[1], other.shape[1]) else 0
    result = np.zeros((length, width), dtype=np.int64)
    for j, row in enumerate(other):
        result[j : j + len(one)] += one * row  # below 2^60, and what is there below 2^30
        result = _carried(result, length)
    return _trimmed(result)


def _common(one: Digits, other: Digits) -> tuple[Array, Array, int]:
    """The digits of both, of one length, in a common unit."""
    unit = lcm(one.unit, other.unit)
    both = [
        x.digits
        if x.unit == unit
        else _product(x.digits, _digits(np.array([unit // x.unit], dtype=object)))
        for x in (one, other)
    ]
    length = max(map(len, both))
    return *(np.pad(x, ((0, length - len(x)), (0, 0))) for x in both), unit  # type: ignore


def _small_factors(odd: int) -> list[int] | None:
    """Factors below 2^32 of an odd integer, few of them; None if some are not found."""
    factors, factor, prime = [], 1, 3
    while odd >= 1 << 32 and prime < 1 << 16:
        if odd % prime:
            prime += 2
            continue
        odd //= prime
        if factor * prime >= 1 << 32:
            factors.append(factor)
            factor = 1
        factor *= prime
    return None if odd >= 1 << 32 else [x for x in (*factors, factor, odd) if x > 1]


def _rounded(digits: Array, inexact: Array) -> tuple[Array, Array]:
    """Mantissas and powers of two of integers, 0 or at least 2^60, rounded to 53 bits.

    The `inexact` ones are a little more, by less than 1.
    """
    top = len(digits) - 1 - (digits[::-1] != 0).argmax(axis=0)  # of 0: anything
    top = np.maximum(top, 2)
    every = np.arange(digits.shape[1])
    first, second, third = (digits[top - k, every] for k in range(3))
    below = np.cumsum(digits != 0, axis=0)
    inexact = inexact | (np.where(top > 2, below[top - 3, every], 0) > 0)
    # 62 bits of the three, and whether there are any others: conversion rounds as if it had all
    length = np.frexp(first.astype(float))[1].astype(np.int64)
    mantissa = first << _BITS | second
    mantissa <<= 32 - length
    shift = length - 2
    mantissa |= np.where(shift >= 0, third >> np.maximum(shift, 0), third << np.maximum(-shift, 0))
    inexact |= (third & ((1 << np.maximum(shift, 0)) - 1)) != 0
    return (mantissa | inexact).astype(float), _BITS * (top - 2) + shift
