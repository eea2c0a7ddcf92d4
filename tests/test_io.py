"""Cages to and from files and PyVista: what is written is read, and what is broken is located."""

import builtins
import os
import random
import re
import sys
import warnings
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zoo
from hypothesis import given
from hypothesis import strategies as st

import limitsurf as ls
from limitsurf.cage.checks import INTERPOLATION

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
# of this warning there are tests of their own
pytestmark = pytest.mark.filterwarnings("ignore:.* a cage has no place for all, left out")
CAGES = Path(__file__).parents[1] / ".." / "shared" / "cages"


@pytest.fixture
def read(tmp_path):
    """Read a text, or bytes, as an OBJ file."""

    def read_text(text, **options):
        path = tmp_path / "cage.obj"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return ls.read(path, **options)

    return read_text


@pytest.fixture
def refused(read):
    """Read what cannot be, and return the message after the path."""

    def message(text):
        with pytest.raises(ls.MeshError) as caught:
            read(text, strict=True)
        path, _, message = str(caught.value).partition("cage.obj")
        assert path
        return message.removeprefix(", ").removeprefix(": ")

    return message


# --- Reading


def test_plain_file(read):
    mesh = read(SQUARE + "f 1 2 3 4\n")
    assert mesh.points.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert mesh.faces.tolist() == [[0, 1, 2, 3]]
    assert mesh == ls.Mesh(mesh.points, mesh.faces)


@pytest.mark.parametrize(
    "text",
    [
        "f 1 2 3 4\n" + SQUARE,
        SQUARE + "f 1 2 3 4",
        SQUARE.replace("\n", "\r\n") + "f 1 2 3 4\r\n",
        SQUARE.replace("\n", "\r") + "f 1 2 3 4\r",
        "\ufeff" + SQUARE + "f 1 2 3 4\n",
        SQUARE.replace(" ", "\t  ") + "f\t1\t\t2 3 4  \t\n",
        "  \n\n" + SQUARE.replace("v", "  v") + "\n\n \tf 1 2 3 4\n\n",
        "# a comment # of many \\\n" + SQUARE.replace("\n", " # trailing\n") + "f 1 2 3 4#5\n#",
        SQUARE.replace("v 1 1 0", "v \\\n1 1 \\  \n 0") + "f 1 2\\\n 3 4\n",
        SQUARE.replace("v 1 1 0", "v\\\r\n1 1 0") + "f 1 2 3 4\n",
        SQUARE + "f -4 -3 -2 -1\n",
        SQUARE + "f 1 -3 +3 -1\n",
        SQUARE + "f -4 -3 -2 -1\nv 9 9 9\n".replace("v 9 9 9\n", ""),
        SQUARE.replace(" 0\n", " 0 1.0\n") + "f 1 2 3 4\n",
        SQUARE.replace(" 0\n", " 0 0.5 .25 1\n") + "f 1 2 3 4\n",
        SQUARE.replace(" 0\n", " 0 1 0.5 .25 1\n") + "f 1 2 3 4\n",
        SQUARE.replace("v 1 1 0", "v 1 1 0 0.5 0.5 0.5") + "f 1 2 3 4\n",
        "v -0. .0E-3 +0\nv +1.0e0 0 0\nv 10E-1 .1e+1 0.e0\nv 0 1. -0e9\nf 01 +2 3 4\n",
        SQUARE + "vn 0 0 1\nf 1//1 2//1 3//1 4//1\n",
        SQUARE + "vn 0 0 1\nf 1//-1 2//1 3 -1//7\n",
        SQUARE + "vt 0 0\nf 1/1 2/1 3 4/1\n",
        SQUARE + "g a\no b c\ns off\nusemtl m#1\nmtllib x.mtl\nf 1 2 3 4\nl 1 2\np 1\nend\n",
        (SQUARE + "# M\u00fcller\ng Stra\u00dfe\nf 1 2 3 4\n").encode("latin-1"),
    ],
)
def test_ways_to_write_a_square(read, text):
    expected = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    found = read(text)
    assert found == ls.Mesh(
        expected.points, expected.faces, face_data=found.face_data
    )  # some have names


def test_negative_indices_count_from_the_face(read):
    mesh = read("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 0 0\nv 6 0 0\nv 5 1 0\nf -3 -2 -1\n")
    assert mesh.faces.tolist() == [[0, 1, 2], [3, 4, 5]]


def test_faces_of_many_sizes(read):
    points, faces = zoo.ZOO["carved_prism"]()
    assert len({len(face) for face in faces}) > 3
    lines = [f"v {x} {y} {z}\n" for x, y, z in points]
    lines += ["f " + " ".join(str(v + 1) for v in face) + "\n" for face in faces]
    assert read("".join(lines)) == ls.Mesh(points, faces)


def test_a_file_of_all_corner_forms(read):
    more = "v 2 0 0\nv 2 1 0\nvt 0 0\nvn 0 0 1\n"
    text = SQUARE + more + "f 1 2/1 3//1 4/1/1\nf 2// 5/-1 6//-1 3/1/1\nf 1/ 2/1/ 3\n"
    mesh = read(text)
    assert mesh.faces.tolist() == [[0, 1, 2, 3], [1, 4, 5, 2], [0, 1, 2]]
    assert not mesh.channels


@pytest.mark.parametrize("corner", ["{}/", "{}//", "{0}/{0}", "{0}/{0}/", "{0}//1", "{0}/{0}/1"])
def test_empty_slots_of_corners(read, corner):
    texture = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\n"
    mesh = read(SQUARE + texture + "f " + " ".join(map(corner.format, range(1, 5))))
    assert mesh.faces.tolist() == [[0, 1, 2, 3]]
    assert ("uv" in mesh.channels) == ("/{0}" in corner)
    assert all(channel[1].tolist() == [0, 1, 2, 3] for channel in mesh.channels.values())


