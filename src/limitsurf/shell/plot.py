"""Pictures of a limit surface.

The surface is drawn from values of itself: a grid of exact positions and normals on each limit
face, under its cage, with the extraordinary points marked by valence. PyVista draws, off screen or
in a window. Where there is no OpenGL at all, for which VTK has no answer but a crash, Matplotlib
paints the same scene, polygon by polygon from back to front.
"""

from __future__ import annotations

import functools
import math
import os
import subprocess
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf.shell.files import replacing
from limitsurf.shell.io import _pyvista

if TYPE_CHECKING:
    from limitsurf.surface import LimitSurface

__all__ = ["plot"]

Array: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
Image: TypeAlias = NDArray[np.uint8]
Color: TypeAlias = str | tuple[float, float, float]

COLOR = "#e8805f"
QUADS = 200_000  # drawn in all, unless told otherwise
SUPERSAMPLING = 2  # pixels drawn per pixel of the picture, each way
VIEW = (-0.35, -1.0, 0.6)  # where the camera stands, for z up
LIGHTS = [  # towards the light in the camera's axes (right, up, back), and its strength
    ((-0.45, 0.65, 0.62), 0.64),
    ((0.78, -0.10, 0.62), 0.28),
    ((0.10, 0.50, -0.86), 0.20),
]
AMBIENT, GLOSS, SHARPNESS = 0.24, 0.25, 18
VIEW_ANGLE = 30.0  # degrees, of the picture's height
DOT = 13.0  # diameter of a dot, in thousandths of the picture's height
MARGIN = 0.06  # of the picture, on each side
POINT = 72 / 100  # Matplotlib's unit of lengths in pixels, at 100 dots per inch
GROUND, SKY, INK = "#dde5ec", "#ffffff", "#263442"
CREASE = 3.0  # thickness of creases, in thousandths of the picture's height
LIFT = 0.0015  # of curves off the surface, in units of the cage
NEEDLE = 0.04  # length of a normal, in units of the cage
CROWD = 10_000  # limit faces; of more, cage and curves would hide the surface
FEW = 1_000  # limit faces; of more, dots are smaller
VALENCES = {  # the largest of each class: its name and colour
    2: ("valence 2", "#17becf"),
    3: ("valence 3", "#1f6fc4"),
    5: ("valence 5", "#f5b82e"),
    6: ("valence 6", "#2e9e5b"),
    7: ("valence 7", "#e377c2"),
    8: ("valence 8", "#7d3fb0"),
    16: ("valence 9 to 16", "#c2185b"),
    math.inf: ("valence 17 and more", "#111111"),
}


@dataclass(frozen=True)
class _Lines:
    ends: Array  # (k, 2, 3)
    color: Color
    width: float  # thousandths of the picture's height


@dataclass(frozen=True)
class _Dots:
    places: Array  # (k, 3)
    color: str
    name: str


@dataclass(frozen=True)
class _Scene:
    """What is drawn, in units of the cage: its largest extent is 1."""

    points: Array  # (p, 3)
    normals: Array  # (p, 3)
    quads: IntArray  # (q, 4)
    color: tuple[float, float, float]
    lines: list[_Lines]
    dots: list[_Dots]
    dot: float  # their diameter, thousandths of the picture's height
    axes: Array  # (3, 3), rows right, up, towards the viewer
    eye: Array  # (3,)
    distance: float  # from the eye to the middle of the scene


