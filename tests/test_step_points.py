"""Compiled refinement by schemes without polynomial pieces, against exact rows of NumPy's way."""

from fractions import Fraction as F

import numpy as np
import oracles_sqrt3
import pytest
from mpmath import cos, pi

import limitsurf as ls
from limitsurf import _kernels

TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
OCTAHEDRON = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4]])
OCTAHEDRON = np.vstack([OCTAHEDRON, np.where(OCTAHEDRON == 4, 5, OCTAHEDRON)[:, ::-1]])
TWO = np.vstack([TETRAHEDRON, np.where(TETRAHEDRON > 0, TETRAHEDRON + 3, 0)])
CAGES = {
    "closed": OCTAHEDRON,
    "open": OCTAHEDRON[:7],
    "bow": OCTAHEDRON[[0, 2, 4, 6]],
    "two fans at a vertex": TWO,
    "two fans at a vertex, one of them open": TWO[:7],
    "three faces at an edge": np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]]),
    "two faces on three vertices": np.array([[0, 1, 2], [2, 1, 0], [2, 3, 4]]),
}


@pytest.mark.parametrize("scheme", ["butterfly", "modified-butterfly"])
@pytest.mark.parametrize("name", CAGES)
def test_points_of_edges_are_those_of_fractions(scheme, name):
    faces = CAGES[name]
    points = np.random.default_rng(len(faces)).integers(-9, 10, (faces.max() + 1, 4))
    exact = ls.refined(ls.Mesh(points.astype(object) + F(0), faces), 2, scheme=scheme)
    for columns in (4, 1):
        with _kernels.chosen("compiled"):
            mesh = ls.Mesh(points[:, :columns].astype(float), faces)
            fine = ls.refined(mesh, 2, scheme=scheme)
        assert (fine.indices == exact.indices).all()
        assert np.abs(fine.points - exact.points[:, :columns].astype(float)).max() < 1e-14


@pytest.mark.parametrize("levels", [1, 2, 3])
@pytest.mark.parametrize("name", ["closed", "open"])
def test_middles_and_thirds_are_those_of_naive_refinement(name, levels):
    faces = CAGES[name]
    points = np.random.default_rng(7).integers(-9, 10, (6, 4))
    with _kernels.chosen("compiled"):
        fine = ls.refined(ls.Mesh(points.astype(float), faces), levels, scheme="sqrt3")
    own = [np.array([F(x) for x in p], dtype=object) for p in points.tolist()]
    naive, made = oracles_sqrt3.refined(own, faces.tolist(), levels, lambda n: cos(2 * pi / n))
    naive = np.array([[float(x) for x in p] for p in naive])
    place = np.abs(fine.points[:, None] - naive).max(axis=2).argmin(axis=1)
    assert sorted(place) == list(range(len(naive)))
    assert np.abs(fine.points - naive[place]).max() < 1e-14
    found = place[np.asarray(fine.faces)]
    assert {tuple(np.roll(f, -f.argmin())) for f in found} == {
        tuple(np.roll(f, -int(np.argmin(f)))) for f in made
    }


@pytest.mark.parametrize("scheme", ["modified-butterfly", "sqrt3"])
@pytest.mark.parametrize("name", CAGES)
def test_kernels_find_the_mesh_and_points_that_numpy_finds(scheme, name):
    faces = CAGES[name]
    points = np.random.default_rng(3).normal(size=(faces.max() + 1, 3))
    for levels in range(1, 5):
        found = []
        for how in ("reference", "compiled"):
            with _kernels.chosen(how):
                fine = ls.refined(ls.Mesh(points, faces), levels, scheme=scheme)
                found.append((fine.indices, fine.twin, fine.edges, fine.points))
        for one, other in zip(*(x[:3] for x in found), strict=True):
            assert (one == other).all()
        assert np.abs(found[0][3] - found[1][3]).max() < 2e-15


@pytest.mark.parametrize("scheme", ["butterfly", "modified-butterfly"])
def test_faces_with_a_vertex_twice_are_refined_alike(scheme):
    faces, found = [[0, 1, 2], [0, 2, 2], [2, 1, 3]], []
    for how in ("reference", "compiled"):
        with _kernels.chosen(how):
            mesh = ls.Mesh(np.arange(12.0).reshape(4, 3) ** 2, faces)
            found.append(ls.refined(mesh, 2, scheme=scheme))
    assert (found[0].indices == found[1].indices).all()
    assert np.abs(found[0].points - found[1].points).max() < 1e-13
