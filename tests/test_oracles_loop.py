"""Loop's oracles against reference numbers, hand calculation, curves, and each other."""

import ast
import itertools
import json
import math
import random
from collections import Counter
from fractions import Fraction as F
from pathlib import Path

import numpy as np
import oracles_loop
import pytest
import zoo
import zoo_triangles
from oracles import CASES as FILES
from oracles import cubic_weights
from oracles_creases import INF, Cage
from oracles_loop import (
    CONTROLS,
    CORNERS,
    STEPS,
    TETRAHEDRON_VOLUME,
    LoopSurface,
    box_spline_polynomials,
    box_spline_weights,
    child_of,
    in_child,
    limit_mask,
    loop_weight,
    reference_cases,
    refine,
    refine_times,
    refined_parameters,
    warren_weight,
)

CASES = reference_cases() or {}
SCHEMES = FILES.parent / "schemes"
ORDERS = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]
ALL = zoo_triangles.ZOO | zoo_triangles.DEGENERATE
NOWHERE = pytest.mark.skipif(not SCHEMES.is_dir(), reason="no reference numbers here")


def exact(points):
    return [tuple(map(F, point)) for point in np.asarray(points).tolist()]


def of_zoo(name, **tags):
    points, faces = (ALL | zoo_triangles.NONMANIFOLD)[name]()
    return Cage(exact(points), faces, **tags)


def tagged(name):
    points, faces, tags = zoo_triangles.TAGGED[name]()
    return Cage(exact(points), faces, **tags)


def inside(rng):
    u, v = F(rng.randint(1, 996), 997), F(rng.randint(1, 990), 991)
    return (u, v) if u + v <= 1 else (1 - u, 1 - v)


def floats(values):
    return [float(x) for x in values]


