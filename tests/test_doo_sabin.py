"""Doo and Sabin's surfaces: reference numbers, volumes, curves, spectra, and what is refused."""

import json
import pickle
import tracemalloc
from dataclasses import replace
from fractions import Fraction as F

import numpy as np
import oracles_doo_sabin
import pytest
import sympy
import zoo
from oracles import CASES
from oracles_creases import Cage

import limitsurf as ls
from limitsurf.refine import dual
from limitsurf.scheme.doo_sabin import DOO_SABIN
from limitsurf.spectra.dual_fan import fan_of

REFERENCE = CASES.parent / "schemes"
NOWHERE = pytest.mark.skipif(not REFERENCE.is_dir(), reason="no reference numbers here")
ORDERS = [(1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]


def of_zoo(name, seed=0, **tags):
    points, faces = zoo.ZOO[name]()
    moved = np.array(points, dtype=float)
    moved += np.random.default_rng(seed).integers(-8, 9, moved.shape) / 64
    return ls.Mesh(moved, faces, scheme="doo-sabin", **tags)


def reference():
    """Cages by number, and rows of the reference data by the number of their cage."""
    cages = json.loads((REFERENCE / "doosabin_cages.json").read_text(encoding="utf-8"))
    with np.load(REFERENCE / "doosabin.npz") as data:
        rows = dict(data)
    for case in np.unique(rows["case"]).tolist():
        here = rows["case"] == case
        yield cages[case], {name: x[here] for name, x in rows.items()}


@NOWHERE
def test_reference_numbers():
    """Of ball arithmetic; also at 1e-12 from a vertex."""
    for cage, rows in reference():
        mesh = ls.Mesh(np.array(cage["points"], dtype=float), cage["faces"])
        s = ls.LimitSurface(mesh, scheme="doo-sabin", boundary=cage["boundary"])
        query, size = (rows["limit_face"], rows["u"], rows["v"]), np.ptp(mesh.points)
        position, normal = s.evaluate(*query), s.normal(*query)
        for found, true in ((position, rows["P"]), (normal, rows["normal"])):
            assert np.array_equal(np.isnan(found), np.isnan(true)), cage["name"]
        bound = 1e-14 * size + 2 * np.spacing(np.abs(rows["P"]))
        assert (np.abs(position - rows["P"]) <= bound)[~np.isnan(position)].all()
        assert np.nanmax(np.abs(normal - rows["normal"]), initial=0) <= 1e-12
        for of in (slice(0, 2), slice(2, 5)):
            largest = np.abs(np.nan_to_num(rows["D"][:, of])).max(axis=(1, 2))[:, None]
            for nu, true in zip(ORDERS[of], np.moveaxis(rows["D"][:, of], 1, 0), strict=True):
                found = s.evaluate(*query, nu=nu)
                known = ~np.isnan(true)
                error = np.abs(found - true) / np.maximum(largest, 1e-3 * size)
                assert (error[known] <= 1e-12).all(), (cage["name"], nu)


@NOWHERE
def test_the_oracle_against_reference_numbers():
    for cage, rows in reference():
        exact = [tuple(map(F, point)) for point in cage["points"]]
        own = Cage(exact, cage["faces"], boundary=cage["boundary"])
        oracle = oracles_doo_sabin.DooSabinSurface(own)
        for k in np.argsort(rows["depth"], kind="stable")[:2].tolist():
            place = int(rows["limit_face"][k]), rows["u"][k], rows["v"][k]
            found = np.array(oracle.evaluate(*place), dtype=float)
            assert np.array_equal(found, rows["P"][k], equal_nan=True)
            found = np.array(oracle.evaluate(*place, (1, 0)), dtype=float)
            known = ~np.isnan(found)
            assert (np.abs(found - rows["D"][k, 0])[known] <= 1e-15).all()


def integral(function, degree):
    """Exact integrals over the unit square of polynomials of so high a degree in s and in t."""
    n = degree + 1
    nodes = [F(k, degree) for k in range(n)]
    powers = np.array([[x**k for x in nodes] for k in range(n)], dtype=object)
    rows = [[*row, F(1, k + 1)] for k, row in enumerate(powers.tolist())]
    for k in range(n):  # Gauss and Jordan
        pivot = next(j for j in range(k, n) if rows[j][k])
        rows[k], rows[pivot] = rows[pivot], rows[k]
        rows[k] = [x / rows[k][k] for x in rows[k]]
        for j in range(n):
            if j != k:
                rows[j] = [x - rows[j][k] * y for x, y in zip(rows[j], rows[k], strict=True)]
    weights = [row[-1] for row in rows]
    return sum(
        a * b * function(s, t)
        for a, s in zip(weights, nodes, strict=True)
        for b, t in zip(weights, nodes, strict=True)
    )


def test_the_volume_of_the_cube_by_its_pieces():
    """Exactly: the rings around a vertex shrink by products of three eigenvalues, powers of 1/2."""
    points = [[F(x) - F(1, 2) for x in (k // 4, k // 2 % 2, k % 2)] for k in range(8)]
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    mesh = ls.Mesh(points, faces)
    rates = [F(1, 2**k) for k in range(2, 13)]
    patches = ls.bezier_patches(
        ls.LimitSurface(mesh, scheme="doo-sabin"), face=0, depth=len(rates) + 1
    )
    assert patches.degree == 2
    by_size = {}
    own = (patches.origin < 0.5).all(axis=1)  # of the 24 corners of faces, all of which are alike
    for size, points in zip(patches.size[own, 0].tolist(), patches.points[own], strict=True):

        def volume(s, t, points=points):
            one, two = [(1 - s) ** 2, 2 * s * (1 - s), s * s], [2 * (s - 1), 2 - 4 * s, 2 * s]
            three, four = [(1 - t) ** 2, 2 * t * (1 - t), t * t], [2 * (t - 1), 2 - 4 * t, 2 * t]
            x, along, across = (
                [sum(a * b * points[i, j, k] for i, a in enumerate(p) for j, b in enumerate(q))
                 for k in range(3)]
                for p, q in ((one, three), (two, three), (one, four))
            )  # fmt: skip
            return (
                x[0] * (along[1] * across[2] - along[2] * across[1])
                + x[1] * (along[2] * across[0] - along[0] * across[2])
                + x[2] * (along[0] * across[1] - along[1] * across[0])
            )

        by_size[size] = by_size.get(size, 0) + integral(volume, 5) / 3
    rings = [by_size[size] for size in sorted(by_size, reverse=True)]
    assert len(rings) == len(rates)
    # ring n is sum_k c_k rate_k^n: the sum over all n is sum_k c_k / (1 - rate_k)
    rows = [[*(r**n for r in rates), x] for n, x in enumerate(rings)]
    for k in range(len(rates)):
        rows[k] = [x / rows[k][k] for x in rows[k]]
        for j in range(len(rates)):
            if j != k:
                rows[j] = [x - rows[j][k] * y for x, y in zip(rows[j], rows[k], strict=True)]
    total = 24 * sum(row[-1] / (1 - r) for row, r in zip(rows, rates, strict=True))
    assert abs(total) == oracles_doo_sabin.CUBE_VOLUME == F(6241, 9920)


def along_boundary(mesh):
    """Limit faces, sides and corners on boundaries: those from each vertex towards the next."""
    first = ls.LimitSurface(mesh, scheme="doo-sabin").limit_faces.first
    for h in np.flatnonzero(mesh.twin < 0).tolist():
        face = int(mesh.corner_face[h])
        place = h - int(mesh.offsets[face])
        yield h, int(first[face]), place, int(mesh.sizes[face])


@pytest.mark.parametrize("boundary", ["edge_only", "edge_and_corner"])
@pytest.mark.parametrize("name", ["grid_3x3", "heptagon", "half_disk_5", "corner_of_three"])
def test_boundaries_are_quadratic_splines(name, boundary):
    """Of the boundary polygon, whatever faces there are; but at vertices that stay."""
    mesh = of_zoo(name, boundary=boundary)
    s = ls.LimitSurface(mesh)
    ends = mesh.indices[mesh.twin < 0], mesh.indices[mesh.next_corner[mesh.twin < 0]]
    after = dict(zip(*(x.tolist() for x in ends), strict=True))
    before = {b: a for a, b in after.items()}
    t = np.linspace(0, 1, 9)
    for h, limit, place, size in along_boundary(mesh):
        v = int(mesh.indices[h])
        if mesh.vertex_faces[v] == 1 and boundary == "edge_and_corner":
            start = s.evaluate(limit if size == 4 else limit + place, *corner(size, place))
            np.testing.assert_allclose(start, mesh.points[v], rtol=0, atol=1e-14)
            continue
        # half of the edge, from the vertex on; x counts from the middle of the edge before
        x = ((1 + t) / 2)[:, None]
        p, q, r = mesh.points[[before[v], v, after[v]]]
        curve = (1 - x) ** 2 / 2 * p + (x * (1 - x) + 0.5) * q + x**2 / 2 * r
        if size == 4:
            begin, end = (np.array(zoo_corner) for zoo_corner in (SQUARE[place], SQUARE[place - 3]))
            u, w = (begin + (end - begin) * t[:, None] / 2).T
            found = s.evaluate(limit, u, w)
        else:
            found = s.evaluate(limit + place, t, 0)
        np.testing.assert_allclose(found, curve, rtol=0, atol=1e-14)


SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]


def corner(size, place):
    """Where a limit face has the corner of a face."""
    return SQUARE[place] if size == 4 else (0, 0)


@pytest.mark.parametrize("name", ["cube", "prism_7", "bipyramid_9", "heptagon", "corner_of_three"])
@pytest.mark.parametrize("boundary", ["edge_only", "edge_and_corner", "none"])
def test_refining_keeps_the_limit(name, boundary):
    """At any place; and refining twice is refining by two."""
    mesh = of_zoo(name, boundary=boundary)
    s, rng = ls.LimitSurface(mesh), np.random.default_rng(0)
    face = rng.integers(0, len(s.limit_faces), 200)
    # nearer to the only face of a vertex that follows the curve, rounding leaves no normals
    most = 1 if boundary == "edge_only" else 40
    u, v = rng.random((2, 200)) ** rng.integers(1, 1 + most, (2, 200))
    gap, turned = ls.refinement_gap(s, face, u, v)
    assert gap <= 1e-14
    assert turned <= 1e-10
    once, twice = ls.refined(ls.refined(mesh)), ls.refined(mesh, 2)
    assert np.array_equal(once.indices, twice.indices)
    np.testing.assert_allclose(once.points, twice.points, rtol=0, atol=1e-15)
    table = ls.validate(s, 3)
    assert ls.agrees(s, table)


def along(s, corners, x):
    """Limit faces and parameters at places x (Q,) of half-edges (n,), from their starts: (n, Q)."""
    mesh, limit_faces = s.mesh, s.limit_faces
    face = mesh.corner_face[corners]
    place, size = corners - mesh.offsets[face], mesh.sizes[face][:, None]
    square = np.array(SQUARE, dtype=float)
    begin, end = square[place % 4], square[(place + 1) % 4]
    whole = begin[:, None] + x[:, None] * (end - begin)[:, None]
    # limit faces of others have half of the edge, from their own corner on
    near = x <= 0.5
    own = np.where(near, place[:, None], (place[:, None] + 1) % size)
    half = np.where(near, 2 * x, 0), np.where(near, 0, 2 - 2 * x)
    u, v = (np.where(size == 4, whole[..., k], half[k]) for k in (0, 1))
    return limit_faces.first[face][:, None] + np.where(size == 4, 0, own), u, v


@pytest.mark.parametrize(
    "name", ["bipyramid_9", "prism_12", "dodecahedron", "truncated_cube", "carved_cube_1"]
)
def test_continuity_everywhere(name):
    """Of positions and tangent planes, across all edges of all limit faces, n-gons and poles."""
    t = np.array([1e-9, 0.2, 0.5, 0.9])
    s = ls.LimitSurface(of_zoo(name))
    corners = np.arange(s.mesh.n_corners)
    one, two = along(s, corners, t), along(s, s.mesh.twin, 1 - t)
    assert np.abs(s.evaluate(*one) - s.evaluate(*two)).max() <= 1e-14
    assert np.abs(s.normal(*one) - s.normal(*two)).max() <= 1e-7
    fine = ls.tessellate(s, 4)
    assert len(fine.normals) == len(fine.points)  # one on all sides of each


def test_spectra():
    """Subdominant 1/2 of every n-gon; two Jordan blocks at 1/4 from n = 5 on; none below."""
    for n in (3, 4, 5, 6, 9, 50):
        basis = ls.eigenbasis("doo-sabin", valence=n)
        table = basis.float64
        assert table.size == n + 5
        assert np.array_equal(table.eigenvalues[:4], [1, 0.5, 0.5, 0.25])
        assert len(table.chains) == (2 if n > 4 else 0)
        assert np.array_equal(table.rates[0, table.chains], [0.25] * len(table.chains))
        assert table.has_bounded_curvature == (n <= 4)
        assert np.abs(table.residual).max() <= 1e-15
        assert np.abs(table.V @ table.Vinv - np.eye(n + 5)).max() <= 1e-14
    assert ls.eigenbasis("doo-sabin", valence=2).float64.eigenvalues[1] == 0.75


@pytest.mark.parametrize("n", [2, 3, 4, 6, 8])
def test_closed_forms_are_the_tables(n):
    basis = ls.eigenbasis("doo-sabin", valence=n)
    exact, table = basis.exact, basis.float64
    assert exact.residual.is_zero_matrix
    for name in ("A", "V", "J", "Vinv"):
        found = np.array(getattr(exact, name).evalf(20).tolist(), dtype=float)
        np.testing.assert_allclose(found, getattr(table, name), rtol=0, atol=1e-14)
    size = table.size
    assert max(map(abs, (exact.V * exact.Vinv - sympy.eye(size)).evalf(30))) < 1e-25
    masks = np.array(exact.tangent_masks, dtype=float).reshape(-1, size)
    assert np.allclose(masks, table.tangent_masks)


@pytest.mark.parametrize("engine", ["reference", "compiled"])
def test_near_poles_nothing_is_lost(engine):
    """At 1e-300 from a vertex of 9 and of 50 faces, and from the middle of a heptagon."""
    for name in ("bipyramid_9", "prism_7", "flower_64"):
        mesh = of_zoo(name)
        s, rng = ls.LimitSurface(mesh, engine=engine), np.random.default_rng(1)
        odd = s.limit_faces.corner >= 0
        face = np.flatnonzero(odd)[:3] if odd.any() else np.arange(3)
        for u in (1e-3, 1e-30, 1e-300):
            x = rng.random(3) + 0.1
            a, b = (
                s.evaluate(face, u * x, u, nu=(1, 0)),
                s.evaluate(face, u * x / 2, u / 2, nu=(1, 0)),
            )
            # at the vertex, of more than four corners, they neither vanish nor grow
            assert np.abs(a - b).max() <= 4 * u + 1e-12
            assert np.abs(s.normal(face, u * x, u) - s.normal(face, 0, 0)).max() <= 20 * u + 1e-12
        assert np.isfinite(s.evaluate(face, 1e-300, 1e-300)).all()


def grid(n, **tags):
    """Of n x n quads, two of them one hexagon, with points of a few binary digits."""
    i = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    quads = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]], axis=-1)
    quads = quads.reshape(-1, 4).tolist()
    (a, b, c, d), (_, _, e, f) = quads[:2]
    points = np.argwhere(i >= 0) + np.random.default_rng(n).integers(-8, 9, (len(i) ** 2, 2)) / 32
    points = np.column_stack([points, np.random.default_rng(0).integers(0, 64, len(points)) / 64])
    return ls.Mesh(points, [[a, b, c, e, f, d], *quads[2:]], **tags)


