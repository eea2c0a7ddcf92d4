"""Compiled evaluation by halvings: the steps to a vertex, and a row of weights carried back.

The twin of `Path` in ``engine/interpolating.py``, one query at a time, with tables of what has been
met. What is not in them is asked for, and the query is asked again: there are few kinds.
Derived in ``derivations/butterfly.py``.
"""

from __future__ import annotations

from math import frexp
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels.jit import inlined, lean, products

Array = NDArray[Any]

LONGEST = 11  # powers of two of halvings that are taken at once: parameters have no more
STACK = 256  # operations of a query, at most: each ends a digit, or halves what a run has left
FIRST, CHILDREN, RUN, END = range(1, 5)  # what may be missing
EIGHT = 8  # columns of a matrix that are multiplied at once: rows of matrices are filled up
_product1, _product2, _product3 = products(1), products(2), products(3)
_MIDDLE = 3
_RUN = 8  # least number of halvings towards a corner that are taken at once
_GROWTH = np.array([2.0 ** (2.0**j / 2) for j in range(LONGEST)])  # square roots of 2^(2^j)


class Steps(NamedTuple):
    """What is known of steps; -1 for what is not yet."""

    children: Array  # (kinds, 4) int64: kinds of children
    single: Array  # (kinds, 4) int64: operations of one step
    runs: Array  # (kinds, 3, LONGEST) int64: operations of 2^j steps towards a corner
    ends: Array  # (3, kinds, 3) int64: where in `values` the rows at corners are, of three types
    sizes: Array  # (kinds,) int64: number of differences
    places: Array  # (kinds,) int64: where in `values` the lattice is, -1 where there is none
    shapes: Array  # (operations, 3) int64: rows, columns, and where in `values` they are:
    # a row, then a matrix
    factors: Array  # (operations, 2): of positions and derivatives
    values: Array  # (n,)


class Maps(NamedTuple):
    """What parts of triangles make of differences, see ``engine/ternary.py``."""

    codes: Array  # (kinds, 9) int64: operations of one part, -1 where unknown
    words: Array  # (9, 9) int64: of a part of a part amid regular vertices
    shapes: Array  # as in `Steps`
    factors: Array
    values: Array


@inlined
def _halved(ref: int, x: float, y: float) -> tuple[int, int, float, float]:
    """The child where a place is, and the place there, by its distances from a corner."""
    least, most = min(x, y), max(x, y)
    if most < 0.5 and least >= 0.5 - most and 4 * most >= 1:
        small = 1 - 2 * most
        rest = 2 * least - small
        # corner i of the middle child is opposite to corner i; the nearest one is referred to
        if x >= y:
            return _MIDDLE, (ref + 2) % 3, rest, small
        return _MIDDLE, (ref + 1) % 3, small, rest
    if x >= 0.5:
        return (ref + 1) % 3, ref, 2 * x - 1, 2 * y
    if y >= 0.5:
        return (ref + 2) % 3, ref, 2 * x, 2 * y - 1
    return ref, ref, 2 * x, 2 * y


@inlined
def _taken_back(code: int, steps: Any, axes: Array, rows: Array, made: Array) -> None:
    """Rows (n, axes) times the matrix of an operation, in their place; `made` is room."""
    m, n, at = steps.shapes[code]
    stride, count, values = (n + EIGHT - 1) // EIGHT * EIGHT, len(axes), steps.values
    for j in range(0, n, EIGHT):
        begin = at + stride + j
        if count == 1:
            _product1(values, begin, m, stride, rows, 0, 1, made, 0, j)
        elif count == 2:
            _product2(values, begin, m, stride, rows, 0, 2, made, 0, j)
        else:
            _product3(values, begin, m, stride, rows, 0, 3, made, 0, j)
    for r in range(count):
        if axes[r] < 0:
            factor = steps.factors[code, 0]
            for j in range(n):
                rows[count * j + r] = made[0, r, j] * factor + values[at + j]
        else:
            factor = steps.factors[code, 1]
            for j in range(n):
                rows[count * j + r] = made[0, r, j] * factor


