"""Offsets against planes, cylinders and spheres, refined normals, and Steiner's formula."""

import numpy as np
import pytest
import zoo
from command_line import facts, fail

import limitsurf as ls

# schemes whose limit faces are of polynomial pieces: others have no spline faces
WITH_PIECES = [*ls.schemes.with_pieces]


def surface_of(made, **options):
    points, faces = made
    return ls.LimitSurface(ls.Mesh(points, faces, **options))


def height(z, n=5):
    """A cage of the grid whose limit is a graph of the quadratic z + its own constant."""
    points = [[x, y, z(x, y)] for x in range(n) for y in range(n)]
    faces = [[n * i + j, n * i + n + j, n * i + n + j + 1, n * i + j + 1]
             for i in range(n - 1) for j in range(n - 1)]  # fmt: skip
    return ls.LimitSurface(ls.Mesh(points, faces))


def places(surface, n=40, seed=1):
    rng = np.random.default_rng(seed)
    face = rng.choice(np.flatnonzero(surface.patches.with_limit), n)
    u, v = rng.random((2, n))
    if surface.topology.lattice.sloped:
        v = v * (1 - u)
    return face, u, v


@pytest.mark.parametrize("distance", [0.3, -0.2, 1e6])
def test_parabola_by_hand(distance):
    """z = x^2 / 2 on inner faces: normal, tangent and curvature typed from calculus."""
    surface = height(lambda x, y: x * x / 2)
    off = ls.offset(surface, distance)
    u, v = np.random.default_rng(0).random((2, 20))
    x, y = 1 + u, 1 + v
    w = np.sqrt(1 + x * x)
    p = np.stack([x, y, x * x / 2 + 1 / 6], axis=1)  # cubic B-splines of x^2 add 1/3
    normal = np.stack([-x, 0 * x, np.ones_like(x)], axis=1) / w[:, None]
    size = 1 + abs(distance)
    assert abs(off.evaluate(5, u, v) - p - distance * normal).max() < 1e-13 * size
    factor = 1 - distance / w**3
    tangent = factor[:, None] * np.stack([1 + 0 * x, 0 * x, x], axis=1)
    assert abs(off.evaluate(5, u, v, nu=(1, 0)) - tangent).max() < 1e-12 * size
    bent = off.curvature(5, u, v)
    expected = 1 / w**3 / factor
    assert abs(np.where(expected > 0, bent.k1, bent.k2) - expected).max() < 1e-9
    assert abs(np.where(expected > 0, bent.k2, bent.k1)).max() < 1e-9
    across = np.cross(bent.d1, bent.d2)
    assert abs(across - off.normal(5, u, v)).max() < 1e-12


@pytest.mark.parametrize("name", WITH_PIECES)
def test_against_refined_normals(name):
    """p + d n at vertices of a refined cage, whose limits and normals are of masks alone."""
    made = zoo.bipyramid(5) if "loop" in name or name == "linear" else zoo.prism(5)
    surface = surface_of(made, scheme=name)
    fine = ls.refined(surface.mesh, 2)
    if name in ("doo-sabin", "bilinear", "linear"):
        face, u, v = places(surface)
        expected = surface.evaluate(face, u, v) + 0.2 * surface.normal(face, u, v)
        assert np.array_equal(ls.offset(surface, 0.2).evaluate(face, u, v), expected)
        return
    face, u, v = fine.parent_face, fine.parent_u, fine.parent_v
    normal = np.empty((fine.n_vertices, 3))
    normal[fine.indices] = fine.limit_normals
    expected = fine.limit_points + 0.2 * normal
    found = ls.offset(surface, 0.2).evaluate(face, u, v)
    assert abs(found - expected).max() < 1e-12


