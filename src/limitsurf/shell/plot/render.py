"""Scenes drawn by VTK, through PyVista: off screen, in a window, and as pages for a browser."""

from __future__ import annotations

import base64
import functools
import html
import io
import json
import os
import re
import subprocess
import sys
import warnings
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.checks import users_level
from limitsurf.shell.io.vtk import imported_pyvista
from limitsurf.shell.plot import paint
from limitsurf.shell.plot import scene as scenes
from limitsurf.shell.plot.paint import Image
from limitsurf.shell.plot.scene import Array, Box, Lines, Scene

TRIAL = 60  # seconds after which VTK counts as unable to draw
SURFACE = "surface"  # the name of its actor
LETTERS = 0.022  # height of the numbers of axes, as a part of the picture's
SUPERSAMPLING = 2  # pixels drawn per pixel of the picture, each way


def pixels(scene: Scene, width: int, height: int) -> Image:
    """The scene, (height, width, 3), without legends; drawn off screen."""
    if not opengl():
        text = "no OpenGL here: painted by Matplotlib, and plainer"
        warnings.warn(text, stacklevel=users_level())
        return paint.painted(scene, width, height)
    # Drawn larger and averaged, which smooths lines and dots as well.
    scale = SUPERSAMPLING
    with _plotter(scene, scale * width, scale * height, True) as plotter:
        return paint.averaged(np.asarray(plotter.screenshot(return_img=True)), scale)


def window(scene: Scene, width: int, height: int) -> Image:
    """Show the scene in a window until it is closed; the last picture, (height, width, 3)."""
    # None leaves PYVISTA_OFF_SCREEN its say.
    with _plotter(scene, width, height, None) as plotter:
        _explain(plotter, scene)
        return np.asarray(plotter.show(auto_close=False, screenshot=True))


def plotter(scene: Scene, width: int, height: int, off_screen: bool | None) -> Any:
    """A PyVista plotter that shows the scene in the user's space, for whoever asks to close."""
    scene = scene.in_units()
    with _calm_vtk():
        found = _made(scene, width, height, off_screen, page=False)
        _explain(found, scene)
        # what is added may be nearer than all of the scene, or farther
        found.camera.clipping_range = 0.02 * scene.distance, 50 * scene.distance
        if found.off_screen:
            found.render()  # when VTK says that there is no X server
    _push_back()
    return found


def _explain(plotter: Any, scene: Scene) -> None:
    """Add what a picture has beside its scene: legend and colour bar."""
    plotter.enable_anti_aliasing("msaa")
    label = None if scene.field is None else scene.field.label
    if scene.dots:
        names = [(dots.name, dots.color) for dots in scene.dots]
        place = {
            "loc": "lower left" if label is not None else "lower right",
            "size": (0.2, 0.05 * len(names)),
        }
        plotter.add_legend(names, face="circle", bcolor=None, **place)
    if label is not None:
        plotter.add_scalar_bar(
            label.replace("$", ""),
            mapper=plotter.actors[SURFACE].mapper,
            vertical=True,
            color=scene.look.ink,
            n_labels=5,
            fmt="%.3g",
            position_x=0.84,
            position_y=0.2,
            height=0.6,
            title_font_size=round(0.025 * plotter.window_size[1]),
            label_font_size=round(0.022 * plotter.window_size[1]),
        )


def page(scene: Scene, width: int, height: int) -> str:
    """The scene as a page of HTML that needs nothing else, to be turned in a browser.

    Raises
    ------
    ImportError
        Without trame-vtk.
    """
    with _plotter(scene, width, height, True, page=True) as plotter:
        text = _viewer(plotter.render_window)
    shown = []
    if scene.field is not None and scene.field.label is not None:
        shown.append((paint.bar(scene.field, 1200, scene.look.ink), "right:0;top:14%;height:72%"))
    if scene.dots:
        explained = paint.legend(scene.dots, 1200, scene.look.ink)
        height = 100 * explained.shape[0] / 1200
        shown.append((explained, f"right:1%;bottom:1%;height:{height:.1f}%"))
    boxes = "".join(
        '<img alt="" src="data:image/png;base64,'
        f'{base64.b64encode(paint.encoded(image)).decode()}" '
        f'style="position:fixed;pointer-events:none;z-index:9;{style}">'
        for image, style in shown
    )
    # The viewer empties what it draws into: without such a container all of the body.
    container = '<div class="content"></div>'
    head = '<title>limitsurf</title><link rel="icon" href="data:,">'
    text = re.sub(r"<title>[^<]*</title>", head, text, count=1)
    end = text.rindex("</body>")
    return text[:end] + container + boxes + text[end:]


