"""Meshes made from meshes, as integers: children, parts, and the numbering of limit faces."""

from __future__ import annotations

import weakref
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import _kernels
from limitsurf.mesh import IntArray, Mesh, read_only

Array = NDArray[Any]


class ChildConnectivity(dict[str, Any]):
    """Connectivity of the refinement of a mesh, derived from that of the mesh when it is needed.

    Parameters
    ----------
    mesh : Mesh
        The coarse mesh; its points do not matter.
    """

    def __init__(self, mesh: Mesh) -> None:
        super().__init__(
            _repeats=False, _large=mesh._large or _kernels.compiled(4 * mesh.n_corners)
        )
        self.mesh = without_points(mesh)
        self.sizes = read_only(np.full(mesh.n_corners, 4))
        self.indices = read_only(child_faces(mesh).ravel())

    def __missing__(self, name: str) -> Any:
        mesh = self.mesh
        if name == "twin":
            found: Any = child_twins(mesh)
        elif name == "_steps":
            found = 4, np.zeros(0, np.int64), np.zeros(0, np.int64)
        elif name in ("vertex_faces", "_valences"):
            sides = np.bincount(mesh.corner_edge, minlength=mesh.n_edges)
            if name == "_valences":
                sides = np.where(mesh.edge_corners[:, 1] >= 0, 2, np.where(sides == 1, -1, 0))
            found = np.concatenate([getattr(mesh, name), 2 * sides, mesh.sizes])
        elif name == "_edge_table" and mesh._compiled:
            found = _child_edges(mesh)
        else:
            raise KeyError(name)
        self[name] = found = read_only(found)
        return found


def _child_edges(mesh: Mesh) -> tuple[Array, Array, Array]:
    """``edges``, ``corner_edge`` and ``edge_corners`` of the refined mesh, without sorting."""
    from limitsurf._kernels import refinement

    V, E, H = mesh.n_vertices, mesh.n_edges, mesh.n_corners
    halves, edges, sides = (np.empty((n, 2), np.int64) for n in (E, 2 * E + H, 2 * E + H))
    corner_edge = np.empty(4 * H, np.int64)
    starts = [
        np.cumsum(count) - count
        for count in (np.bincount(mesh.edges.ravel(), minlength=V), np.bincount(mesh.corner_edge))
    ]
    refinement.child_edges(
        mesh.indices,
        quad_offsets(mesh),
        mesh.twin,
        mesh.edges,
        mesh.corner_edge,
        starts[0],
        2 * E + starts[1],
        halves,
        edges,
        corner_edge,
        sides,
    )
    return edges, corner_edge, sides


def without_points(mesh: Mesh) -> Mesh:
    """The faces of a mesh alone, which keep no points alive."""
    nowhere = np.broadcast_to(0.0, mesh.n_vertices)
    return Mesh._from_valid(nowhere, mesh.sizes, mesh.indices, mesh._connectivity)


def quad_offsets(mesh: Mesh) -> Array:
    """First corners of faces, (n_faces + 1,), as kernels take them: none if all are quads."""
    return mesh._steps[1] if mesh._steps[0] == 4 else mesh.offsets


def child_faces(mesh: Mesh) -> Array:
    """Quads of the refined mesh by corner of `mesh`, (n_corners, 4); see `refined`."""
    V, E = mesh.n_vertices, mesh.n_edges
    if mesh._compiled:
        from limitsurf._kernels import refinement

        result = np.empty((mesh.n_corners, 4), np.int64)
        known = mesh.indices, quad_offsets(mesh), mesh.corner_edge, V, E
        refinement.child_faces(*known, result.ravel())
        return result
    edge = V + mesh.corner_edge
    return np.stack(
        [mesh.indices, edge, V + E + mesh.corner_face, edge[mesh.previous_corner]], axis=1
    )


def child_twins(mesh: Mesh) -> Array:
    """The twins of the refined mesh, without sorting edges, (4 n_corners,)."""
    if mesh._compiled:
        from limitsurf._kernels import refinement

        result = np.empty(4 * mesh.n_corners, np.int64)
        refinement.child_twins(quad_offsets(mesh), mesh.twin, result)
        return result
    after, before, twin = mesh.next_corner, mesh.previous_corner, mesh.twin
    entering = twin[before]  # across the edge that ends at the corner
    # half-edges of child h: corner to midpoint, to face point, to midpoint before, to corner
    twins = [
        np.where(twin < 0, -1, 4 * after[twin] + 3),
        4 * after + 2,
        4 * before + 1,
        np.where(entering < 0, -1, 4 * entering),
    ]
    return np.stack(twins, axis=1).ravel()