@pytest.mark.parametrize(
    ("faces", "expected"),
    [
        ("f 1 2 3 4 1", [0, 1, 2, 3]),
        ("f 1/1 2/2 3/3 4/4 1/1", [0, 1, 2, 3]),
        ("f 1 1 2 3 3 3 4 4 1 1", [0, 1, 2, 3]),
        ("f 2 3 3\nf 1\nf\nf 4 4 4 4\nf 1 2 1\nfo 1 2 3 4\nt hole 1/0/0 5", [0, 1, 2, 3]),
    ],
)
def test_corners_like_the_one_before(read, faces, expected):
    with pytest.warns(UserWarning, match=r"line 9: \d of \d faces? with (a|less)") as caught:
        mesh = read(f"{SQUARE}vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n{faces}\n")
    assert {warning.filename for warning in caught} == {__file__}
    assert mesh.faces.tolist() == [expected]
    assert mesh.n_edges == 4
    assert mesh.holes.tolist() == ([0] if "hole" in faces else [])
    if mesh.channels:
        assert mesh.channels["uv"][1].tolist() == [0, 1, 2, 3]


def test_corners_of_two_texture_coordinates_are_two(read):
    """As in OpenSubdiv's own shapes: a quad with a side of no length there, not in the texture."""
    mesh = read(SQUARE + "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 1/2 2/3 3/4\n")
    assert mesh.faces.tolist() == [[0, 0, 1, 2]]


def test_faces_without_texture_coordinates(read, tmp_path):
    """They are NaN on these alone, and on no other face, whatever these share."""
    points, faces = zoo.torus(4, 5)
    uv = np.random.default_rng(0).random((len(points), 2))
    lacking = np.arange(len(faces)) % 3 == 1
    lines = [
        "f" + "".join(f" {v + 1}" if no else f" {v + 1}/{v + 1}" for v in face)
        for face, no in zip(faces, lacking, strict=True)
    ]
    text = "".join("v {} {} {}\n".format(*p) for p in points)
    text += "".join("vt {} {}\n".format(*p) for p in uv.tolist()) + "\n".join(lines)
    said = f"line {len(points) * 2 + 2}: {lacking.sum()} of {len(faces)} faces without texture"
    with pytest.warns(UserWarning, match=said) as caught:
        mesh = read(text)
    assert len(caught) == 1
    values, rows, _ = mesh.channels["uv"]
    filled = ls.Mesh(points, faces, channels={"uv": (np.nan_to_num(values), rows, "all")})
    filled_smooth = ls.Mesh(
        points, faces, channels={"uv": (np.nan_to_num(values), rows, "corners_plus1")}
    )
    assert filled != mesh
    face, u, v = np.repeat(np.arange(len(faces)), 9), *np.random.default_rng(1).random((2, 180))
    u[::4], v[::5] = 0, 1
    one = ls.LimitSurface(mesh).evaluate(face, u, v, channel="uv")
    other = ls.LimitSurface(filled_smooth).evaluate(face, u, v, channel="uv")
    assert np.array_equal(one, np.where(lacking[face, None], np.nan, other), equal_nan=True)
    fine, smooth = ls.refined(mesh, 2), ls.refined(filled_smooth, 2)
    one, other = (x.channels["uv"][0][x.channels["uv"][1]] for x in (fine, smooth))
    without = np.repeat(lacking, 4 * 4 * 4)[:, None]
    assert np.array_equal(one, np.where(without, np.nan, other), equal_nan=True)
    with pytest.warns(UserWarning, match="faces without texture"):
        same(tmp_path, mesh)


def test_what_has_no_place_is_named_with_its_line(read):
    extra = "mtllib a.mtl\no x\ng a b\nusemtl red\ns 1\ns off\ns 0\nvn 0 0 1\nl 1 2\ng c\n"
    text = SQUARE.replace("1 1 0", "1 1 0 0.5 0.5 0.5").replace("0 1 0", "0 1 0 2") + extra
    said = (
        "cage.obj: a cage has no place for all, left out: weights of vertices (1 line, first 4), "
        "colours of vertices (1 line, first 3), lines (1 line, first 13), files of materials (1 "
        "line, first 5), smoothing groups (1 line, first 9)"
    )
    with pytest.warns(UserWarning, match="a cage has no place") as caught:
        assert read(text + "f 1 2 3 4\n", strict=True).n_faces == 1
    assert str(caught[0].message).rpartition("/")[2] == said
    assert caught[0].filename == __file__


def test_a_bad_part_costs_no_more_than_itself(read):
    text = (
        SQUARE + "v nan 0 inf\nhello world\n1 2 3\nvt 0 0\nvt nan 0\nf 1/1 2/1 3/1\nf 1/1 3/2 4/1\n"
    )
    text += "f 1/1 2/9 3/1\nt crease 2/1/0 0 7 1\nt crease 4/1/0 0 2 1 3 4\nt corner 1/1/0 5 1\n"
    text += (
        "t corner 1/1/0 0 -1\nt hole 2/0/0 0 3\nt crease 2/1\nt wedge 0/0/0\nt corner 1/1/0 2 3\n"
    )
    with pytest.warns(UserWarning, match=r"cage\.obj") as caught:
        mesh = read(text)
    assert mesh.n_vertices == 5
    assert mesh.points[4].tolist() == [0, 0, 0]  # where another one is
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 2]]
    assert mesh.creases[0].tolist() == [[0, 2]]
    assert [x.tolist() for x in mesh.corners] == [[2], [3]]
    assert mesh.holes.tolist() == [0]
    values, rows, _ = mesh.channels["uv"]
    assert np.isnan(values[rows]).all(axis=1).tolist() == [False] * 3 + [True] * 6
    assert sorted(str(x.message).rpartition("cage.obj")[2] for x in caught) == [
        ", line 11: 1 of 3 faces with texture coordinates that are not finite: NaN there",
        ", line 12: 1 of 3 faces without texture coordinates, which are NaN there",
        ", line 12: got texture coordinate index 9, need 1 to 2, or -2 to -1 for those before the "
        "face: left out",
        ", line 13: crease (0, 7): the mesh has no such edge; 1 more like it (counting from 0): "
        "left out",
        ", line 15: corner 5 is out of range, need 0 to 4 (counting from 0): left out",
        ", line 16: corner 0: sharpness -1.0 is not in [0, inf] (counting from 0): left out",
        ", line 17: hole 3 is out of range, need 0 to 2 (counting from 0): left out",
        ", line 18: got tag 'crease 2/1', need 'crease 2/1/0 a b sharpness', or more pairs and as "
        "many sharpnesses or one: left out",
        ", line 19: 1 tag of unknown kinds, 'wedge': ignored",
        ", line 6: 2 statements of unknown kinds, 'hello', '1': ignored",
        ": vertex 4 is not finite, but in no face: put where another one is",
    ]


