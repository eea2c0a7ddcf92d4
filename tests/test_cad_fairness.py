"""Fairness energies: against splines in closed form, sums over rings, refinement; fair cages."""

import math

import numpy as np
import pytest
import zoo
from scipy.sparse import csr_array, kron

import limitsurf as ls
from limitsurf.cad.fairness import ENERGIES
from limitsurf.spectra.fan import Fan


def torus(m, n, triangles=False, **tags):
    i, j = (x.ravel() for x in np.meshgrid(np.arange(m), np.arange(n), indexing="ij"))
    a, b, c, d = i * n + j, (i + 1) % m * n + j, (i + 1) % m * n + (j + 1) % n, i * n + (j + 1) % n
    faces = np.stack([a, b, c, d], axis=1)
    if triangles:
        faces = np.concatenate([np.stack(x, axis=1) for x in ((a, b, d), (b, c, d))])
    x, y = 2 * np.pi * i / m, 2 * np.pi * j / n
    points = [(3 + np.cos(y)) * np.cos(x), (3 + np.cos(y)) * np.sin(x), np.sin(y)]
    return ls.Mesh(np.stack(points, axis=1), faces, **tags)


def circulant(row, n):
    """Symmetric, of a row from its diagonal on."""
    found = np.zeros((n, n))
    for k, value in enumerate(row):
        for sign in (-1, 1)[: 1 + (k > 0)]:
            found[np.arange(n), (np.arange(n) + sign * k) % n] += value
    return csr_array(found)


# of uniform cubic B-splines: products of values, and of first, second and third derivatives
CUBIC = (
    np.array([2416, 1191, 120, 1]) / 5040,
    np.array([2 / 3, -1 / 8, -1 / 5, -1 / 120]),
    np.array([8 / 3, -3 / 2, 0, 1 / 6]),
    np.array([20, -15, 6, -1.0]),
)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_energies_of_splines_in_closed_form(order):
    m, n = 8, 9
    expected = sum(
        math.comb(order, k) * kron(circulant(CUBIC[k], m), circulant(CUBIC[order - k], n))
        for k in range(order + 1)
    )
    found = ls.fairness(ls.LimitSurface(torus(m, n)), ENERGIES[order - 1])
    assert abs(found - expected).max() < 1e-13 * abs(expected).max()


def test_triangles_are_equilateral():
    surface = ls.LimitSurface(torus(7, 8, triangles=True), scheme="loop")
    space = ls.Space(surface)
    # f_u^2 g11 + 2 f_u f_v g12 + f_v^2 g22
    root = math.sqrt(3)
    u, v = (1, 0), (0, 1)
    terms = [(u, u, 2 / root), (u, v, -1 / root), (v, u, -1 / root), (v, v, 2 / root)]
    expected = space.assemble(terms)
    assert abs(ls.fairness(surface, "membrane") - expected).max() < 1e-13
    # the Laplacian's square has the integral of all second derivatives' without a boundary
    second = [((2, 0), 2 / root), ((1, 1), -2 / root), ((0, 2), 2 / root)]
    expected = space.assemble([(a, b, c * d) for a, c in second for b, d in second])
    assert abs(ls.fairness(surface, "thin_plate") - expected).max() < 1e-12


