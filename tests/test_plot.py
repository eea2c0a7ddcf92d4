"""Pictures: both painters, odd cages, files."""

import inspect
import math
import re
import subprocess
import sys
import types
import warnings
from contextlib import nullcontext
from fractions import Fraction

import browser
import make_demo_cage
import make_images
import numpy as np
import pytest
import zoo
from PIL import Image

import limitsurf as ls
from limitsurf.scheme.lattice import TRIANGLES
from limitsurf.scheme.net import Net
from limitsurf.shell.plot import picture as pictures
from limitsurf.shell.plot import render
from limitsurf.shell.plot import scene as scenes
from limitsurf.spectra.fan import Fan, order_at, predicted_order

SIZE = (160, 120)
PAINTED = "painted by Matplotlib"


@pytest.fixture(params=["rendered", "painted"])
def draw(request, monkeypatch):
    """``plot`` at a small size, by either painter."""
    if request.param == "rendered" and not render.opengl():
        pytest.skip("there is no OpenGL")
    monkeypatch.setattr(render, "opengl", lambda: request.param == "rendered")
    monkeypatch.setattr(pictures, "POLYGONS", 2_000)

    def small(surface, file=None, **options):
        options = {"window_size": SIZE, "off_screen": True, **options}
        rendered = request.param == "rendered"
        with nullcontext() if rendered else pytest.warns(UserWarning, match=PAINTED):
            return ls.plot(surface, file, **options).image

    return small


def cube(**tags):
    points, faces = zoo.cube()
    return ls.Mesh(np.asarray(points, dtype=float), faces, **tags)


def surface_of(points, faces, **tags):
    return ls.LimitSurface(ls.Mesh(points, faces, **tags))


def forget_the_trial():
    """Find out anew whether there is OpenGL."""
    render.opengl()
    for found in (render.opengl, render._trial):
        found.cache_clear()


def alike(a, b, tolerance=2.0):
    return np.abs(a.astype(float) - b.astype(float)).mean() < tolerance


def colored(image):
    """The part of the picture that is neither ground nor ink: the surface."""
    rgb = image.astype(int)
    return (rgb[..., 0] - rgb[..., 2] > 30).mean()


def test_picture(draw, tmp_path):
    path = tmp_path / "a.png"
    image = draw(ls.LimitSurface(cube()), path)
    assert image.shape == (*SIZE[::-1], 3)
    assert image.dtype == np.uint8
    np.testing.assert_array_equal(np.asarray(Image.open(path)), image)
    assert list(tmp_path.iterdir()) == [path]
    assert 0.15 < colored(image) < 0.5
    top, bottom = image[0, 0].astype(int), image[-1, 0].astype(int)
    assert (top > bottom).all()


def test_the_painters_agree(monkeypatch):
    if not render.opengl():
        pytest.skip("there is no OpenGL")
    surface = ls.LimitSurface(ls.read(make_demo_cage.FILE))
    rendered = ls.plot(surface, off_screen=True, window_size=(320, 240), n=8).image
    monkeypatch.setattr(render, "opengl", lambda: False)
    with pytest.warns(UserWarning, match=PAINTED):
        painted = ls.plot(surface, off_screen=True, window_size=(320, 240), n=8).image
    assert alike(rendered, painted, 6.0)


def test_every_option_changes_the_picture(draw):
    points, faces = zoo.prism(5)
    surface = surface_of(points, faces)
    bare = {"cage": False, "curves": False, "poles": False, "n": 4}
    plain = draw(surface, **bare)
    for option in [
        {"cage": True},
        {"curves": True},
        {"poles": True},
        {"normals": True},
        {"n": 1},
        {"color": "#3060c0"},
        {"up": "x"},
        {"up": "y"},
    ]:
        assert (draw(surface, **{**bare, **option}) != plain).any(), option


def test_creases_are_thick_edges_of_the_cage():
    surface = ls.LimitSurface(cube(creases={(0, 1): 2, (0, 2): 0}))
    scene = scenes.build(surface, scenes.Wishes(cage=True, curves=False, poles=False), 1.0, 6)
    cage, creases = scene.lines
    assert len(cage.ends) == 12
    (edge,) = creases.ends
    assert sorted(map(tuple, edge)) == sorted(map(tuple, surface.mesh.points[:2] - 0.5))
    assert creases.width > cage.width


def test_a_channel_of_three_numbers_is_drawn_in_their_space(draw):
    square = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    flat = ls.Mesh(square, [[0, 1, 2, 3]])
    there = (np.array(square) * 0.1 + 7, [0, 1, 2, 3], "corners_only")
    painted = ls.Mesh(cube().points[[0, 1, 3, 2]], [[0, 1, 2, 3]], channels={"rest": there})
    assert alike(draw(ls.LimitSurface(painted), channel="rest"), draw(ls.LimitSurface(flat)), 0.1)
    with pytest.raises(ValueError, match="no channel 'st'; it has 'rest'"):
        ls.plot(ls.LimitSurface(painted), channel="st", off_screen=True)


def torn_box(values=None):
    """A box without a lid, its texture a cross with four seams of its four vertical edges."""
    ring = [(0, 0), (1, 0), (1, 1), (0, 1)]
    points = [(x, y, z) for z in (0.0, 1.0) for x, y in ring]
    faces = [[0, 1, 2, 3], [4, 5, 1, 0], [1, 5, 6, 2], [3, 2, 6, 7], [4, 0, 3, 7]]
    cross = [(1, 0), (2, 0), (0, 1), (1, 1), (2, 1), (3, 1)]
    cross += [(0, 2), (1, 2), (2, 2), (3, 2), (1, 3), (2, 3)]
    corners = [3, 4, 8, 7, 0, 1, 4, 3, 4, 5, 9, 8, 7, 8, 11, 10, 2, 3, 7, 6]
    values = np.array(cross, float) if values is None else values(np.array(cross, float))
    return surface_of(points, faces, channels={"uv": (values, corners, "corners_plus1")})


