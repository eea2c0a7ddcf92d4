"""Patch table: for each limit face its exact patches and their control points.

A quad is a patch as it is when all faces around its corners are quads and nothing semi-sharp is at
them, and at most one corner is special: not regular in the sense of `Sectors.regular`. It is a
patch too where a semi-sharp crease of one sharpness runs along one of its sides and goes straight
on at both ends: there the surface is a tensor product (``derivations/creases.py``). Otherwise it is
split into its four children, an n-gon into n, by one refinement of its neighbourhood. Infinitely
sharp edges part the mesh: what lies beyond one is replaced by reflections, which is exact at
regular vertices, or has no influence. Where more than `tables.MOST_FACES` faces meet, their patches
share one copy of the ring around them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import numbers, tables
from limitsurf.mesh import Mesh, read_only
from limitsurf.numbers import NumberType
from limitsurf.refine import ExactOperator, refinement_stages
from limitsurf.rules import Rules, Sectors, Sharpness
from limitsurf.topology import MeshPart, child_mesh, first_limit_face

Array = NDArray[Any]

# kinds of patches; further ones are numbered as they occur
REGULAR, STRIP = 0, 1
NO_LIMIT = -1
# Sharpness below 10 is 0 after 10 refinements, n-gons are gone after one. The points that they make
# are regular then, but for centres of n-gons, and after two no face has two special corners
# (``derivations/isolation.py``).
_DEEPEST = 10


class PatchTable:
    """Patches of all limit faces, and the control points beyond those of the cage.

    Control points are numbered: the vertices of the cage first, then the rows of each operator in
    `extras`, which combine points of lower number.

    Attributes
    ----------
    codes : (n_limit_faces + 4 n_splits,) int
        What covers each limit face, then each quadrant ``i + 2 j`` (i along u, j along v) of each
        split: a patch >= 0, `NO_LIMIT`, or ``-2 - s`` for split s.
    sectors : list
        By kind of patch: None for `REGULAR` and `STRIP`, the `Sector` of the special corner else.
    kind : (n_patches,) int
    row : (n_patches,) int
        Row of the patch in ``controls[kind]``.
    turn : (n_patches,) int
        Corner of the parameter square at which the special corner lies, or where the side begins
        along which a strip's crease runs; 0 if regular.
    controls : list of (patches, K) int arrays
        Control points by kind: 16 for regular patches and strips, index ``4 j + i``; the others in
        the order of ``exact/matrices.py``. Kinds with shared rings have the outer ones alone, all
        seven; what is beyond a sharp side is not used.
    rings : dict
        The `SharedRings` of kinds of more than `tables.MOST_FACES` faces, which have one kind for
        all positions.
    sharpness : (strips,)
        Sharpness of the creases of strips.
    extras : list of operators
        Sparse rows, float64 or exact, over all control points of lower number.
    """

    def __init__(self, mesh: Mesh, rules: Rules, number: NumberType) -> None:
        self.lattice = rules.scheme.lattice
        limit_faces = first_limit_face(mesh)
        self.n_limit_faces = int(limit_faces[-1])
        self.n_vertices = self.n_points = mesh.n_vertices
        self.extras: list[Any] = []
        self._number = number
        self.codes = np.full(self.n_limit_faces, NO_LIMIT, dtype=np.int32)
        self.kind, self.row = np.zeros((2, 0), np.int32)
        self.turn = np.zeros(0, np.int8)
        self.sectors: list[tables.Sector | None] = [None, None]
        self.controls = [np.zeros((0, 16), np.int32) for _ in self.sectors]
        self.rings: dict[int, SharedRings] = {}
        self.sharpness = np.zeros(0, dtype=number.dtype)
        self._kinds: dict[tables.Sector, int] = {}
        self._combined: list[tuple[Array, Array, Array]] = []
        self._early: list[int] = []  # rows of `controls` from before there was any of these
        self._build(mesh, rules, limit_faces)
        self._drop_unused()
        del self._kinds, self._combined, self._early

    def _build(self, cage: Mesh, rules: Rules, limit_faces: Array) -> None:
        """Fill the table level by level; most faces of most cages end at the first."""
        faces = np.flatnonzero(~rules.without_limit(cage))
        sharpness = Sharpness.of(cage, rules, self._number)
        turn = np.zeros(len(faces), dtype=np.int8)
        level = _Level(sharpness, cage.indices, faces, limit_faces[faces], turn)
        for depth in range(_DEEPEST + 1):
            if depth:
                level = self._split(level, rules)
            rest, many = self._add_smooth(level)
            level = level.of_faces(rest)
            if len(level.faces) == 0:
                return
            level = level.part()
            if many or len(level.sharpness.concerned):
                level = level.of_faces(self._add_sharp(level, Sectors.of(level.sharpness)))
            if len(level.faces) == 0:
                return
        face = int(level.slot[0])
        while face >= self.n_limit_faces:
            split = (face - self.n_limit_faces) // 4
            face = int(np.flatnonzero(self.codes == -2 - split)[0])
        raise RuntimeError(
            f"internal fault: after {_DEEPEST} refinements limit face {face} still has parts "
            "without a patch; please report this cage"
        )

    def _add_smooth(self, level: _Level) -> tuple[Array, bool]:
        """Add the patches of faces amid smooth quads; return which faces these are not.

        Also whether there are some among these at which too many faces meet.
        """
        mesh, numbers, slot, turn = level.mesh, level.numbers, level.slot, level.turn
        valence = np.maximum(mesh._valences, 0)
        valence[level.sharpness.concerned] = 0
        if not mesh._of_quads:
            valence[mesh.indices[mesh.sizes[mesh.corner_face] != 4]] = 0
        first = mesh._first(level.faces)
        found, start = smooth_quads(mesh, first, turn, valence)
        shared = found > tables.MOST_FACES
        found[shared] = 0
        plain, odd = np.flatnonzero(found == 4), np.flatnonzero((found != 4) & (found != 0))
        grid = grids(mesh, mesh.twin, numbers, first[plain], start[plain])
        self._add(REGULAR, grid, slot[plain], np.zeros(len(plain), dtype=np.int8))
        for n in np.unique(found[odd]).tolist():
            here = odd[found[odd] == n]
            kind = self._kind(tables.Sector("interior", n, 0))
            control = specials(mesh, numbers, first[here], start[here], n, self._outer(kind))
            self._add(kind, control, slot[here], (turn[here] + start[here]) % 4)
        return np.flatnonzero(found == 0), bool(shared.any())

    def _add_sharp(self, level: _Level, sectors: Sectors) -> Array:
        """Add the patches of faces at sharp edges and vertices; return which are to be split."""
        first = level.mesh._first(level.faces)
        found, start = sharp_quads(level.sharpness, sectors, first, level.turn)
        whole = np.flatnonzero(found)
        found, start, first, slot = found[whole], start[whole], first[whole], level.slot[whole]
        turn = (level.turn[whole] + start) % 4
        grid = self._grid(level.mesh, sectors.twin, level.numbers, first, start)
        points = level.points
        special = np.flatnonzero(found == 2)
        many = sectors.shared[sectors.fans.fan[(first + start)[special]]]
        for kind, members, ring in self._kinds_of(sectors, first + start, special[~many]):
            around = self._around(kind, points[ring])
            control = np.concatenate([around, grid[members[:, None], self._outer(kind)]], 1)
            self._add(kind, control, slot[members], turn[members])
        for kind, members, rings in self._shared(sectors, first + start, special[many], points):
            outer = grid[members[:, None], self._outer(kind)]
            outer = np.where(outer < 0, grid[members, 5][:, None], outer)
            self._add(kind, outer, slot[members], turn[members])
            known = self.rings.get(kind)
            self.rings[kind] = rings if known is None else known.with_more(rings)
        for kind, which in ((REGULAR, found == 1), (STRIP, found == 3)):
            members = np.flatnonzero(which)
            self._add(kind, grid[members], slot[members], turn[members])
        side = level.sharpness.at((first + start)[members])
        self.sharpness = np.concatenate([self.sharpness, side])
        return np.delete(np.arange(len(level.faces)), whole)

    def _kinds_of(
        self, sectors: Sectors, corners: Array, members: Array
    ) -> Iterator[tuple[int, Array, Array]]:
        """Special corners by kind: number of the kind, which, rings around them (n, ring)."""
        fan, position = (x[corners[members]] for x in (sectors.fans.fan, sectors.fans.position))
        kinds, sizes = sectors.kind[fan], sectors.fans.sizes[fan]
        alike = np.array([tables.Sector(name, 2).alike for name in tables.KINDS])[kinds]
        place = np.where(alike, 0, position)
        most = 1 + int(sizes.max(initial=0))
        key = (kinds * most + sizes) * most + place
        for code in np.unique(key).tolist():
            here = np.flatnonzero(key == code)
            one = here[0]
            faces = int(sizes[one])
            sector = tables.Sector(tables.KINDS[kinds[one]], faces, int(place[one]))
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
            kind = self._kind(tables.Sector(name, faces))
            yield kind, members[here], SharedRings(rings, ring, position[here])

    def _kind(self, sector: tables.Sector) -> int:
        """The number of a kind, a new one when it is met first."""
        number = self._kinds.setdefault(sector, len(self.sectors))
        if number == len(self.sectors):
            self.sectors.append(sector)
            width = len(OUTER) if tables.is_shared(sector) else sector.size
            self.controls.append(np.zeros((0, width), np.int32))
        return number

    def _outer(self, kind: int) -> Array:
        """Positions in the grid of the control points of a kind beyond its ring."""
        sector = self.sectors[kind]
        assert sector is not None
        outer = OUTER if tables.is_shared(sector) else sector.outer
        return np.array([4 * j + i for i, j in outer])

    def _add(self, kind: int, controls: Array, slot: Array, turn: Array) -> None:
        """Append patches of a kind."""
        n, start, row = len(controls), len(self.kind), len(self.controls[kind])
        self.codes[slot] = np.arange(start, start + n, dtype=np.int32)
        self.kind = _appended(self.kind, np.full(n, kind, dtype=np.int32))
        self.row = _appended(self.row, np.arange(row, row + n, dtype=np.int32))
        self.turn = _appended(self.turn, turn)
        self.controls[kind] = _appended(self.controls[kind], controls)

    def _grid(self, mesh: Mesh, twin: Array, numbers: Array, first: Array, start: Array) -> Array:
        """4 x 4 control points (P, 16) of quads from a corner on, with reflections as new points.

        What lies beyond a special corner, or beyond a sharp edge at it, is meaningless and not
        used.
        """
        grid = grids(mesh, twin, numbers, first, start)
        sides = first[:, None] + (start[:, None] + np.arange(4)) % 4
        rim = twin[sides] < 0  # (P, 4): side k, from corner k to k + 1, is on the boundary
        left, right = np.roll(rim, 1, axis=1), np.roll(rim, -1, axis=1)
        cases = [rim, rim, rim & ~left, rim & ~right, rim & left]
        place, case = np.nonzero(np.concatenate(cases, axis=1))
        if len(place):
            columns, weights = grid[place[:, None], _FROM[case]], _WEIGHTS[case]
            used = weights != 0
            values = self._number.array(weights[used])
            grid[place, _TARGET[case]] = self._extend(used.sum(axis=1), columns[used], values)
        return grid

    def _extend(self, counts: Array, columns: Array, values: Array) -> Array:
        """Append control points, each combined of `counts` others in turn; return their numbers."""
        if not self._combined:
            self._early = list(map(len, self.controls))
        self._combined.append((counts, columns, values))
        start = self.n_points
        self.n_points += len(counts)
        return np.arange(start, self.n_points, dtype=np.int32)

    def _split(self, level: _Level, rules: Rules) -> _Level:
        """Refine the mesh of a level; return it with the children of the faces.

        Quads become splits, and the limit faces of n-gons go straight to their children.
        """
        mesh, sharpness, faces, slot = level.mesh, level.sharpness, level.faces, level.slot
        # points of the mesh, then its face points, then its vertex and edge points, all numbered
        face_points, refined = refinement_stages(mesh, rules, sharpness, self._number)
        centres = self._extend(*_rows(face_points, level.points))
        points = np.concatenate([level.points, centres])
        others = self._extend(*_rows(refined, points, refined.shape[0] - mesh.n_faces))
        new = np.concatenate([others, centres]).astype(np.int64)
        children = child_mesh(mesh, np.arange(len(new)))
        sizes = mesh.sizes[faces]
        child, corner = _corners(mesh, faces)
        quad = np.repeat(sizes == 4, sizes)
        # only the first level has n-gons: there the slot of a face is its first limit face
        n_codes, n_splits = len(self.codes), int((sizes == 4).sum())
        split = (n_codes - self.n_limit_faces) // 4 + np.arange(n_splits)
        self.codes[slot[sizes == 4]] = -2 - split
        self.codes = np.append(self.codes, np.full(4 * n_splits, NO_LIMIT, dtype=np.int32))
        square = (np.repeat(level.turn, sizes) + corner) % 4
        quadrant = np.array([0, 1, 3, 2])[square]
        slot = np.repeat(slot, sizes) + corner
        slot[quad] = n_codes + np.repeat(4 * np.arange(n_splits), 4) + quadrant[quad]
        turn = np.where(quad, square, 0).astype(np.int8)
        return _Level(sharpness.children(children), new[children.indices], child, slot, turn)

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
        kept = []
        end = self.n_points
        for counts, columns, values in self._combined[::-1]:
            start = end - len(counts)
            kept.append(_needed_rows(counts, columns, values, needed, start))
            end = start
        number = np.cumsum(needed, dtype=np.int32) - np.int32(1)
        self.n_points = self.n_vertices
        for counts, columns, values in kept[::-1]:
            if len(counts):
                rows = counts, number[columns], values
                self.extras.append(_operator(*rows, self.n_points))
                self.n_points += len(counts)
        for control in late:
            np.take(number, control, out=control, mode="clip")

    def locate(self, face: Array, u: Array, v: Array) -> tuple[Array, Array, Array, Array]:
        """Patch (Q,), -1 without limit, parameters in it (Q,), and its depth in the tree (Q,).

        On a line between two quadrants the lower one is taken.
        """
        code = self.codes[face]
        depth = np.zeros(len(face), dtype=np.int64)
        u, v = u.copy(), v.copy()
        while (inside := np.flatnonzero(code <= -2)).size:
            i, j = u[inside] * 2 > 1, v[inside] * 2 > 1
            u[inside] = u[inside] * 2 - i.astype(np.int64)
            v[inside] = v[inside] * 2 - j.astype(np.int64)
            depth[inside] += 1
            split = -2 - code[inside]
            code[inside] = self.codes[self.n_limit_faces + 4 * split + i + 2 * j]
        return code, u, v, depth

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


@dataclass(frozen=True, eq=False)
class _Level:
    """Faces of a mesh that are still to be covered by patches.

    Attributes
    ----------
    sharpness : Sharpness
    numbers : (n_corners,) int
        The control point at each corner of the mesh.
    faces : (n,) int
    slot : (n,) int
        The place of each face in the codes; of the first limit face of an n-gon.
    turn : (n,) int
        Where in the parameter square of the limit face or quadrant its first corner lies.
    """

    sharpness: Sharpness
    numbers: Array
    faces: Array
    slot: Array
    turn: Array

    @property
    def mesh(self) -> Mesh:
        """The mesh of the faces."""
        return self.sharpness.mesh

    @property
    def points(self) -> Array:
        """The control points at the vertices, (n_vertices,) int32."""
        result = np.empty(self.mesh.n_vertices, dtype=np.int32)
        result[self.mesh.indices] = self.numbers
        return result

    def of_faces(self, which: Array) -> _Level:
        """The same for some of the faces."""
        faces, slot, turn = self.faces[which], self.slot[which], self.turn[which]
        return replace(self, faces=faces, slot=slot, turn=turn)

    def part(self) -> _Level:
        """The same on that part of the mesh on which patches and children of the faces depend."""
        wanted = np.zeros(self.mesh.n_corners, dtype=bool)
        wanted[_corners(self.mesh, self.faces)[0]] = True
        near = MeshPart.of(self.mesh, self.sharpness.neighbours(wanted))
        sharpness, numbers = self.sharpness.part(near), self.numbers[near.corners]
        faces = np.searchsorted(near.faces, self.faces)
        return replace(self, sharpness=sharpness, numbers=numbers, faces=faces)


def smooth_quads(mesh: Mesh, first: Array, turn: Array, valence: Array) -> tuple[Array, Array]:
    """Quads amid quads with at most one corner of a valence other than 4.

    Parameters
    ----------
    first : (n,) int
        First corners of faces.
    turn : (n,) int
        Where in the parameter square these lie.
    valence : (n_vertices,) int
        0 where faces may not be such quads, as everywhere around other faces.

    Returns
    -------
    found : (n,) int32
        The valence of that corner, or 4; 0 for other faces.
    start : (n,) int8
        That corner, or the one at (0, 0).
    """
    if mesh._compiled:
        from limitsurf._kernels import connectivity

        return connectivity.smooth_quads(mesh.indices, *map(read_only, (first, turn, valence)))
    # a triangle that is the last face has no fourth corner, nor any that counts
    corners = np.minimum(first[:, None] + np.arange(4), mesh.n_corners - 1)
    here = valence[mesh.indices[corners]]
    odd = here != 4
    special = odd.argmax(axis=1)
    each = np.arange(len(first))
    found = np.where(odd.any(axis=1), here[each, special], 4)
    found[odd.sum(axis=1) > 1] = 0
    start = np.where(found == 0, 0, np.where(found == 4, -turn % 4, special))
    return found.astype(np.int32), start.astype(np.int8)


def sharp_quads(
    sharpness: Sharpness, sectors: Sectors, first: Array, turn: Array
) -> tuple[Array, Array]:
    """Quads that are one patch, be it at sharp edges.

    Parameters
    ----------
    first : (n,) int
        First corners of faces.
    turn : (n,) int
        Where in the parameter square these lie.

    Returns
    -------
    found : (n,) int8
        1 for regular patches; 2 for those with a special corner; 3 for strips, along one side of
        which a semi-sharp crease runs straight; 0 for other faces. Both ends of that side are amid
        four faces and have no other sharp edge, and the other corners are regular.
    start : (n,) int8
        The corner at (0, 0), the special one, or that where the side begins.
    """
    mesh, fans = sharpness.mesh, sectors.fans
    # by fan: -1 with others than quads, 0 semi-sharp, 1 special, 2 regular
    state = np.minimum(sectors.kind + 1, 1).clip(0) + sectors.regular
    if not mesh._of_quads:
        state[fans.fan[mesh.sizes[mesh.corner_face] != 4]] = -1
    around = np.where(fans.closed, fans.sizes, 0)
    edges, through = sharpness.codes
    if mesh._compiled:
        from limitsurf._kernels import connectivity

        known = sectors.twin, fans.fan, state, around, edges, through, first, turn
        return connectivity.sharp_quads(mesh.indices, mesh._steps, *map(read_only, known))
    # a triangle that is the last face has no fourth corner, nor any that counts
    corners = np.minimum(first[:, None] + np.arange(4), mesh.n_corners - 1)
    here = state[fans.fan[corners]]  # (n, 4)
    simple = (here >= 0).all(axis=1)
    settled = simple & (here > 0).all(axis=1)
    special = settled & ((here == 2).sum(axis=1) == 3)
    plain = settled & (here == 2).all(axis=1)
    soft = edges[corners] > 0
    strip = simple & (soft.sum(axis=1) == 1)
    side = np.where(strip, soft.argmax(axis=1), 0)
    each = np.arange(len(first))
    for k in (2, 3):
        strip &= here[each, (side + k) % 4] == 2
    code = edges[corners[each, side]]
    for k in (0, 1):
        corner = corners[each, (side + k) % 4]
        strip &= (around[fans.fan[corner]] == 4) & (through[mesh.indices[corner]] == code)
        # opposite to the side: two edges on from it, three from the face's next edge
        for _ in range(2 + k):
            corner = np.where(strip, sectors.twin[mesh.previous_corner[corner]], 0)
        strip &= edges[corner] == code
    found = np.where(strip, 3, np.where(special, 2, plain))
    start = np.where(strip, side, np.where(special, (here == 1).argmax(axis=1), -turn % 4))
    return found.astype(np.int8), np.where(found > 0, start, 0).astype(np.int8)


def grids(mesh: Mesh, twin: Array, numbers: Array, first: Array, start: Array) -> Array:
    """Control points of quads and around them, (n, 16), -1 where there are none.

    From the corner ``first + start`` on, index ``4 j + i``; `numbers` (n_corners,) are the control
    points of corners, `twin` (n_corners,) joins faces.
    """
    if mesh._compiled:
        from limitsurf._kernels import connectivity

        return connectivity.grids(*read_only((numbers, mesh._steps, twin, first, start)))
    corners = first[:, None] + (start[:, None] + np.arange(4)) % 4
    after, before = mesh.next_corner, mesh.previous_corner
    other = twin[corners]
    leaving = after[other]
    last = twin[leaving]
    grid = np.empty((len(first), 16), dtype=np.int32)
    grid[:, _OWN] = numbers[corners]
    grid[:, _ACROSS] = np.where(other < 0, -1, numbers[after[leaving]])
    grid[:, _BESIDE] = np.where(other < 0, -1, numbers[before[other]])
    grid[:, _BEYOND] = np.where((other < 0) | (last < 0), -1, numbers[before[last]])
    return grid


def specials(
    mesh: Mesh, numbers: Array, first: Array, start: Array, valence: int, outer: Array
) -> Array:
    """Control points (n, K) of quads with an interior vertex of that valence at ``first + start``.

    Those around it as in `Sectors.ring`, then those at `outer` positions of `grids`.
    """
    if mesh._compiled:
        from limitsurf._kernels import connectivity

        known = numbers, mesh._steps, mesh.twin, first, start, valence, outer
        return connectivity.specials(*read_only(known))
    corners = first + start
    parts = [numbers[corners]]
    for _ in range(valence):
        leaving = mesh.next_corner[corners]
        parts += [numbers[leaving], numbers[mesh.next_corner[leaving]]]
        corners = mesh.twin[mesh.previous_corner[corners]]
    grid = grids(mesh, mesh.twin, numbers, first, start)
    return np.concatenate([np.stack(parts, axis=1).astype(np.int32), grid[:, outer]], axis=1)


def _corners(mesh: Mesh, faces: Array) -> tuple[Array, Array]:
    """All corners of some faces, and which of its face each is."""
    if mesh._of_quads:
        corner = np.tile(np.arange(4), len(faces))
        return np.repeat(4 * faces, 4) + corner, corner
    sizes = mesh.sizes[faces]
    corner = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    return np.repeat(mesh._first(faces), sizes) + corner, corner


def _appended(array: Array, more: Array) -> Array:
    """An array, of which there are no views, with more rows; without a copy where memory allows."""
    start = len(array)
    if start == 0:
        return more.astype(array.dtype, copy=False)
    array.resize((start + len(more), *array.shape[1:]), refcheck=False)
    array[start:] = more
    return array


def _rows(operator: Any, numbers: Array, n: int | None = None) -> tuple[Array, Array, Array]:
    """The first rows of an operator, as `PatchTable._extend` takes them; its columns' numbers."""
    if isinstance(operator, ExactOperator):
        starts, columns, values = operator.indptr, operator.columns, operator.values
    else:
        starts, columns, values = operator.indptr, operator.indices, operator.data
    counts = np.diff(starts[: None if n is None else n + 1])
    end = starts[len(counts)]
    return counts, numbers[columns[:end]], values[:end]


