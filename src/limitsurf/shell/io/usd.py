"""Cages from and to USD files, as meshes of UsdGeom; ``io`` says what of them is kept."""

from __future__ import annotations

import os
import re
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import accumulate
from time import process_time
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.checks import MeshError, users_level
from limitsurf.cage.mesh import Mesh
from limitsurf.shell.io.apart import A_WHILE, AN_ANSWER
from limitsurf.shell.io.losses import LocatedError, Losses, listed
from limitsurf.shell.io.parts import DEFAULTS, MIXED, Part, merged
from limitsurf.shell.io.polygons import IntArray, float_points, polygons

if TYPE_CHECKING:
    from limitsurf.query import Tessellation

try:
    from pxr import Sdf, Tf, Usd, UsdGeom, UsdUtils, Vt
except ImportError as error:
    raise ImportError('usd-core is needed for USD files: pip install "limitsurf[usd]"') from error

from limitsurf.shell.io.usd_faces import write_data
from limitsurf.shell.io.usd_reader import (
    CHOICES,
    CREASING_NOTE,
    LINEAR,
    OF_POINTS,
    Reader,
)
from limitsurf.shell.io.usd_scene import Traversal
from limitsurf.shell.io.usd_values import one_line

PRIM = "/mesh"  # what a file of ours calls its mesh
UP = {"Y": "y", "Z": "z"}
# attributes that are points, or place them
_MOVING = ("points", "positions", "orientations", "scales")
VALUES = {  # of a primvar, by the shape of one
    (): (Sdf.ValueTypeNames.FloatArray, Vt.FloatArray),
    (2,): (Sdf.ValueTypeNames.TexCoord2fArray, Vt.Vec2fArray),
    (3,): (Sdf.ValueTypeNames.Float3Array, Vt.Vec3fArray),
    (4,): (Sdf.ValueTypeNames.Float4Array, Vt.Vec4fArray),
}


def read(
    name: str,
    file: str,
    *,
    prim: str | None = None,
    time: float | None = None,
    strict: bool = False,
) -> Mesh:
    """The mesh, or all meshes as one, of a stage or of what is at or below the prim of a path.

    `name` is that of the file for messages. USD hands out a layer that is open already as it is:
    this is called in a process of its own.
    """
    losses = Losses(name, strict)
    code = Usd.TimeCode.EarliestTime() if time is None else Usd.TimeCode(time)
    with _opened(losses, file) as stage:
        mesh = _scene_mesh(stage, prim, code, losses)
    losses.warn(stacklevel=3)
    return mesh


@contextmanager
def _opened(losses: Losses, file: str) -> Iterator[Any]:
    """A stage for as long as the block lasts, and what USD says of it and of all that is done."""
    name = losses.name
    # In its place of stderr, for as long as it lives.
    diagnostics = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        yield Usd.Stage.Open(os.path.abspath(file))
    except Tf.ErrorException as error:
        said = one_line(error.args[0])
        at = re.search(r":(\d+):\d+: ", said)
        place = f"{name}, line {at[1]}: {said[at.end() :]}" if at else f"{name}: {said}"
        raise MeshError(place) from None
    finally:
        complaints = [one_line(found) for found in diagnostics.TakeUncoalescedDiagnostics()]
        if not losses.strict:
            for text in _alike(complaints):
                warnings.warn(f"{name}: {text}", stacklevel=4)
    if complaints and losses.strict:
        raise MeshError(f"{name}: {complaints[0]}")


def _alike(complaints: list[str]) -> list[str]:
    """Of messages that differ in prims alone the first, and how many more there are."""
    found: dict[str, list[str]] = {}
    for text in complaints:
        found.setdefault(re.sub(r"<[^>]*>", "<>", text), []).append(text)
    return [
        first if not others else f"{first} ({len(others)} more like it)"
        for first, *others in found.values()
    ]


def schemes(
    name: str, file: str, *, prim: str | None = None, time: float | None = None
) -> dict[str, str]:
    """The scheme of each mesh that `read` makes one of, by its path."""
    losses = Losses(name, strict=False)
    code = Usd.TimeCode.EarliestTime() if time is None else Usd.TimeCode(time)
    diagnostics = UsdUtils.CoalescingDiagnosticDelegate()
    stage = Usd.Stage.Open(os.path.abspath(file))  # without which its prims expire
    scene = _shown(stage, prim, code, losses)
    readers = [Reader(found, code, losses) for found, _ in scene.placed]
    diagnostics.TakeUncoalescedDiagnostics()  # which `read` has told
    return {x.path: x.choice(*CHOICES["scheme"]) or DEFAULTS["scheme"] for x in readers}


