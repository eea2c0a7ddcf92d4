"""Bezier extraction: basis functions of a cage on elements, as sums of Bernstein polynomials."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf import memory
from limitsurf.pieces.bernstein import is_tensor
from limitsurf.pieces.cells import BezierRest
from limitsurf.query.bezier import bezier_patches
from limitsurf.refine import ExactOperator
from limitsurf.surface import LimitSurface

Array = NDArray[Any]


@dataclass(frozen=True, eq=False, repr=False)
class BezierExtraction:
    """Elements on a limit surface and their extraction operators, made by `bezier_extraction`.

    On element e, at s and t as in `BezierPatches`, function a of the cage is
    ``N[a] = operators[a] @ B(s, t)`` for the rows a from ``offsets[e]`` to ``offsets[e + 1]``, with
    the n Bernstein polynomials B in the order of `exponents`; it is that of vertex ``controls[a]``.
    All others vanish there.

    Attributes
    ----------
    face : (m,) int64
        Limit faces of the elements; those of a face stand together.
    origin, size : (m, 2) float64
        ``(u, v) = origin + size * (s, t)``, exact.
    offsets : (m + 1,) int64
        Where rows of each element begin.
    controls : (rows,) int64
        Connectivity: the vertex of each row, ascending within an element; or the row of the values
        of a channel.
    operators : (rows, n)
        float64, or Fractions.
    exponents : (n, 2) int64
        i and j of the Bernstein polynomials.
    n_controls : int
        Vertices of the cage, or values of the channel.
    rest : BezierRest
        What elements leave out at special corners; boxes are of the points (of the channel).

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2, 3]])
    >>> ls.bezier_extraction(ls.LimitSurface(square))
    BezierExtraction(1 element of degree 3, 4 controls)
    """

    face: NDArray[np.int64]
    origin: NDArray[np.float64]
    size: NDArray[np.float64]
    offsets: NDArray[np.int64]
    controls: NDArray[np.int64]
    operators: Array
    exponents: NDArray[np.int64]
    n_controls: int
    rest: BezierRest

    @property
    def degree(self) -> int:
        """Of the polynomials: in each direction of squares, in all of triangles."""
        return int(self.exponents.max())

    @property
    def tensor(self) -> bool:
        """Whether elements are squares, with products of polynomials in s and in t."""
        return is_tensor(self.exponents)

    def blocks(self) -> list[tuple[Array, Array, Array]]:
        """Elements with equally many controls together, for loops over few arrays.

        Returns
        -------
        list of (elements (e,), controls (e, K), operators (e, K, n))
            By ascending K.

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2, 3]])
        >>> extraction = ls.bezier_extraction(ls.LimitSurface(square))
        >>> [operators.shape for _, _, operators in extraction.blocks()]
        [(1, 4, 16)]
        """
        each = np.diff(self.offsets)
        found = []
        for count in np.unique(each).tolist():
            elements = np.flatnonzero(each == count)
            rows = self.offsets[elements, None] + np.arange(count)
            found.append((elements, self.controls[rows], self.operators[rows]))
        return found

    def __len__(self) -> int:
        return len(self.face)

    def __repr__(self) -> str:
        parts = [
            f"{len(self)} element{'s' * (len(self) != 1)} of degree {self.degree}",
            f"{self.n_controls} controls",
        ]
        if len(self.rest):
            parts.append(f"rest {self.rest!r}")
        return f"{type(self).__name__}({', '.join(parts)})"


def bezier_extraction(
    surface: LimitSurface,
    *,
    face: ArrayLike | None = None,
    depth: int | None = None,
    channel: str | None = None,
    workers: int = 1,
) -> BezierExtraction:
    """Bezier extraction operators: the basis functions of the cage in Bernstein form, by elements.

    Elements are the cells of `bezier_patches`. On a limit face amid regular vertices the operator
    is that of a uniform spline, 16 x 16 by Catmull-Clark's scheme; towards special corners
    elements are rings of three, over the same vertices of the cage, and ``rest`` says what is left
    beyond.

    Parameters
    ----------
    surface : LimitSurface
        Operators are Fractions if its points are exact.
    face : array_like of int, optional
        Limit faces; all by default.
    depth : int, optional
        Rings around special corners, as for `bezier_patches`; 8 by default.
    channel : str, optional
        A face-varying channel, whose values take the place of the vertices.
    workers : int
        Threads, as for `LimitSurface.evaluate`.

    Returns
    -------
    BezierExtraction

    Raises
    ------
    IndexError, TypeError, ValueError, MemoryError
        As by `bezier_patches`.

    Notes
    -----
    Borden, Scott, Evans and Hughes, "Isogeometric finite element data structures based on Bezier
    extraction of NURBS", Int. J. Numer. Meth. Engng 87, 2011, equation 26: ``N = C B``. Operators
    are rows of weights of Bernstein coefficients, derived in ``derivations/pieces.py``.

    Examples
    --------
    >>> import numpy as np
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> cube = ls.LimitSurface(ls.Mesh(points, quads))
    >>> extraction = ls.bezier_extraction(cube, depth=3)
    >>> extraction
    BezierExtraction(144 elements of degree 3, 8 controls, rest BezierRest(24 cells))
    >>> rows = slice(*extraction.offsets[:2])  # of element 0
    >>> bezier = extraction.operators[rows].T @ cube.points[extraction.controls[rows]]
    >>> bool(np.allclose(bezier.reshape(4, 4, 3), ls.bezier_patches(cube, depth=3).points[0]))
    True
    """
    if not isinstance(surface, LimitSurface):
        raise TypeError(f"bezier_extraction needs a LimitSurface, got {type(surface).__name__}")
    patches = bezier_patches(
        surface, face=face, depth=depth, weights=True, channel=channel, workers=workers
    )
    weights: Any = patches.weights
    size, total = len(patches.exponents), weights.shape[1]
    exact = isinstance(weights, ExactOperator)
    if exact:
        row, column, values = weights.rows, weights.columns, weights.values
    else:
        row = np.repeat(np.arange(weights.shape[0]), np.diff(weights.indptr))
        column, values = weights.indices.astype(np.int64), weights.data
    keys, place = np.unique((row // size) * total + column, return_inverse=True)
    each = size * (8 + 100 * exact)
    memory.refuse_beyond(len(keys), each, "rows of operators", "choose a smaller depth, or faces")
    shape = len(keys), size
    operators = np.full(shape, Fraction(0), dtype=object) if exact else np.zeros(shape)
    operators[place, row % size] = values
    element, controls = np.divmod(keys, max(total, 1))
    offsets = np.searchsorted(element, np.arange(len(patches) + 1))
    return BezierExtraction(
        patches.face,
        patches.origin,
        patches.size,
        offsets,
        controls,
        operators,
        patches.exponents,
        total,
        patches.rest,
    )
