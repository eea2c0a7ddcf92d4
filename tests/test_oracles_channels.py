"""The oracle of face-varying channels against numbers worked out by hand and against cut meshes."""

import ast
import itertools
import math
import random
from fractions import Fraction as F
from pathlib import Path

import oracles
import oracles_channels
import oracles_creases
import pytest
from oracles import CUBE_FACES, grid_faces
from oracles_channels import MODES, start, step

HALF = F(1, 2)
ALL_BUT_ALL = MODES[:-1]

# Two by two quads: vertex 4 in the middle, faces counter-clockwise around it 0, 1, 3, 2.
GRID = [[0, 1, 4, 3], [1, 2, 5, 4], [3, 4, 7, 6], [4, 5, 8, 7]]


def begin(faces, copies, numbers, mode, **tags):
    """A channel of scalars, given per corner by name; ``numbers`` maps names to scalars, else 0."""
    names = list(dict.fromkeys(itertools.chain(*copies)))
    return start(
        faces,
        max(itertools.chain(*faces)) + 1,
        tags.get("creases", {}),
        tags.get("corners", {}),
        tags.get("boundary", "edge_and_corner"),
        tags.get("creasing", "uniform"),
        tags.get("triangles", "catmull-clark"),
        [(numbers.get(name, 0),) for name in names],
        [names.index(name) for name in itertools.chain(*copies)],
        mode,
    )


def split(faces, sides):
    """A name (vertex, side) for each corner: faces of one side share their values."""
    return [[(v, side) for v in face] for face, side in zip(faces, sides, strict=True)]


def at_corner(state, face, corner):
    (value,) = state.values[state.corner_values[face][corner]]
    return value


def at_vertex(state, v):
    """The numbers of vertex v in the faces around it."""
    corners = [(f, i) for f, face in enumerate(state.faces) for i, w in enumerate(face) if w == v]
    return {at_corner(state, *corner) for corner in corners}


def in_faces(state, v, faces):
    """The numbers of vertex v of the cage in children of ``faces``, when all faces are quads."""
    children = [4 * f + i for f in faces for i in range(4)]
    return {at_corner(state, f, 0) for f in children if state.faces[f][0] == v}


def corner_points(state):
    return [state.values[index] for index in state.face_indices]


def refine_times(state, levels):
    for _ in range(levels):
        state = step(state)
    return state


