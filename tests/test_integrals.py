"""Integrals: against hand-typed numbers, refined meshes, Fractions and each other."""

import warnings
from fractions import Fraction as F

import numpy as np
import pytest
import zoo
from command_line import facts, fail, succeed

import limitsurf as ls
from limitsurf import numbers, tables
from limitsurf.integrals.tails import ratios, tail
from limitsurf.scheme.catmull_clark import CATMULL_CLARK

SIMPLEX = (
    [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]],
    [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]],
)
EDGE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]]


def exactly(mesh):
    return mesh.with_points(numbers.RATIONAL.array(mesh.points))


def closed(scheme):
    """A closed surface without symmetry, by any scheme."""
    points, faces = zoo.octahedron() if ls.schemes[scheme].lattice.face_size == 3 else zoo.prism(5)
    rng = np.random.default_rng(1)
    return ls.LimitSurface(
        ls.Mesh(points + rng.uniform(-0.1, 0.1, points.shape), faces), scheme=scheme
    )


def of_triangles(mesh):
    """Area, volume, first and second moments of triangles: not of this package's integrals."""
    corners = []
    for face in mesh.faces:
        corners += [(face[0], face[k], face[k + 1]) for k in range(1, len(face) - 1)]
    a, b, c = np.moveaxis(np.asarray(mesh.limit_points)[np.array(corners)], 1, 0)
    normal = np.cross(b - a, c - a)
    w = (a * normal).sum(axis=1)
    first = ((a + b + c) * w[:, None] / 24).sum(axis=0)
    return np.array([np.sqrt((normal**2).sum(axis=1)).sum() / 2, w.sum() / 6, *first])


@pytest.mark.parametrize("scheme", ls.schemes.with_pieces)
def test_refined_meshes_tend_to_it(scheme):
    # triangles at limit points err as h^2; between poles, which lower that, Richardson's step is
    # good to a few digits
    surface = closed(scheme)
    coarse, fine = (of_triangles(ls.refined(surface.mesh, n, **surface.rules)) for n in (4, 5))
    volume, area = ls.volume(surface), ls.area(surface)
    known = np.array([area, volume, *(ls.centroid(surface) * volume)])
    assert np.allclose(fine + (fine - coarse) / 3, known, rtol=0, atol=2e-4 * area)
    assert np.abs(fine - known).max() <= 0.3 * np.abs(coarse - known).max() + 1e-12


@pytest.mark.parametrize("scheme", ls.schemes.with_pieces)
def test_another_cage_of_the_same_surface_elsewhere(scheme):
    surface = closed(scheme)
    turn, _ = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    away = np.array([300.0, -20.0, 7.0])
    again = ls.refined(surface.mesh, 1, **surface.rules)
    moved = ls.LimitSurface(again.with_points(again.points @ turn.T + away), **surface.rules)
    assert np.isclose(ls.volume(moved), ls.volume(surface), rtol=1e-12)
    assert np.isclose(ls.area(moved), ls.area(surface), rtol=1e-12)
    for of in ("body", "surface"):
        middle, tensor = ls.centroid(surface, of=of), ls.inertia(surface, of=of)
        assert np.allclose(ls.centroid(moved, of=of), turn @ middle + away, rtol=0, atol=1e-12)
        found = ls.inertia(moved, of=of, about=away)
        assert (found == found.T).all()
        expected = turn @ ls.inertia(surface, of=of, about=[0, 0, 0]) @ turn.T
        assert np.allclose(found, expected, rtol=0, atol=1e-12 * expected.max())
        # by Steiner's theorem
        mass = ls.volume(surface) if of == "body" else ls.area(surface)
        steiner = mass * (middle @ middle * np.identity(3) - np.multiply.outer(middle, middle))
        assert np.allclose(turn @ (tensor + steiner) @ turn.T, found, rtol=0, atol=1e-12)


@pytest.mark.parametrize("scheme", ls.schemes.with_pieces)
def test_parts_add_up_and_rules_agree(scheme):
    surface = closed(scheme)
    n = len(surface.limit_faces)
    parts = [ls.area(surface, face=range(k, n, 3)) for k in range(3)]
    assert np.isclose(sum(parts), ls.area(surface), rtol=1e-12)
    q = ls.quadrature(surface, points=8)
    assert q.offsets[-1] == len(q)
    assert (np.diff(q.face) >= 0).all()
    assert q.accuracy <= 1e-12
    jet = surface.jet(q.face, q.u, q.v, order=1)
    normal = np.cross(jet[1, 0], jet[0, 1])
    element = np.sqrt((normal**2).sum(axis=1))
    assert np.isclose(q.weights @ element, ls.area(surface), rtol=2e-12)
    volume = q.weights @ (jet[0, 0] * normal).sum(axis=1) / 3
    assert np.isclose(volume, ls.volume(surface), rtol=2e-12)
    flux = ls.integrate(surface, lambda x, normals: (x * normals).sum(axis=1) / 3)
    assert np.isclose(flux, volume, rtol=2e-12)