@pytest.mark.parametrize("scheme", ["doo-sabin", "bilinear"])
def test_kernels_know_faces_of_one_and_of_four_pieces(scheme):
    """Against Fractions on either side of the lines between pieces, and on these."""
    mesh = grid(6)
    s = ls.LimitSurface(mesh, scheme=scheme, engine="compiled")
    places = np.array([0, 0.25, 0.5, 1, 2.0**-40, 0.5 - 2.0**-40, 0.5 + 2.0**-40, 0.625])
    rng, n = np.random.default_rng(0), 60
    face, u, v = rng.integers(6, len(s.limit_faces), n), *rng.choice(places, (2, n))
    exact = [np.array([F(x) for x in q.tolist()], dtype=object) for q in (u, v)]
    for nu in [(0, 0), *ORDERS]:
        true = s.evaluate(face, *exact, nu=nu)
        unknown = np.array([[x != x for x in row] for row in true])
        rows = s.weights(face, u, v, nu=nu)
        for found in (s.evaluate(face, u, v, nu=nu), rows @ mesh.points):
            assert np.array_equal(np.isnan(found), unknown)
            error = np.array((np.where(unknown, 0, found) - np.where(unknown, 0, true)), float)
            assert np.abs(error).max() <= (1e-14 if nu == (0, 0) else 1e-12) * 4
    line = s.evaluate(face[:, None], 0.5, places)
    for k, v in enumerate(places.tolist()):
        assert np.abs(line[:, k] - s.evaluate(face, 0.5, v)).max() <= 4e-14  # a grid, and not


