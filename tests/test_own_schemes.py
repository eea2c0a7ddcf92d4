"""Schemes that users make: exact where they have a limit, refused by name where they have none.

The oracle refines a cage vertex by vertex from masks typed here, and takes the limits of vertices
amid regular ones by the masks of papers: 1/2 and 1/12 (Loop 1987), 4/9, 1/9 and 1/36 (Halstead,
Kass and DeRose 1993). It knows no matrix and no eigenvalue.
"""

import itertools
import multiprocessing
import pickle
import re
import warnings
from fractions import Fraction as F

import numpy as np
import oracles_doo_sabin
import pytest
import sympy
from oracles_creases import Cage

import limitsurf as ls
from limitsurf import tables
from limitsurf.exact.fixed import UnsupportedSpectrum
from limitsurf.scheme.doo_sabin import DOO_SABIN
from limitsurf.tables import cache

# --- schemes --------------------------------------------------------------------------------------

# of an edge from a vertex of that many triangles: it, the other end, each point across
SPOKES = {
    5: (F(17, 50), F(2, 5), F(13, 100)),
    7: (F(3, 10), F(33, 100), F(37, 200)),
    8: (F(1, 4), F(35, 100), F(1, 5)),
}
QUAD_SPOKES = {3: (F(1, 5), F(3, 10), F(1, 4)), 5: (F(3, 10), F(1, 5), F(1, 4))}
# of the vertex and of each neighbour; of the vertex, each neighbour and each face point
VERTICES = {n: (F(11, 20), F(9, 20) / n) for n in (3, 4, 5, 7, 8)}
QUAD_VERTICES = {n: (F(2, 5), F(3, 10) / n, F(3, 10) / n) for n in (3, 5, 6, 7)}


def spoke(a, b):
    return own_edge(a, b, 6, SPOKES, (F(3, 8), F(3, 8), F(1, 8)))


def quad_spoke(a, b):
    return own_edge(a, b, 4, QUAD_SPOKES, (F(1, 4),) * 3)


def own_edge(a, b, regular, spokes, plain):
    """Own masks where one end is regular, else those of regular edges."""
    if (a == regular) == (b == regular):
        return plain
    own, other, across = spokes.get(a if b == regular else b, plain)
    return (own, other, across) if b == regular else (other, own, across)


SCHEMES = {
    "triangles": ls.Scheme("own triangles", lattice="triangles", vertex=VERTICES),
    "spoked triangles": ls.Scheme("own spokes", lattice="triangles", vertex=VERTICES, edge=spoke),
    "quads": ls.Scheme("own quads", vertex=QUAD_VERTICES),
    "spoked quads": ls.Scheme("own quad spokes", vertex=QUAD_VERTICES, edge=quad_spoke),
}
EVERY = pytest.mark.parametrize("name", SCHEMES)


def masks(name):
    """Vertex and edge masks in float64, of any valence."""
    quads = "quads" in name
    vertices = QUAD_VERTICES | {4: (F(1, 2), F(1, 16), F(1, 16))} if quads else VERTICES
    if not quads:
        vertices = vertices | {6: (F(5, 8), F(1, 16))}
    plain = (F(1, 4),) * 3 if quads else (F(3, 8), F(3, 8), F(1, 8))
    edge = {"spoked quads": quad_spoke, "spoked triangles": spoke}.get(name, lambda a, b: plain)
    return {n: [*map(float, w)] for n, w in vertices.items()}, edge


def fan(n, size, layers=3, seed=0):
    """A cage around vertex 0 of n faces of so many corners."""
    turn = 2 * np.pi * np.arange(n + 1) / n
    axis = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    number, points, faces = {}, [], []

    def at(i, a, b):
        place = (0, 0, 0) if a == b == 0 else ((i + 1) % n, b, 0) if a == 0 else (i, a, b)
        if place not in number:
            number[place] = len(number)
            points.append(a * axis[i] + b * axis[i + 1])
        return number[place]

    at(0, 0, 0)
    for i, a, b in itertools.product(range(n), range(layers), range(layers)):
        if size == 4:
            faces.append([at(i, a, b), at(i, a + 1, b), at(i, a + 1, b + 1), at(i, a, b + 1)])
        elif a + b < layers:
            faces.append([at(i, a, b), at(i, a + 1, b), at(i, a, b + 1)])
            if a + b < layers - 1:
                faces.append([at(i, a + 1, b + 1), at(i, a, b + 1), at(i, a + 1, b)])
    height = np.random.default_rng(seed).normal(size=(len(points), 3)) * 0.2
    return np.pad(points, ((0, 0), (0, 1))) + height, faces


