"""Numbers of text files, all at once; OBJ in blocks; parts of cages by data of faces."""

import codecs
import random
from fractions import Fraction

import numpy as np
import pytest

import limitsurf as ls
from limitsurf.shell.io import digits, obj


def converted(function, words):
    """A function of `digits` on words of a text."""
    text = b" " * digits.PADDING + " ".join(words).encode() + b"\n" * digits.PADDING
    length = np.array(list(map(len, words)))
    low = digits.PADDING + np.cumsum(length + 1) - length - 1
    return function(np.frombuffer(text, np.uint8), low, low + length)


def halfway(count):
    """Decimals near the middle between two neighbouring float64, cut to some digits."""
    chance = random.Random(3)
    for _ in range(count):
        x = chance.uniform(1, 100)
        middle = (Fraction(x) + Fraction(float(np.nextafter(x, np.inf)))) / 2
        number = chance.randrange(14, 18)
        scaled = round(middle * 10**number)
        yield f"{scaled // 10**number}.{scaled % 10**number:0{number}d}"


def test_decimals_are_those_of_python():
    chance = random.Random(1)
    words = ["1", "-1", ".5", "5.", "-.5", "+3.25", "-0", "0.0", "12345678.25", "00000001.5"]
    for size in 1, 1e-3, 1e6:
        numbers = [chance.gauss(0, size) for _ in range(4000)]
        words += map(repr, numbers)
        words += [f"{x:.{chance.randrange(22)}f}" for x in numbers]
    words += halfway(4000)
    values, right = converted(digits.decimals, words)
    assert right.mean() > 0.9  # of the others nothing is said
    expected = np.array(list(map(float, words)))
    assert (values.view(np.int64) == expected.view(np.int64))[right].all()
    assert right[:10].all()


def test_what_is_no_plain_decimal():
    words = [".", "-", "+.", "1.2.3", "1-2", "--1", "1e5", "nan", "inf", "1_0", "0x10", "1,5"]
    words += ["9007199254740993", "9" * 30, "0." + "1" * 30, "1/2"]
    assert not converted(digits.decimals, words)[1].any()


def test_integers():
    words = ["0", "-7", "+12", "12345678", "-12345678", "00000012"]
    values, right = converted(digits.integers, words)
    assert values.tolist() == list(map(int, words))
    assert right.all()
    others = ["-", "1.0", "123456789", "1a", "/", "+-1", "1-1"]
    assert not converted(digits.integers, others)[1].any()


@pytest.mark.parametrize("mark", [codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE, codecs.BOM_UTF8])
def test_encodings_that_a_mark_names(tmp_path, mark):
    codec = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}.get(mark, "utf-8")
    text = "v 0 0 0\nv 1 0 0\nv 0 1e0 0\ng d\u00e9\nf 1 2 3\n"
    (tmp_path / "a.obj").write_bytes(mark + text.encode(codec))
    mesh = ls.read(tmp_path / "a.obj")
    assert mesh.face_data["group"].tolist() == ["d\u00e9"]


@pytest.mark.parametrize("size", [1, 5, obj._AT_ONCE])
def test_blocks_make_one_text(monkeypatch, tmp_path, size):
    rng = np.random.default_rng(2)
    points = [*rng.normal(size=(6, 3)), [1e-300, 0.1, -7], [1e300, 2**53, 3]]
    uv = np.array([[0.5, 0.25], [np.nan, np.nan], [1, 0]])
    faces = [[0, 1, 2, 3], [3, 2, 4], [4, 5, 6, 7, 0]]
    rows = [0, 2, 0, 2, 1, 1, 1, 2, 2, 0, 0, 2]
    mesh = ls.Mesh(
        points,
        faces,
        channels={"uv": (uv, rows, "corners_plus1")},
        face_data={"group": ["5%d", "5%d", "%"], "material": ["", "%r", "b c"]},
    )
    monkeypatch.setattr(obj, "_AT_ONCE", size)
    text = "".join(obj.statements(mesh))
    assert "\n\ng 5%d\nf 1/1 2/2 3/1 4/2\nusemtl %r\nf 4 3 5\ng %\nusemtl b c\nf 5/2" in text
    (tmp_path / "a.obj").write_text(text)
    with pytest.warns(UserWarning, match="1 of 3 faces without texture coordinates"):
        found = ls.read(tmp_path / "a.obj")
    assert found.points.tolist() == mesh.points.tolist()
    assert {name: x.tolist() for name, x in found.face_data.items()} == {
        name: x.tolist() for name, x in mesh.face_data.items()
    }


