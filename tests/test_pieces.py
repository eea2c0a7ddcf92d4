"""Bezier patches: equal to the surface, exactly in Fractions; cells, rows and what remains."""

import random
from collections import Counter
from fractions import Fraction as F
from functools import cache
from itertools import product
from math import comb, factorial, lcm, prod

import numpy as np
import oracles
import oracles_creases
import oracles_loop
import pytest
import zoo
import zoo_triangles
from test_properties import same
from test_rings import KINDS, around
from test_wicked import altered

import limitsurf as ls
from limitsurf import numbers, tables
from limitsurf.patches import REGULAR
from limitsurf.pieces import cells, cover
from limitsurf.scheme.catmull_clark import CATMULL_CLARK
from limitsurf.scheme.loop import LOOP

CAGES = {name: (*make(), {}) for name, make in zoo.ZOO.items()}
CAGES |= {f"tagged_{name}": make() for name, make in zoo.TAGGED.items()}
TRIANGLES = {f"loop_{name}": (*make(), {}) for name, make in zoo_triangles.ZOO.items()}
TRIANGLES |= {f"loop_{name}": make() for name, make in zoo_triangles.TAGGED.items()}
# of which there are exact rows over the cage too: long Fractions are slow
ROWS = ("cube", "half_disk_5", "flower_3", "heptagon", "tagged_cone_4", "tagged_ring_2.5")
# where all weights of Loop are rational
RATIONAL = ("tetrahedron", "octahedron", "crowded", "torus_3x4", "triangle", "ringed_fan_4")
RATIONAL += ("grid_3x2", "disc_3", "disc_4", "dart_3", "dart_4", "crease_2_of_6", "semi_2.5")
# the corners of cells, by number
SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
TRIANGLE = SQUARE[[0, 1, 3]]


def mesh_of(name):
    points, faces, tags = (CAGES | TRIANGLES)[name]
    return ls.Mesh(points, faces, **tags)


def surface_of(name, exact=False):
    mesh = mesh_of(name)
    scheme = LOOP if name in TRIANGLES else None
    return ls.LimitSurface(exactly(mesh) if exact else mesh, scheme=scheme)


def exactly(mesh):
    return mesh.with_points(numbers.RATIONAL.array(mesh.points))


def bernstein_polynomials(t):
    return np.array([comb(3, i) * t**i * (1 - t) ** (3 - i) for i in range(4)])


def places(patches, s, t):
    """(u, v) of s, t in each rectangle; in Fractions if these are."""
    origin, size = patches.origin, patches.size
    if isinstance(s, F):
        origin, size = numbers.RATIONAL.array(origin), numbers.RATIONAL.array(size)
    return origin[:, 0] + size[:, 0] * s, origin[:, 1] + size[:, 1] * t


def polynomial(patches, s, t):
    if patches.points.shape[1] == 15:
        rest, places = 1 - s - t, [(i, j) for j in range(5) for i in range(5 - j)]
        terms = [comb(4, i) * comb(4 - i, j) * s**i * t**j * rest ** (4 - i - j) for i, j in places]
        return np.tensordot(np.array(terms), patches.points, (0, 1))
    along, across = bernstein_polynomials(s), bernstein_polynomials(t)
    points = patches.points.reshape(
        *patches.points.shape[:3], int(np.prod(patches.points.shape[3:]))
    )
    terms = points * along[:, None, None] * across[:, None]
    return terms.sum(axis=(1, 2)).reshape(len(patches), *patches.points.shape[3:])


def from_corner(corners, corner, s, t):
    """(u, v) of s along the side after each corner, t along that before it."""
    n = len(corners)
    along, across = corners[(corner + 1) % n], corners[corner - 1]
    return corners[corner] + s * (along - corners[corner]) + t * (across - corners[corner])


