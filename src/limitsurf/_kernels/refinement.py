"""Compiled refinement: children of faces, their connectivity, and refined points.

A mesh has V vertices, E edges, F faces and H corners, numbered face by face. Corner h is also the
half-edge to the next corner of its face; ``twin`` (H,) is the one in the opposite direction or -1.
Faces are given by ``offsets`` (F + 1,) and ``corner_face`` (H,); both are empty if all are quads.
Vertices of the refined mesh are those of the mesh, then a point for each edge, then for each face;
its faces are one for each corner. Where triangles are cut into triangles, faces have no points, and
face f has the children 4 f to 4 f + 3: those at its corners, then the middle one; of half-edge
h = 3 f + k the first half is half-edge 0 of child 4 f + k, the second half-edge 2 of child
4 f + (k + 1) % 3, and half-edge 1 of child 4 f + k is inside, across (k + 1) % 3 of the middle.
Every function passes over the faces once, and fills the arrays that it is given last.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels.doubt import NOISE, UNIT
from limitsurf._kernels.jit import inlined, lean, unfused

Array = NDArray[Any]


@lean
def child_faces(
    indices: Array,
    offsets: Array,
    corner_edge: Array,
    n_vertices: int,
    n_edges: int,
    result: Array,
) -> None:
    """Vertices of the children, (4 H,)."""
    quads = len(offsets) == 0
    n_faces = len(indices) // 4 if quads else len(offsets) - 1
    for face in range(n_faces):
        begin = 4 * face if quads else offsets[face]
        end = begin + 4 if quads else offsets[face + 1]
        before = n_vertices + corner_edge[end - 1]
        for h in range(begin, end):
            edge = n_vertices + corner_edge[h]
            result[4 * h] = indices[h]
            result[4 * h + 1] = edge
            result[4 * h + 2] = n_vertices + n_edges + face
            result[4 * h + 3] = before
            before = edge


@lean
def child_twins(offsets: Array, twin: Array, result: Array) -> None:
    """Twins of the children's half-edges, (4 H,).

    Those of child h go from corner to midpoint, to face point, to midpoint before, to corner.
    """
    quads = len(offsets) == 0
    n_faces = len(twin) // 4 if quads else len(offsets) - 1
    for face in range(n_faces):
        begin = 4 * face if quads else offsets[face]
        end = begin + 4 if quads else offsets[face + 1]
        for h in range(begin, end):
            after = begin if h + 1 == end else h + 1
            result[4 * h + 1] = 4 * after + 2
            result[4 * after + 2] = 4 * h + 1
            across = twin[h]
            if across < 0:
                result[4 * h] = -1
                result[4 * after + 3] = -1
            else:
                result[4 * after + 3] = 4 * across
                result[4 * across] = 4 * after + 3


@inlined
def _halve(
    edges: Array, half: Array, halves: Array, new_edges: Array, new_edge_corners: Array, most: int
) -> None:
    """Number the halves of edges by vertex, then edge, with `most` for the corner of none."""
    for edge in range(len(edges)):
        for side in range(2):
            vertex = edges[edge, side]
            number = half[vertex]
            half[vertex] += 1
            halves[edge, side] = number
            new_edges[number, 0] = vertex
            new_edges[number, 1] = len(half) + edge
            new_edge_corners[number, 0] = most
            new_edge_corners[number, 1] = -1


@lean
def child_edges(
    indices: Array,
    offsets: Array,
    twin: Array,
    edges: Array,
    corner_edge: Array,
    half: Array,
    middle: Array,
    halves: Array,
    new_edges: Array,
    new_corner_edge: Array,
    new_edge_corners: Array,
) -> None:
    """``edges``, ``corner_edge`` and ``edge_corners`` of the refined mesh.

    Its edges come in lexicographic order by themselves: first the halves of edges by vertex and
    edge, 2 E of them, then, by edge and face, those that join a midpoint to a face point. On entry
    ``half`` (V,) and ``middle`` (E,) are where they begin for each vertex and edge; ``halves``
    (E, 2) is room. No half-edge is `separate`.
    """
    quads = len(offsets) == 0
    n_vertices, n_corners, n_edges = len(half), len(twin), len(edges)
    n_faces = n_corners // 4 if quads else len(offsets) - 1
    _halve(edges, half, halves, new_edges, new_edge_corners, 4 * n_corners)
    for face in range(n_faces):
        begin = 4 * face if quads else offsets[face]
        end = begin + 4 if quads else offsets[face + 1]
        for h in range(begin, end):
            after = begin if h + 1 == end else h + 1
            edge = corner_edge[h]
            number = middle[edge]
            middle[edge] += 1
            new_edges[number, 0] = n_vertices + edge
            new_edges[number, 1] = n_vertices + n_edges + face
            new_edge_corners[number, 0] = min(4 * h + 1, 4 * after + 2)
            new_edge_corners[number, 1] = max(4 * h + 1, 4 * after + 2)
            new_corner_edge[4 * h + 1] = number
            new_corner_edge[4 * after + 2] = number
            side = 0 if edges[edge, 0] == indices[h] else 1
            for number, corner in (
                (halves[edge, side], 4 * h),
                (halves[edge, 1 - side], 4 * after + 3),
            ):
                new_corner_edge[corner] = number
                least = new_edge_corners[number, 0]
                new_edge_corners[number, 0] = min(least, corner)
                if twin[h] >= 0 and least < 4 * n_corners:
                    new_edge_corners[number, 1] = max(least, corner)


@lean
def triangle_children(indices: Array, corner_edge: Array, n_vertices: int, result: Array) -> None:
    """Vertices of the children of triangles, (4 H,)."""
    for h in range(0, len(indices), 3):
        a, b, c = indices[h], indices[h + 1], indices[h + 2]
        x, y = n_vertices + corner_edge[h], n_vertices + corner_edge[h + 1]
        z = n_vertices + corner_edge[h + 2]
        at = 4 * h
        result[at], result[at + 1], result[at + 2] = a, x, z
        result[at + 3], result[at + 4], result[at + 5] = b, y, x
        result[at + 6], result[at + 7], result[at + 8] = c, z, y
        result[at + 9], result[at + 10], result[at + 11] = y, z, x


@lean
def triangle_twins(twin: Array, result: Array) -> None:
    """Twins of the half-edges of the children of triangles, (4 H,)."""
    for begin in range(0, len(twin), 3):
        for k in range(3):
            after = 0 if k == 2 else k + 1
            inner, middle = 4 * begin + 3 * k + 1, 4 * begin + 9 + after
            result[inner], result[middle] = middle, inner
            across = twin[begin + k]
            if across < 0:
                result[4 * begin + 3 * k] = result[4 * begin + 3 * after + 2] = -1
            else:
                other = across % 3
                begin_there = 4 * (across - other)
                last = 0 if other == 2 else other + 1
                result[4 * begin + 3 * k] = begin_there + 3 * last + 2
                result[4 * begin + 3 * after + 2] = begin_there + 3 * other


@lean
def triangle_edges(
    indices: Array,
    twin: Array,
    edges: Array,
    corner_edge: Array,
    half: Array,
    cut: Array,
    halves: Array,
    new_edges: Array,
    new_corner_edge: Array,
    new_edge_corners: Array,
) -> None:
    """``edges``, ``corner_edge`` and ``edge_corners`` of the children of triangles.

    As in `child_edges`; those inside of faces come by the two edges that they join, then by face.
    On entry ``cut`` (E,) is 0.
    """
    n_vertices, n_corners, n_edges = len(half), len(twin), len(edges)
    _halve(edges, half, halves, new_edges, new_edge_corners, 4 * n_corners)
    for begin in range(0, n_corners, 3):
        for k in range(3):
            before = begin + 2 if k == 0 else begin + k - 1
            cut[min(corner_edge[begin + k], corner_edge[before])] += 1
    total = 2 * n_edges
    for edge in range(n_edges):
        count = cut[edge]
        cut[edge] = total  # where its next one goes
        total += count
    for number in range(2 * n_edges, total):
        new_edges[number, 0] = -1  # none yet
    for begin in range(0, n_corners, 3):
        for k in range(3):
            h = begin + k
            before = begin + 2 if k == 0 else h - 1
            after = 0 if k == 2 else k + 1
            edge = corner_edge[h]
            # into order: few cuts end at an edge
            low, high = min(edge, corner_edge[before]), max(edge, corner_edge[before])
            number = cut[low]
            cut[low] += 1
            while (
                new_edges[number - 1, 0] == n_vertices + low
                and new_edges[number - 1, 1] > n_vertices + high
            ):
                for side in range(2):
                    new_edges[number, side] = new_edges[number - 1, side]
                    new_edge_corners[number, side] = new_edge_corners[number - 1, side]
                number -= 1
            new_edges[number, 0] = n_vertices + low
            new_edges[number, 1] = n_vertices + high
            new_edge_corners[number, 0] = 4 * begin + 3 * k + 1
            new_edge_corners[number, 1] = 4 * begin + 9 + after
            side = 0 if edges[edge, 0] == indices[h] else 1
            for number, corner in (
                (halves[edge, side], 4 * begin + 3 * k),
                (halves[edge, 1 - side], 4 * begin + 3 * after + 2),
            ):
                new_corner_edge[corner] = number
                least = new_edge_corners[number, 0]
                new_edge_corners[number, 0] = min(least, corner)
                if twin[h] >= 0 and least < 4 * n_corners:
                    new_edge_corners[number, 1] = max(least, corner)
    for number in range(2 * n_edges, total):
        new_corner_edge[new_edge_corners[number, 0]] = number
        new_corner_edge[new_edge_corners[number, 1]] = number


@lean
def operator_rows(
    indices: Array,
    offsets: Array,
    corner_edge: Array,
    weights: Array,
    towards: Array,
    place: Array,
    columns: Array,
    values: Array,
) -> None:
    """What faces and edge neighbours bring to the rows of vertex and edge points.

    A row goes on at ``place`` (V + E,). Face points are columns V + face; `weights` (V, 3) are for
    vertex, neighbours and face points, `towards` (E,) for the face points beside an edge.
    """
    quads = len(offsets) == 0
    n_vertices = len(weights)
    n_faces = len(indices) // 4 if quads else len(offsets) - 1
    for face in range(n_faces):
        begin = 4 * face if quads else offsets[face]
        end = begin + 4 if quads else offsets[face + 1]
        for h in range(begin, end):
            tail, edge = indices[h], corner_edge[h]
            if weights[tail, 1] != 0 or weights[tail, 2] != 0:
                at = place[tail]
                place[tail] += 2
                columns[at] = indices[begin if h + 1 == end else h + 1]
                columns[at + 1] = n_vertices + face
                values[at] = weights[tail, 1]
                values[at + 1] = weights[tail, 2]
            if towards[edge] != 0:
                at = place[n_vertices + edge]
                place[n_vertices + edge] += 1
                columns[at] = n_vertices + face
                values[at] = towards[edge]


@lean
def product(
    starts: Array,
    columns: Array,
    values: Array,
    other_starts: Array,
    other_columns: Array,
    other_values: Array,
    seen: Array,
    total: Array,
    new_starts: Array,
    new_columns: Array,
    new_values: Array,
) -> None:
    """The product of two sparse matrices by rows, with ascending columns.

    ``seen`` and ``total`` are room for as many as the other has columns, the first -1 throughout.
    """
    count = 0
    new_starts[0] = 0
    for row in range(len(starts) - 1):
        begin = count
        for k in range(starts[row], starts[row + 1]):
            weight = values[k]
            for j in range(other_starts[columns[k]], other_starts[columns[k] + 1]):
                column = other_columns[j]
                if seen[column] == row:
                    total[column] += weight * other_values[j]
                    continue
                seen[column] = row
                total[column] = weight * other_values[j]
                # into order: rows are short
                at = count
                while at > begin and new_columns[at - 1] > column:
                    new_columns[at] = new_columns[at - 1]
                    at -= 1
                new_columns[at] = column
                count += 1
        for k in range(begin, count):
            new_values[k] = total[new_columns[k]]
        new_starts[row + 1] = count


@lean
def refined_points(
    points: Array,
    indices: Array,
    offsets: Array,
    corner_face: Array,
    twin: Array,
    corner_edge: Array,
    vertex_faces: Array,
    n_edges: int,
    masks: tuple[Array, Array, Array, Array],
    first: int,
    channels: tuple[int, ...],
    result: Array,
) -> None:
    """Smooth points of the refined mesh, (V + E + F, d), midpoints at edges without a twin.

    `masks` are, by number of corners, where face masks begin, and these, one after the other; by
    number of faces at a vertex the weights of edge neighbours and face points; and what a triangle
    and what another face contributes to the weight of face points in edge points. As many channels
    are computed, from the `first` on, as `channels` is long, whose length the compiler knows.
    """
    start, face_masks, vertex_masks, contribution = masks
    n_vertices = len(points)
    quads = len(offsets) == 0
    n_faces = len(indices) // 4 if quads else len(offsets) - 1
    last = first + len(channels)
    for vertex in range(n_vertices):
        for c in range(first, last):
            result[vertex, c] = 0.0
    for face in range(n_faces):
        begin = 4 * face if quads else offsets[face]
        end = begin + 4 if quads else offsets[face + 1]
        centre = n_vertices + n_edges + face
        for c in range(first, last):
            result[centre, c] = 0.0
        mask = start[end - begin] - begin
        for h in range(begin, end):
            # unsigned: never counted from the end
            tail, weight = np.uint64(indices[h]), face_masks[mask + h]
            for c in range(first, last):
                result[centre, c] += weight * points[tail, c]
        own = contribution[0 if end - begin == 3 else 1] / 2
        for h in range(begin, end):
            tail = np.uint64(indices[h])
            head = np.uint64(indices[begin if h + 1 == end else h + 1])
            # differences from the vertex: many small terms are not lost beside it
            near, far = vertex_masks[vertex_faces[tail], 0], vertex_masks[vertex_faces[tail], 1]
            for c in range(first, last):
                here = points[tail, c]
                step = near * (points[head, c] - here) + far * (result[centre, c] - here)
                result[tail, c] += step
            across = twin[h]
            if across >= h:
                continue  # when the other face has its point
            edge = n_vertices + corner_edge[h]
            weight, other = 0.0, centre
            if across >= 0:
                beside = across // 4 if quads else corner_face[across]
                triangle = not quads and offsets[beside + 1] - offsets[beside] == 3
                weight = own + contribution[0 if triangle else 1] / 2
                other = n_vertices + n_edges + beside
            for c in range(first, last):
                ends = (0.5 - weight) * (points[tail, c] + points[head, c])
                result[edge, c] = ends + weight * (result[centre, c] + result[other, c])
    for vertex in range(n_vertices):
        for c in range(first, last):
            result[vertex, c] += points[vertex, c]


@lean
def refined_triangles(
    points: Array,
    indices: Array,
    twin: Array,
    corner_edge: Array,
    vertex_faces: Array,
    masks: tuple[Array, Array],
    first: int,
    channels: tuple[int, ...],
    result: Array,
) -> None:
    """Smooth points of refined triangles, (V + E, d), midpoints at edges without a twin.

    `masks` are by number of faces at a vertex the weight of edge neighbours; and those of each end,
    and of each opposite corner, in edge points. Channels are as in `refined_points`.
    """
    weights, (end, across) = masks[0], (masks[1][0], masks[1][1])
    n_vertices, last = len(points), first + len(channels)
    for vertex in range(n_vertices):
        for c in range(first, last):
            result[vertex, c] = 0.0
    for begin in range(0, len(indices), 3):
        for k in range(3):
            h = begin + k
            # unsigned: never counted from the end
            tail = np.uint64(indices[h])
            head = np.uint64(indices[begin if k == 2 else h + 1])
            near = weights[vertex_faces[tail]]
            for c in range(first, last):
                result[tail, c] += near * (points[head, c] - points[tail, c])
            other = twin[h]
            if other >= h:
                continue  # when the other face has its point
            edge = n_vertices + corner_edge[h]
            if other < 0:
                for c in range(first, last):
                    result[edge, c] = 0.5 * (points[tail, c] + points[head, c])
                continue
            one = np.uint64(indices[begin + 2 if k == 0 else h - 1])
            two = np.uint64(indices[other + 2 if other % 3 == 0 else other - 1])
            for c in range(first, last):
                ends = end * (points[tail, c] + points[head, c])
                result[edge, c] = ends + across * (points[one, c] + points[two, c])
    for vertex in range(n_vertices):
        for c in range(first, last):
            result[vertex, c] += points[vertex, c]


@lean
def limit_points(
    points: Array,
    indices: Array,
    vertex_faces: Array,
    weights: Array,
    corners: tuple[int, ...],
    first: int,
    channels: tuple[int, ...],
    result: Array,
) -> None:
    """Limits of vertices that are smooth all around, (V, d); of others nonsense.

    `weights` are, by number of faces at a vertex, those of edge neighbours and, in quads, of face
    corners. Faces have as many corners as `corners` is long, 3 or 4; channels are as in
    `refined_points`.
    """
    size = len(corners)
    n_vertices, last = len(points), first + len(channels)
    for vertex in range(n_vertices):
        for c in range(first, last):
            result[vertex, c] = 0.0
    for h in range(len(indices)):
        begin = h // size * size
        tail, head = np.uint64(indices[h]), np.uint64(indices[begin + (h - begin + 1) % size])
        near = weights[vertex_faces[tail], 0]
        if size == 3:
            for c in range(first, last):
                result[tail, c] += near * (points[head, c] - points[tail, c])
            continue
        opposite = np.uint64(indices[begin + (h - begin + 2) % size])
        far = weights[vertex_faces[tail], 1]
        for c in range(first, last):
            own = points[tail, c]
            step = near * (points[head, c] - own) + far * (points[opposite, c] - own)
            result[tail, c] += step
    for vertex in range(n_vertices):
        for c in range(first, last):
            result[vertex, c] += points[vertex, c]


@unfused
def _stepped(value: float, share: float, difference: float) -> float:
    return value + share * difference


@unfused
def _mixed(share: float, value: float, rest: float, other: float) -> float:
    return share * value + rest * other


@inlined
def _in_ring(corner: int, face: int, N: int) -> int:
    """Place in a ring of N faces of a corner of one of these, counted from the middle."""
    corner &= 3
    if corner == 0:
        return 0
    if corner == 3:
        return 1 if face == N - 1 else 3 + 2 * face
    return 2 * face + corner


@lean
def ring_limits(
    points: Array,
    rings: Array,
    first: Array,
    faces: Array,
    ends: Array,
    edges: Array,
    own: Array,
    weights: tuple[Array, Array, Array, Array],
    room: Array,
    result: Array,
) -> None:
    """Limits of semi-sharp vertices (n, d) by refining the `rings` around them, (n, 1 + 2 N).

    The arrays of ``refine/rings.py``; edges (n, N) and own (n,), how sharp they are, end as 0.
    `weights` are those of a face point (4,), of edge neighbours and face points in a smooth vertex
    (2,), of face points in edge points, of the ends in a midpoint and of neighbours along a crease
    (3,), and those of the ring in the limit. ``room`` (2, 1 + 2 N, d) is to work in. What refined
    points take over from `refined_points` is rounded as there, the rest operation by operation.
    """
    centre, smooth, limit = weights[0], weights[1], weights[3]
    near, far, half, beside = smooth[0], smooth[1], weights[2][1], weights[2][2]
    weight = weights[2][0] / 2 + weights[2][0] / 2
    N = faces.shape[1]
    d = points.shape[1]
    ring, fine = room[0], room[1]
    for i in range(len(rings)):
        for k in range(1 + 2 * N):
            for c in range(d):
                ring[k, c] = points[rings[i, k], c]
        level = 0
        while True:
            sharp = still = falling = 0
            for j in range(N):
                sharp += edges[i, j] > 0
                still += edges[i, j] > 1
            if sharp == 0 and not own[i] > 0:
                break
            order = ends[min(level, 1), i]
            total = 0.0
            for j in order:
                if 0 < edges[i, j] <= 1:
                    total += edges[i, j]
                    falling += 1
            if 0 < own[i] <= 1:
                total += own[i]
                falling += 1
            # rules as in ``rules.py``: smooth, dart, crease, corner
            parent = 3 if own[i] > 0 else min(sharp, 3)
            child = 3 if own[i] > 1 else min(still, 3)
            share = 1.0
            if parent != child and parent > 1:
                share = min(total / max(falling, 1), 1.0)
            rest = 1 - share
            own_share = 1.0 if parent <= 1 else rest if child <= 1 else 0.0
            for j in range(N):
                turn = 0 if level else first[i, j]
                for c in range(d):
                    fine[2 + 2 * j, c] = 0.0
                for k in range(4):
                    at = _in_ring(k - turn, j, N)
                    for c in range(d):
                        fine[2 + 2 * j, c] += centre[k] * ring[at, c]
            for c in range(d):
                fine[0, c] = 0.0
            for j in faces[i]:
                for c in range(d):
                    here = ring[0, c]
                    step = near * (ring[1 + 2 * j, c] - here) + far * (fine[2 + 2 * j, c] - here)
                    fine[0, c] += step
            for c in range(d):
                fine[0, c] += ring[0, c]
                fine[0, c] = _stepped(ring[0, c], own_share, fine[0, c] - ring[0, c])
            for j in order:
                size = edges[i, j]
                part = share if size > 0 and parent == 2 else 0.0
                if size > 1 and child == 2 and parent == 3:
                    part += rest
                if part != 0:
                    part *= beside
                    for c in range(d):
                        step = ring[1 + 2 * j, c] - ring[0, c]
                        fine[0, c] = _stepped(fine[0, c], part, step)
            for j in range(N):
                e, before = 1 + 2 * j, 2 * N if j == 0 else 2 * j
                size = edges[i, j]
                middle = min(size, 1.0)
                for c in range(d):
                    both = ring[0, c] + ring[e, c]
                    outer = (0.5 - weight) * both
                    found = outer + weight * (fine[e + 1, c] + fine[before, c])
                    if size > 0:
                        found = _mixed(middle, half * both, 1 - middle, found)
                    fine[e, c] = found
                edges[i, j] = max(size - 1, 0.0)
            own[i] = max(own[i] - 1, 0.0)
            ring, fine = fine, ring
            level += 1
        for c in range(d):
            step = 0.0
            for k in range(1, 1 + 2 * N):
                step = _stepped(step, limit[k], ring[k, c] - ring[0, c])
            result[i, c] = ring[0, c] + step


@inlined
def _collected(
    sums: Array, touched: Array, count: int, column: int, share: float, value: float
) -> int:
    """Add to a sum, which is taken down if it is new; the number of sums."""
    if touched[1, column] == 0:
        touched[1, column] = 1
        touched[0, count] = column
        count += 1
    sums[column] = _stepped(sums[column], share, value)
    return count


@lean
def ring_rows(
    masks: Array,
    numbers: Array,
    first: Array,
    place: Array,
    faces: Array,
    ends: Array,
    edges: Array,
    own: Array,
    weights: tuple[Array, Array, Array, Array],
    sums: Array,
    touched: Array,
    result: Array,
) -> None:
    """Masks of vertices once all is smooth as weights of the `rings` before, (m, n, 1 + 2 N).

    The arrays of ``refine/rings.py``; sharpness is whole. `numbers` (2, n, 1 + 2 N) lists the ring
    by the numbers of its vertices, in the mesh and in all refinements, ``place`` (n, N) where in
    `faces` each face is. `weights` are those of a face point (4,); of the vertex, its neighbours
    and face points in a smooth vertex (3,); of the vertex and its neighbours along a crease (2,);
    of the ends and face points in an edge point, and of the ends in a midpoint (3,). ``sums`` and
    ``touched`` (2, .) have room for 1 + 3 N. Added up in the order of the products of the sparse
    matrices of ``refine/limits.py``, each operation rounded by itself.
    """
    centre, smooth, crease, edge = weights[0], weights[1], weights[2], weights[3]
    N = faces.shape[1]
    R = 1 + 2 * N
    for i in range(len(edges)):
        depth = own[i]
        for j in range(N):
            depth = max(depth, edges[i, j])
        for which in range(len(masks)):
            row = result[which, i]
            for k in range(R):
                row[k] = masks[which, k]
            for level in range(int(depth) - 1, -1, -1):
                sharp = 3 if own[i] > level else 0
                for j in range(N):
                    sharp += edges[i, j] > level
                for k in range(R + N):
                    sums[k] = 0.0
                    touched[1, k] = 0
                count = 0
                for k in numbers[1, i]:
                    share = row[k]
                    if share == 0:
                        continue
                    j = (k - 1) >> 1
                    if k == 0:
                        if sharp > 2:
                            count = _collected(sums, touched, count, 0, share, 1.0)
                        elif sharp == 2:
                            count = _collected(sums, touched, count, 0, share, crease[0])
                            for e in ends[min(level, 1), i]:
                                if edges[i, e] > level:
                                    at = 1 + 2 * e
                                    count = _collected(sums, touched, count, at, share, crease[1])
                        else:
                            if smooth[0] != 0:
                                count = _collected(sums, touched, count, 0, share, smooth[0])
                            for f in faces[i]:
                                at = 1 + 2 * f
                                count = _collected(sums, touched, count, at, share, smooth[1])
                                count = _collected(sums, touched, count, R + f, share, smooth[2])
                    elif k & 1:
                        one, two = 0, k
                        if level == 0:
                            for at in numbers[0, i]:
                                if at == 0 or at == k:
                                    one, two = at, k - at
                                    break
                        weight = edge[2] if edges[i, j] > level else edge[0]
                        count = _collected(sums, touched, count, one, share, weight)
                        count = _collected(sums, touched, count, two, share, weight)
                        if not edges[i, j] > level:
                            before = N - 1 if j == 0 else j - 1
                            f, g = (j, before) if place[i, j] < place[i, before] else (before, j)
                            count = _collected(sums, touched, count, R + f, share, edge[1])
                            count = _collected(sums, touched, count, R + g, share, edge[1])
                    else:
                        count = _collected(sums, touched, count, R + j, share, 1.0)
                for k in range(R):
                    row[k] = 0.0
                for t in range(count - 1, -1, -1):
                    k = touched[0, t]
                    if k < R:
                        row[k] += sums[k]
                        continue
                    j = k - R
                    turn = 0 if level else first[i, j]
                    for corner in range(4):
                        at = _in_ring(corner - turn, j, N)
                        row[at] = _stepped(row[at], sums[k], centre[corner])


@lean
def limit_normals(
    points: Array,
    errors: Array,
    indices: Array,
    twin: Array,
    vertex_faces: Array,
    start: Array,
    masks: Array,
    corners: tuple[int, ...],
    seen: Array,
    result: Array,
) -> None:
    """Unit limit normals (V, 3) of the vertices but those already `seen`.

    By number of faces at a vertex, `start` is where two masks begin, over its edge neighbours and,
    in quads, face corners counter-clockwise, itself first; or -1. Faces have as many corners as
    `corners` is long. NaN where the vectors might be dependent
    within their rounding errors; `errors` are those of the points, as in the reference.
    """
    size = len(corners)
    stride = size - 2
    for vertex in range(len(points)):
        for c in range(3):
            result[vertex, c] = np.nan
    for first in range(len(indices)):
        vertex = indices[first]
        if seen[vertex]:
            continue
        seen[vertex] = True
        valence = vertex_faces[vertex]
        if start[valence] < 0:
            continue
        x, y, z = points[vertex, 0], points[vertex, 1], points[vertex, 2]
        ax = ay = az = bx = by = bz = noise = other_noise = 0.0
        h, at = first, start[valence] + 1
        beside = at + stride * valence + 1
        for _ in range(valence):
            begin = h // size * size
            for k in range(stride):
                other = indices[begin + (h - begin + 1 + k) % size]
                dx, dy, dz = points[other, 0] - x, points[other, 1] - y, points[other, 2] - z
                far = max(abs(dx), abs(dy), abs(dz)) + errors[vertex] + errors[other]
                a, b = masks[at + k], masks[beside + k]
                noise, other_noise = noise + abs(a) * far, other_noise + abs(b) * far
                ax, ay, az = ax + a * dx, ay + a * dy, az + a * dz
                bx, by, bz = bx + b * dx, by + b * dy, bz + b * dz
            at += stride
            beside += stride
            h = twin[begin + (h - begin + size - 1) % size]
        noise, other_noise = NOISE * noise, NOISE * other_noise
        # largest component first: neither overflow nor underflow in the squares
        a, b = max(abs(ax), abs(ay), abs(az)), max(abs(bx), abs(by), abs(bz))
        if not (a > noise and b > other_noise):
            continue
        ax, ay, az = ax / a, ay / a, az / a
        bx, by, bz = bx / b, by / b, bz / b
        scale = sqrt(ax * ax + ay * ay + az * az) * sqrt(bx * bx + by * by + bz * bz)
        nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        far = max(abs(nx), abs(ny), abs(nz))
        if not far > UNIT * (noise / a + other_noise / b) * scale:
            continue
        nx, ny, nz = nx / far, ny / far, nz / far
        scale = sqrt(nx * nx + ny * ny + nz * nz)
        result[vertex, 0], result[vertex, 1], result[vertex, 2] = nx / scale, ny / scale, nz / scale
