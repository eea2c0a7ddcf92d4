"""Symbolic eigenbases of creases, corners, cones, darts, pendants and flaps, with the same proof.

**Crease and corner sectors.** The eigenvectors of the curve, extended into the faces, and the ends
of Jordan chains are rational: they solve a rational linear system, one unknown of which is the
coefficient in the chain, so that whether there is one is decided exactly. All others are sines:
polynomials in lambda and s = cos(pi m / 2 k), proved for all m at once.

**Darts.** The odd part is sines, s = cos(pi m / N). The even part is a rational matrix M. Over an
irreducible factor p of its characteristic polynomial, which must be square free, the columns of the
adjugate of x - M are eigenvectors of eigenvalue x in the field Q[x] / p: their residual vanishes
modulo p, which proves all roots of p at once. Sturm's chain counts the real ones, which are
`sympy.CRootOf`; the last two may be a complex pair, whose sum and product follow from theirs. In V
stand the values of those polynomials, or real and imaginary parts: with r and a the modulus and
argument of the root, powers have the parts ``r^n cos(n a)`` and ``r^n sin(n a)``. If the weight b
of the vertex's neighbours is irrational, Q(b) takes the place of Q; its elements are polynomials in
b, and the real roots of p are some of those of its norm, which is rational.

**Cones** are rings of waves as smooth vertices are. **Pendants and flaps** have the eigenvectors of
cones and corners, and one more, of the crease that carries them: it is rational, and found as those
of the curve of a sector are. See ``derivations/sectors.py``.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from itertools import islice
from typing import Any

import sympy
from sympy.polys.domains import QQ
from sympy.polys.matrices import DomainMatrix

from limitsurf.caching import cached_property
from limitsurf.exact import sectors
from limitsurf.exact.fixed import null_space, reduced
from limitsurf.exact.matrices import SubdivisionMatrix, subdivision_matrix
from limitsurf.exact.ring import ring_generators
from limitsurf.exact.symbolic import (
    RING,
    Family,
    L,
    Ring,
    S,
    SymbolicBasis,
    Waves,
    chebyshev,
    polynomial_rows,
    rational,
    without_zero,
)
from limitsurf.scheme.scheme import Scheme

_x = sympy.Symbol("x")
_APART = sympy.Float(10) ** -40  # conjugate roots are further than this from the ones meant


class SectorBasis(SymbolicBasis):
    """Jordan basis at any kind of vertex but a smooth one: as `SymbolicBasis`, so ordered.

    Complex pairs (of darts) have real columns x, y with ``A x = a x - b y``, ``A y = b x + a y``,
    as in `EigenTable`; `eigenvalues` holds a + ib and a - ib.
    """

    @cached_property
    def _ring(self) -> Ring:
        if self.sector.carried:
            still = SectorBasis(self._scheme, self.sector.still)._ring  # noqa: SLF001  (of the same class)
            return CarriedRing(self._matrix, still, self._ends.get(self.sector.ring - 1))
        if self.sector.open:
            return OpenRing(self._scheme, self._matrix, self._numeric.ring.heads)
        if self.sector.kind == "dart":
            return DartRing(self._scheme, self._matrix, self._numeric.ring.values)
        return super()._ring


class Sines:
    """The waves of a smooth ring that are odd about its edge 0, on points of it but the vertex."""

    def __init__(self, scheme: Scheme, valence: int, points: int, norm: int) -> None:
        # the same for every valence, but in small rings the points on both sides may be one; and
        # whatever the vertex does, so its mask is not asked for
        generators = ring_generators(subdivision_matrix(scheme, scheme.sector("cone", 8)))
        orbits = scheme.lattice.orbits
        self._waves, self._norm = Waves(generators, valence, orbits), norm
        every = (2 * j + k - orbits[0] for j in range(valence) for k in orbits)
        self._steps = list(islice(every, points))
        highs = (True, False)[: len(orbits)]
        self._names = [(f, high) for f in range(1, (valence + 1) // 2) for high in highs]
        # that of half the valence, which is rational; at edge neighbours it vanishes
        self.half = len(self._names) if valence % 2 == 0 and len(orbits) > 1 else None
        if self.half is not None:
            self._names.append((valence // 2, False))

    def __len__(self) -> int:
        return len(self._names)

    def eigenvalue(self, k: int) -> Any:
        """Eigenvalue k."""
        return self._waves.eigenvalue(*self._names[k])

    def right(self, k: int) -> list[Any]:
        """Values of wave k at e_0, f_0, e_1, ..., (points,)."""
        frequency, high = self._names[k]
        profile = self._waves.right(frequency, high)
        return self._waves.values(sympy.sin, frequency, self._steps, profile)

    def left(self, k: int) -> list[Any]:
        """Values of left eigenvector k there, times the norm, (points,)."""
        frequency, high = self._names[k]
        profile = tuple(self._norm * x for x in self._waves.left(frequency, high))
        return self._waves.values(sympy.sin, frequency, self._steps, profile)

    def families(self) -> Iterator[Family]:
        """All waves but that of half the valence, as vectors of the ring."""
        n = self._waves.faces
        nodes = without_zero(chebyshev(n, 1))
        if nodes.degree(S) > 0:
            steps = [k if k <= n else k - 2 * n for k in self._steps]
            yield [RING(0), *self._waves.polynomials(steps, 1)], [self._waves.characteristic, nodes]


class OpenRing:
    """The ring of a crease or corner sector: the vectors of the curve, then sines."""

    def __init__(self, scheme: Scheme, matrix: SubdivisionMatrix, heads: dict[int, int]) -> None:
        rows, faces, size = matrix.rows, matrix.sector.faces, matrix.sector.ring
        zero, one = Fraction(0), Fraction(1)
        self.rotations: dict[int, tuple[Any, Any]] = {}
        self._curve, inner = (0, 1, size - 1), range(2, size - 1)
        # a sum over the sector is half of that over a ring of twice its faces
        self._sines = Sines(scheme, 2 * faces, size - 1, norm=2)
        # eigenvectors of the curve: constant, odd and even about the middle of the sector
        own, beside, half = rows[0][0], rows[0].get(1, zero), rows[1][1]
        vectors = [[one, one, one], [zero, one, -one], [2 * beside / (half - 1), one, one]]
        self._values = [one, half, own + half - 1]
        whole = [[v[i] for v in vectors] + [Fraction(i == j) for j in range(3)] for i in range(3)]
        self._dual = [row[3:] for row in reduced(whole)]
        block = [[rows[p].get(c, zero) for c in inner] for p in inner]
        self._columns = [[one] * size]
        # rational waves in which chains end, and what is left of them: the left eigenvectors
        self._ends: dict[int, tuple[list[Fraction], list[Fraction]]] = {}
        ends = {head: end for end, head in heads.items()}
        for head, (value, vector) in enumerate(zip(self._values, vectors, strict=True)):
            if head == 0:
                continue
            sources = [*zip(self._curve, vector, strict=True)]
            brought = [sum((rows[p].get(c, zero) * y for c, y in sources), zero) for p in inner]
            shifted = [[value * (i == j) - x for j, x in enumerate(r)] for i, r in enumerate(block)]
            extended, wave, left = _extension(shifted, brought)
            self._columns.append([vector[0], vector[1], *extended, vector[2]])
            if any(wave):
                self._ends[ends[head]] = [zero, zero, *wave, zero], left

    def eigenvalue(self, k: int) -> Any:
        """Eigenvalue k."""
        return rational(self._values[k]) if k < 3 else self._sines.eigenvalue(k - 3)

    def right(self, k: int) -> list[Any]:
        """Right eigenvector k, (ring,)."""
        known = self.rational(k)
        if known is None:
            return [sympy.Integer(0), *self._sines.right(k - 3)]
        return [rational(x) for x in known]

    def left(self, k: int) -> list[Any]:
        """Left eigenvector k, (ring,)."""
        inner = [sympy.Integer(0)] * (self._curve[2] - 2)
        parts = [sympy.Integer(k == y) for y in range(3)]
        if k >= 3:
            inner = (
                [rational(x) for x in self._ends[k][1]]
                if k in self._ends
                else self._sines.left(k - 3)[1:-1]
            )
            # nothing of the curve's eigenvectors
            parts = [
                -sum(w * rational(x) for w, x in zip(inner, column[2:-1], strict=True))
                for column in self._columns
            ]
        own, first, last = (
            sum(part * rational(row[j]) for part, row in zip(parts, self._dual, strict=True))
            for j in range(3)
        )
        return [own, first, *inner, last]

    def rational(self, k: int) -> list[Fraction] | None:
        """The vectors of the curve, the ends of chains, and the wave of frequency k."""
        if k < 3:
            return self._columns[k]
        if k in self._ends:
            return self._ends[k][0]
        if k - 3 == self._sines.half:
            return [Fraction(int(x)) for x in (0, *self._sines.right(k - 3))]
        return None

    def families(self) -> Iterator[Family]:
        """All sines but that of frequency k."""
        return self._sines.families()


class CarriedRing:
    """The ring of a pendant or flap: the vectors of that whose vertex stays, then the curve's.

    Parameters
    ----------
    still : Ring
    end : int or None
        The vector of `still` in which the chain of the curve's ends, if it heads one.
    """

    def __init__(self, matrix: SubdivisionMatrix, still: Ring, end: int | None) -> None:
        rows, n = matrix.rows, matrix.sector.ring - 1
        self.rotations: dict[int, tuple[Any, Any]] = {}
        self._still, self._last, self._end = still, n, end
        self._value, self._slope, _ = sectors.curve_mode(matrix)
        zero, inner = Fraction(0), range(1, n)
        shifted = [[self._value * (p == c) - rows[p].get(c, zero) for c in inner] for p in inner]
        brought = [rows[p].get(0, zero) * self._slope for p in inner]
        extended, wave, self._left = _extension(shifted, brought)
        self._curve = [self._slope, *extended, Fraction(1)]
        self._wave = [zero, *wave, zero]

    def eigenvalue(self, k: int) -> Any:
        """Eigenvalue k."""
        return rational(self._value) if k == self._last else self._still.eigenvalue(k)

    def right(self, k: int) -> list[Any]:
        """Right eigenvector k, (ring,)."""
        if k in (self._last, self._end):
            return [rational(x) for x in (self._curve if k == self._last else self._wave)]
        column = self._still.right(k)
        return [*column, column[0]]

    def left(self, k: int) -> list[Any]:
        """Left eigenvector k, (ring,)."""
        one, slope = sympy.Integer(1), rational(self._slope)
        if k == self._last:
            return [1 / (slope - 1), *[sympy.Integer(0)] * (k - 1), 1 / (1 - slope)]
        inner = self._still.left(k)[1:] if k != self._end else [rational(x) for x in self._left]
        # its product with the constant vector is 1 if it is the first, that with the curve's is 0
        constant = int(k == 0) - sum(inner)
        carried = sum(w * rational(x) for w, x in zip(inner, self._curve[1:-1], strict=True))
        own = (constant + carried) / (one - slope)
        return [own, *inner, constant - own]

    def rational(self, k: int) -> list[Fraction] | None:
        """The vector of the curve, the end of a chain, and what is rational of the others."""
        if k in (self._last, self._end):
            return self._curve if k == self._last else self._wave
        column = self._still.rational(k)
        return None if column is None else [*column, column[0]]

    def families(self) -> Iterator[Family]:
        """Those of the ring whose vertex stays."""
        for column, modulo in self._still.families():
            yield [*column, column[0]], modulo


class DartRing:
    """The ring of a dart: even vectors, numbered as the eigenvalues that are given, then sines."""

    def __init__(self, scheme: Scheme, matrix: SubdivisionMatrix, values: list[Any]) -> None:
        self.rotations: dict[int, tuple[Any, Any]] = {}
        self._size = matrix.sector.ring
        self._sines = Sines(scheme, matrix.sector.faces, self._size - 1, norm=1)
        self._orbits = sectors.mirrored(matrix.sector)
        self._field, even = _even_matrix(matrix, self._orbits)
        self._factors = even_factors(even, self._field)
        # eigenvalue and factor of each even vector
        self._even: dict[int, tuple[Any, EvenFactor]] = {}
        for factor in self._factors:
            for root in factor.roots:
                k = min(range(len(even)), key=lambda k: abs(complex(values[k]) - float(root)))
                self._even[k] = root, factor
            if factor.pair:
                k = next(k for k, value in enumerate(values) if value.imag > 0)
                modulus, angle = self.rotations[k] = factor.pair
                a, b = modulus * sympy.cos(angle), modulus * sympy.sin(angle)
                self._even[k] = a + sympy.I * b, factor
                self._even[k + 1] = a - sympy.I * b, factor

    def eigenvalue(self, k: int) -> Any:
        """Eigenvalue k."""
        first = len(self._even)
        return self._even[k][0] if k < first else self._sines.eigenvalue(k - first)

    def right(self, k: int) -> list[Any]:
        """Right eigenvector k, (ring,)."""
        first = len(self._even)
        if k >= first:
            return [sympy.Integer(0), *self._sines.right(k - first)]
        return self._unfolded([self._value(p, k) for p in self._even[k][1].right])

    def left(self, k: int) -> list[Any]:
        """Left eigenvector k, (ring,)."""
        first = len(self._even)
        if k >= first:
            return [sympy.Integer(0), *self._sines.left(k - first)]
        # of a complex vector and its conjugate: twice the real part, less twice the imaginary
        scale = 2 if k in self.rotations else -2 if k - 1 in self.rotations else 1
        shares = [sympy.Rational(scale, len(orbit)) for orbit in self._orbits]
        values = [self._value(p, k) for p in self._even[k][1].left]
        return self._unfolded([w * value for w, value in zip(shares, values, strict=True)])

    def rational(self, k: int) -> list[Fraction] | None:
        """Even vectors of rational eigenvalue, and the wave of frequency N / 2."""
        first = len(self._even)
        if self._even[k][1].is_rational if k < first else k - first == self._sines.half:
            return [Fraction(int(x.p), int(x.q)) for x in self.right(k)]
        return None

    def families(self) -> Iterator[Family]:
        """Even vectors over each factor of the characteristic polynomial; sines."""
        # the equation of b, if masks are in Q(b)
        field = self._field
        known = [] if field is QQ else [_in_weight(field.ext.minpoly.rep.to_list()).monic()]
        for factor in self._factors:
            if not factor.is_rational:
                column = [_in_ring(p) for p in factor.right]
                yield self._unfolded(column), [_in_ring(factor.polynomial), *known]
        yield from self._sines.families()

    def _value(self, polynomial: Any, k: int) -> Any:
        """A polynomial at even eigenvalue k; of a pair, first the real, then the imaginary part."""
        wave = sympy.cos if k in self.rotations else sympy.sin
        polar = self.rotations.get(k) or self.rotations.get(k - 1)
        if polar is None:
            return polynomial.as_expr(self._even[k][0])
        modulus, angle = polar
        return sum(c * modulus**n * wave(n * angle) for (n,), c in polynomial.terms())

    def _unfolded(self, values: list[Any]) -> list[Any]:
        """Values at the points of the ring from those at orbits."""
        row = [values[0]] * self._size
        for value, orbit in zip(values, self._orbits, strict=True):
            for point in orbit:
                row[point] = value
        return row


class EvenFactor:
    """Eigenvectors of a matrix over a field whose eigenvalue is any root of a polynomial.

    Attributes
    ----------
    polynomial : sympy.Poly
        Irreducible factor p of the characteristic polynomial, which is square free.
    right, left : list of sympy.Poly
        Eigenvectors, as polynomials modulo p in the eigenvalue. Their product is 1, and the first
        of the entries 1, 0, 2, 3, ... of the right one that is not 0 is 1.
    is_rational : bool
        Whether p has a rational root alone, and a rational eigenvector.
    roots : list
        The real roots of p.
    pair : tuple or None
        Modulus and argument of the others: two at most.
    """

    def __init__(self, matrix: list[list[Any]], characteristic: Any, polynomial: Any) -> None:
        self.polynomial = polynomial
        places = (1, 0, *range(2, len(matrix)))
        columns = (_adjugate(matrix, characteristic, j) for j in places)
        column = next(c for c in ([x.rem(polynomial) for x in y] for y in columns) if any(c))
        first = next(i for i in places if column[i])
        scale = column[first].invert(polynomial)
        self.right = [(x * scale).rem(polynomial) for x in column]
        # the adjugate over the derivative is the product of right and left eigenvector
        transposed = [list(row) for row in zip(*matrix, strict=True)]
        scale = characteristic.diff().invert(polynomial)
        row = _adjugate(transposed, characteristic, first)
        self.left = [(x * scale).rem(polynomial) for x in row]
        degree, self.roots = polynomial.degree(), _real_roots(polynomial)
        real = len(self.roots)
        self.is_rational = degree == 1 and all(
            c.is_Rational for entry in (polynomial, *self.right) for c in entry.all_coeffs()
        )
        self.pair: tuple[Any, Any] | None = None
        if real not in (degree, degree - 2):
            raise ArithmeticError("more than one complex pair of eigenvalues")
        if real < degree:
            coefficients = polynomial.monic().all_coeffs()
            modulus = sympy.sqrt((-1) ** degree * coefficients[-1] / sympy.prod(self.roots))
            self.pair = modulus, sympy.acos((-coefficients[1] - sum(self.roots)) / (2 * modulus))


def even_factors(matrix: list[list[Any]], field: Any = QQ) -> list[EvenFactor]:
    """The eigenvectors of a matrix over a field whose eigenvalues are simple."""
    size = len(matrix)
    whole = DomainMatrix(matrix, (size, size), field).charpoly()
    characteristic = sympy.Poly(whole, _x, domain=field)
    _, factors = characteristic.factor_list()
    if any(power > 1 for _, power in factors):
        raise ArithmeticError("the even part of a dart has an eigenvalue twice")
    return [EvenFactor(matrix, characteristic, factor) for factor, _ in factors]


def _even_matrix(matrix: SubdivisionMatrix, orbits: list[list[int]]) -> tuple[Any, list[list[Any]]]:
    """A dart's matrix on points that are equal within orbits, and the field it is over."""
    weights, field = matrix.rows[0], QQ
    others = {w for c, w in weights.items() if c and not isinstance(w, Fraction)}
    if others:
        field = QQ.algebraic_field(next(iter(others)))
    rows = polynomial_rows(matrix)

    def number(polynomial: Any) -> Any:
        # in b, which generates the field
        terms = {n: c for (_, _, n), c in polynomial.terms()}
        return field.convert(terms.pop(0, QQ(0))) + sum(
            (field.convert(c) * field.unit**n for n, c in terms.items()), field.zero
        )

    zero = RING(0)
    return field, [
        [number(sum((rows[row[0]].get(c, zero) for c in column), zero)) for column in orbits]
        for row in orbits
    ]


