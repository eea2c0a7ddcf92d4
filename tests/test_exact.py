"""Schemes, subdivision matrices and spectra against papers, naive refinement, exact arithmetic."""

import dataclasses
import functools
import itertools
import random
from fractions import Fraction as F
from math import comb, lcm
from types import SimpleNamespace

import mpmath
import numpy as np
import oracles
import pytest
import sympy
from sympy.polys.domains import QQ
from sympy.polys.matrices import DomainMatrix

import limitsurf as ls
from limitsurf import tables
from limitsurf.exact import spectrum
from limitsurf.exact.fixed import BITS, UnsupportedSpectrum
from limitsurf.exact.matrices import subdivision_matrix
from limitsurf.exact.ring import ring_generators, smooth_limit
from limitsurf.exact.symbolic import SymbolicBasis
from limitsurf.scheme.sector import Sector

CATMULL_CLARK = tables.SCHEMES["catmull-clark"]
ONE = 1 << BITS
TINY = ONE // 10**80
DIGITS = 100  # working precision of the oracle's closed forms

# The outer control points by grid position, in order; those beyond them; and the lower left grid
# position of the 4 x 4 control points of the three pieces of the quad that are regular.
OUTER = [(3, 0), (3, 1), (3, 2), (3, 3), (2, 3), (1, 3), (0, 3)]
BEYOND = [(4, 0), (4, 1), (4, 2), (4, 3), (4, 4), (3, 4), (2, 4), (1, 4), (0, 4)]
PIECES = [(1, 0), (1, 1), (0, 1)]

BUILT = [*range(2, 13), 33]
DERIVED = [*range(3, 41), 64, 100]


# --- other schemes --------------------------------------------------------------------------------


def with_vertex(vertex, name="user"):
    """A scheme that differs from Catmull-Clark at the vertices of valence other than 4."""

    def mask(N):
        return (F(1, 2), F(1, 16), F(1, 16)) if N == 4 else vertex(N)

    return dataclasses.replace(CATMULL_CLARK, name=name, vertex=mask)


def interior_matrix(scheme, N):
    return subdivision_matrix(scheme, Sector("interior", N))


def with_roots(total, product, name="user"):
    """A scheme whose two eigenvalues of frequency 0 other than 1 have this sum and product.

    With B = N beta and G = N gamma they are 3/4 - B - 3/4 G and 1/16 - B/8 - G/16.
    """
    B, G = 2 * total - 24 * product, 1 + 32 * product - 4 * total
    return with_vertex(lambda N: (1 - B - G, F(B) / N, F(G) / N), name)


def random_scheme(seed):
    """Positive rational weights, other ones at every valence."""

    def vertex(N):
        rng = random.Random(f"{seed} {N}")
        own, B, G = (F(rng.randint(1, 99)) for _ in range(3))
        total = own + B + G
        return own / total, B / total / N, G / total / N

    return with_vertex(vertex, f"random {seed}")


# --- a local cage, refined naively ----------------------------------------------------------------


def grid(faces, quad, m):
    """Vertex at each grid position 0 .. m, the quad at (1, 1) to (2, 2); none at (0, 0)."""
    beside = {side: face for face in faces for side in itertools.pairwise([*face, face[0]])}
    at = dict(zip([(1, 1), (2, 1), (2, 2), (1, 2)], quad, strict=True))
    found = [(1, 1)]
    for i, j in found:
        corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1), (i, j)]
        for (p, q), (di, dj) in zip(
            itertools.pairwise(corners), [(0, -1), (1, 0), (0, 1), (-1, 0)], strict=True
        ):
            near = (i + di, j + dj)
            if near in found or near == (0, 0) or not all(0 <= x < m for x in near):
                continue
            face = beside[at[q], at[p]]
            k = face.index(at[q])
            for (x, y), v in ((p, face[k - 2]), (q, face[k - 1])):
                assert at.setdefault((x + di, y + dj), v) == v
            found.append(near)
    return at


def control_points(N, faces):
    """Vertices of the local cage in the order of the matrix's columns, (2 N + 8,)."""
    ring = [v for face in faces[:N] for v in face[1:3]]
    at = grid(faces, faces[0], 3)
    return [0, *ring, *(at[place] for place in OUTER)]


