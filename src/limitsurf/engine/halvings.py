"""Rows of weights under schemes that keep vertices, by kernels: tables of steps, as they are met.

What is in them is what `Operations` and `LocalSteps` say, packed into flat arrays.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import _kernels
from limitsurf.refine.neighbourhoods import FRAMES

if TYPE_CHECKING:
    from limitsurf._kernels.stepwise import Steps
    from limitsurf.engine.interpolating import FirstStep, Operations

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


class Halvings:
    """Steps of a scheme as kernels want them; they only ever become more."""

    def __init__(self, operations: Operations) -> None:
        with _kernels.preparing:
            self._kernels = _kernels.searching("stepwise")
        self._operations, self._local = operations, operations.steps
        self._lock = self._local.kinds.lock
        self._parts: list[Array] = []
        self._length = self._packed = 0
        self._shapes: list[tuple[int, int, int]] = []
        self._factors: list[tuple[float, float]] = []
        none = np.full
        self._tables = [
            none((0, 4), -1), none((0, 4), -1), none((0, 3, self._kernels.LONGEST), -1),
            none((3, 0, 3), -1), none(0, 0), none(0, -1),
        ]  # fmt: skip
        with self._lock:
            self._known, self._width = self._snapshot()

    def rows(
        self, first: FirstStep, face: Array, u: Array, v: Array, axes: Array, type_: str
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

    def _add(self, first: FirstStep, missing: Array, type_: str) -> None:
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
                    self._tables[3][ROWS.index(type_), kind, corner] = self._put(rows)
            self._known, self._width = self._snapshot()

    def _put(self, *values: Array) -> int:
        """Append values; where they begin."""
        begin = self._length
        for each in values:
            self._parts.append(np.ravel(each).astype(float))
            self._length += each.size
        return begin

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
                self._tables[5][kind] = self._put(one.places[3:])
        for g, C, scale, sign in self._operations.known[len(self._shapes) :]:
            rows = np.concatenate([g[None], C])
            more = -rows.shape[1] % self._kernels.EIGHT
            self._shapes.append((*C.shape, self._put(np.pad(rows, ((0, 0), (0, more))))))
            self._factors.append((float(scale), float(sign)))
        self._parts = [np.concatenate(self._parts)]
        tables = [table.copy() for table in self._tables]
        shapes, factors = np.array(self._shapes), np.array(self._factors)
        steps = self._kernels.Steps(*tables, shapes, factors, self._parts[0])
        each = self._kernels.EIGHT
        return steps, -(-int(tables[4].max(initial=0)) // each) * each


def halvings_of(operations: Operations) -> Halvings:
    """The tables for some operations, made once."""
    with operations.steps.kinds.lock:
        if operations.packed is None:
            operations.packed = Halvings(operations)
        found: Halvings = operations.packed
        return found
