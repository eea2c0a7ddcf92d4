"""Neighbourhoods of triangles under steps that cut them into nine, and what these make of each.

The limit on a triangle depends on the vertices of all faces that touch those that touch it: two
rings. So does each of its nine parts, on vertices that come from the same. Which masks apply there
is a matter of how these faces lie together, told by a canonical numbering from the first side of
the triangle on. Around one special vertex or along a boundary there are few such neighbourhoods:
those of the parts are met again and again, and far from all else there is but the regular one.

A numbering is also a walk, by which the vertices of many alike triangles of a mesh are found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from limitsurf import numbers
from limitsurf.caching import cached_property
from limitsurf.cage.connectivity import Connectivity
from limitsurf.options import Rules
from limitsurf.refine.thirds import Thirds, edge_table

Array = NDArray[Any]

# steps of a walk, from a half-edge to another: those around its vertex, and around its face
_AFTER, _BEFORE, _NEXT, _LAST = range(4)

# parts of a triangle: where corner 0 of each is, in thirds, and whether it is turned by half a turn
PARTS = [(0, 0, 1), (2, 0, 1), (0, 2, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
PARTS += [(1, 1, -1), (2, 1, -1), (1, 2, -1)]
# the first corners of these among those of the nine faces that `Thirds.whole_faces` makes
FIRST = np.array([0, 2, 1, 0, 2, 1, 1, 0, 2])


class Maps:
    """Where half-edges of triangles lead to, -1 for nowhere."""

    def __init__(self, twin: Array) -> None:
        corner = np.arange(len(twin))
        face, k = np.divmod(corner, 3)
        last, after = 3 * face + (k + 2) % 3, 3 * face + (k + 1) % 3
        before = np.where(twin < 0, -1, after[twin])
        self.tables = np.stack([twin[last], before, after, last])


@dataclass(eq=False)
class Neighbourhood:
    """One kind of neighbourhood.

    Attributes
    ----------
    steps : list of (int, int)
        The walk: each half-edge from which one before, by which step. The first is the first side.
    ends : list of int
        The half-edges at whose tails the vertices are, in order.
    faces : (m, 3) int
        What it consists of.
    fixed : (n,) bool
        Which vertices stay where they are.
    twin : (3 m,) int
        The half-edges in the other direction, -1 for none.
    """

    steps: list[tuple[int, int]]
    ends: list[int]
    faces: Array
    fixed: Array
    twin: Array

    @classmethod
    def of(cls, maps: Array, indices: Array, fixed: Array, first: int) -> Self:
        """That of the triangle with a side, in a mesh by its half-edges."""
        walk = _Walk(maps, indices, first)
        for side in walk.sides():
            walk.around(side)
        near = len(walk.vertices)
        for place in range(near):
            walk.around(walk.ends[place])
        known = {vertex: k for k, vertex in enumerate(walk.vertices)}
        faces = [[known[vertex] for vertex in face] for face in walk.faces]
        sides = {side: k for k, side in enumerate(walk.corners)}
        across = maps[_AFTER][maps[_NEXT][walk.corners]]
        twin = np.array([sides.get(side, -1) for side in across.tolist()])
        ids = np.array(walk.vertices)
        # what is far is the same whether it stays or not
        stays = fixed[ids] & (np.arange(len(ids)) < near)
        return cls(walk.steps, walk.ends, np.array(faces), stays, twin)

    @cached_property
    def key(self) -> tuple[bytes, ...]:
        """Equal for equal neighbourhoods."""
        numbers_ = (x.astype(np.int32).tobytes() for x in (self.faces, self.twin))
        return self.fixed.tobytes(), *numbers_

    @property
    def size(self) -> int:
        """Number of vertices."""
        return len(self.ends)

    @cached_property
    def _next(self) -> dict[tuple[int, int], int]:
        """The third vertex of the face at each half-edge, by its ends."""
        turns = [(0, 1, 2), (1, 2, 0), (2, 0, 1)]
        return {(f[a], f[b]): f[c] for f in self.faces.tolist() for a, b, c in turns}

    @cached_property
    def open_sides(self) -> Array:
        """Which sides of the triangle are on a boundary, (3,) bool."""
        return np.array([(b, a) not in self._next for a, b in ((0, 1), (1, 2), (2, 0))])

    @cached_property
    def ring(self) -> tuple[Array, bool]:
        """The neighbours of the first vertex, counter-clockwise, and whether they go around it.

        If not, from one boundary to the other.
        """
        back = {self._next[0, b]: b for a, b in self._next if a == 0}
        first = 1
        while first in back and back[first] != 1:
            first = back[first]
        closed = first in back
        ring = [1 if closed else first]
        while (0, ring[-1]) in self._next and len(ring) <= self.size:
            ring.append(self._next[0, ring[-1]])
            if ring[-1] == ring[0]:
                ring.pop()
                break
        return np.array(ring), closed

    @cached_property
    def curve(self) -> Array:
        """Vertices of the boundary that the first one is on, but that: neighbours, then those next.

        Both neighbours are those of the ring, the first and the last.
        """
        ring, _ = self.ring
        ends = [int(ring[0]), int(ring[-1])]
        rim = [(a, b) for a, b in self._next if (b, a) not in self._next]
        on = [b for a, b in rim if a == ends[0]] + [a for a, b in rim if b == ends[1]]
        return np.array(ends + [x for x in dict.fromkeys(on) if x not in (0, *ends)])

    def vertices(self, maps: Array, indices: Array, sides: Array) -> Array:
        """The vertices (Q, size) of like triangles of a mesh, by their first sides."""
        wanted, found = self._needed, {0: sides}
        for k in wanted[1:]:
            source, step = self.steps[k]
            found[k] = maps[step][found[source]]
        return np.stack([indices[found[k]] for k in self.ends], axis=1)

    @cached_property
    def _needed(self) -> list[int]:
        needed = {0, *self.ends}
        for k in range(len(self.steps) - 1, 0, -1):
            if k in needed:
                needed.add(self.steps[k][0])
        return sorted(needed)

    def parts(self, rules: Rules) -> tuple[list[Neighbourhood], list[Array]]:
        """Neighbourhoods of the nine parts, and the vertices of each as rows over the own ones."""
        ends = self.faces.ravel(), np.roll(self.faces, -1, axis=1).ravel()
        known = {"twin": self.twin, "edge_table": edge_table(ends, self.twin)}
        sizes = np.full(len(self.faces), 3)
        cage = Connectivity(self.size, sizes, ends[0], repeats=False, parallel=True, **known)
        fans = cage.fans
        rim = np.zeros(self.size, dtype=bool)
        rim[fans.vertex[~fans.closed]] = True
        step = Thirds.among(cage, ~rim & ~self.fixed, rim & ~self.fixed)
        number = numbers.FLOAT64
        matrix = step.second(rules, number) @ step.first(rules, number)
        finer = step.child
        maps, fixed = Maps(finer.twin).tables, ~(finer.interior | finer.smooth)
        found, rows = [], list[Array]()
        for face, corner in enumerate(FIRST.tolist()):
            # the triangle is the first face
            part = Neighbourhood.of(maps, finer.mesh.indices, fixed, 3 * face + corner)
            side = np.array([3 * face + corner])
            rows.append(matrix[part.vertices(maps, finer.mesh.indices, side)[0]].toarray())
            found.append(part)
        return found, rows


class _Walk:
    """A walk that numbers half-edges, vertices and faces as it meets them."""

    def __init__(self, maps: Array, indices: Array, first: int) -> None:
        self._maps, self._indices = maps, indices
        self._edges, self.steps = [first], [(0, _NEXT)]
        self.vertices: list[int] = []
        self.ends: list[int] = []
        self.faces: list[list[int]] = []
        self.corners: list[int] = []
        self._seen: set[int] = set()
        self._known: set[int] = set()

    def _go(self, source: int, step: int) -> int:
        """The number of the half-edge that a step leads to, -1 for none."""
        found = int(self._maps[step, self._edges[source]])
        if found < 0:
            return -1
        self._edges.append(found)
        self.steps.append((source, step))
        return len(self._edges) - 1

    def _meet(self, place: int) -> None:
        vertex = int(self._indices[self._edges[place]])
        if vertex not in self._known:
            self._known.add(vertex)
            self.vertices.append(vertex)
            self.ends.append(place)

    def sides(self) -> Sequence[int]:
        """The three sides of the triangle, whose corners are the first vertices."""
        sides = [0, self._go(0, _NEXT), self._go(0, _LAST)]
        for side in sides:
            self._meet(side)
        return sides

    def around(self, place: int) -> None:
        """All faces around the vertex of a half-edge: on from it, then, if it is open, back."""
        self._face(place)
        here = self._go(place, _AFTER)
        while here >= 0 and self._edges[here] != self._edges[place]:
            self._face(here)
            here = self._go(here, _AFTER)
        if here < 0:
            here = self._go(place, _BEFORE)
            while here >= 0:
                self._face(here)
                here = self._go(here, _BEFORE)

    def _face(self, place: int) -> None:
        face = self._edges[place] // 3
        if face in self._seen:
            return
        self._seen.add(face)
        corners = [place, self._go(place, _NEXT), self._go(place, _LAST)]
        self.faces.append([int(self._indices[self._edges[corner]]) for corner in corners])
        self.corners += [self._edges[corner] for corner in corners]
        for corner in corners:
            self._meet(corner)
