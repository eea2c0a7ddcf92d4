"""Polygons on the surface: without gaps, every corner where its limit face has it."""

from collections import Counter

import numpy as np
import pytest
import zoo
import zoo_triangles
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

import limitsurf as ls
from limitsurf import _kernels

CAGES = {
    **{name: (lambda make=make: (*make(), {})) for name, make in zoo.ZOO.items()},
    **zoo.TAGGED,
}
CLOSED = [name for name in zoo.ZOO if not ls.Mesh(*zoo.ZOO[name]()).boundary_edge.any()]


def cage(name, **tags):
    points, faces, own = CAGES[name]()
    return ls.Mesh(points, faces, **own, **tags)


def with_uv(mesh, seed=0, mode="corners_plus1"):
    """Some seams: of every vertex one value or two."""
    g = np.random.default_rng(seed)
    rows = mesh.indices + mesh.n_vertices * (g.random(mesh.n_corners) < 0.2)
    return ls.Mesh(
        mesh.points,
        (mesh.sizes, mesh.indices),
        **{name: getattr(mesh, name) for name in ("creases", "corners", "holes")},
        **{name: getattr(mesh, name) for name in ("boundary", "creasing", "triangles")},
        channels={"uv": (g.random((2 * mesh.n_vertices, 2)), rows, mode)},
    )


def expected(surface, n):
    """The limit face, u and v of every corner of every polygon, one by one; sizes of these."""
    mesh, limit_faces = surface.mesh, surface.limit_faces
    centre = surface.evaluate(np.arange(len(limit_faces)), 0.4, 0.6)
    kept = ~np.isnan(centre).any(axis=1)
    doubled = {
        int(mesh.corner_edge[h])
        for h in range(mesh.n_corners)
        if mesh.sizes[f := mesh.corner_face[h]] != 4 and kept[limit_faces.first[f]]
    }
    corners, sizes = [], []
    for face in np.flatnonzero(kept):
        first = mesh.offsets[limit_faces.face[face]]
        fine = [False] * 4
        if limit_faces.corner[face] < 0:
            fine = [int(mesh.corner_edge[first + side]) in doubled for side in range(4)]
        for j in range(n):
            for i in range(n):
                square = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
                on_side = [j == 0, i == n - 1, j == n - 1, i == 0]
                polygon = []
                for side in range(4):
                    (a, b), (c, d) = square[side], square[(side + 1) % 4]
                    polygon.append((face, a / n, b / n))
                    if on_side[side] and fine[side]:
                        polygon.append((face, (a + c) / (2 * n), (b + d) / (2 * n)))
                corners += polygon
                sizes.append(len(polygon))
    return *map(np.array, zip(*corners, strict=True)), sizes


def counted(mesh, surface, n):
    """How many points there are: vertices, insides of edges, centres, spokes, insides of faces."""
    limit_faces = surface.limit_faces
    kept = np.isfinite(surface.evaluate(limit_faces.first, 0.4, 0.6)).all(axis=1)
    there = kept[mesh.corner_face]
    segments = np.zeros(mesh.n_edges, dtype=int)
    np.maximum.at(segments, mesh.corner_edge[there], n)
    ngons = kept & (mesh.sizes != 4)
    np.maximum.at(segments, mesh.corner_edge[ngons[mesh.corner_face]], 2 * n)
    vertices = len(np.unique(mesh.indices[there]))
    sizes = mesh.sizes[ngons]
    inside = (n - 1) ** 2 * (int(kept.sum() - ngons.sum()) + int(sizes.sum()))
    edges = int((segments[segments > 0] - 1).sum())
    return vertices + edges + len(sizes) + (n - 1) * int(sizes.sum()) + inside


def assert_equal(found, wanted, tolerance):
    assert found.shape == wanted.shape
    assert np.array_equal(np.isnan(found), np.isnan(wanted))
    assert (np.abs(found - wanted)[~np.isnan(wanted)] < tolerance).all()


