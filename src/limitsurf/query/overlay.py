"""Cells of a surface and of a channel of another topology, cut until they are the same.

Both are dyadic parts of limit faces, so two that overlap are parts of each other along u and along
v. A corner that is special for one of the two alone lies in a regular cell of the other.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.engine.packing import one_by_one
from limitsurf.pieces import bernstein
from limitsurf.pieces.beyond import Beyond, RingCells
from limitsurf.pieces.cells import cut
from limitsurf.query.index import RINGS, Cells
from limitsurf.query.polynomials import Form
from limitsurf.query.records import numbered
from limitsurf.surface import LimitSurface

Array = NDArray[Any]


@dataclass
class _Layer:
    """Cells (C,) and special corners (R,) of limit faces with coefficients (C, k, d)."""

    form: Form
    face: Array
    origin: Array
    size: Array
    values: Array
    rest_face: Array
    rest_origin: Array
    rest_size: Array
    beyond: Beyond

    def extended(self, which: Array, more: Array) -> _Layer:
        """With so many rings (n,) more of cells at some special corners (n,)."""
        parts = [(self.face, self.origin, self.size, self.values)]
        for ring in range(int(more.max(initial=0))):
            some = which[more > ring]
            found = self.beyond.cells(some, np.full(len(some), ring))
            size = self.rest_size[some][:, None]
            count = found.points.shape[1]
            values = found.points + self.beyond.limits[some][:, None, None]
            parts.append((
                np.repeat(self.rest_face[some], count),
                (self.rest_origin[some][:, None] + size * found.origin).reshape(-1, 2),
                (size * found.size).reshape(-1, 2),
                values.reshape(-1, *values.shape[2:]),
            ))  # fmt: skip
        face, origin, size, own = (np.concatenate(x) for x in zip(*parts, strict=True))
        return replace(self, face=face, origin=origin, size=size, values=own)

    def parts(self, cell: Array, origin: Array, size: Array) -> Array:
        """Coefficients on parts of cells (n,), of limit faces."""
        frame = np.zeros((len(cell), 3, 2))
        frame[:, 0] = (origin - self.origin[cell]) / self.size[cell]
        frame[:, 1, 0], frame[:, 2, 1] = (size / self.size[cell]).T
        found = self.values[cell]
        number, first = numbered(list(frame.reshape(-1, 6).T))
        matrices = bernstein.blossoms(self.form.exponents, frame[first])
        for k, matrix in enumerate(matrices):
            here = number == k
            found[here] = np.matmul(matrix, found[here])
        return found


def _overlap(sloped: bool, one: tuple[Array, Array], two: tuple[Array, Array]) -> Any:
    """Whether parts overlap, by origins and sizes, and what they share."""
    low = np.maximum(*(np.minimum(o, o + s) for o, s in (one, two)))
    high = np.minimum(*(np.maximum(o, o + s) for o, s in (one, two)))
    share = (high > low).all(axis=1)
    if not sloped:
        return share, low, high - low
    smaller = np.all(np.abs(one[1]) <= np.abs(two[1]), axis=1, keepdims=True)
    small = [np.where(smaller, a, b) for a, b in zip(one, two, strict=True)]
    large = [np.where(smaller, b, a) for a, b in zip(one, two, strict=True)]
    middle = (small[0] + small[1] / 3 - large[0]) / large[1]
    share &= (middle > 0).all(axis=1) & (middle.sum(axis=1) < 1)
    return share, *small


class Overlay(Cells):
    """The cells of a surface as parts on which a column of a channel is a polynomial, too."""

    def __init__(  # (nothing of another class is made: these are cells of no hierarchy)
        self, surface: LimitSurface, cells: Cells, values: LimitSurface, numbers: Array,
        workers: int,
    ) -> None:  # fmt: skip
        self.lattice, self.form, self.power = cells.lattice, cells.form, cells.power
        count = len(cells.points)
        places = cells.face, cells.origin, cells.size
        face, origin, size = (x[:count] for x in places)
        rest_face, rest_origin, rest_size = (x[count:] for x in places)
        points = _Layer(
            cells.form, face, origin, size, cells.points,
            rest_face, rest_origin, rest_size, cells.beyond,
        )  # fmt: skip
        layers = [points, _layer(values, numbers, workers)]
        corners = _Corners(layers, self.form, len(self.lattice.pieces))
        layers = corners.layers
        pairs = _pairs(*(layer.face for layer in layers))
        one, two = ((x.origin[k], x.size[k]) for x, k in zip(layers, pairs, strict=True))
        share, origin, size = _overlap(self.lattice.sloped, one, two)
        pairs = [k[share] for k in pairs]
        origin, size = origin[share], size[share]
        both = zip(layers, pairs, strict=True)
        self.points, self.values = (x.parts(k, origin, size) for x, k in both)
        self.face = np.concatenate([layers[0].face[pairs[0]], corners.face])
        self.origin = np.concatenate([origin, corners.origin])
        self.size = np.concatenate([size, corners.size])
        self.beyond: Any = corners


class _Corners:
    """Special corners of either layer, in the place of `Beyond`: (R,)."""

    def __init__(self, layers: list[_Layer], form: Form, pieces: int) -> None:
        self._form, self._pieces = form, pieces
        turn = [x.beyond.corner(np.arange(len(x.beyond))) for x in layers]
        face = np.concatenate([x.rest_face for x in layers])
        origin, size = (
            np.concatenate([getattr(x, name) for x in layers])
            for name in ("rest_origin", "rest_size")
        )
        corner = np.concatenate(turn)
        at = origin + size * form.ends[corner]
        # (which way a corner opens is another in triangles that are turned)
        keys = [np.sign(size[:, 0]), corner, *at.T, face]
        number, first = numbered(keys)
        self._corner, self.face = corner[first], face[first]
        at, sign = at[first], np.sign(size[first])
        count = len(first)
        own = np.full((2, count), -1)
        split = len(turn[0])
        own[0, number[:split]] = np.arange(split)
        own[1, number[split:]] = np.arange(len(number) - split)
        # the cells of a layer that hold what is not special there
        inside = at + sign * 2.0**-45 * (1 / 3 - form.ends[self._corner])
        self._cell = np.full((2, count), -1)
        least = np.full((count, 2), np.inf)
        for k, x in enumerate(layers):
            plain = np.flatnonzero(own[k] < 0)
            self._cell[k, plain] = _holding(x, self.face[plain], inside[plain])
            least[plain] = np.minimum(least[plain], np.abs(x.size[self._cell[k, plain]]))
            there = np.flatnonzero(own[k] >= 0)
            least[there] = np.minimum(least[there], np.abs(x.rest_size[own[k, there]]))
        least = least.min(axis=1)
        self.size = sign * least[:, None]
        self.origin = at - self.size * form.ends[self._corner]
        self._own, self._more = own, np.zeros((2, count), dtype=np.int64)
        self.layers = []
        for k, x in enumerate(layers):
            there = np.flatnonzero(own[k] >= 0)
            ratio = np.abs(x.rest_size[own[k, there], 0]) / least[there]
            self._more[k, there] = np.round(np.log2(ratio)).astype(np.int64)
            self.layers.append(x.extended(own[k, there], self._more[k, there]))
        self.limits, self.values = (self._limits(k) for k in (0, 1))

    def __len__(self) -> int:
        return len(self.face)

    def corner(self, which: Array) -> Array:
        """At which corners of their cells they are, (M,)."""
        return self._corner[which]

    def _limits(self, k: int) -> Array:
        x, own = self.layers[k], self._own[k]
        found = np.empty((len(own), x.values.shape[2]))
        special = own >= 0
        found[special] = x.beyond.limits[own[special]]
        plain = np.flatnonzero(~special)
        there = x.parts(self._cell[k, plain], self.origin[plain], self.size[plain])
        found[plain] = there[np.arange(len(plain)), x.form.corners[self._corner[plain]]]
        return found

    def cells(self, which: Array, ring: Array) -> RingCells:
        """As `Beyond.cells`, of the points."""
        return self.of_layer(0, which, ring)

    def of_layer(self, k: int, which: Array, ring: Array) -> RingCells:
        """The cells of a ring (M,) around corners (M,), relative to the limits there."""
        x = self.layers[k]
        special = self._own[:, which] >= 0
        form, shape = x.form, self._pieces
        points = np.empty((len(which), shape, form.size, x.values.shape[2]))
        origin, size = np.empty((2, len(which), shape, 2))
        for j, layer in enumerate(self.layers):  # places are the same in both
            here = np.flatnonzero(special[j])
            if not len(here):
                continue
            more = self._more[j, which[here]]
            cells = layer.beyond.cells(self._own[j, which[here]], ring[here] + more)
            scale = np.ldexp(1.0, more)[:, None, None]
            far = self._form.ends[self._corner[which[here]]][:, None]
            # (of what remains in the layer, which is larger)
            origin[here], size[here] = (cells.origin - far) * scale + far, cells.size * scale
            if j == k:
                points[here] = cells.points
        plain = np.flatnonzero(~special[k])
        if len(plain):
            own = which[plain]
            low = self.origin[own][:, None] + self.size[own][:, None] * origin[plain]
            extent = self.size[own][:, None] * size[plain]
            cell = np.repeat(self._cell[k, own], shape)
            there = x.parts(cell, low.reshape(-1, 2), extent.reshape(-1, 2))
            limits = self.values if k else self.limits
            there = there.reshape(len(plain), shape, form.size, -1)
            points[plain] = there - limits[own][:, None, None]
        return RingCells(points, origin, size)

    def reach(self, which: Array, ring: Array) -> Array:
        """Bounds (M,) of how far the column goes from that at the corner, from a ring on."""
        x, found = self.layers[1], np.empty(len(which))
        special = self._own[1, which] >= 0
        here = np.flatnonzero(special)
        own = self._own[1, which[here]]
        ones = np.ones((len(here), 1))
        found[here] = x.beyond.reach(own, ring[here] + self._more[1, which[here]], ones)[1]
        plain = np.flatnonzero(~special)
        own, half = which[plain], np.ldexp(1.0, -ring[plain])[:, None]
        origin = self.origin[own] + self.size[own] * self._form.ends[self._corner[own]] * (1 - half)
        there = x.parts(self._cell[1, own], origin, self.size[own] * half)
        found[plain] = np.abs(there - self.values[own][:, None]).max(axis=(1, 2), initial=0)
        return found


class Column:
    """The column of a channel on the cells of an overlay."""

    def __init__(self, cells: Overlay) -> None:
        self._cells, self.form = cells, cells.beyond.layers[1].form

    def of_cells(self) -> Array:
        return np.asarray(self._cells.values[:, :, 0])

    def of_rings(self, which: Array, ring: Array, found: RingCells) -> Array:
        own = self._cells.beyond.of_layer(1, which, ring).points[..., 0]
        return np.asarray(own + self.at_corners(which)[:, None, None])

    def at_corners(self, which: Array) -> Array:
        return np.asarray(self._cells.beyond.values[which, 0])

    def reach(self, which: Array, ring: Array) -> Array:
        return np.asarray(self._cells.beyond.reach(which, ring))


def _layer(surface: LimitSurface, values: Array, workers: int) -> _Layer:
    """The cells of values (n_vertices,) that are subdivided as the points of a surface are."""
    topology = surface.topology
    faces = np.arange(len(surface.limit_faces))
    depth = RINGS - (surface.limit_faces.corner >= 0)
    known = topology.patches, topology.rules.scheme, values[:, None], faces, depth
    found = cut(*known, False, one_by_one(workers))
    form = Form.of(topology.lattice, found.degree)
    own = found.points.reshape(len(found), form.size, 1)
    rest = found.rest
    return _Layer(
        form, found.face, found.origin, found.size, own,
        rest.face, rest.origin, rest.size, Beyond(*known),
    )  # fmt: skip


def _pairs(one: Array, two: Array) -> list[Array]:
    """All pairs of numbers of what is on the same limit faces, (n,) each."""
    order = np.argsort(two, kind="stable")
    low, high = (np.searchsorted(two[order], one, side=side) for side in ("left", "right"))
    each = high - low
    first = np.repeat(np.arange(len(one)), each)
    step = np.arange(len(first)) - np.repeat(np.cumsum(each) - each, each)
    return [first, order[low[first] + step]]


def _holding(layer: _Layer, face: Array, at: Array) -> Array:
    """The cells that hold places (n, 2) on limit faces."""
    place, cell = _pairs(face, layer.face)
    s, t = ((at[place] - layer.origin[cell]) / layer.size[cell]).T
    inside = (s >= 0) & (t >= 0)
    if bernstein.is_tensor(layer.form.exponents):
        inside &= (s <= 1) & (t <= 1)
    else:
        inside &= s + t <= 1
    found = np.full(len(face), -1)
    found[place[inside]] = cell[inside]
    return found
