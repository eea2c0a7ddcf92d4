"""The limit surface of triangles against exact recursion.

Accuracy is that of `test_surface`; derivatives are compared with the largest of their order at the
same place, which those along u, v and the third side mix.
"""

import dataclasses
import functools
import json
import math
import random
from fractions import Fraction as F

import numpy as np
import oracles
import oracles_channels
import oracles_loop
import pytest
import zoo_triangles
from oracles_creases import Cage
from oracles_loop import LoopSurface

import limitsurf as ls
from limitsurf._kernels import reference
from limitsurf.basis import regular_weights
from limitsurf.numbers import FLOAT64, RATIONAL
from limitsurf.patches import STRIP
from limitsurf.scheme.loop import LOOP, LOOP_WARREN

ORDERS = [(i, m - i) for m in range(5) for i in range(m + 1)]
CAGES = ["torus_3x4", "octahedron", "crowded", "sphere_1", "bipyramid_12", "patch_0", "fan_2",
         "fan_5", "dart_5", "crease_2_of_6", "corner_3", "cone_5", "semi_2.5", "chaikin",
         "tagged_sphere_0"]  # fmt: skip
FRACTIONS = ["torus_3x4", "octahedron", "crowded", "grid_3x2", "crease_2_of_6", "dart_6"]
CASES = oracles_loop.reference_cases() or {}
SCHEMES = oracles.CASES.parent / "schemes"
# in coordinates of each corner: on lines between pieces, beside them, near and at the corner
PLACES = [(0.5, 0.25), (0.25, 0.5), (0.25, 0.25), (0.3, 0.2), (0.7, 0.3), (2.0**-40, 0.0),
          (2.0**-40, 2.0**-41), (2.0**-43, 1e-12), (0.5, 0.0), (0.0, 0.3), (0.0, 0.0)]  # fmt: skip

pytestmark = pytest.mark.filterwarnings("ignore:scheme 'loop' converges:UserWarning")


@functools.lru_cache(maxsize=4)
def both(name, bits=1200):
    """A surface, by the reference engine, and the oracle's."""
    makers = zoo_triangles.ZOO | zoo_triangles.TAGGED
    points, faces, *tags = makers[name]()
    tags, points = tags[0] if tags else {}, [[F(float(x)) for x in p] for p in points]
    mesh = ls.Mesh(np.array(points, dtype=float), faces, **tags)
    surface = ls.LimitSurface(mesh, scheme=LOOP, engine="reference")
    return surface, LoopSurface(Cage(points, faces, **tags), bits=bits)


def in_face(corner, s, t):
    """(u, v) of (s, t) as seen from a corner."""
    rest = 1 - max(s, t) - min(s, t)
    return [(s, t), (rest, s), (t, rest)][corner]


def queries(surface, seed, n=3):
    """Faces, each with all places, from each corner."""
    rng = random.Random(seed)
    faces = rng.sample(range(len(surface.limit_faces)), min(n, len(surface.limit_faces)))
    found = [(f, *in_face(k, s, t)) for f in faces for k in range(3) for s, t in PLACES]
    u, v = (sorted((rng.random(), rng.random())) for _ in range(2))
    return found + [(f, x, y * (1 - x)) for f in faces for x, y in zip(u, v, strict=True)]


def floats(values):
    return np.array([float(x) for x in values])


def columns(asked):
    return [np.array(x) for x in zip(*asked, strict=True)]


@pytest.mark.parametrize("name", CAGES)
def test_derivatives(name):
    surface, oracle = both(name)
    asked = queries(surface, name)
    found = {nu: surface.evaluate(*columns(asked), nu=nu) for nu in ORDERS}
    size = np.ptp(surface.points, axis=0).max()
    for k, query in enumerate(asked):
        for order in range(5):
            wanted = {nu: floats(oracle.evaluate(*query, nu)) for nu in ORDERS if sum(nu) == order}
            scale = max(np.abs(x).max() for x in wanted.values())
            for nu, x in wanted.items():
                most = 1e-14 * size if order == 0 else 1e-12 * scale + 1e-300
                if not np.isnan(x).any():  # what the oracle knows
                    assert np.abs(found[nu][k] - x).max() <= most, (query, nu)


