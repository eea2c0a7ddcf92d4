"""What a picture of a limit surface shows: places, colours, lines, dots, and the camera.

The surface is drawn from values of itself: a grid of exact positions and normals on each limit
face. All is moved and scaled so that the cage just fits the unit box; scalars keep the user's
units.
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf.scheme.net import Net

if TYPE_CHECKING:
    from limitsurf.scheme.lattice import Lattice
    from limitsurf.surface import LimitSurface

Array: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
Query: TypeAlias = tuple[IntArray, Array, Array]  # face, u, v
RGB: TypeAlias = tuple[float, float, float]
Color: TypeAlias = str | RGB
Scalars: TypeAlias = str | Callable[..., ArrayLike] | ArrayLike

COLOR = "#e8805f"
MISSING = "#b8bcc0"  # where a scalar is NaN
POLYGONS = 200_000  # drawn in all, unless told otherwise
# Where the camera stands, for z up, where the front faces -y. Another axis that is up takes z's
# place by a turn about the third one, under which the front faces +z if y is up (as in glTF and
# Maya), and -y if x is.
VIEW = (-0.35, -1.0, 0.6)
VIEWS = {  # the same by name
    "front": (0.0, -1.0, 0.0),
    "back": (0.0, 1.0, 0.0),
    "left": (-1.0, 0.0, 0.0),
    "right": (1.0, 0.0, 0.0),
    "top": (0.0, 0.0, 1.0),
    "bottom": (0.0, 0.0, -1.0),
    "iso": (-1.0, -1.0, 1.0),
}
VIEW_ANGLE = 30.0  # degrees, of the picture's height
MARGIN = 0.06  # of the picture, on each side
AXES_MARGIN = 0.13  # the same, with room for numbers
DOT = 13.0  # diameter of a dot, in thousandths of the picture's height
CREASE = 3.0  # thickness of creases, in the same
LIFT = 0.0015  # of curves off the surface, in units of the cage
NEEDLES = 400  # normals in all, unless there are more limit faces
NORMAL, SEAM = "#0f4c96", "#1f6fc4"
CROWD = 10_000  # limit faces; of more, cage and curves would hide the surface
FEW = 1_000  # limit faces; of more, dots are smaller
VALENCES: dict[float, str] = {  # the largest of each class, and its colour
    **{2: "#17becf", 3: "#1f6fc4", 4: "#9acd32", 5: "#f5b82e"},
    **{6: "#2e9e5b", 7: "#e377c2", 8: "#7d3fb0", 16: "#c2185b", math.inf: "#111111"},
}
UNITS = {1.0: " m", 1e-2: " cm", 1e-3: " mm", 1e3: " km", 0.0254: " in", 0.3048: " ft"}

CURVATURES = {  # what can be drawn of `LimitSurface.curvature`: its name, its power of 1 / length
    "mean": ("mean curvature", 1),
    "gaussian": ("Gaussian curvature", 2),
    "k1": ("principal curvature $k_1$", 1),
    "k2": ("principal curvature $k_2$", 1),
}
DIVERGING, SEQUENTIAL = "coolwarm", "viridis"  # even steps to the eye, safe for colour blindness
OUTLIERS = 2.0  # percent of the values, at each end, that a range of colours leaves out
FLATNESS = 1e-6  # curvature in units of the unit box that counts as none
SMALLEST, LARGEST = map(float, (np.finfo(np.float64).tiny, np.finfo(np.float64).max))
STRIPES = 12  # from end to end of the zebra's environment
ZEBRA = ("#20262c", "#f4f4f2")


@dataclass(frozen=True)
class Look:
    """Colours of all but the surface."""

    ground: str  # behind a scene, at the bottom
    sky: str  # and at the top
    page: str  # behind it in a page to turn
    paper: str  # of a diagram
    ink: str  # letters, cages, axes
    grid: str  # of a diagram
    sectors: tuple[str, str]  # of a characteristic map, by turns
    isoline: str
    ring: str


LIGHT = Look(
    *("#dde5ec", "#ffffff", "#f1f4f7", "#ffffff", "#263442", "#d5dbe1"),
    *(("#f6d9cf", "#fbeee9"), "#8a5a4a", "#1f6fc4"),
)
DARK = Look(
    *("#11161b", "#2b353f", "#1b2229", "#14181e", "#dbe3ea", "#36404a"),
    *(("#6b3a2a", "#4a2a20"), "#c98f7a", "#74b3f5"),
)


@dataclass(frozen=True)
class Frame:
    """Where a scene is in the user's space: there a place p of it is ``middle + extent * p``."""

    middle: Array  # (3,)
    extent: float
    unit: str = ""  # what the user's numbers count

    def placed(self, points: Array) -> Array:
        """Points of the scene, (..., 3), in the user's space."""
        return self.middle + self.extent * points


