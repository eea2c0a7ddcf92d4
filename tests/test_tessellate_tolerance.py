"""Polygons to a tolerance: no crack, and never farther from the surface than they say."""

from collections import Counter

import numpy as np
import pytest
import zoo
import zoo_triangles

import limitsurf as ls
from limitsurf.query.adaptive import WHOLE
from limitsurf.query.stitching import levels, stitched
from limitsurf.query.tessellation import _assembled
from limitsurf.query.wanted import Wanted

CUBE = zoo.cube()


def made(points, faces, *tags, scheme=None, **rules):
    mesh = ls.Mesh(np.asarray(points, dtype=float), faces, **(tags[0] if tags else {}), **rules)
    return ls.LimitSurface(mesh, scheme=scheme, engine="reference")


def tagged(name):
    points, faces, own = zoo.TAGGED[name]()
    return made(points, faces, own)


CASES = {
    "cube": lambda: made(*CUBE),
    "bipyramid": lambda: made(*zoo.bipyramid(16)),
    "ngons": lambda: made(*zoo.prism(5)),
    "semi": lambda: made(*CUBE, {"creases": {(0, 1): 1.5, (1, 3): 0.7}}),
    "dart": lambda: tagged("dart_5"),
    "corner": lambda: tagged("corner_3"),
    "crease": lambda: tagged("crease_3_3"),
    "holes": lambda: made(*zoo.torus(4, 5), {"holes": [3, 7]}),
    "none": lambda: made(*zoo.grid(4, 4), boundary="none"),
    "two_sided": lambda: tagged("opposite_orientation"),
    **{f"torus_of_{x}": (lambda x=x: made(*torus(x), scheme=x)) for x in ls.schemes.with_pieces},
    **{f"open_of_{x}": (lambda x=x: made(*grid(x), scheme=x)) for x in ls.schemes.with_pieces},
    "prism_of_doo-sabin": lambda: made(*zoo.prism(5), scheme="doo-sabin"),
    "flat_ngons": lambda: made(*zoo.truncated(zoo.octahedron()), scheme="bilinear"),
    "loop_dart": lambda: made(*zoo_triangles.TAGGED["dart_4"](), scheme="loop"),
}
CLOSED = ["cube", "bipyramid", "ngons", "semi", "prism_of_doo-sabin", "flat_ngons"]
CLOSED += [f"torus_of_{x}" for x in ls.schemes.with_pieces]


def torus(scheme):
    of_triangles = "triangles" in str(ls.schemes[scheme].lattice)
    return zoo_triangles.ZOO["torus_3x4"]() if of_triangles else zoo.torus(4, 5)


def grid(scheme):
    of_triangles = "triangles" in str(ls.schemes[scheme].lattice)
    return zoo_triangles.ZOO["grid_3x2"]() if of_triangles else zoo.grid(3, 3)


def runs(found):
    """How often polygons run along each directed edge."""
    after = np.arange(1, len(found.indices) + 1)
    after[found.offsets[1:] - 1] = found.offsets[:-1]
    ends = np.stack([found.indices, found.indices[after]], axis=1)
    return Counter(map(tuple, ends.tolist()))


def apart(points, a, b, c):
    """Distances (n,) of points from triangles, by trying the plane and every side."""
    found = np.full(len(points), np.inf)
    for p, q in ((a, b), (b, c), (c, a)):
        side = q - p
        share = ((points - p) * side).sum(axis=1) / np.maximum((side**2).sum(axis=1), 1e-300)
        near = p + np.clip(share, 0, 1)[:, None] * side
        found = np.minimum(found, np.linalg.norm(points - near, axis=1))
    normal = np.cross(b - a, c - a)
    area = np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    height = ((points - a) * normal).sum(axis=1) / area
    foot = points - (height / area)[:, None] * normal
    turns = [(np.cross(q - p, foot - p) * normal).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))]
    inside = np.min(turns, axis=0) > 0
    return np.where(inside, np.abs(height), found)


