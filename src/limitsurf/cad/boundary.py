"""Vertices, edges and parts of a boundary representation, from the cage's half-edges alone.

What of `segments` lies along the same two faces, one after the other, is one edge.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from limitsurf.cad.bspline import BSplineFaces
from limitsurf.cad.segments import Sides, Uses, uses_of_squares, uses_of_triangles
from limitsurf.cage.mesh import Mesh
from limitsurf.query.records import numbered

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Boundary:
    """How faces meet: what is between them, by integers and parameters.

    Sides of faces are numbered counter-clockwise, from that of v = 0 on. Parameters along a side
    are u or v, whichever grows there. An edge runs as they do on its first face.

    Attributes
    ----------
    part : (n,) int64
        The connected part of each face.
    closed : (p,) bool
        Whether nothing is open in a part.
    open_edge : (p, 2) int64
        Vertices of the cage of the first edge that is, -1 if there is none.
    start, end : (E,) int64
        Vertices of edges.
    face, side, edge : (C,) int64
        The uses of edges in order around each face, then face after face.
    forward : (C,) bool
        Whether the use goes along the edge.
    low, high : (C,) float64
        Parameters along the side.
    along : (C,) bool
        Whether these grow along the edge.
    first : (E,) int64
        The first use of each edge.
    corner : (V, 2) int64
        A use at each vertex, and 1 if that is at its `low`, 0 if it is at its `high`.
    """

    part: Array
    closed: Array
    open_edge: Array
    start: Array
    end: Array
    face: Array
    side: Array
    edge: Array
    forward: Array
    low: Array
    high: Array
    along: Array
    first: Array
    corner: Array

    @classmethod
    def of(cls, splines: BSplineFaces) -> Boundary:
        """Of the faces that a limit surface was made into."""
        surface, grid = splines.surface, splines.grid
        sides = Sides(surface, splines.limit_faces)
        cells = grid.prod(axis=1)
        one = splines.limit_faces[np.cumsum(cells) - cells]
        if splines.trims is None:
            uses = uses_of_squares(sides, grid, splines.limit_faces, splines.turns)
        else:
            uses = uses_of_triangles(sides, one, splines.origin, splines.size)
        return _joined(sides, uses, grid, sides.part[surface.limit_faces.face[one]])

    def without(self, gone: Array) -> Boundary:
        """With the vertices at both ends of some edges (E,) as one: those that are points."""
        if not gone.any():
            return self
        V = len(self.corner)
        links = (np.ones(int(gone.sum()), dtype=np.int8), (self.start[gone], self.end[gone]))
        _, label = connected_components(coo_array(links, shape=(V, V)), directed=False)
        _, kept, label = np.unique(label, return_index=True, return_inverse=True)
        corner = self.corner[kept]
        return replace(self, start=label[self.start], end=label[self.end], corner=corner)


def _joined(sides: Sides, uses: Uses, grid: Array, part: Array) -> Boundary:
    """Segments put together to edges."""
    size, U = sides.size, len(uses.key)
    segment, _ = numbered([uses.key])
    count, first, other = _pairs(segment)
    follows = _follows(uses, size, segment, other)
    is_first = first[segment] == np.arange(U)
    number = np.empty(len(count), dtype=np.int64)
    number[segment[is_first]] = np.cumsum(is_first & ~follows)[is_first] - 1
    edge = number[segment]
    follows[1:] &= edge[1:] == edge[:-1]
    head = np.flatnonzero(~follows)
    tail = np.append(head[1:], U) - 1
    natural = uses.side < (size + 1) // 2  # parameters grow counter-clockwise
    way = np.where(natural, uses.sign, -uses.sign)
    lead_way = way[first[segment]]
    face, side, edge = uses.face[head], uses.side[head], edge[head]
    _, lead = np.unique(edge, return_index=True)
    ends = np.stack([uses.begin[head], uses.end[tail]])
    ends = np.where(natural[head], ends, ends[::-1])[:, lead].ravel()
    _, kept, vertex = np.unique(ends, return_index=True, return_inverse=True)
    width = grid[face, side % 2].astype(float) if size == 4 else np.ones(len(face))
    around = uses.low[head], uses.high[tail]
    low, high = np.where(natural[head], around, [width - around[1], width - around[0]])
    closed, open_edge = _open(sides.mesh, uses, count[segment] == 1, part)
    return Boundary(
        part=part,
        closed=closed,
        open_edge=open_edge,
        start=vertex[: len(lead)],
        end=vertex[len(lead) :],
        face=face,
        side=side,
        edge=edge,
        forward=uses.sign[head] == lead_way[head],
        low=low,
        high=high,
        along=way[head] == lead_way[head],
        first=lead,
        corner=np.stack([lead[kept % len(lead)], kept < len(lead)], axis=1),
    )


def _pairs(segment: Array) -> tuple[Array, Array, Array]:
    """How many uses each segment has, its first one, and of each use the other or itself."""
    order = np.argsort(segment, kind="stable")
    count = np.bincount(segment)
    begin = np.cumsum(count) - count
    first, last = order[begin], order[begin + count - 1]
    here = np.arange(len(segment))
    return count, first, np.where(first[segment] == here, last[segment], first[segment])


def _follows(uses: Uses, size: int, segment: Array, other: Array) -> Array:
    """Whether a use goes on along the same faces as the one before: no vertex is between them."""
    here, before = np.arange(1, len(segment)), np.arange(len(segment) - 1)
    _, one = np.unique(segment, return_index=True)
    _, vertex = np.unique(np.concatenate([uses.begin, uses.end]), return_inverse=True)
    start, stop = vertex[: len(segment)], vertex[len(segment) :]
    degree = np.bincount(np.concatenate([start[one], stop[one]]))
    line, alone = uses.face * size + uses.side, other == np.arange(len(segment))
    length = uses.high - uses.low
    share = length / length[other]
    goes = (line[here] == line[before]) & (degree[start[here]] == 2)
    goes &= (alone[here] == alone[before]) & (line[other[here]] == line[other[before]])
    goes &= share[here] == share[before]
    return np.append(False, goes)


def _open(mesh: Mesh, uses: Uses, alone: Array, part: Array) -> tuple[Array, Array]:
    """Which parts are closed, and the vertices of the first open edge of each other one."""
    parts = int(part.max(initial=-1)) + 1
    first = np.full(parts, mesh.n_edges)
    here = np.flatnonzero(alone & (uses.cage >= 0))
    np.minimum.at(first, part[uses.face[here]], mesh.corner_edge[uses.cage[here]])
    closed = first == mesh.n_edges
    ends = np.full((parts, 2), -1)
    ends[~closed] = mesh.edges[first[~closed]]
    return closed, ends
