"""Creases, corners, darts, holes, boundaries and non-manifold cages against independent oracles.

All tagged cages of the zoo, and random ones, are refined and evaluated as exactly as by hand. The
accuracy is the design's, see test_surface.py. ``pytest --tagged=N`` tries N random cages.
"""

import itertools
import math
import random
import time
from fractions import Fraction as F
from pathlib import Path

import mpmath
import numpy as np
import oracles
import oracles_creases
import pytest
import zoo
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from oracles import Stencil
from oracles_creases import INF, Cage, TaggedSurface, refine_times
from scipy.interpolate import BSpline
from test_surface import (
    LOW_ORDERS,
    accuracy,
    assert_exact,
    at_corner,
    columns,
    distance,
    exact_queries,
    float_queries,
    fractions,
    same,
)

import limitsurf as ls
from limitsurf import numbers
from limitsurf.patches import REGULAR, STRIP
from limitsurf.query import on_refined, refinement_gap
from limitsurf.rules import Rules, Sharpness

on_the_zoo = pytest.mark.parametrize("name", zoo.TAGGED)
HALF = F(1, 2)
ORDERS = [(0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (0, 3), (2, 3)]


class Oracle(TaggedSurface):
    """`TaggedSurface` with those derivatives at special vertices that exist all the same."""

    @property
    def points(self):
        return self.cage.points

    def _neighbourhood(self, face):
        return self._cut_out(face)

    def sector(self, face, u, v):
        """What surrounds a special corner of the square: kind, faces, which sides are sharp.

        None where the surface is regular. The sides are those along u and along v.
        """
        net, level, _, _, r = self._descend(face, u, v)
        if r is None:
            return None
        corner = oracles_creases._corners(net.local)[r]
        closed_kind = {"smooth": "interior", "corner": "cone", "crease": "pendant"}
        kind = closed_kind.get(corner.rule, corner.rule) if corner.closed else corner.rule
        if kind == "crease" and corner.looped:
            kind = "flap"
        n, position = len(corner.sector), corner.sector.index((0, r))
        sharp = not corner.closed and position == 0, not corner.closed and position == n - 1
        return kind, n, sharp[:: 1 - 2 * (r % 2)], level

    def evaluate(self, face, u, v, nu=(0, 0)):
        value = super().evaluate(face, u, v, nu=nu)
        hole = self.limit_faces[face][0] in self.cage.holes
        if not any(nu) or hole or not any(x != x for x in value):
            return value
        kind, n, sharp, level = self.sector(face, u, v)
        if sum(nu) == 1 and kind in ("interior", "dart") and n <= 3:
            return (F(0),) * len(value)  # the subdominant eigenvalue is less than 1/2
        if sum(nu) == 1 and (kind, n) == ("dart", 4):
            return self.slope_at_a_dart(face, u, v, nu)
        step = F(1, 2 ** (level + 3))
        if (kind, n) in (("crease", 2), ("corner", 1)):
            return self.extrapolated(face, u, v, nu, (step, step))  # beside n-gons
        if kind in ("crease", "corner", "flap") and min(nu) == 0 and sharp[nu[0] == 0]:
            return self.extrapolated(face, u, v, nu, [step * (n > 0) for n in nu])
        return value

    def slope_at_a_dart(self, face, u, v, nu):
        """The first derivatives at a dart of valence 4, where linear functions are eigenfunctions.

        That across the crease is as at a smooth vertex, by symmetry. The mask of that along it is
        the left eigenvector of 1/2, solved for by hand.
        """
        net, level, _, _, r = self._descend(face, u, v)
        corner = oracles_creases._corners(net.local)[r]
        v0, e, f = ([net.local.faces[g][(i + k) % 4] for g, i in corner.sector] for k in range(3))
        masks = [
            {
                v0[0]: 48,
                e[0]: 84,
                e[1]: -24,
                e[3]: -24,
                e[2]: -48,
                f[0]: -3,
                f[3]: -3,
                f[1]: -15,
                f[2]: -15,
            },
            {e[1]: 52, e[3]: -52, f[0]: 13, f[1]: 13, f[2]: -13, f[3]: -13},
        ]
        outgoing = int(r % 2 == 0) == nu[0]  # else the side towards the corner, a quarter on
        turns = corner.sector.index((0, r)) + (not outgoing)
        sign = (1, 1, -1, -1)[turns % 4] * (-1 if (u, v)[nu[0] == 0] else 1)
        scale = F(sign * 2**level, 156)
        return net.combined(Stencil({i: scale * w for i, w in masks[turns % 2].items()}))

    def extrapolated(self, face, u, v, nu, steps):
        """The value at a corner of the polynomial that the surface, or a side, is beside it."""
        weights = {1: 4, 2: -6, 3: 4, 4: -1}
        du, dv = ((1 - 2 * F(x)) * step for x, step in zip((u, v), steps, strict=True))
        total = 0
        for i in weights if du else [0]:
            for j in weights if dv else [0]:
                near = super().evaluate(face, F(u) + i * du, F(v) + j * dv, nu=nu)
                total = total + weights.get(i, 1) * weights.get(j, 1) * np.array(near)
        return tuple(np.asarray(total).tolist())


def both(points, faces, tags):
    """A cage's limit surface, and the oracle's."""
    surface = ls.LimitSurface(ls.Mesh(points, faces, **tags))
    return surface, Oracle(Cage(list(map(tuple, points.tolist())), faces, **tags))


def thirds(name):
    """A tagged cage of the zoo with exact points that are no floats."""
    points, faces, tags = zoo.TAGGED[name]()
    return fractions(points, 3), faces, tags


def naive(points, faces, tags):
    return Cage(list(map(tuple, points.tolist())), faces, **tags)


# --- The refiner


def by_corner(points, faces):
    """Points as rows by face corner: numbers of edges that coincide are arbitrary."""
    return [tuple(points[v]) for face in faces for v in face]


def assert_refined(fine, cage):
    """Points, sharpness of edges and vertices, holes: all by corner of the faces, in order."""
    assert fine.n_vertices == len(cage.points)
    assert fine.sizes.tolist() == list(map(len, cage.faces))
    assert by_corner(fine.points.tolist(), fine.faces.tolist()) == by_corner(
        cage.points, cage.faces
    )
    rules = Rules.resolve(fine)
    sharpness = Sharpness.of(fine, rules, numbers.RATIONAL)
    expected = [cage.creases[edge] for edges in cage.sides for edge in edges]
    assert sharpness.half_edges.tolist() == list(map(float, expected))
    tags = dict(zip(map(tuple, fine.creases[0].tolist()), fine.creases[1].tolist(), strict=True))
    ends = np.sort([fine.indices, fine.indices[fine.next_corner]], axis=0).T.tolist()
    known = [
        (tags[pair], x) for pair, x in zip(map(tuple, ends), expected, strict=True) if pair in tags
    ]
    assert all(tag == x for tag, x in known)
    expected = [cage.corners[v] for face in cage.faces for v in face]
    assert sharpness.vertices[fine.indices].tolist() == list(map(float, expected))
    assert rules.without_limit(fine).nonzero()[0].tolist() == sorted(cage.holes)


@on_the_zoo
def test_refined_is_naively_refined(name):
    points, faces, tags = thirds(name)
    mesh, cage = ls.Mesh(points, faces, **tags), naive(points, faces, tags)
    fine, R = ls.refined(mesh, 2, operator=True)
    assert_refined(fine, refine_times(cage, 2))
    assert_refined(ls.refined(mesh), refine_times(cage, 1))
    assert (R @ points == fine.points).all()


@on_the_zoo
def test_refined_in_floats(name):
    points, faces, tags = zoo.TAGGED[name]()
    levels = 3 if len(faces) < 30 else 2
    fine, R = ls.refined(ls.Mesh(points, faces, **tags), levels, operator=True)
    cage = refine_times(naive(points, faces, tags), levels)
    found = fine.points[fine.indices]
    assert np.abs(found - by_corner(cage.points, cage.faces)).max() < 5e-15
    assert np.abs(R @ points - fine.points).max() < 5e-15
    assert np.abs(R.sum(axis=1) - 1).max() < 5e-15


# --- Evaluation


def exact_queries_near(surface, n, rng):
    """Those of `exact_queries`, and some on the edges and at the corners of the same faces."""
    queries = exact_queries(surface, n, rng)
    for face, *_ in queries[: n // 2]:
        k = rng.randrange(4)
        t = F(rng.randint(0, 12), 12) / 10 ** rng.choice([0, 0, 1, 6, 12])
        queries.append((face, *at_corner(k, *rng.choice([(t, 0), (0, t)]))))
        queries.append((face, *at_corner(k, F(0), F(0))))
    return queries


@on_the_zoo
def test_exact_on_the_zoo(name):
    """Positions and derivatives, also at special corners, on creases and in holes."""
    rng = random.Random(name)
    surface, oracle = both(*thirds(name))
    queries = exact_queries_near(surface, 12, rng)
    assert_exact(surface, oracle, queries, [(0, 0), *rng.sample(ORDERS[1:], 3)])


def float_queries_near(surface, n, rng):
    """Those of `float_queries`, and some of them moved onto an edge."""
    queries = float_queries(range(len(surface.limit_faces)), n, rng)
    for face, u, v in queries[: n // 2]:
        x = float(round(rng.choice([u, v])))
        queries.append((face, *rng.choice([(u, x), (x, v)])))
    return queries


@on_the_zoo
def test_accuracy_on_the_zoo(name):
    """As for untagged cages of the zoo, see test_surface.py, and with the same measure."""
    surface, oracle = both(*zoo.TAGGED[name]())
    queries = float_queries_near(surface, 10, random.Random(name))
    assert max(accuracy(surface, oracle, queries, LOW_ORDERS[:6], floor=F(1, 100)), default=0) <= 1


# --- Limits of refined vertices


@on_the_zoo
def test_limit_points(name):
    """The surface at the parameters that a vertex comes from, exactly; all sharp ones, and some."""
    points, faces, tags = thirds(name)
    surface, oracle = both(points, faces, tags)
    for levels in (0, 1, 2)[: 3 if len(faces) < 12 else 2]:
        fine = ls.refined(surface.mesh, levels)
        loose = Rules.resolve(fine).loose_vertices(fine) | (fine.vertex_faces == 0)
        assert (np.isnan(fine.limit_points.astype(float)).all(axis=1) == loose).all()
        some = random.Random(name).sample(np.flatnonzero(~loose).tolist(), min(12, sum(~loose)))
        parents = zip(fine.parent_face[some], fine.parent_u[some], fine.parent_v[some], strict=True)
        for limit, parent in zip(fine.limit_points[some], parents, strict=True):
            exact = oracle.evaluate(*parent)
            # holes alone around it: it has a limit, which the surface does not tell
            assert tuple(limit) == exact or oracle.limit_faces[parent[0]][0] in oracle.cage.holes
        floats = ls.refined(surface.mesh.with_points(points.astype(float)), levels)
        error = floats.limit_points[~loose] - fine.limit_points[~loose].astype(float)
        assert np.abs(error).max(initial=0) < 5e-15


def parameters_of_corners(fine, faces, levels):
    """Limit face, u, v of every corner of every face of a refined cage."""
    parameters = oracles.refined_parameters(faces, levels)
    face = np.repeat([face for face, _ in parameters], 4)
    return face, *np.array([c for _, corners in parameters for c in corners], dtype=float).T


def folded(surface, face, u, v):
    """Where d/du and d/dv are nearly parallel, or one is nearly 0: on pillows and the like."""
    along, across = (surface.evaluate(face, u, v, nu=nu) for nu in ((1, 0), (0, 1)))
    sizes = [np.abs(x).max(axis=1) for x in (along, across)]
    with np.errstate(invalid="ignore", divide="ignore"):
        area = np.cross(along / sizes[0][:, None], across / sizes[1][:, None])
    return (np.minimum(*sizes) < 1e-6 * np.maximum(*sizes)) | (np.abs(area).max(axis=1) < 1e-4)


@on_the_zoo
def test_limit_normals(name):
    """By tangent masks, in every face around a vertex, what the surface has there."""
    points, faces, tags = zoo.TAGGED[name]()
    surface = ls.LimitSurface(ls.Mesh(points, faces, **tags))
    for levels in (1, 2) if len(faces) < 20 else (1,):
        fine = ls.refined(surface.mesh, levels)
        query = parameters_of_corners(fine, faces, levels)
        normals, sound = surface.normal(*query), ~folded(surface, *query)
        exists = ~np.isnan(normals[:, 0])
        assert (exists == ~np.isnan(fine.limit_normals[:, 0]))[sound].all()
        assert np.abs(fine.limit_normals - normals)[exists & sound].max(initial=0) < 1e-12


# --- Normals


def compare_normals(surface, oracle, queries):
    """To 1e-12 of the exact ones at the very same parameters, where the oracle has any."""
    normals, directions = surface.normal(*columns(queries)), surface.tangents(*columns(queries))
    compared = 0
    for k, query in enumerate(queries):
        exact = oracle.normal(*query)
        if any(x != x for x in exact):
            continue
        compared += 1
        assert distance(normals[k], exact) <= 1e-12, query
        for nu, along in zip(((1, 0), (0, 1)), directions, strict=True):
            assert distance(along[k], unit(oracle.evaluate(*query, nu=nu))) <= 1e-12, query
    return compared


def unit(vector):
    with mpmath.workdps(70):
        vector = [mpmath.mpf(x.numerator) / x.denominator for x in vector]
        return [x / mpmath.norm(vector) for x in vector]


@on_the_zoo
def test_normals_on_the_zoo(name):
    surface, oracle = both(*zoo.TAGGED[name]())
    rng = random.Random(name)
    queries = float_queries_near(surface, 6, rng)
    for k, reach in enumerate([1e-12, 1e-12, 1e-100, 1e-100]):
        face = rng.randrange(len(surface.limit_faces))
        t = rng.choice([0.0, rng.random()])  # near corner 0, where floats are dense
        queries.append((face, *[(reach, reach * t), (reach * t, reach)][k % 2]))
    folds = folded(surface, *columns(queries))
    compare_normals(
        surface, oracle, [q for q, fold in zip(queries, folds, strict=True) if not fold]
    )


# --- Next to special corners of every kind

SPECIAL = {
    **{f"crease of {k}": f"boundary_{k}_edge_only" for k in range(1, 8)},
    "crease of 4 and 4": "crease_4_4",
    **{f"corner of {k}": f"corner_{k}" for k in range(2, 7)},
    **{f"dart of {N}": f"dart_{N}" for N in range(2, 10)},
    **{f"cone of {N}": f"cone_{N}" for N in range(2, 8)},
    "corner at one crease": "corner_of_one_crease",
    **{f"pendant of {k}": f"pendant_{k}" for k in (2, 3, 5)},
    **{f"flap of {k}": f"flap_{k}" for k in (2, 3, 4)},
}
at_special_corners = pytest.mark.parametrize("kind", SPECIAL)
DIRECTIONS = [(1, 0), (0, 1), (1, 1), (0.75, 0.25), (0.125, 1), (1, 1e-8), (0.77, 0.69)]


def around(kind, exact=False):
    """A cage with the special corner, as vertex 0, at each corner of its faces in turn.

    Also the faces there, and which of their corners it is.
    """
    points, faces, tags = zoo.TAGGED[SPECIAL[kind]]()
    there = [f for f, face in enumerate(faces) if 0 in face]
    if kind.startswith(("pendant", "flap")):  # the others are creases
        there = there[3:]
    turned = list(faces)
    for n, f in enumerate(there):
        k = faces[f].index(0)
        turned[f] = faces[f][k - n % 4 :] + faces[f][: k - n % 4]
    places = [(f, turned[f].index(0)) for f in there]
    return (fractions(points, 3) if exact else points, turned, tags), places


@at_special_corners
def test_exact_next_to_special_corners(kind):
    cage, places = around(kind, exact=True)
    surface, oracle = both(*cage)
    rng = random.Random(kind)
    queries = []
    for face, k in places:
        queries.append((face, *at_corner(k, F(0), F(0))))
        for exponent in (0, 3, 12, 30):
            a, b = (F(rng.randint(0, 4), 4) / 10**exponent for _ in "ab")
            queries += [(face, *at_corner(k, *ab)) for ab in ((a, b), (a, F(0)), (F(0), b))]
    some = rng.sample(queries, min(len(queries), 40))
    assert_exact(surface, oracle, some[::2], [(0, 0), (1, 0), (1, 1), (0, 2)])
    assert_exact(surface, oracle, some[1::2], [(0, 0), (0, 1), (2, 0), (3, 1)])


@at_special_corners
def test_accuracy_next_to_special_corners(kind):
    """Down to 1e-12, and on the very edges, sharp ones among them."""
    cage, places = around(kind)
    surface, oracle = both(*cage)
    rng = random.Random(kind)
    queries = []
    for face, k in places:
        scales = 10.0 ** -rng.randrange(12), 1e-12
        for scale, t in itertools.product(scales, (rng.random(), 0.0)):
            queries.append(
                (face, *at_corner(k, *rng.choice([(scale, scale * t), (scale * t, scale)])))
            )
        queries.append((face, *at_corner(k, 0.0, 0.0)))
    assert max(accuracy(surface, oracle, queries, LOW_ORDERS[:6])) <= 1


@at_special_corners
@pytest.mark.parametrize("reach", [1e-3, 1e-12, 1e-100])
def test_normals_next_to_special_corners(kind, reach):
    """Also on the edges; not yet the normal at the vertex, should there be one."""
    (points, faces, tags), _ = around(kind)
    faces = zoo.TAGGED[SPECIAL[kind]]()[1]  # at corner 0, where floats are dense
    surface, oracle = both(points, faces, tags)
    there = [f for f, face in enumerate(faces) if 0 in face]
    if kind.startswith(("pendant", "flap")):  # the others are creases
        there = there[3:]
    assert all(faces[f][0] == 0 for f in there)
    rng = random.Random(kind)
    some = there if reach > 1e-100 else rng.sample(there, min(len(there), 3))
    queries = [(f, a * reach, b * reach) for f in some for a, b in rng.sample(DIRECTIONS, 2)]
    queries += [(there[0], reach, 0.0), (there[-1], 0.0, reach)]
    assert compare_normals(surface, oracle, queries) == len(queries)


# --- The same surface, written differently


@on_the_zoo
def test_a_refined_cage_has_the_same_surface(name):
    """Exactly, where both have a limit; in floats, normals too, up to rounding."""
    points, faces, tags = zoo.TAGGED[name]()
    exact = ls.LimitSurface(ls.Mesh(fractions(points, 3), faces, **tags))
    rng = random.Random(name)
    queries = columns(exact_queries_near(exact, 8, rng))
    finer = ls.LimitSurface(ls.refined(exact.mesh))
    values, again = exact.evaluate(*queries), finer.evaluate(*on_refined(exact, *queries))
    assert all(same([a], [b]) for a, b in zip(values, again, strict=True))
    surface = exact.with_points(points)
    queries = columns(float_queries_near(surface, 8, rng))
    sound = np.flatnonzero(~folded(surface, *queries))
    gaps = refinement_gap(surface, *(x[sound] for x in queries))
    assert gaps[0] <= 1e-14
    assert gaps[1] <= 1e-11


@on_the_zoo
def test_weights(name):
    """Those of the oracle, exactly; in floats they sum to one and give the values."""
    points, faces, tags = zoo.TAGGED[name]()
    surface = ls.LimitSurface(ls.Mesh(points, faces, **tags))
    oracle = TaggedSurface(Cage(None, faces, **tags))
    rng = random.Random(name)
    queries = exact_queries_near(surface, 4, rng)
    W = surface.weights(*columns(queries))
    for k, query in enumerate(queries):
        row = slice(W.indptr[k], W.indptr[k + 1])
        weights = dict(zip(W.columns[row].tolist(), W.values[row], strict=True))
        expected = oracle.weights(*query)
        if expected is None:
            assert any(w != w for w in weights.values())
            continue
        assert {i: w for i, w in weights.items() if w} == {i: w for i, w in expected.items() if w}
        assert sum(weights.values()) == 1
    queries = columns(float_queries_near(surface, 8, rng))
    for nu in LOW_ORDERS[:6]:
        W, values = surface.weights(*queries, nu=nu), surface.evaluate(*queries, nu=nu)
        assert W.shape == (len(queries[0]), len(points))
        undefined = np.isnan((W @ points)[:, 0])
        assert (np.isnan(values[:, 0]) == undefined).all()
        # derivatives in a piece multiply the rounding of its points, which are of any size
        deep = surface.patches.locate(*(x[~undefined] for x in queries))[3]
        scale = np.maximum(1, np.abs(W).sum(axis=1))
        scale[~undefined] += 2.0 ** (sum(nu) * deep) / 100
        assert (np.abs(W @ points - values).max(axis=1) <= 1e-13 * scale)[~undefined].all()
        assert (np.abs(W.sum(axis=1) - (nu == (0, 0))) <= 1e-13 * scale)[~undefined].all()


@pytest.mark.parametrize(
    "name", ["crossed_grid_2.5", "mixed_cube_1", "crease_3_3", "fin", "ring_2.5"]
)
def test_with_points(name):
    points, faces, tags = zoo.TAGGED[name]()
    surface = ls.LimitSurface(ls.Mesh(points, faces, **tags))
    other, fresh = points[::-1] * 2, ls.LimitSurface(ls.Mesh(points[::-1] * 2, faces, **tags))
    queries = columns(float_queries_near(surface, 20, random.Random(name)))
    before = surface.evaluate(*queries)
    assert surface.with_points(other).patches is surface.patches
    for nu in LOW_ORDERS[:3]:
        values = surface.with_points(other).evaluate(*queries, nu=nu)
        assert np.array_equal(values, fresh.evaluate(*queries, nu=nu), equal_nan=True)
    assert np.array_equal(surface.evaluate(*queries), before, equal_nan=True)
    third = [F(1, 3)] * 2
    exact = surface.with_points(other).evaluate(0, *third)
    assert same([exact], [fresh.evaluate(0, *third)])
    assert np.array_equal(
        ls.refined(surface.mesh).with_points(ls.refined(surface.mesh).points * 2).limit_points,
        ls.refined(surface.mesh).limit_points * 2,
        equal_nan=True,
    )


# --- Curves


def spline(polygon, t, closed=False, nu=0):
    """The uniform cubic B-spline of a polygon at t in [0, n], by scipy; clamped or closed."""
    P = np.array(polygon, dtype=float)
    if closed:
        P = np.concatenate([P[-1:], P, P[:2]])
    else:
        P = np.concatenate([2 * P[:1] - P[1:2], P, 2 * P[-1:] - P[-2:-1]])
    return BSpline(np.arange(-3.0, len(P) + 1.0), P, 3)(t, nu)


def along_edge(faces, a, b, t):
    """The limit face, u and v at the fraction t of the edge from a to b, in each face there.

    With the direction along the edge: du, dv and the length of a step in the edge's parameter.
    """
    numbers = {place: i for i, place in enumerate(oracles.limit_faces(faces))}
    for f, face in enumerate(faces):
        for k, pair in enumerate(zip(face, face[1:] + face[:1], strict=True)):
            if set(pair) != {a, b}:
                continue
            forward = 1 if pair == (a, b) else -1
            s = t if forward == 1 else 1 - t
            if len(face) == 4:
                (u, v), (x, y) = oracles.CORNERS[k], oracles.CORNERS[(k + 1) % 4]
                du, dv = (x - u) * forward, (y - v) * forward
                yield (numbers[f, -1], u + s * (x - u), v + s * (y - v)), (du, dv), 1
            elif s <= HALF:
                yield (numbers[f, k], 2 * s, 0 * s), (forward, 0), 2
            else:
                yield (numbers[f, (k + 1) % len(face)], 0 * s, 2 - 2 * s), (0, -forward), 2


def check_curve(surface, faces, path, closed=False):
    """The edges of a path form its B-spline, seen from every face, with all its derivatives."""
    polygon = [surface.points[v] for v in path]
    steps = list(zip(path, path[1:] + path[:1], strict=True))
    for i, (a, b) in enumerate(steps if closed else steps[:-1]):
        for t in (0.0, 1e-12, 0.25, 0.7, 1.0):
            found = list(along_edge(faces, a, b, t))
            assert found
            for query, direction, length in found:
                value, expected = surface.evaluate(*query), spline(polygon, i + t, closed)
                assert np.abs(value - expected).max() < 2e-14
                for order in (1, 2):
                    nu = tuple(order * abs(x) for x in direction)
                    derivative = (
                        surface.evaluate(*query, nu=nu) * (sum(direction) * length) ** order
                    )
                    # a second derivative is continuous, but at ends of a clamped curve
                    expected = spline(polygon, i + t, closed, order)
                    assert np.abs(derivative - expected).max() < 1e-12


@pytest.mark.parametrize(
    "name",
    [
        "crease_1_3",
        "crease_2_2",
        "crease_3_3",
        "crease_4_4",
        "crease_5_5",
        "crease_6_6",
        "crease_7_7",
    ],
)
def test_sharp_creases_are_splines(name):
    """From boundary to boundary through a vertex between any numbers of faces."""
    points, faces, tags = zoo.TAGGED[name]()
    edges = list(tags["creases"])
    path = [edges[1][1], edges[0][1], 0, edges[2][1], edges[3][1]]
    check_curve(ls.LimitSurface(ls.Mesh(points, faces, **tags)), faces, path)


def test_sharp_creases_across_ngons_are_splines():
    points, faces = zoo.ZOO["dodecahedron"]()
    path = next(p for p in paths(faces, 5) if p[0] < p[-1])
    creases = dict.fromkeys(itertools.pairwise(path), INF)
    mesh = ls.Mesh(points, faces, creases=creases, corners={path[0]: INF, path[-1]: 11})
    check_curve(ls.LimitSurface(mesh), faces, path)


def paths(faces, n):
    """Paths of n vertices without a chord, along the edges of a mesh."""
    neighbours = {}
    for a, b in zoo.edges_of(faces):
        neighbours.setdefault(a, []).append(b)
        neighbours.setdefault(b, []).append(a)
    found = [[v] for v in neighbours]
    for _ in range(n - 1):
        found = [
            [*path, v]
            for path in found
            for v in neighbours[path[-1]]
            if not set(neighbours[v]) & set(path[:-1])
        ]
    return found


@pytest.mark.parametrize("k", range(1, 8))
def test_boundaries_are_closed_splines(k):
    """Under "edge_only" all around, at vertices of any number of faces."""
    points, faces, tags = zoo.TAGGED[f"boundary_{k}_edge_only"]()
    surface = ls.LimitSurface(ls.Mesh(points, faces, **tags))
    check_curve(surface, faces, boundary_loop(faces), closed=True)


def boundary_loop(faces):
    directed = set(zoo.half_edges(faces))
    after = {a: b for a, b in directed if (b, a) not in directed}
    loop = [min(after)]
    while after[loop[-1]] != loop[0]:
        loop.append(after[loop[-1]])
    return loop


@pytest.mark.parametrize("k", range(2, 8))
def test_boundaries_are_clamped_at_corners(k):
    points, faces, tags = zoo.TAGGED[f"boundary_{k}_edge_and_corner"]()
    surface = ls.LimitSurface(ls.Mesh(points, faces, **tags))
    loop = boundary_loop(faces)
    corners = [i for i, v in enumerate(loop) if sum(v in face for face in faces) == 1]
    assert len(corners) >= 2
    for i, j in zip(corners, corners[1:] + corners[:1], strict=True):
        part = loop[i : j + 1] if i < j else loop[i:] + loop[: j + 1]
        check_curve(surface, faces, part)


@pytest.mark.parametrize("name", ["fin", "cross", "crossed_grids", "opposite_orientation"])
def test_nonmanifold_edges_are_clamped_splines(name):
    """As seen from all faces, whose directions along the edge may be the same."""
    points, faces, tags = zoo.TAGGED[name]()
    edges = zoo.NONMANIFOLD[name][2]
    path = [edges[0][0], *(b for _, b in edges)]
    check_curve(ls.LimitSurface(ls.Mesh(points, faces, **tags)), faces, path)


# --- Normals and tangents at special corners

HAS_NORMAL = {
    **{f"crease of {k}": k <= 4 for k in range(1, 8)},
    "crease of 4 and 4": True,
    **{f"corner of {k}": k <= 2 for k in range(2, 7)},
    **{f"dart of {N}": N >= 3 for N in range(2, 10)},
    **{f"cone of {N}": False for N in range(2, 8)},
    "corner at one crease": False,
    **{f"pendant of {k}": False for k in (2, 3, 5)},
    **{f"flap of {k}": False for k in (2, 3, 4)},
}


def converges(d):
    """Whether distances at 2^-60, 2^-120, 2^-240 go to 0, at least as 1/n after n halvings."""
    return d[2] <= 1e-12 or (d[0] > d[1] > d[2] and 1 / d[2] - 1 / d[1] > 1.8 / d[1] - 1.8 / d[0])


@at_special_corners
def test_limits_of_normals_and_tangents(kind):
    """At the corner itself they are what they tend to nearby; NaN where that depends on the way."""
    points, faces, tags = zoo.TAGGED[SPECIAL[kind]]()
    surface, oracle = both(points, faces, tags)
    there = [f for f, face in enumerate(faces) if 0 in face]
    if kind.startswith("corner of"):
        there = there[2:]  # the others are corners of one face
    if kind.startswith(("pendant", "flap")):
        there = there[3:]
    normals = surface.normal(there, 0, 0)
    along, across = surface.tangents(there, 0, 0)
    assert not np.isnan([along, across]).any()
    reaches = [F(1, 2**n) for n in (60, 120, 240)]
    for i in random.Random(kind).sample(range(len(there)), min(2, len(there))):
        for nu, tangent in (((1, 0), along[i]), ((0, 1), across[i])):
            near = [oracle.evaluate(there[i], nu[0] * h, nu[1] * h, nu=nu) for h in reaches]
            assert converges([distance(tangent, unit(x)) for x in near])
        if HAS_NORMAL[kind]:
            near = [oracle.normal(there[i], h, h / 3) for h in reaches]
            assert converges([distance(normals[i], n) for n in near])
    if not HAS_NORMAL[kind]:
        assert np.isnan(normals).all()
        h = reaches[-1]
        ways = [(there[0], h, 0), (there[-1], 0, h), (there[0], h, h), (there[0], h / 16, h)]
        ends = [oracle.normal(*way) for way in ways]
        assert max(distance(ends[0], end) for end in ends) > 1e-3


NO_NORMAL = {
    *(("crease", k) for k in range(5, 20)),
    *(("corner", k) for k in range(3, 20)),
    *((kind, N) for kind in ("cone", "pendant", "flap") for N in range(2, 20)),
    ("dart", 2),
    ("interior", 2),
}


@on_the_zoo
def test_normals_at_vertices(name):
    """NaN just where the kind of the corner says so, and in holes."""
    points, faces, tags = zoo.TAGGED[name]()
    surface, oracle = both(points, faces, tags)
    places = [
        (i, float(u), float(v))
        for i, (_, k) in enumerate(oracle.limit_faces)
        for u, v in (oracles.CORNERS if k == -1 else oracles.CORNERS[:1])
    ]
    places = random.Random(name).sample(places, min(len(places), 12))
    beside = [(i, abs(u - 1e-9), abs(v - 1e-9)) for i, u, v in places]
    normals, folds = surface.normal(*columns(places)), folded(surface, *columns(beside))
    for place, normal, fold in zip(places, normals, folds, strict=True):
        hole = oracle.limit_faces[place[0]][0] in oracle.cage.holes
        if hole or (oracle.sector(*place) or ())[:2] in NO_NORMAL:
            assert np.isnan(normal).all(), place
        elif not fold:
            assert abs(np.linalg.norm(normal) - 1) < 1e-14, place


# --- Continuity


def assert_continuous(surface, oracle, faces, edges, fractions_of_the_edge):
    """Exactly the same position in all faces of an edge; unless it is sharp, one tangent plane."""
    for edge in edges:
        for t in fractions_of_the_edge:
            found = list(along_edge(faces, *edge, t=t))
            queries = columns([query for query, _, _ in found])
            values = [x for x in surface.evaluate(*queries).tolist() if x[0] == x[0]]
            assert all(x == values[0] for x in values)
            if oracle.cage.creases[edge] != INF and len(found) == 2:
                along, across = (
                    surface.evaluate(*queries, nu=(1, 0)),
                    surface.evaluate(*queries, nu=(0, 1)),
                )
                normals = cross(along, across)
                first, second = (
                    n * size**2 for n, (_, _, size) in zip(normals, found, strict=True)
                )
                assert any(x != x for x in (*first, *second)) or (first == second).all()


def cross(a, b):
    parts = [a[..., i - 2] * b[..., i - 1] - a[..., i - 1] * b[..., i - 2] for i in range(3)]
    return np.stack(parts, axis=-1)


@on_the_zoo
def test_continuity_across_edges(name):
    points, faces, tags = thirds(name)
    surface, oracle = both(points, faces, tags)
    edges = zoo.edges_of([face for face in faces if len(set(face)) == len(face)])
    some = random.Random(name).sample(edges, min(len(edges), 4))
    assert_continuous(surface, oracle, faces, some, [F(1, 7), HALF, F(1, 2**40)])


@on_the_zoo
def test_continuity_of_normals(name):
    """In floats, on both sides of an edge that is not sharp, and at its ends; both NaN or none."""
    points, faces, tags = zoo.TAGGED[name]()
    surface, oracle = both(points, faces, tags)
    edges = zoo.edges_of([face for face in faces if len(set(face)) == len(face)])
    pairs = [
        [query for query, _, _ in found]
        for edge in random.Random(name).sample(edges, min(len(edges), 12))
        for t in (0.0, 0.3, 1.0)
        for found in [list(along_edge(faces, *edge, t=t))]
        if oracle.cage.creases[edge] != INF and len(found) == 2
    ]
    holes = oracle.cage.holes
    pairs = [p for p in pairs if not any(oracle.limit_faces[q[0]][0] in holes for q in p)]
    if not pairs:
        return
    one, other = (columns(side) for side in zip(*pairs, strict=True))
    beside = [
        (f, abs(u - 1e-9), abs(v - 1e-9))
        for side in (one, other)
        for f, u, v in zip(*side, strict=True)
    ]
    sound = ~folded(surface, *columns(beside)).reshape(2, -1).any(axis=0)
    first, second = surface.normal(*one)[sound], surface.normal(*other)[sound]
    assert np.allclose(first, second, rtol=0, atol=1e-12, equal_nan=True)


# --- What it costs


def grid_with_a_crease(n, s):
    """A regular grid with a crease of constant sharpness in the middle that ends inside."""
    points, faces = zoo.grid(n, n)
    creases = dict.fromkeys(zoo.row_of_edges(n, n, n // 2, n // 2), s)
    return ls.Mesh(points, faces, creases=creases)


@pytest.mark.parametrize("s", [0.3, 1, 2.5, 4.7, 7])
def test_creases_are_isolated_locally(s):
    """Far from the crease nothing is split; where it runs regularly it is one row of strips."""
    n = 24
    surface = ls.LimitSurface(grid_with_a_crease(n, s))
    code = surface.patches.codes[: n * n].reshape(n, n)
    split = code <= -2
    kinds = np.where(split, -1, surface.patches.kind[code])
    i, j = np.indices((n, n))
    # the crease is along the line i = n / 2 from j = 0 to j = n / 2
    beside = (i == n // 2) | (i == n // 2 - 1)
    near_an_end = (abs(j - n // 2 + 0.5) <= 2) | (j < 2)
    assert not split[~(near_an_end & (abs(i - n // 2 + 0.5) <= 2))].any()
    strips = beside & (j < n // 2) & ~near_an_end
    assert strips.any()
    assert (kinds == STRIP).sum() >= strips.sum()
    assert (kinds[strips] == STRIP).all()
    assert (kinds[~split & ~beside & ~near_an_end] == REGULAR).all()
    assert extra_points(2 * n, s) == extra_points(n, s)  # none along the crease
    depth = surface.patches.locate(*(x.ravel() for x in np.meshgrid(range(n * n), 1e-9, 1e-9)))[3]
    assert depth.max() <= math.ceil(s) + 1
    named = dict(surface.patches.summary())
    assert named["one strip along a semi-sharp crease"] == (kinds == STRIP).sum()
    assert named["one regular patch"] == (kinds == REGULAR).sum()
    assert sum(named.values()) == n * n


def extra_points(n, s):
    """Control points that a crease adds."""
    with_it, without = (ls.LimitSurface(grid_with_a_crease(n, x)).patches for x in (s, 0))
    return with_it.n_points - without.n_points


def test_points_grow_linearly_with_sharpness():
    """At the ends of a crease: as many more with every level."""
    steps = np.diff([extra_points(12, s) for s in range(1, 9)])
    assert (steps[1:] == steps[1]).all()
    assert 0 < steps[1] < 200


def test_sharp_creases_split_nothing_more_than_boundaries():
    """Infinitely sharp ones part the faces; only at their ends are there special corners."""
    n = 12
    surface = ls.LimitSurface(grid_with_a_crease(n, INF))
    named = dict(surface.patches.summary())
    assert named.keys() == {"one regular patch", "one patch with a special corner"}
    assert named["one patch with a special corner"] == 4  # the dart


# --- Real cages

SHARED_CAGES = Path(__file__).resolve().parents[2] / "shared" / "cages"
CATMARK = sorted(path.stem for path in SHARED_CAGES.glob("catmark_*.obj"))
on_real_cages = pytest.mark.parametrize("name", CATMARK or [None])
if_real_cages = pytest.mark.skipif(not CATMARK, reason="these cages are not part of the package")


def real_cage(name):
    mesh = ls.read(SHARED_CAGES / f"{name}.obj")
    edges, sharpness = mesh.creases
    creases = dict(zip(map(tuple, edges.tolist()), sharpness.tolist(), strict=True))
    tags = {
        "creases": creases,
        "corners": dict(zip(*(x.tolist() for x in mesh.corners), strict=True)),
        "holes": mesh.holes.tolist(),
    }
    options = ("boundary", "creasing", "triangles")
    tags |= {name: getattr(mesh, name) for name in options if getattr(mesh, name)}
    return mesh.points, mesh.faces.tolist(), tags


@if_real_cages
@on_real_cages
def test_real_cages_are_naively_refined(name):
    points, faces, tags = real_cage(name)
    mesh, cage = ls.Mesh(points, faces, **tags), naive(points, faces, tags)
    levels = 3 if len(faces) < 60 else 2 if len(faces) < 200 else 1
    size = np.abs(points).max()
    for level in range(1, levels + 1):
        fine, cage = ls.refined(mesh, level), refine_times(cage, 1)
        found = fine.points[fine.indices]
        assert np.abs(found - by_corner(cage.points, cage.faces)).max() <= 5e-15 * size
    sharpness = Sharpness.of(fine, Rules.resolve(fine), numbers.FLOAT64)
    expected = [cage.creases[edge] for edges in cage.sides for edge in edges]
    assert np.array_equal(sharpness.half_edges, np.array(expected, dtype=float))


@if_real_cages
@on_real_cages
def test_real_cages_are_evaluated(name):
    points, faces, tags = real_cage(name)
    surface, oracle = both(points, faces, tags)
    rng = random.Random(name)
    sharp = {v for edge in tags["creases"] for v in edge} | set(tags["corners"])
    touched = [i for i, (f, _) in enumerate(oracle.limit_faces) if sharp & set(faces[f])]
    some = rng.sample(touched, min(len(touched), 8)) or range(len(oracle.limit_faces))
    queries = float_queries(some, 10, rng)
    queries += [(f, float(round(u)), v) for f, u, v in queries[:4]]
    assert max(accuracy(surface, oracle, queries, LOW_ORDERS[:6], floor=F(1, 100)), default=0) <= 1
    sound = ~folded(surface, *columns(queries))
    compare_normals(surface, oracle, [q for q, ok in zip(queries, sound, strict=True) if ok])
    table = ls.validate(surface, 1)
    assert not table["limit_error"] > 1e-14 * np.ptp(points, axis=0).max()


# --- Random cages of all kinds mixed

on_random_cages = settings(
    max_examples=zoo.EXAMPLES,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)


@on_random_cages
@given(zoo.tagged_cages())
def test_random_cages_are_naively_refined(cage):
    points, faces, tags = cage
    exact = fractions(points)
    mesh, coarse = ls.Mesh(exact, faces, **tags), naive(exact, faces, tags)
    levels = 2 if len(faces) < 20 else 1
    fine, R = ls.refined(mesh, levels, operator=True)
    assert_refined(fine, refine_times(coarse, levels))
    assert (R @ points == fine.points).all()
    # in floats, whose tags are rounded
    floats = ls.refined(ls.Mesh(points, faces, **tags), levels)
    assert np.abs(floats.points - fine.points.astype(float)).max() < 1e-13


@on_random_cages
@given(zoo.tagged_cages(max_steps=2), st.randoms(use_true_random=False))
def test_random_cages_are_evaluated_exactly(cage, rng):
    surface, oracle = both(*cage)
    queries = exact_queries_near(surface, 4, rng)
    assert_exact(surface, oracle, queries, [(0, 0), rng.choice(ORDERS[1:])])


@on_random_cages
@given(zoo.tagged_cages(), st.randoms(use_true_random=False))
def test_random_cages_are_evaluated_in_floats(cage, rng):
    """Close to the exact values, and to those of the refined cage."""
    points, faces, tags = cage
    surface, oracle = both(points, faces, tags)
    queries = float_queries_near(surface, 6, rng)
    assert max(accuracy(surface, oracle, queries, LOW_ORDERS[:1]), default=0) <= 1
    values = surface.evaluate(*columns(queries))
    holes = np.isin(surface.limit_faces.face[columns(queries)[0]], list(oracle.cage.holes))
    assert np.isnan(values).any(axis=1).tolist() == holes.tolist()
    sound = np.flatnonzero(~folded(surface, *columns(queries)))
    gaps = refinement_gap(surface, *(x[sound] for x in columns(queries)))
    assert gaps[0] <= 1e-13
    assert gaps[1] <= 1e-10


@on_random_cages
@given(zoo.tagged_cages(), st.randoms(use_true_random=False))
def test_random_cages_are_continuous(cage, rng):
    points, faces, tags = cage
    surface, oracle = both(points, faces, tags)
    edges = zoo.edges_of([face for face in faces if len(set(face)) == len(face)])
    if edges:
        t = F(rng.randint(0, 99), 99)
        assert_continuous(surface, oracle, faces, [rng.choice(edges)], [t])


def test_everything_is_tried():
    """The zoo holds every kind of special corner, at every position, and every kind of patch."""
    sectors, turns, reasons = set(), set(), set()
    for make in zoo.TAGGED.values():
        points, faces, tags = make()
        patches = ls.LimitSurface(ls.Mesh(points, faces, **tags)).patches
        sectors |= {patches.sectors[kind] for kind in patches.kind.tolist()}
        turns |= set(zip((patches.kind == STRIP).tolist(), patches.turn.tolist(), strict=True))
        reasons |= {reason for reason, _ in patches.summary()}
    for kind, faces in (("crease", range(1, 8)), ("corner", range(2, 7)), ("dart", range(2, 10))):
        expected = {(n, p) for n in faces for p in range(n) if (kind, n) != ("crease", 2)}
        found = {(s.faces, s.position) for s in sectors if s and s.kind == kind}
        assert found >= expected, kind
    assert {s.faces for s in sectors if s and s.kind == "cone"} >= set(range(2, 8))
    assert turns == set(itertools.product((False, True), range(4)))
    assert len(reasons) == 5


SHARPNESS = {
    "doubles": lambda g: g.uniform(0, 4),
    "integers": lambda g: g.randrange(5),
    "one_decimal": lambda g: round(g.uniform(0, 4), 1),
    "far_apart": lambda g: g.choice([5e-324, 1e-300, 1e-17, 1.0, 2.0, 3.3]),
    "fractions": lambda g: F(g.randrange(20), g.choice([3, 5, 7])),
    "near_infinite": lambda g: g.choice([math.nextafter(10, 0), F(10) - F(1, 10**30), 10, 2.5]),
}


@pytest.mark.parametrize("creasing", ["uniform", "chaikin"])
@pytest.mark.parametrize("kind", SHARPNESS)
def test_sharpness_is_exact_in_float64_too(kind, creasing):
    """Whether it has reached 0, and masks, which are those of exact numbers rounded once."""
    g = random.Random(kind)
    for points, faces in (zoo.grid(2, 3), zoo.flower(5, 1), zoo.bipyramid(3)):
        edges = [e for e in zoo.edges_of(faces) if g.random() < 0.8]
        creases = {e: SHARPNESS[kind](g) for e in edges}
        corners = {v: SHARPNESS[kind](g) for v in range(0, len(points), 4)}
        tags = {"creases": creases, "corners": corners, "creasing": creasing}
        cage = oracles_creases.start(Cage(points, faces, **tags))
        mesh = ls.Mesh(np.asarray(points, float), faces, **tags)
        for levels in (1, 2, 3):
            fine = ls.refined(mesh, levels)
            cage = oracles_creases.refine(cage)
            ends, values = fine.creases
            found = {tuple(e): s for e, s in zip(ends.tolist(), values.tolist(), strict=True)}
            hard = {tuple(e) for e in fine.edges[fine.boundary_edge].tolist()}
            expected = {e: s for e, s in cage.creases.items() if s > 0 and e not in hard}
            assert {e: s for e, s in found.items() if e not in hard} == expected
            assert dict(zip(*(x.tolist() for x in fine.corners), strict=True)) == {
                v: s for v, s in cage.corners.items() if s > 0 and v in corners
            }
            rules = Rules.resolve(mesh)
            exact, rounded = (
                Sharpness.of(fine, rules, t, exact=True)
                for t in (numbers.RATIONAL, numbers.FLOAT64)
            )
            masks = zip(
                (*exact.vertex_masks, exact.edge_masks),
                (*rounded.vertex_masks, rounded.edge_masks),
                strict=True,
            )
            assert all(a.astype(float).tolist() == b.tolist() for a, b in masks)


def test_chaikin_with_float_sharpness_costs_what_its_patches_cost():
    """Time in set-up by patch, whatever number of binary places sharpness has."""
    points, faces = zoo.grid(12, 12)
    sharpness = np.random.default_rng(0).uniform(0, 5, len(zoo.edges_of(faces)))

    def cost(values, creasing):
        creases = zoo.edges_of(faces), values
        mesh = ls.Mesh(np.asarray(points, float), faces, creases=creases, creasing=creasing)
        start = time.process_time()
        surface = ls.LimitSurface(mesh)
        return (time.process_time() - start) / len(surface.patches.kind)

    cost(sharpness, "chaikin")
    slow, fast = (min(cost(sharpness, x) for _ in range(2)) for x in ("chaikin", "uniform"))
    assert slow < 10 * fast
