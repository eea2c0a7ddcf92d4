"""Evaluation by NumPy, of one kind of patch at a time, on any number type."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import numbers
from limitsurf._kernels import reference as kernels
from limitsurf.caching import cached_property
from limitsurf.cage.mesh import Mesh
from limitsurf.engine import places as places_
from limitsurf.engine.groups import CHUNK
from limitsurf.engine.limits import Limits
from limitsurf.engine.places import CharacteristicJets, PlaceJets, Places
from limitsurf.engine.protocol import Order, Request
from limitsurf.engine.topology import Topology
from limitsurf.refine import eliminated, on_one_pattern, sparse_operator, stacked
from limitsurf.values import Values, exact_control_points

Array = NDArray[Any]


class Reference:
    """The engine by NumPy for the points of `mesh`, in float64, or in Fractions if `exact`.

    Those know derivatives and weights alone: the others need square roots.
    """

    def __init__(self, topology: Topology, mesh: Mesh, exact: bool) -> None:
        self._topology, self._mesh, self._exact = topology, mesh, exact
        self._groups = topology.exact_groups if exact else topology.groups
        self._dtype = self._groups.number.dtype

    @property
    def points(self) -> Array:
        """The points of the cage, (n_vertices, d)."""
        return self._mesh.points.reshape(self._mesh.n_vertices, -1)

    @cached_property
    def values(self) -> Values:
        """The control points of all patches in float64."""
        return Values(self._groups.patches, self.points)

    @cached_property
    def _fractions(self) -> Array:
        """Those in Fractions, (n_points, d)."""
        return exact_control_points(self._groups.patches, numbers.RATIONAL.array(self.points))

    @cached_property
    def limits(self) -> Limits:
        """Normals that are limits."""
        return Limits(self._topology, self._mesh, self.values)

    def derivatives(
        self, request: Request, orders: Sequence[Order], out: Sequence[Array] | None = None
    ) -> Sequence[Array]:
        """See `Engine`; any orders."""
        if self._exact:
            points, method = self._fractions, "exact_derivatives"
            return self._answers(request, [points.shape[1]] * len(orders), method, points, orders)
        widths = [self.values.channels] * len(orders)
        return self._answers(request, widths, "derivatives", self.values, orders, out=out)

    def normals(self, request: Request, out: Array | None = None) -> Array:
        """See `Engine`."""
        given = None if out is None else [out]
        (normals,) = self._answers(request, [3], "normals", self.values, out=given)
        self.limits.fill(request, normals)
        return normals

    def tangents(self, request: Request, width: int) -> tuple[Array, Array]:
        """See `Engine`."""
        d = self.values.channels
        found = self._answers(request, [d, d, 1, 1], "directions", self.values)
        shape = len(found[0]), d // max(width, 1), width
        along, across = (
            kernels.unit(x.reshape(shape), noise[:, None]).reshape(x.shape)
            for x, noise in zip(found[:2], found[2:], strict=True)
        )
        return along, across

    def curvatures(self, request: Request) -> Array:
        """See `Engine`."""
        (found,) = self._answers(request, [10], "curvatures", self.values)
        return found

    def weights(self, request: Request, orders: Sequence[Order]) -> list[Any]:
        """See `Engine`; any orders."""
        request.check(self._groups.patches.n_limit_faces, self._topology.lattice)
        face = request.face.ravel().astype(np.int64, copy=False)
        u, v = request.u.ravel(), request.v.ravel()
        parts: list[list[Any]] = [[] for _ in orders]
        for start in range(0, max(len(face), 1), CHUNK):
            part = slice(start, start + CHUNK)
            found = self._weights(face[part], u[part], v[part], orders)
            for matrices, matrix in zip(parts, found, strict=True):
                matrices.append(matrix)
        return on_one_pattern([stacked(matrices) for matrices in parts])

    def _weights(self, face: Array, u: Array, v: Array, orders: Sequence[Order]) -> Iterator[Any]:
        """Weights of a chunk of queries (Q,), each on a pattern of its own."""
        patches = self._groups.patches
        undefined, groups = self._groups.by_kind(face, u, v)
        rows, columns = [undefined], [self._topology.own_vertices[face[undefined]]]
        for g in groups:
            ids = g.kind.ids(g.row)
            rows.append(np.repeat(g.query, ids.shape[1]))
            columns.append(ids.ravel())
        pattern = np.concatenate(rows), np.concatenate(columns)
        for nu in orders:
            values = [np.full(len(undefined), np.nan, dtype=self._dtype)]
            for g in groups:
                with np.errstate(over="ignore", under="ignore", invalid="ignore"):
                    values.append(g.kind.weights(g, nu).ravel())
            total = sparse_operator(*pattern, np.concatenate(values), (len(face), patches.n_points))
            # back through the extra control points, last ones first
            for operator in reversed(patches.extras):
                total = eliminated(total, operator)
            yield total

    def place_jets(self, places: Places, orders: Sequence[Order]) -> PlaceJets:
        """Derivatives of these orders in (s, t) at places, with powers of eigenvalues apart."""
        groups = self._groups
        return places_.jets(groups.patches, groups.kinds, self.values, places, orders)

    def characteristic_jets(self, places: Places) -> CharacteristicJets:
        """Derivatives in the coordinates of characteristic maps, with powers apart."""
        groups = self._groups
        return places_.characteristic(groups.patches, groups.kinds, self.values, places)

    def corner_rates(self, patch: Array) -> Array:
        """The eigenvalues that rule what happens towards the corners of patches, (3, Q)."""
        return places_.corner_rates(self._groups.patches, self._groups.kinds, patch)

    def _answers(
        self,
        request: Request,
        widths: Sequence[int],
        method: str,
        *given: Any,
        out: Sequence[Array] | None = None,
    ) -> Sequence[Array]:
        """Arrays (Q, width) of a method of the kinds of patches; NaN where there is no value.

        Overflow to infinity and underflow to zero are results, not accidents.
        """
        request.check(self._groups.patches.n_limit_faces, self._topology.lattice)
        values, *more = given
        face = request.face.ravel().astype(np.int64, copy=False)
        u, v, width = request.u.ravel(), request.v.ravel(), max(*widths, 1)
        results = list(out or ())
        for own in () if out else widths:
            results.append(np.empty((face.size, own), dtype=self._dtype))
        for result in results:
            result.fill(np.nan)
        for start in range(0, max(face.size, 1), CHUNK):
            part = slice(start, start + CHUNK)
            _, groups = self._groups.by_kind(face[part], u[part], v[part], width, self._exact)
            for g in groups:
                with np.errstate(over="ignore", under="ignore", invalid="ignore"):
                    found = getattr(g.kind, method)(values, g, *more)
                for result, value in zip(results, found, strict=True):
                    result[start + g.query] = value
        return results
