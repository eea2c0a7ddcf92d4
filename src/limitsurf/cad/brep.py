"""Boundary representations of limit surfaces: solids and shells of OpenCASCADE."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from limitsurf.cad.boundary import Boundary
from limitsurf.cad.bspline import BSplineFaces, bspline_faces
from limitsurf.cad.opencascade import module
from limitsurf.cad.shapes import Build, assembled
from limitsurf.cad.sheets import Sheets
from limitsurf.cage.checks import checked_number, choice, count
from limitsurf.surface import LimitSurface

# millimetres
UNITS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "km": 1e6, "um": 1e-3, "in": 25.4, "ft": 304.8}
_POINT = 1e-3  # of the smallest tolerance: a shorter edge is a point
_FAR = 1e99  # OpenCASCADE takes 2e100 to be infinite


@dataclass(frozen=True, eq=False)
class Made:
    """A shape, and what its faces are.

    Attributes
    ----------
    shape : TopoDS_Shape
    faces : list of TopoDS_Face
        In the order of `splines`.
    splines : BSplineFaces
    tolerance : float
        The largest of edges and vertices, in the unit of the shape.
    gap : float
        The largest distance that was found between two faces along an edge of both.
    why_open : list of str
        Of each part that is no solid, why.
    """

    shape: Any
    faces: list[Any]
    splines: BSplineFaces
    tolerance: float
    gap: float
    why_open: list[str]

    def warn(self, solid: bool | None, level: int) -> None:
        """Say why parts are no solids, to whoever called so many levels above, unless asked for."""
        if solid is None and self.why_open:
            rest = len(self.why_open) - 1
            more = f", and {rest} more like it" if rest else ""
            text = f"no solid but a shell: {self.why_open[0]}{more}"
            warnings.warn(f"{text}; solid=False says that it is meant", stacklevel=level)


def to_brep(
    surface: LimitSurface | BSplineFaces,
    *,
    solid: bool | None = None,
    unit: str = "mm",
    tolerance: float | None = None,
    depth: int | None = None,
    merge: bool = True,
    poles: str = "g0",
    g1_angle: float | None = None,
    channel: str | None = None,
    workers: int = 1,
) -> Any:
    """A surface as a solid, or shells, of OpenCASCADE: with edges that its faces share.

    cadquery, build123d and FreeCAD take the shape as it is; `write` makes STEP, IGES and BREP files
    of it (or of a surface, then with names of faces and its deviation). Needs the extra ``cad``.

    Parameters
    ----------
    surface : LimitSurface or BSplineFaces
        Of points (n_vertices, 3); what `bspline_faces` made is taken as it is.
    solid : bool, optional
        True: parts must be closed, an error otherwise. False: they are shells even if they are. By
        default they are solids where they can be, and a warning says why others are not.
    unit : {"mm", "cm", "m", "km", "um", "in", "ft"}
        What the numbers of the surface are. Shapes are in millimetres; so are they by default.
    tolerance, depth, merge, poles, g1_angle
        As for `bspline_faces`.
    channel : str, optional
        A face-varying channel of three columns instead of the points.
    workers : int
        Threads that make the B-splines.

    Returns
    -------
    TopoDS_Shape
        A solid, a shell, or a compound of these, one to each connected part, in their order but for
        voids. Faces are in the order of those of `bspline_faces` in each of them.

    Raises
    ------
    ValueError
        `solid` and an open part: its first open edge. An unknown unit. A face that is a curve.
    ImportError
        OpenCASCADE is not installed.

    Warns
    -----
    UserWarning
        Why parts are no solids, unless `solid` is given.

    Notes
    -----
    What meets is known from the cage: vertices and edges are made once, and used by all faces
    around; nothing is found by distances. An edge of the cage with a split face (an n-gon) on
    either side is two edges. Along non-manifold edges parts are cut from each other. Where faces
    are merged, a side of one may be several edges, each on a part of its curve.

    A closed part within another is a void of that if it is no body in a void; then its shell is an
    inner one. Outsides are outside, whichever way the faces of the cage go around. Parts that
    intersect each other or themselves are not noticed.

    Edges and vertices carry the tolerance that they need: the largest distance found between the
    curve and the faces, times 4, or 1e-7, below which OpenCASCADE takes points to be the same (or
    1e-9 of the size of a surface, if that is less). Sides that are points are edges marked as
    degenerate.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> cube = ls.LimitSurface(ls.Mesh(points, quads))
    >>> solid = ls.to_brep(cube, depth=4)
    >>> type(solid).__name__, solid.Closed(), solid.NbChildren()
    ('TopoDS_Solid', False, 1)
    """
    how: dict[str, Any] = {"tolerance": tolerance, "depth": depth, "merge": merge}
    how |= {"poles": poles, "g1_angle": g1_angle}
    found = made(surface, solid, unit, channel=channel, workers=workers, **how)
    found.warn(solid, 3)
    return found.shape


def made(
    surface: Any, solid: bool | None, unit: str, *, channel: str | None, workers: int, **how: Any
) -> Made:
    """The shape of a surface, and what is known of it; arguments as for `to_brep`."""
    module("gp")
    choice(unit, "unit", tuple(UNITS))
    for name, value in {"solid": solid, "merge": how.get("merge", True)}.items():
        if not isinstance(value, (bool, np.bool_)) and not (name == "solid" and value is None):
            raise TypeError(f"{name} must be True or False, got {value!r}")
    if how.get("tolerance") is not None:
        checked_number("tolerance", how["tolerance"])
    splines = surface
    if not isinstance(surface, BSplineFaces):
        if not isinstance(surface, LimitSurface):
            more = ": give its val()" if hasattr(surface, "val") else ""
            raise TypeError(f"to_brep needs a LimitSurface, got {type(surface).__name__}{more}")
        surface = surface.of_channel(channel)
        _refuse_points(surface, UNITS[unit])
        splines = bspline_faces(surface, workers=workers, **how)
    if splines.points.shape[1] != 3:
        raise ValueError(f"to_brep needs points (n_vertices, 3), got {splines.points.shape[1]}")
    if not len(splines):
        raise ValueError("to_brep needs a face: all of the cage are holes, or have no limit")
    boundary = Boundary.of(splines)
    why = [
        "its part with the edge of vertices {} and {} of the cage is open there".format(*ends)
        for ends in boundary.open_edge[~boundary.closed].tolist()
    ]
    if solid and why:
        raise ValueError(
            f"solid=True, but no solid: {why[0]}; "
            f"{count(len(why), 'part')} of {len(boundary.closed)} are open: close the cage there "
            "(or turn over faces that go the other way around), or leave out solid"
        )
    sheets = Sheets.of(splines, UNITS[unit])
    sheets.refuse_curves()
    points = sheets.lengths(boundary) <= _POINT * sheets.least
    build = Build(sheets, boundary.without(points), points)
    shape = assembled(build, solid is not False)
    return Made(shape, build.faces, splines, build.most, build.gap, why)


def _refuse_points(surface: LimitSurface, factor: float) -> None:
    """Refuse what no shape has: points that are not finite, or too far for OpenCASCADE."""
    mesh = surface.mesh
    points = np.asarray(surface.points[mesh.indices], dtype=float).reshape(len(mesh.indices), -1)
    bad = np.flatnonzero(~(np.abs(points) <= _FAR / factor).all(axis=1))
    if len(bad):
        face, value = mesh.corner_face[bad[0]], points[bad[0]]
        more = f" (and {count(len(bad) - 1, 'corner')} of faces more)" if len(bad) > 1 else ""
        raise ValueError(
            f"face {face} of the cage has a corner at {value}{more}: solids need points that are "
            f"finite and within {_FAR:g} mm; tag the face as a hole, or mend its points"
        )