def checked(mesh, n):
    """The tessellation of a cage, its every corner compared with that of its own limit face."""
    mesh = with_uv(mesh)
    surface = ls.LimitSurface(mesh)
    found = ls.tessellate(surface, n, channels=["uv"])
    assert len(found.points) == counted(mesh, surface, n)
    if not len(found.points):
        return found
    face, u, v, sizes = expected(surface, n)
    assert found.sizes.tolist() == sizes
    size = np.ptp(mesh.points, axis=0).max()
    assert_equal(found.points[found.indices], surface.evaluate(face, u, v), 1e-13 * size)
    assert_equal(found.normals[found.normal_indices], surface.normal(face, u, v), 2e-6)
    values, of_values = found.channels["uv"]
    assert_equal(values[of_values], surface.evaluate(face, u, v, channel="uv"), 1e-13)
    assert_equal(found.points, surface.evaluate(found.face, found.u, found.v), 1e-13 * size)
    for rows, count in (
        (found.indices, len(found.points)),
        (found.normal_indices, len(found.normals)),
        (of_values, len(values)),
    ):
        assert np.array_equal(np.unique(rows), np.arange(count))
    return found


def edges(found):
    """How often polygons run along each directed edge."""
    after = np.arange(1, len(found.indices) + 1)
    after[found.offsets[1:] - 1] = found.offsets[:-1]
    ends = np.stack([found.indices, found.indices[after]], axis=1)
    return Counter(map(tuple, ends.tolist()))


@pytest.mark.parametrize("name", CAGES)
def test_every_corner_is_where_its_limit_face_has_it(name):
    mesh = cage(name)
    for n in (1, 3):
        found = checked(mesh, n)
        # the same cell complex as the cage's, where its edges have different ends
        if n == 3 and len(found.sizes) and not len(mesh.holes) and mesh.boundary != "none":
            used = np.count_nonzero(mesh.vertex_faces)
            n_edges = len({(min(edge), max(edge)) for edge in edges(found)})
            euler = len(found.points) - n_edges + len(found.sizes)
            assert euler == used - mesh.n_edges + mesh.n_faces


@pytest.mark.parametrize("name", CLOSED)
def test_no_gap_in_a_closed_cage(name):
    mesh = cage(name)
    for n in (2, 3):
        found = edges(ls.tessellate(ls.LimitSurface(mesh), n, normals=False))
        assert set(found.values()) == {1}
        assert all((b, a) in found for a, b in found)


@pytest.mark.parametrize(
    "name", ["icosahedron", "sphere_1", "patch_0", "semi_2.5", "tagged_patch_1", "holes"]
)
def test_triangles_of_a_surface_of_triangles(name):
    points, faces, *tags = {**zoo_triangles.ZOO, **zoo_triangles.TAGGED}[name]()
    mesh = with_uv(ls.Mesh(points, faces, **(tags[0] if tags else {})))
    surface = ls.LimitSurface(mesh, scheme="loop")
    kept = np.flatnonzero(np.isfinite(surface.evaluate(np.arange(mesh.n_faces), 0.3, 0.3)[:, 0]))
    for n in (1, 2, 5):
        found = ls.tessellate(surface, n, channels=["uv"])
        # row by row: that with its point in the corner, and beside it the turned one
        corners = [
            (face, a / n, b / n)
            for face in kept.tolist()
            for j in range(n)
            for i in range(n - j)
            for cell in (
                [(i, j), (i + 1, j), (i, j + 1)],
                [(i + 1, j + 1), (i, j + 1), (i + 1, j)],
            )
            if max(a + b for a, b in cell) <= n
            for a, b in cell
        ]
        face, u, v = map(np.array, zip(*corners, strict=True))
        assert found.uniform.shape == (n * n * len(kept), 3)
        assert_equal(found.points[found.indices], surface.evaluate(face, u, v), 1e-13)
        assert_equal(found.points, surface.evaluate(found.face, found.u, found.v), 1e-13)
        assert_equal(found.normals[found.normal_indices], surface.normal(face, u, v), 2e-6)
        values, rows = found.channels["uv"]
        assert_equal(values[rows], surface.evaluate(face, u, v, channel="uv"), 1e-13)
        used = len(np.unique(mesh.indices[np.isin(mesh.corner_face, kept)]))
        n_edges = len(np.unique(mesh.corner_edge[np.isin(mesh.corner_face, kept)]))
        inside = (n - 1) * (n - 2) // 2 * len(kept)
        assert len(found.points) == used + (n - 1) * n_edges + inside
        if not mesh.boundary_edge.any() and not len(mesh.holes):
            assert all((b, a) in edges(found) for a, b in edges(found))


