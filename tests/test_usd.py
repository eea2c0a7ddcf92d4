"""Cages to and from USD: what is written is read, what others write means what it means there."""

import json
import os
import random
import re
import warnings
from contextlib import nullcontext
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import usd_damage
import zoo
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from pxr import Sdf, Usd, UsdGeom, UsdUtils, Vt

import limitsurf as ls
from limitsurf.cage.checks import INTERPOLATION
from limitsurf.shell.cli.commands import main
from limitsurf.shell.io import formats, usd

# USD rounds to float32, which random cages may not survive: `write` says so
pytestmark = pytest.mark.filterwarnings("ignore:.*distinct points become equal:UserWarning")

CAGES = Path(__file__).parents[1] / ".." / "shared" / "cages"
POINTS = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0]]
FACES = [[0, 1, 2, 3], [1, 4, 5, 2]]
TWO_QUADS = """
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0), (2, 1, 0)]
    int[] faceVertexCounts = [4, 4]
    int[] faceVertexIndices = [0, 1, 2, 3, 1, 4, 5, 2]
"""


def prim(text="", name="quads", kind="Mesh", head=""):
    """Two quads side by side, as a prim with more in its body and in its head."""
    return f'def {kind} "{name}" ({head}) {{{TWO_QUADS}{text}\n}}\n'


def group(text, name="World", body=""):
    return f'def Xform "{name}" {{\n{body}\n{text}}}\n'


@pytest.fixture
def read(tmp_path):
    """Read a text as a USD file."""

    def read_text(text, **keywords):
        path = tmp_path / "cage.usda"
        path.write_text("#usda 1.0\n" + text, encoding="utf-8")
        return ls.read(path, **keywords)

    return read_text


@pytest.fixture
def refused(read):
    """Read what cannot be, and return the message after the path of the file."""

    def message(text, **keywords):
        with pytest.raises(ls.MeshError) as caught:
            read(text, **keywords)
        path, _, message = str(caught.value).partition("cage.usda")
        assert path
        return message.removeprefix(", ").removeprefix(": ")

    return message


# --- Reading


def test_plain_mesh(read):
    mesh = read(prim())
    assert mesh == ls.Mesh(POINTS, FACES)
    assert mesh.scheme is mesh.boundary is mesh.creasing is mesh.triangles is None


def test_tags(read):
    mesh = read(
        prim("""
    int[] creaseIndices = [0, 1, 2, 3, 5, 2]
    int[] creaseLengths = [4, 2]
    float[] creaseSharpnesses = [1.5, 10]
    int[] cornerIndices = [5, 0]
    float[] cornerSharpnesses = [2.5, inf]
    int[] holeIndices = [1, 1]
    uniform token subdivisionScheme = "catmullClark"
    token interpolateBoundary = "edgeOnly"
    token triangleSubdivisionRule = "smooth"
""")
    )
    assert mesh == ls.Mesh(
        POINTS,
        FACES,
        creases={(0, 1): 1.5, (1, 2): 1.5, (2, 3): 1.5, (2, 5): 10},
        corners={0: np.inf, 5: 2.5},
        holes=[1],
        scheme="catmull-clark",
        boundary="edge_only",
        triangles="smooth",
    )


def test_sharpness_of_each_edge(read):
    mesh = read(
        prim("""
    int[] creaseIndices = [0, 1, 2, 3, 0, 5, 2]
    int[] creaseLengths = [5, 2]
    float[] creaseSharpnesses = [1, 2, 3, 4, 5]
""")
    )
    edges, sharpness = mesh.creases
    assert edges.tolist() == [[0, 1], [0, 3], [1, 2], [2, 3], [2, 5]]
    assert sharpness.tolist() == [1, 4, 2, 3, 5]


def test_the_last_of_several_tags_holds(read):
    mesh = read(
        prim("""
    int[] creaseIndices = [0, 1, 0, 1, 2, 1]
    int[] creaseLengths = [3, 3]
    float[] creaseSharpnesses = [1, 2, 3, 4]
    int[] cornerIndices = [3, 3]
    float[] cornerSharpnesses = [1, 2]
""")
    )
    assert [array.tolist() for array in mesh.creases] == [[[0, 1], [1, 2]], [2, 4]]
    assert [array.tolist() for array in mesh.corners] == [[3], [2]]


@pytest.mark.parametrize(
    ("token", "option", "value"),
    [
        ("uniform token subdivisionScheme = 'catmullClark'", "scheme", "catmull-clark"),
        ("uniform token subdivisionScheme = 'loop'", "scheme", "loop"),
        ("uniform token subdivisionScheme = 'bilinear'", "scheme", "bilinear"),
        ("uniform token subdivisionScheme = 'none'", "scheme", "none"),
        ("token interpolateBoundary = 'none'", "boundary", "none"),
        ("token interpolateBoundary = 'edgeOnly'", "boundary", "edge_only"),
        ("token interpolateBoundary = 'edgeAndCorner'", "boundary", "edge_and_corner"),
        ("token triangleSubdivisionRule = 'catmullClark'", "triangles", "catmull-clark"),
        ("token triangleSubdivisionRule = 'smooth'", "triangles", "smooth"),
        ("token interpolateBoundary.timeSamples = {3: 'none', 4: 'edgeOnly'}", "boundary", "none"),
        ("token interpolateBoundary = None", "boundary", None),
    ],
)
def test_choices(read, token, option, value):
    assert getattr(read(prim(token)), option) == value


def test_no_surface_is_made_of_a_polygon_mesh_unasked(read):
    mesh = read(prim("uniform token subdivisionScheme = 'none'"))
    for make in ls.LimitSurface, ls.refined:
        with pytest.raises(ValueError, match=r"'none'.* polygons, .* say scheme=.catmull-clark"):
            make(mesh)
    assert len(ls.LimitSurface(mesh, scheme="catmull-clark").limit_faces) == 2


@pytest.mark.parametrize("number", range(6))
def test_face_varying_primvars(read, number):
    tokens = ["none", "cornersOnly", "cornersPlus1", "cornersPlus2", "boundaries", "all"]
    mesh = read(
        prim(f"""
    token faceVaryingLinearInterpolation = "{tokens[number]}"
    texCoord2f[] primvars:st = [(0, 0), (0.5, 0), (0.5, 1), (0, 1), (1, 0), (1, 1)] (
        interpolation = "faceVarying"
    )
    int[] primvars:st:indices = [0, 1, 2, 3, 1, 4, 5, 2]
    double[] primvars:map:depth = [0, 0.1, 2, 3, 4, 5, 6, 7] (interpolation = "faceVarying")
""")
    )
    assert set(mesh.channels) == {"st", "map:depth"}
    values, rows, mode = mesh.channels["st"]
    assert values.tolist() == [[0, 0], [0.5, 0], [0.5, 1], [0, 1], [1, 0], [1, 1]]
    assert rows.tolist() == [0, 1, 2, 3, 1, 4, 5, 2]
    assert mode == INTERPOLATION[number]
    values, rows, mode = mesh.channels["map:depth"]
    assert values.tolist() == [0, 0.1, 2, 3, 4, 5, 6, 7]
    assert rows.tolist() == list(range(8))
    assert mode == INTERPOLATION[number]


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        ("float", "7"),
        ("half", "7"),
        ("float2", "(7, 8)"),
        ("texCoord2h", "(7, 8)"),
        ("texCoord2d", "(7, 8)"),
        ("texCoord3f", "(7, 8, 9)"),
        ("color3f", "(7, 8, 9)"),
        ("double4", "(7, 8, 9, 10)"),
    ],
)
def test_types_of_primvars(read, kind, value):
    mesh = read(
        prim(f"""
    {kind}[] primvars:st = [{value}] (interpolation = "faceVarying")
    int[] primvars:st:indices = [0, 0, 0, 0, 0, 0, 0, 0]
""")
    )
    values, rows, mode = mesh.channels["st"]
    assert values.tolist() == [{"(": list, "7": float}[value[0]](eval(value))]
    assert rows.tolist() == [0] * 8
    assert mode == "corners_plus1"


@pytest.mark.parametrize(
    ("interpolation", "boundary", "mode"),
    [
        ("vertex", "edgeAndCorner", "none"),
        ("vertex", "edgeOnly", "none"),
        ("vertex", "none", "none"),
        ("varying", "edgeAndCorner", "all"),
        ("varying", "none", "all"),
    ],
)
def test_primvars_of_points(read, interpolation, boundary, mode):
    mesh = read(
        prim(f"""
    token interpolateBoundary = "{boundary}"
    float[] primvars:plain = [0, 1, 2, 3, 4, 5] (interpolation = "{interpolation}")
    float[] primvars:indexed = [7, 8] (interpolation = "{interpolation}")
    int[] primvars:indexed:indices = [0, 1, 0, 1, 0, 1]
""")
    )
    for name, expected in ("plain", [0, 1, 2, 3, 4, 5]), ("indexed", [7, 8, 7, 8, 7, 8]):
        values, rows, given = mesh.channels[name]
        assert values.tolist() == expected
        assert rows.tolist() == mesh.indices.tolist()
        assert given == mode


