"""Ends that are free where they can be: counted by hand, and functions seen from both sides."""

import warnings

import numpy as np
import pytest
import zoo

import limitsurf as ls

SQUARE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]]


def plane(m, n, missing=()):
    """A grid of squares in the plane, without some of them."""
    points = [[x, y, 0.0] for y in range(n + 1) for x in range(m + 1)]
    faces = [
        [a, a + 1, a + m + 2, a + m + 1]
        for a, place in ((y * (m + 1) + x, (x, y)) for y in range(n) for x in range(m))
        if place not in missing
    ]
    mesh = ls.Mesh(points, faces)
    return ls.selected(mesh, np.arange(mesh.n_faces))


def corner_plane():
    """An L of 12 squares, with three of them at the corner that is turned in."""
    return plane(4, 4, {(x, y) for x in (2, 3) for y in (2, 3)})


def cut_plane():
    mesh = plane(4, 3)
    return mesh.with_tags(creases={(5 * k + 2, 5 * k + 7): np.inf for k in range(3)})


def sharp_cube():
    points, faces = zoo.prism(4)
    mesh = ls.Mesh(np.asarray(points, float), faces)
    return mesh.with_tags(creases=(mesh.edges, np.full(mesh.n_edges, np.inf)))


def ring_of_creases():
    """A cube with a crease all around its lid, after one step: no crease ends or meets another."""
    points, faces = zoo.prism(4)
    mesh = ls.Mesh(np.asarray(points, float), faces)
    lid = np.asarray(faces[0])
    tagged = mesh.with_tags(creases=dict.fromkeys(zip(lid, np.roll(lid, 1), strict=True), np.inf))
    return ls.refined(tagged)


def dart():
    mesh = plane(4, 4)
    return mesh.with_tags(creases={(12, 7): np.inf, (7, 2): np.inf})


CAGES = {
    "corner": corner_plane, "cut": cut_plane, "cube": sharp_cube, "ring": ring_of_creases,
    "dart": dart,
}  # fmt: skip


def spaces(mesh, *levels):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return [ls.Space(ls.LimitSurface(mesh), levels=k) for k in levels]


def parameters(space):
    """The form of gradients in the parameters of the cage, which is exact and of no level."""
    return space.assemble([((1, 0), (1, 0), 1.0), ((0, 1), (0, 1), 1.0)])


@pytest.mark.parametrize("name", CAGES)
def test_functions_go_on_across_edges(name):
    (space,) = spaces(CAGES[name](), 1)
    mesh, grading = space.refined_surface.mesh, space.grading
    f = space.function(np.random.default_rng(1).normal(size=space.n))
    both = mesh.edge_corners[(mesh.edge_corners >= 0).all(axis=1)]
    sharp = np.zeros(mesh.n_edges, dtype=bool)
    edges, sharpness = mesh.creases
    sharp[mesh.edge_numbers(edges[sharpness == np.inf])] = True
    sharp = sharp[mesh.corner_edge[both[:, 0]]]
    here, there = (grading.placed(x) for x in both.T)
    along = space.surface.limit_faces.along
    t = np.array([0.0, 0.1, 0.35, 0.9, 1.0])
    one, other = along(here[:, None], t), along(there[:, None], 1 - t)
    assert abs(f.evaluate(*one) - f.evaluate(*other)).max() < 1e-12
    # derivatives along the surface, in the plane: the gradient
    if name in ("corner", "cut", "dart"):
        jets = []
        for place in (one, other):
            inside = [x[:, 1:-1] for x in place]
            x, g = space.surface.jet(*inside, order=1), f.jet(*inside, order=1)
            J = np.stack([x[1, 0][..., :2], x[0, 1][..., :2]], axis=-2)
            jets.append(np.linalg.solve(J, np.stack([g[1, 0], g[0, 1]], axis=-1)[..., None]))
        jump = abs(jets[0] - jets[1])[..., 0].max(axis=(1, 2))
        assert jump[~sharp].max() < 1e-10
        if name == "cut":
            assert jump[sharp].min() > 1e-3


@pytest.mark.parametrize("name", CAGES)
def test_coarse_functions_are_fine_ones(name):
    coarse, fine = spaces(CAGES[name](), 0, 2)
    P = fine.prolongation(coarse)
    # children of a face have its parameters twice as fast: the form is the same
    before, after = parameters(coarse), parameters(fine)
    accuracy = {"ring": 5e-5, "corner": 5e-9}.get(name, 1e-11)  # of quadratures at poles
    assert abs(P.T @ after @ P - before).max() < accuracy * abs(before).max()
    assert abs(P @ coarse.points - fine.points).max() < 1e-13
    assert abs(P @ coarse.operator - fine.operator).max() < 1e-13
    assert np.allclose(fine.operator.sum(axis=1), 1)
    assert np.isclose(ls.area(fine.surface), ls.area(fine.cage), rtol=1e-8)
    assert np.linalg.matrix_rank(fine.mass().toarray(), tol=1e-12) == fine.n


def test_as_many_functions_as_splines_have():
    (cube,) = spaces(sharp_cube(), 0)
    # six faces of 16 bicubic functions each; on 12 edges 4 of them are those of two faces, where 3
    # edges meet one value
    values = 8 + 12 * 2
    assert cube.n == values + 6 * (16 - 12)
    (cut,) = spaces(cut_plane(), 0)
    # two pieces of 2 by 3 squares, (2 + 3) (3 + 3) functions, of one line of 6
    assert cut.n == 2 * 5 * 6 - 6
    (corner,) = spaces(corner_plane(), 0)
    # of 24 ghosts around 21 vertices those beside the corner are not free
    assert 21 < corner.n == 42


