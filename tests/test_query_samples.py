"""Samples, against areas of triangles and known surfaces, and blue noise by its distances."""

import numpy as np
import pytest
import zoo
import zoo_triangles
from scipy import stats
from scipy.spatial.distance import pdist
from test_query_closest import CAGES, fan, made

import limitsurf as ls
from limitsurf.query.density import AreaDensity, _density
from limitsurf.query.index import Cells

MANY = {
    **CAGES,
    "hole": lambda: made((*zoo.grid(3, 3), {"holes": [4]})),
    "inner": lambda: made(zoo.grid(4, 4), boundary="none"),
    "doo": lambda: made(zoo.cube(), scheme="doo-sabin"),
    "bilinear": lambda: made(zoo.prism(5), scheme="bilinear"),
    "linear": lambda: made(zoo_triangles.ZOO["grid_3x2"](), scheme="linear"),
    "cone": lambda: made((*zoo.cube(), {"corners": {0: np.inf}})),
    "long": lambda: made((fan(5)[0] * [1, 1e-3, 1], fan(5)[1])),
}  # fmt: skip


def areas(surface, face, corners, n=32):
    """About the areas (F,) of parts of limit faces, of triangles between points of them.

    `corners` (F, 3 or 4, 2) are their places (u, v).
    """
    corners = np.array(corners, dtype=float)[:, :, None]
    i, j = (x.ravel() for x in np.mgrid[: n + 1, : n + 1])
    if corners.shape[1] == 3:
        i, j = i[i + j <= n], j[i + j <= n]
    s, t = i[:, None] / n, j[:, None] / n
    first, along, across = corners[:, 0], corners[:, 1], corners[:, -1]
    place = np.clip(first + s * (along - first) + t * (across - first), 0, 1)
    number = np.full((n + 2, n + 2), -1)
    number[i, j] = np.arange(len(i))
    x = surface.evaluate(np.asarray(face)[:, None], place[..., 0], place[..., 1])
    lower = np.stack([number[:-1, :-1], number[1:, :-1], number[:-1, 1:]], axis=2).reshape(-1, 3)
    upper = np.stack([number[1:, 1:], number[:-1, 1:], number[1:, :-1]], axis=2).reshape(-1, 3)
    abc = np.concatenate([lower, upper])
    a, b, c = np.moveaxis(x[:, abc[(abc >= 0).all(axis=1)]], 2, 0)
    return np.sqrt((np.cross(b - a, c - a) ** 2).sum(axis=2)).sum(axis=1) / 2


def quarters(surface, u, v):
    """Which quarter of its limit face a place is in, and the corners of all four."""
    if surface.topology.lattice.sloped:
        which = np.where(u >= 0.5, 1, np.where(v >= 0.5, 2, np.where(u + v <= 0.5, 0, 3)))
        a, b, c = (0.5, 0), (0.5, 0.5), (0, 0.5)
        return which, [[(0, 0), a, c], [a, (1, 0), b], [c, b, (0, 1)], [b, c, a]]
    which = (u >= 0.5).astype(int) + 2 * (v >= 0.5)
    return which, [
        [(x, y), (x + 0.5, y), (x + 0.5, y + 0.5), (x, y + 0.5)] for y in (0, 0.5) for x in (0, 0.5)
    ]


