"""Answers at places around special corners: patch, ring n, (s, t), with powers taken out.

The place (s, t) of ring n of a patch is (s, t) / 2^n in its parameters, however large n is: (u, v)
ends at 2^-1074, and at corners other than (0, 0) at 2^-53. What grows or falls with n is left out
of the numbers and told beside them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import basis
from limitsurf._kernels import reference as kernels
from limitsurf.engine.kinds import Corners, Group, Kind
from limitsurf.engine.protocol import JET, Order
from limitsurf.patches import PatchTable
from limitsurf.values import Values

Array = NDArray[Any]


@dataclass(slots=True)
class Places:
    """Places in patches, all (Q,): (s, t) in their domain, but not (0, 0).

    Patches without an eigenbasis have ring 0 alone.
    """

    patch: Array
    ring: Array
    s: Array
    t: Array


@dataclass(slots=True)
class PlaceJets:
    """Derivatives of places, in s and t, relative to a power of an eigenvalue.

    The position is ``origin + rate**ring * derivatives[0, 0]``, another derivative is
    ``rate**ring * derivatives[i, j]``.

    Attributes
    ----------
    origin : (Q, d)
        The limit of the corner; 0 in patches without rings.
    rate : (Q,)
        The eigenvalue: the subdominant one, but for degenerate points; 1 in patches without rings.
    derivatives : {(i, j): (Q, d)}
    """

    origin: Array
    rate: Array
    derivatives: dict[Order, Array]


@dataclass(slots=True)
class CharacteristicJets:
    """Derivatives in the coordinates x, y of the characteristic map, by which corners are C1.

    These are the two eigenfunctions that tangents at the corner come from, of eigenvalues a and b;
    m is the largest of the others, by which surfaces approach their tangents. At ring n the surface
    has d/dx = ``tangents[0] + (m/a)**n * first[0]``, d/dy = ``tangents[1] + (m/b)**n * first[1]``,
    and second derivatives ``(m/a**2)**n * second[0]``, ``(m/(a b))**n * second[1]`` and
    ``(m/b**2)**n * second[2]``. NaN where there are no such coordinates: in patches without a
    special corner, and where a normal has no limit or approaches it as 1 / n.

    Attributes
    ----------
    rates : (3, Q)
        a, b and m.
    coordinates : (2, Q)
        x / a**n and y / b**n.
    tangents, first : (2, Q, d)
    second : (3, Q, d)
    """

    rates: Array
    coordinates: Array
    tangents: Array
    first: Array
    second: Array


def corner_rates(patches: PatchTable, kinds: Sequence[Kind], patch: Array) -> Array:
    """Moduli of eigenvalues 1, 2 and 3 after the first at the corners of patches, (3, Q).

    The first is lambda, and the third mu where the first two are equal: a normal is of the order of
    (mu / lambda)^n from its limit. NaN in patches without an eigenbasis.
    """
    table = np.full((len(kinds), 3), np.nan)
    for number, kind in enumerate(kinds):
        if isinstance(kind, Corners):
            table[number] = np.abs(kind.table.rates[0, 1:4])
    return table[patches.kind[patch]].T


def jets(
    patches: PatchTable, kinds: Sequence[Kind], values: Values, places: Places,
    orders: Sequence[Order],
) -> PlaceJets:  # fmt: skip
    """Derivatives of any orders; raises a ValueError for rings where patches have none."""
    shape = len(places.patch), values.channels
    found = PlaceJets(np.zeros(shape), np.ones(shape[0]), {nu: np.zeros(shape) for nu in orders})
    for here, g in _groups(patches, kinds, places):
        ring = places.ring[here]
        if isinstance(g.kind, Corners):
            _corner_jets(g.kind, values, g, ring, here, found)
            continue
        if ring.any():
            raise ValueError("only patches with a special corner that has an eigenbasis have rings")
        for nu, value in zip(orders, g.kind.derivatives(values, g, orders), strict=True):
            found.derivatives[nu][here] = value
    return found


def _corner_jets(
    kind: Corners, values: Values, g: Group, ring: Array, here: Array, found: PlaceJets
) -> None:
    """Derivatives of a group around special corners, into `found`."""
    table, back = kind.table, -values.balance
    for c in kind.parts(values, g):
        at, level = here[c.query], c.place.level
        place = replace(c.place, level=np.where(level < 0, level, level + ring[c.query]))
        powers = basis.EigenPowers.of(table, place, c.powers.lead)
        high, low = table.rates[:, powers.lead].tolist()
        # rings begin at level 0, where the place may be nearer by some
        mantissa, exponent = kernels.scaled_power(high, low, np.maximum(level, 0))
        found.rate[at] = high
        limit = c.modes[c.which, 0] + c.low[c.which] + c.origin[c.which]
        found.origin[at] = np.ldexp(limit, back)
        for nu, result in found.derivatives.items():
            rows = basis.eigen_rows(table, place, powers, nu) * mantissa[:, None]
            rows[level < 0] = np.nan
            value = np.matmul(rows[:, None], c.modes[c.which, 1:])[:, 0]
            scale = exponent + sum(nu) * (level + place.halvings) + back
            result[at] = kernels.scale_by_two(value, scale[:, None])


def characteristic(
    patches: PatchTable, kinds: Sequence[Kind], values: Values, places: Places
) -> CharacteristicJets:
    """Jets of order 2 in the coordinates of the characteristic map."""
    n, d = len(places.patch), values.channels
    sizes = (3, n), (2, n), (2, n, d), (2, n, d), (3, n, d)
    found = CharacteristicJets(*(np.full(size, np.nan) for size in sizes))
    for here, g in _groups(patches, kinds, places):
        if isinstance(g.kind, Corners) and len(g.kind.table.normal):
            table = g.kind.table
            pair = np.sort(table.normal)
            if np.array_equal(pair, [1, 2]) and not np.isin([1, 2, 3], table.chains).any():
                _corner_characteristic(g.kind, values, g, places.ring[here], here, found)
    return found


def _corner_characteristic(
    kind: Corners, values: Values, g: Group, ring: Array, here: Array, found: CharacteristicJets
) -> None:
    """Characteristic jets of a group around special corners, into `found`.

    With eigenfunctions f, of derivatives f_s and so on in s and t, and coordinates (x, y) = f of
    the pair, a function h of the others has h_s = x_s h_x + y_s h_y, and h_ss - x_ss h_x - y_ss h_y
    is x_s^2 h_xx + 2 x_s y_s h_xy + y_s^2 h_yy: two systems of linear equations, in which powers of
    eigenvalues only scale the unknowns.
    """
    table, first = kind.table, list(map(int, kind.table.normal))
    given = g.s, g.t, g.orientation, table.sector.lattice
    place = basis.CornerPlace.of(*given, table.halvings)
    away = np.flatnonzero(place.level >= 0)
    place, here, row, ring = place[away], here[away], g.row[away], ring[away]
    deep = replace(place, level=place.level + ring)
    patch, which = np.unique(row, return_inverse=True)
    _, _, points = values.differences(kind.controls[patch], 0)
    modes = np.ldexp(table.coefficients(points), -values.balance)[which]  # (q, K, d)
    rest = modes[:, 1:].copy()
    rest[:, :2] = 0
    powers = basis.EigenPowers.of(table, deep, 3)
    own = basis.EigenPowers.of(table, replace(place, level=0 * place.level), 1)
    # derivatives in (S, T) of a piece: halvings cancel, for coordinates have the same
    h, f = [], []
    for nu in ((0, 0), *JET):
        rows = basis.eigen_rows(table, place, powers, nu)
        h.append(np.matmul(rows[:, None], rest)[:, 0])
        f.append(basis.eigen_rows(table, place, own, nu)[:, np.array(first) - 1])
    # at level L >= 0 of the ring all are a, b, m to the power of L times this
    rates = table.rates[0, [*first, 3]]
    share = rates[:, None] ** place.level
    x = np.stack(f) * share[:2].T  # (6, q, 2)
    h = np.stack(h) * share[2][:, None]  # (6, q, d)
    slope = np.linalg.solve(x[1:3].swapaxes(0, 1), h[1:3].swapaxes(0, 1))  # (q, 2, d)
    bent = h[3:].swapaxes(0, 1) - np.matmul(x[3:].swapaxes(0, 1), slope)  # (q, 3, d)
    s, t = x[1], x[2]  # (q, 2): derivatives of both coordinates
    system = np.stack(
        [
            np.stack([a[:, 0] * b[:, 0], a[:, 0] * b[:, 1] + a[:, 1] * b[:, 0], a[:, 1] * b[:, 1]])
            for a, b in ((s, s), (s, t), (t, t))
        ]
    )  # (3 equations, 3 unknowns, q)
    found.rates[:, here] = rates[:, None]
    found.coordinates[:, here] = x[0].T
    found.tangents[:, here] = modes[:, first].swapaxes(0, 1)
    found.first[:, here] = slope.swapaxes(0, 1)
    found.second[:, here] = np.linalg.solve(system.transpose(2, 0, 1), bent).swapaxes(0, 1)


def _groups(
    patches: PatchTable, kinds: Sequence[Kind], places: Places
) -> list[tuple[Array, Group]]:
    """Places by kind of patch: which, and as queries of the patches themselves."""
    numbers, none = patches.kind[places.patch], np.zeros(len(places.patch), dtype=np.int64)
    found = []
    for number in np.unique(numbers).tolist():
        here = np.flatnonzero(numbers == number)
        own = patches.row[places.patch[here]], places.s[here], places.t[here]
        every = np.arange(len(here))
        found.append((here, Group(kinds[number], every, *own, none[here], none[here])))
    return found
