"""Silhouettes and isophotes, against conics, polyhedra, rays and normals."""

import numpy as np
import pytest
import zoo
import zoo_triangles
from command_line import facts, fail
from test_query_sections import UP, curves, farthest, made, quadric, some

import limitsurf as ls

A, B, C = 1.0, 2.0, 0.5


def gradient(x, y):
    return 2 * A * x + C * y, 2 * B * y + C * x


def test_silhouettes_of_a_paraboloid_from_afar_are_parabolas():
    # the plane gradient . (wx, wy) = wz cuts it there
    surface = quadric(A, B, C, (0.3, 0.41))
    for view in ([1.0, 0.3, 0.2], [0.0, -7.0, 1.0], [1.0, 0.0, 0.0]):
        found = ls.silhouette(surface, view)
        x, y, _ = found.point.T
        fx, fy = gradient(x, y)
        assert found.closed.tolist() == [False]
        assert np.abs(view[2] - fx * view[0] - fy * view[1]).max() < 1e-13 * np.abs(view).max()
        # it begins and ends on the boundary
        ends = found.point[[0, -1], :2] - [0.3, 0.41]
        assert np.abs(ends).max(axis=1) == pytest.approx(2, abs=1e-12)
        # what faces the viewer is on the left of it
        step = np.diff(found.point[:, :2], axis=0)
        left = np.stack([-step[:, 1], step[:, 0]], axis=1)
        rises = -np.array([2 * A * view[0] + C * view[1], 2 * B * view[1] + C * view[0]])
        assert (left @ rises > 0).all()


