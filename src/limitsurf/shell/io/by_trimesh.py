"""Cages and tessellations from and to trimesh, and files that it reads: STL, glTF, 3MF, DAE."""

from __future__ import annotations

import logging
import re
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import BytesIO
from time import process_time
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.checks import MeshError
from limitsurf.cage.mesh import Mesh
from limitsurf.shell.io import dae, gltf, references
from limitsurf.shell.io.apart import A_WHILE, AN_ANSWER, allow
from limitsurf.shell.io.formats import MEASURES
from limitsurf.shell.io.losses import Losses
from limitsurf.shell.io.merge import Merge, checked, joined
from limitsurf.shell.io.polygons import distinct, mesh_of, polygons, tessellated

if TYPE_CHECKING:
    from limitsurf.query import Polygons, Tessellation
    from limitsurf.surface import LimitSurface

GLTF = (".glb", ".gltf")
_UNPACKED = 1 << 26  # bytes of archives unpacked, beside those in proportion to a file


def from_trimesh(mesh: Any, *, merge: Merge = None, **tags: Any) -> Mesh:
    """A cage of the triangles of a ``trimesh.Trimesh``, or of all in a ``trimesh.Scene``.

    Parameters
    ----------
    mesh : trimesh.Trimesh or trimesh.Scene
        The objects of a scene become one mesh, each where its transforms put it; their point
        clouds and curves are ignored. Texture coordinates are the channel "uv", NaN in objects
        without. Names of several objects, and of several materials, are data of faces, "object"
        and "material".
    merge : bool or float, optional
        Whether points of equal coordinates, or no farther apart than a number, become one, as they
        should where they are repeated along seams; trimesh itself merges most of them unless it is
        told ``process=False``. By default they stay.
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
    tolerance = checked(merge)
    found = _of_trimesh(mesh, losses, merge=tolerance is not None, **tags)
    if tolerance:
        found = joined(found, tolerance, losses)
    losses.warn(2)
    return found


def to_trimesh(x: Mesh | Tessellation | LimitSurface, *, n: int | None = None) -> Any:
    """A cage, a tessellation or a surface as a ``trimesh.Trimesh``, of triangles.

    Polygons are cut as those of `Tessellation.triangles`. trimesh processes nothing: points stay as
    they are and where they are.

    Parameters
    ----------
    x : Mesh, Tessellation or LimitSurface
        Of a cage the points and faces, without tags and channels; exact points are rounded to
        float64. A tessellation is split into one normal for each point, its ``vertex_normals``;
        "uv" or else "st" (k, 2) are the ``uv`` of its ``TextureVisuals``. A surface is tessellated
        first.
    n : int, optional
        Of a surface, polygons along each edge of a limit face, as for `tessellate`; 8 by default.

    Returns
    -------
    trimesh.Trimesh

    Raises
    ------
    ValueError
        Points that are not of shape (n_vertices, 3), or a tessellation without polygons; `n` with
        anything but a surface.
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
    shown = tessellated(x, n)
    return _triangles(polygons(shown, uv=not isinstance(shown, Mesh)))


def _of_trimesh(mesh: Any, losses: Losses, *, merge: bool, **tags: Any) -> Mesh:
    """The cage of a Trimesh or a Scene."""
    trimesh = _trimesh()
    if isinstance(mesh, trimesh.Trimesh):
        placed = [(mesh, np.eye(4))]
    elif isinstance(mesh, trimesh.Scene):
        placed = _placed(mesh)
        tags["face_data"] = _names_of_faces(mesh) | (tags.get("face_data") or {})
    else:
        raise TypeError(f"need a trimesh.Trimesh or Scene, got {type(mesh).__name__}")
    points, faces, textures, rows = _soup(placed, losses)
    return mesh_of(
        points,
        np.full(len(faces), 3),
        faces.ravel(),
        losses,
        uv=textures,
        rows=rows.ravel(),
        merge=merge,
        **tags,
    )


def _placed(scene: Any) -> list[tuple[Any, NDArray[Any]]]:
    """The meshes of a scene, each with the matrix (4, 4) that puts it into its place."""
    nodes = [scene.graph[node] for node in _nodes(scene)]
    return [(scene.geometry[name], np.asarray(matrix)) for matrix, name in nodes]


def _nodes(scene: Any) -> list[str]:
    """The nodes of a scene that are meshes."""
    kind = _trimesh().Trimesh
    nodes = scene.graph.nodes_geometry
    return [node for node in nodes if isinstance(scene.geometry[scene.graph[node][1]], kind)]


def _names_of_faces(scene: Any) -> dict[str, NDArray[Any]]:
    """The object and the material of each face, by name, where there are several of either."""
    parents, nodes = scene.graph.transforms.parents, _nodes(scene)
    parts = [scene.geometry[scene.graph[node][1]] for node in nodes]
    objects = []
    for node in map(str, nodes):
        parent = str(parents.get(node, ""))
        # a node of several materials has a child for each, named with six random digits
        child = re.fullmatch(re.escape(parent) + "_[0-9a-f]{6}", node) if parent else None
        objects.append(parent if child else node)
    visuals = [getattr(part.visual, "material", None) for part in parts]
    materials = [str(getattr(visual, "name", None) or "") for visual in visuals]
    found = {"object": objects, "material": materials}
    counts = [len(part.faces) for part in parts]
    return {
        name: np.repeat(np.array(names), counts)
        for name, names in found.items()
        if len(set(names)) > 1
    }