@lean
def weighted(
    which: Array, face: Array, u: Array, v: Array, triangles: Array, frames: Array, steps: Steps,
    asked: tuple[Array, int], room: tuple[Array, Array, Array], out: Array, found: Array,
) -> None:  # fmt: skip
    """Rows (Q, axes, ...), at most three, over differences around children of the cage's triangles.

    Of queries `which`. `triangles` has the kind of each child and where its points begin, `frames`
    its first corner. Asked are positions (axis -1) and derivatives, and the type of rows at
    corners. `found` (Q, 4) int64 becomes 0, kind and beginning, or what is missing, and of what.
    """
    axes, kind_of_rows = asked
    (stack, rows, made), count = room, len(axes)
    for query in which:
        child, ref, x, y = _halved(0, u[query], v[query])
        triangle = 4 * face[query] + child
        first = triangles[triangle, 0]
        found[query, 0], found[query, 1] = 0, first
        found[query, 2], found[query, 3] = triangles[triangle, 1], 0
        if first < 0:
            found[query, 0], found[query, 1] = FIRST, 3 * triangle + frames[child]
            continue
        if first >= len(steps.sizes) or steps.children[first, 0] < 0:
            found[query, 0], found[query, 1] = CHILDREN, first
            continue
        kind, height = first, 0
        while not ((x == 0 and y == 0) or x == 1 or y == 1):
            if steps.children[kind, 0] < 0:
                found[query, 0], found[query, 1] = CHILDREN, kind
                break
            exponent = -frexp(max(x, y))[1] - 1
            if exponent >= _RUN and steps.children[kind, ref] == kind:
                j = 3
                while exponent >> (j + 1):
                    j += 1
                code = steps.runs[kind, ref, j]
                if code < 0:
                    found[query, 0], found[query, 1] = RUN, kind
                    found[query, 2], found[query, 3] = ref, j
                    break
                x = x * _GROWTH[j] * _GROWTH[j]
                y = y * _GROWTH[j] * _GROWTH[j]
            elif kind == 0:
                a, ref, x, y = _halved(ref, x, y)
                b, ref, x, y = _halved(ref, x, y)
                c, ref, x, y = _halved(ref, x, y)
                code = 16 * a + 4 * b + c
            else:
                a, ref, x, y = _halved(ref, x, y)
                code = steps.single[kind, a]
                kind = steps.children[kind, a]
            stack[height] = code
            height += 1
        if found[query, 0] != 0:
            continue
        end = (ref + (x == 1) + 2 * (y == 1)) % 3
        begin = steps.ends[kind_of_rows, kind, end]
        if begin < 0:
            found[query, 0], found[query, 1], found[query, 2] = END, kind, end
            continue
        n = steps.sizes[kind]
        for r in range(count):
            for j in range(n):
                place = begin + axes[r] * n + j
                rows[count * j + r] = 0.0 if axes[r] < 0 else steps.values[place]
            if axes[r] < 0 and end > 0:
                rows[count * (end - 1) + r] = 1.0
        while height > 0:
            height -= 1
            _taken_back(stack[height], steps, axes, rows, made)
        n, lattice = steps.sizes[first], steps.places[first]
        for r in range(count):
            factor = 1.0 if axes[r] < 0 else -2.0 if child == _MIDDLE else 2.0
            for j in range(n):
                out[query, r, j] = rows[count * j + r] * factor
            if lattice >= 0:
                for j in range(2):
                    total = 0.0
                    for i in range(2, n):
                        total += out[query, r, i] * steps.values[lattice + 2 * (i - 2) + j]
                    out[query, r, j] -= total


@lean
def ascended(
    kinds: Array, parts: Array, maps: Maps, axes: Array, room: tuple[Array, Array], weights: Array
) -> None:
    """Take weights (axes, Q, ...) back through steps (levels, Q), of kind -1 where there is none.

    Axes are -1 for positions; there are at most three.
    """
    (rows, made), count, n = room, len(axes), 0
    for query in range(kinds.shape[1]):
        level, begun = kinds.shape[0] - 1, False
        while level >= 0:
            kind, part = kinds[level, query], parts[level, query]
            if kind < 0:
                level -= 1
                continue
            code = maps.codes[kind, part]
            if kind == 0 and level > 0 and kinds[level - 1, query] == 0:
                level -= 1
                code = maps.words[parts[level, query], part]
            if not begun:
                begun = True
                for r in range(count):
                    for j in range(maps.shapes[code, 0]):
                        rows[count * j + r] = weights[r, query, j]
            _taken_back(code, maps, axes, rows, made)
            n = maps.shapes[code, 1]
            level -= 1
        if begun:
            for r in range(count):
                for j in range(weights.shape[2]):
                    weights[r, query, j] = rows[count * j + r] if j < n else 0.0