def test_cubic_functions_on_both_sides_of_a_crease():
    (space,) = spaces(cut_plane(), 1)

    def f(x, _):  # with a kink in the crease
        a, b = x[:, 0], x[:, 1]
        return a**3 - a * b**2 + b**3 + np.where(a > 2, (a - 2) * b**2, 0)

    q = ls.quadrature(space.surface)
    at = space.surface.evaluate(q.face, q.u, q.v)
    found = space.function(space.project(f)).evaluate(q.face, q.u, q.v)
    assert abs(found - f(at, None)).max() < 1e-11
    found = space.function(space.interpolate(f)).evaluate(q.face, q.u, q.v)
    assert abs(found - f(at, None)).max() < 1e-11


def test_natural_ends_only_where_a_vertex_is_not_regular():
    with pytest.warns(UserWarning, match="natural ends at 1 boundary vertex") as caught:
        free = ls.Space(ls.LimitSurface(corner_plane()), levels=2)
    assert len(caught) == 1
    natural = ls.Space(ls.LimitSurface(corner_plane()), levels=2, ends="natural")

    def f(x, _):
        return np.sin(x[:, 0]) * np.cos(0.7 * x[:, 1])

    errors = []
    for space in (free, natural):
        q = ls.quadrature(space.surface)
        at = space.surface.evaluate(q.face, q.u, q.v)
        apart = space.function(space.project(f)).evaluate(q.face, q.u, q.v) - f(at, None)
        errors.append(np.sqrt((q.weights * space.geometry(q).area) @ apart**2))
    assert errors[0] < errors[1] / 3
    # all but the corner as on a whole square
    value = free.project(lambda x, _: x[:, 0] ** 3)
    far = free.surface.evaluate(np.arange(len(free.surface.limit_faces)), 0.5, 0.5)
    far = np.flatnonzero(np.abs(far[:, :2] - 2).max(axis=1) > 1.8)
    assert len(far)
    found = free.function(value).evaluate(far, 0.5, 0.5)
    assert abs(found - free.surface.evaluate(far, 0.5, 0.5)[:, 0] ** 3).max() < 1e-3


@pytest.mark.parametrize("name", ["cut", "cube"])
def test_extended_cages_are_cut_along_creases(name):
    mesh = CAGES[name]()
    points = mesh.points + np.random.default_rng(3).normal(size=mesh.points.shape) / 9
    before = ls.LimitSurface(mesh.with_points(points))
    wide = ls.extended(before.mesh)
    after = ls.LimitSurface(wide)
    assert len(wide.holes) == wide.n_faces - mesh.n_faces
    assert not len(wide.creases[0])
    face, (s, t) = np.arange(mesh.n_faces)[:, None], np.random.default_rng(0).uniform(size=(2, 9))
    s[:3], t[2:5] = 0, 1
    for nu in ((0, 0), (1, 0), (1, 1)):
        one, other = (x.evaluate(face, s, t, nu=nu) for x in (before, after))
        assert np.allclose(one, other, rtol=0, atol=1e-12, equal_nan=True)


def test_shells_on_parts():
    from limitsurf.fem.supports import clamped, fixed, symmetric

    mesh = cut_plane()
    (space,) = spaces(mesh, 1)
    with pytest.warns(UserWarning, match="6 edges on infinitely sharp creases"):
        shell = ls.ThinShell(space, young=1e6, poisson=0.3, thickness=0.1, density=1.0)
    modes = shell.modes(8).eigenvalues
    assert (abs(modes[:7]) < 1e-9 * modes[7]).all()  # six rigid motions and the hinge
    stiff = ls.ThinShell(
        space, young=1e6, poisson=0.3, thickness=0.1, density=1.0, stiff_creases=True
    )
    whole = ls.Space(ls.LimitSurface(plane(4, 3)), levels=1)
    smooth = ls.ThinShell(whole, young=1e6, poisson=0.3, thickness=0.1, density=1.0)
    one, other = stiff.modes(8).eigenvalues, smooth.modes(8).eigenvalues
    assert (abs(one[:6]) < 1e-9 * one[6]).all()
    assert np.allclose(one[6:], other[6:], rtol=0.03)
    # supports by edges of the cage, by places and by a plane, on both sides of the crease
    edges = mesh.edges[mesh.boundary_edge]
    load = {x: x.load(pressure=1.0) for x in (stiff, smooth)}
    for support in (
        clamped(edges), clamped(), fixed(edges), fixed(where=lambda x: x[:, 0] > -1),
        [fixed(), symmetric(([0, 0, 0], [1, 0, 0]))],
    ):  # fmt: skip
        both = [
            x.solve(load[x], *(support if isinstance(support, list) else [support]))
            for x in (stiff, smooth)
        ]
        assert np.isclose(both[0].energy, both[1].energy, rtol=0.03)


def test_graded_spaces_where_ends_are_parted():
    (space,) = spaces(corner_plane(), 2)
    faces = np.arange(len(space.surface.limit_faces)) % 7 == 0
    finer = space.finer(faces)
    assert finer.n > 0
    parent = space.parents
    assert (np.bincount(parent[parent >= 0], minlength=12) == 16).all()
    with pytest.raises(ValueError, match="phantom points along parts"):
        finer.prolongation(spaces(corner_plane(), 1)[0])
