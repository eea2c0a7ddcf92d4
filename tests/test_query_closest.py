"""Closest points, feet, signs and bounds, against hulls of refined cages and roots of quadrics."""

import gc
import pickle
import weakref

import mpmath
import numpy as np
import pytest
import zoo
import zoo_triangles
from test_every_scheme import KINDS

import limitsurf as ls
from limitsurf.query import closest, nearby, nearest, sides
from limitsurf.query.index import Cells
from limitsurf.query.traversal import kernels_for

CUBE = zoo.cube()
CUBE[0].setflags(write=False)
SIDES = [[f[k], f[(k + 1) % 4]] for f in CUBE[1] for k in range(4)]
SHARP = {tuple(sorted(edge)): np.inf for edge in SIDES}


@pytest.fixture(autouse=True)
def by_kernels(monkeypatch):
    """Surfaces that NumPy evaluates are searched by kernels all the same."""
    monkeypatch.setattr(closest, "kernels_for", lambda _, *known: kernels_for("compiled", *known))


@pytest.fixture
def numpy_alone(monkeypatch):
    """Search by NumPy."""
    return lambda: monkeypatch.setattr(closest, "kernels_for", lambda *_: None)


def made(points_and_faces, **options):
    points, faces, *tags = points_and_faces
    return ls.LimitSurface(
        ls.Mesh(np.asarray(points, dtype=float), faces, **(tags[0] if tags else {})),
        engine="reference", **options,
    )  # fmt: skip


def fan(valence, seed=0):
    """A bent disc of quads around one vertex, in two rings."""
    rng, turn = np.random.default_rng(seed), np.pi * np.arange(2 * valence) / valence
    around = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    rim = np.where(np.arange(2 * valence) % 2, 1.4, 1.0)[:, None] * around
    flat = np.concatenate([[[0, 0]], rim, 2.2 * around])
    height = np.concatenate([[0.3], 0.1 * rng.normal(size=4 * valence)])
    n, k = 2 * valence, np.arange(2 * valence)
    inner = [[0, 1 + i, 2 + i, 1 + (i + 2) % n] for i in range(0, n, 2)]
    outer = np.stack([1 + k, n + 1 + k, n + 1 + (k + 1) % n, 1 + (k + 1) % n], axis=1)
    return np.column_stack([flat, height]), inner + outer.tolist()


CAGES = {
    "cube": lambda: made(CUBE),
    "sharp": lambda: made((*CUBE, {"creases": SHARP})),
    "semi": lambda: made((*CUBE, {"creases": {(0, 1): 1.5, (1, 3): 0.7}})),
    "dart": lambda: made((*CUBE, {"creases": {(0, 1): np.inf}, "corners": {6: 2.5}})),
    "ngons": lambda: made(zoo.prism(5)),
    "open": lambda: made(zoo.grid(3, 4)),
    "pole": lambda: made(fan(7)),
    "crowded": lambda: made(fan(66)),
    "ball": lambda: made(zoo.ball(6, 3)),
    "loop": lambda: made(zoo_triangles.ZOO["torus_3x4"](), scheme="loop"),
    "loop_open": lambda: made(zoo_triangles.ZOO["grid_3x2"](), scheme="loop"),
    "loop_dart": lambda: made(zoo_triangles.TAGGED["dart_4"](), scheme="loop"),
}


def places(surface, n, seed):
    """Random places of limit faces."""
    rng = np.random.default_rng(seed)
    face, (u, v) = rng.integers(0, len(surface.limit_faces), n), rng.random((2, n))
    if surface.topology.lattice.sloped:
        u, v = np.where(u + v > 1, [1 - u, 1 - v], [u, v])
    return face, u, v


def queries(surface, n=24, seed=1):
    """Points on a surface, beside it, and around it."""
    rng, points = np.random.default_rng(seed), surface.points
    low, high = points.min(axis=0), points.max(axis=0)
    on = surface.evaluate(*places(surface, n, seed))
    beside = on + 0.02 * (high - low).max() * rng.normal(size=(n, 3))
    around = low + (high - low) * (1.6 * rng.random((n, 3)) - 0.3)
    return np.concatenate([on, beside, around])


def hulls(surface, levels):
    """Boxes of refined faces with their rings, which hold the limit faces."""
    mesh = ls.refined(surface.mesh, levels, **surface.rules)
    offsets, face = mesh.offsets, np.repeat(np.arange(mesh.n_faces), mesh.sizes)
    order = np.argsort(mesh.indices, kind="stable")
    start = np.searchsorted(mesh.indices[order], np.arange(mesh.n_vertices + 1))
    low = np.full((mesh.n_vertices, 3), np.inf)
    high = -low
    own = mesh.points[mesh.indices]
    least = np.minimum.reduceat(own, offsets[:-1])
    most = np.maximum.reduceat(own, offsets[:-1])
    used = np.flatnonzero(np.diff(start))
    low[used] = np.minimum.reduceat(least[face[order]], start[used])
    high[used] = np.maximum.reduceat(most[face[order]], start[used])
    at = mesh.indices
    return (
        np.minimum.reduceat(low[at], offsets[:-1]),
        np.maximum.reduceat(high[at], offsets[:-1]),
        mesh.limit_points,
    )


