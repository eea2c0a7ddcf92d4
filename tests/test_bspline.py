"""B-spline faces: the limit itself, to rounding, and how far off cells at special corners are."""

import dataclasses
from fractions import Fraction

import numpy as np
import pytest
import zoo
from scipy.interpolate import NdBSpline
from test_query_closest import made

import limitsurf as ls

CASES = {
    "cube": (zoo.cube, {}),
    "prism": (lambda: zoo.prism(5), {}),
    "flower": (lambda: zoo.flower(7), {}),
    "grid": (lambda: zoo.grid(4, 3), {}),
    "boundary": (lambda: zoo.poles_at_the_boundary(5), {}),
    "sharp": (zoo.cube, {"creases": {(0, 1): 2.5, (1, 3): 10, (3, 2): 10}, "corners": {6: 3}}),
    "doo-sabin": (lambda: zoo.prism(5), {"scheme": "doo-sabin"}),
    "bilinear": (lambda: zoo.prism(5), {"scheme": "bilinear"}),
    "loop": (lambda: zoo.bipyramid(5), {"scheme": "loop"}),
    "loop-warren": (zoo.tetrahedron, {"scheme": "loop-warren"}),
    "linear": (zoo.octahedron, {"scheme": "linear"}),
}


def surface_of(name):
    points_and_faces, options = CASES[name]
    points, faces = points_and_faces()
    return ls.LimitSurface(ls.Mesh(points, faces, **options))


def anywhere(surface, n, seed=0):
    """Places on limit faces that have a limit."""
    rng = np.random.default_rng(seed)
    face = rng.choice(np.flatnonzero(surface.patches.with_limit), n)
    u, v = rng.random((2, n))
    if surface.topology.lattice.sloped:
        u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    return face, u, v


def near_poles(surface, faces, face, u, v):
    """Which places are in cells at special corners."""
    corners = np.array(surface.topology.lattice.corners)
    depth = faces.depths[face]
    size = np.ldexp(1.0, (surface.limit_faces.corner[face] >= 0)[:, None] - depth)
    if len(corners) == 4:
        far = np.maximum(*np.abs(np.stack([u, v])[:, :, None] - corners.T[:, None]))
    else:
        far = np.stack([u + v, 1 - u, 1 - v], axis=1)
    return ((depth >= 0) & (far < size)).any(axis=1)


@pytest.mark.parametrize("merge", [False, True])
@pytest.mark.parametrize("name", CASES)
def test_faces_are_the_limit(name, merge):
    surface = surface_of(name)
    faces = ls.bspline_faces(surface, merge=merge)
    face, u, v = anywhere(surface, 3000)
    far = np.linalg.norm(
        faces.evaluate(*faces.of(face, u, v)) - surface.evaluate(face, u, v), axis=1
    )
    size = np.abs(surface.points).max()
    near = near_poles(surface, faces, face, u, v)
    assert far[~near].max() < 1e-14 * size
    exact = faces.exact[faces.of(face, u, v)[0]]
    assert far[exact].max(initial=0) < 1e-14 * size
    assert not (exact & near).any()


@pytest.mark.parametrize("scheme", ls.schemes.with_pieces)
def test_every_scheme(scheme):
    points, faces = zoo.octahedron()
    surface = ls.LimitSurface(ls.Mesh(points, faces, scheme=scheme))
    found = ls.bspline_faces(surface, depth=5)
    face, u, v = anywhere(surface, 500)
    bound = found.deviation[found.of(face, u, v)[0]] + 1e-14
    step = found.evaluate(*found.of(face, u, v)) - surface.evaluate(face, u, v)
    assert (np.linalg.norm(step, axis=1) <= bound).all()
    assert set(np.unique(found.of(face, u, v)[0])) <= set(range(len(found)))


@pytest.mark.parametrize("name", ["prism", "grid", "doo-sabin", "sharp", "loop"])
def test_scipy_evaluates_them_alike(name):
    surface = surface_of(name)
    faces = ls.bspline_faces(surface, depth=6)
    rng = np.random.default_rng(1)
    for k in rng.choice(len(faces), 4):
        one = faces[k]
        oracle = NdBSpline((one.knots_u, one.knots_v), one.points, one.degree)
        u, v = rng.random((2, 50)) * faces.grid[k][:, None]
        found = faces.evaluate(k, u, v)
        assert np.abs(oracle(np.stack([u, v], axis=1)) - found).max() < 1e-14