def plot(
    surface: LimitSurface,
    screenshot: str | os.PathLike[str] | None = None,
    *,
    n: int | None = None,
    cage: bool | None = None,
    curves: bool | None = None,
    poles: bool = True,
    normals: bool = False,
    channel: str | None = None,
    color: str = COLOR,
    up: str = "z",
    window_size: tuple[int, int] = (1600, 1200),
    off_screen: bool | None = None,
) -> Image:
    """Draw a limit surface, with its cage, creases and extraordinary points.

    Every point drawn is an exact one with its exact normal; only what lies between them is
    interpolated. Limit faces without a surface (holes) are left out.

    Parameters
    ----------
    surface : LimitSurface
        Points of shape (n_vertices, 3), or (n_vertices, 2) for a flat one. Exact points are
        rounded to float64.
    screenshot : str or os.PathLike, optional
        A PNG file to write, off screen. It appears whole or not at all.
    n : int, optional
        Each limit face is drawn as n x n quads; by default as many as make a smooth picture.
    cage, curves, poles, normals : bool
        Whether to draw the cage, its creases in thick lines; the edges of the limit faces; the
        limits of extraordinary vertices and the centres of faces that are no quads; the normal at
        the centre of each limit face. By default cage and curves are drawn unless they would hide
        the surface.
    channel : str, optional
        A face-varying channel of two or three numbers to draw instead of the points: of texture
        coordinates the layout, torn along its seams.
    color : str
        The colour of the surface, "#rrggbb" or a name.
    up : {"x", "y", "z"}
        The axis that points up in the picture.
    window_size : (int, int)
        Width and height in pixels.
    off_screen : bool, optional
        Whether to draw without a window. By default that is so if ``screenshot`` is given;
        otherwise a window opens, and the call returns when it is closed.

    Returns
    -------
    ndarray of uint8, shape (height, width, 3)
        The picture.

    Raises
    ------
    ValueError
        Points of another shape, a channel that the mesh does not have, a bad ``n``, ``up`` or
        ``window_size``, a name that does not end in .png, nothing to draw.
    ImportError
        Without PyVista (``pip install "limitsurf[plot]"``).
    OSError
        A file that cannot be written; no display to open a window on.

    Warns
    -----
    UserWarning
        Without OpenGL: the picture is painted by Matplotlib, and plainer.

    Examples
    --------
    >>> import limitsurf as ls
    >>> quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    >>> cube = ls.Mesh([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], quads)
    >>> image = ls.plot(ls.LimitSurface(cube), off_screen=True, window_size=(320, 240))
    >>> image.shape
    (240, 320, 3)
    """
    if screenshot is not None and os.path.splitext(os.fspath(screenshot))[1].lower() != ".png":
        raise ValueError(f"a picture is written as .png, got {os.fspath(screenshot)!r}")
    if n is not None and n < 1:
        raise ValueError(f"n must be at least 1, got {n}")
    if up not in ("x", "y", "z"):
        raise ValueError(f"up must be 'x', 'y' or 'z', got {up!r}")
    width, height = window_size
    if min(width, height) < 1:
        raise ValueError(f"window_size must be positive, got {width} x {height}")
    if off_screen is None:
        off_screen = screenshot is not None
    if not off_screen and not _display():
        raise OSError(
            "there is no display to open a window on; give the name of a picture to write"
        )
    pyvista = _pyvista()
    try:
        body = pyvista.Color(color).float_rgb
    except ValueError:
        raise ValueError(f"unknown color {color!r}") from None
    drawn = surface.of_channel(channel)
    scene = _scene(drawn, n, cage, curves, poles, normals, body, up, width / height)
    if off_screen and not _opengl():
        warnings.warn("no OpenGL here: painted by Matplotlib, and plainer", stacklevel=2)
        image = _painted(scene, width, height)
    else:
        with _calm_vtk():
            image = _rendered(pyvista, scene, width, height, off_screen)
    if scene.dots and off_screen:
        image = _with_legend(image, scene.dots)
    if screenshot is not None:
        from PIL import Image as images

        with replacing(screenshot) as file:
            images.fromarray(image).save(file, format="PNG")
    return image


