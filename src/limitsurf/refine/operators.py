"""Sparse operators, of float64 or of exact numbers: what refinement and weights are made of."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from copy import copy
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf import numbers
from limitsurf.caching import cached_property
from limitsurf.cage.mesh import Mesh
from limitsurf.numbers import NumberType

if TYPE_CHECKING:
    from scipy.sparse import csr_array


Array = NDArray[Any]


class ExactOperator:
    """A sparse matrix of exact numbers: what ``scipy.sparse`` is for float64.

    Attributes
    ----------
    rows, columns : (nnz,) int64
        Sorted by row, then column, without duplicates.
    values : (nnz,) object
    shape : (int, int)

    Examples
    --------
    >>> import limitsurf as ls
    >>> from fractions import Fraction
    >>> square = ls.Mesh([[0], [1], [1], [0]], [[0, 1, 2, 3]])
    >>> W = ls.LimitSurface(square).weights(0, Fraction(1, 3), Fraction(1, 2))
    >>> [str(w) for w in W.toarray()[0]], str((W @ square.points)[0, 0])
    (['1/3', '1/6', '1/6', '1/3'], '1/3')
    """

    def __init__(self, rows: Array, columns: Array, values: Array, shape: tuple[int, int]) -> None:
        order = np.lexsort((columns, rows))
        rows, columns, values = rows[order], columns[order], values[order]
        if len(rows):
            new = np.flatnonzero(np.diff(rows, prepend=-1) | np.diff(columns, prepend=-1))
            rows, columns, values = rows[new], columns[new], np.add.reduceat(values, new)
        self.rows, self.columns, self.values, self.shape = rows, columns, values, shape

    @cached_property
    def indptr(self) -> NDArray[np.int64]:
        """Row r is entries ``indptr[r]`` to ``indptr[r + 1] - 1``, (rows + 1,)."""
        return np.searchsorted(self.rows, np.arange(self.shape[0] + 1))

    @overload
    def __matmul__(self, other: ExactOperator) -> ExactOperator: ...
    @overload
    def __matmul__(self, other: ArrayLike) -> Array: ...
    def __matmul__(self, other: Any) -> Any:
        """Product with another operator, or with an array of shape (columns, ...), exactly."""
        shape = other.shape if isinstance(other, ExactOperator) else np.shape(other)
        if shape[:1] != (self.shape[1],):
            raise ValueError(f"an operator of shape {self.shape} cannot act on shape {shape}")
        if isinstance(other, ExactOperator):
            counts = np.diff(other.indptr)[self.columns]
            entry = np.repeat(np.arange(len(self.rows)), counts)
            place = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
            place += other.indptr[self.columns[entry]]
            values, others, unit = _over_common_denominators(self.values, other.values)
            product = ExactOperator(
                self.rows[entry],
                other.columns[place],
                values[entry] * others[place],
                (self.shape[0], other.shape[1]),
            )
            product.values = product.values * unit
            return product
        dense = numbers.RATIONAL.array(other)
        flat = dense.reshape(len(dense), -1)
        result = np.full((self.shape[0], flat.shape[1]), Fraction(0), dtype=object)
        if len(self.rows):
            present, first = np.unique(self.rows, return_index=True)
            values, flat, unit = _over_common_denominators(self.values, flat)
            terms = values[:, None] * flat[self.columns]
            result[present] = np.add.reduceat(terms, first, axis=0) * unit
        return result.reshape(self.shape[0], *dense.shape[1:])

    def with_values(self, values: Array) -> ExactOperator:
        """Another matrix with entries at the same places; it shares the arrays that say where.

        Examples
        --------
        >>> import limitsurf as ls
        >>> from fractions import Fraction
        >>> square = ls.LimitSurface(ls.Mesh([[0], [1], [1], [0]], [[0, 1, 2, 3]]))
        >>> W = square.weights(0, Fraction(1, 2), Fraction(1, 2))
        >>> str((W.with_values(2 * W.values) @ [[1], [1], [1], [1]])[0, 0])
        '2'
        """
        other = copy(self)
        other.values = values
        return other

    def toarray(self) -> Array:
        """The matrix as a dense object array."""
        dense = np.full(self.shape, Fraction(0), dtype=object)
        dense[self.rows, self.columns] = self.values
        return dense

    def __repr__(self) -> str:
        return f"<ExactOperator of shape {self.shape} with {len(self.rows)} entries>"


def _over_common_denominators(a: Array, b: Array) -> tuple[Array, Array, Fraction | int]:
    """Integers and the unit of their products, where Fractions allow short ones; else a, b and 1.

    Sums of products are then reduced once, not term by term.
    """
    unit, scaled = Fraction(1), []
    for values in (a, b):
        if not all(type(x) is Fraction for x in values.flat):
            return a, b, 1
        D = 1
        for x in {x.denominator for x in values.flat}:
            D = math.lcm(D, x)
            if D.bit_length() > 1000:
                return a, b, 1
        integers = (x.numerator * (D // x.denominator) for x in values.flat)
        scaled.append(np.fromiter(integers, object, values.size).reshape(values.shape))
        unit /= D
    return scaled[0], scaled[1], unit


def sparse_operator(rows: Array, columns: Array, values: Array, shape: tuple[int, int]) -> Any:
    """``csr_array`` for float64 values, `ExactOperator` for objects; duplicates are summed."""
    if numbers.type_of(values).exact:
        return ExactOperator(rows, columns, values, shape)
    from scipy.sparse import coo_array

    return coo_array((values, (rows, columns)), shape=shape).tocsr()


def identity(n: int, number: NumberType) -> Any:
    """The operator that changes nothing, (n, n)."""
    every = np.arange(n)
    return sparse_operator(every, every, number.full(n, number.one), (n, n))


class SparseRows(NamedTuple):
    """A sparse matrix by its rows, as `csr` takes it."""

    indptr: Array
    indices: Array
    data: Array
    shape: tuple[int, int]


def csr(starts: Array, columns: Array, values: Array, shape: tuple[int, int]) -> csr_array[Any]:
    """A sparse matrix by its rows, with indices of 32 bits if these suffice."""
    from scipy.sparse import csr_array

    short = np.int32 if max(starts[-1], *shape) < 2**31 else np.int64
    return csr_array((values, columns.astype(short, copy=False), starts.astype(short)), shape=shape)


def multiplied(one: Any, other: Any, compiled: bool) -> Any:
    """The product of two operators; columns of sparse matrices ascend."""
    if not compiled:
        result = one @ other
        if not isinstance(result, ExactOperator):
            result.sort_indices()
        return result
    from limitsurf._kernels import refinement

    # room for as many entries as there are products; memory beyond what remains is never touched
    most = int(np.diff(other.indptr)[one.indices].sum(dtype=np.int64))
    columns, values = np.empty(most, other.indices.dtype), np.empty(most)
    starts = np.empty(one.shape[0] + 1, np.int64)
    seen, total = np.full(other.shape[1], -1), np.empty(other.shape[1])
    refinement.product(
        *(one.indptr, one.indices, one.data, other.indptr, other.indices, other.data),
        *(seen, total, starts, columns, values),
    )
    columns, values = columns[: starts[-1]], values[: starts[-1]]
    result = csr(starts, columns, values, (one.shape[0], other.shape[1]))
    result.has_sorted_indices = result.has_canonical_format = True
    return result


def stacked(parts: list[Any]) -> Any:
    """Operators of equal width, one above the other."""
    if len(parts) == 1:
        return parts[0]
    if isinstance(parts[0], ExactOperator):
        heights = np.cumsum([0] + [part.shape[0] for part in parts])
        return ExactOperator(
            np.concatenate([h + x.rows for h, x in zip(heights, parts, strict=False)]),
            np.concatenate([x.columns for x in parts]),
            np.concatenate([x.values for x in parts]),
            (int(heights[-1]), parts[0].shape[1]),
        )
    from scipy.sparse import vstack

    return vstack(parts, format="csr")


def sharing(
    starts: Array, columns: Array, values: Iterable[Array], shape: tuple[int, int]
) -> list[Any]:
    """Sparse matrices of the same rows, one for each array of values; columns ascend."""
    found = [csr(starts, columns, one, shape) for one in values]
    for matrix in found:
        matrix.indptr, matrix.indices = found[0].indptr, found[0].indices
        matrix.has_sorted_indices = matrix.has_canonical_format = True
    return found


def on_one_pattern(operators: list[Any]) -> list[Any]:
    """The same operators with the same entries: zeros are added where only others have any."""
    if len(operators) < 2:
        return operators
    first, width = operators[0], operators[0].shape[1]
    parts = list(map(entries, operators))
    keys = [rows.astype(np.int64) * width + columns for rows, columns, _ in parts]
    every = np.concatenate(keys)
    every.sort(kind="stable")  # which is fast where parts ascend, as most of them do
    every = every[np.diff(every, prepend=-1) != 0]
    number, filled = numbers.type_of(parts[0][2]), []
    for key, (_, _, values) in zip(keys, parts, strict=True):
        filled.append(number.full(len(every), number.zero))
        filled[-1][np.searchsorted(every, key)] = values
    rows, columns = np.divmod(every, max(width, 1))
    if isinstance(first, ExactOperator):
        one = ExactOperator(rows, columns, filled[0], first.shape)
        return [one.with_values(values) for values in filled]
    starts = np.searchsorted(rows, np.arange(first.shape[0] + 1))
    return sharing(starts, columns, filled, first.shape)


def merged(some: list[Any], others: list[Any], which: Array) -> list[Any]:
    """Sparse matrices of which some rows are those of others, `which` (rows,) tells; in order.

    Both are on one pattern.
    """
    one, other = some[0], others[0]
    order = np.argsort(np.argsort(which, kind="stable"), kind="stable")
    before = np.concatenate([one.indptr, one.indptr[-1] + other.indptr[1:]]).astype(np.int64)
    counts = np.diff(before)[order]
    starts = np.concatenate([[0], np.cumsum(counts)])
    take = np.arange(starts[-1]) + np.repeat(before[:-1][order] - starts[:-1], counts)
    columns = np.concatenate([one.indices, other.indices])[take]
    values = (np.concatenate([a.data, b.data])[take] for a, b in zip(some, others, strict=True))
    return sharing(starts, columns, values, (len(which), one.shape[1]))


def eliminated(total: Any, operator: Any) -> Any:
    """Replace the last columns of `total` by the rows of `operator` that they stand for."""
    n = operator.shape[1]
    if isinstance(total, ExactOperator):
        kept = total.columns < n
        last = ExactOperator(
            total.rows[~kept],
            total.columns[~kept] - n,
            total.values[~kept],
            (total.shape[0], operator.shape[0]),
        )
        more = last @ operator
        return ExactOperator(
            np.concatenate([total.rows[kept], more.rows]),
            np.concatenate([total.columns[kept], more.columns]),
            np.concatenate([total.values[kept], more.values]),
            (total.shape[0], n),
        )
    result = total[:, :n] + total[:, n:] @ operator
    result.sort_indices()
    return result


def over_values(operator: Any, mesh: Mesh, channel: tuple[Array, Array, Any]) -> Any:
    """An operator over the values of a channel as they were given, not once for each vertex.

    Its columns are the vertices of the `mesh` of the channel, which is (values, which of them each
    corner has, how it is interpolated).
    """
    values, corner_rows, _ = channel
    column = np.empty(mesh.n_vertices, dtype=np.int64)
    column[mesh.indices] = corner_rows
    rows, columns, found = entries(operator)
    return sparse_operator(rows, column[columns], found, (operator.shape[0], len(values)))


def entries(operator: Any) -> tuple[Array, Array, Array]:
    """Rows, columns and values of an operator."""
    if isinstance(operator, ExactOperator):
        return operator.rows, operator.columns, operator.values
    found = operator.tocoo()
    return found.row, found.col, found.data


def channel_groups(count: int) -> Iterator[tuple[int, tuple[int, ...]]]:
    """The first of each three channels, and three numbers, then of each that is left, and one."""
    first = 0
    while first < count:
        channels = (0, 0, 0) if count - first >= 3 else (0,)
        yield first, channels
        first += len(channels)