def test_geomdl_evaluates_them_alike():
    BSpline = pytest.importorskip("geomdl.BSpline")
    one = ls.bspline_faces(surface_of("cube"), depth=4)[0]
    oracle = BSpline.Surface()
    oracle.degree_u, oracle.degree_v = one.degree
    oracle.ctrlpts_size_u, oracle.ctrlpts_size_v = one.points.shape[:2]
    oracle.ctrlpts = one.points.reshape(-1, 3).tolist()
    oracle.knotvector_u, oracle.knotvector_v = one.knots_u.tolist(), one.knots_v.tolist()
    for u, v in ((0.3, 0.4), (0.1, 0.9)):
        there = surface_of("cube").evaluate(0, u, v)
        assert np.abs(np.array(oracle.evaluate_single((u, v))) - there).max() < 1e-14


def test_regular_faces_have_the_cage_for_control_points():
    """Amid a grid the uniform bicubic spline's control points are the vertices themselves."""
    i, j = (x.ravel() for x in np.mgrid[:8, :9])
    points = np.stack([i, j, (3 * i * i - i * j) % 7], axis=1).astype(float)
    quads = [[a * 9 + b, a * 9 + b + 9, a * 9 + b + 10, a * 9 + b + 1]
             for a in range(7) for b in range(8)]  # fmt: skip
    surface = ls.LimitSurface(ls.Mesh(points, quads, corners={0: 10}))
    (one,) = [ls.bspline_faces(surface)[0]]
    net = one.points[2:-2, 2:-2]
    known = points.reshape(8, 9, 3)
    turned = [np.rot90(known, k) for k in range(4)]
    assert one.points.shape[:2] in {(10, 11), (11, 10)}
    assert any(
        x[1:-1, 1:-1].shape == net.shape and np.abs(x[1:-1, 1:-1] - net).max() < 1e-13
        for x in turned
    )


def test_exact_faces_equal_fractions():
    points, faces = zoo.grid(4, 3)
    fractions = np.vectorize(Fraction, otypes=[object])(np.asarray(points))
    truth = ls.LimitSurface(ls.Mesh(fractions, faces))
    found = ls.bspline_faces(made((points, faces)))
    for face, u, v in ((0, 0.25, 0.5), (5, 0.75, 0.125), (11, 1.0, 0.0)):
        there = truth.evaluate(face, Fraction(u), Fraction(v)).astype(float)
        assert np.abs(found.evaluate(*found.of(face, u, v)) - there).max() < 1e-15


@pytest.mark.parametrize("name", ["cube", "prism", "sharp", "boundary", "doo-sabin", "loop"])
def test_bounds_hold_and_are_near(name):
    surface = surface_of(name)
    faces = ls.bspline_faces(surface, depth=6)
    found = ls.deviation(surface, faces)
    rng = np.random.default_rng(2)
    # half of the places in cells at special corners, at all distances from them
    face, u, v = anywhere(surface, 20000)
    corner = np.array(surface.topology.lattice.corners)[
        rng.integers(0, len(faces.depths[0]), 20000)
    ]
    share = 2.0 ** -rng.uniform(3, 20, 20000) * (np.arange(20000) % 2) + (np.arange(20000) % 2 == 0)
    u, v = corner[:, 0] + share * (u - corner[:, 0]), corner[:, 1] + share * (v - corner[:, 1])
    which, x, y = faces.of(face, u, v)
    truth, step = surface.normal(face, u, v), faces.evaluate(which, x, y)
    step = step - surface.evaluate(face, u, v)
    assert (np.linalg.norm(step, axis=1) <= found.parametric[which]).all()
    along = np.nan_to_num(np.abs((step * truth).sum(axis=1)))
    assert (along <= found.along_normal[which]).all()
    other = faces.normal(which, x, y)
    angle = 2 * np.arctan2(
        np.linalg.norm(truth - other, axis=1), np.linalg.norm(truth + other, axis=1)
    )
    assert (np.nan_to_num(angle) <= found.angle[which] + 1e-9).all()
    for bound in ("parametric", "along_normal"):
        most = getattr(found, bound).max()
        assert most <= 3 * getattr(found, f"{bound}_found").max()
    assert found.gap.max() < 1e-14
    assert (np.nan_to_num(found.edge_angle, nan=np.pi) >= found.edge_angle_found - 1e-9).all()