def test_oracle_imports_nothing_of_the_library():
    tree = ast.parse(Path(oracles_channels.__file__).read_text(encoding="utf-8"))
    names = {a.name for node in ast.walk(tree) if isinstance(node, ast.Import) for a in node.names}
    names |= {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert names == {"math", "operator", "collections", "dataclasses", "fractions"}


# --- seams ----------------------------------------------------------------------------------------


def test_seam_across_a_grid():
    copies = split(GRID, "lrlr")  # along 1, 4, 7
    state = step(begin(GRID, copies, {(4, "l"): 8}, "corners_only"))
    # Face 0 is (0, 1, 4, 3); its children are at 0, 1, 4, 3.
    child = [at_corner(state, 2, i) for i in range(4)]  # corner 4, edge to 3, face, edge to 1
    assert child == [6, F(8 + 0 + 2 + 2, 4), 2, 4]
    assert [at_corner(state, 4 + 3, i) for i in range(4)] == [0, 0, 0, 0]  # the other side
    assert at_vertex(state, 1) == {0}
    assert len(state.values) == 9 + 3 + 12 + 2 + 4  # two on each vertex and edge of the seam

    state = step(state)  # on the seam from 4 to 1: 6 at 4, 4 in the middle, 0 at 1
    middle = state.faces[4 * 2 + 3][0]  # was the edge point
    assert at_vertex(state, middle) == {F(6 * 4 + 6 + 0, 8), 0}
    assert at_vertex(state, 4) == {F(6 * 6 + 4 + 4, 8), 0}


def test_end_of_a_seam_on_the_boundary():
    copies = split(GRID, "lrlr")
    numbers = {(1, "l"): 16, (0, "l"): 32, (4, "l"): 64}
    for mode in MODES:
        state = step(begin(GRID, copies, numbers, mode))
        moved = F(6 * 16 + 32 + 64, 8) if mode == "none" else 16
        assert at_vertex(state, 1) == {moved, 0}


def test_dart():
    """The seam 1-4 ends at 4, which has one value: a crease from one copy of 1 to the other."""
    copies = [[(v, "l" if (v, f) == (1, 0) else "") for v in face] for f, face in enumerate(GRID)]
    numbers = {(4, ""): 8, (1, "l"): 16, (1, ""): 32}
    for mode in MODES:
        state = step(begin(GRID, copies, numbers, mode))
        smooth = mode in ("none", "corners_only", "corners_plus1")
        assert at_vertex(state, 4) == {F(6 * 8 + 16 + 32, 8) if smooth else 8}
        middle = state.faces[2][3]  # of the seam, in the child of face 0 at 4
        assert at_vertex(state, middle) == {12, 20}
        if mode != "all":  # no seam: 4 and 3, faces 0 and 2
            assert at_vertex(state, state.faces[2][1]) == {F(8 + 0 + F(8 + 16, 4) + F(8, 4), 4)}


def test_dart_with_a_crease_is_a_corner():
    copies = [[(v, "l" if (v, f) == (1, 0) else "") for v in face] for f, face in enumerate(GRID)]
    numbers = {(4, ""): 8, (1, "l"): 16, (1, ""): 32}
    state = begin(GRID, copies, numbers, "none", creases={(4, 5): math.inf})
    assert at_vertex(step(state), 4) == {8}
    state = begin(GRID, copies, numbers, "none", creases={(1, 4): math.inf})  # on the seam
    assert at_vertex(step(state), 4) == {12}


# --- corners --------------------------------------------------------------------------------------


@pytest.mark.parametrize("boundary", ["none", "edge_only", "edge_and_corner"])
@pytest.mark.parametrize("mode", MODES)
def test_corner_of_the_cage(mode, boundary):
    """A single quad: smooth only if both the boundary and the channel say so."""
    face = [[0, 1, 2, 3]]
    state = step(begin(face, face, {0: 8}, mode, boundary=boundary))
    smooth = mode == "none" and boundary != "edge_and_corner"
    assert at_vertex(state, 0) == {6 if smooth else 8}


# Vertex 4's faces on sides "a", "b", ...: which sides keep their value, mode by mode.
@pytest.mark.parametrize(
    ("sides", "kept"),
    [
        ("aabb", ["", "", "", "", "ab", "ab"]),
        ("aaab", ["", "b", "b", "ab", "ab", "ab"]),
        ("aabc", ["", "bc", "abc", "abc", "abc", "abc"]),
        ("abab", ["ab"] * 6),  # each value has two fans
    ],
)
@pytest.mark.parametrize("mode", MODES)
def test_corners_by_mode(sides, kept, mode):
    around = dict(zip([0, 1, 3, 2], sides, strict=True))  # counter-clockwise
    copies = split(GRID, [around[f] for f in range(4)])
    state = step(begin(GRID, copies, {(4, side): 8 for side in sides}, mode))
    for side in set(sides):
        faces = {f for f in around if around[f] == side}
        expected = 8 if side in kept[MODES.index(mode)] else 6
        assert in_faces(state, 4, faces) == {expected}


def test_boundaries_stay_straight():
    """Also the geometry's boundary is linear then, and nothing else is."""
    numbers = {(v, "a"): v * v for v in range(9)}
    state = begin(GRID, split(GRID, "aaaa"), numbers, "boundaries")
    for level in range(1, 4):
        state = step(state)
        for v in (0, 1, 2, 3, 5, 6, 7, 8):
            assert at_vertex(state, v) == {v * v}
        along = {at_corner(state, f, 1) for f in range(len(state.faces)) if state.faces[f][0] == 1}
        assert along >= {1 + F(4 - 1, 2**level)}  # towards 2
    plain, straight = (
        step(begin(GRID, split(GRID, "aaaa"), numbers, mode)) for mode in ("none", "boundaries")
    )
    assert at_vertex(plain, 4) == at_vertex(straight, 4)
    assert at_vertex(plain, 1) != at_vertex(straight, 1)


def test_vertex_tags_hold_for_every_value():
    copies = split(GRID, "lrlr")
    numbers = {(4, "l"): 8, (4, "r"): 16}
    state = step(begin(GRID, copies, numbers, "none", corners={4: math.inf}))
    assert at_vertex(state, 4) == {8, 16}
    state = step(begin(GRID, copies, numbers, "none", corners={4: F(1, 4)}))
    assert at_vertex(state, 4) == {F(8 + 3 * 6, 4), F(16 + 3 * 12, 4)}
    state = step(begin(GRID, copies, numbers, "none", corners={4: F(5, 4)}))
    assert at_vertex(state, 4) == {8, 16}
    assert at_vertex(step(state), 4) == {F(8 + 3 * 7, 4), F(16 + 3 * 14, 4)}  # edge points 4 and 8


# --- sharpness next to a seam ---------------------------------------------------------------------

SEAM = split(GRID, "llrr")  # along 3, 4, 5; 1-4 lies inside "l", 4-7 inside "r"
EIGHTS = {(4, "l"): 8, (4, "r"): 16}  # both creases would go to three quarters


def test_semi_sharp_edge_inside_a_fan():
    state = step(begin(GRID, SEAM, EIGHTS, "corners_only", creases={(1, 4): HALF}))
    assert at_vertex(state, 4) == {F(8 + 6, 2), 12}
    state = step(begin(GRID, SEAM, EIGHTS, "corners_only", creases={(1, 4): F(3, 2)}))
    assert at_vertex(state, 4) == {8, 12}
    # The edges of the seam are as sharp as can be, whatever the geometry says.
    state = step(begin(GRID, SEAM, EIGHTS, "corners_only", creases={(4, 5): 1, (3, 4): 2}))
    assert at_vertex(state, 4) == {6, 12}
    state = step(begin(GRID, SEAM, EIGHTS, "corners_only", creases={(1, 4): math.inf}))
    assert at_vertex(state, 4) == {8, 12}


@pytest.mark.parametrize("mode", ["corners_plus1", "corners_plus2"])
def test_value_that_depends_on_the_other(mode):
    state = step(begin(GRID, SEAM, EIGHTS, mode, creases={(1, 4): HALF}))
    assert at_vertex(state, 4) == {F(8 + 6, 2), F(16 + 12, 2)}
    state = step(begin(GRID, SEAM, EIGHTS, mode, creases={(1, 4): F(3, 2)}))
    assert at_vertex(state, 4) == {8, 16}
    # Along the seam 8, 4, 0: crease to 7, half way; 16, 8, 0 likewise.
    assert at_vertex(step(state), 4) == {F(15, 2), 15}
    # Sharp for ever: both.
    state = refine_times(begin(GRID, SEAM, EIGHTS, mode, creases={(1, 4): 10}), 3)
    assert at_vertex(state, 4) == {8, 16}
    # Each with an edge of its own: no dependence.
    state = step(begin(GRID, SEAM, EIGHTS, mode, creases={(1, 4): HALF, (4, 7): F(7, 2)}))
    assert at_vertex(state, 4) == {7, 16}
    # Vertex sharpness holds both already.
    state = step(begin(GRID, SEAM, EIGHTS, mode, creases={(1, 4): 3}, corners={4: HALF}))
    assert at_vertex(state, 4) == {8, 14}


@pytest.mark.parametrize("mode", ["corners_plus1", "corners_plus2"])
def test_dependent_value_is_released_late_beside_a_semi_sharp_seam(mode):
    creases = {(1, 4): HALF, (4, 5): F(5, 2)}
    state = step(begin(GRID, SEAM, EIGHTS, mode, creases=creases))
    assert at_vertex(state, 4) == {7, 16}
    state = step(state)  # 7 with 4 on both sides, 16 with 8
    assert at_vertex(state, 4) == {F(6 * 7 + 8, 8), 14}


def test_chaikin_counts_the_edges_of_the_seam():
    tags = {"creases": {(1, 4): HALF, (4, 5): 9}, "creasing": "chaikin"}
    state = step(begin(GRID, SEAM, EIGHTS, "corners_only", **tags))
    assert at_vertex(state, 4) == {8, 12}  # 3/8 + 9/4 - 1 is left of 1/2
    halves = {s for e, s in state.edge_sharpness.items() if 4 in e}
    assert halves == {0, F(13, 8), F(3, 4) * 9 + F(1, 8) - 1}


def test_semi_sharp_edge_point():
    copies = split(GRID, "llrr")
    state = step(begin(GRID, copies, EIGHTS, "none", creases={(1, 4): F(1, 4)}))
    middle = state.faces[2][3]
    assert at_vertex(state, middle) == {F(1, 4) * 4 + F(3, 4) * F(8 + 2 + 2, 4)}


# --- the geometry's rules -------------------------------------------------------------------------


def test_cube_by_hand():
    state = step(begin(CUBE_FACES, CUBE_FACES, {v: v // 4 for v in range(8)}, "corners_plus1"))
    assert at_vertex(state, 0) == {F(2, 9)}
    assert at_vertex(state, 8) == {F(1, 8)}  # edge (0, 1)
    assert at_vertex(state, 8 + 12) == {0}  # face 0


def test_polygons():
    faces = [[0, 1, 2, 3, 4], [1, 0, 5]]
    copies = [["a", "b", "c", "d", "e"], ["b", "a", "f"]]
    numbers = {"a": 30, "f": 15}
    state = step(begin(faces, copies, numbers, "corners_only"))
    assert at_corner(state, 0, 2) == 6
    assert at_corner(state, 5, 2) == 15
    assert at_corner(state, 0, 1) == F(30 + 6 + 15, 4)
    assert at_corner(state, 0, 3) == 15
    assert at_vertex(state, 0) == {F(6 * 30 + 0 + 15, 8)}
    state = step(begin(faces, copies, numbers, "corners_only", triangles="smooth"))
    w = (F(47, 100) + F(1, 4)) / 2
    assert at_corner(state, 0, 1) == (HALF - w) * 30 + w * (6 + 15)

    copies[1] = ["b", "A", "f"]  # a seam
    state = step(begin(faces, copies, numbers | {"A": 60}, "corners_only", triangles="smooth"))
    assert (at_corner(state, 0, 1), at_corner(state, 6, 1)) == (15, F(60 + 15, 2))
    assert (at_corner(state, 0, 0), at_corner(state, 6, 0)) == (30, 60)  # one face each


def _random_tags(faces, seed):
    rng = random.Random(seed)
    sharpness = [HALF, F(3, 4), 1, F(3, 2), F(5, 2), 10, math.inf]
    edges = {tuple(sorted((a, face[i - 1]))) for face in faces for i, a in enumerate(face)}
    n = max(itertools.chain(*faces)) + 1
    return {
        "creases": {e: rng.choice(sharpness) for e in sorted(edges) if rng.random() < 0.4},
        "corners": {v: rng.choice(sharpness) for v in range(n) if rng.random() < 0.2},
        "boundary": rng.choice(oracles_creases.BOUNDARIES),
        "creasing": rng.choice(oracles_creases.CREASINGS),
        "triangles": rng.choice(oracles_creases.TRIANGLES),
    }


FIN = [*GRID, [1, 4, 9, 10]]  # a third face at edge 1-4
BOW = [*GRID, [8, 9, 10, 11]]  # touches the grid at 8
CAGES = {
    "grid": grid_faces(4, 4),
    "torus": grid_faces(3, 4, (True, True)),
    "cube": CUBE_FACES,
    "triangles": [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1], [5, 2, 1], [5, 3, 2]],
    "pentagon": [[0, 1, 2, 3, 4], [1, 0, 5], [2, 1, 5, 6]],
    "fin": FIN,
    "bow": BOW,
}
cage_faces = pytest.mark.parametrize("faces", list(CAGES.values()), ids=list(CAGES))


@cage_faces
@pytest.mark.parametrize("seed", range(4))
def test_values_without_seams_follow_the_vertex_rule(faces, seed):
    """Under "none"; and under the other modes if no boundary is touched by them."""
    tags = _random_tags(faces, seed)
    n = max(itertools.chain(*faces)) + 1
    points = [(F(v**2 % 7), F(v**3 % 11)) for v in range(n)]
    cage = oracles_creases.refine_times(oracles_creases.Cage(points, faces, **tags), 2)
    expected = [tuple(cage.points[v]) for face in cage.faces for v in face]
    reversed_indices = [n - v for face in faces for v in face]
    values = [(0, 0), *reversed(points)]
    closed = all(
        sum({a, b} <= set(face) for face in faces) > 1
        for face in faces
        for a, b in itertools.pairwise([*face, face[0]])
    )
    for mode in ALL_BUT_ALL if closed or tags["boundary"] == "edge_and_corner" else ["none"]:
        if mode == "boundaries" and not closed:
            continue
        state = start(faces, n, *[*tags.values(), values, reversed_indices, mode])
        assert corner_points(refine_times(state, 2)) == expected


# --- whatever the numbering -----------------------------------------------------------------------


def _random_copies(faces, seed, n_seams=4):
    """Names for the corners: equal around a vertex wherever two faces meet at no seam."""
    rng = random.Random(seed)
    sides = {}
    for f, face in enumerate(faces):
        for a, b in itertools.pairwise([*face, face[0]]):
            sides.setdefault(tuple(sorted((a, b))), []).append(f)
    seams = set(rng.sample(sorted(sides), min(n_seams, len(sides))))
    name = {(f, v): (f, v) for f, face in enumerate(faces) for v in face}
    for _ in name:  # as long as anything may change
        for edge, around in sides.items():
            if edge not in seams:
                for v in edge:
                    least = min(name[f, v] for f in around)
                    name |= {(f, v): least for f in around}
    return [[name[f, v] for v in face] for f, face in enumerate(faces)]


def _random_numbers(copies, seed):
    rng = random.Random(seed)
    return {name: rng.randint(-64, 64) for name in sorted(set(itertools.chain(*copies)))}


@cage_faces
@pytest.mark.parametrize("mode", MODES)
def test_numbering_does_not_matter(faces, mode):
    for seed in range(3):
        tags = _random_tags(faces, seed)
        copies = _random_copies(faces, seed)
        numbers = _random_numbers(copies, seed)
        expected = corner_points(refine_times(begin(faces, copies, numbers, mode, **tags), 2))

        rng = random.Random(seed)
        order = rng.sample(range(len(faces)), len(faces))
        turn = [rng.randrange(len(faces[f])) for f in order]
        new_faces, new_copies = (
            [x[f][k:] + x[f][:k] for f, k in zip(order, turn, strict=True)] for x in (faces, copies)
        )
        state = refine_times(begin(new_faces, new_copies, numbers, mode, **tags), 2)
        got = iter(corner_points(state))
        where = {}
        for f, k in zip(order, turn, strict=True):  # 4 children of each child, 4 corners each
            size = len(faces[f])
            for i in range(size):
                where[f, (i + k) % size] = list(itertools.islice(got, 16))
        again = [where[f, i] for f, face in enumerate(faces) for i in range(len(face))]
        assert list(itertools.chain(*again)) == expected


def test_index_shared_by_different_vertices():
    """One index for two vertices: as if each had its own, with equal values."""
    copies = split(GRID, "lrlr")
    numbers = {(4, "l"): 8, (0, "l"): 8, (5, "r"): 8, (1, "r"): 8}
    shared = [["same" if numbers.get(name) else name for name in names] for names in copies]
    for mode in MODES:
        own = refine_times(begin(GRID, copies, numbers, mode), 2)
        one = refine_times(begin(GRID, shared, {"same": 8}, mode), 2)
        assert corner_points(own) == corner_points(one)

    # Here index "x" is at both ends of the edge 1-4, crosswise in its two faces: a seam.
    faces = grid_faces(3, 2)
    copies = [[0, "x", "y", 3], ["y", 2, 5, "x"]]
    state = step(begin(faces, copies, {"x": 8, "y": 16}, "corners_only"))
    assert (at_corner(state, 1, 0), at_corner(state, 4, 0)) == (8, 16)
    assert at_vertex(state, state.faces[1][1]) == {12}


# --- "all", and cages that are not manifold -------------------------------------------------------


def test_all_is_bilinear():
    rng = random.Random(0)
    faces = grid_faces(4, 4)
    copies = _random_copies(faces, 0)
    numbers = _random_numbers(copies, 0)
    tags = {"creases": {(5, 6): 3}, "corners": {5: 2}, "triangles": "smooth"}
    state = refine_times(begin(faces, copies, numbers, "all", **tags), 3)
    parameters = oracles.refined_parameters(faces, 3)
    assert len(parameters) == len(state.faces)
    for f, (parent, corners) in enumerate(parameters):
        a, b, c, d = (numbers[name] for name in copies[parent])
        i = rng.randrange(4)
        u, v = corners[i]
        expected = (a * (1 - u) + b * u) * (1 - v) + (d * (1 - u) + c * u) * v
        assert at_corner(state, f, i) == expected


def test_matching_values_at_a_fin():
    """All three faces agree: values follow the geometry, sharp at both ends of the edge."""
    state = step(begin(FIN, FIN, {4: 8, 1: 16}, "corners_only"))
    assert at_vertex(state, 4) == {8}
    assert at_vertex(state, 1) == {16}
    assert at_vertex(state, state.faces[2][3]) == {12}


def test_seam_at_a_fin():
    """With a seam anywhere at a vertex that is not manifold, all of its values stay."""
    copies = split(FIN, "lllrl")  # face 3 apart: a seam 5-4-7, not at the fin's edge
    numbers = {(4, "l"): 8, (4, "r"): 16}
    state = step(begin(FIN, copies, numbers, "none", boundary="edge_only"))
    assert at_vertex(state, 4) == {8, 16}
    assert at_vertex(state, state.faces[4 * 3 + 1][3]) == {4, 8}


def test_seam_at_an_interior_crease_with_a_fin():
    """Vertex 1 of the geometry is a crease; once it has two values, it is a corner."""
    faces = [
        *([0, 1, 4, 3], [1, 2, 5, 4], [3, 4, 7, 6], [4, 5, 8, 7]),
        *([1, 4, 10, 9], [4, 7, 11, 10]),  # a wall along 1, 4, 7
    ]
    numbers = {(4, "g"): 8, (4, "w"): 16}
    state = step(begin(faces, split(faces, "gggggg"), numbers, "none"))
    assert at_vertex(state, 4) == {6}
    state = step(begin(faces, split(faces, "ggggww"), numbers, "none"))
    assert at_vertex(state, 4) == {8, 16}


def test_vertex_of_two_fans():
    state = step(begin(BOW, BOW, {8: 8}, "none", boundary="edge_only"))
    assert at_vertex(state, 8) == {8}
    copies = split(BOW, "llllr")
    numbers = {(8, "l"): 8, (8, "r"): 16}
    state = step(begin(BOW, copies, numbers, "none", boundary="edge_only"))
    assert at_vertex(state, 8) == {8, 16}


# --- cut meshes -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["grid", "torus", "cube", "triangles", "pentagon"])
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(
    ("mode", "rule"), [("none", "edge_only"), ("corners_only", "edge_and_corner")]
)
def test_channel_equals_the_mesh_cut_along_its_seams(name, seed, mode, rule):
    """Without creases, a value is a vertex of a cut mesh: boundary rules instead of seam rules."""
    faces = CAGES[name]
    copies = _random_copies(faces, seed, n_seams=seed + 1)
    numbers = _random_numbers(copies, seed)
    names = list(numbers)
    cut = [[names.index(name) for name in face] for face in copies]
    ends = {}  # a value with two fans of faces is a corner, for which a plain mesh has no rule
    for face in cut:
        for a, b in itertools.pairwise([*face, face[0]]):
            for v in (a, b):
                ends.setdefault(v, []).append(frozenset((a, b)))
    if any(sum(at.count(e) == 1 for e in at) > 2 for at in ends.values()):
        pytest.skip("a value with two fans")
    points, cut = oracles.refine_times([(numbers[name],) for name in names], cut, 3, rule)
    state = refine_times(begin(faces, copies, numbers, mode, boundary=rule), 3)
    assert corner_points(state) == [tuple(points[v]) for face in cut for v in face]


def test_linear_precision_and_affine_invariance():
    faces = CAGES["pentagon"]
    tags = _random_tags(faces, 1)
    copies = _random_copies(faces, 1)
    numbers = _random_numbers(copies, 1)
    for mode in MODES:
        state = refine_times(begin(faces, copies, numbers, mode, **tags), 2)
        moved = refine_times(
            begin(faces, copies, {k: 3 * x + 5 for k, x in numbers.items()}, mode, **tags), 2
        )
        assert [(3 * x + 5,) for (x,) in corner_points(state)] == corner_points(moved)
