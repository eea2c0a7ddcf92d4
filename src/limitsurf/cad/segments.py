"""Segments between faces, from the cage's half-edges alone: what both faces along them name alike.

Sides of limit faces are cut into edges of the cage, halves of those that a split face is beside,
and the ways from their middles to the middles of faces; those of triangles in parts where the
corner of any part is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from limitsurf.cage.mesh import Mesh
from limitsurf.query.records import numbered
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_WHOLE, _FIRST, _SECOND, _SPOKE = range(4)  # kinds of segments
_UNIT = 1 << 50  # steps along the sides of limit faces of triangles


@dataclass(frozen=True)
class Uses:
    """Segments around faces, (U,), in order: sides of faces, and where along these they are."""

    face: Array
    side: Array
    low: Array
    high: Array
    key: Array  # of the segment
    sign: Array  # 1 if it is used as its key says, else -1
    begin: Array  # numbers of vertices
    end: Array
    cage: Array  # the half-edge of the cage, for messages; -1 on ways to middles


class Sides:
    """Segments of all sides of limit faces."""

    def __init__(self, surface: LimitSurface, limit_faces: Array) -> None:
        self.mesh = mesh = surface.mesh
        self.lattice = surface.topology.lattice
        self.size = self.lattice.face_size
        known = surface.limit_faces
        corner = known.corner
        self.whole = corner < 0
        self.half = mesh.offsets[known.face] + np.maximum(corner, 0)
        self.face = known.face
        self.split = np.zeros(mesh.n_edges, dtype=bool)
        self.split[mesh.corner_edge[np.repeat(mesh.sizes != self.size, mesh.sizes)]] = True
        there = np.zeros(mesh.n_faces, dtype=bool)
        there[known.face[limit_faces]] = True
        self.there = there
        self.part, self.twin = _parts(mesh, there)

    def segments(self, limit_face: Array, side: Array) -> tuple[Array, Array, Array]:
        """Half-edges (Q,) and kinds (Q, 2) of one or two segments of each side, and how many.

        Half-edges are those of the face itself, kinds as seen along them. A way between the middle
        of an edge and that of a face is of the face's half-edge there.
        """
        mesh, half = self.mesh, self.half[limit_face]
        whole = self.whole[limit_face]
        own = np.where(whole, half + side, half)
        back = ~whole & (side >= 2)
        own = np.where(back, mesh.previous_corner[half], own)
        kind = np.where(whole, _WHOLE, np.choose(side % 4, [_FIRST, _SPOKE, _SPOKE, _SECOND]))
        two = whole & self.split[mesh.corner_edge[own]]
        kinds = np.stack([np.where(two, _FIRST, kind), np.full(len(own), _SECOND)], axis=1)
        return own, kinds, 1 + two

    def keys(self, half: Array, kind: Array, side: Array) -> tuple[Array, Array]:
        """Numbers of segments, the same from both of their sides, and directions."""
        twin = self.twin[half]
        spoke = kind == _SPOKE
        flip = (twin >= 0) & (twin < half) & ~spoke
        own = np.where(flip, twin, half)
        turned = np.where(flip & (kind > 0), _FIRST + _SECOND - kind, kind)
        sign = np.where(flip | (spoke & (side == 2)), -1, 1)
        return 4 * own + turned, sign

    def ends(self, half: Array, kind: Array, side: Array) -> tuple[Array, Array]:
        """Numbers of the vertices at which segments begin and end.

        Of the cage's vertices one in each part, then middles of half-edges, then of faces.
        """
        mesh, part = self.mesh, self.part[self.mesh.corner_face[half]]
        vertices = mesh.n_vertices * (int(self.part.max(initial=0)) + 1)
        at = part * mesh.n_vertices
        start, end = at + mesh.indices[half], at + mesh.indices[mesh.next_corner[half]]
        twin = self.twin[half]
        middle = vertices + np.where(twin >= 0, np.minimum(half, twin), half)
        centre = vertices + mesh.n_corners + mesh.corner_face[half]
        begin = np.where(kind == _SECOND, middle, start)
        stop = np.where(kind == _FIRST, middle, end)
        spoke, back = kind == _SPOKE, side == 2
        begin = np.where(spoke, np.where(back, centre, middle), begin)
        stop = np.where(spoke, np.where(back, middle, centre), stop)
        return begin, stop


def _parts(mesh: Mesh, there: Array) -> tuple[Array, Array]:
    """The connected part of each face, and twins, of such half-edges alone that have a face there.

    Where more than two faces meet at an edge it is open, but in parts of which just two faces,
    which pass it both ways, are there.
    """
    own = there[mesh.corner_face]
    twin = np.where(own, mesh.twin, -1)
    twin[twin >= 0] = np.where(own[twin[twin >= 0]], twin[twin >= 0], -1)
    here = np.flatnonzero(twin >= 0)
    ends = mesh.corner_face[here], mesh.corner_face[twin[here]]
    links = coo_array((np.ones(len(here), dtype=np.int8), ends), shape=(mesh.n_faces,) * 2)
    _, label = connected_components(links, directed=False)
    part = np.full(mesh.n_faces, -1)
    _, part[there] = np.unique(label[there], return_inverse=True)
    odd = np.flatnonzero(own & mesh.nonmanifold_edge[mesh.corner_edge])
    if len(odd):
        number, _ = numbered([part[mesh.corner_face[odd]], mesh.corner_edge[odd]])
        order = np.argsort(number, kind="stable")
        count = np.bincount(number)
        start = np.cumsum(count) - count
        pair = np.flatnonzero(count == 2)
        one, other = odd[order[start[pair]]], odd[order[start[pair] + 1]]
        opposite = mesh.indices[one] == mesh.indices[mesh.next_corner[other]]
        opposite &= mesh.indices[one] != mesh.indices[other]
        twin[one[opposite]], twin[other[opposite]] = other[opposite], one[opposite]
    return part, twin


def uses_of_squares(sides: Sides, grid: Array, limit_faces: Array, turns: Array) -> Uses:
    """All segments around faces, in order."""
    size, n = sides.size, len(grid)
    offset = np.cumsum(grid.prod(axis=1)) - grid.prod(axis=1)
    count = grid[:, np.arange(size) % 2] if size == 4 else np.ones((n, size), dtype=np.int64)
    each = count.ravel()
    item = np.repeat(np.arange(n * size), each)
    step = np.arange(len(item)) - np.repeat(np.cumsum(each) - each, each)
    face, side = np.divmod(item, size)
    nu, nv = grid[face].T
    far = each[item] - 1 - step
    i = np.choose(side, [step, nu - 1, far, 0 * far][:size])
    j = np.choose(side, [0 * far, step, nv - 1, far][:size])
    cell = offset[face] + (i * nv + j if size == 4 else 0)
    limit_face, own = limit_faces[cell], (turns[cell] + side) % size
    half, kinds, number = sides.segments(limit_face, own)
    where = np.repeat(np.arange(len(half)), number)
    second = np.append(False, where[1:] == where[:-1])
    half, kind, own = half[where], kinds[where, second.astype(int)], own[where]
    length = 1 / number[where]
    low = step[where] + np.where(second, 0.5, 0)
    key, sign = sides.keys(half, kind, own)
    begin, end = sides.ends(half, kind, own)
    cage = np.where(kind == _SPOKE, -1, half)
    return Uses(face[where], side[where], low, low + length, key, sign, begin, end, cage)


def uses_of_triangles(sides: Sides, limit_faces: Array, origin: Array, size: Array) -> Uses:
    """All segments around triangles that are parts of limit faces, in order."""
    n = len(limit_faces)
    corners = origin[:, None] + size[:, None] * np.array(sides.lattice.corners)
    a = np.rint(corners * _UNIT).astype(np.int64)
    a, b = a.reshape(-1, 2), np.roll(a, -1, axis=1).reshape(-1, 2)
    face, limit_face = np.repeat(np.arange(n), 3), np.repeat(limit_faces, 3)
    side = np.tile(np.arange(3), n)
    half = sides.half[limit_face] + side
    line, low, high, on_border = _on_lines(sides.twin, half, limit_face, side, a, b)
    # points on the lines, and those on each side of a triangle
    at = np.concatenate([low, high])
    number, one = numbered([at, np.concatenate([line, line])])
    first, last = number.reshape(2, -1)
    count = np.abs(last - first)
    item = np.repeat(np.arange(3 * n), count)
    step = np.arange(len(item)) - np.repeat(np.cumsum(count) - count, count)
    sign = np.sign(last - first)[item]
    ends = first[item] + sign * np.stack([step, step + 1])
    share = (at[one][ends] - low[item]) / (high - low)[item]
    where = a[item] + np.rint(share[..., None] * (b - a)[item]).astype(np.int64)
    vertex = _numbers(sides, np.tile(limit_face[item], 2), where.reshape(-1, 2)).reshape(2, -1)
    cage = np.where(on_border, half, -1)[item]
    key = ends.min(axis=0)
    begin, end = vertex
    return Uses(face[item], side[item], share[0], share[1], key, sign, begin, end, cage)


def _on_lines(
    twin: Array, half: Array, limit_face: Array, side: Array, a: Array, b: Array
) -> tuple[Array, Array, Array, Array]:
    """The lines on which sides of triangles are, from where to where, and whether these are edges.

    Lines are edges of the cage, or within a limit face.
    """

    def known(x: Array) -> tuple[Array, Array]:
        along = np.choose(side, [x[:, 0], x[:, 1], _UNIT - x[:, 1]])
        return along, np.choose(side, [x[:, 1], _UNIT - x.sum(axis=1), x[:, 0]])

    (low, across), (high, _) = known(a), known(b)
    border = across == 0
    flip = border & (twin[half] >= 0) & (twin[half] < half)
    owner = np.where(border, np.where(flip, twin[half], half), limit_face)
    line, _ = numbered([across, owner, np.where(border, 0, 1 + side)])
    low, high = (np.where(flip, _UNIT - x, x) for x in (low, high))
    return line, low, high, border


def _numbers(sides: Sides, limit_face: Array, place: Array) -> Array:
    """Numbers of vertices at places (Q, 2) of limit faces of triangles."""
    mesh, half = sides.mesh, sides.half[limit_face]
    u, v = place.T
    kind, owner = np.full(len(u), 2), limit_face
    x, y = u, v
    ways = ((v == 0, u), (u + v == _UNIT, v), (u == 0, _UNIT - v))
    for k, (on, along) in enumerate(ways):
        own, other = half + k, sides.twin[half + k]
        flip = on & (other >= 0) & (other < own)
        kind = np.where(on, 1, kind)
        owner = np.where(on, np.where(flip, other, own), owner)
        x, y = np.where(on, np.where(flip, _UNIT - along, along), x), np.where(on, 0, y)
    for k, corner in enumerate(sides.lattice.corners):
        here = (place == _UNIT * np.array(corner)).all(axis=1)
        part = sides.part[sides.face[limit_face]]
        kind = np.where(here, 0, kind)
        owner = np.where(here, part * mesh.n_vertices + mesh.indices[half + k], owner)
        x, y = np.where(here, 0, x), np.where(here, 0, y)
    return numbered([y, x, owner, kind])[0]