def test_depth_is_counted_from_edges_so_that_neighbours_meet():
    """Limit faces of a pentagon, with half edges, beside quads that are split for their creases."""
    points, quads = zoo.prism(5)
    surface = ls.LimitSurface(ls.Mesh(points, quads, creases={(0, 1): 1.5, (1, 2): 0.5}))
    found = ls.deviation(surface, ls.bspline_faces(surface, depth=7))
    assert len(found.edges) == 15 + 10  # of the cage, and ways to the middles of both pentagons
    assert found.gap.max() < 1e-14


def test_tolerance_is_kept_with_no_more_than_it_takes():
    surface = surface_of("prism")
    for tolerance in (1e-2, 1e-4, 1e-7):
        faces = ls.bspline_faces(surface, tolerance=tolerance)
        assert faces.deviation.max() <= tolerance
        depth = int(faces.depths.max())
        if depth > 3:  # which is the least that there may be
            assert ls.bspline_faces(surface, depth=depth - 1).deviation.max() > tolerance
    assert ls.deviation(surface, faces).gap.max() < 1e-14


@pytest.mark.parametrize("scheme", ["catmull-clark", "doo-sabin", "loop"])
def test_depths_may_differ_from_corner_to_corner(scheme):
    """A large cell is crossed by the lines to smaller ones at other corners of the face."""
    rng = np.random.default_rng(3)
    points, triangles = zoo.bipyramid(7)
    points = points + 0.1 * rng.normal(size=points.shape)
    surface = ls.LimitSurface(ls.Mesh(points, triangles, scheme=scheme))
    faces = ls.bspline_faces(surface, tolerance=1e-3)
    depths = faces.depths[faces.depths >= 0]
    assert depths.max() > depths.min()
    place = anywhere(surface, 4000)
    step = faces.evaluate(*faces.of(*place)) - surface.evaluate(*place)
    far = np.linalg.norm(step, axis=1)
    assert far[~near_poles(surface, faces, *place)].max() < 1e-14
    found = ls.deviation(surface, faces)
    assert (far <= found.parametric[faces.of(*place)[0]]).all()
    assert found.gap.max() < 1e-14


def test_normals_jump_by_no_more_than_asked():
    surface = surface_of("flower")
    faces = ls.bspline_faces(surface, g1_angle=0.5)
    found = ls.deviation(surface, faces)
    assert np.degrees(np.nanmax(found.edge_angle)) <= 0.5
    assert np.degrees(found.edge_angle_found.max()) <= 0.5
    assert faces.angle.max() <= 0.25


def test_rectangles_fill_what_is_regular():
    mesh = zoo.torus(8, 6)
    faces = ls.bspline_faces(made(mesh))
    assert sorted(faces.grid.prod(axis=1).tolist()) == [12, 12, 12, 12]  # none meets itself
    assert sorted(faces.limit_faces.tolist()) == list(range(48))
    # all but around poles of an L: 3 corners around 3 faces
    i, j = np.mgrid[:8, :8]
    keep = (i < 4) | (j < 4)
    points = [[a, b, 0.1 * a * b] for a in range(9) for b in range(9)]
    quads = [[a * 9 + b, a * 9 + b + 9, a * 9 + b + 10, a * 9 + b + 1]
             for a, b in zip(i[keep].tolist(), j[keep].tolist(), strict=True)]  # fmt: skip
    surface = ls.LimitSurface(ls.Mesh(np.array(points, dtype=float), quads))
    faces = ls.bspline_faces(surface)
    assert sorted(faces.limit_faces.tolist()) == list(range(48))
    assert (faces.grid.prod(axis=1) > 1).sum() <= 4


def test_sharp_edges_part_what_is_merged():
    points, quads = zoo.torus(8, 6)
    ring = [(a, b) for face in quads for a, b in zip(face, face[1:] + face[:1], strict=True)]
    straight = ls.Mesh(points, quads)
    edge = ring[0]
    # the whole loop straight on from an edge
    following, twin, indices = straight.next_corner, straight.twin, straight.indices
    at, loop = 0, []
    while True:
        loop.append((int(indices[at]), int(indices[following[at]])))
        at = following[twin[following[at]]]
        if at == 0:
            break
    assert edge in loop
    surface = ls.LimitSurface(ls.Mesh(points, quads, creases=dict.fromkeys(loop, 10)))
    faces = ls.bspline_faces(surface)
    place = anywhere(surface, 2000)
    step = faces.evaluate(*faces.of(*place)) - surface.evaluate(*place)
    assert np.abs(step).max() < 1e-14 * 4
    assert len(faces) < 10


