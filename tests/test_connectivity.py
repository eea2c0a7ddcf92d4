"""Compiled connectivity is what vectorised NumPy gives, integer for integer."""

import numpy as np
import pytest
import zoo
import zoo_triangles
from hypothesis import given, settings
from hypothesis import strategies as st

import limitsurf as ls
from limitsurf import Mesh
from limitsurf.cage.connectivity import Connectivity

NAMES = [
    *("offsets", "corner_face", "next_corner", "previous_corner", "separate", "twin", "edges"),
    *("corner_edge", "edge_corners", "edge_faces", "boundary_edge", "nonmanifold_edge"),
    *("boundary_vertex", "nonmanifold_vertex", "vertex_faces", "valences", "repeats"),
    *("ring_offsets", "ring_position", "ring_corners"),
]
FANS = ["vertex", "closed", "offsets", "corners", "fan", "position"]


def both(make):
    """What a function gives with kernels and without."""
    results = []
    for compiled in (True, False):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Connectivity, "compiled", compiled)
            results.append(make())
    return results


def connectivity(points, faces):
    cage = Mesh(points, faces).connectivity
    arrays = {name: getattr(cage, name) for name in NAMES}
    again = Mesh(points, faces).connectivity  # twins come with edges that are asked for first
    for name in ("edges", "corner_edge", "edge_corners", "twin", "valences"):
        arrays[f"{name}, in another order"] = getattr(again, name)
        assert np.array_equal(getattr(again, name), arrays[name]), name
    return arrays | {f"fans.{name}": getattr(cage.fans, name) for name in FANS}


def assert_same(one, other):
    assert one.keys() == other.keys()
    for name, array in one.items():
        if np.asarray(array).dtype == float:
            assert np.allclose(array, other[name]), name
        else:
            assert np.array_equal(array, other[name]), name
        assert np.asarray(array).dtype == np.asarray(other[name]).dtype, name


@pytest.mark.parametrize("name", zoo.ZOO)
def test_zoo(name):
    assert_same(*both(lambda: connectivity(*zoo.ZOO[name]())))


@pytest.mark.parametrize("name", zoo.NONMANIFOLD)
def test_nonmanifold(name):
    assert_same(*both(lambda: connectivity(*zoo.NONMANIFOLD[name][:2])))


@settings(deadline=None)
@given(zoo.cages(operations=[*zoo.OPERATIONS, zoo.insert_vertex], keep=lambda faces: True))
def test_random_cages(cage):
    assert_same(*both(lambda: connectivity(*cage)))


@settings(deadline=None)
@given(st.lists(st.lists(st.integers(0, 6), min_size=3, max_size=5), min_size=1, max_size=9))
def test_any_faces(faces):
    assert_same(*both(lambda: connectivity(np.zeros((7, 3)), faces)))


@pytest.mark.parametrize("size", [3, 4])
def test_any_faces_of_one_size(size):
    @settings(deadline=None)
    @given(st.lists(st.permutations(range(7)).map(lambda p: p[:size]), min_size=1, max_size=9))
    def any_faces(faces):
        assert_same(*both(lambda: connectivity(np.zeros((7, 3)), np.array(faces))))

    any_faces()


def test_a_pole_and_fans_of_one_vertex():
    """Sorting many neighbours, and fans that are found out of order."""
    n = 700
    spokes = 1 + np.random.default_rng(0).permutation(n)
    faces = np.stack([np.zeros(n, int), spokes, np.roll(spokes, -1)], axis=1)
    for kept in (faces, faces[::2], np.delete(faces, [3, 4, 99, 500], axis=0)):
        assert_same(*both(lambda kept=kept: connectivity(np.zeros((n + 1, 3)), kept)))


def patches(points, faces, **tags):
    """All that a patch table holds, in arrays."""
    table = ls.LimitSurface(Mesh(points, faces, **tags)).patches
    arrays = {
        name: getattr(table, name)
        for name in ("codes", "kind", "row", "turn", "sharpness", "n_points")
    }
    arrays |= {f"controls[{k}]": control for k, control in enumerate(table.controls)}
    arrays |= {f"sectors[{k}]": str(sector) for k, sector in enumerate(table.sectors)}
    return arrays | {f"extras[{k}]": rows.toarray() for k, rows in enumerate(table.extras)}


CAGES = {name: lambda name=name: (*zoo.ZOO[name](), {}) for name in zoo.ZOO}
CAGES |= {name: lambda name=name: (*zoo.NONMANIFOLD[name][:2], {}) for name in zoo.NONMANIFOLD}
CAGES |= {name: zoo.TAGGED[name] for name in zoo.TAGGED}


@pytest.mark.parametrize("name", CAGES)
def test_patches(name):
    points, faces, tags = CAGES[name]()
    assert_same(*both(lambda: patches(points, faces, **tags)))


TRIANGLES = {name: lambda name=name: (*zoo_triangles.ZOO[name](), {}) for name in zoo_triangles.ZOO}
TRIANGLES |= {
    name: lambda name=name: (*zoo_triangles.NONMANIFOLD[name]()[:2], {})
    for name in zoo_triangles.NONMANIFOLD
}
TRIANGLES |= zoo_triangles.TAGGED


@pytest.mark.parametrize("name", TRIANGLES)
def test_patches_of_triangles(name):
    points, faces, tags = TRIANGLES[name]()
    assert_same(*both(lambda: patches(points, faces, scheme="loop", **tags)))


@settings(deadline=None)
@given(zoo.tagged_cages())
def test_patches_of_random_cages(cage):
    points, faces, tags = cage
    assert_same(*both(lambda: patches(points, faces, **tags)))
