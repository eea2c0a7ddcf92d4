"""A script that reads a file of VTK: in a process of its own, since a broken file may end it.

VTK trusts the counts in a file: wrong ones make it ask for any amount of memory, read beyond its
arrays, or read on for ever. Standard input has the bytes of the file, unless its path is given, for
the formats that PyVista reads besides; standard output the arrays of its polygons (npz), or one
named "error" that says what is wrong.
"""

from __future__ import annotations

import os
import sys
import warnings
from contextlib import suppress
from io import BytesIO
from typing import Any

import numpy as np

# The names of cells that are polygons, by VTK's numbers.
POLYGONS = {5: "triangle", 7: "polygon", 9: "quad"}
# Behind all else in a legacy file: an array that is missed, or a part of another one, where the
# file is truncated. VTK does not say so.
_END = "limitsurf"
_FIELD = f"\nFIELD FieldData 1\n{_END} 1 1 int\n".encode()
# Scenes, of which PyVista leaves out the transforms.
SCENES = {".wrl": "vtkVRMLImporter", ".vrml": "vtkVRMLImporter", ".3ds": "vtk3DSImporter"}


class _UnfitError(Exception):
    """What is wrong with a file."""


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
        raise _UnfitError(f"truncated or broken: VTK says {errors[0]}")


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
        raise _UnfitError("truncated or broken: VTK finds nothing")
    places = [found.GetPointData(), found.GetCellData(), found.GetFieldData()]
    if suffix == ".vtk" and not any(place.HasArray(_END) for place in places):
        raise _UnfitError("truncated or broken")
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
        raise _UnfitError(f"PyVista cannot read it, truncated or broken: {said}") from None
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
        raise _UnfitError(f"truncated: need {length} bytes, as it says itself")
    window = _listener()
    importer = getattr(vtkIOImport, SCENES[suffix])()
    importer.SetFileName(path)
    importer.Update()
    leaves = []
    for actor in importer.GetRenderer().GetActors():
        if actor.GetMatrix().Determinant() < 0:
            raise _UnfitError("an object is mirrored, and VTK does not place it right")
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
            raise _UnfitError("need polygons, got triangle strips")
        cells = found.GetPolys()
    elif found is not None and found.IsA("vtkUnstructuredGrid"):
        others = set(vtk_to_numpy(found.GetDistinctCellTypesArray()).tolist()) - POLYGONS.keys()
        if others:
            kinds: list[Any] = [vtkGenericCell.InstantiateCell(number) for number in others]
            if None in kinds:
                raise _UnfitError("truncated or broken: got a cell of unknown type")
            worst = max(kinds, key=lambda cell: int(cell.GetCellDimension()))
            text = f"need cells of types {', '.join(POLYGONS.values())} only, got some of type "
            text += worst.GetClassName().removeprefix("vtk").lower()
            if worst.GetCellDimension() == 3:
                text += ": of what PyVista reads, dataset.extract_surface() is the skin, a cage by "
                text += "limitsurf.from_pyvista"
            raise _UnfitError(text)
        cells = found.GetCells()
    else:
        kind = "nothing" if found is None else found.GetClassName().removeprefix("vtk")
        raise _UnfitError(f"need polygons, got {kind}")
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
        raise _UnfitError("need at least one polygon, got none")
    first = np.cumsum([0] + [len(part["points"]) for part in parts])
    for part, start in zip(parts, first, strict=False):
        part["indices"] += start
    return {
        name: np.concatenate([part[name] for part in parts])
        for name in parts[0]
        if all(name in part for part in parts)
    }


def main(suffix: str, limit: int, path: str | None = None) -> None:
    """Answer on standard output, with so many bytes of memory at most, where that can be said."""
    with suppress(ImportError, ValueError, OSError):  # not on every system
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    answer = BytesIO()
    with os.fdopen(os.dup(1), "wb") as output:
        os.dup2(2, 1)  # for the readers that print
        try:
            if path is None:
                found = _of_bytes(suffix, sys.stdin.buffer.read())
            else:
                found = (_of_scene if suffix in SCENES else _of_path)(suffix, path)
            np.savez(answer, **_joined([_polygons(part) for part in found]))
        except _UnfitError as error:
            np.savez(answer, error=str(error))
        output.write(answer.getvalue())


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), *sys.argv[3:])
