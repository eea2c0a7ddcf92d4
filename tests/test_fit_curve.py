"""Spline curves: within the tolerance by dense measurement, as SciPy evaluates them."""

import numpy as np
import pytest
from scipy.interpolate import BSpline, splev, splprep

import limitsurf as ls

ANGLE = np.linspace(0, 2 * np.pi, 240, endpoint=False)
CIRCLE = np.stack([np.cos(ANGLE), np.sin(ANGLE)], axis=1)
SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
QUADS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
RING = {(0, 1): 10.0, (1, 3): 10.0, (2, 3): 10.0, (0, 2): 10.0}
SHEET = ls.Mesh(
    [[x, y, 0.2 * x * x - 0.1 * x * y + 0.05 * y**3] for x in range(4) for y in range(4)],
    [[4 * i + j, 4 * i + j + 4, 4 * i + j + 5, 4 * i + j + 1] for i in range(3) for j in range(3)],
    boundary="edge_only",
)


def far_from(curves, k, points):
    """The largest distance of points from curve k, by brute force."""
    t = np.union1d(np.linspace(*curves.domain[k], 2001), curves[k][0])
    dense = curves.evaluate(k, t)
    start, way = dense[:-1], np.diff(dense, axis=0)
    along = ((points[:, None] - start) * way).sum(axis=2) / (way**2).sum(axis=1)
    nearest = start + np.clip(along, 0, 1)[..., None] * way
    return np.linalg.norm(points[:, None] - nearest, axis=2).min(axis=1).max()


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6, 1e-12])
def test_circle_is_within_the_tolerance(tolerance):
    found = ls.fit_curve(CIRCLE, closed=True, tolerance=tolerance)
    assert found.deviation[0] <= tolerance
    dense = found.evaluate(0, np.linspace(*found.domain[0], 3001))
    # between points too, but for what 240 points tell of a circle
    assert np.abs(np.linalg.norm(dense, axis=1) - 1).max() < 1.2 * tolerance + 1e-8
    # two derivatives go on where it ends
    for nu in range(3):
        a, b = (found.evaluate(0, t, nu=nu) for t in found.domain[0])
        assert np.abs(a - b).max() < 1e-8


def test_knots_and_points_are_those_of_scipy():
    found = ls.fit_curve([CIRCLE[:100], 2 * CIRCLE[:60]], tolerance=1e-5)
    assert len(found) == 2
    for k in range(2):
        knots, points = found[k]
        t = np.linspace(*found.domain[k], 50)
        for nu in range(4):
            assert (BSpline(knots, points, 3)(t, nu=nu) == found.evaluate(k, t, nu=nu)).all()
        assert len(knots) == len(points) + 4
        assert (knots[:4] == knots[0]).all()
    both = found.evaluate([[0], [1]], [0.1, np.nan])
    assert both.shape == (2, 2, 2)
    assert np.isnan(both[:, 1]).all()
    assert np.isfinite(both[:, 0]).all()


def test_fewer_knots_than_the_smoothing_spline_of_fitpack():
    """FITPACK's splines of the least sum of squares that keeps the same distance."""
    x = np.linspace(0, 6, 400)
    points = np.stack([x, np.sin(x), 0.3 * x * np.cos(2 * x)], axis=1)
    tolerance = 1e-4
    found = ls.fit_curve(points, tolerance=tolerance)
    assert far_from(found, 0, points) <= tolerance + 1e-6
    for exponent in np.linspace(-4, -10, 25):
        known, u = splprep(points.T, s=10.0**exponent)
        if np.linalg.norm(np.transpose(splev(u, known)) - points, axis=1).max() <= tolerance:
            break
    assert len(found[0][0]) < 1.3 * len(known[0])


def test_corners_stay():
    square = ls.fit_curve(SQUARE, closed=True)
    knots, _ = square[0]
    assert knots.tolist() == [0, 0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4, 4]
    assert square.evaluate(0, range(5)).tolist() == [*SQUARE.tolist(), [0, 0]]
    assert np.abs(square.evaluate(0, 1.5) - [1, 0.5]).max() < 1e-15
    # arcs between two corners: the corners are gone through
    half = CIRCLE[:121]
    closed = ls.fit_curve(half, closed=True, tolerance=1e-5)
    assert far_from(closed, 0, half) < 1.1e-5
    first = closed.evaluate(0, closed.domain[0])
    assert (first == half[0]).all() or (first == half[-1]).all()
    sharp = closed[0][0]
    assert sum((sharp == t).sum() >= 3 for t in np.unique(sharp)) == 3