def test_the_refined_surface_of_triangles():
    surface = ls.LimitSurface(ls.Mesh(*zoo_triangles.ZOO["sphere_1"]()), scheme="loop")
    g = np.random.default_rng(0)
    u, v = np.sort(g.random((2, 300)), axis=0)
    face, v = g.integers(0, surface.mesh.n_faces, 300), v - u
    v[::3] = 1 - u[::3]
    position, normal = ls.refinement_gap(surface, face, u, v)
    assert position < 1e-13
    assert normal < 1e-12
    assert ls.agrees(surface, ls.validate(surface, 3))


@pytest.mark.parametrize("name", ["grid_3x3", "carved_grid", "carved_cylinder", "flower_5_wide"])
def test_the_rim_of_an_open_cage(name):
    mesh = cage(name)
    found = edges(ls.tessellate(ls.LimitSurface(mesh), 2))
    assert set(found.values()) == {1}
    rim = [edge for edge in found if edge[::-1] not in found]
    at_rim = mesh.boundary_edge[mesh.corner_edge]
    ngon = mesh.sizes[mesh.corner_face] != 4
    assert len(rim) == np.where(ngon[at_rim], 4, 2).sum()


@given(zoo.tagged_cages(), st.integers(1, 3))
@settings(max_examples=zoo.EXAMPLES)
def test_random_cages(case, n):
    points, faces, tags = case
    checked(ls.Mesh(points, faces, **tags), n)


@pytest.mark.parametrize("name", ["cube", "torus_4x5", "grid_3x3", "ring_2.5", "dart_5", "fin"])
def test_as_refinement(name):
    mesh = cage(name)
    found = ls.tessellate(ls.LimitSurface(mesh), 4)
    limits = ls.refined(mesh, 2).limit_points
    limits = limits[~np.isnan(limits).any(axis=1)]
    assert len(limits) == len(found.points)
    distance, match = cKDTree(limits).query(found.points)
    assert distance.max() < 1e-13 * np.abs(limits).max()
    assert len(np.unique(match)) == len(match)


# --- Normals, channels


def test_creases_have_two_normals():
    rim = [(4, 5), (5, 7), (7, 6), (6, 4)]
    mesh = ls.Mesh(*zoo.cube(), creases=dict.fromkeys([(min(e), max(e)) for e in rim], np.inf))
    found = ls.tessellate(ls.LimitSurface(mesh), 4)
    pairs = np.unique(np.stack([found.indices, found.normal_indices]), axis=1)
    sides = np.bincount(pairs[0])
    assert Counter(sides.tolist()) == {1: 98 - 16, 2: 16}
    smooth = ls.tessellate(ls.LimitSurface(ls.Mesh(*zoo.cube())), 4)
    assert len(smooth.normals) == 98


def test_a_vertex_of_many_sides():
    points, faces = zoo.bipyramid(64)
    spokes = {(i, 64): np.inf for i in range(64)}
    found = ls.tessellate(ls.LimitSurface(ls.Mesh(points, faces, creases=spokes)), 1)
    at_pole = np.unique(found.normal_indices[found.indices == 64])
    assert len(at_pole) == 64


def test_missing_normals_stay_missing():
    # no limit normal at the end of a crease between two faces
    mesh = cage("dart_2")
    found = ls.tessellate(ls.LimitSurface(mesh), 3)
    missing = np.isnan(found.normals).any(axis=1)
    points = found.indices[missing[found.normal_indices]]
    assert 0 in points
    assert len(np.unique(points)) == missing.sum()


def test_opposite_faces_have_opposite_normals():
    found = ls.tessellate(ls.LimitSurface(cage("opposite_orientation")), 3)
    pairs = np.unique(np.stack([found.indices, found.normal_indices]), axis=1)
    assert (np.bincount(pairs[0]) == 2).sum() == 4


def test_without_normals():
    found = ls.tessellate(ls.LimitSurface(cage("cube")), 2, normals=False)
    assert (found.normals.shape, found.normal_indices.shape) == ((0, 3), (0,))
    assert_equal(found.points, ls.tessellate(ls.LimitSurface(cage("cube")), 2).points, 1e-15)
    split = found.split()  # nothing that a point could have two of
    assert (split.normals.shape, split.normal_indices.shape) == ((0, 3), (0,))
    assert np.array_equal(split.points, found.points)
    assert np.array_equal(split.indices, found.indices)