def edges_of(faces):
    found = {}
    for f, face in enumerate(faces):
        for k, a in enumerate(face):
            found.setdefault(frozenset((a, face[k - 1])), []).append((f, k))
    return found


def refined(points, faces, name):
    """One naive step. What is on the boundary goes by the cubic B-spline."""
    vertex, edge = masks(name)
    size, edges, count = len(faces[0]), edges_of(faces), np.bincount(np.ravel(faces))
    rim = {v for e, sides in edges.items() if len(sides) == 1 for v in e}
    centres = points[np.array(faces)].mean(axis=1)
    regular = 6 if size == 3 else 4
    valence = [regular if v in rim else int(count[v]) for v in range(len(points))]
    ring, around, beside = ([[] for _ in points] for _ in range(3))
    new, number = [None] * len(points), {}
    for e, sides in edges.items():
        a, b = e
        ring[a].append(b)
        ring[b].append(a)
        number[e] = len(new)
        if len(sides) == 1:
            beside[a].append(b)
            beside[b].append(a)
            new.append((points[a] + points[b]) / 2)
            continue
        one, other, across = map(float, edge(valence[a], valence[b]))
        far = [centres[f] if size == 4 else points[faces[f][(k + 1) % 3]] for f, k in sides]
        new.append(one * points[a] + other * points[b] + across * sum(far))
    for f, face in enumerate(faces):
        for v in face:
            around[v].append(centres[f])
    for v in range(len(points)):
        if v in rim and count[v] == 1:
            new[v] = points[v]
        elif v in rim:
            new[v] = 0.75 * points[v] + sum(points[w] for w in beside[v]) / 8
        if v in rim:
            continue
        own, near, *faced = vertex[valence[v]]
        new[v] = own * points[v] + near * points[ring[v]].sum(axis=0)
        for weight in faced:
            new[v] = new[v] + weight * np.sum(around[v], axis=0)
    children = []
    for f, face in enumerate(faces):
        middle = [number[frozenset((a, face[(k + 1) % size]))] for k, a in enumerate(face)]
        for k, a in enumerate(face):
            child = [a, middle[k], middle[k - 1]]
            children.append(child if size == 3 else [*child[:2], len(new) + f, child[2]])
        if size == 3:
            children.append([middle[1], middle[2], middle[0]])
    new += [*centres] if size == 4 else []
    return np.array(new), children


def parameters(n_faces, size, levels):
    """Limit face and (u, v) of the corners of all refined faces, in order."""
    corners = {3: [(0, 0), (1, 0), (0, 1)], 4: [(0, 0), (1, 0), (1, 1), (0, 1)]}[size]
    found = [(f, corners) for f in range(n_faces)]
    for _ in range(levels):
        finer = []
        for f, own in found:
            middle = [np.add(own[k], own[(k + 1) % size]) / 2 for k in range(size)]
            centre = np.mean(own, axis=0)
            for k in range(size):
                child = [own[k], middle[k], middle[k - 1]]
                finer.append((f, child if size == 3 else [*child[:2], centre, child[2]]))
            if size == 3:
                finer.append((f, [middle[1], middle[2], middle[0]]))
        found = finer
    return found


def limits(points, faces):
    """Limits of vertices amid regular ones, by number."""
    size, edges, count = len(faces[0]), edges_of(faces), np.bincount(np.ravel(faces))
    regular = 6 if size == 3 else 4
    odd = {v for e, sides in edges.items() if len(sides) == 1 for v in e}
    odd |= {v for v, n in enumerate(count) if n not in (0, regular)}
    near, corners = ({v: set() for v in range(len(points))} for _ in range(2))
    for face in faces:
        for v in face:
            corners[v] |= {*face}
    for a, b in edges:
        near[a].add(b)
        near[b].add(a)
    found = {}
    for v in near:
        if v in odd or corners[v] & odd:
            continue
        beyond = corners[v] - near[v] - {v}
        if size == 3:
            found[v] = points[v] / 2 + points[[*near[v]]].sum(axis=0) / 12
        else:
            found[v] = (4 * points[v] + points[[*near[v]]].sum(axis=0)) / 9
            found[v] = found[v] + points[[*beyond]].sum(axis=0) / 36
    return found


