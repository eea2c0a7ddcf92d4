"""Which faces are one patch, and the control points around them, as the lattice tells.

Fast twins are in ``_kernels/connectivity.py``, and of faces of four corners in ``squares.py``.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.connectivity import read_only
from limitsurf.cage.mesh import Mesh
from limitsurf.patches import squares
from limitsurf.rules import DART, Sectors, Sharpness
from limitsurf.scheme.lattice import Lattice, Place

Array = NDArray[Any]


def smooth_faces(
    mesh: Mesh, lattice: Lattice, first: Array, turn: Array, valence: Array
) -> tuple[Array, Array]:
    """Faces amid faces of the lattice with at most one corner that is not regular.

    Parameters
    ----------
    first : (n,) int
        First corners of faces.
    turn : (n,) int
        At which corner of the domain these lie.
    valence : (n_vertices,) int
        0 where faces may not be such, as everywhere around other faces.

    Returns
    -------
    found : (n,) int32
        The valence of that corner, or the regular one; 0 for other faces.
    start : (n,) int8
        That corner, or the one at (0, 0).
    """
    size, regular = lattice.face_size, lattice.valence
    if mesh.connectivity.compiled:
        from limitsurf._kernels import connectivity

        known = map(read_only, (first, turn, valence))
        return connectivity.smooth_faces(mesh.indices, size, regular, *known)
    here = valence[mesh.indices[_corners(mesh, lattice, first)]]
    odd = here != regular
    special = odd.argmax(axis=1)
    each = np.arange(len(first))
    found = np.where(odd.any(axis=1), here[each, special], regular)
    found[odd.sum(axis=1) > 1] = 0
    start = np.where(found == 0, 0, np.where(found == regular, -turn % size, special))
    return found.astype(np.int32), start.astype(np.int8)


def influenced(sharpness: Sharpness, lattice: Lattice, first: Array) -> Array:
    """Faces of the lattice from an edge of whose corners leads to an irregular vertex, (n,) bool.

    Not along their own sides. `first` (n,) are their first corners. Where masks of edges depend on
    valences, such an edge has others than around a patch.
    """
    mesh, n = sharpness.mesh, sharpness.mesh.n_vertices
    odd = (sharpness.rule <= DART) & (mesh.vertex_faces != lattice.valence)
    tail, head = mesh.edges.T
    count = np.bincount(tail, odd[head], n) + np.bincount(head, odd[tail], n)
    corners = mesh.indices[_corners(mesh, lattice, first)]
    own = odd[corners].astype(float)
    own = np.roll(own, 1, axis=1) + np.roll(own, -1, axis=1)
    return np.asarray((count[corners] > own).any(axis=1))


def sharp_faces(
    sharpness: Sharpness,
    sectors: Sectors,
    lattice: Lattice,
    strips: bool,
    first: Array,
    turn: Array,
) -> tuple[Array, Array]:
    """Faces that are one patch, be it at sharp edges.

    Parameters
    ----------
    strips : bool
        Whether the spline is a product, and continues along a semi-sharp crease.
    first : (n,) int
        First corners of faces.
    turn : (n,) int
        At which corner of the domain these lie.

    Returns
    -------
    found : (n,) int8
        1 for regular patches; 2 for those with a special corner; 3 for strips, along one side of
        which a semi-sharp crease runs straight; 0 for other faces. Both ends of that side are amid
        four faces and have no other sharp edge, and the other corners are regular.
    start : (n,) int8
        The corner at (0, 0), the special one, or that where the side begins.
    """
    mesh, fans, size = sharpness.mesh, sectors.fans, lattice.face_size
    # by fan: -1 with other faces, 0 semi-sharp, 1 special, 2 regular
    state = np.minimum(sectors.kind + 1, 1).clip(0) + sectors.regular
    if mesh.connectivity.uniform_size != size:
        state[fans.fan[mesh.sizes[mesh.corner_face] != size]] = -1
    if mesh.connectivity.compiled and strips and squares.fit(lattice):
        from limitsurf._kernels import connectivity

        around = np.where(fans.closed, fans.sizes, 0)
        known = sectors.twin, fans.fan, state, around, *sharpness.codes, first, turn
        return connectivity.sharp_faces(
            mesh.indices, mesh.connectivity.steps, *map(read_only, known)
        )
    corners = _corners(mesh, lattice, first)
    here = state[fans.fan[corners]]  # (n, size)
    settled = (here > 0).all(axis=1)
    special = settled & ((here == 2).sum(axis=1) == size - 1)
    plain = settled & (here == 2).all(axis=1)
    found = np.where(special, 2, plain)
    start = np.where(special, (here == 1).argmax(axis=1), -turn % size)
    if strips:
        strip, side = _strips(sharpness, sectors, corners, here)
        found, start = np.where(strip, 3, found), np.where(strip, side, start)
    return found.astype(np.int8), np.where(found > 0, start, 0).astype(np.int8)


def _strips(
    sharpness: Sharpness, sectors: Sectors, corners: Array, here: Array
) -> tuple[Array, Array]:
    """Which faces of four corners are strips, and along which side."""
    mesh, fans = sharpness.mesh, sectors.fans
    around = np.where(fans.closed, fans.sizes, 0)
    edges, through = sharpness.codes
    soft = edges[corners] > 0
    strip = (here >= 0).all(axis=1) & (soft.sum(axis=1) == 1)
    side = np.where(strip, soft.argmax(axis=1), 0)
    each = np.arange(len(corners))
    for k in (2, 3):
        strip &= here[each, (side + k) % 4] == 2
    code = edges[corners[each, side]]
    for k in (0, 1):
        corner = corners[each, (side + k) % 4]
        strip &= (around[fans.fan[corner]] == 4) & (through[mesh.indices[corner]] == code)
        # opposite to the side: two edges on from it, three from the face's next edge
        for _ in range(2 + k):
            corner = np.where(strip, sectors.twin[mesh.previous_corner[corner]], 0)
        strip &= edges[corner] == code
    return strip, side


def templates(
    mesh: Mesh, lattice: Lattice, twin: Array, numbers: Array, first: Array, start: Array
) -> Array:
    """Control points of faces and around them at the places of the template, -1 where none is.

    From the corner ``first + start`` on, (n, places); `numbers` (n_corners,) are the control points
    of corners, `twin` (n_corners,) joins faces. What lies around corners that are not regular is
    meaningless.
    """
    if squares.fit(lattice):
        return squares.templates(mesh, twin, numbers, first, start)
    own, around = _stars(lattice)
    if mesh.connectivity.compiled and lattice.face_size == 3:
        from limitsurf._kernels import connectivity

        known = numbers, mesh.connectivity.steps, twin, first, start, own, around
        return connectivity.stars(*read_only(known))
    corners = _turned_corners(lattice, first, start)
    result = np.full((len(first), len(lattice.template)), -1, dtype=np.int32)
    for k, places in enumerate(around):
        result[:, own[k]] = numbers[corners[:, k]]
        ring = _ring(mesh, lattice, twin, numbers, corners[:, k])
        result[:, places] = np.where(ring < 0, result[:, places], ring)
    return result


def reflections(
    grid: Array, sectors: Sectors, lattice: Lattice, first: Array, start: Array
) -> tuple[Array, Array, Array, Array]:
    """What lies beyond sharp sides, as combinations of what does not.

    Around corners that are not regular it is meaningless.

    Returns
    -------
    face, place : (m,) int
        Rows and columns of `grid`, the control points at the places of the template.
    columns, weights : (m, terms) int
        Control points and their weights, of which some may be 0.
    """
    if squares.fit(lattice):
        return squares.reflections(grid, sectors.twin, first, start)
    corners, fans = _turned_corners(lattice, first, start), sectors.fans
    fan, position = fans.fan[corners], fans.position[corners]  # (n, size)
    size = np.where(sectors.regular & ~fans.closed, fans.sizes, 0)[fan]
    missing, found = grid < 0, []
    for (k, count, p, place), (sources, factors) in _beyond(lattice).items():
        here = (size[:, k] == count) & (position[:, k] == p)
        face = np.flatnonzero(here & missing[:, place])
        missing[face, place] = False
        shape = len(face), len(factors)
        columns = grid[face[:, None], np.array(sources)]
        found.append((face, np.full(len(face), place), columns, np.broadcast_to(factors, shape)))
    faces, places, columns, weights = (np.concatenate(x) for x in zip(*found, strict=True))
    order = np.lexsort((places, faces))
    return faces[order], places[order], columns[order], weights[order]


def specials(
    mesh: Mesh, lattice: Lattice, numbers: Array, first: Array, start: Array, valence: int,
    outer: Array,
) -> Array:  # fmt: skip
    """Control points (n, K) of faces with an interior vertex of that valence at ``first + start``.

    Those around it as in `Sectors.ring`, then those at `outer` places of the template.
    """
    if mesh.connectivity.compiled and squares.fit(lattice):
        from limitsurf._kernels import connectivity

        known = numbers, mesh.connectivity.steps, mesh.twin, first, start, valence, outer
        return connectivity.specials(*read_only(known))
    ring = _ring_of(mesh, lattice, numbers, first + start, valence)
    grid = templates(mesh, lattice, mesh.twin, numbers, first, start)
    return np.concatenate([ring, grid[:, outer]], axis=1)


def _ring_of(mesh: Mesh, lattice: Lattice, numbers: Array, corners: Array, valence: int) -> Array:
    """Control points at corners amid so many faces, and around them, face by face."""
    if mesh.connectivity.compiled and lattice.face_size == 3:
        from limitsurf._kernels import connectivity

        known = numbers, mesh.connectivity.steps, mesh.twin, corners
        return connectivity.rings(*read_only(known), valence)
    parts = [numbers[corners]]
    for _ in range(valence):
        leaving = corners
        for _ in lattice.orbits:
            leaving = mesh.next_corner[leaving]
            parts.append(numbers[leaving])
        corners = mesh.twin[mesh.previous_corner[corners]]
    return np.stack(parts, axis=1).astype(np.int32)


def child_at(
    lattice: Lattice, u: Array, v: Array, flipped: Array | None
) -> tuple[Array, Array, Array, Array | None]:
    """Find the children that hold (u, v), (Q,): number, s, t in it, and whether it is flipped.

    On lines between two the one nearer corner 0 of the domain is taken; where it is `flipped`, None
    if there are no `flips`, that is the one nearer its other corners. Numbers are `Lattice.parts`.
    """
    if flipped is None:
        return *squares.child_at(u, v), None
    both = 2 * u, 2 * v
    third = np.maximum(*both) - 1 + np.minimum(*both)  # its sign is exact
    right, upper = ((x > 1) | (flipped & (x == 1)) for x in both)
    low = (third < 0) | (~flipped & (third == 0))
    number = np.where(right, 1, np.where(upper, 2, np.where(low, 0, 3)))
    middle = number == 3
    s, t = (
        np.where(middle, 1 - x, x - (number == k).astype(np.int64))
        for k, x in enumerate(both, start=1)
    )
    return number, s, t, flipped ^ middle


def _corners(mesh: Mesh, lattice: Lattice, first: Array) -> Array:
    """The corners of faces, (n, size), from their first; wrong for others than the lattice's."""
    # the last face may have fewer, which then do not count
    return np.minimum(first[:, None] + np.arange(lattice.face_size), mesh.n_corners - 1)


