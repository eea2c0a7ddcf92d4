"""Where matrices over the functions of a space have entries, and where each element adds to them.

Upper triangles are added up, and copied to lower ones: matrices are symmetric to the last digit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf.caching import cached_property
from limitsurf.engine.packing import over_chunks
from limitsurf.fem.elements import Group
from limitsurf.refine import sharing

Array = NDArray[Any]

_AT_ONCE = 1 << 21  # entries of elements that are added up together
_COPIED = 1 << 17  # entries of a matrix that are copied together
_SPARSE = 2  # entries are added up by themselves in a range of at most so many places for each

# a range from a place on with values there, or places with a value each
Summand: TypeAlias = "tuple[int | Array, Array]"
Work: TypeAlias = Callable[[slice], "tuple[int, Array, Array]"]


def pairs(size: int) -> tuple[Array, Array]:
    """Rows and columns (size (size + 1) / 2,) of the upper triangle of an element's matrix."""
    return np.triu_indices(size)


class Pattern:
    """The entries of matrices of n functions that live on groups of elements.

    Attributes
    ----------
    n : int
    places : list of (F, C (C + 1) / 2) int32
        For each group where the upper triangles of its elements add to that of the matrix.
    indptr, indices : int32
        Of whole matrices, as CSR has them.
    """

    def __init__(self, n: int, groups: list[Group]) -> None:
        self.n, self._groups = n, groups
        low, high, shapes = [], [], []
        for group in groups:
            i, j = pairs(group.controls.shape[1])
            one, other = (np.take(group.controls, x, axis=1) for x in (i, j))
            low.append(np.minimum(one, other).ravel())
            high.append(np.maximum(one, other).ravel())
            shapes.append(one.shape)
        row, column = (np.concatenate(x) if x else np.zeros(0, np.int32) for x in (low, high))
        del low, high
        order = _order(column, n)
        order = order[_order(row[order], n)]
        row, column = row[order], column[order]
        first = np.ones(len(order), dtype=bool)
        first[1:] = (row[1:] != row[:-1]) | (column[1:] != column[:-1])
        place = np.empty(len(order), dtype=np.int32)
        place[order] = np.cumsum(first, dtype=np.int32) - np.int32(1)
        ends = np.cumsum([a * b for a, b in shapes])[:-1]
        self.places = [
            x.reshape(shape) for x, shape in zip(np.split(place, ends), shapes, strict=True)
        ]
        self._upper = int(np.count_nonzero(first))
        self._fill(row[first], column[first])

    def _fill(self, row: Array, column: Array) -> None:
        """Whole rows from those of the upper triangle."""
        from scipy.sparse import csr_array

        n, number = self.n, np.arange(1, self._upper + 1, dtype=np.int32)
        counts = np.bincount(row, minlength=n)
        indptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
        upper = csr_array((number, column, indptr), shape=(n, n))
        below = row != column
        lower = csr_array((number[below], (column[below], row[below])), shape=(n, n))
        whole = (upper + lower).tocsr()
        whole.sort_indices()
        self._source = whole.data - np.int32(1)
        self.indptr, self.indices = whole.indptr, whole.indices

    @cached_property
    def _both(self) -> tuple[Array, Array]:
        """Where each entry of the upper triangle is in a whole matrix, and where its mirror is."""
        row = np.repeat(np.arange(self.n), np.diff(self.indptr))
        above, below = np.empty((2, self._upper), dtype=np.int64)
        for to, which in ((above, self.indices >= row), (below, self.indices <= row)):
            to[self._source[which]] = np.flatnonzero(which)
        return above, below

    def symmetric(self, count: int, work: Work, workers: int) -> Any:
        """The sum of upper triangles (F, C (C + 1) / 2) of some rows of groups.

        `work` gives these three for slices of one number below `count`, in threads.
        """

        def own(part: slice) -> Summand:
            group, rows, values = work(part)
            return _one(self.places[group][rows], values)

        total = _summed(self._upper, over_chunks(count, workers, own, 1))
        data = np.empty(len(self._source))

        def copied(part: slice) -> None:
            np.take(total, self._source[part], out=data[part], mode="clip")

        for _ in over_chunks(len(data), workers, copied, _COPIED):
            pass
        return self._made(data)

    def general(self, count: int, work: Work, workers: int) -> Any:
        """The sum of element matrices (F, C, C), told as those of `symmetric`."""
        above, below = self._both

        def own(part: slice) -> Summand:
            group, rows, values = work(part)
            controls = self._groups[group].controls[rows]
            i, j = pairs(controls.shape[1])
            there = self.places[group][rows]
            ordered = controls[:, i] <= controls[:, j]
            both = np.empty(values.shape, dtype=np.int64)
            both[:, i, j] = np.where(ordered, above[there], below[there])
            both[:, j, i] = np.where(ordered, below[there], above[there])
            return _one(both, values)

        return self._made(_summed(len(self.indices), over_chunks(count, workers, own, 1)))

    def vectors(self, parts: Iterable[tuple[int, Array, Array]]) -> Any:
        """A matrix over functions of d components, unknowns of a function together.

        The sum of blocks (F, C (C + 1) / 2, d, d) of pairs of functions, of some rows of groups:
        of upper triangles, and symmetric where both functions are one.
        """
        from scipy.sparse import bsr_array, csc_array

        total: Array | None = None
        for group, rows, values in parts:
            controls = self._groups[group].controls[rows]
            i, j = pairs(controls.shape[1])
            turned = (controls[:, i] > controls[:, j])[:, :, None, None]
            own = np.where(turned, values.swapaxes(2, 3), values)
            place = self.places[group][rows].ravel()
            adding = csc_array(
                (np.ones(len(place)), place, np.arange(len(place) + 1)),
                shape=(self._upper, len(place)),
            )
            found = adding @ own.reshape(len(place), -1)
            total = found if total is None else np.add(total, found, out=total)
        d = 0 if total is None else int(np.sqrt(total.shape[1]))
        if total is None:
            total = np.zeros((self._upper, 0))
        data = total.reshape(-1, d, d)[self._source]
        row = np.repeat(np.arange(self.n), np.diff(self.indptr))
        below = self.indices < row
        data[below] = data[below].swapaxes(1, 2)
        shape = d * self.n, d * self.n
        return bsr_array((data, self.indices, self.indptr), shape=shape).tocsr()

    def _made(self, values: Array) -> Any:
        (found,) = sharing(self.indptr, self.indices, [values], (self.n, self.n))
        found.indptr, found.indices = self.indptr, self.indices
        return found


