"""Curves where two surfaces meet, against conics, sections, and parity."""

import warnings

import numpy as np
import pytest
import zoo
import zoo_triangles
from test_query_sections import SURFACES, UP, area, curves, farthest, made, pieces, quadric, some

import limitsurf as ls


def plane(origin, normal, size):
    """A flat square that is larger than a surface, its middle not at `origin`."""
    normal = np.asarray(normal) / np.linalg.norm(normal)
    x = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    x /= np.linalg.norm(x)
    y = np.cross(normal, x)
    points = [origin + size * (i * x + j * y) for i in (-3.0, 3.1) for j in (-2.9, 3.0)]
    return made((points, [[0, 2, 3, 1]]), scheme="bilinear")


def off_both(found, a, b):
    """How far points are from what both surfaces say, of the size of the larger one."""
    size = max(np.abs(x.points).max() for x in (a, b))
    there = b.evaluate(found.other_face, found.other_u, found.other_v)
    assert (found.point == a.evaluate(found.face, found.u, found.v)).all()
    return np.abs(found.point - there).max(initial=0) / size


CONICS = {
    "circle": ((1, 1, 0), (0, 0), 2.5, [True]),
    "ellipse": ((2, 1, 0.5), (0.31, 0.17), 1.7, [True]),
    "loop_inside_a_face": ((1, 2, 0.5), (0.3, 0.41), 1e-3, [True]),
    "tiny_loop": ((1, 2, 0.5), (0.3, 0.41), 1e-10, [True]),
    "nothing": ((1, 1, 0), (0.3, 0.41), -1e-9, []),
    "hyperbola": ((1, -1, 0.3), (0.3, 0.41), 1e-6, [False] * 2),
    "line_twice": ((1, 0, 0), (0, 0), 0.25, [False] * 2),
}


@pytest.mark.parametrize("name", CONICS)
def test_planes_meet_quadrics_in_conics(name):
    (a, b, c), shift, height, closed = CONICS[name]
    surface, flat = quadric(a, b, c, shift), plane([0.3, 0.2, height], UP, 3.0)
    tolerance = 1e-4 * np.sqrt(height) if all(closed) and height > 0 else 1e-5
    found = ls.intersect_surfaces(surface, flat, tolerance=tolerance)
    assert found.closed.tolist() == closed
    assert off_both(found, surface, flat) <= 1e-12
    if not closed:
        return
    size = np.abs(surface.points).max()
    x, y, z = found.point.T
    assert np.abs(z - height).max() <= 1e-12 * size
    assert np.abs(a * x * x + b * y * y + c * x * y - height).max() <= 1e-12 * size
    p, q = pieces(found)
    x, y, _ = ((p + q) / 2).T
    slope = np.hypot(2 * a * x + c * y, 2 * b * y + c * x)
    off = np.abs(a * x * x + b * y * y + c * x * y - height)
    assert (off / slope <= 1.01 * tolerance).all()
    if height > 0 and all(closed):
        inside = 2 * np.pi * height / np.sqrt(4 * a * b - c * c)
        assert abs(area(found, UP)) == pytest.approx(inside, rel=1e-3)


def test_quadrics_meet_in_a_curve_that_is_known():
    # z = x^2 + y^2 and z = 1.5 - x^2 / 2 - 2 y^2: an ellipse seen from above
    one, two = quadric(1, 1, 0, (0.1, 0.07)), quadric(-0.5, -2, 0, (0.21, 0.33))
    two = two.with_points(two.points + 1.5 * UP)
    found = ls.intersect_surfaces(one, two)
    assert found.closed.tolist() == [True]
    assert off_both(found, one, two) <= 1e-12
    x, y, z = found.point.T
    assert np.abs(1.5 * x * x + 3 * y * y - 1.5).max() <= 1e-11
    assert np.abs(z - x * x - y * y).max() <= 1e-11
    assert abs(area(found, UP)) == pytest.approx(np.pi * np.sqrt(0.5), rel=1e-3)
    # along the cross product of the normals
    normals = [
        s.normal(f, u, v)
        for s, f, u, v in (
            (one, found.face, found.u, found.v),
            (two, found.other_face, found.other_u, found.other_v),
        )
    ]
    step = np.roll(found.point, -1, axis=0) - found.point
    assert ((np.cross(*normals) * step).sum(axis=1) > 0).all()


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.parametrize("through", ["anywhere", "vertex", "middle", "symmetry"])
def test_planes_meet_surfaces_in_their_sections(name, through):
    surface = SURFACES[name]()
    rng = np.random.default_rng(len(name))
    middle, size = surface.points.mean(axis=0), np.ptp(surface.points, axis=0).max()
    normal = UP if through == "symmetry" else rng.normal(size=3)
    origin = middle + 0.05 * rng.normal(size=3) * (through == "anywhere")
    if through == "vertex":
        origin = surface.evaluate(0, 0.0, 0.0)
    flat = plane(origin, normal, size)
    wanted = ls.section(surface, origin, normal, tolerance=1e-3 * size)
    found = ls.intersect_surfaces(surface, flat, tolerance=1e-3 * size)
    assert sorted(found.closed) == sorted(wanted.closed)
    assert off_both(found, surface, flat) <= 1e-12
    if len(found):
        assert farthest(some(found.point), wanted) <= 2.1e-3 * size
        assert farthest(some(wanted.point), found) <= 2.1e-3 * size


