"""The oracles for tagged cages against hand calculation, curves, cut meshes, and each other."""

import ast
import itertools
import math
import random
from fractions import Fraction as F
from pathlib import Path

import mpmath
import numpy as np
import oracles
import oracles_creases
import pytest
import zoo
from oracles import ExactSurface, grid_faces, limit_mask
from oracles_creases import INF, Cage, TaggedSurface, refine, refine_times, ring_limit, start
from scipy.interpolate import BSpline

ORDERS = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 1)]
SHARPNESSES = [F(1, 4), F(3, 10), F(3, 4), 1, F(3, 2), F(5, 2), F(47, 10), 7, 10, INF]
TINY = F(1, 10**12)
THIRD = F(1, 3)


def exact(points):
    return [tuple(map(F, point)) for point in points]


def of_zoo(name, **tags):
    points, faces = zoo.ZOO[name]()
    return Cage(exact(points), faces, **tags)


def random_points(n, seed=0):
    rng = random.Random(seed)
    return [tuple(F(rng.randint(-256, 256), 256) for _ in range(3)) for _ in range(n)]


def random_parameters(n, seed=0):
    rng = random.Random(seed)
    return [(F(rng.randint(1, 996), 997), F(rng.randint(1, 990), 991)) for _ in range(n)]


def edges_of(faces):
    return sorted({oracles._edge(*side) for face in faces for side in oracles._sides(face)})


def mixed(seed):
    """A random cage with creases and corners of all kinds."""
    rng = random.Random(seed)
    names = ["cube", "prism_3", "octahedron", "flower_3", "stairs", "grid_3x3", "local_cage_5"]
    names += ["truncated_cube", "carved_cube_1", "carved_grid", "disk_7", "pillow_of_quads"]
    cage, density = of_zoo(rng.choice(names)), rng.choice([0.05, 0.3, 0.8])
    edges = edges_of(cage.faces)
    return cage._replace(
        points=random_points(len(cage.points), seed),
        creases={edge: rng.choice(SHARPNESSES) for edge in edges if rng.random() < density},
        corners={v: rng.choice(SHARPNESSES) for v in range(len(cage.points)) if rng.random() < 0.1},
        boundary=rng.choice(["edge_only", "edge_and_corner"]),
        creasing=rng.choice(oracles_creases.CREASINGS),
        triangles=rng.choice(oracles_creases.TRIANGLES),
    )


mixed_seeds = pytest.mark.parametrize("seed", range(16))


def along_edge(faces, edge, t):
    """The (limit face, u, v) at the fraction t from the edge's first end, in each face there."""
    found = []
    for f, face in enumerate(faces):
        first = sum(1 if len(before) == 4 else len(before) for before in faces[:f])
        for k, side in enumerate(oracles._sides(face)):
            if set(side) == set(edge):
                s, after = (t if side[0] == edge[0] else 1 - t), (k + 1) % len(face)
                if len(face) == 4:
                    (a, b), (c, d) = oracles.CORNERS[k], oracles.CORNERS[after]
                    found.append((first, a + s * (c - a), b + s * (d - b)))
                elif 2 * s <= 1:
                    found.append((first + k, 2 * s, F(0)))
                else:
                    found.append((first + after, F(0), 2 - 2 * s))
    return found


def distance(p, q):
    with mpmath.workdps(60):
        return mpmath.norm(
            [oracles._to_mpf(a) - oracles._to_mpf(b) for a, b in zip(p, q, strict=True)]
        )


