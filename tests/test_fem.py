"""Spaces, forms and eigenmodes: against closed forms, theory, and sums written out by hand."""

import warnings

import numpy as np
import pytest
import zoo
from command_line import facts, fail, succeed
from scipy.linalg import eigh
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import spsolve

import limitsurf as ls
from limitsurf import numbers
from limitsurf.fem.modes import _count

SQUARE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]]
SUBDIVISION = [name for name in ls.schemes.with_pieces if name not in ("bilinear", "linear")]


def square(**options):
    return ls.LimitSurface(ls.Mesh(*SQUARE, **options))


def closed(scheme):
    """A closed surface without symmetry, by any scheme, with poles and polygons."""
    triangles = ls.schemes[scheme].lattice.face_size == 3
    points, faces = zoo.bipyramid(5) if triangles else zoo.prism(5)
    rng = np.random.default_rng(1)
    points = np.asarray(points, dtype=float)
    return ls.LimitSurface(ls.Mesh(points + rng.uniform(-0.1, 0.1, points.shape), faces),
                           scheme=scheme)  # fmt: skip


def two_poles(n):
    """Closed, two poles of valence n, between them 2 n vertices of valence 3."""
    turn = np.pi * np.arange(2 * n) / n
    stretch = np.where(np.arange(2 * n) % 2, 1.15, 1.0)
    rings = [
        np.stack([r * np.cos(turn) * stretch, r * np.sin(turn) * stretch, z + 0 * turn], axis=1)
        for r, z in ((1.0, 0.6), (1.1, 0.0), (1.0, -0.6))
    ]
    points = np.concatenate([[[0, 0, 1.0]], *rings, [[0, 0, -1.0]]])

    def at(ring, k):
        return 1 + 2 * n * ring + k % (2 * n)

    faces = [[0, at(0, 2 * k), at(0, 2 * k + 1), at(0, 2 * k + 2)] for k in range(n)]
    faces += [
        [at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)]
        for i in range(2) for k in range(2 * n)
    ]  # fmt: skip
    last = len(points) - 1
    faces += [[last, at(2, 2 * k + 2), at(2, 2 * k + 1), at(2, 2 * k)] for k in range(n)]
    return ls.LimitSurface(ls.Mesh(points, faces))


def torus(m, n):
    """About a torus of radii 2 and 1; all vertices are regular."""
    a, b = (2 * np.pi * x.ravel() for x in np.meshgrid(np.arange(m) / m, np.arange(n) / n,
                                                        indexing="ij"))  # fmt: skip
    points = np.stack([(2 + np.cos(b)) * np.cos(a), (2 + np.cos(b)) * np.sin(a), np.sin(b)], axis=1)
    k = np.arange(m * n).reshape(m, n)
    right, up = np.roll(k, -1, axis=0), np.roll(k, -1, axis=1)
    faces = np.stack([k, right, np.roll(right, -1, axis=1), up], axis=-1).reshape(-1, 4)
    return ls.LimitSurface(ls.Mesh(points, faces))


def u(x):
    return np.sin(1.3 * x[:, 0] + 0.4) * np.cos(0.9 * x[:, 1] - 0.2) + x[:, 2] ** 2 * x[:, 0] / 2


def gradient(x):
    s, c = np.sin(1.3 * x[:, 0] + 0.4), np.cos(0.9 * x[:, 1] - 0.2)
    along = 1.3 * np.cos(1.3 * x[:, 0] + 0.4) * c + x[:, 2] ** 2 / 2
    across = -0.9 * s * np.sin(0.9 * x[:, 1] - 0.2)
    return np.stack([along, across, x[:, 2] * x[:, 0]], axis=1)


def errors(space, coefficients):
    """In L2 and in H1's seminorm, by another rule."""
    q = ls.quadrature(space.surface, points=6, rtol=1e-9)
    basis, at = space.basis(q, 1), space.geometry(q)
    w, x = q.weights * at.area, at.points
    off = basis.weights() @ coefficients - u(x)
    d = np.stack([basis.weights(nu) @ coefficients for nu in ((1, 0), (0, 1))], axis=1)
    found = np.einsum("nab,nb,nak->nk", at.inverse, d, at.tangents)
    true = gradient(x)
    true -= (true * at.normal).sum(axis=1)[:, None] * at.normal
    return np.sqrt([w @ off**2, w @ ((found - true) ** 2).sum(axis=1)])


# ---------------------------------------------------------------------- forms


