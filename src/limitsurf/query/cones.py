"""Cones that hold the normals of a surface, and how far triangles turn from these.

Cross products of derivatives are polynomials: their directions are means of those of Bernstein
coefficients. ``derivations/tessellation.py`` has the bounds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limitsurf.pieces import weights
from limitsurf.pieces.bernstein import Bernstein
from limitsurf.query.chords import length, triangles_error, ways
from limitsurf.query.polynomials import Form, multiples, products
from limitsurf.query.wanted import LOST

if TYPE_CHECKING:
    from limitsurf.pieces.beyond import Beyond
    from limitsurf.scheme.lattice import Lattice
    from limitsurf.tables import EigenTable

Array = NDArray[Any]

# by which normals differ that are welded, and more
WELDED = 2e-6
_TOGETHER = 256  # polynomials, so that sums stay in the cache
_SLOW = 8  # eigenfunctions besides those of tangents of which what they do has its signs
_EQUAL = 1e-14  # eigenvalues are, that differ by less


class Turning:
    """How far triangles with corners on polynomials turn from the surface.

    Parameters
    ----------
    lattice : Lattice
    form : Form
        Of the polynomials.
    """

    def __init__(self, lattice: Lattice, form: Form) -> None:
        self._form = form
        self._normal_form, self._crossed = normal_form(lattice, form.degree)

    def normals(self, points: Array) -> tuple[Array, Array]:
        """Coefficients (L, m, 3) of normals of polynomials (L, n, 3), and their errors (L,)."""
        return crossed(self._form, self._crossed, points)

    def nowhere(self, points: Array) -> Array:
        """Which parts have no normal but for rounding, (L,): those that are curves, or points."""
        normals, noise = self.normals(points)
        return np.asarray(length(normals).max(axis=1) <= noise)

    def whole(self, points: Array) -> Array:
        """The largest angle from any triangle between the corners of parts, (L,), in radians."""
        form = self._form
        normals, noise = self.normals(points)
        corners = points[:, form.corners]
        found = np.zeros(len(points))
        bent = self._bent(normals)
        for way in ways(len(form.ends)):
            here = np.broadcast_to(form.ends[way], (len(points), 3, 2))
            at_corners = normals[:, self._normal_form.corners[way]]
            turned = self._triangles(normals, noise, bent, here, corners[:, way], at_corners)
            found = np.maximum(found, turned)
        return found

    def cut(self, points: Array, own: Array, at: Array, corners: Array) -> Array:
        """The same of triangles in parts: `own` (T,) has the part of each.

        Their corners are (T, 3, 2) in the parameters of the parts, and (T, 3, 3) in space.
        """
        normals, noise = self.normals(points)
        bent = self._bent(normals)
        s, t = at.reshape(-1, 2).T
        basis = self._normal_form.values(s, t, 0)[:, 0].reshape(*at.shape[:2], -1)
        normals, noise = normals[own], noise[own]
        bent = bent[0][own], bent[1][own]
        return self._triangles(normals, noise, bent, at, corners, np.matmul(basis, normals))

    def _bent(self, normals: Array) -> tuple[Array, Array]:
        """Second derivatives of normals, as in `Parts`."""
        form = self._normal_form
        found = np.matmul(form.derivatives[3:].reshape(3 * form.size, form.size), normals)
        found = found.reshape(len(normals), 3, form.size, 3)
        middle = (found.min(axis=2) + found.max(axis=2)) / 2
        return middle, length(found - middle[:, :, None]).max(axis=2)

    def _triangles(
        self, normals: Array, noise: Array, bent: tuple[Array, Array], at: Array, corners: Array,
        at_corners: Array,
    ) -> Array:  # fmt: skip
        """Bounds (T,) of angles of a triangle each, pi if there is none."""
        axis = facing(corners)
        flat = cone(normals, noise, axis)
        # between the normals of corners: directions of means of them, but for the lengths of those
        far = triangles_error(bent[0], bent[1], at, np.zeros_like(corners))
        least = np.matmul(normals, axis[:, :, None])[:, :, 0].min(axis=1) - noise
        sizes = length(at_corners)
        with np.errstate(divide="ignore", invalid="ignore"):
            root = np.sqrt(sizes.max(axis=1) / sizes.min(axis=1))
            share = (root - 1) / (root + 1)
            units = at_corners / sizes[:, :, None]
            wide = length(units - np.roll(units, 1, axis=1)).max(axis=1)
            smooth = _arcsin(far + noise, least) + _arcsin(share * wide, np.cos(flat))
        smooth = np.where(np.isnan(smooth) | (flat >= np.pi / 2), np.pi, smooth)
        found = np.maximum(flat, np.minimum(smooth, 2 * flat))
        return np.where(flat < np.pi / 2, np.minimum(found + WELDED, np.pi), np.pi)


class Crossing(NamedTuple):
    """How coefficients of two polynomials make those of their product.

    Attributes
    ----------
    weights : (n,)
        What coefficients of factors are multiplied by.
    places : (n, n) int
        To which coefficient of the product a pair adds.
    total : (m,)
        What the sums are divided by.
    """

    weights: Array
    places: Array
    total: Array


def crossed(form: Form, pairs: Crossing, points: Array) -> tuple[Array, Array]:
    """Coefficients (L, m, 3) of cross products of derivatives, and what rounding takes, (L,)."""
    n = form.size
    both = np.matmul(form.derivatives[1:3].reshape(2 * n, n), points)
    return cross_products(pairs, both[:, :n], both[:, n:])


def cross_products(pairs: Crossing, du: Array, dv: Array) -> tuple[Array, Array]:
    """The same of polynomials (L, n, 3), of one degree."""
    size = length(du).max(axis=1) + length(dv).max(axis=1)
    found = np.empty((len(du), len(pairs.total), 3))
    for start in range(0, len(du), _TOGETHER):
        some = slice(start, start + _TOGETHER)
        # the longest axis last: sums over pairs are then of long rows
        (a, b, c), (d, e, f) = (
            np.ascontiguousarray((x[some] * pairs.weights[:, None]).transpose(2, 1, 0))
            for x in (du, dv)
        )
        made = np.zeros((3, len(pairs.total), len(du[some])))
        for k, to in enumerate(pairs.places):
            made[0, to] += b[k] * f - c[k] * e
            made[1, to] += c[k] * d - a[k] * f
            made[2, to] += a[k] * e - b[k] * d
        found[some] = (made / pairs.total[:, None]).transpose(2, 1, 0)
    return found, 8 * LOST * size


def cone(normals: Array, noise: Array, axis: Array) -> Array:
    """Half angles (L,) of cones around unit vectors (L, 3) that hold vectors (L, m, 3)."""
    size = length(normals)
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.where(size > noise[:, None], noise[:, None] / size, 1.0)
    angle = np.arctan2(
        length(np.cross(normals, axis[:, None])), np.matmul(normals, axis[:, :, None])[:, :, 0]
    )
    found = (angle + np.arcsin(off)).max(axis=1)
    return np.where(np.isnan(found) | (off >= 1).any(axis=1), np.pi, np.minimum(found, np.pi))


def facing(corners: Array) -> Array:
    """Unit normals (..., 3) of triangles (..., 3, 3); NaN without one."""
    sides = corners[..., 1:, :] - corners[..., :1, :]
    normal = np.cross(sides[..., 0, :], sides[..., 1, :])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(normal / length(normal)[..., None])


def _arcsin(far: Array, size: Array) -> Array:
    """How far a vector turns that is moved by as much, pi if its size is not larger."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(far < size, np.arcsin(np.clip(far / size, 0, 1)), np.pi)


