"""What holds for every cage: on the whole zoo, and on random cages that hypothesis makes."""

import random
from fractions import Fraction as F

import numpy as np
import oracles
import pytest
import zoo
from hypothesis import example, given, settings
from hypothesis import strategies as st

import limitsurf as ls

HALF = F(1, 2)
ORDERS = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 1), (3, 3)]
CAGES = {name: make() for name, make in zoo.ZOO.items()}
SURFACES = [
    (name, mode)
    for name, (_, faces) in CAGES.items()
    for mode in oracles.MODES[: 2 if zoo.boundary_vertices(faces) else 1]
    if zoo.has_regular_boundary(faces, mode)
]
on_the_zoo = pytest.mark.parametrize(("name", "mode"), SURFACES)

regular_cages = zoo.cages(
    keep=zoo.has_regular_boundary, operations=[*zoo.OPERATIONS, zoo.insert_vertex]
)
any_cages = zoo.cages(operations=[*zoo.OPERATIONS, zoo.insert_vertex])
seeds = st.integers(0, 2**32 - 1)
parameters = st.one_of(
    st.fractions(0, 1, max_denominator=10**4),
    st.builds(lambda k, n: F(k, 2**n), st.integers(0, 1), st.integers(0, 60)),
    st.builds(lambda x, n: x / 10**n, st.fractions(0, 1, max_denominator=99), st.integers(0, 12)),
    st.builds(
        lambda x, n: 1 - x / 10**n, st.fractions(0, 1, max_denominator=99), st.integers(0, 9)
    ),
)
floats = st.one_of(st.floats(0, 1), st.floats(0, 1e-12), st.floats(0, 1).map(lambda x: 1 - x))


def fractions(values, divisor=1):
    """The same numbers as an object array of Fractions, divided."""
    values = np.asarray(values)
    exact = np.empty(values.size, dtype=object)
    exact[:] = [F(x) / divisor for x in values.ravel().tolist()]
    return exact.reshape(values.shape)


def shaken(name):
    points, faces = CAGES[name]
    return zoo.random_points(len(points), name), faces


def some_parameters(n, rng, size):
    """Limit faces and exact u, v: inside, on knots and on edges."""
    face = rng.choices(range(n), k=size)
    ends = [F(0), F(1), HALF, F(1, 4)]
    u, v = ([rng.choice([*ends, F(rng.randint(0, 96), 96)]) for _ in face] for _ in "uv")
    return np.array(face), fractions(u), fractions(v)


def same(a, b):
    """Equality of arrays of Fractions, NaN matching NaN."""
    a, b = np.asarray(a), np.asarray(b)
    pairs = zip(a.ravel(), b.ravel(), strict=True)
    return a.shape == b.shape and all(x == y or (x != x and y != y) for x, y in pairs)


# --- Exactness on random cages


@settings(max_examples=60)
@given(regular_cages, st.lists(st.tuples(seeds, parameters, parameters), min_size=1, max_size=4))
def test_exact_on_random_cages(cage, queries):
    """Positions and derivatives are the oracle's, float points counting as rationals."""
    points, faces = cage
    surface, oracle = ls.LimitSurface(ls.Mesh(points, faces)), oracles.ExactSurface(points, faces)
    queries = [(seed % len(surface.limit_faces), u, v) for seed, u, v in queries]
    face, u, v = (np.array(x) for x in zip(*queries, strict=True))
    for nu in ((0, 0), (1, 0), (1, 2)):
        assert same(
            surface.evaluate(face, u, v, nu=nu), [oracle.evaluate(*q, nu=nu) for q in queries]
        )


@settings(max_examples=30)
@given(regular_cages, seeds, floats, floats)
def test_floats_are_near_the_exact_value(cage, seed, u, v):
    points, faces = cage
    surface, oracle = ls.LimitSurface(ls.Mesh(points, faces)), oracles.ExactSurface(points, faces)
    face = seed % len(surface.limit_faces)
    exact = oracle.evaluate(face, u, v)
    size = np.ptp(points[oracle._neighbourhood(face)[1]], axis=0).max()
    value = surface.evaluate(face, u, v)
    allowed = 1e-14 * size + 2 * np.spacing(np.abs(value))
    errors = [float(abs(F(x) - y)) for x, y in zip(value.tolist(), exact, strict=True)]
    assert (errors <= allowed).all()


@settings(max_examples=40)
@given(any_cages, st.integers(1, 2), st.sampled_from(oracles.MODES))
def test_refined_is_naively_refined(cage, levels, mode):
    points, faces = cage
    fine, R = ls.refined(ls.Mesh(fractions(points), faces), levels, operator=True, boundary=mode)
    naive, children = oracles.refine_times(fractions(points).tolist(), faces, levels, mode)
    assert [tuple(p) for p in fine.points.tolist()] == naive
    assert fine.faces.tolist() == children
    assert (R @ points == fine.points).all()