def _viewer(window: Any) -> str:
    """A page with what a render window shows, and with the viewer that draws it.

    trame would run a server, and fetch things, to say the same; its serialisers alone do neither.
    """
    try:
        from trame_vtk.modules.vtk import serializers as vtkjs
        from trame_vtk.tools.vtksz2html import write_html
    except ImportError as error:
        need = 'trame-vtk is needed for interactive pages: pip install "limitsurf[plot]"'
        raise ImportError(need) from error
    vtkjs.initialize_serializers()
    context = vtkjs.SynchronizationContext()
    context.set_ignore_last_dependencies(True)  # all of it, not only what has changed
    scene = vtkjs.serialize(None, window, vtkjs.reference_id(window), context, 1)
    camera = window.GetRenderers().GetFirstRenderer().GetActiveCamera()
    scene["extra"] = {
        "vtkRefId": vtkjs.reference_id(window),
        "centerOfRotation": camera.GetFocalPoint(),
        "camera": vtkjs.reference_id(camera),
    }
    arrays = {
        array["hash"]: {**array, "content": context.get_cached_data_array(array["hash"], False)}
        for array in vtkjs.extract_array_hash(scene)
    }
    packed, text = io.BytesIO(), io.StringIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("index.json", json.dumps({"hashes": arrays, "scene": scene}))
    write_html(packed.getvalue(), text)
    # The icons of the viewer's own home page; a page asks nothing of the network.
    return re.sub(r"https://kitware\.github\.io/[^\"'`]+\.png", "data:,", text.getvalue())


def frame(text: str, height: int) -> str:
    """A page inside of another."""
    return (
        f'<iframe srcdoc="{html.escape(text)}" loading="lazy" '
        f'style="width:100%;height:{height}px;border:0"></iframe>'
    )


@contextmanager
def _plotter(
    scene: Scene, width: int, height: int, off_screen: bool | None, page: bool = False
) -> Iterator[Any]:
    """A PyVista plotter with the scene; of a page all is made of triangles and thin lines."""
    with _calm_vtk(), _offset():
        plotter = _made(scene, width, height, off_screen, page)
        try:
            yield plotter
        finally:
            plotter.close()


def _made(scene: Scene, width: int, height: int, off_screen: bool | None, page: bool) -> Any:
    pyvista = imported_pyvista()
    size = (width, height)
    plotter = pyvista.Plotter(off_screen=off_screen, window_size=size, lighting=None)
    try:
        for place, strength in paint.LIGHTS:
            light = pyvista.Light(position=place, light_type="camera light", intensity=strength)
            plotter.add_light(light)
        if page:
            plotter.set_background(scene.look.page)
        else:
            below, above = paint.ground(scene)
            plotter.set_background(below, top=above)
        _add(pyvista, plotter, scene, page)
        camera = plotter.camera
        camera.view_angle = scenes.VIEW_ANGLE
        camera.position = scene.eye
        camera.focal_point = scene.eye - scene.distance * scene.axes[2]
        camera.up = scene.axes[1]
        if scene.box is not None:
            _add_box(plotter, scene, scene.box)
        plotter.reset_camera_clipping_range()
    except BaseException:
        plotter.close()
        raise
    return plotter


def _add(pyvista: Any, plotter: Any, scene: Scene, page: bool) -> None:
    """Let a plotter show all of a scene, in a page for a browser if so."""
    _add_surface(pyvista, plotter, scene, page)
    height = plotter.window_size[1]
    unit = 2 * scene.distance * np.tan(np.radians(scenes.VIEW_ANGLE / 2)) / 1000
    for lines in scene.lines:
        _add_lines(pyvista, plotter, lines, unit if page else None)
    for dots in scene.dots:
        cloud = pyvista.PolyData(dots.places)
        if page:
            ball = pyvista.Icosphere(radius=unit * scene.dot / 2, nsub=1)
            cloud = cloud.glyph(geom=ball, scale=False, orient=False)
        plotter.add_mesh(
            cloud,
            color=dots.color,
            point_size=height * scene.dot / 1000,
            render_points_as_spheres=not page,
            smooth_shading=page,
            ambient=0.5,
        )


def _add_box(plotter: Any, scene: Scene, box: Box) -> None:
    """Axes with the numbers of the user's space, on those sides of a box that are behind."""
    shown: dict[str, Any] = {}
    for axis, ticks in zip("xyz", box.ticks, strict=True):
        shown |= {f"show_{axis}axis": ticks > 1, f"n_{axis}labels": ticks, f"{axis}title": axis}
    plotter.show_bounds(
        bounds=((box.ends - scene.frame.middle) / scene.frame.extent).T.ravel(),
        axes_ranges=box.ends.T.ravel().tolist(),
        **shown,
        grid="back",
        location="outer",
        ticks="outside",
        color=scene.look.ink,
        font_size=max(8, round(LETTERS * plotter.window_size[1])),
        bold=False,
        fmt="%.6g",
        use_3d_text=False,
    )


