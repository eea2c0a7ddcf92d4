"""The cages in files of VTK, for a process of its own: a broken one may end it."""

from __future__ import annotations

import os
import re
import tempfile
import warnings
from typing import Any

import numpy as np

from limitsurf.cage.checks import MeshError
from limitsurf.cage.mesh import Mesh
from limitsurf.shell.io import references
from limitsurf.shell.io.losses import Losses
from limitsurf.shell.io.polygons import mesh_of, strips

SUFFIXES = (".vtp", ".vtu", ".vtk")

# The names of cells that are polygons, or that these are made of, by VTK's numbers.
POLYGONS = {5: "triangle", 7: "polygon", 9: "quad", 6: "triangle strip", 8: "pixel"}
STRIP, PIXEL = 6, 8
# Behind all else in a legacy file: an array that is missed, or a part of another one, where the
# file is truncated. VTK does not say so.
_END = "limitsurf"
_FIELD = f"\nFIELD FieldData 1\n{_END} 1 1 int\n".encode()
_UNREAD = "limitsurf unread"  # an array that says that others are broken
# Scenes, of which PyVista leaves out the transforms.
SCENES = {".wrl": "vtkVRMLImporter", ".vrml": "vtkVRMLImporter", ".3ds": "vtk3DSImporter"}


def read(name: str, suffix: str, path: str, folder: str | None, *, strict: bool = False) -> Mesh:
    """The cage of a file; active texture coordinates of points are the channel "uv"."""
    losses = Losses(name, strict)
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
    for text in arrays.pop("damage"):
        losses.add(text, "", text)
    losses.left_out(arrays.pop("left_out"))
    # of scenes VTK repeats the points at edges of boxes, of 3DS files at all edges
    mesh = mesh_of(losses=losses, **arrays, merge="uv" in arrays or suffix in SCENES)
    losses.warn(2)
    return mesh


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
    """The dataset in a file of VTK; without attributes if it is read no other way."""
    from vtkmodules.vtkCommonCore import vtkStringArray

    try:
        return _with_arrays(suffix, data)
    except MeshError as error:
        try:
            found = _with_arrays(suffix, data, attributes=False)
        except MeshError:
            raise error from None
    array = vtkStringArray()
    array.SetName(_UNREAD)
    found[0].GetFieldData().AddArray(array)
    return found


def _with_arrays(suffix: str, data: bytes, attributes: bool = True) -> list[Any]:
    """The dataset in a file of VTK, with its attributes of points and cells or without."""
    from vtkmodules.vtkIOLegacy import vtkDataSetReader
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLUnstructuredGridReader

    content: Any = data  # as text, say VTK's annotations
    window = _listener()
    if suffix == ".vtk":
        if not attributes:
            content = re.split(rb"(?m)^[ \t]*(?:POINT|CELL)_DATA\b", data)[0]
        is_text = data.split(b"\n", 3)[2:3] != [b"BINARY"]
        content += _FIELD + (b"0\n" if is_text else bytes(4) + b"\n")
        reader: Any = vtkDataSetReader()
        reader.ReadAllFieldsOn()
        reader.SetBinaryInputString(content, len(content))
    else:
        reader = vtkXMLPolyDataReader() if suffix == ".vtp" else vtkXMLUnstructuredGridReader()
        reader.SetInputString(content)
        if not attributes:
            reader.ReadFromInputStringOn()
            reader.UpdateInformation()
            reader.GetPointDataArraySelection().DisableAllArrays()
            reader.GetCellDataArraySelection().DisableAllArrays()
    reader.ReadFromInputStringOn()
    reader.Update()
    found = reader.GetOutput()
    _check(window)
    if found is None:
        raise MeshError("truncated or broken: VTK finds nothing")
    places = [found.GetPointData(), found.GetCellData(), found.GetFieldData()]
    if suffix != ".vtk" and not found.GetNumberOfCells():
        raise MeshError("need at least one polygon, got none")
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
    """The arrays of the polygons of a dataset: points, sizes, indices, uv where there is one.

    And of strings: left_out, what else there is; damage, what is wrong.
    """
    from vtkmodules.util.numpy_support import vtk_to_numpy

    if found is not None and found.IsA("vtkStructuredGrid"):
        from vtkmodules.vtkFiltersCore import vtkAppendFilter

        cells_of = vtkAppendFilter()  # of a surface these are quads
        cells_of.AddInputData(found)
        cells_of.Update()
        found = cells_of.GetOutput()
    if found is None or not (found.IsA("vtkPolyData") or found.IsA("vtkUnstructuredGrid")):
        kind = "nothing" if found is None else found.GetClassName().removeprefix("vtk")
        raise MeshError(f"need polygons, got {kind}")
    sizes, indices, numbers, others = cells(found)
    if not len(sizes) or not found.GetNumberOfPoints():
        return {}
    points = vtk_to_numpy(found.GetPoints().GetData()).astype(np.float64)
    result: dict[str, Any] = {"points": points, "sizes": sizes, "indices": indices}
    result["face_data"], unfit = cell_data(found, numbers)
    names, damage = _arrays(found, unfit)
    uv = texture(found)
    if uv is not None and len(uv) == len(points):
        result["uv"] = uv
    elif uv is not None:
        damage.append(f"got {len(uv)} texture coordinates, need {len(points)}")
    return {**result, "left_out": [*others, *names], "damage": damage}


