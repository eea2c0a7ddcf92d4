"""Compiled evaluation of scattered queries: each is located, weighted and summed in one pass.

Memory, not arithmetic, is what random queries on a large cage wait for. So what a query needs is
asked for some queries ahead of it. They are taken in blocks, sorted by what their patches are but
otherwise in the order of the caller, and results are written where they belong.

Around a special corner the first halving leads to three regular pieces, three quarters of the
patch, whose control points are kept. Nearer the corner eigenfunctions take over. Where a corner has
no eigenbasis, since too many faces meet, the control points of some more halvings are kept, once
for all its patches; nearer the corner the reference answers.

What a patch is, is packed in one integer, ``row | turn << 32 | far << 35 | kind << 36``; `far` says
that not all its control points are vertices of the cage. ``limitsurf/engine/packing.py`` makes the
arrays. What faces are, is told by the modules `quads` and `triangles`, whose functions and numbers
of equal names are what `evaluator` makes its kernels of.
"""

from __future__ import annotations

from math import cos, sin, sqrt
from typing import Any, NamedTuple

import numpy as np
from numba.core.types import float64, int32, int64
from numpy.typing import NDArray

from limitsurf._kernels.blocks import Block, unpacking, within
from limitsurf._kernels.doubt import NOISE, SCALED
from limitsurf._kernels.jit import (
    bits,
    combination,
    differences,
    inlined,
    lean,
    of_bits,
    outlined,
    prefetch,
    scaling,
)

Array = NDArray[Any]

TURN, FAR, KIND = 32, 35, 36
TURNS = 7  # its bits
STEP = 32  # powers n of eigenvalues are products of those of n % STEP and of n - n % STEP
STEPS = 35  # 2^-1074 is the least float64
TINY = 2.0**-900  # in place of that of the rule, for less room
LANES = 4  # channels that are evaluated at once

# fields of a special kind: number of eigenfunctions but the constant one, and that rounded up to
# whole lanes; first row of its blocks (coefficients from the constant one on, filled up with zeros,
# the control point that they are relative to, and: the largest of them, the first that occurs, the
# largest size of a control point, errors included); numbers of chains and of complex pairs; whether
# odd levels flip normals; number of the first patch in `Points.fine`, or the first row where rings
# are shared; coefficients whose cross product is along the normal at the corner itself, or -1; for
# how many levels control points are kept, and for how many beside sharp sides; the faces around the
# corner where patches share a ring, 0 elsewhere; and for how many levels control points are there
SIZE, ROWS, MODES, CHAINS, PAIRS, FLIP, PATCH, ALONG, ACROSS = range(9)
LEVELS, BESIDE, FACES, READY, FIELDS = range(9, 14)
HEAD = 3  # rows of a level of a shared ring: the limit less the vertex, the vertex, [errors]
FIRST, SECOND = 0, 1  # the eigenvalue that powers are relative to
ROW = (1 << TURN) - 1  # the bits of a packed patch that are its row
QUERIES = 256  # queries that are sorted by what their patches are
AHEAD = 4  # queries that memory is asked for ahead of time; many more at once hinder each other
NEVER = 1 << 40  # more halvings than there are
DEEPEST = 1000  # level beyond which second derivatives are left to the reference
_scale1, _scale3, _scale6 = (scaling(count) for count in (1, 3, 6))
_sum1, _sum3, _sum6 = (combination(count) for count in (1, 3, 6))


class Patches(NamedTuple):
    """What covers the limit faces."""

    info: Array  # (limit faces + 4 splits,) int64: packed patches; -2 - split; -1 without a limit
    n_faces: int
    ids: Array  # flat int32: control points of each regular patch, then of each strip
    strips: Array  # (strips, 2) int64: first piece and depth of their splines
    strip_pieces: Array  # flat: their polynomials
    near: (
        Array  # (rows of ids,) int64: row of a copy of their control points in `Points.fine`, or -1
    )
    halves: int  # whether regular patches are quads of a dual scheme, in four pieces


