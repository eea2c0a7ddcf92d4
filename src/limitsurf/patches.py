"""Patch table: for each limit face its exact patches and their control points.

A quad is a patch as it is when all faces around its corners are quads and at most one corner is
extraordinary, that is, interior of valence other than 4. Otherwise it is split into its four
children, an n-gon into n, by one refinement of its neighbourhood; after two levels every child is
a patch. Where a patch meets a boundary its missing control points are reflections of inner ones,
which is exact at regular boundary vertices (``derivations/masks_bicubic.py``).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels import reference as kernels
from limitsurf.mesh import Mesh
from limitsurf.refine import (
    ExactOperator,
    Rules,
    child_mesh,
    first_limit_face,
    refinement_stages,
    sparse_operator,
)

Array = NDArray[Any]

REGULAR = 4  # the kind of a regular patch; the kind of any other is the valence of its corner
NO_LIMIT = -1


@dataclass(frozen=True)
class LimitFaces:
    """The limit faces of a mesh: one for a quad, n for an n-gon, in the order of its corners.

    Attributes
    ----------
    face : (n_limit_faces,) int
        Face of the mesh that each belongs to.
    corner : (n_limit_faces,) int
        Its corner of an n-gon; -1 for quads.
    first : (n_faces,) int
        First limit face of each face.
    """

    face: Array
    corner: Array
    first: Array

    @classmethod
    def of(cls, mesh: Mesh) -> LimitFaces:
        """Number the limit faces of `mesh`."""
        first = first_limit_face(mesh)
        face = np.repeat(np.arange(mesh.n_faces), np.diff(first))
        corner = np.where(mesh.sizes[face] == 4, -1, np.arange(len(face)) - first[face])
        return cls(face, corner, first[:-1])

    def __len__(self) -> int:
        return len(self.face)


class PatchTable:
    """Patches of all limit faces, and the control points beyond those of the cage.

    Control points are numbered: the vertices of the cage first, then the rows of each operator in
    `extras`, which combine points of lower number.

    Attributes
    ----------
    codes : (n_limit_faces + 4 n_splits,) int
        What covers each limit face, then each quadrant ``i + 2 j`` (i along u, j along v) of each
        split: a patch >= 0, `NO_LIMIT`, or ``-2 - s`` for split s.
    kind : (n_patches,) int
        `REGULAR`, or the valence of the extraordinary corner.
    row : (n_patches,) int
        Row of the patch in ``controls[kind]``.
    turn : (n_patches,) int
        Corner of the parameter square at which the extraordinary corner lies; 0 if regular.
    controls : {kind: (patches, K) int}
        Control points: 16 for regular patches, index ``4 j + i``; ``2 N + 8`` for the others in
        the order of ``exact/matrices.py``.
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
        self._patches: list[tuple[Array, Array, Array]] = []
        self._n_patches = 0
        self._rows: Counter[int] = Counter()
        self._controls: dict[int, list[Array]] = {}
        self._build(mesh, rules)
        self.codes = np.concatenate(self._codes)
        kind, row, turn = (np.concatenate(x) for x in zip(*self._patches, strict=True))
        self.kind, self.row, self.turn = kind, row, turn
        self.controls = {k: np.concatenate(rows) for k, rows in self._controls.items()}
        del self._codes, self._patches, self._rows, self._controls

    def _build(self, mesh: Mesh, rules: Rules) -> None:
        """Fill the table level by level; most faces of most cages end at the first."""
        faces = np.flatnonzero(~rules.without_limit(mesh))
        ids = np.arange(mesh.n_vertices)
        slot = first_limit_face(mesh)[faces]
        turn = np.zeros(len(faces), dtype=np.int64)
        self._patches.append((np.zeros(0, np.int64),) * 3)
        while len(faces):
            simple, irregular = _classify(mesh)
            quads = mesh.offsets[faces][:, None] + np.arange(4)
            ready = (mesh.sizes[faces] == 4) & simple[faces]
            at = irregular[mesh.indices[np.where(ready[:, None], quads, 0)]] & ready[:, None]
            ready &= at.sum(axis=1) <= 1
            special = ready & at.any(axis=1)
            # first corner of the patch: the extraordinary one, or that at (0, 0)
            start = np.where(special, at.argmax(axis=1), -turn % 4)
            for kind, members in self._kinds(mesh, faces, start, ready, special):
                grid = self._grid(mesh, ids, mesh.offsets[faces[members]], start[members])
                if kind != REGULAR:
                    corner = mesh.offsets[faces[members]] + start[members]
                    grid = np.concatenate([_ring(mesh, ids, corner, kind), grid[:, _OUTER]], axis=1)
                square = (turn[members] + start[members]) % 4
                self._add(kind, grid, slot[members], square)
            split = ~ready
            mesh, ids, faces, slot, turn = self._split(
                mesh, ids, rules, faces[split], slot[split], turn[split]
            )

    @staticmethod
    def _kinds(
        mesh: Mesh, faces: Array, start: Array, ready: Array, special: Array
    ) -> Iterator[tuple[int, Array]]:
        """Group the faces that are patches by kind."""
        kind = np.zeros(len(faces), dtype=np.int64)
        kind[ready & ~special] = REGULAR
        corner = mesh.indices[mesh.offsets[faces[special]] + start[special]]
        kind[special] = mesh.vertex_faces[corner]
        for k in np.unique(kind[ready]).tolist():
            yield k, np.flatnonzero(kind == k)

    def _add(self, kind: int, controls: Array, slot: Array, turn: Array) -> None:
        n = len(controls)
        rows = self._rows[kind] + np.arange(n)
        self._rows[kind] += n
        self._controls.setdefault(kind, []).append(controls.astype(np.int32))
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

    def _grid(self, mesh: Mesh, ids: Array, first: Array, start: Array) -> Array:
        """4 x 4 control points (P, 16) of quads from their corner `start` on, index 4 j + i.

        The point diagonally beyond an extraordinary corner is meaningless and not used.
        """
        h = first[:, None] + (start[:, None] + np.arange(4)) % 4  # (P, 4)
        after, before = mesh.next_corner, mesh.previous_corner
        tail, twin = mesh.indices, mesh.twin
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
        self, mesh: Mesh, ids: Array, rules: Rules, faces: Array, slot: Array, turn: Array
    ) -> tuple[Mesh, Array, Array, Array, Array]:
        """Refine the neighbourhood of `faces`; return it with the children of these faces.

        Quads become splits, and the limit faces of n-gons go straight to their children.
        """
        if len(faces) == 0:
            return mesh, ids, faces, slot, turn
        touched = np.zeros(mesh.n_vertices, dtype=bool)
        wanted = np.zeros(mesh.n_faces, dtype=bool)
        wanted[faces] = True
        touched[mesh.indices[wanted[mesh.corner_face]]] = True
        near = np.zeros(mesh.n_faces, dtype=bool)
        near[mesh.corner_face[touched[mesh.indices]]] = True
        used, part = np.arange(mesh.n_vertices), mesh
        if not near.all():
            used, indices = np.unique(mesh.indices[near[mesh.corner_face]], return_inverse=True)
            part = Mesh._from_valid(used, mesh.sizes[near], indices)
        # points of the part, then its face points, then its refined points, all numbered
        stages = refinement_stages(part, rules, self._dtype)
        numbers = ids[used]
        for stage in stages:
            new = self._extend(_renumbered(stage, numbers, self.n_points))
            numbers = np.concatenate([numbers, new])
        ids = new
        children = child_mesh(part, np.arange(len(new)))
        own = np.flatnonzero(near)
        local = np.searchsorted(own, faces)
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
        return children, ids, child, new_slot, np.where(quad, square, 0)

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
        patch = code[code >= 0]
        counts = [
            ("one regular patch", int((self.kind[patch] == REGULAR).sum())),
            ("one patch with an extraordinary corner", int((self.kind[patch] != REGULAR).sum())),
            ("split around n-gons or several extraordinary corners", int((code <= -2).sum())),
            ("no limit (holes)", int((code == NO_LIMIT).sum())),
        ]
        return [(reason, number) for reason, number in counts if number]


