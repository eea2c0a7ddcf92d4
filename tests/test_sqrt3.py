"""The sqrt(3) scheme: against naive refinement in exact and long numbers, and reference numbers."""

import json
import math
import pickle
from dataclasses import replace
from fractions import Fraction as F
from pathlib import Path
from types import SimpleNamespace

import mpmath
import numpy as np
import oracles_sqrt3 as oracle
import pytest

import limitsurf as ls
from limitsurf import _kernels
from limitsurf.scheme.sqrt3 import SQRT3

REFERENCE = Path(__file__).parent / "reference_sqrt3.json"
KNOWN = json.loads(REFERENCE.read_text(encoding="utf-8"))
CAGES = {cage["name"]: (np.array(cage["points"]), cage["faces"]) for cage in KNOWN["cages"]}
OPEN = CAGES["open_5"]


def rows(name):
    return [np.array(x) for x in KNOWN["rows"][name]]


def cage(name):
    return ls.Mesh(*CAGES[name], scheme="sqrt3")


def bipyramid(n):
    """Two poles of valence n over a wavy ring."""
    turn = 2 * np.pi * np.arange(n) / n
    ring = np.stack([np.cos(turn), np.sin(turn), 0.2 * np.cos(2 * turn)], axis=1)
    points = np.vstack([[[0.1, 0.0, 1.0], [0.0, 0.1, -1.0]], ring])
    faces = [[0, 2 + i, 2 + (i + 1) % n] for i in range(n)]
    return ls.Mesh(points, faces + [[1, f[2], f[1]] for f in faces], scheme="sqrt3")


def cosine(n):
    return mpmath.cos(2 * mpmath.pi / n)


def long_points(points):
    return [np.array([mpmath.mpf(float(x)) for x in p], dtype=object) for p in points]


def directed(faces):
    return {tuple(np.roll(f, -int(np.argmin(f)))) for f in np.asarray(faces)}


def assert_same_mesh(fine, points, faces):
    """Equal vertices in any order, and the same faces on them."""
    points = np.array([[float(x) for x in p] for p in points])
    assert len(points) == fine.n_vertices
    place = np.abs(fine.points[:, None] - points).max(axis=2).argmin(axis=1)
    assert np.abs(fine.points - points[place]).max() < 1e-14
    assert sorted(place) == list(range(len(points)))
    assert directed(place[np.asarray(fine.faces)]) == directed(faces)


# ---------------------------------------------------------------- refinement


@pytest.mark.parametrize("levels", [1, 2, 3])
def test_refined_is_naively_refined(levels):
    for name in ("open_5", "sphere_9", "tetrahedron"):
        points, faces = CAGES[name]
        fine, R = ls.refined(cage(name), levels, operator=True)
        with mpmath.workdps(30):
            naive = oracle.refined(long_points(points), faces, levels, cosine)
        assert_same_mesh(fine, *naive)
        assert np.abs(R @ points - fine.points).max() < 1e-15


def test_two_steps_of_an_open_cage_are_the_reference():
    assert_same_mesh(ls.refined(cage("open_5"), 2), KNOWN["open_points_2"], KNOWN["open_faces_2"])


def test_exact_points_are_refined_exactly():
    points = [[F(x)] for x in (0, 9, 27, 1)]
    faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    fine, R = ls.refined(ls.Mesh(points, faces), 2, scheme="sqrt3", operator=True)
    own = [np.array(p, dtype=object) for p in points]
    naive, _ = oracle.refined(own, faces, 2, oracle.rational_cosine)
    assert sorted(fine.points[:, 0]) == sorted(p[0] for p in naive)
    assert ((R @ np.array(points, dtype=object)) == fine.points).all()
    five = [[1, 2, 3], [1, 3, 4], [1, 4, 5], [1, 5, 6], [1, 6, 2]]
    with pytest.raises(TypeError, match="vertex 1 has valence 5, where the masks"):
        ls.refined(ls.Mesh([[F(1)]] * 7, five), scheme="sqrt3")


