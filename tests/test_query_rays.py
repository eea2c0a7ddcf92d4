"""Rays and what is inside, against roots of quadrics, boxes, triangles and hulls.

Kernels answer, and leave to NumPy what they do not settle; where both are compared NumPy answers
all.
"""

import mpmath
import numpy as np
import pytest
import zoo
from command_line import fail, succeed
from test_every_scheme import KINDS
from test_query_closest import CAGES, CUBE, SHARP, fan, hulls, made, places, queries

import limitsurf as ls
from limitsurf.query import crossings, rays, sides
from limitsurf.query.traversal import kernels_for
from limitsurf.shell.cli.rays import NAMES
from limitsurf.shell.io.points import batches

CLOSED = ["cube", "sharp", "semi", "dart", "ngons", "loop"]


@pytest.fixture(autouse=True)
def by_kernels(monkeypatch):
    """Surfaces that NumPy evaluates are searched by kernels all the same."""
    monkeypatch.setattr(rays, "kernels_for", lambda _, *known: kernels_for("compiled", *known))


@pytest.fixture
def by_numpy(monkeypatch):
    """What NumPy alone answers to a call."""

    def answer(call, *arguments, **options):
        with monkeypatch.context() as patch:
            patch.setattr(rays, "kernels_for", lambda *_: None)
            return call(*arguments, **options)

    return answer


def of_scheme(name, cage, **options):
    """A cage of the zoo by any scheme."""
    points, faces, *tags = KINDS[name].cages[cage]()
    tags = {**(tags[0] if tags else {}), **options}
    rules = {key: tags.pop(key) for key in ("boundary", "triangles") if key in tags}
    mesh = ls.Mesh(np.array(points, dtype=float), faces, **tags)
    return ls.LimitSurface(mesh, scheme=KINDS[name].scheme, engine="reference", **rules)


SCHEMES = [
    (name, cage, closed)
    for name in ls.schemes.with_pieces
    for cages, closed in ((("cube", "octahedron", "crowded"), True),
                          (("grid_3x3", "grid_4x4", "fan_7"), False))
    for cage in [next(x for x in cages if x in KINDS[name].cages)]
]  # fmt: skip
SCHEMES += [("doo-sabin", "prism_7", True), ("loop", "semi_dart", False)]
SCHEMES += [("loop", "holes", False), ("doo-sabin", "disk_none", False)]


@pytest.mark.parametrize(("scheme", "cage", "closed"), SCHEMES)
def test_every_scheme(scheme, cage, closed, by_numpy):
    surface = of_scheme(scheme, cage)
    start, way = shots(surface, 40)
    ends = np.array(surface.topology.lattice.corners, dtype=float)
    place = ends[:, None] + np.array([0, 0.25])[:, None] * (np.roll(ends, -1, 0) - ends)[:, None]
    on = surface.evaluate(np.arange(len(surface.limit_faces))[:, None], *place.reshape(-1, 2).T)
    on = on[np.isfinite(on).all(axis=2)][:30]
    away = surface.points.mean(axis=0) + 3 * np.abs(surface.points).max() * np.array(
        [0.3, 0.5, 0.7]
    )
    found, counts, ray = all_hits(
        surface,
        np.concatenate([start, np.broadcast_to(away, on.shape)]),
        np.concatenate([way, on - away]),
    )
    other = by_numpy(
        ls.intersect_all, surface, np.concatenate([start, np.broadcast_to(away, on.shape)]),
        np.concatenate([way, on - away]),
    )  # fmt: skip
    assert (found.offsets == other.offsets).all()
    for name in ("face", "multiplicity"):
        assert (getattr(found, name) == getattr(other, name)).all()
    size = np.abs(surface.points).max()
    assert np.abs(found.t - other.t).max(initial=0) <= 1e-13 * size
    # through vertices and edges, each once
    gap = np.abs(found.point - np.concatenate([start, on])[ray]).max(axis=1)
    near = np.bincount(ray[gap < 1e-11 * size], minlength=len(counts))[len(start) :]
    assert (near == 1).all()
    if closed:
        lines = np.diff(ls.intersect_all(surface, start, way, t_min=-np.inf).offsets)
        assert (lines % 2 == 0).all()
        inside = ls.winding_number(surface, start)
        assert (np.abs(inside) == counts[: len(start)] % 2).all()


