"""Steps towards places on triangles, nine parts at a time, and what they make of weights.

Weights of the limit at a place are those in the part where it is, times what makes the vertices of
that part. So a place is first followed down to where its neighbourhood is regular and small enough,
then weights are taken back up. They are of differences from the first vertex of a neighbourhood
all along: what is left of a derivative at each step is smaller by three, and no constant may be
left over from rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limitsurf.caching import cached_property
from limitsurf.cage.connectivity import Connectivity
from limitsurf.engine.surroundings import PARTS, Maps, Neighbourhood
from limitsurf.options import Rules
from limitsurf.refine import turning

Array = NDArray[Any]

# Steps among regular neighbourhoods after which what quadratics miss is below rounding errors, of
# positions and first derivatives; and steps after which no more are taken beside boundaries. See
# `derivations/sqrt3.py`.
STEPS = 20, 28
DEEPEST = 38

# number of the part by where its cell is, and whether it is turned
_PART = np.full((2, 3, 3), -1)
for _number, (_i, _j, _sign) in enumerate(PARTS):
    _PART[(0, _i, _j) if _sign > 0 else (1, _i - 1, _j - 1)] = _number
ORIGIN = np.array([part[:2] for part in PARTS], dtype=float)
SIGN = np.array([part[2] for part in PARTS], dtype=float)


def split(s: Array, t: Array) -> tuple[Array, Array, Array]:
    """The part where each place is, and its coordinates there."""
    s, t = 3 * s, 3 * t
    i = np.minimum(s.astype(np.int64), 2)
    j = np.minimum(t.astype(np.int64), 2 - i)
    turned = (s - i + (t - j) > 1) & (i + j < 2)
    part = _PART[turned.astype(np.int64), i, j]
    origin, sign = ORIGIN[part], SIGN[part]
    s, t = sign * (s - origin[:, 0]), sign * (t - origin[:, 1])
    # what rounding has put beyond the slope is on it
    over = s + t > 1
    larger = over & (s > t)
    return part, np.where(larger, 1 - t, s), np.where(over & ~larger, 1 - s, t)


class Descent(NamedTuple):
    """How places were followed down: kinds and parts by step, and what is at the end.

    Attributes
    ----------
    kinds, parts : list of (Q,) int
        -1 where no step was taken.
    kind : (Q,) int
        The last.
    s, t : (Q,)
    levels : (Q,) int
        Number of steps.
    sign : (Q,)
        -1 where the last part is turned by half a turn.
    """

    kinds: list[Array]
    parts: list[Array]
    kind: Array
    s: Array
    t: Array
    levels: Array
    sign: Array


class Kinds:
    """The neighbourhoods that are met under a scheme, by numbers; the regular one is 0."""

    def __init__(self, rules: Rules) -> None:
        self.rules = rules
        self.known: list[Neighbourhood] = []
        self._numbers: dict[Any, int] = {}
        self._parts: dict[int, list[int]] = {}
        self._table = np.full((0, 9), -1)
        self._maps: dict[tuple[int, int], tuple[Array, Array]] = {}
        self._rows: dict[int, Any] = {}
        self._words: dict[int, tuple[Array, Array]] = {}
        self._corners: dict[int, Corner] = {}
        self.packed: Any = None  # maps for kernels
        self.number(_regular())

    def number(self, neighbourhood: Neighbourhood) -> int:
        """The number of an equal neighbourhood."""
        found = self._numbers.setdefault(neighbourhood.key, len(self.known))
        if found == len(self.known):
            self.known.append(neighbourhood)
        return found

    def parts(self, kind: int) -> list[int]:
        """Kinds of the nine parts."""
        if kind not in self._parts:
            found, self._rows[kind] = self.known[kind].parts(self.rules)
            self._parts[kind] = [self.number(one) for one in found]
        return self._parts[kind]

    def map(self, kind: int, part: int) -> tuple[Array, Array]:
        """What a part makes of differences: its own, and its first vertex from the whole's."""
        if (kind, part) not in self._maps:
            self.parts(kind)
            rows = self._rows[kind][part]
            self._maps[kind, part] = rows[1:, 1:] - rows[:1, 1:], rows[0, 1:]
        return self._maps[kind, part]

    def table(self, kinds: Array) -> Array:
        """The kinds of all parts, (n, 9), known for these."""
        for kind in np.unique(kinds).tolist():
            self.parts(kind)
        if len(self._table) < len(self.known):
            self._table = np.full((len(self.known), 9), -1)
        for kind, parts in self._parts.items():
            self._table[kind] = parts
        return self._table

    def corner(self, kind: int) -> Corner:
        """What repeats towards the first corner of a kind."""
        if kind not in self._corners:
            self._corners[kind] = Corner(self, kind)
        return self._corners[kind]

    def repeats(self, kinds: Array) -> Array:
        """Whether kinds are special at the first corner, and so is what is there after a step."""
        table = self.table(kinds)
        return np.asarray((table[kinds, 0] == kinds) & (kinds != 0))

    def descend(self, kind: Array, s: Array, t: Array, steps: int) -> Descent:
        """Follow places down."""
        left = np.full(len(kind), steps)
        levels, sign = np.zeros(len(kind), dtype=np.int64), np.ones(len(kind))
        kinds, parts = [], []
        for _ in range(DEEPEST):
            going = left > 0
            if not going.any():
                break
            part, s_next, t_next = split(s, t)
            table = self.table(kind[going])
            kinds.append(np.where(going, kind, -1))
            parts.append(part)
            kind = np.where(going, table[kind, part], kind)
            s, t = np.where(going, s_next, s), np.where(going, t_next, t)
            sign = np.where(going, sign * SIGN[part], sign)
            levels += going
            left -= going & (kinds[-1] == 0)
        return Descent(kinds, parts, kind, s, t, levels, sign)

    def ascend(self, descent: Descent, weights: Array, constant: Array) -> Array:
        """Weights (n, Q, size - 1) taken back to where the descent began.

        Where the constant (n,) is 1 they are of positions, where it is 0 of differences.
        """
        level = len(descent.kinds) - 1
        while level >= 0:
            kinds, parts = descent.kinds[level], descent.parts[level]
            codes = np.where(kinds < 0, -1, 9 * kinds + parts)
            if level:
                # where both are regular, two steps at a time
                two = (descent.kinds[level - 1] == 0) & (kinds == 0)
                words = np.where(two, 9 * descent.parts[level - 1] + parts, -1)
                self._apply(words, self.word, weights, constant)
                self._apply(np.where(two, -1, codes), self._coded, weights, constant)
                level -= 1
                kinds, parts = descent.kinds[level], descent.parts[level]
                codes = np.where(two | (kinds < 0), -1, 9 * kinds + parts)
            self._apply(codes, self._coded, weights, constant)
            level -= 1
        return weights

    def _coded(self, code: int) -> tuple[Array, Array]:
        return self.map(*divmod(code, 9))

    def word(self, code: int) -> tuple[Array, Array]:
        """What two parts make of differences amid regular vertices: of one, then of that."""
        if code not in self._words:
            first, second = divmod(code, 9)
            (own, shift), (inner, inner_shift) = self.map(0, first), self.map(0, second)
            self._words[code] = inner @ own, inner_shift @ own + shift
        return self._words[code]

    def _apply(
        self,
        codes: Array,
        maps: Callable[[int], tuple[Array, Array]],
        weights: Array,
        constant: Array,
    ) -> None:
        """Take weights back, each by the map of its code; those of -1 stay."""
        order = np.argsort(codes, kind="stable")
        found, first = np.unique(codes[order], return_index=True)
        ends = np.append(first[1:], len(order))
        for one, start, end in zip(found.tolist(), first.tolist(), ends.tolist(), strict=True):
            if one < 0:
                continue
            own, shift = maps(one)
            which = order[start:end]
            made = weights[:, which, : own.shape[0]] @ own
            made += constant[:, None, None] * shift
            weights[:, which, : own.shape[1]] = made
            weights[:, which, own.shape[1] :] = 0

    def ends(
        self, descent: Descent, directions: Array, width: int, flat: bool, first: bool = True
    ) -> Array:
        """Weights (3, Q, width) of the position and of two derivatives at the ends of a descent.

        (1, Q, width) without first derivatives.

        Derivatives (2, Q, 2) are in directions of s and t at the beginning, without the powers of
        three. Beside boundaries those have a limit that are along the boundary; if `flat`, others
        are differences, whose directions have.
        """
        s, t, Q = descent.s, descent.t, len(descent.s)
        found = np.zeros((1 + 2 * first, Q, width))
        along = directions * descent.sign[:, None]
        inner = np.flatnonzero(descent.kind == 0)
        value, ds, dt = quadratic(s[inner], t[inner])
        found[0, inner, :6] = value
        for k in range(2 * first):
            a, b = along[k, inner].T
            found[1 + k, inner, :6] = a[:, None] * ds + b[:, None] * dt
        outer = np.flatnonzero(descent.kind != 0)
        found[0, outer, 0], found[0, outer, 1] = s[outer], t[outer]
        for k in range(2 * first):
            found[1 + k, outer, :2] = along[k, outer]
            if not flat:
                lost = ~self._follows(descent.kind[outer], directions[k, outer])
                found[1 + k, outer[lost]] = np.nan
        return found

    def _follows(self, kinds: Array, directions: Array) -> Array:
        """Whether directions are along the boundary that triangles of these kinds have."""
        result = np.zeros(len(kinds), dtype=bool)
        for kind in np.unique(kinds).tolist():
            here = np.flatnonzero(kinds == kind)
            a, b = directions[here].T
            along = np.stack([b == 0, a + b == 0, a == 0])
            result[here] = along[self.known[kind].open_sides].any(axis=0)
        return result


