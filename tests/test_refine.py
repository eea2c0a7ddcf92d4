"""The recursive refiner against a naive one, by hand, and against the limit surface."""

import pickle
import random
from decimal import Decimal
from fractions import Fraction as F
from pathlib import Path
from typing import Any

import numpy as np
import oracles
import pytest
import zoo

import limitsurf as ls
from limitsurf import tables

SHARED_CAGES = Path(__file__).resolve().parents[2] / "shared" / "cages"

CAGES = {name: make() for name, make in zoo.ZOO.items()}
on_the_zoo = pytest.mark.parametrize("name", CAGES)
in_both_modes = pytest.mark.parametrize("mode", oracles.MODES)


def shaken(name):
    """A zoo mesh whose points, thirds of floats, have no symmetry that could hide an error."""
    points, faces = CAGES[name]
    return fractions(zoo.random_points(len(points), name)) / 3, faces


def fractions(values):
    """The same numbers as an object array of Fractions."""
    values = np.asarray(values)
    exact = np.empty(values.size, dtype=object)
    exact[:] = [F(x) for x in values.ravel().tolist()]
    return exact.reshape(values.shape)


def rows(points):
    """Points as the oracle likes them."""
    return [tuple(p) for p in points.tolist()]


def deepest(faces, largest=600):
    """How often a mesh can be refined by loops in a moment, 1 to 3 times."""
    corners = sum(map(len, faces))
    return next(k for k in (3, 2, 1) if k == 1 or corners * 4 ** (k - 1) <= largest)


# --- The rules


@on_the_zoo
@in_both_modes
def test_refined_is_naively_refined(name, mode):
    """Points, exactly, and faces in their order and with their corners in order."""
    points, faces = shaken(name)
    levels = deepest(faces)
    fine = ls.refined(ls.Mesh(points, faces), levels, boundary=mode)
    naive, children = oracles.refine_times(rows(points), faces, levels, mode)
    assert rows(fine.points) == naive
    assert fine.faces.tolist() == children
    assert all(isinstance(x, F) for x in fine.points.ravel())


@on_the_zoo
@in_both_modes
def test_operator_is_naively_refined(name, mode):
    """The matrix is the one that the naive refiner applies, entry by entry."""
    points, faces = shaken(name)
    fine, R = ls.refined(ls.Mesh(points, faces), 1, operator=True, boundary=mode)
    forms = [(oracles.Stencil({v: F(1)}),) for v in range(len(points))]
    naive, _ = oracles.refine(forms, faces, mode)
    assert isinstance(R, ls.ExactOperator)
    assert R.shape == (fine.n_vertices, len(points)) == (len(naive), len(points))
    for k, (stencil,) in enumerate(naive):
        row = slice(R.indptr[k], R.indptr[k + 1])
        weights = dict(zip(R.columns[row].tolist(), R.values[row], strict=True))
        assert {v: w for v, w in weights.items() if w} == {v: w for v, w in stencil.items() if w}
        assert sum(weights.values()) == 1
    assert (R @ points == fine.points).all()


@on_the_zoo
def test_operator_of_several_levels(name):
    points, faces = shaken(name)
    mesh = ls.Mesh(points, faces)
    levels = min(deepest(faces), 2)
    fine, R = ls.refined(mesh, levels, operator=True)
    assert (R @ points == fine.points).all()
    floats = ls.Mesh(points.astype(float), faces)
    rounded, S = ls.refined(floats, levels, operator=True)
    assert S.shape == R.shape
    assert np.abs(S - R.toarray().astype(float)).max() < 5e-15
    assert np.abs(rounded.points - fine.points.astype(float)).max() < 5e-15
    assert np.abs(S @ floats.points - rounded.points).max() < 5e-15
    assert np.abs(S.sum(axis=1) - 1).max() < 5e-15


