"""The same eigenbasis as sympy expressions, and the proof that it is one.

With ``s = cos(pi f / N)`` every entry of the 2 x 2 block of frequency f is a polynomial in s, its
eigenvalues are the roots of a quadratic over Q(s), and an eigenvector scaled to have no
denominators is a polynomial in s and lambda, except for the factor sin(pi f / N) of the sine
modes. So ``A v - lambda v`` is a polynomial too, and to vanish modulo the characteristic
polynomial and the polynomial whose roots are ``cos(pi f / N)``, f odd or f even, proves all
frequencies of that parity at once. See ``derivations/eigenstructure.py``.
"""

from __future__ import annotations

from fractions import Fraction
from functools import cached_property
from typing import Any

import sympy
from sympy.polys.domains import QQ
from sympy.polys.rings import ring as polynomial_ring

from limitsurf.exact import spectrum as numeric
from limitsurf.exact.matrices import subdivision_matrix
from limitsurf.exact.scheme import Scheme

# polynomials in an eigenvalue l and in s; with l first, a polynomial that is monic in l and one in
# s alone are a Groebner basis, so that remainders decide
_RING, _l, _s = polynomial_ring("l, s", QQ)


def _rational(x: Fraction) -> Any:
    return sympy.Rational(x.numerator, x.denominator)


def _constant(x: Fraction) -> Any:
    return _RING(QQ(x.numerator, x.denominator))


