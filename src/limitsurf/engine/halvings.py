"""Tables of steps for kernels, as they are met: under schemes that are evaluated by steps.

What is in them is what `Operations` and `LocalSteps` say, or the kinds of ``ternary.py``, packed
into flat arrays.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from limitsurf import _kernels
from limitsurf.refine.neighbourhoods import FRAMES

if TYPE_CHECKING:
    from limitsurf._kernels.stepwise import Steps
    from limitsurf.engine.operations import Operations
    from limitsurf.engine.ternary import Descent, Kinds

Array = NDArray[Any]

ROWS = "derivatives", "tangents", "normal"  # of `CornerRows`, in the order of kernels
_QUERY, _CALL = 1e-5, 1e-3  # seconds that NumPy takes for one, and for a call


def kernels_for(choice: str, queries: int) -> bool:
    """Whether kernels answer so many queries."""
    if choice == "reference" or not _kernels.compiles():
        return False
    if choice == "compiled":
        return _kernels.load()
    return _kernels.answer(_kernels.STEPWISE, _CALL + queries * _QUERY)


class Children(Protocol):
    """The triangles after a step; `triangles` (n, 2) has kinds, -1 where they are not known yet."""

    triangles: Array

    def kinds_of(self, corner: Array) -> tuple[Array, Array]:
        """Find out kinds, and where points begin, of triangles by a corner each."""
        ...


class Store:
    """Matrices one behind the other, each below a row, filled up to what kernels take at once."""

    def __init__(self, each: int) -> None:
        self._each, self._parts, self.length = each, list[Array](), 0
        self._shapes: list[tuple[int, ...]] = []
        self._factors: list[tuple[float, float]] = []

    def __len__(self) -> int:
        return len(self._shapes)

    def put(self, values: Array) -> int:
        """Append values; where they begin."""
        self._parts.append(np.ravel(values).astype(float))
        self.length += values.size
        return self.length - values.size

    def add(self, row: Array, matrix: Array, scale: float = 1.0, sign: float = 1.0) -> int:
        """Append an operation; its number."""
        both = np.concatenate([row[None], matrix])
        begin = self.put(np.pad(both, ((0, 0), (0, -both.shape[1] % self._each))))
        self._shapes.append((*matrix.shape, begin))
        self._factors.append((float(scale), float(sign)))
        return len(self._shapes) - 1

    def arrays(self) -> tuple[Array, Array, Array]:
        """Shapes, factors and values, which stay as they are."""
        self._parts = [np.concatenate([*self._parts, np.zeros(0)])]
        shapes = np.array(self._shapes, dtype=np.int64).reshape(-1, 3)
        return shapes, np.array(self._factors).reshape(-1, 2), self._parts[0]

    @property
    def width(self) -> int:
        """Room for the largest row."""
        most = max((max(shape[:2]) for shape in self._shapes), default=0)
        return -(-most // self._each) * self._each


class Halvings:
    """Steps of a scheme as kernels want them; they only ever become more."""

    def __init__(self, operations: Operations) -> None:
        with _kernels.preparing:
            self._kernels = _kernels.searching("stepwise")
        self._operations, self._local = operations, operations.steps
        self._lock = self._local.kinds.lock
        self._store = Store(self._kernels.EIGHT)
        none = np.full
        self._tables = [
            none((0, 4), -1), none((0, 4), -1), none((0, 3, self._kernels.LONGEST), -1),
            none((3, 0, 3), -1), none(0, 0), none(0, -1),
        ]  # fmt: skip
        with self._lock:
            self._known, self._width = self._snapshot()

    def rows(
        self, first: Children, face: Array, u: Array, v: Array, axes: Array, type_: str
    ) -> tuple[Array, Array, Array]:
        """Rows (Q, axes, n), and kinds and beginnings of the first triangles (Q,)."""
        Q, which = len(face), np.arange(len(face))
        found = np.empty((Q, 4), dtype=np.int64)
        stack = np.empty(self._kernels.STACK, dtype=np.int64)
        out, asked = np.empty((Q, len(axes), 0)), (axes, ROWS.index(type_))
        while len(which):
            steps, width = self._known, self._width
            if out.shape[2] < width:
                wider = np.zeros((Q, len(axes), width))
                wider[:, :, : out.shape[2]] = out
                out = wider
            room = stack, np.empty(width * len(axes)), np.empty((1, len(axes), width))
            given = which, face, u, v, first.triangles, FRAMES, steps, asked, room
            self._kernels.weighted(*given, out, found)
            which = which[found[which, 0] != 0]
            if len(which):
                self._add(first, np.unique(found[which], axis=0), type_)
        return out, found[:, 1], found[:, 2]

    def counts(self, kinds: Array) -> Array:
        """Numbers of points of some kinds."""
        found: Array = self._known.sizes[kinds] + 1
        return found

    def _add(self, first: Children, missing: Array, type_: str) -> None:
        """Find out what kernels have asked for."""
        k, local = self._kernels, self._local
        corners = missing[missing[:, 0] == k.FIRST, 1]
        if len(corners):
            first.kinds_of(corners)
        with self._lock:
            self._grown()
            for what, kind, corner, j in missing.tolist():
                if what == k.CHILDREN and self._tables[0][kind, 0] < 0:
                    for c in range(4):
                        self._operations.single(kind, c)
                    self._grown()
                    for c in range(4):
                        self._tables[0][kind, c] = local.child(kind, c)
                        self._tables[1][kind, c] = self._operations.single(kind, c)
                elif what == k.RUN:
                    self._tables[2][kind, corner, j] = self._operations.run(kind, corner, j)
                elif what == k.END:
                    rows = getattr(local.corner(kind, corner), type_)
                    self._grown()
                    self._tables[3][ROWS.index(type_), kind, corner] = self._store.put(rows)
            self._known, self._width = self._snapshot()

    def _grown(self) -> None:
        """Make room for all kinds that there are, and say how large they are."""
        known, old = self._local.kinds.known, len(self._tables[4])
        more = len(known) - old
        for t, table in enumerate(self._tables):
            axis = 1 if t == 3 else 0
            shape = list(table.shape)
            shape[axis] = more
            self._tables[t] = np.concatenate([table, np.full(shape, -1)], axis=axis)
        self._tables[4][old:] = [kind.n_points - 1 for kind in known[old:]]

    def _snapshot(self) -> tuple[Steps, int]:
        """What is known now, in arrays of its own, and room for the largest size of all."""
        self._grown()
        kinds = self._local.kinds
        for kind in np.flatnonzero((self._tables[5] < 0) & (self._tables[0][:, 0] >= 0)).tolist():
            one = kinds.known[kind]
            if one.affine and one.places is not None:
                self._tables[5][kind] = self._store.put(one.places[3:])
        for operation in self._operations.known[len(self._store) :]:
            self._store.add(*operation)
        tables = [table.copy() for table in self._tables]
        steps = self._kernels.Steps(*tables, *self._store.arrays())
        each = self._kernels.EIGHT
        return steps, -(-int(tables[4].max(initial=0)) // each) * each


def halvings_of(operations: Operations) -> Halvings:
    """The tables for some operations, made once."""
    with operations.steps.kinds.lock:
        if operations.packed is None:
            operations.packed = Halvings(operations)
        found: Halvings = operations.packed
        return found


class Ascents:
    """Maps of parts of triangles under schemes that cut these into nine, as kernels want them."""

    def __init__(self, kinds: Kinds) -> None:
        with _kernels.preparing:
            self._kernels = _kernels.searching("stepwise")
        self._kinds, self._store = kinds, Store(self._kernels.EIGHT)
        self._codes = np.full((0, 9), -1)
        self._words = np.array(
            [[self._store.add(*kinds.word(9 * a + b)[::-1]) for b in range(9)] for a in range(9)]
        )
        self._maps: Any = None

    def ascend(self, descent: Descent, weights: Array, constant: Array) -> Array:
        """As `Kinds.ascend`."""
        if not descent.kinds:
            return weights
        kinds, parts = np.stack(descent.kinds), np.stack(descent.parts)
        self._look_at(kinds, parts)
        axes = np.where(constant == 1, -1, 0)
        width = max(self._store.width, weights.shape[2])
        room = np.empty(width * len(axes)), np.empty((1, len(axes), width))
        found = np.ascontiguousarray(weights)
        self._kernels.ascended(kinds, parts, self._maps, axes, room, found)
        return found

    def _look_at(self, kinds: Array, parts: Array) -> None:
        """Have the maps of all steps."""
        if len(self._codes) < len(self._kinds.known):
            more = len(self._kinds.known) - len(self._codes)
            self._codes = np.concatenate([self._codes, np.full((more, 9), -1)])
            self._maps = None
        unknown = (kinds >= 0) & (self._codes[kinds, parts] < 0)
        if unknown.any():
            for code in np.unique(9 * kinds[unknown] + parts[unknown]).tolist():
                own, shift = self._kinds.map(*divmod(code, 9))
                self._codes[divmod(code, 9)] = self._store.add(shift, own)
            self._maps = None
        if self._maps is None:
            maps = self._codes.copy(), self._words, *self._store.arrays()
            self._maps = self._kernels.Maps(*maps)


def ascents_of(kinds: Kinds) -> Ascents:
    """The maps for some kinds, made once."""
    if kinds.packed is None:
        kinds.packed = Ascents(kinds)
    found: Ascents = kinds.packed
    return found