@pytest.mark.parametrize("engine", ["reference", "compiled"])
def test_sums_that_round_to_a_half(engine):
    """Third derivatives jump on the lines between the children of a face that is split."""
    points, faces = zoo_triangles.ZOO["crowded"]()
    surface = ls.LimitSurface(ls.Mesh(points, faces), scheme=LOOP, engine=engine)
    u, v = np.array([[0.5 - 2.0**-54, 2.0**-54 + 2.0**-106], [0.5 - 2.0**-54, 2.0**-55]]).T
    assert (u + v == 0.5).all()
    assert [F(x) + F(y) > F(1, 2) for x, y in zip(u, v, strict=True)] == [True, False]
    (face,) = np.flatnonzero(surface.patches.codes[: len(faces)] <= -2)[:1]
    jumped = False
    for nu in [(3, 0), (2, 1), (1, 2), (0, 3)]:
        for s, t in ((u, v), (v, u)):
            found = surface.evaluate(face, s, t, nu=nu)
            wanted = [surface.evaluate(face, F(x), F(y), nu=nu) for x, y in zip(s, t, strict=True)]
            wanted = np.array(wanted, dtype=float)
            assert np.abs(found - wanted).max() <= 1e-12 * np.abs(wanted).max()
            jumped |= np.abs(wanted[0] - wanted[1]).max() > 0.1
    assert jumped


@pytest.mark.parametrize("engine", ["reference", "compiled"])
@pytest.mark.parametrize("nu", [(2, 0), (1, 1), (0, 2), (3, 0), (1, 2)])
def test_derivatives_beyond_the_largest_number_are_infinite(engine, nu):
    """With the sign of those of a smaller surface, though sums of several in a patch."""
    points, faces = zoo_triangles.disc(9)[:2]
    faces = [[*face[1:], face[0]] for face in faces]
    small = ls.LimitSurface(ls.Mesh(np.asarray(points, float), faces), scheme="loop", engine=engine)
    query = 0, 4.4e-16, 1 - 1.3e-15
    found = small.with_points(1e300 * small.points).evaluate(*query, nu=nu)
    assert (found == np.inf * small.evaluate(*query, nu=nu)).all()
    # rows that differ by such a factor: what is infinite adds up to no NaN where it cannot
    weights = small.weights(*query, nu=nu)
    assert np.isfinite(weights.data).all()
    wanted = small.evaluate(*query, nu=nu)
    assert np.abs(weights @ small.points - wanted).max() <= 1e-11 * np.abs(weights.data).max()


@pytest.mark.parametrize("valence", CASES)
def test_reference_cases(valence):
    case = CASES[valence]
    mesh = ls.Mesh(case["verts"], case["faces"])
    surface = ls.LimitSurface(mesh, scheme=LOOP, engine="reference")
    u, v = case["uv"].T
    size = np.ptp(case["verts"], axis=0).max()
    for nu, name in (((0, 0), "P_true"), ((1, 0), "Pu_true"), ((0, 1), "Pv_true")):
        found, wanted = surface.evaluate(case["target_face"], u, v, nu=nu), case[name]
        scale = np.abs(wanted).max(axis=1, keepdims=True)
        assert (np.abs(found - wanted) <= (1e-12 * scale if any(nu) else 1e-14 * size)).all()


def test_close_to_a_vertex_as_anywhere():
    surface, oracle = both("octahedron")
    for s, t in [(1e-300, 2e-300), (0.0, 1e-300), (5e-324, 5e-324), (1e-12, 1e-13)]:
        for nu in ORDERS[:3]:
            found = surface.evaluate(np.arange(8), s, t, nu=nu)
            for face in range(0, 8, 3):
                wanted = floats(oracle.evaluate(face, F(s), F(t), nu))
                assert np.abs(found[face] - wanted).max() <= 1e-14 * np.abs(wanted).max()


