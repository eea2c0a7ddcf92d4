"""Cones that hold the normals of a surface, and how far triangles turn from these.

Cross products of derivatives are polynomials: their directions are means of those of Bernstein
coefficients. ``derivations/tessellation.py`` has the bounds.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.pieces import weights
from limitsurf.pieces.bernstein import Bernstein
from limitsurf.query.chords import length, triangles_error, ways
from limitsurf.query.polynomials import Form, products
from limitsurf.query.wanted import LOST

if TYPE_CHECKING:
    from limitsurf.pieces.beyond import Beyond
    from limitsurf.scheme.lattice import Lattice
    from limitsurf.tables import EigenTable

Array = NDArray[Any]

# by which normals differ that are welded, and more
WELDED = 2e-6


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


def crossed(form: Form, pairs: Array, points: Array) -> tuple[Array, Array]:
    """Coefficients (L, m, 3) of cross products of derivatives, and what rounding takes, (L,)."""
    n = form.size
    both = np.matmul(form.derivatives[1:3].reshape(2 * n, n), points)
    return cross_products(pairs, both[:, :n], both[:, n:])


def cross_products(pairs: Array, du: Array, dv: Array) -> tuple[Array, Array]:
    """The same of polynomials (L, n, 3), of one degree."""
    found = np.empty((len(du), pairs.shape[1], 3))
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        one = np.matmul(du[:, :, None, i], dv[:, None, :, j])
        one -= np.matmul(du[:, :, None, j], dv[:, None, :, i])
        found[:, :, k] = one.reshape(len(du), -1) @ pairs
    size = length(du).max(axis=1) + length(dv).max(axis=1)
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
def normal_form(lattice: Lattice, degree: int) -> tuple[Form, Array]:
    """The form of products of polynomials of a degree, and `products`."""
    return Form.of(lattice, 2 * degree), products(lattice, degree)


@dataclass(frozen=True, eq=False)
class _Leading:
    """What the normals around a special corner tend to, whatever the control points.

    Attributes
    ----------
    pair : (2,)
        The eigenfunctions that lead, counted without the constant one.
    turn : float
        The sign of their Jacobian.
    least : float
        A bound from below of its size, on the first ring.
    most : (2, 2)
        Bounds of their derivatives, by direction and eigenfunction.
    rest : (2, K - 1)
        Bounds of those of others, by direction; 0 for both that lead.
    """

    pair: Array
    turn: float
    least: float
    most: Array
    rest: Array


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
    a, b = leading.pair.tolist()
    one, other = modes[:, a], modes[:, b]
    sizes = length(modes)
    rates = np.abs(table.rates[0, 1 + leading.pair])
    # others against either that leads, by direction: they fall from ring to ring
    by_one, by_other = (sizes @ (leading.rest @ weights.growth(table, level, r)).T for r in rates)
    A, B = sizes[:, [a]] * leading.most[:, 0], sizes[:, [b]] * leading.most[:, 1]
    # of both directions, along s and along t
    off = A[:, 0] * by_other[:, 1] + by_other[:, 0] * A[:, 1]
    off += B[:, 0] * by_one[:, 1] + by_one[:, 0] * B[:, 1]
    off += by_one[:, 0] * by_other[:, 1]
    normal = np.cross(one, other) * leading.turn
    size = length(normal)
    noise = 8 * LOST * (sizes[:, a] + sizes[:, b])
    with np.errstate(divide="ignore", invalid="ignore"):
        wide = _arcsin(off * (1 + 1e-9), size * leading.least) + _arcsin(noise, size)
        return normal / size[:, None], np.minimum(wide, np.pi)


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
    (A, B), (C, D) = (np.moveaxis(x[:, :, pair], 2, 0) for x in both)
    cross = A[:, :, None] * D[:, None] - C[:, :, None] * B[:, None]
    jacobian = cross.reshape(len(cross), -1) @ normal_form(lattice, form.degree)[1]
    turn = float(np.sign(jacobian.sum()))
    least = float((turn * jacobian).min())
    if not least > 0:
        return None
    most = np.abs(both).max(axis=(1, 2))
    rest = most.copy()
    rest[:, pair] = 0
    return _Leading(pair, turn, least, most[:, pair], rest)