@pytest.mark.parametrize("scheme", ls.schemes.with_pieces)
def test_matrices_are_sums_over_points(scheme):
    surface = closed(scheme)
    space = ls.Space(surface, levels=1)
    q = ls.quadrature(space.surface, points=3, rtol=1e-6)
    jet = space.surface.jet(q.face, q.u, q.v, order=1)
    tangents = np.stack([jet[1, 0], jet[0, 1]], axis=1)
    metric = tangents @ tangents.swapaxes(1, 2)
    w = q.weights * np.sqrt(np.linalg.det(metric))
    rows, du, dv = space.surface.weights(q.face, q.u, q.v, nu=[(0, 0), (1, 0), (0, 1)])
    mass = (rows.T * w) @ rows
    g = np.linalg.inv(metric)
    d = du, dv
    stiffness = sum((d[a].T * (w * g[:, a, b])) @ d[b] for a in range(2) for b in range(2))
    for known, made in ((mass, space.mass), (stiffness, space.stiffness)):
        found = made(quadrature=q)
        assert abs(found - known).max() <= 1e-13 * abs(known).max()
        assert (found - found.T).nnz == 0 or abs(found - found.T).max() == 0
        assert (made(quadrature=q, workers=3).data == found.data).all()
    assert abs(space.operator @ surface.points - space.surface.points).max() < 1e-14
    basis = space.basis(q, 1)
    for nu, own in (((0, 0), rows), ((1, 0), du), ((0, 1), dv)):
        matrix = basis.weights(nu)
        assert abs(matrix - own).max() <= 1e-13 * max(1, abs(own).max())
        assert matrix.indices is basis.weights((0, 0)).indices
        assert matrix.indptr is basis.weights((0, 0)).indptr
        assert matrix.has_sorted_indices
    points = np.sort(np.concatenate([block.points.ravel() for block in basis.blocks]))
    assert (points == np.arange(len(q))).all()
    for block in basis.blocks:
        assert block.values()[1, 0].shape == (*block.points.shape, block.controls.shape[1])


@pytest.mark.parametrize("scheme", ls.schemes.with_pieces)
def test_constants_have_no_energy_and_the_area_as_mass(scheme):
    surface = closed(scheme)
    space = ls.Space(surface, levels=1)
    one = np.ones(space.n)
    q = ls.quadrature(space.surface, points=6, rtol=1e-9)
    assert np.isclose(one @ space.mass(quadrature=q) @ one, ls.area(surface), rtol=1e-8)
    assert abs(space.stiffness() @ one).max() < 1e-13
    assert np.isclose(space.load(lambda x, _: x[:, 0] * 0 + 1).sum(), space.mass().sum())


@pytest.mark.parametrize("scheme", SUBDIVISION)
def test_bilaplace_is_a_sum_over_points(scheme):
    space = ls.Space(closed(scheme), levels=1)
    q = ls.quadrature(space.surface, points=2, rtol=1e-3)
    at = space.geometry(q)
    orders = [(2, 0), (1, 1), (0, 2), (1, 0), (0, 1)]
    rows = space.surface.weights(q.face, q.u, q.v, nu=orders)
    g, christoffel = at.inverse, at.christoffel
    trace = np.einsum("nab,ncab->nc", g, christoffel)
    of = [g[:, 0, 0], 2 * g[:, 0, 1], g[:, 1, 1], -trace[:, 0], -trace[:, 1]]
    laplacians = sum(one.T * c for one, c in zip(rows, of, strict=True)).T
    known = (laplacians.T * (q.weights * at.area)) @ laplacians
    found = space.bilaplace(quadrature=q)
    assert abs(found - known).max() <= 1e-11 * abs(known).max()
    assert abs(found - found.T).max() == 0
    assert (space.bilaplace(quadrature=q, workers=2).data == found.data).all()


def test_forms_of_ones_own():
    space = ls.Space(two_poles(5))  # split faces and poles among others
    q = ls.quadrature(space.surface, points=2, rtol=1e-3)
    c = np.random.default_rng(2).normal(size=len(q))
    rows, du = space.surface.weights(q.face, q.u, q.v, nu=[(0, 0), (1, 0)])
    one = space.assemble([((1, 0), (0, 0), c)], quadrature=q)
    assert abs(one - (du.T * (q.weights * c)) @ rows).max() < 1e-13
    other = space.assemble([((0, 0), (1, 0), c)], quadrature=q)
    assert abs(one - other.T).max() < 1e-16
    both = space.assemble([((1, 0), (0, 0), c), ((0, 0), (1, 0), c)], quadrature=q)
    assert abs(both - both.T).max() == 0
    assert abs(both - one - other).max() < 1e-14
    at = space.geometry(q)
    again = space.assemble([((0, 0), (0, 0), at.area)], quadrature=q)
    assert abs(again - space.mass(quadrature=q)).max() < 1e-15
    twice = space.assemble([((0, 0), (0, 0), 1.0), ((0, 0), (0, 0), 1)])
    assert np.isclose(twice.sum(), 2 * len(space.surface.limit_faces))


def test_patch_test_around_poles():
    # a plane with five faces at a vertex and natural ends, on which x and y are linear
    points, faces = zoo.flower(5)
    points = np.concatenate([np.asarray(points, dtype=float)[:, :2], np.zeros((len(points), 1))], 1)
    space = ls.Space(ls.LimitSurface(ls.Mesh(points, faces)), levels=2, ends="natural")
    x, y = space.surface.points[:, :2].T
    stiffness, area = space.stiffness(), ls.area(space.surface)
    assert np.isclose(x @ stiffness @ x, area, rtol=1e-12)
    assert abs(x @ stiffness @ y) < 1e-12
    inside = ~space.surface.mesh.boundary_vertex
    for a, b in space.surface.mesh.edges[space.surface.mesh.boundary_edge]:
        inside[[a, b]] = False
    near = abs(space.mass()) @ (~inside).astype(float) > 0  # functions that reach the boundary
    assert (~near).sum() > 5
    assert abs((stiffness @ x)[~near]).max() < 1e-13
    assert abs(space.bilaplace() @ x).max() < 1e-10