@pytest.mark.parametrize("height", [-2.0, -1e-3])
def test_silhouettes_of_a_paraboloid_from_an_eye_below_are_ellipses(height):
    # x is seen edgewise where the polar form of x and the eye vanishes
    surface = quadric(A, B, C, (0.3, 0.41))
    eye = np.array([0.35, 0.4, height])
    found = ls.silhouette(surface, eye, perspective=True, tolerance=1e-6)
    assert found.closed.tolist() == [True]
    x, y, z = found.point.T
    # z + height = x f_x(eye) + y f_y(eye)
    ex, ey = gradient(eye[0], eye[1])
    assert np.abs(z + eye[2] - x * ex - y * ey).max() < 1e-12
    # seen from above it is the ellipse f(x - eye) = f(eye) - height
    level = A * eye[0] ** 2 + B * eye[1] ** 2 + C * eye[0] * eye[1] - height
    p, q = found.point[:, :2], np.roll(found.point[:, :2], -1, axis=0)
    area = np.abs((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum() / 2)
    assert area == pytest.approx(2 * np.pi * level / np.sqrt(4 * A * B - C * C), rel=1e-3)
    # the eye inside of a convex body sees all from behind
    assert len(ls.silhouette(surface, [0.3, 0.4, 3.0], perspective=True)) == 0


@pytest.mark.parametrize("angle", [0.02, 5.0, 60.0])
def test_isophotes_of_a_paraboloid_under_light_from_above_are_ellipses(angle):
    # |gradient| = tan(angle)
    surface = quadric(A, B, C, (0.3, 0.41))
    found = ls.isophote(surface, [0, 0, 5.0], angle, tolerance=1e-5 * np.radians(angle))
    x, y, _ = found.point.T
    slope = np.hypot(*gradient(x, y))
    assert found.closed.tolist() == [True]
    assert (found.value == angle).all()
    assert np.abs(slope / np.tan(np.radians(angle)) - 1).max() < 1e-7
    p, q = found.point[:, :2], np.roll(found.point[:, :2], -1, axis=0)
    area = (p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum() / 2  # the lighter inside is on the left
    expected = np.pi * np.tan(np.radians(angle)) ** 2 / (4 * A * B - C * C)
    assert area == pytest.approx(expected, rel=2e-3)
    same = ls.isophote(surface, [0, 0, -1.0], 180 - angle, tolerance=1e-5 * np.radians(angle))
    assert same.closed.tolist() == [True]
    q = same.point[:, :2]
    assert ((q[:, 0] * np.roll(q[:, 1], -1) - q[:, 1] * np.roll(q[:, 0], -1)).sum()) < 0
    assert len(ls.isophote(surface, [0, 0, -1.0], angle)) == 0


def test_tilted_isophotes_have_the_angle():
    surface = quadric(A, -B, C, (0.3, 0.41))
    light = np.array([0.3, -0.5, 1.0])
    for angle in (20.0, 70.0, 90.0, 100.0):
        found = ls.isophote(surface, light, angle)
        x, y, _ = found.point.T
        normal = np.stack([-2 * A * x - C * y, 2 * B * y - C * x, np.ones_like(x)], axis=1)
        cosine = normal @ light / np.linalg.norm(light) / np.linalg.norm(normal, axis=1)
        assert len(found) > 0
        assert np.abs(np.degrees(np.arccos(cosine)) - angle).max() < 1e-10


def creased_can():
    quads = zoo.cube()
    rim = {tuple(sorted((f[k], f[(k + 1) % 4]))): np.inf for f in quads[1][:2] for k in range(4)}
    return made(quads, creases=rim)


CLOSED = {
    "cube": lambda: made(zoo.cube()),
    "can": creased_can,
    "two_darts": lambda: made(zoo.cube(), creases={(0, 1): np.inf}, corners={6: 2.5}),
    "semi": lambda: made(zoo.cube(), creases={(0, 1): 1.5, (1, 3): 0.7}),
    "ngons": lambda: made(zoo.prism(7)),
    "wide": lambda: made(zoo.bipyramid(24)),
    "loop": lambda: made(zoo_triangles.icosahedron(), scheme="loop"),
    "warren": lambda: made(zoo_triangles.icosahedron(), scheme="loop-warren"),
    "doo-sabin": lambda: made(zoo.prism(5), scheme="doo-sabin"),
}


@pytest.mark.parametrize("name", CLOSED)
def test_silhouettes_of_convex_bodies_part_rays_that_hit_from_those_that_miss(name):
    surface = CLOSED[name]()
    rng = np.random.default_rng(len(name))
    view = rng.normal(size=3)
    view /= np.linalg.norm(view)
    size = np.ptp(surface.points, axis=0).max()
    found = ls.silhouette(surface, view)
    assert found.closed.tolist() == [True]
    assert (found.point == surface.evaluate(found.face, found.u, found.v)).all()
    # in the picture it goes round once, and bodies that are convex end there
    axes = np.linalg.svd(view[None])[2][1:]
    flat = found.point @ axes.T
    middle = flat.mean(axis=0)
    which = some(np.arange(len(flat)), 40)
    for factor, expected in ((1 - 1e-3, True), (1 + 1e-3, False)):
        start = (middle + factor * (flat[which] - middle)) @ axes + 10 * size * view
        assert (ls.intersect(surface, start, -view).hit == expected).all()
    normal = surface.normal(found.face, found.u, found.v)
    off = np.abs(normal @ view)
    if name not in ("can", "two_darts"):
        assert off.max() < 1e-12
    else:  # but on sharp edges
        sharp = off > 1e-12
        u, v = found.u[sharp], found.v[sharp]
        assert ((u == 0) | (u == 1) | (v == 0) | (v == 1)).all()
    finer = ls.silhouette(surface, view, tolerance=2e-5 * size, workers=2)
    assert farthest(some(finer.point), found) <= 1e-4 * size
    assert farthest(some(found.point), finer) <= 2e-5 * size + 1e-13
    back = ls.silhouette(surface, -view)
    assert back.closed.tolist() == [True]


def test_silhouettes_of_polyhedra_are_edges():
    box = made(zoo.cube(), scheme="bilinear")
    found = ls.silhouette(box, [1.0, 2.0, 3.0])
    assert found.closed.tolist() == [True]
    # the hexagon of all corners but the nearest and the farthest
    assert {tuple(x) for x in found.point} == {
        (float(x), float(y), float(z)) for x in (0, 1) for y in (0, 1) for z in (0, 1)
    } - {(0.0, 0.0, 0.0), (1.0, 1.0, 1.0)}
    near = ls.silhouette(box, [0.5, 0.5, 3.0], perspective=True)  # who sees one face alone
    assert near.closed.tolist() == [True]
    assert (near.point[:, 2] == 1).all()
    points, faces = zoo_triangles.icosahedron()
    solid = made((points, faces), scheme="linear")
    view = np.array([0.3, -0.2, 1.0])
    found = ls.silhouette(solid, view)
    corners = np.asarray(points, dtype=float)[np.asarray(faces)]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) @ view
    step = np.roll(found.point, -1, axis=0)
    seen = np.cross(found.point, step).sum(axis=0) @ view
    assert found.closed.tolist() == [True]
    assert abs(seen) == pytest.approx(area[area > 0].sum())


@pytest.mark.parametrize("reversed_", [False, True])
def test_edges_of_polyhedra_by_the_signs_of_their_faces(reversed_):
    points, faces = zoo.prism(5)  # pentagons beside quads
    points, faces = np.asarray(points, dtype=float), [list(f) for f in faces]
    if reversed_:  # a side that goes round the other way: nothing else is seen
        faces[2] = faces[2][::-1]
    solid = made((points, faces), scheme="bilinear")
    rng = np.random.default_rng(4)
    middle = points.mean(axis=0)
    for view in rng.normal(size=(5, 3)):
        front = {}
        for f in faces:
            area = sum(
                np.cross(points[a], points[b]) for a, b in zip(f, f[1:] + f[:1], strict=True)
            )
            out = np.sign(area @ (points[f].mean(axis=0) - middle))
            for a, b in zip(f, f[1:] + f[:1], strict=True):
                front.setdefault(frozenset((a, b)), []).append(out * (area @ view) > 0)
        edges = [sorted(e) for e, (one, two) in front.items() if one != two]
        length = sum(np.linalg.norm(points[a] - points[b]) for a, b in edges)
        found = ls.silhouette(solid, view)
        assert found.closed.tolist() == [True]
        step = np.roll(found.point, -1, axis=0) - found.point
        assert np.linalg.norm(step, axis=1).sum() == pytest.approx(length, abs=1e-12)
        ends = points[np.array(edges)]
        d = ends[:, 1] - ends[:, 0]
        along = ((found.point[:, None] - ends[:, 0]) * d).sum(axis=2) / (d * d).sum(axis=1)
        off = ends[:, 0] + np.clip(along, 0, 1)[..., None] * d - found.point[:, None]
        assert np.linalg.norm(off, axis=2).min(axis=1).max() < 1e-12


def test_along_creases_one_side_is_seen_and_the_other_is_not():
    can = creased_can()
    found = ls.silhouette(can, [1.0, 0.3, 0.7])
    normal = can.normal(found.face, found.u, found.v)
    on = np.abs(normal @ [1.0, 0.3, 0.7]) > 1e-9
    assert 0.2 < on.mean() < 0.95
    near = ls.closest_point(can, found.point[on] + 1e-5 * np.array([1.0, 0.3, 0.7]))
    far = ls.closest_point(can, found.point[on] - 1e-5 * np.array([1.0, 0.3, 0.7]))
    assert near.distance.max() < 1e-5
    assert far.distance.max() < 1e-5
    # isophotes of a box with sharp edges: each face is light or dark, the border is edges
    box = made(zoo.cube(), scheme="bilinear")
    light = ls.isophote(box, [1.0, 2.0, 4.0], 40.0)  # the top alone is that light
    assert light.closed.tolist() == [True]
    assert (light.point[:, 2] == 1).all()
    assert len(light.face) == 4


def test_poles_are_on_curves_that_go_through_them():
    for valence in (3, 5):
        surface = made(zoo.bipyramid(valence), boundary="none")
        pole = int(np.flatnonzero(surface.mesh.vertex_faces == valence)[-1])
        corner = np.flatnonzero(surface.mesh.indices == pole)[0]
        face = surface.limit_faces.first[surface.mesh.corner_face[corner]] + corner % 3
        at, normal = surface.evaluate(face, 0.0, 0.0), surface.normal(face, 0.0, 0.0)
        found = ls.silhouette(surface, np.cross(normal, [0.3, 0.4, 0.5]))
        assert np.abs(found.point - at).max(axis=1).min() <= 1e-13
        assert found.closed.all()
        # beside it they go on as smooth curves
        tilted = ls.silhouette(surface, np.cross(normal, [0.3, 0.4, 0.5]) + 1e-9 * normal)
        assert tilted.closed.all()
        assert np.abs(tilted.point - at).max(axis=1).min() <= 1e-4


def test_random_creases_tear_no_curve():
    points, faces = zoo.cube()
    rng = np.random.default_rng(2)
    mesh = ls.Mesh(np.asarray(points, dtype=float), faces)
    for turn in range(3):
        creases = {tuple(e): np.inf for e in mesh.edges.tolist() if rng.random() < 0.4}
        shaken = np.asarray(points) + 0.05 * rng.normal(size=(8, 3))
        surface = made((shaken, faces), creases=creases)
        view = rng.normal(size=3)
        found = ls.isophote(surface, view, 60.0) if turn == 0 else ls.silhouette(surface, view)
        ends = [p[[0, -1]] for p, end in zip(curves(found), found.closed, strict=True) if not end]
        if ends:
            _, count = np.unique(np.concatenate(ends), axis=0, return_counts=True)
            assert (count % 2 == 0).all()


@pytest.mark.parametrize("power", [-660, 0, 660])
def test_size_does_not_matter(power):
    points, faces = zoo.cube()
    scaled = made((np.ldexp(points - 0.5, power), faces))
    found = ls.silhouette(scaled, [0, np.ldexp(1.0, power), 0.1 * np.ldexp(1.0, power)])
    same = ls.silhouette(made((points - 0.5, faces)), [0, 1, 0.1])
    assert (np.ldexp(same.point, power) == found.point).all()


def test_flat_pieces_and_nothing():
    points, faces = zoo.grid(3, 3)
    flat = made((np.asarray(points) * [1, 1, 0], faces))
    assert len(ls.silhouette(flat, UP)) == 0
    assert len(ls.isophote(flat, UP, 30)) == 0
    point = made((np.zeros((8, 3)), zoo.cube()[1]))
    assert len(ls.silhouette(point, UP)) == 0
    hole = made(zoo.grid(1, 1), holes=[0])
    assert len(ls.silhouette(hole, UP)) == 0


def test_what_is_no_view_or_angle_is_refused():
    surface = made(zoo.cube())
    with pytest.raises(ValueError, match="view must be three numbers"):
        ls.silhouette(surface, [0, 1])
    with pytest.raises(ValueError, match="view must not be of length 0"):
        ls.silhouette(surface, [0, 0, 0])
    with pytest.raises(ValueError, match="view must be finite"):
        ls.silhouette(surface, [0, 0, np.nan])
    with pytest.raises(ValueError, match="light must not be of length 0"):
        ls.isophote(surface, [0, 0, 0], 30)
    for angle in (0, 180, -5, np.nan):
        with pytest.raises(ValueError, match="angle must be between 0 and 180"):
            ls.isophote(surface, UP, angle)
    with pytest.raises(ValueError, match="above 0"):
        ls.silhouette(surface, UP, tolerance=0)


def test_isophotes_need_one_side_that_is_up():
    points, faces = zoo.grid(2, 2)[:2]
    faces = [faces[0], *(face[::-1] for face in faces[1:])]
    surface = made((points, faces))
    with pytest.raises(ValueError, match=r"an angle other than 90 needs .* of vertices 1 and 4"):
        ls.isophote(surface, UP, 30)
    ls.isophote(surface, UP, 90)


def test_the_command_writes_silhouettes(tmp_path):
    points, faces = zoo.cube()
    cage, target = tmp_path / "cage.obj", tmp_path / "a.csv"
    ls.write(cage, ls.Mesh(np.asarray(points, dtype=float), faces))
    for option, perspective in (("--view", False), ("--eye", True)):
        found = ls.silhouette(ls.LimitSurface(ls.read(cage)), [3, 4, 5], perspective=perspective)
        known = facts("section", cage, option, 3, 4, 5, "-o", target)
        assert (known["points"], known["closed"]) == (len(found.face), 1)
        table = np.loadtxt(target, delimiter=",", skiprows=1)
        assert (table[:, 2:5] == found.point).all()
    assert "one of" in fail("section", cage, "--view", 1, 0, 0, "--eye", 1, 0, 0, "-o", target)
