"""Pictures: both painters, odd cages, files."""

import subprocess
import sys
from contextlib import nullcontext
from fractions import Fraction

import make_demo_cage
import numpy as np
import pytest
import zoo
from PIL import Image

import limitsurf as ls
from limitsurf.shell import plot as room

SIZE = (160, 120)
PAINTED = "painted by Matplotlib"


@pytest.fixture(params=["rendered", "painted"])
def draw(request, monkeypatch):
    """``plot`` at a small size, by either painter."""
    if request.param == "rendered" and not room._opengl():
        pytest.skip("there is no OpenGL")
    monkeypatch.setattr(room, "_opengl", lambda: request.param == "rendered")
    monkeypatch.setattr(room, "QUADS", 2_000)

    def small(surface, screenshot=None, **options):
        options = {"window_size": SIZE, "off_screen": True, **options}
        rendered = request.param == "rendered"
        with nullcontext() if rendered else pytest.warns(UserWarning, match=PAINTED):
            return ls.plot(surface, screenshot, **options)

    return small


def cube(**tags):
    points, faces = zoo.cube()
    return ls.Mesh(np.asarray(points, dtype=float), faces, **tags)


def surface_of(points, faces, **tags):
    return ls.LimitSurface(ls.Mesh(points, faces, **tags))


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
    if not room._opengl():
        pytest.skip("there is no OpenGL")
    surface = ls.LimitSurface(ls.read(make_demo_cage.FILE))
    rendered = ls.plot(surface, off_screen=True, window_size=(320, 240), n=8)
    monkeypatch.setattr(room, "_opengl", lambda: False)
    with pytest.warns(UserWarning, match=PAINTED):
        painted = ls.plot(surface, off_screen=True, window_size=(320, 240), n=8)
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
    options = {"cage": True, "curves": False, "poles": False, "normals": False}
    scene = room._scene(surface, 1, *options.values(), (1.0, 0.5, 0.3), "z", 1.0)
    cage, creases = scene.lines
    assert len(cage.ends) == 12
    (edge,) = creases.ends
    assert sorted(map(tuple, edge)) == sorted(map(tuple, surface.mesh.points[:2] - 0.5))
    assert creases.width > cage.width


def test_a_channel_is_drawn_in_its_own_space(draw):
    square = [[0, 0], [1, 0], [1, 1], [0, 1]]
    flat = ls.Mesh(np.pad(square, ((0, 0), (0, 1))), [[0, 1, 2, 3]])
    uv = (np.array(square) * 0.1 + 7, [0, 1, 2, 3], "corners_only")
    painted = ls.Mesh(cube().points[[0, 1, 3, 2]], [[0, 1, 2, 3]], channels={"uv": uv})
    assert alike(draw(ls.LimitSurface(painted), channel="uv"), draw(ls.LimitSurface(flat)), 0.1)
    with pytest.raises(ValueError, match="no channel 'st'; it has 'uv'"):
        ls.plot(ls.LimitSurface(painted), channel="st", off_screen=True)


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
    count = {dots.name: len(dots.places) for dots in room._poles(ls.LimitSurface(mesh))}
    inside = mesh.vertex_faces[~mesh.boundary_vertex]
    assert count == {
        "valence 3": (inside == 3).sum() + (mesh.sizes == 3).sum(),
        "valence 5": (inside == 5).sum() + (mesh.sizes == 5).sum(),
        "valence 6": (mesh.sizes == 6).sum(),
        "valence 8": 1,
        "valence 9 to 16": 1,
    }


def test_poles_are_where_the_surface_is_smooth_and_closed():
    points, faces = zoo.disjoint(zoo.NONMANIFOLD["fin"][:2], zoo.cube())
    (dots,) = room._poles(ls.LimitSurface(ls.Mesh(points, faces)))
    assert (dots.name, len(dots.places)) == ("valence 3", 8)


def test_poles_sit_where_all_their_faces_meet():
    mesh = cube(holes=[0])  # some of the faces around each vertex have no limit
    (dots,) = room._poles(ls.LimitSurface(mesh))
    centre = mesh.points.mean(axis=0)
    places = {tuple(p) for p in dots.places.round(12)}
    assert places == {tuple(p) for p in ((mesh.points - centre) / 2 + centre).round(12)}


@pytest.mark.parametrize("up", "xyz")
def test_the_camera_sees_everything(up):
    rng = np.random.default_rng(0)
    for _ in range(20):
        points = rng.random((30, 3)) * 10 ** rng.uniform(-1, 1, 3)
        aspect = rng.uniform(0.3, 3)
        axes, eye, distance = room._camera(points, up, aspect)
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-14)
        local = (points - eye) @ axes.T
        slope = np.tan(np.radians(room.VIEW_ANGLE / 2)) * (1 - 2 * room.MARGIN)
        reach = np.abs(local[:, :2] / -local[:, 2:]) / slope / [aspect, 1]
        assert distance > 0
        assert (local[:, 2] < 0).all()
        assert reach.max() == pytest.approx(1)  # the picture is full


def test_bad_calls(tmp_path):
    surface = ls.LimitSurface(cube())
    for options, match in [
        ({"n": 0}, "n must be"),
        ({"up": "w"}, "up must be"),
        ({"window_size": (0, 9)}, "window_size"),
        ({"color": "no such color"}, "no such color"),
        ({"screenshot": "a.jpg"}, "a.jpg"),
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
    monkeypatch.setattr(room, "_rendered", lambda *_: np.zeros((9, 9, 3), np.uint8))
    monkeypatch.setattr(room, "_opengl", lambda: True)
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
    crash = subprocess.CompletedProcess([], -11)
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: crash)
    room._opengl.cache_clear()
    assert not room._opengl()
    room._opengl.cache_clear()


def test_a_window(monkeypatch):
    """As far as it goes without a screen: PYVISTA_OFF_SCREEN is set for the whole suite."""
    if not room._opengl():
        pytest.skip("there is no OpenGL")
    monkeypatch.setattr(room, "_display", lambda: True)
    image = ls.plot(ls.LimitSurface(cube()), window_size=SIZE)
    assert image.shape == (*SIZE[::-1], 3)
    assert colored(image) > 0.1
    monkeypatch.setattr(room, "_display", lambda: False)
    with pytest.raises(OSError, match="display"):
        ls.plot(ls.LimitSurface(cube()))