def test_level_by_level():
    """Refining twice is refining a refined mesh; the operators multiply."""
    for name in ("cube", "carved_grid", "unused_vertices", "stairs"):
        mesh = ls.Mesh(*shaken(name), boundary="edge_only", holes=[0])
        once, first = ls.refined(mesh, operator=True)
        again, second = ls.refined(once, operator=True)
        twice, both = ls.refined(mesh, 2, operator=True)
        assert again.boundary == "edge_only"
        assert (again.points == twice.points).all()
        assert again.faces == twice.faces
        assert again.holes.tolist() == twice.holes.tolist()
        product = second @ first
        assert product.shape == both.shape
        assert (product.toarray() == both.toarray()).all()


def test_no_level_is_the_mesh_itself():
    points, faces = shaken("carved_prism")
    mesh = ls.Mesh(points, faces, holes=[2], boundary="edge_only")
    fine, R = ls.refined(mesh, 0, operator=True)
    assert (fine.points == points).all()
    assert fine.faces.tolist() == faces
    assert fine.holes.tolist() == [2]
    assert (R.toarray() == np.eye(len(points), dtype=int)).all()
    assert isinstance(fine, ls.RefinedMesh)
    floats, S = ls.refined(ls.Mesh(points.astype(float), faces), 0, operator=True)
    assert (S.toarray() == np.eye(len(points))).all()
    assert (S @ floats.points == floats.points).all()
    assert (floats.parent_face >= 0).all()


def test_cube_by_hand():
    mesh = ls.Mesh(np.array(oracles.CUBE_POINTS, dtype=float), oracles.CUBE_FACES)
    fine = ls.refined(mesh)
    assert fine.points[0] == pytest.approx([2 / 9] * 3)
    assert fine.points[8:10].tolist() == [[1 / 8, 1 / 8, 1 / 2], [1 / 8, 1 / 2, 1 / 8]]
    assert fine.points[20].tolist() == [0, 1 / 2, 1 / 2]
    assert fine.faces[:2].tolist() == [[0, 8, 20, 9], [1, 11, 20, 8]]
    assert fine.limit_points[0] == pytest.approx([1 / 4] * 3)
    assert fine.limit_normals[0] == pytest.approx([-(3**-0.5)] * 3)


def test_edge_points_follow_the_edges():
    """Vertices, edge points in the order of the mesh's edges, face points; children of a face."""
    points, faces = CAGES["carved_cube_0"]
    mesh = ls.Mesh(points, faces)
    fine = ls.refined(mesh)
    V, E = mesh.n_vertices, mesh.n_edges
    assert fine.n_vertices == V + E + mesh.n_faces
    edge_of = {tuple(edge): V + e for e, edge in enumerate(mesh.edges.tolist())}
    child = 0
    for f, face in enumerate(faces):
        for k, v in enumerate(face):
            after, before = (
                edge_of[tuple(sorted((v, face[j])))] for j in ((k + 1) % len(face), k - 1)
            )
            assert fine.faces[child].tolist() == [v, after, V + E + f, before]
            child += 1
    assert child == fine.n_faces


def test_boundary_rules_by_hand():
    points = [[0, 0], [16, 0], [32, 8], [0, 16], [16, 16], [32, 16]]
    mesh = ls.Mesh(points, [[0, 1, 4, 3], [1, 2, 5, 4]])
    fixed, following = ls.refined(mesh), ls.refined(mesh, boundary="edge_only")
    assert fixed.points[0].tolist() == [0, 0]
    assert following.points[0].tolist() == [2, 2]
    assert fixed.points[1].tolist() == following.points[1].tolist() == [16, 1]
    assert fixed.points[6].tolist() == following.points[6].tolist() == [8, 0]
    assert (ls.refined(mesh, boundary="none").points == following.points).all()


