"""OpenCASCADE's vertices, edges, faces, shells and solids, made one by one of arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cad.boundary import Boundary
from limitsurf.cad.opencascade import Arrays, compound_of, module
from limitsurf.cad.sheets import Sheets

Array = NDArray[Any]

_SLACK = 4.0  # times the largest gap that was found at places between knots


class Build:
    """The vertices, edges and faces of a boundary representation.

    Attributes
    ----------
    vertices, edges, faces : list
        Of OpenCASCADE. An edge that is a point is one on each face, and None in the list.
    places : (V, 3) float64
    gap, most : float
        The largest gap that was found, and the largest tolerance.
    """

    def __init__(self, sheets: Sheets, boundary: Boundary, points: Array) -> None:
        self.sheets, self.boundary = sheets, boundary
        self._arrays, self._tool = Arrays(), module("BRep").BRep_Builder()
        self._topods, self._geom = module("TopoDS"), module("Geom")
        self._geom2d, self._gp = module("Geom2d"), module("gp")
        ways = module("TopAbs").TopAbs_Orientation
        self._ways = ways.TopAbs_REVERSED, ways.TopAbs_FORWARD
        gaps = sheets.gaps(boundary)
        self.gap = float(gaps.max(initial=0))
        tolerance = np.maximum(_SLACK * gaps, sheets.least)
        self.places, near = self._vertices(tolerance)
        self.most = float(near.max(initial=0))
        self.vertices = [
            self._vertex(*known) for known in zip(self.places.tolist(), near.tolist(), strict=True)
        ]
        self._tolerance = tolerance.tolist()
        self._points = points.tolist()
        self.edges = [None if gone else self._edge(e) for e, gone in enumerate(self._points)]
        ends = np.searchsorted(boundary.face, np.arange(len(sheets.first) + 1))
        self._around = [x.tolist() for x in (boundary.side, boundary.edge, boundary.forward)]
        self._spans = [x.tolist() for x in (boundary.low, boundary.high, boundary.along)]
        self.faces = [self._face(f, ends[f], ends[f + 1]) for f in range(len(sheets.first))]

    def _vertices(self, tolerance: Array) -> tuple[Array, Array]:
        """Where vertices are, and how far ends of edges are from there."""
        boundary = self.boundary
        use, low = boundary.corner.T
        places = self.sheets.along(
            boundary.face[use],
            boundary.side[use],
            np.where(low == 1, boundary.low[use], boundary.high[use]),
        )
        near = np.full(len(places), self.sheets.least)
        every = np.arange(len(boundary.face))
        for x, from_start in ((boundary.low, boundary.along), (boundary.high, ~boundary.along)):
            edge = boundary.edge
            vertex = np.where(from_start, boundary.start[edge], boundary.end[edge])
            at = self.sheets.along(boundary.face, boundary.side, x[every])
            off = np.linalg.norm(at - places[vertex], axis=1)
            np.maximum.at(near, vertex, np.maximum(tolerance[edge], _SLACK * off))
        return places, near

    def _vertex(self, place: list[float], tolerance: float) -> Any:
        vertex = self._topods.TopoDS_Vertex()
        self._tool.MakeVertex(vertex, self._gp.gp_Pnt(*place), tolerance)
        return vertex

    def _edge(self, e: int) -> Any:
        """An edge with its curve, which is a side of its first face or a part of one."""
        boundary, tool = self.boundary, self._tool
        use = int(boundary.first[e])
        points, knots, degree = self.sheets.curve(int(boundary.face[use]), int(boundary.side[use]))
        curve = self._geom.Geom_BSplineCurve(
            self._arrays.points(points), *self._arrays.knots(knots), degree
        )
        low, high = float(boundary.low[use]), float(boundary.high[use])
        if (low, high) != (knots[0], knots[-1]):
            curve.Segment(low, high)
        edge = self._topods.TopoDS_Edge()
        tool.MakeEdge(edge, curve, self._tolerance[e])
        self._bounded(edge, e, low, high)
        return edge

    def _bounded(self, edge: Any, e: int, low: float, high: float) -> None:
        ends = (self.boundary.start[e], self.boundary.end[e])
        for vertex, way in zip(ends, self._ways[::-1], strict=True):
            self._tool.Add(edge, self.vertices[vertex].Oriented(way))
        self._tool.Range(edge, low, high)

    def _face(self, f: int, begin: int, end: int) -> Any:
        """A face within its edges."""
        sheets, tool, arrays = self.sheets, self._tool, self._arrays
        (u, m), (v, n) = (arrays.knots(sheets.knots(f, way)) for way in (0, 1))
        net = arrays.net(sheets.net(f))
        surface = self._geom.Geom_BSplineSurface(net, u, v, m, n, *sheets.splines.degree)
        face, wire = self._topods.TopoDS_Face(), self._topods.TopoDS_Wire()
        tool.MakeFace(face, surface, sheets.least)
        tool.MakeWire(wire)
        (sides, edges, forward), (low, high, along) = self._around, self._spans
        width = sheets.splines.grid[f].tolist()
        seams = _twice(edges[begin:end])
        for k in range(begin, end):
            e = edges[k]
            span = (low[k], high[k]) if along[k] else (high[k], low[k])
            if self._points[e]:
                own = self._point(e, *sorted(span))
                curve = self._line(sides[k], width, sorted(span), span)
                tool.UpdateEdge(own, curve, face, self._tolerance[e])
                tool.Range(own, face, *sorted(span))
            else:
                own = self.edges[e]
                lead = int(self.boundary.first[e])
                curve = self._line(sides[k], width, (low[lead], high[lead]), span)
                if e in seams:
                    both = seams[e] = [*seams[e], curve] if forward[k] else [curve, *seams[e]]
                    if len(both) == 2:
                        tool.UpdateEdge(own, both[1], both[0], face, self._tolerance[e])
                else:
                    tool.UpdateEdge(own, curve, face, self._tolerance[e])
            tool.Add(wire, own.Oriented(self._ways[forward[k]]))
        wire.Closed(True)
        tool.Add(face, wire)
        return face

    def _point(self, e: int, low: float, high: float) -> Any:
        """An edge that is a point."""
        edge = self._topods.TopoDS_Edge()
        self._tool.MakeEdge(edge)
        self._tool.UpdateEdge(edge, self._tolerance[e])
        self._tool.Degenerated(edge, True)
        self._bounded(edge, e, low, high)
        return edge

    def _line(self, side: int, width: list[int], of: Any, to: Any) -> Any:
        """A side in a face's plane, as parameters of an edge go from `of` to `to`."""
        gp, triangles = self._gp, self.sheets.triangles
        ends = [_place(triangles, side, width, x) for x in to]
        step = (to[1] - to[0]) / (of[1] - of[0])
        if abs(step) != 1 or (triangles and side == 1):
            knots = self._arrays.knots(np.repeat([of[0], of[1]], 2))
            return self._geom2d.Geom2d_BSplineCurve(self._arrays.places(ends), *knots, 1)
        way = ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]
        size = of[1] - of[0]
        way = way[0] / size, way[1] / size
        at = ends[0][0] - of[0] * way[0], ends[0][1] - of[0] * way[1]
        return self._geom2d.Geom2d_Line(gp.gp_Pnt2d(*at), gp.gp_Dir2d(*way))


