"""The cages in files of VTK, for a process of its own: a broken one may end it."""

from __future__ import annotations

import os
import re
import tempfile
import warnings
from typing import Any

import numpy as np

from limitsurf.mesh import Mesh, MeshError
from limitsurf.shell import references
from limitsurf.shell.polygons import mesh_of

SUFFIXES = (".vtp", ".vtu", ".vtk")

# The names of cells that are polygons, by VTK's numbers.
POLYGONS = {5: "triangle", 7: "polygon", 9: "quad"}
# Behind all else in a legacy file: an array that is missed, or a part of another one, where the
# file is truncated. VTK does not say so.
_END = "limitsurf"
_FIELD = f"\nFIELD FieldData 1\n{_END} 1 1 int\n".encode()
# Scenes, of which PyVista leaves out the transforms.
SCENES = {".wrl": "vtkVRMLImporter", ".vrml": "vtkVRMLImporter", ".3ds": "vtk3DSImporter"}


def read(name: str, suffix: str, path: str, folder: str | None) -> Mesh:
    """The cage of a file; active texture coordinates of points are the channel "uv"."""
    try:
        if suffix in SUFFIXES:
            with open(path, "rb") as file:
                found = _of_bytes(suffix, file.read())
        else:
            references.add_mentioned(name, path)
            found = (_of_scene if suffix in SCENES else _of_path)(suffix, path)
        arrays = _joined([_polygons(part) for part in found])
    except ImportError as error:
        raise ImportError('PyVista is needed: pip install "limitsurf[plot]"') from error
    except MeshError as error:
        raise MeshError(f"{name}: {error}") from None
    # of scenes VTK repeats the points at edges of boxes, of 3DS files at all edges
    return mesh_of(**arrays, merge="uv" in arrays or suffix in SCENES)


def _listener() -> Any:
    """Where VTK says what is wrong, instead of printing it."""
    from vtkmodules.vtkCommonCore import vtkLogger, vtkOutputWindow, vtkStringOutputWindow

    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    window = vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(window)
    return window


def _check(window: Any) -> None:
    said = window.GetOutput()
    said = said if isinstance(said, str) else said.decode("latin-1")
    errors = [line.strip() for line in said.splitlines() if "rror" in line]
    if errors:
        raise MeshError(f"truncated or broken: VTK says {errors[0]}")


def _of_bytes(suffix: str, data: bytes) -> list[Any]:
    """The dataset in a file of VTK."""
    from vtkmodules.vtkIOLegacy import vtkDataSetReader
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLUnstructuredGridReader

    content: Any = data  # as text, say VTK's annotations
    window = _listener()
    if suffix == ".vtk":
        is_text = data.split(b"\n", 3)[2:3] != [b"BINARY"]
        content += _FIELD + (b"0\n" if is_text else bytes(4) + b"\n")
        reader: Any = vtkDataSetReader()
        reader.ReadAllFieldsOn()
        reader.SetBinaryInputString(content, len(content))
    else:
        reader = vtkXMLPolyDataReader() if suffix == ".vtp" else vtkXMLUnstructuredGridReader()
        reader.SetInputString(content)
    reader.ReadFromInputStringOn()
    reader.Update()
    found = reader.GetOutput()
    _check(window)
    if found is None:
        raise MeshError("truncated or broken: VTK finds nothing")
    places = [found.GetPointData(), found.GetCellData(), found.GetFieldData()]
    if suffix == ".vtk" and not any(place.HasArray(_END) for place in places):
        raise MeshError("truncated or broken")
    return [found]


def _of_path(suffix: str, path: str) -> list[Any]:
    """The datasets in a file of another format that PyVista reads."""
    import pyvista  # before the listener: it sets one of its own

    window = _listener()
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("error", "The VTK reader")
            found = pyvista.read(path, force_ext=suffix)
    except Exception as error:  # of whatever type
        said = " ".join(str(error).rpartition("\t")[2].split())[:300]  # what VTK says, if it did
        raise MeshError(f"PyVista cannot read it, truncated or broken: {said}") from None
    _check(window)
    if found is None or not found.IsA("vtkCompositeDataSet"):
        return [found]
    leaves, at = [], found.NewIterator()
    at.InitTraversal()
    while not at.IsDoneWithTraversal():
        leaves.append(at.GetCurrentDataObject())
        at.GoToNextItem()
    return leaves