def test_a_layout_shows_its_seams_in_its_numbers(tmp_path):
    torn, rim = scenes.seams(torn_box(), "uv")
    place = np.array([1.5, 1.5, 0]) + 3 * torn.ends  # the layout is 3 wide about its middle
    # each vertical edge is on two seams, between corners of the cross and its inner square
    assert {tuple(p) for p in place.round(9).reshape(-1, 3)} >= {(0, 1, 0), (1, 0, 0), (2, 3, 0)}
    edge = (3 * rim.ends + [1.5, 1.5, 0]).round(9)
    on_rim = (edge[..., :2] == 0) | (edge[..., :2] == 3)
    assert on_rim.any(axis=2).all()
    path = tmp_path / "a.svg"
    ls.plot(torn_box(), path, channel="uv", window_size=SIZE, n=2)
    text = path.read_text("utf-8")
    assert text.count("<path") > 20
    folded = torn_box(lambda p: np.where(p == 3, 1.5, p))
    size = {"window_size": (320, 240), "off_screen": True}
    blue = [
        (np.diff(ls.plot(s, channel="uv", **size).image[..., [0, 2]].astype(int)) > 15).mean()
        for s in (torn_box(), folded)
    ]
    assert blue[1] > blue[0] + 0.02  # what is turned over


@pytest.mark.parametrize("options", [{}, {"scalars": "mean"}, {"isolines": 2}, {"dark": True}])
def test_layouts_of_all_kinds(options, tmp_path):
    for name in ("a.png", "a.pdf", "a.html"):
        ls.plot(torn_box(), tmp_path / name, channel="uv", window_size=SIZE, n=2, **options)
    loop = ls.refined(ls.Mesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]], scheme="loop"))
    uv = loop.points * 2, loop.indices, "all"
    triangles = loop.with_points(np.pad(loop.points, ((0, 0), (0, 1))))
    flat = ls.Mesh(triangles.points, triangles.uniform, scheme="loop", channels={"st": uv})
    ls.plot(flat, tmp_path / "b.png", channel="st", window_size=SIZE, **options)


def test_files_of_pixels(tmp_path):
    picture = ls.plot_characteristic_map(valence=5, window_size=SIZE, off_screen=True)
    for suffix, kind in {".jpg": "JPEG", ".jpeg": "JPEG", ".webp": "WEBP", ".png": "PNG"}.items():
        picture.save(tmp_path / f"a{suffix}")
        with Image.open(tmp_path / f"a{suffix}") as image:
            assert image.format == kind
            assert alike(np.asarray(image.convert("RGB")), picture.image, 6.0)


def test_a_dark_picture_is_dark(draw):
    light, dark = (draw(ls.LimitSurface(cube()), dark=dark) for dark in (False, True))
    assert light[:5].mean() > 200
    assert dark[:5].mean() < 100
    assert colored(dark) == pytest.approx(colored(light), rel=0.2)
    charts = ls.plot_characteristic_map(valence=5, window_size=SIZE, off_screen=True, dark=True)
    assert charts.image[:5].mean() < 60


def test_axes_have_round_numbers_in_the_units_of_the_points():
    surface = ls.LimitSurface(cube().with_points(cube().points * 30 + [100, 0, 0]))
    scene = scene_of(surface, box=True, cage=True)
    np.testing.assert_array_equal(scene.box.ends, [[100, 0, 0], [130, 30, 30]])
    assert scene.box.ticks == [4, 4, 4]
    unit = scene.in_units()
    np.testing.assert_allclose(unit.points.max(axis=0), scene.frame.placed(scene.points).max(0))
    flat = scene_of(surface_of([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2, 3]]), box=True)
    assert flat.box.ticks[2] == 1


@pytest.mark.parametrize("option", ["axes", "scale_bar"])
def test_axes_and_scale_bars_change_the_picture(option):
    if not render.opengl():
        pytest.skip("there is no OpenGL")
    surface, size = ls.LimitSurface(cube(units=0.01)), {"window_size": SIZE, "off_screen": True}
    plain, other = (ls.plot(surface, **size, **k).image for k in ({}, {option: True}))
    assert (plain != other).any()
    for factor in (1e-310, 1e305):
        with pytest.raises(ValueError, match="sizes from 1e-300 to 1e300"):
            ls.plot(surface.with_points(surface.points * factor), **size, **{option: True})


def test_a_plotter_takes_more_in_the_units_of_the_points():
    if not render.opengl():
        pytest.skip("there is no OpenGL")
    surface = ls.LimitSurface(cube().with_points(cube().points * 30 + [100, 0, 0]))
    plotter = ls.plot(
        surface,
        scalars="mean",
        poles=True,
        off_screen=True,
        return_plotter=True,
        window_size=(320, 240),
    )
    try:
        low, high = surface.evaluate(range(6), 0.5, 0.5).min(axis=0), 130
        found = np.array(plotter.actors[render.SURFACE].bounds).reshape(3, 2)
        assert (found[:, 0] >= [100, 0, 0]).all()
        assert (found[:, 1] <= [high, 30, 30]).all()
        np.testing.assert_allclose(found[:, 0], low, atol=0.5)
        between = np.add(plotter.camera.position, (115, 15, 15)) / 2
        plotter.add_points(between[None], color="lime", point_size=30)
        red, green, blue = np.moveaxis(plotter.screenshot(return_img=True).astype(int), 2, 0)
        assert (green - np.maximum(red, blue) > 60).any()
    finally:
        plotter.close()


def test_a_hint_before_many_polygons(monkeypatch):
    monkeypatch.setattr("limitsurf.shell.plot.plots.MANY", 23)
    with pytest.warns(UserWarning, match="drawing 24 polygons"):
        ls.plot(ls.LimitSurface(cube()), n=2, off_screen=True, window_size=SIZE)


def test_size_and_place_do_not_matter(draw):
    mesh = cube()
    expected = draw(ls.LimitSurface(mesh))
    others = {
        "huge": mesh.points * 1.7e308 - 0.8e308,
        "tiny": mesh.points * 1e-300,
        "far": mesh.points + 1e9,
        "exact": np.vectorize(Fraction)(mesh.points),
    }
    for name, points in others.items():
        assert alike(draw(ls.LimitSurface(mesh.with_points(points))), expected), name


def test_unused_vertices_do_not_shrink_the_picture(draw):
    mesh = cube()
    far = np.concatenate([mesh.points, [[1e308, 0, 0]]])
    assert alike(draw(surface_of(far, mesh.faces)), draw(ls.LimitSurface(mesh)), 0.5)