@pytest.mark.parametrize("name", CAGES)
def test_distance_is_between_certified_bounds(name):
    surface = CAGES[name]()
    asked = queries(surface)
    found = ls.closest_point(surface, asked)
    assert (found.point == surface.evaluate(found.face, found.u, found.v)).all()
    size = np.abs(surface.points).max()
    low, high, limits = hulls(surface, 3 if len(surface.limit_faces) < 80 else 1)
    gap = np.maximum(np.maximum(low - asked[:, None], asked[:, None] - high), 0)
    least = np.sqrt((gap**2).sum(axis=2)).min(axis=1)
    reached = np.sqrt(((limits - asked[:, None]) ** 2).sum(axis=2))
    assert (found.distance >= least - 1e-13 * size).all()
    assert (found.distance <= np.nanmin(reached, axis=1) + 1e-13 * size).all()
    on = found.distance[:24]
    assert on.max() <= 1e-13 * size
    # it cannot be nearer on any limit face next to the foot: the way there is a perpendicular
    inside = (np.minimum(found.u, found.v) > 0) & (np.maximum(found.u, found.v) < 1)
    if surface.topology.lattice.sloped:
        inside &= found.u + found.v < 1
    away = (asked - found.point)[inside & (found.distance > 1e-3 * size)]
    where = [x[inside & (found.distance > 1e-3 * size)] for x in (found.face, found.u, found.v)]
    for tangent in surface.tangents(*where):
        slope = np.nan_to_num((away * tangent).sum(axis=1))
        assert np.abs(slope).max(initial=0) <= 1e-12 * size


@pytest.mark.parametrize("shape", [(0.3, 0.2, 0.1), (0.5, -0.4, 0), (0, 0, 0)])
def test_feet_on_a_quadric_are_roots(shape):
    # heights of which the limit is z = a x^2 + b y^2 + c x y, away from the boundary
    a, b, c = shape
    i, j = (x.ravel() - 5.0 for x in np.mgrid[:11, :11])
    points = np.stack([i, j, a * (i * i - 1 / 3) + b * (j * j - 1 / 3) + c * i * j], axis=1)
    surface = made((points, zoo.grid(10, 10)[1]))
    rng = np.random.default_rng(3)
    foot = rng.uniform(-2.5, 2.5, (8, 2))
    z = a * foot[:, 0] ** 2 + b * foot[:, 1] ** 2 + c * foot[:, 0] * foot[:, 1]
    on = np.column_stack([foot, z])
    normal = np.column_stack(
        [-2 * a * foot[:, 0] - c * foot[:, 1], -2 * b * foot[:, 1] - c * foot[:, 0], 1 + 0 * z]
    )
    asked = on + rng.uniform(-0.25, 0.25, (8, 1)) * normal
    found = ls.closest_point(surface, asked)
    with mpmath.workdps(50):
        for q, p, d in zip(asked, found.point, found.distance, strict=True):
            q0, q1, q2 = map(mpmath.mpf, q.tolist())

            def slope(x, y, q0=q0, q1=q1, q2=q2):
                h = a * x * x + b * y * y + c * x * y - q2
                return x - q0 + h * (2 * a * x + c * y), y - q1 + h * (2 * b * y + c * x)

            x, y = mpmath.findroot(slope, tuple(p[:2].tolist()))
            true = mpmath.matrix([x, y, a * x * x + b * y * y + c * x * y])
            far = mpmath.norm(true - mpmath.matrix([q0, q1, q2]))
            assert abs(far - d) < 1e-13 * 5
            assert mpmath.norm(true - mpmath.matrix(p.tolist())) < 1e-10
    # and these are nearest: nothing is nearer on a fine grid of the true graph
    x, y = np.meshgrid(np.linspace(-4, 4, 801), np.linspace(-4, 4, 801))
    graph = np.stack([x, y, a * x * x + b * y * y + c * x * y], axis=-1)
    for q, d in zip(asked, found.distance, strict=True):
        assert np.sqrt(((graph - q) ** 2).sum(axis=-1)).min() >= d - 1e-12


