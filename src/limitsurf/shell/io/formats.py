"""Cages and tessellations from and to PyVista and trimesh, and the formats that these know."""

from __future__ import annotations

import json
import logging
import os
import re
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.mesh import UP, Mesh, MeshError
from limitsurf.shell.io import references, vtk_reader
from limitsurf.shell.io.apart import allow, read_apart
from limitsurf.shell.io.losses import Losses
from limitsurf.shell.io.polygons import mesh_of, polygons

if TYPE_CHECKING:
    from limitsurf.query import Polygons, Tessellation

USD = (".usd", ".usda", ".usdc")
PLAIN = (".obj", ".ply", ".off")
VTK = vtk_reader.SUFFIXES
TRIMESH = (".stl", ".glb", ".gltf", ".3mf", ".dae")
READABLE = (*PLAIN, *USD, ".usdz", *VTK, *TRIMESH)
WRITABLE = (*PLAIN, *USD, *VTK, *TRIMESH)
# what else a format holds of a tessellation
WITH_NORMALS = (".obj", ".ply", *USD, *VTK, ".glb", ".gltf", ".dae")
WITH_UV = (".obj", ".ply", *USD, *VTK, ".glb", ".gltf", ".dae")
# the axis that points up, and the metres of one unit, in files as they are written
MEASURES = {".glb": ("y", 1.0), ".gltf": ("y", 1.0), ".dae": ("y", 1.0), ".3mf": ("z", 0.001)}

_UNPACKED = 1 << 26  # bytes of archives unpacked, beside those in proportion to a file
# what reads files of a library in a process of its own, and what is to be imported there first
_READERS: dict[str, tuple[str, tuple[str, ...]]] = {
    "usd": ("limitsurf.shell.io.references:read_usd", ("limitsurf.shell.io.usd",)),
    "vtk": (
        "limitsurf.shell.io.vtk_reader:read",
        ("vtkmodules.vtkIOLegacy", "vtkmodules.vtkIOXML", "vtkmodules.util.numpy_support"),
    ),
    "pyvista": ("limitsurf.shell.io.vtk_reader:read", ("pyvista",)),
    "trimesh": ("limitsurf.shell.io.formats:read_trimesh", ("trimesh.exchange.load",)),
}
# how a file begins, after white space, and what to say where it does not
_BEGINNINGS = {
    ".vtp": (rb"\s*<((?s:.){0,2000}<)?VTKFile\b", "XML with <VTKFile"),
    ".vtu": (rb"\s*<((?s:.){0,2000}<)?VTKFile\b", "XML with <VTKFile"),
    ".vtk": (rb"# vtk DataFile Version \d", "'# vtk DataFile Version'"),
    ".glb": (rb"glTF\x02\0\0\0", "'glTF', version 2"),
    ".gltf": (rb"(\xef\xbb\xbf)?\s*\{", "JSON, '{'"),
    ".3mf": (rb"PK\x03\x04", "a ZIP archive, 'PK'"),
    ".dae": (rb"(\xef\xbb\xbf)?\s*<((?s:.){0,2000}<)?COLLADA\b", "XML with <COLLADA"),
}


def read_by_library(name: str, suffix: str, path: str, folder: str | None, **options: Any) -> Mesh:
    """The cage of a file at a path, whose format is not `PLAIN`, read in a process of its own.

    `name` is that of the file for messages; files that it names are in the folder, if any.
    """
    families = {**dict.fromkeys((*USD, ".usdz"), "usd"), **dict.fromkeys(VTK, "vtk")}
    families |= dict.fromkeys(TRIMESH, "trimesh")
    with open(path, "rb") as file:
        _check_beginning(name, suffix, file.read(1 << 16))
    function, modules = _READERS[families.get(suffix) or library(suffix) or "trimesh"]
    size = os.path.getsize(path)
    found: Mesh = read_apart(
        name, size, function, name, suffix, path, folder, modules=modules, **options
    )
    return found


def library(suffix: str) -> str | None:
    """The library that reads a format outside of `READABLE`, if it is installed."""
    with suppress(ImportError):
        from trimesh.exchange.load import mesh_formats

        if suffix in {f".{name}" for name in mesh_formats()} - {".xyz"}:  # points alone
            return "trimesh"
    with suppress(ImportError):
        from pyvista.core.utilities.reader import CLASS_READERS

        if suffix in CLASS_READERS:
            return "pyvista"
    return None