def test_corners_of_one_face_stay_unless_boundaries_go_around_them():
    points, faces = np.array([[0.0, 0], [9, 0], [0, 9]]), [[0, 1, 2]]
    own = [np.array([F(x) for x in p.tolist()]) for p in points]
    for boundary, fixed in (("edge_and_corner", (0, 1, 2)), ("edge_only", ())):
        fine = ls.refined(ls.Mesh(points, faces), 2, scheme="sqrt3", boundary=boundary)
        naive = oracle.refined(own, faces, 2, lambda n: F(-1, 2), fixed)
        assert_same_mesh(fine, *naive)
        surface = ls.LimitSurface(fine.with_points(fine.points), boundary=boundary)
        assert len(surface.limit_faces) == 9
    assert (ls.refined(ls.Mesh(points, faces), 4, scheme="sqrt3").points[:3] == points).all()


@pytest.mark.parametrize("levels", range(5))
@pytest.mark.parametrize("name", ["open_5", "sphere_9", "tetrahedron"])
def test_vertices_are_where_their_parents_are(name, levels):
    """Also on intermediate meshes, after an odd number of steps."""
    mesh = cage(name)
    fine, surface = ls.refined(mesh, levels), ls.LimitSurface(mesh)
    at = fine.parent_face, fine.parent_u, fine.parent_v
    assert np.abs(surface.evaluate(*at) - fine.limit_points).max() < 2e-15
    assert (
        np.abs(fine.limit_points[: mesh.n_vertices] - ls.refined(mesh, 0).limit_points).max()
        < 1e-15
    )
    normals = np.empty((fine.n_vertices, 3))
    normals[fine.indices] = fine.limit_normals
    assert np.abs(surface.normal(*at) - normals).max() < 1e-12
    again = pickle.loads(pickle.dumps(fine))
    assert (again.parent_u == fine.parent_u).all()
    assert (again.limit_points == fine.limit_points).all()


def with_islands(name, islands, mode):
    """A cage with a channel that has seams around some faces, and what the channel is cut into."""
    points, faces = CAGES[name]
    corners, values = np.array(faces), [np.sin(3 * points[:, :2] + points[:, 1:])]
    for k, island in enumerate(islands):
        corners[island] += (k + 1) * len(points)
        values.append(values[0] * (k + 2) + 0.5)
    channels = {"uv": (np.concatenate(values), corners.ravel(), mode)}
    kept, cut = np.unique(corners, return_inverse=True)
    mesh = ls.Mesh(points, faces, channels=channels, scheme="sqrt3")
    return mesh, np.concatenate(values)[kept], cut.reshape(-1, 3).tolist()


@pytest.mark.parametrize("mode", ["none", "corners_only"])
def test_channels_are_refined_like_meshes_cut_along_seams(mode):
    """Islands of one face and of four, whose corners in a single face stay or not."""
    mesh, values, faces = with_islands("open_5", [[0], [4, 8, 12, 16]], mode)
    alone = np.flatnonzero(np.bincount(np.ravel(faces)) == 1).tolist()
    assert len(alone) == 5
    fixed = alone if mode == "corners_only" else ()
    naive = oracle.refined(long_points(values), faces, 2, cosine, fixed)
    found, corners, kept = ls.refined(mesh, 2).channels["uv"]
    assert kept == mode
    fine = SimpleNamespace(points=found, n_vertices=len(found), faces=corners.reshape(-1, 3))
    assert_same_mesh(fine, *naive)
    deep = ls.refined(mesh, 4).channels["uv"][0]
    assert len(deep) == len(oracle.refined(long_points(values), faces, 4, cosine, fixed)[0])


