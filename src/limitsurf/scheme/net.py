"""The domain of limit faces, cut evenly into polygons."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.caching import cached_property
from limitsurf.scheme.lattice import Lattice

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Net:
    """The domain of limit faces, each edge of it cut into n segments; rows (v) come in turn.

    Attributes
    ----------
    lattice : Lattice
    n : int

    Examples
    --------
    >>> from limitsurf.scheme.net import Net
    >>> from limitsurf.scheme.lattice import TRIANGLES
    >>> net = Net(TRIANGLES, 2)
    >>> net.cells.tolist()
    [[0, 1, 3], [4, 3, 1], [1, 2, 4], [3, 4, 5]]
    >>> net.sides.tolist(), net.inner.tolist()
    ([[0, 1, 2], [2, 4, 5], [5, 3, 0]], [])
    """

    lattice: Lattice
    n: int

    @cached_property
    def steps(self) -> tuple[Array, Array]:
        """How many n-th parts of 1 the u and v of each point are, (W,) int."""
        v, u = (x.ravel() for x in np.indices((self.n + 1, self.n + 1)))
        there = self._inside(u, v)
        return u[there], v[there]

    @cached_property
    def places(self) -> tuple[Array, Array]:
        """The u and v of each point, (W,)."""
        u, v = (x / self.n for x in self.steps)
        if self.lattice.sloped:
            # on the edge u + v = 1 exactly: what is left of the larger one has all its digits
            edge = self.sides[1]
            u[edge], v[edge] = (
                np.where(x < y, 1 - y, x) for x, y in ((u[edge], v[edge]), (v[edge], u[edge]))
            )
        return u, v

    @cached_property
    def cells(self) -> Array:
        """The points of the polygons between them, (m, face_size)."""
        u, v = (x[:, None, None] for x in self.steps)
        cells = np.array(self.lattice.cells)  # (k, face_size, 2)
        u, v = u + cells[..., 0], v + cells[..., 1]  # (W, k, face_size)
        complete = self._inside(u, v).all(axis=2)
        return self._numbers(u[complete], v[complete])

    @cached_property
    def sides(self) -> Array:
        """The points of each side, from its corner on to the next: (face_size, n + 1)."""
        start = np.array(self.lattice.corners)
        along = np.roll(start, -1, axis=0) - start
        u, v = (
            self.n * start[:, k, None] + along[:, k, None] * np.arange(self.n + 1) for k in (0, 1)
        )
        return self._numbers(u, v)

    @cached_property
    def rim(self) -> Array:
        """The points on sides."""
        return np.unique(self.sides)

    @cached_property
    def inner(self) -> Array:
        """The others."""
        return np.setdiff1d(np.arange(len(self.steps[0])), self.rim)

    def _inside(self, u: Array, v: Array) -> Array:
        """Whether steps are within the domain."""
        edges = ((self.n * a, b, c) for a, b, c in self.lattice.edges)
        return np.asarray(np.all([a + b * u + c * v >= 0 for a, b, c in edges], axis=0))

    def _numbers(self, u: Array, v: Array) -> Array:
        """The numbers of points with so many steps."""
        # each row of a sloped domain is shorter by one than that before
        return np.asarray(v * (self.n + 1) - (v * (v - 1) // 2 if self.lattice.sloped else 0) + u)