@pytest.mark.parametrize("n", [2, 3, 4, 5])
def test_few_points_are_gone_through(n):
    points = CIRCLE[: 10 * n : 10]
    found = ls.fit_curve(points, tolerance=1e-14)
    assert (found.evaluate(0, found.domain[0]) == points[[0, -1]]).all()
    assert found.deviation[0] < 1e-14
    assert far_from(found, 0, points) < 1e-3


def test_sections_of_surfaces():
    points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    creases = {(4, 5): 10, (5, 7): 10, (6, 7): 10, (4, 6): 10}
    surface = ls.LimitSurface(ls.Mesh(points, quads, creases=creases))
    cut = ls.section(surface, [0.5, 0.5, 0.5], [0, 1, 0.1])
    found = ls.fit_curve(cut)
    assert (found.closed == cut.closed).all()
    assert len(found) == len(cut) == 1
    side = np.ptp(cut.point, axis=0).max()
    assert found.deviation[0] <= 1e-4 * side
    # the curve is on the surface, between points as well, and in the plane
    dense = found.evaluate(0, np.linspace(*found.domain[0], 200))
    assert np.abs(ls.closest_point(surface, dense).distance).max() < 4e-4 * side
    assert np.abs((dense - 0.5) @ [0, 1, 0.1]).max() < 1e-12
    # the crease is crossed twice
    knots = found[0][0]
    inner = [t for t in np.unique(knots) if (knots == t).sum() == 3]
    assert len(inner) == 1  # and the other is where it begins
    empty = ls.fit_curve(ls.section(surface, [0, 0, 9], [0, 0, 1]))
    assert len(empty) == 0
    assert empty.evaluate([], []).shape == (0, 3)


def test_units_and_places_do_not_matter():
    one = ls.fit_curve(CIRCLE, closed=True, tolerance=2.0**-10)
    two = ls.fit_curve(CIRCLE * 2.0**200, closed=True, tolerance=2.0**190)
    assert (two.points == one.points * 2.0**200).all()
    assert (two.knots == one.knots * 2.0**200).all()
    far = ls.fit_curve(CIRCLE + 2.0**20, closed=True, tolerance=2.0**-10)
    assert np.abs(far.points - one.points - 2.0**20).max() < 1e-8


def test_curves_that_go_back_and_points_too_near_to_the_last():
    back = [[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]]
    assert far_from(ls.fit_curve(back, closed=True), 0, np.array(back)) < 1e-15
    near = ls.fit_curve([[0, 0], [1e-300, 0], [1.0, 0]])
    assert near.evaluate(0, near.domain[0]).tolist() == [[0, 0], [1, 0]]


def test_repeated_points_and_noise():
    twice = np.repeat(CIRCLE, 2, axis=0)
    assert len(ls.fit_curve(twice, closed=True, tolerance=1e-4).points) < 30
    shut = np.concatenate([CIRCLE, CIRCLE[:1]])
    assert ls.fit_curve(shut).closed.all()
    rng = np.random.default_rng(1)
    noisy = CIRCLE + 1e-3 * rng.normal(size=CIRCLE.shape)
    found = ls.fit_curve(noisy, closed=True, tolerance=4e-3, corner_angle=179)
    assert len(found.points) < 40
    scattered = ls.fit_curve(rng.random((60, 3)), tolerance=1e-9, corner_angle=179.9)
    assert scattered.deviation[0] < 1e-9


@pytest.mark.parametrize(
    ("error", "match", "points", "options"),
    [
        (ValueError, "fewer than two", [[0.0, 1.0]], {}),
        (ValueError, "fewer than two", [[0.0, 1.0]] * 3, {}),
        (ValueError, "fewer than two", np.zeros((0, 2)), {}),
        (ValueError, "point 1 of curve 0", [[0, 0], [np.nan, 1]], {}),
        (ValueError, r"shape \(n, d\)", [1.0, 2.0], {}),
        (ValueError, "one d", [CIRCLE, np.zeros((4, 3))], {}),
        (TypeError, "real numbers", CIRCLE * 1j, {}),
        (ValueError, "float64 cannot hold", CIRCLE * 1e308, {"closed": True}),
        (ValueError, "tolerance must be", CIRCLE, {"tolerance": 0}),
        (ValueError, "corner_angle must be", CIRCLE, {"corner_angle": 180}),
        (ValueError, "closed must be one for each of 1", CIRCLE, {"closed": [True, False]}),
        (ValueError, "edges are those of a surface", CIRCLE, {"edges": "crease"}),
        (ValueError, "edges must be 'boundary'", SHEET, {"edges": "rim"}),
        (ValueError, "closed is of points", SHEET, {"closed": True}),
        (ValueError, "scheme 'doo-sabin' have no sides", SHEET.with_tags(scheme="doo-sabin"), {}),
        (ValueError, "points of shape", SHEET.with_points(SHEET.points[:, :2]), {}),
    ],
)
def test_what_is_wrong_is_said(error, match, points, options):
    with pytest.raises(error, match=match):
        ls.fit_curve(points, **options)