def test_rays_into_closed_cages_have_an_even_number_of_hits():
    for surface in (made(zoo.carved(zoo.cube(), 1)), CAGES["loop"]()):
        start, way = shots(surface, 10000)
        found = ls.intersect_all(surface, start, way, t_min=-np.inf)
        every = np.add.reduceat(np.append(found.multiplicity, 0), found.offsets[:-1])
        assert (every[np.diff(found.offsets) > 0] % 2 == 0).all()


def test_work_is_bounded(monkeypatch, by_numpy):
    """Also where a ray and a surface touch along a line, and where all of it is one place."""
    i, j = (x.ravel() - 4.0 for x in np.mgrid[:9, :9])
    surface = made((np.stack([i, j, j * j / 2 - 1 / 6], axis=1), zoo.grid(8, 8)[1]))
    looked = []
    halve = crossings.Crossings._halve

    def counted(self, pairs):
        looked.append(len(pairs))
        return halve(self, pairs)

    monkeypatch.setattr(crossings.Crossings, "_halve", counted)
    found = ls.intersect_all(surface, [[-9.0, 0, 0]], [[1.0, 0, 0]])
    assert sum(looked) < 20000
    assert len(found.t)
    assert (found.multiplicity == 2).all()
    assert np.abs(found.point[:, 1:]).max() < 1e-6
    # rays are searched for apart where they meet more boxes than there is room for
    start, way = shots(surface, 50)
    one = by_numpy(ls.intersect, surface, start, way)
    monkeypatch.setattr(crossings, "_CROWDED", 100)
    assert (by_numpy(ls.intersect, surface, start, way).t == one.t).all()


def shots(surface, n, seed=3):
    """Rays from around a surface to the inside of its box."""
    rng, points = np.random.default_rng(seed), surface.points
    low, high = points.min(axis=0), points.max(axis=0)
    start = low + (high - low) * (1.6 * rng.random((n, 3)) - 0.3)
    return start, low + (high - low) * rng.random((n, 3)) - start


def all_hits(surface, start, way, **options):
    """All hits with what every one of them has to be: on the ray, in order, as `intersect` says."""
    found = ls.intersect_all(surface, start, way, **options)
    counts = np.diff(found.offsets)
    ray = np.repeat(np.arange(len(counts)), counts)
    start, way = (np.broadcast_to(x, (len(counts), 3)) for x in (start, way))
    size = np.abs(surface.points).max()
    assert (found.point == surface.evaluate(found.face, found.u, found.v).reshape(-1, 3)).all()
    gap = start[ray] - found.point
    across = np.cross(gap, way[ray]) / np.sqrt((way[ray] ** 2).sum(axis=1, keepdims=True))
    assert np.abs(across).max(initial=0) <= 1e-13 * size
    assert (np.diff(found.t)[np.diff(ray) == 0] >= 0).all()
    first = ls.intersect(surface, start, way, **options)
    assert (first.hit == (counts > 0)).all()
    gap = first.t[first.hit] - found.t[found.offsets[:-1][counts > 0]]
    assert (np.abs(gap * np.sqrt((way[first.hit] ** 2).sum(axis=1))) <= 1e-12 * size).all()
    assert (ls.occluded(surface, start, way, **options) == first.hit).all()
    return found, counts, ray


def crossed(triangles, start, way):
    """How many triangles (m, 3, 3) a line crosses, and how near it comes to a side of one."""
    a, b, c = (triangles - start).swapaxes(0, 1)
    areas = np.stack([np.cross(x, y) @ way for x, y in ((a, b), (b, c), (c, a))])
    inside = (areas > 0).all(axis=0) | (areas < 0).all(axis=0)
    return int(inside.sum())


