"""Functions of the normals of a surface, in Bernstein form on each of its cells.

All are of ``d/ds x d/dt``, which is not of unit length: it is a polynomial, and along the normal.
Its length jumps between cells, which signs do not know of. So each cell has a factor of its own, by
which rounding errors are about those of `scalars`, whatever its size.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from limitsurf import basis
from limitsurf.pieces import weights
from limitsurf.pieces.beyond import RingCells
from limitsurf.query.index import Cells
from limitsurf.query.polynomials import Form, products
from limitsurf.query.scalars import Scalar
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_AT_ONCE = 1 << 10  # cells whose products of coefficients are in memory at once
_ROUNDING = 2.0**-44  # what of a unit normal is taken for 0


class OfNormals(Scalar, Protocol):
    """A function that jumps where normals do; its level is 0.

    It is `odd` if it changes its sign with the normals.
    """

    odd: bool

    def at_places(self, surface: LimitSurface, face: Array, uv: Array) -> tuple[Array, Array]:
        """Whether it is above there, (n,), and whether there is a normal, (n,)."""

    def counts(self, surface: LimitSurface, face: Array, uv: Array) -> Array:
        """Whether what is 0 there is of the level set that is sought, (n,)."""


class _Products:
    """Coefficients (n, m, 3) of the normals of cells (n, k, 3), by factors (n,)."""

    def __init__(self, cells: Cells) -> None:
        self.form = Form.of(cells.lattice, 2 * cells.form.degree)
        self._cells = cells
        self._means = products(cells.lattice, cells.form.degree)

    def slopes(self, points: Array) -> Array:
        """Coefficients of d/ds and d/dt, (2, n, k, 3)."""
        return np.asarray(np.matmul(self._cells.form.derivatives[1:3, None], points))

    def of(self, points: Array, size: Array) -> Array:
        """Of cells, the errors of whose points are those of places of some size (n,)."""
        s, t = self.slopes(points)
        found = np.empty((len(points), self.form.size, 3))
        for axis in range(3):
            b, c = (axis + 1) % 3, (axis + 2) % 3
            both = s[:, :, None, b] * t[:, None, :, c] - s[:, :, None, c] * t[:, None, :, b]
            found[:, :, axis] = both.reshape(len(points), -1) @ self._means
        return found * _factor(s, t, size)[:, None, None]


def _factor(s: Array, t: Array, size: Array) -> Array:
    """What products of such slopes (n, k, 3) are multiplied by, (n,)."""
    most = [np.sqrt((x**2).sum(axis=2)).max(axis=1, initial=0) for x in (s, t)]
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        # the products are 1 at most, and their errors some roundings of 1
        found = np.minimum(1 / (most[0] * most[1]), 1 / (4 * size * (most[0] + most[1])))
    return np.where(np.isfinite(found), found, 0.0)


class _Poles:
    """What normals are near special corners, after what scales them is taken out.

    With ``a`` and ``b`` the vectors of the two leading eigenfunctions, normals are there
    ``J (a x b)`` up to an error, with ``low <= J <= high``: ``derivations/silhouettes.py``.

    Attributes
    ----------
    normal : (R, 3)
        ``a x b`` of a length of at most 1, or 0 where there is no normal.
    low, high : (R,)
    """

    def __init__(self, cells: Cells) -> None:
        count = len(cells.beyond)
        self._beyond = cells.beyond
        self.normal, self.low, self.high = np.zeros((count, 3)), np.zeros(count), np.zeros(count)
        self._groups: list[tuple[Array, Any]] = []
        self._group = np.full(count, -1)
        for here, table, start, modes in cells.beyond.eigenfunctions():
            if table is None or not self._plain(table):
                continue
            first = weights.ring_functions(table, 1)
            functions = basis.on_rings(table, first, np.zeros(len(first), dtype=np.int64))
            self._begin(cells, here, table, start, modes, functions)

    @staticmethod
    def _plain(table: Any) -> bool:
        """Whether the leading two are multiplied by their eigenvalues, and by nothing else."""
        heads = np.concatenate([table.chains, table.chains - 1])
        return len(table.normal) == 2 and not np.isin(table.normal, heads).any()

    def _begin(
        self, cells: Cells, here: Array, table: Any, start: int, modes: Array, functions: Array
    ) -> None:
        pair = table.normal - 1
        form, k = cells.form, functions.shape[1]
        each = functions.reshape(-1, form.size, k)
        slopes = np.matmul(form.derivatives[1:3, None], each)  # (2, c, n, K - 1)
        (a_s, b_s), (a_t, b_t) = slopes[0][..., pair].T, slopes[1][..., pair].T
        both = a_s.T[:, :, None] * b_t.T[:, None] - b_s.T[:, :, None] * a_t.T[:, None]
        jacobian = both.reshape(len(each), -1) @ products(cells.lattice, form.degree)
        if not jacobian.min() > 0:
            return
        length = np.sqrt((modes**2).sum(axis=2))  # (m, K - 1)
        most = np.abs(slopes).max(axis=(0, 1, 2))
        # what the leading two give at most, and what is left
        size = length[:, pair] @ most[pair]
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = np.where(size > 0, 1 / size, 0.0)
        a, b = (modes[:, p] * scale[:, None] for p in pair)
        self.normal[here] = np.cross(a, b)
        self.low[here], self.high[here] = jacobian.min(), jacobian.max()
        rest = np.ones(k, dtype=bool)
        rest[pair] = False
        self._group[here] = len(self._groups)
        scaled = length * scale[:, None]
        known = here, (table, start, scaled, most, rest, float(table.rates[0, table.normal].min()))
        self._groups.append(known)

    def error(self, which: Array, ring: Array) -> Array:
        """Bounds (M,) of what normals are off ``J (a x b)`` from a ring on; inf if unknown."""
        found = np.full(len(which), np.inf)
        place = np.zeros(len(self._group), dtype=np.int64)
        for number, (members, known) in enumerate(self._groups):
            place[members] = np.arange(len(members))
            here = np.flatnonzero(self._group[which] == number)
            table, start, scaled, most, rest, least = known
            for one in np.unique(ring[here]).tolist():
                some = here[ring[here] == one]
                grown = most @ _relative_growth(table, start + one, least)
                left = scaled[place[which[some]]][:, rest] @ grown[rest]
                # (the leading two are 1 at most)
                found[some] = (2 * left + left**2) * (1 + 1e-9)
        return found


def _relative_growth(table: Any, count: int, least: float) -> Array:
    """As `weights.growth`, of the powers of J over those of a rate."""
    rate = np.abs(table.rates[0, 1:]) / least
    heads, first = table.chains - 1, table.pairs - 1
    found = np.diag(rate**count)
    found[first + 1, first] = found[first, first + 1] = rate[first] ** count
    own = rate[heads]
    with np.errstate(divide="ignore", invalid="ignore"):
        n = np.where(own < 1, np.maximum(count, -1 / np.log(own)), np.inf)
        found[heads - 1, heads] = np.where(own > 0, n * own ** (n - 1) / least, 0.0)
    return np.asarray(np.nan_to_num(found, nan=np.inf))


class Facing:
    """The inner product of normals with a direction (3,), or that towards an eye (3,).

    In the unit of the index; eyes and directions are about 1 in size.
    """

    odd = True

    def __init__(self, cells: Cells, toward: Array, perspective: bool) -> None:
        self._cells, self._toward, self._perspective = cells, toward, perspective
        self._normals, self._poles = _Products(cells), _Poles(cells)
        degree = cells.form.degree
        self.form = self._normals.form
        self._factor = 1 / (1 + np.sqrt((toward**2).sum())) if perspective else 1.0
        if perspective:
            self.form = Form.of(cells.lattice, 3 * degree)
            self._means = products(cells.lattice, 2 * degree, degree)

    def _of(self, points: Array, base: Array, size: Array) -> Array:
        """Coefficients on cells (n, k, 3), relative to places (n, 3)."""
        found = np.empty((len(points), self.form.size))
        for start in range(0, len(points), _AT_ONCE):
            part = slice(start, start + _AT_ONCE)
            normals = self._normals.of(points[part], size[part])
            if not self._perspective:
                found[part] = normals @ self._toward
                continue
            view = (self._toward - base[part, None] - points[part]) * self._factor
            gram = np.matmul(normals, view.swapaxes(1, 2))
            found[part] = gram.reshape(len(gram), -1) @ self._means
        return found

    def of_cells(self) -> Array:
        points = self._cells.points
        return self._of(points, np.zeros((len(points), 3)), np.ones(len(points)))

    def of_rings(self, which: Array, ring: Array, found: RingCells) -> Array:
        points, base, size = _of_rings(self._cells, which, found)
        return self._of(points, base, size).reshape(*found.points.shape[:2], -1)

    def _view(self, which: Array) -> Array:
        limits = self._cells.beyond.limits[which]
        view = (self._toward - limits) if self._perspective else self._toward
        return np.broadcast_to(view * self._factor, limits.shape)

    def at_corners(self, which: Array) -> Array:
        poles = self._poles
        product = (poles.normal[which] * self._view(which)).sum(axis=1)
        return np.asarray(product * poles.low[which])

    def reach(self, which: Array, ring: Array) -> Array:
        poles, view = self._poles, self._view(which)
        error = poles.error(which, ring)
        found = error * np.sqrt((view**2).sum(axis=1))
        if self._perspective:
            far, _ = self._cells.beyond.reach(which, ring, view)
            length = np.sqrt((poles.normal[which] ** 2).sum(axis=1))
            with np.errstate(invalid="ignore"):
                found += (length * poles.high[which] + error) * far * self._factor
        return np.where(np.isfinite(error), found, np.inf)

    def at_places(self, surface: LimitSurface, face: Array, uv: Array) -> tuple[Array, Array]:
        normal = surface.normal(face, *uv.T)
        view = np.broadcast_to(self._toward, normal.shape)
        if self._perspective:
            view = self._toward - np.ldexp(surface.evaluate(face, *uv.T), self._cells.power)
        value = (normal * view).sum(axis=1)
        size = np.sqrt((view**2).sum(axis=1))
        return value >= -_ROUNDING * size, np.isfinite(value)

    def counts(self, surface: LimitSurface, face: Array, uv: Array) -> Array:
        return np.ones(len(face), dtype=bool)


class Angle:
    """The squared inner product of normals with a unit vector (3,), less a part of their square.

    It is 0 at an angle from the vector and at another, 180 degrees less that; those of the first
    count, which is less than 90 degrees.
    """

    odd = False

    def __init__(self, cells: Cells, toward: Array, cosine: float) -> None:
        self._cells, self._toward, self._cosine = cells, toward, cosine
        self._normals, self._poles = _Products(cells), _Poles(cells)
        degree = 2 * cells.form.degree
        self.form = Form.of(cells.lattice, 2 * degree)
        self._means = products(cells.lattice, degree)
        self._square = np.outer(toward, toward) - cosine**2 * np.eye(3)

    def _of(self, points: Array, size: Array) -> Array:
        found = np.empty((len(points), self.form.size))
        for start in range(0, len(points), _AT_ONCE // 4):
            part = slice(start, start + _AT_ONCE // 4)
            normals = self._normals.of(points[part], size[part])
            gram = np.matmul(normals @ self._square, normals.swapaxes(1, 2))
            most = np.abs(normals).max(axis=(1, 2))
            gram = gram.reshape(len(gram), -1) @ self._means
            found[part] = gram / np.where(most > 0, 4 * most, 1.0)[:, None]
        return found

    def of_cells(self) -> Array:
        return self._of(self._cells.points, np.ones(len(self._cells.points)))

    def of_rings(self, which: Array, ring: Array, found: RingCells) -> Array:
        points, _, size = _of_rings(self._cells, which, found)
        return self._of(points, size).reshape(*found.points.shape[:2], -1)

    def at_corners(self, which: Array) -> Array:
        normal = self._poles.normal[which]
        value = ((normal @ self._square) * normal).sum(axis=1)
        return np.asarray(value * self._poles.low[which] ** 2)

    def reach(self, which: Array, ring: Array) -> Array:
        poles = self._poles
        error = poles.error(which, ring)
        length = np.sqrt((poles.normal[which] ** 2).sum(axis=1))
        with np.errstate(invalid="ignore"):
            found = (2 * length * poles.high[which] * error + error**2) * 1.01
        return np.where(np.isfinite(error), found, np.inf)

    def _at(self, surface: LimitSurface, face: Array, uv: Array) -> Array:
        return np.asarray(surface.normal(face, *uv.T) @ self._toward)

    def at_places(self, surface: LimitSurface, face: Array, uv: Array) -> tuple[Array, Array]:
        value = self._at(surface, face, uv)
        return value >= self._cosine - _ROUNDING, np.isfinite(value)

    def counts(self, surface: LimitSurface, face: Array, uv: Array) -> Array:
        return np.asarray(self._at(surface, face, uv) > 0)


def _of_rings(cells: Cells, which: Array, found: RingCells) -> tuple[Array, Array, Array]:
    """Points (n, k, 3) of cells on rings relative to their corners, these, and sizes (n,)."""
    points = found.points.reshape(-1, *found.points.shape[2:])
    size = np.abs(found.points).max(axis=(1, 2, 3), initial=0)
    count = found.points.shape[1]
    return points, np.repeat(cells.beyond.limits[which], count, axis=0), np.repeat(size, count)