def test_unused_vertices_stay():
    points, faces = CAGES["unused_vertices"]
    mesh = ls.Mesh(points, faces)
    alone = np.flatnonzero(mesh.vertex_faces == 0)
    assert len(alone) == 3
    fine, R = ls.refined(mesh, 2, operator=True)
    assert (fine.points[alone] == points[alone]).all()
    assert (R[alone].toarray() == np.eye(len(points))[alone]).all()
    assert (fine.parent_face[alone] == -1).all()
    assert np.isnan(fine.parent_u[alone]).all()
    assert np.isnan(fine.parent_v[alone]).all()
    assert np.isnan(fine.limit_points[alone]).all()
    assert np.flatnonzero(np.isnan(fine.limit_points[:, 0])).tolist() == alone.tolist()


@pytest.mark.parametrize("shape", [(), (0,), (1,), (2,), (2, 2)])
@pytest.mark.parametrize("exact", [False, True])
def test_any_channels(shape, exact):
    _, faces = CAGES["carved_grid"]
    n = 1 + max(map(max, faces))
    data = np.random.default_rng(3).integers(-256, 256, (n, *shape)) / 256
    points = fractions(data) if exact else data
    fine, R = ls.refined(ls.Mesh(points, faces), 2, operator=True)
    flat = ls.refined(ls.Mesh(points.reshape(n, -1), faces), 2)
    assert fine.points.shape == fine.limit_points.shape == (fine.n_vertices, *shape)
    assert fine.points.dtype == points.dtype
    assert (fine.points == flat.points.reshape(fine.points.shape)).all()
    assert (fine.limit_points == flat.limit_points.reshape(fine.points.shape)).all()
    assert (R @ points if exact else R @ flat_rows(data)).shape[0] == fine.n_vertices


def flat_rows(array):
    return array.reshape(len(array), -1)


@pytest.mark.parametrize("dtype", [np.int32, np.float32, object])
def test_number_types(dtype):
    points, faces = CAGES["cube"]
    fine = ls.refined(ls.Mesh((points * 9).astype(int).astype(dtype), faces))
    assert fine.points.dtype == (object if dtype is object else float)
    assert fine.points[0] == pytest.approx([2, 2, 2], abs=1e-15)


@pytest.mark.parametrize(
    "name",
    ["spot_control_mesh", "gismo_bitorus", "gismo_polycube", "gismo_mushroom", "catmark_pawn"],
)
@pytest.mark.skipif(not SHARED_CAGES.is_dir(), reason="these cages are not part of the package")
def test_real_cages(name):
    mesh = ls.read(SHARED_CAGES / f"{name}.obj")
    if len(mesh.creases[0]):
        mesh = ls.Mesh(mesh.points, (mesh.sizes, mesh.indices))
    levels = 1 if mesh.n_faces > 300 else 2
    faces = mesh.faces.tolist()
    naive, children = oracles.refine_times(mesh.points.tolist(), faces, levels)
    fine = ls.refined(mesh, levels)
    assert fine.faces.tolist() == children
    size = np.abs(mesh.points).max()
    assert np.abs(fine.points - naive).max() <= 5e-15 * size
    limits = oracles.limit_positions(naive, children)
    assert np.abs(fine.limit_points - limits).max() <= 5e-15 * size


# --- Limits of refined vertices


def moved_to_limits(points, faces, levels, mode):
    """Naive limits of the refined vertices, after one more level for those that touch n-gons."""
    naive, children = oracles.refine_times(rows(points), faces, levels, mode)
    n = len(naive)
    if any(len(face) != 4 for face in children):
        naive, children = oracles.refine(naive, children, mode)
    return oracles.limit_positions(naive, children, mode)[:n]


@on_the_zoo
@in_both_modes
def test_limit_points(name, mode):
    """By the published masks, exactly; NaN for a vertex that nothing is around."""
    points, faces = shaken(name)
    for levels in (0, 1) if sum(map(len, faces)) < 200 else (1,):
        fine = ls.refined(ls.Mesh(points, faces), levels, boundary=mode)
        limits = moved_to_limits(points, faces, levels, mode)
        used = fine.vertex_faces > 0
        assert rows(fine.limit_points[used]) == [p for p, u in zip(limits, used, strict=True) if u]
        assert all(x != x for x in fine.limit_points[~used].ravel())
        floats = ls.refined(ls.Mesh(points.astype(float), faces), levels, boundary=mode)
        error = floats.limit_points[used] - fine.limit_points[used].astype(float)
        assert np.abs(error).max() < 1e-15