def test_derivatives_are_differences():
    surface = surface_of(zoo.prism(5))
    off, (face, u, v) = ls.offset(surface, -0.3), places(surface)
    u, v, h = 0.1 + 0.8 * u, 0.1 + 0.8 * v, 1e-5
    du = (off.evaluate(face, u + h, v) - off.evaluate(face, u - h, v)) / (2 * h)
    dv = (off.evaluate(face, u, v + h) - off.evaluate(face, u, v - h)) / (2 * h)
    jet = off.jet(face, u, v)
    assert abs(jet[1, 0] - du).max() < 1e-8
    assert abs(jet[0, 1] - dv).max() < 1e-8
    along = off.tangents(face, u, v)[0]
    assert abs(along - du / np.linalg.norm(du, axis=1)[:, None]).max() < 1e-6


def test_values_at_the_edges_of_definition():
    surface = surface_of(zoo.prism(5))
    off = ls.offset(surface, 0.1)
    assert np.isnan(off.evaluate(0, [np.nan, 0.5], 0.5)).all(axis=1).tolist() == [True, False]
    whole = ls.offset(surface, 0)
    face, u, v = places(surface)
    assert np.array_equal(whole.evaluate(face, u, v), surface.evaluate(face, u, v))
    flat = ls.offset(height(lambda x, y: 0 * x), 3.0)
    assert abs(flat.evaluate(0, 1.0, 1.0, nu=(1, 0)) - [1, 0, 0]).max() < 1e-14
    pole = ls.offset(surface, 0.1).jet(0, 1.0, 1.0)  # curvature diverges: points, no derivatives
    assert np.isfinite(pole[0, 0]).all()
    assert np.isnan(pole[1, 0]).all()
    with pytest.raises(IndexError, match="face"):
        off.evaluate(len(surface.limit_faces), 0.5, 0.5)
    with pytest.raises(ValueError, match="order 0 and 1"):
        off.evaluate(0, 0.5, 0.5, nu=(2, 0))
    with pytest.raises(ValueError, match="order 2"):
        off.jet(0, 0.5, 0.5, order=2)


@pytest.mark.parametrize(
    ("what", "error", "says"),
    [
        ({"distance": np.nan}, ValueError, "finite"),
        ({"distance": np.inf}, ValueError, "finite"),
        ({"distance": "1"}, TypeError, "number"),
        ({"distance": [1.0, 2.0]}, TypeError, "number"),
        ({"distance": True}, TypeError, "number"),
        ({"distance": 1, "tolerance": 0}, ValueError, "positive"),
        ({"distance": 1, "tolerance": np.nan}, ValueError, "positive"),
        ({"distance": 1, "channel": "uv"}, ValueError, "uv"),
    ],
)
def test_bad_calls(what, error, says):
    with pytest.raises(error, match=says):
        ls.offset(surface_of(zoo.cube()), **what)


def test_bad_surfaces():
    with pytest.raises(TypeError, match="LimitSurface"):
        ls.offset(ls.Mesh(*zoo.cube()), 1)
    with pytest.raises(ValueError, match=r"\(n, 3\)"):
        ls.offset(ls.LimitSurface(ls.Mesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2, 3]])), 1)


def test_folds_of_a_trough():
    """Of z = x^2 / 2 the curvature is 1 at x = 0: the offset is singular from distance 1 on."""
    surface = height(lambda x, y: (x - 2.3) ** 2 / 2, 6)
    assert not len(ls.offset(surface, 0.99).folds().singular)
    found = ls.offset(surface, 1.02).folds()
    inner = found.least[[11, 12, 13]]  # x from 2 to 3
    assert abs(inner - (1 - 1.02)).max() < 1e-5
    assert abs(found.u[12] - 0.3).max() < 5e-3
    assert len(found.near_face)
    assert len(ls.offset(surface, 1e4).folds().near_face)
    assert not ls.offset(surface, -0.5).folds().any
    assert not ls.offset(surface, 0.0).folds().any