@pytest.mark.parametrize("mode", ["none", "corners_plus1", "all"])
def test_seams(mode):
    points, faces = zoo.torus(4, 5)
    mesh = with_uv(ls.Mesh(points, faces), 3, mode)
    surface = ls.LimitSurface(mesh)
    found = ls.tessellate(surface, 3, channels="uv")
    values, rows = found.channels["uv"]
    assert len(found.points) < len(values) < len(rows)
    face, u, v, _ = expected(surface, 3)
    assert_equal(values[rows], surface.evaluate(face, u, v, channel="uv"), 1e-13)
    with pytest.raises(ValueError, match="no channel 'st'; it has 'uv'"):
        ls.tessellate(surface, 3, channels=["uv", "st"])


# --- Triangles


@pytest.mark.parametrize("name", ["carved_cube_1", "sphere_8", "prism_7", "truncated_cube"])
@pytest.mark.parametrize("n", [1, 2, 5])
def test_triangles_cover_the_polygons(name, n):
    found = ls.tessellate(ls.LimitSurface(cage(name)), n)
    triangles, points = found.triangles, found.points
    assert len(triangles) == (found.sizes - 2).sum()
    polygon = np.repeat(np.arange(len(found.sizes)), found.sizes)
    assert (polygon[triangles] == polygon[triangles[:, :1]]).all()
    assert (np.diff(polygon[triangles[:, 0]]) >= 0).all()
    a, b, c = points[found.indices[triangles]].transpose(1, 0, 2)
    area = np.zeros((len(found.sizes), 3))
    np.add.at(area, polygon[triangles[:, 0]], np.cross(b - a, c - a))
    around = [np.roll(np.arange(k), -1) for k in found.sizes]
    for f, after in enumerate(around):
        p = points[found.indices[found.offsets[f] :][: found.sizes[f]]]
        assert np.allclose(np.cross(p, p[after]).sum(axis=0), area[f], atol=1e-12)
    # no sliver amid the side of a quad that has one point more
    lengths = np.linalg.norm(np.stack([b - a, c - b, a - c]), axis=2)
    height = np.linalg.norm(np.cross(b - a, c - a), axis=1) / lengths.max(axis=0)
    assert (height / lengths.max(axis=0)).min() > 0.02


@pytest.mark.parametrize("name", ["torus_4x5", "cube", "dodecahedron", "sphere_8"])
def test_triangles_and_normals_face_the_same_way(name):
    found = ls.tessellate(ls.LimitSurface(cage(name)), 4)
    a, b, c = found.points[found.indices[found.triangles]].transpose(1, 0, 2)
    normals = found.normals[found.normal_indices[found.triangles]]
    assert (np.einsum("ti,tki->tk", np.cross(b - a, c - a), normals) > 0).all()


def test_quads_are_cut_along_the_shorter_diagonal():
    points = [[0, 0, 0], [4, 1, 0], [5, 5, 0], [1, 4, 0]]
    for shift in range(4):
        mesh = ls.Mesh(np.roll(points, shift, axis=0), [[0, 1, 2, 3]], creases={})
        found = ls.tessellate(ls.LimitSurface(mesh), 1)
        shared = set(found.triangles[0]) & set(found.triangles[1])
        a, b = found.points[found.indices[list(shared)]]
        assert np.isclose(np.linalg.norm(a - b), np.sqrt(18))


# --- One value for each point


def test_polygons_are_faces():
    """One type whatever their sizes: quads, or up to eight corners beside an n-gon."""
    quads = ls.tessellate(ls.LimitSurface(ls.Mesh(*zoo.cube())), 2)
    assert quads.uniform.tolist() == quads.faces.tolist()
    mixed = ls.tessellate(ls.LimitSurface(ls.Mesh(*zoo.prism(5))), 2)
    assert mixed.uniform is None
    assert list(map(len, mixed.faces)) == mixed.sizes.tolist()
    assert ls.Mesh(mixed.points, mixed.faces).indices.tolist() == mixed.indices.tolist()