def test_holes_are_left_out_and_places_go_back():
    points, faces = zoo.grid(4, 3)
    surface = ls.LimitSurface(ls.Mesh(points, faces, holes=[5]))
    found = ls.bspline_faces(surface)
    assert 5 not in found.limit_faces
    assert found.of(5, 0.5, 0.5)[0] == -1
    face, u, v = anywhere(surface, 500)
    back, place = found.on_surface(*found.of(face, u, v))
    assert np.allclose(surface.evaluate(back, *place.T), surface.evaluate(face, u, v), atol=1e-13)


def test_nan_stays_where_it_is():
    faces = ls.bspline_faces(surface_of("cube"))
    found = faces.evaluate([0, 1], [np.nan, 0.5], 0.5)
    assert np.isnan(found[0]).all()
    assert np.isfinite(found[1]).all()
    # values of channels may be missing
    points, quads = zoo.disjoint(zoo.cube(), zoo.cube())
    values = np.arange(32.0).reshape(16, 2)
    values[3] = np.nan
    channels = {"uv": (values, np.ravel(quads), "none")}
    surface = ls.LimitSurface(ls.Mesh(points, quads, channels=channels))
    found = ls.bspline_faces(surface, channel="uv").evaluate(np.arange(12), 0.3, 0.4)
    assert np.isnan(found[:6]).any()
    assert np.isfinite(found[6:]).all()


def test_channels_and_workers():
    values = np.arange(16.0).reshape(8, 2)
    points, faces = zoo.cube()
    mesh = ls.Mesh(points, faces, channels={"uv": (values, np.ravel(faces), "none")})
    surface = ls.LimitSurface(mesh)
    found = ls.bspline_faces(surface, channel="uv", workers=2)
    step = found.evaluate(0, 0.3, 0.4) - surface.evaluate(0, 0.3, 0.4, channel="uv")
    assert np.abs(step).max() < 1e-13
    one, two = (ls.bspline_faces(surface, workers=n).points for n in (1, 2))
    assert np.array_equal(one, two)


def test_nothing_is_no_trouble():
    empty = ls.LimitSurface(ls.Mesh(*zoo.single_face(4), holes=[0]))
    assert len(ls.bspline_faces(empty)) == 0
    assert len(ls.deviation(empty, ls.bspline_faces(empty)).parametric) == 0
    flat = ls.LimitSurface(ls.Mesh(np.zeros((8, 3)), zoo.cube()[1]))
    assert ls.bspline_faces(flat, tolerance=1e-3).deviation.max() <= 1e-3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"depth": 41}, "too close"),
        ({"depth": 0}, "at least"),
        ({"depth": 5, "tolerance": 1e-3}, "not both"),
        ({"tolerance": 1e-20}, "rounding"),
        ({"tolerance": np.nan}, "rounding"),
        ({"g1_angle": 0}, "above 0"),
        ({"g1_angle": 1e-9}, "ask for less"),
    ],
)
def test_what_cannot_be_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        ls.bspline_faces(surface_of("cube"), **options)


def test_what_is_no_surface_or_patches_is_refused():
    surface = surface_of("cube")
    with pytest.raises(TypeError, match="LimitSurface"):
        ls.bspline_faces(surface.mesh)
    with pytest.raises(TypeError, match="bezier_patches"):
        ls.bspline_faces(
            ls.LimitSurface(ls.Mesh([[Fraction(k)] for k in range(4)], [[0, 1, 2, 3]]))
        )
    faces = ls.bspline_faces(surface)
    with pytest.raises(ValueError, match="another surface"):
        ls.deviation(surface_of("prism"), faces)
    with pytest.raises(TypeError, match="ApproximatePatches"):
        ls.deviation(surface, surface)
    with pytest.raises(IndexError, match="out of range"):
        faces.evaluate(6, 0.5, 0.5)
    with pytest.raises(ValueError, match="not in"):
        faces.evaluate(0, 1.5, 0.5)
    with pytest.raises(IndexError):
        faces[6]


def test_approximate_patches_are_measured_along_edges():
    surface = surface_of("cube")
    found = ls.deviation(surface, ls.approximate(surface, "gregory", levels=1))
    assert len(found.gap) == 48
    assert found.gap.max() < 1e-14
    assert (found.edge_angle_found < 1e-6).all()
    acc = ls.deviation(surface, ls.approximate(surface, "acc", levels=1))
    assert (acc.edge_angle >= acc.edge_angle_found - 1e-9).all()