def test_curvature_diverges_at_poles():
    surface = surface_of(zoo.prism(5))  # poles of valence 5 in the middles of both pentagons
    found = ls.offset(surface, -0.05).folds()
    assert len(np.unique(found.pole)) == 2
    assert found.turns.all()
    assert (found.pole >= surface.mesh.n_vertices).all()
    assert (found.radius > 0).all()
    # round the pole of a prism curvature grows as (mu / lambda^2)^n, distances fall as lambda^n
    mu, lam = (8 + np.sqrt(24)) / 40, 0.549988
    less = ls.offset(surface, -0.1).folds().radius
    expected = 2 ** (np.log(lam) / np.log(mu / lam**2))
    assert abs(np.log(found.radius / less) / np.log(expected) - 1).max() < 0.05
    assert not len(ls.offset(surface_of(zoo.cube()), 0.1).folds().pole)


@pytest.mark.parametrize("made", [zoo.cube, lambda: zoo.prism(5)])
def test_spline_faces_meet_and_are_near(made):
    surface = surface_of(made())
    off = ls.offset(surface, 0.1)
    faces = off.bspline_faces(tolerance=1e-4)
    assert faces.deviation.max() < 1e-4
    rng = np.random.default_rng(3)
    face, (u, v) = rng.integers(0, len(faces), 300), rng.random((2, 300))
    points = faces.evaluate(face, u, v)
    away = ls.closest_point(surface, points).distance
    assert abs(away - 0.1).max() < 1.2e-4
    mesh = faces.surface.mesh  # neighbours have the same edges
    from limitsurf.cad.edges import inner_edges
    from limitsurf.cad.edges import places as on_edges

    half = inner_edges(faces.surface)
    s = np.tile(rng.random(7), (len(half), 1))
    one = faces.evaluate(*faces.of(*on_edges(faces.surface, half, s)))
    two = faces.evaluate(*faces.of(*on_edges(faces.surface, mesh.twin[half], 1 - s)))
    assert abs(one - two).max() < 1e-13


@pytest.mark.parametrize(
    ("made", "rules", "distance"),
    [
        (zoo.cube, {}, 0.1),
        (zoo.cube, {}, -0.05),
        (lambda: zoo.prism(5), {}, 0.02),
        (zoo.cube, {"scheme": "doo-sabin"}, 0.1),
    ],
)
def test_bounds_of_spline_faces_hold_and_are_near(made, rules, distance):
    """At places everywhere, half of them close to poles, by points and normals alone."""
    surface = surface_of(made(), **rules)
    faces = ls.offset(surface, distance).bspline_faces(tolerance=1e-3)
    rng = np.random.default_rng(5)
    face, (u, v) = rng.integers(0, len(faces), 4000), rng.random((2, 4000))
    u[2000:], v[2000:] = 2.0 ** -rng.uniform(0, 12, (2, 2000))
    at = faces.limit_faces[face], u, v
    w = faces.evaluate(face, u, v) - faces.surface.evaluate(*at)
    height = (w * faces.surface.normal(*at)).sum(axis=1)
    across = ((w**2).sum(axis=1) - height**2).clip(0)
    far = np.abs(height - distance) + across / (2 * abs(distance))
    assert (far <= faces.bounds[face] + 1e-15).all()
    assert (faces.along_normal <= faces.bounds).all()
    assert faces.bounds.max() < 6 * far.max()


def test_bounds_of_triangles_are_refused():
    faces = ls.offset(surface_of(zoo.tetrahedron(), scheme="loop"), 0.05).bspline_faces(
        tolerance=1e-2
    )
    with pytest.raises(ValueError, match="schemes of triangles"):
        _ = faces.bounds


def test_spline_faces_of_triangles():
    surface = surface_of(zoo.tetrahedron(), scheme="loop")
    faces = ls.offset(surface, 0.05).bspline_faces(tolerance=1e-3)
    assert faces.degree == (4, 4)
    assert faces.deviation.max() < 1e-3
    x, y = np.random.default_rng(3).random((2, 30))
    y = y * (1 - x)
    away = ls.closest_point(surface, faces.evaluate(np.arange(30) % len(faces), x, y)).distance
    assert abs(away - 0.05).max() < 1.2e-3


