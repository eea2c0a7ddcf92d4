"""The kinds of patches: how queries in them get their weights, and with points their values.

Regular patches and strips are splines. A special corner has an eigenbasis, or where too many faces
meet a ring that its patches share. What depends on the points comes as `values.Values`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import repeat
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import basis, rings, tables
from limitsurf._kernels import reference as kernels
from limitsurf.caching import cached_property
from limitsurf.engine.protocol import JET, Order
from limitsurf.numbers import NumberType
from limitsurf.patches import SharedRings
from limitsurf.values import Values

if TYPE_CHECKING:
    from limitsurf.scheme.scheme import Scheme

Array = NDArray[Any]


@dataclass(slots=True)
class Group:
    """Queries of a chunk that lie in patches of one kind."""

    kind: Kind
    query: Array  # (q,) places in the chunk
    row: Array  # (q,) rows of the patches in the control table of the kind
    s: Array  # (q,) parameters in the patch
    t: Array
    depth: Array  # (q,) halvings from limit face to patch
    orientation: Array  # (q,) of the patch in the limit face; see `Lattice.gradients`


class Kind(ABC):
    """Patches of one kind, for numbers of one type.

    Attributes
    ----------
    controls : (patches, K)
        Their control points.
    number : NumberType
    widths : (int, int)
        How many control points a patch has, but for those of shared rings, and with them.
    """

    def __init__(self, controls: Array, number: NumberType, scheme: Scheme) -> None:
        self.controls, self.number = controls, number
        self.widths = controls.shape[1], controls.shape[1]
        self._scheme, self._lattice = scheme, scheme.lattice

    def ids(self, row: Array) -> Array:
        """All control points of some patches, (n, K)."""
        return np.asarray(self.controls[row])

    @abstractmethod
    def weights(self, g: Group, nu: Order) -> Array:
        """Weights (q, K) of the control points for a derivative in (u, v) of the limit face."""

    @abstractmethod
    def derivatives(self, values: Values, g: Group, orders: Sequence[Order]) -> list[Array]:
        """Derivatives (q, d) in (u, v), in float64."""

    def exact_derivatives(self, points: Array, g: Group, orders: Sequence[Order]) -> list[Array]:
        """Derivatives (q, d) in (u, v) from all control points, (n_points, d), as Fractions."""
        own = points[self.ids(g.row)]
        return [(self.weights(g, nu)[:, :, None] * own).sum(axis=1) for nu in orders]

    @abstractmethod
    def directions(self, values: Values, g: Group) -> list[Array]:
        """Directions of d/du and d/dv (q, d) up to positive factors, and their noise (q, 1)."""

    @abstractmethod
    def normals(self, values: Values, g: Group) -> list[Array]:
        """Unit normals (q, 3)."""

    @abstractmethod
    def curvatures(self, values: Values, g: Group) -> list[Array]:
        """What `curvatures` returns, (q, 10)."""

    def jets(
        self, values: Values, g: Group, orientation: Array
    ) -> tuple[Array, Array, Array] | None:
        """Derivatives (q, n, n, d) of all orders in x and y, in parameters of their piece.

        Patches have this `orientation` (q,) in x and y, which are these times 2 ** exponent (q,),
        returned last; before it bounds (q, n, n) of rounding errors. The position, of order (0, 0),
        is left 0. None if there are no such pieces.
        """
        return None

    @cached_property
    def _orders(self) -> list[Order]:
        """Orders of derivatives that are not 0 everywhere."""
        each = range(self._size)
        orders = [(i, j) for i in each for j in each if i or j]
        return [nu for nu in orders if not self._scheme.spline.vanishes(nu)]

    @property
    def _size(self) -> int:
        return self._scheme.spline.degree + 1


class Spline(Kind):
    """Patches of pieces of a spline."""

    @abstractmethod
    def own_weights(self, g: Group, nu: Order, here: Any) -> Array:
        """Weights (n, K) of some queries for derivatives in (s, t), but for the depth."""

    def patch_weights(self, g: Group, nu: Order, orientation: Array | None = None) -> Array:
        """Weights (q, K) for derivatives in (u, v), but for the depth of the patch.

        Those of an `orientation` if it is given, else of their own.
        """
        orientation = g.orientation if orientation is None else orientation
        if not orientation.any():
            return self.own_weights(g, nu, slice(None))
        rows = partial(self.own_weights, g)
        return basis.turned_rows(self._lattice, nu, orientation, rows)

    @cached_property
    def _first(self) -> int:
        """The control point at the corner (0, 0)."""
        return self._scheme.spline.template.index((1, 1))

    def weights(self, g: Group, nu: Order) -> Array:
        scale = kernels.scale_by_two(np.ones(len(g.s), dtype=self.number.dtype), g.depth * sum(nu))
        return np.asarray(self.patch_weights(g, nu) * scale[:, None])

    def derivatives(self, values: Values, g: Group, orders: Sequence[Order]) -> list[Array]:
        high, low, points = values.differences(self.controls[g.row], self._first)
        found = []
        for nu in orders:
            value = np.matmul(self.patch_weights(g, nu)[:, None], points)[:, 0]
            if nu == (0, 0):
                value = value + low + high
            if nu != (0, 0) or values.balance:
                exponent = g.depth * sum(nu) - values.balance
                value = kernels.scale_by_two(value, exponent[:, None])
            found.append(value)
        return found

    def directions(self, values: Values, g: Group) -> list[Array]:
        ids = self.controls[g.row]
        *_, points = values.differences(ids, self._first)
        size = values.sizes(points, ids)[..., None]  # (q, K, 1)
        weights = [self.patch_weights(g, nu) for nu in ((1, 0), (0, 1))]
        noise = [kernels.NOISE * _contract(np.abs(w), size) + kernels.TINY for w in weights]
        return [_contract(w, points) for w in weights] + noise

    def normals(self, values: Values, g: Group) -> list[Array]:
        along, across, *noise = self.directions(values, g)
        return [kernels.unit_normals(along, across, (noise[0], noise[1]))]

    def curvatures(self, values: Values, g: Group) -> list[Array]:
        (normal,), ids = self.normals(values, g), self.controls[g.row]
        *_, points = values.differences(ids, self._first)
        weights = [self.patch_weights(g, nu) for nu in JET]
        jet = np.stack([_contract(w, points) for w in weights])
        sizes = np.abs(points) + values.errors[ids]
        errors = kernels.NOISE * np.stack([_contract(np.abs(w), sizes) for w in weights])
        return [curvatures(jet, normal, errors, sizes.max(axis=(1, 2)), values.balance)]

    def jets(self, values: Values, g: Group, orientation: Array) -> tuple[Array, Array, Array]:
        ids, n = self.controls[g.row], self._size
        *_, points = values.differences(ids, self._first)
        sizes = values.sizes(points, ids)
        found, error = np.zeros((len(ids), n, n, points.shape[2])), np.zeros((len(ids), n, n))
        for nu in self._orders:
            weights = self.patch_weights(g, nu, orientation)
            found[:, *nu] = _contract(weights, points)
            error[:, *nu] = (np.abs(weights) * sizes).sum(axis=1)
        return found, kernels.NOISE * error, g.depth.copy()


class Regular(Spline):
    """Patches of the scheme's spline."""

    def __init__(self, controls: Array, number: NumberType, scheme: Scheme) -> None:
        super().__init__(controls, number, scheme)
        self._weights = basis.regular_weights(scheme.spline, number)

    def own_weights(self, g: Group, nu: Order, here: Any) -> Array:
        return self._weights(g.s[here], g.t[here], nu)