def test_channels_keep_to_the_faces_that_they_are_on():
    """The limit of a refined mesh is that of the cage, at places inside of each of nine parts."""
    mesh, _, _ = with_islands("open_5", [[0, 4, 8], [9], [18, 19]], "none")
    thirds = [[(0, 0), (1, 0), (0, 1)], [(3, 0), (2, 1), (2, 0)], [(0, 3), (0, 2), (1, 2)]]
    thirds += [[(1, 0), (2, 0), (1, 1)], [(2, 1), (1, 2), (1, 1)], [(0, 2), (0, 1), (1, 1)]]
    thirds += [[(1, 0), (1, 1), (0, 1)], [(2, 1), (1, 1), (2, 0)], [(0, 2), (1, 1), (1, 2)]]
    weights = np.array([0.5, 0.3, 0.2])
    place = np.einsum("k,jkd->jd", weights, np.array(thirds)) / 3
    fine = ls.refined(mesh, 2)
    face = np.arange(9 * mesh.n_faces)
    found = ls.LimitSurface(fine).evaluate(face, 0.3, 0.2, channel="uv")
    at = face // 9, *place[face % 9].T
    assert np.abs(found - ls.LimitSurface(mesh).evaluate(*at, channel="uv")).max() < 1e-13
    again = ls.LimitSurface(pickle.loads(pickle.dumps(fine)))
    assert (again.evaluate(face, 0.3, 0.2, channel="uv") == found).all()


def test_channels_that_have_no_seams_are_refined_like_points():
    points, faces = CAGES["sphere_9"]
    split = np.ravel(faces) + len(points) * (np.arange(3 * len(faces)) < 3)
    channels = {
        "same": (points, np.ravel(faces), "none"),
        "cut": (np.vstack([points, points]), split, "none"),
        "other": (points, np.ravel(faces), "corners_plus1"),
    }
    mesh = ls.Mesh(points, faces, channels=channels, scheme="sqrt3")
    for levels in range(1, 4):
        with pytest.warns(UserWarning, match="channels are left out") as told:
            fine = ls.refined(mesh, levels)
        assert (fine.channels["same"][0] == fine.points).all()
        assert ("cut" in fine.channels) == (levels % 2 == 0)
        whats = sorted(str(one.message) for one in told)
        assert "('other'): scheme 'sqrt3' has no rule for how they are interp" in whats[-1]
        if levels % 2:
            assert "('cut'): scheme 'sqrt3' makes faces across edges, on both sides" in whats[0]
        assert len(told) == 1 + levels % 2
        assert told[0].filename == __file__
    assert list(ls.refined(mesh, 0).channels) == list(channels)
    five = [[1, 2, 3], [1, 3, 4], [1, 4, 5], [1, 5, 6], [1, 6, 2]]
    exact = {"x": ([[F(1)]] * 7, np.ravel(five), "none")}
    mesh = ls.Mesh([[0.0]] * 7, five, channels=exact)
    with pytest.raises(TypeError, match="channel 'x' has exact values, and a valence at which"):
        ls.refined(mesh, scheme="sqrt3")


def test_faces_keep_their_data_and_holes_and_channels():
    points, faces = OPEN
    uv = points[:, :2], np.ravel(faces), "corners_only"
    mesh = ls.Mesh(points, faces, holes=[3], face_data={"part": np.arange(20)}, channels={"uv": uv})
    for levels, each in ((1, 3), (2, 9), (3, 27)):
        fine = ls.refined(mesh, levels, scheme="sqrt3")
        assert np.abs(fine.channels["uv"][0] - fine.points[:, :2]).max() < 1e-15
        assert (fine.face_data["part"] == np.repeat(np.arange(20), each)).all()
        assert fine.holes.tolist() == list(range(3 * each, 4 * each))
    surface = ls.LimitSurface(mesh, scheme="sqrt3")
    assert np.isnan(surface.evaluate(3, 0.2, 0.2)).all()
    linear = ls.Mesh(points, faces, channels={"uv": (*uv[:2], "all")})
    with pytest.raises(ValueError, match="scheme 'sqrt3' has no rule for channel 'uv'"):
        ls.LimitSurface(linear, scheme="sqrt3").evaluate(0, 0.2, 0.3, channel="uv")
    flat = surface.evaluate(0, 0.2, 0.3, channel="uv")
    assert np.abs(flat - surface.evaluate(0, 0.2, 0.3)[:2]).max() < 1e-15


# ---------------------------------------------------------------- limits


def test_shares_are_those_of_the_paper():
    for n in range(2, 51):
        assert abs(float(SQRT3.share_at(n)) - (4 - 2 * math.cos(2 * math.pi / n)) / 9) < 1e-16


