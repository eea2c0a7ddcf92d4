"""Approximate patches, one to a quad, as games draw them: bicubic ones, and Gregory's.

Masks are those of Loop and Schaefer (2008) and of Loop, Schaefer, Ni and Castano (2009), for all
corners of faces at once. They are derived in ``derivations/approximate.py``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf import html
from limitsurf.cage.checks import checked_integer
from limitsurf.cage.mesh import Mesh
from limitsurf.engine.protocol import Request
from limitsurf.patches import NO_LIMIT, REGULAR
from limitsurf.query.bezier import bezier_patches
from limitsurf.query.deviation import Deviation, deviation, length
from limitsurf.query.index import checked_surface
from limitsurf.query.polynomials import line_values
from limitsurf.refine import refined
from limitsurf.surface import LimitSurface

Array = NDArray[Any]
Kind: TypeAlias = Literal["acc", "gregory"]

KINDS: tuple[str, ...] = get_args(Kind)
# of the corners of a quad, counter-clockwise: the Bezier points there, towards the next and the
# previous corner, and inside
_CORNER = (0, 0), (3, 0), (3, 3), (0, 3)
_NEXT = (1, 0), (3, 1), (2, 3), (0, 2)
_PREVIOUS = (0, 1), (2, 0), (3, 2), (1, 3)
_INSIDE = (1, 1), (2, 1), (2, 2), (1, 2)
_ROW, _COLUMN = np.array(_INSIDE).T - 1


@dataclass(frozen=True, eq=False, repr=False)
class ApproximatePatches:
    """Patches near a limit surface, made by `approximate`.

    Attributes
    ----------
    kind : {"acc", "gregory"}
    levels : int
        How often the cage was refined before.
    mesh : Mesh
        The cage that has a patch over each of its faces, refined so often. Places are faces of it,
        with u and v as on limit faces.
    points : (n, 4, 4, 3) float64
        Bezier points: i counts along u, j along v. NaN on faces without a limit. Inside of
        Gregory's they are the means of two.
    along, across : (n, 3, 4, 3) and (n, 4, 3, 3), or None
        Of "acc": Bezier points of the fields of tangents along u and along v, of degree 2 in their
        own direction, whose cross product is the normal. They are not derivatives.
    inside : (n, 2, 2, 2, 3), or None
        Of "gregory": the two points of each that is inside, at (i, j) = (1, 1) to (2, 2), first
        that of the edge along u.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> cube = ls.LimitSurface(ls.Mesh(points, quads))
    >>> ls.approximate(cube, "gregory")
    ApproximatePatches(6 patches, gregory)
    """

    kind: str
    levels: int
    mesh: Mesh
    points: Array
    along: Array | None
    across: Array | None
    inside: Array | None
    _fine: LimitSurface = field(repr=False)

    def __len__(self) -> int:
        return len(self.points)

    def _repr_html_(self) -> str:
        known = {"patches": len(self), "kind": self.kind, "levels": self.levels}
        return html.facts(type(self).__name__, known)

    def __repr__(self) -> str:
        n = len(self)
        return f"{type(self).__name__}({n} patch{'es' * (n != 1)}, {self.kind})"

    def evaluate(self, face: ArrayLike, u: ArrayLike, v: ArrayLike) -> Array:
        """Points of patches at (u, v), (..., 3); arguments broadcast.

        Parameters
        ----------
        face : array_like of int
            Faces of `mesh`.
        u, v : array_like
            In [0, 1].

        Raises
        ------
        IndexError, ValueError
            For a face or parameters out of range.

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
        >>> ls.approximate(ls.LimitSurface(square), "acc").evaluate(0, 0.25, 0.5).round(12).tolist()
        [0.25, 0.5, 0.0]
        """
        shape, which, s, t = self._places(face, u, v)
        points, _, _ = self._at(which, s, t)
        weights = line_values(3, s)[:, :, None] * line_values(3, t)[:, None]
        return np.asarray(np.einsum("qij,qijd->qd", weights, points).reshape(*shape, 3))

    def normal(
        self, face: ArrayLike, u: ArrayLike, v: ArrayLike, *, geometric: bool = False
    ) -> Array:
        """Unit normals of patches at (u, v), (..., 3): of "acc" those of its fields of tangents.

        Other arguments and errors are those of `evaluate`. NaN where tangents are dependent.

        Parameters
        ----------
        geometric : bool
            Of "acc", whether to give the normals of the patches themselves instead, by their
            derivatives: these jump from patch to patch.

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
        >>> patches = ls.approximate(ls.LimitSurface(square), "acc")
        >>> abs(patches.normal(0, 0.25, 0.5)).round(12).tolist()
        [0.0, 0.0, 1.0]
        """
        shape, which, s, t = self._places(face, u, v)
        b, c, e, f = (line_values(degree, x) for degree in (3, 2) for x in (s, t))
        if not geometric and self.along is not None and self.across is not None:
            du = np.einsum("qi,qj,qijd->qd", e, c, self.along[which])
            dv = np.einsum("qi,qj,qijd->qd", b, f, self.across[which])
        else:
            points, along, across = self._at(which, s, t)
            du = 3 * np.einsum("qi,qj,qijd->qd", e, c, np.diff(points, axis=1))
            dv = 3 * np.einsum("qi,qj,qijd->qd", b, f, np.diff(points, axis=2))
            inner = b[:, 1:3, None] * c[:, None, 1:3]
            du += np.einsum("qij,qijd->qd", inner, along)
            dv += np.einsum("qij,qijd->qd", inner, across)
        with np.errstate(invalid="ignore", divide="ignore"):
            cross = np.cross(*(x / length(x)[:, None] for x in (du, dv)))
            return np.asarray(cross / length(cross)[:, None]).reshape(*shape, 3)

    def error(self, surface: LimitSurface, *, workers: int = 1) -> Deviation:
        """How far the patches are from the limit surface that they approximate, face by face.

        Parameters
        ----------
        surface : LimitSurface
            That of which they were made, or one of the same faces.
        workers : int
            Threads, as for `LimitSurface.evaluate`.

        Returns
        -------
        Deviation
            With a row to each face of `mesh`.

        Raises
        ------
        ValueError
            For a surface of other faces.

        Examples
        --------
        >>> import limitsurf as ls
        >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
        >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1],
        ...          [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
        >>> cube = ls.LimitSurface(ls.Mesh(points, quads))
        >>> found = ls.approximate(cube, "acc").error(cube)
        >>> bool((found.parametric_found <= found.parametric).all())
        True
        """
        fine = _fine(checked_surface(surface), self.levels)
        if not np.array_equal(fine.mesh.indices, self.mesh.indices):
            raise ValueError("the surface has other faces than that of which the patches were made")
        half = None
        if self.inside is not None:
            half = np.zeros(self.points.shape)
            half[:, 1:3, 1:3] = (self.inside[..., 0, :] - self.inside[..., 1, :]) / 2
        tangents = None
        if self.along is not None and self.across is not None:
            tangents = self.along, self.across
        asked = self.evaluate, self.normal
        return deviation(fine, self.points, half, asked, tangents, workers)

    def _places(
        self, face: ArrayLike, u: ArrayLike, v: ArrayLike
    ) -> tuple[tuple[int, ...], Array, Array, Array]:
        request = Request.of(face, np.asarray(u, float), np.asarray(v, float), False, 1)
        request.check(len(self), self._fine.topology.lattice)
        which, s, t = (np.ravel(x) for x in (request.face, request.u, request.v))
        return request.face.shape, which, s, t

    def _at(self, which: Array, s: Array, t: Array) -> tuple[Array, Array, Array]:
        """Bezier points (Q, 4, 4, 3) at places, and derivatives of those inside, (Q, 2, 2, 3)."""
        points = self.points[which]
        along, across = np.zeros((2, len(which), 2, 2, 3))
        if self.inside is None:
            return points, along, across
        two = self.inside[which]
        # distances from the corner that is nearest to each
        a = np.stack([s, 1 - s], axis=1)[:, :, None, None]
        b = np.stack([t, 1 - t], axis=1)[:, None, :, None]
        sum_ = a + b
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(sum_ > 0, a / sum_, 0.5)
            fall = np.where(sum_ > 0, 1 / sum_**2, 0.0)
        step = two[..., 0, :] - two[..., 1, :]
        points = points.copy()
        points[:, 1:3, 1:3] = two[..., 1, :] + share * step
        sign = np.array([1.0, -1.0])
        along = b * fall * step * sign[:, None, None]
        across = -a * fall * step * sign[None, :, None]
        return points, along, across


def approximate(
    surface: LimitSurface, kind: Kind, *, levels: int = 0, workers: int = 1
) -> ApproximatePatches:
    """Patches near a limit surface, one to each quad, of the kinds that games and GPUs draw.

    Parameters
    ----------
    surface : LimitSurface
        Of Catmull-Clark's scheme, with float64 points (n_vertices, 3).
    kind : {"acc", "gregory"}
        * "acc": bicubic patches for places, with two fields of tangents for normals (Loop and
          Schaefer 2008). Places have creases where patches meet, normals do not.
        * "gregory": Gregory patches of degree 3, that meet smoothly (Loop, Schaefer, Ni and
          Castano 2009).
    levels : int
        How often the cage is refined before, so that there are 4 times as many patches each time,
        which are nearer to the surface.
    workers : int
        Threads, as for `LimitSurface.evaluate`, for faces that are one patch anyway.

    Returns
    -------
    ApproximatePatches

    Raises
    ------
    TypeError
        For what is no surface of float64 points.
    ValueError
        For an unknown kind, another scheme, and faces for which there are no masks here, of which
        the first is named: polygons that are not quads, and faces beside vertices that are not
        smooth or have two faces, if they are not one bicubic patch anyway.

    Notes
    -----
    Faces amid regular vertices, at boundaries and sharp edges too, are one bicubic patch exactly,
    of both kinds. Others need vertices that are smooth, amid at least 3 faces. At the corners the
    patches have the places and normals of the limit. The masks at other than regular vertices of
    boundaries (Loop et al. 2009) and creases (Kovacs, Mitchell, Drone and Zorin 2009), and Gregory
    patches on triangles, are left out. With `levels` of 1 all faces are quads, with 2 most of what
    is refused beside boundaries has gone.

    - C. Loop, S. Schaefer, "Approximating Catmull-Clark subdivision surfaces with bicubic patches",
      ACM Transactions on Graphics 27, 2008.
    - C. Loop, S. Schaefer, T. Ni, I. Castano, "Approximating subdivision surfaces with Gregory
      patches for hardware tessellation", ACM Transactions on Graphics 28, 2009.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> cube = ls.LimitSurface(ls.Mesh(points, quads))
    >>> patches = ls.approximate(cube, "acc", levels=1)
    >>> patches.points.shape
    (24, 4, 4, 3)
    """
    surface = checked_surface(surface)
    if kind not in KINDS:
        raise ValueError(f"kind must be one of {', '.join(KINDS)}, got {kind!r}")
    scheme = surface.topology.rules.scheme
    if scheme.name != "catmull-clark":
        raise ValueError(f"approximate patches are for the scheme catmull-clark, got {scheme.name}")
    levels = checked_integer("levels", levels, 0)
    fine = _fine(surface, levels)
    mesh, n = fine.mesh, fine.mesh.n_faces
    other = np.flatnonzero(mesh.sizes != 4)
    if len(other):
        raise ValueError(
            f"face {other[0]} has {mesh.sizes[other[0]]} corners, and approximate patches are for "
            "quads: ask for levels=1"
        )
    codes = fine.patches.codes[:n]
    known = codes != NO_LIMIT
    whole = np.zeros(n, dtype=bool)
    at = np.flatnonzero(codes >= 0)
    whole[at] = fine.patches.kind[codes[at]] == REGULAR
    smooth = _smooth(fine)[mesh.indices.reshape(n, 4)].all(axis=1)
    refused = np.flatnonzero(known & ~whole & ~smooth)
    if len(refused):
        raise ValueError(
            f"face {refused[0]} is beside a boundary, a sharp edge or vertex, or a vertex of two "
            f"faces, and not regular ({len(refused)} such faces): there are no masks for it; "
            "with more levels there may be"
        )
    corners = _Corners.of(mesh)
    points = np.full((n, 4, 4, 3), np.nan)
    along, across = np.full((n, 3, 4, 3), np.nan), np.full((n, 4, 3, 3), np.nan)
    inside = np.full((n, 2, 2, 2, 3), np.nan)
    exact = np.flatnonzero(whole)
    points[exact] = bezier_patches(fine, face=exact, workers=workers).points
    along[exact], across[exact] = (3 * np.diff(points[exact], axis=k) for k in (1, 2))
    inside[exact] = points[exact][:, 1:3, 1:3, None]
    rest = np.flatnonzero(known & ~whole)
    if kind == "gregory":
        points[rest], inside[rest] = _gregory(corners, rest)
        return ApproximatePatches(kind, levels, mesh, points, None, None, inside, fine)
    points[rest], along[rest], across[rest] = _loop_schaefer(corners, rest)
    return ApproximatePatches(kind, levels, mesh, points, along, across, None, fine)


def _fine(surface: LimitSurface, levels: int) -> LimitSurface:
    """The same surface over its refined cage."""
    if not levels:
        return surface
    mesh = refined(surface.mesh, levels, **surface.rules)
    return LimitSurface(mesh, **surface.rules, engine=surface.engine)


def _smooth(surface: LimitSurface) -> Array:
    """Whether vertices are smooth, amid at least three faces: (n_vertices,)."""
    mesh, cage = surface.mesh, surface.mesh.connectivity
    found = np.asarray(cage.valences >= 3)
    (edges, sharpness), (vertices, pinned) = mesh.creases, mesh.corners
    found[np.ravel(np.asarray(edges)[np.asarray(sharpness) > 0])] = False
    found[np.asarray(vertices)[np.asarray(pinned) > 0]] = False
    return found


@dataclass(frozen=True, eq=False)
class _Corners:
    """What masks add up, at all corners of faces (n_corners, ...).

    Where rings are open it is nothing that means anything.

    Attributes
    ----------
    n, position : (n_corners,) int
        Faces around the vertex, and place of the corner in their ring.
    next, previous, after, before : (n_corners,) int
        Corners of the face, and of the ring, beside each.
    vertex, edge, face : (n_corners, 3)
        Points: the vertex itself, the other end of the corner's edge, the opposite one of its face.
    indices : (n_corners,) int
        Vertices.
    """

    n: Array
    position: Array
    next: Array
    previous: Array
    after: Array
    before: Array
    vertex: Array
    edge: Array
    face: Array
    indices: Array

    @classmethod
    def of(cls, mesh: Mesh) -> _Corners:
        """Those of a mesh of quads."""
        cage, indices, points = mesh.connectivity, mesh.indices, mesh.points
        n = np.abs(cage.valences[indices])
        n = np.where(n > 0, n, 1)
        following, previous = cage.next_corner, cage.previous_corner
        twin = np.where(cage.twin < 0, np.arange(len(indices)), cage.twin)
        return cls(
            n, cage.ring_position, following, previous, twin[previous], following[twin],
            points[indices], points[indices[following]], points[indices[following[following]]],
            indices,
        )  # fmt: skip

    def around(self, values: Array, turn: float) -> Array:
        """Sums over rings of values (n_corners, 3) times cosines of angles from each corner.

        Entry j of a ring is at the angle ``2 pi (j + turn) / n`` from its first.
        """
        angle = 2 * np.pi * (self.position + turn) / self.n
        total = np.zeros((int(self.indices.max(initial=-1)) + 1, 3), dtype=complex)
        np.add.at(total, self.indices, values * np.exp(1j * angle)[:, None])
        own = np.exp(-2j * np.pi * self.position / self.n)
        return np.asarray((total[self.indices] * own[:, None]).real)

    def total(self, values: Array) -> Array:
        """Sums over rings, for each corner."""
        total = np.zeros((int(self.indices.max(initial=-1)) + 1, 3))
        np.add.at(total, self.indices, values)
        return np.asarray(total[self.indices])


def _placed(corners: Array, following: Array, previous: Array, inside: Array) -> Array:
    """Bezier points (m, 4, 4, 3) from those of corners, (m, 4, 3) each."""
    found = np.empty((len(corners), 4, 4, 3))
    for k in range(4):
        for place, values in (
            (_CORNER, corners), (_NEXT, following), (_PREVIOUS, previous), (_INSIDE, inside),
        ):  # fmt: skip
            found[:, place[k][0], place[k][1]] = values[:, k]
    return found


def _loop_schaefer(c: _Corners, faces: Array) -> tuple[Array, Array, Array]:
    """Bezier points of patches and of both fields of tangents, by Loop and Schaefer (2008)."""
    n = c.n[:, None]
    corner = (n * n * c.vertex + c.total(4 * c.edge + c.face)) / (n * (n + 5))
    sides = 4 * c.edge + 2 * (c.edge[c.before] + c.edge[c.after]) + c.face[c.before] + c.face
    along = (2 * n * c.vertex + sides) / (2 * n + 10)
    inside = (n * c.vertex + 2 * (c.edge + c.edge[c.after]) + c.face) / (n + 5)
    half = np.cos(np.pi / n)
    root = 1 / (n * np.sqrt(4 + half**2))
    tangent = c.around((1 / n + half * root) * c.edge, 0) + c.around(root * c.face, 0.5)
    lines = _lines(c, along, tangent)
    # across each corner's own edge, and across that to the corner before, a third of the way
    across = lines + 3 * (inside - along)
    beside = (lines - 3 * along)[c.after] + 3 * inside
    fields = corner, along, along[c.after], inside, tangent, tangent[c.after], across, beside
    corner, following, previous, inside, out, back, across, beside = (
        x.reshape(-1, 4, 3)[faces] for x in fields
    )
    points = _placed(corner, following, previous, inside)
    u, v = 3 * np.diff(points, axis=1), 3 * np.diff(points, axis=2)
    u[:, 0, 0], u[:, 2, 0], u[:, 2, 3], u[:, 0, 3] = out[:, 0], -back[:, 1], -out[:, 2], back[:, 3]
    v[:, 0, 0], v[:, 3, 0], v[:, 3, 2], v[:, 0, 2] = back[:, 0], out[:, 1], -back[:, 2], -out[:, 3]
    u[:, 0, 1], u[:, 0, 2] = beside[:, 0], across[:, 3]
    u[:, 2, 1], u[:, 2, 2] = -across[:, 1], -beside[:, 2]
    v[:, 1, 0], v[:, 2, 0] = across[:, 0], beside[:, 1]
    v[:, 1, 2], v[:, 2, 2] = -beside[:, 3], -across[:, 2]
    return points, u, v


def _gregory(c: _Corners, faces: Array) -> tuple[Array, Array]:
    """Bezier points of Gregory patches, and the two of each inside, by Loop et al. (2009)."""
    n = c.n[:, None]
    middle = (c.vertex + c.edge) / 2
    centre = (c.vertex + c.edge + c.edge[c.after] + c.face) / 4
    corner = (n - 3) / (n + 5) * c.vertex + 4 * c.total(middle + centre) / (n * (n + 5))
    half, cosine = np.cos(np.pi / n), np.cos(2 * np.pi / n)
    sigma = 1 / np.sqrt(4 + half**2)
    tangent = c.around((1 - sigma * half) * middle, 0) + c.around(2 * sigma * centre, 0.5)
    size = (5 + cosine + half * np.sqrt(18 + 2 * cosine)) / 16
    step = 4 / (3 * n) * size * tangent
    along = corner + step
    lines = _lines(c, along, 3 * step)
    other = (middle[c.after] - middle[c.before]) / 3 + 2 / 3 * (centre - centre[c.before])
    # as the edge of each corner has it, and as that to the corner before has it
    one, two = along + (lines + other) / 3, (along + (lines - other) / 3)[c.after]
    fields = corner, along, along[c.after], one, two
    corner, following, previous, one, two = (x.reshape(-1, 4, 3)[faces] for x in fields)
    inside = np.empty((len(faces), 2, 2, 2, 3))
    for k, (i, j) in enumerate(_INSIDE):
        inside[:, i - 1, j - 1, k % 2], inside[:, i - 1, j - 1, 1 - k % 2] = one[:, k], two[:, k]
    return _placed(corner, following, previous, inside.mean(axis=3)[:, _ROW, _COLUMN]), inside


def _lines(c: _Corners, along: Array, tangent: Array) -> Array:
    """What tangents across edges have in common with those along them, a third of the way.

    On both sides of an edge of the tangents t0, t1, t2, between vertices of n and m faces, those
    across it are ``(1 - x) cos(2 pi / n) - x cos(2 pi / m)`` times the tangent, and the same vector
    to both sides.
    """
    cosine = np.cos(2 * np.pi / c.n)[:, None]
    middle = 3 * (along[c.after[c.next]] - along)
    return np.asarray((2 * cosine * middle - cosine[c.next] * tangent) / 3)