@dataclass(frozen=True)
class Box:
    """Axes around a scene, from a round number to another."""

    ends: Array  # (2, 3), in the user's space
    ticks: list[int]  # on each axis, the ends included; 1 where there is no extent

    @classmethod
    def around(cls, points: Array) -> Box:
        """That of points (k, 3) in the user's space."""
        from matplotlib.ticker import MaxNLocator

        low, high = points.min(axis=0), points.max(axis=0)
        slack = 1e-9 * (high - low)  # rounding is not to take it to the next round number
        low, high = low + slack, high - slack
        locator = MaxNLocator(4, steps=[1, 2, 5, 10])
        ends, ticks = np.stack([low, high]), [1, 1, 1]
        for k in range(3):
            if high[k] - low[k] > 1e-6 * (high - low).max():
                found = np.asarray(locator.tick_values(low[k], high[k]))
                ends[:, k], ticks[k] = found[[0, -1]], len(found)
        return cls(ends, ticks)


@dataclass(frozen=True)
class Lines:
    """Straight lines of one look."""

    ends: Array  # (k, 2, 3)
    color: Color
    width: float  # thousandths of the picture's height
    normals: Array | None = None  # (k, 2, 3) of the surface, if they lie on it


@dataclass(frozen=True)
class Dots:
    """Dots of one look, explained in the legend."""

    places: Array  # (k, 3)
    color: str
    name: str


@dataclass(frozen=True)
class Field:
    """A scalar that the surface is coloured by."""

    values: Array  # (p,), NaN where there is none
    limits: tuple[float, float]
    cmap: Any  # name of a Matplotlib colour map, or one
    label: str | None  # of the colour bar; None for none
    beyond: tuple[bool, bool] = (False, False)  # whether values lie below and above the limits

    @property
    def shades(self) -> Array:
        """The values as places in the range, (p,), from 0 to 1."""
        low, high = self.limits
        return (np.clip(self.values, low, high) - low) / (high - low)


@dataclass(frozen=True)
class Scene:
    """What is drawn, in units of the cage: its largest extent is 1."""

    points: Array  # (p, 3)
    normals: Array  # (p, 3)
    cells: IntArray  # (q, 3 or 4)
    outlines: IntArray  # (limit faces, k), the points around each
    color: RGB
    field: Field | None
    lines: list[Lines]
    dots: list[Dots]
    dot: float  # their diameter, thousandths of the picture's height
    axes: Array  # (3, 3), rows right, up, towards the viewer
    eye: Array  # (3,)
    distance: float  # from the eye to the middle of the scene
    look: Look
    flat: bool  # whether there is nothing behind it but paper
    frame: Frame
    box: Box | None
    bar: bool  # whether a length is drawn beside it

    def in_units(self) -> Scene:
        """The same in the user's space."""
        at, size = self.frame.placed, self.frame.extent
        return replace(
            self,
            points=at(self.points),
            lines=[replace(k, ends=at(k.ends)) for k in self.lines],
            dots=[replace(k, places=at(k.places)) for k in self.dots],
            eye=at(self.eye),
            distance=size * self.distance,
            frame=Frame(np.zeros(3), 1.0, self.frame.unit),
        )


