"""Compiled connectivity of faces: corners at vertices, twins, fans, edges, and regular patches.

Corners are numbered face by face, H in all. ``tail`` (H,) is the vertex of each. ``size`` is 3 or 4
for meshes of triangles or quads alone; else ``after`` and ``before`` (H,) are the next and the
previous corner of the same face. ``starts`` (V + 1,) and ``corners`` (H,) are what `around` gives,
``twin`` (H,) what `twins` does. Other given integers have 64 bits; H is less than 2^31. Everything
is linear in H, but for the sorting of the neighbours of each vertex in `edges`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels.jit import inlined, kernel

Array = NDArray[Any]
# size, after, before
Steps = tuple[int, Array, Array]


@inlined
def _following(corner: int, size: int, after: Array) -> Any:
    if size == 4:
        return corner & ~3 | corner + 1 & 3
    if size == 3:
        return corner + 1 - 3 * (corner % 3 == 2)
    return after[corner]


@inlined
def _preceding(corner: int, size: int, before: Array) -> Any:
    if size == 4:
        return corner & ~3 | corner - 1 & 3
    if size == 3:
        return corner - 1 + 3 * (corner % 3 == 0)
    return before[corner]


def around(tail: Array, offsets: Array, n_vertices: int) -> tuple[Array, Array, bool]:
    """The corners at each vertex, ascending, and whether a face has a vertex more than once.

    ``offsets`` (F + 1,) are the first corners of the faces.
    """
    starts = np.zeros(n_vertices + 1, np.int64)
    corners = np.empty(len(tail), np.int32)
    repeats = _around(tail, offsets, starts, np.empty(n_vertices, np.int32), corners)
    return starts, corners, bool(repeats)


@kernel
def _around(tail: Array, offsets: Array, starts: Array, place: Array, corners: Array) -> bool:
    for vertex in tail:
        starts[vertex + 1] += 1
    for vertex in range(len(place)):
        place[vertex] = starts[vertex]
        starts[vertex + 1] += starts[vertex]
    repeats = False
    for face in range(len(offsets) - 1):
        for corner in range(offsets[face], offsets[face + 1]):
            vertex = tail[corner]
            here = place[vertex]
            repeats |= here > starts[vertex] and corners[here - 1] >= offsets[face]
            corners[here] = corner
            place[vertex] = here + 1
    return repeats


def values(rows: Array, starts: Array, corners: Array) -> tuple[Array, Array, Array]:
    """Vertices and rows of the values of a channel, and the value at each corner (H,).

    A value is a pair of a vertex and one of the ``rows`` (H,) at its corners; they are ordered.
    """
    vertex, row = np.empty((2, len(rows)), np.int64)
    value, keys = np.empty(len(rows), np.int64), np.empty(np.diff(starts).max(), np.int64)
    count = _values(rows, starts, corners, keys, vertex, row, value)
    return vertex[:count].copy(), row[:count].copy(), value


@kernel
def _values(
    rows: Array,
    starts: Array,
    corners: Array,
    keys: Array,
    vertices: Array,
    found: Array,
    value: Array,
) -> int:
    count = 0
    for vertex in range(len(starts) - 1):
        begin, n = starts[vertex], starts[vertex + 1] - starts[vertex]
        # rows may have more than 32 bits: their order first, then the corners that have them
        for k in range(n):
            keys[k] = rows[corners[begin + k]]
        _sort(keys, n)
        first = count
        for k in range(n):
            if k == 0 or keys[k] != keys[k - 1]:
                vertices[count], found[count] = vertex, keys[k]
                count += 1
        for k in range(n):
            low, high = first, count - 1
            row = rows[corners[begin + k]]
            while low < high:
                middle = (low + high) // 2
                if found[middle] < row:
                    low = middle + 1
                else:
                    high = middle
            value[corners[begin + k]] = low
    return count


def twins(tail: Array, steps: Steps, starts: Array, corners: Array) -> Array:
    """The half-edge in the opposite direction, (H,); -1 unless there is just one in each.

    No face may have a vertex more than once.
    """
    result = np.empty(len(tail), np.int64)
    room = np.full((2, len(starts) - 1), -1, np.int32)
    _twins(tail, *steps, starts, corners, room[0], room[1], result)
    return result


@kernel
def _twins(
    tail: Array,
    size: int,
    after: Array,
    before: Array,
    starts: Array,
    corners: Array,
    leaving: Array,
    entering: Array,
    result: Array,
) -> None:
    # half-edges from the current vertex to another, and back: -1 none, -2 several
    for vertex in range(len(starts) - 1):
        for k in range(starts[vertex], starts[vertex + 1]):
            corner = corners[k]
            head = tail[_following(corner, size, after)]
            leaving[head] = corner if leaving[head] == -1 else -2
            earlier = _preceding(corner, size, before)
            head = tail[earlier]
            entering[head] = earlier if entering[head] == -1 else -2
        found = 0
        for k in range(starts[vertex], starts[vertex + 1]):
            corner = corners[k]
            head = tail[_following(corner, size, after)]
            result[corner] = -1
            if leaving[head] >= 0 and entering[head] >= 0:
                result[corner] = entering[head]
                entering[head] = -1
                found += 1
            leaving[head] = -1
        if found < starts[vertex + 1] - starts[vertex]:
            for k in range(starts[vertex], starts[vertex + 1]):
                entering[tail[_preceding(corners[k], size, before)]] = -1


def valences(steps: Steps, twin: Array, starts: Array, corners: Array) -> Array:
    """The number of faces at each vertex, (V,); negative on a rim, 0 where they form no one fan."""
    result = np.empty(len(starts) - 1, np.int64)
    _valences(*steps, twin, starts, corners, result)
    return result


@kernel
def _valences(
    size: int,
    after: Array,
    before: Array,
    twin: Array,
    starts: Array,
    corners: Array,
    result: Array,
) -> None:
    for vertex in range(len(result)):
        begin, end = starts[vertex], starts[vertex + 1]
        result[vertex] = _valence(size, after, before, twin, corners, begin, end)


@inlined
def _valence(
    size: int, after: Array, before: Array, twin: Array, corners: Array, begin: int, end: int
) -> int:
    count = end - begin
    if count == 0:
        return 0
    first = corners[begin]
    found, corner = 1, twin[_preceding(first, size, before)]
    while corner >= 0 and corner != first:
        found, corner = found + 1, twin[_preceding(corner, size, before)]
    sign = 1
    if corner < 0:
        sign, corner = -1, twin[first]
        while corner >= 0:
            found, corner = found + 1, twin[_following(corner, size, after)]
    return sign * count if found == count else 0


def fans(steps: Steps, twin: Array, starts: Array, corners: Array) -> tuple[Array, ...]:
    """The members of `Fans`: vertex, closed, offsets, corners, fan, position."""
    n = len(twin)
    # as many fans as corners at most
    vertex, closed, offsets = np.empty(n, np.int64), np.empty(n, bool), np.zeros(n + 1, np.int64)
    ordered, fan, position = np.empty(n, np.int64), np.full(n, -1), np.empty(n, np.int64)
    result = vertex, closed, offsets, ordered, fan, position
    count = _fans(*steps, twin, starts, corners, *result)
    return vertex[:count], closed[:count], offsets[: count + 1], ordered, fan, position


@kernel
def _fans(
    size: int,
    after: Array,
    before: Array,
    twin: Array,
    starts: Array,
    corners: Array,
    vertices: Array,
    closed: Array,
    offsets: Array,
    ordered: Array,
    fan: Array,
    position: Array,
) -> int:
    count, done = 0, 0
    for vertex in range(len(starts) - 1):
        for k in range(starts[vertex], starts[vertex + 1]):
            first = corners[k]
            if fan[first] != -1:
                continue
            corner = first
            # clockwise, back to here or to the first corner of a fan that comes later
            while twin[corner] >= 0 and fan[corner] == -1:
                fan[corner] = -2
                corner = _following(twin[corner], size, after)
            if corner != first:
                continue
            vertices[count], closed[count] = vertex, twin[first] >= 0
            start = done
            while True:
                fan[corner], position[corner], ordered[done] = count, done - start, corner
                done += 1
                corner = twin[_preceding(corner, size, before)]
                if corner < 0 or corner == first:
                    break
            count += 1
            offsets[count] = done
    return count


def edges(
    tail: Array, steps: Steps, twin: Array | None, starts: Array, corners: Array
) -> tuple[Array, Array, Array, tuple[Array, ...]]:
    """Vertices of all edges (E, 2), edge of each corner (H,), half-edges of each edge (E, 2).

    Rows and their order are those of `Mesh.edges` and `Mesh.edge_corners`. Twins that are not given
    are found on the way, and `valences`: both come last, as those functions give them.
    """
    fresh, n, V = twin is None, len(tail), len(starts) - 1
    most = n if twin is None else int(np.count_nonzero(twin < np.arange(n)))
    # at once, which costs less; memory beyond what is found is never touched
    counts = [n, fresh * n, fresh * V, 2 * most, 2 * most]
    corner_edge, *more, ends, sides = _parted(np.empty(sum(counts), np.int64), counts)
    ends, sides = ends.reshape(most, 2), sides.reshape(most, 2)
    room = np.empty(2 * np.diff(starts).max(), np.int64)
    known = more[0] if twin is None else twin, more[1], starts, corners
    count = _edges(tail, *steps, fresh, *known, room, ends, corner_edge, sides)
    return ends[:count], corner_edge, sides[:count], tuple(more) if fresh else ()


def _parted(array: Array, counts: list[int]) -> list[Array]:
    """Parts of an array, of so many entries each."""
    return np.split(array, np.cumsum(counts)[:-1])


@kernel
def _edges(
    tail: Array,
    size: int,
    after: Array,
    before: Array,
    fresh: bool,
    twin: Array,
    valence: Array,
    starts: Array,
    corners: Array,
    keys: Array,
    ends: Array,
    corner_edge: Array,
    edge_corners: Array,
) -> int:
    edge = -1
    for vertex in range(len(starts) - 1):
        # half-edges between this vertex and higher ones: that one's number, then their own
        n = 0
        for k in range(starts[vertex], starts[vertex + 1]):
            corner = corners[k]
            other = tail[_following(corner, size, after)]
            if other > vertex:
                keys[n] = other << 32 | corner
                n += 1
            earlier = _preceding(corner, size, before)
            other = tail[earlier]
            if other > vertex:
                keys[n] = other << 32 | earlier
                n += 1
        _sort(keys, n)
        last = -1
        for k in range(n):
            other, corner = keys[k] >> 32, keys[k] & 0xFFFFFFFF
            if other != last:
                last = other
                edge += 1
                if fresh:
                    twin[corner] = -1
                    if k + 1 < n and keys[k + 1] >> 32 == other:
                        second = keys[k + 1] & 0xFFFFFFFF
                        alone = k + 2 == n or keys[k + 2] >> 32 != other
                        if alone and (tail[corner] == vertex) != (tail[second] == vertex):
                            twin[corner] = second
                ends[edge, 0], ends[edge, 1] = vertex, other
                edge_corners[edge, 0], edge_corners[edge, 1] = corner, twin[corner]
            elif fresh:
                first = edge_corners[edge, 0]
                twin[corner] = first if twin[first] == corner else -1
            corner_edge[corner] = edge
        if fresh:  # twins of all half-edges here are known by now
            begin, end = starts[vertex], starts[vertex + 1]
            valence[vertex] = _valence(size, after, before, twin, corners, begin, end)
    return edge + 1


@inlined
def _sort(keys: Array, n: int) -> None:
    """Sort the first n in place, by Shell's method."""
    gap = 1
    while 9 * gap < n:
        gap = 3 * gap + 1
    while gap:
        for k in range(gap, n):
            key = keys[k]
            while k >= gap and keys[k - gap] > key:
                keys[k] = keys[k - gap]
                k -= gap
            keys[k] = key
        gap //= 3