def _place(triangles: bool, side: int, width: list[int], x: float) -> tuple[float, float]:
    """U and v at a parameter along a side."""
    if triangles:
        return ((x, 0.0), (1 - x, x), (0.0, x))[side]
    return ((x, 0.0), (float(width[0]), x), (x, float(width[1])), (0.0, x))[side]


def _twice(edges: list[int]) -> dict[int, list[Any]]:
    """Edges that a face has on two of its sides."""
    return {e: [] for e in edges if edges.count(e) > 1} if len(set(edges)) < len(edges) else {}


def assembled(build: Build, solids: bool) -> Any:
    """Shells of all parts, those that are closed as solids, several as a compound."""
    tool, topods = module("BRep").BRep_Builder(), module("TopoDS")
    boundary = build.boundary
    shells = []
    order = np.argsort(boundary.part, kind="stable")
    ends = np.searchsorted(boundary.part[order], np.arange(len(boundary.closed) + 1))
    for part, closed in enumerate(boundary.closed.tolist()):
        shell = topods.TopoDS_Shell()
        tool.MakeShell(shell)
        for f in order[ends[part] : ends[part + 1]].tolist():
            tool.Add(shell, build.faces[f])
        shell.Closed(closed)
        shells.append(shell)
    found = _bodies(build, shells) if solids else shells
    return found[0] if len(found) == 1 else compound_of(found)


