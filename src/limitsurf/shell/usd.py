"""Cages from and to USD files, as meshes of UsdGeom; ``io`` says what of them is kept."""

from __future__ import annotations

import os
import re
import tempfile
import warnings
from collections.abc import Iterator
from itertools import accumulate
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from limitsurf.mesh import INTERPOLATION, Mesh, MeshError
from limitsurf.shell.polygons import IntArray, float_points, polygons

if TYPE_CHECKING:
    from limitsurf.query import Tessellation

try:
    from pxr import Sdf, Tf, Usd, UsdGeom, UsdUtils, Vt
except ImportError as error:
    raise ImportError('usd-core is needed for USD files: pip install "limitsurf[usd]"') from error

# For each of our choices USD's attribute, and the meanings of its tokens; first the one that holds
# where a file says nothing.
CHOICES = {
    "scheme": (
        "subdivisionScheme",
        {
            "catmullClark": "catmull-clark",
            "loop": "loop",
            "bilinear": "bilinear",
            "none": "none",
        },
    ),
    "boundary": (
        "interpolateBoundary",
        {"edgeAndCorner": "edge_and_corner", "edgeOnly": "edge_only", "none": "none"},
    ),
    "triangles": (
        "triangleSubdivisionRule",
        {"catmullClark": "catmull-clark", "smooth": "smooth"},
    ),
}
TOKENS = ("none", "cornersOnly", "cornersPlus1", "cornersPlus2", "boundaries", "all")
LINEAR = ("faceVaryingLinearInterpolation", dict(zip(TOKENS, INTERPOLATION, strict=True)))
ORIENTATION = ("orientation", {"rightHanded": "", "leftHanded": "reversed"})
# USD knows one way of creasing, "uniform": ours is a note that other programs pass over.
CREASING = "limitsurf:creasing"
PRIM = "/mesh"  # what a file of ours calls its mesh
TIME = Usd.TimeCode.EarliestTime()
VALUES = {  # of a primvar, by the shape of one
    (): (Sdf.ValueTypeNames.FloatArray, Vt.FloatArray),
    (2,): (Sdf.ValueTypeNames.TexCoord2fArray, Vt.Vec2fArray),
    (3,): (Sdf.ValueTypeNames.Float3Array, Vt.Vec3fArray),
    (4,): (Sdf.ValueTypeNames.Float4Array, Vt.Vec4fArray),
}
# What primvars with a value for each point are as face-varying ones: without seams, "none" is as
# smooth as the points, with their creases and corners.
OF_POINTS = {"vertex": "none", "varying": "all"}


def read(name: str, path: str | None, file: str) -> Mesh:
    """The mesh, or all meshes as one, of a stage or of what is at or below the prim of a path.

    `name` is that of the file for messages. USD hands out a layer that is open already as it is:
    this is called in a process of its own.
    """
    # In its place of stderr, for as long as it lives.
    diagnostics = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        stage = Usd.Stage.Open(os.path.abspath(file))
        return _merged(name, [_Reader(name, prim) for prim in _found(name, stage, path)])
    except Tf.ErrorException as error:
        said = _plain(error.args[0])
        at = re.search(r":(\d+):\d+: ", said)
        place = f"{name}, line {at[1]}: {said[at.end() :]}" if at else f"{name}: {said}"
        raise MeshError(place) from None
    finally:
        for diagnostic in diagnostics.TakeUncoalescedDiagnostics():
            warnings.warn(f"{name}: {_plain(diagnostic)}", stacklevel=3)


def _plain(diagnostic: Any) -> str:
    """What USD says, in one line and without what only its programmers understand."""
    internal = (
        r":SDF_FORMAT_ARGS:\w+=\w+| matching \w+::.*?(?= at ')| \(instantiating stage [^)]*\)"
    )
    try:
        said = diagnostic.commentary
    except UnicodeDecodeError as error:
        said = error.object.decode(errors="backslashreplace")
    return " ".join(re.sub(internal, "", said).split())


