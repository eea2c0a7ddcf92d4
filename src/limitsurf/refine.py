"""Recursive refinement: mesh and masks to refined mesh and sparse refinement operator."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal, Self, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf import _kernels, memory, numbers, tables
from limitsurf._kernels import reference as kernels
from limitsurf.caching import cached_property
from limitsurf.channels import ChannelMesh
from limitsurf.checks import checked_integer
from limitsurf.mesh import Mesh, read_only
from limitsurf.numbers import NumberType
from limitsurf.rules import PENDING, Rules, Sectors, Sharpness
from limitsurf.topology import (
    MeshPart,
    child_mesh,
    first_limit_face,
    quad_offsets,
    without_points,
)

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from limitsurf.scheme.scheme import Scheme

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
            values, others, unit = _over_common_denominators(self.values, other.values)
            product = ExactOperator(
                self.rows[entry],
                other.columns[place],
                values[entry] * others[place],
                (self.shape[0], other.shape[1]),
            )
            product.values = product.values * unit
            return product
        dense = numbers.RATIONAL.array(other)
        flat = dense.reshape(len(dense), -1)
        result = np.full((self.shape[0], flat.shape[1]), Fraction(0), dtype=object)
        if len(self.rows):
            present, first = np.unique(self.rows, return_index=True)
            values, flat, unit = _over_common_denominators(self.values, flat)
            terms = values[:, None] * flat[self.columns]
            result[present] = np.add.reduceat(terms, first, axis=0) * unit
        return result.reshape(self.shape[0], *dense.shape[1:])

    def toarray(self) -> Array:
        """The matrix as a dense object array."""
        dense = np.full(self.shape, Fraction(0), dtype=object)
        dense[self.rows, self.columns] = self.values
        return dense

    def __repr__(self) -> str:
        return f"<ExactOperator of shape {self.shape} with {len(self.rows)} entries>"


def _over_common_denominators(a: Array, b: Array) -> tuple[Array, Array, Fraction | int]:
    """Integers and the unit of their products, where Fractions allow short ones; else a, b and 1.

    Sums of products are then reduced once, not term by term.
    """
    unit, scaled = Fraction(1), []
    for values in (a, b):
        if not all(type(x) is Fraction for x in values.flat):
            return a, b, 1
        D = 1
        for x in {x.denominator for x in values.flat}:
            D = math.lcm(D, x)
            if D.bit_length() > 1000:
                return a, b, 1
        integers = (x.numerator * (D // x.denominator) for x in values.flat)
        scaled.append(np.fromiter(integers, object, values.size).reshape(values.shape))
        unit /= D
    return scaled[0], scaled[1], unit


def sparse_operator(rows: Array, columns: Array, values: Array, shape: tuple[int, int]) -> Any:
    """``csr_array`` for float64 values, `ExactOperator` for objects; duplicates are summed."""
    if numbers.type_of(values).exact:
        return ExactOperator(rows, columns, values, shape)
    from scipy.sparse import coo_array

    return coo_array((values, (rows, columns)), shape=shape).tocsr()


def refinement_stages(
    mesh: Mesh, rules: Rules, sharpness: Sharpness, number: NumberType, compiled: bool | None = None
) -> tuple[Any, Any]:
    """One level of refinement as two sparse operators.

    The first gives the face points from the vertices, (F, V); the second the refined points from
    vertices and face points, (V + E + F, V + F). A face of n corners costs n entries in each; in
    their product it would cost n^2.
    """
    V, E, F = mesh.n_vertices, mesh.n_edges, mesh.n_faces
    dtype, one, zero = number.dtype, number.one, number.zero
    edge, crease_edge, crease_vertex = tables.rule_weights(rules.scheme, number)
    # vertex points: shares of the smooth, crease and corner masks; unused vertices stay
    smooth, share = number.full(V, one), number.full(V, zero)
    masks = (x.astype(dtype) for x in sharpness.vertex_masks)
    smooth[sharpness.concerned], share[sharpness.concerned], along = masks
    unused = mesh.vertex_faces == 0
    smooth[unused], share[unused] = zero, one
    rough = np.flatnonzero(smooth == 0)
    weights = _vertex_weights(mesh, rules, rough, number)[mesh.vertex_faces]
    weights *= smooth[:, None]
    end, other = sharpness.sharp_ends
    on = np.flatnonzero(along != 0)
    end, other, along = end[on], other[on], along[on]
    # each of the two ends of a crease brings half of its mask
    np.add.at(share, end, along * (crease_vertex[0] / 2))
    # edge points
    middle = np.zeros(E, dtype=dtype)
    middle[mesh.corner_edge[sharpness.sharp_edges]] = sharpness.edge_masks.astype(dtype)
    towards = np.zeros(E, dtype=dtype)
    inner = np.flatnonzero((mesh.edge_corners[:, 1] >= 0) & (middle != 1))
    contribution = tables.edge_face_weights(rules.scheme, rules.triangles == "smooth", number)
    if (contribution == contribution[1]).all():
        towards[inner] = contribution[1]
    else:
        both = mesh.corner_face[mesh.edge_corners[inner]]
        towards[inner] = contribution[(mesh.sizes != 3).astype(int)[both]].sum(axis=1) / 2
    ends = np.full(E, edge[0], dtype=dtype)
    ends[inner] += edge[1] - towards[inner]
    ends = (1 - middle) * ends + middle * crease_edge[0]
    towards *= 1 - middle
    # rows in which no column is met twice
    own = weights[:, 0] + share
    rows = np.flatnonzero(own != 0)
    every = np.arange(max(E, F))
    parts = [
        (rows, rows, own[rows]),
        (V + every[:E], mesh.edges[:, 0], ends),
        (V + every[:E], mesh.edges[:, 1], ends),
        (V + E + every[:F], V + every[:F], number.full(F, one)),
    ]
    while len(end):
        found, here = np.unique(end, return_index=True)
        parts.append((found, other[here], along[here] * crease_vertex[1]))
        end, other, along = (np.delete(x, here) for x in (end, other, along))
    corner_weights = _corner_weights(mesh, rules, number)
    shapes = (F, V), (V + E + F, V + F)
    if compiled is None:
        compiled = not number.exact and mesh._large
    if not compiled:
        tail, head = mesh.indices, mesh.indices[mesh.next_corner]
        h = np.flatnonzero((smooth != 0)[tail])
        parts.append((tail[h], head[h], weights[tail[h], 1]))
        parts.append((tail[h], V + mesh.corner_face[h], weights[tail[h], 2]))
        h = np.flatnonzero((towards != 0)[mesh.corner_edge])
        parts.append(
            (V + mesh.corner_edge[h], V + mesh.corner_face[h], towards[mesh.corner_edge[h]])
        )
        rows, columns, values = (np.concatenate(x) for x in zip(*parts, strict=True))
        faces = sparse_operator(mesh.corner_face, mesh.indices, corner_weights, shapes[0])
        return faces, sparse_operator(rows, columns, values, shapes[1])
    from limitsurf._kernels import refinement

    counts = np.zeros(V + E + F, dtype=np.int64)
    counts[:V] = 2 * mesh.vertex_faces * (weights[:, 1:] != 0).any(axis=1)
    counts[V : V + E] = 2 * (towards != 0)
    for rows, _, _ in parts:
        counts[rows] += 1
    starts = np.concatenate([[0], np.cumsum(counts)])
    columns, values = np.empty(starts[-1], np.int32), np.empty(starts[-1])
    place = starts[:-1].copy()
    for rows, column, value in parts:
        at = place[rows]
        columns[at], values[at] = column, value
        place[rows] += 1
    refinement.operator_rows(
        mesh.indices,
        quad_offsets(mesh),
        mesh.corner_edge,
        weights,
        towards,
        place,
        columns,
        values,
    )
    stage = _csr(starts, columns, values, shapes[1])
    if mesh._repeats or (smooth[sharpness.sharp_ends[0][on]] != 0).any():
        # an edge neighbour may be met twice
        stage.sum_duplicates()
    return _csr(mesh.offsets, mesh.indices, corner_weights, shapes[0]), stage


def _csr(starts: Array, columns: Array, values: Array, shape: tuple[int, int]) -> csr_array[Any]:
    """A sparse matrix by its rows, with indices of 32 bits if these suffice."""
    from scipy.sparse import csr_array

    short = np.int32 if max(starts[-1], *shape) < 2**31 else np.int64
    return csr_array((values, columns.astype(short, copy=False), starts.astype(short)), shape=shape)


def _corner_weights(mesh: Mesh, rules: Rules, number: NumberType) -> Array:
    """Weight of every face corner in its face point, (n_corners,)."""
    if mesh._steps[0] == 4:
        return np.tile(tables.corner_weights(rules.scheme, np.array([4]), number), mesh.n_faces)
    return tables.corner_weights(rules.scheme, mesh.sizes, number)


def _vertex_weights(mesh: Mesh, rules: Rules, rough: Array, number: NumberType) -> Array:
    """Smooth masks by number of faces at a vertex, (largest + 1, 3); 0 where all are `rough`."""
    most, valences = _smooth_valences(mesh, rough)
    table = np.zeros((most + 1, 3), dtype=number.dtype)
    table[valences] = tables.vertex_weights(rules.scheme, np.array(valences, dtype=int), number)
    return table


def multiplied(one: Any, other: Any, compiled: bool) -> Any:
    """The product of two operators; columns of sparse matrices ascend."""
    if not compiled:
        result = one @ other
        if not isinstance(result, ExactOperator):
            result.sort_indices()
        return result
    from limitsurf._kernels import refinement

    # room for as many entries as there are products; memory beyond what remains is never touched
    most = int(np.diff(other.indptr)[one.indices].sum(dtype=np.int64))
    columns, values = np.empty(most, other.indices.dtype), np.empty(most)
    starts = np.empty(one.shape[0] + 1, np.int64)
    seen, total = np.full(other.shape[1], -1), np.empty(other.shape[1])
    refinement.product(
        *(one.indptr, one.indices, one.data, other.indptr, other.indices, other.data),
        *(seen, total, starts, columns, values),
    )
    columns, values = columns[: starts[-1]], values[: starts[-1]]
    result = _csr(starts, columns, values, (one.shape[0], other.shape[1]))
    result.has_sorted_indices = result.has_canonical_format = True
    return result


def refined_values(
    mesh: Mesh, rules: Rules, sharpness: Sharpness, values: Array, compiled: bool
) -> Array:
    """One level of refinement of values at the vertices, (n_vertices, d)."""
    if not compiled:
        faces, vertices = refinement_stages(mesh, rules, sharpness, numbers.type_of(values), False)
        return np.asarray(vertices @ np.concatenate([values, faces @ values]))
    from limitsurf._kernels import refinement

    smooth, _, along = (x.astype(float, copy=False) for x in sharpness.vertex_masks)
    middle = sharpness.edge_masks.astype(float, copy=False)
    _, crease_edge, crease_vertex = tables.rule_weights(rules.scheme, numbers.FLOAT64)
    offsets = quad_offsets(mesh)
    result = np.empty((mesh.n_vertices + mesh.n_edges + mesh.n_faces, values.shape[1]))
    known = (
        read_only(values),
        mesh.indices,
        offsets,
        mesh.corner_face if len(offsets) else offsets,
        mesh.twin,
        mesh.corner_edge,
        mesh.vertex_faces,
        mesh.n_edges,
        _smooth_masks(mesh, rules, sharpness.concerned[smooth == 0]),
    )
    for first, channels in _channels(values.shape[1]):
        refinement.refined_points(*known, first, channels, result)
    # what is sharp moves less towards the smooth point, and along creases
    place, (end, other) = sharpness.concerned, sharpness.sharp_ends
    result[place] = values[place] + smooth[:, None] * (result[place] - values[place])
    on = np.flatnonzero(along)
    step = (along[on] * crease_vertex[1])[:, None] * (values[other[on]] - values[end[on]])
    np.add.at(result, end[on], step)
    # the points of edges without a twin are midpoints
    side = sharpness.sharp_edges
    inner = np.flatnonzero(mesh.twin[side] >= 0)
    edge, share = mesh.n_vertices + mesh.corner_edge[side[inner]], middle[inner, None]
    ends = crease_edge * (values[end[inner]] + values[other[inner]])
    result[edge] = share * ends + (1 - share) * result[edge]
    return result


def _channels(count: int) -> Iterator[tuple[int, tuple[int, ...]]]:
    """The first of each three channels, and three numbers, then of each that is left, and one."""
    first = 0
    while first < count:
        channels = (0, 0, 0) if count - first >= 3 else (0,)
        yield first, channels
        first += len(channels)


def _smooth_masks(mesh: Mesh, rules: Rules, rough: Array) -> tuple[Array, Array, Array, Array]:
    """The masks that the kernel `refined_points` needs, but for those of `rough` vertices."""
    sizes = [4] if mesh._steps[0] == 4 else np.flatnonzero(np.bincount(mesh.sizes)).tolist()
    most, valences = _smooth_valences(mesh, rough)
    return _rounded_masks(rules, tuple(sizes), most, tuple(valences))


@lru_cache(maxsize=64)
def _rounded_masks(
    rules: Rules, sizes: tuple[int, ...], most: int, valences: tuple[int, ...]
) -> tuple[Array, Array, Array, Array]:
    """Masks in float64 of faces of some sizes, and of vertices of some numbers of faces."""
    number, corners = numbers.FLOAT64, np.array(sizes)
    start = np.zeros(corners[-1] + 1, dtype=np.int64)
    start[corners] = np.cumsum(corners) - corners
    weights = np.zeros((most + 1, 2))
    faces = np.array(valences, dtype=int)
    weights[faces] = tables.vertex_weights(rules.scheme, faces, number)[:, 1:]
    contribution = tables.edge_face_weights(rules.scheme, rules.triangles == "smooth", number)
    masks = start, tables.corner_weights(rules.scheme, corners, number), weights, contribution
    return read_only(masks)


def _limit_points(sharpness: Sharpness, rules: Rules, points: Array, wanted: Array) -> Array:
    """Limits of the `wanted` (n_vertices,) bool vertices of an all-quad mesh, NaN elsewhere."""
    sectors = Sectors.of(sharpness)
    vertex = sectors.fans.vertex
    result = np.full_like(points, np.nan)
    for kind, faces, fans in sectors.groups(np.flatnonzero(wanted[vertex] & (sectors.kind >= 0))):
        own = points[vertex[fans]]
        step = np.zeros_like(own)
        mask = tables.limit_mask(rules.scheme, kind, faces, sharpness.number)
        if tables.Sector(kind, faces).carried:  # the last point is the middle of two
            mask = np.append(mask[:-1], [mask[-1] / 2] * 2)
        ring = sectors.ring(kind, faces, fans)[:, 1:]
        if faces > tables.MOST_FACES:
            step = (mask[1:, None] * (points[ring] - own[:, None])).sum(axis=1)
        else:
            for weight, beside in zip(mask[1:], ring.T, strict=True):
                step = step + weight * (points[beside] - own)
        result[vertex[fans]] = own + step
    # where something is semi-sharp, the limit is that after one more refinement
    pending = np.zeros(len(wanted), dtype=bool)
    pending[vertex[sectors.kind == PENDING]] = True
    pending &= wanted
    if pending.any():
        near = MeshPart.of(sharpness.mesh, sharpness.neighbours(pending[sharpness.mesh.indices]))
        inner = sharpness.part(near)
        compiled = not numbers.type_of(points).exact and near.mesh._large
        finer = refined_values(near.mesh, rules, inner, points[near.vertices], compiled)
        later = np.zeros(len(finer), dtype=bool)
        later[: near.mesh.n_vertices] = pending[near.vertices]
        inner = inner.children(child_mesh(near.mesh, finer))
        limits = _limit_points(inner, rules, finer, later)
        result[pending] = limits[later]
    return result


def _normal_operators(
    sharpness: Sharpness, rules: Rules, wanted: Array, masks: Callable[[Scheme, str, int], Array]
) -> list[Any]:
    """Operators (n_fans, n_vertices) on differences from the vertex of an all-quad mesh.

    They give pairs of vectors for each fan of the `Sectors`, two if `masks` are those of
    `tables.normal_masks`, and four of `tables.collapsed_masks`. A fan without a normal has no
    entries, nor have others than those `wanted` (n_fans,) bool.
    """
    mesh, sectors = sharpness.mesh, Sectors.of(sharpness)
    parts: list[list[tuple[Array, Array, Array]]] = [[] for _ in range(8)]
    for kind, faces, fans in sectors.groups(np.flatnonzero(wanted & (sectors.kind >= 0))):
        ring = sectors.ring(kind, faces, fans)
        rows = masks(rules.scheme, kind, faces)
        for part, mask in zip(parts, rows.reshape(-1, rows.shape[2]), strict=False):
            used = np.flatnonzero(mask != 0)
            values = np.broadcast_to(mask[used], (len(fans), len(used)))
            part.append((np.repeat(fans, len(used)), ring[:, used].ravel(), values.ravel()))
    # where something is semi-sharp, the limit is that after one more refinement
    pending = np.flatnonzero(wanted & (sectors.kind == PENDING))
    if len(pending):
        near = MeshPart.of(mesh, sharpness.neighbours(np.isin(sectors.fans.fan, pending)))
        inner = sharpness.part(near)
        faces_stage, stage = refinement_stages(near.mesh, rules, inner, numbers.FLOAT64)
        child = child_mesh(near.mesh, np.zeros(stage.shape[0]))
        later = inner.children(child)
        first = np.searchsorted(near.corners, sectors.fans.corners[sectors.fans.offsets[pending]])
        child_fans = Sectors.of(later).fans
        fan = np.full(len(child_fans.vertex), -1)
        fan[child_fans.fan[4 * first]] = pending
        both = stacked([_identity(near.mesh.n_vertices, numbers.FLOAT64), faces_stage])
        limits = _normal_operators(later, rules, fan >= 0, masks)
        for part, finer in zip(parts, limits, strict=True):
            rows, columns, values = entries((finer @ stage) @ both)
            part.append((fan[rows], near.vertices[columns], values))
    operators = []
    for part in parts:
        part.append((np.zeros(0, int), np.zeros(0, int), np.zeros(0)))
        rows, columns, values = (np.concatenate(x) for x in zip(*part, strict=True))
        operators.append(sparse_operator(rows, columns, values, (len(wanted), mesh.n_vertices)))
    return operators


def _limit_normals(
    sharpness: Sharpness, rules: Rules, points: Array, errors: Array, wanted: Array
) -> Array:
    """Limit normals by corner, (n_corners, 3), at the `wanted` vertices of an all-quad mesh.

    `errors` (n_vertices,) bound those of the points, in units of `NOISE`.
    """
    fans = Sectors.of(sharpness).fans

    def vectors(wanted: Array, masks: Callable[[Scheme, str, int], Array]) -> list[Array]:
        found = []
        for operator in _normal_operators(sharpness, rules, wanted, masks):
            vector, size, error = _from_own(operator, points, errors, fans.vertex)
            found += [vector, kernels.NOISE * (size + error), kernels.NOISE * error]
        return found

    def crossed(found: list[Array], k: int) -> Array:
        (a, noise, _), (b, other, _) = (found[3 * j : 3 * j + 3] for j in (2 * k, 2 * k + 1))
        return kernels.unit_normals(a, b, (noise, other))

    wanted = wanted[fans.vertex]
    found = vectors(wanted, tables.normal_masks)
    # the second where the first pair is dependent
    result = crossed(found, 0)
    result = np.where(np.isnan(result), crossed(found, 1), result)
    lost = wanted & np.isnan(result[:, 0])
    if lost.any():
        found = vectors(lost, tables.collapsed_masks)
        first, second = ((np.abs(found[j]) <= found[j + 2]).all(axis=1) for j in (18, 21))
        cases = first & second, first & ~second, second & ~first
        for k, case in enumerate(cases):
            result = np.where((lost & case)[:, None], crossed(found, k), result)
    return np.asarray(result[fans.fan])


def _smooth_valences(mesh: Mesh, rough: Array) -> tuple[int, list[int]]:
    """The most faces at a vertex; the numbers of faces at any but the `rough` vertices."""
    faces = np.bincount(mesh.vertex_faces)
    most = len(faces) - 1
    faces -= np.bincount(mesh.vertex_faces[rough], minlength=len(faces))
    return most, (1 + np.flatnonzero(faces[1:])).tolist()


def _ring_weights(mesh: Mesh, rules: Rules, rough: Array) -> Array:
    """Weights of each edge neighbour and face corner in a limit, by number of faces at a vertex."""
    most, valences = _smooth_valences(mesh, rough)
    weights = np.zeros((most + 1, 2))
    for N in valences:
        weights[N] = tables.limit_mask(rules.scheme, "interior", N, numbers.FLOAT64)[1:3]
    return read_only(weights)


def _normal_weights(mesh: Mesh, rules: Rules, rough: Array) -> tuple[Array, Array, Array]:
    """Number of faces at a vertex, where its masks begin, -1 for none, and all masks."""
    most, valences = _smooth_valences(mesh, rough)
    start, masks = np.full(most + 1, -1), [np.zeros(0)]
    for N in valences:
        found = tables.normal_masks(rules.scheme, "interior", N)[:1].ravel()
        if len(found):
            start[N] = sum(map(len, masks))
            masks.append(found)
    return read_only((mesh.vertex_faces, start, np.concatenate(masks)))


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

    _rules: Rules
    _sharpness: Sharpness
    _channel_meshes: dict[str, ChannelMesh]
    _lineage: tuple[Mesh, ...]  # from the cage to this mesh, without points
    _rounded: bool  # whether the points come from refinement, and not from outside

    @cached_property
    def _parents(self) -> tuple[Array, Array, Array]:
        """Parent face and parameters, taken in a vertex's first face, one with a limit if any."""
        limit_face, uv = _cage_parameters(self._lineage[0])
        for mesh in self._lineage[:-1]:
            limit_face, uv = _child_parameters(mesh, limit_face, uv)
        face = np.full(self.n_vertices, -1)
        u, v = np.full((2, self.n_vertices), np.nan)
        without = self._rules.without_limit(self)[self.corner_face]
        # the last to be written stays
        for corners in (np.flatnonzero(without)[::-1], np.flatnonzero(~without)[::-1]):
            vertex = self.indices[corners]
            face[vertex] = limit_face[corners]
            u[vertex], v[vertex] = uv[corners].T
        return read_only((face, u, v))

    @property
    def parent_face(self) -> Array:
        """Limit face of the original mesh that each vertex is on."""
        return self._parents[0]

    @property
    def parent_u(self) -> Array:
        """First parameter of each vertex in its limit face."""
        return self._parents[1]

    @property
    def parent_v(self) -> Array:
        """Second parameter of each vertex in its limit face."""
        return self._parents[2]

    def __getstate__(self) -> dict[str, Any]:
        _ = self._parents
        return {name: x for name, x in super().__getstate__().items() if name != "_lineage"}

    @cached_property
    def limit_points(self) -> Array:
        """Limit positions of the vertices by limit masks, the shape of `points`.

        Exact rationals if the points are. NaN at vertices without a limit: unused ones, and those
        on untagged boundaries under boundary="none".
        """
        if self._steps[0] != 4:
            finer = refined(self, **vars(self._rules))
            return np.asarray(finer.limit_points[: self.n_vertices])
        points, balance = _balanced(self.points.reshape(self.n_vertices, -1))
        rules = self._rules
        sharpness = Sharpness.of(self, rules, numbers.type_of(points))
        if sharpness.number.exact or not self._large:
            result = _limit_points(sharpness, rules, points, self.vertex_faces > 0)
        else:
            from limitsurf._kernels import refinement

            result = np.empty_like(points)
            masks = _ring_weights(self, rules, sharpness.concerned)
            for first, channels in _channels(points.shape[1]):
                known = points, self.indices, self.vertex_faces, masks
                refinement.limit_points(*known, first, channels, result)
            result[self.vertex_faces == 0] = np.nan
            rough = sharpness.sharp_vertices
            if rough.any():
                near = MeshPart.of(self, rough[self.indices])
                inner, own = sharpness.part(near), rough[near.vertices]
                limits = _limit_points(inner, rules, points[near.vertices], own)
                result[near.vertices[own]] = limits[own]
        result[rules.loose_vertices(self)] = np.nan
        if balance:
            result = np.ldexp(result, -balance)
        return np.asarray(result.reshape(self.points.shape))

    @cached_property
    def limit_normals(self) -> Array:
        """Unit limit normals by face corner, (n_corners, 3), by tangent masks.

        At creases the faces on each side have their own. NaN where no limit normal exists: at
        interior vertices and darts of valence 2, boundary and crease vertices with 5 or more faces
        on that side, sharp corners with 3 or more, sharp vertices amid smooth faces, faces at a
        crease that does not bound them; where vectors might be dependent within their rounding
        errors, those of refined points included; faces without a limit. Where the points of
        boundaries and creases coincide they are limits all the same. See `LimitSurface.normal`.

        Raises
        ------
        TypeError
            For points that are not float64 and three-dimensional.
        """
        if numbers.type_of(self.points).exact or self.points.shape[1:] != (3,):
            raise TypeError(
                "limit normals need points of shape (n, 3) in numbers that have square roots, "
                f"float64: got {self.points.dtype} {self.points.shape}"
            )
        if self._steps[0] != 4:
            finer = refined(self, **vars(self._rules))
            # the first corner of child h is corner h
            return np.asarray(finer.limit_normals[::4])
        rules, sharpness = self._rules, Sharpness.of(self, self._rules, numbers.FLOAT64)
        points = np.ldexp(self.points, kernels.balance(self.points))
        # what refinement rounded; a cage is exact
        errors = np.abs(points).max(axis=1) * self._rounded
        if not self._large:
            result = _limit_normals(sharpness, rules, points, errors, self.vertex_faces > 0)
        else:
            from limitsurf._kernels import refinement

            by_vertex, seen = np.empty((self.n_vertices, 3)), sharpness.sharp_vertices
            masks = _normal_weights(self, rules, sharpness.concerned)
            known = points, errors, self.indices, self.twin
            refinement.limit_normals(*known, *masks, seen, by_vertex)
            result = by_vertex.take(self.indices, axis=0)
            # sharp ones, and those for which the first pair of vectors will not do
            rough = sharpness.sharp_vertices
            rough[np.isnan(by_vertex[:, 0]) & (self.vertex_faces > 0)] = True
            if rough.any():
                near = MeshPart.of(self, rough[self.indices])
                inner, own = sharpness.part(near), rough[near.vertices]
                around = points[near.vertices], errors[near.vertices]
                normals = _limit_normals(inner, rules, *around, own)
                own = own[near.mesh.indices]
                result[near.corners[own]] = normals[own]
        result.reshape(-1, 4, 3)[rules.without_limit(self)] = np.nan
        return np.asarray(result)

    def with_points(self, points: ArrayLike) -> Self:
        """A copy with other points, (n_vertices, ...); limits are computed afresh."""
        mesh = super().with_points(points)
        for name in ("limit_points", "limit_normals"):
            mesh.__dict__.pop(name, None)
        mesh._rounded = False
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
    MemoryError
        At once, for more faces than there is memory for; it says how many levels fit.

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
    levels = checked_integer("levels", levels, 0)
    refuse_levels(mesh, levels, operator)
    rules = Rules.resolve(mesh, scheme, boundary, creasing, triangles)
    number = numbers.type_of(mesh.points)
    points, balance = _balanced(mesh.points.reshape(mesh.n_vertices, -1))
    total = _identity(mesh.n_vertices, number) if operator else None
    # decided once, so that equal calls have equal results, to the last digit
    compiled = not number.exact and _kernels.compiled(mesh.n_corners * 4 ** (levels - 1))
    coarse, holes = mesh, np.flatnonzero(rules.without_limit(mesh))
    first = sharpness = Sharpness.of(mesh, rules, number)
    lineage = []
    for _ in range(levels):
        if operator:
            faces, vertices = refinement_stages(coarse, rules, sharpness, number, compiled)
            both = stacked([total, multiplied(faces, total, compiled)])
            total = multiplied(vertices, both, compiled)
        points = refined_values(coarse, rules, sharpness, points, compiled)
        holes = _corners(coarse, holes)
        lineage.append(without_points(coarse))
        coarse = child_mesh(coarse, points)
        sharpness = sharpness.children(coarse)
    if balance:
        points = np.ldexp(points, -balance)
    channels = {
        name: _refined_channel(ChannelMesh.of(mesh, name, rules, first), levels, holes)
        for name in mesh.channels
    }
    fine = RefinedMesh._from_valid(
        points.reshape(len(points), *mesh.points.shape[1:]),
        coarse.sizes,
        coarse.indices,
        coarse._connectivity,
        scheme=scheme if scheme is not None else mesh.scheme,
        boundary=boundary if boundary is not None else mesh.boundary,
        creasing=creasing if creasing is not None else mesh.creasing,
        triangles=triangles if triangles is not None else mesh.triangles,
        units=mesh.units,
        up=mesh.up,
    )
    # valid as they are made: no edge is looked for
    tags: dict[str, Any] = {**sharpness.tags()}
    tags["holes"] = holes if levels else mesh.holes
    tags["_channels"] = {
        name: (channel.points, channel.indices, mesh.channels[name][2])
        for name, channel in channels.items()
    }
    vars(fine).update(read_only(tags))
    fine._rules, fine._sharpness, fine._channel_meshes = rules, sharpness, channels
    fine._lineage = *lineage, without_points(coarse)
    fine._rounded = levels > 0 or getattr(mesh, "_rounded", False)
    return (fine, total) if operator else fine


