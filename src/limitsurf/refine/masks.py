"""Limits of all vertices of a mesh by kernels, with masks that are kept as long as its faces are.

Smooth vertices have masks by their number of faces, for what a kernel finds around them. At sharp
ones each sector has a row of its own: weights of vertices of the mesh, whatever refinement they
take.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from limitsurf import numbers, tables
from limitsurf._kernels import reference as kernels
from limitsurf.cage.connectivity import read_only
from limitsurf.cage.mesh import Mesh, kept
from limitsurf.refine.limits import limit_normals, limit_rows, sector_operator
from limitsurf.refine.operators import channel_groups, on_one_pattern
from limitsurf.refine.stages import smooth_valences
from limitsurf.rules import Rules, Sectors, Sharpness
from limitsurf.topology import MeshPart

Array = NDArray[Any]

# how the normal of a sector is found, see `row_normals`
PAIR, ENDS, NEVER = range(3)


class _Rows(NamedTuple):
    """Rows of weights of the n sectors at sharp vertices: vertex, first entries, and entries."""

    vertices: Array
    starts: Array
    columns: Array
    weights: Array

    @classmethod
    def of(cls, sectors: Sectors, near: MeshPart, some: Array, operators: list[Any]) -> Self:
        """Those of `some` fans of a part of the mesh; all others of the operators are empty."""
        found = on_one_pattern(operators)
        weights = np.stack([one.data for one in found], axis=1)
        starts = found[0].indptr[np.append(some, len(sectors.fans.vertex))].astype(np.int64)
        vertices = near.vertices[sectors.fans.vertex[some]]
        return cls(vertices, starts, near.vertices[found[0].indices], weights)


def _near(sharpness: Sharpness, rules: Rules) -> tuple[Sectors, MeshPart, Array]:
    """The sectors in what surrounds all sharp vertices, that part of the mesh, and which are there.

    Vertices at its rim have others, but not all.
    """
    rough = sharpness.sharp_vertices
    near = MeshPart.of(sharpness.mesh, rough[sharpness.mesh.indices])
    sectors = Sectors.of(sharpness.part(near), rules.scheme.lattice)
    return sectors, near, np.flatnonzero(rough[near.vertices][sectors.fans.vertex])


def _chosen(fans: Array, sectors: Sectors) -> Array:
    """Which fans they are, (n_fans,) bool."""
    result = np.zeros(len(sectors.fans.vertex), dtype=bool)
    result[fans] = True
    return result


@dataclass(frozen=True, eq=False)
class _PointMasks:
    """What limits of points are made of.

    Attributes
    ----------
    smooth : (most + 1, 1 or 2)
        By number of faces at a vertex, what each face brings: the weights of its edge neighbour and
        of the corner beyond, where that is in the ring.
    rows : _Rows or None
        At sharp vertices.
    without : (n,) int
        Vertices without a limit.
    """

    smooth: Array
    rows: _Rows | None
    without: Array

    @classmethod
    def of(cls, mesh: Mesh, rules: Rules) -> Self:
        """Those of a mesh of regular faces."""
        sharpness = Sharpness.of(mesh, rules, numbers.FLOAT64)
        most, valences = smooth_valences(mesh, sharpness.concerned)
        smooth = np.zeros((most + 1, len(rules.scheme.lattice.orbits)))
        for N in valences:
            mask = tables.limit_mask(rules.scheme, "interior", N, numbers.FLOAT64)
            smooth[N] = mask[1 : 1 + smooth.shape[1]]
        rows = None
        if len(sharpness.concerned):
            sectors, near, some = _near(sharpness, rules)
            chosen = _chosen(some, sectors)
            operator = sector_operator(sectors.sharpness, rules, chosen, limit_rows, 1)
            rows = _Rows.of(sectors, near, some, [operator])
        without = np.flatnonzero(rules.loose_vertices(mesh) | (mesh.vertex_faces == 0))
        return cls(smooth, rows, without)


def all_limit_points(mesh: Mesh, rules: Rules, points: Array) -> Array:
    """Limits (n_vertices, d) of the vertices of regular faces, NaN where there is none."""
    from limitsurf._kernels import refinement

    masks = kept(mesh, "limit masks", rules, lambda: _PointMasks.of(mesh, rules))
    result = np.empty_like(points)
    for first, channels in channel_groups(points.shape[1]):
        known = points, mesh.indices, mesh.vertex_faces, masks.smooth
        regular = (0,) * rules.scheme.lattice.face_size
        refinement.limit_points(*known, regular, first, channels, result)
    if masks.rows is not None:
        vertices, starts, columns, weights = masks.rows
        refinement.row_limits(points, vertices, starts, columns, weights.ravel(), result)
    result[masks.without] = np.nan
    return result


@dataclass(frozen=True, eq=False)
class _NormalMasks:
    """What limit normals are made of.

    Attributes
    ----------
    start : (most + 1,) int
        By number of faces at a vertex, where in `smooth` its masks begin.
    smooth : (n,)
        The masks, see `refinement.limit_normals`.
    sharp : (n_vertices,) bool
        Where there are rows instead.
    rows : _Rows or None
        Of pairs of weights.
    sectors : (array, array, array)
        How their normals are found (n,), where their corners begin (n + 1,), and these.
    without : (n,) int
        Faces without a limit.
    """

    start: Array
    smooth: Array
    sharp: Array
    rows: _Rows | None
    sectors: tuple[Array, Array, Array]
    without: Array

    @classmethod
    def of(cls, mesh: Mesh, rules: Rules) -> Self:
        """Those of a mesh of regular faces."""
        sharpness = Sharpness.of(mesh, rules, numbers.FLOAT64)
        most, valences = smooth_valences(mesh, sharpness.concerned)
        start, masks = np.zeros(most + 1, np.int64), [np.zeros(0)]
        for N in valences:
            pairs = _pair(rules, "interior", N)[:, 1:]
            size = np.abs(pairs).sum(axis=1)
            if not len(pairs):
                pairs, size = np.zeros((2, len(rules.scheme.lattice.orbits) * N)), np.full(2, -1.0)
            start[N] = sum(map(len, masks))
            masks += [size, pairs.T.ravel()]
        nothing = np.zeros(0, np.int64)
        rows: tuple[Any, Any] = None, (nothing, nothing, nothing)
        if len(sharpness.concerned):
            rows = _normal_rows(sharpness, rules)
        without = np.flatnonzero(rules.without_limit(mesh))
        return cls(start, np.concatenate(masks), sharpness.sharp_vertices, *rows, without)


def _pair(rules: Rules, kind: str, faces: int) -> Array:
    """Masks of two vectors, (2 or 0, ring)."""
    pairs = tables.normal_masks(rules.scheme, kind, faces)
    return pairs[:1].reshape(-1, pairs.shape[2])


def _ends(rules: Rules, kind: str, faces: int) -> Array:
    """The vectors to both ends of a sector."""
    return np.asarray(tables.collapsed_masks(rules.scheme, kind, faces)[3])


def _normal_rows(sharpness: Sharpness, rules: Rules) -> tuple[_Rows, tuple[Array, Array, Array]]:
    """Of the sectors at sharp vertices, as in `_NormalMasks`."""
    sectors, near, some = _near(sharpness, rules)
    fans = sectors.fans
    state = np.full(len(fans.vertex), PAIR)
    for kind, faces, members in sectors.groups(some[sectors.kind[some] >= 0]):
        if not len(_pair(rules, kind, faces)):
            collapsed = tables.collapsed_masks(rules.scheme, kind, faces)[:3].any()
            state[members] = ENDS if collapsed else NEVER
    chosen = _chosen(some, sectors)
    pairs, to_ends = (
        sector_operator(sectors.sharpness, rules, chosen & (state == wanted), masks, 2)
        for wanted, masks in ((PAIR, _pair), (ENDS, _ends))
    )
    both, n = pairs + to_ends, len(state)  # no row is in both
    rows = _Rows.of(sectors, near, some, [both[:n], both[n:]])
    corners = near.corners[fans.corners[chosen[fans.fan[fans.corners]]]]
    begin = np.concatenate([[0], np.cumsum(fans.sizes[some])])
    return rows, (state[some], begin, corners)


def all_limit_normals(mesh: Mesh, rules: Rules, points: Array, rounded: bool) -> Array:
    """Limit normals (n_corners, 3) at the corners of regular faces, NaN where there is none."""
    from limitsurf._kernels import refinement

    masks = kept(mesh, "normal masks", rules, lambda: _NormalMasks.of(mesh, rules))
    result, doubtful = np.empty((mesh.n_corners, 3)), np.zeros(mesh.n_vertices, dtype=bool)
    known = mesh.indices, mesh.twin, mesh.vertex_faces, masks.start, masks.smooth
    room = masks.sharp.copy(), np.empty(len(masks.start), np.int64)
    regular = (0,) * rules.scheme.lattice.face_size
    given = read_only(points), int(rounded)
    count = refinement.limit_normals(*given, *known, regular, *room, doubtful, result)
    if masks.rows is not None:
        count += refinement.row_normals(*given, *masks.rows, *masks.sectors, doubtful, result)
    if count:
        near = MeshPart.of(mesh, doubtful[mesh.indices])
        inner = Sharpness.of(mesh, rules, numbers.FLOAT64).part(near)
        own, around = doubtful[near.vertices], points[near.vertices]
        errors = kernels.largest(around)[:, 0] * rounded
        normals = limit_normals(inner, rules, around, errors, own)
        own = own[near.mesh.indices]
        result[near.corners[own]] = normals[own]
    result.reshape(-1, rules.scheme.lattice.face_size, 3)[masks.without] = np.nan
    return result


def tangent_rows(mesh: Mesh, rules: Rules, corners: Array) -> tuple[Any, Array]:
    """Operator (2 n, n_vertices) onto two tangent vectors at corners of regular faces, by sectors.

    To all first ones, then to all second ones. Also whether general points have a tangent plane
    there, (n,) bool.
    """
    sharpness = Sharpness.of(mesh, rules, numbers.FLOAT64)
    sectors = Sectors.of(sharpness, rules.scheme.lattice)
    fan, n = sectors.fans.fan[corners], len(sectors.fans.vertex)
    wanted = np.zeros(n, dtype=bool)
    wanted[fan] = True
    both = sector_operator(sharpness, rules, wanted, _pair, 2)
    found = both[np.concatenate([fan, fan + n])]
    return found, np.diff(found.indptr)[: len(corners)] > 0
