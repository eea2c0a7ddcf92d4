"""Eigenbases of dual schemes as sympy expressions.

What `exact.dual` has in digits: cosines and sines, of which one of each parity heads a Jordan chain
where their eigenvalue is one of the outer points, and is taken away from the others. Derived in
``derivations/doo_sabin.py``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import sympy

from limitsurf.caching import cached_property
from limitsurf.exact.dual import DualModes, norm_of
from limitsurf.exact.matrices import subdivision_matrix
from limitsurf.exact.spectrum import dense_basis, outer_modes, spectrum
from limitsurf.exact.symbolic import JordanForm, rational
from limitsurf.scheme.scheme import Scheme
from limitsurf.scheme.sector import Sector

_DIGITS = 60  # to which the residual is looked at
_NOTHING = 1e-9  # of couplings, which else are like 1 / n
_DENOMINATOR = 64  # of eigenvalues that are taken for rational


class DualBasis(JordanForm):
    """Jordan basis of a subdivision matrix as sympy matrices, in the order of `EigenTable`.

    Attributes are computed when first asked for.
    """

    def __init__(self, scheme: Scheme, sector: Sector) -> None:
        self._scheme, self.sector = scheme, sector
        self._matrix = subdivision_matrix(scheme, sector)
        self._numeric = spectrum(scheme, sector)
        ring = self._numeric.ring
        assert isinstance(ring, DualModes)
        self._ring: DualModes = ring
        self._values, self._plain, self._plain_left = outer_modes(self._matrix)
        order, chains = self._numeric.order, self._numeric.chains
        # {ring mode that heads a chain: outer mode at its end}
        self._ends = {order[k]: order[k - 1] - sector.ring for k in chains}

    def _wave(self, mode: int, point: int) -> Any:
        frequency, parity = self._ring.waves[mode]
        turn = sympy.Rational(2 * (frequency * point % self.sector.faces), self.sector.faces)
        return (sympy.sin if parity else sympy.cos)(turn * sympy.pi)

    def _value(self, mode: int) -> Any:
        """The eigenvalue of a ring mode, rational where it is to all digits."""
        value = self._ring.values[mode]
        near = sympy.Rational(int(self._ring.at.mp.nint(value * _DENOMINATOR)), _DENOMINATOR)
        if abs(value - self._ring.at.mp.mpf(near.p) / near.q) < self._ring.at.equal:
            return near
        frequency, _ = self._ring.waves[mode]
        n = self.sector.faces
        weights = [rational(self._matrix.rows[0].get(j, 0)) for j in range(n)]
        turns = [sympy.Rational(2 * (frequency * j % n), n) * sympy.pi for j in range(n)]
        return sum(w * sympy.cos(t) for w, t in zip(weights, turns, strict=True))

    @cached_property
    def _shares(self) -> dict[int, tuple[int, Any]]:
        """{mode: (mode that is taken away from it, how often)}."""
        found = {}
        for k, (pivot, _) in self._ring.taken.items():
            rows = [self._coupling(self._plain_left, x) for x in (k, pivot)]
            # of any outer vector that the pivot is coupled to
            m = max(range(len(rows[1])), key=lambda m: abs(rows[1][m].evalf(20)) * self._at(k, m))
            found[k] = pivot, rows[0][m] / rows[1][m]
        return found

    def _at(self, mode: int, m: int) -> int:
        """Whether an outer eigenvalue is that of a ring mode."""
        near = self._ring.at.to_mpf(self._values[m])
        return int(abs(self._ring.values[mode] - near) < self._ring.at.equal)

    def _coupling(self, left: Any, mode: int) -> list[Any]:
        """Numerators of `_joined`: left outer vectors times what a plain wave makes outside."""
        n, size = self.sector.ring, self.sector.size
        made = [
            sum((rational(w) * self._wave(mode, j) for j, w in row.items() if j < n), sympy.S.Zero)
            for row in self._matrix.rows[n:size]
        ]
        found = [sum(rational(x) * y for x, y in zip(row, made, strict=True)) for row in left]
        return [sympy.S.Zero if _is_zero(x) else x for x in found]

    @cached_property
    def _columns(self) -> list[list[Any]]:
        """Right eigenvectors of the ring."""
        n = self.sector.ring
        found = [[self._wave(k, j) for j in range(n)] for k in range(n)]
        for k, (pivot, share) in self._shares.items():
            found[k] = [x - share * self._wave(pivot, j) for j, x in enumerate(found[k])]
        return found

    @cached_property
    def _rows(self) -> list[list[Any]]:
        """Left eigenvectors of the ring."""
        n = self.sector.ring
        norms = [sympy.Rational(norm_of(n, f), n) for f, _ in self._ring.waves]
        plain = [[norms[k] * self._wave(k, j) for j in range(n)] for k in range(n)]
        found = [list(row) for row in plain]
        for k, (pivot, share) in self._shares.items():
            found[pivot] = [x + share * y for x, y in zip(found[pivot], plain[k], strict=True)]
        return found

    @cached_property
    def _outer(self) -> tuple[Any, Any]:
        """Eigenvectors of the outer points, as columns and as rows, such that chains end in one."""
        W = [list(map(rational, row)) for row in self._plain]
        left = [list(map(rational, row)) for row in self._plain_left]
        for head, end in self._ends.items():
            g = self._coupling(left, head)
            places = [m for m in range(len(W)) if self._at(head, m)]
            for row in W:
                row[end] = sum(row[m] * g[m] for m in places)
            left[end] = [x / g[end] for x in left[end]]
            for m in places:
                if m != end:
                    left[m] = [x - g[m] * y for x, y in zip(left[m], left[end], strict=True)]
        return W, left

    @cached_property
    def _links(self) -> list[list[Any]]:
        """The columns of G, by mode of the ring: (ring, outer)."""
        _, left = self._outer
        plain = [self._coupling(left, k) for k in range(self.sector.ring)]
        found = []
        for k, numerators in enumerate(plain):
            if k in self._shares:
                pivot, share = self._shares[k]
                numerators = [x - share * y for x, y in zip(numerators, plain[pivot], strict=True)]
            value = self._value(k)
            found.append(
                [
                    sympy.S.Zero if self._at(k, m) else x / (value - rational(d))
                    for m, (x, d) in enumerate(zip(numerators, self._values, strict=True))
                ]
            )
        return found

    @cached_property
    def _dense(self) -> list[Any]:
        """Which entries of V and Vinv are not 0, which sums of roots do not tell."""
        noise = self._ring.at.is_noise
        return [~np.vectorize(noise, otypes=[bool])(x) for x in dense_basis(self._numeric)]

    @cached_property
    def V(self) -> Any:
        """Right eigenvectors as columns, (K, K)."""
        ring, size = self.sector.ring, self.sector.size
        W, _ = self._outer
        V = sympy.zeros(size, size)
        for place, k in enumerate(self._numeric.order):
            column = self._columns[k] if k < ring else [sympy.S.Zero] * ring
            for row in W:
                below = sum(x * g for x, g in zip(row, self._links[k], strict=True)) if k < ring \
                    else row[k - ring]  # fmt: skip
                column = [*column, below]
            for i, value in enumerate(column):
                V[i, place] = value if self._dense[0][i, place] else sympy.S.Zero
        return V

    @cached_property
    def Vinv(self) -> Any:
        """Left eigenvectors as rows, (K, K): the inverse of V."""
        ring, size = self.sector.ring, self.sector.size
        _, left = self._outer
        rows = sympy.zeros(size, size)
        for place, k in enumerate(self._numeric.order):
            if k < ring:
                found = self._rows[k] + [sympy.S.Zero] * (size - ring)
            else:
                m = k - ring
                links = [-self._links[j][m] for j in range(ring)]
                found = [
                    sum(g * row[i] for g, row in zip(links, self._rows, strict=True))
                    for i in range(ring)
                ]
                found += left[m]
            for i, value in enumerate(found):
                rows[place, i] = value if self._dense[1][place, i] else sympy.S.Zero
        return rows

    @cached_property
    def limit_mask(self) -> tuple[Any, ...]:
        """Weights of the control points in the limit position, rationals, (K,)."""
        n, size = self.sector.ring, self.sector.size
        return (sympy.Rational(1, n),) * n + (sympy.S.Zero,) * (size - n)

    @cached_property
    def tangent_masks(self) -> tuple[tuple[Any, ...], ...]:
        """Weights of two vectors with a cross product along the limit normal, (2, K) or (0, K)."""
        order, more = self._numeric.order, self.sector.size - self.sector.ring
        rows = (self._rows[order[k]] for k in self._numeric.normal)
        return tuple((*row, *[sympy.S.Zero] * more) for row in rows)

    @cached_property
    def residual(self) -> Any:
        """``A V - V J``, (K, K): the zero matrix, looked at to 60 digits.

        Raises
        ------
        ArithmeticError
            If it is not: then the basis is wrong.
        """
        size = self.sector.size
        A, V, J = (x.evalf(_DIGITS + 20) for x in (self.A, self.V, self.J))
        if max(abs(x) for x in A * V - V * J) > sympy.Float(10) ** -_DIGITS:
            raise ArithmeticError(f"{self.sector}: these are no eigenvectors")
        return sympy.zeros(size, size)


def _is_zero(x: Any) -> bool:
    """Whether a sum of few cosines is 0: those that are not are far from it."""
    return not x.free_symbols and abs(float(sympy.lambdify((), x, "mpmath")())) < _NOTHING
