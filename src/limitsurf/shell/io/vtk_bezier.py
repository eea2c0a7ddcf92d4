"""Surfaces as rational Bezier cells of VTK, which are the polynomials themselves."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.checks import users_level
from limitsurf.pieces.bernstein import is_tensor
from limitsurf.shell.io.polygons import float_points, known_channels

if TYPE_CHECKING:
    from limitsurf.pieces.cells import BezierPatches
    from limitsurf.surface import LimitSurface

Array = NDArray[Any]

TRIANGLE, QUADRILATERAL = 76, 77  # VTK's numbers of Bezier cells
WEIGHTS, DEGREES = "RationalWeights", "HigherOrderDegrees"


def dataset(surface: LimitSurface, depth: int | None, pyvista: Any) -> Any:
    """The Bezier patches of a surface, and what remains at special corners, as cells of PyVista."""
    from limitsurf.query.bezier import bezier_patches

    surface = surface.with_points(float_points(surface.mesh))
    patches = bezier_patches(surface, depth=depth)
    if not len(patches):
        raise ValueError("the surface has no Bezier patch: no face has a limit")
    order = point_order(patches.exponents)
    rest = patches.rest
    points = _coefficients(patches, _corners(surface, patches, None))[:, order]
    cells, size = points.shape[:2]
    rows = np.insert(np.arange(cells * size).reshape(cells, size), 0, size, axis=1)
    kind = QUADRILATERAL if is_tensor(patches.exponents) else TRIANGLE
    grid = pyvista.UnstructuredGrid(
        rows.ravel(), np.full(cells, kind, dtype=np.uint8), points.reshape(-1, 3)
    )
    for name, values in _fields(surface, patches, depth).items():
        grid.point_data[name] = values[:, order].reshape(cells * size, -1)
    grid.point_data[WEIGHTS] = np.ones(cells * size)
    degree = patches.degree
    grid.cell_data[DEGREES] = np.tile(np.array([degree, degree, 0.0]), (cells, 1))
    for name in ("face", "origin", "size"):
        parts = getattr(patches, name), getattr(rest, name)
        grid.cell_data[name] = np.concatenate(parts)
    exact = np.zeros(len(patches))
    grid.cell_data["deviation"] = np.concatenate([exact, deviation(patches)])
    # without these attributes VTK and ParaView take other weights and degrees
    grid.GetPointData().SetRationalWeights(grid.GetPointData().GetArray(WEIGHTS))
    grid.GetCellData().SetHigherOrderDegrees(grid.GetCellData().GetArray(DEGREES))
    return grid


def point_order(exponents: Array) -> Array:
    """Rows of `exponents` in the order in which VTK has the points of a Bezier cell.

    Corners first, then the inner points of each side. Of squares sides run along u or v, the inside
    by rows along u; of triangles they run around, and what is inside is a triangle in its turn.
    """
    degree = int(exponents.max())
    number = {(int(i), int(j)): k for k, (i, j) in enumerate(exponents.tolist())}
    inner = range(1, degree)
    if not is_tensor(exponents):
        return np.array([number[place] for place in _triangle(degree, 0)])
    corners = [(0, 0), (degree, 0), (degree, degree), (0, degree)]
    sides = [(i, 0) for i in inner] + [(degree, j) for j in inner]
    sides += [(i, degree) for i in inner] + [(0, j) for j in inner]
    inside = [(i, j) for j in inner for i in inner]
    return np.array([number[place] for place in corners + sides + inside])


def _triangle(degree: int, first: int) -> list[tuple[int, int]]:
    """Places of a triangle of a degree whose corner 0 is at (first, first)."""
    if degree < 0:
        return []
    if degree == 0:
        return [(first, first)]
    corners = [(0, 0), (degree, 0), (0, degree)]
    inner = range(1, degree)
    sides = [(i, 0) for i in inner] + [(degree - i, i) for i in inner]
    sides += [(0, degree - j) for j in inner]
    around = [(first + i, first + j) for i, j in corners + sides]
    return around + _triangle(degree - 3, first + 1)


def deviation(patches: BezierPatches) -> Array:
    """How far a cell at a special corner may be from the surface, at each place: bounds (m,).

    The cell interpolates points of the surface, so that both are in one box.
    """
    width = patches.rest.upper - patches.rest.lower
    return np.asarray(np.sqrt((width * width).sum(axis=1)))


def _corners(surface: LimitSurface, patches: BezierPatches, channel: str | None) -> Array:
    """Values (m, corners, ...) at the corners of what remains."""
    rest, corners = patches.rest, np.array(surface.topology.lattice.corners, dtype=float)
    places = rest.origin[:, None] + rest.size[:, None] * corners
    face = np.broadcast_to(rest.face[:, None], places.shape[:2])
    return surface.evaluate(face, places[..., 0], places[..., 1], channel=channel)


def _coefficients(patches: BezierPatches, corners: Array) -> Array:
    """Bernstein coefficients (cells, n, c) of patches, and of what interpolates corners."""
    s, t = patches.exponents.T / patches.degree
    shares = np.stack([1 - s - t, s, t])
    if is_tensor(patches.exponents):
        shares = np.stack([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t])
    size = len(patches.exponents)
    known = patches.points.reshape(len(patches), size, -1)
    flat = corners.reshape(*corners.shape[:2], known.shape[2])
    return np.concatenate([known, np.einsum("cn,mck->mnk", shares, flat)])


def _fields(surface: LimitSurface, patches: BezierPatches, depth: int | None) -> dict[str, Array]:
    """Coefficients of all channels whose pieces are those of the points; a warning of others."""
    from limitsurf.query.bezier import bezier_patches

    found = {}
    for name in known_channels(surface, [*surface.mesh.channels]):
        own = bezier_patches(surface, depth=depth, channel=name)
        same = all(
            np.array_equal(getattr(x, key), getattr(y, key))
            for x, y in ((own, patches), (own.rest, patches.rest))
            for key in ("face", "origin", "size")
        )
        if same:
            found[name] = _coefficients(own, _corners(surface, own, name))
        else:
            warnings.warn(
                f"left out: channel {name!r}, whose polynomial pieces are others than those of the "
                "points (at seams of its own): ls.to_pyvista(surface, n=) has it on polygons",
                stacklevel=users_level(),
            )
    return found
