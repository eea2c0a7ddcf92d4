"""A picture: what was drawn, as pixels, files, and pages that a reader can turn."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from limitsurf.shell import files
from limitsurf.shell.files import Path
from limitsurf.shell.plot import charts, paint, render
from limitsurf.shell.plot.paint import Image
from limitsurf.shell.plot.scene import POLYGONS, Lines, Look, Scene

PAGE_POLYGONS = 30_000  # of a page, whose size they make up


class Drawing(Protocol):
    """What a picture is made of."""

    @property
    def suffixes(self) -> tuple[str, ...]:
        """Of the files that can be made of it, those of pixels (`RASTERS`) among them."""
        ...

    def prepare(self, suffix: str) -> None:
        """Do what can fail of the work for such a file."""
        ...

    def pixels(self) -> Image:
        """The picture, (height, width, 3)."""
        ...

    def content(self, suffix: str) -> bytes:
        """What a file with this suffix, none of pixels, contains."""
        ...

    def window(self) -> Image:
        """Show it in a window until that is closed; the last picture."""
        ...


class Picture:
    """A picture of a surface or of a spectrum, as `plot` and its relatives return it.

    It is drawn when it is first needed. In a notebook the last expression of a cell is shown.
    ``np.asarray(picture)`` is its `image`.

    Attributes
    ----------
    image : ndarray of uint8, shape (height, width, 3)
        The pixels.

    Examples
    --------
    >>> import limitsurf as ls
    >>> quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    >>> cube = ls.Mesh([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], quads)
    >>> picture = ls.plot(ls.LimitSurface(cube), off_screen=True, window_size=(320, 240))
    >>> picture
    <Picture of 320 x 240 pixels>
    >>> picture.image.shape
    (240, 320, 3)
    """

    def __init__(self, drawing: Drawing, size: tuple[int, int]) -> None:
        self._drawing = drawing
        self._image: Image | None = None
        self._size = size

    @property
    def image(self) -> Image:
        """The pixels, (height, width, 3) uint8, drawn on first use."""
        if self._image is None:
            self._image = self._drawing.pixels()
        return self._image

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        if copy is False and dtype not in (None, np.uint8):
            raise ValueError(f"an array of {dtype} is a copy")
        return np.array(self.image, dtype=dtype, copy=bool(copy or dtype))

    def __repr__(self) -> str:
        width, height = self._size
        return f"<Picture of {width} x {height} pixels>"

    def save(self, file: Path) -> None:
        """Write the picture to a file, which appears whole or not at all.

        Parameters
        ----------
        file : str or os.PathLike
            ``.png``, ``.jpg`` or ``.webp``; of a surface or an eigenfunction also ``.html``, a page
            that any browser shows, without a network, and in which the scene turns: some two
            megabytes, and more from 30,000 limit faces on; of a diagram and of a layout also
            ``.svg`` and ``.pdf``.

        Raises
        ------
        ValueError
            Another suffix.
        ImportError
            For a page, without trame-vtk (``pip install "limitsurf[plot]"``).
        OSError
            A file that cannot be written.
        """
        suffix = _suffix(file, self._drawing.suffixes)
        raster = suffix in paint.RASTERS
        content = paint.encoded(self.image, suffix) if raster else self._drawing.content(suffix)
        with files.replacing(file) as target:
            target.write(content)

    def show(self) -> None:
        """Open a window with the picture, to be turned with the mouse; until it is closed.

        Raises
        ------
        OSError
            Without a display.
        """
        render.check_display()
        self._image = self._drawing.window()

    def interactive(self, height: int = 480) -> Interactive:
        """The scene for a notebook, to be turned with the mouse; nothing is loaded from elsewhere.

        Parameters
        ----------
        height : int
            Of the frame, in pixels of the page.

        Raises
        ------
        ValueError
            For a picture that is not of a scene in space.
        ImportError
            Without trame-vtk (``pip install "limitsurf[plot]"``).
        """
        if ".html" not in self._drawing.suffixes:
            raise ValueError("this picture is flat, there is nothing to turn; show it as it is")
        return Interactive(self._drawing.content(".html").decode(), height)

    def _repr_png_(self) -> bytes:
        return paint.encoded(self.image)


class Interactive:
    """A page in a frame, which notebooks show."""

    def __init__(self, page: str, height: int) -> None:
        self.page = page
        self.height = height

    def _repr_html_(self) -> str:
        return render.frame(self.page, self.height)


class SceneDrawing:
    """A scene; ``build(aspect, polygons)`` makes it, of more for a picture than for a page."""

    suffixes = (*paint.RASTERS, ".html")

    def __init__(
        self, build: Callable[[float, int], Scene], size: tuple[int, int], with_bar: bool
    ) -> None:
        self.build, self.size = build, size
        # a colour bar has a strip of its own; in a page the scene stays in the middle
        self._strip = with_bar * paint.strip(size[1])
        self._scenes: dict[int, Scene] = {}

    def prepare(self, suffix: str) -> None:
        """Make the scene of such a file, or raise what is wrong with it."""
        self._of(PAGE_POLYGONS if suffix == ".html" else POLYGONS)

    def _of(self, polygons: int) -> Scene:
        if polygons not in self._scenes:
            width = self.size[0] - self._strip * (2 if polygons == PAGE_POLYGONS else 1)
            self._scenes[polygons] = self.build(max(1, width) / self.size[1], polygons)
        return self._scenes[polygons]

    def pixels(self) -> Image:
        """The picture, (height, width, 3)."""
        width = max(1, self.size[0] - self._strip)
        image = render.pixels(self._of(POLYGONS), width, self.size[1])
        return paint.explained(image, self._of(POLYGONS))

    def content(self, suffix: str) -> bytes:
        """A page of HTML."""
        return render.page(self._of(PAGE_POLYGONS), *self.size).encode()

    def window(self) -> Image:
        """Show it in a window until that is closed; the last picture."""
        return render.window(self._of(POLYGONS), *self.size)

    def plotter(self, off_screen: bool | None) -> Any:
        """A PyVista plotter with all of it, in the user's units."""
        return render.plotter(self._of(POLYGONS), *self.size, off_screen)


