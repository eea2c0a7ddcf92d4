"""Fits: known cages come back, noise ends at its level, optima are those that scipy finds."""

import warnings

import numpy as np
import pytest
from scipy.optimize import least_squares

import limitsurf as ls
from limitsurf.cad.features import crease_points
from limitsurf.cad.feet import SharpEdges, followed, sought
from limitsurf.cad.gauss_newton import PAIRS, sums
from limitsurf.cad.targets import Target, detected

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
QUADS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
CUBE = ls.Mesh(CORNERS, QUADS)
OCTAHEDRON = ls.Mesh(
    np.concatenate([np.eye(3), -np.eye(3)]),
    [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]],
)
# three by three quads, bent, so that nothing of it is a plane
SHEET = ls.Mesh(
    [[x, y, 0.2 * x * x - 0.1 * x * y + 0.05 * y**3] for x in range(4) for y in range(4)],
    [[4 * i + j, 4 * i + j + 4, 4 * i + j + 5, 4 * i + j + 1] for i in range(3) for j in range(3)],
)
PIECEWISE = [*ls.schemes.with_pieces]


def moved(mesh, by, seed=0):
    noise = np.random.default_rng(seed).normal(size=mesh.points.shape)
    return mesh.with_points(mesh.points + by * noise)


def cage_of(scheme):
    triangles = ls.schemes[scheme].lattice.face_size == 3
    return (OCTAHEDRON if triangles else CUBE).with_tags(scheme=scheme)


@pytest.mark.parametrize("scheme", PIECEWISE)
def test_known_cage_comes_back(scheme):
    mesh = cage_of(scheme)
    points = ls.sample(ls.LimitSurface(mesh), 200, rng=1).point
    found = ls.fit(moved(mesh, 0.03), points)
    assert found.converged
    assert found.error.max() < 1e-10
    if scheme != "catmull-clark":  # (where a cube of +-1 in alternation has the surface 0)
        assert np.abs(found.mesh.points - mesh.points).max() < 1e-8
    # what is said of feet is so
    there = found.surface.evaluate(found.face, found.u, found.v)
    assert np.abs(np.linalg.norm(there - points, axis=1) - found.error).max() < 1e-15


def test_steps_converge_quadratically():
    points = ls.sample(ls.LimitSurface(CUBE), 300, rng=2).point
    history = ls.fit(moved(CUBE, 0.02), points).history
    late = history[(history < 1e-2) & (history > 1e-12)]
    assert (late[1:] < 30 * late[:-1] ** 1.5).all()
    assert len(history) < 10


def test_cages_that_can_slide_come_back():
    """Where a cage moves almost within its surface steps are bent, and damped by nothing."""
    m, n = 12, 8
    i, j = (x.ravel() for x in np.meshgrid(range(m), range(n), indexing="ij"))
    a, b = 2 * np.pi * i / m, 2 * np.pi * j / n
    torus = [(3 + np.cos(b)) * np.cos(a), (3 + np.cos(b)) * np.sin(a), np.sin(b)]
    corners = [i * n + j, (i + 1) % m * n + j, (i + 1) % m * n + (j + 1) % n, i * n + (j + 1) % n]
    mesh = ls.Mesh(np.stack(torus, axis=1), np.stack(corners, axis=1))
    points = ls.sample(ls.LimitSurface(mesh), 2000, rng=1).point
    found = ls.fit(moved(mesh, 0.05), points, max_iterations=12)
    assert found.converged
    assert found.history[-1] < 1e-13
    assert np.abs(found.mesh.points - mesh.points).max() < 1e-9


