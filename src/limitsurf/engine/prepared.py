"""Points prepared for compiled kernels, together with their patches; evaluated in chunks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limitsurf import basis
from limitsurf._kernels import blocks, evaluation, grids
from limitsurf._kernels import reference as kernels
from limitsurf.engine.packing import CHUNK, TERMS, Packing, over_chunks
from limitsurf.numbers import FLOAT64
from limitsurf.patches import REGULAR

Array = NDArray[Any]
Order = tuple[int, int]

# faces and parameters for which a grid is worth its tables of weights
_FACES, _PLACES = 16, range(4, 4097)
_NONE = np.zeros(0, dtype=np.int64)
_NORMAL = ((1, 0), (0, 1))


class Asked(NamedTuple):
    """What kernels are asked for."""

    terms: tuple[Order, ...]  # derivatives that are formed
    which: Array  # places of those that are returned, in the order of `LimitSurface.jet`
    order: int  # the highest
    normals: bool  # unit normals, from two derivatives

    @property
    def count(self) -> int:
        """Arrays that are returned."""
        return len(self.which)


@lru_cache(maxsize=256)
def asked(orders: tuple[Order, ...] | None) -> Asked:
    """Derivatives of these orders, which are among `TERMS`; None asks for unit normals instead.

    Examples
    --------
    >>> from limitsurf.engine.prepared import asked
    >>> asked(((0, 0), (1, 1))).which.tolist()
    [0, 4]
    """
    terms = _NORMAL if orders is None else orders
    places = [1] if orders is None else [TERMS.index(nu) for nu in orders]
    return Asked(terms, np.array(places, dtype=np.int64), max(map(sum, terms)), orders is None)


class Prepared:
    """What is evaluated: patches and tables of a `packing`, and points of the cage (n, d)."""

    def __init__(self, packing: Packing, points: Array) -> None:
        self._packing, self.channels = packing, points.shape[1]
        self._block = blocks.Block(packing.patches, packing.tables, packing.points(points))
        # what a single query needs, at hand
        self._words, self._kernel = self._block.words, packing.shape.scattered
        self._n_faces, self._free = packing.patches.n_faces, packing.free
        self._room = evaluation.Room.size(packing.tables)

    def one(
        self, face: int, u: float, v: float, orders: tuple[Order, ...] | None
    ) -> Array | None:
        """Derivatives, or normals, at one place, (count, 1, d); `orders` as in `asked`.

        None if it is out of range, or left to the reference.
        """
        if not 0 <= face < self._n_faces:
            return None
        try:
            room = self._free.pop()
        except IndexError:
            room = np.empty(self._room + 4)
        room[-4], room[-3], room[-2] = face, u, v
        _, which, order, normals = asked(orders)
        out = np.empty((len(which), 1, self.channels))
        left = self._kernel(room, 1, self._words, order, which, normals, out, 0)
        self._free.append(room)
        return None if left else out

    def evaluate(
        self,
        queries: tuple[Array, Array, Array],
        orders: tuple[Order, ...] | None,
        workers: int,
        out: Sequence[Array] | None = None,
    ) -> tuple[Sequence[Array], Array] | None:
        """Derivatives, or normals, (Q, d) each, and which queries are left to the reference.

        Orders are as in `asked`. The queries are faces, u and v of one shape; results are written to `out`, if it is given:
        contiguous arrays. Returns None if a query is out of range.
        """
        given = asked(orders)
        grid = _grid(queries) if queries[0].ndim > 1 else None
        if grid is not None:
            found = self._gridded(grid, given, workers, out)
            if found is not None:
                results, rest = found
                face, place = np.divmod(rest, grid[1].size)
                some = grid[0][face], grid[1][place], grid[2][place]
                again = self._scattered(some, given, workers, None)
                if again is None:
                    return None
                for result, part in zip(results, again[0], strict=True):
                    result[rest] = part
                return results, rest[again[1]]
        return self._scattered(queries, given, workers, out)

    def _scattered(
        self,
        queries: tuple[Array, Array, Array],
        given: Asked,
        workers: int,
        out: Sequence[Array] | None,
    ) -> tuple[Sequence[Array], Array] | None:
        """Derivatives, or normals, each query by itself."""
        total, size = queries[0].size, self._room
        results, joint = self._results(given, total, out)

        def work(part: slice) -> Array | None:
            n = part.stop - part.start
            room = np.empty(size + 4 * n)
            if n == total:
                places = room[size : size + 3 * n].reshape(3, *queries[0].shape)
                places[0], places[1], places[2] = queries
            else:
                places = room[size:].reshape(4, n)
                for place, x in zip(places, queries, strict=False):
                    # (an iterator of its own for each thread)
                    place[:] = (x.reshape(-1) if x.flags.c_contiguous else x.flat)[part]
            into, start = (joint, part.start) if joint is not None else (
                np.empty((given.count, n, self.channels)), 0
            )  # fmt: skip
            left = self._kernel(
                room, n, self._words, given.order, given.which, given.normals, into, start
            )
            if joint is None:
                for result, found in zip(results, into, strict=True):
                    result[part] = found
            return _rest(room[-n:], left, part.start - start)

        chunk = CHUNK if joint is not None else CHUNK >> 3
        if total <= chunk:
            rest = work(slice(0, total))
        else:
            rest = _joined(over_chunks(total, workers, work, chunk))
        return None if rest is None else (results, rest)

    def _results(
        self, given: Asked, total: int, out: Sequence[Array] | None
    ) -> tuple[Sequence[Array], Array | None]:
        """Arrays (total, d) of results, and one array of all of them, if there is one."""
        shape = given.count, total, self.channels
        if out is None:
            made = np.empty(shape)
            return made, made
        if len(out) == 1:
            return out, out[0].reshape(shape)
        # those of an earlier answer, or parts of one array, lie one behind the other
        first, *more = (x.ctypes.data for x in out)
        if more == [first + k * out[0].nbytes for k in range(1, len(out))]:
            strides = out[0].nbytes, *out[0].strides
            return out, np.lib.stride_tricks.as_strided(out[0], shape, strides)
        return out, None

    def _gridded(
        self,
        grid: tuple[Array, Array, Array],
        given: Asked,
        workers: int,
        out: Sequence[Array] | None,
    ) -> tuple[Sequence[Array], Array] | None:
        """Derivatives, or normals, at all parameters on all faces, (faces,), (places,), (places,).

        None where a face or a parameter is out of range or not finite, or results are in several
        places.
        """
        faces, u, v = grid
        inside = (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)
        packing, n = self._packing, len(u)
        if packing.lattice.sloped:
            inside &= np.maximum(u, v) - 1 + np.minimum(u, v) <= 0
        if not inside.all() or faces.min() < 0 or faces.max() >= self._n_faces:
            return None
        results, joint = self._results(given, len(faces) * n, out)
        if joint is None:
            return None
        terms = given.terms
        weights = self._grid_weights(packing.patches.info[faces], u, v, terms)
        position = terms.index((0, 0)) if (0, 0) in terms else -1

        def work(part: slice) -> Array | None:
            face = np.array(faces[part], dtype=np.int64)
            rest = np.empty(len(face) * n, dtype=np.int64)
            room = np.empty(64), np.empty((6, 3, weights.places))
            left = packing.shape.gridded(
                face, self._words, *weights, len(terms), n, position, given.normals, joint,
                part.start, rest, *room,
            )  # fmt: skip
            return None if left < 0 else rest[:left]

        rest = _joined(over_chunks(len(faces), workers, work, max(1, CHUNK // n)))
        return None if rest is None else (results, rest)

    def _grid_weights(
        self, codes: Array, u: Array, v: Array, terms: Sequence[Order]
    ) -> grids.Weights:
        """Weights for derivatives at parameters, for kinds and turns of these packed patches."""
        kinds = self._packing.tables.kinds
        places = -(-len(u) // grids.PLACES) * grids.PLACES
        start = np.full((len(kinds), 4), -1)
        parts, at = [np.zeros(0)], 0
        there = np.bincount((codes[codes >= 0] >> evaluation.TURN) & ~np.int64(8))
        for both in np.flatnonzero(there).tolist():
            kind, turn = both >> (evaluation.KIND - evaluation.TURN), both & evaluation.TURNS
            if kind == REGULAR:
                size = self._packing.shape.POINTS
                weights_of = basis.regular_weights(self._packing.spline, FLOAT64)
                rows = [weights_of(u, v, nu) for nu in terms]
            elif kinds[kind, evaluation.MODES] >= 0:
                size = int(kinds[kind, evaluation.ROWS])
                found = self._eigen_weights(kind, turn, u, v, terms)
                if found is None:
                    continue
                rows = found
            else:
                continue
            table = np.zeros((len(terms), size, places))
            for k, weights in enumerate(rows):
                table[k, : weights.shape[1], : len(u)] = weights.T
            start[kind, turn] = at
            at += table.size
            parts.append(table.reshape(-1))
        return grids.Weights(start, np.concatenate(parts), places)

    def _eigen_weights(
        self, kind: int, turn: int, u: Array, v: Array, terms: Sequence[Order]
    ) -> list[Array] | None:
        """Weights (places, K - 1) of coefficients in each derivative; None where they overflow."""
        table = self._packing.sectors[kind]
        assert table is not None
        lattice = table.sector.lattice
        sides = kernels.coordinates(u, v, lattice.sides)
        s, t = sides[turn], sides[(turn + 1) % len(sides)]
        place = basis.CornerPlace.of(s, t, np.full(len(u), turn), lattice)
        powers = basis.EigenPowers.of(table, place)
        rows = []
        for nu in terms:
            parts = []
            for order, factors in lattice.turned(nu).items():
                if factors[turn]:
                    found = basis.eigen_weights(table, place, powers, order)
                    if np.abs(found.exponent).max() > 900:
                        return None
                    scaled = kernels.scale_by_two(found.rows, found.exponent[:, None])
                    parts.append(factors[turn] * scaled)
            rows.append(parts[0] if len(parts) == 1 else np.sum(parts, axis=0))
        return rows


def _rest(room: Array, left: int, start: int) -> Array | None:
    """Numbers of the queries that a kernel left to others; None if one is out of range."""
    if left <= 0:
        return None if left else _NONE
    return room[:left].view(np.int64) + start


def _joined(parts: Iterable[Array | None]) -> Array | None:
    """Queries that all chunks leave to others; None if one has a query out of range."""
    found = list(parts)
    if any(part is None for part in found):
        return None
    return np.concatenate([_NONE, *(x for x in found if x is not None)])


def _grid(queries: tuple[Array, Array, Array]) -> tuple[Array, Array, Array] | None:
    """Faces (F,) and parameters (n,), two, if queries are all of these at all of those.

    Broadcasting tells: along the first axes only faces vary, along the others only parameters.
    """
    face, u, v = queries
    for axis in range(1, face.ndim if face.size else 0):
        before, after = range(axis), range(axis, face.ndim)
        if all(face.shape[k] == 1 or u.strides[k] == v.strides[k] == 0 for k in before) and all(
            face.shape[k] == 1 or face.strides[k] == 0 for k in after
        ):
            faces = face[(slice(None),) * axis + (0,) * len(after)].reshape(-1)
            u, v = (np.array(x[(0,) * axis].reshape(-1), dtype=float) for x in (u, v))
            return (faces, u, v) if len(faces) >= _FACES and len(u) in _PLACES else None
    return None