def _needed_rows(
    counts: Array, columns: Array, values: Array, needed: Array, start: int
) -> tuple[Array, Array, Array]:
    """Those of some rows, numbered from `start` on, that are needed; so are then their columns."""
    used = needed[start : start + len(counts)]
    if not used.all():
        entries = np.repeat(used, counts)
        counts, columns, values = counts[used], columns[entries], values[entries]
    needed[columns] = True
    return counts, columns, values


def _operator(counts: Array, columns: Array, values: Array, width: int) -> Any:
    """An operator from the number of entries of each row, their columns and values."""
    shape = len(counts), width
    if numbers.type_of(values).exact:
        return ExactOperator(np.repeat(np.arange(len(counts)), counts), columns, values, shape)
    from scipy.sparse import csr_array

    starts = np.zeros(len(counts) + 1, dtype=np.int32)
    np.cumsum(counts, out=starts[1:])
    return csr_array((values, columns, starts), shape=shape)


# outer control points, as (i, j)
OUTER = tables.Sector("interior", 4).outer

# grid positions 4 j + i by side of the quad: its corner, the points across it beside its two
# corners, that diagonally beyond its corner
_OWN = np.array([5, 6, 10, 9])
_ACROSS = np.array([1, 7, 14, 8])
_BESIDE = np.array([2, 11, 13, 4])
_BEYOND = np.array([0, 3, 15, 12])

# reflections at sides k on the boundary: both points across it, those beyond its first and its
# second corner where the next side there is not on the boundary, that beyond both; (20,), (20, 4)
_LEFT, _RIGHT, _FAR = (np.arange(4) + 3) % 4, (np.arange(4) + 1) % 4, (np.arange(4) + 2) % 4
_TARGET = np.concatenate([_ACROSS, _BESIDE, _BEYOND, _BEYOND[_RIGHT], _BEYOND])
_FROM = np.concatenate(
    [
        np.stack(terms, axis=1)
        for terms in (
            (_OWN, _OWN[_LEFT], _OWN, _OWN),
            (_OWN[_RIGHT], _OWN[_FAR], _OWN, _OWN),
            (_BESIDE[_LEFT], _ACROSS[_LEFT], _OWN, _OWN),
            (_ACROSS[_RIGHT], _BESIDE[_RIGHT], _OWN, _OWN),
            (_OWN, _OWN[_LEFT], _OWN[_RIGHT], _OWN[_FAR]),
        )
    ]
)
_WEIGHTS = np.repeat([[2, -1, 0, 0]] * 4 + [[4, -2, -2, 1]], 4, axis=0)
