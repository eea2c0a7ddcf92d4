"""Evaluation by NumPy, of one kind of patch at a time: the twin of the compiled kernels.

Queries are parted by kind of patch (`Groups`), whose weights depend on (u, v) alone; with control
points they give derivatives, directions, normals and curvature (`Values`). Fractions take the same
way as far as their field goes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import factorial
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf import basis, rings, tables
from limitsurf._kernels import reference as kernels
from limitsurf.caching import cached_property
from limitsurf.patches import OUTER, REGULAR, STRIP, PatchTable

if TYPE_CHECKING:
    from limitsurf.scheme.scheme import Scheme

Array = NDArray[Any]
Order: TypeAlias = tuple[int, int]

# queries handled at once, and control values gathered at once: what stays in cache and in memory
_CHUNK = 1 << 16
_GATHER = 1 << 22
JET = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))  # derivatives that curvature comes from
_FIRST_CORNER = 5  # the control point of a bicubic patch at its corner (0, 0)


@dataclass(frozen=True)
class Group:
    """Queries of a chunk that lie in patches of one kind."""

    kind: int
    sector: tables.Sector | None  # what surrounds the special corner, if there is one
    query: Array  # (q,) places in the chunk
    row: Array  # (q,) rows of the patches in the control table of the kind
    s: Array  # (q,) parameters in the patch
    t: Array
    depth: Array  # (q,) halvings from limit face to patch
    turn: Array  # (q,) corners that the patch is turned against the limit face


@dataclass(frozen=True)
class Corners:
    """Queries of a group around extraordinary corners, with what their patches have in common."""

    query: Array  # (q,) places in the group
    table: tables.EigenTable
    place: basis.CornerPlace
    powers: basis.EigenPowers
    origin: Array  # (P, d) first control points of the patches concerned
    low: Array  # (P, d) what rounding took from them
    points: Array  # (P, K, d) control points relative to the first
    ids: Array  # (P, K) which they are
    modes: Array  # (P, K, d) their coefficients in the eigenbasis
    which: Array  # (q,) patch of each query


class Groups:
    """Queries by kind of patch and their weights, in float64 or Fractions.

    Shared by surfaces of one topology.
    """

    def __init__(self, patches: PatchTable, scheme: Scheme, exact: bool) -> None:
        self.patches = patches
        self.exact = exact
        self._scheme = scheme

    def of(self, face: Array, u: Array, v: Array) -> tuple[Array, Iterator[Group]]:
        """Queries without a value (NaN), and the others by kind of patch; all flat."""
        patches = self.patches
        if u.dtype == object:
            finite = np.array([x == x and y == y for x, y in zip(u, v, strict=True)], dtype=bool)
        else:
            finite = np.isfinite(u) & np.isfinite(v)
        defined = np.flatnonzero(finite & (patches.codes[face] != -1))
        undefined = np.flatnonzero(~(finite & (patches.codes[face] != -1)))
        patch, s, t, depth = patches.locate(face[defined], u[defined], v[defined])

        def groups() -> Iterator[Group]:
            kinds = patches.kind[patch]
            for kind in np.unique(kinds).tolist():
                here = np.flatnonzero(kinds == kind)
                turn = patches.turn[patch[here]]
                sides = [s[here], t[here], 1 - s[here], 1 - t[here]]
                yield Group(
                    kind,
                    patches.sectors[kind],
                    defined[here],
                    patches.row[patch[here]],
                    np.choose(turn, sides),
                    np.choose(turn, sides[1:] + sides[:1]),
                    depth[here],
                    turn,
                )

        return undefined, groups()

    def special(self, face: Array, u: Array, v: Array) -> Array:
        """Whether queries (Q,) lie in patches with a special corner."""
        where = np.flatnonzero(np.isfinite(u) & np.isfinite(v) & (self.patches.codes[face] != -1))
        patch, *_ = self.patches.locate(face[where], u[where], v[where])
        found = np.zeros(len(face), dtype=bool)
        found[where] = ~np.isin(self.patches.kind[patch], (REGULAR, STRIP))
        return found

    def chunks(
        self, face: Array, u: Array, v: Array, width: int = 1, dense: bool = True
    ) -> Iterator[tuple[slice, Array, Iterator[Group]]]:
        """Some thousands of queries at a time, flat: where, which of them have no value, the groups
        of others, none of which gathers too much for `width` numbers a control point. Those of
        shared rings count if `dense`.
        """
        face, u, v = face.ravel().astype(np.int64, copy=False), u.ravel(), v.ravel()
        for start in range(0, max(len(face), 1), _CHUNK):
            part = slice(start, start + _CHUNK)
            undefined, groups = self.of(face[part], u[part], v[part])
            pieces = (
                g for group in groups for g in _pieces(group, self._size(group, dense) * width)
            )
            yield part, undefined, pieces

    def _size(self, g: Group, dense: bool) -> int:
        """How many control points the patches of a group have; those of shared rings if `dense`."""
        shared = self.patches.rings.get(g.kind)
        ring = 0 if shared is None else shared.points.shape[1] if dense else 25
        return int(ring + self.patches.controls[g.kind].shape[1])

    def answers(
        self,
        face: Array,
        u: Array,
        v: Array,
        widths: Sequence[int],
        compute: Callable[[Group], Sequence[Array]],
    ) -> list[Array]:
        """Arrays (Q, width) of `compute` over all queries; NaN where there is no value.

        Overflow to infinity and underflow to zero are results, not accidents.
        """
        dtype = object if self.exact else float
        results = [np.full((face.size, width), np.nan, dtype=dtype) for width in widths]
        for part, _, groups in self.chunks(face, u, v, max(*widths, 1), self.exact):
            for g in groups:
                with np.errstate(over="ignore", under="ignore", invalid="ignore"):
                    values = compute(g)
                for result, value in zip(results, values, strict=True):
                    result[part.start + g.query] = value
        return results

    def controls(self, g: Group) -> Array:
        """Control points of the patches of a group, (q, K)."""
        return self.patches.control_points(g.kind, g.row)

    def table(self, g: Group) -> tables.EigenTable:
        assert g.sector is not None
        return tables.eigen_table(self._scheme, g.sector)

    def weights(self, g: Group, nu: Order) -> Array:
        """Weights (q, K) of the control points for a derivative in (u, v) of the limit face."""
        dtype = np.dtype(object if self.exact else float)
        if g.sector is None:
            scale = kernels.scale_by_two(np.ones(len(g.s), dtype=dtype), g.depth * sum(nu))
            return np.asarray(self.spline_weights(g, nu) * scale[:, None])
        turned, sign = basis.turned(nu)
        scale = kernels.scale_by_two(sign[g.turn].astype(dtype), g.depth * sum(nu))[:, None]
        place = basis.CornerPlace.of(g.s, g.t, g.turn)
        if g.kind in self.patches.rings:
            return np.asarray(self._ring_weights(g, place, turned) * scale)
        table = self.table(g)
        result = np.empty((len(g.s), table.size), dtype=dtype)
        for order in set(turned):
            here = np.array([o == order for o in turned])[g.turn]
            sub = place[here]
            if self.exact:
                at_corner = basis.corner_derivative(table, order)
                rational = tables.rational_table(self._scheme, g.sector)
                result[here] = basis.rational_weights(rational, sub, order, at_corner)
            else:
                powers = basis.EigenPowers.of(table, sub)
                eigen = basis.eigen_weights(table, sub, powers, order)
                result[here] = basis.control_weights(table, eigen)
        return np.asarray(result * scale)

    def _ring_weights(self, g: Group, place: basis.CornerPlace, turned: Sequence[Order]) -> Array:
        """The same around a shared ring, in parameters of the patch; an order for each turn."""
        shared, masks = self.patches.rings[g.kind], self.masks(g.kind)
        position, width = shared.position[g.row], shared.points.shape[1] + len(OUTER)
        result = np.empty((len(g.s), width), dtype=object if self.exact else float)
        for order in set(turned):
            here = np.flatnonzero(np.array([o == order for o in turned])[g.turn])
            if not self.exact:
                s, t, turn = g.s[here], g.t[here], g.turn[here]
                result[here] = rings.weights(masks, position[here], s, t, turn, order)
                continue
            for p in np.unique(position[here]).tolist():
                at = here[position[here] == p]
                columns, sector = rings.columns(masks.sector, p)
                zero = np.zeros(1)
                exists = rings.on_curve(masks, np.array([p]), zero, zero, order)[0]
                at_corner = np.full(1, 1.0 if exists else np.nan if max(order) <= 3 else 0.0)
                rational = tables.rational_table(self._scheme, sector)
                result[at] = Fraction(0)
                found = basis.rational_weights(rational, place[at], order, at_corner)
                result[at[:, None], columns] = found
        return result

    def masks(self, kind: int) -> tables.RingMasks:
        """The masks of a kind with shared rings."""
        sector = self.patches.sectors[kind]
        assert sector is not None
        return tables.ring_masks(self._scheme, sector.kind, sector.faces)

    def spline_weights(self, g: Group, nu: Order) -> Array:
        """The same (q, 16) for regular patches and strips, but for the depth of the patch."""
        if g.kind == REGULAR:
            return kernels.bicubic_weights(g.s, g.t, nu)
        strips, index = self.strips
        turned, sign = basis.turned(nu)
        up = (g.turn == 1) | (g.turn == 2)  # where t grows against u or v
        result = np.empty((len(g.s), 16), dtype=object if self.exact else float)
        for order in set(turned):
            here = np.flatnonzero(np.array([o == order for o in turned])[g.turn])
            which = index[g.row[here]]
            result[here] = basis.strip_weights(strips, which, g.s[here], g.t[here], order, up[here])
        return np.asarray(result * sign[g.turn].astype(result.dtype)[:, None])

    @cached_property
    def strips(self) -> tuple[tables.StripTables, Array]:
        """Splines across the creases of strips, and which of them each strip has."""
        sharpness, index = np.unique(self.patches.sharpness, return_inverse=True)
        dtype = np.dtype(object if self.exact else float)
        return tables.strip_tables(self._scheme, sharpness, dtype), index


class Values:
    """Values of a group's queries from control points, float64 (n_vertices, d) of the cage.

    The points are multiplied by 2 ** `balance` before anything is added up.
    """

    def __init__(self, groups: Groups, points: Array) -> None:
        self._groups = groups
        self.balance = kernels.balance(points)
        self._points = np.ldexp(points, self.balance) if self.balance else points
        self._rings: dict[int, rings.RingValues] = {}

    def _around(self, g: Group) -> rings.RingValues:
        """Values around the shared rings of a group."""
        if g.kind not in self._rings:
            patches = self._groups.patches
            known = patches.rings[g.kind], patches.controls[g.kind], *self._control_points
            found = rings.RingValues(self._groups.masks(g.kind), *known)
            self._rings.setdefault(g.kind, found)
        return self._rings[g.kind]

    @cached_property
    def _control_points(self) -> tuple[Array, Array]:
        """All control points as unevaluated sums high + low, both (n_points, d).

        Those of deep patches are close to each other, and their differences have all digits.
        """
        patches, done = self._groups.patches, len(self._points)
        high, low = np.zeros((2, patches.n_points, self._points.shape[1]))
        high[:done] = self._points
        for operator in patches.extras:
            first = operator.indices[operator.indptr[:-1]]
            rows = operator.indptr, operator.indices, operator.data
            step = kernels.differences(*rows, high, low, first)
            new = slice(done, done + operator.shape[0])
            high[new], error = kernels.two_sum(high[first], step)
            low[new] = low[first] + error
            done = new.stop
        return high, low

    @cached_property
    def _errors(self) -> Array:
        """Bounds (n_points, d) of what rounding did to control points, in units of `NOISE`."""
        return kernels.errors(self._groups.patches.extras, *self._control_points)

    def derivatives(self, g: Group, orders: Sequence[Order]) -> list[Array]:
        """Derivatives (q, d) of the queries of a group, in float64."""
        values = []
        if g.kind in (REGULAR, STRIP):
            high, low, points = self._differences(self._groups.controls(g), _FIRST_CORNER)
            for nu in orders:
                value = _contract(self._groups.spline_weights(g, nu), points)
                if nu == (0, 0):
                    value = value + low + high
                if nu != (0, 0) or self.balance:
                    value = _scaled(value, g.depth * sum(nu) - self.balance)
                values.append(value)
            return values
        if g.kind in self._groups.patches.rings:
            around = self._around(g)
            values = around.derivatives(g.row, g.s, g.t, g.turn, g.depth, orders)
            back = np.full(len(g.query), -self.balance)
            return [_scaled(x, back) for x in values] if self.balance else values
        # in patch parameters first: all orders at once, then each query picks by its turn
        turned = [basis.turned(nu) for nu in orders]
        needed = sorted({order for choices, _ in turned for order in choices})
        parts = np.empty((len(g.query), len(needed), self._points.shape[1]))
        for c in self._corners(g):
            eigen = [basis.eigen_weights(c.table, c.place, c.powers, order) for order in needed]
            rows = np.stack([x.rows for x in eigen], axis=1)  # (q, orders, K - 1)
            found = np.matmul(rows, c.modes[c.which, 1:])  # (q, orders, d)
            for k, (order, x) in enumerate(zip(needed, eigen, strict=True)):
                exponent = x.exponent + g.depth[c.query] * sum(order)
                if not x.with_limit:
                    found[:, k] = _scaled(found[:, k], exponent - self.balance)
                    continue
                found[:, k] = _scaled(found[:, k], exponent)
                found[:, k] += c.modes[c.which, 0]
                found[:, k] += c.low[c.which]
                found[:, k] += c.origin[c.which]
                if self.balance:
                    found[:, k] = np.ldexp(found[:, k], -self.balance)
            parts[c.query] = found
        for choices, sign in turned:
            pick = np.array([needed.index(order) for order in choices])[g.turn]
            values.append(parts[np.arange(len(pick)), pick] * sign[g.turn][:, None])
        return values

    def directions(self, g: Group) -> list[Array]:
        """Directions of d/du and d/dv (q, d) of a group, and bounds of their errors (q, 1)."""
        noise = kernels.NOISE
        if g.kind in (REGULAR, STRIP):
            ids = self._groups.controls(g)
            *_, points = self._differences(ids, _FIRST_CORNER)
            size = self._sizes(points, ids)  # (q, 16)
            weights = [self._groups.spline_weights(g, nu) for nu in ((1, 0), (0, 1))]
            return [_contract(w, points) for w in weights] + [
                noise * _contract(np.abs(w), size[..., None]) + kernels.TINY for w in weights
            ]
        found = np.empty((2, len(g.query), self._points.shape[1]))
        errors = np.empty((2, len(g.query), 1))
        if g.kind in self._groups.patches.rings:
            around = self._around(g)
            found, errors = around.directions(g.row, around.place(g.row, g.s, g.t, g.turn))
        else:
            for c in self._corners(g):
                found[:, c.query], errors[:, c.query] = basis.eigen_directions(
                    c.table, c.place, c.powers, c.modes, self._added(c), c.which
                )
        (ds, dt), (noise_s, noise_t) = found, noise * errors
        odd, turn = (g.turn % 2 == 1)[:, None], g.turn[:, None]
        along = np.where(odd, dt, ds) * np.where((turn == 1) | (turn == 2), -1, 1)
        across = np.where(odd, ds, dt) * np.where((turn == 2) | (turn == 3), -1, 1)
        return [along, across, np.where(odd, noise_t, noise_s), np.where(odd, noise_s, noise_t)]

    def normals(self, g: Group) -> list[Array]:
        """Unit normals (q, 3) of a group."""
        if g.kind in (REGULAR, STRIP):
            along, across, noise, other = self.directions(g)
            return [kernels.unit_normals(along, across, (noise, other))]
        if g.kind in self._groups.patches.rings:
            around = self._around(g)
            return [around.normals(g.row, around.place(g.row, g.s, g.t, g.turn))]
        result = np.empty((len(g.query), 3))
        for c in self._corners(g):
            found, error = basis.eigen_normals(
                c.table, c.place, c.powers, c.modes, self._added(c), c.which
            )
            result[c.query] = kernels.unit(found, kernels.NOISE * error)
        return [result]

    def jets(self, g: Group) -> tuple[Array, Array, Array]:
        """Derivatives (q, 4, 4, d) of orders 0 to 3 in u and v, in parameters of their piece.

        Those are u and v times 2 ** exponent (q,), returned last; before it bounds (q, 4, 4) of
        rounding errors. The position, of order (0, 0), is left 0.
        """
        shape = len(g.query), 4, 4, self._points.shape[1]
        found, error, exponent = np.zeros(shape), np.zeros(shape[:3]), g.depth.copy()
        orders = [(i, j) for i in range(4) for j in range(4) if i or j]
        if g.kind in (REGULAR, STRIP):
            ids = self._groups.controls(g)
            *_, points = self._differences(ids, _FIRST_CORNER)
            sizes = self._sizes(points, ids)
            for nu in orders:
                weights = self._groups.spline_weights(g, nu)
                found[:, *nu] = _contract(weights, points)
                error[:, *nu] = (np.abs(weights) * sizes).sum(axis=1)
            return found, kernels.NOISE * error, exponent
        for c in self._corners(g):
            added = self._added(c)[c.which, 1:]
            rows = [basis.eigen_rows(c.table, c.place, c.powers, nu) for nu in orders]
            rows = [np.where((c.place.level < 0)[:, None], np.nan, x) for x in rows]
            for nu, row in zip(orders, rows, strict=True):
                found[c.query, *nu] = _contract(row, c.modes[c.which, 1:])
                error[c.query, *nu] = (np.abs(row) * added).sum(axis=1)
            exponent[c.query] += c.place.level + 1
        error *= kernels.NOISE
        turned, bounds = np.empty_like(found), np.empty_like(error)
        for nu in orders:
            choices, sign = basis.turned(nu)
            for turn, order in enumerate(choices):
                here = g.turn == turn
                turned[here, *nu] = sign[turn] * found[here, *order]
                bounds[here, *nu] = error[here, *order]
        return turned, bounds, exponent

    def edge_normals(self, g: Group, side: Array, away: Array) -> Array:
        """Limits (q, 3) of normals towards sides of limit faces on which derivatives vanish.

        Queries of a group on the sides v = 0, u = 1, v = 1, u = 0, of numbers `side` 0 to 3 (q,),
        of which the normal is wanted so far `away` (q,) from the side; NaN where there is none.
        Derived in ``derivations/limit_normals.py``, section 8.
        """
        if g.kind in self._groups.patches.rings:  # those are not sought
            return np.full((len(g.query), 3), np.nan)
        found, error, exponent = self.jets(g)
        # x along the side, y away from it
        along_v, back = side % 2 == 1, (side == 1) | (side == 2)
        found = np.where(along_v[:, None, None, None], found.swapaxes(1, 2), found)
        error = np.where(along_v[:, None, None], error.swapaxes(1, 2), error)
        found[:, :, 1::2] *= np.where(back, -1, 1)[:, None, None, None]
        y = kernels.scale_by_two(away, exponent)
        parts = []
        for first in (found[:, 1:], error[:, 1:]), (found[:, :, 1:], error[:, :, 1:]):
            # polynomials in x, of which the first that are 0 everywhere are left out
            seen = (np.abs(first[0]).max(axis=3) > first[1]).any(axis=1)
            terms = np.cumsum(seen, axis=1) > 0
            power = np.cumsum(terms, axis=1) - 1
            scale = np.where(terms, y[:, None] ** np.maximum(power, 0), 0)
            scale /= [factorial(k) for k in range(terms.shape[1])]
            parts.append((first[0][:, 0] * scale[..., None]).sum(axis=1))
            parts.append((first[1][:, 0] * scale).sum(axis=1)[:, None])
        along, noise, across, other = parts
        normals = kernels.unit_normals(along, across, (noise, other))
        return normals * np.where((side == 2) | (side == 3), -1, 1)[:, None]

    def curvatures(self, g: Group) -> list[Array]:
        """What `curvatures` returns for a group, (q, 10)."""
        (normal,) = self.normals(g)
        if g.kind in (REGULAR, STRIP):
            ids = self._groups.controls(g)
            *_, points = self._differences(ids, _FIRST_CORNER)
            weights = [self._groups.spline_weights(g, nu) for nu in JET]
            jet = np.stack([_contract(w, points) for w in weights])
            sizes = np.abs(points) + self._errors[ids]
            errors = kernels.NOISE * np.stack([_contract(np.abs(w), sizes) for w in weights])
            return [curvatures(jet, normal, errors, sizes.max(axis=(1, 2)), self.balance)]
        if g.kind in self._groups.patches.rings:
            around = self._around(g)
            place = around.place(g.row, g.s, g.t, g.turn)
            return [_around_rings(around, place, g.row, normal, self.balance)]
        form, axis = np.full((3, len(normal)), np.nan), np.full((len(normal), 3), np.nan)
        exponent = np.zeros(len(normal), dtype=np.int64)
        for c in self._corners(g):
            sizes = np.abs(c.points) + self._errors[c.ids]
            added = np.stack([c.table.coefficient_sizes(x) for x in np.moveaxis(sizes, 2, 0)], 2)
            form[:, c.query], exponent[c.query], axis[c.query] = basis.eigen_curvatures(
                c.table, c.place, c.modes, added, sizes.max(axis=(1, 2)), c.which
            )
        return [_principal(form, exponent + self.balance, axis, normal)]

    def _differences(self, ids: Array, base: int) -> tuple[Array, Array, Array]:
        """A control point of each patch, high and low (P, d), and all relative to it (P, K, d)."""
        high, low = self._control_points
        first = ids[:, base]
        points = high[ids]
        points -= high[first, None]
        extra = (ids >= len(self._points)).any(axis=1)
        if extra.any():
            points[extra] += low[ids[extra]] - low[first[extra], None]
        return high[first], low[first], points

    def _corners(self, g: Group) -> Iterator[Corners]:
        """What evaluation around an extraordinary corner needs, for queries of a group.

        Queries are parted by the first eigenfunction that occurs in their patch at all: the
        second, but for degenerate points.
        """
        table = self._groups.table(g)
        controls = self._groups.patches.controls[g.kind]
        patch, which = np.unique(g.row, return_inverse=True)
        origin, low, points = self._differences(controls[patch], 0)
        modes = table.coefficients(points)
        occurs = (modes[:, 1:] != 0).any(axis=2)
        leads = 1 + occurs.argmax(axis=1)
        place = basis.CornerPlace.of(g.s, g.t, g.turn)
        for lead in np.unique(leads).tolist():
            query = np.flatnonzero(leads[which] == lead)
            here = place[query]
            powers = basis.EigenPowers.of(table, here, lead)
            own = origin, low, points, controls[patch], modes
            yield Corners(query, table, here, powers, *own, which[query])

    def _sizes(self, points: Array, ids: Array) -> Array:
        """Sizes (P, K) of control points `ids` relative to one of them, their errors included."""
        return np.asarray((np.abs(points) + self._errors[ids]).max(axis=2, initial=0))

    def _added(self, c: Corners) -> Array:
        """Sizes (P, K) of what was added up to coefficients."""
        return c.table.coefficient_sizes(self._sizes(c.points, c.ids))


class ExactValues:
    """Values of a group's queries from control points, as Fractions (n_vertices, d) of the cage."""

    def __init__(self, groups: Groups, points: Array) -> None:
        self._groups = groups
        for operator in groups.patches.extras:
            points = np.concatenate([points, operator @ points])
        self._points = points

    def derivatives(self, g: Group, orders: Sequence[Order]) -> list[Array]:
        """Derivatives (q, d) of the queries of a group."""
        points = self._points[self._groups.controls(g)]
        return [(self._groups.weights(g, nu)[:, :, None] * points).sum(axis=1) for nu in orders]