def _turned_corners(lattice: Lattice, first: Array, start: Array) -> Array:
    """The corners (n, size) of faces of the lattice from ``first + start`` on."""
    size = lattice.face_size
    return np.asarray(first[:, None] + (start[:, None] + np.arange(size)) % size)


def _ring(mesh: Mesh, lattice: Lattice, twin: Array, numbers: Array, corners: Array) -> Array:
    """Control points around regular corners, (n, size of the star), -1 where there are none.

    From the edge from the corner to the next one on.
    """
    faces, stride, after = lattice.valence, len(lattice.orbits), mesh.next_corner
    before = mesh.previous_corner
    result = np.full((len(corners), faces * stride), -1, dtype=np.int32)
    for clockwise in (False, True):
        here = corners
        for face in range(faces):
            going = np.flatnonzero(here >= 0)
            if not len(going):
                break
            column = (-face if clockwise else face) % faces * stride
            leaving = here[going]
            for k in range(stride):
                leaving = after[leaving]
                result[going, column + k] = numbers[leaving]
            result[going, (column + stride) % result.shape[1]] = numbers[before[here[going]]]
            across = twin[here[going]] if clockwise else twin[before[here[going]]]
            turned = np.where(across < 0, -1, after[across]) if clockwise else across
            here = np.full_like(here, -1)
            here[going] = turned
    return result


