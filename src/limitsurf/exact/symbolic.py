"""Eigenbases of subdivision matrices as sympy expressions, and the proof that they are.

With ``s = cos(pi f / N)`` every entry of the block of frequency f is a polynomial in s, its
eigenvalues are the roots of a quadratic over Q(s), or linear, and an eigenvector scaled to have no
denominators is a polynomial in s and lambda, except for the factor sin(pi f / N) of the sine
modes. So ``A v - lambda v`` is a polynomial too, and to vanish modulo the characteristic
polynomial and the polynomial whose roots are ``cos(pi f / N)``, f odd or f even, proves all
frequencies of that parity at once. Where the masks of the vertex are irrational, the weight of its
neighbours is an indeterminate: what is proved of any weight holds for that one. See
``derivations/eigenstructure.py``.

`SymbolicBasis` does what all kinds of corners share, with one of several rings: that of smooth and
conical vertices is here, those of creases, corners and darts are in ``exact/symbolic_sectors.py``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from fractions import Fraction
from functools import reduce
from typing import Any, Protocol

import sympy
from sympy.polys.domains import QQ
from sympy.polys.rings import ring as polynomial_ring

from limitsurf.caching import cached_property
from limitsurf.exact.fixed import EQUAL, to_mpf
from limitsurf.exact.matrices import SubdivisionMatrix, subdivision_matrix
from limitsurf.exact.ring import (
    Generators,
    centre_block,
    centre_quadratic,
    cofactor,
    ring_generators,
    ring_modes,
)
from limitsurf.exact.sectors import limit_weights
from limitsurf.exact.spectrum import Spectrum, outer_modes, spectrum
from limitsurf.scheme.scheme import Scheme
from limitsurf.scheme.sector import Sector

# polynomials in an eigenvalue l, in s and in a weight b; with l first, a polynomial that is monic
# in l and one in s alone are a Groebner basis, so that remainders decide
RING, L, S, B = polynomial_ring("l, s, b", QQ)

# a column of polynomials in L and S, and the polynomials modulo which it is an eigenvector for L
Family = tuple[list[Any], list[Any]]


def rational(x: Any) -> Any:
    """A Fraction as sympy has it; other numbers of sympy as they are."""
    return sympy.Rational(x.numerator, x.denominator) if isinstance(x, Fraction) else x


def constant(x: Fraction) -> Any:
    """A rational as a polynomial."""
    return RING(QQ(x.numerator, x.denominator))


class Ring(Protocol):
    """The eigenvectors of a ring, numbered as in `Spectrum.ring`."""

    # modulus and argument of each complex pair, by its first eigenvalue
    rotations: dict[int, tuple[Any, Any]]

    def eigenvalue(self, k: int) -> Any:
        """Eigenvalue k."""

    def right(self, k: int) -> list[Any]:
        """Right eigenvector k, (ring,)."""

    def left(self, k: int) -> list[Any]:
        """Left eigenvector k, (ring,)."""

    def rational(self, k: int) -> list[Fraction] | None:
        """Right eigenvector k, if that and its eigenvalue are rational by construction."""

    def families(self) -> Iterator[Family]:
        """All the others, as polynomials."""


class JordanForm(ABC):
    """The eigenvalues of a subdivision matrix and its Jordan matrix, as sympy has them."""

    _scheme: Scheme
    sector: Sector
    _matrix: SubdivisionMatrix
    _numeric: Spectrum
    _values: list[Any]  # of the outer points

    @abstractmethod
    def _value(self, k: int) -> Any:
        """Eigenvalue k of the ring."""

    def __repr__(self) -> str:
        name = f"{type(self).__name__} of {self._scheme.name} at {self.sector.place}"
        return f"<{name}: {self.sector.size} control points>"

    @cached_property
    def eigenvalues(self) -> tuple[Any, ...]:
        """All eigenvalues with multiplicity, by decreasing modulus, (K,)."""
        ring = self.sector.ring
        return tuple(
            self._value(k) if k < ring else rational(self._values[k - ring])
            for k in self._numeric.order
        )

    @cached_property
    def A(self) -> Any:
        """Subdivision matrix, (K, K)."""
        size = self.sector.size
        entries = {
            (i, j): rational(w)
            for i, row in enumerate(self._matrix.rows[:size])
            for j, w in row.items()
        }
        return sympy.SparseMatrix(size, size, entries).as_mutable()

    @cached_property
    def J(self) -> Any:
        """Real Jordan matrix, (K, K): a pair a +- ib is the block [[a, b], [-b, a]]."""
        return self.power(1)

    def power(self, n: Any) -> Any:
        """``J^n`` in closed form, (K, K), for a natural number or a symbol for one."""
        n = sympy.sympify(n)
        power = sympy.diag(*(value**n for value in self.eigenvalues))
        for k in self._numeric.chains:
            power[k - 1, k] = n * self.eigenvalues[k] ** (n - 1)
        return power


class SymbolicBasis(JordanForm):
    """Jordan basis of a subdivision matrix as sympy matrices, in the order of `EigenTable`.

    Attributes are computed when first asked for; ``V`` and ``Vinv`` of a large valence N are
    ``(2 N + 8)^2`` expressions. Trigonometric values stay symbolic; ``.evalf(digits)`` or
    ``sympy.N`` turn any entry into as many digits as are wanted.

    Parameters
    ----------
    scheme : Scheme
    valence : int or Sector
        Of a smooth vertex; or a sector of kind "interior" or "cone".
    """

    def __init__(self, scheme: Scheme, valence: int | Sector) -> None:
        self.sector = valence if isinstance(valence, Sector) else scheme.sector("interior", valence)
        self.valence = self.sector.faces
        self._scheme = scheme
        self._matrix = subdivision_matrix(scheme, self.sector)
        self._numeric = spectrum(scheme, self.sector)
        ring, size = self.sector.ring, self.sector.size
        rows = self._matrix.rows[ring:size]
        self._coupling = [{c: w for c, w in row.items() if c < ring} for row in rows]
        self._values, self._W, self._Winv = outer_modes(self._matrix)
        # the end of the Jordan chain of each ring vector that heads one
        order, chains = self._numeric.order, self._numeric.chains
        self._ends = {order[k]: order[k - 1] for k in chains}

    @cached_property
    def _ring(self) -> Ring:
        return SymbolicWaves(self._matrix)

    # ---------------------------------------------------------------- expressions

    def _value(self, k: int) -> Any:
        return self._ring.eigenvalue(k)

    def power(self, n: Any) -> Any:
        """``J^n`` in closed form, (K, K), for a natural number or a symbol for one."""
        n = sympy.sympify(n)
        power = super().power(n)
        for k in self._numeric.pairs:
            modulus, angle = self._ring.rotations[self._numeric.order[k]]
            cosine, sine = (modulus**n * wave(n * angle) for wave in (sympy.cos, sympy.sin))
            power[k : k + 2, k : k + 2] = sympy.Matrix([[cosine, sine], [-sine, cosine]])
        return power

    @cached_property
    def V(self) -> Any:
        """Right eigenvectors as columns, (K, K)."""
        ring, size = self.sector.ring, self.sector.size
        V = sympy.zeros(size, size)
        W, _ = self._outer
        for place, k in enumerate(self._numeric.order):
            column = self._right[k] if k < ring else [sympy.Integer(0)] * ring
            below = _times(W, self._links(k)) if k < ring else [rational(r[k - ring]) for r in W]
            for i, value in enumerate([*column, *below]):
                V[i, place] = value
        return V

    @cached_property
    def Vinv(self) -> Any:
        """Left eigenvectors as rows, (K, K): the inverse of V."""
        ring, size = self.sector.ring, self.sector.size
        rows = sympy.zeros(size, size)
        place = {k: i for i, k in enumerate(self._numeric.order)}
        _, Winv = self._outer
        for m, row in enumerate(Winv):
            for j, w in enumerate(row):
                rows[place[ring + m], ring + j] = rational(w)
        for k in range(ring):
            left = self._ring.left(k)
            for i, value in enumerate(left):
                rows[place[k], i] = value
            # below: - G R^-1
            for m, g in enumerate(self._links(k)):
                if g != 0:
                    for i, value in enumerate(left):
                        rows[place[ring + m], i] -= g * value
        return rows

    @cached_property
    def limit_mask(self) -> tuple[Any, ...]:
        """Weights of the control points in the limit position, rationals, (K,)."""
        return self._padded(map(rational, limit_weights(self._scheme, self.sector)))

    @cached_property
    def tangent_masks(self) -> tuple[tuple[Any, ...], ...]:
        """Weights of two vectors whose cross product is along the limit normal, (2, K) or (0, K).

        At a smooth vertex the subdominant components, even and odd about the diagonal of the face.
        """
        order = self._numeric.order
        return tuple(self._padded(self._ring.left(order[k])) for k in self._numeric.normal)

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
        return sympy.zeros(self.sector.size, self.sector.size)

    # ---------------------------------------------------------------- how they are made

    def _padded(self, values: Any) -> tuple[Any, ...]:
        return (*values, *[sympy.Integer(0)] * len(self._values))

    @cached_property
    def _right(self) -> list[list[Any]]:
        """Right eigenvectors of the ring."""
        return [self._ring.right(k) for k in range(self.sector.ring)]

    def _links(self, k: int) -> list[Any]:
        """Column k of G, (outer,): 0 where the two eigenvalues are equal."""
        if k in self._paired:
            return self._paired[k]
        value, end = self._ring.eigenvalue(k), self._ends.get(k, self.sector.ring)
        numerators = self._numerators(k)
        if end < self.sector.ring:
            numerators = [x - y for x, y in zip(numerators, self._links(end), strict=True)]
        meets = self._meets(k)
        return [
            sympy.Integer(0) if meet or g == 0 else g / (value - rational(d))
            for g, d, meet in zip(numerators, self._values, meets, strict=True)
        ]

    @cached_property
    def _paired(self) -> dict[int, list[Any]]:
        """The columns of G that belong to complex pairs: real and imaginary parts of one."""
        columns: dict[int, list[Any]] = {}
        for k, (modulus, angle) in self._ring.rotations.items():
            a, b = modulus * sympy.cos(angle), modulus * sympy.sin(angle)
            real, imaginary = columns.setdefault(k, []), columns.setdefault(k + 1, [])
            for x, y, d in zip(
                self._numerators(k), self._numerators(k + 1), self._values, strict=True
            ):
                gap = a - rational(d)
                real.append((x * gap + y * b) / (gap**2 + b**2))
                imaginary.append((y * gap - x * b) / (gap**2 + b**2))
        return columns

    def _rational(self, k: int) -> list[Fraction]:
        """Ring vector k of a Jordan chain; all those that are handled are rational."""
        column = self._ring.rational(k)
        if column is None:
            raise ArithmeticError(f"{self.sector}: a Jordan chain of irrational vectors")
        return column

    def _numerators(self, k: int) -> list[Any]:
        """W^-1 A_or times ring vector k, (outer,)."""
        column = self._right[k]
        coupled = [sum(rational(w) * column[c] for c, w in row.items()) for row in self._coupling]
        return _times(self._outer[1], coupled)

    def _meets(self, k: int) -> list[bool]:
        """Which outer eigenvalues equal that of ring vector k, (outer,)."""
        value = self._numeric.ring.values[k]
        return [abs(value - to_mpf(d)) < EQUAL for d in self._values]

    @cached_property
    def _outer(self) -> tuple[list[list[Fraction]], list[list[Fraction]]]:
        """W and W^-1 with the ends of Jordan chains among the columns of W.

        Between ring and outer points there are chains only where everything is rational.
        """
        W, Winv = [list(row) for row in self._W], [list(row) for row in self._Winv]
        for k, end in self._ends.items():
            end -= self.sector.ring
            if end < 0:
                continue
            column = self._rational(k)
            coupled = [sum(w * column[c] for c, w in row.items()) for row in self._coupling]
            g = {
                m: sum((x * y for x, y in zip(Winv[m], coupled, strict=True)), Fraction(0))
                for m, meets in enumerate(self._meets(k))
                if meets
            }
            for row in W:
                row[end] = sum((row[m] * x for m, x in g.items()), Fraction(0))
            Winv[end] = [x / g[end] for x in Winv[end]]
            for m in set(g) - {end}:
                Winv[m] = [x - g[m] * y for x, y in zip(Winv[m], Winv[end], strict=True)]
        return W, Winv

    # ---------------------------------------------------------------- the proof

    def _prove(self) -> None:
        """Check ``A v = lambda v`` (+ the end of its chain) for all columns of V."""
        ring = self.sector.ring
        self._rows = polynomial_rows(self._matrix)
        W, Winv = self._outer
        size = range(len(W))
        if [[sum(x * W[j][c] for j, x in enumerate(row)) for c in size] for row in Winv] != [
            [i == j for j in size] for i in size
        ]:
            raise ArithmeticError("W^-1 is not the inverse of W")
        for m, d in enumerate(self._values):
            column = [RING(0)] * ring + [constant(row[m]) for row in W]
            self._check(column, constant(d), [])
        for k in range(ring):
            known = self._ring.rational(k)
            if known is not None:
                value = self._ring.eigenvalue(k)
                column = [constant(x) for x in known]
                self._check_at(column, Fraction(int(value.p), int(value.q)), [], k)
        for column, modulo in self._ring.families():
            self._check_scaled(column, modulo)
            # members whose eigenvalue is one of the outer ones
            for d in set(self._values):
                common = reduce(lambda p, q: p.gcd(q), (_at(p, d) for p in modulo))
                if common.degree(S) > 0:
                    self._check_at([_at(x, d) for x in column], d, [common])

    def _polynomial_numerators(self, column: list[Any]) -> list[Any]:
        coupled = [
            sum((constant(w) * column[c] for c, w in row.items()), RING(0))
            for row in self._coupling
        ]
        return _combined(self._outer[1], coupled)

    def _check_scaled(self, column: list[Any], modulo: list[Any]) -> None:
        """Check the extension of a family, scaled by the product of L - d over all d."""
        distinct = sorted(set(self._values))
        scale = RING(1)
        for d in distinct:
            scale *= L - constant(d)
        cofactor = {d: scale.quo(L - constant(d)) for d in distinct}
        scale = scale.rem(modulo)
        terms = [
            (g * cofactor[d]).rem(modulo)
            for g, d in zip(self._polynomial_numerators(column), self._values, strict=True)
        ]
        outer = _combined(self._outer[0], terms)
        scaled = [(x * scale).rem(modulo) for x in column]
        self._check([*scaled, *outer], L, modulo)

    def _check_at(
        self, column: list[Any], value: Fraction, modulo: list[Any], k: int | None = None
    ) -> None:
        """Check the extension of ring vectors of rational eigenvalue: vector k, or a family's."""
        ring, end = self.sector.ring, None if k is None else self._ends.get(k)
        _, below = self._extended(column, value, modulo, k)
        link = [RING(0)] * self.sector.size
        if end is not None and end >= ring:
            link = [RING(0)] * ring + [constant(row[end - ring]) for row in self._outer[0]]
        elif end is not None:
            link = [constant(x) for x in self._rational(end)]
            link += self._extended(link, value, [], end)[1]
        self._check([*column, *below], constant(value), modulo, link)

    def _extended(
        self, column: list[Any], value: Fraction, modulo: list[Any], k: int | None
    ) -> tuple[list[Any], list[Any]]:
        """Column of G and outer values of ring vectors of rational eigenvalue."""
        ring, end = self.sector.ring, None if k is None else self._ends.get(k)
        numerators = self._polynomial_numerators(column)
        if end is not None and end < ring:
            before, _ = self._extended([constant(x) for x in self._rational(end)], value, [], end)
            numerators = [x - y for x, y in zip(numerators, before, strict=True)]
        terms = []
        for m, (g, d) in enumerate(zip(numerators, self._values, strict=True)):
            if d != value:
                terms.append(g * constant(1 / (value - d)))
                continue
            terms.append(RING(0))
            if (g - int(end == ring + m)).rem(modulo) != 0:
                raise ArithmeticError(f"eigenvalue {value} has a Jordan block that is not in J")
        return terms, _combined(self._outer[0], terms)

    def _check(
        self, column: list[Any], value: Any, modulo: list[Any], end: list[Any] | None = None
    ) -> None:
        """Raise unless A times `column` is `value` times it plus `end`, modulo polynomials."""
        for i, row in enumerate(self._rows):
            total = -value * column[i]
            for c, w in row.items():
                total += w * column[c]
            if end:
                total -= end[i]
            if total.rem(modulo) != 0:
                raise ArithmeticError(f"{self.sector}: A V - V J is not zero in row {i}")


