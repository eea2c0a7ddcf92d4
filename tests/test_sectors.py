"""Creases, corners, cones, darts, pendants and flaps: matrices, spectra, symbols and tables.

Against matrices typed by hand, naive refinement of a tagged cage (oracles_creases), exact ranks
over the rationals, and closed forms.
"""

import dataclasses
import functools
import io
import itertools
import json
import pickle
import random
import zipfile
from fractions import Fraction as F
from math import lcm
from types import SimpleNamespace

import mpmath
import numpy as np
import oracles
import oracles_creases
import pytest
import sympy
from sympy.polys.domains import QQ
from sympy.polys.matrices import DomainMatrix

import limitsurf as ls
from limitsurf import tables
from limitsurf.exact.fixed import BITS, STANDARD, UnsupportedSpectrum
from limitsurf.exact.matrices import subdivision_matrix
from limitsurf.exact.sectors import limit_weights
from limitsurf.exact.spectrum import dense_basis, spectrum
from limitsurf.exact.symbolic_sectors import SectorBasis
from limitsurf.scheme.loop import LOOP
from limitsurf.scheme.sector import KINDS, Sector

CATMULL_CLARK = tables.SCHEMES["catmull-clark"]
ONE = 1 << BITS
TINY = ONE // 10**80
DIGITS = 110
HALF, FOURTH, EIGHTH = F(1, 2), F(1, 4), F(1, 8)
OUTER = [(3, 0), (3, 1), (3, 2), (3, 3), (2, 3), (1, 3), (0, 3)]
PIECES = [(1, 0), (1, 1), (0, 1)]


def positions(kind, k):
    return range(k) if kind in ("crease", "corner", "dart", "flap") else range(1)


def sectors(kinds, sizes):
    return [
        Sector(kind, k, p)
        for kind in kinds
        for k in sizes
        if k > 1 or kind in ("crease", "corner", "flap")
        for p in positions(kind, k)
    ]


def name(sector):
    return f"{sector.kind} {sector.faces}.{sector.position}"


def named(text):
    """The sectors that are called so."""
    found = []
    for word in text.split(", "):
        kind, faces, position = word.replace(".", " ").split()
        found.append(Sector(kind, int(faces), int(position)))
    return found


def each(cases):
    return pytest.mark.parametrize("sector", cases, ids=name)


SHARP = ("crease", "corner", "cone", "dart")
SMALL = sectors(SHARP, range(1, 6))
ALL = sectors(SHARP, range(1, 10))
# whose vertex is carried by a crease beside them
CARRIED = [*sectors(("pendant", "flap"), range(1, 7)), *named("pendant 9.0, flap 7.0, flap 8.3")]
LARGE = named(
    "crease 32.0, crease 33.17, crease 46.45, corner 32.0, corner 33.17, corner 46.45, "
    "cone 40.0, dart 20.0, dart 33.5"
)
# a few of every kind and parity, in the middle and at both ends
SOME = named(
    "crease 1.0, crease 2.0, crease 2.1, crease 3.1, crease 4.0, crease 4.3, crease 5.2, "
    "crease 6.1, crease 8.0, corner 1.0, corner 2.0, corner 2.1, corner 3.0, corner 4.2, "
    "corner 6.5, cone 2.0, cone 3.0, cone 4.0, cone 5.0, cone 8.0, "
    "dart 2.0, dart 3.2, dart 4.0, dart 5.2, dart 6.0, dart 7.6, dart 8.3, "
    "pendant 2.0, pendant 3.0, pendant 4.0, flap 2.0, flap 3.1, flap 3.2, flap 4.1"
)
FEW = named(
    "crease 1.0, crease 3.1, crease 4.0, corner 2.1, corner 3.0, cone 3.0, "
    "dart 2.1, dart 3.2, dart 4.1, dart 6.5, pendant 3.0, flap 2.1, flap 3.0"
)


# --- a tagged cage around the sector, refined naively ---------------------------------------------


