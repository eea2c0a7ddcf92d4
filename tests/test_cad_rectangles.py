"""Limit faces in rectangles: as few as hand counts and brute force say, with poles at corners."""

from itertools import combinations

import numpy as np
import pytest
import zoo
from scipy.interpolate import NdBSpline

import limitsurf as ls
from limitsurf.cad.chords import independent
from limitsurf.cad.rectangles import rectangles

SHAPES = {
    "square": (["##", "##"], 1),
    "L": (["#..", "#..", "###"], 2),
    "T": (["###", ".#.", ".#."], 2),
    "plus": ([".#.", "###", ".#."], 3),
    "U": (["#.#", "#.#", "###"], 3),
    "Z": (["##.", ".##"], 2),
    "ring": (["###", "#.#", "###"], 4),
    "stairs": (["#...", "##..", "###.", "####"], 4),
    "comb": (["#.#.#", "#####"], 4),
    "saw": (["#.#.#.#", "#######", "#.#.#.#"], 7),  # its columns
    "two": (["##.##", "##.##"], 2),
    # upright lines of two edges cross one of three: the former are more
    "lanes": ([".#.#.", "#####", "#####", ".#.#."], 5),
}


def filled(mask):
    """Rectangles of the faces of a plane grid that are in a mask."""
    mask = np.asarray(mask)
    a, b = mask.shape
    points, quads = zoo.grid(a, b)
    surface = ls.LimitSurface(ls.Mesh(points, quads))
    own = np.zeros(len(quads), dtype=bool)
    middles = np.array(points)[np.array(quads)].mean(axis=1)[:, :2]
    place = [np.unique(x.round(6), return_inverse=True)[1] for x in middles.T]
    if len(np.unique(place[0])) != a:
        place = place[::-1]
    own[:] = mask[place[0], place[1]]
    none = np.zeros(surface.mesh.n_edges, dtype=bool)
    found = rectangles(surface, own, none, np.zeros((len(quads), 4), dtype=bool))
    assert sorted(found.faces.tolist()) == np.flatnonzero(own).tolist()
    return found


@pytest.mark.parametrize("name", SHAPES)
def test_hand_counted_regions(name):
    rows, least = SHAPES[name]
    assert len(filled([[c == "#" for c in row] for row in rows]).grid) == least


def least(mask):
    """The least number of rectangles, by trying all sets of chords of a region of cells."""
    m = np.pad(mask, 1)
    a, b = m.shape
    around = {}
    for i in range(1, a):
        for j in range(1, b):
            around[i, j] = [bool(m[i - 1 + p, j - 1 + q]) for p in (0, 1) for q in (0, 1)]
    if any(x in ([True, False, False, True], [False, True, True, False]) for x in around.values()):
        return None
    concave = {x for x, cells in around.items() if sum(cells) == 3}
    chords = []
    for i, j in concave:
        for di, dj in ((1, 0), (0, 1)):
            at, way = (i, j), [(i, j)]
            while True:
                i0, j0 = at
                sides = ((i0, j0 - 1), (i0, j0)) if di else ((i0 - 1, j0), (i0, j0))
                if not all(m[x] for x in sides):
                    break
                at = (i0 + di, j0 + dj)
                way.append(at)
                if sum(around[at]) != 4:
                    break
            if at in concave and len(way) > 1 and at == way[-1]:
                chords.append(frozenset(way))
    best = 0
    for k in range(len(chords), 0, -1):
        if any(
            all(not x & y for x, y in combinations(some, 2)) for some in combinations(chords, k)
        ):
            best = k
            break
    from scipy.ndimage import label

    whole = np.ones((3, 3))
    holes = label(~m, whole)[1] - 1
    return len(concave) - best - holes + label(m)[1]


def test_random_regions_have_as_few_as_there_are():
    rng = np.random.default_rng(5)
    seen = 0
    while seen < 40:
        mask = np.kron(rng.random((4, 5)) < 0.7, np.ones((1, 1))) > 0
        count = least(mask)
        if count is None or not mask.any():
            continue
        seen += 1
        assert len(filled(mask).grid) == count, mask.astype(int)


