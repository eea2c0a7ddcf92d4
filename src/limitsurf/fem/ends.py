"""Free ends: a ring of ghost faces beyond boundaries, whose vertices are unknowns of their own.

Boundary rules are those of the inside with reflections beyond the boundary: of the vertex i inside
across an edge at b, ``2 b - i``, and ``4 c - 2 p - 2 q + d`` across a sharp corner c of the face
(c, p, d, q); `triangle_ghosts` has those of triangles. Reflections stay reflections under
refinement (``derivations/elements.py``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.mesh import Mesh
from limitsurf.cage.selection import selected
from limitsurf.fem.ghosts import Ghosts, cut, rows_of
from limitsurf.fem.sectors import Sectors, straight
from limitsurf.fem.triangle_ghosts import TriangleGhosts
from limitsurf.options import Rules
from limitsurf.tables.masks import is_infinite

if TYPE_CHECKING:
    from limitsurf.scheme.scheme import Scheme

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Rim:
    """The boundary of the faces of a mesh that have a limit.

    Attributes
    ----------
    sides : (n,) int
        Half-edges of such faces on a boundary of the mesh.
    loop : (n,) int
        To which connected boundary each belongs.
    irregular : (m,) int
        Vertices there beyond which there are no reflections, ascending.
    faces : (n_vertices,) int
        Faces at each regular vertex of the boundary: 1, or 2 quads or 3 triangles.
    """

    sides: Array
    loop: Array
    irregular: Array
    faces: Array

    @classmethod
    def of(cls, mesh: Mesh, rules: Rules) -> Rim:
        """That of a mesh, by the rules in force."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        ghost = rules.without_limit(mesh)
        sides = np.flatnonzero((mesh.twin < 0) & ~ghost[mesh.corner_face])
        start, end = mesh.indices[sides], mesh.indices[mesh.next_corner[sides]]
        n = mesh.n_vertices
        joined = coo_array((np.ones(len(sides), np.int8), (start, end)), shape=(n, n))
        loop = connected_components(joined, directed=False)[1][start]
        faces = np.where(mesh.connectivity.valences < 0, -mesh.connectivity.valences, 0)
        lattice = rules.scheme.lattice
        good = (faces == 1) | (faces == straight(lattice))
        other = ghost | (mesh.sizes != lattice.face_size)
        good[mesh.indices[other[mesh.corner_face]]] = False
        edges, sharpness = mesh.creases
        inside = ~mesh.boundary_edge[mesh.edge_numbers(edges)] & (sharpness > 0)
        good[edges[inside]] = False
        sharp = np.zeros(n, dtype=mesh.corners[1].dtype)
        sharp[mesh.corners[0]] = mesh.corners[1]
        pointed = is_infinite(sharp) | (rules.boundary == "edge_and_corner")
        good &= np.where(faces == 1, pointed, sharp == 0).astype(bool)
        on = np.unique(np.concatenate([start, end]))
        return cls(sides, loop, on[~good[on]], faces)


def refusal(scheme: Scheme) -> str | None:
    """Why there are no ghost faces under a scheme, or None."""
    lattice = scheme.lattice
    faces = "squares" if lattice.face_size == 4 else "triangles"
    plain = lattice.face_size == 4 or not scheme.local
    if lattice.dual or callable(scheme.edge) or not plain:
        return (
            f"ghost faces are those of {faces} with {straight(lattice)} at each boundary vertex "
            "and rules inside that go on across boundaries, which scheme "
            f"{scheme.name!r} does not have"
        )
    return None


def ghosts_of(mesh: Mesh, sectors: Sectors) -> Any:
    """The ghost faces beyond the rims of a mesh, of the lattice of its scheme."""
    kind = Ghosts if Rules.resolve(mesh).scheme.lattice.face_size == 4 else TriangleGhosts
    return kind(mesh, sectors)