def gap(surface, patches):
    """The largest distance from the surface, in units of the cage's size and of last digits."""
    largest = 0.0
    for s, t in ((0, 0), (0.3, 0.8), (1, 0.6)):
        if patches.degree == 4:  # a triangle is half of the square
            s, t = s / 2, t / 2
        found, wanted = (
            polynomial(patches, s, t),
            surface.evaluate(patches.face, *places(patches, s, t)),
        )
        largest = max(largest, float(np.abs(found - wanted).max(initial=0)))
    size = np.ptp(surface.points[np.unique(surface.mesh.indices)], axis=0).max()
    return largest / (1e-14 * size + 4 * np.spacing(np.abs(surface.points).max()))


# --- On all cages


@pytest.mark.parametrize("name", [*CAGES, *list(TRIANGLES)[::3]])
def test_floats_on_the_zoo(name):
    surface = surface_of(name)
    patches = ls.bezier_patches(surface, depth=4, weights=True)
    rest, n = patches.rest, len(surface.limit_faces)
    corners = TRIANGLE if name in TRIANGLES else SQUARE
    assert patches.degree == (4 if name in TRIANGLES else 3)
    assert gap(surface, patches) < 1
    # rows over the cage
    W = patches.weights
    assert W.shape == (len(patches.exponents) * len(patches), len(surface.points))
    assert np.abs(W @ surface.points - patches.points.reshape(-1, 3)).max(initial=0) < 1e-13
    assert np.abs(W.sum(axis=1) - 1).max(initial=0) < 1e-14
    # cells and rest tile each limit face that has one, and any place is in one of them
    area = np.zeros(n)
    for x in (patches, rest):
        ends = x.origin[:, None] + x.size[:, None] * corners
        assert (ends >= 0).all()
        assert (ends <= 1).all()
        assert len(corners) == 4 or (ends.sum(axis=2) <= 1).all()
        np.add.at(area, x.face, x.size.prod(axis=1))
    limit = ~np.isnan(surface.evaluate(np.arange(n), 0.5, 0.5)[:, 0])
    assert (area == limit).all()
    u, v = np.random.default_rng(0).random((2, n)) ** 3
    if len(corners) == 3:
        u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    times = np.zeros(n)
    for x in (patches, rest):
        place = (np.stack([u, v], axis=1)[x.face] - x.origin) / x.size
        inside = ((place > 0) & (place < 1)).all(axis=1)
        np.add.at(times, x.face, inside & ((place.sum(axis=1) < 1) | (len(corners) == 4)))
    assert (times == limit).all()
    # the rest is where it says, and within its bounds, which are close
    values = []
    for s, t in ((0, 0), (0.5, 0.25), (1e-3, 1e-2), (1, 0), (0, 1), (1, 1))[: len(corners) + 2]:
        away = from_corner(corners, rest.corner, s, t)
        values.append(surface.evaluate(rest.face, *(rest.origin + rest.size * away).T))
    allowed = 1e-14 * np.abs(surface.points).max()
    assert (np.min(values, axis=0, initial=np.inf) >= rest.lower - allowed).all()
    assert (np.max(values, axis=0, initial=-np.inf) <= rest.upper + allowed).all()
    extent = np.ptp(values, axis=0).max(axis=1, initial=0) if len(rest) else np.zeros(0)
    assert ((rest.upper - rest.lower).max(axis=1, initial=0) <= 4 * extent + 1e-12).all()


