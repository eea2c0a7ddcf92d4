"""The control cage: faces, rings and tags as integers; points are carried, never computed with."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Generic, Literal, Self, TypeAlias, TypeVar, get_args, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf import _kernels, checks
from limitsurf.cage.faces import Faces, histogram
from limitsurf.cage.faces import IntArray as IntArray
from limitsurf.checks import FacesLike
from limitsurf.checks import MeshError as MeshError
from limitsurf.numbers import Numbers

__all__ = ["Mesh", "MeshError"]

BoolArray: TypeAlias = NDArray[np.bool_]
Channel: TypeAlias = tuple[NDArray[Any], IntArray, str]

T = TypeVar("T")

Boundary: TypeAlias = Literal["none", "edge_only", "edge_and_corner"]
Creasing: TypeAlias = Literal["uniform", "chaikin"]
Triangles: TypeAlias = Literal["catmull-clark", "smooth"]
Up: TypeAlias = Literal["y", "z"]

BOUNDARY: tuple[Boundary | None, ...] = (None, *get_args(Boundary))
CREASING: tuple[Creasing | None, ...] = (None, *get_args(Creasing))
TRIANGLES: tuple[Triangles | None, ...] = (None, *get_args(Triangles))
UP: tuple[Up | None, ...] = (None, *get_args(Up))
INTERPOLATION = ("none", "corners_only", "corners_plus1", "corners_plus2", "boundaries", "all")
# what a mesh has besides points, faces, tags and channels, as it is given
CHOICES = ("scheme", "boundary", "creasing", "triangles", "units", "up")


class _shared(Generic[T]):  # noqa: N801  (a decorator)
    """Computed on first use, read-only, and shared by all copies of a mesh with other points."""

    def __init__(self, compute: Callable[[Any], T]) -> None:
        self.compute = compute
        self.name = compute.__name__
        self.__doc__ = compute.__doc__

    @overload
    def __get__(self, mesh: None, owner: type) -> Self: ...
    @overload
    def __get__(self, mesh: Mesh, owner: type) -> T: ...
    def __get__(self, mesh: Mesh | None, owner: type) -> Self | T:
        if mesh is None:
            return self
        try:
            found: T = mesh._connectivity[self.name]
        except KeyError:
            mesh._connectivity[self.name] = found = read_only(self.compute(mesh))
        return found


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

    @property
    def sizes(self) -> IntArray:
        """Number of faces of each fan: shape (n_fans,)."""
        return np.diff(self.offsets)

    @classmethod
    def of(cls, mesh: Mesh, twin: IntArray) -> Fans:
        """Fans of faces joined where a half-edge has a twin (n_corners,); it is -1 elsewhere.

        Linked lists ranked by pointer doubling, in log2 of the largest valence steps.
        """
        if mesh._compiled:
            from limitsurf._kernels import connectivity

            return cls(*connectivity.fans(mesh._steps, read_only(twin), *mesh._around[:2]))
        corner = np.arange(mesh.n_corners)
        clockwise = np.where(twin < 0, corner, mesh.next_corner[twin])
        steps = int(mesh.vertex_faces.max()).bit_length()
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
        start = start[np.argsort(mesh.indices[start], kind="stable")]
        fan = np.empty_like(corner)
        fan[start] = np.arange(len(start))
        fan = fan[first]
        offsets = _offsets(np.bincount(fan))
        corners = np.empty_like(corner)
        corners[offsets[fan] + position] = corner
        return cls(mesh.indices[start], cyclic[start], offsets, corners, fan, position)


class Mesh:
    """A polygonal control cage: faces of any size, open or closed, manifold or not.

    A *corner* ``h`` (0 to ``n_corners`` - 1) is a vertex in a face; it also stands for the
    half-edge from its vertex to that of the next corner of the face. The corners of face ``f`` are
    ``offsets[f]`` to ``offsets[f + 1] - 1``, counter-clockwise. All arrays are read-only.

    Parameters
    ----------
    points : array_like, shape (n_vertices, ...)
        Control points with any number of channels. Integers and floats are stored as float64;
        arrays of objects (Fractions, mpf, sympy numbers) are kept as they are.
    faces : (m, k) integer array, list of index sequences, pair (sizes, indices), or Faces
        Vertex indices of each face, counter-clockwise. The pair is a tuple of two 1-d integer
        arrays: the number of corners of each face, and the vertices of all faces in turn. Two
        faces are a list, or a tuple of tuples. `Faces` are those of another mesh.
    creases : mapping {(a, b): sharpness} or pair (edges (c, 2), sharpness (c,)), optional
        Edges, in either order of their vertices, with a sharpness in [0, inf]; from 10 on an edge
        is infinitely sharp.
    corners : mapping {vertex: sharpness} or pair (vertices (c,), sharpness (c,)), optional
        Vertices with a sharpness.
    holes : sequence of int, optional
        Faces that have no surface, yet shape their neighbours.
    scheme : str or Scheme, optional
        Kept as it is. None here and below leaves the choice to whoever uses the mesh.
    boundary : {"none", "edge_only", "edge_and_corner"}, optional
    creasing : {"uniform", "chaikin"}, optional
    triangles : {"catmull-clark", "smooth"}, optional
    channels : mapping {name: (values (k, ...), face_indices (n_corners,), interpolation)}, optional
        Face-varying data: for each corner the row of ``values`` that it takes. ``interpolation``
        is "none", "corners_only", "corners_plus1", "corners_plus2", "boundaries" or "all". Values
        may be NaN, where faces have none.
    units : float, optional
        The metres that one unit of the points is. It is kept for files; nothing is scaled by it.
    up : {"y", "z"}, optional
        The axis that points up, kept for files likewise.

    Attributes
    ----------
    points : ndarray, shape (n_vertices, ...), float64 or object
    sizes : ndarray of int64, shape (n_faces,)
        Number of corners of each face.
    indices : ndarray of int64, shape (n_corners,)
        Vertex of each corner.
    faces : Faces
        The faces by themselves: ``len(faces)`` arrays of vertices, whatever their sizes.
    uniform : ndarray of int64, shape (n_faces, k), or None
        The vertices of all faces if each has k corners; None where their sizes differ.
    creases : (edges (c, 2), sharpness (c,))
        Rows ascending, in the order of ``edges``. Sharpness is float64, or object where Fractions
        were given.
    corners : (vertices (c,), sharpness (c,))
        Vertices ascending.
    holes : ndarray of int64
        Faces ascending.
    scheme, boundary, creasing, triangles, units, up
        As given.
    channels : read-only mapping {name: (values, face_indices, interpolation)}

    Raises
    ------
    MeshError
        No vertex or face; a coordinate that is NaN or infinite; a vertex index that is negative or
        out of range; a face with fewer than three corners; a tag on an edge, vertex or face that
        does not exist, a tag given twice, or one with a sharpness outside [0, inf].
    TypeError
        Points that are no numbers, indices that are no integers.
    ValueError
        An unknown ``boundary``, ``creasing``, ``triangles``, interpolation or ``up``; ``units``
        that are no positive number.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[0, 0], [1, 0], [2, 0], [0, 1], [1, 1]]
    >>> mesh = ls.Mesh(points, [[0, 1, 4, 3], [1, 2, 4]], creases={(4, 1): 2.5})
    >>> mesh
    Mesh(5 vertices, 6 edges, 2 faces {3: 1, 4: 1}, 5 boundary vertices, 1 crease)
    >>> mesh.edges[mesh.boundary_edge].tolist()
    [[0, 1], [0, 3], [1, 2], [2, 4], [3, 4]]
    """

    points: NDArray[Any]
    sizes: IntArray
    indices: IntArray
    creases: tuple[IntArray, NDArray[Any]]
    corners: tuple[IntArray, NDArray[Any]]
    holes: IntArray
    scheme: Any
    boundary: Boundary | None
    creasing: Creasing | None
    triangles: Triangles | None
    units: float | None
    up: Up | None

    def __init__(
        self,
        points: Numbers,
        faces: FacesLike,
        *,
        creases: Mapping[tuple[int, int], Any] | tuple[ArrayLike, ArrayLike] | None = None,
        corners: Mapping[int, Any] | tuple[ArrayLike, ArrayLike] | None = None,
        holes: ArrayLike | None = None,
        scheme: Any = None,
        boundary: Boundary | None = None,
        creasing: Creasing | None = None,
        triangles: Triangles | None = None,
        channels: Mapping[str, tuple[Numbers, ArrayLike, str]] | None = None,
        units: float | None = None,
        up: Up | None = None,
    ) -> None:
        self._connectivity: dict[str, Any] = {}
        self.points = read_only(checks.numbers(points, "vertex"))
        sizes, indices = checks.face_arrays(faces)
        self.sizes, self.indices = read_only(sizes), read_only(indices)
        _check_faces(self)
        self._set_tags(
            creases=creases,
            corners=corners,
            holes=holes,
            scheme=scheme,
            boundary=boundary,
            creasing=creasing,
            triangles=triangles,
            channels=channels,
            units=units,
            up=up,
        )

    @classmethod
    def _from_valid(
        cls,
        points: NDArray[Any],
        sizes: IntArray,
        indices: IntArray,
        connectivity: dict[str, Any] | None = None,
        **tags: Any,
    ) -> Self:
        """A mesh of arrays known to be valid, taken without a copy; tags are as in ``Mesh``."""
        mesh = object.__new__(cls)
        mesh._connectivity = {} if connectivity is None else connectivity
        mesh.points, mesh.sizes, mesh.indices = map(read_only, (points, sizes, indices))
        if tags:
            mesh._set_tags(**tags)
        else:
            mesh.__dict__.update(_NO_TAGS)
        return mesh

    def _set_tags(
        self,
        *,
        creases: Any = None,
        corners: Any = None,
        holes: Any = None,
        scheme: Any = None,
        boundary: Boundary | None = None,
        creasing: Creasing | None = None,
        triangles: Triangles | None = None,
        channels: Any = None,
        units: float | None = None,
        up: Up | None = None,
    ) -> None:
        self.scheme = scheme
        self.boundary = checks.choice(boundary, "boundary", BOUNDARY)
        self.creasing = checks.choice(creasing, "creasing", CREASING)
        self.triangles = checks.choice(triangles, "triangles", TRIANGLES)
        self.units, self.up = checks.units(units), checks.choice(up, "up", UP)
        self.creases = read_only(_crease_tags(self, creases))
        self.corners = read_only(_corner_tags(self, corners))
        self.holes = read_only(_hole_tags(self, holes))
        if not isinstance(channels, Mapping | None):
            raise TypeError(f"channels: need a mapping, got {type(channels).__name__}")
        self._channels = read_only(
            {name: _channel(self, name, given) for name, given in (channels or {}).items()}
        )

    def with_points(self, points: Numbers) -> Self:
        """A copy with other points, (n_vertices, ...); faces, tags and connectivity are shared.

        Raises
        ------
        MeshError
            A number of points other than ``n_vertices``, or coordinates that are NaN or infinite.
        """
        new_points = checks.numbers(points, "vertex")
        if len(new_points) != self.n_vertices:
            raise MeshError(
                f"got {len(new_points)} points, need {self.n_vertices}, one for each vertex"
            )
        mesh = object.__new__(type(self))
        mesh.__dict__.update(self.__dict__, points=read_only(new_points))
        return mesh

    @property
    def channels(self) -> Mapping[str, Channel]:
        """Face-varying data: {name: (values (k, ...), face_indices (n_corners,), mode)}."""
        return MappingProxyType(self._channels)

    @property
    def n_vertices(self) -> int:
        """Number of vertices, unused ones included."""
        return len(self.points)

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

    @_shared
    def faces(self) -> Faces:
        """The faces, a sequence of arrays of vertices, whatever their sizes."""
        return Faces(self.sizes, self.indices)

    @property
    def uniform(self) -> IntArray | None:
        """The vertices of all faces, (m, k), if each has k corners; None where they differ."""
        return self.faces.uniform

    @_shared
    def offsets(self) -> IntArray:
        """First corner of each face, and ``n_corners``: shape (n_faces + 1,)."""
        return _offsets(self.sizes)

    @_shared
    def corner_face(self) -> IntArray:
        """Face of each corner: shape (n_corners,)."""
        return np.repeat(np.arange(self.n_faces), self.sizes)

    @_shared
    def next_corner(self) -> IntArray:
        """The next corner in the same face: shape (n_corners,)."""
        following = np.arange(1, self.n_corners + 1)
        following[self.offsets[1:] - 1] = self.offsets[:-1]
        return following

    @_shared
    def previous_corner(self) -> IntArray:
        """The previous corner in the same face: shape (n_corners,)."""
        preceding = np.arange(-1, self.n_corners - 1)
        preceding[self.offsets[:-1]] = self.offsets[1:] - 1
        return preceding

    @_shared
    def _large(self) -> bool:
        """Whether the mesh, or that which it is a part of, is large enough for compiled kernels."""
        return _kernels.compiled(self.n_corners)

    @_shared
    def _compiled(self) -> bool:
        """Whether to use compiled connectivity, whose corners have 32 bits in places.

        It finds the same integers: once a large mesh has used it, small ones do too.
        """
        return self.n_corners < 2**31 and (_kernels.connects() or self._large)

    @_shared
    def _steps(self) -> tuple[int, IntArray, IntArray]:
        """How kernels go around faces: 4 for quads; else 0, and the next and previous corner."""
        if int(self.sizes.max()) == 4 == int(self.sizes.min()):
            return 4, np.zeros(0, np.int64), np.zeros(0, np.int64)
        return 0, self.next_corner, self.previous_corner

    @property
    def _of_quads(self) -> bool:
        """Whether all faces are quads."""
        return self._steps[0] == 4

    def _first(self, faces: IntArray) -> IntArray:
        """The first corners of faces."""
        return 4 * faces if self._of_quads else self.offsets[faces]

    def _after(self, corners: IntArray) -> IntArray:
        """The next corners in the same faces."""
        size, after, _ = self._steps
        return corners & ~3 | corners + 1 & 3 if size == 4 else after[corners]

    @_shared
    def _around(self) -> tuple[IntArray, IntArray, bool]:
        """The corners at each vertex, and whether a face has a vertex more than once."""
        from limitsurf._kernels import connectivity

        return connectivity.around(self.indices, self.offsets, self.n_vertices)

    @_shared
    def separate(self) -> BoolArray:
        """Half-edges with an edge of their own, whatever others join their vertices: (n_corners,).

        Those from a vertex to itself, and those whose face has run along their edge before.
        """
        if not self._repeats:
            return np.zeros(self.n_corners, dtype=bool)
        start, end = self.indices, self.indices[self.next_corner]
        result: BoolArray = np.asarray(start == end)
        key = np.minimum(start, end) * self.n_vertices + np.maximum(start, end)
        order = np.lexsort((key, self.corner_face))
        key, face = key[order], self.corner_face[order]
        result[order[1:]] |= (key[1:] == key[:-1]) & (face[1:] == face[:-1])
        return result

    @_shared
    def _parallel(self) -> bool:
        """Whether there are edges between the same vertices that the faces do not tell of.

        Refinement may make them, with an `_edge_table` that it knows.
        """
        return False

    @_shared
    def _repeats(self) -> bool:
        """Whether a face has a vertex more than once."""
        if self._compiled:
            return self._around[2]
        size = int(self.sizes[0])
        if size <= 4 and (self.sizes == size).all():
            corners = self.indices.reshape(-1, size).T
            return any(
                bool((corners[i] == corners[j]).any()) for i in range(size) for j in range(i)
            )
        key = np.sort(self.corner_face * self.n_vertices + self.indices)
        return bool((key[1:] == key[:-1]).any())

    @_shared
    def _edge_table(self) -> tuple[IntArray, IntArray, IntArray]:
        """``edges``, ``corner_edge``, ``edge_corners``: half-edges sorted by their vertices."""
        if self._compiled and not self._repeats:
            from limitsurf._kernels import connectivity

            known = self.indices, self._steps, self.twin
            return connectivity.edges(*known, *self._around[:2])
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

    @_shared
    def edges(self) -> IntArray:
        """The vertices of each edge, ascending, rows in lexicographic order: shape (n_edges, 2).

        Rows are distinct unless a face has a vertex more than once, see `separate`.
        """
        return self._edge_table[0]

    @_shared
    def corner_edge(self) -> IntArray:
        """Edge of each corner's half-edge: shape (n_corners,)."""
        return self._edge_table[1]

    @_shared
    def edge_corners(self) -> IntArray:
        """The half-edges of each edge, lower first: shape (n_edges, 2).

        Second -1 on a boundary, and on a non-manifold edge, whose first is the lowest.
        """
        return self._edge_table[2]

    def edge_numbers(self, ends: IntArray) -> IntArray:
        """Numbers (c,) of edges from their vertices (c, 2), ascending; they must exist."""
        key = self.edges[:, 0] * self.n_vertices + self.edges[:, 1]
        return np.searchsorted(key, ends[:, 0] * self.n_vertices + ends[:, 1])

    @_shared
    def edge_faces(self) -> IntArray:
        """Number of faces at each edge: shape (n_edges,)."""
        return np.bincount(self.corner_edge)

    @_shared
    def boundary_edge(self) -> BoolArray:
        """Whether an edge has one face only: shape (n_edges,)."""
        return np.asarray(self.edge_faces == 1)

    @_shared
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

    @_shared
    def twin(self) -> IntArray:
        """The half-edge in the opposite direction, -1 on boundary and non-manifold edges.

        Shape (n_corners,).
        """
        if self._compiled and not self._repeats:
            from limitsurf._kernels import connectivity

            return connectivity.twins(self.indices, self._steps, *self._around[:2])
        twin = np.full(self.n_corners, -1)
        one, other = self.edge_corners[self.edge_corners[:, 1] >= 0].T
        twin[one], twin[other] = other, one
        return twin

    @_shared
    def boundary_vertex(self) -> BoolArray:
        """Whether a vertex lies on a boundary edge: shape (n_vertices,)."""
        on_boundary = np.zeros(self.n_vertices, dtype=bool)
        ends, alone, _ = self._rim
        on_boundary[ends[alone]] = True
        return on_boundary

    @_shared
    def nonmanifold_vertex(self) -> BoolArray:
        """Whether a vertex is on a non-manifold edge or of several fans: shape (n_vertices,)."""
        result = np.asarray((self._valences == 0) & (self.vertex_faces > 0))
        ends, _, odd = self._rim
        result[ends[odd]] = True
        return result

    @_shared
    def _valences(self) -> IntArray:
        """Faces at each vertex, (n_vertices,); negative on a rim, 0 where they form no one fan."""
        if self._compiled:
            from limitsurf._kernels import connectivity

            return connectivity.valences(self._steps, self.twin, *self._around[:2])
        fans = self.fans
        valences = np.zeros(self.n_vertices, dtype=np.int64)
        valences[fans.vertex] = np.where(fans.closed, fans.sizes, -fans.sizes)
        valences[np.bincount(fans.vertex, minlength=self.n_vertices) > 1] = 0
        return valences

    @_shared
    def _rim(self) -> tuple[IntArray, BoolArray, BoolArray]:
        """Vertices (n, 2) of edges without twins; whether they have one face; are not manifold."""
        if self._repeats:
            rim = np.flatnonzero(self.edge_corners[:, 1] < 0)
            return self.edges[rim], self.boundary_edge[rim], self.nonmanifold_edge[rim]
        corners = np.flatnonzero(self.twin < 0)
        one, other = self.indices[corners], self.indices[self._after(corners)]
        key = np.minimum(one, other) * self.n_vertices + np.maximum(one, other)
        key, faces = np.unique(key, return_counts=True)
        return np.stack(np.divmod(key, self.n_vertices), axis=1), faces == 1, faces > 1

    @_shared
    def vertex_faces(self) -> IntArray:
        """Number of faces at each vertex, 0 if it is unused: shape (n_vertices,).

        At an interior vertex this is its valence.
        """
        if self._compiled:
            return np.diff(self._around[0])
        return np.bincount(self.indices, minlength=self.n_vertices)

    @_shared
    def fans(self) -> Fans:
        """The corners at each vertex in fans of faces joined along manifold edges."""
        return Fans.of(self, self.twin)

    @_shared
    def ring_offsets(self) -> IntArray:
        """Start of each vertex's ring in ``ring_corners``, and the end: shape (n_vertices + 1,)."""
        return _offsets(self.vertex_faces)

    @_shared
    def ring_position(self) -> IntArray:
        """Position of each corner in the ring of its vertex: shape (n_corners,)."""
        position = np.empty(self.n_corners, dtype=np.int64)
        position[self.ring_corners] = np.arange(self.n_corners)
        return position - self.ring_offsets[self.indices]

    @_shared
    def ring_corners(self) -> IntArray:
        """The corners (outgoing half-edges) at each vertex, counter-clockwise: shape (n_corners,).

        After corner ``h`` comes ``twin[previous_corner[h]]``. The ring of a boundary vertex starts
        at its outgoing boundary half-edge, that of an interior vertex at its smallest corner; at
        a non-manifold vertex its fans follow each other.
        """
        return self.fans.corners

    def __repr__(self) -> str:
        on_rim = self.boundary_vertex | self.nonmanifold_vertex
        interior = self.vertex_faces[~on_rim & (self.vertex_faces > 0)]
        parts = [
            checks.count(self.n_vertices, "vertex"),
            checks.count(self.n_edges, "edge"),
            f"{checks.count(self.n_faces, 'face')} {histogram(self.sizes)}",
        ]
        if len(interior):
            parts.append(f"interior valences {histogram(interior)}")
        tagged = {
            "boundary vertex": self.boundary_vertex.sum(),
            "non-manifold vertex": self.nonmanifold_vertex.sum(),
            "unused vertex": (self.vertex_faces == 0).sum(),
            "crease": len(self.creases[0]),
            "corner": len(self.corners[0]),
            "hole": len(self.holes),
        }
        parts += [checks.count(n, noun) for noun, n in tagged.items() if n]
        options = {name: getattr(self, name) for name in CHOICES}
        parts += [f"{name}={value!r}" for name, value in options.items() if value is not None]
        parts += [f"channel {name!r}" for name in self.channels]
        return f"{type(self).__name__}({', '.join(parts)})"

    def __eq__(self, other: object) -> bool:
        """Whether points, faces, tags and channels are all the same."""
        if not isinstance(other, Mesh):
            return NotImplemented
        return all(map(_same, self._content(), other._content()))

    __hash__ = None  # type: ignore[assignment]

    def _content(self) -> tuple[Any, ...]:
        cage = (self.points, self.sizes, self.indices, self.creases, self.corners, self.holes)
        return *cage, *(getattr(self, name) for name in CHOICES), self._channels

    def __getstate__(self) -> dict[str, Any]:
        # these can be known from how the mesh was made; everything else is computed again
        known = ("separate", "twin", "_repeats", *("_parallel", "_edge_table") * self._parallel)
        given = {name: x for name, x in self._connectivity.items() if name in known}
        return {**self.__dict__, "_connectivity": given}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(read_only(state))


