"""Matrices over the unknowns of graded spaces, from those over the controls of elements."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.caching import cached_property
from limitsurf.fem.pattern import Pattern, Work
from limitsurf.refine import sharing

Array = NDArray[Any]
Parts = Iterable[tuple[int, Array, Array]]


class Extracted:
    """A `Pattern` over controls, whose matrices A are handed out as ``C.T @ A @ C``."""

    def __init__(self, local: Pattern, extraction: Any) -> None:
        self._local, self._matrix = local, extraction

    @cached_property
    def _places(self) -> Places:
        ones = np.ones(len(self._local.indices))
        n = self._local.n
        (a,) = sharing(self._local.indptr, self._local.indices, [ones], (n, n))
        positive = abs(self._matrix)
        return Places((positive.T @ a @ positive).tocsr())

    def symmetric(self, count: int, work: Work, workers: int) -> Any:
        """The sum of upper triangles of elements."""
        found = self._matrix.T @ self._local.symmetric(count, work, workers) @ self._matrix
        return self._places.of((found + found.T) / 2)

    def general(self, count: int, work: Work, workers: int) -> Any:
        """The sum of element matrices."""
        found = self._local.general(count, work, workers)
        return self._places.of(self._matrix.T @ found @ self._matrix)

    def vectors(self, parts: Parts) -> Any:
        """A matrix over functions of several components, unknowns of a function together."""
        from scipy.sparse import eye_array, kron

        local = self._local.vectors(parts)
        wide = kron(self._matrix, eye_array(local.shape[0] // self._local.n), format="csr")
        found = wide.T @ local @ wide
        return ((found + found.T) / 2).tocsr()


class Places:
    """Where matrices have entries: those whose entries are some of a given one's share arrays."""

    def __init__(self, matrix: Any) -> None:
        matrix.sort_indices()
        self._shape = matrix.shape
        self.indptr, self.indices = matrix.indptr, matrix.indices
        self._keys = _keys(matrix)

    def of(self, matrix: Any) -> Any:
        """The same matrix on these entries."""
        matrix = matrix.tocsr()
        data = np.zeros(len(self.indices))
        data[np.searchsorted(self._keys, _keys(matrix))] = matrix.data
        (found,) = sharing(self.indptr, self.indices, [data], self._shape)
        found.indptr, found.indices = self.indptr, self.indices
        return found


def _keys(matrix: Any) -> Array:
    row = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    return np.asarray(row * matrix.shape[1] + matrix.indices)
