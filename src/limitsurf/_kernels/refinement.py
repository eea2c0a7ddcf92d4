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

from math import ceil, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels.doubt import NOISE, SCALED
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
    edges: Array,
    edge_corners: Array,
    vertex_faces: Array,
    masks: tuple[Array, Array],
    first: int,
    channels: tuple[int, ...],
    result: Array,
) -> None:
    """Smooth points of refined triangles, (V + E, d), midpoints at edges without a twin.

    `masks` are by number of faces at a vertex the weight of edge neighbours; and those of each end,
    and of each opposite corner, in edge points. Channels are as in `refined_points`. At a smooth
    vertex every edge has a twin: what its neighbours bring comes by edges.
    """
    weights, (end, across) = masks[0], (masks[1][0], masks[1][1])
    n_vertices, last = len(points), first + len(channels)
    for vertex in range(n_vertices):
        for c in range(first, last):
            result[vertex, c] = 0.0
    for edge in range(len(edges)):
        # unsigned: never counted from the end
        a, b = np.uint64(edges[edge, 0]), np.uint64(edges[edge, 1])
        h, other = edge_corners[edge, 0], edge_corners[edge, 1]
        if other < 0:
            for c in range(first, last):
                result[n_vertices + edge, c] = 0.5 * (points[a, c] + points[b, c])
            continue
        one = np.uint64(indices[h + 2 if h % 3 == 0 else h - 1])
        two = np.uint64(indices[other + 2 if other % 3 == 0 else other - 1])
        for c in range(first, last):
            p, q = points[a, c], points[b, c]
            result[a, c] += q - p
            result[b, c] += p - q
            ends = end * (p + q)
            result[n_vertices + edge, c] = ends + across * (points[one, c] + points[two, c])
    for vertex in range(n_vertices):
        near = weights[vertex_faces[vertex]]
        for c in range(first, last):
            result[vertex, c] = points[vertex, c] + near * result[vertex, c]


@unfused
def _stepped(value: float, share: float, difference: float) -> float:
    return value + share * difference


@unfused
def _mixed(share: float, value: float, other: float) -> float:
    return share * value + (1 - share) * other


@lean
def sharpened(
    points: Array,
    vertices: Array,
    smooth: Array,
    ends: Array,
    others: Array,
    along: Array,
    edges: Array,
    tails: Array,
    heads: Array,
    midpoints: Array,
    half: Array,
    result: Array,
) -> None:
    """Make refined points of smooth rules those of sharp ones, each operation rounded by itself.

    `vertices` (n,) move by a share towards their smooth points, and `ends` (m,) of sharp edges
    towards the `others`; `edges` (k,) from `tails` to `heads` have a share of their midpoints,
    where the weight of each end is ``half[0]``.
    """
    width = points.shape[1]
    for i in range(len(vertices)):
        vertex = vertices[i]
        for c in range(width):
            own = points[vertex, c]
            result[vertex, c] = _stepped(own, smooth[i], result[vertex, c] - own)
    for i in range(len(ends)):
        end, other = ends[i], others[i]
        for c in range(width):
            step = points[other, c] - points[end, c]
            result[end, c] = _stepped(result[end, c], along[i], step)
    for i in range(len(edges)):
        edge, tail, head = edges[i], tails[i], heads[i]
        for c in range(width):
            middle = half[0] * (points[tail, c] + points[head, c])
            result[edge, c] = _mixed(midpoints[i], middle, result[edge, c])


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
    for begin in range(0, len(indices), size):
        # unsigned: never counted from the end
        i, j = np.uint64(indices[begin]), np.uint64(indices[begin + 1])
        k, m = np.uint64(indices[begin + 2]), np.uint64(indices[begin + size - 1])
        one, two = vertex_faces[i], vertex_faces[j]
        three, four = vertex_faces[k], vertex_faces[m]
        for c in range(first, last):
            x, y, z, w = points[i, c], points[j, c], points[k, c], points[m, c]
            if size == 3:
                result[i, c] += weights[one, 0] * (y - x)
                result[j, c] += weights[two, 0] * (z - y)
                result[k, c] += weights[three, 0] * (x - z)
                continue
            step = weights[one, 0] * (y - x) + weights[one, 1] * (z - x)
            result[i, c] += step
            step = weights[two, 0] * (z - y) + weights[two, 1] * (w - y)
            result[j, c] += step
            step = weights[three, 0] * (w - z) + weights[three, 1] * (x - z)
            result[k, c] += step
            step = weights[four, 0] * (x - w) + weights[four, 1] * (y - w)
            result[m, c] += step
    for vertex in range(n_vertices):
        for c in range(first, last):
            result[vertex, c] += points[vertex, c]


