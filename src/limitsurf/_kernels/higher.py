"""Compiled derivatives of the third order and more, of scattered queries: all of one order at once.

Pieces are polynomials over control points, and so are eigenfunctions: monomials are derived and
added up, whatever the order, at some cost beside the lower orders, whose kernels know them by
heart. Derivatives in patch parameters are made those of the limit face by factors that are handed
over. Where kernels know less than the reference does the query is left to it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels.evaluation import (
    DEEPEST,
    FIRST,
    KIND,
    LANES,
    MODES,
    QUERIES,
    ROW,
    ROWS,
    STEP,
    TURN,
    TURNS,
    Room,
    Tables,
    control_points,
    patches_of,
    points_of,
    powered,
    scale_by_two,
    tables_of,
)
from limitsurf._kernels.finding import finder
from limitsurf._kernels.jit import combination, gathered, inlined, lean

Array = NDArray[Any]

TERMS = 6  # derivatives in patch parameters, at most

_sum6 = combination(TERMS)


@inlined
def _factor(power: int, order: int, x: float) -> float:
    """The derivative of a power of x, not beyond it."""
    factor = 1.0
    for k in range(order):
        factor *= power - k
    for _ in range(power - order):
        factor *= x
    return factor


def deriver(shape: Any) -> Any:
    """The kernel `higher`, for faces of a shape."""
    size, degrees, piece_of = shape.POINTS, shape.DEGREES, shape.piece_of
    (_, kept, *_), (locate, ask, controls) = control_points(shape), finder(shape)
    gather, middle = gathered(size, shape.OWN, TERMS), shape.MIDDLE

    @inlined
    def _of_splines(
        S: float, T: float, piece: int, orders: Array, pieces: Array, sums: Array
    ) -> None:
        """Weights of control points in the derivatives of a piece, (terms, size) of flat `sums`."""
        for r in range(len(orders)):
            a, b = orders[r, 0], orders[r, 1]
            for k in range(size):
                sums[size * r + k] = 0.0
            m = 0
            for j in range(len(degrees)):
                for i in range(degrees[j] + 1):
                    if i >= a and j >= b:
                        factor = _factor(i, a, S) * _factor(j, b, T)
                        for k in range(size):
                            sums[size * r + k] += factor * pieces[piece, m, k]
                    m += 1

    @inlined
    def _of_eigenfunctions(
        S: float, T: float, kind: int, piece: int, orders: Array, tables: Tables, rows: Array
    ) -> None:
        """Derivatives of the eigenfunctions on a piece around a special corner."""
        n = tables.kinds[kind, ROWS]
        for r in range(TERMS):
            for k in range(n):
                rows[r, k] = 0.0
            if r >= len(orders):
                continue
            a, b, m = orders[r, 0], orders[r, 1], 0
            for j in range(len(degrees)):
                for i in range(degrees[j] + 1):
                    if i >= a and j >= b:
                        factor = _factor(i, a, S) * _factor(j, b, T)
                        for k in range(n):
                            rows[r, k] += factor * tables.pieces[kind, piece, m, k]
                    m += 1

    @inlined
    def _write(
        found: Array, terms: int, turning: Array, turn: int, mantissa: float, exponent: int,
        out: Array, query: int, channel: int,
    ) -> None:  # fmt: skip
        """Write what derivatives in patch parameters are in those of the limit face."""
        for j in range(len(out)):
            for c in range(min(LANES, out.shape[2] - channel)):
                total = 0.0
                for r in range(terms):
                    factor = turning[turn, j, r]
                    if factor != 0:  # (infinities that are not to be added stay away)
                        total += factor * found[LANES * r + c]
                out[j, query, channel + c] = scale_by_two(total * mantissa, exponent)

    @lean
    def higher(
        face: Array, u: Array, v: Array, words: Array, order: int, orders: Array, turning: Array,
        pieces: Array, sums: Array, out: Array, start: int, rest: Array, room: Room,
    ) -> int:  # fmt: skip
        """Derivatives of a total order into out (n, Q, d).

        Derivatives in patch parameters, orders (terms, 2), are added up with the factors turning
        (orientations, n, `TERMS`). Coefficients of monomials pieces (pieces, monomials, size) are
        those of splines, by the numbers that `piece_of` gives; flat sums (`TERMS` size,) are zeros
        beyond the terms. The others, and what is returned, are as for `evaluator`.
        """
        patches, tables, points = patches_of(words), tables_of(words), points_of(words)
        found, rows, modes, width = room.found, room.rows, points.modes, points.high.shape[1]
        left = 0
        for begin in range(0, len(face), QUERIES):
            count = min(QUERIES, len(face) - begin)
            if not locate(face, u, v, begin, count, patches, room):
                return -1
            for q in range(count):
                ask(q, count, room, patches, tables, points)
                query, code, place = start + begin + q, room.codes[q], room.places[q]
                if code < 0:
                    for j in range(len(out)):
                        for c in range(out.shape[2]):
                            out[j, query, c] = np.nan
                    continue
                kind, turn, piece, level = code >> KIND, code >> TURN & TURNS, place & 3, place >> 2
                S, T, step = room.s[q], room.t[q], room.depths[q] * order
                turned = -1.0 if piece == middle and order % 2 else 1.0
                at = tables.kinds[kind, MODES]
                n = tables.kinds[kind, ROWS]
                block = (at + (code & ROW) * (n + 3)) * width
                if kind > 1 and at >= 0:
                    level -= 1
                    if (
                        level < 0
                        or level * order > DEEPEST
                        or modes[block + (n + 2) * width + 1] != 1
                    ):
                        rest[left] = query
                        left += 1
                        continue
                    _of_eigenfunctions(S, T, kind, piece, orders, tables, rows)
                    powered(kind, FIRST, level, TERMS, tables, rows)
                    turned *= tables.mantissas[kind, level % STEP]
                    turned *= tables.mantissas[kind, STEP + level // STEP]
                    step += tables.exponents[kind, level % STEP] + (level + 1) * order
                    step += tables.exponents[kind, STEP + level // STEP]
                    for channel in range(0, out.shape[2], LANES):
                        _sum6(rows, n, modes, block + channel + width, width, found)
                        _write(found, len(orders), turning, turn, turned, step, out, query, channel)
                    continue
                if kind > 1 and not 0 < level <= kept(code, tables):
                    rest[left] = query
                    left += 1
                    continue
                number = along = across = 0
                if kind > 1:
                    step += level * order
                else:
                    number, S, T, along, across = piece_of(code, S, T, patches)
                _of_splines(S, T, number, orders, pieces, sums)
                for r in range(len(orders)):
                    power = along * orders[r, 0] + across * orders[r, 1]
                    for k in range(size if power else 0):
                        sums[size * r + k] = scale_by_two(sums[size * r + k], power)
                for channel in range(0, out.shape[2], LANES):
                    grid, numbers, first, base, column = controls(
                        code, place, channel, patches, tables, points, room
                    )
                    gather(grid, numbers, first, base, column, sums, 1.0, found)
                    _write(found, len(orders), turning, turn, turned, step, out, query, channel)
        return left

    return higher
