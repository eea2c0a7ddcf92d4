"""What a shape of OpenCASCADE is made of, as plain arrays: splines, trims, what they share."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cad.opencascade import cast, module, parts_of

Array = NDArray[Any]

_ON = 1e-9  # of the sides of a domain: what is nearer to its border is on it


def contents(shape: Any) -> dict[str, Any]:
    """Arrays by the names of `SplineFaces` and `Trims`, the latter with ``trim_`` before them.

    Raises
    ------
    ValueError
        A shape without faces.
    """
    if shape.IsNull() or next(parts_of(shape, "Face"), None) is None:
        raise ValueError("it has no faces")
    shape = _as_splines(shape)
    solids, shells = (_owners(shape, kind) for kind in ("Solid", "Shell"))
    surfaces, trims, about = [], [], []
    edges: dict[int, int] = {}
    seen: set[int] = set()
    backward = module("TopAbs").TopAbs_Orientation.TopAbs_REVERSED
    for face in parts_of(shape, "Face"):
        key = hash(face)
        if key in seen:
            continue
        seen.add(key)
        surface = _surface(face)
        own = _trims(face, edges)
        box = _box(surface, own)
        about.append(
            (
                solids.get(key, -1),
                shells.get(key, -1),
                face.Orientation() == backward,
                _is_whole(own, box),
            )
        )
        surfaces.append((*surface, box))
        trims.append(own)
    return {**_joined(surfaces), **_joined_trims(trims), **_about(about), "faces": len(seen)}


def _as_splines(shape: Any) -> Any:
    """The same shape, all of whose surfaces are B-splines."""
    tool = module("BRep").BRep_Tool
    for face in parts_of(shape, "Face"):
        if type(tool.Surface_s(face)).__name__ != "Geom_BSplineSurface":
            return module("BRepBuilderAPI").BRepBuilderAPI_NurbsConvert(shape, True).Shape()
    return shape


def _owners(shape: Any, kind: str) -> dict[int, int]:
    """Of each face, the number of the solid or shell that it is in."""
    return {
        hash(face): k
        for k, owner in enumerate(parts_of(shape, kind))
        for face in parts_of(owner, "Face")
    }


def _surface(face: Any) -> tuple[Any, ...]:
    """Degree, counts, knots along u and v, control points and weights."""
    surface = module("BRep").BRep_Tool.Surface_s(face)
    if surface.IsUPeriodic() or surface.IsVPeriodic():
        surface = surface.Copy()
        if surface.IsUPeriodic():
            surface.SetUNotPeriodic()
        if surface.IsVPeriodic():
            surface.SetVNotPeriodic()
    degree = surface.UDegree(), surface.VDegree()
    counts = surface.NbUPoles(), surface.NbVPoles()
    poles = [
        (pole.X(), pole.Y(), pole.Z())
        for i in range(1, counts[0] + 1)
        for pole in (surface.Pole(i, j) for j in range(1, counts[1] + 1))
    ]
    weights = np.ones(len(poles))
    if surface.IsURational() or surface.IsVRational():
        weights = np.array(
            [surface.Weight(i, j) for i in range(1, counts[0] + 1) for j in range(1, counts[1] + 1)]
        )
    knots = (np.array(list(x)) for x in (surface.UKnotSequence(), surface.VKnotSequence()))
    return (degree, counts, *knots, np.array(poles), weights)


def _trims(face: Any, edges: dict[int, int]) -> list[tuple[Any, ...]]:
    """Of each use of an edge: loop, edge, along it or not, and a curve in the plane of (u, v)."""
    brep, tools, convert = module("BRepAdaptor"), module("BRepTools"), module("Geom2dConvert")
    geom = module("Geom2d")
    forward = module("TopAbs").TopAbs_Orientation.TopAbs_FORWARD
    outer = tools.BRepTools.OuterWire_s(face)
    wires = sorted(parts_of(face, "Wire"), key=lambda wire: not wire.IsSame(outer))
    found = []
    for loop, wire in enumerate(wires):
        around = tools.BRepTools_WireExplorer(wire, face)
        while around.More():
            edge = cast(around.Current(), "Edge")
            number = edges.setdefault(hash(edge), len(edges))
            along = brep.BRepAdaptor_Curve2d(edge, face)
            low, high = along.FirstParameter(), along.LastParameter()
            part = geom.Geom2d_TrimmedCurve(along.Curve(), low, high)
            curve = convert.Geom2dConvert.CurveToBSplineCurve_s(part)
            count = curve.NbPoles()
            poles = [curve.Pole(i) for i in range(1, count + 1)]
            weights = [curve.Weight(i) for i in range(1, count + 1)]
            points = np.array([(pole.X(), pole.Y()) for pole in poles])
            knots = np.array(list(curve.KnotSequence()))
            is_forward = edge.Orientation() == forward
            spline = curve.Degree(), count, knots, points, np.array(weights)
            found.append((loop, number, is_forward, *spline))
            around.Next()
    return found


def _box(surface: tuple[Any, ...], trims: list[tuple[Any, ...]]) -> Array:
    """The parameters (2, 2) that a face has: least and most of u, of v."""
    own = np.array([[surface[k][0], surface[k][-1]] for k in (2, 3)])
    if not trims:
        return own
    points = np.concatenate([trim[6] for trim in trims])
    low, high = points.min(axis=0), points.max(axis=0)
    near = _ON * (own[:, 1] - own[:, 0])
    low = np.where(np.abs(low - own[:, 0]) <= near, own[:, 0], low)
    high = np.where(np.abs(high - own[:, 1]) <= near, own[:, 1], high)
    return np.stack([np.maximum(low, own[:, 0]), np.minimum(high, own[:, 1])], axis=1)


def _is_whole(trims: list[tuple[Any, ...]], box: Array) -> bool:
    """Whether trims are the border of a box of parameters, and nothing else."""
    if not trims:
        return True
    if max(trim[0] for trim in trims) > 0:
        return False
    near = _ON * (box[:, 1] - box[:, 0])
    for trim in trims:
        off = np.minimum(np.abs(trim[6] - box[:, 0]), np.abs(trim[6] - box[:, 1]))
        if not ((off <= near).all(axis=0)).any():
            return False
    return True


def _joined(surfaces: list[tuple[Any, ...]]) -> dict[str, Array]:
    columns = list(zip(*surfaces, strict=True))
    return {
        "degree": np.array(columns[0], dtype=np.int64),
        "counts": np.array(columns[1], dtype=np.int64),
        "knots_u": np.concatenate(columns[2]),
        "knots_v": np.concatenate(columns[3]),
        "points": np.concatenate(columns[4]),
        "weights": np.concatenate(columns[5]),
        "domain": np.stack(columns[6]),
    }


def _joined_trims(trims: list[list[tuple[Any, ...]]]) -> dict[str, Array]:
    rows = [trim for own in trims for trim in own]
    columns = list(zip(*rows, strict=True)) if rows else [()] * 8
    none = [np.zeros(0)]
    return {
        "trim_face": np.repeat(np.arange(len(trims)), [len(own) for own in trims]),
        "trim_loop": np.array(columns[0], dtype=np.int64),
        "trim_edge": np.array(columns[1], dtype=np.int64),
        "trim_forward": np.array(columns[2], dtype=bool),
        "trim_degree": np.array(columns[3], dtype=np.int64),
        "trim_counts": np.array(columns[4], dtype=np.int64),
        "trim_knots": np.concatenate([*none, *columns[5]]),
        "trim_points": np.concatenate([np.zeros((0, 2)), *columns[6]]),
        "trim_weights": np.concatenate([*none, *columns[7]]),
    }


def _about(rows: list[tuple[Any, ...]]) -> dict[str, Array]:
    solid, shell, reversed_, whole = zip(*rows, strict=True)
    return {
        "solid": np.array(solid, dtype=np.int64),
        "shell": np.array(shell, dtype=np.int64),
        "reversed": np.array(reversed_, dtype=bool),
        "untrimmed": np.array(whole, dtype=bool),
    }