@settings(max_examples=25)
@given(regular_cages, st.integers(0, 2), seeds)
def test_refined_vertices_lie_on_the_surface(cage, levels, seed):
    """Moved to their limits, at their parents' parameters, exactly; with their normals."""
    points, faces = cage
    mesh = ls.Mesh(fractions(points), faces)
    fine = ls.refined(mesh, levels)
    some = random.Random(seed).choices(np.flatnonzero(fine.vertex_faces > 0).tolist(), k=12)
    parents = fine.parent_face[some], fine.parent_u[some], fine.parent_v[some]
    assert same(ls.LimitSurface(mesh).evaluate(*parents), fine.limit_points[some])


# --- Weights


@settings(max_examples=30)
@given(regular_cages, seeds, st.sampled_from(ORDERS))
def test_weights_reproduce_affine_functions(cage, seed, nu):
    """Rows sum to one (derivatives: to zero); weights times points is the value, exactly."""
    points, faces = cage
    surface = ls.LimitSurface(ls.Mesh(points, faces))
    query = some_parameters(len(surface.limit_faces), random.Random(seed), 4)
    W = surface.weights(*query, nu=nu)
    values = surface.evaluate(*query, nu=nu)
    assert same(W @ points, values)
    totals = (W @ np.ones(len(points), dtype=int)).tolist()
    for total, value in zip(totals, values, strict=True):
        assert total == (nu == (0, 0)) or any(x != x for x in value)


@on_the_zoo
def test_affine_invariance(name, mode):
    """Exactly: the surface of a mapped cage is the mapped surface."""
    points, faces = shaken(name)
    surface = ls.LimitSurface(ls.Mesh(points, faces), boundary=mode)
    matrix, shift = [[2, -1, 0], [F(1, 3), 1, 5], [7, 0, F(-2, 7)]], [100, F(1, 7), -3]
    mapped = surface.with_points(fractions(points) @ fractions(matrix).T + fractions(shift))
    query = some_parameters(len(surface.limit_faces), random.Random(name), 6)
    for nu in ((0, 0), (1, 1)):
        values = surface.evaluate(*query, nu=nu) @ fractions(matrix).T
        expected = values + fractions(shift) if nu == (0, 0) else values
        assert same(mapped.evaluate(*query, nu=nu), expected)
    face, u, v = query[0], query[1].astype(float), query[2].astype(float)
    turn = np.array([[0.6, 0, 0.8], [0, 1, 0], [-0.8, 0, 0.6]])
    turned = surface.with_points(points @ turn.T * 3 + [5, 6, 7])
    error = turned.normal(face, u, v) - surface.normal(face, u, v) @ turn.T
    sound = ~fold(surface, face, u, v)
    assert not (np.abs(error)[sound] > 1e-12).any()


def fold(surface, face, u, v):
    """Where one first derivative vanishes beside the other: on the edges of a pillow."""
    along, across = (np.abs(surface.evaluate(face, u, v, nu=nu)).max(-1) for nu in ((1, 0), (0, 1)))
    return np.minimum(along, across) < 1e-6 * np.maximum(along, across)


# --- The same surface, written differently


def limit_face_numbers(faces):
    """{(face, corner): limit face}, corner 0 to 3 of a quad all being the same one."""
    numbers = {}
    for i, (f, k) in enumerate(oracles.limit_faces(faces)):
        for corner in range(4) if k == -1 else [k]:
            numbers[f, corner] = i
    return numbers


def turned_query(n, k, corner, u, v):
    """Where (u, v) of limit face `corner` goes when a face of n corners begins at corner k.

    Returns the corner of the new limit face, its u and v, and how derivatives turn: the new order
    of (i, j) and its sign.
    """
    if n != 4:
        return (corner - k) % n, u, v, lambda i, j: ((i, j), 1)
    return [
        (0, u, v, lambda i, j: ((i, j), 1)),
        (0, v, 1 - u, lambda i, j: ((j, i), (-1) ** i)),
        (0, 1 - u, 1 - v, lambda i, j: ((i, j), (-1) ** (i + j))),
        (0, 1 - v, u, lambda i, j: ((j, i), (-1) ** j)),
    ][k]