@functools.cache
def naive_step(N):
    """Rows {column: weight} of the refined control points and those beyond; rows of each piece."""
    points, faces = oracles.local_cage(N)
    column = {v: k for k, v in enumerate(control_points(N, faces))}
    forms = [(oracles.Stencil({v: F(1)}),) for v in range(len(points))]
    fine, children = oracles.refine(forms, faces)
    at = grid(children, children[0], 4)
    ring = [v for child in children[: 4 * N : 4] for v in child[1:3]]
    order = [0, *ring, *(at[place] for place in OUTER + BEYOND)]
    rows = tuple({column[v]: w for v, w in fine[k][0].items() if w} for k in order)
    pieces = tuple(
        tuple(order.index(at[x + i, y + j]) for j in range(4) for i in range(4)) for x, y in PIECES
    )
    return rows, pieces


def dense(rows, size):
    return [[row.get(k, F(0)) for k in range(size)] for row in rows]


def naive_matrix(N):
    size = 2 * N + 8
    return dense(naive_step(N)[0][:size], size)


def shifted(A, value):
    return [[x - value * (i == j) for j, x in enumerate(row)] for i, row in enumerate(A)]


def rank(A):
    """Rank of a rational matrix by elimination; and of its square."""
    A = DomainMatrix(
        [[QQ(x.numerator, x.denominator) for x in row] for row in A], (len(A),) * 2, QQ
    )
    return A.rank(), (A * A).rank()


# --- masks ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("N", [2, 3, 4, 5, 6, 17, 1000])
def test_masks_are_those_of_the_papers(N):
    scheme = CATMULL_CLARK
    assert scheme.face_mask(N + 1) == (F(1, N + 1),) * (N + 1)
    assert scheme.edge == (F(1, 4), F(1, 4))
    # (Q + 2 R + (N - 3) S) / N, R the mean of the N midpoints
    assert scheme.vertex_mask(N) == (F(N - 3, N) + F(1, N), F(1, N**2), F(1, N**2))
    assert scheme.boundary_edge == F(1, 2)
    assert scheme.boundary_vertex == (F(6, 8), F(1, 8))


@pytest.mark.parametrize("N", [3, 5, 6, 12])
def test_stencils_are_those_of_the_papers(N):
    rows = interior_matrix(CATMULL_CLARK, N).rows
    edges, faces = range(1, 2 * N, 2), range(2, 2 * N + 1, 2)
    vertex = {0: 1 - F(7, 4 * N)} | dict.fromkeys(edges, F(3, 2 * N * N))
    assert rows[0] == vertex | dict.fromkeys(faces, F(1, 4 * N * N))
    edge = dict.fromkeys((0, 1), F(3, 8)) | dict.fromkeys((2, 3, 2 * N - 1, 2 * N), F(1, 16))
    assert rows[1] == edge
    assert rows[2] == dict.fromkeys((0, 1, 2, 3), F(1, 4))
    # around the regular vertex f_0: its face corners are 0, (3, 1), (3, 3) and (1, 3)
    outer = {place: 2 * N + 1 + k for k, place in enumerate(OUTER)}
    regular = {2: F(9, 16)} | dict.fromkeys((1, 3, outer[3, 2], outer[2, 3]), F(3, 32))
    regular |= dict.fromkeys((0, outer[3, 1], outer[3, 3], outer[1, 3]), F(1, 64))
    assert rows[outer[3, 3]] == regular


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"edge": (F(1, 4), F(1, 8))}, r"edge sums to 3/4, not to 1"),
        ({"edge": (F(1, 3), F(1, 6))}, r"edge is \(1/3, 1/6\), but .* needs \(1/4, 1/4\)"),
        ({"edge": (F(0), F(1, 2))}, r"edge is \(0, 1/2\)"),
        ({"edge": (0.25, 0.25)}, r"edge must be 2 Fractions, got \(0.25, 0.25\)"),
        ({"edge": (F(1, 2),)}, r"edge must be 2 Fractions"),
        ({"face": lambda n: (F(1, n),) * (n - 1)}, r"face\(4\) must be 4 Fractions"),
        ({"face": lambda n: (F(2, n), F(0)) + (F(1, n),) * (n - 2)}, r"face\(4\) is \(1/2, 0,"),
        ({"vertex": lambda N: (F(1), F(0), F(0))}, r"vertex\(4\) is \(1, 0, 0\)"),
        ({"vertex": lambda N: (F(1, 2), F(1, 8), F(1, 8))}, r"vertex\(4\) sums to 3/2"),
        ({"boundary_edge": F(1, 3)}, r"boundary_edge sums to 2/3"),
        ({"boundary_vertex": (F(1), F(0))}, r"boundary_vertex is \(1, 0\)"),
        ({"boundary_vertex": (F(1), F(1, 8))}, r"boundary_vertex sums to 5/4"),
    ],
)
def test_scheme_refuses_wrong_masks(change, message):
    with pytest.raises(ValueError, match=f"'wicked': {message}"):
        dataclasses.replace(CATMULL_CLARK, name="wicked", **change)


