"""Compiled evaluation against its NumPy twin, and against the oracles themselves.

The twins may differ by rounding: a position by 1e-14 of the size of the local cage and 2 ulp, a
derivative by 1e-12 of itself. Where a derivative is small, the rounding of the additions that it is
made of counts: 1e-14 of the size of the cage times the largest sum of absolute weights, of any
derivative of that order, on the ring around the nearest corner.
"""

import itertools
import math
import random
from fractions import Fraction as F
from functools import cache

import numba
import numpy as np
import oracles
import pytest
import test_creases
import test_surface
import zoo
import zoo_triangles
from test_surface import accuracy, float_queries, largest_on_ring, random_cage

import limitsurf as ls
from limitsurf import basis, tables
from limitsurf._kernels import evaluation, jit, quads, reference
from limitsurf.engine import packing
from limitsurf.numbers import FLOAT64
from limitsurf.patches import STRIP
from limitsurf.scheme.lattice import QUADS

TERMS = [(m - j, j) for m in range(3) for j in range(m + 1)]
NAMES = sorted(zoo.ZOO) + sorted(zoo.TAGGED)
# cages with all kinds of patches: smooth ones, cut ones, strips, sectors of creases, darts, cones
SAMPLE = [
    "carved_cube_1",
    "bipyramid_9",
    "local_cage_12",
    "grid_3x3",
    "crossing_rings_2.5",
    "crease_3_3",
    "corner_2",
    "dart_2",
    "cone_3",
    "chaikin_row",
    "hole_beside_a_crease",
    "open_and_closed_fan",
]
on_samples = pytest.mark.parametrize("name", SAMPLE)
over_the_zoo = pytest.mark.parametrize("name", NAMES)
over_some = pytest.mark.parametrize("name", sorted({*SAMPLE, *NAMES[::4]}))
LEAST = 5e-324
NEAR = [0, 1e-30, 1e-16, 2.0**-52, 1e-12, 1e-6, 1e-3, 2.0**-7, 0.1, 0.125, 0.25, 0.3, 0.5]
NEAREST = [LEAST, 2e-320, 2.0**-1022, 1e-300, 1e-290, 1e-200, 2.0**-500, 1e-100]


def cage(name):
    """A cage of the zoo, with points that have no symmetry."""
    points, faces, tags = (*zoo.ZOO[name](), {}) if name in zoo.ZOO else zoo.TAGGED[name]()
    return np.asarray(zoo.random_points(len(points), name), dtype=float), faces, tags


def surface_of(name):
    points, faces, tags = cage(name)
    return ls.LimitSurface(ls.Mesh(points, faces, **tags))


def queries(surface, n, rng, near=(*NEAR, *NEAREST)):
    """Anywhere, dyadic, on edges, at corners, and closer to them than any number but 0."""
    kind, turn = rng.integers(6, size=n), rng.integers(8, size=n)
    (a, b), dyadic = rng.random((2, n)), rng.integers(65, size=(2, n)) / 64
    c, d = rng.choice(near, (2, n)) * np.where(rng.random((2, n)) < 0.5, 1, rng.random((2, n)))
    u = np.choose(kind, [a, dyadic[0], c, c, a, c])
    v = np.choose(kind, [b, dyadic[1], d, c * b, 0 * b, c])
    u, v = np.where(turn & 1, v, u), np.where(turn & 1, u, v)
    u, v = np.where(turn & 2, 1 - u, u), np.where(turn & 4, 1 - v, v)
    return rng.integers(len(surface.limit_faces), size=n), u, v


def with_gaps(face, u, v):
    """Some of the queries without a value."""
    u, v = u.copy(), v.copy()
    u[3], v[7], u[11], v[12] = np.nan, np.inf, -np.inf, np.nan
    u[13] = v[13] = np.nan
    return face, u, v


def row_sums(W):
    """Of absolute values."""
    return np.asarray(abs(W).sum(axis=1))


def sizes(surface, face, u, v):
    """Of the part of the cage that each query, or one further within its face, depends on, (Q,)."""
    flat, result = surface.points.reshape(len(surface.points), -1), 0
    for x, y in ((u, v), (0.25 + u / 2, 0.25 + v / 2)):
        W = surface.weights(face, x, y)
        near = flat[W.indices]
        most, least = (f.reduceat(near, W.indptr[:-1], axis=0) for f in (np.maximum, np.minimum))
        result = np.maximum(result, (most - least).max(axis=1))
    return result


def scales(surface, face, u, v, terms=TERMS):
    """Largest sums of absolute weights that are close to queries, by order, (orders, Q).

    Around a special corner: on the ring that the query lies on; else anywhere in the patch.
    """
    patches = surface.patches
    defined = np.isfinite(u) & np.isfinite(v) & (patches.codes[face] != -1)
    u, v = (np.where(defined, x, 0.5) for x in (u, v))
    special, origin, size = np.zeros(len(u), dtype=bool), np.zeros((2, len(u))), np.ones(len(u))
    patch, s, t, depth, _ = patches.locate(face[defined], u[defined], v[defined])
    special[defined], size[defined] = patches.kind[patch] > STRIP, 0.5**depth
    origin[:, defined] = [u[defined] - s * 0.5**depth, v[defined] - t * 0.5**depth]
    a = np.maximum(np.minimum(u, 1 - u), np.minimum(v, 1 - v))
    ring = [(1, 1), (1, 0.5), (0.5, 1), (1, 0), (0, 1), (0.75, 0.3), (0.3, 0.75), (0, 0)]
    us, vs = (
        np.array([
            np.where(special, np.where(x <= 0.5, a * k, 1 - a * k), first + size * k) for k in part
        ])
        for x, first, part in zip((u, v), origin, zip(*ring, strict=True), strict=True)
    )  # fmt: skip
    us[-1], vs[-1] = u, v
    us, vs = us.clip(0, 1), vs.clip(0, 1)
    result = np.zeros((1 + max(map(sum, terms)), len(face)))
    with np.errstate(over="ignore", invalid="ignore"):
        for nu in terms:
            found = row_sums(surface.weights(face, us, vs, nu=nu)).reshape(us.shape)
            result[sum(nu)] = np.maximum(result[sum(nu)], np.nan_to_num(found).max(axis=0))
    return result