@pytest.mark.parametrize("flat", range(3))
@pytest.mark.parametrize("up", "xyz")
def test_flat_cages_are_seen_from_the_front(flat, up, draw):
    points, faces = zoo.grid(3, 3)
    points = np.insert(np.asarray(points, dtype=float)[:, :2], flat, 0.0, axis=1)
    assert colored(draw(surface_of(points, faces), up=up)) > 0.3


def test_points_in_the_plane(draw):
    points, faces = zoo.grid(3, 3)
    points = np.asarray(points, dtype=float)[:, :2]
    flat = np.pad(points, ((0, 0), (0, 1)))
    np.testing.assert_array_equal(draw(surface_of(points, faces)), draw(surface_of(flat, faces)))


def test_degenerate_cages_draw_something(draw):
    mesh = cube()
    for factor in [(1, 0, 0), (0, 0, 0)]:
        draw(ls.LimitSurface(mesh.with_points(mesh.points * factor)))


def test_holes_are_left_out(draw):
    whole, holed = ls.LimitSurface(cube()), ls.LimitSurface(cube(holes=[0, 2]))
    options = {"cage": False, "curves": False, "poles": False}
    assert colored(draw(holed, **options)) < colored(draw(whole, **options))
    with pytest.raises(ValueError, match="nothing to draw"):
        ls.plot(ls.LimitSurface(cube(holes=range(6))), off_screen=True)


@pytest.mark.parametrize(
    "make",
    [
        lambda: zoo.pillow_of_quads(),  # valence 2: no normals at its vertices
        lambda: zoo.tetrahedron(),
        lambda: zoo.disjoint(zoo.cube(), zoo.torus(4, 5)),
        lambda: zoo.sphere(12, 4),
        lambda: zoo.single_face(4),
        *(lambda name=name: zoo.NONMANIFOLD[name][:2] for name in ("fin", "bow_tie", "moebius")),
    ],
)
@pytest.mark.parametrize(
    "tags",
    [
        {},
        {"boundary": "edge_only"},
        {"corners": dict.fromkeys(range(4), np.inf)},  # no limit normals there
    ],
    ids=str,
)
def test_all_sorts_of_cages(make, tags, draw):
    points, faces = make()
    assert colored(draw(surface_of(points, faces, **tags))) > 0.005


def test_poles_of_the_demo():
    mesh = ls.read(make_demo_cage.FILE)
    count = {dots.name: len(dots.places) for dots in scenes.extraordinary(ls.LimitSurface(mesh))}
    inside = mesh.vertex_faces[~mesh.boundary_vertex]
    assert count == {
        "valence 3": (inside == 3).sum() + (mesh.sizes == 3).sum(),
        "valence 5": (inside == 5).sum() + (mesh.sizes == 5).sum(),
        "valence 6": (mesh.sizes == 6).sum(),
        "valence 8": 1,
        "valence 16": 1,
    }


def test_poles_are_where_the_surface_is_smooth_and_closed():
    points, faces = zoo.disjoint(zoo.NONMANIFOLD["fin"][:2], zoo.cube())
    (dots,) = scenes.extraordinary(ls.LimitSurface(ls.Mesh(points, faces)))
    assert (dots.name, len(dots.places)) == ("valence 3", 8)


def test_poles_sit_where_all_their_faces_meet():
    mesh = cube(holes=[0])  # some of the faces around each vertex have no limit
    (dots,) = scenes.extraordinary(ls.LimitSurface(mesh))
    centre = mesh.points.mean(axis=0)
    places = {tuple(p) for p in dots.places.round(12)}
    assert places == {tuple(p) for p in ((mesh.points - centre) / 2 + centre).round(12)}


@pytest.mark.parametrize("up", "xyz")
def test_the_camera_sees_everything(up):
    rng = np.random.default_rng(0)
    for _ in range(20):
        points = rng.random((30, 3)) * 10 ** rng.uniform(-1, 1, 3)
        aspect = rng.uniform(0.3, 3)
        axes, eye, distance = scenes.camera(points, up, None, aspect)
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-14)
        local = (points - eye) @ axes.T
        slope = np.tan(np.radians(scenes.VIEW_ANGLE / 2)) * (1 - 2 * scenes.MARGIN)
        reach = np.abs(local[:, :2] / -local[:, 2:]) / slope / [aspect, 1]
        assert distance > 0
        assert (local[:, 2] < 0).all()
        assert reach.max() == pytest.approx(1)  # the picture is full


def test_bad_calls(tmp_path):
    surface = ls.LimitSurface(cube())
    for options, match in [
        ({"n": 0}, "n must be an integer >= 1, got 0"),
        ({"n": 2.5}, "n must be an integer >= 1, got 2.5"),
        ({"n": "3"}, "n must be an integer >= 1, got '3'"),
        ({"n": True}, "n must be an integer >= 1, got True"),
        ({"up": "w"}, "up must be"),
        ({"window_size": (0, 9)}, r"window_size\[0\] must be an integer >= 1, got 0"),
        ({"window_size": (9, 200.5)}, r"window_size\[1\] must be an integer >= 1, got 200.5"),
        ({"window_size": 5}, "window_size must be two integers, .*, got 5"),
        ({"window_size": (1, 2, 3)}, "window_size must be two integers"),
        ({"color": "no such color"}, "color must be .*, got 'no such color'"),
        ({"color": 5}, "color must be .*, got 5"),
        ({"limits": (0, 1)}, "limits needs scalars that have a colour bar, got None"),
        ({"cmap": "viridis"}, "cmap needs scalars"),
        ({"label": "a"}, "label needs scalars"),
        ({"label": "a", "scalars": "zebra"}, "label needs scalars that .*, got 'zebra'"),
        ({"file": "a.gif"}, "a.gif.*.png or .jpg"),
        ({"file": "a.svg"}, "a.svg"),
        ({"file": "a.png", "return_plotter": True}, "no file with return_plotter"),
    ]:
        with pytest.raises(ValueError, match=match):
            ls.plot(surface, **{"off_screen": True, **options})
    for points in [np.zeros((8, 1)), np.zeros(8), np.zeros((8, 3, 2))]:
        with pytest.raises(ValueError, match="shape"):
            ls.plot(surface.with_points(points), off_screen=True)
    with pytest.raises(FileNotFoundError, match="nowhere"):
        ls.plot(surface, tmp_path / "nowhere" / "a.png", window_size=SIZE)


