"""Evaluation by compiled kernels, in float64; what they do not know is left to the reference."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, NoReturn, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf import _kernels
from limitsurf.caching import cached_property
from limitsurf.engine.isolated import Isolated
from limitsurf.engine.packing import TERMS, asked
from limitsurf.engine.protocol import Engine, Order, Request
from limitsurf.engine.reference import Reference
from limitsurf.engine.results import Results
from limitsurf.engine.topology import Topology
from limitsurf.refine import merged, on_one_pattern

if TYPE_CHECKING:
    from limitsurf._kernels.evaluation import Points

Array = NDArray[Any]

# derivatives that most kernels know, in the order of `jet`
PLACES = {nu: place for place, nu in enumerate(TERMS)}
Ask: TypeAlias = Callable[[Engine, Request], Iterable[Array]]
_HIGHER = 4e-7  # seconds that NumPy takes for one of a higher order


class Compiled:
    """The engine by kernels, for the points of a `reference` in float64.

    `choice` is "compiled" where it has all kernels, whatever it costs.
    """

    def __init__(self, topology: Topology, reference: Reference, choice: str) -> None:
        self._topology, self._reference, self._choice = topology, reference, choice

    def knows(self, orders: Sequence[Order], weights: bool) -> bool:
        """Whether kernels can answer at all: of points of common size, weights of few orders.

        Patches must be of a shape that has kernels, and there must be numbers to be answered; for
        `weights` points do not matter. One order of these is enough: the reference may give the
        others.
        """
        if self._topology.shape is None or (weights and not PLACES.keys() & orders):
            return False
        values = self._reference.values
        return weights or (values.channels > 0 and not values.balance)

    @cached_property
    def _isolated(self) -> Isolated:
        """What kernels evaluate, as far as queries have asked for it."""
        with _kernels.preparing:
            found: Isolated | None = self.__dict__.get("_made")
            if found is None:
                found = self.__dict__["_made"] = Isolated(self._topology, self._reference.points)
            return found

    @property
    def _points(self) -> Points:
        """Control points as kernels want them."""
        return self._isolated.points

    def one(self, face: int, u: float, v: float, orders: tuple[Order, ...] | None) -> Array | None:
        """Derivatives of orders of `PLACES`, or the normal for None, at one place: (n, 1, d).

        None where `derivatives` and `normals` know more, or complain.
        """
        if orders is not None and not PLACES.keys() >= {*orders}:
            return None
        channels = self._reference.values.channels
        return self._topology.packing.one(
            self._isolated.words, channels, (face, u, v), asked(orders)
        )

    def derivatives(
        self, request: Request, orders: Sequence[Order], out: Sequence[Array] | None = None
    ) -> Sequence[Array]:
        """See `Engine`."""
        orders = tuple(orders)
        known = [k for k, nu in enumerate(orders) if nu in PLACES]
        if len(known) < len(orders):
            others = [k for k, nu in enumerate(orders) if nu not in PLACES]
            both: dict[int, Array] = {}
            asking = (self.derivatives, known), (self._higher, others)
            for ask, which in asking if known else asking[1:]:
                into = out and [out[k] for k in which]
                some = ask(request, [orders[k] for k in which], into)
                both.update(zip(which, some, strict=True))
            return [both[k] for k in range(len(orders))]
        found, rest = self._answers(request, orders, out)
        self._complete(found, rest, request, _derivatives(orders))
        return found

    def _higher(
        self, request: Request, orders: Sequence[Order], out: Sequence[Array] | None
    ) -> Sequence[Array]:
        """Derivatives beyond those of `PLACES`; by the reference while it is faster."""
        kind = f"{self._topology.shape}{_kernels.HIGHER}"
        seconds = _HIGHER * request.face.size * len(orders)
        if self._choice == "auto" and not _kernels.answer(kind, seconds):
            return self._reference.derivatives(request, orders, out)
        results: list[Any] = [*out] if out else [*orders]  # (places for them)
        queries = request.face, request.u, request.v
        packing, words = self._topology.packing, self._isolated.words
        values = self._reference.values
        for total in {sum(nu): None for nu in orders}:
            which = [k for k, nu in enumerate(orders) if sum(nu) == total]
            some = [orders[k] for k in which]
            found, rest = packing.higher(words, queries, some, values.channels, request.workers)
            if rest is None:
                self._complain(request)
            self._complete(found, rest, request, _derivatives(some))
            for k, result in zip(which, found, strict=True):
                if out:
                    results[k][...] = result
                else:
                    results[k] = result
        return results

    def normals(self, request: Request, out: Array | None = None) -> Array:
        """See `Engine`."""
        found, rest = self._answers(request, None, None if out is None else [out])
        self._complete(found, rest, request, lambda engine, some: [engine.normals(some)])
        return found[0]

    def tangents(self, request: Request, width: int) -> tuple[Array, Array]:
        """See `Engine`."""
        out = np.empty((2, request.face.size, self._reference.values.channels))
        rest = self._shapes("tangents", request, lambda: (width, out))
        self._complete(out, rest, request, lambda engine, some: engine.tangents(some, width))
        return out[0], out[1]

    def curvatures(self, request: Request) -> Array:
        """See `Engine`."""
        values, inner = self._reference.values, self._topology.patches.n_vertices
        rounding, out = values.errors[inner:], np.empty((request.face.size, 10))
        rest = self._shapes("curved", request, lambda: (rounding, np.empty((3, 1, 24)), out))
        self._complete([out], rest, request, lambda engine, some: [engine.curvatures(some)])
        return out

    def _complete(self, results: Iterable[Array], rest: Array, request: Request, ask: Ask) -> None:
        """Write what kernels have left: theirs if they know more by now, else the reference's."""
        if not len(rest):
            return
        again = request.flat(rest)
        more = self._isolated.add(again, self._reference.values)
        parts = ask(self if more else self._reference, again)
        for result, part in zip(results, parts, strict=True):
            result[rest] = part

    def _shapes(self, kernel: str, request: Request, given: Callable[[], Sequence[Any]]) -> Array:
        """What `Packing.shapes` returns, of requests that are in range."""
        queries = request.face, request.u, request.v
        packing = self._topology.packing
        words = self._isolated.words
        rest = packing.shapes(kernel, words, queries, given, request.workers)
        if rest is None:
            self._complain(request)
        return rest

    def _complain(self, request: Request) -> NoReturn:
        """Say what of a request is out of range."""
        request.check(self._topology.patches.n_limit_faces, self._topology.lattice)
        raise AssertionError("kernels and checks disagree about what is in range")

    def weights(self, request: Request, orders: Sequence[Order]) -> list[Any]:
        """See `Engine`; orders of `PLACES` by kernels, others by the reference.

        An order in which kernels do not know each query is one for the reference, whatever other
        orders are asked for: these change no matrix but for zeros.
        """
        known = [nu for nu in orders if nu in PLACES]
        found = self._known_weights(request, known)
        if found is None:  # second derivatives too near a vertex
            request.check(self._topology.patches.n_limit_faces, self._topology.lattice)
            known = [nu for nu in known if sum(nu) < 2]
            found = self._known_weights(request, known)
        if found is None:
            self._complain(request)
        rest = [nu for nu in orders if nu not in known]
        if not rest:
            return found
        others = iter(self._reference.weights(request, rest))
        kernels = iter(found)
        return on_one_pattern([next(kernels if nu in known else others) for nu in orders])

    def _known_weights(self, request: Request, orders: Sequence[Order]) -> list[Any] | None:
        """Weights of orders of `PLACES`; None if kernels do not know how to answer a query."""
        if not orders:
            return []
        packing, flat = self._topology.packing, request.flat()
        rest = self._without_rows(flat)
        known = flat if rest is None else flat.flat(~rest)
        queries, places = (known.face, known.u, known.v), [PLACES[nu] for nu in orders]
        found = packing.weights(queries, places, request.workers)
        if found is None or rest is None:
            return found
        return merged(found, self._reference.weights(flat.flat(rest), orders), rest)

    def _without_rows(self, flat: Request) -> Array | None:
        """Queries whose rows of weights only the reference can give; None if there are none.

        Complains of what is out of range before it looks.
        """
        without = self._topology.packing.without_rows
        if not without.any():
            return None
        patches = self._topology.patches
        flat.check(patches.n_limit_faces, self._topology.lattice)
        there = np.flatnonzero(np.isfinite(flat.u) & np.isfinite(flat.v))
        patch, *_ = patches.locate(flat.face[there].astype(np.int64), flat.u[there], flat.v[there])
        result = np.zeros(len(flat.face), dtype=bool)
        result[there] = without[patch] & (patch >= 0)
        return result if result.any() else None

    def _answers(
        self,
        request: Request,
        orders: tuple[Order, ...] | None,
        out: Sequence[Array] | None,
    ) -> tuple[Sequence[Array], Array]:
        """Arrays (Q, d): derivatives, or unit normals for None; and which queries are left."""
        given = asked(orders)
        shape = len(given.which), request.face.size, self._reference.values.channels
        results = Results.new(shape) if out is None else Results.into(out)
        places = request.face, request.u, request.v
        packing = self._topology.packing
        rest = packing.evaluate(self._isolated.words, places, given, results, request.workers)
        if rest is None:
            self._complain(request)
        return results.arrays, rest


def _derivatives(orders: Sequence[Order]) -> Ask:
    """What asks an engine for derivatives of these orders."""
    return lambda engine, request: engine.derivatives(request, orders)