def curvatures(
    jet: Array,
    normal: Array,
    errors: Array | None = None,
    size: Array | None = None,
    balance: int = 0,
) -> Array:
    """Curvatures k1, k2, mean, Gaussian and directions d1, d2 (q, 10) from derivatives.

    `jet` has those of `JET`, (5, q, 3), of points times 2 ** balance; `normal` (q, 3), NaN where
    there is none. If `errors`, bounds of those of the jet, and the `size` (q,) of the patch are
    given, curvatures in doubt are as `kernels.honest` says.
    """
    # neither overflow nor underflow in squares
    exponent = -np.frexp(np.abs(jet[:2]).max(axis=(0, 2)))[1]
    jet = kernels.scale_by_two(jet, exponent[:, None])
    ones = np.ones((3, len(normal)))
    if errors is not None and size is not None:
        errors = kernels.scale_by_two(errors, exponent[:, None])
        form, noise, axis = kernels.shape_operators(jet[:2], jet[2:], ones, errors)
        form = kernels.honest(form, noise, kernels.scale_by_two(size, exponent))
    else:
        form, _, axis = kernels.shape_operators(jet[:2], jet[2:], ones)
    return _principal(form, exponent + balance, axis, normal)


def _around_rings(
    around: rings.RingValues, place: rings.Place, row: Array, normal: Array, balance: int
) -> Array:
    """The same around shared rings; at the corner itself NaN, but for 0 where all is flat."""
    found = np.full((len(row), 10), np.nan)
    jet = np.stack([place.derivatives(nu) for nu in JET])
    values = curvatures(jet, normal[place.away])
    exponent = balance - place.exponent
    values[:, :3] = _scaled(values[:, :3], exponent)
    values[:, 3] = kernels.scale_by_two(values[:, 3], 2 * exponent)
    found[place.away] = values
    at = place.corner[~np.isnan(normal[place.corner, 0])]
    if len(at):
        found[at[around.is_flat(row[at], normal[at])], :4] = 0
    return found