def test_scheme_takes_lists_and_integers():
    scheme = dataclasses.replace(
        CATMULL_CLARK,
        name="lists",
        edge=[F(1, 4)] * 2,
        vertex=lambda N: [F(1, 2), F(1, 16), F(1, 16)] if N == 4 else [1, 0, 0],
    )
    assert scheme.edge == (F(1, 4), F(1, 4))
    assert scheme.vertex_mask(7) == (F(1), F(0), F(0))
    assert all(type(w) is F for w in scheme.vertex_mask(7))
    assert interior_matrix(scheme, 7).rows[0] == {0: 1}


def test_scheme_checks_other_masks_when_they_are_needed():
    wicked = with_vertex(lambda N: (F(1, 2), F(1, N), F(1, N)), "wicked")
    assert wicked.vertex_mask(4) == (F(1, 2), F(1, 16), F(1, 16))
    with pytest.raises(ValueError, match=r"'wicked': vertex\(5\) sums to 5/2"):
        interior_matrix(wicked, 5)
    floats = with_vertex(lambda N: (0.5, 0.25 / N, 0.25 / N), "wicked")
    with pytest.raises(ValueError, match=r"'wicked': vertex\(8\) must be 3 Fractions"):
        interior_matrix(floats, 8)
    triangles = dataclasses.replace(
        CATMULL_CLARK, name="wicked", face=lambda n: (F(1, 4),) * 4 if n == 4 else (F(1, 2),) * n
    )
    with pytest.raises(ValueError, match=r"'wicked': face\(3\) sums to 3/2"):
        triangles.face_mask(3)


def test_key_holds_the_masks_at_that_valence_alone():
    like = with_vertex(CATMULL_CLARK.vertex, "own")
    key = like.key(5)
    assert key["scheme"] == "own"
    assert key["masks"]["vertex(5)"] == ["3/5", "1/25", "1/25"]
    assert key["masks"]["vertex(4)"] == ["1/2", "1/16", "1/16"]
    other = with_vertex(
        lambda N: CATMULL_CLARK.vertex(N) if N != 7 else (F(1, 2), F(1, 28), F(1, 28)),
        "own",
    )
    assert other.key(5) == key
    assert other.key(7) != like.key(7)


# --- matrices -------------------------------------------------------------------------------------


@pytest.mark.parametrize("N", BUILT)
def test_matrix_is_one_naive_refinement(N):
    built = interior_matrix(CATMULL_CLARK, N)
    rows, pieces = naive_step(N)
    assert built.sector == Sector("interior", N)
    assert built.size == 2 * N + 8
    assert len(built.rows) == 2 * N + 17
    for k, (got, needed) in enumerate(zip(built.rows, rows, strict=True)):
        assert dict(got) == needed, f"row {k}"
    assert tuple(map(tuple, built.pieces)) == pieces


@pytest.mark.parametrize("scheme", [CATMULL_CLARK, random_scheme(0)], ids=lambda s: s.name)
@pytest.mark.parametrize("N", [*BUILT, 100])
def test_rows_sum_to_one(scheme, N):
    for row in interior_matrix(scheme, N).rows:
        assert sum(row.values()) == 1
        assert all(type(w) is F and w != 0 for w in row.values())


def test_regular_matrix_is_knot_insertion():
    insertion = [
        [F(x, 8) for x in row]
        for row in ([4, 4, 0, 0], [1, 6, 1, 0], [0, 4, 4, 0], [0, 1, 6, 1], [0, 0, 4, 4])
    ]
    ring = [(1, 1), (2, 1), (2, 2), (1, 2), (0, 2), (0, 1), (0, 0), (1, 0), (2, 0)]
    columns, rows = ring + OUTER, ring + OUTER + BEYOND
    assert len(set(rows)) == 25
    built = interior_matrix(CATMULL_CLARK, 4)
    assert dense(built.rows, built.size) == [
        [insertion[i][k] * insertion[j][m] for k, m in columns] for i, j in rows
    ]


def test_pieces_are_neighbours():
    """Two pieces share the twelve control points that make them one smooth spline."""
    for N in BUILT:
        pieces = np.array(interior_matrix(CATMULL_CLARK, N).pieces).reshape(3, 4, 4)
        assert (pieces[0, 1:] == pieces[1, :-1]).all()
        assert (pieces[2, :, 1:] == pieces[1, :, :-1]).all()