def test_kernels_beside_polygons_with_very_many_corners():
    """Of whose points some have too many weights: their rows are by NumPy, positions are not."""
    turn = 2 * np.pi * np.arange(300) / 300
    ring = np.column_stack([np.cos(turn), np.sin(turn), np.cos(3 * turn) / 8])
    i, j = np.arange(300), np.roll(np.arange(300), -1)
    around = [np.stack([i + a, j + a, j + a + 300, i + a + 300], 1)[:, ::-1] for a in (0, 300, 600)]
    points = np.concatenate([ring * r for r in (1, 1.1, 1.2, 1.3)])
    mesh = ls.Mesh(points, [i, *np.concatenate(around)], scheme="doo-sabin")
    kernels, numpy = (ls.LimitSurface(mesh, engine=e) for e in ("compiled", "reference"))
    rng, n = np.random.default_rng(0), 500
    query = rng.integers(0, len(kernels.limit_faces), n), rng.random(n), rng.random(n)
    assert np.abs(kernels.evaluate(*query) - numpy.evaluate(*query)).max() <= 1e-14
    assert np.abs(kernels.normal(*query) - numpy.normal(*query)).max() <= 1e-11
    assert abs(kernels.weights(*query) - numpy.weights(*query)).max() <= 1e-14


def prism(n):
    """A band of n quads between two n-gons, moved a little."""
    turn = 2 * np.pi * np.arange(n) / n
    ring = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    i, j = np.arange(n), np.roll(np.arange(n), -1)
    points = np.concatenate([ring, ring + np.eye(3)[2]])
    points += np.random.default_rng(n).integers(-8, 9, points.shape) / 64
    return points, [i[::-1], i + n, *np.stack([i, j, j + n, i + n], axis=1)]