@pytest.mark.parametrize("name", CAGES)
def test_hits_are_those_of_triangles_and_in_hulls(name):
    surface = CAGES[name]()
    start, way = shots(surface, 60)
    found, counts, ray = all_hits(surface, start, way, t_min=-np.inf)
    if name in CLOSED:
        assert (counts % 2 == 0).all()
    few = 8 if len(surface.limit_faces) < 60 else 4
    rest = np.arange(len(start))
    for segments in (few, 5 * few):  # (near silhouettes many triangles know better)
        pieces = ls.tessellate(surface, segments, normals=False)
        corners = pieces.points[pieces.indices[pieces.triangles]]
        rest = rest[[crossed(corners, start[k], way[k]) != counts[k] for k in rest]]
        if not len(rest):
            break
    assert not len(rest)
    # what a ray hits it enters by a hull, and where it enters none it hits nothing
    low, high, _ = hulls(surface, 2 if len(surface.limit_faces) < 60 else 1)
    with np.errstate(divide="ignore"):
        one, other = ((x - start[:, None]) / way[:, None] for x in (low, high))
    enter, leave = np.minimum(one, other).max(axis=2), np.maximum(one, other).min(axis=2)
    t = found.t[:, None]
    assert ((enter[ray] <= t + 1e-9) & (t <= leave[ray] + 1e-9)).any(axis=1).all()
    assert (counts[(enter > leave).all(axis=1)] == 0).all()
    # any place is hit
    face, u, v = places(surface, 40, 4)
    on = surface.evaluate(face, u, v)
    found = ls.intersect_all(surface, start[:40], on - start[:40])
    for low, high in zip(found.offsets[:-1], found.offsets[1:], strict=True):
        assert np.abs(found.t[low:high] - 1).min() < 1e-9


@pytest.mark.parametrize("shape", [(0.3, 0.2, 0.1), (0.5, -0.4, 0)])
def test_hits_on_a_quadric_are_roots(shape):
    # heights of which the limit is z = a x^2 + b y^2 + c x y, away from the boundary
    a, b, c = shape
    i, j = (x.ravel() - 5.0 for x in np.mgrid[:11, :11])
    points = np.stack([i, j, a * (i * i - 1 / 3) + b * (j * j - 1 / 3) + c * i * j], axis=1)
    surface = made((points, zoo.grid(10, 10)[1]))
    form = mpmath.matrix([[a, c / 2], [c / 2, b]])
    rng = np.random.default_rng(3)
    start = np.column_stack([rng.uniform(-3, 3, (40, 2)), rng.uniform(0, 3, 40)])
    way = np.column_stack([rng.uniform(-3, 3, (40, 2)), rng.uniform(-1, 3, 40)]) - start
    found, _, ray = all_hits(surface, start, way, t_min=-np.inf)
    with mpmath.workdps(50):
        for k in range(40):
            p, d = (mpmath.matrix(x[k].tolist()) for x in (start, way))
            q2 = (d[:2, 0].T * form * d[:2, 0])[0]
            q1 = 2 * (p[:2, 0].T * form * d[:2, 0])[0] - d[2]
            q0 = (p[:2, 0].T * form * p[:2, 0])[0] - p[2]
            root = q1**2 - 4 * q2 * q0
            times = found.t[ray == k]
            if root < 0:
                near = [mpmath.mpf(0)][:0]
            else:
                near = [(-q1 + s * mpmath.sqrt(root)) / (2 * q2) for s in (-1, 1)]
            near = [t for t in near if max(abs(p[0] + t * d[0]), abs(p[1] + t * d[1])) < 3.99]
            inside = np.abs(start[k, :2] + times[:, None] * way[k, :2]).max(axis=1) < 3.99
            assert len(near) == inside.sum()
            for t, s in zip(sorted(near), times[inside], strict=True):
                # across the ray 1e-13 of the size, along it over the cosine
                slope = abs(2 * q2 * t + q1) / mpmath.norm(d)
                assert abs(t - s) * mpmath.norm(d) <= 1e-13 * 12 * (1 + 3 / slope)


def test_rays_that_touch():
    # z = x^2 / 2 + y^2 / 2 from the side: at its bottom, and by a hair above and below
    i, j = (x.ravel() - 5.0 for x in np.mgrid[:11, :11])
    points = np.stack([i, j, (i * i + j * j) / 2 - 1 / 3], axis=1)
    surface = made((points, zoo.grid(10, 10)[1]))
    for shift in ([0, 0.0], [0.3, -0.2]):
        x, y = shift
        start = np.array([[x - 3, y, (x * x + y * y) / 2 - 3 * x]]) + [
            [0, 0, h] for h in (0, 1e-6, -1e-6)
        ]
        found, counts, _ = all_hits(surface, start, [[1, 0, x]], t_max=6.0)
        assert counts.tolist() == [1, 2, 0]
        assert found.multiplicity.tolist() == [2, 1, 1]
        assert np.abs(found.t - [3, 3 - 2e-6**0.5, 3 + 2e-6**0.5]).max() < 1e-6
        assert abs(found.t[1] - 3 + 2e-6**0.5) < 1e-10


