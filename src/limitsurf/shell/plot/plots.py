"""Pictures of limit surfaces and of what makes them: the public functions.

A picture shows exact values, in a window, as a file, in a notebook, or as a page that turns in a
browser. PyVista draws what is in space. Where there is no OpenGL at all, for which VTK has no
answer but a crash, Matplotlib paints the same scene, polygon by polygon from back to front.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, TypedDict, Unpack, overload

import numpy as np
from numpy.typing import NDArray

from limitsurf import memory
from limitsurf.cage.checks import checked_integer, users_level
from limitsurf.cage.mesh import Mesh
from limitsurf.engine.protocol import threads
from limitsurf.query import POLYGON, validate
from limitsurf.scheme.net import Net
from limitsurf.shell.files import Path
from limitsurf.shell.io.vtk import imported_pyvista
from limitsurf.shell.plot import charts, render
from limitsurf.shell.plot import picture as pictures
from limitsurf.shell.plot.picture import Picture
from limitsurf.shell.plot.scene import (
    COLOR,
    CURVATURES,
    DARK,
    DIVERGING,
    LIGHT,
    VIEWS,
    Look,
    Scalars,
    Wishes,
    build,
    real_numbers,
    seams,
    unit_points,
)
from limitsurf.surface import LimitSurface

if TYPE_CHECKING:
    from limitsurf.scheme.scheme import Scheme
    from limitsurf.spectra.fan import Fan, Mode

__all__ = [
    "Picture",
    "plot",
    "plot_characteristic_map",
    "plot_convergence",
    "plot_eigenfunctions",
    "plot_spectrum",
]

MANY = 1_000_000  # polygons that are drawn without a word
HEIGHT = 0.45  # of the graph of an eigenfunction over the unit circle
GRAPH_VIEW = (-0.5, -1.0, 0.8)


class Options(TypedDict, total=False):
    """What `plot` may be told beside what to draw."""

    n: int | None
    cage: bool | None
    curves: bool | None
    poles: bool | None
    normals: bool
    isolines: int
    scalars: Scalars | None
    limits: tuple[float, float] | None
    cmap: Any
    label: str | None
    channel: str | None
    color: str
    up: str | None
    view: str | Sequence[float] | None
    axes: bool
    scale_bar: bool
    dark: bool
    window_size: tuple[int, int]
    off_screen: bool | None
    workers: int


@overload
def plot(
    surface: LimitSurface | Mesh,
    file: Path | None = None,
    *,
    return_plotter: Literal[False] = False,
    **options: Unpack[Options],
) -> Picture: ...
@overload
def plot(
    surface: LimitSurface | Mesh,
    file: Path | None = None,
    *,
    return_plotter: bool,
    **options: Unpack[Options],
) -> Any: ...
def plot(
    surface: LimitSurface | Mesh,
    file: Path | None = None,
    *,
    n: int | None = None,
    cage: bool | None = None,
    curves: bool | None = None,
    poles: bool | None = None,
    normals: bool = False,
    isolines: int = 0,
    scalars: Scalars | None = None,
    limits: tuple[float, float] | None = None,
    cmap: Any = None,
    label: str | None = None,
    channel: str | None = None,
    color: str = COLOR,
    up: str | None = None,
    view: str | Sequence[float] | None = None,
    axes: bool = False,
    scale_bar: bool = False,
    dark: bool = False,
    window_size: tuple[int, int] = (1600, 1200),
    off_screen: bool | None = None,
    return_plotter: bool = False,
    workers: int = 1,
) -> Any:
    """Draw a limit surface: its cage, creases, extraordinary points, curvature or any scalar.

    Every point drawn is an exact one with its exact normal; only what lies between them is
    interpolated. Limit faces without a surface (holes) are left out.

    Parameters
    ----------
    surface : LimitSurface or Mesh
        Points of shape (n_vertices, 3), or (n_vertices, 2) for a flat one. Exact points are
        rounded to float64. Of a mesh it is ``LimitSurface(mesh)``.
    file : str or os.PathLike, optional
        A file to write, off screen: ``.png``, ``.jpg`` or ``.webp``; ``.html`` for a page that
        needs nothing else and turns in a browser; of a layout (see ``channel``) ``.svg`` or
        ``.pdf`` too. It appears whole or not at all.
    n : int, optional
        Each limit face is drawn as n x n polygons; by default as many as make a smooth picture, and
        fewer in a page.
    cage, curves, poles, normals : bool
        Whether to draw the cage, its creases in thick lines; the edges of the limit faces; the
        limits of extraordinary vertices and the centres of faces that are n-gons; normals in
        the middle of each limit face, and between if these are few. By default all but the normals
        are drawn unless they would hide the surface or its scalars.
    isolines : int
        How many lines of constant u, and as many of constant v, in triangles also of constant
        1 - u - v, to draw within each limit face, evenly spaced.
    scalars : str, callable or array_like, optional
        What to colour the surface by. "mean", "gaussian", "k1" or "k2" is that of its
        `LimitSurface.curvature`, in units of its points; where there is none, as at extraordinary
        vertices, that of a place nearby. "zebra" are the reflections of bright and dark strips as
        the camera sees them: they have kinks where normals do, and gaps where the surface does. A
        function of (face, u, v), arrays of shape (n,), returns values (n,). Numbers of shape
        (n_vertices,) belong to the vertices of the cage and are subdivided like their points. NaN
        is grey.
    limits : (float, float), optional
        The scalars at both ends of the colours; what lies beyond has the colour of the end, and
        the bar an arrow. By default 2 percent of the values are left out at each end, and the
        range is symmetric about 0 for curvatures and for scalars of both signs.
    cmap : str or matplotlib.colors.Colormap, optional
        Colours of the scalars; by default "coolwarm" about 0, otherwise "viridis".
    label : str, optional
        What the colour bar says; mathematics between $ signs.
    channel : str, optional
        A face-varying channel of two or three numbers to draw instead of the points. Of two, as
        texture coordinates are, it is the layout with axes and numbers: thick lines are its seams
        and the ends of the mesh, it is darker where faces overlap, and blue where they are turned
        over; with `scalars`, those of the surface itself, it has their colours instead.
    color : str
        The colour of the surface, "#rrggbb" or a name.
    up : {"x", "y", "z"}, optional
        The axis that points up in the picture; by default ``mesh.up``, or else "z".
    view : str or array_like of shape (3,), optional
        From where to look: "front", "back", "left", "right", "top", "bottom" or "iso", or the
        direction from the surface to the camera. The front is seen from +z if y is up, as in glTF
        and Maya, and from -y otherwise; right is +x for both y and z. By default from the front and
        above, and onto a flat surface from its front.
    axes : bool
        Whether to draw a box around it with the numbers of its points.
    scale_bar : bool
        Whether to draw a bar of a round length, in the units of the points (of ``mesh.units`` if
        there are any), which holds at the distance of the middle. Not in pages and windows.
    dark : bool
        Whether to draw on a dark ground.
    window_size : (int, int)
        Width and height in pixels.
    off_screen : bool, optional
        Whether to draw without a window. By default that is so if there is a ``file``, and in a
        notebook, which shows the picture itself; otherwise a window opens, and the call returns
        when it is closed.
    return_plotter : bool
        Whether to return a ``pyvista.Plotter`` that shows all this, in the units of the points, for
        more to be added, instead of a picture. ``show()`` and ``close()`` it yourself.
    workers : int
        Threads that evaluate the surface, as for `LimitSurface.evaluate`.

    Returns
    -------
    Picture or pyvista.Plotter
        A picture has its pixels as `image`; `save` and `interactive` make files and pages of it.

    Raises
    ------
    ValueError
        Points of another shape, a channel that the mesh does not have, a bad ``n``, ``isolines``,
        ``scalars``, ``limits``, ``cmap``, ``label``, ``color``, ``up``, ``view`` or
        ``window_size``; ``limits``, ``cmap`` or ``label`` without scalars that have a colour bar;
        no finite scalar; a file with another suffix, or one beside ``return_plotter``; nothing to
        draw; with ``axes``, ``scale_bar`` or ``return_plotter`` sizes beyond 1e-300 to 1e300.
    ImportError
        Without PyVista, for a page without trame-vtk (``pip install "limitsurf[plot]"``).
    OSError
        A file that cannot be written; no display to open a window on.

    Warns
    -----
    UserWarning
        Without OpenGL: the picture is painted by Matplotlib, and plainer, without ``axes``. Before
        more than a million polygons are drawn.

    Examples
    --------
    >>> import limitsurf as ls
    >>> quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    >>> cube = ls.Mesh([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], quads)
    >>> surface = ls.LimitSurface(cube)
    >>> ls.plot(surface, off_screen=True, scalars="mean", window_size=(320, 240)).image.shape
    (240, 320, 3)

    A page to turn in a browser, of a scalar of our own:

    >>> ls.plot(surface, "cube.html", scalars=lambda face, u, v: u * v)  # doctest: +SKIP

    A picture with something of our own in it:

    >>> plotter = ls.plot(surface, off_screen=True, return_plotter=True)
    >>> _ = plotter.add_point_labels([[0.5, 0.5, 1.2]], ["above"])
    >>> plotter.close()
    """
    surface = _surface(surface)
    layout = channel is not None and surface.of_channel(channel).points.shape[1:] == (2,)
    if return_plotter:
        if file is not None:
            raise ValueError("a plotter writes its own files: give no file with return_plotter")
    else:
        kind = pictures.LayoutDrawing if layout else pictures.SceneDrawing
        pictures.check_target(file, off_screen, kind.suffixes)
        if not layout and pictures.draws_at_once(file, off_screen):
            render.begin()
    n = None if n is None else checked_integer("n", n, 1)
    isolines = checked_integer("isolines", isolines, 0)
    with_bar = _has_bar(scalars, {"limits": limits, "cmap": cmap, "label": label})
    if limits is not None:
        limits = _checked_limits(limits)
    up = (surface.mesh.up or "z") if up is None else up
    if up not in ("x", "y", "z"):
        raise ValueError(f"up must be 'x', 'y' or 'z', got {up!r}")
    _check_view(view)
    width, height = _checked_size(window_size)
    _check_number(len(surface.limit_faces) * (n or 1) ** 2)
    memory.refuse_beyond(width * height, 100, "pixels")
    pyvista = imported_pyvista()
    try:
        body = pyvista.Color(color).float_rgb
    except (TypeError, ValueError):
        raise ValueError(f'color must be a name or "#rrggbb", got {color!r}') from None
    if cmap is not None:
        _check_colormap(cmap)
    wishes = Wishes(
        *(n, cage, curves, poles, normals, isolines, scalars, limits, cmap, label, with_bar),
        *(channel, body, up, view),
        look=DARK if dark else LIGHT,
        box=axes and not layout,
        ruler=scale_bar and not layout,
        workers=threads(workers),
    )
    if axes or scale_bar or return_plotter:
        _check_extent(surface.of_channel(channel))
    make = partial(build, surface, wishes)
    drawing = pictures.SceneDrawing(make, (width, height), with_bar)
    if layout and channel is not None:
        torn = partial(seams, surface, channel)
        size = width, height
        drawing = pictures.LayoutDrawing(make, size, with_bar, torn, channel, wishes.look)
    if return_plotter:
        return drawing.plotter(off_screen)
    return pictures.finished(drawing, (width, height), file, off_screen)


def _has_bar(scalars: Any, wanted: Mapping[str, Any]) -> bool:
    """Whether scalars have a colour bar; ValueError for what is wanted of one if not."""
    if isinstance(scalars, str) and scalars not in (*CURVATURES, "zebra"):
        known = ", ".join(map(repr, [*CURVATURES, "zebra"]))
        raise ValueError(f"scalars must be one of {known}, a function or an array, got {scalars!r}")
    with_bar = scalars is not None and not (isinstance(scalars, str) and scalars == "zebra")
    for name, value in wanted.items():
        if value is not None and not with_bar:
            raise ValueError(f"{name} needs scalars that have a colour bar, got {scalars!r}")
    if not isinstance(wanted["label"], str | None):
        raise ValueError(f"label must be text, got {wanted['label']!r}")
    return with_bar


def _check_number(polygons: int) -> None:
    """Refuse more polygons than memory holds; a hint before many are drawn."""
    memory.refuse_beyond(polygons, POLYGON, "polygons")
    if polygons > MANY:
        text = f"drawing {polygons:,} polygons, which may take minutes and gigabytes"
        warnings.warn(f"{text}: give a smaller n, or a part of the mesh", stacklevel=users_level())


def _check_extent(surface: LimitSurface) -> None:
    """ValueError where lengths in the user's units are beyond what can be said."""
    _, extent, middle = unit_points(surface.mesh)
    if not (1e-300 < extent < 1e300 and np.abs(middle).max() < 1e300):
        raise ValueError(
            f"axes, scale_bar and return_plotter need sizes from 1e-300 to 1e300, got {extent:.3g}"
        )


