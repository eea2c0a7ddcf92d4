"""Moments of a body in Fractions: infinitely many rings in closed form, from the first ones.

The control points of a corner's rings, relative to its limit, are ``A^n y``. With the minimal
polynomial of A there, a ring's integral F_n of degree p in them satisfies the linear recurrence
whose roots are the products of p eigenvalues. If ``q_0 + q_1 z + ... + q_M z^M`` is the product of
all ``1 - r z``, then ``(sum F_n z^n) q(z)`` is a polynomial of degree below M, and at z = 1

    sum over all n of F_n = sum over n < M of F_n (q_0 + ... + q_{M - 1 - n}) / q(1)

exactly, without any eigenvalue (``derivations/integrals.py``). Jordan blocks are multiple roots.
"""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache
from math import comb, lcm
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import numbers
from limitsurf.integrals.moments import Moments
from limitsurf.integrals.rules import moments_rule
from limitsurf.patches import STRIP
from limitsurf.pieces.bernstein import Bernstein
from limitsurf.pieces.cells import cut
from limitsurf.pieces.cover import Cover
from limitsurf.pieces.weights import LocalWeights
from limitsurf.surface import LimitSurface
from limitsurf.values import exact_control_points

if TYPE_CHECKING:
    from limitsurf.scheme.scheme import Scheme
    from limitsurf.tables import RationalTable

Array = NDArray[Any]

MOST_FACES = 8  # around a special corner: the recurrence grows with the cube of their number


def exact_moments(surface: LimitSurface, order: int) -> Moments:
    """Moments up to an order about (0, 0, 0), of a surface of Fractions.

    Raises
    ------
    TypeError
        For special corners of more than `MOST_FACES` faces, and for irrational masks.
    """
    topology, faces = surface.topology, np.arange(len(surface.limit_faces))
    _refuse_wide(surface, faces)
    patches, scheme = topology.exact_groups.patches, topology.rules.scheme
    points, number = numbers.RATIONAL.array(surface.points), numbers.RATIONAL
    found = cut(
        patches, scheme, points, faces, 0 * faces, False, lambda n, work: map(work, [slice(n)])
    )
    forms, total = _Forms.of(scheme, order), _Total(order)
    every = list(range(order + 2))
    for cell in found.points.reshape(len(found), len(found.exponents), 3):
        whole, unit = _integers(cell)
        total.add(number.full(3, number.zero), forms(whole[None], every, unit, False))
    local, covered = LocalWeights(patches, scheme, number), Cover.of(patches, faces)
    controls, kind = exact_control_points(patches, points), patches.kind[covered.patch]
    for one in np.unique(kind[kind > STRIP]).tolist():
        rows = patches.row[covered.patch[kind == one]]
        ids = patches.control_points(one, rows)
        for here, columns, table in local.sectors(one, rows):
            for around in controls[ids[here][:, columns]]:
                limit = table.limit_mask @ around
                total.add(limit, _over_rings(forms, table, around - limit, order))
    return total.moments()


def _refuse_wide(surface: LimitSurface, faces: Array) -> None:
    """Refuse corners of more faces than recurrences are formed for, naming a limit face."""
    patches = surface.patches
    covered = Cover.of(patches, faces)
    kind = patches.kind[covered.patch]
    for one in np.unique(kind[kind > STRIP]).tolist():
        sector = patches.sectors[one]
        assert sector is not None
        if sector.faces > MOST_FACES:
            face = int(covered.owner[np.flatnonzero(kind == one)[0]])
            raise TypeError(
                f"Fractions are summed around at most {MOST_FACES} faces, but limit face {face} "
                f"has a corner that is {sector.place}: give float64 points"
            )