def frames(
    name: str,
    file: str,
    *,
    prim: str | None = None,
    times: list[float] | None = None,
) -> dict[str, Any]:
    """The first frames of an animation, as many as one answer holds, from one stage.

    These are ``points`` of the first of ``times``, which are given or else all that there are, and
    the ``sizes`` and ``indices`` of their faces. They end before a frame whose faces are others, or
    which is broken, if it is not the first.
    """
    losses = Losses(name, strict=False)
    known: dict[str, tuple[Mesh, bool]] = {}
    points: list[NDArray[np.float64]] = []
    with _opened(losses, file) as stage:
        if times is None:
            times = _times(stage, prim, losses) or [0.0]
        begun, size = process_time(), 0
        first: tuple[IntArray, IntArray] | None = None
        for time in times:
            code = Usd.TimeCode(time)
            told = losses if first is None else Losses(name, strict=False)
            try:
                parts = _parts(stage, prim, code, told, known)
            except MeshError:
                if first is None:
                    raise
                break
            faces = _faces(parts)
            if first is None:
                first = faces
            elif not all(map(np.array_equal, faces, first)):
                break
            points.append(np.concatenate([part.points for part in parts]))
            size += points[-1].nbytes
            if size > AN_ANSWER or process_time() - begun > A_WHILE:
                break
    losses.warn(stacklevel=3)
    sizes, indices = first or (np.zeros(0, np.int64), np.zeros(0, np.int64))
    return {"times": times, "points": points, "sizes": sizes, "indices": indices}


def _faces(parts: list[Part]) -> tuple[IntArray, IntArray]:
    """Sizes and corners of the faces of all parts together."""
    first = [0, *accumulate(len(part.points) for part in parts)]
    indices = [part.indices + n for part, n in zip(parts, first, strict=False)]
    return np.concatenate([part.sizes for part in parts]), np.concatenate(indices)


def _times(stage: Any, prim: str | None, losses: Losses) -> list[float]:
    """The frames at which points or transforms of what `read` reads are given, ascending."""
    found: set[float] = set()
    seen: set[Any] = set()
    scene = _shown(stage, prim, Usd.TimeCode.EarliestTime(), losses)
    for each, _ in scene.placed:
        while each and each.GetPath() not in seen:
            seen.add(each.GetPath())
            for attribute in each.GetAuthoredAttributes():
                name = attribute.GetName()
                if name in _MOVING or name.startswith("xformOp:"):
                    found.update(attribute.GetTimeSamples())
            each = each.GetParent()
    return sorted(found)


def _shown(stage: Any, path: str | None, time: Any, losses: Losses) -> Traversal:
    """What is shown of a stage, or at or below a path; ValueError if there is no such path."""
    scene = Traversal(time, losses)
    root = stage.GetPseudoRoot()
    if path is not None:
        root = stage.GetPrimAtPath(path) if Sdf.Path.IsValidPathString(path) else None
        if not root:
            scene.add(stage.GetPseudoRoot())
            paths = list(dict.fromkeys(str(prim.GetPath()) for prim, _ in scene.placed))
            known = ", ".join(paths[:6]) + (", ..." if len(paths) > 6 else "")
            raise ValueError(f"{losses.name}: there is no prim {path!r}; its meshes are {known}")
    scene.add(root)
    return scene


def _scene_mesh(stage: Any, path: str | None, time: Any, losses: Losses) -> Mesh:
    """All that is shown of a stage, or at or below a path, as one mesh."""
    return merged(_parts(stage, path, time, losses), losses, **_measures(stage, losses))


