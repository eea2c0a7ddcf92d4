"""Meshes made from meshes, as integers: children, parts, and the numbering of limit faces."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf.caching import cached_property
from limitsurf.cage.connectivity import Connectivity, derived, read_only
from limitsurf.cage.faces import IntArray, equal_sizes
from limitsurf.cage.mesh import Mesh, valid_mesh
from limitsurf.scheme.lattice import Lattice

Array = NDArray[Any]
Floats = NDArray[np.float64]


class ChildConnectivity(Connectivity):
    """Connectivity of the refinement of a mesh, derived from that of the mesh when it is needed.

    Parameters
    ----------
    coarse : Connectivity
        That of the mesh.
    lattice : Lattice
    """

    def __init__(self, coarse: Connectivity, lattice: Lattice) -> None:
        faces = child_faces(coarse, lattice)
        super().__init__(
            child_vertices(coarse, lattice),
            equal_sizes(len(faces), lattice.face_size),
            faces.ravel(),
            repeats=False,
            uniform_size=lattice.face_size,
        )
        self.coarse, self.lattice = coarse, lattice

    @derived
    def twin(self) -> IntArray:
        """Without sorting edges."""
        return child_twins(self.coarse, self.lattice)

    @derived
    def vertex_faces(self) -> IntArray:
        """By what a vertex was made for."""
        coarse = self.coarse
        sides = np.bincount(coarse.corner_edge, minlength=coarse.n_edges)
        return self._by_origin(coarse.vertex_faces, sides)

    @derived
    def valences(self) -> IntArray:
        """By what a vertex was made for."""
        coarse = self.coarse
        sides = np.bincount(coarse.corner_edge, minlength=coarse.n_edges)
        sides = np.where(coarse.edge_corners[:, 1] >= 0, 2, np.where(sides == 1, -1, 0))
        return self._by_origin(coarse.valences, sides)

    def _by_origin(self, own: Array, sides: Array) -> Array:
        """Of old vertices, and of those for edges, on so many sides, and for faces."""
        parts = [own, self.lattice.valence // 2 * sides, self.coarse.sizes]
        return np.concatenate(parts[: 2 + self.lattice.face_points])

    @derived
    def edge_table(self) -> tuple[IntArray, IntArray, IntArray]:
        """Without sorting half-edges, unless nothing is compiled."""
        if self.coarse.compiled:
            return _child_edges(self.coarse, self.lattice)
        if not self.lattice.face_points:
            return _edges_without_centres(self.coarse, self.lattice, self.twin)
        return super().edge_table

    @derived
    def parallel(self) -> bool:
        """By the edges, of which there may be parallel ones where no face gets a point."""
        if self.lattice.face_points:
            return False
        edges = self.edges
        return bool((edges[1:] == edges[:-1]).all(axis=1).any())


def _child_edges(cage: Connectivity, lattice: Lattice) -> tuple[Array, Array, Array]:
    """``edges``, ``corner_edge`` and ``edge_corners`` of the refined mesh, without sorting."""
    from limitsurf._kernels import refinement

    V, E, H = cage.n_vertices, cage.n_edges, cage.n_corners
    halves, edges, sides = (np.empty((n, 2), np.int64) for n in (E, 2 * E + H, 2 * E + H))
    corner_edge = np.empty(4 * H, np.int64)
    count = np.bincount(cage.edges.ravel(), minlength=V)
    known, first = (cage.twin, cage.edges, cage.corner_edge), np.cumsum(count) - count
    made = halves, edges, corner_edge, sides
    if lattice.face_points:
        count = np.bincount(cage.corner_edge)
        middle = 2 * E + np.cumsum(count) - count
        refinement.child_edges(cage.indices, cage.varying_offsets, *known, first, middle, *made)
    else:
        refinement.triangle_edges(cage.indices, *known, first, np.zeros(E, np.int64), *made)
    return edges, corner_edge, sides


def _edges_without_centres(
    cage: Connectivity, lattice: Lattice, twin: Array
) -> tuple[Array, Array, Array]:
    """Edges of the refined mesh where faces are cut along lines between points of their edges.

    First come the two halves of each edge, then the cuts. Faces that have two edges in common have
    cuts between the same points, each its own: they are in the order of the faces. The twins are
    those of the refined mesh.
    """
    split = _Split.of(lattice)
    V, E, size = cage.n_vertices, cage.n_edges, lattice.face_size
    corner_edge = np.empty(len(twin), np.int64)
    # halves by vertex, then edge, then end
    order = np.argsort(cage.edges.ravel(), kind="stable")
    number = np.empty(2 * E, np.int64)
    number[order] = np.arange(2 * E)
    tail_first = cage.edges[cage.corner_edge, 0] == cage.indices
    for half, end in zip(child_halves(cage, None, lattice), (0, 1), strict=True):
        corner_edge[half] = number[2 * cage.corner_edge + (tail_first == end)]
    # cuts by the edges at their ends, then face
    around = cage.corner_edge.reshape(-1, size)
    ends = np.sort(around[:, split.cuts], axis=2).reshape(-1, 2)
    by_ends = np.argsort(ends[:, 0] * E + ends[:, 1], kind="stable")
    number = np.empty(len(ends), np.int64)
    number[by_ends] = np.arange(2 * E, 2 * E + len(ends))
    inner = split.stride * np.arange(cage.n_faces)[:, None, None] + split.inner
    corner_edge[inner] = number.reshape(-1, len(split.cuts), 1)
    edges = np.concatenate(
        [np.stack([cage.edges.ravel()[order], V + order // 2], axis=1), V + ends[by_ends]]
    )
    # the last to be written stays
    first = np.empty(len(edges), np.int64)
    first[corner_edge[::-1]] = np.arange(len(corner_edge))[::-1]
    return edges, corner_edge, np.stack([first, twin[first]], axis=1)


def without_points(mesh: Mesh) -> Mesh:
    """The faces of a mesh alone, which keep no points alive."""
    nowhere = np.broadcast_to(0.0, mesh.n_vertices)
    return valid_mesh(Mesh, nowhere, mesh.connectivity)


def vertex_numbers(mesh: Mesh) -> Array:
    """What the vertices are called in messages: of a part, as in the whole."""
    named = mesh.points.dtype == np.int64  # the points of a cage are no integers
    return mesh.points if named else np.arange(mesh.n_vertices)


@dataclass(frozen=True, eq=False)
class _Split:
    """How a regular face is cut into its children where it gets no point of its own.

    Half-edges of the children are counted through, child by child.

    Attributes
    ----------
    corners : (children, face_size) int
        What stands at the corners of the children: the corners of the face, then the points of its
        edges. The children at the corners of the face begin there.
    halves : (2, face_size) int
        The first and the second half of each half-edge of the face.
    inner : (cuts, 2) int
        The half-edges on both sides of each cut.
    cuts : (cuts, 2) int
        The edges that it joins.
    stride : int
        Number of half-edges.
    """

    corners: Array
    halves: Array
    inner: Array
    cuts: Array
    stride: int

    @classmethod
    @lru_cache(maxsize=16)
    def of(cls, lattice: Lattice) -> _Split:
        """That of a lattice."""
        n = lattice.face_size
        corners = [(1 + i, 1 + j) for i, j in lattice.corners]
        elements = [{corner} for corner in corners]
        elements += [{corners[k], corners[(k + 1) % n]} for k in range(n)]
        children = []
        for k, child in enumerate(lattice.children):
            places = [set(lattice.parents(child.place(corner))) for corner in corners]
            begin = k if k < n else 0
            children.append([elements.index(places[(begin + j) % n]) for j in range(n)])
        at = {
            (child[j], child[(j + 1) % n]): n * k + j
            for k, child in enumerate(children)
            for j in range(n)
        }
        cuts = [(a, b) for a, b in at if n <= a < b]
        halves = [[at[k, n + k] for k in range(n)], [at[n + k, (k + 1) % n] for k in range(n)]]
        inner = [(at[a, b], at[b, a]) for a, b in cuts]
        joined = np.array(cuts) - n
        return cls(np.array(children), np.array(halves), np.array(inner), joined, len(at))


def all_regular(mesh: Mesh, lattice: Lattice) -> bool:
    """Whether all faces have as many corners as those of the lattice."""
    return mesh.connectivity.uniform_size == lattice.face_size


def child_faces(cage: Connectivity, lattice: Lattice) -> Array:
    """Faces of the refined mesh, (n, face_size); see `refined`."""
    V, E = cage.n_vertices, cage.n_edges
    if cage.compiled:
        from limitsurf._kernels import refinement

        result = np.empty(4 * cage.n_corners, np.int64)
        if lattice.face_points:
            known = cage.indices, cage.varying_offsets, cage.corner_edge, V, E
            refinement.child_faces(*known, result)
        else:
            refinement.triangle_children(cage.indices, cage.corner_edge, V, result)
        return result.reshape(-1, lattice.face_size)
    return at_children(cage, cage.indices, V + cage.corner_edge, V + E + cage.corner_face, lattice)


def at_children(
    cage: Connectivity, corners: Array, edges: Array, faces: Array, lattice: Lattice
) -> Array:
    """What is at the corners of the children, (n, face_size, ...).

    By corner of the mesh: from what is there, at the point of the edge that begins there, and at
    that of the face, if it has one; (n_corners, ...) each.
    """
    if lattice.face_points:
        return np.stack([corners, edges, faces, edges[cage.previous_corner]], axis=1)
    shape = -1, lattice.face_size, *corners.shape[1:]
    around = np.concatenate([corners.reshape(shape), edges.reshape(shape)], axis=1)
    return np.asarray(around[:, _Split.of(lattice).corners].reshape(shape))


def child_vertices(cage: Connectivity, lattice: Lattice) -> int:
    """Number of vertices of the refined mesh."""
    return cage.n_vertices + cage.n_edges + cage.n_faces * lattice.face_points


def children_of(mesh: Mesh, faces: Array, lattice: Lattice) -> Array:
    """The children of some faces, in turn."""
    if not lattice.face_points:
        count = len(lattice.children)
        return np.asarray((count * faces[:, None] + np.arange(count)).ravel())
    return corners_of(mesh, faces)[0]


def corners_of(mesh: Mesh, faces: Array) -> tuple[Array, Array]:
    """All corners of some faces, and which of its face each is."""
    size = mesh.connectivity.uniform_size
    if size:
        corner = np.tile(np.arange(size), len(faces))
        return np.repeat(size * faces, size) + corner, corner
    sizes = mesh.sizes[faces]
    corner = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    return np.repeat(mesh.connectivity.first(faces), sizes) + corner, corner


def child_halves(
    cage: Connectivity, corners: Array | None, lattice: Lattice
) -> tuple[Array, Array]:
    """The first and the second halves of some half-edges, or of all, in the refined mesh.

    The first half of half-edge h is also the corner that the children have where h has its own.
    """
    if corners is None:
        corners = np.arange(cage.n_corners)
    if lattice.face_points:
        # child h goes from corner to midpoint, to face point, to midpoint before, to corner
        return 4 * corners, 4 * cage.after(corners) + 3
    split = _Split.of(lattice)
    face, k = np.divmod(corners, lattice.face_size)
    first, second = split.stride * face + split.halves[:, k]
    return first, second


def child_twins(cage: Connectivity, lattice: Lattice) -> Array:
    """The twins of the refined mesh, without sorting edges."""
    if cage.compiled:
        from limitsurf._kernels import refinement

        result = np.empty(4 * cage.n_corners, np.int64)
        if lattice.face_points:
            refinement.child_twins(cage.varying_offsets, cage.twin, result)
        else:
            refinement.triangle_twins(cage.twin, result)
        return result
    if not lattice.face_points:
        split, twin = _Split.of(lattice), cage.twin
        first, second = child_halves(cage, None, lattice)
        twins = np.empty((cage.n_faces, split.stride), np.int64)
        begin = split.stride * np.arange(cage.n_faces)[:, None]
        for one, other in (split.inner.T, split.inner[:, ::-1].T):
            twins[:, one] = begin + other
        result = twins.ravel()
        result[first] = np.where(twin < 0, -1, second[twin])
        result[second] = np.where(twin < 0, -1, first[twin])
        return result
    after, before, twin = cage.next_corner, cage.previous_corner, cage.twin
    entering = twin[before]  # across the edge that ends at the corner
    # half-edges of child h: corner to midpoint, to face point, to midpoint before, to corner
    found = [
        np.where(twin < 0, -1, 4 * after[twin] + 3),
        4 * after + 2,
        4 * before + 1,
        np.where(entering < 0, -1, 4 * entering),
    ]
    return np.stack(found, axis=1).ravel()


def child_mesh(mesh: Mesh, points: Array, lattice: Lattice) -> Mesh:
    """The refined mesh on given points; while one is alive, others share its connectivity."""
    cage = mesh.connectivity
    if cage.repeats:
        # no corner of a child is repeated, but the halves of an edge from a vertex to itself are
        # alike, and twins may be missing, then and ever after, that would be found in the child
        loops = np.flatnonzero(cage.indices == cage.indices[cage.next_corner])
        faces, twin = child_faces(cage, lattice), child_twins(cage, lattice)
        separate = np.zeros(faces.size, dtype=bool)
        for half in child_halves(cage, loops, lattice):
            separate[half] = True
        known: dict[str, Any] = {"twin": twin, "separate": separate, "repeats": True}
        if not lattice.face_points:
            known["parallel"] = True
            known["edge_table"] = _edges_without_centres(cage, lattice, twin)
        sizes = equal_sizes(len(faces), lattice.face_size)
        children = Connectivity(child_vertices(cage, lattice), sizes, faces.ravel(), **known)
        return valid_mesh(Mesh, points, children)
    found = cage.children.get(lattice.name)
    if found is None:
        cage.children[lattice.name] = found = ChildConnectivity(cage, lattice)
    return valid_mesh(Mesh, points, found)


@dataclass(frozen=True, eq=False)
class MeshPart:
    """Some faces of a mesh as a mesh of their own, with what they were.

    Attributes
    ----------
    mesh : Mesh
        Its points are the `vertex_numbers` of its vertices.
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
        cage = mesh.connectivity
        known: dict[str, Any] = {"repeats": cage.repeats}
        if cage.compiled:
            from limitsurf._kernels import connectivity

            given = read_only(wanted), cage.indices, cage.varying_offsets, cage.twin
            found = connectivity.part(*given, cage.n_vertices)
            faces, corners, vertices, indices, twin = found
            # right where all faces at an edge, or vertex, are in the part; elsewhere nobody asks
            known |= {"twin": twin, "valences": cage.valences[vertices]}
        else:
            inside = np.logical_or.reduceat(wanted, cage.offsets[:-1])
            faces, corners = np.flatnonzero(inside), np.flatnonzero(inside[cage.corner_face])
            indices = cage.indices[corners]
            number = np.zeros(cage.n_vertices, dtype=np.int64)
            number[indices] = 1
            vertices = np.flatnonzero(number)
            number[vertices] = np.arange(len(vertices))
            indices = number[indices]
        if cage.repeats:
            known["separate"] = cage.separate[corners]
        if cage.parallel:
            known |= _part_edges(cage, corners, indices)
        if cage.uniform_size:
            known["uniform_size"] = cage.uniform_size
        inner = Connectivity(len(vertices), cage.sizes[faces], indices, **known)
        part = valid_mesh(Mesh, vertex_numbers(mesh)[vertices], inner)
        return cls(part, wanted, faces, corners, vertices)


