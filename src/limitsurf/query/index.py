"""Bezier cells of a surface in a hierarchy of boxes: where to look."""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from limitsurf import numbers
from limitsurf.caching import cached_property
from limitsurf.engine.packing import one_by_one
from limitsurf.engine.protocol import threads
from limitsurf.engine.topology import Topology
from limitsurf.integrals.cells import used_vertices
from limitsurf.pieces.beyond import Beyond
from limitsurf.pieces.cells import cut
from limitsurf.query.polynomials import Form
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

RINGS = 6  # of cells around special corners; those beyond are made when they are asked for
_WIDTH = 4  # children of a box
_MARGIN = 2.0**-49  # by which boxes are larger, of the largest coordinate: rounding of coefficients

_known: WeakKeyDictionary[LimitSurface, Cells] = WeakKeyDictionary()
_orders: WeakKeyDictionary[Topology, Array] = WeakKeyDictionary()


class SurfaceIndex:
    """A surface cut into Bezier cells, in a hierarchy of boxes, for questions that search it.

    Functions that search make one when they are first asked of a surface, and keep it as long as
    the surface lives. Make it yourself to choose when that is. A surface `with_points` of another
    has the same hierarchy: only its cells and boxes are computed anew.

    Every box holds its part of the surface: a hull of control points, rounding included. Cells are
    the limit surface exactly. Around special corners there are 6 rings of them; more are made as
    deep as a query needs them.

    Parameters
    ----------
    surface : LimitSurface
        Of float64 points, (n_vertices, 3).
    workers : int
        Threads that make the cells, as for `LimitSurface.evaluate`.

    Attributes
    ----------
    surface : LimitSurface

    Raises
    ------
    TypeError
        For what is not a surface, and for exact points.
    ValueError
        For points of another shape, or that are not finite.

    Notes
    -----
    A regular face takes about 0.6 kB where faces are quads; a special corner 9 to 13 kB for each
    face, and 6 kB more once kernels search for closest points.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> ls.SurfaceIndex(ls.LimitSurface(square))
    SurfaceIndex(1 cells, 0 special corners)
    """

    def __init__(self, surface: LimitSurface, *, workers: int = 1) -> None:
        self.surface = surface
        self.cells = Cells.of(surface, threads(workers))

    def __reduce__(self) -> Any:
        return SurfaceIndex, (self.surface,)

    def __repr__(self) -> str:
        cells, rest = len(self.cells.points), len(self.cells.beyond)
        return f"SurfaceIndex({cells} cells, {rest} special corners)"