@pytest.mark.parametrize("N", [1, 0, -3])
def test_matrix_refuses_valences_below_two(N):
    with pytest.raises(ValueError, match=f"at least 2, got {N}"):
        interior_matrix(CATMULL_CLARK, N)


def test_masks_without_the_symmetry_of_the_ring_are_refused():
    matrix = interior_matrix(CATMULL_CLARK, 5)
    rows = list(matrix.rows)
    rows[3] = {3: F(1, 2), 0: F(1, 2)}  # of one edge neighbour
    with pytest.raises(UnsupportedSpectrum, match="symmetry of the ring"):
        ring_generators(dataclasses.replace(matrix, rows=tuple(rows)))


# --- the spectrum in fixed point ------------------------------------------------------------------


def derive(scheme, N):
    """A spectrum, with V and V^-1."""
    s = spectrum.spectrum(scheme, Sector("interior", N))
    V, Vinv = spectrum.dense_basis(s)
    return SimpleNamespace(**vars(s), V=V, Vinv=Vinv)


derived = functools.cache(derive)


def fixed(x):
    """An mpf in units of 2**-BITS."""
    return int(mpmath.ldexp(x, BITS))


def times_jordan(columns, s):
    """Columns (..., K) times the Jordan matrix, in fixed point."""
    result = columns * np.array([fixed(x) for x in s.eigenvalues], dtype=object) >> BITS
    for k in s.chains:
        result[..., k] += columns[..., k - 1]
    return result


def check_basis(s):
    """Assert A V = V J and V V^-1 = 1 to 80 digits."""
    scale = lcm(*(w.denominator for row in s.matrix.rows for w in row.values()))
    product = np.stack(
        [
            sum(int(w * scale) * s.V[c] for c, w in row.items())
            for row in s.matrix.rows[: s.matrix.size]
        ]
    )
    assert abs(product - scale * times_jordan(s.V, s)).max() < scale * TINY
    columns = np.eye(s.matrix.size, dtype=int)
    if s.matrix.size > 60:  # instead of all columns, a few combinations
        columns = np.random.default_rng(0).integers(-99, 100, (s.matrix.size, 5))
    columns = columns.astype(object)
    assert abs((s.V.dot(s.Vinv.dot(columns)) >> BITS) - columns * ONE).max() < 1000 * TINY


def closed_form(N):
    """All eigenvalues by [BS] and [S], ascending."""
    ring = [x for values in oracles.ring_eigenvalues(N).values() for x in values]
    outer = [mpmath.mpf(x.numerator) / x.denominator for x in oracles.OUTER_EIGENVALUES]
    return sorted(ring + outer)


@pytest.mark.parametrize("N", [2, *DERIVED])
def test_basis_and_eigenvalues(N):
    s = derive(CATMULL_CLARK, N)
    check_basis(s)
    with mpmath.workdps(DIGITS):
        for got, needed in zip(sorted(s.eigenvalues), closed_form(N), strict=True):
            assert abs(got - needed) < mpmath.mpf(10) ** -80
        # by decreasing modulus, the positive one first
        for a, b in itertools.pairwise(s.eigenvalues):
            gap = abs(a) - abs(b)
            assert gap > -(mpmath.mpf(10) ** -60)
            if abs(gap) < mpmath.mpf(10) ** -60:
                assert a > b - mpmath.mpf(10) ** -60
    assert s.eigenvalues[0] == 1
    assert s.chains == ([5] if N == 2 else [])
    assert s.normal == ((1, 2) if N > 2 else ())
    assert abs(s.V[:, 0] - ONE).max() < TINY


@pytest.mark.parametrize("N", list(oracles.SUBDOMINANT))
def test_subdominant_eigenvalue(N):
    s = derived(CATMULL_CLARK, N)
    assert s.eigenvalues[1] == s.eigenvalues[2]
    assert abs(float(s.eigenvalues[1]) - oracles.SUBDOMINANT[N]) < 1e-15
    assert s.eigenvalues[3] < s.eigenvalues[2]


def test_valence_two_has_one_jordan_block():
    s = derived(CATMULL_CLARK, 2)
    assert sorted(s.eigenvalues[:4]) == [F(-1, 4), F(1, 4), F(1, 4), 1]
    assert s.chains == [5]
    assert s.eigenvalues[4] == s.eigenvalues[5] == F(1, 8)
    assert s.normal == ()
    A = naive_matrix(2)
    assert rank(shifted(A, F(1, 8))) == (10, 9)
    for other in sorted({*map(F, map(float, s.eigenvalues))} - {F(1, 8)}):
        first, second = rank(shifted(A, other))
        assert first == second < 12


