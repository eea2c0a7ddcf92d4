"""Schemes by which only its own corners decide about a face: what that means.

What holds for all schemes is in `test_every_scheme`.
"""

import dataclasses
import pickle
from fractions import Fraction as F

import numpy as np
import oracles_bilinear
import pytest
import zoo
import zoo_triangles
from oracles_creases import Cage

import limitsurf as ls
from limitsurf.patches import REGULAR

QUAD = [[0.0, 0, 0], [2, 0, 0], [2, 1, 0.5], [0, 1, 0]]
BOTH = pytest.mark.parametrize("scheme", ["bilinear", "linear"])


def cage(scheme):
    points, faces = (zoo.ZOO["truncated_cube"] if scheme == "bilinear" else zoo_triangles.crowded)()
    return np.array(points, dtype=float), faces


@BOTH
def test_tags_change_nothing_but_holes(scheme):
    points, faces = cage(scheme)
    edge = faces[0][:2]
    tags = {"creases": {tuple(edge): 2.3}, "corners": {faces[1][0]: np.inf}}
    plain = ls.LimitSurface(ls.Mesh(points, faces), scheme=scheme)
    face = np.arange(len(plain.limit_faces))
    here = face[:, None], np.linspace(0, 0.5, 5), 0.25
    for rules in ({}, {"boundary": "none"}, {"creasing": "chaikin"}, {"boundary": "edge_only"}):
        mesh = ls.Mesh(points, faces, **tags, **rules)
        other = ls.LimitSurface(mesh, scheme=scheme)
        assert np.array_equal(plain.evaluate(*here), other.evaluate(*here))
        assert np.array_equal(plain.normal(*here), other.normal(*here))
        one, two = (ls.refined(x, 2, scheme=scheme) for x in (plain.mesh, mesh))
        assert np.allclose(one.points, two.points, rtol=0, atol=1e-15 * np.ptp(points))
        assert np.array_equal(two.limit_points, two.points)
    first = ls.LimitSurface(ls.Mesh(points, faces, holes=[0]), scheme=scheme)
    lost = np.isnan(first.evaluate(*here)).any(axis=(1, 2))
    assert np.array_equal(lost, first.limit_faces.face == 0)


@BOTH
def test_all_patches_are_regular(scheme):
    """Whatever the valence: one patch to a limit face, but for none on its own corners."""
    points, faces = cage(scheme)
    table = ls.LimitSurface(ls.Mesh(points, faces), scheme=scheme).patches
    assert (table.kind == REGULAR).all()
    assert len(table.kind) == table.n_limit_faces
    assert table.special_corners() == []
    spokes, rim = zoo.bipyramid(300)
    pole = ls.LimitSurface(ls.Mesh(spokes, rim), scheme=scheme)
    assert sum(x.size for x in pole.patches.controls) <= 4 * len(pole.limit_faces)


@pytest.mark.parametrize("mode", ["none", "corners_only", "corners_plus1", "corners_plus2",
                                  "boundaries", "all"])  # fmt: skip
@BOTH
def test_channels_are_linear_in_all_modes(scheme, mode):
    points, faces = cage(scheme)
    rng = np.random.default_rng(0)
    sizes = [len(f) for f in faces]
    rows = rng.integers(0, 2, sum(sizes)) + 2 * np.concatenate([np.ravel(f) for f in faces])
    values = rng.integers(-64, 65, (2 * len(points), 2)) / 64.0
    mesh = ls.Mesh(points, faces, channels={"uv": (values, rows, mode)})
    surface = ls.LimitSurface(mesh, scheme=scheme)
    # the faces by themselves, each with corners of its own
    own = np.split(np.arange(sum(sizes)), np.cumsum(sizes)[:-1])
    exact = [tuple(map(F, row)) for row in values[rows].tolist()]
    kind = "BilinearSurface" if scheme == "bilinear" else "LinearSurface"
    oracle = getattr(oracles_bilinear, kind)(Cage(exact, [x.tolist() for x in own]))
    fine = ls.refined(mesh, 2, scheme=scheme)
    for f in range(len(surface.limit_faces)):
        needed = [float(x) for x in oracle.evaluate(f, F(1, 4), F(1, 8))]
        assert np.allclose(surface.evaluate(f, 0.25, 0.125, channel="uv"), needed, atol=1e-15)
    there = ls.LimitSurface(fine, scheme=scheme)
    gap = ls.refinement_gap(surface, np.arange(3), np.full(3, 0.3), np.full(3, 0.2), channel="uv")
    assert gap[0] < 1e-15
    assert len(there.limit_faces) == fine.n_faces


