"""Numbers of a text, converted eight digits at a time, all words of it together.

Only the plain ones, such as ``-12.5``: of the others it is said that they are not.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]

PADDING = 32  # bytes that a text has before and after its words
_CHUNK = 1 << 14  # words whose arrays stay in a cache of the processor
_EIGHTY = np.uint64(0x8080808080808080)
_ABOVE_9 = np.uint64(0x7676767676767676)  # plus a byte above 9 has the high bit set
_ZEROS = np.uint64(0x3030303030303030)
# one step joins neighbours: digits to pairs, these to fours, these to eight
_STEPS = [
    (np.uint64(10), np.uint64(8), np.uint64(0x00FF00FF00FF00FF)),
    (np.uint64(100), np.uint64(16), np.uint64(0x0000FFFF0000FFFF)),
    (np.uint64(10000), np.uint64(32), np.uint64(0x00000000FFFFFFFF)),
]
_POWERS = 10.0 ** np.arange(23)  # each of them exact
_TENS = np.uint64(10) ** np.arange(20, dtype=np.uint64)
_SPLIT = 2.0**27 + 1


def integers(text: NDArray[np.uint8], low: IntArray, high: IntArray) -> tuple[IntArray, BoolArray]:
    """What stands in text[low:high] (n,), 0 where that is no integer of up to 8 digits; and where.

    The text is padded as `PADDING` says.
    """
    values: IntArray = np.zeros(len(low), dtype=np.int64)
    return values, _in_chunks(_integers, values, text, low, high)


def decimals(
    text: NDArray[np.uint8], low: IntArray, high: IntArray
) -> tuple[NDArray[np.float64], BoolArray]:
    """The float64 next to the decimals in text[low:high] (n,), and which of them are that plain.

    Those are of a sign or none, up to 8 digits, a point and more digits, or an integer alone. The
    others are 0 here.
    """
    values = np.zeros(len(low))
    return values, _in_chunks(_decimals, values, text, low, high)


def _in_chunks(
    convert: Callable[..., tuple[Any, Any]],
    values: NDArray[Any],
    text: NDArray[np.uint8],
    low: IntArray,
    high: IntArray,
) -> BoolArray:
    """Fill in values, and tell which of them are right."""
    right = np.zeros(len(low), dtype=bool)
    # the eight bytes from each place on, as one number whose lowest byte is the first of them
    eights = np.ndarray(len(text) - 7, "<u8", text.data, strides=(1,))
    with np.errstate(over="ignore"):
        for i in range(0, len(low), _CHUNK):
            part = slice(i, i + _CHUNK)
            found, good = convert(text, eights, low[part], high[part])
            right[part] = good
            values[part] = np.where(good, found, 0)
    return right


def _unsigned(text: NDArray[np.uint8], low: IntArray) -> tuple[BoolArray, IntArray]:
    """Where there is a minus, and where the digits begin, behind it or a plus."""
    sign = text[low]
    minus: BoolArray = sign == ord("-")
    return minus, low + (minus | (sign == ord("+")))


def _eight(eights: NDArray[Any], high: IntArray, count: IntArray) -> tuple[Any, BoolArray]:
    """The digits before a place, so many of them, from 0 to 8, and whether they are digits."""
    value = eights[high - 8] ^ _ZEROS
    shift = ((8 - count) * 8).astype(np.uint64)
    value = (value >> shift) << shift  # NumPy leaves 0 of a shift by 64
    good: BoolArray = ((value + _ABOVE_9) | value) & _EIGHTY == 0
    for factor, bits, mask in _STEPS:
        value = (value * factor + (value >> bits)) & mask
    return value, good


def _integers(
    text: NDArray[np.uint8], eights: NDArray[Any], low: IntArray, high: IntArray
) -> tuple[IntArray, BoolArray]:
    minus, first = _unsigned(text, low)
    count = high - first
    inside = (count > 0) & (count <= 8)
    found, good = _eight(eights, high, np.where(inside, count, 0))
    signed = found.astype(np.int64)
    return np.where(minus, -signed, signed), good & inside


def _decimals(
    text: NDArray[np.uint8], eights: NDArray[Any], low: IntArray, high: IntArray
) -> tuple[NDArray[np.float64], BoolArray]:
    minus, first = _unsigned(text, low)
    point = _points(text, first, high)
    whole = point - first
    fraction = np.maximum(high - point - 1, 0)  # how many digits there are
    good: BoolArray = (whole >= 0) & (whole <= 8) & (fraction <= 22) & (whole + fraction > 0)
    if not good.all():
        whole, fraction = np.where(good, [whole, fraction], 0)
    mantissa, digits = _eight(eights, point, whole)
    good &= digits
    estimate = mantissa * _POWERS[fraction]
    mantissa *= _TENS[np.minimum(fraction, 19)]
    for place in 0, 8, 16:  # of digits of the fraction, from its end
        some: Any = np.flatnonzero(fraction > place)
        if len(some) == len(low):
            some = slice(None)
        elif not len(some):
            break
        count = np.minimum(fraction[some] - place, 8)
        part, digits = _eight(eights, high[some] - place, count)
        good[some] &= digits
        estimate[some] += part * _POWERS[place]
        mantissa[some] += part * _TENS[place]
    good &= estimate < 2.0**63 * 0.99  # what is larger may have lost digits
    mantissa[~good] = 0
    values, sure = _quotients(mantissa.view(np.int64), fraction)
    np.negative(values, out=values, where=minus)
    return values, good & sure


def _points(text: NDArray[np.uint8], low: IntArray, high: IntArray) -> IntArray:
    """Where in text[low:high] the first point is, among 9 bytes, or the end if there is none."""
    found = low + 1  # as in 1.25
    left = np.flatnonzero(text[found] != ord("."))
    at, end = low[left], high[left]
    found[left] = end
    for _ in range(9):
        there = (text[at] == ord(".")) & (at < end)
        found[left[there]] = at[there]
        left, at, end = left[~there], at[~there] + 1, end[~there]
        if not len(left):
            break
    return found


def _quotients(mantissa: IntArray, power: IntArray) -> tuple[NDArray[np.float64], BoolArray]:
    """The float64 next to mantissa / 10**power (n,), and where it is known to be that one.

    The quotient is found as a sum of two floats, to 100 bits: 2 roundings of 2^-53 times a
    remainder that is 2^-52 of it at the most. The nearest float64 is the first of the sum, unless
    the second is that close to half of the distance to its neighbours.
    """
    head = mantissa.astype(np.float64)
    tail = (mantissa - head.astype(np.int64)).astype(np.float64)  # exact: less than 2^11
    divisor = _POWERS[power]
    quotient = head / divisor
    # Dekker's product: quotient * divisor is product + error exactly
    product = quotient * divisor
    high = quotient * _SPLIT
    high -= high - quotient
    low = quotient - high
    other_high = divisor * _SPLIT
    other_high -= other_high - divisor
    other_low = divisor - other_high
    error = high * other_high - product + high * other_low + low * other_high + low * other_low
    rest = (head - product - error + tail) / divisor
    values = quotient + rest
    second = np.abs(rest - (values - quotient))
    half = np.spacing(values) / 2
    # a power of two has a nearer neighbour below
    close = np.abs(second - half) < 2.0**-40 * half
    close |= np.abs(second - half / 2) < 2.0**-40 * half
    return values, ~close
