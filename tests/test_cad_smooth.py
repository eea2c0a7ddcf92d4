"""Spline faces that share tangent planes around poles."""

import warnings

import numpy as np
import pytest
import zoo
from scipy.interpolate import NdBSpline

import limitsurf as ls

CASES = {
    "cube": (zoo.cube, {}),
    "prism": (lambda: zoo.prism(5), {}),
    "even": (lambda: zoo.prism(6), {}),
    "semi-sharp": (zoo.cube, {"creases": {(0, 1): 1.5, (1, 3): 0.5}}),
}


def surface_of(name):
    points_and_faces, options = CASES[name]
    return ls.LimitSurface(ls.Mesh(*points_and_faces(), **options))


def flower(valence):
    """A bent disc of quads around one vertex."""
    points, faces = zoo.flower(valence)
    points = np.array(points, dtype=float)
    points[:, 2] += 0.3 * points[:, 0] ** 2 - 0.2 * points[:, 0] * points[:, 1] + 0.1 * points[:, 1]
    return ls.LimitSurface(ls.Mesh(points, faces))


def shared_edges(surface):
    """Pairs of (limit face, corner) where an edge of quads begins, found by their vertices."""
    corners = {}
    for face in range(surface.mesh.n_faces):
        ring = list(surface.mesh.faces[face])
        for k, (a, b) in enumerate(zip(ring, ring[1:] + ring[:1], strict=True)):
            corners[int(a), int(b)] = face, k
    return [
        (here, corners[b, a]) for (a, b), here in corners.items() if a < b and (b, a) in corners
    ]


def along(corner, s):
    ends = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], dtype=float)
    return (ends[corner] + s[:, None] * (ends[(corner + 1) % 4] - ends[corner])).T


def by_scipy(faces, face, u, v):
    """Points, and normals, of one face."""
    which, x, y = faces.of(face, u, v)
    one = faces[int(which[0])]
    assert (which == which[0]).all()
    oracle = NdBSpline((one.knots_u, one.knots_v), one.points, one.degree)
    place = np.stack([x, y], axis=1)
    normal = np.cross(oracle(place, nu=(1, 0)), oracle(place, nu=(0, 1)))
    return oracle(place), normal / np.linalg.norm(normal, axis=1)[:, None]


@pytest.mark.parametrize("depth", [2, 8])
@pytest.mark.parametrize("valence", [3, 5, 6, 8, 12, 20])
def test_tangent_planes_are_shared(valence, depth):
    surface = flower(valence)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of corners of the boundary, where it is
        faces = ls.bspline_faces(surface, depth=depth, poles="g1", merge=False)
    assert faces.degree == (3, 3)
    assert faces.smooth.sum() == valence
    s = np.concatenate([np.linspace(0, 1, 300), 2.0 ** -np.linspace(0, 30, 300)])
    for (face, k), (other, m) in shared_edges(surface):
        one, n = by_scipy(faces, np.full(600, face), *along(k, s))
        two, o = by_scipy(faces, np.full(600, other), *along(m, 1 - s))
        assert np.abs(one - two).max() < 1e-14
        assert np.degrees(2 * np.arcsin(np.linalg.norm(n - o, axis=1).max() / 2)) < 1e-7
    # and the limit's at the pole
    face, corner = np.argwhere(faces.smooth)[0]
    u, v = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])[corner]
    assert np.abs(faces.evaluate(face, u, v) - surface.evaluate(face, u, v)).max() < 1e-14
    assert np.abs(faces.normal(face, u, v) - surface.normal(face, u, v)).max() < 1e-9


