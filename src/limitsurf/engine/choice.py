"""Which engine answers: the one place that decides."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf import _kernels
from limitsurf._kernels import VARIABLE as VARIABLE
from limitsurf.caching import cached_property
from limitsurf.cage.mesh import Mesh
from limitsurf.engine.compiled import PLACES, Compiled
from limitsurf.engine.interpolating import Interpolating
from limitsurf.engine.protocol import Engine, Order, Request
from limitsurf.engine.reference import Reference
from limitsurf.engine.stepwise import StepwiseTopology
from limitsurf.engine.topology import Topology
from limitsurf.engine.turning import Turning
from limitsurf.patches import PatchTable
from limitsurf.refine import sharing, stacked
from limitsurf.rules import Rules
from limitsurf.scheme.scheme import Scheme
from limitsurf.scheme.sqrt3 import TurningScheme
from limitsurf.scheme.stepwise import InterpolatingScheme

Array = NDArray[Any]
Choice: TypeAlias = Literal["auto", "reference", "compiled"]

# seconds that NumPy takes for a call, for each kind of patch in it, and for a query of one order
_CALL, _KIND, _QUERY = 6e-4, 2e-4, 1e-6
_PORTION = 1 << 18  # queries of a call after which is asked anew who answers

# types of plain numbers
_WHOLE, _REAL = {int, np.int64, np.int32}, {float, np.float64}
_FAR = 1 << 62  # no integers of other types before


def chosen(engine: str | None) -> Choice:
    """The choice that an argument, or where it is None the environment, makes.

    Examples
    --------
    >>> from limitsurf.engine.choice import chosen
    >>> chosen("reference")
    'reference'
    """
    found: Any = _kernels.named(engine)
    choice: Choice = found
    return choice


def topology_of(
    mesh: Mesh, rules: Rules, choice: Choice, patches: PatchTable | None = None
) -> Topology:
    """What answers depend on besides the points; with patches if there are any."""
    if rules.scheme.has_pieces:
        return Topology(mesh, rules, choice, patches)
    return StepwiseTopology(mesh, rules, choice)


# who answers where a scheme has no pieces, by its kind: (topology, mesh, exact) -> Engine
STEPWISE: dict[type[Scheme], Callable[[StepwiseTopology, Mesh, bool], Any]] = {
    InterpolatingScheme: Interpolating,
    TurningScheme: Turning,
}


def _reference(topology: Topology, mesh: Mesh, exact: bool) -> Reference:
    """NumPy, for whichever kind of scheme there is."""
    if isinstance(topology, StepwiseTopology):
        found: Any = STEPWISE[type(topology.rules.scheme)](topology, mesh, exact)
        engine: Reference = found  # of pieces it is asked for nothing
        return engine
    return Reference(topology, mesh, exact)


class Answers:
    """Both engines for the points of `mesh`, and which of them is asked."""

    def __init__(self, topology: Topology, mesh: Mesh, choice: Choice) -> None:
        self.topology, self._mesh, self._choice = topology, mesh, choice

    @cached_property
    def reference(self) -> Reference:
        """NumPy in float64."""
        return _reference(self.topology, self._mesh, False)

    @cached_property
    def exact(self) -> Reference:
        """NumPy in Fractions."""
        return _reference(self.topology, self._mesh, True)

    @cached_property
    def compiled(self) -> Compiled:
        """Kernels."""
        return Compiled(self.topology, self.reference, self._choice)

    def one(
        self, face: Any, u: Any, v: Any, orders: tuple[Order, ...] | None, workers: Any
    ) -> Sequence[Array] | None:
        """Derivatives (1, d) of these orders, or the normal for None, at a place in plain numbers.

        Points are in float64. None if it is not in plain numbers, or `workers` are asked for: the
        call is as any other then.
        """
        if type(u) is int and 0 <= u <= 1:
            u = float(u)
        if type(v) is int and 0 <= v <= 1:
            v = float(v)
        if type(u) not in _REAL or type(v) not in _REAL or type(face) not in _WHOLE:
            return None
        if type(workers) is not int or workers != 1 or not 0 <= face < _FAR:
            return None
        compiled = self.topology.shape is not None and self._choice == "compiled"
        if compiled or (self._choice == "auto" and self.topology.shape in _kernels.available):
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

    def engine(self, request: Request, orders: Sequence[Order] = (), part: str = "") -> Engine:
        """Who answers a request for derivatives of these orders or their weights, or what else.

        `part` is "" for derivatives and normals, else `WEIGHTS` or `CURVATURE` of the kernels.

        Kernels where they can, unless "reference" is chosen. If neither is, they do so as soon as
        they are loaded, and NumPy until then.
        """
        if request.exact:
            return self.exact
        choice, shape = self._choice, self.topology.shape
        if choice == "reference" or shape is None:
            return self.reference
        weights = part == _kernels.WEIGHTS
        if (orders or weights) and not PLACES.keys() & orders:
            if weights:  # (what kernels never know costs them nothing)
                return self.reference
            part = _kernels.HIGHER
        if choice == "auto" and (kind := shape + part) not in _kernels.available:
            size, kinds = request.face.size, len(self.topology.patches.controls)
            seconds = _CALL + _KIND * min(size, kinds) + _QUERY * size * (1 + (len(orders) or 3))
            if not _kernels.answer(kind, seconds):
                portions = size > _PORTION and self.compiled.knows(orders, weights)
                return _Portions(self, orders, part) if portions else self.reference
        return self.compiled if self.compiled.knows(orders, weights) else self.reference


class _Portions:
    """Large calls while kernels are not there: in portions, so that these take over when they come.

    The portions are accounted as well as the whole; what is decided by that does not need care.
    """

    def __init__(self, answers: Answers, orders: Sequence[Order], part: str) -> None:
        self._answers, self._asked = answers, (orders, part)

    def derivatives(
        self, request: Request, orders: Sequence[Order], out: Sequence[Array] | None = None
    ) -> Sequence[Array]:
        """See `Engine`."""
        return self._joined(request, lambda engine, some: engine.derivatives(some, orders), out)

    def normals(self, request: Request, out: Array | None = None) -> Array:
        """See `Engine`."""
        given = None if out is None else [out]
        return self._joined(request, lambda engine, some: [engine.normals(some)], given)[0]

    def tangents(self, request: Request, width: int) -> tuple[Array, Array]:
        """See `Engine`."""
        along, across = self._joined(request, lambda engine, some: engine.tangents(some, width))
        return along, across

    def curvatures(self, request: Request) -> Array:
        """See `Engine`."""
        return self._joined(request, lambda engine, some: [engine.curvatures(some)])[0]

    def weights(self, request: Request, orders: Sequence[Order]) -> list[Any]:
        """See `Engine`."""
        parts = [engine.weights(some, orders) for engine, some, _ in self._portions(request)]
        found = list(map(stacked, map(list, zip(*parts, strict=True))))
        if not found:
            return found
        one = found[0]
        return sharing(one.indptr, one.indices, [x.data for x in found], one.shape)

    def _joined(
        self,
        request: Request,
        ask: Callable[[Engine, Request], Sequence[Array]],
        out: Sequence[Array] | None = None,
    ) -> Sequence[Array]:
        """Arrays (Q, width) of all portions, `out` or new ones."""
        results: Sequence[Array] = out or []
        for engine, some, part in self._portions(request):
            found = ask(engine, some)
            if not results:
                results = [np.empty((request.face.size, x.shape[1])) for x in found]
            for result, values in zip(results, found, strict=True):
                result[part] = values
        return results

    def _portions(self, request: Request) -> Iterator[tuple[Engine, Request, slice]]:
        topology, total = self._answers.topology, request.face.size
        request.check(topology.patches.n_limit_faces, topology.lattice)
        for start in range(0, total, _PORTION):
            part = slice(start, start + _PORTION)
            some = request.flat(part)
            yield self._answers.engine(some, *self._asked), some, part
