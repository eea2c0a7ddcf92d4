"""Recursive refinement: mesh and masks to refined mesh and sparse refinement operator."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, Self, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf import tables
from limitsurf._kernels import reference as kernels
from limitsurf.mesh import Mesh

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from limitsurf.exact.scheme import Scheme

Array = NDArray[Any]


class ExactOperator:
    """A sparse matrix of exact numbers: what ``scipy.sparse`` is for float64.

    Attributes
    ----------
    rows, columns : (nnz,) int64
        Sorted by row, then column, without duplicates.
    values : (nnz,) object
    shape : (int, int)

    Examples
    --------
    >>> import limitsurf as ls
    >>> from fractions import Fraction
    >>> square = ls.Mesh([[0], [1], [1], [0]], [[0, 1, 2, 3]])
    >>> W = ls.LimitSurface(square).weights(0, Fraction(1, 3), Fraction(1, 2))
    >>> [str(w) for w in W.toarray()[0]], str((W @ square.points)[0, 0])
    (['1/3', '1/6', '1/6', '1/3'], '1/3')
    """

    def __init__(self, rows: Array, columns: Array, values: Array, shape: tuple[int, int]) -> None:
        order = np.lexsort((columns, rows))
        rows, columns, values = rows[order], columns[order], values[order]
        if len(rows):
            new = np.flatnonzero(np.diff(rows, prepend=-1) | np.diff(columns, prepend=-1))
            rows, columns, values = rows[new], columns[new], np.add.reduceat(values, new)
        self.rows, self.columns, self.values, self.shape = rows, columns, values, shape

    @cached_property
    def indptr(self) -> Array:
        """Row r is entries ``indptr[r]`` to ``indptr[r + 1] - 1``, (rows + 1,)."""
        return np.searchsorted(self.rows, np.arange(self.shape[0] + 1))

    @overload
    def __matmul__(self, other: ExactOperator) -> ExactOperator: ...
    @overload
    def __matmul__(self, other: ArrayLike) -> Array: ...
    def __matmul__(self, other: Any) -> Any:
        """Product with another operator, or with an array of shape (columns, ...), exactly."""
        shape = other.shape if isinstance(other, ExactOperator) else np.shape(other)
        if shape[:1] != (self.shape[1],):
            raise ValueError(f"an operator of shape {self.shape} cannot act on shape {shape}")
        if isinstance(other, ExactOperator):
            counts = np.diff(other.indptr)[self.columns]
            entry = np.repeat(np.arange(len(self.rows)), counts)
            place = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
            place += other.indptr[self.columns[entry]]
            return ExactOperator(
                self.rows[entry],
                other.columns[place],
                self.values[entry] * other.values[place],
                (self.shape[0], other.shape[1]),
            )
        dense = kernels.exact(other)
        flat = dense.reshape(len(dense), -1)
        result = np.full((self.shape[0], flat.shape[1]), Fraction(0), dtype=object)
        if len(self.rows):
            present, first = np.unique(self.rows, return_index=True)
            terms = self.values[:, None] * flat[self.columns]
            result[present] = np.add.reduceat(terms, first, axis=0)
        return result.reshape(self.shape[0], *dense.shape[1:])

    def toarray(self) -> Array:
        """The matrix as a dense object array."""
        dense = np.full(self.shape, Fraction(0), dtype=object)
        dense[self.rows, self.columns] = self.values
        return dense

    def __repr__(self) -> str:
        return f"<ExactOperator of shape {self.shape} with {len(self.rows)} entries>"


def sparse_operator(rows: Array, columns: Array, values: Array, shape: tuple[int, int]) -> Any:
    """``csr_array`` for float64 values, `ExactOperator` for objects; duplicates are summed."""
    if values.dtype == object:
        return ExactOperator(rows, columns, values, shape)
    from scipy.sparse import coo_array

    return coo_array((values, (rows, columns)), shape=shape).tocsr()


@dataclass(frozen=True)
class Rules:
    """Which scheme applies to a mesh, and how at its boundary."""

    scheme: Scheme
    boundary: str
    creasing: str
    triangles: str

    @classmethod
    def resolve(
        cls,
        mesh: Mesh,
        scheme: str | Scheme | None = None,
        boundary: str | None = None,
        creasing: str | None = None,
        triangles: str | None = None,
    ) -> Rules:
        """Options from the arguments, else from the mesh, else the defaults; all are checked."""
        given = {"boundary": boundary, "creasing": creasing, "triangles": triangles}
        allowed = {
            "boundary": ("edge_and_corner", "edge_only", "none"),
            "creasing": ("uniform", "chaikin"),
            "triangles": ("catmull-clark", "smooth"),
        }
        chosen = {}
        for option, values in allowed.items():
            value = next(
                x for x in (given[option], getattr(mesh, option), values[0]) if x is not None
            )
            if value not in values:
                raise ValueError(f"{option} must be one of {', '.join(values)}, got {value!r}")
            chosen[option] = value
        named = scheme if scheme is not None else mesh.scheme
        rules = cls(tables.find_scheme("catmull-clark" if named is None else named), **chosen)
        for what, (tagged, sharpness) in (
            ("edge {} is a crease", mesh.creases),
            ("vertex {} is a corner", mesh.corners),
        ):
            for k in np.flatnonzero(sharpness > 0)[:1]:
                place = tagged[k].tolist()
                name = tuple(place) if isinstance(place, list) else place
                raise NotImplementedError(f"{what.format(name)} of sharpness {sharpness[k]}")
        if chosen["triangles"] == "smooth" and (mesh.sizes == 3).any():
            raise NotImplementedError('the triangle rule "smooth" on a mesh with triangles')
        return rules

    def sharp(self, mesh: Mesh) -> Array:
        """Boundary vertices that stay where they are, (n_vertices,) bool."""
        if self.boundary != "edge_and_corner":
            return np.zeros(mesh.n_vertices, dtype=bool)
        return np.asarray(mesh.boundary_vertex & (mesh.vertex_faces == 1))

    def without_limit(self, mesh: Mesh) -> Array:
        """Faces that are holes, tagged or by boundary "none", (n_faces,) bool."""
        result = np.zeros(mesh.n_faces, dtype=bool)
        result[mesh.holes] = True
        if self.boundary == "none":
            result[mesh.corner_face[mesh.boundary_vertex[mesh.indices]]] = True
        return result


def child_faces(mesh: Mesh) -> Array:
    """Quads of the refined mesh by corner of `mesh`, (n_corners, 4); see `refined`."""
    V, E = mesh.n_vertices, mesh.n_edges
    edge = V + mesh.corner_edge
    return np.stack(
        [mesh.indices, edge, V + E + mesh.corner_face, edge[mesh.previous_corner]], axis=1
    )


def child_mesh(mesh: Mesh, points: Array) -> Mesh:
    """The refined mesh on given points, its twins and boundary known without sorting edges."""
    children = Mesh._from_valid(points, np.full(mesh.n_corners, 4), child_faces(mesh).ravel())
    after, before, twin = mesh.next_corner, mesh.previous_corner, mesh.twin
    entering = twin[before]  # across the edge that ends at the corner
    # half-edges of child h: corner to midpoint, to face point, to midpoint before, to corner
    twins = np.stack(
        [
            np.where(twin < 0, -1, 4 * after[twin] + 3),
            4 * after + 2,
            4 * before + 1,
            np.where(entering < 0, -1, 4 * entering),
        ],
        axis=1,
    ).ravel()
    rim = np.zeros(children.n_vertices, dtype=bool)
    outer = np.flatnonzero(twins < 0)
    rim[children.indices[outer]] = rim[children.indices[children.next_corner[outer]]] = True
    children._connectivity.update(twin=twins, boundary_vertex=rim)
    return children


def refinement_stages(mesh: Mesh, rules: Rules, dtype: Any) -> tuple[Any, Any]:
    """One level of refinement as two sparse operators.

    The first gives the face points from the vertices, (F, V); the second the refined points from
    vertices and face points, (V + E + F, V + F). A face of n corners costs n entries in each; in
    their product it would cost n^2.
    """
    V, E, F = mesh.n_vertices, mesh.n_edges, mesh.n_faces
    faces = sparse_operator(
        mesh.corner_face,
        mesh.indices,
        tables.corner_weights(rules.scheme, mesh.sizes, dtype),
        (F, V),
    )
    edge, boundary_edge, boundary_vertex = tables.rule_weights(rules.scheme, dtype)
    entries: list[tuple[Array, Array, Array]] = []

    def add(rows: Array, columns: Array, weight: Array) -> None:
        entries.append((rows, columns, np.broadcast_to(weight, rows.shape)))

    tail, head = mesh.indices, mesh.indices[mesh.next_corner]
    outer = mesh.twin < 0
    one = tables.one(dtype)
    # vertex points
    smooth_boundary = mesh.boundary_vertex & ~rules.sharp(mesh)
    interior = ~mesh.boundary_vertex & (mesh.vertex_faces > 0)
    kept = np.flatnonzero(~interior & ~smooth_boundary)
    add(kept, kept, one)
    inner = np.flatnonzero(interior)
    weights = np.zeros((V, 3), dtype=dtype)
    weights[inner] = tables.vertex_weights(rules.scheme, mesh.vertex_faces[inner], dtype)
    add(inner, inner, weights[inner, 0])
    h = np.flatnonzero(interior[tail])
    add(tail[h], head[h], weights[tail[h], 1])
    add(tail[h], V + mesh.corner_face[h], weights[tail[h], 2])
    rim = np.flatnonzero(smooth_boundary)
    add(rim, rim, boundary_vertex[:1])
    h = np.flatnonzero(outer & smooth_boundary[tail])
    add(tail[h], head[h], boundary_vertex[1:])
    h = np.flatnonzero(outer & smooth_boundary[head])
    add(head[h], tail[h], boundary_vertex[1:])
    # edge points
    a, b = mesh.edges.T
    rows = V + np.arange(E)
    ends = np.where(mesh.boundary_edge, boundary_edge, edge[:1])
    add(rows, a, ends)
    add(rows, b, ends)
    h = np.flatnonzero(~outer)
    add(V + mesh.corner_edge[h], V + mesh.corner_face[h], edge[1:])
    # face points
    add(V + E + np.arange(F), V + np.arange(F), one)
    rows, columns, values = (np.concatenate(parts) for parts in zip(*entries, strict=True))
    return faces, sparse_operator(rows, columns, values, (V + E + F, V + F))


def limit_operator(mesh: Mesh, rules: Rules, dtype: Any) -> Any:
    """Limit positions of the vertices of an all-quad mesh, (V, V), by limit masks.

    Vertices without a limit (unused, or on the boundary where that is "none") have no entries.
    """
    V = mesh.n_vertices
    tail, head = mesh.indices, mesh.indices[mesh.next_corner]
    across = head[mesh.next_corner]
    sharp = rules.sharp(mesh)
    interior = ~mesh.boundary_vertex & (mesh.vertex_faces > 0)
    rim = mesh.boundary_vertex & ~sharp & (rules.boundary != "none")
    weights = np.zeros((V, 3), dtype=dtype)
    for valence in np.unique(mesh.vertex_faces[interior]).tolist():
        group = interior & (mesh.vertex_faces == valence)
        weights[group] = tables.limit_weights(rules.scheme, valence, dtype)
    weights[rim, :2] = tables.boundary_limit_weights(rules.scheme, dtype)
    weights[sharp, 0] = tables.one(dtype)
    own = np.flatnonzero(interior | rim | sharp)
    inside = np.flatnonzero(interior[tail])
    leaving = np.flatnonzero((mesh.twin < 0) & rim[tail])
    arriving = np.flatnonzero((mesh.twin < 0) & rim[head])
    rows = [own, tail[inside], tail[inside], tail[leaving], head[arriving]]
    columns = [own, head[inside], across[inside], head[leaving], tail[arriving]]
    kind = np.repeat([0, 1, 2, 1, 1], [len(r) for r in rows])
    row = np.concatenate(rows)
    return sparse_operator(row, np.concatenate(columns), weights[row, kind], (V, V))


def tangent_operators(mesh: Mesh, rules: Rules) -> tuple[Any, Any, Array]:
    """Two independent limit tangents of the vertices of an all-quad mesh, by tangent masks.

    Returns two (V, V) operators, to be applied to differences from the vertex itself, whose cross
    product points along the normal, and where they hold, (V,) bool: not at unused vertices,
    interior vertices without a tangent plane (valence 2), and boundary vertices other than of two
    faces or, if sharp, of one.
    """
    V = mesh.n_vertices
    tail, head = mesh.indices, mesh.indices[mesh.next_corner]
    across, before = head[mesh.next_corner], mesh.indices[mesh.previous_corner]
    valence, position = mesh.vertex_faces, mesh.ring_position
    interior = ~mesh.boundary_vertex & (valence > 0)
    known = interior.copy()
    entries: list[list[tuple[Array, Array, Array]]] = [[], []]

    def add(k: int, rows: Array, columns: Array, values: Array | float) -> None:
        entries[k].append((rows, columns, np.broadcast_to(values, rows.shape)))

    for n in np.unique(valence[interior]).tolist():
        table = tables.eigen_table(rules.scheme, n)
        if not table.smooth:
            known &= ~(interior & (valence == n))
            continue
        h = np.flatnonzero(interior[tail] & (valence[tail] == n))
        for k, mask in enumerate(table.tangent_masks):
            add(k, tail[h], head[h], mask[1 + 2 * position[h]])
            add(k, tail[h], across[h], mask[2 + 2 * position[h]])
    # two faces, ring e0 f0 e1 f1 e2 with the boundary through e0 and e2: the B-spline with points
    # reflected at the boundary has derivatives e0 - e2 along it and, across it, inner minus
    # boundary row, each averaged by the limit mask of the boundary curve
    smooth = mesh.boundary_vertex & (valence == 2) & ~rules.sharp(mesh)
    known |= smooth
    own, side = tables.boundary_limit_weights(rules.scheme, float)
    first = np.flatnonzero(smooth[tail] & (position == 0))
    last = np.flatnonzero(smooth[tail] & (position == 1))
    for h, column, sign in ((first, head, 1.0), (last, before, -1.0)):
        add(0, tail[h], column[h], sign)
        add(1, tail[h], column[h], -side)
        add(1, tail[h], across[h], side)
    add(1, tail[last], head[last], own)
    # one face: the two boundary edges
    sharp = rules.sharp(mesh)
    known |= sharp
    h = np.flatnonzero(sharp[tail])
    add(0, tail[h], head[h], 1.0)
    add(1, tail[h], before[h], 1.0)
    operators = []
    for parts in entries:
        rows, columns, values = (np.concatenate(part) for part in zip(*parts, strict=True))
        operators.append(sparse_operator(rows, columns, values, (V, V)))
    return operators[0], operators[1], known


class RefinedMesh(Mesh):
    """A refined mesh that remembers where it came from.

    Attributes
    ----------
    parent_face, parent_u, parent_v : (n_vertices,)
        A limit face of the original mesh and the parameters in it whose limit each vertex
        approaches (float64; exact to 50 levels); -1 and NaN at unused vertices.

    Examples
    --------
    >>> import limitsurf as ls
    >>> fine = ls.refined(ls.Mesh([[0], [8], [8], [0]], [[0, 1, 2, 3]]))
    >>> place = fine.parent_face[8], fine.parent_u[8], fine.parent_v[8]
    >>> [x.item() for x in place], fine.limit_points[8].tolist()
    ([0, 0.5, 0.5], [4.0])
    """

    parent_face: Array
    parent_u: Array
    parent_v: Array
    _rules: Rules

    @cached_property
    def limit_points(self) -> Array:
        """Limit positions of the vertices by limit masks, the shape of `points`.

        Exact rationals if the points are. NaN at vertices without a limit: unused ones, and
        boundary vertices under boundary="none".
        """
        if (self.sizes != 4).any():
            finer = refined(self, **vars(self._rules))
            return np.asarray(finer.limit_points[: self.n_vertices])
        operator = limit_operator(self, self._rules, self.points.dtype)
        points = self.points.reshape(self.n_vertices, -1)
        if points.dtype == object:
            result = operator @ points
        else:
            result = points + _from_own(operator, points)
        result[np.diff(operator.indptr) == 0] = np.nan
        return np.asarray(result.reshape(self.points.shape))

    @cached_property
    def limit_normals(self) -> Array:
        """Unit limit normals by face corner, (n_corners, 3), by tangent masks.

        NaN where no limit normal exists (interior valence 2; degenerate points; faces without a
        limit) and at boundary vertices other than of two faces or, if sharp, of one.

        Raises
        ------
        TypeError
            For points that are not float64 and three-dimensional.
        """
        if self.points.dtype == object or self.points.shape[1:] != (3,):
            raise TypeError(
                "limit normals need points of shape (n, 3) in numbers that have square roots, "
                "float64 (or mpf or sympy ones, where these are supported): "
                f"got {self.points.dtype} {self.points.shape}"
            )
        if (self.sizes != 4).any():
            finer = refined(self, **vars(self._rules))
            # the first corner of child h is corner h
            return np.asarray(finer.limit_normals[::4])
        first, second, known = tangent_operators(self, self._rules)
        along, across = (_from_own(operator, self.points) for operator in (first, second))
        ring = np.zeros((self.n_vertices, 1))
        edge = self.points[self.edges[:, 0]] - self.points[self.edges[:, 1]]
        length = np.abs(edge).max(axis=1, initial=0)[:, None]
        for end in self.edges.T:
            np.maximum.at(ring, end, length)
        noise = 16 * np.finfo(float).eps * ring
        normals = kernels.unit_normals(along, across, (noise, noise))
        normals[~known] = np.nan
        by_corner = normals[self.indices]
        by_corner[self._rules.without_limit(self)[self.corner_face]] = np.nan
        return np.asarray(by_corner)

    def with_points(self, points: ArrayLike) -> Self:
        """A copy with other points, (n_vertices, ...); limits are computed afresh."""
        mesh = super().with_points(points)
        for name in ("limit_points", "limit_normals"):
            mesh.__dict__.pop(name, None)
        return mesh


@overload
def refined(
    mesh: Mesh,
    levels: int = 1,
    *,
    operator: Literal[False] = False,
    scheme: str | Scheme | None = None,
    boundary: str | None = None,
    creasing: str | None = None,
    triangles: str | None = None,
) -> RefinedMesh: ...
@overload
def refined(
    mesh: Mesh,
    levels: int = 1,
    *,
    operator: Literal[True],
    scheme: str | Scheme | None = None,
    boundary: str | None = None,
    creasing: str | None = None,
    triangles: str | None = None,
) -> tuple[RefinedMesh, csr_array[Any] | ExactOperator]: ...
def refined(
    mesh: Mesh,
    levels: int = 1,
    *,
    operator: bool = False,
    scheme: str | Scheme | None = None,
    boundary: str | None = None,
    creasing: str | None = None,
    triangles: str | None = None,
) -> RefinedMesh | tuple[RefinedMesh, csr_array[Any] | ExactOperator]:
    """Refine a mesh recursively by its subdivision rules.

    Parameters
    ----------
    mesh : Mesh
        Points of shape (n_vertices, ...); objects (Fractions) are refined exactly.
    levels : int
        How often, 0 or more. Every level has four times as many faces.
    operator : bool
        Whether to return also R with ``R @ mesh.points == fine.points``, of shape
        (fine.n_vertices, mesh.n_vertices): a ``csr_array``, or an `ExactOperator` if the points
        are objects.
    scheme, boundary, creasing, triangles
        As for `LimitSurface`: the argument, else the mesh's, else the default.

    Returns
    -------
    RefinedMesh or (RefinedMesh, operator)
        Its vertices are the vertex points, then the edge points in the order of ``mesh.edges``,
        then the face points; unused vertices are kept. Its faces are the children of each face in
        the order of its corners, with corner 0 at that corner, corner 1 the midpoint of the edge
        to the next one and corner 2 the face point. Children of holes are holes, and so are those
        of boundary faces under boundary="none"; channels are not refined.
        It also has `parent_face`, `parent_u`, `parent_v`, `limit_points` and `limit_normals`.

    Raises
    ------
    ValueError
        For levels that are not an integer >= 0, or an unknown option.
    NotImplementedError
        For creases, corner tags, and triangles under triangles="smooth".

    Notes
    -----
    Rules: Catmull and Clark 1978; boundaries after DeRose, Kass and Truong 1998. Boundary vertices
    follow the boundary curve, a cubic B-spline; under "edge_and_corner" those of a single face
    stay fixed.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0], [4, 0], [4, 4], [0, 4]], [[0, 1, 2, 3]])
    >>> fine, R = ls.refined(square, operator=True)
    >>> fine.n_faces, R.shape
    (4, (9, 4))
    >>> fine.points[4:].tolist()
    [[2.0, 0.0], [0.0, 2.0], [4.0, 2.0], [2.0, 4.0], [2.0, 2.0]]
    """
    if isinstance(levels, bool) or not isinstance(levels, (int, np.integer)) or levels < 0:
        raise ValueError(f"levels must be an integer >= 0, got {levels!r}")
    rules = Rules.resolve(mesh, scheme, boundary, creasing, triangles)
    dtype = mesh.points.dtype
    points = mesh.points.reshape(mesh.n_vertices, -1)
    if dtype == object:
        points = kernels.exact(points)
    identity = np.arange(mesh.n_vertices)
    one = np.broadcast_to(tables.one(dtype), identity.shape)
    total = sparse_operator(identity, identity, one, (len(identity),) * 2) if operator else None
    coarse, limit_face, uv, holes = mesh, *_cage_parameters(mesh), rules.without_limit(mesh)
    sizes, indices = mesh.sizes, mesh.indices
    for _ in range(levels):
        faces, vertices = refinement_stages(coarse, rules, dtype)
        points = vertices @ np.concatenate([points, faces @ points])
        if operator:
            total = vertices @ stacked([total, faces @ total])
        limit_face, uv = _child_parameters(coarse, limit_face, uv)
        holes = np.repeat(holes, coarse.sizes)
        coarse = child_mesh(coarse, points)
        sizes, indices = coarse.sizes, coarse.indices
    fine = RefinedMesh._from_valid(
        points.reshape(len(points), *mesh.points.shape[1:]),
        sizes,
        indices,
        holes=np.flatnonzero(holes) if levels else mesh.holes,
        scheme=rules.scheme if scheme is not None else mesh.scheme,
        boundary=boundary if boundary is not None else mesh.boundary,
        creasing=creasing if creasing is not None else mesh.creasing,
        triangles=triangles if triangles is not None else mesh.triangles,
    )
    fine._connectivity = coarse._connectivity if levels else mesh._connectivity
    fine._rules = rules
    # the parent of a vertex is taken in its first face, one with a limit if there is any
    order = np.argsort(holes[fine.corner_face], kind="stable")
    vertex, place = np.unique(indices[order], return_index=True)
    fine.parent_face = np.full(len(points), -1)
    fine.parent_u, fine.parent_v = np.full((2, len(points)), np.nan)
    fine.parent_face[vertex] = limit_face[order[place]]
    fine.parent_u[vertex], fine.parent_v[vertex] = uv[order[place]].T
    return (fine, total) if operator else fine


def first_limit_face(mesh: Mesh) -> Array:
    """First limit face of each face and, last, their number, (n_faces + 1,)."""
    return np.concatenate([[0], np.cumsum(np.where(mesh.sizes == 4, 1, mesh.sizes))])


_SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def _cage_parameters(mesh: Mesh) -> tuple[Array, Array]:
    """Limit face (n_corners,) and parameters (n_corners, 2) of every corner of a cage."""
    corner = np.arange(mesh.n_corners) - mesh.offsets[mesh.corner_face]
    quad = mesh.sizes[mesh.corner_face] == 4
    limit_face = first_limit_face(mesh)[mesh.corner_face] + np.where(quad, 0, corner)
    return limit_face, _SQUARE[np.where(quad, corner, 0)]


def _child_parameters(mesh: Mesh, limit_face: Array, uv: Array) -> tuple[Array, Array]:
    """The same for the corners of the children, from those of `mesh`."""
    after, before = mesh.next_corner, mesh.previous_corner
    opposite = after[after]
    children = np.stack(
        [uv, (uv + uv[after]) / 2, (uv + uv[opposite]) / 2, (uv + uv[before]) / 2], axis=1
    )
    children[mesh.sizes[mesh.corner_face] != 4] = _SQUARE
    return np.repeat(limit_face, 4), children.reshape(-1, 2)


def stacked(parts: list[Any]) -> Any:
    """Operators of equal width, one above the other."""
    if len(parts) == 1:
        return parts[0]
    if isinstance(parts[0], ExactOperator):
        heights = np.cumsum([0] + [part.shape[0] for part in parts])
        return ExactOperator(
            np.concatenate([h + x.rows for h, x in zip(heights, parts, strict=False)]),
            np.concatenate([x.columns for x in parts]),
            np.concatenate([x.values for x in parts]),
            (int(heights[-1]), parts[0].shape[1]),
        )
    from scipy.sparse import vstack

    return vstack(parts, format="csr")


def _from_own(operator: Any, points: Array) -> Array:
    """Each row of a square operator applied to differences from the row's own point, (V, d)."""
    result = np.zeros_like(points)
    used = np.diff(operator.indptr) > 0
    every = np.arange(len(points))
    result[used] = kernels.differences(
        operator.indptr[np.concatenate([used, [True]])],
        operator.indices,
        operator.data,
        points,
        every,
        np.zeros_like(points),
        every[used],
    )
    return result
