"""Contours of channels whose topology is not that of the points, against their values."""

import numpy as np
import pytest
import zoo
import zoo_triangles
from test_query_sections import curves, farthest, made, some

import limitsurf as ls


def with_seams(points_and_faces, cut, columns=2, seed=0, scheme=None, **tags):
    """A channel of random values that some faces (a mask) have of their own."""
    points, faces = points_and_faces
    rng = np.random.default_rng(seed)
    n = len(points)
    values = rng.normal(size=(2 * n, columns))
    values[n:] = values[:n] + 0.5 * rng.normal(size=(n, columns))
    flat = np.concatenate([np.asarray(f) + n * (k in cut) for k, f in enumerate(faces)])
    used, index = np.unique(flat, return_inverse=True)
    channels = {"uv": (values[used], index, "corners_plus1")}
    mesh = ls.Mesh(np.asarray(points, float), faces, channels=channels, scheme=scheme, **tags)
    return ls.LimitSurface(mesh, engine="reference")


SURFACES = {
    "cube": lambda: with_seams(zoo.cube(), {0, 1}),
    "creased": lambda: with_seams(zoo.cube(), {2}, creases={(0, 1): np.inf, (1, 3): 1.5}),
    "ngons": lambda: with_seams(zoo.prism(7), {0, 3}),
    "wide": lambda: with_seams(zoo.bipyramid(9), {0, 1, 2}),
    "loop": lambda: with_seams(zoo_triangles.icosahedron(), {0, 1, 7}, scheme="loop"),
}


@pytest.mark.parametrize("name", SURFACES)
def test_contours_have_the_value_and_end_at_seams(name):
    surface = SURFACES[name]()
    size = np.ptp(surface.points, axis=0).max()
    own = surface.of_channel("uv")
    for column in (0, 1):
        values = np.quantile(own.points[:, column], [0.4, 0.6])
        found = ls.contour(surface, ("uv", column), values)
        value = np.repeat(found.value, np.diff(found.offsets))
        there = own.evaluate(found.face, found.u, found.v)[:, column]
        assert len(found) > 0
        assert np.abs(there - value).max() < 1e-12
        assert (found.point == surface.evaluate(found.face, found.u, found.v)).all()
        finer = ls.contour(surface, ("uv", column), values, tolerance=2e-5 * size)
        assert finer.closed.tolist() == found.closed.tolist()
        assert farthest(some(finer.point), found) <= 1e-4 * size
        # those that are open end on seams: on sides of limit faces, or at saddles
        for p, k in zip(curves(found), range(len(found)), strict=True):
            if not found.closed[k]:
                for end in (found.offsets[k], found.offsets[k + 1] - 1):
                    u, v = found.u[end], found.v[end]
                    assert min(abs(u), abs(1 - u), abs(v), abs(1 - v), abs(1 - u - v)) < 1e-12
            assert len(p) > 1


@pytest.mark.parametrize("name", ["cube", "loop"])
def test_signs_at_random_places_change_where_contours_are(name):
    surface = SURFACES[name]()
    own = surface.of_channel("uv")
    level = float(np.median(own.points[:, 0]))
    found = ls.contour(surface, ("uv", 0), level, tolerance=1e-5)
    # along lines u = const. of each face each change of sign is crossed by one polyline
    faces = np.arange(len(surface.limit_faces))
    v = np.linspace(0, 0.7, 257)
    grid = own.evaluate(faces[:, None], 0.2871, v)[..., 0] > level
    changes = (grid[:, 1:] != grid[:, :-1]).sum()
    crossings = 0
    runs = np.split(np.arange(len(found.u)), found.offsets[1:-1])
    for p, closed in zip(runs, found.closed, strict=True):
        q = np.append(p, p[:1]) if closed else p
        same = found.face[q[1:]] == found.face[q[:-1]]
        a, b = q[:-1][same], q[1:][same]
        crossed = (found.u[a] < 0.2871) != (found.u[b] < 0.2871)
        at = found.v[a] + (0.2871 - found.u[a]) / np.where(crossed, found.u[b] - found.u[a], 1) * (
            found.v[b] - found.v[a]
        )
        crossings += int((crossed & (at < 0.7)).sum())
    assert crossings == changes


def test_a_channel_of_the_points_has_their_contours():
    points, faces = zoo.cube()
    flat = np.concatenate(faces)
    mesh = ls.Mesh(np.asarray(points, float), faces, channels={"at": (points, flat, "all")})
    surface = ls.LimitSurface(mesh, engine="reference", boundary="edge_only")
    one, two = ls.contour(surface, ("at", 2), [0.4, 0.6]), ls.contour(surface, "z", [0.4, 0.6])
    assert one.closed.tolist() == two.closed.tolist()


def test_what_is_no_column_is_refused():
    surface = SURFACES["cube"]()
    with pytest.raises(ValueError, match="has 2 columns, got column 2"):
        ls.contour(surface, ("uv", 2), 0.0)
    with pytest.raises(ValueError, match="no channel 'st'"):
        ls.contour(surface, ("st", 0), 0.0)
    with pytest.raises(TypeError):
        ls.contour(surface, ("uv", 0.5), 0.0)
    assert len(ls.contour(made(zoo.cube()), "z", [])) == 0
