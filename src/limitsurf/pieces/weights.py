"""Bernstein coefficients of patches as weights of their control points, and around special corners.

Around a special corner the control points of ring n are ``P A^n C``: A refines the control points C
of a patch around its corner, P gives those of the three regular pieces of the first ring. For
float64 the powers come from the eigenbasis, in which they cost the same at any n, and for exact
numbers from A itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from itertools import islice
from math import lcm
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import basis, rings, tables
from limitsurf.caching import cached_property
from limitsurf.numbers import NumberType
from limitsurf.patches import REGULAR, STRIP, PatchTable
from limitsurf.pieces import bernstein
from limitsurf.pieces.bernstein import Bernstein
from limitsurf.pieces.cover import Group

if TYPE_CHECKING:
    from limitsurf.scheme.scheme import Scheme
    from limitsurf.tables import EigenTable, RationalTable, RingMasks, Sector

Array = NDArray[Any]

# rings beyond the last one whose coefficients bound what remains, before control points do
AHEAD = 4


@dataclass(frozen=True, eq=False)
class LocalWeights:
    """Weights of the control points of patches in the coefficients of their cells.

    Attributes
    ----------
    patches : PatchTable
    scheme : Scheme
    number : NumberType
    """

    patches: PatchTable
    scheme: Scheme
    number: NumberType

    @cached_property
    def bernstein(self) -> Bernstein:
        """Matrices onto Bernstein coefficients."""
        return Bernstein.of(self.scheme, self.number.exact)

    @cached_property
    def strips(self) -> tuple[tables.StripTables, Array]:
        """Splines across the creases of strips, and which of them each strip has."""
        return tables.strips_of(self.scheme, self.patches.sharpness, self.number)

    def of(self, group: Group, part: slice) -> Iterator[tuple[Array, Array, Array]]:
        """Weights for some patches of a group, of those alike at a time.

        Which of the group (p,), their control points (p, K), and weights (c, n, K) of the n
        coefficients in the parameters of the patches, or (p, c, n, K).
        """
        rows = group.rows[part]
        here = np.arange(*part.indices(len(group.rows)))
        ids = self.patches.control_points(group.kind, rows)
        if group.kind == REGULAR:
            yield here, ids, self.bernstein.from_controls[None]
        elif group.kind == STRIP:
            yield here, ids, self._of_strips(rows, group.count)
        elif group.kind not in self.patches.rings:
            yield here, ids, self._around(group.kind, group.count)
        elif not self.number.exact:
            yield here, ids, self._of_shared(group.kind, rows, group.count)
        else:
            for some, columns, table in self.sectors(group.kind, rows):
                weights = ring_weights(self.scheme, table, group.count)
                yield here[some], ids[some][:, columns], weights

    def _of_strips(self, rows: Array, depth: int) -> Array:
        """Weights (p, depth + 1, 16, 16) in strips; (4, n, 16) in quads of dual schemes."""
        tables_, which = self.strips
        if tables_.both:
            found = bernstein.centers(self.scheme.spline, tables_.pieces)[::-1, ::-1]
            return found.reshape(4, *found.shape[2:])
        first = tables_.first[which[rows]]
        polynomials = tables_.pieces[first[:, None] + np.arange(depth + 1)]
        across = polynomials.reshape(-1, *polynomials.shape[2:])
        found = bernstein.strips(self.scheme.spline, across)
        return found.reshape(len(rows), depth + 1, *found.shape[1:])

    def _around(self, kind: int, count: int) -> Array:
        """Weights (3 count, n, K) on the rings around special corners of a kind."""
        sector = self.patches.sectors[kind]
        assert sector is not None
        if self.number.exact:
            return ring_weights(self.scheme, self._table(sector, kind), count)
        table = tables.eigen_table(self.scheme, sector)
        functions = ring_functions(table, count)
        exponent = np.zeros(len(functions), dtype=np.int64)
        eigen = basis.EigenWeights(functions, exponent, True)
        return basis.control_weights(table, eigen).reshape(-1, self.bernstein.size, table.size)

    def _of_shared(self, kind: int, rows: Array, count: int) -> Array:
        """Weights (p, 3 count, 16, K) on the rings around special corners of many faces."""
        masks, shared = self.masks(kind), self.patches.rings[kind]
        pieces, size = len(self.scheme.lattice.pieces), self.bernstein.size
        shape = len(rows), count, pieces, size
        position, level, piece = np.broadcast_arrays(
            shared.position[rows].reshape(-1, 1, 1, 1),
            np.arange(count).reshape(-1, 1, 1),
            np.arange(pieces).reshape(-1, 1),
        )
        position, level, piece = (
            np.broadcast_to(x, shape).ravel() for x in (position, level, piece)
        )
        b = np.tile(self.bernstein.from_controls, (position.size // size, 1))
        found = rings.piece_weights(masks, position, level, piece, b)
        return found.reshape(len(rows), count * pieces, size, found.shape[1])

    def masks(self, kind: int) -> RingMasks:
        """The masks of a kind with shared rings."""
        sector = self.patches.sectors[kind]
        assert sector is not None
        return tables.ring_masks(self.scheme, sector.kind, sector.faces)

    def sectors(
        self, kind: int, rows: Array
    ) -> Iterator[tuple[Array, Array | slice, RationalTable]]:
        """Exact tables for patches of a kind: which they are for, and columns of control points."""
        sector = self.patches.sectors[kind]
        assert sector is not None
        if kind not in self.patches.rings:
            yield np.arange(len(rows)), slice(None), self._table(sector, kind)
            return
        position = self.patches.rings[kind].position[rows]
        for p in np.unique(position).tolist():
            columns, own = rings.columns(sector, p)
            yield np.flatnonzero(position == p), columns, self._table(own, kind)

    def _table(self, sector: Sector, kind: int) -> RationalTable:
        vertex = int(self.patches.control_points(kind, np.zeros(1, dtype=np.int64))[0, 0])
        return tables.rational_table(self.scheme, sector, not self.number.exact, vertex)


def ring_functions(table: EigenTable, count: int) -> Array:
    """Bernstein coefficients of eigenfunctions on the first rings, (count * 3 * n, K - 1).

    Without the constant one; ring n is that next to the corner after n halvings, times J^n.
    """
    pieces = Bernstein.of(table.scheme, False).from_powers @ table.pieces[:, :, 1:]
    ring = pieces.reshape(-1, table.size - 1)
    functions, level = np.tile(ring, (count, 1)), np.repeat(np.arange(count), len(ring))
    return basis.on_rings(table, functions, level)


@lru_cache(maxsize=16)
def ring_weights(scheme: Scheme, table: RationalTable, count: int) -> Array:
    """Exact weights (3 count, n, K) of the control points on the first rings."""
    size = table.sector.size
    steps = islice(_steps(scheme, table), count)
    found = [fractions(rows[:-size], unit) for rows, unit in steps]
    shape = -1, Bernstein.of(scheme, True).size, size
    return np.array(found, dtype=object).reshape(shape)


@lru_cache(maxsize=256)
def hull_weights(scheme: Scheme, table: RationalTable, count: int, exact: bool) -> Array | None:
    """Weights (R, K) of points whose convex hull holds what is beyond so many rings.

    The limit is in the hull of any refined control points if all masks are convex combinations,
    which is looked up in the table; else None. Here they are the coefficients of `AHEAD` rings
    more, then all control points after these: ``derivations/pieces.py``.
    """
    size = table.sector.size
    rows, unit = next(_steps(scheme, table))
    if not (rows >= 0).all():
        return None
    steps = _steps(scheme, table) if exact else _float_steps(table, (rows / unit).astype(float))
    found: list[Array] = []
    for rows, unit in islice(steps, count, count + AHEAD):
        found.append(rows[:-size] / unit if not exact else fractions(rows[:-size], unit))
    found.append(rows[-size:] / unit if not exact else fractions(rows[-size:], unit))
    return np.concatenate(found)


@lru_cache(maxsize=256)
def most_beyond(table: EigenTable, count: int) -> Array:
    """Bounds (K - 1,) of the eigenfunctions after the first on ring `count` and all after it."""
    pieces = Bernstein.of(table.scheme, False).from_powers @ table.pieces[:, :, 1:]
    return np.asarray(np.abs(pieces).max(axis=(0, 1)) @ growth(table, count))


def growth(table: EigenTable, count: int, base: float = 1.0) -> Array:
    """Bounds (K - 1, K - 1) of the powers J^n, n >= `count`, of eigenfunctions after the first.

    If those of row k are bounded on ring 0 by ``m[k]``, then on ring n by ``m @ growth``. All are
    relative to powers of a `base`: rows of rates from there on mean nothing.
    """
    rate = np.abs(table.rates[0, 1:]) / base
    heads, first = table.chains - 1, table.pairs - 1
    found = np.diag(rate**count)
    found[first + 1, first] = found[first, first + 1] = rate[first] ** count
    # the entries n rate^(n - 1) of Jordan blocks are largest at n = -1 / log(rate), or later
    n = np.maximum(count, -1 / np.log(rate[heads]))
    found[heads - 1, heads] = n * rate[heads] ** (n - 1) / base
    return np.asarray(found)


def _steps(scheme: Scheme, table: RationalTable) -> Iterator[tuple[Array, int]]:
    """Integers (3 n + K, K) and their denominator, for ring 0, 1, 2, ... on and on.

    Weights of the control points in the coefficients of the ring, then in the control points after
    one step more.
    """
    form, size = Bernstein.of(scheme, True), table.sector.size
    from_controls, each = form.from_controls, form.size
    n = len(table.pieces) * each
    unit = lcm(*(x.denominator for x in from_controls.ravel()))
    rows = np.zeros((n + size, table.n_rows), dtype=object)
    for piece, control in enumerate(table.pieces):
        block = rows[each * piece : each * (piece + 1)]
        for k, row in enumerate(control.tolist()):
            block[:, row] += _whole(from_controls[:, k] * unit)
    rows[n + np.arange(size), np.arange(size)] = unit
    starts = np.searchsorted(table.columns, np.arange(size))
    rows = np.add.reduceat(rows[:, table.rows] * table.numerators, starts, axis=1)
    unit *= table.denominator
    sources, values, starts = _square(table)
    while True:
        yield rows, unit
        rows = np.add.reduceat(rows[:, sources] * values, starts, axis=1)
        unit *= table.denominator


def _float_steps(table: RationalTable, rows: Array) -> Iterator[tuple[Array, int]]:
    """Rings 0, 1, 2, ... in float64, from those of ring 0: sums of products of numbers >= 0."""
    sources, values, starts = _square(table)
    values = (values / table.denominator).astype(float)
    while True:
        yield rows, 1
        rows = np.add.reduceat(rows[:, sources] * values, starts, axis=1)


def _square(table: RationalTable) -> tuple[Array, Array, Array]:
    """The matrix A by columns: row and numerator of each entry, and where columns start."""
    square = table.rows < table.sector.size
    starts = np.searchsorted(table.columns[square], np.arange(table.sector.size))
    return table.rows[square], table.numerators[square], starts


def products(weights: Array, points: Array) -> tuple[Array, Array]:
    """Exact weights (..., R, K) times points (..., K, d), as integers and denominators (..., 1, 1).

    Integers are faster than Fractions, which `fractions` makes of both.
    """
    rows, unit = _integers(weights)
    columns, other = _integers(points)
    return np.matmul(rows, columns), np.asarray(unit * other)[..., None, None]


def _integers(values: Array) -> tuple[Array, Array]:
    """Fractions (..., n, m) as integers over a common denominator (...) of the last two axes."""
    flat = values.reshape(*values.shape[:-2], -1)
    below = _denominator(flat)
    unit = np.asarray(np.lcm.reduce(below, axis=-1), dtype=object)
    return (_numerator(flat) * (unit[..., None] // below)).reshape(values.shape), unit


fractions: Any = np.frompyfunc(Fraction, 2, 1)
_numerator = np.frompyfunc(lambda x: x.numerator, 1, 1)
_denominator = np.frompyfunc(lambda x: x.denominator, 1, 1)
_whole = np.frompyfunc(int, 1, 1)