def _surface(given: LimitSurface | Mesh) -> LimitSurface:
    """What is to be drawn; TypeError that says what to do with anything else."""
    if isinstance(given, Mesh):
        return LimitSurface(given)
    if isinstance(given, LimitSurface):
        return given
    advice = "; draw a tessellation by ls.to_pyvista(it).plot()"
    kind = type(given).__name__
    raise TypeError(f"need a LimitSurface or a Mesh, got {kind}{advice * (kind == 'Tessellation')}")


def plot_characteristic_map(
    scheme: str | Scheme = "catmull-clark",
    file: Path | None = None,
    *,
    valence: int | None = None,
    kind: str | None = None,
    faces: int | None = None,
    isolines: int = 7,
    rings: int = 5,
    axes: bool = False,
    dark: bool = False,
    window_size: tuple[int, int] = (1200, 1200),
    off_screen: bool | None = None,
) -> Picture:
    """Draw the characteristic map around a special vertex.

    The map takes the faces around the vertex into the plane by the two eigenfunctions of the
    tangent plane. Each halving of the parameters shrinks its image by the subdominant eigenvalue
    lambda: the image is made of nested rings, lambda^n times the first. Lines of constant u and v
    are denser by two from ring to ring, so that rings look alike.

    Parameters
    ----------
    scheme : str or Scheme
        A name such as "catmull-clark", or a scheme of your own.
    file : str or os.PathLike, optional
        A ``.svg``, ``.pdf``, ``.png``, ``.jpg`` or ``.webp`` file to write.
    valence : int, optional
        Number of faces around a smooth interior vertex, at least 3.
    kind : {"crease", "corner", "dart"}, optional
        Instead: what the vertex is, as for `eigenbasis`. Where the two eigenvalues differ, rings
        shrink by another factor each way, and are numbered.
    faces : int, optional
        With `kind`: the number of faces of the sector.
    isolines : int
        Lines of constant u in each sector and ring, and as many of constant v.
    rings : int
        How many rings are drawn inside of the first, at least 0.
    axes : bool
        Whether to draw the numbers of the plane, in which the outline is as the eigenvectors are
        scaled.
    dark : bool
        As for `plot`.
    window_size : (int, int)
        Width and height in pixels.
    off_screen : bool, optional
        As for `plot`.

    Returns
    -------
    Picture

    Raises
    ------
    ValueError
        Neither or both of `valence` and `kind`; numbers that are no integers or too small; a vertex
        without two eigenfunctions that span a tangent plane: valence 2, creases of 1 and of 4 and
        more faces, corners of 3 and more, darts of 2, cones.

    Notes
    -----
    After Reif, "A unified approach to subdivision algorithms near extraordinary vertices", Computer
    Aided Geometric Design 12, 1995. Both eigenfunctions are drawn from their exact values, as limit
    surfaces of eigenvectors of one step of refinement (``derivations/eigenfunctions.py``).

    Examples
    --------
    >>> import limitsurf as ls
    >>> ls.plot_characteristic_map(valence=5, off_screen=True, window_size=(300, 300))
    <Picture of 300 x 300 pixels>
    """
    if (valence is None) == (kind is None and faces is None) or (kind is None) != (faces is None):
        raise ValueError(
            f"give either valence, or kind and faces; got {valence!r}, {kind!r} and {faces!r}"
        )
    pictures.check_target(file, off_screen, charts.ChartDrawing.suffixes)
    isolines, rings = checked_integer("isolines", isolines, 0), checked_integer("rings", rings, 0)
    fan = (
        _fan(scheme, valence)
        if kind is None
        else _fan(scheme, checked_integer("faces", faces, 1), kind)
    )
    fan.characteristic_map()  # says now what there is not
    look = DARK if dark else LIGHT
    draw = partial(
        charts.draw_characteristic_map,
        fan=fan,
        isolines=isolines,
        rings=rings,
        ticks=bool(axes),
        look=look,
    )
    return _chart(draw, window_size, file, off_screen, look)


