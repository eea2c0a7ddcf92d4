"""Evaluation by compiled kernels, in float64; what they do not know is left to the reference."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import _kernels
from limitsurf._kernels import reference as kernels
from limitsurf.engine.kinds import curvatures
from limitsurf.engine.packing import TERMS
from limitsurf.engine.protocol import JET, Order, Request
from limitsurf.engine.reference import Reference
from limitsurf.engine.topology import Topology
from limitsurf.refine import stacked

if TYPE_CHECKING:
    from limitsurf._kernels.evaluation import Points

Array = NDArray[Any]

_PORTION = 1 << 20  # queries whose jets are in memory at once
# derivatives that kernels know, in the order of `jet`
PLACES = {nu: place for place, nu in enumerate(TERMS)}


class Compiled:
    """The engine by kernels, for the points of a `reference` in float64."""

    def __init__(self, topology: Topology, reference: Reference) -> None:
        self._topology, self._reference = topology, reference

    def knows(self, orders: Sequence[Order], weights: bool) -> bool:
        """Whether kernels can answer at all: derivatives of few orders, of points of common size.

        Patches must be of a shape that has kernels, and there must be numbers to be answered. For
        `weights` points do not matter.
        """
        if self._topology.shape is None:
            return False
        for nu in orders:
            if nu not in PLACES:
                return False
        if weights:
            return True
        values = self._reference.values
        return values.channels > 0 and not values.balance

    @property
    def _points(self) -> Points:
        """Control points as kernels want them."""
        found: Points | None = self.__dict__.get("_packed")
        if found is None:
            packing = self._topology.packing
            with _kernels.preparing:
                found = self.__dict__.get("_packed")
                if found is None:
                    found = packing.points(self._reference.points)
                    self.__dict__["_packed"] = found
        return found

    def derivatives(self, request: Request, orders: Sequence[Order]) -> Sequence[Array]:
        """See `Engine`; orders of `PLACES`."""
        places = list(map(PLACES.__getitem__, orders))
        return self._answers(request, self._reference.values.channels, places, orders)

    def normals(self, request: Request, limits: bool = True) -> Array:
        """See `Engine`."""
        (normals,) = self._answers(request, 3, None, ())
        if limits:
            self._reference.limits.fill(request, normals)
        return normals

    def tangents(self, request: Request) -> tuple[Array, Array, Array, Array]:
        """See `Engine`; by the reference, for there are no kernels."""
        return self._reference.tangents(request)

    def curvatures(self, request: Request) -> Array:
        """See `Engine`; around special corners, and where errors may weigh, by the reference."""
        request.check(self._topology.patches.n_limit_faces, self._topology.lattice)
        total, start = request.face.size, 0
        found = np.empty((total, 10))
        for part in np.array_split(found, max(1, total // _PORTION)):  # views
            some = request.flat(slice(start, start + len(part)))
            start += len(part)
            jet = np.stack(self.derivatives(some, JET))
            part[:] = curvatures(jet, self.normals(some, limits=False))
            left = kernels.nearly_dependent(*jet[:2])
            left |= self._topology.groups.special(some.face, some.u, some.v)
            here = np.flatnonzero(left)
            part[here] = self._reference.curvatures(some.flat(here))
        return found

    def weights(self, request: Request, nu: Order) -> Any:
        """See `Engine`; an order of `PLACES`."""
        packing, flat = self._topology.packing, request.flat()
        rest = self._without_rows(flat)
        known = flat if rest is None else flat.flat(~rest)
        found = packing.weights((known.face, known.u, known.v), PLACES[nu], request.workers)
        if found is None:
            request.check(self._topology.patches.n_limit_faces, self._topology.lattice)
            return self._reference.weights(request, nu)
        if rest is None:
            return found
        both = stacked([found, self._reference.weights(flat.flat(rest), nu)])
        both = both[np.argsort(np.argsort(rest, kind="stable"), kind="stable")]
        parts = [x.astype(found.indices.dtype) for x in (both.indices, both.indptr)]
        return type(found)((both.data, *parts), shape=both.shape)

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
        width: int,
        places: list[int] | None,
        orders: Sequence[Order],
    ) -> Sequence[Array]:
        """Arrays (Q, width): derivatives, or unit normals where `places` is None."""
        found = self._topology.packing.evaluate(
            self._points, (request.face, request.u, request.v), width, places, request.workers
        )
        if found is None:
            request.check(self._topology.patches.n_limit_faces, self._topology.lattice)
            raise AssertionError("kernels and checks disagree about what is in range")
        results, rest = found
        if len(rest):
            some, other = request.flat(rest), self._reference
            if places is None:
                results[0][rest] = other.normals(some, limits=False)
                return list(results)
            for result, part in zip(results, other.derivatives(some, orders), strict=True):
                result[rest] = part
        return list(results)
