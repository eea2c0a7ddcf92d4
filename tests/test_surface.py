"""The limit surface against exact arithmetic, scipy, published numbers, and what it promises.

Accuracy is the design's: a position within 1e-14 of the largest coordinate difference in the local
cage plus 2 ulp, a derivative within 1e-12 of its own size or of 1e-3 of the largest of that order
on the same ring, normals and tangents within 1e-12, all of the exact value at that (u, v).
"""

import itertools
import math
import random
from fractions import Fraction as F
from pathlib import Path

import mpmath
import numpy as np
import oracles
import pytest
import zoo

import limitsurf as ls
from limitsurf import tables
from limitsurf._kernels import reference as kernels
from limitsurf.patches import REGULAR

SHARED_CAGES = Path(__file__).resolve().parents[2] / "shared" / "cages"

# The oracle of every registered scheme; a scheme without one fails test_everything_is_tried.
ORACLES = {"catmull-clark": oracles.ExactSurface}

HALF = F(1, 2)
ORDERS = [*itertools.product(range(4), repeat=2), (4, 0), (1, 5)]
LOW_ORDERS = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (3, 3)]
POLES = [3, 5, 6, 7, 12, 33]
SURFACES = [
    (name, mode)
    for name, faces in ((name, make()[1]) for name, make in zoo.ZOO.items())
    for mode in oracles.MODES[: 2 if zoo.boundary_vertices(faces) else 1]
    if zoo.has_regular_boundary(faces, mode)
]
on_the_zoo = pytest.mark.parametrize(("name", "mode"), SURFACES)


def both(points, faces, mode=None):
    """A cage's limit surface, and the oracle's."""
    surface = ls.LimitSurface(ls.Mesh(points, faces), boundary=mode)
    return surface, ORACLES["catmull-clark"](surface.mesh.points, faces, mode or oracles.MODES[0])


def shaken(name, divisor=1):
    """A zoo mesh whose points have no symmetry that could hide an error; Fractions if divided."""
    points, faces = zoo.ZOO[name]()
    points = zoo.random_points(len(points), name)
    return fractions(points, divisor) if divisor != 1 else points, faces


def fractions(values, divisor=1):
    """The same numbers as an object array of Fractions, divided."""
    values = np.asarray(values)
    exact = np.empty(values.size, dtype=object)
    exact[:] = [F(x) / divisor for x in values.ravel().tolist()]
    return exact.reshape(values.shape)


def columns(queries):
    """(face, u, v) triples as three arrays, of objects where there are Fractions."""
    return tuple(np.array(column) for column in zip(*queries, strict=True))


def at_corner(k, a, b):
    """The (u, v) at distances a and b from corner k of the parameter square."""
    return [(a, b), (1 - a, b), (1 - a, 1 - b), (a, 1 - b)][k]


def exact_queries(surface, n, rng):
    """Rational queries: anywhere, dyadic, on knots, at corners, and very close to corners."""
    face = rng.sample(range(len(surface.limit_faces)), min(n, len(surface.limit_faces)))
    kinds = itertools.cycle(["close", "random", "corner", "dyadic", "knots", "edge"])
    queries = []
    for f, kind, _ in zip(itertools.cycle(face), kinds, range(n), strict=False):
        k = rng.randrange(4)
        if kind == "random":
            u, v = F(rng.randint(0, 997), 997), F(rng.randint(0, 991), 991)
        elif kind == "dyadic":
            u, v = F(rng.randint(0, 2**11), 2**11), F(rng.randint(0, 64), 64)
        elif kind == "knots":
            u, v = at_corner(k, F(1, 2 ** rng.randint(0, 6)), F(1, 2 ** rng.randint(0, 6)))
        elif kind == "corner":
            u, v = at_corner(k, F(0), F(0))
        elif kind == "edge":
            u, v = at_corner(k, F(rng.randint(0, 1)), F(rng.randint(0, 99), 99))
        else:
            size = F(1, 10 ** rng.choice([1, 3, 6, 9, 12, 20]))
            u, v = at_corner(k, size * F(rng.randint(0, 77), 77), size * F(rng.randint(0, 78), 78))
        queries.append((f, u, v))
    return queries


def expected(oracle, query, nu):
    """The oracle's exact value; past cubic every piece has derivative 0, at its ends too."""
    value = oracle.evaluate(*query, nu=nu)
    return (0,) * len(value) if max(nu) > 3 else value


def same(values, exact):
    """Equality of rows of Fractions, NaN matching NaN."""
    pairs = zip(values, exact, strict=True)
    return all(x == y or (x != x and y != y) for a, b in pairs for x, y in zip(a, b, strict=True))


def assert_exact(surface, oracle, queries, orders):
    face, u, v = columns(queries)
    # the oracle remembers its last walk, so one query after the other
    exact = [[expected(oracle, query, nu) for nu in orders] for query in queries]
    for k, nu in enumerate(orders):
        values = surface.evaluate(face, u, v, nu=nu)
        assert values.dtype == object
        assert all(isinstance(x, F) or x != x for x in values.ravel())
        assert same(values, [row[k] for row in exact]), f"derivative {nu}"


# --- Exactness


@pytest.mark.parametrize("periodic", [(True, True), (False, True), (False, False)])
def test_regular_surfaces_are_limits_of_refinement(periodic):
    """The only surfaces of a scheme that is wrong at regular vertices: it has no eigenbasis."""
    faces = oracles.grid_faces(4, 5, periodic)
    mesh = ls.Mesh(fractions(zoo.random_points(20, 1), 3), faces)
    fine = ls.refined(mesh, 2)
    values = ls.LimitSurface(mesh).evaluate(fine.parent_face, fine.parent_u, fine.parent_v)
    assert same(values, fine.limit_points)


def with_a_hexagon():
    """A torus of quads, two of them merged; and the quads at the hexagon's four outer corners.

    These have regular vertices only, so that one split makes them regular patches.
    """
    points, faces = zoo.torus(6, 7)
    hexagon = [faces[0][0], faces[0][1], faces[1][1], faces[1][2], faces[1][3], faces[1][0]]
    assert set(hexagon) == {*faces[0], *faces[1]}
    odd = set(faces[0]) & set(faces[1])
    faces = [hexagon, *faces[2:]]
    beside = [f for f, face in enumerate(faces) if {*hexagon} & {*face} and not odd & {*face}]
    assert len(beside) == 6
    return zoo.random_points(len(points), 3), faces, beside


def test_regular_quads_beside_an_ngon():
    points, faces, beside = with_a_hexagon()
    surface, oracle = both(points, faces)
    rng = random.Random(1)
    queries = [
        (5 + face, F(rng.randint(0, 97), 97), F(rng.randint(0, 8), 8))
        for face in beside
        for _ in range(4)
    ]
    assert surface.limit_faces.first[beside].tolist() == [5 + face for face in beside]
    assert_exact(surface, oracle, queries, ORDERS[::3])
    floats = [(face, float(u), float(v)) for face, u, v in queries]
    assert max(accuracy(surface, oracle, floats)) <= 1


@on_the_zoo
def test_exact_on_the_zoo(name, mode):
    """Fractions give the oracle's very numbers, at any parameter, in any derivative."""
    rng = random.Random(f"{name} {mode}")
    surface, oracle = both(*shaken(name, 3), mode=mode)
    orders = [(0, 0), (1, 0), (0, 1), *rng.sample(ORDERS, 3)]
    assert_exact(surface, oracle, exact_queries(surface, 12, rng), orders)


@pytest.mark.parametrize("N", [2, *POLES, 64])
@pytest.mark.parametrize("corner", range(4))
def test_exact_around_an_extraordinary_vertex(N, corner):
    points, faces = oracles.local_cage(N, seed=N, corner=corner)
    surface, oracle = both(points, faces)
    rng = random.Random(N)
    queries = [(0, *at_corner(corner, F(0), F(0)))]
    for exponent in (0, 0, 1, 3, 6, 12, 12, 30):
        a, b = F(rng.randint(0, 96), 97), F(rng.randint(1, 88), 89)
        queries.append((rng.randrange(N), *at_corner(corner, a / 10**exponent, b / 10**exponent)))
    assert_exact(surface, oracle, queries, [(0, 0), (1, 0), (0, 1), (1, 1), (3, 2), (3, 3), (4, 0)])


@pytest.mark.parametrize("name", ["cube", "torus_4x5", "carved_flower", "disk_3"])
def test_floats_count_as_the_rationals_they_are(name):
    """One exact number among points, u and v makes the result exact."""
    points, faces = shaken(name)
    surface, oracle = both(points + 0.1, faces)
    exact_surface = surface.with_points(fractions(points + 0.1))
    query = (1, 0.3, 0.7)
    value = oracle.evaluate(*query)
    assert same([surface.evaluate(1, F(0.3), 0.7)], [value])
    assert same([surface.evaluate(1, 0.3, F(0.7))], [value])
    assert same([surface.evaluate(1, np.array(0.3, dtype=object), 0.7)], [value])
    assert same([exact_surface.evaluate(*query)], [value])
    assert same([exact_surface.evaluate(1, 1, 0)], [oracle.evaluate(1, 1, 0)])
    third = surface.evaluate([1, 1], [F(1, 3), 0], [1, F(2, 3)])
    assert same(third, [oracle.evaluate(1, F(1, 3), 1), oracle.evaluate(1, 0, F(2, 3))])


