"""Limit faces cut into parts on which the surface is near to triangles: proved, not sampled.

Parts are halves of halves of limit faces, so that their corners are multiples of powers of 1/2 and
those of neighbours meet. On most the surface is one polynomial, of which second derivatives bound
the distance to a triangle. At a special corner, where they need not exist, that is bounded by hulls
of the rings around it: ``derivations/tessellation.py``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.caching import cached_property
from limitsurf.pieces import bernstein
from limitsurf.query.chords import distance, length, polygon_error, slide
from limitsurf.query.cones import WELDED, Poles, Turning, cone, facing
from limitsurf.query.hulls import Hulls, on_triangle
from limitsurf.query.index import Cells
from limitsurf.query.polynomials import Form
from limitsurf.query.records import Rows
from limitsurf.query.wanted import Wanted, longest

if TYPE_CHECKING:
    from limitsurf.pieces.beyond import RingCells
    from limitsurf.scheme.lattice import Lattice

Array = NDArray[Any]

BITS = 50  # u and v are multiples of 2^-50
WHOLE = 1 << BITS
FINEST = 1 << 6  # the smallest size of a part: there is a dyadic point inside

_RINGS = 5  # of cells that bound what is at a special corner, before what remains is bounded whole
# halvings, and rings around special corners, after which angles are no longer asked for: of these
# fewer if normals have no limit
_DEEPEST, _DEEPEST_RING, _NO_LIMIT = 10, 16, 8
_PORTION = 4096  # parts that are handled at once
_PORTION_OF_CORNERS = 256
_MIGHT = 6  # so many times too large bounds by second derivatives may be larger than by hulls


@dataclass(frozen=True, eq=False, slots=True)
class Parts(Rows):
    """Parts of limit faces.

    Attributes
    ----------
    face : (L,) int64
    place : (L, 2) int64
        Corner 0 in units of 2^-BITS of u and v.
    step : (L, 2) int64
        From there along the sides; both negative in triangles turned by half a turn.
    error : (L,) float64
        Bounds of the distance to triangles between the corners, in the unit of the cells.
    bent : (L, 3, 3) float64
        Means of second derivatives (ss, st, tt) in the parts' own parameters.
    loose : (L, 3) float64
        By how much these differ from that anywhere in the part.
    seen : (L,) float64
        These bounds as a view has them, in pixels; -1 out of its sight.
    turn : (L,) float64
        Bounds of angles between normals, in radians; 0 if not asked for, NaN where there is none.
    root : (L,) int64
        The polynomial on it; -1 at special corners.
    corner, ring : (L,) int64
        Which special corner it is at, -1 elsewhere, and how many rings are cut off.
    """

    face: Array
    place: Array
    step: Array
    error: Array
    bent: Array
    loose: Array
    seen: Array
    turn: Array
    root: Array
    corner: Array
    ring: Array


class Division:
    """Limit faces divided until nothing exceeds what is wanted.

    Parameters
    ----------
    cells : Cells
        Of a surface, without rings around special corners.
    kept : (F,) bool
        The limit faces that are wanted.

    Attributes
    ----------
    wanted : Wanted
        In the unit of the cells. Parts with too long edges are halved across their longer sides,
        others where they bend most.
    turning : Turning
    hulls : Hulls
    """

    wanted: Wanted

    def __init__(self, cells: Cells, kept: Array) -> None:
        self.cells, self.form = cells, cells.form
        self.turning, self.hulls = Turning(cells.lattice, cells.form), Hulls(cells.form)
        self._kept = kept[cells.face]
        self._points = [cells.points]  # of all polynomials
        n = len(cells.points)
        self._frames = [_integers(cells.origin[:n], cells.size[:n])]
        self._faces = [cells.face[:n]]
        self._roots, self._known = n, 0
        self._ways = _ways(self.form, cells.lattice)

    def first(self) -> Parts:
        """The coarsest parts that are good enough by themselves."""
        n = len(self.cells.points)
        cells, corners = (np.flatnonzero(x) for x in (self._kept[:n], self._kept[n:]))
        found = [self._refined(cells[:0])]
        for start in range(0, len(cells), _PORTION):
            found.append(self._refined(cells[start : start + _PORTION]))
        found += self._around(corners, np.zeros(len(corners), dtype=np.int64))
        return Parts.joined(found)

    def finer(self, parts: Parts, which: Array, times: Array) -> Parts:
        """The parts with some divided, those at special corners so many times, others once."""
        kept = np.ones(len(parts), dtype=bool)
        kept[which] = False
        found = [parts[kept]]
        self._known = int(kept.sum())
        special = parts.corner[which] >= 0
        flat = parts[which[~special]]
        for start in range(0, len(flat), _PORTION):
            some = flat[start : start + _PORTION]
            points = self.points(some)
            found.append(self._divided(*self._halves(some, points, self._second(points))))
        deep, times = parts[which[special]], times[special]
        for k in range(int(times.max(initial=0))):
            here = times > k
            found += self._rings(deep.corner[here], deep.ring[here] + k)
        found += self._around(deep.corner, deep.ring + times)
        return Parts.joined(found)

    def points(self, parts: Parts) -> Array:
        """Bernstein coefficients (L, n, 3) of parts that are not at special corners."""
        place, step = (x[parts.root] for x in self._roots_frames())
        frame = np.zeros((len(parts), 3, 2))
        frame[:, 0] = (parts.place - place) / step
        frame[:, 1, 0], frame[:, 2, 1] = (parts.step / step).T
        return np.asarray(np.matmul(self.form.part(frame), self._points[0][parts.root]))

    def judged(
        self, corners: Array, error: Array, beside: Callable[[Array], Array] | None
    ) -> Array:
        """The errors (L,) as they are seen; arguments as for `Sight.seen`."""
        sight = self.wanted.sight
        return error if sight is None else sight.seen(corners, error, beside)

    def might_do(self, error: Array) -> Array:
        """Which errors (L,) are so little too large that another bound may do."""
        if self.wanted.view is not None:
            return np.zeros(len(error), dtype=bool)
        return np.asarray((error > self.wanted.chord) & (error < _MIGHT * self.wanted.chord))

    def too_deep(self, parts: Parts) -> Array:
        """Which parts, not at special corners, are too small to ask for angles, (L,)."""
        whole = np.abs(self._roots_frames()[1][parts.root])
        whole = np.maximum(whole, WHOLE >> 2 * _DEEPEST)
        return np.asarray((np.abs(parts.step) << _DEEPEST <= whole).any(axis=1))

    # ------------------------------------------------------------------ one polynomial

    def _roots_frames(self) -> tuple[Array, Array]:
        """Places and steps of all polynomials."""
        if len(self._frames) > 1:
            self._points = [np.concatenate(self._points)]
            frames = [np.concatenate(x) for x in zip(*self._frames, strict=True)]
            self._frames = [(frames[0], frames[1])]
        return self._frames[0]

    def _add(self, face: Array, place: Array, step: Array, points: Array) -> Array:
        """Polynomials that are new: their numbers."""
        self._points.append(points)
        self._frames.append((place, step))
        self._faces.append(face)
        self._roots += len(face)
        return np.arange(self._roots - len(face), self._roots)

    def _refined(self, root: Array) -> Parts:
        """The parts of cells of the surface."""
        place, step = (x[root] for x in self._frames[0])
        return self._divided(self.cells.face[root], place, step, root, self.cells.points[root])

    def _divided(self, face: Array, place: Array, step: Array, root: Array, points: Array) -> Parts:
        """The parts of parts with polynomials (L, n, 3)."""
        found, pending = [], [(face, place, step, root, points)]
        waiting = len(face)
        while pending:
            face, place, step, root, points = pending.pop()
            waiting -= len(face)
            second = self._second(points)
            parts = self._bounded(face, place, step, root, points, second)
            far = self.wanted.excess(points[:, self.form.corners], parts.seen)
            excess = np.maximum(far, self.wanted.turned(parts.turn))
            done = excess <= 1
            found.append(parts[done])
            self._known += int(done.sum())
            rest = np.flatnonzero(~done)
            least = self._known + waiting + len(rest)
            self.wanted.check(least, self._known + waiting + float(excess[rest].sum()))
            for start in range(0, len(rest), _PORTION):
                some = rest[start : start + _PORTION]
                known = second[0][some], second[1][some]
                pending.append(self._halves(parts[some], points[some], known))
                waiting += len(pending[-1][0])
        return Parts.joined(found)

    def _bounded(
        self, face: Array, place: Array, step: Array, root: Array, points: Array,
        second: tuple[Array, Array],
    ) -> Parts:  # fmt: skip
        """Parts with all that bounds them."""
        form, corners = self.form, points[:, self.form.corners]
        error, none = polygon_error(form.ends, *second, corners), np.full(len(face), -1)
        near = np.flatnonzero(self.might_do(error))
        error[near] = np.minimum(error[near], self.hulls.whole(points[near], self.wanted.chord))
        seen = self.judged(corners, error, lambda x: polygon_error(form.ends, *second, corners, x))
        turn = np.zeros(len(face))
        if self.wanted.turning:
            here = np.flatnonzero(seen >= 0)
            for start in range(0, len(here), _PORTION // 4):
                some = here[start : start + _PORTION // 4]
                turn[some] = self.turning.whole(points[some])
        known = error, *second, seen, turn, root, none, 0 * none
        parts = Parts(face, place, step, *known)
        wide = np.flatnonzero(self.wanted.turned(turn) > 1)
        if len(wide):
            never = self.too_deep(parts[wide]) | self.turning.nowhere(points[wide])
            turn[wide[never]] = np.nan
        return parts

    def _second(self, points: Array) -> tuple[Array, Array]:
        """Means (L, 3, 3) of second derivatives, and how far others are from them (L, 3)."""
        n = self.form.size
        found = np.matmul(self.form.derivatives[3:].reshape(3 * n, n), points)
        found = found.reshape(len(points), 3, n, 3)
        middle = (found.min(axis=2) + found.max(axis=2)) / 2
        return middle, length(found - middle[:, :, None]).max(axis=2)

    def _halves(self, parts: Parts, points: Array, second: tuple[Array, Array]) -> Any:
        """Parts of parts, as `_divided` takes them."""
        bent, loose = second
        corners = points[:, self.form.corners]
        if len(self._ways) > 1:
            along = corners[:, [1, 3]] - corners[:, :1]
            slid = bent[:, [0, 2]] - slide(bent[:, [0, 2]], along)
            size = length(slid) + loose[:, [0, 2]]
            sides = length(corners - np.roll(corners, -1, axis=1))
            wide = np.maximum(sides[:, :2], sides[:, 2:]).argmax(axis=1)
            twist = length(bent[:, 1]) > size.max(axis=1)
            long = longest(corners) > self.wanted.edge
            way = np.where(twist | long, wide, size.argmax(axis=1))
            turned = self.wanted.turned(parts.turn)
            steep = ~long & (turned > np.maximum(self.wanted.excess(corners, parts.seen), 1))
            if steep.any():
                way[steep] = _turns_most(bent[steep], loose[steep], corners[steep])
        else:
            way = np.zeros(len(parts), dtype=np.int64)
        found = []
        for k, (frames, matrices) in enumerate(self._ways):
            here = np.flatnonzero(way == k)
            new = np.matmul(matrices, points[here, None]).reshape(-1, *points.shape[1:])
            step = parts.step[here, None]
            place = parts.place[here, None] + step * frames[:, 0] // 2
            steps = step * frames[:, [1, 2], [0, 1]] // 2
            face, root = (np.repeat(x[here], len(frames)) for x in (parts.face, parts.root))
            found.append((face, place.reshape(-1, 2), steps.reshape(-1, 2), root, new))
        made = [np.concatenate(x) for x in zip(*found, strict=True)]
        if (np.abs(made[2]) < FINEST).any():
            raise ValueError(_TOO_FINE)
        return made

    # ------------------------------------------------------------------ special corners

    def _around(self, which: Array, ring: Array) -> list[Parts]:
        """The parts of what is at special corners from some rings on."""
        found = []
        while len(which):
            error, turn, points = self._corners(which, ring)
            seen = self.judged(points, error, None)
            turn = np.where(seen < 0, 0, self._where_asked(turn, which, ring))
            far = self.wanted.excess(points, seen)
            done = np.maximum(far, self.wanted.turned(turn)) <= 1
            which_, ring_ = which[done], ring[done]
            place, step = self._frame(which_, ring_)
            zero, none = np.zeros((len(which_), 3, 3)), np.full(len(which_), -1)
            face = self.cells.face[len(self.cells.points) + which_]
            known = face, place, step, error[done], zero, zero[:, 0], seen[done], turn[done]
            found.append(Parts(*known, none, which_, ring_))
            self._known += len(which_)
            which, ring = which[~done], ring[~done]
            self.wanted.check(self._known + len(which))
            found += self._rings(which, ring)
            ring = ring + 1
        return found

    def _where_asked(self, turn: Array, which: Array, ring: Array) -> Array:
        """Angles (M,) at special corners, NaN from where on they are no longer asked for."""
        if not self.wanted.turning:
            return turn
        limit = self.poles.cones(which, ring + _RINGS)[1] < np.pi
        last = ring >= np.where(limit, _DEEPEST_RING, _NO_LIMIT)
        return np.where((self.wanted.turned(turn) > 1) & last, np.nan, turn)

    @cached_property
    def poles(self) -> Poles:
        """Cones of normals at special corners."""
        return Poles(self.cells.beyond, self.cells.lattice, self.form)

    def _frame(self, which: Array, ring: Array) -> tuple[Array, Array]:
        """Where what is at special corners from some rings on lies."""
        leaf = len(self.cells.points) + which
        origin, size = self.cells.origin[leaf], self.cells.size[leaf]
        half = np.ldexp(1.0, -ring)[:, None]
        place, step = _integers(
            origin + size * self.form.ends[self.cells.beyond.corner(which)] * (1 - half),
            size * half,
        )
        if (np.abs(step) < FINEST).any():
            raise ValueError(_TOO_FINE)
        return place, step

    def _rings(self, which: Array, ring: Array) -> list[Parts]:
        """The parts of the cells of a ring around special corners."""
        found = []
        for start in range(0, len(which), _PORTION // 4):
            here = which[start : start + _PORTION // 4]
            made = self.cells.beyond.cells(here, ring[start : start + len(here)])
            leaf, count = len(self.cells.points) + here, made.points.shape[1]
            points = self.cells.beyond.limits[here][:, None, None] + made.points
            origin, size = self.cells.origin[leaf][:, None], self.cells.size[leaf][:, None]
            place, step = _integers(origin + size * made.origin, size * made.size)
            if (np.abs(step) < FINEST).any():
                raise ValueError(_TOO_FINE)
            face = np.repeat(self.cells.face[leaf], count)
            known = face, place.reshape(-1, 2), step.reshape(-1, 2)
            flat = points.reshape(-1, *points.shape[2:])
            root = self._add(*known, flat)
            found.append(self._divided(*known, root, flat))
        return found

    def _corners(self, which: Array, ring: Array) -> tuple[Array, Array, Array]:
        """Distances and angles (M,) to triangles at special corners; of these corners (M, c, 3)."""
        beyond, size = self.cells.beyond, len(self.form.ends)
        (error, turn), points = np.empty((2, len(which))), np.empty((len(which), size, 3))
        turn = beyond.corner(which)
        for k in np.unique(turn).tolist():
            alike = np.flatnonzero(turn == k)
            for start in range(0, len(alike), _PORTION_OF_CORNERS):
                here = alike[start : start + _PORTION_OF_CORNERS]
                found = self._corner(k, which[here], ring[here])
                error[here], turn[here], points[here] = found
        return error, turn, points + beyond.limits[which][:, None]

    def _corner(self, k: int, which: Array, ring: Array) -> tuple[Array, Array, Array]:
        """The same at corner k of parts, relative to the limit there."""
        beyond, form = self.cells.beyond, self.form
        size = len(form.ends)
        rings = [beyond.cells(which, ring + n) for n in range(_RINGS)]
        # corners of the part are corners of cells
        half = np.ldexp(1.0, -ring[:1])
        wanted = form.ends[k] * (1 - half) + half * form.ends
        there = rings[0].origin[0][:, None] + rings[0].size[0][:, None] * form.ends
        cell, corner = ((there[:, :, None] == wanted).all(axis=3)).nonzero()[:2]
        which_corner = (there[cell, corner][:, None] == wanted).all(axis=2).argmax(axis=1)
        points = np.zeros((len(which), size, 3))
        points[:, which_corner] = rings[0].points[:, cell, form.corners[corner]]
        of_corner = np.full(size, -1)
        of_corner[which_corner] = cell
        after = [(k + 1 + n) % size for n in range(size - 1)]
        split, quarters = _corner_splits(self.cells.lattice, form)
        error = beyond.reach(which, ring + _RINGS, np.zeros((len(which), 3)))[0]
        triangles = points[:, [[k, *pair] for pair in pairwise(after)]]
        turn = self._corner_turn(which, ring, triangles, rings)
        for n, pair in enumerate(pairwise(after)):
            triangle = points[:, [k, *pair]]
            if size == 3:
                hulls = [(quarters, slice(None))]
            else:
                # that across from the special corner is of two triangles
                whole = (quarters, of_corner[[after[0], after[2]][n]])
                hulls = [whole, (split[k % 2][n ^ (k >= 2)], of_corner[after[1]])]
            for level, ring_cells in enumerate(rings):
                for (fine, plain), cells in hulls:
                    found = ring_cells.points[:, cells]
                    found = np.matmul(plain if level else fine, found).reshape(len(which), -1, 3)
                    error = np.maximum(error, distance(found, triangle).max(axis=1))
        return error, turn, points

    def _corner_turn(
        self, which: Array, ring: Array, triangles: Array, rings: list[RingCells]
    ) -> Array:
        """The largest angles (M,) of triangles (M, k, 3, 3) at special corners."""
        turn = np.zeros(len(which))
        if not self.wanted.turning:
            return turn
        limit, beyond = self.poles.cones(which, ring + _RINGS)
        axes = facing(triangles)
        for axis in axes.swapaxes(0, 1):
            far = np.arctan2(length(np.cross(axis, limit)), (axis * limit).sum(axis=1)) + beyond
            turn = np.maximum(turn, np.where(np.isnan(far), np.pi, far))
        for ring_cells in rings:
            for cell in ring_cells.points.swapaxes(0, 1):
                normals, noise = self.turning.normals(cell)
                for axis in axes.swapaxes(0, 1):
                    turn = np.maximum(turn, cone(normals, noise, axis))
        # those between corners are off by as much on the other side
        return np.where(turn < np.pi / 2, np.minimum(2 * turn + WELDED, np.pi), np.pi)


def _turns_most(bent: Array, loose: Array, corners: Array) -> Array:
    """Along which parameter the normals of parts turn most, 0 or 1: (L,)."""
    one, other = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    axis, sides = np.cross(one, other), np.stack([one - other, one + other], axis=1) / 2
    with np.errstate(invalid="ignore", divide="ignore"):
        axis = axis / length(axis)[:, None]
        by = (np.abs(np.matmul(bent, axis[:, :, None])[:, :, 0]) + loose)[:, :, None]
        found = by / length(sides)[:, None]
    along = np.maximum(found[:, 0, 0], found[:, 1, 1]), np.maximum(found[:, 2, 1], found[:, 1, 0])
    return np.asarray(np.nan_to_num(np.stack(along, axis=1)).argmax(axis=1))


_TOO_FINE = "float64 cannot tell the parts apart that this tolerance needs: allow for more"


@lru_cache(maxsize=32)
def _corner_splits(lattice: Lattice, form: Form) -> tuple[Any, tuple[Array, Array]]:
    """Matrices onto hulls of halves of cells by both diagonals, and of whole cells.

    Pairs: of what is cut into four, and as it is.
    """
    if lattice.sloped:
        return (), (np.concatenate(_ways(form, lattice)[0][1]), np.eye(form.size))
    quarters = [second @ first for first in form.halves[0] for second in form.halves[1]]
    ways = ((0, 1, 2), (0, 2, 3)), ((1, 2, 3), (1, 3, 0))
    halves = tuple(tuple(on_triangle(form, form.ends[list(x)]) for x in both) for both in ways)
    return halves, (np.concatenate(quarters), np.eye(form.size))


@lru_cache(maxsize=32)
def _ways(form: Form, lattice: Lattice) -> list[tuple[Array, Array]]:
    """Ways to divide a part: frames (c, 3, 2) in halves of its steps, and matrices (c, n, n)."""
    if not lattice.sloped:
        frames = np.round(2 * form.frames).astype(np.int64)
        return list(zip(frames, form.halves, strict=True))
    frames, parts = bernstein.children(lattice, form.exponents)
    return [((2 * frames).astype(np.int64), parts)]


def _integers(origin: Array, size: Array) -> tuple[Array, Array]:
    """Places and steps in units of 2^-BITS."""
    return (origin * WHOLE).astype(np.int64), (size * WHOLE).astype(np.int64)
