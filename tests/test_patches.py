"""The patch table: integers once, whatever numbers are asked for.

A table that is built for Fractions from the start is the oracle of one that shares its integers.
"""

import functools
import math
import pickle
import random
from fractions import Fraction as F

import numpy as np
import oracles_creases
import oracles_loop
import pytest
import zoo
import zoo_triangles
from hypothesis import given, settings
from oracles_creases import Cage

import limitsurf as ls
from limitsurf import numbers
from limitsurf.patches import STRIP, PatchTable, level
from limitsurf.rules import Rules
from limitsurf.scheme.loop import LOOP, LOOP_WARREN

INTEGERS = ["codes", "kind", "row", "turn", "sectors", "controls", "rings", "n_points"]
TINY = F(1, 10**20)
# sharpness that float64 rounds, also to another number of levels, beside some that it does not
SHARPNESSES = {
    "less_than_1": [1 - TINY],
    "more_than_1": [1 + TINY],
    "next_to_2": [2 - TINY, 2 + TINY, 2],
    "thirds": [F(1, 3), F(4, 3)],
    "smallest": [5e-324, 1 - 2.0**-53, 1],
    "mixed": [0.3, 7, 1 + TINY, math.inf],
}


def mesh_of(points, faces, tags=None, **options):
    return ls.Mesh(np.array(points, dtype=float), faces, **(tags or {}), **options)