def _found(name: str, stage: Any, path: str | None) -> list[Any]:
    """The meshes of a stage that are shown, or those at or below a path."""
    root = stage.GetPseudoRoot()
    if path is not None:
        root = stage.GetPrimAtPath(path) if Sdf.Path.IsValidPathString(path) else None
        if not root:
            paths = [str(prim.GetPath()) for prim in _found(name, stage, None)]
            listed = ", ".join(paths[:6]) + (", ..." if len(paths) > 6 else "")
            raise ValueError(f"{name}: there is no prim {path!r}; its meshes are {listed}")
    found = []
    prims = iter(Usd.PrimRange(root, Usd.TraverseInstanceProxies()))
    for prim in prims:
        if prim.IsA(UsdGeom.PointInstancer):
            prims.PruneChildren()  # its prototypes, which are nowhere themselves
        elif prim.IsA(UsdGeom.Mesh) and (prim == root or _is_shown(prim)):
            found.append(prim)
    if not found:
        place = "in the stage" if path is None else f"at or below {path}"
        raise MeshError(f"{name}: need a mesh of UsdGeom, found none that is shown {place}")
    return found


def _is_shown(prim: Any) -> bool:
    image = UsdGeom.Imageable(prim)
    visible = image.ComputeVisibility(TIME) != UsdGeom.Tokens.invisible
    return visible and image.ComputePurpose() not in (UsdGeom.Tokens.proxy, UsdGeom.Tokens.guide)