def alike(counts, sizes):
    """Whether counts are those of samples by sizes, but for one case in a million."""
    expected = counts.sum() * sizes / sizes.sum()
    assert (counts[expected < 1e-9] == 0).all()
    counts, expected = counts[expected >= 1e-9], expected[expected >= 1e-9]
    order = np.argsort(expected)
    start = np.unique(np.cumsum(expected[order]) // 12, return_index=True)[1]
    seen, due = (np.add.reduceat(x[order], start) for x in (counts, expected))
    return stats.chi2.sf(((seen - due) ** 2 / due).sum(), max(len(due) - 1, 1)) > 1e-6


@pytest.mark.parametrize("name", [name for name in MANY if name != "crowded"])
def test_each_part_has_its_share_of_area(name):
    surface = MANY[name]()
    n = len(surface.limit_faces)
    found = ls.sample(surface, 10000, rng=5)
    assert (found.point == surface.evaluate(found.face, found.u, found.v)).all()
    quarter, parts = quarters(surface, found.u, found.v)
    counts = np.bincount(4 * found.face + quarter, minlength=4 * n)
    sizes = areas(surface, np.repeat(np.arange(n), 4), np.tile(parts, (n, 1, 1)))
    assert alike(counts, np.nan_to_num(sizes))


@pytest.mark.parametrize("name", MANY)
def test_bounds_hold_where_places_are_tried(name):
    cells = Cells.of(MANY[name]())
    density, rng = AreaDensity.of(cells, 1), np.random.default_rng(2)
    s, t, ring, piece = rng.random((4, 4000))
    if cells.lattice.sloped:
        s, t = np.where(s + t > 1, [1 - s, 1 - t], [s, t])
    which = rng.integers(len(density.most), size=4000)
    with np.errstate(invalid="ignore"):
        ratio, _ = density._in_pieces(which, s, t)
    assert (ratio[density.most[which] > 0] <= 1).all()
    if len(density.start):
        corner = rng.integers(len(density.start), size=300)
        ratio, _ = density._on_rings(corner, *(x[:300] for x in (ring, piece, s, t)))
        assert (ratio <= 1).all()
        assert ratio.max() > 0.1 or name in ("crowded", "long", "loop_dart")


@pytest.mark.parametrize("valence", [3, 5, 8, 64, 66])
def test_rings_around_poles_have_their_share(valence):
    points, faces = fan(valence)
    points[1:, 2] = 0  # all faces alike
    rim = np.arange(2 * valence) % 2
    points[1 : 2 * valence + 1, 2] = 0.1 * rim
    surface = made((points, faces))
    found = ls.sample(surface, 20000, rng=valence)
    at, most = found.face < valence, 12
    ring = np.floor(-np.log2(np.maximum(found.u, found.v)[at])).astype(int)
    counts = np.bincount(np.minimum(ring, most - 1), minlength=most)
    assert valence < 8 or counts[5:].sum() > 20
    h = 0.5 ** np.arange(1, most + 1)[:, None, None]
    square = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    parts = np.stack([h * (square + corner) for corner in ((1, 0), (0, 1), (1, 1))], axis=1)
    sizes = areas(surface, np.zeros(3 * most, dtype=int), parts.reshape(-1, 4, 2), 10)
    assert alike(counts, sizes.reshape(most, 3).sum(axis=1))


def test_places_in_a_plane_are_even_whatever_the_parameters():
    points, faces = zoo.grid(6, 6)
    points = np.asarray(points, dtype=float) * [1, 1, 0]
    rng = np.random.default_rng(0)
    inside = (np.abs(points[:, :2] - points[:, :2].mean(axis=0)) < 2.5).all(axis=1)
    points[inside, :2] += rng.uniform(-0.35, 0.35, (inside.sum(), 2))
    found = ls.sample(made((points, faces)), 20000, rng=rng)
    for x in found.point.T[:2]:
        assert stats.kstest(x, "uniform", (x.min().round(), np.ptp(x).round())).pvalue > 1e-6
    assert (found.normal @ [0, 0, 1] == pytest.approx(np.ones(20000), abs=1e-12)) or (
        found.normal @ [0, 0, 1] == pytest.approx(-np.ones(20000), abs=1e-12)
    )


@pytest.mark.parametrize("name", ["ngons", "loop", "hole", "inner", "doo"])
def test_by_parameter_faces_are_alike(name):
    surface = MANY[name]()
    found = ls.sample(surface, 9000, method="parameter", rng=3)
    n = len(surface.limit_faces)
    quarter, _ = quarters(surface, found.u, found.v)
    known = np.isfinite(surface.evaluate(np.arange(n), 0.3, 0.3)).all(axis=1)
    counts = np.bincount(4 * found.face + quarter, minlength=4 * n).reshape(n, 4)
    assert not counts[~known].any()
    assert alike(counts[known].ravel(), np.ones(4 * known.sum()))
    assert np.isfinite(found.point).all()


@pytest.mark.parametrize("name", ["cube", "open", "loop", "ball", "dart"])
def test_blue_noise_keeps_its_distance(name):
    surface, n = MANY[name](), 600
    found = ls.sample(surface, n, method="blue_noise", rng=1)
    assert len(found) == n == len(np.unique(found.point, axis=0))
    assert found.spacing == pytest.approx(pdist(found.point).min(), rel=1e-12)
    _, parts = quarters(surface, found.u, found.v)
    faces = len(surface.limit_faces)
    total = areas(surface, np.repeat(np.arange(faces), 4), np.tile(parts, (faces, 1, 1))).sum()
    best = 2 * np.sqrt(total / (2 * np.sqrt(3) * n))
    assert 0.6 * best < found.spacing < best
    assert ls.sample(surface, n, rng=1).spacing is None
    # and no place is far from all of them
    other = ls.sample(surface, 500, rng=2).point
    gap = np.sqrt(((other[:, None] - found.point) ** 2).sum(axis=2)).min(axis=1)
    assert gap.max() < 1.1 * best


def test_the_order_of_elimination_is_that_of_one_by_one():
    from limitsurf.query.samples import _ALPHA, _BETA, _GAMMA, _apart

    rng = np.random.default_rng(4)
    points = np.column_stack([rng.random((300, 2)), np.zeros(300)])
    kept = _apart(points, 60, 1.0)
    most = np.sqrt(1 / (2 * np.sqrt(3) * 60))
    least = most * (1 - (60 / 300) ** _GAMMA) * _BETA
    far = np.sqrt(((points[:, None] - points) ** 2).sum(axis=2))
    weight = np.maximum(1 - np.clip(far, 2 * least, None) / (2 * most), 0) ** _ALPHA
    np.fill_diagonal(weight, 0)
    left = np.arange(300)
    while len(left) > 60:
        total = weight[np.ix_(left, left)].sum(axis=1)
        left = np.delete(left, total.argmax())
    assert kept.tolist() == left.tolist()


@pytest.mark.parametrize("method", ["area", "parameter", "blue_noise"])
def test_the_same_seed_gives_the_same_samples(method):
    surface = made(zoo.prism(5))
    one, two = (ls.sample(surface, 1500, method=method, rng=11, workers=k) for k in (1, 2))
    for name in ("face", "u", "v", "point", "normal"):
        assert (getattr(one, name) == getattr(two, name)).all()
    rng = np.random.default_rng(11)
    again = ls.sample(surface, 1500, method=method, rng=rng)
    assert (again.u == one.u).all()
    assert not (ls.sample(surface, 1500, method=method, rng=rng).u == one.u).any()
    assert len(ls.sample(surface, 7, method=method)) == 7
    for n in (0, 1, 2):
        few = ls.sample(surface, n, method=method, rng=0)
        assert few.point.shape == few.normal.shape == (n, 3)
        assert few.face.dtype == np.int64


@pytest.mark.parametrize("power", [-600, -30, 40, 600])
def test_units_do_not_matter(power):
    points, faces = zoo.cube()
    surface = made((points, faces))
    scaled = surface.with_points(np.ldexp(surface.points, power))
    for method in ("area", "blue_noise"):
        one, two = (ls.sample(s, 50, method=method, rng=1) for s in (surface, scaled))
        assert (one.u == two.u).all()
        if method == "blue_noise":
            assert two.spacing == pytest.approx(np.ldexp(one.spacing, power), rel=1e-12)


def test_what_cannot_be_sampled_is_refused():
    surface = made(zoo.cube())
    for n in (-1, 2.0, True, "3", None):
        with pytest.raises(ValueError, match="n must be an integer >= 0"):
            ls.sample(surface, n)
    with pytest.raises(ValueError, match="area, parameter, blue_noise, got 'grid'"):
        ls.sample(surface, 3, method="grid")
    for rng in ("x", -1, 0.5):
        with pytest.raises((TypeError, ValueError), match="rng must be None, an integer >= 0"):
            ls.sample(surface, 3, rng=rng)
    with pytest.raises(TypeError, match="need a LimitSurface, got Mesh"):
        ls.sample(surface.mesh, 3)
    with pytest.raises(MemoryError):
        ls.sample(surface, 10**13)
    line = np.outer([0, 0.37, 1, 0.2], [0.3, 0.7, 0.9])
    for points in (np.zeros((4, 3)), line, line + np.array([1e5, 3e5, 2e5])):
        flat = made((points, [[0, 1, 2, 3]]))
        with pytest.raises(ValueError, match="the surface has no area"):
            ls.sample(flat, 3)
        assert len(ls.sample(flat, 3, method="parameter")) == 3
        assert len(ls.sample(flat, 0)) == 0
    nothing = made((*zoo.grid(1, 1), {"holes": [0]}))
    for method in ("area", "parameter", "blue_noise"):
        with pytest.raises(ValueError, match="there is no limit face"):
            ls.sample(nothing, 1, method=method)
    broken = surface.points.copy()
    broken[3, 1] = np.nan
    with pytest.raises(ValueError, match="finite"):
        ls.sample(surface.with_points(broken), 3)


def test_densities_are_those_of_jets():
    surface = made(zoo.prism(5))
    cells = Cells.of(surface)
    rng = np.random.default_rng(0)
    which, (s, t) = rng.integers(len(cells.points), size=40), rng.random((2, 40))
    u, v = (cells.origin[which] + np.stack([s, t], axis=1) * cells.size[which]).T
    jet = surface.jet(cells.face[which], u, v, order=1)
    truth = np.sqrt((np.cross(jet[1, 0], jet[0, 1]) ** 2).sum(axis=1))
    truth *= np.abs(cells.size[which]).prod(axis=1) * 4.0**cells.power
    assert _density(cells.form, cells.points[which], s, t) == pytest.approx(truth, rel=1e-11)
