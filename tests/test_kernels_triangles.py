"""Compiled evaluation of surfaces of triangles, against its NumPy twin and exact numbers.

Twins may differ by rounding: a position by 1e-14 of the size of the cage, a derivative by 1e-12 of
the largest of its order there and by what 1e-14 of the size makes of it, where the patch is as many
halvings within its face.
"""

import itertools
import math
from fractions import Fraction as F

import numpy as np
import oracles_loop
import pytest
import zoo_triangles
from oracles_creases import Cage
from test_kernels import EDGES, NEAR, TERMS, alone

import limitsurf as ls
from limitsurf import _kernels
from limitsurf._kernels import evaluation, reference, triangles
from limitsurf.engine import packing
from limitsurf.numbers import FLOAT64
from limitsurf.patches import PatchTable
from limitsurf.scheme.lattice import TRIANGLES
from limitsurf.scheme.loop import LOOP
from limitsurf.scheme.spline import BICUBIC, QUARTIC, Spline

# cages with all kinds of patches: regular, cut, boundaries, creases, corners, darts, cones
SAMPLE = [
    "torus_5x4", "bipyramid_12", "sphere_1", "fan_5", "patch_1", "crease_1_of_6", "corner_1_and_5",
    "cone_5", "dart_5", "semi_2.5", "holes", "tagged_patch_0", "tagged_sphere_1",
]  # fmt: skip


def surface_of(name):
    points, faces, *tags = {**zoo_triangles.ZOO, **zoo_triangles.TAGGED}[name]()
    mesh = ls.Mesh(np.array(points, dtype=float), faces, **dict(*tags))
    return ls.LimitSurface(mesh, scheme=LOOP)


def queries(surface, n, rng, near=(*NEAR, 1e-60, 1e-100, 2.0**-300)):
    """Anywhere, dyadic, on sides and lines between pieces, and at corners and close to them."""
    kind, turn = rng.integers(5, size=n), rng.integers(3, size=n)
    (a, b), (i, j) = rng.random((2, n)), rng.integers(65, size=(2, n)) / 64
    c, d = rng.choice(near, (2, n))
    u = np.choose(kind, [a, i, c, c, c])
    v = np.choose(kind, [b, j, d, c * b, 0 * b])
    over = u + v > 1
    u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    w = reference.coordinates(u, v, TRIANGLES.sides)[2]
    u, v = np.choose(turn, [u, v, w]), np.choose(turn, [v, w, u])
    return rng.integers(len(surface.limit_faces), size=n), u, v


def assert_close(found, expected, order, size, depth=0):
    """Derivatives of an order, (terms, Q, d)."""
    assert (np.isnan(found) == np.isnan(expected)).all()
    largest = np.abs(np.where(np.isfinite(expected), expected, 0)).max(axis=(0, 2))
    with np.errstate(invalid="ignore", over="ignore"):
        allowed = 1e-12 * largest * (order > 0) + 1e-14 * size * 2.0 ** (order * depth)
        fine = np.abs(found - expected) <= allowed[:, None]
    fine |= np.isnan(expected) | (found == expected)
    assert fine.all(), (found[~fine][:3], expected[~fine][:3])


def of_order(order, derivative):
    """All derivatives of an order, (terms, ...)."""
    return np.stack([derivative(nu) for nu in TERMS if sum(nu) == order])


@pytest.mark.filterwarnings("ignore:.* has no tangent plane")
@pytest.mark.parametrize("name", SAMPLE)
def test_cages(name, use):
    """Derivatives, jets, normals and weights at parameters of every kind."""
    surface, rng = surface_of(name), np.random.default_rng(len(name))
    query = queries(surface, 300, rng)
    query[1][3], query[2][7], query[1][11] = np.nan, np.inf, -np.inf
    size = np.ptp(surface.points, axis=0).max()
    there = np.isfinite(query[1]) & np.isfinite(query[2])
    depth = np.zeros(len(there), dtype=int)
    depth[there] = surface.patches.locate(*(x[there] for x in query))[3]
    use(False)
    expected = [of_order(k, lambda nu: surface.evaluate(*query, nu=nu)) for k in range(3)]
    rows = [surface.weights(*query, nu=nu).toarray() for nu in TERMS]
    higher, twin = surface.jet(*query, order=5), surface.normal(*query)
    use(True)
    more = surface.jet(*query, order=5, workers=2)
    for order in (3, 4, 5):
        given, wanted = (
            np.stack([jet[order - j, j] for j in range(order + 1)]) for jet in (more, higher)
        )
        assert_close(given, wanted, order, 8 * size, depth)
    every = surface.jet(*query, order=2)
    for order, wanted in enumerate(expected):
        for derivative in (lambda nu: surface.evaluate(*query, nu=nu), every.__getitem__):
            assert_close(of_order(order, derivative), wanted, order, size, depth)
    normals = surface.normal(*query)
    assert (np.isnan(normals) == np.isnan(twin)).all()
    assert np.nanmax(np.abs(normals - twin)) < 1e-12
    known = dict(zip(TERMS, rows, strict=True))
    found = {nu: surface.weights(*query, nu=nu, workers=2) for nu in TERMS}
    assert all(W.has_canonical_format for W in found.values())
    for order in range(3):
        given = of_order(order, lambda nu: found[nu].toarray())
        assert_close(given, of_order(order, known.__getitem__), order, 10, depth)


