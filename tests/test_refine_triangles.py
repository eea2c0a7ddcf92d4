"""Refinement of triangles against a naive refiner, by hand, and by what is the same otherwise."""

import copy
import pickle
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction as F

import numpy as np
import oracles_loop
import pytest
import zoo
import zoo_triangles
from oracles_creases import Cage

import limitsurf as ls
from limitsurf import tables
from limitsurf.cage.checks import MeshError
from limitsurf.cage.mesh import Mesh
from limitsurf.scheme.loop import LOOP

TWO = [[0, 1, 2], [0, 2, 1], [1, 0, 3]]  # two faces on three vertices, and one beside them
THREE = [[0, 1, 2], [0, 2, 1], [0, 1, 2], [1, 0, 3]]
CAGES = {
    **zoo_triangles.ZOO,
    **zoo_triangles.TAGGED,
    **zoo_triangles.NONMANIFOLD,
    **zoo_triangles.DEGENERATE,
    "two_alike": lambda: (zoo.random_points(4, 1), TWO),
    "three_alike": lambda: (zoo.random_points(4, 2), THREE),
    "loop": lambda: (zoo.random_points(5, 3), [[0, 0, 1], [0, 1, 2], [1, 0, 3], [2, 1, 4]]),
    "back_and_forth": lambda: (zoo.random_points(4, 4), [[0, 1, 0], [0, 1, 2], [1, 0, 3]]),
}
over_the_cages = pytest.mark.parametrize("name", CAGES)
RATIONAL = {2, 3, 4, 6}
MODES = ("edge_and_corner", "edge_only", "none")


def given(name, exact=False):
    """A mesh of the zoo, with one of the three boundary modes, and the same for the oracle."""
    points, faces, *rest = CAGES[name]()
    tags = {"boundary": MODES[len(name) % 3], **(rest[0] if rest else {})}
    numbers = zoo.random_points(len(points), name)
    rows = [tuple(map(F, row)) for row in np.asarray(numbers, dtype=float).tolist()]
    points = np.array(rows, dtype=object if exact else float)
    return ls.Mesh(points, faces, scheme=LOOP, **tags), Cage(rows, faces, **tags)


def sides(mesh):
    """Vertices of half-edges, (n, 2)."""
    return np.stack([mesh.indices, mesh.indices[mesh.next_corner]], axis=1)


@pytest.mark.parametrize("name", list(CAGES)[::3])
@pytest.mark.filterwarnings("ignore:scheme 'loop' converges")
def test_kernels_do_the_same(name, use):
    """Points, operator and limits, to rounding."""
    found = []
    for kernels in (False, True):
        use(kernels)
        mesh = given(name)[0]
        fine, R = ls.refined(mesh, 2, operator=True)
        cage = ls.refined(mesh, 0)
        found.append((fine.points, R.toarray(), fine.limit_points, cage.limit_points))
        found[-1] += fine.limit_normals, cage.limit_normals
    for k, (one, other) in enumerate(zip(*found, strict=True)):
        assert np.array_equal(np.isnan(one), np.isnan(other))
        assert np.nanmax(np.abs(one - other), initial=0) <= (4e-15 if k < 4 else 1e-11)


def floats(rows):
    return np.array([[float(x) for x in row] for row in rows])


@over_the_cages
def test_refined_is_naively_refined(name):
    """Faces in their order, holes, points, operator: exactly where masks are rational."""
    mesh, cage = given(name)
    naive = oracles_loop.refine_times(cage, 2, bits=100)
    fine, R = ls.refined(mesh, 2, operator=True)
    assert fine.faces.tolist() == naive.faces
    assert set(fine.holes.tolist()) == naive.holes
    assert fine.n_edges == len({edge for face in naive.sides for edge in face})
    expected = floats(naive.points)
    assert np.abs(fine.points - expected).max() <= 1e-15 * np.abs(mesh.points).max()
    assert np.abs(R @ mesh.points - fine.points).max() <= 1e-15 * np.abs(mesh.points).max()
    if set(mesh.vertex_faces[~mesh.boundary_vertex].tolist()) <= RATIONAL:
        exact, R = ls.refined(given(name, exact=True)[0], 2, operator=True)
        assert [tuple(row) for row in exact.points.tolist()] == naive.points
        assert (R @ given(name, exact=True)[0].points == exact.points).all()


