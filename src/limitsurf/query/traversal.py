"""Rays followed by compiled kernels: what these are handed, and what they give back."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from limitsurf import _kernels
from limitsurf.query.crossings import BLUR, NEAR, SLACK, TIE, TIED, WIDE, Hits, Rays, inside
from limitsurf.query.index import Cells
from limitsurf.query.polynomials import Form, multiples
from limitsurf.scheme.lattice import Lattice

if TYPE_CHECKING:
    from limitsurf._kernels import traversal

Array = NDArray[Any]

_RAY = 1.5e-4  # seconds that NumPy takes for one
_HITS = (2, 1, 8)  # of a ray that there is room for, by what is asked, and some more
_SPARE = 256
_STEEPEST = 2000  # powers of two between t and depths that kernels know


class Kernels(NamedTuple):
    """What follows rays, for one surface."""

    module: Any
    cells: Cells
    tree: traversal.Hierarchy
    shape: traversal.Shape


_trees: WeakKeyDictionary[Cells, Any] = WeakKeyDictionary()


def kernels_for(choice: str, cells: Cells, rays: int) -> Kernels | None:
    """Kernels that follow so many rays; None if NumPy is to do it."""
    if choice == "reference":
        return None
    if choice == "compiled":
        if not _kernels.load():
            return None
    elif not _kernels.answer(_kernels.SEARCHES, rays * _RAY):
        return None
    with _kernels.preparing:
        module = _kernels.searching("traversal")
    if cells not in _trees:
        _trees[cells] = _hierarchy(module, cells)
    return Kernels(module, cells, _trees[cells], _shape(module, cells.lattice, cells.form.degree))


def _hierarchy(module: Any, cells: Cells) -> traversal.Hierarchy:
    """The boxes and cells of a surface as kernels know them."""
    boxes = np.concatenate([np.concatenate(level, axis=1) for level in cells.levels])
    counts = [len(lower) for lower, _ in cells.levels]
    n = len(cells.points)
    known: traversal.Hierarchy = module.Hierarchy(
        np.clip(boxes, -WIDE, WIDE),
        np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        cells.order.astype(np.int64),
        np.ascontiguousarray(cells.points),
        np.concatenate([cells.origin[:n], cells.size[:n]], axis=1),
    )
    return known


@lru_cache(maxsize=32)
def _shape(module: Any, lattice: Lattice, degree: int) -> traversal.Shape:
    """Polynomials of a degree as kernels know them."""
    form = Form.of(lattice, degree)
    number = {tuple(place): k for k, place in enumerate(form.exponents.tolist())}
    less = Form.of(lattice, degree - 1).exponents if degree > 1 else np.zeros((1, 2), dtype=int)
    i, j = less.T
    if lattice.sloped:
        near, powers = [(0, 0), (1, 0), (0, 1), (0, 0)], [i, j, degree - 1 - i - j, 0 * i]
    else:
        near, powers = [(0, 0), (1, 0), (0, 1), (1, 1)], [i, degree - 1 - i, j, degree - 1 - j]
    lower = [[number[a + x, b + y] for x, y in near] for a, b in less.tolist()]
    pairs = [
        [[k, number[a + x, b + y]] for (a, b), k in number.items() if (a + x, b + y) in number]
        for x, y in ((1, 0), (0, 1))
    ]
    lines, halves = _lines(lattice, degree, number)
    known: traversal.Shape = module.Shape(
        np.array(lower, dtype=np.int64),
        np.stack(powers, axis=1).astype(np.int64),
        np.array(multiples(less) if degree > 1 else [1], dtype=float),
        np.array(pairs, dtype=np.int64),
        lines,
        halves,
        np.ascontiguousarray(form.frames),
    )
    return known


def _lines(
    lattice: Lattice, degree: int, number: dict[tuple[int, int], int]
) -> tuple[Array, Array]:
    """Coefficients (w, l, d + 1) along lines, and (w, 2, l, d + 1) where their halves belong."""
    steps = range(degree + 1)
    ways = 3 if lattice.sloped else 2
    lines = np.full((ways, degree + 1, degree + 1), -1, dtype=np.int64)
    halves = np.full((ways, 2, degree + 1, degree + 1), -1, dtype=np.int64)
    for way in range(ways):
        for row in steps:
            if not lattice.sloped:
                line = [number[(k, row) if way == 0 else (row, k)] for k in steps]
                lines[way, row] = halves[way, :, row] = line
                continue
            # exponents at corners 0, 1 and 2, of which one stays, and others are halved between
            for k in range(degree - row + 1):
                at = np.zeros(3, dtype=int)
                at[way], at[(way + 1) % 3], at[(way + 2) % 3] = degree - row - k, k, row
                lines[way, row, k] = number[int(at[1]), int(at[2])]
                halves[way, :, row, k] = number[degree - row - k, k]
    return lines, halves


def followed(kernels: Kernels, rays: Rays, what: str) -> tuple[Hits, Array]:
    """Hits of rays, and which rays NumPy has to follow, (n,)."""
    module, cells = kernels.module, kernels.cells
    mode = {"first": module.FIRST, "any": module.ANY, "every": module.EVERY}[what]
    room = module.Room.of(cells.form.size)
    most = _HITS[mode] * len(rays) + _SPARE
    ray, cell = np.empty((2, most), dtype=np.int64)
    real, left = np.empty((most, 7)), np.zeros(len(rays), dtype=np.int64)
    limits = module.Limits(SLACK, NEAR, TIED, BLUR)
    steep = np.abs(rays.power) > _STEEPEST
    lines = _seen(module, rays)
    n = module.traverse(
        kernels.tree, kernels.shape, lines, limits, cells.lattice.sloped, mode, room,
        ray, cell, real, left,
    )  # fmt: skip
    left[steep] = 1
    keep = np.flatnonzero(~steep[ray[:n]]) if steep.any() else slice(0, n)
    ray, cell, real = ray[:n][keep], cell[:n][keep], real[:n][keep]
    u, v, depth, t, blur, sign, rim = np.ascontiguousarray(real.T)
    u, v = inside(cells.lattice, u, v)  # but for rounding
    hits = Hits(
        ray, cells.face[cell], u, v, depth, t, blur, np.sign(sign).astype(np.int64), rim > 0,
        np.zeros(len(ray), dtype=bool),
    )  # fmt: skip
    return hits, np.flatnonzero(left)


def _seen(module: Any, rays: Rays) -> traversal.Lines:
    """Rays as kernels know them."""
    half = np.clip(rays.power // 2, -1000, 1000)
    rest = np.clip(rays.power - half, -1000, 1000)
    with np.errstate(over="ignore", under="ignore"):
        ends = np.stack([rays.least, rays.most])
        depth = np.sort(rays.origin + rays.along * np.ldexp(ends, -rays.power), axis=0)
    bounds = np.stack([depth[0] - TIE, depth[1] + TIE, rays.least, rays.most], axis=1)
    along = np.stack([rays.along, np.ldexp(1.0, half), np.ldexp(1.0, rest)], axis=1)
    known: traversal.Lines = module.Lines(
        np.ascontiguousarray(rays.axes, dtype=np.int64), np.ascontiguousarray(rays.slope),
        np.ascontiguousarray(rays.start), along, np.ascontiguousarray(rays.origin),
        np.ascontiguousarray(bounds),
    )  # fmt: skip
    return known