def test_units_and_up_axis_come_back(tmp_path):
    mesh = ls.Mesh(*zoo.cube(), units=0.0254, up="z")
    same(tmp_path, mesh)
    ls.write(tmp_path / "fine.obj", ls.tessellate(ls.LimitSurface(mesh), 1, normals=False))
    fine = ls.read(tmp_path / "fine.obj")
    assert (fine.units, fine.up) == (0.0254, "z")


def test_texture_coordinates(read):
    texture = "vt 0 0\nvt 1 0\nvt 0.5 1 0\nvt 0.25\n"
    mesh = read(SQUARE + texture + "f 1/1 2/2 3/3\nf 1/-1 3/-2 4/4\n")
    values, indices, interpolation = mesh.channels["uv"]
    assert values.tolist() == [[0, 0], [1, 0], [0.5, 1], [0.25, 0]]
    assert indices.tolist() == [0, 1, 2, 3, 2, 3]
    assert interpolation == "corners_plus1"
    assert read(SQUARE + texture + "f 1/1/1 2/2/1 3/3/1 4/4/1\n").channels["uv"][0].shape == (4, 2)


def test_tags(read):
    mesh = read(
        SQUARE + "v 2 0 0\nv 2 1 0\nvt 0 0\nf 1/1 2/1 3/1 4/1\nf 2/1 5/1 6/1 3/1\n"
        "t crease 2/1/0 2 1 1.5\n"
        "t  crease  4/2/0  0 1  1 4  inf 0.1\n"
        "t crease 4/1/0 3 2 2 5 4 \n"
        "t corner 1/1/0 3 2.8\n"
        "t corner 2/2/0 4 5 1 10\n"
        "t hole 1/0/0 1\n"
        "t interpolateboundary 1/0/0 2\n"
        "t creasemethod 0/0/1 chaikin\n"
        "t smoothtriangles 0/0/1 smooth\n"
        "t facevaryinginterpolateboundary 1/0/0 3\n"
        "t facevaryingpropagatecorners 1/0/0 1\n"
        "t scheme 0/0/1 loop\n"
    )
    assert mesh.creases[0].tolist() == [[0, 1], [1, 2], [1, 4], [2, 3], [2, 5]]
    assert mesh.creases[1].tolist() == [np.inf, 1.5, 0.1, 4, 4]
    assert [array.tolist() for array in mesh.corners] == [[3, 4, 5], [2.8, 1, 10]]
    assert mesh.holes.tolist() == [1]
    assert (mesh.boundary, mesh.creasing, mesh.triangles) == ("edge_only", "chaikin", "smooth")
    assert mesh.channels["uv"][2] == "corners_plus2"
    assert mesh.scheme == "loop"


@pytest.mark.parametrize(
    ("tag", "option", "value"),
    [
        ("interpolateboundary 1/0/0 0", "boundary", "none"),
        ("interpolateboundary 1/0/0 1", "boundary", "edge_and_corner"),
        ("interpolateboundary 1/0/0 2", "boundary", "edge_only"),
        ("creasemethod 0/0/1 normal", "creasing", "uniform"),
        ("creasemethod 0/0/1 chaikin", "creasing", "chaikin"),
        ("smoothtriangles 0/0/1 catmark", "triangles", "catmull-clark"),
        ("smoothtriangles 0/0/1 smooth", "triangles", "smooth"),
        ("smoothtriangles 1/0/0 1", "triangles", "catmull-clark"),
        ("smoothtriangles 1/0/0 2", "triangles", "smooth"),
    ],
)
def test_tags_of_choices(read, tag, option, value):
    assert getattr(read(f"{SQUARE}f 1 2 3 4\nt {tag}\n"), option) == value


@pytest.mark.parametrize("number", range(6))
def test_interpolation_of_texture_coordinates(read, number):
    tag = f"t facevaryinginterpolateboundary 1/0/0 {number}\n"
    mesh = read(SQUARE + "vt 0 0\nf 1/1 2/1 3/1 4/1\n" + tag)
    order = ["none", "corners_only", "corners_plus1", "corners_plus2", "boundaries", "all"]
    assert mesh.channels["uv"][2] == order[number]
    assert not read(SQUARE + "f 1 2 3 4\n" + tag).channels


def test_the_last_of_several_tags_holds(read):
    mesh = read(
        SQUARE + "f 1 2 3 4\nt crease 2/1/0 0 1 1\nt crease 2/1/0 1 0 2\nt corner 1/1/0 0 1\n"
        "t corner 1/1/0 0 3\nt hole 1/0/0 0\nt hole 1/0/0 0\nt interpolateboundary 1/0/0 1\n"
        "t interpolateboundary 1/0/0 0\n"
    )
    assert mesh.creases[1].tolist() == [2]
    assert mesh.corners[1].tolist() == [3]
    assert mesh.holes.tolist() == [0]
    assert mesh.boundary == "none"


