"""Cages and tessellations from and to PyVista, and to files of VTK; `vtk_reader` reads these."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from limitsurf.cage.mesh import Mesh
from limitsurf.shell.io import vtk_reader
from limitsurf.shell.io.losses import Losses
from limitsurf.shell.io.merge import Merge, checked, joined
from limitsurf.shell.io.polygons import mesh_of, polygons, tessellated

if TYPE_CHECKING:
    from limitsurf.query import Polygons, Tessellation
    from limitsurf.surface import LimitSurface


def from_pyvista(dataset: Any, *, merge: Merge = None, **tags: Any) -> Mesh:
    """A cage of the polygons of a PyVista ``PolyData`` or ``UnstructuredGrid``.

    It is what `read` makes of the same object in a file: data of cells are the ``face_data``,
    active texture coordinates of points are the channel "uv". Other data of points are ignored, and
    so are vertex cells and lines. Triangle strips become triangles, in the order of VTK behind
    other polygons.

    Parameters
    ----------
    dataset : pyvista.PolyData or pyvista.UnstructuredGrid
        Polygons of any size; a grid must have no other cells.
    merge : bool or float, optional
        As for `read`: True joins points of equal coordinates, a number those that are as close. By
        default they are joined where there are texture coordinates, along whose seams points are
        repeated.
    **tags
        Creases, corners and all else that ``Mesh`` takes besides points and faces.

    Returns
    -------
    Mesh

    Raises
    ------
    MeshError
        Polygons that ``Mesh`` refuses.
    TypeError
        Another type of dataset.
    ValueError
        Cells of a grid that are no polygons.
    ImportError
        PyVista is not installed.

    Examples
    --------
    >>> import limitsurf as ls, pyvista
    >>> cube = ls.from_pyvista(pyvista.Cube(), merge=True)
    >>> cube.n_vertices, cube.is_closed
    (8, True)
    """
    imported_pyvista()
    losses = Losses("from_pyvista", strict=False)
    tolerance = checked(merge)
    sizes, indices, numbers = _dataset_faces(dataset)
    data, _ = vtk_reader.cell_data(dataset, numbers)
    tags["face_data"] = {**data, **(tags.get("face_data") or {})}
    uv = vtk_reader.texture(dataset)
    if uv is not None and len(uv) != len(dataset.points):
        losses.add("uv", "", f"got {len(uv)} texture coordinates, need {len(dataset.points)}")
        uv = None
    seams = uv is not None and merge is None
    mesh = mesh_of(dataset.points, sizes, indices, losses, uv=uv, merge=seams, **tags)
    if tolerance is not None:
        mesh = joined(mesh, tolerance, losses)
    losses.warn(2)
    return mesh


def to_pyvista(
    x: Mesh | Tessellation | LimitSurface,
    *,
    n: int | None = None,
    bezier: bool = False,
    depth: int | None = None,
) -> Any:
    """A cage, a tessellation or a surface as polygons or as Bezier cells of PyVista.

    Parameters
    ----------
    x : Mesh, Tessellation or LimitSurface
        Of a cage the points and faces, without tags and channels; exact points are rounded to
        float64. Of a tessellation the polygons, split into one normal for each point, which are
        the active normals; "uv" or else "st" (k, 2) are the active texture coordinates, and other
        channels data of points. A surface is tessellated first, with all of its channels.
    n : int, optional
        Of a surface, polygons along each edge of a limit face, as for `tessellate`; 8 by default.
    bezier : bool
        Of a surface, its polynomial pieces themselves, those of `bezier_patches`, as cells of VTK's
        type Bezier quadrilateral or Bezier triangle.
    depth : int, optional
        Of Bezier cells, how many rings of them there are around special corners, as for
        `bezier_patches`; 8 by default.

    Returns
    -------
    pyvista.PolyData, or pyvista.UnstructuredGrid of Bezier cells
        Cells have points of their own, the control points, with the coefficients of channels as
        data of points, which VTK interpolates alike, and "RationalWeights", all 1. Data of cells
        are "HigherOrderDegrees"; "face", "origin" and "size", where each is, as in `BezierPatches`;
        and "deviation": 0 of pieces of the surface. Behind these there is one more cell for each
        special corner, where pieces go on for ever: it joins the corners of what remains, and its
        deviation is a bound of its distance from the surface at the same parameters.

    Raises
    ------
    ValueError
        Points that are not of shape (n_vertices, 3), or a tessellation without polygons; `n` or
        `bezier` with anything but a surface, or both; a depth out of range, or without `bezier`.
    ImportError
        PyVista is not installed.

    Warns
    -----
    UserWarning
        Of channels that the scheme has no rule for; of those that Bezier cells cannot hold, since
        their own pieces are cut elsewhere.

    Examples
    --------
    >>> import limitsurf as ls
    >>> ls.to_pyvista(ls.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])).n_cells
    1

    >>> cube = ls.Mesh(
    ...     [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)],
    ...     [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    >>> cells = ls.to_pyvista(ls.LimitSurface(cube), bezier=True, depth=4)
    >>> cells.n_cells, cells.n_points
    (240, 3840)
    """
    if bezier:
        if n is not None:
            raise ValueError("n is for polygons, which Bezier cells are not: give depth=, or no n")
        return _bezier(x, depth)
    if depth is not None:
        raise ValueError("depth is for Bezier cells: say bezier=True")
    shown = tessellated(x, n, every=True)
    held = not isinstance(shown, Mesh)
    return _dataset(polygons(shown, uv=held, every=held))


def _bezier(x: Any, depth: int | None) -> Any:
    """Bezier cells of a surface."""
    from limitsurf.shell.io import vtk_bezier
    from limitsurf.surface import LimitSurface

    if not isinstance(x, LimitSurface):
        raise ValueError(f"bezier is for a LimitSurface, got {type(x).__name__}")
    return vtk_bezier.dataset(x, depth, imported_pyvista())


def imported_pyvista() -> Any:
    """PyVista; ImportError that says how to install it."""
    try:
        import pyvista
    except ImportError as error:
        raise ImportError('PyVista is needed: pip install "limitsurf[plot]"') from error
    return pyvista


def _dataset_faces(dataset: Any) -> tuple[Any, Any, Any]:
    """Sizes, indices and numbers of the polygons of a dataset of PyVista."""
    pyvista = imported_pyvista()
    if not isinstance(dataset, (pyvista.PolyData, pyvista.UnstructuredGrid)):
        raise TypeError(
            f"need a pyvista.PolyData or UnstructuredGrid, got {type(dataset).__name__}: "
            "datasets of pyvista become PolyData by .extract_surface()"
        )
    if isinstance(dataset, pyvista.UnstructuredGrid):
        others = np.flatnonzero(~np.isin(dataset.celltypes, list(vtk_reader.POLYGONS)))
        if len(others):
            kind = pyvista.CellType(dataset.celltypes[others[0]]).name
            raise ValueError(
                f"cell {others[0]} is a {kind}, need polygons only: call .extract_surface()"
            )
    return vtk_reader.cells(dataset)[:3]


def _dataset(shape: Polygons) -> Any:
    """Polygons as a PolyData, split at creases and seams."""
    shape = shape.split()
    cells = np.insert(shape.indices, shape.offsets[:-1], shape.sizes)  # size, vertices, size, ...
    dataset = imported_pyvista().PolyData(shape.points.copy(), cells)
    for name, (values, _) in shape.channels.items():
        if name != "uv":
            dataset.point_data[name] = values.reshape(len(values), -1).astype(float)
    if len(shape.normals):
        dataset.point_data["Normals"] = shape.normals
        dataset.point_data.active_normals_name = "Normals"
    if "uv" in shape.channels:
        # in single precision: of others VTK's writer of PLY files would end the process
        dataset.point_data["uv"] = shape.channels["uv"][0].astype(np.float32)
        dataset.GetPointData().SetActiveTCoords("uv")
    for name, values in shape.face_data.items():
        dataset.cell_data[name] = values
    return dataset


@contextmanager
def _complaints() -> Iterator[list[str]]:
    """What VTK says meanwhile, instead of printing it."""
    from vtkmodules.vtkCommonCore import vtkLogger, vtkOutputWindow, vtkStringOutputWindow

    said: list[str] = []
    window, before = vtkStringOutputWindow(), vtkOutputWindow.GetInstance()
    verbosity = vtkLogger.GetCurrentVerbosityCutoff()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    vtkOutputWindow.SetInstance(window)
    try:
        yield said
    finally:
        vtkOutputWindow.SetInstance(before)
        vtkLogger.SetStderrVerbosity(verbosity)
        said += [line for line in window.GetOutput().splitlines() if "rror" in line]


def content(shape: Polygons, suffix: str) -> Iterator[bytes]:
    """The bytes of a file of VTK."""
    dataset: Any = _dataset(shape)
    from vtkmodules.vtkIOLegacy import vtkPolyDataWriter
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter, vtkXMLUnstructuredGridWriter

    with _complaints() as said:
        if suffix == ".vtk":
            writer = vtkPolyDataWriter()
            writer.SetFileTypeToBinary()
        else:
            writer = vtkXMLPolyDataWriter() if suffix == ".vtp" else vtkXMLUnstructuredGridWriter()
            dataset = dataset if suffix == ".vtp" else dataset.cast_to_unstructured_grid()
        writer.SetInputData(dataset)
        writer.WriteToOutputStringOn()
        writer.Write()
        text = writer.GetOutputStdString() if suffix == ".vtk" else writer.GetOutputString()
    if said or not text:
        raise OSError(f"VTK cannot write it: {' '.join(said)}")
    yield text.encode() if isinstance(text, str) else text