def _principal(form: Array, exponent: Array, axis: Array, normal: Array) -> Array:
    """The same from second fundamental forms (3, q), times 2 ** exponent."""
    form[:, np.isnan(normal).any(axis=1)] = np.nan
    found = kernels.principal(form, axis, normal)
    found[:, :3] = _scaled(found[:, :3], exponent)
    found[:, 3] = kernels.scale_by_two(found[:, 3], 2 * exponent)
    return found


def _pieces(group: Group, width: int) -> Iterator[Group]:
    """Cut a group so that no piece gathers too much: `width` numbers a query."""
    step = max(1, _GATHER // max(width, 1))
    if len(group.query) <= step:
        yield group
        return
    for start in range(0, len(group.query), step):
        part = slice(start, start + step)
        yield Group(
            group.kind,
            group.sector,
            *(x[part] for x in (group.query, group.row, group.s, group.t, group.depth, group.turn)),
        )


def _contract(weights: Array, points: Array) -> Array:
    """Sum over k of weights (q, K) times points (q, K, d)."""
    return np.asarray(np.matmul(weights[:, None], points)[:, 0])


def _scaled(values: Array, exponent: Array) -> Array:
    """Values (q, d) times 2 ** exponent (q,); infinite beyond float64's range."""
    return kernels.scale_by_two(values, exponent[:, None])