def test_primvars_that_are_no_channels(read):
    text = prim("""
    color3f[] primvars:displayColor = [(1, 0, 0)]
    float[] primvars:constant = [1] (interpolation = "constant")
    float[] primvars:uniform = [1, 2] (interpolation = "uniform")
    int[] primvars:integers = [0, 1, 2, 3, 4, 5] (interpolation = "vertex")
    string[] primvars:names = ["a", "b", "c", "d", "e", "f"] (interpolation = "vertex")
    float primvars:single = 1 (interpolation = "vertex")
    float[] primvars:weights = [0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1] (
        elementSize = 2
        interpolation = "vertex"
    )
    texCoord2f[] primvars:declared (interpolation = "faceVarying")
    texCoord2f[] primvars:blocked = None (interpolation = "faceVarying")
    normal3f[] normals = [(0, 0, 1)] (interpolation = "constant")
    float[] plain = [1, 2, 3]
    rel material:binding = </paint>
    def GeomSubset "front" {}
""")
    with pytest.warns(UserWarning, match="no place for all, left out") as caught:
        mesh = read(text + 'def Sphere "ball" {}\n' + text.replace('"quads"', '"again"'))
    data = {"material": ["paint"] * 4, "uniform": np.array([1, 2, 1, 2], np.float32)}
    faces = [*FACES, *(np.array(FACES) + 6).tolist()]
    data["object"] = ["quads", "quads", "again", "again"]
    assert mesh == ls.Mesh([*POINTS, *POINTS], faces, face_data=data)
    assert len(caught) == 1
    said = str(caught[0].message)
    for what in (
        "Sphere (1: /ball)",
        "materials (2: /quads, /again)",
        "primvars:displayColor (2: /quads, /again)",
        "primvars:weights (2: ",
        "primvars:names (2: ",
    ):
        assert what in said


SUBSETS = """
    def GeomSubset "a" {
        uniform token elementType = "face"
        uniform token familyName = "%s"
        int[] indices = [%s]
    }
    def GeomSubset "b" {
        uniform token elementType = "face"
        uniform token familyName = "%s"
        int[] indices = [%s]
        rel material:binding = </looks/steel>
    }
"""


@pytest.mark.parametrize(
    ("subsets", "expected"),
    [
        (("parts", "1", "parts", "0"), {"parts": ["b", "a"]}),
        (("", "1", "", ""), {"subset": ["", "a"]}),
        (("parts", "0, 1", "parts", "1"), {"a": [True, True], "b": [False, True]}),
        (("one", "0", "materialBind", "1"), {"one": ["a", ""], "material": ["", "steel"]}),
    ],
)
def test_subsets_are_data_of_faces(read, subsets, expected):
    found = read(prim(SUBSETS % subsets)).face_data
    assert {name: values.tolist() for name, values in found.items()} == expected


@pytest.mark.parametrize(
    "values",
    [
        ["a_b", "a|b", "a_b_2", "a~b", "a_b_1"],  # of which USD makes two names
        np.array([True, False, True, True, False]),
        np.arange(5) + 2**62,
        np.arange(10.0).reshape(5, 2) / 3,
    ],
)
def test_data_of_faces_come_back(values, tmp_path):
    path = tmp_path / "a.usda"
    points, faces = np.eye(15, 3) + np.arange(15)[:, None], np.arange(15).reshape(5, 3)
    ls.write(path, ls.Mesh(points, faces, face_data={"x": values}))
    found = ls.read(path).face_data["x"]
    assert (found == np.array(values)).all()
    assert found.dtype.kind == np.array(values).dtype.kind


def test_integers_that_usd_cannot_hold(tmp_path):
    path, data = tmp_path / "a.usda", {"x": np.array([1, 2**63], np.uint64)}
    with pytest.warns(UserWarning, match=r"left out, of no form, size or name .* 'x'"):
        ls.write(path, ls.Mesh(POINTS, FACES, face_data=data))


def test_uniform_values_of_another_number_of_faces(read):
    body = "float[] primvars:heat = [1, 2, 3] (interpolation = 'uniform')"
    with pytest.warns(UserWarning, match="primvar 'heat': got 3 values, need one for each face"):
        assert not read(prim(body)).face_data


def test_a_subset_of_faces_that_do_not_exist(read):
    with pytest.warns(UserWarning, match="subset 'b': face 9 is out of range, need 0 to 1"):
        mesh = read(prim(SUBSETS % ("x", "0", "x", "1, 9")) + prim(name="plain"))
    assert mesh.face_data["x"].tolist() == ["a", "", "", ""]


@pytest.mark.parametrize("suffix", [".usda", ".usdc"])
def test_data_of_faces_are_written(tmp_path, suffix):
    data = {
        "group": ["lid of 5%", ""],
        "material": ["steel", "brass"],
        "id": [7, -3],
        "flag": [True, False],
        "load": [0.1, np.nan],
        "colour": [[0.0, 0.5, 1], [1, 2, 3]],
    }
    mesh = ls.Mesh(POINTS, FACES, face_data=data)
    ls.write(tmp_path / f"a{suffix}", mesh)
    found = ls.read(tmp_path / f"a{suffix}").face_data
    assert found.keys() == data.keys()
    for name, values in mesh.face_data.items():
        np.testing.assert_array_equal(found[name], values)
    with pytest.warns(UserWarning, match="data of faces are left out.*'two words'"):
        ls.write(tmp_path / f"b{suffix}", mesh.with_tags(face_data={"two words": [1, 2]}))


MOVING = """#usda 1.0
def Xform "lift" {
    double3 xformOp:translate.timeSamples = {1: (0, 0, 0), 5: (0, 0, 8)}
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Mesh "sheet" {
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        point3f[] points.timeSamples = {
            1: [(0, 0, 0), (1, 0, 0), (0, 1, 0)],
            3: [(0, 0, 0), (3, 0, 0), (0, 1, 0)],
        }
        %s
    }
}
"""


def test_frames_of_an_animation(tmp_path):
    path = tmp_path / "a.usda"
    path.write_text(MOVING % "")
    found = list(ls.frames(path))
    assert [time for time, _ in found] == [1, 3, 5]
    x, z = np.array([[points[1, 0], points[1, 2]] for _, points in found]).T
    assert x.tolist() == [1, 3, 3]
    assert z.tolist() == [0, 4, 8]
    ((time, points),) = ls.frames(path, prim="/lift/sheet", times=[2])
    assert (time, points[1].tolist()) == (2, [2, 0, 2])
    assert len(list(ls.frames(path, times=iter([1, 5])))) == 2
    assert list(ls.frames(path, times=[])) == []
    still = tmp_path / "still.usda"
    ls.write(still, ls.Mesh(POINTS, FACES))
    assert [time for time, _ in ls.frames(still)] == [0]
    with pytest.raises(ValueError, match="only USD and glTF files have frames"):
        ls.frames(tmp_path / "a.obj")  # before the first is asked for


def test_frames_are_read_at_once(tmp_path, monkeypatch):
    """All that one answer holds; without room, one frame each."""
    path, calls = tmp_path / "a.usda", []
    path.write_text(MOVING % "")
    original = formats.read_by_library

    def counted(*arguments, **options):
        calls.append(options)
        return original(*arguments, **options)

    monkeypatch.setattr(formats, "read_by_library", counted)
    assert len(list(ls.frames(path))) == 3
    assert len(calls) == 1
    monkeypatch.setattr(usd, "AN_ANSWER", 0)
    one = usd.frames("a", str(path))
    assert (one["times"], len(one["points"])) == ([1, 3, 5], 1)
    np.testing.assert_array_equal(one["points"][0], ls.read(path).points)
    assert one["indices"].tolist() == [0, 1, 2]


def test_frames_end_before_one_that_is_broken(tmp_path):
    path = tmp_path / "a.usda"
    path.write_text((MOVING % "").replace("(3, 0, 0)", "(inf, 0, 0)"))
    found = ls.frames(path)
    assert next(found)[0] == 1
    with pytest.raises(ls.MeshError, match="coordinate inf is not finite"):
        next(found)


def test_frames_that_are_no_one_cage(tmp_path):
    path = tmp_path / "a.usda"
    change = "int[] faceVertexIndices.timeSamples = {1: [0, 1, 2], 3: [0, 2, 1]}"
    path.write_text((MOVING % change).replace("int[] faceVertexIndices = [0, 1, 2]", ""))
    with pytest.raises(ls.MeshError, match="at time 3 its faces are others than before"):
        list(ls.frames(path))
    with pytest.raises(ValueError, match="only USD and glTF files have frames"):
        list(ls.frames(tmp_path / "a.obj"))


CORNERS = "[(0, 0), (1, 0), (1, 1), (0, 1), (1, 0), (2, 0), (2, 1), (1, 1)]"


def test_left_handed_faces_are_turned_around(read):
    mesh = read(
        prim(f"""
    uniform token orientation = "leftHanded"
    int[] creaseIndices = [1, 2]
    int[] creaseLengths = [2]
    float[] creaseSharpnesses = [3]
    int[] holeIndices = [1]
    texCoord2f[] primvars:st = {CORNERS} (interpolation = "faceVarying")
""")
    )
    assert mesh.faces.tolist() == [[0, 3, 2, 1], [1, 2, 5, 4]]
    assert mesh.holes.tolist() == [1]
    assert mesh.creases[0].tolist() == [[1, 2]]
    values, rows, _ = mesh.channels["st"]
    assert values[rows].tolist() == mesh.points[mesh.indices, :2].tolist()


def test_left_handed_faces_of_many_sizes(tmp_path):
    cage = ls.Mesh(*zoo.ZOO["carved_prism"]())
    ls.write(tmp_path / "cage.usda", cage)
    stage = Usd.Stage.Open(str(tmp_path / "cage.usda"))
    UsdGeom.Gprim(stage.GetPrimAtPath("/mesh")).CreateOrientationAttr("leftHanded")
    stage.Save()
    faces = [[face[0], *face[:0:-1]] for face in zoo.ZOO["carved_prism"]()[1]]
    assert ls.read(tmp_path / "cage.usda").faces.tolist() == faces


# --- Where meshes stand

MOVED = """
        double3 xformOp:translate = (10, 20, 30)
        double3 xformOp:scale = (2, 3, 4)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
"""
MIRRORED = """
        double3 xformOp:scale = (-1, 1, 1)
        uniform token[] xformOpOrder = ["xformOp:scale"]
"""


def test_a_mesh_stands_where_its_transforms_put_it(read):
    mesh = read(group(prim(MOVED), body=MOVED.replace("(2, 3, 4)", "(1, 1, 2)")))
    expected = (np.array(POINTS) * [2, 3, 4] + [10, 20, 30]) * [1, 1, 2] + [10, 20, 30]
    assert mesh == ls.Mesh(expected, FACES)