@pytest.mark.parametrize("name", CLOSED)
def test_rays_through_vertices_and_along_edges(name):
    surface = CAGES[name]()
    middle = surface.points.mean(axis=0)
    ends = np.array(surface.topology.lattice.corners, dtype=float)
    x = np.array([0, 2.0**-18, 0.25, 1 - 1e-5])
    step = np.roll(ends, -1, axis=0) - ends
    place = (ends[:, None] + x[:, None] * step[:, None]).reshape(-1, 2)
    face = np.arange(len(surface.limit_faces))[: 12 if len(ends) == 3 else 5, None]
    on = surface.evaluate(face, *place.T).reshape(-1, 3)
    away = 3 * np.abs(surface.points).max() * np.array([0.3, 0.5, 0.7])
    for start in (middle + away, np.broadcast_to(middle, on.shape)):
        found, counts, ray = all_hits(surface, np.broadcast_to(start, on.shape), on - start)
        gap = np.abs(found.point - on[ray]).max(axis=1)
        assert (np.bincount(ray[gap < 1e-9], minlength=len(on)) == 1).all()
    # from the middle of what is seen from there in one way, once
    if name in ("cube", "sharp"):
        assert (counts == 1).all()
        assert (found.multiplicity == 1).all()


@pytest.mark.parametrize(
    ("scheme", "cage", "to"),
    [
        ("bilinear", "carved_cube_1", [0, 0.5, 0]),
        ("bilinear", "carved_cube_1", [0, 1, 0]),
        # faces as thin as rounding
        ("loop", "sphere_1", [-0.4765625, -0.476708984375, 0.074169921875]),
    ],
)
def test_rays_cross_where_faces_are_seen_from_both_sides(scheme, cage, to):
    surface = of_scheme(scheme, cage)
    start = surface.points.mean(axis=0)
    for away in ([0, 0, 0], [3, 5, 7]) if scheme == "loop" else ([0, 0, 0], [5, 0, 0]):
        found = ls.intersect_all(surface, [start + away], to - start - away, t_min=-np.inf)
        assert found.multiplicity.sum() % 2 == 0
        assert np.abs(found.t - 1).min() < 1e-13


def test_sides_of_slivers_are_hit(by_numpy):
    """Where derivatives are parallel, rounding moves zeros along sides, and so over others."""
    surface = of_scheme("doo-sabin", "grid_edge_only")
    on = surface.evaluate(6, 0.99999 - np.array([0, 1e-13, 1e-12]), 0.0)
    start, way = on + np.array([9, 15, 21]), [-9.0, -15, -21]
    for found in (ls.intersect(surface, start, way), by_numpy(ls.intersect, surface, start, way)):
        assert np.abs(found.t - 1).max() < 1e-13


def test_rays_on_a_box():
    surface = made((*CUBE, {"creases": SHARP}))
    start = [[0.5, 0.5, 3], [3, 3, 3], [0.25, 3, 3], [0.25, 3, 1], [0, 3, 1], [0.25, 3, 1 + 1e-9]]
    way = [[0, 0, -1.0], [-1, -1, -1], [0, -1, -1], [0, -1, 0], [0, -1, 0], [0, -1, 0]]
    found = ls.intersect_all(surface, start, way)
    times = [found.t[a:b].tolist() for a, b in zip(found.offsets[:-1], found.offsets[1:])]  # noqa: B905
    assert times[:3] == [[2, 3], [2, 3], [2, 3]]
    assert (found.multiplicity[:6] == 1).all()
    # in a face, and along an edge
    assert times[3][0] >= 2
    assert times[3][-1] <= 3
    assert times[4][-1] <= 3
    assert times[5] == []
    # touching an edge, and a corner
    found = ls.intersect_all(surface, [[0.5, 2, 0], [2.5, 2, 0]], [[0, -1, 1.0], [-2, -1, 1]])
    assert found.offsets.tolist() == [0, 1, 2]
    assert found.multiplicity.tolist() == [2, 2]
    assert np.abs(found.t - 1).max() < 1e-15


