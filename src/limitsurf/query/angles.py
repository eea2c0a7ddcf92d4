"""How far normals of polynomial patches are from those of a limit surface, at most.

``derivations/approximate.py`` has the bounds.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.pieces.beyond import Beyond
from limitsurf.query.bezier import BezierPatches
from limitsurf.query.chords import length
from limitsurf.query.cones import Poles, cone, cross_products, crossed, normal_form
from limitsurf.query.polynomials import Form
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_WIDE, _PARTS = 0.1, 4  # cells as wide are cut into 4 x 4, before they are bounded
_PORTION = 512  # parts at once

# the points of a quadratic as those of a cubic
_RAISED = np.array([[3, 0, 0], [1, 2, 0], [0, 2, 1], [0, 0, 3]]) / 3


@dataclass(frozen=True, eq=False)
class Tangents:
    """Two fields of tangents whose cross products are normals of patches.

    Attributes
    ----------
    along, across : (n, 4, 4, 3)
        Bezier points, of degree 3.
    half : (n, 4, 4, 3), optional
        Half the steps between both points of each inside Gregory patches, where the fields are the
        derivatives of patches with their middles.
    """

    along: Array
    across: Array
    half: Array | None = None

    @classmethod
    def of(cls, along: Array, across: Array, half: Array | None = None) -> Tangents:
        """Those of points (n, 3, 4, 3) and (n, 4, 3, 3)."""
        one, other = (
            np.einsum("ai,nijd->najd", _RAISED, along),
            np.einsum("aj,nijd->niad", _RAISED, across),
        )
        return cls(one, other, half)

    @classmethod
    def derivatives(cls, points: Array, half: Array | None = None) -> Tangents:
        """Those of patches (n, 4, 4, 3)."""
        return cls.of(3 * np.diff(points, axis=1), 3 * np.diff(points, axis=2), half)


def angle_bounds(
    surface: LimitSurface, cells: BezierPatches, faces: Array, fields: Tangents, depth: int
) -> Array:
    """Bounds (f,) of angles on some limit faces, in radians; pi where there is none.

    `cells` are those of the faces, which are quads, with so many rings around special corners.
    """
    form = Form.of(surface.topology.lattice, cells.degree)
    most = np.zeros(len(surface.limit_faces))
    size = float(np.abs(surface.points[surface.mesh.indices]).max(initial=0))
    power = -int(np.frexp(size)[1])
    points = np.ldexp(cells.points.reshape(len(cells), form.size, 3), power)
    scaled = Tangents(
        np.ldexp(fields.along, power),
        np.ldexp(fields.across, power),
        None if fields.half is None else np.ldexp(fields.half, power),
    )
    wide = np.abs(cells.size).max(axis=1) > _WIDE
    steps = np.array(list(product(range(_PARTS), repeat=2))) / _PARTS
    for which, origins, step in (
        (np.flatnonzero(~wide), np.zeros((1, 2)), 1.0),
        (np.flatnonzero(wide), steps, 1 / _PARTS),
    ):
        own = np.repeat(which, len(origins))
        origin = np.tile(origins, (len(which), 1))
        for start in range(0, len(own), _PORTION):
            some, at = own[start : start + _PORTION], origin[start : start + _PORTION]
            limit = np.matmul(form.part(_frames(at, np.full(at.shape, step))), points[some])
            place = cells.origin[some] + at * cells.size[some]
            frames = _frames(place, step * cells.size[some])
            found = _parted(surface, form, limit, scaled, cells.face[some], frames)
            np.maximum.at(most, cells.face[some], found)
    rest = cells.rest
    if len(rest):
        given = np.zeros(surface.points.shape)
        used = surface.mesh.indices
        given[used] = np.ldexp(surface.points[used], power)
        known = surface.topology.patches, surface.topology.rules.scheme, given, faces
        beyond = Beyond(*known, np.full(len(faces), depth))
        every = np.arange(len(beyond))
        poles = Poles(beyond, surface.topology.lattice, form)
        axis, narrow = poles.cones(every, np.zeros(len(every), dtype=np.int64))
        normals, noise, _ = _normals(
            surface, form, scaled, rest.face, _frames(rest.origin, rest.size)
        )
        np.maximum.at(most, rest.face, np.minimum(narrow + cone(normals, noise, axis), np.pi))
    return most[faces]


def _frames(origin: Array, size: Array) -> Array:
    """Corner 0, s and t of parts, (L, 3, 2)."""
    found = np.zeros((len(origin), 3, 2))
    found[:, 0], found[:, 1, 0], found[:, 2, 1] = origin, size[:, 0], size[:, 1]
    return found


def _parted(
    surface: LimitSurface, form: Form, limit: Array, fields: Tangents, face: Array, frames: Array
) -> Array:
    """Bounds (L,) on parts with the limit's polynomials (L, n, 3)."""
    _, pairs = normal_form(surface.topology.lattice, form.degree)
    truth, off = crossed(form, pairs, limit)
    normals, noise, slack = _normals(surface, form, fields, face, frames)
    return between(truth, off, normals, noise, slack)[0]


