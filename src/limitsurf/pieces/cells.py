"""Limit faces cut into cells on which the limit is one polynomial, and what remains at corners."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf import html, memory, numbers
from limitsurf.numbers import Numbers
from limitsurf.patches import STRIP, PatchTable
from limitsurf.pieces import bernstein, cover
from limitsurf.pieces.bernstein import Bernstein
from limitsurf.pieces.cover import Cover, Group
from limitsurf.pieces.points import ExactPoints, FloatPoints
from limitsurf.pieces.weights import LocalWeights
from limitsurf.refine import ExactOperator, eliminated, sparse_operator, stacked

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from limitsurf.scheme.scheme import Scheme
    from limitsurf.values import Values

Array = NDArray[Any]
# does a work for each slice of so many jobs, and gives what comes of it in order
Divided: TypeAlias = Callable[[int, Callable[[slice], Any]], Iterator[Any]]

# patches and numbers that are handled at once: what stays in cache; in memory for rows of weights
_PATCHES, _CHUNK, _PORTION = 512, 1 << 18, 1 << 24


@dataclass(frozen=True, eq=False, repr=False)
class BezierRest:
    """Where cells end: at special corners, beyond the last ring of cells.

    What remains at a corner is one cell, a square or triangle like those of `BezierPatches`.

    Attributes
    ----------
    face : (m,) int64
        Limit faces.
    corner : (m,) int64
        Which corner of the cell is special: 0 at (s, t) = (0, 0), then counter-clockwise.
    origin, size : (m, 2) float64
        ``(u, v) = origin + size * (s, t)``, exact; negative sizes as in `BezierPatches`.
    lower, upper : (m, ...)
        A box that holds the limit surface there, coordinate by coordinate: a bound, rounding
        included, not an estimate. -inf and inf where none is known: for a scheme of your own that
        has negative weights, with Fractions or around more than 64 faces.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0], [1], [2]], [[0, 1, 2]])
    >>> ls.bezier_patches(ls.LimitSurface(square), depth=3).rest
    BezierRest(3 cells)
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
        return f"BezierRest({len(self)} cells)"