def smallest_pieces(surface, face, u, v):
    """Sizes of the polynomials that queries lie in, in parameters, (Q,)."""
    patches, result = surface.patches, np.ones(len(u))
    there = np.isfinite(u) & np.isfinite(v) & (patches.codes[face] != -1)
    patch, s, t, depth, _ = patches.locate(face[there], u[there], v[there])
    near = np.maximum(np.minimum(s, 1 - s), np.minimum(t, 1 - t)) / 2
    across = np.minimum(t, 1 - t) / 2 + 2.0**-20
    kind = patches.kind[patch]
    size = np.where(kind > STRIP, near, np.where(kind == STRIP, across, 1.0))
    result[there] = np.maximum(size * 0.5**depth, LEAST)
    return result


def assert_close(found, expected, scale, slack=0.0):
    """Arrays (Q, ...) with scales (Q,); `slack` allows for more than rounding within the cage."""
    assert found.shape == expected.shape
    assert (np.isnan(found) == np.isnan(expected)).all()
    infinite = np.isinf(expected)
    assert (np.isinf(found) == infinite).all()
    assert (found[infinite] == expected[infinite]).all()
    there = np.isfinite(expected)
    if not there.any():
        return
    scale = np.broadcast_to(scale.reshape(-1, *[1] * (found.ndim - 1)), found.shape)[there]
    x, y = found[there], expected[there]
    with np.errstate(over="ignore"):
        if slack:
            allowed = 1e-14 * scale + slack * np.spacing(np.abs(y))
        else:  # either may be 1e-14 off
            allowed = np.maximum(1e-12 * np.abs(y), 2e-14 * scale)
        far = np.abs(x - y) > allowed + 4 * LEAST
    assert not far.any(), (x[far][:3], y[far][:3], allowed[far][:3])


def compare(surface, query, use, orders=TERMS):
    """Values and derivatives of one surface by kernels and by NumPy."""
    use(False)
    twin = surface.jet(*query)
    use(True)
    size, scale = sizes(surface, *query), scales(surface, *query)
    jets = [surface.jet(*query, order=order) for order in range(3)]
    with np.errstate(over="ignore"):
        allowed = size * scale
    for nu in orders:
        order = sum(nu)
        for found in (surface.evaluate(*query, nu=nu), *(jet[nu] for jet in jets[order:])):
            assert_close(found, twin[nu], allowed[order], 2 * (order == 0))
    return twin, size, scale


def compare_normals(surface, query, use, slopes, size, scale):
    """Directions are as accurate as the derivatives that they come from."""
    use(False)
    twin = surface.normal(*query)
    along, across = surface.tangents(*query)
    use(True)
    found = surface.normal(*query)
    assert (np.isnan(found) == np.isnan(twin)).all()
    with np.errstate(all="ignore"):
        noise = 0
        for slope in slopes:
            part = 1e-15 * size * scale[1] / np.abs(slope).max(axis=1)
            noise = noise + np.nan_to_num(part, nan=0, posinf=0)
        sine = np.linalg.norm(np.cross(along, across), axis=1)
        noise = np.nan_to_num(noise / sine, nan=0, posinf=0)
        far = np.abs(found - twin).max(axis=1) > 1e-12 + noise
    assert not far.any(), [x[far][:3] for x in (*query, found, twin, noise)]


# --- All cages


@over_the_zoo
def test_zoo(name, use):
    """All derivatives, jets, normals and weights at parameters of every kind."""
    rng = np.random.default_rng(len(name))
    surface = surface_of(name)
    query = with_gaps(*queries(surface, 160, rng))
    twin, size, scale = compare(surface, query, use)
    compare_normals(surface, query, use, (twin[1, 0], twin[0, 1]), size, scale)


@over_some
def test_weights(name, use):
    """Their accuracy is that of test_surface.py: rounding in deep patches is not that of evaluate.

    Nearer to corners than tried here weights may be infinite, or add up to nothing but rounding.
    """
    rng = np.random.default_rng(len(name))
    surface = surface_of(name)
    query = with_gaps(*queries(surface, 100, rng, NEAR))
    use(True)
    scale = scales(surface, *query)
    for nu in [(0, 0), TERMS[rng.integers(1, 3)], TERMS[rng.integers(3, 6)]]:
        use(False)
        expected, values = surface.weights(*query, nu=nu), surface.evaluate(*query, nu=nu)
        use(True)
        W = surface.weights(*query, nu=nu)
        assert_sparse(W, expected.shape)
        allowed = 10 * scale[sum(nu)]
        assert_close(W.toarray(), expected.toarray(), allowed)
        assert_close(W @ surface.points, values, allowed)


def assert_sparse(W, shape, dtype=np.int32):
    assert W.shape == shape
    assert W.format == "csr"
    assert dtype in (None, W.indices.dtype)
    assert dtype in (None, W.indptr.dtype)
    assert W.has_sorted_indices
    assert W.has_canonical_format
    steps, rows = np.diff(W.indices), np.repeat(np.arange(W.shape[0]), np.diff(W.indptr))
    assert (steps[np.diff(rows) == 0] > 0).all()
    assert len(W.data) == len(W.indices) == W.indptr[-1]