@pytest.mark.parametrize("orientation", ["rightHanded", "leftHanded"])
@pytest.mark.parametrize("times", [1, 2])
def test_mirrored_meshes_keep_their_outside(read, orientation, times):
    body = f"uniform token orientation = '{orientation}'" + MIRRORED
    mesh = read(group(prim(body), body=MIRRORED if times == 2 else ""))
    assert mesh.points[:, 0].tolist() == [(-1) ** times * x for x, _, _ in POINTS]
    x, y, _ = mesh.points[mesh.uniform].T  # each (4, 2)
    area = np.sum(x * np.roll(y, -1, axis=0) - y * np.roll(x, -1, axis=0), axis=0)
    # As seen from above, unless the left hand rules.
    assert (np.sign(area) == (1 if orientation == "rightHanded" else -1)).all()


@pytest.mark.filterwarnings("ignore:.*boundary edges lie on another")
def test_a_flat_transform(read):
    body = MIRRORED.replace("(-1, 1, 1)", "(-1, 0, 1)")
    assert read(prim(body)).faces.tolist() == FACES


def test_names_of_prims_are_objects(read, tmp_path):
    """Whole paths where a name is there twice; they come back from a file of one mesh."""
    two = group(prim(name="lid")) + group(prim(name="lid") + prim(name="body"), "Other")
    mesh = read(two)
    assert mesh.face_data["object"].tolist()[::2] == ["/World/lid", "/Other/lid", "body"]
    for suffix in ".usda", ".obj":
        ls.write(tmp_path / f"a{suffix}", mesh)
        again = ls.read(tmp_path / f"a{suffix}")
        assert again.face_data["object"].tolist() == mesh.face_data["object"].tolist()
    assert ls.selected(mesh, {"object": "body"}).n_faces == 2


def test_several_meshes_become_one(read):
    tags = """
    int[] creaseIndices = [1, 2]
    int[] creaseLengths = [2]
    float[] creaseSharpnesses = [{0}]
    int[] cornerIndices = [{0}]
    float[] cornerSharpnesses = [1]
    int[] holeIndices = [0]
    token interpolateBoundary = "edgeOnly"
    texCoord2f[] primvars:st = [(0, 0), ({0}, 0)] (interpolation = "faceVarying")
    int[] primvars:st:indices = [0, 0, 1, 1, 0, 0, 1, 1]
    float[] primvars:once_{0} = [1, 1, 1, 1, 1, 1, 1, 1] (interpolation = "faceVarying")
"""
    with pytest.warns(UserWarning, match="'once_.': 2 of 4 faces have none, and are NaN there"):
        mesh = read(group(prim(tags.format(3) + MOVED, "b") + prim(tags.format(4), "a")))
    nan, ones, none = np.nan, [0, 1, 2, 3, 4, 5, 6, 7], [8] * 8
    moved = np.array(POINTS) * [2, 3, 4] + [10, 20, 30]
    assert mesh == ls.Mesh(
        [*moved.tolist(), *POINTS],
        [*FACES, [6, 7, 8, 9], [7, 10, 11, 8]],
        creases={(1, 2): 3, (7, 8): 4},
        corners={3: 1, 10: 1},
        holes=[0, 2],
        boundary="edge_only",
        channels={
            "st": (
                [[0, 0], [3, 0], [0, 0], [4, 0]],
                [0, 0, 1, 1, 0, 0, 1, 1, 2, 2, 3, 3, 2, 2, 3, 3],
                "corners_plus1",
            ),
            "once_3": ([1] * 8 + [nan], ones + none, "corners_plus1"),
            "once_4": ([1] * 8 + [nan], none + ones, "corners_plus1"),
        },
        face_data={"object": ["b", "b", "a", "a"]},
    )
    surface = ls.LimitSurface(mesh)
    assert np.isnan(surface.evaluate([0, 1, 2], 0.5, 0.5, channel="once_4")).tolist() == [
        True,
        True,
        True,
    ]
    assert surface.evaluate(3, 0.2, 0.5, channel="once_4") == 1


def test_a_default_agrees_with_the_same_said(read):
    mesh = read(
        prim("token interpolateBoundary = 'edgeAndCorner'", "a")
        + prim("uniform token subdivisionScheme = 'catmullClark'", "b")
        + prim("token triangleSubdivisionRule = 'catmullClark'", "c")
    )
    assert mesh.n_faces == 6
    assert mesh.boundary == "edge_and_corner"
    assert mesh.scheme == mesh.triangles == "catmull-clark"
    assert mesh.creasing is None


ST = "texCoord{n}f[] primvars:st = [{value}] (interpolation = '{interpolation}')\n"
ST += "int[] primvars:st:indices = [0, 0, 0, 0, 0, 0, 0, 0]\n"


@pytest.mark.parametrize(
    ("one", "other", "option", "message"),
    [
        (
            "token interpolateBoundary = 'none'",
            "",
            "boundary",
            "its meshes differ in boundary: 'none' (1: /a), 'edge_and_corner' (1: /b): choose",
        ),
        (
            "token triangleSubdivisionRule = 'smooth'",
            "",
            "triangles",
            "its meshes differ in triangles: 'smooth' (1: /a), 'catmull-clark' (1: /b): choose",
        ),
        (
            ST.format(n=2, value="(0, 1)", interpolation="faceVarying"),
            ST.format(n=2, value="(0, 1)", interpolation="faceVarying")
            + "token faceVaryingLinearInterpolation = 'all'",
            "st",
            "/b: channel 'st': interpolation: got 'all', but 'corners_plus1' in /a",
        ),
        (
            ST.format(n=2, value="(0, 1)", interpolation="faceVarying"),
            ST.format(n=2, value="(0, 1)", interpolation="vertex").replace("0, 0, 0]", "0]"),
            "st",
            "/b: channel 'st': interpolation: got 'none', but 'corners_plus1' in /a",
        ),
        (
            ST.format(n=2, value="(0, 1)", interpolation="faceVarying"),
            ST.format(n=3, value="(0, 1, 2)", interpolation="faceVarying"),
            "st",
            "/b: channel 'st': numbers of a value: got (3,), but (2,) in /a",
        ),
    ],
)
def test_meshes_that_differ(read, refused, one, other, option, message):
    text = prim(one, "a") + prim(other, "b")
    with pytest.warns(UserWarning, match=re.escape(message) + "|2 of 4 faces have none") as caught:
        mesh = read(text)
    assert message in str(caught[0].message)
    assert len(caught) == 1 + ("(3,)" in message)  # where one is left out, there is a gap
    assert mesh.n_faces == 4
    if option == "st":
        values, rows, mode = mesh.channels["st"]
        assert mode == "corners_plus1"
        assert values[rows][:8].tolist() == [[0, 1]] * 8
        lacking = np.isnan(values[rows][8:])
        assert lacking.all() if "(3,)" in message else not lacking.any()
    else:
        assert getattr(mesh, option) is None
    assert refused(text, strict=True).startswith(message)
    assert read(text, prim="/a").n_faces == read(text, prim="/b").n_faces == 2


def test_meshes_of_several_schemes(read, tmp_path):
    text = group(prim("uniform token subdivisionScheme = 'none'", "ground") + prim(name="box"))
    with pytest.warns(UserWarning, match=r"'none' \(1: /World/ground\), 'catmull-clark' \(1: "):
        mesh = read(text)
    assert mesh.scheme == "mixed"
    with pytest.raises(ValueError, match=r'with several schemes; .* say scheme="catmull-clark"'):
        ls.LimitSurface(mesh)
    assert len(ls.LimitSurface(mesh, scheme="catmull-clark").limit_faces) == 4
    with pytest.warns(UserWarning, match="of several schemes, .*: written as 'none'") as caught:
        ls.write(tmp_path / "again.usda", mesh)
    assert caught[0].filename == __file__
    assert ls.read(tmp_path / "again.usda").scheme == "none"
    path = str(tmp_path / "cage.usda")
    told = CliRunner().invoke(main, ["info", path])
    assert told.exit_code == 0
    assert "--scheme catmull-clark" in told.stdout
    assert "differ in scheme: 'none' (1: /World/ground)" in told.stderr
    assert "--prim PATH" in told.stderr
    assert re.search(r"scheme of /World/ground +none\nscheme of /World/box +catmull", told.stdout)
    found = {"/World/ground": "none", "/World/box": "catmull-clark"}
    for cage in ([path], ["-", "--from", "usda"]):
        said = CliRunner().invoke(main, ["info", *cage, "--json"], input=Path(path).read_bytes())
        assert json.loads(said.stdout)["schemes"] == found
    only = CliRunner().invoke(main, ["info", path, "--json", "--prim", "/World/box"])
    assert json.loads(only.stdout)["schemes"] is None
    chosen = CliRunner().invoke(main, ["info", path, "--scheme", "catmull-clark"])
    assert (chosen.exit_code, chosen.stderr) == (0, "")
    assert "limit faces" in chosen.stdout


def test_how_to_subdivide_all_the_same(tmp_path):
    scheme, reason = "none", "a mere mesh of polygons"
    path = str(tmp_path / "cage.usda")
    ls.write(path, ls.Mesh(POINTS, FACES, scheme=scheme))
    for command in "tessellate", "refine", "validate":
        done = CliRunner().invoke(main, [command, path])
        assert done.exit_code == 2
        assert reason in done.stderr
        assert "say --scheme catmull-clark" in done.stderr
    told = CliRunner().invoke(main, ["info", path])
    assert told.exit_code == 0
    assert re.search(rf"scheme +{scheme}\n", told.stdout)
    assert CliRunner().invoke(main, ["refine", path, "--scheme", "catmull-clark"]).exit_code == 0


