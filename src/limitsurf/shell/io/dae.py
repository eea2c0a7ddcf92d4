"""Cages from COLLADA files (``.dae``, and ``.zae``, archives of them), with their polygons."""

from __future__ import annotations

from collections.abc import Iterator
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.checks import MeshError
from limitsurf.cage.mesh import UP, Mesh
from limitsurf.shell.io.losses import Losses
from limitsurf.shell.io.parts import reversed_corners
from limitsurf.shell.io.polygons import mesh_of

SUFFIXES = (".dae", ".zae")


def read(name: str, data: bytes, losses: Losses) -> Mesh:
    """The cage of all that the scene of a file shows, points joined."""
    import collada

    try:
        with np.errstate(all="ignore"):
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
    others = [kind for kind in ("lines", "points") if any(kind == x[1] for x in found)]
    polygons = [(title, shape) for title, shape in found if not isinstance(shape, str)]
    if not polygons:
        besides = f"; it has {', '.join(others)}" if others else ""
        raise MeshError(f"{name}: need at least one polygon in its scene, found none{besides}")
    others += ["materials"] * bool(len(file.materials)) + ["animations"] * bool(file.animations)
    losses.left_out(others)
    return _joined(polygons, losses, **_measures(file))


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

    for bound in file.scene.objects("geometry") if file.scene else ():
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
