"""Control points around corners of many faces, isolated as far as queries of kernels have asked.

Each level costs as much as all patches around these corners, and most queries need the first ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import _kernels, basis
from limitsurf.engine.kinds import Rings
from limitsurf.engine.packing import LEVELS, Packing, ring_rows
from limitsurf.engine.protocol import Request
from limitsurf.engine.topology import Topology
from limitsurf.values import Values

if TYPE_CHECKING:
    from limitsurf.patches import SharedRings
    from limitsurf.rings import RingValues

Array = NDArray[Any]


class Isolated:
    """What kernels evaluate, of some points: with more levels whenever queries need them.

    Attributes
    ----------
    words : ndarray
        A block of patches, tables and points.
    points : Points
    """

    def __init__(self, topology: Topology, points: Array) -> None:
        from limitsurf._kernels.evaluation import block

        self._topology, packing = topology, topology.packing
        self.points = packing.points(points)
        self._kinds = packing.tables.kinds.copy()  # which say what is there
        tables = packing.tables._replace(kinds=self._kinds)
        self._block = block(packing.patches, tables, self.points)
        self.words: Array = self._block.words
        self._levels: dict[int, Iterator[tuple[Array, Array, Array]]] = {}

    def add(self, request: Request, values: Values) -> bool:
        """Have what flat queries need that are in range; whether that is more than before."""
        from limitsurf._kernels.evaluation import FACES, READY

        around = (self._kinds[:, FACES] > 0) & (self._kinds[:, READY] < LEVELS)
        rings = np.flatnonzero(around).tolist()
        if not rings:
            return False
        patches, more = self._topology.patches, False
        patch, s, t, *_ = patches.locate(request.face.astype(np.int64), request.u, request.v)
        own = self._topology.packing.cover.kind[patch]
        for kind in rings:
            here = np.flatnonzero((own == kind) & (patch >= 0))
            if len(here):
                turn = patches.turn[patch[here]].astype(np.int64)
                place = basis.CornerPlace.of(s[here], t[here], turn, patches.lattice)
                kept = place.level[place.level < LEVELS]
                with _kernels.preparing:
                    more |= self._extend(kind, int(kept.max(initial=0)) + 1, values)
        return more

    def _extend(self, kind: int, levels: int, values: Values) -> bool:
        """Have control points around shared rings of a kind for so many levels."""
        from limitsurf._kernels.evaluation import READY

        if self._kinds[kind, READY] >= levels:
            return False
        found = self._topology.groups.kinds[kind]
        assert isinstance(found, Rings)
        around, start = found.around(values), int(self._kinds[kind, READY])
        spread = _Spread(self._topology.packing, kind, found.shared, self.points.fine)
        if start == 0:
            spread.vertices(around)
            self._levels[kind] = around.levels()
        for level in range(start, levels):
            spread.level(level, *next(self._levels[kind]))
            self._kinds[kind, READY] = level + 1  # (kernels may be reading it)
        if levels == LEVELS:
            del self._levels[kind]
        return True


class _Spread:
    """Where control points around shared rings of a kind are written."""

    def __init__(self, packing: Packing, kind: int, rings: SharedRings, fine: Array) -> None:
        from limitsurf._kernels.evaluation import FACES, HEAD, PATCH

        self._shape, self._rings = packing.shape, rings
        self._faces, first = packing.tables.kinds[kind, [FACES, PATCH]].tolist()
        count, self._start = len(rings.points), HEAD * (LEVELS + 1)
        own = fine[first : first + count * ring_rows(self._shape, self._faces)]
        self._own = own.reshape(count, -1, fine.shape[1])
        self._heads = self._own[:, : self._start].reshape(count, LEVELS + 1, HEAD, -1)

    def vertices(self, values: RingValues) -> None:
        """Write what comes before all levels."""
        high, low, limit = values.vertices
        d = high.shape[1]
        self._heads[:, :, 0, :d] = (low + limit)[:, None]
        self._heads[:, :, 1, :d] = high[:, None]

    def level(self, level: int, points: Array, after: Array, size: Array) -> None:
        """Write a level of `RingValues.levels`."""
        shape, rings, d = self._shape, self._rings, points.shape[-1]
        self._heads[:, level + 1, 0, :d] -= after
        # rows that refine have sums of at most 3, where points are reflected
        self._heads[:, level + 1, 2, 0] = 3 * size
        j, i = np.nonzero(shape.PLACES >= 0)
        blocks = shape.BLOCK * np.asarray(rings.position)[:, None] + shape.PLACES[j, i]
        rows = np.zeros((len(blocks), 5, 5, self._own.shape[2]))
        rows[..., :d] = points
        whole = np.dtype((np.void, rows[0, 0, 0].nbytes))  # (as one, they are copied faster)
        kept, found = self._own.view(whole)[..., 0], rows.view(whole)[..., 0]
        start = self._start + level * shape.BLOCK * (self._faces + 3)
        kept[rings.ring[:, None], start + blocks] = found[:, j, i]