class Corner:
    """What repeats towards the first corner of a kind of neighbourhood.

    Attributes
    ----------
    value : float
        The largest eigenvalue of what one step makes of differences.
    limit : (size - 1,)
        Weights of differences in the limit at the corner.
    open_sides : (3,) bool
    curve : (m,) int
        Where the first and the last neighbour are, and others on the boundary, if there is one.
    tangents : (2, size - 1) or None
        Of both derivatives there, in directions that are limits, up to their lengths.
    """

    def __init__(self, kinds: Kinds, kind: int) -> None:
        own, shift = kinds.map(kind, 0)
        # (amid two faces there may be nothing left at once)
        self.value = max(float(np.abs(np.linalg.eigvals(own)).max()), 1e-9)
        self.limit = np.linalg.solve((np.eye(len(own)) - own).T, shift)
        ring, closed = kinds.known[kind].ring
        self.open_sides, self.curve = kinds.known[kind].open_sides, kinds.known[kind].curve - 1
        # first derivatives grow by this with each step
        self.vanishes = 3 * self.value < 1 - 1e-9 and closed
        self._own, self._powers = own, {self.value: [own / self.value]}
        masks = turning.tangent_masks(kinds.rules, len(ring) - (not closed), closed)
        pair = masks[int(kinds.known[kind].fixed[0])]
        self.tangents = self.edges = None
        if pair is not None:
            self.tangents = np.zeros((2, len(own)))
            self.tangents[:, ring - 1] = pair[:, 1:]
            if closed:
                turn = 2 * np.pi / len(ring)
                place = np.flatnonzero(ring == 1)[0]
                angle = turn * (place + np.arange(2))
                self.edges = np.stack([np.cos(angle), np.sin(angle)], axis=1) @ self.tangents

    def on_curve(self, weights: Array, n: Array) -> Array:
        """Weights (Q, m) of what is on the boundary after so many steps, times powers of three."""
        own = 3 * self._own[np.ix_(self.curve, self.curve)]
        powers = self._powers.setdefault(0.0, [own])
        (found,) = _raised(powers, weights[None], n)
        return np.asarray(found)

    def power(self, weights: Array, n: Array, value: float | None = None) -> Array:
        """Weights (k, Q, size - 1) times so many steps, but for the powers of the eigenvalue.

        If a value is given, for its powers, and those of what is left without the tangents.
        """
        if value is None:
            powers = self._powers[self.value]
        else:
            powers = self._powers.setdefault(-value, [self._rest / value])
        return _raised(powers, weights, n)

    @cached_property
    def _dual(self) -> tuple[Array, Array]:
        """The eigenvalues of both tangents, (2,), and what they are 1 on, each, (size - 1, 2)."""
        tangents = self.tangents
        assert tangents is not None
        values = ((tangents @ self._own) * tangents).sum(axis=1) / (tangents**2).sum(axis=1)
        every, vectors = np.linalg.eig(self._own)
        first = np.argsort(np.abs(every - values[0]))[0]
        near = np.argsort(np.abs(every - values[1]))
        which = [first, near[near != first][0]]
        both = np.concatenate([vectors[:, which].real, vectors[:, which].imag], axis=1)
        basis = np.linalg.svd(both, full_matrices=False)[0][:, :2]
        return values, basis @ np.linalg.inv(tangents @ basis)

    @cached_property
    def _rest(self) -> Array:
        """What a step makes of differences, less what it does to the tangents."""
        values, dual = self._dual
        return np.asarray(self._own - (dual * values) @ self.tangents)

    def planes(self, weights: Array, n: Array) -> Array:
        """Vectors (2, Q, size - 1) after so many steps that span what these do; of their size.

        Each is a tangent and what vanishes beside it, so that neither is lost beside the other.
        """
        if self.tangents is None:
            return self.power(weights, n)
        values, dual = self._dual
        shares = np.einsum("kqm,mj->qkj", weights, dual)
        rest = weights - np.einsum("qkj,jm->kqm", shares, self.tangents)
        sign = np.sign(np.linalg.det(shares))
        turned = np.einsum("qjk,kqm->jqm", np.linalg.pinv(shares), rest)
        found = np.empty_like(weights)
        for j, value in enumerate(values.tolist()):
            later = self.power(turned[j : j + 1].copy(), n, value)[0]
            found[j] = self.tangents[j] + later
        found[1] *= sign[:, None]
        return found


