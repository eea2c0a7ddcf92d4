"""Cages to and from USD: what is written is read, what others write means what it means there."""

import os
import random
import sys
import warnings
from contextlib import nullcontext
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import zoo
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from pxr import Sdf, Usd, UsdGeom, UsdUtils, Vt

import limitsurf as ls
from limitsurf.mesh import INTERPOLATION
from limitsurf.shell.cli import main

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
    with pytest.raises(ValueError, match="unknown scheme 'none'"):
        ls.LimitSurface(mesh)
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
    mesh = read(
        prim("""
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
""")
    )
    assert mesh == ls.Mesh(POINTS, FACES)


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
    assert list(map(list, ls.read(tmp_path / "cage.usda").faces)) == faces


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
    x, y, _ = mesh.points[mesh.faces].T  # each (4, 2)
    area = np.sum(x * np.roll(y, -1, axis=0) - y * np.roll(x, -1, axis=0), axis=0)
    # As seen from above, unless the left hand rules.
    assert (np.sign(area) == (1 if orientation == "rightHanded" else -1)).all()


def test_a_flat_transform(read):
    body = MIRRORED.replace("(-1, 1, 1)", "(-1, 0, 1)")
    assert read(prim(body)).faces.tolist() == FACES


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
    mesh = read(
        group(prim(tags.format(3) + MOVED, "b") + prim(tags.format(4), "a"))
        + 'def Sphere "ball" {}\n'
    )
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
            )
        },
    )


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
    ("one", "other", "message"),
    [
        (
            "",
            "uniform token subdivisionScheme = 'none'",
            "scheme is 'catmull-clark' in /a, but 'none' in /b: one mesh cannot have both, read "
            "them apart with prim=...",
        ),
        (
            "token interpolateBoundary = 'none'",
            "",
            "boundary is 'none' in /a, but 'edge_and_corner' in /b",
        ),
        (
            "token triangleSubdivisionRule = 'smooth'",
            "",
            "triangles is 'smooth' in /a, but 'catmull-clark' in /b",
        ),
        (
            ST.format(n=2, value="(0, 1)", interpolation="faceVarying"),
            ST.format(n=2, value="(0, 1)", interpolation="faceVarying")
            + "token faceVaryingLinearInterpolation = 'all'",
            "interpolation of primvars:st is 'corners_plus1' in /a, but 'all' in /b",
        ),
        (
            ST.format(n=2, value="(0, 1)", interpolation="faceVarying"),
            ST.format(n=3, value="(0, 1, 2)", interpolation="faceVarying"),
            "primvars:st is '(2,) per value' in /a, but '(3,) per value' in /b",
        ),
    ],
)
def test_meshes_that_cannot_be_one(read, refused, one, other, message):
    text = prim(one, "a") + prim(other, "b")
    assert refused(text).startswith(message)
    assert read(text, prim="/a").n_faces == read(text, prim="/b").n_faces == 2


HIDDEN = {
    "invisible": prim("token visibility = 'invisible'", "hidden"),
    "below an invisible one": group(prim(name="hidden"), body="token visibility = 'invisible'"),
    "proxy": prim("uniform token purpose = 'proxy'", "hidden"),
    "guide": prim("uniform token purpose = 'guide'", "hidden"),
    "inactive": prim(name="hidden", head="active = false"),
    "class": prim(name="hidden").replace("def", "class"),
    "over": prim(name="hidden").replace("def", "over"),
    "prototype": f"""def PointInstancer "instancer" {{
        point3f[] positions = [(0, 0, 0)]
        int[] protoIndices = [0]
        rel prototypes = </instancer/hidden>
        {prim(name="hidden")}
    }}
    """,
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
    ("counts", "int[] faceVertexCounts = [6, 2]"): "face 1 has 2 corners, need three or more",
    ("counts", "int[] faceVertexCounts = [8, 0]"): "face 1 has 0 corners, need three or more",
    ("counts", "int[] faceVertexCounts = [2147483647, 2147483647]"): "faceVertexCounts add up to 4",
    ("counts", "float[] faceVertexCounts = [4, 4]"): "faceVertexCounts: got FloatArray, need int[]",
    ("counts", "string faceVertexCounts = '44'"): "faceVertexCounts: got str, need int[]",
    ("counts", "int faceVertexCounts = 4"): "faceVertexCounts: got int, need int[]",
    ("indices", "[]"): "faceVertexCounts add up to 8, but there are 0 faceVertexIndices",
    ("indices", "None"): "faceVertexCounts add up to 8, but there are 0 faceVertexIndices",
    ("indices", "[0, 1, 2, 6, 1, 4, 5, 2]"): "face 0: vertex index 6 is out of range, need 0 to 5",
    ("indices", "[0, 1, 2, -3, 1, 4, 5, 2]"): "face 0: vertex index -3 is negative, need 0 to 5",
}


@pytest.mark.parametrize(("change", "message"), BROKEN_MESHES.items())
@pytest.mark.parametrize("orientation", ["rightHanded", "leftHanded"])
def test_broken_meshes(refused, change, message, orientation):
    text = prim(f"uniform token orientation = '{orientation}'", "b")
    text = text.replace(MATTERS[change[0]], change[1])
    assert refused(text).startswith("/b: " + message)
    assert refused(group(prim(name="a") + text)).startswith("/World/b: " + message)


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
    "float[] creaseIndices = [0, 1]": "creaseIndices: got FloatArray, need int[]",
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
    VARYING.format("[(0, 0), (0, 0), (0, nan), (0, 0), (0, 0), (0, 0)]", "vertex"): "channel 'st': "
    "row 2: coordinate nan is not finite",
    MOVED.replace("(2, 3, 4)", "(2, nan, 4)"): "vertex 0: coordinate nan is not finite; 5 more",
    MOVED.replace("(2, 3, 4)", "(1e308, 1, 4)"): "vertex 4: coordinate inf is not finite; 1 more",
}


@pytest.mark.parametrize(("text", "message"), BROKEN_TAGS.items())
def test_broken_tags(refused, text, message):
    assert refused(prim(text)).startswith("/quads: " + message)


def test_broken_note_on_creasing(refused):
    for note in "string creasing = 'sharp'", "int creasing = 3", "int[] creasing = [1, 2]":
        text = prim(head=f"customData = {{dictionary limitsurf = {{{note}}}}}")
        assert refused(text).startswith("/quads: creasing: got ")


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
        warnings.filterwarnings("ignore", message=r".*noise\.usda: ")
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
def test_cages_of_others_come_back(tmp_path, path):
    same(tmp_path, ls.read(path), ".usdc")


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
        (
            ls.Mesh(
                *TRIANGLE, channels={"a": ([0], [0] * 3, "all"), "b": ([0], [0] * 3, "boundaries")}
            ),
            "channels: a USD mesh holds one interpolation for all its seams, got {'a': 'all', 'b':",
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


def test_without_usd(tmp_path, monkeypatch):
    path = tmp_path / "cube.usda"
    ls.write(path, ls.Mesh(*zoo.cube()))
    monkeypatch.setitem(sys.modules, "pxr", None)
    monkeypatch.delitem(sys.modules, "limitsurf.shell.usd")
    monkeypatch.delattr(sys.modules["limitsurf.shell"], "usd")
    with pytest.raises(ImportError, match=r'pip install "limitsurf\[usd\]"'):
        ls.read(path)
    with pytest.raises(ImportError, match=r'pip install "limitsurf\[usd\]"'):
        ls.write(path, ls.Mesh(*zoo.cube()))
    ls.write(tmp_path / "cube.obj", ls.Mesh(*zoo.cube()))
