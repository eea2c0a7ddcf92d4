"""Eigenvalues and eigenvectors around an interior vertex, for symbolic valence N.

Which eigenvalue is subdominant, that it dominates for every N >= 3, that no Jordan block arises for
any N >= 3, and that one does at N = 2.

Papers
    A. Ball, D. Storry, "Conditions for tangent plane continuity over recursively generated B-spline
    surfaces", ACM Transactions on Graphics 7 (1988).
    U. Reif, "A unified approach to subdivision algorithms near extraordinary vertices", Computer
    Aided Geometric Design 12 (1995): why the subdominant pair decides about the tangent plane.
    J. Stam, "Exact evaluation of Catmull-Clark subdivision surfaces at arbitrary parameter values",
    SIGGRAPH 1998: the eigenvectors of the extended matrix.

Run this file: it says nothing unless an assertion fails.
"""

from sympy import QQ, Matrix, Rational, cos, expand, factor, pi, rem, simplify, solve, sqrt, symbols
from sympy.polys.matrices import DomainMatrix

from limitsurf.exact.catmull_clark import CATMULL_CLARK
from limitsurf.exact.matrices import Sector, subdivision_matrix

N, s = symbols("N s", positive=True)
lam, mu = symbols("lambda mu")

# 1. The eigenvalues of the ring
# ------------------------------
# subdivision_matrix.py derives, for a wave of frequency f = 1 ... N-1 and s = cos(pi f / N), the
# block [[3/8 + c/8, s/8], [s/2, 1/4]] with c = 2 s^2 - 1, and for f = 0 a block with eigenvalue 1.
# Their characteristic polynomials (without that 1) are

block = Matrix([[Rational(1, 4) + s**2 / 4, s / 8], [s / 2, Rational(1, 4)]])
ring = expand((block - lam * Matrix.eye(2)).det())
assert expand(ring - (lam**2 - (2 + s**2) / 4 * lam + Rational(1, 16))) == 0

centre_block = Matrix(
    [
        [1 - 7 / (4 * N), 3 / (2 * N), 1 / (4 * N)],
        [Rational(3, 8), Rational(1, 2), Rational(1, 8)],
        [Rational(1, 4), Rational(1, 2), Rational(1, 4)],
    ]
)
centre = mu**2 - (3 * N - 7) / (4 * N) * mu + (N - 3) / (16 * N)
assert simplify((centre_block - mu * Matrix.eye(3)).det() - (1 - mu) * centre) == 0

# The product of the two roots of `ring` is 1/16, so they are a fourth of a number and of its
# inverse. Both are perfect squares: lambda_+- = ((sqrt(4 + s^2) +- s) / 4)^2, which is e^(+-2x) / 4
# with 2 sinh x = s. So lambda_+ grows with s and lambda_- falls:
#
#     s = 0:       both are 1/4;
#     0 < s < 1:   1/16 < (3 - sqrt 5)/8 < lambda_- < 1/4 < lambda_+ < (3 + sqrt 5)/8 < 1.

upper, lower = ((sqrt(4 + s**2) + s) / 4) ** 2, ((sqrt(4 + s**2) - s) / 4) ** 2
for root in (upper, lower):
    assert expand(ring.subs(lam, root)) == 0
assert simplify(upper.diff(s) - 2 * upper / sqrt(4 + s**2)) == 0  # positive
assert expand(upper.subs(s, 1)) == (3 + sqrt(5)) / 8
assert expand(lower.subs(s, 1)) == (3 - sqrt(5)) / 8
assert Rational(1, 16) < (3 - sqrt(5)) / 8

# `centre` has discriminant (5 (N - 3)^2 + 4) / (16 N^2): two different real roots, for N >= 3 not
# negative as their sum and product are not, and neither is 1. At N = 3 they are 0 and 1/6.

discriminant = ((3 * N - 7) / (4 * N)) ** 2 - (N - 3) / (4 * N)
assert simplify(discriminant - (5 * (N - 3) ** 2 + 4) / (16 * N**2)) == 0
assert simplify(centre.subs(mu, 1) - 5 * (N + 5) / (16 * N)) == 0
assert set(solve(centre.subs(N, 3), mu)) == {0, Rational(1, 6)}

# 2. The subdominant pair
# -----------------------
# Claim: for every N >= 3 the largest eigenvalue below 1 is lambda = lambda_+ at f = 1 and N - 1,
# the cosine and the sine wave that go around once, and all others are smaller in modulus.
#
# Other frequencies: |s| = |cos(pi f / N)| is largest at f = 1 and N - 1, and lambda_+ grows. All
# lambda_- and the outer eigenvalues 1/8 ... 1/64 are at most 1/4. And lambda is at least its value
# at N = 3:

smallest = upper.subs(s, Rational(1, 2))
assert expand(smallest - (9 + sqrt(17)) / 32) == 0
assert smallest > Rational(2, 5)

# Frequency 0: both roots of `centre` are below lambda if lambda lies right of their mean
# (3 N - 7) / (8 N) < 3/8 < lambda, and `centre` is positive there. Modulo lambda's own equation