def extended(mesh: Mesh) -> Mesh:
    """A cage with a ring of ghost faces beyond its boundary, of the same limit surface.

    The new vertices are reflections of those inside, and the new faces are holes: the limit is as
    it was, but the functions of the new vertices are free to be moved, as `Space` does under
    ``ends="free"``.

    Parameters
    ----------
    mesh : Mesh
        Of quads at its boundary under a scheme such as Catmull and Clark's, or of triangles under
        one such as Loop's. Around each boundary vertex are two quads or three triangles, or one
        face where it is a sharp corner, and no creases inside end there.
        Where holes are at a boundary nothing is added. Infinitely sharp creases that part the mesh,
        beside which there are two quads, or one where they meet, are boundaries of both sides: the
        mesh is cut there.

    Returns
    -------
    Mesh
        Vertices and faces as they were, then those that are new; where the mesh is cut faces of one
        side have copies of its vertices. Tags of the edges and vertices of the old boundary, which
        have done their work, are gone; so are channels and data of faces.

    Raises
    ------
    ValueError
        For a boundary vertex that is not regular, the first of them by its number; or a scheme of
        other faces.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2, 3]])
    >>> wide = ls.extended(square)
    >>> wide.n_faces, wide.points.min(axis=0).tolist(), wide.points.max(axis=0).tolist()
    (9, [-1.0, -1.0], [2.0, 2.0])
    >>> ls.LimitSurface(wide).evaluate(0, 0.25, 0.5).round(12).tolist()
    [0.25, 0.5]
    """
    if not isinstance(mesh, Mesh):
        raise TypeError(f"extended needs a Mesh, got {type(mesh).__name__}")
    rules = Rules.resolve(mesh, None, None, None, None)
    why = refusal(rules.scheme)
    if why is not None:
        raise ValueError(why)
    sectors = Sectors.of(mesh, rules)
    if sectors.creased.any() and not sectors.irregular.any():
        return _parted(mesh, sectors)
    rim = Rim.of(mesh, rules)
    if len(rim.irregular):
        raise ValueError(
            f"{described(mesh, rim.irregular)}: refine the cage if faces there are no quads, or "
            "add ghost faces of your own as holes"
        )
    return with_ghosts(mesh, rim, np.ones(len(rim.sides), dtype=bool))[0]


def _parted(mesh: Mesh, sectors: Sectors) -> Mesh:
    """A mesh cut along its creases, with ghost faces beyond all its rims."""
    ghosts = ghosts_of(mesh, sectors)
    copies = mesh.points[sectors.vertex]
    matrix = ghosts.reflected(len(copies)).tocoo()
    flat = copies.reshape(len(copies), -1)
    new = np.zeros((ghosts.count, flat.shape[1]), dtype=flat.dtype)
    value = matrix.data.astype(np.int64) if flat.dtype == object else matrix.data
    np.add.at(new, matrix.row, value.astype(flat.dtype)[:, None] * flat[matrix.col])
    points = np.concatenate([copies, new.reshape(-1, *copies.shape[1:])])
    found = cut(mesh, sectors, ghosts).with_points(points)
    return found


def described(mesh: Mesh, irregular: Array) -> str:
    """Which boundary vertices are not regular, and what is at the first."""
    first, more = int(irregular[0]), len(irregular) - 1
    others = f" (nor are {more} more)" if more else ""
    faces = int(mesh.vertex_faces[first])
    lattice = Rules.resolve(mesh).scheme.lattice
    needed = f"{straight(lattice)} {'quads' if lattice.face_size == 4 else 'triangles'}"
    return (
        f"boundary vertex {first} with {faces} face{'s' * (faces != 1)}{others} is not regular, "
        f"which needs {needed}, or 1 at a sharp corner, and no crease that ends there"
    )


def with_ghosts(mesh: Mesh, rim: Rim, which: Array) -> tuple[Mesh, Any]:
    """A mesh with ghost faces at some sides of its rim, whose vertices are regular.

    Also the matrix from its vertices to those of the result.
    """
    from scipy.sparse import csr_array

    if Rules.resolve(mesh).scheme.lattice.face_size == 3:
        return _with_triangles(mesh, rim.sides[which])
    n, side = mesh.n_vertices, rim.sides[which]
    after, before = mesh.next_corner, mesh.previous_corner
    vertex = mesh.indices
    start, end = vertex[side], vertex[after[side]]
    leaving = np.full(n, -1)
    leaving[start] = np.arange(len(side))
    corner = np.flatnonzero(rim.faces[end] == 1)  # sides that end at one
    count = len(side) + 2 * len(corner)
    first = n + np.arange(len(side))
    last = first[leaving[end]].copy()
    last[corner] = n + len(side) + np.arange(len(corner))
    beyond = n + len(side) + len(corner) + np.arange(len(corner))
    c, p, d, q = (
        vertex[x[corner]]
        for x in (after[side], after[after[side]], before[before[after[side]]], side)
    )
    rows = [(first, start, vertex[before[side]]), (last[corner], c, p)]
    row = np.concatenate([np.repeat(x[0], 2) for x in rows] + [np.repeat(beyond, 4)]) - n
    column = np.concatenate(
        [np.stack(x[1:], axis=1).ravel() for x in rows] + [np.stack([c, p, q, d], axis=1).ravel()]
    )
    twice = len(side) + len(corner)
    value = np.concatenate([np.tile([2.0, -1.0], twice), np.tile([4.0, -2, -2, 1], len(corner))])
    new = csr_array((value, (row, column)), shape=(count, n))
    flat = mesh.points.reshape(n, -1)
    if flat.dtype == object:
        whole = np.zeros((count, flat.shape[1]), dtype=object)
        np.add.at(whole, row, value.astype(int).astype(object)[:, None] * flat[column])
    else:
        whole = new @ flat
    points = np.concatenate([mesh.points, whole.reshape(count, *mesh.points.shape[1:])])
    faces = np.concatenate(
        [
            np.stack([end, start, first, last], axis=1),
            np.stack([c, last[corner], beyond, first[leaving[c]]], axis=1),
        ]
    )
    result = _of(mesh, points, faces, start)
    return result, stacked_identity(n, new)