@dataclass(frozen=True)
class Wishes:
    """What `limitsurf.plot` was asked to draw, and where those words are explained."""

    n: int | None = None
    cage: bool | None = None
    curves: bool | None = None
    poles: bool | None = None
    normals: bool = False
    isolines: int = 0
    scalars: Scalars | None = None
    limits: tuple[float, float] | None = None
    cmap: Any = None
    label: str | None = None
    bar: bool = True
    channel: str | None = None
    color: RGB = (0.91, 0.5, 0.37)
    up: str = "z"
    view: str | Sequence[float] | None = None
    look: Look = LIGHT
    flat: bool = False
    box: bool = False
    ruler: bool = False
    workers: int = 1


def build(surface: LimitSurface, wishes: Wishes, aspect: float, polygons: int) -> Scene:
    """The scene of a surface, of about so many polygons unless ``wishes.n`` says how many."""
    drawn = surface.of_channel(wishes.channel)
    places, extent, middle = unit_points(drawn.mesh)
    drawn = drawn.with_points(places)
    faces = len(drawn.limit_faces)
    net = Net(drawn.topology.lattice, _steps(faces, wishes, polygons))
    query = (np.arange(faces)[:, None], *net.places)
    normal = partial(drawn.normal, workers=wishes.workers)
    points = drawn.evaluate(*query, workers=wishes.workers).reshape(-1, 3)
    normals = filled(normal, query, net.lattice).reshape(-1, 3)
    normals[np.isnan(normals).any(axis=-1)] = (0.0, 0.0, 1.0)
    width = len(net.places[0])
    cells = (width * np.arange(faces)[:, None, None] + net.cells).reshape(-1, net.cells.shape[1])
    cells = cells[np.isfinite(points[cells]).all(axis=(1, 2))]
    if not len(cells):
        raise ValueError("nothing to draw: no limit face has a surface")
    lines = [k for k in map(_drawable, _lines(drawn, wishes, net)) if len(k.ends)]
    poles = wishes.poles or (wishes.poles is None and wishes.scalars is None)
    seen = [points[cells].reshape(-1, 3), *(k.ends.reshape(-1, 3) for k in lines)]
    frame = Frame(middle, extent, UNITS.get(drawn.mesh.units or 0.0, ""))
    box, margin = None, MARGIN
    if wishes.box:
        box, margin = Box.around(frame.placed(np.concatenate(seen))), AXES_MARGIN
        seen.append((np.stack(np.meshgrid(*box.ends.T), -1).reshape(-1, 3) - middle) / extent)
    axes, eye, distance = camera(np.concatenate(seen), wishes.up, wishes.view, aspect, margin)
    field = None
    if isinstance(wishes.scalars, str) and wishes.scalars == "zebra":
        field = _zebra(points, normals, axes, eye)
    elif wishes.scalars is not None:
        field = _field(surface, wishes, query, _areas(points, cells))
    return Scene(
        points=points,
        normals=normals,
        cells=cells,
        outlines=width * np.arange(faces)[:, None] + net.sides[:, :-1].ravel(),
        color=wishes.color,
        field=field,
        lines=lines,
        dots=extraordinary(drawn) if poles else [],
        dot=DOT * min(1.0, (FEW / faces) ** 0.25),
        axes=axes,
        eye=eye,
        distance=distance,
        look=wishes.look,
        flat=wishes.flat,
        frame=frame,
        box=box,
        bar=wishes.ruler,
    )


