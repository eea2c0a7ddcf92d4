"""What holds for every scheme: those that are registered, and some that only this file knows.

Each is compared with a naive exact evaluator of its own; a scheme that is registered without one
fails.
"""

import functools
from collections.abc import Callable
from fractions import Fraction as F
from pathlib import Path
from typing import NamedTuple

import numpy as np
import oracles
import oracles_bilinear
import oracles_creases
import oracles_doo_sabin
import oracles_loop
import pytest
import zoo
import zoo_triangles
from oracles_creases import Cage

import limitsurf as ls
from limitsurf.scheme.doo_sabin import DOO_SABIN
from limitsurf.scheme.lattice import DUAL_QUADS, QUADS, TRIANGLES
from limitsurf.scheme.loop import LOOP, LOOP_WARREN

SITE = Path(__file__).parents[1] / "notebooks" / "site"


class Kind(NamedTuple):
    """A scheme, what evaluates it naively, and cages for it: their points and faces, and tags."""

    scheme: ls.Scheme
    surface: Callable
    refine: Callable
    cages: dict
    rational: Callable  # whether Fractions go in and out


def of_zoo(module, names):
    return {name: (module.ZOO if name in module.ZOO else module.TAGGED)[name] for name in names}


def bounded(name, boundary):
    """A cage of the zoo with that rule at its boundary."""
    points, faces = zoo.ZOO[name]()
    return points, faces, {"boundary": boundary}


DUAL_CAGES = {
    **of_zoo(
        zoo,
        ["cube", "tetrahedron", "prism_7", "bipyramid_9", "carved_cube_1", "torus_3x3", "grid_3x3",
         "heptagon", "corner_of_three"],
    ),
    **{f"half_disk_{n}": functools.partial(bounded, f"half_disk_{n}", "edge_only")
       for n in (2, 5)},
    "grid_edge_only": functools.partial(bounded, "grid_3x3", "edge_only"),
    "disk_none": functools.partial(bounded, "disk_7", "none"),
}  # fmt: skip
QUAD_CAGES = of_zoo(
    zoo, ["cube", "tetrahedron", "prism_7", "carved_cube_1", "torus_3x3", "grid_3x3"]
)
TRIANGLE_CAGES = of_zoo(
    zoo_triangles,
    ["tetrahedron", "octahedron", "icosahedron", "crowded", "bipyramid_12", "torus_3x4", "sphere_1",
     "triangle", "fan_2", "fan_3", "fan_7", "ringed_fan_1", "ringed_fan_3", "ringed_fan_6",
     "strip_3", "grid_4x4", "disc_8", "patch_0", "dart_5", "dart_6", "crease_2_of_6",
     "crease_3_of_6", "crease_6_of_8", "corner_3", "corner_1_and_5", "cone_5", "semi_2.5",
     "semi_dart", "semi_corner", "chaikin", "tagged_sphere_0", "tagged_patch_0", "tagged_patch_1",
     "tagged_patch_2", "holes"],
)  # fmt: skip


def valences(faces):
    return np.bincount(np.concatenate([np.ravel(face) for face in faces]))


def always(faces):
    return True


def dual_rational(faces, *tags):
    """Faces, and vertices, of 3, 4 and 6 corners, and of 1 to 3 faces on boundaries."""
    fans = oracles_doo_sabin.fans_of([list(map(int, face)) for face in faces])
    sizes = {len(face) for face in faces} | {len(x.corners) for x in fans if x.closed}
    return sizes <= {2, 3, 4, 6} and all(x.closed or len(x.corners) <= 3 for x in fans)