def test_imports_nothing_of_the_library():
    tree = ast.parse(Path(oracles_creases.__file__).read_text(encoding="utf-8"))
    names = {a.name for node in ast.walk(tree) if isinstance(node, ast.Import) for a in node.names}
    names |= {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert not [name for name in names if name.startswith("limitsurf")]


# --- without tags ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", list(zoo.ZOO))
def test_untagged_refines_as_the_smooth_oracle(name):
    points, faces = zoo.ZOO[name]()
    levels = 2 if len(faces) < 40 else 1
    for mode in oracles.MODES:
        cage = refine_times(Cage(exact(points), faces, boundary=mode), levels)
        expected = oracles.refine_times(exact(points), faces, levels, mode)
        assert (cage.points, cage.faces) == expected


@pytest.mark.parametrize("mode", oracles.MODES)
@pytest.mark.parametrize(
    "name", ["cube", "flower_5_wide", "carved_cube_1", "disk_7", "stairs", "pillow_of_quads"]
)
def test_untagged_limit_as_the_smooth_oracle(name, mode):
    cage = of_zoo(name, boundary=mode)
    smooth, surface = ExactSurface(cage.points, cage.faces, mode), TaggedSurface(cage)
    rng = random.Random(name)
    special = [(0, 0), (1, 0), (1, 1), (0, 1), (0, THIRD), (F(1, 2), F(1, 4)), (1, TINY)]
    for u, v in random_parameters(3) + special:
        face = rng.randrange(len(surface.limit_faces))
        assert surface.evaluate(face, u, v) == smooth.evaluate(face, u, v)
        for nu in ORDERS:
            found, expected = (s.weights(face, u, v, nu) for s in (surface, smooth))
            if found is None:  # a derivative at a vertex that is not regular
                assert any(nu)
                assert (u, v) in oracles.CORNERS
            else:
                assert found == expected


def test_normal_as_the_smooth_oracle():
    cage = of_zoo("carved_cube_1")
    smooth, surface = ExactSurface(cage.points, cage.faces), TaggedSurface(cage)
    for u, v in [*random_parameters(3), (TINY, 2 * TINY), (0, THIRD)]:
        assert distance(surface.normal(1, u, v), smooth.normal(1, u, v)) < 1e-50


# --- the rules, by hand ---------------------------------------------------------------------------

PLANE = grid_faces(3, 3)  # four quads; vertex 4 in the middle, its neighbours 1, 3, 5, 7


def height(creases, corners=oracles_creases.NOTHING, at=(4,), **options):
    """`PLANE` with one channel, which is 64 at the vertices ``at`` and 0 elsewhere."""
    return Cage([(F(64 * (v in at)),) for v in range(9)], PLANE, creases, corners, **options)


@pytest.mark.parametrize(
    ("creases", "corner", "expected"),
    [
        ({}, 0, 36),  # 9/16
        ({(4, 1): INF}, 0, 36),  # dart
        ({(4, 1): 2, (4, 7): 3}, 0, 48),  # crease: 3/4
        ({(1, 4): 2, (4, 5): 3}, 0, 48),  # round a corner
        ({(4, 1): 2, (4, 7): 3, (4, 3): 1}, 0, 64),
        ({}, 1, 64),
        ({(4, 1): F(1, 2), (4, 7): 2}, 3, 64),
        ({}, F(1, 2), F(64 + 36, 2)),
        ({(4, 1): 1, (4, 7): 1}, 0, 48),
        ({(4, 1): F(1, 2)}, 0, 36),  # dart to smooth
        ({(4, 1): F(1, 2), (4, 7): F(1, 4)}, 0, F(3 * 48 + 5 * 36, 8)),  # crease to smooth
        ({(4, 1): F(1, 2), (4, 7): 2}, 0, F(48 + 36, 2)),  # crease to dart
        ({(4, 1): 2, (4, 7): 2, (4, 3): F(1, 4)}, 0, F(64 + 3 * 48, 4)),  # corner to crease
        ({(4, 1): F(1, 2), (4, 7): F(1, 2)}, F(1, 4), F(5 * 64 + 7 * 36, 12)),
        ({(4, 1): F(1, 2), (4, 7): 2}, F(1, 4), F(3 * 64 + 5 * 36, 8)),  # corner to dart
        (dict.fromkeys([(1, 4), (3, 4), (4, 5), (4, 7)], F(1, 8)), 0, F(64 + 7 * 36, 8)),
    ],
)
def test_vertex_point_by_hand(creases, corner, expected):
    assert refine(height(creases, {4: corner})).points[4] == (expected,)


def test_crease_runs_along_the_edges_that_stay_sharp():
    fine = refine(height({(4, 1): 2, (4, 5): F(1, 2), (4, 7): 3, (4, 3): F(1, 4)}, at=(1, 7)))
    assert fine.points[4] == (F(5, 8) * F(64 + 64, 8),)  # and 3/8 of 0


@pytest.mark.parametrize(
    ("s", "expected"), [(0, 24), (F(1, 4), 26), (F(1, 2), 28), (1, 32), (F(3, 2), 32), (INF, 32)]
)
def test_edge_point_by_hand(s, expected):
    cage = refine(height({(1, 4): s}))
    # Smooth (64 + 16 + 16) / 4, sharp 64 / 2.
    assert cage.points[9 + edges_of(PLANE).index((1, 4))] == (expected,)


def test_sharpness_runs_out():
    cage = height({(1, 4): F(5, 2), (4, 7): 9, (3, 4): 10}, {4: F(3, 2), 0: 3, 5: 12})
    for n in range(4):
        fine = refine_times(cage, n)
        assert fine.corners[4] == max(F(3, 2) - n, 0)
        assert fine.corners[0] == fine.corners[5] == INF  # vertex 0 is a corner of the plane
        around = sorted(s for edge, s in fine.creases.items() if 4 in edge)
        assert around == sorted([max(F(5, 2) - n, 0), 9 - n, INF, 0])
        assert all(s == 0 for v, s in fine.corners.items() if v > 8)


def test_chaikin_sharpness_by_hand():
    new = {edge: 9 + edges_of(PLANE).index(edge) for edge in [(1, 4), (4, 7), (4, 5)]}
    fine = refine(height({(1, 4): 2, (4, 7): 3}, creasing="chaikin"))
    assert fine.creases[4, new[1, 4]] == F(5, 4)  # 3/4 2 + 1/4 3 - 1
    assert fine.creases[4, new[4, 7]] == F(7, 4)  # 3/4 3 + 1/4 2 - 1
    assert fine.creases[1, new[1, 4]] == 1  # the boundary is infinitely sharp, and does not count
    creases = {(1, 4): 2, (4, 7): 3, (4, 5): 7, (3, 4): INF}
    fine = refine(height(creases, creasing="chaikin"))
    assert fine.creases[4, new[1, 4]] == F(7, 4)  # 3/4 2 + 1/4 5 - 1
    assert fine.creases[4, new[4, 5]] == F(39, 8)  # 3/4 7 + 1/4 5/2 - 1
    fine = refine(height({(1, 4): F(1, 2), (4, 7): F(1, 8)}, creasing="chaikin"))
    assert fine.creases[4, new[1, 4]] == 0


def test_chaikin_edge_stays_sharp_between_sharper_ones():
    creases, faces = {(4, 5): 3, (5, 6): F(1, 2), (6, 7): 5}, grid_faces(4, 4)
    points = [(F(64 * (v == 9)),) for v in range(16)]
    new = 16 + edges_of(faces).index((5, 6))
    fine = refine(Cage(points, faces, creases, creasing="chaikin"))
    assert fine.creases[5, new] == F(1, 8)  # 3/4 1/2 + 1/4 3 - 1
    assert fine.creases[6, new] == F(5, 8)  # 3/4 1/2 + 1/4 5 - 1
    assert fine.points[new] == (0,)  # the midpoint
    assert refine(Cage(points, faces, creases)).points[new] == (2,)  # half way to (0 + 0 + 16) / 4
    fine = refine(Cage(points, faces, creases | {(4, 5): 2}, creasing="chaikin"))
    assert fine.points[new] == (2,)  # 3/4 1/2 + 1/4 2 - 1 < 0
    creases = {(4, 5): F(1, 8), (5, 6): F(5, 4), (6, 7): F(1, 8)}
    fine = refine(Cage(points, faces, creases, creasing="chaikin"))
    assert fine.creases[5, new] == fine.creases[6, new] == 0  # 3/4 5/4 + 1/4 1/8 - 1 < 0
    assert fine.points[new] == (0,)  # sharpness 1 is a midpoint, and more is no more


def test_chaikin_is_uniform_along_equal_sharpness():
    faces = grid_faces(4, 5, periodic=(True, True))
    loop = {oracles._edge(i, (i + 1) % 5): F(23, 10) for i in range(5)}
    cages = [Cage(random_points(20), faces, loop, creasing=c) for c in ("uniform", "chaikin")]
    uniform, chaikin = (refine_times(cage, 4) for cage in cages)
    assert uniform[:4] == chaikin[:4]
    uniform, chaikin = (TaggedSurface(cage) for cage in cages)
    for u, v in [*random_parameters(2), (0, THIRD), (0, 0), (TINY, 0)]:
        assert uniform.weights(0, u, v) == chaikin.weights(0, u, v)


TETRAHEDRON = [(0, 0, 0), (12, 0, 0), (0, 12, 0), (0, 0, 12)], zoo.tetrahedron()[1]


def test_smooth_triangles_by_hand():
    fine = refine(Cage(*TETRAHEDRON, triangles="smooth"))
    # 3/100 of each end, 47/100 of the face points (4, 4, 0) and (4, 0, 4).
    assert fine.points[4] == (F(103, 25), F(47, 25), F(47, 25))
    plain = refine(Cage(*TETRAHEDRON))
    assert fine.points[:4] == plain.points[:4]
    assert fine.points[10:] == plain.points[10:]
    fine = refine(Cage(*TETRAHEDRON, {(1, 0): F(1, 4)}, triangles="smooth"))
    assert fine.points[4] == (F(6 + 3 * F(103, 25), 4), F(141, 100), F(141, 100))


def test_smooth_triangle_beside_a_quad_by_hand():
    points = [(0,), (100,), (100,), (0,), (0,)]
    fine = refine(Cage(points, [[0, 1, 2, 3], [1, 0, 4]], triangles="smooth"))
    # 36/100 of the face points 50 and 100/3, 14/100 of the ends.
    assert fine.points[5] == (18 + 12 + 14,)


def test_floats_follow_the_fractions():
    for seed in range(6):
        cage = mixed(seed)
        floats = refine_times(cage._replace(points=np.array(cage.points, float)), 2)
        fractions = refine_times(cage, 2)
        assert floats[1:4] == fractions[1:4]
        difference = np.array(floats.points) - np.array(fractions.points, float)
        assert np.abs(difference).max() < 1e-14


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"creases": {(0, 8): 1}}, "no edge"),
        ({"corners": {9: 1}}, "no vertex"),
        ({"creases": {(0, 1): -1}}, "-1"),
        ({"corners": {0: math.nan}}, "nan"),
        ({"boundary": "corner"}, "boundary 'corner'"),
        ({"creasing": "smooth"}, "creasing 'smooth'"),
        ({"triangles": "loop"}, "triangles 'loop'"),
    ],
)
def test_bad_tags(change, what):
    with pytest.raises(ValueError, match=what):
        refine(height({})._replace(**change))