class LayoutDrawing(SceneDrawing):
    """A flat scene, that of a channel of two numbers: as a diagram, and as a page to turn.

    ``seams()`` returns where it is torn, and where the mesh ends.
    """

    suffixes = (*SceneDrawing.suffixes, ".svg", ".pdf")

    def __init__(
        self,
        build: Callable[[float, int], Scene],
        size: tuple[int, int],
        with_bar: bool,
        seams: Callable[[], tuple[Lines, Lines]],
        name: str,
        look: Look,
    ) -> None:
        super().__init__(build, size, with_bar)
        self._chart = charts.ChartDrawing(self._draw, size, look)
        self._seams, self._name = seams, name

    def prepare(self, suffix: str) -> None:
        """Make the scene, or raise what is wrong with it."""
        self._of(PAGE_POLYGONS)

    def _draw(self, figure: Any) -> None:
        charts.draw_layout(figure, self._of(PAGE_POLYGONS), self._seams(), self._name)

    def pixels(self) -> Image:
        """The diagram, (height, width, 3)."""
        return self._chart.pixels()

    def content(self, suffix: str) -> bytes:
        """The diagram in lines and letters, or a page of HTML."""
        return super().content(suffix) if suffix == ".html" else self._chart.content(suffix)


def draws_at_once(file: Path | None, off_screen: bool | None) -> bool:
    """Whether pixels are needed without a window, as far as one can know."""
    if not _off_screen(file, off_screen):
        return False
    return in_notebook() if file is None else _suffix(file, (*paint.RASTERS, ".html")) != ".html"


def _suffix(file: Path, known: tuple[str, ...]) -> str:
    """The suffix of a file to write, in lower case; ValueError if it is another."""
    suffix = os.path.splitext(os.fspath(file))[1].lower()
    if suffix not in known:
        need = " or ".join(known)
        raise ValueError(f"{os.fspath(file)}: this picture is written as {need}, got {suffix!r}")
    return suffix


def in_notebook() -> bool:
    """Whether this is a kernel whose front end shows what a cell returns."""
    ipython = sys.modules.get("IPython")
    shell = None if ipython is None else ipython.get_ipython()
    return hasattr(shell, "kernel")


def check_target(file: Path | None, off_screen: bool | None, known: tuple[str, ...]) -> None:
    """Complain, before any work, of a target that could not be served.

    That is a file of another suffix, one that cannot be written, or a window without a display.
    """
    if file is not None:
        _suffix(file, known)
        files.check_target(file)
    if not _off_screen(file, off_screen):
        render.check_display()


def finished(
    drawing: Drawing, size: tuple[int, int], file: Path | None, off_screen: bool | None
) -> Picture:
    """The picture, shown in a window and written to a file if that is wanted."""
    shown = not _off_screen(file, off_screen)
    drawing.prepare(".png" if file is None or shown else _suffix(file, drawing.suffixes))
    picture = Picture(drawing, size)
    if shown:
        picture.show()
    if file is not None:
        picture.save(file)
    return picture


def _off_screen(file: Path | None, off_screen: bool | None) -> bool:
    return (file is not None or in_notebook()) if off_screen is None else off_screen
