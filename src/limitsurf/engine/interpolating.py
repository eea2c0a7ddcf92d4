"""Evaluation under schemes that keep vertices: products of local matrices, one for each halving.

A float64 (u, v) is a vertex after finitely many steps, and there the value is its point. So the
steps on the way are found first, from the child of the cage's triangle on; then a row of weights is
carried back, from the vertex to what is around that child. Runs of steps towards a vertex are taken
at once, by powers of its matrix, and three at a time amid regular vertices. Parameters are kept as
the two barycentric coordinates that are exact, so that none is ever rounded.
Derived in ``derivations/butterfly.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from limitsurf import numbers
from limitsurf._kernels import reference as kernels
from limitsurf.caching import cached_property
from limitsurf.cage.mesh import Mesh
from limitsurf.engine.halvings import halvings_of, kernels_for
from limitsurf.engine.operations import MIDDLE as _MIDDLE
from limitsurf.engine.operations import operations_of
from limitsurf.engine.packing import over_chunks
from limitsurf.engine.protocol import Order, Request
from limitsurf.engine.stepwise import StepwiseTopology
from limitsurf.numbers import NumberType
from limitsurf.refine import interpolating, on_one_pattern, sparse_operator
from limitsurf.refine.local_steps import LocalSteps, local_steps
from limitsurf.refine.neighbourhoods import FRAMES, REGULAR
from limitsurf.topology import child_mesh

Array = NDArray[Any]
# of `CornerRows`
Wanted: TypeAlias = Literal["derivatives", "tangents", "normal"]
_T = TypeVar("_T")

_CHUNK = 1 << 13  # queries in memory at once
_RUN = 8  # least number of halvings towards a corner that are taken at once
_SIDES = (0, 0), (1, 0), (0, 1)  # orders of what rows are of
_AXES = {(0, 0): -1, (1, 0): 0, (0, 1): 1}


class Interpolating:
    """The engine for the points of `mesh`, in float64, or in Fractions if `exact`.

    It knows positions and first derivatives; those of higher order are NaN.
    """

    def __init__(self, topology: StepwiseTopology, mesh: Mesh, exact: bool) -> None:
        self._topology, self._mesh = topology, mesh
        self._number = numbers.RATIONAL if exact else numbers.FLOAT64
        self._first: FirstStep = topology.kept(f"first step {exact}", self._make_first)

    def _make_first(self) -> FirstStep:
        return FirstStep(self._topology, self._number)

    @cached_property
    def _control(self) -> tuple[Array, Array]:
        """Points after a step as vertices of the cage (n,), and what they are off these (n, d)."""
        points = self._number.array(self._mesh.points.reshape(self._mesh.n_vertices, -1))
        return self._first.bases, self._first.offsets(points)

    def derivatives(
        self, request: Request, orders: Sequence[Order], out: Sequence[Array] | None = None
    ) -> Sequence[Array]:
        """See `Engine`; NaN beyond first derivatives."""
        base, offset = self._control
        points = self._number.array(self._mesh.points.reshape(self._mesh.n_vertices, -1))
        d = points.shape[1]
        results = list(out or (np.empty((request.face.size, d), points.dtype) for _ in orders))
        for result in results:
            result.fill(np.nan)
        known = [nu for nu in orders if nu in _SIDES]

        def use(where: Array, ids: Array, rows: Array) -> None:
            near = points[base[ids]] - points[base[ids[:, :1]]]
            near += offset[ids] - offset[ids[:, :1]]
            found = _times(rows, near[:, 1:])
            for k, nu in enumerate(known):
                value = found[:, k]
                if nu == (0, 0):
                    value = points[base[ids[:, 0]]] + (offset[ids[:, 0]] + value)
                for result, order in zip(results, orders, strict=True):
                    if order == nu:
                        result[where] = value

        if known:
            self._each(request, known, "derivatives", use)
        return results

    def normals(self, request: Request, out: Array | None = None) -> Array:
        """See `Engine`."""
        result = np.empty((request.face.size, 3)) if out is None else out
        result.fill(np.nan)

        def use(where: Array, a: Array, b: Array, noise: Array) -> None:
            result[where] = kernels.unit_normals(a, b, (noise[0], noise[1]))

        self._vectors(request, "normal", use)
        return result

    def tangents(self, request: Request, width: int) -> tuple[Array, Array]:
        """See `Engine`."""
        d = self._control[1].shape[1]
        along, across = np.full((2, request.face.size, d), np.nan)

        def use(where: Array, a: Array, b: Array, noise: Array) -> None:
            for result, x, bound in ((along, a, noise[0]), (across, b, noise[1])):
                shape = len(x), d // max(width, 1), width
                result[where] = kernels.unit(x.reshape(shape), bound[:, None]).reshape(x.shape)

        self._vectors(request, "tangents", use)
        return along, across

    def curvatures(self, request: Request) -> Array:
        """There are none: a ValueError that says what there is."""
        found: Array = self._topology.patches
        return found

    def weights(self, request: Request, orders: Sequence[Order]) -> list[Any]:
        """See `Engine`; rows beyond first derivatives are NaN."""
        first, number, Q = self._first, self._number, request.face.size
        known = [nu for nu in orders if nu in _SIDES] or [(0, 0)]
        defined = np.zeros(Q, dtype=bool)

        def use(where: Array, ids: Array, rows: Array) -> tuple[Array, Array, Array]:
            defined[where] = True
            own = -rows.sum(axis=2)
            own[:, [k for k, nu in enumerate(known) if nu == (0, 0)]] += number.one
            values = np.concatenate([own[:, :, None], rows], axis=2)
            return np.repeat(where, ids.shape[1]), ids.ravel(), values

        parts = self._each(request, known, "derivatives", use)
        matrices = []
        for nu in orders:
            entries = [
                (row, column, values[:, known.index(nu)].ravel())
                for row, column, values in parts
                if nu in known
            ]
            entries.append((np.zeros(0, int), np.zeros(0, int), number.full(0, number.zero)))
            row, column, value = (np.concatenate(x) for x in zip(*entries, strict=True))
            rows = sparse_operator(row, column, value, (Q, len(first.bases))) @ first.operator
            lost = np.flatnonzero(~defined) if nu in known else np.arange(Q)
            face = request.face.ravel()[lost].astype(np.int64)
            nan = np.full(len(lost), np.nan, dtype=number.dtype)
            own = self._topology.own_vertices[face]
            matrices.append(_summed(rows, sparse_operator(lost, own, nan, rows.shape)))
        return on_one_pattern(matrices)

    def _vectors(
        self, request: Request, wanted: Wanted, use: Callable[[Array, Array, Array, Array], None]
    ) -> None:
        """What is done with some queries, two vectors of each, and their noise (2, q, 1)."""
        base, offset = self._control
        points = self._mesh.points.reshape(self._mesh.n_vertices, -1)

        def each(where: Array, ids: Array, rows: Array) -> None:
            near = points[base[ids]] - points[base[ids[:, :1]]]
            near += offset[ids] - offset[ids[:, :1]]
            found = _times(rows, near[:, 1:])
            size = kernels.NOISE * np.einsum("qrn,qn->rq", np.abs(rows), np.abs(near).max(2)[:, 1:])
            use(where, found[:, 0], found[:, 1], size[:, :, None])

        self._each(request, [(1, 0), (0, 1)], wanted, each)

    def _each(
        self,
        request: Request,
        orders: Sequence[Order],
        wanted: Wanted,
        use: Callable[[Array, Array, Array], _T],
    ) -> list[_T]:
        """What is made of queries (q,), points after a step (q, n + 1), and rows (q, orders, n).

        The rows are over differences of the points from the first of them.
        """
        first, lattice, number = self._first, self._topology.lattice, self._number
        request.check(len(self._topology.limit_faces), lattice)
        face = request.face.ravel().astype(np.int64, copy=False)
        u, v = request.u.ravel(), request.v.ravel()
        known = self._topology.with_limit[face] & number.finite(u) & number.finite(v)
        every = np.flatnonzero(known)
        if number.exact:
            _check_dyadic(u[every], v[every], self._topology.rules.scheme.name)
        kernels_ = not number.exact and kernels_for(self._topology.choice, len(every))
        rows_of = self._compiled_rows if kernels_ else self._rows_of

        def work(part: slice) -> list[_T]:
            where = every[part]
            some = face[where], u[where].astype(u.dtype), v[where].astype(v.dtype)
            rows, counts, starts = rows_of(*some, orders, wanted)
            alike = bool((counts == counts[0]).all())
            found = []
            for n in [int(counts[0])] if alike else np.unique(counts).tolist():
                which = slice(None) if alike else np.flatnonzero(counts == n)
                ids = first.points[starts[which][:, None] + np.arange(n)]
                found.append(use(where[which], ids, rows[which, :, : n - 1]))
            return found

        workers = request.workers if kernels_ else 1
        return [x for part in over_chunks(len(every), workers, work, _CHUNK) for x in part]

    def _compiled_rows(
        self, face: Array, u: Array, v: Array, orders: Sequence[Order], wanted: Wanted
    ) -> tuple[Array, Array, Array]:
        """As `_rows_of`, by kernels."""
        packed = halvings_of(operations_of(self._first.steps))
        known = tuple(dict.fromkeys(orders))
        axes = np.array([_AXES[nu] for nu in known])
        rows, kinds, starts = packed.rows(self._first, face, u, v, axes, wanted)
        if len(known) < len(orders):
            rows = rows[:, [known.index(nu) for nu in orders]]
        return rows, packed.counts(kinds), starts

    def _rows_of(
        self, face: Array, u: Array, v: Array, orders: Sequence[Order], wanted: Wanted
    ) -> tuple[Array, Array, Array]:
        """Rows (q, orders, ...), numbers of points of first triangles, and where these begin."""
        first = self._first
        path = Path(first.steps, u, v)
        child, corner = path.begin(face)
        kinds, starts = first.kinds_of(corner)
        path.walk(kinds)
        rows, counts = path.back(orders, wanted, child), np.empty(len(kinds), dtype=np.int64)
        for kind in np.unique(kinds).tolist():
            here, n = np.flatnonzero(kinds == kind), first.steps.kinds.known[kind].n_points
            counts[here] = n
            if first.steps.kinds.expanded(kind).affine:
                plain = rows[here, :, : n - 1] @ first.steps.differences(kind)
                rows[here, :, : n - 1] = plain
        return rows, counts, starts


def _times(rows: Array, points: Array) -> Array:
    """Rows (q, r, n) times points (q, n, d)."""
    # row by row: products of several round as their number has it
    return np.asarray((rows[:, :, None] @ points[:, None])[:, :, 0])


def _summed(one: Any, other: Any) -> Any:
    """The sum of two operators of one shape."""
    if hasattr(one, "nnz"):
        found = (one + other).tocsr()
        found.sort_indices()
        return found
    arrays = (np.concatenate([getattr(x, name) for x in (one, other)])
              for name in ("rows", "columns", "values"))  # fmt: skip
    return type(one)(*arrays, one.shape)


def _check_dyadic(u: Array, v: Array, scheme: str) -> None:
    """Refuse exact parameters that are no vertex after finitely many halvings."""
    for name, values in (("u", u), ("v", v)):
        for x in values.tolist():
            if x.denominator & (x.denominator - 1):
                raise ValueError(
                    f"{name} = {x}: under scheme {scheme!r} exact values are known at fractions "
                    "whose denominators are powers of two; give such, or float64"
                )


class FirstStep:
    """The once refined cage, and the neighbourhoods of its triangles as they are asked for."""

    def __init__(self, topology: StepwiseTopology, number: NumberType) -> None:
        mesh, rules = topology.mesh, topology.rules
        self._rows = interpolating.edge_rows(mesh, rules, number)
        self._number, self._cage = number, mesh
        self.steps = local_steps(rules, number)
        E = mesh.n_edges
        self.bases = np.concatenate([np.arange(mesh.n_vertices), mesh.edges[:, 0]])
        self.mesh = child_mesh(mesh, np.zeros((mesh.n_vertices + E, 0)), topology.lattice)
        # of each triangle its kind, -1 while unknown, and where its points begin
        self.triangles = np.zeros((self.mesh.n_faces, 2), dtype=np.int64)
        self.triangles[:, 0] = -1
        self.points = np.zeros(0, dtype=np.int64)
        self.rules = rules

    @cached_property
    def operator(self) -> Any:
        """The step as an operator."""
        return interpolating.stage(self._cage, self.rules, self._number)

    def offsets(self, points: Array) -> Array:
        """What all points after the step are off their `bases`, (n, d)."""
        rows, columns, values = self._rows
        V = self._cage.n_vertices
        order = np.argsort(rows, kind="stable")
        rows, columns, values = rows[order], columns[order], values[order]
        result = self._number.full((len(self.bases), points.shape[1]), self._number.zero)
        if len(rows) and points.shape[1]:
            terms = values[:, None] * (points[columns] - points[self.bases[V + rows]])
            first = np.flatnonzero(np.diff(rows, prepend=-1))
            result[V + rows[first]] = np.add.reduceat(terms, first, axis=0)
        return result

    def kinds_of(self, corner: Array) -> tuple[Array, Array]:
        """Kinds of triangles, by a corner of the refined mesh, and where their points begin."""
        face = corner // 3
        if (self.triangles[face, 0] < 0).any():
            with self.steps.kinds.lock:
                lost = self.triangles[face, 0] < 0
                unknown, first = np.unique(face[lost], return_index=True)
                if len(unknown):
                    kinds, starts, points = self.steps.kinds.of(self.mesh, corner[lost][first])
                    self.triangles[unknown, 1] = len(self.points) + starts[:-1]
                    self.points = np.concatenate([self.points, points])
                    self.triangles[unknown, 0] = kinds  # last: others may look meanwhile
        return self.triangles[face, 0], self.triangles[face, 1]


class Path:
    """The steps from triangles (q,) to places in them, and rows back."""

    def __init__(self, steps: LocalSteps, u: Array, v: Array) -> None:
        self._steps, self._exact = steps, steps.number.exact
        # barycentric coordinates of the two corners after the one that is referred to
        self._ref, self._x, self._y = np.zeros(len(u), dtype=np.int64), u.copy(), v.copy()
        self._operations: list[Array] = []

    def begin(self, face: Array) -> tuple[Array, Array]:
        """The children of the cage's triangles, and their first corners in the refined mesh."""
        child = self._halved(np.arange(len(face)))
        return child, 3 * (4 * face + child) + FRAMES[child]

    def _halved(self, some: Array) -> Array:
        """Go to the children of some triangles; which they are."""
        ref, x, y = self._ref[some], self._x[some], self._y[some]
        one = self._steps.number.one
        half = one / 2
        least, most = np.where(x <= y, x, y), np.where(x <= y, y, x)
        # exact: most is at least 1/4 where it matters
        middle = np.asarray((most < half) & (least >= half - most) & (4 * most >= one), dtype=bool)
        along, across = np.asarray(x >= half, bool), np.asarray(y >= half, bool)
        along, across = along & ~middle, across & ~middle & ~along
        child = np.where(middle, _MIDDLE, (ref + along + 2 * across) % 3)
        new_x = 2 * x - np.where(along, one, 0 * one)
        new_y = 2 * y - np.where(across, one, 0 * one)
        # corner i of the middle child is opposite to corner i; the nearest one is referred to
        far = np.asarray(x >= y, dtype=bool)
        small = one - 2 * most
        rest = 2 * least - small
        ref = np.where(middle, (ref + np.where(far, 2, 1)) % 3, ref)
        self._x[some] = np.where(middle, np.where(far, rest, small), new_x)
        self._y[some] = np.where(middle, np.where(far, small, rest), new_y)
        self._ref[some] = ref
        return child

    def _done(self) -> Array:
        x, y, one = self._x, self._y, self._steps.number.one
        return np.asarray(((x == 0) & (y == 0)) | (x == one) | (y == one), dtype=bool)

    def walk(self, kinds: Array) -> None:
        """Find all steps, from the kinds of the first triangles on."""
        steps, kinds = self._steps, kinds.copy()
        table = operations_of(steps)
        active = np.flatnonzero(~self._done())
        while len(active):
            own, codes = kinds[active], np.empty(len(active), dtype=np.int64)
            exponent = self._exponents(active)
            run = exponent >= 0
            for kind, k in _pairs(own[run], self._ref[active][run]):
                here = run & (own == kind) & (self._ref[active] == k)
                run[here] = steps.child(kind, k) == kind
            for kind, k, j in _pairs(own[run], self._ref[active][run], exponent[run]):
                here = run & (own == kind) & (self._ref[active] == k) & (exponent == j)
                codes[here] = table.run(kind, k, j)
                which = active[here]
                self._x[which] = np.ldexp(self._x[which], 1 << j)
                self._y[which] = np.ldexp(self._y[which], 1 << j)
            regular = ~run & (own == REGULAR) & (not self._exact)
            some = active[regular]
            if len(some):
                codes[regular] = table.regular(*(self._halved(some) for _ in range(3)))
            other = ~run & ~regular
            some = active[other]
            if len(some):
                child, before = self._halved(some), own[other]
                after, code = np.empty_like(child), np.empty_like(child)
                for kind, c in _pairs(before, child):
                    here = (before == kind) & (child == c)
                    after[here], code[here] = steps.child(kind, c), table.single(kind, c)
                kinds[some], codes[other] = after, code
            operation = np.full(len(self._ref), -1)
            operation[active] = codes
            self._operations.append(operation)
            active = active[~self._done()[active]]
        self._kinds = kinds

    def _exponents(self, active: Array) -> Array:
        """Of the power of two of halvings towards a corner that can be taken at once, or -1."""
        if self._exact:
            return np.full(len(active), -1)
        _, e = np.frexp(np.maximum(self._x[active], self._y[active]))
        n = -e - 1
        return np.where(n >= _RUN, np.frexp(np.maximum(n, 1))[1] - 1, -1)

    def back(self, orders: Sequence[Order], wanted: Wanted, child: Array) -> Array:
        """Rows (q, orders, n) over the differences around the first triangles."""
        steps, number, Q = self._steps, self._steps.number, len(self._ref)
        table, one = operations_of(steps), number.one
        position = np.array([nu == (0, 0) for nu in orders])
        end = (self._ref + np.asarray(self._x == one) + 2 * np.asarray(self._y == one)) % 3
        n = max([table.width(op) for op in self._operations] + [steps.size(self._kinds)])
        rows = number.full((Q, len(orders), n), number.zero)
        for kind, k in _pairs(self._kinds, end):
            here = np.flatnonzero((self._kinds == kind) & (end == k))
            if position.any() and k:
                rows[here[:, None], np.flatnonzero(position), k - 1] = one
            given = [(i, nu.index(1)) for i, nu in enumerate(orders) if nu != (0, 0)]
            if given:
                found = getattr(steps.corner(kind, k), wanted)
                for i, axis in given:
                    rows[here, i, : found.shape[1]] = found[axis]
        for operation in reversed(self._operations):
            order = np.argsort(operation, kind="stable")
            codes = operation[order]
            starts = np.flatnonzero(np.diff(codes, prepend=-2))
            for a, b in zip(starts, [*starts[1:], Q], strict=True):
                if codes[a] < 0:
                    continue
                g, C, scale, sign = table.known[codes[a]]
                here = order[a:b]
                block = rows[here][:, :, : len(C)]
                found = (block.reshape(-1, len(C)) @ C).reshape(len(here), len(orders), -1)
                found *= np.where(position, scale, sign)[:, None]
                found[:, position] += g
                rows[here, :, : C.shape[1]] = found
        rows[:, ~position] *= np.where(child == _MIDDLE, -2 * one, 2 * one)[:, None, None]
        return rows


def _pairs(*columns: Array) -> list[tuple[int, ...]]:
    """The different rows of some integer columns."""
    if not len(columns[0]):
        return []
    return [tuple(row) for row in np.unique(np.stack(columns, axis=1), axis=0).tolist()]