def polynomial_rows(matrix: SubdivisionMatrix) -> list[dict[int, Any]]:
    """The square matrix, with B for an irrational weight of the vertex's neighbours."""
    own, *others = (dict(row) for row in matrix.rows[: matrix.size])
    if not all(isinstance(w, Fraction) for w in own.values()):
        irrational = {c for c, w in own.items() if c and not isinstance(w, Fraction)}
        if len({own[c] for c in irrational}) != 1:
            raise ArithmeticError(f"{matrix.sector}: several irrational weights")
        rest = 1 - sum(w for c, w in own.items() if c and c not in irrational)
        first = {c: B if c in irrational else constant(w) for c, w in own.items() if c}
        first[0] = constant(Fraction(rest)) - len(irrational) * B
    else:
        first = {c: constant(w) for c, w in own.items()}
    return [first, *({c: constant(w) for c, w in row.items()} for row in others)]


class Waves:
    """The waves around a smooth ring of N faces: all that is common to cosines and sines.

    A wave is named by its frequency, 1 to N / 2, and whether it belongs to the higher of the two
    eigenvalues of its block, or to the only one; at N / 2 by whether it lives on the edge
    neighbours.
    """

    def __init__(self, generators: Generators, faces: int, orbits: tuple[int, ...]) -> None:
        self.faces, self._stride = faces, len(orbits)
        # the block as polynomials in s: cos(k theta / 2) is T_k(s)
        self.block = {
            (a, b): sum(
                (constant(w) * chebyshev(2 * j + orbits[b] - orbits[a], 0) for j, w in row.items()),
                RING(0),
            )
            for (a, b), row in generators.items()
        }
        if len(orbits) == 1:
            self.characteristic = L - self.block[0, 0]
            return
        ee, ff, ef, fe = (self.block[place] for place in ((0, 0), (1, 1), (0, 1), (1, 0)))
        self._trace = ee + ff
        self.characteristic = L**2 - self._trace * L + ee * ff - ef * fe
        # the eigenvalues are (trace +- factor root) / 2
        square = (ee - ff) ** 2 + 4 * ef * fe
        unit, factors = square.factor_list()
        root = square_root(Fraction(int(unit.numerator), int(unit.denominator)))
        self._factor = RING(1) if root is None else constant(root)
        self._radicand = RING(unit if root is None else 1)
        for factor, power in factors:
            self._factor *= factor ** (power // 2)
            self._radicand *= factor ** (power % 2)

    def at(self, polynomial: Any, frequency: int) -> Any:
        """A polynomial in s at s = cos(pi f / N), as an expression."""
        value = sympy.cos(sympy.pi * sympy.Rational(frequency, self.faces))
        powers = polynomial.as_expr(sympy.Symbol("l"), value, sympy.Symbol("b"))
        return powers if value.has(sympy.cos) else sympy.expand(powers)

    def eigenvalue(self, frequency: int, high: bool) -> Any:
        """The larger or the smaller eigenvalue of waves of a frequency."""
        if 2 * frequency == self.faces or self._stride == 1:
            return self.at(self.block[(0, 0) if high else (1, 1)], frequency)
        trace, factor, radicand = (
            self.at(x, frequency) for x in (self._trace, self._factor, self._radicand)
        )
        sign = 1 if high else -1
        return sympy.expand_mul((trace + sign * factor * sympy.sqrt(radicand)) / 2)

    def right(self, frequency: int, high: bool) -> tuple[Any, ...]:
        """Amplitudes on edge neighbours and face corners."""
        if 2 * frequency == self.faces or self._stride == 1:
            return tuple(map(sympy.Integer, (high, not high)[: self._stride]))
        fe, ff = (self.at(self.block[place], frequency) for place in ((1, 0), (1, 1)))
        return (self.eigenvalue(frequency, high) - ff) / fe, sympy.Integer(1)

    def left(self, frequency: int, high: bool) -> tuple[Any, ...]:
        """Left eigenvector at the points, with the norm: N / 2, and N at frequency N / 2."""
        right = self.right(frequency, high)
        if 2 * frequency == self.faces:
            return tuple(x / self.faces for x in right)
        if self._stride == 1:
            return (sympy.Rational(2, self.faces),)
        # inverse of [[e, other], [1, 1]]
        e, other = right[0], self.right(frequency, not high)[0]
        scale = 2 / (self.faces * (e - other))
        return scale, -other * scale

    def values(
        self, wave: Any, frequency: int, steps: Sequence[int], profile: tuple[Any, ...]
    ) -> list[Any]:
        """Amplitudes times a wave at the points of the ring, so many half faces from its origin."""
        turns = (step * frequency % (2 * self.faces) for step in steps)
        return [
            profile[i % self._stride] * wave(sympy.pi * sympy.Rational(turn, self.faces))
            for i, turn in enumerate(turns)
        ]

    def polynomials(self, steps: Sequence[int], parity: int) -> list[Any]:
        """All right eigenvectors of positive frequency but N / 2, without their denominators.

        Cosines (parity 0), or sines over sin(pi f / N) (parity 1), as polynomials in L and S.
        """
        profile: tuple[Any, ...] = (RING(1),)
        if self._stride == 2:
            profile = L - self.block[1, 1], self.block[1, 0]
        return [profile[i % self._stride] * chebyshev(k, parity) for i, k in enumerate(steps)]


class SymbolicWaves:
    """The ring of a smooth or conical vertex; angles from the middle of face 0."""

    def __init__(self, matrix: SubdivisionMatrix) -> None:
        orbits = matrix.sector.lattice.orbits
        self._faces, self._orbits = matrix.sector.faces, orbits
        self._size = 1 + len(orbits)  # vectors of frequency 0
        self._modes = ring_modes(matrix)
        self._waves = Waves(ring_generators(matrix), self._faces, orbits)
        self._block = centre_block(matrix)
        trace, product = centre_quadratic(self._block)
        self._trace, self._product = trace, product
        if len(orbits) == 2:
            self._root = square_root(trace * trace - 4 * product)
        else:  # rational or not
            self._root = trace if isinstance(trace, Fraction) else None
        self.rotations: dict[int, tuple[Any, Any]] = {}
        self._steps = [2 * j + k for j in range(self._faces) for k in orbits]
        self._rows = polynomial_rows(matrix)[: self._size]

    def _high(self, k: int) -> bool:
        if 2 * self._modes[k].frequency == self._faces:
            return bool(self._modes[k].parity)
        return (k - self._size) % (2 * len(self._orbits)) < 2

    def eigenvalue(self, k: int) -> Any:
        """Eigenvalue k."""
        if k == 0:
            return sympy.Integer(1)
        if k >= self._size:
            return self._waves.eigenvalue(self._modes[k].frequency, self._high(k))
        trace, product = rational(self._trace), rational(self._product)
        if self._size == 2:
            return trace
        return (trace + (1 if k == 1 else -1) * sympy.sqrt(trace**2 - 4 * product)) / 2

    def right(self, k: int) -> list[Any]:
        """Right eigenvector k, (ring,)."""
        if k < self._size:
            own, *around = self._centre[:, k]
            return [own, *around * self._faces]
        return self._wave(k, self._waves.right(self._modes[k].frequency, self._high(k)))

    def left(self, k: int) -> list[Any]:
        """Left eigenvector k, (ring,)."""
        if k < self._size:
            own, *around = self._centre_inverse[k, :]
            return [own, *[x / self._faces for x in around] * self._faces]
        return self._wave(k, self._waves.left(self._modes[k].frequency, self._high(k)))

    def rational(self, k: int) -> list[Fraction] | None:
        """Frequency 0, if it is rational, and frequency N / 2."""
        half = 2 * self._modes[k].frequency == self._faces
        if half or k == 0 or (k < self._size and self._root is not None):
            return [Fraction(int(x.p), int(x.q)) for x in self.right(k)]
        return None

    def families(self) -> Iterator[Family]:
        """Cosines and sines of odd and of even frequencies; frequency 0, if it is irrational."""
        n = self._faces
        if self._root is None:
            block = [[RING(0)] * self._size for _ in range(self._size)]
            for total, row in zip(block, self._rows, strict=True):
                for c, w in row.items():
                    total[0 if c == 0 else 1 + (c - 1) % len(self._orbits)] += w
            trace, product = centre_quadratic(block)
            modulo = L - trace if self._size == 2 else L**2 - trace * L + product
            own, *around = self._cross(block, L)
            yield [own, *around * n], [modulo]
        for odd in (1, 0):
            # the product of s - cos(pi f / N) over 0 < f < N / 2 and N / 2 < f < N
            nodes = (chebyshev(n, 0) + (1 if odd else -1)).gcd(chebyshev(n, 1))
            nodes = without_zero(nodes)
            # the latter half of the ring clockwise: of lower degree
            steps = [step if step <= n else step - 2 * n for step in self._steps]
            for parity in (0, 1) if nodes.degree(S) > 0 else ():
                wave = self._waves.polynomials(steps, parity)
                yield [RING(0), *wave], [self._waves.characteristic, nodes]

    def _wave(self, k: int, profile: tuple[Any, ...]) -> list[Any]:
        mode = self._modes[k]
        wave = sympy.sin if mode.parity else sympy.cos
        return [sympy.Integer(0), *self._waves.values(wave, mode.frequency, self._steps, profile)]

    @staticmethod
    def _cross(block: list[list[Any]], value: Any) -> list[Any]:
        """Eigenvector of a block: orthogonal to the rows of block - value after the first."""
        rows = [
            [x - value if i == j else x for j, x in enumerate(row)] for i, row in enumerate(block)
        ]
        return [cofactor(rows, 0, j) for j in range(len(block))]

    @cached_property
    def _centre(self) -> Any:
        """Right eigenvectors of frequency 0 as columns, last entries 1 if they can be."""
        block = [[rational(x) for x in row] for row in self._block]
        columns = []
        for k in range(self._size):
            vector = self._cross(block, self.eigenvalue(k))
            scale = sympy.radsimp(vector[-1])
            if scale == 0:
                scale = next(x for x in map(sympy.radsimp, vector) if x != 0)
            columns.append([sympy.radsimp(x / scale) for x in vector])
        return sympy.Matrix(columns).T

    @cached_property
    def _centre_inverse(self) -> Any:
        inverse = self._centre.adjugate() / self._centre.det()
        return inverse.applyfunc(sympy.radsimp)


def without_zero(nodes: Any) -> Any:
    """A polynomial in S without its simple root at 0, if it has one."""
    return nodes.quo(S) if nodes.rem([S]) == 0 else nodes


def chebyshev(k: int, parity: int) -> Any:
    """cos(k theta / 2), or sin(k theta / 2) / sin(theta / 2), as a polynomial in s."""
    sign = -1 if parity and k < 0 else 1
    k = abs(k)
    if parity:
        return sign * (_from_sympy(sympy.chebyshevu_poly(k - 1, polys=True)) if k else RING(0))
    return _from_sympy(sympy.chebyshevt_poly(k, polys=True))


def square_root(x: Fraction) -> Fraction | None:
    """Rational square root, or None."""
    root = sympy.sqrt(rational(x))
    return Fraction(int(root.p), int(root.q)) if root.is_Rational else None


def _from_sympy(polynomial: Any) -> Any:
    return RING.from_dict({(0, p[0], 0): QQ(int(c)) for p, c in polynomial.terms()})


def _at(polynomial: Any, value: Fraction) -> Any:
    """A polynomial at a rational L."""
    return polynomial.compose(L, constant(value))


def _times(matrix: list[list[Fraction]], vector: list[Any]) -> list[Any]:
    """A rational matrix times expressions."""
    return [
        sum((rational(x) * y for x, y in zip(row, vector, strict=True) if x), sympy.Integer(0))
        for row in matrix
    ]


def _combined(matrix: list[list[Fraction]], vector: list[Any]) -> list[Any]:
    """A rational matrix times polynomials."""
    return [
        sum((constant(x) * y for x, y in zip(row, vector, strict=True) if x), RING(0))
        for row in matrix
    ]
