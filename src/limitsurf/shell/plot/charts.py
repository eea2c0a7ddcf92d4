"""Flat diagrams, by Matplotlib: characteristic maps, panels of pictures, convergence, spectra."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf.shell.plot import paint
from limitsurf.shell.plot.paint import Image
from limitsurf.shell.plot.scene import LIGHT, SEAM, Lines, Look, Scene

if TYPE_CHECKING:
    from limitsurf.spectra import SpectralAnalysis
    from limitsurf.spectra.fan import Fan, Mode

Array: TypeAlias = NDArray[np.float64]

INCHES = 6.0  # height of a diagram, to which its letters belong
CURVES = ("#3a86d4", "#e8805f", "#2e9e5b", "#9a62cc", "#b58900", "#d8407a", "#7f8a94")
MIRRORED = "#3a86d4"  # faces of a layout that are turned over
MARKS = "osD^vP*"
FREQUENCIES = {0: ":", 1: "-", 2: "--"}  # of eigenvalues, and their lines
COLUMNS, ROWS = 3, 3  # of a panel
PANEL = COLUMNS * ROWS
HEAD, NAME = 0.08, 0.04  # parts of its height for its title, and for each picture's


class ChartDrawing:
    """A Matplotlib figure, drawn by a function."""

    suffixes = (*paint.RASTERS, ".svg", ".pdf")

    def __init__(
        self, draw: Callable[[Any], None], size: tuple[int, int], look: Look = LIGHT
    ) -> None:
        self.draw, self.size, self.look = draw, size, look

    def prepare(self, suffix: str) -> None:
        """Nothing is left that could fail."""

    def _figure(self) -> Any:
        from matplotlib.figure import Figure

        width, height = self.size
        figure = Figure(figsize=(INCHES * width / height, INCHES), dpi=height / INCHES)
        figure.set_facecolor(self.look.paper)
        self.draw(figure)
        return figure

    def pixels(self) -> Image:
        """The picture, (height, width, 3)."""
        return np.ascontiguousarray(
            paint.pixels(self._figure())[: self.size[1], : self.size[0], :3]
        )

    def content(self, suffix: str) -> bytes:
        """The diagram in lines and letters."""
        import matplotlib

        file = io.BytesIO()
        with matplotlib.rc_context({"svg.hashsalt": "limitsurf"}):
            self._figure().savefig(file, format=suffix[1:])
        return file.getvalue()

    def window(self) -> Image:
        """Show it in a window until that is closed; the picture."""
        from PIL import Image as PILImage

        image = self.pixels()
        PILImage.fromarray(image).show()
        return image


def draw_characteristic_map(
    figure: Any, fan: Fan, isolines: int, rings: int, ticks: bool, look: Look
) -> None:
    """Images of the sectors under the characteristic map, with nested rings around the vertex."""
    surface = fan.limit(fan.characteristic_map())
    if ticks:
        axes = figure.add_axes((0.12, 0.08, 0.85, 0.82), aspect="equal")
        _plain_axes(axes, look)
    else:
        axes = figure.add_axes((0.03, 0.03, 0.94, 0.87), aspect="equal")
        axes.set_axis_off()
    face = np.arange(fan.faces)[:, None]
    at, corners = np.linspace(0.0, 1.0, 33), fan.corners
    u, v = _path([*corners, corners[0]])
    for k, outline in enumerate(surface.evaluate(face, u, v)):
        axes.fill(*outline.T, color=look.sectors[k % 2], lw=0)
    _draw_isolines(axes, fan, surface, isolines, rings, look.isoline)
    for s in range(fan.faces):
        axes.plot(
            *surface.evaluate(s, at, 0 * at).T, color=look.ink, lw=1.4, solid_capstyle="round"
        )
        axes.plot(
            *surface.evaluate(s, 0 * at, at).T, color=look.ink, lw=1.4, solid_capstyle="round"
        )
    first, second = fan.basis.float64.rates[0, fan.basis.float64.normal].tolist()
    similar = abs(first - second) < 1e-9
    _draw_rings(axes, fan, surface, rings, r"\lambda" if similar else "", look)
    axes.plot(0, 0, "o", color=look.ink, ms=4.5)
    spectrum = (
        rf"$\lambda = {first:.5f}$"
        if similar
        else rf"$\lambda_1 = {max(first, second):.5f},\ \lambda_2 = {min(first, second):.5f}$"
    )
    axes.autoscale_view()
    axes.set_title(title(fan, spectrum), color=look.ink, size=12, pad=8)


def _path(corners: Sequence[tuple[int, int]]) -> Array:
    """The u and v along straight lines between corners, (2, p)."""
    at = np.linspace(0.0, 1.0, 33)[:, None]
    ends = np.array(corners)
    return np.concatenate([a + at * (b - a) for a, b in pairwise(ends)]).T


def _draw_isolines(
    axes: Any, fan: Fan, surface: Any, isolines: int, rings: int, color: str
) -> None:
    """Lines of constant u and v on all faces.

    In the n-th ring, where the larger of u and v, in triangles their sum, is from 2^-n-1 to 2^-n,
    they are 2^-n as dense.
    """
    from matplotlib.collections import LineCollection

    at = np.linspace(0.0, 1.0, 33)
    steps = np.arange(1, isolines + 1) / (isolines + 1)
    fixed, high = steps[:, None], np.ones((len(steps), 1))
    low = np.where(fixed < 0.5, 0.5, 0.0)
    if fan.lattice.sloped:
        low, high = np.maximum(0.5 - fixed, 0), 1 - fixed
    along = low + at * (high - low)  # (isolines, 33)
    fixed = np.broadcast_to(fixed, along.shape)
    face = np.arange(fan.faces)[:, None, None]
    for ring in range(rings + 1):
        scale = 2.0**-ring
        for x, y in ((fixed, along), (along, fixed)):
            lines = surface.evaluate(face, scale * x, scale * y)  # (k, isolines, 33, 2)
            width = 0.7 * 0.8**ring
            axes.add_collection(
                LineCollection(list(lines.reshape(-1, len(at), 2)), colors=color, linewidths=width)
            )


def _draw_rings(axes: Any, fan: Fan, surface: Any, rings: int, factor: str, look: Look) -> None:
    """The far sides of all faces in each ring, named by a power of the factor, if any."""
    from matplotlib.collections import LineCollection

    face = np.arange(fan.faces)[:, None]
    u, v = _path(fan.corners[1:])
    reach = np.abs(surface.evaluate(face, u, v)).max()
    named = math.inf  # the largest distance of a name from the vertex
    for ring in range(rings + 1):
        scale = 2.0**-ring
        edge = surface.evaluate(face, scale * u, scale * v)  # (k, p, 2)
        axes.add_collection(
            LineCollection(list(edge), colors=look.ring, linewidths=1.8 * 0.88**ring)
        )
        place = surface.evaluate(0, scale, 0.0)
        far = float(np.hypot(*place))
        power = "1" if ring == 0 else factor + (f"^{ring}" if ring > 1 else "")
        if ring and min(named - far, far) < 0.13 * reach:  # no room for more names
            named = 0.0
        else:
            named = far
            axes.annotate(
                *(f"${power}$" if factor else f"${ring}$", place),
                xytext=(4, -4),
                textcoords="offset points",
                **{"color": look.ring, "size": 11, "va": "top"},
                bbox={"facecolor": look.paper, "alpha": 0.8, "lw": 0, "pad": 0.8},
            )


def title(fan: Fan, what: str) -> str:
    """What is shown, and of which vertex."""
    place = f"{fan.kind} of {fan.faces} face" + "s" * (fan.faces > 1)
    if fan.kind == "interior":
        place = f"valence {fan.faces}"
    return f"{fan.basis.scheme.name.title()}, {place}:  {what}"


def mode_name(mode: Mode) -> str:
    """Eigenvalue and frequency, and whether there are two of them."""
    twice = " (twice)" if mode.paired else ""
    return rf"$\lambda = {mode.eigenvalue:.4f}$, frequency {mode.frequency}{twice}"


def draw_panel(
    figure: Any, images: Sequence[Image], titles: Sequence[str], title: str, look: Look
) -> None:
    """Pictures of one size, row by row, each under its title."""
    for k, (image, text) in enumerate(zip(images, titles, strict=True)):
        row, column = divmod(k, COLUMNS)
        bottom = 1 - HEAD - (row + 1) * (1 - HEAD) / ROWS
        axes = figure.add_axes((column / COLUMNS, bottom, 1 / COLUMNS, (1 - HEAD) / ROWS - NAME))
        axes.set_axis_off()
        axes.imshow(image, interpolation="antialiased")
        place = ((column + 0.5) / COLUMNS, bottom + (1 - HEAD) / ROWS - NAME)
        figure.text(
            *place, text, **{"color": look.ink, "size": 9.5, "ha": "center", "va": "bottom"}
        )
    figure.text(0.5, 1 - HEAD / 2, title, color=look.ink, size=12, ha="center", va="center")


def picture_size(size: tuple[int, int]) -> tuple[int, int]:
    """Width and height in pixels of the pictures of a panel."""
    width, height = size
    return width // COLUMNS, max(1, round(height * ((1 - HEAD) / ROWS - NAME)))


def _plain_axes(axes: Any, look: Look) -> None:
    """Ticks, a pale grid, and neither a box nor a ground."""
    axes.set_facecolor("none")
    axes.grid(which="major", color=look.grid, lw=0.7)
    axes.set_axisbelow(True)
    axes.tick_params(colors=look.ink, labelsize=11)
    axes.xaxis.label.set_color(look.ink)
    axes.yaxis.label.set_color(look.ink)
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(look.ink)


def draw_layout(figure: Any, scene: Scene, seams: tuple[Lines, Lines], name: str) -> None:
    """A channel of two numbers in its plane, with its seams; where faces overlap it is darker."""
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    look, frame, field = scene.look, scene.frame, scene.field
    axes = figure.add_axes((0.1, 0.17, 0.87 if field is None else 0.74, 0.75), aspect="equal")
    _plain_axes(axes, look)
    flat = frame.placed(scene.points)[:, :2]
    known: list[Any] = []
    if field is None:
        corners = flat[scene.outlines]  # (faces, corners, 2)
        corners = corners[np.isfinite(corners).all(axis=(1, 2))]
        x, y = np.moveaxis(corners - corners[:, :1], 2, 0)
        turned = (x * np.roll(y, -1, 1) - y * np.roll(x, -1, 1)).sum(axis=1) < 0
        for which, color, text in (
            (~turned, scene.color, ""),
            (turned, MIRRORED, "turned over"),
        ):
            axes.add_collection(
                PolyCollection(list(corners[which]), facecolors=[color], alpha=0.4, lw=0)
            )
            if text and which.any():
                known.append(Patch(color=color, alpha=0.4, label=text))
    else:
        shades = PolyCollection(list(flat[scene.cells]), antialiased=False, lw=0)
        shades.set(
            array=np.ma.masked_invalid(field.values[scene.cells].mean(axis=1)),
            cmap=paint.colormap(field),
            clim=field.limits,
        )
        axes.add_collection(shades)
        if field.label is not None:
            _colorbar(figure, shades, scene)
    for lines in scene.lines:
        ends = frame.placed(lines.ends)[..., :2]
        axes.add_collection(
            LineCollection(list(ends), colors=[lines.color], linewidths=0.43 * lines.width)
        )
    for lines, color, text in zip(
        seams, (SEAM, look.ink), ("seam", "end of the mesh"), strict=True
    ):
        if len(lines.ends):
            ends, width = frame.placed(lines.ends)[..., :2], 0.43 * lines.width
            axes.add_collection(
                LineCollection(list(ends), colors=color, linewidths=width, capstyle="round")
            )
            known.append(Line2D([], [], color=color, lw=width, label=text))
    for dots in scene.dots:
        places = frame.placed(dots.places)[:, :2]
        style = {"color": dots.color, "ms": 0.4 * scene.dot, "ls": "", "label": dots.name}
        known += axes.plot(*places.T, "o", **style)
    axes.autoscale_view()
    axes.set_title(f"channel {name}", color=look.ink, size=12, pad=8)
    axes.set_xlabel("u" if name == "uv" else "first number", size=12)
    axes.set_ylabel("v" if name == "uv" else "second number", size=12)
    if known:
        place = {"loc": "lower center", "ncols": 5, "frameon": False, "borderaxespad": 0.2}
        figure.legend(handles=known, fontsize=10, labelcolor=look.ink, **place)


def _colorbar(figure: Any, shades: Any, scene: Scene) -> None:
    """The colours of a diagram explained, on its right."""
    field, look = scene.field, scene.look
    assert field is not None
    extend = {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}[field.beyond]
    drawn = figure.colorbar(shades, cax=figure.add_axes((0.87, 0.17, 0.025, 0.75)), extend=extend)
    drawn.outline.set_edgecolor(look.ink)
    drawn.ax.tick_params(colors=look.ink, labelsize=10)
    drawn.set_label(field.label, color=look.ink, size=11)


def draw_convergence(
    figure: Any, errors: Mapping[str, Array], orders: Mapping[str, float], look: Look
) -> None:
    """Errors (levels,) on a logarithmic scale, with the slopes that the theory gives them."""
    from matplotlib.ticker import LogFormatterSciNotation, LogLocator, MaxNLocator

    axes = figure.add_axes((0.15, 0.115, 0.82, 0.8))
    _plain_axes(axes, look)
    axes.set_title("Refined vertices against the surface", color=look.ink, size=13, pad=10)
    levels = max(len(e) for e in errors.values())
    for k, (name, error) in enumerate(errors.items()):
        color, level = CURVES[k % len(CURVES)], np.arange(1, len(error) + 1)
        seen = np.flatnonzero(np.isfinite(error) & (error > 0))
        if not len(seen):
            continue
        error, level = error[seen], level[seen]
        text = f"{name}: " if name else ""
        if len(error) > 1:
            slope = np.log2(error[-2] / error[-1]) / (level[-1] - level[-2])
            text += f"order {slope:.2f} in the last step, "
        text += f"{orders[name]:.2f} in the limit"
        mark = MARKS[k % len(MARKS)]
        axes.semilogy(level, error, mark + "-", color=color, lw=1.6, ms=6, label=text)
        beyond = np.array([level[-1], levels + 1])
        line = error[-1] * 2.0 ** (-orders[name] * (beyond - level[-1]))
        axes.semilogy(beyond, line, "--", color=color, lw=1.2)
    axes.set_xlim(0.7, levels + 1.15)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("level of refinement", size=12)
    axes.set_ylabel("largest distance from the surface / size of the cage", size=12)
    least, most = axes.get_ylim()
    if least > 0 and most / least < 1e3:  # powers of ten alone would be few
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        formatter = LogFormatterSciNotation(minor_thresholds=(math.inf, math.inf))
        axes.yaxis.set_major_formatter(formatter)
    axes.legend(frameon=False, fontsize=11, labelcolor=look.ink)


def draw_spectrum(figure: Any, found: Mapping[str, Sequence[SpectralAnalysis]], look: Look) -> None:
    """Eigenvalues by frequency, and what curvature is multiplied by, over the number of faces."""
    from matplotlib.ticker import MaxNLocator

    left, right = (figure.add_axes((x, 0.12, 0.41, 0.78)) for x in (0.07, 0.57))
    for k, (name, analyses) in enumerate(found.items()):
        color, mark = CURVES[k % len(CURVES)], MARKS[k % len(MARKS)]
        faces = np.array([one.sector.faces for one in analyses])
        for frequency, style in FREQUENCIES.items():
            sizes = np.array([_largest_of(one, frequency) for one in analyses])
            left.plot(faces, sizes, mark + style, color=color, lw=1.4, ms=5)
        rates = [np.nan if x.curvature is None else x.curvature.rate for x in analyses]
        right.plot(faces, rates, mark + "-", color=color, lw=1.6, ms=6, label=name)
    for frequency, style in FREQUENCIES.items():
        left.plot([], [], style, color=look.ink, lw=1.4, label=f"frequency {frequency}")
    right.axhline(1.0, color=look.ink, lw=0.8, ls=":")
    texts = "Largest eigenvalues but 1", "Curvature, as parameters are halved, times"
    for axes, text in zip((left, right), texts, strict=True):
        _plain_axes(axes, look)
        axes.set_title(text, color=look.ink, size=13, pad=10)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_xlabel("faces around the vertex", size=12)
        axes.legend(frameon=False, fontsize=10, labelcolor=look.ink)


def _largest_of(found: SpectralAnalysis, frequency: int) -> float:
    """The size of the largest eigenvalue but 1 of a Fourier frequency; NaN if it has none."""
    origin = f"frequency {frequency}"
    sizes = [abs(x.value) for x in found.eigenvalues[1:] if origin in x.origins]
    return max(sizes, default=np.nan)
