"""Compiled refinement against its NumPy twin, which the oracles judge in other files."""

import copy
import pickle
import weakref

import numpy as np
import pytest
import zoo
from hypothesis import given

import limitsurf as ls
from limitsurf import _kernels
from limitsurf.cage.mesh import Mesh
from limitsurf.refine.rings import Rings
from limitsurf.scheme.lattice import QUADS
from limitsurf.topology import child_mesh

NAMES = sorted(zoo.ZOO) + sorted(zoo.TAGGED)
over_the_zoo = pytest.mark.parametrize("name", NAMES)
CONNECTIVITY = (
    "edges",
    "corner_edge",
    "edge_corners",
    "twin",
    "vertex_faces",
    "boundary_edge",
    "boundary_vertex",
    "nonmanifold_edge",
    "nonmanifold_vertex",
    "separate",
    "offsets",
    "corner_face",
    "next_corner",
    "previous_corner",
)


def cage(name, boundary=None):
    """A new mesh of the zoo in float64: nothing is cached."""
    points, faces, tags = (*zoo.ZOO[name](), {}) if name in zoo.ZOO else zoo.TAGGED[name]()
    points = zoo.random_points(len(points), name)
    options = {} if boundary is None else {"boundary": boundary}
    return ls.Mesh(np.asarray(points, dtype=float), faces, **(tags | options))


def close(one, other, size=1.0):
    """Whether arrays agree to rounding, and about what is NaN."""
    same = np.array_equal(np.isnan(one), np.isnan(other))
    return same and np.nanmax(np.abs(one - other), initial=0) <= 4e-15 * size


@over_the_zoo
def test_refinement_is_the_same(name, use):
    """Points, faces, tags, parents, operator."""
    use(False)
    plain, R = ls.refined(cage(name), 2, operator=True)
    use(True)
    fine, S = ls.refined(cage(name), 2, operator=True)
    assert close(fine.points, plain.points)
    assert (fine.indices == plain.indices).all()
    for one, other in ((fine.creases, plain.creases), (fine.corners, plain.corners)):
        assert (one[0] == other[0]).all()
        assert (one[1] == other[1]).all()
    assert (fine.holes == plain.holes).all()
    assert (fine.parent_face == plain.parent_face).all()
    assert np.array_equal(fine.parent_u, plain.parent_u, equal_nan=True)
    assert np.array_equal(fine.parent_v, plain.parent_v, equal_nan=True)
    assert np.abs(R - S).max() <= 1e-15
    assert S.has_sorted_indices
    assert S.has_canonical_format
    assert close(S @ cage(name).points, fine.points)
    for channel in plain.channels:
        assert close(fine.channels[channel][0], plain.channels[channel][0])
        assert (fine.channels[channel][1] == plain.channels[channel][1]).all()


@over_the_zoo
@pytest.mark.parametrize("kernels", [False, True])
def test_children_are_connected_as_if_they_were_new(name, kernels, use):
    """Also in copies; where half-edges have edges of their own, only by what is inherited."""
    use(kernels)
    mesh = cage(name)
    fine = ls.refined(mesh, 2)
    alike = [pickle.loads(pickle.dumps(fine)), copy.deepcopy(fine), fine.with_points(fine.points)]
    if not mesh.separate.any():
        use(False)
        alike.append(Mesh(fine.points, (fine.sizes, fine.indices)))
    for member in CONNECTIVITY:
        for other in alike:
            assert np.array_equal(getattr(fine, member), getattr(other, member)), member


@over_the_zoo
def test_limits_are_the_same(name, use):
    boundary = ("none", "edge_only")[len(name) % 2]  # each on half of the cages
    use(False)
    plain = ls.refined(cage(name, boundary))
    expected = plain.limit_points, plain.limit_normals
    use(True)
    fine = ls.refined(cage(name, boundary))
    assert close(fine.limit_points, expected[0])
    assert np.array_equal(np.isnan(fine.limit_normals), np.isnan(expected[1]))
    assert np.nanmax(np.abs(fine.limit_normals - expected[1]), initial=0) <= 1e-11


@pytest.mark.parametrize("scale", [1e-300, 1e-80, 1e80, 1e300])
def test_normals_at_any_scale(scale, use):
    """Kernels leave the extremes to the reference."""
    use(True)
    fine = ls.refined(cage("unequal_ring"))
    scaled = fine.with_points(scale * fine.points)
    assert close(scaled.limit_normals, fine.limit_normals)
    assert close(scaled.limit_points / scale, fine.limit_points)


def test_masks_are_kept_and_hold_no_points(use):
    use(True)
    fine = ls.refined(cage("unequal_ring"))
    expected = fine.limit_points, fine.limit_normals
    other, points = fine.with_points(2 * fine.points), weakref.ref(fine.points.base)
    known = {name: id(masks) for name, (_, masks) in vars(other)["_kept"].items()}
    assert (other.limit_points == 2 * expected[0]).all()
    assert np.array_equal(other.limit_normals, expected[1], equal_nan=True)
    assert {"limit masks", "normal masks"} <= set(known)
    assert known == {name: id(masks) for name, (_, masks) in vars(other)["_kept"].items()}
    del fine
    assert points() is None