@EVERY
@pytest.mark.parametrize("n", [3, 5, 7])
def test_surfaces_are_naively_refined_ones(name, n):
    """Values are those of the limit at all vertices of three levels; so is the refined mesh."""
    size = 4 if "quads" in name else 3
    points, faces = fan(n, size)
    surface = ls.LimitSurface(ls.Mesh(points, faces), scheme=SCHEMES[name])
    finer, children = points, faces
    for _ in range(3):
        finer, children = refined(finer, children, name)
    given = ls.refined(ls.Mesh(points, faces), 3, scheme=SCHEMES[name])
    places = parameters(len(faces), size, 3)
    ordered = np.empty_like(given.points)
    ordered[given.faces] = finer[np.array(children)]
    assert np.abs(given.points - ordered).max() < 1e-14
    found = limits(finer, children)
    assert len(found) > 100
    seen = {}
    for (f, corners), child in zip(places, children, strict=True):
        seen |= {v: (f, *at) for v, at in zip(child, corners, strict=True) if v in found}
    f, u, v = np.array([*seen.values()]).T
    needed = np.array([found[k] for k in seen])
    value = surface.evaluate(f.astype(int), u, v)
    assert np.abs(value - needed).max() < 1e-14
    W = surface.weights(f.astype(int), u, v)
    assert np.abs(W @ points - needed).max() < 1e-14
    near = surface.evaluate(0, 0.0, 0.0)  # at the vertex itself
    finest = ls.refined(ls.Mesh(points, faces), 5, scheme=SCHEMES[name])
    assert np.abs(finest.points[0] - near).max() < 0.05
    assert np.abs(finest.limit_points[0] - near).max() < 1e-14


@pytest.mark.parametrize("name", ["spoked triangles", "spoked quads"])
def test_derivatives_with_spokes_are_those_of_the_surface(name):
    """By differences of values, in Fractions: no digit of them is lost."""
    size = 4 if "quads" in name else 3
    points, faces = fan(5, size)
    exact = np.vectorize(lambda x: F(x).limit_denominator(100), otypes=[object])(points)
    surface = ls.LimitSurface(ls.Mesh(exact, faces), scheme=SCHEMES[name])
    floats = surface.with_points(exact.astype(float))
    step = F(1, 1 << 40)
    for u, v in ((F(1, 5), F(1, 7)), (F(1, 40), F(1, 300)), (F(3, 5), F(1, 9)), (F(1, 9), F(5, 7))):
        for du, dv in ((1, 0), (0, 1)):
            move = step * du, step * dv
            for nu in ((0, 0), (1, 0), (0, 1)):
                here = [
                    surface.evaluate(0, u + s * move[0], v + s * move[1], nu=nu) for s in (-1, 1)
                ]
                quotient = (here[1] - here[0]) / (2 * step)
                order = nu[0] + du, nu[1] + dv
                value = floats.evaluate(0, float(u), float(v), nu=order)
                assert np.abs(quotient.astype(float) - value).max() < 1e-9
    exact_value = surface.evaluate(0, F(1, 40), F(1, 300)).astype(float)
    assert np.abs(exact_value - floats.evaluate(0, 1 / 40, 1 / 300)).max() < 1e-15


@pytest.mark.parametrize("name", ["spoked triangles", "spoked quads"])
def test_normals_with_spokes_approach_that_of_the_vertex(name):
    size = 4 if "quads" in name else 3
    points, faces = fan(5, size)
    surface = ls.LimitSurface(ls.Mesh(points, faces), scheme=SCHEMES[name])
    assert ls.spectral_analysis(SCHEMES[name], valence=5).c1
    at, h = surface.normal(0, 0.0, 0.0), 2.0 ** -np.arange(20, 1000, 140)
    near = np.concatenate([surface.normal(0, a * h, b * h) for a, b in ((1, 0), (0.3, 0.6))])
    assert np.abs(near[:: len(h)] - at).max() < 0.1
    assert np.abs(near[len(h) - 1 :: len(h)] - at).max() < 1e-12
    curvature = surface.curvature(0, 0.3 * h, 0.2 * h)
    assert np.isfinite(curvature.k1).all()
    exact = ls.eigenbasis(SCHEMES[name], valence=5)
    assert exact.exact.residual.is_zero_matrix