def plot_eigenfunctions(
    scheme: str | Scheme = "catmull-clark",
    file: Path | None = None,
    *,
    valence: int,
    which: int | None = None,
    dark: bool = False,
    window_size: tuple[int, int] = (1600, 1200),
    off_screen: bool | None = None,
) -> Picture:
    """Draw eigenfunctions of subdivision around a smooth vertex, over the characteristic map.

    An eigenfunction is the limit of an eigenvector of one step of refinement: at half the
    parameters it has lambda times the value. All limit surfaces around a vertex of this valence are
    sums of them; the eigenvalues say how fast each fades towards the vertex.

    Parameters
    ----------
    file : str or os.PathLike, optional
        A file to write: ``.png``, ``.jpg``, ``.webp``, and of a single one ``.html``, of a panel
        ``.svg`` and ``.pdf``.
    valence : int
        Number of faces around the vertex, at least 3.
    which : int, optional
        Only this one, counted from 0, the constant, by decreasing eigenvalue; of two that are
        turned against each other the one that is symmetric about the first edge comes first. By
        default a panel of the first after the constant, one of each such pair.
    scheme, dark, window_size, off_screen
        As for `plot_characteristic_map`.

    Returns
    -------
    Picture

    Raises
    ------
    ValueError
        A valence below 3, a `which` that is no integer; a scheme of your own with complex
        eigenvalues or without a basis of eigenvectors.
    IndexError
        For `which` beyond the last.

    Notes
    -----
    After Stam (1998), who shows them in Figure 6; derived in ``derivations/eigenfunctions.py``.
    Modes have a frequency: waves once around the vertex.

    Examples
    --------
    >>> import limitsurf as ls
    >>> ls.plot_eigenfunctions(valence=5, which=1, off_screen=True, window_size=(320, 240))
    <Picture of 320 x 240 pixels>
    """
    kinds = charts.ChartDrawing if which is None else pictures.SceneDrawing
    pictures.check_target(file, off_screen, kinds.suffixes)
    size, look = _checked_size(window_size), DARK if dark else LIGHT
    which = None if which is None else checked_integer("which", which)
    fan = _fan(scheme, valence)
    plane = fan.characteristic_map()
    plane = plane / np.hypot(*plane[fan.number[:, :2, :2]].reshape(-1, 2).T).max()
    modes = fan.modes()
    if which is not None:
        if not -len(modes) <= which < len(modes):
            raise IndexError(f"which is {which}, but there are {len(modes)} eigenfunctions")
        drawing = _graph(fan, plane, modes[which], size, look, True)
        return pictures.finished(drawing, size, file, off_screen)
    shown = [m for m in modes[1:] if not (m.sine and m.paired)][: charts.PANEL]
    small = charts.picture_size(size)

    def draw(figure: Any) -> None:
        images = [_graph(fan, plane, mode, small, look, False).pixels() for mode in shown]
        names = [charts.mode_name(mode) for mode in shown]
        charts.draw_panel(figure, images, names, charts.title(fan, "eigenfunctions"), look)

    return _chart(draw, size, file, off_screen, look)