def by_quadrature(fan, f, energy):
    """Sums over the points of rings, of derivatives by the characteristic map."""
    surface = fan.surface(f)
    q = ls.quadrature(surface, points=12, integrand="curvature")
    order = [(1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]
    jet = surface.jet(q.face, q.u, q.v, order=2)
    chi = fan.surface(fan.characteristic_map()).jet(q.face, q.u, q.v, order=2)
    (xu, yu), (xv, yv), (xuu, yuu), (xuv, yuv), (xvv, yvv) = (chi[nu].T for nu in order)
    fu, fv, fuu, fuv, fvv = (jet[nu].ravel() for nu in order)
    area = xu * yv - xv * yu
    fx, fy = (fu * yv - fv * yu) / area, (fv * xu - fu * xv) / area
    faces = fan.faces * (1 if fan.lattice.face_size == 4 else 0.5)
    scale = faces / (q.weights @ np.abs(area))
    if energy == "membrane":
        return q.weights @ (np.abs(area) * (fx**2 + fy**2))
    rows = [(xu * xu, 2 * xu * yu, yu * yu), (xu * xv, xu * yv + xv * yu, yu * yv)]
    rows.append((xv * xv, 2 * xv * yv, yv * yv))
    given = [
        fuu - xuu * fx - yuu * fy, fuv - xuv * fx - yuv * fy, fvv - xvv * fx - yvv * fy
    ]  # fmt: skip
    system = np.moveaxis(np.array(rows), 2, 0)
    xx, xy, yy = np.linalg.solve(system, np.stack(given, axis=1)[..., None])[..., 0].T
    return q.weights @ (np.abs(area) * (xx**2 + 2 * xy**2 + yy**2)) / scale


@pytest.mark.parametrize("energy", ENERGIES[:2])
@pytest.mark.parametrize(
    ("scheme", "valence"), [("catmull-clark", 3), ("catmull-clark", 5), ("loop", 5), ("loop", 8)]
)
def test_energies_at_poles(scheme, valence, energy):
    fan = Fan(scheme, "interior", valence)
    f = np.random.default_rng(valence).normal(size=fan.size)
    E = ls.fairness(fan.surface(f), energy)
    assert f @ E @ f == pytest.approx(by_quadrature(fan, f, energy), rel=1e-9)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_energies_at_semi_sharp_creases_are_those_of_the_refined_cage(order):
    ring = [(j, (j + 1) % 7) for j in range(7)]
    mesh = torus(6, 7, creases=(ring, [1.5] * 7))
    fine, R = ls.refined(mesh, 1, operator=True)
    E, F = (ls.fairness(ls.LimitSurface(x), ENERGIES[order - 1]) for x in (mesh, fine))
    # of refined faces parameters are twice as large
    assert abs(E - 4 ** (order - 1) * (R.T @ F @ R)).max() < 1e-12 * abs(E).max()


def cages(scheme):
    """Cages with poles, creases, corners, boundaries and holes, and n-gons where they may be."""
    if ls.schemes[scheme].lattice.face_size == 3:
        octahedron = ls.Mesh(*zoo.octahedron())
        edges = octahedron.edges[:3]
        yield octahedron.with_tags(creases=(edges, [0.7, 2, np.inf]))
        yield ls.selected(octahedron, np.arange(octahedron.n_faces) > 1)
        return
    prism = ls.Mesh(*zoo.prism(5))
    yield prism
    tags = {"creases": (prism.edges[:4], [0.7, 2.5, np.inf, 1])}
    if scheme not in ("doo-sabin", "bilinear"):
        yield prism.with_tags(**tags, corners={7: 1.5})
    yield ls.selected(prism, np.arange(prism.n_faces) > 0)
    yield prism.with_tags(holes=[3])


@pytest.mark.parametrize("energy", ENERGIES)
@pytest.mark.parametrize("scheme", ls.schemes.with_pieces)
def test_what_all_energies_have(scheme, energy):
    for mesh in cages(scheme):
        surface = ls.LimitSurface(mesh, scheme=scheme)
        local = ls.schemes[scheme].local
        if (local and energy != "membrane") or (scheme == "doo-sabin" and energy == "variation"):
            with pytest.raises(ValueError, match=f"{scheme}.*it has: membrane"):
                ls.fairness(surface, energy)
            continue
        E = ls.fairness(surface, energy)
        assert E.shape == (mesh.n_vertices, mesh.n_vertices)
        assert abs(E - E.T).max() == 0
        size = abs(E).max()
        assert abs(E.sum(axis=1)).max() < 1e-14 * size
        assert np.linalg.eigvalsh(E.toarray())[0] > -1e-12 * size
        assert E.nnz == 0 or size > 0.1


def test_energies_do_not_depend_on_points_or_corners():
    mesh = ls.Mesh(*zoo.prism(5))
    faces = [np.roll(face, k) for k, face in enumerate(mesh.faces)]
    other = ls.Mesh(np.random.default_rng(0).normal(size=(10, 2)), faces)
    for energy in ENERGIES:
        one, two = (ls.fairness(ls.LimitSurface(x), energy) for x in (mesh, other))
        assert abs(one - two).max() < 1e-12 * abs(one).max()


def test_channels_and_threads():
    rng = np.random.default_rng(0)
    mesh = torus(5, 6)
    cut = np.arange(120)  # a value at each corner: all edges are seams
    channels = {
        "cut": (rng.random((120, 2)), cut, "all"),
        "whole": (rng.random((31, 2)), mesh.indices + 1, "boundaries"),
        "apart": (rng.random((120, 2)), cut, "corners_only"),
    }
    surface = ls.LimitSurface(mesh.with_tags(channels=channels))
    E = ls.fairness(surface, "membrane")
    whole = ls.fairness(surface, "membrane", channel="whole")
    assert abs(whole[1:][:, 1:] - E).max() < 1e-15
    assert whole[:1].nnz == 0
    single = ls.Mesh(rng.random((4, 1)), [[0, 1, 2, 3]], boundary="edge_only")
    one = ls.fairness(ls.LimitSurface(single), "membrane").toarray()
    apart = ls.fairness(surface, "membrane", channel="apart").toarray()
    corners = cut.reshape(-1, 4)
    for face in corners[:3]:
        block = apart[np.ix_(face, face)]
        rest = np.setdiff1d(cut, face)
        assert np.abs(block @ np.ones(4)).max() < 1e-14
        assert not apart[np.ix_(face, rest)].any()
        assert block.shape == one.shape
    assert ls.fairness(surface, "membrane", channel="cut").shape == (120, 120)
    big = ls.LimitSurface(torus(130, 130))
    one, two = (ls.fairness(big, workers=n) for n in (1, 2))
    assert (one != two).nnz == 0
    with pytest.raises(ValueError, match="workers"):
        ls.fairness(big, workers=0)
    with pytest.raises(ValueError, match="st"):
        ls.fairness(big, channel="st")


def test_wide_rings():
    n = 70
    angle = 2 * np.pi * np.arange(n) / n
    rim = [np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1) for r in (1, 2)]
    i, j = np.arange(n), (np.arange(n) + 1) % n
    faces = [[0, 1 + a, 1 + b] for a, b in zip(i, j, strict=True)]
    faces += [[1 + a, 1 + n + a, 1 + n + b, 1 + b] for a, b in zip(i, j, strict=True)]
    mesh = ls.Mesh(np.concatenate([[[0, 0]], *rim]), faces)
    E = ls.fairness(ls.LimitSurface(mesh), "membrane")
    sizes = np.linalg.eigvalsh(E.toarray())
    assert abs(sizes[0]) < 1e-13 * sizes[-1] < sizes[1]
    # turns change nothing
    turned = np.concatenate([[0], 1 + j, 1 + n + j])
    assert abs(E[turned][:, turned] - E).max() < 1e-13 * sizes[-1]