def _balanced(points: Array) -> tuple[Array, int]:
    """Points times a power of two, where their sums might overflow, and its exponent; or exact."""
    if numbers.type_of(points).exact:
        return numbers.RATIONAL.array(points), 0
    balance = kernels.balance(points)
    return (np.ldexp(points, balance) if balance else points), balance


def refuse_levels(mesh: Mesh, levels: int, operator: bool = False) -> None:
    """Refuse, by a MemoryError, so many refinements if there is no room for their faces.

    What a face takes is the least that has been measured: a vertex, four corners with their
    neighbours, and with an operator some 16 entries twice.
    """
    columns = max(math.prod(mesh.points.shape[1:]), 1)
    each = 100 + (100 if numbers.type_of(mesh.points).exact else 8) * columns
    each += 32 * len(mesh.channels) + 400 * operator
    fit = memory.available() / (each * mesh.n_corners)
    most = 0 if fit < 1 else int(math.log(fit, 4)) + 1 if math.isfinite(fit) else levels
    advice = f"up to {most} levels fit" if most else "no level fits"
    faces = mesh.n_corners * 4 ** max(min(levels, 400) - 1, 0)  # more than any machine holds
    if levels:
        memory.refuse_beyond(faces, each, f"faces of {levels} levels", advice)


def _corners(mesh: Mesh, faces: Array) -> Array:
    """All corners of some faces."""
    if not len(faces):
        return faces
    sizes = mesh.sizes[faces]
    place = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    return np.asarray(np.repeat(mesh.offsets[faces], sizes) + place)