KINDS = {
    "catmull-clark": Kind(
        ls.schemes["catmull-clark"],
        oracles_creases.TaggedSurface, oracles_creases.refine, QUAD_CAGES, always,
    ),
    "doo-sabin": Kind(
        DOO_SABIN,
        oracles_doo_sabin.DooSabinSurface, oracles_doo_sabin.refine, DUAL_CAGES, dual_rational,
    ),
    "loop": Kind(
        LOOP, oracles_loop.LoopSurface, oracles_loop.refine, TRIANGLE_CAGES,
        lambda faces: set(valences(faces).tolist()) <= {0, 1, 2, 3, 4, 6},
    ),
    "loop-warren": Kind(
        LOOP_WARREN,
        functools.partial(oracles_loop.LoopSurface, weight=oracles_loop.warren_weight),
        functools.partial(oracles_loop.refine, weight=oracles_loop.warren_weight),
        TRIANGLE_CAGES, always,
    ),
    "bilinear": Kind(
        ls.schemes["bilinear"],
        oracles_bilinear.BilinearSurface, oracles_bilinear.refine_bilinear,
        of_zoo(zoo, ["cube", "prism_7", "carved_cube_1", "grid_3x3", "ring_2.5", "tagged_boundary",
                     "chaikin_row", "semi_sharp_flap", "holes"]), always,
    ),
    "linear": Kind(
        ls.schemes["linear"],
        oracles_bilinear.LinearSurface, oracles_bilinear.refine_linear,
        of_zoo(zoo_triangles, ["crowded", "bipyramid_12", "fan_7", "semi_2.5", "chaikin",
                               "tagged_patch_1", "tagged_patch_2", "holes"]), always,
    ),
}  # fmt: skip
EVERY = [
    pytest.param(kind, name, id=f"{kind}-{name}") for kind in KINDS for name in KINDS[kind].cages
]
every = pytest.mark.parametrize(("kind", "name"), EVERY)
ENGINES = pytest.mark.parametrize("engine", ["reference", "compiled"])


def test_every_registered_scheme_is_here():
    assert ls.schemes.with_pieces.keys() <= KINDS.keys()
    assert {scheme.lattice for scheme in ls.schemes.values()} <= {QUADS, DUAL_QUADS, TRIANGLES}


@pytest.mark.parametrize("page", ["howto/schemes.md", "comparison.md"])
def test_every_registered_scheme_has_its_row_in_documents(page):
    text = (SITE / page).read_text("utf-8")
    for name, scheme in ls.schemes.items():
        assert f"\n| `{name}` | " in text, f"{page} has no row of {name}"
        assert scheme.paper, name


def test_schemes_are_listed():
    assert list(ls.schemes) == [scheme.name for scheme in ls.schemes.values()]
    lines = str(ls.schemes).splitlines()
    for line, (name, scheme) in zip(lines, ls.schemes.items(), strict=True):
        assert line.split()[:2] == [name, scheme.lattice.name]
        assert line.endswith(scheme.paper)
    with pytest.raises(TypeError):
        ls.schemes["mine"] = LOOP


@functools.cache
def given(kind, name):
    """The mesh, an oracle, and the faces and tags of a cage."""
    points, faces, *tags = KINDS[kind].cages[name]()
    tags = tags[0] if tags else {}
    points = np.random.default_rng(len(points)).integers(-64, 65, (len(points), 3)) / 64 + np.array(
        points, dtype=float
    )
    if "creases" in tags:
        tags = tags | {"creases": dict(tags["creases"])}
    mesh = ls.Mesh(points, faces, **tags)
    exact = [tuple(map(F, point)) for point in points.tolist()]
    return mesh, Cage(exact, [list(map(int, f)) for f in faces], **tags), faces


@functools.cache
def oracle(kind, name):
    return KINDS[kind].surface(given(kind, name)[1])


@functools.cache
def surface(kind, name, engine="auto"):
    return ls.LimitSurface(given(kind, name)[0], scheme=KINDS[kind].scheme, engine=engine)


def coordinates(lattice, u, v):
    return [a + b * u + c * v for a, b, c in lattice.sides]