@over_the_zoo
def test_grids(name, use, monkeypatch):
    """The same parameters on many faces, all at once or one by one."""
    monkeypatch.setattr(packing, "_FACES", 1)  # also cages of few faces
    surface = surface_of(name)
    n = len(surface.limit_faces)
    face = np.random.default_rng(n).integers(n, size=5 if n < 5 else min(n, 20))
    u = np.array([0, 0.1, 0.3, 0.5, 1, 1e-3, 2.0**-6, 1 - 1e-9])
    v = np.array([0, 0.25, 0.7, 1, 1e-9])
    grid = face[:, None, None], u[:, None], v
    flat = [x.reshape(-1).copy() for x in np.broadcast_arrays(*grid)]
    use(True)
    assert packing._grid(np.broadcast_arrays(*grid)) is not None
    assert packing._grid(flat) is None
    size, scale = sizes(surface, *flat), scales(surface, *flat)
    jets, alone = surface.jet(*grid), surface.jet(*flat)
    for nu in TERMS:
        for found in (jets[nu], surface.evaluate(*grid, nu=nu)):
            assert found.shape == (len(face), 8, 5, 3)
            part = found.reshape(-1, 3)
            assert_close(part, alone[nu], size * scale[sum(nu)], 2 * (nu == (0, 0)))
    # normals on grids are left to others unless they are clear
    single, normals = surface.normal(*flat), surface.normal(*grid).reshape(-1, 3)
    assert np.array_equal(np.isnan(single), np.isnan(normals))
    assert np.nanmax(np.abs(single - normals), initial=0) < 1e-12


@pytest.mark.parametrize("shape", [(), (1,), (2,), (4,), (5,), (9,), (2, 2), (0,)])
@on_samples
def test_channels(name, shape, use):
    """Any number of channels, on grids as well."""
    rng = np.random.default_rng(1)
    surface = surface_of(name)
    surface = surface.with_points(rng.normal(size=(surface.mesh.n_vertices, *shape)))
    query = with_gaps(*queries(surface, 60, rng, NEAR))
    if 0 in shape:
        use(True)
        assert surface.evaluate(*query).shape == (60, 0)
        return
    compare(surface, query, use, TERMS[::2])
    face, u, v = np.arange(6)[:, None] % len(surface.limit_faces), query[1][20:], query[2][20:]
    flat = [x.reshape(-1).copy() for x in np.broadcast_arrays(face, u, v)]
    size, scale = sizes(surface, *flat), scales(surface, *flat)
    for nu in TERMS[:3]:
        found = surface.evaluate(face, u, v, nu=nu).reshape(-1, *shape)
        assert_close(
            found, surface.evaluate(*flat, nu=nu), size * scale[sum(nu)], 2 * (nu == (0, 0))
        )


@pytest.mark.parametrize("interpolation", ["all", "none", "boundaries", "corners_only"])
@pytest.mark.parametrize("name", ["carved_cube_1", "crossing_rings_2.5", "sphere_8"])
def test_face_varying_channels(name, interpolation, use):
    """With seams between faces of odd and even number."""
    points, faces, tags = cage(name)
    rng = np.random.default_rng(2)
    n = len(points)
    corners = np.concatenate([np.array(face) + n * (f % 2) for f, face in enumerate(faces)])
    channels = {"uv": (rng.random((2 * n, 2)), corners, interpolation)}
    surface = ls.LimitSurface(ls.Mesh(points, faces, channels=channels, **tags))
    query = with_gaps(*queries(surface, 100, rng, NEAR))
    own = surface.of_channel("uv")
    twin, *_ = compare(own, query, use)
    for nu in TERMS:
        found = surface.evaluate(*query, nu=nu, channel="uv")
        assert np.array_equal(found, own.evaluate(*query, nu=nu), equal_nan=True)
        assert (np.isnan(found) == np.isnan(twin[nu])).all()
        jet = surface.jet(*query, channel="uv", workers=2)[nu]
        assert np.array_equal(jet, own.jet(*query)[nu], equal_nan=True)


@pytest.mark.parametrize(
    "change",
    [
        lambda p: p * 1e150,
        lambda p: p * 1e-150,
        lambda p: p * 1e300,
        lambda p: 1e-3 * p + 1e8 * np.array([1, -0.5, 0.25]),
        lambda p: p * [1, 1, 0],
        lambda p: p * [1e-200, 1, 1e200],
    ],
    ids=["huge", "tiny", "vast", "far", "plane", "uneven"],
)
@on_samples
def test_coordinates_of_any_size(name, change, use):
    surface = surface_of(name)
    surface = surface.with_points(change(surface.points))
    query = with_gaps(*queries(surface, 80, np.random.default_rng(3), NEAR))
    with np.errstate(over="ignore"):
        twin, size, scale = compare(surface, query, use)
    if np.ptp(surface.points[:, 0]) < np.ptp(surface.points[:, 1]) / 10:
        return  # these have no normals: one coordinate is rounding error of others
    compare_normals(surface, query, use, (twin[1, 0], twin[0, 1]), size, scale)


@pytest.mark.parametrize(
    "points",
    [lambda p: p * 0 + 1.5, lambda p: np.outer(p[:, 0], [1, 2, -0.5])],
    ids=["equal", "line"],
)
@over_some
def test_degenerate_points(name, points, use):
    """Some or all coefficients in the eigenbasis are exactly zero; there are no normals."""
    surface = surface_of(name)
    surface = surface.with_points(points(surface.points))
    query = queries(surface, 40, np.random.default_rng(4), NEAR)
    compare(surface, query, use, TERMS[::3])
    defined = ~np.isnan(surface.evaluate(*query)).any(axis=1)
    grid = np.arange(5)[:, None] % len(surface.limit_faces), [0.1, 0.5, 1, 0], [0.3, 0.2, 0, 0]
    for kernels in (True, False):
        use(kernels)
        assert np.isnan(surface.normal(*query)).all()
        assert np.isnan(surface.normal(*grid)).all()
    if np.ptp(surface.points) == 0:
        use(True)
        assert (surface.evaluate(*query)[defined] == 1.5).all()
        assert (surface.evaluate(*query, nu=(1, 0))[defined] == 0).all()