def texture(found: Any) -> Any:
    """Active texture coordinates (n, 2) of a dataset, or None."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    array = found.GetPointData().GetTCoords()
    if array is None or array.GetNumberOfComponents() < 2:
        return None
    return vtk_to_numpy(array)[:, :2].astype(np.float64)


def cell_data(found: Any, numbers: Any) -> tuple[dict[str, Any], list[str]]:
    """Data of the cells of such numbers by name, but normals; and the names of others."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    data, kept, others = found.GetCellData(), {}, []
    for i in range(data.GetNumberOfArrays()):
        array = data.GetAbstractArray(i)
        name, count = array.GetName() or str(i), array.GetNumberOfTuples()
        if count != found.GetNumberOfCells() or name in (_END, _UNREAD):
            continue
        if array.IsA("vtkStringArray") and array.GetNumberOfComponents() == 1:
            kept[name] = np.array([array.GetValue(k) for k in range(count)], dtype=str)[numbers]
        elif array.IsA("vtkDataArray") and array is not data.GetNormals():
            kept[name] = vtk_to_numpy(array)[numbers]
        elif array is not data.GetNormals():
            others.append(name)
    return kept, others


def cells(found: Any) -> tuple[Any, Any, Any, list[str]]:
    """Sizes and vertices of the polygons of a PolyData or UnstructuredGrid, and what else it has.

    Before that the number of the cell that each was. Strips become triangles. Cells that are no
    polygons are left out, if there are polygons.
    """
    from vtkmodules.util.numpy_support import vtk_to_numpy

    def listed(array: Any) -> tuple[Any, Any]:
        if array is None or not array.GetNumberOfCells():
            return np.zeros(0, np.int64), np.zeros(0, np.int64)
        offsets = vtk_to_numpy(array.GetOffsetsArray()).astype(np.int64)
        return np.diff(offsets), vtk_to_numpy(array.GetConnectivityArray()).astype(np.int64)

    others = []
    if found.IsA("vtkPolyData"):
        sizes, indices = listed(found.GetPolys())
        of_strips, ends = listed(found.GetStrips())
        is_strip = np.repeat([False, True], [len(sizes), len(of_strips)])
        sizes, indices = np.append(sizes, of_strips), np.append(indices, ends)
        for name, array in ("lines", found.GetLines()), ("points", found.GetVerts()):
            if array.GetNumberOfCells():
                others.append(f"{name} ({array.GetNumberOfCells()})")
        before = found.GetNumberOfVerts() + found.GetNumberOfLines()
        numbers = before + np.arange(len(sizes))
        return *_without_strips(sizes, indices, numbers, is_strip), others
    sizes, indices = listed(found.GetCells())
    if not len(sizes):
        return sizes, indices, np.zeros(0, np.int64), others
    try:
        types = found.GetCellTypes()
    except TypeError:  # before VTK 9.6
        types = found.GetCellTypesArray()
    kinds = np.asarray(types) if isinstance(types, np.ndarray) else vtk_to_numpy(types)
    fit = np.isin(kinds, list(POLYGONS))
    wrong = _names(np.unique(kinds[~fit]).tolist())
    if not fit.any():
        text = f"need cells of types {', '.join(POLYGONS.values())}, got some of type "
        raise MeshError(text + wrong[-1][1] + (_SKIN if wrong[-1][0] == 3 else ""))
    others = [f"cells of type {name}" for _, name in wrong]
    indices, sizes, kinds = indices[np.repeat(fit, sizes)], sizes[fit], kinds[fit]
    third = (np.cumsum(sizes) - sizes)[(kinds == PIXEL) & (sizes == 4)] + 2
    indices[third], indices[third + 1] = indices[third + 1], indices[third]  # along rows, in VTK
    return *_without_strips(sizes, indices, np.flatnonzero(fit), kinds == STRIP), others