def valid_mesh(
    points: NDArray[Any],
    sizes: IntArray,
    indices: IntArray,
    like: Mesh | None = None,
    **tags: Any,
) -> Mesh:
    """A mesh of arrays known to be valid, taken without a copy; tags are as in ``Mesh``.

    With one `like` it, of the same faces, it shares what is known of these.
    """
    known = None if like is None else like._connectivity
    return Mesh._from_valid(points, sizes, indices, known, **tags)


def read_only(value: T) -> T:
    """A value with every array in it, also in tuples, lists and dicts, as a read-only view."""
    found: Any = value
    if isinstance(value, np.ndarray):
        found = value.view()
        found.setflags(write=False)
    elif isinstance(value, (tuple, list)):
        found = type(value)(map(read_only, value))
    elif isinstance(value, dict):
        found = {name: read_only(item) for name, item in value.items()}
    return found  # type: ignore[no-any-return]


_NO_TAGS: dict[str, Any] = read_only(
    {
        **dict.fromkeys(CHOICES),
        "creases": (np.zeros((0, 2), np.int64), np.zeros(0)),
        "corners": (np.zeros(0, np.int64), np.zeros(0)),
        "holes": np.zeros(0, np.int64),
        "_channels": {},
    }
)


def _same(one: Any, other: Any) -> bool:
    """Equality, by value, of arrays, of tuples and dicts of them, and of plain values."""
    if isinstance(one, np.ndarray):
        if not isinstance(other, np.ndarray) or one.shape != other.shape:
            return False
        return bool(((one == other) | ((one != one) & (other != other))).all())
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(_same(one[name], other[name]) for name in one)
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(_same, one, other))
    return bool(one == other)