@pytest.mark.parametrize("valence", [3, 5, 6, 8, 16, 64, 66])
def test_hits_at_and_beside_poles(valence):
    surface = made(fan(valence))
    small = np.array([0, 1e-300, 1e-9, 1e-3] if valence < 10 else [0, 1e-6])
    face, u = np.arange(0, valence, 1 + valence // 2)[:, None, None], small[:, None]
    on = surface.evaluate(face, u, small).reshape(-1, 3)[: 2 if valence > 60 else None]
    for way in ([0, 0, -1.0], [0.3, 0.2, -1])[: 1 if valence > 10 else 2]:
        start = on - 2 * np.array(way)
        found = ls.intersect_all(surface, start, [way])
        ray = np.repeat(np.arange(len(on)), np.diff(found.offsets))
        gap = np.sqrt(((found.point - on[ray]) ** 2).sum(axis=1))
        near = gap <= 1e-12
        assert (np.bincount(ray[near], minlength=len(on)) == 1).all()
        assert np.abs(found.t[near] - 2).max() < 1e-12


@pytest.mark.parametrize("name", CLOSED)
def test_inside(name):
    surface = CAGES[name]()
    asked = queries(surface)[24:]
    number = ls.winding_number(surface, asked)
    pieces = ls.tessellate(surface, 12, normals=False)
    corners = pieces.points[pieces.indices[pieces.triangles]]
    a, b, c = np.moveaxis(corners[None] - asked[:, None, None], 2, 0)
    x, y, z = (np.sqrt((p**2).sum(axis=2)) for p in (a, b, c))
    below = x * y * z + (a * b).sum(2) * z + (b * c).sum(2) * x + (c * a).sum(2) * y
    turns = np.arctan2((a * np.cross(b, c)).sum(axis=2), below).sum(axis=1) / (2 * np.pi)
    clear = ls.closest_point(surface, asked).distance > 0.02 * np.abs(surface.points).max()
    assert clear.sum() > 20
    assert (number[clear] == np.round(turns[clear])).all()
    inside = ls.contains(surface, asked)
    assert (inside == (number != 0)).all()
    on = surface.evaluate(*places(surface, 20, 5))
    assert ls.contains(surface, on).all()
    signed = ls.closest_point(surface, asked, signed=True).distance
    assert ((signed < 0) == (number > 0)).all() or number.min() < 0


@pytest.mark.parametrize("name", ["sharp", "dart", "loop"])
def test_inside_where_rays_are_drawn_again(name):
    """Of points of which the first rays go through vertices, along edges and into their middles."""
    surface = CAGES[name]()
    ends = np.array(surface.topology.lattice.corners, dtype=float)
    place = np.concatenate([ends, (ends + np.roll(ends, -1, axis=0)) / 2])
    face = np.arange(len(surface.limit_faces))[:, None]
    on = surface.evaluate(face, *place.T).reshape(-1, 3)[:: 3 if name != "loop" else 7]
    size = np.abs(surface.points).max()
    for draw in (0, 1):
        way = np.random.default_rng(draw).normal(size=3)
        way /= np.sqrt((way**2).sum())
        asked = np.concatenate([on - far * size * way for far in (0.05, 0.3, 2)])
        number = ls.winding_number(surface, asked)
        turns = sides.covered(surface, asked)
        clear = np.abs(turns - np.round(turns)) < 0.2
        assert clear.mean() > 0.9
        assert (number[clear] == np.round(turns[clear])).all()


def test_inside_of_a_box_and_nothing():
    surface = made((*CUBE, {"creases": SHARP}))
    asked = np.stack(np.meshgrid(*3 * [np.arange(-2, 7) / 4]), axis=-1)
    inside = ((asked >= 0) & (asked <= 1)).all(axis=-1)
    assert (ls.contains(surface, asked) == inside).all()
    turned = ls.LimitSurface(ls.Mesh(CUBE[0], [f[::-1] for f in CUBE[1]]), engine="reference")
    assert ls.winding_number(turned, [0.5, 0.5, 0.5]) == -1
    strange = [[np.nan, 0, 0], [0.5, 0.5, 0.5], [np.inf, 0, 0]]
    assert ls.contains(surface, strange).tolist() == [False, True, False]
    assert np.isnan(ls.winding_number(surface, strange)).tolist() == [True, False, True]
    with pytest.raises(ValueError, match=r"vertices 0 and \d has a face on one side only"):
        ls.contains(made((CUBE[0], CUBE[1][1:])), [0, 0, 0])


@pytest.mark.parametrize("name", ["dart", "loop_open", "pole"])
def test_moves_along(name):
    surface = CAGES[name]()
    start, way = shots(surface, 40)
    one = ls.intersect(surface, start, way)
    for power in (-600, 900):
        scaled = surface.with_points(np.ldexp(surface.points, power))
        found = ls.intersect(scaled, np.ldexp(start, power), np.ldexp(way, power))
        for key in ("face", "t", "u", "v"):
            assert np.array_equal(getattr(found, key), getattr(one, key), equal_nan=True)
    # directions are not unit: t is in theirs; origins may be far away
    found = ls.intersect(surface, start, 1e-3 * way)
    assert np.allclose(found.t[one.hit] * 1e-3, one.t[one.hit], rtol=1e-12, atol=0)
    far = np.round(way * 1024) / 1024
    near = ls.intersect(surface, start, far, t_min=-np.inf)
    found = ls.intersect(surface, start - 2.0**20 * far, far)
    assert np.mean(found.hit == near.hit) == 1
    assert np.allclose(found.t[near.hit] - 2.0**20, near.t[near.hit], rtol=0, atol=1e-8)
    # the other way round
    back = ls.intersect_all(surface, start + way, -way, t_min=-np.inf)
    ahead = ls.intersect_all(surface, start, way, t_min=-np.inf)
    assert (back.offsets == ahead.offsets).all()


def test_bounds_of_t_and_shapes():
    surface = made((*CUBE, {"creases": SHARP}))
    start, way = [0.5, 0.5, 3], np.array([[[0, 0, -1.0]], [[0, 0, -2.0]]])
    assert ls.intersect(surface, start, way).t.tolist() == [[2], [1]]
    assert ls.intersect(surface, start, way, t_min=2.5).t.tolist() == [[3], [np.inf]]
    assert ls.intersect(surface, start, way[0, 0], t_min=2, t_max=2).hit
    assert ls.intersect(surface, start, way[0], t_max=[1.9]).face.tolist() == [-1]
    assert ls.intersect(surface, start, way[0, 0], t_min=4, t_max=1).hit == False  # noqa: E712
    assert ls.intersect(surface, np.zeros((0, 3)), [1.0, 0, 0]).face.shape == (0,)
    assert ls.intersect_all(surface, np.zeros((0, 3)), [1.0, 0, 0]).offsets.tolist() == [0]


def test_bad_input():
    surface = made(CUBE)
    start = [[np.nan, 0, 0], [0.5, 0.5, 2], [0.5, 0.5, 2], [0.5, np.inf, 2], [1e300, 0.5, 0.5]]
    way = [[0, 0, -1.0], [0, 0, np.nan], [0, 0, -1], [0, 0, -1], [-1e-200, 0, 0]]
    found = ls.intersect(surface, start, way)
    assert found.hit.tolist() == [0, 0, 1, 0, 1]
    assert found.face.tolist() == [-1, -1, 1, -1, found.face[4]]
    assert np.isinf(found.t).tolist() == [1, 1, 0, 1, 1]  # t beyond float64
    assert np.isnan(found.point[[0, 1, 3]]).all()
    assert np.isnan(found.u).tolist() == [1, 1, 0, 1, 0]
    assert np.diff(ls.intersect_all(surface, start, way).offsets).tolist() == [0, 0, 2, 0, 2]
    with pytest.raises(ValueError, match=r"direction 1 is zero \(1 more like it\)"):
        ls.intersect(surface, [0, 0, 0], [[0, 0, 1], [0, 0, 0], [0, 0, 0]])
    with pytest.raises(ValueError, match="direction is zero: "):
        ls.occluded(surface, [0, 0, 0], [0, 0, 0])
    for points, match in (([0, 1], r"origins must be of shape"), (3.0, r"\(\.\.\., 3\)")):
        with pytest.raises(ValueError, match=match):
            ls.intersect(surface, points, [0, 0, 1])
    with pytest.raises(ValueError, match="broadcast"):
        ls.intersect(surface, np.zeros((2, 3)), np.ones((3, 3)))
    with pytest.raises(ValueError, match="t_max must not be NaN"):
        ls.intersect(surface, [0, 0, 0], [0, 0, 1], t_max=np.nan)
    with pytest.raises(ValueError, match="t_min must be a number or"):
        ls.intersect(surface, [0, 0, 0], [0, 0, 1], t_min=[0, 1])
    with pytest.raises(ValueError, match=r"of shape \(n, 3\)"):
        ls.intersect_all(surface, [0, 0, 0], [0, 0, 1])
    with pytest.raises(TypeError, match="directions must be real"):
        ls.intersect(surface, [0, 0, 0], ["a", "b", "c"])
    with pytest.raises(TypeError, match="need a LimitSurface"):
        ls.intersect(surface.mesh, [0, 0, 0], [0, 0, 1])
    holes = made((*CUBE, {"holes": list(range(6))}))
    assert not ls.occluded(holes, [0.5, 0.5, 2], [0, 0, -1])


@pytest.mark.parametrize("name", ["crossed", "flat", "diagonal", "point", "collapsed"])
def test_degenerate(name):
    points, faces = CUBE
    points = np.array(points, dtype=float)
    if name == "crossed":
        points, faces, *_ = zoo.crossed_grids()
    elif name == "flat":
        points = points * [1, 1, 0]
    elif name == "diagonal":  # faces that are a curve each
        faces = zoo.grid(3, 3)[1]
        points = np.add.outer(np.arange(4.0), np.arange(4.0)).reshape(-1, 1) ** [1, 2, 3] / 8
    elif name == "point":
        points = 0 * points + 2
    else:
        points[0] = points[1]
    surface = made((points, faces))
    start, way = shots(surface, 6 if name == "point" else 20)
    all_hits(surface, start, way + (name == "point"))
    # towards places of it, along its planes too
    on = surface.evaluate(*places(surface, 6 if name == "point" else 20, 3))
    on = on[np.isfinite(on).all(axis=1)]
    for step in np.array([[0.3, 0.2, 0.4], [0, 1, 0]]):
        found = ls.intersect(surface, on + step, -step)
        assert found.hit.all()


def test_any_number_of_workers_and_chunks(monkeypatch):
    surface = CAGES["dart"]()
    start, way = shots(surface, 300)
    some = ls.intersect(surface, start, way)
    monkeypatch.setattr(rays, "_CHUNK", 128)
    all_, threaded = (ls.intersect(surface, start, way, workers=n) for n in (1, 2))
    for name in ("point", "hit", "t", "face", "u", "v", "normal"):
        a, b, c = (getattr(x, name) for x in (all_, threaded, some))
        assert np.array_equal(a, b, equal_nan=True)
        assert np.allclose(a, c, rtol=0, atol=1e-12, equal_nan=True)
    assert repr(some).startswith("RayHits(300 rays, ")


def test_command_line(tmp_path):
    path, asked = tmp_path / "cube.obj", tmp_path / "rays.csv"
    ls.write(path, ls.Mesh(*CUBE))
    found = succeed("intersect", path, "--ray", 0.5, 0.5, 3, 0, 0, -2).splitlines()
    assert found[0] == "face,u,v,ray,t,x,y,z,n_x,n_y,n_z"
    hit = ls.intersect(ls.LimitSurface(ls.read(path)), [0.5, 0.5, 3], [0, 0, -2.0])
    values = np.array(found[1].split(","), dtype=float)
    assert np.abs(values[:8] - [hit.face, hit.u, hit.v, 0, hit.t, *hit.point]).max() < 1e-12
    rows = np.array([[0.5, 0.5, 3, 0, 0, -1], [9, 9, 9, 0, 0, 1], [2, 2, 2, -1, -1, -1]])
    np.savetxt(asked, rows, delimiter=",", header="x,y,z,dx,dy,dz", comments="")
    np.save(tmp_path / "rays.npy", rows)
    assert len(succeed("intersect", path, "--rays", asked).splitlines()) == 3
    for name in ("rays.csv", "rays.npy"):
        out = tmp_path / "hits.npz"
        succeed("intersect", path, "--rays", tmp_path / name, "--all", "-o", out)
        with np.load(out) as content:
            hits = dict(content)
        assert hits["ray"].tolist() == [0, 0, 2, 2]
        assert hits["multiplicity"].tolist() == [1] * 4
        assert hits["position"].shape == (4, 3)
    assert (
        len(
            succeed(
                "intersect", path, "--rays", "-", "--t-max", 1, stdin="0,0,9,1,1,1"
            ).splitlines()
        )
        == 1
    )
    asked.write_text("name,dx,dy,dz,z,y,x\nfirst,0,0,1,3,2,1\n")  # columns by name
    (row,) = batches(str(asked), NAMES)
    assert row.tolist() == [[1, 2, 3, 0, 0, 1]]
    asked.write_text("ox,oy,oz,vx,vy,vz\n1,2,3,0,0,1\n")
    (row,) = batches(str(asked), NAMES)
    assert row.tolist() == [[1, 2, 3, 0, 0, 1]]
    np.savez(tmp_path / "rays.npz", **dict(zip(NAMES, rows.T, strict=True)))
    (found,) = batches(str(tmp_path / "rays.npz"), NAMES)
    np.testing.assert_array_equal(found, rows)
    asked.write_text("1,2,3,0,0,1\n1,2,3\n")
    assert "line 2: need six numbers" in fail("intersect", path, "--rays", asked)
    assert "either --ray" in fail("intersect", path)
    np.save(tmp_path / "rays.npy", rows[:, :5])
    assert "(n, 6)" in fail("intersect", path, "--rays", tmp_path / "rays.npy")
    assert "direction 0 is zero" in fail("intersect", path, "--ray", 0, 0, 0, 0, 0, 0)


@pytest.mark.parametrize("seed", range(4))
def test_hits_are_one_as_their_pairs_say(seed):
    """What is sorted by place and depth, against all pairs."""
    surface, rng, n = made(CUBE), np.random.default_rng(seed), 60
    flag, depth = rng.random((2, n)) < 0.7, rng.integers(0, 12, n) / 8
    places = rng.integers(0, 3, (2, n)) / 2
    blur = rng.choice([1e-13, 0.02, 0.07], n)
    hits = crossings.Hits(
        rng.integers(0, 2, n), rng.integers(0, 6, n), places[0], places[1], depth, depth, blur,
        rng.integers(-1, 2, n), flag[0], flag[1] & False,
    )  # fmt: skip
    faces = [set(face) for face in CUBE[1]]
    group = np.arange(n)
    for a in range(n):
        for b in range(n):
            same = hits.ray[a] == hits.ray[b] and abs(depth[a] - depth[b]) <= blur[a] + blur[b]
            rims = flag[0][a] and flag[0][b] and faces[hits.face[a]] & faces[hits.face[b]]
            at = hits.face[a] == hits.face[b] and np.array_equal(places[:, a], places[:, b])
            if same and (rims or at):
                group[group == group[b]] = group[a]
    found = rays._once(surface, hits)
    assert len(found) == len(np.unique(group))
    for name, of in (("blur", np.max), ("face", np.min)):
        expected = sorted((hits.ray[k].min(), of(getattr(hits, name)[k]))
                          for k in (group == g for g in np.unique(group)))  # fmt: skip
        assert sorted(zip(found.ray, getattr(found, name), strict=True)) == expected


def test_many_rays_through_a_pole():
    """Of hundreds of hits at a place each is compared with a few, not with all."""
    surface = made(fan(66))
    on, way = surface.evaluate(0, 0.0, 0.0), np.array([[0, 0, -1.0], [0.01, 0, -1], [0, 0.01, -1]])
    found = ls.intersect_all(surface, on - 2 * way, way)
    assert found.offsets.tolist() == [0, 1, 2, 3]
    n, one = 100_000, np.ones(100_000)
    whole, no = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=bool)
    many = crossings.Hits(whole, whole, 0 * one, 0 * one, one, one, one, whole, ~no, no)
    assert len(rays._once(surface, many)) == 1
