"""Refinement by dual schemes: the corners of all faces become vertices, and all else faces.

One step makes of each face a smaller one between the points at its corners, of each edge with two
faces a quad between those of its ends, and of each vertex amid faces the polygon between those of
its corners. The first step also makes points beyond the boundaries, unless these are to have no
limit: reflections by which edges and vertices on boundaries have such faces, too. So the limit of
a refined mesh, whose own boundary has none, is that of the cage.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf import numbers, tables
from limitsurf._kernels import reference as kernels
from limitsurf.caching import cached_property
from limitsurf.cage.checks import MeshError
from limitsurf.cage.connectivity import Connectivity, Fans, read_only
from limitsurf.cage.mesh import Mesh, valid_mesh
from limitsurf.numbers import NumberType
from limitsurf.options import Rules
from limitsurf.refine.operators import sparse_operator, stacked
from limitsurf.scheme.dual import Waves
from limitsurf.scheme.lattice import Lattice
from limitsurf.topology import first_limit_face, vertex_numbers

Array = NDArray[Any]

# corners of polygons from which on points are made by sums over them, not by their masks, and masks
# in float64 by its own cosines
_MANY = 64

# the number of entries of each row; columns and values of the entries of all rows, in turn
Rows: TypeAlias = tuple[Array, Array, Array]


@dataclass(frozen=True, eq=False)
class Rim:
    """The boundary vertices of a cage, as its faces see them: one for each open fan of k faces.

    Squares beyond the boundary make the ring around each whole: k of them, or 3 where there is one
    face, from the last face of the fan on.

    Attributes
    ----------
    vertex : (m,) int
    ends : (m, 2) int
        The vertices next to it along the boundary, of the first and of the last face.
    faces : (m,) int
        Their number k.
    corners : (m,) int
        The first corner of the fan.
    start : (m + 1,) int
        Numbers of the first squares beyond, counted from those of the cage.
    fans : Fans
    which : (m,) int
        The fans they are.
    """

    vertex: Array
    ends: Array
    faces: Array
    start: Array
    fans: Fans
    which: Array

    @classmethod
    def of(cls, mesh: Mesh, fans: Fans) -> Self:
        """Those of all open fans."""
        which = np.flatnonzero(~fans.closed)
        first = fans.corners[fans.offsets[which]]
        last = fans.corners[fans.offsets[which + 1] - 1]
        ends = mesh.indices[np.stack([mesh.next_corner[first], mesh.previous_corner[last]], axis=1)]
        faces = fans.sizes[which]
        start = mesh.n_corners + np.concatenate([[0], np.cumsum(np.where(faces == 1, 3, faces))])
        return cls(fans.vertex[which], ends, faces, start, fans, which)

    @property
    def counts(self) -> Array:
        """Squares beyond each, (m,)."""
        return np.diff(self.start)

    def corners(self, which: Array, position: int) -> Array:
        """The corner of the cage that some have at a place in their fans; -1 is the last."""
        offsets = self.fans.offsets
        begin = offsets[self.which[which]] if position >= 0 else offsets[self.which[which] + 1]
        return np.asarray(self.fans.corners[begin + position])


@dataclass(frozen=True, eq=False)
class Step:
    """What one step makes of a mesh.

    Attributes
    ----------
    mesh : Mesh
        That which is refined.
    fans : Fans
        What surrounds its vertices.
    rim : Rim or None
        Its boundary, if there are points beyond that.
    """

    mesh: Mesh
    fans: Fans
    rim: Rim | None

    @classmethod
    def of(cls, mesh: Mesh, rules: Rules) -> Self:
        """The step of a mesh."""
        fans = Fans.of(mesh.connectivity, mesh.twin)
        return cls(mesh, fans, None if rules.boundary == "none" else Rim.of(mesh, fans))

    @property
    def n_points(self) -> int:
        """Number of points after it: at the corners of all faces, then beyond the boundary."""
        return self.mesh.n_corners if self.rim is None else int(self.rim.start[-1])

    def operator(self, rules: Rules, number: NumberType) -> Any:
        """The points that it makes, as rows over those of the vertices."""
        mesh, V, H = self.mesh, self.mesh.n_vertices, self.mesh.n_corners
        inner = _operator(corner_rows(mesh, rules, number), np.arange(H), (H, V), number)
        more = self.beyond(rules, number)
        if more is None:
            return inner
        every = np.arange(V)
        own = sparse_operator(every, every, number.full(V, number.one), (V, V))
        return stacked([inner, more @ stacked([own, inner])])

    def beyond(self, rules: Rules, number: NumberType) -> Any:
        """The points beyond the boundary, as rows over the vertices, then the corners; or None."""
        mesh, V, H = self.mesh, self.mesh.n_vertices, self.mesh.n_corners
        if self.rim is None or not len(self.rim.vertex):
            return None
        found = rim_rows(mesh, self.rim, rules, V + np.arange(H), number)
        place = np.concatenate([place for place, _ in found]) - H
        rows: Any = tuple(np.concatenate(x) for x in zip(*(r for _, r in found), strict=True))
        return _operator(rows, place, (self.n_points - H, V + H), number)

    @cached_property
    def faces(self) -> tuple[Array, Array, Array]:
        """Sizes and vertices of the refined faces, and at which corner of a square each of these.

        Those of faces, of edges by their first half-edge, and of vertices by their fans. A refined
        vertex is a square of its limit face, with these faces at its corners.
        """
        mesh, fans, rim = self.mesh, self.fans, self.rim
        corners, after, twin = np.arange(mesh.n_corners), mesh.next_corner, mesh.twin
        edge = np.flatnonzero(twin > corners)
        sides = [np.stack([edge, after[twin[edge]], twin[edge], after[edge]], axis=1)]
        if rim is not None:
            # from the vertex on, whose first face has the half-edge
            every = np.arange(len(rim.vertex))
            first, last = rim.corners(every, 0), rim.corners(every, -1)
            begin = np.full(mesh.n_corners, -1)
            begin[last] = rim.start[:-1]
            beyond = rim.start[1:] - 1, begin[after[first]]
            sides.append(np.stack([first, *beyond, after[first]], axis=1))
            edge = np.concatenate([edge, first])
        around, starts, which = _around(self)
        sizes = np.diff(np.append(starts, len(around)))
        if (sizes < 3).any():
            vertex = vertex_numbers(mesh)[fans.vertex[which[(sizes < 3).argmax()]]]
            raise MeshError(
                f"vertex {vertex} is amid two faces: of it a dual scheme makes a face of two "
                "corners, which no mesh has; the limit can be evaluated there, but meshes cannot "
                "be refined"
            )
        of_edges = np.concatenate(sides)[np.argsort(edge, kind="stable")]
        indices = np.concatenate([corners, of_edges.ravel(), around])
        counts = np.concatenate([mesh.sizes, np.full(len(of_edges), 4), sizes])
        roles = [
            np.full(len(corners), 2),
            np.tile([1, 3], 2 * len(of_edges)),
            np.zeros(len(around)),
        ]
        return counts, indices, np.concatenate(roles).astype(np.int8)

    @cached_property
    def corner_at(self) -> Array:
        """The corner of the refined mesh that each refined vertex has in each role, (n, 4)."""
        _, indices, roles = self.faces
        found = np.full((self.n_points, 4), -1)
        found[indices, roles] = np.arange(len(indices))
        return found

    @property
    def parent(self) -> Array:
        """The face of the mesh that each refined face takes after: that of its first corner."""
        counts, indices, _ = self.faces
        return np.asarray(self.mesh.corner_face[indices[np.cumsum(counts) - counts]])

    def child(self, points: Array) -> Mesh:
        """The refined mesh with given points."""
        sizes, indices, _ = self.faces
        return valid_mesh(Mesh, points, Connectivity(self.n_points, sizes, indices))


def _operator(rows: Rows, place: Array, shape: tuple[int, int], number: NumberType) -> Any:
    """Rows at their places."""
    counts, columns, values = rows
    return sparse_operator(np.repeat(place, counts), columns, values, shape)


def refined_points(step: Step, rules: Rules, points: Array) -> Array:
    """The points after a step from those before, (n_vertices, d).

    In float64 at a cost that is linear in the corners of polygons, where masks do the same to all
    waves but the slowest; an operator has the square of their number.
    """
    number, scheme, mesh = numbers.type_of(points), rules.scheme, step.mesh
    waves: Waves | None = getattr(scheme, "waves", None)
    many = mesh.sizes > _MANY
    if number.exact or waves is None or not many.any():
        return np.asarray(step.operator(rules, number) @ points)
    H, V = mesh.n_corners, mesh.n_vertices
    rows = corner_rows(mesh, rules, number, _MANY)
    inner = _operator(rows, np.arange(H), (H, V), number) @ points
    for n in np.unique(mesh.sizes[many]).tolist():
        corners = mesh.offsets[np.flatnonzero(mesh.sizes == n)][:, None] + np.arange(n)
        inner[corners] = _by_waves(waves, points[mesh.indices[corners]])
    more = step.beyond(rules, number)
    return (
        inner if more is None else np.concatenate([inner, more @ np.concatenate([points, inner])])
    )


def _by_waves(waves: Waves, points: Array) -> Array:
    """The new points at the corners of n-gons, (m, n, d), from their points."""
    n, first = points.shape[1], points[:, :1]
    steps, once = points - first, circle(n)
    slow = np.einsum("kn,mnd->mkd", 2 / n * once, steps)
    turned = np.einsum("kn,mkd->mnd", once, slow)
    mean = steps.mean(axis=1, keepdims=True)
    own, share = float(waves.own), float(waves.once)
    return np.asarray(first + own * steps + (1 - own) * mean + share * turned)


def circle(n: int) -> Array:
    """Cosines and sines of n steps once around, (2, n)."""
    turn = np.arange(n) * (2 * np.pi / n)
    return np.stack([np.cos(turn), np.sin(turn)])


def parents(lineage: Sequence[Mesh], rules: Rules, lattice: Lattice) -> tuple[Array, Array, Array]:
    """Limit face and parameters of each vertex of the last mesh: the middle of its square.

    The lineage is from the cage on, refined by the rules. Vertices of the cage itself are at the
    corners of limit faces; -1 and NaN for those beyond boundaries and for unused ones.
    """
    cage = lineage[0]
    face = np.full(cage.n_vertices, -1)
    uv = np.full((cage.n_vertices, 2), np.nan)
    domain = np.array(lattice.corners, dtype=float)
    corner = np.arange(cage.n_corners) - cage.offsets[cage.corner_face]
    whole_face = cage.sizes[cage.corner_face] == lattice.face_size
    limit = first_limit_face(cage, lattice)[cage.corner_face] + np.where(whole_face, 0, corner)
    turn = np.where(whole_face, corner, 0)
    if len(lineage) == 1:
        hole = np.isin(cage.corner_face, cage.holes)
        # the last to be written stays: the first face that has a limit
        for corners in (np.flatnonzero(hole)[::-1], np.flatnonzero(~hole)[::-1]):
            face[cage.indices[corners]] = limit[corners]
            uv[cage.indices[corners]] = domain[turn[corners]]
        return face, uv[:, 0], uv[:, 1]
    # quads are four squares, limit faces of others one
    size = np.where(whole_face, 0.5, 1.0)
    middle = np.where(whole_face[:, None], 0.25 + domain[turn] / 2, 0.5)
    for k, mesh in enumerate(lineage[1:]):
        more = mesh.n_vertices - len(limit)
        limit, turn = (np.append(x, np.full(more, fill)) for x, fill in ((limit, -1), (turn, 0)))
        size = np.append(size, np.ones(more))
        middle = np.concatenate([middle, np.full((more, 2), np.nan)])
        if k == len(lineage) - 2:
            break
        _, indices, roles = Step.of(lineage[k], rules if k == 0 else _inner(rules)).faces
        towards = (turn[indices] + roles) % 4
        middle = middle[indices] + (domain[towards] - 0.5) * (size[indices] / 2)[:, None]
        # corner 0 of a square is at the vertex that it is made at, the middle of the one before
        limit, size, turn = limit[indices], size[indices] / 2, (towards + 2) % 4
    return limit, middle[:, 0], middle[:, 1]


def _inner(rules: Rules) -> Rules:
    """The rules of refined meshes, whose boundaries have no limit."""
    return replace(rules, boundary="none")


def limits(mesh: Mesh, rules: Rules, points: Array) -> Array:
    """Limits of the vertices, (n_vertices, d): the middle of what surrounds them after a step.

    Of several fans the last; NaN where there are none.
    """
    step = Step.of(mesh, rules)
    around, fans, which = _around(step)
    result = np.full_like(points, np.nan)
    if not len(which):
        return result
    fine = refined_points(step, rules, points)
    first = around[fans]
    counts = np.diff(np.append(fans, len(around)))
    _smooth(rules, counts)
    steps = fine[around] - np.repeat(fine[first], counts, axis=0)
    number = numbers.type_of(points)
    mean = np.add.reduceat(steps, fans, axis=0) / number.array(counts)[:, None]
    result[step.fans.vertex[which]] = fine[first] + mean
    return result


def limit_normals(mesh: Mesh, rules: Rules, points: Array, rounded: bool) -> Array:
    """Unit limit normals at the corners, (n_corners, 3), by the waves once around each vertex.

    NaN where there is none: amid two faces, on boundaries without a limit.
    """
    step = Step.of(mesh, rules)
    around, fans, which = _around(step)
    result = np.full((len(step.fans.vertex), 3), np.nan)
    if len(which):
        fine = refined_points(step, rules, points)
        counts = np.diff(np.append(fans, len(around)))
        angle = 2 * np.pi * (np.arange(len(around)) - np.repeat(fans, counts))
        angle /= np.repeat(counts, counts)
        steps = fine[around] - np.repeat(fine[around[fans]], counts, axis=0)
        size = np.add.reduceat(np.abs(steps).max(axis=1), fans)
        noise = size + (np.abs(fine).max() if rounded else 0) * counts
        waves = [
            np.add.reduceat(wave(angle)[:, None] * steps, fans, axis=0) for wave in (np.cos, np.sin)
        ]
        bound = kernels.NOISE * noise[:, None]
        found = kernels.unit_normals(waves[0], waves[1], (bound, bound))
        found[(counts < 3) | ~_smooth(rules, counts)] = np.nan
        result[which] = found
    found = result[step.fans.fan]
    found[np.isin(mesh.corner_face, mesh.holes)] = np.nan
    return found


def _smooth(rules: Rules, counts: Array) -> Array:
    """Whether there are tangent planes amid so many points; masks without a limit are refused.

    Masks that scale all but the slowest waves alike have both: of others their spectrum tells.
    """
    scheme: Any = rules.scheme
    if scheme.waves is not None:
        return np.ones(len(counts), dtype=bool)
    several, where = np.unique(counts, return_inverse=True)
    planes = [
        n < 3 or tables.eigen_table(scheme, scheme.sector("interior", n)).normal.size
        for n in several.tolist()
    ]
    return np.array(planes, dtype=bool)[where]


def _around(step: Step) -> tuple[Array, Array, Array]:
    """Refined points around the fans that have a limit, where each fan begins, and which they are.

    In turn; on boundaries those beyond are the last.
    """
    fans, rim = step.fans, step.rim
    around, sizes = fans.corners, fans.sizes
    if rim is None:
        around, sizes = around[np.repeat(fans.closed, sizes)], sizes[fans.closed]
        which = np.flatnonzero(fans.closed)
    else:
        counts = np.zeros(len(sizes), dtype=np.int64)
        counts[rim.which] = rim.counts
        place = np.repeat(fans.offsets[1:], counts)
        around = np.insert(around, place, np.arange(rim.start[0], rim.start[-1]))
        sizes, which = sizes + counts, np.arange(len(sizes))
    return around, np.cumsum(sizes) - sizes, which


def masks(scheme: Any, n: int, number: NumberType, where: str) -> Array:
    """The mask of n corners; a TypeError where it is irrational, but numbers exact."""
    if number.exact and not scheme.is_rational(n):
        raise TypeError(
            f"{where} has {n} corners, where the masks of scheme {scheme.name!r} are irrational: "
            "there are no exact points; take float64, as in "
            "mesh.with_points(mesh.points.astype(float))"
        )
    return _mask(scheme, n, number)


@lru_cache(maxsize=256)
def _mask(scheme: Any, n: int, number: NumberType) -> Array:
    waves: Waves | None = scheme.waves
    if number.exact or waves is None or n <= _MANY:
        return read_only(number.array(list(scheme.mask(n))))
    own, once = float(waves.own), float(waves.once)
    found = (1 - own + 2 * once * circle(n)[0]) / n
    found[0] += own
    return read_only(found)


@lru_cache(maxsize=256)
def _mirrors(scheme: Any, k: int, number: NumberType) -> Array | None:
    """The ratios of `DualScheme.rim`; None where they are irrational, but numbers exact."""
    ratios = scheme.rim(k)
    if number.exact and not all(isinstance(r, Fraction) for r in ratios):
        return None
    return read_only(number.array(list(ratios)))


def corner_rows(mesh: Mesh, rules: Rules, number: NumberType, most: int | None = None) -> Rows:
    """The points at the corners of faces, as rows over those of the vertices.

    Those of more than so many corners have empty ones.
    """
    scheme: Any = rules.scheme
    sizes = mesh.sizes if most is None else np.where(mesh.sizes > most, 0, mesh.sizes)
    counts = sizes[mesh.corner_face]
    starts = np.concatenate([[0], np.cumsum(counts)])
    columns = np.empty(starts[-1], dtype=np.int32)
    values = np.empty(starts[-1], dtype=number.dtype)
    for n in np.unique(sizes[sizes > 0]).tolist():
        faces = np.flatnonzero(sizes == n)
        mask = masks(scheme, n, number, f"face {faces[0]}")
        corners = mesh.offsets[faces][:, None] + np.arange(n)
        turns = (np.arange(n)[:, None] + np.arange(n)) % n  # of a corner, from it on
        place = starts[corners][..., None] + np.arange(n)
        columns[place] = mesh.indices[corners][:, turns]
        values[place] = mask
    return counts, columns, values


def rim_rows(
    mesh: Mesh, rim: Rim, rules: Rules, points: Array, number: NumberType
) -> list[tuple[Array, Rows]]:
    """The points of squares beyond a boundary: which, and their rows over points.

    `points` (n_corners,) are those at the corners of faces.
    """
    scheme: Any = rules.scheme
    found = []
    for k in np.unique(rim.faces).tolist():
        here = np.flatnonzero(rim.faces == k)
        r = _mirrors(scheme, k, number)
        if r is None:
            name = vertex_numbers(mesh)[rim.vertex[here[0]]]
            raise TypeError(
                f"vertex {name} is on the boundary and has {k} faces, where the points beyond it "
                f"are irrational under scheme {scheme.name!r}: there are no exact points; take "
                "float64, as in mesh.with_points(mesh.points.astype(float))"
            )
        one, last = number.one, len(r) - 1
        # c + d + r (c - d) - w, with c and d as Chaikin has them
        ends, vertex = rim.ends[here], rim.vertex[here]
        for j in range(last + 1):
            own = points[rim.corners(here, min(j, k - 1))]
            columns = np.stack([vertex, ends[:, 0], ends[:, 1], own], axis=1)
            near, far = (one + r[j]) / 4, (one - r[j]) / 4
            weights = number.array([6 * one / 4, near, far, -one])
            place = rim.start[here] + (last - j if k > 1 else (2, 0)[j])
            counts = np.full(len(here), 4)
            found.append((place, (counts, columns.ravel(), np.tile(weights, len(here)))))
        if k == 1:
            found.append(_opposite(rim, here, rules, points, number))
    return found


def _opposite(
    rim: Rim, here: Array, rules: Rules, points: Array, number: NumberType
) -> tuple[Array, Rows]:
    """The point opposite to the only face of a vertex: that of the face, or what holds the vertex.

    ``x = 4 v - w - g_0 - g_1``, where g_0 + g_1 are ``3 v + (a + b) / 2 - 2 w``.
    """
    one, own = number.one, points[rim.corners(here, 0)]
    if rules.boundary == "edge_and_corner":
        columns = np.stack([rim.vertex[here], rim.ends[here, 0], rim.ends[here, 1], own], axis=1)
        weights = number.array([one, -one / 2, -one / 2, one])
    else:
        columns, weights = own[:, None], number.array([one])
    counts = np.full(len(here), columns.shape[1])
    return rim.start[here] + 1, (counts, columns.ravel(), np.tile(weights, len(here)))