@over_the_cages
@pytest.mark.parametrize("kernels", [False, True])
def test_children_are_connected_as_if_they_were_new(name, kernels, use):
    """Also in copies; edges between the same vertices are known by inheritance alone."""
    use(kernels)
    fine = ls.refined(given(name)[0], 2)
    assert (fine.edges[fine.corner_edge] == np.sort(sides(fine), axis=1)).all()
    paired = np.flatnonzero(fine.twin >= 0)
    assert (sides(fine)[fine.twin[paired]] == sides(fine)[paired, ::-1]).all()
    alike = [pickle.loads(pickle.dumps(fine)), copy.deepcopy(fine), fine.with_points(fine.points)]
    use(not kernels)
    alike.append(ls.refined(given(name)[0], 2))
    if not fine.connectivity.parallel:
        alike.append(Mesh(fine.points, fine.indices.reshape(-1, 3)))
    members = ["edges", "corner_edge", "edge_corners", "twin", "vertex_faces", "boundary_edge"]
    members += ["boundary_vertex", "nonmanifold_edge", "nonmanifold_vertex", "valences"]
    for member in members:
        for other in alike:
            one, two = (getattr(mesh.connectivity, member) for mesh in (fine, other))
            assert np.array_equal(one, two), member


def test_faces_on_the_same_vertices():
    """Inner edges between the same two midpoints, each its own; cut out they stay so."""
    mesh = given("pillow_of_triangles")[0]
    fine = ls.refined(mesh)
    assert (fine.n_vertices, fine.n_edges, fine.n_faces) == (6, 12, 8)
    assert (fine.edge_faces == 2).all()
    assert (fine.vertex_faces == [2, 2, 2, 6, 6, 6]).all()
    assert not fine.nonmanifold_vertex.any()
    # a sharp vertex that becomes smooth is looked at alone
    sharp = ls.Mesh(mesh.points, mesh.faces, corners={0: 1.5}, scheme=LOOP)
    limits = ls.refined(sharp, 0).limit_points
    assert np.abs(ls.refined(sharp, 3).limit_points[:3] - limits).max() <= 1e-15 * 64


@over_the_cages
def test_parents(name):
    """The first face that has a limit, and the vertex's parameters there."""
    mesh = given(name)[0]
    fine = ls.refined(mesh, 2)
    places = oracles_loop.refined_parameters(mesh.n_faces, 2)
    found = {}
    without = set(fine.rules.without_limit(fine).nonzero()[0].tolist())
    for f in sorted(range(fine.n_faces), key=lambda f: f in without):
        face, corners = places[f]
        for v, (u, w) in zip(fine.faces[f].tolist(), corners, strict=True):
            found.setdefault(v, (face, u, w))
    for v, place in found.items():
        assert (fine.parent_face[v], fine.parent_u[v], fine.parent_v[v]) == place