def test_valence_three_has_an_exact_zero():
    s = derived(CATMULL_CLARK, 3)
    assert [k for k, x in enumerate(s.eigenvalues) if x == 0] == [13]
    assert rank(naive_matrix(3)) == (13, 13)


@pytest.mark.parametrize("N", [2, 3, 4, 5, 7, 8])
def test_defective_only_at_valence_two_in_exact_arithmetic(N):
    """The square-free part of the characteristic polynomial annihilates a diagonalisable matrix."""
    A = naive_matrix(N)
    size = len(A)
    A = DomainMatrix([[QQ(x.numerator, x.denominator) for x in row] for row in A], (size, size), QQ)
    polynomial = sympy.Poly(A.charpoly(), sympy.Symbol("x"), domain=QQ)
    total = DomainMatrix.zeros((size, size), QQ)
    for coefficient in polynomial.sqf_part().rep.to_list():
        total = total * A + DomainMatrix.eye(size, QQ) * coefficient
    assert total.is_zero_matrix == (N != 2)


@pytest.mark.parametrize("N", [4, 8, 12])
def test_the_tie_at_one_eighth_is_not_defective(N):
    first, second = rank(shifted(naive_matrix(N), F(1, 8)))
    assert first == second
    eigenvalues = derived(CATMULL_CLARK, N).eigenvalues
    multiplicity = [abs(fixed(x) - ONE // 8) < TINY for x in eigenvalues]
    assert first == 2 * N + 8 - sum(multiplicity)
    assert sum(multiplicity) >= 4


@pytest.mark.parametrize("N", [*range(2, 13), 33, 64])
def test_limit_mask(N):
    vertex, edge, diagonal = oracles.limit_mask(N)
    matrix = interior_matrix(CATMULL_CLARK, N)
    assert smooth_limit(matrix) == (vertex, edge, diagonal)
    needed = [vertex, *[edge, diagonal] * N, *[0] * 7]
    for got, w in zip(derived(CATMULL_CLARK, N).Vinv[0], needed, strict=True):
        assert abs(F(int(got), ONE) - w) < F(1, 10**80)


@pytest.mark.parametrize("N", [3, 4, 5, 6, 7, 8, 12, 33, 64])
def test_tangent_masks_span_the_published_ones(N):
    left = derived(CATMULL_CLARK, N).Vinv[1:3]
    even, odd = left[:, 1 : 2 * N + 1].reshape(2, N, 2)  # (edge neighbour, face corner) j
    assert not left[:, 0].any()
    assert not left[:, 2 * N + 1 :].any()
    # about the diagonal of face 0, edge j mirrors edge 1 - j, and face j mirrors face -j
    assert abs(even[:, 0] - np.roll(even[::-1, 0], 2)).max() < TINY
    assert abs(odd[:, 0] + np.roll(odd[::-1, 0], 2)).max() < TINY
    assert abs(even[:, 1] - np.roll(even[::-1, 1], 1)).max() < TINY
    assert abs(odd[:, 1] + np.roll(odd[::-1, 1], 1)).max() < TINY
    with mpmath.workdps(DIGITS):
        published = [
            [w for pair in zip(*mask, strict=True) for w in pair]
            for mask in oracles.tangent_masks(N)
        ]
        for row in left[:, 1 : 2 * N + 1]:
            row = [mpmath.mpf(int(x)) / ONE for x in row]
            rest = list(row)
            for mask in published:  # orthogonal
                part = mpmath.fdot(row, mask) / mpmath.fdot(mask, mask)
                rest = [x - part * w for x, w in zip(rest, mask, strict=True)]
            assert max(map(abs, row)) > 0.1 / N
            assert max(map(abs, rest)) < mpmath.mpf(10) ** -80


def test_deriving_leaves_the_precision_of_others_alone():
    with mpmath.workprec(61):
        derive(CATMULL_CLARK, 5)
        assert mpmath.mp.prec == 61


# --- eigenfunctions -------------------------------------------------------------------------------


@pytest.mark.parametrize("N", [2, 3, 4, 5, 8, 33])
def test_eigenfunctions_scale_smoothly(N):
    """Continuous second derivatives between the pieces and those at half the size, lambda x."""
    s = derived(CATMULL_CLARK, N)
    near = s.pieces.reshape(3, 4, 4, -1)  # (piece, power of T, power of S, K)
    far = times_jordan(near, s)
    # value and derivatives of a polynomial at 1 and at 0; from T to (T + half) / 2, times 8
    at_one = np.array([[1, 1, 1, 1], [0, 1, 2, 3], [0, 0, 2, 6]], dtype=object)
    at_zero = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 2, 0]], dtype=object)
    halves = [
        np.array([[comb(j, m) * half ** (j - m) * 2 ** (3 - j) if m <= j else 0 for j in range(4)]
                  for m in range(4)], dtype=object)
        for half in (0, 1)
    ]  # fmt: skip
    for side, ends in ((0, (0, 1)), (2, (2, 1))):
        # bring the direction across the edge to the front: (across, along, K)
        turn = (lambda x: x.transpose(1, 0, 2)) if side == 0 else (lambda x: x)
        edge = np.tensordot(at_zero, turn(near[side]), 1)  # (order, along, K)
        for half, end in enumerate(ends):
            needed = np.tensordot(halves[half], edge, (1, 1)).transpose(1, 0, 2)
            got = np.tensordot(at_one, turn(far[end]), 1)
            got *= np.array([8, 16, 32], dtype=object)[:, None, None]
            assert abs(got - needed).max() < 1000 * TINY
    # and between the pieces
    for side, turn in ((0, lambda x: x), (2, lambda x: x.transpose(1, 0, 2))):
        before = np.tensordot(at_one, turn(near[side]), 1)
        after = np.tensordot(at_zero, turn(near[1]), 1)
        assert abs(before - after).max() < 1000 * TINY