def inside(lattice, rng, n):
    """Random (u, v) in the domain, some near its corners, (n, 2)."""
    uv = rng.random((4 * n, 2))
    uv = uv[np.all([x >= 0 for x in coordinates(lattice, *uv.T)], axis=0)][:n]
    near = 10.0 ** -rng.integers(1, 13, len(uv) // 2)
    corners = np.array(lattice.corners, dtype=float)[
        rng.integers(0, len(lattice.corners), len(near))
    ]
    half = len(near)
    uv[:half] = corners + near[:, None] * (uv[:half] - corners)
    return uv


def queries(kind, name, n=8):
    s, rng = surface(kind, name), np.random.default_rng(len(name))
    lattice = KINDS[kind].scheme.lattice
    face = rng.integers(0, len(s.limit_faces), n)
    return face, *inside(lattice, rng, n).T


@functools.cache
def true(kind, name, order):
    """All derivatives of an order at `queries`; the oracle remembers its walk to each of them."""
    orders = [(order - j, j) for j in range(order + 1)]
    rows = [
        [oracle(kind, name).evaluate(int(f), x, y, nu) for nu in orders]
        for f, x, y in zip(*(a.tolist() for a in queries(kind, name)), strict=True)
    ]
    columns = zip(*rows, strict=True)
    return {
        nu: np.array([[float(x) for x in row] for row in column])
        for nu, column in zip(orders, columns, strict=True)
    }


@ENGINES
@every
def test_values_are_the_oracles(kind, name, engine):
    face, u, v = queries(kind, name)
    s, size = surface(kind, name, engine), np.ptp(given(kind, name)[0].points)
    for m in range(5 if engine == "reference" else 3):
        needed = true(kind, name, m)
        pairs = [(values, s.evaluate(face, u, v, nu=nu)) for nu, values in needed.items()]
        # of all derivatives of the order, each query by itself
        largest = np.max([np.abs(np.nan_to_num(needed)) for needed, _ in pairs], axis=(0, 2))
        # higher ones are bounded by the largest on their ring, which may be larger
        rtol = 1e-12 if m == 1 else 1e-11
        bound = 1e-14 * size if m == 0 else rtol * np.maximum(largest, 1e-3 * size)[:, None]
        for needed, found in pairs:
            assert np.array_equal(np.isnan(needed), np.isnan(found))
            error = np.abs(np.nan_to_num(found - needed))
            assert (error <= bound + 4e-16 * np.abs(np.nan_to_num(needed))).all(), m


@every
def test_fractions_are_the_oracles(kind, name):
    mesh, _, faces = given(kind, name)
    if not KINDS[kind].rational(faces):
        pytest.skip("masks are irrational")
    face, u, v = queries(kind, name, 3)
    s = surface(kind, name)
    u, v = (
        np.array([F(x).limit_denominator(64) for x in y.tolist()], dtype=object) for y in (u, v)
    )
    keep = np.array(
        [min(coordinates(KINDS[kind].scheme.lattice, *x)) >= 0 for x in zip(u, v, strict=True)]
    )
    face, u, v = face[keep], u[keep], v[keep]
    exact = s.with_points(np.vectorize(F, otypes=[object])(mesh.points))
    for nu in ((0, 0), (1, 0), (0, 2)):
        found = exact.evaluate(face, u, v, nu=nu)
        for row, f, x, y in zip(found, face.tolist(), u, v, strict=True):
            needed = oracle(kind, name).evaluate(f, x, y, nu)
            known = all(x == x for x in needed)  # the oracle knows no derivatives at vertices
            assert not known or list(row) == list(needed)


@ENGINES
@every
def test_weights_and_jets(kind, name, engine):
    face, u, v = queries(kind, name)
    s, mesh = surface(kind, name, engine), given(kind, name)[0]
    jet = s.jet(face, u, v, order=2)
    for nu in ((0, 0), (1, 0), (1, 1)):
        W = s.weights(face, u, v, nu=nu)
        value = s.evaluate(face, u, v, nu=nu)
        there = ~np.isnan(value[:, 0])
        # from a vertex, as weights come from it: nothing is lost where they are large
        points = mesh.points - mesh.points[W.indices[0]] * (nu != (0, 0))
        size = np.ptp(mesh.points) * (0.1 + np.abs(W[there]).sum(axis=1))
        assert (np.abs((W @ points)[there] - value[there]) <= 1e-13 * size[:, None]).all()
        sums = W.sum(axis=1)[there]
        bound = 1e-13 * (0.1 + np.abs(W[there]).sum(axis=1))
        assert (np.abs(sums - (nu == (0, 0))) <= bound).all()
        np.testing.assert_allclose(jet[nu], value, rtol=1e-12, atol=1e-15)


@ENGINES
@every
def test_normals_tangents_and_curvature(kind, name, engine):
    face, u, v = queries(kind, name)
    s = surface(kind, name, engine)
    jet, normal = s.jet(face, u, v, order=2), s.normal(face, u, v)
    du, dv = jet[1, 0], jet[0, 1]
    cross = np.cross(du, dv)
    sine = np.linalg.norm(cross, axis=1) / (np.linalg.norm(du, axis=1) * np.linalg.norm(dv, axis=1))
    clear = sine > 1e-3
    unit = cross / np.linalg.norm(cross, axis=1)[:, None]
    assert (np.abs(normal - unit)[clear] < 1e-10).all()
    tangents = s.tangents(face, u, v)
    for found, along in zip(tangents, (du, dv), strict=True):
        expected = along / np.linalg.norm(along, axis=1)[:, None]
        assert (np.abs(found - expected)[clear] < 1e-10).all()
    # nearer to a vertex these formulas lose digits
    clear &= np.min(coordinates(KINDS[kind].scheme.lattice, u, v), axis=0) > 1e-2
    k = s.curvature(face, u, v)
    first = [(a * b).sum(axis=1) for a, b in ((du, du), (du, dv), (dv, dv))]
    second = [(jet[nu] * unit).sum(axis=1) for nu in ((2, 0), (1, 1), (0, 2))]
    (E, G_, H), (L, M, N) = first, second
    area = E * H - G_**2
    gaussian, mean = (L * N - M**2) / area, (L * H - 2 * M * G_ + N * E) / (2 * area)
    size = np.maximum(np.abs(k.k1), np.abs(k.k2))
    known = clear & ~np.isnan(size)
    assert (np.abs(k.gaussian - gaussian)[known] <= 1e-7 * size[known] ** 2 + 1e-15).all()
    assert (np.abs(k.mean - mean)[known] <= 1e-7 * size[known] + 1e-15).all()


@every
def test_refined_is_naively_refined(kind, name):
    mesh, cage, _ = given(kind, name)
    fine, R = ls.refined(mesh, 2, scheme=KINDS[kind].scheme, operator=True)
    needed = KINDS[kind].refine(KINDS[kind].refine(cage))
    assert [list(f) for f in fine.faces] == [list(f) for f in needed.faces]
    points = np.array([[float(x) for x in p] for p in needed.points])
    size = np.ptp(mesh.points)
    assert np.abs(fine.points - points).max() <= 1e-14 * size
    assert np.abs(R @ mesh.points - points).max() <= 1e-14 * size
    assert set(fine.holes.tolist()) == set(needed.holes)


@every
def test_refined_vertices_are_where_they_say(kind, name):
    fine = ls.refined(given(kind, name)[0], 2, scheme=KINDS[kind].scheme)
    used = np.flatnonzero(fine.parent_face >= 0)
    place = (x[used] for x in (fine.parent_face, fine.parent_u, fine.parent_v))
    found = surface(kind, name).evaluate(*place)
    size = np.ptp(given(kind, name)[0].points)
    # on holes vertices have limits, but faces have none
    known = ~np.isnan(found[:, 0])
    assert known.all() or len(fine.holes) or given(kind, name)[0].boundary == "none"
    np.testing.assert_allclose(
        found[known], fine.limit_points[used][known], rtol=0, atol=2e-14 * size
    )


@every
def test_bezier_patches_are_the_surface(kind, name):
    s = surface(kind, name)
    patches = ls.bezier_patches(s, depth=3)
    points = np.abs(patches.points.reshape(len(patches), -1, 3))
    assert len(patches) or not len(s.limit_faces) or points.size == 0
    # the first coefficient is the value at the cell's corner 0
    first = patches.points.reshape(len(patches), -1, 3)[:, 0]
    found = s.evaluate(patches.face, *patches.origin.T)
    np.testing.assert_allclose(
        first, found, rtol=0, atol=2e-14 * np.ptp(given(kind, name)[0].points)
    )


def on_sides(lattice, t):
    """Places along all sides, from corner k to the next: (sides, len(t)) u and v."""
    corners = np.array(lattice.corners, dtype=float)
    ends = np.roll(corners, -1, axis=0)
    both = corners[:, None] + t[None, :, None] * (ends - corners)[:, None]
    return both[..., 0], both[..., 1]


@pytest.mark.parametrize(
    ("kind", "name"), [p for p in EVERY if KINDS[p.values[0]].scheme.lattice is TRIANGLES]
)
def test_continuity_across_edges(kind, name):
    mesh = given(kind, name)[0]
    s, t = surface(kind, name), np.array([1e-9, 0.3, 0.5, 0.8])
    h = np.flatnonzero(mesh.twin >= 0)
    here, there = on_sides(TRIANGLES, t), on_sides(TRIANGLES, 1 - t)
    side, other = h % 3, mesh.twin[h] % 3
    one = s.evaluate(h[:, None] // 3, here[0][side], here[1][side])
    two = s.evaluate(mesh.twin[h][:, None] // 3, there[0][other], there[1][other])
    both = ~(np.isnan(one) | np.isnan(two))
    assert (np.abs(one - two)[both] <= 2e-14 * np.ptp(mesh.points)).all()
    sharp = KINDS[kind].scheme.local or len(mesh.creases[0]) or len(mesh.corners[0])
    if not sharp:
        a = s.normal(h[:, None] // 3, here[0][side], here[1][side])
        b = s.normal(mesh.twin[h][:, None] // 3, there[0][other], there[1][other])
        both = ~(np.isnan(a) | np.isnan(b))
        assert (np.abs(a - b)[both] <= 1e-9).all()


@pytest.mark.parametrize("kind", KINDS)
def test_eigenbases_hold(kind):
    scheme = KINDS[kind].scheme
    if scheme.local:
        with pytest.raises(ValueError, match=rf"'{kind}' has no eigenbases: .* corners alone"):
            ls.eigenbasis(scheme, valence=5)
        return
    sectors = {"valence": 5}, {"kind": "crease", "faces": 2}, {"kind": "corner", "faces": 2}
    for what in sectors:
        if what.get("kind", "interior") not in scheme.kinds:
            with pytest.raises(ValueError, match="no rule for sharp edges"):
                ls.eigenbasis(scheme, **what)
            continue
        table = ls.eigenbasis(scheme, **what).float64
        assert np.abs(table.residual).max() < 1e-12
        assert table.eigenvalues.shape == (len(table.V),)
        assert table.eigenvalues[0] == 1


@ENGINES
@pytest.mark.skipif(not oracles.CASES.is_dir(), reason="no reference numbers here")
@pytest.mark.parametrize("valence", oracles_loop.reference_cases() or [3])
def test_reference_numbers(valence, engine):
    """Also at 1e-12 from the vertex."""
    case = oracles_loop.reference_cases()[valence]
    s = ls.LimitSurface(ls.Mesh(case["verts"], case["faces"]), scheme=LOOP, engine=engine)
    size = np.ptp(case["verts"])
    queries = case["target_face"], *case["uv"].T
    assert np.abs(s.evaluate(*queries) - case["P_true"]).max() <= 1e-14 * size
    pairs = [(s.evaluate(*queries, nu=nu), case[name]) for nu, name in
             (((1, 0), "Pu_true"), ((0, 1), "Pv_true"))]  # fmt: skip
    largest = np.max([np.abs(needed).max(axis=1) for _, needed in pairs], axis=0)[:, None]
    for found, needed in pairs:
        assert (np.abs(found - needed) <= 1e-12 * largest).all()
