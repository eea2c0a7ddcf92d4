"""Curves on a surface along which a function has a value: plane sections and contours."""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf import numbers
from limitsurf.cage.checks import checked_number
from limitsurf.engine.protocol import threads
from limitsurf.query.index import Cells, checked_surface
from limitsurf.query.leaves import Parting
from limitsurf.query.overlay import Column, Overlay
from limitsurf.query.records import Polylines
from limitsurf.query.scalars import Height, Scalar, SquaredDistance, Subdivided
from limitsurf.query.tracing import Adjacency, Network, Nodes, Spans, chained
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_RELATIVE = 1e-4  # tolerances that nobody chose, of the longest side of the surface's box
_FAR = 2.0**64  # in the unit of the index: no surface is there
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True, eq=False, repr=False)
class Curves(Polylines):
    """Curves on a surface as polylines of points on it, as `section` and `contour` find them.

    Attributes
    ----------
    offsets : (n + 1,) int64
        The points of curve k are numbers ``offsets[k]`` to ``offsets[k + 1]``, exclusive, in order.
    closed : (n,) bool
        Whether a curve goes on from its last point to its first. Others end at a boundary of the
        surface, or where curves meet.
    value : (n,) float64
        Of the function whose contour it is; of sections 0.
    point : (m, 3) float64
        ``surface.evaluate(face, u, v)``.
    face : (m,) int64
        Limit faces; of points that several share, one of these.
    u, v : (m,) float64

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> ls.section(ls.LimitSurface(square), [0.5, 0.5, 0.0], [1.0, 0.0, 0.0])
    Curves(1 curve of 2 points, 0 closed)
    """

    offsets: Array
    closed: Array
    value: Array
    point: Array
    face: Array
    u: Array
    v: Array

    _of_curves = ("value",)


def section(
    surface: LimitSurface,
    origin: ArrayLike,
    normal: ArrayLike,
    *,
    tolerance: float | None = None,
    channel: str | None = None,
    workers: int = 1,
) -> Curves:
    """The curves in which a plane cuts a surface: all of them, however small.

    Parameters
    ----------
    surface : LimitSurface
        Of float64 points, (n_vertices, 3).
    origin : (3,) array_like
        A point of the plane.
    normal : (3,) array_like
        Perpendicular to the plane, of any length; it points to what is above.
    tolerance : float, optional
        How far polylines may be from the curves, in the units of the points. By default 1e-4 of the
        longest side of the surface's box.
    channel : str, optional
        A face-varying channel of three columns, to cut instead of the points.
    workers : int
        Threads, as for `LimitSurface.evaluate`; answers do not depend on it.

    Returns
    -------
    Curves
        What is above is on their left, seen from the side of the surface's normals; so a section
        of a closed surface whose normals point outward goes counter-clockwise about `normal`
        around the solid, clockwise around holes. Of a surface of inconsistent orientation each
        curve goes as most of it says.

    Raises
    ------
    TypeError
        For what is not a surface, a surface of exact points, a tolerance that is not a number.
    ValueError
        For an origin or normal that is not three finite numbers, a normal of length 0, a tolerance
        that is not above 0.
    MemoryError
        At once, for more points than there is memory for.

    Notes
    -----
    The section is the border, on the surface, of what is below the plane. So where faces lie in the
    plane it is the part of their border beyond which the surface goes down; where the surface
    touches the plane and does not cross it there is none. On surfaces without boundary all
    curves are closed, but for those that meet at saddles: there they end, at the saddle.

    All points are in the plane, and of curves that pass through vertices, also special ones, the
    vertex is a point, up to 1e-13 of the largest coordinate of the points that the surface depends
    on. Cells of the surface are parted until the Bernstein coefficients of the height above the
    plane show that the section is a graph in each, with a bound of its second derivative that says
    how many points it takes. What is within rounding of the plane, or smaller than `tolerance` amid
    much that the plane only touches, is left as it is. ``derivations/sections.py`` derives all
    this.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> ball = ls.LimitSurface(ls.Mesh(points, quads))
    >>> found = ls.section(ball, [0.5, 0.5, 0.75], [0, 0, 1])
    >>> len(found), found.closed.tolist(), bool((abs(found.point[:, 2] - 0.75) < 1e-13).all())
    (1, [True], True)
    """
    surface = checked_surface(surface, channel)
    at, toward = vector("origin", origin), vector("normal", normal)
    if not toward.any():
        raise ValueError("normal must not be of length 0")
    cells = Cells.of(surface, threads(workers))
    toward, height = _height(cells, toward, at, np.zeros(1))
    return traced(surface, cells, Height(cells, toward), height, tolerance, workers)[1]