@pytest.mark.parametrize("valence", [3, 5, 6, 8, 16, 64])
def test_at_and_beside_poles(valence):
    surface = made(fan(valence))
    pole, up = surface.evaluate(0, 0.0, 0.0), surface.normal(0, 0.0, 0.0)
    u, v = np.meshgrid(*2 * [np.linspace(0, 1, 7)])
    scale = 2.0 ** -np.arange(0, 54, 2)[:, None, None]
    near = surface.evaluate(np.arange(valence)[:, None, None, None], scale * u, scale * v)
    near = near.reshape(-1, 3)
    beside = np.repeat([0.0, 1e-300, 1e-6, 1e-3], 2)
    high = np.tile([0.05, -0.05], 4)
    start = ls.closest_point(surface, pole + beside[:, None] * np.array([0.6, 0.8, 0]))
    asked = start.point + high[:, None] * np.nan_to_num(start.normal)
    found = ls.closest_point(surface, asked)
    assert (found.distance <= np.abs(high) + 1e-15).all()
    brute = np.sqrt(((near - asked[:, None]) ** 2).sum(axis=2)).min(axis=1)
    assert (found.distance <= brute + 1e-15).all()
    if valence < 6:  # elsewhere curvature may grow towards it without bounds
        found = ls.closest_point(surface, pole + 0.05 * up)
        assert (found.face, found.u, found.v) == (0, 0, 0)


def test_distances_and_signs_of_a_box():
    surface = made((*CUBE, {"creases": SHARP}))
    asked = np.random.default_rng(0).uniform(-0.5, 1.5, (400, 3))
    # on symmetry planes too: feet on edges and vertices
    asked = np.concatenate([asked, np.round(4 * asked) / 4])
    beyond = np.abs(asked - 0.5) - 0.5
    true = np.sqrt((np.maximum(beyond, 0) ** 2).sum(axis=1)) + np.minimum(beyond.max(axis=1), 0)
    found = ls.closest_point(surface, asked, signed=True)
    assert np.abs(found.distance - true).max() < 1e-15
    # ties: of equally near ones the smallest limit face
    middle = ls.closest_point(surface, [0.5, 0.5, 0.5], signed=True)
    assert (middle.distance, middle.face, middle.u, middle.v) == (-0.5, 0, 0.5, 0.5)
    every = ls.feet(surface, [[0.5, 0.5, 0.5], [0.5, 2.0, 0.5], [2.0, 2.0, 2.0]], within=5)
    assert np.diff(every.offsets).tolist() == [6, 2, 1]
    assert every.face[:6].tolist() == [0, 1, 2, 3, 4, 5]
    assert np.allclose(every.distance, [0.5] * 6 + [1, 2, 3**0.5], rtol=0, atol=1e-15)


@pytest.mark.parametrize("name", ["cube", "dart", "ngons", "semi", "loop"])
def test_signs_are_those_of_the_solid_angle(name):
    surface = CAGES[name]()
    asked = queries(surface)[24:]
    found = ls.closest_point(surface, asked, signed=True)
    pieces = ls.tessellate(surface, 12, normals=False)
    corners = pieces.points[pieces.indices[pieces.triangles]]
    a, b, c = np.moveaxis(corners[None] - asked[:, None, None], 2, 0)
    x, y, z = (np.sqrt((p**2).sum(axis=2)) for p in (a, b, c))
    below = x * y * z + (a * b).sum(2) * z + (b * c).sum(2) * x + (c * a).sum(2) * y
    turns = np.arctan2((a * np.cross(b, c)).sum(axis=2), below).sum(axis=1) / (2 * np.pi)
    clear = np.abs(found.distance) > 0.02 * np.abs(surface.points).max()
    outwards = 1 if turns.sum() >= 0 else -1
    inside = np.abs(turns) > 0.5
    assert clear.sum() > 20
    assert (np.sign(found.distance[clear]) * outwards == np.where(inside, -1, 1)[clear]).all()


def test_feet_of_a_smooth_ball():
    surface = made(CUBE)
    middle = np.array([0.5, 0.5, 0.5])
    for shift, count in ((0, 6), (1e-9, 6), (0.05, 2)):
        found = ls.feet(surface, middle[None] + np.array([0, 0, shift]), within=1)
        assert len(found.face) == count
        assert sorted(found.face.tolist()) == ([0, 1] if count == 2 else list(range(6)))
    # a vertex that is nearest, once, and the far one not at all
    found = ls.feet(surface, [[2.0, 2.0, 2.0]], within=5)
    assert (found.face[0], found.u[0], found.v[0], len(found.face)) == (1, 1, 1, 1)
    with pytest.raises(ValueError, match=r"of shape \(n, 3\)"):
        ls.feet(surface, middle, within=1)
    assert len(ls.feet(surface, [[np.nan, 0, 0], middle], within=0.1).face) == 0