def distances(surface, parts, n, seed=0):
    """Of random places of the surface from the triangles with parameters around them."""
    stitches, sites, sizes, _, _ = parts
    first = np.cumsum(sizes) - sizes
    triangles = []
    for size in (3, 4):
        start = first[sizes == size]
        ways = [[0, 1, 2]] if size == 3 else [[0, 1, 2], [0, 2, 3], [0, 1, 3], [1, 2, 3]]
        triangles += [sites[start[:, None] + np.array(way)] for way in ways]
    triangles, rng = np.concatenate(triangles), np.random.default_rng(seed)
    triangles = triangles[rng.integers(0, len(triangles), n)]
    shares = rng.dirichlet((1, 1, 1), n)
    shares[: n // 3, 0] = 0  # on edges
    shares /= shares.sum(axis=1, keepdims=True)
    u, v = np.clip(np.einsum("nij,ni->jn", stitches.at[triangles] / WHOLE, shares), 0, 1)
    if surface.patches.lattice.sloped:
        v = np.minimum(v, 1 - u)
    points = surface.evaluate(stitches.face[stitches.row[triangles[:, 0]]], u, v)
    used, which = np.unique(triangles, return_inverse=True)
    corners = surface.evaluate(*stitches.places(used))[which.reshape(-1, 3)]
    return apart(points, *corners.swapaxes(0, 1))


def check_cover(surface, parts):
    """Polygons cover the parameters of each limit face, counter-clockwise: none twice, none not."""
    stitches, sites, sizes, owner, _ = parts
    first = np.cumsum(sizes) - sizes
    row = stitches.row[sites[first]]
    assert (stitches.row[sites] == np.repeat(row, sizes)).all()
    assert (stitches.face[row] == owner).all()
    after = np.arange(1, len(sites) + 1)
    after[first + sizes - 1] = first
    x, y = (stitches.at[sites] / WHOLE).T
    twice = np.add.reduceat(x * y[after] - x[after] * y, first)
    assert (twice > 0).all()
    total = 1 if surface.patches.lattice.sloped else 2
    assert np.bincount(row, twice, len(stitches.face)) == pytest.approx(total, abs=1e-9)


@pytest.mark.parametrize("name", CASES)
def test_no_gap_and_within_the_error_that_is_stated(name):
    surface = CASES[name]()
    size = np.ptp(surface.points, axis=0).max()
    parts = stitched(surface, Wanted(chord=1e-1 * size), 1)
    assert distances(surface, parts, 3000).max() <= parts[-1].chord <= 1e-1 * size
    check_cover(surface, parts)
    parts = stitched(surface, Wanted(chord=5e-3 * size), 1)
    far = distances(surface, parts, 9000).max()
    assert far <= parts[-1].chord <= 5e-3 * size
    assert far < 1e-9 * size or parts[-1].chord <= 3 * far
    check_cover(surface, parts)
    found = _assembled(surface, parts, True, (), 1)
    assert (found.points == surface.evaluate(found.face, found.u, found.v)).all()
    assert np.array_equal(np.unique(found.indices), np.arange(len(found.points)))
    assert np.array_equal(np.unique(found.normal_indices), np.arange(len(found.normals)))
    check_edges(name, surface, found)


def check_edges(name, surface, found):
    """Each edge has two sides but at boundaries, which are closed and as long as they should be."""
    edges = runs(found)
    if name == "two_sided":  # from both sides in the same direction
        both = Counter(tuple(sorted(edge)) for edge in edges.elements())
        assert set(both.values()) == {1, 2}
        return
    assert set(edges.values()) == {1}
    rim = [edge for edge in edges if edge[::-1] not in edges]
    if name in CLOSED:
        assert not rim
        assert len(found.points) - len(edges) // 2 + len(found.sizes) == 2 * ("torus" not in name)
    # what is open are closed curves, as long as those of the uniform polygons
    wanted = runs(uniform := ls.tessellate(surface, 8, normals=False))
    wanted = [edge for edge in wanted if edge[::-1] not in wanted]
    lengths = [
        np.linalg.norm(x.points[np.array(y)[:, 0]] - x.points[np.array(y)[:, 1]], axis=1).sum()
        for x, y in ((found, rim), (uniform, wanted))
        if len(y)
    ]
    assert len(lengths) in (0, 2)
    assert not lengths or abs(lengths[0] / lengths[1] - 1) < 0.1
    starts, ends = (Counter(edge[k] for edge in rim) for k in (0, 1))
    assert starts == ends


def test_seams_normals_and_data():
    points, faces = zoo.torus(4, 5)
    g = np.random.default_rng(3)
    rows = np.array(faces).ravel() + len(points) * (g.random(4 * len(faces)) < 0.2)
    uv = g.random((2 * len(points), 2)), rows, "corners_plus1"
    creases = {(faces[0][0], faces[0][1]): np.inf}
    data = {"id": np.arange(len(faces))}
    mesh = ls.Mesh(points, faces, channels={"uv": uv}, creases=creases, face_data=data)
    surface = ls.LimitSurface(mesh, engine="reference")
    found = ls.tessellate(surface, chord=0.02, channels="uv")
    stitches, sites, _, owner, _ = stitched(surface, Wanted(chord=0.02), 1)
    there = stitches.places(sites)
    values, of_values = found.channels["uv"]
    assert abs(values[of_values] - surface.evaluate(*there, channel="uv")).max() < 1e-13
    assert len(values) > len(found.points)
    normals = found.normals[found.normal_indices]
    assert np.nanmax(abs(normals - surface.normal(*there))) < 2e-6
    assert np.array_equal(found.face_data["id"], owner)
    assert abs(found.points[found.indices] - surface.evaluate(*there)).max() < 1e-13
    flat = found.split()
    assert flat.chord_error == found.chord_error
    assert np.array_equal(flat.indices, flat.channels["uv"][1])


def test_fewer_than_uniform_and_reproducible():
    points, faces = zoo.torus(4, 5)
    surface = made(points, faces)
    one, two = (ls.tessellate(surface, chord=1e-3, workers=k, normals=False) for k in (1, 2))
    assert np.array_equal(one.indices, two.indices)
    assert np.array_equal(one.points, two.points)
    coarse = ls.tessellate(surface, chord=1e-2, normals=False)
    assert 6 < len(one.sizes) / len(coarse.sizes) < 14


def test_edges_and_flat_faces():
    surface = made(*CUBE)
    found = ls.tessellate(surface, edge=0.1)
    corners = found.points[found.indices[found.triangles]]
    assert np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max() <= 0.1
    assert found.chord_error < 0.01
    # bent along u, and long along v
    bent = made([[0, 0, 0], [1, 0, 0.3], [2, 0, 0], [0, 99, 0], [1, 99, 0.3], [2, 99, 0]],
                [[0, 1, 4, 3], [1, 2, 5, 4]])  # fmt: skip
    assert len(ls.tessellate(bent, chord=1, edge=2, max_triangles=1000).sizes) < 500
    bent = made(*zoo.corner_of_three(), scheme="doo-sabin")
    assert len(ls.tessellate(bent, chord=1, edge=0.6, max_triangles=2000).sizes) < 1000
    flat = made(*zoo.grid(3, 3), scheme="bilinear")
    flat = flat.with_points(flat.points * [1, 1, 0])
    assert len(ls.tessellate(flat, chord=1e-9).sizes) == 9


def test_any_scale_and_place():
    wanted = len(ls.tessellate(made(*CUBE), chord=1e-2).sizes)
    for scale in (1e-200, 1e200):
        surface = made(np.array(CUBE[0]) * scale, CUBE[1])
        found = ls.tessellate(surface, chord=1e-2 * scale)
        assert len(found.sizes) == wanted
        assert found.chord_error <= 1e-2 * scale
    far = made(np.array(CUBE[0]) + 1e6, CUBE[1])
    assert abs(len(ls.tessellate(far, chord=1e-2).sizes) - wanted) < 0.05 * wanted
    with pytest.raises(ValueError, match="chord must be at least"):
        ls.tessellate(far, chord=1e-9)
    one = made(np.zeros((4, 3)), [[0, 1, 2, 3]])
    assert len(ls.tessellate(one, chord=1e-3).sizes) == 1
    nothing = made(*CUBE, {"holes": range(6)})
    assert len(ls.tessellate(nothing, chord=1e-3).sizes) == 0


@pytest.mark.parametrize("make", [lambda: zoo.bipyramid(64), lambda: zoo.prism(60)])
def test_wide_poles_and_polygons(make):
    surface = made(*make())
    parts = stitched(surface, Wanted(chord=0.02), 1)
    assert distances(surface, parts, 9000).max() <= parts[-1].chord <= 0.02
    check_cover(surface, parts)


def test_what_is_refused():
    surface = made(*CUBE)
    for bad in (0, -1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="chord must be above 0"):
            ls.tessellate(surface, chord=bad)
    with pytest.raises(TypeError, match="edge must be a number, got str"):
        ls.tessellate(surface, edge="1")
    with pytest.raises(TypeError, match="chords must be several numbers, got float"):
        ls.levels_of_detail(surface, 0.1)
    with pytest.raises(ValueError, match=r"got n=4 and chord=0\.1: give one"):
        ls.tessellate(surface, 4, chord=0.1)
    with pytest.raises(ValueError, match="n must be"):
        ls.tessellate(surface, 0)
    with pytest.raises(ValueError, match="takes 192 triangles, more than max_triangles=100"):
        ls.tessellate(surface, 4, max_triangles=100)
    need = len(ls.tessellate(surface, chord=0.01).triangles)
    assert len(ls.tessellate(surface, chord=0.01, max_triangles=need).triangles) == need
    with pytest.raises(ValueError, match=f"takes {need} triangles"):
        ls.tessellate(surface, chord=0.01, max_triangles=need - 1)
    with pytest.raises(ValueError, match=r"takes some .* triangles, more than max_triangles=10"):
        ls.tessellate(surface, chord=1e-9, max_triangles=10)
    with pytest.raises(MemoryError, match="allow for a larger error"):
        ls.tessellate(surface, chord=3e-13)


@pytest.mark.parametrize("name", ["cube", "ngons", "semi", "dart", "torus_of_loop"])
def test_levels_divide_each_other(name):
    surface = CASES[name]()
    size = np.ptp(surface.points, axis=0).max()
    chords = size * np.array([1e-1, 1e-2, 2e-3])
    before, fans = set(), set()
    every = levels(surface, [Wanted(chord=x) for x in chords], 1)
    for parts, chord in zip(every, chords, strict=True):
        stitches, sites, _, _, error = parts
        assert error.chord <= chord
        found = _assembled(surface, parts, False, (), 1)
        assert set(runs(found).values()) == {1}
        places = set(zip(found.face.tolist(), found.u.tolist(), found.v.tolist(), strict=True))
        # but for the middles of fans
        assert before - places <= fans
        assert len(before) < len(places)
        middles = stitches.places(np.setdiff1d(sites, stitches.loop))
        before, fans = places, set(zip(*(x.tolist() for x in middles), strict=True))


def test_levels_are_in_the_order_of_tolerances():
    surface = CASES["cube"]()
    fine, coarse = ls.levels_of_detail(surface, [0.002, 0.1], normals=False)
    one = ls.tessellate(surface, chord=0.1, normals=False)
    assert np.array_equal(one.points, coarse.points)
    assert fine.chord_error <= 0.002 < coarse.chord_error <= 0.1
    assert ls.levels_of_detail(surface, []) == []