# --- boundaries, holes, non-manifold parts --------------------------------------------------------


def test_boundary_none():
    cage = Cage(random_points(36), grid_faces(6, 6), boundary="none")
    inner = {6, 7, 8, 11, 12, 13, 16, 17, 18}
    assert start(cage).holes == set(range(25)) - inner
    assert refine(cage).holes == {4 * f + k for f in start(cage).holes for k in range(4)}
    open_cage = cage._replace(boundary="edge_only")
    assert refine(cage).points == refine(open_cage).points
    surface, expected = TaggedSurface(cage), TaggedSurface(open_cage)
    u, v = random_parameters(1)[0]
    assert surface.evaluate(12, u, v) == expected.evaluate(12, u, v)
    assert np.isnan(surface.evaluate(0, u, v)).all()
    assert surface.weights(0, u, v) is None
    assert all(map(mpmath.isnan, surface.normal(0, u, v)))
    # Faces stay where all of the boundary at their vertices is tagged.
    side = {(i, i + 1): 10 for i in range(5)}
    assert start(cage._replace(creases=side)).holes == set(range(25)) - inner - {1, 2, 3}
    assert start(cage._replace(creases={(2, 3): INF})).holes == start(cage).holes
    assert start(cage._replace(holes=[12])).holes == start(cage).holes | {12}