def _raised(powers: list[Array], weights: Array, n: Array) -> Array:
    """Weights (k, Q, m) times powers of a matrix, of which the list has those of 1, 2, 4, ..."""
    bit = 0
    while (n >> bit).any():
        while len(powers) <= bit:
            powers.append(powers[-1] @ powers[-1])
        which = np.flatnonzero(n >> bit & 1)
        # one by one: products of many round as their number has it
        weights[:, which] = (weights[:, which, None] @ powers[bit])[:, :, 0]
        bit += 1
    return weights


def quadratic(s: Array, t: Array) -> tuple[Array, Array, Array]:
    """Weights (Q, 6) of the neighbours of corner 0, less it, amid regular vertices.

    In the value and both derivatives of the quadratic that the limit is up to third order.
    """
    star = _STAR
    value = star[0] + np.multiply.outer(s, star[1]) + np.multiply.outer(t, star[2])
    value += np.multiply.outer(s * s / 2, star[3]) + np.multiply.outer(s * t, star[4])
    value += np.multiply.outer(t * t / 2, star[5])
    first = star[1] + np.multiply.outer(s, star[3]) + np.multiply.outer(t, star[4])
    second = star[2] + np.multiply.outer(s, star[4]) + np.multiply.outer(t, star[5])
    return value, first, second