class _Reader:
    """A mesh of a stage at its earliest time; what is wrong with it raises an error naming it."""

    def __init__(self, name: str, prim: Any) -> None:
        self.prim = prim
        self.path = str(prim.GetPath())
        self.where = f"{name}, {self.path}"

    def fail(self, message: str) -> NoReturn:
        raise MeshError(f"{self.where}: {message}")

    def array(self, attribute: str, kind: str, shape: tuple[int, ...] = ()) -> NDArray[Any]:
        """The numbers of an attribute, (n, *shape): integers ("i") or floats; none without it."""
        dtype = np.int64 if kind == "i" else np.float64
        value = self.prim.GetAttribute(attribute).Get(TIME)
        if value is None:
            return np.zeros((0, *shape), dtype)
        array = np.array(value)
        if array.dtype.kind != kind or array.ndim == 0 or array.shape[1:] != shape:
            need = self.prim.GetAttribute(attribute).GetTypeName()
            self.fail(f"{attribute}: got {type(value).__name__}, need {need}")
        return array.astype(dtype)

    def choice(self, attribute: str, meanings: dict[str, str]) -> str | None:
        """What the token of an attribute means, None where the file has none."""
        if not self.prim.GetAttribute(attribute).HasAuthoredValue():
            return None
        token = self.prim.GetAttribute(attribute).Get(TIME)
        if not isinstance(token, str) or token not in meanings:
            self.fail(f"{attribute}: got {token!r}, need one of {', '.join(meanings)}")
        return meanings[token]

    def mesh(self) -> Mesh:
        """In the coordinates of the stage."""
        points = self.array("points", "f", (3,))
        sizes, indices = self.faces()
        if len(points) == 0:
            self.fail("need at least one of its points, got none")
        options: dict[str, Any] = {option: self.choice(*CHOICES[option]) for option in CHOICES}
        channels = dict(self.channels(len(points), indices))
        to_world = np.array(UsdGeom.Imageable(self.prim).ComputeLocalToWorldTransform(TIME))
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused
            mirrored = np.linalg.slogdet(to_world[:3, :3]).sign < 0
            if (to_world != np.eye(4)).any():
                points = points @ to_world[:3, :3] + to_world[3, :3]
        if mirrored != (self.choice(*ORIENTATION) == "reversed"):
            order = _reversed_faces(sizes)
            indices = indices[order]
            channels = {
                name: (values, rows[order], mode) for name, (values, rows, mode) in channels.items()
            }
        tags = {
            "creases": self.creases(),
            "corners": self.corners(),
            "holes": np.unique(self.array("holeIndices", "i")),
            "creasing": self.prim.GetCustomDataByKey(CREASING),
        }
        try:
            return Mesh(points, (sizes, indices), channels=channels, **tags, **options)
        except ValueError as error:
            self.fail(str(error))

    def faces(self) -> tuple[IntArray, IntArray]:
        """Sizes and indices that fit together."""
        sizes, indices = self.array("faceVertexCounts", "i"), self.array("faceVertexIndices", "i")
        if len(sizes) == 0:
            self.fail("need at least one of its faceVertexCounts, got none")
        small = np.flatnonzero(sizes < 3)
        if len(small):
            self.fail(f"face {small[0]} has {sizes[small[0]]} corners, need three or more")
        if sizes.sum() != len(indices):
            self.fail(
                f"faceVertexCounts add up to {sizes.sum()}, but there are {len(indices)} "
                "faceVertexIndices"
            )
        return sizes, indices

    def creases(self) -> tuple[IntArray, NDArray[np.float64]]:
        """Edges (c, 2) and sharpness (c,); of an edge that comes twice, its last."""
        indices, lengths = self.array("creaseIndices", "i"), self.array("creaseLengths", "i")
        sharpness = self.array("creaseSharpnesses", "f")
        short = np.flatnonzero(lengths < 2)
        if len(short):
            self.fail(f"creaseLengths: crease {short[0]} has {lengths[short[0]]}, need two or more")
        if lengths.sum() != len(indices):
            self.fail(
                f"creaseLengths add up to {lengths.sum()}, but there are {len(indices)} "
                "creaseIndices"
            )
        n_edges = len(indices) - len(lengths)
        if len(sharpness) == len(lengths):
            sharpness = np.repeat(sharpness, lengths - 1)
        elif len(sharpness) != n_edges:
            self.fail(
                f"creaseSharpnesses: got {len(sharpness)}, need {len(lengths)}, one for each "
                f"crease, or {n_edges}, one for each edge"
            )
        is_start = np.ones(len(indices), dtype=bool)
        is_start[np.cumsum(lengths) - 1] = False
        start = np.flatnonzero(is_start)
        edges = np.sort(np.stack([indices[start], indices[start + 1]], axis=1), axis=1)
        last = _last(edges)
        return edges[last], sharpness[last]

    def corners(self) -> tuple[IntArray, NDArray[np.float64]]:
        """Vertices and sharpness (c,); of a vertex that comes twice, its last."""
        vertices = self.array("cornerIndices", "i")
        sharpness = self.array("cornerSharpnesses", "f")
        if len(vertices) != len(sharpness):
            self.fail(
                f"cornerSharpnesses: got {len(sharpness)}, need {len(vertices)}, one for each of "
                "cornerIndices"
            )
        last = _last(vertices)
        return vertices[last], sharpness[last]

    def channels(
        self, n_vertices: int, indices: IntArray
    ) -> Iterator[tuple[str, tuple[NDArray[Any], IntArray, str]]]:
        """The primvars that vary on faces and are made of floats."""
        seams = self.choice(*LINEAR) or "corners_plus1"
        for primvar in UsdGeom.PrimvarsAPI(self.prim).GetPrimvarsWithAuthoredValues():
            interpolation = primvar.GetInterpolation()
            values = np.array(primvar.Get(TIME))
            if (
                interpolation not in ("faceVarying", *OF_POINTS)
                or primvar.GetElementSize() != 1
                or not primvar.GetTypeName().isArray
                or values.dtype.kind != "f"
                or values.ndim > 2
            ):
                continue
            name = primvar.GetName()
            rows, what = np.arange(len(values)), "values"
            if primvar.IsIndexed():
                rows, what = self.array(primvar.GetIndicesAttr().GetName(), "i"), "indices"
            n, each = len(indices), "corner of a face"
            if interpolation in OF_POINTS:
                n, each = n_vertices, "point"
            if len(rows) != n:
                self.fail(f"{name}: got {len(rows)} {what}, need {n}, one for each {each}")
            wrong = np.flatnonzero((rows < 0) | (rows >= len(values)))
            if len(wrong):
                self.fail(f"{name}: got index {rows[wrong[0]]}, need 0 to {len(values) - 1}")
            if interpolation in OF_POINTS:
                values, rows = values[rows], indices
            yield primvar.GetPrimvarName(), (values, rows, OF_POINTS.get(interpolation, seams))


def _last(keys: IntArray) -> IntArray:
    """Where each of the keys is last."""
    _, first = np.unique(keys[::-1], axis=0, return_index=True)
    last: IntArray = len(keys) - 1 - first
    return last


def _reversed_faces(sizes: IntArray) -> IntArray:
    """The order of corners that turns every face around and keeps its first corner."""
    offset, size = np.repeat([np.cumsum(sizes) - sizes, sizes], sizes, axis=1)
    position = np.arange(len(offset)) - offset
    order: IntArray = offset + -position % size
    return order