@pytest.mark.parametrize("name", FRACTIONS)
def test_fractions(name):
    surface, oracle = both(name)
    third = [(F(1, 3), F(1, 5)), (F(1, 2**20), F(1, 3 * 2**20)), (F(2, 3), F(1, 3))]
    places = [*((F(s), F(t)) for s, t in PLACES), *third]
    rng = random.Random(name)
    for place in places:
        face, query = rng.randrange(len(surface.limit_faces)), in_face(rng.randrange(3), *place)
        for nu in [(0, 0), (1, 0), (0, 1), *rng.sample(ORDERS[3:], 2)]:
            wanted = oracle.evaluate(face, *query, nu)
            if not any(x != x for x in wanted):
                assert list(surface.evaluate(face, *query, nu=nu)) == list(wanted), (query, nu)
                weights, own = (
                    surface.weights(face, *query, nu=nu),
                    oracle.weights(face, *query, nu),
                )
                kept = zip(weights.columns.tolist(), weights.values, strict=True)
                assert {k: w for k, w in kept if w} == {k: w for k, w in own.items() if w}
    jet = surface.jet(0, F(1, 3), F(1, 3), order=1)
    assert list(jet[0, 1]) == list(oracle.evaluate(0, F(1, 3), F(1, 3), (0, 1)))


def test_irrational_masks_have_no_fractions():
    surface, oracle = both("disc_7")
    far = F(1, 3), F(1, 5)
    assert list(surface.evaluate(27, *far)) == list(oracle.evaluate(27, *far))
    with pytest.raises(TypeError, match=r"vertex 0: .*irrational at interior valence 7.*float64"):
        surface.evaluate(0, *far)
    with pytest.raises(TypeError, match=r"vertex 0: .*irrational at a dart of 9 faces.*float64"):
        both("dart_9")[0].evaluate(0, *far)
    with pytest.raises(TypeError, match=r"valence 5.*irrational"):
        both("icosahedron")[0].evaluate(0, *far)


@pytest.mark.parametrize("name", ["sphere_1", "patch_0", "crease_2_of_6", "fan_5"])
def test_normals_and_curvature(name):
    surface, oracle = both(name)
    asked = queries(surface, name)
    normals, bent = surface.normal(*columns(asked)), surface.curvature(*columns(asked))
    for k, query in enumerate(asked):
        normal = floats(oracle.normal(*query))
        if not np.isnan(normal).any():
            assert np.abs(normals[k] - normal).max() < 1e-12, query
        first, second = (
            [floats(oracle.evaluate(*query, nu)) for nu in ORDERS if sum(nu) == m] for m in (1, 2)
        )
        if np.isnan(first).any():
            continue
        form, metric = ([a @ b for a, b in pairs] for pairs in (
            [(normal, x) for x in second],
            [(first[0], first[0]), (first[0], first[1]), (first[1], first[1])],
        ))  # fmt: skip
        area = metric[0] * metric[2] - metric[1] ** 2
        gaussian = (form[0] * form[2] - form[1] ** 2) / area
        mean = (form[0] * metric[2] - 2 * form[1] * metric[1] + form[2] * metric[0]) / (2 * area)
        size = max(abs(bent.k1[k]), abs(bent.k2[k]))
        # far from singular, where these formulas themselves are precise
        if min(query[1] + query[2], 2 - 2 * query[1] - query[2], 2 - query[1] - 2 * query[2]) > 0.1:
            assert abs(bent.mean[k] - mean) < 1e-11 * size
            assert abs(bent.gaussian[k] - gaussian) < 1e-11 * size**2


@pytest.mark.parametrize("name", ["disc_7", "fan_3", "bipyramid_3", "crease_2_of_6", "cone_5"])
def test_tangents_at_vertices(name):
    """Along sides they are limits along these; others along the line between both."""
    surface, _ = both(name)
    face = np.arange(len(surface.limit_faces))
    for k in range(3):
        (a, b), (c, d) = LOOP.lattice.gradients[k]
        at = surface.tangents(face, *in_face(k, 0, 0))
        for axis, (s, t) in enumerate(((a, c), (b, d))):
            place = (0.5, 0.5) if s and t else (abs(s), abs(t))
            gaps = []
            for near in (2.0**-20, 2.0**-45):
                tangent = surface.tangents(face, *in_face(k, *(near * x for x in place)))[axis]
                gaps.append(np.nanmax(np.abs(tangent - at[axis]), axis=1))
                assert (np.isnan(tangent) == np.isnan(at[axis])).all()
            # the slowest limits fall like (mu / lambda)^n, at best by 2^-n
            assert (gaps[1] <= 0.3 * gaps[0] + 1e-7).all(), (k, axis, gaps)


