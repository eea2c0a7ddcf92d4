"""Polygons on a surface, welded by what they are in the cage."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, ClassVar, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf import html, memory, numbers
from limitsurf.caching import cached_property
from limitsurf.cage.checks import checked_integer, checked_number
from limitsurf.cage.faces import Faces
from limitsurf.cage.mesh import Mesh, Up
from limitsurf.engine.protocol import threads
from limitsurf.query.camera import View
from limitsurf.query.stitching import Stated, Stitches, levels, stitched
from limitsurf.query.wanted import Wanted
from limitsurf.query.welding import sides
from limitsurf.scheme.net import Net
from limitsurf.surface import LimitSurface

Array: TypeAlias = NDArray[Any]

POLYGON = 200  # bytes that one of a tessellation takes, at least

_LEAST_ANGLE = 1e-3  # degrees: beyond what welded normals, and files, tell apart

_DIAGONALS = 1 << 22  # of polygons that are in memory at once


@dataclass(frozen=True, eq=False, repr=False)
class Polygons:
    """Polygons and what their corners have, for files; attributes as in `Tessellation`.

    Their points need not lie on a surface: they may be those of a cage.

    Examples
    --------
    >>> import numpy as np
    >>> from limitsurf.query import Polygons
    >>> nothing = np.zeros((0, 3)), np.zeros(0, dtype=np.int64)
    >>> Polygons(np.eye(3), np.array([3]), np.arange(3), *nothing, {}).triangles.tolist()
    [[0, 1, 2]]
    """

    points: NDArray[np.float64]
    sizes: NDArray[np.int64]
    indices: NDArray[np.int64]
    normals: NDArray[np.float64]
    normal_indices: NDArray[np.int64]
    channels: Mapping[str, tuple[NDArray[Any], NDArray[np.int64]]]
    face_data: Mapping[str, NDArray[Any]] = field(default_factory=dict, kw_only=True)

    _by_point: ClassVar[tuple[str, ...]] = ("points",)

    @cached_property
    def offsets(self) -> NDArray[np.int64]:
        """First corner of each polygon, and their number C: shape (F + 1,)."""
        return np.concatenate([[0], np.cumsum(self.sizes)])

    @cached_property
    def faces(self) -> Faces:
        """The polygons, a sequence of arrays of rows of `points`, whatever their sizes."""
        return Faces(self.sizes, self.indices)

    @property
    def uniform(self) -> NDArray[np.int64] | None:
        """The points of all polygons, (F, k), if each has k corners; None where they differ."""
        return self.faces.uniform

    @cached_property
    def triangles(self) -> NDArray[np.int64]:
        """The polygons cut into triangles, as positions among the C corners: shape (T, 3).

        ``indices[triangles]`` are the points of the triangles, ``normal_indices[triangles]`` their
        normals. One of four corners is cut by its shorter diagonal, another by those from the
        corner where the smallest triangle is largest.
        """
        first = np.cumsum(self.sizes - 2) - (self.sizes - 2)  # triangle of each polygon
        triangles = np.empty((int((self.sizes - 2).sum()), 3), dtype=np.int64)
        for size in np.unique(self.sizes).tolist():
            alike = np.flatnonzero(self.sizes == size)
            fan = np.arange(1, size - 1)
            portion = max(_DIAGONALS // size**2, 1)
            for start in range(0, len(alike), portion):
                some = alike[start : start + portion]
                corner = self.offsets[some]
                points = self.points[self.indices[corner[:, None] + np.arange(size)]]
                tip = _tips(points)
                turned = np.stack([0 * fan, fan, fan + 1], axis=1)  # (size - 2, 3)
                place = (tip[:, None, None] + turned) % size
                triangles[first[some, None] + fan - 1] = corner[:, None, None] + place
        return triangles

    def split(self) -> Self:
        """These polygons with one normal and one value of each channel per point.

        Points are repeated where they have several, at creases and seams, behind the others, with
        the same face, u and v. The indices of points, normals and channels are then all the same,
        as formats and graphics libraries want them that keep everything by point.
        """
        number, origin = self.indices.copy(), np.arange(len(self.points))
        attributes = [(name, *channel) for name, channel in self.channels.items()]
        if len(self.normals):
            attributes.append(("", self.normals, self.normal_indices))
        for _, _, rows in attributes:
            # a point keeps the row of one of its corners; those with another one get a new point
            row = np.zeros(len(origin), dtype=np.int64)
            row[number] = rows
            other = np.flatnonzero(row[number] != rows)
            key = np.stack([number[other], rows[other]])
            new, inverse = np.unique(key, axis=1, return_inverse=True)
            number[other] = len(origin) + inverse.ravel()
            origin = np.concatenate([origin, origin[new[0]]])
        found = {}
        for name, values, rows in attributes:
            row = np.zeros(len(origin), dtype=np.int64)
            row[number] = rows
            found[name] = values[row]
        normals = found.pop("", self.normals)
        by_point: dict[str, Any] = {x: getattr(self, x)[origin] for x in self._by_point}
        return replace(
            self,
            **by_point,
            indices=number,
            normals=normals,
            normal_indices=number if len(normals) else self.normal_indices,
            channels={name: (values, number) for name, values in found.items()},
        )

    def _repr_html_(self) -> str:
        known = {"points": len(self.points), "faces": len(self.sizes), "normals": len(self.normals)}
        return html.facts(type(self).__name__, {**known, "channels": ", ".join(self.channels)})

    def __repr__(self) -> str:
        parts = [f"{len(self.points)} points", f"{len(self.sizes)} faces"]
        if len(self.normals):
            parts.append(f"{len(self.normals)} normals")
        parts += [f"channel {name!r}" for name in self.channels]
        return f"{type(self).__name__}({', '.join(parts)})"


@dataclass(frozen=True, eq=False, repr=False)
class Tessellation(Polygons):
    """Polygons with their corners on a surface, made by `tessellate`.

    A polygon is a run of corners, counter-clockwise as the faces of the cage. For each corner
    there is the row of `points` that it has, and of `normals` and each channel: these are several
    for one point where the surface has several sides.

    Attributes
    ----------
    points : (V, 3) float64
        Each once, on the surface.
    sizes : (F,) int64
        Corners of each polygon: 3 on limit faces that are triangles, else 4 to 8; 3 or 4 if they
        were made to a tolerance.
    indices : (C,) int64
        Rows of `points` of all corners.
    faces : Faces
        The polygons by themselves: ``len(faces)`` arrays of rows of `points`.
    uniform : (F, k) int64, or None
        The rows of all polygons, if each has k corners; None where some have more than others.
    face, u, v : (V,)
        One place of each point: ``surface.evaluate(face, u, v)`` equals `points`.
    normals : (K, 3) float64
        Unit normals, NaN where the surface has none; (0, 3) if none were asked for.
    normal_indices : (C,) int64
        Rows of `normals` of all corners; (0,) without normals.
    channels : {name: (values (k, ...), indices (C,))}
        Face-varying channels in the same way.
    face_data : {name: (F, ...)}
        Data of the faces of the cage, by polygon.
    units, up
        Those of the cage, for files: see ``Mesh``.
    chord_error : float or None
        A bound of the distance of the surface from the polygons, in the units of the points, or in
        pixels with a view, if they were made to a tolerance: see `tessellate`.
    angle_error : float or None
        A bound of the angle between normals, in degrees, if `angle` was asked for.
    without_angle : (k,) int64
        Polygons that it is not of.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> ls.tessellate(ls.LimitSurface(square), 2)
    Tessellation(9 points, 4 faces, 9 normals)
    """

    face: NDArray[np.int64]
    u: NDArray[np.float64]
    v: NDArray[np.float64]
    units: float | None = None
    up: Up | None = None
    chord_error: float | None = None
    angle_error: float | None = None
    without_angle: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    _by_point: ClassVar[tuple[str, ...]] = ("points", "face", "u", "v")


def tessellate(
    surface: LimitSurface,
    n: int | None = None,
    *,
    chord: float | None = None,
    angle: float | None = None,
    edge: float | None = None,
    view: View | None = None,
    max_triangles: int | None = None,
    normals: bool = True,
    channels: Iterable[str] = (),
    workers: int = 1,
) -> Tessellation:
    """Polygons on the surface, n x n to each limit face or as many as a tolerance needs, no gaps.

    Points are welded by what they are in the cage (on a vertex, an edge, inside a face), not by
    distance: polygons of neighbouring faces share them. All are on the surface, and no corner of
    one polygon lies amid the side of another. Faces without a limit (holes) are left out.

    With `n`, polygons have as many corners as limit faces, triangles by Loop's scheme. An edge of
    an n-gon has 2 n segments, n from each of the two limit faces there; a whole face beside one
    takes them over, so that some of its polygons have 5 to 8 corners.

    With `chord`, `angle` or `edge`, limit faces are halved, and the halves again, where it takes
    that: along u or v or both, finer towards special corners, so that few polygons are where the
    surface is nearly flat. Polygons with finer ones beside them are cut into triangles.

    Parameters
    ----------
    surface : LimitSurface
        Of float64 points, (n_vertices, 3).
    n : int, optional
        Segments along u and v of each limit face, at least 1; 8 if no tolerance is given.
    chord : float, optional
        How far the surface may be from the polygons, in the units of the points, however these are
        cut into triangles: at every (face, u, v) from the triangle whose corners have parameters
        around it. That is proved, not sampled: ``chord_error`` of the result has the bound.
        With a `view`, in pixels.
    angle : float, optional
        Largest angle, in degrees, between the normal of the surface at any (face, u, v) and both
        the normal of the triangle there and the one between the normals of its corners, however
        polygons are cut into triangles; at most 90. That is proved, too: ``angle_error`` has the
        bound. Where there is none, at corners without a normal and where derivatives vanish, it
        is given up after some halvings: ``without_angle`` has these polygons, which lie within
        1/256 of a limit face around corners and 1/1024 elsewhere.
    edge : float, optional
        Longest edge of a triangle, in the units of the points.
    view : View, optional
        A camera. `chord` is then how far, in pixels, what it sees of the surface may be from the
        polygons in the picture, so that they are fine where surfaces are near, and at silhouettes,
        and coarse out of its sight, where nothing is asked for. What hides what is left out.
    max_triangles : int, optional
        Make no more than so many.
    normals : bool
        Whether to find normals: one for each side at creases and boundaries between faces of
        opposite orientation. Sides whose unit normals differ by less than 1e-6 are one.
    channels : iterable of str
        Face-varying channels to evaluate as well, such as "uv", with their seams.
    workers : int
        Threads, as for `LimitSurface.evaluate`.

    Returns
    -------
    Tessellation
        The polygons of each limit face in turn, row by row (v); with `n`, n to a row.

    Raises
    ------
    ValueError
        For an n that is not an integer >= 1, or one beside a tolerance; a view without a chord; a
        tolerance that is not above 0, or too small for float64; more than `max_triangles`, before
        any is made, with the number; points that are of another shape, or with a tolerance not
        finite; a channel that the mesh does not have.
    TypeError
        For a surface of exact numbers, and tolerances that are no numbers.
    MemoryError
        At once, for more polygons than there is memory for; it says which n fits.

    Notes
    -----
    On a part of a limit face with one polynomial, second derivatives are a mean and what differs
    from it, bounded by Bernstein coefficients. The mean gives the distance from a triangle but for
    what moves points along its edges, which leaves them in the triangle; the rest is bounded after
    Filip, Magedson and Markot, "Surface algorithms using bounds on derivatives", CAGD 3 (1986).
    Where that is a little too large, hulls of polynomials on quarters of triangles are asked, too.
    At special corners, where second derivatives may have no bound, the hulls of rings around them
    are compared with triangles, and for `angle` limits of normals by eigenvalues. All is derived in
    ``derivations/tessellation.py``.

    Examples
    --------
    >>> import limitsurf as ls
    >>> cube = ls.Mesh(
    ...     [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)],
    ...     [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    >>> surface = ls.LimitSurface(cube)
    >>> pieces = ls.tessellate(surface, 4)
    >>> pieces
    Tessellation(98 points, 96 faces, 98 normals)
    >>> corners = pieces.points[pieces.indices[pieces.triangles]]
    >>> corners.shape
    (192, 3, 3)
    >>> ls.tessellate(surface, chord=0.01).chord_error <= 0.01
    True
    """
    wanted = _wanted(n, chord, angle, edge, view, max_triangles)
    if not isinstance(surface, LimitSurface):
        raise TypeError(f"tessellate needs a LimitSurface, got {type(surface).__name__}")
    if surface.points.shape[1:] != (3,):
        raise ValueError(f"got points of shape {surface.points.shape}, need (n_vertices, 3)")
    workers = threads(workers)
    parts = _parts(surface, n, wanted, workers)
    return _assembled(surface, parts, normals, channels, workers)


def levels_of_detail(
    surface: LimitSurface,
    chords: Iterable[float],
    *,
    normals: bool = True,
    channels: Iterable[str] = (),
    workers: int = 1,
) -> list[Tessellation]:
    """Polygons to several tolerances, of which finer ones divide coarser ones.

    Each is as by ``tessellate(surface, chord=...)``. The points of a coarser one are points of all
    finer ones too, with the same face, u and v, but for those inside of parts that are cut into
    triangles all around, between finer neighbours on every side.

    Parameters
    ----------
    surface : LimitSurface
        Of float64 points, (n_vertices, 3).
    chords : iterable of float
        Tolerances, in any order.
    normals, channels, workers
        As for `tessellate`.

    Returns
    -------
    list of Tessellation
        In the order of `chords`.

    Raises
    ------
    ValueError, TypeError, MemoryError
        As by `tessellate`.

    Examples
    --------
    >>> import limitsurf as ls
    >>> cube = ls.Mesh(
    ...     [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)],
    ...     [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    >>> fine, coarse = ls.levels_of_detail(ls.LimitSurface(cube), [0.001, 0.01])
    >>> len(fine.triangles) > 4 * len(coarse.triangles)
    True
    """
    if not isinstance(chords, Iterable):
        raise TypeError(f"chords must be several numbers, got {type(chords).__name__}")
    asked = list(chords)
    every = [_wanted(None, chord, None, None, None, None) for chord in asked]
    _check(surface)
    workers = threads(workers)
    order = np.argsort([-wanted.chord for wanted in every], kind="stable")
    made = levels(surface, [every[k] for k in order.tolist()], workers)
    names = [channels] if isinstance(channels, str) else list(channels)
    found = [_assembled(surface, parts, normals, names, workers) for parts in made]
    return [found[k] for k in np.argsort(order, kind="stable").tolist()]


def _check(surface: LimitSurface) -> None:
    """Refuse what is no surface of float64 points in space."""
    if not isinstance(surface, LimitSurface):
        raise TypeError(f"tessellate needs a LimitSurface, got {type(surface).__name__}")
    if surface.points.shape[1:] != (3,):
        raise ValueError(f"got points of shape {surface.points.shape}, need (n_vertices, 3)")
    if numbers.type_of(surface.points).exact:
        raise TypeError("polygons need float64 points, these are exact: convert them first")


def _assembled(
    surface: LimitSurface,
    parts: tuple[_Sites | Stitches, Array, Array, Array, Stated | None],
    normals: bool,
    channels: Iterable[str],
    workers: int,
) -> Tessellation:
    """Polygons with all that their corners have."""
    sites, corners, sizes, owner, stated = parts
    number, place = sites.welded(surface.mesh)
    at = sites.places(place)
    rows, directions = np.zeros(0, np.int64), np.zeros((0, 3))
    if normals:
        rows, directions = sites.normals(surface, number, len(place), workers)
        rows = rows[corners]
    of_channels = {}
    for name in [channels] if isinstance(channels, str) else channels:
        value, where = sites.welded(surface.of_channel(name).mesh)
        there = sites.places(where)
        values = surface.evaluate(*there, channel=name, workers=workers)
        of_channels[name] = values, value[corners]
    points = surface.evaluate(*at, workers=workers)
    shape = points, sizes, number[corners], directions, rows, of_channels
    owner = surface.limit_faces.face[owner]
    data = {name: values[owner] for name, values in surface.mesh.face_data.items()}
    known: tuple[Any, ...] = surface.mesh.units, surface.mesh.up
    if stated is not None:
        turn = None if stated.angle is None else math.degrees(stated.angle)
        known += stated.chord, turn, stated.without
    return Tessellation(*shape, *at, *known, face_data=data)


def _wanted(
    n: int | None, chord: Any, angle: Any, edge: Any, view: Any, max_triangles: int | None
) -> Wanted:
    """What polygons are wanted, checked."""
    if n is not None:
        checked_integer("n", n, 1)
    found: dict[str, Any] = {}
    for name, value in (("chord", chord), ("angle", angle), ("edge", edge)):
        if value is None:
            continue
        found[name] = checked_number(name, value, above=0, below=math.inf)
        if n is not None:
            raise ValueError(f"got n={n} and {name}={value}: give one of them")
    if angle is not None:
        if not _LEAST_ANGLE <= angle <= 90:
            raise ValueError(f"angle must be from {_LEAST_ANGLE} to 90 degrees, got {angle}")
        found["angle"] = math.radians(found["angle"])
    if view is not None:
        if not isinstance(view, View):
            raise TypeError(f"view must be a View, got {type(view).__name__}")
        if chord is None:
            raise ValueError("a view needs chord, in pixels" + ("" if n is None else ", and no n"))
        found["view"] = view
    most = math.inf if max_triangles is None else checked_integer("max_triangles", max_triangles, 1)
    return Wanted(**found, most=most)


def _parts(
    surface: LimitSurface, n: int | None, wanted: Wanted, workers: int
) -> tuple[_Sites | Stitches, Array, Array, Array, Stated | None]:
    """Places, corners of polygons and sizes, limit faces of these, and what is stated of them."""
    if min(wanted.chord, wanted.edge, wanted.angle) < math.inf:
        _check(surface)
        return stitched(surface, wanted, workers)
    n = 8 if n is None else int(n)
    faces = len(surface.limit_faces)
    most = math.isqrt(int(min(memory.available() / POLYGON, 2**62)) // max(faces, 1))
    advice = f"up to n={most} fits" if most else "none fits"
    memory.refuse_beyond(faces * n * n, POLYGON, "polygons", advice)
    _check(surface)
    sites = _Sites(surface, n)
    corners, sizes = sites.corners()
    wanted.check(0, triangles=int((sizes - 2).sum()))
    return sites, corners, sizes, np.repeat(sites.face, len(sites.net.cells)), None


def _tips(points: Array) -> Array:
    """The corner of each polygon (p, k, 3) from which its diagonals are to go: (p,)."""
    across = [np.roll(points, -i, axis=1) - points for i in range(1, points.shape[1])]
    # exactly scaled to less than 1: squares of large lengths overflow, those of small ones vanish
    size = np.max([np.abs(x).max(axis=(1, 2)) for x in across], axis=0)
    power = -np.frexp(size)[1][:, None, None]
    across = [np.ldexp(x, power) for x in across]
    if len(across) == 3:
        return np.asarray(np.argmin((across[1] ** 2).sum(axis=2), axis=1))
    areas = [(np.cross(*sides) ** 2).sum(axis=2) for sides in pairwise(across)]
    return np.asarray(np.argmax(np.min(areas, axis=0), axis=1))


class _Sites:
    """The places in limit faces where polygons have corners.

    Those of a limit face are the points of a net. Behind those of all faces come the middles of
    segments on the sides of whole faces beside cut ones, n to a side.

    Attributes
    ----------
    net : Net
    face : (K,) int
        The limit faces that there are polygons of.
    corner : (K,) int
        Their corners of the cage: of a whole face the first.
    whole : (K,) bool
        Whether they are faces of the cage, and not the parts of one.
    fine : (n_corners,) bool
        Half-edges with 2 n segments.
    row, side : (X,) int
        Whole faces, as rows of `face`, and the sides of theirs that are fine.
    """

    def __init__(self, surface: LimitSurface, n: int) -> None:
        mesh, limit_faces = surface.mesh, surface.limit_faces
        self.net = Net(surface.topology.lattice, n)
        self.face = np.flatnonzero(surface.topology.with_limit)
        corner = limit_faces.corner[self.face]
        self.whole = corner < 0
        self.corner = mesh.offsets[limit_faces.face[self.face]] + np.maximum(corner, 0)
        fine = np.zeros(mesh.n_edges, dtype=bool)
        fine[mesh.corner_edge[self.corner[~self.whole]]] = True
        self.fine = fine[mesh.corner_edge]
        rows = np.flatnonzero(self.whole)
        sides = np.arange(self.net.lattice.face_size)
        row, self.side = np.nonzero(self.fine[self.corner[rows, None] + sides])
        self.row = rows[row]

    def corners(self) -> tuple[Array, Array]:
        """The sites of all corners of polygons (C,), and the sizes of these (F,)."""
        n, cells, width = self.net.n, self.net.cells, len(self.net.steps[0])
        size = cells.shape[1]
        sites = (np.arange(len(self.face))[:, None] * width + cells.ravel()).ravel()
        sizes = np.full(len(self.face) * len(cells), size)
        if len(self.row):
            # the cells along each side, from its start
            along = np.empty((size, n), dtype=np.int64)
            at = np.empty(width, dtype=np.int64)
            for k, side in enumerate(self.net.sides):
                at[cells[:, k]] = np.arange(len(cells))
                along[k] = at[side[:-1]]
            beside = self.row[:, None] * len(cells) + along[self.side]  # (X, n)
            extra = len(self.face) * width + np.arange(beside.size)
            sites = np.insert(sites, (size * beside + self.side[:, None] + 1).ravel(), extra)
            sizes += np.bincount(beside.ravel(), minlength=len(sizes))
        return sites, sizes

    def welded(self, mesh: Mesh) -> tuple[Array, Array]:
        """The points of all sites (S,), and a site of each point (V,).

        `mesh` is the cage, or that of a channel, which has the same faces and half-edges.
        """
        net, n = self.net, self.net.n
        after = mesh.next_corner
        inside = np.full(mesh.n_edges, n - 1)  # points inside each edge
        inside[mesh.corner_edge[self.fine]] = 2 * n - 1
        first = mesh.n_vertices + np.cumsum(inside) - inside

        def on_edge(corner: Array, step: Array) -> Array:
            """The points so many steps (m,) or (k, m) from the starts of half-edges (k,)."""
            corner = corner[:, None]
            edge = mesh.corner_edge[corner]
            start, end = mesh.indices[corner], mesh.indices[after[corner]]
            last = inside[edge] + 1
            step = np.where(start <= end, step, last - step)
            ends = np.where(step == 0, np.minimum(start, end), np.maximum(start, end))
            return np.where((step == 0) | (step == last), ends, first[edge] + step - 1)

        K, steps = len(self.face), np.arange(n + 1)
        points = np.empty((K, len(net.steps[0])), dtype=np.int64)
        whole, cut = (np.flatnonzero(x)[:, None] for x in (self.whole, ~self.whole))
        for k, side in enumerate(net.sides):
            corner = self.corner[whole[:, 0]] + k
            segments = 1 + self.fine[corner, None]  # to a step
            points[whole, side] = on_edge(corner, segments * steps)
        total = mesh.n_vertices + int(inside.sum())
        if len(cut):
            # from the vertex along its edges; from the middles of these to that of the face
            corner = self.corner[cut[:, 0]]
            out, to_middle, from_middle, back = net.sides
            points[cut, out] = on_edge(corner, steps)
            points[cut, back[::-1]] = on_edge(mesh.previous_corner[corner], 2 * n - steps)
            # limit faces of one face follow each other
            is_first = mesh.offsets[mesh.corner_face[corner]] == corner
            own = np.arange(len(cut))
            previous = own - 1 + is_first * mesh.sizes[mesh.corner_face[corner]]
            points[cut[:, 0], to_middle[-1]] = total + np.cumsum(is_first) - 1
            total += int(is_first.sum())
            inner = np.arange(n - 1)
            points[cut, to_middle[1:-1]] = total + own[:, None] * (n - 1) + inner
            points[cut, from_middle[-2:0:-1]] = total + previous[:, None] * (n - 1) + inner
            total += len(cut) * (n - 1)
        new = total + np.arange(K * len(net.inner))
        points[:, net.inner] = new.reshape(K, len(net.inner))
        total += len(new)
        number = points.ravel()
        if len(self.row):
            extra = on_edge(self.corner[self.row] + self.side, 2 * np.arange(n) + 1)
            number = np.concatenate([number, extra.ravel()])
        # of the vertices and edges some have no polygon
        place = np.full(total, -1)
        place[number[::-1]] = np.arange(len(number))[::-1]
        used = place >= 0
        if not used.all():
            number, place = (np.cumsum(used) - 1)[number], place[used]
        return number, place

    def places(self, site: Array) -> tuple[Array, Array, Array]:
        """Limit face, u and v of sites."""
        n, sides, (u, v) = self.net.n, self.net.sides, self.net.steps
        whole = len(self.face) * len(u)
        extra = site >= whole
        row, point = np.divmod(site, len(u))
        place = [x[point] for x in self.net.places]
        row = row.clip(max=len(self.face) - 1)
        if extra.any():
            number, step = np.divmod(site[extra] - whole, n)
            row[extra], side = self.row[number], self.side[number]
            for found, x in zip(place, (u, v), strict=True):
                found[extra] = (x[sides[side, step]] + x[sides[side, step + 1]]) / (2 * n)
        return self.face[row], place[0], place[1]

    def normals(
        self, surface: LimitSurface, number: Array, n_points: int, workers: int
    ) -> tuple[Array, Array]:
        """The normals of all sites, as rows (S,) of normals (K, 3), one for each side of a point.

        `number` has the points of sites; those inside a limit face are no other's.
        """
        rim, inner, (u, v) = self.net.rim, self.net.inner, self.net.places
        K, S, width = len(self.face), len(number), len(u)

        def grid(which: Array) -> Array:
            found = surface.normal(self.face[:, None], u[which], v[which], workers=workers)
            return np.asarray(found).reshape(K * len(which), 3)

        extra = np.arange(K * width, S)
        sites = np.concatenate([(np.arange(K)[:, None] * width + rim).ravel(), extra])
        known = np.concatenate([grid(rim), surface.normal(*self.places(extra), workers=workers)])
        side, chosen = sides(number[sites], known, n_points)
        rows = np.empty(S, dtype=np.int64)
        rows[sites] = side
        middle = np.arange(K * len(inner)).reshape(K, len(inner))
        rows[: K * width].reshape(K, width)[:, inner] = len(chosen) + middle
        return rows, np.concatenate([known[chosen], grid(inner)])
