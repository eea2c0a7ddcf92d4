"""Compiled weights of scattered queries: rows of a sparse matrix over the vertices of the cage.

How long a row can be is known from its patch, so that rows are written where they belong at once;
where control points coincide or share vertices of the cage they come out shorter.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels.evaluation import (
    DEEPEST,
    FAR,
    FIRST,
    KIND,
    MODES,
    ROW,
    SIZE,
    STEP,
    TURN,
    TURNS,
    Patches,
    Room,
    Tables,
    powered,
    scale_by_two,
)
from limitsurf._kernels.jit import inlined, lean, prefetch

Array = NDArray[Any]
OUT_OF_RANGE, UNKNOWN = -1, -2


class Controls(NamedTuple):
    """Control points of special patches, and what control points are in terms of the cage."""

    ids: Array  # flat int32
    first: Array  # (kinds,) int64: where those of a kind begin
    left: Array  # (kinds, W + 1, C): left eigenvectors, the limit mask first
    own: Array  # (limit faces,) int64: a vertex of the cage at each
    n_vertices: int
    indptr: Array  # (extras + 1,) int64: control points that are not vertices, as rows over those
    indices: Array  # int64
    data: Array


@inlined
def _insert(indices: Array, data: Array, start: int, end: int, column: int, value: float) -> int:
    """Add an entry to a row with sorted columns; its new end."""
    k = end
    while k > start and indices[k - 1] > column:
        k -= 1
    if k > start and indices[k - 1] == column:
        data[k - 1] += value
        return end
    for j in range(end, k, -1):
        indices[j] = indices[j - 1]
        data[j] = data[j - 1]
    indices[k] = column
    data[k] = value
    return end + 1


@inlined
def _place(
    ids: Array, at: int, n: int, weights: Array, keys: Array, indices: Array, data: Array,
    start: int,
) -> bool:  # fmt: skip
    """A row with sorted columns, by counting which are smaller; False if some are equal."""
    for k in range(n):
        keys[k] = ids[at + k]
    for k in range(n):
        smaller = start
        for j in range(n):
            smaller += keys[j] < keys[k]
        indices[smaller] = ids[at + k]
        data[smaller] = weights[k]
    # where columns are equal, places stay empty
    total = 0
    for k in range(n):
        total += keys[k]
    for k in range(start, start + n):
        total -= indices[k]
    for k in range(start, start + n - 1):
        if indices[k] >= indices[k + 1]:
            return False
    return total == 0


def writers(shape: Any) -> tuple[Any, Any]:
    """The kernels `lengths` and `fill`, for faces of a shape."""
    size, eigenfunctions, spline_row = shape.POINTS, shape.eigenfunctions, shape.spline_row
    located, turned, place_around = shape.located, shape.turned, shape.place_around
    chosen = shape.chosen

    @inlined
    def _controls(
        code: int, patches: Patches, tables: Tables, controls: Controls
    ) -> tuple[int, int]:
        """Where the control points of a patch begin, and how many there are."""
        kind, row = code >> KIND, code & ROW
        if kind <= 1:
            return row * size, size
        n = tables.kinds[kind, SIZE] + 1
        return controls.first[kind] + row * n, n

    @lean
    def lengths(
        face: Array, u: Array, v: Array, patches: Patches, tables: Tables, controls: Controls,
        order: int, result: Array,
    ) -> int:  # fmt: skip
        """Most entries that the row of each query can have; negative if one cannot be answered."""
        for q in range(len(face)):
            code, _, s, t, fine = located(face[q], u[q], v[q], patches)
            if not fine:
                return OUT_OF_RANGE
            if code < 0:
                result[q] = 1
                continue
            kind, turn = code >> KIND, code >> TURN & TURNS
            if kind > 1:
                s, t = turned(s, t, turn)
                if tables.kinds[kind, MODES] < 0 or (
                    order == 2 and place_around(s, t, turn)[0] > DEEPEST
                ):
                    return UNKNOWN
            at, n = _controls(code, patches, tables, controls)
            result[q] = n
            if code >> FAR & 1:
                ids = patches.ids if code >> KIND <= 1 else controls.ids
                for k in range(at, at + n):
                    extra = ids[k] - controls.n_vertices
                    if extra >= 0:
                        result[q] += controls.indptr[extra + 1] - controls.indptr[extra] - 1
        return 0

    @lean
    def fill(
        face: Array, u: Array, v: Array, patches: Patches, tables: Tables, controls: Controls,
        order: int, term: int, starts: Array, ends: Array, indices: Array, data: Array, room: Room,
        weights: Array, keys: Array,
    ) -> None:  # fmt: skip
        """Rows of one derivative, `term` in the order of `LimitSurface.jet`; `starts`, `ends`.

        `weights` and `keys` (int64) are room for those of the control points of a patch.
        """
        rows, along = room.rows, room.weights
        for q in range(len(face)):
            if q + 16 < len(face):
                prefetch(patches.info, face[q + 16])
                ahead = patches.info[face[q + 8]]
                if ahead >= 0 and ahead >> KIND <= 1:
                    prefetch(patches.ids, (ahead & ROW) * size)
            start = starts[q]
            code, depth, s, t, _ = located(face[q], u[q], v[q], patches)
            if code < 0:
                indices[start], data[start] = controls.own[face[q]], np.nan
                ends[q] = start + 1
                continue
            kind, turn = code >> KIND, code >> TURN & TURNS
            s, t = turned(s, t, turn)
            at, n = _controls(code, patches, tables, controls)
            if kind <= 1:
                spline_row(code, depth, s, t, term, order, patches, along, weights)
            else:
                level, piece, S, T = place_around(s, t, turn)
                for k in range(n):
                    weights[k] = 0.0
                mantissa, exponent = 1.0, order * depth
                if level < 0:
                    for j in range(6):
                        for k in range(n - 1):
                            rows[j, k] = tables.corners[kind, j, k]
                else:
                    eigenfunctions(order, kind, piece, S, T, tables, rows)
                    powered(kind, FIRST, level, (order + 1) * (order + 2) // 2, tables, rows)
                    mantissa = tables.mantissas[kind, level % STEP]
                    mantissa *= tables.mantissas[kind, STEP + level // STEP]
                    exponent += tables.exponents[kind, level % STEP] + order * (level + 1)
                    exponent += tables.exponents[kind, STEP + level // STEP]
                here, sign = chosen(rows, n - 1, turn, piece, term)
                mantissa *= sign
                if level >= 0 or order > 0:
                    for j in range(n - 1):
                        value = rows[here, j]
                        for k in range(n):
                            weights[k] += value * controls.left[kind, j + 1, k]
                for k in range(n):
                    w = scale_by_two(weights[k] * mantissa, exponent)
                    weights[k] = w + controls.left[kind, 0, k] if order == 0 else w
            ids = patches.ids if kind <= 1 else controls.ids
            if not code >> FAR & 1 and _place(ids, at, n, weights, keys, indices, data, start):
                ends[q] = start + n
                continue
            end = start
            for k in range(n):
                column = ids[at + k]
                extra = column - controls.n_vertices
                if extra < 0:
                    end = _insert(indices, data, start, end, column, weights[k])
                else:
                    for e in range(controls.indptr[extra], controls.indptr[extra + 1]):
                        value = weights[k] * controls.data[e]
                        end = _insert(indices, data, start, end, controls.indices[e], value)
            ends[q] = end

    return lengths, fill


@lean
def close_gaps(indptr: Array, ends: Array, indices: Array, data: Array) -> None:
    """Move rows together that are shorter than there is room for; `indptr` tells where they are."""
    to = 0
    for r in range(len(ends)):
        start, end = indptr[r], ends[r]
        indptr[r] = to
        for k in range(start, end):
            indices[to] = indices[k]
            data[to] = data[k]
            to += 1
    indptr[len(ends)] = to
