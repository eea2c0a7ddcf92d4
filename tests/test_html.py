"""What notebooks show: tables of HTML."""

import pickle
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest
import zoo

import limitsurf as ls
from limitsurf import html


class Cells(HTMLParser):
    """The texts of a table, and whether all of its elements are closed."""

    def __init__(self, text):
        super().__init__()
        self.open, self.cells = [], []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attributes):
        self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.cells.append(data)


def cube(**tags):
    points, faces = zoo.cube()
    return ls.Mesh(np.array(points, dtype=float), faces, **tags)


def test_facts():
    mesh = cube(creases={(0, 1): 2}, boundary="edge_only", face_data={"<b>": np.arange(6)})
    cells = Cells(mesh._repr_html_()).cells
    assert cells[:7] == ["Mesh", "vertices", "8", "edges", "12", "faces", "6 {4: 6}"]
    assert cells[cells.index("creases") + 1] == "1"
    assert cells[cells.index("boundary") + 1] == "edge_only"
    assert cells[cells.index("face data") + 1] == "<b>"
    surface = ls.LimitSurface(mesh)
    cells = Cells(surface._repr_html_()).cells
    assert cells[:5] == ["LimitSurface", "limit faces", "6", "vertices", "8"]
    assert "catmull-clark" in cells
    cells = Cells(ls.tessellate(surface, 2)._repr_html_()).cells
    assert cells[3:5] == ["faces", "24"]


def test_tables():
    surface = ls.LimitSurface(cube())
    cells = Cells(ls.eigenbasis(valence=5)._repr_html_()).cells
    assert cells[cells.index("0.549988") + 1] == "2"
    closest = ls.closest_point(surface, np.zeros((3, 4, 3)))
    cells = Cells(closest._repr_html_()).cells
    assert cells[0] == "ClosestPoints(12 points)"
    assert cells[-1] == "12 rows, of which these are the first"
    assert len(Cells(ls.bounds(surface)._repr_html_()).cells) == 1 + 2 + 2 * 6
    nothing = ls.closest_point(surface, np.zeros((0, 3)))
    assert Cells(nothing._repr_html_()).cells[-1] == "point"


@pytest.mark.parametrize(
    ("make", "first", "head"),
    [
        (
            lambda s: ls.feet(s, [[0, 0, 0], [2.0, 0, 0]], within=2),
            "FeetOfPoints(",
            ["foot of point", "face", "u", "v", "distance", "point"],
        ),
        (
            lambda s: ls.intersect(s, [[[0.4, 0.5, 5], [9, 9, 9]]], [0, 0, -1.0]),
            "RayHits(2 rays, 1 hit)",
            ["hit", "t", "face", "u", "v", "point", "normal", "True"],
        ),
        (
            lambda s: ls.intersect_all(s, [[9, 9, 9], [0.4, 0.5, 5]], [[0, 0, -1.0]] * 2),
            "AllRayHits(2 hits of 2 rays)",
            ["hit of ray", "t", "face", "u", "v", "multiplicity", "point", "normal", "1"],
        ),
        (
            lambda s: ls.sample(s, 3, rng=0),
            "Samples(3 samples)",
            ["face", "u", "v", "point", "normal"],
        ),
        (
            lambda s: ls.section(s, [0, 0, 0.4], [0, 0, 1]),
            "Curves(1 curve of ",
            ["points", "closed", "value", "first point"],
        ),
        (
            lambda s: ls.intersect_surfaces(s, s.with_points(s.points + 0.3)),
            "IntersectionCurves(1 curve of ",
            ["points", "closed", "first point"],
        ),
        (
            lambda s: ls.quadrature(s, points=2),
            "Quadrature(",
            ["face", "u", "v", "weights", "0"],
        ),
        (
            lambda s: ls.approximate(s, "acc").error(s),
            "Deviation(6 faces",
            ["face", "parametric", "parametric_found"],
        ),
        (
            lambda s: ls.approximate(s, "acc"),
            "ApproximatePatches",
            ["patches", "6", "kind", "acc", "levels", "0"],
        ),
        (lambda s: ls.bezier_patches(s), "BezierPatches(", ["face", "origin", "size", "0"]),
    ],
)
def test_answers_are_tables(make, first, head):
    cells = Cells(make(ls.LimitSurface(cube()))._repr_html_()).cells
    assert cells[0].startswith(first)
    assert cells[1 : len(head) + 1] == head


def test_answers_of_nothing_are_tables():
    surface = ls.LimitSurface(cube())
    far = ls.intersect_all(surface, [[9.0, 9, 9]], [[0.0, 0, 1]])
    assert Cells(far._repr_html_()).cells[-1] == "normal"
    none = ls.section(surface, [0, 0, 9.0], [0, 0, 1])
    assert Cells(none._repr_html_()).cells[-1] == "first point"


def test_a_report_is_an_array():
    report: Any = ls.validate(ls.LimitSurface(cube()), 2)
    assert Cells(report._repr_html_()).cells[:5] == ["level", "error", "order", "limit_error", "1"]
    assert repr(report).startswith("array([(1, ")
    assert type(report["error"]) is np.ndarray
    assert isinstance(report[:1], html.Report)
    again = pickle.loads(pickle.dumps(report))
    np.testing.assert_array_equal(again, report)
    assert report.reshape(1, 2)._repr_html_() is None


def test_bounds_of_a_mesh_are_those_of_its_surface():
    mesh = cube()
    one, other = ls.bounds(mesh), ls.bounds(ls.LimitSurface(mesh))
    np.testing.assert_array_equal(one.lower, other.lower)
    with pytest.raises(TypeError, match="need a LimitSurface, got Tessellation"):
        ls.bounds(ls.tessellate(ls.LimitSurface(mesh), 1))