@pytest.mark.parametrize("n", [7, 8, 21])
def test_a_wide_polygon_is_told_by_few_points(n):
    """As by all of its corners: by a scheme of the same masks, of which nothing else is known."""
    plain = replace(DOO_SABIN, name="plain", corner=DOO_SABIN.mask)
    few, all_ = (ls.LimitSurface(ls.Mesh(*prism(n)), scheme=x) for x in (DOO_SABIN, plain))
    assert {x.size for x in few.patches.sectors if x} == {3 + 5, 6 + 5}
    assert {x.size for x in all_.patches.sectors if x} == {3 + 5, n + 5}
    rng, q = np.random.default_rng(0), 300
    face, (u, v) = rng.integers(0, len(few.limit_faces), q), 1 - rng.random((2, q)) ** 4
    for nu in [(0, 0), *ORDERS]:
        a, b = (s.evaluate(face, u, v, nu=nu) for s in (few, all_))
        assert np.abs(a - b).max() <= 1e-12 * max(1, np.abs(b).max())
    assert np.abs(few.normal(face, u, v) - all_.normal(face, u, v)).max() <= 1e-12
    assert np.abs(few.normal(face, 1, 1) - all_.normal(face, 1, 1)).max() <= 1e-12
    assert abs(few.weights(face, u, v) - all_.weights(face, u, v)).max() <= 1e-14