@pytest.mark.parametrize("turn", range(3))
def test_normals_where_a_row_of_points_coincides(turn):
    points, faces = zoo_triangles.grid(4, 4, seed=3)
    points = np.array(points, dtype=float)
    row = np.argsort(points[:, 0])[:5]
    points[row] = points[row].mean(axis=0)
    faces = [face[turn:] + face[:turn] for face in faces]
    surface = ls.LimitSurface(ls.Mesh(points, faces), scheme=LOOP, engine="reference")
    sides = np.argwhere(surface.topology.sharp_sides)
    poles = [(f, k) for f, k in sides.tolist() if {faces[f][k], faces[f][(k + 1) % 3]} <= {*row}]
    assert len(poles) == 4
    for face, k in poles:
        for s in (0.3, 0.5, 0.8):
            limit = surface.normal(face, *in_face(k, s, 0.0))
            gaps = [
                np.abs(surface.normal(face, *in_face(k, s * (1 - t), t)) - limit).max()
                for t in (2.0**-8, 2.0**-14)
            ]
            assert gaps[0] < 0.05
            assert gaps[1] < gaps[0] / 32


def test_the_domain():
    surface, _ = both("octahedron")
    for u, v, message in [
        (1.3, 0.0, r"u \+ v = 1.3 is outside the triangle u, v >= 0, u \+ v <= 1"),
        ([0.5, 0.6], 0.5, r"u \+ v = 1.1 at index 1 is outside the triangle"),
        (-0.1, 0.5, r"u = -0.1 is outside \[0, 1\]"),
        (0.5, -0.1, r"v = -0.1 is outside \[0, 1\]"),
        (F(2, 3), F(1, 3) + F(1, 10**20), r"u \+ v = .* is outside the triangle"),
        (0.5, 0.5 + 2.0**-49, r"u \+ v = .* is outside the triangle"),
    ]:
        with pytest.raises(ValueError, match=message):
            surface.evaluate(0, u, v)
    # by rounding
    inside = [(0.5, 0.5), (1.0, 0.0), (0.7, 0.3)]
    for u, v in inside:
        for nu in ORDERS[:6]:
            found = surface.evaluate(0, u + 2.0**-51, v, nu=nu)
            wanted = surface.evaluate(0, u, v, nu=nu)
            assert np.allclose(found, wanted, rtol=0, atol=1e-12, equal_nan=True)
    assert np.isnan(surface.evaluate(0, [math.nan, math.inf], 0.5)).all()
    # corner 1 is approached along the third side, too
    found = surface.evaluate(0, 1.0, 1e-20, nu=(0, 1))
    assert np.abs(found).max() > 0
    assert surface.evaluate(0, 1.0, 0.0).tolist() == surface.evaluate(0, 1.0, 1e-300).tolist()


def test_all_kinds_of_patches_are_here():
    kinds = set()
    for name in CAGES:
        patches = both(name)[0].patches
        kinds |= {sector.kind for sector in patches.sectors if sector is not None}
        assert not (patches.kind == STRIP).any()
    assert {"interior", "crease", "corner", "dart", "cone"} <= kinds


# --- Pieces


def walked(s, t, flipped):
    """Halvings towards the corner, the child there, and the parameters in it, by recursion."""
    level = 0
    while (child := oracles_loop.child_of(s, t, flipped)) == 0:
        s, t, level = 2 * s, 2 * t, level + 1
    return level, child - 1, *oracles_loop.in_child(s, t, child)