@pytest.mark.parametrize("name", ["dart", "loop_open", "pole"])
def test_moves_along(name):
    surface = CAGES[name]()
    asked = queries(surface, 10)
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    one, other = (
        ls.closest_point(s, q)
        for s, q in (
            (surface, asked),
            (surface.with_points(4 * surface.points @ turn.T + 1), 4 * asked @ turn.T + 1),
        )
    )
    assert np.allclose(4 * one.distance, other.distance, rtol=0, atol=1e-13)
    # powers of two change no digit, out to the ends of float64
    for power in (-600, 900):
        scaled = surface.with_points(np.ldexp(surface.points, power))
        found = ls.closest_point(scaled, np.ldexp(asked, power))
        assert (found.face == one.face).all()
        assert (found.u == one.u).all()
        assert np.allclose(np.ldexp(found.distance, -power), one.distance, rtol=1e-15, atol=1e-16)


def test_any_number_of_workers_and_chunks(monkeypatch):
    surface = CAGES["dart"]()
    asked = np.random.default_rng(5).random((300, 3))
    some = ls.closest_point(surface, asked.reshape(3, 100, 3))
    monkeypatch.setattr(closest, "_CHUNK", 128)
    all_, threaded = (ls.closest_point(surface, asked, workers=n) for n in (1, 2))
    for name in ("point", "distance", "face", "u", "v", "normal"):
        a, b, c = (getattr(x, name) for x in (all_, threaded, some))
        assert np.array_equal(a, b, equal_nan=True)
        assert np.allclose(a.reshape(c.shape), c, rtol=0, atol=1e-12, equal_nan=True)
    assert some.point.shape == (3, 100, 3)
    assert some.face.shape == (3, 100)


def test_one_index_a_surface():
    surface = CAGES["ngons"]()
    index = ls.SurfaceIndex(surface)
    assert Cells.of(surface) is index.cells is ls.SurfaceIndex(surface).cells
    moved = surface.with_points(surface.points + 1)
    assert ls.SurfaceIndex(moved).cells.order is index.cells.order
    copy = pickle.loads(pickle.dumps(index))
    assert (copy.cells.lower == index.cells.lower).all()
    assert copy.surface is not surface
    gone = weakref.ref(moved)
    del moved
    assert repr(index).startswith("SurfaceIndex(")
    gc.collect()
    assert gone() is None


@pytest.mark.parametrize(
    "name", ["crossed", "fins", "flat", "diagonal", "point", "collapsed", "holes"]
)
def test_degenerate_and_non_manifold(name):
    points, faces = CUBE
    points, tags = np.array(points, dtype=float), {}
    if name == "crossed":
        points, faces, *_ = zoo.crossed_grids()
    elif name == "fins":
        points, faces, *_ = zoo.fins(4)
    elif name == "flat":
        points = points * [1, 1, 0]
    elif name == "diagonal":  # faces that are a curve each, across which nothing changes
        faces = zoo.grid(3, 3)[1]
        points = np.add.outer(np.arange(4.0), np.arange(4.0)).reshape(-1, 1) ** [1, 2, 3] / 8
    elif name == "point":
        points = 0 * points + 2
    elif name == "collapsed":
        points[0] = points[1]
    else:
        tags["holes"] = [2, 3]
    surface = made((np.asarray(points, dtype=float), faces, tags))
    asked = queries(surface, 8)
    asked = asked[np.isfinite(asked).all(axis=1)]
    found = ls.closest_point(surface, asked)
    face = np.unique(found.face)
    u, v = np.meshgrid(*2 * [np.linspace(0, 1, 33)])
    near = surface.evaluate(np.arange(len(surface.limit_faces))[:, None, None], u, v).reshape(-1, 3)
    near = near[np.isfinite(near).all(axis=1)]
    brute = np.sqrt(((near - asked[:, None]) ** 2).sum(axis=2)).min(axis=1)
    size = max(np.abs(points).max(), 1)
    assert len(face)
    assert (found.distance <= brute + 1e-13 * size).all()
    assert (found.distance >= brute - 0.1 * size).all()


