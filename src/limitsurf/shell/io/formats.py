"""The formats of files: which there are, what each can hold, and who reads it."""

from __future__ import annotations

import codecs
import os
import re
from contextlib import suppress
from dataclasses import replace
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np

from limitsurf.cage.checks import MeshError
from limitsurf.cage.mesh import Mesh
from limitsurf.shell.io import vtk_reader
from limitsurf.shell.io.apart import read_apart

if TYPE_CHECKING:
    from limitsurf.query import Polygons, Tessellation

USD = (".usd", ".usda", ".usdc")
PLAIN = (".obj", ".ply", ".off")
VTK = vtk_reader.SUFFIXES
TRIMESH = (".stl", ".glb", ".gltf", ".3mf", ".dae")
READABLE = (*PLAIN, ".msh", *USD, ".usdz", *VTK, *TRIMESH)
CAD = (".step", ".stp", ".iges", ".igs", ".brep")  # of surfaces, see `step`
WRITABLE = (*PLAIN, *USD, *VTK, *TRIMESH)
# what else a format holds of a tessellation
WITH_NORMALS = (".obj", ".ply", *USD, *VTK, ".glb", ".gltf", ".dae")
WITH_UV = (".obj", ".ply", *USD, *VTK, ".glb", ".gltf", ".dae")
WITH_CHANNELS = (*VTK, *USD)  # all channels, whatever their shape
# the axis that points up, and the metres of one unit, in files as they are written
MEASURES = {".glb": ("y", 1.0), ".gltf": ("y", 1.0), ".dae": ("y", 1.0), ".3mf": ("z", 0.001)}

# what reads files of a library in a process of its own, and what is to be imported there first
_READERS: dict[str, tuple[str, tuple[str, ...]]] = {
    "usd": ("limitsurf.shell.io.references:read_usd", ("limitsurf.shell.io.usd",)),
    "vtk": (
        "limitsurf.shell.io.vtk_reader:read",
        ("vtkmodules.vtkIOLegacy", "vtkmodules.vtkIOXML", "vtkmodules.util.numpy_support"),
    ),
    "pyvista": ("limitsurf.shell.io.vtk_reader:read", ("pyvista",)),
    "trimesh": ("limitsurf.shell.io.by_trimesh:read", ("trimesh.exchange.load",)),
    "rhino": ("limitsurf.shell.io.rhino:read", ("rhino3dm",)),
}
# what makes files that are read of others
_DETOURS = {
    ".blend .fbx .abc .x3d .x3dv .bvh .lwo .svg": "Blender opens it, and exports USD or OBJ",
    ".ma .mb .max .c4d .hip .hipnc .lxo .zpr .ztl": "the program that wrote it exports USD or OBJ",
    ".skp .dwg .dxf": "the program that wrote it exports COLLADA (.dae) or OBJ",
    ".step .stp .iges .igs .brep": (
        "a CAD kernel's faces are no cage: limitsurf.read_brep reads them, and its to_mesh() makes "
        "a cage of those that are limit faces; FreeCAD or Gmsh mesh others, and write OBJ or .msh"
    ),
    ".x_t .sat .fcstd .sldprt .ipt": (
        "a CAD kernel's faces are no cage: FreeCAD or Gmsh mesh it, and write OBJ or .msh"
    ),
    ".mesh .meshb .inp .bdf .nas .fem .su2 .med .xdmf .cgns .unv": (
        "'meshio convert', of the package meshio, or Gmsh writes .vtk, .msh or OBJ of it"
    ),
}
# how a file begins, after white space, and what to say where it does not
_BEGINNINGS = {
    ".vtp": (rb"\s*<((?s:.){0,2000}<)?VTKFile\b", "XML with <VTKFile"),
    ".vtu": (rb"\s*<((?s:.){0,2000}<)?VTKFile\b", "XML with <VTKFile"),
    ".vtk": (rb"# vtk DataFile Version \d", "'# vtk DataFile Version'"),
    ".glb": (rb"glTF[\x01\x02]\0\0\0", "'glTF', version 1 or 2"),
    ".gltf": (rb"(\xef\xbb\xbf)?\s*\{", "JSON, '{'"),
    ".3mf": (rb"PK\x03\x04", "a ZIP archive, 'PK'"),
    ".3dm": (rb"3D Geometry File Format", "'3D Geometry File Format'"),
    ".dae": (rb"(\xef\xbb\xbf)?\s*<((?s:.){0,2000}<)?COLLADA\b", "XML with <COLLADA"),
}


def read_by_library(name: str, suffix: str, path: str, folder: str | None, **options: Any) -> Any:
    """The cage of a file at a path, whose format is not `PLAIN`, read in a process of its own.

    `name` is that of the file for messages; files that it names are in the folder, if any.
    """
    families = {**dict.fromkeys((*USD, ".usdz"), "usd"), **dict.fromkeys(VTK, "vtk")}
    families |= dict.fromkeys(TRIMESH, "trimesh")
    with open(path, "rb") as file:
        _check_beginning(name, suffix, file.read(1 << 16))
    function, modules = _READERS[families.get(suffix) or library(suffix) or "trimesh"]
    if suffix in TRIMESH and "call" in options:
        function = f"{function.partition(':')[0]}:{options.pop('call')}"
    size = os.path.getsize(path)
    return read_apart(name, size, function, name, suffix, path, folder, modules=modules, **options)


def library(suffix: str) -> str | None:
    """The library that reads a format outside of `READABLE`, if it is installed."""
    if suffix == ".3dm":
        if find_spec("rhino3dm") is None:
            raise ImportError('rhino3dm is needed for .3dm files: pip install "limitsurf[rhino]"')
        return "rhino"
    with suppress(ImportError):
        from trimesh.exchange.load import mesh_formats

        if suffix in {f".{name}" for name in mesh_formats()} - {".xyz"}:  # points alone
            return "trimesh"
    with suppress(ImportError):
        from pyvista.core.utilities.reader import CLASS_READERS

        if suffix in CLASS_READERS:
            return "pyvista"
    return None


def detour(suffix: str) -> str:
    """Which program makes a file that is read of one that is not, for the end of a message."""
    for suffixes, how in _DETOURS.items():
        if suffix in suffixes.split():
            return f"; {how}"
    return ""


def _check_beginning(name: str, suffix: str, data: bytes) -> None:
    pattern, need = _BEGINNINGS.get(suffix, (b"", ""))
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        data = data.decode("utf-16", errors="replace").encode()
    if not re.match(pattern, data):
        raise MeshError(f"{name}: need {need} at the start: this is no {suffix} file")


def placed(shape: Polygons, suffix: str, x: Mesh | Tessellation) -> Polygons:
    """Polygons turned and scaled as a format takes them that has units and an up axis of its own.

    What is not known of `x` is taken to be right.
    """
    if suffix not in MEASURES:
        return shape
    up, units = MEASURES[suffix]
    points, normals = shape.points, shape.normals
    if x.up not in (None, up):
        turn = (
            [[1, 0, 0], [0, 0, -1], [0, 1, 0]] if up == "y" else [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
        )
        points, normals = points @ np.array(turn, float), normals @ np.array(turn, float)
    if x.units not in (None, units):
        points = points * (x.units / units)
    return replace(shape, points=points, normals=normals)
