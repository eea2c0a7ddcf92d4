"""Rings around special corners one after the other, as deep as is asked: what cells end before."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import basis, rings, tables
from limitsurf.numbers import FLOAT64
from limitsurf.patches import STRIP, PatchTable
from limitsurf.pieces import bernstein, weights
from limitsurf.pieces.cover import Cover
from limitsurf.pieces.points import FloatPoints

if TYPE_CHECKING:
    from limitsurf.scheme.scheme import Scheme

Array = NDArray[Any]

_EPS = np.finfo(float).eps


@dataclass(frozen=True, eq=False)
class RingCells:
    """The cells of one ring around each of M corners, c to a ring.

    Attributes
    ----------
    points : (M, c, n, d)
        Bernstein coefficients relative to the limit of the corner, by u and v of the limit face.
    origin, size : (M, c, 2)
        Where they lie in what remains, as the cells of `BezierRest` do in limit faces.
    """

    points: Array
    origin: Array
    size: Array


class Beyond:
    """What remains of limit faces at special corners, in the order of `BezierRest`.

    Parameters
    ----------
    patches : PatchTable
    scheme : Scheme
    points : (n_vertices, d) float64
    faces : (F,) int
    depth : (F,) int
        As `rings` of `cut`.

    Attributes
    ----------
    limits : (R, d)
        The limits of the corners.
    """

    def __init__(
        self, patches: PatchTable, scheme: Scheme, points: Array, faces: Array, depth: Array
    ) -> None:
        covered = Cover.of(patches, faces)
        kind = patches.kind[covered.patch]
        special = np.flatnonzero(kind > STRIP)
        patch = covered.patch[special]
        self._kind, self._row = kind[special], patches.row[patch]
        self._turn = patches.turn[patch].astype(np.int64)
        self._start = np.maximum(depth[covered.owner[special]] - covered.level[special], 0)
        self._local = weights.LocalWeights(patches, scheme, FLOAT64)
        self._source = FloatPoints(self._local, points)
        self._lattice, self._patches = scheme.lattice, patches
        self._modes: dict[int, Array] = {}
        self._tables: dict[int, tables.EigenTable] = {}
        self._place = np.zeros(len(special), dtype=np.int64)
        self.limits = np.zeros((len(special), points.shape[1]))
        self._functions: dict[tuple[int, int], tuple[Array, Array]] = {}
        for one in np.unique(self._kind).tolist():
            here = np.flatnonzero(self._kind == one)
            self._begin(one, here)

    def __len__(self) -> int:
        return len(self._kind)

    def _begin(self, kind: int, here: Array) -> None:
        """Limits of corners of a kind, and what eigenfunctions are multiplied by."""
        self._place[here] = np.arange(len(here))
        rows = self._row[here]
        if kind in self._patches.rings:
            high, low = self._source.corner(kind, rows)
            self.limits[here] = high + low
            return
        table = self._table(kind)
        ids = self._patches.controls[kind][rows]
        high, low, points = self._source.values.differences(ids, 0)
        modes = table.coefficients(points)
        self.limits[here] = high + (low + modes[:, 0])
        self._modes[kind] = modes[:, 1:]

    def _table(self, kind: int) -> tables.EigenTable:
        if kind not in self._tables:
            sector = self._patches.sectors[kind]
            assert sector is not None
            self._tables[kind] = tables.eigen_table(self._local.scheme, sector)
        return self._tables[kind]

    def cells(self, which: Array, ring: Array) -> RingCells:
        """The cells of a ring (M,) of corners `which` (M,); ring 0 is the first that remains."""
        form, pieces = self._local.bernstein, self._lattice.pieces
        shape = len(which), len(pieces), form.size, self.limits.shape[1]
        points = np.empty(shape)
        refined = np.isin(self._kind[which], list(self._patches.rings))
        for kind in np.unique(self._kind[which[refined]]).tolist():
            here = np.flatnonzero(self._kind[which] == kind)
            level = self._start[which[here]] + ring[here]
            points[here] = self._source.on_ring(kind, self._row[which[here]], level)
        rest = np.flatnonzero(~refined)
        for some, kind, level in self._alike(which[rest], ring[rest]):
            here = rest[some]
            functions, _ = self._known(kind, level)
            found = np.matmul(functions, self._modes[kind][self._place[which[here]]])
            points[here] = found.reshape(len(here), *shape[1:])
        turn = self._turn[which]
        order = form.turned[turn][:, None, :, None]
        points = np.take_along_axis(points, order, axis=2)
        half = np.ldexp(1.0, -1 - ring)[:, None, None]
        sign = np.array([-1 if piece.turned else 1 for piece in pieces])[:, None]
        origin = half * np.array([piece.origin for piece in pieces])
        size = half * sign * np.ones(2)
        return RingCells(points, *bernstein.turned_cells(self._lattice, origin, size, turn))

    def reach(self, which: Array, ring: Array, toward: Array) -> tuple[Array, Array]:
        """How far the limit goes from the corner from a ring on, (M,), and along vectors, (M,).

        The latter bounds the sizes of inner products with `toward` (M, d).
        """
        far, along = np.empty((2, len(which)))
        for here, kind, level in self._alike(which, ring):
            w = toward[here]
            if kind in self._patches.rings:
                if not rings.is_convex(self._source.local.masks(kind)):
                    far[here] = along[here] = np.inf
                    continue
                rows = self._row[which[here]]
                least, most = self._source.shared(kind).extent(rows, max(level, 1))
                size = np.maximum(np.abs(least), np.abs(most))
                far[here], along[here] = np.sqrt((size**2).sum(axis=1)), (np.abs(w) * size).sum(1)
                continue
            _, most = self._known(kind, level)
            modes = self._modes[kind][self._place[which[here]]]
            far[here] = np.sqrt((modes**2).sum(axis=2)) @ most
            along[here] = np.abs(np.matmul(modes, w[:, :, None])[:, :, 0]) @ most
        return far * (1 + 1e-9), along * (1 + 1e-9)

    def spans(self, ring: int, count: int) -> tuple[Array, Array]:
        """Vectors (R, count, d), and lengths (R,), that bound all corners from a ring on.

        No more than the sizes of inner products of a vector with these, and its length times the
        last, is how far the limit goes along it; longer ones are kept, the others summed.
        """
        found = np.zeros((len(self), count, self.limits.shape[1]))
        rest, every = np.zeros(len(self)), np.arange(len(self))
        for here, kind, level in self._alike(every, np.full(len(every), ring)):
            if kind not in self._patches.rings:
                _, most = self._known(kind, level)
                own = self._modes[kind][self._place[here]] * most[:, None]
            elif rings.is_convex(self._source.local.masks(kind)):
                both = self._source.shared(kind).extent(self._row[here], max(level, 1))
                own = np.maximum(*map(np.abs, both))[:, None] * np.eye(self.limits.shape[1])
            else:
                rest[here] = np.inf
                continue
            size = np.sqrt((own**2).sum(axis=2))
            order = np.argsort(-size, axis=1)
            longer = order[:, :count]
            found[here, : longer.shape[1]] = np.take_along_axis(own, longer[:, :, None], axis=1)
            rest[here] = np.take_along_axis(size, order[:, count:], axis=1).sum(axis=1)
        return found * (1 + 1e-9), rest * (1 + 1e-9)

    def tangents(self, which: Array) -> tuple[Array, Array]:
        """Two vectors that span the tangent plane at corners, (M, d) each; 0 without one."""
        found = np.zeros((2, len(which), self.limits.shape[1]))
        for kind in np.unique(self._kind[which]).tolist():
            if kind in self._modes and len(pair := self._table(kind).normal):
                here = np.flatnonzero(self._kind[which] == kind)
                modes = self._modes[kind][self._place[which[here]]]
                found[:, here] = modes[:, pair - 1].swapaxes(0, 1)
        return found[0], found[1]

    def eigenfunctions(self) -> Iterator[tuple[Array, tables.EigenTable | None, int, Array]]:
        """Corners that are alike at a time: which (m,), their table, ring, and modes (m, K - 1, d).

        The ring is the first that remains, counted from the patch. Without a table, and modes,
        for those whose rings are refined.
        """
        every = np.arange(len(self))
        for here, kind, level in self._alike(every, np.zeros(len(self), dtype=np.int64)):
            if kind in self._patches.rings:
                yield here, None, level, np.zeros((len(here), 0, self.limits.shape[1]))
            else:
                yield here, self._table(kind), level, self._modes[kind][self._place[here]]

    def rings(self, which: Array, count: int) -> Array:
        """Coefficients (M, count, c, n, d) on the first rings that remain, of the pieces' own s, t.

        Around corners that `eigenfunctions` has no table of, which are of one kind and ring.
        """
        kind, level = int(self._kind[which[0]]), int(self._start[which[0]])
        found = self._source.on_rings(kind, self._row[which], range(level, level + count))
        return found.reshape(len(which), count, -1, *found.shape[2:])

    @property
    def is_smooth(self) -> Array:
        """Whether the faces around the corners close and are smooth there, (R,)."""
        kinds = [s is not None and s.kind == "interior" for s in self._patches.sectors]
        return np.array(kinds, dtype=bool)[self._kind]

    def corner(self, which: Array) -> Array:
        """At which corners of their cells they are, (M,)."""
        return self._turn[which]

    def interior(self, which: Array) -> Array:
        """Whether faces go all around corners, without creases, (M,)."""
        smooth = [x is not None and x.kind == "interior" for x in self._patches.sectors]
        return np.asarray(np.array(smooth)[self._kind[which]])

    def _alike(self, which: Array, ring: Array) -> Iterator[tuple[Array, int, int]]:
        """Those of a kind and a ring at a time, rings counted from the patch."""
        key = self._kind[which] * 4096 + self._start[which] + ring
        for one in np.unique(key).tolist():
            yield np.flatnonzero(key == one), one // 4096, one % 4096

    def _known(self, kind: int, level: int) -> tuple[Array, Array]:
        """Coefficients (c n, K - 1) of eigenfunctions on a ring, and bounds (K - 1,) beyond."""
        key = kind, level
        if key not in self._functions:
            table = self._table(kind)
            first = weights.ring_functions(table, 1)
            functions = basis.on_rings(table, first, np.full(len(first), level))
            self._functions[key] = functions, weights.most_beyond(table, level)
        return self._functions[key]