def test_optimum_is_that_of_scipy():
    """All of cage and feet as unknowns, on the limit faces where feet are."""
    rng = np.random.default_rng(4)
    points = ls.sample(ls.LimitSurface(CUBE), 90, rng=3).point
    points = points + 0.01 * rng.normal(size=points.shape)
    found = ls.fit(moved(CUBE, 0.02), points)
    face, surface = found.face, found.surface
    n, k = len(points), CUBE.n_vertices

    def parts(x):
        return x[: 3 * k].reshape(k, 3), np.clip(x[3 * k :].reshape(2, n), 0, 1)

    def residuals(x):
        P, (u, v) = parts(x)
        return (surface.with_points(P).evaluate(face, u, v) - points).ravel()

    def jacobian(x):
        P, (u, v) = parts(x)
        here = surface.with_points(P)
        W = np.kron(surface.weights(face, u, v).toarray(), np.eye(3))
        jet = here.jet(face, u, v, order=1)
        rows = np.arange(3 * n)
        du, dv = np.zeros((2, 3 * n, n))
        du[rows, rows // 3], dv[rows, rows // 3] = jet[1, 0].ravel(), jet[0, 1].ravel()
        return np.hstack([W, du, dv])

    start = np.concatenate([found.mesh.points.ravel(), found.u, found.v])
    low = np.concatenate([np.full(3 * k, -np.inf), np.full(2 * n, -1e-9)])
    best = least_squares(
        residuals, np.clip(start, low + 1e-12, None), jacobian,
        bounds=(low, np.concatenate([np.full(3 * k, np.inf), np.full(2 * n, 1 + 1e-9)])),
        xtol=1e-12, ftol=1e-12, max_nfev=60,
    )  # fmt: skip
    assert found.history[-1] ** 2 * n == pytest.approx(2 * best.cost, rel=1e-2)


def test_noise_ends_at_its_level():
    rng = np.random.default_rng(5)
    exact = ls.sample(ls.LimitSurface(CUBE), 400, rng=6).point
    normal = ls.closest_point(ls.LimitSurface(CUBE), exact).normal
    noise = 0.005 * rng.normal(size=400)
    found = ls.fit(moved(CUBE, 0.03), exact + noise[:, None] * normal)
    # 24 numbers take their share of 400 deviations
    assert 0.8 * 0.005 < found.rms < 1.05 * 0.005
    off = ls.closest_point(found.surface, exact).distance
    assert np.sqrt((off**2).mean()) < 0.5 * 0.005


@pytest.mark.parametrize("loss", ["huber", "soft_l1", "cauchy"])
def test_robust_losses_leave_outliers(loss):
    exact = ls.sample(ls.LimitSurface(CUBE), 160, rng=7).point
    rng, points = np.random.default_rng(8), exact.copy()
    points += 1e-3 * rng.normal(size=points.shape)
    points[::15] += 0.2 * rng.normal(size=points[::15].shape)

    def off(**options):
        found = ls.fit(moved(CUBE, 0.03), points, max_iterations=6, **options)
        distance = ls.closest_point(found.surface, exact).distance
        return np.sqrt((distance**2).mean())

    assert off(loss=loss) < 1e-3 < 5e-3 < off()


def test_weights_of_zero_leave_out():
    points = ls.sample(ls.LimitSurface(CUBE), 200, rng=9).point
    bad = np.concatenate([points, points[:20] + 0.3])
    found = ls.fit(moved(CUBE, 0.03), bad, weights=np.repeat([2.0, 0.0], [200, 20]))
    assert found.error[:200].max() < 1e-10
    assert found.error[200:].min() > 0.01


def test_normals_tell_the_sides_of_a_wall():
    """Two sheets, 0.1 apart, of which the cage begins nearer to the wrong one."""
    sheet = [[x, y, 0.0] for x in range(4) for y in range(4)]
    quads = SHEET.uniform
    mesh = ls.Mesh(
        np.concatenate([sheet, np.add(sheet, [0, 0, -0.1])]),
        np.concatenate([quads, quads[:, ::-1] + 16]),
    )
    both = ls.sample(ls.LimitSurface(mesh), 400, rng=10)
    start = mesh.with_points(mesh.points + np.array([0, 0, 0.08]))
    found = ls.fit(start, both.point, normals=5 * both.normal)
    assert found.error.max() < 1e-10
    assert abs(found.surface.evaluate(4, 0.5, 0.5)[2]) < 1e-9


def test_normals_that_all_point_to_the_other_side_are_refused():
    found = ls.sample(ls.LimitSurface(SHEET), 60, rng=1)
    with pytest.raises(ValueError, match=r"no point has a normal .* turn them"):
        ls.fit(moved(SHEET, 0.01), found.point, normals=-found.normal)


def test_boundaries_go_to_boundaries():
    truth = ls.LimitSurface(SHEET)
    larger = SHEET.with_points((SHEET.points - 1.5) * 1.05 + 1.5)
    inside = ls.sample(truth, 150, rng=11).point
    edges = SharpEdges(truth)
    which = np.repeat(np.arange(len(edges)), 12)
    at = edges.places(which, np.tile(np.linspace(0, 1, 12), len(edges)))
    rim = truth.evaluate(at.face, at.u, at.v)
    kinds = np.repeat(["", "boundary"], [len(inside), len(rim)])
    found = ls.fit(larger, np.concatenate([inside, rim]), edges=kinds)
    assert found.error.max() < 1e-10
    assert np.abs(found.mesh.points - SHEET.points).max() < 1e-8


def test_surfaces_are_sampled_with_their_edges():
    target = Target.of(SHEET, None, None, "auto", 1)
    assert len(target.points) > 20_000
    rim = target.points[target.kinds == 1]
    assert (ls.closest_point(ls.LimitSurface(SHEET), rim[::40]).distance < 1e-12).all()
    assert not Target.of(SHEET, None, None, None, 1).kinds.any()
    # a cage without boundary takes them as any other points
    assert not target.on_edges_of(ls.LimitSurface(CUBE)).kinds.any()


def test_creases_go_to_creases():
    ring = {(0, 1): 10.0, (1, 3): 10.0, (2, 3): 10.0, (0, 2): 10.0}
    mesh = ls.Mesh(CORNERS, QUADS, creases=ring)
    surface = ls.LimitSurface(mesh)
    edges = SharpEdges(surface)
    assert len(edges) == 4
    assert not edges.on_boundary.any()
    at = edges.places(np.repeat(np.arange(4), 10), np.tile(np.linspace(0, 1, 10), 4))
    crease = surface.evaluate(at.face, at.u, at.v)
    inside = ls.sample(surface, 200, rng=12).point
    told = np.repeat([False, True], [200, 40])
    found = ls.fit(moved(mesh, 0.03), np.concatenate([inside, crease]), edges=told)
    assert found.error.max() < 1e-10
    assert np.abs(found.mesh.points - CORNERS).max() < 1e-8


def half_cylinder(n, rng):
    """Points and normals of one of radius 1 and length 2, on the plane z = 0."""
    share = np.array([2 * np.pi, 4, np.pi / 2, np.pi / 2])
    wall, floor, *ends = rng.multinomial(n, share / share.sum())
    a = np.pi * rng.random(wall)
    turn = np.stack([np.cos(a), 0 * a, np.sin(a)], axis=1)
    parts = [(turn + 2 * rng.random((wall, 1)) * [0, 1, 0], turn)]
    flat = rng.random((floor, 3)) * [2, 2, 0] - [1, 0, 0]
    parts.append((flat, np.tile([0.0, 0, -1], (floor, 1))))
    for y, count in zip((0, 2), ends, strict=True):
        a, r = np.pi * rng.random(count), np.sqrt(rng.random(count))
        disc = np.stack([r * np.cos(a), np.full(count, y), r * np.sin(a)], axis=1)
        parts.append((disc, np.tile([0.0, y - 1, 0], (count, 1))))
    return tuple(map(np.concatenate, zip(*parts, strict=True)))


def from_its_edges(x):
    """Distances from the four edges of that part."""
    radius = np.hypot(x[:, 0], x[:, 2])
    ends = [np.abs(x[:, 1] - y) for y in (0, 2)]
    sides = [np.hypot(x[:, 0] - s, x[:, 2]) for s in (-1, 1)]
    around = [np.hypot(end, radius - 1) for end in ends]
    across = [np.hypot(end, x[:, 2]) for end in ends]
    return np.min([*sides, *around, *across], axis=0)


@pytest.mark.parametrize(("given", "usual", "most"), [(True, 2e-3, 1e-2), (False, 6e-3, 0.1)])
def test_sharp_edges_of_a_part_are_found(given, usual, most):
    points, normals = half_cylinder(5000, np.random.default_rng(1))  # 0.05 apart
    signs = np.random.default_rng(2).choice([-3.0, 2.0], (5000, 1))
    found = crease_points(points, signs * normals if given else None)
    off = from_its_edges(found)
    assert len(found) > 600
    assert np.median(off) < usual
    assert off.max() < most
    # and all along
    for place in ([1, 1, 0], [-1, 0.5, 0], [0, 0, 1], [0.2, 2, 0], [0, 0, 0]):
        assert np.linalg.norm(found - place, axis=1).min() < 0.1


def test_what_is_smooth_or_thin_has_no_sharp_edges():
    sphere = np.random.default_rng(3).normal(size=(4000, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    flat = np.random.default_rng(4).random((600, 3)) * [1, 1, 0]
    wall = np.concatenate([flat, flat[::-1] + np.array([0, 0, 1e-3])])
    sides = np.repeat([[0, 0, -1.0], [0, 0, 1.0]], 600, axis=0)
    assert not len(crease_points(sphere, sphere))
    assert not len(crease_points(sphere, None))
    assert not len(crease_points(wall, sides))
    assert not len(crease_points(sphere[:5], None))
    assert not len(crease_points(np.zeros((40, 3)), np.zeros((40, 3))))


@pytest.mark.parametrize("given", [True, False])
def test_creases_go_to_sharp_edges_that_are_found(given):
    sharp = ls.Mesh(CORNERS - 0.5, QUADS, creases={tuple(e): 10.0 for e in CUBE.edges.tolist()})
    scan = ls.sample(ls.LimitSurface(sharp), 600, rng=3)
    c, s = np.cos(np.deg2rad(25)), np.sin(np.deg2rad(25))
    start = sharp.with_points(1.1 * sharp.points @ [[c, s, 0], [-s, c, 0], [0, 0, 1]] + 0.05)
    normals = scan.normal if given else None
    found = ls.fit(start, scan.point, normals=normals, edges="detect")
    # (what was detected does not stay in the result, nor among its errors)
    assert found.error.shape == (600,)
    assert len(found.history) == len(found.levels)
    assert found.converged
    assert found.error.max() < 1e-10
    assert np.abs(np.abs(found.mesh.points) - 0.5).max() < 1e-8


def test_nearest_places_on_edges_are_those_of_brute_force():
    surface = ls.LimitSurface(SHEET)
    edges = SharpEdges(surface)
    assert len(edges) == 12
    points = np.random.default_rng(13).uniform(-1, 4, (30, 3))
    found = edges.nearest(surface, points, np.arange(12))
    there = surface.evaluate(found.face, found.u, found.v)
    t = np.linspace(0, 1, 2001)
    dense = edges.places(np.repeat(np.arange(12), len(t)), np.tile(t, 12))
    curve = surface.evaluate(dense.face, dense.u, dense.v)
    least = np.linalg.norm(points[:, None] - curve, axis=2).min(axis=1)
    distance = np.linalg.norm(points - there, axis=1)
    assert (distance <= least + 1e-12).all()
    assert (distance > least - 1e-5).all()


def test_halves_of_edges_of_n_gons_are_sides_once():
    pentagon = [[np.cos(2 * np.pi * k / 5), np.sin(2 * np.pi * k / 5), 0] for k in range(5)]
    surface = ls.LimitSurface(ls.Mesh(pentagon, [[0, 1, 2, 3, 4]]))
    edges = SharpEdges(surface)
    assert len(edges) == 10
    at = edges.places(np.arange(10), np.full(10, 0.5))
    middle = surface.evaluate(at.face, at.u, at.v)
    apart = np.linalg.norm(middle[:, None] - middle, axis=2) + np.eye(10)
    assert apart.min() > 0.1


def test_detected_boundary_is_the_rim_of_a_grid():
    x, y = np.meshgrid(np.arange(12.0), np.arange(9.0), indexing="ij")
    points = np.stack([x, y, 0.01 * x * y], axis=-1).reshape(-1, 3)
    rim = ((x == 0) | (x == 11) | (y == 0) | (y == 8)).ravel()
    assert (detected(points) == rim).all()
    # of a closed surface none
    assert not detected(ls.sample(ls.LimitSurface(CUBE), 2000, rng=1).point).any()


def test_feet_that_are_followed_are_nearest():
    surface = ls.LimitSurface(CUBE)
    points = ls.sample(surface, 120, rng=14).point * 1.1
    there = surface.with_points(moved(CUBE, 0.01).points)
    by_steps = followed(there, points, None, sought(surface, points, None, 1), 1)
    known = ls.closest_point(there, points)
    distance = np.linalg.norm(
        there.evaluate(by_steps.face, by_steps.u, by_steps.v) - points, axis=1
    )
    assert np.abs(distance - known.distance).max() < 1e-13


def test_sums_are_products_of_matrices():
    mesh = ls.Mesh(*_mixed())
    surface = ls.LimitSurface(mesh)
    rng = np.random.default_rng(15)
    face = rng.integers(len(surface.limit_faces), size=300)
    W = surface.weights(face, *rng.random((2, 300)))
    metric = rng.random((300, 6))
    dense = W.toarray()
    for one, column in zip(sums(W, metric), metric.T, strict=True):
        assert np.abs(one.toarray() - dense.T @ (column[:, None] * dense)).max() < 1e-13
    assert len(PAIRS) == 6


def _mixed():
    points = [[0, 0, 0], [1, 0, 0.2], [2, 0, 0], [0, 1, 0.1], [1, 1, 0], [2, 1, 0.3], [1, 2, 0]]
    return points, [[0, 1, 4, 3], [1, 2, 5, 4], [3, 4, 6], [4, 5, 6]]


def test_parts_are_refined_where_their_error_asks_for_it():
    two = ls.Mesh(
        np.concatenate([CORNERS, CORNERS + np.array([3, 0, 0])]),
        QUADS + [[k + 8 for k in face] for face in QUADS],
        creases={(0, 1): 10.0},
        face_data={"part": ["a"] * 6 + ["b"] * 6},
        channels={"uv": (np.eye(2), np.tile([0, 1], 24), "all")},
    )
    fine = ls.refined(two)
    wavy = fine.points + 0.05 * np.sin(9 * fine.points[:, [1, 2, 0]]) * (fine.points[:, :1] > 2)
    points = ls.sample(ls.LimitSurface(fine.with_points(wavy)), 600, rng=16).point
    found = ls.fit(two, points, refine="auto", tolerance=2e-3, max_iterations=8)
    assert found.mesh.n_faces == 6 + 24
    assert found.rms < 2e-3
    assert found.levels.max() == 1
    assert len(found.levels) == len(found.history)
    part = found.mesh.face_data["part"]
    assert (part == "b").sum() == 24
    assert len(found.mesh.creases[0]) == 1
    assert found.mesh.scheme is None
    assert set(found.mesh.channels) == {"uv"}


def test_refinement_ends_at_noise():
    rng = np.random.default_rng(17)
    points = ls.sample(ls.LimitSurface(CUBE), 320, rng=18).point
    noisy = points + 0.01 * rng.normal(size=points.shape)
    found = ls.fit(CUBE, noisy, refine="auto", tolerance=1e-6, max_iterations=3)
    assert found.mesh.n_faces <= 24


def test_tags_channels_and_data_are_kept():
    mesh = ls.Mesh(
        CORNERS, QUADS, creases={(0, 1): 2.5}, corners={3: 1.5}, units=0.001, up="z",
        face_data={"group": list("abcdef")},
        channels={"uv": (np.eye(2), np.tile([0, 1], 12), "all")},
    )  # fmt: skip
    points = ls.sample(ls.LimitSurface(mesh), 100, rng=19).point
    found = ls.fit(moved(mesh, 0.02), points).mesh
    assert found.with_points(CORNERS) == mesh


def test_vertices_can_be_fixed_and_pinned():
    points = ls.sample(ls.LimitSurface(CUBE), 150, rng=20).point
    start = moved(CUBE, 0.02)
    held = ls.fit(start, points, fixed=[0, 5], max_iterations=3).mesh.points
    assert (held[[0, 5]] == start.points[[0, 5]]).all()
    # the corner of the limit is at 3/4; the fit of a third of the points alone is elsewhere
    pinned = ls.fit(start, points[:40], corners={7: [0.8, 0.8, 0.8]})
    face, corner = next((f, QUADS[f].index(7)) for f in range(6) if 7 in QUADS[f])
    limit = pinned.surface.evaluate(*pinned.surface.limit_faces.at_corner(face, corner))
    assert np.abs(limit - 0.8).max() < 0.01
    assert pinned.rms > 1e-4


def test_corners_count_where_points_are_met_already():
    points = ls.sample(ls.LimitSurface(CUBE), 60, rng=20).point
    there = ls.LimitSurface(CUBE).evaluate(*_place_of(7))
    pulled = ls.fit(CUBE, points, corners={7: there + 0.05}, max_iterations=5)
    gap = np.linalg.norm(pulled.surface.evaluate(*_place_of(7)) - there - 0.05)
    assert gap < 0.9 * np.linalg.norm([0.05] * 3)


def _place_of(vertex):
    face = next(f for f in range(6) if vertex in QUADS[f])
    return ls.LimitSurface(CUBE).limit_faces.at_corner(face, QUADS[face].index(vertex))


def test_points_beyond_what_has_a_limit_are_reached():
    flat = SHEET.with_points(SHEET.points * [1, 1, 0]).with_tags(boundary="none")
    x, y = np.meshgrid(np.linspace(0.5, 2.5, 9), np.linspace(0.5, 2.5, 9))
    points = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    found = ls.fit(flat, points, max_iterations=10)
    assert found.rms < 1e-12


def test_scales_and_units_at_the_ends_of_the_range():
    points = ls.sample(ls.LimitSurface(CUBE), 60, rng=20).point + 0.01
    assert np.isfinite(ls.fit(CUBE, points, loss="cauchy", scale=1e-300, max_iterations=2).rms)
    tiny = ls.fit(CUBE.with_points(CORNERS * 1e-308), points * 1e-308, max_iterations=2)
    assert np.isfinite(tiny.mesh.points).all()


def test_vertices_at_no_point_are_told():
    flat = [[x, y, 0.0] for x in range(8) for y in range(3)]
    quads = [[3 * x + y, 3 * x + y + 3, 3 * x + y + 4, 3 * x + y + 1]
             for x in range(7) for y in range(2)]  # fmt: skip
    surface = ls.LimitSurface(ls.Mesh(flat, quads))
    points = ls.sample(surface, 300, rng=1).point
    with pytest.warns(
        UserWarning, match="9 of 24 vertices are at no point, the first is vertex 15"
    ):
        found = ls.fit(surface, points[points[:, 0] < 2.9] + [0, 0, 0.1])
    assert found.rms < 1e-3
    assert np.abs(found.mesh.points - np.add(flat, [0, 0, 0.1])).max() < 0.2


def test_what_is_added_for_vertices_at_no_point_vanishes():
    """A bent strip of which points see a part: there they are met, not smoothed."""
    bent = [[x, y, 0.1 * x * x + 0.05 * x * y] for x in range(8) for y in range(3)]
    quads = [[3 * x + y, 3 * x + y + 3, 3 * x + y + 4, 3 * x + y + 1]
             for x in range(7) for y in range(2)]  # fmt: skip
    mesh = ls.Mesh(bent, quads)
    points = ls.sample(ls.LimitSurface(mesh), 300, rng=1).point
    with pytest.warns(UserWarning, match="are at no point"):
        found = ls.fit(moved(mesh, 0.03), points[points[:, 0] < 2.9])
    assert found.rms < 1e-8
    assert np.abs(found.mesh.points).max() < 10


def test_too_few_points_are_told_and_fair():
    points = ls.sample(ls.LimitSurface(CUBE), 6, rng=21).point
    with pytest.warns(UserWarning, match="6 distances are too few for 8 vertices.*smoothing=1e-06"):
        found = ls.fit(CUBE, points + 0.05)
    assert found.rms < 1e-3
    assert np.abs(found.mesh.points).max() < 2
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ls.fit(CUBE, points, smoothing=1e-4)


def test_vertices_that_run_away_are_told_and_held():
    """A closed cage folds onto a plane that is given alone, wherever its rim is."""
    flat = np.random.default_rng(1).random((60, 3)) * [1, 1, 0] + [0, 0, 0.5]
    with pytest.warns(UserWarning, match=r"ran away .* begin with a cage of their shape"):
        found = ls.fit(CUBE, flat, max_iterations=8)
    assert np.abs(found.mesh.points).max() < 4
    assert found.rms < 1e-3
    assert len(found.history) <= 9


@pytest.mark.parametrize("onto", [[1, 0, 0], [1, 1e-14, 0], [1e200, 0, 0], [0, 0, 0]])
def test_cages_on_a_line_are_refused(onto):
    points = ls.sample(ls.LimitSurface(CUBE), 20, rng=1).point * max(1, onto[0])
    with pytest.raises(ValueError, match="no extent: its vertices are all"):
        ls.fit(CUBE.with_points(CORNERS * onto), points)


def test_a_third_of_outliers_does_not_count():
    """By Cauchy's loss and a scale of its own the others are met to rounding."""
    rng = np.random.default_rng(6)
    points = ls.sample(ls.LimitSurface(CUBE), 600, rng=5).point
    bad = np.arange(600) < 180
    points[bad] = rng.uniform(-0.2, 1.2, (180, 3))
    found = ls.fit(moved(CUBE, 0.02), points, loss="cauchy")
    assert found.converged
    assert found.error[~bad].max() < 1e-10
    assert np.median(found.error[bad]) > 0.1
    assert ls.fit(moved(CUBE, 0.02), points, loss="huber").error[~bad].max() < 5e-3


def test_fairness_smooths():
    rng = np.random.default_rng(22)
    points = ls.sample(ls.LimitSurface(SHEET), 120, rng=23).point + 0.02 * rng.normal(size=(120, 3))
    E = ls.fairness(ls.LimitSurface(SHEET), "thin_plate")
    energies = []
    for smoothing in (0.0, 1e-4, 1e-2):
        P = ls.fit(SHEET, points, smoothing=smoothing, max_iterations=8).mesh.points
        energies.append((P * (E @ P)).sum())
    assert energies[0] > energies[1] > energies[2]


def test_answers_are_the_same_for_any_number_of_workers_and_in_any_unit():
    points = ls.sample(ls.LimitSurface(CUBE), 100, rng=24).point
    start = moved(CUBE, 0.02)
    one = ls.fit(start, points)
    two = ls.fit(start, points, workers=2)
    assert (one.mesh.points == two.mesh.points).all()
    assert (one.history == two.history).all()
    scale = 2.0**-400
    other = ls.fit(start.with_points(start.points * scale), points * scale)
    assert (other.mesh.points == one.mesh.points * scale).all()
    far = ls.fit(start.with_points(start.points + 2.0**20), points + 2.0**20)
    assert far.error.max() < 1e-8


def test_points_that_are_not_finite_are_left_out():
    points = ls.sample(ls.LimitSurface(CUBE), 120, rng=25).point
    points[3], points[7, 1] = np.nan, np.inf
    found = ls.fit(moved(CUBE, 0.02), points)
    gone = np.isnan(found.error)
    assert np.flatnonzero(gone).tolist() == np.flatnonzero(found.face < 0).tolist() == [3, 7]
    assert found.error[~gone].max() < 1e-10


POINTS = np.random.default_rng(26).random((20, 3))


@pytest.mark.parametrize(
    ("error", "match", "points", "options"),
    [
        (ValueError, "one or more", np.zeros((0, 3)), {}),
        (ValueError, "finite, got 4 of which none is", np.full((4, 3), np.nan), {}),
        (ValueError, r"shape \(n, 3\), got \(20, 2\)", POINTS[:, :2], {}),
        (TypeError, "points must be real numbers", POINTS * 1j, {}),
        (ValueError, "times the size of the larger", POINTS + 1000, {}),
        (ValueError, "weights must be of shape", POINTS, {"weights": [1.0]}),
        (ValueError, "got -1.0 of point 2", POINTS, {"weights": [1, 1, -1] + [1] * 17}),
        (ValueError, "not all be 0", POINTS, {"weights": np.zeros(20)}),
        (ValueError, "normals must be of shape", POINTS, {"normals": POINTS[:3]}),
        (ValueError, "the surface of the cage has none", POINTS, {"edges": np.ones(20, bool)}),
        (ValueError, "got 'rim' of point 0", POINTS, {"edges": np.full(20, "rim")}),
        (ValueError, "edges must be", POINTS, {"edges": "found"}),
        (TypeError, "truth values or texts", POINTS, {"edges": np.ones(20)}),
        (ValueError, "vertex 8 is not one", POINTS, {"corners": {8: [0, 0, 0]}}),
        (TypeError, "mapping", POINTS, {"corners": [0, 1]}),
        (ValueError, "three finite numbers", POINTS, {"corners": {0: [0, np.nan, 0]}}),
        (IndexError, "vertex 8 is out of range", POINTS, {"fixed": [8]}),
        (ValueError, "nothing to fit", POINTS, {"fixed": np.ones(8, bool)}),
        (ValueError, "cannot be fixed", POINTS, {"fixed": [0], "refine": "auto"}),
        (ValueError, "loss must be one of", POINTS, {"loss": "l1"}),
        (ValueError, "refine must be", POINTS, {"refine": "all"}),
        (ValueError, "smoothing must be", POINTS, {"smoothing": -1.0}),
        (ValueError, "energy must be one of", POINTS, {"fairness": "plate"}),
        (ValueError, "scale must be", POINTS, {"scale": 0.0}),
        (ValueError, "tolerance must be", POINTS, {"tolerance": 0.0}),
        (ValueError, "max_iterations must be", POINTS, {"max_iterations": -1}),
        (ValueError, "weights are of points", CUBE, {"weights": [1.0]}),
        (ValueError, "edges are of points", CUBE, {"edges": "detect"}),
    ],
)
def test_what_is_wrong_is_said(error, match, points, options):
    with pytest.raises(error, match=match):
        ls.fit(CUBE, points, **options)


def test_cages_that_cannot_be_fitted_are_refused():
    with pytest.raises(TypeError, match="mesh must be a Mesh"):
        ls.fit("cage.obj", POINTS)
    with pytest.raises(ValueError, match="no face with a limit"):
        ls.fit(CUBE.with_tags(holes=range(6)), POINTS)
    with pytest.raises(ValueError, match="no extent"):
        ls.fit(CUBE.with_points(0 * CORNERS), 0 * POINTS)
    with pytest.raises(ValueError, match="need points of shape"):
        ls.fit(ls.Mesh(CORNERS[:, :2], QUADS), POINTS)