def _refined_channel(channel: ChannelMesh, levels: int, holes: Array) -> ChannelMesh:
    """The values of a channel, refined."""
    number = numbers.type_of(channel.points)
    values, balance = _balanced(channel.points.reshape(channel.n_vertices, -1))
    mesh: Mesh = channel
    sharpness = Sharpness.of(channel, channel._rules, number)
    compiled = not number.exact and _kernels.compiled(mesh.n_corners * 4 ** (levels - 1))
    coarser = None
    for _ in range(levels):
        sharpness = sharpness if coarser is None else coarser.children(mesh)
        values = refined_values(mesh, channel._rules, sharpness, values, compiled)
        mesh, coarser = child_mesh(mesh, values), sharpness
    if balance:
        values = np.ldexp(values, -balance)
    values = values.reshape(len(values), *channel.points.shape[1:])
    return channel.refined(mesh, values, sharpness, coarser is not None, holes)


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


def _identity(n: int, number: NumberType) -> Any:
    every = np.arange(n)
    return sparse_operator(every, every, number.full(n, number.one), (n, n))


def _from_own(
    operator: Any, points: Array, errors: Array, own: Array
) -> tuple[Array, Array, Array]:
    """Each row of an operator applied to differences from a point of its own, (rows, d).

    Also the size of what is added up, and what errors of the points do to it, both (rows, 1).
    """
    result = np.zeros((operator.shape[0], points.shape[1] + 2))
    used = np.diff(operator.indptr) > 0
    starts, columns = operator.indptr[np.concatenate([used, [True]])], operator.indices
    rows = starts, columns, operator.data
    result[used, :-2] = kernels.differences(*rows, points, np.zeros_like(points), own[used])
    if len(columns):
        near, weights = np.repeat(own[used], np.diff(starts)), np.abs(operator.data)
        sizes = np.abs(points[columns] - points[near]).max(axis=1, initial=0)
        for k, terms in ((-2, sizes), (-1, errors[columns] + errors[near])):
            result[used, k] = np.add.reduceat(weights * terms, starts[:-1])
    return result[:, :-2], result[:, -2:-1], result[:, -1:]
