"""Approximate patches: where they are exact, how they meet, and how far they are."""

import numpy as np
import pytest
import zoo
from test_query_closest import fan, made

import limitsurf as ls
from limitsurf.query.angles import _slope

KINDS = ["acc", "gregory"]
CORNERS = np.array([(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)], dtype=float)


def torus(n, m):
    """Quads around a torus, all regular."""
    i, j = (x.ravel() for x in np.mgrid[:n, :m])
    a, b = 2 * np.pi * i / n, 2 * np.pi * j / m
    ring = 2 + np.cos(b)
    points = np.stack([ring * np.cos(a), ring * np.sin(a), np.sin(b)], axis=1)
    number = np.arange(n * m).reshape(n, m)
    steps = (0, 0), (-1, 0), (-1, -1), (0, -1)
    faces = np.stack([np.roll(number, step, (0, 1)) for step in steps], axis=2)
    return points, faces.reshape(-1, 4)


def bent_cube(levels):
    points, faces = zoo.cube()
    points = np.asarray(points, dtype=float) + 0.2 * np.random.default_rng(1).normal(size=(8, 3))
    return made((points, faces)), levels


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("levels", [0, 1, 2])
def test_corners_are_those_of_the_limit(kind, levels):
    surface, levels = bent_cube(levels)
    patches = ls.approximate(surface, kind, levels=levels)
    fine = made((patches.mesh.points, patches.mesh.faces))
    face = np.arange(len(patches))
    for u, v in CORNERS[:4]:
        for name in ("evaluate", "normal"):
            one, other = (getattr(x, name)(face, u, v) for x in (patches, fine))
            assert np.abs(one - other).max() < 1e-12


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["cube", "poles"])
def test_patches_meet(kind, name):
    if name == "cube":
        surface, levels = bent_cube(0)
    else:  # valences of 7 and of 3 and 4 side by side
        surface, levels = made(fan(7)), 2
    patches = ls.approximate(surface, kind, levels=levels)
    twin = patches.mesh.connectivity.twin
    corner = np.flatnonzero(twin >= 0)
    for t in (0.0, 0.15, 0.5, 0.9):
        places = []
        for c, x in ((corner, t), (twin[corner], 1 - t)):
            start, end = CORNERS[c % 4], CORNERS[c % 4 + 1]
            places.append((c // 4, *(start + x * (end - start)).T))
        for name in ("evaluate", "normal"):
            one, other = (getattr(patches, name)(*place) for place in places)
            assert np.abs(one - other).max() < 1e-12


@pytest.mark.parametrize("kind", KINDS)
def test_regular_faces_are_exact(kind):
    for surface in (made(torus(5, 6)), made(zoo.grid(3, 4))):
        found = ls.approximate(surface, kind).error(surface)
        assert found.parametric.max() < 1e-11
        assert found.angle_found.max() < 1e-12
        assert found.geometric_angle_found.max() < 1e-12
        assert max(found.angle.max(), found.geometric_angle.max()) < 1e-8


def test_deviations_of_the_cube_are_those_that_are_known():
    surface = made(zoo.cube())
    found = ls.approximate(surface, "acc").error(surface)
    assert found.parametric.max() == pytest.approx(1.4e-2, abs=1e-3)
    assert np.degrees(found.geometric_angle_found.max()) == pytest.approx(6.2, abs=0.05)
    assert found.parametric.max() < 1.1 * found.parametric_found.max()
    assert found.geometric_angle.max() < 1.2 * found.geometric_angle_found.max()
    assert found.angle.max() < 1.2 * found.angle_found.max()


def test_the_largest_angle_is_at_corners():
    """A grid that starts a little inside misses some of it."""
    points, faces = fan(5)
    points = np.asarray(points, dtype=float)
    points = points + 0.3 * np.random.default_rng(2).normal(size=points.shape)
    surface, levels = made((points, faces)), 2
    patches = ls.approximate(surface, "acc", levels=levels)
    fine = made((patches.mesh.points, patches.mesh.faces))
    face, most = np.arange(len(patches))[:, None, None], []
    for inset in (0, 0.01):
        x = np.linspace(inset, 1 - inset, 15)
        places = face, x[:, None], x
        one, other = patches.normal(*places, geometric=True), fine.normal(*places)
        most.append(degrees(one, other).max())
    assert most[0] > 1.1 * most[1]
    assert most[0] <= np.degrees(patches.error(surface).geometric_angle.max())


def degrees(one, other):
    across = np.linalg.norm(np.cross(one, other), axis=-1)
    return np.degrees(np.arctan2(across, (one * other).sum(axis=-1)))


def test_slopes_of_weights_inside_gregory_patches():
    rng = np.random.default_rng(0)
    for _ in range(50):
        a, b, c, d = np.concatenate([np.sort(rng.random(2)) for _ in range(2)])
        x, y = np.meshgrid(np.linspace(a, b, 60), np.linspace(c, d, 60))
        truth = 2 * y / (x + y) ** 2
        least, most = _slope(*(np.array([value]) for value in (a, b, c, d)))
        assert least <= truth.min() * (1 + 1e-12)
        assert truth.max() <= most * (1 + 1e-12)
        assert least > 0.999 * truth.min()
        assert most < 1.05 * truth.max()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("levels", [0, 1])
def test_bounds_hold(kind, levels):
    surface, levels = bent_cube(levels)
    patches = ls.approximate(surface, kind, levels=levels)
    found, rng = patches.error(surface), np.random.default_rng(3)
    face, (u, v) = rng.integers(len(patches), size=4000), rng.random((2, 4000)) ** 2
    fine = made((patches.mesh.points, patches.mesh.faces))
    step = patches.evaluate(face, u, v) - fine.evaluate(face, u, v)
    assert (np.sqrt((step**2).sum(axis=1)) <= found.parametric[face]).all()
    assert (found.parametric_found <= found.parametric).all()
    assert (found.along_normal_found <= found.parametric_found * (1 + 1e-12)).all()
    for geometric, bound in ((False, found.angle), (True, found.geometric_angle)):
        normal = patches.normal(face, u, v, geometric=geometric)
        turned = degrees(normal, fine.normal(face, u, v))
        assert (turned <= np.degrees(bound[face])).all()
        assert bound.max() < np.radians(12)
    assert (found.angle_found <= found.angle).all()
    assert (found.geometric_angle_found <= found.geometric_angle).all()


@pytest.mark.parametrize("kind", KINDS)
def test_refined_cages_are_nearer(kind):
    surface, _ = bent_cube(0)
    most = [ls.approximate(surface, kind, levels=k).error(surface).parametric.max()
            for k in range(3)]  # fmt: skip
    assert most[2] < most[1] / 2 < most[0] / 4


@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_are_those_of_places(kind):
    surface, _ = bent_cube(0)
    patches, h = ls.approximate(surface, kind), 1e-5
    face, (u, v) = np.arange(6), np.random.default_rng(5).uniform(0.1, 0.9, (2, 6))
    du, dv = (
        patches.evaluate(face, u + h * a, v + h * b) - patches.evaluate(face, u - h * a, v - h * b)
        for a, b in ((1, 0), (0, 1))
    )
    cross = np.cross(du, dv)
    cross /= np.sqrt((cross**2).sum(axis=1))[:, None]
    assert patches.normal(face, u, v, geometric=True) == pytest.approx(cross, abs=1e-7)


def test_what_papers_leave_out_is_refused():
    surface = made(zoo.cube())
    with pytest.raises(ValueError, match="kind must be one of acc, gregory, got 'pn'"):
        ls.approximate(surface, "pn")
    with pytest.raises(ValueError, match=r"has 5 corners.*ask for levels=1"):
        ls.approximate(made(zoo.prism(5)), "acc")
    assert len(ls.approximate(made(zoo.prism(5)), "acc", levels=1)) == 30
    sharp = made((*zoo.cube(), {"creases": {(0, 1): np.inf}}))
    with pytest.raises(ValueError, match="face 0 is beside a boundary, a sharp edge or vertex"):
        ls.approximate(sharp, "acc")
    with pytest.raises(ValueError, match="face 5 is beside a boundary"):
        ls.approximate(made(fan(5)), "gregory")
    with pytest.raises(ValueError, match="for the scheme catmull-clark, got doo-sabin"):
        ls.approximate(made(zoo.cube(), scheme="doo-sabin"), "acc")
    with pytest.raises(ValueError, match="levels must be an integer >= 0"):
        ls.approximate(surface, "acc", levels=-1)
    patches = ls.approximate(surface, "acc")
    with pytest.raises(ValueError, match="the surface has other faces"):
        patches.error(made(torus(3, 3)))
    with pytest.raises(IndexError, match="6"):
        patches.evaluate(6, 0.5, 0.5)
    with pytest.raises(ValueError, match="outside"):
        patches.evaluate(0, 1.5, 0.5)
    assert patches.evaluate([[0], [1]], 0.5, [0.1, 0.2, 0.3]).shape == (2, 3, 3)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("power", [-600, 600])
def test_units_do_not_matter(kind, power):
    surface, _ = bent_cube(0)
    scaled = surface.with_points(np.ldexp(surface.points, power))
    one, two = (ls.approximate(x, kind) for x in (surface, scaled))
    assert (np.ldexp(one.points, power) == two.points).all()
    off, scaled_off = one.error(surface), two.error(scaled)
    assert np.ldexp(off.parametric, power) == pytest.approx(scaled_off.parametric, rel=1e-12)
    assert off.angle_found == pytest.approx(scaled_off.angle_found, abs=1e-12)
    assert off.angle == pytest.approx(scaled_off.angle, abs=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_holes_have_no_patch(kind):
    points, faces = torus(4, 4)
    surface = made((points, faces, {"holes": [5]}))
    patches = ls.approximate(surface, kind)
    assert np.isnan(patches.evaluate(5, 0.5, 0.5)).all()
    found = patches.error(surface)
    assert np.flatnonzero(np.isnan(found.parametric)).tolist() == [5]