def _steps(faces: int, wishes: Wishes, polygons: int) -> int:
    """Into how many parts each edge of so many limit faces is cut."""
    n = wishes.n
    if n is None:
        n = int(np.clip(math.sqrt(polygons / faces), 1, 32))
        strips = wishes.isolines + 1
        n = -(-n // strips) * strips  # so that the curves follow the grid
    return n


def _lines(drawn: LimitSurface, wishes: Wishes, net: Net) -> list[Lines]:
    """Curves on the surface, normals and cage.

    What would hide the surface, or its colours, is drawn only if it is asked for.
    """
    faces = len(drawn.limit_faces)
    plain = faces <= CROWD and wishes.scalars is None
    lines = []
    red, green, blue = wishes.color
    dark = (0.42 * red, 0.42 * green, 0.42 * blue) if wishes.scalars is None else (0.15, 0.17, 0.2)
    ink = wishes.look.ink
    if wishes.isolines:
        between = np.arange(1, wishes.isolines + 1) / (wishes.isolines + 1)
        lines.append(_isolines(drawn, between, net, dark, 0.6, wishes.workers))
    if wishes.curves or (wishes.curves is None and (plain or wishes.isolines)):
        width = 1.4 if wishes.isolines else 0.9
        rims = np.array([0.0] if net.lattice.sloped else [0.0, 1.0])
        lines.append(_isolines(drawn, rims, net, dark, width, wishes.workers))
    if wishes.normals:
        lines.append(_needles(drawn, wishes.workers))
    if wishes.cage or (wishes.cage is None and plain):
        mesh = drawn.mesh
        lines.append(Lines(mesh.points[mesh.edges], ink, 1.0))
        lines.append(Lines(mesh.points[mesh.creases[0][mesh.creases[1] > 0]], ink, CREASE))
    return lines


def _needles(drawn: LimitSurface, workers: int) -> Lines:
    """Normals at some places of each limit face."""
    faces = len(drawn.limit_faces)
    every = int(np.clip(math.sqrt(NEEDLES / faces), 1, 6))
    net = Net(drawn.topology.lattice, every)
    places = (np.arange(faces)[:, None], *(x[net.cells].mean(axis=1) for x in net.places))
    foot, length = drawn.evaluate(*places, workers=workers), 0.6 / every / math.sqrt(faces)
    tip = foot + np.clip(length, 0.01, 0.1) * drawn.normal(*places, workers=workers)
    return Lines(np.stack([foot, tip], axis=-2).reshape(-1, 2, 3), NORMAL, 1.6)


def unit_points(mesh: Any) -> tuple[Array, float, Array]:
    """The cage's points, (n_vertices, 3), in the unit box; the box's size and middle (3,).

    A graphics card counts in 24 bits: a small cage far from the origin would come out in steps,
    and a large one overflow.
    """
    points = np.asarray(mesh.points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise ValueError(f"points of shape (n_vertices, 2 or 3) can be drawn, got {points.shape}")
    used = np.unique(mesh.indices)
    largest = max(np.abs(points[used]).max(), np.finfo(np.float64).tiny)
    places = points[used] / largest
    low, high = places.min(axis=0), places.max(axis=0)
    extent = float(np.max(high - low)) or 1.0
    scaled = np.zeros((len(points), 3))
    scaled[used, : points.shape[1]] = (places - (low + high) / 2) / extent
    middle = np.zeros(3)
    middle[: points.shape[1]] = largest * ((low + high) / 2)
    with np.errstate(over="ignore"):
        return scaled, float(extent * largest), middle


def filled(function: Callable[..., Array], query: Query, lattice: Lattice) -> Array:
    """Values of a function of (face, u, v), with that of a nearby place where one is not finite."""
    middle = np.mean(lattice.corners, axis=0).tolist()
    values = np.array(function(*query))  # (...), or (..., d)
    face, u, v = np.broadcast_arrays(*query)
    for inward in (0.02, 0.5):
        bad = ~np.isfinite(values)
        missing = bad.any(axis=-1) if values.ndim > face.ndim else bad
        u, v = (x + inward * (at - x) for x, at in zip((u, v), middle, strict=True))
        values[missing] = function(face[missing], u[missing], v[missing])
    return values


def _curves(where: Array, net: Net) -> list[tuple[Array, Array]]:
    """Places (w, n + 1) on the lines u = where and v = where; in triangles, 1 - u - v = where."""
    where, along = where[:, None], np.arange(net.n + 1) / net.n
    if not net.lattice.sloped:
        return [(where, along), (along, where)]
    end = 1 - where
    along = np.minimum(along, end)  # the last points may be one
    return [(where, along), (along, where), (along, end - along)]


def _isolines(
    surface: LimitSurface, where: Array, net: Net, color: RGB, width: float, workers: int
) -> Lines:
    """The `_curves` on all limit faces, between exact points."""
    face = np.arange(len(surface.limit_faces))[:, None, None]
    ends: list[Array] = []
    normals: list[Array] = []
    normal = partial(surface.normal, workers=workers)
    for place in _curves(where, net):
        query = (face, *place)  # (faces, w, n + 1)
        for found, to in (
            (surface.evaluate(*query, workers=workers), ends),
            (filled(normal, query, net.lattice), normals),
        ):
            to.append(np.stack([found[:, :, :-1], found[:, :, 1:]], axis=-2).reshape(-1, 2, 3))
    return Lines(np.concatenate(ends), color, width, np.nan_to_num(np.concatenate(normals)))


def _drawable(lines: Lines) -> Lines:
    """Those of the lines that have two ends."""
    good = np.isfinite(lines.ends).all(axis=(1, 2))
    normals = None if lines.normals is None else lines.normals[good]
    return replace(lines, ends=lines.ends[good], normals=normals)


def extraordinary(surface: LimitSurface) -> list[Dots]:
    """Limits of the extraordinary interior vertices, and centres of faces that are cut.

    The centre of such a face is such a vertex of the refined cage. None where limit faces depend on
    their own corners alone.
    """
    if surface.rules["scheme"].local:
        return []
    lattice = surface.topology.lattice
    mesh, first = surface.mesh, surface.limit_faces.first
    inside = ~(mesh.boundary_vertex | mesh.nonmanifold_vertex)
    valence = np.where(inside, mesh.vertex_faces, lattice.valence)
    corner = np.flatnonzero(valence[mesh.indices] != lattice.valence)
    vertex, face = mesh.indices[corner], mesh.corner_face[corner]
    place = corner - mesh.offsets[face]  # of the vertex in its face
    whole = mesh.sizes[face] == lattice.face_size
    polygon = np.flatnonzero(mesh.sizes != lattice.face_size)
    centre = np.ones(len(polygon))
    u, v = np.array(lattice.corners)[np.where(whole, place, 0)].T
    at = surface.evaluate(
        np.concatenate([first[face] + np.where(whole, 0, place), first[polygon]]),
        np.concatenate([u, centre]),
        np.concatenate([v, centre]),
    )  # (k, 3)
    # One face with a limit is enough, and all of them agree.
    finite = np.flatnonzero(np.isfinite(at).all(axis=1))
    names = np.concatenate([vertex, mesh.n_vertices + polygon])[finite]
    chosen = finite[np.unique(names, return_index=True)[1]]
    number = np.concatenate([valence[vertex], mesh.sizes[polygon]])[chosen]
    group = np.searchsorted(np.array(list(VALENCES)), number)
    return [
        Dots(at[chosen[group == i]], color, _valences(np.unique(number[group == i]).tolist()))
        for i, color in enumerate(VALENCES.values())
        if (group == i).any()
    ]


def _valences(known: Sequence[int]) -> str:
    """Some valences, ascending, in words."""
    if len(known) == 1:
        return f"valence {known[0]}"
    if len(known) < 4:
        return f"valences {', '.join(map(str, known[:-1]))} and {known[-1]}"
    return f"valences {known[0]} to {known[-1]}"


def seams(surface: LimitSurface, channel: str) -> tuple[Lines, Lines]:
    """Where the layout of a channel is torn, and where the mesh itself ends, in the layout."""
    drawn, cage = surface.of_channel(channel), surface.mesh
    mesh = drawn.mesh
    drawn = drawn.with_points(unit_points(mesh)[0])
    corner = np.flatnonzero(mesh.boundary_edge[mesh.corner_edge])
    t = np.linspace(0.0, 1.0, int(np.clip(POLYGONS / 8 / max(len(corner), 1), 2, 33)))
    ends = mesh.edges[mesh.corner_edge[corner]]
    path = drawn.evaluate(*drawn.limit_faces.at_edge(ends[:, None], t))  # (k, len(t), 3)
    pieces = np.stack([path[:, :-1], path[:, 1:]], axis=2)
    torn = ~cage.boundary_edge[cage.corner_edge[corner]]
    found = (Lines(pieces[k].reshape(-1, 2, 3), SEAM, 4.0) for k in (torn, ~torn))
    return _drawable(next(found)), _drawable(next(found))


def _turned(direction: Sequence[float], up: str) -> Array:
    """A direction for z up, turned with z to another axis that is up."""
    x, y, z = direction
    return np.array({"x": (z, y, -x), "y": (x, z, -y), "z": (x, y, z)}[up])


def camera(
    points: Array,
    up: str,
    view: str | Sequence[float] | None,
    aspect: float,
    margin: float = MARGIN,
) -> tuple[Array, Array, float]:
    """The axes of a camera that sees all points as large as they fit, its place, its distance."""
    upward = "xyz".index(up)
    above = np.eye(3)[upward]
    extent = np.ptp(points, axis=0)
    if view is None and extent.min() < 1e-2 * extent.max():  # flat: seen straight from its front
        flat = int(extent.argmin())
        back = np.eye(3)[flat]
        above = np.eye(3)[upward if upward != flat else (flat + 2) % 3]
    elif view is None or isinstance(view, str):
        back = _turned(VIEW if view is None else VIEWS[view], up)
    else:
        back = np.asarray(view, dtype=np.float64)
    right = np.cross(above, back)
    if np.linalg.norm(right) < 1e-6 * np.linalg.norm(back):  # straight from above or below
        above = _turned(VIEWS["back"], up)
        right = np.cross(above, back)
    axes = np.stack([right, np.cross(back, right), back])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    local = points @ axes.T  # (k, 3)
    slope = math.tan(math.radians(VIEW_ANGLE / 2)) * (1 - 2 * margin) * np.array([aspect, 1.0])
    # |x - centre| <= slope * (distance - z) for all points: the least distance and its centre.
    high = (local[:, :2] + local[:, 2:] * slope).max(axis=0)
    low = (local[:, :2] - local[:, 2:] * slope).min(axis=0)
    depth = max(*((high - low) / (2 * slope)), local[:, 2].max() + 0.01)
    middle = (local[:, 2].min() + local[:, 2].max()) / 2
    eye = np.array([*(high + low) / 2, depth])
    return axes, eye @ axes, depth - middle


def _field(surface: LimitSurface, wishes: Wishes, query: Query, areas: Array) -> Field:
    """A scalar at the places of a query, each with its share of the area that is drawn, (p,)."""
    scalars = wishes.scalars
    floor, name = 0.0, "value"
    if isinstance(scalars, str):
        name = CURVATURES[scalars][0]
        values, floor = _curvature(surface, scalars, query, wishes.workers)
    elif callable(scalars):
        values = _of_function(scalars, query)
    else:
        values = _of_vertices(surface, scalars, query, wishes.workers)
    values = np.where(np.isfinite(values), values, np.nan).ravel()
    there = np.flatnonzero((areas > 0) & ~np.isnan(values))
    if not len(there):
        raise ValueError("no scalar to draw is finite")
    finite = values[there]
    low, high = _robust_range(finite, areas[there])
    # Signed ones get colours about 0, of the same range on both sides.
    signed = isinstance(scalars, str) or (
        low < 0 < high and min(-low, high) > 0.1 * max(-low, high)
    )
    if wishes.limits is not None:
        low, high = map(float, wishes.limits)
    elif signed and (isinstance(scalars, str) or wishes.cmap is None):
        high = max(-low, high, floor)
        # neither a range of subnormal numbers, nor one whose width is infinite
        high = min(high, LARGEST / 4) if high > SMALLEST else 1.0
        low = -high
    elif high - low <= 1e-12 * max(-low, high):  # a constant
        low, high = low - (abs(low) / 2 or 1.0), high + (abs(high) / 2 or 1.0)
    return Field(
        values,
        (low, high),
        wishes.cmap or (DIVERGING if signed else SEQUENTIAL),
        (name if wishes.label is None else wishes.label) if wishes.bar else None,
        (bool(finite.min() < low), bool(finite.max() > high)),
    )


def _curvature(surface: LimitSurface, kind: str, query: Query, workers: int) -> tuple[Array, float]:
    """One of the `CURVATURES` at the places of a query, and how much of it counts as none."""
    power = CURVATURES[kind][1]
    places, extent, _ = unit_points(surface.mesh)
    unit = surface.with_points(places)

    def curvature(*at: Any) -> Array:
        found: Array = getattr(unit.curvature(*at, workers=workers), kind)
        # At a vertex of valence 3 it tends to 0, but so late that nothing near is like it.
        corner = np.isin(at[1], (0, 1)) & np.isin(at[2], (0, 1))
        return np.where(corner & (found == 0), np.nan, found)

    values = filled(curvature, query, unit.topology.lattice)
    least = np.float64(FLATNESS)
    # one after the other: the power of an extent can be 0 or infinite where quotients are not
    with np.errstate(over="ignore", under="ignore", divide="ignore", invalid="ignore"):
        for _ in range(power):
            values, least = values / extent, least / extent
    return values, float(least)


def _of_function(function: Callable[..., ArrayLike], query: Query) -> Array:
    """What a function of the user returns at the places of a query."""
    face, u, v = (x.ravel() for x in np.broadcast_arrays(*query))
    values = real_numbers(function(face, u, v), "what the function of (face, u, v) returns")
    if values.shape != face.shape:
        raise ValueError(
            f"the function of (face, u, v) must return as many values as it gets, "
            f"{face.shape}, got {values.shape}"
        )
    return values


def _of_vertices(surface: LimitSurface, scalars: Any, query: Query, workers: int) -> Array:
    """Values of the cage's vertices, (n_vertices,), at the places of a query."""
    control = real_numbers(scalars, "scalars")
    if control.shape != (surface.mesh.n_vertices,):
        raise ValueError(
            f"scalars of the cage's vertices have shape ({surface.mesh.n_vertices},), "
            f"got {control.shape}"
        )
    values: Array = surface.with_points(control).evaluate(*query, workers=workers)
    return values


def real_numbers(values: Any, name: str) -> Array:
    """An array of float64; ValueError if there is anything but real numbers in it."""
    try:
        found = np.asarray(values)
        if found.dtype.kind in "biufO":
            return found.astype(np.float64)
    except (TypeError, ValueError, OverflowError):
        pass
    raise ValueError(f"{name} must be real numbers, got {reprlib.repr(values)}")


def _areas(points: Array, cells: IntArray) -> Array:
    """The area of the polygons around each point, (p,), never 0 where there are any."""
    a, b, c, d = (points[cells[:, k]] for k in (0, 1, 2, -1))
    area = np.linalg.norm(np.cross(c - a, d - b), axis=1) + np.finfo(float).tiny
    shares = np.repeat(area, cells.shape[1])
    return np.bincount(cells.ravel(), shares, len(points)).astype(np.float64)


def _robust_range(values: Array, areas: Array) -> tuple[float, float]:
    """Lower and upper percentile of the area."""
    order = np.argsort(values)
    area = np.cumsum(areas[order])
    low, high = np.searchsorted(area, area[-1] * np.array([OUTLIERS, 100 - OUTLIERS]) / 100)
    return float(values[order[low]]), float(values[order[min(high, len(order) - 1)]])


def _zebra(points: Array, normals: Array, axes: Array, eye: Array) -> Field:
    """Where the surface mirrors bright and dark strips around it, to the eye of the picture.

    The value is the height at which the reflected ray leaves a sphere around the scene, above a
    tilted plane. It is smooth where the normal is; a texture makes stripes of it.
    """
    sight = points - eye
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    mirrored = sight - 2 * np.sum(sight * normals, axis=1, keepdims=True) * normals
    across = np.array([0.35, 0.9, 0.25]) @ axes
    values = mirrored @ (across / np.linalg.norm(across))
    return Field(values, (-1.0, 1.0), "zebra", None)
