"""Recursive refinement: mesh and masks to refined mesh and sparse refinement operator."""

from __future__ import annotations

from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, Self, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf import tables
from limitsurf._kernels import reference as kernels
from limitsurf.channels import ChannelMesh
from limitsurf.mesh import Mesh
from limitsurf.rules import PENDING, Rules, Sectors, Sharpness
from limitsurf.topology import MeshPart, child_mesh, first_limit_face

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


def refinement_stages(
    mesh: Mesh, rules: Rules, sharpness: Sharpness, dtype: Any
) -> tuple[Any, Any]:
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
    edge, crease_edge, crease_vertex = tables.rule_weights(rules.scheme, dtype)
    entries: list[tuple[Array, Array, Array]] = []

    def add(rows: Array, columns: Array, weight: Array) -> None:
        entries.append((rows, columns, np.broadcast_to(weight, rows.shape)))

    tail, head = mesh.indices, mesh.indices[mesh.next_corner]
    one = tables.one(dtype)
    # vertex points: shares of the smooth, crease and corner masks; unused vertices stay
    smooth, corner, along = (x.astype(dtype) for x in sharpness.vertex_masks)
    used = mesh.vertex_faces > 0
    smooth_vertices = np.flatnonzero(used & (smooth != 0))
    share = np.where(used, corner, one)
    weights = np.zeros((V, 3), dtype=dtype)
    weights[smooth_vertices] = tables.vertex_weights(
        rules.scheme, mesh.vertex_faces[smooth_vertices], dtype
    )
    weights *= smooth[:, None]
    h = np.flatnonzero((smooth != 0)[tail])
    add(tail[h], head[h], weights[tail[h], 1])
    add(tail[h], V + mesh.corner_face[h], weights[tail[h], 2])
    number, end = sharpness.sharp_ends
    other = mesh.edges[number].sum(axis=1) - end
    on = np.flatnonzero(along != 0)
    add(end[on], other[on], along[on] * crease_vertex[1])
    own = weights[:, 0] + share
    # each of the two ends of a crease brings half of its mask
    np.add.at(own, end[on], along[on] * (crease_vertex[0] / 2))
    rows = np.flatnonzero(own != 0)
    add(rows, rows, own[rows])
    # edge points
    middle = sharpness.edge_masks.astype(dtype)
    contribution = tables.edge_face_weights(rules.scheme, rules.triangles == "smooth", dtype)
    inner = np.flatnonzero((mesh.twin >= 0) & (middle != 1)[mesh.corner_edge])
    triangle = (mesh.sizes != 3).astype(np.int64)[mesh.corner_face]
    towards = contribution[triangle[inner]] / 2 + contribution[triangle[mesh.twin[inner]]] / 2
    rows = V + np.arange(E)
    ends = np.full(E, edge[0], dtype=dtype)
    ends[mesh.corner_edge[inner]] += edge[1] - towards
    ends = (1 - middle) * ends + middle * crease_edge[0]
    towards = towards * (1 - middle[mesh.corner_edge[inner]])
    add(V + mesh.corner_edge[inner], V + mesh.corner_face[inner], towards)
    add(rows, mesh.edges[:, 0], ends)
    add(rows, mesh.edges[:, 1], ends)
    # face points
    add(V + E + np.arange(F), V + np.arange(F), one)
    rows, columns, values = (np.concatenate(parts) for parts in zip(*entries, strict=True))
    return faces, sparse_operator(rows, columns, values, (V + E + F, V + F))


