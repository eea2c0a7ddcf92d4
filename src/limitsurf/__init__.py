"""Exact limit surfaces of subdivision schemes, fast, from Python.

>>> import limitsurf as ls
>>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
>>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
>>> surface = ls.LimitSurface(ls.Mesh(points, quads))
>>> surface.evaluate(0, 0.0, 0.0).round(12).tolist()
[0.25, 0.25, 0.25]
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from limitsurf.cad.brep import to_brep as to_brep
    from limitsurf.cad.bspline import BSplineFaces as BSplineFaces
    from limitsurf.cad.bspline import bspline_faces as bspline_faces
    from limitsurf.cad.compare import Comparison as Comparison
    from limitsurf.cad.compare import compare as compare
    from limitsurf.cad.curves import SplineCurves as SplineCurves
    from limitsurf.cad.curves import fit_curve as fit_curve
    from limitsurf.cad.deviation import PatchDeviation as PatchDeviation
    from limitsurf.cad.deviation import deviation as deviation
    from limitsurf.cad.fairing import fair as fair
    from limitsurf.cad.fairness import fairness as fairness
    from limitsurf.cad.fit import Fit as Fit
    from limitsurf.cad.fit import fit as fit
    from limitsurf.cad.folds import Folds as Folds
    from limitsurf.cad.interpolate import Interpolation as Interpolation
    from limitsurf.cad.interpolate import interpolate as interpolate
    from limitsurf.cad.offset import OffsetSurface as OffsetSurface
    from limitsurf.cad.offset import offset as offset
    from limitsurf.cad.offset_cage import OffsetCage as OffsetCage
    from limitsurf.cad.offset_faces import OffsetFaces as OffsetFaces
    from limitsurf.cad.spline_faces import SplineFaces as SplineFaces
    from limitsurf.cad.thick import thickened as thickened
    from limitsurf.cage.checks import MeshError as MeshError
    from limitsurf.cage.faces import Faces as Faces
    from limitsurf.cage.mesh import Mesh as Mesh
    from limitsurf.cage.selection import selected as selected
    from limitsurf.fem.ends import extended as extended
    from limitsurf.fem.modes import Eigenmodes as Eigenmodes
    from limitsurf.fem.modes import eigenmodes as eigenmodes
    from limitsurf.fem.residuals import element_residuals as element_residuals
    from limitsurf.fem.space import Space as Space
    from limitsurf.fem.thin import ShellSolution as ShellSolution
    from limitsurf.fem.thin import ThinShell as ThinShell
    from limitsurf.integrals.body import area as area
    from limitsurf.integrals.body import centroid as centroid
    from limitsurf.integrals.body import inertia as inertia
    from limitsurf.integrals.body import integrate as integrate
    from limitsurf.integrals.body import volume as volume
    from limitsurf.integrals.quadrature import Quadrature as Quadrature
    from limitsurf.integrals.quadrature import quadrature as quadrature
    from limitsurf.query import (
        Tessellation as Tessellation,
    )
    from limitsurf.query import (
        agrees as agrees,
    )
    from limitsurf.query import (
        levels_of_detail as levels_of_detail,
    )
    from limitsurf.query import (
        refinement_gap as refinement_gap,
    )
    from limitsurf.query import (
        tessellate as tessellate,
    )
    from limitsurf.query import (
        validate as validate,
    )
    from limitsurf.query.approximate import ApproximatePatches as ApproximatePatches
    from limitsurf.query.approximate import approximate as approximate
    from limitsurf.query.bezier import (
        BezierPatches as BezierPatches,
    )
    from limitsurf.query.bezier import (
        BezierRest as BezierRest,
    )
    from limitsurf.query.bezier import (
        bezier_patches as bezier_patches,
    )
    from limitsurf.query.bounds import Bounds as Bounds
    from limitsurf.query.bounds import bounds as bounds
    from limitsurf.query.camera import View as View
    from limitsurf.query.closest import (
        ClosestPoints as ClosestPoints,
    )
    from limitsurf.query.closest import (
        FeetOfPoints as FeetOfPoints,
    )
    from limitsurf.query.closest import (
        closest_point as closest_point,
    )
    from limitsurf.query.closest import (
        feet as feet,
    )
    from limitsurf.query.creases import creases_by_angle as creases_by_angle
    from limitsurf.query.deviation import Deviation as Deviation
    from limitsurf.query.extraction import (
        BezierExtraction as BezierExtraction,
    )
    from limitsurf.query.extraction import (
        bezier_extraction as bezier_extraction,
    )
    from limitsurf.query.index import (
        SurfaceIndex as SurfaceIndex,
    )
    from limitsurf.query.intersections import IntersectionCurves as IntersectionCurves
    from limitsurf.query.intersections import intersect_surfaces as intersect_surfaces
    from limitsurf.query.rays import AllRayHits as AllRayHits
    from limitsurf.query.rays import RayHits as RayHits
    from limitsurf.query.rays import contains as contains
    from limitsurf.query.rays import intersect as intersect
    from limitsurf.query.rays import intersect_all as intersect_all
    from limitsurf.query.rays import occluded as occluded
    from limitsurf.query.rays import winding_number as winding_number
    from limitsurf.query.samples import Samples as Samples
    from limitsurf.query.samples import sample as sample
    from limitsurf.query.sections import Curves as Curves
    from limitsurf.query.sections import contour as contour
    from limitsurf.query.sections import section as section
    from limitsurf.query.silhouettes import isophote as isophote
    from limitsurf.query.silhouettes import silhouette as silhouette
    from limitsurf.refine import (
        ExactOperator as ExactOperator,
    )
    from limitsurf.refine import (
        RefinedMesh as RefinedMesh,
    )
    from limitsurf.refine import (
        refined as refined,
    )
    from limitsurf.scheme import schemes as schemes
    from limitsurf.scheme.dual import DualScheme as DualScheme
    from limitsurf.scheme.scheme import Scheme as Scheme
    from limitsurf.shell.io.by_suffix import (
        frames as frames,
    )
    from limitsurf.shell.io.by_suffix import (
        read as read,
    )
    from limitsurf.shell.io.by_suffix import (
        write as write,
    )
    from limitsurf.shell.io.by_trimesh import (
        from_trimesh as from_trimesh,
    )
    from limitsurf.shell.io.by_trimesh import (
        to_trimesh as to_trimesh,
    )
    from limitsurf.shell.io.merge import merged as merged
    from limitsurf.shell.io.step import read_brep as read_brep
    from limitsurf.shell.io.vtk import (
        from_pyvista as from_pyvista,
    )
    from limitsurf.shell.io.vtk import (
        to_pyvista as to_pyvista,
    )
    from limitsurf.shell.plot.plots import (
        Picture as Picture,
    )
    from limitsurf.shell.plot.plots import (
        plot as plot,
    )
    from limitsurf.shell.plot.plots import (
        plot_characteristic_map as plot_characteristic_map,
    )
    from limitsurf.shell.plot.plots import (
        plot_convergence as plot_convergence,
    )
    from limitsurf.shell.plot.plots import (
        plot_eigenfunctions as plot_eigenfunctions,
    )
    from limitsurf.shell.plot.plots import (
        plot_spectrum as plot_spectrum,
    )
    from limitsurf.spectra import Eigenbasis as Eigenbasis
    from limitsurf.spectra import SpectralAnalysis as SpectralAnalysis
    from limitsurf.spectra import eigenbasis as eigenbasis
    from limitsurf.spectra import spectral_analysis as spectral_analysis
    from limitsurf.surface import (
        Curvature as Curvature,
    )
    from limitsurf.surface import (
        LimitSurface as LimitSurface,
    )

__version__ = "0.2.0"

# what is public, and the module that defines it; imported on first use
_HOME = {
    "AllRayHits": "query.rays",
    "ApproximatePatches": "query.approximate",
    "BezierExtraction": "query.extraction",
    "BezierPatches": "query.bezier",
    "BSplineFaces": "cad.bspline",
    "Bounds": "query.bounds",
    "BezierRest": "query.bezier",
    "ClosestPoints": "query.closest",
    "Comparison": "cad.compare",
    "Curvature": "surface",
    "Deviation": "query.deviation",
    "DualScheme": "scheme.dual",
    "Eigenbasis": "spectra",
    "Eigenmodes": "fem.modes",
    "ExactOperator": "refine",
    "Faces": "cage.faces",
    "Fit": "cad.fit",
    "FeetOfPoints": "query.closest",
    "Folds": "cad.folds",
    "LimitSurface": "surface",
    "Mesh": "cage.mesh",
    "MeshError": "cage.checks",
    "OffsetCage": "cad.offset_cage",
    "OffsetFaces": "cad.offset_faces",
    "OffsetSurface": "cad.offset",
    "PatchDeviation": "cad.deviation",
    "Picture": "shell.plot.plots",
    "RayHits": "query.rays",
    "Quadrature": "integrals.quadrature",
    "RefinedMesh": "refine",
    "Samples": "query.samples",
    "Scheme": "scheme.scheme",
    "ShellSolution": "fem.thin",
    "Space": "fem.space",
    "SpectralAnalysis": "spectra",
    "SplineCurves": "cad.curves",
    "ThinShell": "fem.thin",
    "SplineFaces": "cad.spline_faces",
    "SurfaceIndex": "query.index",
    "Tessellation": "query",
    "View": "query.camera",
    "agrees": "query",
    "area": "integrals.body",
    "approximate": "query.approximate",
    "bezier_extraction": "query.extraction",
    "bezier_patches": "query.bezier",
    "bounds": "query.bounds",
    "bspline_faces": "cad.bspline",
    "centroid": "integrals.body",
    "closest_point": "query.closest",
    "compare": "cad.compare",
    "Curves": "query.sections",
    "contour": "query.sections",
    "contains": "query.rays",
    "creases_by_angle": "query.creases",
    "deviation": "cad.deviation",
    "eigenbasis": "spectra",
    "eigenmodes": "fem.modes",
    "element_residuals": "fem.residuals",
    "extended": "fem.ends",
    "fair": "cad.fairing",
    "fairness": "cad.fairness",
    "feet": "query.closest",
    "fit": "cad.fit",
    "fit_curve": "cad.curves",
    "frames": "shell.io.by_suffix",
    "from_pyvista": "shell.io.vtk",
    "from_trimesh": "shell.io.by_trimesh",
    "inertia": "integrals.body",
    "interpolate": "cad.interpolate",
    "integrate": "integrals.body",
    "intersect": "query.rays",
    "intersect_all": "query.rays",
    "intersect_surfaces": "query.intersections",
    "Interpolation": "cad.interpolate",
    "IntersectionCurves": "query.intersections",
    "isophote": "query.silhouettes",
    "levels_of_detail": "query",
    "merged": "shell.io.merge",
    "occluded": "query.rays",
    "offset": "cad.offset",
    "plot": "shell.plot.plots",
    "plot_characteristic_map": "shell.plot.plots",
    "plot_convergence": "shell.plot.plots",
    "plot_eigenfunctions": "shell.plot.plots",
    "plot_spectrum": "shell.plot.plots",
    "precompile": "compiling",
    "quadrature": "integrals.quadrature",
    "read": "shell.io.by_suffix",
    "read_brep": "shell.io.step",
    "refined": "refine",
    "refinement_gap": "query",
    "sample": "query.samples",
    "schemes": "scheme",
    "selected": "cage.selection",
    "section": "query.sections",
    "silhouette": "query.silhouettes",
    "spectral_analysis": "spectra",
    "tessellate": "query",
    "thickened": "cad.thick",
    "to_brep": "cad.brep",
    "to_pyvista": "shell.io.vtk",
    "to_trimesh": "shell.io.by_trimesh",
    "validate": "query",
    "volume": "integrals.body",
    "winding_number": "query.rays",
    "write": "shell.io.by_suffix",
}
__all__ = [*_HOME]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*_HOME, "__version__"])