def test_unknown_tags_and_statements_are_named_once(read):
    text = (
        SQUARE + "vcolor 1 1\nf 1 2 3 4\nt vertexedit 2/3/3 1\nvcolor\nt faceedit\nt vertexedit\n"
    )
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        mesh = read(text)
    assert mesh.n_faces == 1
    messages = [str(warning.message).partition("cage.obj, ")[2] for warning in caught]
    assert messages == [
        "line 7: 2 tags of unknown kinds, 'vertexedit', 'faceedit': ignored",
        "line 5: 2 statements of unknown kinds, 'vcolor': ignored",
    ]
    assert {warning.filename for warning in caught} == {__file__}


@pytest.mark.parametrize("suffix", [".obj", ".OBJ", ".Obj"])
def test_suffixes_and_kinds_of_paths(tmp_path, suffix):
    mesh = ls.Mesh(*zoo.cube())
    path = tmp_path / f"cube{suffix}"
    ls.write(path, mesh)
    for one in path, str(path), os.fsencode(path):
        assert ls.read(one) == mesh


# --- What is broken is located

BROKEN = {
    "": "need at least one vertex, 'v x y z', got none up to the last line",
    "# nothing\n": "need at least one vertex",
    SQUARE: "need at least one face, 'f 1 2 3', got none up to the last line",
    "solid cube\n": "line 1: got 'solid cube', need a statement of an OBJ file",
    # numbers
    SQUARE + "v 0 0 zero\nf 1 2 3\n": "line 5: got 'zero', need a finite number",
    SQUARE + "f 1 2 3\n\n\nv 0 1e 0\n": "line 8: got '1e', need a finite number",
    "v 0 \\\n0 0\nv 1 \\\n nan 0\nv 0 0 0\nf 1 2 3": "line 3: got 'nan', need a finite number",
    "#\n# two\nv inf 0 0\nf 1 -1 1": "line 3: got 'inf', need a finite number",
    "v 0 0 -1e999\nf 1 1 1": "line 1: got '-1e999', need a finite number",
    "v 1,0 2 3\n": "line 1: got '1,0', need a finite number",
    "v 1 2 3_0\n": "line 1: got '3_0', need a finite number",
    "v 1 2 0x1\n": "line 1: got '0x1', need a finite number",
    "v 1 2 1-2\n": "line 1: got '1-2', need a finite number",
    "v 1 2 -\n": "line 1: got '-', need a finite number",
    "v 1 2 1.2.3\n": "line 1: got '1.2.3', need a finite number",
    "v 1 2\\ \nv 1 2 3": "line 1: got 'v', need a finite number",
    "v 0 0 0\nv 0 0\n": "line 2: got a vertex of 2 numbers, need 3 or more",
    "v\n": "line 1: got a vertex of 0 numbers",
    SQUARE + "vt\nf 1/1 2/1 3/1\n": "line 5: got a texture coordinate of 0 numbers, need 1 or more",
    SQUARE + "vt 1 x\nf 1/1 2/1 3/1\n": "line 5: got 'x', need a finite number",
    SQUARE + "vt 1 nan\nf 1/1 2/1 3/1\n": "line 6: 1 of 1 face with texture coordinates that are",
    SQUARE + "v nan 0 0\nf 1 2 3\n": "vertex 4 is not finite, but in no face",
    # corners
    SQUARE + "f 1 2 3\nf 1 2\n": "line 6: 1 of 2 faces with less than 3 corners that differ",
    SQUARE + "f\n": "line 5: 1 of 1 face with less than 3 corners that differ",
    SQUARE + "f 1 2 3 4 1\n": "line 5: 1 of 1 face with a corner twice in succession",
    SQUARE + "f 1 2 3.5 4\n": "line 5: got '3.5', need integers as v, v/vt, v//vn or v/vt/vn",
    SQUARE + "f 1 2 3 4\nf 1 2 x\n": "line 6: got 'x', need integers as v, v/vt, v//vn or v/vt",
    SQUARE + "f 1 2/1/ 3\n": "line 5: got texture coordinate index 1, but have none",
    SQUARE + "f / 2 3\n": "line 5: got '/', need integers",
    SQUARE + "f // 2 3\n": "line 5: got '//', need integers",
    SQUARE + "f 1 2 //1\n": "line 5: got '//1', need integers",
    SQUARE + "f 1/1/1/ 2 3\n": "line 5: got '1/1/1/', need integers",
    SQUARE + "f 1 /2 3\n": "line 5: got '/2', need integers",
    SQUARE + "f /1/2 3 4\n": "line 5: got '/1/2', need integers",
    SQUARE + "f 1 2/1/1/1 3\n": "line 5: got '2/1/1/1', need integers",
    SQUARE + "f 1 2 3///1\n": "line 5: got '3///1', need integers",
    SQUARE + "f 1 2 ////\n": "line 5: got '////', need integers",
    SQUARE + "f 1-2/1 3/ 4/1\n": "line 5: got '1-2/1', need integers",
    SQUARE + "f 1 2 -\n": "line 5: got '-', need integers",
    SQUARE + "f 1 2 3- 4\n": "line 5: got '3-', need integers",
    SQUARE + "f 1 2 --3\n": "line 5: got '--3', need integers",
    SQUARE + "f 1 2 3 \\": "line 5: got '\\\\', need integers",
    SQUARE + "f 1 2 0\n": "line 5: got vertex index 0, need 1 to 4, or -4 to -1 for those before",
    SQUARE + "f 1 2 5\n": "line 5: got vertex index 5, need 1 to 4, or -4 to -1",
    "v 0 0 0\nf 1 2 -2\n" + SQUARE: "line 2: got vertex index -2, need 1 to 5, or -1 to -1",
    SQUARE + "f 1 2 99999999999999999999\n": "line 5: got vertex index 9223372036854775807",
    SQUARE + "f 1 2 -99999999999999999999\n": "line 5: got vertex index ",
    SQUARE + "vt 0 0\nf 1/1 2/2 3/1\n": "line 6: got texture coordinate index 2, need 1 to 1",
    SQUARE + "f 1/1 2/1 3/1\n": "line 5: got texture coordinate index 1, but have none",
    SQUARE + "vt 0 0\nf 1/0 2/1 3/1\n": "line 6: got texture coordinate index 0, need 1 to 1",
    # tags
    SQUARE + "f 1 2 3 4\nt\n": "line 6: got 't', need the name of a tag after it",
    SQUARE + "f 1 2 3 4\n#\nt crease 2/1/0 0 2 1\n": "line 7: crease (0, 2): the mesh has no such",
    SQUARE + "f 1 2 3\nt corner 1/1/0 4 1\n": "line 6: corner 4 is out of range, need 0 to 3",
    SQUARE + "f 1 2 3\nt hole 1/0/0 1\n": "line 6: hole 1 is out of range, need 0 to 0",
    SQUARE + "f 1 2 3\nt crease 2/1/0 1 0 -1\n": "line 6: crease (0, 1): sharpness -1.0 is not in",
    SQUARE + "f 1 2 3\nt corner 1/1/0 1 nan\n": "line 6: corner 1: sharpness nan is not in",
    # truncated
    SQUARE[:-3]: "line 4: got a vertex of 2 numbers",
    SQUARE + "f 1 2": "line 5: 1 of 1 face with less than 3 corners that differ",
    SQUARE + "f 1 2 3 4\nt corner 1/1": "line 6: got tag 'corner 1/1', need",
    # binaries
    b"\x89PNG\r\n\x1a\n\x00\x00": "line 1: got '\\\\x89PNG', need a statement of an OBJ file",
    b"\xff\xfev\x00 \x000\x00": "line 1: got a vertex of 1 numbers",  # UTF-16
    b"\x00" * 100: "line 1: got '\\x00",
    b"v 0 0 \xff\n": "line 1: got '\\\\xff', need a finite number",
    b"v 0 0 1\x002\n": "line 1: got '1\\x002', need a finite number",
    "v 0 0 0\nf 1 1 \u0661\n": "line 2: got '\u0661', need integers",
    "ply\nformat ascii 1.0\n0 0 0\n": "line 1: got 'ply', need a statement of an OBJ file",
    "{" + "x" * 99: "line 1: got '{" + "x" * 39 + "...', need a statement of an OBJ file",
}