def tagged(made, sharpness, seed, **options):
    """A cage with a third of its edges and some vertices tagged."""
    (points, faces), rng = made, random.Random(seed)
    mesh = mesh_of(points, faces)
    edges = rng.sample(mesh.edges.tolist(), len(mesh.edges) // 3)
    corners = rng.sample(range(mesh.n_vertices), mesh.n_vertices // 6)
    tags = {
        "creases": {tuple(edge): rng.choice(sharpness) for edge in edges},
        "corners": {corner: rng.choice(sharpness) for corner in corners},
    }
    return mesh_of(points, faces, tags, **options)


def assert_shared(mesh, scheme=None):
    """Return the table for Fractions, which is what it would be if it were built for them."""
    rules = Rules.resolve(mesh, scheme)
    table = PatchTable(mesh, rules, numbers.FLOAT64)
    wanted = PatchTable(mesh, rules, numbers.RATIONAL)
    found = table.typed(mesh, rules, numbers.RATIONAL)
    assert all(getattr(found, name) is getattr(table, name) for name in INTEGERS)
    assert_equal(found, wanted)
    return found


def assert_equal(found, wanted):
    for name in ("codes", "kind", "row", "turn"):
        assert (getattr(found, name) == getattr(wanted, name)).all()
    assert found.sectors == wanted.sectors
    pairs = list(zip(found.controls, wanted.controls, strict=True))
    assert found.rings.keys() == wanted.rings.keys()
    pairs += [(found.rings[kind].points, wanted.rings[kind].points) for kind in found.rings]
    assert all((one == other).all() for one, other in pairs)
    assert found.sharpness.tolist() == wanted.sharpness.tolist()
    for one, other in zip(found.extras, wanted.extras, strict=True):
        assert one.shape == other.shape
        assert (one.rows == other.rows).all()
        assert (one.columns == other.columns).all()
        assert all(type(x) is F for x in one.values)
        assert (one.values == other.values).all()


QUADS = {
    **{name: zoo.ZOO[name] for name in ("cube", "tetrahedron", "prism_7", "grid_3x3")},
    "crossed_grids": lambda: zoo.NONMANIFOLD["crossed_grids"][:2],
    "shared_ring": lambda: zoo.flower(70, 1),
    "sharp_shared_ring": lambda: (*zoo.half_disk(70), {"boundary": "edge_only"}),
    **{name: zoo.TAGGED[name] for name in list(zoo.TAGGED)[::4]},
}
TRIANGLES = {
    name: (zoo_triangles.ZOO | zoo_triangles.TAGGED)[name]
    for name in ("octahedron", "crowded", "grid_4x4", "fan_7", "crease_2_of_6", "cone_5", "dart_6",
                 "semi_2.5", "semi_corner", "chaikin", "tagged_sphere_0", "tagged_patch_1", "holes")
}  # fmt: skip


@pytest.mark.parametrize("name", QUADS)
def test_quads(name):
    assert_shared(mesh_of(*QUADS[name]()))


@pytest.mark.parametrize("scheme", [LOOP, LOOP_WARREN], ids=lambda scheme: scheme.name)
@pytest.mark.parametrize("name", TRIANGLES)
def test_triangles(scheme, name):
    mesh = mesh_of(*TRIANGLES[name]())
    try:
        assert_shared(mesh, scheme)
    except TypeError:  # Fractions are refused alike
        assert scheme is not LOOP_WARREN
        surface = ls.LimitSurface(mesh, scheme=scheme)
        with pytest.raises(TypeError, match="irrational"):
            surface.weights(0, F(1, 3), F(1, 3))


@pytest.mark.parametrize("creasing", ["uniform", "chaikin"])
@pytest.mark.parametrize("sharpness", SHARPNESSES)
def test_sharpness_that_float64_rounds(sharpness, creasing):
    """No rounding decides what is a patch, nor which control points these need."""
    cages = [(None, zoo.grid(3, 3)), (None, zoo.prism(5))]
    cages += [(LOOP_WARREN, zoo_triangles.ZOO[name]()) for name in ("grid_3x2", "crowded")]
    for seed, (scheme, made) in enumerate(cages):
        assert_shared(tagged(made, SHARPNESSES[sharpness], seed, creasing=creasing), scheme)


@settings(max_examples=8)
@given(zoo.tagged_cages())
def test_random_cages(cage):
    assert_shared(mesh_of(*cage))


@pytest.mark.parametrize("sharpness", [1 - TINY, 1 + TINY, F(7, 3)])
@pytest.mark.parametrize("creasing", ["uniform", "chaikin"])
def test_values(sharpness, creasing):
    """What the table for Fractions gives is what naive recursion gives."""
    cases = [
        (zoo.grid(3, 3), None, oracles_creases.TaggedSurface),
        (zoo_triangles.ZOO["grid_3x2"](), "loop", oracles_loop.LoopSurface),
    ]
    for (points, faces), scheme, oracle in cases:
        mesh = tagged((points, faces), [sharpness], 3, creasing=creasing)
        exact = numbers.RATIONAL.array(mesh.points)
        edges, creases = mesh.creases
        tags = {
            "creases": {tuple(e): s for e, s in zip(edges.tolist(), creases, strict=True)},
            "corners": dict(zip(mesh.corners[0].tolist(), mesh.corners[1], strict=True)),
            "creasing": creasing,
        }
        surface = ls.LimitSurface(mesh, scheme=scheme)
        naive = oracle(Cage([tuple(p) for p in exact], [list(map(int, f)) for f in faces], **tags))
        for face in range(0, len(surface.limit_faces), 2):
            for nu in [(0, 0), (2, 1)]:
                query = face, F(1, 2**6), F(1, 3 * 2**6)
                assert list(surface.evaluate(*query, nu=nu)) == list(naive.evaluate(*query, nu))


def test_built_once(monkeypatch):
    """However it is asked, also after a journey."""
    built = []
    monkeypatch.setattr(PatchTable, "_build", counting(PatchTable._build, built))
    surface = ls.LimitSurface(mesh_of(*zoo.TAGGED["crossed_grid_2.5"]()))
    half = F(1, 2)
    surface.evaluate(0, half, half)
    surface.evaluate(0, 0.5, 0.5)
    surface.weights(0, half, half)
    other = surface.with_points(numbers.RATIONAL.array(surface.points) / 3)
    ls.bezier_patches(other, weights=True)
    there = pickle.loads(pickle.dumps(other))
    assert (there.evaluate(3, half, half / 3) == other.evaluate(3, half, half / 3)).all()
    assert len(built) == 1
    tables = there.topology.patches, there.topology.exact_groups.patches
    assert tables[0].codes is tables[1].codes
    assert (tables[0].kind == STRIP).any()
    assert tables[0].extras[0].shape == tables[1].extras[0].shape


def counting(method, calls):
    @functools.wraps(method)
    def counted(*given):
        calls.append(given)
        return method(*given)

    return counted


def test_replayed_once(monkeypatch):
    """Fractions refine what is split, and no mesh more."""
    made, asked = [], []
    mesh = mesh_of(*zoo.TAGGED["crossed_grid_2.5"]())
    rules = Rules.resolve(mesh)
    table = PatchTable(mesh, rules, numbers.FLOAT64)
    for name, calls in (("child_mesh", made), ("stage_rows", asked)):
        monkeypatch.setattr(level, name, counting(getattr(level, name), calls))
    table.typed(mesh, rules, numbers.RATIONAL)
    assert len(asked) == len(table._splits) == len(made) + 1 == 3