class Tables(NamedTuple):
    """Eigenbases by kind of patch; W eigenfunctions after the constant one, the last of them 0."""

    kinds: Array  # (kinds, FIELDS) int64
    pieces: Array  # (kinds, 3, monomials, W)
    ratios: Array  # (kinds, 2, STEP + STEPS, W): powers of ratios to the first, second eigenvalue
    inverses: Array  # (kinds, 2): of these eigenvalues
    mantissas: Array  # (kinds, STEP + STEPS): of the first's powers, which are in [0.5, 1)
    exponents: Array  # (kinds, STEP + STEPS) int64: of two, with them
    corners: Array  # (kinds, 6, W): derivatives at the corner itself
    sizes: Array  # (kinds, W): of what is added up to coefficients, of points of size 1
    angles: Array  # (kinds, pairs)
    chains: Array  # (kinds, chains) int64: ends of Jordan chains
    pairs: Array  # (kinds, pairs) int64


class Points(NamedTuple):
    """What is evaluated, in rows of a multiple of four channels."""

    high: Array  # (vertices, width)
    extras: Array  # (other control points, 2 width): each with what rounding took from it
    errors: Array  # (other control points,): what rounding did to them at most, times 1 / NOISE
    modes: Array  # flat: blocks (ROWS + 3, width) of special patches
    # (REFINED + 2 of each patch, width): refined points around special corners, or copies of the
    # control points of others; all relative to an origin, of which the last two rows have what is
    # rounded, and itself. Then of each shared ring `HEAD` rows for the corner itself and for each
    # level, and of each level `BLOCK` rows for each face around, one before and two after these
    fine: Array


class Room(NamedTuple):
    """Where kernels keep what they need for a moment."""

    codes: Array  # by query of a block: patch, parameters in it, and its depth
    depths: Array
    places: Array  # piece + 4 (level + 1) around special corners
    s: Array
    t: Array
    simple: Array  # queries in regular patches as they are, in others, around special corners
    splines: Array
    special: Array
    weights: Array
    found: Array
    near: Array
    rows: Array

    @classmethod
    def of(cls, tables: Tables) -> Room:
        """Enough for these tables."""
        codes, depths, places, simple, splines, special = np.empty((6, QUERIES), dtype=np.int64)
        s, t = np.empty((2, QUERIES))
        rows = np.empty((6 + tables.chains.shape[1], max(6, tables.pieces.shape[3])))
        sums = np.empty(72), np.empty(7 * LANES), np.empty((16, LANES))
        return cls(codes, depths, places, s, t, simple, splines, special, *sums, rows)

    @classmethod
    def size(cls, tables: Tables) -> int:
        """How many numbers of 8 bytes that is."""
        return sum(x.size for x in cls.of(tables))


_ints, _floats, _rows = (within(kind) for kind in (int64[::1], float64[::1], float64[:, ::1]))
_FIELDS = (
    (int64[::1], int64, int32[::1], int64[:, ::1], float64[::1], int64[::1], int64),
    (
        int64[:, ::1], *[float64[:, :, :, ::1]] * 2, *[float64[:, ::1]] * 2, int64[:, ::1],
        float64[:, :, ::1], *[float64[:, ::1]] * 2, *[int64[:, ::1]] * 2,
    ),
    (*[float64[:, ::1]] * 2, *[float64[::1]] * 2, float64[:, ::1]),
)  # fmt: skip


def block(*known: Patches | Tables | Points) -> Block:
    """All that kernels evaluate, patches, tables and points, or the first of these, prepared."""
    return Block(_FIELDS[: len(known)], *known)


# what is in it
patches_of = unpacking(Patches, 0, _FIELDS[0])
tables_of = unpacking(Tables, len(Patches._fields), _FIELDS[1])
points_of = unpacking(Points, len(Patches._fields + Tables._fields), _FIELDS[2])