@pytest.mark.parametrize("name", [*list(CAGES)[::3], *ROWS, *(f"loop_{x}" for x in RATIONAL)])
def test_fractions_on_the_zoo(name):
    """Equality without a tolerance, of a few faces; corners that cells share are the same."""
    mesh, surface = mesh_of(name), surface_of(name, exact=True)
    corners = TRIANGLE if name in TRIANGLES else SQUARE
    rng = random.Random(name)
    face = rng.sample(range(len(surface.limit_faces)), min(3, len(surface.limit_faces)))
    patches = ls.bezier_patches(surface, face=face, depth=2, weights=name in ROWS)
    s, t = F(rng.randint(1, 9), 10), F(rng.randint(1, 9), 10)
    if len(corners) == 3 and s + t > 1:
        s, t = 1 - s, 1 - t
    assert same(patches.evaluate(s, t), polynomial(patches, s, t))
    assert same(polynomial(patches, s, t), surface.evaluate(patches.face, *places(patches, s, t)))
    if patches.weights is not None:
        assert same(patches.weights @ surface.points, patches.points.reshape(-1, 3))
    ends = {}
    degree = patches.degree
    points = patches.points.reshape(len(patches), len(patches.exponents), 3)
    for i, j in corners:
        u, v = places(patches, int(i), int(j))
        (at,) = np.flatnonzero((patches.exponents == (degree * i, degree * j)).all(axis=1))
        for place, point in zip(
            zip(patches.face.tolist(), u, v, strict=True), points[:, at], strict=True
        ):
            assert tuple(ends.setdefault(place, point)) == tuple(point), (i, j)
    rest = patches.rest
    values = surface.evaluate(rest.face, *places(rest, s, t))
    assert ((rest.lower <= values) & (values <= rest.upper)).all()
    # float64 is near, and its bounds are wider
    floats = ls.bezier_patches(surface_of(name), face=face, depth=2)
    wanted = patches.points.astype(float)
    size = np.ptp(mesh.points, axis=0).max()
    assert (np.abs(floats.points - wanted) <= 1e-14 * size + 2 * np.spacing(np.abs(wanted))).all()
    assert (floats.rest.lower <= rest.lower).all()
    assert (floats.rest.upper >= rest.upper).all()
    for x, y in zip((floats.rest.lower, floats.rest.upper), (rest.lower, rest.upper), strict=True):
        assert np.abs(x - y.astype(float)).max(initial=0) < 1e-11 * size
    for x, y in ((floats, patches), (floats.rest, rest)):
        for field in ("face", "origin", "size"):
            assert np.array_equal(getattr(x, field), getattr(y, field))


@pytest.mark.parametrize("name", ["cube", "flower_5_wide", "half_disk_5", "heptagon"])
def test_against_the_oracle(name):
    points, faces, _ = CAGES[name]
    oracle = oracles.ExactSurface(points, faces)
    patches = ls.bezier_patches(ls.LimitSurface(exactly(ls.Mesh(points, faces))), face=0, depth=3)
    s, t = F(1, 3), F(5, 7)
    wanted = [oracle.evaluate(0, u, v) for u, v in zip(*places(patches, s, t), strict=True)]
    assert same(polynomial(patches, s, t), wanted)


@pytest.mark.parametrize("name", ["crowded", "disc_4", "grid_3x2", "dart_3", "semi_2.5", "disc_5"])
def test_triangles_against_the_oracle(name):
    """Exactly; where weights of Loop are no rational numbers, to rounding."""
    points, faces, tags = TRIANGLES[f"loop_{name}"]
    cage = oracles_creases.Cage(points.tolist(), faces, **tags)
    oracle, exact = oracles_loop.LoopSurface(cage), name != "disc_5"
    patches = ls.bezier_patches(surface_of(f"loop_{name}", exact), face=[0, 1], depth=3)
    s, t = F(1, 3), F(3, 7)
    u, v = places(patches, s, t)
    wanted = [oracle.evaluate(*x) for x in zip(patches.face.tolist(), u, v, strict=True)]
    if exact:
        assert same(polynomial(patches, s, t), wanted)
    else:
        gaps = np.abs(patches.evaluate(s, t) - np.array(wanted)).astype(float)
        assert gaps.max() <= 1e-14 * np.ptp(points, axis=0).max()