def _offsets(counts: IntArray) -> IntArray:
    return np.concatenate([[0], np.cumsum(counts)])


def _check_faces(mesh: Mesh) -> None:
    """Every face has three or more corners, at vertices that exist."""
    checks.check_sizes(mesh.sizes)

    def missing(h: int) -> tuple[Any, ...]:
        face, vertex = int(mesh.corner_face[h]), mesh.indices[h]
        reason = "negative" if vertex < 0 else "out of range"
        need = f"need 0 to {mesh.n_vertices - 1}"
        return f"face {face}: vertex index {vertex} is {reason}, {need}", ("face", face)

    if mesh.indices.min() < 0 or mesh.indices.max() >= mesh.n_vertices:
        checks.check((mesh.indices < 0) | (mesh.indices >= mesh.n_vertices), missing)


def _crease_tags(mesh: Mesh, given: Any) -> tuple[IntArray, NDArray[Any]]:
    keys, values = checks.tagged(given, "crease")
    ends = (
        checks.integers(keys, "vertices of creases")
        if len(keys)
        else np.zeros((0, 2), dtype=np.int64)
    )
    if ends.ndim != 2 or ends.shape[1] != 2:
        raise MeshError(f"creases: got edges of shape {ends.shape}, need (c, 2)")
    names = ends
    sharpness = checks.sharpness(values, "crease", names)
    if len(names) == 0:
        return ends, sharpness
    ends = np.sort(ends, axis=1)
    edge = mesh.edge_numbers(ends).clip(max=mesh.n_edges - 1)
    checks.check(
        (mesh.edges[edge] != ends).any(axis=1),
        lambda i: (
            f"crease {checks.named(names[i])}: the mesh has no such edge",
            ("crease", checks.named(names[i])),
        ),
    )
    order = checks.distinct_order(edge, "crease", names)
    return ends[order], sharpness[order]


