"""Cages from Rhino's files: its SubD objects and meshes, one after the other."""

from __future__ import annotations

from itertools import chain
from typing import Any

import numpy as np

from limitsurf.cage.checks import MeshError
from limitsurf.cage.mesh import Mesh
from limitsurf.shell.io.losses import Losses, listed, tagged
from limitsurf.shell.io.parts import Part, merged

# metres, by the names of units
UNITS = {
    "Microns": 1e-6,
    "Millimeters": 1e-3,
    "Centimeters": 1e-2,
    "Decimeters": 0.1,
    "Meters": 1.0,
    "Kilometers": 1e3,
    "Mils": 2.54e-5,
    "Inches": 0.0254,
    "Feet": 0.3048,
    "Yards": 0.9144,
    "Miles": 1609.344,
}


def read(name: str, suffix: str, path: str, folder: str | None, *, strict: bool = False) -> Mesh:
    """The SubD objects of a file as one cage, with its meshes; without any of these, an error."""
    import rhino3dm

    losses = Losses(name, strict)
    file: Any = rhino3dm.File3dm.Read(path)
    if file is None:
        raise MeshError(f"{name}: rhino3dm cannot read it: truncated or broken")
    layers = {layer.Index: layer for layer in file.Layers}
    parts: list[Part] = []
    others: dict[str, list[str]] = {}
    for number, item in enumerate(file.Objects):
        shape, about, where = item.Geometry, item.Attributes, f"object {number}"
        kind = type(shape).__name__
        layer = layers.get(about.LayerIndex)
        is_hidden = not about.Visible or (layer is not None and not layer.Visible)
        if is_hidden or about.IsInstanceDefinitionObject:
            kind = "hidden objects"
        if kind not in ("SubD", "Mesh"):
            others.setdefault(kind, []).append(where)
            continue
        try:
            mesh = _subd(shape, losses, where) if kind == "SubD" else _mesh(shape)
        except MeshError as error:
            losses.add("broken", where, str(error), "the object is left out")
            continue
        names = {"object": about.Name or "", "layer": "" if layer is None else layer.FullPath}
        data = {key: np.full(mesh.n_faces, value) for key, value in names.items()}
        mesh = mesh.with_tags(face_data=data)
        parts.append(Part.of(where, mesh, False, np.eye(4)[None]))
    said = [f"{kind} ({listed(where)})" for kind, where in sorted(others.items())]
    if not parts:
        besides = f"; it has {', '.join(said)}" if said else ""
        raise MeshError(f"{name}: need at least one SubD or mesh, got none{besides}")
    losses.left_out(said)
    units = UNITS.get(file.Settings.ModelUnitSystem.name)
    found = merged(parts, losses, up="z", units=units)
    losses.warn(2)
    return found


def _subd(shape: Any, losses: Losses, where: str) -> Mesh:
    """A SubD: Catmull-Clark, smooth to its boundary but for the corners that it names."""
    vertices = list(shape.Vertices)
    number = {vertex.Id: i for i, vertex in enumerate(vertices)}
    places = [vertex.ControlNetPoint for vertex in vertices]
    points = np.array([[place.X, place.Y, place.Z] for place in places]).reshape(-1, 3)
    faces = [[number[vertex.Id] for vertex in face.Vertices] for face in shape.Faces]
    edges, sharpness = [], []
    for edge in shape.Edges:
        if edge.IsCrease and edge.FaceCount > 1:  # a boundary is one anyway
            edges.append([number[edge.VertexId(0)], number[edge.VertexId(1)]])
            sharpness.append(np.inf)
        elif edge.IsSharp:
            ends = edge.EndSharpness(0), edge.EndSharpness(1)
            if ends[0] != ends[1]:
                text = f"edges whose sharpness varies from {ends[0]:g} to {ends[1]:g}"
                losses.add("sharpness", where, text, "its mean is taken")
            edges.append([number[edge.VertexId(0)], number[edge.VertexId(1)]])
            sharpness.append(sum(ends) / 2)
    corners = [i for i, vertex in enumerate(vertices) if vertex.IsCorner]
    return tagged(
        Mesh(
            points,
            (np.array(list(map(len, faces)), np.int64), np.array(list(chain(*faces)), np.int64)),
        ),
        lambda what, names, why: losses.add(what, where, f"{what} {names[0]}{why}"),
        creases=(np.array(edges, np.int64).reshape(-1, 2), np.array(sharpness)),
        corners=(np.array(corners, np.int64), np.full(len(corners), np.inf)),
        scheme="catmull-clark",
        boundary="edge_only",
    )


def _mesh(shape: Any) -> Mesh:
    """A mesh: polygons of three or four corners, no surface of a scheme."""
    points = np.array([[p.X, p.Y, p.Z] for p in shape.Vertices], float).reshape(-1, 3)
    corners = np.array([shape.Faces[i] for i in range(shape.Faces.Count)], int).reshape(-1, 4)
    kept = np.ones(corners.shape, dtype=bool)
    kept[:, 3] = corners[:, 3] != corners[:, 2]  # triangles have their last corner twice
    return Mesh(points, (kept.sum(axis=1), corners[kept]))