def periodic(points, n=400):
    """Points of the closed uniform cubic B-spline of a polygon (Catmull and Clark 1978)."""
    k = len(points)
    spline = BSpline(np.arange(-3.0, k + 4.0), np.concatenate([points, points[:3]]), 3)
    return spline(np.linspace(0, k, n))


@pytest.mark.parametrize("scheme", ["catmull-clark", "loop"])
def test_boundaries_and_creases_of_surfaces_are_splines_of_the_cage(scheme):
    sheet, cube, tolerance = SHEET, ls.Mesh(CORNERS, QUADS, creases=RING), 1e-6
    if scheme == "loop":
        halves = lambda quads: [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]  # noqa: E731
        sheet = ls.Mesh(SHEET.points, halves(SHEET.uniform), boundary="edge_only", scheme=scheme)
        cube = ls.Mesh(CORNERS, halves(QUADS), creases=RING, scheme=scheme)
    for mesh, vertices in (
        (sheet, [0, 1, 2, 3, 7, 11, 15, 14, 13, 12, 8, 4]),
        (cube, [0, 1, 3, 2]),
    ):
        found = ls.fit_curve(mesh, tolerance=tolerance)
        assert found.closed.tolist() == [True]
        assert found.deviation[0] < 1e-14
        assert len(found.points) == len(vertices) + 3
        # at the ends of sides, in either direction
        own = periodic(mesh.points[vertices], len(vertices) + 1)[:-1]
        there = found.evaluate(0, np.arange(len(vertices)))
        assert np.linalg.norm(own[:, None] - there, axis=2).min(axis=1).max() < 1e-14
        # the polyline of far_from is 1e-5 off by itself
        assert far_from(found, 0, periodic(mesh.points[vertices])) < 3e-5
        # with a larger tolerance fewer knots do
        loose = ls.fit_curve(mesh, tolerance=0.1)
        assert len(loose.points) < len(vertices) + 3 or len(vertices) == 4
        assert far_from(loose, 0, periodic(mesh.points[vertices])) < 0.1
    both = ls.fit_curve(ls.LimitSurface(cube.with_tags(boundary="edge_only")), edges="boundary")
    assert len(both) == 0


def test_curves_of_surfaces_end_at_branches_and_corners_stay():
    three = ls.fit_curve(ls.Mesh(CORNERS, QUADS, creases={(0, 1): 10, (0, 2): 10, (0, 4): 10}))
    assert (len(three), three.closed.any()) == (3, False)
    ends = np.concatenate([three.evaluate(k, three.domain[k]) for k in range(3)])
    assert sorted((np.abs(ends) < 1e-15).all(axis=1)) == [False] * 3 + [True] * 3
    # with corners kept, the rim has four of them, and two ends where it closes
    rim = ls.fit_curve(SHEET.with_tags(boundary="edge_and_corner"))
    knots = rim[0][0]
    assert sum((knots == t).sum() >= 3 for t in np.unique(knots)) == 6
    # of an n-gon too, by halves of its edges; and two parts are two curves
    pentagon = [[np.cos(2 * np.pi * k / 5), np.sin(2 * np.pi * k / 5), 0] for k in range(5)]
    far = np.add(pentagon, [3, 0, 0])
    two = ls.Mesh(np.concatenate([pentagon, far]), [[0, 1, 2, 3, 4], [5, 6, 7, 8, 9]],
                  boundary="edge_only")  # fmt: skip
    found = ls.fit_curve(two, tolerance=1e-5)
    assert found.closed.tolist() == [True, True]
    assert far_from(found, 0, periodic(np.array(pentagon))) < 2e-5
    assert far_from(found, 1, periodic(far)) < 2e-5


def test_edges_that_have_collapsed_are_no_curves():
    points = SHEET.points.copy()
    points[[0, 1, 2, 3]] = points[0]
    with_point = ls.fit_curve(SHEET.with_points(points), tolerance=1e-4)
    assert with_point.deviation[0] <= 1e-4
    assert len(ls.fit_curve(SHEET.with_points(0 * points))) == 0


def test_wrong_places_on_curves_are_said():
    found = ls.fit_curve(CIRCLE, tolerance=1e-3)
    with pytest.raises(IndexError, match="curve 1 is out of range"):
        found.evaluate(1, 0.0)
    with pytest.raises(ValueError, match="outside of the domain of curve 0"):
        found.evaluate(0, -0.1)
    with pytest.raises(IndexError, match="need 0 to 0"):
        found[1]