def test_holes_shape_their_neighbours():
    cage = of_zoo("cube", holes=[2])
    whole, surface = TaggedSurface(of_zoo("cube")), TaggedSurface(cage)
    assert surface.evaluate(0, THIRD, 0) == whole.evaluate(0, THIRD, 0)
    assert np.isnan(surface.evaluate(2, THIRD, 0)).all()
    assert refine_times(cage, 2).holes == set(range(32, 48))


def sharp_corners(cage):
    return {v for v, s in start(cage).corners.items() if s == INF}


def assert_as_alone(cage, parts, **tags):
    """The limit over each part, a list of faces, is that of a cage of these faces alone."""
    surface = TaggedSurface(cage)
    for part in parts:
        alone = TaggedSurface(cage._replace(faces=[cage.faces[f] for f in part], **tags))
        for i, f in enumerate(part):
            for u, v in [*random_parameters(2), (0, 0), (1, 0), (1, 1), (0, 1), (THIRD, 0)]:
                assert surface.weights(f, u, v) == alone.weights(i, u, v)


def test_bow_tie():
    cage = Cage(random_points(7), [[0, 1, 2, 3], [2, 4, 5, 6]])
    assert sharp_corners(cage._replace(boundary="edge_only")) == {2}
    assert_as_alone(cage._replace(boundary="edge_only"), [[0], [1]], corners={2: INF})
    assert_as_alone(cage, [[0], [1]])


@pytest.mark.parametrize(
    "faces",
    [
        [[0, 1, 2, 3], [1, 0, 4, 5], [1, 0, 6, 7]],  # an edge of three faces
        [[0, 1, 2, 3], [0, 1, 4, 5], [0, 1, 6, 7], [1, 0, 8, 9]],  # of four
        [[0, 1, 2, 3], [0, 1, 4, 5]],  # of two faces that run along it in the same direction
    ],
)
def test_non_manifold_edge(faces):
    cage = Cage(random_points(10), faces)
    open_cage = cage._replace(boundary="edge_only")
    assert start(open_cage).creases[0, 1] == INF
    assert {0, 1} <= sharp_corners(open_cage) <= {0, 1, *range(len(faces) * 2 + 2, 10)}
    parts = [[f] for f in range(len(faces))]
    assert_as_alone(open_cage, parts, corners={0: INF, 1: INF})
    assert_as_alone(cage, parts)
    fine = refine(cage)
    assert len(fine.points) == 10 + len(edges_of(faces)) + len(faces)  # one point for the edge
    assert fine.points[10] == tuple(sum(x) / 2 for x in zip(*cage.points[:2], strict=True))


