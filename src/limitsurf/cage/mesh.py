"""The control cage: faces and tags as integers; points are carried, never computed with."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Generic, Literal, Self, TypeAlias, TypeVar, get_args, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf import html
from limitsurf.cage import checks
from limitsurf.cage.checks import Channel, FacesLike, MeshError
from limitsurf.cage.connectivity import Connectivity, derived, read_only
from limitsurf.cage.faces import IntArray, histogram
from limitsurf.numbers import Numbers

T = TypeVar("T")
M = TypeVar("M", bound="Mesh")

Boundary: TypeAlias = Literal["none", "edge_only", "edge_and_corner"]
Creasing: TypeAlias = Literal["uniform", "chaikin"]
Triangles: TypeAlias = Literal["catmull-clark", "smooth"]
Up: TypeAlias = Literal["y", "z"]

BOUNDARY: tuple[Boundary | None, ...] = (None, *get_args(Boundary))
CREASING: tuple[Creasing | None, ...] = (None, *get_args(Creasing))
TRIANGLES: tuple[Triangles | None, ...] = (None, *get_args(Triangles))
UP: tuple[Up | None, ...] = (None, *get_args(Up))
# what a mesh has besides points, faces, tags and channels, as it is given
_TAGS = ("creases", "corners", "holes", "channels", "face_data")
CHOICES = ("scheme", "boundary", "creasing", "triangles", "units", "up")


class _of_faces(Generic[T]):  # noqa: N801  (it stands for a property)
    """A member of the connectivity, as one of a mesh."""

    def __init__(self, member: derived[T]) -> None:
        self.name, self.__doc__ = member.name, member.__doc__

    @overload
    def __get__(self, mesh: None, owner: type) -> Self: ...
    @overload
    def __get__(self, mesh: Mesh, owner: type) -> T: ...
    def __get__(self, mesh: Mesh | None, owner: type) -> Self | T:
        if mesh is None:
            return self
        found: T = getattr(mesh.connectivity, self.name)
        return found


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
    face_data : mapping {name: (n_faces,) or (n_faces, k)}, optional
        Of each face a number, a row of numbers or a text: groups, materials, identities. They are
        carried along by refined meshes, tessellations, and files that have a place for them.
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
    face_data : read-only mapping {name: (n_faces,) or (n_faces, k)}

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
    connectivity: Connectivity
    creases: tuple[IntArray, NDArray[Any]]
    corners: tuple[IntArray, NDArray[Any]]
    holes: IntArray
    scheme: Any
    boundary: Boundary | None
    creasing: Creasing | None
    triangles: Triangles | None
    units: float | None
    up: Up | None
    _channels: dict[str, Channel]
    _face_data: dict[str, NDArray[Any]]
    _kept: dict[str, tuple[Any, Any]]  # see `kept`

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
        face_data: Mapping[str, ArrayLike] | None = None,
        units: float | None = None,
        up: Up | None = None,
    ) -> None:
        self.points = read_only(checks.numbers(points, "vertex"))
        self.connectivity = Connectivity(len(self.points), *checks.face_arrays(faces))
        checks.check_faces(self.connectivity)
        self._kept = {}
        tags = _checked(
            self.connectivity,
            creases=creases,
            corners=corners,
            holes=holes,
            scheme=scheme,
            boundary=boundary,
            creasing=creasing,
            triangles=triangles,
            channels=channels,
            face_data=face_data,
            units=units,
            up=up,
        )
        vars(self).update(tags)

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

    def with_tags(self, **tags: Any) -> Mesh:
        """A copy with other tags; points, faces, connectivity and all other tags are shared.

        Parameters
        ----------
        **tags
            All that ``Mesh`` takes besides points and faces: creases, corners, holes, scheme,
            channels, face_data and so on. None takes away what there is.

        Raises
        ------
        MeshError, TypeError, ValueError
            As for ``Mesh``.

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2, 3]], corners={0: 2})
        >>> square.with_tags(boundary="edge_only").corners[0].tolist()
        [0]
        """
        known = {name: getattr(self, name) for name in (*_TAGS, *CHOICES)}
        wrong = sorted(set(tags) - set(known))
        if wrong:
            raise TypeError(f"got {wrong[0]!r}, need one of {', '.join(known)}")
        mesh = object.__new__(Mesh)
        mesh.points, mesh.connectivity, mesh._kept = self.points, self.connectivity, {}
        vars(mesh).update(_checked(self.connectivity, **{**known, **tags}))
        return mesh

    @property
    def channels(self) -> Mapping[str, Channel]:
        """Face-varying data: {name: (values (k, ...), face_indices (n_corners,), mode)}."""
        return MappingProxyType(self._channels)

    @property
    def face_data(self) -> Mapping[str, NDArray[Any]]:
        """Values of faces, such as groups or materials: {name: (n_faces, ...)}."""
        return MappingProxyType(self._face_data)

    @property
    def sizes(self) -> IntArray:
        """Number of corners of each face: shape (n_faces,)."""
        return self.connectivity.sizes

    @property
    def indices(self) -> IntArray:
        """Vertex of each corner: shape (n_corners,)."""
        return self.connectivity.indices

    @property
    def n_vertices(self) -> int:
        """Number of vertices, unused ones included."""
        return self.connectivity.n_vertices

    @property
    def n_faces(self) -> int:
        """Number of faces."""
        return self.connectivity.n_faces

    @property
    def n_edges(self) -> int:
        """Number of edges."""
        return self.connectivity.n_edges

    @property
    def n_corners(self) -> int:
        """Number of face corners, the sum of ``sizes``."""
        return self.connectivity.n_corners

    @property
    def uniform(self) -> IntArray | None:
        """The vertices of all faces, (m, k), if each has k corners; None where they differ."""
        return self.faces.uniform

    @property
    def is_closed(self) -> bool:
        """Whether no edge has one face only."""
        return not self.boundary_edge.any()

    @property
    def is_manifold(self) -> bool:
        """Whether around each vertex there is one fan of faces, joined along edges of two faces.

        Boundaries are manifold; two faces that run along an edge the same way are not.
        """
        return not self.nonmanifold_vertex.any()

    faces = _of_faces(Connectivity.faces)
    offsets = _of_faces(Connectivity.offsets)
    corner_face = _of_faces(Connectivity.corner_face)
    next_corner = _of_faces(Connectivity.next_corner)
    previous_corner = _of_faces(Connectivity.previous_corner)
    separate = _of_faces(Connectivity.separate)
    edges = _of_faces(Connectivity.edges)
    corner_edge = _of_faces(Connectivity.corner_edge)
    edge_corners = _of_faces(Connectivity.edge_corners)
    edge_faces = _of_faces(Connectivity.edge_faces)
    boundary_edge = _of_faces(Connectivity.boundary_edge)
    nonmanifold_edge = _of_faces(Connectivity.nonmanifold_edge)
    twin = _of_faces(Connectivity.twin)
    boundary_vertex = _of_faces(Connectivity.boundary_vertex)
    nonmanifold_vertex = _of_faces(Connectivity.nonmanifold_vertex)
    boundary_chains = _of_faces(Connectivity.boundary_chains)
    vertex_faces = _of_faces(Connectivity.vertex_faces)
    fans = _of_faces(Connectivity.fans)
    ring_offsets = _of_faces(Connectivity.ring_offsets)
    ring_position = _of_faces(Connectivity.ring_position)
    ring_corners = _of_faces(Connectivity.ring_corners)

    def edge_numbers(self, ends: IntArray) -> IntArray:
        """Numbers (c,) of edges from their vertices (c, 2), ascending; they must exist."""
        return self.connectivity.edge_numbers(ends)

    def _facts(self) -> dict[str, Any]:
        """Numbers of what is in it, by their nouns; what there is none of but faces is left out."""
        tagged = {
            "boundary vertex": self.boundary_vertex.sum(),
            "non-manifold vertex": self.nonmanifold_vertex.sum(),
            "unused vertex": (self.vertex_faces == 0).sum(),
            "crease": len(self.creases[0]),
            "corner": len(self.corners[0]),
            "hole": len(self.holes),
        }
        known = {"vertex": self.n_vertices, "edge": self.n_edges, "face": self.n_faces}
        return known | {noun: int(n) for noun, n in tagged.items() if n}

    def _valences(self) -> str:
        on_rim = self.boundary_vertex | self.nonmanifold_vertex
        interior = self.vertex_faces[~on_rim & (self.vertex_faces > 0)]
        return str(histogram(interior)) if len(interior) else ""

    def _options(self) -> dict[str, Any]:
        options = {name: getattr(self, name) for name in CHOICES}
        return {name: value for name, value in options.items() if value is not None}

    def __repr__(self) -> str:
        known = {noun: checks.count(n, noun) for noun, n in self._facts().items()}
        known["face"] += f" {histogram(self.sizes)}"
        parts = list(known.values())
        if valences := self._valences():
            parts.insert(3, f"interior valences {valences}")
        parts += [f"{name}={value!r}" for name, value in self._options().items()]
        parts += [f"channel {name!r}" for name in self.channels]
        parts += [f"face data {name!r}" for name in self.face_data]
        return f"{type(self).__name__}({', '.join(parts)})"

    def _repr_html_(self) -> str:
        known = {checks.count(2, noun)[2:]: n for noun, n in self._facts().items()}
        known["faces"] = f"{self.n_faces} {histogram(self.sizes)}"
        others = {"channels": self.channels, "face data": self.face_data}
        lists = {name: ", ".join(found) for name, found in others.items()}
        valences = {"interior valences": self._valences()}
        return html.facts(type(self).__name__, {**known, **valences, **self._options(), **lists})

    def __eq__(self, other: object) -> bool:
        """Whether points, faces, tags, channels and data of faces are all the same."""
        if not isinstance(other, Mesh):
            return NotImplemented
        return all(map(_same, self._content(), other._content()))

    __hash__ = None  # type: ignore[assignment]

    def _content(self) -> tuple[Any, ...]:
        cage = (self.points, self.sizes, self.indices, self.creases, self.corners, self.holes)
        options = (getattr(self, name) for name in CHOICES)
        return *cage, *options, self._channels, self._face_data

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_kept": {}}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(read_only({"_kept": {}, **state}))


def kept(mesh: Mesh, name: str, key: Any, make: Callable[[], T]) -> T:
    """What follows from a mesh and a key, whatever the points: made once, for the last key.

    Copies with other points share it; `make` must not hold on to the mesh.
    """
    memory: dict[str, tuple[Any, T]] = vars(mesh)["_kept"]
    known = memory.get(name)
    if known is None or known[0] != key:
        known = memory[name] = key, make()
    return known[1]


def valid_mesh(kind: type[M], points: NDArray[Any], faces: Connectivity, **tags: Any) -> M:
    """A mesh of points known to be valid, taken without a copy, and of faces by what is known.

    Of a kind that is `Mesh` or derived from it; tags are as in ``Mesh``.
    """
    mesh = object.__new__(kind)
    mesh.points, mesh.connectivity, mesh._kept = read_only(points), faces, {}
    if tags.keys() <= set(CHOICES):
        vars(mesh).update(_NO_TAGS, **_choices(**tags))
    else:
        vars(mesh).update(_checked(faces, **tags))
    return mesh


def _checked(
    cage: Connectivity,
    *,
    creases: Any = None,
    corners: Any = None,
    holes: Any = None,
    scheme: Any = None,
    boundary: Boundary | None = None,
    creasing: Creasing | None = None,
    triangles: Triangles | None = None,
    channels: Any = None,
    face_data: Any = None,
    units: float | None = None,
    up: Up | None = None,
) -> dict[str, Any]:
    """What a mesh has besides points and faces, checked, by the names of its attributes."""
    choices = _choices(scheme, boundary, creasing, triangles, units, up)
    tags = {
        "creases": checks.crease_tags(cage, creases),
        "corners": checks.corner_tags(cage, corners),
        "holes": checks.hole_tags(cage, holes),
    }
    for what, value in (("channels", channels), ("face_data", face_data)):
        if not isinstance(value, Mapping | None):
            raise TypeError(f"{what}: need a mapping, got {type(value).__name__}")
    given = (channels or {}).items()
    found = {name: checks.channel(cage, name, channel) for name, channel in given}
    data = {
        name: checks.face_data(cage, name, values) for name, values in (face_data or {}).items()
    }
    return {**choices, **read_only(tags), **read_only({"_channels": found, "_face_data": data})}


def _choices(
    scheme: Any = None,
    boundary: Boundary | None = None,
    creasing: Creasing | None = None,
    triangles: Triangles | None = None,
    units: float | None = None,
    up: Up | None = None,
) -> dict[str, Any]:
    """The `CHOICES`, checked, by their names."""
    return {
        "scheme": scheme,
        "boundary": checks.choice(boundary, "boundary", BOUNDARY),
        "creasing": checks.choice(creasing, "creasing", CREASING),
        "triangles": checks.choice(triangles, "triangles", TRIANGLES),
        "units": checks.units(units),
        "up": checks.choice(up, "up", UP),
    }


_NO_TAGS: dict[str, Any] = read_only(
    {
        **dict.fromkeys(CHOICES),
        "creases": (np.zeros((0, 2), np.int64), np.zeros(0)),
        "corners": (np.zeros(0, np.int64), np.zeros(0)),
        "holes": np.zeros(0, np.int64),
        "_channels": {},
        "_face_data": {},
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