def from_pyvista(dataset: Any, **tags: Any) -> Mesh:
    """A cage of the polygons of a PyVista ``PolyData`` or ``UnstructuredGrid``.

    Vertex cells and lines are ignored, and so are data arrays. Triangle strips become triangles,
    in the order of VTK behind other polygons. Faces that only touch are joined nowhere: merge their
    points first with ``dataset.clean()``.

    Parameters
    ----------
    dataset : pyvista.PolyData or pyvista.UnstructuredGrid
        Polygons of any size; a grid must have no other cells.
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
    >>> ls.from_pyvista(pyvista.Cube().clean())
    Mesh(8 vertices, 12 edges, 6 faces {4: 6}, interior valences {3: 8})
    """
    _pyvista()
    losses = Losses("from_pyvista", strict=False)
    sizes, indices = _dataset_faces(dataset)
    mesh = mesh_of(dataset.points, sizes, indices, losses, **tags)
    losses.warn(2)
    return mesh


def to_pyvista(x: Mesh | Tessellation) -> Any:
    """A cage or a tessellation as a ``pyvista.PolyData``.

    Parameters
    ----------
    x : Mesh or Tessellation
        Of a cage the points and faces, without tags and channels; exact points are rounded to
        float64. Of a tessellation the polygons, split into one normal for each point, which are
        the active normals; "uv" or else "st" (k, 2) are the active texture coordinates.

    Returns
    -------
    pyvista.PolyData

    Raises
    ------
    ValueError
        Points that are not of shape (n_vertices, 3), or a tessellation without polygons.
    ImportError
        PyVista is not installed.

    Examples
    --------
    >>> import limitsurf as ls
    >>> ls.to_pyvista(ls.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])).n_cells
    1
    """
    return _dataset(polygons(x, uv=not isinstance(x, Mesh)))


def from_trimesh(mesh: Any, *, merge: bool = False, **tags: Any) -> Mesh:
    """A cage of the triangles of a ``trimesh.Trimesh``, or of all in a ``trimesh.Scene``.

    Parameters
    ----------
    mesh : trimesh.Trimesh or trimesh.Scene
        The objects of a scene become one mesh, each where its transforms put it; their point
        clouds and curves are ignored. Texture coordinates are the channel "uv", NaN in objects
        without.
    merge : bool
        Whether points of equal coordinates become one, as they should where they are repeated
        along seams; trimesh itself merges most of them unless it is told ``process=False``.
    **tags
        Creases, corners and all else that ``Mesh`` takes besides points and faces.

    Returns
    -------
    Mesh

    Raises
    ------
    MeshError
        Faces that ``Mesh`` refuses, such as none.
    TypeError
        Another type.
    ImportError
        trimesh is not installed.

    Examples
    --------
    >>> import limitsurf as ls, trimesh
    >>> ls.from_trimesh(trimesh.creation.icosahedron())
    Mesh(12 vertices, 30 edges, 20 faces {3: 20}, interior valences {5: 12})
    """
    losses = Losses("from_trimesh", strict=False)
    found = _of_trimesh(mesh, losses, merge=merge, **tags)
    losses.warn(2)
    return found


def to_trimesh(x: Mesh | Tessellation) -> Any:
    """A cage or a tessellation as a ``trimesh.Trimesh``, of triangles.

    Polygons are cut as those of `Tessellation.triangles`. trimesh processes nothing: points stay as
    they are and where they are.

    Parameters
    ----------
    x : Mesh or Tessellation
        Of a cage the points and faces, without tags and channels; exact points are rounded to
        float64. A tessellation is split into one normal for each point, its ``vertex_normals``;
        "uv" or else "st" (k, 2) are the ``uv`` of its ``TextureVisuals``.

    Returns
    -------
    trimesh.Trimesh

    Raises
    ------
    ValueError
        Points that are not of shape (n_vertices, 3), or a tessellation without polygons.
    ImportError
        trimesh is not installed.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> ls.to_trimesh(square).faces.tolist()
    [[0, 1, 2], [0, 2, 3]]
    >>> ls.to_trimesh(ls.tessellate(ls.LimitSurface(square), 2)).vertex_normals.shape
    (9, 3)
    """
    return _triangles(polygons(x, uv=not isinstance(x, Mesh)))


