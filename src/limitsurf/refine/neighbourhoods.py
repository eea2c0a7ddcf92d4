"""What surrounds triangles, told apart by how faces meet: the states of evaluation by steps.

The limit on a triangle is decided by the faces at its corners and at their neighbours, and by these
alone those of its four children are made. So neighbourhoods that are alike have one matrix for each
child, and there are few kinds: after a step or two all are regular, or along a boundary, or next to
one special vertex, and stay so. A kind is found when it is first met, from a mesh of its own.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.connectivity import Connectivity
from limitsurf.cage.mesh import Mesh, valid_mesh
from limitsurf.numbers import NumberType
from limitsurf.refine import interpolating
from limitsurf.refine.operators import entries
from limitsurf.rules import Rules
from limitsurf.topology import child_mesh

Array = NDArray[Any]

# at which corner of a child, as refinement makes it, its frame begins that is that of its parent,
# for the last one turned by half a turn
FRAMES = np.array([0, 2, 1, 0])
_ORIGINS = np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) / 2  # of these frames
_SIGNS = 1, 1, 1, -1
REGULAR = 0  # the first kind
_MANY = 1 << 14  # neighbourhoods that are looked at at once


@dataclass(eq=False)
class Kind:
    """A kind of neighbourhood.

    Attributes
    ----------
    faces : (m, 3) int
        Its faces by its points, of which 0, 1, 2 are the corners of the triangle.
    n_points : int
    places : (n_points, 2) int or None
        Coordinates of the points, from corner 0 in (u, v), if they are part of a regular lattice.
    joined : (twins, edges), each (3 m,) int, or nothing
        The half-edges opposite to those of the faces, -1 where there is none, and their edges,
        where vertices do not tell.
    children : (4,) int
        Kinds of the children, once they are known.
    steps : list of four arrays (n_points of the child, n_points)
        Points of the children.
    affine : bool
        Whether a step keeps all points of a lattice in line.
    """

    faces: Array
    n_points: int
    places: Array | None
    joined: tuple[Array, ...] = ()
    children: Array = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    steps: list[Array] = field(default_factory=list)
    affine: bool = False


class Kinds:
    """All kinds that have been met under a scheme, in one type of numbers."""

    def __init__(self, rules: Rules, number: NumberType) -> None:
        self.rules, self.number = rules, number
        self.known: list[Kind] = []
        self._by_code: dict[bytes, int] = {}
        self.lock = threading.RLock()
        walk, places = _regular_walk()
        self._walk = walk
        size = 5  # of a lattice around the triangle at (0, 0)
        every = [(i, j) for j in range(-size, size) for i in range(-size, size)]
        inside = {place: k for k, place in enumerate(places)}
        triangles = [
            [(i, j), (i + 1, j), (i, j + 1)] for i, j in every
        ] + [[(i + 1, j + 1), (i, j + 1), (i + 1, j)] for i, j in every]  # fmt: skip
        near = [[inside[p] for p in t] for t in triangles if all(p in inside for p in t)]
        near.sort(key=lambda t: t != [0, 1, 2])
        self.known.append(Kind(np.array(near), len(places), np.array(places)))

    def expanded(self, kind: int) -> Kind:
        """A kind whose children are known."""
        one = self.known[kind]
        if len(one.children):
            return one
        with self.lock:
            if len(one.children):
                return one
            mesh = _mesh(one)
            rows, columns, values = entries(interpolating.stage(mesh, self.rules, self.number))
            fine = child_mesh(mesh, np.zeros((one.n_points + mesh.n_edges, 0)), self.lattice)
            dense = np.full((fine.n_vertices, one.n_points), self.number.zero, self.number.dtype)
            dense[rows, columns] = values
            kinds, starts, points = self.of(fine, 3 * np.arange(4) + FRAMES)
            one.steps = [dense[points[starts[c] : starts[c + 1]]] for c in range(4)]
            one.affine = self._is_affine(one, kinds)
            one.children = kinds
        return one

    def _is_affine(self, one: Kind, children: Array) -> bool:
        if one.places is None:
            return False
        for c, kind in enumerate(children.tolist()):
            there = self.known[kind].places
            if there is None:
                return False
            found = one.steps[c].astype(float) @ one.places
            if np.abs(found - _ORIGINS[c] - _SIGNS[c] * there / 2).max() > 1e-12:
                return False
        return True

    @property
    def lattice(self) -> Any:
        """That of the scheme."""
        return self.rules.scheme.lattice

    def of(self, mesh: Mesh, corners: Array) -> tuple[Array, Array, Array]:
        """The kinds of the neighbourhoods of triangles, seen from one corner each, and points.

        Returns kinds (n,), and the vertices of neighbourhood i, those from ``starts[i]`` on.
        """
        n = len(corners)
        kinds = np.full(n, REGULAR)
        half, regular = self._regular(mesh, corners)
        counts = np.full(n, len(self._walk))
        parts = [(np.flatnonzero(regular), mesh.indices[half[regular]].ravel())]
        others = np.flatnonzero(~regular)
        for first in range(0, len(others), _MANY):
            which = others[first : first + _MANY]
            kinds[which], counts[which], points = self._others(mesh, corners[which])
            parts.append((which, points))
        starts = np.concatenate([[0], np.cumsum(counts)])
        result = np.empty(starts[-1], dtype=np.int64)
        for which, points in parts:
            own = counts[which]
            place = np.arange(len(points)) - np.repeat(np.cumsum(own) - own, own)
            result[np.repeat(starts[which], own) + place] = points
        return kinds, starts, result

    def _regular(self, mesh: Mesh, corners: Array) -> tuple[Array, Array]:
        """Half-edges from the points of regular neighbourhoods (n, points), and which are that."""
        before, after, twin, fans = mesh.previous_corner, mesh.next_corner, mesh.twin, mesh.fans
        half = np.empty((len(corners), len(self._walk)), dtype=np.int64)
        found: dict[tuple[str, ...], Array] = {(): corners}
        for k, path in enumerate(self._walk):
            for length in range(1, len(path) + 1):
                if path[:length] not in found:
                    h = found[path[: length - 1]]
                    found[path[:length]] = after[h] if path[length - 1] == "n" else twin[before[h]]
            half[:, k] = found[path]
        near = half[:, :12]  # the triangle and its neighbours
        fan = fans.fan[near]
        fine = (fans.sizes[fan] == 6) & fans.closed[fan]
        fine &= mesh.vertex_faces[mesh.indices[near]] == 6
        return half, np.asarray(fine.all(axis=1))

    def _others(self, mesh: Mesh, corners: Array) -> tuple[Array, Array, Array]:
        """Kinds, numbers of points and points of neighbourhoods that are not regular."""
        after, before, n = mesh.next_corner, mesh.previous_corner, len(corners)
        own = np.stack([corners, after[corners], before[corners]], axis=1).ravel()
        group, listed = _around(mesh, np.repeat(np.arange(n), 3), own)
        # first corners of all vertices met, in the order in which they are
        met_group = np.repeat(group, 3)
        met = np.stack([listed, after[listed], before[listed]], axis=1).ravel()
        met_group, met = (
            np.concatenate([x, y]) for x, y in ((np.repeat(np.arange(n), 3), met_group), (own, met))
        )
        order = np.argsort(met_group, kind="stable")
        met_group, met = met_group[order], met[order]
        first = _firsts(met_group, mesh.indices[met], mesh.n_vertices)
        number = _ranks(met_group[first])
        ring = first[number >= 3]
        more_group, more = _around(mesh, met_group[ring], met[ring])
        group = np.concatenate([np.arange(n), group, more_group])
        listed = np.concatenate([corners, listed, more])
        order = np.argsort(group, kind="stable")
        group, listed = group[order], listed[order]
        # each face once, from the corner by which it was met
        first = _firsts(group, mesh.corner_face[listed], mesh.n_faces)
        group, listed = group[first], listed[first]
        at = np.stack([listed, after[listed], before[listed]], axis=1).ravel()
        group, vertex = np.repeat(group, 3), mesh.indices[at]
        first = _firsts(group, vertex, mesh.n_vertices)
        name = _ranks(group[first])
        key = group * mesh.n_vertices + vertex
        known = key[first]
        sort = np.argsort(known)
        local = name[sort][np.searchsorted(known[sort], key)]
        counts = np.bincount(group[first], minlength=n)
        cage = mesh.connectivity
        if cage.parallel or cage.repeats:  # vertices do not tell how faces meet
            joined = _joined(mesh, group, at, n)
            order = np.argsort(np.tile(group, 3), kind="stable")
            group, local = np.tile(group, 3)[order], np.concatenate([local, *joined])[order]
            return self._named(group, local, n, joined=True), counts, vertex[first]
        return self._named(group, local, n), counts, vertex[first]

    def _named(self, group: Array, local: Array, n: int, joined: bool = False) -> Array:
        """Kinds of neighbourhoods by their faces, corner by corner."""
        sizes = np.bincount(group, minlength=n)
        starts = np.cumsum(sizes) - sizes
        kinds = np.empty(n, dtype=np.int64)
        for size in np.unique(sizes).tolist():
            which = np.flatnonzero(sizes == size)
            rows = local[starts[which][:, None] + np.arange(size)].astype(np.int32)
            distinct, inverse = np.unique(rows, axis=0, return_inverse=True)
            names = [self._name(row, joined) for row in distinct]
            kinds[which] = np.array(names)[inverse.ravel()]
        return kinds

    def _name(self, row: Array, joined: bool) -> int:
        code = bytes([joined]) + row.tobytes()
        found = self._by_code.get(code)
        if found is None:
            with self.lock:
                found = self._by_code.get(code)
                if found is None:
                    corners, *more = np.split(row.astype(np.int64), 3 if joined else 1)
                    faces, n = corners.reshape(-1, 3), int(corners.max()) + 1
                    places = None if joined else lattice_places(faces, n)
                    self.known.append(Kind(faces, n, places, tuple(more)))
                    self._by_code[code] = found = len(self.known) - 1
        return found


def _mesh(kind: Kind) -> Mesh:
    faces, known = kind.faces, dict[str, Any]()
    if kind.joined:
        twin, edge = kind.joined
        corner = np.arange(faces.size).reshape(-1, 3)
        ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        first = np.empty(edge.max() + 1, np.int64)
        first[edge[::-1]] = corner.ravel()[::-1]
        table = ends[first], edge, np.stack([first, twin[first]], axis=1)
        known = {"twin": twin, "parallel": True, "edge_table": table}
    cage = Connectivity(kind.n_points, np.full(len(faces), 3), faces.ravel(), **known)
    return valid_mesh(Mesh, np.zeros((kind.n_points, 0)), cage)


def _joined(mesh: Mesh, group: Array, corners: Array, n: int) -> tuple[Array, Array]:
    """Twins of half-edges and their edges, by numbers within their groups, which are in order."""
    own = _ranks(group)
    key = group * mesh.n_corners + corners
    order = np.argsort(key)
    opposite = group * mesh.n_corners + mesh.twin[corners]
    place = np.minimum(np.searchsorted(key[order], opposite), len(key) - 1)
    found = (mesh.twin[corners] >= 0) & (key[order][place] == opposite)
    twins = np.where(found, own[order][place], -1)
    edge = mesh.corner_edge[corners]
    first = _firsts(group, edge, mesh.n_edges)
    name, known = _ranks(group[first]), (group * mesh.n_edges + edge)[first]
    sort = np.argsort(known)
    place = np.searchsorted(known[sort], group * mesh.n_edges + edge)
    return twins, name[sort][place]


def _around(mesh: Mesh, group: Array, corners: Array) -> tuple[Array, Array]:
    """All corners at the vertices of some corners, of each fan in turn, its own one first."""
    fans, vertex = mesh.fans, mesh.indices[corners]
    own = fans.fan[corners]
    count = np.bincount(fans.vertex, minlength=mesh.n_vertices)
    begin = np.cumsum(count) - count
    # fans of the vertex, the own one first
    many = count[vertex]
    row = np.repeat(np.arange(len(corners)), many)
    place = np.arange(len(row)) - np.repeat(np.cumsum(many) - many, many)
    each = begin[vertex][row] + (own[row] - begin[vertex][row] + place) % many[row]
    sizes = fans.sizes[each]
    entry = np.repeat(np.arange(len(each)), sizes)
    step = np.arange(len(entry)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    turn = np.where(fans.closed[each] & (place == 0), fans.position[corners][row], 0)
    found = fans.corners[fans.offsets[each][entry] + (step + turn[entry]) % sizes[entry]]
    return group[row][entry], found


def _firsts(group: Array, value: Array, width: int) -> Array:
    """Where each value of each group is met first, ascending."""
    _, first = np.unique(group * width + value, return_index=True)
    return np.sort(first)


def _ranks(group: Array) -> Array:
    """Numbers within groups, which are in order."""
    sizes = np.bincount(group)
    return np.asarray(np.arange(len(group)) - (np.cumsum(sizes) - sizes)[group])


def lattice_places(faces: Array, n: int) -> Array | None:
    """Coordinates of points in a lattice, from the first face on; None if it is part of none."""
    found: dict[int, tuple[int, int]] = {0: (0, 0), 1: (1, 0), 2: (0, 1)}
    rest = [tuple(face) for face in faces[1:].tolist()]
    while rest:
        later = []
        for face in rest:
            turns = [face[k:] + face[:k] for k in range(3)]
            known = next((t for t in turns if t[0] in found and t[1] in found), None)
            if known is None:
                later.append(face)
                continue
            (a, b), (c, d) = found[known[0]], found[known[1]]
            place = a - (d - b), b + (c - a) + (d - b)
            if {(c - a, d - b)} - _DIRECTIONS or found.setdefault(known[2], place) != place:
                return None
        if len(later) == len(rest):
            return None
        rest = later
    if len(set(found.values())) < n:
        return None
    return np.array([found[k] for k in range(n)])


_DIRECTIONS = {(1, 0), (0, 1), (-1, 1), (-1, 0), (0, -1), (1, -1)}


def _regular_walk() -> tuple[list[tuple[str, ...]], list[tuple[int, int]]]:
    """Steps to half-edges from all points of a regular neighbourhood, and where these are.

    "n" goes on to the next half-edge of a face, "t" turns around a point, counter-clockwise.
    """
    triangle = [(0, 0), (1, 0), (0, 1)]

    def near(points: list[tuple[int, int]]) -> set[tuple[int, int]]:
        return {(i + x, j + y) for i, j in points for x, y in (*_DIRECTIONS, (0, 0))}

    ring = near(triangle)
    wanted = near(list(ring))
    paths: dict[tuple[int, int], tuple[str, ...]] = {}
    seen: set[tuple[tuple[int, int], tuple[int, int]]] = set()
    front: list[tuple[tuple[int, int], tuple[int, int], tuple[str, ...]]] = [((0, 0), (1, 0), ())]
    while len(paths) < len(wanted):
        later = []
        for place, (x, y), path in front:
            if (place, (x, y)) in seen or place not in wanted:
                continue
            seen.add((place, (x, y)))
            paths.setdefault(place, path)
            later.append(((place[0] + x, place[1] + y), (-x - y, x), (*path, "n")))
            later.append((place, (-y, x + y), (*path, "t")))
        front = later
    order = triangle + sorted(ring - set(triangle)) + sorted(wanted - ring)
    return [paths[place] for place in order], order