def _parts(
    stage: Any,
    path: str | None,
    time: Any,
    losses: Losses,
    known: dict[str, tuple[Mesh, bool]] | None = None,
) -> list[Part]:
    """All meshes that are shown of a stage, or at or below a path.

    Those that are `known` by their path, from another time, are but moved where that is all that
    changes; others become known.
    """
    name, scene = losses.name, _shown(stage, path, time, losses)
    if not scene.placed:
        place = "in the stage" if path is None else f"at or below {path}"
        text = f"{name}: need a mesh of UsdGeom, found none that is shown {place}"
        raise MeshError("; ".join([text, *losses.messages()]))
    scene.reserve_memory()
    parts, others = [], scene.others
    read: dict[str, tuple[Mesh, bool]] = {}
    broken: dict[str, str] = {}
    for prim, matrices in scene.placed:
        reader = Reader(prim, time, losses)
        try:
            if reader.path not in read:
                before = None if known is None else known.get(reader.path)
                moved = None if before is None else reader.moved(before[0])
                read[reader.path] = moved or reader.mesh(), reader.is_left_handed()
                for what in reader.left_out:
                    others.setdefault(what, []).append(reader.path)
            parts.append(Part.of(reader.path, *read[reader.path], matrices))
        except LocatedError:
            raise
        except (MeshError, Tf.ErrorException) as error:
            broken[reader.path] = one_line(error.args[0])
    if not parts:
        where = next(iter(broken))
        more = f"; {len(broken) - 1} more meshes are broken" if len(broken) > 1 else ""
        raise MeshError(f"{name}, {where}: {broken[where]}{more}")
    for where, reason in broken.items():
        losses.add("mesh", where, reason, "the mesh is left out")
    if others:
        kinds = [f"{kind} ({listed(paths)})" for kind, paths in sorted(others.items())]
        losses.note("others", "", f"a cage has no place for all, left out: {', '.join(kinds)}")
    if known is not None:
        known.update(read)
    return parts


def _measures(stage: Any, losses: Losses) -> dict[str, Any]:
    """Units and up axis of a stage, None where the file says nothing of them."""
    found: dict[str, Any] = {}
    if stage.HasAuthoredMetadata(UsdGeom.Tokens.metersPerUnit):
        units = stage.GetMetadata(UsdGeom.Tokens.metersPerUnit)  # of any type, in old files
        if isinstance(units, (int, float)) and 0 < units < float("inf"):
            # of single precision the shortest decimal, 0.01 and not 0.009999999776482582
            with np.errstate(over="ignore", under="ignore"):
                single = np.float32(units)
            found["units"] = float(str(single) if float(single) == units else units)
        else:
            losses.add("units", "", f"metersPerUnit: got {units}, need a positive number")
    if stage.HasAuthoredMetadata(UsdGeom.Tokens.upAxis):
        axis = str(stage.GetMetadata(UsdGeom.Tokens.upAxis))
        if axis in UP:
            found["up"] = UP[axis]
        else:
            losses.add("up", "", f"upAxis: got {axis!r}, need 'Y' or 'Z'")
    return found


def content(x: Mesh | Tessellation, suffix: str) -> Iterator[bytes]:
    """The bytes of a file with the mesh as the one prim of a stage, in the format of the suffix."""
    stage = Usd.Stage.CreateInMemory()
    if isinstance(x, Mesh):
        _define(stage, x)
    else:
        shape = polygons(x)
        channels = {name: (*channel, "corners_plus1") for name, channel in x.channels.items()}
        faces = shape.sizes, shape.indices
        geom = _define(
            stage,
            Mesh(
                shape.points,
                faces,
                scheme="none",
                channels=channels,
                face_data=x.face_data,
                units=x.units,
                up=x.up,
            ),
        )
        if len(shape.normals):
            normals = shape.normals[shape.normal_indices].astype(np.float32)
            geom.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(normals))
            geom.SetNormalsInterpolation(UsdGeom.Tokens.faceVarying)
    # USD takes the format from a name, and writes to no open file.
    with tempfile.TemporaryDirectory() as folder:
        whole = os.path.join(folder, f"mesh{suffix}")
        try:
            stage.GetRootLayer().Export(whole)
        except Tf.ErrorException as error:
            raise OSError(one_line(error.args[0])) from None
        with open(whole, "rb") as source:
            content = source.read()
    return iter([content])


