"""Cages whose limit passes through points: against dense algebra, exact masks, and evaluation."""

import warnings
from fractions import Fraction

import numpy as np
import pytest
import zoo
from scipy.linalg import null_space
from test_cad_fairness import torus

import limitsurf as ls
from limitsurf.cad import solving


def limits(mesh, count=None):
    """Limits at vertices, by masks."""
    return ls.refined(mesh, 0).limit_points[:count]


def cage_of(scheme):
    triangles = ls.schemes[scheme].lattice.face_size == 3
    return ls.Mesh(*(zoo.octahedron() if triangles else zoo.prism(5)), scheme=scheme)


def size_of(mesh):
    return np.ptp(mesh.points, axis=0).max()


# ------------------------------------------------------------------ at vertices


@pytest.mark.parametrize("scheme", ls.schemes.with_pieces)
def test_limits_pass_through_points(scheme):
    mesh = cage_of(scheme)
    points = np.random.default_rng(0).normal(size=(mesh.n_vertices, 2, 2))
    given = mesh.with_points(points + 1)
    found = ls.interpolate(given, points)
    assert np.abs(limits(found.mesh) - points).max() < 1e-13
    assert found.residual < 1e-14
    assert (found.levels, found.rank, found.conditions) == (0, len(points), len(points))
    assert found.mesh.scheme == scheme
    if scheme == "doo-sabin":
        with pytest.raises(ValueError, match="'doo-sabin' have other vertices"):
            ls.interpolate(given, points, refine=True)
        return
    found = ls.interpolate(given, points, refine=True)
    assert found.levels == 1
    assert np.abs(limits(found.mesh, len(points)) - points).max() < 1e-13
    assert found.mesh.n_faces == ls.refined(mesh, 1).n_faces


def test_tags_stay():
    n = 4
    i, j = (x.ravel() for x in np.meshgrid(np.arange(n - 1), np.arange(n - 1)))
    faces = np.stack([i * n + j, i * n + n + j, i * n + n + j + 1, i * n + j + 1], axis=1)
    points = np.random.default_rng(0).normal(size=(n * n, 3))
    creases = {(5, 6): np.inf, (6, 10): 1.7, (1, 5): 2.3}
    mesh = ls.Mesh(points, faces, creases=creases, corners={0: np.inf}, holes=[8])
    for refine in (False, True):
        found = ls.interpolate(mesh, refine=refine)
        known = ~np.isnan(found.errors)
        assert known.sum() == 15  # the vertex of the hole alone has no limit
        assert np.abs(limits(found.mesh, 16) - points)[known].max() < 1e-13
        if not refine:
            assert found.mesh.creases[1].tolist() == mesh.creases[1].tolist()
            assert found.mesh.holes.tolist() == [8]


def exact_limits(mesh):
    n = mesh.n_vertices
    unit = np.array([[Fraction(i == j) for j in range(n)] for i in range(n)], dtype=object)
    return ls.refined(ls.Mesh(unit, mesh.faces), 0).limit_points


@pytest.mark.parametrize("sides", [4, 6, 20])
def test_cubes_and_prisms_of_even_numbers_of_sides(sides):
    mesh = ls.Mesh(*zoo.prism(sides))
    n = mesh.n_vertices
    # signs by turns, exactly
    sign = np.zeros(n, dtype=int)
    sign[0] = 1
    for _ in range(n):
        for a, b in mesh.edges.tolist():
            sign[b], sign[a] = sign[b] or -sign[a], sign[a] or -sign[b]
    assert not (exact_limits(mesh) @ sign.astype(object)).any()
    with pytest.raises(ValueError, match=rf"depend on each other \(rank {n - 1}.*refine=.auto"):
        ls.interpolate(mesh, refine=False)
    points = mesh.points + 0.1 * np.random.default_rng(0).normal(size=(n, 3))
    with pytest.warns(UserWarning, match=rf"rank {n - 1}.*: the cage was refined once"):
        found = ls.interpolate(mesh, points)
    assert np.abs(limits(found.mesh, n) - points).max() < 1e-14
    assert np.abs(found.mesh.points).max() < 2 * np.abs(points).max()
    assert found.condition < 2
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ls.interpolate(mesh, points, refine=True)