def test_bilinear(tmp_path):
    path = tmp_path / "cage.usda"
    ls.write(path, ls.Mesh(POINTS, FACES, scheme="bilinear", creases={tuple(FACES[0][:2]): 3.0}))
    cage = ls.read(path)
    fine = ls.refined(cage, 2)
    assert np.array_equal(fine.points[: len(POINTS)], cage.points)
    there = ls.LimitSurface(cage).evaluate(fine.parent_face, fine.parent_u, fine.parent_v)
    assert np.allclose(there, fine.points, rtol=0, atol=1e-14)


def test_loop(tmp_path):
    path, out = str(tmp_path / "cage.usda"), str(tmp_path / "out.obj")
    points, faces = zoo.tetrahedron()
    ls.write(path, ls.Mesh(points, faces, scheme="loop"))
    surface = ls.LimitSurface(ls.read(path))
    wanted = ls.LimitSurface(ls.Mesh(points, faces), scheme="loop").evaluate(0, 0.2, 0.3)
    assert np.array_equal(surface.evaluate(0, 0.2, 0.3), wanted)
    for command in ["tessellate", path, "-o", out], ["refine", path, "-o", out], ["validate", path]:
        assert CliRunner().invoke(main, command).exit_code == 0
    ls.write(path, ls.Mesh(*zoo.cube(), scheme="loop"))
    done = CliRunner().invoke(main, ["refine", path, "-o", out])
    assert done.exit_code == 2
    assert "face 0 has 4 corners" in done.stderr


HIDDEN = {
    "invisible": prim("token visibility = 'invisible'", "hidden"),
    "below an invisible one": group(prim(name="hidden"), body="token visibility = 'invisible'"),
    "proxy": prim("uniform token purpose = 'proxy'", "hidden"),
    "guide": prim("uniform token purpose = 'guide'", "hidden"),
    "inactive": prim(name="hidden", head="active = false"),
    "class": prim(name="hidden").replace("def", "class"),
    "over": prim(name="hidden").replace("def", "over"),
}


@pytest.mark.parametrize("text", HIDDEN.values(), ids=HIDDEN)
def test_what_is_not_shown_is_not_read(read, refused, text):
    shown = prim("uniform token purpose = 'render'", "shown")
    assert read(text + shown).n_faces == 2
    message = "need a mesh of UsdGeom, found none that is shown in the stage"
    assert refused(text) == message


@pytest.mark.parametrize("text", [HIDDEN["invisible"], HIDDEN["proxy"]])
def test_what_is_not_shown_is_read_when_named(read, text):
    assert read(text, prim="/hidden").n_faces == 2


def test_a_part_of_a_stage(read, refused):
    text = group(group(prim(MOVED, "a"), "hand") + prim(name="b") + 'def Scope "empty" {}\n')
    moved = np.array(POINTS) * [2, 3, 4] + [10, 20, 30]
    assert read(text) == read(text, prim="/World") == read(text, prim="/")
    assert read(text).n_faces == 4
    assert read(text, prim="/World/hand") == read(text, prim="/World/hand/a")
    assert read(text, prim="/World/hand") == ls.Mesh(moved, FACES)
    assert refused(text, prim="/World/empty").endswith(
        "none that is shown at or below /World/empty"
    )
    for path in "/World/none", "World/none", "", "//", "/World/b.points", ".":
        with pytest.raises(
            ValueError, match=r"there is no prim '.*'; its meshes are /World/hand/a, /World/b$"
        ):
            read(text, prim=path)


def test_a_part_of_an_obj_file(tmp_path):
    ls.write(tmp_path / "cube.obj", ls.Mesh(*zoo.cube()))
    with pytest.raises(ValueError, match=r"cube\.obj: got prim '/cube', but only a USD file has"):
        ls.read(tmp_path / "cube.obj", prim="/cube")


def test_instances_and_references(tmp_path, read):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "quads.usda").write_text(
        '#usda 1.0\n(defaultPrim = "part")\n' + group(prim(), "part")
    )
    reference = 'def Xform "{}" (instanceable = true; references = @parts/quads.usda@) {{{}}}\n'
    mesh = read(reference.format("one", "") + reference.format("two", MOVED))
    moved = np.array(POINTS) * [2, 3, 4] + [10, 20, 30]
    assert mesh.points.tolist() == [*POINTS, *moved.tolist()]
    assert read(reference.format("two", MOVED), prim="/two/quads").points.tolist() == moved.tolist()


def instancer(body, name="scatter", prototypes="</scatter/a>, </scatter/b>", more=""):
    inside = prim(name="a") + group(prim(MOVED, "c"), "b", MOVED)
    head = f'def PointInstancer "{name}" {{\nrel prototypes = [{prototypes}]'
    return f"{head}\n{body}\n{inside}{more}}}\n"


INSTANCES = """
    int[] protoIndices = [0, 1, 0, 1, 0]
    point3f[] positions = [(0, 0, 0), (1, 2, 3), (4, 5, 6), (7, 8, 9), (-1, -2, -3)]
    quath[] orientations = [(1, 0, 0, 0), (0.5, 0.5, 0.5, 0.5), (0, 1, 0, 0),
        (-0.5, 0.5, -0.5, 0.5), (0, 0, 0, 0)]
    float3[] scales = [(1, 1, 1), (1, 2, 3), (2, 2, 2), (-1, 1, 1), (1, 1, -2)]
    int64[] ids = [10, 20, 30, 40, 50]
"""


def expected_instances(path):
    """The points (n, 6, 3) of the instances by USD's own matrices, prototype by prototype."""
    stage = Usd.Stage.Open(str(path))
    early = Usd.TimeCode.EarliestTime()
    scatter = UsdGeom.PointInstancer(stage.GetPrimAtPath("/World/scatter"))
    matrices = scatter.ComputeInstanceTransformsAtTime(early, early, applyMask=scatter.IgnoreMask)
    shown = scatter.ComputeMaskAtTime(early) or [True] * len(matrices)
    world = UsdGeom.Imageable(scatter).ComputeLocalToWorldTransform(early)
    below = UsdGeom.Xformable(stage.GetPrimAtPath("/World/scatter/b/c")).GetLocalTransformation()
    found = []
    for prototype, between in (0, None), (1, below):
        for index, matrix, is_shown in zip(
            scatter.GetProtoIndicesAttr().Get(), matrices, shown, strict=True
        ):
            if index == prototype and is_shown:
                whole = matrix * world if between is None else between * matrix * world
                found.append([list(whole.Transform(tuple(map(float, p)))) for p in POINTS])
    return np.array(found)


@pytest.mark.parametrize("hidden", ["", "int64[] invisibleIds = [20, 50]"])
def test_point_instancers(read, tmp_path, hidden):
    text = instancer(INSTANCES + hidden + MOVED).replace("/scatter/", "/World/scatter/")
    mesh = read(group(text, body=MOVED))
    expected = expected_instances(tmp_path / "cage.usda")
    assert len(expected) == (3 if hidden else 5)
    found = mesh.points.reshape(-1, 6, 3)
    assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()
    first = mesh.indices.reshape(-1, 2, 4)[0]
    assert first.tolist() == FACES
    # mirrored copies are turned around
    corners = mesh.indices.reshape(-1, 8) - 6 * np.arange(len(found))[:, None]
    turned = (corners[:, 1] != 1).tolist()
    assert turned == ([False, False, True] if hidden else [False, False, True, False, True])


def test_instances_of_instancers(read, tmp_path):
    """Two copies of three copies, of a part with tags and a channel, far below a mere "over"."""
    tags = """
    int[] creaseIndices = [1, 2]
    int[] creaseLengths = [2]
    float[] creaseSharpnesses = [3]
    int[] holeIndices = [1]
    texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1), (2, 0), (2, 1)] (
        interpolation = "vertex"
    )
"""
    text = f"""
    over "Prototypes" {{
        def PointInstancer "row" {{
            rel prototypes = </Prototypes/one>
            int[] protoIndices = [0, 0, 0]
            point3f[] positions = [(0, 0, 0), (3, 0, 0), (6, 0, 0)]
        }}
        def Mesh "one" {{{TWO_QUADS + tags}}}
    }}
    def PointInstancer "rows" {{
        rel prototypes = </Prototypes/row>
        int[] protoIndices = [0, 0]
        point3f[] positions.timeSamples = {{1: [(0, 0, 0), (0, 2, 0)], 3: [(0, 0, 8), (0, 2, 8)]}}
    }}
"""
    mesh = read(text)
    move = [[x, y, 0] for y in (0, 2) for x in (0, 3, 6)]
    assert (mesh.points.reshape(6, 6, 3) == np.array(POINTS) + np.array(move)[:, None]).all()
    shift = 6 * np.arange(6)[:, None, None]
    assert (mesh.indices.reshape(6, 2, 4) == np.array(FACES) + shift).all()
    assert mesh.creases[0].tolist() == [[1 + 6 * i, 2 + 6 * i] for i in range(6)]
    assert mesh.holes.tolist() == [1, 3, 5, 7, 9, 11]
    values, rows, _ = mesh.channels["st"]
    assert len(values) == 6
    assert (values[rows].reshape(6, 8, 2) == np.array(POINTS)[np.ravel(FACES), :2]).all()
    assert (read(text, time=2).points[:, 2] == 4).all()
    assert read(text, prim="/rows") == mesh


@pytest.mark.parametrize(
    ("change", "faces", "message"),
    [
        (("positions = [(0, 0, 0), ", "positions = ["), 2, "/s: positions: got 4, need 5, one for"),
        (
            ("protoIndices = [0, 1, 0, 1, 0]", "protoIndices = [0, 1, 7, -1, 0]"),
            8,
            "/s: instance 2 is of prototype 7, need 0 to 1; 1 more like it",
        ),
        (("(7, 8, 9)", "(nan, 8, 9)"), 10, "/s: instance 3 stands at no finite place"),
        (
            ("scales = [(1, 1, 1), ", "scales = ["),
            12,
            "/s: scales: got 4, need 5, one for each ins",
        ),
        (("ids = [10, ", "ids = ["), 12, "/s: ids: got 4, need 5, one for each instance"),
        (("</s/a>", "</s/none>"), 6, "/s: there is no prim /s/none for prototype 0: 3 instances"),
        (("</s/a>", "</s>"), 6, "/s: the point instancer is its own prototype"),
    ],
)
def test_broken_instancers(read, refused, change, faces, message):
    text = instancer(INSTANCES, "s", "</s/a>, </s/b>").replace(*change) + prim(name="sound")
    with pytest.warns(UserWarning, match=re.escape(message)):
        assert read(text).n_faces == faces
    assert refused(text, strict=True).startswith(message.partition(": 3 inst")[0])