@lru_cache(maxsize=32)
def normal_form(lattice: Lattice, degree: int) -> tuple[Form, Crossing]:
    """The form of products of polynomials of a degree, and how these are made."""
    factor, product = Form.of(lattice, degree), Form.of(lattice, 2 * degree)
    number = {tuple(place): k for k, place in enumerate(product.exponents.tolist())}
    sums = factor.exponents[:, None] + factor.exponents
    places = np.array([[number[tuple(place)] for place in row] for row in sums.tolist()])
    weights, total = multiples(factor.exponents), multiples(product.exponents)
    return product, Crossing(weights, places, total)


@dataclass(frozen=True, eq=False)
class _Leading:
    """What the normals around a special corner tend to, whatever the control points.

    Of c coefficients of normals, on all pieces of the first ring.

    Attributes
    ----------
    pair : (2,)
        The eigenfunctions that lead, counted without the constant one.
    turn : float
        The sign of their Jacobian.
    jacobian : (c,)
        Its size, positive.
    most : (2, 2)
        Bounds of their derivatives, by direction and eigenfunction.
    plain : (s,)
        Eigenfunctions that follow and fall each by a rate of its own, the slowest first.
    steps : (2, n, s)
        Derivatives of these, by direction.
    crossed : (2, c, s)
        Jacobians of either that leads and these.
    rest : (2, K - 1)
        Bounds of derivatives of others, by direction; 0 for both that lead.
    """

    pair: Array
    turn: float
    jacobian: Array
    most: Array
    plain: Array
    steps: Array
    crossed: Array
    rest: Array

    def split(self, some: Array) -> _Leading:
        """With so many of the plain ones, as `rest` has the others."""
        rest = self.rest.copy()
        rest[:, self.plain[some]] = 0
        steps, crossed = self.steps[..., some], self.crossed[..., some]
        return replace(self, plain=self.plain[some], steps=steps, crossed=crossed, rest=rest)


