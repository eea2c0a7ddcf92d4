"""Rhino's files. rhino3dm cannot make a SubD, so objects of its form stand for some."""

from types import SimpleNamespace

import numpy as np
import pytest

import limitsurf as ls
from limitsurf.shell.io import rhino
from limitsurf.shell.io.losses import Losses


def place(x, y, z):
    return SimpleNamespace(X=x, Y=y, Z=z)


def subd(points, faces, creases=(), sharp=None, corners=()):
    """A SubD as rhino3dm shows it, with numbers from 1 on."""
    sharp = sharp or {}
    vertices = [
        SimpleNamespace(Id=i + 1, ControlNetPoint=place(*point), IsCorner=i in corners)
        for i, point in enumerate(points)
    ]
    pairs = {}
    for face in faces:
        for a, b in zip(face, [*face[1:], face[0]], strict=True):
            pairs[min(a, b), max(a, b)] = pairs.get((min(a, b), max(a, b)), 0) + 1
    edges = [
        SimpleNamespace(
            VertexId=[a + 1, b + 1].__getitem__,
            FaceCount=count,
            IsCrease=(a, b) in creases or count == 1,
            IsSharp=(a, b) in sharp,
            EndSharpness=sharp.get((a, b), (0, 0)).__getitem__,
        )
        for (a, b), count in pairs.items()
    ]
    shapes = [SimpleNamespace(Vertices=[vertices[i] for i in face]) for face in faces]
    return SimpleNamespace(Vertices=vertices, Edges=edges, Faces=shapes)


POINTS = [(0, 0, 0), (1, 0, 0), (2, 0, 1), (0, 1, 0), (1, 1, 0), (2, 1, 0), (3, 0, 0)]
FACES = [[0, 1, 4, 3], [1, 2, 5, 4], [2, 6, 5]]


def test_creases_sharp_edges_and_corners():
    losses = Losses("a.3dm", strict=False)
    given = subd(POINTS, FACES, creases={(1, 4)}, sharp={(2, 5): (1, 2)}, corners={0})
    expected = ls.Mesh(
        POINTS,
        FACES,
        creases={(1, 4): np.inf, (2, 5): 1.5},
        corners={0: np.inf},
        scheme="catmull-clark",
        boundary="edge_only",
    )
    assert rhino._subd(given, losses, "object 0") == expected
    said = "a.3dm, object 0: edges whose sharpness varies from 1 to 2: its mean is taken"
    assert losses.messages() == [said]


def test_a_file(tmp_path):
    rhino3dm = pytest.importorskip("rhino3dm")
    file, mesh = rhino3dm.File3dm(), rhino3dm.Mesh()
    for point in POINTS:
        mesh.Vertices.Add(*point)
    for face in FACES:
        mesh.Faces.AddFace(*face)
    file.Objects.AddMesh(mesh)
    file.Settings.ModelUnitSystem = rhino3dm.UnitSystem.Centimeters
    file.Write(str(tmp_path / "a.3dm"), 7)
    found = ls.read(tmp_path / "a.3dm")
    assert found.with_tags(face_data=None) == ls.Mesh(POINTS, FACES, units=0.01, up="z")
    (tmp_path / "b.3dm").write_bytes((tmp_path / "a.3dm").read_bytes()[:900])
    with pytest.raises(ls.MeshError, match=r"b\.3dm: "):
        ls.read(tmp_path / "b.3dm")