def test_refused_splines():
    sharp = surface_of(zoo.cube(), creases={(0, 1): 10})
    with pytest.raises(ValueError, match=r"vertices [01] and [01]"):
        ls.offset(sharp, 0.1).bspline_faces()
    with pytest.raises(ValueError, match="tolerance must be above"):
        ls.offset(surface_of(zoo.cube()), 0.1).bspline_faces(tolerance=1e-16)


def steiner(surface, d):
    """The volume between a surface and its offset, from integrals of curvature."""
    rule = ls.quadrature(surface)
    bent = surface.curvature(rule.face, rule.u, rule.v)
    factor = 1 - d * bent.mean + d * d / 3 * bent.gaussian
    jet = surface.jet(rule.face, rule.u, rule.v, order=1)
    area = np.linalg.norm(np.cross(jet[1, 0], jet[0, 1]), axis=1)
    return float((rule.weights * area * factor).sum()) * d


@pytest.mark.parametrize("d", [0.07, -0.07])
def test_volume_of_thick_solids(d):
    surface = surface_of(zoo.cube())
    solid = ls.thickened(surface, d, tolerance=1e-6)
    found = ls.volume(ls.LimitSurface(solid))
    # closed surfaces: K integrates to 4 pi, by Gauss and Bonnet
    assert abs(found - abs(steiner(surface, d))) < 2e-5
    assert solid.is_closed


def test_thick_shells_are_closed_and_hold_the_surface():
    surface = height(lambda x, y: x * x / 8 - y * x / 9, 4)
    solid = ls.thickened(surface, -0.2)
    thick = ls.LimitSurface(solid)
    assert solid.is_closed
    assert solid.n_faces == 2 * 9 + 12
    assert abs(ls.volume(thick) - abs(steiner(surface, -0.2))) < 2e-3
    face, u, v = places(surface)
    assert abs(thick.evaluate(face, u, v) - surface.evaluate(face, u, v)).max() < 1e-13


def test_mitres():
    """All edges of a box sharp: the fitted offset is the larger box."""
    points, faces = zoo.cube()
    mesh = ls.Mesh(points, faces)
    sharp = ls.LimitSurface(mesh.with_tags(creases=(mesh.edges, np.full(len(mesh.edges), 10.0))))
    fitted = ls.offset(sharp, 0.5).fit()
    box = np.asarray(points, dtype=float)
    middle = box.mean(axis=0)
    size = np.ptp(box, axis=0)
    assert abs(fitted.mesh.points - (middle + (box - middle) * (1 + 1 / size))).max() < 1e-6
    assert fitted.along_normal < 1e-6


def test_refused_solids():
    with pytest.raises(ValueError, match="must not be 0"):
        ls.thickened(surface_of(zoo.cube()), 0)
    with pytest.raises(ValueError, match="holes: face 0"):
        ls.thickened(surface_of(zoo.cube(), holes=[0]), 0.1)
    book = [[0, 1, 2, 3], [1, 0, 4, 5], [0, 1, 6, 7]]
    points = np.random.default_rng(0).random((8, 3))
    with pytest.raises(ValueError, match=r"non-manifold edges: \[0, 1\]"):
        ls.thickened(ls.LimitSurface(ls.Mesh(points, book)), 0.1)
    with pytest.raises(ValueError, match="doo-sabin has no sharp"):
        ls.thickened(surface_of(zoo.grid(3, 3), scheme="doo-sabin"), 0.1)