def _scene(
    surface: LimitSurface,
    n: int | None,
    cage: bool | None,
    curves: bool | None,
    poles: bool,
    normals: bool,
    color: tuple[float, float, float],
    up: str,
    aspect: float,
) -> _Scene:
    mesh = surface.mesh
    places = _unit_points(mesh)
    surface = surface.with_points(places)
    faces = len(surface.limit_faces)
    if n is None:
        n = int(np.clip(math.sqrt(QUADS / faces), 1, 32))
    at = np.linspace(0.0, 1.0, n + 1)
    query = (np.arange(faces)[:, None, None], at[:, None], at)
    position = surface.evaluate(*query)  # (faces, n + 1, n + 1, 3)
    normal = _drawable_normals(surface, query)
    number = np.arange(faces * (n + 1) ** 2).reshape(faces, n + 1, n + 1)
    quads = np.stack(
        [number[:, :-1, :-1], number[:, 1:, :-1], number[:, 1:, 1:], number[:, :-1, 1:]], axis=-1
    ).reshape(-1, 4)
    points = position.reshape(-1, 3)
    quads = quads[np.isfinite(points[quads]).all(axis=(1, 2))]
    if not len(quads):
        raise ValueError("nothing to draw: no limit face has a surface")

    lines, dots = [], []
    crowded = faces > CROWD
    if curves or (curves is None and not crowded):
        # Both sides, so that the curves of an open surface show from within as well.
        edges = [position + side * LIFT * normal for side in (1, -1)]
        borders = [
            border
            for grid in edges
            for border in (grid[:, 0], grid[:, -1], grid[:, :, 0], grid[:, :, -1])
        ]
        ends = np.stack([np.stack([b[:, :-1], b[:, 1:]], axis=2) for b in borders])
        dark = (0.5 * color[0], 0.5 * color[1], 0.5 * color[2])
        lines.append(_Lines(ends.reshape(-1, 2, 3), dark, 0.9))
    if normals:
        centre = (np.arange(faces), 0.5, 0.5)
        foot = surface.evaluate(*centre)  # (faces, 3)
        tip = foot + NEEDLE * surface.normal(*centre)
        lines.append(_Lines(np.stack([foot, tip], axis=1), VALENCES[3][1], 1.1))
    if cage or (cage is None and not crowded):
        lines.append(_Lines(places[mesh.edges], INK, 1.0))
        lines.append(_Lines(places[mesh.creases[0][mesh.creases[1] > 0]], INK, CREASE))
    if poles:
        dots = _poles(surface)
    lines = [_Lines(k.ends[np.isfinite(k.ends).all(axis=(1, 2))], k.color, k.width) for k in lines]
    lines = [k for k in lines if len(k.ends)]

    seen = [points[quads].reshape(-1, 3), *(k.ends.reshape(-1, 3) for k in lines)]
    axes, eye, distance = _camera(np.concatenate(seen), up, aspect)
    dot = DOT * min(1.0, (FEW / faces) ** 0.25)
    return _Scene(
        points, normal.reshape(-1, 3), quads, color, lines, dots, dot, axes, eye, distance
    )