@on_the_zoo
def test_relabelled_vertices_and_rotated_faces(name, mode):
    """Exactly the same surface: positions, derivatives; normals to rounding."""
    points, faces = shaken(name)
    rng = random.Random(name)
    new = rng.sample(range(len(points)), len(points))
    order = rng.sample(range(len(faces)), len(faces))
    starts = [rng.randrange(len(face)) for face in faces]
    changed = [[new[v] for v in faces[f][starts[f] :] + faces[f][: starts[f]]] for f in order]
    surface = ls.LimitSurface(ls.Mesh(points, faces), boundary=mode)
    other = ls.LimitSurface(ls.Mesh(points[np.argsort(new)], changed), boundary=mode)
    numbers, targets = oracles.limit_faces(faces), limit_face_numbers(changed)
    u, v = [F(1, 3), F(0), F(1), F(3, 4)], [F(5, 7), F(0), HALF, F(1)]
    for i in rng.sample(range(len(numbers)), min(4, len(numbers))):
        f, corner = numbers[i]
        for s, t in zip(u, v, strict=True):
            k, a, b, turn = turned_query(len(faces[f]), starts[f], max(corner, 0), s, t)
            j = targets[order.index(f), k]
            assert (surface.evaluate(i, s, t) == other.evaluate(j, a, b)).all()
            normals = surface.normal(i, float(s), float(t)), other.normal(j, float(a), float(b))
            if not fold(surface, i, float(s), float(t)):
                assert np.allclose(*normals, rtol=0, atol=1e-12, equal_nan=True)
        for nu in ((1, 0), (2, 1)):  # not on a knot, where it depends on the side
            k, a, b, turn = turned_query(len(faces[f]), starts[f], max(corner, 0), u[0], v[0])
            turned, sign = turn(*nu)
            there = other.evaluate(targets[order.index(f), k], a, b, nu=turned) * sign
            assert (surface.evaluate(i, u[0], v[0], nu=nu) == there).all()


@settings(max_examples=30)
@given(regular_cages, seeds)
@example(CAGES["relabelled_sphere"], 1)
def test_relabelling_random_cages(cage, seed):
    points, faces = cage
    rng = random.Random(seed)
    new = rng.sample(range(len(points)), len(points))
    surface = ls.LimitSurface(ls.Mesh(points, faces))
    renamed = [[new[v] for v in face] for face in faces]
    other = ls.LimitSurface(ls.Mesh(points[np.argsort(new)], renamed))
    query = some_parameters(len(surface.limit_faces), rng, 6)
    for nu in ((0, 0), (1, 0), (2, 2)):
        assert same(surface.evaluate(*query, nu=nu), other.evaluate(*query, nu=nu))


def test_refinement_of_a_relabelled_mesh():
    points, faces = shaken("carved_cylinder")
    new = random.Random(1).sample(range(len(points)), len(points))
    fine = ls.refined(ls.Mesh(fractions(points), faces), 2)
    other = ls.refined(
        ls.Mesh(fractions(points)[np.argsort(new)], [[new[v] for v in face] for face in faces]), 2
    )
    assert (fine.points[fine.uniform] == other.points[other.uniform]).all()


@on_the_zoo
def test_a_refined_cage_has_the_same_surface(name, mode):
    """Each child holds a quadrant of its parent (of an n-gon: a whole limit face), exactly."""
    points, faces = shaken(name)
    mesh = ls.Mesh(fractions(points), faces, boundary=mode)
    surface, fine = ls.LimitSurface(mesh), ls.LimitSurface(ls.refined(mesh))
    rng = random.Random(name)
    child_of = [
        (i, k if corner == -1 else None)
        for i, (_, corner) in enumerate(oracles.limit_faces(faces))
        for k in (range(4) if corner == -1 else [0])
    ]
    for child in rng.sample(range(len(child_of)), min(8, len(child_of))):
        i, k = child_of[child]
        s, t = F(rng.randint(0, 30), 30), F(rng.randint(0, 31), 31)
        u, v = (s, t) if k is None else [(s, t), (2 - t, s), (2 - s, 2 - t), (t, 2 - s)][k]
        scale = 1 if k is None else 2
        assert (surface.evaluate(i, u / scale, v / scale) == fine.evaluate(child, s, t)).all()


# --- Continuity


def sides(faces):
    """The two (face, corner) of every interior edge, corner being where its half-edge begins."""
    at = {edge: (f, k) for f, face in enumerate(faces) for k, edge in enumerate(half_edges(face))}
    return [(at[a, b], at[b, a]) for a, b in at if a < b and (b, a) in at]


def half_edges(face):
    return list(zip(face, face[1:] + face[:1], strict=True))


def on_side(faces, numbers, side, t):
    """Limit face, u, v at the fraction t of the way along a side of a face; 2 or 1 per unit."""
    f, k = side
    n = len(faces[f])
    if n == 4:
        (a, b), (c, d) = oracles.CORNERS[k], oracles.CORNERS[(k + 1) % 4]
        return numbers[f, k], a + t * (c - a), b + t * (d - b)
    if t <= HALF:
        return numbers[f, k], 2 * t, F(0)
    return numbers[f, (k + 1) % n], F(0), 2 - 2 * t