@pytest.mark.parametrize("pole", [False, True])
def test_very_wide_polygons_cost_no_more_than_many(pole):
    n = 2000
    points, faces = prism(n)
    if pole:  # pairs of edges of the first, and a point in its middle
        i = np.arange(0, n, 2)
        middle = np.full(len(i), 2 * n)
        faces[:1] = np.stack([(i + 2) % n, i + 1, i, middle], axis=1)
        points = np.concatenate([points, [[0, 0, -0.5]]])
    s = ls.LimitSurface(ls.Mesh(points, faces), scheme="doo-sabin", engine="reference")
    kept = [*(x.size for x in s.patches.controls), *(x.nnz for x in s.patches.extras)]
    assert sum(kept) <= 300 * n  # as squares they were more than n * n
    cap = s.limit_faces.first[-n - 1]  # the other one
    assert (
        np.abs(s.evaluate(cap + np.arange(3), 1, 1) - points[n : 2 * n].mean(axis=0)).max() < 1e-14
    )
    assert np.isfinite(s.normal([0, cap], [0, 0.9], [0, 0.8])).all()


@pytest.mark.parametrize("name", ["prism_7", "grid"])
def test_kernels_give_tangents_and_curvature(name, monkeypatch):
    from limitsurf.engine.reference import Reference

    mesh = grid(6, scheme="doo-sabin") if name == "grid" else of_zoo(name)
    kernels, numpy = (ls.LimitSurface(mesh, engine=e) for e in ("compiled", "reference"))
    rng, n = np.random.default_rng(0), 400
    query = rng.integers(0, len(kernels.limit_faces), n), *rng.random((2, n))
    true = numpy.curvature(*query), *numpy.tangents(*query)
    left = []
    for what in ("curvatures", "tangents"):
        own = getattr(Reference, what)

        def counted(self, request, *more, own=own):
            left.append(request.face.size)
            return own(self, request, *more)

        monkeypatch.setattr(Reference, what, counted)
    found = kernels.curvature(*query), *kernels.tangents(*query)
    assert sum(left) <= n / 20
    for name_ in ("k1", "k2", "mean", "gaussian"):
        x, y = (getattr(of[0], name_) for of in (found, true))
        assert np.array_equal(np.isnan(x), np.isnan(y))
        assert np.nanmax(np.abs(x - y) / (1 + np.abs(y))) <= 1e-9
    assert all(np.nanmax(np.abs(x - y)) <= 1e-12 for x, y in zip(found[1:], true[1:], strict=True))