def test_instancers_are_bounded(tmp_path, monkeypatch):
    path = tmp_path / "cage.usda"

    def read(text):  # in this process
        path.write_text("#usda 1.0\n" + text)
        return usd.read("cage.usda", str(path))

    monkeypatch.setattr("limitsurf.shell.io.usd_scene.MOST_CORNERS", 40)
    assert read(instancer(INSTANCES)).n_faces == 10
    text = instancer(INSTANCES, more=instancer("", "other", "</scatter/a>"))
    path = tmp_path / "other.usda"  # USD keeps the layer of a path
    assert read(text).n_faces == 10
    monkeypatch.setattr("limitsurf.shell.io.usd_scene.MOST_CORNERS", 39)
    path = tmp_path / "sound.usda"
    message = "/scatter: 5 instances make 40 corners of faces, which is more than 39"
    with pytest.raises(ls.MeshError, match=re.escape(message)):
        read(text + prim(name="sound"))


def test_the_earliest_time(read):
    mesh = read(
        prim("""
    float[] creaseSharpnesses.timeSamples = {2: [3], 1: [2.5]}
    int[] creaseIndices = [1, 2]
    int[] creaseLengths = [2]
    texCoord2f[] primvars:st.timeSamples = {
        5: [(1, 1), (2, 2), (3, 3), (4, 4), (5, 5), (6, 6)],
        9: [(0, 0), (0, 0), (0, 0), (0, 0), (0, 0), (0, 0)],
    }
    uniform token[] xformOpOrder = ["xformOp:translate"]
    double3 xformOp:translate.timeSamples = {-3: (0, 0, 0), -4: (1, 0, 0)}
    texCoord2f[] primvars:st (interpolation = "vertex")
""")
        .replace(
            "point3f[] points = [",
            "point3f[] points.timeSamples = {0: [(9, 9, 9)], -7: [",
        )
        .replace("(2, 1, 0)]", "(2, 1, 0)]}\n point3f[] points = [(8, 8, 8)]")
    )
    assert mesh.points.tolist() == [[x + 1, y, z] for x, y, z in POINTS]
    assert mesh.creases[1].tolist() == [2.5]
    assert mesh.channels["st"][0].tolist() == [[i, i] for i in range(1, 7)]


def test_a_frame(read, tmp_path):
    first, second = ("(0, 0, 0), (1, 0, 0), (1, 1, 0)".replace("0)", f"{z})") for z in (0, 8))
    text = f"""
    def Mesh "sheet" {{
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        point3f[] points.timeSamples = {{1: [{first}], 3: [{second}]}}
        float[] creaseSharpnesses.timeSamples = {{1: [1], 3: [5]}}
        int[] creaseIndices = [0, 1]
        int[] creaseLengths = [2]
        token visibility.timeSamples = {{1: "inherited", 9: "invisible"}}
        double3 xformOp:translate.timeSamples = {{1: (0, 0, 0), 3: (0, 0, 2)}}
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}
"""
    for time, z, sharpness in (None, 0, 1), (1, 0, 1), (2, 5, 3), (2.5, 7.5, 4), (3, 10, 5):
        mesh = read(text, time=time)
        assert mesh.points[:, 2].tolist() == [z] * 3
        assert mesh.creases[1].tolist() == [sharpness]
    with pytest.raises(ls.MeshError, match="found none that is shown"):
        read(text, time=9)
    for time in float("nan"), float("inf"), "2", [1]:
        with pytest.raises(ValueError, match=r"time: got .*, need a finite number"):
            read(text, time=time)
    cage = str(tmp_path / "cage.usda")
    done = CliRunner().invoke(main, ["convert", cage, str(tmp_path / "a.obj"), "--time", "3"])
    assert done.exit_code == 0
    assert ls.read(tmp_path / "a.obj").points[:, 2].tolist() == [10] * 3
    with pytest.raises(ValueError, match=r"got time 2, but only a USD file has frames"):
        ls.read(tmp_path / "a.obj", time=2)


# --- What is broken is located

MATTERS = {
    "points": "(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0), (2, 1, 0)",
    "counts": "int[] faceVertexCounts = [4, 4]",
    "indices": "[0, 1, 2, 3, 1, 4, 5, 2]",
}
BROKEN_MESHES = {
    ("points", ""): "need at least one of its points, got none",
    ("points", "(0, 0, 0)"): "face 0: vertex index ",
    ("points", "(nan, 0, 0)"): "vertex 0: coordinate nan is not finite",
    ("points", "(0, 0, inf)"): "vertex 0: coordinate inf is not finite",
    ("counts", ""): "need at least one of its faceVertexCounts, got none",
    ("counts", "int[] faceVertexCounts = []"): "need at least one of its faceVertexCounts",
    ("counts", "int[] faceVertexCounts = None"): "need at least one of its faceVertexCounts",
    ("counts", "int[] faceVertexCounts = [4]"): "faceVertexCounts add up to 4, but there are 8 ",
    ("counts", "int[] faceVertexCounts = [4, 5]"): "faceVertexCounts add up to 9, but there are 8",
    ("counts", "int[] faceVertexCounts = [9, -1]"): "face 1 has -1 corners, need three or more",
    ("counts", "int[] faceVertexCounts = [2, 2, 2, 2]"): "face 0 has 2 corners, need three or more",
    ("counts", "int[] faceVertexCounts = [2147483647, 2147483647]"): "faceVertexCounts add up to 4",
    (
        "counts",
        "float[] faceVertexCounts = [4, 4]",
    ): "faceVertexCounts: got FloatArray, need an array",
    (
        "counts",
        "string faceVertexCounts = '44'",
    ): "faceVertexCounts: got str, need an array of int",
    ("counts", "int faceVertexCounts = 4"): "faceVertexCounts: got int, need an array of integers",
    ("indices", "[]"): "faceVertexCounts add up to 8, but there are 0 faceVertexIndices",
    ("indices", "None"): "faceVertexCounts add up to 8, but there are 0 faceVertexIndices",
    ("indices", "[0, 1, 2, 6, 1, 4, 5, 2]"): "face 0: vertex index 6 is out of range, need 0 to 5",
    ("indices", "[0, 1, 2, -3, 1, 4, 5, 2]"): "face 0: vertex index -3 is negative, need 0 to 5",
}


@pytest.mark.parametrize(("change", "message"), BROKEN_MESHES.items())
@pytest.mark.parametrize("orientation", ["rightHanded", "leftHanded"])
def test_broken_meshes(read, refused, change, message, orientation):
    text = prim(f"uniform token orientation = '{orientation}'", "b")
    text = text.replace(MATTERS[change[0]], change[1])
    assert refused(text).startswith("/b: " + message)
    assert refused(text, strict=True).startswith("/b: " + message)
    both = group(prim(name="a") + text)
    assert refused(both, strict=True).startswith("/World/b: " + message)
    with pytest.warns(UserWarning, match=re.escape(f"/World/b: {message}")) as caught:
        assert read(both) == ls.Mesh(POINTS, FACES)
    assert str(caught[0].message).endswith("the mesh is left out")