def between(
    truth: Array, off: Array, normals: Array, noise: Array, slack: Array | float = 0.0
) -> tuple[Array, Array, Array]:
    """Bounds (L,) of angles between two fields of normals, the axis of the first and its cone.

    Both are coefficients (L, m, 3), which rounding moves by `off` and `noise` (L,), and the latter
    err by `slack`. Axes are (L, 3), half angles of cones (L,).
    """
    axis = truth.mean(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        axis = axis / length(axis)[:, None]
        wide = cone(truth, off, axis)
        along, other = (np.matmul(x, axis[:, :, None])[:, :, 0] for x in (truth, normals))
        scale = other.mean(axis=1) / along.mean(axis=1)
        step = normals - scale[:, None, None] * truth
        across = step - np.matmul(step, axis[:, :, None]) * axis[:, None]
        far = length(across).max(axis=1) + 2 * np.sin(wide / 2) * length(step).max(axis=1)
        far = far + noise + slack + np.abs(scale) * off
        least = other.min(axis=1) - noise - slack
        sure = (far < least) & (wide < np.pi / 2) & (scale > 0)
        found = np.where(sure, np.arcsin(np.clip(far / least, 0, 1)), np.pi)
    # or by the cones of both
    both = wide + cone(normals, noise + slack, axis)
    least_of_both = np.fmin(found, np.where(np.isnan(both), np.pi, np.minimum(both, np.pi)))
    return least_of_both, axis, wide


def _normals(
    surface: LimitSurface, form: Form, fields: Tangents, face: Array, frames: Array
) -> tuple[Array, Array, Array]:
    """Coefficients of normals of patches in parts, what rounding takes, and how far they err."""
    _, pairs = normal_form(surface.topology.lattice, form.degree)
    i, j = form.exponents.T
    matrix, size = form.part(frames), frames[:, [1, 2], [0, 1]]
    du = np.matmul(matrix, fields.along[face][:, i, j]) * size[:, 0, None, None]
    dv = np.matmul(matrix, fields.across[face][:, i, j]) * size[:, 1, None, None]
    u, v = np.zeros((2, len(face)))
    if fields.half is not None:
        for a, b in product((1, 2), repeat=2):
            half = fields.half[face, a, b]
            weight = matrix[:, :, int(np.flatnonzero((i == a) & (j == b))[0])]
            step, off = _moved(form, matrix, weight, frames, (a, b))
            du = du + step[0][:, :, None] * half[:, None]
            dv = dv + step[1][:, :, None] * half[:, None]
            u, v = u + off[0] * length(half), v + off[1] * length(half)
    normals, noise = cross_products(pairs, du, dv)
    far = u * length(dv).max(axis=1) + v * length(du).max(axis=1) + u * v
    return normals, noise, far


def _moved(
    form: Form, matrix: Array, weight: Array, frames: Array, place: tuple[int, int]
) -> tuple[Array, Array]:
    """What a unit of half the step inside adds to derivatives along u and v of Gregory patches.

    Coefficients (2, L, n), and by how much they err, (2, L); `weight` (L, n) has the coefficients
    of the Bernstein polynomial.
    """
    low, size = frames[:, 0], frames[:, [1, 2], [0, 1]]
    # distances from the nearest corner, and which way they grow
    ends = np.stack([low, low + size])
    sign = np.where(np.array(place) == 1, 1.0, -1.0)
    ends = np.sort(np.where(sign > 0, ends, 1 - ends), axis=0)
    (a, b), (c, d) = np.moveaxis(ends, 2, 0)  # of both, least and largest
    at_corner = (a == 0) & (c == 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        lower, upper = (a - d) / (a + d), (b - c) / (b + c)
        slopes = [_slope(a, b, c, d), _slope(c, d, a, b)]
    middle, half = (lower + upper) / 2, (upper - lower) / 2
    found, off = np.empty((2, *weight.shape)), np.empty((2, len(weight)))
    for k, (least, most) in enumerate(slopes):
        turn, far = (np.where(at_corner, 0, x) for x in ((least + most) / 2, (most - least) / 2))
        turn = turn * sign[k] * (1 - 2 * k)
        bend = weight @ form.derivatives[1 + k].T
        found[k] = bend * middle[:, None] + weight * (turn * size[:, k])[:, None]
        fall = np.matmul(matrix, _fall(form, place, k)).max(axis=1)
        rest = np.where(at_corner, fall, weight.max(axis=1) * far) * size[:, k]
        off[k] = np.abs(bend).max(axis=1) * half + rest
    return found, off


def _slope(a: Array, b: Array, c: Array, d: Array) -> tuple[Array, Array]:
    """The least and the largest of ``2 y / (x + y)^2`` for x from a to b and y from c to d."""
    best = np.clip(a, c, d)
    least = np.minimum(2 * c / (b + c) ** 2, 2 * d / (b + d) ** 2)
    return least, 2 * best / (a + best) ** 2


def _fall(form: Form, place: tuple[int, int], axis: int) -> Array:
    """Coefficients (n,) of a bound of that slope times the Bernstein polynomial of a place."""
    found = np.zeros((4, 4))
    own, other = place[axis], place[1 - axis]
    for k, weight in ((3 * (own - 1), 1.5), (own, 0.5)):
        found[(k, other) if axis == 0 else (other, k)] = weight
    i, j = form.exponents.T
    return np.asarray(found[i, j])
