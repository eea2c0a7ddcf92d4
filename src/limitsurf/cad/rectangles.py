"""Limit faces in rectangles, as few as corners ask for, with special corners at corners of them.

Sides that begin at a special corner are cut. Where the border of a region turns the other way,
around three faces, or a cut ends, a line is cut straight on: first as many of the lines that end
at another such place as cross none of each other, then the shorter of both ways. What is left has
no such corners: rectangles, and tubes and tori, which are cut along a line.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cad.chords import independent
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_SEAMS = 4  # times that what is no rectangle is cut
_LONG = 1024  # edges to which lines are followed to see which are short


@dataclass(frozen=True, eq=False)
class Rectangles:
    """Limit faces side by side.

    Attributes
    ----------
    grid : (n, 2) int
        How many there are along u and along v.
    faces : (l,) int
        Limit faces, ``grid.prod(axis=1)`` of each, those along v one after the other.
    turns : (l,) int
        Which of their corners is at low u and low v.
    """

    grid: Array
    faces: Array
    turns: Array


def rectangles(surface: LimitSurface, own: Array, sharp: Array, special: Array) -> Rectangles:
    """Rectangles of the limit faces that are one's `own` (n_limit_faces,).

    They are faces of the mesh; `sharp` (n_edges,) are edges that none goes across, and `special`
    (n_limit_faces, 4) corners that are only at corners of rectangles.
    """
    walls = _Walls(surface, own, sharp, special)
    walls.part()
    for _ in range(_SEAMS):
        if not walls.seams():
            break
    return walls.rectangles()


class _Walls:
    """Half-edges across which regular faces go on, fewer and fewer.

    Half-edges are corners of the mesh: that to the next corner of its face.
    """

    def __init__(self, surface: LimitSurface, faces: Array, sharp: Array, special: Array) -> None:
        mesh, known = surface.mesh, surface.limit_faces
        self.mesh, self.following, self.previous = mesh, mesh.next_corner, mesh.previous_corner
        own = np.zeros(mesh.n_faces, dtype=bool)
        own[known.face[faces]] = True
        twin = mesh.twin
        inner = own[mesh.corner_face]
        here = inner & (twin >= 0) & ~sharp[mesh.corner_edge]
        here[here] = inner[twin[here]] & here[twin[here]]
        self.twin = np.where(twin < 0, np.arange(len(twin)), twin)
        # not onto a side of the same face
        here &= mesh.corner_face[self.twin] != mesh.corner_face
        self.open, self.inner = here, inner
        self.limit_face = known.first[mesh.corner_face]
        self.corner = np.arange(mesh.n_corners) - np.repeat(mesh.offsets[:-1], mesh.sizes)
        face, corner = np.nonzero(special & faces[:, None])
        at = mesh.offsets[known.face[face]] + corner
        self._cut(np.concatenate([at, self.previous[at]]))

    def _around(self) -> tuple[Array, Array]:
        """Corners (c,) at which sectors of faces begin, and how many faces these have, up to 5."""
        begin = np.flatnonzero(self.inner & ~self.open)
        count, at, going = np.ones(len(begin), dtype=np.int64), begin, np.ones(len(begin), bool)
        for _ in range(4):
            going = going & self.open[self.previous[at]]
            at = np.where(going, self.twin[self.previous[at]], at)
            count += going
        return begin, count

    def _ahead(self, at: Array) -> tuple[Array, Array]:
        """Half-edges straight on, and whether lines go on there."""
        left = self.following[at]
        straight = self.following[self.twin[left]]
        right = self.previous[self.twin[at]]
        return straight, self.open[left] & self.open[straight] & self.open[right]

    def _lines(self, start: Array, most: int = _LONG) -> tuple[Array, Array]:
        """Half-edges of lines, so many at most, and the line of each, if none stopped another."""
        line, at = np.arange(len(start)), start
        found, owner = [at], [line]
        for _ in range(most):
            straight, going = self._ahead(at)
            at, line = straight[going], line[going]
            again = at == start[line]  # lines that are closed
            at, line = at[~again], line[~again]
            if not len(at):
                break
            found.append(at)
            owner.append(line)
        return np.concatenate(found), np.concatenate(owner)

    def _cut(self, at: Array) -> None:
        self.open[at] = self.open[self.twin[at]] = False

    def part(self) -> None:
        """Cut lines from all corners around three faces."""
        self._chords()
        begin, count = self._around()
        corner = begin[count >= 3]
        one = self.twin[self.previous[corner]]
        other = self.twin[self.previous[one]]
        starts = np.stack([one, other])
        _, owner = self._lines(starts.ravel())
        long = np.bincount(owner, minlength=starts.size).reshape(starts.shape)
        at = np.where((long[0] <= long[1]) & (count[count >= 3] == 3), one, other)
        # all at once, each until it meets a border or another; where two meet, one goes on
        while len(at):
            at = at[self.open[at]]
            straight, going = self._ahead(at)
            end = self.mesh.indices[self.following[at]]
            self._cut(at)
            at, end = straight[going], end[going]
            at = at[np.sort(np.unique(end, return_index=True)[1])]

    def _chords(self) -> None:
        """Cut lines from one such corner to another: as many as cross none of each other."""
        begin, count = self._around()
        corner, end = begin[count == 3], begin[count == 4]
        one = self.twin[self.previous[corner]]
        straight = self.twin[self.previous[self.twin[self.previous[end]]]]
        start = np.concatenate([one, self.twin[self.previous[one]], straight])
        if not len(start):
            return
        bends = np.zeros(self.mesh.n_corners, dtype=bool)
        bends[start] = True
        edges, owner = self._lines(start)
        last = np.zeros(len(start), dtype=np.int64)
        last[owner] = edges  # the last of each is written last
        back = self.twin[last]
        chord = bends[back] & (start < back)
        keep = chord[owner]
        edges, owner = edges[keep], owner[keep]
        first, second = self.mesh.indices[edges], self.mesh.indices[self.following[edges]]
        # each vertex once: where its edge begins, and the end of the last
        ends = np.concatenate([first, second[edges == last[owner]]])
        lines = np.concatenate([owner, owner[edges == last[owner]]])
        chosen = independent(ends, lines, chord)
        self._cut(edges[chosen[owner]])

    def seams(self) -> bool:
        """Cut parts without corners along a line each; whether there were any."""
        label = self._labels()
        begin, count = self._around()
        face = self.mesh.corner_face
        n = int(label.max(initial=-1)) + 1
        corners = np.bincount(label[face[begin[count == 1]]], minlength=n)
        round_ = np.zeros(n, dtype=bool)
        round_[label[face[self.inner]]] = True
        round_ &= corners == 0
        if not round_.any():
            return False
        # from the border where there is one, else from anywhere
        own = np.flatnonzero(self.inner & round_[label[face]])
        order = np.argsort(self.open[own], kind="stable")
        own = own[order]
        _, first = np.unique(label[face[own]], return_index=True)
        at = own[first]
        at = np.where(self.open[at], at, self.twin[self.previous[at]])
        edges, _ = self._lines(at[self.open[at]], len(self.open))
        self._cut(edges)
        return bool(len(edges))

    def _labels(self) -> Array:
        """Numbers of the parts that faces of the mesh are in, (n_faces,)."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        face, here = self.mesh.corner_face, np.flatnonzero(self.open)
        links = np.ones(len(here), dtype=np.int8), (face[here], face[self.twin[here]])
        shape = self.mesh.n_faces, self.mesh.n_faces
        return np.asarray(connected_components(coo_array(links, shape=shape), directed=False)[1])

    def rectangles(self) -> Rectangles:
        """Parts as rectangles; faces of what is none are ones by themselves."""
        for _ in range(_SEAMS):
            faces, *known = self._developed()
            if not self._halved(*known):
                break
        return self._checked(faces, *known)

    def _halved(self, label: Array, place: Array, turn: Array) -> bool:
        """Cut parts that meet themselves in halves, across the way they do; whether any do."""
        mesh = self.mesh
        face, beyond = mesh.corner_face, mesh.corner_face[self.twin]
        wall = self.inner & ~self.open & self.inner[self.twin] & (mesh.twin >= 0)
        wall &= label[face] == label[beyond]
        # across lower and upper sides, and across left and right ones
        way = (self.corner[wall] - turn[face[wall]]) % 2
        touching = label[face[wall]]
        n = int(label.max(initial=-1)) + 1
        size = np.zeros((n, 2), dtype=np.int64)
        np.maximum.at(size, label, place)
        low = np.zeros((n, 2), dtype=np.int64)
        np.minimum.at(low, label, place)
        size = size - low + 1
        cut, along = np.zeros(n, dtype=bool), np.zeros(n, dtype=np.int64)
        along[touching] = 1 - way
        along = np.where(size[np.arange(n), along] > 1, along, 1 - along)
        cut[touching] = size[touching, along[touching]] > 1
        if not cut.any():
            return False
        here = np.flatnonzero(self.open & cut[label[face]])
        own = label[face[here]]
        middle = (low + size // 2)[own, along[own]]
        a, b = place[face[here], along[own]], place[beyond[here], along[own]]
        self._cut(here[(a < middle) != (b < middle)])
        return True

    def _developed(self) -> tuple[Array, Array, Array, Array]:
        """Faces, and by faces of the mesh their parts, places and turns there."""
        mesh, label = self.mesh, self._labels()
        first = mesh.offsets[:-1]
        own = np.zeros(mesh.n_faces, dtype=bool)
        own[mesh.corner_face[self.inner]] = True
        _, seed = np.unique(np.where(own, label, -1), return_index=True)
        seed = seed[own[seed]]
        place = np.zeros((mesh.n_faces, 2), dtype=np.int64)
        turn = np.full(mesh.n_faces, -1)
        turn[seed] = 0
        steps = np.array([(0, -1), (1, 0), (0, 1), (-1, 0)])
        front = seed
        while len(front):
            out = first[front][:, None] + np.arange(4)
            go = self.open[out]
            source = np.broadcast_to(front[:, None], out.shape)[go]
            out = out[go]
            to = mesh.corner_face[self.twin[out]]
            new = turn[to] < 0
            out, source, to = out[new], source[new], to[new]
            to, one = np.unique(to, return_index=True)
            out, source = out[one], source[one]
            way = (self.corner[out] - turn[source]) % 4
            place[to] = place[source] + steps[way]
            turn[to] = (self.corner[self.twin[out]] - way - 2) % 4
            front = to
        return np.flatnonzero(own), label, place, turn

    def _checked(self, faces: Array, label: Array, place: Array, turn: Array) -> Rectangles:
        """Faces (f,) in rectangles where their places fill one, and agree across all sides."""
        mesh = self.mesh
        n = int(label.max(initial=-1)) + 1
        low, high = np.full((n, 2), np.iinfo(np.int64).max), np.full((n, 2), -1 - len(label))
        for k in range(2):
            np.minimum.at(low[:, k], label[faces], place[faces, k])
            np.maximum.at(high[:, k], label[faces], place[faces, k])
        size = high - low + 1
        count = np.bincount(label[faces], minlength=n)
        good = (count > 0) & (size.astype(float).prod(axis=1) == count)
        # each side must lead to the place beside
        here = np.flatnonzero(self.open)
        a, b = mesh.corner_face[here], mesh.corner_face[self.twin[here]]
        steps = np.array([(0, -1), (1, 0), (0, 1), (-1, 0)])
        way = (self.corner[here] - turn[a]) % 4
        back = (self.corner[self.twin[here]] - turn[b]) % 4
        wrong = (place[a] + steps[way] != place[b]).any(axis=1) | ((way + 2) % 4 != back)
        good[label[a[wrong]]] = False
        single = ~good[label[faces]]
        place = place[faces] - low[label[faces]]
        place[single] = 0
        turn = np.where(single, 0, turn[faces])
        # a part of its own for each that is single
        part = np.where(single, n + np.arange(len(faces)), label[faces])
        order = np.lexsort([place[:, 1], place[:, 0], part])
        _, begin = np.unique(part[order], return_index=True)
        ids = part[order][begin]
        grid = np.where((ids < n)[:, None], size[np.minimum(ids, n - 1)], 1)
        known = self.mesh.offsets[:-1][faces[order]]
        return Rectangles(grid, self.limit_face[known], turn[order])
