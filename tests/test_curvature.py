"""Curvature: against exact derivatives and 60-digit roots, closed forms, and by invariance."""

from fractions import Fraction
from typing import Any

import mpmath
import numpy as np
import pytest
import zoo
import zoo_triangles

import limitsurf as ls

FLAT = 1e-12  # what rounding bends a flat cage of size 1
PLACES = [(0.3, 0.6), (2.0**-9, 2.0**-10), (0.0, 2.0**-40), (2.0**-160, 0.75 * 2.0**-160)]


def exact_curvature(jet):
    """k1, k2, d1 and the sine between d/du and d/dv.

    From rational derivatives, by eigenvalues of the shape operator in mpmath.
    """
    with mpmath.workdps(700):
        x, y, xx, xy, yy = (
            [mpmath.mpf(c.numerator) / c.denominator for c in map(Fraction, jet[nu])]
            for nu in ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
        )

        def dot(a, b):
            return mpmath.fdot(a, b)

        cross = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]]
        length = mpmath.sqrt(dot(cross, cross))
        if length == 0:
            return np.nan, np.nan, np.full(3, np.nan), np.nan
        first = mpmath.matrix([[dot(x, x), dot(x, y)], [dot(x, y), dot(y, y)]])
        e, f, g = (dot(cross, second) / length for second in (xx, xy, yy))
        shape = first**-1 * mpmath.matrix([[e, f], [f, g]])
        mean = (shape[0, 0] + shape[1, 1]) / 2
        spread = mpmath.sqrt(mean**2 - mpmath.det(shape))
        k1, k2 = mean + spread, mean - spread
        # (shape - k2) maps everything to the direction of k1
        a = [shape[0, 0] - k2, shape[1, 0]]
        b = [shape[0, 1], shape[1, 1] - k2]
        a = max(a, b, key=lambda c: max(map(abs, c)))
        d1 = [a[0] * p + a[1] * q for p, q in zip(x, y, strict=True)]
        size = mpmath.sqrt(dot(d1, d1)) or 1
        sine = length / mpmath.sqrt(dot(x, x) * dot(y, y))
        return float(k1), float(k2), np.array([float(c / size) for c in d1]), float(sine)


CAGES = {name: lambda name=name: (*zoo.ZOO[name](), {}) for name in zoo.ZOO} | zoo.TAGGED


# two faces on the same points are folded: next to the fold little but rounding may bend them
FOLDED = {"pillow_of_triangles", "mixed_pillow"}


def exact(points):
    return np.vectorize(Fraction, otypes=[object])(points)


@pytest.mark.parametrize("name", sorted(CAGES))
def test_exact_derivatives_give_it(name):
    _, faces, tags = CAGES[name]()
    count = 1 + max(v for face in faces for v in face)
    mesh = ls.Mesh(zoo.random_points(count, 3), faces, **tags)
    surface, compiled = ls.LimitSurface(mesh), ls.LimitSurface(mesh, engine="compiled")
    precise = surface.with_points(exact(mesh.points))
    faces = np.repeat(np.random.default_rng(1).choice(len(surface.limit_faces), 3), len(PLACES))
    u, v = np.tile(np.transpose(PLACES), 3)
    jet = precise.jet(faces, exact(u), exact(v), order=2)
    both = surface.curvature(faces, u, v), compiled.curvature(faces, u, v)
    normals = surface.normal(faces, u, v)
    for k, normal in enumerate(normals):
        where = faces[k], u[k], v[k]
        if np.isnan(normal).any():
            assert np.isnan([found.k1[k] for found in both]).all()
            continue
        k1, k2, d1, sine = exact_curvature({nu: values[k] for nu, values in jet.items()})
        if np.isnan(k1):
            continue
        size = max(abs(k1), abs(k2))
        gap = (k1 - k2) / (size + FLAT)
        for found in both:
            bound = 3e-12 * size / min(sine, 0.1) + FLAT
            if found is both[1] and name in FOLDED:
                # kernels answer if no entry of the form may be off by more than 2^-36 of it
                bound += 4 * 2.0**-36 * size
            assert found.k1[k] == pytest.approx(k1, rel=0, abs=bound), where
            assert found.k2[k] == pytest.approx(k2, rel=0, abs=bound), where
            along = found.d1[k]
            assert gap < 1e-3 or abs(abs(along @ d1) - 1) < bound / (gap**2 * size), where
            np.testing.assert_allclose(along @ along, 1)
            np.testing.assert_allclose(np.cross(along, found.d2[k]), normal, atol=1e-9)


