"""Sparse quadratic minima under linear conditions, and how well these conditions are posed.

A minimum of ``x @ K @ x / 2 - b @ x`` where ``C x = p`` is a stationary point of a matrix that is
quasi-definite with a small -d on the diagonal of its second block: then every order of elimination
will do, symmetric, without pivoting (Vanderbei, "Symmetric quasidefinite matrices", SIAM J. Optim.
5, 1995). What d leaves is taken away by repeated solution for the residual.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.fem import forms

Array = NDArray[Any]

SINGULAR = 1e4  # condition from which on rows count as dependent
_RANK = 1e-6  # singular values below, relative to the largest, count as 0
_RELAXED = 1e-9
_STEPS = 12  # of iterated solution
_LANCZOS = 1e-2  # relative accuracy of extreme singular values
_DENSE = 64  # rows up to which all singular values are computed


def minimum(form: Any, load: Array, rows: Any, targets: Array) -> Array:
    """Where ``x @ form @ x / 2 - load @ x`` is least among all x with ``rows @ x = targets``.

    The form (n, n) must be positive definite. Where rows depend on each other and no x is exact,
    one of least squares.
    """
    from scipy.sparse import block_array, eye_array

    n, m = form.shape[0], rows.shape[0]
    # multipliers are as large as these over d, which must not overflow
    power = int(np.frexp(max(np.abs(x).max(initial=0) for x in (load, targets)))[1])
    load, targets = np.ldexp(load, -power), np.ldexp(targets, -power)
    if not m:
        return np.asarray(np.ldexp(forms.factors(form).solve(load), power))
    relaxed = -_RELAXED * eye_array(m)
    factors = forms.factors(block_array([[form, rows.T], [rows, relaxed]], format="csc"))
    total, best, least = np.zeros((n + m, *load.shape[1:])), None, np.inf
    for _ in range(_STEPS):
        x, multipliers = total[:n], total[n:]
        left = np.concatenate(
            [load - form @ x - rows.T @ multipliers, targets - rows @ x], dtype=np.float64
        )
        size = float(np.abs(left[n:]).max(initial=0))
        if best is not None and not size < 0.5 * least:
            if size < least:
                best = x
            break
        best, least = x.copy(), size
        total = total + factors.solve(left)
    assert best is not None
    return np.asarray(np.ldexp(best, power))


def square(rows: Any) -> tuple[Callable[[Array], Array] | None, float]:
    """What solves with a square matrix, and its condition; None where a pivot is 0."""
    matrix = rows.tocsc()
    try:
        factors = forms.factors(matrix)
    except ValueError:
        return None, np.inf

    def solve(targets: Array) -> Array:
        found = factors.solve(targets)
        return np.asarray(found + factors.solve(targets - matrix @ found))

    return solve, _condition(matrix, lambda x: factors.solve(factors.solve(x), "T"))


def condition(rows: Any) -> float:
    """The largest singular value of independent rows (m, n) over the smallest.

    From a dense decomposition of few rows; else by Lanczos iteration, to about 1 in 100, and then
    not above 3e4 where it is larger.
    """
    from scipy.sparse import block_array, eye_array

    m, n = rows.shape
    if m > n:
        return np.inf
    if not m:
        return 1.0
    if m <= _DENSE:
        sizes = np.linalg.svd(rows.toarray(), compute_uv=False)
        return float(sizes[0] / sizes[-1]) if sizes[-1] else np.inf
    blocks = [[eye_array(n), rows.T], [rows, -_RELAXED * eye_array(m)]]
    factors = forms.factors(block_array(blocks, format="csc"))

    def inverse(x: Array) -> Array:
        return np.asarray(-factors.solve(np.concatenate([np.zeros(n), x]))[n:])

    return _condition(rows.T.tocsc(), inverse)


def rank(rows: Any) -> int:
    """How many singular values are above 1e-6 of the bound ``sqrt(|C|_1 |C|_inf)`` of all.

    Counted by Sylvester's law of inertia: with t the square of that, [[1, C'], [C, t]] has as many
    negative eigenvalues as ``C C' - t`` has positive ones, and as many as its factors have pivots.
    """
    from scipy.sparse import block_array, eye_array

    m, n = rows.shape
    if m <= _DENSE:
        return int(np.linalg.matrix_rank(rows.toarray(), rtol=_RANK))
    most = abs(rows).sum(axis=0).max() * abs(rows).sum(axis=1).max()
    blocks = [[eye_array(n), rows.T], [rows, _RANK**2 * most * eye_array(m)]]
    pivots = forms.factors(block_array(blocks, format="csc")).U.diagonal()
    return int((pivots < 0).sum())


def _condition(matrix: Any, inverse: Callable[[Array], Array]) -> float:
    """From a matrix A, and the inverse of A' A (or of what has the same eigenvalues)."""
    from scipy.sparse.linalg import LinearOperator, eigsh

    n = matrix.shape[1]
    if n <= _DENSE:
        sizes = np.linalg.svd(matrix.toarray(), compute_uv=False)
        return float(sizes[0] / sizes[-1]) if sizes[-1] else np.inf
    across = matrix.T.tocsr()
    start = np.random.default_rng(0).standard_normal(n)
    found = []
    for apply in (lambda x: across @ (matrix @ x), inverse):
        operator = LinearOperator((n, n), matvec=lambda x, f=apply: f(x.ravel()), dtype=float)
        options = {"which": "LM", "tol": _LANCZOS, "v0": start, "ncv": 8, "maxiter": 100}
        largest = eigsh(operator, 1, return_eigenvectors=False, **options)[0]
        found.append(abs(float(largest)))
    return float(np.sqrt(found[0] * found[1]))
