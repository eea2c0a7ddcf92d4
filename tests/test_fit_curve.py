"""Spline curves: within the tolerance by dense measurement, as SciPy evaluates them."""

import numpy as np
import pytest
from scipy.interpolate import BSpline, splev, splprep

import limitsurf as ls

ANGLE = np.linspace(0, 2 * np.pi, 240, endpoint=False)
CIRCLE = np.stack([np.cos(ANGLE), np.sin(ANGLE)], axis=1)
SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])


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
        (ValueError, "tolerance must be", CIRCLE, {"tolerance": 0}),
        (ValueError, "corner_angle must be", CIRCLE, {"corner_angle": 180}),
        (ValueError, "closed must be one for each of 1", CIRCLE, {"closed": [True, False]}),
    ],
)
def test_what_is_wrong_is_said(error, match, points, options):
    with pytest.raises(error, match=match):
        ls.fit_curve(points, **options)


def test_wrong_places_on_curves_are_said():
    found = ls.fit_curve(CIRCLE, tolerance=1e-3)
    with pytest.raises(IndexError, match="curve 1 is out of range"):
        found.evaluate(1, 0.0)
    with pytest.raises(ValueError, match="outside of the domain of curve 0"):
        found.evaluate(0, -0.1)
    with pytest.raises(IndexError, match="need 0 to 0"):
        found[1]