at_lambda = rem(expand(centre.subs(mu, lam)), ring, lam)
assert simplify(4 * at_lambda - (lam * (7 / N - (1 - s**2)) - 3 / (4 * N))) == 0

# with 1 - s^2 = sin(pi/N)^2 <= (pi/N)^2 <= pi^2 / (3 N) for N >= 3. So 4 N times it is at least

assert Rational(2, 5) * (7 - pi**2 / 3) - Rational(3, 4) > 0

# which proves the claim. Numbers, to compare with other programs:

PUBLISHED = {
    3: "0.4100970508005519",
    5: "0.5499883545182972",
    6: "0.5796823261022109",
    7: "0.5985102834817406",
    8: "0.6111165266945380",
    10: "0.6263412675469543",
    50: "0.6533541152143524",
}
for n, digits in PUBLISHED.items():
    assert abs(upper.subs(s, cos(pi / n)).evalf(30) - Rational(digits)) < Rational(1, 10**16)
assert expand(upper.subs(s, cos(pi / 4))) == Rational(1, 2)

# N = 2 is outside the claim: the ring has 1, 1/4 twice (f = 1, s = 0), 1/8 and -1/4. The -1/4 ties
# with the pair in modulus, so in general the normal swings forever and has no limit.

assert set(solve(centre.subs(N, 2), mu)) == {Rational(1, 8), -Rational(1, 4)}
assert set(solve(ring.subs(s, 0), lam)) == {Rational(1, 4)}

# 3. The outer points
# -------------------
# The seven outer points of a face refine by knot insertion (subdivision_matrix.py, section 4).

OUTER = [(3, 0), (3, 1), (3, 2), (3, 3), (2, 3), (1, 3), (0, 3)]
LINES = {
    0: {0: Rational(1, 2), 1: Rational(1, 2)},
    1: {0: Rational(1, 8), 1: Rational(3, 4), 2: Rational(1, 8)},
    2: {1: Rational(1, 2), 2: Rational(1, 2)},
    3: {1: Rational(1, 8), 2: Rational(3, 4), 3: Rational(1, 8)},
}
rows = [{(a, b): p * q for a, p in LINES[i].items() for b, q in LINES[j].items()} for i, j in OUTER]
outer_block = Matrix(7, 7, lambda i, k: rows[i].get(OUTER[k], 0))

# Its left eigenvectors are differences along the two outer sides; 1/8 has the curve mask 1, 4, 1.

LEFT = [
    (Rational(1, 8), [1, 4, 1, 0, 0, 0, 0]),
    (Rational(1, 8), [0, 0, 0, 0, 1, 4, 1]),
    (Rational(1, 16), [-1, 0, 1, 0, 0, 0, 0]),
    (Rational(1, 16), [0, 0, 0, 0, -1, 0, 1]),
    (Rational(1, 32), [1, -2, 1, 0, 0, 0, 0]),
    (Rational(1, 32), [0, 0, 0, 0, 1, -2, 1]),
    (Rational(1, 64), [1, -3, 3, -1, 3, -3, 1]),
]
W_inverse = Matrix([vector for _, vector in LEFT])
d = [value for value, _ in LEFT]
assert W_inverse * outer_block == Matrix.diag(*d) * W_inverse
W = W_inverse.inv()  # its columns are the right eigenvectors

# The whole matrix is [[A, 0], [B, D]], A the ring, D the outer block, B how the outer points hang
# on the ring. An eigenvector r of A with eigenvalue lambda becomes one of the whole, (r, x), if
#
#     B r + D x = lambda x;    with x = W g:   g_m = (W^-1 B r)_m / (lambda - d_m).
#
# Where lambda = d_m the numerator must vanish (then g_m is free, say 0), or there is no such x and
# the whole matrix has a Jordan block: the condition to be checked at every coincidence.


def numerators(values):
    coupling = [sum(w * values.get(k, 0) for k, w in row.items()) for row in rows]
    return W_inverse * Matrix(coupling)


# 4. Coincidences
# ---------------
# Between waves and outer eigenvalues: s^2 <= 1 leaves one. It needs cos(pi f / N)^2 = 1/2, so
# N = 4 m and f = m (or N - m).

assert {value: solve(ring.subs(lam, value), s**2) for value in set(d)} == {
    Rational(1, 8): [Rational(1, 2)],
    Rational(1, 16): [Rational(9, 4)],
    Rational(1, 32): [Rational(49, 8)],
    Rational(1, 64): [Rational(225, 16)],
}

# Between frequency 0 and outer eigenvalues: two, at whole numbers N.

assert {value: solve(centre.subs(mu, value), N) for value in set(d)} == {
    Rational(1, 8): [2],
    Rational(1, 16): [4],
    Rational(1, 32): [Rational(136, 41)],
    Rational(1, 64): [Rational(656, 209)],
}

# Eigenvalue 1 meets none. Among themselves, eigenvalues of the ring meet only across frequencies or
# between cosine and sine, which are different vectors. So the ring is diagonalisable for every N.

# 5. Eigenvectors of the waves
# ----------------------------
# (E, F) = (4 lambda - 1, 2 s) solves the block of a wave (its second row by sight), for s != 0.

