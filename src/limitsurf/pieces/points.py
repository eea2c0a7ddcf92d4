"""Bernstein coefficients of cells and hulls of what remains, from control points."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import rings, tables
from limitsurf._kernels import reference as kernels
from limitsurf.patches import REGULAR, STRIP
from limitsurf.pieces import weights
from limitsurf.pieces.cover import Group
from limitsurf.values import Values, exact_control_points, repeated

Array = NDArray[Any]

_EPS = np.finfo(float).eps


class FloatPoints:
    """Coefficients from float64 points (n_vertices, d) of the cage.

    Differences from a control point are formed first, so that no digits are lost far from the
    origin. Points are multiplied by a power of two where their sums might overflow.
    """

    dtype = np.dtype(float)

    def __init__(
        self, local: weights.LocalWeights, points: Array, values: Values | None = None
    ) -> None:
        self.local, self._patches, self._form = local, local.patches, local.bernstein
        self.values = Values(self._patches, points) if values is None else values
        self._high, self._low = self.values.control_points

    def coefficients(self, group: Group, part: slice) -> Array:
        """Coefficients (p, c, n, d) of some patches of a group, in their parameters."""
        kind, rows = group.kind, group.rows[part]
        if kind in self._patches.rings:
            found = self.on_rings(kind, rows, range(group.count))
            found += self.corner(kind, rows)[1][:, None, None]
            found += self.corner(kind, rows)[0][:, None, None]
        elif kind in (REGULAR, STRIP):
            ((_, ids, local),) = self.local.of(group, part)
            near = self._form.near if kind == REGULAR else 5  # (of four times four)
            high, low, points = self.values.differences(ids, near)
            found = np.matmul(local, points[:, None])
            flat = found.reshape(len(rows), -1)
            places = repeated(found.shape[1] * self._form.size, found.shape[3])
            for step in (low, high) if low.any() else (high,):
                flat += np.take(step, places, axis=1, mode="clip")
        else:
            sector = self._patches.sectors[kind]
            assert sector is not None
            table = tables.eigen_table(self.local.scheme, sector)
            high, low, points = self.values.differences(self._patches.controls[kind][rows], 0)
            modes = table.coefficients(points)
            found = np.matmul(weights.ring_functions(table, group.count), modes[:, 1:])
            for step in (modes[:, 0], low, high):
                found += step[:, None]
            found = found.reshape(len(rows), -1, self._form.size, found.shape[2])
        return np.ldexp(found, -self.values.balance) if self.values.balance else np.asarray(found)

    def hull(self, group: Group) -> tuple[Array, Array]:
        """Bounds (P, d) of what is beyond the rings of special patches, -inf and inf if unknown."""
        kind, rows = group.kind, group.rows
        ids = self._patches.control_points(kind, rows)
        high, low, points = self.values.differences(ids, 0)
        size = np.abs(points).max(axis=1)
        # sums of K products at each step, of numbers that sum to one; and what made the points
        terms = (group.count + weights.AHEAD + 4) * (ids.shape[1] + 2)
        error = terms * _EPS * size + kernels.NOISE * self.values.errors[ids].max(axis=1)
        least, most = np.full((2, *size.shape), [[[-np.inf]], [[np.inf]]])
        if kind in self._patches.rings:
            if rings.is_convex(self.local.masks(kind)):
                least, most = self._beyond(kind, rows, group.count)
                high, low = self.corner(kind, rows)
        else:
            ((*_, table),) = self.local.sectors(kind, rows)
            hull = weights.hull_weights(self.local.scheme, table, group.count, False)
            if hull is not None:
                found = np.matmul(hull, points)
                least, most = found.min(axis=1), found.max(axis=1)
            else:
                least, most = self._spectral_bounds(kind, points, group.count)
        with np.errstate(invalid="ignore"):
            least = np.nextafter(high + (low + least - error), -np.inf)
            most = np.nextafter(high + (low + most + error), np.inf)
        return np.ldexp(least, -self.values.balance), np.ldexp(most, -self.values.balance)

    def _spectral_bounds(self, kind: int, points: Array, count: int) -> tuple[Array, Array]:
        """Bounds (P, d) of what is beyond some rings, from sizes of all eigenfunctions there."""
        sector = self._patches.sectors[kind]
        assert sector is not None
        table = tables.eigen_table(self.local.scheme, sector)
        modes, most = table.coefficients(points), weights.most_beyond(table, count)
        added = [table.coefficient_sizes(x) for x in np.moveaxis(np.abs(points), 2, 0)]
        sizes = np.abs(modes) + kernels.NOISE * np.stack(added, axis=2)
        reach = np.einsum("k,pkd->pd", most, sizes[:, 1:]) + kernels.NOISE * sizes[:, 0]
        limit: Array = modes[:, 0]
        return limit - reach, limit + reach

    # ------------------------------------------------------------------ shared rings

    def shared(self, kind: int) -> rings.RingValues:
        """Values around the shared rings of a kind."""
        known = self._patches.rings[kind], self._patches.controls[kind]
        return self.values.around(self.local.masks(kind), *known)

    def corner(self, kind: int, rows: Array) -> tuple[Array, Array]:
        """Limits of the special corners of patches, high and low, (P, d) each."""
        shared = self._patches.rings[kind]
        vertex = shared.points[shared.ring[rows], 0]
        return self._high[vertex], self._low[vertex] + self.shared(kind).limits(rows)

    def on_rings(self, kind: int, rows: Array, levels: range) -> Array:
        """Coefficients (P, 3 levels, n, d) on some rings, relative to the limit of the corner."""
        level = np.tile(np.array(levels, dtype=np.int64), len(rows))
        found = self.on_ring(kind, np.repeat(rows, len(levels)), level)
        return found.reshape(len(rows), -1, *found.shape[2:])

    def on_ring(self, kind: int, rows: Array, level: Array) -> Array:
        """Coefficients (P, 3, n, d) on a ring of each, relative to the limit of the corner."""
        fine = self.shared(kind).refined(rows, level)
        lattice = self.local.scheme.lattice
        i, j = np.array([[piece.place(x) for x in lattice.template] for piece in lattice.pieces]).T
        points = fine[:, j.T, i.T]  # (P, 3, K, d)
        return np.asarray(np.matmul(self._form.from_controls, points))

    def _beyond(self, kind: int, rows: Array, count: int) -> tuple[Array, Array]:
        """Bounds (P, d) of what is beyond some rings, relative to the limit of the corner."""
        last = count + weights.AHEAD
        found = self.on_rings(kind, rows, range(count, last))
        points = found.reshape(len(rows), -1, found.shape[3])
        least, most = self.shared(kind).extent(rows, last)
        return np.minimum(points.min(axis=1), least), np.maximum(points.max(axis=1), most)


class ExactPoints:
    """Bernstein coefficients from Fractions (n_vertices, d)."""

    dtype = np.dtype(object)

    def __init__(self, local: weights.LocalWeights, points: Array) -> None:
        self.local = local
        self._points = exact_control_points(local.patches, points)

    def coefficients(self, group: Group, part: slice) -> Array:
        """Coefficients (p, c, n, d) of some patches of a group, in their parameters."""
        n = self.local.bernstein.size
        shape = len(group.rows[part]), len(group.origin), n, self._points.shape[1]
        found = np.empty(shape, dtype=object)
        begin = part.indices(len(group.rows))[0]
        for here, ids, local in self.local.of(group, part):
            product = weights.products(local, self._points[ids][:, None])
            found[here - begin] = weights.fractions(*product)
        return found

    def hull(self, group: Group) -> tuple[Array, Array]:
        """Bounds (P, d) of what is beyond the rings of special patches, -inf and inf if unknown."""
        ids = self.local.patches.control_points(group.kind, group.rows)
        least, most = np.full((2, len(ids), self._points.shape[1]), np.inf, dtype=object)
        least[:] = -np.inf
        for here, columns, table in self.local.sectors(group.kind, group.rows):
            hull = weights.hull_weights(self.local.scheme, table, group.count, True)
            if hull is not None:
                found, unit = weights.products(hull, self._points[ids[here][:, columns]])
                for bound, extreme in ((least, found.min(axis=1)), (most, found.max(axis=1))):
                    bound[here] = weights.fractions(extreme, unit[:, 0])
        return least, most
