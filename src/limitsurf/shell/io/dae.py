"""Cages from COLLADA files (``.dae``, and ``.zae``, archives of them), with their polygons."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator
from io import BytesIO
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.checks import MeshError
from limitsurf.cage.mesh import UP, Mesh
from limitsurf.shell.io.losses import Losses
from limitsurf.shell.io.parts import reversed_corners
from limitsurf.shell.io.polygons import mesh_of

SUFFIXES = (".dae", ".zae")
# elements that are no shapes, and what is said of them
_LEFT_OUT = {
    "library_materials": "materials",
    "library_animations": "animations",
    "library_cameras": "cameras",
    "library_lights": "lights",
} | dict.fromkeys(
    ("library_effects", "library_images", "bind_material", "instance_camera", "instance_light",
     "library_animation_clips", "library_physics_models", "library_physics_scenes"), ""
)  # fmt: skip
_NUMBERS = ("float_array", "translate", "rotate", "scale", "matrix", "lookat")
_NO_NUMBER = re.compile(r"[+-]?\d*\.#\w+")  # as in -1.#IND00


def read(name: str, data: bytes, losses: Losses) -> Mesh:
    """The cage of all that the scene of a file shows, points joined."""
    import collada

    try:
        with np.errstate(all="ignore"):
            data, others = _shapes(data)
            file = collada.Collada(BytesIO(data), ignore=[collada.common.DaeError])
            found = list(_shown(file))
    except MemoryError:
        raise
    except Exception as error:  # of whatever type: it checks little of what it reads
        reason = f"{type(error).__name__}: {error}"[:200]
        text = f"{name}: pycollada cannot read it, truncated or broken: {reason}"
        raise MeshError(text) from None
    if file.errors:
        more = f"; {len(file.errors) - 1} more like it" if len(file.errors) > 1 else ""
        losses.add("collada", "", f"pycollada says {str(file.errors[0])[:200]}{more}")
    others += ["lines"] * any(isinstance(shape, str) for _, shape in found)
    polygons = [(title, shape) for title, shape in found if not isinstance(shape, str)]
    if not polygons:
        besides = f"; it has {', '.join(others)}" if others else ""
        raise MeshError(f"{name}: need at least one polygon in its scene, found none{besides}")
    losses.left_out(others)
    return _joined(polygons, losses, **_measures(file))


def _shapes(data: bytes) -> tuple[bytes, list[str]]:
    """A file without what is no shape, and what that is: mistakes there cost no shapes then."""
    if zipfile.is_zipfile(BytesIO(data)):
        with zipfile.ZipFile(BytesIO(data)) as archive:
            data = archive.read(next(x for x in archive.namelist() if x.lower().endswith(".dae")))
    root = ElementTree.fromstring(data)
    found: dict[str, None] = {}
    for parent in list(root.iter()):
        for child in list(parent):
            name = str(child.tag).rpartition("}")[2]
            if name in _LEFT_OUT:
                found |= dict.fromkeys(_LEFT_OUT[name].split() if len(child) else ())
                parent.remove(child)
            elif name in _NUMBERS and child.text:
                if "." not in child.text:  # a comma is the point of some
                    child.text = child.text.replace(",", ".")
                child.text = _NO_NUMBER.sub("nan", child.text)
    return ElementTree.tostring(root), list(found)


def _measures(file: Any) -> dict[str, Any]:
    units = file.assetInfo.unitmeter
    up = str(file.assetInfo.upaxis)[:1].lower()
    return {
        "up": up if up in UP else None,
        "units": 1.0 if units is None else units if 0 < units < float("inf") else None,
    }


def _shown(file: Any) -> Iterator[tuple[str, Any]]:
    """The primitives in a scene, each with the name of its object: polygons, or what else it is."""
    import collada

    scene = file.scene
    skinned = [x.geometry for x in scene.objects("controller")] if scene else []
    for bound in [*scene.objects("geometry"), *skinned] if scene else ():
        title = bound.original.name or bound.original.id or ""
        for x in bound.primitives():
            if isinstance(x, collada.lineset.BoundLineSet):
                yield title, "lines"
                continue
            indices = np.asarray(x.vertex_index, np.int64)
            if x.vertex is None or not indices.size:
                continue
            is_list = hasattr(x, "polyindex")
            sizes = np.diff(x.polyindex, axis=1)[:, 0] if is_list else np.full(len(indices), 3)
            uv, rows = None, np.full(indices.size, -1)
            if len(x.texcoordset) and len(x.texcoordset[0]):
                uv = np.asarray(x.texcoordset[0], np.float64)[:, :2]
                rows = np.asarray(x.texcoord_indexset[0], np.int64).ravel()
            points = np.asarray(x.vertex, np.float64)
            yield title, (points, sizes, indices.ravel(), uv, rows, np.linalg.det(bound.matrix) < 0)


def _joined(polygons: list[tuple[str, Any]], losses: Losses, **tags: Any) -> Mesh:
    """One mesh of all polygons, and of which object each is if there are several."""
    points: list[NDArray[Any]] = []
    textures: list[NDArray[Any]] = [np.zeros((0, 2))]
    corners, places, sizes, titles = [], [], [], []
    n_points = n_rows = 0
    for title, (own, counts, indices, uv, rows, mirrored) in polygons:
        order = reversed_corners(counts) if mirrored else slice(None)
        corners.append(indices[order] + n_points)
        places.append(np.where(rows < 0, -1, rows + n_rows)[order])
        sizes.append(counts)
        points.append(own)
        n_points += len(own)
        if uv is not None:
            textures.append(uv)
            n_rows += len(uv)
        titles.append(np.full(len(counts), title))
    if len({title for title, _ in polygons}) > 1:
        tags["face_data"] = {"object": np.concatenate(titles)}
    return mesh_of(
        np.concatenate(points),
        np.concatenate(sizes),
        np.concatenate(corners),
        losses,
        uv=np.concatenate(textures) if len(textures) > 1 else None,
        rows=np.concatenate(places),
        merge=True,
        **tags,
    )