def test_normals_of_quads_with_an_edge_that_is_a_point():
    """The limits towards it: of x = (1 - v) (a + u (b - a)) + v p, a flat triangle."""
    a, b, p = np.array([[0.0, 0, 0], [2, 0, 0], [0, 1, 1]])
    needed = np.cross(b - a, p - a) / np.linalg.norm(np.cross(b - a, p - a))
    corners = [a, b, p, p]
    for turn in range(4):
        points = np.array(corners[turn:] + corners[:turn])
        for engine in ("reference", "compiled"):
            surface = ls.LimitSurface(
                ls.Mesh(points, [[0, 1, 2, 3]]), scheme="bilinear", engine=engine
            )
            u, v = np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 1, 5))
            assert np.allclose(surface.normal(0, u, v), needed, rtol=0, atol=1e-15)
        mesh = ls.refined(ls.Mesh(points, [[0, 1, 2, 3]]), 0, scheme="bilinear")
        assert np.allclose(mesh.limit_normals, needed, rtol=0, atol=1e-15)


def test_normals_that_do_not_exist():
    points = [[0.0, 0, 0], [0, 0, 0], [1, 0, 0], [0, 0, 0]]  # a line
    surface = ls.LimitSurface(ls.Mesh(points, [[0, 1, 2, 3]]), scheme="bilinear")
    assert np.isnan(surface.normal(0, [0, 0.5, 1], [0, 0.5, 1])).all()


def test_faces_have_normals_of_their_own():
    points, quads = zoo.cube()
    points = np.array(points, dtype=float)
    surface = ls.LimitSurface(ls.Mesh(points, quads), scheme="bilinear")
    middle = surface.normal(np.arange(6), 0.5, 0.5)
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1), (0.5, 0)]).T
    assert np.array_equal(surface.normal(np.arange(6)[:, None], *corners),
                          np.repeat(middle[:, None], 5, axis=1))  # fmt: skip
    fine = ls.tessellate(surface, 2)
    assert len(fine.points) == 26
    assert len(fine.normals) >= 6 * 9


def test_saddle():
    """Curvature of z = x y at the origin: mean 0, Gaussian -1."""
    points = [[-1.0, -1, 1], [1, -1, -1], [1, 1, 1], [-1, 1, -1]]
    k = ls.LimitSurface(ls.Mesh(points, [[0, 1, 2, 3]]), scheme="bilinear").curvature(0, 0.5, 0.5)
    assert np.allclose([k.k1, k.k2, k.mean, k.gaussian], [1, -1, 0, -1], rtol=0, atol=1e-15)


def test_exact_numbers_go_in_and_out():
    exact = np.vectorize(F, otypes=[object])(np.array(QUAD))
    surface = ls.LimitSurface(ls.Mesh(exact, [[0, 1, 2, 3]]), scheme="bilinear")
    assert surface.evaluate(0, F(1, 3), F(1, 7)).tolist() == [F(2, 3), F(1, 7), F(1, 42)]
    assert surface.evaluate(0, F(1, 3), F(1, 7), nu=(1, 1)).tolist() == [0, 0, F(1, 2)]
    assert surface.evaluate(0, 1, 1, nu=(2, 0)).tolist() == [0, 0, 0]
    fine = ls.refined(ls.Mesh(exact, [[0, 1, 2, 3]]), scheme="bilinear")
    assert fine.points[8].tolist() == [1, F(1, 2), F(1, 8)]
    assert fine.limit_points.tolist() == fine.points.tolist()
    with pytest.raises(TypeError, match="square roots"):
        surface.normal(0, F(1, 3), F(1, 7))


@BOTH
def test_pickles_and_single_faces(scheme):
    size = 4 if scheme == "bilinear" else 3
    surface = ls.LimitSurface(ls.Mesh(QUAD[:size], [list(range(size))]), scheme=scheme)
    again = pickle.loads(pickle.dumps(surface))
    assert np.array_equal(again.evaluate(0, 0.2, 0.3), surface.evaluate(0, 0.2, 0.3))
    patches = ls.bezier_patches(surface)
    assert len(patches.rest) == 0
    there = patches.evaluate(np.array([0.2]), np.array([0.3])).reshape(3)
    assert np.allclose(there, surface.evaluate(0, 0.2, 0.3), rtol=0, atol=1e-15)


def test_linear_wants_triangles():
    with pytest.raises(ls.MeshError, match="scheme 'linear' is of triangles: face 0 has 4 corners"):
        ls.LimitSurface(ls.Mesh(QUAD, [[0, 1, 2, 3]]), scheme="linear")
    with pytest.raises(ValueError, match='has no triangle rule "smooth"'):
        ls.LimitSurface(ls.Mesh(QUAD, [[0, 1, 2, 3]]), scheme="bilinear", triangles="smooth")


@pytest.mark.parametrize("change", [
    {"vertex": lambda n: (F(1), F(0), F(0)) if n == 4 else (F(1, 2), F(1, 4 * n), F(1, 4 * n))},
    {"edge": lambda a, b: (F(1, 2), F(1, 2), F(0)) if a == b == 4 else (F(1, 4),) * 3},
])  # fmt: skip
def test_masks_that_faces_would_not_see_are_refused(change):
    scheme = dataclasses.replace(ls.schemes["bilinear"], name="wicked", **change)
    with pytest.raises(ValueError, match=r"'wicked': .* but the bilinear spline needs .* at every"):
        ls.refined(ls.Mesh(*zoo.cube()), scheme=scheme)