def test_exact_points_may_be_integers():
    points = np.array([[0], [7], [7], [0]], dtype=object)
    surface = ls.LimitSurface(ls.Mesh(points, [[0, 1, 2, 3]]))
    assert surface.evaluate(0, F(1, 3), 0).tolist() == [F(7, 3)]
    assert surface.evaluate(0, 0.5, 0).tolist() == [F(7, 2)]


def test_cube_numbers():
    """Limits of the closed unit cube's corners, edge midpoints and face centres, as Fractions."""
    points, faces = oracles.CUBE_POINTS, oracles.CUBE_FACES
    surface = ls.LimitSurface(ls.Mesh(fractions(points), faces))
    for f, face in enumerate(faces):
        for k, (u, v) in enumerate(oracles.CORNERS):
            corner, after = points[face[k]], points[face[(k + 1) % 4]]
            inwards = [oracles.CUBE_CORNER * (1 - 2 * x) for x in corner]
            assert surface.evaluate(f, F(u), v).tolist() == [
                x + d for x, d in zip(corner, inwards, strict=True)
            ]
            middle = [(x + y) / 2 for x, y in zip(corner, after, strict=True)]
            mu, mv = (
                F(x + y, 2) for x, y in zip((u, v), oracles.CORNERS[(k + 1) % 4], strict=True)
            )
            inwards = [oracles.CUBE_EDGE_MIDPOINT * (1 - 2 * x) for x in middle]
            assert surface.evaluate(f, mu, mv).tolist() == [
                x + d for x, d in zip(middle, inwards, strict=True)
            ]
        middle = [sum(points[i][c] for i in face) / 4 for c in range(3)]
        inwards = [oracles.CUBE_FACE_CENTRE * (1 - 2 * x) for x in middle]
        assert surface.evaluate(f, HALF, 0.5).tolist() == [
            x + d for x, d in zip(middle, inwards, strict=True)
        ]
    assert surface.evaluate(0, F(0), 0).tolist() == [F(1, 4)] * 3
    assert surface.evaluate(0, HALF, HALF).tolist() == [F(13, 162), HALF, HALF]
    assert surface.evaluate(0, HALF, F(0)).tolist() == [F(253, 1296), F(253, 1296), HALF]


def test_derivatives_at_extraordinary_vertices():
    """Those that do not exist are NaN, those that vanish are 0, in both worlds."""
    for N in (2, 3, 5, 6, 33):
        points, faces = oracles.local_cage(N)
        exact = ls.LimitSurface(ls.Mesh(fractions(points), faces))
        floats = ls.LimitSurface(ls.Mesh(np.array(points, dtype=float), faces))
        for nu in ORDERS[1:]:
            vanishes = (sum(nu) == 1 and N < 4) or max(nu) > 3
            for values in (exact.evaluate(0, 0, 0, nu=nu), floats.evaluate(0, 0, 0, nu=nu)):
                if vanishes:
                    assert (values == 0).all()
                else:
                    assert all(math.isnan(x) for x in values)
            for W in (exact.weights(0, 0, 0, nu=nu), floats.weights(0, 0, 0, nu=nu)):
                assert np.isnan(W.toarray().astype(float)).any() != vanishes


def test_limit_faces():
    """Numbered as in Ptex: a quad is one, an n-gon n consecutive ones."""
    for make in zoo.ZOO.values():
        points, faces = make()
        numbering = ls.LimitSurface(ls.Mesh(points, faces)).limit_faces
        pairs = list(zip(numbering.face.tolist(), numbering.corner.tolist(), strict=True))
        assert pairs == oracles.limit_faces(faces)
        assert len(numbering) == len(pairs)
        assert numbering.first.tolist() == [
            pairs.index((f, -1 if len(face) == 4 else 0)) for f, face in enumerate(faces)
        ]


# --- Accuracy in float64


def largest_on_ring(oracle, face, u, v, order):
    """The largest derivative of a total order in the pieces as far from the vertex as (u, v)."""
    _, level, *_ = oracle._descend(face, u, v)
    up = max(level - 1, 0)
    corner = [max(0, math.ceil(F(x) * 2**up) - 1) for x in (u, v)]
    largest = F(0)
    for steps in itertools.product(range(5), repeat=2):
        s, t = ((c + F(k, 4)) / 2**up for c, k in zip(corner, steps, strict=True))
        _, there, _, _, irregular = oracle._descend(face, s, t)
        if irregular is None and there == level:
            for i in range(order + 1):
                derivative = oracle.evaluate(face, s, t, nu=(i, order - i))
                largest = max(largest, *map(abs, derivative))
    return largest


def accuracy(surface, oracle, queries, orders=LOW_ORDERS, floor=F(1, 1000)):
    """Errors of floats as parts of what the design allows, one for each query and order.

    A derivative may differ by 1e-12 of its size, or of `floor` times the largest on the ring.
    """
    face, u, v = columns(queries)
    jets = {nu: surface.evaluate(face, u, v, nu=nu).reshape(len(queries), -1) for nu in orders}
    # the oracle remembers its last walk, so one query after the other
    for (k, query), (nu, values) in itertools.product(enumerate(queries), jets.items()):
        exact = expected(oracle, query, nu)
        if any(x != x for x in exact):
            assert np.isnan(values[k]).all(), (query, nu)
            continue
        assert np.isfinite(values[k]).all(), (query, nu)
        errors = [abs(F(x) - y) for x, y in zip(values[k].tolist(), exact, strict=True)]
        if nu == (0, 0):
            cage = fractions([oracle.points[i] for i in oracle._neighbourhood(query[0])[1]])
            size = max(cage.max(axis=0) - cage.min(axis=0))
            allowed = [size / 10**14 + 2 * F(math.ulp(x)) for x in exact]
            yield max(float(e / a) for e, a in zip(errors, allowed, strict=True))
        else:
            size = max(map(abs, exact))
            if max(errors) > size / 10**12:
                size = max(size, floor * largest_on_ring(oracle, *query, order=sum(nu)))
            yield float(max(errors) / size * 10**12) if size else float(max(errors))


def float_queries(faces, n, rng):
    """Float queries towards every corner of the parameter square, down to 1e-12."""
    queries = []
    for k in range(n):
        scale = 10 ** rng.uniform(-12, 0)
        a, b = rng.random() * scale, rng.random() * scale
        if k % 6 == 5:
            a, b = rng.randrange(65) / 64, rng.randrange(65) / 64
        queries.append((rng.choice(faces), *at_corner(rng.randrange(4), a, b)))
    return queries