@pytest.mark.parametrize(("text", "message"), BROKEN.items())
def test_broken_files(refused, text, message):
    assert refused(text).startswith(message)


@pytest.mark.parametrize(
    ("tag", "need"),
    [
        ("crease 2/1/0 0 1", "'crease 2/1/0 a b sharpness', or more pairs"),
        ("crease 2/1/0 0 1 1 1", "'crease 2/1/0 a b sharpness'"),
        ("crease 1/1/0 0 1", "'crease 2/1/0 a b sharpness'"),
        ("crease 4/3/0 0 1 1 2 1 1 1", "'crease 2/1/0 a b sharpness'"),
        ("crease 2/1/0 0 1.5 1", "'crease 2/1/0 a b sharpness'"),
        ("crease 2/1/0 0 1 sharp", "'crease 2/1/0 a b sharpness'"),
        ("crease 2/1 0 1 1", "'crease 2/1/0 a b sharpness'"),
        ("crease 2/x/0 0 1 1", "'crease 2/1/0 a b sharpness'"),
        ("crease 3/-1/0 0 1", "'crease 2/1/0 a b sharpness'"),
        ("crease 2/1/0 0 99999999999999999999 1", "'crease 2/1/0 a b sharpness'"),
        ("crease 2/1/1 0 1 1 x", "'crease 2/1/0 a b sharpness'"),
        ("crease 0/0/1 1", "'crease 2/1/0 a b sharpness'"),
        ("crease", "'crease 2/1/0 a b sharpness'"),
        ("corner 1/0/0 1", "'corner 1/1/0 vertex sharpness', or more vertices"),
        ("corner 2/3/0 0 1 1 1 1", "'corner 1/1/0 vertex sharpness'"),
        ("hole 0/0/1 0", "'hole 1/0/0 face', or more faces"),
        ("hole 1/1/0 0 1", "'hole 1/0/0 face', or more faces"),
        ("interpolateboundary 1/0/0 3", "'interpolateboundary 1/0/0 x', x of 0, 1, 2"),
        ("interpolateboundary 2/0/0 1 1", "'interpolateboundary 1/0/0 x', x of 0, 1, 2"),
        ("interpolateboundary 0/1/0 1", "'interpolateboundary 1/0/0 x', x of 0, 1, 2"),
        ("creasemethod 0/0/1 uniform", "'creasemethod 0/0/1 x', x of normal, chaikin"),
        ("creasemethod 0/0/0", "'creasemethod 0/0/1 x', x of normal, chaikin"),
        ("smoothtriangles 1/0/0 0", "'smoothtriangles 0/0/1 x', x of catmark, smooth, 1, 2"),
        ("facevaryinginterpolateboundary 1/0/0 6", "'facevaryinginterpolateboundary 1/0/0 x', x"),
        ("scheme 0/0/0", "'scheme 0/0/1 name'"),
        ("scheme 1/0/0 3", "'scheme 0/0/1 name'"),
    ],
)
def test_broken_tags(refused, tag, need):
    message = refused(f"{SQUARE}f 1 2 3 4\nt {tag}\n")
    start = f"line 6: got tag {tag[:40]!r}".rstrip("'")
    assert message.startswith(start)
    assert f", need {need}" in message


