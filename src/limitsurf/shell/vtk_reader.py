"""A script that reads a file of VTK: in a process of its own, since a broken file may end it.

VTK trusts the counts in a file: wrong ones make it ask for any amount of memory, read beyond its
arrays, or read on for ever. Standard input has the bytes of the file, standard output the arrays
of its polygons (npz), or one named "error" that says what is wrong.
"""

from __future__ import annotations

import sys
from contextlib import suppress
from io import BytesIO
from typing import Any

import numpy as np

# The names of cells that are polygons, by VTK's numbers.
_POLYGONS = {5: "triangle", 7: "polygon", 9: "quad"}
# Behind all else in a legacy file: an array that is missed, or a part of another one, where the
# file is truncated. VTK does not say so.
_END = "limitsurf"
_FIELD = f"\nFIELD FieldData 1\n{_END} 1 1 int\n".encode()


def arrays(suffix: str, data: bytes) -> dict[str, Any]:
    """The arrays of the polygons in a file: points, sizes, indices, uv where there is one."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkLogger, vtkOutputWindow, vtkStringOutputWindow
    from vtkmodules.vtkIOLegacy import vtkDataSetReader
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLUnstructuredGridReader

    content: Any = data  # as text, say VTK's annotations
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    window = vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(window)
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
    said = window.GetOutput()
    said = said if isinstance(said, str) else said.decode("latin-1")
    errors = [line.strip() for line in said.splitlines() if "rror" in line]
    if errors or found is None:
        return {"error": f"truncated or broken: VTK says {errors[0] if errors else 'nothing'}"}
    places = [found.GetPointData(), found.GetCellData(), found.GetFieldData()]
    if suffix == ".vtk" and not any(place.HasArray(_END) for place in places):
        return {"error": "truncated or broken"}
    if found.IsA("vtkPolyData"):
        if found.GetStrips().GetNumberOfCells():
            return {"error": "need polygons, got triangle strips"}
        cells = found.GetPolys()
    elif found.IsA("vtkUnstructuredGrid"):
        others = set(vtk_to_numpy(found.GetDistinctCellTypesArray()).tolist()) - _POLYGONS.keys()
        if others:
            need = ", ".join(_POLYGONS.values())
            return {"error": f"need cells of types {need} only, got some of type {min(others)}"}
        cells = found.GetCells()
    else:
        return {"error": f"need PolyData or UnstructuredGrid, got {found.GetClassName()[3:]}"}
    if cells is None or not cells.GetNumberOfCells() or not found.GetNumberOfPoints():
        return {"error": "need at least one polygon, got none"}
    result = {
        "points": vtk_to_numpy(found.GetPoints().GetData()).astype(np.float64),
        "sizes": np.diff(vtk_to_numpy(cells.GetOffsetsArray()).astype(np.int64)),
        "indices": vtk_to_numpy(cells.GetConnectivityArray()).astype(np.int64),
    }
    texture = found.GetPointData().GetTCoords()
    if texture is not None and texture.GetNumberOfComponents() >= 2:
        result["uv"] = vtk_to_numpy(texture)[:, :2].astype(np.float64)
    return result


def main(suffix: str, limit: int) -> None:
    """Answer on standard output, with so many bytes of memory at most, where that can be said."""
    with suppress(ImportError, ValueError, OSError):  # not on every system
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    answer = BytesIO()
    np.savez(answer, **arrays(suffix, sys.stdin.buffer.read()))
    sys.stdout.buffer.write(answer.getvalue())


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