@pytest.mark.parametrize("name", SAMPLE[::3])
def test_grids(name, use, monkeypatch):
    monkeypatch.setattr(packing, "_FACES", 1)  # also cages of few faces
    surface = surface_of(name)
    n = len(surface.limit_faces)
    face = np.random.default_rng(n).integers(n, size=12)[:, None]
    places = [(i / 8, j / 8) for i in range(9) for j in range(9 - i)] + [(1e-9, 1e-3), (0.3, 0.7)]
    u, v = np.array(places).T
    flat = [x.reshape(-1).copy() for x in np.broadcast_arrays(face, u, v)]
    use(True)
    for nu in TERMS:
        grid, alone = (
            surface.evaluate(face, u, v, nu=nu).reshape(-1, 3),
            surface.evaluate(*flat, nu=nu),
        )
        assert (np.isnan(grid) == np.isnan(alone)).all()
        size = np.nanmax(np.abs(alone), initial=np.ptp(surface.points))
        assert np.nanmax(np.abs(grid - alone)) <= 1e-13 * size
    found, alone = surface.normal(face, u, v).reshape(-1, 3), surface.normal(*flat)
    differ = (np.isnan(found) != np.isnan(alone)).any(axis=1)
    assert not differ.any(), [x[differ][:3] for x in (*flat, found, alone)]
    assert np.nanmax(np.abs(found - alone)) < 1e-12


@pytest.mark.parametrize("name", ["octahedron", "tetrahedron", "fan_2", "crease_1_of_6"])
def test_accuracy_next_to_corners(name, use):
    """Positions and derivatives against exact ones of naive refinement, down to 2^-900."""
    cage = {**zoo_triangles.ZOO, **zoo_triangles.TAGGED}[name]()
    surface, oracle = surface_of(name), oracles_loop.LoopSurface(Cage(*cage[:2], **dict(*cage[2:])))
    size = np.ptp(surface.points, axis=0).max()
    use(True)
    for level, (s, t) in itertools.product((2, 40, 900), ((3, 4), (8, 0), (1, 6), (4, 4))):
        unit, face = F(1, 2**level), level % len(surface.limit_faces)
        u, v = s * unit / 8, t * unit / 8
        for order in range(3 if level < 900 else 2):
            terms = [nu for nu in TERMS if sum(nu) == order]
            exact = np.array([oracle.evaluate(face, u, v, nu) for nu in terms])
            found = np.array([surface.evaluate(face, float(u), float(v), nu=nu) for nu in terms])
            error = max(abs(F(x) - y) for x, y in zip(found.ravel(), exact.ravel(), strict=True))
            largest = np.abs(exact).max()
            assert error <= (F(1e-12) * largest if order else F(1e-14 * size))


def test_workers_change_nothing(use):
    surface = surface_of("tagged_sphere_1")
    query = queries(surface, 2 * packing.CHUNK + 5, np.random.default_rng(0))
    use(True)
    alone, several = (surface.jet(*query, order=1, workers=n) for n in (1, 3))
    assert all(alone[nu].tobytes() == several[nu].tobytes() for nu in alone)


@pytest.mark.parametrize(("u", "v"), [(-0.1, 0.5), (0.6, 0.41), (0.5, 0.5 + 1e-14), (1.5, 0)])
def test_outside(u, v, use):
    surface = surface_of("torus_5x4")
    use(True)
    with pytest.raises(ValueError, match="outside"):
        surface.evaluate([0, 1], [0.2, u], [0.2, v])
    with pytest.raises(IndexError):
        surface.evaluate([0, len(surface.limit_faces)], 0.2, 0.2)
    # rounding may take u + v over 1 by a few units in the last place
    found = surface.evaluate([0, 0], [0.7, 0.7], [0.3 + 2.0**-53, np.nextafter(0.3, 1)])
    assert np.abs(found - surface.evaluate(0, 0.7, 0.3)).max() < 1e-14