@on_the_zoo
def test_parents(name):
    """The limit of a refined vertex is the surface at its parent parameters, exactly."""
    points, faces = shaken(name)
    mesh = ls.Mesh(points, faces)
    surface = ls.LimitSurface(mesh)
    for levels in range(1 + deepest(faces)):
        fine = ls.refined(mesh, levels)
        used = np.flatnonzero(fine.vertex_faces > 0).tolist()
        some = random.Random(name).sample(used, min(len(used), 16))
        parents = fine.parent_face[some], fine.parent_u[some], fine.parent_v[some]
        assert (surface.evaluate(*parents) == fine.limit_points[some]).all()


@on_the_zoo
def test_parents_are_parameters_of_corners(name):
    """A vertex's parent is where some child has it, by naive bookkeeping."""
    points, faces = CAGES[name]
    levels = deepest(faces, 3000)
    fine = ls.refined(ls.Mesh(points, faces), levels)
    places = [set() for _ in range(fine.n_vertices)]
    for child, (face, corners) in zip(
        fine.faces.tolist(), oracles.refined_parameters(faces, levels), strict=True
    ):
        for v, (s, t) in zip(child, corners, strict=True):
            places[v].add((face, float(s), float(t)))
    parents = zip(
        fine.parent_face.tolist(), fine.parent_u.tolist(), fine.parent_v.tolist(), strict=True
    )
    for at, parent in zip(places, parents, strict=True):
        assert parent in at if at else parent[0] == -1


@on_the_zoo
def test_limit_normals(name):
    """By tangent masks, what the surface has at the parameters of every corner of every child."""
    points, faces = CAGES[name]
    mesh = ls.Mesh(zoo.random_points(len(points), name), faces)
    surface = ls.LimitSurface(mesh)
    for levels in (1, 2) if sum(map(len, faces)) < 200 else (1,):
        fine = ls.refined(mesh, levels)
        assert fine.limit_normals.shape == (fine.n_corners, 3)
        parameters = oracles.refined_parameters(faces, levels)
        face = np.repeat([face for face, _ in parameters], 4)
        u, v = np.array([c for _, corners in parameters for c in corners], dtype=float).T
        normals = surface.normal(face, u, v)
        # where the sheets of a pillow meet, one derivative is nothing but rounding
        sizes = [
            np.linalg.norm(surface.evaluate(face, u, v, nu=nu), axis=1) for nu in ((1, 0), (0, 1))
        ]
        fold = np.minimum(*sizes) < 1e-6 * np.maximum(*sizes)
        assert not fold.any() or "pillow" in name or name == "disconnected"
        exists = ~np.isnan(normals[:, 0])
        assert (exists == ~np.isnan(fine.limit_normals[:, 0]))[~fold].all()
        assert np.abs(fine.limit_normals - normals)[exists & ~fold].max() < 1e-12


@pytest.mark.parametrize("name", ["truncated_cube", "carved_grid", "flower_3", "triangle"])
def test_limit_normals_of_a_cage(name):
    """Without any refinement, n-gons included."""
    points, faces = CAGES[name]
    mesh = ls.Mesh(zoo.random_points(len(points), name), faces)
    normals = ls.refined(mesh, 0).limit_normals
    assert normals.shape == (mesh.n_corners, 3)
    surface = ls.LimitSurface(mesh)
    first = surface.limit_faces.first[mesh.corner_face]
    corner = np.arange(mesh.n_corners) - mesh.offsets[mesh.corner_face]
    quad = mesh.sizes[mesh.corner_face] == 4
    u, v = np.array(oracles.CORNERS, dtype=float)[np.where(quad, corner, 0)].T
    expected = surface.normal(first + np.where(quad, 0, corner), u, v)
    assert np.abs(normals - expected).max() < 1e-12