CREASE = "int[] creaseIndices = {}\nint[] creaseLengths = {}\nfloat[] creaseSharpnesses = {}\n"
CORNER = "int[] cornerIndices = {}\nfloat[] cornerSharpnesses = {}\n"
VARYING = "float2[] primvars:st = {} (interpolation = '{}')\n"
INDEXED = VARYING + "int[] primvars:st:indices = {}\n"
BROKEN_TAGS = {
    CREASE.format("[0, 2]", "[2]", "[1]"): "crease (0, 2): the mesh has no such edge",
    CREASE.format("[0, 1, 2, 4]", "[4]", "[1]"): "crease (2, 4): the mesh has no such edge",
    CREASE.format("[0, 7]", "[2]", "[1]"): "crease (0, 7): the mesh has no such edge",
    CREASE.format("[0, -1]", "[2]", "[1]"): "crease (-1, 0): the mesh has no such edge",
    CREASE.format("[0, 0]", "[2]", "[1]"): "crease (0, 0): the mesh has no such edge",
    CREASE.format("[0, 1]", "[2]", "[-1]"): "crease (0, 1): sharpness -1.0 is not in [0, inf]",
    CREASE.format("[0, 1]", "[2]", "[nan]"): "crease (0, 1): sharpness nan is not in [0, inf]",
    CREASE.format("[0, 1]", "[2]", "[]"): "creaseSharpnesses: got 0, need 1, one for each crease, ",
    CREASE.format("[0, 1, 2, 3]", "[4]", "[1, 2]"): "creaseSharpnesses: got 2, need 1, one for "
    "each crease, or 3, one for each edge",
    CREASE.format("[0, 1]", "[1, 1]", "[1, 1]"): "creaseLengths: crease 0 has 1, need two or more",
    CREASE.format("[0, 1]", "[3, -1]", "[1, 1]"): "creaseLengths: crease 1 has -1, need two or mo",
    CREASE.format("[0, 1]", "[3]", "[1]"): "creaseLengths add up to 3, but there are 2 creaseInd",
    CREASE.format("[0, 1]", "[]", "[]"): "creaseLengths add up to 0, but there are 2 creaseIndices",
    CREASE.format("[]", "[2]", "[1]"): "creaseLengths add up to 2, but there are 0 creaseIndices",
    "float[] creaseIndices = [0, 1]": "creaseIndices: got FloatArray, need an array of",
    CORNER.format("[6]", "[1]"): "corner 6 is out of range, need 0 to 5",
    CORNER.format("[-1]", "[1]"): "corner -1 is out of range, need 0 to 5",
    CORNER.format("[1]", "[-2]"): "corner 1: sharpness -2.0 is not in [0, inf]",
    CORNER.format("[1]", "[]"): "cornerSharpnesses: got 0, need 1, one for each of cornerIndices",
    CORNER.format("[]", "[1]"): "cornerSharpnesses: got 1, need 0, one for each of cornerIndices",
    "int[] holeIndices = [2]": "hole 2 is out of range, need 0 to 1",
    "int[] holeIndices = [-1]": "hole -1 is out of range, need 0 to 1",
    "uniform token subdivisionScheme = 'butterfly'": "subdivisionScheme: got 'butterfly', need one "
    "of catmullClark, loop, bilinear, none",
    "token interpolateBoundary = 'edge_only'": "interpolateBoundary: got 'edge_only', need one of",
    "int interpolateBoundary = 1": "interpolateBoundary: got 1, need one of edgeAndCorner, edgeOnl",
    "int[] interpolateBoundary = [1]": "interpolateBoundary: got Vt.IntArray(1, (1,)), need one of",
    "token triangleSubdivisionRule = ''": "triangleSubdivisionRule: got '', need one of catmullCl",
    "token faceVaryingLinearInterpolation = 'x'": "faceVaryingLinearInterpolation: got 'x', need o",
    "uniform token orientation = 'up'": "orientation: got 'up', need one of rightHanded, leftHand",
    VARYING.format("[(0, 0)]", "faceVarying"): "primvars:st: got 1 values, need 8, one for each "
    "corner of a face",
    VARYING.format("[]", "vertex"): "primvars:st: got 0 values, need 6, one for each point",
    INDEXED.format("[(0, 0)]", "faceVarying", "[0, 0]"): "primvars:st: got 2 indices, need 8, one ",
    INDEXED.format("[(0, 0)]", "faceVarying", "[0, 0, 0, 0, 0, 0, 1, 0]"): "primvars:st: got index "
    "1, need 0 to 0",
    INDEXED.format("[(0, 0)]", "vertex", "[0, 0, 0, 0, 0, -1]"): "primvars:st: got index -1, need ",
}


@pytest.mark.parametrize(("text", "message"), BROKEN_TAGS.items())
def test_broken_tags(read, refused, text, message):
    with pytest.warns(UserWarning, match=re.escape(f"cage.usda, /quads: {message}")) as caught:
        mesh = read(prim(text))
    assert len(caught) == 1
    assert str(caught[0].message).endswith(": left out")
    creases = {(0, 1): 1, (1, 2): 1} if "[0, 1, 2, 4]" in text else {}
    assert mesh == ls.Mesh(POINTS, FACES, creases=creases)
    assert refused(prim(text), strict=True).startswith("/quads: " + message)
    with pytest.warns(UserWarning, match=r"; 2 more like it: /b, /c$"):
        assert read(prim(text, "a") + prim(text, "b") + prim(text, "c")).n_faces == 6


def test_sound_tags_stay_beside_broken_ones(read):
    text = CREASE.format("[0, 1, 0, 7, 1, 2, 1, 4, 3, 9]", "[2, 2, 2, 2, 2]", "[10, 3, nan, 2, 1]")
    text += CORNER.format("[5, 6, 0]", "[1, 2, -1]") + "uint[] holeIndices = [1, 2]\n"
    with pytest.warns(UserWarning, match="left out") as caught:
        mesh = read(prim(text))
    tags = {"creases": {(0, 1): 10, (1, 4): 2}, "corners": {5: 1}, "holes": [1]}
    assert mesh == ls.Mesh(POINTS, FACES, **tags)
    assert [str(one.message).partition("/quads: ")[2] for one in caught] == [
        "crease (0, 7): the mesh has no such edge; 1 more like it: left out",
        "crease (1, 2): sharpness nan is not in [0, inf]: left out",
        "corner 6 is out of range, need 0 to 5: left out",
        "corner 0: sharpness -1.0 is not in [0, inf]: left out",
        "hole 2 is out of range, need 0 to 1: left out",
    ]


@pytest.mark.parametrize("kind", ["uint", "int64", "uint64", "uchar"])
def test_integers_of_other_types(read, kind):
    text = prim("int[] holeIndices = [1]").replace("int[]", f"{kind}[]")
    assert read(text) == ls.Mesh(POINTS, FACES, holes=[1])


def test_small_faces_are_left_out(read, refused):
    text = prim("""
    int[] holeIndices = [1, 3]
    float[] primvars:st = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9] (interpolation = "faceVarying")
""")
    text = text.replace("[4, 4]", "[4, 2, 0, 4]").replace("3, 1, 4, 5, 2]", "3, 0, 1, 1, 4, 5, 2]")
    with pytest.warns(UserWarning, match="face 1 has 2 corners, which enclose nothing; 1 more"):
        mesh = read(text)
    assert mesh.faces.tolist() == FACES
    assert mesh.holes.tolist() == [1]
    assert mesh.channels["st"][0][mesh.channels["st"][1]].tolist() == [0, 1, 2, 3, 6, 7, 8, 9]
    assert refused(text, strict=True).startswith("/quads: face 1 has 2 corners")


def test_points_that_no_face_uses(read, refused):
    text = prim(MOVED).replace("(2, 1, 0)]", "(2, 1, 0), (nan, 0, 0), (0, inf, 0)]")
    with pytest.warns(UserWarning, match="point 6 is not finite, but in no face; 1 more like it"):
        mesh = read(text)
    assert mesh.points[:6].tolist() == (np.array(POINTS) * [2, 3, 4] + [10, 20, 30]).tolist()
    assert np.isfinite(mesh.points).all()
    assert mesh.n_vertices == 8
    assert refused(text, strict=True).startswith("/quads: point 6 is not finite")


@pytest.mark.parametrize(
    ("scale", "message"),
    [
        ("(2, nan, 4)", "vertex 0: coordinate nan is not finite in its place; 5 more"),
        ("(1e308, 1, 4)", "vertex 4: coordinate inf is not finite in its place; 1 more"),
    ],
)
def test_places_that_are_none(read, refused, scale, message):
    text = prim(MOVED.replace("(2, 3, 4)", scale), "b")
    assert refused(text).startswith("/b: " + message)
    with pytest.warns(UserWarning, match="the mesh is left out"):
        assert read(prim(name="a") + text) == ls.Mesh(POINTS, FACES)


def test_values_that_are_none(read, refused):
    text = prim(VARYING.format("[(0, 0), (0, 0), (0, nan), (0, 0), (0, 0), (0, 0)]", "vertex"))
    assert np.isnan(read(text, strict=True).channels["st"][0]).sum() == 1
    with pytest.warns(UserWarning, match="primvars:st: value 2 is infinite: NaN"):
        assert np.isnan(read(text.replace("nan", "inf")).channels["st"][0]).sum() == 1


def test_broken_note_on_creasing(read, refused):
    for note in "string creasing = 'sharp'", "int creasing = 3", "int[] creasing = [1, 2]":
        text = prim(head=f"customData = {{dictionary limitsurf = {{{note}}}}}")
        with pytest.warns(UserWarning, match="/quads: creasing: got "):
            assert read(text) == ls.Mesh(POINTS, FACES)
        assert refused(text, strict=True).startswith("/quads: creasing: got ")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "need a mesh of UsdGeom, found none that is shown in the stage"),
        ('def Sphere "ball" {}', "need a mesh of UsdGeom, found none that is shown in the stage"),
        ('def Mesh "quads" {', "line 2: "),
        ("\n\n}", "line 4: "),
        (prim("point3f[] points = [(0, 0, 0), (1, 0)]"), ""),
        (prim("texCoord2f[] primvars:st = [(0, 0), (1, 0]"), "line "),
        (prim("int[] holeIndices = [1 2]"), "line 6"),
        ('def Mesh "\udcff" {', "line "),
    ],
)
def test_broken_texts(tmp_path, text, message):
    path = tmp_path / "cage.usda"
    path.write_bytes(b"#usda 1.0\n" + text.encode(errors="surrogateescape"))
    with pytest.raises(ls.MeshError) as caught:
        ls.read(path)
    after = str(caught.value).partition("cage.usda")[2]
    assert after.lstrip(",: ").startswith(message)
    assert "\n" not in after
    assert "::" not in after
    assert "SDF_FORMAT_ARGS" not in after


@pytest.mark.parametrize("suffix", [".usd", ".usda", ".usdc", ".usdz"])
@pytest.mark.parametrize(
    "data", [b"", b"#sdf 1\n", b"\x89PNG\r\n\x1a\n", b"PXR-USDC\0\1\0\0" * 99, b"PK\3\4" * 99]
)
def test_files_of_another_kind(tmp_path, suffix, data):
    path = tmp_path / f"cage{suffix}"
    path.write_bytes(data)
    with pytest.raises(ls.MeshError, match=rf"cage\{suffix}(, line 1)?: "):
        ls.read(path)


@pytest.mark.parametrize("seed", range(100))
def test_noise_is_refused_or_read_but_nothing_else(tmp_path, seed):
    """Bytes of a good text changed, cut or doubled at random: a mesh, or a MeshError."""
    g = random.Random(seed)
    text = prim(CREASE.format("[0, 1, 2]", "[3]", "[1]") + CORNER.format("[3]", "[2]"))
    data = bytearray(("#usda 1.0\n" + text).encode())
    for _ in range(g.randrange(1, 8)):
        at = g.randrange(len(data))
        change = g.randrange(3)
        if change == 0:
            data[at] = g.choice(b" \n()[]\"'{}=:,.-+0123456789abc\x00\xff")
        elif change == 1:
            del data[at : at + g.randrange(10)]
        else:
            data[at:at] = data[at : at + g.randrange(10)]
    path = tmp_path / "noise.usda"
    path.write_bytes(data)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=r".*noise\.usda[:,] ")
        try:
            assert np.isfinite(ls.read(path).points).all()
        except ls.MeshError as error:
            message = str(error)
        else:
            return
    assert "noise.usda" in message


