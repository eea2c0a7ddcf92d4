"""Random USD stages with all kinds of damage beside a sound mesh, for tests."""

from __future__ import annotations

import random
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

POINTS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0), (2, 1, 0)]
COUNTS, INDICES = [4, 4], [0, 1, 2, 3, 1, 4, 5, 2]
WILD = (float("nan"), float("inf"), -float("inf"), 1e38, -1.0, 0.0)
TYPES = [
    Sdf.ValueTypeNames.Find(name)
    for name in [
        "int[]",
        "uint[]",
        "int64[]",
        "uchar[]",
        "bool[]",
        "float[]",
        "double[]",
        "half[]",
        "float2[]",
        "float3[]",
        "float4[]",
        "token[]",
        "string[]",
        "quath[]",
        "matrix4d[]",
        "int",
        "float",
        "token",
        "string",
        "bool",
    ]
]


def mesh(stage: Any, path: str, points: Any = POINTS) -> Any:
    """A sound mesh of two quads."""
    geom = UsdGeom.Mesh.Define(stage, path)
    geom.CreatePointsAttr(points)
    geom.CreateFaceVertexCountsAttr(COUNTS)
    geom.CreateFaceVertexIndicesAttr(INDICES)
    return geom


def _array(g: random.Random, kind: Any) -> Any:
    """Some value of a type, of any length; None for types that need more care."""
    n = g.choice([0, 1, 2, 3, 6, 8, 9])
    name = str(kind)
    integers = [g.choice([-7, -1, 0, 1, 2, 3, 5, 6, 8, 2**31 - 1]) for _ in range(n)]
    floats = [g.choice([*WILD, 0.5, 2.5]) for _ in range(4 * n)]
    made = {
        "int[]": lambda: Vt.IntArray(integers),
        "uint[]": lambda: Vt.UIntArray([abs(i) for i in integers]),
        "int64[]": lambda: Vt.Int64Array([i * 2**30 for i in integers]),
        "uchar[]": lambda: Vt.UCharArray([abs(i) % 256 for i in integers]),
        "bool[]": lambda: Vt.BoolArray([i > 1 for i in integers]),
        "float[]": lambda: Vt.FloatArray(floats[:n]),
        "double[]": lambda: Vt.DoubleArray(floats[:n]),
        "half[]": lambda: Vt.HalfArray(floats[:n]),
        "float2[]": lambda: Vt.Vec2fArray([Gf.Vec2f(*floats[2 * i : 2 * i + 2]) for i in range(n)]),
        "float3[]": lambda: Vt.Vec3fArray([Gf.Vec3f(*floats[3 * i : 3 * i + 3]) for i in range(n)]),
        "float4[]": lambda: Vt.Vec4fArray([Gf.Vec4f(*floats[4 * i : 4 * i + 4]) for i in range(n)]),
        "token[]": lambda: Vt.TokenArray(["none"] * n),
        "string[]": lambda: Vt.StringArray(["x"] * n),
        "quath[]": lambda: Vt.QuathArray([Gf.Quath(0, 0, 0, i) for i in range(n)]),
        "matrix4d[]": lambda: Vt.Matrix4dArray([Gf.Matrix4d(1)] * n),
        "int": lambda: g.choice([-1, 0, 7]),
        "float": lambda: g.choice(WILD),
        "token": lambda: g.choice(["", "none", "all", "leftHanded", "butterfly", "invisible"]),
        "string": lambda: "x",
        "bool": lambda: True,
    }
    return made[name]() if name in made else None


MESH = [
    "points",
    "faceVertexCounts",
    "faceVertexIndices",
    "creaseIndices",
    "creaseLengths",
    "creaseSharpnesses",
    "cornerIndices",
    "cornerSharpnesses",
    "holeIndices",
    "subdivisionScheme",
    "interpolateBoundary",
    "triangleSubdivisionRule",
    "faceVaryingLinearInterpolation",
    "orientation",
    "normals",
    "primvars:st",
    "primvars:st:indices",
    "primvars:displayColor",
    "visibility",
    "purpose",
    "extent",
    "xformOp:translate",
    "xformOp:scale",
]
INSTANCER = [
    "positions",
    "protoIndices",
    "orientations",
    "orientationsf",
    "scales",
    "ids",
    "invisibleIds",
    "velocities",
    "visibility",
    "xformOp:scale",
]


def _damaged(g: random.Random, prim: Any, names: list[str]) -> None:
    """Some attributes set to some value, of their type or another."""
    for name in g.sample(names, g.randrange(1, 5)):
        usual = prim.GetAttribute(name).GetTypeName()
        kind = usual if usual and g.random() < 0.5 else g.choice(TYPES)
        value = _array(g, kind)
        if value is None:
            kind = g.choice(TYPES)
            value = _array(g, kind)
        spec = _attribute(prim, name, kind)
        if g.random() < 0.2:
            prim.GetStage().GetRootLayer().SetTimeSample(spec.path, g.choice([0.0, 5.0]), value)
        else:
            spec.default = value
        if name.startswith("primvars:") and not name.endswith("indices"):
            kinds = ["vertex", "varying", "faceVarying", "uniform", "constant", "x", ""]
            spec.SetInfo("interpolation", g.choice(kinds))
            if g.random() < 0.2:
                spec.SetInfo("elementSize", g.choice([-1, 0, 2]))
    if g.random() < 0.3:
        order = [name for name in names if name.startswith("xformOp:")] + ["!resetXformStack!"]
        spec = _attribute(prim, "xformOpOrder", Sdf.ValueTypeNames.TokenArray)
        spec.default = Vt.TokenArray(g.sample(order, g.randrange(1, len(order) + 1)))


def _attribute(prim: Any, name: str, kind: Any) -> Any:
    """The attribute of a prim in its layer, of a type that need not be that of its schema."""
    spec = prim.GetStage().GetRootLayer().GetPrimAtPath(prim.GetPath())
    if name in spec.attributes:
        del spec.properties[name]
    return Sdf.AttributeSpec(spec, name, kind)


def damaged_stage(g: random.Random) -> Any:
    """A stage in memory with the sound mesh /sound, and some that are not."""
    stage = Usd.Stage.CreateInMemory()
    for i in range(g.randrange(1, 4)):
        path = f"/{g.choice(['a', 'World'])}{i}"
        kind = g.randrange(4)
        if kind == 0:
            scatter = UsdGeom.PointInstancer.Define(stage, path)
            part = mesh(stage, f"{path}/part")
            targets = [part.GetPath(), "/none", path, "/sound"]
            for target in g.sample(targets, g.randrange(0, 4)):
                scatter.CreatePrototypesRel().AddTarget(target)
            scatter.CreateProtoIndicesAttr([0, 0, 1])
            scatter.CreatePositionsAttr([(0, 0, 0), (1, 0, 0), (0, 1, 0)])
            _damaged(g, scatter.GetPrim(), INSTANCER)
            if g.random() < 0.3:
                _damaged(g, part.GetPrim(), MESH)
        elif kind == 1:
            UsdGeom.Mesh.Define(stage, path)
        else:
            geom = mesh(stage, path)
            _damaged(g, geom.GetPrim(), MESH)
            if g.random() < 0.2:
                UsdGeom.Subset.Define(stage, f"{path}/subset").CreateIndicesAttr([99, -1])
            if g.random() < 0.2:
                geom.GetPrim().CreateRelationship("material:binding").AddTarget("/none")
    if g.random() < 0.3:
        stage.SetMetadata("metersPerUnit", g.choice(WILD))
    mesh(stage, "/sound", np.array(POINTS, np.float32) + np.float32(100))
    return stage
