"""Feet of points found by compiled kernels: what these are handed, and what they give back."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from limitsurf import _kernels
from limitsurf.query.index import Cells
from limitsurf.query.nearest import FAR, LOST, POINT, SAME, Feet, Search
from limitsurf.query.polynomials import Form, multiples, products
from limitsurf.query.traversal import Kernels
from limitsurf.scheme.lattice import Lattice

if TYPE_CHECKING:
    from limitsurf._kernels import nearest

Array = NDArray[Any]

_FEET, _SPARE = (4, 12), 256  # of a point that there is room for, or of all within, and some more
_RINGS = 5  # of cells beyond those of an index: places that NumPy is left with are rare
_SPANS = 8  # vectors that bound what remains at a special corner, but for short ones

_CELLS = 1 << 10  # that are bounded at once
_ALMOST = 1e-6  # by which bounds are wider, of what is about 1: rounding, of cells that are not
_SLANTED = 2.0**24  # as thin, or as small, as this

_ROUNDING, _CLOSE = 2.0**-50, 2.0**-20  # of places in limit faces; and what is beside a corner

_corners: WeakKeyDictionary[Cells, Any] = WeakKeyDictionary()


def search(
    kernels: Kernels | None, cells: Cells, points: Array, within: Array, every: bool
) -> Feet:
    """Places that may be nearest to points (Q, 3), at most `within` (Q,) away, or `every` foot.

    By kernels if there are any, and by NumPy what they leave.
    """
    found, rest = [Feet.none()], np.arange(len(points))
    if kernels is not None:
        known, rest = approached(kernels, points, within, every)
        found.append(known)
    if len(rest):
        own = Search(cells, points[rest], within[rest], every).run()
        own.query = rest[own.query]
        found.append(own)
    feet = Feet.joined(found)
    if cells.lattice.sloped:  # (so that 1 - u - v is 0 on the third side)
        on = np.abs(feet.u + feet.v - 1) <= _ROUNDING
        on &= np.minimum(feet.u, feet.v) > _CLOSE
        feet.v = np.where(on, 1 - feet.u, feet.v)
    return feet


def approached(kernels: Kernels, points: Array, within: Array, every: bool) -> tuple[Feet, Array]:
    """Feet of points, and which points NumPy has to do, (n,)."""
    cells = kernels.cells
    with _kernels.preparing:
        module = _kernels.searching("nearest")
    if cells not in _corners:
        _corners[cells] = _beyond(module, cells), bends(cells)
    squares = _squares(module, cells.lattice, cells.form.degree)
    room = module.Room.of(cells.form.size, len(squares.starts) - 1)
    limits = module.Limits(SAME, LOST, POINT, FAR)
    out = np.empty((_FEET[every] * len(points) + _SPARE, 6))
    found, asked, doubt = [Feet.none()], np.arange(len(points)), [np.zeros(0, dtype=np.int64)]
    while len(asked):
        left = np.zeros(len(asked), dtype=np.int64)
        n = module.approach(
            kernels.tree, kernels.shape, squares, *_corners[cells], limits,
            np.ascontiguousarray(points[asked]), within[asked], cells.lattice.sloped, every, room,
            out, left,
        )  # fmt: skip
        s, t, distance, off, query, leaf = out[:n].T
        leaf = leaf.astype(np.int64)
        places = cells.origin[leaf] + cells.size[leaf] * np.stack([s, t], axis=1)
        u, v = _on_sides(places.T)
        query = asked[query.astype(np.int64)]
        found.append(Feet(query, cells.face[leaf], u, v, distance.copy(), off.copy()))
        again = asked[left == module.FULL] if n else np.zeros(0, dtype=np.int64)
        doubt.append(asked[left == module.DOUBT] if n else asked[left != module.KNOWN])
        asked = again
    return Feet.joined(found), np.sort(np.concatenate(doubt))


def _on_sides(u: Array) -> Array:
    """Parameters of places in cells, those on sides of limit faces put there but for rounding."""
    u = np.where(np.abs(u - 1) <= _ROUNDING, 1.0, u)
    return np.where(np.abs(u) <= _ROUNDING, 0.0, u)


def _beyond(module: Any, cells: Cells) -> nearest.Corners:
    """What remains at the special corners of a surface as kernels know it."""
    beyond = cells.beyond
    n = len(beyond)
    bounds = [beyond.spans(ring, _SPANS) for ring in (0, _RINGS)]
    spans, rest = (np.stack(x) for x in zip(*bounds, strict=True))
    which, ring = np.repeat(np.arange(n), _RINGS), np.tile(np.arange(_RINGS), n)
    found = beyond.cells(which, ring)
    count = _RINGS * found.points.shape[1]
    points = found.points.reshape(n, count, *found.points.shape[2:])
    frames = np.concatenate([found.origin, found.size], axis=2).reshape(n, count, 4)
    known: nearest.Corners = module.Corners(beyond.limits, spans, rest, points, frames)
    return known


def bends(cells: Cells) -> Array:
    """Bounds of cells (C, 3) in parameters of their own, in which mean derivatives are orthonormal.

    Of second derivatives from above (inf where derivatives are not near their means), of chords,
    squared, to these parameters from below, and of these parameters to s and t from above: of a
    foot where the first times the distance is less than the second nothing in the cell is nearer.
    """
    found = np.full((len(cells.points), 3), np.inf)
    found[:, 1] = 0
    n = cells.form.size
    every = cells.form.derivatives[1:].reshape(-1, n)
    for start in range(0, len(found), _CELLS):
        points = cells.points[start : start + _CELLS]
        x = np.matmul(every, points).reshape(len(points), 5, -1, 3)
        mean = x[:, :2].mean(axis=2)
        with np.errstate(all="ignore"):
            # the columns of the inverse of R, of mean = Q R
            first = 1 / np.sqrt((mean[:, 0] ** 2).sum(axis=1))
            unit = mean[:, 0] * first[:, None]
            along = (unit * mean[:, 1]).sum(axis=1)
            across = mean[:, 1] - along[:, None] * unit
            second = 1 / np.sqrt((across**2).sum(axis=1))
            slant = -along * first * second
            p, g, r = (y[:, None, None] for y in (first, second, slant))
            off = x[:, :2] - mean[:, :, None]
            bent = _longest(off[:, 0] * p) + _longest(off[:, 0] * r + off[:, 1] * g)
            ss, st, tt = x[:, 2], x[:, 3], x[:, 4]
            bend = _longest(ss * p**2) + 2 * _longest(ss * p * r + st * p * g)
            bend += _longest(ss * r**2 + 2 * st * r * g + tt * g**2)
            least = 1 - np.sqrt(bent) - _ALMOST
            here = least > 0
            rows = np.stack(
                [
                    np.sqrt(bend) * (1 + _ALMOST),
                    least**2,
                    np.sqrt(first**2 + second**2 + slant**2) * (1 + _ALMOST),
                ],
                axis=1,
            )
            here &= np.isfinite(rows).all(axis=1) & (rows[:, 2] < _SLANTED)
        found[start : start + _CELLS][here] = rows[here]
    return found


def _longest(vectors: Array) -> Array:
    """The square of the longest of vectors (C, k, 3), (C,)."""
    return np.asarray((vectors**2).sum(axis=2).max(axis=1))


@lru_cache(maxsize=32)
def _squares(module: Any, lattice: Lattice, degree: int) -> nearest.Squares:
    """Squared distances from cells of a degree as kernels know them."""
    form, twice = Form.of(lattice, degree), Form.of(lattice, 2 * degree)
    n, m = form.size, twice.size
    means = products(lattice, degree).reshape(n, n, m)
    a, b, c = np.nonzero(means)
    half = a <= b
    a, b, c = (x[half] for x in (a, b, c))
    order = np.argsort(c, kind="stable")
    a, b, c = (x[order] for x in (a, b, c))
    shares = means[a, b, c] * np.where(a == b, 1, 2)
    starts = np.concatenate([[0], np.cumsum(np.bincount(c, minlength=m))])
    ways = {(1, 0): 0, (0, 1): 1, (1, 1): 2}
    signs = form.inward.sum(axis=1) > 0
    inward = [
        (ways[tuple(np.abs(way).astype(int).tolist())], 1 if up else -1)
        for way, up in zip(form.inward, signs, strict=True)
    ]
    ratio = 1.0 if lattice.sloped else 2 * degree / (2 * degree - 1)
    known: nearest.Squares = module.Squares(
        starts.astype(np.int64), np.stack([a, b], axis=1).astype(np.int64), shares,
        *_differences(twice), ratio, np.array(inward, dtype=np.int64),
        twice.corners.astype(np.int64), form.corners.astype(np.int64), form.ends,
        np.array(lattice.edges, dtype=float), twice.edges.astype(np.int64),
        form.exponents.astype(np.int64), np.array(multiples(form.exponents), dtype=float),
    )  # fmt: skip
    return known


def _differences(form: Form) -> tuple[Array, Array, Array]:
    """Coefficients (2, k, 2), (2, l, 3) and (q, 4) whose differences are those of derivatives."""
    number = {tuple(place): k for k, place in enumerate(form.exponents.tolist())}

    def rows(*steps: tuple[int, int]) -> list[list[int]]:
        places = [[(i + x, j + y) for x, y in steps] for i, j in number]
        return [[number[at] for at in row] for row in places if all(at in number for at in row)]

    first = [rows((0, 0), (1, 0)), rows((0, 0), (0, 1))]
    second = [rows((0, 0), (1, 0), (2, 0)), rows((0, 0), (0, 1), (0, 2))]
    mixed = rows((0, 0), (1, 0), (0, 1), (1, 1))
    return tuple(np.array(x, dtype=np.int64) for x in (first, second, mixed))  # type: ignore[return-value]