class Strip(Spline):
    """Patches along semi-sharp creases, of some `sharpness` (patches,); quads of dual schemes."""

    _first = 5  # of four times four

    def __init__(
        self, controls: Array, number: NumberType, scheme: Scheme, sharpness: Array
    ) -> None:
        super().__init__(controls, number, scheme)
        self._sharpness = sharpness

    @cached_property
    def tables(self) -> tuple[tables.StripTables, Array]:
        """Splines across creases, and which of them each strip has."""
        return tables.strips_of(self._scheme, self._sharpness, self.number)

    def own_weights(self, g: Group, nu: Order, here: Any) -> Array:
        strips, index = self.tables
        # where s and t grow towards corner 0
        up = np.array([both[:2] for both in self._lattice.against])[g.orientation[here]].T
        given = g.s[here], g.t[here], nu, (up[0], up[1])
        return basis.strip_weights(strips, index[g.row[here]], *given)


@dataclass(slots=True)
class _Around:
    """Queries of a group around extraordinary corners, with what their patches have in common."""

    query: Array  # (q,) places in the group
    place: basis.CornerPlace
    powers: basis.EigenPowers
    origin: Array  # (P, d) first control points of the patches concerned
    low: Array  # (P, d) what rounding took from them
    points: Array  # (P, K, d) control points relative to the first
    ids: Array  # (P, K) which they are
    modes: Array  # (P, K, d) their coefficients in the eigenbasis
    which: Array  # (q,) patch of each query