def _real_roots(polynomial: Any) -> list[Any]:
    """The real roots of a polynomial over Q, or over a field Q(b), as those of rational ones."""
    if polynomial.domain == QQ:
        return [sympy.rootof(polynomial, k) for k in range(polynomial.count_roots())]
    if polynomial.degree() == 1:
        return [polynomial.domain.to_sympy(-polynomial.monic().rep.to_list()[-1])]
    # the norm has the roots of all conjugates: those that are meant are told apart by 40 digits,
    # and counted by whoever asks
    expression = polynomial.as_expr()
    candidates = [
        sympy.rootof(factor, k)
        for factor, _ in polynomial.norm().factor_list()[1]
        for k in range(factor.count_roots())
    ]
    return [r for r in candidates if abs(expression.subs(_x, r.evalf(80)).evalf(60)) < _APART]


def _adjugate(matrix: list[list[Any]], characteristic: Any, column: int) -> list[Any]:
    """A column of the adjugate of x - matrix: Horner's scheme."""
    field = characteristic.domain
    unit = [field(int(i == column)) for i in range(len(matrix))]
    powers = [unit]
    for c in characteristic.rep.to_list()[1:-1]:
        powers.append(
            [
                sum((x * y for x, y in zip(row, powers[-1], strict=True)), c * one)
                for row, one in zip(matrix, unit, strict=True)
            ]
        )
    return [sympy.Poly(list(entry), _x, domain=field) for entry in zip(*powers, strict=True)]


