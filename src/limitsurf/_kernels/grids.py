"""Compiled evaluation of the same parameters on many faces: one product of matrices a face.

What depends on the parameters alone, weights of control points or of coefficients, is tabulated
once for each kind and turn of patches.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels.evaluation import (
    FAR,
    KIND,
    MODES,
    ROW,
    ROWS,
    TURN,
    TURNS,
    patches_of,
    points_of,
    tables_of,
)
from limitsurf._kernels.jit import inlined, lean, products

Array = NDArray[Any]
PLACES = 8  # parameters that are handled at once
# sine of the angle between derivatives above which their cross product is accurate
_CLEAR = 1e-2
_LEAST = 1e-10  # of the size of the patch: shorter ones may be noise

_products1, _products3 = products(1), products(3)


class Weights(NamedTuple):
    """Weights for some derivatives at parameters, by kind and turn of a patch."""

    start: Array  # (kinds, 4) int64: where those of a patch begin, -1 where they are not known
    table: Array  # flat: (derivatives, rows, places) of each, places a multiple of `PLACES`
    places: int


@inlined
def _across(sums: Array, places: int, size: float) -> None:
    """Unit vectors across both derivatives in `sums` into its third row; 0 where in doubt."""
    least = (_LEAST * size) ** 2
    for q in range(places):
        a0, a1, a2 = sums[0, 0, q], sums[0, 1, q], sums[0, 2, q]
        b0, b1, b2 = sums[1, 0, q], sums[1, 1, q], sums[1, 2, q]
        c0, c1, c2 = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
        a, b = a0 * a0 + a1 * a1 + a2 * a2, b0 * b0 + b1 * b1 + b2 * b2
        c = c0 * c0 + c1 * c1 + c2 * c2
        clear = (a > least) & (b > least) & (c > _CLEAR**2 * a * b) & (c > 1e-280) & (c < 1e280)
        scale = 1 / sqrt(c) if clear else 0.0
        sums[2, 0, q], sums[2, 1, q], sums[2, 2, q] = c0 * scale, c1 * scale, c2 * scale


def gridder(shape: Any) -> Any:
    """The kernel that evaluates grids of queries, for faces of a shape."""
    own_size, own_point = shape.POINTS, shape.OWN

    @lean
    def gridded(
        faces: Array, words: Array, starts: Array, weights: Array, stride: int, count: int,
        places: int, position: int, normals: bool, out: Array, start: int, rest: Array, near: Array,
        sums: Array,
    ) -> int:  # fmt: skip
        """Derivatives, or unit normals, at the same `places` parameters on each face.

        Words are those of a block of patches, tables and points; starts, weights and stride are
        `Weights`.
        Results are written to ``out[k, (start + f) * places + place, channel]`` for the `count`
        derivatives k of the weights, of which number `position` (or -1) is the position; normals
        need two, along u and v. Queries that are left to others are written to `rest`; returned is
        how many there are, or -1 if a face is out of range. near (64,) and sums
        (6, 3, stride) are room.
        """
        patches, tables, points = patches_of(words), tables_of(words), points_of(words)
        width, d = points.high.shape[1], out.shape[2]
        channels = 3 if d == 3 else 1
        left = 0
        for f in range(len(faces)):
            if faces[f] < 0 or faces[f] >= patches.n_faces:
                return -1
            code = patches.info[faces[f]]
            kind, row, turn = code >> KIND, code & ROW, code >> TURN & TURNS
            table = -1 if code < 0 else starts[kind, turn]
            size, block, own = own_size, 0, np.int64(0)
            if table >= 0 and kind > 1:
                size = tables.kinds[kind, ROWS]
                block = (tables.kinds[kind, MODES] + row * (size + 3)) * width
                if points.modes[block + (size + 2) * width + 1] != 1:
                    table = -1
            if table < 0 or (kind <= 1 and code >> FAR & 1):
                for q in range(places):
                    rest[left] = (start + f) * places + q
                    left += 1
                continue
            for channel in range(0, d, channels):
                reach = 0.0
                if kind <= 1:
                    own = np.int64(patches.ids[row * own_size + own_point])
                    for j in range(own_size):
                        i = np.int64(patches.ids[row * own_size + j])
                        for c in range(channels):
                            x = points.high[i, channel + c] - points.high[own, channel + c]
                            near[j * 4 + c] = x
                            reach = max(reach, abs(x))
                else:
                    sizes = block + (size + 2) * width
                    reach = max(points.modes[sizes], points.modes[sizes + 2])
                first = block + width + channel
                for k in range(count):
                    for begin in range(0, stride, PLACES):
                        at = table + k * size * stride + begin
                        if kind <= 1 and channels == 3:
                            _products3(weights, at, size, stride, near, 0, 4, sums, k, begin)
                        elif kind <= 1:
                            _products1(weights, at, size, stride, near, 0, 4, sums, k, begin)
                        elif channels == 3:
                            _products3(
                                weights, at, size, stride, points.modes, first, width, sums,
                                k, begin,
                            )  # fmt: skip
                        else:
                            _products1(
                                weights, at, size, stride, points.modes, first, width, sums,
                                k, begin,
                            )  # fmt: skip
                query = (start + f) * places
                if normals:
                    _across(sums, places, reach)
                    for q in range(places):
                        out[0, query + q, 0] = sums[2, 0, q]
                        out[0, query + q, 1] = sums[2, 1, q]
                        out[0, query + q, 2] = sums[2, 2, q]
                    for q in range(places):
                        if not abs(sums[2, 0, q]) + abs(sums[2, 1, q]) + abs(sums[2, 2, q]) > 0:
                            rest[left] = query + q
                            left += 1
                    continue
                if position >= 0:
                    for c in range(channels):
                        if kind <= 1:
                            high, low = points.high[own, channel + c], 0.0
                        else:
                            low = points.modes[block + channel + c]
                            high = points.modes[block + (size + 1) * width + channel + c]
                        for q in range(places):
                            sums[position, c, q] = (sums[position, c, q] + low) + high
                for k in range(count):
                    if channels == 3:
                        for q in range(places):
                            out[k, query + q, 0] = sums[k, 0, q]
                            out[k, query + q, 1] = sums[k, 1, q]
                            out[k, query + q, 2] = sums[k, 2, q]
                    else:
                        for q in range(places):
                            out[k, query + q, channel] = sums[k, 0, q]
        return left

    return gridded