@dataclass(frozen=True, eq=False, repr=False)
class BezierPatches:
    """Limit faces as Bezier patches, made by `bezier_patches`.

    Each is a cell of a limit face on which the limit is one polynomial, a rectangle in schemes of
    quads, a triangle in those of triangles. At

        u = origin[k, 0] + s * size[k, 0],  v = origin[k, 1] + t * size[k, 1]

    the surface is a sum of Bernstein polynomials times `points`, which `evaluate` computes:

    * of quads, with s and t in [0, 1], the sum of ``B_i(s) B_j(t) points[k, i, j]`` over i and j
      from 0 to d: i counts along u, j along v of the limit face, and
      ``B_i(s) = d! / (i! (d - i)!) s^i (1 - s)^(d - i)``;
    * of triangles, with s, t >= 0 and s + t <= 1, the sum of
      ``d! / (i! j! (d - i - j)!) s^i t^j (1 - s - t)^(d - i - j) points[k, m]`` over m, where
      i and j are ``exponents[m]``: (0, 0), (1, 0) .. (d, 0), (0, 1) .. (d - 1, 1) .. (0, d). So
      corner 0 comes first, and a row along u after the other. A triangle that is turned by half a
      turn, as the one in the middle of a split face, has negative sizes.

    Attributes
    ----------
    face : (n,) int64
        Limit faces; those of a face stand together.
    origin, size : (n, 2) float64
        Where s = t = 0, and lengths along u and v: multiples and powers of 1/2, exact.
    points : (n, d + 1, d + 1, ...) or (n, (d + 1)(d + 2)/2, ...)
        Bernstein coefficients, the control points of the Bezier patches: float64 or Fractions.
    exponents : (m, 2) int64
        i and j of the m coefficients of a patch, in their order.
    weights : csr_array, ExactOperator or None
        If asked for, the same as rows over the cage, (n * len(exponents), n_vertices), or over the
        values of a channel. They give the coefficients of the first patch, then of the next, in the
        order of `exponents`: of bicubic quads row ``16 k + 4 i + j`` gives ``points[k, i, j]``, of
        quartic triangles row ``15 k + j`` gives ``points[k, j]``. Each sums to one.
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
    exponents: NDArray[np.int64]
    weights: csr_array[Any] | ExactOperator | None
    rest: BezierRest

    @property
    def degree(self) -> int:
        """The degree d of the polynomials: in each direction of rectangles, in all of triangles."""
        return int(self.exponents.max())

    def evaluate(self, s: Numbers, t: Numbers) -> Array:
        """Points of every patch at the same places (s, t) in them.

        Parameters
        ----------
        s, t : array_like
            Parameters of the patches; they broadcast. Outside of the patches their polynomials go
            on, but not the surface.

        Returns
        -------
        array, (n, ..., channels)
            For each patch, then for each (s, t). Fractions if any numbers are.

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2, 3]])
        >>> patches = ls.bezier_patches(ls.LimitSurface(square))
        >>> patches.evaluate([0, 0.5, 1], 0.5)[0].round(12).tolist()
        [[0.0, 0.5], [0.5, 0.5], [1.0, 0.5]]
        """
        number = numbers.common(self.points, s, t)
        along, across = np.broadcast_arrays(number.array(s), number.array(t))
        basis = bernstein.polynomials(self.exponents, along.ravel(), across.ravel())
        channels = self.points.shape[2 + bernstein.is_tensor(self.exponents) :]
        shape = len(self), len(self.exponents), int(np.prod(channels))
        flat = number.array(self.points).reshape(shape)
        return np.asarray(np.matmul(basis, flat).reshape(len(self), *along.shape, *channels))

    def __len__(self) -> int:
        return len(self.face)

    def _repr_html_(self) -> str:
        columns = {name: getattr(self, name) for name in ("face", "origin", "size")}
        return html.table(columns, repr(self))

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
    divided: Divided,
    hulls: bool = True,
    *,
    values: Values | None = None,
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
    divided : callable
        Divides jobs among threads; what they are does not depend on it.
    hulls : bool
        Whether what remains is to have bounds; else they are NaN.
    values : Values, optional
        Of the patches and these points, if they are known from elsewhere: they are of all faces.
    """
    number = numbers.type_of(points)
    flat = points.reshape(len(points), -1)
    local = LocalWeights(patches, scheme, number)
    form = local.bernstein
    covered = Cover.of(patches, faces)
    around = np.maximum(rings[covered.owner] - covered.level, 0)
    n, groups = cover.grouped(patches, covered, around, *local.strips)
    each = 40 + form.size * flat.shape[1] * (8 + 100 * number.exact) + weights * 12 * form.size**2
    memory.refuse_beyond(n, each, "Bezier patches", "choose a smaller depth, or faces")
    source: Any = ExactPoints(local, flat) if number.exact else FloatPoints(local, flat, values)
    owner = np.empty(n, dtype=np.int64)
    origin, size = np.empty((2, n, 2))
    found = np.empty((n, form.size, flat.shape[1]), dtype=points.dtype)
    for g in groups:
        cells = g.cells
        places = cover.placed(patches.lattice, covered, g, g.origin, g.size)
        owners = np.broadcast_to(covered.owner[g.members, None], cells.shape)
        for array, placed in ((owner, owners), (origin, places[0]), (size, places[1])):
            _write(array, cells, placed)
    width = form.size * max(flat.shape[1], 1)
    jobs = [(g, part) for g in groups for part in _parts(g, _CHUNK // width, _PATCHES)]

    def work(some: slice) -> None:
        for g, part in jobs[some]:
            made = _turned(form, source.coefficients(g, part), g.turn[part])
            _write(found, g.cells[part], made)

    for _ in divided(len(jobs), work):
        pass
    found = found.reshape(n, *form.shape, *points.shape[1:])
    rows = _rows(local, groups, n) if weights else None
    rest = _rest(patches, source, covered, groups, faces, points.shape[1:], hulls)
    return BezierPatches(faces[owner], origin, size, found, form.exponents, rows, rest)


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


def _turned(form: Bernstein, values: Array, turn: Array) -> Array:
    """Values (p, c, n, d) by S and T of patches as those by u and v of the limit face."""
    if not turn.any():
        return values
    order = form.turned[turn][:, None, :, None]
    return np.take_along_axis(values, order, axis=2)


def _rows(local: LocalWeights, groups: list[Group], n: int) -> csr_array[Any] | ExactOperator:
    """Rows of weights over the cage for all coefficients of n cells."""
    patches, parts, places = local.patches, [], [np.zeros(0, dtype=np.int64)]
    size = local.bernstein.size
    for g in groups:
        width = max(patches.control_points(g.kind, g.rows[:1]).shape[1], 1)
        for part in _parts(g, _PORTION // (size * width)):
            for here, ids, weights in local.of(g, part):
                cells, turn = g.cells[here], g.turn[here]
                shape = cells.size * size, patches.n_points
                total = sparse_operator(*_entries(local.bernstein, weights, ids, turn), shape)
                for operator in reversed(patches.extras):  # the last ones first
                    total = eliminated(total, operator)
                parts.append(total)
                places.append((cells[..., None] * size + np.arange(size)).ravel())
    if not parts:
        nothing = np.zeros(0, dtype=np.int64)
        shape = 0, patches.n_vertices
        return sparse_operator(nothing, nothing, nothing.astype(local.number.dtype), shape)
    total, place = stacked(parts), np.concatenate(places)
    if (place == np.arange(n * size)).all():
        return total
    if isinstance(total, ExactOperator):
        return ExactOperator(place[total.rows], total.columns, total.values, total.shape)
    return total[np.argsort(place)]


def _entries(
    form: Bernstein, weights: Array, ids: Array, turn: Array
) -> tuple[Array, Array, Array]:
    """Rows, columns and values of weights (c, n, K) or (p, c, n, K) of control points (p, K)."""
    n, each = len(ids), weights.shape[-3] * form.size
    if weights.ndim == 4 or turn.any():
        shape = n, *weights.shape[-3:]
        values = _turned(form, np.broadcast_to(weights, shape), turn).reshape(n * each, -1)
        row, column = np.nonzero(values)
        return row, ids[row // each, column], values[row, column]
    # all alike
    row, column = np.nonzero(weights.reshape(each, -1))
    rows = each * np.arange(n)[:, None] + row
    values = np.tile(weights.reshape(each, -1)[row, column], n)
    return rows.ravel(), ids[:, column].ravel(), values


def _rest(
    patches: PatchTable,
    source: Any,
    covered: Cover,
    groups: list[Group],
    faces: Array,
    shape: tuple[int, ...],
    hulls: bool,
) -> BezierRest:
    """What remains at special corners, in the order of the patches."""
    special = [g for g in groups if g.kind > STRIP]
    members = np.concatenate([np.zeros(0, dtype=np.int64), *(g.members for g in special)])
    order = np.argsort(members)
    places, bounds = [np.zeros((2, 0, 2))], []
    for g in special:
        whole = np.zeros((1, 2)), np.full((1, 2), np.ldexp(1.0, -g.count))
        cells = cover.placed(patches.lattice, covered, g, *whole)
        places.append(np.stack(cells)[:, :, 0])
        none = np.full((2, len(g.members), int(np.prod(shape))), np.nan, dtype=source.dtype)
        bounds.append(np.stack(source.hull(g)) if hulls else none)
    origin, size = np.concatenate(places, axis=1)[:, order]
    turn = np.concatenate([np.zeros(0, dtype=np.int64), *(g.turn for g in special)])[order]
    owner = faces[covered.owner[members[order]]]
    none = np.zeros((2, 0, int(np.prod(shape))), dtype=source.dtype)
    both = np.concatenate([none, *bounds], axis=1)[:, order].reshape(2, len(order), *shape)
    return BezierRest(owner, turn, origin, size, *both)