def test_geometry_of_a_cylinder():
    # within what a cubic spline has of a circle of 40 points
    turn = 2 * np.pi * np.arange(40) / 40
    rim = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    points = np.concatenate([np.add(rim, [0, 0, k]) for k in range(4)])
    faces = [[40 * k + i, 40 * k + (i + 1) % 40, 40 * k + 40 + (i + 1) % 40, 40 * k + 40 + i]
             for k in range(3) for i in range(40)]  # fmt: skip
    space = ls.Space(ls.LimitSurface(ls.Mesh(points, faces)))
    q = ls.quadrature(space.surface, points=2, face=range(40, 80))
    at = space.geometry(q)
    radial = at.points * [1, 1, 0]
    assert np.allclose(at.normal, radial / np.linalg.norm(radial, axis=1)[:, None], atol=1e-3)
    step = np.linalg.norm(at.tangents[:, 0], axis=1)
    assert np.allclose(at.metric, at.tangents @ at.tangents.swapaxes(1, 2))
    assert np.allclose(at.inverse @ at.metric, np.identity(2), atol=1e-12)
    assert np.allclose(at.second_form[:, 0, 0] / step**2, -1, atol=2e-2)
    assert np.abs(at.second_form[:, 1:]).max() < 1e-12
    assert np.abs(at.christoffel).max() < 1e-3
    assert at.second.shape == (len(q), 2, 2, 3)


# ---------------------------------------------------------------------- orders


def test_orders_without_poles():
    surface = torus(8, 6)
    found = [
        errors(space := ls.Space(surface, levels=n), space.project(lambda x, _: u(x)))
        for n in (1, 2, 3)
    ]
    rates = np.log2(found[-2] / found[-1])
    assert (rates > [3.9, 2.9]).all()
    assert found[-1][0] < 1e-4


@pytest.mark.parametrize(
    ("n", "least", "most"),
    [(3, (3.7, 2.5), (5.0, 4.0)), (5, (2.59, 1.73), (3.6, 2.9)), (8, (2.13, 1.42), (3.2, 2.4))],
)
def test_orders_at_poles(n, least, most):
    # three times and twice log2(1 / l) in the end (derivations/elements.py), from above
    surface = two_poles(n)
    found = [
        errors(space := ls.Space(surface, levels=k), space.project(lambda x, _: u(x)))
        for k in (2, 3)
    ]
    rates = np.log2(found[0] / found[1])
    assert (rates > least).all()
    assert (rates < most).all()


def test_free_ends_on_the_square():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        free, natural = (ls.Space(square(), levels=5, ends=ends) for ends in ("free", "natural"))
    known = {"free": (2.1e-9, 4.1e-7), "natural": (1.5e-5, 2e-3)}
    for space in (free, natural):
        found = errors(space, space.project(lambda x, _: u(x)))
        assert (found < known[space.ends]).all()
        assert (found > np.array(known[space.ends]) / 10).all()
    assert (free.n, natural.n) == (35**2, 33**2)
    assert (errors(free, free.interpolate(lambda x, _: u(x))) < [5e-9, 5e-7]).all()


def test_ends_of_dual_schemes_are_free_once_refined():
    surface = square(scheme="doo-sabin")
    with pytest.warns(UserWarning, match="falls back on natural ends along 1 boundary"):
        assert ls.Space(surface).n == 4
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        spaces = [ls.Space(surface, levels=n) for n in (2, 3)]
    found = [errors(s, s.project(lambda x, _: u(x))) for s in spaces]
    assert (np.log2(found[0] / found[1]) > (2.8, 1.9)).all()
    assert np.isclose(spaces[0].mass().sum(), 1, rtol=1e-13)


TRIANGLE = [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]


def halved(**tags):
    """A parallelogram whose corners have one triangle or two, refined once."""
    mesh = ls.Mesh(SQUARE[0], [[0, 1, 2], [0, 2, 3]], scheme="loop", **tags)
    return ls.refined(mesh, 2).with_tags()


def test_free_ends_on_a_triangle():
    surface = ls.LimitSurface(ls.Mesh(*TRIANGLE, scheme="loop"))
    found, spaces = {}, []
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for ends in ("natural", "free"):
            spaces = [ls.Space(surface, levels=n, ends=ends) for n in (2, 3)]
            found[ends] = [errors(s, s.project(lambda x, _: u(x))) for s in spaces]
    assert spaces[1].n == 45 + 24 + 6  # vertices, sides, two more beyond each corner
    for ends, least, most in (
        ("free", (3.9, 2.9), (4.2, 3.2)),
        ("natural", (2.3, 1.3), (2.7, 1.7)),
    ):
        rates = np.log2(found[ends][0] / found[ends][1])
        assert (least < rates).all()
        assert (rates < most).all()


