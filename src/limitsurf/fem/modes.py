"""Eigenvalues and eigenfunctions of the Laplace-Beltrami operator, none of them left out.

Krylov methods started from one vector see each eigenspace once, and find further copies of a
multiple eigenvalue by rounding alone. By Sylvester's law of inertia ``K - s M`` has as many
negative pivots as there are eigenvalues below s: that count tells what is missing, and what further
starts find is added until nothing is.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.checks import checked_integer
from limitsurf.fem.forms import factors, refuse_dependent
from limitsurf.fem.space import Space

Array = NDArray[Any]

_DENSE = 400  # unknowns up to which matrices are dense
_SPARE = 4  # eigenvalues beyond those asked for, among which there should be a gap
_STARTS = 6
_APART = 1e-6  # relative gap at which eigenvalues are counted
_SAME = 1e-12  # part of a vector in norm squared that is new


@dataclass(frozen=True, eq=False, repr=False)
class Eigenmodes:
    """What `eigenmodes` returns.

    Attributes
    ----------
    eigenvalues : (k,) float64
        Ascending, each as often as its multiplicity; of the unit 1 / length^2.
    modes : (n, k) float64
        Coefficients of the eigenfunctions; integrals of products of two of them are 0, of their
        squares 1.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> ls.eigenmodes(ls.Space(ls.LimitSurface(square), levels=2), 2)
    Eigenmodes(2 of 49, eigenvalues 0 to 9.87)
    """

    eigenvalues: NDArray[np.float64]
    modes: NDArray[np.float64]

    def __repr__(self) -> str:
        n, k = self.modes[..., 0].size, len(self.eigenvalues)
        ends = (f"{abs(x) if abs(x) < 1e-9 else x:.3g}" for x in self.eigenvalues[[0, -1]])
        ends = (x if "e-" not in x else "0" for x in ends)
        return f"Eigenmodes({k} of {n}, eigenvalues {' to '.join(ends)})"


def eigenmodes(space: Space, k: int, *, workers: int = 1) -> Eigenmodes:
    """The first eigenvalues of minus the Laplace-Beltrami operator, and their functions.

    Functions satisfy no condition at boundaries: normal derivatives of eigenfunctions vanish there.

    Parameters
    ----------
    space : Space
    k : int
        How many, zero ones and all copies of multiple ones included; 1 to ``space.n``.
    workers : int
        Threads for the matrices, as for `LimitSurface.evaluate`.

    Returns
    -------
    Eigenmodes

    Raises
    ------
    ValueError
        For a k out of range.

    Warns
    -----
    RuntimeWarning
        If some eigenvalues could not be found: how many are missing is known by counting.

    Notes
    -----
    Eigenvalues of a space are upper bounds of those of the surface, to rounding and quadrature.
    They are found by Lanczos's method on the inverse (ARPACK, by SciPy), and counted by Sylvester's
    law of inertia.

    Examples
    --------
    >>> import numpy as np
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> space = ls.Space(ls.LimitSurface(square), levels=3)
    >>> found = ls.eigenmodes(space, 4)
    >>> (abs(found.eigenvalues) / np.pi**2).round(4).tolist()  # i^2 + j^2
    [0.0, 1.0, 1.0, 2.0]
    """
    if not isinstance(space, Space):
        raise TypeError(f"eigenmodes needs a Space, got {type(space).__name__}")
    k = checked_integer("k", k, 1)
    if k > space.n:
        raise ValueError(f"k must be 1 to {space.n}, the number of unknowns, got {k}")
    K, M = space.stiffness(workers=workers), space.mass(workers=workers)
    return lowest(K, M, k, -1 / float(M.sum()))  # (of the area: functions add up to 1)


def lowest(K: Any, M: Any, k: int, shift: float) -> Eigenmodes:
    """The lowest modes of symmetric matrices, M positive and K not negative, from below 0 on."""
    n = K.shape[0]
    if n <= _DENSE or k + _SPARE >= n // 2:
        from scipy.linalg import eigh, eigvalsh

        refuse_dependent(eigvalsh(M.toarray()))
        values, modes = eigh(K.toarray(), M.toarray(), subset_by_index=(0, k - 1))
        return Eigenmodes(values, modes)
    return _sparse(K.tocsc(), M.tocsc(), k, shift)


def _sparse(K: Any, M: Any, k: int, shift: float) -> Eigenmodes:
    """Modes by Krylov spaces, from further starts until their number is right."""
    from scipy.sparse.linalg import LinearOperator, eigsh

    solver = factors(K - shift * M)
    inverse = LinearOperator(K.shape, matvec=solver.solve, dtype=float)
    rng = np.random.default_rng(0)
    found, values, missing = np.zeros((len(K.indptr) - 1, 0)), np.zeros(0), 0
    for start in range(_STARTS):
        asked = min(k + _SPARE + 2 * start, K.shape[0] - 2)
        _, more = eigsh(
            K,
            asked,
            M,
            sigma=shift,
            OPinv=inverse,
            v0=rng.normal(size=K.shape[0]),
            ncv=min(2 * asked + 20, K.shape[0] - 1),
        )
        values, found = _ritz(K, M, np.concatenate([found, more], axis=1))
        gaps = np.diff(values[k - 1 :]) / np.maximum(values[k:], -shift)
        if not len(gaps) or gaps.max() < _APART:
            continue
        first = k + int(np.flatnonzero(gaps >= min(1e-3, gaps.max()))[0])
        count = _count(K, M, (values[first - 1] + values[first]) / 2)
        if count is None:
            continue
        missing = count - first
        if missing <= 0:
            return Eigenmodes(values[:k], found[:, :k])
    how = f"{missing} are missing" if missing > 0 else "they could not be counted"
    warnings.warn(
        f"some of the first {k} eigenvalues may not have been found: {how}",
        RuntimeWarning,
        stacklevel=3,
    )
    return Eigenmodes(values[:k], found[:, :k])


def _ritz(K: Any, M: Any, vectors: Array) -> tuple[Array, Array]:
    """Eigenvalues and orthonormal eigenvectors within the span of vectors."""
    gram = vectors.T @ (M @ vectors)
    size, axes = np.linalg.eigh((gram + gram.T) / 2)
    new = size > _SAME * size.max()
    basis = vectors @ (axes[:, new] / np.sqrt(size[new]))
    projected = basis.T @ (K @ basis)
    values, turn = np.linalg.eigh((projected + projected.T) / 2)
    return values, basis @ turn


def _count(K: Any, M: Any, shift: float) -> int | None:
    """How many eigenvalues are below a shift; None if pivots do not tell."""
    solver = factors(K - shift * M)
    if not np.array_equal(solver.perm_r, solver.perm_c):
        return None
    return int((solver.U.diagonal() < 0).sum())