def test_the_first_culprit_among_many_lines_is_found(refused):
    n = 2000
    lines = [f"v {i} {i % 7} 0" for i in range(n)] + [
        f"f {i + 1} {i + 2} {i + 3}" for i in range(0, n - 3, 3)
    ]
    for at, bad in (0, "v 1 2 x"), (n - 1, "v 1 2 x"), (n // 3, "v x y z"), (n + 7, "f 1 2 3x"):
        broken = list(lines)
        broken[at] = bad
        broken[n - 1 if at < n else -1] += " x"
        assert refused("\n".join(broken)).startswith(f"line {at + 1}: got ")


@pytest.mark.parametrize("seed", range(200))
def test_noise_is_refused_or_read_but_nothing_else(tmp_path, seed):
    """Bytes of a good file changed, cut or doubled at random: a mesh, or a MeshError."""
    g = random.Random(seed)
    good = (SQUARE + "vt 0 0\nf 1/1 2/1 3/1\nf 1/1 3/1 4/1\nt crease 2/1/0 0 1 2\n").encode()
    data = bytearray(good)
    for _ in range(g.randrange(1, 8)):
        at = g.randrange(len(data))
        change = g.randrange(3)
        if change == 0:
            data[at] = g.choice(b" \n\\/-+.e#0123456789vft\t\r\x00\xff\x0b")
        elif change == 1:
            del data[at : at + g.randrange(10)]
        else:
            data[at:at] = data[at : at + g.randrange(10)]
        data = data or bytearray(good)
    path = tmp_path / "noise.obj"
    path.write_bytes(data)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=r".*noise\.obj[:,] ")
        try:
            assert np.isfinite(ls.read(path).points).all()
        except ls.MeshError as error:
            message = str(error)
        else:
            return
    assert re.search(r"noise\.obj(, lines? [\d, ]+)?: ", message)


# --- Files that are none


def test_no_such_file(tmp_path):
    with pytest.raises(FileNotFoundError):
        ls.read(tmp_path / "none.obj")


def test_directory(tmp_path):
    (tmp_path / "folder.obj").mkdir()
    with pytest.raises(OSError, match=r"folder\.obj"):
        ls.read(tmp_path / "folder.obj")


def test_unknown_suffix(tmp_path):
    path = tmp_path / "cube.xyz"
    path.write_text("solid")
    with pytest.raises(ValueError, match=r"cube\.xyz: unknown suffix '\.xyz', need one of \.obj, "):
        ls.read(path)
    with pytest.raises(ValueError, match=r"cube: unknown suffix '', need one of \.obj, "):
        ls.write(tmp_path / "cube", ls.Mesh(*zoo.cube()))
    assert os.listdir(tmp_path) == ["cube.xyz"]


def test_no_path():
    with pytest.raises(TypeError):
        ls.read(3)
    with pytest.raises(TypeError):
        ls.write(None, ls.Mesh(*zoo.cube()))


# --- Writing


def same(tmp_path, mesh):
    path = tmp_path / "again.obj"
    ls.write(path, mesh)
    assert ls.read(path) == mesh
    return path.read_text()


@pytest.mark.parametrize("name", zoo.ZOO)
def test_the_zoo_comes_back(tmp_path, name):
    same(tmp_path, ls.Mesh(*zoo.ZOO[name]()))


# in a file a corner like the one before is none
@pytest.mark.parametrize("name", [name for name in zoo.NONMANIFOLD if name != "collapsed_side"])
def test_non_manifold_cages_come_back(tmp_path, name):
    points, faces, *_ = zoo.NONMANIFOLD[name]
    mesh = ls.Mesh(points, faces)
    same(tmp_path, mesh)
    number = 3 * mesh.n_corners
    uv = np.random.default_rng(0).random((number, 2))
    rows = np.random.default_rng(1).integers(number, size=mesh.n_corners)
    ends = np.unique(mesh.edges, axis=0)
    creases = ends, np.arange(len(ends)) / 3
    tags = {"creases": creases, "corners": {int(mesh.indices[0]): np.inf}, "holes": [0]}
    same(tmp_path, ls.Mesh(points, faces, **tags, channels={"uv": (uv, rows, "all")}))


@pytest.mark.parametrize(
    ("faces", "edges", "vertices"),
    [
        # an edge of three faces, one that two faces run along in the same direction, two fans
        ([[0, 1, 2], [1, 0, 3], [0, 1, 3]], [(0, 1)], [0, 1]),
        ([[0, 1, 2], [0, 1, 3]], [(0, 1)], [0, 1]),
        ([[0, 1, 2], [0, 3, 4]], [], [0]),
        # a vertex twice in a face, apart
        ([[0, 1, 2, 0, 3, 4]], [], [0]),
    ],
)
def test_odd_faces_are_read_as_they_are(read, tmp_path, faces, edges, vertices):
    lines = ["f " + " ".join(str(v + 1) for v in face) + "\n" for face in faces]
    mesh = read(SQUARE + "v 2 0 1\n" + "".join(lines))
    assert mesh.faces.tolist() == faces
    assert list(map(tuple, mesh.edges[mesh.nonmanifold_edge].tolist())) == edges
    assert np.flatnonzero(mesh.nonmanifold_vertex).tolist() == vertices
    same(tmp_path, mesh)


