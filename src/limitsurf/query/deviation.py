"""How far polynomial patches are from a limit surface over the same parameters.

Both are cut into the same cells; the difference of two polynomials is bounded by its Bernstein
coefficients, beyond the last rings around special corners by hulls of both.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import html
from limitsurf.query.angles import Tangents, angle_bounds
from limitsurf.query.bezier import BezierPatches, bezier_patches
from limitsurf.query.polynomials import Form
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_DEPTH = 12
_PLACES = 17  # in each direction of a face
_FACES = 256  # at once
_SLACK = 1 + 2.0**-40


@dataclass(frozen=True, eq=False, repr=False)
class Deviation:
    """How far patches are from a limit surface, made by `ApproximatePatches.error`.

    The patches and the surface are compared at the same (u, v). Bounds hold at all of them; what is
    `found` is the largest at 17 x 17 places of each face, so that the truth is between both.

    Attributes
    ----------
    parametric : (n,) float64
        For each face, a bound of the distance between both, rounding included.
    parametric_found : (n,)
        The largest distance at places that were looked at.
    along_normal_found : (n,)
        The largest part of these distances along the normal of the surface. The bound of distances
        is one of it.
    angle_found, geometric_angle_found : (n,)
        The largest angles between the normal of the surface and that of the patch, by `normal` and
        with its ``geometric=True``, in radians.
    angle, geometric_angle : (n,)
        Bounds of these angles, in radians; pi where there is none, as on faces that fold.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> surface = ls.LimitSurface(square)
    >>> bool(ls.approximate(surface, "acc").error(surface).parametric[0] < 1e-12)
    True
    """

    parametric: Array
    parametric_found: Array
    along_normal_found: Array
    angle_found: Array
    geometric_angle_found: Array
    angle: Array
    geometric_angle: Array

    def _repr_html_(self) -> str:
        columns = {field.name: getattr(self, field.name) for field in fields(self)}
        return html.table({"face": np.arange(len(self.parametric)), **columns}, repr(self))

    def __repr__(self) -> str:
        n = len(self.parametric)
        most = np.nanmax(self.parametric, initial=0)
        return f"{type(self).__name__}({n} face{'s' * (n != 1)}, at most {most:.3g})"


def deviation(
    surface: LimitSurface,
    points: Array,
    half: Array | None,
    patches: tuple[Callable[..., Array], Callable[..., Array]],
    tangents: tuple[Array, Array] | None,
    workers: int,
) -> Deviation:
    """The deviation of bicubic patches, one to each limit face.

    Parameters
    ----------
    surface : LimitSurface
        Of points (n_vertices, 3).
    points : (n, 4, 4, 3)
        Bezier points by i, along u, and j; NaN where a face has none.
    half : (n, 4, 4, 3), optional
        Up to plus or minus how much Bezier points are off, as in Gregory patches.
    patches : (callable, callable)
        Points and unit normals of patches at (face, u, v); the latter take `geometric`.
    tangents : ((n, 3, 4, 3), (n, 4, 3, 3)), optional
        Fields of tangents whose cross products are the normals, if they are not derivatives.
    workers : int
    """
    n = len(points)
    bound = np.full(n, np.nan)
    sizes = None if half is None else length(half)
    found, angles = np.full((4, n), np.nan), np.full((2, n), np.nan)
    geometric = Tangents.derivatives(points, half)
    fields = geometric if tangents is None else Tangents.of(*tangents)
    faces = np.flatnonzero(np.isfinite(points).all(axis=(1, 2, 3)))
    for start in range(0, len(faces), _FACES):
        some = faces[start : start + _FACES]
        cells = bezier_patches(surface, face=some, depth=_DEPTH, workers=workers)
        bound[some] = _bounds(surface, cells, some, points, sizes)
        found[:, some] = _found(surface, some, patches, workers)
        angles[:, some] = angle_bounds(surface, cells, some, geometric, _DEPTH)
        if tangents is not None:
            angles[0, some] = angle_bounds(surface, cells, some, fields, _DEPTH)
    return Deviation(bound, *found, *angles)


def _bounds(
    surface: LimitSurface, cells: BezierPatches, faces: Array, points: Array, half: Array | None
) -> Array:
    """Bounds of distances (f,) on some limit faces."""
    form = Form.of(surface.topology.lattice, cells.degree)
    i, j = cells.exponents.T  # of coefficients, in their order
    most = np.zeros(len(points))

    def parts(face: Array, origin: Array, size: Array) -> tuple[Array, Array | float]:
        """Coefficients of patches in parts of faces, and by how much they may be off."""
        frames = np.zeros((len(face), 3, 2))
        frames[:, 0] = origin
        frames[:, [1, 2], [0, 1]] = size
        matrix = form.part(frames)
        off = 0.0 if half is None else np.matmul(matrix, half[face][:, i, j, None])[..., 0]
        return np.matmul(matrix, points[face][:, i, j]), off

    here, off = parts(cells.face, cells.origin, cells.size)
    far = length(cells.points.reshape(here.shape) - here)
    np.maximum.at(most, cells.face, far.max(axis=1) + np.max(off, axis=-1, initial=0))
    rest = cells.rest
    if len(rest):
        here, off = parts(rest.face, rest.origin, rest.size)
        low, high = here.min(axis=1), here.max(axis=1)
        far = length(np.maximum(np.abs(rest.upper - low), np.abs(high - rest.lower)))
        np.maximum.at(most, rest.face, far + np.max(off, axis=-1, initial=0))
    size = np.abs(points[faces]).max(axis=(1, 2, 3))
    return np.asarray(most[faces] * _SLACK + 2.0**-46 * size)


def _found(
    surface: LimitSurface,
    faces: Array,
    patches: tuple[Callable[..., Array], Callable[..., Array]],
    workers: int,
) -> Array:
    """Largest distances, distances along normals, and angles between two kinds of these, (4, f)."""
    x = np.linspace(0, 1, _PLACES)
    face, u, v = (a.ravel() for a in np.meshgrid(faces, x, x, indexing="ij"))
    step = patches[0](face, u, v) - surface.evaluate(face, u, v, workers=workers)
    truth = surface.normal(face, u, v, workers=workers)
    found = [length(step), np.abs((step * truth).sum(axis=1))]
    for geometric in (False, True):
        other = patches[1](face, u, v, geometric=geometric)
        # precise for small angles and for large ones
        found.append(2 * np.arctan2(length(truth - other), length(truth + other)))
    values = np.nan_to_num(np.stack(found).reshape(4, len(faces), -1))
    return np.asarray(values.max(axis=2, initial=0))


def length(vectors: Array) -> Array:
    """Lengths (...) of vectors (..., 3), of any size."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    return np.asarray(np.hypot(np.hypot(x, y), z))