def test_bad_input():
    surface = made(CUBE)
    found = ls.closest_point(surface, [[np.nan, 0, 0], [0, np.inf, 0], [0.5, 0.5, 2]])
    assert found.face.tolist() == [-1, -1, 1]
    assert np.isnan(found.distance).tolist() == [1, 1, 0]
    assert np.isnan(found.point[:2]).all()
    assert np.isnan(found.u[:2]).all()
    near = ls.closest_point(surface, [[9.0, 9, 9], [0.5, 0.5, 1]], max_distance=1)
    assert near.face.tolist() == [-1, 1]
    assert np.isinf(near.distance[0])
    assert np.isnan(near.v[0])
    assert ls.closest_point(surface, np.zeros((0, 3))).face.shape == (0,)
    far = ls.closest_point(surface, [[1e300, 0.5, 0.5], [0.5, 0.5, -1e-300]])
    assert far.distance[0] == 1e300
    assert far.face[0] == 5
    assert far.distance[1] > 0
    for points, match in (([0, 1], r"\(\.\.\., 3\)"), (3.0, r"\(\.\.\., 3\)")):
        with pytest.raises(ValueError, match=match):
            ls.closest_point(surface, points)
    with pytest.raises(TypeError, match="real numbers"):
        ls.closest_point(surface, [["a", "b", "c"]])
    with pytest.raises(ValueError, match="0 or more"):
        ls.closest_point(surface, [0, 0, 0], max_distance=-1)
    with pytest.raises(TypeError, match="need a LimitSurface"):
        ls.closest_point(surface.mesh, [0, 0, 0])
    with pytest.raises(ValueError, match="n_vertices, 3"):
        ls.closest_point(made(([[0.0, 0], [1, 0], [1, 1]], [[0, 1, 2]])), [0, 0, 0])
    holes = made((*CUBE, {"holes": list(range(6))}))
    nothing = ls.closest_point(holes, [0.0, 0, 0])
    assert nothing.face == -1
    assert nothing.distance == np.inf
    assert np.isnan(nothing.normal).all()


def test_signs_need_a_closed_surface():
    points, faces = CUBE
    with pytest.raises(ValueError, match=r"vertices 0 and \d has a face on one side only"):
        ls.closest_point(made((points, faces[1:])), [0, 0, 0], signed=True)
    turned = [faces[0][::-1], *faces[1:]]
    with pytest.raises(ValueError, match=r"vertices 0 and \d is passed the same way"):
        ls.closest_point(made((points, turned)), [0, 0, 0], signed=True)
    with pytest.raises(ValueError, match="on one side only"):
        ls.closest_point(made((*CUBE, {"holes": [0]})), [0, 0, 0], signed=True)


@pytest.mark.parametrize("name", CAGES)
def test_bounds_hold_and_are_tight(name):
    surface = CAGES[name]()
    size = np.abs(surface.points).max()
    u, v = np.meshgrid(*2 * [np.linspace(0, 1, 17)])
    if surface.topology.lattice.sloped:
        u, v = u[u + v <= 1], v[u + v <= 1]
    face = np.arange(min(len(surface.limit_faces), 12))
    on = surface.evaluate(face[:, None], u.ravel(), v.ravel())
    for tolerance in (None, 1e-6):
        box = ls.bounds(surface, face, tolerance=tolerance)
        assert (box.lower <= on.min(axis=1)).all()
        assert (box.upper >= on.max(axis=1)).all()
    spare = np.maximum(on.min(axis=1) - box.lower, box.upper - on.max(axis=1))
    assert spare.max() <= 0.02 * size
    inside = (u >= 0.2) & (u <= 0.5) & (v >= 0.1) & (v <= 0.4)
    part = surface.evaluate(face[:, None], u[inside], v[inside])
    box = ls.bounds(surface, face, [0.2, 0.5], [0.1, 0.4], tolerance=1e-4)
    assert (box.lower <= part.min(axis=1)).all()
    assert (box.upper >= part.max(axis=1)).all()
    at = surface.evaluate(face, 0.3, 0.25)
    box = ls.bounds(surface, face, [0.3, 0.3], [0.25, 0.25], tolerance=1e-9)
    assert np.abs(np.stack([box.lower, box.upper]) - at).max() < 1e-13 * size
    slope = surface.evaluate(face[:, None], u[inside], v[inside], nu=(0, 1))
    box = ls.bounds(surface, face, [0.2, 0.5], [0.1, 0.4], nu=(0, 1), tolerance=1e-2)
    assert (box.lower <= slope.min(axis=1)).all()
    assert (box.upper >= slope.max(axis=1)).all()


def test_bounds_refuse():
    surface = made(CUBE)
    with pytest.raises(IndexError, match="limit face 6"):
        ls.bounds(surface, 6)
    with pytest.raises(ValueError, match="least first"):
        ls.bounds(surface, 0, [0.5, 0.2])
    with pytest.raises(ValueError, match="above 0"):
        ls.bounds(surface, tolerance=0.0)
    with pytest.raises(TypeError, match="tolerance must be a number, got str"):
        ls.bounds(surface, tolerance="x")
    box = ls.bounds(made((*CUBE, {"holes": [0]})))
    assert np.isinf(box.lower[0]).all()
    assert np.isfinite(box.lower[1:]).all()
    assert np.isinf(ls.bounds(surface, 0, nu=(2, 0)).upper).all()