@pytest.mark.parametrize(
    ("mesh", "condition"),
    [
        (ls.Mesh(*zoo.tetrahedron()), 4.5),
        (ls.Mesh(*zoo.octahedron()), 4.5),
        (torus(6, 4), 9),
        (torus(12, 10), 9),
    ],
)
def test_conditions_are_those_of_singular_values(mesh, condition):
    found = ls.interpolate(mesh)
    assert found.condition == pytest.approx(condition, rel=0.01)
    assert found.rank == mesh.n_vertices


def test_ranks_of_many_rows_are_counted():
    part = ls.Mesh(*zoo.prism(8))
    n, count = part.n_vertices, 12
    points = np.concatenate([part.points + np.array([3 * k, 0, 0]) for k in range(count)])
    faces = [(np.asarray(face) + k * n).tolist() for k in range(count) for face in part.faces]
    mesh = ls.Mesh(points, faces)
    with pytest.warns(UserWarning, match=f"rank {count * (n - 1)}"):
        found = ls.interpolate(mesh)
    assert np.abs(limits(found.mesh, len(points)) - points).max() < 1e-13
    surface = ls.LimitSurface(mesh)
    rng = np.random.default_rng(0)
    rows = surface.weights(rng.integers(0, len(surface.limit_faces), 100), *rng.random((2, 100)))
    sizes = np.linalg.svd(rows.toarray(), compute_uv=False)
    assert solving.rank(rows) == (sizes > 1e-6 * sizes[0]).sum()
    assert solving.condition(rows[:70]) == pytest.approx(np.linalg.cond(rows[:70].toarray()), 0.02)


# ------------------------------------------------------------------ the fairest


def fairest(E, C, p, load=0.0):
    """By a basis of what conditions leave free, dense."""
    some, *_ = np.linalg.lstsq(C, p, rcond=None)
    free = null_space(C)
    return some + free @ np.linalg.solve(free.T @ E @ free, free.T @ (load - E @ some))


@pytest.mark.parametrize("energy", ["membrane", "thin_plate"])
@pytest.mark.parametrize("scheme", ["catmull-clark", "loop"])
def test_the_fairest_cage(scheme, energy):
    mesh = cage_of(scheme)
    found = ls.interpolate(mesh, refine=True, fairness=energy)
    fine = ls.refined(mesh, 1)
    surface = ls.LimitSurface(fine)
    place = ls.refined(fine, 0)
    rows = surface.weights(place.parent_face, place.parent_u, place.parent_v)
    expected = fairest(
        ls.fairness(surface, energy).toarray(), rows.toarray()[: mesh.n_vertices], mesh.points
    )
    assert np.abs(found.mesh.points - expected).max() < 1e-8
    # a few vertices alone
    E = ls.fairness(ls.LimitSurface(mesh), energy).toarray()
    some, points = [4, 0, 3], np.random.default_rng(1).normal(size=(3, 3))
    place = ls.refined(mesh, 0)
    rows = ls.LimitSurface(mesh).weights(place.parent_face, place.parent_u, place.parent_v)
    found = ls.interpolate(mesh, points, vertices=some, fairness=energy)
    expected = fairest(E, rows.toarray()[some], points)
    assert np.abs(found.mesh.points - expected).max() < 1e-8
    assert found.residual < 1e-14


def places_on(surface, n, seed=0):
    rng = np.random.default_rng(seed)
    u, v = rng.random((2, n))
    if surface.topology.lattice.face_size == 3:
        over = u + v > 1
        u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    return rng.integers(0, len(surface.limit_faces), n), u, v