class _Total:
    """Moments about (0, 0, 0) from integrals about points d, with x = d + y."""

    def __init__(self, order: int) -> None:
        number = numbers.RATIONAL
        self.order, self.volume = order, number.zero
        self.first, self.second = number.full(3, number.zero), number.full((3, 3), number.zero)

    def add(self, d: Array, forms: list[Array]) -> None:
        """Add what `_Forms` gives about d."""
        # sums of y .. y (y . n), one y less than in the forms
        inner = [
            forms[k].reshape(-1, 3, 3).trace(axis1=1, axis2=2) for k in range(1, self.order + 1)
        ]
        inner.append(forms[-1])
        flat = d @ forms[0] + inner[0][0]
        self.volume += flat
        if self.order:
            line = forms[1].reshape(3, 3) @ d + inner[1]
            self.first = self.first + d * flat + line
        if self.order > 1:
            both = np.multiply.outer(d, line)
            more = forms[2].reshape(3, 3, 3) @ d + inner[2].reshape(3, 3)
            self.second = self.second + np.multiply.outer(d, d) * flat + both + both.T + more

    def moments(self) -> Moments:
        """Of the body."""
        return Moments(self.volume / 3, self.first / 4, self.second / 5, abs(self.volume))


class _Forms:
    """Integrals of products y .. y n over cells, with n = y_s x y_t, in Fractions.

    Form k, of degree k + 2, has k of y, (3^(k + 1),), but the last has y . n and one y less.
    """

    def __init__(self, scheme: Scheme, order: int) -> None:
        rule, self.order = moments_rule(scheme, 3 + order, True), order
        self._values, self._unit = _integers(rule.values.reshape(-1, rule.values.shape[2]))
        form = Bernstein.of(scheme, True)
        controls = rule.values.reshape(-1, form.size) @ form.from_controls
        self._of_controls, self._controls_unit = _integers(controls)
        self._weights, self._weight_unit = _integers(rule.weights)

    @classmethod
    @lru_cache(maxsize=16)
    def of(cls, scheme: Scheme, order: int) -> _Forms:
        """Those of a scheme's cells."""
        return cls(scheme, order)

    def __call__(self, cells: Array, which: list[int], unit: int, controls: bool) -> list[Array]:
        """Some forms of cells together, from integers (c, n, 3) over a unit.

        Bernstein coefficients or control points of regular patches.
        """
        values, below = (
            (self._of_controls, self._controls_unit) if controls else (self._values, self._unit)
        )
        found = np.concatenate([(values @ cell).reshape(3, -1, 3) for cell in cells], axis=1)
        y, (a, b) = found[0], found[1:].swapaxes(1, 2)[:, :, :, None].reshape(2, 3, -1)
        n = np.stack(
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        )
        n = n * np.tile(self._weights, len(cells))
        powers: list[Array] = [np.ones((len(y), 1), dtype=object)]
        forms = []
        for k in range(max(which, default=-1) + 1):
            own, with_n = powers[-1], n
            if k == self.order + 1:
                own, with_n = powers[-2], (y.T * n).sum(axis=0)[None]
            if k in which:
                form = (with_n @ own).T.ravel()
                forms.append(_fractions(form, self._weight_unit * (below * unit) ** (k + 2)))
            powers.append((powers[-1][:, :, None] * y[:, None]).reshape(len(y), -1))
        return forms


def _over_rings(forms: _Forms, table: RationalTable, around: Array, order: int) -> list[Array]:
    """Forms summed over all rings, from control points about the limit."""
    weights, start = [ring_weights(table, 2 + k) for k in range(order + 2)], annihilator(table)[1]
    values, unit = _integers(around)
    total: list[Any] = [0] * (order + 2)
    for n in range(start + max(map(len, weights))):
        refined = _refined(table, values)
        unit *= table.denominator
        which = [k for k, w in enumerate(weights) if n < start + len(w)]
        for k, form in zip(which, forms(refined[table.pieces], which, unit, True), strict=True):
            total[k] = total[k] + (1 if n < start else weights[k][n - start]) * form
        values = refined[: table.sector.size]
    return total


def _refined(table: RationalTable, values: Array) -> Array:
    """One refinement of integers (K, ...), times the denominator of the table."""
    order = np.argsort(table.rows, kind="stable")
    rows = table.rows[order]
    terms = table.numerators[order][:, None] * values[table.columns[order]]
    found: Array = np.add.reduceat(terms, np.searchsorted(rows, np.arange(table.n_rows)), axis=0)
    return found