def _graph(
    fan: Fan, plane: NDArray[Any], mode: Mode, size: tuple[int, int], look: Look, alone: bool
) -> pictures.SceneDrawing:
    """An eigenfunction over the characteristic map, with a colour bar if it is alone."""
    places = Net(fan.lattice, 16).places
    limits = fan.limit(mode.values).evaluate(np.arange(fan.faces)[:, None], *places)
    height = mode.values / np.abs(limits).max()
    surface = fan.surface(np.column_stack([plane, HEIGHT * height]))
    wishes = Wishes(
        cage=False,
        poles=False,
        curves=True,
        isolines=3,
        # rounding may take the largest beyond the ends of the colours
        scalars=lambda face, u, v: fan.surface(height).evaluate(face, u, v).clip(-1.0, 1.0),
        cmap=DIVERGING,
        limits=(-1.0, 1.0),
        label=charts.mode_name(mode),
        bar=alone,
        view=GRAPH_VIEW,
        look=look,
        flat=not alone,
    )
    return pictures.SceneDrawing(partial(build, surface, wishes), size, alone)


def plot_convergence(
    surfaces: LimitSurface | Mesh | Mapping[str, LimitSurface | Mesh],
    file: Path | None = None,
    *,
    levels: int = 4,
    channel: str | None = None,
    dark: bool = False,
    window_size: tuple[int, int] = (1600, 1200),
    off_screen: bool | None = None,
    workers: int = 1,
) -> Picture:
    """Draw how recursive refinement approaches the surface, beside what theory says it does.

    The error is that of `validate`: the largest distance of a refined vertex from the surface at
    the parameters that it stands for, here in parts of the cage's largest extent. The legend gives
    the order of the last step, and the order that it tends to, which is also the slope of the
    dashed lines: 2 where all is regular, log2(1 / lambda) at an extraordinary vertex of subdominant
    eigenvalue lambda, the least of which wins in the end.

    Parameters
    ----------
    surfaces : LimitSurface or Mesh, or mapping of names to them
        Of float64 points. Of a mesh it is ``LimitSurface(mesh)``.
    file : str or os.PathLike, optional
        A ``.svg``, ``.pdf``, ``.png``, ``.jpg`` or ``.webp`` file to write.
    levels : int
        How many levels to refine, at least 1; memory and time grow by four with each.
    channel, workers
        As for `validate`.
    window_size : (int, int)
        Width and height in pixels.
    dark, off_screen : bool, optional
        As for `plot`.

    Returns
    -------
    Picture

    Raises
    ------
    ValueError, TypeError
        As for `validate`; no surface at all.

    Notes
    -----
    Derived in ``derivations/convergence.py``. Where cages are semi-sharp, orders settle only after
    as many levels as they are sharp.

    Examples
    --------
    >>> import limitsurf as ls
    >>> quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    >>> cube = ls.Mesh([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], quads)
    >>> ls.plot_convergence({"cube": ls.LimitSurface(cube)}, levels=3, off_screen=True)
    <Picture of 1600 x 1200 pixels>
    """
    from limitsurf.spectra.fan import predicted_order  # not for every picture

    named = surfaces if isinstance(surfaces, Mapping) else {"": surfaces}
    pictures.check_target(file, off_screen, charts.ChartDrawing.suffixes)
    if not named:
        raise ValueError("plot_convergence needs at least one surface, got none")
    errors, orders = {}, {}
    for name, of_points in named.items():
        surface = _surface(of_points).of_channel(channel)
        used = surface.mesh.points[np.unique(surface.mesh.indices)].astype(np.float64)
        extent = np.ptp(used.reshape(len(used), -1), axis=0).max() or 1.0
        errors[str(name)] = validate(surface, levels, workers=workers)["error"] / extent
        orders[str(name)] = predicted_order(surface)
    look = DARK if dark else LIGHT
    draw = partial(charts.draw_convergence, errors=errors, orders=orders, look=look)
    return _chart(draw, window_size, file, off_screen, look)