@lean
def row_limits(
    points: Array, vertices: Array, starts: Array, columns: Array, weights: Array, result: Array
) -> None:
    """Limits of `vertices` (n,) by rows of weights on differences from them, into (V, d).

    Row i has the entries from ``starts[i]`` to ``starts[i + 1]``, of `columns` and `weights`. Each
    operation is rounded by itself.
    """
    for i in range(len(vertices)):
        vertex = vertices[i]
        for c in range(points.shape[1]):
            own, step = points[vertex, c], 0.0
            for k in range(starts[i], starts[i + 1]):
                step = _stepped(step, weights[k], points[columns[k], c] - own)
            result[vertex, c] = own + step


@lean
def ring_rows(
    masks: Array,
    edges: Array,
    own: Array,
    weights: Array,
    room: Array,
    result: Array,
) -> None:
    """Masks of vertices once all is smooth as weights of the rings before, (m, n, 1 + 2 N).

    Of how sharp the edges (n, N) and the vertices (n,) are. `weights` (6,) are those of a corner in
    its face point; of edge neighbours and face points in a smooth vertex; of face points in an edge
    point; of the ends in a midpoint; and of neighbours along a crease. ``room`` (2, 1 + 2 N) is to
    work in.
    """
    centre, near, far = weights[0], weights[1], weights[2]
    across, half, beside = weights[3], weights[4], weights[5]
    N = edges.shape[1]
    row, faces = room[0], room[1]
    for i in range(len(edges)):
        deepest = own[i]
        for j in range(N):
            deepest = max(deepest, edges[i, j])
        for which in range(len(masks)):
            for k in range(1 + 2 * N):
                result[which, i, k] = masks[which, k]
        for level in range(ceil(deepest) - 1, -1, -1):
            sharp = still = falling = 0
            total = 0.0
            for j in range(N):
                size = edges[i, j] - level
                sharp += size > 0
                still += size > 1
                if 0 < size <= 1:
                    total += size
                    falling += 1
            size = own[i] - level
            if 0 < size <= 1:
                total += size
                falling += 1
            # rules as in ``rules.py``: smooth, dart, crease, corner
            parent = 3 if size > 0 else min(sharp, 3)
            child = 3 if size > 1 else min(still, 3)
            share = 1.0
            if parent != child and parent > 1:
                share = min(total / max(falling, 1), 1.0)
            rest = 1 - share
            smooth = 1.0 if parent <= 1 else rest if child <= 1 else 0.0
            for which in range(len(masks)):
                after = result[which, i]
                middle = after[0]  # what is left for the vertex: its weights add up to this
                for j in range(N):
                    give = after[0] * smooth * far
                    faces[j] = after[2 + 2 * j] + give
                    middle -= give
                for j in range(N):
                    size = edges[i, j] - level
                    part = share if size > 0 and parent == 2 else 0.0
                    if size > 1 and child == 2 and parent == 3:
                        part += rest
                    give = after[0] * (smooth * near + part * beside)
                    middle -= give
                    # of an edge point, so much is a midpoint
                    whole = after[1 + 2 * j]
                    straight = min(max(size, 0.0), 1.0) * whole
                    curved = whole - straight
                    ends = half * straight + (0.5 - across) * curved
                    middle += ends
                    row[1 + 2 * j] = give + ends
                    faces[j] += across * curved
                    faces[N - 1 if j == 0 else j - 1] += across * curved
                for j in range(N):
                    give = centre * faces[j]
                    middle += give
                    row[1 + 2 * j] += give
                    row[2 + 2 * j] = give
                    row[1 if j == N - 1 else 3 + 2 * j] += give
                row[0] = middle
                for k in range(1 + 2 * N):
                    after[k] = row[k]


@inlined
def _after(h: int, k: int, size: int) -> int:
    """The k-th half-edge after h in its face of so many corners, 3 or 4."""
    if size == 4:
        return h & ~3 | (h + k & 3)
    begin = h // 3 * 3
    return begin + (h - begin + k) % 3


# of vectors whose products neither overflow nor underflow
_LEAST, _MOST = 1e-60, 1e60


@inlined
def _unit_normal(
    a: tuple[float, float, float], b: tuple[float, float, float], noise: tuple[float, float]
) -> tuple[bool, float, float, float]:
    """Whether there is no doubt of the unit vector along a x b, and that vector.

    A sufficient condition: no component is asked about, only the largest ones of a and b, which
    are at least 1 / sqrt(3) of their lengths.
    """
    nx, ny, nz = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    one, two = max(abs(a[0]), abs(a[1]), abs(a[2])), max(abs(b[0]), abs(b[1]), abs(b[2]))
    fine = min(one, two) > _LEAST and max(one, two) < _MOST
    fine &= one > noise[0] and two > noise[1]
    fine &= max(abs(nx), abs(ny), abs(nz)) > SCALED * (noise[0] * two + noise[1] * one)
    scale = 1 / sqrt(nx * nx + ny * ny + nz * nz)
    return fine, nx * scale, ny * scale, nz * scale


