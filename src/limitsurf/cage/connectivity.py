"""Which faces, edges and vertices of a cage meet: integers, derived from the faces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeVar
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from limitsurf import _kernels
from limitsurf.caching import cached_property
from limitsurf.cage.faces import Faces, IntArray

BoolArray: TypeAlias = NDArray[np.bool_]

T = TypeVar("T")


class derived(cached_property[T]):  # noqa: N801  (a decorator)
    """Computed on first use, and read-only."""

    def __init__(self, compute: Callable[[Any], T]) -> None:
        super().__init__(compute)
        self.func = lambda cage: read_only(compute(cage))


class Connectivity:
    """What is known of the faces of a cage by themselves, whatever its points.

    It is derived from the faces when it is first asked for, and shared by all meshes that have
    them. Here, and nowhere else, is decided whether compiled kernels do it. Corners and half-edges
    are as in `Mesh`.

    Parameters
    ----------
    n_vertices : int
        Unused ones included.
    sizes : (n_faces,) int64
        Number of corners of each face.
    indices : (n_corners,) int64
        Vertex of each corner. Both are known to be valid, and taken without a copy.
    **known
        Members that need not be derived.
    """

    def __init__(self, n_vertices: int, sizes: IntArray, indices: IntArray, **known: Any) -> None:
        self.n_vertices = n_vertices
        self.sizes, self.indices = read_only(sizes), read_only(indices)
        vars(self).update(read_only(known))

    def __reduce__(self) -> tuple[Any, ...]:
        # these can be known from how the faces were made; everything else is derived again
        names = ("separate", "twin", "repeats", *("parallel", "edge_table") * self.parallel)
        known = {name: vars(self)[name] for name in names if name in vars(self)}
        return _restored, (self.n_vertices, self.sizes, self.indices, known)

    @derived
    def children(self) -> WeakValueDictionary[str, Connectivity]:
        """That of the refinements that are alive, by the name of the lattice."""
        return WeakValueDictionary()

    @property
    def n_faces(self) -> int:
        """Number of faces."""
        return len(self.sizes)

    @property
    def n_edges(self) -> int:
        """Number of edges."""
        return len(self.edges)

    @property
    def n_corners(self) -> int:
        """Number of face corners, the sum of ``sizes``."""
        return len(self.indices)

    @derived
    def faces(self) -> Faces:
        """The faces, a sequence of arrays of vertices, whatever their sizes."""
        return Faces(self.sizes, self.indices)

    @property
    def uniform(self) -> IntArray | None:
        """The vertices of all faces, (m, k), if each has k corners; None where they differ."""
        return self.faces.uniform

    @derived
    def offsets(self) -> IntArray:
        """First corner of each face, and ``n_corners``: shape (n_faces + 1,)."""
        return _offsets(self.sizes)

    @derived
    def corner_face(self) -> IntArray:
        """Face of each corner: shape (n_corners,)."""
        return np.repeat(np.arange(self.n_faces), self.sizes)

    @derived
    def next_corner(self) -> IntArray:
        """The next corner in the same face: shape (n_corners,)."""
        following = np.arange(1, self.n_corners + 1)
        following[self.offsets[1:] - 1] = self.offsets[:-1]
        return following

    @derived
    def previous_corner(self) -> IntArray:
        """The previous corner in the same face: shape (n_corners,)."""
        preceding = np.arange(-1, self.n_corners - 1)
        preceding[self.offsets[:-1]] = self.offsets[1:] - 1
        return preceding

    @property
    def compiled(self) -> bool:
        """Whether to use compiled connectivity, whose corners have 32 bits in places.

        It finds the same integers, so that some may be found by one way and some by the other.
        """
        return self.n_corners < 2**31 and _kernels.compiled(self.n_corners)

    @derived
    def uniform_size(self) -> int:
        """Number of corners of every face; 0 where they differ."""
        size = int(self.sizes.max())
        return size if size == int(self.sizes.min()) else 0

    @derived
    def steps(self) -> tuple[int, IntArray, IntArray]:
        """How kernels go around faces: 3 or 4 if all have as many corners, and nothing else.

        Otherwise 0, and the next and the previous corner.
        """
        if self.uniform_size in (3, 4):
            return self.uniform_size, np.zeros(0, np.int64), np.zeros(0, np.int64)
        return 0, self.next_corner, self.previous_corner

    @property
    def varying_offsets(self) -> IntArray:
        """First corners of faces, (n_faces + 1,), as kernels take them: none if `steps` is 4."""
        return self.steps[1] if self.steps[0] == 4 else self.offsets

    def first(self, faces: IntArray) -> IntArray:
        """The first corners of faces."""
        size = self.uniform_size
        return size * faces if size else self.offsets[faces]

    def after(self, corners: IntArray) -> IntArray:
        """The next corners in the same faces."""
        size, after = self.uniform_size, corners + 1
        if size == 4:
            return corners & ~3 | after & 3
        return after - size * (after % size == 0) if size else self.next_corner[corners]

    @derived
    def around(self) -> tuple[IntArray, IntArray, bool]:
        """The corners at each vertex, and whether a face has a vertex more than once."""
        from limitsurf._kernels import connectivity

        return connectivity.around(self.indices, self.offsets, self.n_vertices)

    @derived
    def separate(self) -> BoolArray:
        """Half-edges with an edge of their own, whatever others join their vertices: (n_corners,).

        Those from a vertex to itself, and those whose face has run along their edge before.
        """
        if not self.repeats:
            return np.zeros(self.n_corners, dtype=bool)
        start, end = self.indices, self.indices[self.next_corner]
        result: BoolArray = np.asarray(start == end)
        key = np.minimum(start, end) * self.n_vertices + np.maximum(start, end)
        order = np.lexsort((key, self.corner_face))
        key, face = key[order], self.corner_face[order]
        result[order[1:]] |= (key[1:] == key[:-1]) & (face[1:] == face[:-1])
        return result

    @derived
    def parallel(self) -> bool:
        """Whether there are edges between the same vertices that the faces do not tell of.

        Refinement may make them, with an `edge_table` that it knows.
        """
        return False

    @derived
    def repeats(self) -> bool:
        """Whether a face has a vertex more than once."""
        if self.compiled:
            return self.around[2]
        size = int(self.sizes[0])
        if size <= 4 and (self.sizes == size).all():
            corners = self.indices.reshape(-1, size).T
            return any(
                bool((corners[i] == corners[j]).any()) for i in range(size) for j in range(i)
            )
        key = np.sort(self.corner_face * self.n_vertices + self.indices)
        return bool((key[1:] == key[:-1]).any())

    @derived
    def edge_table(self) -> tuple[IntArray, IntArray, IntArray]:
        """``edges``, ``corner_edge``, ``edge_corners``: half-edges sorted by their vertices."""
        if self.compiled and not self.repeats:
            from limitsurf._kernels import connectivity

            known = self.indices, self.steps, vars(self).get("twin")
            *table, more = connectivity.edges(*known, *self.around[:2])
            for name, found in zip(("twin", "valences"), more, strict=False):
                vars(self).setdefault(name, read_only(found))
            return tuple(table)  # type: ignore[return-value]
        start, end = self.indices, self.indices[self.next_corner]
        key = np.minimum(start, end) * self.n_vertices + np.maximum(start, end)
        alone = self.separate
        order = np.lexsort((alone, key)) if alone.any() else np.argsort(key)
        key = key[order]
        is_first = np.append(True, key[1:] != key[:-1]) | alone[order]
        first = np.flatnonzero(is_first)  # (E,) into order
        corner_edge = np.empty_like(order)
        corner_edge[order] = np.cumsum(is_first) - 1
        counts = np.diff(first, append=len(order))
        one = np.minimum.reduceat(order, first)
        paired = np.flatnonzero(counts == 2)
        other = np.full_like(one, -1)
        other[paired] = np.maximum(order[first[paired]], order[first[paired] + 1])
        manifold = (other >= 0) & (start[one] != start[other])
        if alone.any():
            # nor is an edge manifold that one of its faces runs along again
            again = np.isin(key[first], key[alone[order]])
            manifold &= ~again
        edges = np.stack(np.divmod(key[first], self.n_vertices), axis=1)
        return edges, corner_edge, np.stack([one, np.where(manifold, other, -1)], axis=1)

    @derived
    def edges(self) -> IntArray:
        """The vertices of each edge, ascending, rows in lexicographic order: shape (n_edges, 2).

        Rows are distinct unless a face has a vertex more than once, see `separate`.
        """
        return self.edge_table[0]

    @derived
    def corner_edge(self) -> IntArray:
        """Edge of each corner's half-edge: shape (n_corners,)."""
        return self.edge_table[1]

    @derived
    def edge_corners(self) -> IntArray:
        """The half-edges of each edge, lower first: shape (n_edges, 2).

        Second -1 on a boundary, and on a non-manifold edge, whose first is the lowest.
        """
        return self.edge_table[2]

    def edge_numbers(self, ends: IntArray) -> IntArray:
        """Numbers (c,) of edges from their vertices (c, 2), ascending; they must exist."""
        key = self.edges[:, 0] * self.n_vertices + self.edges[:, 1]
        return np.searchsorted(key, ends[:, 0] * self.n_vertices + ends[:, 1])

    @derived
    def edge_faces(self) -> IntArray:
        """Number of faces at each edge: shape (n_edges,)."""
        return np.bincount(self.corner_edge)

    @derived
    def boundary_edge(self) -> BoolArray:
        """Whether an edge has one face only: shape (n_edges,)."""
        return np.asarray(self.edge_faces == 1)

    @derived
    def nonmanifold_edge(self) -> BoolArray:
        """Whether an edge has three or more faces, or two that run along it the same way.

        Or one face that does so twice. Shape (n_edges,).
        """
        result = (self.edge_corners[:, 1] < 0) & ~self.boundary_edge
        if self.separate.any():
            result |= np.isin(
                self.edges @ [self.n_vertices, 1],
                self.edges[self.corner_edge[self.separate]] @ [self.n_vertices, 1],
            )
        return result

    @derived
    def twin(self) -> IntArray:
        """The half-edge in the opposite direction, -1 on boundary and non-manifold edges.

        Shape (n_corners,).
        """
        if self.compiled and not self.repeats:
            from limitsurf._kernels import connectivity

            return connectivity.twins(self.indices, self.steps, *self.around[:2])
        twin = np.full(self.n_corners, -1)
        one, other = self.edge_corners[self.edge_corners[:, 1] >= 0].T
        twin[one], twin[other] = other, one
        return twin

    @derived
    def boundary_vertex(self) -> BoolArray:
        """Whether a vertex lies on a boundary edge: shape (n_vertices,)."""
        on_boundary = np.zeros(self.n_vertices, dtype=bool)
        ends, alone, _ = self._rim
        on_boundary[ends[alone]] = True
        return on_boundary

    @derived
    def nonmanifold_vertex(self) -> BoolArray:
        """Whether a vertex is on a non-manifold edge or of several fans: shape (n_vertices,)."""
        result = np.asarray((self.valences == 0) & (self.vertex_faces > 0))
        ends, _, odd = self._rim
        result[ends[odd]] = True
        return result

    @derived
    def valences(self) -> IntArray:
        """Faces at each vertex, (n_vertices,); negative on a rim, 0 where they form no one fan."""
        if self.compiled:
            from limitsurf._kernels import connectivity

            return connectivity.valences(self.steps, self.twin, *self.around[:2])
        fans = self.fans
        valences = np.zeros(self.n_vertices, dtype=np.int64)
        valences[fans.vertex] = np.where(fans.closed, fans.sizes, -fans.sizes)
        valences[np.bincount(fans.vertex, minlength=self.n_vertices) > 1] = 0
        return valences

    @derived
    def _rim(self) -> tuple[IntArray, BoolArray, BoolArray]:
        """Vertices (n, 2) of edges without twins; whether they have one face; are not manifold."""
        if self.repeats:
            rim = np.flatnonzero(self.edge_corners[:, 1] < 0)
            return self.edges[rim], self.boundary_edge[rim], self.nonmanifold_edge[rim]
        corners = np.flatnonzero(self.twin < 0)
        one, other = self.indices[corners], self.indices[self.after(corners)]
        key = np.minimum(one, other) * self.n_vertices + np.maximum(one, other)
        key, faces = np.unique(key, return_counts=True)
        return np.stack(np.divmod(key, self.n_vertices), axis=1), faces == 1, faces > 1

    @derived
    def vertex_faces(self) -> IntArray:
        """Number of faces at each vertex, 0 if it is unused: shape (n_vertices,).

        At an interior vertex this is its valence.
        """
        if self.compiled:
            return np.diff(self.around[0])
        return np.bincount(self.indices, minlength=self.n_vertices)

    @derived
    def fans(self) -> Fans:
        """The corners at each vertex in fans of faces joined along manifold edges."""
        return Fans.of(self, self.twin)

    @derived
    def boundary_chains(self) -> tuple[IntArray, ...]:
        """Vertices along the boundary, one array a chain, the surface on their left.

        A closed chain ends with the vertex that it begins with; one that ends at a non-manifold
        edge is open.
        """
        # half-edges without a twin are a permutation: each ends at an open fan, of which another
        # one begins; its cycles, ranked by pointer doubling, fall apart at edges that are no rim
        rim = np.flatnonzero(self.twin < 0)
        if not len(rim):
            return ()
        fans = self.fans
        number = np.empty(self.n_corners, np.int64)
        number[rim] = np.arange(len(rim))
        following = number[fans.corners[fans.offsets[fans.fan[self.next_corner[rim]]]]]
        least, after = np.arange(len(rim)), following
        steps = len(rim).bit_length()
        for _ in range(steps):
            least, after = np.minimum(least, least[after]), after[after]
        preceding = np.empty_like(following)
        preceding[following] = np.arange(len(rim))
        # start open chains behind what is not manifold, closed ones at their first half-edge
        inner = self.boundary_edge[self.corner_edge[rim]]
        if not inner.any():
            return ()
        starts = inner & ~inner[preceding]
        broken = np.zeros(len(rim), dtype=bool)
        broken[least[starts]] = True
        starts |= (least == np.arange(len(rim))) & inner & ~broken
        back = np.where(starts, np.arange(len(rim)), preceding)
        rank = (back != np.arange(len(rim))).astype(np.int64)
        for _ in range(steps):
            rank, back = rank + rank[back], back[back]
        order = np.lexsort((rank, back))
        order = order[inner[order]]
        vertices = self.indices[rim[order]]
        cut = np.flatnonzero(np.diff(back[order])) + 1
        last = order[np.append(cut, len(order)) - 1]
        ends = self.indices[self.next_corner[rim[last]]]
        found = np.split(vertices, cut)
        return tuple(np.append(chain, end) for chain, end in zip(found, ends, strict=True))

    @derived
    def ring_offsets(self) -> IntArray:
        """Start of each vertex's ring in ``ring_corners``, and the end: shape (n_vertices + 1,)."""
        return _offsets(self.vertex_faces)

    @derived
    def ring_position(self) -> IntArray:
        """Position of each corner in the ring of its vertex: shape (n_corners,)."""
        position = np.empty(self.n_corners, dtype=np.int64)
        position[self.ring_corners] = np.arange(self.n_corners)
        return position - self.ring_offsets[self.indices]

    @derived
    def ring_corners(self) -> IntArray:
        """The corners (outgoing half-edges) at each vertex, counter-clockwise: shape (n_corners,).

        After corner ``h`` comes ``twin[previous_corner[h]]``. The ring of a boundary vertex starts
        at its outgoing boundary half-edge, that of an interior vertex at its smallest corner; at
        a non-manifold vertex its fans follow each other.
        """
        return self.fans.corners