def test_imports_nothing_of_the_library():
    tree = ast.parse(Path(oracles_loop.__file__).read_text(encoding="utf-8"))
    names = {a.name for node in ast.walk(tree) if isinstance(node, ast.Import) for a in node.names}
    names |= {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert not [name for name in names if name.startswith("limitsurf")]


# --- reference numbers ----------------------------------------------------------------------------


@pytest.mark.parametrize("valence", CASES)
def test_reference_cases_to_the_last_bit(valence):
    case = CASES[valence]
    surface = LoopSurface(Cage(exact(case["verts"]), case["faces"]))
    near = np.flatnonzero(case["kind"] == 2)[::3]  # 1e-1 to 1e-12 from the extraordinary vertex
    for i in [*range(0, len(case["uv"]), 30), *near]:
        for nu, name in (((0, 0), "P_true"), ((1, 0), "Pu_true"), ((0, 1), "Pv_true")):
            found = surface.evaluate(case["target_face"], *case["uv"][i].tolist(), nu=nu)
            assert floats(found) == case[name][i].tolist()


def scheme_cases():
    if not SCHEMES.is_dir():
        return []
    cages = json.loads((SCHEMES / "loop_cages.json").read_text(encoding="utf-8"))
    return [pytest.param(i, cage, id=cage["name"]) for i, cage in enumerate(cages) if len(cage) > 1]


@NOWHERE
@pytest.mark.parametrize(("number", "given"), scheme_cases())
def test_scheme_cases_to_the_last_bit(number, given):
    cage = Cage(
        exact(given["points"]),
        given["faces"],
        {(a, b): float(s) for a, b, s in given["creases"]},
        {v: float(s) for v, s in given["corners"]},
        boundary=given["boundary"],
    )
    surface = LoopSurface(cage, warren_weight if given["warren"] else loop_weight)
    with np.load(SCHEMES / "loop.npz") as data:
        rows = {name: data[name][data["case"] == number][::4].tolist() for name in data}
    for i, (face, u, v) in enumerate(zip(rows["face"], rows["u"], rows["v"], strict=True)):
        for nu, expected in zip(ORDERS, [rows["P"][i], *rows["D"][i]], strict=True):
            assert floats(surface.evaluate(face, u, v, nu)) == expected
        assert floats(surface.normal(face, u, v)) == rows["normal"][i]


def integral(net):
    """Of det(P, P_u, P_v) over a regular triangle."""
    control = oracles_loop._control_net(net.local)
    values = {place: net.combined(form) for place, form in control.items()}
    D = math.lcm(*(x.denominator for point in values.values() for x in point))
    vectors = []
    for nu in ORDERS[:3]:
        vectors.append([Counter(), Counter(), Counter()])
        for place, polynomial in box_spline_polynomials(nu).items():
            for key, a in polynomial.items():
                for total, x in zip(vectors[-1], values[place], strict=True):
                    total[key] += int(12 * a * x * D)
    total = 0
    for order in itertools.permutations(range(3)):
        sign = np.linalg.det(np.eye(3)[list(order)])
        factors = (vector[c].items() for vector, c in zip(vectors, order, strict=True))
        for terms in itertools.product(*factors):
            i, j = (sum(key[axis] for key, _ in terms) for axis in (0, 1))
            weight = math.factorial(i) * math.factorial(j) * math.perm(12, 10 - i - j)
            total += int(sign) * weight * math.prod(a for _, a in terms)
    return F(total, math.factorial(12) * (12 * D) ** 3)


def test_volume_of_the_tetrahedron():
    """Ring by ring towards the vertices of a face, which are all alike."""
    points = [(-1, -1, -1), (-1, 1, 1), (1, -1, 1), (1, 1, -1)]  # edges of twice the root of 2
    surface = LoopSurface(Cage(exact(points), [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    net = surface._start(0)
    found, ring = integral(surface._child(net, 3)), None
    for _ in range(6):
        net = surface._child(net, 0)
        ring = 3 * sum(integral(surface._child(net, k)) for k in (1, 2, 3))
        found += ring
    expected = 3 * 16 * TETRAHEDRON_VOLUME / 4  # 3 V for four faces; 2^3 of 2^(3/2) / 2^(1/2)
    # Rings shrink with the square of the eigenvalue 1/4, almost: there is a Jordan block.
    assert ring / 16 < expected - found < ring / 8
    assert ring < expected / 10**5


# --- the regular patch ----------------------------------------------------------------------------


def regular_refined(points):
    """A step on the lattice {place: value}, by the masks of valence 6, where all points are."""

    def at(place):
        return points[place]

    fine = {}
    for a, b in points:
        ring = [(a + x, b + y) for x, y in STEPS]
        if all(place in points for place in ring):
            fine[2 * a, 2 * b] = F(5, 8) * at((a, b)) + F(1, 16) * sum(map(at, ring))
        for k in range(6):
            end, *sides = (ring[(k + j) % 6] for j in (0, 1, -1))
            if all(place in points for place in (end, *sides)):
                middle = a + end[0], b + end[1]
                fine[middle] = F(3, 8) * (at((a, b)) + at(end)) + F(1, 8) * sum(map(at, sides))
    return fine


@pytest.mark.parametrize("nu", ORDERS)
def test_box_spline_is_what_refinement_leaves(nu):
    rng = random.Random(1)
    points = {place: F(rng.randint(-99, 99)) for place in CONTROLS}
    fine = regular_refined(points)
    origins = [((0, 0), 1), ((1, 0), 1), ((0, 1), 1), ((1, 1), -1)]  # of the children, in `fine`
    for _ in range(4):
        u, v = inside(rng)
        k = child_of(u, v, False)
        (a, b), sign = origins[k]
        weights = box_spline_weights(*in_child(u, v, k), nu=nu)
        found = sum(w * fine[a + sign * x, b + sign * y] for (x, y), w in weights.items())
        expected = sum(w * points[place] for place, w in box_spline_weights(u, v, nu).items())
        assert found * (2 * sign) ** sum(nu) == expected


def test_box_spline_gives_planes():
    u, v = F(2, 7), F(3, 11)
    for nu in ORDERS:
        weights = box_spline_weights(u, v, nu).items()
        assert sum(w for _, w in weights) == (nu == (0, 0))
        for axis, x in enumerate((u, v)):
            found = sum(w * place[axis] for place, w in weights)
            assert found == {(0, 0): x, ((1, 0), (0, 1))[axis]: 1}.get(nu, 0)


# --- refinement -----------------------------------------------------------------------------------


def test_tetrahedron_by_hand():
    fine = refine(Cage(exact(np.eye(4)), [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    assert fine.points[0] == (F(7, 16), F(3, 16), F(3, 16), F(3, 16))
    assert fine.points[4] == (F(3, 8), F(3, 8), F(1, 8), F(1, 8))  # edge (0, 1)
    assert fine.points[9] == (F(1, 8), F(1, 8), F(3, 8), F(3, 8))  # edge (2, 3), the last
    # edges (0, 1) (0, 2) (0, 3) (1, 2) (1, 3) (2, 3) are 4 .. 9
    assert fine.faces[:4] == [[0, 5, 4], [2, 7, 5], [1, 4, 7], [7, 4, 5]]
    assert limit_mask(3) == (F(2, 5), F(1, 5))


def test_weights():
    assert [loop_weight(n) for n in (2, 3, 4, 6)] == [F(39, 128), F(3, 16), F(31, 256), F(1, 16)]
    assert [warren_weight(n) for n in (3, 4, 6)] == [F(3, 16), F(3, 32), F(1, 16)]
    root = F(math.isqrt(5 * 10**60), 10**30)  # cos(2 pi / 5) = (sqrt 5 - 1) / 4
    assert abs(5 * loop_weight(5) - F(5, 8) + ((5 + root) / 16) ** 2) < F(1, 10**29)


@pytest.mark.parametrize("name", ["disc_5", "patch_1", "crowded", "pillow_of_triangles"])
def test_floats_refine_as_fractions(name):
    cage = of_zoo(name)
    points = [tuple(map(float, point)) for point in cage.points]
    fine = refine_times(cage, 2)
    found = refine_times(cage._replace(points=points), 2)
    assert found.faces == fine.faces
    np.testing.assert_allclose(found.points, np.array(fine.points, dtype=float), atol=1e-14)


# --- limits ---------------------------------------------------------------------------------------

SMOOTH = ["tetrahedron", "crowded", "sphere_1", "torus_3x4", "fan_2", "triangle", "patch_1"]
WILD = [*zoo_triangles.DEGENERATE, *zoo_triangles.NONMANIFOLD]


@pytest.mark.parametrize("name", [*SMOOTH, *WILD, *zoo_triangles.TAGGED])
def test_limits_do_not_change_under_refinement(name):
    cage = tagged(name) if name in zoo_triangles.TAGGED else of_zoo(name)
    fine = refine(cage, warren_weight)
    rng, children = random.Random(name), refined_parameters(len(cage.faces), 1)
    surface, finer = LoopSurface(cage, warren_weight), LoopSurface(fine, warren_weight)
    for child in rng.sample(range(len(children)), 4):
        face, corners = children[child]
        s, t = inside(rng)
        places = [(s, t), *CORNERS]
        u, v = ((1 - s - t) * a + s * b + t * c for a, b, c in zip(*corners, strict=True))
        for (s, t), where in zip(places, [(u, v), *corners], strict=True):
            expected = surface.evaluate(face, *where)
            found = finer.evaluate(child, s, t)
            assert found == expected or all(map(math.isnan, found + expected))


@pytest.mark.parametrize("seed", range(4))
def test_weights_are_what_evaluates(seed):
    make = zoo_triangles.tagged_patch if seed % 2 else zoo_triangles.tagged_sphere
    points, faces, tags = make(seed)
    cage = Cage(exact(points), faces, **tags)
    surface, rng = LoopSurface(cage), random.Random(seed)
    for nu in ORDERS[:3]:
        face = rng.choice([f for f in range(len(faces)) if f not in tags["holes"]])
        u, v = inside(rng)
        weights = surface.weights(face, u, v, nu)
        assert abs(sum(weights.values()) - (nu == (0, 0))) < F(1, 10**150)
        for c, expected in enumerate(surface.evaluate(face, u, v, nu)):
            found = sum(w * cage.points[i][c] for i, w in weights.items())
            assert abs(found - expected) < F(1, 10**150)


@pytest.mark.parametrize("name", ["cylinder_5", "ringed_fan_2", "grid_3x2", "disc_4", "strip_3"])
def test_boundaries_are_cubic_curves(name):
    cage = of_zoo(name, boundary="edge_only")
    surface = LoopSurface(cage)
    sides = zoo.half_edges(cage.faces)
    after = {a: b for a, b in sides if (b, a) not in sides}
    before = {b: a for a, b in after.items()}
    t = F(3, 7)
    for number, (a, b) in enumerate(sides):
        if after.get(a) == b:
            face, k = divmod(number, 3)
            (x, y), (p, q) = CORNERS[k], CORNERS[(k + 1) % 3]
            found = surface.evaluate(face, x + t * (p - x), y + t * (q - y))
            curve = zip(cubic_weights(t), (before[a], a, b, after[b]), strict=True)
            terms = [[w * x for x in cage.points[v]] for w, v in curve]
            assert found == tuple(map(sum, zip(*terms, strict=True)))


@pytest.mark.parametrize("name", ["sphere_0", "disc_9", "crowded"])
def test_faces_meet_in_position_and_normal(name):
    cage = of_zoo(name)
    surface, rng = LoopSurface(cage), random.Random(name)
    number = {side: i for i, side in enumerate(zoo.half_edges(cage.faces))}
    shared = [side for side in number if side[::-1] in number]
    for side in rng.sample(shared, 3):
        t, values = F(2, 9), []
        for (a, b), x in ((side, t), (side[::-1], 1 - t)):
            face, k = divmod(number[a, b], 3)
            start, end = CORNERS[k], CORNERS[(k + 1) % 3]
            u, v = (p + x * (q - p) for p, q in zip(start, end, strict=True))
            values.append(floats(surface.evaluate(face, u, v) + surface.normal(face, u, v)))
        np.testing.assert_allclose(values[0], values[1], atol=1e-15)


def test_holes_and_faces_without_a_limit():
    cage = of_zoo("grid_4x4", boundary="none", holes=[9])
    surface = LoopSurface(cage)
    limits = [f for f in range(32) if not np.isnan(floats(surface.evaluate(f, F(1, 4), 0))[0])]
    inner = {v for v in range(25) if v not in zoo.boundary_vertices(cage.faces)}
    assert limits == [f for f in range(32) if f != 9 and set(cage.faces[f]) <= inner]


def test_derivatives_close_to_a_vertex():
    """First derivatives scale with (2 lambda)^n on the way: 1/2 at valence 3."""
    surface = LoopSurface(of_zoo("disc_3", corners={4: INF}), bits=2400)
    steps = [surface.evaluate(0, F(1, 3 * 2**n), F(1, 5 * 2**n), (1, 0))[2] for n in (299, 300)]
    assert abs(steps[1] / steps[0] - F(1, 2)) < F(1, 10**80)


# --- the zoo --------------------------------------------------------------------------------------


def valences(faces):
    return Counter(itertools.chain(*faces))


@pytest.mark.parametrize("name", zoo_triangles.ZOO)
def test_zoo_is_what_it_says(name):
    points, faces = zoo_triangles.ZOO[name]()
    assert zoo.is_manifold(faces)
    assert all(len(face) == 3 for face in faces)
    count, rim = valences(faces), zoo.boundary_vertices(faces)
    assert sorted(count) == list(range(len(points)))
    assert (name in zoo_triangles.BOUNDED) == bool(rim)
    assert all(3 <= n <= 16 for v, n in count.items() if v not in rim)
    assert (points * 4096 == np.rint(points * 4096)).all()


def test_zoo_has_every_kind():
    cages = {name: make()[1] for name, make in zoo_triangles.ZOO.items()}
    inner, outer, crowds = set(), set(), set()
    for faces in cages.values():
        count, rim = valences(faces), zoo.boundary_vertices(faces)
        inner |= {n for v, n in count.items() if v not in rim}
        outer |= {n for v, n in count.items() if v in rim}
        crowds |= {sum(v not in rim and count[v] != 6 for v in face) for face in faces}
    assert inner >= set(range(3, 11)) | {12, 16}
    assert outer == set(range(1, 9))
    assert crowds == {0, 1, 2, 3}  # extraordinary corners of one face


@pytest.mark.parametrize("name", zoo_triangles.NONMANIFOLD)
def test_zoo_has_cages_that_are_no_manifold(name):
    points, faces = zoo_triangles.NONMANIFOLD[name]()
    assert not zoo.is_manifold(faces)
    assert sorted(valences(faces)) == list(range(len(points)))