def test_channels_are_surfaces_too():
    points, faces = CUBE
    corners = np.ravel(faces)
    channels = {
        "flow": (2 * np.asarray(points), corners, "none"),
        "one": (np.zeros((1, 1)), 0 * corners, "none"),
    }
    surface = ls.LimitSurface(ls.Mesh(points, faces, channels=channels), engine="reference")
    found = ls.closest_point(surface, [[1.0, 1, 4]], channel="flow")
    same = ls.closest_point(surface, [[0.5, 0.5, 2]])
    assert found.face.tolist() == [1]
    assert np.allclose(found.distance, 2 * same.distance, rtol=1e-14)
    twice, once = (ls.bounds(surface, 1, channel=x, tolerance=1e-6) for x in ("flow", None))
    assert np.allclose(twice.upper, 2 * once.upper, rtol=0, atol=4e-6)
    with pytest.raises(ValueError, match=r"values of shape \(n, 3\)"):
        ls.feet(surface, [[0.0, 0, 0]], within=1, channel="one")


def test_a_thin_surface_ends():
    # squared distances along its folds are long and narrow valleys, along no parameter
    rng = np.random.default_rng(0)
    points, faces, *_ = zoo_triangles.ZOO["torus_3x4"]()
    points = np.asarray(points, dtype=float)
    points = (points + rng.normal(size=points.shape) * np.ptp(points, axis=0).max() / 2) * [
        1, 0.01, 1,
    ]  # fmt: skip
    surface = made((points, faces), scheme="loop")
    asked = points.mean(axis=0) + rng.normal(size=(4, 3))[:2] * np.ptp(points, axis=0) * 0.3
    found = ls.closest_point(surface, asked)
    u, v = np.meshgrid(*2 * [np.linspace(0, 1, 65)])
    u, v = u[u + v <= 1], v[u + v <= 1]
    near = surface.evaluate(np.arange(len(surface.limit_faces))[:, None], u, v).reshape(-1, 3)
    brute = np.sqrt(((near - asked[:, None]) ** 2).sum(axis=2)).min(axis=1)
    assert (found.distance <= brute + 1e-13).all()
    assert (found.distance >= brute - 1e-3).all()


def test_memory_does_not_grow_with_pairs(monkeypatch, numpy_alone):
    numpy_alone()
    surface = ls.LimitSurface(ls.refined(ls.Mesh(*CUBE), levels=2), engine="reference")
    monkeypatch.setattr(nearest, "_BATCH", 256)
    seen = []

    def count(self, pairs):
        seen.append((len(pairs), sum(map(len, self._pending[0]))))

    monkeypatch.setattr(nearest.Search, "_cells", count)
    ls.feet(surface, np.full((50, 3), 0.5), within=2.0)  # all cells of all
    counts, pending = np.transpose(seen)
    assert counts.sum() >= 50 * len(surface.limit_faces)
    assert pending.max() <= 4 * 256


@pytest.mark.parametrize(
    ("name", "nu"), [("cube", (1, 0)), ("pole", (1, 1)), ("loop_dart", (0, 1))]
)
def test_bounds_of_derivatives_beside_special_corners(name, nu):
    surface = CAGES[name]()
    for low, high in ((1e-4, 0.05), (0.001, 0.0011)):
        u, v = np.meshgrid(*2 * [np.linspace(low, high, 9)])
        box = ls.bounds(surface, 0, [low, high], [low, high], nu=nu, tolerance=1e-3)
        slope = surface.evaluate(0, u.ravel(), v.ravel(), nu=nu)
        assert (box.lower <= slope.min(axis=0)).all()
        assert (box.upper >= slope.max(axis=0)).all()
        assert np.isfinite(box.lower).all()
    assert (box.upper - box.lower <= np.ptp(slope, axis=0) * 1.5 + 3e-3).all()


def test_points_on_a_closed_surface_are_outside(monkeypatch):
    cage = ls.Mesh(*CUBE, creases=SHARP)
    surface = ls.LimitSurface(ls.refined(cage, levels=1), engine="reference")
    monkeypatch.setattr(sides, "tessellate", None)  # no need of solid angles
    on = surface.evaluate(*places(surface, 60, 0))
    found = ls.closest_point(surface, on, signed=True)
    assert (np.signbit(found.distance) == 0).all()
    far = ls.closest_point(surface, [[0.5, 0.5, 0.5], [9, 9, 9]], signed=True, max_distance=0.1)
    assert (far.distance == np.inf).all()


def test_points_of_no_face_do_not_count():
    asked = queries(made(CUBE), 6)
    points = np.concatenate([CUBE[0], [[1e12] * 3]])
    one, other = (ls.closest_point(made((p, CUBE[1])), asked) for p in (CUBE[0], points))
    for name in ("distance", "face", "u", "v"):
        assert (getattr(one, name) == getattr(other, name)).all()
    box = ls.bounds(made((points, CUBE[1])), tolerance=1e-6)
    assert (box.upper - box.lower < 1).all()