def child_mesh(mesh: Mesh, points: Array) -> Mesh:
    """The refined mesh on given points; while one is alive, others share its connectivity."""
    if mesh._repeats:
        # no corner of a child is repeated, but the halves of an edge from a vertex to itself are
        # alike, and twins may be missing, then and ever after, that would be found in the child
        loop = mesh.indices == mesh.indices[mesh.next_corner]
        separate = np.zeros((mesh.n_corners, 4), dtype=bool)
        separate[:, 0], separate[:, 3] = loop, loop[mesh.previous_corner]
        known = {"twin": child_twins(mesh), "separate": separate.ravel(), "_repeats": True}
        known = read_only(known)
        sizes = np.full(mesh.n_corners, 4)
        return Mesh._from_valid(points, sizes, child_faces(mesh).ravel(), known)
    children = mesh._connectivity.get("children", lambda: None)()
    if children is None:
        children = ChildConnectivity(mesh)
        mesh._connectivity["children"] = weakref.ref(children)
    return Mesh._from_valid(points, children.sizes, children.indices, children)


@dataclass(frozen=True, eq=False)
class MeshPart:
    """Some faces of a mesh as a mesh of their own, with what they were.

    Attributes
    ----------
    mesh : Mesh
        Its points are `vertices`.
    wanted : (n_corners of the whole,) bool
        The corners whose faces they are.
    faces, corners, vertices : int arrays, ascending
    """

    mesh: Mesh
    wanted: Array
    faces: Array
    corners: Array
    vertices: Array

    @classmethod
    def of(cls, mesh: Mesh, wanted: Array) -> MeshPart:
        """The faces that have one of the wanted corners (n_corners,) bool."""
        known: dict[str, Any] = {"_repeats": mesh._repeats, "_large": mesh._large}
        if mesh._compiled:
            from limitsurf._kernels import connectivity

            given = read_only(wanted), mesh.indices, quad_offsets(mesh), mesh.twin
            found = connectivity.part(*given, mesh.n_vertices)
            faces, corners, vertices, indices, twin = found
            # right where all faces at an edge, or vertex, are in the part; elsewhere nobody asks
            known |= {"twin": twin, "_valences": mesh._valences[vertices]}
        else:
            inside = np.logical_or.reduceat(wanted, mesh.offsets[:-1])
            faces, corners = np.flatnonzero(inside), np.flatnonzero(inside[mesh.corner_face])
            indices = mesh.indices[corners]
            number = np.zeros(mesh.n_vertices, dtype=np.int64)
            number[indices] = 1
            vertices = np.flatnonzero(number)
            number[vertices] = np.arange(len(vertices))
            indices = number[indices]
        if mesh._repeats:
            known["separate"] = mesh.separate[corners]
        if mesh._of_quads:
            known["_steps"] = mesh._steps
        part = Mesh._from_valid(vertices, mesh.sizes[faces], indices, known)
        return cls(part, wanted, faces, corners, vertices)


def first_limit_face(mesh: Mesh) -> IntArray:
    """First limit face of each face and, last, their number, (n_faces + 1,)."""
    if mesh._steps[0] == 4:
        return np.arange(mesh.n_faces + 1)
    return np.concatenate([[0], np.cumsum(np.where(mesh.sizes == 4, 1, mesh.sizes))])


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

    face: IntArray
    corner: IntArray
    first: IntArray

    @classmethod
    def of(cls, mesh: Mesh) -> LimitFaces:
        """Number the limit faces of `mesh`."""
        first = first_limit_face(mesh)
        if mesh._steps[0] == 4:
            return cls(first[:-1], np.full(mesh.n_faces, -1), first[:-1])
        face = np.repeat(np.arange(mesh.n_faces), np.diff(first))
        corner = np.where(mesh.sizes[face] == 4, -1, np.arange(len(face)) - first[face])
        return cls(face, corner, first[:-1])

    def __len__(self) -> int:
        return len(self.face)