def _with_triangles(mesh: Mesh, sides: Array) -> tuple[Mesh, Any]:
    """A mesh with ghost triangles at some sides of its boundaries, and the matrix to its vertices.

    All boundary vertices there are regular.
    """
    from scipy.sparse import vstack

    sectors = Sectors.of(mesh, Rules.resolve(mesh), creases=False)
    there = np.zeros(len(sectors.vertex), dtype=bool)
    there[sectors.copy[sides]] = True
    sectors = replace(sectors, size=np.where(there, sectors.size, 0))
    ghosts = TriangleGhosts(mesh, sectors)
    copies = rows_of(sectors.vertex, mesh.n_vertices)
    matrix = vstack([copies, ghosts.reflected(len(sectors.vertex)) @ copies], format="csr")
    whole = cut(mesh, sectors, ghosts)
    flat = mesh.points.reshape(mesh.n_vertices, -1)
    if flat.dtype == object:
        points = np.zeros((whole.n_vertices, flat.shape[1]), dtype=object)
        found = matrix.tocoo()
        value = found.data.astype(int).astype(object)[:, None]
        np.add.at(points, found.row, value * flat[found.col])
    else:
        points = matrix @ flat
    return whole.with_points(points.reshape(-1, *mesh.points.shape[1:])), matrix


def _of(mesh: Mesh, points: Array, beyond: Array, rim: Array) -> Mesh:
    """A mesh with more faces, which are holes, without the tags of its old boundary."""
    edges, sharpness = mesh.creases
    inside = ~mesh.boundary_edge[mesh.edge_numbers(edges)]
    vertices, of_vertices = mesh.corners
    kept = ~np.isin(vertices, rim)
    sizes = np.concatenate([mesh.sizes, np.full(len(beyond), 4)])
    return Mesh(
        points,
        (sizes, np.concatenate([mesh.indices, beyond.ravel()])),
        creases=(edges[inside], sharpness[inside]),
        corners=(vertices[kept], of_vertices[kept]),
        holes=np.concatenate([mesh.holes, mesh.n_faces + np.arange(len(beyond))]),
        scheme=mesh.scheme,
        boundary=mesh.boundary,
        creasing=mesh.creasing,
        triangles=mesh.triangles,
        units=mesh.units,
        up=mesh.up,
    )


def stacked_identity(n: int, new: Any) -> Any:
    """Rows that leave n values as they are, then others."""
    from scipy.sparse import eye_array, vstack

    return vstack([eye_array(n, format="csr"), new], format="csr")


def trimmed(mesh: Mesh, rules: Rules) -> tuple[Mesh, Any]:
    """A mesh without faces and vertices on which no face with a limit depends.

    Also the matrix from its vertices to those of the result, None if nothing is left out.
    """
    from scipy.sparse import eye_array

    ghost = rules.without_limit(mesh)
    near = np.zeros(mesh.n_vertices, dtype=bool)
    near[mesh.indices[~ghost[mesh.corner_face]]] = True
    kept = ~ghost
    if not rules.scheme.local:
        kept[mesh.corner_face[near[mesh.indices]]] = True
    used = np.zeros(mesh.n_vertices, dtype=bool)
    used[mesh.indices[kept[mesh.corner_face]]] = True
    if used.all():
        return mesh, None
    return selected(mesh, kept), eye_array(mesh.n_vertices, format="csr")[np.flatnonzero(used)]