def contour(
    surface: LimitSurface,
    scalar: str | ArrayLike | tuple[str, int],
    values: ArrayLike,
    *,
    origin: ArrayLike | None = None,
    tolerance: float | None = None,
    channel: str | None = None,
    workers: int = 1,
) -> Curves:
    """The curves on a surface along which a function has given values.

    Parameters
    ----------
    surface : LimitSurface
        Of float64 points, (n_vertices, 3).
    scalar : str, array_like or tuple
        The function: ``"x"``, ``"y"`` or ``"z"``; a direction (3,), for the inner product with it;
        ``"distance"``, from `origin`; values of the cage's vertices, (n_vertices,) or
        (n_vertices, 1), which are subdivided as its points are; or a face-varying channel and which
        column of it, as ``("uv", 0)``.
    values : float or (k,) array_like
        There are no curves of values that are not finite.
    origin : (3,) array_like, optional
        Where places are measured from; (0, 0, 0) by default.
    tolerance : float, optional
        How far polylines may be from the curves, in the units of the points. By default 1e-4 of the
        longest side of the surface's box.
    channel : str, optional
        A face-varying channel of three columns, taken instead of the points.
    workers : int
        Threads, as for `LimitSurface.evaluate`; answers do not depend on it.

    Returns
    -------
    Curves
        Those of each value after those of the one before. Larger values are on their left, seen
        from the side of the surface's normals. Contours of channels end at seams.

    Raises
    ------
    TypeError, ValueError, MemoryError
        As `section` does; for a function that is none of these.

    Notes
    -----
    Each is the border of where the function is less, as a section is. Values are right to 1e-13 of
    the largest coordinate, relative to `origin`, or of the largest value of a vertex.

    Channels have a topology of their own: where theirs is another one than that of the points,
    cells of both are cut until they are the same.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> ball = ls.LimitSurface(ls.Mesh(points, quads))
    >>> ls.contour(ball, "z", [0.25, 0.5, 0.75]).value.tolist()
    [0.25, 0.5, 0.75]
    >>> ls.contour(ball, "distance", 0.432, origin=[0.5, 0.5, 0.5])
    Curves(8 curves of ... points, 8 closed)
    """
    given, surface = surface, checked_surface(surface, channel)
    asked = np.asarray(values, dtype=float)
    if asked.ndim > 1:
        raise ValueError(f"values must be a number or of shape (k,), got shape {asked.shape}")
    at = np.zeros(3) if origin is None else vector("origin", origin)
    cells, workers_ = Cells.of(surface, threads(workers)), threads(workers)
    kept = asked.ravel()[np.isfinite(asked.ravel())]
    found: Scalar
    adjacency = None
    if isinstance(scalar, tuple) and len(scalar) == 2 and isinstance(scalar[0], str):
        own, known = _column(given, scalar[0], scalar[1])
        power = -int(np.frexp(np.abs(known).max(initial=0))[1])
        cells = laid = Overlay(surface, cells, own, np.ldexp(known, power), workers_)
        found, adjacency = Column(laid), Adjacency.of(own)
        heights = np.clip(np.ldexp(kept, power), -_FAR, _FAR)
    elif isinstance(scalar, str) and scalar == "distance":
        point = clipped(np.ldexp(at, cells.power))
        factor = 1 / (1 + np.sqrt((point**2).sum())) ** 2
        found = SquaredDistance(cells, point, factor)
        heights = np.clip(np.ldexp(kept, cells.power), -_FAR, _FAR)
        heights = np.where(kept < 0, -1.0, heights**2 * factor)
    elif isinstance(scalar, str) or np.shape(scalar) == (3,):
        toward = _direction(scalar)
        toward, heights = _height(cells, toward, at, kept)
        found = Height(cells, toward)
    else:
        known = _vertex_values(surface, scalar)
        power = -int(np.frexp(np.abs(known).max(initial=0))[1])
        found = Subdivided(surface, cells, np.ldexp(known, power), workers_)
        heights = np.clip(np.ldexp(kept, power), -_FAR, _FAR)
    number, curves = traced(surface, cells, found, heights, tolerance, workers, adjacency=adjacency)
    curves.value[:] = kept[number]
    return curves