def plot_spectrum(
    scheme: str | Scheme | Iterable[str | Scheme] = "catmull-clark",
    file: Path | None = None,
    *,
    valences: Iterable[int] = range(3, 13),
    dark: bool = False,
    window_size: tuple[int, int] = (1600, 800),
    off_screen: bool | None = None,
) -> Picture:
    """Draw what eigenvalues schemes have at smooth vertices, and how curvature behaves there.

    On the left, over the number of faces N, the largest eigenvalue but 1 of the Fourier
    frequencies 0 (cups), 1 (the tangent plane) and 2 (saddles): surfaces have a tangent plane where
    that of frequency 1 is above the others. On the right by what curvature is multiplied at each
    halving of the parameters: it is unbounded where that is above 1, and tends to 0 below.

    Parameters
    ----------
    scheme : str or Scheme, or several of them
        Names such as "catmull-clark", or schemes of your own.
    file : str or os.PathLike, optional
        A ``.svg``, ``.pdf``, ``.png``, ``.jpg`` or ``.webp`` file to write.
    valences : iterable of int
        Numbers of faces, at least 2 each. There is no curvature where there is no tangent plane.
    window_size : (int, int)
        Width and height in pixels.
    dark, off_screen : bool, optional
        As for `plot`.

    Returns
    -------
    Picture

    Raises
    ------
    ValueError
        No scheme, or no valence; a valence that is no integer of at least 2; and as
        `spectral_analysis`, for masks without a limit, and schemes by which no vertex is special.

    Notes
    -----
    Everything is decided as by `spectral_analysis`; derived in ``derivations/analysis.py``.

    Examples
    --------
    >>> import limitsurf as ls
    >>> ls.plot_spectrum(["loop", "doo-sabin"], valences=range(3, 7), off_screen=True)
    <Picture of 1600 x 800 pixels>
    """
    from limitsurf.spectra import spectral_analysis  # not for every picture

    pictures.check_target(file, off_screen, charts.ChartDrawing.suffixes)
    given: Any = scheme
    several = [given] if isinstance(given, str) or hasattr(given, "lattice") else [*given]
    faces = [checked_integer(f"valences[{k}]", n, 2) for k, n in enumerate(valences)]
    if not several or not faces:
        raise ValueError(f"need a scheme and a valence at least, got {several!r} and {faces!r}")
    found = {}
    for one in several:
        analyses = [spectral_analysis(one, valence=n) for n in faces]
        found[analyses[0].scheme.name] = analyses
    look = DARK if dark else LIGHT
    draw = partial(charts.draw_spectrum, found=found, look=look)
    return _chart(draw, window_size, file, off_screen, look)