@pytest.mark.parametrize("flipped", [False, True])
def test_the_piece_around_a_corner(flipped):
    rng = random.Random(int(flipped))
    dyadic = [(rng.randint(0, 8), rng.randint(0, 8), rng.randint(3, 5)) for _ in range(60)]
    places = [(a / 2**n, b / 2**n) for a, b, n in dyadic if 0 < a + b <= 2**n]
    # sums that are rounded to a power of two, from either side
    for s in (0.1, 0.3, 0.2, 1e-3, 1e-9):
        t = 0.5 - s
        places += [(s, t), (s, np.nextafter(t, 0)), (s, np.nextafter(t, 1)), (t / 8, s / 8)]
    places += [(s * 1e-300, t * 1e-300) for s, t in places[-20:]] + [(5e-324, 0.0), (0.0, 1e-310)]
    s, t = columns(places)
    up = np.full(len(s), flipped)
    found = reference.split_flipped_corner(s, t, up, up, up)
    exact = RATIONAL.array(s), RATIONAL.array(t)
    for *own, x, y in zip(*found, *exact, strict=True):
        wanted = walked(x, y, flipped)
        assert tuple(own[:2]) == wanted[:2]
        assert np.abs(floats(own[2:]) - floats(wanted[2:])).max() <= 2.0**-53
    own = zip(*reference.split_flipped_corner(*exact, up, up, up), strict=True)
    assert list(own) == [walked(x, y, flipped) for x, y in zip(*exact, strict=True)]
    zero, no = np.zeros(1), np.zeros(1, dtype=bool)
    assert [x[0] for x in reference.split_flipped_corner(zero, zero, no, no, no)] == [-1, 0, 0, 0]


@pytest.mark.parametrize("nu", [*ORDERS, (5, 0), (3, 3)])
def test_regular_weights(nu):
    """Those of Stam's table; in floats to rounding, with no negative weight of a position."""
    spline, template = LOOP.spline, [(i - 1, j - 1) for i, j in LOOP.lattice.template]
    exact = [(F(1, 3), F(1, 5)), (F(0), F(1)), (F(1, 2), F(1, 2))]
    s, t = map(RATIONAL.array, columns(exact))
    rows = regular_weights(spline, RATIONAL)(s, t, nu)
    for row, place in zip(rows, exact, strict=True):
        wanted = oracles_loop.box_spline_weights(*place, nu)
        assert list(row) == [wanted[k] for k in template]
    near = [(0.3, 0.6999), (1e-9, 1e-3), (0.7, 0.3), (0.25, 0.5)]
    s, t = columns(near)
    rows = regular_weights(spline, FLOAT64)(s, t, nu)
    for row, (x, y) in zip(rows, near, strict=True):
        wanted = oracles_loop.box_spline_weights(F(x), F(y), nu)
        wanted = floats(wanted[k] for k in template)
        assert np.abs(row - wanted).max() <= 1e-15 * max(1, np.abs(wanted).max())
        assert any(nu) or (row >= 0).all()


def separate(faces, rng):
    """Every corner of every face has a value of its own."""
    return list(range(3 * len(faces)))


def torn(faces, rng):
    """Seams here and there, some of which end inside."""
    several = [rng.choice([1, 1, 2, 3]) for _ in range(1 + np.max(faces))]
    return [3 * v + rng.randrange(several[v]) for v in np.ravel(faces).tolist()]


