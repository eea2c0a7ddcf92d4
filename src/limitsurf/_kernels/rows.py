"""Compiled weights of scattered queries: rows of sparse matrices over the vertices of the cage.

Which columns a row has is a matter of its patch, and so is their order: it is found out where a
patch is first met, and kept. So rows are written where they belong at once, those of any number of
derivatives side by side, on one pattern.
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
    PATCH,
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
from limitsurf._kernels.jit import inlined, lean, prefetch, products, unfused

Array = NDArray[Any]
OUT_OF_RANGE, UNKNOWN = -1, -2
EIGHT = 8  # columns of a matrix that are multiplied at once
_STAMP = 16  # bits of the most columns of a row

_product = products(1)


class Controls(NamedTuple):
    """Control points of special patches, and what control points are in terms of the cage."""

    ids: Array  # flat int32
    first: Array  # (kinds,) int64: where those of a kind begin
    left: Array  # (kinds, W + 1, C): left eigenvectors, the limit mask first; C whole eights
    own: Array  # (limit faces,) int64: a vertex of the cage at each
    n_vertices: int
    indptr: Array  # (extras + 1,) int64: control points that are not vertices, as rows over those
    indices: Array  # int64
    data: Array
    # (patches,) int64: the number of columns; or, of a spline on as many vertices as it has control
    # points, which of them is next in ascending order, four bits each; 0 if nobody has asked yet
    forms: Array


class Space(NamedTuple):
    """Where rows keep what they need for a moment."""

    eigen: Array  # (W,): one derivative of eigenfunctions
    weights: Array  # (derivatives, 1, C): of the control points of a patch
    columns: Array  # (most columns of a row,) int32: in the order in which they occur,
    ranks: Array  # int64: their places in ascending order,
    ascending: Array  # int32: and in that order
    slots: Array  # (most terms of a row,) int64: which column a term is added to
    seen: Array  # int64, a power of two, zero: stamps of columns by their hash

    @classmethod
    def of(cls, controls: Controls, points: int, count: int) -> Space:
        """Enough for so many derivatives, of patches with a spline of so many control points."""
        wide = max(controls.left.shape[2], points)
        terms = wide * int(np.diff(controls.indptr).max(initial=1))
        seen = np.zeros(1 << (2 * terms).bit_length(), np.int64)
        columns, ascending = np.empty((2, terms), np.int32)
        ranks, slots = np.empty((2, terms), np.int64)
        weights = np.empty((count, 1, wide))
        return cls(np.empty(wide), weights, columns, ranks, ascending, slots, seen)


@unfused
def _plus(total: float, weight: float, factor: float) -> float:
    """A sum with a product that is rounded before."""
    return total + weight * factor


@inlined
def _columns(
    ids: Array, at: int, n: int, controls: Controls, stamp: int, space: Space
) -> tuple[int, int]:
    """Columns of the vertices that control points depend on, and which each term belongs to.

    Returned is how many there are of both. Stamps ascend by more than those of columns.
    """
    columns, slots, seen = space.columns, space.slots, space.seen
    mask = len(seen) - 1
    total = terms = 0
    for k in range(n):
        column = np.int64(ids[at + k])
        extra = column - controls.n_vertices
        begin, end = 0, 1
        if extra >= 0:
            begin, end = controls.indptr[extra], controls.indptr[extra + 1]
        for e in range(begin, end):
            if extra >= 0:
                column = controls.indices[e]
            place = (column * 0x9E3779B1 >> 12) & mask
            while True:
                slot = seen[place] - stamp
                if slot < 0:  # of a row before
                    slot = total
                    seen[place] = stamp + slot
                    columns[slot] = column
                    total += 1
                    break
                if columns[slot] == column:
                    break
                place = (place + 1) & mask
            slots[terms] = slot
            terms += 1
    return total, terms


def writers(shape: Any) -> tuple[Any, Any]:
    """The kernels `lengths` and `fill`, for faces of a shape."""
    size, eigenfunctions, spline_rows = shape.POINTS, shape.eigenfunctions, shape.spline_rows
    located, turned, place_around = shape.located, shape.turned, shape.place_around
    chosen = shape.chosen

    @inlined
    def _controls(
        code: int, patches: Patches, tables: Tables, controls: Controls
    ) -> tuple[int, int, int]:
        """The number of a patch, where its control points begin, and how many there are."""
        kind, row = code >> KIND, code & ROW
        if kind <= 1:
            return row, row * size, size
        n = tables.kinds[kind, SIZE] + 1
        number = len(patches.near) + tables.kinds[kind, PATCH] + row
        return number, controls.first[kind] + row * n, n

    @inlined
    def _form(ids: Array, at: int, n: int, code: int, controls: Controls, stamp: int,
              space: Space) -> int:  # fmt: skip
        """What is kept of a patch."""
        if code >> KIND <= 1 and not code >> FAR & 1:
            form = total = 0
            for k in range(n):
                smaller = 0
                for j in range(n):
                    smaller += ids[at + j] < ids[at + k]
                form |= k << 4 * smaller
                total += smaller
            if total == n * (n - 1) // 2:  # no two are equal
                return form
        total, _ = _columns(ids, at, n, controls, stamp, space)
        return total

    @lean
    def lengths(
        face: Array, u: Array, v: Array, patches: Patches, tables: Tables, controls: Controls,
        order: int, result: Array, space: Space,
    ) -> int:  # fmt: skip
        """How many entries the row of each query has; negative if one cannot be answered."""
        for q in range(len(face)):
            if q + 16 < len(face):
                prefetch(patches.info, face[q + 16])
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
            number, at, n = _controls(code, patches, tables, controls)
            form = controls.forms[number]
            if form == 0:
                ids = patches.ids if kind <= 1 else controls.ids
                form = _form(ids, at, n, code, controls, (q + 1) << _STAMP, space)
                # (whoever else asks writes the same)
                controls.forms[number] = form
            result[q] = size if form >> 32 else form
        return 0

    @inlined
    def _special_rows(
        code: int, depth: int, s: float, t: float, order: int, terms: Array, tables: Tables,
        controls: Controls, room: Room, space: Space,
    ) -> None:  # fmt: skip
        """Weights of the control points of a special patch."""
        kind, turn = code >> KIND, code >> TURN & TURNS
        rows, left, n = room.rows, controls.left, tables.kinds[kind, SIZE]
        level, piece, S, T = place_around(s, t, turn)
        common, power = 1.0, 0
        if level < 0:
            for j in range(6):
                for k in range(n):
                    rows[j, k] = tables.corners[kind, j, k]
        else:
            eigenfunctions(order, kind, piece, S, T, tables, rows)
            powered(kind, FIRST, level, (order + 1) * (order + 2) // 2, tables, rows)
            common = tables.mantissas[kind, level % STEP]
            common *= tables.mantissas[kind, STEP + level // STEP]
            power = tables.exponents[kind, level % STEP]
            power += tables.exponents[kind, STEP + level // STEP]
        for o in range(len(terms)):
            term = terms[o]
            own = (term > 0) + (term > 2)
            weights = space.weights[o, 0]
            mantissa = common * chosen(rows, n, turn, piece, term, space.eigen)
            exponent = power + own * (depth + level + 1)
            count = n if level >= 0 or own > 0 else 0
            first = (kind * left.shape[1] + 1) * left.shape[2]
            for k in range(0, n + 1, EIGHT):
                _product(
                    left, first + k, count, left.shape[2], space.eigen, 0, 1, space.weights, o, k
                )
            for k in range(n + 1):
                w = scale_by_two(weights[k] * mantissa, exponent)
                weights[k] = w + left[kind, 0, k] if own == 0 else w

    @inlined
    def _pattern(
        ids: Array, at: int, n: int, form: int, distinct: bool, controls: Controls, stamp: int,
        space: Space,
    ) -> None:  # fmt: skip
        """The `form` columns of a patch in ascending order, and where among them its terms go."""
        columns, ranks, slots, terms = space.columns, space.ranks, space.slots, n
        if distinct:
            for k in range(n):
                columns[k], slots[k] = ids[at + k], k
        else:
            _, terms = _columns(ids, at, n, controls, stamp, space)
        for i in range(form):
            smaller = 0
            for j in range(form):
                smaller += columns[j] < columns[i]
            ranks[i] = smaller
            space.ascending[smaller] = columns[i]
        for k in range(terms):
            slots[k] = ranks[slots[k]]

    @inlined
    def _merge(
        ids: Array, at: int, n: int, form: int, controls: Controls, start: int, count: int,
        indices: Array, data: Array, space: Space,
    ) -> None:  # fmt: skip
        """Write rows on a pattern, terms of equal columns added up."""
        for i in range(form):
            indices[start + i] = space.ascending[i]
        for o in range(count):
            for i in range(start, start + form):
                data[o, i] = -0.0  # (which leaves what is added as it is)
            term = 0
            for k in range(n):
                weight, extra = space.weights[o, 0, k], ids[at + k] - controls.n_vertices
                if extra < 0:
                    place = start + space.slots[term]
                    data[o, place] = _plus(data[o, place], weight, 1.0)
                    term += 1
                    continue
                for e in range(controls.indptr[extra], controls.indptr[extra + 1]):
                    place = start + space.slots[term]
                    data[o, place] = _plus(data[o, place], weight, controls.data[e])
                    term += 1

    @lean
    def fill(
        face: Array, u: Array, v: Array, patches: Patches, tables: Tables, controls: Controls,
        order: int, terms: Array, starts: Array, indices: Array, data: Array, room: Room,
        space: Space,
    ) -> None:  # fmt: skip
        """Rows of some derivatives, `terms` in the order of `LimitSurface.jet`, up to an order.

        Those of query q begin at ``indices[starts[q]]`` and, for derivative o, at
        ``data[o, starts[q]]``. `lengths` has been asked before.
        """
        count, last = len(terms), -1
        for q in range(len(face)):
            if q + 16 < len(face):
                prefetch(patches.info, face[q + 16])
                ahead = patches.info[face[q + 8]]
                if ahead >= 0 and ahead >> KIND <= 1:
                    prefetch(patches.ids, (ahead & ROW) * size)
                    prefetch(controls.forms, ahead & ROW)
            start = starts[q]
            code, depth, s, t, _ = located(face[q], u[q], v[q], patches)
            if code < 0:
                indices[start] = controls.own[face[q]]
                for o in range(count):
                    data[o, start] = np.nan
                continue
            kind = code >> KIND
            s, t = turned(s, t, code >> TURN & TURNS)
            number, at, n = _controls(code, patches, tables, controls)
            form, ids = controls.forms[number], patches.ids
            if kind <= 1:
                spline_rows(
                    code, depth, s, t, order, terms, patches, room.weights, space.weights
                )
                if form >> 32:
                    for i in range(size):
                        indices[start + i] = ids[at + (form >> 4 * i & 15)]
                    for o in range(count):
                        for i in range(size):
                            data[o, start + i] = space.weights[o, 0, form >> 4 * i & 15]
                    continue
            else:
                ids = controls.ids
                _special_rows(code, depth, s, t, order, terms, tables, controls, room, space)
            if number != last:
                distinct = form == n and not code >> FAR & 1
                _pattern(ids, at, n, form, distinct, controls, (q + 1) << _STAMP, space)
                last = number
            _merge(ids, at, n, form, controls, start, count, indices, data, space)

    return lengths, fill