@pytest.mark.parametrize(
    "name", ["cube", "dodecahedron", "prism_12", "trapezohedron_5", "carved_cube_1", "crease_3_3"]
)
def test_normals_of_few_points(name, use):
    """Only three vertices are not at the origin: many faces are a line, or a point."""
    surface = surface_of(name)
    surface = surface.with_points(np.eye(surface.mesh.n_vertices, 3))
    query = queries(surface, 40, np.random.default_rng(5), NEAR)
    for kernels in (True, False):
        use(kernels)
        length = np.linalg.norm(surface.normal(*query), axis=1)
        assert np.nanmax(np.abs(length - 1), initial=0) < 1e-15


@pytest.mark.parametrize("N", [40, 80])
def test_high_poles(N, use):
    """At some valence coefficients are not kept, but control points of some levels."""
    points, faces = zoo.flower(N)
    surface = ls.LimitSurface(ls.Mesh(zoo.random_points(len(points), N), faces))
    sizes_of_tables = surface._topology.packing.tables.kinds[:, evaluation.MODES]
    assert (sizes_of_tables[2:] < 0).any() == (N == 80)
    query = with_gaps(*queries(surface, 300, np.random.default_rng(N)))
    twin, size, scale = compare(surface, query, use)
    compare_normals(surface, query, use, (twin[1, 0], twin[0, 1]), size, scale)
    for workers in (1, 2):
        W = surface.weights(*query, workers=workers)
        assert_sparse(W, (300, len(points)), np.int32 if N == 40 else None)
        assert_close(W @ surface.points, twin[0, 0], size, 2)
    grid = np.arange(0, 4 * N, 5)[:, None], query[1][20:60], query[2][20:60]
    flat = [x.reshape(-1).copy() for x in np.broadcast_arrays(*grid)]
    found = surface.evaluate(*grid).reshape(-1, 3)
    assert_close(found, surface.evaluate(*flat), sizes(surface, *flat), 2)


@pytest.mark.filterwarnings("ignore:.* has no tangent plane")
@pytest.mark.parametrize("own", [F(1, 2), F(1), F(0), F(-1, 2)])
@pytest.mark.parametrize("N", [2, 3, 5])
def test_schemes_of_ones_own(own, N, use):
    """Other eigenvalues, also zero and negative ones."""

    def vertex(valence):
        share = (1 - own) / (2 * valence)
        return true.vertex(4) if valence == 4 else (own, share, share)

    true = tables.SCHEMES["catmull-clark"]
    masks = {name: getattr(true, name) for name in ls.Scheme.__dataclass_fields__}
    scheme = ls.Scheme(**masks | {"name": f"vertex weight {own}", "vertex": vertex})
    points, faces = oracles.local_cage(N, seed=2)
    surface = ls.LimitSurface(ls.Mesh(np.array(points, dtype=float), faces), scheme=scheme)
    query = with_gaps(*queries(surface, 80, np.random.default_rng(N), NEAR))
    query = np.zeros(80, dtype=int), *query[1:]
    compare(surface, query, use)


HIGHER = [(order - j, j) for order in range(3, 8) for j in range(order + 1)]


@over_the_zoo
def test_higher_derivatives(name, use):
    """Of all orders beyond the second, also where they are on other sides of lines, or infinite."""
    rng = np.random.default_rng(len(name))
    surface = surface_of(name)
    query = with_gaps(*queries(surface, 160, rng))
    orders = [*rng.permutation(HIGHER)[:5], (3, 0), (2, 1), (1, 2), (0, 3)]
    use(False)
    expected = [surface.evaluate(*query, nu=tuple(nu)) for nu in orders]
    use(True)
    size, scale = sizes(surface, *query), scales(surface, *query, terms=[*TERMS, *HIGHER])
    with np.errstate(over="ignore"):
        least = 2 / smallest_pieces(surface, *query)
    for nu, values in zip(orders, expected, strict=True):
        with np.errstate(over="ignore"):
            # what cancels in the weights of vertices does not in those of control points
            allowed = size * np.maximum(scale[sum(nu)], least ** sum(nu))
        assert_close(surface.evaluate(*query, nu=tuple(nu)), values, allowed)


@over_some
def test_jets_of_higher_order(name, use):
    """They are what is asked for one by one, whoever answers."""
    surface = surface_of(name)
    query = with_gaps(*queries(surface, 60, np.random.default_rng(6), NEAR))
    use(False)
    rows = surface.weights(*query, nu=(2, 1))
    use(True)
    low, found = surface.jet(*query, order=2), surface.jet(*query, order=4)
    out = {nu: np.empty_like(x) for nu, x in found.items()}
    given = surface.jet(*query, order=4, out=out, workers=2)
    for nu, x in found.items():
        wanted = low[nu] if nu in low else surface.evaluate(*query, nu=nu)
        # (NumPy adds up in an order that depends on how many there are)
        assert np.allclose(x, wanted, rtol=0 if nu in low else 1e-12, atol=0, equal_nan=True)
        assert given[nu] is out[nu]
        assert np.array_equal(out[nu], x, equal_nan=True)
        one = surface.jet(*(x.ravel()[0] for x in query), order=4)[nu]
        # (of the pillow NumPy answers)
        rounding = 0 if nu in low and name != "pillow_of_quads" else 1e-12
        wanted = x.reshape(-1, 3)[0]
        assert np.allclose(one, wanted, rtol=rounding, atol=rounding, equal_nan=True)
    # (weights of these orders are for NumPy)
    assert np.array_equal(surface.weights(*query, nu=(2, 1)).toarray(), rows.toarray(), True)