@pytest.mark.parametrize("cut", [separate, torn])
@pytest.mark.parametrize("mode", oracles_channels.MODES)
@pytest.mark.parametrize("name", ["triangle", "tetrahedron", "fan_4", "patch_0", "crease_2_of_6"])
def test_channels(name, mode, cut):
    """As on the mesh of the values, with those that the mode fixes for corners; "all" is linear."""
    points, faces, *tags = (zoo_triangles.ZOO | zoo_triangles.TAGGED)[name]()
    tags, faces = tags[0] if tags else {}, np.array(faces)
    rng = random.Random(name)
    rows = np.array(cut(faces, rng)).reshape(-1, 3)
    values = [tuple(F(rng.randint(-64, 64)) for _ in "uv") for _ in range(rows.max() + 1)]
    state = oracles_channels.start(
        faces.tolist(), len(points), tags.get("creases", {}), {}, "edge_and_corner", "uniform",
        "catmull-clark", values, rows.ravel(), mode,
    )  # fmt: skip
    rules = {value: rule for at in state.rules.values() for value, rule in at.items()}
    fixed = [x for x, rule in rules.items() if rule == "corner"]
    fixed += rows[np.isin(faces, np.flatnonzero(state.vertex_sharpness))].tolist()
    creases = {}
    for ends, there in zip(faces.tolist(), rows.tolist(), strict=True):
        for k in range(3):
            edge, own = ((min(x), max(x)) for x in ((i[k - 1], i[k]) for i in (ends, there)))
            if state.edge_sharpness[edge] and edge not in state.seams:
                creases[own] = math.inf
    corners = dict.fromkeys(fixed, math.inf)
    cage = Cage(values, rows.tolist(), creases, corners, boundary="edge_only")
    oracle = LoopSurface(cage, weight=oracles_loop.warren_weight)
    exact, floats = (
        ls.LimitSurface(
            ls.Mesh(
                np.array(points, float), faces, **tags, channels={"uv": (x, rows.ravel(), mode)}
            ),
            scheme=LOOP_WARREN,
        )
        for x in (np.array(values, dtype=object), np.array(values, dtype=float))
    )
    for face in rng.sample(range(len(faces)), min(3, len(faces))):
        for u, v in [(F(1, 2), F(1, 4)), (F(1, 64), F(1, 4)), (F(5, 8), F(3, 8)), (F(0), F(1))]:
            needed = oracle.evaluate(face, u, v)
            if mode == "all":
                weights = 1 - u - v, u, v
                needed = sum(
                    w * np.array(values[i]) for w, i in zip(weights, rows[face], strict=True)
                )
            assert exact.evaluate(face, u, v, channel="uv").tolist() == list(needed)
            rounded = floats.evaluate(face, float(u), float(v), channel="uv")
            assert np.abs(rounded - np.array(needed, dtype=float)).max() <= 1e-14 * 128


def bent(first, second):
    """Other weights between irregular vertices alone."""
    share = F(1, 4) if 6 in (first, second) else F(3, 16)
    return (F(3, 8), F(3, 8), F(1, 8)) if share == F(1, 4) else (F(5, 16), F(5, 16), share)


def test_edges_between_irregular_vertices():
    """Faces beside such edges are refined until their masks are those of the patch."""
    scheme = dataclasses.replace(LOOP_WARREN, name="bent", edge=bent)
    points, faces = zoo_triangles.sphere(1)
    mesh = ls.Mesh(np.vectorize(F, otypes=[object])(np.array(points, float)), faces)
    surface = ls.LimitSurface(mesh, scheme=scheme)
    fine = ls.refined(mesh, scheme=scheme)
    for level in (ls.refined(mesh, 0, scheme=scheme), fine):
        for k, corner in enumerate(oracles_loop.CORNERS):
            # from all faces at a vertex, by the masks of the limit
            own = np.arange(mesh.n_faces)
            found = surface.evaluate(own, *corner)
            assert (found == level.limit_points[mesh.indices.reshape(-1, 3)[:, k]]).all()
    straight = ls.refined(mesh, scheme=LOOP_WARREN).limit_points
    assert np.abs(fine.limit_points - straight).max() > 0.01
    finer = ls.LimitSurface(fine, scheme=scheme)
    for face in range(0, mesh.n_faces, 3):
        place = F(1, 32), F(1, 5)
        at_corner = finer.evaluate(4 * face, *(2 * x for x in place))
        assert (surface.evaluate(face, *place) == at_corner).all()


def test_edges_that_have_a_first_end_are_refused():
    scheme = dataclasses.replace(
        LOOP_WARREN, name="one way",
        edge=lambda a, b: (F(3, 8),) * 2 + (F(1, 8),) if 6 in (a, b) or a == b
        else (F(1, 4), F(1, 2), F(1, 8)),
    )  # fmt: skip
    message = r"'one way': edge\((\d), (\d)\) is \(1/4, .*edge\(\2, \1\) is \(1/4, .*exchanged"
    for use in (ls.refined, ls.LimitSurface):
        with pytest.raises(ValueError, match=message):
            use(ls.Mesh(*zoo_triangles.ZOO["crowded"]()), scheme=scheme)