def _of_scene(suffix: str, path: str) -> list[Any]:
    """The datasets of a scene, each where its transforms put it."""
    import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  (the importers need a window)
    from vtkmodules import vtkIOImport
    from vtkmodules.vtkCommonTransforms import vtkTransform
    from vtkmodules.vtkFiltersCore import vtkTriangleFilter
    from vtkmodules.vtkFiltersGeneral import vtkTransformPolyDataFilter

    with open(path, "rb") as file:
        length = int.from_bytes(file.read(6)[2:], "little")
    if suffix == ".3ds" and length > os.path.getsize(path):
        raise MeshError(f"truncated: need {length} bytes, as it says itself")
    window = _listener()
    importer = getattr(vtkIOImport, SCENES[suffix])()
    importer.SetFileName(path)
    if said := re.search(rb"(?m)^Error near line.*", _printed(importer.Update)):
        # of a VRML file VTK prints this, and goes on with what there is
        raise MeshError(f"truncated or broken: VTK says {said[0].decode('latin-1')}")
    leaves = []
    for actor in importer.GetRenderer().GetActors():
        if actor.GetMatrix().Determinant() < 0:
            raise MeshError("an object is mirrored, and VTK does not place it right")
        transform, placed, cut = vtkTransform(), vtkTransformPolyDataFilter(), vtkTriangleFilter()
        transform.SetMatrix(actor.GetMatrix())
        actor.GetMapper().Update()
        placed.SetInputData(actor.GetMapper().GetInput())
        placed.SetTransform(transform)
        cut.SetInputConnection(placed.GetOutputPort())
        last: Any = cut if suffix == ".3ds" else placed  # VTK made strips of its triangles
        last.Update()
        leaves.append(last.GetOutput())
    _check(window)
    return leaves


def _printed(call: Any) -> bytes:
    """What a call prints on the standard error, which it is not to see."""
    before = os.dup(2)
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), 2)
        try:
            call()
        finally:
            os.dup2(before, 2)
            os.close(before)
        file.seek(0)
        return file.read()


def _polygons(found: Any) -> dict[str, Any]:
    """The arrays of the polygons of a dataset: points, sizes, indices, uv where there is one."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkGenericCell

    if found is not None and found.IsA("vtkStructuredGrid"):
        from vtkmodules.vtkFiltersCore import vtkAppendFilter

        cells_of = vtkAppendFilter()  # of a surface these are quads
        cells_of.AddInputData(found)
        cells_of.Update()
        found = cells_of.GetOutput()
    if found is not None and found.IsA("vtkPolyData"):
        if found.GetStrips().GetNumberOfCells():
            raise MeshError("need polygons, got triangle strips")
        cells = found.GetPolys()
    elif found is not None and found.IsA("vtkUnstructuredGrid"):
        others = set(vtk_to_numpy(found.GetDistinctCellTypesArray()).tolist()) - POLYGONS.keys()
        if others:
            kinds: list[Any] = [vtkGenericCell.InstantiateCell(number) for number in others]
            if None in kinds:
                raise MeshError("truncated or broken: got a cell of unknown type")
            worst = max(kinds, key=lambda cell: int(cell.GetCellDimension()))
            text = f"need cells of types {', '.join(POLYGONS.values())} only, got some of type "
            text += worst.GetClassName().removeprefix("vtk").lower()
            if worst.GetCellDimension() == 3:
                text += ": of what PyVista reads, dataset.extract_surface() is the skin, a cage by "
                text += "limitsurf.from_pyvista"
            raise MeshError(text)
        cells = found.GetCells()
    else:
        kind = "nothing" if found is None else found.GetClassName().removeprefix("vtk")
        raise MeshError(f"need polygons, got {kind}")
    if cells is None or not cells.GetNumberOfCells() or not found.GetNumberOfPoints():
        return {}
    result = {
        "points": vtk_to_numpy(found.GetPoints().GetData()).astype(np.float64),
        "sizes": np.diff(vtk_to_numpy(cells.GetOffsetsArray()).astype(np.int64)),
        "indices": vtk_to_numpy(cells.GetConnectivityArray()).astype(np.int64),
    }
    texture = found.GetPointData().GetTCoords()
    if texture is not None and texture.GetNumberOfComponents() >= 2:
        result["uv"] = vtk_to_numpy(texture)[:, :2].astype(np.float64)
    return result


def _joined(parts: list[dict[str, Any]]) -> dict[str, Any]:
    """The arrays of all datasets as those of one; "uv" if all have some."""
    parts = [part for part in parts if part]
    if not parts:
        raise MeshError("need at least one polygon, got none")
    first = np.cumsum([0] + [len(part["points"]) for part in parts])
    for part, start in zip(parts, first, strict=False):
        part["indices"] += start
    return {
        name: np.concatenate([part[name] for part in parts])
        for name in parts[0]
        if all(name in part for part in parts)
    }