@pytest.mark.parametrize("scheme", ls.schemes.with_pieces)
def test_places_with_weights(scheme):
    mesh = cage_of(scheme)
    surface = ls.LimitSurface(mesh)
    places = places_on(surface, 30)
    rng = np.random.default_rng(1)
    points = surface.evaluate(*places) + 0.1 * rng.normal(size=(30, 3))
    weights = rng.uniform(0, 50, 30)
    weights[:2], weights[5] = np.inf, 0
    found = ls.interpolate(mesh, points, places=places, weights=weights)
    A = surface.weights(*places).toarray()
    W = np.where(np.isinf(weights), 0, weights)[:, None] * A
    form = ls.fairness(surface).toarray() + A.T @ W
    expected = fairest(form, A[:2], points[:2], W.T @ points)
    assert np.abs(found.mesh.points - expected).max() < 1e-8
    away = np.linalg.norm(A @ expected - points, axis=1)
    assert np.isnan(found.errors[5])
    assert np.delete(found.errors, 5) == pytest.approx(np.delete(away, 5), abs=1e-8)
    assert (found.residual, found.rank) == (pytest.approx(0, abs=1e-14), 2)


def test_known_cages_are_found_again():
    mesh = ls.Mesh(*zoo.prism(5), creases={(0, 1): 1.5})
    surface = ls.LimitSurface(mesh)
    places = places_on(surface, 60)
    found = ls.interpolate(mesh, surface.evaluate(*places), places=places)
    assert (found.levels, found.rank, found.conditions) == (0, 10, 60)
    assert np.abs(found.mesh.points - mesh.points).max() < 1e-12
    points = surface.evaluate(*places) + 1e-3 * np.random.default_rng(0).normal(size=(60, 3))
    with pytest.raises(
        ValueError, match=r"contradict each other.*at place \d+, \(.*finite weights"
    ):
        ls.interpolate(mesh, points, places=places, refine="auto")


def test_places_on_refined_cages_are_the_same():
    for scheme in ("catmull-clark", "loop"):
        mesh = cage_of(scheme)
        surface = ls.LimitSurface(mesh)
        places = places_on(surface, 8, 3)
        points = surface.evaluate(*places)
        for refine in (1, 2):
            found = ls.interpolate(mesh, points, places=places, refine=refine).mesh
            # the same places, by the parents of the refined vertices next to them
            nearest = ls.closest_point(ls.LimitSurface(found), points).distance
            assert nearest.max() < 1e-13


def test_fixed_vertices():
    mesh = torus(6, 5)
    held = np.arange(30) % 4 == 0
    points = 1.1 * mesh.points
    found = ls.interpolate(mesh, points, fixed=held)
    assert (found.mesh.points[held] == mesh.points[held]).all()
    assert np.abs(limits(found.mesh) - points)[~held].max() < 1e-13
    assert np.isnan(found.errors[held]).all()
    # parts without a point stay, refined or not
    both = ls.Mesh(np.tile(mesh.points, (2, 1)), np.concatenate([mesh.uniform, 30 + mesh.uniform]))
    found = ls.interpolate(both, 2 * mesh.points[:3], vertices=[0, 1, 2])
    assert np.abs(found.mesh.points[30:] - mesh.points).max() < 1e-14
    found = ls.interpolate(both, 2 * mesh.points[:3], vertices=[0, 1, 2], refine=True)
    fine = ls.refined(both, 1).points
    there = np.unique(found.mesh.uniform[120:])
    assert np.abs(found.mesh.points[there] - fine[there]).max() < 1e-14


# ------------------------------------------------------------------ normals


@pytest.mark.parametrize("scheme", ls.schemes.with_pieces)
def test_normals_at_vertices(scheme):
    mesh = cage_of(scheme)
    rng = np.random.default_rng(0)
    normals = mesh.points - mesh.points.mean(axis=0) + 0.2 * rng.normal(size=mesh.points.shape)
    if ls.schemes[scheme].local:
        return  # faces have their own
    if scheme == "doo-sabin":
        cage = cage_of(scheme)
        surface, place = ls.LimitSurface(cage), ls.refined(cage, 0)
        where = place.parent_face, place.parent_u, place.parent_v
        points, normals = surface.evaluate(*where), surface.normal(*where)
        found = ls.interpolate(mesh.with_points(mesh.points + 0.1), points, normals=3 * normals)
        assert np.abs(found.mesh.points - cage.points).max() < 1e-12
        assert found.normal_errors.max() < 1e-12
        return
    normals[1] = np.nan
    found = ls.interpolate(mesh, normals=normals, refine=1)
    surface = ls.LimitSurface(found.mesh)
    place = ls.refined(found.mesh, 0)
    n = surface.normal(place.parent_face, place.parent_u, place.parent_v)[: mesh.n_vertices]
    expected = normals / np.linalg.norm(normals, axis=1)[:, None]
    known = np.arange(mesh.n_vertices) != 1
    assert np.abs(np.cross(n, expected))[known].max() < 1e-12
    angle = np.arccos(np.clip((n * expected).sum(axis=1), -1, 1))
    assert found.normal_errors[known] == pytest.approx(angle[known], abs=1e-7)
    assert np.isnan(found.normal_errors[1])
    assert np.abs(limits(found.mesh, mesh.n_vertices) - mesh.points).max() < 1e-13
    assert found.conditions == 3 * mesh.n_vertices + 2 * known.sum()


