"""Functions of a space and their derivatives at the points of a quadrature, block by block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf.caching import cached_property
from limitsurf.engine.orders import checked_order, orders_up_to
from limitsurf.engine.protocol import Order
from limitsurf.fem.elements import Elements, Group
from limitsurf.fem.extraction import Places
from limitsurf.fem.nearby import weights_nearby
from limitsurf.integrals.quadrature import Quadrature
from limitsurf.refine import sharing
from limitsurf.surface import LimitSurface

Array = NDArray[Any]
Pair: TypeAlias = tuple[Order, Order]

_AT_ONCE = 1 << 19  # faces x points x controls of a block
_TABLES, _LARGEST = 32, 1 << 22  # how many tables are kept, of so many bytes each at most
# derivatives of the functions of faces with a special corner, that of last use last: there are many
# points, and the same for each valence
_KEPT: dict[tuple[Any, ...], Array] = {}


@dataclass(frozen=True, eq=False, repr=False)
class Block:
    """Limit faces with equal numbers F of controls C and points P, some of a `Basis`.

    Attributes
    ----------
    face : (F,) int
        Limit faces of the surface of the space.
    controls : (F, C) int32
        Functions that do not vanish on each face: columns of matrices.
    points : (F, P) int
        Places of its points in the quadrature.
    """

    face: NDArray[np.int64]
    controls: NDArray[np.int32]
    points: NDArray[np.int64]
    group: int = field(repr=False)
    rows: Array = field(repr=False)
    table: Table | None = field(repr=False)
    _basis: Basis = field(repr=False)

    def __repr__(self) -> str:
        f, p, c = *self.points.shape, self.controls.shape[1]
        return f"Block({f} faces, {p} points, {c} controls)"

    def values(self) -> dict[Order, NDArray[np.float64]]:
        """Derivatives of the functions, {nu: (F, P, C)}; read-only where faces share them.

        They are computed anew at each call: what is not needed at once takes no memory.
        """
        if self.table is not None:
            shape = len(self.face), *self.table.values.shape[1:]
            found = [np.broadcast_to(x, shape) for x in self.table.values]
        else:
            found = list(self._basis.evaluated(self.controls, self.points))
        return dict(zip(self._basis.orders, found, strict=True))


class Table:
    """Derivatives (D, P, C) that all faces of a kind have, and their products.

    Attributes
    ----------
    values : (D, P, C)
    """

    def __init__(self, orders: Sequence[Order], values: Array) -> None:
        self.values, self._place = values, {nu: k for k, nu in enumerate(orders)}
        self._products: dict[tuple[bool, tuple[Pair, ...]], Array] = {}

    def of(self, nu: Order) -> Array:
        """One derivative (P, C)."""
        found: Array = self.values[self._place[nu]]
        return found

    def products(self, terms: Sequence[Pair], symmetric: bool) -> Array:
        """Products (terms P, E) of derivatives of two functions, at each point, kept.

        E entries of a matrix of C functions; or of upper triangles, of terms and their mirrors.
        """
        key = symmetric, tuple(terms)
        if key not in self._products:
            _, count, size = self.values.shape
            entries = size * (size + 1) // 2 if symmetric else size * size
            found = np.empty((len(terms), count, entries))
            for to, (nu, mu) in zip(found, terms, strict=True):
                a, b = self.of(nu), self.of(mu)
                begin = 0
                for k in range(size):  # rows of the matrix, of a fixed few functions
                    first = k if symmetric else 0
                    row = to[:, begin : begin + size - first]
                    np.multiply(a[:, k, None], b[:, first:], out=row)
                    if symmetric and nu != mu:
                        row += b[:, k, None] * a[:, first:]
                    begin += size - first
            self._products[key] = found.reshape(-1, entries)
        return self._products[key]


class Basis:
    """The functions of a space and their derivatives at the points of a quadrature.

    Made by `Space.basis`. Every function is 1 unknown of the space; on a limit face few do not
    vanish, its controls.

    Attributes
    ----------
    quadrature : Quadrature
    orders : list of (int, int)
        Derivatives by u and v of limit faces that there are, as `LimitSurface.jet` has them.
    blocks : list of Block
        Limit faces with equal numbers of controls and points: ``face``, ``controls``, ``points``
        and ``values()``, arrays (faces, points, controls) of each derivative. Together they have
        every point of the quadrature once.
    n : int
        Functions of the space.
    n_controls : int
        What ``controls`` of blocks count: vertices of the surface of the space. They are its
        functions, or in graded spaces the rows of `Space.extraction`.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> space = ls.Space(ls.LimitSurface(square), ends="natural")
    >>> basis = space.basis(ls.quadrature(space.surface, points=2), order=1)
    >>> basis.blocks, basis.blocks[0].values()[1, 0].shape
    ([Block(1 faces, 4 points, 4 controls)], (1, 4, 4))
    >>> du = basis.weights((1, 0))
    >>> (du @ space.surface.points).round(12)[:, 0].tolist()  # x_u
    [1.0, 1.0, 1.0, 1.0]
    """

    def __init__(
        self,
        surface: LimitSurface,
        elements: Elements,
        quadrature: Quadrature,
        order: int,
        extraction: Any = None,
    ) -> None:
        self.quadrature, self.n_controls = quadrature, surface.mesh.n_vertices
        self.n = self.n_controls if extraction is None else int(extraction.shape[1])
        self._surface, self._extraction = surface, extraction
        self.orders: list[Order] = list(orders_up_to(order)[0])
        self.blocks: list[Block] = []
        counts = np.diff(quadrature.offsets)
        there = np.flatnonzero(counts)
        start, counts = quadrature.offsets[there].astype(np.int64), counts[there]
        face = quadrature.face[start]
        group, row = elements.group[face].astype(np.int64), elements.row[face]
        key = group * (1 + counts.max(initial=0)) + counts
        for one in np.unique(key).tolist():
            here = np.flatnonzero(key == one)
            number = int(group[here[0]])
            self._add(number, elements.groups[number], row[here], start[here], counts[here[0]])

    def __repr__(self) -> str:
        return f"Basis({self.n} functions at {len(self.quadrature)} points)"

    def _add(self, number: int, group: Group, rows: Array, start: Array, count: int) -> None:
        """Add blocks of faces of a group with so many points each."""
        size = int(count) * group.controls.shape[1]
        same, table = np.zeros(len(rows), dtype=bool), None
        if group.alike:
            same[:] = True
            for x in (self.quadrature.u, self.quadrature.v):
                own = np.lib.stride_tricks.sliding_window_view(x, count)[start]
                same &= (own == own[0]).all(axis=1)
        for which, alike in ((same, True), (~same, False)):
            here = np.flatnonzero(which)
            if alike and len(here):
                points = start[here[:1], None] + np.arange(count)
                table = Table(self.orders, self._tabulated(group, rows[here[:1]], points))
            each = max(1, _AT_ONCE // (size if alike else size * len(self.orders)))
            for begin in range(0, len(here), each):
                some = here[begin : begin + each]
                own = rows[some]
                self.blocks.append(
                    Block(
                        group.faces[own],
                        group.controls[own],
                        start[some, None] + np.arange(count),
                        number,
                        own,
                        table if alike else None,
                        self,
                    )
                )

    def _tabulated(self, group: Group, row: Array, points: Array) -> Array:
        """Derivatives (D, P, C) that all faces of a group have, of one of them."""
        places = (x[points].tobytes() for x in (self.quadrature.u, self.quadrature.v))
        key = group.special, tuple(self.orders), *places
        found = _KEPT.pop(key, None) if group.special is not None else None
        if found is None:
            own = self.evaluated(group.controls[row], points)[:, 0]
            found = np.ascontiguousarray(own)
            found.flags.writeable = False
        if group.special is not None and found.nbytes < _LARGEST:
            _KEPT[key] = found  # as the last
            for old in list(_KEPT)[:-_TABLES]:
                _KEPT.pop(old, None)
        return found

    def evaluated(self, controls: Array, points: Array) -> Array:
        """Derivatives (D, F, P, C) of the controls of faces at their points, by `weights`."""
        q, n = self.quadrature, self.n_controls
        at = points.ravel()
        found = self._surface.weights(q.face[at], q.u[at], q.v[at], nu=self.orders)
        (f, c), p = controls.shape, points.shape[1]
        order = np.argsort(controls, axis=1, kind="stable")
        known = np.arange(f)[:, None] * n + np.take_along_axis(controls, order, axis=1)
        values = np.zeros((len(self.orders), f * p, c))
        nearby = weights_nearby(self._surface, q, at, self.orders)
        for rows, matrices in chain([(np.arange(f * p), found)], nearby):
            values[:, rows] = 0
            row = np.repeat(rows, np.diff(matrices[0].indptr))
            key = row // p * n + matrices[0].indices
            place = np.minimum(np.searchsorted(known.ravel(), key), known.size - 1)
            there = known.ravel()[place] == key
            column = order.ravel()[place[there]]
            for to, one in zip(values, matrices, strict=True):
                assert not one.data[~there].any()  # functions that vanish there
                to[row[there], column] = one.data[there]
        return values.reshape(-1, f, p, c)

    @cached_property
    def _pattern(self) -> tuple[Array, Array]:
        """Starts and columns of the rows of all points."""
        width = np.zeros(len(self.quadrature), dtype=np.int64)
        for block in self.blocks:
            width[block.points] = block.controls.shape[1]
        indptr = np.concatenate([[0], np.cumsum(width)])
        kind = np.int32 if indptr[-1] < 2**31 else np.int64
        indices = np.empty(indptr[-1], dtype=kind)
        for block in self.blocks:
            own = np.sort(block.controls, axis=1)[:, None]
            indices[_entries(indptr, block)] = own
        return indptr.astype(kind), indices

    def weights(self, nu: Order = (0, 0)) -> Any:
        """The matrix of a derivative: from coefficients to its values at the points.

        Parameters
        ----------
        nu : (int, int)
            One of `orders`.

        Returns
        -------
        csr_array, (points, n)
            On one pattern for all orders: `indptr` and `indices` are the same arrays. Copy a matrix
            before its pattern is changed in place.

        Raises
        ------
        ValueError
            For an order that the basis has not.
        """
        nu = checked_order(nu)
        if nu not in self.orders:
            raise ValueError(f"nu = {nu} is not among the derivatives of this basis: {self.orders}")
        indptr, indices = self._pattern
        data = np.empty(len(indices))
        for block in self.blocks:
            order = np.argsort(block.controls, axis=1)[:, None]
            data[_entries(indptr, block)] = np.take_along_axis(block.values()[nu], order, axis=2)
        (found,) = sharing(indptr, indices, [data], (len(self.quadrature), self.n_controls))
        if self._extraction is not None:
            return self._places.of(found @ self._extraction)
        found.indptr, found.indices = indptr, indices
        return found

    @cached_property
    def _places(self) -> Places:
        indptr, indices = self._pattern
        shape = len(self.quadrature), self.n_controls
        (ones,) = sharing(indptr, indices, [np.ones(len(indices))], shape)
        return Places(ones @ abs(self._extraction))

    def collected(self, values: Array) -> Array:
        """Sums (n, k) over the controls of each function, from values (n_controls, k)."""
        return values if self._extraction is None else np.asarray(self._extraction.T @ values)


def _entries(indptr: Array, block: Block) -> Array:
    """Places (F, P, C) of the entries of a block in the data of a matrix."""
    first = indptr[block.points].astype(np.int64)
    return np.asarray(first[:, :, None] + np.arange(block.controls.shape[1]))