E, F = 4 * lam - 1, 2 * s
first, second = (block - lam * Matrix.eye(2)) * Matrix([E, F])
assert rem(expand(first), ring, lam) == 0
assert expand(second) == 0

# On the ring e_j = E wave((j - 1/2) theta), f_j = F wave(j theta), theta = 2 pi f / N, so that
# s = cos(theta / 2). In s, the sine divided by sin(theta / 2):

double, triple = 2 * s**2 - 1, 4 * s**3 - 3 * s  # cos theta, cos(3 theta / 2)
cosine = {(1, 1): 0, (2, 1): E * s, (2, 2): F, (1, 2): E * s}
cosine |= {(0, 2): F * double, (0, 1): E * triple, (1, 0): E * triple, (2, 0): F * double}
sine = {(1, 1): 0, (2, 1): -E, (2, 2): 0, (1, 2): E}
sine |= {(0, 2): 2 * s * F, (0, 1): E * (4 * s**2 - 1)}
sine |= {(1, 0): -E * (4 * s**2 - 1), (2, 0): -2 * s * F}

# The numerators, modulo lambda's own equation: four polynomials and the signs of the symmetry.


def reduced(expression):
    return factor(rem(expand(expression), ring, lam))


n8 = (8 * lam * s**2 + 44 * lam + 10 * s**2 - 11) / 4
n16 = (4 * lam + 5) / 4
n32 = (8 * lam * s**2 - 28 * lam + 10 * s**2 + 7) / 16
n64 = (4 * lam * s**2 - 12 * lam + 5 * s**2 + 18) / 8
k16 = s * (1 - s**2)
EXPECTED = {
    "cosine": (cosine, [s * n8, s * n8, k16 * n16, -k16 * n16, s * n32, s * n32, s * n64]),
    "sine": (sine, [-n8, n8, s**2 * n16, s**2 * n16, -n32, n32, 0]),
}
for values, expected in EXPECTED.values():
    for got, wanted in zip(numerators(values), expected, strict=True):
        assert expand(reduced(got) - wanted) == 0

# The condition at the coincidence s^2 = 1/2, lambda = 1/8: n8 vanishes. No Jordan block.

assert n8.subs({lam: Rational(1, 8), s: sqrt(Rational(1, 2))}) == 0

# More is true: n8 is a multiple of lambda - 1/8, so g is a polynomial in lambda and s there, and
# the eigenvector passes through the coincidence smoothly.

assert reduced((88 * lam - 20 * s**2 - 22) * (lam - Rational(1, 8)) - n8) == 0

# At f = N/2 the wave has s = 0, lambda = 1/4: the sine on the e_j alone, the cosine on the f_j
# alone. No outer eigenvalue is 1/4.

# 6. Eigenvectors of frequency 0
# ------------------------------
# The cross product of the last two rows of the block; it does not vanish, as 6 mu - 1 and 4 mu + 1
# have no common root.

C, E, F = 16 * mu**2 - 12 * mu + 1, 6 * mu - 1, 4 * mu + 1
residual = (centre_block - mu * Matrix.eye(3)) * Matrix([C, E, F])
assert expand(residual[1]) == expand(residual[2]) == 0
assert simplify(residual[0] - 16 * (1 - mu) * centre) == 0

same = {(1, 1): C} | dict.fromkeys([(2, 1), (1, 2), (0, 1), (1, 0)], E)
same |= dict.fromkeys([(2, 2), (0, 2), (2, 0)], F)
at_8, again_at_8, at_16, again_at_16, *_ = (
    simplify(rem(expand(got), centre, mu)) for got in numerators(same)
)

# N = 4, mu = 1/16: the numerator is zero for every N and mu, since these left vectors take the
# difference of two points whose neighbours on the ring are alike. No Jordan block.

assert at_16 == again_at_16 == 0

# N = 2, mu = 1/8: the numerator is not zero. The whole matrix of valence 2 has 1/8 three times
# (once from the ring, twice from outside), only two eigenvectors for it, and one Jordan block of
# size two.

assert simplify(at_8 - (102 * N * mu - 7 * N - 56 * mu + 6) / (4 * N)) == 0
assert simplify(again_at_8 - at_8) == 0
assert at_8.subs({N: 2, mu: Rational(1, 8)}) == Rational(21, 16)

# So the matrix is diagonalisable for every N >= 3 and not at N = 2. The same, counted by ranks in
# the package's own matrices: dimension of the kernels of A - 1/8 and of its square.

for n, dimensions in {2: (2, 3), 3: (2, 2), 4: (4, 4), 5: (2, 2), 8: (4, 4), 12: (4, 4)}.items():
    built = subdivision_matrix(CATMULL_CLARK, Sector("interior", n))
    A = Matrix(built.size, built.size, lambda i, k, rows=built.rows: Rational(rows[i].get(k, 0)))
    shifted = DomainMatrix.from_Matrix(A - Matrix.eye(built.size) / 8).convert_to(QQ)
    assert tuple(built.size - power.rank() for power in (shifted, shifted**2)) == dimensions