def _unit_points(mesh: Any) -> Array:
    """The cage's points, (n_vertices, 3), moved and scaled to the unit box.

    A graphics card counts in 24 bits: a small cage far from the origin would come out in steps,
    and a large one overflow.
    """
    points = np.asarray(mesh.points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise ValueError(f"points of shape (n_vertices, 2 or 3) can be drawn, got {points.shape}")
    used = np.unique(mesh.indices)
    places = points[used] / max(np.abs(points[used]).max(), np.finfo(np.float64).tiny)
    low, high = places.min(axis=0), places.max(axis=0)
    scaled = np.zeros((len(points), 3))
    scaled[used, : points.shape[1]] = (places - (low + high) / 2) / (np.max(high - low) or 1.0)
    return scaled


def _drawable_normals(surface: LimitSurface, query: tuple[IntArray, Array, Array]) -> Array:
    """Normals, with that of a nearby point where there is none."""
    normal: Array = surface.normal(*query)  # (..., 3)
    face, u, v = np.broadcast_arrays(*query)
    for inward in (0.02, 0.5):
        missing = np.isnan(normal).any(axis=-1)
        u, v = u + inward * (0.5 - u), v + inward * (0.5 - v)
        normal[missing] = surface.normal(face[missing], u[missing], v[missing])
    normal[np.isnan(normal).any(axis=-1)] = (0.0, 0.0, 1.0)
    return normal


def _poles(surface: LimitSurface) -> list[_Dots]:
    """Limits of the interior vertices of valence other than 4, and centres of faces with other
    than four corners, which are such vertices of the refined cage."""
    mesh, first = surface.mesh, surface.limit_faces.first
    inside = ~(mesh.boundary_vertex | mesh.nonmanifold_vertex)
    valence = np.where(inside, mesh.vertex_faces, 4)
    corner = np.flatnonzero(valence[mesh.indices] != 4)
    vertex, face = mesh.indices[corner], mesh.corner_face[corner]
    place = corner - mesh.offsets[face]  # of the vertex in its face
    quad = mesh.sizes[face] == 4
    polygon = np.flatnonzero(mesh.sizes != 4)
    centre = np.ones(len(polygon))
    at = surface.evaluate(
        np.concatenate([first[face] + np.where(quad, 0, place), first[polygon]]),
        np.concatenate([quad & np.isin(place, (1, 2)), centre]),
        np.concatenate([quad & np.isin(place, (2, 3)), centre]),
    )  # (k, 3)
    # One face with a limit is enough, and all of them agree.
    finite = np.flatnonzero(np.isfinite(at).all(axis=1))
    names = np.concatenate([vertex, mesh.n_vertices + polygon])[finite]
    chosen = finite[np.unique(names, return_index=True)[1]]
    group = np.searchsorted(
        np.array(list(VALENCES)), np.concatenate([valence[vertex], mesh.sizes[polygon]])[chosen]
    )
    return [
        _Dots(at[chosen[group == i]], color, name)
        for i, (name, color) in enumerate(VALENCES.values())
        if (group == i).any()
    ]


def _camera(points: Array, up: str, aspect: float) -> tuple[Array, Array, float]:
    """The axes of a camera that sees all points as large as they fit, its place, its distance."""
    upward = "xyz".index(up)
    back, above = np.roll(VIEW, upward - 2), np.eye(3)[upward]
    extent = np.ptp(points, axis=0)
    if extent.min() < 1e-2 * extent.max():  # flat: seen straight from its front
        flat = int(extent.argmin())
        back = np.eye(3)[flat]
        above = np.eye(3)[upward if upward != flat else (flat + 2) % 3]
    right = np.cross(above, back)
    axes = np.stack([right, np.cross(back, right), back])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    local = points @ axes.T  # (k, 3)
    slope = math.tan(math.radians(VIEW_ANGLE / 2)) * (1 - 2 * MARGIN) * np.array([aspect, 1.0])
    # |x - centre| <= slope * (distance - z) for all points: the least distance and its centre.
    high = (local[:, :2] + local[:, 2:] * slope).max(axis=0)
    low = (local[:, :2] - local[:, 2:] * slope).min(axis=0)
    depth = max(*((high - low) / (2 * slope)), local[:, 2].max() + 0.01)
    middle = (local[:, 2].min() + local[:, 2].max()) / 2
    eye = np.array([*(high + low) / 2, depth])
    return axes, eye @ axes, depth - middle


def _rendered(pyvista: Any, scene: _Scene, width: int, height: int, off_screen: bool) -> Image:
    # An off-screen picture is drawn larger and averaged, which smooths lines and dots as well.
    scale = SUPERSAMPLING if off_screen else 1
    size = (scale * width, scale * height)
    # None leaves PYVISTA_OFF_SCREEN its say.
    plotter = pyvista.Plotter(off_screen=off_screen or None, window_size=size, lighting=None)
    try:
        for place, strength in LIGHTS:
            light = pyvista.Light(position=place, light_type="camera light", intensity=strength)
            plotter.add_light(light)
        plotter.set_background(GROUND, top=SKY)
        body = pyvista.PolyData.from_regular_faces(scene.points, scene.quads)
        body.point_data.active_normals = scene.normals
        plotter.add_mesh(
            body,
            color=scene.color,
            smooth_shading=True,
            ambient=AMBIENT,
            diffuse=1.0,
            specular=GLOSS,
            specular_power=SHARPNESS,
        )
        for lines in scene.lines:
            ends = lines.ends.reshape(-1, 3)
            cells = np.arange(len(ends)).reshape(-1, 2)
            wires = pyvista.PolyData(ends, lines=np.insert(cells, 0, 2, axis=1))
            thickness = size[1] * lines.width / 1000
            plotter.add_mesh(wires, color=lines.color, line_width=thickness, lighting=False)
        for dots in scene.dots:
            plotter.add_mesh(
                pyvista.PolyData(dots.places),
                color=dots.color,
                point_size=size[1] * scene.dot / 1000,
                render_points_as_spheres=True,
                ambient=0.5,
            )
        camera = plotter.camera
        camera.view_angle = VIEW_ANGLE
        camera.position = scene.eye
        camera.focal_point = scene.eye - scene.distance * scene.axes[2]
        camera.up = scene.axes[1]
        plotter.reset_camera_clipping_range()
        if off_screen:
            image = plotter.screenshot(return_img=True)
        else:
            plotter.enable_anti_aliasing("msaa")
            if scene.dots:
                names = [(dots.name, dots.color) for dots in scene.dots]
                plotter.add_legend(names, face="circle", bcolor=None, loc="lower right")
            image = plotter.show(auto_close=False, screenshot=True)
    finally:
        plotter.close()
    picture: Image = np.asarray(image)
    if off_screen:
        tiles = picture.reshape(height, scale, width, scale, 3)
        picture = np.rint(tiles.mean(axis=(1, 3))).astype(np.uint8)
    return picture


def _painted(scene: _Scene, width: int, height: int) -> Image:
    """The scene without OpenGL: flat polygons, painted over each other from back to front."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgb
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width / 100, height / 100), dpi=100)
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, width), ylim=(0, height))
    axes.set_axis_off()
    shade = np.linspace(to_rgb(GROUND), to_rgb(SKY), 256)[:, None]
    axes.imshow(shade, extent=(0, width, 0, height), origin="lower", aspect="auto")

    # All is quads: a line is one pinched to its ends, a dot a star of two, and both get a rounded
    # edge of their thickness. They stand in front of the quad that they lie on.
    focal = height / 2 / math.tan(math.radians(VIEW_ANGLE / 2))  # pixels
    dot = scene.dot * height / 1000
    # Quads (k, 4, 3), colours (k or 1, 3), width of the edge in pixels, how much nearer.
    layers = [(scene.points[scene.quads], _lit(scene), 0.6, 0.0)]
    for lines in scene.lines:
        pieces = _cut(lines.ends)[:, [0, 1, 1, 0]]
        layers.append((pieces, np.array([to_rgb(lines.color)]), lines.width * height / 1000, 0.001))
    for dots in scene.dots:
        turn = np.arange(8).reshape(4, 2).T * math.tau / 8
        star = np.stack([np.cos(turn), np.sin(turn)], axis=-1) @ scene.axes[:2]  # (2, 4, 3)
        pixel = (scene.eye - dots.places) @ scene.axes[2] / focal  # its size at each dot
        squares = dots.places[:, None, None] + 0.2 * dot * pixel[:, None, None, None] * star
        layers.append((squares.reshape(-1, 4, 3), np.array([to_rgb(dots.color)]), 0.6 * dot, 0.01))
    number = [len(layer[0]) for layer in layers]
    local = (np.concatenate([layer[0] for layer in layers]) - scene.eye) @ scene.axes.T  # (k, 4, 3)
    order = np.argsort(
        local[..., 2].mean(axis=1) + np.repeat([layer[3] for layer in layers], number)
    )
    flat = np.array([width, height]) / 2 - focal * local[..., :2] / local[..., 2:]
    colors = [np.broadcast_to(layer[1], (k, 3)) for layer, k in zip(layers, number, strict=True)]
    color = np.concatenate(colors)[order]
    axes.add_collection(
        PolyCollection(
            flat[order],  # type: ignore[arg-type]
            facecolors=color,
            edgecolors=color,
            linewidths=POINT * np.repeat([layer[2] for layer in layers], number)[order],
            joinstyle="round",
            capstyle="round",
            snap=False,
        )
    )
    canvas.draw()
    return np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[:, :, :3])


def _with_legend(image: Image, dots: list[_Dots]) -> Image:
    """The picture with the colours of the dots explained in its lower right corner."""
    from PIL import Image as images
    from PIL import ImageDraw, ImageFont

    fine = 4  # drawn larger and shrunk, for smooth edges
    line = 0.034 * image.shape[0] * fine
    font = ImageFont.load_default(0.65 * line)
    width = max(font.getlength(k.name) for k in dots) + 2 * line
    legend = images.new("RGBA", (math.ceil(width), math.ceil((len(dots) + 0.5) * line)))
    draw = ImageDraw.Draw(legend)
    for k, kind in enumerate(dots):
        y = (k + 0.5) * line
        draw.ellipse((0.3 * line, y - 0.22 * line, 0.74 * line, y + 0.22 * line), fill=kind.color)
        draw.text((1.1 * line, y), kind.name, fill=INK, font=font, anchor="lm")
    legend = legend.resize((legend.width // fine, legend.height // fine), images.Resampling.BOX)
    picture = images.fromarray(image)
    corner = (picture.width - legend.width, picture.height - legend.height)
    picture.paste(legend, corner, legend)
    return np.asarray(picture)


def _cut(ends: Array) -> Array:
    """Lines cut into pieces short enough to be sorted by depth."""
    pieces = int(np.clip(100_000 // max(len(ends), 1), 1, 16))
    at = np.linspace(0.0, 1.0, pieces + 1)[:, None, None]
    line = ends[:, 0] + at * (ends[:, 1] - ends[:, 0])  # (pieces + 1, k, 3)
    return np.stack([line[:-1], line[1:]], axis=2).reshape(-1, 2, 3)


def _lit(scene: _Scene) -> Array:
    """The colour of each quad, (q, 3), under a key light, a fill light and a back light."""
    normal = scene.normals[scene.quads].mean(axis=1)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    toward = scene.eye - scene.points[scene.quads].mean(axis=1)
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    normal *= np.where(np.sum(normal * toward, axis=1, keepdims=True) < 0, -1.0, 1.0)
    light = np.array([place for place, _ in LIGHTS]) @ scene.axes
    strength = np.array([strength for _, strength in LIGHTS])
    diffuse = np.maximum(normal @ light.T, 0.0) @ strength
    half = toward + light[0]
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    gloss = GLOSS * np.maximum(np.sum(normal * half, axis=1), 0.0) ** SHARPNESS
    colors: Array = (AMBIENT + diffuse)[:, None] * scene.color + gloss[:, None]
    return np.clip(colors, 0.0, 1.0)


def _display() -> bool:
    if sys.platform != "linux":
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


@functools.cache
def _opengl() -> bool:
    """Whether VTK can draw here. Where it cannot it crashes, so another process finds out."""
    if sys.platform != "linux":
        return True
    trial = (
        "import vtkmodules.vtkRenderingOpenGL2\n"
        "from vtkmodules.vtkRenderingCore import vtkRenderWindow\n"
        "window = vtkRenderWindow()\n"
        "window.SetOffScreenRendering(1)\n"
        "window.Render()\n"
        "raise SystemExit(not window.SupportsOpenGL())\n"
    )
    run = subprocess.run([sys.executable, "-c", trial], capture_output=True, check=False)
    return run.returncode == 0


@contextmanager
def _calm_vtk() -> Iterator[None]:
    """Keep VTK from warning on stderr that it has no X server before it does without."""
    from vtkmodules.vtkCommonCore import vtkLogger

    before = vtkLogger.GetCurrentVerbosityCutoff()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)
    try:
        yield
    finally:
        vtkLogger.SetStderrVerbosity(vtkLogger.ConvertToVerbosity(int(before)))