class LocalCage:
    """Two rings of quads around vertex 0, numbered by sector and steps along its two edges.

    A pendant or flap has three fins between two more edges, of which that of a flap is its own.
    """

    def __init__(self, kind, k):
        self.kind, self.k, self.closed = kind, k, kind not in ("crease", "corner")
        self.ids = {}
        self.vertex(0, 0, 0)
        quads = [
            [self.vertex(i, a + x, b + y) for x, y in oracles.CORNERS]
            for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))
            for i in range(k)
        ]
        creases = {}
        if kind == "dart":
            curve = [self.vertex(0, a, 0) for a in range(3)]
            creases = dict.fromkeys(itertools.pairwise(curve), 10)
        if kind in ("pendant", "flap"):
            n, own = len(self.ids), kind == "flap"
            curve = [self.vertex(0, a, 0) if own else n + a for a in (1, 2)] + [n + 3]
            self.ids |= {("fin", i): i for i in range(n, n + 10)}
            for i in (n + 4, n + 6, n + 8):
                quads += [[0, curve[0], i, curve[2]], [curve[0], curve[1], i + 1, i]]
            self.curve = curve[0], curve[2]
        corners = {0: 10} if kind in ("corner", "cone") else {}
        self.cage = oracles_creases.Cage(None, quads, creases, corners, boundary="edge_only")

    def key(self, i, a, b):
        if a == b == 0:
            return 0, 0, 0
        if a == 0:  # the other edge of a sector is the first of the next
            i, a, b = i + 1, b, 0
        return (i % self.k if self.closed else i), a, b

    def vertex(self, i, a, b):
        return self.ids.setdefault(self.key(i, a, b), len(self.ids))

    def with_points(self, points):
        return self.cage._replace(points=points)

    def ring(self):
        """Sector and steps of the points of the ring."""
        last = [(self.k - 1, 0, 1)] if not self.closed or self.kind == "flap" else []
        return [(0, 0, 0), *((i, 1, b) for i in range(self.k) for b in (0, 1)), *last]

    def control(self, values, p):
        """Values at the control points of face p, from those at vertices."""
        found = [values[self.vertex(*place)] for place in self.control_places(p)]
        if self.kind in ("pendant", "flap"):
            both = zip(*(values[v] for v in self.curve), strict=True)
            found.insert(len(self.ring()), tuple((a + b) / 2 for a, b in both))
        return found

    @staticmethod
    def on_grid(p, x, y):
        """Sector and steps of a grid position of face p."""
        if y == 0:
            return p - 1, 1, x - 1
        return (p, x - 1, y - 1) if x else (p + 1, y - 1, 1)

    def sides(self, p):
        """Whether face p has sharp edges along u and along v."""
        ends = self.kind in ("crease", "corner", "dart", "flap")
        return ends and p == 0, ends and p == self.k - 1

    def control_places(self, p):
        along_u, along_v = self.sides(p)
        outer = [(x, y) for x, y in OUTER if (y or not along_u) and (x or not along_v)]
        return [*self.ring(), *(self.on_grid(p, x, y) for x, y in outer)]

    @functools.cached_property
    def fine(self):
        """One step, every point a linear form."""
        forms = [(oracles.Stencil({v: F(1)}),) for v in range(len(self.ids))]
        return [point[0] for point in oracles_creases.refine(self.with_points(forms)).points]

    @functools.cached_property
    def index(self):
        """Refined points by their corners: a vertex, the two of an edge, the four of a face."""
        n = len(self.ids)
        edges = sorted({tuple(sorted(e)) for face in self.cage.faces for e in ends(face)})
        index = {frozenset([v]): v for v in range(n)}
        index |= {frozenset(edge): n + e for e, edge in enumerate(edges)}
        return index | {
            frozenset(face): n + len(edges) + f for f, face in enumerate(self.cage.faces)
        }

    def refined(self, place):
        """The form of the refined point at a place, whose steps are half as long."""
        i, a, b = place
        corners = {self.vertex(i, x, y) for x in (a // 2, -(-a // 2)) for y in (b // 2, -(-b // 2))}
        return self.fine[self.index[frozenset(corners)]]

    def matrix(self, p):
        """The square matrix of face p, rows of Fractions."""
        places = self.control_places(p)
        columns = [self.vertex(*place) for place in places]
        rows = []
        for place in places:
            form = self.refined(place)
            assert {v for v, w in form.items() if w} <= set(columns)
            rows.append([form.get(v, F(0)) for v in columns])
        return rows

    def piece_points(self, p):
        """Forms of the control points of the three pieces of face p, [piece][4 j + i]."""
        along_u, along_v = self.sides(p)

        def form(x, y):
            if y == 0 and along_u:
                return 2 * form(x, 1) + -1 * form(x, 2)
            if x == 0 and along_v:
                return 2 * form(1, y) + -1 * form(2, y)
            return self.refined(self.on_grid(p, x, y))

        return [[form(x + i, y + j) for j in range(4) for i in range(4)] for x, y in PIECES]


def ends(face):
    return itertools.pairwise([*face, face[0]])


@functools.cache
def local_cage(kind, k):
    return LocalCage(kind, k)


def naive_matrix(sector):
    return local_cage(sector.kind, sector.faces).matrix(sector.position)


def built_matrix(sector):
    matrix = subdivision_matrix(CATMULL_CLARK, sector)
    return [[row.get(c, F(0)) for c in range(matrix.size)] for row in matrix.rows[: matrix.size]]


# --- matrices -------------------------------------------------------------------------------------

# order: vertex, e_0, f_0, e_1, ...; then (3, 1), (3, 2), (3, 3), (2, 3), (1, 3)
CREASE_1 = [
    [48, 8, 0, 8, 0, 0, 0, 0, 0],
    [32, 32, 0, 0, 0, 0, 0, 0, 0],
    [16, 16, 16, 16, 0, 0, 0, 0, 0],
    [32, 0, 0, 32, 0, 0, 0, 0, 0],
    [8, 48, 0, 0, 8, 0, 0, 0, 0],
    [4, 24, 24, 4, 4, 4, 0, 0, 0],
    [1, 6, 36, 6, 1, 6, 1, 6, 1],
    [4, 4, 24, 24, 0, 0, 0, 4, 4],
    [8, 0, 0, 48, 0, 0, 0, 0, 8],
]
# the rings: edge points between two faces are 3/8 of each end and 1/16 of four corners
CREASE_3 = [
    [48, 8, 0, 0, 0, 0, 0, 8],
    [32, 32, 0, 0, 0, 0, 0, 0],
    [16, 16, 16, 16, 0, 0, 0, 0],
    [24, 4, 4, 24, 4, 4, 0, 0],
    [16, 0, 0, 16, 16, 16, 0, 0],
    [24, 0, 0, 4, 4, 24, 4, 4],
    [16, 0, 0, 0, 0, 16, 16, 16],
    [32, 0, 0, 0, 0, 0, 0, 32],
]
CORNER_2 = [
    [64, 0, 0, 0, 0, 0],
    [32, 32, 0, 0, 0, 0],
    [16, 16, 16, 16, 0, 0],
    [24, 4, 4, 24, 4, 4],
    [16, 0, 0, 16, 16, 16],
    [32, 0, 0, 0, 0, 32],
]
# the dart of two faces: vertex mask (1 - 7/8, 3/8, 3/8, 1/16, 1/16) as any smooth one
DART_2 = [
    [8, 24, 4, 24, 4],
    [32, 32, 0, 0, 0],
    [16, 16, 16, 16, 0],
    [24, 8, 4, 24, 4],
    [16, 16, 0, 16, 16],
]
CONE_2 = [[64, 0, 0, 0, 0], [24, 24, 4, 8, 4], [16, 16, 16, 16, 0], DART_2[3], DART_2[4]]


@pytest.mark.parametrize(
    ("sector", "typed"),
    [
        (Sector("crease", 1), CREASE_1),
        (Sector("crease", 3, 1), CREASE_3),
        (Sector("corner", 2), CORNER_2),
        (Sector("dart", 2, 1), DART_2),
        (Sector("cone", 2), CONE_2),
    ],
    ids=["crease 1", "crease 3", "corner 2", "dart 2", "cone 2"],
)
def test_matrix_typed_by_hand(sector, typed):
    size = len(typed)
    built = built_matrix(sector)
    assert [[64 * w for w in row[:size]] for row in built[:size]] == typed
    assert not any(any(row[size:]) for row in built[:size])


@each(ALL)
def test_matrix_is_one_naive_refinement(sector):
    assert built_matrix(sector) == naive_matrix(sector)


@each([*SMALL, *sectors(("crease", "dart"), (7,))])
def test_pieces_are_made_of_naively_refined_points(sector):
    cage = local_cage(sector.kind, sector.faces)
    matrix = subdivision_matrix(CATMULL_CLARK, sector)
    columns = [cage.vertex(*place) for place in cage.control_places(sector.position)]
    for got, needed in zip(matrix.pieces, cage.piece_points(sector.position), strict=True):
        for k, form in zip(got, needed, strict=True):
            row = {columns[c]: w for c, w in matrix.rows[k].items()}
            assert row == {v: w for v, w in form.items() if w}


# (there is no flap of one face: where a face runs along an edge twice it has two edges)
@each([*(s for s in CARRIED if s.faces > 1), *named("pendant 12.0, flap 9.8")])
def test_carried_matrix_is_one_naive_refinement(sector):
    """As forms on vertices: the ends of a flap are one, the last of its ring is halfway of two."""
    cage, p = local_cage(sector.kind, sector.faces), sector.position
    matrix = subdivision_matrix(CATMULL_CLARK, sector)
    vertices = [(oracles.Stencil({v: F(1)}),) for v in range(len(cage.ids))]

    def halfway(a, b):
        return F(1, 2) * a + F(1, 2) * b

    control = [vertices[cage.vertex(*place)][0] for place in cage.control_places(p)]
    refined = [cage.refined(place) for place in cage.control_places(p)]
    middle = len(cage.ring())
    control.insert(middle, halfway(*(vertices[v][0] for v in cage.curve)))
    edges = [cage.fine[cage.index[frozenset((0, v))]] for v in cage.curve]
    refined.insert(middle, halfway(*edges))

    def nonzero(form):
        return {v: w for v, w in form.items() if w}

    def combined(row):
        total = oracles.Stencil()
        for c, w in row.items():
            total = total + w * control[c]
        return nonzero(total)

    assert [combined(row) for row in matrix.rows[: sector.size]] == [*map(nonzero, refined)]
    for got, needed in zip(matrix.pieces, cage.piece_points(p), strict=True):
        assert [combined(matrix.rows[k]) for k in got] == [*map(nonzero, needed)]


@each([*ALL, *LARGE, *CARRIED])
def test_rows_sum_to_one(sector):
    for row in subdivision_matrix(CATMULL_CLARK, sector).rows:
        assert sum(row.values()) == 1
        assert all(type(w) is F and w for w in row.values())


def test_sector_counts_its_points():
    for sector in ALL:
        sharp = sum(local_cage(sector.kind, sector.faces).sides(sector.position))
        assert sector.ring == 2 * sector.faces + 1 + (sector.kind in ("crease", "corner"))
        assert len(sector.outer) == 7 - sharp
        assert sector.size == sector.ring + 7 - sharp


@pytest.mark.parametrize(
    ("kind", "faces", "position", "message"),
    [
        ("edge", 3, 0, "kind must be one of cone, .*, interior, flap, pendant, got 'edge'"),
        ("crease", 0, 0, "the number of faces is at least 1, got 0"),
        ("corner", -2, 0, "the number of faces is at least 1, got -2"),
        ("dart", 1, 0, "at least 2, got 1"),
        ("cone", 1, 0, "at least 2, got 1"),
        ("interior", 1, 0, "the valence of an interior vertex is at least 2, got 1"),
        ("crease", 3, 3, "position must be 0 to 2, got 3"),
        ("crease", 3, -1, "position must be 0 to 2, got -1"),
        ("cone", 3, 1, "position must be 0 to 0, got 1"),
        ("pendant", 1, 0, "at least 2, got 1"),
        ("pendant", 4, 1, "position must be 0 to 0, got 1"),
        ("flap", 0, 0, "at least 1, got 0"),
        ("interior", 5, 1, "position must be 0 to 0, got 1"),
    ],
)
def test_sectors_that_are_none(kind, faces, position, message):
    with pytest.raises(ValueError, match=message):
        Sector(kind, faces, position)


# --- the spectrum in fixed point ------------------------------------------------------------------


def spectrum_with_inverse(scheme, sector):
    """A spectrum, with V and V^-1."""
    s = spectrum(scheme, sector)
    V, Vinv = dense_basis(s)
    return SimpleNamespace(**vars(s), V=V, Vinv=Vinv)


@functools.cache
def derived(sector):
    return spectrum_with_inverse(CATMULL_CLARK, sector)


def fixed(x):
    return int(mpmath.ldexp(x, BITS))


def times_jordan(columns, s):
    """Columns (..., K) times the Jordan matrix, in fixed point."""
    result = columns * np.array([fixed(x.real) for x in s.eigenvalues], dtype=object) >> BITS
    for k in s.chains:
        result[..., k] += columns[..., k - 1]
    for k in s.pairs:
        turn = fixed(s.eigenvalues[k].imag)
        result[..., k] -= columns[..., k + 1] * turn >> BITS
        result[..., k + 1] += columns[..., k] * turn >> BITS
    return result


def check_basis(s):
    """Assert A V = V J and V V^-1 = 1 to 80 digits."""
    scale = lcm(*(w.denominator for row in s.matrix.rows for w in row.values()))
    rows = s.matrix.rows[: s.matrix.size]
    product = np.stack([sum(int(w * scale) * s.V[c] for c, w in row.items()) for row in rows])
    size = max(1, abs(s.V).max() // ONE)
    assert abs(product - scale * times_jordan(s.V, s)).max() < scale * size * TINY
    columns = np.eye(s.matrix.size, dtype=int)
    if s.matrix.size > 40:  # instead of all columns, a few combinations
        columns = np.random.default_rng(0).integers(-99, 100, (s.matrix.size, 5))
    columns = columns.astype(object)
    identity = s.V.dot(s.Vinv.dot(columns)) >> BITS
    assert abs(identity - columns * ONE).max() < 1000 * size * TINY


def laws(sector):
    """Eigenvalues that have a Jordan block of size two."""
    k = sector.faces
    if sector.kind == "flap":
        return {FOURTH} if k % 2 else {HALF}
    if sector.kind == "crease":
        return {FOURTH} if k % 2 else {HALF} if k % 4 == 0 else set()
    return {HALF} if sector.kind == "corner" and k % 2 == 0 else set()


@each([*ALL, *LARGE, *CARRIED])
def test_basis(sector):
    s = derived(sector)
    check_basis(s)
    assert s.eigenvalues[0] == 1
    assert abs(s.V[:, 0] - ONE).max() < TINY
    for a, b in itertools.pairwise(s.eigenvalues):  # by decreasing modulus, the positive one first
        gap = abs(a) - abs(b)
        assert gap > -(mpmath.mpf(10) ** -60)
        if gap < mpmath.mpf(10) ** -60 and not a.imag:
            assert a.real > b.real - mpmath.mpf(10) ** -60
    assert all(abs(x) < 1 for x in s.eigenvalues[1:])
    # the Jordan law
    assert {F(float(s.eigenvalues[k])) for k in s.chains} == laws(sector)
    assert len(s.chains) == len(laws(sector))
    for k in s.chains:
        assert s.eigenvalues[k] == s.eigenvalues[k - 1]


def wave_values(n, frequencies):
    """Both roots of x^2 - (2 + a^2) / 4 x + 1/16, a = cos(pi f / n); at a = 0 one of them."""
    values = []
    for f in frequencies:
        a = mpmath.cospi(mpmath.mpf(f) / n)
        trace, product = (2 + a * a) / 4, mpmath.mpf(1) / 16
        root = mpmath.sqrt(trace * trace - 4 * product)
        values += [mpmath.mpf(1) / 4] if 2 * f == n else [(trace + root) / 2, (trace - root) / 2]
    return values


@each([s for s in (*ALL, *LARGE, *CARRIED) if s.kind != "dart"])
def test_eigenvalues_are_the_closed_forms(sector):
    s, k = derived(sector), sector.faces
    with mpmath.workdps(DIGITS):
        needed = [mpmath.mpf(1), *(mpmath.mpf(x) / 64 for x in (8, 8, 4, 4, 2, 2, 1))]
        for _ in range(7 - len(sector.outer)):
            needed.remove(mpmath.mpf(2) / 64)
        if sector.carried:
            needed.append(mpmath.mpf(1) / 4)  # of the crease
        if sector.kind in ("cone", "pendant"):
            needed += [(3 + sign * mpmath.sqrt(5)) / 8 for sign in (1, -1)]
            for f in range(1, k):
                both = wave_values(k, [f])  # at a = 0 one of them twice: cosine on f, sine on e
                needed += both if 2 * f != k else [both[0], mpmath.mpf(1) / 4]
        else:
            needed += [mpmath.mpf(1) / 2, mpmath.mpf(1) / (4 if sector.kind == "crease" else 2)]
            needed += wave_values(2 * k, range(1, k + 1))
        for got, value in zip(sorted(s.eigenvalues), sorted(needed), strict=True):
            assert abs(got - value) < mpmath.mpf(10) ** -80


# Sturm: how many complex pairs the even part of the dart of N faces has
PAIRS = {N: int(N >= 6 and N != 20) for N in range(2, 21)} | {33: 1}
# its largest even eigenvalue and its largest odd one
DART_VALUES = {
    3: (0.46206, 0.41010),
    4: (0.5, 0.5),
    5: (0.52642, 0.54999),
    6: (0.54822, 0.57968),
    7: (0.56670, 0.59851),
    8: (0.58191, 0.61112),
    10: (0.60379, 0.62634),
    16: (0.63285, 0.64334),
}


@pytest.mark.parametrize("N", [*range(2, 17), 20, 33])
def test_eigenvalues_of_darts(N):
    s = derived(Sector("dart", N))
    assert len(s.pairs) == PAIRS[N]
    for k in s.pairs:
        a, b = s.eigenvalues[k : k + 2]
        assert a.imag > 0.001
        assert a == b.conjugate()
        assert abs(a) < abs(s.eigenvalues[2])
    # the ring's characteristic polynomial, of the matrix that was refined naively
    ring = 2 * N + 1
    A = [row[:ring] for row in naive_matrix(Sector("dart", N))[:ring]]
    polynomial = sympy.Poly(exact(A).charpoly(), sympy.Symbol("x"), domain=QQ)
    with mpmath.workdps(DIGITS):
        coefficients = [mpmath.mpf(int(c.p)) / int(c.q) for c in polynomial.all_coeffs()]
        values = s.ring.values
        for value in (mpmath.mpmathify(0.3), mpmath.mpf(-2), mpmath.mpc(0, 1)):
            product = mpmath.fprod(value - mpmath.mpmathify(x) for x in values)
            needed = mpmath.polyval(coefficients, value)
            assert abs(product - needed) < max(1, abs(needed)) * mpmath.mpf(10) ** -80
    if N in DART_VALUES:
        found = [float(abs(x)) for x in s.eigenvalues[1:3]]
        assert found == pytest.approx(sorted(DART_VALUES[N], reverse=True), abs=6e-6)


def exact(rows):
    size = len(rows)
    entries = [[QQ(x.numerator, x.denominator) for x in row] for row in rows]
    return DomainMatrix(entries, (size, size), QQ)


def kernels(rows, value):
    """Dimensions of the kernels of A - value and of its square, over the rationals."""
    A = exact([[x - value * (i == j) for j, x in enumerate(row)] for i, row in enumerate(rows)])
    return len(rows) - A.rank(), len(rows) - (A * A).rank()


VALUES = [HALF, FOURTH, EIGHTH, F(1, 16), F(1, 32), F(1, 64)]
RANKED = [s for s in ALL if s.faces <= 4 or s.position in (0, s.faces // 2)]
RANKED += named("crease 12.11, crease 13.12, corner 12.11, corner 13.12")
RANKED += [s for s in CARRIED if s.position in (0, s.faces - 1)]


@each(RANKED)
def test_jordan_law_by_ranks(sector):
    A = built_matrix(sector) if sector.carried else naive_matrix(sector)
    s = derived(sector)
    for value in VALUES:
        first, second = kernels(A, value)
        assert second - first == (value in laws(sector))
        real = [fixed(x) for x in s.eigenvalues if not x.imag]
        assert second == sum(abs(x - int(value * ONE)) < TINY for x in real)


@each([s for s in SMALL if s.position == 0] + [Sector("dart", 6), Sector("crease", 6, 2)])
def test_no_other_jordan_block(sector):
    """The square-free part of the characteristic polynomial, times what the law adds, kills A."""
    A, x = exact(naive_matrix(sector)), sympy.Symbol("x")
    square_free = sympy.Poly(A.charpoly(), x, domain=QQ).sqf_part()
    for law in (set(), laws(sector)):
        polynomial = square_free
        for value in law:
            polynomial *= sympy.Poly(x - sympy.Rational(value), x, domain=QQ)
        total = DomainMatrix.zeros(A.shape, QQ)
        for coefficient in polynomial.rep.to_list():
            total = total * A + DomainMatrix.eye(A.shape, QQ) * coefficient
        assert total.is_zero_matrix == (law == laws(sector))


@pytest.mark.parametrize("kind", ["crease", "corner", "flap"])
@pytest.mark.parametrize("k", range(1, 14))
def test_chains_in_closed_form(kind, k):
    """(A - lambda) g = c p, p a wave of quarter turns (derivations/sectors.py)."""
    sector = Sector(kind, k)
    basis = SectorBasis(CATMULL_CLARK, sector)
    for value in laws(sector):
        place = basis._numeric.chains[0]
        head, end = (basis._ring.rational(basis._numeric.order[i]) for i in (place, place - 1))
        if value == FOURTH:
            needed = [F(0), *itertools.chain(*([F(0), F((-1) ** j)] for j in range(k)))]
            scale = F(3, 4 * k) * head[1] / 2
        else:
            sine = [(0, 1, 0, -1)[j % 4] for j in range(k + 1)]
            needed = [
                F(0),
                *itertools.chain(*([F(p), F(p + q)] for p, q in itertools.pairwise(sine))),
            ]
            scale = F(1, 3 * k) * head[1]
        last = 2 * k + 1
        assert end[:last] == [scale * x for x in needed[:last]]
        assert not any(end[last:])
        assert head[0] == (-head[1] / 2 if value == FOURTH else 0)
        assert head[1] == 1


# --- limits ---------------------------------------------------------------------------------------


def published_limit(sector):
    """Weights of the ring in the limit of its vertex."""
    k, rest = sector.faces, [F(0)] * (sector.ring - 1)
    if sector.carried:
        return [F(4, 6), *rest[1:], F(2, 6)]
    if sector.kind in ("corner", "cone"):
        return [F(1), *rest]
    if sector.kind == "crease":  # the cubic B-spline's 4, 1, 1 over 6
        return [F(4, 6), F(1, 6), *rest[2:], F(1, 6)]
    lucas, fibonacci = (lambda n: int(sympy.lucas(abs(n)))), (lambda n: int(sympy.fibonacci(n)))
    last = F(1, lucas(2 * k))
    mask = [F(k * k)]
    for j in range(k):
        mask += [4 * (1 - lucas(2 * k - 4 * j) * last), 1 - lucas(2 * k - 4 * j - 2) * last]
    mask[1] = 10 * fibonacci(2 * k) * last
    total = k * (k + 5) - 4 * fibonacci(2 * k) * last
    return [w / total for w in mask]


@each([*ALL, *LARGE, *CARRIED])
def test_limit_mask(sector):
    mask = published_limit(sector)
    assert sum(mask) == 1
    assert limit_weights(CATMULL_CLARK, sector) == mask
    mask += [F(0)] * len(sector.outer)
    # a left eigenvector of eigenvalue 1, exactly, and the first row of V^-1
    A = built_matrix(sector)
    size = range(sector.size)
    assert all(sum(mask[i] * A[i][j] for i in size if A[i][j]) == mask[j] for j in size)
    left = derived(sector).Vinv[0]
    assert all(abs(F(int(x), ONE) - w) < F(1, 10**80) for x, w in zip(left, mask, strict=True))
    rational = tables.rational_table(CATMULL_CLARK, sector)
    assert rational.limit_mask.tolist() == mask
    if sector.faces < 10:
        got = tables.eigen_table(CATMULL_CLARK, sector).limit_mask
        assert got == pytest.approx([*map(float, mask)], abs=1e-15)


def random_points(cage, seed=0):
    rng = random.Random(f"{cage.kind} {cage.k} {seed}")
    return [tuple(F(rng.randint(-256, 256), 256) for _ in range(3)) for _ in cage.ids]


def open_points(cage):
    """Points near the cone z = r^2 / 9, the sector spread over its natural angle."""
    rng = random.Random(f"{cage.kind} {cage.k}")
    turn = {"crease": 2 * mpmath.pi / 3, "corner": mpmath.pi / 2}.get(
        cage.kind, 2 * mpmath.pi
    ) / cage.k
    points = []
    for i, a, b in cage.ids:
        angle, radius = turn * (i + (F(b, a + b) if b else 0)), mpmath.hypot(a, b)
        place = radius * mpmath.cos(angle), radius * mpmath.sin(angle), radius**2 / 9
        points.append(tuple(F(round(256 * float(x)) + rng.randint(-16, 16), 256) for x in place))
    return points


@each(SOME)
def test_eigenexpansion_is_the_limit_by_refinement(sector):
    """Position and derivatives at all depths, also on the sharp edges."""
    s, cage, p = derived(sector), local_cage(sector.kind, sector.faces), sector.position
    points = random_points(cage)
    surface = oracles_creases.TaggedSurface(cage.with_points(points))
    control = cage.control(points, p)
    coefficients = s.Vinv.dot(np.array(control, dtype=object)).T  # (3, K)
    samples = [(0, F(3, 4), F(1, 5)), (1, F(2, 3), F(5, 7)), (2, F(1, 9), F(4, 5))]
    samples += [(0, F(4, 5), F(0)), (2, F(0), F(5, 8)), (1, F(1), F(1))]
    # J coefficients = (coefficients^T J^T)^T: the transposed action of `times_jordan`
    for level in range(5):
        if level:
            coefficients = jordan_times(s, coefficients)
        for piece, u, v in samples:
            S, T = 2 * u - PIECES[piece][0], 2 * v - PIECES[piece][1]
            powers = np.array([S**i * T**j for j in range(4) for i in range(4)])
            got = coefficients.dot(powers.dot(s.pieces[piece])) / ONE**2
            needed = surface.evaluate(p, u / 2**level, v / 2**level)
            assert abs(got - np.array(needed)).max() < F(1, 10**78)
            # on a line between pieces the oracle takes the piece nearer the corner
            slopes = np.array([i * S ** max(i - 1, 0) * T**j for j in range(4) for i in range(4)])
            got = coefficients.dot(slopes.dot(s.pieces[piece])) / ONE**2 * 2 ** (level + 1)
            needed = surface.evaluate(p, u / 2**level, v / 2**level, nu=(1, 0))
            assert abs(got - np.array(needed)).max() < F(1, 10**75)


def jordan_times(s, coefficients):
    """J times coefficients (3, K)."""
    result = coefficients * np.array([F(fixed(x.real), ONE) for x in s.eigenvalues])
    for k in s.chains:
        result[:, k - 1] += coefficients[:, k]
    for k in s.pairs:
        turn = F(fixed(s.eigenvalues[k].imag), ONE)
        result[:, k] += turn * coefficients[:, k + 1]
        result[:, k + 1] -= turn * coefficients[:, k]
    return result


@each(SMALL)
def test_pieces_are_splines_through_refined_eigenvectors(sector):
    """Polynomials against B-splines on the naively refined control points of each column of V."""
    s, cage, p = derived(sector), local_cage(sector.kind, sector.faces), sector.position
    row = {cage.vertex(*place): k for k, place in enumerate(cage.control_places(p))}
    for got, forms in zip(s.pieces, cage.piece_points(p), strict=True):
        control = np.stack([sum(w * s.V[row[v]] for v, w in form.items() if w) for form in forms])
        for S, T in ((F(0), F(0)), (F(1), F(1, 3)), (F(2, 5), F(1)), (F(3, 7), F(5, 8))):
            spline = [b * a for b in oracles.cubic_weights(T) for a in oracles.cubic_weights(S)]
            powers = [S**i * T**j for j in range(4) for i in range(4)]
            needed, found = np.array(spline).dot(control), np.array(powers).dot(got)
            assert abs(found - needed).max() < TINY


# where a limit normal exists
NORMALS = {"crease": range(1, 5), "corner": range(1, 3), "dart": range(3, 99)}
NORMALS |= dict.fromkeys(("cone", "pendant", "flap"), range(0))


@each([*ALL, *LARGE, *CARRIED])
def test_normals_exist_where_they_should(sector):
    s = derived(sector)
    assert len(s.normal) == (2 if sector.faces in NORMALS[sector.kind] else 0)
    table = tables.eigen_table(CATMULL_CLARK, sector) if sector.faces < 10 else None
    if table:
        assert table.normal.tolist() == list(s.normal)
        rows = s.Vinv[list(s.normal)].astype(float) / float(ONE) if s.normal else []
        assert len(table.tangent_masks) == len(s.normal)
        for got, needed in zip(table.tangent_masks, rows, strict=True):
            assert got == pytest.approx(needed, abs=1e-13)


@each([s for s in ALL if s.faces in NORMALS[s.kind] and s.faces < 8])
def test_normals_are_approached(sector):
    """In every direction, on every face; slowly (like 1 / n) where a Jordan chain leads."""
    s, cage, p = derived(sector), local_cage(sector.kind, sector.faces), sector.position
    points = open_points(cage)
    surface = oracles_creases.TaggedSurface(cage.with_points(points))
    control = np.array([points[cage.vertex(*place)] for place in cage.control_places(p)])
    first, second = (s.Vinv[k].dot(control) / ONE for k in s.normal)
    pole = np.cross(first.astype(float), second.astype(float))
    pole /= np.linalg.norm(pole)
    for u, v in ((F(1), F(0)), (F(1), F(1, 2)), (F(3, 4), F(1)), (F(1, 5), F(1))):
        away = []
        for level in (8, 24):
            scale = F(1, 2**level)
            normal = surface.normal(p, u * scale, v * scale, digits=20)
            away.append(np.linalg.norm(np.array(normal, dtype=float) - pole))
        assert away[1] < max(0.75 * away[0], 1e-9)
        assert away[1] < 0.2


@each([s for s in ALL if any(s.sharp_sides)])
def test_fields_that_vanish_along_a_crease_vanish_exactly(sector):
    """Neither rounding nor the 96th digit: (2 lambda)^n would amplify it."""
    s, table = derived(sector), tables.eigen_table(CATMULL_CLARK, sector)
    cage, p = local_cage(sector.kind, sector.faces), sector.position
    places = [cage.key(*place) for place in cage.control_places(p)]
    for side, piece, line in ((0, 0, slice(0, 4)), (1, 2, slice(0, 16, 4))):
        if not sector.sharp_sides[side]:
            continue
        curve = [cage.key(*((p, a, 0) if side == 0 else (p, 0, a))) for a in range(3)]
        on = s.V[[places.index(place) for place in curve]]  # (3, K)
        zero = (abs(on) < TINY).all(axis=0)
        assert 0 < zero.sum() < sector.size
        along = table.pieces[piece, line]  # (4, K): powers of the parameter along the edge
        assert (along[:, zero] == 0).all()
        assert (along[:, ~zero] != 0).any(axis=0).all()
        # the others: the curve's own cubic B-spline
        assert (abs(along).max(axis=0) > 1e-3)[~zero].all()


# --- symbols --------------------------------------------------------------------------------------


@functools.cache
def symbolic(sector):
    return SectorBasis(CATMULL_CLARK, sector)


def numbers(matrix):
    """A sympy matrix at mpmath's working precision, by a walk over its expressions."""
    rules = {
        sympy.Add: lambda *x: mpmath.fsum(x),
        sympy.Mul: lambda *x: mpmath.fprod(x),
        sympy.Pow: mpmath.power,
        sympy.cos: mpmath.cos,
        sympy.sin: mpmath.sin,
        sympy.acos: mpmath.acos,
    }
    known = {sympy.pi: +mpmath.pi, sympy.I: mpmath.mpc(0, 1)}

    def number(x):
        if x not in known:
            if x.is_Rational:
                known[x] = mpmath.mpf(int(x.p)) / int(x.q)
            elif isinstance(x, sympy.CRootOf):
                known[x] = mpmath.mpf(str(x.evalf(mpmath.mp.dps + 5)))
            else:
                known[x] = rules[x.func](*map(number, x.args))
        return known[x]

    matrix = sympy.Matrix(matrix)
    return np.array([number(x) for x in matrix], dtype=object).reshape(matrix.shape)


def distance(a, b):
    return abs(a - b).max()


@each(SOME)
def test_symbolic_basis_is_the_fixed_point_one(sector):
    basis, s = symbolic(sector), derived(sector)
    size = sector.size
    with mpmath.workdps(DIGITS):
        bound = mpmath.mpf(10) ** -78
        V, Vinv, J = (numbers(x) for x in (basis.V, basis.Vinv, basis.J))
        assert V.shape == Vinv.shape == J.shape == (size, size)
        assert distance(V, s.V / mpmath.mpf(ONE)) < bound
        assert distance(Vinv, s.Vinv / mpmath.mpf(ONE)) < bound
        values = np.array([mpmath.mpmathify(x) for x in s.eigenvalues], dtype=object)
        assert distance(numbers(basis.eigenvalues)[:, 0], values) < bound
        identity = np.eye(size, dtype=int)
        assert distance(Vinv.dot(V), identity) < bound
        assert distance(numbers(basis.A).dot(V), V.dot(J)) < bound
        assert distance(numbers(basis.limit_mask)[:, 0], Vinv[0]) < bound
        assert len(basis.tangent_masks) == len(s.normal)
        for mask, k in zip(basis.tangent_masks, s.normal, strict=True):
            assert distance(numbers(mask)[:, 0], Vinv[k]) < bound
    assert list(basis.limit_mask[: sector.ring]) == published_limit(sector)
    assert basis.A.tolist() == built_matrix(sector)
    paired = {k for p in s.pairs for k in (p, p + 1)}
    for i, k in itertools.product(range(size), repeat=2):
        if i == k and k not in paired:
            assert basis.J[i, k] == basis.eigenvalues[k]
        elif not (i in paired and k in paired):
            assert basis.J[i, k] == (1 if i == k - 1 and k in s.chains else 0)


@each([*SMALL, *(s for s in CARRIED if s.position == 0)])
def test_symbolic_residual_is_the_zero_matrix(sector):
    assert symbolic(sector).residual == sympy.zeros(sector.size, sector.size)


@each(
    named(
        "crease 12.4, crease 17.16, crease 20.0, corner 12.0, corner 15.7, cone 12.0, cone 25.0, "
        "dart 7.3, dart 12.0, dart 16.5, dart 20.1"
    )
)
def test_symbolic_residual_of_larger_sectors(sector):
    assert SectorBasis(CATMULL_CLARK, sector).residual.is_zero_matrix


@each(named("crease 1.0, corner 1.0, crease 2.0, corner 2.1"))
def test_symbolic_basis_multiplied_out(sector):
    """Where every entry is simple, in plain exact arithmetic."""
    basis = symbolic(sector)
    rest = basis.A * basis.V - basis.V * basis.J
    assert rest.applyfunc(lambda x: sympy.radsimp(sympy.expand(x))).is_zero_matrix
    rest = basis.Vinv * basis.V - sympy.eye(sector.size)
    assert rest.applyfunc(lambda x: sympy.radsimp(sympy.expand(x))).is_zero_matrix


def test_symbolic_rational_columns_multiplied_out():
    """Chains, and what is rational of larger sectors."""
    for sector in (Sector("crease", 5, 1), Sector("crease", 8), Sector("corner", 6, 2)):
        basis = symbolic(sector)
        size, plain = range(sector.size), set()
        for k in size:
            if all(x.is_Rational for x in [*basis.V[:, k], basis.eigenvalues[k]]):
                plain.add(k)
                rest = basis.A * basis.V[:, k] - basis.eigenvalues[k] * basis.V[:, k]
                if k in basis._numeric.chains:
                    rest -= basis.V[:, k - 1]
                assert rest.is_zero_matrix
        chains = basis._numeric.chains
        assert {k for head in chains for k in (head, head - 1)} < plain
        assert len(plain) >= 3 + len(sector.outer)


def perturbed(basis, row):
    """The basis, as if one weight of the matrix had moved from one control point to another."""
    rows = [dict(r) for r in basis._matrix.rows]
    first, second = list(rows[row])[:2]
    rows[row][first] += F(1, 1000)
    rows[row][second] -= F(1, 1000)
    basis._ring  # noqa: B018, made of the right matrix
    basis._matrix = dataclasses.replace(basis._matrix, rows=tuple(rows))
    return basis


@each(named("crease 4.1, corner 3.0, cone 3.0, dart 6.2"))
def test_the_proof_proves(sector):
    assert SectorBasis(CATMULL_CLARK, sector).residual.is_zero_matrix
    matrix = subdivision_matrix(CATMULL_CLARK, sector)
    for row in range(0, sector.size, 3):
        if len(matrix.rows[row]) > 1:
            basis = perturbed(SectorBasis(CATMULL_CLARK, sector), row)
            with pytest.raises(ArithmeticError, match="A V - V J is not zero in row"):
                _ = basis.residual


def test_the_proof_needs_the_right_chains():
    """A chain that is not there, and one that was not seen."""
    basis = SectorBasis(CATMULL_CLARK, Sector("crease", 3))
    basis._ends = {}
    with pytest.raises(ArithmeticError, match="A V - V J is not zero"):
        _ = basis.residual
    basis = SectorBasis(CATMULL_CLARK, Sector("crease", 2))
    order = basis._numeric.order
    basis._ends = {order.index(0): 3}
    with pytest.raises(ArithmeticError):
        _ = basis.residual


@each(named("crease 3.1, crease 4.0, corner 2.0, cone 3.0, dart 3.0, dart 6.1"))
def test_powers_of_the_jordan_matrix(sector):
    basis = symbolic(sector)
    n = sympy.Symbol("n", integer=True, nonnegative=True)
    closed = basis.power(n)
    with mpmath.workdps(60):
        J = numbers(basis.J)
        power = np.array([[mpmath.mpf(i == j) for j in range(len(J))] for i in range(len(J))])
        for k in range(5):
            assert distance(numbers(basis.power(k)), power) < mpmath.mpf(10) ** -50
            assert distance(numbers(closed.subs(n, k)), power) < mpmath.mpf(10) ** -50
            power = power.dot(J)
    for k in basis._numeric.chains:
        value = basis.eigenvalues[k]
        assert sympy.simplify(closed[k - 1, k] - n * value ** (n - 1)) == 0
    for k in set(range(sector.size)) - {i + d for i in basis._numeric.pairs for d in (0, 1)}:
        assert closed[k, k] == basis.eigenvalues[k] ** n


def test_powers_of_smooth_vertices():
    n = sympy.Symbol("n", integer=True, positive=True)
    basis = ls.eigenbasis("catmull-clark", 2).exact
    assert basis.power(n)[4, 5] == n * sympy.Rational(1, 8) ** (n - 1)
    assert basis.power(3) == basis.J**3
    # the exact zero of valence 3: 0^0 = 1
    basis = ls.eigenbasis("catmull-clark", 3).exact
    assert basis.power(0) == sympy.eye(14)
    assert basis.power(2)[13, 13] == 0


def test_complex_pairs_are_roots_of_their_polynomial():
    basis = symbolic(Sector("dart", 6))
    (k,) = basis._numeric.pairs
    factor = next(f for f in basis._ring._factors if f.pair)
    with mpmath.workdps(60):
        a, b = numbers(basis.eigenvalues[k : k + 2])[:, 0]
        coefficients = [mpmath.mpf(int(c.p)) / int(c.q) for c in factor.polynomial.all_coeffs()]
        assert abs(mpmath.polyval(coefficients, a)) < mpmath.mpf(10) ** -50
        assert abs(a - b.conjugate()) < mpmath.mpf(10) ** -50
        assert a.imag > 0.02
        assert abs(a - (mpmath.mpf("0.34397") + mpmath.mpc(0, "0.02992"))) < 1e-5


@pytest.mark.parametrize("N", [3, 5, 6, 8, 12])
def test_even_vectors_of_darts_are_inverse_over_the_number_field(N):
    """Left times right is 1 in Q[x] / p for every irreducible factor p."""
    x = sympy.Symbol("x")
    ring = symbolic(Sector("dart", N))._ring
    assert sum(f.polynomial.degree() for f in ring._factors) == N + 2
    for f in ring._factors:
        assert len(f.roots) + 2 * bool(f.pair) == f.polynomial.degree()
        total = sum((a * b for a, b in zip(f.left, f.right, strict=True)), sympy.Poly(0, x))
        assert total.rem(f.polynomial) == sympy.Poly(1, x, domain=QQ)
        assert f.right[1] == sympy.Poly(1, x, domain=QQ)  # e_0
        assert f.right[0].rem(f.polynomial) == sympy.Poly(2 * x - 1, x, domain=QQ).rem(f.polynomial)


# --- tables ---------------------------------------------------------------------------------------


@each(FEW)
def test_table_is_the_exact_basis_rounded(sector):
    place = {"kind": sector.kind, "faces": sector.faces, "position": sector.position}
    basis = ls.eigenbasis("catmull-clark", **place)
    table, exact, size = basis.float64, basis.exact, sector.size
    with mpmath.workdps(100):
        for got, needed in (
            (table.V, numbers(exact.V)),
            (table.Vinv, numbers(exact.Vinv)),
            (table.J, numbers(exact.J)),
            (table.A, numbers(exact.A)),
        ):
            assert got.shape == (size, size)
            for x, y in zip(got.ravel(), needed.ravel(), strict=True):
                assert abs(x - y) <= 3e-16 * abs(y) + mpmath.mpf(10) ** -60
        values = [abs(x) if x.imag else x for x in numbers(exact.eigenvalues)[:, 0]]
        for high, low, value in zip(*table.rates.tolist(), values, strict=True):
            assert high == float(value)
            assert abs(high + mpmath.mpf(low) - value) < 1e-31
        own = numbers(exact.eigenvalues)[:, 0]
        assert table.eigenvalues.shape == (size,)
        assert np.iscomplexobj(table.eigenvalues) == any(x.imag for x in own)
        assert all(abs(x - y) < 1e-15 for x, y in zip(table.eigenvalues.tolist(), own, strict=True))
    assert abs(table.residual).max() < 1e-13
    assert abs(table.V @ table.Vinv - np.eye(size)).max() < 1e-12
    assert exact.residual.is_zero_matrix
    for either in (exact, table):
        assert len(either.limit_mask) == size
        assert [len(mask) for mask in either.tangent_masks] == [size] * len(table.normal)
    # what the ring makes of left eigenvectors
    left = table.Vinv[np.argsort(table.order)][: sector.ring, : sector.ring]
    data = np.random.default_rng(0).normal(size=(2, sector.ring, 3))
    assert table.ring.coefficients(data) == pytest.approx(left @ data, abs=1e-12)
    assert table.ring.weights(data[..., 0]) == pytest.approx(data[..., 0] @ left, abs=1e-12)


@each([s for s in ALL if s.kind in ("crease", "dart") and s.faces in (1, 2, 5, 8)])
def test_no_noise_where_a_number_is_zero(sector):
    table = tables.eigen_table(CATMULL_CLARK, sector)
    for array in (table.V, table.Vinv, table.pieces, table.links, table.outer):
        assert not ((array != 0) & (abs(array) < 1e-60)).any()


def test_even_vectors_do_not_depend_on_where_the_iteration_begins(monkeypatch):
    """Other libraries for matrices in float64 find other scales and signs."""
    import limitsurf.exact.sectors as module

    matrix = subdivision_matrix(CATMULL_CLARK, Sector("dart", 9))
    before = module.dart_ring(CATMULL_CLARK, matrix, STANDARD)
    true_eig = np.linalg.eig

    def eig(matrix):
        values, vectors = true_eig(matrix)
        turn = np.exp(1j * np.arange(len(values)))
        real = abs(values.imag) < 1e-9
        turn[real] = -1.7
        # pairs stay conjugate
        for k in np.flatnonzero(values.imag > 0):
            other = np.argmin(abs(values - values[k].conjugate()))
            turn[other] = turn[k].conjugate()
        return values, vectors * turn

    monkeypatch.setattr(np.linalg, "eig", eig)
    after = module.dart_ring(CATMULL_CLARK, matrix, STANDARD)
    assert abs(before.right - after.right).max() < TINY
    assert abs(before.inverse - after.inverse).max() < TINY


LAZY = dataclasses.replace(
    CATMULL_CLARK,
    name="lazy",
    vertex=lambda N: (
        CATMULL_CLARK.vertex(4) if N == 4 else (1 - F(3, 2 * N), F(3, 4 * N**2), F(3, 4 * N**2))
    ),
)


@pytest.mark.parametrize("N", [2, 3, 5, 6, 7])
def test_darts_of_other_schemes(N):
    """Other weights at the end of a crease: only darts notice."""
    sector = Sector("dart", N, N - 1)
    s = spectrum_with_inverse(LAZY, sector)
    check_basis(s)
    basis = SectorBasis(LAZY, sector)
    assert basis.residual.is_zero_matrix
    with mpmath.workdps(DIGITS):
        assert distance(numbers(basis.V), s.V / mpmath.mpf(ONE)) < mpmath.mpf(10) ** -78
    mask = limit_weights(LAZY, sector)
    assert mask != limit_weights(CATMULL_CLARK, sector)
    assert list(basis.limit_mask) == [*mask, *[0] * len(sector.outer)]
    for kind in ("crease", "corner", "cone"):
        other = Sector(kind, N)
        assert subdivision_matrix(LAZY, other) is subdivision_matrix(CATMULL_CLARK, other)


def test_darts_with_a_double_eigenvalue_are_refused():
    """1/2 along the crease and 3/8 + 1/8 across it, where the vertex stays."""
    still = dataclasses.replace(
        LOOP, name="still", vertex=lambda N: LOOP.vertex(6) if N == 6 else (F(1), F(0))
    )
    with pytest.raises(UnsupportedSpectrum, match="dart of 3 faces has an eigenvalue twice"):
        spectrum(still, still.sector("dart", 3))


def test_masks_are_asked_for_no_more_than_needed():
    masks = {N: CATMULL_CLARK.vertex(N) for N in (4, 5)}
    scheme = dataclasses.replace(CATMULL_CLARK, name="few", vertex=masks.__getitem__)
    for sector in named("crease 3.1, corner 2.0, cone 6.0, dart 5.0"):
        check_basis(spectrum_with_inverse(scheme, sector))
        assert SectorBasis(scheme, sector).residual.is_zero_matrix
    with pytest.raises(ValueError, match=r"'few': vertex\(6\) raised KeyError"):
        spectrum(scheme, Sector("dart", 6))


def test_symbolic_basis_of_a_dart_refuses_a_double_eigenvalue():
    from limitsurf.exact.symbolic_sectors import even_factors

    double = [[QQ(1), QQ(0)], [QQ(0), QQ(1)]]
    with pytest.raises(ArithmeticError, match="an eigenvalue twice"):
        even_factors(double)
    turns = [[QQ(0)] * 4 for _ in range(4)]
    turns[0][1], turns[1][0], turns[2][3], turns[3][2] = QQ(1), QQ(-1), QQ(1), QQ(-1)
    turns[0][2] = QQ(1, 3)
    turns[3][0] = QQ(1, 5)
    with pytest.raises(ArithmeticError, match="more than one complex pair"):
        even_factors(turns)


# --- stored files ---------------------------------------------------------------------------------


@pytest.fixture
def cache(tmp_path, monkeypatch):
    directory = tmp_path / "cache"
    monkeypatch.setenv("LIMITSURF_CACHE_DIR", str(directory))
    monkeypatch.setattr(tables.cache, "_memory", {})
    monkeypatch.setattr(tables.cache, "SHIPPED", tmp_path / "nothing")
    return directory


def files(directory):
    return {path.name: path.read_bytes() for path in directory.iterdir() if path.is_file()}


def content(table):
    arrays = [getattr(table, f.name) for f in dataclasses.fields(table) if f.type == "Array"]
    ring = [getattr(table.ring, f.name) for f in dataclasses.fields(table.ring)]
    return b"".join(array.tobytes() for array in [*arrays, *ring])


STORED = named("crease 3.1, corner 1.0, cone 3.0, dart 6.5, flap 2.1")


@each(STORED)
def test_files_are_read_back(cache, monkeypatch, sector):
    table = tables.eigen_table(CATMULL_CLARK, sector)
    written = files(cache)
    assert len(written) == (1 if sector.kind == "cone" else 2)
    monkeypatch.setattr(tables.cache, "_memory", {})
    monkeypatch.setattr(tables.cache, "_derive", None)
    monkeypatch.setattr(tables.cache, "_derive_ring", None)
    again = tables.eigen_table(CATMULL_CLARK, sector)
    assert content(again) == content(table)
    assert again.provenance == table.provenance
    assert files(cache) == written
    places = []
    for path in cache.iterdir():
        with zipfile.ZipFile(path) as archive:
            key = json.loads(archive.read("key.json"))["key"]
        assert key["kind"] == sector.kind
        assert key["faces"] == sector.faces
        assert key["format"] == tables.FORMAT
        assert any(mask.startswith("vertex(") and mask != "vertex(4)" for mask in key["masks"]) == (
            sector.kind == "dart"
        )
        places.append(key["position"])
    assert sorted(map(str, places)) == sorted(["all", str(sector.position)][-len(places) :])


def test_positions_share_their_ring(cache, monkeypatch):
    first, second = (tables.eigen_table(CATMULL_CLARK, Sector("crease", 3, p)) for p in (0, 2))
    assert first.ring is second.ring
    assert len(files(cache)) == 3
    monkeypatch.setattr(tables.cache, "_memory", {})
    assert content(tables.eigen_table(CATMULL_CLARK, Sector("crease", 3, 2))) == content(second)


def wrong(right, others):
    """Contents that must not be believed."""
    half = len(right) // 2
    flipped = [bytearray(right) for _ in range(6)]
    for n, copy in enumerate(flipped):
        copy[n * (len(right) - 1) // 5] ^= 1 << n
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("key.json", pickle.dumps({}))
    yield from (b"", right[:half], right[:-1], right + b" ", b"no table" * 99, buffer.getvalue())
    yield from map(bytes, flipped)
    yield from others


@each(STORED)
def test_wrong_files_are_replaced(cache, monkeypatch, sector):
    other = Sector(sector.kind, sector.faces + 1)
    tables.eigen_table(CATMULL_CLARK, other)
    foreign = list(files(cache).values())
    for path in cache.iterdir():
        path.unlink()
    table = tables.eigen_table(CATMULL_CLARK, sector)
    right = files(cache)
    for name in right:
        # also the file of this table's ring in the place of the table, and the other way round
        others = foreign + [content for key, content in right.items() if key != name]
        for bytes_ in wrong(right[name], others):
            (cache / name).write_bytes(bytes_)
            monkeypatch.setattr(tables.cache, "_memory", {})
            assert content(tables.eigen_table(CATMULL_CLARK, sector)) == content(table)
            assert files(cache) == right


def test_shipped_sectors():
    """Whatever faces at creases, corners and darts of usual cages need is shipped."""
    shipped = {*tables.SHIPPED_SECTORS}
    assert len(shipped) == len(tables.SHIPPED_SECTORS)
    assert {*sectors(("crease", "corner"), range(1, 5))} <= shipped
    assert {*sectors(("dart",), (3, 4, 5))} <= shipped
    assert Sector("interior", 5) in shipped


# --- the public call ------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [*SHARP, "pendant", "flap"])
def test_eigenbasis(kind):
    basis = ls.eigenbasis("catmull-clark", kind=kind, faces=np.int64(3))
    assert basis.sector == Sector(kind, 3)
    assert type(basis.valence) is int
    assert basis.valence == 3
    assert basis.provenance["kind"] == kind
    assert "DeRose" in basis.provenance["paper"]
    assert repr(basis).startswith(f"<Eigenbasis of catmull-clark at a {kind} of 3 faces: ")
    text = basis._repr_latex_()
    assert text.startswith("$")
    assert text.count("{") == text.count("}")
    assert f"a {kind} of 3 faces" in text
    assert isinstance(basis.exact, SectorBasis)
    assert basis.exact is basis.exact


def test_eigenbasis_of_a_face():
    basis = ls.eigenbasis("catmull-clark", kind="crease", faces=5, position=3)
    assert basis.sector == Sector("crease", 5, 3)
    assert "face 3" in repr(basis)
    assert basis.float64 is tables.eigen_table(CATMULL_CLARK, basis.sector)
    assert pickle.loads(pickle.dumps(basis)).sector == basis.sector
    other = ls.eigenbasis("catmull-clark", 5, kind="crease", position=3)
    assert other.float64 is basis.float64


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"kind": "crease"}, "either valence or faces, got None and None"),
        ({}, "either valence or faces"),
        ({"valence": 3, "faces": 3}, "either valence or faces, got 3 and 3"),
        ({"kind": "edge", "faces": 3}, "kind must be one of .*, got 'edge'"),
        ({"kind": None, "faces": 3}, "kind must be one of .*, got None"),
        ({"kind": "crease", "faces": 0}, "number of faces is at least 1, got 0"),
        ({"kind": "dart", "faces": 1}, "at least 2, got 1"),
        ({"kind": "crease", "faces": 2.0}, "number of faces is an integer, got 2.0"),
        ({"kind": "crease", "faces": True}, "number of faces is an integer, got True"),
        ({"kind": "crease", "faces": "3"}, "number of faces is an integer, got '3'"),
        ({"kind": "corner", "faces": 2, "position": 2}, "position must be 0 to 1, got 2"),
        ({"kind": "corner", "faces": 2, "position": -1}, "position must be 0 to 1, got -1"),
        ({"kind": "corner", "faces": 2, "position": 0.0}, "position is an integer, got 0.0"),
        ({"kind": "cone", "faces": 4, "position": 1}, "position must be 0 to 0, got 1"),
        ({"valence": 5, "position": 1}, "position must be 0 to 0, got 1"),
    ],
    ids=str,
)
def test_eigenbasis_refuses(arguments, message):
    with pytest.raises(ValueError, match=message):
        ls.eigenbasis("catmull-clark", **arguments)


def test_kinds_are_public():
    assert set(KINDS) == {*SHARP, "pendant", "flap", "interior"}
    assert issubclass(UnsupportedSpectrum, ValueError)
