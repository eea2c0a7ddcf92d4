"""The oracles against reference numbers, hand calculation, scipy and each other."""

import ast
import itertools
import math
import random
from fractions import Fraction as F
from pathlib import Path

import mpmath
import numpy as np
import oracles
import pytest
from oracles import CUBE_FACES, CUBE_POINTS, ExactSurface, local_cage

HALF = F(1, 2)
ORDERS = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3), (3, 3)]
VALENCES = [3, 5, 6, 7, 12, 33]


def random_points(n, seed=0):
    rng = random.Random(seed)
    return [tuple(F(rng.randint(-256, 256), 256) for _ in range(3)) for _ in range(n)]


def random_parameters(n, seed=0):
    rng = random.Random(seed)
    return [(F(rng.randint(0, 997), 997), F(rng.randint(0, 991), 991)) for _ in range(n)]


def _distance(a, b):
    """Between vectors of Fractions or mpf; between unit vectors a small one is their angle."""
    return mpmath.norm([oracles._to_mpf(x) - oracles._to_mpf(y) for x, y in zip(a, b, strict=True)])


def _meshes():
    """Name -> faces: closed, open, n-gons, interior valences from 2, boundary fans of 1 to 3."""
    ring = [[5, i, (i + 1) % 5] for i in range(5)]  # a pole of five triangles
    skirt = [[(i + 1) % 5, i, 6 + i, 6 + (i + 1) % 5] for i in range(5)]
    flower = [list(range(5))] + [[(i + 1) % 5, i, 5 + i] for i in range(5)]
    return {
        "cube": CUBE_FACES,
        "tetrahedron": [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
        "prism": [[0, 2, 1], [3, 4, 5], [0, 1, 4, 3], [1, 2, 5, 4], [2, 0, 3, 5]],
        "pillow": [[0, 1, 2, 3], [3, 2, 1, 0]],
        "quad": [[0, 1, 2, 3]],
        "triangle": [[0, 1, 2]],
        "strip": [[0, 1, 4, 3], [1, 2, 5, 4]],
        "notched": oracles.grid_faces(4, 4)[1:],
        "dome": ring + skirt,
        "flower": flower,
        "valence 2": local_cage(2)[1],
        "valence 5": local_cage(5)[1],
    }


MESHES = _meshes()
mesh_faces = pytest.mark.parametrize("faces", list(MESHES.values()), ids=list(MESHES))


def test_oracles_import_nothing_of_the_library():
    tree = ast.parse(Path(oracles.__file__).read_text(encoding="utf-8"))
    names = {a.name for node in ast.walk(tree) if isinstance(node, ast.Import) for a in node.names}
    names |= {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert not [name for name in names if name.startswith("limitsurf")]


# --- the refiner ----------------------------------------------------------------------------------


def test_cube_refined_once_by_hand():
    points, faces = oracles.refine(CUBE_POINTS, CUBE_FACES)
    assert len(points) == 8 + 12 + 6
    assert len(faces) == 24
    assert points[0] == (F(2, 9),) * 3
    assert points[8] == (F(1, 8), F(1, 8), HALF)  # of edge (0, 1), the first in order
    assert points[9] == (F(1, 8), HALF, F(1, 8))  # of edge (0, 2)
    assert points[20] == (0, HALF, HALF)  # of face (0, 1, 3, 2), the first
    assert faces[:4] == [[0, 8, 20, 9], [1, 11, 20, 8], [3, 13, 20, 11], [2, 9, 20, 13]]


def test_tetrahedron_refined_once_by_hand():
    points = [(0, 0, 0), (12, 0, 0), (0, 12, 0), (0, 0, 12)]
    points, faces = oracles.refine(points, MESHES["tetrahedron"])
    # Vertex 0 touches the first, second and fourth of the face points.
    assert points[10:] == [(4, 4, 0), (4, 0, 4), (4, 4, 4), (0, 4, 4)]
    assert points[4] == (5, 1, 1)  # edge (0, 1): (12 + 4 + 4) / 4 and 4 / 4
    assert points[0] == (F(20, 9),) * 3  # (Q + 2 R) / 3, Q = 8/3, R = 2
    assert faces[:3] == [[0, 5, 10, 4], [2, 7, 10, 5], [1, 4, 10, 7]]


@pytest.mark.parametrize("N", [3, 4, 5, 6, 17])
def test_masks_of_one_step(N):
    """Stencils of a vertex, 1 - 7 / (4 N) and so on, of an edge and of a face."""
    points, faces = local_cage(N)
    forms = [(oracles.Stencil({i: F(1)}),) for i in range(len(points))]
    fine, children = oracles.refine(forms, faces)
    _, e0, f0, e1 = faces[0]
    ends, diagonals = {q[1] for q in faces[:N]}, {q[2] for q in faces[:N]}
    vertex = {0: 1 - F(7, 4 * N)} | dict.fromkeys(ends, F(3, 2 * N * N))
    assert fine[0][0] == vertex | dict.fromkeys(diagonals, F(1, 4 * N * N))
    last = faces[N - 1]
    edge = {0: F(3, 8), e0: F(3, 8)} | dict.fromkeys((f0, e1, last[1], last[2]), F(1, 16))
    assert fine[children[0][1]][0] == edge
    assert fine[children[0][2]][0] == dict.fromkeys((0, e0, f0, e1), F(1, 4))


def test_boundary_rules_by_hand():
    points = [(0, 0), (16, 0), (32, 8), (0, 16), (16, 16), (32, 16)]
    faces = MESHES["strip"]
    fixed, _ = oracles.refine(points, faces)
    following, _ = oracles.refine(points, faces, "edge_only")
    assert fixed[0] == (0, 0)
    assert following[0] == (2, 2)
    assert fixed[1] == following[1] == (16, 1)  # (0 + 6 * 0 + 8) / 8
    assert fixed[6] == following[6] == (8, 0)  # midpoint of edge (0, 1)
    assert fixed[9] == (16, F(16 + 8 + 10, 4))  # inner edge (1, 4) and the two face points
    with pytest.raises(ValueError, match="edge_corner"):
        oracles.refine(points, faces, "edge_corner")


def test_refine_keeps_unused_vertices_and_number_types():
    points = [*CUBE_POINTS, (F(1, 3),) * 3]
    exact, faces = oracles.refine_times(points, CUBE_FACES, 2)
    assert exact[8] == points[8]
    assert oracles.limit_positions(exact, faces)[8] == points[8]
    floats, _ = oracles.refine_times([tuple(map(float, p)) for p in points], CUBE_FACES, 2)
    with mpmath.workdps(40):
        mpfs = [tuple(mpmath.mpf(x.numerator) / x.denominator for x in p) for p in points]
        mpfs, _ = oracles.refine_times(mpfs, CUBE_FACES, 2)
        for p, q, r in zip(exact, floats, mpfs, strict=True):
            assert all(abs(F(y) - x) < F(1, 2**50) for x, y in zip(p, q, strict=True))
            assert all(
                abs(oracles.rational(y) - x) < F(1, 10**38) for x, y in zip(p, r, strict=True)
            )


def test_limit_positions_ask_for_quads():
    with pytest.raises(ValueError, match="no quad"):
        oracles.limit_positions(random_points(4), MESHES["tetrahedron"])


# --- numbers from papers --------------------------------------------------------------------------


def _ring_matrix(N):
    """The 2 N + 8 rows of one step around an extraordinary vertex, as dicts, and that corner."""
    _, faces = local_cage(N)
    surface = ExactSurface(None, faces)
    local, _ = surface._neighbourhood(0)
    local, _, _ = oracles._step(local, 0, surface.mode)
    finer, rows, D = oracles._step(local, 0, surface.mode)
    assert finer == local
    assert len(rows) == 2 * N + 8
    matrix = [{i: F(w, D) for i, w in zip(*row, strict=True)} for row in rows]
    return matrix, oracles._corners(local)[0]


@pytest.mark.parametrize("N", [3, 5, 6, 8, 12])
def test_eigenvalues(N):
    matrix, _ = _ring_matrix(N)
    dense = np.array([[float(row.get(j, 0)) for j in range(2 * N + 8)] for row in matrix])
    found = np.sort(np.linalg.eigvals(dense).real)
    expected = [float(x) for values in oracles.ring_eigenvalues(N).values() for x in values]
    expected = np.sort(expected + [float(x) for x in oracles.OUTER_EIGENVALUES])
    assert np.abs(found - expected).max() < 1e-6  # eigenvalues 1/8 of N = 12 are repeated


def test_subdominant_eigenvalues():
    for N, value in oracles.SUBDOMINANT.items():
        ring = oracles.ring_eigenvalues(N)
        assert float(ring[1][0]) == pytest.approx(value, rel=4e-16)
        assert ring[1][0] == pytest.approx(ring[N - 1][0], rel=1e-14)
        assert ring[1][0] >= max(abs(x) for f in ring for x in ring[f][f in (0, 1, N - 1) :])


@pytest.mark.parametrize("N", [2, 3, 4, 5, 6, 7, 8, 33])
def test_masks_are_left_eigenvectors(N):
    matrix, corner = _ring_matrix(N)

    def times_matrix(mask):
        product = oracles.Stencil()
        for i, w in mask.items():
            product = product + w * oracles.Stencil(matrix[i])
        return {i: w for i, w in product.items() if w}

    centre, edge, diagonal = oracles.limit_mask(N)
    mask = {corner.vertex: centre} | dict.fromkeys(corner.ends, edge)
    mask |= dict.fromkeys(corner.diagonals, diagonal)
    assert times_matrix(mask) == mask

    with mpmath.workdps(50):
        value = oracles.ring_eigenvalues(N)[1][0]
        for edges, diagonals in oracles.tangent_masks(N):
            mask = dict(zip(corner.ends, edges, strict=True))
            mask |= zip(corner.diagonals, diagonals, strict=True)
            product = dict.fromkeys(range(2 * N + 8), mpmath.mpf(0))
            for i, w in mask.items():
                for j, x in matrix[i].items():
                    product[j] += w * x.numerator / x.denominator
            assert all(abs(x - value * mask.get(j, 0)) < 1e-45 for j, x in product.items())


def test_cube_positions_exactly():
    surface = ExactSurface(CUBE_POINTS, CUBE_FACES)
    for f, face in enumerate(CUBE_FACES):
        for k, (u, v) in enumerate(oracles.CORNERS):
            corner = CUBE_POINTS[face[k]]
            depth = oracles.CUBE_CORNER
            assert surface.evaluate(f, u, v) == tuple(x + depth * (1 - 2 * x) for x in corner)
            nu, nv = oracles.CORNERS[(k + 1) % 4]
            middle = [(x + y) / 2 for x, y in zip(corner, CUBE_POINTS[face[k - 3]], strict=True)]
            depth = oracles.CUBE_EDGE_MIDPOINT
            expected = tuple(x + depth * (1 - 2 * x) for x in middle)
            assert surface.evaluate(f, F(u + nu, 2), F(v + nv, 2)) == expected
        middle = [sum(CUBE_POINTS[i][c] for i in face) / 4 for c in range(3)]
        depth = oracles.CUBE_FACE_CENTRE
        expected = tuple(x + depth * (1 - 2 * x) for x in middle)
        assert surface.evaluate(f, HALF, HALF) == expected


def test_cube_volume():
    """Volume and area by quadrature over the pieces towards one corner, until they are tiny."""
    surface = ExactSurface(CUBE_POINTS, CUBE_FACES)
    nodes, weights = np.polynomial.legendre.leggauss(5)
    nodes, weights = (nodes + 1) / 2, weights / 2
    volume = area = 0.0
    for level in range(2, 20):
        size = 2.0**-level
        for a, b in ((1, 0), (1, 1), (0, 1)):
            for (x, wx), (y, wy) in itertools.product(zip(nodes, weights, strict=True), repeat=2):
                uv = (a + x) * size, (b + y) * size
                P, Pu, Pv = (np.array(surface.evaluate(0, *uv, nu), float) for nu in ORDERS[:3])
                normal = np.cross(Pu, Pv) * wx * wy * size * size
                volume += (P - 0.5) @ normal / 3
                area += np.linalg.norm(normal)
    assert 24 * volume == pytest.approx(float(oracles.CUBE_VOLUME), rel=1e-11)
    assert 24 * area == pytest.approx(float(oracles.CUBE_AREA), rel=1e-7)


cases = oracles.reference_cases() or {}


@pytest.mark.skipif(not cases, reason="the reference numbers are not part of the package")
@pytest.mark.parametrize("N", [3, 5, 8, 16])
def test_reference_cases(N):
    """Position and both derivatives are the reference's correctly rounded numbers, up to ties."""
    case = cases[N]
    surface = ExactSurface(case.points, case.faces)
    for (u, v), *expected in zip(case.uv, case.P, case.Pu, case.Pv, strict=True):
        for nu, values in zip(ORDERS[:3], expected, strict=True):
            for x, y in zip(surface.evaluate(case.face, u, v, nu), values, strict=True):
                assert abs(x - F(y)) <= F(math.ulp(y)) / 2


def test_reference_cases_may_be_absent(tmp_path):
    assert oracles.reference_cases(tmp_path / "nowhere") is None


# --- regular grids --------------------------------------------------------------------------------


@pytest.mark.parametrize("periodic", list(itertools.product((False, True), repeat=2)))
def test_regular_faces_are_scipy_splines(periodic):
    n, m = 5, 6
    rng = np.random.default_rng(7)
    grid = rng.integers(-256, 256, (n, m, 2)) / 256
    faces = oracles.grid_faces(n, m, periodic)
    columns = m if periodic[1] else m - 1
    assert len(faces) == (n if periodic[0] else n - 1) * columns
    surface = ExactSurface(grid.reshape(-1, 2), faces)
    uv = np.vstack([rng.random((2, 2)), [[0, 0], [1, 0.25], [1, 1], [0.5, 0.5]]])
    face, query = (x.ravel() for x in np.indices((len(faces), len(uv))))
    u, v = uv[query].T
    i, j = np.divmod(face, columns)
    for nu in ORDERS:
        spline = oracles.bspline_oracle(grid, i, j, u, v, nu, periodic)
        exact = [surface.evaluate(*q, nu) for q in zip(face, u, v, strict=True)]
        assert np.abs(spline - np.array(exact, float)).max() < 1e-13 * 10 ** sum(nu)


# --- the descent ----------------------------------------------------------------------------------


@mesh_faces
@pytest.mark.parametrize("mode", oracles.MODES)
def test_refined_vertices_at_their_limits(faces, mode):
    """Twice refined and moved by limit masks is the surface at dyadic parameters, exactly."""
    points = random_points(1 + max(map(max, faces)))
    surface = ExactSurface(points, faces, mode)
    fine, children = oracles.refine_times(points, faces, 2, mode)
    limits = oracles.limit_positions(fine, children, mode)
    parameters = oracles.refined_parameters(faces, 2)
    places = {
        (face, *uv): vertex
        for child, (face, corners) in zip(children, parameters, strict=True)
        for vertex, uv in zip(child, corners, strict=True)
    }
    for place, vertex in places.items():
        assert surface.evaluate(*place) == limits[vertex]


@mesh_faces
def test_deep_refinement_approaches_the_limit(faces):
    """Refined vertices, not moved at all, approach the surface."""
    points = [tuple(map(float, p)) for p in random_points(1 + max(map(max, faces)))]
    surface = ExactSurface(points, faces)
    errors = []
    for levels in (2, 3, 4):
        fine, children = oracles.refine_times(points, faces, levels)
        parameters = oracles.refined_parameters(faces, levels)
        every = random.Random(3).sample(range(len(children)), 32 if len(children) > 32 else 8)
        errors.append(
            max(
                math.dist(
                    surface.evaluate(parameters[c][0], *parameters[c][1][2]), fine[children[c][2]]
                )
                for c in every
            )
        )
    assert errors[2] < 0.05
    assert errors[2] <= errors[0] / 3


@mesh_faces
@pytest.mark.parametrize("mode", oracles.MODES)
def test_queries_of_a_refined_mesh(faces, mode):
    """A child of the refined mesh holds the same surface, at any depth, derivatives included."""
    points = random_points(1 + max(map(max, faces)))
    coarse = ExactSurface(points, faces, mode)
    fine = ExactSurface(*oracles.refine(points, faces, mode), mode=mode)
    deep = [(F(1, 3**40), F(2, 3**41)), (F(1, 3**30), F(0))]
    child = 0
    for face, (_, corner) in enumerate(oracles.limit_faces(faces)):
        for k in range(4) if corner == -1 else [None]:
            for s, t in random_parameters(1, face) + (deep if face < 2 else []):
                u, v, scale = s, t, 1
                if k is not None:  # corner 0 of the child is corner k of the face
                    u, v = [(s, t), (2 - t, s), (2 - s, 2 - t), (t, 2 - s)][k]
                    u, v, scale = u / 2, v / 2, 2
                for nu in [(0, 0), (1, 0), (2, 3)]:
                    sign, (i, j) = 1, nu
                    if k in (1, 3):
                        i, j = j, i
                    if k is not None:  # d/du is this many times d/ds or d/dt of the child
                        su, sv = [(1, 1), (-1, 1), (-1, -1), (1, -1)][k]
                        sign = su ** nu[0] * sv ** nu[1] * scale ** sum(nu)
                    expected = [sign * x for x in fine.evaluate(child, s, t, (i, j))]
                    assert list(coarse.evaluate(face, u, v, nu)) == expected
            child += 1
    assert child == len(fine.faces)


def _edge_parameters(faces, f, k, t):
    """Limit face and (u, v) at the fraction t of the way from corner k of face f to the next."""
    n = len(faces[f])
    first = sum(1 if len(face) == 4 else len(face) for face in faces[:f])
    if n == 4:
        (a, b), (c, d) = oracles.CORNERS[k], oracles.CORNERS[(k + 1) % 4]
        return first, a + t * (c - a), b + t * (d - b)
    if t <= HALF:
        return first + k, 2 * t, F(0)
    return first + (k + 1) % n, F(0), 2 - 2 * t


@mesh_faces
@pytest.mark.parametrize("mode", oracles.MODES)
def test_continuity_across_edges(faces, mode):
    points = random_points(1 + max(map(max, faces)))
    surface = ExactSurface(points, faces, mode)
    sides = {e: (f, k) for f, face in enumerate(faces) for k, e in enumerate(oracles._sides(face))}
    for a, b in sides:
        if a < b and (b, a) in sides:
            for t in (F(0), F(1, 7), HALF, F(5, 8), F(1)):
                here = _edge_parameters(faces, *sides[a, b], t)
                there = _edge_parameters(faces, *sides[b, a], 1 - t)
                assert surface.evaluate(*here) == surface.evaluate(*there)
                normals = surface.normal(*here), surface.normal(*there)
                if any(map(mpmath.isnan, normals[0] + normals[1])):  # at irregular vertices only
                    assert all(map(mpmath.isnan, normals[0] + normals[1]))
                    assert t in (0, 1) or faces is MESHES["pillow"]  # whose sheets coincide
                else:
                    assert _distance(*normals) < 1e-49


@pytest.mark.parametrize("N", VALENCES)
@pytest.mark.parametrize("corner", range(4))
def test_turning_a_face_turns_its_parameters(N, corner):
    points, faces = local_cage(N)
    turned_points, turned_faces = local_cage(N, corner=corner)
    assert turned_points == points
    assert turned_faces[0][corner] == 0
    surface, turned = ExactSurface(points, faces), ExactSurface(points, turned_faces)
    deep = F(1, 10**20)
    for s, t in [*random_parameters(4), (deep, deep / 3), (F(0), F(0))]:
        u, v = [(s, t), (1 - t, s), (1 - s, 1 - t), (t, 1 - s)][corner]
        assert turned.evaluate(0, u, v) == surface.evaluate(0, s, t)
        with mpmath.workdps(60):
            assert _distance(turned.normal(0, u, v), surface.normal(0, s, t)) < 1e-49
            along_s, along_t = surface.tangents(0, s, t)
            minus_s, minus_t = (tuple(-x for x in tangent) for tangent in (along_s, along_t))
            expected = [
                (along_s, along_t),
                (minus_t, along_s),
                (minus_s, minus_t),
                (along_t, minus_s),
            ][corner]
            for x, y in zip(turned.tangents(0, u, v), expected, strict=True):
                assert _distance(x, y) < 1e-49


@mesh_faces
def test_weights(faces):
    """Weights times points is the value; they sum to one, those of a derivative to zero."""
    n = 1 + max(map(max, faces))
    points = random_points(n)
    surface = ExactSurface(points, faces)
    for face in range(len(surface.limit_faces)):
        for (u, v), nu in itertools.product([*random_parameters(2), (F(0), F(1))], ORDERS[:3]):
            weights = oracles.exact_weights(faces, face, u, v, nu)
            value = oracles.exact_limit(points, faces, face, u, v, nu)
            if weights is None:
                assert all(map(math.isnan, value))
                continue
            assert sum(weights.values()) == (sum(nu) == 0)
            products = [sum(w * points[i][c] for i, w in weights.items()) for c in range(3)]
            assert tuple(products) == value == surface.evaluate(face, u, v, nu)


@pytest.mark.parametrize("N", VALENCES)
def test_derivatives_by_exact_differences(N):
    """Within one piece the surface is bicubic: four values give its derivatives."""
    surface = ExactSurface(*local_cage(N))
    level = 37
    size = F(1, 2**level)
    for a, b in ((1, 0), (1, 1), (0, 1)):
        v = (b + F(2, 7)) * size

        def at(k, a=a, v=v, nu=(0, 0)):
            return np.array(surface.evaluate(0, (a + F(k, 3)) * size, v, nu))

        P = [at(k) for k in range(4)]
        h = size / 3
        assert (P[3] - 3 * P[2] + 3 * P[1] - P[0] == h**3 * at(1, nu=(3, 0))).all()
        assert (P[2] - 2 * P[1] + P[0] == h**2 * at(1, nu=(2, 0))).all()
        assert ((-2 * P[0] - 3 * P[1] + 6 * P[2] - P[3]) / 6 == h * at(1, nu=(1, 0))).all()


def test_third_derivatives_belong_to_the_piece_nearer_corner_0():
    third, nearby = (3, 0), F(1, 10**6)
    for corner, knots in enumerate(
        [(HALF, F(1, 4)), (HALF, F(3, 4)), (HALF, F(3, 4)), (HALF, F(1, 4))]
    ):
        points, faces = local_cage(5, corner=corner)
        surface = ExactSurface(points, faces)
        v = F(1, 9) if corner < 2 else F(8, 9)
        for u in knots:
            below, here, above = (
                surface.evaluate(0, u + d, v, third) for d in (-nearby, 0, nearby)
            )
            assert here == below != above
            for nu in ORDERS[:6]:
                values = (surface.evaluate(0, u + d, v, nu) for d in (-nearby, 0, nearby))
                for x, y, z in zip(*values, strict=True):
                    assert abs(x - y) < 1e-2
                    assert abs(z - y) < 1e-2


def test_relabelling():
    faces = MESHES["prism"]
    points = random_points(6)
    order = [3, 5, 0, 4, 1, 2]
    moved = [points[order.index(i)] for i in range(6)]
    renamed = [[order[v] for v in face] for face in faces]
    for face, (u, v) in enumerate(random_parameters(9)):
        expected = oracles.exact_limit(points, faces, face, u, v)
        assert oracles.exact_limit(moved, renamed, face, u, v) == expected


@pytest.mark.parametrize("N", [2, *VALENCES])
def test_derivatives_at_an_extraordinary_vertex(N):
    points, faces = local_cage(N)
    surface = ExactSurface(points, faces)
    for nu in ((1, 0), (0, 1)):
        at, near = surface.evaluate(0, 0, 0, nu), surface.evaluate(0, F(1, 2**90), 0, nu)
        if N < 4:
            assert at == (0, 0, 0)
            assert max(map(abs, near)) < 1e-7
        else:
            assert all(map(math.isnan, at))
            assert max(map(abs, near)) > 100
    assert all(map(math.isnan, surface.evaluate(0, 0, 0, (1, 1))))


def test_number_types_and_domain():
    points, faces = local_cage(5)
    exact = oracles.exact_limit(points, faces, 0, F(3, 8), F(1, 16))
    floats = np.array(points, float)
    assert oracles.exact_limit(floats, np.array(faces), 0, 0.375, np.float64(0.0625)) == exact
    assert oracles.exact_limit(points, faces, 0, mpmath.mpf("0.375"), mpmath.mpf(1) / 16) == exact
    with pytest.raises(ValueError, match=r"need both in \[0, 1\]"):
        oracles.exact_limit(points, faces, 0, 1.5, 0)
    with pytest.raises(ValueError, match="edge_none"):
        ExactSurface(points, faces, "edge_none")


# --- normals --------------------------------------------------------------------------------------


@pytest.mark.parametrize("N", VALENCES)
@pytest.mark.parametrize("distance", [1e-12, 1e-100, 1e-300])
def test_normals_approach_the_pole_at_the_rate_of_the_spectrum(N, distance):
    """The distance to the pole's shrinks by mu / lambda a level, mu the mode after lambda."""
    surface = ExactSurface(*local_cage(N, seed=N))
    depth, digits = -math.log2(distance), 450
    with mpmath.workdps(digits):
        spectrum = {
            mpmath.nstr(x, 40): x for xs in oracles.ring_eigenvalues(N).values() for x in xs
        }
        spectrum["1/8"] = mpmath.mpf(1) / 8  # of the outer ring
        dominant, value, mu, slower, *_ = sorted(spectrum.values(), reverse=True)
        assert dominant == 1
        pole = surface.normal(0, 0, 0, digits)
        u, v = distance, 0.375 * distance
        near, nearer = (_distance(pole, surface.normal(0, u / k, v / k, digits)) for k in (1, 2))
        # What this rate leaves out is of second order, or due to the next mode.
        left_out = 1e3 * max(mu / value, slower / mu) ** depth + 1e-40
        assert left_out > 0.1 or abs(nearer / near * value / mu - 1) < left_out
        assert 0 < near < 0.6
        assert N < 33 or near > 1e-8  # even at 1e-300 it is not the pole's


@pytest.mark.parametrize("N", VALENCES)
def test_normals_and_tangents_agree_with_derivatives(N):
    surface = ExactSurface(*local_cage(N))
    for u, v in ((F(1, 10**100), F(1, 10**101)), (F(1, 3), F(1, 5))):
        Pu, Pv = (surface.evaluate(0, u, v, nu) for nu in ORDERS[1:3])
        tu, tv = surface.tangents(0, u, v)
        n = surface.normal(0, u, v)
        with mpmath.workdps(50):
            for tangent, derivative in ((tu, Pu), (tv, Pv)):
                assert abs(sum(x * y for x, y in zip(tangent, n, strict=True))) < 1e-48
                length = mpmath.sqrt(oracles._to_mpf(sum(x * x for x in derivative)))
                for x, y in zip(tangent, derivative, strict=True):
                    assert abs(x * length - oracles._to_mpf(y)) < 1e-48 * length
            assert abs(sum(x * x for x in n) - 1) < 1e-48
            assert n[2] == pytest.approx(
                oracles._cross(tu, tv)[2] / mpmath.norm(oracles._cross(tu, tv))
            )


@pytest.mark.parametrize("N", [3, 5, 7])
def test_tangents_at_the_pole_are_limits(N):
    surface = ExactSurface(*local_cage(N))
    pole = surface.tangents(0, 0, 0)
    depth = F(1, 2**300)
    along_u, along_v = surface.tangents(0, depth, 0)[0], surface.tangents(0, 0, depth)[1]
    for x, y in zip(pole, (along_u, along_v), strict=True):
        assert _distance(x, y) < 1e-20


def test_cube_normal_at_a_corner_is_its_diagonal():
    surface = ExactSurface(CUBE_POINTS, CUBE_FACES)
    for f, face in enumerate(CUBE_FACES):
        for k, (u, v) in enumerate(oracles.CORNERS):
            outwards = [int(2 * x - 1) / mpmath.sqrt(3) for x in CUBE_POINTS[face[k]]]
            assert _distance(surface.normal(f, u, v), outwards) < 1e-14
            assert (
                _distance(
                    surface.normal(f, 0.5, 0.5), [round(x) for x in surface.normal(f, 0.5, 0.5)]
                )
                == 0
            )


def test_normals_far_from_the_origin():
    points, faces = local_cage(7)
    far = [tuple(x + 2**60 for x in p) for p in points]
    for u, v in ((0, 0), (F(1, 10**50), F(1, 10**51))):
        pair = (oracles.exact_normal(p, faces, 0, u, v) for p in (points, far))
        assert _distance(*pair) < 1e-45
        pair = (oracles.exact_tangents(p, faces, 0, u, v)[0] for p in (points, far))
        assert _distance(*pair) < 1e-45


def test_no_normal_is_claimed_where_none_is_known():
    valence_2 = ExactSurface(*local_cage(2))
    notched = ExactSurface(random_points(16), MESHES["notched"])
    face = next(f for f, q in enumerate(notched.faces) if q[0] == 5)  # boundary vertex of 3 faces
    for surface, f in ((valence_2, 0), (notched, face)):
        assert all(map(mpmath.isnan, surface.normal(f, 0, 0)))
        assert not any(map(mpmath.isnan, surface.normal(f, 1e-30, 1e-30)))


# --- cages ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("N", [2, 3, 4, 5, 12, 64])
def test_local_cage(N):
    points, faces = local_cage(N, seed=3)
    assert len(points) == 6 * N + 1
    assert len(faces) == 4 * N
    assert all(256 % x.denominator == 0 for p in points for x in p)
    assert points != local_cage(N, seed=4)[0]
    surface = ExactSurface(points, faces)
    counts = [sum(v in face for face in faces) for v in range(len(points))]
    assert counts[0] == N
    inner = set(itertools.chain(*faces[:N]))
    assert {counts[v] for v in inner - {0}} == {4}
    assert sorted(set(counts) - {N, 4}) in ([1, 2], [1])
    following = ExactSurface(points, faces, "edge_only")
    for face in range(N):  # nothing beyond the cage can matter there
        assert surface.evaluate(face, F(1, 3), 1) == following.evaluate(face, F(1, 3), 1)