class SymbolicBasis:
    """Jordan basis of a subdivision matrix as sympy matrices, in the order of `EigenTable`.

    Attributes are computed when first asked for; ``V`` and ``Vinv`` of a large valence N are
    ``(2 N + 8)^2`` expressions. Trigonometric values stay symbolic; ``.evalf(digits)`` or
    ``sympy.N`` turn any entry into as many digits as are wanted.
    """

    def __init__(self, scheme: Scheme, valence: int) -> None:
        self.valence = valence
        self._matrix = subdivision_matrix(scheme, valence)
        self._numeric = numeric.spectrum(scheme, valence)
        ring, size = 2 * valence + 1, self._matrix.size
        rows = self._matrix.rows[ring:size]
        self._outer = [[row.get(ring + j, Fraction(0)) for j in range(7)] for row in rows]
        self._coupling = [{c: w for c, w in row.items() if c < ring} for row in rows]
        self._values, self._W, self._Winv = numeric.outer_eigenbasis(self._outer)
        self._generators = numeric.ring_generators(self._matrix)
        self._modes = self._numeric.modes
        # eigenvalues of the block of frequency f, as functions of s: (trace +- factor root) / 2
        block = self._block
        self._trace = block["ee"] + block["ff"]
        square = (block["ee"] - block["ff"]) ** 2 + 4 * block["ef"] * block["fe"]
        unit, factors = square.factor_list()
        root = _square_root(Fraction(int(unit.numerator), int(unit.denominator)))
        self._factor = _RING(1) if root is None else _constant(root)
        self._radicand = _RING(unit if root is None else 1)
        for factor, power in factors:
            self._factor *= factor ** (power // 2)
            self._radicand *= factor ** (power % 2)

    @cached_property
    def _block(self) -> dict[str, Any]:
        """Entries of the 2 x 2 block as polynomials in s: cos(k theta / 2) is T_k(s)."""
        offset = {"ee": 0, "ff": 0, "ef": 1, "fe": -1}
        return {
            name: sum(
                (_constant(w) * _chebyshev(2 * j + offset[name], 0) for j, w in row.items()),
                _RING(0),
            )
            for name, row in self._generators.items()
        }

    # ---------------------------------------------------------------- expressions

    @cached_property
    def eigenvalues(self) -> tuple[Any, ...]:
        """All eigenvalues with multiplicity, by decreasing modulus, (K,)."""
        return tuple(self._eigenvalue(k) for k in self._numeric.order)

    @cached_property
    def A(self) -> Any:
        """Subdivision matrix, rational, (K, K)."""
        size = self._matrix.size
        entries = {
            (i, j): _rational(w)
            for i, row in enumerate(self._matrix.rows[:size])
            for j, w in row.items()
        }
        return sympy.SparseMatrix(size, size, entries).as_mutable()

    @cached_property
    def J(self) -> Any:
        """Jordan matrix, (K, K); diagonal except, for Catmull-Clark, at valence 2."""
        J = sympy.diag(*self.eigenvalues)
        for k in self._numeric.chains:
            J[k - 1, k] = 1
        return J

    @cached_property
    def V(self) -> Any:
        """Right eigenvectors as columns, (K, K)."""
        ring, size = 2 * self.valence + 1, self._matrix.size
        V = sympy.zeros(size, size)
        W, _ = self._chained_outer
        for place, k in enumerate(self._numeric.order):
            if k >= ring:
                for i in range(7):
                    V[ring + i, place] = _rational(W[i][k - ring])
                continue
            column = self._ring_values(k, self._right(k))
            for i, value in enumerate(column):
                V[i, place] = value
            for i, value in enumerate(self._extension(k, column)):
                V[ring + i, place] = value
        return V

    @cached_property
    def Vinv(self) -> Any:
        """Left eigenvectors as rows, (K, K): the inverse of V."""
        ring, size = 2 * self.valence + 1, self._matrix.size
        rows = sympy.zeros(size, size)
        place = {k: i for i, k in enumerate(self._numeric.order)}
        _, Winv = self._chained_outer
        for m in range(7):
            for j in range(7):
                rows[place[ring + m], ring + j] = _rational(Winv[m][j])
        left = {k: self._ring_values(k, self._left(k)) for k in range(ring)}
        for k, values in left.items():
            for i, value in enumerate(values):
                rows[place[k], i] = value
        # below: - G R^-1
        for k in range(ring):
            column = self._ring_values(k, self._right(k))
            for m, g in enumerate(self._quotients(k, column)):
                if g != 0:
                    for i, value in enumerate(left[k]):
                        rows[place[ring + m], i] -= g * value
        return rows

    @cached_property
    def limit_mask(self) -> tuple[Any, ...]:
        """Weights of the control points in the limit position, rationals, (K,)."""
        own, neighbour, across = map(_rational, numeric.limit_mask(self._matrix))
        return (own, *[neighbour, across] * self.valence, *[sympy.Integer(0)] * 7)

    @cached_property
    def tangent_masks(self) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        """Weights of the subdominant components, even and odd about the diagonal, (2, K)."""
        first, second = (
            (*self._ring_values(k, self._left(k)), *[sympy.Integer(0)] * 7)
            for k in self._numeric.order[1:3]
        )
        return first, second

    @cached_property
    def residual(self) -> Any:
        """``A V - V J``, (K, K): the zero matrix, proved in exact arithmetic.

        The proof is of the eigenvectors as polynomials in s and lambda (see the module), of which
        the entries of `V` are the values.

        Raises
        ------
        ArithmeticError
            If the proof fails: then the basis is wrong.
        """
        self._prove()
        return sympy.zeros(self._matrix.size, self._matrix.size)

    # ---------------------------------------------------------------- how they are made

    def _s(self, frequency: int) -> Any:
        return sympy.cos(sympy.pi * sympy.Rational(frequency, self.valence))

    def _at(self, polynomial: Any, frequency: int) -> Any:
        """A polynomial in s at s = cos(pi f / N), as an expression."""
        value = self._s(frequency)
        powers = polynomial.as_expr(sympy.Symbol("l"), value)
        return powers if value.has(sympy.cos) else sympy.expand(powers)

    def _high(self, k: int) -> bool:
        """Whether ring mode k belongs to the larger of the two eigenvalues of its block."""
        frequency = self._modes[k].frequency
        if frequency == 0:
            return k == 1
        return (k - 3) % 4 < 2

    def _eigenvalue(self, k: int) -> Any:
        ring = 2 * self.valence + 1
        if k >= ring:
            return _rational(self._values[k - ring])
        mode = self._modes[k]
        sign = 1 if self._high(k) else -1
        if mode.frequency == 0:
            if k == 0:
                return sympy.Integer(1)
            trace, product = map(_rational, self._quadratic)
            return (trace + sign * sympy.sqrt(trace**2 - 4 * product)) / 2
        if 2 * mode.frequency == self.valence:
            return self._at(self._block["ee" if mode.parity else "ff"], mode.frequency)
        trace, factor, radicand = (
            self._at(x, mode.frequency) for x in (self._trace, self._factor, self._radicand)
        )
        return sympy.expand_mul((trace + sign * factor * sympy.sqrt(radicand)) / 2)

    @cached_property
    def _quadratic(self) -> tuple[Fraction, Fraction]:
        return numeric.centre_quadratic(numeric.centre_block(self._matrix))

    @cached_property
    def _centre(self) -> Any:
        """Right eigenvectors of frequency 0 as columns, (3, 3), last entries 1."""
        block = numeric.centre_block(self._matrix)
        columns = []
        for k in range(3):
            value = self._eigenvalue(k)
            (a, b, c), (d, e, f) = (
                [_rational(x) - value * int(i == j) for j, x in enumerate(block[i])] for i in (1, 2)
            )
            vector = [b * f - c * e, c * d - a * f, a * e - b * d]
            scale = sympy.radsimp(vector[2])
            if scale == 0:
                scale = next(x for x in map(sympy.radsimp, vector) if x != 0)
            columns.append([sympy.radsimp(x / scale) for x in vector])
        return sympy.Matrix(columns).T

    def _profile(self, k: int) -> tuple[Any, Any]:
        """Right profile (edge neighbours, face corners) of a mode of frequency above 0."""
        mode = self._modes[k]
        if 2 * mode.frequency == self.valence:
            return sympy.Integer(mode.parity), sympy.Integer(1 - mode.parity)
        fe = self._at(self._block["fe"], mode.frequency)
        ff = self._at(self._block["ff"], mode.frequency)
        return (self._eigenvalue(k) - ff) / fe, sympy.Integer(1)

    def _right(self, k: int) -> tuple[Any, Any, Any]:
        if self._modes[k].frequency == 0:
            return tuple(self._centre[:, k])
        return (sympy.Integer(0), *self._profile(k))

    def _left(self, k: int) -> tuple[Any, Any, Any]:
        """Left profile, the norm included: rows of the inverse of the block of eigenvectors."""
        n, mode = self.valence, self._modes[k]
        if mode.frequency == 0:
            a, b, c = self._centre_inverse[k, :]
            return a, b / n, c / n
        if 2 * mode.frequency == n:
            e, f = self._profile(k)
            return sympy.Integer(0), e / n, f / n
        other = k + 2 if self._high(k) else k - 2
        a, b = self._profile(k)[0], self._profile(other)[0]
        # inverse of [[a, b], [1, 1]], and the norm N / 2 of cosines and sines
        scale = 2 / (n * (a - b))
        return sympy.Integer(0), scale, -b * scale

    @cached_property
    def _centre_inverse(self) -> Any:
        inverse = self._centre.adjugate() / self._centre.det()
        return inverse.applyfunc(sympy.radsimp)

    def _ring_values(self, k: int, profile: tuple[Any, Any, Any]) -> list[Any]:
        """A profile times its Fourier factor at the points of the ring, (2 N + 1,)."""
        mode = self._modes[k]
        wave = sympy.sin if mode.parity else sympy.cos
        values = [profile[0]]
        for step in range(-1, 2 * self.valence - 1):
            turn = step * mode.frequency % (2 * self.valence)
            factor = wave(sympy.pi * sympy.Rational(turn, self.valence))
            values.append(profile[2 if (step + 1) % 2 else 1] * factor)
        return values

    def _numerators(self, k: int, column: list[Any]) -> list[Any]:
        """W^-1 A_or times a ring vector, (7,)."""
        coupled = [sum(_rational(w) * column[c] for c, w in row.items()) for row in self._coupling]
        return _times(self._chained_outer[1], coupled)

    def _meets(self, k: int) -> list[bool]:
        """Which outer eigenvalues equal that of ring mode k, (7,)."""
        value = self._modes[k].eigenvalue
        return [abs(value - numeric.to_mpf(d)) < numeric.EQUAL for d in self._values]

    def _quotients(self, k: int, column: list[Any]) -> list[Any]:
        """Column k of G, (7,): 0 where the two eigenvalues are equal."""
        value = self._eigenvalue(k)
        numerators = self._numerators(k, column)
        return [
            sympy.Integer(0) if meets or g == 0 else g / (value - _rational(d))
            for g, d, meets in zip(numerators, self._values, self._meets(k), strict=True)
        ]

    def _extension(self, k: int, column: list[Any]) -> list[Any]:
        """Outer values of ring mode k, (7,)."""
        return _times(self._chained_outer[0], self._quotients(k, column))

    @cached_property
    def _chained_outer(self) -> tuple[list[list[Fraction]], list[list[Fraction]]]:
        """W and W^-1 with the ends of Jordan chains among the columns of W.

        Chains occur only where everything is rational, at frequency 0.
        """
        W, Winv = [list(row) for row in self._W], [list(row) for row in self._Winv]
        order, ring = self._numeric.order, 2 * self.valence + 1
        for place in self._numeric.chains:
            k, end = order[place], order[place - 1] - ring
            profile = [Fraction(str(sympy.nsimplify(x))) for x in self._centre[:, k]]
            column = [profile[0], *profile[1:] * self.valence]
            coupled = [sum(w * column[c] for c, w in row.items()) for row in self._coupling]
            g = {
                m: sum(x * y for x, y in zip(Winv[m], coupled, strict=True))
                for m, meets in enumerate(self._meets(k))
                if meets
            }
            for i in range(7):
                W[i][end] = sum((W[i][m] * x for m, x in g.items()), Fraction(0))
            Winv[end] = [x / g[end] for x in Winv[end]]
            for m in set(g) - {end}:
                Winv[m] = [x - g[m] * y for x, y in zip(Winv[m], Winv[end], strict=True)]
        return W, Winv

    # ---------------------------------------------------------------- the proof

    def _prove(self) -> None:
        """Check ``A v = lambda v`` (+ the end of its chain) for all columns of V."""
        n, ring = self.valence, 2 * self.valence + 1
        # outer eigenvectors
        W, Winv = self._chained_outer
        for m, d in enumerate(self._values):
            column = [_RING(0)] * ring + [_constant(row[m]) for row in W]
            self._check(column, _constant(d), [])
        identity = [[sum(x * W[j][c] for j, x in enumerate(r)) for c in range(7)] for r in Winv]
        if identity != [[Fraction(i == j) for j in range(7)] for i in range(7)]:
            raise ArithmeticError("W^-1 is not the inverse of W")
        # frequency 0: rational numbers, or polynomials in l modulo the quadratic
        trace, product = self._quadratic
        root = _square_root(trace * trace - 4 * product)
        if root is None:
            quadratic = _l**2 - _constant(trace) * _l + _constant(product)
            self._check_scaled(self._centre_column(_l), _l, [quadratic])
        values = [Fraction(1)] + ([] if root is None else [(trace + root) / 2, (trace - root) / 2])
        for place, value in enumerate(values):
            head = self._numeric.order.index(place) if place < 3 else -1
            chain = self._numeric.order[head - 1] - ring if head in self._numeric.chains else None
            self._check_at(self._centre_column(_constant(value)), value, [], chain)
        # frequency N / 2: s = 0
        if n % 2 == 0:
            for parity in (0, 1):
                column = [_RING(0)]
                for step in range(-1, 2 * n - 1):
                    on = (step % 2 == 1) if parity else (step % 2 == 0)
                    column.append(_RING((-1) ** ((step - parity) // 2 % 2) if on else 0))
                value = self._block["ee" if parity else "ff"].coeff(1)
                self._check_at(column, Fraction(int(value.numerator), int(value.denominator)), [])
        # all other frequencies, odd and even ones, cosine and sine
        block = self._block
        quadratic = _l**2 - self._trace * _l + block["ee"] * block["ff"] - block["ef"] * block["fe"]
        for odd in (1, 0):
            nodes = self._nodes(odd)
            if nodes == 1:
                continue
            for parity in (0, 1):
                column = [_RING(0)]
                for step in range(-1, 2 * n - 1):
                    k = step if step <= n else step - 2 * n
                    profile = block["fe"] if step % 2 == 0 else _l - block["ff"]
                    column.append(profile * _chebyshev(k, parity))
                self._check_scaled(column, _l, [quadratic, nodes])
                # frequencies whose eigenvalue is one of the outer ones
                for d in set(self._values):
                    common = quadratic.compose(_l, _constant(d)).gcd(nodes)
                    if common.degree(_s) > 0:
                        special = [x.compose(_l, _constant(d)) for x in column]
                        self._check_at(special, d, [common])

    def _nodes(self, odd: int) -> Any:
        """Product of s - cos(pi f / N) over 0 < f < N / 2 and N / 2 < f < N, f odd or even."""
        n = self.valence
        common = (_chebyshev(n, 0) + (1 if odd else -1)).gcd(_chebyshev(n, 1))
        return common.quo(_s) if common.rem([_s]) == 0 else common

    def _centre_column(self, value: Any) -> list[Any]:
        """Ring part of the eigenvector of frequency 0 for an eigenvalue, as polynomials."""
        block = numeric.centre_block(self._matrix)
        (a, b, c), (d, e, f) = (
            [_constant(x) - value * int(i == j) for j, x in enumerate(block[i])] for i in (1, 2)
        )
        vector = [b * f - c * e, c * d - a * f, a * e - b * d]
        return [vector[0], *vector[1:] * self.valence]

    def _polynomial_numerators(self, column: list[Any]) -> list[Any]:
        coupled = [
            sum((_constant(w) * column[c] for c, w in row.items()), _RING(0))
            for row in self._coupling
        ]
        _, Winv = self._chained_outer
        return [
            sum((_constant(x) * y for x, y in zip(row, coupled, strict=True)), _RING(0))
            for row in Winv
        ]

    def _check_scaled(self, column: list[Any], value: Any, modulo: list[Any]) -> None:
        """Check the extension of a ring vector, scaled by the product of value - d over all d."""
        distinct = sorted(set(self._values))
        scale = _RING(1)
        for d in distinct:
            scale *= value - _constant(d)
        scale = scale.rem(modulo)
        numerators = self._polynomial_numerators(column)
        W, _ = self._chained_outer
        cofactor = {}
        for d in distinct:
            cofactor[d] = _RING(1)
            for other in distinct:
                if other != d:
                    cofactor[d] *= value - _constant(other)
        terms = [
            (g * cofactor[d]).rem(modulo) for g, d in zip(numerators, self._values, strict=True)
        ]
        outer = [
            sum((_constant(x) * t for x, t in zip(row, terms, strict=True)), _RING(0)) for row in W
        ]
        scaled = [(x * scale).rem(modulo) for x in column]
        self._check([*scaled, *outer], value, modulo)

    def _check_at(
        self, column: list[Any], value: Fraction, modulo: list[Any], chain: int | None = None
    ) -> None:
        """Check the extension of a ring vector of rational eigenvalue, that of a chain included."""
        terms, end = [], [_RING(0)] * 7
        W, _ = self._chained_outer
        for m, (g, d) in enumerate(
            zip(self._polynomial_numerators(column), self._values, strict=True)
        ):
            if d != value:
                terms.append(g * _constant(1 / (value - d)))
                continue
            terms.append(_RING(0))
            if m == chain:
                end = [_constant(row[m]) * g for row in W]
            elif g.rem(modulo) != 0:
                raise ArithmeticError(f"eigenvalue {value} has a Jordan block that is not in J")
        outer = [
            sum((_constant(x) * t for x, t in zip(row, terms, strict=True)), _RING(0)) for row in W
        ]
        ring = len(column)
        self._check([*column, *outer], _constant(value), modulo, [_RING(0)] * ring + end)

    def _check(
        self, column: list[Any], value: Any, modulo: list[Any], end: list[Any] | None = None
    ) -> None:
        """Raise unless A times `column` is `value` times it plus `end`, modulo polynomials."""
        for i, row in enumerate(self._matrix.rows[: self._matrix.size]):
            total = -value * column[i]
            for c, w in row.items():
                total += _constant(w) * column[c]
            if end:
                total -= end[i]
            if total.rem(modulo) != 0:
                raise ArithmeticError(f"valence {self.valence}: A V - V J is not zero in row {i}")


def _times(matrix: list[list[Fraction]], vector: list[Any]) -> list[Any]:
    """A rational matrix times expressions."""
    return [
        sum((_rational(x) * y for x, y in zip(row, vector, strict=True) if x), sympy.Integer(0))
        for row in matrix
    ]


def _chebyshev(k: int, parity: int) -> Any:
    """cos(k theta / 2), or sin(k theta / 2) / sin(theta / 2), as a polynomial in s."""
    sign = -1 if parity and k < 0 else 1
    k = abs(k)
    if parity:
        return sign * (_from_sympy(sympy.chebyshevu_poly(k - 1, polys=True)) if k else _RING(0))
    return _from_sympy(sympy.chebyshevt_poly(k, polys=True))


def _from_sympy(polynomial: Any) -> Any:
    return _RING.from_dict({(0, p[0]): QQ(int(c)) for p, c in polynomial.terms()})


def _square_root(x: Fraction) -> Fraction | None:
    """Rational square root, or None."""
    root = sympy.sqrt(_rational(x))
    return Fraction(int(root.p), int(root.q)) if root.is_Rational else None