def _part_edges(cage: Connectivity, corners: Array, indices: Array) -> dict[str, Any]:
    """What a part of a mesh with parallel edges has to know, from some corners and their vertices.

    It cannot be told from the faces.
    """
    number = np.full(cage.n_corners + 1, -1)  # the last is for none
    number[corners] = np.arange(len(corners))
    twin = number[cage.twin[corners]]
    _, corner_edge = np.unique(cage.corner_edge[corners], return_inverse=True)
    first = np.empty(corner_edge.max() + 1, np.int64)
    first[corner_edge[::-1]] = np.arange(len(corners))[::-1]
    last = np.full(cage.n_corners, -1)
    last[corners] = indices
    heads = last[cage.next_corner[corners]]
    edges = np.sort(np.stack([indices, heads], axis=1)[first], axis=1)
    table = edges, corner_edge, np.stack([first, twin[first]], axis=1)
    return {"twin": twin, "parallel": True, "edge_table": table}


def first_limit_face(mesh: Mesh, lattice: Lattice) -> IntArray:
    """First limit face of each face and, last, their number, (n_faces + 1,)."""
    if all_regular(mesh, lattice):
        return np.arange(mesh.n_faces + 1)
    counts = np.where(mesh.sizes == lattice.face_size, 1, mesh.sizes)
    return np.concatenate([[0], np.cumsum(counts)])