# --- The oracles

EXACT = [name for name in SAMPLE if name in zoo.TAGGED]
EXACT += ["dart_5", "boundary_5_edge_only", "semi_sharp_corner", "smooth_truncated", "holes"]


@pytest.mark.parametrize("seed", [0, 3, 7, 9, 13, 30, 61])
def test_accuracy_on_random_cages(seed, use):
    """The design's, see test_surface.py."""
    points, faces = random_cage(seed)
    surface, oracle = test_surface.both(points, faces)
    closed = not zoo.boundary_vertices(faces)
    target = range(len(surface.limit_faces)) if closed else [seed % 3]
    use(True)
    queries = float_queries(target, 6, random.Random(seed))
    assert max(accuracy(surface, oracle, queries, TERMS)) <= 1


@pytest.mark.parametrize("name", EXACT)
def test_accuracy_on_tagged_cages(name, use):
    surface, oracle = test_creases.both(*zoo.TAGGED[name]())
    queries = test_creases.float_queries_near(surface, 6, random.Random(name))
    use(True)
    assert max(accuracy(surface, oracle, queries, TERMS, floor=F(1, 100)), default=0) <= 1


@pytest.mark.parametrize("offset", [1e9, -123456.7])
def test_accuracy_far_from_the_origin(offset, use):
    points, faces = random_cage(15)
    surface, oracle = test_surface.both(points + offset * np.array([1, -0.5, 0.25]), faces)
    queries = float_queries(range(len(surface.limit_faces)), 8, random.Random(15))
    use(True)
    assert max(accuracy(surface, oracle, queries, TERMS)) <= 1


@pytest.mark.parametrize(
    ("name", "face"),
    [
        ("crease_1_1", 4),
        ("corner_1", 0),
        ("corner_of_one_crease", 4),
        ("boundary_1_edge_only", 0),
        ("boundary_4_edge_only", 4),
        ("dart_2", 0),
        ("dart_4", 0),
    ],
)
def test_accuracy_next_to_corners(name, face, use):
    """Where powers of eigenvalues are near the ends of the range, but derivatives are not."""
    surface, oracle = test_creases.both(*zoo.TAGGED[name]())
    use(True)
    for query in [(face, 1e-288, 5.5e-291), (face, 1e-300, 5.5e-303), (face, 0.0, 4.8e-306)]:
        for nu in TERMS:
            exact, found = oracle.evaluate(*query, nu=nu), surface.evaluate(*query, nu=nu).tolist()
            largest = max(map(abs, exact))
            if largest > F(10) ** 307:
                continue
            error = max(abs(F(x) - y) for x, y in zip(found, exact, strict=True))
            if error * 10**12 > largest:
                largest = max(largest, largest_on_ring(oracle, *query, sum(nu)) / 100)
            assert error <= largest / 10**12, (query, nu, found, [float(x) for x in exact])


# --- Workers and sizes


def same_bits(one, other):
    return np.array_equal(one.view(np.int64), other.view(np.int64))


CALLS = {
    "evaluate": lambda surface, query, workers: [surface.evaluate(*query, workers=workers)],
    "slope": lambda surface, query, workers: [surface.evaluate(*query, nu=(0, 1), workers=workers)],
    "jet": lambda surface, query, workers: list(surface.jet(*query, workers=workers).values()),
    "normal": lambda surface, query, workers: [surface.normal(*query, workers=workers)],
    "weights": lambda surface, query, workers: parts(
        surface.weights(*query, nu=TERMS[:4], workers=workers)
    ),
}


def parts(matrices):
    pattern = matrices[0].indices, matrices[0].indptr
    return [*(W.data for W in matrices), *(x.astype(float) for x in pattern)]


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("extra", [None, -1, 0, 1, 2 * packing.CHUNK + 5])
def test_workers_change_nothing(call, extra, use):
    """Not a bit; sizes are around that of what threads take at a time, and very small."""
    surface = surface_of("crease_3_3")
    rng = np.random.default_rng(7)
    ask = CALLS[call]
    use(True)
    for n in [packing.CHUNK + extra] if extra is not None else [0, 1, 2]:
        query = queries(surface, n, rng, NEAR)
        first = ask(surface, query, 1)
        for workers in (1, 2, 3, -1, 64):
            found = ask(surface, query, workers)
            assert all(same_bits(x, y) for x, y in zip(found, first, strict=True))
        if call != "weights":
            assert all(x.shape == (n, 3) for x in first)
            # nor does it matter what else is asked at the same time
            some = rng.integers(n, size=min(n, 50))
            few = ask(surface, [x[some] for x in query], 1)
            assert all(same_bits(x[some], y) for x, y in zip(first, few, strict=True))


@pytest.mark.parametrize("call", ["evaluate", "jet", "normal"])
def test_workers_on_grids(call, use):
    surface = surface_of("crease_3_3")
    u, v = np.random.default_rng(8).random((2, 1000))
    u[:3] = 0
    query = np.resize(np.arange(len(surface.limit_faces)), 80)[:, None], u, v
    use(True)
    first = CALLS[call](surface, query, 1)
    for workers in (1, 2, 3, -1):
        found = CALLS[call](surface, query, workers)
        assert all(same_bits(x, y) for x, y in zip(found, first, strict=True))


@pytest.mark.parametrize("workers", [0, True, False, 1.5, "2", None, np.float64(2)])
def test_no_number_of_workers(workers, use):
    surface = surface_of("cube")
    for kernels in (False, True):
        use(kernels)
        for call in CALLS.values():
            with pytest.raises(ValueError, match="workers must be a positive integer, or -1"):
                call(surface, (0, 0.5, 0.5), workers)


