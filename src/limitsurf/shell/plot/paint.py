"""What Matplotlib draws of a scene: legend and colour bar; all of it where there is no OpenGL."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf.shell.plot import scene as scenes
from limitsurf.shell.plot.scene import Array, Dots, Field, Scene

Image: TypeAlias = NDArray[np.uint8]

LIGHTS = [  # towards the light in the camera's axes (right, up, back), and its strength
    ((-0.45, 0.65, 0.62), 0.54),
    ((0.50, -0.15, 0.85), 0.44),
    ((0.10, 0.50, -0.86), 0.20),
]
AMBIENT, DIFFUSE, GLOSS, SHARPNESS = 0.27, 1.0, 0.25, 18
COLORED = (0.45, 0.72, 0.08)  # ambient, diffuse, gloss where colours must match those of a bar
POINT = 72 / 100  # Matplotlib's unit of lengths in pixels, at 100 dots per inch
BAR = 0.24  # width of the strip of a colour bar, as a part of the picture's height
GAP = 0.02  # around legends, the same


def material(scene: Scene) -> tuple[float, float, float]:
    """Strength of ambient and diffuse light and of gloss."""
    return (AMBIENT, DIFFUSE, GLOSS) if scene.field is None else COLORED


def ground(scene: Scene) -> tuple[str, str]:
    """Colours behind a scene, at the bottom and at the top."""
    look = scene.look
    return (look.paper, look.paper) if scene.flat else (look.ground, look.sky)


def colormap(field: Field) -> Any:
    """The Matplotlib colour map of a field."""
    from matplotlib import colormaps
    from matplotlib.colors import Colormap, ListedColormap

    if isinstance(field.cmap, str) and field.cmap == "zebra":
        band = np.arange(2048) * 2 * scenes.STRIPES // 2048 % 2
        return ListedColormap(np.array(scenes.ZEBRA)[band].tolist())
    found = field.cmap if isinstance(field.cmap, Colormap) else colormaps[field.cmap]
    return found.with_extremes(bad=scenes.MISSING)


def painted(scene: Scene, width: int, height: int) -> Image:
    """The scene without OpenGL: flat polygons, painted over each other from back to front."""
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgb
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width / 100, height / 100), dpi=100)
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, width), ylim=(0, height))
    axes.set_axis_off()
    below, above = ground(scene)
    shade = np.linspace(to_rgb(below), to_rgb(above), 256)[:, None]
    axes.imshow(shade, extent=(0, width, 0, height), origin="lower", aspect="auto")

    # All has four corners: of a triangle the last is twice there, a line is pinched to its ends, a
    # dot is a star of two squares, and both get a rounded edge of their thickness. They stand in
    # front of what they lie on.
    focal = height / 2 / math.tan(math.radians(scenes.VIEW_ANGLE / 2))  # pixels
    dot = scene.dot * height / 1000
    # Corners (k, 4, 3), colours (k or 1, 3), width of the edge in pixels, how much nearer.
    layers = [(scene.points[scene.cells[:, [0, 1, 2, -1]]], _lit(scene), 0.6, 0.0)]
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
    return np.ascontiguousarray(pixels(figure)[:, :, :3])


def pixels(figure: Any) -> Image:
    """A Matplotlib figure, drawn: (height, width, 4)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba()).copy()


RASTERS: dict[str, dict[str, Any]] = {  # by suffix, what Pillow is told
    ".png": {"format": "PNG", "compress_level": 4},  # half the time of 6, a tenth larger
    ".jpg": {"format": "JPEG", "quality": 92, "subsampling": 0},
    ".jpeg": {"format": "JPEG", "quality": 92, "subsampling": 0},
    ".webp": {"format": "WEBP", "quality": 92},
}


def encoded(image: Image, suffix: str = ".png") -> bytes:
    """An image, (height, width, 3 or 4), as the contents of one of the `RASTERS`."""
    from PIL import Image as PILImage

    file = io.BytesIO()
    PILImage.fromarray(image).save(file, **RASTERS[suffix])
    return file.getvalue()