def strips(count, turned=()):
    """Pairs of quads that all share the edges (0, 1) and (1, 2)."""
    faces = []
    for s in range(count):
        a, b, c = range(3 * s + 3, 3 * s + 6)
        pair = [[0, 1, b, a], [1, 2, c, b]]
        faces += [face[::-1] for face in pair] if s in turned else pair
    return Cage(random_points(3 * count + 3), faces)


def test_crease_through_non_manifold_edges():
    cage = strips(3, turned=[1])
    assert start(cage).corners[1] == 0  # six faces, five edges
    assert_as_alone(cage, [[0, 1], [2, 3], [4, 5]])
    assert start(strips(2)).corners[1] == INF  # four faces, four edges, but turned the same way
    assert start(strips(2, turned=[1])).corners[1] == 0  # a plane
    assert start(refine(strips(2))).corners[1] == INF
    middle = 6 + 3 + edges_of(strips(2).faces).index((0, 1))
    assert refine_times(strips(2), 2).corners[middle] == 0  # decided on the cage alone


def test_unused_vertices_stay():
    cage = of_zoo("unused_vertices")
    fine = refine_times(cage, 2)
    assert {v for v in sharp_corners(cage) if fine.points[v] == cage.points[v]} == {0, 4, 10}


def test_faces_with_a_vertex_twice():
    """A collapsed quad is one of sharp edges; an edge that a face runs along twice is two edges."""
    points = random_points(4)
    collapsed, quad = Cage(points, [[0, 1, 2, 2]]), Cage([*points[:3], points[2]], [[0, 1, 2, 3]])
    assert set(start(collapsed).creases) == {(0, 1), (0, 2), (1, 2), (2, 2)}
    found, expected = TaggedSurface(collapsed), TaggedSurface(quad)
    for u, v in [*random_parameters(3), (0, 0), (1, 1), (0, 1), (THIRD, 1), (1, 1 - TINY)]:
        assert found.evaluate(0, u, v) == expected.evaluate(0, u, v)
    fine, smooth = refine_times(collapsed, 3), refine_times(quad, 3)
    corners = [[cage.points[v] for face in cage.faces for v in face] for cage in (fine, smooth)]
    assert corners[0] == corners[1]

    folded, quad = Cage(points, [[0, 1, 0, 2]]), Cage([points[i] for i in (0, 1, 0, 2)], quad.faces)
    assert set(start(folded).creases) == {(0, 1), (0, 1, 1), (0, 2), (0, 2, 1)}
    joined = start(folded._replace(faces=[[0, 1, 0, 2], [1, 0, 3]]))
    assert joined.creases[0, 1] == INF  # though it has two faces, one along each direction
    found, expected = TaggedSurface(folded), TaggedSurface(quad)
    for u, v in [*random_parameters(3), (0, 0), (1, 1), (0, THIRD), (1, TINY)]:
        assert found.evaluate(0, u, v) == expected.evaluate(0, u, v)


# --- creases as boundaries, as tensor products, as curves -----------------------------------------


def test_sharp_crease_cuts_a_grid():
    faces = grid_faces(5, 4)  # vertices 4 i + j, faces 3 i + j; the crease along i = 2
    crease = {(4 * 2 + j, 4 * 2 + j + 1): INF for j in range(3)}
    for mode in oracles.MODES:
        corners = {8: INF, 11: INF}  # ends of the crease: there three sharp edges meet
        surface = TaggedSurface(Cage(None, faces, crease, boundary=mode))
        for first, part in ((0, faces[:6]), (6, faces[6:])):
            tagged = TaggedSurface(Cage(None, part, corners=corners, boundary=mode))
            for i in range(6):
                for u, v in [*random_parameters(2, i), (0, 0), (1, 1), (0, THIRD), (1, TINY)]:
                    expected = tagged.weights(i, u, v)
                    assert surface.weights(first + i, u, v) == expected
                    if mode == "edge_and_corner":
                        assert ExactSurface(None, part, mode).weights(i, u, v) == expected


