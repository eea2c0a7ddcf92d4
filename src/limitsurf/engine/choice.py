"""Which engine answers: the one place that decides."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Literal, TypeAlias, get_args

from limitsurf import _kernels
from limitsurf.caching import cached_property
from limitsurf.cage.mesh import Mesh
from limitsurf.engine.compiled import Compiled
from limitsurf.engine.protocol import Engine, Order, Request
from limitsurf.engine.reference import Reference
from limitsurf.engine.topology import Topology

Choice: TypeAlias = Literal["auto", "reference", "compiled"]
VARIABLE = "LIMITSURF_ENGINE"


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

    def quick(self, orders: Sequence[Order]) -> Compiled | None:
        """Kernels, if these are who `engine` would ask for one query in float64, and know all."""
        choice = self._choice
        if choice == "reference" or (choice == "auto" and not _kernels.pays(1)):
            return None
        return self.compiled if self.compiled.knows(orders, False) else None

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