@pytest.mark.parametrize("height", [1e-6, 1e-11, 1e-14, 1e-100])
@pytest.mark.parametrize("valence", [3, 5, 9])
def test_a_flat_cage_keeps_what_bends_it(valence, height):
    points, faces = zoo.flower(valence)
    points = zoo.random_points(len(points), valence) + 3 * np.asarray(points) / zoo.UNIT
    points[:, 2] *= height
    surface = ls.LimitSurface(ls.Mesh(points, faces))
    precise = surface.with_points(exact(surface.points))
    for face in (0, 4):
        for u, v in PLACES:
            found = surface.curvature(face, u, v)
            jet = precise.jet(face, Fraction(u), Fraction(v), order=2)
            k1, k2, _, sine = exact_curvature(jet)
            bound = 1e-12 * max(abs(k1), abs(k2)) / sine
            assert [found.k1, found.k2] == pytest.approx([k1, k2], rel=0, abs=bound), (u, v)


@pytest.mark.parametrize("name", sorted(set(CAGES) - FOLDED))
def test_kernels_give_the_same(name, use):
    points, faces, tags = CAGES[name]()
    surface = ls.LimitSurface(ls.Mesh(zoo.random_points(len(points), 4), faces, **tags))
    rng = np.random.default_rng(2)
    face = rng.integers(len(surface.limit_faces), size=60)
    u, v = rng.choice([0, 0.5, 1, 0.3, 1e-9, np.nan], size=(2, 60))
    plain = surface.curvature(face, u, v)
    # where tangents are parallel up to rounding, it is rounding that bends the surface
    along, across = surface.tangents(face, u, v)
    sine = np.linalg.norm(np.cross(along, across), axis=1)
    directions = along, across
    use(True)
    for workers in (1, 2):
        for a, b in zip(directions, surface.tangents(face, u, v, workers=workers), strict=True):
            np.testing.assert_allclose(b, a, rtol=0, atol=1e-12)
        compiled = surface.curvature(face, u, v, workers=workers)
        # sums come in another order; what is flat is so up to rounding, more so where degenerate
        size = np.fmax(abs(plain.k1), abs(plain.k2)) + 0.01
        for a, b in zip((plain.k1, plain.k2), (compiled.k1, compiled.k2), strict=True):
            off = np.abs(b - a) / size * np.minimum(sine, 1) ** 3
            assert np.nanmax(off, initial=0) < 6e-12  # each is within 3e-12 of what is true
            np.testing.assert_array_equal(np.isnan(a), np.isnan(b))


@pytest.mark.parametrize("sharp", [False, True])
def test_kernels_around_a_vertex_of_many_faces(sharp, monkeypatch):
    """No eigenfunctions are kept there, but refined points of some levels: more than this asks."""
    points, faces = zoo.flower(80)
    near = np.ldexp(np.linspace(0.55, 1, 7), -(np.arange(7) % 4))
    creases = [[0, 1], [0, faces[160][1]]] if sharp else []
    mesh = ls.Mesh(
        zoo.random_points(len(points), 4), faces, creases=(creases, [np.inf] * len(creases))
    )
    plain, other = (ls.LimitSurface(mesh, engine=x) for x in ("reference", "compiled"))
    face, u, v = 4 * np.arange(80)[:, None, None], near[:, None], near
    wanted, curved = plain.tangents(face, u, v), plain.curvature(face, u, v)
    sine = np.linalg.norm(np.cross(*wanted), axis=-1)
    answers = other._answers.compiled._reference  # who gets what kernels leave
    for left in ("tangents", "curvatures"):
        monkeypatch.setattr(answers, left, None)
    for a, b in zip(wanted, other.tangents(face, u, v), strict=True):
        np.testing.assert_allclose(b, a, rtol=0, atol=1e-12)
    found = other.curvature(face, u, v)
    size = np.maximum(abs(curved.k1), abs(curved.k2))
    for a, b in ((curved.k1, found.k1), (curved.k2, found.k2)):
        assert (abs(a - b) * np.minimum(sine, 1) ** 3 < 6e-12 * size).all()


