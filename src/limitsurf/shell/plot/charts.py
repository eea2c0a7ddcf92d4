"""Flat diagrams, by Matplotlib: characteristic maps, panels of pictures, convergence."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf.shell.plot import paint
from limitsurf.shell.plot.paint import Image
from limitsurf.shell.plot.scene import INK
from limitsurf.spectra.fan import Fan, Mode

Array: TypeAlias = NDArray[np.float64]

INCHES = 6.0  # height of a diagram, to which its letters belong
SECTORS = ("#f6d9cf", "#fbeee9")  # of a characteristic map, by turns
LINE, RING, AXIS = "#8a5a4a", "#1f6fc4", INK
CURVES = ("#1f6fc4", "#e8805f", "#2e9e5b", "#7d3fb0", "#b58900", "#c2185b", "#111111")
MARKS = "osD^vP*"
COLUMNS, ROWS = 3, 3  # of a panel
PANEL = COLUMNS * ROWS
HEAD, NAME = 0.08, 0.04  # parts of its height for its title, and for each picture's


class ChartDrawing:
    """A Matplotlib figure, drawn by a function."""

    suffixes = (".png", ".svg", ".pdf")

    def __init__(self, draw: Callable[[Any], None], size: tuple[int, int]) -> None:
        self.draw, self.size = draw, size

    def prepare(self, suffix: str) -> None:
        """Nothing is left that could fail."""

    def _figure(self) -> Any:
        from matplotlib.figure import Figure

        width, height = self.size
        figure = Figure(figsize=(INCHES * width / height, INCHES), dpi=height / INCHES)
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


def draw_characteristic_map(figure: Any, fan: Fan, isolines: int, rings: int) -> None:
    """Images of the sectors under the characteristic map, with nested rings around the vertex."""
    surface = fan.limit(fan.characteristic_map())
    axes = figure.add_axes((0.03, 0.03, 0.94, 0.87), aspect="equal")
    axes.set_axis_off()
    face = np.arange(fan.faces)[:, None]
    at, corners = np.linspace(0.0, 1.0, 33), fan.corners
    u, v = _path([*corners, corners[0]])
    for k, outline in enumerate(surface.evaluate(face, u, v)):
        axes.fill(*outline.T, color=SECTORS[k % 2], lw=0)
    _draw_isolines(axes, fan, surface, isolines, rings)
    for s in range(fan.faces):
        axes.plot(*surface.evaluate(s, at, 0 * at).T, color=AXIS, lw=1.4, solid_capstyle="round")
        axes.plot(*surface.evaluate(s, 0 * at, at).T, color=AXIS, lw=1.4, solid_capstyle="round")
    first, second = fan.basis.float64.rates[0, fan.basis.float64.normal].tolist()
    similar = abs(first - second) < 1e-9
    _draw_rings(axes, fan, surface, rings, r"\lambda" if similar else "")
    axes.plot(0, 0, "o", color=INK, ms=4.5)
    spectrum = (
        rf"$\lambda = {first:.5f}$"
        if similar
        else rf"$\lambda_1 = {max(first, second):.5f},\ \lambda_2 = {min(first, second):.5f}$"
    )
    axes.autoscale_view()
    axes.set_title(title(fan, spectrum), color=INK, size=12, pad=8)


def _path(corners: Sequence[tuple[int, int]]) -> Array:
    """The u and v along straight lines between corners, (2, p)."""
    at = np.linspace(0.0, 1.0, 33)[:, None]
    ends = np.array(corners)
    return np.concatenate([a + at * (b - a) for a, b in pairwise(ends)]).T


def _draw_isolines(axes: Any, fan: Fan, surface: Any, isolines: int, rings: int) -> None:
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
                LineCollection(list(lines.reshape(-1, len(at), 2)), colors=LINE, linewidths=width)
            )


def _draw_rings(axes: Any, fan: Fan, surface: Any, rings: int, factor: str) -> None:
    """The far sides of all faces in each ring, named by a power of the factor, if any."""
    from matplotlib.collections import LineCollection

    face = np.arange(fan.faces)[:, None]
    u, v = _path(fan.corners[1:])
    reach = np.abs(surface.evaluate(face, u, v)).max()
    named = math.inf  # the largest distance of a name from the vertex
    for ring in range(rings + 1):
        scale = 2.0**-ring
        edge = surface.evaluate(face, scale * u, scale * v)  # (k, p, 2)
        axes.add_collection(LineCollection(list(edge), colors=RING, linewidths=1.8 * 0.88**ring))
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
                **{"color": RING, "size": 11, "va": "top"},
                bbox={"facecolor": "white", "alpha": 0.8, "lw": 0, "pad": 0.8},
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


def draw_panel(figure: Any, images: Sequence[Image], titles: Sequence[str], title: str) -> None:
    """Pictures of one size, row by row, each under its title."""
    for k, (image, text) in enumerate(zip(images, titles, strict=True)):
        row, column = divmod(k, COLUMNS)
        bottom = 1 - HEAD - (row + 1) * (1 - HEAD) / ROWS
        axes = figure.add_axes((column / COLUMNS, bottom, 1 / COLUMNS, (1 - HEAD) / ROWS - NAME))
        axes.set_axis_off()
        axes.imshow(image, interpolation="antialiased")
        place = ((column + 0.5) / COLUMNS, bottom + (1 - HEAD) / ROWS - NAME)
        figure.text(*place, text, **{"color": INK, "size": 9.5, "ha": "center", "va": "bottom"})
    figure.text(0.5, 1 - HEAD / 2, title, color=INK, size=12, ha="center", va="center")


def picture_size(size: tuple[int, int]) -> tuple[int, int]:
    """Width and height in pixels of the pictures of a panel."""
    width, height = size
    return width // COLUMNS, max(1, round(height * ((1 - HEAD) / ROWS - NAME)))


def draw_convergence(figure: Any, errors: Mapping[str, Array], orders: Mapping[str, float]) -> None:
    """Errors (levels,) on a logarithmic scale, with the slopes that the theory gives them."""
    from matplotlib.ticker import MaxNLocator

    axes = figure.add_axes((0.12, 0.115, 0.85, 0.86))
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
    axes.set_xlabel("level of refinement", color=INK, size=12)
    axes.set_ylabel("largest distance from the surface / size of the cage", color=INK, size=12)
    axes.grid(which="major", color="#d5dbe1", lw=0.7)
    axes.set_axisbelow(True)
    axes.tick_params(colors=INK, labelsize=11)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.legend(frameon=False, fontsize=11, labelcolor=INK)