TRIANGLES = {name: ls.schemes[name].lattice.sloped for name in ls.schemes.with_pieces}


@pytest.mark.parametrize("name", ls.schemes.with_pieces)
def test_closed_surfaces_of_all_schemes_meet_in_closed_curves(name):
    solid = zoo_triangles.icosahedron() if TRIANGLES[name] else zoo.cube()
    a, b = made(solid, scheme=name), made(zoo.cube())
    b = b.with_points((b.points - 0.5) * np.ptp(a.points, axis=0).max())
    middle = a.points.mean(axis=0)
    rng = np.random.default_rng(3)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    other = b.with_points(b.points @ turn + middle + 0.1 * rng.normal(size=3))
    found = ls.intersect_surfaces(a, other)
    assert found.closed.all()
    assert off_both(found, a, other) <= 1e-12
    turned = ls.intersect_surfaces(other, a)
    assert len(turned) == len(found) > 0
    assert farthest(some(turned.point, 30), found) <= 1e-3 * np.ptp(a.points)


def test_surfaces_that_are_apart_do_not_meet():
    a = made(zoo.cube())
    for shift in ([5.0, 0, 0], [0.8, 0.8, 0.0]):  # (their boxes meet)
        found = ls.intersect_surfaces(a, a.with_points(a.points + shift))
        assert len(found) == len(found.point) == len(found.other_u) == 0
        assert found.offsets.tolist() == [0]


@pytest.mark.parametrize("case", ["touch", "saddle", "same"])
def test_a_warning_names_where_surfaces_touch(case):
    if case == "same":
        one = two = quadric(1, 1, 0, n=4)
    else:
        one = quadric(1, 1 if case == "touch" else -1, 0, (0.3, 0.41))
        two = plane([0.1, 0.2, 0.0], UP, 3.0)
    with pytest.warns(UserWarning, match=r"touch, or coincide, near \("):
        found = ls.intersect_surfaces(one, two)
    assert len(found) == {"touch": 0, "saddle": 4, "same": 0}[case]
    if case == "saddle":  # each ends there
        ends = np.concatenate([p[[0, -1]] for p in curves(found)])
        assert (np.abs(ends).max(axis=1) < 1e-4 * 3).sum() == 4


def test_answers_do_not_depend_on_units_and_threads():
    a = made(zoo.cube())
    b = a.with_points(a.points + np.array([0.3, 0.2, 0.1]))
    found = ls.intersect_surfaces(a, b)
    threads = ls.intersect_surfaces(a, b, workers=2)
    assert (threads.point == found.point).all()
    scale = 2.0**300
    large = ls.intersect_surfaces(a.with_points(a.points * scale), b.with_points(b.points * scale))
    assert (large.point == found.point * scale).all()


def test_errors_come_first():
    a = made(zoo.cube())
    with pytest.raises(TypeError, match="need a LimitSurface, got int"):
        ls.intersect_surfaces(a, 3)
    with pytest.raises(ValueError, match="tolerance must be above 0, got -1"):
        ls.intersect_surfaces(a, a, tolerance=-1)
    flat = ls.LimitSurface(ls.Mesh(a.points[:, :2], a.mesh.faces))
    with pytest.raises(ValueError, match=r"need points of shape \(n_vertices, 3\)"):
        ls.intersect_surfaces(a, flat)


def test_small_tolerances_take_more_points_that_are_nearer():
    a, b = quadric(1, 1, 0), plane([0, 0, 2.0], UP, 3.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for tolerance in (1e-2, 1e-4, 1e-6):
            found = ls.intersect_surfaces(a, b, tolerance=tolerance)
            p, q = pieces(found)
            radius = np.hypot(*((p + q) / 2)[:, :2].T)
            assert np.sqrt(2) - radius.min() <= tolerance