def around(valence, height=0.3):
    """Points and faces around one vertex, of random heights."""
    ring = np.exp(2j * np.pi * np.arange(valence) / valence)
    outer = (ring + np.roll(ring, -1)) * (1.0 if valence > 3 else 1.5)
    z, k = np.concatenate([[0], ring, outer]), np.arange(valence)
    points = np.stack([z.real, z.imag, height * np.random.default_rng(0).normal(size=len(z))], 1)
    return points, np.stack([0 * k, 1 + k, 1 + valence + k, 1 + (k + 1) % valence], 1)


@pytest.mark.parametrize("valence", [3, 5, 9, 16, 40])
def test_bounds_of_angles_are_near_at_any_valence(valence):
    surface = made(around(valence))
    faces = ls.bspline_faces(surface)
    found = ls.deviation(surface, faces)
    for name in ("angle", "edge_angle"):
        bound, most = getattr(found, name), getattr(found, f"{name}_found")
        assert (most <= bound).all()
        assert bound.max() <= 3 * most.max()
    # at places of their own: cells at the vertex, and both sides of edges from there
    rng = np.random.default_rng(1)
    face, (u, v) = rng.integers(0, valence, 20000), 2.0 ** -rng.uniform(5, 16, (2, 20000))
    which, x, y = faces.of(face, u, v)
    truth, other = surface.normal(face, u, v), faces.normal(which, x, y)
    angle = 2 * np.arctan2(
        np.linalg.norm(truth - other, axis=1), np.linalg.norm(truth + other, axis=1)
    )
    assert (angle <= found.angle[which] + 1e-9).all()
    sides = [
        faces.normal(*faces.of(*place))
        for place in ((face, u, 0.0), ((face - 1) % valence, 0.0, u))
    ]
    angle = 2 * np.arctan2(*(np.linalg.norm(sides[0] + s * sides[1], axis=1) for s in (-1, 1)))
    assert (angle <= found.edge_angle.max()).all()


@pytest.mark.filterwarnings("ignore:.* cannot share tangent planes")
@pytest.mark.parametrize("poles", ["g0", "g1"])
@pytest.mark.parametrize("seed", range(6))
def test_what_is_found_is_within_bounds_of_degenerate_cages(seed, poles):
    """Faces without area, on a line, folded: what rounding does there is no angle that is found."""
    rng = np.random.default_rng(seed)
    points, faces = zoo.grid(4, 4) if seed % 2 else zoo.cube()
    points = zoo.random_points(len(points), seed)
    which = rng.permutation(len(points))
    if seed < 2:
        points[which[0]] = points[which[1]]  # of two vertices, of the same face or not
    elif seed < 4:
        points[faces[1]] = points[faces[1][:1]]
    else:
        points = np.asarray(points, float) * [1, 1e-9, 1e-9]
    surface = made((points, faces))
    found = ls.deviation(surface, ls.bspline_faces(surface, poles=poles))
    for name in ("parametric", "along_normal", "angle", "geometric_angle", "gap"):
        assert (getattr(found, f"{name}_found") <= getattr(found, name)).all(), name


@pytest.mark.parametrize("scale", [1e-200, 1e200])
def test_deviation_is_that_of_the_size(scale):
    points, quads = around(5)
    one, other = (
        ls.deviation(s, ls.bspline_faces(s))
        for s in (made((points, quads)), made((points * scale, quads)))
    )
    assert np.allclose(other.parametric / scale, one.parametric, rtol=1e-6)
    for name in ("angle", "edge_angle", "edge_angle_found"):
        assert np.allclose(getattr(other, name), getattr(one, name), rtol=1e-6)
    assert 0 < other.gap.max() / scale < 1e-14


def test_gaps_far_from_the_origin_count_what_points_are_rounded_to():
    points, quads = around(5)
    surface = made((points + 1e6, quads))
    faces = ls.bspline_faces(surface)
    found = ls.deviation(surface, faces)
    near = ls.deviation(made((points, quads)), ls.bspline_faces(made((points, quads))))
    assert (found.edge_angle_found <= found.edge_angle).all()
    assert found.edge_angle.max() < 1.01 * near.edge_angle.max() + 1e-6
    # rows of control points along shared edges, as they are
    gap = max(np.abs(faces[k].points[:, 0] - faces[(k - 1) % 5].points[0]).max() for k in range(5))
    assert gap <= found.gap.max() < 1e-8


def test_points_that_were_moved_are_noticed():
    surface = surface_of("cube")
    faces = ls.bspline_faces(surface, depth=4)
    for k in (0, 57, 400):
        moved = faces.points.copy()
        moved[k] += 0.1
        with pytest.raises(ValueError, match="not as it was made"):
            ls.deviation(surface, dataclasses.replace(faces, points=moved))