@pytest.mark.parametrize("triangles", ["smooth", "catmull-clark"])
@pytest.mark.parametrize("shape", [(), (1,), (2,), (5,), (2, 2)])
def test_any_number_of_channels(triangles, shape, use):
    points, faces = zoo.ZOO["octahedron"]()
    points = np.random.default_rng(3).random((len(points), *shape))
    mesh = ls.Mesh(points, faces, triangles=triangles)
    use(False)
    plain = ls.refined(mesh, 2)
    use(True)
    fine = ls.refined(mesh, 2)
    assert fine.points.shape == plain.points.shape
    assert close(fine.points, plain.points)
    assert close(fine.limit_points, plain.limit_points)


@given(cage=zoo.tagged_cages())
def test_random_cages(cage):
    found = []
    for engine in ("reference", "compiled"):
        points, faces, tags = cage
        mesh = ls.Mesh(np.asarray(points, dtype=float), faces, **tags)
        with _kernels.chosen(engine):
            fine, R = ls.refined(mesh, 2, operator=True)
            found.append((fine.points, R.toarray(), fine.limit_points))
            if not mesh.separate.any():
                assert (fine.twin == Mesh(fine.points, (fine.sizes, fine.indices)).twin).all()
    size = max(1, np.abs(found[0][0]).max())
    for one, other in zip(*found, strict=True):
        assert close(one, other, size)


@pytest.mark.parametrize("name", ["cube", "unequal_ring"])
def test_refinements_of_one_topology_share_it(name, use):
    """As long as one is alive; then the memory is free again."""
    use(True)
    mesh = cage(name)
    one = ls.refined(mesh, 2)
    other = ls.refined(mesh.with_points(2 * mesh.points), 2)
    assert np.shares_memory(one.indices, other.indices)
    assert other.connectivity is one.connectivity
    assert (other.points == 2 * one.points).all()
    assert list(mesh.connectivity.children) == ["quads"]
    del one, other
    assert not list(mesh.connectivity.children)
    again, fresh = ls.refined(mesh, 2), ls.refined(cage(name), 2)
    assert (again.indices == fresh.indices).all()
    assert (again.points == fresh.points).all()
    assert (again.creases[1] == fresh.creases[1]).all()


def test_points_of_a_cage_are_not_kept_alive():
    mesh = cage("cube")
    children, points = child_mesh(mesh, np.zeros((26, 3)), QUADS), weakref.ref(mesh.points.base)
    assert points() is not None
    del mesh
    assert points() is None
    assert (children.twin >= 0).all()


def test_many_faces_at_a_pole(use):
    """A vertex is moved by the sum of small steps, not rounded at each of them."""
    n = 360
    angle = np.arange(n) * (2 * np.pi / n)
    rim = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    points = np.concatenate([[[0.1, 0.2, 1.0]], rim, 2 * rim])
    ring = np.arange(n)
    after = (ring + 1) % n
    faces = [[0, 1 + i, 1 + j] for i, j in zip(ring, after, strict=True)]
    faces += [[1 + i, 1 + n + i, 1 + n + j, 1 + j] for i, j in zip(ring, after, strict=True)]
    mesh = ls.Mesh(points, faces)
    exact = ls.Mesh(mesh.points.astype(object), faces)
    use(True)
    error = ls.refined(mesh).points - ls.refined(exact).points.astype(float)
    assert np.abs(error).max() <= 1e-15


@pytest.mark.parametrize("whole", [True, False])
def test_rings_refine_as_whole_meshes_do(whole, use, monkeypatch):
    """Limits at semi-sharp vertices of valence 3 to 5, by their rings and by all that is near."""
    rng = np.random.default_rng(7)
    points, faces = zoo.ZOO["cube"]()
    mesh = ls.refined(ls.Mesh(zoo.random_points(len(points), "cube"), [*faces[:-1], faces[-1][:3]]))
    edges, vertices = rng.choice(mesh.n_edges, 30, False), rng.choice(mesh.n_vertices, 6, False)
    sharpness, corners = rng.integers(1, 5, 30) * 1.0, rng.integers(1, 4, 6) * 1.0
    if not whole:
        sharpness, corners = sharpness - rng.random(30), corners - rng.random(6)
    tags = {"creases": (mesh.edges[edges], sharpness), "corners": (vertices, corners)}
    use(True)

    def limits(level):
        fine = ls.refined(ls.Mesh(mesh.points, mesh.faces, **tags), level)
        return fine.limit_points, fine.limit_normals

    found = [limits(level) for level in range(3)]
    use(False)
    others = [limits(level) for level in range(3)]
    use(True)
    met: list[Rings] = []
    of = Rings.of

    def none(*given):
        met.extend(of(*given))
        return ()

    monkeypatch.setattr(Rings, "of", none)
    for level, (point, normal) in enumerate(found):
        one, other = limits(level)
        assert close(point, one)
        assert close(normal, other)
        assert close(point, others[level][0])
        assert close(normal, others[level][1], 100)
    assert {rings.edges.shape[1] for rings in met} >= {3, 4}