def test_spokes_scale_waves():
    """Of frequency f by b + 2 c cos(2 pi f / N): b of the far end, c of what lies across."""
    for n, (_, b, c) in SPOKES.items():
        found = ls.spectral_analysis(SCHEMES["spoked triangles"], valence=n)
        cosine = np.cos(2 * np.pi / n), np.cos(4 * np.pi / n)
        waves = [float(b) + 2 * float(c) * x for x in cosine]
        assert found.subdominant == pytest.approx((waves[0],) * 2, abs=1e-15)
        (second,) = (m for m in found.curvature.by_frequency if m.frequency == 2)
        assert second.rate == pytest.approx(max(waves[1], 1 / 8) / waves[0] ** 2, abs=1e-14)
        assert (found.regular, found.injective, found.c1) == (True, True, True)


def test_crowded_cages_with_spokes_are_split_until_their_vertices_are_apart():
    """Faces with two such vertices, and faces beside one."""
    points = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, -1.0]])
    faces = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1], [5, 2, 1], [5, 3, 2], [5, 4, 3], [5, 1, 4]]
    quarter = {(4, 4): (F(1, 3), F(1, 3), F(1, 6)), (4, 6): (F(2, 5), F(3, 10), F(3, 20))}

    def edge(a, b):
        first, second, across = quarter.get((min(a, b), max(a, b)), (F(3, 8), F(3, 8), F(1, 8)))
        return (first, second, across) if a <= b else (second, first, across)

    scheme = ls.Scheme("octahedral", lattice="triangles", vertex=VERTICES, edge=edge)
    mesh = ls.Mesh(points, faces)
    surface, fine = ls.LimitSurface(mesh, scheme=scheme), ls.refined(mesh, 4, scheme=scheme)
    found = surface.evaluate(fine.parent_face, fine.parent_u, fine.parent_v)
    assert np.abs(found - fine.limit_points).max() < 1e-14


def test_what_spokes_do_not_have_is_refused():
    points, faces = fan(5, 3)
    mesh, scheme = ls.Mesh(points, faces), SCHEMES["spoked triangles"]
    surface = ls.LimitSurface(mesh, scheme=scheme)
    assert len(ls.tessellate(surface, 2).points)
    for call in (
        lambda: ls.bezier_patches(surface),
        lambda: ls.closest_point(surface, [[0.0, 0, 0]]),
        lambda: ls.area(surface),
        lambda: ls.sample(surface, 5),
    ):
        with pytest.raises(ValueError, match=r"'own spokes' has masks of its own for edges at"):
            call()
    dart = ls.Mesh(points, faces, creases={(0, 1): np.inf})
    with pytest.raises(UnsupportedSpectrum, match=r"'own spokes': at a dart of 5 faces edges have"):
        ls.LimitSurface(dart, scheme=scheme).evaluate(0, 0, 0)


# --- dual schemes ---------------------------------------------------------------------------------


def circulant(values, n):
    """The mask of an n-gon on whose waves a step has these eigenvalues."""
    waves = [values[min(f, n - f)] for f in range(n)]
    cosine = oracles_doo_sabin.cosine
    return tuple(sum(x * cosine(F(f * j, n)) for f, x in enumerate(waves)) / n for j in range(n))


BOUNDED = {
    3: circulant((F(1), F(1, 2)), 3),
    6: circulant((F(1), F(1, 2), F(1, 5), F(1, 6)), 6),
}


def test_a_dual_scheme_is_its_naive_refinement(monkeypatch):
    scheme = ls.DualScheme("bounded", corner=BOUNDED)
    regular = oracles_doo_sabin.mask(4)
    monkeypatch.setattr(oracles_doo_sabin, "mask", (BOUNDED | {4: regular}).__getitem__)
    hexagon = [[np.cos(a), np.sin(a)] for a in np.pi / 3 * np.arange(6)]
    points = [[F(x).limit_denominator(50) for x in (*p, z)] for z in (0, 1) for p in hexagon]
    sides = [[k, (k + 1) % 6, 6 + (k + 1) % 6, 6 + k] for k in range(6)]
    faces = [[5, 4, 3, 2, 1, 0], [6, 7, 8, 9, 10, 11], *sides]
    mesh = ls.Mesh(points, faces)
    surface = ls.LimitSurface(mesh, scheme=scheme)
    floats = surface.with_points(np.array(points, dtype=float))
    oracle = oracles_doo_sabin.DooSabinSurface(Cage([*map(tuple, points)], faces))
    for face, u, v in (
        (0, F(1, 3), F(1, 5)),
        (3, F(0), F(1, 8)),
        (12, F(1, 7), F(6, 7)),
        (1, 0, 0),
    ):
        needed = oracle.evaluate(face, F(u), F(v))
        assert surface.evaluate(face, F(u), F(v)).tolist() == list(needed)
        near = floats.evaluate(face, float(u), float(v))
        assert np.abs(near - np.array(needed, dtype=float)).max() < 1e-14
    found = ls.spectral_analysis(scheme, valence=6)
    assert (found.c1, found.curvature.behaviour) == (True, "bounded")
    assert ls.spectral_analysis("doo-sabin", valence=6).curvature.behaviour == "unbounded"