def averaged(image: Image, scale: int) -> Image:
    """Means of scale x scale pixels."""
    from PIL import Image as PILImage

    return np.asarray(PILImage.fromarray(image).reduce(scale))


def legend(dots: Sequence[Dots], height: int, ink: str) -> Image:
    """The colours of dots explained, (h, w, 4), for a picture of so many pixels."""
    from matplotlib.figure import Figure

    line = 0.036 * height  # pixels
    figure = Figure(figsize=(0.01, 0.01), dpi=100)
    figure.patch.set_alpha(0.0)
    width = (max(len(k.name) for k in dots) * 0.62 * 0.62 + 2) * line
    figure.set_size_inches(math.ceil(width) / 100, math.ceil(len(dots) * line) / 100)
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, width), ylim=(len(dots), 0))
    axes.set_axis_off()
    edge: dict[str, Any] = {"ms": 0.42 * line * POINT, "mec": ink, "mew": 0.03 * line * POINT}
    for k, kind in enumerate(dots):
        axes.plot(0.6 * line, k + 0.5, "o", mfc=kind.color, **edge)
        size = 0.62 * line * POINT
        place = (1.1 * line, k + 0.5)
        axes.text(*place, kind.name, color=ink, size=size, va="center_baseline")
    return pixels(figure)


def strip(height: int) -> int:
    """Width in pixels of the strip for a colour bar."""
    return round(BAR * height)