def _chart(
    draw: Callable[[Any], None],
    window_size: tuple[int, int],
    file: Path | None,
    off_screen: bool | None,
    look: Look,
) -> Picture:
    size = _checked_size(window_size)
    return pictures.finished(charts.ChartDrawing(draw, size, look), size, file, off_screen)


def _fan(scheme: str | Scheme, faces: Any, kind: str = "interior") -> Fan:
    from limitsurf.spectra.dual_fan import fan_of  # not for every picture

    if kind == "interior":
        faces = checked_integer("valence", faces, 3)
    return fan_of(scheme, kind, faces)


def _checked_size(window_size: Any) -> tuple[int, int]:
    try:
        width, height = window_size
    except (TypeError, ValueError):
        need = "window_size must be two integers, width and height in pixels"
        raise ValueError(f"{need}, got {window_size!r}") from None
    return checked_integer("window_size[0]", width, 1), checked_integer("window_size[1]", height, 1)


def _checked_limits(limits: Any) -> tuple[float, float]:
    pair = real_numbers(limits, "limits")
    if pair.shape != (2,) or not np.isfinite(pair).all() or not pair[0] < pair[1]:
        raise ValueError(f"limits are two finite numbers, the lower one first, got {limits!r}")
    return float(pair[0]), float(pair[1])


def _check_view(view: Any) -> None:
    if view is None or (isinstance(view, str) and view in VIEWS):
        return
    need = f"view is one of {', '.join(map(repr, VIEWS))}, or a direction of three numbers"
    if isinstance(view, str):
        raise ValueError(f"{need}, got {view!r}")
    direction = real_numbers(view, "view")
    if direction.shape != (3,) or not np.isfinite(direction).all() or not direction.any():
        raise ValueError(f"{need}, got {view!r}")


def _check_colormap(cmap: Any) -> None:
    from matplotlib import colormaps
    from matplotlib.colors import Colormap

    if not (isinstance(cmap, Colormap) or (isinstance(cmap, str) and cmap in colormaps)):
        raise ValueError(f"cmap is the name of a Matplotlib colour map, got {cmap!r}")