def test_what_kernels_know():
    assert _kernels.shape(BICUBIC.directions) == "quads"
    assert _kernels.shape(QUARTIC.directions[::-1]) == "triangles"
    assert _kernels.shape(Spline("linear", ((1, 0), (0, 1), (1, 1)), (0.3, 0.2)).directions) is None


# --- Kernels and their twins


def test_weights_of_the_spline():
    """Against its polynomials: exactly in Fractions, in float64 to rounding."""
    places = [(F(1, 3), F(1, 5)), (F(3, 7), F(2, 5)), (F(0), F(0)), (F(1), F(0)), (F(0), F(1, 2))]
    found, rounded = np.empty(72, dtype=object), np.empty(72)
    for s, t in places:
        triangles.spline_weights.py_func(s, t, 2, found)  # type: ignore[attr-defined]
        alone(triangles.spline_weights)(float(s), float(t), 2, rounded)
        for k, (i, j) in enumerate(TERMS):
            powers = [
                math.perm(e, i) * math.perm(f, j) * s ** max(e - i, 0) * t ** max(f - j, 0)
                for e, f in QUARTIC.exponents
            ]
            exact = 12 * np.array(powers) @ np.array(QUARTIC.pieces)
            assert (found[12 * k : 12 * k + 12] == exact).all()
            error = np.abs(rounded[12 * k : 12 * k + 12] - exact.astype(float)).max()
            assert error <= 12 * 4e-16 * 4 ** (i + j)


def test_orientations():
    """What the lattice says of turns, in the order of `LimitSurface.jet`."""
    for (k, nu), orientation in itertools.product(enumerate(TERMS), range(6)):
        row = triangles.TURNED[orientation, k]
        expected = {TERMS.index(order): x[orientation] for order, x in TRIANGLES.turned(nu).items()}
        assert row.tolist() == [expected.get(j, 0) for j in range(6)]
        s, t = 0.25, 0.625
        sides = [s, t, 0.125]
        place = sides[orientation % 3], sides[(orientation + 1) % 3]
        assert alone(triangles.turned)(s, t, orientation) == place
    taken = [[piece.place(near) for near in TRIANGLES.template] for piece in TRIANGLES.pieces]
    places = sorted({place for piece in taken for place in piece})
    assert len(places) == triangles.REFINED
    assert triangles.PIECES.tolist() == [places.index(x) for x in itertools.chain(*taken)]
    assert len(TRIANGLES.template) == triangles.POINTS
    assert len(QUARTIC.exponents) == triangles.MONOMIALS
    assert TRIANGLES.template[triangles.OWN] == (1, 1)


def test_places_around_corners():
    s, t = (x.ravel() for x in np.meshgrid(EDGES, EDGES))
    s, t = (x[s + t <= 1] for x in (s, t))
    for orientation, against in enumerate(TRIANGLES.against):
        ups = [np.full(len(s), up) for up in against]
        twins = zip(*reference.split_flipped_corner(s, t, *ups), strict=True)
        for x, y, twin in zip(s.tolist(), t.tolist(), twins, strict=True):
            assert alone(triangles.place_around)(x, y, orientation) == tuple(twin)


def test_locating():
    """In splits, on lines and beside them, as the patch table does."""
    points, faces, tags = zoo_triangles.TAGGED["semi_2.5"]()
    patches = PatchTable(ls.Mesh(np.array(points, dtype=float), faces, **tags),
                         surface_of("semi_2.5")._topology.rules, FLOAT64)  # fmt: skip
    known = surface_of("semi_2.5")._topology.packing.patches
    u, v = (x.ravel() for x in np.meshgrid([*EDGES, 3 / 8, 5 / 8, 3 / 16], [*EDGES, 1 / 8, 5 / 16]))
    u, v = (x[np.maximum(u, v) - 1 + np.minimum(u, v) <= 0] for x in (u, v))
    for face in range(patches.n_limit_faces):
        twins = zip(*patches.locate(np.full(len(u), face), u, v), strict=True)
        for x, y, (patch, s, t, depth, flipped) in zip(u.tolist(), v.tolist(), twins, strict=True):
            code, *found, fine = alone(triangles.located)(face, x, y, known)
            assert fine
            assert found == [depth, s, t]
            assert code & evaluation.ROW == patches.row[patch]
            assert code >> evaluation.KIND == patches.kind[patch]
            turn = code >> evaluation.TURN & evaluation.TURNS
            assert turn == patches.turn[patch] + 3 * flipped