def bar(field: Field, height: int, ink: str) -> Image:
    """The colours of a field explained, (h, w, 4), for a picture of so many pixels."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator, ScalarFormatter

    width, tall = strip(height), round(0.72 * height)
    figure = Figure(figsize=(width / 100, tall / 100), dpi=100)
    figure.patch.set_alpha(0.0)
    size = 0.024 * height * POINT
    axes = figure.add_axes((0.16, 0.04, 0.13, 0.92))
    extend = {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}[field.beyond]
    mappable = ScalarMappable(Normalize(*field.limits), colormap(field))
    formatter = ScalarFormatter(useMathText=True)
    formatter.set_powerlimits((-3, 4))
    drawn = figure.colorbar(
        mappable, cax=axes, extend=extend, extendfrac=0.045, ticks=MaxNLocator(6), format=formatter
    )
    drawn.outline.set(linewidth=0.0012 * height * POINT, edgecolor=ink)
    axes.tick_params(
        labelsize=size,
        labelcolor=ink,
        color=ink,
        length=0.3 * size,
        width=0.0012 * height * POINT,
        pad=0.3 * size,
    )
    drawn.set_label(field.label or "", size=1.05 * size, color=ink, labelpad=0.7 * size)
    axes.yaxis.get_offset_text().set(size=size, color=ink)
    return pixels(figure)


def ruler(scene: Scene, height: int) -> Image:
    """A round length at the distance of the scene's middle, in the user's units, (h, w, 4)."""
    from matplotlib.figure import Figure

    pixel = 2 * scene.distance * math.tan(math.radians(scenes.VIEW_ANGLE / 2)) / height
    most = 0.3 * height * pixel * scene.frame.extent
    power = math.floor(math.log10(most))
    digit = max(k for k in (1, 2, 5) if k * 10.0**power <= most)
    long = digit * 10.0**power / (pixel * scene.frame.extent)  # pixels
    size, edge = 0.022 * height, 0.0025 * height
    width, tall = math.ceil(long + 4 * size), math.ceil(2.6 * size)
    figure = Figure(figsize=(width / 100, tall / 100), dpi=100)
    figure.patch.set_alpha(0.0)
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, width), ylim=(0, tall))
    axes.set_axis_off()
    ends, ink = ((width - long) / 2, (width + long) / 2), scene.look.ink
    low, up = 0.5 * size, 0.25 * size
    outline = [ends[0], ends[0], ends[0], ends[1], ends[1], ends[1]]
    heights = [low - up, low + up, low, low, low - up, low + up]
    axes.plot(outline, heights, color=ink, lw=edge * POINT, solid_capstyle="butt")
    text = f"{digit * 10.0**power:.12g}{scene.frame.unit}"
    place = (width / 2, low + up)
    axes.text(*place, text, color=ink, size=size * POINT, ha="center", va="bottom")
    return pixels(figure)


def explained(image: Image, scene: Scene) -> Image:
    """The picture with a strip for the colour bar on its right, if there is one, and the legends.

    These are in the corners where they hide least.
    """
    if scene.field is not None and scene.field.label is not None:
        shown = bar(scene.field, image.shape[0], scene.look.ink)
        # the ground is the same in every column
        ground = np.repeat(image[:, :1], shown.shape[1], axis=1)
        image = np.concatenate([image, ground], axis=1)
        image = _laid(image, shown, (image.shape[0] - shown.shape[0]) // 2, -shown.shape[1])
    legends = [ruler(scene, image.shape[0])] if scene.bar else []
    if scene.dots:
        legends.append(legend(scene.dots, image.shape[0], scene.look.ink))
    # the ground is dithered
    ground = image[:, :1]
    apart = np.maximum(image, ground) - np.minimum(image, ground) if legends else None
    busy = None if apart is None else np.any(apart > 4, axis=2)
    gap = round(GAP * image.shape[0])
    for shown in legends:
        assert busy is not None
        down, right = image.shape[0] - shown.shape[0] - gap, image.shape[1] - shown.shape[1] - gap
        corners = [(down, right), (down, gap), (gap, right), (gap, gap)]
        row, column = min(corners, key=lambda c: _hidden(busy, shown, *c))
        image = _laid(image, shown, row, column)
        busy[max(row, 0) : row + shown.shape[0], max(column, 0) : column + shown.shape[1]] = True
    return image


def _hidden(busy: NDArray[np.bool_], shown: Image, row: int, column: int) -> int:
    """How many of the pixels that are busy an image would hide."""
    high, wide = shown.shape[:2]
    return int(busy[max(row, 0) : row + high, max(column, 0) : column + wide].sum())


def _laid(image: Image, shown: Image, row: int, column: int) -> Image:
    """An image with another, which has transparency, laid over it."""
    from PIL import Image as PILImage

    picture, over = PILImage.fromarray(image), PILImage.fromarray(shown)
    picture.paste(over, (column % picture.width, row % picture.height), over)
    return np.asarray(picture)


def _cut(ends: Array) -> Array:
    """Lines cut into pieces short enough to be sorted by depth."""
    pieces = int(np.clip(100_000 // max(len(ends), 1), 1, 16))
    at = np.linspace(0.0, 1.0, pieces + 1)[:, None, None]
    line = ends[:, 0] + at * (ends[:, 1] - ends[:, 0])  # (pieces + 1, k, 3)
    return np.stack([line[:-1], line[1:]], axis=2).reshape(-1, 2, 3)


def _lit(scene: Scene) -> Array:
    """The colour of each cell, (q, 3), under a key light, a fill light and a back light."""
    normal = scene.normals[scene.cells].mean(axis=1)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    toward = scene.eye - scene.points[scene.cells].mean(axis=1)
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    normal *= np.where(np.sum(normal * toward, axis=1, keepdims=True) < 0, -1.0, 1.0)
    light = np.array([place for place, _ in LIGHTS]) @ scene.axes
    strength = np.array([strength for _, strength in LIGHTS])
    ambient, diffuse, gloss = material(scene)
    lit = ambient + diffuse * (np.maximum(normal @ light.T, 0.0) @ strength)
    half = toward + light[0]
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    shine = gloss * np.maximum(np.sum(normal * half, axis=1), 0.0) ** SHARPNESS
    colors: Array = np.asarray(scene.color)
    if scene.field is not None:
        shade = scene.field.shades[scene.cells].mean(axis=1)  # (q,)
        colors = colormap(scene.field)(np.ma.masked_invalid(shade))[:, :3]
    colors = lit[:, None] * colors + shine[:, None]
    return np.clip(colors, 0.0, 1.0)