@pytest.mark.parametrize("name", CASES)
def test_bounds_hold(name):
    surface = surface_of(name)
    faces = ls.bspline_faces(surface, depth=6, poles="g1")
    assert (faces.smooth == (faces.depths >= 0)).all()
    found, plain = (
        ls.deviation(surface, faces),
        ls.deviation(surface, ls.bspline_faces(surface, depth=6)),
    )
    assert found.gap.max() < 1e-14
    assert (found.edge_angle_found <= found.edge_angle + 1e-12).all()
    assert np.degrees(found.edge_angle.max()) < 1e-6 < np.degrees(plain.edge_angle_found.max())
    for bound in ("parametric", "along_normal", "angle"):
        most, seen = getattr(found, bound), getattr(found, f"{bound}_found")
        assert most.max() <= 3 * seen.max()
        assert (seen <= most + 1e-9).all()
    assert found.parametric.max() <= 1.1 * plain.parametric.max()
    rng = np.random.default_rng(4)
    face = rng.integers(0, len(surface.limit_faces), 4000)
    corner = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])[rng.integers(0, 4, 4000)]
    away = rng.random((4000, 2)) * 2.0 ** -rng.uniform(0, 12, (4000, 1))
    u, v = np.abs(corner - away).T
    which, x, y = faces.of(face, u, v)
    truth, step = surface.normal(face, u, v), faces.evaluate(which, x, y)
    step -= surface.evaluate(face, u, v)
    assert (np.linalg.norm(step, axis=1) <= found.parametric[which]).all()
    assert (np.abs((step * truth).sum(axis=1)) <= found.along_normal[which]).all()
    turn = 2 * np.arcsin(np.linalg.norm(truth - faces.normal(which, x, y), axis=1) / 2)
    assert (turn <= found.angle[which] + 1e-9).all()
    # outside of cells at poles nothing has changed
    size = np.ldexp(1.0, (surface.limit_faces.corner[face] >= 0).astype(int) - 6)[:, None, None]
    far = np.abs(np.stack([u, v], axis=1)[:, None] - np.array([(0, 0), (1, 0), (1, 1), (0, 1)]))
    outside = (far >= size).any(axis=2).all(axis=1)
    assert np.linalg.norm(step, axis=1)[outside].max() < 1e-14


def test_faces_are_smooth_inside():
    """Derivatives on both sides of double knots."""
    faces = ls.bspline_faces(surface_of("prism"), depth=4, poles="g1")
    one = faces[0]
    knots, count = np.unique(one.knots_u, return_counts=True)
    double = knots[1:-1][count[1:-1] == 2]  # in halves of edges, as of all faces of n-gons
    assert count[1:-1].max() == 2
    assert {2.0**-3, 2.0**-4} <= set(double.tolist())
    v = np.linspace(0, 1, 101)[1:-1]
    for knot in double.tolist():
        oracle = NdBSpline((one.knots_u, one.knots_v), one.points, one.degree)
        for nu in ((0, 0), (1, 0), (0, 1), (1, 1)):
            low, high = (
                oracle(np.stack([np.full(99, knot + e), v], axis=1), nu=nu) for e in (-1e-9, 1e-9)
            )
            assert np.abs(low - high).max() < 1e-4


def test_a_tolerance_is_kept():
    surface = surface_of("even")
    for tolerance in (1e-2, 1e-4):
        faces = ls.bspline_faces(surface, tolerance=tolerance, g1_angle=1.0, poles="g1")
        assert faces.deviation.max() <= tolerance
    # an angle between faces that have none takes no depth
    assert ls.bspline_faces(surface, g1_angle=0.01, poles="g1").depths.max() <= 3


def test_poles_that_cannot_stay_as_they_are():
    points, faces = zoo.cube()
    options = {"creases": {(0, 1): 10, (1, 3): 10, (3, 2): 10}, "corners": {6: 10}}
    surface = ls.LimitSurface(ls.Mesh(points, faces, **options))
    with pytest.warns(RuntimeWarning, match=r'^5 poles of 8 .* stay "g0"'):
        some = ls.bspline_faces(surface, depth=6, poles="g1")
    assert some.smooth.sum() == 9
    found = ls.deviation(surface, some)
    assert found.gap.max() < 1e-14
    assert (np.nan_to_num(found.edge_angle, nan=np.pi) >= found.edge_angle_found - 1e-9).all()
    for scheme in ("doo-sabin", "loop"):
        other = ls.LimitSurface(ls.Mesh(*zoo.octahedron(), scheme=scheme))
        with pytest.warns(RuntimeWarning, match="Catmull and Clark"):
            as_before = ls.bspline_faces(other, depth=5, poles="g1")
        assert not as_before.smooth.any()
        assert np.array_equal(as_before.points, ls.bspline_faces(other, depth=5).points)
    flat = ls.LimitSurface(ls.Mesh(np.zeros((8, 3)), faces))
    with pytest.warns(RuntimeWarning, match="8 poles of 8"):
        assert not ls.bspline_faces(flat, poles="g1").smooth.any()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        torus = ls.bspline_faces(ls.LimitSurface(ls.Mesh(*zoo.torus(8, 6))), poles="g1")
    assert torus.exact.all()


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match='"g0" or "g1"'):
        ls.bspline_faces(surface_of("cube"), poles="g2")
    plane = ls.LimitSurface(ls.Mesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2, 3]]))
    with pytest.raises(ValueError, match="in space"):
        ls.bspline_faces(plane, poles="g1")
