"""Compiled refinement by schemes of triangles that have no polynomial pieces.

Corners, half-edges and points are as in `refinement`. Every function fills the arrays that it is
given last, of as many channels, from the `first` on, as `channels` is long.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels.jit import inlined, lean

Array = NDArray[Any]


@inlined
def _next(h: int) -> int:
    return h - 2 if h % 3 == 2 else h + 1


@inlined
def _before(h: int) -> int:
    return h + 2 if h % 3 == 0 else h - 1


@inlined
def _closed_fan(twin: Array, h: int) -> int:
    """Number of faces around the tail of a half-edge; 0 if that is at a boundary."""
    size, at = 1, twin[_before(h)]
    while at >= 0 and at != h:
        size += 1
        at = twin[_before(at)]
    return 0 if at < 0 else size


@inlined
def _masked(indices: Array, twin: Array, valences: Array, start: Array, h: int) -> int:
    """Valence of the tail of a half-edge if edges there have a mask, else 0."""
    valence = valences[np.uint64(indices[h])]
    if valence == 0:  # of several fans
        valence = _closed_fan(twin, h)
    return valence if valence > 0 and start[valence] >= 0 else 0


@inlined
def _beyond(indices: Array, twin: Array, h: int) -> int:
    """The vertex across a half-edge, -1 beyond a boundary."""
    there = twin[h]
    return indices[_before(there)] if there >= 0 else -1


@lean
def interpolated_edges(
    points: Array,
    indices: Array,
    twin: Array,
    corner_edge: Array,
    edge_corners: Array,
    valences: Array,
    weights: tuple[float, float, float, float, float],
    spokes: tuple[Array, Array],
    sides: Array,
    first: int,
    channels: tuple[int, ...],
    result: Array,
) -> None:
    """Vertices, and points of edges by schemes that keep vertices, (V + E, d).

    `weights` are those of ends, across, wings, and near and far along a boundary. `spokes` are, by
    valence, where the mask of edges at such a vertex begins, -1 if there is none, and these, one
    after the other: of the vertex, then of its neighbours from the other end on. ``sides`` (E,) is
    0 on entry.
    """
    ends, across, wings, near, far = weights
    start, masks = spokes
    n_vertices, last = len(points), first + len(channels)
    for vertex in range(n_vertices):
        for c in range(first, last):
            result[vertex, c] = points[vertex, c]
    for edge in range(len(edge_corners)):
        at = n_vertices + edge
        if edge_corners[edge, 1] < 0:
            for c in range(first, last):
                result[at, c] = 0.0
            continue
        one = _masked(indices, twin, valences, start, edge_corners[edge, 0])
        two = _masked(indices, twin, valences, start, edge_corners[edge, 1])
        if one > 0 or two > 0:
            share = 0.5 if one > 0 and two > 0 else 1.0
            for c in range(first, last):
                result[at, c] = 0.0
            for side in range(2):
                valence, there = two if side else one, edge_corners[edge, side]
                if valence == 0:
                    continue
                mask = start[valence]
                for c in range(first, last):
                    result[at, c] += share * masks[mask] * points[indices[there], c]
                for k in range(1, valence + 1):
                    weight = share * masks[mask + k]
                    if weight != 0:
                        neighbour = indices[_next(there)]
                        for c in range(first, last):
                            result[at, c] += weight * points[neighbour, c]
                    there = twin[_before(there)]
            continue
        h, other = edge_corners[edge, 0], edge_corners[edge, 1]
        # unsigned: never counted from the end
        tail, head = np.uint64(indices[h]), np.uint64(indices[other])
        left, right = np.uint64(indices[_before(h)]), np.uint64(indices[_before(other)])
        around = (
            (_beyond(indices, twin, _next(h)), head, left, tail),
            (_beyond(indices, twin, _before(h)), left, tail, head),
            (_beyond(indices, twin, _next(other)), tail, right, head),
            (_beyond(indices, twin, _before(other)), right, head, tail),
        )
        for c in range(first, last):
            inner = ends * (points[tail, c] + points[head, c])
            inner += across * (points[left, c] + points[right, c])
            total = 0.0
            for wing, p, q, o in around:
                if wing >= 0:
                    total += points[np.uint64(wing), c]
                else:  # beyond a boundary edge (p, q) of the triangle (p, q, o)
                    total += points[p, c] + points[q, c] - points[o, c]
            result[at, c] = inner + wings * total
    for h in range(len(twin)):
        if twin[h] < 0:
            sides[corner_edge[h]] += 1
    for h in range(len(twin)):
        if twin[h] >= 0:
            continue
        # along the boundary, from the last face at the tail, and to the first at the head
        back, on = h, _next(h)
        while twin[_before(back)] >= 0:
            back = twin[_before(back)]
        while twin[on] >= 0:
            on = _next(twin[on])
        at, share = n_vertices + corner_edge[h], 1.0 / sides[corner_edge[h]]
        tail, head = indices[h], indices[_next(h)]
        before, after = indices[_before(back)], indices[_next(on)]
        for c in range(first, last):
            inner = near * (points[tail, c] + points[head, c])
            result[at, c] += share * (inner + far * (points[before, c] + points[after, c]))


@inlined
def _move(points: Array, shares: Array, first: int, last: int, result: Array) -> None:
    """Vertices moved by their shares of the sums of steps to neighbours that `result` has."""
    for vertex in range(len(shares)):
        share = shares[vertex]
        for c in range(first, last):
            moved = share * result[vertex, c] if share != 0 else 0.0
            result[vertex, c] = points[vertex, c] + moved


@lean
def centred(
    points: Array,
    indices: Array,
    shares: Array,
    first: int,
    channels: tuple[int, ...],
    result: Array,
) -> None:
    """Points after a first step by sqrt(3), (V + F, d): vertices, then the middles of faces.

    `shares` (V,) are the weights of each neighbour of a vertex, 0 where it stays.
    """
    n_vertices, last = len(points), first + len(channels)
    for vertex in range(n_vertices):
        for c in range(first, last):
            result[vertex, c] = 0.0
    for begin in range(0, len(indices), 3):
        one, two = np.uint64(indices[begin]), np.uint64(indices[begin + 1])
        three, middle = np.uint64(indices[begin + 2]), n_vertices + begin // 3
        for c in range(first, last):
            p, q, r = points[one, c], points[two, c], points[three, c]
            result[one, c] += q - p
            result[two, c] += r - q
            result[three, c] += p - r
            result[middle, c] = (p + q + r) / 3
    _move(points, shares, first, last, result)


@lean
def cut_into_thirds(
    points: Array,
    indices: Array,
    twin: Array,
    corner_edge: Array,
    shares: Array,
    middles: Array,
    first: int,
    channels: tuple[int, ...],
    result: Array,
) -> None:
    """Points after both steps, (V + F + 2 E, d), from those after the first; not on boundaries.

    `shares` (V,) are as in `centred`, `middles` (4,) those of the middles of faces with so many
    neighbours. Points on edges without a twin are left alone.
    """
    n_vertices, n_half, last = len(shares), len(points), first + len(channels)
    for vertex in range(n_vertices):
        for c in range(first, last):
            result[vertex, c] = 0.0
    for face in range(len(indices) // 3):
        middle, count = n_vertices + face, 0
        for c in range(first, last):
            result[middle, c] = 0.0
        for h in range(3 * face, 3 * face + 3):
            tail = np.uint64(indices[h])
            for c in range(first, last):
                step = points[middle, c] - points[tail, c]
                result[tail, c] += step
                result[middle, c] -= step
            if twin[h] < 0:
                continue
            count += 1
            other = np.uint64(n_vertices + twin[h] // 3)
            near = n_half + 2 * corner_edge[h] + (indices[h] > indices[_next(h)])
            for c in range(first, last):
                p, q, r = points[tail, c], points[middle, c], points[other, c]
                result[middle, c] += r - q
                result[near, c] = (p + q + r) / 3
        share = middles[count]
        for c in range(first, last):
            result[middle, c] = points[middle, c] + share * result[middle, c]
    _move(points, shares, first, last, result)


@lean
def third_faces(
    indices: Array, twin: Array, corner_edge: Array, n_vertices: int, faces: Array, twins: Array
) -> None:
    """Faces after both steps and the twins of their half-edges, (27 F,) each.

    Nine from each face: three at its corners, three amid its edges, three between its middle and
    these.
    """
    n_half = n_vertices + len(indices) // 3
    for h in range(len(indices)):
        face, k = h // 3, h % 3
        after, last, across = _next(h), _before(h), twin[h]
        corner, head, before = indices[h], indices[after], indices[last]
        middle = n_vertices + face
        near = n_half + 2 * corner_edge[h] + (corner > head)
        far = n_half + 2 * corner_edge[h] + (corner < head)
        back = n_half + 2 * corner_edge[last] + (before < corner)
        at, amid, inside = (
            27 * face + 3 * k,
            27 * face + 9 + 3 * k,
            27 * face + 18 + 3 * k,
        )
        faces[at], faces[at + 1], faces[at + 2] = corner, near, back
        faces[amid], faces[amid + 1], faces[amid + 2] = near, far, middle
        faces[inside], faces[inside + 1], faces[inside + 2] = near, middle, back
        twins[at + 1], twins[inside + 2] = inside + 2, at + 1
        twins[inside], twins[amid + 2] = amid + 2, inside
        twins[inside + 1] = 27 * face + 9 + 3 * (last % 3) + 1
        twins[27 * face + 9 + 3 * (last % 3) + 1] = inside + 1
        if across < 0:
            twins[at] = twins[amid] = -1
            twins[27 * face + 3 * (after % 3) + 2] = -1
        else:
            there = _next(across)
            twins[at] = 27 * (across // 3) + 3 * (there % 3) + 2
            twins[amid] = 27 * (across // 3) + 9 + 3 * (across % 3)
            twins[27 * face + 3 * (after % 3) + 2] = 27 * (across // 3) + 3 * (across % 3)