def _soup(
    placed: list[tuple[Any, NDArray[Any]]], losses: Losses
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any] | None, NDArray[Any]]:
    """Points (V, 3) and triangles (m, 3) of meshes; texture coordinates, or None, and their rows.

    The latter are (m, 3), and -1 where there are none.
    """
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
    uv = np.concatenate(textures) if len(textures) > 1 else None
    return np.concatenate(points), np.concatenate(faces), uv, np.concatenate(rows)


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


def read(name: str, suffix: str, path: str, folder: str | None, *, strict: bool = False) -> Mesh:
    """The cage of a file that trimesh reads, its objects together, points joined."""
    _trimesh()  # or who needs it says so
    with open(path, "rb") as file:
        data = file.read()
    if suffix == ".stl":
        _check_stl(name, data)
    if suffix in dae.SUFFIXES:
        return _of_dae(name, data, Losses(name, strict))
    resolver = references.resolver(name, folder) if folder is not None else None
    if suffix in GLTF:
        data = gltf.plain(data, None if resolver is None else resolver.get)
    try:
        return _read(name, suffix, data, resolver, Losses(name, strict))
    except MeshError as error:
        if b"KHR_draco_mesh_compression" in data:
            how = "'gltf-transform copy', or Blender, unpacks it"
            raise MeshError(f"{error}; it is compressed by Draco: {how}") from None
        raise


def _scene(name: str, suffix: str, data: bytes, resolver: Any) -> Any:
    """What trimesh makes of a file, a scene."""
    trimesh = _trimesh()
    try:
        _check_archive(name, data)
        with _quiet(), np.errstate(all="ignore"):
            return trimesh.load_scene(
                BytesIO(data), file_type=suffix[1:], resolver=resolver, process=False
            )
    except ImportError as error:
        raise ImportError(f'{name}: {error}: pip install "limitsurf[formats]"') from error
    except (MeshError, MemoryError):
        raise
    except Exception as error:  # of whatever type: trimesh checks little of what it reads
        reason = f"{type(error).__name__}: {error}"[:200]
        raise MeshError(f"{name}: trimesh cannot read it, truncated or broken: {reason}") from None


def _read(name: str, suffix: str, data: bytes, resolver: Any, losses: Losses) -> Mesh:
    """The cage of the content of a file."""
    scene = _scene(name, suffix, data, resolver)
    others, damage = gltf.others(data) if suffix in GLTF else (_scene_others(scene), [])
    if not any(len(getattr(part, "faces", ())) for part in scene.geometry.values()):
        besides = f"; it has {', '.join(others)}" if others else ""
        raise MeshError(f"{name}: need at least one triangle, got none{besides}")
    for text in damage:
        losses.add(text, "", text)
    losses.left_out(others)
    mesh = _of_trimesh(scene, losses, merge=True, **_measures(suffix, scene))
    losses.warn(3)
    return mesh


def frames(
    name: str,
    suffix: str,
    path: str,
    folder: str | None,
    *,
    prim: str | None = None,
    times: list[float] | None = None,
) -> dict[str, Any]:
    """The first frames of the animation of a glTF file, as `usd.frames` has them."""
    if prim is not None:
        raise ValueError(f"{name}: got prim {prim!r}, but only a USD file has some")
    with open(path, "rb") as opened:
        data = opened.read()
    resolver = references.resolver(name, folder) if folder is not None else None
    resolved = None if resolver is None else resolver.get
    losses = Losses(name, strict=False)
    rest = gltf.plain(data, resolved)
    mesh = _read(name, suffix, rest, resolver, losses)
    try:
        file = gltf.File(gltf.plain(data, resolved, at_rest=False), resolved)
        moves, known, others = gltf.animation(file)
        if others:
            text = f"only the first animation is read, left out: {', '.join(others)}"
            losses.note("animations", "", text)
        times = known or [0.0] if times is None else times
        at_rest, *_ = _soup(_placed(_scene(name, suffix, rest, resolver)), losses)
        first, _ = distinct(at_rest)  # of points that are joined the first one moves all
        first = first if len(first) < len(at_rest) else np.arange(len(at_rest))
        points: list[NDArray[np.float64]] = []
        begun, size = process_time(), 0
        for time in times:
            scene = _scene(name, suffix, gltf.posed(file, moves, time), resolver)
            moved, *_ = _soup(_placed(scene), Losses(name, strict=False))
            points.append(moved[first])
            size += points[-1].nbytes
            if size > AN_ANSWER or process_time() - begun > A_WHILE:
                break
    except gltf.BROKEN as error:
        if isinstance(error, MeshError):
            raise
        reason = f"{type(error).__name__}: {error}"[:200]
        raise MeshError(f"{name}: its animation is broken: {reason}") from None
    losses.warn(3)
    return {"times": times, "points": points, "sizes": mesh.sizes, "indices": mesh.indices}


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
    return list(said)


def _of_dae(name: str, data: bytes, losses: Losses) -> Mesh:
    try:
        _check_archive(name, data)
        mesh = dae.read(name, data, losses)
    except ImportError as error:
        raise ImportError(f'{name}: {error}: pip install "limitsurf[formats]"') from error
    except zipfile.BadZipFile as error:
        text = f"{name}: pycollada cannot read it, truncated or broken: BadZipFile: {error}"
        raise MeshError(text) from None
    losses.warn(4)
    return mesh


def _measures(suffix: str, scene: Any) -> dict[str, Any]:
    """Units and up axis of a file, as far as its format has them."""
    if suffix not in MEASURES:
        return {}
    up, units = MEASURES[suffix]
    if suffix == ".3mf" and scene.units is not None:
        with suppress(ValueError, KeyError, TypeError):
            units = _trimesh().units.unit_conversion(scene.units, "meters")
    return {"up": up, "units": units if 0 < units < float("inf") else None}


def content(shape: Polygons, suffix: str) -> Iterator[bytes]:
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