# --- refused --------------------------------------------------------------------------------------


def at_five(weights):
    """A vertex mask of quads that is another at valence 5."""
    share = F(1, 16)
    return lambda N: weights(N) if N == 5 else (F(1, 2), share * 4 / N, share * 4 / N)


def changing():
    numbers = itertools.count(3)
    return lambda N: (F(1, 2), F(1, 4 * N) - F(1, k := next(numbers)), F(1, 4 * N) + F(1, k))


REFUSED = {
    "float": (at_five(lambda N: (0.5, 0.05, 0.05)), r".* is the float 0\.5, .*Fraction\(1, 2\)"),
    "NaN": (at_five(lambda N: (F(1), F(0), float("nan"))), r".*weight 2 is nan, need a Fraction"),
    "NaN of sympy": (at_five(lambda N: (F(1), F(0), sympy.nan)), r".*weight 2 is of type NaN"),
    "symbol": (at_five(lambda N: (F(1), F(0), sympy.Symbol("w"))), r".*weight 2 is of type Symbol"),
    "float of sympy": (at_five(lambda N: (sympy.Float(1), F(0), F(0))), r".*weight 0 is the float"),
    "pi": (at_five(lambda N: (1 - sympy.pi, F(0), sympy.pi / 5)), r".*weight 0 is of type Add"),
    "complex": (at_five(lambda N: (1 - 5 * sympy.I, sympy.I, F(0))), r".*weight 0 is of type Add"),
    "bool": (at_five(lambda N: (True, F(0), F(0))), r".*weight 0 is of type bool"),
    "raises": (at_five(lambda N: F(1, N - 5)), r"raised ZeroDivisionError"),
    "none": (at_five(lambda N: None), r"must be 3 Fractions, got None"),
    "text": (at_five(lambda N: "100"), r"must be 3 Fractions, got '100'"),
    "endless": (at_five(lambda N: itertools.repeat(F(1))), r"must be 3 Fractions"),
    "too few": (at_five(lambda N: (F(1, 2), F(1, 10))), r"must be 3 Fractions"),
    "sum": (at_five(lambda N: (F(1, 2), F(1, 5), F(1, 5))), r"sums to 5/2, not to 1"),
    "huge": (at_five(lambda N: (F(10**400), F(0), F(1 - 10**400, 5))), r".*larger than 1e100"),
    "changes": (at_five(changing()), r"is \(.*\), but was \(.*\) when it was asked before"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
@pytest.mark.parametrize("use", [ls.LimitSurface, ls.refined])
def test_masks_that_are_none_are_refused(name, use):
    vertex, complaint = REFUSED[name]
    scheme = ls.Scheme("wicked", vertex=vertex)
    mesh = ls.Mesh(*fan(5, 4, layers=2))
    with pytest.raises(ValueError, match=rf"'wicked': vertex\(5\) {complaint}"):
        use(mesh, scheme=scheme)


def test_a_mask_that_depends_on_something_else_is_refused_when_that_changes():
    state = [F(1, 20)]
    scheme = ls.Scheme("moody", vertex=at_five(lambda N: (1 - 10 * state[0], state[0], state[0])))
    mesh = ls.Mesh(*fan(5, 4, layers=2))
    before = ls.LimitSurface(mesh, scheme=scheme).evaluate(0, 0.1, 0.2)
    state[0] = F(1, 25)
    with pytest.raises(ValueError, match=r"'moody': vertex\(5\) is \(3/5, 1/25, 1/25\), but was"):
        ls.LimitSurface(mesh, scheme=scheme)
    # another scheme of this name has other tables
    again = ls.Scheme("moody", vertex=at_five(lambda N: (F(1, 2), F(1, 20), F(1, 20))))
    other = ls.Scheme("moody", vertex=scheme.vertex)
    values = [ls.LimitSurface(mesh, scheme=x).evaluate(0, 0.1, 0.2) for x in (again, other)]
    assert np.array_equal(values[0], before)
    assert np.abs(values[1] - before).max() > 1e-3


def test_faces_have_no_first_corner():
    faces = {5: (F(2, 5), *[F(3, 20)] * 4)}
    scheme = ls.Scheme("leaning", face=faces, vertex=QUAD_VERTICES)
    with pytest.raises(ValueError, match=r"'leaning': face\(5\) is .* must be alike, 1/5"):
        ls.refined(ls.Mesh(np.eye(5), [[0, 1, 2, 3, 4]]), scheme=scheme)


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        ({"name": "loop"}, "'loop': there is one of this name in limitsurf.schemes"),
        ({"name": "none"}, "'none': there is one of this name"),
        ({"name": ""}, "must be a text, got ''"),
        ({"name": 3}, "must be a text, got 3"),
        ({"vertex": None}, r"'own': vertex is missing: a function .*\(vertex, neighbour, face"),
        ({"lattice": "hexagons"}, "lattice must be one of quads, triangles, got 'hexagons'"),
        ({"spline": "sextic"}, "spline must be one of bicubic, .*, got 'sextic'"),
        ({"lattice": 4}, "'own': lattice must be one of quads, triangles, got 4"),
        ({"spline": 3}, "'own': spline must be one of bicubic, .*, got 3"),
        ({"vertex": {"5": (F(1), F(0), F(0))}}, "'own': keys .* are integers, got '5'"),
        ({"smooth_triangle": 0.3}, r"'own': smooth_triangle is the float 0\.3, need a Fraction"),
        ({"lattice": "triangles", "spline": "bicubic"}, "no bicubic B-spline of triangles"),
        ({"vertex": {4: (F(1, 3), F(1, 12), F(1, 12))}}, r"vertex\(4\) sums to 1, not|vertex\(4\)"),
        ({"edge": (F(1, 2), F(0))}, r"edge is \(1/2, 0\), but the bicubic B-spline needs"),
    ],
)
def test_what_is_no_scheme_is_refused_at_once(given, complaint):
    facts = {"name": "own", "vertex": QUAD_VERTICES} | given
    with pytest.raises(ValueError, match=complaint):
        ls.Scheme(facts.pop("name"), **facts)