def _order(keys: Array, n: int) -> Array:
    """Which keys from 0 to n - 1 come first, equal ones in their order; in linear time."""
    from scipy.sparse import csr_array

    starts = np.arange(len(keys) + 1, dtype=np.int32)
    one = csr_array((np.ones(len(keys), np.int8), keys, starts), shape=(len(keys), n))
    return np.asarray(one.tocsc().indices)


def _one(places: Array, values: Array) -> Summand:
    """Values at places as one summand: added up in a range of places, where they lie together."""
    places, values = places.ravel(), values.ravel()
    if not len(places):
        return places, values
    low, high = int(places.min()), int(places.max()) + 1
    if high - low > _SPARSE * len(places):
        return places, values
    return low, _added(places - low, values, high - low)


def _added(places: Array, values: Array, size: int) -> Array:
    """Sums (size,) of values at places: a product with a sparse matrix, the fastest way."""
    from scipy.sparse import csc_array

    count = len(places)
    kind = np.int32 if max(count, size) < 2**31 else np.int64
    starts = np.arange(count + 1, dtype=kind)
    adding = csc_array((np.ones(count), places.astype(kind), starts), shape=(size, count))
    return np.asarray(adding @ values)


def _summed(size: int, summands: Iterable[Summand]) -> Array:
    """Sums (size,) of summands, in their order; many small ones at a time."""
    total = np.zeros(size)
    waiting: list[tuple[Array, Array]] = []

    def add() -> None:
        place, value = (np.concatenate(z) for z in zip(*waiting, strict=True))
        np.add(total, _added(place, value, size), out=total)
        waiting.clear()

    for place, value in summands:
        if isinstance(place, int):
            total[place : place + len(value)] += value
            continue
        waiting.append((place, value))
        if sum(len(x) for _, x in waiting) >= _AT_ONCE:
            add()
    if waiting:
        add()
    return total