_SKIN = (
    ": of what PyVista reads, dataset.extract_surface() is the skin, a cage by "
    "limitsurf.from_pyvista"
)


def _names(numbers: list[int]) -> list[tuple[int, str]]:
    """Dimensions and names of types of cells, ascending."""
    from vtkmodules.vtkCommonDataModel import vtkGenericCell

    kinds: list[Any] = [vtkGenericCell.InstantiateCell(number) for number in numbers]
    if None in kinds:
        raise MeshError("truncated or broken: got a cell of unknown type")
    names = [kind.GetClassName().removeprefix("vtk").lower() for kind in kinds]
    return sorted((int(k.GetCellDimension()), name) for k, name in zip(kinds, names, strict=True))


def _without_strips(sizes: Any, indices: Any, numbers: Any, is_strip: Any) -> tuple[Any, Any, Any]:
    """Sizes, indices and numbers of polygons, and behind them the triangles of strips."""
    if not is_strip.any():
        return sizes, indices, numbers
    corners = np.repeat(is_strip, sizes)
    ends = indices[corners]
    corner = strips(sizes[is_strip], ends)
    of_triangles = np.repeat(numbers[is_strip], sizes[is_strip])[corner[:, 0]]
    triangles = ends[corner]
    sizes = np.append(sizes[~is_strip], np.full(len(triangles), 3))
    numbers = np.append(numbers[~is_strip], of_triangles)
    return sizes, np.append(indices[~corners], triangles), numbers


def _arrays(found: Any, unfit: list[str]) -> tuple[list[str], list[str]]:
    """The names of data arrays that are not kept; and of those of a wrong size.

    Of cells `unfit` ones are not kept.
    """
    names, damage = [], []
    for of, data, number in (
        ("points", found.GetPointData(), found.GetNumberOfPoints()),
        ("cells", found.GetCellData(), found.GetNumberOfCells()),
        ("the file", found.GetFieldData(), None),
    ):
        listed = []
        for i in range(data.GetNumberOfArrays()):
            array = data.GetAbstractArray(i)
            name = array.GetName() or str(i)
            if name == _UNREAD:
                damage.append("got attributes of points or cells that are truncated or broken")
                continue
            count = array.GetNumberOfTuples()
            if name == _END or (of == "points" and _is_known(data, array)):
                continue
            if number is not None and count != number:
                damage.append(f"array {name} of {of}: got {count} values, need {number}")
            elif of != "cells" or name in unfit:
                listed.append(name)
        names += [f"of {of} {', '.join(listed)}"] if listed else []
    return names, damage


def _is_known(data: Any, array: Any) -> bool:
    """Whether an array of points is texture coordinates; or normals, which the surface has."""
    return array is data.GetTCoords() or array is data.GetNormals()


def _joined(parts: list[dict[str, Any]]) -> dict[str, Any]:
    """The arrays of all datasets as those of one; of texture coordinates the row of each corner.

    It is -1 in datasets without.
    """
    parts = [part for part in parts if part]
    if not parts:
        raise MeshError("need at least one polygon, got none")
    first = np.cumsum([0] + [len(part["points"]) for part in parts])
    rows, count = [], 0
    for part, start in zip(parts, first, strict=False):
        own = "uv" in part
        rows.append(part["indices"] + count if own else np.full(len(part["indices"]), -1))
        count += len(part["uv"]) if own else 0
        part["indices"] = part["indices"] + start
    names = ["points", "sizes", "indices"]
    joined: dict[str, Any] = {n: np.concatenate([part[n] for part in parts]) for n in names}
    if count:
        joined["uv"] = np.concatenate([part["uv"] for part in parts if "uv" in part])
        joined["rows"] = np.concatenate(rows)
    shared = [set(part["face_data"]) for part in parts]
    joined["face_data"] = {}
    for name in sorted(set.intersection(*shared)):
        values = [part["face_data"][name] for part in parts]
        if len({x.shape[1:] for x in values}) == len({x.dtype.kind == "U" for x in values}) == 1:
            joined["face_data"][name] = np.concatenate(values)
    lost = sorted(set.union(*shared) - set(joined["face_data"]))
    parts[0]["left_out"] += [f"of cells {name}" for name in lost]
    for name in "left_out", "damage":
        joined[name] = list(dict.fromkeys(x for part in parts for x in part[name]))
    return joined
