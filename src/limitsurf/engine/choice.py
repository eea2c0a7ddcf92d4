"""Which engine answers: the one place that decides."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from limitsurf import _kernels
from limitsurf.caching import cached_property
from limitsurf.cage.mesh import Mesh
from limitsurf.engine.compiled import Compiled
from limitsurf.engine.protocol import Engine, Order, Request
from limitsurf.engine.reference import Reference
from limitsurf.engine.topology import Topology

Array = NDArray[Any]
Choice: TypeAlias = Literal["auto", "reference", "compiled"]
VARIABLE = "LIMITSURF_ENGINE"

# types of plain numbers
_WHOLE, _REAL = {int, np.int64}, {float, np.float64}
_FAR = 1 << 62  # no integers of other types before


def chosen(engine: str | None) -> Choice:
    """The choice that an argument, or where it is None the environment, makes.

    Examples
    --------
    >>> from limitsurf.engine.choice import chosen
    >>> chosen("reference")
    'reference'
    """
    known, given, name = get_args(Choice), engine, "engine"
    if given is None:
        given, name = os.environ.get(VARIABLE) or "auto", f"the environment variable {VARIABLE}"
    for choice in known:
        if given == choice:
            found: Choice = choice
            return found
    raise ValueError(f"{name} must be one of {', '.join(map(repr, known))}, got {given!r}")


class Answers:
    """Both engines for the points of `mesh`, and which of them is asked."""

    def __init__(self, topology: Topology, mesh: Mesh, choice: Choice) -> None:
        self._topology, self._mesh, self._choice = topology, mesh, choice

    @cached_property
    def reference(self) -> Reference:
        """NumPy in float64."""
        return Reference(self._topology, self._mesh, False)

    @cached_property
    def exact(self) -> Reference:
        """NumPy in Fractions."""
        return Reference(self._topology, self._mesh, True)

    @cached_property
    def compiled(self) -> Compiled:
        """Kernels."""
        return Compiled(self._topology, self.reference)

    def one(
        self, face: Any, u: Any, v: Any, orders: tuple[Order, ...] | None, workers: Any
    ) -> Sequence[Array] | None:
        """Derivatives (1, d) of these orders, or the normal for None, at a place in plain numbers.

        Points are in float64. None if it is not in plain numbers, or `workers` are asked for: the
        call is as any other then.
        """
        if type(u) not in _REAL or type(v) not in _REAL or type(face) not in _WHOLE:
            return None
        if type(workers) is not int or workers != 1 or not 0 <= face < _FAR:
            return None
        if self._choice == "compiled" or (self._choice == "auto" and _kernels.pays(1)):
            kernels = self.compiled
            if kernels.knows(orders or (), False):
                found: Any = kernels.one(face, u, v, orders)
                if found is not None:
                    known: Sequence[Array] = found
                    return known
        request = Request(np.asarray(face), np.asarray(u), np.asarray(v), False, 1)
        engine = self.engine(request, orders or ())
        if orders is None:
            return [engine.normals(request)]
        return engine.derivatives(request, orders)

    def engine(
        self, request: Request, orders: Sequence[Order] = (), weights: bool = False
    ) -> Engine:
        """Who answers a request for derivatives of these orders or their weights, or what else.

        Kernels where they can, unless "reference" is chosen, or "auto" and the call is small. That
        depends on the call alone: equal calls have equal answers, to the last digit.
        """
        if request.exact:
            return self.exact
        choice = self._choice
        if choice == "reference" or (choice == "auto" and not _kernels.pays(request.face.size)):
            return self.reference
        return self.compiled if self.compiled.knows(orders, weights) else self.reference