def test_what_usd_warns_of(read):
    with pytest.warns(UserWarning, match=r"cage\.usda: .*none\.usda") as caught:
        assert read(prim(head="references = @none.usda@</a>")).n_faces == 2
    assert caught[0].filename == __file__
    assert "SDF_FORMAT_ARGS" not in str(caught[0].message)
    with pytest.raises(ls.MeshError, match=r"cage\.usda: .*none\.usda"):
        read(prim(head="references = @none.usda@</a>"), strict=True)


def test_files_that_are_none(tmp_path):
    (tmp_path / "folder.usda").mkdir()
    for name in "none.usda", "folder.usda":
        with pytest.raises(OSError, match=name):
            ls.read(tmp_path / name)
    with pytest.raises(ValueError, match=r"a\.usdz: unknown suffix '\.usdz', need one of \.obj, "):
        ls.write(tmp_path / "a.usdz", ls.Mesh(*zoo.cube()))
    with pytest.raises(OSError, match=r"cube\.usdc"):
        ls.write(tmp_path / "none" / "cube.usdc", ls.Mesh(*zoo.cube()))
    assert os.listdir(tmp_path) == ["folder.usda"]


@pytest.mark.parametrize(
    ("head", "units", "up"),
    [
        ('upAxis = "Z"\nmetersPerUnit = 0.001', 0.001, "z"),
        ('upAxis = "Y"', None, "y"),
        ("metersPerUnit = 1", 1.0, None),
        ("", None, None),
    ],
)
def test_units_and_up_axis(read, tmp_path, head, units, up):
    mesh = read(f"({head})\n" + prim(MOVED))
    assert (mesh.units, mesh.up) == (units, up)
    tessellation = ls.tessellate(ls.LimitSurface(mesh), 2)
    fine = ls.refined(mesh, 1)
    for x in mesh, fine, tessellation, fine.with_points(fine.points + 1):
        assert (x.units, x.up) == (units, up)
        ls.write(tmp_path / "again.usda", x)
        stage = Usd.Stage.Open(str(tmp_path / "again.usda"))
        assert UsdGeom.StageHasAuthoredMetersPerUnit(stage) == (units is not None)
        assert stage.HasAuthoredMetadata("upAxis") == (up is not None)
        if units is not None:
            assert UsdGeom.GetStageMetersPerUnit(stage) == units
        if up is not None:
            assert UsdGeom.GetStageUpAxis(stage) == up.upper()


@pytest.mark.parametrize("units", [0.01, 0.0254, 1e-300, 1e300, float(np.float32(1e-30))])
def test_units_come_back(tmp_path, units):
    mesh = ls.Mesh(*zoo.cube(), units=units)
    ls.write(tmp_path / "cube.usda", mesh)
    assert ls.read(tmp_path / "cube.usda").units == pytest.approx(units, rel=1e-7)


@pytest.mark.parametrize(
    ("head", "message"),
    [
        ('upAxis = "X"', "upAxis: got 'X', need 'Y' or 'Z'"),
        ("metersPerUnit = 0", "metersPerUnit: got 0.0, need a positive number"),
        ("metersPerUnit = -1", "metersPerUnit: got -1.0, need"),
        ("metersPerUnit = nan", "metersPerUnit: got nan, need"),
        ("metersPerUnit = inf", "metersPerUnit: got inf, need"),
    ],
)
def test_bad_units_and_up_axes(read, refused, head, message):
    with pytest.warns(UserWarning, match=re.escape(message)):
        assert read(f"({head})\n" + prim()) == ls.Mesh(POINTS, FACES)
    assert refused(f"({head})\n" + prim(), strict=True).startswith(message)


@pytest.mark.parametrize("start", [*range(0, 60, 10), 1210])
def test_damage_of_all_kinds_together(tmp_path, start):
    """The sound mesh is read whatever is beside it; where there is a warning, strict refuses."""
    path = str(tmp_path / "damaged.usdc")
    for seed in range(start, start + 10):
        stage = usd_damage.damaged_stage(random.Random(seed))
        stage.GetRootLayer().Export(path)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            mesh = ls.read(path)
        assert (mesh.points == [100, 100, 100]).all(axis=1).any()
        harmless = r"differ in scheme|have none, and are NaN|no place for all"
        damage = [one for one in caught if not re.search(harmless, str(one.message))]
        assert all(one.category is UserWarning for one in caught)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with pytest.raises(ls.MeshError, match="damaged") if damage else nullcontext():
                ls.read(path, strict=True)


# --- Writing


def rounded(mesh):
    """The same with the numbers of a USD file."""

    def single(values):
        return np.asarray(values, dtype=np.float32).astype(np.float64)

    return ls.Mesh(
        single(mesh.points),
        (mesh.sizes, mesh.indices),
        creases=(mesh.creases[0], single(mesh.creases[1])),
        corners=(mesh.corners[0], single(mesh.corners[1])),
        holes=mesh.holes,
        scheme=mesh.scheme,
        boundary=mesh.boundary,
        creasing=mesh.creasing,
        triangles=mesh.triangles,
        units=mesh.units,
        up=mesh.up,
        channels={
            name: (single(values), rows, mode)
            for name, (values, rows, mode) in mesh.channels.items()
        },
    )


def same(tmp_path, mesh, suffix=".usda"):
    path = tmp_path / f"again{suffix}"
    ls.write(path, mesh)
    assert ls.read(path) == rounded(mesh)
    return path


@pytest.mark.parametrize("suffix", [".usd", ".usda", ".usdc", ".USDA"])
@pytest.mark.parametrize("name", zoo.ZOO)
def test_the_zoo_comes_back(tmp_path, name, suffix):
    same(tmp_path, ls.Mesh(*zoo.ZOO[name]()), suffix)


@pytest.mark.parametrize("path", sorted(CAGES.glob("*.obj")), ids=lambda path: path.stem)
@pytest.mark.filterwarnings("ignore:.*left out. files of materials")
def test_cages_of_others_come_back(tmp_path, path):
    same(tmp_path, ls.read(path).with_tags(face_data=None), ".usdc")


def test_suffixes_name_the_format(tmp_path):
    begin = {".usd": b"PXR-USDC", ".usda": b"#usda 1.0", ".usdc": b"PXR-USDC"}
    for suffix, expected in begin.items():
        path = same(tmp_path, ls.Mesh(*zoo.cube()), suffix)
        assert path.read_bytes().startswith(expected)


@given(st.data())
def test_random_tagged_cages_come_back(tmp_path_factory, data):
    points, faces = data.draw(zoo.cages(max_steps=3))
    mesh = ls.Mesh(points, faces)
    sharpness = st.floats(0, allow_nan=False, width=32)
    finite = st.floats(allow_nan=False, allow_infinity=False, width=32)
    edges = st.sampled_from(list(map(tuple, mesh.edges.tolist())))
    vertices = st.integers(0, mesh.n_vertices - 1)
    seams = data.draw(st.sampled_from(INTERPOLATION))
    channels = {}
    for name in data.draw(st.sets(st.sampled_from(["uv", "st", "a:b", "\u00fc"]))):
        shape = data.draw(st.sampled_from([(), (2,), (3,), (4,)]))
        if data.draw(st.booleans()):  # a value for each vertex
            count, rows = mesh.n_vertices, mesh.indices
            mode = data.draw(st.sampled_from(["all", "none", seams]))
        else:
            count = data.draw(st.integers(1, 5))
            rows, mode = np.arange(mesh.n_corners) ** 2 % count, seams
        values = data.draw(st.lists(finite, min_size=4, max_size=4))
        channels[name] = (np.resize(values, (count, *shape)), rows, mode)
    tagged = ls.Mesh(
        mesh.points * data.draw(st.floats(-1e30, 1e30)),
        faces,
        creases=data.draw(st.dictionaries(edges, sharpness, max_size=3)),
        corners=data.draw(st.dictionaries(vertices, sharpness, max_size=3)),
        holes=sorted(data.draw(st.sets(st.integers(0, mesh.n_faces - 1), max_size=3))),
        scheme=data.draw(st.sampled_from([None, "catmull-clark", "loop", "bilinear", "none"])),
        boundary=data.draw(st.sampled_from([None, "none", "edge_only", "edge_and_corner"])),
        creasing=data.draw(st.sampled_from([None, "uniform", "chaikin"])),
        triangles=data.draw(st.sampled_from([None, "catmull-clark", "smooth"])),
        units=data.draw(st.sampled_from([None, 0.01, 1, 1e-300])),
        up=data.draw(st.sampled_from([None, "y", "z"])),
        channels=channels,
    )
    same(tmp_path_factory.mktemp("again"), tagged, data.draw(suffixes))


suffixes = st.sampled_from([".usd", ".usda", ".usdc"])

FULL = ls.Mesh(
    POINTS,
    FACES,
    creases={(0, 1): np.inf, (2, 1): 0.1},
    corners={2: 3},
    holes=[0],
    scheme="loop",
    boundary="edge_only",
    creasing="chaikin",
    triangles="smooth",
    channels={
        "uv": ([[0, 0.5], [1, 0.1]], [0, 1, 1, 1, 0, 0, 0, 0], "boundaries"),
        "heat": (range(6), [0, 1, 2, 3, 1, 4, 5, 2], "none"),
        "flat": (range(6), [0, 1, 2, 3, 1, 4, 5, 2], "all"),
    },
)