def test_feet_are_no_saddles():
    # z = x y, from above: a saddle in the middle of a face, then on an edge
    for shift in (5.5, 5.0):
        i, j = (x.ravel() - y for x, y in zip(np.mgrid[:12, :12], (5.5, shift), strict=True))
        surface = made((np.stack([i, j, i * j], axis=1), zoo.grid(11, 11)[1]))
        found = ls.feet(surface, [[0, 0, 2.0]], within=2.1)
        assert np.allclose(found.distance, [3**0.5] * 2, rtol=0, atol=1e-13)


@pytest.mark.parametrize("scheme", ["catmull-clark", "doo-sabin", "bilinear"])
def test_feet_are_reported_once(scheme):
    surface = made(zoo.prism(5), scheme=scheme)
    if scheme == "doo-sabin":
        at = [(0, 0.0, 0.5), (0, 0.0, 0.0), (0, 1.0, 1.0)]
    else:
        at = [(0, 1.0, 0.5), (0, 1.0, 1.0), (1, 0.3, 1.0), (0, 0.4, 0.0)]
    face, u, v = np.transpose(at)
    on, normal = (f(face.astype(int), u, v) for f in (surface.evaluate, surface.normal))
    if scheme == "bilinear":
        on, normal = on[:3], normal[:3]
    found = ls.feet(surface, on + 0.01 * normal, within=0.0100001)
    assert np.diff(found.offsets).tolist() == [1] * len(on)
    assert np.abs(found.point - on).max() < 1e-9
    # and all along sides, where rounding puts feet beside them
    rng = np.random.default_rng(0)
    face, (u, v) = rng.integers(0, len(surface.limit_faces), 40), rng.random((2, 40))
    u = np.where(np.arange(40) % 2, u, np.round(u))
    v = np.where(np.arange(40) % 2, np.round(v), v)
    on, normal = (f(face, u, v) for f in (surface.evaluate, surface.normal))
    found = ls.feet(surface, on + 0.01 * normal, within=0.0100001)
    assert np.diff(found.offsets).tolist() == [1] * 40


@pytest.mark.parametrize("scheme", ["catmull-clark", "doo-sabin"])
def test_feet_on_boundaries(scheme):
    surface = made(zoo.grid(3, 3)[:2], scheme=scheme)
    asked = [[-2, 1.3, 0.5], [-1, -1, 0.3], [1.5, 5, 0]]
    found, near = ls.feet(surface, asked, within=5), ls.closest_point(surface, asked)
    assert np.diff(found.offsets).min() == 1
    first = found.offsets[:-1]
    assert np.allclose(found.distance[first], near.distance, rtol=0, atol=1e-14)
    assert (found.face[first] == near.face).all()


@pytest.mark.parametrize("scheme", ls.schemes.with_pieces)
def test_kernels_and_numpy_agree(scheme, numpy_alone):
    """The reference decides each place on its own way: also at vertices, on sides, in the middle.

    (Both are held against hulls and roots above; this is that one is as good as the other.)
    """
    known = KINDS[scheme]
    cages = [x for x in ("grid_3x3", "grid_4x4", "fan_7") if x in known.cages]
    asked = []
    for name in cages[: 1 if known.scheme.lattice.sloped else 2]:
        points, faces, *_ = known.cages[name]()
        surface = made((points, faces), scheme=known.scheme)
        u, v = np.array([0, 1, 0, 0.5, 0.25, 0.3]), np.array([0, 0, 0.5, 0.5, 0.25, 1e-9])
        on = surface.evaluate(np.arange(2)[:, None], u, v).reshape(-1, 3)
        rng, size = np.random.default_rng(2), np.ptp(surface.points, axis=0).max()
        near = on[::2] + 0.05 * size * rng.normal(size=(6, 3))
        middle = surface.points.mean(axis=0)
        asked.append((surface, np.concatenate([on, near, middle + size * rng.normal(size=(3, 3))])))
    found = [(ls.closest_point(*x), ls.feet(*x, within=0.3)) for x in asked]
    numpy_alone()
    for (surface, points), (one, feet) in zip(asked, found, strict=True):
        other, size = ls.closest_point(surface, points), np.abs(surface.points).max()
        assert np.abs(one.distance - other.distance).max() <= 1e-14 * size
        assert (one.face == other.face).all()
        assert np.abs(one.u - other.u).max() <= 1e-9
        assert np.abs(one.v - other.v).max() <= 1e-9
        others = ls.feet(surface, points, within=0.3)
        assert (feet.offsets == others.offsets).all()
        assert (feet.face == others.face).all()
        assert np.abs(feet.distance - others.distance).max(initial=0) <= 1e-14 * size