def _extension(
    shifted: list[list[Fraction]], brought: list[Fraction]
) -> tuple[list[Fraction], list[Fraction], list[Fraction]]:
    """Vectors x, p and w: ``shifted x + p = brought``, p in its kernel, w in that of its transpose.

    If the kernels have dimension 1, w x = 0, and w p = 1 unless p = 0. Otherwise p = 0.
    """
    if not brought:
        return [], [], []
    right = null_space(shifted)
    left = null_space([list(column) for column in zip(*shifted, strict=True)])
    zero, n = Fraction(0), len(brought)
    system = [
        [*row, *(vector[i] for vector in right), b]
        for i, (row, b) in enumerate(zip(shifted, brought, strict=True))
    ]
    system += [[*vector, *[zero] * len(right), zero] for vector in left]
    solution = [row[-1] for row in reduced(system)]
    if not right or not solution[n]:
        return solution[:n], [zero] * n, [zero] * n
    wave = [solution[n] * y for y in right[0]]
    norm = sum(x * y for x, y in zip(left[0], wave, strict=True))
    return solution[:n], wave, [x / norm for x in left[0]]


def _in_ring(polynomial: Any) -> Any:
    """A polynomial in the eigenvalue L, whose coefficients are rational or polynomials in B."""
    total = RING(0)
    for n, coefficient in enumerate(reversed(polynomial.rep.to_list())):
        numbers = coefficient.to_list() if hasattr(coefficient, "to_list") else [coefficient]
        total += L**n * _in_weight(numbers)
    return total


def _in_weight(numbers: list[Any]) -> Any:
    """The polynomial in B of some coefficients, that of the highest power first."""
    return RING.from_dict({(0, 0, n): QQ(c) for n, c in enumerate(reversed(numbers)) if c})
