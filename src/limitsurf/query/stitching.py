"""Parts of limit faces joined to polygons: what neighbours have on a common side, both have.

A place is a row of `face` and steps of 2^-BITS in u and v. Sides of limit faces are lines: edges of
the cage, or the ways from the middles of edges to that of an n-gon.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.mesh import Mesh
from limitsurf.query.adaptive import BITS, WHOLE, Division, Parts
from limitsurf.query.chords import triangles_error
from limitsurf.query.index import Cells
from limitsurf.query.records import numbered
from limitsurf.query.wanted import LOST, Wanted
from limitsurf.query.welding import sides
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_LINE = 2 * WHOLE  # steps along an edge of the cage; a side of a part of an n-gon has half of them
_PORTION = 2048  # triangles that are handled at once


@dataclass(frozen=True)
class Stated:
    """What is stated of polygons.

    Attributes
    ----------
    chord : float
        A bound of the distance of the surface from them, in pixels if there is a view.
    angle : float or None
        One of the angles between normals, in radians, if it was asked for.
    without : (k,) int64
        Polygons that it is not of.
    """

    chord: float
    angle: float | None
    without: Array


def stitched(
    surface: LimitSurface, wanted: Wanted, workers: int
) -> tuple[Stitches, Array, Array, Array, Stated]:
    """Polygons as wanted.

    Returns
    -------
    stitches : Stitches
    sites, sizes : (C,), (F,)
        Places of all corners of polygons, and sizes of these.
    owner : (F,)
        The limit face of each polygon.
    stated : Stated
    """
    return next(levels(surface, [wanted], workers))


def levels(
    surface: LimitSurface, all_wanted: Sequence[Wanted], workers: int
) -> Iterator[tuple[Stitches, Array, Array, Array, Stated]]:
    """Polygons as wanted, coarse ones first, each by dividing the parts of those before."""
    cells = Cells(surface, workers, 0)
    turn = cells.beyond.corner(np.arange(len(cells.beyond)))
    every = [wanted.scaled(cells.power) for wanted in all_wanted]
    division = Division(cells, surface.topology.with_limit)
    parts = None
    for scaled in every:
        division.wanted = scaled
        if parts is None:
            parts = division.first()
        else:
            coarse = np.flatnonzero(parts.error > scaled.chord)
            parts = division.finer(parts, coarse, np.ones(len(coarse), dtype=np.int64))
        while True:
            stitches = Stitches(surface, parts, turn)
            parts = stitches.parts
            sites, sizes, part = stitches.polygons()
            scaled.check(len(parts), triangles=int((sizes - 2).sum()))
            which, times = stitches.crowded()
            crowded = np.zeros(len(parts), dtype=np.int64)
            crowded[which] = times
            seen, tilt, excess = _cut(surface, division, stitches, sites, sizes, part, workers)
            bad = np.flatnonzero((crowded > 0) | (excess > 1))
            if not len(bad):
                break
            parts = division.finer(parts, bad, np.maximum(crowded[bad], 1))
        chord = float(seen.max(initial=0))
        if scaled.view is None:
            chord = float(np.ldexp(chord + LOST, -cells.power))
        angle = float(np.fmax.reduce(tilt, initial=0)) if scaled.turning else None
        stated = Stated(chord, angle, np.flatnonzero(np.isnan(tilt[part])))
        yield stitches, sites, sizes, parts.face[part], stated


def _cut(
    surface: LimitSurface, division: Division, stitches: Stitches, sites: Array, sizes: Array,
    part: Array, workers: int,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Bounds of the distances and angles of all parts, as in `Parts`, and excess of those cut.

    A bound of a triangle holds for it alone, and may be larger than that of the whole part.
    """
    parts, cells, wanted = stitches.parts, division.cells, division.wanted
    seen, turn, excess = parts.seen.copy(), parts.turn.copy(), np.zeros(len(parts))
    cut = (stitches.hanging.sum(axis=1) > 0) & (parts.corner < 0)
    seen[cut] = np.minimum(seen[cut], 0)
    own = part[np.flatnonzero(cut[part])]
    first = (np.cumsum(sizes) - sizes)[cut[part]]
    corners = sites[first[:, None] + np.arange(3)]  # (T, 3)
    used, inverse = np.unique(corners, return_inverse=True)
    points = np.ldexp(surface.evaluate(*stitches.places(used), workers=workers), cells.power)
    points = points[inverse.reshape(corners.shape)]
    at = (stitches.at[corners] - parts.place[own, None]) / parts.step[own, None]
    known = parts.bent[own], parts.loose[own], at, points
    found = triangles_error(*known)
    near = np.flatnonzero(division.might_do(found))
    if len(near):
        which, mine = np.unique(own[near], return_inverse=True)
        cells_ = division.points(parts[which])[mine]
        by_hulls = division.hulls.cut(cells_, at[near], points[near], wanted.chord)
        found[near] = np.minimum(found[near], by_hulls)
    found = division.judged(points, found, lambda x: triangles_error(*known, x))
    np.maximum.at(seen, own, found)
    np.maximum.at(excess, own, wanted.excess(points, found))
    if wanted.turning:
        _turned(division, parts, own, at, points, found >= 0, turn, excess)
    return seen, turn, excess


