"""Basis functions of a patch: (patch kind, s, t, derivative) to weights of its control points.

A regular patch is a piece of the scheme's spline; along a semi-sharp crease of quads it is one in s
and, in t, a spline of the crease's own. Around a special corner at (0, 0) the limit is

    x(s, t) = b(S, T) P A' A^n C,    A^n = V J^n V^-1,

where (S, T) are the parameters within the regular piece P that holds (s, t) after n halvings
towards the corner, b are the weights of the spline, A' is one more step of refinement and C are
the control points (Stam 1998, section 4; ``derivations/eigenstructure.py``). In float64
``b P A' V`` is a polynomial in S and T with tabulated coefficients, exactly 0 where they should be;
the powers of the eigenvalues are taken relative to the largest that matters and the common scale is
kept apart, so that every n costs the same and nothing overflows before the result does. Rationals,
whose field does not hold the eigenvalues, take n steps of A instead.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache, partial
from math import comb, factorial, lcm, perm
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import numbers
from limitsurf._kernels import reference as kernels
from limitsurf.corner_places import CornerPlace as CornerPlace
from limitsurf.numbers import NumberType
from limitsurf.tables import EigenTable, RationalTable, StripTables

if TYPE_CHECKING:
    from limitsurf.scheme.lattice import Lattice
    from limitsurf.scheme.spline import Spline

Array = NDArray[Any]
Order = tuple[int, int]

NOISE = kernels.NOISE


@dataclass(frozen=True)
class EigenWeights:
    """Weights in terms of eigencoefficients c = V^-1 C, scaled: ``2**exponent * (rows @ c[1:])``.

    To a position (`with_limit`) the coefficient c[0], the limit of the corner, is added.
    """

    rows: Array
    exponent: Array
    with_limit: bool


@dataclass(frozen=True)
class EigenPowers:
    """J^n divided by the n-th power of its eigenvalue number `lead`, for each query.

    All eigenvalues before the lead, but the first, are taken to have coefficients 0.

    Attributes
    ----------
    lead : int
    level : (Q,)
        n, 0 at the corner itself.
    diagonal : (Q, K - 1)
        Powers of the ratios of the eigenvalues after the first.
    chained : (Q, chains)
        The entries beside the diagonal, ``n ratio^(n - 1) / eigenvalue[lead]``.
    turned : (2, Q, pairs)
        Cosines and sines by which complex pairs are turned.
    """

    lead: int
    level: Array
    diagonal: Array
    chained: Array
    turned: Array

    @classmethod
    def of(cls, table: EigenTable, place: CornerPlace, lead: int = 1) -> EigenPowers:
        """Powers at the levels of `place`."""
        levels, which = np.unique(np.maximum(place.level, 0), return_inverse=True)
        high, low = ratios(table, lead)
        heads = table.chains - 1
        before = kernels.power(high[heads], low[heads], np.maximum(levels - 1, 0))
        chained = levels[:, None] * before / table.rates[0, lead]
        angle = levels[:, None] * table.angles
        turned = np.stack([np.cos(angle), np.sin(angle)])[:, which]
        diagonal = kernels.power(high, low, levels)
        return cls(lead, levels[which], diagonal[which], chained[which], turned)

    def __getitem__(self, here: Array) -> EigenPowers:
        """The powers at some queries, by mask or index."""
        chosen = self.level[here], self.diagonal[here], self.chained[here], self.turned[:, here]
        return EigenPowers(self.lead, *chosen)


@lru_cache(maxsize=1024)
def ratios(table: EigenTable, lead: int) -> Array:
    """Ratios of the eigenvalues after the first to number `lead`, high and low, (2, K - 1).

    Zero for those before the lead, and to one that is 0.
    """
    exact = _exact_eigenvalues(table)
    zero, whole = Fraction(0), exact[lead]
    return _high_and_low(
        [x / whole if k >= lead and whole else zero for k, x in enumerate(exact)][1:]
    )


@lru_cache(maxsize=1024)
def _powers(spline: Spline, nu: Order) -> tuple[Array, Array, Array, tuple[int, int]]:
    """What the `nu`-th derivative leaves of a piece's monomials, and the highest exponents.

    The exponents (terms,) of S and T, and which of `Spline.exponents` they come from.
    """
    i, j = np.array(spline.exponents).T
    kept = np.flatnonzero((i >= nu[0]) & (j >= nu[1]))
    i, j = i[kept] - nu[0], j[kept] - nu[1]
    return i, j, kept, (int(i.max(initial=0)), int(j.max(initial=0)))


@lru_cache(maxsize=1024)
def _piece_derivatives(table: EigenTable, nu: Order) -> Array:
    """Polynomials in S, T of derivatives of the eigenfunctions on their pieces.

    Of order `nu` in the directions of s and t, against which a flipped piece has S and T:
    (pieces, terms, K - 1) in the order of `_powers`, without the constant eigenfunction.
    """
    i, j, kept, _ = _powers(table.scheme.spline, nu)
    found = table.pieces[:, kept, 1:]
    for exponents, order in ((i, nu[0]), (j, nu[1])):
        found = found * np.array([perm(k + order, order) for k in exponents.tolist()])[:, None]
    signs: Array = np.array([(-1.0) ** (p.turned * sum(nu)) for p in table.places])
    return np.ascontiguousarray(found * signs[:, None, None])


def side_piece(lattice: Lattice, axis: int, fine: bool = False) -> int:
    """The piece at the far end of the side t = 0, or s = 0."""
    pieces, far = (lattice.fine_pieces, 3) if fine else (lattice.pieces, 1)
    return [piece.origin for piece in pieces].index(((far, 0), (0, far))[axis])


@lru_cache(maxsize=1024)
def _along_sides(table: EigenTable, nu: Order) -> Array:
    """Those polynomials on the side t = 0 if nu = (i, 0), on s = 0 if (0, j): (powers, K - 1).

    Of two pieces along it that at the far end, then the powers of the other, the first of which is
    what it has more.
    """
    axis = int(nu[1] > 0)
    on_side = _powers(table.scheme.spline, nu)[1 - axis] == 0
    fine = table.halvings == 2
    both = _piece_derivatives(table, nu) * (2.0 ** sum(nu) if fine else 1)
    far = both[side_piece(table.sector.lattice, axis, fine), on_side]
    if not fine:
        return np.asarray(far)
    origins = [piece.origin for piece in table.places]
    near = both[origins.index(((2, 0), (0, 2))[axis]), on_side].copy()
    near[0] -= far[0]
    noise = NOISE * np.abs(far[0])
    near[0, np.abs(near[0]) <= noise] = 0
    return np.concatenate([far, near])


@lru_cache(maxsize=1024)
def corner_derivative(table: EigenTable, nu: Order) -> Array:
    """Weights (K - 1,) of the eigencoefficients in a derivative at the corner; NaN if it has none.

    It is 0 where it tends to 0 from everywhere; else one along a side exists if the limit does, as
    on sharp creases, which are splines.
    """
    nothing = np.zeros(table.size - 1)
    order = sum(nu)
    growth = 2.0**order * np.abs(table.rates[0, 1:])
    if not len(_powers(table.scheme.spline, nu)[2]) or (growth < 1).all():
        return nothing
    if min(nu) > 0:
        return np.full_like(nothing, np.nan)
    side = _along_sides(table, nu)
    seen = (side != 0).any(axis=0)
    heads = table.chains - 1
    grows = seen & (growth > 1)
    grows[heads] |= seen[heads - 1] & (growth[heads] >= 1)
    varies = (side[1:] != 0).any(axis=0) & (growth == 1)
    if (grows | varies).any():
        return np.full_like(nothing, np.nan)
    return np.where(growth == 1, 2.0**order * side[0], 0)


@lru_cache(maxsize=1024)
def corner_directions(table: EigenTable, way: tuple[int, int]) -> Array:
    """Weights whose sums point along the limit of ``a d/ds + b d/dt``, (2, K - 1); NaN if none.

    For `way` (a, b) along a side that is the limit along it; for others, which lead out of the
    face, the one towards the corner along s = t: at smooth vertices, by symmetry, that is also the
    sum of the limits along both sides. Weights are those of the eigenfunctions that fall most
    slowly there, in the first row; where that sum is 0 since the head of a Jordan chain has no part
    in the points, the other row.
    """
    side, far = _ahead(table, way)
    heads, values = table.chains - 1, table.rates[0, 1:]
    seen = (side != 0).any(axis=0)
    falling = np.abs(values) == np.abs(values[seen]).max(initial=0)
    if not seen.any() or (values[falling & seen] < 0).any():
        return np.full((2, len(values)), np.nan)
    plain = np.where(falling, far, 0)
    chained = heads[falling[heads] & seen[heads - 1]]
    if not len(chained):
        return np.array([plain, plain])
    first = np.zeros_like(far)
    first[chained] = far[chained - 1]
    return np.array([first, plain])


def _ahead(table: EigenTable, way: tuple[int, int]) -> tuple[Array, Array]:
    """Derivatives along `way` of the eigenfunctions on the line that `corner_directions` takes.

    Polynomials (powers, K - 1) on a piece, and their values (K - 1,) halfway between two rings.
    """
    if 0 in way:
        axis = int(way[0] == 0)
        side = sum(way) * _along_sides(table, ((1, 0), (0, 1))[axis])
        return side, side[: len(side) // table.halvings].sum(axis=0)  # at the far end of the side
    # in the piece between the others, whose corner 0 is where s and t are 1/2
    lattice = table.sector.lattice
    middle = table.halvings, table.halvings
    (piece,) = (
        k
        for k, child in enumerate(table.places)
        if child.origin == middle and child.turned == lattice.flips
    )
    line = np.zeros((2 * table.scheme.spline.degree, table.size - 1))
    for factor, nu in zip(way, ((1, 0), (0, 1)), strict=True):
        i, j, *_ = _powers(table.scheme.spline, nu)
        np.add.at(line, i + j, factor * _piece_derivatives(table, nu)[piece])
    noise = NOISE * np.abs(_piece_derivatives(table, (1, 0))[piece]).sum(axis=0)
    line[np.abs(line) <= noise] = 0  # differences of what is equal by symmetry
    return line, line[0]


def eigen_weights(
    table: EigenTable, place: CornerPlace, powers: EigenPowers, nu: Order
) -> EigenWeights:
    """The `nu`-th derivative in (s, t) around an extraordinary corner, in float64.

    At the corner itself a derivative of positive order is 0 if all its terms vanish in the limit,
    else NaN.
    """
    order = sum(nu)
    rows = eigen_rows(table, place, powers, nu)
    high, low = table.rates[:, powers.lead].tolist()
    mantissa, exponent = kernels.scaled_power(high, low, powers.level)
    rows *= mantissa[:, None]
    exponent = exponent + order * (powers.level + place.halvings)
    rows[place.level < 0] = corner_derivative(table, nu) if order else 0.0
    exponent[place.level < 0] = 0
    return EigenWeights(rows, exponent, order == 0)


def eigen_directions(
    table: EigenTable,
    place: CornerPlace,
    powers: EigenPowers,
    modes: Array,
    added: Array,
    which: Array,
    orientation: Array,
) -> tuple[Array, Array]:
    """Vectors (2, Q, d) along d/du and d/dv of points with eigencoefficients `modes`, (P, K, d).

    Both up to a common positive factor; also the sizes (2, Q, 1) of what was added up to them, from
    those of the coefficients, `added` (P, K). At the corner itself they are the limits that
    `corner_directions` tells.
    """
    lattice = table.sector.lattice
    points, sizes = modes[which, 1:], added[which, 1:, None]
    # the common factor, a power of the leading eigenvalue, is positive but for odd powers of a
    # negative one
    negative = (powers.level % 2 == 1) & (table.rates[0, powers.lead] < 0)
    found, error = np.empty((2, *points[:, 0].shape)), np.empty((2, len(which), 1))
    for axis, nu in enumerate(((1, 0), (0, 1))):
        rows = eigen_rows(table, place, powers, nu)
        rows[negative] *= -1
        found[axis], error[axis] = _total(rows, points), _total(np.abs(rows), sizes)
    found, error = turned_directions(lattice, found, error, orientation)
    corners = np.flatnonzero(place.level < 0)
    for here in np.unique(orientation[corners]).tolist():
        for axis, way in enumerate(zip(*lattice.gradients[here], strict=True)):
            corner = corners[orientation[corners] == here]
            for limit in corner_directions(table, way):
                value = np.matmul(limit, points[corner])
                size = np.matmul(np.abs(limit), sizes[corner])
                found[axis, corner], error[axis, corner] = value, size
                corner = corner[np.abs(value).max(axis=1, initial=0) <= NOISE * size[:, 0]]
                if not len(corner):
                    break
    return found, error


def turned_directions(
    lattice: Lattice, found: Array, errors: Array, orientation: Array
) -> tuple[Array, Array]:
    """Vectors (2, Q, d) along d/du and d/dv from those along d/ds and d/dt; errors (2, Q, 1)."""
    factors = np.array(lattice.gradients)[orientation].T[..., None]  # (u and v, s and t, Q, 1)
    turned, bounds = np.empty_like(found), np.empty_like(errors)
    for axis, (a, b) in enumerate(factors):
        # where one of them is 0 what it is of has no part, not even by being infinite
        turned[axis] = np.where(a == 0, b * found[1], a * found[0])
        bounds[axis] = np.where(a == 0, errors[1], errors[0])
        both = np.flatnonzero((a * b)[:, 0])
        turned[axis, both] += (b * found[1])[both]
        bounds[axis, both] += errors[1, both]
    return turned, bounds


def _total(rows: Array, values: Array) -> Array:
    """Sums over k of rows (Q, K) times values (Q, K, d)."""
    return np.asarray(np.matmul(rows[:, None], values)[:, 0])


def eigen_rows(table: EigenTable, place: CornerPlace, powers: EigenPowers, nu: Order) -> Array:
    """Derivatives in (S, T) of the eigenfunctions after the first, times `powers`, (Q, K - 1)."""
    return _powered(table, _eigenfunctions(table, place, nu), powers)


def _eigenfunctions(table: EigenTable, place: CornerPlace, nu: Order) -> Array:
    """Derivatives in (S, T) of the eigenfunctions after the first on their pieces, (Q, K - 1)."""
    rows = np.zeros((len(place.level), len(table.order) - 1))
    i, j, kept, most = _powers(table.scheme.spline, nu)
    if not len(kept):
        return rows
    along, across = kernels.monomials(place.S, most[0]), kernels.monomials(place.T, most[1])
    b = across[:, j] * along[:, i]
    for piece, polynomials in enumerate(_piece_derivatives(table, nu)):
        here = place.piece == piece
        rows[here] = b[here] @ polynomials
    return rows


def _powered(table: EigenTable, functions: Array, powers: EigenPowers) -> Array:
    """Rows (Q, K - 1) of eigenfunctions times J^n."""
    heads, first = table.chains - 1, table.pairs - 1
    rows = functions * powers.diagonal
    rows[:, heads] += functions[:, heads - 1] * powers.chained
    if len(first):
        (cosine, sine), x, y = powers.turned, rows[:, first], rows[:, first + 1]
        rows[:, first], rows[:, first + 1] = x * cosine - y * sine, x * sine + y * cosine
    return rows


def on_rings(table: EigenTable, functions: Array, level: Array) -> Array:
    """Rows (Q, K - 1) of eigenfunctions after the first on rings `level` (Q,): times J^n."""
    powers = EigenPowers.of(table, CornerPlace(level, level, level, level))
    high, low = table.rates[:, powers.lead].tolist()
    mantissa, exponent = kernels.scaled_power(high, low, level)
    return kernels.scale_by_two(
        _powered(table, functions, powers) * mantissa[:, None], exponent[:, None]
    )


def eigen_normals(
    table: EigenTable,
    place: CornerPlace,
    powers: EigenPowers,
    modes: Array,
    added: Array,
    which: Array,
) -> tuple[Array, Array]:
    """Vectors (Q, 3) along d/ds x d/dt of points with eigencoefficients `modes`, (P, K, 3).

    Also bounds (Q, 1) of their rounding errors in units of `NOISE`, from the sizes (P, K) of what
    was `added` up to coefficients. With c the coefficient of the leading eigenfunction, and a and b
    its derivatives, ``(a c + p) x (b c + q)`` is ``c x (a q - b p) + p x q``: the product
    ``c x c``, which would swamp the rest near the corner, never arises. At the corner itself the
    vector is that of the limit normal; 0 where there is none.
    """
    largest = np.abs(modes[:, 1:]).max(axis=(1, 2), initial=0)[:, None]
    largest = np.where(largest > 0, largest, 1)  # neither overflow nor underflow below
    modes, added = modes / largest[..., None], added / largest
    lead, size = powers.lead - 1, np.abs(modes).max(axis=2)
    found, error = np.zeros((len(which), 3)), np.zeros((len(which), 1))
    corner = place.level < 0
    patch = which[corner]
    for one, other in table.normal_pairs[::-1]:
        product = np.cross(modes[patch, one], modes[patch, other])
        # each component is a difference of two products
        bound = size[patch, one] * added[patch, other] + added[patch, one] * size[patch, other]
        bound = 2 * bound[:, None]
        seen = np.abs(product).max(axis=1, keepdims=True) > NOISE * bound
        found[corner] = np.where(seen, product, found[corner])
        error[corner] = np.where(seen, bound, error[corner])
    # what follows the leading eigenfunction relative to the next one: neither underflows
    away = np.flatnonzero(~corner)
    there, patch = place[away], which[away]
    rest = EigenPowers.of(table, there, min(powers.lead + 1, table.size - 1))
    high, low = ratios(table, powers.lead)[:, rest.lead - 1, None]
    ratio = kernels.power(high, low, rest.level)
    functions = [_eigenfunctions(table, there, nu) for nu in ((1, 0), (0, 1))]
    a, b = (_powered(table, f, powers[away])[:, lead, None] for f in functions)
    ds, dt = (_powered(table, f, rest) for f in functions)
    ds[:, lead] = dt[:, lead] = 0

    points = modes[patch, 1:]
    found[away] = np.cross(points[:, lead], _total(a * dt - b * ds, points))
    found[away] += np.cross(_total(ds, points), _total(dt, points)) * ratio
    # the common factor, a product of powers of these eigenvalues, can be negative
    if table.rates[0, [powers.lead, rest.lead]].prod() < 0:
        found[away[rest.level % 2 == 1]] *= -1
    ds, dt = np.abs(ds), np.abs(dt)
    sums = np.stack([np.abs(a) * dt + np.abs(b) * ds, ds, dt], axis=1)
    sizes = np.stack([size[patch, 1:], added[patch, 1:]], axis=2)
    across, along, other = np.matmul(sums, sizes).swapaxes(0, 1)  # (3, Q, 2)
    bound = size[patch, powers.lead] * across[:, 1] + added[patch, powers.lead] * across[:, 0]
    bound += (along[:, 0] * other[:, 1] + along[:, 1] * other[:, 0]) * np.abs(ratio[:, 0])
    error[away] = 2 * bound[:, None]
    return found, error


def eigen_curvatures(
    table: EigenTable,
    place: CornerPlace,
    modes: Array,
    added: Array,
    size: Array,
    which: Array,
) -> tuple[Array, Array, Array]:
    """Second fundamental forms of points with eigencoefficients `modes`, (P, K, 3).

    In a frame of each patch whose x-axis is along the coefficient that falls most slowly, whose
    plane holds the next one and whose z-axis the third, x, y and z fall by powers a1, a2, b of
    three eigenvalues, which are taken out: the normal part of second derivatives is not lost in
    their tangential part, however near the corner; ``derivations/curvature.py``. `added` (P, K, 3)
    are the sizes of what was added up to coefficients, `size` (P,) those of the patches; forms in
    doubt are as `kernels.honest` says. At the corner itself curvature is 0 where it tends to 0,
    else NaN.

    Returns
    -------
    form : (3, Q)
    exponent : (Q,)
        The power of two by which the form is to be multiplied.
    axis : (Q, 3)
        The frame that it refers to; see `kernels.shape_operators`.
    """
    scale = np.frexp(np.abs(modes[:, 1:]).max(axis=(1, 2), initial=0))[1]
    points = kernels.scale_by_two(modes[:, 1:], -scale[:, None, None])  # (P, K - 1, 3), at most 1
    noise = NOISE * kernels.scale_by_two(added[:, 1:], -scale[:, None, None])
    axes, local, leads = _frames(table, points, noise)
    # errors of these coordinates, but where they are known to be 0
    noise = np.matmul(noise, np.abs(axes).swapaxes(1, 2)) * (local != 0)
    size = kernels.scale_by_two(size, -scale)
    form, axis = np.full((3, len(which)), np.nan), np.full((len(which), 3), np.nan)
    exponent = np.zeros(len(which), dtype=np.int64)
    values = _exact_eigenvalues(table)
    kinds, kind = np.unique(leads, axis=0, return_inverse=True)
    for case, (first, second, third) in enumerate(kinds.tolist()):
        if not second or not values[second]:
            continue  # a line or a point: no surface
        flat, third = not third, third or second
        a1, a2, b = values[first], values[second], values[third]
        here = np.flatnonzero(kind.ravel()[which] == case)
        at_corner = place.level[here] < 0
        if [first, second] in table.normal_pairs[:1].tolist() and (flat or abs(b) < a2 * a2):
            form[:, here[at_corner]] = 0
        here = here[~at_corner]
        there, patch = place[here], which[here]
        powers = [EigenPowers.of(table, there, lead) for lead in (first, second, third)]
        derivatives, errors = np.empty((2, 5, len(here), 3))
        for k, nu in enumerate(((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))):
            functions = _eigenfunctions(table, there, nu)
            for x, p in enumerate(powers):
                rows = _powered(table, functions, p)
                derivatives[k, :, x] = (rows * local[patch, :, x]).sum(axis=1)
                errors[k, :, x] = (np.abs(rows) * noise[patch, :, x]).sum(axis=1)
        level = there.level
        high, low = _high_and_low([a2 / a1, b / a1, b / a2])
        parts, bounds, along = kernels.shape_operators(
            derivatives[:2], derivatives[2:], kernels.power(high, low, level).T, errors
        )
        units = [_scaled_power(x, level) for x in (b / (a1 * a1), b / (a1 * a2), b / (a2 * a2))]
        powers_of_two = np.array([n for _, n in units])
        largest = powers_of_two.max(axis=0)
        mantissas = np.array([mantissa for mantissa, _ in units])
        parts, bounds = parts * mantissas, bounds * np.abs(mantissas)
        parts, bounds = (kernels.scale_by_two(x, powers_of_two - largest) for x in (parts, bounds))
        parts = kernels.honest(parts, bounds, kernels.scale_by_two(size[patch], largest))
        if a1 * a2 < 0:  # areas are positive; in w12 their sign stands already
            parts[::2, level % 2 == 1] *= -1
        form[:, here], exponent[here] = parts, largest - scale[patch]
        axis[here] = np.matmul(along[:, None], axes[patch])[:, 0]
    return form, exponent, axis


def _frames(table: EigenTable, points: Array, noise: Array) -> tuple[Array, Array, Array]:
    """Axes (P, 3, 3) along the slowest coefficients (P, K - 1, 3), which are at most 1.

    `noise` bounds their errors, coordinate by coordinate: flat cages keep what bends them. Also the
    coefficients in these axes, and the number of the eigenvalue with which each coordinate begins
    (P, 3); 0 where all of it is 0.
    """
    axes, leads = np.zeros((len(points), 3, 3)), np.zeros((len(points), 3), dtype=np.int64)
    local, patch = np.zeros_like(points), np.arange(len(points))
    for x in range(3):
        if x < 2:  # a unit vector along the first coefficient that is not in the axes before
            rest, error = points, noise
            for axis in [*axes[:, :x].swapaxes(0, 1)] * 2:  # twice, for the sake of rounding
                axis = axis[:, None]  # (P, 1, 3)
                rest = rest - (rest * axis).sum(axis=2, keepdims=True) * axis
                error = noise + (noise * np.abs(axis)).sum(axis=2, keepdims=True) * np.abs(axis)
            seen: Array = np.asarray((np.abs(rest) > error).any(axis=2))  # (P, K - 1)
            axes[:, x] = kernels.unit(rest[patch, seen.argmax(axis=1)], np.zeros((len(points), 1)))
            along = (points * axes[:, x, None]).sum(axis=2)
        else:
            axes[:, x] = np.cross(axes[:, 0], axes[:, 1])
            along = (points * axes[:, x, None]).sum(axis=2)
            seen = np.abs(along) > (noise * np.abs(axes[:, x, None])).sum(axis=2)
        first = 1 + seen.argmax(axis=1)
        first -= np.isin(first - 1, table.pairs)  # complex pairs go together
        some: Array = np.asarray(seen.any(axis=1))
        leads[:, x] = np.where(some, first, 0)
        before = np.arange(1, points.shape[1] + 1) < first[:, None]
        local[:, :, x] = np.where(before | ~some[:, None], 0, along)
    return axes, local, leads


def _scaled_power(base: Fraction, n: Array) -> tuple[Array, Array]:
    """``base ** n`` as mantissas (n,) and powers of two (n,)."""
    if not base:
        return np.where(n == 0, 1.0, 0.0), np.zeros_like(n)
    (high,), (low,) = _high_and_low([base]).tolist()
    return kernels.scaled_power(high, low, n)


def _exact_eigenvalues(table: EigenTable) -> list[Fraction]:
    return [Fraction(high) + Fraction(low) for high, low in table.rates.T.tolist()]


def _high_and_low(values: list[Fraction]) -> Array:
    """Numbers rounded, and what rounding took from them, (2, n)."""
    high = [float(x) for x in values]
    return np.array([high, [float(x - Fraction(h)) for x, h in zip(values, high, strict=True)]])


def control_weights(table: EigenTable, weights: EigenWeights) -> Array:
    """Weights of the eigencoefficients in terms of the control points, (Q, K)."""
    ring = table.sector.ring
    rows = np.zeros((len(weights.rows), table.size))
    rows[:, table.order[1:]] = weights.rows
    modes, outer = rows[:, :ring], rows[:, ring:]
    around = table.ring.weights(modes - outer @ table.links)
    result = np.concatenate([around, outer @ table.outer], axis=1)
    result = kernels.scale_by_two(result, weights.exponent[:, None])
    return np.asarray(result + table.limit_mask if weights.with_limit else result)


def rational_weights(
    table: RationalTable, spline: Spline, place: CornerPlace, nu: Order, at_corner: Array
) -> Array:
    """Weights (Q, K) of control points around a special corner, as Fractions.

    Every level costs one sparse integer row-vector product. Whether a derivative has a value at the
    corner itself `corner_derivative` tells, whose weights `at_corner` are.
    """
    size, pieces = table.sector.size, table.places
    b = regular_weights(spline, numbers.RATIONAL)(place.S, place.T, nu)
    # integers over one denominator per query: far faster than Fractions
    unit = np.array([lcm(*(w.denominator for w in row)) for row in b], dtype=object)
    rows = np.zeros((len(b), table.n_rows), dtype=object)
    for piece, own in enumerate(pieces):
        here = np.flatnonzero(place.piece == piece)
        signed = unit[here] * (-1) ** (own.turned * sum(nu))
        for k, row in enumerate(table.pieces[piece]):
            rows[here, row] += _integers(b[here, k] * signed)
    starts = np.searchsorted(table.columns, np.arange(size))
    rows = np.add.reduceat(rows[:, table.rows] * table.numerators, starts, axis=1)
    square = table.rows < size
    sources, values = table.rows[square], table.numerators[square]
    starts = np.searchsorted(table.columns[square], np.arange(size))
    for done in range(int(place.level.max(initial=0))):
        going = np.flatnonzero(place.level > done)
        rows[going] = np.add.reduceat(rows[going][:, sources] * values, starts, axis=1)
    # (not ** on the array: a Fraction to the power of an array falls back to floats)
    step = Fraction(2 ** sum(nu), table.denominator)
    scale = np.array([step ** (max(n, 0) + 1) for n in place.level.tolist()], dtype=object)
    scale *= 2 ** (sum(nu) * (place.halvings - 1))
    weights = rows * (scale / unit)[:, None]
    corner = place.level < 0
    if corner.any():
        weights[corner] = (
            _rational_derivative(table, spline, nu, at_corner) if sum(nu) else table.limit_mask
        )
    return np.asarray(weights)


def _rational_derivative(
    table: RationalTable, spline: Spline, nu: Order, at_corner: Array
) -> Array:
    """Weights (K,) of the control points in a derivative at the corner."""
    sector = table.sector
    row = np.full(sector.size, Fraction(0), dtype=object)
    axis = int(nu[0] == 0)
    if not at_corner.any():
        return row
    if np.isnan(at_corner).any():
        return np.full(sector.size, np.nan, dtype=object)
    if not (sector.open and sector.sharp_sides[axis]):
        # by halvings along the side it tends to its part in the eigenspace of 1 / 2^order
        S, T = (numbers.RATIONAL.array([int(axis == k)]) for k in (0, 1))
        fine = len(table.places) > len(sector.lattice.pieces)
        piece = np.array([side_piece(sector.lattice, axis, fine)])
        place = CornerPlace(np.array([0]), piece, S, T, 1 + fine)
        ahead = rational_weights(table, spline, place, nu, at_corner)[0]
        return table.projected(ahead, Fraction(1, 2 ** sum(nu)))
    # the crease is a cubic spline; at a corner its first point is reflected at the vertex, beside a
    # flap, whose other end is the same, at the middle of the first and the last
    before, vertex, ahead, beyond = kernels.cubic_weights(numbers.RATIONAL.array([0]), sum(nu))[0]
    ends = (1, 1 + len(sector.lattice.orbits) * sector.faces)
    outer = sector.ring + sector.outer.index(((3, 1), (1, 3))[axis])
    near, far = ends[axis], ends[1 - axis]
    row[0] += vertex
    row[near] += ahead
    row[outer] += beyond
    if sector.kind in ("corner", "flap"):
        row[0 if sector.kind == "corner" else -1 - len(sector.outer)] += 2 * before
        row[near] -= before
    else:
        row[far] += before
    return row


# Fractions that are whole to Python integers, which NumPy must not turn into machine ones
_integers = np.frompyfunc(int, 1, 1)


@lru_cache(maxsize=256)
def turned(lattice: Lattice, nu: Order) -> tuple[tuple[tuple[Order, ...], Array], ...]:
    """A derivative in (u, v) as sums of those in (s, t).

    The orders of the first terms by orientation with their factors (orientations,), then those of
    the second ones, whose factors are 0 where there is none, and so on; in quads there are none.
    """
    terms: list[list[tuple[Order, int]]] = [[] for _ in lattice.gradients]
    for order, factors in lattice.turned(nu).items():
        for own, factor in zip(terms, factors, strict=True):
            own += [(order, factor)] if factor else []
    most = max(map(len, terms))
    full = [own + [(nu, 0)] * (most - len(own)) for own in terms]
    return tuple(
        (tuple(order for order, _ in each), np.array([factor for _, factor in each]))
        for each in zip(*full, strict=True)
    )


def turned_rows(
    lattice: Lattice, nu: Order, orientation: Array, rows: Callable[[Order, Array], Array]
) -> Array:
    """Rows (Q, K) for a derivative in (u, v), from those for derivatives in (s, t) of some queries.

    `rows` is asked for an order and which queries.
    """
    result: Array = np.zeros((0, 0))
    for number, (orders, factors) in enumerate(turned(lattice, nu)):
        for order in dict.fromkeys(o for o, f in zip(orders, factors, strict=True) if f):
            chosen = np.array([o == order for o in orders]) & (factors != 0)
            here = np.flatnonzero(chosen[orientation])
            if not len(here) and len(orientation):
                continue
            found, factor = rows(order, here), factors[orientation[here], None]
            if (factor != 1).any():
                found = found * factor.astype(found.dtype)
            if not result.size:
                result = np.empty((len(orientation), found.shape[1]), found.dtype)
            result[here] = result[here] + found if number else found
    return result


WeightsOf = Callable[[Array, Array, Order], Array]


@lru_cache(maxsize=64)
def regular_weights(spline: Spline, number: NumberType) -> WeightsOf:
    """What gives weights (Q, K) of a regular piece from s, t (Q,) and the order of a derivative."""
    if spline.cubic:
        return kernels.bicubic_weights
    if spline.is_product:
        return partial(_product_weights, spline.degree)
    return partial(_piece_weights, spline, number)


def _product_weights(degree: int, s: Array, t: Array, nu: Order) -> Array:
    """Those of a product of B-splines of one degree in s and in t."""
    along, across = (_line_weights(degree, x, k) for x, k in zip((s, t), nu, strict=True))
    return np.asarray((across[:, :, None] * along[:, None, :]).reshape(len(s), -1))


def _line_weights(degree: int, x: Array, order: int) -> Array:
    """Weights (Q, degree + 1) in the derivative of a piece of a B-spline, as `cubic_weights`."""
    weights = kernels.spline_weights(x, max(degree - order, 0))
    if order > degree:
        return np.repeat(0 * weights, degree + 1, axis=1)
    for _ in range(order):
        above = np.zeros((len(x), 1), dtype=x.dtype)
        weights = np.concatenate([above, weights], 1) - np.concatenate([weights, above], 1)
    return weights


def _piece_weights(spline: Spline, number: NumberType, s: Array, t: Array, nu: Order) -> Array:
    exponents, coefficients = barycentric(spline, nu, number)
    if not exponents:
        return number.full((len(s), len(spline.template)), number.zero)
    return np.asarray(kernels.barycentric_monomials(s, t, exponents) @ coefficients)


@lru_cache(maxsize=256)
def barycentric(
    spline: Spline, nu: Order, number: NumberType
) -> tuple[Sequence[tuple[int, int, int]], Array]:
    """The derivative of a regular piece in its barycentric coordinates: exponents, coefficients.

    Of ``(1 - s - t)^i s^j t^k`` with i + j + k the degree: all coefficients (terms, K) of a box
    spline are positive, nothing cancels, and those of its derivatives are as few as can be.
    """
    i, j, kept, _ = _powers(spline, nu)
    if not len(kept):
        return (), number.array([])
    degree = max(map(sum, spline.exponents)) - sum(nu)
    exponents = [(degree - b - c, b, c) for c in range(degree + 1) for b in range(degree + 1 - c)]
    found = {powers: [Fraction(0)] * len(spline.template) for powers in exponents}
    for b, c, k in zip(i.tolist(), j.tolist(), kept.tolist(), strict=True):
        factor, rest = perm(b + nu[0], nu[0]) * perm(c + nu[1], nu[1]), degree - b - c
        for x in range(rest + 1):  # times (1 - s - t + s + t)^rest
            for y in range(rest + 1 - x):
                row = found[rest - x - y, b + x, c + y]
                times = factor * comb(rest, x) * comb(rest - x, y)
                for n, weight in enumerate(spline.pieces[k]):
                    row[n] += times * weight
    flat = number.array([x for row in found.values() for x in row])
    return exponents, flat.reshape(len(exponents), len(spline.template))


def strip_weights(
    strips: StripTables, which: Array, s: Array, t: Array, nu: Order, up: tuple[Array, Array]
) -> Array:
    """Weights (Q, 16) of patches with a semi-sharp crease along t = 0, control point 4 j + i.

    Within ceil(sharpness) halvings of t towards the crease the pieces are polynomials in t;
    ``derivations/creases.py``. On a line between two, that of larger t is taken where ``up[1]``,
    and where there are such pieces along s, too, that of larger s where ``up[0]``.
    """
    if strips.both:
        along = _across_strip(strips, which, s, nu[0], up[0])
    else:
        along = kernels.cubic_weights(s, nu[0])
    across = _across_strip(strips, which, t, nu[1], up[1])
    return np.asarray((across[:, :, None] * along[:, None, :]).reshape(len(s), 16))


def center_weights(strips: StripTables, s: Array, t: Array, nu: Order) -> Array:
    """The same of quads of a dual scheme that are not turned."""
    one = np.zeros(len(s), dtype=np.int64)
    return strip_weights(strips, one, s, t, nu, (one > 0, one > 0))


def _across_strip(strips: StripTables, which: Array, t: Array, order: int, up: Array) -> Array:
    """Weights (Q, 4) of the rows of control points across strips."""
    piece, T, level = kernels.split_strip(t, strips.depth[which], up)
    degree = strips.pieces.shape[1] - 1 - order
    if degree < 0:
        number = numbers.type_of(t)
        return number.full((len(t), 4), number.zero)
    polynomials = strips.pieces[strips.first[which] + piece]  # (Q, powers, 4)
    factor = [factorial(k + order) // factorial(k) for k in range(degree + 1)]
    powers = kernels.monomials(T, degree) * np.array(factor)
    across = (powers[:, :, None] * polynomials[:, order:]).sum(axis=1)
    return np.asarray(across * kernels.scale_by_two(np.ones_like(T), level * order)[:, None])
