"""Squares with a point each: what a dual scheme refines, and who surrounds whom.

Half-edges are numbered through, four to a square: half-edge ``4 q + k`` goes from corner k of
square q to the next. The corners of squares have the same numbers.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.connectivity import Fans
from limitsurf.cage.mesh import Mesh
from limitsurf.refine.dual import Rim

Array = NDArray[Any]

_AFTER, _BEFORE = np.array([1, 1, 1, -3]), np.array([3, -1, -1, -1])


@dataclass(frozen=True, eq=False)
class Squares:
    """Squares that are joined along edges.

    Attributes
    ----------
    twin : (4 n,) int
        The half-edge on the other side of each; -1 at rims.
    around : (4 n,) int
        How many squares are around the vertex at each corner; 0 at rims.
    special : (4 n,) bool
        Whether a patch with that corner is a piece of more than the spline.
    """

    twin: Array
    around: Array
    special: Array

    def __len__(self) -> int:
        return len(self.twin) // 4

    def left(self, corners: Array) -> Array:
        """The corners of the next squares around the vertices of some, counter-clockwise."""
        return np.asarray(self.twin[corners + _BEFORE[corners % 4]])

    def right(self, corners: Array) -> Array:
        """The corners of the squares before, clockwise."""
        across = self.twin[corners]
        return np.asarray(np.where(across < 0, -1, across + _AFTER[across % 4]))

    def places(self, corners: Array, n: int) -> tuple[Array, Array, Array]:
        """Which vertices, amid n squares, some corners are at.

        One corner (r,) at each vertex, the vertex of each of those asked for, and its place there,
        from that one on. Linked lists ranked by pointer doubling.
        """
        every = np.flatnonzero(self.around == n)
        number = np.full(len(self.twin), -1)
        number[every] = np.arange(len(every))
        back = number[self.right(every)]
        # (of a part of the squares some rings are not whole; nobody asks for these)
        back = np.where(back < 0, np.arange(len(every)), back)
        first, step, steps = np.arange(len(every)), back, max(n - 1, 1).bit_length()
        for _ in range(steps):
            first, step = np.minimum(first, first[step]), step[step]
        step = np.where(first == np.arange(len(every)), first, back)
        place = (step != np.arange(len(every))).astype(np.int64)
        for _ in range(steps):
            place, step = place + place[step], step[step]
        asked = number[corners]
        met, ring = np.unique(first[asked], return_inverse=True)
        return every[met], ring, place[asked]

    def rings(self, corners: Array, n: int) -> Array:
        """The corners around the vertices of some corners, from these on, (., n)."""
        found = [corners]
        for _ in range(n - 1):
            found.append(self.left(found[-1]))
        return np.stack(found, axis=1)

    def by_size(self, corners: Array) -> Iterator[tuple[int, Array]]:
        """Which of some corners have n squares around their vertex, for each n that there is."""
        sizes = self.around[corners]
        for n in np.unique(sizes[sizes > 0]).tolist():
            yield n, np.flatnonzero(sizes == n)

    def beside(self, corners: Array) -> Array:
        """The squares around those of some corners but those around these, (., 5).

        Counter-clockwise from that across the edge away from the corner; other vertices are amid
        four squares.
        """
        first = corners - corners % 4
        k = corners % 4
        right, top = (self.twin[first + (k + j) % 4] for j in (1, 2))
        below = self.twin[corners]
        found = [
            self.twin[below + _BEFORE[below % 4]],
            right,
            self.twin[right + _BEFORE[right % 4]],
            top,
            self.twin[top + _BEFORE[top % 4]],
        ]
        return np.stack(found, axis=1) // 4

    def split(self) -> Squares:
        """Their children: number ``4 q + k`` is at corner k of square q, its corner 0 there."""
        corners = np.arange(len(self.twin))
        after, before = corners + _AFTER[corners % 4], corners + _BEFORE[corners % 4]
        split = _split(self.twin, self.around, after, before, np.full(len(corners), 4))
        special = np.zeros((len(corners), 4), dtype=bool)
        special[:, 0] = self.special
        return Squares(*split, special.ravel())

    def part(self, which: Array) -> Squares:
        """Some of the squares, by number."""
        number = np.full(len(self), -1)
        number[which] = np.arange(len(which))
        corners = (4 * which[:, None] + np.arange(4)).ravel()
        twin = self.twin[corners]
        joined = np.where(twin < 0, -1, number[twin // 4])
        twin = np.where(joined < 0, -1, 4 * joined + twin % 4)
        return Squares(twin, self.around[corners], self.special[corners])


def first_squares(mesh: Mesh, rim: Rim | None, lone: bool, regular: int) -> Squares:
    """The squares at the corners of a cage, and those beyond its boundary, if there are to be any.

    Special is what is not amid a `regular` number of squares, and, if so are `lone` ones, boundary
    vertices of one face. Corner 0 of a square is at the vertex, then come the edge to the next, the
    face, and the edge to the one before.
    """
    fans = Fans.of(mesh.connectivity, mesh.twin) if rim is None else rim.fans
    around = np.where(fans.closed, fans.sizes, 0)[fans.fan]
    known = mesh.twin, around, mesh.next_corner, mesh.previous_corner
    twin, around = _split(*known, mesh.sizes[mesh.corner_face])
    if rim is None or not len(rim.vertex):
        return Squares(twin, around, around != regular)
    more = 4 * int(rim.start[-1] - rim.start[0])
    twin = np.concatenate([twin, np.full(more, -1)])
    around = np.concatenate([around, np.zeros(more, dtype=np.int64)])

    def join(one: Array, other: Array) -> None:
        twin[one], twin[other] = other, one

    every = np.arange(len(rim.vertex))
    first, last = rim.corners(every, 0), rim.corners(every, -1)
    begin, end = 4 * rim.start[:-1], 4 * (rim.start[1:] - 1)
    join(4 * last + 3, begin)
    join(end + 3, 4 * first)
    inner = 4 * np.setdiff1d(np.arange(rim.start[0], rim.start[-1]), rim.start[1:] - 1)
    join(inner + 3, inner + 4)
    # at the middle of the boundary edge from the vertex to the next one, the last of the next
    next_first = np.full(mesh.n_corners, -1)
    next_first[last] = begin
    join(end + 2, next_first[mesh.next_corner[first]] + 1)
    whole = rim.faces + rim.counts
    around[4 * np.arange(rim.start[0], rim.start[-1])] = np.repeat(whole, rim.counts)
    around[end + 3] = around[begin + 1] = 4
    around[4 * first + 1] = around[4 * last + 3] = 4
    open_fan = np.zeros(len(fans.vertex), dtype=np.int64)
    open_fan[rim.which] = whole
    corners = np.flatnonzero(~fans.closed[fans.fan])
    around[4 * corners] = open_fan[fans.fan[corners]]
    special = around != regular
    special[4 * first[rim.faces == 1]] |= lone
    return Squares(twin, around, special)


def _split(
    twin: Array, around: Array, after: Array, before: Array, sizes: Array
) -> tuple[Array, Array]:
    """Twins, and squares around corners, of the squares at the corners of polygons."""
    entering = twin[before]
    twins = [
        np.where(twin < 0, -1, 4 * after[twin] + 3),
        4 * after + 2,
        4 * before + 1,
        np.where(entering < 0, -1, 4 * entering),
    ]
    four = np.where(twin < 0, 0, 4), np.where(entering < 0, 0, 4)
    corners = [around, four[0], sizes, four[1]]
    return np.stack(twins, axis=1).ravel(), np.stack(corners, axis=1).ravel()
