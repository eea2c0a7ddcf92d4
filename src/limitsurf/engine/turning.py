"""Evaluation under schemes that turn edges: limits by steps towards the place."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels import reference as kernels
from limitsurf.caching import cached_property
from limitsurf.cage.mesh import Mesh
from limitsurf.engine.ground import Ground
from limitsurf.engine.halvings import ascents_of, kernels_for
from limitsurf.engine.protocol import Order, Request
from limitsurf.engine.stepwise import StepwiseTopology
from limitsurf.engine.ternary import STEPS, Corner, Descent
from limitsurf.refine import on_one_pattern, sparse_operator

Array = NDArray[Any]

CHUNK = 1 << 14  # queries at a time
_POSITION: Order = (0, 0)
_FIRST, _BOTH, _ALL = slice(1), slice(1, 3), slice(3)
LONG = 1 << 6  # steps after which all but the slowest is gone
# directions of d/du and d/dv in the coordinates of each corner, (turn, 2, 2)
_TURNED = np.array([[[1, 0], [0, 1]], [[0, -1], [1, -1]], [[-1, 1], [-1, 0]]], dtype=float)


class Found(NamedTuple):
    """Weights at some places.

    Attributes
    ----------
    query : (Q,) int
        Which of the queries they are.
    vertices : (Q, m) int
        The first is that from which differences are taken.
    weights : (n, Q, m - 1)
        Of these differences.
    """

    query: Array
    vertices: Array
    weights: Array


class Turning:
    """The engine for the points of `mesh`."""

    def __init__(self, topology: StepwiseTopology, mesh: Mesh, exact: bool) -> None:
        if exact:
            raise TypeError(
                f"scheme {topology.rules.scheme.name!r} has exact points in refined meshes alone: "
                "evaluation is an infinite product, and needs float64 points, u and v"
            )
        self._topology, self._mesh = topology, mesh

    @property
    def _ground(self) -> Ground:
        kept = vars(self._topology)
        if "ground" not in kept:
            kept["ground"] = Ground(self._topology.mesh, self._topology.rules)
        found: Ground = kept["ground"]
        return found

    @cached_property
    def _points(self) -> tuple[Array, Array, int]:
        """All vertices that weights are of, less a middle of the cage, and this.

        Both times a power of two where sums might overflow, and its exponent.
        """
        points = self._mesh.points.reshape(self._mesh.n_vertices, -1)
        balance = kernels.balance(points)
        points = np.ldexp(points, balance) if balance else points
        used = points[self._mesh.indices]
        middle = used[0] if len(used) else np.zeros(points.shape[1])
        with np.errstate(invalid="ignore", over="ignore"):
            return self._ground.operator @ (points - middle), middle, balance

    # ---------------------------------------------------------------- what `Engine` asks for

    def derivatives(
        self, request: Request, orders: Sequence[Order], out: Sequence[Array] | None = None
    ) -> Sequence[Array]:
        """See `Engine`; NaN beyond the first order."""
        points, middle, balance = self._points
        shape = request.face.size, points.shape[1]
        results = list(out or (np.empty(shape) for _ in orders))
        for result in results:
            result.fill(np.nan)
        for found in self._chunks(request, orders):
            steps = points[found.vertices]
            first, steps = steps[:, 0], steps[:, 1:] - steps[:, :1]
            for result, nu, weights in zip(results, orders, found.weights, strict=True):
                value = np.einsum("qm,qmd->qd", weights, steps)
                if nu == _POSITION:
                    value = value + first + middle
                result[found.query] = np.ldexp(value, -balance) if balance else value
        return results

    def normals(self, request: Request, out: Array | None = None) -> Array:
        """See `Engine`."""
        result = np.empty((request.face.size, 3)) if out is None else out
        result.fill(np.nan)
        for found, along, across, noise in self._directions(request):
            result[found] = kernels.unit_normals(along, across, noise)
        return result

    def _directions(self, request: Request) -> Any:
        """Vectors that span tangent planes, and bounds of their errors."""
        points, _, _ = self._points
        large = np.abs(points).max(initial=0)
        for found in self._chunks(request, None):
            steps = points[found.vertices]
            steps = steps[:, 1:] - steps[:, :1]
            sizes = np.abs(steps).max(axis=2) + large
            with np.errstate(invalid="ignore"):
                along, across = (np.einsum("qm,qmd->qd", w, steps) for w in found.weights)
                noise = tuple(
                    kernels.NOISE * np.einsum("qm,qm->q", np.abs(w), sizes)[:, None]
                    for w in found.weights
                )
            yield found.query, along, across, noise

    def tangents(self, request: Request, width: int) -> tuple[Array, Array]:
        """See `Engine`."""
        points, _, _ = self._points
        large = np.abs(points).max(initial=0)
        shape = request.face.size, points.shape[1]
        results = np.full(shape, np.nan), np.full(shape, np.nan)
        for found in self._chunks(request, ()):
            steps = points[found.vertices]
            steps = steps[:, 1:] - steps[:, :1]
            for result, weights in zip(results, found.weights, strict=True):
                vector = np.einsum("qm,qmd->qd", weights, steps)
                noise = kernels.NOISE * large * np.abs(weights).sum(axis=1)
                parts = vector.reshape(len(vector), -1, max(width, 1))
                unit = kernels.unit(parts, noise[:, None, None])
                result[found.query] = unit.reshape(vector.shape)
        return results

    def curvatures(self, request: Request) -> Array:
        """There are none: second derivatives are not continuous enough to be had."""
        raise ValueError(
            f"scheme {self._topology.rules.scheme.name!r} has no curvature here: evaluate it as "
            "far as first derivatives, or take a scheme of ls.schemes.with_pieces"
        )

    def weights(self, request: Request, orders: Sequence[Order]) -> list[Any]:
        """See `Engine`; NaN beyond the first order."""
        request.check(len(self._topology.limit_faces), self._topology.lattice)
        Q, n = request.face.size, self._ground.operator.shape
        known = np.zeros(Q, dtype=bool)
        rows, columns, values = [], [], []
        for found in self._chunks(request, orders):
            width = found.vertices.shape[1]
            rows.append(np.repeat(found.query, width))
            columns.append(found.vertices.ravel())
            constant = np.array([nu == _POSITION for nu in orders], dtype=float)
            first = constant[:, None] - found.weights.sum(axis=2)
            whole = np.concatenate([first[..., None], found.weights], axis=2)
            values.append(whole.reshape(len(orders), -1))
            known[found.query] = True
        none = np.zeros(0, dtype=np.int64)
        row, column = (np.concatenate([*x, none]) for x in (rows, columns))
        lost = np.flatnonzero(~known)
        made = []
        for k in range(len(orders)):
            value = np.concatenate([x[k] for x in values]) if values else np.zeros(0)
            ok = np.isfinite(value)
            inner = sparse_operator(row, column, np.where(ok, value, 0), (Q, n[0]))
            total = inner @ self._ground.operator
            bad = np.unique(np.concatenate([row[~ok], lost]))
            places = self._mesh.indices[3 * request.face.ravel()[bad].astype(np.int64)]
            nan = sparse_operator(bad, places, np.full(len(bad), np.nan), (Q, n[1]))
            made.append((total + nan).tocsr())
        return on_one_pattern(made)

    # ---------------------------------------------------------------- weights

    def _chunks(self, request: Request, orders: Sequence[Order] | None) -> Any:
        """Weights where there is a limit; for None what spans tangent planes, for () tangents."""
        topology = self._topology
        request.check(len(topology.limit_faces), topology.lattice)
        face = request.face.ravel().astype(np.int64, copy=False)
        u, v = request.u.ravel(), request.v.ravel()
        compiled = kernels_for(topology.choice, len(face))
        for start in range(0, len(face), CHUNK):
            part = slice(start, start + CHUNK)
            which = start + np.flatnonzero(np.isfinite(u[part]) & np.isfinite(v[part]))
            which = which[topology.with_limit[face[which]]]
            if len(which):
                yield Found(
                    which, *self._weights(face[which], u[which], v[which], orders, compiled)
                )

    def _weights(
        self,
        face: Array,
        u: Array,
        v: Array,
        orders: Sequence[Order] | None,
        compiled: bool,
    ) -> tuple[Array, Array]:
        """Vertices and weights of places."""
        w = np.maximum((1 - np.maximum(u, v)) - np.minimum(u, v), 0)
        sides = np.stack([w, u, v])
        turn = sides.argmax(axis=0)
        every = np.arange(len(face))
        s, t = sides[(turn + 1) % 3, every], sides[(turn + 2) % 3, every]
        ground, directions = self._ground, _TURNED[turn].transpose(1, 0, 2)
        kind, vertices, s, t, scale = ground.begin(face, turn, s, t)
        found = _Place(ground, kind, s, t, directions, vertices.shape[1] - 1, compiled)
        if orders is None or not len(orders):
            return vertices, found.planes(scale, tangents=orders is not None)
        return vertices, found.derivatives(scale, orders)


class _Place:
    """Weights of places where a descent begins."""

    def __init__(
        self, ground: Ground, kind: Array, s: Array, t: Array, directions: Array, width: int,
        compiled: bool,
    ) -> None:  # fmt: skip
        kinds = ground.kinds
        self._kinds, self._kind, self._width, self._compiled = kinds, kind, width, compiled
        self._directions = directions
        special = kinds.repeats(kind)
        with np.errstate(divide="ignore"):
            run = np.floor(-np.log(s + t) / np.log(3))
        self._run = np.where(special & (s + t > 0) & (run > 0), run, 0).astype(np.int64)
        self._at = special & (s + t == 0)
        # in two parts, as powers of 3 end before those of numbers do
        half = self._run // 2
        grown = [x * 3.0**half * 3.0 ** (self._run - half) for x in (s, t)]
        over = grown[0] + grown[1] > 1
        self._run[over] -= 1
        self._s, self._t = (np.where(over, x / 3, x) for x in grown)

    def _ended(self, steps: int, flat: bool, which: slice) -> tuple[Descent, Array]:
        """The descent, and weights where runs end: of some of the position and both derivatives."""
        kinds = self._kinds
        descent = kinds.descend(self._kind, self._s, self._t, steps)
        width, first = max(self._width, 26), which != _FIRST
        weights = kinds.ends(descent, self._directions, width, flat, first)[which]
        ascend = ascents_of(kinds).ascend if self._compiled else kinds.ascend
        return descent, ascend(descent, weights, np.array([1.0, 0, 0])[which])

    def derivatives(self, scale: Array, orders: Sequence[Order]) -> Array:
        """Weights of derivatives, (n, Q, width)."""
        found = np.full((len(orders), len(scale), self._width), np.nan)
        wanted = [(0, 0), (1, 0), (0, 1)]
        if not any(nu in wanted for nu in orders):
            return found
        first = any(nu in wanted[1:] for nu in orders)
        descent, weights = self._ended(STEPS[first], False, _ALL if first else _FIRST)
        weights[1:] *= (scale * 3.0**descent.levels)[:, None]
        weights = weights[..., : self._width]
        ran = np.flatnonzero((self._run > 0) | self._at)
        for kind in np.unique(self._kind[ran]).tolist():
            here = ran[self._kind[ran] == kind]
            weights[:, here] = self._back(kind, here, weights[:, here], scale)
        for k, nu in enumerate(orders):
            if nu in wanted:
                found[k] = weights[wanted.index(nu)]
        return found

    def _back(self, kind: int, here: Array, weights: Array, scale: Array) -> Array:
        """Weights taken back through runs towards the corner of places of one kind."""
        corner, run = self._kinds.corner(kind), self._run[here]
        size = len(corner.limit)
        some, start = weights[..., :size].copy(), weights[..., :size]
        some[0] -= corner.limit
        some = corner.power(some, run)
        with np.errstate(over="ignore", under="ignore", invalid="ignore"):
            some[0] *= np.power(corner.value, run)[:, None]
            some[1:] *= np.power(3 * corner.value, run)[:, None]
        some[0] += corner.limit
        at = self._at[here]
        some[0, at] = corner.limit
        some[1:, at] = 0 if corner.vanishes else np.nan
        for side, beside, across in ((0, self._t, 1), (2, self._s, 0)):
            if corner.open_sides[side]:
                self._along(corner, side, here, beside[here] == 0, across, start, some, scale)
        weights[..., :size] = some
        return weights

    def _along(
        self,
        corner: Corner,
        side: int,
        here: Array,
        on: Array,
        across: int,
        start: Array,
        found: Array,
        scale: Array,
    ) -> None:
        """Derivatives along a boundary, at places on it: of the curve alone."""
        for k in range(len(start) - 1):
            ways = self._directions[k, here]
            some = np.flatnonzero(on & (ways[:, across] == 0))
            at = self._at[here[some]]
            begin = start[1 + k, some][:, corner.curve]
            own = ways[some, 1 - across] * scale[here[some]]
            begin[at] = 0
            begin[at, side // 2] = own[at]
            found[1 + k, some] = 0
            run = np.where(at, LONG, self._run[here[some]])
            found[1 + k, some[:, None], corner.curve] = corner.on_curve(begin, run)

    def planes(self, scale: Array, tangents: bool) -> Array:
        """Weights of two vectors that span tangent planes, or are along d/du and d/dv."""
        _, weights = self._ended(STEPS[1], not tangents, _BOTH)
        weights = weights[..., : self._width] * np.sign(scale)[:, None]
        largest = np.abs(weights).max(axis=2, keepdims=True)
        weights /= np.where(largest > 0, largest, 1)
        ran = np.flatnonzero((self._run > 0) | self._at)
        for kind in np.unique(self._kind[ran]).tolist():
            here = ran[self._kind[ran] == kind]
            corner = self._kinds.corner(kind)
            some = weights[:, here, : len(corner.limit)].copy()
            some = (corner.power if tangents else corner.planes)(some, self._run[here])
            at = np.flatnonzero(self._at[here])
            some[:, at] = np.nan
            vectors = corner.edges if tangents else corner.tangents
            if vectors is not None:
                signs = np.sign(scale[here[at]])[:, None]
                ways = self._directions[:, here[at]] if tangents else _PLAIN
                some[:, at] = (ways @ vectors) * signs
            weights[:, here, : len(corner.limit)] = some
        return weights


_PLAIN = np.eye(2)[:, None]
