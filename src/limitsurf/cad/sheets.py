"""Sides of B-spline faces: their curves, ends, lengths, and gaps between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cad.boundary import Boundary
from limitsurf.cad.bspline import BSplineFaces

Array = NDArray[Any]

_LEAST = 1e-7  # below it, OpenCASCADE takes points to be the same
_SHARE = 1e-9  # of the size of a surface, where that is less
_FLAT = 1e-12  # of the size of a face: what is no wider is a curve
_NAMED = 20  # faces that a message names


@dataclass(frozen=True, eq=False)
class Sheets:
    """B-spline faces, flat arrays, in the unit of a shape.

    Sides are numbered as in `Boundary`; of triangles the one from (1, 0) to (0, 1) is 1, the others
    are those of v = 0 and of u = 0.

    Attributes
    ----------
    splines : BSplineFaces
    factor : float
        Units of the shape in one of the surface.
    points : (m, 3)
        Control points in the unit of the shape.
    first : (n,)
        Where those of each face begin.
    first_knot : ((n,), (n,))
        Where knots along u and along v begin.
    least : float
        The smallest tolerance.
    """

    splines: BSplineFaces
    factor: float
    points: Array
    first: Array
    first_knot: tuple[Array, Array]
    least: float

    @classmethod
    def of(cls, splines: BSplineFaces, factor: float) -> Sheets:
        """Those of a surface, with so many units of the shape in one of its own."""
        sizes = splines.counts.prod(axis=1)
        length = splines.counts + np.array(splines.degree) + 1
        first = np.cumsum(length, axis=0) - length
        points = splines.points * factor
        size = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
        least = min(_LEAST, _SHARE * size) if size else _LEAST
        at = np.cumsum(sizes) - sizes
        return cls(splines, factor, points, at, (first[:, 0], first[:, 1]), least)

    @property
    def triangles(self) -> bool:
        """Whether faces are the lower halves of squares."""
        return self.splines.trims is not None

    def net(self, face: int) -> Array:
        """Control points (nu, nv, 3) of a face."""
        nu, nv = self.splines.counts[face].tolist()
        return self.points[self.first[face] : self.first[face] + nu * nv].reshape(nu, nv, 3)

    def knots(self, face: int, way: int) -> Array:
        """Knots of a face along u (0) or v (1)."""
        splines = self.splines
        begin = self.first_knot[way][face]
        end = begin + splines.counts[face, way] + splines.degree[way] + 1
        return np.asarray((splines.knots_u, splines.knots_v)[way][begin:end])

    def curve(self, face: int, side: int) -> tuple[Array, Array, int]:
        """Control points (k, 3), knots and degree of a side, by growing parameters."""
        net = self.net(face)
        if self.triangles and side == 1:
            return self._slope(net), self.knots(face, 0), self.splines.degree[0]
        way = self.way(side)
        rows = (net[:, 0], net[-1], net[:, -1], net[0])
        row = net[0] if self.triangles and side == 2 else rows[side]
        return row, self.knots(face, way), self.splines.degree[way]

    def way(self, side: Any) -> Any:
        """Along which of u (0) and v (1) a side is."""
        return (side > 0) * 1 if self.triangles else side % 2

    def _slope(self, net: Array) -> Array:
        """Control points of the curve on the diagonal, of the degree that the triangle has."""
        p = self.splines.degree[0]
        t = np.arange(p + 1) / p
        basis = _bernstein(p, t)
        points = np.einsum("ti,tj,ijk->tk", _bernstein(p, 1 - t), basis, net)
        return np.asarray(np.linalg.solve(basis, points))

    def place(self, face: Array, side: Array, x: Array) -> tuple[Array, Array]:
        """U and v at parameters along sides."""
        if self.triangles:
            return np.choose(side, [x, 1 - x, 0 * x]), np.choose(side, [0 * x, x, x])
        u, v = self.splines.grid[face].T.astype(float)
        return np.choose(side, [x, u, x, 0 * x]), np.choose(side, [0 * x, x, v, x])

    def along(self, face: Array, side: Array, x: Array) -> Array:
        """Points (..., 3) at parameters along sides."""
        return np.asarray(self.factor * self.splines.evaluate(face, *self.place(face, side, x)))

    def _inner(self, boundary: Boundary, use: Array) -> tuple[Array, Array]:
        """Parameters of uses at their ends, at knots, and between these; and whose each is."""
        splines = self.splines
        face, way = boundary.face[use], self.way(boundary.side[use])
        length = splines.counts[face, way] + np.array(splines.degree)[way]  # spans of knots
        owner = np.repeat(np.arange(len(use)), length)
        step = np.arange(len(owner)) - np.repeat(np.cumsum(length) - length, length)
        begin = np.where(way == 0, self.first_knot[0][face], self.first_knot[1][face])[owner] + step
        knots = splines.knots_u, splines.knots_v
        # (the knots of the other direction are no places of these, and not used)
        a, b = (
            np.where(
                way[owner] == 0,
                knots[0][np.minimum(at, len(knots[0]) - 1)],
                knots[1][np.minimum(at, len(knots[1]) - 1)],
            )
            for at in (begin, begin + 1)
        )
        full = b > a
        a, b, owner = a[full], b[full], owner[full]
        x = a[:, None] + (b - a)[:, None] * np.array([0.0, 1 / 3, 2 / 3, 1.0])
        owner = np.repeat(owner, x.shape[1])
        low, high = boundary.low[use][owner], boundary.high[use][owner]
        return np.clip(x.ravel(), low, high), owner

    def gaps(self, boundary: Boundary) -> Array:
        """The largest distance (E,) found between the first face at each edge and the other."""
        lead = boundary.first[boundary.edge]
        use = np.flatnonzero(lead != np.arange(len(lead)))
        first = lead[use]
        x, owner = self._inner(boundary, first)
        share = (x - boundary.low[first][owner]) / (boundary.high - boundary.low)[first][owner]
        other, one = use[owner], first[owner]
        share = np.where(boundary.along[other], share, 1 - share)
        y = boundary.low[other] + share * (boundary.high - boundary.low)[other]
        far = self.along(boundary.face[one], boundary.side[one], x)
        far -= self.along(boundary.face[other], boundary.side[other], y)
        gaps = np.zeros(len(boundary.first))
        np.maximum.at(gaps, boundary.edge[other], np.linalg.norm(far, axis=1))
        return gaps

    def lengths(self, boundary: Boundary) -> Array:
        """How far edges (E,) go from their start."""
        use = boundary.first
        x, owner = self._inner(boundary, use)
        face, side = boundary.face[use], boundary.side[use]
        start = self.along(face, side, boundary.low[use])
        far = np.linalg.norm(self.along(face[owner], side[owner], x) - start[owner], axis=1)
        found = np.zeros(len(use))
        np.maximum.at(found, owner, far)
        return found

    def refuse_curves(self) -> None:
        """Refuse faces that have no area.

        Raises
        ------
        ValueError
            Naming the first one's face of the cage.
        """
        sizes = self.splines.counts.prod(axis=1)
        owner = np.repeat(np.arange(len(sizes)), sizes)
        points = self.points - self.points[self.first][owner]
        points /= np.abs(points).max(initial=0) or 1.0  # squares of any size are numbers
        far = np.linalg.norm(points, axis=1)
        farthest = np.lexsort((far, owner))[np.cumsum(sizes) - 1]  # of each face
        length = far[farthest]
        with np.errstate(invalid="ignore", divide="ignore"):
            way = points[farthest] / length[:, None]
        wide = np.zeros(len(sizes))
        np.fmax.at(wide, owner, np.linalg.norm(np.cross(points, way[owner]), axis=1))
        bad = np.flatnonzero(wide <= _FLAT * length)
        if len(bad):
            grid = self.splines.grid.prod(axis=1)
            limit_face = self.splines.limit_faces[(np.cumsum(grid) - grid)[bad]]
            face = self.splines.surface.limit_faces.face[limit_face]
            every = np.unique(face).tolist()
            more = f" (and {len(bad) - 1} more are like it)" if len(bad) > 1 else ""
            holes = ", ".join(map(str, every[:_NAMED])) + ", ..." * (len(every) > _NAMED)
            raise ValueError(
                f"limit face {limit_face[0]}, of face {face[0]} of the cage, has no area: its "
                f"points are on a line{more}: move its vertices apart, or tag what is like it as "
                f"holes, mesh.with_tags(holes=[{holes}])"
            )


def _bernstein(degree: int, t: Array) -> Array:
    """Bernstein polynomials (k, degree + 1) at t (k,)."""
    i = np.arange(degree + 1)
    count = np.ones(degree + 1)
    for k in range(1, degree + 1):
        count[k] = count[k - 1] * (degree - k + 1) / k
    return np.asarray(count * t[:, None] ** i * (1 - t[:, None]) ** (degree - i))
