"""Cages of graded spaces: refined further in parts, as one cage whose functions are extracted.

Of each level the faces that are not refined further are elements. They are kept with one layer of
faces around them, on which no other element depends, as a part of one cage by itself. A matrix has
the controls of all parts from the unknowns: truncated hierarchical functions, which are chosen by
their supports (``derivations/elements.py``, 4).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.caching import cached_property
from limitsurf.cage.mesh import Mesh
from limitsurf.cage.selection import selected
from limitsurf.fem.elements import Elements
from limitsurf.fem.ends import trimmed
from limitsurf.fem.joining import joined
from limitsurf.options import Rules
from limitsurf.refine import refined
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

LAYERS = 3  # of faces around special corners
AROUND = 2  # around faces that are chosen, by which all finer functions on them are there
_CHILDREN = 4  # of a face after the first step
_SURROUNDINGS = 2  # layers from which one step gives all that finer faces depend on


class Grading:
    """What a graded space is made of.

    Attributes
    ----------
    surface : LimitSurface
        Over the parts of all levels.
    extraction : csr_array, (n_vertices, n)
        From unknowns to the vertices of `surface`.
    parent, level : (n_faces,) int
        Of faces of `surface`: the face of the cage they are in, -1 without a limit, and their level
        beyond the first.
    rim : (n_corners,) bool
        Corners of `surface` at which sides on its boundary begin, not those between levels.
    told : (n_vertices,) bool
        Vertices of `surface` of elements of the level of which their own function is.
    """

    def __init__(
        self,
        surface: LimitSurface,
        parent: Array,
        near_poles: int,
        more: Array,
        chosen: list[Array],
    ) -> None:
        from scipy.sparse import diags_array, eye_array, hstack, vstack

        mesh = _begun(surface, parent, more)
        self._steps: list[Any] = []
        self._active: list[Array] = []
        chain: Any = None
        rows, parts, told = [], [], []
        self.chosen, self._children = chosen, max(_CHILDREN, int(mesh.sizes.max()))
        deepest = max(near_poles, int(more.max(initial=0)), len(chosen))
        for k in range(deepest + 1):
            inside = mesh.face_data["inside"] > 0
            finer = inside & _refined_further(mesh, inside, k, near_poles)
            if k < len(chosen):
                here = inside & np.isin(mesh.face_data["number"], chosen[k])
                finer |= inside & grown(mesh, here, AROUND)
            own = surface if k == 0 else _around(mesh, inside, surface)
            covered, dropped = _supports(own, inside, finer, k == 0)
            active = np.flatnonzero(covered & ~dropped)
            self._active.append(active)
            new = eye_array(mesh.n_vertices, format="csr")[:, active]
            if chain is None:
                chain = new
            else:
                before = diags_array((~covered).astype(float)) @ (self._steps[-1] @ chain)
                chain = hstack([before, new], format="csr")
            part, used = _part(mesh, own, inside & ~finer, k)
            if part is not None:
                parts.append(part)
                rows.append(chain[used])
                told.append((covered & ~dropped)[used])
            if not finer.any():
                break
            mesh, step = _step(mesh, finer, self._radix(k))
            self._steps.append(step)
        n = chain.shape[1]
        for one in rows:
            one.resize((one.shape[0], n))
        self.extraction = vstack(rows, format="csr")
        self.extraction.eliminate_zeros()
        self.parent, self.level, self._number = (
            np.concatenate([part.mesh.face_data[name] for part in parts])
            for name in ("parent", "level", "number")
        )
        self.rim = np.concatenate([part.rim for part in parts])
        self.told = np.concatenate(told)
        self._base = surface.mesh
        found = joined([part.mesh for part in parts])
        self.surface = LimitSurface(found, engine=surface.engine)

    @property
    def n(self) -> int:
        """Number of unknowns."""
        return int(self.extraction.shape[1])

    @cached_property
    def sides(self) -> tuple[Array, Array, Array]:
        """Of each corner of `surface` the corner of the first cage on whose side its own side is.

        -1 where it is on none. Also which part of that side, counted from 0, of 2 to what power:
        of the first half of a side from the child at its start, of the other from that at its end.
        """
        mesh, base = self.surface.mesh, self._base
        face = mesh.corner_face
        number, level = self._number[face], self.level[face]
        size, k = mesh.sizes[face], np.arange(mesh.n_corners) - mesh.offsets[face]
        on, regular = self.parent[face] >= 0, self.surface.topology.lattice.face_size
        part = np.zeros(mesh.n_corners, dtype=np.int64)
        for step in range(int(level.max(initial=0)), 0, -1):
            here = np.flatnonzero(level >= step)
            above, child = np.divmod(number[here], self._radix(step - 1))
            sides = base.sizes[above] if step == 1 else np.full(len(here), regular)
            first, last = k[here] == 0, k[here] == size[here] - 1
            on[here] &= (first | last) & (child < sides)
            part[here] += np.where(last, 1 << (level[here] - step), 0)
            k[here] = np.where(first, child, (child - 1) % sides)
            size[here], number[here] = sides, above
        corner = np.where(on, base.offsets[np.where(on, number, 0)] + k, -1)
        return corner, part, level

    def _radix(self, k: int) -> int:
        """By what numbers of faces of level k are multiplied to have those of their children."""
        return self._children if k == 0 else _CHILDREN

    def and_chosen(self, faces: Array) -> list[Array]:
        """Faces that were chosen and some of `surface`, by their numbers at each level.

        With those that they are in, so that there is room around them.
        """
        found = []
        above = np.zeros(0, dtype=np.int64)
        for k in range(int(self.level[faces].max()), -1, -1):
            own = self._number[faces[self.level[faces] == k]]
            old = self.chosen[k] if k < len(self.chosen) else own[:0]
            found.append(np.unique(np.concatenate([above, own, old])))
            above = found[-1] // self._radix(k - 1) if k else above
        found.reverse()
        return found + self.chosen[len(found) :]

    def prolonged(self, values: Any) -> Any:
        """Unknowns of functions, from what is at the vertices of the first level, sparse or not.

        Coefficients of truncated functions are those of the level that they are of.
        """
        found = [values[self._active[0]]]
        for step, active in zip(self._steps, self._active[1:], strict=True):
            values = step @ values
            found.append(values[active])
        if isinstance(values, np.ndarray):
            return np.concatenate(found)
        from scipy.sparse import vstack

        return vstack(found, format="csr")


class _Part:
    """Elements of one level with what they depend on."""

    def __init__(self, mesh: Mesh, rim: Array) -> None:
        self.mesh, self.rim = mesh, rim


def _begun(surface: LimitSurface, parent: Array, more: Array) -> Mesh:
    """The cage of the first level, with what its faces hand down to their children."""
    data = {
        "parent": parent,
        "more": np.where(parent >= 0, more[parent], 0),
        "inside": np.ones(len(parent), dtype=np.int64),
        "number": np.arange(len(parent)),
    }
    return surface.mesh.with_tags(channels=None, **surface.rules, face_data=data)


def grown(mesh: Mesh, faces: Array, layers: int) -> Array:
    """Which faces (n_faces,) are some or within layers around them."""
    for _ in range(layers):
        at = np.zeros(mesh.n_vertices, dtype=bool)
        at[mesh.indices[faces[mesh.corner_face]]] = True
        faces = np.zeros(mesh.n_faces, dtype=bool)
        faces[mesh.corner_face[at[mesh.indices]]] = True
    return faces


def _refined_further(mesh: Mesh, inside: Array, k: int, near_poles: int) -> Array:
    """Which faces of level k are near enough to special corners, or to chosen faces."""
    found = grown(mesh, inside & (mesh.face_data["more"] > k), AROUND)
    if k < near_poles:
        rules = Rules.resolve(mesh)
        limit = inside & ~rules.without_limit(mesh)
        odd = limit & (mesh.sizes != rules.scheme.lattice.face_size)
        found |= grown(mesh, odd, LAYERS - 1)
        special = _special(mesh, rules)
        first = limit & (np.bincount(mesh.corner_face, special[mesh.indices]) > 0)
        at = np.zeros(mesh.n_vertices, dtype=bool)
        at[mesh.indices[first[mesh.corner_face]]] = True
        near = np.zeros(mesh.n_faces, dtype=bool)
        near[mesh.corner_face[(special & at)[mesh.indices]]] = True
        found |= grown(mesh, near, LAYERS - 1)
    return found


def _special(mesh: Mesh, rules: Rules) -> Array:
    """Which vertices are not those of a spline: poles, darts, ends and crossings of creases."""
    regular = rules.scheme.lattice.valence
    boundary = mesh.boundary_vertex
    faces = mesh.vertex_faces
    found = np.where(boundary, 2 * faces > regular, faces != regular)
    edges, sharpness = mesh.creases
    sharp = edges[np.asarray(~mesh.boundary_edge[mesh.edge_numbers(edges)] & (sharpness > 0))]
    ends = np.bincount(sharp.ravel(), minlength=mesh.n_vertices)
    found |= np.where(boundary, ends > 0, (ends == 1) | (ends > 2))
    pointed = mesh.corners[0]
    found[pointed[~boundary[pointed]]] = True
    return np.asarray(found)


def _around(mesh: Mesh, inside: Array, surface: LimitSurface) -> LimitSurface:
    """The surface of faces and of one layer around them."""
    holes = ~grown(mesh, inside, 1)
    holes[mesh.holes] = True
    return LimitSurface(mesh.with_tags(holes=np.flatnonzero(holes)), engine=surface.engine)


def _supports(
    surface: LimitSurface, inside: Array, finer: Array, complete: bool
) -> tuple[Array, Array]:
    """Of which vertices functions vanish outside some faces, and outside those refined further."""
    mesh, face = surface.mesh, surface.limit_faces.face
    count = np.zeros((3, mesh.n_vertices), dtype=np.int64)
    for group in Elements(surface, complete=complete).groups:
        at = face[group.faces]
        for to, which in zip(count, (at >= 0, inside[at], finer[at]), strict=True):
            to += np.bincount(group.controls[which].ravel(), minlength=mesh.n_vertices)
    return (count[1] == count[0]) & (count[0] > 0), (count[2] == count[0]) & (count[0] > 0)


def _part(mesh: Mesh, own: LimitSurface, elements: Array, k: int) -> tuple[_Part | None, Array]:
    """Elements with what they depend on, and which vertices of the mesh they have."""
    limit = own.patches.with_limit[own.limit_faces.first]
    if not (elements & limit).any():
        return None, np.zeros(0, dtype=np.int64)
    parent = np.where(elements & limit, mesh.face_data["parent"], -1)
    data = {
        "parent": parent,
        "level": np.full(mesh.n_faces, k),
        "number": mesh.face_data["number"],
        "own": np.arange(mesh.n_faces),
    }
    tagged = mesh.with_tags(holes=np.flatnonzero(~(elements & limit)), face_data=data)
    found, operator = trimmed(tagged, Rules.resolve(tagged))
    used = np.arange(mesh.n_vertices) if operator is None else operator.indices
    both = mesh.edge_corners
    there = (both >= 0) & limit[mesh.corner_face[both]]
    rim = np.zeros(mesh.n_corners, dtype=bool)
    rim[both[(there.sum(axis=1) == 1)[:, None] & there]] = True
    rim &= elements[mesh.corner_face]
    kept = np.zeros(mesh.n_faces, dtype=bool)
    kept[found.face_data["own"]] = True
    return _Part(found, rim[kept[mesh.corner_face]]), used


def _step(mesh: Mesh, finer: Array, radix: int) -> tuple[Mesh, Any]:
    """The refined cage of some faces and their surroundings, and the matrix to it."""
    from scipy.sparse import eye_array

    which = grown(mesh, finer, _SURROUNDINGS)
    used = np.zeros(mesh.n_vertices, dtype=bool)
    used[mesh.indices[which[mesh.corner_face]]] = True
    data = dict(mesh.face_data, inside=finer.astype(np.int64))
    some = selected(mesh.with_tags(face_data=data), which)
    fine, operator = refined(some, 1, operator=True)
    number = fine.face_data["number"]
    order = np.argsort(number, kind="stable")
    first = np.searchsorted(number[order], number[order])
    child = np.empty(len(number), dtype=np.int64)
    child[order] = np.arange(len(number)) - first
    data = dict(fine.face_data, number=radix * number + child)
    return fine.with_tags(face_data=data), operator @ eye_array(mesh.n_vertices, format="csr")[
        np.flatnonzero(used)
    ]