@pytest.mark.parametrize("n", [3, 4, 5, 7, 12, 33, 50])
def test_limits_at_vertices_are_those_of_deep_refinement(n):
    """The ring shrinks by at most 2/3 with each step; of it alone the next one is made."""
    mesh = bipyramid(n)
    fine = ls.refined(mesh, 0)
    with mpmath.workdps(300):
        own = long_points(mesh.points)
        p, ring = own[0], oracle.around(0, own, np.asarray(mesh.faces).tolist())
        a = oracle.alpha(n, cosine)
        steps = 240
        for _ in range(steps):
            new = [(p + x + y) / 3 for x, y in zip(ring, ring[1:] + ring[:1], strict=True)]
            p, ring = (1 - a) * p + a / n * sum(ring), new
        spread = [x - p for x in ring]
        area = sum(np.cross(x, y) for x, y in zip(spread, spread[1:] + spread[:1], strict=True))
        normal = area / mpmath.sqrt(sum(x * x for x in area))
        limit = p.astype(float)
    assert np.abs(fine.limit_points[0] - limit).max() < 5e-16
    at = np.flatnonzero(mesh.indices == 0)
    assert np.abs(fine.limit_normals[at] - normal.astype(float)).max() < 1e-13


@pytest.mark.parametrize(
    "name", ["tetrahedron", "sphere_9", "sphere_24", "bipyramid_12", "bipyramid_50"]
)
def test_reference_positions_and_normals(name):
    mesh = cage(name)
    face, u, v, P, vertex, VP, VN = rows(name)
    assert np.abs(ls.LimitSurface(mesh).evaluate(face, u, v) - P).max() < 1e-15
    fine = ls.refined(mesh, 0)
    assert np.abs(fine.limit_points[vertex] - VP).max() < 1e-15
    normals = np.empty((mesh.n_vertices, 3))
    normals[mesh.indices] = fine.limit_normals
    assert np.abs(normals[vertex] - VN).max() < 1e-14