@pytest.mark.parametrize("n", [3, 4, 5, 9])
def test_eigenfunctions_scale(n):
    """All that there are on the sectors of a polygon; a map by two, with axes that are regular."""
    fan, rng = fan_of("doo-sabin", "interior", n), np.random.default_rng(0)
    face, (u, v) = np.arange(n)[:, None], rng.random((2, 20))
    plane = fan.limit(fan.characteristic_map())
    whole = plane.evaluate(face, u, v)
    assert np.abs(plane.evaluate(face, u / 2, v / 2) - whole / 2).max() <= 1e-15
    x, y = plane.evaluate(np.arange(n), 1, 0).T
    turn = 2 * np.pi * np.arange(n) / n
    assert np.abs(np.array([x, y]) - np.hypot(x, y) * [np.cos(turn), np.sin(turn)]).max() <= 4e-15
    if n > 4:
        with pytest.raises(ValueError, match=r"no basis of eigenvectors .*: 2 of"):
            fan.modes()
        return
    modes = fan.modes()
    assert np.linalg.matrix_rank([m.values for m in modes]) == len(modes) == 4 * n
    for mode in modes:
        f = fan.limit(mode.values)
        gap = f.evaluate(face, u / 2, v / 2) - mode.eigenvalue * f.evaluate(face, u, v)
        assert np.abs(gap).max() <= 1e-14


def test_kernels_survive_a_pickle():
    s = ls.LimitSurface(grid(4), scheme="doo-sabin", engine="compiled")
    before = s.evaluate(3, 0.3, 0.7)
    assert np.array_equal(pickle.loads(pickle.dumps(s)).evaluate(3, 0.3, 0.7), before)


def test_curvature_grows_like_a_logarithm():
    mesh = of_zoo("bipyramid_9")
    s = ls.LimitSurface(mesh)
    at_pole = np.flatnonzero(mesh.vertex_faces[mesh.indices] == 9)[0]  # a limit face to each corner
    u = 0.5 ** np.array([20, 40, 80, 160])
    steps = np.diff(s.curvature(at_pole, u / 3, u).mean) / np.array([20, 40, 80])
    assert abs(steps[0]) > 1e-3
    np.testing.assert_allclose(steps, steps[0], rtol=1e-3)