def test_text(tmp_path):
    text = same(tmp_path, FULL).read_text()
    assert [line.strip() for line in text.splitlines() if line.strip()] == [
        "#usda 1.0",
        "(",
        'defaultPrim = "mesh"',
        ")",
        'def Mesh "mesh" (',
        "customData = {",
        "dictionary limitsurf = {",
        'string creasing = "chaikin"',
        "}",
        "}",
        ")",
        "{",
        "int[] cornerIndices = [2]",
        "float[] cornerSharpnesses = [3]",
        "int[] creaseIndices = [0, 1, 1, 2]",
        "int[] creaseLengths = [2, 2]",
        "float[] creaseSharpnesses = [inf, 0.1]",
        "float3[] extent = [(0, 0, 0), (2, 1, 0)]",
        'token faceVaryingLinearInterpolation = "boundaries"',
        "int[] faceVertexCounts = [4, 4]",
        "int[] faceVertexIndices = [0, 1, 2, 3, 1, 4, 5, 2]",
        "int[] holeIndices = [0]",
        'token interpolateBoundary = "edgeOnly"',
        "point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0), (2, 1, 0)]",
        "float[] primvars:flat = [0, 1, 2, 3, 4, 5] (",
        'interpolation = "varying"',
        ")",
        "float[] primvars:heat = [0, 1, 2, 3, 4, 5] (",
        'interpolation = "vertex"',
        ")",
        "texCoord2f[] primvars:uv = [(0, 0.5), (1, 0.1)] (",
        'interpolation = "faceVarying"',
        ")",
        "int[] primvars:uv:indices = [0, 1, 1, 1, 0, 0, 0, 0]",
        'uniform token subdivisionScheme = "loop"',
        'token triangleSubdivisionRule = "smooth"',
        "}",
    ]


def test_a_plain_mesh_leaves_all_choices_open(tmp_path):
    path = same(tmp_path, ls.Mesh(POINTS, FACES))
    stage = Usd.Stage.Open(str(path))
    written = UsdGeom.Mesh(stage.GetDefaultPrim())
    authored = {attribute.GetName() for attribute in written.GetPrim().GetAuthoredAttributes()}
    assert authored == {"points", "extent", "faceVertexCounts", "faceVertexIndices"}
    assert UsdGeom.Mesh.ValidateTopology(
        written.GetFaceVertexIndicesAttr().Get(), written.GetFaceVertexCountsAttr().Get(), 6
    )


def test_exact_points_are_rounded(tmp_path):
    points = np.array([[Fraction(1, 3), 0, 0], [1, 0, 0], [0, 2**60 + 1, 0]], dtype=object)
    mesh = ls.Mesh(points, [[0, 1, 2]], creases={(0, 1): Fraction(5, 2), (1, 2): Fraction(1, 3)})
    again = ls.read(same(tmp_path, mesh))
    third = float(np.float32(1 / 3))
    assert again.points.tolist() == [[third, 0, 0], [1, 0, 0], [0, 2.0**60, 0]]
    assert again.creases[1].tolist() == [2.5, third]


def test_sharpness_stays_on_its_side_of_infinite(tmp_path):
    sharpness = [np.nextafter(10, 0), 10, 1e300, np.inf]
    path = tmp_path / "sharp.usdc"
    for corners in (
        dict(enumerate(sharpness)),
        {0: 10 - Fraction(1, 10**30), 1: 10, 2: 10**400, 3: np.inf},
    ):
        ls.write(path, ls.Mesh(POINTS, FACES, corners=corners))
        below, *infinite = ls.read(path).corners[1].tolist()
        assert 10 - 1e-6 < below < 10
        assert infinite == [10, np.inf, np.inf]


def test_colours_have_their_type(tmp_path):
    mesh = ls.Mesh(POINTS, FACES, channels={"displayColor": ([[1, 0, 0]], [0] * 8, "all")})
    stage = Usd.Stage.Open(str(same(tmp_path, mesh)))
    (primvar,) = UsdGeom.PrimvarsAPI(stage.GetDefaultPrim()).GetAuthoredPrimvars()
    assert primvar.GetTypeName() == Sdf.ValueTypeNames.Color3fArray


TRIANGLE = (np.zeros((3, 3)), [[0, 1, 2]])


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (ls.Mesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]]), r"shape \(3, 2\), need \(n_vertices, 3\)"),
        (ls.Mesh([[10**400, 0, 0]] * 3, [[0, 1, 2]]), "a coordinate is beyond float64"),
        (
            ls.Mesh([[1e39, 0, 0]] * 3, [[0, 1, 2]]),
            "a coordinate is beyond float32, in which a USD",
        ),
        (
            ls.Mesh(*TRIANGLE, scheme=object()),
            "scheme: a USD file holds one of 'catmull-clark', 'l",
        ),
        (ls.Mesh(*TRIANGLE, scheme="butterfly"), "scheme: .*, 'bilinear', 'none', got 'butterfly'"),
        (
            ls.Mesh(*TRIANGLE, channels={"a b": ([[0, 0]], [0] * 3, "all")}),
            r"channel 'a b' of shape \(1, 2\): a USD file holds channels of shape .* identifiers",
        ),
        (
            ls.Mesh(*TRIANGLE, channels={"st:indices": ([[0, 0]], [0] * 3, "all")}),
            "channel 'st:indices' of shape",
        ),
        (
            ls.Mesh(*TRIANGLE, channels={"st": ([[0]], [0] * 3, "all")}),
            r"channel 'st' of shape \(1, 1\): a USD file",
        ),
        (
            ls.Mesh(*TRIANGLE, channels={"st": ([0, 1e39], [0, 1, 0], "all")}),
            "channel 'st': a value is beyond float32",
        ),
        (
            ls.Mesh(*TRIANGLE, channels={"st": ([0, 10**400], [0, 1, 0], "all")}),
            "channel 'st': a value is beyond float32",
        ),
    ],
)
@pytest.mark.parametrize("suffix", [".usda", ".usdc"])
def test_what_a_usd_file_cannot_hold(tmp_path, mesh, message, suffix):
    path = tmp_path / f"old{suffix}"
    path.write_text("old")
    with pytest.raises(ValueError, match=message):
        ls.write(path, mesh)
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == [path.name]


def test_seams_of_several_interpolations(tmp_path):
    channels = {"a": ([0], [0] * 3, "all"), "b": ([0, np.nan], [0, 1, 0], "boundaries")}
    with pytest.warns(UserWarning, match="one interpolation for all its seams, got .* as 'all'"):
        ls.write(tmp_path / "a.usda", ls.Mesh(*TRIANGLE, channels=channels))
    again = ls.read(tmp_path / "a.usda").channels
    assert {name: mode for name, (_, _, mode) in again.items()} == {"a": "all", "b": "all"}
    assert np.isnan(again["b"][0]).tolist() == [False, True]


def test_a_file_is_replaced_whole(tmp_path):
    path = tmp_path / "cube.usdc"
    ls.write(path, ls.Mesh(*zoo.torus(5, 5)))
    ls.write(path, ls.Mesh(*zoo.cube()))
    assert ls.read(os.fsencode(path)) == ls.Mesh(*zoo.cube())
    assert os.listdir(tmp_path) == ["cube.usdc"]


def test_a_full_disk(tmp_path, monkeypatch):
    (tmp_path / "full").write_text("")
    monkeypatch.setattr("tempfile.TemporaryDirectory", lambda: nullcontext(str(tmp_path / "full")))
    with pytest.raises(OSError, match="full"):
        ls.write(tmp_path / "cube.usdc", ls.Mesh(*zoo.cube()))
    assert os.listdir(tmp_path) == ["full"]


@pytest.mark.parametrize("suffix", [".usda", ".usdc"])
def test_the_file_is_read_though_a_stage_has_it_open(tmp_path, suffix):
    path = tmp_path / f"cube{suffix}"
    ls.write(path, ls.Mesh(POINTS, FACES))
    stage = Usd.Stage.Open(str(path))
    points = UsdGeom.Mesh(stage.GetDefaultPrim()).GetPointsAttr()
    points.Set(Vt.Vec3fArray(6))
    ls.write(path, ls.Mesh(*zoo.cube()))
    assert ls.read(path) == ls.Mesh(*zoo.cube())
    assert points.Get() == Vt.Vec3fArray(6)


def test_names_with_special_characters(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in "a b.usda", "a[1].usdc", "\u00fc?#.usd", "a@b.usda":
        ls.write(name, FULL)
        assert ls.read(name) == rounded(FULL)


def test_packages(tmp_path):
    ls.write(tmp_path / "full.usdc", FULL)
    package = str(tmp_path / "full.usdz")
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "full.usdc"), package)
    assert ls.read(package) == rounded(FULL)


# --- Around it


def test_the_command_line_reads_usd(tmp_path):
    path = str(tmp_path / "cube.usda")
    ls.write(path, ls.Mesh(*zoo.cube()))
    result = CliRunner().invoke(main, ["info", path])
    assert result.exit_code == 0
    assert "limit faces" in result.output


def test_the_command_line_is_strict_when_told(tmp_path):
    path = tmp_path / "cage.usda"
    path.write_text("#usda 1.0\n" + prim("int[] holeIndices = [7]"))
    message = f"{path}, /quads: hole 7 is out of range, need 0 to 1"
    for command in ["info"], ["refine", "-o", str(tmp_path / "fine.obj")]:
        done = CliRunner().invoke(main, [*command, str(path)])
        assert (done.exit_code, done.stderr) == (0, f"limitsurf: warning: {message}: left out\n")
        done = CliRunner().invoke(main, [*command, str(path), "--strict"])
        assert (done.exit_code, done.stderr) == (2, f"limitsurf: error: {message}\n")


def test_why_there_is_no_mesh(refused):
    text = instancer(INSTANCES.replace("(0, 0, 0), ", "", 1))
    message = refused(text)
    assert message.startswith("need a mesh of UsdGeom, found none that is shown in the stage; ")
    assert "/scatter: positions: got 4, need 5" in message