def _merged(name: str, readers: list[_Reader]) -> Mesh:
    """One mesh of all; choices that hold for a whole mesh must agree."""
    meshes = [reader.mesh() for reader in readers]
    if len(meshes) == 1:
        return meshes[0]

    def agreed(what: str, values: list[str]) -> str:
        for reader, value in zip(readers, values, strict=True):
            if value != values[0]:
                raise MeshError(
                    f"{name}: {what} is {values[0]!r} in {readers[0].path}, but {value!r} in "
                    f"{reader.path}: one mesh cannot have both, read them apart with prim=..."
                )
        return values[0]

    options: dict[str, Any] = {}
    fallbacks = {option: next(iter(meanings.values())) for option, (_, meanings) in CHOICES.items()}
    for option, fallback in {**fallbacks, "creasing": "uniform"}.items():
        given = [getattr(mesh, option) for mesh in meshes]
        value = agreed(option, [choice or fallback for choice in given])
        options[option] = value if any(given) else None
    channels = {}
    for channel in meshes[0].channels:
        if not all(channel in mesh.channels for mesh in meshes):
            continue
        values, rows, modes = zip(*(mesh.channels[channel] for mesh in meshes), strict=True)
        agreed(f"primvars:{channel}", [f"{value.shape[1:]} per value" for value in values])
        first_row = _starts([len(value) for value in values])
        channels[channel] = (
            np.concatenate(values),
            np.concatenate([row + first for row, first in zip(rows, first_row, strict=True)]),
            agreed(f"interpolation of primvars:{channel}", list(modes)),
        )
    first_vertex = _starts([mesh.n_vertices for mesh in meshes])
    first_face = _starts([mesh.n_faces for mesh in meshes])
    numbered = list(zip(meshes, first_vertex, first_face, strict=True))
    return Mesh(
        np.concatenate([mesh.points for mesh in meshes]),
        (
            np.concatenate([mesh.sizes for mesh in meshes]),
            np.concatenate([mesh.indices + vertex for mesh, vertex, _ in numbered]),
        ),
        creases=(
            np.concatenate([mesh.creases[0] + vertex for mesh, vertex, _ in numbered]),
            np.concatenate([mesh.creases[1] for mesh in meshes]),
        ),
        corners=(
            np.concatenate([mesh.corners[0] + vertex for mesh, vertex, _ in numbered]),
            np.concatenate([mesh.corners[1] for mesh in meshes]),
        ),
        holes=np.concatenate([mesh.holes + face for mesh, _, face in numbered]),
        channels=channels,
        **options,
    )


def _starts(counts: list[int]) -> list[int]:
    return [0, *accumulate(counts[:-1])]


def pieces(x: Mesh | Tessellation, suffix: str) -> Iterator[bytes]:
    """The bytes of a file with the mesh as the one prim of a stage, in the format of the suffix."""
    stage = Usd.Stage.CreateInMemory()
    if isinstance(x, Mesh):
        _define(stage, x)
    else:
        shape = polygons(x)
        channels = {name: (*channel, "corners_plus1") for name, channel in x.channels.items()}
        faces = shape.sizes, shape.indices
        geom = _define(stage, Mesh(shape.points, faces, scheme="none", channels=channels))
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
            raise OSError(_plain(error.args[0])) from None
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
        _choose(prim, option, attribute, meanings, getattr(mesh, option))
    if mesh.creasing is not None:
        prim.SetCustomDataByKey(CREASING, mesh.creasing)
    modes = {}
    for name in mesh.channels:
        if _add_primvar(prim, mesh, name) == "faceVarying":
            modes[name] = mesh.channels[name][2]
    if len(set(modes.values())) > 1:
        raise ValueError(
            f"channels: a USD mesh holds one interpolation for all its seams, got {modes}"
        )
    _choose(prim, "interpolation", *LINEAR, next(iter(modes.values()), None))
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
    """Finite numbers in the precision of USD's points."""
    try:
        with np.errstate(over="ignore"):
            single = values.astype(np.float64).astype(np.float32)
    except OverflowError:
        single = np.full(1, np.inf, dtype=np.float32)
    if not np.isfinite(single).all():
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
