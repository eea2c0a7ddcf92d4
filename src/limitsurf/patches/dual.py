"""Patches of dual schemes: squares that have a point each, amid others.

The first step makes a square of each corner of a face; what lies beyond boundaries are squares,
too, whose points are reflections. From there on all is smooth. A square is one patch when at most
one of its corners is not amid four squares; otherwise it is split into its children. Only corners
at vertices and in the middle of faces of the cage are such corners, and they are opposite: after
one split no square has two.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.connectivity import Fans
from limitsurf.cage.mesh import Mesh
from limitsurf.numbers import NumberType
from limitsurf.patches.dual_squares import Squares, first_squares
from limitsurf.patches.points import Rows
from limitsurf.patches.table import NO_LIMIT, REGULAR, PatchTable
from limitsurf.refine.dual import Rim, corner_rows, masks, rim_rows
from limitsurf.rules import Rules

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
    """Patches of all limit faces of a dual scheme; see `PatchTable`."""

    def _build(self, cage: Mesh, rules: Rules, limit_faces: Array) -> None:
        level = self._first(cage, rules, limit_faces)
        for _ in range(2):
            level = self._covered(level)
            if not len(level.which):
                return
            level = self._children(level)
        level = self._covered(level)
        assert not len(level.which)

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

    def _first(self, cage: Mesh, rules: Rules, limit_faces: Array) -> _Level:
        """The squares at the corners of the faces of a cage."""
        fans = Fans.of(cage.connectivity, cage.twin)
        rim = None if rules.boundary == "none" else Rim.of(cage, fans)
        # the points around boundary vertices of one face that follow the curve are in one plane:
        # there a spline has normals that are limits, which an eigenbasis knows
        lone = rules.boundary == "edge_only"
        squares = first_squares(cage, rim, lone, self.lattice.valence)
        points = self._extend(*corner_rows(cage, rules, self._number))
        if rim is not None and len(rim.vertex):
            beyond = np.full(len(squares) - cage.n_corners, -1, dtype=np.int32)
            for place, rows in rim_rows(cage, rim, rules, points, self._number):
                beyond[place - cage.n_corners] = self._extend(*rows)
            points = np.concatenate([points, beyond])
        # quads are split first, others are so many limit faces
        size, count = self.lattice.face_size, len(self.lattice.children)
        corner = np.arange(cage.n_corners) - cage.offsets[cage.corner_face]
        whole_face = cage.sizes == size
        splits = np.cumsum(whole_face) - 1
        n_codes = len(self.codes)
        limit = np.ones(cage.n_faces, dtype=bool)
        limit[cage.holes] = False
        more = np.full(count * int(whole_face.sum()), NO_LIMIT, dtype=np.int32)
        self.codes = np.append(self.codes, more)
        self.codes[limit_faces[:-1][whole_face & limit]] = -2 - splits[whole_face & limit]
        whole = whole_face[cage.corner_face]
        part = np.array(self.lattice.parts)[corner % size]
        slot = limit_faces[cage.corner_face] + corner
        slot[whole] = n_codes + count * splits[cage.corner_face[whole]] + part[whole]
        turn = np.where(whole, corner, 0)
        with_limit = limit[cage.corner_face] & (squares.around[4 * np.arange(cage.n_corners)] > 0)
        which = np.flatnonzero(with_limit)
        return _Level(squares, points, which, slot[which], turn[which])

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
            kind = self._kind(self._scheme.sector("interior", n))
            corner, own = first[here], single[here]
            ids = np.concatenate([squares.rings(corner, n) // 4, squares.beside(corner)], axis=1)
            turn = (level.turn[own] + special[own]) % 4
            self._add(kind, numbers_[ids], level.slot[own], turn.astype(np.int8))
        rest = count > 1
        return _Level(squares, numbers_, which[rest], level.slot[rest], level.turn[rest])

    def _children(self, level: _Level) -> _Level:
        """The children of the squares that are to be covered, and of those around them."""
        squares, count = level.squares, len(self.lattice.children)
        corners = (4 * level.which[:, None] + np.arange(4)).ravel()
        touched = np.zeros(len(squares.twin), dtype=bool)
        for n, here in squares.by_size(corners):
            touched[squares.rings(corners[here], n)] = True
        kept = np.flatnonzero(touched.reshape(-1, 4).any(axis=1))
        near = squares.part(kept)
        own = np.full(4 * len(kept), -1, dtype=np.int32)
        known = touched.reshape(-1, 4)[kept].ravel()
        points = level.numbers[kept]
        made = np.flatnonzero(known)
        for n, here in near.by_size(made):
            ring = near.rings(made[here], n) // 4
            mask = masks(self._scheme, n, self._number, "a vertex or a face")
            counts = np.full(len(here), n)
            rows: Rows = (counts, points[ring].ravel(), np.tile(mask, len(here)))
            own[made[here]] = self._extend(*rows)
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