def test_normals_at_creases_and_anywhere():
    mesh = torus(6, 5, creases=([(j, (j + 1) % 5) for j in range(5)], [np.inf] * 5))
    surface = ls.LimitSurface(mesh)
    # all corners of all faces, and so both sides of the crease, and places in faces
    corners = np.array(surface.topology.lattice.corners, dtype=float)
    face = np.repeat(np.arange(30), 5)
    u, v = np.tile([*corners, [0.3, 0.6]], (30, 1)).T
    points, normals = surface.evaluate(face, u, v), surface.normal(face, u, v)
    own = mesh.uniform[face, np.tile([0, 1, 2, 3, 0], 30)]
    _, first = np.unique(own + 100 * (u % 1 > 0), return_index=True)
    rest = np.setdiff1d(np.flatnonzero((own < 5) & (u % 1 == 0)), first)
    used = np.concatenate([first, rest])  # each place once, and all sides of the crease
    places = face[used], u[used], v[used]
    found = ls.interpolate(
        mesh.with_points(mesh.points + 0.1), points[used], places=places, normals=normals[used]
    )
    assert found.levels == 0
    assert found.normal_errors.max() < 1e-12
    assert np.abs(found.mesh.points - mesh.points).max() < 1e-12
    # sides of a crease are not one
    sides = normals[own == 0][:4]
    assert np.linalg.matrix_rank(sides, tol=1e-6) > 1


def test_reversed_normals_are_told():
    mesh = torus(6, 5)
    with pytest.warns(UserWarning, match=r"normal \d+ .* came out reversed"):
        found = ls.interpolate(mesh, normals=-limit_normals(mesh), refine=True)
    assert np.nanmax(found.normal_errors) == pytest.approx(np.pi)
    assert found.residual < 1e-14


def limit_normals(mesh):
    found = np.empty(mesh.points.shape)
    found[mesh.indices] = ls.refined(mesh, 0).limit_normals
    return found


def test_places_without_a_normal():
    mesh = ls.Mesh(*zoo.cube(), corners={0: np.inf})
    with pytest.raises(ValueError, match="no limit normal exists at vertex 0"):
        ls.interpolate(mesh, normals=mesh.points - 0.4, refine=True)


# ------------------------------------------------------------------ bad input

CUBE = ls.Mesh(*zoo.cube())
PLACE = {"places": ([0], [0.5], [0.5])}