def test_a_picture_appears_whole_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    path.write_text("precious")
    monkeypatch.setattr(Image.Image, "save", lambda *_, **__: 1 / 0)
    monkeypatch.setattr(render, "pixels", lambda *_: np.zeros((9, 9, 3), np.uint8))
    with pytest.raises(ZeroDivisionError):
        ls.plot(ls.LimitSurface(cube()), path, window_size=(9, 9), poles=False)
    assert path.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [path]


def test_without_pyvista(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    with pytest.raises(ImportError, match=r"limitsurf\[plot\]"):
        ls.plot(ls.LimitSurface(cube()), off_screen=True)


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere OpenGL is taken for granted")
def test_a_crash_of_the_trial_means_no_opengl(monkeypatch):
    crash = subprocess.Popen([sys.executable, "-c", "import os; os.abort()"])
    monkeypatch.setattr(render, "_trial", lambda: crash)
    render.opengl.cache_clear()
    assert not render.opengl()
    render.opengl.cache_clear()


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere OpenGL is taken for granted")
def test_a_trial_without_end_means_no_opengl(monkeypatch):
    monkeypatch.setattr(render, "TRIAL", 1e-3)
    forget_the_trial()
    assert not render.opengl()
    forget_the_trial()


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere OpenGL is taken for granted")
def test_the_trial_runs_nothing_of_the_working_directory(monkeypatch, tmp_path):
    able = render.opengl()
    (tmp_path / "vtkmodules").mkdir()
    (tmp_path / "vtkmodules" / "__init__.py").write_text("open('was_here', 'w')\n")
    monkeypatch.chdir(tmp_path)
    forget_the_trial()
    assert render.opengl() == able
    assert [path.name for path in tmp_path.iterdir()] == ["vtkmodules"]


def test_the_warning_names_the_line_that_asked_for_pixels(monkeypatch, tmp_path):
    monkeypatch.setattr(render, "opengl", lambda: False)
    small = {"window_size": SIZE, "n": 1, "off_screen": True}
    picture = ls.plot(ls.LimitSurface(cube()), **small)
    for ask in (
        lambda: ls.plot(ls.LimitSurface(cube()), tmp_path / "a.png", **small),
        lambda: np.asarray(picture),
        lambda: ls.plot_eigenfunctions(valence=3, which=1, window_size=SIZE, off_screen=True).image,
    ):
        with pytest.warns(UserWarning, match=PAINTED) as record:
            ask()
        assert [warning.filename for warning in record] == [__file__]


def test_a_window(monkeypatch):
    """As far as it goes without a screen: PYVISTA_OFF_SCREEN is set for the whole suite."""
    if not render.opengl():
        pytest.skip("there is no OpenGL")
    monkeypatch.setattr(render, "_display", lambda: True)
    image = ls.plot(ls.LimitSurface(cube()), window_size=SIZE).image
    assert image.shape == (*SIZE[::-1], 3)
    assert colored(image) > 0.1
    points, faces = zoo.prism(5)
    plain = {"window_size": (320, 240), "poles": False}
    bare = ls.plot(surface_of(points, faces), **plain).image
    image = ls.plot(surface_of(points, faces), **plain, scalars="mean").image
    assert (image[60:180, 280:] != bare[60:180, 280:]).any()  # the colour bar
    monkeypatch.setattr(render, "_display", lambda: False)
    with pytest.raises(OSError, match="display"):
        ls.plot(ls.LimitSurface(cube()))


# ------------------------------------------------------------------ reference pictures


@pytest.mark.parametrize("name", make_images.PICTURES)
def test_reference_pictures(name):
    if name not in make_images.FLAT and not render.opengl():
        pytest.skip("there is no OpenGL")
    draw, tolerance, variants = make_images.PICTURES[name]
    expected = make_images.reference(name)
    assert make_images.difference(draw().image, expected) < tolerance
    for variant in variants:
        assert make_images.difference(draw(**variant).image, expected) > tolerance, variant


def test_the_picture_of_the_readme_is_what_is_drawn():
    if not render.opengl():
        pytest.skip("there is no OpenGL")
    expected = np.asarray(Image.open(make_images.README))
    assert make_images.difference(make_images.of_readme(), expected) < make_images.OF_README


@pytest.mark.parametrize("name", make_images.PAINTED)
def test_painted_reference_pictures(name):
    draw, _, _ = make_images.PICTURES[name]
    image = make_images.painted(draw)
    expected = make_images.reference(f"{name}_painted")
    assert make_images.difference(image, expected) < make_images.PAINTED_ALIKE
    bare = make_images.painted(lambda: draw(isolines=0, cage=False, curves=False, scalars=None))
    assert make_images.difference(bare, expected) > make_images.PAINTED_ALIKE


# ------------------------------------------------------------------ scalars


def scene_of(surface, quads=100, **wishes):
    return scenes.build(surface, scenes.Wishes(**wishes), 1.0, quads)


def dented():
    """A surface with curvature of both signs."""
    points, faces = zoo.torus(6, 5)
    return surface_of(np.asarray(points, dtype=float), faces)


def test_curvature_is_in_units_of_the_points():
    surface = dented()
    for name, power in (("mean", 1), ("k1", 1), ("k2", 1), ("gaussian", 2)):
        field = scene_of(surface, scalars=name, n=2).field
        there = np.arange(len(surface.limit_faces))[:, None, None], [0, 0.5, 1], [[0], [0.5], [1]]
        found = getattr(surface.curvature(*there), name)
        known = np.isfinite(found) & (found != 0)
        assert known.sum() > 100
        np.testing.assert_allclose(field.values.reshape(found.shape)[known], found[known], 1e-9)
        large = surface.with_points(surface.points * 1000 + 7)
        other = scene_of(large, scalars=name, n=2).field
        np.testing.assert_allclose(other.values, field.values / 1000**power, 1e-6, 1e-12)
        assert -field.limits[0] == field.limits[1] > 0
        assert np.isfinite(field.values).all()


@pytest.mark.parametrize("factor", [1e-200, 1e-154, 1e-150, 1e150, 1e160, 1e300])
def test_curvature_at_the_ends_of_float64(factor, draw):
    """Gaussian curvature there is 0, infinite, or nearly so."""
    surface = dented().with_points(dented().points * factor)
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        low, high = scene_of(surface, scalars="mean").field.limits
        assert -low == high == pytest.approx(0.8 / factor, rel=0.5)
        if factor == 1e-200:
            with pytest.raises(ValueError, match="no scalar to draw is finite"):
                ls.plot(surface, scalars="gaussian", n=2, off_screen=True)
            return
        field = scene_of(surface, scalars="gaussian").field
        assert -field.limits[0] == field.limits[1] > 0
        assert np.isfinite(field.limits[1] - field.limits[0])
        assert (field.shades[np.isfinite(field.values)] <= 1).all()
        draw(surface, scalars="gaussian", n=2)


def test_the_range_of_colours_leaves_out_outliers():
    surface = surface_of(*zoo.grid(10, 10))

    def spiky(face, u, v):
        return np.where((face == 0) & (u == 0), 1e9, u)

    field = scene_of(surface, scalars=spiky).field
    assert field.limits[1] <= 1
    assert field.beyond[1]
    field = scene_of(surface, scalars=spiky, limits=(-1, 2e9)).field
    assert field.limits == (-1, 2e9)
    assert field.beyond == (False, False)


def test_signed_scalars_are_symmetric_and_others_are_not():
    surface = surface_of(*zoo.grid(4, 4))
    signed = scene_of(surface, scalars=lambda face, u, v: u - 0.4).field
    assert signed.limits[0] == -signed.limits[1]
    assert signed.cmap == scenes.DIVERGING
    other = scene_of(surface, scalars=lambda face, u, v: 3 + u).field
    assert 3 <= other.limits[0] < other.limits[1] <= 4
    assert other.cmap == scenes.SEQUENTIAL
    for constant in (0.0, 5.0):
        low, high = scene_of(surface, scalars=lambda face, u, v, c=constant: c + 0 * u).field.limits
        assert low < constant < high


def test_a_flat_surface_has_no_curvature_to_exaggerate():
    points, faces = zoo.grid(4, 4)
    flat = np.asarray(points, dtype=float) * (1, 1, 0)
    field = scene_of(surface_of(flat, faces), scalars="mean").field
    assert np.abs(field.values).max() < 1e-3 * field.limits[1]


def test_scalars_of_the_vertices_are_subdivided():
    surface = surface_of(*zoo.prism(5))
    x = np.asarray(surface.mesh.points, dtype=float)[:, 0]
    scene = scene_of(surface, scalars=x)
    extent = np.ptp(np.asarray(surface.mesh.points, dtype=float), axis=0).max()
    np.testing.assert_allclose(np.ptp(scene.field.values), np.ptp(scene.points[:, 0]) * extent)


def test_scalars_that_are_nan_are_grey(draw):
    surface = surface_of(*zoo.grid(3, 3))
    bare = {"cage": False, "curves": False, "poles": False, "view": "top"}
    half = draw(surface, scalars=lambda f, u, v: np.where(f < 4, np.nan, f), **bare)
    full = draw(surface, scalars=lambda f, u, v: f, **bare)
    grey = np.ptp(half.astype(int), axis=2) < 12
    assert grey.mean() > (np.ptp(full.astype(int), axis=2) < 12).mean() + 0.1
    with pytest.raises(ValueError, match="finite"):
        ls.plot(surface, scalars=lambda f, u, v: np.nan * u, off_screen=True)


def test_bad_scalars():
    surface = ls.LimitSurface(cube())
    for options, match in [
        ({"scalars": "means"}, "'means'"),
        ({"scalars": np.zeros(7)}, r"\(8,\), got \(7,\)"),
        ({"scalars": lambda face, u, v: 1.0}, "as many values"),
        ({"scalars": lambda face, u, v: np.zeros((2, len(u)))}, r"as many .*, got \(2, "),
        ({"scalars": lambda face, u, v: "red"}, r"\(face, u, v\) returns must be real .*'red'"),
        ({"scalars": lambda face, u, v: 1j * u}, "must be real numbers"),
        ({"scalars": ["1"] * 8}, "scalars must be real numbers"),
        ({"scalars": "mean", "limits": (1, 0)}, "limits"),
        ({"scalars": "mean", "limits": (0, np.nan)}, "limits"),
        ({"scalars": "mean", "limits": "ab"}, "limits must be real numbers, got 'ab'"),
        ({"scalars": "mean", "cmap": "no such map"}, "no such map"),
        ({"scalars": "mean", "cmap": [1]}, r"cmap .*, got \[1\]"),
        ({"scalars": "mean", "label": 5}, "label must be text, got 5"),
        ({"isolines": -1}, "isolines"),
        ({"isolines": 1.5}, "isolines"),
        ({"view": "above"}, "'above'"),
        ({"view": (0, 0, 0)}, "view"),
        ({"view": (0, 1)}, "view"),
        ({"view": ("a", "b", "c")}, "view must be real numbers"),
    ]:
        with pytest.raises(ValueError, match=match):
            ls.plot(surface, off_screen=True, **options)


def test_stripes_of_a_zebra_have_kinks_at_creases_only():
    """The value is smooth across faces, and its slope too, but where there is a crease."""
    points, faces = zoo.cube()
    for sharp in (0, np.inf):
        mesh = ls.Mesh(np.asarray(points, dtype=float), faces, creases={(0, 1): sharp})
        scene = scene_of(ls.LimitSurface(mesh), scalars="zebra", n=8)
        places = scene.points.round(9)
        gaps = [
            np.ptp(scene.field.values[(places == place).all(axis=1)])
            for place in np.unique(places, axis=0)
        ]
        assert (max(gaps) > 0.1) == (sharp > 0)


# ------------------------------------------------------------------ curves and views


def test_isolines_are_exact():
    surface = dented()
    scene = scene_of(surface, isolines=2, cage=False, n=3)
    (inner, outer) = scene.lines
    unit = surface.with_points(scenes.unit_points(surface.mesh)[0])
    faces = len(surface.limit_faces)
    assert len(inner.ends) == faces * 2 * 2 * 3  # faces, directions, lines, pieces
    assert len(outer.ends) == faces * 2 * 2 * 3
    u, v = np.meshgrid([1 / 3, 2 / 3], [0, 1 / 3, 2 / 3, 1])
    expected = unit.evaluate(np.arange(faces)[:, None], u.ravel(), v.ravel()).reshape(-1, 3)
    found = {tuple(p) for p in inner.ends.reshape(-1, 3).round(9)}
    assert {tuple(p) for p in expected.round(9)} <= found


@pytest.mark.parametrize("up", "xyz")
def test_views(up):
    k = "xyz".index(up)
    rng = np.random.default_rng(1)
    points = rng.random((30, 3))
    for name in scenes.VIEWS:
        axes, _, _ = scenes.camera(points, up, name, 1.0)
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-14)
        assert np.linalg.det(axes) > 0
        assert axes[1, k] > 0 or name in ("top", "bottom")
        same, _, _ = scenes.camera(points, up, axes[2] * 5, 1.0)
        np.testing.assert_allclose(same, axes, atol=1e-14)
    opposite = [("front", "back"), ("left", "right"), ("top", "bottom")]
    for one, other in opposite:
        a, b = (scenes.camera(points, up, name, 1.0)[0][2] for name in (one, other))
        np.testing.assert_allclose(a, -b, atol=1e-14)
    assert scenes.camera(points, "z", "top", 1.0)[0][2].tolist() == [0, 0, 1]
    assert scenes.camera(points, "z", "front", 1.0)[0][2].tolist() == [0, -1, 0]