# --- PyVista


def _pyvista() -> Any:
    try:
        import pyvista
    except ImportError as error:
        raise ImportError('PyVista is needed: pip install "limitsurf[plot]"') from error
    return pyvista


def _dataset_faces(dataset: Any) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Sizes and indices of the polygons of a dataset of PyVista."""
    pyvista = _pyvista()
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
    sizes, indices, _ = vtk_reader.cells(dataset)
    return sizes, indices


def _dataset(shape: Polygons) -> Any:
    """Polygons as a PolyData, split at creases and seams."""
    shape = shape.split()
    cells = np.insert(shape.indices, shape.offsets[:-1], shape.sizes)  # size, vertices, size, ...
    dataset = _pyvista().PolyData(shape.points.copy(), cells)
    if len(shape.normals):
        dataset.point_data["Normals"] = shape.normals
        dataset.point_data.active_normals_name = "Normals"
    if "uv" in shape.channels:
        # in single precision: of others VTK's writer of PLY files would end the process
        dataset.point_data["uv"] = shape.channels["uv"][0].astype(np.float32)
        dataset.GetPointData().SetActiveTCoords("uv")
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


def vtk(shape: Polygons, suffix: str) -> Iterator[bytes]:
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


# --- trimesh


def _of_trimesh(mesh: Any, losses: Losses, *, merge: bool, **tags: Any) -> Mesh:
    """The cage of a Trimesh or a Scene."""
    trimesh = _trimesh()
    if isinstance(mesh, trimesh.Trimesh):
        placed = [(mesh, np.eye(4))]
    elif isinstance(mesh, trimesh.Scene):
        nodes = [mesh.graph[node] for node in mesh.graph.nodes_geometry]
        placed = [(mesh.geometry[name], np.asarray(matrix)) for matrix, name in nodes]
        placed = [(part, matrix) for part, matrix in placed if isinstance(part, trimesh.Trimesh)]
    else:
        raise TypeError(f"need a trimesh.Trimesh or Scene, got {type(mesh).__name__}")
    points, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    textures, rows = [np.zeros((0, 2))], [np.zeros((0, 3), np.int64)]
    for i, (part, matrix) in enumerate(placed):
        triangles = np.asarray(part.faces, dtype=np.int64)
        if np.linalg.det(matrix[:3, :3]) < 0:
            triangles = triangles[:, [0, 2, 1]]  # mirrored, and outwards again
        vertices = np.array(part.vertices, dtype=np.float64)
        if (matrix != np.eye(4)).any():
            finite = np.isfinite(vertices).all(axis=1)  # others stay as the file has them
            vertices[finite] = vertices[finite] @ matrix[:3, :3].T + matrix[:3, 3]
        uv = getattr(part.visual, "uv", None)
        if uv is not None and np.shape(uv) == (len(vertices), 2):
            rows.append(triangles + sum(map(len, textures)))
            textures.append(np.asarray(uv, dtype=np.float64))
        else:
            rows.append(np.full_like(triangles, -1))
            if uv is not None:
                need = f"need {(len(vertices), 2)}"
                text = f"got texture coordinates of shape {np.shape(uv)}, {need}"
                losses.add("uv", f"object {i}", text)
        faces.append(triangles + count)
        points.append(vertices)
        count += len(vertices)
    indices = np.concatenate(faces)
    return mesh_of(
        np.concatenate(points),
        np.full(len(indices), 3),
        indices.ravel(),
        losses,
        uv=np.concatenate(textures) if len(textures) > 1 else None,
        rows=np.concatenate(rows).ravel(),
        merge=merge,
        **tags,
    )


def _trimesh() -> Any:
    try:
        import trimesh
    except ImportError as error:
        raise ImportError('trimesh is needed: pip install "limitsurf[formats]"') from error
    return trimesh


def _triangles(shape: Polygons) -> Any:
    """Polygons as a Trimesh, split at creases and seams."""
    trimesh = _trimesh()
    shape = shape.split()
    visual = None
    if "uv" in shape.channels:
        visual = trimesh.visual.TextureVisuals(uv=shape.channels["uv"][0])
    return trimesh.Trimesh(
        shape.points,
        shape.indices[shape.triangles],
        vertex_normals=shape.normals if len(shape.normals) else None,
        visual=visual,
        process=False,
    )


@contextmanager
def _quiet() -> Iterator[None]:
    """What trimesh logs is left out: what is wrong it raises too."""
    logger = logging.getLogger("trimesh")
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(level)


def read_trimesh(
    name: str, suffix: str, path: str, folder: str | None, *, strict: bool = False
) -> Mesh:
    """The cage of a file that trimesh reads, its objects together, points joined."""
    trimesh = _trimesh()
    with open(path, "rb") as file:
        data = file.read()
    if suffix == ".stl":
        _check_stl(name, data)
    resolver = references.resolver(name, folder) if folder is not None else None
    try:
        _check_archive(name, data)
        with _quiet(), np.errstate(all="ignore"):
            scene = trimesh.load_scene(
                BytesIO(data), file_type=suffix[1:], resolver=resolver, process=False
            )
    except ImportError as error:
        raise ImportError(f'{name}: {error}: pip install "limitsurf[formats]"') from error
    except (MeshError, MemoryError):
        raise
    except Exception as error:  # of whatever type: trimesh checks little of what it reads
        reason = f"{type(error).__name__}: {error}"[:200]
        raise MeshError(f"{name}: trimesh cannot read it, truncated or broken: {reason}") from None
    others, damage = (
        _gltf_others(data) if suffix in (".glb", ".gltf") else (_scene_others(scene), [])
    )
    if not any(len(getattr(part, "faces", ())) for part in scene.geometry.values()):
        besides = f"; it has {', '.join(others)}" if others else ""
        raise MeshError(f"{name}: need at least one triangle, got none{besides}")
    losses = Losses(name, strict)
    for text in damage:
        losses.add(text, "", text)
    losses.left_out(others)
    mesh = _of_trimesh(scene, losses, merge=True, **_measures(suffix, data, scene))
    losses.warn(3)
    return mesh


_MODES = {0: "points", 1: "lines", 2: "lines", 3: "lines", 6: "triangle fans"}  # of glTF


def _gltf_others(data: bytes) -> tuple[list[str], list[str]]:
    """What a glTF file has besides triangles and texture coordinates, and what is wrong there."""
    length = int.from_bytes(data[12:16], "little")
    try:
        found = json.loads(data[20 : 20 + length] if data[:4] == b"glTF" else data)
        parts = [part for mesh in found["meshes"] for part in mesh["primitives"]]
        names = {name for part in parts for name in part["attributes"]}
        others = sorted(names - {"POSITION", "NORMAL", "TEXCOORD_0"})
        others += sorted({_MODES[m] for part in parts if (m := part.get("mode", 4)) in _MODES})
        others += ["targets"] if any("targets" in part for part in parts) else []
        others += [name for name in ("animations", "skins", "cameras") if found.get(name)]
        plain = [{"pbrMetallicRoughness": {}}, {}, {"name": "material_0"}]
        others += ["materials"] if any(x not in plain for x in found.get("materials", ())) else []
        others += ["names of objects"] if len(found["meshes"]) > 1 else []
        damage = {}
        for part in parts:
            count = {name: found["accessors"][i]["count"] for name, i in part["attributes"].items()}
            for name, number in count.items():
                if number != count["POSITION"]:
                    damage[name] = f"got {number} of {name}, need {count['POSITION']}, one a point"
        return others, list(damage.values())
    except (ValueError, LookupError, TypeError, AttributeError):
        return [], []  # trimesh has read it all the same


def _scene_others(scene: Any) -> list[str]:
    """What the parts of a scene have besides triangles and texture coordinates."""
    said: dict[str, None] = {}
    for part in scene.geometry.values():
        visual = getattr(part, "visual", None)
        if not hasattr(part, "faces"):
            said["points and curves"] = None
        elif getattr(visual, "kind", None) in ("vertex", "face"):
            said["colours"] = None
        elif getattr(getattr(visual, "material", None), "name", None):
            said["materials"] = None
        said |= dict.fromkeys(getattr(part, "vertex_attributes", ()))
    if len(scene.geometry) > 1:
        said["names of objects"] = None
    return list(said)


def _measures(suffix: str, data: bytes, scene: Any) -> dict[str, Any]:
    """Units and up axis of a file, as far as its format has them."""
    if suffix == ".zae":  # an archive with a DAE file
        with zipfile.ZipFile(BytesIO(data)) as archive:
            names = [name for name in archive.namelist() if name.lower().endswith(".dae")]
            suffix, data = ".dae", archive.read(names[0]) if names else b""
    if suffix not in MEASURES:
        return {}
    up, units = MEASURES[suffix]
    if suffix == ".dae":
        said = re.search(rb"<up_axis>\s*([XYZ])_UP\s*</up_axis>", data)
        up = said[1].decode().lower() if said else "y"
    if suffix in (".dae", ".3mf") and scene.units is not None:
        with suppress(ValueError, KeyError, TypeError):
            units = _trimesh().units.unit_conversion(scene.units, "meters")
    return {
        "up": up if up in UP else None,
        "units": units if 0 < units < float("inf") else None,
    }


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


def trimesh_bytes(shape: Polygons, suffix: str) -> Iterator[bytes]:
    """The bytes of a file that trimesh writes."""
    mesh = _triangles(shape)
    with _quiet():
        try:
            if suffix == ".gltf":
                from trimesh.exchange.gltf import export_gltf

                files = export_gltf(mesh.scene(), include_normals=True, embed_buffers=True)
                found: Any = files["model.gltf"]
            elif suffix == ".glb":
                found = mesh.export(file_type="glb", include_normals=bool(len(shape.normals)))
            else:
                found = mesh.export(file_type=suffix[1:])
        except ImportError as error:
            raise ImportError(f'{suffix}: {error}: pip install "limitsurf[formats]"') from error
    yield found.encode() if isinstance(found, str) else found


def rounded(suffix: str, points: NDArray[np.float64]) -> NDArray[Any]:
    """Points (V, 3) as a file that trimesh writes keeps them."""
    if suffix == ".3mf":
        return points
    single = points.astype(np.float32)
    # pycollada's own number of digits
    return np.char.mod("%.7g", single).astype(np.float64) if suffix == ".dae" else single


def _check_stl(name: str, data: bytes) -> None:
    """Refuse an STL file that is not whole: trimesh takes what there is of it."""
    size, least = len(data), 84
    number = int.from_bytes(data[80:84], "little")  # of triangles, of 50 bytes each
    if size >= least and size == least + 50 * number:
        return
    solids = list(re.finditer(rb"(?im)^(\xef\xbb\xbf)?[ \t]*solid\b", data))
    if b"\0" not in data:
        if not solids:
            raise MeshError(
                f"{name}: this is no STL file: need 'solid' at the start of a text, or a binary "
                "header"
            )
        if not re.search(rb"(?i)\bendsolid\b", data[solids[-1].end() :]):
            raise MeshError(f"{name}: need 'endsolid' at the end: the file is truncated")
        return
    if size < least:
        raise MeshError(
            f"{name}: need a header of {least} bytes, got {size}: truncated, or no STL file"
        )
    wrong = "truncated, or no STL file" if size < least + 50 * number else "this is no STL file"
    raise MeshError(
        f"{name}: a binary header promises {number} triangles, {least + 50 * number} bytes, "
        f"got {size}: {wrong}"
    )


def _check_beginning(name: str, suffix: str, data: bytes) -> None:
    pattern, need = _BEGINNINGS.get(suffix, (b"", ""))
    if not re.match(pattern, data):
        raise MeshError(f"{name}: need {need} at the start: this is no {suffix} file")


def _check_archive(name: str, data: bytes) -> None:
    """Refuse a ZIP archive that would fill the memory, which trimesh unpacks into it.

    What it holds counts as much as a file that large.
    """
    if not zipfile.is_zipfile(BytesIO(data)):
        return
    limit = _UNPACKED + 64 * len(data)
    with zipfile.ZipFile(BytesIO(data)) as archive:
        members = archive.infolist()
        unpacked = sum(member.file_size for member in members)
        if unpacked > limit:
            raise MeshError(
                f"{name}: an archive of {len(data)} bytes that holds {unpacked}, need {limit} "
                "at most"
            )
        for member in members:
            # of a wrong size one learns by unpacking alone, and in small pieces of these two only
            if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise MeshError(
                    f"{name}: got {member.filename!r} compressed by method {member.compress_type}, "
                    "need members of an archive stored (0) or deflated (8)"
                )
            with archive.open(member) as opened:
                while opened.read(1 << 20):
                    pass
    allow(unpacked)