@pytest.mark.parametrize(
    "name",
    [
        *("crowded", "sphere_1", "torus_3x4", "patch_0", "fan_3", "disc_9", "grid_1x1", "dart_5"),
        *("crease_2_of_6", "corner_3", "cone_5", "semi_2.5", "chaikin", "semi_corner", "holes"),
        *("tagged_sphere_0", "tagged_patch_2", "two_tetrahedra", "moebius"),
    ],
)
@pytest.mark.filterwarnings("ignore:scheme 'loop' converges")
def test_limits_of_vertices(name):
    """Positions, and where the oracle knows them normals, of closed cages."""
    mesh, cage = given(name)
    surface = oracles_loop.LoopSurface(cage)
    fine = ls.refined(mesh, 0)
    for f in range(0, mesh.n_faces, 1 + mesh.n_faces // 8):
        for k, (u, v) in enumerate(oracles_loop.CORNERS):
            point, normal = (
                floats([x])[0] for x in (surface.evaluate(f, u, v), surface.normal(f, u, v))
            )
            got = fine.limit_points[mesh.faces[f][k]]
            if f not in surface.cage.holes:
                assert np.abs(got - point).max() <= 1e-15 * np.abs(mesh.points).max()
            if not mesh.boundary_vertex.any() and not np.isnan(normal).any():
                assert np.abs(fine.limit_normals[3 * f + k] - normal).max() <= 1e-12


def test_exact_limits():
    points, faces = zoo.octahedron()
    points = np.vectorize(F, otypes=[object])(points)
    mesh = ls.Mesh(points, faces, scheme=LOOP)
    own, each = oracles_loop.limit_mask(4)
    limits = ls.refined(mesh, 0).limit_points
    ring = {v for face in faces if 0 in face for v in face} - {0}
    expected = own * mesh.points[0] + each * sum(mesh.points[v] for v in ring)
    assert limits[0].tolist() == expected.tolist()
    assert (ls.refined(mesh, 2).limit_points[:6] == limits).all()


def test_irrational_masks_have_no_exact_points():
    points, faces = zoo_triangles.icosahedron()
    mesh = ls.Mesh(np.array(points, dtype=float).astype(object), faces, scheme=LOOP)
    for use in (ls.refined, lambda mesh: ls.refined(mesh, 0).limit_points):
        with pytest.raises(TypeError, match=r"vertex 0 has (valence )?5.*take float64"):
            use(mesh)
    ls.refined(mesh.with_points(mesh.points.astype(float)))
    # a sharp vertex stays where it is, until it becomes smooth; others are on the rim of what
    # is looked at alone
    points, faces = zoo_triangles.disc(5)
    faces = (np.array(faces) + 2) % len(points)
    mesh = ls.Mesh(zoo.random_points(len(points), 1), faces, scheme=LOOP, corners={2: 1.5})
    exact = mesh.with_points(mesh.points.astype(object))
    ls.refined(exact)
    uses: list[Callable[[], object]] = [
        lambda: ls.refined(exact, 2),
        lambda: ls.refined(exact, 0).limit_points,
    ]
    for act in uses:
        with pytest.raises(TypeError, match=r"vertex 2 has (valence )?5"):
            act()


def test_other_faces_are_refused():
    mesh = ls.Mesh(np.eye(4), [[0, 1, 2], [0, 1, 2, 3], [3, 2, 1, 0]], scheme=LOOP)
    with pytest.raises(MeshError, match=r"face 1 has 4 corners, need 3; cut .*; 1 more like it"):
        ls.refined(mesh)
    with pytest.raises(ValueError, match='has no triangle rule "smooth"'):
        ls.refined(ls.Mesh(np.eye(3), [[0, 1, 2]], scheme=LOOP), triangles="smooth")


def by_valence(a, b):
    """Loop's edge mask, bent towards the ends of more faces."""
    first, second = F(3, 8) + F(a - 6, 64), F(3, 8) + F(b - 6, 64)
    return first, second, (1 - first - second) / 2


@pytest.mark.parametrize("name", ["crowded", "patch_1", "semi_corner", "dart_6", "tagged_sphere_1"])
def test_edge_masks_by_the_valences_of_both_ends(name):
    """Those of sharp ends, and of ends on creases, are regular."""
    scheme = replace(LOOP, name="bent", edge=by_valence)
    mesh = given(name)[0]
    fine, R = ls.refined(mesh, 1, scheme=scheme, operator=True)
    plain = ls.refined(mesh)
    sharp = {int(v) for v in mesh.corners[0]} | set(mesh.indices[mesh.twin < 0].tolist())
    ends = mesh.creases[0].ravel().tolist()
    sharp |= {v for v in ends if ends.count(v) > 1} | set(mesh.edges[mesh.boundary_edge].ravel())
    creased = {tuple(edge) for edge in mesh.creases[0].tolist()}
    opposite = {}
    for face in mesh.faces.tolist():
        for k in range(3):
            opposite.setdefault(tuple(sorted((face[k], face[k - 1]))), []).append(face[k - 2])
    for number, (a, b) in enumerate(mesh.edges.tolist()):
        got = fine.points[mesh.n_vertices + number]
        if (a, b) in creased or len(opposite[a, b]) == 1:
            continue
        na, nb = (6 if v in sharp else int(mesh.vertex_faces[v]) for v in (a, b))
        first, second, across = map(float, by_valence(na, nb))
        c, d = opposite[a, b]
        expected = first * mesh.points[a] + second * mesh.points[b]
        expected = expected + across * (mesh.points[c] + mesh.points[d])
        assert np.abs(got - expected).max() <= 1e-15 * np.abs(mesh.points).max()
    vertices = slice(mesh.n_vertices)
    assert (fine.points[vertices] == plain.points[vertices]).all()
    assert np.abs(R @ mesh.points - fine.points).max() <= 1e-15 * np.abs(mesh.points).max()


@pytest.mark.parametrize("mode", ["none", "corners_plus2", "boundaries", "all"])
def test_channels(mode):
    """One without seams is refined as points are; of one with a seam each side by itself."""
    points, faces = zoo_triangles.grid(4, 2)
    faces = np.array(faces)
    values = zoo.random_points(len(points), mode)
    # a seam along the middle: vertices 2, 7, 12 of rows of five
    right = np.array(points, dtype=float)[faces].mean(axis=1)[:, 0] > np.mean(
        [p[0] for p in points]
    )
    seam = [v for v in range(len(points)) if {*right[(faces == v).any(axis=1)]} == {True, False}]
    rows = faces.copy()
    for k, v in enumerate(seam):
        rows[right] = np.where(rows[right] == v, len(points) + k, rows[right])
    more = np.concatenate([values, zoo.random_points(len(seam), 5)])
    channels = {
        "plain": (values, faces.ravel(), mode),
        "cut": (more, rows.ravel(), mode),
    }
    mesh = ls.Mesh(points, faces, scheme=LOOP, boundary="edge_only", channels=channels)
    fine = ls.refined(mesh, 2)
    if mode == "none":
        for got, (own, corners) in zip(
            ("plain", "cut"), ((values, faces), (more, rows)), strict=True
        ):
            alone = ls.refined(ls.Mesh(own, corners, scheme=LOOP, boundary="edge_only"), 2)
            found, indices, _ = fine.channels[got]
            assert np.abs(found[indices] - alone.points[alone.indices]).max() <= 1e-15 * 64
    if mode == "all":
        found, indices, _ = fine.channels["cut"]
        places = oracles_loop.refined_parameters(len(faces), 2)
        for (f, corners), at in zip(places, indices.reshape(-1, 3), strict=True):
            a, b, c = more[rows[f]]
            for (u, v), value in zip(corners, found[at], strict=True):
                expected = a * float(1 - u - v) + b * float(u) + c * float(v)
                assert np.abs(value - expected).max() <= 1e-15 * 64


def test_most_faces_at_a_vertex():
    """More than tables of quads are made for."""
    n = tables.MOST_FACES + 8
    points, faces = zoo_triangles.disc(n)
    mesh = ls.Mesh(zoo.random_points(len(points), n), faces, scheme=LOOP)
    own, each = (float(x) for x in oracles_loop.limit_mask(n, bits=100))
    limit = ls.refined(mesh, 0).limit_points[0]
    expected = own * mesh.points[0] + each * mesh.points[1 : n + 1].sum(axis=0)
    assert np.abs(limit - expected).max() <= 1e-13
