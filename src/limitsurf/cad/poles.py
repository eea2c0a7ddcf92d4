"""Special corners of limit faces: which are of one vertex, and how small the cells there are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.caching import cached_property
from limitsurf.engine.packing import one_by_one
from limitsurf.engine.protocol import threads
from limitsurf.numbers import FLOAT64
from limitsurf.patches import STRIP
from limitsurf.pieces import cells as cells_of
from limitsurf.pieces.cover import Cover
from limitsurf.pieces.weights import LocalWeights
from limitsurf.query.bezier import BezierPatches, BezierRest
from limitsurf.surface import LimitSurface
from limitsurf.values import Values

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Poles:
    """The special corners of all limit faces of a surface.

    Attributes
    ----------
    face, corner : (r,) int
        Limit faces, and their corners.
    pole : (r,) int
        Numbers of what is one place: vertices, or middles of faces.
    half : (n_limit_faces,) int
        1 where sides are half edges, as on limit faces of n-gons.
    corners : (corners, 2) int
        Of the domain.
    least : int
        How often edges have to be halved so that no face is split within a cell at a corner.
    finest : int
        How often edges are halved where faces are split furthest, rings aside.
    """

    face: Array
    corner: Array
    pole: Array
    half: Array
    corners: Array
    least: int
    finest: int

    @classmethod
    def of(cls, surface: LimitSurface) -> Poles:
        """Those of a surface."""
        topology, mesh = surface.topology, surface.mesh
        table, ends, n = topology.patches, surface.limit_faces, len(surface.limit_faces)
        half = (ends.corner >= 0).astype(np.int64)
        covered = Cover.of(table, np.arange(n))
        kind = table.kind[covered.patch]
        special = np.flatnonzero(kind > STRIP)
        face, lattice = covered.owner[special], topology.lattice
        corners = np.array(lattice.corners)
        own = corners[table.turn[covered.patch[special]].astype(np.int64)]
        own = covered.place[special] + covered.sign[special, None] * own
        same = own[:, None] == corners << covered.level[special, None, None]
        at, corner = np.nonzero(same.all(axis=2))
        if len(at) < len(face):
            bad = face[np.setdiff1d(np.arange(len(face)), at)[0]]
            raise ValueError(
                f"limit face {bad} has a special point that is none of its corners, around which "
                "no spline face can be: refine the mesh once"
            )
        # of n-gons: a vertex at corner 0, the middle of the face at others
        whole = half[face] == 0
        first = (np.cumsum(mesh.sizes) - mesh.sizes)[ends.face[face]]
        vertex = mesh.indices[first + np.where(whole, corner, ends.corner[face])]
        pole = np.where(whole | (corner == 0), vertex, mesh.n_vertices + ends.face[face])
        level = covered.level + half[covered.owner]
        level[special] += 1
        across = np.flatnonzero(kind == STRIP)
        if len(across):
            strips, which = LocalWeights(table, topology.rules.scheme, FLOAT64).strips
            more = 1 if strips.both else strips.depth[which[table.row[covered.patch[across]]]]
            level[across] += more
        has = np.zeros(n, dtype=bool)
        has[face] = True
        least = int(level[has[covered.owner]].max(initial=0))
        finest = int(level.max(initial=0))
        return cls(face, corner, pole, half, corners, least, finest)

    def at_depths(self, surface: LimitSurface, depth: Array) -> Depths:
        """Depths (r,) of theirs, or one for all; of the same surface."""
        each = np.full((len(self.half), len(self.corners)), -1)
        each[self.face, self.corner] = depth
        return Depths(surface, each, self.half, self.corners)


@dataclass(frozen=True, eq=False)
class Depths:
    """How small the cells at corners of limit faces are: 2^-depth of edges of the cage.

    Attributes
    ----------
    surface : LimitSurface
    each : (n_limit_faces, corners) int
        -1 at corners that are not special.
    half : (n_limit_faces,) int
    corners : (corners, 2) int
    """

    surface: LimitSurface
    each: Array
    half: Array
    corners: Array

    @cached_property
    def _values(self) -> Values:
        """Of all faces, and therefore made once."""
        return Values(self.surface.topology.patches, self.surface.points)

    @property
    def most(self) -> Array:
        """The largest of each limit face, (n_limit_faces,)."""
        return np.asarray(self.each.max(axis=1))

    def pieces(self, faces: Array, workers: int) -> Iterator[BezierPatches]:
        """Pieces of some limit faces, of those of one depth at a time."""
        surface, topology = self.surface, self.surface.topology
        scheme = topology.rules.scheme
        most = self.most[faces]
        for depth in np.unique(most).tolist():
            some = faces[most == depth]
            rings = max(depth, 0) - self.half[some]
            known = topology.patches, scheme, surface.points, some, rings
            divided = one_by_one(threads(workers))
            found = cells_of.cut(*known, False, divided, hulls=False, values=self._values)
            yield self.shortened(found)

    def shortened(self, pieces: BezierPatches) -> BezierPatches:
        """Pieces that were cut to the largest depths, without those within cells of less."""
        rest = pieces.rest
        own = self.each[rest.face, rest.corner]
        if (own == self.most[rest.face]).all():
            return pieces
        face = pieces.face
        size = np.ldexp(1.0, self.half[:, None] - self.each)  # (n_limit_faces, corners)
        kept = np.ones(len(face), dtype=bool)
        middle = pieces.origin + pieces.size / 3
        for k, corner in enumerate(self.corners):
            known = self.each[face, k] >= 0
            near = np.abs(middle - corner)
            if len(self.corners) == 4:
                inside = (near < size[face, k, None]).all(axis=1)
            else:  # barycentric coordinate of the corner
                far = middle.sum(axis=1) if k == 0 else 1 - middle[:, k - 1]
                inside = far < size[face, k]
            kept &= ~(known & inside)
        step = size[rest.face, rest.corner, None] * np.ones(2)
        turned = np.sign(rest.size) * step
        end = rest.origin + rest.size * self.corners[rest.corner]
        cut = BezierRest(
            rest.face, rest.corner, end - turned * self.corners[rest.corner], turned,
            rest.lower, rest.upper,
        )  # fmt: skip
        return replace(
            pieces, face=face[kept], origin=pieces.origin[kept], size=pieces.size[kept],
            points=pieces.points[kept], rest=cut,
        )  # fmt: skip