@inlined
def _room_of(flat: Array, tables: Tables) -> Room:
    """Room at the begin of a flat array, as `Room.of` makes it."""
    wide = max(6, tables.pieces.shape[3])
    at = 8 * QUERIES
    return Room(
        _ints(flat, 0, (QUERIES,)),
        _ints(flat, QUERIES, (QUERIES,)),
        _ints(flat, 2 * QUERIES, (QUERIES,)),
        _floats(flat, 3 * QUERIES, (QUERIES,)),
        _floats(flat, 4 * QUERIES, (QUERIES,)),
        _ints(flat, 5 * QUERIES, (QUERIES,)),
        _ints(flat, 6 * QUERIES, (QUERIES,)),
        _ints(flat, 7 * QUERIES, (QUERIES,)),
        _floats(flat, at, (72,)),
        _floats(flat, at + 72, (7 * LANES,)),
        _rows(flat, at + 72 + 7 * LANES, (16, LANES)),
        _rows(flat, at + 72 + 23 * LANES, (6 + tables.chains.shape[1], wide)),
    )


@outlined
def _scaled_far(x: float, n: int) -> float:
    """``x * 2 ** n``, whatever n is."""
    n = max(-4400, min(4400, n))
    while n > 1023:
        x *= 2.0**1023
        n -= 1023
    while n < -1022:
        x *= 2.0**-1022
        n += 1022
    result: float = x * of_bits((n + 1023) << 52)
    return result


@inlined
def scale_by_two(x: float, n: int) -> float:
    """``x * 2 ** n``."""
    result: float
    if -1022 <= n <= 1023:
        result = x * of_bits((n + 1023) << 52)
        return result
    result = _scaled_far(x, n)
    return result


@inlined
def halvings(x: float, up: bool) -> int:
    """Largest k >= 0 with 2^k x <= 1 (< 1 where `up`, unless x is 1); far for x = 0."""
    if x == 0:
        return NEVER
    n: int = bits(x)
    shift = 0
    if n >> 52 == 0:  # subnormal
        n = bits(x * 2.0**54)
        shift = 54
    k = 1022 - (n >> 52) + shift
    if n & ((1 << 52) - 1) == 0 and not up:
        k += 1
    return max(k, 0)


