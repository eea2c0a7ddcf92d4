"""Compiled preparation of points: control points beyond the cage, and coefficients at corners."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels.evaluation import LANES
from limitsurf._kernels.jit import combination, inlined, lean, prefetch

Array = NDArray[Any]
SIX = 6  # rows of a matrix that are multiplied at once
_AHEAD = 4  # patches, and half as many as rows, that memory is asked for ahead of time

_sum6 = combination(SIX)


@inlined
def _high(high: Array, extras: Array, i: int, c: int) -> float:
    """A control point as it is rounded."""
    x: float = high[i, c] if i < len(high) else extras[i - len(high), c]
    return x


@inlined
def _low(high: Array, extras: Array, i: int, c: int) -> float:
    """What rounding took from it."""
    x: float = 0.0 if i < len(high) else extras[i - len(high), high.shape[1] + c]
    return x


@inlined
def _step(high: Array, extras: Array, i: int, first: int, c: int) -> float:
    """From one control point to another."""
    near = _high(high, extras, i, c) - _high(high, extras, first, c)
    step: float = near + (_low(high, extras, i, c) - _low(high, extras, first, c))
    return step


@lean
def extend(
    indptr: Array, columns: Array, values: Array, high: Array, extras: Array, bounds: Array,
    errors: Array, start: int,
) -> None:  # fmt: skip
    """Control points, sparse rows over those before, into extras from row `start` on.

    Each is formed relative to its first term, so that no digits are lost far from the origin, nor
    among points that are close to each other; see `reference.differences` and `two_sum`. What
    rounding does to its coordinates is bounded as by `reference.errors` in bounds (m, channels);
    errors (m,) get the largest.
    """
    width, inner = high.shape[1], len(high)
    for r in range(len(indptr) - 1):
        later = min(r + 2 * _AHEAD, len(indptr) - 2)
        for k in range(indptr[later], indptr[later + 1]):
            prefetch(high, min(columns[k], inner - 1) * width)
        row, first = start + r, columns[indptr[r]]
        more = max((indptr[r + 1] - indptr[r]) / 16, 1.0)  # longer sums have larger errors
        for k in range(indptr[r], indptr[r + 1]):
            i, weight = columns[k], values[k]
            for channel in range(0, width, LANES):
                for c in range(channel, channel + LANES):
                    # sums grow where they will be rounded
                    extras[row, c] += weight * _step(high, extras, i, first, c)
            for c in range(bounds.shape[1]):
                far = abs(_step(high, extras, i, first, c)) * more
                far += bounds[i - inner, c] if i >= inner else 0.0
                bounds[row, c] += abs(weight) * far
        for c in range(bounds.shape[1]):
            errors[row] = max(errors[row], bounds[row, c])
        for c in range(width):
            own, rest = _high(high, extras, first, c), _low(high, extras, first, c)
            step = extras[row, c]
            total = own + step
            part = total - own
            error = (own - (total - part)) + (step - part)
            extras[row, c] = total
            extras[row, width + c] = rest + error


@lean
def coefficients(
    ids: Array, high: Array, extras: Array, errors: Array, matrix: Array, modes: Array, fine: Array,
    near: Array, sums: Array,
) -> None:  # fmt: skip
    """Coefficients and refined points of special patches with control points ids (P, K).

    high (n, width), extras (m, 2 width), errors (m,) as in ``evaluation.Points``; matrix
    (K + REFINED, rounded up to `SIX`; K, rounded up to `LANES`) has left eigenvectors and rows of
    refined points; modes (P, ROWS + 3, width) and fine (P, REFINED + 2, width) are zero and get
    what ``evaluation.Points`` says.
    near (K, rounded up; `LANES`) is flat and zero, sums (`SIX`, `LANES`) are room.
    """
    K, size, width = ids.shape[1], matrix.shape[1], high.shape[1]
    last, refined = modes.shape[1] - 1, fine.shape[1] - 2
    for p in range(len(ids)):
        for k in range(K if p + _AHEAD < len(ids) else 0):
            prefetch(high, min(np.int64(ids[p + _AHEAD, k]), len(high) - 1) * width)
        own: int = ids[p, 0]
        first = -1
        largest = size_of_points = 0.0
        for channel in range(0, width, LANES):
            for k in range(K):
                i: int = ids[p, k]
                error = errors[i - len(high)] if i >= len(high) else 0.0
                for c in range(LANES):
                    x = _step(high, extras, i, own, channel + c)
                    near[k * LANES + c] = x
                    size_of_points = max(size_of_points, abs(x) + error)
            for begin in range(0, K + refined, SIX):
                _sum6(matrix[begin : begin + SIX], size, near, 0, LANES, sums)
                for r in range(begin, min(begin + SIX, K)):
                    for c in range(LANES):
                        modes[p, r, channel + c] = sums[r - begin, c]
                for r in range(max(begin, K), min(begin + SIX, K + refined)):
                    for c in range(LANES):
                        fine[p, r - K, channel + c] = sums[r - begin, c]
            for r in range(1, K):
                for c in range(channel, channel + LANES):
                    x = modes[p, r, c]
                    if x != 0 and (first < 0 or r < first):
                        first = r
                    if not abs(x) <= largest:
                        largest = abs(x)
            for c in range(channel, channel + LANES):
                low, rounded = _low(high, extras, own, c), _high(high, extras, own, c)
                modes[p, 0, c] += low
                modes[p, last - 1, c] = rounded
                fine[p, refined, c], fine[p, refined + 1, c] = low, rounded
        modes[p, last, 0] = largest
        modes[p, last, 1] = max(1, first)
        modes[p, last, 2] = size_of_points


@lean
def copies(
    ids: Array, own_point: int, which: Array, high: Array, extras: Array, fine: Array
) -> None:
    """Control points ids (patches, n) of some of the patches, relative to one, into fine.

    fine (len(which), REFINED + 2, width) as in ``evaluation.Points``.
    """
    last = fine.shape[1] - 1
    for p in range(len(which)):
        own: int = ids[which[p], own_point]
        for c in range(high.shape[1]):
            rounded, low = _high(high, extras, own, c), _low(high, extras, own, c)
            for k in range(ids.shape[1]):
                i: int = ids[which[p], k]
                step = _high(high, extras, i, c) - rounded
                fine[p, k, c] = step + (_low(high, extras, i, c) - low)
            fine[p, last - 1, c], fine[p, last, c] = low, rounded