@pytest.mark.parametrize("workers", [-1, np.int32(2), np.uint8(3), np.int8(-1)])
def test_numbers_of_workers(workers, use):
    surface = surface_of("cube")
    use(True)
    query = queries(surface, 70_000, np.random.default_rng(9))
    for call in CALLS.values():
        one, some = call(surface, query, 1), call(surface, query, workers)
        assert all(same_bits(x, y) for x, y in zip(one, some, strict=True))


@on_samples
def test_patches_of_large_cages(name, use, monkeypatch):
    """Without copies of control points beyond the cage, as where there are too many of them."""
    surface = surface_of(name)
    query = with_gaps(*queries(surface, 160, np.random.default_rng(3)))
    monkeypatch.setattr(packing, "_COPIED", -1)
    monkeypatch.setattr(packing, "_COPIED_SHARE", -1)
    twin, size, scale = compare(surface, query, use)
    assert len(surface._topology.packing._copied) == 0
    compare_normals(surface, query, use, (twin[1, 0], twin[0, 1]), size, scale)


# --- Weights


def test_weights_without_queries(use):
    surface = surface_of("cube")
    use(True)
    for empty in ([], np.zeros((3, 0)), np.zeros((0, 2, 1))):
        assert_sparse(surface.weights(0, empty, 0.5), (0, 8))


def test_weights_of_undefined_queries(use):
    """Rows have one NaN, at a vertex of the face."""
    points, faces, _ = cage("carved_cube_1")
    surface = ls.LimitSurface(ls.Mesh(points, faces, holes=[1, 4]))
    face = np.arange(len(surface.limit_faces))
    gone = np.isin(surface.limit_faces.face, [1, 4])
    use(True)
    for nu in TERMS:
        W = surface.weights(face, 0.3, 0.7, nu=nu, workers=2)
        assert_sparse(W, (len(face), len(points)))
        rows = W.toarray()
        assert (np.isnan(rows).sum(axis=1) == gone).all()
        assert (np.diff(W.indptr)[gone] == 1).all()
        for k in np.flatnonzero(gone):
            assert W.indices[W.indptr[k]] in faces[surface.limit_faces.face[k]]
        W = surface.weights(face, np.nan, 0.7, nu=nu)
        assert np.isnan(W.data).all()
        assert (np.diff(W.indptr) == 1).all()


def assert_one_pattern(matrices):
    exact = isinstance(matrices[0], ls.ExactOperator)
    for name in ("rows", "columns") if exact else ("indptr", "indices"):
        assert len({id(getattr(W, name)) for W in matrices}) == 1
    assert len({id(W.values if exact else W.data) for W in matrices}) == len(matrices)


def assert_as_alone(matrices, alone):
    """The same numbers to the last bit, zeros added but nothing else."""
    assert_one_pattern(matrices)
    for W, one in zip(matrices, alone, strict=True):
        assert W.shape == one.shape
        assert np.array_equal(W.toarray(), one.toarray(), equal_nan=True)


# regular and special patches, coinciding and combined control points, strips, valences beyond
# kernels, n-gons, triangles
SEVERAL = ["carved_cube_1", "torus_2x2", "crossing_rings_2.5", "hole_beside_a_crease", "flower 80"]


@pytest.mark.parametrize("kernels", [True, False])
@pytest.mark.parametrize("name", [*SEVERAL, "loop"])
def test_weights_of_several_orders(name, kernels, use):
    """As those of each order by itself; also beside orders that kernels do not know."""
    if name == "flower 80":
        points, faces = zoo.flower(80)
        surface = ls.LimitSurface(ls.Mesh(zoo.random_points(len(points), 80), faces))
    elif name == "loop":
        points, faces = zoo_triangles.sphere(1)
        surface = ls.LimitSurface(ls.Mesh(np.array(points, dtype=float), faces), scheme="loop")
    else:
        surface = surface_of(name)
    face, u, v = with_gaps(*queries(surface, 150, np.random.default_rng(5), NEAR))
    if name == "loop":
        u, v = u / 2, v / 2
    use(kernels)
    alone = {nu: surface.weights(face, u, v, nu=nu) for nu in [*TERMS, (3, 0)]}
    for orders in [TERMS[:3], TERMS, [(0, 1), (0, 1)], [(2, 0)], [(3, 0), (1, 0), (0, 0)]]:
        found = surface.weights(face, u, v, nu=orders, workers=2)
        assert_as_alone(found, [alone[nu] for nu in orders])
    for W, nu in zip(found, orders, strict=True):
        scale = np.maximum(1, row_sums(W)) * np.abs(surface.points).max()
        error = np.abs(W @ surface.points - surface.evaluate(face, u, v, nu=nu)).max(axis=1)
        assert (error <= 1e-12 * scale)[~np.isnan(error)].all()
    # as rows of one order are, those of kernels are on the pattern of any
    if kernels and name != "flower 80":
        assert np.array_equal(surface.weights(face, u, v, nu=TERMS)[0].indices, alone[0, 0].indices)


def test_weights_of_several_orders_where_kernels_know_some(use):
    """Second derivatives too near a vertex are left to the reference, and do not touch others."""
    surface = surface_of("local_cage_12")
    use(True)
    query = 0, [1e-310, 0.3], [1e-310, 0.4]
    alone = [surface.weights(*query, nu=nu) for nu in TERMS]
    assert_as_alone(surface.weights(*query, nu=TERMS), alone)


def test_exact_weights_of_several_orders():
    surface = surface_of("carved_cube_1")
    query = [0, 3, 5], [F(1, 3), F(0), F(6, 7)], [F(1, 5), F(1, 2), F(1)]
    orders = [(0, 0), (1, 0), (0, 2)]
    found = surface.weights(*query, nu=orders)
    assert_one_pattern(found)
    for W, nu in zip(found, orders, strict=True):
        assert (W.toarray() == surface.weights(*query, nu=nu).toarray()).all()
        assert (W @ np.ones((surface.mesh.n_vertices, 1)) == (nu == (0, 0))).all()


