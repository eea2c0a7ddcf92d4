"""How far patches are from a limit surface, and from each other along edges."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import html
from limitsurf.cad.bspline import BSplineFaces
from limitsurf.cad.edges import Sides, across, inner_edges, spokes
from limitsurf.cad.poles import Poles
from limitsurf.cad.splines import Splines
from limitsurf.query.approximate import ApproximatePatches
from limitsurf.query.deviation import Deviation, length
from limitsurf.query.index import checked_surface
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_CELLS = 1 << 16  # at once
_STEPS = np.array([0.0, 0.25, 0.5, 0.75, 1.0])  # of places in cells
_OF_POINTS = 2.0**-50  # of the size of control points, by which points are rounded
_OF_SLOPES = 2.0**-47  # of the size of control points over knots, by which slopes are rounded
_ROUNDED = 2.0**-46  # of the size, by which faces that are exact may be off


@dataclass(frozen=True, eq=False, repr=False)
class PatchDeviation(Deviation):
    """How far patches are from a limit surface and from each other, made by `deviation`.

    Attributes
    ----------
    parametric, parametric_found : (n,)
        As of `Deviation`: the largest distances at the same (u, v), a bound and what was found.
    along_normal, along_normal_found : (n,)
        The same of their parts along the normals of the surface.
    angle, angle_found, geometric_angle, geometric_angle_found : (n,)
        As of `Deviation`, radians; of splines both are the same. Those of splines leave out what
        rounding does to derivatives: bounds of exact faces are 0, and of an angle that is found
        only what rounding cannot have made counts. That is nothing where a face has no area.
    edges : (e, 2) int64
        The limit faces on both sides of each edge between two (of `ApproximatePatches`, the faces):
        those of edges of the cage, then those of the ways from there to the middles of n-gons. An
        edge beside an n-gon has two limit faces there, of which it is the first.
    gap, gap_found : (e,)
        The largest distances along these edges between the patches on both sides.
    edge_angle, edge_angle_found : (e,)
        The largest angles between their normals there, radians. NaN for the bound on sharp edges,
        where the surface itself has two normals. The bound holds for the faces as they are, with
        what rounding does to them: around poles of ``poles="g1"`` it is nothing else.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> cube = ls.LimitSurface(ls.Mesh(points, quads))
    >>> found = ls.deviation(cube, ls.bspline_faces(cube, depth=6))
    >>> bool((found.gap < 1e-14).all() and (found.parametric_found <= found.parametric).all())
    True
    """

    along_normal: Array
    edges: Array
    gap: Array
    gap_found: Array
    edge_angle: Array
    edge_angle_found: Array

    def _repr_html_(self) -> str:
        n = len(self.parametric)
        names = [field.name for field in fields(self)]
        first = names.index("edges")
        along = ["along_normal", *names[:first]]
        columns = {name: getattr(self, name) for name in dict.fromkeys(along)}
        return html.table({"face": np.arange(n), **columns}, repr(self))

    def __repr__(self) -> str:
        gap = np.max(self.gap, initial=0)
        return f"{super().__repr__()[:-1]}, gaps at most {gap:.3g})"


def deviation(
    surface: LimitSurface,
    patches: BSplineFaces | ApproximatePatches,
    *,
    channel: str | None = None,
    workers: int = 1,
) -> PatchDeviation:
    """How far patches are from the limit surface they were made of, and from each other.

    Parameters
    ----------
    surface : LimitSurface
        Of points (n_vertices, 3).
    patches : BSplineFaces or ApproximatePatches
        As `bspline_faces` and `approximate` make them of this surface.
    channel : str, optional
        A face-varying channel of three numbers, if they were made of it.
    workers : int
        Threads, as for `LimitSurface.evaluate`.

    Returns
    -------
    PatchDeviation
        With a row to each patch, and to each edge between two limit faces.

    Raises
    ------
    TypeError
        For what are no such patches, or no surface of float64 points.
    ValueError
        For patches of another surface.

    Notes
    -----
    B-spline faces are the limit itself, to rounding, but for cells at special corners; there both
    are compared ring by ring, by the Bernstein coefficients of their difference, and a hull bounds
    what is beyond the last ring (``derivations/spline_faces.py``). Along edges both sides are
    polynomials, whose normals are compared without the limit. On the cages that were tried bounds
    were within 3 times what was found, but not where that is rounding, and not where no limit of
    the normal is proved at a corner, or faces fold: there bounds of angles are pi, and those along
    the normal were up to 300 times too large. What is found is the largest at 25 places of each
    cell at a special corner between knots, in rings of these, and at the middles of other cells.
    All edges are measured.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> cube = ls.LimitSurface(ls.Mesh(points, quads))
    >>> found = ls.deviation(cube, ls.bspline_faces(cube, tolerance=1e-4))
    >>> bool(found.parametric.max() <= 1e-4)
    True
    """
    found = checked_surface(surface, channel)
    if isinstance(patches, ApproximatePatches):
        return _of_approximate(found, patches, workers)
    if not isinstance(patches, BSplineFaces):
        raise TypeError(
            f"patches must be BSplineFaces or ApproximatePatches, got {type(patches).__name__}"
        )
    made = patches.surface
    same = made is found or (
        np.array_equal(made.mesh.indices, found.mesh.indices)
        and np.array_equal(made.points, found.points, equal_nan=True)
        and made.rules == found.rules
    )
    if not same:
        raise ValueError("the patches were made of another surface")
    owner, errors = patches.cap_errors
    size = float(np.abs(found.points[found.mesh.indices]).max(initial=0))
    values = np.zeros((6, len(patches)))
    values[:2] = _ROUNDED * size
    for row, name in enumerate((
        "parametric", "along_normal", "angle",
        "parametric_found", "along_normal_found", "angle_found",
    )):  # fmt: skip
        np.maximum.at(values[row], owner, getattr(errors, name))
    near = _Near.of(patches)
    error = _rounding(near)
    sampled = _sampled(found, patches, near, error, workers)
    np.maximum(values[3:], sampled, out=values[3:])
    if (values[3] > values[0]).any():
        k = int(np.argmax(values[3] - values[0]))
        raise ValueError(f"face {k} of the patches is not as it was made of the surface")
    half, ways, lines = inner_edges(found), spokes(found), _lines(found, patches)

    def sides(face: Array, u: Array, v: Array) -> Sides:
        """Those of places of limit faces."""
        which, x, y = (np.ravel(a) for a in patches.of(face, u, v))
        value, du, dv = near.splines.jet(which, x, y, 1)
        origin = near.origin[which]
        return Sides(value, None, origin, error[2, which], du, dv, error[:2, which])

    edges, ends = across(found, half, ways, lines, patches.degree[0], sides)
    bound = np.maximum(edges[3], 0)
    bound[: len(half)][_sharp(found, half)] = np.nan
    return PatchDeviation(
        values[0], values[3], values[4], values[5], values[5], values[2], values[2], values[1],
        ends, edges[0], edges[1], bound, edges[2],
    )  # fmt: skip


def _sampled(
    surface: LimitSurface, faces: BSplineFaces, near: _Near, rounding: Array, workers: int
) -> Array:
    """Largest distances, distances along normals, and angles at places of all cells, (3, n).

    Angles are those that `rounding` of derivatives cannot have made. 25 of those at special
    corners, and one of each other, which takes all control points.
    """
    found = np.zeros((3, len(faces)))
    p, q = faces.degree
    spans = faces.counts - (p, q)
    number = spans.prod(axis=1)
    x, y = (a.ravel() for a in np.meshgrid(_STEPS, _STEPS, indexing="ij"))
    middle = np.array([1 / 2]), np.array([1 / 2])
    if faces.trims is not None:
        x, y = x[x + y <= 1], y[x + y <= 1]
        middle = np.array([1 / 3]), np.array([1 / 3])
    splines, ends = faces.splines, np.cumsum(number)
    total = int(ends[-1]) if len(ends) else 0
    for start in range(0, total, _CELLS):
        cell = np.arange(start, min(start + _CELLS, total))
        face = np.searchsorted(ends, cell, side="right")
        i, j = np.divmod(cell - (ends - number)[face], spans[face, 1])
        low, high = (
            np.stack([
                faces.knots_u[splines.first_u[face] + p + i + more],
                faces.knots_v[splines.first_v[face] + q + j + more],
            ]) for more in (0, 1)
        )  # fmt: skip
        place = (low + high) / (2 if faces.trims is None else 3)
        whole = (high > low).all(axis=0)
        special = whole & _at_corner(surface, faces, face, place)
        for some, places in ((whole & ~special, middle), (special, (x, y))):
            a, b = low[:, some, None], high[:, some, None]
            u, v = a + (b - a) * np.stack(places)[:, None]
            which = np.repeat(face[some], len(places[0]))
            at = which, u.ravel(), v.ravel()
            errors = _errors(surface, faces, near, rounding[:2, which], at, workers)
            for k in range(3):
                np.maximum.at(found[k], which, errors[k])
    return found


def _at_corner(surface: LimitSurface, faces: BSplineFaces, face: Array, place: Array) -> Array:
    """Whether places (2, q) of faces (q,) are within cells at special corners, (q,)."""
    where, at = faces.on_surface(face, *place)
    found = np.zeros(len(face), dtype=bool)
    more = surface.limit_faces.corner[where] >= 0
    for k, corner in enumerate(surface.topology.lattice.corners):
        depth = faces.depths[where, k]
        far = np.abs(at - np.array(corner))
        if faces.trims is not None:
            far = (at.sum(axis=1) if k == 0 else 1 - at[:, k - 1])[:, None]
        found |= (depth >= 0) & (far.max(axis=1) < np.ldexp(1.0, more - depth))
    return found


def _errors(
    surface: LimitSurface,
    faces: BSplineFaces,
    near: _Near,
    rounding: Array,
    place: tuple[Array, ...],
    workers: int,
) -> Array:
    """Distances, distances along normals, and angles at places (q,) of faces, (3, q).

    `rounding` (2, q) bounds errors of derivatives: those of the surface are no larger.
    """
    limit_face, at = faces.on_surface(*place)
    known = limit_face, *at.T
    value, du, dv = near.jet(*place)
    step = value - surface.evaluate(*known, workers=workers)
    truth = surface.normal(*known, workers=workers)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        sizes = [np.abs(d).max(axis=1) for d in (du, dv)]
        du, dv = (d / size[:, None] for d, size in zip((du, dv), sizes, strict=True))
        other = np.cross(du, dv)
        area = length(other)
        other /= area[:, None]
        # (a unit vector turns by as much as errors are of the area, and cross products have two)
        doubt = 4 * (rounding[0] / sizes[0] + rounding[1] / sizes[1]) / area
    angle = 2 * np.arctan2(length(truth - other), length(truth + other))
    angle = np.maximum(angle - np.nan_to_num(doubt, nan=np.inf), 0)
    found = np.stack([length(step), np.abs((step * truth).sum(axis=1)), angle])
    return np.asarray(np.nan_to_num(found))


def _lines(surface: LimitSurface, faces: BSplineFaces) -> Array:
    """Lines along all edges between which their curves are polynomials."""
    if faces.trims is None:
        # knots, in limit faces, and of those beside half edges
        found = np.unique(np.concatenate([faces.knots_u % 1, faces.knots_v % 1, [0.0, 1.0]]))
        if (surface.limit_faces.corner >= 0).any():
            found = np.concatenate([found, found / 2, 0.5 - found / 2, [0.5]])
    else:
        level = Poles.of(surface).finest
        found = np.concatenate([
            np.arange(2**level + 1) / 2**level,
            *(2.0 ** -np.arange(k + 2) for k in np.unique(faces.depths[faces.depths >= 0]).tolist())
        ])  # fmt: skip
    return np.unique(np.concatenate([found, 1 - found]))


@dataclass(frozen=True, eq=False)
class _Near:
    """Splines of points relative to the first one of each, far from the origin as these may be.

    Attributes
    ----------
    splines : Splines
    origin : (n, 3)
    """

    splines: Splines
    origin: Array

    @classmethod
    def of(cls, faces: BSplineFaces) -> _Near:
        """Those of faces."""
        known = faces.splines
        origin = known.points[known.first[:-1]]
        points = known.points - np.repeat(origin, np.diff(known.first), axis=0)
        return cls(replace(known, points=points), origin)

    def jet(self, which: Array, u: Array, v: Array) -> tuple[Array, Array, Array]:
        """Points, and derivatives along u and along v, at places (q,) of faces."""
        value, du, dv = self.splines.jet(which, u, v, 1)
        return value + self.origin[which], du, dv


def _rounding(faces: _Near) -> Array:
    """What rounding may do to derivatives along u and along v, and to points, of faces (3, n)."""
    splines, n = faces.splines, len(faces.origin)
    if not n:
        return np.zeros((3, 0))
    size = np.maximum.reduceat(np.abs(splines.points).max(axis=1), splines.first[:-1])
    found = np.empty((3, n))
    found[2] = _OF_POINTS * size
    for k, (knots, first) in enumerate((
        (splines.knots_u, splines.first_u), (splines.knots_v, splines.first_v)
    )):  # fmt: skip
        span = np.append(np.diff(knots), np.inf)
        span = np.where(span > 0, span, np.inf)
        with np.errstate(over="ignore"):
            found[k] = _OF_SLOPES * size / np.minimum.reduceat(span, first[:-1])
    return found


def _sharp(surface: LimitSurface, half: Array) -> Array:
    """Which of half-edges (e,) are infinitely sharp."""
    mesh = surface.mesh
    sharp = np.zeros(mesh.n_edges, dtype=bool)
    ends, sharpness = mesh.creases
    if len(sharpness):
        sharp[mesh.edge_numbers(ends)[np.asarray(sharpness, dtype=float) >= 10]] = True
    return np.asarray(sharp[mesh.corner_edge[half]])


def _of_approximate(
    surface: LimitSurface, patches: ApproximatePatches, workers: int
) -> PatchDeviation:
    """That of patches of degree 3, one to a face of a refined mesh."""
    error = patches.error(surface, workers=workers)
    mesh = patches.mesh
    fine = LimitSurface(mesh, **surface.rules)
    half = inner_edges(fine)
    none, line = np.zeros(0, dtype=np.int64), np.array([0.0, 1.0])

    def sides(face: Array, u: Array, v: Array) -> Sides:
        """Those of places of faces."""
        point, normal = (x(face, u, v).reshape(-1, 3) for x in (patches.evaluate, patches.normal))
        return Sides(point, normal)

    edges, ends = across(fine, half, none, line, 3, sides)
    known = [getattr(error, field.name) for field in fields(Deviation)]
    face = mesh.corner_face
    bound = np.minimum(error.angle[face[half]] + error.angle[face[mesh.twin[half]]], np.pi)
    return PatchDeviation(
        *known, error.parametric, ends, edges[0], edges[1], bound, edges[2],
    )  # type: ignore[call-arg]  # fmt: skip
