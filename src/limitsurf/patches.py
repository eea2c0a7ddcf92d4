"""Patch table: for each limit face its exact patches and their control points.

A quad is a patch as it is when all faces around its corners are quads and nothing semi-sharp is at
them, and at most one corner is special: not regular in the sense of `Sectors.regular`. It is a
patch too where a semi-sharp crease of one sharpness runs along one of its sides and goes straight
on at both ends: there the surface is a tensor product (``derivations/creases.py``). Otherwise it is
split into its four children, an n-gon into n, by one refinement of its neighbourhood. Infinitely
sharp edges part the mesh: what lies beyond one is replaced by reflections, which is exact at
regular vertices, or has no influence.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import tables
from limitsurf._kernels import reference as kernels
from limitsurf.mesh import Mesh
from limitsurf.refine import entries, refinement_stages, sparse_operator
from limitsurf.rules import ASTRAY, CREASE, Rules, Sectors, Sharpness
from limitsurf.topology import MeshPart, child_mesh, first_limit_face

Array = NDArray[Any]

# kinds of patches; further ones are numbered as they occur
REGULAR, STRIP = 0, 1
NO_LIMIT = -1


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
        the order of ``exact/matrices.py``.
    sharpness : (strips,)
        Sharpness of the creases of strips.
    extras : list of operators
        Sparse rows, float64 or exact, over all control points of lower number.
    """

    def __init__(self, mesh: Mesh, rules: Rules, dtype: Any) -> None:
        self.n_limit_faces = int(first_limit_face(mesh)[-1])
        self.n_vertices = self.n_points = mesh.n_vertices
        self.extras: list[Any] = []
        self._dtype = dtype
        self._codes = [np.full(self.n_limit_faces, NO_LIMIT)]
        self._n_codes = self.n_limit_faces
        self._patches: list[tuple[Array, Array, Array]] = [(np.zeros(0, np.int64),) * 3]
        self._n_patches = 0
        self.sectors: list[tables.Sector | None] = [None, None]
        self._controls: list[list[Array]] = [[np.zeros((0, 16), np.int32)] for _ in range(2)]
        self._kinds: dict[tables.Sector, int] = {}
        self._sharpness = [np.zeros(0, dtype=dtype)]
        self._build(mesh, rules)
        self.codes = np.concatenate(self._codes).astype(np.int32)
        self.kind, self.row, self.turn = (
            np.concatenate(x).astype(kind)
            for x, kind in zip(
                zip(*self._patches, strict=True), (np.int32, np.int32, np.int8), strict=True
            )
        )
        self.controls = [np.concatenate(rows) for rows in self._controls]
        self.sharpness = np.concatenate(self._sharpness)
        del self._codes, self._patches, self._controls, self._kinds, self._sharpness
        self._drop_unused()

    def _build(self, mesh: Mesh, rules: Rules) -> None:
        """Fill the table level by level; most faces of most cages end at the first."""
        faces = np.flatnonzero(~rules.without_limit(mesh))
        ids = np.arange(mesh.n_vertices)
        slot = first_limit_face(mesh)[faces]
        turn = np.zeros(len(faces), dtype=np.int64)
        sharpness = Sharpness.of(mesh, rules, self._dtype)
        _refuse_astray(Sectors.of(sharpness), faces)
        while len(faces):
            sectors = Sectors.of(sharpness)
            quad = mesh.sizes[faces] == 4
            corners = mesh.offsets[faces][:, None] + np.where(quad[:, None], np.arange(4), 0)
            fan = sectors.fans.fan[corners]  # (F, 4)
            beside_ngon = np.zeros(len(sectors.kind), dtype=bool)
            beside_ngon[sectors.fans.fan[mesh.sizes[mesh.corner_face] != 4]] = True
            simple = quad & ~beside_ngon[fan].any(axis=1)
            regular = sectors.regular[fan]
            settled = simple & (sectors.kind[fan] >= 0).all(axis=1)
            special = settled & (regular.sum(axis=1) == 3)
            plain = settled & regular.all(axis=1)
            crease = self._crease(sharpness, sectors, corners, simple)
            strip = crease >= 0
            # first corner of the patch: that at (0, 0), the special one, or that before the crease
            start = np.where(strip, crease, np.where(special, (~regular).argmax(axis=1), -turn % 4))
            for kind, members, ring in self._kinds_of(sectors, corners, start, special):
                grid = self._grid(mesh, sectors.twin, ids, corners[members], start[members])
                sector = self.sectors[kind]
                assert sector is not None
                outer = [4 * j + i for i, j in sector.outer]
                control = np.concatenate([ids[ring], grid[:, outer]], axis=1)
                square = (turn[members] + start[members]) % 4
                self._add(kind, control, slot[members], square)
            for kind, which in ((REGULAR, plain), (STRIP, strip)):
                members = np.flatnonzero(which)
                grid = self._grid(mesh, sectors.twin, ids, corners[members], start[members])
                square = (turn[members] + start[members]) % 4
                self._add(kind, grid, slot[members], square)
            side = corners[strip, crease[strip]]
            self._sharpness.append(sharpness.half_edges[side])
            split = ~(plain | special | strip)
            sharpness, ids, faces, slot, turn = self._split(
                sharpness, ids, rules, faces[split], slot[split], turn[split]
            )
            mesh = sharpness.mesh

    @staticmethod
    def _crease(sharpness: Sharpness, sectors: Sectors, corners: Array, simple: Array) -> Array:
        """Side of each face (F,) along which a semi-sharp crease runs straight; -1 if none does.

        Both ends are in the midst of four faces with no other sharp edge, the other two corners
        are regular.
        """
        mesh = sharpness.mesh
        along = sharpness.half_edges[corners]  # (F, 4)
        soft = (along > 0) & ~tables.is_infinite(along)
        alone = simple & (soft.sum(axis=1) == 1)
        side = np.where(alone, soft.argmax(axis=1), 0)
        each = np.arange(len(corners))
        far = [corners[each, (side + k) % 4] for k in (2, 3)]
        fine = alone
        for h in far:
            fine &= sectors.regular[sectors.fans.fan[h]]
        value = along[each, side]
        ends = corners[each, side], corners[each, (side + 1) % 4]
        for h in ends:
            vertex, fan = mesh.indices[h], sectors.fans.fan[h]
            fine &= sectors.fans.closed[fan] & (sectors.fans.sizes[fan] == 4)
            fine &= (sharpness.rule[vertex] == CREASE) & (sharpness.straight[vertex] == value)
        # opposite to the side: two edges on from it, three from the face's next edge
        for h, steps in zip(ends, (2, 3), strict=True):
            for _ in range(steps):
                h = np.where(fine, sectors.twin[mesh.previous_corner[h]], 0)
            fine &= sharpness.half_edges[h] > 0
        return np.where(fine, side, -1)

    def _kinds_of(
        self, sectors: Sectors, corners: Array, start: Array, special: Array
    ) -> Iterator[tuple[int, Array, Array]]:
        """Special faces by kind: number of the kind, faces, rings of their corners (n, ring)."""
        members = np.flatnonzero(special)
        corner = corners[members, start[members]]
        fan, position = sectors.fans.fan[corner], sectors.fans.position[corner]
        kinds, sizes = sectors.kind[fan], sectors.fans.sizes[fan]
        alike = np.isin(kinds, [tables.KINDS.index(name) for name in ("interior", "cone")])
        key = np.stack([kinds, sizes, np.where(alike, 0, position)])
        unique, which = np.unique(key, axis=1, return_inverse=True)
        for k, (kind, faces, place) in enumerate(unique.T.tolist()):
            sector = tables.Sector(tables.KINDS[kind], faces, place)
            here = np.flatnonzero(which.ravel() == k)
            begin = position[here] if alike[here[0]] else 0
            number = self._kinds.setdefault(sector, len(self.sectors))
            if number == len(self.sectors):
                self.sectors.append(sector)
                self._controls.append([])
            yield number, members[here], sectors.ring(sector.kind, faces, fan[here], begin)

    def _add(self, kind: int, controls: Array, slot: Array, turn: Array) -> None:
        n = len(controls)
        rows = sum(map(len, self._controls[kind])) + np.arange(n)
        self._controls[kind].append(controls.astype(np.int32))
        self._patches.append((np.full(n, kind), rows, turn))
        self._fill(slot, self._n_patches + np.arange(n))
        self._n_patches += n

    def _fill(self, slot: Array, code: Array) -> None:
        """Write codes at places in the concatenation of all blocks."""
        start = 0
        for block in self._codes:
            here = (slot >= start) & (slot < start + len(block))
            block[slot[here] - start] = code[here]
            start += len(block)

    def _grid(self, mesh: Mesh, twins: Array, ids: Array, corners: Array, start: Array) -> Array:
        """4 x 4 control points (P, 16) of quads from their corner `start` on, index 4 j + i.

        What lies beyond a special corner, or beyond a sharp edge at it, is meaningless and not
        used.
        """
        h = np.take_along_axis(corners, (start[:, None] + np.arange(4)) % 4, axis=1)  # (P, 4)
        after, before = mesh.next_corner, mesh.previous_corner
        tail, twin = mesh.indices, twins
        t, s = twin[h], twin[before[h]]
        grid = np.empty((len(h), 16), dtype=np.int64)
        grid[:, _CORNER] = ids[tail[h]]
        # beyond each corner: across its own edge, across the edge before it, and diagonally
        grid[:, _ACROSS] = ids[tail[after[after[t]]]]
        grid[:, _BESIDE] = ids[tail[before[s]]]
        grid[:, _BEYOND] = ids[tail[before[twin[after[t]]]]]
        rim = t < 0  # (P, 4): side k, from corner k to k + 1, is on the boundary
        for k in range(4):
            left, right = (k - 1) % 4, (k + 1) % 4
            place = np.flatnonzero(rim[:, k])
            for target, on, inner in (
                (_ACROSS[k], _CORNER[k], _CORNER[left]),
                (_BESIDE[right], _CORNER[right], _CORNER[(k + 2) % 4]),
            ):
                self._reflect(grid, place, target, ((on, 2), (inner, -1)))
            place = np.flatnonzero(rim[:, k] & ~rim[:, left])
            terms = ((_BESIDE[k], 2), (_ACROSS[left], -1))
            self._reflect(grid, place, _BEYOND[k], terms)
            place = np.flatnonzero(rim[:, k] & ~rim[:, right])
            terms = ((_ACROSS[right], 2), (_BESIDE[(k + 2) % 4], -1))
            self._reflect(grid, place, _BEYOND[right], terms)
            place = np.flatnonzero(rim[:, k] & rim[:, left])
            corner = ((_CORNER[k], 4), (_CORNER[left], -2), (_CORNER[right], -2))
            self._reflect(grid, place, _BEYOND[k], (*corner, (_CORNER[(k + 2) % 4], 1)))
        return grid

    def _reflect(
        self, grid: Array, place: Array, target: int, terms: tuple[tuple[int, int], ...]
    ) -> None:
        """Make new control points at `target` of the grids `place`: integer combinations."""
        if len(place) == 0:
            return
        columns = np.concatenate([grid[place, position] for position, _ in terms])
        weights = np.repeat([weight for _, weight in terms], len(place))
        values = kernels.exact(weights) if self._dtype == object else weights.astype(float)
        rows = np.tile(np.arange(len(place)), len(terms))
        grid[place, target] = self._extend(
            sparse_operator(rows, columns, values, (len(place), self.n_points))
        )

    def _extend(self, operator: Any) -> Array:
        """Append the rows of an operator as control points; return their numbers."""
        numbers = self.n_points + np.arange(operator.shape[0])
        self.extras.append(operator)
        self.n_points += operator.shape[0]
        return numbers

    def _split(
        self, sharpness: Sharpness, ids: Array, rules: Rules, faces: Array, slot: Array, turn: Array
    ) -> tuple[Sharpness, Array, Array, Array, Array]:
        """Refine the neighbourhood of `faces`; return it with the children of these faces.

        Quads become splits, and the limit faces of n-gons go straight to their children.
        """
        if len(faces) == 0:
            return sharpness, ids, faces, slot, turn
        mesh = sharpness.mesh
        wanted = np.zeros(mesh.n_faces, dtype=bool)
        wanted[faces] = True
        near = MeshPart.of(mesh, sharpness.neighbours(wanted[mesh.corner_face]))
        part = near.mesh
        inner = sharpness.part(near)
        # points of the part, then its face points, then its vertex and edge points, all numbered
        numbers = ids[near.vertices]
        face_points, refined = refinement_stages(part, rules, inner, self._dtype)
        centres = self._extend(_renumbered(face_points, numbers, self.n_points))
        numbers = np.concatenate([numbers, centres])
        count = refined.shape[0] - part.n_faces
        others = self._extend(_renumbered(refined, numbers, self.n_points, count))
        new = np.concatenate([others, centres])
        children = child_mesh(part, np.arange(len(new)))
        local = np.searchsorted(near.faces, faces)
        sizes = part.sizes[local]
        corner = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        child = np.repeat(part.offsets[local], sizes) + corner
        quad = np.repeat(sizes == 4, sizes)
        # only the first level has n-gons: there the slot of a face is its first limit face
        n_splits = int((sizes == 4).sum())
        split = (self._n_codes - self.n_limit_faces) // 4 + np.arange(n_splits)
        self._fill(slot[sizes == 4], -2 - split)
        self._codes.append(np.full(4 * n_splits, NO_LIMIT))
        square = (np.repeat(turn, sizes) + corner) % 4
        quadrant = np.array([0, 1, 3, 2])[square]
        new_slot = np.repeat(slot, sizes) + corner
        new_slot[quad] = self._n_codes + np.repeat(4 * np.arange(n_splits), 4) + quadrant[quad]
        self._n_codes += 4 * n_splits
        return inner.children(children), new, child, new_slot, np.where(quad, square, 0)

    def _drop_unused(self) -> None:
        """Leave out control points that no patch needs, and number the others anew."""
        needed = np.zeros(self.n_points, dtype=bool)
        needed[: self.n_vertices] = True
        for control in self.controls:
            needed[control] = True
        starts = self.n_vertices + np.cumsum([0, *(x.shape[0] for x in self.extras)])
        for operator, start in zip(self.extras[::-1], starts[-2::-1], strict=True):
            rows, columns, _ = entries(operator)
            needed[columns[needed[start + rows]]] = True
        number = np.cumsum(needed) - 1
        kept = []
        for operator, start in zip(self.extras, starts, strict=False):
            rows, columns, values = entries(operator)
            place = np.cumsum(needed[start : start + operator.shape[0]]) - 1
            here = needed[start + rows]
            shape = (int(place[-1]) + 1, int(number[start - 1]) + 1)
            if shape[0]:
                new = place[rows[here]], number[columns[here]]
                kept.append(sparse_operator(*new, values[here], shape))
        self.extras = kept
        self.controls = [number[control].astype(np.int32) for control in self.controls]
        self.n_points = int(needed.sum())

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