def _bodies(build: Build, shells: list[Any]) -> list[Any]:
    """Closed shells as solids, each with the voids in it; open ones as they are."""
    tool, topods = module("BRep").BRep_Builder(), module("TopoDS")
    closed = build.boundary.closed
    shells = [
        shell.Reversed() if is_closed and _volume(shell) < 0 else shell
        for shell, is_closed in zip(shells, closed.tolist(), strict=True)
    ]
    around = _around(build, shells)
    depth = np.array([len(x) for x in around])
    solids: dict[int, Any] = {}
    found = []
    for k in np.argsort(depth, kind="stable").tolist():
        if not closed[k] or depth[k] % 2:
            continue
        solids[k] = topods.TopoDS_Solid()
        tool.MakeSolid(solids[k])
        tool.Add(solids[k], shells[k])
    for k in np.flatnonzero(closed & (depth % 2 == 1)).tolist():
        outer = next(j for j in around[k] if depth[j] == depth[k] - 1)
        tool.Add(solids[outer], shells[k].Reversed())
    for k, shell in enumerate(shells):
        if not closed[k]:
            found.append(shell)
        elif k in solids:
            found.append(solids[k])
    return found


def _volume(shape: Any) -> float:
    """What a closed shape bounds, negative if its faces look inwards."""
    found = module("GProp").GProp_GProps()
    module("BRepGProp").BRepGProp.VolumeProperties_s(shape, found)
    return float(found.Mass())


def _around(build: Build, shells: list[Any]) -> list[list[int]]:
    """The closed parts that each closed part is in."""
    boundary, sheets = build.boundary, build.sheets
    found: list[list[int]] = [[] for _ in shells]
    if boundary.closed.sum() < 2:
        return found
    sizes = sheets.splines.counts.prod(axis=1)
    part = np.repeat(boundary.part, sizes)
    low, high = (np.full((len(shells), 3), x) for x in (np.inf, -np.inf))
    np.minimum.at(low, part, sheets.points)
    np.maximum.at(high, part, sheets.points)
    use = boundary.corner[:, 0]
    place = np.empty((len(shells), 3))
    place[boundary.part[boundary.face[use]]] = build.places
    inside = (place[:, None] > low) & (place[:, None] < high)
    within = inside.all(axis=2) & boundary.closed & boundary.closed[:, None]
    np.fill_diagonal(within, False)
    for outer in np.flatnonzero(within.any(axis=0)).tolist():
        holds = _inside(shells[outer], place[within[:, outer]])
        for k, is_in in zip(np.flatnonzero(within[:, outer]).tolist(), holds, strict=True):
            if is_in:
                found[k].append(outer)
    return found


def _inside(shell: Any, places: Array) -> list[bool]:
    """Which places are in what a closed shell bounds."""
    tool, topods, gp = module("BRep").BRep_Builder(), module("TopoDS"), module("gp")
    solid = topods.TopoDS_Solid()
    tool.MakeSolid(solid)
    tool.Add(solid, shell)
    test = module("BRepClass3d").BRepClass3d_SolidClassifier(solid)
    within = module("TopAbs").TopAbs_State.TopAbs_IN
    found = []
    for place in places.tolist():
        test.Perform(gp.gp_Pnt(*place), 1e-7)
        found.append(test.State() == within)
    return found