POINTS = [[x, y, 0] for y in range(3) for x in range(4)]
QUADS = [[i, i + 1, i + 5, i + 4] for i in (0, 1, 2, 4, 5, 6)]
GRID = ls.Mesh(
    POINTS,
    QUADS,
    creases={(1, 2): 3, (5, 9): 2},
    corners={0: 1, 10: 4},
    holes=[2, 5],
    scheme="catmull-clark",
    units=0.01,
    channels={"uv": (np.arange(48).reshape(24, 2), np.arange(24)[::-1], "all")},
    face_data={"group": ["a", "b", "b", "a", "c", ""], "id": [0, 1, 2, 3, 4, 4], "n": np.eye(6)},
)


def test_a_part_of_a_cage():
    part = ls.selected(GRID, {"group": ["b", ""]})
    faces = [1, 2, 5]
    corners = GRID.indices.reshape(6, 4)[faces].ravel()
    assert part.points[part.indices].tolist() == GRID.points[corners].tolist()
    assert part.n_vertices == 8
    a, b, d = (part.points.tolist().index(POINTS[i]) for i in (1, 2, 10))
    assert [x.tolist() for x in part.creases] == [[[a, b]], [3]]  # (5, 9) is in no face
    assert [x.tolist() for x in part.corners] == [[d], [4]]
    assert part.holes.tolist() == [1, 2]
    values, rows, how = part.channels["uv"]
    expected = GRID.channels["uv"][0][GRID.channels["uv"][1].reshape(6, 4)[faces].ravel()]
    assert values[rows].tolist() == expected.tolist()
    assert (how, part.scheme, part.units) == ("all", "catmull-clark", 0.01)
    assert part.face_data["id"].tolist() == [1, 2, 4]
    whole = ls.selected(GRID, range(6))
    assert whole == GRID.with_tags(channels=whole.channels)


@pytest.mark.parametrize(
    ("chosen", "faces"),
    [
        ({"group": "a"}, [0, 3]),
        ({"group": "b", "id": [2, 4]}, [2]),
        ({"id": 4}, [4, 5]),
        ([5, 0, 0], [0, 5]),
        (np.arange(6) < 2, [0, 1]),
    ],
)
def test_ways_to_choose(chosen, faces):
    assert ls.selected(GRID, chosen).face_data["n"].argmax(axis=1).tolist() == faces


@pytest.mark.parametrize(
    ("chosen", "kind", "message"),
    [
        ({"group": "d"}, ValueError, "no face has group 'd': they have '', 'a', 'b', 'c'"),
        ({"group": 1}, ValueError, "no face has group 1"),
        ({"id": "1"}, ValueError, "no face has id '1': they have 0, 1, 2, 3, 4"),
        ({"lid": 1}, ValueError, "no data of faces 'lid': the cage has 'group', 'id', 'n'"),
        ({"n": 1}, ValueError, "'n' are rows of numbers: give a mask"),
        ({"group": "a", "id": 4}, ls.MeshError, "no face is selected"),
        ([], ls.MeshError, "no face is selected"),
        ([6], IndexError, "face 6 is out of range, need 0 to 5"),
        ([-1], IndexError, "face -1 is out of range, need 0 to 5"),
        ([True], IndexError, r"got a mask of shape \(1,\), need \(6,\)"),
        ([0.5], TypeError, "need a mapping such as"),
        ("group", TypeError, "need a mapping such as"),
    ],
)
def test_no_such_part(chosen, kind, message):
    with pytest.raises(kind, match=message):
        ls.selected(GRID, chosen)
