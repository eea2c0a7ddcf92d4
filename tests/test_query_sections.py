"""Plane sections and contours, against conics, polygons, volumes and fine tessellations."""

import numpy as np
import pytest
import zoo
import zoo_triangles
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

import limitsurf as ls

UP = np.array([0.0, 0.0, 1.0])


def made(points_and_faces, **options):
    points, faces = points_and_faces
    tags = {name: options.pop(name) for name in ("creases", "corners", "holes") if name in options}
    mesh = ls.Mesh(np.asarray(points, dtype=float), faces, **tags)
    return ls.LimitSurface(mesh, engine="reference", **options)


def quadric(a, b, c, shift=(0.0, 0.0), n=6):
    """The graph z = a x^2 + b y^2 + c x y itself, by its bicubic control points."""
    i, j = np.meshgrid(np.arange(n + 1) - n // 2, np.arange(n + 1) - n // 2, indexing="ij")
    x, y = i + shift[0], j + shift[1]
    z = a * (x * x - 1 / 3) + b * (y * y - 1 / 3) + c * x * y
    k = np.arange(n)
    first = ((n + 1) * k[:, None] + k).ravel()
    faces = np.stack([first, first + n + 1, first + n + 2, first + 1], axis=1)
    # (of its outermost faces alone the spline is another one)
    return made((np.stack([x, y, z], axis=-1).reshape(-1, 3), faces), boundary="none")


def curves(found):
    """The points of each curve."""
    return np.split(found.point, found.offsets[1:-1])


def pieces(found):
    """Both ends of all pieces of polylines, (n, 3) each."""
    ends = [
        (p, np.roll(p, -1, axis=0)) if closed else (p[:-1], p[1:])
        for p, closed in zip(curves(found), found.closed, strict=True)
    ]
    return tuple(np.concatenate(x) for x in zip(*ends, strict=True))


def farthest(points, found):
    """The largest distance of points from polylines."""
    a, b = pieces(found)
    d = b - a
    along = ((points[:, None] - a) * d).sum(axis=2) / np.maximum((d * d).sum(axis=1), 1e-300)
    at = a + np.clip(along, 0, 1)[..., None] * d
    return np.sqrt(((at - points[:, None]) ** 2).sum(axis=2)).min(axis=1).max()


def some(points, n=100):
    """Not many of them."""
    return points[:: 1 + len(points) // n]


def area(found, normal):
    """What curves enclose, counter-clockwise about a unit normal."""
    a, b = pieces(found)
    return float(np.cross(a, b).sum(axis=0) @ normal) / 2


CONICS = {
    "circle": ((1, 1, 0), (0, 0), 2.5, [True]),
    "ellipse": ((2, 1, 0.5), (0.31, 0.17), 1.7, [True]),
    "loop_inside_a_face": ((1, 2, 0.5), (0.3, 0.41), 1e-3, [True]),
    "tiny_loop": ((1, 2, 0.5), (0.3, 0.41), 1e-10, [True]),
    "nothing": ((1, 1, 0), (0.3, 0.41), -1e-9, []),
    "touches": ((1, 1, 0), (0, 0), 0.0, []),
    "touches_along_a_line": ((-1, 0, 0), (0.3, 0.0), 0.0, []),
    "hyperbola": ((1, -1, 0.3), (0.3, 0.41), 1e-9, [False] * 2),
    "saddle_at_a_vertex": ((1, -1, 0), (0, 0), 0.0, [False] * 4),
    "saddle_in_a_face": ((1, -1, 0.3), (0.3, 0.41), 0.0, [False] * 4),
    "line_twice": ((1, 0, 0), (0, 0), 0.25, [False] * 2),
}


@pytest.mark.parametrize("name", CONICS)
def test_sections_of_quadrics_are_conics(name):
    (a, b, c), shift, height, closed = CONICS[name]
    surface = quadric(a, b, c, shift, 4 if name == "touches_along_a_line" else 6)
    tolerance = 1e-4 * np.sqrt(height) if all(closed) and height > 0 else 1e-5
    found = ls.section(surface, [7, -5, height], 3 * UP, tolerance=tolerance)
    assert found.closed.tolist() == closed
    if not closed:
        return
    size = np.abs(surface.points).max()
    x, y, z = found.point.T
    assert np.abs(z - height).max() <= 1e-13 * size
    assert np.abs(a * x * x + b * y * y + c * x * y - height).max() <= 1e-13 * size
    # middles of pieces: how far the conic is, by its slope
    p, q = pieces(found)
    x, y, _ = ((p + q) / 2).T
    slope = np.hypot(2 * a * x + c * y, 2 * b * y + c * x)
    off = np.abs(a * x * x + b * y * y + c * x * y - height)
    assert (np.minimum(off / np.maximum(slope, 1e-300), np.sqrt(off)) <= 1.01 * tolerance).all()
    if name.startswith("saddle"):
        # all four begin or end in the same place, the saddle
        ends = np.concatenate([p[[0, -1]] for p in curves(found)])
        at = np.abs(ends).max(axis=1) < 1e-6
        assert at.sum() == 4
        assert np.ptp(ends[at], axis=0).max() == 0
    if height > 0 and all(closed):  # inside is below: on the right, so they go clockwise about z
        inside = 2 * np.pi * height / np.sqrt(4 * a * b - c * c)
        assert -area(found, UP) == pytest.approx(inside, rel=1e-3)


SURFACES = {
    "cube": lambda: made(zoo.cube()),
    "semi": lambda: made(zoo.cube(), creases={(0, 1): 1.5, (1, 3): 0.7}),
    "dart": lambda: made(zoo.cube(), creases={(0, 1): np.inf}, corners={6: 2.5}),
    "ngons": lambda: made(zoo.prism(7)),
    "wide": lambda: made(zoo.bipyramid(24)),
    "open": lambda: made(zoo.grid(3, 3)),
    "loop": lambda: made(zoo_triangles.icosahedron(), scheme="loop"),
    "loop_open": lambda: made(zoo_triangles.ZOO["grid_3x2"](), scheme="loop"),
    **{
        f"{name}_prism": lambda name=name: made(zoo.prism(5), scheme=name)
        for name in ls.schemes.with_pieces
        if not ls.schemes[name].lattice.sloped
    },
    "linear": lambda: made(zoo_triangles.icosahedron(), scheme="linear"),
}


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.parametrize("through", ["anywhere", "vertex", "middle"])
def test_curves_are_on_the_surface_and_in_the_plane(name, through):
    surface = SURFACES[name]()
    rng = np.random.default_rng(len(name))
    middle, size = surface.points.mean(axis=0), np.ptp(surface.points, axis=0).max()
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    origin = middle + 0.05 * rng.normal(size=3)
    if through == "vertex":
        origin = surface.evaluate(1, 0.0, 0.0)
    if through == "middle":  # which many are symmetric about
        origin, normal = (surface.points.max(axis=0) + surface.points.min(axis=0)) / 2, np.eye(3)[1]
    found = ls.section(surface, origin, normal)
    assert len(found) > 0
    assert (found.point == surface.evaluate(found.face, found.u, found.v)).all()
    most = np.abs(surface.points).max()
    assert np.abs((found.point - origin) @ normal).max() <= 1e-13 * most
    if through == "vertex":
        again = ls.section(surface, origin, normal, workers=2)
        assert (again.point == found.point).all()
    mesh = surface.mesh
    if not mesh.boundary_edge.any():
        assert found.closed.all()
    finer = ls.section(surface, origin, normal, tolerance=2e-5 * size)
    assert finer.closed.tolist() == found.closed.tolist()
    assert farthest(some(finer.point), found) <= 1e-4 * size
    assert farthest(some(found.point), finer) <= 2e-5 * size + 1e-13
    if through == "anywhere":
        # with few points in between, this cuts no more and no fewer curves
        assert len(found) == loops_of_triangles(surface, origin, normal)
        back = ls.section(surface, origin, -normal)
        assert len(back) == len(found)


def loops_of_triangles(surface, origin, normal):
    """The number of curves that a plane cuts of a fine tessellation."""
    fine = ls.tessellate(surface, 16, normals=False)
    corners = fine.indices[fine.triangles]
    above = (fine.points - origin) @ normal > 0
    cut = corners[above[corners].any(axis=1) & ~above[corners].all(axis=1)]
    sides = np.sort(np.stack([cut, np.roll(cut, -1, axis=1)], axis=2), axis=2)
    crossed = above[sides[..., 0]] != above[sides[..., 1]]
    key = (sides[..., 0] * len(fine.points) + sides[..., 1])[crossed]
    number = np.unique(key, return_inverse=True)[1].reshape(-1, 2)
    n = number.max() + 1
    graph = coo_array((np.ones(len(number)), number.T), shape=(n, n))
    return connected_components(graph, directed=False)[0]


@pytest.mark.parametrize("name", ["cube", "dart", "loop", "doo-sabin_prism"])
def test_areas_of_sections_add_up_to_the_volume(name):
    surface = SURFACES[name]()
    box = ls.bounds(surface, tolerance=1e-9)
    low, high = box.lower[:, 2].min(), box.upper[:, 2].max()
    x, w = np.polynomial.legendre.leggauss(16)
    heights = low + (high - low) * (1 + x) / 2
    found = ls.contour(surface, "z", heights, tolerance=1e-5)
    assert (np.unique(found.value) == heights).all()
    a, b = pieces(found)
    value = np.repeat(found.value, np.diff(found.offsets))
    at = np.searchsorted(heights, value)
    areas = np.bincount(at, np.cross(a, b) @ UP / 2)
    total = (high - low) / 2 * w @ areas
    volumes = []
    for n in (8, 16):
        fine = ls.tessellate(surface, n, normals=False)
        p, q, r = np.moveaxis(fine.points[fine.indices[fine.triangles]], 1, 0)
        volumes.append((p * np.cross(q, r)).sum() / 6)
    # (the error of a tessellation falls by 4; creases bend areas of sections)
    assert total == pytest.approx((4 * volumes[1] - volumes[0]) / 3, rel=1e-3)


def test_planes_through_faces_and_edges():
    box = made(zoo.cube(), scheme="bilinear")
    square = ls.section(box, [0, 0, 0.5], UP)
    assert square.closed.tolist() == [True]
    corners = {(x, y) for x in (0.0, 1.0) for y in (0.0, 1.0)}
    assert corners == set(map(tuple, square.point[:, :2]))
    assert area(square, UP) == 1
    # the border of what is below: of a face in the plane where the surface goes down, or nothing
    top = ls.section(box, [0, 0, 1], UP)
    assert top.closed.tolist() == [True]
    assert area(top, UP) == 1
    assert len(ls.section(box, [0, 0, 0], UP)) == 0
    assert len(ls.section(box, [0, 0, 1 + 1e-9], UP)) == 0
    diagonal = ls.section(box, [0, 0, 0], [1, -1, 0])
    assert diagonal.closed.tolist() == [True]
    assert abs(area(diagonal, np.array([1, -1, 0]) / np.sqrt(2))) == pytest.approx(np.sqrt(2))
    # a flat face of a smooth surface, with smooth and with sharp sides
    i, j = np.meshgrid(np.arange(8), np.arange(8), indexing="ij")
    height = -np.maximum(np.abs(i - 3.5), np.abs(j - 3.5)).clip(2.5) + 2.5
    points = np.stack([i, j, height], axis=-1).reshape(-1, 3)
    first = (8 * np.arange(7)[:, None] + np.arange(7)).ravel()
    faces = np.stack([first, first + 8, first + 9, first + 1], axis=1)
    table = made((points, faces))
    rim = ls.section(table, [0, 0, 0], UP)
    assert rim.closed.tolist() == [True]
    assert area(rim, UP) == pytest.approx(9, abs=1e-3)
    assert np.abs(np.abs(rim.point[:, :2] - 3.5).max(axis=1) - 1.5).max() < 1e-4


def test_creases_are_crossed_with_a_kink():
    quads = zoo.cube()
    rim = {tuple(sorted((f[k], f[(k + 1) % 4]))): np.inf for f in quads[1][:2] for k in range(4)}
    can = made(quads, creases=rim)
    found = ls.section(can, [0.5, 0.5, 0.5], [1, 0, 0])
    assert found.closed.tolist() == [True]
    flat = np.abs(found.point[:, 2] - 0.5) == 0.5
    step = np.diff(found.point, axis=0, append=found.point[:1])
    step = step[np.abs(step).max(axis=1) > 0]
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    turn = (step * np.roll(step, 1, axis=0)).sum(axis=1)
    assert (np.sort(turn)[:4] < 0.5).all()
    assert np.sort(turn)[4] > 0.9
    assert flat.sum() >= 4


def test_sections_through_poles_have_them_as_points():
    for valence in (3, 5, 8, 24):
        surface = made(zoo.bipyramid(valence), boundary="none")
        pole = int(np.flatnonzero(surface.mesh.vertex_faces == valence)[-1])
        corner = np.flatnonzero(surface.mesh.indices == pole)[0]
        face = surface.limit_faces.first[surface.mesh.corner_face[corner]] + corner % 3
        at = surface.evaluate(face, 0.0, 0.0)
        found = ls.section(surface, at, [0.3, 1, 0.2])
        assert found.closed.all()
        assert np.abs(found.point - at).max(axis=1).min() <= 1e-13


def test_contours():
    surface = made(zoo.prism(5))
    direction = np.array([1.0, 2.0, -0.5])
    same = ls.contour(surface, direction, 0.3, origin=[0.1, 0.2, 0.3])
    point = np.array([0.1, 0.2, 0.3]) + 0.3 * direction / (direction @ direction)
    found = ls.section(surface, point, direction)
    assert len(same) == len(found) > 0
    assert np.abs((same.point - [0.1, 0.2, 0.3]) @ direction - 0.3).max() < 1e-13
    center = np.array([0.2, 0.1, 0.4])
    balls = ls.contour(surface, "distance", [0.5, -1.0, np.nan, 0.6, 0.0], origin=center)
    assert set(balls.value) == {0.5, 0.6}
    value = np.repeat(balls.value, np.diff(balls.offsets))
    assert np.abs(np.linalg.norm(balls.point - center, axis=1) - value).max() < 1e-13
    heat = np.random.default_rng(3).normal(size=surface.mesh.n_vertices)
    lines = ls.contour(surface, heat, [-0.2, 0.1])
    limit = surface.with_points(np.stack([heat] * 3, axis=1))
    value = np.repeat(lines.value, np.diff(lines.offsets))
    assert len(lines) > 0
    assert lines.closed.all()
    off = limit.evaluate(lines.face, lines.u, lines.v)[:, 0] - value
    assert np.abs(off).max() < 1e-13 * np.abs(heat).max()


@pytest.mark.parametrize("power", [-660, 0, 660])
def test_size_and_place_do_not_matter(power):
    points, faces = zoo.cube()
    scaled = made((np.ldexp(points - 0.5, power), faces))
    found = ls.section(scaled, np.zeros(3), [0, np.ldexp(1.0, power), 0])
    same = ls.section(made((points - 0.5, faces)), np.zeros(3), [0, 1, 0])
    assert (np.ldexp(same.point, power) == found.point).all()
    assert len(ls.section(scaled, [0, 1e300, 0], [0, 1, 0])) == 0


def test_what_is_no_plane_or_no_tolerance_is_refused():
    surface = made(zoo.cube())
    for bad, what in (
        (([0, 0], UP), "origin must be three numbers"),
        (([0, 0, np.nan], UP), "origin must be finite"),
        (([0, 0, 0], [0, 0, 0]), "normal must not be of length 0"),
        (([0, 0, 0], [0, np.inf, 0]), "normal must be finite"),
    ):
        with pytest.raises(ValueError, match=what):
            ls.section(surface, *bad)
    with pytest.raises(ValueError, match="above 0"):
        ls.section(surface, [0, 0, 0], UP, tolerance=0)
    with pytest.raises(TypeError, match="must be a number"):
        ls.section(surface, [0, 0, 0], UP, tolerance="1")
    with pytest.raises(ValueError, match="scalar must be"):
        ls.contour(surface, "height", 0.5)
    with pytest.raises(ValueError, match="values of vertices"):
        ls.contour(surface, np.zeros(7), 0.5)
    with pytest.raises(ValueError, match="that of vertex 2 is not"):
        ls.contour(surface, [0, 0, np.nan, 0, 0, 0, 0, 0], 0.5)
    with pytest.raises(MemoryError, match="larger tolerance"):
        ls.section(surface, [0.5, 0.5, 0.5], UP, tolerance=1e-30)


def test_nothing_to_cut():
    hole = made(zoo.grid(1, 1), holes=[0])
    assert len(ls.section(hole, [0, 0, 0], UP)) == 0
    point = made((np.zeros((8, 3)), zoo.cube()[1]))
    assert len(ls.section(point, [0, 0, 0], UP)) == 0
    assert len(ls.contour(made(zoo.cube()), "z", [])) == 0