def test_dual_masks_that_are_none_are_refused():
    quarter = F(1, 4)
    wrong = {
        "float": ((0.5, 0.25, 0.25), r".*weight 0 is the float 0\.5"),
        "short": ((F(1),), r"must be 3 exact numbers"),
        "sum": ((F(1), quarter, quarter), r".* of sum 1, got .* of sum 3/2"),
        "skew": ((F(1, 2), F(1, 2), F(0)), r"is not symmetric"),
        "nan": ((F(1), F(0), sympy.nan), r".*weight 2 is of type NaN"),
        "huge": ((F(1 - 2 * 10**400), F(10**400), F(10**400)), r".*larger than 1e100"),
    }
    cube = ls.Mesh(
        [[x, y, z] for x in (0.0, 1) for y in (0, 1) for z in (0, 1)],
        [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]],
    )
    for weights, complaint in wrong.values():
        scheme = ls.DualScheme("cut", corner={3: weights})
        with pytest.raises(ValueError, match=rf"'cut': corner\(3\) {complaint}"):
            ls.LimitSurface(cube, scheme=scheme)
    with pytest.raises(ValueError, match=r"corner\(4\) is .* but the biquadratic B-spline needs"):
        ls.DualScheme("cut", corner={4: (quarter,) * 4})
    with pytest.raises(ValueError, match="there is one of this name"):
        ls.DualScheme("doo-sabin", corner={})
    with pytest.raises(
        ValueError, match=r"'cut': corner\(3\) is not given: the mapping has 4; add"
    ):
        ls.LimitSurface(cube, scheme=ls.DualScheme("cut", corner={}))


def in_waves(*values):
    return ls.DualScheme("waves", corner={6: circulant(values, 6)})


def flipping(a, b):
    spokes = {5: (F(11, 10), F(-3, 10), F(1, 10))}
    return own_edge(a, b, 6, spokes, (F(3, 8), F(3, 8), F(1, 8)))


FLIPPED = ls.Scheme("flipped", lattice="triangles", vertex={5: (F(9, 10), F(1, 50))}, edge=flipping)


