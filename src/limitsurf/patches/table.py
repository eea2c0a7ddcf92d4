"""Patch table: for each limit face its exact patches and their control points.

A face of the lattice is a patch as it is when all faces around its corners are such faces, nothing
semi-sharp is at them, and at most one corner is special: not regular in the sense of
`Sectors.regular`. Where the spline is a tensor product it is a patch too where a semi-sharp crease
of one sharpness runs along one of its sides and goes straight on at both ends
(``derivations/creases.py``). Where masks of edges depend on valences, other neighbours of its
corners are regular, too. Otherwise it is split into its children, another polygon into as many
as it has corners, by one refinement of its neighbourhood. Infinitely sharp edges part the mesh:
what lies beyond one is replaced by reflections, which is exact at regular vertices, or has no
influence. Where more than `tables.MOST_FACES` faces meet, their patches may share one copy of the
ring around them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import tables
from limitsurf.cage.mesh import Mesh
from limitsurf.numbers import NumberType
from limitsurf.patches import neighbourhood
from limitsurf.patches.level import Level
from limitsurf.patches.points import (
    Rows,
    converted,
    new_numbers,
    operator_of,
    some_rows,
    without_unused,
)
from limitsurf.rules import Rules, Sectors
from limitsurf.scheme.lattice import Lattice
from limitsurf.topology import first_limit_face

Array = NDArray[Any]

# kinds of patches; further ones are numbered as they occur
REGULAR, STRIP = 0, 1
NO_LIMIT = -1
# Sharpness below 10 is 0 after 10 refinements, n-gons are gone after one. The points that they make
# are regular then, but for centres of n-gons, and after two no face has two special corners
# (``derivations/isolation.py``). One more parts faces from irregular vertices beside their corners,
# where masks of edges depend on valences.
_DEEPEST = 11


class PatchTable:
    """Patches of all limit faces, and the control points beyond those of the cage.

    Control points are numbered: the vertices of the cage first, then the rows of each operator in
    `extras`, which combine points of lower number.

    Attributes
    ----------
    lattice : Lattice
    codes : (n_limit_faces + 4 n_splits,) int
        What covers each limit face, then each part of each split: a patch >= 0, `NO_LIMIT`, or
        ``-2 - s`` for split s. Parts are the `Lattice.children` by `Lattice.parts`.
    sectors : list
        By kind of patch: None for `REGULAR` and `STRIP`, the `Sector` of the special corner else.
    kind : (n_patches,) int
    row : (n_patches,) int
        Row of the patch in ``controls[kind]``.
    turn : (n_patches,) int
        Corner of the domain at which the special corner lies, or where the side begins along which
        a strip's crease runs; 0 if regular.
    controls : list of (patches, K) int arrays
        Control points by kind: those of regular patches and strips at the places of
        `Spline.template`; the others in the order of ``exact/matrices.py``. Kinds with shared
        rings have the outer ones alone, all of them; what is beyond a sharp side is not used.
    rings : dict
        The `SharedRings` of kinds of more than `tables.MOST_FACES` faces, which have one kind for
        all positions.
    sharpness : (strips,)
        Sharpness of the creases of strips.
    extras : list of operators
        Sparse rows, float64 or exact, over all control points of lower number. Integers are those
        of all types of numbers, see `typed`; these values and `sharpness` are of one.
    """

    def __init__(self, mesh: Mesh, rules: Rules, number: NumberType) -> None:
        self.lattice, self._scheme = rules.scheme.lattice, rules.scheme
        limit_faces = first_limit_face(mesh, self.lattice)
        self.n_limit_faces = int(limit_faces[-1])
        self.n_vertices = self.n_points = mesh.n_vertices
        self.extras: list[Any] = []
        self._number = number
        self.codes = np.full(self.n_limit_faces, NO_LIMIT, dtype=np.int32)
        self.kind, self.row = np.zeros((2, 0), np.int32)
        self.turn = np.zeros(0, np.int8)
        self.sectors: list[tables.Sector | None] = [None, None]
        width = len(self._scheme.spline.template)
        self.controls = [np.zeros((0, width), np.int32) for _ in self.sectors]
        self.rings: dict[int, SharedRings] = {}
        self.sharpness = np.zeros(0, dtype=number.dtype)
        self._kinds: dict[tables.Sector, int] = {}
        self._combined: list[Rows] = []
        self._early: list[int] = []  # rows of `controls` from before there was any of these
        # for each refinement, how many there were before it: patches of smooth faces and others,
        # all patches, points, codes
        self._splits: list[tuple[int, int, int, int]] = []
        self._build(mesh, rules, limit_faces)
        self._drop_unused()
        del self._kinds, self._combined, self._early, self._number

    @property
    def has_own_spokes(self) -> bool:
        """Whether edges at some special corner have masks of their own: then pieces are finer."""
        return any(
            sector is not None and self._scheme.pieces_of(sector) != self._scheme.lattice.pieces
            for sector in self.sectors
        )

    def check_pieces(self) -> None:
        """Refuse to tell pieces where edges at special corners have masks of their own."""
        if self.has_own_spokes:
            raise ValueError(
                f"scheme {self._scheme.name!r} has masks of its own for edges at vertices of other "
                f"valences than {self.lattice.valence}: there are no Bezier patches of its "
                "surfaces, nor what stands on them (closest points, rays, sections, samples, "
                "integrals); evaluate or tessellate them, or refine the cage"
            )

    def _build(self, cage: Mesh, rules: Rules, limit_faces: Array) -> None:
        """Fill the table level by level; most faces of most cages end at the first."""
        level, smooth = Level.first(cage, rules, self._number, limit_faces), 0
        local = self._scheme.local
        for depth in range(_DEEPEST + 1):
            if depth:
                level = self._split(level, rules, smooth)
            rest, many = self._add_whole(level) if local else self._add_smooth(level)
            smooth = len(self.kind)
            level = level.of_faces(rest)
            if len(level.faces) == 0:
                return
            level = level.part()
            if many or (len(level.sharpness.concerned) and not local):
                level = level.of_faces(
                    self._add_sharp(level, Sectors.of(level.sharpness, self.lattice))
                )
            if len(level.faces) == 0:
                return
        face = int(level.slot[0])
        while face >= self.n_limit_faces:
            split = (face - self.n_limit_faces) // len(self.lattice.children)
            face = int(np.flatnonzero(self.codes == -2 - split)[0])
        raise RuntimeError(
            f"internal fault: after {_DEEPEST} refinements limit face {face} still has parts "
            "without a patch; please report this cage"
        )

    def _add_smooth(self, level: Level) -> tuple[Array, bool]:
        """Add the patches of faces amid smooth ones; return which faces these are not.

        Also whether there are some among these at which too many faces meet.
        """
        mesh, numbers, slot, turn = level.mesh, level.numbers, level.slot, level.turn
        valence = np.maximum(mesh.connectivity.valences, 0)
        valence[level.sharpness.concerned] = 0
        lattice, size, regular = self.lattice, self.lattice.face_size, self.lattice.valence
        if mesh.connectivity.uniform_size != size:
            valence[mesh.indices[mesh.sizes[mesh.corner_face] != size]] = 0
        first = mesh.connectivity.first(level.faces)
        found, start = neighbourhood.smooth_faces(mesh, lattice, first, turn, valence)
        if callable(self._scheme.edge):
            found[neighbourhood.influenced(level.sharpness, lattice, first)] = 0
        shared = (found > tables.MOST_FACES) & (not lattice.dual)
        found[shared] = 0
        plain = np.flatnonzero(found == regular)
        odd = np.flatnonzero((found != regular) & (found != 0))
        around = mesh, lattice, mesh.twin, numbers
        grid = neighbourhood.templates(*around, first[plain], start[plain])
        self._add(REGULAR, grid, slot[plain], np.zeros(len(plain), dtype=np.int8))
        for n in np.flatnonzero(np.bincount(found[odd])).tolist():
            here = odd[found[odd] == n]
            kind = self._kind(self._scheme.sector("interior", n))
            faces = first[here], start[here], n, self._outer(kind)
            control = neighbourhood.specials(mesh, lattice, numbers, *faces)
            self._add(kind, control, slot[here], (turn[here] + start[here]) % size)
        return np.flatnonzero(found == 0), bool(shared.any())

    def _add_whole(self, level: Level) -> tuple[Array, bool]:
        """Add the patches of all faces of the lattice, which depend on their own corners alone.

        Return as `_add_smooth` does.
        """
        size = self.lattice.face_size
        whole = level.mesh.sizes[level.faces] == size
        here = np.flatnonzero(whole)
        first, turn = level.mesh.connectivity.first(level.faces[here]), level.turn[here]
        corners = [
            self.lattice.corners.index((i - 1, j - 1)) for i, j in self._scheme.spline.template
        ]
        own = first[:, None] + (np.array(corners) - turn[:, None]) % size
        self._add(
            REGULAR, level.numbers[own].astype(np.int32), level.slot[here], np.zeros_like(turn)
        )
        return np.flatnonzero(~whole), False

    def _add_sharp(self, level: Level, sectors: Sectors) -> Array:
        """Add the patches of faces at sharp edges and vertices; return which are to be split."""
        first = level.mesh.connectivity.first(level.faces)
        strips = self._scheme.spline.is_product
        found, start = neighbourhood.sharp_faces(
            level.sharpness, sectors, self.lattice, strips, first, level.turn
        )
        if callable(self._scheme.edge):
            found[neighbourhood.influenced(level.sharpness, self.lattice, first)] = 0
        whole, rest = np.flatnonzero(found), np.flatnonzero(found == 0)
        found, start, first, slot = found[whole], start[whole], first[whole], level.slot[whole]
        turn = (level.turn[whole] + start) % self.lattice.face_size
        grid = self._grid(sectors, level.numbers, first, start)
        points = level.points
        special = np.flatnonzero(found == 2)
        many = sectors.shared[sectors.fans.fan[(first + start)[special]]]
        for kind, members, ring in self._kinds_of(sectors, first + start, special[~many]):
            around = self._around(kind, points[ring])
            control = np.concatenate([around, grid[members[:, None], self._outer(kind)]], 1)
            self._add(kind, control, slot[members], turn[members])
        for kind, members, rings in self._shared(sectors, first + start, special[many], points):
            outer = grid[members[:, None], self._outer(kind)]
            near = grid[members, self.lattice.template.index((1, 1))]
            outer = np.where(outer < 0, near[:, None], outer)
            self._add(kind, outer, slot[members], turn[members])
            known = self.rings.get(kind)
            self.rings[kind] = rings if known is None else known.with_more(rings)
        for kind, which in ((REGULAR, found == 1), (STRIP, found == 3)):
            members = np.flatnonzero(which)
            self._add(kind, grid[members], slot[members], turn[members])
        side = level.sharpness.at((first + start)[members])
        self.sharpness = np.concatenate([self.sharpness, side])
        return rest

    def _kinds_of(
        self, sectors: Sectors, corners: Array, members: Array
    ) -> Iterator[tuple[int, Array, Array]]:
        """Special corners by kind: number of the kind, which, rings around them (n, ring)."""
        fan, position = (x[corners[members]] for x in (sectors.fans.fan, sectors.fans.position))
        kinds, sizes = sectors.kind[fan], sectors.fans.sizes[fan]
        alike = _alike(self.lattice)[kinds]
        place = np.where(alike, 0, position)
        most = 1 + int(sizes.max(initial=0))
        key = (kinds * most + sizes) * most + place
        for code in np.unique(key).tolist():
            here = np.flatnonzero(key == code)
            one = here[0]
            faces = int(sizes[one])
            sector = self._scheme.sector(tables.KINDS[kinds[one]], faces, int(place[one]))
            begin = position[here] if alike[one] else 0
            ring = sectors.ring(sector.kind, faces, fan[here], begin)
            yield self._kind(sector), members[here], ring

    def _around(self, kind: int, ring: Array) -> Array:
        """Control points of the ring of a kind from those at the vertices of `Sectors.ring`."""
        sector = self.sectors[kind]
        assert sector is not None
        if not sector.carried:
            return ring
        n, halves = len(ring), self._number.full(2 * len(ring), self._number.one / 2)
        middle = self._extend(np.full(n, 2), ring[:, -2:].ravel(), halves)
        return np.concatenate([ring[:, :-2], middle[:, None]], axis=1)

    def _shared(
        self, sectors: Sectors, corners: Array, members: Array, points: Array
    ) -> Iterator[tuple[int, Array, SharedRings]]:
        """Special corners of many faces by kind: number of the kind, which, their rings."""
        fans, position = (x[corners[members]] for x in (sectors.fans.fan, sectors.fans.position))
        met, which = np.unique(fans, return_inverse=True)
        for name, faces, group in sectors.groups(met):
            own = np.sort(group)
            here = np.flatnonzero(np.isin(met, own)[which])
            ring = np.searchsorted(own, fans[here])
            rings = points[sectors.ring(name, faces, own)]
            kind = self._kind(self._scheme.sector(name, faces))
            yield kind, members[here], SharedRings(rings, ring, position[here])

    def _kind(self, sector: tables.Sector) -> int:
        """The number of a kind, a new one when it is met first."""
        number = self._kinds.setdefault(sector, len(self.sectors))
        if number == len(self.sectors):
            self.sectors.append(sector)
            shared = tables.is_shared(sector)
            width = len(sector.lattice.outer) if shared else sector.size
            self.controls.append(np.zeros((0, width), np.int32))
        return number

    def _outer(self, kind: int) -> Array:
        """Places in the template of the control points of a kind beyond its ring."""
        sector = self.sectors[kind]
        assert sector is not None
        outer = sector.lattice.outer if tables.is_shared(sector) else sector.outer
        return np.array([self.lattice.template.index(place) for place in outer], dtype=np.int64)

    def _add(self, kind: int, controls: Array, slot: Array, turn: Array) -> None:
        """Append patches of a kind."""
        n, start, row = len(controls), len(self.kind), len(self.controls[kind])
        self.codes[slot] = np.arange(start, start + n, dtype=np.int32)
        self.kind = _appended(self.kind, np.full(n, kind, dtype=np.int32))
        self.row = _appended(self.row, np.arange(row, row + n, dtype=np.int32))
        self.turn = _appended(self.turn, turn)
        self.controls[kind] = _appended(self.controls[kind], controls)

    def _grid(self, sectors: Sectors, numbers: Array, first: Array, start: Array) -> Array:
        """Control points (P, places) of faces from a corner on, with reflections as new points.

        What lies beyond a special corner, or beyond a sharp edge at it, is meaningless and not
        used.
        """
        around = sectors.mesh, self.lattice, sectors.twin, numbers
        grid = neighbourhood.templates(*around, first, start)
        faces = sectors, self.lattice, first, start
        place, target, columns, weights = neighbourhood.reflections(grid, *faces)
        if len(place):
            used = weights != 0
            values = self._number.array(weights[used])
            grid[place, target] = self._extend(used.sum(axis=1), columns[used], values)
        return grid

    def _extend(self, counts: Array, columns: Array, values: Array) -> Array:
        """Append control points, each combined of `counts` others in turn; return their numbers."""
        if not self._combined:
            self._early = list(map(len, self.controls))
        self._combined.append((counts, columns, values))
        start = self.n_points
        self.n_points += len(counts)
        return np.arange(start, self.n_points, dtype=np.int32)

    def _split(self, level: Level, rules: Rules, smooth: int) -> Level:
        """Refine a level; the first `smooth` patches were found before it was made smaller."""
        size, count = self.lattice.face_size, len(self.lattice.children)
        n_codes = len(self.codes)
        self._splits.append((smooth, len(self.kind), self.n_points, n_codes))
        whole = level.mesh.sizes[level.faces] == size
        n_splits = int(whole.sum())
        split = (n_codes - self.n_limit_faces) // count + np.arange(n_splits)
        self.codes[level.slot[whole]] = -2 - split
        self.codes = np.append(self.codes, np.full(count * n_splits, NO_LIMIT, dtype=np.int32))
        n_points = self.n_points
        for each in level.rows(rules, n_points):
            self._extend(*each)
        return level.refined(self.lattice, n_points, n_codes)

    def _drop_unused(self) -> None:
        """Leave out control points that no patch needs, and number the others anew."""
        if not self._combined:
            return
        needed = np.zeros(self.n_points, dtype=bool)
        needed[: self.n_vertices] = True
        starts = self._early + [0] * (len(self.controls) - len(self._early))
        late = [control[start:] for control, start in zip(self.controls, starts, strict=True)]
        late += [rings.points for rings in self.rings.values()]
        for control in late:
            needed[control] = True
        self.extras, number = without_unused(self._combined, needed)
        self.n_points = int(np.count_nonzero(needed))
        for control in late:
            np.take(number, control, out=control, mode="clip")
        self._needed = np.packbits(needed)

    def typed(self, cage: Mesh, rules: Rules, number: NumberType) -> PatchTable:
        """The table of the same cage for numbers of another type, which shares all integers.

        This one is of float64. Whatever the type, sharpness decides exactly which patches there
        are: the levels are refined again for the values of operators alone.
        """
        made = self._refined(cage, rules, number)
        found = copy(self)
        found.sharpness = number.array(self.sharpness)
        # what refinement does not make has integers and halves, exact in float64
        found.extras = [
            made[x.shape[1]] if x.shape[1] in made else converted(x, number) for x in self.extras
        ]
        return found

    def _refined(self, cage: Mesh, rules: Rules, number: NumberType) -> dict[int, Any]:
        """Those `extras` that refinement makes, by the number of their first row.

        A row may combine points that it did not in float64, which rounded their weights to 0, but
        none that have been left out (``derivations/isolation.py``, part 7).
        """
        made: dict[int, Any] = {}
        if not self._splits:
            return made
        needed = np.unpackbits(self._needed).astype(bool)
        place = new_numbers(needed)
        level = Level.first(cage, rules, number, first_limit_face(cage, self.lattice))
        for k, (smooth, patches, n_points, _) in enumerate(self._splits):
            if k:
                level = level.refined(self.lattice, *self._splits[k - 1][2:])
            # what is left by smooth patches, and by all patches of the level
            level = level.of_faces(self._beyond(level, smooth)).part()
            level = level.of_faces(self._beyond(level, patches))
            for each in level.rows(rules, n_points):
                new = slice(n_points, n_points + len(each[0]))
                counts, columns, values = some_rows(each, needed[new])
                columns = place[columns]
                assert (columns >= 0).all()
                if len(counts):
                    width = int(place[new][needed[new]][0])
                    made[width] = operator_of((counts, columns, values), width)
                n_points = new.stop
        return made

    def _beyond(self, level: Level, n: int) -> Array:
        """Faces of a level that the first patches do not cover, (n_faces,) bool."""
        code = self.codes[level.slot]
        return np.asarray((code < 0) | (code >= n))

    @property
    def with_limit(self) -> Array:
        """Limit faces that have a limit all over, (n_limit_faces,) bool."""
        return np.asarray(self.codes[: self.n_limit_faces] != NO_LIMIT)

    def locate(
        self, face: Array, u: Array, v: Array
    ) -> tuple[Array, Array, Array, Array, Array | None]:
        """Find the patches of places on limit faces.

        On a line between two parts of a split that nearer corner 0 of the limit face is taken.

        Returns
        -------
        patch : (Q,)
            -1 without limit.
        s, t : (Q,)
            Parameters in the domain of the patch, which is not turned.
        depth : (Q,)
            Halvings from the limit face to it.
        flipped : (Q,) bool or None
            Whether it is turned by half a turn; None where none is.
        """
        code = self.codes[face]
        depth = np.zeros(len(face), dtype=np.int64)
        flipped = np.zeros(len(face), dtype=bool) if self.lattice.flips else None
        u, v = u.copy(), v.copy()
        while (inside := np.flatnonzero(code <= -2)).size:
            given = u[inside], v[inside], None if flipped is None else flipped[inside]
            part, u[inside], v[inside], turned = neighbourhood.child_at(self.lattice, *given)
            if flipped is not None:
                flipped[inside] = turned
            depth[inside] += 1
            split = -2 - code[inside]
            first = self.n_limit_faces + len(self.lattice.children) * split
            code[inside] = self.codes[first + part]
        return code, u, v, depth, flipped

    def control_points(self, kind: int, rows: Array) -> Array:
        """Control points of some patches of a kind, (n, K); those of shared rings come first."""
        outer = self.controls[kind][rows]
        if kind not in self.rings:
            return outer
        rings = self.rings[kind]
        return np.concatenate([rings.points[rings.ring[rows]], outer], axis=1)

    def summary(self) -> list[tuple[str, int]]:
        """How many limit faces are covered in which way, as (reason, number) pairs."""
        code = self.codes[: self.n_limit_faces]
        kind = self.kind[code[code >= 0]]
        counts = [
            ("one regular patch", int((kind == REGULAR).sum())),
            ("one strip along a semi-sharp crease", int((kind == STRIP).sum())),
            ("one patch with a special corner", int((kind > STRIP).sum())),
            ("split around n-gons, sharpness or several special corners", int((code <= -2).sum())),
            ("no limit (holes)", int((code == NO_LIMIT).sum())),
        ]
        return [(reason, number) for reason, number in counts if number]

    def special_corners(self) -> list[tuple[str, int, int]]:
        """What is around special corners: kind, faces, and patches there; smooth ones first."""
        counts: Counter[tuple[bool, str, int]] = Counter()
        for sector, number in zip(self.sectors, np.bincount(self.kind).tolist(), strict=False):
            if sector is not None:
                counts[sector.kind != "interior", sector.kind, sector.faces] += number
        return [(kind, faces, number) for (_, kind, faces), number in sorted(counts.items())]


@dataclass(frozen=True, eq=False)
class SharedRings:
    """The rings around special corners of one kind, whose patches share them.

    Attributes
    ----------
    points : (rings, 2 N + 1 or more) int32
        Control points in the order of ``exact/matrices.py``, from some face on if all are alike.
    ring, position : (patches,) int
        Which ring each patch is at, and the number of its face there.
    """

    points: Array
    ring: Array
    position: Array

    def with_more(self, other: SharedRings) -> SharedRings:
        """These rings and patches, then others."""
        ring = np.concatenate([self.ring, len(self.points) + other.ring])
        points, position = (
            np.concatenate([getattr(x, name) for x in (self, other)])
            for name in ("points", "position")
        )
        return SharedRings(points, ring, position)


@lru_cache(maxsize=16)
def _alike(lattice: Lattice) -> Array:
    """Whether all faces at a special corner are alike, by kind, (kinds,) bool."""
    return np.array([tables.Sector(kind, 2, 0, lattice).alike for kind in tables.KINDS])


def _appended(array: Array, more: Array) -> Array:
    """An array, of which there are no views, with more rows; without a copy where memory allows."""
    start = len(array)
    if start == 0:
        return more.astype(array.dtype, copy=False)
    array.resize((start + len(more), *array.shape[1:]), refcheck=False)
    array[start:] = more
    return array