# of the value, d/ds, d/dt, d2/ds2, d2/dsdt, d2/dt2 at a regular vertex, from its neighbours at
# (1, 0), (0, 1), (-1, 1), (-1, 0), (0, -1), (1, -1)
_STAR = (
    np.array(
        [
            [1, 1, 1, 1, 1, 1],
            [4, 2, -2, -4, -2, 2],
            [2, 4, 2, -2, -4, -2],
            [12, 0, 0, 12, 0, 0],
            [6, 6, -6, 6, 6, -6],
            [0, 12, 0, 0, 12, 0],
        ]
    )
    / 12
)


def _regular() -> Neighbourhood:
    """That of a triangle amid regular vertices."""
    n = 8
    corner = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    after, above = corner + n + 1, corner + 1
    cells = [(corner, after, above), (after + 1, above, after)]
    faces = np.stack([np.stack(cell, axis=1) for cell in cells], axis=1)
    cage = Connectivity((n + 1) ** 2, np.full(2 * n * n, 3), faces.ravel())
    middle = 2 * (n * (n // 2) + n // 2)
    stays = np.zeros(cage.n_vertices, dtype=bool)
    return Neighbourhood.of(Maps(cage.twin).tables, cage.indices, stays, 3 * middle)


@lru_cache(maxsize=16)
def kinds_of(rules: Rules) -> Kinds:
    """Those of a scheme; they stay, as they are few."""
    return Kinds(rules)