@pytest.mark.parametrize("name", ["crowded", "fan", "disc"])
def test_triangles_by_kernels(name):
    points, faces = getattr(zoo_triangles, name)(*() if name == "crowded" else (5,))
    mesh = ls.Mesh(zoo.random_points(len(points), 4), faces, scheme="loop")
    plain, other = (ls.LimitSurface(mesh, engine=x) for x in ("reference", "compiled"))
    face = np.arange(len(faces))[:, None]
    near = np.array([0, 0.3, 0.5, 2.0**-9, 2.0**-40, 1e-300])
    # towards each of the corners, but that floats do not reach two of them as closely
    for u, v in ((near, near / 3), (1 - near, near / 3), (near / 3, 1 - near)):
        for a, b in zip(plain.tangents(face, u, v), other.tangents(face, u, v), strict=True):
            np.testing.assert_allclose(b, a, rtol=0, atol=1e-12)
        one, two = plain.curvature(face, u, v), other.curvature(face, u, v)
        size = np.fmax(abs(one.k1), abs(one.k2))
        for a, b in ((one.k1, two.k1), (one.k2, two.k2)):
            np.testing.assert_array_equal(np.isnan(a), np.isnan(b))
            assert (abs(a - b) <= 1e-10 * size + 1e-300)[np.isfinite(size)].all()


def test_kernels_of_different_shapes_have_different_files():
    from limitsurf._kernels import quads, triangles

    for name in ("scattered", "gridded", "lengths", "fill", "tangents", "curved"):
        one, other = (getattr(shape, name)._cache._code for shape in (quads, triangles))
        assert one != other


def test_a_torus_of_many_points():
    """Splines of cages on a torus tend to one of nearby radii R and r."""
    m, n = 96, 64
    points, faces = zoo.torus(m, n)
    a, b = 2 * np.pi * np.arange(m)[:, None] / m, 2 * np.pi * np.arange(n) / n
    ring = 3 + np.cos(b)
    points = np.stack(np.broadcast_arrays(ring * np.cos(a), ring * np.sin(a), np.sin(b)), axis=2)
    surface = ls.LimitSurface(ls.Mesh(points.reshape(-1, 3), faces))
    face = np.arange(len(faces))
    at, found = surface.evaluate(face, 0.3, 0.8), surface.curvature(face, 0.3, 0.8)
    away = np.hypot(at[:, 0], at[:, 1])
    expected = np.sort([np.ones(len(away)), (away - 3) / away], axis=0)
    sign = np.sign(found.mean[0])
    got = np.sort([sign * found.k1, sign * found.k2], axis=0)
    # the curve through n points of a circle is (2 pi / n)^2 / 6 smaller, and bends as much more
    np.testing.assert_allclose(got, expected, atol=2 * (2 * np.pi / n) ** 2 / 6)
    np.testing.assert_allclose(found.gaussian, found.k1 * found.k2, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.mean, (found.k1 + found.k2) / 2, rtol=1e-9)


@pytest.mark.parametrize("factor", [1e-200, 3.0, 1e200])
def test_it_scales_as_one_over_length(factor):
    points, faces = zoo.carved(zoo.cube(), 3)
    surface = ls.LimitSurface(ls.Mesh(points, faces))
    face = np.arange(len(surface.limit_faces))[:, None]
    near = np.array([0.4, 2.0**-30, 2.0**-300])
    one = surface.curvature(face, near, 0.5 * near)
    other = surface.with_points(np.asarray(points, float) * factor).curvature(
        face, near, 0.5 * near
    )
    size = np.fmax(abs(one.k1), abs(one.k2))
    for a, b in ((one.k1, other.k1), (one.k2, other.k2), (one.mean, other.mean)):
        with np.errstate(over="ignore"):
            small = np.abs(a) < 1e100  # else beyond range after scaling
        np.testing.assert_allclose((b * factor / size)[small], (a / size)[small], rtol=0, atol=1e-9)


