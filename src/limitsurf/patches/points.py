"""Control points beyond those of the cage: sparse rows over control points of lower number."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf import numbers
from limitsurf.numbers import NumberType
from limitsurf.refine import ExactOperator

Array = NDArray[Any]
# the number of entries of each row; columns and values of the entries of all rows, in turn
Rows: TypeAlias = tuple[Array, Array, Array]


def rows_of(operator: Any, numbers: Array, n: int | None = None) -> Rows:
    """The first rows of an operator whose columns are control points of these numbers."""
    if isinstance(operator, ExactOperator):
        starts, columns, values = operator.indptr, operator.columns, operator.values
    else:
        starts, columns, values = operator.indptr, operator.indices, operator.data
    counts = np.diff(starts[: None if n is None else n + 1])
    end = starts[len(counts)]
    return counts, numbers[columns[:end]], values[:end]


def some_rows(rows: Rows, which: Array) -> Rows:
    """Some of the rows, by a bool for each."""
    if which.all():
        return rows
    counts, columns, values = rows
    entries = np.repeat(which, counts)
    return counts[which], columns[entries], values[entries]


def without_unused(combined: Sequence[Rows], needed: Array) -> tuple[list[Any], Array]:
    """Operators of those rows that are needed, over control points that are numbered anew.

    `needed` (n_points,) bool tells which points are, of those of the cage and then of the rows;
    what needed rows combine is added. Also returned are the new numbers, as by `new_numbers`.
    """
    kept, end = [], len(needed)
    for rows in combined[::-1]:
        start = end - len(rows[0])
        kept.append(some_rows(rows, needed[start:end]))
        needed[kept[-1][1]] = True
        end = start
    number, operators = new_numbers(needed), []
    for counts, columns, values in kept[::-1]:
        if len(counts):
            operators.append(operator_of((counts, number[columns], values), end))
            end += len(counts)
    return operators, number


def new_numbers(needed: Array) -> Array:
    """The numbers of control points among those that are needed, -1 for the others; int32."""
    number = np.cumsum(needed, dtype=np.int32) - np.int32(1)
    number[~needed] = -1
    return number


def converted(operator: Any, number: NumberType) -> Any:
    """An operator of float64 with entries of another type."""
    counts, values = np.diff(operator.indptr), number.array(operator.data)
    return operator_of((counts, operator.indices, values), operator.shape[1])


def operator_of(rows: Rows, width: int) -> Any:
    """The operator of some rows."""
    counts, columns, values = rows
    shape = len(counts), width
    if numbers.type_of(values).exact:
        return ExactOperator(np.repeat(np.arange(len(counts)), counts), columns, values, shape)
    from scipy.sparse import csr_array

    starts = np.zeros(len(counts) + 1, dtype=np.int32)
    np.cumsum(counts, out=starts[1:])
    return csr_array((values, columns, starts), shape=shape)