def test_the_volume_of_a_tetrahedron():
    """The known one, all rings of all corners summed: to the last digit of its 17."""
    mesh = ls.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], zoo.tetrahedron()[1])
    middle = mesh.with_points(numbers.RATIONAL.array(mesh.points) - F(1, 4))
    patches = ls.bezier_patches(ls.LimitSurface(middle, scheme=LOOP), face=0, depth=18)
    # corners are alike, as seen from the middle: one of them, and the piece between them
    at_corner = (patches.origin + patches.size / 3).sum(axis=1) < 0.5
    volumes = Counter()
    for k in np.flatnonzero(at_corner | (patches.size[:, 0] == -0.5)):
        volumes[float(abs(patches.size[k, 0]))] += cone(patches.points[k])
    between, *rings = (volumes[0.5**n] for n in range(1, 19))
    # ring n is a sum of products of three eigenvalues to the power of n, of which one may be 1: of
    # 1/4, 1/8, and 1/16 in a Jordan block: 2^-4n, 2^-5n, then with factors of 1 and n to 2^-12n
    series = [F(1)]
    for k in (4, 5, *range(6, 13), *range(6, 13)):
        series = [a - b / 2**k for a, b in zip([*series, F(0)], [F(0), *series], strict=True)]
    terms = [
        sum(series[i] * rings[n - i] for i in range(min(n + 1, len(series))))
        for n in range(len(rings))
    ]
    assert terms[16] == 0
    volume = 4 * (between + 3 * sum(terms) / sum(series))
    # by the edge 1 it is larger by the root of 2 less
    assert abs(volume) == oracles_loop.TETRAHEDRON_VOLUME