@pytest.mark.parametrize("kernels", [True, False])
def test_weights_of_no_orders(kernels, use):
    surface = surface_of("cube")
    use(kernels)
    assert surface.weights(0, 0.5, 0.5, nu=[]) == []
    assert len(surface.weights(0, 0.5, 0.5, nu=np.array(TERMS))) == 6
    with pytest.raises(IndexError, match="limit face 99"):
        surface.weights(99, 0.5, 0.5, nu=[])
    for bad in ((1,), [(0, 0), (1, -1)], 3, [0, (1, 0)]):
        with pytest.raises(ValueError, match="nu must be two integers"):
            surface.weights(0, 0.5, 0.5, nu=bad)


# --- Kernels and their twins


def compiled(function):
    """Without Numba's runtime, as the kernels are; not cached."""
    return numba.njit(**jit._LEAN)(function)


@cache
def alone(part):
    """What only kernels call, for Python to call."""

    @compiled
    def call(*given):
        return part(*given)

    return call


EDGES = [0.0, LEAST, 3 * LEAST, 2.0**-1023, 2.0**-1022, 1e-300, 2.0**-53, 2.0**-52, 0.1, 0.25,
         np.nextafter(0.5, 0), 0.5, np.nextafter(0.5, 1), 2 / 3, 1 - 2.0**-53, 1.0]  # fmt: skip


def test_scale_by_two():
    numbers = [*EDGES, -0.0, -1.5, 1e300, np.finfo(float).max, math.inf, -math.inf]
    powers = [0, 1, -1, 52, 1022, 1023, 1024, -1021, -1022, -1023, -1074, 2098, -2098, 10**6]
    for x, n in itertools.product(numbers, [*powers, -(10**6)]):
        twin = reference.scale_by_two(np.array([x]), np.array([n]))[0]
        found = alone(evaluation.scale_by_two)(x, n)
        if abs(x) < 1e300 and twin and abs(twin) < 2.0**-1022:
            assert abs(found - twin) <= LEAST  # rounded twice
        else:
            assert found == twin
            assert math.copysign(1, found) == math.copysign(1, twin)
    assert math.isnan(alone(evaluation.scale_by_two)(math.nan, 5))


def test_halvings():
    for x, up in itertools.product(EDGES, [False, True]):
        twin = FLOAT64.halvings(np.array([x]), np.array([up]))[0]
        found = alone(evaluation.halvings)(x, up)
        assert found == twin or (x == 0 and found > 2**39)


def test_cubic_weights():
    t, found = np.array([*EDGES, *np.random.default_rng(0).random(50)]), np.empty(16)
    for order in range(3):
        for k, x in enumerate(t.tolist()):
            found[:] = np.nan
            alone(quads.cubic_weights)(x, order, 2, found)
            assert np.isnan(found[2 + 4 * (order + 1) :]).all()
            for j in range(order + 1):
                twin = reference.cubic_weights(t[k : k + 1], j)[0]
                assert np.abs(found[2 + 4 * j :][:4] - twin).max() <= 3e-16 * 4**j
                exact = reference.cubic_weights(np.array([F(x)], dtype=object), j)[0].astype(float)
                assert np.abs(found[2 + 4 * j :][:4] - exact).max() <= 3e-16 * 4**j


def test_places_around_corners():
    """Level, piece and parameters of (s, t), for every turn of a patch."""
    s, t = (x.ravel() for x in np.meshgrid(EDGES, EDGES))
    for turn in range(4):
        ups = np.full(len(s), turn >= 2), np.full(len(s), turn in (1, 2))
        twins = zip(*reference.split_corner(s, t, *ups), strict=True)
        for x, y, twin in zip(s.tolist(), t.tolist(), twins, strict=True):
            assert alone(quads.place_around)(x, y, turn) == tuple(twin)


def test_turned():
    for turn in range(4):
        sides = [0.25, 0.875, 0.75, 0.125]
        found = alone(quads.turned)(0.25, 0.875, turn)
        assert found == (sides[turn], sides[(turn + 1) % 4])
        # a derivative along u is one along s or t, of a sign
        for k, (i, j) in enumerate(TERMS):
            ((choices, signs),) = basis.turned(QUADS, (i, j))
            assert TERMS[quads.TURNED[turn & 1, k]] == choices[turn]
            assert quads.SIGN[turn, k] == signs[turn]


@pytest.mark.parametrize("sharpness", [0.3, 1.0, 2.5, 4.7, 9.99])
def test_strip_weights(sharpness):
    """Across a semi-sharp crease, against the exact splines."""
    scheme = tables.SCHEMES["catmull-clark"]
    strips = tables.strip_tables(scheme, np.array([0.5, sharpness]), FLOAT64)
    pieces = np.array(strips.pieces, dtype=float).reshape(-1)
    first, depth = int(strips.first[1]), int(strips.depth[1])
    found = np.empty(12)
    for t, up in itertools.product(EDGES, [False, True]):
        alone(quads.strip_weights)(t, 2, up, pieces, first, depth, 0, found)
        one = np.array([1]), np.array([0.5]), np.array([t])
        for j in range(3):
            twin = ls.basis.strip_weights(strips, *one, (0, j), np.array([[up], [up]]))
            twin = twin[0].reshape(4, 4)[:, 1] / reference.cubic_weights(np.array([0.5]), 0)[0, 1]
            assert np.abs(found[4 * j :][:4] - twin).max() <= 4e-15 * 4.0 ** (j * depth)


def numbers(*shape):
    return np.random.default_rng(0).normal(size=shape)


def close(found, expected, size=1):
    return found.shape == expected.shape and np.abs(found - expected).max() <= 4e-15 * size


