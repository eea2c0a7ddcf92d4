"""Kernels of schemes that are evaluated by steps: exactness, and any division of work."""

from fractions import Fraction as F

import numpy as np
import pytest
import zoo_triangles

import limitsurf as ls

SCHEMES = ["butterfly", "modified-butterfly", "sqrt3"]
schemes = pytest.mark.parametrize("scheme", SCHEMES)


def surfaces(name, scheme):
    """By kernels, and by NumPy."""
    points, faces = zoo_triangles.ZOO[name]()
    random = np.random.default_rng(len(points)).integers(-64, 65, (len(points), 3))
    found = []
    for engine in ("compiled", "reference"):
        mesh = ls.Mesh(random / 64, faces)
        found.append(ls.LimitSurface(mesh, scheme=scheme, engine=engine))
    return found


@pytest.mark.parametrize("name", ["grid_4x4", "crowded", "triangle"])
def test_kernels_are_exact_arithmetic(name):
    plain, _ = surfaces(name, "butterfly")
    whole = [[F(x) for x in row] for row in plain.mesh.points.tolist()]
    exact = ls.LimitSurface(plain.mesh.with_points(whole), scheme="butterfly")
    random = np.random.default_rng(1)
    for _ in range(6):
        i, j = sorted(random.integers(0, 1025, 2).tolist())
        face, u, v = 0, F(i, 1024), F(1024 - j, 1024)
        wanted = exact.evaluate(face, u, v)
        found = plain.evaluate(face, float(u), float(v))
        np.testing.assert_allclose(found, wanted.astype(float), rtol=0, atol=1e-15)


@schemes
def test_work_may_be_divided_in_any_way(scheme):
    plain, _ = surfaces("icosahedron", scheme)
    random = np.random.default_rng(2)
    face, (u, v) = random.integers(0, 20, 20000), random.random((2, 20000)) / 2
    u[:4], v[:4] = [0, 1e-300, np.nan, 1], [0, 5e-324, 0.2, 0]
    every = plain.jet(face, u, v, order=1)
    some = plain.jet(face[:9000:7], u[:9000:7], v[:9000:7], order=1)
    several = plain.jet(face, u, v, order=1, workers=3)
    for nu, values in every.items():
        np.testing.assert_array_equal(values[:9000:7], some[nu])
        np.testing.assert_array_equal(values, several[nu])
        one = plain.evaluate(int(face[5]), float(u[5]), float(v[5]), nu=nu)
        np.testing.assert_array_equal(one, values[5])
    assert np.isnan(every[0, 0]).any(axis=1).nonzero()[0].tolist() == [2]
    normal = plain.normal(face, u, v, workers=2)
    np.testing.assert_array_equal(normal[7], plain.normal(face[7], u[7], v[7]))


@schemes
@pytest.mark.parametrize("name", ["icosahedron", "crowded", "fan_7", "bipyramid_12"])
def test_numpy_says_the_same(scheme, name):
    plain, other = surfaces(name, scheme)
    random = np.random.default_rng(3)
    face, (u, v) = random.integers(0, len(other.limit_faces), 400), random.random((2, 400)) / 2
    u[::3] *= 10.0 ** -random.integers(0, 300, 134)
    v[::5] = 0
    pairs = [
        (plain.evaluate(face, u, v), other.evaluate(face, u, v)),
        (plain.weights(face, u, v).toarray(), other.weights(face, u, v).toarray()),
        (plain.tangents(face, u, v)[0], other.tangents(face, u, v)[0]),
        (plain.normal(face, u, v), other.normal(face, u, v)),
    ]
    if (scheme, name) == ("sqrt3", "fan_7"):  # towards a corner without a tangent plane: rounding
        pairs = pairs[:2]
    for one, two in pairs:
        np.testing.assert_allclose(one, two, rtol=0, atol=1e-13)