def _refuse_astray(sectors: Sectors, faces: Array) -> None:
    """Complain of faces at a vertex that follows a crease on which they do not border."""
    mesh = sectors.mesh
    wanted = np.zeros(mesh.n_faces, dtype=bool)
    wanted[faces] = True
    astray = np.flatnonzero((sectors.kind == ASTRAY)[sectors.fans.fan] & wanted[mesh.corner_face])
    if len(astray):
        vertex, face = mesh.indices[astray[0]], mesh.corner_face[astray[0]]
        raise NotImplementedError(
            f"vertex {vertex} follows a crease of non-manifold edges, but face {face} belongs to "
            "others there, a cone or a loop, that do not lie between the two edges of that crease: "
            "their limit is not evaluated; make the vertex a corner of sharpness 10, or the faces "
            "holes"
        )


def _renumbered(operator: Any, numbers: Array, n_columns: int, n_rows: int | None = None) -> Any:
    """The first rows of an operator, on columns `numbers` of `n_columns`."""
    n_rows = operator.shape[0] if n_rows is None else n_rows
    rows, columns, values = entries(operator)
    kept = rows < n_rows
    return sparse_operator(rows[kept], numbers[columns[kept]], values[kept], (n_rows, n_columns))


# grid positions 4 j + i of the corners of the quad and of the points beyond them
_CORNER = np.array([5, 6, 10, 9])
_ACROSS = np.array([1, 7, 14, 8])
_BESIDE = np.array([4, 2, 11, 13])
_BEYOND = np.array([0, 3, 15, 12])