def test_holes_and_boundaries_without_limit():
    mesh = of_zoo("grid_3x3", holes=[4], boundary="none")
    s = ls.LimitSurface(mesh)
    assert np.isnan(s.evaluate(4, 0.5, 0.5)).all()
    # the quarter at an inner vertex has a limit
    u, v = np.meshgrid([0.25, 0.75], [0.25, 0.75])
    there = ~np.isnan(s.evaluate(0, u, v)[..., 0])
    assert there.sum() == 1
    assert len(ls.tessellate(s, 2).sizes) == 0
    W = s.weights(0, u.ravel(), v.ravel())
    assert np.isnan(W.sum(axis=1)).sum() == 3


@pytest.mark.parametrize(
    ("tags", "complaint"),
    [
        ({"creases": {(0, 1): 2.5}}, r"no rule for creases: edge \(0, 1\) has sharpness 2\.5"),
        ({"corners": {3: 10}}, r"no rule for corners: vertex 3 has sharpness 10"),
        ({"creasing": "chaikin"}, r"has no creases: leave out creasing='chaikin'"),
        ({"triangles": "smooth"}, r'has no triangle rule "smooth"'),
    ],
)
def test_what_has_no_rule_is_refused(tags, complaint):
    mesh = of_zoo("cube", **tags)
    for use in (ls.LimitSurface, ls.refined):
        with pytest.raises(ValueError, match=f"scheme 'doo-sabin' {complaint}|{complaint}"):
            use(mesh)


def test_sharpness_of_zero_is_none():
    ls.LimitSurface(of_zoo("cube", creases={(0, 1): 0}))


def test_digons_have_a_position_and_no_normal():
    mesh = of_zoo("pillow_of_quads")
    s = ls.LimitSurface(mesh)
    two = np.flatnonzero(mesh.vertex_faces == 2)
    assert len(two)
    h = np.flatnonzero(np.isin(mesh.indices, two))[0]
    face, place = int(mesh.corner_face[h]), int(h - mesh.offsets[mesh.corner_face[h]])
    assert np.isfinite(s.evaluate(face, *SQUARE[place])).all()
    assert np.isnan(s.normal(face, *SQUARE[place])).all()
    with pytest.raises(ls.MeshError, match="amid two faces"):
        ls.refined(mesh)


def test_irrational_masks_name_their_place():
    for name, what in (("prism_7", "face 0 has 7 corners"), ("half_disk_5", "boundary and has 5")):
        mesh = of_zoo(name)
        exact = mesh.with_points(np.vectorize(F, otypes=[object])(mesh.points))
        for use in (lambda m: ls.LimitSurface(m).evaluate(0, 0.5, 0.5), ls.refined):
            with pytest.raises(TypeError, match=what):
                use(exact)


def test_channels_with_seams():
    """As a surface of their own, whose boundaries are boundaries and seams."""
    mesh = of_zoo("cube")
    values = np.random.default_rng(0).random((24, 2))
    square = np.arange(24)
    for mode, boundary in (("none", "edge_only"), ("corners_only", "edge_and_corner")):
        with_uv = ls.Mesh(mesh.points, mesh.faces, channels={"uv": (values, square, mode)})
        s = ls.LimitSurface(with_uv, scheme="doo-sabin")
        apart = ls.Mesh(values, square.reshape(6, 4), boundary=boundary)
        own = ls.LimitSurface(apart, scheme="doo-sabin")
        query = np.arange(6), 0.3, 0.8
        assert np.array_equal(s.evaluate(*query, channel="uv"), own.evaluate(*query))
        W = s.weights(*query, channel="uv")
        np.testing.assert_allclose(W @ values, own.evaluate(*query), rtol=0, atol=1e-15)
        with pytest.warns(UserWarning, match="channels are left out"):
            assert not ls.refined(with_uv, scheme="doo-sabin").channels
    with_uv = ls.Mesh(mesh.points, mesh.faces, channels={"uv": (values, square, "boundaries")})
    with pytest.raises(ValueError, match="no rule for channel 'uv', which is interpolated as"):
        ls.LimitSurface(with_uv, scheme="doo-sabin").evaluate(0, 0.5, 0.5, channel="uv")