@lru_cache(maxsize=8)
def _stars(lattice: Lattice) -> tuple[Array, Array]:
    """Places in the template of the corners of the face, and of the points around each."""
    place, stars = lattice.template.index, [_star(lattice, k) for k in range(lattice.face_size)]
    own = np.array([place(vertex) for vertex, _ in stars])
    return own, np.array([[place(x) for x in star] for _, star in stars])


def _star(lattice: Lattice, k: int) -> tuple[Place, list[Place]]:
    """The place of corner k, and those around it, from that of the next corner on."""
    (x, y), along, _ = lattice.turns[k]
    begin, size = lattice.star.index(along), len(lattice.star)
    star = [lattice.star[(begin + r) % size] for r in range(size)]
    return (1 + x, 1 + y), [(1 + x + i, 1 + y + j) for i, j in star]


@lru_cache(maxsize=8)
def _beyond(
    lattice: Lattice,
) -> dict[tuple[int, int, int, int], tuple[tuple[int, ...], tuple[int, ...]]]:
    """What lies beyond sharp edges at a regular corner.

    By corner of the face, faces of the fan there, position of the face among them, and place in the
    template: places and weights. Beyond a smooth boundary these are `Lattice.reflection`; beyond a
    corner of one face, what goes on as the face itself does (``derivations/loop_sectors.py``).
    """
    stride, size, place_of = len(lattice.orbits), len(lattice.star), lattice.template.index
    found = {}
    for k in range(lattice.face_size):
        vertex, star = _star(lattice, k)
        own = [place_of((1 + i, 1 + j)) for i, j in lattice.corners]
        for x, y in star[stride + 1 :]:
            found[k, 1, 0, place_of((x, y))] = tuple(own), lattice.extrapolated((x - 1, y - 1))
        faces = lattice.valence // 2
        for position in range(faces):
            # directions along the boundary and into the mesh
            first = -position * stride % size
            (a, b), (c, d) = (
                (star[r % size][0] - vertex[0], star[r % size][1] - vertex[1])
                for r in (first, first + stride)
            )
            for r in range(first + size // 2 + 1, first + size):
                x, y = star[r % size]
                weights, sources = zip(*lattice.reflection, strict=True)
                places = tuple(place_of((x + i * a + j * c, y + i * b + j * d)) for i, j in sources)
                found[k, faces, position, place_of((x, y))] = places, weights
    return found