@pytest.mark.parametrize(
    ("scheme", "complaint"),
    [
        (ls.Scheme("far", vertex=at_five(lambda N: (F(-9, 10), F(19, 50), F(0)))),
         r"'far': the masks do not converge at interior valence 5: .* modulus >= 1, -1\.\d+"),
        (in_waves(F(1), F(1), F(1, 4), F(1, 4)),
         r"'waves': .* interior valence 6: .* >= 1, 1; change the scheme's corner\(6\)"),
        (in_waves(F(1), F(-1, 2), F(1, 4), F(1, 4)),
         r"'waves': at interior valence 6 the pair .* but 1 is negative, -0\.5, need a positive"),
        (ls.Scheme("twisted", vertex=at_five(lambda N: (F(49, 100), F(-3, 25), F(111, 500)))),
         r"'twisted': frequency 0 of valence 5 has no real .* are 0\.25875 \+0\.034\d+i, and"),
        (FLIPPED, r"'flipped': at interior valence 5 the pair .* is negative, -0\.4618\d+, need"),
    ],
    ids=["far", "one", "negative", "twisted", "flipped"],
)  # fmt: skip
def test_masks_without_a_limit_are_refused(scheme, complaint, tmp_path, monkeypatch):
    monkeypatch.setenv("LIMITSURF_CACHE_DIR", str(tmp_path))
    valence = 6 if isinstance(scheme, ls.DualScheme) else 5
    for _ in range(2):  # it is not remembered as anything else
        with pytest.raises(UnsupportedSpectrum, match=complaint):
            ls.eigenbasis(scheme, valence=valence)
    assert not list(tmp_path.glob("**/*.npz"))


def test_what_is_not_c1_is_said_once_and_has_no_normals(monkeypatch):
    monkeypatch.setattr(cache, "_warned", set())
    scheme = ls.Scheme("spiky", vertex=at_five(lambda N: (F(9, 10), F(1, 50), F(0))))
    mesh = ls.Mesh(*fan(5, 4, layers=2))
    with pytest.warns(UserWarning, match=r"'spiky' converges at interior valence 5, .* not C1"):
        ls.eigenbasis(scheme, valence=5)
    surface = ls.LimitSurface(mesh, scheme=scheme)
    assert np.isnan(surface.normal(0, 0.0, 0.0)).all()
    assert np.isfinite(surface.evaluate(0, 0.0, 0.0)).all()
    assert np.isfinite(surface.normal(0, 0.1, 0.2)).all()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ls.LimitSurface(mesh, scheme=scheme).normal(0, 0, 0)