def test_edges_at_irregular_vertices_may_have_masks_of_their_own():
    scheme = dataclasses.replace(
        LOOP_WARREN, name="spokes",
        edge=lambda a, b: (F(3, 8), F(3, 8), F(1, 8)) if a == b else (F(1, 4), F(1, 4), F(1, 4)),
    )  # fmt: skip
    mesh = ls.Mesh(*zoo_triangles.disc(5), scheme=scheme)
    fine = ls.refined(mesh, 3)
    found = ls.LimitSurface(mesh).evaluate(fine.parent_face, fine.parent_u, fine.parent_v)
    assert np.abs(found - fine.limit_points).max() <= 1e-14 * np.ptp(mesh.points)
    near, far = (ls.refined(mesh, n) for n in (1, 6))
    error = np.abs(near.limit_points - far.points[: near.n_vertices]).max()
    assert error <= 1e-3 * np.ptp(mesh.points)


def beside_points(faces, **tags):
    """A boundary vertex, number 0, whose two boundary edges are points, with faces around it."""
    points, triangles = zoo_triangles.rings(faces, open_at=True)
    points = points + np.random.default_rng(faces).normal(size=points.shape) / 8
    points[[1, faces + 1]] = points[0]
    return ls.LimitSurface(ls.Mesh(points, triangles, **tags), scheme="loop", boundary="edge_only")


@pytest.mark.parametrize("corners", [{}, {0: np.inf}], ids=["crease", "corner"])
@pytest.mark.parametrize("faces", [3, 4, 6, 8])
def test_normals_where_sharp_edges_are_points(faces, corners):
    """All faces have the limit, which normals approach from all sides."""
    surface, every = beside_points(faces, corners=corners), np.arange(faces)
    found = surface.normal(every, 0, 0)
    assert np.array_equal(found, np.repeat(found[:1], faces, axis=0))
    t = np.linspace(0.02, 0.98, 9)
    regular = faces == 3 and not corners  # one quartic, whose derivatives lose digits there
    far = 1e-6 if regular else 1e-60
    near = surface.normal(every[:, None], far * t, far * (1 - t))
    assert np.abs(near - found[0]).max() <= (1e-4 if regular else 1e-11)


@pytest.mark.parametrize("faces", [1, 2])
def test_normals_where_sharp_edges_are_points_and_all_is_up_to_others(faces):
    surface = beside_points(faces)
    assert np.isnan(surface.normal(np.arange(faces), 0, 0)).all()


@pytest.mark.skipif(not SCHEMES.is_dir(), reason="no reference numbers here")
@pytest.mark.parametrize("engine", ["reference", "compiled"])
def test_reference_rows(engine):
    """Of sectors, fans, semi-sharp creases, poles: within the bounds of the design."""
    cages = json.loads((SCHEMES / "loop_cages.json").read_text(encoding="utf-8"))
    with np.load(SCHEMES / "loop.npz") as data:
        rows = {name: data[name] for name in data}
    for case in np.unique(rows["case"]).tolist():
        cage, own = cages[case], {name: x[rows["case"] == case] for name, x in rows.items()}
        tags = {
            "creases": {(a, b): float(s) for a, b, s in cage["creases"]},
            "corners": {v: float(s) for v, s in cage["corners"]},
            "boundary": cage["boundary"],
        }
        mesh, size = ls.Mesh(cage["points"], cage["faces"], **tags), np.ptp(cage["points"])
        scheme = LOOP_WARREN if cage["warren"] else LOOP
        surface = ls.LimitSurface(mesh, scheme=scheme, engine=engine)
        places = own["face"], own["u"], own["v"]
        jet = surface.jet(*places, order=2)
        assert np.abs(jet[0, 0] - own["P"]).max() <= 1e-14 * size
        for m, orders in ((1, slice(0, 2)), (2, slice(2, 5))):
            found = np.stack([jet[m - j, j] for j in range(m + 1)], axis=1)
            needed = own["D"][:, orders]
            largest = np.maximum(np.abs(needed).max(axis=(1, 2)), 1e-3 * size)
            error = np.abs(found - needed).max(axis=(1, 2))
            assert (error <= (1e-12 if m == 1 else 1e-11) * largest).all()
        assert np.abs(surface.normal(*places) - own["normal"]).max() <= 1e-12