def test_free_ends_of_triangles_beside_natural_ones():
    surface = ls.LimitSurface(halved())
    with pytest.warns(UserWarning, match="natural ends at 2 boundary vertices"):
        coarse = ls.Space(surface)
    with pytest.warns(UserWarning, match="natural ends at 2 boundary vertices"):
        fine = ls.Space(surface, levels=2)
    assert coarse.n > surface.mesh.n_vertices  # some ghosts are free, not all
    step = fine.prolongation(coarse)
    assert abs(step @ coarse.operator - fine.operator).max() < 1e-14
    assert abs(step @ coarse.points - fine.points).max() < 1e-14
    c = np.random.default_rng(5).normal(size=coarse.n)
    f, g = coarse.function(c), fine.function(step @ c)
    # the same functions of places: at vertices, found by where they are
    places = [s.grading.places(s.refined_surface) for s in (coarse, fine)]
    one, other = (s.surface.evaluate(*p) for s, p in zip((coarse, fine), places, strict=True))
    near = np.argmin(((one[:, None] - other) ** 2).sum(axis=2), axis=1)
    assert abs(one - other[near]).max() < 1e-14
    values, finer = f.evaluate(*places[0]), g.evaluate(*(p[near] for p in places[1]))
    assert np.allclose(values, finer, atol=1e-13)
    # and functions are smooth across sides, where faces of both kinds meet too
    mesh = fine.refined_surface.mesh
    here = np.flatnonzero(mesh.twin >= 0)
    free = fine.grading.free[mesh.corner_face]
    assert (free[here] != free[mesh.twin[here]]).any()
    found = []
    for corners, t in ((here, 0.3), (mesh.twin[here], 0.7)):
        at = fine.surface.limit_faces.along(fine.grading.placed(corners), t)
        x, c = (h.jet(*at, order=1) for h in (fine.surface, g))
        sides = np.stack([x[1, 0], x[0, 1]], axis=1)[:, :, :2]
        found.append(np.linalg.solve(sides, np.stack([c[1, 0], c[0, 1]], axis=1)[:, :, None]))
    assert np.allclose(*found, atol=1e-10)


def test_rings_do_for_mass_at_a_sharp_corner():
    # polynomials in the parameters are integrated as exactly as on finer cages
    surface = ls.LimitSurface(ls.Mesh(*TRIANGLE, scheme="loop"))
    coarse, fine = (ls.Space(surface, levels=n, ends="natural") for n in (1, 4))
    step = fine.prolongation(coarse)
    mass = coarse.mass()
    assert abs(mass - step.T @ fine.mass() @ step).max() < 1e-11 * abs(mass).max()
    assert np.isclose(mass[0, 0], 43 / 1680, rtol=1e-11)