def limit_operators(
    sharpness: Sharpness, rules: Rules, dtype: Any, tangents: bool, wanted: Array | None = None
) -> list[Any]:
    """Limits at the vertices of an all-quad mesh by masks, a row for each fan of its `Sectors`.

    One operator (n_fans, n_vertices) gives limit positions; or, with `tangents`, four give two
    pairs of vectors, from differences from the vertex: the cross product of the first pair points
    along the limit normal, or that of the second if it is 0. A fan without such a limit has no
    entries, nor have others than those `wanted` (n_fans,) bool.
    """
    mesh, sectors = sharpness.mesh, Sectors.of(sharpness)
    if wanted is None:
        wanted = np.ones(len(sectors.kind), dtype=bool)
    n_fans = len(sectors.fans.vertex)
    count = 4 if tangents else 1
    parts: list[list[tuple[Array, Array, Array]]] = [[] for _ in range(count)]
    for kind, faces, fans in sectors.groups(np.flatnonzero(wanted & (sectors.kind >= 0))):
        ring = sectors.ring(kind, faces, fans)
        if tangents:
            masks = tables.normal_masks(rules.scheme, kind, faces).reshape(-1, ring.shape[1])
        else:
            masks = tables.limit_mask(rules.scheme, kind, faces, dtype)[None]
        for part, mask in zip(parts, masks, strict=False):
            used = np.flatnonzero(mask != 0)
            values = np.broadcast_to(mask[used], (len(fans), len(used)))
            part.append((np.repeat(fans, len(used)), ring[:, used].ravel(), values.ravel()))
    # where something is semi-sharp, the limit is that after one more refinement
    pending = np.flatnonzero(wanted & (sectors.kind == PENDING))
    if len(pending):
        corners = np.isin(sectors.fans.fan, pending)
        near = MeshPart.of(mesh, sharpness.neighbours(corners))
        inner = sharpness.part(near)
        faces_stage, stage = refinement_stages(near.mesh, rules, inner, dtype)
        child = child_mesh(near.mesh, np.zeros(stage.shape[0]))
        later = inner.children(child)
        first = np.searchsorted(near.corners, sectors.fans.corners[sectors.fans.offsets[pending]])
        child_fans = Sectors.of(later).fans
        fan = np.full(len(child_fans.vertex), -1)
        fan[child_fans.fan[4 * first]] = pending
        both = stacked([_identity(near.mesh.n_vertices, dtype), faces_stage])
        for part, limit in zip(
            parts, limit_operators(later, rules, dtype, tangents, fan >= 0), strict=True
        ):
            rows, columns, values = entries(limit @ (stage @ both))
            here = fan[rows] >= 0
            part.append((fan[rows[here]], near.vertices[columns[here]], values[here]))
    operators = []
    for part in parts:
        part.append((np.zeros(0, int), np.zeros(0, int), np.zeros(0, dtype=dtype)))
        rows, columns, values = (np.concatenate(x) for x in zip(*part, strict=True))
        operators.append(sparse_operator(rows, columns, values, (n_fans, mesh.n_vertices)))
    return operators


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
    _sharpness: Sharpness
    _channel_meshes: dict[str, ChannelMesh]

    @cached_property
    def limit_points(self) -> Array:
        """Limit positions of the vertices by limit masks, the shape of `points`.

        Exact rationals if the points are. NaN at vertices without a limit: unused ones, and those
        on untagged boundaries under boundary="none".
        """
        if (self.sizes != 4).any():
            finer = refined(self, **vars(self._rules))
            return np.asarray(finer.limit_points[: self.n_vertices])
        dtype = self.points.dtype
        sharpness = Sharpness.of(self, self._rules, dtype)
        (operator,) = limit_operators(sharpness, self._rules, dtype, False)
        vertex = Sectors.of(sharpness).fans.vertex
        points = self.points.reshape(self.n_vertices, -1)
        if dtype == object:
            limits = operator @ points
        else:
            limits = points[vertex] + _from_own(operator, points, vertex)
        result = np.full_like(points, np.nan)
        found = np.diff(operator.indptr) > 0
        result[vertex[found]] = limits[found]
        result[self._rules.loose_vertices(self)] = np.nan
        return np.asarray(result.reshape(self.points.shape))

    @cached_property
    def limit_normals(self) -> Array:
        """Unit limit normals by face corner, (n_corners, 3), by tangent masks.

        At creases the faces on each side have their own. NaN where no limit normal exists: at
        interior vertices and darts of valence 2, boundary and crease vertices with 5 or more faces
        on that side, sharp corners with 3 or more, sharp vertices amid smooth faces; degenerate
        points; faces without a limit. See `LimitSurface.normal`.

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
        sharpness = Sharpness.of(self, self._rules, float)
        fans = Sectors.of(sharpness).fans
        operators = limit_operators(sharpness, self._rules, float, True)
        vectors = [_from_own(operator, self.points, fans.vertex) for operator in operators]
        ring = np.zeros((self.n_vertices, 1))
        edge = self.points[self.edges[:, 0]] - self.points[self.edges[:, 1]]
        length = np.abs(edge).max(axis=1, initial=0)[:, None]
        for end in self.edges.T:
            np.maximum.at(ring, end, length)
        noise = 16 * np.finfo(float).eps * ring[fans.vertex]
        first, second = (
            kernels.unit_normals(vectors[k], vectors[k + 1], (noise, noise)) for k in (0, 2)
        )
        by_corner = np.where(np.isnan(first), second, first)[fans.fan]
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
        of boundary faces under boundary="none". Creases and corners carry their sharpness on, and
        channels are refined with their seams.
        It also has `parent_face`, `parent_u`, `parent_v`, `limit_points` and `limit_normals`.

    Raises
    ------
    ValueError
        For levels that are not an integer >= 0, or an unknown option.

    Notes
    -----
    Rules: Catmull and Clark 1978; boundaries, creases and corners after DeRose, Kass and Truong
    1998. Boundary vertices follow the boundary curve, a cubic B-spline; under "edge_and_corner"
    those of a single face stay fixed. ``exact/creases.py`` has the table of all rules, also of
    non-manifold cages.

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
    total = _identity(mesh.n_vertices, dtype) if operator else None
    coarse, limit_face, uv, holes = mesh, *_cage_parameters(mesh), rules.without_limit(mesh)
    sharpness = Sharpness.of(mesh, rules, dtype)
    for _ in range(levels):
        faces, vertices = refinement_stages(coarse, rules, sharpness, dtype)
        points = vertices @ np.concatenate([points, faces @ points])
        if operator:
            total = vertices @ stacked([total, faces @ total])
        limit_face, uv = _child_parameters(coarse, limit_face, uv)
        holes = np.repeat(holes, coarse.sizes)
        coarse = child_mesh(coarse, points)
        sharpness = sharpness.children(coarse)
    channels = {
        name: _refined_channel(ChannelMesh.of(mesh, name, rules), levels, np.flatnonzero(holes))
        for name in mesh.channels
    }
    indices = coarse.indices
    fine = RefinedMesh._from_valid(
        points.reshape(len(points), *mesh.points.shape[1:]),
        coarse.sizes,
        indices,
        coarse._connectivity,
        **sharpness.tags(),
        holes=np.flatnonzero(holes) if levels else mesh.holes,
        scheme=rules.scheme if scheme is not None else mesh.scheme,
        boundary=boundary if boundary is not None else mesh.boundary,
        creasing=creasing if creasing is not None else mesh.creasing,
        triangles=triangles if triangles is not None else mesh.triangles,
        channels={
            name: (channel.points, channel.indices, mesh.channels[name][2])
            for name, channel in channels.items()
        },
    )
    fine._rules, fine._sharpness, fine._channel_meshes = rules, sharpness, channels
    # the parent of a vertex is taken in its first face, one with a limit if there is any
    order = np.argsort(holes[fine.corner_face], kind="stable")
    vertex, place = np.unique(indices[order], return_index=True)
    fine.parent_face = np.full(len(points), -1)
    fine.parent_u, fine.parent_v = np.full((2, len(points)), np.nan)
    fine.parent_face[vertex] = limit_face[order[place]]
    fine.parent_u[vertex], fine.parent_v[vertex] = uv[order[place]].T
    return (fine, total) if operator else fine


def _refined_channel(channel: ChannelMesh, levels: int, holes: Array) -> ChannelMesh:
    """The values of a channel, refined."""
    dtype = channel.points.dtype
    values = channel.points.reshape(channel.n_vertices, -1)
    if dtype == object:
        values = kernels.exact(values)
    mesh: Mesh = channel
    sharpness = Sharpness.of(channel, channel._rules, dtype)
    for _ in range(levels):
        faces, vertices = refinement_stages(mesh, channel._rules, sharpness, dtype)
        values = vertices @ np.concatenate([values, faces @ values])
        mesh = child_mesh(mesh, values)
        sharpness = sharpness.children(mesh)
    values = values.reshape(len(values), *channel.points.shape[1:])
    return channel.refined(mesh, values, sharpness, holes)


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


def eliminated(total: Any, operator: Any) -> Any:
    """Replace the last columns of `total` by the rows of `operator` that they stand for."""
    n = operator.shape[1]
    if isinstance(total, ExactOperator):
        kept = total.columns < n
        last = ExactOperator(
            total.rows[~kept],
            total.columns[~kept] - n,
            total.values[~kept],
            (total.shape[0], operator.shape[0]),
        )
        more = last @ operator
        return ExactOperator(
            np.concatenate([total.rows[kept], more.rows]),
            np.concatenate([total.columns[kept], more.columns]),
            np.concatenate([total.values[kept], more.values]),
            (total.shape[0], n),
        )
    result = total[:, :n] + total[:, n:] @ operator
    result.sort_indices()
    return result


def entries(operator: Any) -> tuple[Array, Array, Array]:
    """Rows, columns and values of an operator."""
    if isinstance(operator, ExactOperator):
        return operator.rows, operator.columns, operator.values
    found = operator.tocoo()
    return found.row, found.col, found.data


def _identity(n: int, dtype: Any) -> Any:
    every = np.arange(n)
    return sparse_operator(every, every, np.broadcast_to(tables.one(dtype), n), (n, n))


def _from_own(operator: Any, points: Array, own: Array) -> Array:
    """Each row of an operator applied to differences from a point of its own, (rows, d)."""
    result = np.zeros((operator.shape[0], points.shape[1]))
    used = np.diff(operator.indptr) > 0
    rows = operator.indptr[np.concatenate([used, [True]])], operator.indices, operator.data
    result[used] = kernels.differences(*rows, points, np.zeros_like(points), own[used])
    return result
