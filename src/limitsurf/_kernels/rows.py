"""Compiled weights of scattered queries: rows of sparse matrices over the vertices of the cage.

Which columns a row has is a matter of its patch, and so is their order: both are found out once, by
`patterns`. So rows are written where they belong at once, those of any number of derivatives side
by side.
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
    LANES,
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
    patches_of,
    powered,
    scale_by_two,
    tables_of,
)
from limitsurf._kernels.jit import inlined, lean, prefetch, products, store, unfused

Array = NDArray[Any]
OUT_OF_RANGE, UNKNOWN = -1, -2
EIGHT = 8  # columns of a matrix that are multiplied at once
_AHEAD = 4  # queries that memory is asked for ahead of time

_product = products(1)


class Controls(NamedTuple):
    """Control points of special patches, and what control points are in terms of the cage."""

    ids: Array  # flat int32
    first: Array  # (kinds,) int64: where those of a kind begin
    left: Array  # (kinds, W + 1, C): left eigenvectors, the limit mask first; C whole eights
    own: Array  # (limit faces,) int64: a vertex of the cage at each
    n_vertices: int
    indptr: Array  # (extras + 1,) int64: control points that are not vertices, as rows over those
    indices: Array  # int32
    data: Array


class Patterns(NamedTuple):
    """The columns of the rows of each patch, whatever the query."""

    # (patches,) int64: of a spline on distinct vertices which of its control points is next in
    # ascending order, four bits each; of others a number below 2^32, which these arrays go by
    forms: Array
    columns: Array  # int32, ascending
    slots: Array  # uint16: which of them each term of each control point is added to
    starts: Array  # (others + 1, 2) int64: where those of a patch begin in both arrays


class Space(NamedTuple):
    """Where rows keep what they need for a moment."""

    eigen: Array  # (W,): one derivative of eigenfunctions
    weights: Array  # (derivatives, 1, C): of the control points of a patch
    sums: Array  # flat (most columns of a row, LANES)

    @classmethod
    def of(cls, controls: Controls, found: Patterns, points: int, count: int) -> Space:
        """Enough for so many derivatives, of patches with a spline of so many control points."""
        wide = max(controls.left.shape[2], points)
        most = int(np.diff(found.starts[:, 0]).max(initial=1))
        weights = np.zeros((-(-count // LANES) * LANES, 1, wide))
        return cls(np.empty(wide), weights, np.empty(LANES * most))


@unfused
def _plus(total: float, weight: float, factor: float) -> float:
    """A sum with a product that is rounded before."""
    return total + weight * factor


@lean
def patterns(
    ids: Array, plain: bool, controls: Controls, forms: Array, found: Patterns, number: int,
    seen: Array, room: Array,
) -> int:  # fmt: skip
    """Fill `found` from pattern `number` on, for patches with control points ids (P, K).

    forms (P,) are theirs, packed if `plain` and they are distinct vertices. seen (vertices,) int64
    is -1, and is left so; room (2, most terms of a patch) int32. Returned is the next number.
    """
    n_points = ids.shape[1]
    for p in range(len(ids)):
        form = total = 0
        inside = plain
        for k in range(n_points):
            inside &= ids[p, k] < controls.n_vertices
        if inside:
            for k in range(n_points):
                smaller = 0
                for j in range(n_points):
                    smaller += ids[p, j] < ids[p, k]
                form |= k << 4 * smaller
                total += smaller
            if total == n_points * (n_points - 1) // 2:  # no two are equal
                forms[p] = form
                continue
        forms[p] = number
        begin, start = found.starts[number, 0], found.starts[number, 1]
        total, term = 0, start
        for k in range(n_points):
            column = np.int64(ids[p, k])
            extra = column - controls.n_vertices
            first, last = 0, 1
            if extra >= 0:
                first, last = controls.indptr[extra], controls.indptr[extra + 1]
            for e in range(first, last):
                if extra >= 0:
                    column = np.int64(controls.indices[e])
                if seen[column] < 0:
                    seen[column] = total
                    room[0, total] = column
                    total += 1
                found.slots[term] = seen[column]
                term += 1
        for i in range(total):
            smaller = 0
            for j in range(total):
                smaller += room[0, j] < room[0, i]
            room[1, i] = smaller
            found.columns[begin + smaller] = room[0, i]
            seen[room[0, i]] = -1
        for k in range(start, term):
            found.slots[k] = room[1, found.slots[k]]
        number += 1
        found.starts[number, 0], found.starts[number, 1] = begin + total, term
    return number


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

    @lean
    def lengths(
        face: Array, u: Array, v: Array, words: Array, controls: Controls,
        found: Patterns, order: int, result: Array,
    ) -> int:  # fmt: skip
        """How many entries the row of each query has; negative if one cannot be answered."""
        patches, tables = patches_of(words), tables_of(words)
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
            number, _, _ = _controls(code, patches, tables, controls)
            form = found.forms[number]
            result[q] = size
            if not form >> 32:
                result[q] = found.starts[form + 1, 0] - found.starts[form, 0]
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
    def _merge(
        ids: Array, at: int, n: int, form: int, controls: Controls, found: Patterns, start: int,
        count: int, indices: Array, data: Array, space: Space,
    ) -> None:  # fmt: skip
        """Write rows, terms of equal columns added up."""
        begin, total = found.starts[form, 0], found.starts[form + 1, 0] - found.starts[form, 0]
        for i in range(total):
            indices[start + i] = found.columns[begin + i]
        weights, sums = space.weights, space.sums
        for o in range(0, count, LANES):
            for i in range(LANES * total):
                sums[i] = -0.0  # (which leaves what is added as it is)
            term = found.starts[form, 1]
            for k in range(n):
                w0, w1, w2, w3 = (
                    weights[o, 0, k],
                    weights[o + 1, 0, k],
                    weights[o + 2, 0, k],
                    weights[o + 3, 0, k],
                )
                first, last, extra = 0, 1, ids[at + k] - controls.n_vertices
                if extra >= 0:
                    first, last = controls.indptr[extra], controls.indptr[extra + 1]
                for e in range(first, last):
                    factor = controls.data[e] if extra >= 0 else 1.0
                    slot = LANES * found.slots[term]
                    term += 1
                    sums[slot] = _plus(sums[slot], w0, factor)
                    sums[slot + 1] = _plus(sums[slot + 1], w1, factor)
                    sums[slot + 2] = _plus(sums[slot + 2], w2, factor)
                    sums[slot + 3] = _plus(sums[slot + 3], w3, factor)
            for j in range(min(LANES, count - o)):
                for i in range(total):
                    store(data, o + j, start + i, sums[LANES * i + j])

    @inlined
    def _ask(
        k: int, count: int, queries: Array, codes: Array, patches: Patches, tables: Tables,
        controls: Controls, found: Patterns,
    ) -> None:  # fmt: skip
        """Prefetch what queries some way beyond number k of some need."""
        for stage in range(3):
            j = k + (3 - stage) * _AHEAD
            if j >= count:
                continue
            code = codes[queries[j]]
            number, at, n = _controls(code, patches, tables, controls)
            ids = patches.ids if code >> KIND <= 1 else controls.ids
            if stage == 0:
                prefetch(found.forms, number)
                for i in range(at, at + n, 16):
                    prefetch(ids, i)
                continue
            form = found.forms[number]
            if form >> 32 or code == codes[queries[j - 1]]:
                continue
            if stage == 1:
                prefetch(found.starts, 2 * form)
            else:
                prefetch(found.columns, found.starts[form, 0])
                for i in range(found.starts[form, 1], found.starts[form + 1, 1], 32):
                    prefetch(found.slots, i)
            if not code >> FAR & 1:
                continue
            for i in range(at, at + n):
                extra = ids[i] - controls.n_vertices
                if extra < 0:
                    continue
                if stage == 1:
                    prefetch(controls.indptr, extra)
                else:
                    prefetch(controls.data, controls.indptr[extra])
                    prefetch(controls.data, controls.indptr[extra + 1] - 1)

    @inlined
    def _plain(
        count: int, left: int, begin: int, order: int, terms: Array, patches: Patches,
        found: Patterns, starts: Array, indices: Array, data: Array, room: Room, space: Space,
    ) -> int:  # fmt: skip
        """Rows of splines on vertices; those on some that coincide are added to the others."""
        ids = patches.ids
        for j in range(-2 * _AHEAD, count):
            if j + 2 * _AHEAD < count:
                row = room.codes[room.simple[j + 2 * _AHEAD]] & ROW
                prefetch(found.forms, row)
                prefetch(ids, row * size)
            if j < 0:
                continue
            k = room.simple[j]
            code, start = room.codes[k], starts[begin + k]
            at, form = (code & ROW) * size, found.forms[code & ROW]
            if not form >> 32:
                room.splines[left] = k
                left += 1
                continue
            spline_rows(
                code, room.depths[k], room.s[k], room.t[k], order, terms, patches, room.weights,
                space.weights,
            )  # fmt: skip
            for i in range(size):
                indices[start + i] = ids[at + (form >> 4 * i & 15)]
            for o in range(len(terms)):
                for i in range(size):
                    store(data, o, start + i, space.weights[o, 0, form >> 4 * i & 15])
        return left

    @lean
    def fill(
        face: Array, u: Array, v: Array, words: Array, controls: Controls,
        found: Patterns, order: int, terms: Array, starts: Array, indices: Array, data: Array,
        room: Room, space: Space,
    ) -> None:  # fmt: skip
        """Rows of some derivatives, `terms` in the order of `LimitSurface.jet`, up to an order.

        Those of query q begin at number ``starts[q]`` of indices, and of each array whose address
        is in `data`. `lengths` has been asked before.
        """
        patches, tables = patches_of(words), tables_of(words)
        codes = room.codes
        for begin in range(0, len(face), len(codes)):
            plain = others = 0
            for k in range(min(len(codes), len(face) - begin)):
                q = begin + k
                if q + 16 < len(face):
                    prefetch(patches.info, face[q + 16])
                code, room.depths[k], s, t, _ = located(face[q], u[q], v[q], patches)
                codes[k] = code
                if code < 0:
                    indices[starts[q]] = controls.own[face[q]]
                    for o in range(len(terms)):
                        store(data, o, starts[q], np.nan)
                    continue
                room.s[k], room.t[k] = turned(s, t, code >> TURN & TURNS)
                if code >> KIND <= 1 and not code >> FAR & 1:
                    room.simple[plain] = k
                    plain += 1
                else:
                    room.splines[others] = k
                    others += 1
            others = _plain(
                plain, others, begin, order, terms, patches, found, starts, indices, data, room,
                space,
            )  # fmt: skip
            for j in range(others):
                _ask(j, others, room.splines, codes, patches, tables, controls, found)
                k = room.splines[j]
                code, depth, s, t = codes[k], room.depths[k], room.s[k], room.t[k]
                number, at, n = _controls(code, patches, tables, controls)
                ids = patches.ids
                if code >> KIND <= 1:
                    spline_rows(
                        code, depth, s, t, order, terms, patches, room.weights, space.weights
                    )
                else:
                    ids = controls.ids
                    _special_rows(code, depth, s, t, order, terms, tables, controls, room, space)
                _merge(
                    ids, at, n, found.forms[number], controls, found, starts[begin + k],
                    len(terms), indices, data, space,
                )  # fmt: skip

    return lengths, fill
