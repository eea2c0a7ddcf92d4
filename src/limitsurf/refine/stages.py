"""One level of refinement: from masks to operators, or to values at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf import _kernels, numbers, tables
from limitsurf.cage.connectivity import read_only
from limitsurf.cage.mesh import Mesh, kept
from limitsurf.numbers import NumberType
from limitsurf.refine import interpolating
from limitsurf.refine.operators import SparseRows, channel_groups, csr, sparse_operator
from limitsurf.rules import DART, Rules, Sharpness
from limitsurf.topology import child_vertices, vertex_numbers

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Array = NDArray[Any]
_Sharp: TypeAlias = tuple[Array, Array, Array, Array, Array]


def refinement_stages(
    mesh: Mesh, rules: Rules, sharpness: Sharpness, number: NumberType, compiled: bool | None = None
) -> tuple[Any, Any]:
    """One level of refinement as two sparse operators.

    See `stage_rows`.
    """
    stages = stage_rows(mesh, rules, sharpness, number, compiled)
    faces, stage = (csr(*x) if isinstance(x, SparseRows) else x for x in stages)
    return faces, stage


def stage_rows(
    mesh: Mesh, rules: Rules, sharpness: Sharpness, number: NumberType, compiled: bool | None = None
) -> tuple[Any, Any]:
    """One level of refinement as two sparse operators, or the `SparseRows` of such.

    The first gives the face points from the vertices, (F, V); the second the refined points from
    vertices and face points, (V + E + F, V + F). A face of n corners costs n entries in each; in
    their product it would cost n^2. Where faces have no points F is 0.
    """
    if not rules.scheme.has_pieces:
        nothing = np.zeros(0, dtype=np.int64)
        none = sparse_operator(nothing, nothing, number.full(0, number.zero), (0, mesh.n_vertices))
        return none, interpolating.stage(mesh, rules, number)
    V, centres = mesh.n_vertices, rules.scheme.lattice.face_points
    F = mesh.n_faces * centres
    vertices = _VertexMasks.of(mesh, rules, sharpness, number)
    edges = _EdgeMasks.of(mesh, rules, sharpness, number)
    parts = _single_entries(mesh, vertices, edges, F, number)
    corner_weights = _corner_weights(mesh, rules, number)
    shapes = (F, V), (V + mesh.n_edges + F, V + F)
    if compiled is None:
        compiled = not number.exact and _kernels.compiled(mesh.n_corners, 5)
    if compiled and centres:
        faces = SparseRows(mesh.offsets, mesh.indices, corner_weights, shapes[0])
        return faces, _compiled_stage(mesh, vertices, edges, parts)
    # by corner: the edge neighbours and the face points around vertices, what is across edges
    tail, head = mesh.indices, mesh.indices[mesh.next_corner]
    across = V + mesh.corner_face if centres else mesh.indices[mesh.previous_corner]
    around = zip((head, across), vertices.weights[:, 1:].T, strict=False)
    for what, weights in around:
        h = np.flatnonzero((weights != 0)[tail])
        parts.append((tail[h], what[h], weights[tail[h]]))
    h = np.flatnonzero((edges.towards != 0)[mesh.corner_edge])
    edge = mesh.corner_edge[h]
    parts.append((V + edge, across[h], edges.towards[edge]))
    rows, columns, values = (np.concatenate(x) for x in zip(*parts, strict=True))
    own = slice(len(corner_weights))  # all corners, or none
    faces = sparse_operator(mesh.corner_face[own], mesh.indices[own], corner_weights, shapes[0])
    return faces, sparse_operator(rows, columns, values, shapes[1])


@dataclass(frozen=True, eq=False)
class _VertexMasks:
    """What the points of vertices are made of.

    Attributes
    ----------
    smooth : (V,)
        Shares of the smooth masks.
    weights : (V, 3 or 2)
        These masks times their shares: of the vertex, each edge neighbour, each face point if any.
    own : (V,)
        All of the weight of the vertex itself.
    end, other, along : (n,)
        Vertices on creases, their neighbours there, and these neighbours' weights.
    """

    smooth: Array
    weights: Array
    own: Array
    end: Array
    other: Array
    along: Array

    @classmethod
    def of(cls, mesh: Mesh, rules: Rules, sharpness: Sharpness, number: NumberType) -> Self:
        """Those of all vertices; unused ones stay."""
        _, _, (own, beside) = tables.rule_weights(rules.scheme, number)
        smooth, share = (number.full(mesh.n_vertices, x) for x in (number.one, number.zero))
        masks = (x.astype(number.dtype) for x in sharpness.vertex_masks)
        smooth[sharpness.concerned], share[sharpness.concerned], along = masks
        unused = mesh.vertex_faces == 0
        smooth[unused], share[unused] = number.zero, number.one
        weights = _vertex_weights(mesh, rules, np.flatnonzero(smooth == 0), number)
        weights = weights[mesh.vertex_faces]
        weights *= smooth[:, None]
        end, other = sharpness.sharp_ends
        on = np.flatnonzero(along != 0)
        end, other, along = end[on], other[on], along[on]
        # each of the two ends of a crease brings half of its mask
        np.add.at(share, end, along * (own / 2))
        if not beside:
            end, other, along = end[:0], other[:0], along[:0]
        return cls(smooth, weights, weights[:, 0] + share, end, other, along * beside)


@dataclass(frozen=True, eq=False)
class _EdgeMasks:
    """What the points of edges are made of, each (E,).

    Attributes
    ----------
    ends : (array, array)
        Weights of both ends, most often one array.
    towards : (E,)
        Of what lies across: of each face point, or corner.
    """

    ends: tuple[Array, Array]
    towards: Array

    @classmethod
    def of(cls, mesh: Mesh, rules: Rules, sharpness: Sharpness, number: NumberType) -> Self:
        """Those of all edges."""
        edge, (half,), _ = tables.rule_weights(rules.scheme, number)
        middle, towards = np.zeros((2, mesh.n_edges), dtype=number.dtype)
        middle[mesh.corner_edge[sharpness.sharp_edges]] = sharpness.edge_masks.astype(number.dtype)
        inner = np.flatnonzero((mesh.edge_corners[:, 1] >= 0) & (middle != 1))
        first = second = edge[0]
        across = edge[1]
        if callable(rules.scheme.edge):
            first, second, across = _by_valences(mesh, rules, sharpness, inner, number)
        towards[inner] = across
        triangle, other = tables.edge_face_weights(
            rules.scheme, rules.triangles == "smooth", number
        )
        if triangle != other:
            both = mesh.corner_face[mesh.edge_corners[inner]]
            shares = np.where((mesh.sizes == 3)[both], triangle, np.reshape(across, (-1, 1)))
            towards[inner] = shares.sum(axis=1) / 2
        ends = []
        for own in (first,) if first is second else (first, second):
            end = np.full(mesh.n_edges, edge[0], dtype=number.dtype)
            end[inner] = own + (across - towards[inner])
            ends.append((1 - middle) * end + middle * half)
        towards *= 1 - middle
        return cls((ends[0], ends[-1]), towards)


def _by_valences(
    mesh: Mesh, rules: Rules, sharpness: Sharpness, inner: Array, number: NumberType
) -> Array:
    """Masks of smooth edges by what is around both ends, (3, n): of each end, and across.

    Sharp vertices, those on creases, and those on the rim of a part, count as regular.
    """
    valence = np.where(sharpness.rule <= DART, mesh.vertex_faces, rules.scheme.lattice.valence)
    valence[_on_rim(mesh)] = rules.scheme.lattice.valence
    ends = valence[mesh.edges[inner]]
    try:
        return tables.edge_weights(rules.scheme, ends[:, 0], ends[:, 1], number).T
    except TypeError:
        for edge, pair in zip(inner, ends, strict=True):
            try:
                tables.edge_weights(rules.scheme, pair[:1], pair[1:], number)
            except TypeError:
                first, second = vertex_numbers(mesh)[mesh.edges[edge]].tolist()
                what = f"the edge of vertices {first} and {second}"
                what += f" joins valences {pair[0]} and {pair[1]}"
                raise TypeError(irrational(what, rules)) from None
        raise


def irrational(what: str, rules: Rules) -> str:
    """A message for those who want exact numbers where there are none."""
    return (
        f"{what}, where the masks of scheme {rules.scheme.name!r} are irrational: there are no "
        "exact points; take float64, as in mesh.with_points(mesh.points.astype(float))"
    )


def _single_entries(
    mesh: Mesh, vertices: _VertexMasks, edges: _EdgeMasks, F: int, number: NumberType
) -> list[tuple[Array, Array, Array]]:
    """Rows, columns and values; in each part no row is met twice, and no entry in any other.

    F is the number of face points.
    """
    V, E = mesh.n_vertices, mesh.n_edges
    rows, every = np.flatnonzero(vertices.own != 0), np.arange(max(E, F))
    parts = [
        (rows, rows, vertices.own[rows]),
        (V + every[:E], mesh.edges[:, 0], edges.ends[0]),
        (V + every[:E], mesh.edges[:, 1], edges.ends[1]),
        (V + E + every[:F], V + every[:F], number.full(F, number.one)),
    ]
    order = np.argsort(vertices.end, kind="stable")
    end, other, along = (x[order] for x in (vertices.end, vertices.other, vertices.along))
    while len(end):
        again = np.zeros(len(end), dtype=bool)
        np.equal(end[1:], end[:-1], out=again[1:])
        first = ~again
        parts.append((end[first], other[first], along[first]))
        end, other, along = end[again], other[again], along[again]
    return parts


def _compiled_stage(
    mesh: Mesh,
    vertices: _VertexMasks,
    edges: _EdgeMasks,
    parts: list[tuple[Array, Array, Array]],
) -> SparseRows | csr_array[Any]:
    """The second operator of `stage_rows`, its entries by corner filled in by a kernel."""
    from limitsurf._kernels import refinement

    V, E, F = mesh.n_vertices, mesh.n_edges, mesh.n_faces
    counts = np.zeros(V + E + F, dtype=np.int64)
    counts[:V] = 2 * mesh.vertex_faces * (vertices.weights[:, 1:] != 0).any(axis=1)
    counts[V : V + E] = 2 * (edges.towards != 0)
    for rows, _, _ in parts:
        counts[rows] += 1
    starts = np.concatenate([[0], np.cumsum(counts)])
    columns, values = np.empty(starts[-1], np.int32), np.empty(starts[-1])
    place = starts[:-1].copy()
    for rows, column, value in parts:
        at = place[rows]
        columns[at], values[at] = column, value
        place[rows] += 1
    known = mesh.indices, mesh.connectivity.varying_offsets, mesh.corner_edge
    refinement.operator_rows(*known, vertices.weights, edges.towards, place, columns, values)
    made = SparseRows(starts, columns, values, (V + E + F, V + F))
    if mesh.connectivity.repeats or (vertices.smooth[vertices.end] != 0).any():
        # an edge neighbour may be met twice
        stage = csr(*made)
        stage.sum_duplicates()
        return stage
    return made


def _corner_weights(mesh: Mesh, rules: Rules, number: NumberType) -> Array:
    """Weight of every face corner in its face point, (n_corners,); none where there is none."""
    if not rules.scheme.lattice.face_points:
        return number.full(0, number.zero)
    size = mesh.connectivity.uniform_size
    if size:
        return np.tile(_face_weights(rules, size, number), mesh.n_faces)
    return tables.corner_weights(rules.scheme, mesh.sizes, number)


@lru_cache(maxsize=64)
def _face_weights(rules: Rules, size: int, number: NumberType) -> Array:
    """Weight of every corner of a face of so many in its face point, (size,)."""
    return read_only(tables.corner_weights(rules.scheme, np.array([size]), number))


def _vertex_weights(mesh: Mesh, rules: Rules, rough: Array, number: NumberType) -> Array:
    """Smooth masks by number of faces at a vertex, (largest + 1, n); 0 where all are `rough`."""
    most, valences = smooth_valences(mesh, rough)
    try:
        return _weights_table(rules, most, tuple(valences), number)
    except (TypeError, ValueError):
        table = _weights_table(rules, most, (), number).copy()
        for faces in valences:
            try:
                table[faces] = tables.vertex_weights(rules.scheme, np.array([faces]), number)
            except TypeError:
                _refuse_irrational(mesh, rules, faces, rough)
            except ValueError:  # no mask for so many faces
                if _is_smooth(mesh, faces, rough).any():
                    raise
                table[faces, 0] = number.one
    return table


@lru_cache(maxsize=64)
def _weights_table(rules: Rules, most: int, valences: tuple[int, ...], number: NumberType) -> Array:
    """Smooth masks of some numbers of faces, (most + 1, n), 0 for the others."""
    table = np.zeros((most + 1, 1 + len(rules.scheme.lattice.orbits)), dtype=number.dtype)
    faces = np.array(valences, dtype=int)
    table[faces] = tables.vertex_weights(rules.scheme, faces, number)
    return read_only(table)


def _refuse_irrational(mesh: Mesh, rules: Rules, faces: int, rough: Array) -> None:
    """Refuse exact points of a smooth vertex of so many faces, if there is one."""
    smooth = _is_smooth(mesh, faces, rough)
    if smooth.any():
        what = f"vertex {vertex_numbers(mesh)[smooth.argmax()]} has valence {faces}"
        raise TypeError(irrational(what, rules)) from None


def _is_smooth(mesh: Mesh, faces: int, rough: Array) -> Array:
    """Which vertices of so many faces are smooth, (V,); those on the rim of a part are none."""
    smooth = np.asarray(mesh.vertex_faces == faces)
    smooth[rough] = False
    smooth[_on_rim(mesh)] = False
    return smooth


def _on_rim(mesh: Mesh) -> Array:
    rim = np.flatnonzero(mesh.twin < 0)
    return np.concatenate([mesh.indices[rim], mesh.indices[mesh.connectivity.after(rim)]])


def refined_values(
    mesh: Mesh, rules: Rules, sharpness: Sharpness, values: Array, compiled: bool
) -> Array:
    """One level of refinement of values at the vertices, (n_vertices, d)."""
    if not rules.scheme.has_pieces:
        if compiled:
            return interpolating.refined_points(mesh, rules, read_only(values))
        return np.asarray(interpolating.stage(mesh, rules, numbers.type_of(values)) @ values)
    if not compiled or callable(rules.scheme.edge):
        faces, vertices = refinement_stages(mesh, rules, sharpness, numbers.type_of(values), False)
        return np.asarray(vertices @ np.concatenate([values, faces @ values]))
    from limitsurf._kernels import refinement

    lattice = rules.scheme.lattice
    result = np.empty((child_vertices(mesh.connectivity, lattice), values.shape[1]))
    masks, sharp = kept(mesh, "stage", rules, lambda: _compiled_masks(mesh, rules, sharpness))
    given, around = (read_only(values), mesh.indices), (mesh.twin, mesh.corner_edge)
    if lattice.face_points:
        offsets = mesh.connectivity.varying_offsets
        faces = offsets, mesh.corner_face if len(offsets) else offsets
        known: Any = *given, *faces, *around, mesh.vertex_faces, mesh.n_edges, masks
        refine: Any = refinement.refined_points
    else:
        around = mesh.edges, mesh.edge_corners
        known = *given, *around, mesh.vertex_faces, (masks[2][:, 0], masks[3])
        refine = refinement.refined_triangles
    for first, channels in channel_groups(values.shape[1]):
        refine(*known, first, channels, result)
    refinement.sharpened(given[0], *sharp[0], *sharp[1], result)
    return result


def _compiled_masks(
    mesh: Mesh, rules: Rules, sharpness: Sharpness
) -> tuple[tuple[Array, Array, Array, Array], tuple[_Sharp, _Sharp]]:
    """What the kernels `refined_points` and `sharpened` need to know beside the faces."""
    smooth, _, along = (x.astype(float, copy=False) for x in sharpness.vertex_masks)
    _, half, crease = tables.rule_weights(rules.scheme, numbers.FLOAT64)
    end, other = sharpness.sharp_ends
    on = np.flatnonzero(along)
    # the points of edges without a twin are midpoints
    side = sharpness.sharp_edges
    inner = np.flatnonzero(mesh.twin[side] >= 0)
    edge = mesh.n_vertices + mesh.corner_edge[side[inner]]
    middle = sharpness.edge_masks.astype(float, copy=False)[inner]
    vertices = sharpness.concerned, smooth, end[on], other[on], along[on] * crease[1]
    edges = edge, end[inner], other[inner], middle, half
    masks = _smooth_masks(mesh, rules, sharpness.concerned[smooth == 0])
    return masks, (vertices, edges)


def _smooth_masks(mesh: Mesh, rules: Rules, rough: Array) -> tuple[Array, Array, Array, Array]:
    """The masks that the kernel `refined_points` needs, but for those of `rough` vertices."""
    size = mesh.connectivity.uniform_size
    sizes = [size] if size else np.flatnonzero(np.bincount(mesh.sizes)).tolist()
    most, valences = smooth_valences(mesh, rough)
    return rounded_masks(rules, tuple(sizes), most, tuple(valences))


@lru_cache(maxsize=64)
def rounded_masks(
    rules: Rules, sizes: tuple[int, ...], most: int, valences: tuple[int, ...]
) -> tuple[Array, Array, Array, Array]:
    """Masks in float64 of faces of some sizes, and of vertices of some numbers of faces.

    Where faces have no points, the last are those of edges.
    """
    number, corners = numbers.FLOAT64, np.array(sizes)
    start = np.zeros(corners[-1] + 1, dtype=np.int64)
    start[corners] = np.cumsum(corners) - corners
    weights = np.zeros((most + 1, len(rules.scheme.lattice.orbits)))
    faces = np.array(valences, dtype=int)
    weights[faces] = tables.vertex_weights(rules.scheme, faces, number)[:, 1:]
    if not rules.scheme.lattice.face_points:
        edge, _, _ = tables.rule_weights(rules.scheme, number)
        return read_only((start, np.zeros(0), weights, edge))
    contribution = tables.edge_face_weights(rules.scheme, rules.triangles == "smooth", number)
    masks = start, tables.corner_weights(rules.scheme, corners, number), weights, contribution
    return read_only(masks)


def smooth_valences(mesh: Mesh, rough: Array) -> tuple[int, list[int]]:
    """The most faces at a vertex; the numbers of faces at any but the `rough` vertices."""
    faces = np.bincount(mesh.vertex_faces)
    most = len(faces) - 1
    faces -= np.bincount(mesh.vertex_faces[rough], minlength=len(faces))
    return most, (1 + np.flatnonzero(faces[1:])).tolist()