@pytest.mark.parametrize("name", ["cube", "sphere_8", "trapezohedron_5"])
def test_closed_sharp_crease_cuts_a_sphere(name):
    cage = of_zoo(name, boundary="edge_only")
    part = [0] if name == "cube" else list(range(8)) if name == "sphere_8" else list(range(5))
    rest = [f for f in range(len(cage.faces)) if f not in part]
    sides = [set(edges_of([cage.faces[f] for f in faces])) for faces in (part, rest)]
    crease = dict.fromkeys(sides[0] & sides[1], 12)
    assert crease
    surface = TaggedSurface(cage._replace(creases=crease))
    for faces in (part, rest):
        cut = [cage.faces[f] for f in faces]
        expected = ExactSurface(cage.points, cut, "edge_only")
        first = {f: i for i, (f, k) in reversed(list(enumerate(surface.limit_faces)))}
        for i, (f, k) in enumerate(expected.limit_faces):
            limit_face = first[faces[f]] + max(k, 0)
            for u, v in [*random_parameters(1, i), (0, 0), (1, 0), (TINY, TINY), (0, THIRD)]:
                assert surface.weights(limit_face, u, v) == expected.weights(i, u, v)


def curve_step(n, sharpness):
    """One step of a cubic B-spline curve with knots of such sharpness, clamped: (2 n - 1, n)."""
    A = np.full((2 * n - 1, n), F(0))
    for i in range(n):
        w = 1 if i in (0, n - 1) else min(sharpness.get(i, 0), 1)
        A[2 * i, i] += w
        if w < 1:
            A[2 * i, i - 1 : i + 2] += (1 - w) * np.array([F(1, 8), F(6, 8), F(1, 8)])
    for i in range(n - 1):
        A[2 * i + 1, i : i + 2] = F(1, 2)
    return A