@pytest.mark.parametrize("N", [2, 3, 4, 5, 6, 8, 33])
def test_eigenexpansion_is_the_limit_by_refinement(N):
    s = derived(CATMULL_CLARK, N)
    points, faces = oracles.local_cage(N)
    surface = oracles.ExactSurface(points, faces)
    order = control_points(N, faces)
    control = np.array([points[v] for v in order], dtype=object)  # (K, 3)
    coefficients = s.Vinv.dot(control).T  # (3, K), units of 2**-BITS
    eigenvalues = np.array([F(fixed(x), ONE) for x in s.eigenvalues], dtype=object)
    samples = {0: (F(3, 4), F(1, 5)), 1: (F(2, 3), F(5, 7)), 2: (F(1, 9), F(4, 5))}
    for level in range(6):
        if level:  # J times the coefficients
            ends = {k - 1: coefficients[:, k] for k in s.chains}
            coefficients = coefficients * eigenvalues
            for k, more in ends.items():
                coefficients[:, k] += more
        for piece, (u, v) in samples.items():
            S, T = 2 * u % 1, 2 * v % 1
            powers = np.array([S**i * T**j for j in range(4) for i in range(4)])
            got = coefficients.dot(powers.dot(s.pieces[piece])) / ONE**2
            needed = surface.evaluate(0, u / 2**level, v / 2**level)
            assert abs(got - np.array(needed)).max() < F(1, 10**78)


# --- schemes of users -----------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(8))
def test_random_schemes(seed):
    scheme = random_scheme(seed)
    for N in (2, 3, 5, 6, 8, 11):
        matrix = interior_matrix(scheme, N)
        s = derived(scheme, N)
        check_basis(s)
        with mpmath.workdps(DIGITS):
            _, B, G = (w * c for w, c in zip(scheme.vertex_mask(N), (1, N, N), strict=True))
            total = F(3, 4) - B - F(3, 4) * G
            square = total**2 - 4 * (F(1, 16) - B / 8 - G / 16)
            total, root = (mpmath.mpf(x.numerator) / x.denominator for x in (total, square))
            changed = [(total + sign * mpmath.sqrt(root)) / 2 for sign in (1, -1)]
            ring = oracles.ring_eigenvalues(N)
            ring[0] = [mpmath.mpf(1), *changed]
            needed = [x for values in ring.values() for x in values]
            needed += [mpmath.mpf(x.numerator) / x.denominator for x in oracles.OUTER_EIGENVALUES]
            for a, b in zip(sorted(s.eigenvalues), sorted(needed), strict=True):
                assert abs(a - b) < mpmath.mpf(10) ** -80
        # the limit mask is a left eigenvector of eigenvalue 1
        vertex, edge, diagonal = smooth_limit(matrix)
        left = [vertex, *[edge, diagonal] * N, *[F(0)] * 7]
        assert sum(left) == 1
        product = [F(0)] * matrix.size
        for w, row in zip(left, matrix.rows[: matrix.size], strict=True):
            for k, x in row.items():
                product[k] += w * x
        assert product == left
        assert abs(s.Vinv[0] - np.array([int(w * ONE) for w in left], dtype=object)).max() < TINY