def test_motions_and_turning_inside_out():
    points, faces = zoo.carved(zoo.cube(), 5)
    mesh = ls.Mesh(points, faces)
    surface = ls.LimitSurface(mesh)
    face, u, v = np.arange(len(surface.limit_faces)), 0.3, 1e-6
    one = surface.curvature(face, u, v)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    moved = surface.with_points(mesh.points @ turn.T + [5, -3, 2]).curvature(face, u, v)
    np.testing.assert_allclose(moved.k1, one.k1, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(np.abs(np.sum(moved.d1 * (one.d1 @ turn.T), axis=1)), 1, rtol=1e-6)
    mirrored = surface.with_points(mesh.points * [1, 1, -1]).curvature(face, u, v)
    np.testing.assert_allclose(mirrored.k1, -one.k2, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(mirrored.gaussian, one.gaussian, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize(("valence", "limit"), [(3, True), (4, True), (5, False), (9, False)])
def test_where_it_exists_at_a_vertex(valence, limit):
    points, faces = zoo.flower(valence, 3)
    surface = ls.LimitSurface(ls.Mesh(zoo.random_points(len(points), 1), faces))
    at = surface.curvature(0, *[(0, 0), (1, 0), (1, 1), (0, 1)][faces[0].index(0)])
    assert np.isfinite(at.k1) == limit
    if valence == 3:
        assert at.k1 == at.k2 == at.mean == at.gaussian == 0
        assert np.isnan(at.d1).all()


def test_queries_and_errors():
    surface = ls.LimitSurface(ls.Mesh(*zoo.cube()))
    found = surface.curvature([0, 1], [[0.5], [np.nan]], 0.5)
    assert found.k1.shape == (2, 2)
    assert found.d1.shape == (2, 2, 3)
    assert np.isnan(found.k1[1]).all()
    assert np.isfinite(found.d2[0]).all()
    with pytest.raises(TypeError, match="square roots"):
        surface.curvature(0, Fraction(1, 2), 0)
    with pytest.raises(IndexError):
        surface.curvature(99, 0, 0)
    with pytest.raises(ValueError, match=r"\(n, 3\)"):
        surface.with_points(np.zeros((8, 2))).curvature(0, 0, 0)


def test_dask_arrays():
    da = pytest.importorskip("dask.array")
    surface = ls.LimitSurface(ls.Mesh(*zoo.cube()))
    u = np.linspace(0.1, 0.9, 10)
    lazy: Any = surface.curvature(1, da.from_array(u, chunks=4), 0.25)
    now = surface.curvature(1, u, 0.25)
    for a, b in zip(lazy, now, strict=True):
        np.testing.assert_allclose(a.compute(), b, rtol=1e-13)


@pytest.mark.parametrize("repeat", [False, True])
def test_a_flat_cage_beside_a_collapsed_edge(repeat, use):
    """What is exactly flat is 0, or nothing where errors outweigh it; never noise."""
    points, faces = zoo.ball(8, 5, repeat)
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    flat = points * [1, 1, 0] @ turn + [1, 2, 3]
    surface, v = ls.LimitSurface(ls.Mesh(flat, faces)), np.linspace(0, 1, 9)
    for compiled in (False, True):
        use(compiled)
        for u in (1e-300, 1e-12, 1e-8, 1e-6, 1e-3, 0.1, 0.3, 0.9):
            found = surface.curvature(0, u, v)
            for k in (found.k1, found.k2, found.mean):
                assert (np.isnan(k) | (np.abs(k) < 1e-10)).all()
                assert u < 1e-3 or not np.isnan(k).any()