def cross(a, b):
    return np.stack(
        [a[..., i - 2] * b[..., i - 1] - a[..., i - 1] * b[..., i - 2] for i in range(3)], -1
    )


def edge_queries(faces, edges, fractions_of_the_edge):
    """Queries from both sides of each edge in turn, and the length of each side in parameters."""
    numbers = limit_face_numbers(faces)
    queries, lengths = [], []
    for one, other in edges:
        for t in fractions_of_the_edge:
            queries += [on_side(faces, numbers, one, t), on_side(faces, numbers, other, 1 - t)]
            lengths += [1 if len(faces[f]) == 4 else 2 for f, _ in (one, other)]
    return *(np.array(x) for x in zip(*queries, strict=True)), np.array(lengths)


@pytest.mark.parametrize(("name", "mode"), [pair for pair in SURFACES if sides(CAGES[pair[0]][1])])
def test_continuity_across_every_edge(name, mode):
    """Position and tangent plane agree on both sides of every edge, also at its ends."""
    points, faces = shaken(name)
    surface = ls.LimitSurface(ls.Mesh(points, faces), boundary=mode)
    face, u, v, _ = edge_queries(faces, sides(faces), [F(0), F(1, 7), HALF, F(5, 8), F(1)])
    u, v = u.astype(float), v.astype(float)
    values, normals = surface.evaluate(face, u, v), surface.normal(face, u, v)
    assert np.abs(values[::2] - values[1::2]).max() <= 1e-14
    flat = fold(surface, face, u, v).reshape(-1, 2).any(axis=1)
    assert not flat.any() or "pillow" in name or name == "disconnected"
    first, second = normals[::2][~flat], normals[1::2][~flat]
    assert np.allclose(first, second, rtol=0, atol=1e-12, equal_nan=True)


@pytest.mark.parametrize(("name", "mode"), [pair for pair in SURFACES if sides(CAGES[pair[0]][1])])
def test_exact_continuity(name, mode):
    """The same with no tolerance, on some edges: d/du x d/dv is the same vector on both sides.

    A limit face of an n-gon is half as long as one of a quad, in both directions.
    """
    points, faces = shaken(name)
    surface = ls.LimitSurface(ls.Mesh(points, faces), boundary=mode)
    edges = sides(faces)
    some = random.Random(name).sample(edges, min(len(edges), 12))
    *queries, lengths = edge_queries(faces, some, [F(0), F(1, 7), HALF])
    values = surface.evaluate(*queries)
    assert (values[::2] == values[1::2]).all()
    normals = cross(surface.evaluate(*queries, nu=(1, 0)), surface.evaluate(*queries, nu=(0, 1)))
    normals = normals * lengths[:, None] ** 2
    assert same(normals[::2], normals[1::2])


@on_the_zoo
def test_continuity_around_every_vertex(name, mode):
    """All faces at a vertex agree on its limit and its unit normal, and nearly so beside it."""
    points, faces = shaken(name)
    surface = ls.LimitSurface(ls.Mesh(points, faces), boundary=mode)
    numbers = limit_face_numbers(faces)
    corners = [(v, f, k) for f, face in enumerate(faces) for k, v in enumerate(face)]
    vertex = np.array([v for v, _, _ in corners])
    face = np.array([numbers[f, k] for _, f, k in corners])
    u, v = np.array(
        [oracles.CORNERS[k] if len(faces[f]) == 4 else (0, 0) for _, f, k in corners], dtype=float
    ).T
    first = {v: i for i, v in reversed(list(enumerate(vertex.tolist())))}
    other = np.array([first[v] for v in vertex.tolist()])
    values, normals = surface.evaluate(face, u, v), surface.normal(face, u, v)
    assert np.abs(values - values[other]).max() <= 1e-14
    assert np.allclose(normals, normals[other], rtol=0, atol=1e-12, equal_nan=True)
    near = surface.evaluate(face, np.clip(u, 1e-9, 1 - 1e-9), v)
    assert np.abs(near - values).max() < 1e-5


@settings(max_examples=25)
@given(regular_cages, seeds, st.fractions(0, 1, max_denominator=1000))
def test_continuity_on_random_cages(cage, seed, t):
    points, faces = cage
    edges = sides(faces)
    if not edges:
        return
    surface = ls.LimitSurface(ls.Mesh(points, faces))
    *queries, lengths = edge_queries(faces, [edges[seed % len(edges)]], [t])
    here, there = surface.evaluate(*queries)
    assert same(here, there)
    normals = cross(surface.evaluate(*queries, nu=(1, 0)), surface.evaluate(*queries, nu=(0, 1)))
    here, there = normals * lengths[:, None] ** 2
    assert same(here, there)