def random_cage(seed):
    """Valences 3 to 64, each in turn; every fourth cage is closed, of any faces and valences."""
    rng = random.Random(seed)
    if seed % 4 == 3:
        start = rng.choice([zoo.cube(), zoo.dodecahedron(), zoo.bipyramid(3 + seed % 20)])
        points, faces = zoo.carved(start, seed, 10)
        return zoo.random_points(len(points), seed), faces
    points, faces = oracles.local_cage(3 + seed % 62, seed, corner=seed // 3 % 4)
    return np.array(points, dtype=float), faces


def pytest_generate_tests(metafunc):
    if "seed_of_cage" in metafunc.fixturenames:
        metafunc.parametrize("seed_of_cage", range(metafunc.config.getoption("cages")))


def test_accuracy_on_random_cages(seed_of_cage):
    points, faces = random_cage(seed_of_cage)
    surface, oracle = both(points, faces)
    closed = not zoo.boundary_vertices(faces)
    target = range(len(surface.limit_faces)) if closed else [seed_of_cage % 3]
    queries = float_queries(target, 8, random.Random(seed_of_cage))
    assert max(accuracy(surface, oracle, queries)) <= 1


@on_the_zoo
def test_accuracy_on_the_zoo(name, mode):
    """All ways to cut a face, all boundaries.

    Second derivatives vanish across every boundary, and in places on cages as small as these.
    There, the rounding of a few additions is measured by 1e-2 of the largest on the ring.
    """
    surface, oracle = both(*shaken(name), mode=mode)
    queries = float_queries(range(len(surface.limit_faces)), 8, random.Random(name))
    assert max(accuracy(surface, oracle, queries, LOW_ORDERS[:6], floor=F(1, 100))) <= 1


@pytest.mark.parametrize("offset", [1e6, 1e9, 1e12, -123456.7])
@pytest.mark.parametrize("seed", [3, 9, 15, 47])
def test_accuracy_far_from_the_origin(offset, seed):
    points, faces = random_cage(seed)
    surface, oracle = both(points + offset * np.array([1, -0.5, 0.25]), faces)
    target = range(len(surface.limit_faces)) if seed % 4 == 3 else [0]
    queries = float_queries(target, 12, random.Random(seed))
    assert max(accuracy(surface, oracle, queries)) <= 1
    for query in queries[:4]:
        assert distance(surface.normal(*query), oracle.normal(*query)) <= 1e-12


@pytest.mark.parametrize("scale", [1e-200, 1e200])
@pytest.mark.parametrize("seed", [3, 9, 15, 47])
def test_accuracy_at_any_scale(scale, seed):
    points, faces = random_cage(seed)
    surface, oracle = both(points * scale, faces)
    target = range(len(surface.limit_faces)) if seed % 4 == 3 else [0]
    queries = float_queries(target, 12, random.Random(seed))
    assert max(accuracy(surface, oracle, queries)) <= 1
    for query in queries[:4]:
        assert distance(surface.normal(*query), oracle.normal(*query)) <= 1e-12


def test_local_differences_set_the_error():
    """A vertex far away does not cost the digits of faces that it does not touch."""
    points, faces = zoo.disjoint(zoo.carved(zoo.cube(), 1), zoo.cube())
    points[-8:] *= 1e9
    surface, oracle = both(points, faces)
    queries = float_queries(range(40), 12, random.Random(1))
    assert max(accuracy(surface, oracle, queries, [(0, 0), (1, 0), (0, 1)], floor=F(1, 10))) <= 1


@pytest.mark.parametrize("shape", [(), (1,), (2,), (3,), (2, 2), (5, 1, 2)])
def test_any_channels(shape):
    points, faces = zoo.carved(zoo.cube(), 2)
    n = len(points)
    data = np.random.default_rng(1).integers(-256, 256, (n, *shape)) / 256
    surface, oracle = both(data, faces)
    assert surface.points.shape == (n, *shape)
    oracle.points = data.reshape(n, -1)
    queries = float_queries(range(len(surface.limit_faces)), 6, random.Random(2))
    assert max(accuracy(surface, oracle, queries, LOW_ORDERS[:4])) <= 1
    face, u, v = columns(queries)
    assert surface.evaluate(face, u, v).shape == (6, *shape)
    assert surface.evaluate(0, 0.25, 0.5, nu=(1, 0)).shape == shape
    exact = surface.evaluate(face, fractions(u), v)
    assert exact.shape == (6, *shape)
    assert same(exact.reshape(6, -1), [oracle.evaluate(*query) for query in queries])
    tangent, _ = surface.tangents(face, u, v)
    assert tangent.shape == (6, *shape)


def test_no_channels():
    surface = ls.LimitSurface(ls.Mesh(np.zeros((8, 0)), zoo.cube()[1]))
    assert surface.evaluate([0, 1], 0.3, 0.2).shape == (2, 0)
    assert surface.evaluate(0, F(1, 3), 0.2, nu=(1, 0)).shape == (0,)
    assert surface.weights(0, 0.3, 0.2).shape == (1, 8)


@pytest.mark.parametrize("N", [3, 5, 12])
def test_beyond_the_range_of_floats(N):
    """What floats cannot hold is infinite or 0, silently; directions are right all the same."""
    points, faces = oracles.local_cage(N, seed=7)
    surface, oracle = both(np.array(points, dtype=float), faces)
    limit = F(np.finfo(float).max)
    for query in ((0, 1e-300, 3e-301), (1, 5e-324, 0.0), (2, 2e-308, 1e-312)):
        for nu in LOW_ORDERS:
            values, exact = surface.evaluate(*query, nu=nu).tolist(), oracle.evaluate(*query, nu=nu)
            size = max(map(abs, exact))
            for x, y in zip(values, exact, strict=True):
                if abs(y) > limit:
                    assert x == (math.inf if y > 0 else -math.inf)
                else:
                    assert abs(F(x) - y) <= size / 10**12 + F(1, 10**320)
        assert distance(surface.normal(*query), oracle.normal(*query)) <= 1e-12


def test_powers_of_eigenvalues():
    """Good to an ulp or two at any depth, because an eigenvalue is a sum of two floats."""
    n = np.array([0, 1, 2, 39, 400, 1022, 1074])
    for value in (mpmath.mpf(1) / 3, mpmath.sqrt(mpmath.mpf(3)) / 2, -mpmath.sqrt(2) / 4):
        high = float(value)
        with mpmath.workdps(40):
            value = value + mpmath.mpf(10) ** -17 / 7
            low = float(value - high)
            powers = kernels.power(np.array([high]), np.array([low]), n)[:, 0]
            mantissa, exponent = kernels.scaled_power(high, low, n)
            for k, m in enumerate(n.tolist()):
                exact = value**m
                if abs(exact) > 1e-300:
                    assert abs(powers[k] / exact - 1) < 5e-16
                assert abs(mpmath.ldexp(mantissa[k], int(exponent[k])) / exact - 1) < 5e-16


cases = oracles.reference_cases() or {}


@pytest.mark.skipif(not cases, reason="the reference numbers are not part of the package")
@pytest.mark.parametrize("N", [3, 5, 8, 16])
def test_reference_cases(N):
    """Numbers of another program: 60-digit refinement, rounded."""
    case = cases[N]
    surface, oracle = both(case.points, case.faces)
    u, v = case.uv.T
    cage = case.points[oracle._neighbourhood(case.face)[1]]
    allowed = 1e-14 * np.ptp(cage, axis=0).max() + 2 * np.spacing(np.abs(case.P))
    assert (np.abs(surface.evaluate(case.face, u, v) - case.P) <= allowed).all()
    for nu, derivative in (((1, 0), case.Pu), ((0, 1), case.Pv)):
        error = np.abs(surface.evaluate(case.face, u, v, nu=nu) - derivative).max(axis=1)
        assert (error <= 1e-12 * np.abs(derivative).max(axis=1)).all()
    queries = [(case.face, *uv) for uv in case.uv[::7]]
    assert max(accuracy(surface, oracle, queries)) <= 1


@pytest.mark.parametrize("periodic", list(itertools.product((False, True), repeat=2)))
def test_regular_faces_are_scipy_splines(periodic):
    n, m = 5, 6
    rng = np.random.default_rng(7)
    grid = rng.normal(size=(n, m, 2))
    faces = oracles.grid_faces(n, m, periodic)
    rows = m if periodic[1] else m - 1
    surface = ls.LimitSurface(ls.Mesh(grid.reshape(-1, 2), faces))
    inner = np.vstack([rng.random((20, 2)), [[0, 0], [1, 0.25], [1, 1], [0.5, 0.5], [1e-12, 0]]])
    face, query = (x.ravel() for x in np.indices((len(faces), len(inner))))
    u, v = inner[query].T
    for nu in ORDERS:
        spline = oracles.bspline_oracle(grid, *np.divmod(face, rows), u, v, nu, periodic)
        error = np.abs(surface.evaluate(face, u, v, nu=nu) - spline).max()
        assert error <= 1e-14 * 6 ** sum(nu)


def test_an_open_grid_is_linear():
    """A flat grid with unit spacing has the limit (i + u, j + v), right up to its corners."""
    faces = oracles.grid_faces(4, 5)
    points = fractions([(i, j) for i in range(4) for j in range(5)])
    surface = ls.LimitSurface(ls.Mesh(points, faces))
    for f, (i, j) in enumerate(itertools.product(range(3), range(4))):
        for u, v in ((F(0), F(0)), (F(1), F(1)), (F(1, 3), F(7, 9))):
            assert surface.evaluate(f, u, v).tolist() == [i + u, j + v]
            assert surface.evaluate(f, u, v, nu=(1, 0)).tolist() == [1, 0]
            assert surface.evaluate(f, u, v, nu=(1, 1)).tolist() == [0, 0]


@pytest.mark.skipif(not SHARED_CAGES.is_dir(), reason="these cages are not part of the package")
@pytest.mark.parametrize(
    "name",
    ["spot_control_mesh", "gismo_bitorus", "gismo_polycube", "gismo_mushroom", "catmark_pole64"],
)
def test_real_cages(name):
    """The surface at dyadic parameters is the refined cage, moved to its limit."""
    mesh = ls.read(SHARED_CAGES / f"{name}.obj")
    surface = ls.LimitSurface(mesh)
    size = np.ptp(mesh.points, axis=0).max()
    faces = mesh.faces.tolist()
    levels = 1 if mesh.n_faces > 1000 else 2
    points, children = oracles.refine_times(mesh.points.tolist(), faces, levels)
    limits = np.array(oracles.limit_positions(points, children))
    parameters = oracles.refined_parameters(faces, levels)
    u, v = np.moveaxis(np.array([corners for _, corners in parameters], dtype=float), -1, 0)
    values = surface.evaluate(np.array([[face] for face, _ in parameters]), u, v)
    assert np.abs(values - limits[np.array(children)]).max() <= 1e-14 * size

    fine = ls.refined(mesh, 3)
    values = surface.evaluate(fine.parent_face, fine.parent_u, fine.parent_v)
    assert np.abs(values - fine.limit_points).max() <= 1e-14 * size
    table = ls.validate(surface, 2)
    assert (table["limit_error"] <= 1e-14 * size).all()


# --- Normals and tangents


def distance(a, b):
    """Between vectors of floats or mpf, without rounding; a NaN makes it NaN."""
    with mpmath.workdps(40):
        return float(mpmath.norm([mpmath.mpf(x) - y for x, y in zip(a, b, strict=True)]))


DIRECTIONS = [(1, 0), (0, 1), (1, 1), (1, 0.375), (0.2, 1), (1, 1e-8), (0.77, 0.69)]


@pytest.mark.parametrize("N", POLES)
@pytest.mark.parametrize("reach", [1e-3, 1e-12, 1e-100, 1e-300])
def test_normals_next_to_a_pole(N, reach):
    """The exact normal at that very (u, v), which is not yet the pole's."""
    surface, oracle = both(*floats_of(oracles.local_cage(N, seed=N)))
    pole = oracle.normal(0, 0, 0)
    assert distance(surface.normal(0, 0, 0), pole) <= 1e-12
    queries = [(0, a * reach, b * reach) for a, b in DIRECTIONS]
    u_then_v = surface.tangents(*columns(queries))
    normals = surface.normal(*columns(queries))
    gaps = []
    for k, query in enumerate(queries):
        exact = oracle.normal(*query)
        assert distance(normals[k], exact) <= 1e-12
        gaps.append(distance(pole, exact))
        for tangents, along in zip(u_then_v, oracle.tangents(*query), strict=True):
            assert distance(tangents[k], along) <= 1e-12
    # so that answering with the pole's normal would have failed above; N = 3 gets there soonest
    if reach == 1e-3 or (reach == 1e-12 and N > 3) or N == 33:
        assert min(gaps) > 1e-10


def floats_of(points_and_faces):
    points, faces = points_and_faces
    return np.array(points, dtype=float), faces


@pytest.mark.parametrize("N", POLES)
@pytest.mark.parametrize("corner", range(4))
def test_normals_at_any_corner(N, corner):
    """The pole at each corner of its face, on its edges and off them, and with 1e-12 and 1e-300."""
    surface, oracle = both(*floats_of(oracles.local_cage(N, 1, corner)))
    near = [(1e-12, 3e-13), (2e-16, 1e-12), (0.0, 1e-12), (1e-3, 1e-3)]
    queries = [(face, *at_corner(corner, a, b)) for face, (a, b) in enumerate(near[:3])]
    u, v = at_corner(corner, 0.0, 0.0)
    tiny = 1e-300
    queries += [(0, u, v), (0, u or tiny, v), (0, u, v or tiny), (1, u or 1e-12, v or tiny)]
    for query in queries:
        assert distance(surface.normal(*query), oracle.normal(*query)) <= 1e-12
        pairs = zip(surface.tangents(*query), oracle.tangents(*query), strict=True)
        assert all(distance(*pair) <= 1e-12 for pair in pairs)


@pytest.mark.parametrize("N", POLES)
def test_normals_at_a_pole_by_published_masks(N):
    """Halstead, Kass and DeRose's tangent masks, applied to the ring by hand."""
    points, faces = floats_of(oracles.local_cage(N, seed=5))
    surface = ls.LimitSurface(ls.Mesh(points, faces))
    relative = points - points[0]
    edges, diagonals = [face[1] for face in faces[:N]], [face[2] for face in faces[:N]]
    masks = oracles.tangent_masks(N)
    first, second = (
        np.array(e, float) @ relative[edges] + np.array(d, float) @ relative[diagonals]
        for e, d in masks
    )
    normal = np.cross(first, second)
    normal /= np.linalg.norm(normal)
    assert np.abs(surface.normal(range(N), 0, 0) - normal).max() <= 1e-12
    along_u, along_v = surface.tangents(0, 0, 0)
    assert np.abs(along_u - first / np.linalg.norm(first)).max() <= 1e-12
    angle = 2 * np.pi / N
    back = np.cos(angle) * first + np.sin(angle) * second
    assert np.abs(along_v - back / np.linalg.norm(back)).max() <= 1e-12


@on_the_zoo
def test_normals_on_the_zoo(name, mode):
    surface, oracle = both(*shaken(name), mode=mode)
    rng = random.Random(name)
    faces = rng.choices(range(len(surface.limit_faces)), k=8)
    near = [(0.0, 0.0), (0.3, 0.7), (1e-12, 1e-13), (0.0, 1e-9)]
    queries = [(f, *at_corner(k % 4, *near[k // 2])) for k, f in enumerate(faces)]
    queries += [(faces[0], 1e-300, 2e-300), (faces[1], 0.0, 1e-100)]
    normals, tangents = surface.normal(*columns(queries)), surface.tangents(*columns(queries))
    for k, query in enumerate(queries):
        exact = [oracle.normal(*query), *oracle.tangents(*query)]
        sizes = [max(map(abs, oracle.evaluate(*query, nu=nu))) for nu in ((1, 0), (0, 1))]
        if query[1:] not in oracles.CORNERS and min(sizes) * 10**6 <= max(sizes):
            assert "pillow" in name  # its sheets meet at a fold, where one derivative vanishes
            continue
        for value, truth in zip([normals[k], tangents[0][k], tangents[1][k]], exact, strict=True):
            if any(map(mpmath.isnan, truth)):
                assert np.isnan(value).all()
            else:
                assert distance(value, truth) <= 1e-12


def test_valence_two_has_no_normal_at_the_vertex():
    surface, oracle = both(*floats_of(oracles.local_cage(2)))
    assert np.isnan(surface.normal(0, 0, 0)).all()
    assert np.isnan(surface.tangents(0, 0, 0)).all()
    for query in ((0, 1e-300, 1e-300), (1, 0.0, 1e-12), (0, 0.4, 0.5)):
        assert distance(surface.normal(*query), oracle.normal(*query)) <= 1e-12


def test_normals_need_space_and_roots():
    points, faces = zoo.cube()
    with pytest.raises(ValueError, match=r"shape \(n, 3\), got \(8, 2\)"):
        ls.LimitSurface(ls.Mesh(points[:, :2], faces)).normal(0, 0.5, 0.5)
    surface = ls.LimitSurface(ls.Mesh(points, faces))
    exact = surface.with_points(fractions(points))
    for call in (surface.normal, surface.tangents):
        with pytest.raises(TypeError, match="square roots, which exact numbers do not have"):
            call(0, F(1, 2), 0.5)
    for call in (exact.normal, exact.tangents):
        with pytest.raises(TypeError, match="square roots, which exact numbers do not have"):
            call(0, 0.5, 0.5)


def test_degenerate_normals_are_nan():
    points, faces = zoo.grid(3, 3)
    flat = ls.LimitSurface(ls.Mesh(points * 0 + 1.5, faces))
    assert np.isnan(flat.normal([0, 4], 0.3, [0.2, 0.4])).all()
    assert np.isnan(flat.tangents(0, 0.3, 0.4)).all()
    assert (flat.evaluate([0, 4], 0.3, 0.2) == 1.5).all()
    line = ls.LimitSurface(ls.Mesh(points * [1, 0, 0], faces))
    assert np.isnan(line.normal(4, 0.3, 0.4)).all()
    assert line.tangents(4, 0.3, 0.4)[0].tolist() == [1, 0, 0]


def test_normals_point_outwards():
    for name in ("cube", "octahedron", "dodecahedron", "trapezohedron_5", "prism_12"):
        points, faces = zoo.ZOO[name]()
        points = points - points.mean(axis=0)
        surface = ls.LimitSurface(ls.Mesh(points, faces))
        face = np.arange(len(surface.limit_faces))[:, None]
        u, v = np.random.default_rng(2).random((2, 6))
        outwards = surface.normal(face, u, v) * surface.evaluate(face, u, v)
        assert (outwards.sum(axis=-1) > 0).all()
        assert np.abs(np.linalg.norm(surface.normal(face, u, v), axis=-1) - 1).max() < 4e-16


# --- Weights


@on_the_zoo
def test_exact_weights_on_the_zoo(name, mode):
    """The oracle's rows exactly, which sum to one, or to zero for a derivative."""
    rng = random.Random(name)
    points, faces = shaken(name)
    surface = ls.LimitSurface(ls.Mesh(points, faces), boundary=mode)
    queries = exact_queries(surface, 6, rng)
    for nu in [(0, 0), *rng.sample(ORDERS[1:-2], 2)]:
        W = surface.weights(*columns(queries), nu=nu)
        assert isinstance(W, ls.ExactOperator)
        assert W.shape == (len(queries), len(points))
        oracle = ORACLES["catmull-clark"](None, faces, mode)
        for k, query in enumerate(queries):
            row = slice(W.indptr[k], W.indptr[k + 1])
            weights = dict(zip(W.columns[row].tolist(), W.values[row], strict=True))
            exact = oracle.weights(*query, nu=nu)
            if exact is None:
                assert any(w != w for w in weights.values())
                continue
            assert {i: w for i, w in weights.items() if w} == {i: w for i, w in exact.items() if w}
            assert sum(weights.values()) == (nu == (0, 0))
        value = surface.evaluate(*columns(queries), nu=nu)
        assert same(W @ points, value)


@on_the_zoo
def test_weights_on_the_zoo(name, mode):
    """Weights times points is the value; they reproduce constants, also when differentiated."""
    points, faces = shaken(name)
    surface = ls.LimitSurface(ls.Mesh(points, faces), boundary=mode)
    face, u, v = columns(float_queries(range(len(surface.limit_faces)), 12, random.Random(name)))
    for nu in LOW_ORDERS:
        W = surface.weights(face, u, v, nu=nu)
        assert W.shape == (12, len(points))
        assert W.has_sorted_indices
        values, undefined = surface.evaluate(face, u, v, nu=nu), np.isnan((W @ points)[:, 0])
        assert (np.isnan(values[:, 0]) == undefined).all()
        scale = np.maximum(1, np.abs(W).sum(axis=1))  # some derivatives vanish for all points
        error = np.abs(W @ points - values).max(axis=1)
        assert (error <= 1e-13 * scale)[~undefined].all()
        total = W.sum(axis=1) - (nu == (0, 0))
        assert (np.abs(total) <= 1e-13 * scale)[~undefined].all()


def test_weights_of_any_shape():
    """Rows are queries in C order; where there is no value they are NaN, and only there."""
    points, faces = zoo.cube()
    surface = ls.LimitSurface(ls.Mesh(points, faces, holes=[4]))
    face, u = np.array([[0], [3], [4]]), np.array([0.25, np.nan, 0.5, 0.0])
    W = surface.weights(face, u, 0.75)
    values = surface.evaluate(face, u, 0.75)
    assert W.shape == (12, 8)
    assert np.allclose(
        (W @ points).reshape(values.shape), values, rtol=0, atol=1e-15, equal_nan=True
    )
    assert np.isnan(values).sum() == 3 * 6
    assert surface.weights(0, 0.5, 0.5).shape == (1, 8)
    assert surface.weights([], [], []).shape == (0, 8)
    exact = surface.weights(face, fractions([F(1, 4), F(0)]), F(3, 4))
    assert exact.shape == (6, 8)
    assert np.isnan(exact.toarray()[4:].astype(float)).any(axis=1).all()


# --- The call


def shuffled_surface():
    points, faces = zoo.carved(zoo.cube(), 1)
    return ls.LimitSurface(ls.Mesh(zoo.random_points(len(points), 1), faces))


@pytest.mark.parametrize(
    ("face", "u", "v"),
    [
        ((), (), ()),
        ((3,), (), ()),
        ((), (4,), ()),
        ((2, 1), (3,), ()),
        ((1, 5), (4, 1), (2, 4, 1)),
        ((0,), (), ()),
        ((3, 0), (3, 1), ()),
    ],
)
@pytest.mark.parametrize("exact", [False, True])
def test_queries_broadcast(face, u, v, exact):
    """Shapes broadcast; every element is what it is alone."""
    surface = shuffled_surface()
    rng = np.random.default_rng(5)
    face = rng.integers(0, len(surface.limit_faces), face)
    u, v = rng.integers(0, 17, u) / 16, rng.integers(0, 17, v) / 16
    if exact:
        u = fractions(u)
    shape = np.broadcast(face, u, v).shape
    values = surface.evaluate(face, u, v)
    assert values.shape == (*shape, 3)
    assert values.dtype == (object if exact else float)
    calls = [lambda *q: surface.evaluate(*q, nu=(1, 1)), lambda *q: surface.jet(*q, order=1)[1, 0]]
    if not exact:
        calls += [surface.normal, lambda *q: surface.tangents(*q)[1]]
    for call in [surface.evaluate, *calls]:
        values = call(face, u, v)
        assert values.shape == (*shape, 3)
        each = np.broadcast_arrays(face, u, v)
        for place in np.ndindex(shape):
            alone = call(*(x[place] for x in each)).astype(float)
            assert np.allclose(values[place].astype(float), alone, 1e-13, 1e-13, equal_nan=True)


def test_scalar_points_and_queries_give_scalars():
    surface = ls.LimitSurface(ls.Mesh([0, 1, 1, 0], [[0, 1, 2, 3]]))
    assert surface.evaluate(0, 0.25, 0.5).shape == ()
    assert surface.evaluate(0, 0.25, 0.5) == 0.25
    assert surface.evaluate(0, F(1, 3), 0.5) == F(1, 3)
    assert surface.evaluate([0, 0], 0.25, 0.5).shape == (2,)


def test_number_types_of_parameters():
    surface = shuffled_surface()
    assert (surface.evaluate(1, 1, 0) == surface.evaluate(1, 1.0, 0.0)).all()
    assert (surface.evaluate(np.uint8(1), True + 0, np.int32(0)) == surface.evaluate(1, 1, 0)).all()
    u, v = np.float32(0.1), np.float32(0.7)
    assert (surface.evaluate(1, u, v) == surface.evaluate(1, float(u), float(v))).all()
    assert surface.evaluate(1, np.float16(0.5), v).dtype == float
    assert (surface.evaluate(1, -0.0, 0.5) == surface.evaluate(1, 0.0, 0.5)).all()
    assert (surface.evaluate([1], [0.5], (0.25,)) == surface.evaluate(1, 0.5, 0.25)).all()


def test_layout_of_arrays_does_not_matter():
    """Strided, reversed, transposed, read-only arrays; none is written to."""
    surface = shuffled_surface()
    rng = np.random.default_rng(0)
    face, (u, v) = rng.integers(0, 40, (6, 4)), rng.random((2, 6, 4))
    expected_values = surface.evaluate(face.copy(), u.copy(), v.copy())
    wide = np.full((6, 8), 0.5)
    wide[:, ::2] = u
    backwards = np.ascontiguousarray(v[::-1])[::-1]
    columnwise = np.asfortranarray(face)
    for array in (wide, backwards, columnwise):
        array.flags.writeable = False
    for dtype in (np.int64, np.int16, np.uint64):
        values = surface.evaluate(columnwise.astype(dtype), wide[:, ::2], backwards)
        assert (values == expected_values).all()
    values = surface.evaluate(face.T, u.T, v.T)
    assert np.allclose(values, expected_values.transpose(1, 0, 2), rtol=1e-14, atol=1e-14)
    before = u.copy()
    for _ in (surface.normal(face, u, v), surface.weights(face, u, v), surface.jet(face, u, v)):
        assert (u == before).all()
    written = surface.evaluate(face, u, v)
    written[:] = 0
    assert (surface.evaluate(face, u, v) == expected_values).all()


@pytest.mark.parametrize("empty", [[], np.zeros(0), np.zeros((3, 0)), np.zeros(0, dtype=object)])
def test_no_queries(empty):
    surface = shuffled_surface()
    shape = (*np.shape(empty), 3)
    assert surface.evaluate(np.zeros(0, dtype=int), empty, empty).shape == shape
    assert surface.evaluate([], empty, 0.5).shape == shape
    assert surface.jet(0, empty, 0.5)[1, 1].shape == shape
    assert surface.weights(0, 0.5, empty).shape == (0, surface.mesh.n_vertices)
    if np.asarray(empty).dtype != object:
        assert surface.normal(0, empty, empty).shape == shape
        assert surface.tangents(0, empty, 0.5)[0].shape == shape


@pytest.mark.parametrize("name", ["cube", "grid_3x3", "carved_cylinder", "local_cage_12"])
@pytest.mark.parametrize("exact", [False, True])
def test_jets_are_derivatives(name, exact):
    points, faces = shaken(name)
    surface = ls.LimitSurface(ls.Mesh(points, faces))
    rng = random.Random(4)
    face, u, v = columns(float_queries(range(len(surface.limit_faces)), 12, rng))
    u[0] = v[0] = 0.0
    if exact:
        u = fractions(u)
    for order in (0, 1, 2, 4):
        jet = surface.jet(face, u, v, order=order)
        assert sorted(jet) == [(i, j) for i in range(order + 1) for j in range(order + 1 - i)]
        for nu, values in jet.items():
            alone = surface.evaluate(face, u, v, nu=nu)
            if exact:
                assert same(values, alone)
            else:
                scale = np.abs(surface.weights(face, u, v, nu=nu)).sum(axis=1)[:, None]
                assert (np.isnan(values) == np.isnan(alone)).all()
                assert not (np.abs(values - alone) > 1e-14 * scale).any()
    assert sorted(surface.jet(0, 0.5, 0.5)) == sorted(LOW_ORDERS[:6])


def test_many_queries_at_once():
    """More than fit in one go, in one patch or all over, are what they are in small portions."""
    points, faces = zoo.flower(16)
    surface = ls.LimitSurface(ls.Mesh(zoo.random_points(len(points), 2), faces))
    rng = np.random.default_rng(8)
    n = 70_000
    u, v = rng.random((2, n)) ** 4
    face = rng.integers(0, len(faces), n)
    face[: n // 2] = 0
    picked = rng.integers(0, n, 50)
    few = face[picked], u[picked], v[picked]
    for call in (surface.evaluate, surface.normal):
        assert np.allclose(call(face, u, v)[picked], call(*few), rtol=1e-13, atol=1e-14)
    W = surface.weights(face, u, v)
    assert W.shape == (n, len(points))
    assert np.abs(W[picked] - surface.weights(*few)).max() < 1e-14


def test_undefined_elements_are_nan_and_others_are_not():
    surface = shuffled_surface()
    u = np.array([0.5, np.nan, np.inf, -np.inf, 0.25, 0.0])
    v = np.array([0.5, 0.5, 0.5, 0.5, np.nan, 1.0])
    bad = [False, True, True, True, True, False]
    for call in (surface.evaluate, surface.normal, lambda *q: surface.jet(*q)[0, 1]):
        assert np.isnan(call(2, u, v)).all(axis=1).tolist() == bad
        assert np.isnan(call(2, u, v)).any(axis=1).tolist() == bad
    exact = surface.evaluate(2, u.astype(object), v)
    assert [all(x != x for x in row) for row in exact] == bad
    assert same(exact[[0, 5]], surface.evaluate(2, fractions(u[[0, 5]]), v[[0, 5]]))
    assert np.isnan(surface.evaluate(2, np.nan, np.nan)).all()


def test_holes_have_no_limit_and_shape_their_neighbours():
    points, faces = shaken("carved_cube_1")
    whole = ls.LimitSurface(ls.Mesh(points, faces))
    holes = [1, 4]
    surface = ls.LimitSurface(ls.Mesh(points, faces, holes=holes))
    face = np.arange(len(whole.limit_faces))
    gone = np.isin(whole.limit_faces.face, holes)
    assert gone.any()
    assert not gone.all()
    for exact in (False, True):
        u, v = (F(1, 3), 0.5) if exact else (0.3, 0.7)
        values, complete = surface.evaluate(face, u, v), whole.evaluate(face, u, v)
        assert all(x != x for x in values[gone].ravel())
        assert np.abs(values - complete)[~gone].max() <= (0 if exact else 1e-15)
    assert np.isnan(surface.normal(face, 0.3, 0.7)).any(axis=1).tolist() == gone.tolist()
    assert dict(surface.patches.summary())["no limit (holes)"] == gone.sum()
    nothing = ls.LimitSurface(ls.Mesh(points, faces, holes=range(len(faces))))
    assert np.isnan(nothing.evaluate(face, 0.5, 0.5)).all()
    assert nothing.weights(face, 0.5, 0.5).shape == (len(face), len(points))


@pytest.mark.parametrize(
    "name", ["grid_3x3", "stairs", "half_disk_5", "carved_grid", "flower_5_wide"]
)
def test_no_limit_at_a_boundary_if_it_is_none(name):
    """Under boundary="none" faces with a boundary vertex are like holes; others do not notice."""
    points, faces = shaken(name)
    surface = ls.LimitSurface(ls.Mesh(points, faces), boundary="none")
    rim = zoo.boundary_vertices(faces)
    touching = [any(v in rim for v in face) for face in faces]
    face = np.arange(len(surface.limit_faces))
    values = surface.evaluate(face, 0.3, 0.7)
    assert np.isnan(values).any(axis=1).tolist() == [touching[f] for f in surface.limit_faces.face]
    whole = ls.LimitSurface(ls.Mesh(points, faces)).evaluate(face, 0.3, 0.7)
    defined = ~np.isnan(values)
    assert np.abs(values - whole)[defined].max(initial=0) <= 1e-15


def test_with_points():
    """Another surface on the same cage, in either world; the first one stays as it is."""
    points, faces = shaken("carved_dodecahedron")
    surface = ls.LimitSurface(ls.Mesh(points, faces))
    third = F(1, 3)
    before = surface.evaluate(3, 0.3, 0.7), surface.evaluate(3, third, 0.7)
    other = surface.with_points(points[::-1])
    fresh = ls.LimitSurface(ls.Mesh(points[::-1], faces))
    assert other.patches is surface.patches
    for changed in (other, surface.with_points(points * 0).with_points(points[::-1])):
        assert (changed.evaluate(3, 0.3, 0.7) == fresh.evaluate(3, 0.3, 0.7)).all()
        assert same([changed.evaluate(3, third, 0.7)], [fresh.evaluate(3, third, 0.7)])
        assert (changed.normal(3, 0.3, 0.7) == fresh.normal(3, 0.3, 0.7)).all()
        assert (changed.points == points[::-1]).all()
    assert (surface.evaluate(3, 0.3, 0.7) == before[0]).all()
    assert same([surface.evaluate(3, third, 0.7)], [before[1]])
    assert surface.with_points(points[:, 0]).evaluate(3, 0.3, 0.7).shape == ()
    exact = surface.with_points(fractions(points, 3))
    assert same([exact.evaluate(3, 0.5, 0.25) * 3], [surface.evaluate(3, HALF, 0.25)])
    with pytest.raises(ls.MeshError, match="5 points"):
        surface.with_points(points[:5])


def test_faces_out_of_range():
    surface = ls.LimitSurface(ls.Mesh(*zoo.cube()))
    for call in (surface.evaluate, surface.normal, surface.tangents, surface.weights, surface.jet):
        with pytest.raises(IndexError, match=r"limit face 6 .* 6, 0 to 5"):
            call(6, 0.5, 0.5)
        with pytest.raises(IndexError, match=r"limit face -1 at index 1 \(1 more"):
            call([0, -1, 77], 0.5, 0.5)
        with pytest.raises(IndexError, match=r"limit face 9 at index 1, 0"):
            call([[0, 1], [9, 2]], F(1, 2), 0.5)


def test_parameters_out_of_the_square():
    surface = ls.LimitSurface(ls.Mesh(*zoo.cube()))
    for call in (surface.evaluate, surface.normal, surface.weights, surface.jet):
        with pytest.raises(ValueError, match=r"u = 1\.5 at index 1 is outside \[0, 1\]"):
            call(0, [0.5, 1.5], 0.5)
        with pytest.raises(ValueError, match=r"v = -1e-300 is outside \[0, 1\]"):
            call(0, 0.5, -1e-300)
        with pytest.raises(ValueError, match=r"v = 1\.0000000000000002 at index 0, 2 \(1 more"):
            call(0, np.nan, [[0.5, 1, 1 + 2**-52], [2, 1, np.inf]])
    with pytest.raises(ValueError, match=r"u = 3/2 at index 1 is outside \[0, 1\]"):
        surface.evaluate(0, [F(1, 2), F(3, 2)], 0)


@pytest.mark.parametrize("nu", [1.0, (1,), (1, 0, 0), (-1, 0), (0.5, 0), "10", None, (True, 0)])
def test_order_of_a_derivative(nu):
    surface = ls.LimitSurface(ls.Mesh(*zoo.cube()))
    for call in (surface.evaluate, surface.weights):
        with pytest.raises(ValueError, match="nu must be two integers >= 0, got"):
            call(0, 0.5, 0.5, nu=nu)
    with pytest.raises(ValueError, match="order must be an integer >= 0, got"):
        surface.jet(0, 0.5, 0.5, order=nu)


def test_what_is_no_query():
    surface = ls.LimitSurface(ls.Mesh(*zoo.cube()))
    with pytest.raises(TypeError, match="faces must be integers, got float64"):
        surface.evaluate(0.0, 0.5, 0.5)
    with pytest.raises(TypeError, match="u must be real numbers, got complex"):
        surface.evaluate(0, 0.5j, 0.5)
    with pytest.raises(TypeError, match="v must be real numbers, got <U"):
        surface.evaluate(0, 0.5, "0.5")
    with pytest.raises(TypeError, match="str"):
        surface.evaluate(0, F(1, 2), "0.5")
    with pytest.raises(ValueError, match=r"shapes \(2,\), \(3,\) and \(\) cannot be broadcast"):
        surface.evaluate([0, 1], [0.1, 0.2, 0.3], 0.5)


# --- The constructor


def cube_with(**tags):
    return ls.Mesh(*zoo.cube(), **tags)


def test_tags_of_no_effect():
    plain = ls.LimitSurface(cube_with()).evaluate(2, 0.3, 0.7)
    for mesh in (
        cube_with(creases={(0, 1): 0}, corners={3: 0.0}),
        cube_with(triangles="smooth"),
        cube_with(boundary="edge_only"),
    ):
        assert (ls.LimitSurface(mesh).evaluate(2, 0.3, 0.7) == plain).all()
    assert (ls.LimitSurface(cube_with(), creasing="chaikin").evaluate(2, 0.3, 0.7) == plain).all()


def test_holes_at_an_irregular_boundary():
    """At the boundary vertex of three faces; with or without a limit of their own, others agree."""
    points, faces = zoo.grid(4, 4)
    faces = faces[1:]  # vertex 6 loses a face
    holes = [f for f, face in enumerate(faces) if 6 in face]
    assert len(holes) == 3
    whole = ls.LimitSurface(ls.Mesh(points, faces))
    surface = ls.LimitSurface(ls.Mesh(points, faces, holes=holes))
    values = surface.evaluate(range(len(faces)), 0.25, 0.5)
    assert np.flatnonzero(np.isnan(values[:, 0])).tolist() == holes
    oracle = oracles.ExactSurface(points, faces)
    for f in range(len(faces)):
        exact = oracle.evaluate(f, F(1, 4), HALF)
        assert same([whole.evaluate(f, F(1, 4), HALF)], [exact])
        if f not in holes:
            assert np.abs(values[f] - np.array(exact, dtype=float)).max() < 1e-14


def test_options():
    """The argument, else the mesh's, else the default."""
    points, faces = zoo.cylinder(5, 2)
    points, faces = zoo.disjoint((points, faces), zoo.grid(2, 2))
    last = len(faces) - 1
    for mesh, options, at_corner_of_grid in (
        (ls.Mesh(points, faces), {}, True),
        (ls.Mesh(points, faces, boundary="none"), {}, None),
        (ls.Mesh(points, faces, boundary="none"), {"boundary": "edge_and_corner"}, True),
        (ls.Mesh(points, faces, boundary="edge_and_corner"), {"boundary": "none"}, None),
    ):
        value = ls.LimitSurface(mesh, **options).evaluate(last, 1, 1)
        if at_corner_of_grid:
            assert (value == points[faces[last][2]]).all()
        else:
            assert np.isnan(value).all()
    for option in ("boundary", "creasing", "triangles"):
        with pytest.raises(ValueError, match=f"{option} must be one of .*, got 'odd'"):
            ls.LimitSurface(ls.Mesh(points, faces), **{option: "odd"})
    with pytest.raises(ValueError, match="unknown scheme 'odd'; known: catmull-clark"):
        ls.LimitSurface(ls.Mesh(points, faces), scheme="odd")
    scheme = tables.SCHEMES["catmull-clark"]
    for mesh in (ls.Mesh(points, faces, scheme="catmull-clark"), ls.Mesh(points, faces)):
        assert (ls.LimitSurface(mesh, scheme=scheme).evaluate(last, 1, 1) == points[-1]).all()


@pytest.mark.filterwarnings("ignore:.* has no tangent plane")
@pytest.mark.parametrize("own", [F(1, 2), F(1), F(0), F(-1, 2)])
@pytest.mark.parametrize("N", [2, 3, 5, 8])
def test_a_scheme_of_ones_own(own, N):
    """Any vertex mask at valence != 4: floats are near Fractions, which refinement confirms."""

    def vertex(valence):
        share = (1 - own) / (2 * valence)
        return true.vertex(4) if valence == 4 else (own, share, share)

    true = tables.SCHEMES["catmull-clark"]
    masks = {name: getattr(true, name) for name in ls.Scheme.__dataclass_fields__}
    scheme = ls.Scheme(**masks | {"name": f"vertex weight {own}", "vertex": vertex})
    points, faces = oracles.local_cage(N, seed=2)
    mesh = ls.Mesh(fractions(points), faces)
    exact = ls.LimitSurface(mesh, scheme=scheme)
    surface = exact.with_points(np.array(points, dtype=float))
    fine = ls.refined(mesh, 2, scheme=scheme)
    around = np.unique(fine.faces[: 16 * N : 16])
    parents = fine.parent_face[around], fine.parent_u[around], fine.parent_v[around]
    assert same(exact.evaluate(*parents), fine.limit_points[around])
    face, u, v = np.zeros(8, dtype=int), 0.3 ** np.arange(1, 9), 0.4 ** np.arange(1, 9)
    for nu in ((0, 0), (1, 0), (0, 1), (1, 1)):
        values = exact.evaluate(face, u, v, nu=nu).astype(float)
        error = np.abs(surface.evaluate(face, u, v, nu=nu) - values).max(axis=1)
        assert (error <= 1e-12 * np.abs(values).max(axis=1)).all()
    for nu, tangent in zip(((1, 0), (0, 1)), surface.tangents(face, u, v), strict=True):
        direction = exact.evaluate(face, u, v, nu=nu).astype(float)
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        assert np.abs(tangent - direction).max() <= 1e-12


def test_everything_is_tried():
    """The zoo holds every kind of patch in every position."""
    assert set(ORACLES) <= set(tables.SCHEMES)
    sectors, ways, turns, reasons = set(), set(), set(), set()
    for name, mode in SURFACES:
        points, faces = zoo.ZOO[name]()
        surface = ls.LimitSurface(ls.Mesh(points, faces, holes=[0]), boundary=mode)
        patches = surface.patches
        sectors |= {patches.sectors[kind] for kind in patches.kind.tolist()}
        turns |= set(zip((patches.kind == REGULAR).tolist(), patches.turn.tolist(), strict=True))
        ways |= {depth_of(patches, f) for f in range(len(surface.limit_faces))}
        reasons |= {reason for reason, _ in patches.summary()}
    assert sectors == {
        None,
        *(tables.Sector("interior", N) for N in (2, 3, *range(5, 11), 12, 33, 64)),
    }
    assert turns == {(True, 0), *((False, turn) for turn in range(4))}
    assert ways == {0, 1}
    assert len(reasons) == 4


def depth_of(patches, limit_face):
    """How often a limit face is split."""
    u, v = (x.ravel() for x in np.meshgrid([0.1, 0.4, 0.6, 0.9], [0.1, 0.4, 0.6, 0.9]))
    return int(patches.locate(np.full(16, limit_face), u, v)[3].max())


def test_repr():
    text = repr(ls.LimitSurface(ls.Mesh(*zoo.tetrahedron())))
    assert text == "<LimitSurface of 12 limit faces over 4 vertices, catmull-clark>"


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.skipif(not SHARED_CAGES.is_dir(), reason="these cages are not part of the package")
def test_values_on_faces_that_repeat_a_vertex(compiled, use):
    use(compiled)
    surface = ls.LimitSurface(ls.read(SHARED_CAGES / "catmark_nonman_edges.obj"))
    table = ls.validate(surface.of_channel("uv"), 3)
    assert table["limit_error"].max() < 1e-15
    np.testing.assert_allclose(table["order"], 2, atol=0.01)


def test_refinement_parts_all_patches_in_time(monkeypatch):
    """Ten times at most, and not as often as that by accident."""
    for sharpness in (F(10) - F(1, 10**9), 9.5):
        mesh = ls.Mesh(*zoo.single_face(5), corners={0: sharpness}, boundary="edge_only")
        table = ls.LimitSurface(mesh).patches
        assert table.locate(np.arange(5), np.zeros(5), np.zeros(5))[3].max() == 9
    monkeypatch.setattr("limitsurf.patches.table._DEEPEST", 8)
    with pytest.raises(RuntimeError, match="internal fault: after 8 refinements limit face 0 "):
        ls.LimitSurface(mesh)


# --- Nothing made of rounding


@pytest.fixture(params=[False, True], ids=["numpy", "compiled"])
def engine(request, use):
    """Either of both engines, for calls of any size."""
    use(request.param)


def direction(a, b):
    """The unit vector across two of Fractions."""
    cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    size = max(map(abs, cross))
    cross = np.array([float(x / size) for x in cross])
    return cross / np.linalg.norm(cross)


def pillow(n, seed):
    """A polygon glued to its own back."""
    points = np.random.default_rng(seed).integers(-64, 64, (n, 3)) / 16
    return ls.Mesh(points, [list(range(n)), list(range(n))[::-1]])


@pytest.mark.parametrize("n", [3, 4, 5, 6])
def test_folded_edges_have_no_normal(n, engine):
    u = np.linspace(0.05, 0.95, 10)
    for seed in range(6):
        surface = ls.LimitSurface(pillow(n, 10 * n + seed))
        precise = surface.with_points(fractions(surface.points))
        assert not precise.evaluate(0, fractions(u), F(0), nu=(0, 1)).any()
        assert np.isnan(surface.normal(0, u, 0.0)).all()
        assert np.isnan(surface.tangents(0, u, 0.0)[1]).all()
        for v in (1e-3, 0.3):
            jet = precise.jet(0, F(0.3), F(v), order=1)
            off = surface.normal(0, 0.3, v) - direction(jet[1, 0], jet[0, 1])
            assert np.abs(off).max() < 1e-11
        fine = ls.refined(surface.mesh, 2)
        edges = (fine.parent_v == 0)[fine.indices] & ~np.isnan(fine.limit_normals[:, 0])
        assert not edges.any()


@pytest.mark.parametrize("seed", [None, 0])
@pytest.mark.parametrize("repeat", [False, True], ids=["row", "point"])
def test_normals_where_a_row_of_points_coincides(repeat, seed, engine):
    """There d/dv = 0 along the side u = 0; the limit is that of d/du x d2/dudv."""
    points, faces = zoo.ball(7, 4, repeat, seed)
    surface = ls.LimitSurface(ls.Mesh(points, faces))
    precise = surface.with_points(fractions(points))
    v = np.array([0, 0.25, 0.5, 0.8, 1])
    for face in (0, 3):
        zero = precise.evaluate(face, F(0), fractions(v[1:-1]), nu=(0, 1))
        assert not zero.any()
        along = precise.evaluate(face, F(0), fractions(v[1:-1]), nu=(1, 0))
        mixed = precise.evaluate(face, F(0), fractions(v[1:-1]), nu=(1, 1))
        expected = np.array([direction(a, b) for a, b in zip(along, mixed, strict=True)])
        found = surface.normal(face, 0.0, v)
        assert np.abs(found[1:-1] - expected).max() < 1e-12
        # beside it, and at the vertices from both faces
        for u in (5e-324, 1e-200, 1e-30, 1e-18)[face:]:
            jet = precise.jet(face, F(u), F(0.25), order=1)
            off = surface.normal(face, u, 0.25) - direction(jet[1, 0], jet[0, 1])
            assert np.abs(off).max() < 1e-12
        ends = np.array([surface.normal(face, 1e-8, x) for x in (0.0, 1.0)])
        assert np.abs(found[[0, -1]] - ends).max() < 1e-6
        assert np.abs(surface.normal((face + 1) % 7, 0.0, 0.0) - found[-1]).max() < 1e-12
        assert np.isnan(surface.tangents(face, 0.0, v[1:-1])[1]).all()
        assert np.isnan(surface.curvature(face, 0.0, v).k1).all()
    normals = ls.refined(surface.mesh, 0).limit_normals.reshape(-1, 4, 3)
    corners = surface.normal(np.arange(len(faces))[:, None], [0, 1, 1, 0], [0, 0, 1, 1])
    assert np.abs(normals - corners).max() < 1e-12
    fine = ls.refined(surface.mesh, 2)
    assert np.isfinite(fine.limit_normals).all()
    if seed is None:  # a cone about the axis
        poles = surface.normal(np.arange(7), 0.0, 0.0)
        assert np.abs(poles.mean(axis=0) / poles[0, 2] - [0, 0, 1]).max() < 1e-12


def test_normals_at_a_flat_pole_are_the_axis(engine):
    points, faces = zoo.ball(9, 4)
    points[:18, 2] = 1
    found = ls.LimitSurface(ls.Mesh(points, faces)).normal(0, [0, 0, 0, 1e-300], [0, 0.3, 1, 0.4])
    np.testing.assert_allclose(found, [[0, 0, 1]] * 4, atol=1e-14)


def test_normals_where_rows_coincide(engine):
    """A boundary row that is given twice, and open corners of a row of coinciding points."""
    points, faces = zoo.grid(3, 4)
    points = points.reshape(4, 5, 3)
    twice, point = points.copy(), points.copy()
    twice[1] = twice[0]
    point[0] = point[0, 0]
    for given, nu in ((twice, ((0, 1), (3, 0))), (point, ((1, 1), (1, 0)))):
        surface = ls.LimitSurface(ls.Mesh(given.reshape(-1, 3), faces))
        precise = surface.with_points(fractions(surface.points))
        sides = [surface._topology.sharp_sides[:, k].nonzero()[0] for k in range(4)]
        for side, x in itertools.product(range(4), (0.3, 0.7)):
            for face in sides[side]:
                u, v = [(x, 0), (1, x), (x, 1), (0, x)][side]
                moved = 1e-9
                w, y = [(x, moved), (1 - moved, x), (x, 1 - moved), (moved, x)][side]
                jet = precise.jet(face, F(w), F(y), order=1)
                expected = direction(jet[1, 0], jet[0, 1])
                assert np.abs(surface.normal(face, u, v) - expected).max() < 1e-7, (face, u, v, nu)
        normals = ls.refined(surface.mesh, 0).limit_normals.reshape(-1, 4, 3)
        every = surface.normal(np.arange(len(faces))[:, None], [0, 1, 1, 0], [0, 0, 1, 1])
        assert (np.isnan(normals) == np.isnan(every)).all()
        assert np.nanmax(np.abs(normals - every)) < 1e-12
    assert np.isfinite(every).all()


def test_a_collapsed_edge_inside_is_like_any_other(engine):
    points, faces = zoo.grid(4, 4)
    mesh = ls.Mesh(points, faces)
    inner = np.flatnonzero(~np.isin(mesh.edges, np.flatnonzero(mesh.boundary_vertex)).any(axis=1))
    a, b = mesh.edges[inner[0]]
    points[a] = points[b]
    surface, oracle = both(points, faces)
    for face in np.flatnonzero(np.isin(faces, [a, b]).any(axis=1)):
        for u, v in itertools.product((0.0, 0.4, 1.0), repeat=2):
            expected = np.array(oracle.normal(face, F(u), F(v)), dtype=float)
            assert distance(surface.normal(face, u, v), expected) < 1e-11


@pytest.mark.parametrize("name", sorted({*zoo.ZOO, *zoo.TAGGED}))
def test_limit_normals_and_normals_agree_on_where_there_is_one(name):
    points, faces, tags = (*zoo.ZOO[name](), {}) if name in zoo.ZOO else zoo.TAGGED[name]()
    surface = ls.LimitSurface(ls.Mesh(zoo.random_points(len(points), name), faces, **tags))
    fine = ls.refined(surface.mesh, 1, **surface.rules)
    normals = fine.limit_normals.reshape(-1, 4, 3)
    corner, face = np.maximum(surface.limit_faces.corner, 0), surface.limit_faces.face
    # the child at the first corner of a quad, or that which a limit face of a polygon is
    child = surface.mesh.offsets[face] + corner
    half = np.where(surface.limit_faces.corner < 0, 0.5, 1)[:, None]
    u, v = half * [0, 1, 1, 0], half * [0, 0, 1, 1]
    found = surface.normal(np.arange(len(face))[:, None], u, v)
    assert (np.isnan(found) == np.isnan(normals[child])).all()
    assert np.nanmax(np.abs(found - normals[child]), initial=0) < 1e-7


HUGE = 1.797e308


@pytest.mark.parametrize("scale", [1e290, 1e307, HUGE, 1e-300, 1e-310, 5e-322])
@pytest.mark.parametrize("tags", [{}, {"corners": {0: math.inf}}, {"creases": {(0, 1): 2.5}}])
def test_any_finite_coordinates(tags, scale, engine):
    points, faces = zoo.cube()
    rng = np.random.default_rng(0)
    points = np.where(rng.random((8, 3)) < 0.5, rng.random((8, 3)), 2 * points - 1) * scale
    surface = ls.LimitSurface(ls.Mesh(points, faces, **tags))
    precise = surface.with_points(fractions(points))
    ordinary = surface.with_points(points / scale)
    u, v = np.array([[0, 5e-324, 1e-200, 1e-50, 0.3, 1], [0.2, 1e-100, 5e-324, 1e-50, 0.7, 1]])
    found = surface.evaluate(0, u, v)
    for place, exact in zip(found, precise.evaluate(0, fractions(u), fractions(v)), strict=True):
        for x, y in zip(place, exact, strict=True):
            assert abs(F(x) - y) <= F(1e-14) * 2 * F(scale) + 2 * F(float(np.spacing(abs(x))))
    if scale >= 1e-310:
        close = 1e-9 if scale < 1e-307 else 1e-12
        np.testing.assert_allclose(surface.normal(0, u, v), ordinary.normal(0, u, v), atol=close)
    fine = ls.refined(surface.mesh, 2)
    assert np.isfinite(fine.points).all()
    assert np.isfinite(fine.limit_points).all()
    np.testing.assert_allclose(
        fine.limit_points / scale, ls.refined(ordinary.mesh, 2).limit_points, atol=1e-2
    )


@pytest.mark.parametrize("nu", [(10**9, 0), (0, 10**40), (10**9, 1), (4, 4)])
def test_derivatives_of_any_order(nu, engine):
    surface = ls.LimitSurface(cube_with(creases={(0, 1): 2.5}, corners={7: math.inf}))
    u, v = np.array([[0, 0, 0.5, 1, np.nan], [0, 0.3, 0.5, 1, 0]])
    for face in range(6):
        assert not surface.evaluate(face, u[:4], v[:4], nu=nu).any()
        assert np.isnan(surface.evaluate(face, u[4], v[4], nu=nu)).all()
        assert not surface.weights(face, u[:4], v[:4], nu=nu).count_nonzero()
        assert not surface.evaluate(face, F(0), F(1, 3), nu=nu).any()


def test_orders_of_jets():
    surface = ls.LimitSurface(cube_with())
    assert len(surface.jet(0, 0.2, 0.3, order=30)) == 496
    with pytest.raises(ValueError, match=r"1000000000 has 500,000,001,500,000,001 derivatives"):
        surface.jet(0, 0.2, 0.3, order=10**9)


def test_masked_queries_have_no_answer(engine):
    surface = ls.LimitSurface(cube_with())
    u = np.ma.array([0.1, 0.2, 7], mask=[False, True, True])
    face = np.ma.array([0, 99, 1], mask=[False, True, False])
    for given, gone in (((0, u, 0.3), [1, 2]), ((face, 0.1, 0.3), [1]), ((face, 0.2, u), [1, 2])):
        known = np.setdiff1d(np.arange(3), gone)
        plain = np.ma.filled(given[0], 0), *(np.ma.filled(x, 0.5) for x in given[1:])
        calls = [
            lambda s, *q: s.evaluate(*q),
            lambda s, *q: s.jet(*q, order=1)[1, 0],
            lambda s, *q: s.normal(*q),
            lambda s, *q: s.tangents(*q)[1],
            lambda s, *q: s.curvature(*q).d1,
            lambda s, *q: s.weights(*q).toarray().sum(axis=1),
        ]
        for call in calls:
            found = call(surface, *given)
            assert type(found) is np.ndarray
            assert np.isnan(found[gone]).all()
            np.testing.assert_allclose(found[known], call(surface, *plain)[known], rtol=1e-13)
    assert np.isnan(surface.evaluate(0, np.ma.masked, 0.5)).all()
    assert np.isnan(surface.evaluate(0, [np.ma.masked, 0.5], 0.5)[0]).all()
    exact = np.ma.array([HALF, F(7)], mask=[False, True], dtype=object)
    assert [x != x for x in surface.evaluate(0, exact, HALF)[:, 0]] == [False, True]


@pytest.mark.parametrize("faces", [3, 4, 5])
def test_all_faces_have_the_normal_where_sharp_edges_are_points(faces):
    """Also those that have no side there."""
    angle = np.pi * np.arange(2 * faces + 1) / (2 * faces)
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    points = np.concatenate([np.zeros((1, 3)), circle, 2 * circle])
    points += np.random.default_rng(faces).normal(size=points.shape) / 8
    ring = 1 + np.arange(2 * faces + 1)
    points[ring[[0, -1]]] = points[0]
    quads = [[0, *ring[2 * j : 2 * j + 3]] for j in range(faces)]
    outer = ring + len(ring)
    quads += [[ring[j], outer[j], outer[j + 1], ring[j + 1]] for j in range(2 * faces)]
    surface = ls.LimitSurface(ls.Mesh(points, quads), boundary="edge_only")
    found = surface.normal(np.arange(faces), 0, 0)
    assert not np.isnan(found).any()
    assert np.abs(found - found[0]).max() <= 1e-14
