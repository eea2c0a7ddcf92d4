"""Several halvings at once, under schemes that keep vertices: products of local matrices."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.refine.local_steps import LocalSteps
from limitsurf.refine.neighbourhoods import REGULAR

Array = NDArray[Any]

MIDDLE = 3  # the child that is turned by half a turn


class Operations:
    """Several steps at once, by number: row, matrix, and factors of positions and derivatives."""

    def __init__(self, steps: LocalSteps) -> None:
        self.steps = steps
        self.packed: Any = None  # the same for kernels
        self.known: list[tuple[Array, Array, Any, int]] = []
        self._numbers: dict[tuple[int, ...], int] = {}
        if not steps.number.exact:
            one = [self._single(REGULAR, c) for c in range(4)]
            two = [_product(a, b) for a in one for b in one]
            self.known += [_product(a, b) for a in two for b in one]

    def width(self, operation: Array) -> int:
        """The most columns of those that are met."""
        codes = np.unique(operation[operation >= 0]).tolist()
        return max((self.known[code][1].shape[1] for code in codes), default=0)

    def regular(self, first: Array, second: Array, third: Array) -> Array:
        """Three steps to these children amid regular vertices."""
        found: Array = 16 * first + 4 * second + third
        return found

    def _single(self, kind: int, c: int) -> tuple[Array, Array, Any, int]:
        g, C = self.steps.step(kind, c)
        return g, C, self.steps.number.one / 2, -1 if c == MIDDLE else 1

    def single(self, kind: int, c: int) -> int:
        """One step."""
        return self._named((kind, c), lambda: self._single(kind, c))

    def run(self, kind: int, k: int, j: int) -> int:
        """2^j steps towards a corner, whose children are of the same kind."""
        return self._named((kind, k, j), lambda: self._powers(kind, k, j))

    def _powers(self, kind: int, k: int, j: int) -> tuple[Array, Array, Any, int]:
        # rounding errors grow with the number of steps: with some more digits, where there are any
        g, C, scale, sign = self._single(kind, k)
        found = g.astype(np.longdouble), C.astype(np.longdouble), np.longdouble(scale), sign
        for _ in range(j):
            found = _product(found, found)
        return found[0].astype(float), found[1].astype(float), float(found[2]), sign

    def _named(self, key: tuple[int, ...], make: Callable[[], Any]) -> int:
        if key not in self._numbers:
            with self.steps.kinds.lock:
                if key not in self._numbers:
                    self.known.append(make())
                    self._numbers[key] = len(self.known) - 1
        return self._numbers[key]


def _product(
    first: tuple[Array, Array, Any, int], then: tuple[Array, Array, Any, int]
) -> tuple[Array, Array, Any, int]:
    """Some steps, and then others."""
    (g, C, scale, sign), (h, D, factor, other) = first, then
    return g + scale * (h @ C), D @ C, scale * factor, sign * other


def operations_of(steps: LocalSteps) -> Operations:
    """The operations of some steps, made once."""
    if steps.operations is None:
        with steps.kinds.lock:
            if steps.operations is None:
                steps.operations = Operations(steps)
    found: Operations = steps.operations
    return found