def test_numbers_typed_by_hand():
    cube, simplex = ls.Mesh(*zoo.cube()), ls.Mesh(*SIMPLEX)
    assert abs(ls.volume(ls.LimitSurface(cube)) - 0.32755237908737) < 1e-14
    assert ls.volume(ls.LimitSurface(exactly(cube), scheme="doo-sabin")) == F(6241, 9920)
    # of edges 2 sqrt 2; of unit edges it is this over 16 sqrt 2
    found = ls.volume(ls.LimitSurface(exactly(simplex), scheme="loop"))
    assert found == 16 * F(44192429513855101, 6865302375425894400)
    assert np.isclose(ls.volume(ls.LimitSurface(simplex, scheme="loop")), float(found), rtol=1e-14)
    box = ls.LimitSurface(exactly(cube), scheme="bilinear")
    assert ls.volume(box) == 1
    assert (ls.centroid(box) == F(1, 2)).all()
    assert (ls.inertia(box) == np.identity(3, dtype=int) * F(1, 6)).all()
    about = ls.inertia(box, about=[0, 0, 0])
    assert (about == np.identity(3, dtype=int) * F(11, 12) - F(1, 4)).all()


def test_exact_moments():
    points, faces = SIMPLEX
    mesh = ls.Mesh(np.array(points) + np.array([[0.5, 0, 0], *[[0, 0, 0]] * 3]), faces)
    exact, close = (ls.LimitSurface(m, scheme="doo-sabin") for m in (exactly(mesh), mesh))
    middle = ls.centroid(exact)
    assert all(isinstance(x, F) for x in middle)
    assert np.allclose(middle.astype(float), ls.centroid(close), rtol=0, atol=1e-14)


@pytest.mark.parametrize("name", ["tagged_ring_2.5", "tagged_cone_4"])
def test_sharpness(name):
    points, faces, tags = zoo.TAGGED[name.removeprefix("tagged_")]()
    surface = ls.LimitSurface(ls.Mesh(points, faces, **tags))
    again = ls.LimitSurface(ls.refined(surface.mesh, 1, **surface.rules), **surface.rules)
    assert np.isclose(ls.area(again), ls.area(surface), rtol=1e-12)
    q = ls.quadrature(surface, points=10)
    jet = surface.jet(q.face, q.u, q.v, order=1)
    # areas of these cages have kinks, where they fold over; normals do not
    found = ls.integrate(surface, lambda _, normals: normals)
    assert np.allclose(q.weights @ np.cross(jet[1, 0], jet[0, 1]), found, rtol=0, atol=1e-11)


def test_a_pole_of_many_faces():
    surface = ls.LimitSurface(ls.Mesh(*zoo.prism(66)))
    again = ls.LimitSurface(ls.refined(surface.mesh, 1))
    assert np.isclose(ls.volume(again), ls.volume(surface), rtol=1e-12)
    with pytest.raises(TypeError, match="at most 8 faces, but limit face 0"):
        ls.volume(ls.LimitSurface(exactly(surface.mesh)))


@pytest.mark.parametrize(
    ("valence", "none", "some"), [(3, 16, 10), (5, 24, 13), (8, 29, 17), (20, 32, 22), (50, 33, 22)]
)
def test_rings(valence, none, some):
    # without a tail, area needs rings until the first ratio to their power is below 1e-12
    table = tables.eigen_table(CATMULL_CLARK, CATMULL_CLARK.sector("interior", valence))
    r = ratios(table, "metric")
    assert np.ceil(np.log(1e-12) / np.log(r[0])) == none
    found = tail(table, "metric", 1e-12)
    assert len(found.factors) <= some
    assert found.accuracy <= 1e-12
    sums = found.factors @ r[None, :] ** np.arange(len(found.factors))[:, None]
    assert np.allclose(sums * (1 - r), 1, rtol=0, atol=1.1e-12)


def test_scales():
    mesh = ls.Mesh(*zoo.cube())
    plain = ls.LimitSurface(mesh)
    for scale in (2.0**300, 2.0**-300):
        other = plain.with_points(mesh.points * scale)
        assert ls.area(other) == ls.area(plain) * scale**2
        assert ls.volume(other) == ls.volume(plain) * scale**3
    huge = plain.with_points(mesh.points * 1e200)
    assert ls.volume(huge) == np.inf
    assert np.isfinite(ls.centroid(huge)).all()
    assert (ls.inertia(huge, about=[0, 0, 0]).diagonal() == np.inf).all()


def test_an_integrand_that_is_not_smooth(monkeypatch):
    monkeypatch.setattr("limitsurf.integrals.sums._FEW", 1 << 12)
    surface = ls.LimitSurface(ls.Mesh(*zoo.cube()), scheme="bilinear")
    # 0.7 of four sides, and one more
    with pytest.warns(RuntimeWarning, match=r"the integral is known to about .* only") as told:
        found = ls.integrate(surface, lambda points, _: points[:, 0] > 0.3)
    reached = float(str(told[0].message).split("known to about ")[1].split()[0])
    assert abs(found - 3.8) <= reached * 3.8 < 0.1