def test_places_in_slivers_are_on_the_surface():
    """Beside some corners derivatives are parallel but for 1e-6: valleys of squared distances."""
    known = KINDS["doo-sabin"]
    points, faces, *tags = known.cages["grid_edge_only"]()
    tags = {**(tags[0] if tags else {})}
    rules = {key: tags.pop(key) for key in ("boundary",) if key in tags}
    surface = made((points, faces, tags), scheme=known.scheme, **rules)
    u = [1e-13, 1 - 1e-6, 1e-13, 1e-6, 1e-6, 1 - 1e-5]
    v = [1 - 1e-6, 1e-13, 1e-6, 1e-13, 1.0, 1e-13]
    on = surface.evaluate([2, 6, 0, 0, 2, 6], u, v)
    found = ls.closest_point(surface, on)
    assert found.distance.max() <= 1e-13 * np.abs(surface.points).max()


@pytest.mark.parametrize("engine", ["numpy", "kernels"])
@pytest.mark.parametrize(
    ("name", "scheme", "rules"),
    [
        ("disk_7", "doo-sabin", {"boundary": "none"}),
        ("torus_4x5", "catmull-clark", {}),
        ("pillow_of_quads", "bilinear", {}),
        ("bipyramid_9", "loop", {}),
    ],
)
def test_places_beside_sides_and_corners_are_found(name, scheme, rules, engine, numpy_alone):
    """Squared distances next to 0 say less of where feet are than what counts as nearer."""
    if engine == "numpy":
        numpy_alone()
    surface = made(zoo.ZOO[name](), scheme=scheme, **rules)
    rng, n = np.random.default_rng(2), 400
    face = rng.integers(0, len(surface.limit_faces), n)
    corner = rng.choice([0, 0.125, 0.5, 0.875, 1], (2, n))
    off = 10 ** rng.uniform(-15, -5, (2, n)) * rng.integers(-1, 2, (2, n))
    u, v = np.clip(corner + off, 0, 1)
    if surface.topology.lattice.sloped:
        v = np.minimum(v, 1 - u)
    on = surface.evaluate(face, u, v)
    on = on[np.isfinite(on).all(axis=1)]
    found = ls.closest_point(surface, on)
    assert len(on) >= 20
    assert found.distance.max() <= 2e-14 * np.abs(surface.points).max()


def test_cells_that_are_thin_have_the_feet_that_they_have():
    """In thin cells what rounding took of squared distances is of places far along."""
    points, faces = zoo.grid(3, 3)[:2]
    surface = made((np.asarray(points) * [1, 1e-4, 0], faces))
    rng = np.random.default_rng(4)
    u = 10 ** rng.uniform(-14, -3, 200)
    on = surface.evaluate(rng.integers(0, 9, 200), rng.random(200), u)
    found = ls.closest_point(surface, on)
    assert found.distance.max() <= 1e-13 * np.abs(surface.points).max()


@pytest.mark.parametrize("scheme", ["catmull-clark", "loop"])
def test_bounds_of_how_cells_bend_hold(scheme):
    """Chords and second differences of samples, in parameters of cells, by differences alone."""
    surface = made(
        zoo.ZOO["cube"]() if scheme != "loop" else zoo.ZOO["bipyramid_9"](), scheme=scheme
    )
    cells = Cells.of(surface)
    found, form = nearby.bends(cells), cells.form
    which = np.flatnonzero(np.isfinite(found[:, 0]))
    assert len(which) >= len(found) / 2
    rng, h = np.random.default_rng(0), 1e-3
    for k in rng.choice(which, 20):
        s, t = 0.05 + 0.4 * rng.random((2, 30))
        x = form.values(s, t, 0)[:, 0] @ cells.points[k]
        mean = (form.derivatives[1:3] @ cells.points[k]).mean(axis=1)
        turn = np.linalg.cholesky(mean @ mean.T).T
        place = turn @ np.stack([s, t])
        apart = ((place[:, :, None] - place[:, None]) ** 2).sum(axis=0)
        chord = ((x[:, None] - x) ** 2).sum(axis=2)
        assert (chord >= found[k, 1] * apart * (1 - 1e-9) - 1e-30).all()
        way = rng.normal(size=2)
        way *= h / np.abs(way).max()
        three = [
            form.values(s + m * way[0], t + m * way[1], 0)[:, 0] @ cells.points[k]
            for m in (-1, 0, 1)
        ]
        second = np.linalg.norm(three[0] - 2 * three[1] + three[2], axis=1)
        length = ((turn @ way) ** 2).sum()
        assert (second <= found[k, 0] * length * (1 + 1e-6) + 1e-15).all()
        assert np.linalg.norm(way) <= found[k, 2] * np.sqrt(length)
