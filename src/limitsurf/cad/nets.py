"""Control nets of spline faces from their Bezier pieces: one sparse matrix for all faces cut alike.

``derivations/spline_faces.py`` derives them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from math import comb, factorial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.pieces import bernstein
from limitsurf.query.polynomials import Form

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from limitsurf.query.bezier import BezierPatches
    from limitsurf.scheme.lattice import Lattice

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Cut:
    """How limit faces are cut into pieces, those that are cut alike together.

    Attributes
    ----------
    faces : (m,) int
        Places among the limit faces that were cut.
    cells, rest : (m, c) and (m, r) int
        Their pieces, and what remains at special corners, in the order of `BezierPatches`.
    origin, size : (c, 2)
        Of the pieces of each.
    rest_origin, rest_size : (r, 2)
    corner : (r,) int
    """

    faces: Array
    cells: Array
    rest: Array
    origin: Array
    size: Array
    rest_origin: Array
    rest_size: Array
    corner: Array


def alike(patches: BezierPatches, faces: Array, smooth: Array) -> Iterator[Cut]:
    """Those of limit faces (f,), sorted, that are cut alike; those without pieces are in none.

    And in which what remains is `smooth` (r,) at the same corners.
    """
    rest = patches.rest
    begin, end = (np.searchsorted(patches.face, faces, side) for side in ("left", "right"))
    first, last = (np.searchsorted(rest.face, faces, side) for side in ("left", "right"))
    rows = np.concatenate([patches.origin, patches.size], axis=1)
    more = np.concatenate([rest.origin, rest.size], axis=1)
    counts = np.stack([end - begin, last - first], axis=1)
    kinds, inverse = np.unique(counts, axis=0, return_inverse=True)
    for k, (c, r) in enumerate(kinds.tolist()):
        some = np.flatnonzero(inverse.ravel() == k)
        if not c + r:
            continue
        cells, left = (start[some, None] + np.arange(n) for start, n in ((begin, c), (first, r)))
        both = rows[cells].reshape(len(some), -1), more[left].reshape(len(some), -1)
        keys = np.concatenate([*both, rest.corner[left], smooth[left]], axis=1)
        for here in _equal(keys):
            one = here[0]
            at, on = cells[one], left[one]
            yield Cut(
                some[here], cells[here], left[here], patches.origin[at], patches.size[at],
                rest.origin[on], rest.size[on], rest.corner[on],
            )  # fmt: skip


def _equal(keys: Array) -> list[Array]:
    """Which rows of keys (n, k) are equal, together."""
    bits = np.ascontiguousarray(keys + 0.0).view(np.uint64)  # of zeros of one sign
    with np.errstate(over="ignore"):
        random = np.random.default_rng(0).integers(1, 2**63, keys.shape[1], dtype=np.uint64)
        mixed = ((bits ^ (bits >> np.uint64(31))) * (2 * random + np.uint64(1))).sum(axis=1)
    _, first, inverse = np.unique(mixed, return_index=True, return_inverse=True)
    inverse = inverse.ravel()
    if not (keys == keys[first[inverse]]).all():  # as good as never
        _, inverse = np.unique(keys, axis=0, return_inverse=True)
        inverse = inverse.ravel()
    order = np.argsort(inverse, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(inverse[order])) + 1)


# ---------------------------------------------------------------------- rectangles


def breaks(cut: Cut, capped: Array | None = None) -> tuple[Array, Array]:
    """The lines along u and v that bound pieces, sorted.

    Twice where what remains at corners that are `capped` (r,) ends, and cells of twice its size.
    """
    ends = [cut.origin, cut.origin + cut.size, cut.rest_origin, cut.rest_origin + cut.rest_size]
    u, v = (np.unique(x) for x in np.concatenate(ends).T)
    if capped is None or not capped.any():
        return u, v
    found = []
    for axis, line in enumerate((u, v)):
        low, size = cut.rest_origin[capped, axis], cut.rest_size[capped, axis]
        at_zero = low < 0.5
        double = np.concatenate([
            np.where(at_zero, low + size, low), np.where(at_zero, low + 2 * size, low - size)
        ])  # fmt: skip
        inner = np.setdiff1d(double, [line[0], line[-1]])
        found.append(np.sort(np.concatenate([line, inner])))
    return found[0], found[1]


def clamped(lines: Array, degree: int) -> Array:
    """Knots with these breaks."""
    return np.concatenate([np.repeat(lines[0], degree), lines, np.repeat(lines[-1], degree)])


def net(cut: Cut, lattice: Lattice, degree: int) -> csr_array[Any]:
    """Control points from the coefficients of the pieces, then the limits of special corners.

    (nu * nv, c * (degree + 1)^2 + r), where v counts fastest. What remains at special corners has
    those limits, and goes on from the pieces around.
    """
    from scipy.sparse import csr_array, eye_array, vstack

    none = np.zeros(len(cut.corner), dtype=bool)
    found, whole, r = of_pieces(cut, degree, none), len(cut.origin) * (degree + 1) ** 2, len(none)
    if not r:
        return found
    every = eye_array(whole, whole + r, format="csr")
    return csr_array(found @ vstack([every, caps(cut, lattice, degree)], format="csr"))


def of_pieces(cut: Cut, degree: int, capped: Array) -> csr_array[Any]:
    """Control points from the coefficients of the pieces, then of what remains.

    (nu * nv, (c + r) * (degree + 1)^2), where v counts fastest. Each is the blossom of the piece
    next to its knots, with which it has most in common; of what remains at special corners where
    it has no other, or as good as any where that is `capped` (r,), as those corners themselves.
    """
    from scipy.sparse import csr_array

    lines = breaks(cut)
    owner = _owner(cut, lines)
    knots = [clamped(x, degree) for x in breaks(cut, capped)]
    n = [len(x) - degree - 1 for x in knots]
    # by control point along a line: intervals of its support, and weights there
    spans = [_supports(x, line, degree) for x, line in zip(knots, lines, strict=True)]
    pieces = owner[spans[0][:, None, :, None], spans[1][None, :, None, :]]
    origin = np.concatenate([cut.origin, cut.rest_origin])
    step = np.concatenate([cut.size, cut.rest_size])
    free = np.concatenate([np.ones(len(cut.origin), dtype=bool), capped])
    cost, weights = np.where(free[pieces], 1.0, np.inf), []
    for axis in (0, 1):
        own = knots[axis][np.arange(n[axis])[:, None] + np.arange(1, degree + 1)]
        own = own[:, None] if axis == 0 else own[None, :]
        at = (own[:, :, None, None] - origin[pieces, axis][..., None]) / step[pieces, axis, None]
        weights.append(at)  # (nu, nv, a, b, degree)
        cost = cost * (np.abs(at) + np.abs(1 - at)).prod(axis=-1)
    best = cost.reshape(*n, -1).argmin(axis=2)
    chosen = np.take_along_axis(pieces.reshape(*n, -1), best[..., None], axis=2)[..., 0]
    one, other = (
        _blossom(np.take_along_axis(x.reshape(*n, -1, degree), best[..., None, None], axis=2))
        for x in weights
    )
    size = (degree + 1) ** 2
    values = one[:, :, 0, :, None] * other[:, :, 0, None, :]
    columns = chosen[:, :, None] * size + np.arange(size)
    rows = np.repeat(np.arange(n[0] * n[1]), size)
    shape = n[0] * n[1], len(origin) * size
    found = csr_array((values.ravel(), (rows, columns.ravel())), shape=shape)
    found.eliminate_zeros()
    return found


def _supports(knots: Array, lines: Array, degree: int) -> Array:
    """Intervals between lines in the support of each control point along a line, (n, degree + 1).

    Where double knots leave fewer, some are there more than once.
    """
    at = np.arange(len(knots) - degree - 1)[:, None] + np.arange(degree + 1)
    first = np.searchsorted(lines, knots, side="right") - 1
    last = np.searchsorted(lines, knots, side="left") - 1
    found = np.clip(first[at], first[at[:, :1]], last[at[:, :1] + degree + 1])
    return np.asarray(np.clip(found, 0, len(lines) - 2))


def around(cut: Cut, lattice: Lattice, k: int) -> list[int]:
    """The pieces around what remains at special corner k.

    Along the side that begins there, across from it, and along the side that ends there.
    """
    corners, at = np.array(lattice.corners), int(cut.corner[k])
    origin, size = cut.rest_origin[k], cut.rest_size[k]
    a, b, d = (origin + size * corners[(at + m) % len(corners)] for m in (0, 1, -1))
    here, middles = origin + size / 2, cut.origin + cut.size / 2
    places = here + b - a, here + b - a + d - a, here + d - a
    return [int(np.abs(middles - place).sum(axis=1).argmin()) for place in places]


def line(breaks: Array, lines: Array, degree: int) -> tuple[Array, Array]:
    """For each control point of a curve with these breaks, the piece it follows from, and weights.

    (n,) and (n, degree + 1). Pieces end at all breaks, and may end at more `lines`.
    """
    knots = clamped(breaks, degree)
    n = len(knots) - degree - 1
    first = np.searchsorted(lines, knots[:n], side="right") - 1
    last = np.searchsorted(lines, knots[degree + 1 :], side="left") - 1
    spans = np.minimum(first[:, None] + np.arange((last - first).max() + 1), last[:, None])
    own = knots[np.arange(n)[:, None] + np.arange(1, degree + 1)]
    at = (own[:, None] - lines[spans][..., None]) / np.diff(lines)[spans][..., None]
    best = (np.abs(at) + np.abs(1 - at)).prod(axis=2).argmin(axis=1)
    every = np.arange(n)
    return spans[every, best], _blossom(at[every, best])


def _owner(cut: Cut, lines: tuple[Array, Array]) -> Array:
    """The piece at each rectangle between lines, (m, n); what remains is numbered after pieces."""
    found = np.full([len(x) - 1 for x in lines], -1)
    origin = np.concatenate([cut.origin, cut.rest_origin])
    end = origin + np.concatenate([cut.size, cut.rest_size])
    low, high = (
        [np.searchsorted(x, ends[:, k]) for k, x in enumerate(lines)] for ends in (origin, end)
    )
    wide, deep = high[0] - low[0], high[1] - low[1]
    which, step = _counted(wide * deep)
    i, j = np.divmod(step, deep[which])
    found[low[0][which] + i, low[1][which] + j] = which
    return found


def _counted(count: Array) -> tuple[Array, Array]:
    """Each number so many times, and how often it was there before."""
    which = np.repeat(np.arange(len(count)), count)
    return which, np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)


def _blossom(at: Array) -> Array:
    """Weights (..., degree + 1) of Bernstein coefficients for arguments (..., degree)."""
    degree = at.shape[-1]
    found = np.zeros((*at.shape[:-1], degree + 1))
    found[..., 0] = 1
    for k in range(degree):
        x = at[..., k, None]
        step = (1 - x) * found
        step[..., 1:] += x * found[..., :-1]
        found = step
    return found


# ---------------------------------------------------------------------- triangles


@lru_cache(maxsize=16)
def square_of_triangle(degree: int) -> Array:
    """Onto the coefficients (i, j) of a square, v fastest, from those of a triangle.

    The polynomial is the same; the square goes on beyond the triangle's long side.
    """
    exponents = [(i, j) for j in range(degree + 1) for i in range(degree + 1 - j)]
    number = {place: k for k, place in enumerate(exponents)}
    found = np.zeros((degree + 1, degree + 1, len(exponents)))
    for k in range(degree + 1):
        for m in range(degree + 1):
            for both in range(max(0, k + m - degree), min(k, m) + 1):
                share = comb(k, both) * comb(degree - k, m - both) / comb(degree, m)
                # a place at (1, 1) is (1, 0) + (0, 1) - (0, 0)
                for a in range(both + 1):
                    for b in range(both + 1 - a):
                        c = both - a - b
                        ways = factorial(both) // (factorial(a) * factorial(b) * factorial(c))
                        at = number[k - both + a, m - both + b]
                        found[k, m, at] += share * ways * (-1) ** c
    return found.reshape(-1, len(exponents))


def caps(cut: Cut, lattice: Lattice, degree: int) -> csr_array[Any]:
    """Coefficients of what remains at special corners, from those of the pieces around, and limits.

    (r * n, c * n + r): the pieces across from the corner, in squares those beside it, go on into
    the rest; on sides of triangles those beside; and the corner is its limit.
    """
    from scipy.sparse import csr_array

    exponents = Form.of(lattice, degree).exponents
    n, r, c, sides = len(exponents), len(cut.corner), len(cut.origin), lattice.face_size
    rows, columns, values = [], [c * n + np.arange(r)], [np.ones(r)]
    corners = np.array(lattice.corners)
    middle = corners.mean(axis=0)
    middles = cut.origin + cut.size * middle
    for k in range(r):
        at = int(cut.corner[k])
        rows.append(k * n + np.flatnonzero(_away(lattice, exponents, at, 0)))
    for k in range(r):
        origin, size, at = cut.rest_origin[k], cut.rest_size[k], int(cut.corner[k])
        here = origin + size * middle
        a, b, d = (origin + size * corners[(at + m) % sides] for m in (0, 1, -1))
        places = (b + d - a - a) / 3 * lattice.sloped + here, here + b - a, here + d - a
        for m, place in enumerate(places):
            which = _away(lattice, exponents, at, m + 1)
            if not which.any():
                continue
            one = int(np.abs(middles - place).sum(axis=1).argmin())
            if not np.allclose(middles[one], place, rtol=0, atol=1e-9 * np.abs(size).max()):
                raise AssertionError("there is no ring around what remains")
            frame = np.zeros((1, 3, 2))
            frame[0, 0] = (origin - cut.origin[one]) / cut.size[one]
            frame[0, [1, 2], [0, 1]] = size / cut.size[one]
            matrix = bernstein.blossoms(exponents, frame)[0]
            i, j = np.nonzero(which[:, None] & (matrix != 0))
            rows.append(k * n + i)
            columns.append(one * n + j)
            values.append(matrix[i, j])
    known = np.concatenate(rows), np.concatenate(columns)
    return csr_array((np.concatenate(values), known), shape=(r * n, c * n + r))


def _away(lattice: Lattice, exponents: Array, corner: int, which: int) -> Array:
    """Which coefficients of a rest come from the limit (0) or the piece across (1) or beside it."""
    degree, following = int(exponents.max()), (corner + 1) % lattice.face_size
    at, ahead = np.array(lattice.corners)[[corner, following]] * degree
    if not lattice.sloped:
        along = int(at[0] == ahead[0])  # the axis of the side that begins at the corner
        first, second = (
            np.abs(exponents[:, along] - at[along]),
            np.abs(exponents - at)[:, 1 - along],
        )
        return np.asarray([
            (first == 0) & (second == 0), np.zeros(len(first), dtype=bool), first > 0,
            (first == 0) & (second > 0),
        ][which])  # fmt: skip
    powers = np.column_stack([degree - exponents.sum(axis=1), exponents])
    away, next_to = degree - powers[:, corner], powers[:, following] == 1
    return np.asarray([
        away == 0, away > 1, (away == 1) & next_to, (away == 1) & ~next_to,
    ][which])  # fmt: skip
