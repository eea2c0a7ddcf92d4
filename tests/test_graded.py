"""Graded spaces: against uniform ones by least squares and min-max, polynomials, known plates."""

import warnings

import numpy as np
import pytest
import zoo
from scipy.sparse.linalg import spsolve
from test_fem import closed, errors, gradient, square, two_poles, u

import limitsurf as ls
from limitsurf.fem.supports import at, clamped, fixed, symmetric, turning

SPLIT = [name for name in ls.schemes.with_pieces if not ls.schemes[name].lattice.dual]


def places(surface, count=4):
    """Points inside limit faces."""
    known = np.flatnonzero(surface.patches.with_limit)
    at = (np.arange(count) + 0.4) / count
    s, t = (np.tile(x.ravel(), len(known)) for x in np.meshgrid(at, at))
    if surface.topology.lattice.face_size == 3:
        t = t * (1 - s)
    return np.repeat(known, count**2), s, t


def some(space, count, seed=0):
    """Which limit faces: some of those that have a limit."""
    known = np.flatnonzero(space.surface.patches.with_limit)
    found = np.zeros(len(space.surface.limit_faces), dtype=bool)
    found[np.random.default_rng(seed).choice(known, count, replace=False)] = True
    return found


def at_points(space, points):
    """All functions (m, n) at points that are on the surface."""
    found = ls.closest_point(space.surface, points)
    assert found.distance.max() < 1e-9
    return space.rows(found.face, found.u, found.v).toarray()


def rank(matrix):
    size = np.linalg.svd(matrix / np.linalg.norm(matrix, axis=0), compute_uv=False)
    return int((size > 1e-8 * size[0]).sum())


# ---------------------------------------------------------------------- what functions there are


@pytest.mark.parametrize("scheme", SPLIT)
def test_functions_are_those_of_the_finest_space_by_least_squares(scheme):
    surface = closed(scheme)
    coarse, fine = (ls.Space(surface, levels=n) for n in (1, 2))
    graded = coarse.finer(some(coarse, 1))
    assert coarse.n <= graded.n <= fine.n
    face, s, t = places(graded.surface, 3)
    points = graded.surface.evaluate(face, s, t)
    own = graded.rows(face, s, t).toarray()
    assert rank(own) == graded.n  # independent
    wide = at_points(fine, points)
    off = wide @ np.linalg.lstsq(wide, own, rcond=None)[0] - own
    assert abs(off).max() < 1e-6  # of places that were found, next to poles
    # all functions of the coarse space, and which they are
    P = graded.prolongation(coarse)
    assert abs(own @ P - at_points(coarse, points)).max() < 1e-6
    mass = [
        x.mass(quadrature=ls.quadrature(x.surface, points=6, rtol=1e-6)) for x in (graded, coarse)
    ]
    assert np.allclose((P.T @ mass[0] @ P).toarray(), mass[1].toarray(), atol=1e-6)
    # constants, and the surface itself
    assert abs(graded.extraction.sum(axis=1) - 1).max() < 1e-13
    assert abs(graded.extraction @ graded.points - graded.surface.points).max() < 1e-13
    assert abs(graded.operator @ surface.points - graded.points).max() < 1e-13
    assert np.isclose(graded.mass().sum(), fine.mass().sum(), rtol=1e-7)


def test_functions_are_chosen_by_supports():
    # by hand: of both uniform spaces those functions that Kraft takes span the same space
    surface = two_poles(5)
    coarse, fine = (ls.Space(surface, levels=n) for n in (1, 2))
    graded = coarse.finer(some(coarse, 2, seed=3))
    face, s, t = places(graded.surface)
    refined = graded.grading.level[graded.surface.limit_faces.face[face]] == 1
    points = graded.surface.evaluate(face, s, t)
    low, high = at_points(coarse, points), at_points(fine, points)
    tiny = 1e-9
    # samples tell supports: many in each face
    kept = low[:, (abs(low[~refined]) > tiny).any(axis=0)]
    new = high[:, (abs(high[~refined]) <= tiny).all(axis=0)]
    both = np.concatenate([kept, new], axis=1)
    assert graded.n == both.shape[1]
    assert 0 < new.shape[1] < high.shape[1]
    assert kept.shape[1] < low.shape[1]
    assert rank(np.concatenate([both, graded.rows(face, s, t).toarray()], axis=1)) == graded.n