class Cells:
    """The cells of a surface and their boxes; the surface itself is not kept.

    Attributes
    ----------
    lattice : Lattice
    form : Form
    power : int
        Points of the cage are multiplied by 2 to this power, so that the largest coordinate of
        those that the surface depends on is about 1: the unit of all that follows, and of searches.
    face : (C + R,) int64
        Limit faces of C cells, then of R special corners.
    origin, size : (C + R, 2)
        As in `BezierPatches` and `BezierRest`.
    points : (C, n, 3)
    beyond : Beyond
    lower, upper : (C + R, 3)
    order : (C + R,) int
        Leaves of the hierarchy, if there are 6 rings of cells, as searches want them.
    """

    def __init__(self, surface: LimitSurface, workers: int, rings: int = RINGS) -> None:
        topology, points = surface.topology, surface.points
        self.lattice = topology.lattice
        faces = np.arange(len(surface.limit_faces))
        used = used_vertices(surface, faces)
        largest = np.abs(points[used]).max(initial=0)
        if not np.isfinite(largest):
            raise ValueError("the points of the cage must be finite")
        self.power = -int(np.frexp(largest)[1]) if largest else 0
        depth = rings - (surface.limit_faces.corner >= 0)
        scheme, scaled = topology.rules.scheme, np.zeros(points.shape)
        scaled[used] = np.ldexp(points[used], self.power)
        divided = one_by_one(workers)
        cells = cut(topology.patches, scheme, scaled, faces, depth, False, divided)
        self.form = Form.of(self.lattice, cells.degree)
        self.face = np.concatenate([cells.face, cells.rest.face])
        self.origin = np.concatenate([cells.origin, cells.rest.origin])
        self.size = np.concatenate([cells.size, cells.rest.size])
        self.points = cells.points.reshape(len(cells), self.form.size, 3)
        self.beyond = Beyond(topology.patches, scheme, scaled, faces, depth)
        lower, upper = self.points.min(axis=1), self.points.max(axis=1)
        rest = [x.reshape(-1, 3) for x in (cells.rest.lower, cells.rest.upper)]
        self.lower = np.concatenate([lower, rest[0]]) - _MARGIN
        self.upper = np.concatenate([upper, rest[1]]) + _MARGIN
        if rings != RINGS:
            return
        if topology not in _orders:
            with np.errstate(invalid="ignore"):
                _orders[topology] = _near_ones(self.lower, self.upper)
        self.order = _orders[topology]

    @classmethod
    def of(cls, surface: LimitSurface, workers: int = 1) -> Cells:
        """Those of a surface, made when first asked for."""
        found = _known.get(checked_surface(surface))
        if found is None:
            found = _known[surface] = cls(surface, workers)
        return found

    @cached_property
    def levels(self) -> list[tuple[Array, Array]]:
        """Lower and upper corners of boxes, (n, 3) each: of all, ..., of the leaves in order."""
        found = [(self.lower[self.order], self.upper[self.order])]
        while len(found[-1][0]) > _WIDTH:
            first = np.arange(0, len(found[-1][0]), _WIDTH)
            lower, upper = found[-1]
            both = np.minimum.reduceat(lower, first), np.maximum.reduceat(upper, first)
            found.append(both)
        return found[::-1]

    @cached_property
    def middles(self) -> tuple[Any, Array]:
        """A tree of the surface at the middles of all cells, and where in a cell that is, (2,)."""
        from scipy.spatial import cKDTree

        middle = self.form.ends.mean(axis=0)
        basis = self.form.values(middle[:1], middle[1:], 0)[0]
        points = np.matmul(basis, self.points)[:, 0]
        tree = cKDTree(points, balanced_tree=False, compact_nodes=False) if len(points) else None
        return tree, middle

    def frames(self, leaf: Array) -> Array:
        """Corner 0, s and t of leaves (P,) in (u, v) of their limit faces, (P, 3, 2)."""
        found = np.zeros((len(leaf), 3, 2))
        found[:, 0] = self.origin[leaf]
        found[:, 1, 0], found[:, 2, 1] = self.size[leaf].T
        return found

    def ring_frames(self, which: Array, origin: Array, size: Array) -> Array:
        """The same of cells on rings of special corners (M,), (M, c, 3, 2).

        `origin` and `size` (M, c, 2) are as in `RingCells`.
        """
        leaf = which + len(self.points)
        found, scale = np.zeros((*size.shape[:2], 3, 2)), self.size[leaf][:, None]
        found[:, :, 0] = self.origin[leaf][:, None] + scale * origin
        found[:, :, [1, 2], [0, 1]] = scale * size
        return found

    def children(self, node: Array, query: Array, level: int) -> tuple[Array, Array]:
        """Boxes that those of a level hold, and the queries of each, (n,) both."""
        node = (_WIDTH * node[:, None] + np.arange(_WIDTH)).ravel()
        inside = node < len(self.levels[level + 1][0])
        return node[inside], np.repeat(query, _WIDTH)[inside]


def checked_surface(surface: Any, channel: str | None = None) -> LimitSurface:
    """A surface that can be searched, or that of one of its channels."""
    if not isinstance(surface, LimitSurface):
        raise TypeError(f"need a LimitSurface, got {type(surface).__name__}")
    found = surface.of_channel(channel)
    if found.points.shape[1:] != (3,):
        what = "points of shape (n_vertices, 3)" if channel is None else "values of shape (n, 3)"
        raise ValueError(f"need {what}, got {found.points.shape}")
    if numbers.type_of(found.points).exact:
        raise TypeError("distances need square roots: give float64 points")
    return found


def _near_ones(lower: Array, upper: Array) -> Array:
    """An order of boxes (n, 3) in which those of each run of a power of two are near each other.

    Runs are halved where their middles are spread most, as hierarchies of boxes are cut.
    """
    middle = np.nan_to_num((lower + upper) / 2, posinf=0, neginf=0)
    order, place = np.arange(len(middle)), np.arange(len(middle))
    for bit in range(max(len(middle) - 1, 0).bit_length(), 0, -1):
        run = place >> bit
        first = np.arange(0, len(middle), 1 << bit)
        here = middle[order]
        span = np.maximum.reduceat(here, first) - np.minimum.reduceat(here, first)
        along = here[place, span.argmax(axis=1)[run]]
        order = order[np.lexsort([along, run])]
    return order