@pytest.mark.parametrize(
    "name",
    ["stairs", "half_disk_2", "half_disk_4", "half_disk_5", "half_disk_7", "carved_cylinder"],
)
def test_limits_at_boundaries(name):
    """There is no normal at boundary vertices of 5 faces and more, and no limit under "none"."""
    points, faces = CAGES[name]
    mesh = ls.Mesh(zoo.random_points(len(points), name), faces)
    modes: list[Any] = [*oracles.MODES]
    for mode in modes:
        fine = ls.refined(mesh, 2, boundary=mode)
        odd = fine.boundary_vertex & (fine.vertex_faces >= 5)
        assert (np.isnan(fine.limit_points).any(axis=1) == (fine.vertex_faces == 0)).all()
        missing = np.isnan(fine.limit_normals).any(axis=1)
        assert missing.tolist() == odd[fine.indices].tolist()
    fine = ls.refined(mesh, 2, boundary="none")
    without = fine.boundary_vertex | (fine.vertex_faces == 0)
    assert (np.isnan(fine.limit_points[:, 0]) == without).all()
    touching = [fine.boundary_vertex[face].any() for face in fine.faces]
    coarse = [any(mesh.boundary_vertex[v] for v in faces[f]) for f in ancestor_faces(faces, 2)]
    missing = np.isnan(fine.limit_normals).any(axis=1).reshape(-1, 4).all(axis=1)
    assert (missing == np.array(touching) | coarse).all()


def ancestor_faces(faces, levels):
    """The cage's face that each refined face comes from."""
    return [f for f, face in enumerate(faces) for _ in range(len(face) * 4 ** (levels - 1))]


@pytest.mark.parametrize("name", ["cube", "carved_cube_2", "carved_cylinder"])
def test_holes_stay_holes(name):
    """They shape their neighbours as other faces do; only their own limits are left out."""
    points, faces = CAGES[name]
    whole = ls.refined(ls.Mesh(points, faces), 2)
    fine = ls.refined(ls.Mesh(points, faces, holes=[1, 3]), 2)
    assert (fine.points == whole.points).all()
    origin = ancestor_faces(faces, 2)
    assert fine.holes.tolist() == [k for k, f in enumerate(origin) if f in (1, 3)]
    hole = np.isin(origin, [1, 3])
    assert (np.isnan(fine.limit_normals).any(axis=1) == np.repeat(hole, 4)).all()
    # parents lie in faces with a limit wherever there is one
    numbering = ls.LimitSurface(ls.Mesh(points, faces)).limit_faces
    at_a_face = np.zeros(fine.n_vertices, dtype=bool)
    at_a_face[fine.uniform[~hole]] = True
    assert (np.isin(numbering.face[fine.parent_face], [1, 3]) == ~at_a_face).all()
    surface = ls.LimitSurface(ls.Mesh(points, faces, holes=[1, 3]))
    values = surface.evaluate(fine.parent_face, fine.parent_u, fine.parent_v)
    assert (np.isnan(values[:, 0]) == ~at_a_face).all()


def test_with_points_forgets_limits():
    points, faces = CAGES["carved_cube_3"]
    fine = ls.refined(ls.Mesh(points, faces), 1)
    first = fine.limit_points, fine.limit_normals
    other = fine.with_points(fine.points[:, [1, 2, 0]] * 2)
    assert np.abs(other.limit_points - first[0][:, [1, 2, 0]] * 2).max() < 1e-15
    assert np.abs(other.limit_normals - first[1][:, [1, 2, 0]]).max() < 1e-12
    assert (fine.limit_points == first[0]).all()
    assert (other.parent_face == fine.parent_face).all()