@pytest.mark.parametrize(
    ("up", "name", "back", "right"),
    [
        # as glTF, Maya and Blender have it: y up, the front faces +z
        ("y", "front", (0, 0, 1), (1, 0, 0)),
        ("y", "back", (0, 0, -1), (-1, 0, 0)),
        ("y", "right", (1, 0, 0), (0, 0, -1)),
        ("y", "left", (-1, 0, 0), (0, 0, 1)),
        ("y", "top", (0, 1, 0), (1, 0, 0)),
        ("y", "bottom", (0, -1, 0), (-1, 0, 0)),
        ("z", "front", (0, -1, 0), (1, 0, 0)),
        ("z", "back", (0, 1, 0), (-1, 0, 0)),
        ("z", "right", (1, 0, 0), (0, 1, 0)),
        ("z", "left", (-1, 0, 0), (0, -1, 0)),
        ("z", "top", (0, 0, 1), (1, 0, 0)),
        ("x", "front", (0, -1, 0), (0, 0, -1)),
        ("x", "top", (1, 0, 0), (0, 0, -1)),
    ],
)
def test_where_views_are_from(up, name, back, right):
    axes, _, _ = scenes.camera(np.random.default_rng(1).random((9, 3)), up, name, 1.0)
    np.testing.assert_allclose(axes[[2, 0]], [back, right], atol=1e-15)