@given(st.data())
def test_random_tagged_cages_come_back(tmp_path_factory, data):
    points, faces = data.draw(zoo.cages(max_steps=3))
    mesh = ls.Mesh(points, faces)
    sharpness = st.floats(0, allow_nan=False)
    finite = st.floats(allow_nan=False, allow_infinity=False)
    edges = st.sampled_from(list(map(tuple, mesh.edges.tolist())))
    vertices = st.integers(0, mesh.n_vertices - 1)
    uv = data.draw(st.lists(st.tuples(finite, finite), max_size=4))
    rows = [i * i % max(len(uv), 1) for i in range(mesh.n_corners)]
    tagged = ls.Mesh(
        mesh.points * data.draw(st.floats(-1e300, 1e300)),
        faces,
        creases=data.draw(st.dictionaries(edges, sharpness, max_size=3)),
        corners=data.draw(st.dictionaries(vertices, sharpness, max_size=3)),
        holes=sorted(data.draw(st.sets(st.integers(0, mesh.n_faces - 1), max_size=3))),
        scheme=data.draw(st.sampled_from([None, "catmull-clark", "loop"])),
        boundary=data.draw(st.sampled_from([None, "none", "edge_only", "edge_and_corner"])),
        creasing=data.draw(st.sampled_from([None, "uniform", "chaikin"])),
        triangles=data.draw(st.sampled_from([None, "catmull-clark", "smooth"])),
        channels={"uv": (uv, rows, data.draw(st.sampled_from(INTERPOLATION)))} if uv else None,
    )
    same(tmp_path_factory.mktemp("again"), tagged)


def test_text(tmp_path):
    mesh = ls.Mesh(
        [[0, 0.1, 1e-300], [1 / 3, -0.0, 1e22], [5e-324, 2, 3]],
        [[0, 1, 2]],
        creases={(0, 2): np.inf, (1, 0): 0.1},
        corners={2: 3},
        holes=[0],
        scheme="loop",
        boundary="edge_only",
        creasing="uniform",
        triangles="catmull-clark",
        channels={"uv": ([[0, 0.5], [1, 0.1]], [0, 1, 1], "boundaries")},
    )
    assert same(tmp_path, mesh) == (
        "v 0.0 0.1 1e-300\n"
        "v 0.3333333333333333 -0.0 1e+22\n"
        "v 5e-324 2.0 3.0\n"
        "vt 0.0 0.5\n"
        "vt 1.0 0.1\n"
        "\n"
        "f 1/1 2/2 3/2\n"
        "t crease 2/1/0 0 1 0.1\n"
        "t crease 2/1/0 0 2 inf\n"
        "t corner 1/1/0 2 3.0\n"
        "t hole 1/0/0 0\n"
        "t interpolateboundary 1/0/0 2\n"
        "t creasemethod 0/0/1 normal\n"
        "t smoothtriangles 0/0/1 catmark\n"
        "t facevaryinginterpolateboundary 1/0/0 4\n"
        "t scheme 0/0/1 loop\n"
    )
    signs = np.signbit(ls.read(tmp_path / "again.obj").points[1])
    assert signs.tolist() == [False, True, False]


def test_exact_points_are_rounded(tmp_path):
    points = np.array([[Fraction(1, 3), 0, 0], [1, 0, 0], [0, 2**60 + 1, 0]], dtype=object)
    mesh = ls.Mesh(points, [[0, 1, 2]], creases={(0, 1): Fraction(5, 2), (1, 2): Fraction(1, 3)})
    path = tmp_path / "exact.obj"
    ls.write(path, mesh)
    again = ls.read(path)
    assert again.points.tolist() == [[1 / 3, 0, 0], [1, 0, 0], [0, 2.0**60, 0]]
    assert again.creases[1].tolist() == [2.5, 1 / 3]


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (ls.Mesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]]), r"shape \(3, 2\), need \(n_vertices, 3\)"),
        (ls.Mesh(np.zeros((3, 3, 1)), [[0, 1, 2]]), r"shape \(3, 3, 1\), need"),
        (ls.Mesh([[10**400, 0, 0]] * 3, [[0, 1, 2]]), "a coordinate is beyond float64"),
        (
            ls.Mesh(np.zeros((3, 3)), [[0, 1, 2]], scheme=object()),
            "scheme: an OBJ file holds a name",
        ),
        (ls.Mesh(np.zeros((3, 3)), [[0, 1, 2]], scheme="a b"), "of one word, got 'a b'"),
        (ls.Mesh(np.zeros((3, 3)), [[0, 1, 2]], scheme="a#"), "of one word, got 'a#'"),
    ],
)
def test_what_an_obj_file_cannot_hold(tmp_path, mesh, message):
    path = tmp_path / "old.obj"
    path.write_text("old")
    with pytest.raises(ValueError, match=message):
        ls.write(path, mesh)
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["old.obj"]


def test_channels_of_an_obj_file(tmp_path):
    st, path = ([[0, 1], [1, 0]], [0, 1, 1], "all"), tmp_path / "x.obj"
    points, faces = np.zeros((3, 3)), [[0, 1, 2]]
    ls.write(path, ls.Mesh(points, faces, channels={"st": st}))
    assert ls.read(path) == ls.Mesh(points, faces, channels={"uv": st})
    odd = {"uv": ([[0] * 3], [0] * 3, "all"), "c": ([0.5], [0] * 3, "none"), "st": st}
    text = (
        r"x\.obj: a file of type \.obj cannot hold everything, left out: channel 'uv', channel 'c'$"
    )
    with pytest.warns(UserWarning, match=text) as caught:
        ls.write(path, ls.Mesh(points, faces, channels=odd))
    assert caught[0].filename == __file__
    assert ls.read(path) == ls.Mesh(points, faces, channels={"uv": st})


def test_a_file_is_replaced_whole(tmp_path):
    path = tmp_path / "cube.obj"
    ls.write(path, ls.Mesh(*zoo.torus(5, 5)))
    ls.write(path, ls.Mesh(*zoo.cube()))
    assert ls.read(path) == ls.Mesh(*zoo.cube())
    assert os.listdir(tmp_path) == ["cube.obj"]


# --- PyVista