@dataclass(frozen=True, eq=False)
class LimitFaces:
    """The limit faces of a mesh: one for a regular face, n for an n-gon, by its corners.

    Regular faces have as many corners as those of the lattice.

    Attributes
    ----------
    face : (n_limit_faces,) int
        Face of the mesh that each belongs to.
    corner : (n_limit_faces,) int
        Its corner of an n-gon; -1 for regular faces.
    first : (n_faces,) int
        First limit face of each face.
    """

    face: IntArray
    corner: IntArray
    first: IntArray
    _cage: Connectivity = field(repr=False)
    _holes: IntArray = field(repr=False)
    _lattice: Lattice = field(repr=False)

    @classmethod
    def of(cls, mesh: Mesh, lattice: Lattice) -> LimitFaces:
        """Number the limit faces of `mesh`."""
        first = first_limit_face(mesh, lattice)
        known = mesh.connectivity, mesh.holes, lattice
        if all_regular(mesh, lattice):
            return cls(first[:-1], np.full(mesh.n_faces, -1), first[:-1], *known)
        face = np.repeat(np.arange(mesh.n_faces), np.diff(first))
        regular = mesh.sizes[face] == lattice.face_size
        corner = np.where(regular, -1, np.arange(len(face)) - first[face])
        return cls(face, corner, first[:-1], *known)

    def at_corner(self, face: ArrayLike, corner: ArrayLike) -> tuple[IntArray, Floats, Floats]:
        """Where corners of faces of the mesh are: limit face, u and v.

        Parameters
        ----------
        face, corner : int or array_like
            Faces of the mesh, and their corners from 0 on; they broadcast.

        Returns
        -------
        limit_face, u, v : arrays of the same shape

        Raises
        ------
        IndexError
            For a face, or a corner, that does not exist.

        Examples
        --------
        >>> import limitsurf as ls
        >>> mesh = ls.Mesh([[0, 0], [1, 0], [1, 1], [0, 1], [2, 0]], [[0, 1, 2, 3], [1, 4, 2]])
        >>> surface = ls.LimitSurface(mesh)
        >>> surface.limit_faces.at_corner([0, 1], 2)
        (array([0, 3]), array([1., 0.]), array([1., 0.]))
        """
        face, corner = np.broadcast_arrays(_whole(face, "face"), _whole(corner, "corner"))
        _refuse_beyond(face, len(self.first), "face")
        wrong = (corner < 0) | (corner >= self._cage.sizes[face])
        if wrong.any():
            f, k = int(face[wrong].flat[0]), int(corner[wrong].flat[0])
            raise IndexError(f"face {f} has corners 0 to {self._cage.sizes[f] - 1}, got {k}")
        regular = self._cage.sizes[face] == self._lattice.face_size
        place = np.array(self._lattice.corners, dtype=float)[np.where(regular, corner, 0)]
        limit_face = self.first[face] + np.where(regular, 0, corner)
        return limit_face, place[..., 0], place[..., 1]

    def at_vertex(self, vertex: ArrayLike) -> tuple[IntArray, Floats, Floats]:
        """Where vertices of the mesh have their limits: limit face, u and v of one face there.

        Of the faces at a vertex it is the first in the mesh that is no hole, if there is one.

        Parameters
        ----------
        vertex : int or array_like

        Returns
        -------
        limit_face, u, v : arrays of the same shape

        Raises
        ------
        IndexError
            For a vertex that does not exist.
        ValueError
            For a vertex of no face.

        Examples
        --------
        The limit positions of all vertices of a cage:

        >>> import limitsurf as ls
        >>> mesh = ls.Mesh([[1, 1], [2, 1], [2, 2], [1, 2]], [[0, 1, 2, 3]])
        >>> surface = ls.LimitSurface(mesh)
        >>> surface.evaluate(*surface.limit_faces.at_vertex(range(4))).round(12).tolist()
        [[1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.0]]
        """
        vertex = _whole(vertex, "vertex")
        _refuse_beyond(vertex, self._cage.n_vertices, "vertex")
        corner = self._first_corner[vertex]
        if (corner < 0).any():
            raise ValueError(f"vertex {vertex[corner < 0].flat[0]} is of no face")
        return self._at(corner)

    def at_edge(self, ends: ArrayLike, t: ArrayLike = 0.5) -> tuple[IntArray, Floats, Floats]:
        """Where edges of the mesh are on the surface: limit face, u and v of one face there.

        Of the faces at an edge it is the first in the mesh that is no hole, if there is one.

        Parameters
        ----------
        ends : array_like, (..., 2)
            Vertices of edges.
        t : array_like
            How far along the edge, from 0 at its first to 1 at its second vertex; it broadcasts.

        Returns
        -------
        limit_face, u, v : arrays of the same shape

        Raises
        ------
        ValueError
            For two vertices without an edge, a shape without two ends, or t outside [0, 1].

        Examples
        --------
        >>> import limitsurf as ls
        >>> mesh = ls.Mesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2, 3]])
        >>> surface = ls.LimitSurface(mesh)
        >>> surface.limit_faces.at_edge([2, 1], [0.25, 0.5])
        (array([0, 0]), array([1., 1.]), array([0.75, 0.5 ]))
        """
        pair, t = _whole(ends, "ends"), np.asarray(t, dtype=float)
        if not pair.ndim or pair.shape[-1] != 2:
            raise ValueError(f"ends: got shape {pair.shape}, need two vertices (..., 2)")
        if not ((t >= 0) & (t <= 1)).all():
            raise ValueError("t must be in [0, 1]")
        cage, ascending = self._cage, np.sort(pair.reshape(-1, 2), axis=1)
        edge = cage.edge_numbers(ascending).clip(max=cage.n_edges - 1)
        wrong = np.flatnonzero((cage.edges[edge] != ascending).any(axis=1))
        if len(wrong):
            a, b = pair.reshape(-1, 2)[wrong[0]].tolist()
            raise ValueError(f"the mesh has no edge between vertices {a} and {b}")
        corner = self._first_corner_of_edge[edge].reshape(pair.shape[:-1])
        corner, start, t = np.broadcast_arrays(corner, pair[..., 0], t)
        return self.along(corner, np.where(cage.indices[corner] == start, t, 1 - t))

    def along(self, corner: IntArray, t: ArrayLike) -> tuple[IntArray, Floats, Floats]:
        """Where sides of faces are: limit face, u and v at t along those that begin at corners.

        Corners are numbered through all faces; t is not checked. They broadcast.
        """
        cage = self._cage
        corner, t = np.broadcast_arrays(corner, t)
        regular = cage.sizes[cage.corner_face[corner]] == self._lattice.face_size
        near = regular | (t <= 0.5)  # of an n-gon each half is the edge of another limit face
        after = cage.next_corner[corner]
        limit_face, u, v = self._at(np.where(near, corner, after))
        _, far_u, far_v = self._at(after)
        u = np.where(regular, (1 - t) * u + t * far_u, np.where(near, 2 * t, 0.0))
        v = np.where(regular, (1 - t) * v + t * far_v, np.where(near, 0.0, 2 * (1 - t)))
        return limit_face, u, v

    def _at(self, corner: IntArray) -> tuple[IntArray, Floats, Floats]:
        face = self._cage.corner_face[corner]
        return self.at_corner(face, corner - self._cage.offsets[face])

    def _first(self, number: IntArray, count: int) -> IntArray:
        """The first corner of each number (n_corners,), of a hole if there is no other, or -1."""
        first = np.full(count, -1)
        hole = np.zeros(self._cage.n_faces, dtype=bool)
        hole[self._holes] = True
        of_hole = hole[self._cage.corner_face]
        for some in (np.flatnonzero(of_hole)[::-1], np.flatnonzero(~of_hole)[::-1]):
            first[number[some]] = some  # of several the last one written stays
        return first

    @cached_property
    def _first_corner(self) -> IntArray:
        return self._first(self._cage.indices, self._cage.n_vertices)

    @cached_property
    def _first_corner_of_edge(self) -> IntArray:
        return self._first(self._cage.corner_edge, self._cage.n_edges)

    def __len__(self) -> int:
        return len(self.face)


def _whole(values: ArrayLike, name: str) -> IntArray:
    """Integers as an array."""
    array = np.asarray(values)
    if array.dtype.kind not in "iu" and array.size:
        raise TypeError(f"{name} must be integers, got {array.dtype}")
    return array.astype(np.int64, copy=False)


def _refuse_beyond(values: IntArray, count: int, name: str) -> None:
    wrong = (values < 0) | (values >= count)
    if wrong.any():
        worst = values[wrong].flat[0]
        raise IndexError(f"{name} {worst} is out of range, need 0 to {count - 1}")
