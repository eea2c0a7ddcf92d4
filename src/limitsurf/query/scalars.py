"""Functions on a surface whose level sets are sought, in Bernstein form on each of its cells."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from limitsurf.engine.packing import one_by_one
from limitsurf.pieces.beyond import Beyond, RingCells
from limitsurf.pieces.cells import cut
from limitsurf.query.index import RINGS, Cells
from limitsurf.query.polynomials import Form, products
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_AT_ONCE = 1 << 12  # cells whose products of coefficients are in memory at once


class Scalar(Protocol):
    """A function on a surface, about 1 in size, that is a polynomial on each cell."""

    form: Form

    def of_cells(self) -> Array:
        """Coefficients on all cells, (C, m)."""

    def of_rings(self, which: Array, ring: Array, found: RingCells) -> Array:
        """Coefficients (M, c, m) on the cells that make a ring (M,) around corners (M,)."""

    def at_corners(self, which: Array) -> Array:
        """Values at special corners, (M,)."""

    def reach(self, which: Array, ring: Array) -> Array:
        """Bounds (M,) of how far values go from that at the corner, from a ring on."""


class Height:
    """The inner product with a vector (3,), of places in the unit of the index."""

    def __init__(self, cells: Cells, toward: Array) -> None:
        self.form, self._cells, self._toward = cells.form, cells, toward

    def of_cells(self) -> Array:
        return np.asarray(self._cells.points @ self._toward)

    def of_rings(self, which: Array, ring: Array, found: RingCells) -> Array:
        return np.asarray(found.points @ self._toward + self.at_corners(which)[:, None, None])

    def at_corners(self, which: Array) -> Array:
        return np.asarray(self._cells.beyond.limits[which] @ self._toward)

    def reach(self, which: Array, ring: Array) -> Array:
        toward = np.broadcast_to(self._toward, (len(which), 3))
        return self._cells.beyond.reach(which, ring, toward)[1]


class SquaredDistance:
    """The squared distance from a point (3,) in the unit of the index, times a factor."""

    def __init__(self, cells: Cells, point: Array, factor: float) -> None:
        self.form = Form.of(cells.lattice, 2 * cells.form.degree)
        self._means = products(cells.lattice, cells.form.degree)
        self._cells, self._point, self._factor = cells, point, factor

    def _squares(self, points: Array) -> Array:
        """Coefficients (n, m) of the squared lengths of polynomials (n, k, 3)."""
        found = np.empty((len(points), self.form.size))
        for start in range(0, len(points), _AT_ONCE):
            some = points[start : start + _AT_ONCE]
            gram = np.matmul(some, some.swapaxes(1, 2)).reshape(len(some), -1)
            found[start : start + _AT_ONCE] = gram @ self._means
        return found * self._factor

    def of_cells(self) -> Array:
        return self._squares(self._cells.points - self._point)

    def of_rings(self, which: Array, ring: Array, found: RingCells) -> Array:
        base = self._cells.beyond.limits[which] - self._point
        points = (found.points + base[:, None, None]).reshape(-1, *found.points.shape[2:])
        return self._squares(points).reshape(*found.points.shape[:2], -1)

    def at_corners(self, which: Array) -> Array:
        base = self._cells.beyond.limits[which] - self._point
        return np.asarray((base**2).sum(axis=1) * self._factor)

    def reach(self, which: Array, ring: Array) -> Array:
        base = self._cells.beyond.limits[which] - self._point
        far, along = self._cells.beyond.reach(which, ring, base)
        return np.asarray((2 * along + far**2) * self._factor)


class Subdivided:
    """Values (n_vertices,) of the cage, subdivided as its points are."""

    def __init__(self, surface: LimitSurface, cells: Cells, values: Array, workers: int) -> None:
        topology = surface.topology
        self.form = cells.form
        faces = np.arange(len(surface.limit_faces))
        depth = RINGS - (surface.limit_faces.corner >= 0)
        known = topology.patches, topology.rules.scheme, values[:, None], faces, depth
        found = cut(*known, False, one_by_one(workers))
        self._values = found.points.reshape(len(found), self.form.size)
        self._beyond = Beyond(*known)

    def of_cells(self) -> Array:
        return self._values

    def of_rings(self, which: Array, ring: Array, found: RingCells) -> Array:
        own = self._beyond.cells(which, ring).points[..., 0]
        return np.asarray(own + self.at_corners(which)[:, None, None])

    def at_corners(self, which: Array) -> Array:
        return np.asarray(self._beyond.limits[which, 0])

    def reach(self, which: Array, ring: Array) -> Array:
        return self._beyond.reach(which, ring, np.ones((len(which), 1)))[1]
