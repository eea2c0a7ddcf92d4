"""Normal equations of fits: sums over points of weights times weights times 3 x 3 matrices."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Array = NDArray[Any]

# entries of a symmetric 3 x 3 matrix, and where these are
PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
ENTRY = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
_ROWS = 32  # that are multiplied at once
_MOST = 1 << 22  # numbers that are in memory at once
_FLOOR = 0.1  # of the mean of the diagonal


def sums(W: csr_array, metric: Array) -> list[csr_array]:
    """For each of `PAIRS` the matrix ``W.T @ diag(metric[:, k]) @ W``, (n, n).

    Rows with entries in the same columns are multiplied as dense blocks, some 32 rows at a time.

    Parameters
    ----------
    W : csr_array, shape (q, n)
    metric : (q, 6)
    """
    from scipy.sparse import coo_array, csr_array

    n, each = W.shape[1], np.diff(W.indptr)
    keys = np.random.default_rng(1).integers(1 << 62, size=n)
    ends = np.cumsum(keys[W.indices])
    code = np.diff(np.concatenate([[0], ends])[W.indptr])  # (sums that wrap are as good)
    order = np.lexsort((code, each))
    total = [csr_array((n, n)) for _ in PAIRS]
    for k in np.unique(each[each > 0]).tolist():
        rows = order[each[order] == k]
        new = np.append(True, code[rows][1:] != code[rows][:-1])
        most = max(1, _MOST // (len(PAIRS) * k * k))
        starts = np.flatnonzero(new)
        for part in range(0, len(starts), most):
            first = starts[part]
            last = starts[part + most] if part + most < len(starts) else len(rows)
            some = rows[first:last]
            at = W.indptr[some][:, None] + np.arange(k)
            begins = starts[part : part + most] - first
            blocks = _products(W.data[at], metric[some], begins)
            columns = W.indices[at[begins]]
            i = np.repeat(columns, k, axis=1).ravel()
            j = np.tile(columns, (1, k)).ravel()
            for which, one in enumerate(blocks):
                total[which] = total[which] + coo_array((one.ravel(), (i, j)), shape=(n, n)).tocsr()
    return total


def _products(A: Array, metric: Array, begins: Array) -> Array:
    """Sums over runs of rows of ``A[r, i] metric[r, c] A[r, j]``: (6, runs, k, k)."""
    k, each = A.shape[1], np.diff(np.append(begins, len(A)))
    count = -(-each // _ROWS)
    block = np.concatenate([[0], np.cumsum(count)])
    run = np.repeat(np.arange(len(each)), each)
    place = _ROWS * block[run] + np.arange(len(A)) - begins[run]
    rows = np.zeros((_ROWS * block[-1], k))
    scaled = np.zeros((_ROWS * block[-1], metric.shape[1], k))
    rows[place], scaled[place] = A, metric[:, :, None] * A[:, None]
    left = scaled.reshape(block[-1], _ROWS, -1).transpose(0, 2, 1)
    found = np.matmul(left, rows.reshape(block[-1], _ROWS, k))
    found = np.add.reduceat(found, block[:-1], axis=0)
    return found.reshape(len(each), metric.shape[1], k, k).transpose(1, 0, 2, 3)


class Normal:
    """A symmetric matrix (3 n, 3 n) of blocks, and solutions with some of its diagonal added."""

    def __init__(self, blocks: list[csr_array]) -> None:
        from scipy.sparse import block_array

        own = sum(blocks[k].diagonal() for k in (0, 3, 5)) / 3
        # of each vertex as much as it has, so that it moves as easily whether its faces are large
        # or small; and something where there is nothing
        self._damped = np.tile(own + _FLOOR * own.mean(), 3)
        self._matrix = block_array([[blocks[k] for k in row] for row in ENTRY], format="csc")

    def solve(self, damping: float, right: Array) -> Array | None:
        """A step (n, 3) for a right side (n, 3); None if the matrix is singular by rounding."""
        # (LAPACK's factorizations of small matrices take ten times as long by several threads)
        from scipy.sparse import diags_array
        from scipy.sparse.linalg import splu

        shifted = (self._matrix + diags_array(damping * self._damped)).tocsc()
        options = {"SymmetricMode": True}
        try:
            factor = splu(shifted, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0, options=options)
        except RuntimeError:
            return None
        found = factor.solve(right.T.ravel()).reshape(3, -1).T
        return np.asarray(found) if np.isfinite(found).all() else None

    def curvature(self, step: Array) -> float:
        """``step^T matrix step`` of a step (n, 3)."""
        flat = step.T.ravel()
        return float(flat @ (self._matrix @ flat))
