"""Patches, tables and points packed for compiled kernels: flat arrays without objects.

A `Packing` is made once for a patch table. What it evaluates are the control points, and their
coefficients in the eigenbasis of each special corner.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limitsurf import _kernels, basis, tables
from limitsurf._kernels import reference as kernels
from limitsurf.caching import cached_property
from limitsurf.engine.monomials import Cover, Monomials, holding, polynomials
from limitsurf.engine.protocol import threads
from limitsurf.engine.results import Results
from limitsurf.numbers import FLOAT64
from limitsurf.patches import REGULAR, STRIP, PatchTable
from limitsurf.refine import sharing

if TYPE_CHECKING:
    from limitsurf._kernels import evaluation, grids, rows
    from limitsurf._kernels.blocks import Block
    from limitsurf.scheme.scheme import Scheme

Array = NDArray[Any]

# derivatives that kernels know, in the order of `LimitSurface.jet`
TERMS = [(m - j, j) for m in range(3) for j in range(m + 1)]
_TOTALS = [sum(nu) for nu in TERMS]
_NORMAL = ((1, 0), (0, 1))
_NONE = np.zeros(0, dtype=np.int64)
# faces and parameters for which a grid is worth its tables of weights
_FACES, _PLACES = 16, range(4, 4097)

CHUNK = 1 << 15  # queries; what a thread takes at a time
# Bicubic patches with control points beyond the cage have copies of them in one place if there are
# at most so many, or this share of the limit faces: 0.9 KB each, that save going after 16 points
# and what rounding took from each.
_COPIED, _COPIED_SHARE = 1 << 16, 1 / 4
_LARGEST = 136  # control points of special patches whose coefficients are kept
# Levels around corners whose patches share rings for which control points are kept: no more memory
# a face than coefficients take where fewer meet. Sharp sides fall faster than faces do beside them,
# and relative to these lose a factor of 2.6^2 with each level in second derivatives.
LEVELS, LEVELS_BESIDE = 12, 4
_WIDEST = 256  # vertices of the cage that a control point of compiled rows of weights may combine


def over_chunks(
    total: int, workers: int, work: Callable[[slice], Any], chunk: int = CHUNK
) -> Iterator[Any]:
    """What `work` gives for each chunk of `total` items, in order.

    Chunks are the same for any number of workers, and so are results.
    """
    parts = [slice(start, min(start + chunk, total)) for start in range(0, total, chunk)]
    count = min(threads(workers), len(parts))
    if count <= 1:
        yield from map(work, parts)
        return
    with ThreadPoolExecutor(count) as pool:
        yield from pool.map(work, parts)


def one_by_one(workers: int) -> Callable[[int, Callable[[slice], Any]], Iterator[Any]]:
    """What divides a number of jobs among threads: `over_chunks` of one each."""
    return lambda jobs, work: over_chunks(jobs, workers, work, 1)


class Asked(NamedTuple):
    """What kernels are asked for."""

    terms: tuple[tuple[int, int], ...]  # derivatives that are formed
    which: Array  # places in `TERMS` of those that are returned
    order: int  # the highest
    normals: bool  # unit normals, from two derivatives


@lru_cache(maxsize=256)
def asked(orders: tuple[tuple[int, int], ...] | None) -> Asked:
    """Derivatives of these orders, which are among `TERMS`; None asks for unit normals instead.

    Examples
    --------
    >>> from limitsurf.engine.packing import asked
    >>> asked(((0, 0), (1, 1))).which.tolist()
    [0, 4]
    """
    terms = _NORMAL if orders is None else orders
    places = [1] if orders is None else [TERMS.index(nu) for nu in orders]
    return Asked(terms, np.array(places, dtype=np.int64), max(map(sum, terms)), orders is None)


def ring_rows(shape: Any, faces: int) -> int:
    """Rows of control points of a shared ring, by the kernels for a shape of faces."""
    from limitsurf._kernels.evaluation import HEAD

    each: int = shape.BLOCK * (faces + 3)
    return HEAD + LEVELS * (HEAD + each)


class Packing:
    """The patches of a surface as flat arrays; ``_kernels/evaluation.py`` says what is in them.

    `eigen_tables` are those of the kinds of patches that have one, `strips` has the splines across
    creases, `which` that of each strip; `own` is a vertex of the cage at each limit face.
    """

    def __init__(
        self,
        patches: PatchTable,
        scheme: Scheme,
        eigen_tables: Sequence[tables.EigenTable | None],
        strips: tables.StripTables,
        which: Array,
        own: Array,
    ) -> None:
        from limitsurf._kernels import evaluation

        self._patches, self._own, self._spline = patches, own, scheme.spline
        self._strips = strips
        self._copied = np.zeros(0, dtype=np.int64)
        self._native = holding(scheme.spline)
        shape = _kernels.shape(self._native.directions)
        assert shape is not None
        self.shape = _kernels.evaluating(shape)
        self.cover = Cover.of(patches, eigen_tables, scheme)
        self._controls, self._sectors = self.cover.controls, self.cover.tables
        self.tables, self._n_rows, self._n_fine = self._tables()
        self.patches = self._covering(strips, which)
        # of `evaluation.Room`, in numbers; and what single queries leave behind for the next
        self._room, self._free = evaluation.Room.size(self.tables), list[Array]()

    def _covering(self, strips: tables.StripTables, which: Array) -> evaluation.Patches:
        from limitsurf._kernels import evaluation

        patches, cover = self._patches, self.cover
        regular, strip = self._controls[REGULAR], self._controls[STRIP]
        packed = cover.kind.astype(np.int64) << evaluation.KIND
        packed |= patches.turn.astype(np.int64) << evaluation.TURN
        row = patches.row.astype(np.int64)
        row[cover.kind == STRIP] += len(regular)
        for kind, rings in patches.rings.items():
            here = np.flatnonzero(cover.kind == kind)
            number = rings.ring * self.tables.kinds[kind, evaluation.FACES] + rings.position
            row[here] = number[patches.row[here]]
        packed |= row
        for kind, controls in enumerate(self._controls):
            here = np.flatnonzero(cover.kind == kind)
            beyond = np.any(controls >= patches.n_vertices, axis=1)
            packed[here] |= beyond[patches.row[here]].astype(np.int64) << evaluation.FAR
        info = patches.codes.astype(np.int64)
        inside = info >= 0
        info[inside] = packed[info[inside]]
        near = np.full(len(regular) + len(strip), -1, dtype=np.int64)
        far = np.flatnonzero((packed >> evaluation.FAR & 1 == 1) & (cover.kind <= STRIP))
        if len(far) <= max(_COPIED, _COPIED_SHARE * patches.n_limit_faces):
            self._copied = packed[far] & evaluation.ROW
            near[self._copied] = self._n_fine + np.arange(len(far)) * (self.shape.REFINED + 2)
        if strips.both:
            which = which[:0]
        return evaluation.Patches(
            info,
            patches.n_limit_faces,
            (np.concatenate([regular, strip]) if len(strip) else regular).reshape(-1),
            np.stack([strips.first[which], strips.depth[which]], axis=1).astype(np.int64),
            np.array(strips.pieces, dtype=float).reshape(-1),
            near,
            int(strips.both),
        )

    def _tables(self) -> tuple[evaluation.Tables, int, int]:
        """Tables of the kinds whose coefficients are kept, in so many rows.

        Also how many rows of control points there are of these and of kinds with shared rings.
        """
        from limitsurf._kernels import evaluation

        kept = [
            (kind, table)
            for kind, table in enumerate(self._sectors)
            if table is not None and table.size <= _LARGEST
        ]
        n, levels = len(self._sectors), evaluation.STEP + evaluation.STEPS
        # (at least what rows of derivatives in `evaluation.Room` have)
        wide = _rounded(max(max(table.size - 1, 6) for _, table in kept)) if kept else 0
        chains = max((len(table.chains) for _, table in kept), default=0)
        pairs = max((len(table.pairs) for _, table in kept), default=0)
        kinds = np.zeros((n, evaluation.FIELDS), dtype=np.int64)
        kinds[:, evaluation.MODES] = -1
        made = evaluation.Tables(
            kinds,
            np.zeros((n, 3, self.shape.MONOMIALS, wide)),
            np.zeros((n, 2, levels, wide)),
            np.zeros((n, 2)),
            np.zeros((n, levels)),
            np.zeros((n, levels), dtype=np.int64),
            np.zeros((n, 6, wide)),
            np.zeros((n, wide)),
            np.zeros((n, pairs)),
            np.zeros((n, chains), dtype=np.int64),
            np.zeros((n, pairs), dtype=np.int64),
        )
        rows = patches = 0
        places = [self._native.exponents.index(powers) for powers in self._spline.exponents]
        for k, table in kept:
            size = table.size - 1
            kinds[k, evaluation.SIZE] = size
            kinds[k, evaluation.ROWS] = _rounded(size)
            kinds[k, evaluation.MODES] = rows
            kinds[k, evaluation.CHAINS] = len(table.chains)
            kinds[k, evaluation.PAIRS] = len(table.pairs)
            first, second = (*table.normal, -1, -1)[:2]
            kinds[k, [evaluation.ALONG, evaluation.ACROSS]] = first, second
            kinds[k, evaluation.FLIP] = table.rates[0, 1:3].prod() < 0
            kinds[k, evaluation.PATCH] = patches
            kinds[k, evaluation.LEVELS] = self.cover.splines
            patches += len(self._controls[k])
            rows += len(self._controls[k]) * (_rounded(size) + 3)
            made.pieces[k][:, places, :size] = table.pieces[:, :, 1:]
            for lead in (1, 2):
                made.ratios[k, lead - 1, :, :size] = _powers(table, lead)
                value = table.rates[0, lead]
                made.inverses[k, lead - 1] = 1 / value if value else 0
            made.mantissas[k], made.exponents[k] = _mantissas(table)
            made.sizes[k, :size] = table.coefficient_sizes(np.ones((1, table.size)))[0, 1:]
            for place, nu in enumerate(TERMS[1:], start=1):
                made.corners[k, place, :size] = _corner_derivative(table, nu)
            made.angles[k, : len(table.pairs)] = table.angles
            made.chains[k, : len(table.chains)] = table.chains - 1
            made.pairs[k, : len(table.pairs)] = table.pairs - 1
        fine = patches * (self.shape.REFINED + 2) * self.cover.splines
        # kernels know control points of shared rings in squares alone
        known = self.cover.splines and self.shape.BLOCK > 0
        for k, rings in self._patches.rings.items() if known else ():
            sector = self._patches.sectors[k]
            assert sector is not None
            sharp = sector.open or sector.kind == "dart"
            own = LEVELS, LEVELS_BESIDE if sharp else LEVELS, sector.faces
            kinds[k, [evaluation.LEVELS, evaluation.BESIDE, evaluation.FACES]] = own
            kinds[k, evaluation.PATCH] = fine
            fine += len(rings.points) * ring_rows(self.shape, sector.faces)
        return made, rows, fine

    def points(self, points: Array) -> evaluation.Points:
        """Points of the cage (n_vertices, d), ready for evaluation but around shared rings."""
        from limitsurf._kernels import coefficients, evaluation

        d = points.shape[1]
        patches, kinds, width = self._patches, self.tables.kinds, _rounded(d)
        high = _aligned((patches.n_vertices, width))
        high[:, :d] = points
        extras = _aligned((patches.n_points - patches.n_vertices, 2 * width))
        start, errors, bounds = 0, np.zeros(len(extras)), np.zeros((len(extras), 3 * (d == 3)))
        for indptr, indices, values in self._operators:
            given = indptr, indices, values, high, extras, bounds, errors
            coefficients.extend(*given, start)
            start += len(indptr) - 1
        modes = _aligned((self._n_rows, width))
        shape, each = self.shape, self.shape.REFINED + 2
        fine = _aligned((self._n_fine + len(self._copied) * each, width))
        copies = fine[self._n_fine :].reshape(-1, each, width)
        ids = self.patches.ids.reshape(-1, shape.POINTS)
        coefficients.copies(ids, shape.OWN, self._copied, high, extras, copies)
        sums = np.empty((coefficients.SIX, evaluation.LANES))
        for kind, table in enumerate(self._sectors):
            begin, size, patch = kinds[
                kind, [evaluation.MODES, evaluation.ROWS, evaluation.PATCH]
            ].tolist()
            if table is None or begin < 0:
                continue
            ids = self._controls[kind]
            blocks = modes[begin : begin + len(ids) * (size + 3)].reshape(-1, size + 3, width)
            matrix = _projections(table, shape, self.cover.splines)
            near = np.zeros(matrix.shape[1] * evaluation.LANES)
            grids = np.zeros((len(ids), 2, width))  # no refined points, which are not read
            if self.cover.splines:
                grids = fine[patch * each : (patch + len(ids)) * each].reshape(-1, each, width)
            coefficients.coefficients(
                ids, high, extras, errors, matrix, blocks, grids, near, sums,
            )  # fmt: skip
            if isinstance(table, Monomials):  # polynomials are known whichever of them comes first
                blocks[:, -1, 1] = 1
        return evaluation.Points(high, extras, errors, modes.reshape(-1), fine)

    @cached_property
    def _operators(self) -> list[tuple[Array, Array, Array]]:
        """Rows of control points beyond the cage, as kernels take them."""
        return [
            (x.indptr.astype(np.int64), x.indices.astype(np.int64), x.data)
            for x in self._patches.extras
        ]

    @cached_property
    def _cover_block(self) -> Block:
        """What kernels know whatever the points."""
        from limitsurf._kernels.evaluation import block

        return block(self.patches, self.tables)

    @cached_property
    def _columns(self) -> rows.Controls:
        from limitsurf._kernels import evaluation, rows

        patches, kinds = self._patches, self.tables.kinds
        special = self._controls[STRIP + 1 :]
        first = np.cumsum(
            [0] * (STRIP + 2) + [control.size for control in special[:-1]], dtype=np.int64
        )
        most = int(kinds[:, evaluation.SIZE].max()) + 1
        wide = -(-most // rows.EIGHT) * rows.EIGHT
        left = np.zeros((len(kinds), most, wide))
        for kind, table in enumerate(self._sectors):
            if table is not None and kinds[kind, evaluation.MODES] >= 0:
                left[kind, : table.size, : table.size] = _left(table)
        extra, _ = self._over_vertices
        return rows.Controls(
            np.concatenate([np.zeros(0, np.int32), *(control.reshape(-1) for control in special)]),
            first,
            left,
            self._own,
            patches.n_vertices,
            extra.indptr.astype(np.int64),
            extra.indices.astype(np.int32),
            extra.data,
        )

    @cached_property
    def _patterns(self) -> rows.Patterns:
        from limitsurf._kernels import evaluation, rows

        controls = self._columns
        known = self.tables.kinds[:, evaluation.MODES] >= 0
        blocks = [self.patches.ids.reshape(-1, self.shape.POINTS)]
        blocks += [ids for ids, kept in zip(self._controls, known, strict=True) if kept]
        one = np.ones(controls.n_vertices, np.int64)
        each = np.concatenate([one, np.diff(controls.indptr)])
        terms = [each[ids].sum(axis=1) for ids in blocks]
        # room enough if no columns are equal; memory beyond what remains is never touched
        most, total = int(sum(map(np.sum, terms))), sum(map(len, blocks))
        forms = np.empty(total, np.int64)
        starts = np.zeros((total + 1, 2), np.int64)
        found = rows.Patterns(forms, np.empty(most, np.int32), np.empty(most, np.uint16), starts)
        seen = np.full(controls.n_vertices, -1, dtype=np.int64)
        room = np.empty((2, max(int(x.max(initial=0)) for x in terms)), np.int32)
        start = number = 0
        for k, ids in enumerate(blocks):
            some = forms[start : start + len(ids)]
            number = rows.patterns(ids, k == 0, controls, some, found, number, seen, room)
            start += len(ids)
        columns, slots = starts[number]
        parts = found.columns[:columns], found.slots[:slots], starts[: number + 1]
        return rows.Patterns(forms, *(part.copy() for part in parts))

    @cached_property
    def _over_vertices(self) -> tuple[Any, Array]:
        """Control points that are not vertices, as sparse rows over these, (m, n_vertices).

        Also which control points combine too many of them, (n_points,) bool: these have no row, and
        what depends on one is one, so that all rows together stay small.
        """
        from scipy.sparse import csr_array, diags_array, eye_array, vstack

        n = self._patches.n_vertices
        parts, wide = [eye_array(n, format="csr")], np.zeros(n, dtype=bool)

        def without(rows: Any, which: Array) -> Any:
            if which.any():
                rows = diags_array((~which).astype(float)).tocsr() @ rows
                rows.eliminate_zeros()
            return rows

        for operator in self._patches.extras:
            touching = np.zeros(operator.shape[0], dtype=bool)
            if wide.any():
                touching = np.add.reduceat(wide[operator.indices], operator.indptr[:-1]) > 0
            found = without(operator, touching) @ vstack(parts, format="csr")
            many = np.diff(found.indptr) > _WIDEST
            parts.append(without(found, many))
            wide = np.concatenate([wide, touching | many])
        return vstack([csr_array((0, n)), *parts[1:]], format="csr"), wide

    @cached_property
    def without_rows(self) -> Array:
        """Patches whose rows of weights only the reference can give, (n_patches,) bool.

        Those with too many control points, or with some that combine too many vertices.
        """
        from limitsurf._kernels import evaluation

        result = np.zeros(len(self.cover.kind), dtype=bool)
        known = self.tables.kinds[:, evaluation.MODES] >= 0
        _, wide = self._over_vertices
        for kind, controls in enumerate(self._controls):
            here = np.flatnonzero(self.cover.kind == kind)
            if kind > STRIP and not known[kind]:
                result[here] = True
            elif wide.any():
                result[here] = wide[controls[self._patches.row[here]]].any(axis=1)
        return result

    def weights(
        self, queries: tuple[Array, Array, Array], terms: Sequence[int], workers: int
    ) -> list[Any] | None:
        """Sparse matrices (Q, vertices) of derivatives at these places in the order of `jet`.

        All have one pattern. None if a query is out of range, or in a patch that only the reference
        knows.
        """
        with _kernels.preparing:
            known = self._cover_block.words, self._columns, self._patterns
        from limitsurf._kernels import evaluation, rows

        total, order = queries[0].size, max(_TOTALS[term] for term in terms)
        chunk = _chunks(queries)
        indptr = np.zeros(total + 1, dtype=np.int64)

        def measure(part: slice) -> int:
            found: int = self.shape.lengths(*chunk(part), *known, order, indptr[1:][part])
            return found

        if any(found < 0 for found in over_chunks(total, workers, measure)):
            return None
        np.cumsum(indptr, out=indptr)
        most = max(int(indptr[-1]), self._patches.n_vertices)
        indices = np.empty(indptr[-1], dtype=np.int32 if most < 2**31 else np.int64)
        # (the C library keeps memory of freed arrays for the next, but not of very large ones)
        data, wanted = [np.empty(indptr[-1]) for _ in terms], np.array(terms, np.int64)
        addresses = np.array([values.ctypes.data for values in data])

        def fill(part: slice) -> None:
            places = indptr[:-1][part], indices, addresses
            room = evaluation.Room.of(self.tables)
            space = rows.Space.of(*known[1:], self.shape.POINTS, len(terms))
            self.shape.fill(*chunk(part), *known, order, wanted, *places, room, space)

        for _ in over_chunks(total, workers, fill):
            pass
        return sharing(indptr, indices, data, (total, self._patches.n_vertices))

    def one(
        self, words: Array, channels: int, query: tuple[int, float, float], given: Asked
    ) -> Array | None:
        """Derivatives, or normals, at one place, (n, 1, channels); words are those of a `block`.

        None if it is out of range, or left to the reference.
        """
        if not 0 <= query[0] < self.patches.n_faces:
            return None
        try:
            room = self._free.pop()
        except IndexError:
            room = np.empty(self._room + 4)
        room[-4], room[-3], room[-2] = query
        _, which, order, normals = given
        out = np.empty((len(which), 1, channels))
        left = self.shape.scattered(room, 1, words, order, which, normals, out, 0)
        self._free.append(room)
        return None if left else out

    def evaluate(
        self,
        words: Array,
        queries: tuple[Array, Array, Array],
        given: Asked,
        out: Results,
        workers: int,
    ) -> Array | None:
        """Write derivatives, or normals, to `out`; words are those of a `block`.

        Queries are faces, u and v of one shape. Returns which of them are left to the reference, or
        None if one is out of range.
        """
        grid = _grid(queries) if queries[0].ndim > 1 else None
        if grid is not None:
            rest = self._gridded(words, grid, given, out, workers)
            if rest is not None:
                face, place = np.divmod(rest, grid[1].size)
                some = grid[0][face], grid[1][place], grid[2][place]
                again = Results.new((len(given.which), len(rest), out.arrays[0].shape[1]))
                left = self._scattered(words, some, given, again, workers)
                for result, part in zip(out.arrays, again.arrays, strict=True):
                    result[rest] = part
                return None if left is None else rest[left]
        return self._scattered(words, queries, given, out, workers)

    def shapes(
        self,
        kernel: str,
        words: Array,
        queries: tuple[Array, Array, Array],
        given: Callable[[], Sequence[Any]],
        workers: int,
    ) -> Array | None:
        """Answer queries by a kernel of ``_kernels/curvature.py``; which are left to the reference.

        Words are those of a `block`; `given` makes what comes between them and the number of the
        first query. Returns None if a query is out of range.
        """
        from limitsurf._kernels import evaluation

        total, chunk, function = queries[0].size, _chunks(queries), getattr(self.shape, kernel)

        def work(part: slice) -> Array | None:
            face, u, v = chunk(part)
            rest, room = np.empty(len(face), dtype=np.int64), evaluation.Room.of(self.tables)
            left = function(face, u, v, words, *given(), part.start, rest, room)
            return None if left < 0 else rest[:left]

        if total <= CHUNK:
            return work(slice(0, total))
        return _joined(over_chunks(total, workers, work))

    def higher(
        self,
        words: Array,
        queries: tuple[Array, Array, Array],
        orders: Sequence[tuple[int, int]],
        channels: int,
        workers: int,
    ) -> tuple[Array, Array | None]:
        """Derivatives of these orders, of one total, (n, Q, channels); else as `shapes`."""
        from limitsurf._kernels import higher

        total, turned = sum(orders[0]), [self._patches.lattice.turned(nu) for nu in orders]
        every = ((total - j, j) for j in range(total + 1))
        terms = [nu for nu in every if not self._native.vanishes(nu)]
        turning = np.zeros((len(self._patches.lattice.gradients), len(orders), higher.TERMS))
        for column, term in enumerate(terms):
            for row, factors in enumerate(turned):
                turning[:, row, column] = factors.get(term, 0)
        out = np.empty((len(orders), queries[0].size, channels))
        wanted = np.array(terms, dtype=np.int64).reshape(-1, 2)

        def given() -> Sequence[Any]:
            sums = np.zeros(higher.TERMS * self.shape.POINTS)
            return total, wanted, turning, self._polynomials, sums, out

        return out, self.shapes("higher", words, queries, given, workers)

    @cached_property
    def _polynomials(self) -> Array:
        """What `polynomials` gives, by the numbers of ``piece_of`` of the kernels."""
        return polynomials(self._native, self._strips, self.shape.DEGREES)

    def _gridded(
        self,
        words: Array,
        grid: tuple[Array, Array, Array],
        given: Asked,
        out: Results,
        workers: int,
    ) -> Array | None:
        """Derivatives, or normals, at all parameters on all faces, (faces,), (places,), (places,).

        None where a face or a parameter is out of range or not finite.
        """
        faces, u, v = grid
        inside = (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)
        if self._patches.lattice.sloped:
            inside &= np.maximum(u, v) - 1 + np.minimum(u, v) <= 0
        if not inside.all() or faces.min() < 0 or faces.max() >= self.patches.n_faces:
            return None
        terms, n = given.terms, len(u)
        weights = self._grid_weights(self.patches.info[faces], u, v, terms)
        position = terms.index((0, 0)) if (0, 0) in terms else -1

        chunk = _chunk(out)

        def work(part: slice) -> Array | None:
            face = np.array(faces[part], dtype=np.int64)
            rest = np.empty(len(face) * n, dtype=np.int64)
            room = np.empty(64), np.empty((6, 3, weights.places))
            queries = slice(part.start * n, part.stop * n)
            into, start = out.place(queries)
            left = self.shape.gridded(
                face, words, *weights, len(terms), n, position, given.normals, into, start // n,
                rest, *room,
            )  # fmt: skip
            out.keep(queries, into)
            return None if left < 0 else rest[:left] + (part.start * n - start)

        return _joined(over_chunks(len(faces), workers, work, max(1, chunk // n)))

    def _grid_weights(
        self, codes: Array, u: Array, v: Array, terms: Sequence[tuple[int, int]]
    ) -> grids.Weights:
        """Weights for derivatives at parameters, for kinds and turns of these packed patches."""
        from limitsurf._kernels import evaluation, grids

        kinds = self.tables.kinds
        places = -(-len(u) // grids.PLACES) * grids.PLACES
        start = np.full((len(kinds), 4), -1, dtype=np.int64)
        parts, at = [np.zeros(0)], 0
        there = np.bincount((codes[codes >= 0] >> evaluation.TURN) & ~np.int64(8))
        for both in np.flatnonzero(there).tolist():
            kind, turn = both >> (evaluation.KIND - evaluation.TURN), both & evaluation.TURNS
            if kind == REGULAR:
                size = self.shape.POINTS
                weights_of = basis.regular_weights(self._spline, FLOAT64)
                if self._strips.both:
                    weights_of = partial(basis.center_weights, self._strips)
                rows = [weights_of(u, v, nu) for nu in terms]
            elif kinds[kind, evaluation.MODES] >= 0:
                size = int(kinds[kind, evaluation.ROWS])
                found = self._eigen_weights(kind, turn, u, v, terms)
                if found is None:
                    continue
                rows = found
            else:
                continue
            table = np.zeros((len(terms), size, places))
            for k, weights in enumerate(rows):
                table[k, : weights.shape[1], : len(u)] = weights.T
            start[kind, turn] = at
            at += table.size
            parts.append(table.reshape(-1))
        return grids.Weights(start, np.concatenate(parts), places)

    def _eigen_weights(
        self, kind: int, turn: int, u: Array, v: Array, terms: Sequence[tuple[int, int]]
    ) -> list[Array] | None:
        """Weights (places, K - 1) of coefficients in each derivative; None where they overflow."""
        table = self._sectors[kind]
        assert table is not None
        lattice = table.sector.lattice
        sides = kernels.coordinates(u, v, lattice.sides)
        s, t = sides[turn], sides[(turn + 1) % len(sides)]
        place = basis.CornerPlace.of(s, t, np.full(len(u), turn), lattice)
        powers = basis.EigenPowers.of(table, place)
        rows = []
        for nu in terms:
            parts = []
            for order, factors in lattice.turned(nu).items():
                if factors[turn]:
                    found = basis.eigen_weights(table, place, powers, order)
                    if np.abs(found.exponent).max() > 900:
                        return None
                    if sum(nu):
                        found.rows[place.level < 0] = _corner_derivative(table, order)
                    scaled = kernels.scale_by_two(found.rows, found.exponent[:, None])
                    parts.append(factors[turn] * scaled)
            rows.append(parts[0] if len(parts) == 1 else np.sum(parts, axis=0))
        return rows

    def _scattered(
        self,
        words: Array,
        queries: tuple[Array, Array, Array],
        given: Asked,
        out: Results,
        workers: int,
    ) -> Array | None:
        """Derivatives, or normals, each query by itself."""
        total, size, chunk = queries[0].size, self._room, _chunk(out)
        scattered, (_, which, order, normals) = self.shape.scattered, given

        def work(part: slice) -> Array | None:
            n = part.stop - part.start
            room, begin = np.empty(size + 4 * n), size
            for x in queries:
                some: Any = x
                if some.ndim > 1:  # (an iterator of its own for each thread)
                    some = some.reshape(-1) if some.flags.c_contiguous else some.flat
                room[begin : begin + n] = some if n == total else some[part]
                begin += n
            into, start = out.place(part)
            left: int = scattered(room, n, words, order, which, normals, into, start)
            out.keep(part, into)
            if left <= 0:
                return None if left else _NONE
            rest: Array = room[-n:][:left].view(np.int64) + (part.start - start)
            return rest

        if total <= chunk:
            return work(slice(0, total))
        return _joined(over_chunks(total, workers, work, chunk))


def _chunk(out: Results) -> int:
    """Queries that are taken at a time; what is copied afterwards stays in the cache."""
    return CHUNK if out.joint is not None else CHUNK >> 3


def _joined(parts: Iterable[Array | None]) -> Array | None:
    """Queries that all chunks leave to others; None if one has a query out of range."""
    found = list(parts)
    if any(part is None for part in found):
        return None
    return np.concatenate([_NONE, *(x for x in found if x is not None)])


def _grid(queries: tuple[Array, Array, Array]) -> tuple[Array, Array, Array] | None:
    """Faces (F,) and parameters (n,), two, if queries are all of these at all of those.

    Broadcasting tells: along the first axes only faces vary, along the others only parameters.
    """
    face, u, v = queries
    for axis in range(1, face.ndim if face.size else 0):
        before, after = range(axis), range(axis, face.ndim)
        if all(face.shape[k] == 1 or u.strides[k] == v.strides[k] == 0 for k in before) and all(
            face.shape[k] == 1 or face.strides[k] == 0 for k in after
        ):
            faces = face[(slice(None),) * axis + (0,) * len(after)].reshape(-1)
            u, v = (np.array(x[(0,) * axis].reshape(-1), dtype=float) for x in (u, v))
            return (faces, u, v) if len(faces) >= _FACES and len(u) in _PLACES else None
    return None


def _chunks(queries: tuple[Array, Array, Array]) -> Callable[[slice], tuple[Array, Array, Array]]:
    """Parts of flattened queries: contiguous, writeable, of one type, whatever was given."""
    types = np.int64, float, float

    def chunk(part: slice) -> tuple[Array, Array, Array]:
        found = []
        for x, dtype in zip(queries, types, strict=True):
            # (an iterator of its own for each thread)
            some = (x.reshape(-1) if x.flags.c_contiguous else x.flat)[part]
            found.append(np.array(some, dtype=dtype))
        face, u, v = found
        return face, u, v

    return chunk


def _aligned(shape: tuple[int, int]) -> Array:
    """Zeros that begin at a cache line."""
    size = shape[0] * shape[1]
    room = np.zeros(size + 8)
    start = -room.ctypes.data // 8 % 8
    return room[start : start + size].reshape(shape)


@lru_cache(maxsize=1024)
def _left(table: tables.EigenTable) -> Array:
    """Left eigenvectors, (K, K)."""
    return np.asarray(table.coefficients(np.eye(table.size)[None])[0])


def _corner_derivative(table: tables.EigenTable, nu: tuple[int, int]) -> Array:
    """Weights (K - 1,) of coefficients in a derivative at the corner; NaN if it has none."""
    if isinstance(table, Monomials):
        return table.corner(nu)
    return basis.corner_derivative(table, nu)


@lru_cache(maxsize=1024)
def _projections(table: tables.EigenTable, shape: Any, refined: bool) -> Array:
    """Left eigenvectors, then points if `refined`, as rows over K control points; filled up.

    The refined points are those of the three regular pieces.
    """
    from limitsurf._kernels.coefficients import SIX

    size, more = table.size, shape.REFINED * refined
    result = np.zeros((-(-(size + more) // SIX) * SIX, _rounded(size)))
    result[:size, :size] = _left(table)
    if refined:
        result[size + shape.PIECES, :size] = table.refined.reshape(-1, size)
    return result


@lru_cache(maxsize=1024)
def _powers(table: tables.EigenTable, lead: int) -> Array:
    """Powers of the ratios of the eigenvalues to number `lead`, (levels, K - 1)."""
    high, low = basis.ratios(table, lead)
    rows = np.concatenate([kernels.power(high, low, n) for n in _levels()])
    rows[np.abs(rows) < 2.0**-1022] = 0  # not worth the time that such numbers take
    return rows


@lru_cache(maxsize=1024)
def _mantissas(table: tables.EigenTable) -> tuple[Array, Array]:
    """Powers of the first eigenvalue as mantissas (levels,) and exponents of two (levels,)."""
    high, low = table.rates[:, 1].tolist()
    powers = [kernels.scaled_power(high, low, n) for n in _levels()]
    mantissas, exponents = zip(*powers, strict=True)
    return np.concatenate(mantissas), np.concatenate(exponents)


def _levels() -> tuple[Array, Array]:
    """Levels whose powers are tabulated: those of all others are products of two."""
    from limitsurf._kernels.evaluation import STEP, STEPS

    return np.arange(STEP), STEP * np.arange(STEPS)


def _rounded(n: int) -> int:
    """Up to whole lanes."""
    from limitsurf._kernels.evaluation import LANES

    return -(-n // LANES) * LANES