class Corners(Kind):
    """Patches with a special corner that has an eigenbasis, its `table`."""

    def __init__(
        self, controls: Array, number: NumberType, scheme: Scheme, table: tables.EigenTable
    ) -> None:
        super().__init__(controls, number, scheme)
        self.table, self._halvings = table, table.halvings

    @cached_property
    def _rational(self) -> tables.RationalTable:
        # the points of refined corners are rational where their masks are, or have been refused
        vertex = int(self.controls[0, 0])
        return tables.rational_table(self._scheme, self.table.sector, vertex=vertex)

    def weights(self, g: Group, nu: Order) -> Array:
        given = g.s, g.t, g.orientation, self._lattice, self._halvings
        place, table = basis.CornerPlace.of(*given), self.table
        # one for all derivatives of an order, whose sums are finite where they are not
        exponent = np.zeros(len(g.s), dtype=np.int64)

        def rows(order: Order, here: Array) -> Array:
            sub = place[here]
            if self.number.exact:
                at_corner = basis.corner_derivative(table, order)
                spline = self._scheme.spline
                return basis.rational_weights(self._rational, spline, sub, order, at_corner)
            found = basis.eigen_weights(table, sub, basis.EigenPowers.of(table, sub), order)
            if not found.with_limit:
                exponent[here] = found.exponent
                found = replace(found, exponent=np.zeros_like(found.exponent))
            return basis.control_weights(table, found)

        found = basis.turned_rows(self._lattice, nu, g.orientation, rows)
        exponent += g.depth * sum(nu)
        if self.number.exact:
            scale = kernels.scale_by_two(np.ones(len(g.s), dtype=self.number.dtype), exponent)
            return np.asarray(found * scale[:, None])
        return kernels.scale_by_two(found, exponent[:, None])

    def derivatives(self, values: Values, g: Group, orders: Sequence[Order]) -> list[Array]:
        # in patch parameters first: all orders at once, then each query adds up what it needs
        balance, wanted = values.balance, set[Order]()
        turned = list(map(basis.turned, repeat(self._lattice), orders))
        for terms in turned:
            for choices, _ in terms:
                wanted.update(choices)
        needed = sorted(wanted)
        parts = np.empty((len(g.query), len(needed), values.channels))
        # of two, one for all derivatives of an order, whose sums are finite where they are not
        exponents = np.zeros(parts.shape[:2], dtype=np.int64)
        for c in self.parts(values, g):
            weights = partial(basis.eigen_weights, self.table, c.place, c.powers)
            eigen = list(map(weights, needed))
            rows = np.stack(list(map(attrgetter("rows"), eigen)), axis=1)  # (q, orders, K - 1)
            found = np.matmul(rows, c.modes[c.which, 1:])  # (q, orders, d)
            for k, (order, x) in enumerate(zip(needed, eigen, strict=True)):
                exponent = x.exponent + g.depth[c.query] * sum(order)
                if not x.with_limit:
                    exponents[c.query, k] = exponent - balance
                    continue
                found[:, k] = kernels.scale_by_two(found[:, k], exponent[:, None])
                found[:, k] += c.modes[c.which, 0]
                found[:, k] += c.low[c.which]
                found[:, k] += c.origin[c.which]
                if balance:
                    found[:, k] = np.ldexp(found[:, k], -balance)
            parts[c.query] = found
        result: list[Array] = []
        every = np.arange(len(g.query))
        for terms in turned:
            for number, (choices, factors) in enumerate(terms):
                pick = np.array(list(map(needed.index, choices)))[g.orientation]
                factor = factors[g.orientation]
                if number == 0:
                    result.append(parts[every, pick] * factor[:, None])
                    exponent = exponents[every, pick]
                    continue
                here = np.flatnonzero(factor)
                result[-1][here] += parts[here, pick[here]] * factor[here, None]
            result[-1] = kernels.scale_by_two(result[-1], exponent[:, None])
        return result

    def directions(self, values: Values, g: Group) -> list[Array]:
        found, errors = np.empty((2, len(g.query), values.channels)), np.empty((2, len(g.query), 1))
        for c in self.parts(values, g):
            known = c.modes, self._added(values, c), c.which, g.orientation[c.query]
            found[:, c.query], errors[:, c.query] = basis.eigen_directions(
                self.table, c.place, c.powers, *known
            )
        return [*found, *(kernels.NOISE * errors)]

    def normals(self, values: Values, g: Group) -> list[Array]:
        result = np.empty((len(g.query), 3))
        for c in self.parts(values, g):
            found, error = basis.eigen_normals(
                self.table, c.place, c.powers, c.modes, self._added(values, c), c.which
            )
            result[c.query] = kernels.unit(found, kernels.NOISE * error)
        return [result]

    def curvatures(self, values: Values, g: Group) -> list[Array]:
        (normal,) = self.normals(values, g)
        form, axis = np.full((3, len(normal)), np.nan), np.full((len(normal), 3), np.nan)
        exponent = np.zeros(len(normal), dtype=np.int64)
        for c in self.parts(values, g):
            sizes = np.abs(c.points) + values.errors[c.ids]
            added = np.stack(
                [self.table.coefficient_sizes(x) for x in np.moveaxis(sizes, 2, 0)], axis=2
            )
            form[:, c.query], exponent[c.query], axis[c.query] = basis.eigen_curvatures(
                self.table, c.place, c.modes, added, sizes.max(axis=(1, 2)), c.which
            )
        return [_principal(form, exponent + values.balance, axis, normal)]

    def jets(self, values: Values, g: Group, orientation: Array) -> tuple[Array, Array, Array]:
        shape = len(g.query), self._size, self._size, values.channels
        found, error, exponent = np.zeros(shape), np.zeros(shape[:3]), g.depth.copy()
        for c in self.parts(values, g):
            added = self._added(values, c)[c.which, 1:]
            rows = [basis.eigen_rows(self.table, c.place, c.powers, nu) for nu in self._orders]
            rows = [np.where((c.place.level < 0)[:, None], np.nan, x) for x in rows]
            for nu, row in zip(self._orders, rows, strict=True):
                found[c.query, *nu] = _contract(row, c.modes[c.which, 1:])
                error[c.query, *nu] = (np.abs(row) * added).sum(axis=1)
            exponent[c.query] += c.place.level + c.place.halvings
        error *= kernels.NOISE
        turned, bounds = np.zeros_like(found), np.zeros_like(error)
        for nu in self._orders:
            for choices, factors in basis.turned(self._lattice, nu):
                for way, (order, factor) in enumerate(zip(choices, factors, strict=True)):
                    here = np.flatnonzero((orientation == way) & (factor != 0))
                    turned[here, *nu] += factor * found[here, *order]
                    bounds[here, *nu] += abs(factor) * error[here, *order]
        return turned, bounds, exponent

    def parts(self, values: Values, g: Group) -> list[_Around]:
        """Queries parted by the first eigenfunction that occurs in their patch at all.

        That is the second, but for degenerate points.
        """
        patch, which = np.unique(g.row, return_inverse=True)
        ids = self.controls[patch]
        origin, low, points = values.differences(ids, 0)
        modes = self.table.coefficients(points)
        occurs = (modes[:, 1:] != 0).any(axis=2)
        leads = 1 + occurs.argmax(axis=1)
        given = g.s, g.t, g.orientation, self._lattice, self._halvings
        place, parts = basis.CornerPlace.of(*given), []
        found = np.unique(leads).tolist()
        for lead in found:
            query = np.flatnonzero(leads[which] == lead)
            here = place[query] if len(found) > 1 else place
            powers = basis.EigenPowers.of(self.table, here, lead)
            own = origin, low, points, ids, modes
            parts.append(_Around(query, here, powers, *own, which[query]))
        return parts

    def _added(self, values: Values, c: _Around) -> Array:
        """Sizes (P, K) of what was added up to coefficients."""
        return self.table.coefficient_sizes(values.sizes(c.points, c.ids))


