"""Limit faces cut into cells on which the limit is one polynomial, and what remains at corners."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import memory, numbers
from limitsurf.patches import STRIP, PatchTable
from limitsurf.pieces import bernstein, cover
from limitsurf.pieces.bernstein import SIZE
from limitsurf.pieces.cover import Cover, Group
from limitsurf.pieces.points import ExactPoints, FloatPoints
from limitsurf.pieces.weights import LocalWeights
from limitsurf.refine import ExactOperator, eliminated, sparse_operator, stacked

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from limitsurf.scheme.scheme import Scheme

Array = NDArray[Any]

# patches and numbers that are handled at once: what stays in cache; in memory for rows of weights
_PATCHES, _CHUNK, _PORTION = 512, 1 << 18, 1 << 24


@dataclass(frozen=True, eq=False, repr=False)
class BezierRest:
    """Where cells end: squares at special corners, beyond the last ring of cells.

    Attributes
    ----------
    face : (m,) int64
        Limit faces.
    corner : (m,) int64
        Which corner of the square is special: 0 at its least u and v, then counter-clockwise.
    origin, size : (m, 2) float64
        Least u and v, and lengths along u and v; exact.
    lower, upper : (m, ...)
        A box that holds the limit surface there, coordinate by coordinate: a bound, rounding
        included, not an estimate. -inf and inf where none is known: for a scheme of your own that
        has negative weights, with Fractions or around more than 64 faces.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0], [1], [2]], [[0, 1, 2]])
    >>> ls.bezier_patches(ls.LimitSurface(square), depth=3).rest
    BezierRest(3 squares)
    """

    face: NDArray[np.int64]
    corner: NDArray[np.int64]
    origin: NDArray[np.float64]
    size: NDArray[np.float64]
    lower: Array
    upper: Array

    def __len__(self) -> int:
        return len(self.face)

    def __repr__(self) -> str:
        return f"BezierRest({len(self)} squares)"


@dataclass(frozen=True, eq=False, repr=False)
class BezierPatches:
    """Limit faces as Bezier patches, made by `bezier_patches`.

    Each is a rectangle of a limit face on which the limit is one polynomial. At

        u = origin[k, 0] + s * size[k, 0],  v = origin[k, 1] + t * size[k, 1]

    the surface is the sum of ``B_i(s) B_j(t) points[k, i, j]`` over i and j, with the Bernstein
    polynomials B of degree 3 and s, t in [0, 1]: i counts along u, j along v of the limit face.

    Attributes
    ----------
    face : (n,) int64
        Limit faces; those of a face stand together.
    origin, size : (n, 2) float64
        Least u and v of each, and its lengths along u and v: multiples and powers of 1/2, exact.
    points : (n, 4, 4, ...)
        Bernstein coefficients, the control points of the Bezier patches: float64 or Fractions.
    weights : csr_array, ExactOperator or None
        If asked for, the same as rows over the cage: row ``16 k + 4 i + j`` of (16 n, n_vertices)
        gives ``points[k, i, j]``. Each sums to one.
    rest : BezierRest
        What remains of these limit faces at special corners, with bounds.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2, 3]])
    >>> patches = ls.bezier_patches(ls.LimitSurface(square))
    >>> patches
    BezierPatches(1 patch of degree 3)
    >>> patches.points[0, :, 0, 0].round(12).tolist()
    [0.0, 0.333333333333, 0.666666666667, 1.0]
    """

    face: NDArray[np.int64]
    origin: NDArray[np.float64]
    size: NDArray[np.float64]
    points: Array
    weights: csr_array[Any] | ExactOperator | None
    rest: BezierRest

    @property
    def degree(self) -> int:
        """The degree of the polynomials in each direction."""
        return int(self.points.shape[1]) - 1

    def __len__(self) -> int:
        return len(self.face)

    def __repr__(self) -> str:
        parts = [f"{len(self)} patch{'es' * (len(self) != 1)} of degree {self.degree}"]
        if len(self.rest):
            parts.append(f"rest {self.rest!r}")
        return f"{type(self).__name__}({', '.join(parts)})"


def cut(
    patches: PatchTable,
    scheme: Scheme,
    points: Array,
    faces: Array,
    rings: Array,
    weights: bool,
) -> BezierPatches:
    """Cells of limit faces.

    Parameters
    ----------
    patches : PatchTable
        Of the number type of the points.
    scheme : Scheme
    points : (n_vertices, ...)
        Of the cage, float64 or Fractions.
    faces : (F,) int
    rings : (F,) int
        Rings around special corners, less one for each halving from the limit face to the patch.
    weights : bool
        Whether rows of weights are wanted.
    """
    number = numbers.type_of(points)
    flat = points.reshape(len(points), -1)
    local = LocalWeights(patches, scheme, number)
    covered = Cover.of(patches, faces)
    around = np.maximum(rings[covered.owner] - covered.level, 0)
    n, groups = cover.grouped(patches, covered, around, *local.strips)
    each = 40 + SIZE * flat.shape[1] * (8 + 100 * number.exact) + weights * 12 * SIZE**2
    memory.refuse_beyond(n, each, "Bezier patches", "choose a smaller depth, or faces")
    source: Any = ExactPoints(local, flat) if number.exact else FloatPoints(local, flat)
    owner = np.empty(n, dtype=np.int64)
    origin, size = np.empty((2, n, 2))
    found = np.empty((n, SIZE, flat.shape[1]), dtype=points.dtype)
    for g in groups:
        cells = g.cells
        squares = cover.placed(covered, g, g.origin, g.size)
        owners = np.broadcast_to(covered.owner[g.members, None], cells.shape)
        for array, values in ((owner, owners), (origin, squares[0]), (size, squares[1])):
            _write(array, cells, values)
        for part in _parts(g, _CHUNK // (SIZE * max(flat.shape[1], 1)), _PATCHES):
            values = _turned(source.coefficients(g, part), g.turn[part])
            _write(found, cells[part], values)
    shape = n, *bernstein.SHAPE, *points.shape[1:]
    rows = _rows(local, groups, n) if weights else None
    rest = _rest(source, covered, groups, faces, points.shape[1:])
    return BezierPatches(faces[owner], origin, size, found.reshape(shape), rows, rest)


def _parts(group: Group, cells: int, most: int = _PORTION) -> Iterator[slice]:
    """At most so many patches of a group, and if that may be so many cells, at a time."""
    step = max(1, min(most, cells // max(len(group.origin), 1)))
    for start in range(0, len(group.rows) * bool(len(group.origin)), step):
        yield slice(start, min(start + step, len(group.rows)))


def _write(found: Array, cells: Array, values: Array) -> None:
    """Write the values (p, c, ...) of cells; as a run if they are one, which is faster."""
    first, last = (int(cells[0, 0]), int(cells[-1, -1]) + 1) if cells.size else (0, 0)
    if last - first == cells.size:
        found[first:last] = values.reshape(cells.size, *values.shape[2:])
    else:
        found[cells] = values


def _turned(values: Array, turn: Array) -> Array:
    """Values (p, c, 16, d) by S and T of patches as those by u and v of the limit face."""
    if not turn.any():
        return values
    order = bernstein.turned(turn)[:, None, :, None]
    return np.take_along_axis(values, order, axis=2)


def _rows(local: LocalWeights, groups: list[Group], n: int) -> csr_array[Any] | ExactOperator:
    """Rows of weights over the cage for all coefficients of n cells."""
    patches, parts, places = local.patches, [], [np.zeros(0, dtype=np.int64)]
    for g in groups:
        width = max(patches.control_points(g.kind, g.rows[:1]).shape[1], 1)
        for part in _parts(g, _PORTION // (SIZE * width)):
            for here, ids, weights in local.of(g, part):
                cells, turn = g.cells[here], g.turn[here]
                shape = cells.size * SIZE, patches.n_points
                total = sparse_operator(*_entries(weights, ids, turn), shape)
                for operator in reversed(patches.extras):  # the last ones first
                    total = eliminated(total, operator)
                parts.append(total)
                places.append((cells[..., None] * SIZE + np.arange(SIZE)).ravel())
    if not parts:
        nothing = np.zeros(0, dtype=np.int64)
        shape = 0, patches.n_vertices
        return sparse_operator(nothing, nothing, nothing.astype(local.number.dtype), shape)
    total, place = stacked(parts), np.concatenate(places)
    if (place == np.arange(n * SIZE)).all():
        return total
    if isinstance(total, ExactOperator):
        return ExactOperator(place[total.rows], total.columns, total.values, total.shape)
    return total[np.argsort(place)]


def _entries(weights: Array, ids: Array, turn: Array) -> tuple[Array, Array, Array]:
    """Rows, columns and values of weights of control points (p, K), (c, 16, K) or (p, c, 16, K)."""
    n, each = len(ids), weights.shape[-3] * SIZE
    if weights.ndim == 4 or turn.any():
        shape = n, *weights.shape[-3:]
        values = _turned(np.broadcast_to(weights, shape), turn).reshape(n * each, -1)
        row, column = np.nonzero(values)
        return row, ids[row // each, column], values[row, column]
    # all alike
    row, column = np.nonzero(weights.reshape(each, -1))
    rows = each * np.arange(n)[:, None] + row
    values = np.tile(weights.reshape(each, -1)[row, column], n)
    return rows.ravel(), ids[:, column].ravel(), values


def _rest(
    source: Any, covered: Cover, groups: list[Group], faces: Array, shape: tuple[int, ...]
) -> BezierRest:
    """What remains at special corners, in the order of the patches."""
    special = [g for g in groups if g.kind > STRIP]
    members = np.concatenate([np.zeros(0, dtype=np.int64), *(g.members for g in special)])
    order = np.argsort(members)
    squares, bounds = [np.zeros((2, 0, 2))], []
    for g in special:
        whole = np.zeros((1, 2)), np.full((1, 2), np.ldexp(1.0, -g.count))
        squares.append(np.stack(cover.placed(covered, g, *whole))[:, :, 0])
        bounds.append(np.stack(source.hull(g)))
    origin, size = np.concatenate(squares, axis=1)[:, order]
    turn = np.concatenate([np.zeros(0, dtype=np.int64), *(g.turn for g in special)])[order]
    owner = faces[covered.owner[members[order]]]
    none = np.zeros((2, 0, int(np.prod(shape))), dtype=source.dtype)
    both = np.concatenate([none, *bounds], axis=1)[:, order].reshape(2, len(order), *shape)
    return BezierRest(owner, turn, origin, size, *both)