def _define(stage: Any, mesh: Mesh) -> Any:
    """The mesh as a prim, which is returned; what USD cannot hold raises."""
    geom = UsdGeom.Mesh.Define(stage, PRIM)
    prim = geom.GetPrim()
    stage.SetDefaultPrim(prim)
    points = _single(float_points(mesh), "a coordinate")
    geom.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    geom.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([points.min(0), points.max(0)])))
    geom.CreateFaceVertexCountsAttr(_integers(mesh.sizes))
    geom.CreateFaceVertexIndicesAttr(_integers(mesh.indices))
    edges, sharpness = mesh.creases
    if len(edges):
        geom.CreateCreaseIndicesAttr(_integers(edges.ravel()))
        geom.CreateCreaseLengthsAttr(_integers(np.full(len(edges), 2)))
        geom.CreateCreaseSharpnessesAttr(_sharpness(sharpness))
    vertices, sharpness = mesh.corners
    if len(vertices):
        geom.CreateCornerIndicesAttr(_integers(vertices))
        geom.CreateCornerSharpnessesAttr(_sharpness(sharpness))
    if len(mesh.holes):
        geom.CreateHoleIndicesAttr(_integers(mesh.holes))
    for option, (attribute, meanings) in CHOICES.items():
        value = getattr(mesh, option)
        if option == "scheme" and value == MIXED:
            text = "its meshes are of several schemes, which one mesh cannot be: written as 'none'"
            warnings.warn(text, stacklevel=users_level())
            value = "none"
        _choose(prim, option, attribute, meanings, value)
    if mesh.creasing is not None:
        prim.SetCustomDataByKey(CREASING_NOTE, mesh.creasing)
    if mesh.units is not None:
        UsdGeom.SetStageMetersPerUnit(stage, mesh.units)
    if mesh.up is not None:
        UsdGeom.SetStageUpAxis(stage, mesh.up.upper())
    modes = {}
    for name in mesh.channels:
        if _add_primvar(prim, mesh, name) == "faceVarying":
            modes[name] = mesh.channels[name][2]
    mode = next(iter(modes.values()), None)
    if len(set(modes.values())) > 1:
        text = f"channels: a USD mesh holds one interpolation for all its seams, got {modes}"
        warnings.warn(f"{text}: written as {mode!r}", stacklevel=users_level())
    _choose(prim, "interpolation", *LINEAR, mode)
    write_data(geom, mesh)
    return geom


def _choose(prim: Any, what: str, attribute: str, meanings: dict[str, str], value: Any) -> None:
    if value is None:
        return
    tokens = [token for token, meaning in meanings.items() if meaning == value]
    if not tokens:
        known = ", ".join(map(repr, meanings.values()))
        raise ValueError(f"{what}: a USD file holds one of {known}, got {value!r}")
    prim.GetAttribute(attribute).Set(tokens[0])


def _add_primvar(prim: Any, mesh: Mesh, name: str) -> str:
    """The primvar of a channel, and its interpolation in the terms of USD."""
    values, rows, mode = mesh.channels[name]
    is_name = Sdf.Path.IsValidNamespacedIdentifier(name) and UsdGeom.Primvar.IsValidPrimvarName(
        f"primvars:{name}"
    )
    if values.shape[1:] not in VALUES or not is_name:
        raise ValueError(
            f"channel {name!r} of shape {values.shape}: a USD file holds channels of shape (k,), "
            "(k, 2), (k, 3) or (k, 4), whose names are identifiers"
        )
    kind, array = VALUES[values.shape[1:]]
    declared = prim.GetAttribute(f"primvars:{name}").GetTypeName()
    if declared and declared.type != kind.type:
        raise ValueError(f"channel {name!r} of shape {values.shape}: in USD it is {declared}")
    interpolation = "faceVarying"
    if len(values) == mesh.n_vertices and np.array_equal(rows, mesh.indices):
        of_points = {meaning: token for token, meaning in OF_POINTS.items()}
        interpolation = of_points.get(mode, interpolation)
    primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(name, declared or kind, interpolation)
    primvar.Set(array.FromNumpy(_single(values, f"channel {name!r}: a value")))
    if interpolation == "faceVarying":
        primvar.SetIndices(_integers(rows))
    return interpolation


def _single(values: NDArray[Any], what: str) -> NDArray[np.float32]:
    """Numbers in the precision of USD's points, none of them infinite."""
    try:
        with np.errstate(over="ignore"):
            single = values.astype(np.float64).astype(np.float32)
    except OverflowError:
        single = np.full(1, np.inf, dtype=np.float32)
    if np.isinf(single).any():
        raise ValueError(f"{what} is beyond float32, in which a USD file keeps it")
    return single


def _sharpness(values: NDArray[Any]) -> Any:
    """Sharpness in single precision; what is below 10, where it becomes infinite, stays so."""
    with np.errstate(over="ignore"):
        single = np.minimum(values, 1e300).astype(np.float64).astype(np.float32)
    below = (values < 10).astype(bool) & (single >= 10)
    single[below] = np.nextafter(np.float32(10), np.float32(0))
    return Vt.FloatArray.FromNumpy(single)


def _integers(values: IntArray) -> Any:
    return Vt.IntArray.FromNumpy(values.astype(np.int32))