def _corner_tags(mesh: Mesh, given: Any) -> tuple[IntArray, NDArray[Any]]:
    keys, values = checks.tagged(given, "corner")
    vertices = checks.integers(keys, "vertices of corners")
    checks.check_range(vertices, "corner", mesh.n_vertices)
    sharpness = checks.sharpness(values, "corner", vertices)
    order = checks.distinct_order(vertices, "corner", vertices)
    return vertices[order], sharpness[order]


def _hole_tags(mesh: Mesh, given: Any) -> IntArray:
    faces = checks.integers(() if given is None else given, "holes")
    checks.check_range(faces, "hole", mesh.n_faces)
    return faces[checks.distinct_order(faces, "hole", faces)]


def _channel(mesh: Mesh, name: str, given: Any) -> Channel:
    if not isinstance(given, (tuple, list)) or len(given) != 3:
        raise TypeError(f"channel {name!r}: need (values, face_indices, interpolation)")
    values = checks.numbers(given[0], "row", f"channel {name!r}: ", gaps=True)
    rows = checks.integers(given[1], f"channel {name!r}: face_indices")
    if rows.shape != (mesh.n_corners,):
        raise MeshError(
            f"channel {name!r}: got face_indices of shape {rows.shape}, need ({mesh.n_corners},)"
        )

    def missing(h: int) -> tuple[Any, ...]:
        face = int(mesh.corner_face[h])
        need = f"need 0 to {len(values) - 1}"
        return f"channel {name!r}: face {face} has index {rows[h]}, {need}", ("face", face)

    checks.check((rows < 0) | (rows >= len(values)), missing)
    interpolation = checks.choice(given[2], f"channel {name!r}: interpolation", INTERPOLATION)
    return values, rows, interpolation