def test_a_dual_scheme_is_checked():
    from limitsurf.scheme.dual import DualScheme

    with pytest.raises(ValueError, match=r"corner\(4\) is .* but the biquadratic B-spline needs"):
        DualScheme(name="wrong", corner=lambda n: (F(1, n),) * n, paper="none")
    skew = DualScheme(
        name="skew", paper="none",
        corner=lambda n: DOO_SABIN.corner(4) if n == 4 else (F(1, 2), F(1, 2), F(0)),
    )  # fmt: skip
    with pytest.raises(ValueError, match=r"corner\(3\) is not symmetric"):
        skew.mask(3)
    short = DualScheme(
        name="short", paper="none",
        corner=lambda n: DOO_SABIN.corner(4) if n == 4 else (F(1, 2),) * (n - 1),
    )  # fmt: skip
    with pytest.raises(ValueError, match=r"corner\(3\) must be 3 exact numbers of sum 1"):
        short.mask(3)


@pytest.mark.parametrize("wicked", ["extraordinary", "boundary"])
def test_a_wicked_mask_is_seen(wicked, monkeypatch, request):
    """By comparison with the oracle: at n = 3 alone, or beyond boundaries alone."""
    name = "cube" if wicked == "extraordinary" else "grid_3x3"
    points, faces = zoo.ZOO[name]()
    mesh = ls.Mesh(points, faces)
    oracle = oracles_doo_sabin.DooSabinSurface(
        Cage([tuple(map(F, map(float, p))) for p in np.asarray(points).tolist()], faces)
    )
    true = np.array(oracle.evaluate(0, 0.125, 0.25), dtype=float)

    def gap():
        s = ls.LimitSurface(mesh, scheme="doo-sabin")
        fine = ls.refined(mesh, scheme="doo-sabin").points
        needed = oracles_doo_sabin.refine(oracle.cage).points
        refined_gap = np.abs(fine - np.array(needed, dtype=float)).max()
        return np.abs(s.evaluate(0, 0.125, 0.25) - true).max(), refined_gap

    assert max(gap()) <= 1e-14
    kind = type(DOO_SABIN)
    mask, rim = kind.mask, kind.rim

    def forget():
        for known in (dual._mask, dual._mirrors):
            known.cache_clear()

    forget()
    request.addfinalizer(forget)

    def wrong_mask(self, n):
        weights = list(mask(self, n))
        if n == 3:
            weights = [weights[0] - F(2, 100), *(w + F(1, 100) for w in weights[1:])]
        return tuple(weights)

    if wicked == "extraordinary":
        monkeypatch.setattr(kind, "mask", wrong_mask)
        assert gap()[0] > 1e-4
    else:
        monkeypatch.setattr(kind, "rim", lambda self, k: tuple(r * F(9, 10) for r in rim(self, k)))
        assert min(gap()) > 1e-4


def test_polygons_of_many_corners_are_refined_by_sums():
    """As by the operator, whose rows of an n-gon have n entries, and as they turn."""
    n = 100
    angle = 2 * np.pi * np.arange(n) / n
    inner = np.stack([np.cos(angle), np.sin(angle), np.cos(3 * angle)], axis=1)
    points = np.concatenate([inner, 2 * inner])
    j = np.arange(n)
    quads = np.stack([j, n + j, n + (j + 1) % n, (j + 1) % n], axis=1)
    mesh = ls.Mesh(points, (np.append(n, np.full(n, 4)), np.append(j, quads.ravel())))
    for boundary in ("none", "edge_only", "edge_and_corner"):
        given = {"scheme": "doo-sabin", "boundary": boundary}
        fine, R = ls.refined(mesh, 2, operator=True, **given)
        found = ls.refined(mesh, 2, **given).points
        assert np.abs(found - fine.points).max() < 4e-15
        assert np.abs(R @ mesh.points - found).max() < 4e-15
    # waves by own + once = 1/2, once around, and by own = 1/4
    first = ls.refined(mesh.with_points(points - [0, 0, 1e3]), 1, scheme="doo-sabin").points[:n]
    assert np.abs(first[:, :2] - inner[:, :2] / 2).max() < 1e-15
    assert np.abs(first[:, 2] - (inner[:, 2] / 4 - 1e3)).max() < 1e-12


def test_cost_of_refined_points_is_linear():
    sizes = []
    for n in (4000, 8000):
        points = np.random.default_rng(n).random((n, 3))
        mesh = ls.Mesh(points, (np.array([n]), np.arange(n)))
        tracemalloc.start()
        ls.refined(mesh, 2, scheme="doo-sabin")
        sizes.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert sizes[1] < 2.2 * sizes[0]
    assert sizes[1] < 4000 * 8000