@pytest.mark.parametrize("scheme", ["catmull-clark", "loop"])
def test_everything_refined_is_the_uniform_space(scheme):
    surface = closed(scheme)
    fine = ls.Space(surface, levels=2)
    for graded in (
        ls.Space(surface, levels=1, where=np.ones(surface.mesh.n_faces, dtype=bool)),
        ls.Space(surface, where=[2] * surface.mesh.n_faces),
    ):
        assert graded.n == fine.n
        assert np.allclose(graded.mass().toarray(), fine.mass().toarray(), rtol=0, atol=1e-12)
        assert abs(graded.stiffness() - fine.stiffness()).max() < 1e-9
        assert (graded.parents >= 0).sum() == fine.surface.patches.with_limit.sum()


def test_where_and_finer_are_one():
    surface = two_poles(5)
    chosen = np.arange(surface.mesh.n_faces) == 7
    space = ls.Space(surface, levels=1)
    one, other = ls.Space(surface, levels=1, where=chosen), space.finer(space.parents == 7)
    assert one.n == other.n
    assert (one.parents == other.parents).all()
    assert abs(one.mass() - other.mass()).max() == 0
    again = other.finer(some(other, 1, seed=5))
    assert again.n > other.n
    assert again.grading.level.max() in (1, 2)
    assert np.isclose(again.mass().sum(), one.mass().sum(), rtol=1e-6)