def vector(name: str, given: ArrayLike) -> Array:
    """Three finite numbers, or an error that says the name."""
    found = np.asarray(given, dtype=float)
    if found.shape != (3,):
        raise ValueError(f"{name} must be three numbers, got shape {found.shape}")
    if not np.isfinite(found).all():
        raise ValueError(f"{name} must be finite, got {found.tolist()}")
    return found


def _direction(scalar: Any) -> Array:
    if isinstance(scalar, str) and scalar not in _AXES:
        names = ", ".join(map(repr, _AXES))
        raise ValueError(f"scalar must be {names}, 'distance' or numbers, got {scalar!r}")
    found = vector("a direction", _AXES[scalar] if isinstance(scalar, str) else scalar)
    if not found.any():
        raise ValueError("a direction must not be of length 0")
    return found


def _vertex_values(surface: LimitSurface, scalar: Any) -> Array:
    """Values of vertices, (n_vertices,)."""
    found, n = np.asarray(scalar, dtype=float), surface.mesh.n_vertices
    if found.shape not in ((n,), (n, 1)):
        raise ValueError(
            f"scalar must be a direction (3,) or values of vertices, ({n},), got {found.shape}"
        )
    if not np.isfinite(found).all():
        bad = np.flatnonzero(~np.isfinite(found.ravel()))
        raise ValueError(f"values of vertices must be finite; that of vertex {bad[0]} is not")
    return found.ravel()


def _column(surface: LimitSurface, name: str, column: Any) -> tuple[LimitSurface, Array]:
    """The surface of a channel, and the values of a column of it."""
    own = surface.of_channel(name)
    known = own.points.reshape(len(own.points), -1)
    if numbers.type_of(known).exact:
        raise TypeError(f"contours need float64 values, channel {name!r} is exact")
    number = operator.index(column)
    if not 0 <= number < known.shape[1]:
        raise ValueError(f"channel {name!r} has {known.shape[1]} columns, got column {number}")
    found = known[:, number]
    if not np.isfinite(found).all():
        bad = int(np.flatnonzero(~np.isfinite(found))[0])
        raise ValueError(f"values of channel {name!r} must be finite; value {bad} is not")
    return own, found


def _height(cells: Cells, toward: Array, origin: Array, values: Array) -> tuple[Array, Array]:
    """A direction with a largest part of about 1, and inner products with it, (k,).

    In the unit of the index: those that differ by `values` from that of `origin`.
    """
    power = -int(np.frexp(np.abs(toward).max())[1])
    scaled = np.ldexp(toward, power)
    both = zip(scaled.tolist(), origin.tolist(), strict=True)
    exact = sum(Fraction(x) * Fraction(y) for x, y in both)
    unit, more = Fraction(2) ** cells.power, Fraction(2) ** power
    most = Fraction(_FAR)
    heights = [(exact + Fraction(x) * more) * unit for x in values.tolist()]
    return scaled, np.array([float(max(min(x, most), -most)) for x in heights])