@dataclass(frozen=True)
class Fans:
    """The corners at each vertex, parted into fans of faces that are joined along edges.

    Fans are numbered by vertex, then by first corner; the first corner of an open fan is the one
    whose own half-edge has no twin, that of a closed one the smallest.

    Attributes
    ----------
    vertex : (n_fans,) int
    closed : (n_fans,) bool
        Whether the last face of the fan is joined to the first.
    offsets : (n_fans + 1,) int
        Start of each fan in `corners`, and the end.
    corners : (n_corners,) int
        The corners of each fan, counter-clockwise.
    fan, position : (n_corners,) int
        The fan of each corner, and its place in there.
    """

    vertex: IntArray
    closed: BoolArray
    offsets: IntArray
    corners: IntArray
    fan: IntArray
    position: IntArray

    @derived
    def sizes(self) -> IntArray:
        """Number of faces of each fan: shape (n_fans,)."""
        return np.diff(self.offsets)

    @classmethod
    def of(cls, cage: Connectivity, twin: IntArray) -> Fans:
        """Fans of faces joined where a half-edge has a twin (n_corners,); it is -1 elsewhere.

        Linked lists ranked by pointer doubling, in log2 of the largest valence steps.
        """
        if cage.compiled:
            from limitsurf._kernels import connectivity

            return cls(*connectivity.fans(cage.steps, read_only(twin), *cage.around[:2]))
        corner = np.arange(cage.n_corners)
        clockwise = np.where(twin < 0, corner, cage.next_corner[twin])
        steps = int(cage.vertex_faces.max()).bit_length()
        least, back = corner, clockwise
        for _ in range(steps):
            least = np.minimum(least, least[back])
            back = back[back]
        cyclic = twin[back] >= 0
        first = np.where(cyclic, least, back)
        back = np.where(corner == first, corner, clockwise)
        position = (back != corner).astype(np.int64)
        for _ in range(steps):
            position += position[back]
            back = back[back]
        start = np.flatnonzero(first == corner)
        start = start[np.argsort(cage.indices[start], kind="stable")]
        fan = np.empty_like(corner)
        fan[start] = np.arange(len(start))
        fan = fan[first]
        offsets = _offsets(np.bincount(fan))
        corners = np.empty_like(corner)
        corners[offsets[fan] + position] = corner
        return cls(cage.indices[start], cyclic[start], offsets, corners, fan, position)


def read_only(value: T) -> T:
    """A value with every array in it, also in tuples, lists and dicts, as a read-only view."""
    found: Any = value
    if isinstance(value, np.ndarray):
        if value.flags.writeable:
            found = value.view()
            found.flags.writeable = False
    elif isinstance(value, (tuple, list)):
        found = type(value)(map(read_only, value))
    elif isinstance(value, dict):
        found = {name: read_only(item) for name, item in value.items()}
    return found  # type: ignore[no-any-return]


def _offsets(counts: IntArray) -> IntArray:
    return np.concatenate([[0], np.cumsum(counts)])


def _restored(
    n_vertices: int, sizes: IntArray, indices: IntArray, known: dict[str, Any]
) -> Connectivity:
    return Connectivity(n_vertices, sizes, indices, **known)