def test_refined_meshes_of_dual_masks_have_no_limits_that_surfaces_lack(monkeypatch):
    monkeypatch.setattr(cache, "_warned", set())
    mesh = ls.Mesh(np.eye(4)[:, :3], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    flat = ls.DualScheme("flat", corner={3: (F(1, 3),) * 3})
    with pytest.warns(UserWarning, match=r"corner\(3\) decides \(see limitsurf.DualScheme\)"):
        assert np.isnan(ls.refined(mesh, 0, scheme=flat).limit_normals).all()
    assert np.isfinite(ls.refined(mesh, 0, scheme=flat).limit_points).all()
    wild = ls.DualScheme("wild", corner={3: (F(2), F(-1, 2), F(-1, 2))})
    for what in ("limit_points", "limit_normals"):
        with pytest.raises(UnsupportedSpectrum, match=r"'wild': .* valence 3: .*, 2\.5; .*corner"):
            getattr(ls.refined(mesh, 0, scheme=wild), what)


# --- elsewhere ------------------------------------------------------------------------------------


def shared():
    """A surface of a scheme of lambdas, and places."""
    scheme = ls.Scheme(
        "of lambdas", lattice="triangles", vertex=lambda N: (F(5, 8), F(3, 8) / N),
        edge=lambda a, b: spoke(a, b),
    )  # fmt: skip
    surface = ls.LimitSurface(ls.Mesh(*fan(7, 3)), scheme=scheme)
    return surface, (np.arange(5), np.full(5, 0.3), np.full(5, 0.01))


def test_pickles_hold_the_values_of_masks():
    surface, places = shared()
    again = pickle.loads(pickle.dumps(surface))
    assert np.array_equal(again.evaluate(*places), surface.evaluate(*places))
    scheme = pickle.loads(pickle.dumps(surface.rules["scheme"]))
    assert scheme == pickle.loads(pickle.dumps(surface.rules["scheme"]))
    assert scheme.key(7) == surface.rules["scheme"].key(7)
    assert ls.eigenbasis(scheme, 32).float64 is ls.eigenbasis(surface.rules["scheme"], 32).float64
    with pytest.raises(ValueError, match=r"vertex\(33\) is not known here: .* came from another"):
        ls.eigenbasis(scheme, 33)
    known = pickle.loads(pickle.dumps(SCHEMES["spoked triangles"]))
    assert known == SCHEMES["spoked triangles"]
    assert pickle.loads(pickle.dumps(ls.schemes["loop"])) == ls.schemes["loop"]
    waves = ls.DualScheme("cut", corner=lambda n: DOO_SABIN.mask(n))
    assert pickle.loads(pickle.dumps(waves)).mask(7) == waves.mask(7)


def test_masks_travel_to_processes_that_are_started_anew():
    surface, places = shared()
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        found = pool.apply(ls.LimitSurface.evaluate, (surface, *places))
    assert np.array_equal(found, surface.evaluate(*places))


def test_masks_travel_with_dask():
    pickler = pytest.importorskip("cloudpickle")
    surface, places = shared()
    again = pickle.loads(pickler.dumps(surface))
    assert np.array_equal(again.evaluate(*places), surface.evaluate(*places))
    array = pytest.importorskip("dask.array")
    chunks = [array.from_array(x, chunks=2) for x in places]
    found = surface.evaluate(*chunks).compute(scheduler="processes", num_workers=1)
    assert np.abs(found - surface.evaluate(*places)).max() < 1e-15  # NumPy's chunks differ


def test_algebraic_weights_need_not_be_simplified():
    """Square roots whose sum is one by an identity that expansion does not show."""
    share = sympy.sqrt(3 + 2 * sympy.sqrt(2)) - sympy.sqrt(2)  # 1
    scheme = ls.Scheme("roots", vertex=at_five(lambda N: (share / 2, F(1, 20), F(1, 20))))
    found = tables.limit_mask(scheme, "interior", 5, ls.numbers.FLOAT64)
    plain = ls.Scheme("plain", vertex=at_five(lambda N: (F(1, 2), F(1, 20), F(1, 20))))
    assert np.allclose(
        found, tables.limit_mask(plain, "interior", 5, ls.numbers.FLOAT64), atol=1e-15
    )


@pytest.mark.parametrize("mask", [F(1, 2), (F(1, 2), F(1, 6)), "half"])
def test_a_mask_that_is_no_function_is_told_what_it_should_be(mask):
    with pytest.raises(ValueError, match="'number': a mask must be a function of the valence, or"):
        ls.Scheme("number", lattice="triangles", vertex=mask)


def test_edges_between_equal_valences_have_no_first_end():
    scheme = ls.Scheme(
        "asymmetric",
        lattice="triangles",
        vertex=lambda n: (F(5, 8), F(3, 8) / n),
        edge=lambda a, b: (
            (F(3, 8), F(3, 8), F(1, 8)) if a == b == 6 else (F(1, 2), F(1, 4), F(1, 8))
        ),
    )
    with pytest.raises(
        ValueError, match=r"edge\(3, 3\) is \(1/2, 1/4, 1/8\); an edge has no first"
    ):
        scheme.edge_mask(3, 3)


def test_a_mask_that_leaves_the_program_is_refused_as_one_that_raises():
    def vertex(n):
        if n == 6:
            return F(5, 8), F(1, 16)
        raise SystemExit(3)

    scheme = ls.Scheme("leaves", lattice="triangles", vertex=vertex)
    with pytest.raises(ValueError, match=r"'leaves': vertex\(5\) raised SystemExit: 3"):
        scheme.vertex_mask(5)


@pytest.mark.parametrize(
    ("edges", "what"), [(True, "edge and vertex(5) decide"), (False, "vertex(5) decides")]
)
def test_a_warning_names_the_masks_that_decide(edges, what):
    def edge(a, b):
        if (a == 6) == (b == 6):
            return F(3, 8), F(3, 8), F(1, 8)
        return (F(5, 8), F(1, 8), F(1, 8)) if b == 6 else (F(1, 8), F(5, 8), F(1, 8))

    # the vertex keeps so much that frequency 0 outweighs the tangent plane
    scheme = ls.Scheme(
        f"cups {edges}",
        lattice="triangles",
        vertex=lambda n: (F(5, 8), F(1, 16)) if n == 6 else (F(99, 100), F(1, 100) / n),
        edge=edge if edges else None,
    )
    with pytest.warns(UserWarning, match="are NaN; " + re.escape(what) + " "):
        assert ls.spectral_analysis(scheme, valence=5).c1 is False
