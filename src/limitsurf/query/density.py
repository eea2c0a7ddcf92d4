"""Places of a surface drawn by chance, in proportion to area.

A surface is cut into pieces, each with a bound of how much area there is to an area of parameters.
Pieces are drawn by these bounds, places in them evenly, and each is kept with the probability
that the bound, and the number of its piece, call for: so those kept are spread by area, whatever
the bounds are (``derivations/samples.py``). Bounds that are near what they bound waste less.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limitsurf.engine.packing import over_chunks
from limitsurf.pieces import weights
from limitsurf.pieces.bernstein import Bernstein
from limitsurf.query.index import Cells
from limitsurf.query.polynomials import Form, products
from limitsurf.tables import EigenTable

Array = NDArray[Any]

_CHUNK = 1 << 11  # cells that are bounded at once
_FEW = 64  # corners at once, where there are many cells to each
_TRIES = 1 << 13  # places that are tried in one piece of work, and at once at most
_MOST_TRIES = 1 << 19
_LOOSE = 1.5  # bounds that are this many times the mean are tightened, beyond 2 times by halves
_HALVINGS = 40
_NOISE = 2.0**-46  # of lengths of derivatives: areas that are rounding
_SLACK = 1 + 2.0**-40
_RINGS = 64  # where rings are refined; one in 2^53 places tried is deeper, if that
_WIDE = 0.5625


class Places(NamedTuple):
    """Places of a surface."""

    face: Array
    u: Array
    v: Array


@dataclass(frozen=True, eq=False)
class AreaDensity:
    """Pieces of a surface, with bounds of the density of area.

    Attributes
    ----------
    cells : Cells
    cell : (P,) int
        What cells the pieces are parts of.
    frame : (P, 3, 2)
        Where: corner 0, s and t of each in (s, t) of its cell.
    most : (P,)
        Bounds of |dx/ds x dx/dt| in pieces.
    start, rate : (R,)
        At special corners, beyond the cells: bounds on ring n are ``start * rate**n``.
    area : float
        Of the surface, about: as four places in each piece say.
    """

    cells: Cells
    cell: Array
    frame: Array
    most: Array
    start: Array
    rate: Array
    area: float

    @classmethod
    def of(cls, cells: Cells, workers: int) -> AreaDensity:
        """That of a surface.

        Raises
        ------
        ValueError
            If it has no area.
        """
        form, points = cells.form, cells.points

        def work(part: slice) -> Array:
            return np.stack(_bounds(cells, points[part]))

        found = list(over_chunks(len(points), workers, work, _CHUNK))
        most, mean, long = np.concatenate([np.zeros((3, 0)), *found], axis=1)
        if not most.sum() > _NOISE * long.sum():
            raise ValueError(
                "the surface has no area to take samples of"
                if len(points)
                else "there is no limit face to take samples of"
            )
        cell = np.arange(len(points))
        frame = np.tile([[0.0, 0], [1, 0], [0, 1]], (len(points), 1, 1))
        for _ in range(_HALVINGS):
            loose = (most > 2 * mean) & (most > most.sum() / (16 * len(most)))
            if most.sum() <= 2 * mean.sum() or not loose.any():
                break
            which, parts = _halves(form, frame[loose])
            below = np.matmul(form.part(parts), points[cell[loose][which]])
            more, middle, _ = _bounds(cells, below)
            # a bound of the whole is one of halves, which have half the area of parameters
            more = np.minimum(more, most[loose][which] / 2)
            keep = ~loose
            cell = np.concatenate([cell[keep], cell[loose][which]])
            frame = np.concatenate([frame[keep], parts])
            most = np.concatenate([most[keep], more])
            mean = np.concatenate([mean[keep], middle])
        start, rate = _corners(cells)
        unit = 0.5 if cells.lattice.sloped else 1.0
        return cls(cells, cell, frame, most, start, rate, float(unit * mean.sum()))

    def draw(self, n: int, rng: np.random.Generator, workers: int) -> Places:
        """Places of as many independent samples, (n,) each."""
        rings = len(self.cells.lattice.pieces) * self.start / (1 - self.rate)
        total = np.cumsum(np.concatenate([self.most, rings]))
        left, share = n, min(1.0, self.area / total[-1] * (2 if self.cells.lattice.sloped else 1))
        found = []
        while left > 0:
            count = min(int(left / share * 1.05) + 16, _MOST_TRIES)
            chance = rng.random((6, count))

            def work(part: slice, chance: Array = chance) -> Array:
                return self._kept(total, chance[:, part])

            kept = np.concatenate(list(over_chunks(count, workers, work, _TRIES)), axis=1)
            found.append(kept[:, :left])
            left -= found[-1].shape[1]
        leaf, u, v = np.concatenate(found, axis=1)
        return Places(self.cells.face[leaf.astype(np.int64)], *np.clip([u, v], 0, 1))

    def _kept(self, total: Array, chance: Array) -> Array:
        """Leaf, u and v (3, m) of the places that are kept, of some by chance (6, Q)."""
        place, s, t, kept, ring, piece = chance
        which = np.searchsorted(total, place * total[-1], side="right")
        which = np.minimum(which, len(total) - 1)
        if self.cells.lattice.sloped:
            s, t = np.where(s + t > 1, [1 - s, 1 - t], [s, t])
        ratio, found = np.zeros(len(which)), np.empty((3, len(which)))
        here = np.flatnonzero(which < len(self.most))
        ratio[here], found[:, here] = self._in_pieces(which[here], s[here], t[here])
        here = np.flatnonzero(which >= len(self.most))
        if len(here):
            by_ring = (x[here] for x in (ring, piece, s, t))
            ratio[here], found[:, here] = self._on_rings(which[here] - len(self.most), *by_ring)
        return found[:, kept < ratio]

    def _in_pieces(self, which: Array, s: Array, t: Array) -> tuple[Array, Array]:
        """Densities in pieces by their bounds (Q,), and leaf, u and v of places (3, Q)."""
        cells, cell, frame = self.cells, self.cell[which], self.frame[which]
        s, t = (frame[:, 0] + s[:, None] * frame[:, 1] + t[:, None] * frame[:, 2]).T
        size = np.abs(frame[:, 1, 0] * frame[:, 2, 1] - frame[:, 1, 1] * frame[:, 2, 0])
        density = _density(cells.form, cells.points[cell], s, t) * size
        u, v = (cells.origin[cell] + np.stack([s, t], axis=1) * cells.size[cell]).T
        with np.errstate(divide="ignore", invalid="ignore"):
            return density / self.most[which], np.stack([cell, u, v])

    def _on_rings(
        self, corner: Array, ring: Array, piece: Array, s: Array, t: Array
    ) -> tuple[Array, Array]:
        """The same at special corners, ring and piece by chance."""
        cells, rate = self.cells, self.rate[corner]
        depth = np.floor(np.log1p(-ring) / np.log(rate)).astype(np.int64)
        on = cells.beyond.cells(corner, depth)
        k = (piece * on.points.shape[1]).astype(np.int64)
        each = np.arange(len(corner))
        density = _density(cells.form, on.points[each, k], s, t)
        leaf = corner + len(cells.points)
        place = on.origin[each, k] + np.stack([s, t], axis=1) * on.size[each, k]
        u, v = (cells.origin[leaf] + place * cells.size[leaf]).T
        return density / (self.start[corner] * rate**depth), np.stack([leaf, u, v])


def _density(form: Form, points: Array, s: Array, t: Array) -> Array:
    """|dx/ds x dx/dt| (Q,) of polynomials (Q, n, 3), each at one place."""
    basis = form.values(s, t)[:, 1:3]
    a, b = np.matmul(basis, points).swapaxes(0, 1)
    return _length(np.cross(a, b))


def _length(vectors: Array) -> Array:
    return np.asarray(np.sqrt((vectors**2).sum(axis=-1)))


def _bounds(cells: Cells, points: Array) -> tuple[Array, Array, Array]:
    """Bounds of |dx/ds x dx/dt| (p,) of polynomials (p, n, 3), about their mean, and lengths."""
    form = cells.form
    a, b = (np.matmul(form.derivatives[k], points) for k in (1, 2))
    along, across = (_length(x).max(axis=1, initial=0) for x in (a, b))
    most = along * across
    middle = form.ends.mean(axis=0)
    inner = middle + (form.ends - middle) / np.sqrt(3)
    basis = form.values(inner[:, 0], inner[:, 1], 0)[:, 0]
    mean = _length(np.cross(np.matmul(basis, a), np.matmul(basis, b))).mean(axis=1)
    loose = np.flatnonzero(most > _LOOSE * mean)
    if len(loose):
        x, y = a[loose], b[loose]
        product = products(cells.lattice, form.degree)
        square = 0.0
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            both = x[:, :, None, i] * y[:, None, :, j] - x[:, :, None, j] * y[:, None, :, i]
            square = square + (both.reshape(len(x), -1) @ product) ** 2
        most[loose] = np.minimum(most[loose], np.sqrt(square).max(axis=1))
    return most * _SLACK, mean, along + across


def _halves(form: Form, frame: Array) -> tuple[Array, Array]:
    """Both halves of parts of cells, across their longest side: of which, and their frames."""
    ends = np.matmul(form.ends, frame[:, 1:])
    a, b = form.across.T
    way = ((ends[:, a] - ends[:, b]) ** 2).sum(axis=2).argmax(axis=1)
    found = np.matmul(form.frames[way], frame[:, None, 1:])
    found[:, :, 0] += frame[:, None, 0]
    return np.repeat(np.arange(len(frame)), 2), found.reshape(-1, 3, 2)


def _corners(cells: Cells) -> tuple[Array, Array]:
    """Bounds of |dx/ds x dx/dt| on rings beyond the cells: on ring n ``start * rate**n``."""
    start, rate = np.zeros((2, len(cells.beyond)))
    for which, table, ring, modes in cells.beyond.eigenfunctions():
        if table is None:
            start[which], rate[which] = _refined(cells, which), _WIDE
            continue
        i, j, most, rate[which] = _minors(cells.form, table, ring)
        step = max(1, (1 << 22) // max(len(i), 1))
        for begin in range(0, len(which), step):
            some = slice(begin, begin + step)
            areas = _length(np.cross(modes[some][:, i], modes[some][:, j]))
            start[which[some]] = (areas @ most.T).max(axis=1) * _SLACK
    return start, rate


def _minors(form: Form, table: EigenTable, ring: int) -> tuple[Array, Array, Array, float]:
    """Bounds of |df/ds dg/dt - df/dt dg/ds| of all pairs of eigenfunctions, from a ring on.

    Numbers f and g of the pairs, bounds (m, pairs) by ``rate**n`` on rings n = 0 .. m - 1, which
    fall from there on, and the rate.
    """
    bernstein = Bernstein.of(table.scheme, False)
    first = bernstein.from_powers @ table.pieces[:, :, 1:]  # (c, n, K - 1)
    a, b = (np.matmul(form.derivatives[k], first) for k in (1, 2))
    product = products(table.scheme.lattice, form.degree)
    size = first.shape[2]
    i, j = np.triu_indices(size, 1)
    minors = np.zeros((size, size))
    for f in range(size - 1):
        g = slice(f + 1, size)
        both = a[:, :, None, f, None] * b[:, None, :, g] - b[:, :, None, f, None] * a[:, None, :, g]
        flat = np.moveaxis(both, 3, 1).reshape(len(a), size - 1 - f, -1) @ product
        minors[f, g] = np.abs(flat).max(axis=(0, 2))
    minors += minors.T
    sizes = np.sort(np.abs(table.rates[0, 1:]))[::-1]
    rate, steps = float(sizes[0] * sizes[1]), 1
    if len(table.chains):  # powers of n are as much more at first
        slower = (1 + 3 * rate) / 4
        steps = ceil(1 / (np.sqrt(slower / rate) - 1)) + 1
        rate = slower
    bounds = []
    for n in range(steps):
        powers = weights.growth(table, ring + n)
        bounds.append((powers.T @ minors @ powers)[i, j] / rate**n)
    return i, j, np.array(bounds), rate


def _refined(cells: Cells, which: Array) -> Array:
    """What bounds on rings that are refined begin with, (m,)."""
    found, fall = np.zeros(len(which)), _WIDE ** np.arange(_RINGS)
    for begin in range(0, len(which), _FEW):
        some = slice(begin, begin + _FEW)
        points = cells.beyond.rings(which[some], _RINGS)
        most, _, _ = _bounds(cells, points.reshape(-1, *points.shape[3:]))
        by_ring = most.reshape(*points.shape[:3]).max(axis=2)
        found[some] = (by_ring / fall).max(axis=1)
    return found