def test_largest_independent_sets_by_brute_force():
    rng = np.random.default_rng(3)
    for _ in range(60):
        n = 9
        # lines of two directions, each of some places of a grid
        ways = []
        for k in range(n):
            x, low = rng.integers(0, 6, 2)
            run = np.arange(low, low + rng.integers(1, 5))
            ways.append([(x, y) if k % 2 else (y, x) for y in run])
        # those of one direction do not overlap
        kept = []
        for k, way in enumerate(ways):
            if not any(set(way) & set(other) for j, other in kept if (k - j) % 2 == 0):
                kept.append((k, way))
        ways = [way for _, way in kept]
        place = np.array([10 * x + y for way in ways for x, y in way])
        line = np.repeat(np.arange(len(ways)), [len(way) for way in ways])
        found = independent(place, line, np.ones(len(ways), dtype=bool))
        sets = [set(way) for way in ways]

        def apart(some, sets=sets):
            return all(not sets[a] & sets[b] for a, b in combinations(some, 2))

        assert apart(np.flatnonzero(found))
        most = max(
            k for k in range(len(ways) + 1) if any(map(apart, combinations(range(len(ways)), k)))
        )
        assert found.sum() == most


def test_lines_that_cross_their_own_kind_are_still_apart():
    # three that cross each other, and one that crosses itself
    place = np.array([0, 0, 1, 1, 2, 2, 7, 7])
    line = np.array([0, 1, 1, 2, 2, 0, 3, 3])
    found = independent(place, line, np.ones(4, dtype=bool))
    assert found[:3].sum() == 1
    assert found[3]
    assert not independent(place[:0], line[:0], np.zeros(0, dtype=bool)).any()


def patch_of_poles(side, valence=5):
    """A pole amid squares of `side` faces, refined from one ring of quads."""
    points, faces = zoo.flower(valence)
    return ls.refined(ls.Mesh(points, faces), int(np.log2(side)))


@pytest.mark.parametrize("options", [{"depth": 6}, {"tolerance": 1e-4}])
def test_rectangles_with_poles_at_corners_are_the_limit(options):
    surface = ls.LimitSurface(patch_of_poles(4))
    merged = ls.bspline_faces(surface, **options)
    apart = ls.bspline_faces(surface, merge=False, **options)
    assert len(merged) < len(apart) / 3
    assert len(merged.points) < len(apart.points)
    rng = np.random.default_rng(0)
    face = rng.integers(0, len(surface.limit_faces), 4000)
    u, v = rng.random((2, 4000)) ** 3
    one = merged.evaluate(*merged.of(face, u, v))
    other = apart.evaluate(*apart.of(face, u, v))
    size = np.abs(surface.points).max()
    assert np.abs(one - other).max() < 1e-14 * size  # the same cells at poles, too
    far = np.linalg.norm(one - surface.evaluate(face, u, v), axis=1)
    assert (far <= merged.deviation[merged.of(face, u, v)[0]] + 1e-14 * size).all()
    assert ls.deviation(surface, merged).gap.max() < 4e-15 * size
    for k in rng.choice(len(merged), 5):
        one_face = merged[k]
        knots = one_face.knots_u, one_face.knots_v
        oracle = NdBSpline(knots, one_face.points, one_face.degree)
        at = rng.random((60, 2)) * merged.grid[k]
        assert np.abs(oracle(at) - merged.evaluate(k, *at.T)).max() < 4e-15 * size


def test_rows_along_semi_sharp_creases_are_one_face():
    points, quads = zoo.grid(6, 4)
    mesh = ls.Mesh(points, quads)
    inner = mesh.edges[mesh.twin[np.unique(mesh.corner_edge, return_index=True)[1]] >= 0]
    at = np.array(points)[inner]
    middle = np.median(np.unique(np.array(points)[:, 1]))
    along = (np.abs(at[:, :, 1] - middle) < 1e-9).all(axis=1)
    assert along.sum() > 2
    points = np.array(points, dtype=float)
    points[:, 2] = np.sin(points).sum(axis=1)
    tags = {tuple(edge): 1.5 + (k % 2) for k, edge in enumerate(inner[along].tolist())}
    surface = ls.LimitSurface(ls.Mesh(points, quads, creases=tags))
    found = ls.bspline_faces(surface)
    assert len(found) < len(surface.limit_faces) / 4
    rng = np.random.default_rng(2)
    face, (u, v) = rng.integers(0, len(quads), 3000), rng.random((2, 3000))
    step = found.evaluate(*found.of(face, u, v)) - surface.evaluate(face, u, v)
    assert np.abs(step).max() < 1e-14 * np.abs(points).max()


def test_dual_rectangles_have_knots_between_sides_alone():
    points, quads = zoo.torus(9, 6)
    surface = ls.LimitSurface(ls.Mesh(points, quads), scheme="doo-sabin")
    found = ls.bspline_faces(surface)
    assert found.exact.all()
    assert (found.counts == found.grid + 3).all()
    rng = np.random.default_rng(4)
    face, (u, v) = rng.integers(0, len(quads), 2000), rng.random((2, 2000))
    step = found.evaluate(*found.of(face, u, v)) - surface.evaluate(face, u, v)
    assert np.abs(step).max() < 1e-14 * np.abs(points).max()