# ------------------------------------------------------------------ Picture


def test_a_picture_is_an_array_and_a_file(tmp_path):
    if not render.opengl():
        pytest.skip("there is no OpenGL")
    picture = ls.plot(ls.LimitSurface(cube()), off_screen=True, window_size=SIZE)
    assert np.asarray(picture).shape == (*SIZE[::-1], 3)
    assert np.asarray(picture, dtype=float).dtype == float
    assert repr(picture) == "<Picture of 160 x 120 pixels>"
    picture.save(tmp_path / "a.PNG")
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "a.PNG")), picture.image)
    assert picture._repr_png_() == (tmp_path / "a.PNG").read_bytes()
    for name in ("a", "a.svg"):
        with pytest.raises(ValueError, match=r"\.png .*or \.html"):
            picture.save(tmp_path / name)


def test_a_notebook_shows_what_is_returned(monkeypatch):
    """In a kernel no window opens."""
    kernel = types.SimpleNamespace(kernel=None)
    monkeypatch.setitem(sys.modules, "IPython", types.SimpleNamespace(get_ipython=lambda: kernel))
    monkeypatch.setattr(render, "_display", lambda: True)
    monkeypatch.setattr(render, "window", lambda *_: 1 / 0)
    assert isinstance(ls.plot(ls.LimitSurface(cube())), ls.Picture)
    monkeypatch.setitem(sys.modules, "IPython", types.SimpleNamespace(get_ipython=lambda: None))
    with pytest.raises(ZeroDivisionError):
        ls.plot(ls.LimitSurface(cube()))


# ------------------------------------------------------------------ pages


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    if not render.opengl():
        pytest.skip("there is no OpenGL")
    path = tmp_path_factory.mktemp("page") / "scene.html"
    ls.plot(dented(), path, scalars="mean", poles=True, isolines=3, cage=True)
    return path


def test_a_page_needs_nothing_else(page):
    text = page.read_text(encoding="utf-8")
    assert [p.name for p in page.parent.iterdir()] == ["scene.html"]
    assert 1e6 < len(text) < 3e6
    assert "<title>limitsurf</title>" in text
    # addresses in the code of the viewer are comments; none of them is loaded
    assert not re.search(
        r"""<(?:script|link|img|iframe)[^>]*(?:src|href)\s*=\s*["'](?!data:)""", text
    )


def test_a_page_in_a_browser(page, tmp_path):
    found = browser.find()
    if found is None:
        pytest.skip("there is no Chromium with its driver")
    shot = tmp_path / "shot.png"
    switches = ["--headless", "--no-sandbox", "--use-angle=swiftshader", "--window-size=800,600"]
    switches += ["--enable-unsafe-swiftshader", "--virtual-time-budget=20000"]
    switches += [f"--user-data-dir={tmp_path / 'profile'}", "--proxy-server=127.0.0.1:9"]
    command = [found[0], *switches, f"--screenshot={shot}", page.as_uri()]
    subprocess.run(command, capture_output=True, check=True, timeout=120)
    image = np.asarray(Image.open(shot).convert("RGB")).astype(int)
    ground = tuple(bytes.fromhex(scenes.LIGHT.page[1:]))
    assert (image[5, 5] == ground).all()
    assert 0.15 < (image != ground).any(axis=2).mean() < 0.8
    bar = image[100:500, 620:]
    assert (bar[..., 2] - bar[..., 0] > 60).any()  # blue and red ends of the colour bar
    assert (bar[..., 0] - bar[..., 2] > 60).any()
    assert (image.max(axis=2) < 90).mean() > 0.005  # lines


def test_interactive_scenes_in_notebooks():
    if not render.opengl():
        pytest.skip("there is no OpenGL")
    picture = ls.plot(ls.LimitSurface(cube()), off_screen=True, window_size=SIZE)
    html = picture.interactive(height=300)._repr_html_()
    assert html.startswith("<iframe srcdoc=")
    assert "height:300px" in html
    flat = ls.plot_characteristic_map(valence=3, off_screen=True)
    with pytest.raises(ValueError, match="flat"):
        flat.interactive()