@pytest.mark.parametrize(
    ("given", "error", "said"),
    [
        ({"points": CUBE.points[:5]}, ValueError, r"points must be of shape \(8, 3\)"),
        ({"points": CUBE.points * np.nan}, ValueError, "points: number 0 .and 7 more. is not fin"),
        ({"points": "x"}, TypeError, "points must be real numbers"),
        ({"points": CUBE.points.astype(object)}, TypeError, "real numbers, float64"),
        ({"vertices": [8]}, IndexError, "vertex 8"),
        ({"vertices": [0.5]}, ValueError, "vertices must be numbers"),
        ({"vertices": [True]}, ValueError, r"\(8,\) booleans"),
        ({"vertices": []}, ValueError, "there is no point"),
        ({"vertices": [], "points": CUBE.points[:0]}, ValueError, "there is no point"),
        ({"points": CUBE.points * 1.7e308}, ValueError, "too near the end of float64"),
        ({"points": CUBE.points[:2], "vertices": [3, 3]}, ValueError, "points 0 and 1 are both of"),
        (PLACE, ValueError, "places need points"),
        ({"points": [[0, 0, 0]], "vertices": [0], **PLACE}, ValueError, "not both"),
        ({"points": [[0, 0, 0]], "places": (0, 2.0, 0)}, ValueError, "outside"),
        ({"points": [[0, 0, 0]], "places": (99, 0, 0)}, IndexError, "99"),
        ({"points": [[0, 0, 0]], "places": (0, np.nan, 0)}, ValueError, "no limit at place 0"),
        ({"points": [[0, 0, 0]], "places": 3}, ValueError, r"places must be \(face, u, v\)"),
        ({"normals": [[0, 0, 1]]}, ValueError, r"normals must be \(8, 3\)"),
        ({"normals": 0 * CUBE.points}, ValueError, "normal 0 .and 7 more. has no direction"),
        ({"normals": np.full((8, 3), np.inf)}, ValueError, "has no direction"),
        ({"weights": -1}, ValueError, "weights must not be below 0"),
        ({"weights": np.nan}, ValueError, "weights must not be below 0 or NaN"),
        ({"weights": [1, 2]}, ValueError, r"weights must be one number, or \(8,\)"),
        ({"weights": 0}, ValueError, "there is no point"),
        ({"fixed": [9]}, IndexError, "fixed: vertex 9"),
        ({"refine": "yes"}, ValueError, 'refine must be "auto"'),
        ({"refine": 9}, ValueError, "at most 3 times"),
        ({"refine": -1}, ValueError, "refine"),
        ({"fairness": "smooth"}, ValueError, "energy must be one of"),
    ],
)
def test_bad_input(given, error, said):
    with pytest.raises(error, match=said):
        ls.interpolate(CUBE, **given)


def test_bad_cages():
    with pytest.raises(TypeError, match="needs a Mesh or LimitSurface, got ndarray"):
        ls.interpolate(CUBE.points)
    with pytest.raises(TypeError, match="exact"):
        ls.interpolate(ls.Mesh(CUBE.points.astype(object), CUBE.faces))
    with pytest.raises(ValueError, match=r"normals need points of shape \(n, 3\)"):
        ls.interpolate(ls.Mesh(CUBE.points[:, :2], CUBE.faces), normals=CUBE.points)
    loose = ls.Mesh(np.concatenate([CUBE.points, [[5, 5, 5]]]), CUBE.faces)
    found = ls.interpolate(loose, refine=True)
    assert np.abs(limits(found.mesh, 8) - CUBE.points).max() < 1e-14
    assert np.isnan(found.errors[8])
    with pytest.raises(ValueError, match=r"vertex 8 \(and 0 more\) has no limit"):
        ls.interpolate(loose, vertices=[0, 8])


def test_sizes_and_places_in_space_do_not_matter():
    mesh = torus(6, 5)
    for scale, shift in ((1e-150, 0), (1e150, 0), (1, 1e6)):
        for refine in (False, True):
            moved = mesh.with_points(scale * mesh.points + shift)
            found = ls.interpolate(moved, refine=refine)
            rounding = 1e-13 * (1 + shift / size_of(mesh))
            assert found.residual < rounding
            expected = scale * ls.interpolate(mesh, refine=refine).mesh.points + shift
            assert np.abs(found.mesh.points - expected).max() < 1e-6 * scale * size_of(mesh)


@pytest.mark.parametrize("power", [-1000, -600, 600, 1000])
def test_errors_and_angles_of_any_size(power):
    mesh = ls.Mesh(*zoo.prism(5))
    normals = np.full((10, 3), np.nan)
    normals[3] = mesh.points[3] + [0, 0, -0.5]
    given = mesh.with_points(mesh.points * 2.0**power)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = ls.interpolate(given, normals=normals, refine=True)
    assert found.residual < 1e-14
    assert found.normal_errors[3] < 1e-12
    soft = [ls.interpolate(x, weights=1.0).errors for x in (mesh, given)]
    assert np.abs(soft[1] * 2.0**-power - soft[0]).max() < 1e-10