def _add_surface(pyvista: Any, plotter: Any, scene: Scene, page: bool) -> None:
    field = scene.field
    values, limits = np.zeros(len(scene.points)), (0.0, 1.0)
    if field is not None:  # a page counts in 24 bits, a window shows the values
        values, limits = (field.shades, limits) if page else (field.values, field.limits)
    cells = scene.cells
    vertices: NDArray[Any] = np.column_stack([scene.points, scene.normals, values])
    if page:
        vertices, number = _joined(vertices)
        cells = number[cells]
    body = pyvista.PolyData.from_regular_faces(vertices[:, :3], cells)
    body.point_data.active_normals = vertices[:, 3:6]
    look: dict[str, Any] = {"color": scene.color}
    if field is not None:
        body["value"] = vertices[:, 6]
        cmap = paint.colormap(field)
        look = {
            **{"scalars": "value", "cmap": cmap, "n_colors": cmap.N, "clim": limits},
            **{"nan_color": scenes.MISSING, "interpolate_before_map": True},
            "show_scalar_bar": False,
        }
    ambient, diffuse, gloss = paint.material(scene)
    light = {"ambient": ambient, "diffuse": diffuse, "specular": gloss}
    actor = plotter.add_mesh(
        body, name=SURFACE, **look, **light, specular_power=paint.SHARPNESS, smooth_shading=True
    )
    # Pushed back a little, it does not hide the lines that lie on it.
    actor.mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(2.0, 2.0)


def _add_lines(pyvista: Any, plotter: Any, lines: Lines, page_unit: float | None) -> None:
    """Lines of one look; for a page, a thousandth of whose height is so long in the scene."""
    ends = lines.ends
    if page_unit is not None and lines.normals is not None:  # nothing is pushed back: both sides
        ends = np.concatenate([ends + side * scenes.LIFT * lines.normals for side in (1, -1)])
    places: NDArray[Any] = ends.reshape(-1, 3)
    number = np.arange(len(places))
    if page_unit is not None:
        places, number = _joined(places)
    cells = np.insert(number.reshape(-1, 2), 0, 2, axis=1)
    wires = pyvista.PolyData(places, lines=cells)
    thickness = plotter.window_size[1] * lines.width / 1000
    if page_unit is not None:  # lines there have one pixel, on most machines
        thickness = 1.0
        if lines.width >= scenes.CREASE:
            wires = wires.tube(radius=page_unit * lines.width / 2, n_sides=6)
    plotter.add_mesh(wires, color=lines.color, line_width=thickness, lighting=False)


def _joined(rows: Array) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Rows (m, d) rounded, without repetitions, and the new number of each row.

    They keep 16 bits of what the columns span: a page of them is small.
    """
    low, high = np.nanmin(rows, axis=0, initial=0), np.nanmax(rows, axis=0, initial=0)
    step = np.exp2(np.ceil(np.log2(np.maximum(high - low, 1e-300))) - 16)
    rounded = (np.rint(rows / step) * step).astype(np.float32)
    keys = np.ascontiguousarray(rounded).view(np.dtype((np.void, 4 * rows.shape[1]))).ravel()
    _, first, number = np.unique(keys, return_index=True, return_inverse=True)
    return rounded[first], number.ravel()


@contextmanager
def _offset() -> Iterator[None]:
    """Let mappers push polygons back, which VTK switches for all of them."""
    from vtkmodules.vtkRenderingCore import vtkMapper

    before = vtkMapper.GetResolveCoincidentTopology()
    _push_back()
    try:
        yield
    finally:
        vtkMapper.SetResolveCoincidentTopology(before)


def _push_back() -> None:
    from vtkmodules.vtkRenderingCore import vtkMapper

    vtkMapper.SetResolveCoincidentTopologyToPolygonOffset()


def check_display() -> None:
    """OSError without a display."""
    if not _display():
        raise OSError(
            "there is no display to open a window on; give the name of a picture to write, or say "
            "off_screen=True"
        )


def _display() -> bool:
    if sys.platform != "linux":
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


@functools.cache
def _trial() -> subprocess.Popen[bytes]:
    """A process that ends with 0 if VTK can draw here."""
    trial = (
        "import vtkmodules.vtkRenderingOpenGL2\n"
        "from vtkmodules.vtkRenderingCore import vtkRenderWindow\n"
        "window = vtkRenderWindow()\n"
        "window.SetOffScreenRendering(1)\n"
        "window.Render()\n"
        "raise SystemExit(not window.SupportsOpenGL())\n"
    )
    # -P: modules of the working directory are not VTK's
    command = [sys.executable, "-P", "-c", trial]
    silent = subprocess.DEVNULL
    return subprocess.Popen(command, stdin=silent, stdout=silent, stderr=silent)


def begin() -> None:
    """Start to find out whether there is OpenGL: it takes as long as to import PyVista."""
    if sys.platform == "linux":
        _trial()


@functools.cache
def opengl() -> bool:
    """Whether VTK can draw here. Where it cannot it crashes, so another process finds out."""
    if sys.platform != "linux":
        return True
    trial = _trial()
    try:
        return trial.wait(TRIAL) == 0
    except subprocess.TimeoutExpired:
        trial.kill()
        trial.wait()
        return False


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