@lru_cache(maxsize=128)
def annihilator(table: RationalTable) -> tuple[list[Fraction], int]:
    """What the control points about their limit satisfy, under refinement.

    The coefficients c of ``c_0 y_n + c_1 y_(n-1) + ... = 0``, with c_0 = 1, of lowest degree, and
    the first n of the last term: more than 0 if A has the eigenvalue 0.
    """
    size, rng = table.sector.size, np.random.default_rng(0)
    left, right = rng.integers(1, 1 << 30, (2, size)).astype(object)
    whole = numbers.RATIONAL.array(right)
    y, unit = _integers((whole - table.limit_mask @ whole)[:, None])
    sequence = []
    for _ in range(2 * size):
        sequence.append(Fraction(int((left @ y)[0]), unit))
        y, unit = _refined(table, y)[:size], unit * table.denominator
    found, length = _shortest(sequence)
    _check(table, found, length)
    return found, length - (len(found) - 1)


def _check(table: RationalTable, found: list[Fraction], length: int) -> None:
    """That all control points satisfy the recurrence which generic ones did."""
    size, y = table.sector.size, np.identity(table.sector.size, dtype=object)
    y = numbers.RATIONAL.array(y) - table.limit_mask
    total: Any = 0
    for n in range(length + 1):
        if n >= length + 1 - len(found):
            total = total + found[length - n] * y
        y = _refined(table, y)[:size] / Fraction(table.denominator)
    if (total != 0).any():
        raise RuntimeError(
            f"internal fault: no recurrence at {table.sector.place}; please report it"
        )


def _shortest(sequence: list[Fraction]) -> tuple[list[Fraction], int]:
    """The shortest linear recurrence of a sequence and its length (Berlekamp and Massey)."""
    now, before = [Fraction(1)], [Fraction(1)]
    length, gap, last = 0, 1, Fraction(1)
    for n in range(len(sequence)):
        miss = sum(
            (c * sequence[n - i] for i, c in enumerate(now) if i <= length), start=Fraction(0)
        )
        if not miss:
            gap += 1
            continue
        kept, factor = now, miss / last
        now = now + [Fraction(0)] * (len(before) + gap - len(now))
        for i, c in enumerate(before):
            now[i + gap] -= factor * c
        if 2 * length <= n:
            length, before, last, gap = n + 1 - length, kept, miss, 1
        else:
            gap += 1
    while not now[-1]:
        now.pop()
    return now, length


@lru_cache(maxsize=512)
def ring_weights(table: RationalTable, degree: int) -> list[Fraction]:
    """Weights of the first rings in the sum over all, of integrals of a degree.

    Rings count from `annihilator`'s first.
    """
    c, _ = annihilator(table)
    size = comb(len(c) + degree - 2, degree)
    # sums of powers of the eigenvalues, then of their products
    sums: list[Any] = [None]
    for m in range(1, degree * size + 1):
        own = -m * c[m] if m < len(c) else Fraction(0)
        sums.append(own - sum(c[i] * sums[m - i] for i in range(1, min(m, len(c)))))
    q = [Fraction(1)]
    products: list[Any] = [None]
    for m in range(1, size + 1):
        complete = [Fraction(1)]
        for k in range(1, degree + 1):
            complete.append(sum(sums[i * m] * complete[k - i] for i in range(1, k + 1)) / k)
        products.append(complete[degree])
        q.append(-sum(products[i] * q[m - i] for i in range(1, m + 1)) / m)
    every = sum(q)
    part, found = Fraction(0), []
    for x in q[:-1]:
        part += x
        found.append(part / every)
    return found[::-1]


def _integers(values: Array) -> tuple[Array, int]:
    """Fractions as integers over one unit."""
    unit = lcm(*(x.denominator for x in values.ravel().tolist()))
    found = np.empty(values.size, dtype=object)
    found[:] = [x.numerator * (unit // x.denominator) for x in values.ravel().tolist()]
    return found.reshape(values.shape), unit


def _fractions(values: Array, unit: int) -> Array:
    found = np.empty(values.size, dtype=object)
    found[:] = [Fraction(int(x), unit) for x in values.ravel().tolist()]
    return found.reshape(values.shape)