@pytest.mark.parametrize("s", SHARPNESSES)
def test_straight_creases_are_tensor_products(s):
    n, m, sharpness = 7, 4, {1: F(3, 10), 3: s, 4: F(5, 2)}
    points = [point[:1] for point in random_points(n * m, 5)]
    creases = {(m * i + j, m * i + j + 1): x for i, x in sharpness.items() for j in range(m - 1)}
    cage = Cage(points, grid_faces(n, m), creases)
    grid = np.array(points).reshape(n, m)
    place = [(i, j) for i in range(n) for j in range(m)]
    for _ in range(3):
        across, along = curve_step(len(grid), sharpness), curve_step(grid.shape[1], {})
        grid = across @ grid @ along.T
        sharpness = {2 * i: max(x - 1, 0) for i, x in sharpness.items()}
        pairs = [[place[v] for v in edge] for edge in edges_of(cage.faces)]
        quads = [[place[v] for v in face] for face in cage.faces]
        cage = refine(cage)
        place = [(2 * i, 2 * j) for i, j in place]
        place += [tuple(map(sum, zip(*pair, strict=True))) for pair in pairs]
        place += [tuple(sum(x) // 2 for x in zip(*quad, strict=True)) for quad in quads]
        assert all(cage.points[v] == (grid[ij],) for v, ij in enumerate(place))


def spline_curve(polygon, spans, t, closed=False):
    """Uniform cubic B-spline of a polygon at t in some spans, clamped by reflection or closed."""
    P = np.array(polygon, dtype=float)
    if closed:
        P = np.concatenate([P[-1:], P, P[:2]])
    else:
        P = np.concatenate([2 * P[:1] - P[1:2], P, 2 * P[-1:] - P[-2:-1]])
    spline = BSpline(np.arange(-3.0, len(P) + 1.0), P, 3)
    return spline(np.array(spans) + float(t))


def path_through(faces, length, seed):
    """Vertices of a path without chords."""
    rng = random.Random(seed)
    neighbours = {}
    for a, b in edges_of(faces):
        neighbours.setdefault(a, set()).add(b)
        neighbours.setdefault(b, set()).add(a)
    path = [rng.choice(sorted(neighbours))]
    while len(path) < length:
        free = [v for v in neighbours[path[-1]] if not neighbours[v] & set(path[:-1])]
        path.append(rng.choice(sorted(set(free) - set(path))))
    return path


@pytest.mark.parametrize("name", ["sphere_8", "carved_torus", "dodecahedron"])
def test_sharp_crease_is_a_clamped_spline(name):
    cage = of_zoo(name)
    path = path_through(cage.faces, 5, 1)
    steps = [oracles._edge(a, b) for a, b in itertools.pairwise(path)]
    cage = cage._replace(creases=dict.fromkeys(steps, INF), corners={path[0]: INF, path[-1]: INF})
    surface, polygon = TaggedSurface(cage), [cage.points[v] for v in path]
    for i, (a, b) in enumerate(itertools.pairwise(path)):
        for t in (F(0), F(2, 7), F(1, 2), F(1)):
            (expected,) = spline_curve(polygon, [i], t)
            for query in along_edge(cage.faces, (a, b), t):
                found = np.array(surface.evaluate(*query), dtype=float)
                np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("name", ["flower_5_wide", "disk_7", "poles_at_the_boundary_6"])
def test_boundary_is_a_closed_spline(name):
    cage = of_zoo(name, boundary="edge_only")
    directed = {side for face in cage.faces for side in oracles._sides(face)}
    after = {a: b for a, b in directed if (b, a) not in directed}
    loop = [min(after)]
    while after[loop[-1]] != loop[0]:
        loop.append(after[loop[-1]])
    surface, polygon = TaggedSurface(cage), [cage.points[v] for v in loop]
    for i, a in enumerate(loop):
        (query,) = along_edge(cage.faces, (a, after[a]), F(2, 7))
        (expected,) = spline_curve(polygon, [i], F(2, 7), closed=True)
        found = np.array(surface.evaluate(*query), dtype=float)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)


def test_sharpness_from_zero_to_infinity():
    cage = of_zoo("truncated_cube")
    edges = edges_of(cage.faces)[::5]
    query = along_edge(cage.faces, edges[0], THIRD)[0]

    def limit(s, corner=0):
        tagged = cage._replace(creases=dict.fromkeys(edges, s), corners={edges[0][0]: corner})
        return TaggedSurface(tagged).evaluate(*query)

    assert limit(0) == TaggedSurface(cage).evaluate(*query)
    assert limit(10) == limit(12) == limit(INF)
    assert distance(limit(F(1, 2**40)), limit(0)) < 1e-11
    assert distance(limit(F(399, 40)), limit(INF)) < 1e-2
    distances = [distance(limit(F(k, 2)), limit(INF)) for k in range(12)]
    assert distances == sorted(distances, reverse=True)
    assert limit(F(1, 2)) != limit(F(1, 2), 3)


# --- limits at vertices ---------------------------------------------------------------------------


@pytest.mark.parametrize("n", [2, 3, 4, 5, 8, 13])
def test_limits_of_rings(n):
    centre, edge, diagonal = limit_mask(n)
    assert ring_limit(n) == [centre] + [edge] * n + [diagonal] * n
    crease = [F(2, 3)] + [F(0)] * (2 * n)
    crease[1] = crease[n] = F(1, 6)
    assert ring_limit(n, frozenset([0, n - 1])) == crease
    assert ring_limit(n, frozenset(range(min(3, n)))) == ([1] + [0] * (2 * n) if n > 2 else crease)
    dart = ring_limit(n, frozenset([0]))
    assert sum(dart) == 1
    assert min(dart) > 0
    ends, diagonals = dart[1 : n + 1], dart[n + 1 :]
    assert ends[1:] == ends[:0:-1]  # symmetric about the sharp edge
    assert diagonals == diagonals[::-1]


def test_dart_limit_is_the_limit_of_refinement():
    points, faces = oracles.local_cage(5)
    cage = Cage(points, faces, {(0, faces[0][1]): INF})
    limit = TaggedSurface(cage).evaluate(0, 0, 0)
    errors = [distance(refine_times(cage, n).points[0], limit) for n in range(5)]
    assert all(after < 0.6 * before for before, after in itertools.pairwise(errors))


# --- any cage -------------------------------------------------------------------------------------


@mixed_seeds
def test_weights_are_affine(seed):
    cage = mixed(seed)
    surface, plain = TaggedSurface(cage), TaggedSurface(cage._replace(points=None))

    def moved(point, shift):
        return tuple(3 * point[i] + point[i - 1] - shift for i in range(3))

    moved_points = [moved(point, F(2, 7)) for point in cage.points]
    moved_surface = TaggedSurface(cage._replace(points=moved_points))
    rng = random.Random(seed)
    for u, v in [*random_parameters(3, seed), (0, 0), (1, 1), (0, THIRD), (1, TINY)]:
        face = rng.randrange(len(surface.limit_faces))
        for nu in ORDERS:
            weights, value = plain.weights(face, u, v, nu), surface.evaluate(face, u, v, nu)
            if weights is None:
                assert any(nu)
                assert np.isnan(value).all()
                continue
            assert sum(weights.values()) == (not any(nu))
            terms = [[w * x for x in cage.points[i]] for i, w in weights.items()]
            assert value == tuple(sum(term[i] for term in terms) for i in range(3))
            expected = moved(value, F(0) if any(nu) else F(2, 7))
            assert moved_surface.evaluate(face, u, v, nu) == expected


def assert_step_changes_nothing(cage, children, parameters):
    """The limit is that of the refined cage, for pairs of a child face and (s, t) on it."""
    coarse, refined = TaggedSurface(cage), TaggedSurface(refine(cage))
    squares = oracles.refined_parameters(cage.faces, 1)
    for child, (s, t) in zip(children, parameters, strict=True):
        face, (p, q, _, r) = squares[child]
        (su, sv), (tu, tv) = ((x - p[0], y - p[1]) for x, y in (q, r))
        u, v = p[0] + s * su + t * tu, p[1] + s * sv + t * tv
        assert coarse.evaluate(face, u, v) == refined.evaluate(child, s, t)
        if 0 < s < 1 and 0 < t < 1:
            du, dv = (coarse.evaluate(face, u, v, nu) for nu in ((1, 0), (0, 1)))
            expected = tuple(su * a + sv * b for a, b in zip(du, dv, strict=True))
            assert refined.evaluate(child, s, t, (1, 0)) == expected


@mixed_seeds
def test_one_step_more_changes_nothing(seed):
    cage = mixed(seed)
    parameters = [*random_parameters(3, seed), *oracles.CORNERS, (0, THIRD), (TINY, TINY)]
    n_children = sum(map(len, cage.faces))
    children = random.Random(seed).choices(range(n_children), k=len(parameters))
    assert_step_changes_nothing(cage, children, parameters)


def test_chaikin_depends_on_two_rings():
    """Edge (12, 13) ends at a corner of face 5; what keeps it sharp at its other end is beyond."""
    creases = {(12, 17): 7, (12, 13): F(3, 4), (13, 14): 7}
    cage = Cage(random_points(25), grid_faces(5, 5), creases)
    for creasing in oracles_creases.CREASINGS:
        parameters = [*random_parameters(3), (0, 0)]
        assert_step_changes_nothing(cage._replace(creasing=creasing), [22] * 4, parameters)


@mixed_seeds
def test_continuous_across_edges(seed):
    cage = mixed(seed)
    surface, creases = TaggedSurface(cage), start(cage).creases
    for edge in random.Random(seed).sample(edges_of(cage.faces), 4):
        for t in (F(2, 7), F(1, 2), TINY):
            queries = along_edge(cage.faces, edge, t)
            assert len({surface.evaluate(*query) for query in queries}) == 1
            if creases[edge] < INF:
                first, second = (surface.normal(*query) for query in queries)
                assert distance(first, second) < 1e-45


@mixed_seeds
def test_continuous_at_vertices(seed):
    cage = mixed(seed)
    surface = TaggedSurface(cage)
    for face in random.Random(seed).choices(range(len(surface.limit_faces)), k=4):
        for a, b in oracles.CORNERS:
            u, v = (abs(x - TINY) for x in (a, b))
            assert distance(surface.evaluate(face, u, v), surface.evaluate(face, a, b)) < 1e-5


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 5, 8])
def test_refinement_converges_to_the_limit(seed):
    cage = mixed(seed)
    surface, rng = TaggedSurface(cage), random.Random(seed)
    floats = cage._replace(points=[tuple(map(float, p)) for p in cage.points])
    errors = []
    for levels in (3, 4, 5) if len(cage.faces) < 9 else (2, 3, 4):
        fine = refine_times(floats, levels)
        parameters = oracles.refined_parameters(cage.faces, levels)
        errors.append(0)
        for child in rng.sample(range(len(fine.faces)), 60):
            face, corners = parameters[child]
            found = fine.points[fine.faces[child][0]]
            limit = np.array(surface.evaluate(face, *corners[0]), dtype=float)
            errors[-1] = max(errors[-1], np.abs(limit - found).max())
    assert errors[2] < 0.7 * errors[1] < 0.5 * errors[0]
    assert errors[2] < 0.02