@pytest.mark.parametrize(
    "name", ["cube", "dodecahedron", "carved_prism", "grid_3x3", "disconnected"]
)
def test_pyvista_comes_back(name):
    mesh = ls.Mesh(*zoo.ZOO[name]())
    surface = ls.to_pyvista(mesh)
    assert surface.n_cells == mesh.n_faces
    assert surface.n_points == mesh.n_vertices
    assert ls.from_pyvista(surface) == mesh
    assert ls.from_pyvista(surface.cast_to_unstructured_grid()) == mesh
    surface.points[0] = 7
    assert mesh.points[0].tolist() != [7, 7, 7]


def test_pyvista_keeps_double_precision():
    mesh = ls.Mesh(np.random.default_rng(0).random((3, 3)), [[0, 1, 2]])
    assert np.array_equal(ls.to_pyvista(mesh).points, mesh.points)


def test_pyvista_with_tags():
    cube = ls.to_pyvista(ls.Mesh(*zoo.cube()))
    mesh = ls.from_pyvista(cube, creases={(0, 1): 2}, boundary="none")
    assert mesh == ls.Mesh(*zoo.cube(), creases={(0, 1): 2}, boundary="none")


def test_pyvista_ignores_lines_and_vertices():
    import pyvista

    triangle = pyvista.PolyData(np.eye(3), faces=[3, 0, 1, 2], lines=[2, 0, 1], verts=[1, 2])
    assert ls.from_pyvista(triangle).faces.tolist() == [[0, 1, 2]]


def test_pyvista_strips_and_pixels():
    import pyvista

    strips = pyvista.PolyData(np.eye(5)[:, :3], faces=[3, 0, 1, 4], strips=[4, 0, 1, 2, 3])
    assert ls.from_pyvista(strips).faces.tolist() == [[0, 1, 4], [0, 1, 2], [2, 1, 3]]
    cells, kinds = [4, 0, 1, 2, 3, 3, 1, 4, 3], [pyvista.CellType.PIXEL, pyvista.CellType.TRIANGLE]
    grid = pyvista.UnstructuredGrid(np.array(cells), kinds, np.eye(5)[:, :3])
    assert ls.from_pyvista(grid).faces.tolist() == [[0, 1, 3, 2], [1, 4, 3]]


def test_pyvista_refuses():
    import pyvista

    with pytest.raises(ls.MeshError, match="at least one face"):
        ls.from_pyvista(pyvista.PolyData(np.eye(3)))
    with pytest.raises(ls.MeshError, match="at least one"):
        ls.from_pyvista(pyvista.PolyData())
    solid = pyvista.ImageData(dimensions=(2, 2, 2)).cast_to_unstructured_grid()
    with pytest.raises(ValueError, match=r"cell 0 is a \w+, need polygons only: call .extract_sur"):
        ls.from_pyvista(solid)
    with pytest.raises(TypeError, match=r"got ImageData: .* become PolyData by .extract_surface"):
        ls.from_pyvista(pyvista.ImageData(dimensions=(2, 2, 2)))
    with pytest.raises(TypeError, match="got list"):
        ls.from_pyvista([1, 2])
    with pytest.raises(ValueError, match="need"):
        ls.to_pyvista(ls.Mesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]]))


def test_without_pyvista(monkeypatch):
    original = builtins.__import__

    def missing(name, *arguments, **keywords):
        if name == "pyvista":
            raise ImportError(name)
        return original(name, *arguments, **keywords)

    monkeypatch.setattr(builtins, "__import__", missing)
    monkeypatch.delitem(sys.modules, "pyvista", raising=False)
    with pytest.raises(ImportError, match=r'pip install "limitsurf\[plot\]"'):
        ls.to_pyvista(ls.Mesh(*zoo.cube()))
    with pytest.raises(ImportError, match=r'pip install "limitsurf\[plot\]"'):
        ls.from_pyvista(None)


# --- Cages of others, where they are at hand

NON_MANIFOLD = {"catmark_fan", "catmark_gregory_test4", "catmark_nonman_edges"}


def tags_of(text):
    """Creases, corners, holes and options of a file whose tags are on lines of their own."""
    found: dict[str, Any] = {"crease": {}, "corner": {}, "hole": set(), "options": {}}
    for line in re.findall(r"^t\s+(.*)", text, re.M):
        name, counts, *words = line.split()
        integers, floats, _ = map(int, counts.split("/"))
        numbers = [int(word) for word in words[:integers]]
        if name == "crease":
            assert (integers, floats) == (2, 1)
            found[name][tuple(sorted(numbers))] = float(words[2])
        elif name == "corner":
            assert (integers, floats) == (1, 1)
            found[name][numbers[0]] = float(words[1])
        elif name == "hole":
            found[name].update(numbers)
        else:
            found["options"][name] = words[-1]
    return found


@pytest.mark.parametrize("path", sorted(CAGES.glob("*.obj")), ids=lambda path: path.stem)
def test_cages_of_others(tmp_path, path):
    mesh = ls.read(path)
    same(tmp_path, mesh)
    assert mesh.nonmanifold_vertex.any() == (path.stem in NON_MANIFOLD)
    text = path.read_text()
    rows = re.findall(r"^v\s+(\S+)\s+(\S+)\s+(\S+)", text, re.MULTILINE)
    assert mesh.points.tolist() == [list(map(float, row)) for row in rows]
    faces = [line.split()[1:] for line in text.splitlines() if line.startswith("f ")]
    assert mesh.faces.tolist() == [
        [int(corner.split("/")[0]) - 1 for corner in face] for face in faces
    ]
    tags = tags_of(text)
    for name, (keys, sharpness) in ("crease", mesh.creases), ("corner", mesh.corners):
        found = [tuple(key) if name == "crease" else key for key in keys.tolist()]
        assert dict(zip(found, sharpness.tolist(), strict=True)) == tags[name]
    assert mesh.holes.tolist() == sorted(tags["hole"])
    boundary = {"0": "none", "1": "edge_and_corner", "2": "edge_only", None: None}
    assert mesh.boundary == boundary[tags["options"].get("interpolateboundary")]