class Poles:
    """Cones that hold the normals from some ring around special corners on.

    Parameters
    ----------
    beyond : Beyond
    lattice : Lattice
    form : Form
    """

    def __init__(self, beyond: Beyond, lattice: Lattice, form: Form) -> None:
        self._group = np.full(len(beyond), -1)
        self._row = np.zeros(len(beyond), dtype=np.int64)
        self._known: list[tuple[EigenTable, _Leading, int, Array]] = []
        for which, table, level, modes in beyond.eigenfunctions():
            leading = None if table is None else _leading(table, lattice, form)
            if table is not None and leading is not None:
                self._group[which] = len(self._known)
                self._row[which] = np.arange(len(which))
                self._known.append((table, leading, level, modes))

    def cones(self, which: Array, ring: Array) -> tuple[Array, Array]:
        """Unit normals (M, 3) at corners, and half angles (M,); pi without a bound."""
        axis, wide = np.full((len(which), 3), np.nan), np.full(len(which), np.pi)
        key = self._group[which] * 4096 + ring
        for one in np.unique(key[self._group[which] >= 0]).tolist():
            here = np.flatnonzero(key == one)
            table, leading, level, modes = self._known[one // 4096]
            known = modes[self._row[which[here]]]
            axis[here], wide[here] = _cone_beyond(table, leading, level + one % 4096, known)
        return axis, wide


def _cone_beyond(
    table: EigenTable, leading: _Leading, level: int, modes: Array
) -> tuple[Array, Array]:
    """Normals (M, 3) at corners and half angles of cones from a ring on, of modes (M, K - 1, 3)."""
    one, other = (modes[:, k] for k in leading.pair.tolist())
    rates, plain = table.rates[0, 1:], leading.plain
    sizes = leading.rest[:, plain].max(axis=0) * length(modes[:, plain]).max(axis=0, initial=0)
    fallen = (rates[plain] / np.abs(rates[leading.pair]).min()) ** level
    leading = leading.split(np.sort(np.argsort(-sizes * fallen, kind="stable")[:_SLOW]))
    normal = np.cross(one, other) * leading.turn
    size = length(normal)
    axis, wide = np.full(normal.shape, np.nan), np.full(len(normal), np.pi)
    for start in range(0, len(modes), _TOGETHER):
        some = np.arange(start, min(start + _TOGETHER, len(modes)))
        some = some[size[some] > 0]
        axis[some] = normal[some] / size[some, None]
        aside, off = _rest_beyond(table, leading, level, modes[some], axis[some])
        along, far = _slow_beyond(table, leading, level, modes[some], axis[some])
        along += leading.jacobian[:, None] * size[some, None, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            far = (far + aside[:, None, None]) / (along - off[:, None, None])
            sure = (along > off[:, None, None]).all(axis=(1, 2))
            turned = np.arctan(far.max(axis=(1, 2), initial=0)) * (1 + 1e-9)
        wide[some] = np.where(sure, turned, np.pi)
    noise = 8 * LOST * (length(one) + length(other))
    return axis, np.minimum(wide + _arcsin(noise, size), np.pi)


def _slow_beyond(
    table: EigenTable, leading: _Leading, level: int, modes: Array, axis: Array
) -> tuple[Array, Array]:
    """What slow modes add to coefficients along axes, and how far across, (M, c, g) each.

    Multiples of what falls slowest, of that and what is next, and so on: normals are means of
    these, on the first ring and all beyond (``derivations/tessellation.py``).
    """
    rates, slow = table.rates[0, 1:], leading.plain
    count = len(leading.jacobian)
    none = np.zeros((len(modes), count, 1))
    if not len(slow):
        return none, none
    across = _across(axis)
    basis = np.concatenate([axis[:, None], across], axis=1)  # (M, 3, 3)
    rate = (rates[slow] / np.abs(rates[leading.pair[::-1], None])).ravel()
    steps = np.concatenate([np.cross(modes[:, [k]], modes[:, slow]) for k in leading.pair], axis=1)
    vectors = np.matmul(steps * leading.turn, basis.swapaxes(1, 2))
    columns = np.concatenate([*leading.crossed], axis=1)
    order = np.argsort(-rate, kind="stable")
    rate, vectors, columns = rate[order], vectors[:, order], columns[:, order]
    vectors = vectors * (rate**level)[None, :, None]
    first = np.flatnonzero(np.append(True, rate[1:] < rate[:-1] * (1 - _EQUAL)))
    ends = np.append(first[1:], len(rate))
    found = np.zeros((len(modes), len(first) + 1, count, 3))
    for k, (low, high) in enumerate(zip(first.tolist(), ends.tolist(), strict=True)):
        more = np.matmul(columns[:, low:high], vectors[:, low:high])
        found[:, k + 1] = found[:, k] + more
    found = found.swapaxes(1, 2)
    return found[..., 0], np.hypot(found[..., 1], found[..., 2])


def _rest_beyond(
    table: EigenTable, leading: _Leading, level: int, modes: Array, axis: Array
) -> tuple[Array, Array]:
    """How far coefficients of normals move by all that is not in `_slow_beyond`, (M,) each.

    Across the axis, and at all: the former takes a factor that is not across it, as both that lead
    are, and so is nothing on what is flat.
    """
    plain, leads = leading.plain, np.abs(table.rates[0, 1 + leading.pair])
    heights = np.matmul(modes, axis[:, :, None])
    A, B = (length(modes[:, [k]]) * leading.most[:, j] for j, k in enumerate(leading.pair.tolist()))
    first, both = [], []
    for parts in (heights, modes):
        sizes = np.sqrt((parts**2).sum(axis=2))
        # others against either that leads, by direction: they fall from ring to ring
        rest = [sizes @ (leading.rest @ weights.growth(table, level, r)).T for r in leads]
        off = A[:, 0] * rest[1][:, 1] + rest[1][:, 0] * A[:, 1]
        first.append(off + B[:, 0] * rest[0][:, 1] + rest[0][:, 0] * B[:, 1])
        for r, more in zip(leads.tolist(), rest, strict=True):
            far = np.zeros((len(modes), 2))
            total = np.zeros((len(modes), 2, leading.steps.shape[1], parts.shape[2]))
            for j, own in enumerate(plain.tolist()):
                # those of one rate are summed before, here as elsewhere
                rate = table.rates[0, 1 + own]
                share = (rate / r) ** level * parts[:, None, None, own]
                total = total + leading.steps[:, :, j, None] * share
                last = j + 1 == len(plain)
                if last or table.rates[0, 1 + plain[j + 1]] < rate * (1 - _EQUAL):
                    far = np.maximum(far, np.sqrt((total**2).sum(axis=3)).max(axis=2))
            both.append(far + more)
    (a, b), (c, d) = both[:2], both[2:]
    aside = first[0] + a[:, 0] * d[:, 1] + c[:, 0] * b[:, 1]
    off = first[1] + c[:, 0] * d[:, 1]
    return np.minimum(aside, off) * (1 + 1e-9), off * (1 + 1e-9)


def _across(axis: Array) -> Array:
    """Two unit vectors (M, 2, 3) that are orthogonal to others (M, 3), and to each other."""
    least = np.eye(3)[np.abs(axis).argmin(axis=1)]
    one = np.cross(axis, least)
    one /= length(one)[:, None]
    return np.stack([one, np.cross(axis, one)], axis=1)


@lru_cache(maxsize=256)
def _leading(table: EigenTable, lattice: Lattice, form: Form) -> _Leading | None:
    """None if normals have no limit, or are not known to reach it."""
    if not len(table.normal):
        return None
    pair, rates = table.normal - 1, np.abs(table.rates[0])
    linked = np.concatenate([table.chains, table.chains - 1, table.pairs, table.pairs + 1])
    others = np.setdiff1d(np.arange(1, table.size), table.normal)
    slow = len(others) and rates[others].max() >= rates[table.normal].min()
    if np.isin(table.normal, linked).any() or slow:
        return None
    pieces = Bernstein.of(table.scheme, False).from_powers @ table.pieces[:, :, 1:]
    both = np.matmul(form.derivatives[1:3, None], pieces)  # (2, c, n, K - 1)
    pairs = products(lattice, form.degree)

    def jacobian(a: int, b: int) -> Array:
        """Coefficients of that of two eigenfunctions, on all pieces."""
        (A, B), (C, D) = both[..., a], both[..., b]
        cross = A[:, :, None] * D[:, None] - B[:, :, None] * C[:, None]
        return np.asarray(cross.reshape(len(cross), -1) @ pairs).ravel()

    leads = jacobian(*pair.tolist())
    turn = float(np.sign(leads.sum()))
    if not (turn * leads).min() > 0:
        return None
    plain = np.setdiff1d(others, linked)
    plain = plain[table.rates[0, plain] > 0] - 1
    plain = plain[np.argsort(-rates[1 + plain], kind="stable")]
    most = np.abs(both).max(axis=(1, 2))
    rest = most.copy()
    rest[:, pair] = 0
    crossed = np.zeros((2, len(leads), len(plain)))
    for k, lead in enumerate(pair.tolist()):
        for j, other in enumerate(plain.tolist()):
            crossed[k, :, j] = jacobian(lead, other)
    steps = both[..., plain].reshape(2, -1, len(plain))
    return _Leading(pair, turn, turn * leads, most[:, pair], plain, steps, crossed, rest)