@pytest.mark.parametrize(
    "roots",
    [(F(1, 8), F(1, 7)), (F(1, 16), F(1, 32)), (F(1, 64), F(1, 5)), (F(-1, 8), F(1, 8))],
    ids=lambda roots: "{} and {}".format(*roots),
)
@pytest.mark.parametrize("N", [3, 5, 8])
def test_chains_of_other_schemes(roots, N):
    """Eigenvalues of frequency 0 at those of the outer block: as many chains as ranks tell."""
    scheme = with_roots(sum(roots), roots[0] * roots[1])
    s = derived(scheme, N)
    check_basis(s)
    for root in roots:
        assert min(abs(fixed(x) - int(root * ONE)) for x in s.eigenvalues) < TINY
    A = dense(s.matrix.rows[: s.matrix.size], s.matrix.size)
    ends = sorted(F(float(s.eigenvalues[k])) for k in s.chains)
    missing = []
    for value in sorted(set(oracles.OUTER_EIGENVALUES)):
        first, second = rank(shifted(A, value))
        missing += [value] * (first - second)
    assert ends == missing
    assert missing


@pytest.mark.parametrize("roots", [(F(9, 10), F(1, 5)), (F(-9, 10), F(1, 5))])
def test_a_slow_even_mode_leaves_no_tangent_plane(roots):
    scheme = with_roots(sum(roots), roots[0] * roots[1])
    s = derived(scheme, 5)
    check_basis(s)
    assert abs(fixed(s.eigenvalues[1]) - int(roots[0] * ONE)) < TINY
    assert s.normal == ()


@pytest.mark.parametrize(
    ("total", "product"),
    [
        pytest.param(F(1), F(1, 3), id="complex"),
        pytest.param(F(0), F(1, 100), id="imaginary"),
        pytest.param(F(1), F(1, 4), id="defective"),
        pytest.param(F(0), F(0), id="nilpotent"),
        pytest.param(F(9, 8), F(1, 8), id="1 twice"),
        pytest.param(F(7, 3), F(2, 3), id="diverges"),
        pytest.param(F(-23, 8), F(-3, 8), id="diverges, alternating"),
        pytest.param(F(-2, 3), F(-1, 3), id="-1 and 1"),
    ],
)
@pytest.mark.parametrize("N", [3, 5])
def test_unsupported_spectra_are_refused(total, product, N):
    """No real Jordan basis, or no limit: an eigenvalue other than the 1 has modulus 1 or more."""
    scheme = with_roots(total, product)
    assert issubclass(UnsupportedSpectrum, ValueError)
    with pytest.raises(UnsupportedSpectrum, match=f"valence {N}"):
        spectrum.spectrum(scheme, Sector("interior", N))
    spectrum.spectrum(scheme, Sector("interior", 4))  # regular, like every scheme


# --- the symbolic basis ---------------------------------------------------------------------------

OTHERS = {
    "irrational": with_roots(F(1, 2), F(1, 20)),
    "chained": with_roots(F(15, 56), F(1, 56)),
    "zero": with_roots(F(1, 3), F(0)),
}
CASES = [(CATMULL_CLARK, N) for N in (2, 3, 4, 5, 6, 8)]
CASES += [(scheme, N) for scheme in OTHERS.values() for N in (3, 4, 5)]
cases = pytest.mark.parametrize(
    ("scheme", "N"),
    CASES,
    ids=[f"catmull-clark {N}" for _, N in CASES[:6]]
    + [f"{name} {N}" for name in OTHERS for N in (3, 4, 5)],
)


@functools.cache
def symbolic(scheme, N):
    return SymbolicBasis(scheme, N)


def numbers(matrix):
    """A sympy matrix at mpmath's working precision, by a walk over its expressions."""
    rules = {
        sympy.Add: lambda *x: mpmath.fsum(x),
        sympy.Mul: lambda *x: mpmath.fprod(x),
        sympy.Pow: mpmath.power,
        sympy.cos: mpmath.cos,
        sympy.sin: mpmath.sin,
    }
    known = {sympy.pi: +mpmath.pi}

    def number(x):
        if x not in known:
            if x.is_Rational:
                known[x] = mpmath.mpf(int(x.p)) / int(x.q)
            else:
                known[x] = rules[x.func](*map(number, x.args))
        return known[x]

    matrix = sympy.Matrix(matrix)
    return np.array([number(x) for x in matrix], dtype=object).reshape(matrix.shape)


def distance(a, b):
    return abs(a - b).max()