def test_bad_input():
    square, cube = ls.LimitSurface(ls.Mesh(*EDGE)), ls.LimitSurface(ls.Mesh(*zoo.cube()))
    points, faces = zoo.cube()
    for calls in (ls.volume, ls.centroid, ls.inertia):
        with pytest.raises(
            ValueError, match="edge of vertices 0 and 1 has a face on one side only"
        ):
            calls(square)
    hole = ls.LimitSurface(ls.Mesh(points, faces, holes=[2]))
    with pytest.raises(ValueError, match=r"edge of vertices .* 3 more edges"):
        ls.volume(hole)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        turned = ls.LimitSurface(ls.Mesh(points, [faces[0][::-1], *faces[1:]]))
    with pytest.raises(ValueError, match="is passed the same way"):
        ls.volume(turned)
    inside = ls.LimitSurface(ls.Mesh(points, [f[::-1] for f in faces]))
    assert np.isclose(ls.volume(inside), -ls.volume(cube), rtol=1e-13)
    for bad in (1e-16, np.nan, 1, "small"):
        with pytest.raises(ValueError, match="rtol must be"):
            ls.area(cube, rtol=bad)
    with pytest.raises(ValueError, match="points must be an integer >= 1"):
        ls.quadrature(cube, points=0)
    with pytest.raises(ValueError, match="integrand must be one of"):
        ls.quadrature(cube, integrand="mass")
    exact = ls.LimitSurface(exactly(ls.Mesh(points, faces)))
    with pytest.raises(TypeError, match="volume, and centroid"):
        ls.area(exact)
    with pytest.raises(TypeError, match="volume, and centroid"):
        ls.quadrature(exact)
    flat = cube.with_points(points * [1, 1, 0])
    with pytest.raises(ValueError, match="no volume"):
        ls.centroid(flat)
    with pytest.raises(ValueError, match="no area"):
        ls.centroid(square.with_points(0 * square.points), of="surface")
    with pytest.raises(ValueError, match='of must be "body"'):
        ls.inertia(cube, of="soul")
    for bad in ([0, 0], [0, np.inf, 0], "abc", [None] * 3):
        with pytest.raises(ValueError, match="about must be a finite point"):
            ls.inertia(cube, about=bad)
    assert ls.inertia(cube, about=[F(1, 2)] * 3).dtype == float
    with pytest.raises(ValueError, match="shape"):
        ls.integrate(cube, lambda x, n: np.ones(len(x) + 1))
    with pytest.raises(ValueError, match="finite"):
        ls.integrate(cube, lambda x, n: x[:, 0] * np.nan)
    with pytest.raises(IndexError):
        ls.area(cube, face=6)
    with pytest.raises(TypeError, match="LimitSurface"):
        ls.area(points)
    assert ls.area(cube, face=[]) == 0
    assert ls.integrate(cube, lambda x, n: n, face=[]).tolist() == [0, 0, 0]


def test_measure(tmp_path):
    for name, cage in (("cube", zoo.cube()), ("square", EDGE)):
        ls.write(tmp_path / f"{name}.obj", ls.Mesh(*cage))
    found = facts("measure", tmp_path / "cube.obj")
    assert abs(found["volume"] - 0.32755237908737) < 1e-13
    assert found["of"] == "body"
    assert "centroid of the body" in succeed("measure", tmp_path / "cube.obj")
    found = facts("measure", tmp_path / "square.obj")
    assert found["volume"] is None
    assert "closed" in found["no_volume"]
    assert found["of"] == "surface"
    assert "rtol" in fail("measure", tmp_path / "cube.obj", "--rtol", "1e-20")


def test_channels_are_measured():
    """A channel of the points themselves is the surface."""
    points, faces = np.array(zoo.cube()[0], dtype=float), zoo.cube()[1]
    mesh = ls.Mesh(points, faces, channels={"again": (points, np.ravel(faces), "none")})
    surface = ls.LimitSurface(mesh)
    for call in (ls.area, ls.volume):
        assert call(surface, channel="again") == pytest.approx(call(surface), rel=1e-13)
    assert ls.contains(surface, [0.5, 0.5, 0.5], channel="again")
    assert ls.occluded(surface, [0.5, 0.5, 3], [0, 0, -1.0], channel="again")
    found, same = (ls.quadrature(surface, channel=c) for c in (None, "again"))
    assert (found.weights == same.weights).all()
    flat = ls.LimitSurface(ls.Mesh(points[:, :2], faces, channels=mesh.channels))
    assert ls.area(flat, channel="again") == pytest.approx(ls.area(surface), rel=1e-13)
    for call in (ls.area, ls.quadrature):
        with pytest.raises((KeyError, ValueError), match="nothing"):
            call(surface, channel="nothing")