@pytest.mark.parametrize(("order", "sized"), [(0, False), (1, False), (2, False), (1, True)])
def test_bicubic(order, sized):
    contract = jit.bicubic(order, sized)

    @compiled
    def call(points, ids, at, base, channel, weights, out):
        contract(points, ids, at, base, channel, weights, out)

    points, weights = numbers(50, 8), numbers(2, order + 1, 4)
    ids = np.random.default_rng(1).integers(40, size=40).astype(np.int32)
    count = (order + 1) * (order + 2) // 2
    for at, base, channel in ((0, 0, 0), (7, 3, 4), (24, 10, 0)):
        out = np.full((count + 2, 4), -7.0)
        call(points, ids, at, base, channel, weights, out)
        net = points[ids[at : at + 16] + base, channel : channel + 4]
        net = (net - net[5]).reshape(4, 4, 4)
        for k, (i, j) in enumerate(TERMS[:count]):
            assert close(out[k], np.einsum("y,x,yxc", weights[1, j], weights[0, i], net), 30)
        if sized:
            assert (out[count] == np.abs(net).max(axis=(0, 1))).all()
        assert (out[count + sized :] == -7).all()


@pytest.mark.parametrize(("count", "sized"), [(1, False), (3, True), (6, False)])
def test_gathered(count, sized):
    contract = jit.gathered(12, 4, count, sized)

    @compiled
    def call(points, ids, at, base, channel, weights, scale, out):
        contract(points, ids, at, base, channel, weights, scale, out)

    points, weights = numbers(50, 8), numbers(count, 12)
    ids = np.random.default_rng(1).integers(40, size=40).astype(np.int32)
    for at, base, channel in ((0, 0, 0), (7, 3, 4), (24, 10, 0)):
        out = np.full((count + 2, 4), -7.0)
        call(points, ids, at, base, channel, weights.reshape(-1), 0.75, out)
        net = points[ids[at : at + 12] + base, channel : channel + 4]
        net -= net[4]
        assert close(out[:count], 0.75 * weights @ net, 30)
        if sized:
            assert (out[count] == np.abs(net).max(axis=0)).all()
        assert (out[count + sized :] == -7).all()


@pytest.mark.parametrize("degrees", [(3, 3, 3, 3), (4, 3, 2, 1, 0)])
@pytest.mark.parametrize("order", range(3))
def test_polynomials(order, degrees):
    evaluate = jit.polynomials(order, degrees)

    @compiled
    def call(c, at, size, S, T, rows):
        evaluate(c, at, size, S, T, rows)

    stride, size = 12, 8
    exponents = [(e, f) for f, most in enumerate(degrees) for e in range(most + 1)]
    c, S, T = numbers(3, len(exponents), stride), 0.375, 0.7
    count = (order + 1) * (order + 2) // 2
    for part in range(3):
        rows = np.full((7, stride), -7.0)
        call(c, part * len(exponents) * stride, size, S, T, rows)
        for k, (i, j) in enumerate(TERMS[:count]):
            along, across = (
                [math.perm(e, n) * x ** (e - n) if e >= n else 0.0 for e in range(5)]
                for x, n in ((S, i), (T, j))
            )
            expected = np.array([along[e] * across[f] for e, f in exponents]) @ c[part, :, :size]
            assert close(rows[k, :size], expected, 30)
        assert (rows[:, size:] == -7).all()
        assert (rows[count:] == -7).all()


@pytest.mark.parametrize("count", [1, 3, 6])
def test_scaling_and_combination(count):
    scale, combine = jit.scaling(count), jit.combination(count)

    @compiled
    def call(rows, size, factors, a, b, values, at, width, out):
        scale(rows, size, factors, a, b)
        combine(rows, size, values, at, width, out)

    for size in (4, 8, 20):
        rows, factors, values = numbers(8, 24), numbers(5, 24), numbers(30, 8)
        out = np.full((count + 1, 4), -7.0)
        expected = rows.copy()
        expected[:count, :size] *= factors[1, :size] * factors[3, :size]
        call(rows, size, factors, 24, 72, values.reshape(-1), 3 * 8 + 4, 8, out)
        assert close(rows, expected)
        assert (rows[count:] == expected[count:]).all()
        assert close(out[:count], expected[:count, :size] @ values[3 : 3 + size, 4:], 30)
        assert (out[count] == -7).all()


@pytest.mark.parametrize("channels", [1, 3])
def test_products(channels):
    contract = jit.products(channels)

    @compiled
    def call(weights, at, size, stride, values, first, width, out, k, begin):
        contract(weights, at, size, stride, values, first, width, out, k, begin)

    for size, k, begin in ((1, 0, 0), (16, 2, 8), (28, 1, 16)):
        weights, values = numbers(30, 24), numbers(40, 4)
        out = np.full((3, 3, 24), -7.0)
        flat = weights.reshape(-1), 24 + 8, size, 24, values.reshape(-1), 4 * 2 + 1, 4
        call(*flat, out, k, begin)
        expected = values[2 : 2 + size, 1 : 1 + channels].T @ weights[1 : 1 + size, 8:16]
        assert close(out[k, :channels, begin : begin + 8].copy(), expected, 30)
        out[k, :channels, begin : begin + 8] = -7
        assert (out == -7).all()


def test_bits():
    @compiled
    def there(x):
        return jit.bits(x)

    @compiled
    def back(n):
        return jit.of_bits(n)

    for x in [*EDGES, -0.0, -1.5, math.inf, np.finfo(float).max]:
        n = np.array(x).view(np.int64).item()
        assert there(x) == n
        assert np.array(back(n)).view(np.int64) == n


def test_prefetching_is_harmless():
    @compiled
    def call(array, index):
        jit.prefetch(array, index)
        return array[0]

    array = numbers(8)
    for index in (0, 7, 10**6, -(10**6)):
        assert call(array, index) == array[0]