class Rings(Kind):
    """Patches with a special corner of many faces, which share the rings around these."""

    def __init__(
        self,
        controls: Array,
        number: NumberType,
        scheme: Scheme,
        shared: SharedRings,
        masks: tables.RingMasks,
    ) -> None:
        super().__init__(controls, number, scheme)
        self.shared, self.masks = shared, masks
        outer = controls.shape[1]
        self.widths = 25 + outer, shared.points.shape[1] + outer  # (5 x 5 refined points)

    def ids(self, row: Array) -> Array:
        """All control points of some patches, those of rings first."""
        own = self.shared.points[self.shared.ring[row]]
        return np.concatenate([own, self.controls[row]], axis=1)

    def weights(self, g: Group, nu: Order) -> Array:
        scale = kernels.scale_by_two(np.ones(len(g.s), dtype=self.number.dtype), g.depth * sum(nu))
        place = basis.CornerPlace.of(g.s, g.t, g.orientation, self._lattice)
        position = self.shared.position[g.row]

        def rows(order: Order, here: Array) -> Array:
            if not self.number.exact:
                own = position[here], g.s[here], g.t[here], g.orientation[here]
                return rings.weights(self.masks, *own, order)
            result = self.number.full((len(here), self.widths[1]), self.number.zero)
            for p in np.unique(position[here]).tolist():
                at = np.flatnonzero(position[here] == p)
                columns, sector = rings.columns(self.masks.sector, p)
                zero, only = np.zeros(1), np.array([p])
                exists = rings.on_curve(self.masks, only, zero, zero, order)
                at_corner = np.where(exists, 1.0, rings.at_corners(self.masks, only, order))
                rational = tables.rational_table(self._scheme, sector)
                given = rational, self._scheme.spline, place[here[at]], order, at_corner
                result[at[:, None], columns] = basis.rational_weights(*given)
            return result

        return basis.turned_rows(self._lattice, nu, g.orientation, rows) * scale[:, None]

    def derivatives(self, values: Values, g: Group, orders: Sequence[Order]) -> list[Array]:
        found = self.around(values).derivatives(g.row, g.s, g.t, g.orientation, g.depth, orders)
        back = np.full((len(g.query), 1), -values.balance)
        return [kernels.scale_by_two(x, back) for x in found] if values.balance else found

    def directions(self, values: Values, g: Group) -> list[Array]:
        around = self.around(values)
        place = around.place(g.row, g.s, g.t, g.orientation)
        both = basis.turned_directions(
            self._lattice, *around.directions(g.row, place), g.orientation
        )
        return [*both[0], *(kernels.NOISE * both[1])]

    def normals(self, values: Values, g: Group) -> list[Array]:
        around = self.around(values)
        return [around.normals(g.row, around.place(g.row, g.s, g.t, g.orientation))]

    def curvatures(self, values: Values, g: Group) -> list[Array]:
        """At the corner itself NaN, but for 0 where all is flat."""
        (normal,), around = self.normals(values, g), self.around(values)
        place, balance = around.place(g.row, g.s, g.t, g.orientation), values.balance
        result = np.full((len(g.row), 10), np.nan)
        jet = np.stack([place.derivatives(nu) for nu in JET])
        found = curvatures(jet, normal[place.away])
        exponent = balance - place.exponent
        found[:, :3] = kernels.scale_by_two(found[:, :3], exponent[:, None])
        found[:, 3] = kernels.scale_by_two(found[:, 3], 2 * exponent)
        result[place.away] = found
        at = place.corner[~np.isnan(normal[place.corner, 0])]
        if len(at):
            result[at[around.is_flat(g.row[at], normal[at])], :4] = 0
        return [result]

    def around(self, values: Values) -> rings.RingValues:
        """Values around the shared rings."""
        return values.around(self.masks, self.shared, self.controls)


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


def _principal(form: Array, exponent: Array, axis: Array, normal: Array) -> Array:
    """Curvatures and directions (q, 10) from second forms (3, q), times 2 ** exponent."""
    form[:, np.isnan(normal).any(axis=1)] = np.nan
    found = kernels.principal(form, axis, normal)
    found[:, :3] = kernels.scale_by_two(found[:, :3], exponent[:, None])
    found[:, 3] = kernels.scale_by_two(found[:, 3], 2 * exponent)
    return found


def _contract(weights: Array, points: Array) -> Array:
    """Sum over k of weights (q, K) times points (q, K, d)."""
    return np.asarray(np.matmul(weights[:, None], points)[:, 0])