def _turned(
    division: Division, parts: Parts, own: Array, at: Array, points: Array, visible: Array,
    turn: Array, excess: Array,
) -> None:  # fmt: skip
    """Set bounds of angles of parts that are cut, and add to the excess of these."""
    known = ~np.isnan(turn[own])
    turn[own[known]] = 0
    here = np.flatnonzero(known & visible)
    for start in range(0, len(here), _PORTION):
        some = here[start : start + _PORTION]
        which, mine = np.unique(own[some], return_inverse=True)
        cells = division.points(parts[which])
        found = division.turning.cut(cells, mine, at[some], points[some])
        off = division.wanted.turned(found)
        stuck = (off > 1) & division.too_deep(parts[own[some]])
        with np.errstate(invalid="ignore"):
            np.maximum.at(turn, own[some], np.where(stuck, np.nan, found))
        np.maximum.at(excess, own[some], np.where(stuck, 0, off))


class Stitches:
    """The places where polygons have corners, and the polygons.

    Attributes
    ----------
    face : (K,) int
        The limit faces that there are.
    row : (S,) int64
        The face of each place, as a row of `face`.
    at : (S, 2) int64
    parts : Parts
        Those that are joined, by face, then v, then u.
    hanging : (L, c) int64
        How many places of neighbours there are on each side of a part.
    loop, offsets
        All places around the parts, and where those of each begin.
    """

    def __init__(self, surface: LimitSurface, parts: Parts, turn: Array) -> None:
        mesh, limit_faces = surface.mesh, surface.limit_faces
        self._lattice = surface.topology.lattice
        self.face = np.flatnonzero(surface.topology.with_limit)
        corner = limit_faces.corner[self.face]
        self._whole = corner < 0
        self._corner = mesh.offsets[limit_faces.face[self.face]] + np.maximum(corner, 0)
        self._ends = np.array(self._lattice.corners)
        self._mesh = mesh
        row = np.full(len(limit_faces), -1)
        row[self.face] = np.arange(len(self.face))
        order = np.lexsort((parts.place[:, 0], parts.place[:, 1], parts.face))
        self.parts = parts = parts[order]
        self._turn = turn[parts.corner] if len(turn) else parts.corner
        self._row = row[parts.face]
        corners = parts.place[:, None] + parts.step[:, None] * self._ends
        rows = np.repeat(self._row, len(self._ends))
        row, at, _ = _distinct(rows, corners.reshape(-1, 2))
        more = self._shared(row, at)
        rows = np.concatenate([rows, more[0]])
        places = np.concatenate([corners.reshape(-1, 2), more[1]])
        self.row, self.at, site = _distinct(rows, places)
        self._loops(site[: self._row.size * len(self._ends)].reshape(-1, len(self._ends)))

    # ------------------------------------------------------------------ lines

    def _lines(self, mesh: Mesh) -> tuple[Array, Array, Array]:
        """The lines at the sides of faces (K, sides), and steps along these from steps of sides.

        ``step = start + speed * (steps from the side's own start)``. Edges come first, then as
        many lines as there are faces. `mesh` is the cage or that of a channel.
        """
        K, n_sides = len(self.face), len(self._ends)
        line, start, speed = np.zeros((3, K, n_sides), dtype=np.int64)
        whole, cut = np.flatnonzero(self._whole), np.flatnonzero(~self._whole)

        def edges(rows: Array, k: int, corner: Array, begin: int, step: int) -> None:
            line[rows, k] = mesh.corner_edge[corner]
            flip = mesh.indices[corner] > mesh.indices[mesh.next_corner[corner]]
            start[rows, k] = np.where(flip, _LINE - begin, begin)
            speed[rows, k] = np.where(flip, -step, step)

        for k in range(n_sides):
            edges(whole, k, self._corner[whole] + k, 0, 2)
        if len(cut):
            corner = self._corner[cut]
            edges(cut, 0, corner, 0, 1)
            edges(cut, 3, mesh.previous_corner[corner], WHOLE, 1)
            # limit faces of one face follow each other
            is_first = mesh.offsets[mesh.corner_face[corner]] == corner
            previous = cut - 1 + is_first * mesh.sizes[mesh.corner_face[corner]]
            line[cut, 1], speed[cut, 1] = mesh.n_edges + cut, 1
            line[cut, 2], start[cut, 2], speed[cut, 2] = mesh.n_edges + previous, WHOLE, -1
        return line, start, speed

    def _along(self, k: int, at: Array) -> tuple[Array, Array]:
        """Which places are on side k of their faces, and steps from its start."""
        (a, b, c), (p, q, r) = self._lattice.edges[k], self._lattice.sides[k]
        on = a * WHOLE + b * at[:, 0] + c * at[:, 1] == 0
        return np.asarray(on), np.asarray(p * WHOLE + q * at[:, 0] + r * at[:, 1])

    def _shared(self, row: Array, at: Array) -> tuple[Array, Array]:
        """The places that any face has on a line, for all faces there."""
        line, start, speed = self._lines(self._mesh)
        found = []
        for k in range(len(self._ends)):
            on, step = self._along(k, at)
            of, along = line[row, k], start[row, k] + speed[row, k] * step
            # corners of limit faces of n-gons are in the middles of edges
            on &= (along > 0) & (along < np.where(of < self._mesh.n_edges, _LINE, WHOLE))
            found.append((of[on], along[on]))
        lines, steps, _ = _distinct(*(np.concatenate(x) for x in zip(*found, strict=True)))
        # what is on each line, for each side on it
        own = np.arange(line.size)
        first = np.searchsorted(lines, line.ravel())
        count = np.searchsorted(lines, line.ravel(), side="right") - first
        side = np.repeat(own, count)
        offset = np.arange(len(side)) - np.repeat(np.cumsum(count) - count, count)
        step = (steps[first[side] + offset] - start.ravel()[side]) // speed.ravel()[side]
        inside = (step > 0) & (step < WHOLE)
        rows, k = np.divmod(side[inside], len(self._ends))
        along = np.roll(self._ends, -1, axis=0) - self._ends
        return rows, WHOLE * self._ends[k] + step[inside, None] * along[k]

    # ------------------------------------------------------------------ polygons

    def _loops(self, corner: Array) -> None:
        """Find all places around each part, from its corners (L, c)."""
        L, size = corner.shape
        count, begin, back = np.empty((3, L, size), dtype=np.int64)
        orders = []
        for k in range(size):
            _, b, c = self._lattice.edges[k]
            _, q, r = self._lattice.sides[k]
            key = b * self.at[:, 0] + c * self.at[:, 1]
            order = np.lexsort((q * self.at[:, 0] + r * self.at[:, 1], key, self.row))
            rank = np.empty(len(order), dtype=np.int64)
            rank[order] = np.arange(len(order))
            one, other = rank[corner[:, k]], rank[np.roll(corner, -1, axis=1)[:, k]]
            back[:, k] = other < one
            count[:, k] = np.abs(other - one) - 1
            begin[:, k] = one
            orders.append(order)
        self.hanging = count
        self.sizes = size + count.sum(axis=1)
        self.offsets = np.concatenate([[0], np.cumsum(self.sizes)])
        each = (1 + count).ravel()
        item = np.repeat(np.arange(L * size), each)
        step = np.arange(len(item)) - np.repeat(np.cumsum(each) - each, each)
        rank = begin.ravel()[item] + np.where(back.ravel()[item] == 1, -step, step)
        self.loop = np.choose(item % size, np.stack(orders)[:, rank]) if L else item

    def polygons(self) -> tuple[Array, Array, Array]:
        """Places of all corners (C,), sizes of the polygons, and the part of each.

        Parts with places between their corners are cut into triangles: from a place that is alone
        on its side, from a corner with none on both its sides, or from one inside, which is new.
        """
        size, count = len(self._ends), self.hanging
        alone, free = count == 1, (count == 0) & (np.roll(count, 1, axis=1) == 0)
        corner_at = np.concatenate(
            [np.zeros((len(count), 1), dtype=np.int64), np.cumsum(1 + count, axis=1)[:, :-1]],
            axis=1,
        )
        rows = np.arange(len(count))
        tip = corner_at[rows, free.argmax(axis=1)]
        one = alone.any(axis=1)
        tip[one] = corner_at[rows, alone.argmax(axis=1)][one] + 1
        special = self.parts.corner >= 0
        tip[special] = corner_at[rows, self._turn][special]
        plain = (count.sum(axis=1) == 0) & ~(special & (size > 3))
        middle = ~plain & ~one & ~free.any(axis=1)
        new = np.flatnonzero(middle)
        inside = len(self.row) + np.cumsum(middle) - 1
        if len(new):
            share = 8 if size > 3 else 5
            at = self.parts.place[new] + self.parts.step[new] // 16 * share
            self.row, self.at = (
                np.concatenate(x) for x in ((self.row, self._row[new]), (self.at, at))
            )
        n_triangles = np.where(middle, self.sizes, self.sizes - 2)
        n_polygons = np.where(plain, 1, n_triangles)
        part = np.repeat(rows, n_polygons)
        sizes = np.where(plain, size, 3)[part]
        k = np.arange(len(part)) - np.repeat(np.cumsum(n_polygons) - n_polygons, n_polygons)
        offset = np.concatenate([[0], np.cumsum(sizes)])
        sites = np.empty(offset[-1], dtype=np.int64)
        whole = plain[part]
        first, mine = offset[:-1], part
        for j in range(size):
            sites[first[whole] + j] = self.loop[self.offsets[mine[whole]] + j]
        cut = mine[~whole]
        start, n, fan, k = first[~whole], self.sizes[cut], middle[cut], k[~whole]
        begin = self.offsets[cut]
        near = np.where(fan, k, (tip[cut] + 1 + k) % n)
        sites[start] = np.where(fan, inside[cut], self.loop[begin + tip[cut]])
        sites[start + 1] = self.loop[begin + near]
        sites[start + 2] = self.loop[begin + (near + 1) % n]
        return sites, sizes, part

    def crowded(self) -> tuple[Array, Array]:
        """Parts at special corners that have places on their sides; halvings until they have none.

        As far as these are on the sides at the corner itself; if they are across from it, one.
        """
        which = np.flatnonzero((self.parts.corner >= 0) & (self.hanging.sum(axis=1) > 0))
        count = self.sizes[which]
        item = np.repeat(np.arange(len(which)), count)
        step = np.arange(len(item)) - np.repeat(np.cumsum(count) - count, count)
        at = self.at[self.loop[self.offsets[which][item] + step]]
        x, y = ((at - self.parts.place[which][item]) / self.parts.step[which][item]).T
        forms, k = np.array(self._lattice.sides), self._turn[which][item]
        seen = forms[k].T, forms[(k + 1) % len(forms)].T
        s, t = (a + b * x + c * y for a, b, c in seen)
        far = s + t if self._lattice.sloped else np.maximum(s, t)
        near = np.ones(len(which))
        np.minimum.at(near, item, np.where(far > 0, far, 1.0))
        times = np.maximum(np.ceil(-np.log2(near)), 1).astype(np.int64)
        return which, times

    def places(self, site: Array) -> tuple[Array, Array, Array]:
        """Limit face, u and v of places."""
        u, v = np.moveaxis(np.ldexp(self.at[site].astype(float), -BITS), -1, 0)
        return self.face[self.row[site]], u, v

    def welded(self, mesh: Mesh) -> tuple[Array, Array]:
        """The points of all places (S,), and a place of each point (V,).

        `mesh` is the cage, or that of a channel, which has the same faces and half-edges.
        """
        line, start, speed = self._lines(mesh)
        row, K = self.row, len(self.face)
        vertices, faces = mesh.n_vertices, mesh.n_faces
        lines = vertices + faces + mesh.n_edges
        key = np.column_stack([lines + K + row, self.at])
        # ways to the middles of n-gons end at edges
        for k in sorted(range(len(self._ends)), key=lambda k: k in (0, 3)):
            on, step = self._along(k, self.at)
            here = row[on]
            of = line[here, k]
            key[on, 0] = vertices + np.where(of < mesh.n_edges, of, faces + of)
            key[on, 1], key[on, 2] = start[here, k] + speed[here, k] * step[on], 0
        for k, end in enumerate(self._ends):
            there = (self.at == WHOLE * end).all(axis=1)
            on = np.flatnonzero(there & (self._whole[row] | (k == 0)))
            corner = self._corner[row[on]] + k
            key[on] = np.column_stack([mesh.indices[corner], 0 * on, 0 * on])
            if k == 2:
                on = np.flatnonzero(there & ~self._whole[row])
                face = mesh.corner_face[self._corner[row[on]]]
                key[on] = np.column_stack([vertices + mesh.n_edges + face, 0 * on, 0 * on])
        _, _, number = _distinct(key[:, 0], key[:, 1:])
        place = np.empty(int(number.max(initial=-1)) + 1, dtype=np.int64)
        place[number[::-1]] = np.arange(len(number))[::-1]
        return number, place

    def normals(
        self, surface: LimitSurface, number: Array, n_points: int, workers: int
    ) -> tuple[Array, Array]:
        """The normals of all places, as rows (S,) of normals (K, 3), one for each side of a point.

        `number` has the points of places.
        """
        known = surface.normal(*self.places(np.arange(len(number))), workers=workers)
        side, chosen = sides(number, known, n_points)
        return side, known[chosen]


def _distinct(first: Array, rest: Array) -> tuple[Array, Array, Array]:
    """Different pairs of (n,) and (n,) or (n, m) in order, and which of them each is, (n,)."""
    number, kept = numbered([*np.atleast_2d(rest.T)[::-1], first])
    return first[kept], rest[kept], number