def test_without_trame(monkeypatch, tmp_path):
    for name in ("trame_vtk", "trame_vtk.modules.vtk"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ImportError, match=r'pip install "limitsurf\[plot\]"'):
        ls.plot(ls.LimitSurface(cube()), tmp_path / "a.html")
    assert not list(tmp_path.iterdir())


# ------------------------------------------------------------------ eigenfunctions


@pytest.mark.parametrize("valence", [3, 4, 5, 6, 8, 9, 12])
def test_eigenfunctions_scale_by_their_eigenvalue(valence):
    fan = Fan("catmull-clark", "interior", valence)
    modes = fan.modes()
    assert len(modes) == fan.size == 6 * valence + 1
    values = np.stack([mode.values for mode in modes], axis=1)
    assert np.linalg.cond(values) < 1e3  # they are a basis
    eigenvalues = np.array([mode.eigenvalue for mode in modes])
    u, v = np.random.default_rng(0).random((2, 50))
    face, surface = np.arange(valence)[:, None], fan.surface(values)
    whole, half = surface.evaluate(face, u, v), surface.evaluate(face, u / 2, v / 2)
    np.testing.assert_allclose(half, eigenvalues * whole, rtol=0, atol=1e-13)
    # those of the ring are the ones of `eigenbasis`, the others come once per sector
    table = ls.eigenbasis("catmull-clark", valence=valence).float64
    ring = np.sort(np.abs(table.eigenvalues))[::-1]
    found = np.abs(eigenvalues)
    assert all(np.abs(found - value).min() < 1e-9 for value in ring)
    np.testing.assert_allclose(found[:3], ring[:3], rtol=0, atol=1e-12)


def test_frequencies_are_waves_around_the_vertex():
    fan = Fan("catmull-clark", "interior", 7)
    for mode in fan.modes():
        ring = fan.surface(mode.values).evaluate(np.arange(7), 0.7, 0.7)
        spectrum = np.abs(np.fft.rfft(ring))
        others = np.delete(spectrum, mode.frequency)
        assert others.max() < 1e-12
        mirrored = fan.mirrored(mode.values)
        np.testing.assert_allclose(mirrored, -mode.values if mode.sine else mode.values, atol=1e-12)


@pytest.mark.parametrize(
    ("kind", "faces"),
    [
        *(("interior", n) for n in (3, 4, 5, 8, 20)),
        *(("crease", n) for n in (2, 3)),
        *(("corner", n) for n in (1, 2)),
        *(("dart", n) for n in (3, 4, 5, 8)),
    ],
)
def test_characteristic_maps(kind, faces):
    fan = Fan("catmull-clark", kind, faces)
    surface = fan.surface(fan.characteristic_map())
    face = np.arange(faces)[:, None]
    u, v = np.random.default_rng(0).random((2, 200))
    whole, half = surface.evaluate(face, u, v), surface.evaluate(face, u / 2, v / 2)
    ratios = (np.abs(half) ** 2).sum(axis=(0, 1)) / (np.abs(whole) ** 2).sum(axis=(0, 1))
    np.testing.assert_allclose(half, np.sqrt(ratios) * whole, rtol=0, atol=1e-13)
    table = fan.basis.float64
    expected = np.sort(table.eigenvalues[table.normal])
    np.testing.assert_allclose(np.sort(np.sqrt(ratios)), expected, rtol=1e-12)
    # one to one, and counter-clockwise
    du, dv = (surface.evaluate(face, u, v, nu=nu) for nu in ((1, 0), (0, 1)))
    assert (du[..., 0] * dv[..., 1] - du[..., 1] * dv[..., 0] > 0).all()


def test_vertices_without_a_characteristic_map():
    for kind, faces in (
        ("crease", 1),
        ("crease", 4),
        ("crease", 5),
        ("corner", 3),
        ("cone", 4),
        ("dart", 2),
    ):
        with pytest.raises(ValueError, match="no characteristic map"):
            ls.plot_characteristic_map(kind=kind, faces=faces, off_screen=True)


def test_vertices_without_eigenfunctions():
    with pytest.raises(ValueError, match=r"no basis of eigenvectors at interior valence 2: 1 of 1"):
        Fan("catmull-clark", "interior", 2).modes()
    with pytest.raises(ValueError, match="modes are those of a smooth vertex, not of a crease of"):
        Fan("catmull-clark", "crease", 3).modes()
    with pytest.raises(ValueError, match=r"no basis of eigenvectors at interior valence 3: 1 of 9"):
        Fan("loop", "interior", 3).modes()


@pytest.mark.parametrize("valence", [4, 5, 6, 8])
def test_eigenfunctions_of_triangles(valence):
    fan = Fan("loop", "interior", valence)
    modes = fan.modes()
    values = np.stack([mode.values for mode in modes], axis=1)
    assert np.linalg.matrix_rank(values) == len(modes) == fan.size == 3 * valence + 1
    face, (u, v) = np.arange(valence)[:, None], Net(TRIANGLES, 4).places
    large, small = (fan.surface(values).evaluate(face, x * u, x * v) for x in (1.0, 0.5))
    assert np.abs(small - [mode.eigenvalue for mode in modes] * large).max() < 1e-14
    # Loop 1987: 3/8 + cos(2 pi / N) / 4
    assert abs(modes[1].eigenvalue - 3 / 8 - math.cos(math.tau / valence) / 4) < 1e-14


def test_pictures_of_triangles():
    surface = ls.LimitSurface(ls.Mesh(*zoo.tetrahedron()), scheme="loop")
    options = {"off_screen": True, "window_size": (120, 90)}
    assert ls.plot(surface, isolines=2, normals=True, **options).image.any()
    assert ls.plot(surface, scalars="mean", **options).image.any()
    shown = scene_of(surface, n=3)
    assert shown.cells.shape == (36, 3)
    assert {dots.name for dots in shown.dots} == {"valence 3"}
    assert ls.plot_characteristic_map("loop", valence=5, **options).image.any()
    assert ls.plot_eigenfunctions("loop", valence=4, which=1, **options).image.any()
    assert ls.plot_convergence(surface, levels=2, **options).image.any()