@inlined
def _noise(x: float, y: float, z: float, largest: float, rounded: int) -> float:
    """Bound of the errors of differences from a point, by the largest, as in the reference.

    A point is in error by its own size, if it is `rounded`, and others by that and the difference.
    One per mille is for the rounding of this bound.
    """
    own = rounded * max(abs(x), abs(y), abs(z))
    return 1.001 * NOISE * ((1 + rounded) * largest + 2 * own)


@lean
def limit_normals(
    points: Array,
    rounded: int,
    indices: Array,
    twin: Array,
    vertex_faces: Array,
    start: Array,
    masks: Array,
    corners: tuple[int, ...],
    seen: Array,
    ring: Array,
    doubtful: Array,
    result: Array,
) -> int:
    """Unit limit normals, (H, 3), at the corners of the vertices but those already `seen`.

    By number of faces at a vertex, `start` is where two masks begin: the sums of their sizes, -1 if
    there are none, then pairs of weights of its edge neighbours and, in quads, face corners
    counter-clockwise. Faces have as many corners as `corners` is long. ``ring`` has room for the
    largest number of faces. ``rounded`` is 1 where points are rounded, and 0 of a cage. Normals are
    NaN where there are no masks, and at vertices that become `doubtful` (V,), as many as are
    returned, where the reference has to decide whether there is one.
    """
    size = len(corners)
    count = 0
    for first in range(len(indices)):
        vertex = indices[first]
        if seen[vertex]:
            continue
        seen[vertex] = True
        valence = vertex_faces[vertex]
        x, y, z = points[vertex, 0], points[vertex, 1], points[vertex, 2]
        ax = ay = az = bx = by = bz = largest = 0.0
        h, at = first, start[valence]
        one, two = masks[at], masks[at + 1]
        for j in range(valence):
            ring[j] = h
            for k in range(size - 2):
                other = np.uint64(indices[_after(h, 1 + k, size)])
                dx, dy, dz = points[other, 0] - x, points[other, 1] - y, points[other, 2] - z
                largest = max(largest, max(abs(dx), abs(dy), abs(dz)))
                at += 2
                a, b = masks[at], masks[at + 1]
                ax, ay, az = ax + a * dx, ay + a * dy, az + a * dz
                bx, by, bz = bx + b * dx, by + b * dy, bz + b * dz
            h = twin[_after(h, size - 1, size)]
        noise = _noise(x, y, z, largest, rounded)
        noises = one * noise, two * noise
        fine, nx, ny, nz = _unit_normal((ax, ay, az), (bx, by, bz), noises)
        if not fine:
            nx = ny = nz = np.nan
            if one >= 0:
                doubtful[vertex] = True
                count += 1
        for j in range(valence):
            corner = np.uint64(ring[j])
            result[corner, 0], result[corner, 1], result[corner, 2] = nx, ny, nz
    return count


@lean
def row_normals(
    points: Array,
    rounded: int,
    vertices: Array,
    starts: Array,
    columns: Array,
    weights: Array,
    state: Array,
    corner_starts: Array,
    corners: Array,
    doubtful: Array,
    result: Array,
) -> int:
    """Unit limit normals in n sectors by rows of pairs of weights, as those of `limit_normals`.

    `vertices` (n,) are where they are, and `weights` (., 2) are on differences from these, as in
    `row_limits`; `corners` from ``corner_starts[i]`` on are what they consist of. In `state` (n,) 0
    there is a normal along the cross product; in 1 there is none, but that there may be one where
    one of the vectors is 0; in 2 there is none.
    """
    count = 0
    for i in range(len(vertices)):
        vertex = vertices[i]
        x, y, z = points[vertex, 0], points[vertex, 1], points[vertex, 2]
        ax = ay = az = bx = by = bz = largest = one = two = 0.0
        for k in range(starts[i], starts[i + 1]):
            other, a, b = columns[k], weights[k, 0], weights[k, 1]
            dx, dy, dz = points[other, 0] - x, points[other, 1] - y, points[other, 2] - z
            largest = max(largest, max(abs(dx), abs(dy), abs(dz)))
            one, two = one + abs(a), two + abs(b)
            ax, ay, az = ax + a * dx, ay + a * dy, az + a * dz
            bx, by, bz = bx + b * dx, by + b * dy, bz + b * dz
        noise = _noise(x, y, z, largest, rounded)
        one, two = one * noise, two * noise
        fine, nx, ny, nz = _unit_normal((ax, ay, az), (bx, by, bz), (one, two))
        lost = not fine
        if state[i] == 1:
            lost = max(abs(ax), abs(ay), abs(az)) <= one or max(abs(bx), abs(by), abs(bz)) <= two
        if state[i] < 2 and lost:
            doubtful[vertex] = True
            count += 1
        if state[i] > 0 or not fine:
            nx = ny = nz = np.nan
        for k in range(corner_starts[i], corner_starts[i + 1]):
            h = corners[k]
            result[h, 0], result[h, 1], result[h, 2] = nx, ny, nz
    return count