def test_normals_need_floats_in_space():
    points, faces = CAGES["cube"]
    for bad in (points[:, :2], fractions(points)):
        with pytest.raises(TypeError, match=r"points of shape \(n, 3\) .* got (float64|object)"):
            _ = ls.refined(ls.Mesh(bad, faces)).limit_normals


def test_far_from_the_origin():
    """Normals come from differences; limit positions lose no more than their own rounding."""
    points, faces = CAGES["carved_dodecahedron"]
    near, far = (ls.refined(ls.Mesh(points + shift, faces), 1) for shift in (0, 2.0**30))
    exact = ls.refined(ls.Mesh(fractions(far.points), far.faces), 0)
    assert np.abs(far.limit_points - exact.limit_points.astype(float)).max() <= 2.0**-20
    moved = ls.refined(ls.Mesh(points, faces), 1).with_points(far.points - 2.0**30)
    assert np.abs(far.limit_normals - moved.limit_normals).max() < 1e-12
    assert near.limit_normals.shape == far.limit_normals.shape


@pytest.mark.parametrize("name", ["cube", "torus_4x5", "carved_dodecahedron", "carved_cylinder"])
def test_refinement_converges(name):
    """The refined cage approaches the surface at the known rate; its limit points are on it."""
    points, faces = CAGES[name]
    surface = ls.LimitSurface(ls.Mesh(points, faces))
    table = ls.validate(surface, 4)
    assert table["level"].tolist() == [1, 2, 3, 4]
    assert (table["limit_error"] < 1e-14).all()
    assert (np.diff(table["error"]) < 0).all()
    fine = ls.refined(ls.Mesh(points, faces), 4)
    gap = surface.evaluate(fine.parent_face, fine.parent_u, fine.parent_v) - fine.points
    assert table["error"][3] == pytest.approx(np.linalg.norm(gap, axis=1).max())
    assert table["order"][1:] == pytest.approx(np.log2(table["error"][:-1] / table["error"][1:]))
    if name == "torus_4x5":
        assert table["order"][3] == pytest.approx(2, abs=0.05)


# --- The call


@pytest.mark.parametrize("levels", [-1, 1.0, "1", None, True])
def test_levels(levels):
    with pytest.raises(ValueError, match=f"levels must be an integer >= 0, got {levels!r}"):
        ls.refined(ls.Mesh(*CAGES["cube"]), levels)


def test_options():
    """The argument, else the mesh's, else the default; the refined mesh passes them on."""
    points, faces = CAGES["grid_1x1"]
    for of_mesh, argument, corners_stay in (
        (None, None, True),
        ("edge_only", None, False),
        ("edge_only", "edge_and_corner", True),
        ("edge_and_corner", "edge_only", False),
    ):
        mesh = ls.Mesh(points, faces, boundary=of_mesh)
        fine = ls.refined(mesh, boundary=argument)
        assert (fine.points[0] == points[0]).all() == corners_stay
        assert fine.boundary == (argument or of_mesh)
        again = ls.refined(fine)
        assert (again.points[0] == points[0]).all() == corners_stay
    mesh = ls.Mesh(points, faces)
    for option in ("boundary", "creasing", "triangles"):
        wrong: dict[str, Any] = {option: "odd"}
        with pytest.raises(ValueError, match=f"{option} must be one of .*, got 'odd'"):
            ls.refined(mesh, **wrong)
    with pytest.raises(ValueError, match="unknown scheme 'odd'; known: catmull-clark"):
        ls.refined(mesh, scheme="odd")
    for scheme in ("catmull-clark", tables.SCHEMES["catmull-clark"]):
        assert (ls.refined(mesh, scheme=scheme).points == ls.refined(mesh).points).all()


# --- The operator of exact numbers


def operator(dense):
    """An `ExactOperator` with the entries of a dense matrix, in any order."""
    dense = fractions(dense)
    r, c = (x.ravel()[::-1] for x in np.indices(dense.shape))
    return ls.ExactOperator(r, c, dense[r, c], dense.shape)