def clipped(point: Array) -> Array:
    """A place in the unit of the index that is not beyond where no surface is."""
    return np.clip(point, -_FAR, _FAR)


def traced(
    surface: LimitSurface, cells: Cells, scalar: Scalar, heights: Array,
    tolerance: float | None, workers: int, *, adjacency: Adjacency | None = None,
    finish: Callable[[Network], None] | None = None,
) -> tuple[Array, Curves]:  # fmt: skip
    """The curves on which a function has values (k,), and which of them.

    It is continuous across what `adjacency` joins; `finish` is called with what was found.
    """
    scaled = scaled_tolerance(cells, tolerance)
    leaves = Parting(cells, scalar, heights, scaled).run()
    adjacency = adjacency or Adjacency.of(surface)
    network = Network(surface, leaves, cells.form, scalar.form, adjacency)
    if finish is not None:
        finish(network)
    spans = network.spans
    number = network.leaves.cells.level[spans.leaf]
    starts, order, backward, closed = chained(spans, number, len(network.nodes.face))
    places, offsets = _in_order(network, scaled, starts, order, backward, closed)
    u, v = places.uv.T.copy()
    point = surface.evaluate(places.face, u, v, workers=workers).reshape(-1, 3)
    value = np.zeros(len(closed))
    curves = Curves(offsets, closed, value, point, places.face, u, v)
    return number[order[starts[:-1]]], curves


def scaled_tolerance(cells: Cells, tolerance: float | None) -> float:
    """In the unit of the index."""
    if tolerance is None:
        points = cells.points.reshape(-1, 3)
        span = points.max(axis=0, initial=-1) - points.min(axis=0, initial=1)
        return max(_RELATIVE * float(span.max()), 2.0**-60)
    asked = checked_number("tolerance", tolerance, above=0)
    with np.errstate(over="ignore", under="ignore"):
        return float(np.clip(np.ldexp(asked, cells.power), 2.0**-60, _FAR))


def _in_order(
    network: Network, tolerance: float, starts: Array, order: Array, backward: Array, closed: Array
) -> tuple[Nodes, Array]:
    """The places of curves in order, and offsets (n + 1,)."""
    spans, nodes = network.spans, network.nodes
    offsets, inner = network.points(tolerance)
    chains = starts, order, backward, closed
    source, found = sources(spans, len(nodes.face), offsets, chains)
    face = np.concatenate([nodes.face, inner.face])[source]
    uv = np.concatenate([nodes.uv, inner.uv])[source]
    return Nodes(face, uv), found


def sources(
    spans: Spans, n_nodes: int, offsets: Array, chains: tuple[Array, Array, Array, Array]
) -> tuple[Array, Array]:
    """Numbers of nodes, and beyond these of what is inside of spans, in order, and offsets.

    `chains` are as `chained` finds them; span k has ``offsets[k]`` to ``offsets[k + 1]`` inside.
    """
    starts, order, backward, closed = chains
    each = np.diff(offsets)[order]
    # of each span its first node and what is inside; of open curves their last node
    size, last = 1 + each, starts[1:] - 1
    size[last] += ~closed
    first = np.cumsum(size) - size
    source = np.empty(int(size.sum()), dtype=np.int64)
    source[first] = np.where(backward, spans.b[order], spans.a[order])
    owner = np.repeat(np.arange(len(order)), each)
    step = np.arange(len(owner)) - np.repeat(np.cumsum(each) - each, each)
    back = backward[owner]
    number = offsets[order[owner]] + np.where(back, each[owner] - 1 - step, step)
    source[first[owner] + 1 + step] = n_nodes + number
    tips = last[~closed]
    at = first[tips] + size[tips] - 1
    source[at] = np.where(backward[tips], spans.a[order[tips]], spans.b[order[tips]])
    return source, np.append(first[starts[:-1]], len(source))