def test_holes_alone_have_no_energy():
    mesh = ls.Mesh(*zoo.cube(), holes=range(6))
    assert ls.fairness(ls.LimitSurface(mesh)).nnz == 0
    assert (ls.fair(mesh, fixed=[0]).points == mesh.points).all()
    with pytest.raises(ValueError, match="there is no point to pass through"):
        ls.interpolate(mesh)


def test_bad_input():
    mesh = ls.Mesh(*zoo.prism(5))
    surface = ls.LimitSurface(mesh)
    with pytest.raises(TypeError, match="needs a LimitSurface, got Mesh"):
        ls.fairness(mesh)
    with pytest.raises(ValueError, match="energy must be one of membrane"):
        ls.fairness(surface, "plate")
    exact = ls.Mesh(mesh.points.astype(object), mesh.faces)
    for f in (lambda x: ls.fairness(ls.LimitSurface(x)), ls.fair):
        with pytest.raises(TypeError, match="exact"):
            f(exact)


# ------------------------------------------------------------------ fair cages


def test_fair_cages_have_the_least_energy():
    mesh = torus(6, 5)
    rng = np.random.default_rng(1)
    held = rng.random(30) < 0.3
    found = ls.fair(mesh, fixed=held)
    E = ls.fairness(ls.LimitSurface(mesh)).toarray()
    free, points = ~held, mesh.points.copy()
    points[free] = -np.linalg.solve(E[np.ix_(free, free)], E[np.ix_(free, held)] @ points[held])
    assert (found.points[held] == mesh.points[held]).all()
    assert np.abs(found.points - points).max() < 1e-8
    # with weights
    weights = rng.random(30)
    found = ls.fair(mesh, weights=weights, energy="membrane")
    E = ls.fairness(ls.LimitSurface(mesh), "membrane").toarray()
    points = np.linalg.solve(E + np.diag(weights), weights[:, None] * mesh.points)
    assert np.abs(found.points - points).max() < 1e-8
    held = np.where(np.arange(30) < 3, np.inf, 1.0)
    assert (ls.fair(mesh, weights=held).points[:3] == mesh.points[:3]).all()


def test_fair_keeps_boundaries_and_creases():
    n = 5
    points = np.random.default_rng(2).random((n * n, 3))
    i, j = (x.ravel() for x in np.meshgrid(np.arange(n - 1), np.arange(n - 1)))
    faces = np.stack([i * n + j, i * n + n + j, i * n + n + j + 1, i * n + j + 1], axis=1)
    mesh = ls.Mesh(points, faces, creases={(6, 7): 2.0}, corners={12: 3.0})
    rim = np.unique(mesh.edges[mesh.boundary_edge])
    found = ls.fair(mesh).points
    moved = np.flatnonzero((found != points).any(axis=1))
    assert np.setdiff1d(np.arange(n * n), [*rim, 6, 7, 12]).tolist() == moved.tolist()
    found = ls.fair(mesh, creases=False).points
    assert (found[[6, 7, 12]] != points[[6, 7, 12]]).all()
    found = ls.fair(mesh, boundaries=False, creases=False, fixed=[0, 24, 4]).points
    assert (found[rim[1:3]] != points[rim[1:3]]).any()


def test_bad_input_to_fair():
    mesh = torus(4, 5)
    with pytest.raises(ValueError, match="nothing is fixed in the part of the cage of vertex 0"):
        ls.fair(mesh)
    faces = np.concatenate([mesh.uniform, 20 + mesh.uniform])
    both = ls.Mesh(np.tile(mesh.points, (2, 1)), faces)
    with pytest.raises(ValueError, match=r"vertex 20 \(1 parts of 2\)"):
        ls.fair(both, fixed=[3])
    with pytest.raises(IndexError, match="vertex 20"):
        ls.fair(mesh, fixed=[20])
    with pytest.raises(ValueError, match="fixed must be numbers"):
        ls.fair(mesh, fixed=[True])
    for weights in (-1, np.nan, [1, 2]):
        with pytest.raises(ValueError, match="weights must"):
            ls.fair(mesh, weights=weights)
    with pytest.raises(TypeError, match="needs a Mesh or LimitSurface"):
        ls.fair(mesh.points)