def irregular_boundary(mesh: Mesh, rules: Rules) -> Array:
    """Boundary vertices of faces with a limit that are not regular: not of two faces, nor sharp."""
    odd = mesh.boundary_vertex & (mesh.vertex_faces != 2) & ~rules.sharp(mesh)
    with_limit = ~rules.without_limit(mesh)[mesh.corner_face]
    return np.unique(mesh.indices[with_limit & odd[mesh.indices]])


def _renumbered(operator: Any, numbers: Array, n_columns: int) -> Any:
    """The operator on columns `numbers` of `n_columns`."""
    if isinstance(operator, ExactOperator):
        rows, columns, values = operator.rows, operator.columns, operator.values
    else:
        entries = operator.tocoo()
        rows, columns, values = entries.row, entries.col, entries.data
    return sparse_operator(rows, numbers[columns], values, (operator.shape[0], n_columns))


# grid positions 4 j + i of the corners of the quad and of the points beyond them
_CORNER = np.array([5, 6, 10, 9])
_ACROSS = np.array([1, 7, 14, 8])
_BESIDE = np.array([4, 2, 11, 13])
_BEYOND = np.array([0, 3, 15, 12])
# the outer points of an extraordinary patch: (3, 0) ... (3, 3) ... (0, 3) as (i, j)
_OUTER = np.array([3, 7, 11, 15, 14, 13, 12])


def _classify(mesh: Mesh) -> tuple[Array, Array]:
    """Faces whose corners all lie among quads (n_faces,); extraordinary vertices (n_vertices,)."""
    beside_ngon = np.zeros(mesh.n_vertices, dtype=bool)
    beside_ngon[mesh.indices[mesh.sizes[mesh.corner_face] != 4]] = True
    simple = ~np.logical_or.reduceat(beside_ngon[mesh.indices], mesh.offsets[:-1])
    return simple, ~mesh.boundary_vertex & (mesh.vertex_faces != 4)


def _ring(mesh: Mesh, ids: Array, corner: Array, valence: int) -> Array:
    """Vertex at each corner (P,), then its neighbours and opposite corners, (P, 2 N + 1)."""
    vertex = mesh.indices[corner]
    turns = (mesh.ring_position[corner][:, None] + np.arange(valence)) % valence
    h = mesh.ring_corners[mesh.ring_offsets[vertex][:, None] + turns]
    neighbour = mesh.next_corner[h]
    pairs = np.stack([mesh.indices[neighbour], mesh.indices[mesh.next_corner[neighbour]]], axis=-1)
    ring = np.concatenate([vertex[:, None], pairs.reshape(len(corner), -1)], axis=1)
    return np.asarray(ids[ring])