def triangular(degree):
    """Exponents, and multinomial coefficients, of Bernstein polynomials on a triangle."""
    places = [(i, j, degree - i - j) for j in range(degree + 1) for i in range(degree + 1 - j)]
    return places, [factorial(degree) // prod(map(factorial, place)) for place in places]


@cache
def integrals():
    """12! times those of a Bernstein polynomial of degree 4 and two of degree 3, (15, 10, 10)."""
    quartics, cubics = (list(zip(*triangular(degree), strict=True)) for degree in (4, 3))
    terms = [
        c * prod(map(factorial, map(sum, zip(*places, strict=True))))
        for three in product(quartics, cubics, cubics)
        for places, c in [([x for x, _ in three], prod(x for _, x in three))]
    ]
    return np.array(terms, dtype=object).reshape(15, 10, 10)


def cone(points):
    """Volume between a patch of degree 4 (15, 3) and the origin, with its sign."""
    unit = lcm(*(x.denominator for x in points.ravel()))
    whole = np.array([[int(unit * x) for x in point] for point in points], dtype=object)
    at = dict(zip(triangular(4)[0], whole, strict=True))
    ds, dt = (
        np.array([4 * (at[i + x, j + 1 - x, k] - at[i, j, k + 1]) for i, j, k in triangular(3)[0]])
        for x in (1, 0)
    )
    total = sum(
        sign * (((integrals() @ dt[:, z]) @ ds[:, y]) @ whole[:, x])
        for sign, axes in ((1, (0, 1, 2)), (-1, (2, 1, 0)))
        for x, y, z in (axes, axes[1:] + axes[:1], axes[2:] + axes[:2])
    )
    return F(total, 3 * factorial(12) * unit**3)


# --- What coefficients are


@pytest.mark.parametrize("turn", range(4))
def test_quadrics_by_hand(turn):
    """Control heights i^2 - 1/3 give x^2, i j give x y; whichever corner a face begins with."""
    heights = [(i, j, i * i - F(1, 3), i * j) for j in range(-1, 3) for i in range(-1, 3)]
    quads = [[k, k + 1, k + 5, k + 4] for k in (0, 1, 2, 4, 5, 6, 8, 9, 10)]
    quads[4] = quads[4][turn:] + quads[4][:turn]
    surface = ls.LimitSurface(ls.Mesh(np.array(heights, dtype=object), quads))
    patches = ls.bezier_patches(surface, face=4)
    line, square = [0, F(1, 3), F(2, 3), 1], [0, 0, F(1, 3), 1]
    wanted = np.empty((4, 4, 4), dtype=object)  # by x and y
    for i in range(4):
        for j in range(4):
            wanted[i, j] = line[i], line[j], square[i], line[i] * line[j]
    for _ in range(turn):  # u is along y then, and v against x
        wanted = wanted.swapaxes(0, 1)[:, ::-1]
    assert same(patches.points, wanted[None])
    assert len(patches.rest) == 0


def test_a_boundary_and_a_corner():
    """The patch of one quad, whose corners stay: coefficients are those of two cubic splines."""
    square = ls.Mesh([[0, 0], [6, 0], [6, 6], [0, 6]], [[0, 1, 2, 3]])
    patches = ls.bezier_patches(ls.LimitSurface(exactly(square)))
    assert same(patches.points[0, :, 0, 0], [0, 2, 4, 6])
    assert same(patches.points[0, 0, :, 1], [0, 2, 4, 6])


def test_strips_are_rectangles():
    surface = ls.LimitSurface(mesh_of("tagged_crossing_rings_2.5"))
    patches = ls.bezier_patches(surface)
    narrow = patches.size[:, 0] != patches.size[:, 1]
    strips = patches.size[narrow].min(axis=1) / patches.size[narrow].max(axis=1)
    assert set(strips) == {0.5, 0.25, 0.125}


def test_depth_counts_from_the_edges_of_the_cage():
    """What remains at a vertex is of one size on quads, split quads and n-gons."""
    mesh = mesh_of("truncated_cube")
    surface = ls.LimitSurface(mesh)
    for depth in (3, 7):
        rest = ls.bezier_patches(surface, depth=depth).rest
        n_gon = surface.limit_faces.corner[rest.face] >= 0
        assert n_gon.any()
        assert (rest.size == np.where(n_gon, 2.0, 1.0)[:, None] * 0.5**depth).all()
    # until corners are apart there are no rings
    cube = ls.LimitSurface(mesh_of("cube"))
    for depth in (0, 1):
        found = ls.bezier_patches(cube, depth=depth)
        assert len(found) == 0
        assert (found.rest.size == 0.5).all()
    assert (ls.bezier_patches(cube).rest.size == 0.5**8).all()


@pytest.mark.parametrize("name", ["tagged_mixed_carved_grid_uniform", "loop_tagged_sphere_0"])
def test_some_faces_in_any_order(name):
    surface = surface_of(name)
    whole = ls.bezier_patches(surface, depth=4, weights=True)
    face = np.random.default_rng(0).permutation(len(surface.limit_faces))[:7]
    some = ls.bezier_patches(surface, face=face, depth=4, weights=True)
    for x, y in ((some, whole), (some.rest, whole.rest)):
        place = np.concatenate([np.flatnonzero(y.face == f) for f in face])
        assert np.array_equal(x.face, y.face[place])
        for field in ("origin", "size", *(["points"] if x is some else ["lower", "corner"])):
            assert np.array_equal(getattr(x, field), getattr(y, field)[place])
    each = len(whole.exponents)
    rows = (each * np.concatenate([np.flatnonzero(whole.face == f) for f in face]))[:, None]
    assert (some.weights != whole.weights[(rows + np.arange(each)).ravel()]).nnz == 0
    single = ls.bezier_patches(surface, face=int(face[0]), depth=4)
    assert np.array_equal(single.points, some.points[: len(single)])
    empty = ls.bezier_patches(surface, face=[], weights=True)
    assert (len(empty), len(empty.rest), empty.weights.shape[0]) == (0, 0, 0)
    assert empty.points.shape == (0, *whole.points.shape[1:])
    assert empty.evaluate([0, 1], 0).shape == (0, 2, 3)


@pytest.mark.parametrize("scheme", [None, LOOP])
def test_columns_and_channels(scheme):
    points, faces = zoo.tetrahedron() if scheme else zoo.cube()
    values = np.random.default_rng(0).random((14, 2))
    index = np.arange(sum(map(len, faces))) % 14
    mesh = ls.Mesh(points, faces, channels={"uv": (values, index, "corners_only")})
    surface = ls.LimitSurface(mesh, scheme=scheme)
    patches = ls.bezier_patches(surface, channel="uv", depth=3, weights=True)
    shape = (15,) if scheme else (4, 4)
    assert patches.points.shape[1:] == (*shape, 2)
    value = surface.evaluate(patches.face, *places(patches, 0.2, 0.7), channel="uv")
    assert np.allclose(polynomial(patches, 0.2, 0.7), value, atol=1e-14, rtol=0)
    # over the values as they were given, of which some are at several vertices
    flat = patches.points.reshape(-1, 2)
    assert np.allclose(patches.weights @ values, flat, atol=1e-14, rtol=0)
    rational = np.array([[F(*x.as_integer_ratio()) for x in row] for row in values.tolist()])
    exact = ls.Mesh(points, faces, channels={"uv": (rational, index, "corners_only")})
    if scheme is None:
        patches = ls.bezier_patches(ls.LimitSurface(exact), channel="uv", depth=1, weights=True)
        flat = patches.points.reshape(-1, 2)
        assert (patches.weights @ exact.channels["uv"][0] == flat).all()
    wide = np.random.default_rng(0).random((len(points), 2, 5))
    surface = surface.with_points(wide)
    patches = ls.bezier_patches(surface, depth=3)
    assert patches.points.shape[1:] == (*shape, 2, 5)
    value = surface.evaluate(patches.face, *places(patches, 0.2, 0.7))
    assert np.allclose(polynomial(patches, 0.2, 0.7), value, atol=1e-14, rtol=0)
    found = patches.evaluate([[0.2], [0.1]], 0.7)
    assert found.shape == (len(patches), 2, 1, 2, 5)
    assert np.allclose(found[:, 0, 0], value, atol=1e-14, rtol=0)
    line = ls.bezier_patches(surface.with_points(wide[:, 0, 0]))
    assert line.points.shape[1:] == shape
    assert line.rest.lower.shape == (len(line.rest),)


# --- Accuracy and bounds


@pytest.mark.parametrize("name", ["local_cage_7", "tagged_crease_3_3", "loop_disc_4", "loop_fan_3"])
def test_deep_and_far(name):
    """Far from the origin, 52 rings deep, and at coordinates whose sums overflow."""
    mesh, scheme = mesh_of(name), LOOP if name in TRIANGLES else None
    corners = SQUARE if scheme is None else TRIANGLE
    for change in (lambda x: x + 1e6, lambda x: x * 2.0**1020, lambda x: x * 2.0**-1020):
        moved = mesh.with_points(change(mesh.points))
        found, wanted = (
            ls.bezier_patches(ls.LimitSurface(x, scheme=scheme), face=0, depth=52)
            for x in (moved, exactly(moved))
        )
        value = wanted.points.astype(float)
        size = np.ptp(moved.points, axis=0).max()
        allowed = 1e-14 * size + 2 * np.spacing(np.abs(value))
        errors = np.abs((numbers.RATIONAL.array(found.points) - wanted.points).astype(float))
        assert (errors <= allowed).all()
        assert (found.rest.lower <= wanted.rest.lower).all()
        assert (found.rest.upper >= wanted.rest.upper).all()
        corner = found.rest.origin + found.rest.size * corners[found.rest.corner]
        assert np.array_equal(corner, np.rint(corner))


@pytest.mark.parametrize("kind", KINDS)
def test_shared_rings(kind, monkeypatch):
    """The same patches, rows and bounds as from eigenbases, for both number types."""
    mesh = around(kind, 12)
    face = [0, 5, 11]
    found = []
    for most in (12, 8):
        for module in (tables, tables.masks):
            monkeypatch.setattr(module, "MOST_FACES", most)
        surface = ls.LimitSurface(mesh)
        assert bool(surface.patches.rings) == (most == 8)
        found.append(ls.bezier_patches(surface, face=face, depth=5, weights=True))
    exact = ls.bezier_patches(ls.LimitSurface(exactly(mesh)), face=face, depth=5)
    one, other = found
    for x in found:
        assert np.abs(x.points - exact.points.astype(float)).max() < 1e-14
        assert (x.rest.lower <= exact.rest.lower).all()
        assert (x.rest.upper >= exact.rest.upper).all()
    assert np.abs(one.weights - other.weights).max() < 1e-14
    # hulls of whole rings are a little wider than those of a face's control points
    assert ((other.rest.upper - other.rest.lower) < 2 * (one.rest.upper - one.rest.lower)).all()


def test_bounds_for_negative_masks():
    """Where masks are no convex combinations, bounds come from sizes of eigenfunctions."""
    a, usual = F(-1, 4), CATMULL_CLARK.vertex_mask
    own = a, (1 - a) / 10, (1 - a) / 10
    scheme = altered(vertex=lambda N: own if N == 5 else usual(N))
    surface = ls.LimitSurface(mesh_of("local_cage_5"), scheme=scheme)
    rest = ls.bezier_patches(surface, face=[0, 4, 8], depth=2).rest
    assert len(rest) == 3
    u, v = np.random.default_rng(0).random((2, 400, 1)) ** 4
    corner = SQUARE[rest.corner]
    values = surface.evaluate(
        rest.face,
        rest.origin[:, 0] + rest.size[:, 0] * np.abs(corner[:, 0] - u),
        rest.origin[:, 1] + rest.size[:, 1] * np.abs(corner[:, 1] - v),
    )
    assert (rest.lower <= values).all()
    assert (rest.upper >= values).all()
    assert np.isfinite(rest.upper).all()
    exact = ls.LimitSurface(exactly(surface.mesh), scheme=scheme)
    assert (ls.bezier_patches(exact, face=0, depth=1).rest.upper == np.inf).all()


# --- Mistakes


@pytest.mark.parametrize("name", ["carved_torus", "loop_sphere_1"])
@pytest.mark.parametrize("mistake", ["control", "turn", "piece"])
def test_a_wrong_index_shows(mistake, name, monkeypatch):
    true, surface = surface_of(name), surface_of(name)
    assert gap(true, ls.bezier_patches(surface, depth=3)) < 1
    if mistake == "control":
        control = surface.patches.controls[REGULAR]
        control[:, [0, 1]] = control[:, [1, 0]]
    elif mistake == "turn":
        turned = cells._turned
        sides = 3 if name in TRIANGLES else 4
        monkeypatch.setattr(cells, "_turned", lambda form, x, turn: turned(form, x, -turn % sides))
    else:
        pieces = cover._cells
        monkeypatch.setattr(cover, "_cells", lambda *args: [x[::-1] for x in pieces(*args)])
    assert gap(true, ls.bezier_patches(surface, depth=3)) > 1e6


def test_bad_calls():
    surface = ls.LimitSurface(mesh_of("cube"))
    for face, error, text in (
        (6, IndexError, "limit face 6 at index 0 is out of range: there are 6, 0 to 5"),
        ([0, -1, 9], IndexError, r"limit face -1 at index 1 \(1 more like it\)"),
        ([0.5], TypeError, "faces must be integers, got float64"),
        ([True], TypeError, "faces must be integers, got bool"),
    ):
        with pytest.raises(error, match=text):
            ls.bezier_patches(surface, face=face)
    for depth, error in ((-1, ValueError), (53, ValueError), (1.5, ValueError)):
        with pytest.raises(error, match="depth"):
            ls.bezier_patches(surface, depth=depth)
    with pytest.raises(ValueError, match="nothing"):
        ls.bezier_patches(surface, channel="nothing")
    with pytest.raises(TypeError, match="LimitSurface"):
        ls.bezier_patches(surface.mesh)