def test_random_faces():
    """Faces put together at random: non-manifold, of any orientation, with vertices repeated."""
    for seed in range(12):
        rng = random.Random(seed)
        faces = [rng.sample(range(7), rng.choice([3, 4, 4, 5])) for _ in range(4)]
        faces.append(rng.choices(range(7), k=4))
        cage = Cage(random_points(7, seed), faces, boundary=rng.choice(["edge_only", "none"]))
        cage = cage._replace(creases={edges_of(faces)[0]: F(3, 2)}, corners={3: F(1, 2)})
        fine = refine(cage)
        coarse, refined = (TaggedSurface(c._replace(holes=())) for c in (start(cage), fine))
        parameters = oracles.refined_parameters(cage.faces, 1)
        for child in rng.sample(range(len(fine.faces)), 5):
            face, corners = parameters[child]
            middle = [sum(x) / 4 for x in zip(*corners, strict=True)]
            for (u, v), (s, t) in zip(corners, oracles.CORNERS, strict=True):
                assert coarse.evaluate(face, u, v) == refined.evaluate(child, s, t)
            assert coarse.evaluate(face, *middle) == refined.evaluate(child, F(1, 2), F(1, 2))
            assert sum(coarse.weights(face, *middle).values()) == 1


def test_parameters_outside():
    with pytest.raises(ValueError, match="need both in"):
        TaggedSurface(of_zoo("cube")).evaluate(0, 2, 0)