def test_split():
    rim = {(4, 5): np.inf, (5, 7): np.inf, (6, 7): np.inf, (4, 6): np.inf}
    mesh = with_uv(ls.Mesh(*zoo.cube(), creases=rim))
    found = ls.tessellate(ls.LimitSurface(mesh), 4, channels=["uv"])
    split = found.split()
    values, rows = found.channels["uv"]
    values_of_points, rows_of_points = split.channels["uv"]
    assert np.array_equal(split.indices, split.normal_indices)
    assert np.array_equal(split.indices, rows_of_points)
    assert len(split.points) == len(split.normals) == len(values_of_points) == len(split.face)
    triples = np.stack([found.indices, found.normal_indices, rows])
    assert len(split.points) == len(np.unique(triples, axis=1).T)
    assert np.array_equal(split.points[split.indices], found.points[found.indices])
    assert np.array_equal(split.normals[split.indices], found.normals[found.normal_indices])
    assert np.array_equal(values_of_points[rows_of_points], values[rows])
    assert np.array_equal(split.points[: len(found.points)], found.points)
    surface = ls.LimitSurface(mesh)
    assert_equal(surface.evaluate(split.face, split.u, split.v), split.points, 1e-13)
    assert np.array_equal(split.triangles, found.triangles)


# --- Nothing, much, and what is refused


def test_nothing_but_holes():
    mesh = ls.Mesh(*zoo.grid(1, 1), holes=[0])
    found = ls.tessellate(ls.LimitSurface(mesh), 2)
    assert repr(found) == "Tessellation(0 points, 0 faces)"
    assert found.triangles.shape == (0, 3)
    assert found.split().points.shape == (0, 3)


def test_holes_are_left_out():
    mesh = ls.Mesh(*zoo.grid(3, 3), holes=[4])
    found = ls.tessellate(ls.LimitSurface(mesh), 2)
    assert len(found.sizes) == 32
    assert 4 not in found.face
    assert np.isfinite(found.points).all()


def test_compiled_alike(use, monkeypatch):
    points, faces = zoo.carved(zoo.torus(3, 4), 8)
    answers = []
    compiled = _kernels.compiled

    def heard(*items):
        answers.append(compiled(*items))
        return answers[-1]

    def found():
        surface = ls.LimitSurface(ls.Mesh(points, faces))
        return surface, ls.tessellate(surface, 12)

    monkeypatch.setattr(_kernels, "compiled", heard)
    use(False)
    _, twin = found()
    assert set(answers) == {False}
    answers.clear()
    use(True)
    surface, fast = found()
    assert set(answers) == {True}
    for name in ("sizes", "indices", "face", "u", "v", "normal_indices"):
        assert np.array_equal(getattr(fast, name), getattr(twin, name))
    # both have the stated accuracy of points: 1e-14 of the size, and 2 ulp
    size, largest = np.ptp(points, axis=0).max(), np.abs(twin.points).max()
    assert_equal(fast.points, twin.points, 2 * (1e-14 * size + 2 * np.spacing(largest)))
    # and of both derivatives, 1e-12, which turns a normal the more the less these two differ
    along, across = surface.tangents(fast.face, fast.u, fast.v)
    sine = np.linalg.norm(np.cross(along, across), axis=1)
    assert_equal(fast.normals, twin.normals, 4e-12 / sine.min())


@pytest.mark.parametrize("n", [0, -1, 1.0, True, "2"])
def test_no_number_of_segments(n):
    with pytest.raises(ValueError, match="n must be an integer >= 1, got"):
        ls.tessellate(ls.LimitSurface(cage("cube")), n)


def test_no_surface():
    with pytest.raises(TypeError, match="needs a LimitSurface, got Mesh"):
        ls.tessellate(cage("cube"), 2)
    points, faces = zoo.cube()
    with pytest.raises(ValueError, match=r"shape \(8, 2\), need \(n_vertices, 3\)"):
        ls.tessellate(ls.LimitSurface(ls.Mesh(points[:, :2], faces)), 2)
    with pytest.raises(TypeError, match="need float64 points"):
        ls.tessellate(ls.LimitSurface(ls.Mesh(points.astype(object), faces)), 2)


@pytest.mark.parametrize("name", ["truncated_cube", "sphere_8"])
@pytest.mark.parametrize("power", [530, -660])
def test_triangles_of_any_size(name, power):
    # edges whose squares are no float64
    mesh = cage(name)
    found = [
        ls.tessellate(ls.LimitSurface(ls.Mesh(np.ldexp(mesh.points, k), mesh.faces)), 3)
        for k in (0, power)
    ]
    triangles = found[0].triangles
    with np.errstate(all="raise"):
        assert np.array_equal(found[1].triangles, triangles)