@cases
def test_symbolic_basis_is_the_fixed_point_one(scheme, N):
    exact, s = symbolic(scheme, N), derived(scheme, N)
    size = 2 * N + 8
    with mpmath.workdps(DIGITS):
        bound = mpmath.mpf(10) ** -78
        V, Vinv, J = (numbers(x) for x in (exact.V, exact.Vinv, exact.J))
        assert V.shape == Vinv.shape == J.shape == (size, size)
        assert distance(V, s.V / mpmath.mpf(ONE)) < bound
        assert distance(Vinv, s.Vinv / mpmath.mpf(ONE)) < bound
        assert distance(numbers(exact.eigenvalues)[:, 0], np.array(s.eigenvalues)) < bound
        assert distance(np.diag(J), np.array(s.eigenvalues)) < bound
        identity = np.eye(size, dtype=int)
        assert distance(Vinv.dot(V), identity) < bound
        assert distance(V.dot(Vinv), identity) < bound
        assert distance(numbers(exact.A).dot(V), V.dot(J)) < bound
        assert distance(numbers(exact.limit_mask)[:, 0], Vinv[0]) < bound
        assert len(exact.tangent_masks) == len(s.normal)
        for mask, k in zip(exact.tangent_masks, s.normal, strict=True):
            assert distance(numbers(mask)[:, 0], Vinv[k]) < bound
    above = exact.J - sympy.diag(*exact.eigenvalues)
    assert [k for k in range(1, size) if above[k - 1, k] == 1] == s.chains
    assert sum(x != 0 for x in above) == len(s.chains)
    assert exact.limit_mask[:3] == smooth_limit(s.matrix)


@cases
def test_symbolic_residual_is_the_zero_matrix(scheme, N):
    exact = symbolic(scheme, N)
    assert exact.residual == sympy.zeros(2 * N + 8, 2 * N + 8)
    A = dense(derived(scheme, N).matrix.rows[: 2 * N + 8], 2 * N + 8)
    assert exact.A.tolist() == A


@pytest.mark.parametrize("N", [9, 10, 11, 16, 20, 33])
def test_symbolic_residual_of_larger_valences(N):
    assert SymbolicBasis(CATMULL_CLARK, N).residual.is_zero_matrix


@pytest.mark.parametrize("N", [2, 4])
def test_symbolic_basis_multiplied_out(N):
    """Where every entry is rational, in plain exact arithmetic."""
    exact = symbolic(CATMULL_CLARK, N)
    assert (exact.A * exact.V - exact.V * exact.J).applyfunc(sympy.expand).is_zero_matrix
    assert (exact.Vinv * exact.V - sympy.eye(2 * N + 8)).applyfunc(sympy.expand).is_zero_matrix


def test_symbolic_subdominant_columns_multiplied_out():
    exact = symbolic(CATMULL_CLARK, 3)
    for k in (1, 2):
        rest = exact.A * exact.V[:, k] - exact.eigenvalues[k] * exact.V[:, k]
        assert all(sympy.radsimp(sympy.expand(x)) == 0 for x in rest)


def test_symbolic_eigenvalues_are_the_closed_forms():
    s = symbolic(CATMULL_CLARK, 3)
    assert sympy.simplify(s.eigenvalues[1] - (9 + sympy.sqrt(17)) / 32) == 0
    assert s.eigenvalues[0] == 1
    assert s.eigenvalues[-1] == 0
    fifth = symbolic(CATMULL_CLARK, 5).eigenvalues
    c, half = sympy.cos(2 * sympy.pi / 5), sympy.cos(sympy.pi / 5)
    closed = (5 + c + half * sympy.sqrt(18 + 2 * c)) / 16
    assert abs(sympy.N(fifth[1] - closed, 50)) < 1e-48
    assert fifth[1] == fifth[2]
    assert all(x.is_real for x in fifth)


@pytest.mark.parametrize("row", [0, 1, 2, 11, 14, 17])
def test_the_proof_proves(row):
    """It fails when one weight of the matrix moves from one control point to another."""
    exact = SymbolicBasis(CATMULL_CLARK, 5)
    assert exact.residual.is_zero_matrix
    rows = [dict(r) for r in exact._matrix.rows]
    first, second = list(rows[row])[:2]
    rows[row][first] += F(1, 1000)
    rows[row][second] -= F(1, 1000)
    exact._matrix = dataclasses.replace(exact._matrix, rows=tuple(rows))
    del exact.residual
    with pytest.raises(ArithmeticError, match="A V - V J is not zero in row"):
        _ = exact.residual


def test_a_scheme_of_a_user_through_the_public_call():
    basis = ls.eigenbasis(random_scheme(1), valence=5)
    assert abs(basis.float64.residual).max() < 1e-14
    assert basis.exact.residual.is_zero_matrix
    assert basis.provenance["scheme"] == "random 1"
