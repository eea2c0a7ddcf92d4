"""Patches of dual schemes: squares that have a point each, amid others.

The first step makes a square of each corner of a face; what lies beyond boundaries are squares,
too, whose points are reflections. From there on all is smooth. A square is one patch when at most
one of its corners is not amid four squares; otherwise it is split into its children. Only corners
at vertices and in the middle of faces of the cage are such corners, and they are opposite: after
one split no square has two.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.connectivity import Fans
from limitsurf.cage.mesh import Mesh
from limitsurf.numbers import NumberType
from limitsurf.patches import neighbourhood
from limitsurf.patches.dual_squares import Squares, first_squares
from limitsurf.patches.table import NO_LIMIT, REGULAR, STRIP, PatchTable
from limitsurf.refine.dual import Rim, circle, masks, rim_rows
from limitsurf.rules import Rules
from limitsurf.scheme import lattice
from limitsurf.topology import MeshPart, corners_of

Array = NDArray[Any]


def patch_table(mesh: Mesh, rules: Rules, number: NumberType) -> PatchTable:
    """The patches of a cage, whichever kind of scheme there is."""
    kind = DualPatchTable if rules.scheme.lattice.dual else PatchTable
    return kind(mesh, rules, number)


@dataclass(frozen=True, eq=False)
class _Level:
    """Squares of a level, those that are to be covered by patches, and the points of all."""

    squares: Squares
    numbers: Array  # (n,) their control points, -1 where there are none
    which: Array  # (m,) squares to be covered
    slot: Array  # (m,) their places in the codes
    turn: Array  # (m,) at which corner of the domain their corner 0 lies


class DualPatchTable(PatchTable):
    """Patches of all limit faces of a dual scheme; see `PatchTable`.

    Strips are quads amid quads, four around each vertex there: four pieces of the spline over the
    vertices of the cage themselves.
    """

    def _build(self, cage: Mesh, rules: Rules, limit_faces: Array) -> None:
        rest = self._centers(cage, rules, limit_faces)
        if not len(rest):
            return
        level = self._first(cage, rules, limit_faces, rest)
        for _ in range(2):
            level = self._covered(level)
            if not len(level.which):
                return
            level = self._children(level)
        level = self._covered(level)
        assert not len(level.which)

    def _centers(self, cage: Mesh, rules: Rules, limit_faces: Array) -> Array:
        """Add the quads amid others; return which faces with limits are none."""
        primal, faces = lattice.QUADS, np.flatnonzero(~rules.without_limit(cage))
        valence = np.maximum(cage.connectivity.valences, 0)
        valence[cage.indices[cage.sizes[cage.corner_face] != primal.face_size]] = 0
        first = cage.connectivity.first(faces)
        turn = np.zeros(len(faces), dtype=np.int8)
        found, start = neighbourhood.smooth_faces(cage, primal, first, turn, valence)
        here = np.flatnonzero(found == primal.valence)
        known = cage, primal, cage.twin, cage.indices, first[here], start[here]
        grid = neighbourhood.templates(*known)
        self.controls[STRIP] = np.zeros((0, grid.shape[1]), np.int32)
        self._add(STRIP, grid, limit_faces[faces[here]], turn[here])
        self.sharpness = self._number.full(len(here), self._number.zero)
        return np.delete(faces, here)

    def summary(self) -> list[tuple[str, int]]:
        """How many limit faces are covered in which way, as (reason, number) pairs."""
        counts = dict(super().summary())
        centers = counts.pop("one strip along a semi-sharp crease", 0)
        one = "one regular patch"
        return [(one, n) for n in [counts.pop(one, 0) + centers] if n] + list(counts.items())

    def typed(self, cage: Mesh, rules: Rules, number: NumberType) -> PatchTable:
        """The table of the same cage for numbers of another type."""
        return DualPatchTable(cage, rules, number)

    @property
    def with_limit(self) -> Array:
        """Limit faces that have a limit all over, (n_limit_faces,) bool."""
        code, count = self.codes[: self.n_limit_faces], len(self.lattice.children)
        found, split = code != NO_LIMIT, np.flatnonzero(code <= -2)
        first = self.n_limit_faces + count * (-2 - code[split].astype(np.int64))
        parts = self.codes[first[:, None] + np.arange(count)]
        found[split] = (parts != NO_LIMIT).all(axis=1)
        return np.asarray(found)

    def _first(self, cage: Mesh, rules: Rules, limit_faces: Array, rest: Array) -> _Level:
        """The squares at the corners of some faces of a cage, and of those around them."""
        near = np.zeros(cage.n_vertices, dtype=bool)
        near[cage.indices[corners_of(cage, rest)[0]]] = True
        part = MeshPart.of(cage, near[cage.indices])
        mesh, number = part.mesh, self._number
        fans = Fans.of(mesh.connectivity, mesh.twin)
        rim = None if rules.boundary == "none" else Rim.of(mesh, fans)
        # the points around boundary vertices of one face that follow the curve are in one plane:
        # there a spline has normals that are limits, which an eigenbasis knows
        lone = rules.boundary == "edge_only"
        squares = first_squares(mesh, rim, lone, self.lattice.valence)
        points = np.empty(mesh.n_corners, dtype=np.int32)
        for n in np.unique(mesh.sizes).tolist():
            faces = np.flatnonzero(mesh.sizes == n)
            corners = mesh.offsets[faces][:, None] + np.arange(n)
            rings = part.vertices[mesh.indices[corners]].astype(np.int32)
            points[corners] = self._step(rings, f"face {part.faces[faces[0]]}")
        if rim is not None and len(rim.vertex):
            beyond = np.full(len(squares) - mesh.n_corners, -1, dtype=np.int32)
            named = replace(rim, vertex=part.vertices[rim.vertex], ends=part.vertices[rim.ends])
            for place, rows in rim_rows(cage, named, rules, points, number):
                beyond[place - mesh.n_corners] = self._extend(*rows)
            points = np.concatenate([points, beyond])
        # quads are split first, others are so many limit faces
        size, count = self.lattice.face_size, len(self.lattice.children)
        corner = np.arange(mesh.n_corners) - mesh.offsets[mesh.corner_face]
        wanted = np.zeros(cage.n_faces, dtype=bool)
        wanted[rest] = True
        limit = wanted[part.faces]
        split = (mesh.sizes == size) & limit
        splits = np.cumsum(split) - 1
        n_codes, first = len(self.codes), limit_faces[part.faces]
        more = np.full(count * int(split.sum()), NO_LIMIT, dtype=np.int32)
        self.codes = np.append(self.codes, more)
        self.codes[first[split]] = -2 - splits[split]
        whole = split[mesh.corner_face]
        parts = np.array(self.lattice.parts)[corner % size]
        slot = first[mesh.corner_face] + corner
        slot[whole] = n_codes + count * splits[mesh.corner_face[whole]] + parts[whole]
        turn = np.where(whole, corner, 0)
        with_limit = limit[mesh.corner_face] & (squares.around[4 * np.arange(mesh.n_corners)] > 0)
        which = np.flatnonzero(with_limit)
        return _Level(squares, points, which, slot[which], turn[which])

    def _step(self, rings: Array, where: str) -> Array:
        """The points that a step makes at the corners of n-gons, (r, n), of their points (r, n)."""
        n = rings.shape[1]
        if not self._gathers(n):
            mask = masks(self._scheme, n, self._number, where)
            turns = (np.arange(n)[:, None] + np.arange(n)) % n  # of a corner, from it on
            columns, weights = rings[:, turns].ravel(), np.tile(mask, rings.size)
            return self._extend(np.full(rings.size, n), columns, weights).reshape(rings.shape)
        scheme: Any = self._scheme
        waves = scheme.waves
        own, once = float(waves.own), float(waves.once)
        cos, sin = once * circle(n)
        weights = np.stack([np.full(n, own), 1 - own - cos - sin, cos, sin], axis=1)
        mean = np.broadcast_to(self._gathered(rings)[:, None], (*rings.shape, 3))
        columns = np.concatenate([rings[..., None], mean], axis=2)
        rows = np.full(rings.size, 4), columns.ravel(), np.tile(weights.ravel(), len(rings))
        return self._extend(*rows).reshape(rings.shape)

    def _gathers(self, n: int) -> bool:
        """Whether the points around a vertex or face are told by few; in float64 alone."""
        scheme: Any = self._scheme
        return not self._number.exact and scheme.gathers(n)

    def _gathered(self, rings: Array) -> Array:
        """The mean of n-gons, and this plus its parts that turn once from corner 0 on, (r, 3)."""
        r, n = rings.shape
        ones = np.ones(n)
        masks = np.stack([ones / n, *(ones / n + 2 / n * wave for wave in circle(n))])
        rows = np.full(3 * r, n), np.repeat(rings, 3, axis=0).ravel(), np.tile(masks.ravel(), r)
        return self._extend(*rows).reshape(r, 3)

    def _covered(self, level: _Level) -> _Level:
        """Add the patches of squares; what is left of the level."""
        squares, which, numbers_ = level.squares, level.which, level.numbers
        corners = 4 * which[:, None] + np.arange(4)
        regular = self.lattice.valence
        odd = squares.special[corners]
        count = odd.sum(axis=1)
        special = odd.argmax(axis=1)
        plain = np.flatnonzero(count == 0)
        start = -level.turn[plain] % 4
        first = 4 * which[plain] + start
        ring = squares.rings(first, regular) // 4
        grid = np.empty((len(plain), 9), dtype=np.int32)
        near = [self.lattice.template.index((1 + i, 1 + j)) for i, j in self.lattice.star]
        far = [self.lattice.template.index(place) for place in self.lattice.outer]
        grid[:, near] = numbers_[ring]
        grid[:, far] = numbers_[squares.beside(first)]
        self._add(REGULAR, grid, level.slot[plain], np.zeros(len(plain), dtype=np.int8))
        single = np.flatnonzero(count == 1)
        first = 4 * which[single] + special[single]
        for n, here in squares.by_size(first):
            corner, own = first[here], single[here]
            sector = self._scheme.sector("interior", n)
            if self._gathers(n):
                sector = replace(sector, gathered=True)
                ring = self._turned(squares, numbers_, corner, n)
            else:
                ring = numbers_[squares.rings(corner, n) // 4]
            controls = np.concatenate([ring, numbers_[squares.beside(corner)]], axis=1)
            turn = (level.turn[own] + special[own]) % 4
            self._add(self._kind(sector), controls, level.slot[own], turn.astype(np.int8))
        rest = count > 1
        return _Level(squares, numbers_, which[rest], level.slot[rest], level.turn[rest])

    def _turned(self, squares: Squares, numbers: Array, corners: Array, n: int) -> Array:
        """The gathered rings (., 6) of `Sector` at corners amid n squares."""
        first, ring, place = squares.places(corners, n)
        around = squares.rings(first, n) // 4
        mean = self._gathered(numbers[around])[ring]  # (., 3)
        cos, sin = circle(n)[:, place]
        weights = [1 - cos - sin, cos, sin, 1 - cos + sin, -sin, cos]
        rows = np.full(2 * len(ring), 3), np.tile(mean, 2).ravel(), np.stack(weights, 1).ravel()
        waves = self._extend(*rows).reshape(-1, 2)
        after, before = squares.left(corners), squares.right(corners)
        near = numbers[np.stack([corners, after, before], axis=1) // 4]
        return np.concatenate([near, mean[:, :1], waves], axis=1)

    def _children(self, level: _Level) -> _Level:
        """The children of the squares that are to be covered, and of those around them."""
        squares, count = level.squares, len(self.lattice.children)
        corners = (4 * level.which[:, None] + np.arange(4)).ravel()
        touched = np.zeros(len(squares.twin), dtype=bool)
        for n, here in squares.by_size(corners):
            first, *_ = squares.places(corners[here], n)
            touched[squares.rings(first, n)] = True
        kept = np.flatnonzero(touched.reshape(-1, 4).any(axis=1))
        near = squares.part(kept)
        own = np.full(4 * len(kept), -1, dtype=np.int32)
        known = touched.reshape(-1, 4)[kept].ravel()
        points = level.numbers[kept]
        made = np.flatnonzero(known)
        for n, here in near.by_size(made):
            first, *_ = near.places(made[here], n)
            rings = near.rings(first, n)
            own[rings] = self._step(points[rings // 4], "a vertex or a face")
        n_codes, splits = len(self.codes), np.arange(len(level.which))
        split = (n_codes - self.n_limit_faces) // count + splits
        self.codes[level.slot] = -2 - split
        more = np.full(count * len(splits), NO_LIMIT, dtype=np.int32)
        self.codes = np.append(self.codes, more)
        corner = np.tile(np.arange(4), len(splits))
        turn = (np.repeat(level.turn, 4) + corner) % 4
        slot = n_codes + np.repeat(count * splits, count) + np.array(self.lattice.parts)[turn]
        which = (4 * np.searchsorted(kept, level.which)[:, None] + np.arange(4)).ravel()
        return _Level(near.split(), own, which, slot, turn)