def test_boundaries_are_cubic_splines():
    """Of a strip's edge far from its ends, whatever is inside."""
    rng = np.random.default_rng(5)
    n = 9
    points = rng.normal(size=(2 * n, 3))
    faces = [f for i in range(n - 1) for f in ([i, i + 1, n + i], [i + 1, n + i + 1, n + i])]
    surface = ls.LimitSurface(ls.Mesh(points, faces), scheme="sqrt3")
    t = rng.random(20)
    basis = np.stack(
        [(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3]
    )
    assert np.abs(surface.evaluate(8, t, 0.0) - basis.T @ points[3:7] / 6).max() < 2e-15
    slope = (
        np.stack([-((1 - t) ** 2), 3 * t**2 - 4 * t, -3 * t**2 + 2 * t + 1, t**2]).T @ points[3:7]
    )
    assert np.abs(surface.evaluate(8, t, 0.0, nu=(1, 0)) - slope / 2).max() < 1e-13
    assert np.isnan(surface.evaluate(8, t, 0.0, nu=(0, 1))).all()
    normal = surface.normal(8, t, 0.0)
    assert np.abs((normal * slope).sum(axis=1)).max() < 1e-13
    assert np.abs(surface.normal(8, t, 1e-12) - normal).max() < 1e-6


# ---------------------------------------------------------------- derivatives


def test_derivatives_are_those_of_differences():
    rng = np.random.default_rng(1)
    for name in ("tetrahedron", "sphere_24", "open_5"):
        mesh = cage(name)
        surface = ls.LimitSurface(mesh)
        face = rng.integers(0, mesh.n_faces, 100)
        u, v = 0.1 + 0.7 * rng.dirichlet([1, 1, 1], 100).T[:2]
        h = 2.0**-16
        jet = surface.jet(face, u, v, order=1)
        for nu, (x, y) in {(1, 0): (h, 0), (0, 1): (0, h)}.items():
            slope = surface.evaluate(face, u + x, v + y) - surface.evaluate(face, u - x, v - y)
            # second derivatives are Hoelder continuous to some 0.6
            assert np.abs(slope / (2 * h) - jet[nu]).max() < 1e-6
        W = surface.weights(face, u, v, nu=[(0, 0), (1, 0), (0, 1)])
        for matrix, nu in zip(W, [(0, 0), (1, 0), (0, 1)], strict=True):
            assert np.abs(matrix @ mesh.points - jet[nu]).max() < 2e-14
        along, across = surface.tangents(face, u, v)
        for found, nu in ((along, (1, 0)), (across, (0, 1))):
            length = np.linalg.norm(jet[nu], axis=1, keepdims=True)
            assert np.abs(found * length - jet[nu]).max() < 1e-14
        normal = np.cross(jet[1, 0], jet[0, 1])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        assert np.abs(surface.normal(face, u, v) - normal).max() < 1e-13


@pytest.mark.parametrize("n", [3, 5, 7, 50])
def test_derivatives_scale_towards_vertices(n):
    """By three times the square of two thirds of cos(pi / n), at any distance."""
    surface, value = ls.LimitSurface(bipyramid(n)), 4 / 3 * math.cos(math.pi / n) ** 2
    far, near = (
        surface.evaluate(0, 0.3 / 3.0**k, 0.2 / 3.0**k, nu=(1, 0)) / value**k for k in (400, 600)
    )
    # what turns twice falls faster, by little where many faces meet
    beyond = (math.cos(2 * math.pi / n) / math.cos(math.pi / n)) ** 800
    assert np.abs(far - near).max() < (1e-11 + beyond) * np.abs(near).max()
    gap = surface.evaluate(0, 1e-300, 1e-301) - surface.evaluate(0, 0.0, 0.0)
    assert np.abs(gap).max() < 1e-16
    turned = surface.normal(0, 1e-300, 1e-301) - surface.normal(0, 0, 0)
    assert np.abs(turned).max() < (1e-12 if n < 50 else 1e-3)
    at = surface.evaluate(0, 0.0, 0.0, nu=(1, 0))
    assert (at == 0).all() if n < 6 else np.isnan(at).all()


def test_second_derivatives_are_not_a_number():
    surface = ls.LimitSurface(cage("sphere_24"))
    assert np.isnan(surface.evaluate(0, 0.3, 0.3, nu=(1, 1))).all()
    assert np.isnan(surface.weights(0, 0.3, 0.3, nu=(2, 0)).data).all()
    with pytest.raises(ValueError, match="scheme 'sqrt3' has no curvature here"):
        surface.curvature(0, 0.3, 0.3)


@pytest.mark.parametrize("faces", range(1, 9))
def test_normals_on_boundaries_where_there_is_a_tangent_plane(faces):
    """Of up to five faces, and of corners that stay of up to two."""
    rng = np.random.default_rng(faces)
    turn = np.arange(faces + 1) * 3 / faces
    ring = np.stack([np.cos(turn), np.sin(turn), 0.3 * rng.normal(size=faces + 1)], axis=1)
    mesh = ls.Mesh(np.vstack([[0.0, 0, 0], ring]), [[0, i + 1, i + 2] for i in range(faces)])
    surface = ls.LimitSurface(mesh, scheme="sqrt3", boundary="edge_only")
    t = np.array([0, 0.01, 0.3, 0.8, 1])
    near = surface.normal(np.arange(faces)[:, None], 1e-200 * t, 1e-200 * (1 - t))
    at = surface.normal(np.arange(faces), 0.0, 0.0)
    if faces <= 5:
        assert np.abs(near - at[0]).max() < 1e-12
        assert np.abs(at - at[0]).max() < 1e-15
        assert at[0, 2] > 0
    else:
        assert np.isnan(at).all()


@pytest.mark.parametrize("faces", [1, 2, 4, 5, 7])
def test_derivatives_along_boundaries_at_vertices_and_near(faces):
    """Of the cubic B-spline, and of a straight end where the corner stays."""
    rng = np.random.default_rng(faces)
    turn = np.arange(faces + 1) * 3 / faces
    ring = np.stack([np.cos(turn), np.sin(turn), rng.normal(size=faces + 1)], axis=1)
    mesh = ls.Mesh(np.vstack([[0.0, 0, 0], ring]), [[0, i + 1, i + 2] for i in range(faces)])
    for boundary in ("edge_only", "edge_and_corner"):
        surface = ls.LimitSurface(mesh, scheme="sqrt3", boundary=boundary)
        stays = faces == 1 and boundary == "edge_and_corner"
        slope = ring[0] if stays else (ring[0] - ring[-1]) / 2
        back = ring[-1] if stays else -slope
        for x in (0.0, 1e-300, 1e-100):
            assert np.abs(surface.evaluate(0, x, 0.0, nu=(1, 0)) - slope).max() < 1e-13
            assert np.abs(surface.evaluate(faces - 1, 0.0, x, nu=(0, 1)) - back).max() < 1e-13


# ---------------------------------------------------------------- calls


def test_what_is_asked_for_does_not_matter_to_others():
    surface = ls.LimitSurface(cage("sphere_24"))
    rng = np.random.default_rng(2)
    face = rng.integers(0, 44, 60)
    u, v = rng.dirichlet([1, 1, 1], 60).T[:2]
    many = surface.evaluate(face, u, v)
    assert np.abs(many[::-1] - surface.evaluate(face[::-1], u[::-1], v[::-1])).max() < 1e-15
    assert (surface.evaluate(face, u, v, workers=2) == many).all()
    one = [surface.evaluate(int(f), float(x), float(y)) for f, x, y in zip(face, u, v, strict=True)]
    assert np.abs(np.array(one) - many).max() < 1e-15
    u[3], v[5] = np.nan, np.inf
    some = surface.evaluate(face, u, v)
    assert np.flatnonzero(np.isnan(some).any(axis=1)).tolist() == [3, 5]
    far = ls.LimitSurface(cage("sphere_24").with_points(cage("sphere_24").points + 2.0**40))
    assert (
        np.abs(far.evaluate(face, u, v, nu=(1, 0)) - surface.evaluate(face, u, v, nu=(1, 0)))[
            :3
        ].max()
        < 1e-3
    )


@pytest.mark.parametrize("engine", ["reference", "compiled"])
def test_faces_with_a_vertex_twice_are_refused(engine):
    """Both thirds of an edge from a vertex to itself would be one point."""
    mesh = ls.Mesh(np.eye(3), [[0, 1, 2], [0, 2, 2]])
    with (
        _kernels.chosen(engine),
        pytest.raises(ls.MeshError, match=r"face 1 has a vertex twice \(0, 2, 2\): scheme 'sqrt3'"),
    ):
        ls.refined(mesh, 2, scheme="sqrt3")


@pytest.mark.parametrize("levels", [1, 2])
@pytest.mark.parametrize("seed", range(12))
def test_connectivity_of_any_cage_by_both_engines(seed, levels):
    """Of faces on few vertices: on the same ones, with edges of many, in no order."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 7))
    faces = [rng.permutation(n)[:3] for _ in range(rng.integers(1, 9))]
    mesh, found = ls.Mesh(rng.random((n, 3)), faces), []
    for engine in ("reference", "compiled"):
        with _kernels.chosen(engine):
            fine = ls.refined(mesh, levels, scheme="sqrt3")
            found.append((fine.indices, fine.edges, fine.points, fine.limit_points))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(other, one, rtol=0, atol=1e-14)


def test_bad_calls_are_refused():
    mesh = cage("sphere_9")
    surface = ls.LimitSurface(mesh)
    with pytest.raises(IndexError, match="limit face 14 is out of range"):
        surface.evaluate(14, 0.1, 0.1)
    with pytest.raises(ValueError, match="outside the triangle"):
        surface.evaluate(0, 0.6, 0.6)
    with pytest.raises(TypeError, match="has exact points in refined meshes alone"):
        surface.evaluate(0, F(1, 3), F(1, 3))
    with pytest.raises(ls.MeshError, match="is of triangles: face 0 has 4 corners"):
        ls.LimitSurface(ls.Mesh(np.zeros((4, 3)), [[0, 1, 2, 3]]), scheme="sqrt3")
    with pytest.raises(ls.MeshError, match="no rule for creases"):
        ls.LimitSurface(ls.Mesh(mesh.points, mesh.faces, creases={(6, 5): 1}), scheme="sqrt3")
    with pytest.raises(ValueError, match=r"scheme 'sqrt3' .* has no polynomial pieces"):
        ls.bezier_patches(surface)


@pytest.mark.parametrize(
    "faces", [[[0, 1, 2], [1, 0, 3], [0, 1, 4]], [[0, 1, 2], [0, 3, 4]], [[0, 1, 2], [0, 1, 3]]]
)
def test_cages_that_are_no_manifolds(faces):
    """Vertices of several fans stay, and all sides share the points of an edge."""
    mesh = ls.Mesh(np.random.default_rng(0).normal(size=(5, 3)), faces)
    surface = ls.LimitSurface(mesh, scheme="sqrt3")
    for levels in (2, 3):
        fine = ls.refined(mesh, levels, scheme="sqrt3")
        used = fine.vertex_faces > 0
        at = fine.parent_face[used], fine.parent_u[used], fine.parent_v[used]
        assert np.abs(surface.evaluate(*at) - fine.limit_points[used]).max() < 1e-15
    assert (fine.points[0] == mesh.points[0]).all()


def test_vertices_amid_two_faces():
    """There two edges join the same vertices; a position, but no normal."""
    rng = np.random.default_rng(8)
    for faces in ([[0, 1, 2], [0, 2, 1]], [[0, 1, 2], [0, 2, 1], [1, 3, 2]]):
        mesh = ls.Mesh(rng.normal(size=(1 + np.max(faces), 3)), faces, scheme="sqrt3")
        surface = ls.LimitSurface(mesh)
        for levels in (1, 2, 3, 4):
            fine = ls.refined(mesh, levels)
            at = fine.parent_face, fine.parent_u, fine.parent_v
            assert np.abs(surface.evaluate(*at) - fine.limit_points).max() < 2e-15
        assert np.isnan(surface.normal(0, 0.0, 0.0)).all()
        assert np.isnan(ls.refined(mesh, 0).limit_normals[0]).all()


def test_the_largest_numbers_do_not_overflow():
    mesh = cage("tetrahedron")
    surface = ls.LimitSurface(mesh)
    large = surface.with_points(mesh.points * 1.7e308)
    found = large.evaluate(0, 0.2, 0.3) / 1.7e308
    assert np.abs(found - surface.evaluate(0, 0.2, 0.3)).max() < 1e-15


# ---------------------------------------------------------------- wicked masks


WICKED = {
    "share": {"share": lambda n: SQRT3.share(n) + F(1, 100)},
    "share where it is extraordinary": {"share": lambda n: SQRT3.share(n) + F(n != 6, 100)},
    "boundary vertex": {"boundary_vertex": (F(17, 27), F(5, 27))},
    "boundary third": {"boundary_third": (F(15, 27), F(11, 27), F(1, 27))},
}


@pytest.mark.parametrize("mask", WICKED)
def test_a_wicked_mask_is_noticed(mask):
    """In refined meshes, and in limits: by what the tests above compare with."""
    wicked = replace(SQRT3, name="wicked", **WICKED[mask])
    name = "open_5"
    points, faces = CAGES[name]
    fine = ls.refined(ls.Mesh(points, faces), 2, scheme=wicked)
    with pytest.raises(AssertionError):
        assert_same_mesh(fine, KNOWN["open_points_2"], KNOWN["open_faces_2"])
    if mask.startswith("share"):
        face, u, v, P, *_ = rows("sphere_9")
        found = ls.LimitSurface(ls.Mesh(*CAGES["sphere_9"]), scheme=wicked).evaluate(face, u, v)
        assert np.abs(found - P).max() > 1e-6


def test_masks_that_do_not_sum_to_one_are_refused():
    with pytest.raises(ValueError, match="'odd': boundary_vertex sums to 8/9, not to 1"):
        replace(SQRT3, name="odd", boundary_vertex=(F(16, 27), F(4, 27)))
    with pytest.raises(ValueError, match="'odd': boundary_third sums to 2/3"):
        replace(SQRT3, name="odd", boundary_third=(F(1, 3), F(1, 3), F(0)))
    with pytest.raises(ValueError, match=r"'odd': share\(3\) must be 2 Fractions"):
        replace(SQRT3, name="odd", share=lambda n: 0.5).share_at(3)
