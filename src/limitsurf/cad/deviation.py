"""How far patches are from a limit surface, and from each other along edges."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import html
from limitsurf.cad.bspline import BSplineFaces
from limitsurf.cad.edges import across, inner_edges, spokes
from limitsurf.cad.poles import Poles
from limitsurf.query.approximate import ApproximatePatches
from limitsurf.query.chords import length
from limitsurf.query.deviation import Deviation
from limitsurf.query.index import checked_surface
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_PLACES = 1 << 18  # at once
_STEPS = np.array([0.0, 0.25, 0.5, 0.75, 1.0])  # of places in cells
_FINEST = 12
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
        As of `Deviation`, radians; of splines both are the same. Bounds of splines leave out what
        rounding does to exact faces, which is no more than what it does to the surface.
    edges : (e, 2) int64
        The limit faces on both sides of each edge between two (of `ApproximatePatches`, the faces):
        those of edges of the cage, then those of the ways from there to the middles of n-gons. An
        edge beside an n-gon has two limit faces there, of which it is the first.
    gap, gap_found : (e,)
        The largest distances along these edges between the patches on both sides.
    edge_angle, edge_angle_found : (e,)
        The largest angles between their normals there, radians. NaN for the bound on sharp edges,
        where the surface itself has two normals. With ``poles="g1"`` the bound is what rounding of
        control points does to tangent planes that are the same.

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
    what is beyond the last ring (``derivations/spline_faces.py``). Bounds are about what is found,
    but for angles around vertices of many faces, where they may be some times as large. What is
    found is the largest at 25 places of each cell between knots, and in rings of those at corners.
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
    sampled = _sampled(found, patches, workers)
    np.maximum(values[3:], sampled, out=values[3:])
    if (values[3] > values[0]).any():
        k = int(np.argmax(values[3] - values[0]))
        raise ValueError(f"face {k} of the patches is not as it was made of the surface")
    half, ways, lines = inner_edges(found), spokes(found), _lines(found, patches)

    def evaluate(face: Array, u: Array, v: Array) -> Array:
        return patches.evaluate(*patches.of(face, u, v)).reshape(-1, 3)

    def normal(face: Array, u: Array, v: Array) -> Array:
        return patches.normal(*patches.of(face, u, v)).reshape(-1, 3)

    edges, ends = across(found, half, ways, lines, patches.degree[0], evaluate, normal)
    bound = _angles_across(found, half, ways, patches)
    return PatchDeviation(
        values[0], values[3], values[4], values[5], values[5], values[2], values[2], values[1],
        ends, edges[0], edges[1], bound, edges[2],
    )  # fmt: skip


def _sampled(surface: LimitSurface, faces: BSplineFaces, workers: int) -> Array:
    """Largest distances, distances along normals, and angles at places of all cells, (3, n)."""
    found = np.zeros((3, len(faces)))
    p, q = faces.degree
    spans = faces.counts - (p, q)
    number = spans.prod(axis=1)
    x, y = (a.ravel() for a in np.meshgrid(_STEPS, _STEPS, indexing="ij"))
    if faces.trims is not None:
        x, y = x[x + y <= 1], y[x + y <= 1]
    splines, each = faces.splines, max(1, _PLACES // len(x))
    ends = np.cumsum(number)
    for start in range(0, int(ends[-1]) if len(ends) else 0, each):
        cell = np.arange(start, min(start + each, int(ends[-1])))
        face = np.searchsorted(ends, cell, side="right")
        i, j = np.divmod(cell - (ends - number)[face], spans[face, 1])
        low, high = (
            np.stack([
                faces.knots_u[splines.first_u[face] + p + i + more],
                faces.knots_v[splines.first_v[face] + q + j + more],
            ]) for more in (0, 1)
        )  # fmt: skip
        u, v = (
            a[:, None] + (b - a)[:, None] * t for a, b, t in zip(low, high, (x, y), strict=True)
        )
        which = np.broadcast_to(face[:, None], u.shape).ravel()
        errors = _errors(surface, faces, which, u.ravel(), v.ravel(), workers)
        most = errors.reshape(3, len(cell), -1).max(axis=2)
        for k in range(3):
            np.maximum.at(found[k], face, most[k])
    return found


def _errors(
    surface: LimitSurface, faces: BSplineFaces, which: Array, u: Array, v: Array, workers: int
) -> Array:
    """Distances, distances along normals, and angles at places (q,) of faces, (3, q)."""
    limit_face, place = faces.on_surface(which, u, v)
    known = limit_face, *place.T
    step = faces.evaluate(which, u, v) - surface.evaluate(*known, workers=workers)
    truth = surface.normal(*known, workers=workers)
    other = faces.normal(which, u, v)
    angle = 2 * np.arctan2(length(truth - other), length(truth + other))
    found = np.stack([length(step), np.abs((step * truth).sum(axis=1)), angle])
    return np.asarray(np.nan_to_num(found))


def _lines(surface: LimitSurface, faces: BSplineFaces) -> Array:
    """Lines along all edges between which their curves are polynomials."""
    poles = Poles.of(surface)
    level = min(poles.finest, _FINEST)
    lines = [np.arange(2**level + 1) / 2**level]
    for depth in np.unique(faces.depths[faces.depths >= 0]).tolist():
        lines.append(2.0 ** -np.arange(depth + 2))
    found = np.concatenate(lines)
    return np.unique(np.concatenate([found, 1 - found]))


def _angles_across(surface: LimitSurface, half: Array, ways: Array, faces: BSplineFaces) -> Array:
    """Bounds (e,) of angles between normals on both sides of edges; NaN where these are sharp."""
    mesh, known, poles = surface.mesh, surface.limit_faces, Poles.of(surface)
    errors = faces.cap_errors[1]
    smooth = np.isfinite(errors.edge)
    by_face = np.zeros(mesh.n_faces)
    np.maximum.at(by_face, known.face[poles.face], np.where(smooth, 0, errors.angle))
    found = by_face[mesh.corner_face[half]] + by_face[mesh.corner_face[mesh.twin[half]]]
    # along sides that begin at corners around which tangent planes are shared
    shared = np.zeros(faces.smooth.shape)
    shared[poles.face[smooth], poles.corner[smooth]] = errors.edge[smooth]
    if smooth.any():
        for begin in (half, mesh.twin[half]):
            face = mesh.corner_face[begin]
            first, corner = known.first[face], begin - mesh.offsets[face]
            split = known.corner[first] >= 0
            at = np.where(split, first + corner, first), np.where(split, 0, corner % 4)
            found = np.maximum(found, shared[at])
    ends, sharpness = mesh.creases
    if len(sharpness):
        sharp = np.zeros(mesh.n_edges, dtype=bool)
        sharp[mesh.edge_numbers(ends)[np.asarray(sharpness, dtype=float) >= 10]] = True
        found[sharp[mesh.corner_edge[half]]] = np.nan
    middle = 2 * by_face[mesh.corner_face[ways]]
    if smooth.any():
        face, beside = mesh.corner_face[ways], mesh.next_corner[ways]
        own = known.first[face] + beside - mesh.offsets[face]
        middle = np.maximum(middle, shared[own, 2])
    return np.asarray(np.minimum(np.append(found, middle), np.pi))


def _of_approximate(
    surface: LimitSurface, patches: ApproximatePatches, workers: int
) -> PatchDeviation:
    """That of patches of degree 3, one to a face of a refined mesh."""
    error = patches.error(surface, workers=workers)
    mesh = patches.mesh
    fine = LimitSurface(mesh, **surface.rules)
    half = inner_edges(fine)
    none, line = np.zeros(0, dtype=np.int64), np.array([0.0, 1.0])
    edges, ends = across(fine, half, none, line, 3, patches.evaluate, patches.normal)
    known = [getattr(error, field.name) for field in fields(Deviation)]
    face = mesh.corner_face
    bound = np.minimum(error.angle[face[half]] + error.angle[face[mesh.twin[half]]], np.pi)
    return PatchDeviation(
        *known, error.parametric, ends, edges[0], edges[1], bound, edges[2],
    )  # type: ignore[call-arg]  # fmt: skip