def part(
    wanted: Array, tail: Array, offsets: Array, twin: Array, n_vertices: int
) -> tuple[Array, Array, Array, Array, Array]:
    """The faces that have one of the wanted corners (H,), as a mesh of their own.

    Faces, corners and vertices, each ascending, then tails and twins of the part. ``offsets``
    (F + 1,) are the first corners of the faces; there are none if all are quads.
    """
    n = len(tail)
    # memory beyond what is found is never touched
    faces, corners = np.empty(n // 3 + 1, np.int64), np.empty(n, np.int64)
    vertices, number = np.empty(n_vertices, np.int64), np.zeros(n_vertices, np.int32)
    place, counts = np.empty(n, np.int32), np.zeros(3, np.int64)
    _part(wanted, tail, offsets, faces, corners, vertices, number, place, counts)
    faces, corners, vertices = (
        x[:k].copy() for x, k in zip((faces, corners, vertices), counts.tolist(), strict=True)
    )
    tails, twins = np.empty((2, len(corners)), np.int64)
    _renumber(tail, twin, corners, number, place, tails, twins)
    return faces, corners, vertices, tails, twins


@kernel
def _part(
    wanted: Array,
    tail: Array,
    offsets: Array,
    faces: Array,
    corners: Array,
    vertices: Array,
    number: Array,
    place: Array,
    counts: Array,
) -> None:
    quads = len(offsets) == 0
    count = found = 0
    for face in range(len(tail) // 4 if quads else len(offsets) - 1):
        begin = 4 * face if quads else offsets[face]
        end = begin + 4 if quads else offsets[face + 1]
        any_wanted = False
        for corner in range(begin, end):
            any_wanted |= wanted[corner]
        if any_wanted:
            faces[count] = face
            count += 1
            for corner in range(begin, end):
                corners[found], place[corner] = corner, found
                number[tail[corner]] = 1
                found += 1
    counts[0], counts[1] = count, found
    count = 0
    for vertex in range(len(number)):
        if number[vertex]:
            vertices[count], number[vertex] = vertex, count
            count += 1
    counts[2] = count


@kernel
def _renumber(
    tail: Array,
    twin: Array,
    corners: Array,
    number: Array,
    place: Array,
    tails: Array,
    twins: Array,
) -> None:
    for k in range(len(corners)):
        tails[k] = number[tail[corners[k]]]
        other = twin[corners[k]]
        here = place[other] if other >= 0 else -1
        # places of corners outside are whatever was there
        inside = here >= 0 and here < len(corners) and corners[here] == other
        twins[k] = here if inside else -1


def smooth_faces(
    tail: Array, size: int, regular: int, first: Array, turn: Array, valence: Array
) -> tuple[Array, Array]:
    """Which faces are one smooth patch: see `patches.neighbourhood.smooth_faces`."""
    found, start = np.empty(len(first), np.int32), np.empty(len(first), np.int8)
    _smooth_faces(tail, size, regular, first, turn, valence, found, start)
    return found, start


@kernel
def _smooth_faces(
    tail: Array,
    size: int,
    regular: int,
    first: Array,
    turn: Array,
    valence: Array,
    found: Array,
    start: Array,
) -> None:
    for face in range(len(first)):
        special, place = regular, (size - turn[face]) % size
        for k in range(size):
            here = valence[tail[first[face] + k]]
            if here != regular:
                special, place = (here, k) if special == regular else (0, 0)
                if special == 0:
                    break
        found[face] = special
        start[face] = place if special else 0


def grids(tail: Array, steps: Steps, twin: Array, first: Array, start: Array) -> Array:
    """Vertices of and around quads, (n, 16): see `patches.grids`."""
    result = np.empty((len(first), 16), np.int32)
    _grids(tail, *steps, twin, first, start, result)
    return result


@kernel
def _grids(
    tail: Array,
    size: int,
    after: Array,
    before: Array,
    twin: Array,
    first: Array,
    start: Array,
    result: Array,
) -> None:
    for face in range(len(first)):
        _grid(tail, size, after, before, twin, first[face], start[face], result, face)


@inlined
def _grid(
    tail: Array,
    size: int,
    after: Array,
    before: Array,
    twin: Array,
    first: int,
    start: int,
    result: Array,
    row: int,
) -> None:
    for k in range(4):
        corner = first + (start + k & 3)
        result[row, _OWN[k]] = tail[corner]
        other = twin[corner]
        across = beside = beyond = -1
        if other >= 0:
            leaving = _following(other, size, after)
            across = tail[_following(leaving, size, after)]
            beside = tail[_preceding(other, size, before)]
            other = twin[leaving]
            if other >= 0:
                beyond = tail[_preceding(other, size, before)]
        result[row, _ACROSS[k]] = across
        result[row, _BESIDE[k]] = beside
        result[row, _BEYOND[k]] = beyond


# by side of the quad: its corner, the vertices across it beside its corners, that beyond its corner
_OWN, _ACROSS, _BESIDE, _BEYOND = (5, 6, 10, 9), (1, 7, 14, 8), (2, 11, 13, 4), (0, 3, 15, 12)


def specials(
    tail: Array,
    steps: Steps,
    twin: Array,
    first: Array,
    start: Array,
    valence: int,
    outer: Array,
) -> Array:
    """Vertices around the starting corners, and others of the grids: see `patches.specials`."""
    result = np.empty((len(first), 2 * valence + 1 + len(outer)), np.int32)
    room = np.empty((1, 16), np.int32)
    _specials(tail, *steps, twin, first, start, valence, outer, room, result)
    return result


@kernel
def _specials(
    tail: Array,
    size: int,
    after: Array,
    before: Array,
    twin: Array,
    first: Array,
    start: Array,
    valence: int,
    outer: Array,
    room: Array,
    result: Array,
) -> None:
    for face in range(len(first)):
        corner = first[face] + start[face]
        result[face, 0] = tail[corner]
        for j in range(valence):
            leaving = _following(corner, size, after)
            result[face, 2 * j + 1] = tail[leaving]
            result[face, 2 * j + 2] = tail[_following(leaving, size, after)]
            corner = twin[_preceding(corner, size, before)]
        _grid(tail, size, after, before, twin, first[face], start[face], room, 0)
        for j in range(len(outer)):
            result[face, 2 * valence + 1 + j] = room[0, outer[j]]


def stars(
    tail: Array, steps: Steps, twin: Array, first: Array, start: Array, own: Array, around: Array
) -> Array:
    """Vertices of and around triangles, (n, places): see `patches.neighbourhood.templates`.

    ``own`` (3,) and ``around`` (3, 6) are the places of the corners, and of what is around each.
    """
    result = np.full((len(first), around.max() + 1), -1, np.int32)
    _stars(tail, *steps, twin, first, start, own, around, result)
    return result


@kernel
def _stars(
    tail: Array,
    size: int,
    after: Array,
    before: Array,
    twin: Array,
    first: Array,
    start: Array,
    own: Array,
    around: Array,
    result: Array,
) -> None:
    for face in range(len(first)):
        for k in range(3):
            corner = first[face] + (start[face] + k) % 3
            result[face, own[k]] = tail[corner]
            # counter-clockwise, and clockwise where that does not come back
            here, earlier, j = corner, corner, 0
            while here >= 0 and j < 6:
                result[face, around[k, j]] = tail[_following(here, size, after)]
                earlier = _preceding(here, size, before)
                here, j = twin[earlier], j + 1
            result[face, around[k, j % 6]] = tail[earlier]
            if here != corner:
                here, j = corner, 6
                result[face, around[k, 1]] = tail[_preceding(here, size, before)]
                while here >= 0 and j > 0:
                    result[face, around[k, j % 6]] = tail[_following(here, size, after)]
                    if j < 6:
                        result[face, around[k, (j + 1) % 6]] = tail[_preceding(here, size, before)]
                    here, j = twin[here], j - 1
                    if here >= 0:
                        here = _following(here, size, after)


def rings(tail: Array, steps: Steps, twin: Array, corners: Array, valence: int) -> Array:
    """Vertices of triangles around corners: that there, then their edge neighbours."""
    result = np.empty((len(corners), valence + 1), np.int32)
    _rings(tail, *steps, twin, corners, result)
    return result


@kernel
def _rings(
    tail: Array, size: int, after: Array, before: Array, twin: Array, corners: Array, result: Array
) -> None:
    for row in range(len(corners)):
        corner = corners[row]
        result[row, 0] = tail[corner]
        for j in range(1, result.shape[1]):
            result[row, j] = tail[_following(corner, size, after)]
            corner = twin[_preceding(corner, size, before)]


def sharp_faces(
    tail: Array,
    steps: Steps,
    twin: Array,
    fan: Array,
    state: Array,
    around: Array,
    edges: Array,
    through: Array,
    first: Array,
    turn: Array,
) -> tuple[Array, Array]:
    """What kind of patch quads at sharp edges are: see `patches.neighbourhood.sharp_faces`."""
    found, start = np.empty(len(first), np.int8), np.empty(len(first), np.int8)
    known = fan, state, around, edges, through, first, turn
    _sharp_faces(tail, *steps, twin, *known, found, start)
    return found, start


@kernel
def _sharp_faces(
    tail: Array,
    size: int,
    after: Array,
    before: Array,
    twin: Array,
    fan: Array,
    state: Array,
    around: Array,
    edges: Array,
    through: Array,
    first: Array,
    turn: Array,
    found: Array,
    start: Array,
) -> None:
    for face in range(len(first)):
        found[face] = start[face] = 0
        special = regular = side = soft = here = 0
        for k in range(4):
            corner = first[face] + k
            here = state[fan[corner]]
            if here == _MIXED:
                break
            regular += here == _REGULAR
            if here == _SPECIAL:
                special, start[face] = special + 1, k
            if edges[corner] > 0:
                soft, side = soft + 1, k
        if here == _MIXED:
            start[face] = 0
        elif regular == 4:
            found[face], start[face] = 1, -turn[face] & 3
        elif regular == 3 and special == 1:
            found[face] = 2
        elif regular >= 2 and soft == 1:
            code = edges[first[face] + side]
            fine = True
            for k in range(2, 4):
                fine &= state[fan[first[face] + (side + k & 3)]] == _REGULAR
            for k in range(2):
                corner = first[face] + (side + k & 3)
                fine &= around[fan[corner]] == 4 and through[tail[corner]] == code
                # opposite to the side: two edges on from it, three from the face's next edge
                if fine:
                    for _ in range(2 + k):
                        corner = twin[_preceding(corner, size, before)]
                    fine = edges[corner] == code
            found[face], start[face] = (3, side) if fine else (0, 0)
        else:
            start[face] = 0


# states of fans: with others than quads, semi-sharp, the special corner of a patch, or regular
_MIXED, _PENDING, _SPECIAL, _REGULAR = -1, 0, 1, 2