def test_bad_calls_of_the_spectrum():
    for options in ({}, {"valence": 3, "kind": "dart"}, {"kind": "dart"}, {"faces": 3}):
        with pytest.raises(ValueError, match="either valence, or kind and faces"):
            ls.plot_characteristic_map(off_screen=True, **options)
    for valence in (2, 2.5, "5", True):
        with pytest.raises(ValueError, match="valence must be an integer >= 3"):
            ls.plot_characteristic_map(valence=valence, off_screen=True)
        with pytest.raises(ValueError, match="valence must be an integer >= 3"):
            ls.plot_eigenfunctions(valence=valence, off_screen=True)
    for faces in (0, 2.5, "2", True):
        with pytest.raises(ValueError, match="faces must be an integer >= 1"):
            ls.plot_characteristic_map(kind="crease", faces=faces, off_screen=True)
    for name in ("rings", "isolines"):
        with pytest.raises(ValueError, match=f"{name} must be an integer >= 0, got -1"):
            ls.plot_characteristic_map(valence=5, off_screen=True, **{name: -1})
    for which in (1.5, "a", True):
        with pytest.raises(ValueError, match="which must be an integer, got"):
            ls.plot_eigenfunctions(valence=5, which=which, off_screen=True)
    with pytest.raises(IndexError, match="31 eigenfunctions"):
        ls.plot_eigenfunctions(valence=5, which=31, off_screen=True)
    with pytest.raises(ValueError, match="unknown scheme"):
        ls.plot_eigenfunctions("no such scheme", valence=5, off_screen=True)


def test_the_file_is_the_second_argument_or_a_keyword():
    for name in (name for name in ls.__all__ if name.startswith("plot")):
        parameters = list(inspect.signature(getattr(ls, name)).parameters.values())
        assert (parameters[1].name, parameters[1].default) == ("file", None)
        assert {p.kind for p in parameters[2:]} == {inspect.Parameter.KEYWORD_ONLY}


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_diagrams_as_files(suffix, tmp_path):
    path = tmp_path / f"map{suffix}"
    ls.plot_characteristic_map(valence=3, file=path, window_size=(240, 240))
    start = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}[suffix]
    assert path.read_bytes().startswith(start)
    with pytest.raises(ValueError, match=r"\.png .*or \.svg or \.pdf"):
        ls.plot_convergence(ls.LimitSurface(cube()), tmp_path / "a.html", levels=1)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


# ------------------------------------------------------------------ convergence


def test_predicted_orders():
    for make, expected in [
        (zoo.cube(), np.log2(1 / 0.41009705)),
        (zoo.torus(5, 5), 2),
        (zoo.prism(5), np.log2(1 / 0.54998835)),
        (zoo.grid(3, 3), 2),
    ]:
        assert predicted_order(surface_of(*make)) == pytest.approx(expected, abs=1e-6)


def refined_two_ring(fan):
    """One refinement of the points of a fan to those of half its size, (M, M)."""
    cage = fan.surface(np.zeros((fan.size, 1))).mesh
    fine, rows = ls.refined(cage, scheme="catmull-clark", operator=True)
    child = fine.indices.reshape(-1, 4, 4)[: fan.faces]  # of the inner faces, from each corner on
    at = np.empty_like(fan.number)
    corners = [[(0, 0), (1, 0), (1, 1), (0, 1)], [(2, 0), (2, 1), (1, 1), (1, 0)]]
    corners += [[(2, 2), (1, 2), (1, 1), (2, 1)], [(0, 2), (0, 1), (1, 1), (1, 2)]]
    for k, places in enumerate(corners):
        for corner, (i, j) in enumerate(places):
            at[:, i, j] = child[:, k, corner]
    origin = np.empty(fan.size, dtype=int)
    origin[fan.number] = at
    return rows.toarray()[origin]


@pytest.mark.parametrize(
    ("kind", "faces"),
    [("interior", 3), ("interior", 4), ("interior", 7), ("cone", 6), ("crease", 3), ("dart", 5)],
)
def test_orders_are_those_of_the_refiner(kind, faces):
    fan = Fan("catmull-clark", kind, faces)
    eigenvalues, vectors = np.linalg.eig(refined_two_ring(fan))
    parts = np.concatenate([vectors.real, vectors.imag], axis=1)
    face, ends = np.arange(faces)[:, None, None], np.array([0.0, 1.0])
    limits = fan.surface(parts).evaluate(face, ends[:, None], ends)
    gaps = np.abs(parts[fan.number[:, :2, :2]] - limits).max(axis=(0, 1, 2))
    slowest = np.abs(eigenvalues[gaps.reshape(2, -1).max(axis=0) > 1e-6]).max()
    assert order_at("catmull-clark", kind, faces) == pytest.approx(-np.log2(slowest), abs=1e-9)


def test_the_order_of_a_jordan_chain():
    """At a sharp corner of two faces, 1/2: what heads the chain moves, what ends it does not."""
    fan = Fan("catmull-clark", "corner", 2)
    surface = fan.surface(np.random.default_rng(1).normal(size=(fan.size, 3)))
    assert predicted_order(surface) == pytest.approx(1, abs=1e-12)
    assert ls.validate(surface, 7)["order"][-1] == pytest.approx(1, abs=0.01)


def test_the_order_at_a_pole_of_many_faces():
    table = ls.eigenbasis("catmull-clark", valence=200).float64
    first = table.eigenvalues[table.normal[0]]
    assert order_at("catmull-clark", "interior", 200) == pytest.approx(-np.log2(first), abs=1e-9)


@pytest.mark.parametrize("valence", [3, 5, 9])
def test_observed_orders_are_those_predicted(valence):
    """On a cage that is nothing but the slowest eigenfunctions; regular ones have order 2."""
    fan = Fan("catmull-clark", "interior", valence)
    surface = fan.surface(fan.characteristic_map())
    orders = ls.validate(surface, 4)["order"]
    assert orders[-1] == pytest.approx(predicted_order(surface), abs=0.01)


def test_convergence_of_nothing():
    with pytest.raises(ValueError, match="at least one surface"):
        ls.plot_convergence({}, off_screen=True)
    with pytest.raises(ValueError, match="levels"):
        ls.plot_convergence(ls.LimitSurface(cube()), levels=0, off_screen=True)
