"""Refinement by schemes of triangles that keep vertices: points of edges, and what follows.

A point of an edge depends on what is around it by half-edges alone, so that any cage has one,
non-manifold ones included: at these every side of an edge counts as a boundary, and the point is
the mean of what the sides say.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import tables
from limitsurf.cage.connectivity import read_only
from limitsurf.cage.mesh import Mesh
from limitsurf.numbers import FLOAT64, NumberType
from limitsurf.refine.operators import channel_groups, sparse_operator
from limitsurf.rules import Rules
from limitsurf.topology import vertex_numbers

Array = NDArray[Any]
_Entries = tuple[Array, Array, Array]


def stage(mesh: Mesh, rules: Rules, number: NumberType) -> Any:
    """The operator of one step, (n_vertices + n_edges, n_vertices)."""
    V, E, every = mesh.n_vertices, mesh.n_edges, np.arange(mesh.n_vertices)
    rows, columns, values = edge_rows(mesh, rules, number)
    return sparse_operator(
        np.concatenate([every, V + rows]),
        np.concatenate([every, columns]),
        np.concatenate([number.full(V, number.one), values]),
        (V + E, V),
    )


def refined_points(mesh: Mesh, rules: Rules, points: Array) -> Array:
    """The points of one step, (n_vertices + n_edges, d), by a kernel; `points` are (V, d)."""
    from limitsurf._kernels import step_points

    result = np.empty((mesh.n_vertices + mesh.n_edges, points.shape[1]))
    valences = mesh.connectivity.valences
    closed = np.bincount(np.maximum(valences, 0))
    if (valences[mesh.vertex_faces > 0] == 0).any():  # several fans
        fans = mesh.fans
        own = fans.sizes[fans.closed]
        closed = np.bincount(own, minlength=len(closed))
    known = (mesh.indices, mesh.twin, mesh.corner_edge, mesh.edge_corners, valences)
    weights: Any = tuple(map(float, tables.interpolating_weights(rules.scheme, FLOAT64)))
    spokes = _all_spokes(rules, len(closed), tuple((np.flatnonzero(closed[1:]) + 1).tolist()))
    for first, channels in channel_groups(points.shape[1]):
        sides = np.zeros(mesh.n_edges, dtype=np.int64)
        step_points.interpolated_edges(
            points, *known, weights, spokes, sides, first, channels, result
        )
    return result


@lru_cache(maxsize=64)
def _all_spokes(rules: Rules, size: int, valences: tuple[int, ...]) -> tuple[Array, Array]:
    """Where the masks of edges at vertices of some valences begin, -1 for none, and these."""
    start, masks, total = np.full(size, -1), [np.zeros(0)], 0
    for N in valences:
        if tables.has_spokes(rules.scheme, N):
            start[N] = total
            masks.append(tables.spoke_weights(rules.scheme, N, FLOAT64))
            total += N + 1
    return read_only((start, np.concatenate(masks)))


def edge_rows(mesh: Mesh, rules: Rules, number: NumberType) -> _Entries:
    """Edges, vertices and weights of the points of edges; an entry may be met several times."""
    inner = np.flatnonzero(mesh.twin >= 0)
    valence, masked = _masked(mesh, rules, inner)
    count = np.zeros(mesh.n_edges, dtype=np.int64)
    np.add.at(count, mesh.corner_edge[inner[masked]], 1)
    first = inner[(mesh.twin[inner] > inner) & (count[mesh.corner_edge[inner]] == 0)]
    parts = [*_regular(mesh, rules, first, number), *_curve(mesh, rules, number)]
    half, valence = inner[masked], valence[masked]
    for N in np.unique(valence).tolist():
        corners = half[valence == N]
        mask = _spokes(mesh, rules, N, corners, number)
        edge = mesh.corner_edge[corners]
        around = _around(mesh, corners, N)
        columns = np.concatenate([mesh.indices[corners][:, None], around], axis=1)
        used = np.flatnonzero(mask != 0)
        shares = mask[used] / number.array(count[edge])[:, None]
        parts.append((np.repeat(edge, len(used)), columns[:, used].ravel(), shares.ravel()))
    rows, columns, values = (np.concatenate(x) for x in zip(*parts, strict=True))
    return rows, columns, values


def _masked(mesh: Mesh, rules: Rules, half: Array) -> tuple[Array, Array]:
    """Valences at the tails of some half-edges with twins, and whether these have masks."""
    fans, fan = mesh.fans, mesh.fans.fan[half]
    valence = fans.sizes[fan]
    most = int(valence.max(initial=0))
    known = np.zeros(most + 1, dtype=bool)
    for N in np.unique(valence).tolist():
        known[N] = tables.has_spokes(rules.scheme, N)
    return valence, known[valence] & fans.closed[fan]


def _around(mesh: Mesh, corners: Array, N: int) -> Array:
    """The neighbours of vertices in closed fans of N faces, from the ends of half-edges, (n, N)."""
    fans = mesh.fans
    start, place = fans.offsets[fans.fan[corners]], fans.position[corners]
    turned = fans.corners[start[:, None] + (place[:, None] + np.arange(N)) % N]
    return np.asarray(mesh.indices[mesh.next_corner[turned]])


def _spokes(mesh: Mesh, rules: Rules, N: int, corners: Array, number: NumberType) -> Array:
    """The mask at edges of vertices of valence N; a TypeError where it is not to be had."""
    try:
        return tables.spoke_weights(rules.scheme, N, number)
    except TypeError:
        vertex = vertex_numbers(mesh)[mesh.indices[corners[0]]]
        raise TypeError(
            f"vertex {vertex} has valence {N}, where the masks of scheme {rules.scheme.name!r} "
            "are irrational: there are no exact points; take float64, as in "
            "mesh.with_points(mesh.points.astype(float))"
        ) from None


def _regular(mesh: Mesh, rules: Rules, half: Array, number: NumberType) -> list[_Entries]:
    """Points of edges by the mask of regular ones, from one half-edge of each."""
    ends, across, wings, _, _ = tables.interpolating_weights(rules.scheme, number)
    after, before = mesh.next_corner, mesh.previous_corner
    other = mesh.twin[half]
    edge, parts = mesh.corner_edge[half], []

    def add(edges: Array, columns: Array, weight: Any) -> None:
        parts.append((edges, columns, number.full(len(edges), weight)))

    for h in (half, other):
        add(edge, mesh.indices[h], ends)
        add(edge, mesh.indices[before[h]], across)
        for side in (after[h], before[h]):
            there = mesh.twin[side]
            known = there >= 0
            add(edge[known], mesh.indices[before[there[known]]], wings)
            # beyond a boundary edge (p, q) of the triangle (p, q, o): p + q - o
            lost, rim = edge[~known], side[~known]
            add(lost, mesh.indices[rim], wings)
            add(lost, mesh.indices[after[rim]], wings)
            add(lost, mesh.indices[before[rim]], -wings)
    return parts


def _curve(mesh: Mesh, rules: Rules, number: NumberType) -> list[_Entries]:
    """Points of boundary edges: the mean over their sides."""
    *_, near, far = tables.interpolating_weights(rules.scheme, number)
    half = np.flatnonzero(mesh.twin < 0)
    edge, after = mesh.corner_edge[half], mesh.next_corner
    share = number.one / number.array(np.bincount(edge, minlength=mesh.n_edges)[edge])
    fans = mesh.fans
    last = fans.corners[fans.offsets[fans.fan[half] + 1] - 1]
    first = fans.corners[fans.offsets[fans.fan[after[half]]]]
    each = (
        (half, near),
        (after[half], near),
        (mesh.previous_corner[last], far),
        (after[first], far),
    )
    return [(edge, mesh.indices[corner], share * weight) for corner, weight in each]


def limit_points(mesh: Mesh, rules: Rules) -> Array:
    """The vertices themselves, NaN where there is no limit, the shape of the points."""
    known = (mesh.vertex_faces > 0) & ~rules.loose_vertices(mesh)
    result = mesh.points.copy()
    result[~known] = np.nan
    return result