def test_solids_of_opencascade():
    pytest.importorskip("OCP")
    surface = surface_of(zoo.cube())
    outer = ls.to_brep(ls.offset(surface, 0.1).bspline_faces(tolerance=1e-4), solid=True)
    thick = ls.to_brep(ls.LimitSurface(ls.thickened(surface, 0.1)), solid=True, depth=4)
    from OCP.BRepCheck import BRepCheck_Analyzer
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps

    sheet = height(lambda x, y: x * x / 8 - y * x / 9, 4)
    plate = ls.to_brep(ls.LimitSurface(ls.thickened(sheet, 0.1, tolerance=1e-3)), solid=True)
    volumes = []
    for shape in (outer, thick, plate):
        assert BRepCheck_Analyzer(shape).IsValid()
        properties = GProp_GProps()
        BRepGProp.VolumeProperties_s(shape, properties)
        volumes.append(properties.Mass())
    shell = steiner(surface, 0.1)
    assert abs(volumes[0] - ls.volume(surface) - shell) < 5e-4
    assert abs(volumes[1] - shell) < 2e-3
    assert abs(volumes[2] - steiner(sheet, 0.1)) < 1e-3


def test_command(tmp_path):
    cage = tmp_path / "cube.obj"
    ls.write(cage, ls.Mesh(*zoo.cube()))
    larger = tmp_path / "larger.obj"
    found = facts("offset", cage, "-d", 0.1, "-o", larger)
    fitted = ls.offset(surface_of(zoo.cube()), 0.1).fit()
    assert abs(ls.read(larger).points - fitted.mesh.points).max() < 1e-12
    assert found["deviation"] == fitted.along_normal
    thick = tmp_path / "thick.obj"
    assert facts("offset", cage, "-d", -0.1, "--thick", "-o", thick)["faces"] == 12
    assert ls.read(thick).is_closed
    assert "finite" in fail("offset", cage, "-d", "nan", "-o", larger)
    assert "name one" in fail("offset", cage, "-d", 1, "--to", "step")


def test_command_for_cad(tmp_path):
    pytest.importorskip("OCP")
    cage, part = tmp_path / "cube.obj", tmp_path / "cube.step"
    ls.write(cage, ls.Mesh(*zoo.cube()))
    found = facts("offset", cage, "-d", 0.1, "--tolerance", 1e-3, "-o", part)
    assert found["faces"] == 6
    assert found["deviation"] < 1e-3
    text = part.read_text()
    assert "offset at 0.1" in text
    assert "cube.step" in text
    surface = surface_of(zoo.cube())
    faces = ls.offset(surface, 0.1).bspline_faces(tolerance=1e-3)
    with pytest.raises(ValueError, match="offset"):
        ls.deviation(surface, faces)


@pytest.mark.parametrize("name", WITH_PIECES)
def test_spline_faces_of_every_scheme(name):
    """Measured by closest points; schemes whose edges are all sharp are refused by name."""
    made = zoo.bipyramid(5) if "loop" in name or name == "linear" else zoo.prism(5)
    surface = surface_of(made, scheme=name)
    off = ls.offset(surface, 0.05)
    if name in ("bilinear", "linear"):
        with pytest.raises(ValueError, match="sharp edges"):
            off.bspline_faces()
        return
    faces = off.bspline_faces(tolerance=4e-3)
    face = np.arange(len(faces))
    away = ls.closest_point(surface, faces.evaluate(face, 0.3, 0.4)).distance
    assert abs(away - 0.05).max() < 5e-3


def test_channels_and_workers():
    points, faces = zoo.prism(5)
    mesh = ls.Mesh(points, faces)
    bent = mesh.points * [1.0, 2.0, 0.5]
    channel = {"rest": (bent, mesh.indices, "none")}
    surface = ls.LimitSurface(ls.Mesh(points, faces, channels=channel))
    other = ls.LimitSurface(ls.Mesh(bent, faces))
    face, u, v = places(surface)
    one = ls.offset(surface, 0.1, channel="rest", workers=2)
    two = ls.offset(other, 0.1)
    assert abs(one.evaluate(face, u, v) - two.evaluate(face, u, v)).max() < 1e-13
    assert one.bspline_faces(tolerance=1e-2).deviation.max() < 1e-2
    solid = ls.thickened(surface, 0.05, channel="rest")
    expected = ls.thickened(other, 0.05)
    assert abs(solid.points - expected.points).max() < 1e-9
    with pytest.raises(ValueError, match="positive integer, or -1 for all"):
        ls.offset(surface, 0.1, workers=0)