@inlined
def powered(kind: int, lead: int, level: int, count: int, tables: Tables, rows: Array) -> None:
    """Multiply `count` rows of eigenfunctions by J^level, relative to an eigenvalue."""
    kinds, ratios = tables.kinds, tables.ratios
    chains, wide = kinds[kind, CHAINS], rows.shape[1]
    for c in range(chains):
        # ends of Jordan chains also take from their heads, as these are before
        end, before = tables.chains[kind, c], 0.0
        if level > 0:
            m = level - 1
            before = ratios[kind, lead, m % STEP, end] * tables.inverses[kind, lead] * level
            before *= ratios[kind, lead, STEP + m // STEP, end]
        for r in range(count):
            rows[6 + c, r] = rows[r, end - 1] * before
    table = (kind * 2 + lead) * (STEP + STEPS) * wide
    low, high = table + level % STEP * wide, table + (STEP + level // STEP) * wide
    if count == 1:
        _scale1(rows, kinds[kind, ROWS], ratios, low, high)
    elif count == 3:
        _scale3(rows, kinds[kind, ROWS], ratios, low, high)
    else:
        _scale6(rows, kinds[kind, ROWS], ratios, low, high)
    for c in range(chains):
        for r in range(count):
            rows[r, tables.chains[kind, c]] += rows[6 + c, r]
    for p in range(kinds[kind, PAIRS]):
        first, angle = tables.pairs[kind, p], level * tables.angles[kind, p]
        cosine, sine = cos(angle), sin(angle)
        for r in range(count):
            x, y = rows[r, first], rows[r, first + 1]
            rows[r, first] = x * cosine - y * sine
            rows[r, first + 1] = x * sine + y * cosine


@inlined
def crossed(found: Array, noise: float, other: float, out: Array, query: int) -> bool:
    """The unit vector across both first derivatives; False if rounding errors might decide."""
    x = max(abs(found[4]), abs(found[5]), abs(found[6]))
    y = max(abs(found[8]), abs(found[9]), abs(found[10]))
    if not (x > noise and y > other and x < np.inf and y < np.inf):
        return False
    a, b = 1 / x, 1 / y
    a0, a1, a2 = found[4] * a, found[5] * a, found[6] * a
    b0, b1, b2 = found[8] * b, found[9] * b, found[10] * b
    c0, c1, c2 = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
    length = sqrt(c0 * c0 + c1 * c1 + c2 * c2)
    if not length > SCALED * (noise * a + other * b):
        return False
    scale = 1 / length
    out[0, query, 0], out[0, query, 1], out[0, query, 2] = c0 * scale, c1 * scale, c2 * scale
    return True


@inlined
def _eigen_normal(
    level: int, kind: int, at: int, width: int, tables: Tables, modes: Array, rows: Array,
    found: Array, out: Array, query: int,
) -> bool:  # fmt: skip
    """As `crossed` around a special corner, from rows of order 1; see `basis.eigen_normals`."""
    n = tables.kinds[kind, ROWS]
    size, added = modes[at + (n + 1) * width], modes[at + (n + 1) * width + 2]
    if tables.kinds[kind, SIZE] < 2 or not size > 0:
        return False
    # row 0 is free: rows 1 and 2 are the derivatives
    a, b = rows[1, 0], rows[2, 0]
    if tables.kinds[kind, PAIRS] and tables.pairs[kind, 0] == 0:
        angle = level * tables.angles[kind, 0]
        a = a * cos(angle) - rows[1, 1] * sin(angle)
        b = b * cos(angle) - rows[2, 1] * sin(angle)
    powered(kind, SECOND, level, 3, tables, rows)
    rows[1, 0] = rows[2, 0] = 0.0
    sums = along = across = added_sums = added_along = added_across = 0.0
    for k in range(n):
        ds, dt, more = rows[1, k], rows[2, k], tables.sizes[kind, k]
        rows[0, k] = a * dt - b * ds
        own = abs(a * dt) + abs(b * ds)
        ds, dt = abs(ds), abs(dt)
        sums += own
        along += ds
        across += dt
        added_sums += own * more
        added_along += ds * more
        added_across += dt * more
    _sum3(rows, n, modes, at, width, found)
    ratio = tables.ratios[kind, FIRST, level % STEP, 1]
    ratio *= tables.ratios[kind, FIRST, STEP + level // STEP, 1]
    scale = 1 / size
    c0, c1, c2 = modes[at] * scale, modes[at + 1] * scale, modes[at + 2] * scale
    g0, g1, g2 = found[0] * scale, found[1] * scale, found[2] * scale
    p0, p1, p2 = found[4] * scale, found[5] * scale, found[6] * scale
    q0, q1, q2 = found[8] * scale, found[9] * scale, found[10] * scale
    x = c1 * g2 - c2 * g1 + (p1 * q2 - p2 * q1) * ratio
    y = c2 * g0 - c0 * g2 + (p2 * q0 - p0 * q2) * ratio
    z = c0 * g1 - c1 * g0 + (p0 * q1 - p1 * q0) * ratio
    # (scaled coefficients are at most 1)
    bound = max(abs(c0), abs(c1), abs(c2)) * added_sums + tables.sizes[kind, 0] * sums
    bound = 2 * added * scale * (bound + (along * added_across + added_along * across) * abs(ratio))
    largest = max(abs(x), abs(y), abs(z))
    if not (largest > NOISE * bound and largest < np.inf and bound < np.inf):
        return False
    if tables.kinds[kind, FLIP] and level % 2:
        largest = -largest
    scale = 1 / largest
    x, y, z = x * scale, y * scale, z * scale
    scale = 1 / sqrt(x * x + y * y + z * z)
    out[0, query, 0], out[0, query, 1], out[0, query, 2] = x * scale, y * scale, z * scale
    return True


def control_points(shape: Any) -> tuple[Any, Any, Any, Any]:
    """What finds control points of splines, and asks for their memory.

    Those around special corners, for how many levels they are there, and copies of others.
    """
    size, fine, shared, low_origin = shape.POINTS, shape.REFINED + 2, shape.BLOCK, shape.REFINED
    pieces = np.concatenate([shape.PIECES, shape.AROUND])

    @inlined
    def around(code: int, place: int, tables: Tables) -> tuple[int, int, int]:
        """First row in `Points.fine` of a piece, of its origin, and where its grid begins.

        Rows of patches that share rings are numbers of these times faces, plus positions.
        """
        kind, row, piece = code >> KIND, code & ROW, place & 3
        start, levels = tables.kinds[kind, PATCH], tables.kinds[kind, LEVELS]
        first, head, at = 0, 0, piece * size
        if shared and levels > 1:
            faces, level = tables.kinds[kind, FACES], (place >> 2) - 1
            each = shared * (faces + 3)
            start += row // faces * (HEAD * (levels + 1) + each * levels)
            first = start + HEAD * (levels + 1) + each * level + shared * (row % faces)
            head = start + HEAD * (level + 1)
            at += 3 * size
        else:
            first = (start + row) * fine
            head = first + low_origin
        return first, head, at

    @inlined
    def kept(code: int, tables: Tables) -> int:
        """For how many levels the control points around a special corner are there."""
        kind = code >> KIND
        levels: int = tables.kinds[kind, LEVELS]
        if shared and levels > 1:
            faces = tables.kinds[kind, FACES]
            position = (code & ROW) % faces
            if position == 0 or position == faces - 1:
                levels = tables.kinds[kind, BESIDE]
            levels = min(levels, tables.kinds[kind, READY])
        return levels

    @inlined
    def copied(code: int, patches: Patches) -> int:
        """First row in `Points.fine` of the control points of a spline; -1 if it has none there."""
        first = -1
        if code >> FAR & 1:
            first = patches.near[code & ROW]
        return first

    @inlined
    def fetch(code: int, place: int, patches: Patches, tables: Tables, points: Points) -> None:
        """Prefetch the control points of a spline."""
        width, inner = points.high.shape[1], len(points.high)
        if code >> KIND > 1:
            base, _, at = around(code, place, tables)
            if shared and at >= 3 * size:
                for k in range(at, at + size):
                    prefetch(points.fine, (base + pieces[k]) * width)
                return
        else:
            base = copied(code, patches)
        base *= width
        if base >= 0:
            for line in range(base, base + fine * width, 8):
                prefetch(points.fine, line)
            return
        at = (code & ROW) * size
        for k in range(size):
            number = np.int64(patches.ids[at + k])
            if number < inner:
                prefetch(points.high, number * width)
            else:
                prefetch(points.extras, (number - inner) * 2 * width)

    return around, kept, copied, fetch


def evaluator(shape: Any) -> Any:
    """The kernel that evaluates scattered queries, for faces of a shape."""
    size, own_point = shape.POINTS, shape.OWN
    pieces, shared = np.concatenate([shape.PIECES, shape.AROUND]), shape.BLOCK
    low_origin = shape.REFINED
    same = np.arange(size, dtype=np.int32)
    near = differences(size, own_point)
    located, turned, place_around = shape.located, shape.turned, shape.place_around
    spline, spline_weights, patch_weights = shape.spline, shape.spline_weights, shape.patch_weights
    halved_weights, (around, kept, copied, fetch) = shape.halved_weights, control_points(shape)
    spline_normal, eigenfunctions, write = shape.spline_normal, shape.eigenfunctions, shape.write

    @inlined
    def _ask(
        i: int, n: int, queries: Array, room: Room, patches: Patches, tables: Tables, points: Points
    ) -> None:
        """Prefetch what the splines of queries some way beyond number i need."""
        codes = room.codes
        for j in range(0 if i == 0 else i + 2 * AHEAD, min(i + 2 * AHEAD + 1, n)):
            code = codes[queries[j]]
            if code >> KIND <= 1 and copied(code, patches) < 0:
                prefetch(patches.ids, (code & ROW) * size)
        j = i + AHEAD
        if j >= n or codes[queries[j]] == codes[queries[j - 1]]:
            return
        fetch(codes[queries[j]], room.places[queries[j]], patches, tables, points)

    @outlined
    def _simple(
        simple: int, start: int, words: Array, order: int, which: Array, normals: bool, out: Array,
        rest: Array, left: int, flat: Array,
    ) -> int:  # fmt: skip
        """Queries in regular patches as they are."""
        patches, tables, points = patches_of(words), tables_of(words), points_of(words)
        room = _room_of(flat, tables)
        ids = patches.ids
        weights = room.weights
        found = room.found
        for i in range(simple):
            _ask(i, simple, room.simple, room, patches, tables, points)
            k = room.simple[i]
            at, query = room.codes[k] * size, start + k
            if patches.halves:
                halved_weights(room.s[k], room.t[k], order, weights)
            else:
                spline_weights(room.s[k], room.t[k], order, weights)
            spline(order, normals, points.high, ids, at, 0, 0, weights, found)
            if normals:
                if not spline_normal(weights, found, 0.0, out, query):
                    rest[left] = query
                    left += 1
                continue
            own = np.int64(ids[at + own_point])
            for c in range(3):
                found[c] += points.high[own, c]
            for j in range(len(which)):
                for c in range(3):
                    out[j, query, c] = found[LANES * which[j] + c]
        return left

    @outlined
    def _splines(
        splines: int, start: int, words: Array, order: int, which: Array, normals: bool, out: Array,
        rest: Array, left: int, flat: Array,
    ) -> int:  # fmt: skip
        """Queries in other splines: turned, split, strips, next to special corners."""
        patches, tables, points = patches_of(words), tables_of(words), points_of(words)
        room = _room_of(flat, tables)
        width = points.high.shape[1]
        d = out.shape[2]
        ids = patches.ids
        weights = room.weights
        found = room.found
        inner = len(points.high)
        for i in range(splines):
            _ask(i, splines, room.splines, room, patches, tables, points)
            k = room.splines[i]
            code, query = room.codes[k], start + k
            kind, row, turn = code >> KIND, code & ROW, code >> TURN & TURNS
            s, t, step, piece = room.s[k], room.t[k], room.depths[k], 0
            base, head = -1, 0
            grid, numbers, at = points.high, ids, row * size
            if kind > 1:
                piece = room.places[k] & 3
                base, head, at = around(code, room.places[k], tables)
                grid, numbers = points.fine, pieces
                step += room.places[k] >> 2
            else:
                base = copied(code, patches)
                head = base + low_origin
                s, t = turned(s, t, turn)
                if base >= 0:
                    grid, numbers, at = points.fine, same, 0
            patch_weights(code, s, t, order, patches, weights)
            first = max(base, 0)
            own = first + np.int64(numbers[at + own_point])
            extra = own - inner
            far = base < 0 and code >> FAR & 1
            for channel in range(0, d, LANES):
                column = channel
                if far:
                    near(points.high, points.extras, ids, row * size, channel, room.near)
                    grid, numbers, at, column = room.near, same, 0, 0
                spline(order, normals, grid, numbers, at, first, column, weights, found)
                if normals:
                    error = 0.0
                    if kind > 1 and shared and at >= 3 * size:
                        error = points.fine[head + 2, 0]
                    elif kind > 1:
                        # rows that refine have sums of at most 3, where points are reflected
                        n = tables.kinds[kind, ROWS]
                        block = tables.kinds[kind, MODES] + row * (n + 3)
                        error = 3 * points.modes[(block + n + 2) * width + 2]
                    elif code >> FAR & 1:
                        for j in range(row * size, row * size + size):
                            number = np.int64(ids[j]) - inner
                            if number >= 0:
                                error = max(error, points.errors[number])
                    if not spline_normal(weights, found, error, out, query):
                        rest[left] = query
                        left += 1
                    break
                if base >= 0:
                    for c in range(LANES):
                        value = found[c] + points.fine[own, channel + c]
                        value += points.fine[head, channel + c]
                        found[c] = value + points.fine[head + 1, channel + c]
                elif extra >= 0:
                    for c in range(LANES):
                        value = found[c] + points.extras[extra, width + channel + c]
                        found[c] = value + points.extras[extra, channel + c]
                else:
                    for c in range(LANES):
                        found[c] += points.high[own, channel + c]
                write(order, found, which, turn, piece, 1.0, 0, step, out, query, channel)
        return left

    @outlined
    def _special(
        special: int, start: int, words: Array, order: int, which: Array, normals: bool, out: Array,
        rest: Array, left: int, flat: Array,
    ) -> int:  # fmt: skip
        """Queries nearer to special corners."""
        tables, points = tables_of(words), points_of(words)
        room = _room_of(flat, tables)
        width = points.high.shape[1]
        d = out.shape[2]
        modes = points.modes
        found = room.found
        rows = room.rows
        for i in range(special):
            for j in range(0 if i == 0 else i + AHEAD, min(i + AHEAD + 1, special)):
                code = room.codes[room.special[j]]
                length = (tables.kinds[code >> KIND, ROWS] + 3) * width
                base = tables.kinds[code >> KIND, MODES] * width + (code & ROW) * length
                for line in range(base, base + length, 8):
                    prefetch(modes, line)
            k = room.special[i]
            code, query = room.codes[k], start + k
            kind, turn = code >> KIND, code >> TURN & TURNS
            n, at = tables.kinds[kind, ROWS], tables.kinds[kind, MODES]
            block = (at + (code & ROW) * (n + 3)) * width
            piece, level = room.places[k] & 3, (room.places[k] >> 2) - 1
            S, T = room.s[k], room.t[k]
            if shared and tables.kinds[kind, READY] and level < 0 and order == 0:
                _, head, _ = around(code, room.places[k], tables)
                for j in range(len(which)):
                    for c in range(d):
                        out[j, query, c] = points.fine[head, c] + points.fine[head + 1, c]
                continue
            # what the reference does: coefficients too many to keep, degenerate points, second
            # derivatives where what they come from is nothing beside the first eigenfunction
            if normals and level < 0 and at >= 0:
                # (where there is none, or degenerate points hide it, the reference knows why)
                along, across = tables.kinds[kind, ALONG], tables.kinds[kind, ACROSS]
                for c in range(3):
                    found[LANES + c] = modes[block + along * width + c]
                    found[2 * LANES + c] = modes[block + across * width + c]
                noise = NOISE * modes[block + (n + 2) * width + 2]
                if along >= 0:
                    noise, other = (
                        noise * tables.sizes[kind, along - 1],
                        noise * tables.sizes[kind, across - 1],
                    )
                    if crossed(found, noise, other, out, query):
                        continue
            if (
                at < 0
                or modes[block + (n + 2) * width + 1] != 1
                or (normals and level < 0)
                or (order == 2 and level > DEEPEST)
            ):
                rest[left] = query
                left += 1
                continue
            mantissa, exponent, step = 1.0, 0, room.depths[k]
            if level < 0:
                for j in range(6):
                    for c in range(n):
                        rows[j, c] = tables.corners[kind, j, c]
            else:
                eigenfunctions(order, kind, piece, S, T, tables, rows)
                if normals:
                    if not _eigen_normal(
                        level, kind, block + width, width, tables, modes, rows, found, out, query
                    ):
                        rest[left] = query
                        left += 1
                    continue
                count = (order + 1) * (order + 2) // 2
                powered(kind, FIRST, level, count, tables, rows)
                mantissa = tables.mantissas[kind, level % STEP]
                mantissa *= tables.mantissas[kind, STEP + level // STEP]
                exponent = tables.exponents[kind, level % STEP]
                exponent += tables.exponents[kind, STEP + level // STEP]
                step += level + 1
            for channel in range(0, d, LANES):
                at = block + channel
                if order == 0:
                    _sum1(rows, n, modes, at + width, width, found)
                elif order == 1:
                    _sum3(rows, n, modes, at + width, width, found)
                else:
                    _sum6(rows, n, modes, at + width, width, found)
                if exponent > -1000:
                    scale = mantissa * of_bits((exponent + 1023) << 52)
                    for c in range(LANES):
                        found[c] *= scale
                else:
                    for c in range(LANES):
                        found[c] = scale_by_two(found[c] * mantissa, exponent)
                for c in range(LANES):
                    found[c] = (found[c] + modes[at + c]) + modes[at + (n + 1) * width + c]
                write(
                    order, found, which, turn, piece, mantissa, exponent, step, out, query, channel
                )
        return left

    @lean
    def scattered(
        room: Array, n: int, words: Array, order: int, which: Array, normals: bool, out: Array,
        start: int,
    ) -> int:  # fmt: skip
        """Derivatives, or unit normals, at n places: queries number `start` to `start + n`.

        The last 4 n numbers of the flat `room` are their faces, u and v, and free; before them is
        room for `Room`. Words are those of a block of patches, tables and points. Results are
        written to ``out[k, query, channel]`` for the derivatives `which` (places in the order of
        `LimitSurface.jet`), or to ``out[0]``; NaN where u or v is not finite and on faces without a
        limit. Queries that are left to the reference are written over the last n numbers of the
        room, as integers; returned is how many there are, or -1 if a face or a parameter is out of
        range.
        """
        patches, tables = patches_of(words), tables_of(words)
        own = _room_of(room, tables)
        first, d, left = len(room) - 4 * n, out.shape[2], 0
        face, u = _floats(room, first, (n,)), _floats(room, first + n, (n,))
        v, rest = _floats(room, first + 2 * n, (n,)), _ints(room, first + 3 * n, (n,))
        codes, places, ss, ts = own.codes, own.places, own.s, own.t
        for begin in range(0, n, QUERIES):
            size = min(QUERIES, n - begin)
            simple = splines = special = 0
            for k in range(size):
                if begin + k + 4 * AHEAD < n:
                    prefetch(patches.info, np.int64(face[begin + k + 4 * AHEAD]))
                number = face[begin + k]
                code, depth, s, t, fine = located(
                    np.int64(number) if 0 <= number < patches.n_faces else -1,
                    u[begin + k], v[begin + k], patches,
                )  # fmt: skip
                if not fine:
                    return -1
                codes[k], own.depths[k], ss[k], ts[k] = code, depth, s, t
                if code < 0:
                    for j in range(len(out)):
                        for c in range(d):
                            out[j, start + begin + k, c] = np.nan
                elif code >> KIND > 1:
                    turn = code >> TURN & TURNS
                    s, t = turned(s, t, turn)
                    level, piece, ss[k], ts[k] = place_around(s, t, turn)
                    places[k] = piece + 4 * (level + 1)
                    if 0 <= level < kept(code, tables):
                        own.splines[splines] = k
                        splines += 1
                    else:
                        own.special[special] = k
                        special += 1
                elif code > ROW or depth or d != 3:
                    own.splines[splines] = k
                    splines += 1
                else:
                    own.simple[simple] = k
                    simple += 1

            given = words, order, which, normals, out, rest
            left = _simple(simple, start + begin, *given, left, room)
            left = _splines(splines, start + begin, *given, left, room)
            left = _special(special, start + begin, *given, left, room)
        return left

    return scattered