@pytest.mark.parametrize("scheme", ["loop", "loop-warren"])
def test_extended_triangles_have_the_same_limit(scheme):
    mesh = ls.refined(ls.Mesh(*TRIANGLE, scheme=scheme), 2).with_tags()
    points = mesh.points + np.random.default_rng(6).normal(size=mesh.points.shape) / 20
    mesh = mesh.with_points(points)
    wide = ls.extended(mesh)
    assert wide.n_vertices == mesh.n_vertices + 12 + 6
    face, (a, b) = np.arange(16)[:, None], np.random.default_rng(7).uniform(0, 0.5, (2, 8))
    for nu in ((0, 0), (1, 0), (0, 2)):
        one, other = (ls.LimitSurface(m).evaluate(face, a, b, nu=nu) for m in (mesh, wide))
        assert np.allclose(one, other, atol=1e-10)
    fractions = ls.extended(ls.Mesh(np.array(TRIANGLE[0], object), TRIANGLE[1], scheme=scheme))
    assert fractions.points.tolist() == [
        *TRIANGLE[0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [-1, 0, 0], [0, -1, 0], [2, -1, 0],
        [2, 0, 0], [0, 2, 0], [-1, 2, 0],
    ]  # fmt: skip


# ---------------------------------------------------------------------- spaces


@pytest.mark.parametrize("ends", ["free", "natural"])
def test_coarse_functions_are_fine_ones(ends):
    surface = ls.LimitSurface(ls.Mesh(*zoo.grid(3, 2, seed=3)))
    surface = surface.with_points(np.resize(surface.points, (len(surface.points), 3)))
    coarse, fine = ls.Space(surface, levels=1, ends=ends), ls.Space(surface, levels=3, ends=ends)
    prolongation = fine.prolongation(coarse)
    c = np.random.default_rng(4).normal(size=coarse.n)
    assert prolongation.shape == (fine.n, coarse.n)
    assert np.isclose(c @ coarse.mass() @ c, (prolongation @ c) @ fine.mass() @ (prolongation @ c))
    assert abs(prolongation @ coarse.surface.points - fine.surface.points).max() < 1e-13
    assert abs(prolongation @ coarse.operator - fine.operator).max() < 1e-14
    for k in (0, 1, 2, 3):  # corners of the domain, where children come first
        f, g = coarse.function(c), fine.function(prolongation @ c)
        assert np.isclose(f.evaluate(k, 0, 0), g.evaluate(16 * k, 0, 0))
    assert (fine.prolongation(fine) - np.identity(fine.n)).sum() == 0


@pytest.mark.parametrize("boundary", ["edge_and_corner", "edge_only"])
def test_extended_cages_have_the_same_limit(boundary):
    rng = np.random.default_rng(5)
    if boundary == "edge_only":  # a tube, without corners
        points, faces = zoo.cylinder(7, 3)
    else:
        points, faces = zoo.grid(4, 3)
        faces = [list(face) for face in faces]
    mesh = ls.Mesh(rng.normal(size=(len(points), 3)), faces, boundary=boundary)
    wide = ls.extended(mesh)
    before, after = ls.LimitSurface(mesh), ls.LimitSurface(wide)
    face, (s, t) = np.arange(mesh.n_faces)[:, None], rng.uniform(size=(2, 9))
    s[:3], t[2:5] = 0, 1
    for nu in ((0, 0), (1, 0), (1, 1), (0, 2)):
        one, other = (x.evaluate(face, s, t, nu=nu) for x in (before, after))
        assert np.allclose(one, other, rtol=0, atol=1e-12)
    assert (wide.faces.uniform[: mesh.n_faces] == mesh.faces.uniform).all()
    assert len(wide.holes) == wide.n_faces - mesh.n_faces
    exact = ls.extended(mesh.with_points(numbers.RATIONAL.array(mesh.points)))
    assert np.allclose(exact.points.astype(float), wide.points)


def test_ghosts_of_ones_own():
    wide = ls.extended(ls.Mesh(*SQUARE))
    for levels in (0, 2):
        own, made = (
            ls.Space(ls.LimitSurface(wide), levels=levels),
            ls.Space(square(), levels=levels),
        )
        assert own.n == made.n
        assert np.allclose(eigenvalues(own), eigenvalues(made), rtol=0, atol=1e-9)
    # a wider ring is cut down to what has influence
    wider = ls.Space(ls.LimitSurface(ls.refined(wide)), levels=1)
    assert wider.n == made.n
    assert np.allclose(wider.mass().sum(), 1)
    assert wider.operator.shape == (wider.n, 49)


def test_ends_that_become_free():
    triangle = ls.LimitSurface(ls.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    with pytest.warns(UserWarning, match="boundary vertex 0 with 1 face") as caught:
        coarse = ls.Space(triangle)  # whose faces at the boundary are no quads
    assert len(caught) == 1
    assert caught[0].filename == __file__
    fine = ls.Space(triangle, levels=1)
    prolongation = fine.prolongation(coarse)
    assert (coarse.n, fine.n) == (3, 19)
    assert abs(coarse.mass() - prolongation.T @ fine.mass() @ prolongation).max() < 1e-15
    # faces at a boundary without a rule are ghosts
    ghosts = ls.LimitSurface(ls.Mesh(*zoo.grid(3, 3), boundary="none"))
    points = np.zeros((16, 3))
    points[:, 0], points[:, 1] = np.arange(16) % 4, np.arange(16) // 4
    assert np.isclose(ls.Space(ghosts.with_points(points), levels=2).mass().sum(), 1)


def eigenvalues(space):
    return eigh(space.stiffness().toarray(), space.mass().toarray(), eigvals_only=True)[:8]


def test_functions_as_surfaces_and_channels():
    space = ls.Space(square(), levels=2)
    c = space.project(lambda x, _: np.stack([x[:, 0] ** 2, x[:, 1]], axis=1))
    f, named = space.function(c), space.function(c, channel="f")
    at = np.arange(16)[:, None], np.array([0, 0.3, 1]), np.array([0, 0.6, 0.2])
    x = space.surface.evaluate(*at)
    expected = np.stack([x[..., 0] ** 2, x[..., 1]], axis=-1)
    assert np.allclose(f.evaluate(*at), expected, atol=1e-12)
    assert np.allclose(named.evaluate(*at, channel="f"), expected, atol=1e-12)
    assert np.allclose(named.evaluate(*at), x)
    assert ls.tessellate(named, 3, channels=["f"]).channels["f"][0].shape[1:] == (2,)


# ---------------------------------------------------------------------- eigenmodes


def test_eigenvalues_of_the_square():
    found = ls.eigenmodes(space := ls.Space(square(), levels=5), 15)
    known = np.sort([i * i + j * j for i in range(8) for j in range(8)])[:15]
    assert np.allclose(found.eigenvalues / np.pi**2, known, rtol=2e-7, atol=1e-11)
    assert np.allclose(found.modes.T @ space.mass() @ found.modes, np.identity(15), atol=1e-10)
    assert _count(space.stiffness().tocsc(), space.mass().tocsc(), 4.5 * np.pi**2) == 6


def test_eigenvalues_of_a_sphere():
    # l (l + 1), 2 l + 1 times: cubes' copies are threefold, where one Krylov space sees one each
    cube = ls.refined(ls.Mesh(*zoo.cube()).with_points(2 * np.array(zoo.cube()[0], float) - 1), 3)
    on = cube.limit_points / np.linalg.norm(cube.limit_points, axis=1)[:, None]
    rough = ls.LimitSurface(cube)
    face, a, b = cube.parent_face, cube.parent_u, cube.parent_v
    assert face.min() >= 0
    rows = ls.Space(rough)
    points = rows.interpolate(lambda x, _: x / np.linalg.norm(x, axis=1)[:, None])
    space = ls.Space(rough.with_points(points))
    assert space.n == len(on) > 350
    assert a.shape == b.shape
    found = ls.eigenmodes(space, 16).eigenvalues
    known = np.repeat([0, 2, 6, 12], [1, 3, 5, 7])
    assert np.allclose(found, known, rtol=2e-3, atol=1e-10)


def test_eigenvalues_of_a_torus():
    # by Fourier's series along the tube, for each number of waves around
    n = 24
    k = np.arange(-n, n + 1)
    t = 2 * np.pi * np.arange(8 * n) / (8 * n)
    e = np.exp(1j * np.outer(t, k)) / np.sqrt(2 * np.pi)
    r, w = 2 + np.cos(t), t[1]
    known = []
    for m in range(4):
        stiff = (e.conj().T * (k[:, None] * r * w)) @ (e * k) + (e.conj().T * (m * m / r * w)) @ e
        values = eigh(stiff, (e.conj().T * (r * w)) @ e, eigvals_only=True)[:8]
        known += [*values] * (1 + (m > 0))
    known = np.sort(known)[:10]
    rough = torus(24, 16)
    at = ls.Space(rough)

    def onto(x, _):
        ring = x * [1, 1, 0] / np.linalg.norm(x[:, :2], axis=1)[:, None]
        tube = x - 2 * ring
        return 2 * ring + tube / np.linalg.norm(tube, axis=1)[:, None]

    space = ls.Space(rough.with_points(at.interpolate(onto)))
    assert np.allclose(ls.eigenmodes(space, 10).eigenvalues, known, rtol=2e-4, atol=1e-10)


def test_poisson_on_the_square():
    # - u'' = f with the values of u at the boundary, as in the how-to page
    space = ls.Space(square(), levels=3)
    stiffness, load = space.stiffness(), space.load(lambda x, _: 2.19 + 0 * x[:, 0])
    assert np.isclose(load.sum(), 2.19)
    c = space.project(lambda x, _: x[:, 0] ** 2 - x[:, 1] ** 2)  # harmonic
    rows = stiffness @ c
    q = ls.quadrature(space.surface)
    reach = space.basis(q, 0)
    assert reach.blocks[0].values()[0, 0].shape == (64, 16, 16)
    f = lambda x, _: np.stack([2 * x[:, 0], -2 * x[:, 1]], axis=1)  # noqa: E731
    assert np.isclose(c @ rows, (space.load(f)[:, 0] @ space.project(f)[:, 0]) * 2, rtol=1e-9)


# ---------------------------------------------------------------------- bad input


def test_what_is_wrong_is_named():
    surface = square()
    space = ls.Space(surface)
    exact = ls.LimitSurface(ls.Mesh(numbers.RATIONAL.array(np.array(SQUARE[0])), SQUARE[1]))
    with pytest.raises(TypeError, match="float64 points"):
        ls.Space(exact)
    with pytest.raises(ValueError, match="points of shape"):
        ls.Space(surface.with_points(np.zeros((4, 2))))
    with pytest.raises(ValueError, match='"free" or "natural"'):
        ls.Space(surface, ends="clamped")
    with pytest.raises(ValueError, match="levels"):
        ls.Space(surface, levels=-1)
    with pytest.raises(ValueError, match="no limit face has one"):
        ls.Space(square(holes=[0]))
    with pytest.raises(ValueError, match=r"must be of the shape of the points, \(16,\)"):
        space.assemble([((0, 0), (0, 0), np.ones(3))])
    with pytest.raises(ValueError, match="not finite at point 2"):
        space.assemble([((0, 0), (0, 0), np.where(np.arange(16) == 2, np.nan, 1))])
    with pytest.raises(ValueError, match=r"array \(16, ...\) at 16 points"):
        space.load(lambda x, _: 1.0)
    with pytest.raises(ValueError, match="finite numbers"):
        space.load(lambda x, _: x[:, 0] * np.nan)
    with pytest.raises(TypeError, match="real numbers"):
        space.project(lambda x, _: x[:, 0] * 1j)
    with pytest.raises(ValueError, match=r"\(16, ...\), one for each function"):
        space.function(np.zeros(4))
    with pytest.raises(ValueError, match=r"make it by ls\.quadrature"):
        space.mass(quadrature=ls.quadrature(ls.Space(surface, levels=1).surface))
    with pytest.raises(TypeError, match="need a Quadrature"):
        space.basis(surface)
    with pytest.raises(ValueError, match="is not among the derivatives"):
        space.basis(ls.quadrature(space.surface), 1).weights((2, 0))
    with pytest.raises(ValueError, match="is not coarser"):
        space.prolongation(ls.Space(surface, levels=1))
    with pytest.raises(ValueError, match="ends differ"):
        space.prolongation(ls.Space(surface, ends="natural"))
    with pytest.raises(ValueError, match="k must be 1 to 16"):
        ls.eigenmodes(space, 17)
    with pytest.raises(ValueError, match="area element vanishes on limit face 0"):
        ls.Space(surface.with_points(np.array(SQUARE[0]) * [1, 0, 0])).mass()
    with pytest.raises(ValueError, match="bilaplace needs functions"):
        ls.Space(ls.LimitSurface(surface.mesh, scheme="bilinear")).bilaplace()
    with pytest.raises(ValueError, match="use project"):
        ls.Space(closed("doo-sabin")).interpolate(lambda x, _: x)


def test_functions_of_nothing_are_named():
    points, faces = zoo.grid(4, 2)
    points = np.concatenate([np.asarray(points, float)[:, :2], np.zeros((len(points), 1))], axis=1)
    middle = [(a, b) for a, b in ls.Mesh(points, faces).edges.tolist()
              if points[a, 0] == points[b, 0] == 2]  # fmt: skip
    beyond = [k for k, face in enumerate(faces) if points[list(face), 0].mean() > 2]
    mesh = ls.Mesh(points, faces, creases=dict.fromkeys(middle, np.inf), holes=beyond)
    with pytest.raises(ValueError, match="of holes beyond sharp edges; leave these out"):
        ls.Space(ls.LimitSurface(mesh), ends="natural").mass()


def test_dependent_functions_are_named():
    cube = ls.Space(ls.LimitSurface(ls.Mesh(*zoo.cube())))  # +1 and -1 by turns vanish in the limit
    for ask in (lambda: ls.eigenmodes(cube, 2), lambda: cube.project(lambda x, _: x)):
        with pytest.raises(ValueError, match="linearly dependent"):
            ask()


def test_ends_that_cannot_be_free():
    points, faces = zoo.flower(5)
    points = np.concatenate([np.asarray(points, float)[:, :2], np.zeros((len(points), 1))], axis=1)
    mesh = ls.Mesh(points, faces, boundary="edge_only")
    single = np.flatnonzero(mesh.vertex_faces == 1)
    irregular = mesh.boundary_vertex & (mesh.vertex_faces != 2)
    assert irregular.any() or len(single) == 0
    square_ = ls.Mesh(*SQUARE, boundary="edge_only")
    with pytest.raises(ValueError, match=r"boundary vertex 0 with 1 face .* is not regular"):
        ls.extended(square_)
    with pytest.warns(UserWarning, match=r"natural ends at 4 boundary vertices"):
        space = ls.Space(ls.LimitSurface(square_), levels=1)
    assert space.n == 9
    with pytest.raises(ValueError, match=r"vertex 0 with 2 faces .* needs 3 triangles, or 1 at"):
        ls.extended(ls.Mesh(SQUARE[0], [[0, 1, 2], [0, 2, 3]], scheme="loop"))
    with pytest.raises(ValueError, match="ghost faces are those of squares"):
        ls.extended(ls.Mesh(*SQUARE, scheme="doo-sabin"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert ls.Space(ls.LimitSurface(square_, scheme="bilinear"), levels=1).n == 9


def test_modes_on_the_command_line(tmp_path):
    """A square: eigenvalues pi^2 (i^2 + j^2), and fields that are products of cosines."""
    import pyvista

    cage, path = tmp_path / "square.obj", tmp_path / "modes.vtu"
    ls.write(cage, ls.Mesh(*SQUARE))
    found = facts("modes", cage, "-k", 4, "--levels", 3, "-o", path)
    assert np.allclose(found["eigenvalues"], np.pi**2 * np.array([0, 1, 1, 2]), atol=1e-5)
    assert (found["unknowns"], found["faces"]) == (121, 64 * 16)
    dataset = pyvista.read(path)
    x, y, _ = dataset.points.T
    product = 2 * np.cos(np.pi * x) * np.cos(np.pi * y)
    field = dataset.point_data["mode_3"]
    assert np.allclose(field * np.sign(field[0] * product[0]), product, atol=1e-4)
    assert set(dataset.point_data) == {"Normals", *(f"mode_{i}" for i in range(4))}
    natural = facts("modes", cage, "-k", 3, "--levels", 3, "--ends", "natural")
    assert natural["output"] is None
    assert natural["unknowns"] == 81
    assert natural["eigenvalues"][1] > found["eigenvalues"][1]
    table = succeed("modes", cage, "-k", 2, "--levels", 3).splitlines()
    assert table[0].split() == ["mode", "eigenvalue", "frequency"]
    assert table[1].split() == ["0", "0", "0"]
    assert float(table[2].split()[2]) == pytest.approx(np.pi, abs=1e-6)
    assert ".vtu" in fail("modes", cage, "-o", tmp_path / "modes.obj")
    assert "number of unknowns" in fail("modes", cage, "-k", 99, "--levels", 1)


def test_large_systems_are_solved():
    space = ls.Space(torus(12, 8), levels=1)
    right = space.load(lambda x, _: x[:, 0])
    c = spsolve((space.stiffness() + space.mass()).tocsc(), right)
    assert np.isclose(c @ space.mass() @ np.ones(space.n), 0, atol=1e-10)


def test_other_solvers():
    # as the how-to page has them
    pyamg, skfem = pytest.importorskip("pyamg"), pytest.importorskip("skfem")
    space = ls.Space(two_poles(5), levels=1)
    K, M = space.stiffness(), space.mass()
    load = space.load(lambda x, _: x[:, 0])
    known = spsolve((K + M).tocsc(), load)
    multigrid = pyamg.smoothed_aggregation_solver(csr_matrix(K + M), B=np.ones((space.n, 1)))
    assert np.allclose(multigrid.solve(load, tol=1e-10), known, atol=1e-7 * abs(known).max())
    load -= load.sum() * M.sum(axis=0) / M.sum()
    u = skfem.solve(*skfem.condense(csr_matrix(K), load, D=np.array([0])))
    assert u[0] == 0
    assert abs(K @ u - load).max() < 1e-12


@pytest.mark.parametrize("unit", [1e-150, 1e100])
def test_units_of_forms(unit):
    # areas are as s^2, gradients as 1 / s, Laplacians as 1 / s^2
    own = torus(5, 4)
    one, other = (ls.Space(own.with_points(own.points * s)) for s in (1.0, unit))
    q = ls.quadrature(one.surface, points=2, rtol=1e-2)  # weights do not depend on points
    for name, power in (("mass", 2), ("stiffness", 0), ("bilaplace", -2)):
        a, b = (getattr(space, name)(quadrature=q) for space in (one, other))
        assert abs(b * unit ** (-power) - a).max() < 1e-9 * abs(a).max()
    g, h = one.geometry(q), other.geometry(q)
    assert np.allclose(h.area / unit / unit, g.area)
    assert np.allclose(h.inverse * unit * unit, g.inverse)
    assert np.allclose(*(space.interpolate(lambda x, n: n[:, 0]) for space in (one, other)))


def test_interpolation_where_functions_depend_on_each_other():
    cube = ls.Space(ls.LimitSurface(ls.Mesh(*zoo.cube())))
    with pytest.raises(ValueError, match="linearly dependent"):
        cube.interpolate(lambda x, _: x)


def test_other_tags_have_other_functions():
    creased = ls.Mesh(*zoo.cube(), creases={(0, 1): 2.0})
    coarse, fine = ls.Space(ls.LimitSurface(ls.Mesh(*zoo.cube()))), ls.LimitSurface(creased)
    with pytest.raises(ValueError, match="both need one cage, with the same tags"):
        ls.Space(fine, levels=1).prolongation(coarse)
    with pytest.raises(ValueError, match="terms: got none"):
        coarse.assemble([])
    with pytest.raises(TypeError, match="need a function"):
        coarse.load(1.0)


def test_deep_rings_at_any_corner():
    # rings of a pole of valence 12 that u and v cannot tell from the corner (1, 1)
    first = two_poles(12)
    faces = np.reshape(first.mesh.indices, (-1, 4))
    found = []
    for k in (0, 2):
        space = ls.Space(ls.LimitSurface(ls.Mesh(first.mesh.points, np.roll(faces, k, axis=1))))
        q = ls.quadrature(space.surface, integrand="curvature", face=[0], points=2)
        assert ((q.u == 1) | (q.v == 1)).any() == (k > 0)
        found.append(space.bilaplace(quadrature=q))
    assert abs(found[0]).max() > 1
    assert abs(found[1] - found[0]).max() < 1e-12 * abs(found[0]).max()


def test_energies_that_are_infinite():
    points, faces = zoo.prism(4)
    points, faces = np.asarray(points, float), np.asarray([list(x) for x in faces])
    away = np.linalg.norm(points - points[0], axis=1).argmax()
    other = np.where(faces == 0, away, faces + len(points))
    both = ls.Mesh(
        np.concatenate([points, points - points[0] + points[away]]), np.concatenate([faces, other])
    )
    touching = ls.LimitSurface(ls.selected(both, np.arange(12)))
    assert touching.mesh.nonmanifold_vertex.sum() == 1
    spike = ls.LimitSurface(ls.Mesh(points, faces, corners={0: np.inf}))
    for cage, several in ((touching, (0, 1)), (spike, (0,))):
        for levels in several:
            space = ls.Space(cage, levels=levels)
            assert np.isclose(space.mass().sum(), ls.area(cage), rtol=1e-6)
            with pytest.raises(ValueError, match=r"infinite around a corner of limit face"):
                space.bilaplace()
            with pytest.raises(ValueError, match="energies of second derivatives are infinite"):
                ls.ThinShell(space, young=1.0, poisson=0.3, thickness=0.1)