def test_operators_multiply():
    rng = np.random.default_rng(2)
    A, B = rng.integers(-3, 4, (3, 4)), rng.integers(-3, 4, (4, 5))
    product = operator(A) @ operator(B)
    assert isinstance(product, ls.ExactOperator)
    assert product.shape == (3, 5)
    assert (product.toarray() == A @ B).all()
    for shape in ((4,), (4, 1), (4, 2), (4, 2, 3), (4, 0)):
        X = rng.integers(-9, 9, shape)
        assert (operator(A) @ X == np.tensordot(A, X, 1)).all()
        assert (operator(A) @ X).shape == (3, *shape[1:])
    assert (operator(A) @ [0.5, 0.25, F(1, 3), 1]).tolist() == [
        F(int(6 * a + 3 * b + 4 * c + 12 * d), 12) for a, b, c, d in A
    ]
    for bad in (np.zeros(3), np.zeros((5, 4)), operator(A)):
        with pytest.raises(ValueError, match=r"shape \(3, 4\) cannot act on shape \([35]"):
            operator(A) @ bad


def test_operators_sum_what_is_given_twice():
    rows_, columns, values = np.array([1, 0, 1]), np.array([2, 1, 2]), fractions([1, 2, 3])
    twice = ls.ExactOperator(rows_, columns, values, (3, 3))
    assert twice.toarray().tolist() == [[0, 2, 0], [0, 0, 4], [0, 0, 0]]
    assert (twice.rows.tolist(), twice.columns.tolist()) == ([0, 1], [1, 2])
    assert twice.indptr.tolist() == [0, 1, 2, 2]
    assert (twice @ fractions([1, 1, 1])).tolist() == [2, 4, 0]
    assert repr(twice) == "<ExactOperator of shape (3, 3) with 2 entries>"
    none = np.zeros(0, dtype=np.int64)
    empty = ls.ExactOperator(none, none, none.astype(object), (0, 3))
    assert (empty @ np.ones((3, 2))).shape == (0, 2)
    assert (empty @ twice).shape == (0, 3)


def test_every_kind_of_vertex_is_tried():
    """Boundary fans, interior valences and face sizes that the zoo must hold."""
    fans, valences, sizes = set(), set(), set()
    for points, faces in CAGES.values():
        mesh = ls.Mesh(points, faces)
        fans |= set(mesh.vertex_faces[mesh.boundary_vertex].tolist())
        valences |= set(mesh.vertex_faces[~mesh.boundary_vertex].tolist())
        sizes |= set(mesh.sizes.tolist())
    assert fans >= {1, 2, 3, 4, 5, 6, 7}
    assert valences >= {0, 2, 3, 4, 5, 6, 7, 9, 12, 33, 64}
    assert sizes >= {3, 4, 5, 6, 7, 8, 12}


# --- what rounding and copying must not change ----------------------------------------------------

GRID = [[i, j, (i * 7 + j * 3) % 5 / 5] for j in range(5) for i in range(5)]
CELLS = [
    [j * 5 + i, j * 5 + i + 1, j * 5 + i + 6, j * 5 + i + 5] for j in range(4) for i in range(4)
]


@pytest.mark.parametrize(
    ("creases", "creasing"),
    [
        ({(12, 13): 0.8, (11, 12): 1.1, (7, 12): 0.6}, "chaikin"),
        ({(12, 13): 2.8000000000000003, (11, 12): 5.4, (7, 12): 2, (12, 17): 1}, "chaikin"),
        ({(12, 13): F(10) - F(1, 10**25)}, "uniform"),
        ({(12, 13): 1 + F(1, 10**25), (12, 11): F(1, 2)}, "uniform"),
    ],
)
def test_rounding_does_not_decide_about_rules(creases, creasing):
    """Where a sharpness just reaches 0 the rules jump: floats and Fractions agree about it."""
    surface = ls.LimitSurface(ls.Mesh(GRID, CELLS, creases=creases, creasing=creasing))
    for u, v in ((0.3, 0.2), (0.7, 0.9), (0.0, 0.0)):
        rough = surface.evaluate(np.arange(16), u, v)
        exact = surface.evaluate(np.arange(16), F(u), F(v))
        assert np.abs(rough - exact.astype(float)).max() <= 1e-14


