"""Matrices and vectors of forms: sums over the points of a quadrature, element by element.

Elements of one kind at equal places have the same values of functions: their matrices are one
product of coefficients at points with a table of products. Blocks do not depend on the number of
threads, and are added up in their order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf.engine.orders import checked_order
from limitsurf.engine.packing import over_chunks
from limitsurf.engine.protocol import Order
from limitsurf.fem.basis import Basis, Block, Pair
from limitsurf.fem.checks import power_of_two, reals
from limitsurf.fem.geometry import Components

if TYPE_CHECKING:
    from limitsurf.fem.extraction import Extracted
    from limitsurf.fem.pattern import Pattern

Array = NDArray[Any]
# coefficients (F, P) of products of derivatives, in which weights of the quadrature are
Terms: TypeAlias = dict[Pair, Array]

_U, _V = (1, 0), (0, 1)
FIRST = ((0, 0), _U, _V)
_SINGULAR = 1e-13  # smallest pivot of a mass matrix, relative to the largest
_DEPENDENT = (
    "the functions of this space are linearly dependent: some combination of them vanishes in the "
    "limit, as that of 1 and -1 by turns at the corners of a cube; use more levels"
)


def mass(at: Components) -> Terms:
    """Of the product of two functions."""
    return {((0, 0), (0, 0)): at.measure}


def stiffness(at: Components) -> Terms:
    """Of the product of their gradients on the surface."""
    g, h, k = (x * at.own_measure for x in at.inverse)
    return {(_U, _U): g, (_U, _V): h, (_V, _V): k}


def components(basis: Basis, block: Block, points: Array, orders: Sequence[Order]) -> Components:
    """The geometry of a block from the points of the cage, up to its derivatives of some orders.

    Differences from a point of each face keep the digits of derivatives, and a unit of each face
    keeps squares of squares within the range of float64.
    """
    own = points[block.controls]
    origin = own[:, 0].copy()
    own -= origin[:, None]
    unit = power_of_two(own, (1, 2))[:, :, 0]
    own /= unit[:, :, None]
    f, c, _ = own.shape
    found = {}
    if block.table is not None:
        flat = np.ascontiguousarray(own.transpose(2, 0, 1)).reshape(3 * f, c)
        for nu in orders:
            found[nu] = (flat @ block.table.of(nu).T).reshape(3, f, -1)
    else:
        values = block.values()
        for nu in orders:
            found[nu] = np.ascontiguousarray(np.moveaxis(np.matmul(values[nu], own), 2, 0))
    if (0, 0) in found:
        found[0, 0] = found[0, 0] * unit + origin.T[:, :, None]
    at = Components(found, basis.quadrature.weights[block.points], unit)
    if _U in found and not (at.area > 0).all():
        bad = np.flatnonzero(~(at.area > 0).all(axis=1))
        raise ValueError(
            f"the area element vanishes on limit face {block.face[bad[0]]} (and {len(bad) - 1} "
            "more): forms need a surface with a tangent plane at the points of the quadrature"
        )
    return at


def matrix(
    basis: Basis,
    pattern: Pattern | Extracted,
    terms: Callable[[Block], Terms],
    workers: int,
    symmetric: bool = True,
) -> Any:
    """The matrix of a form; of symmetric ones terms of (nu, mu) stand for (mu, nu) as well."""

    def work(part: slice) -> tuple[int, Array, Array]:
        block = basis.blocks[part.start]
        return block.group, block.rows, _elements(block, terms(block), symmetric)

    add = pattern.symmetric if symmetric else pattern.general
    return add(len(basis.blocks), work, workers)


def _elements(block: Block, terms: Terms, symmetric: bool) -> Array:
    """Matrices (F, C, C) of the elements of a block, or upper triangles (F, C (C + 1) / 2)."""
    f, c = block.controls.shape
    if block.table is not None:
        table = block.table.products(list(terms), symmetric)
        found = np.concatenate(list(terms.values()), axis=1) @ table
        return found if symmetric else found.reshape(f, c, c)
    values = block.values()
    total = np.zeros((f, c, c))
    for (nu, mu), coefficient in terms.items():
        part = np.matmul(values[nu].swapaxes(1, 2), coefficient[:, :, None] * values[mu])
        total += part
        if symmetric and nu != mu:
            total += part.swapaxes(1, 2)
    if not symmetric:
        return total
    return _upper(total)


def _upper(elements: Array) -> Array:
    f, c = elements.shape[:2]
    i, j = np.triu_indices(c)
    return np.asarray(np.take(elements.reshape(f, c * c), i * c + j, axis=1))


def bilaplace(basis: Basis, pattern: Pattern | Extracted, points: Array, workers: int) -> Any:
    """The matrix of the product of the Laplacians of two functions."""

    def work(part: slice) -> tuple[int, Array, Array]:
        block = basis.blocks[part.start]
        at = components(basis, block, points, [nu for nu in basis.orders if nu != (0, 0)])
        found = at.laplacian()
        root = np.sqrt(np.abs(at.own_measure)) / at.unit
        sign = np.sign(at.own_measure)
        if block.table is not None:
            scaled = np.stack([c * root for c in found.values()], axis=2)  # (F, P, 5)
            table = np.stack([block.table.of(nu) for nu in found], axis=1)  # (P, 5, C)
            laplacians = np.empty((*root.shape, table.shape[2]))
            for k, rows in enumerate(table):
                laplacians[:, k] = scaled[:, k] @ rows
        else:
            values = block.values()
            laplacians = sum((c * root)[:, :, None] * values[nu] for nu, c in found.items())
        signed = laplacians if (sign > 0).all() else laplacians * sign[:, :, None]
        return block.group, block.rows, _upper(np.matmul(signed.swapaxes(1, 2), laplacians))

    return pattern.symmetric(len(basis.blocks), work, workers)


def load(
    basis: Basis, f: Callable[[Array, Array], ArrayLike], points: Array, workers: int
) -> Array:
    """Integrals (n, ...) of products of the functions with those (points, ...) that f gives."""
    shapes: list[tuple[int, ...]] = []

    def values(_: Block, x: Array, normal: Array) -> Array:
        found, each = given(f, x, normal)
        shapes.append(each)
        return found

    found = load_of_blocks(basis, values, points, workers)
    return found.reshape(basis.n, *(shapes[0] if shapes else ()))


def load_of_blocks(
    basis: Basis, f: Callable[[Block, Array, Array], Array], points: Array, workers: int
) -> Array:
    """Integrals (n, k) of products of the functions with those (F P, k) that f gives of a block."""

    def work(part: slice) -> tuple[Array, Array]:
        block = basis.blocks[part.start]
        at = components(basis, block, points, FIRST)
        shape = at.area.shape
        x, normal = (np.stack([z.ravel() for z in y], axis=1) for y in (at.jet[0, 0], at.cross))
        normal /= at.area.reshape(-1, 1)
        values = f(block, x, normal).reshape(*shape, -1) * at.measure[:, :, None]  # (F, P, k)
        if block.table is not None:
            own = np.matmul(block.table.of((0, 0)).T, values)
        else:
            own = np.matmul(block.values()[0, 0].swapaxes(1, 2), values)
        return block.controls.ravel(), own.reshape(-1, own.shape[2])

    parts = over_chunks(len(basis.blocks), workers, work, 1)
    return basis.collected(_scattered(basis.n_controls, parts))


def factors(matrix: Any, symmetric: bool = True) -> Any:
    """Factors of a matrix; pivots of a symmetric one are on its diagonal where they can be."""
    from scipy.sparse.linalg import splu

    options: dict[str, Any] = {}
    if symmetric:
        options = {"diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    try:
        return splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", **options)
    except RuntimeError:  # a pivot is exactly 0
        raise ValueError(_DEPENDENT) from None


def refuse_dependent(sizes: Array) -> None:
    """Refuse a mass matrix with these pivots, or eigenvalues, if it is singular."""
    if not sizes.min() > _SINGULAR * sizes.max():
        raise ValueError(_DEPENDENT)


def given(
    f: Callable[[Array, Array], ArrayLike], points: Array, normals: Array
) -> tuple[Array, tuple[int, ...]]:
    """What a function gives at points, (m, k), and the shape (...) of one value."""
    if not callable(f):
        raise TypeError(f"need a function f(points, normals), got {type(f).__name__}")
    try:
        found = np.asarray(f(points, normals))
    except ValueError as error:
        if "inhomogeneous" not in str(error):
            raise
        raise ValueError("f must give an array, got rows of different lengths") from None
    if found.dtype.kind not in "biuf":
        raise TypeError(f"f must give real numbers, got an array of {found.dtype}")
    if found.shape[:1] != (len(points),):
        raise ValueError(
            f"f must give an array ({len(points)}, ...) at {len(points)} points, got one of shape "
            f"{found.shape}"
        )
    flat = found.reshape(len(found), int(np.prod(found.shape[1:]))).astype(float)
    good = np.isfinite(flat).all(axis=1)
    if not good.all():
        bad = np.flatnonzero(~good)[0]
        raise ValueError(f"f must give finite numbers, but does not at {points[bad].tolist()}")
    return flat, found.shape[1:]


def summed(terms: Any, count: int) -> Terms:
    """Coefficients (count,) of pairs of derivatives, after checks."""
    found: Terms = {}
    for k, term in enumerate(terms):
        if not isinstance(term, (tuple, list)) or len(term) != 3:
            raise ValueError(f"term {k} must be (nu, mu, coefficient), got {term!r}")
        nu, mu = checked_order(term[0]), checked_order(term[1])
        c = reals(f"the coefficient of term {k}", term[2])
        if c.shape not in ((), (count,)):
            raise ValueError(
                f"the coefficient of term {k} must be of the shape of the points, ({count},), or "
                f"one number, got {c.shape}"
            )
        if not np.isfinite(c).all():
            bad = np.flatnonzero(~np.isfinite(np.atleast_1d(c)))
            raise ValueError(
                f"the coefficient of term {k} is not finite at point {bad[0]} (and at "
                f"{len(bad) - 1} more)"
            )
        if (nu, mu) in found:
            c = c + found[nu, mu]
        found[nu, mu] = np.broadcast_to(c, count)
    if not found:
        raise ValueError("terms: got none, need (nu, mu, coefficient) at least once")
    return found


def is_symmetric(terms: Terms) -> bool:
    """Whether each term has its mirror."""
    return all(
        (mu, nu) in terms and np.array_equal(c, terms[mu, nu]) for (nu, mu), c in terms.items()
    )


def _scattered(n: int, parts: Iterator[tuple[Array, Array]]) -> Array:
    """Sums (n, k) of rows."""
    total: Array | None = None
    for place, values in parts:
        found = np.stack([np.bincount(place, x, minlength=n) for x in values.T], axis=1)
        total = found if total is None else total + found
    return np.zeros((n, 1)) if total is None else total