@pytest.mark.parametrize("ends", ["free", "natural"])
def test_creases_and_boundaries_keep_their_limit(ends):
    points, faces = zoo.grid(5, 4, seed=2)
    points = np.concatenate([np.asarray(points, float)[:, :2], np.zeros((len(points), 1))], axis=1)
    points += 0.2 * np.random.default_rng(1).normal(size=points.shape)
    mesh = ls.Mesh(points, faces)
    inside = mesh.edges[~mesh.boundary_edge][::3]
    surface = ls.LimitSurface(
        mesh.with_tags(creases=(inside, np.resize([1.5, np.inf, 0.5], len(inside))), holes=[3])
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of creases that end at the boundary
        space = ls.Space(surface, levels=1, ends=ends)
    graded = space.finer(some(space, 1))
    graded = graded.finer(some(graded, 2, seed=1))
    found = ls.closest_point(surface, graded.surface.evaluate(*places(graded.surface)))
    assert found.distance.max() < 1e-11
    assert np.isclose(ls.area(graded.surface), ls.area(surface), rtol=1e-9)
    here = places(graded.surface)
    own = graded.function(graded.points).evaluate(*here)
    assert abs(own - graded.surface.evaluate(*here)).max() < 1e-13
    assert set(np.unique(graded.parents)) == {*range(mesh.n_faces)} - {3} | {-1}


def test_cubics_are_in_graded_spaces_of_squares():
    space = ls.Space(square(), levels=3)
    x = space.surface.evaluate(np.arange(len(space.surface.limit_faces)), 0.5, 0.5)
    graded = space.finer((x < 0.2).all(axis=-1))
    assert space.n < graded.n < 19**2
    x = graded.surface.evaluate(np.arange(len(graded.surface.limit_faces)), 0.5, 0.5)
    graded = graded.finer((x < 0.1).all(axis=-1))

    def f(x, _):
        return x[:, 0] ** 3 * x[:, 1] ** 2 - x[:, 1] ** 3

    c = graded.project(f)
    face, s, t = places(graded.surface)
    g = graded.function(c, channel="f")
    where = graded.surface.evaluate(face, s, t)
    assert np.allclose(
        g.evaluate(face, s, t, channel="f")[:, 0], f(where, None), rtol=0, atol=1e-11
    )
    assert np.allclose(graded.function(c).evaluate(face, s, t), f(where, None), rtol=0, atol=1e-11)
    # of the square of its Laplacian, 6 x y^2 + 2 x^3 - 6 y: by sympy
    assert np.isclose(c @ graded.bilaplace() @ c, 36 / 15 + 4 / 7 + 12 + 24 / 15 - 9 - 3)
    assert ls.tessellate(g, 3, channels=["f"]).channels["f"][0].shape[1:] == (1,)


# ---------------------------------------------------------------------- forms


def test_matrices_are_sums_over_points():
    graded = ls.Space(two_poles(5), levels=1, near_poles=0, where=np.arange(30) == 0)
    q = ls.quadrature(graded.surface, points=3, rtol=1e-6)
    basis, geometry = graded.basis(q, 2), graded.geometry(q)
    rows, du, dv = graded.rows(q.face, q.u, q.v, nu=[(0, 0), (1, 0), (0, 1)])
    w, g = q.weights * geometry.area, geometry.inverse
    d = du, dv
    known = {
        "mass": (rows.T * w) @ rows,
        "stiffness": sum((d[a].T * (w * g[:, a, b])) @ d[b] for a in range(2) for b in range(2)),
    }
    for name, matrix in known.items():
        made = getattr(graded, name)
        found = made(quadrature=q)
        assert abs(found - matrix).max() <= 1e-13 * abs(matrix).max()
        assert abs(found - found.T).max() == 0
        assert (made(quadrature=q, workers=3).data == found.data).all()
        assert found.indices is made().indices
    one = graded.assemble([((1, 0), (0, 0), w / q.weights)], quadrature=q)
    assert abs(one - (du.T * w) @ rows).max() < 1e-13
    for nu, own in (((0, 0), rows), ((1, 0), du)):
        assert abs(basis.weights(nu) - own).max() < 1e-12
        assert basis.weights(nu).indices is basis.weights((0, 0)).indices
    load = graded.load(lambda x, _: x[:, :2], quadrature=q)
    assert np.allclose(load, rows.T @ (w[:, None] * geometry.points[:, :2]), atol=1e-14)


def test_eigenvalues_are_between_those_of_uniform_spaces():
    surface = two_poles(8)
    low, high = (ls.eigenmodes(ls.Space(surface, levels=n), 8).eigenvalues for n in (1, 2))
    space = ls.Space(surface, levels=1)
    found = ls.eigenmodes(space.finer(space.parents < 8), 8)
    assert (found.eigenvalues[1:] < low[1:] + 1e-10).all()
    assert (found.eigenvalues[1:] > high[1:] - 1e-10).all()
    assert abs(found.eigenvalues[0]) < 1e-10


def solution(space):
    """Of u - Laplace u = f, of which u is known, in the weak form."""
    q = ls.quadrature(space.surface)
    basis, geometry = space.basis(q, 1), space.geometry(q)
    w = q.weights * geometry.area
    right = basis.weights().T @ (w * u(geometry.points))
    flux = np.einsum("nab,nbk,nk->na", geometry.inverse, geometry.tangents,
                     gradient(geometry.points))  # fmt: skip
    for a, nu in enumerate([(1, 0), (0, 1)]):
        right += basis.weights(nu).T @ (w * flux[:, a])
    return spsolve((space.mass(quadrature=q) + space.stiffness(quadrature=q)).tocsc(), right)


def test_a_third_of_the_unknowns_for_the_same_error():
    # the uniform space of 4 levels has 12,290 and errors of 5.57e-5 and 2.07e-3
    graded = ls.Space(two_poles(8), levels=3, near_poles=1)
    assert graded.n == 4226
    assert np.allclose(errors(graded, solution(graded)), [5.61e-5, 2.10e-3], rtol=3e-3)


def test_refinement_by_residuals_regains_the_order():
    # errors in the energy, of the best solution that is known: 1.5 is best, poles have 0.71
    surface = two_poles(8)
    f = lambda x, _: u(x)  # noqa: E731
    space, found = ls.Space(surface, levels=1), []
    for _ in range(6):
        load = space.load(f)
        c = spsolve((space.mass() + space.stiffness()).tocsc(), load)
        off = ls.element_residuals(space, c, f, reaction=1.0)
        found.append((space.n, 2.56707000087 - c @ load, np.sqrt(off @ off)))
        order = np.argsort(-off)
        most = np.cumsum(off[order] ** 2)
        chosen = np.zeros(len(off), dtype=bool)
        chosen[order[: 1 + np.searchsorted(most, most[-1] / 2)]] = True
        space = space.finer(chosen)
    n, energy, estimate = np.array(found).T
    error = np.sqrt(energy)
    rates = [np.polyfit(np.log(n), np.log(x), 1)[0] for x in (error, estimate)]
    assert (np.array(rates) < -1.3).all()
    ratio = estimate / error
    assert ratio.max() < 4 * ratio.min()


# ---------------------------------------------------------------------- thin shells


def plate(graded, **options):
    space = ls.Space(square(), levels=3)
    if graded:
        x = space.surface.evaluate(np.arange(len(space.surface.limit_faces)), 0.5, 0.5)
        space = space.finer((abs(x - [0.5, 0.5, 0]) < 0.1).all(axis=-1))
    return ls.ThinShell(space, young=1e6, poisson=0.3, thickness=0.01, density=2.0, **options)


def test_plates_on_graded_spaces():
    shell = plate(True)
    assert shell.space.n > plate(False).space.n
    stiffness = 1e6 * 0.01**3 / 12 / (1 - 0.3**2)
    load = shell.load(pressure=1.0)
    for support, known in ((fixed, 0.00406235), (clamped, 0.00126532)):  # Timoshenko's tables
        x = shell.solve(load, support(where=lambda x: x[:, 0] == x[:, 0]))
        middle = ls.closest_point(shell.space.surface, [[0.5, 0.5, 0]])
        w = x.displacement.evaluate(middle.face, middle.u, middle.v)[0, 2]
        assert np.isclose(abs(w) * stiffness, known, rtol=2e-3)
        assert np.isclose(x.reactions[:, 2].sum(), -load[:, 2].sum())
        assert np.isclose(abs(load[:, 2].sum()), 1)
    moved = x.deformed(2.0).evaluate(middle.face, middle.u, middle.v)[0]
    assert np.isclose(moved[2], 2 * w)
    # a force at a place
    force = shell.load(points=[(int(middle.face[0]), middle.u[0], middle.v[0], (0, 0, 1.0))])
    assert np.allclose(force.sum(axis=0), [0, 0, 1])


def test_rigid_motions_and_constant_strains_of_graded_shells():
    shell = plate(True)
    K, points = shell.stiffness(), shell.space.points
    assert abs(K - K.T).max() == 0
    found = shell.modes(8).eigenvalues
    assert (abs(found[:6]) < 1e-6).all()
    assert (found[6:] > 100).all()
    stretched = points * [1, 0, 0]
    energy = stretched.ravel() @ K @ stretched.ravel()
    assert np.isclose(energy, 1e6 * 0.01 / (1 - 0.3**2), rtol=1e-12)
    turned = np.cross([0.3, 0.2, 1], points).ravel()
    assert abs(K @ turned).max() < 1e-9 * abs(K).max()
    whole = shell.mass()
    moved = np.tile([0, 0, 1.0], shell.space.n)
    assert np.isclose(moved @ whole @ moved, 2.0 * 0.01)
    membrane, bending = shell.strains(stretched, *(x[:4] for x in places(shell.space.surface)))
    assert np.allclose(membrane, np.diag([1, 0, 0]), atol=1e-11)
    assert abs(bending).max() < 1e-8


@pytest.mark.parametrize("scheme", ["catmull-clark", "loop", "bilinear", "linear"])
def test_functions_of_given_values_in_graded_spaces(scheme):
    space = ls.Space(closed(scheme), levels=1, near_poles=2)

    def f(x, _):
        return np.stack([x[:, 0], np.sin(2 * x[:, 1])], axis=1)

    c = space.interpolate(f)
    # the surface itself is of the space, and no other function has its values
    assert abs(c[:, 0] - space.points[:, 0]).max() < 1e-9
    found = space.function(c)
    face, u, v = space.surface.limit_faces.at_vertex(np.flatnonzero(space.grading.told))
    x = space.surface.evaluate(face, u, v)
    assert len(face) > space.n / 2
    assert abs(found.evaluate(face, u, v) - f(x, None)).max() < 1e-12


def roof(where, **options):
    """A sharp edge between two slopes, in a space of one level more on some faces."""
    points = [[x, y, abs(x - 2) / 4] for y in range(4) for x in range(5)]
    faces = [[a, a + 1, a + 6, a + 5] for a in range(15) if a % 5 < 4]
    edges = {(2, 7): np.inf, (7, 12): np.inf, (12, 17): np.inf}
    surface = ls.LimitSurface(ls.Mesh(points, faces, creases=edges))
    space = ls.Space(surface, levels=1, where=where, ends="natural")
    return ls.ThinShell(
        space, young=1e6, poisson=0.3, thickness=0.1, density=1.0, stiff_creases=True
    )


def test_stiff_creases_between_faces_of_different_levels():
    left = np.arange(12) % 4 < 2
    some = np.isin(np.arange(12), [1, 6, 10])  # on both sides, here and there
    energies = []
    for where in (None, ~left, left, np.ones(12, bool)):
        shell = roof(where)
        values = shell.modes(8).eigenvalues
        assert np.abs(values[:6]).max() < 1e-8 * values[6]
        support = clamped([(0, 5), (5, 10), (10, 15)])  # edges of the cage
        energies.append(shell.solve(shell.load(pressure=1.0), support).energy)
    assert energies == sorted(energies)  # what has more functions gives way more
    assert np.isclose(*energies[2:], rtol=1e-3)  # where it is held it is refined in both
    # each piece of a crease once, whatever the levels beside it
    from limitsurf.fem.creases import hinges

    for where in (None, left, some):
        found = hinges(roof(where).space)
        _, along = turning(roof(where).space, found.corners[:, 0], 0.5)
        length = np.linalg.norm(along, axis=1) @ found.share[:, 0]
        assert np.isclose(length, 3, rtol=1e-2)
        sides = roof(where).space.surface.limit_faces.along
        at = found.at(0.3)
        one, other = (
            roof(where).space.surface.evaluate(*sides(found.corners[:, k], at[k])) for k in (0, 1)
        )
        assert abs(one - other).max() < 1e-12


def test_fixed_edges_of_several_levels():
    # displacements on them are zero all along, however many functions there are
    space = ls.Space(square(), levels=2, where=None)
    graded = space.finer(np.arange(len(space.surface.limit_faces)) == 0)
    shell = ls.ThinShell(graded, young=1e6, poisson=0.3, thickness=0.05)
    x = shell.solve(shell.load(pressure=1.0), fixed([(0, 1), (1, 2), (2, 3), (3, 0)]))
    rim = np.flatnonzero(graded.grading.rim)
    assert set(graded.grading.level[graded.surface.mesh.corner_face[rim]]) == {0, 1}
    place = graded.surface.limit_faces.along(rim[:, None], np.linspace(0, 1, 7))
    assert abs(x.displacement.evaluate(*place)).max() < 1e-10 * abs(x.coefficients).max()


def everywhere(points):
    return points[:, 0] == points[:, 0]


@pytest.mark.parametrize("middle", [(0, 0.5), (0.2, 0), (1, 1)])
def test_clamped_edges_of_several_levels(middle):
    # a square plate, Timoshenko's table; whole, and as a quarter between planes of symmetry
    stiffness = 1e6 * 0.01**3 / 12 / (1 - 0.3**2)
    space = ls.Space(square(), levels=3)
    x = space.surface.evaluate(np.arange(len(space.surface.limit_faces)), 0.5, 0.5)
    space = space.finer((abs(x - [*middle, 0]) < 0.15).all(axis=-1))
    rim = np.flatnonzero(space.grading.rim)
    assert set(space.grading.level[space.surface.mesh.corner_face[rim]]) == {0, 1}
    shell = ls.ThinShell(space, young=1e6, poisson=0.3, thickness=0.01)
    load = shell.load(pressure=1.0)
    whole = shell.solve(load, clamped(where=everywhere))
    far = (clamped(where=lambda x, k=k: x[:, k] > 1 - 1e-9) for k in (0, 1))
    quarter = shell.solve(load, symmetric("x"), symmetric("y"), *far)
    for found, place, size in ((whole, [0.5, 0.5, 0], 1), (quarter, [0, 0, 0], 2)):
        there = ls.closest_point(space.surface, [place])
        w = found.displacement.evaluate(there.face, there.u, there.v)[0, 2]
        assert np.isclose(w * stiffness, 0.00126532 * size**4, rtol=3e-4)
    # neither moved nor turned, all along
    place = space.surface.limit_faces.along(rim[:, None], np.linspace(0, 1, 7))
    size = abs(whole.coefficients).max()
    for nu in ((0, 0), (1, 0), (0, 1)):
        assert abs(whole.displacement.evaluate(*place, nu=nu)).max() < 1e-10 * size


def test_clamped_curved_edges_of_several_levels_do_not_lock():
    # turns about curved edges are no splines: one condition too many would make it stiffer
    flat = ls.Space(square(), levels=3)

    def roof(points, normals):
        return np.stack([points[:, 0], points[:, 1], 0.3 * np.sin(2 * points[:, 0])], axis=1)

    surface = ls.LimitSurface(flat.surface.mesh.with_points(flat.project(roof)))
    energy = {}
    for name in ("coarse", "graded", "fine"):
        space = ls.Space(surface, levels=int(name == "fine"), ends="natural")
        if name == "graded":
            x = space.surface.evaluate(np.arange(len(space.surface.limit_faces)), 0.5, 0.5)
            space = space.finer(x[:, 0] < 0.3)
        shell = ls.ThinShell(space, young=1e6, poisson=0.3, thickness=0.02)
        found = shell.solve(shell.load(pressure=1.0), clamped(where=everywhere))
        energy[name] = found.energy
    assert energy["coarse"] < energy["graded"] < energy["fine"]
    assert energy["graded"] - energy["coarse"] > 0.1 * (energy["fine"] - energy["coarse"])


# ---------------------------------------------------------------------- bad input


def test_what_is_wrong_is_named():
    surface = square()
    space = ls.Space(surface, levels=3)
    graded = space.finer(some(space, 1))
    with pytest.raises(ValueError, match=r"where must be \(1,\) booleans"):
        ls.Space(surface, where=[True, False])
    with pytest.raises(ValueError, match=r"where must be \(1,\) booleans"):
        ls.Space(surface, where=[0.5])
    with pytest.raises(ValueError, match=r"where must be \(1,\) booleans"):
        ls.Space(surface, where=[-1])
    with pytest.raises(ValueError, match="near_poles"):
        ls.Space(surface, near_poles=-1)
    with pytest.raises(ValueError, match="'doo-sabin' does not: use levels="):
        ls.Space(closed("doo-sabin"), near_poles=1)
    with pytest.raises(ValueError, match=r"where must be \(\d+,\) booleans, one for each limit"):
        graded.finer([True])
    with pytest.raises(ValueError, match="on a limit face that has a limit"):
        graded.finer(np.zeros(len(graded.surface.limit_faces), dtype=bool))
    with pytest.raises(ValueError, match="prolongation from graded spaces"):
        space.prolongation(graded)
    with pytest.raises(MemoryError, match=r"faces of 40 levels take .* up to \d+ levels fit"):
        ls.Space(surface, levels=40)
    with pytest.raises(ValueError, match=r"got float64 of shape \(1, 2\), need integers"):
        clamped([[0, 1.5]])
    corner = space.surface.evaluate(np.arange(len(space.surface.limit_faces)), 0.5, 0.5).max(
        axis=-1
    )
    edge = ls.ThinShell(space.finer(corner < 0.1), young=1.0, poisson=0.0, thickness=0.1)
    edge.solve(edge.load(pressure=1.0), at(0, [0, 1, 0.5], [0, 0, 0.5]))
    with pytest.raises(TypeError, match="needs a Space"):
        ls.element_residuals(surface, [0], lambda x, _: x[:, 0])
    with pytest.raises(ValueError, match="one tangent plane"):
        ls.element_residuals(ls.Space(closed("bilinear")), [0], lambda x, _: x[:, 0])
    with pytest.raises(ValueError, match="one number for each point"):
        ls.element_residuals(space, np.zeros(space.n), lambda x, _: x)
    with pytest.raises(ValueError, match="reaction must be finite"):
        ls.element_residuals(space, np.zeros(space.n), lambda x, _: x[:, 0], reaction=np.nan)