def test_a_copy_of_a_refined_degenerate_mesh_is_connected_alike():
    mesh = ls.Mesh([[0, 0, 0], [3, 1, 0], [2, 5, 1], [-1, 4, 2]], [[2, 1, 1, 3], [0, 1, 2, 3]])
    fine = ls.refined(mesh)
    copy = pickle.loads(pickle.dumps(fine))
    assert copy.n_edges == fine.n_edges == 20
    assert (copy.twin == fine.twin).all()
    assert np.array_equal(copy.limit_points, fine.limit_points, equal_nan=True)


@pytest.mark.parametrize("exact", [False, True])
def test_vertices_carried_by_a_crease_that_does_not_bound_their_faces(exact):
    """Also where no faces at all lie between the two edges of the crease: only two shells, each
    with a flap of two faces at either edge."""
    flaps = [[0, 1, 5, 3], [0, 3, 6, 1], [0, 1, 7, 4], [0, 4, 8, 1]]
    flaps += [[0, 2, 10, 9], [0, 9, 11, 2], [0, 2, 13, 12], [0, 12, 14, 2]]
    points = np.random.default_rng(3).integers(-9, 9, (15, 3)).astype(float)
    for faces in (flaps, [[2, 0, 3], [0, 1, 2, 3], [3, 1, 2, 0], [0, 3, 2, 1]]):
        p = points[: 1 + max(map(max, faces))]
        if exact:
            p = np.vectorize(F)(p)
        mesh = ls.Mesh(p, faces)
        fine = ls.refined(mesh, 2)
        used = np.flatnonzero(fine.parent_face >= 0)
        place = fine.parent_face[used], fine.parent_u[used], fine.parent_v[used]
        found = ls.LimitSurface(mesh).evaluate(*place)
        gap = np.abs(found - fine.limit_points[used])
        assert gap.max() == 0 if exact else gap.max() < 1e-13
    assert "flap" in str(ls.LimitSurface(ls.Mesh(points, flaps)).patches.sectors)
    limit = (4 * points[0] + points[1] + points[2]) / 6
    found = ls.refined(ls.Mesh(points, flaps)).limit_points[0]
    np.testing.assert_allclose(found, limit, atol=1e-14)


@pytest.mark.parametrize("sharpness", [None, "2", Decimal("2.5"), 1j])
def test_sharpness_is_a_real_number(sharpness):
    with pytest.raises(TypeError, match="sharpness must be"):
        ls.Mesh(GRID, CELLS, creases={(12, 13): sharpness})


def test_what_a_mesh_keeps_follows_rules_and_is_not_pickled():
    points, faces, tags = zoo.TAGGED[next(iter(zoo.TAGGED))]()
    corners = sum(map(len, faces))
    channels = {"uv": (np.arange(corners) / 8.0, np.arange(corners), "corners_only")}
    mesh = ls.Mesh(points, faces, **tags, channels=channels)
    moved = mesh.points[::-1]
    options: Any
    for options in ({}, {"boundary": "edge_only"}, {"creasing": "chaikin"}, {}):
        fresh = ls.Mesh(points, faces, **tags, channels=channels)
        for _ in range(2):
            assert ls.refined(mesh, **options) == ls.refined(fresh, **options)
        again = ls.refined(mesh.with_points(moved), **options)
        assert again == ls.refined(fresh.with_points(moved), **options)
        assert again.channels["uv"][0].tolist() == ls.refined(mesh).channels["uv"][0].tolist()
    assert mesh._kept
    assert not pickle.loads(pickle.dumps(mesh))._kept
