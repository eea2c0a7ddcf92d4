# ---
# jupyter:
#   jupytext:
#     formats: py:percent
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% tags=["remove-cell"]
"""Eigenvalues and eigenvectors around an interior vertex, for symbolic valence N.

After Ball and Storry (1988), Reif (1995) and Stam (1998).

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # The eigenstructure of a smooth vertex
#
# For symbolic valence $N$: which eigenvalue is subdominant, and that it dominates for every
# $N \ge 3$; that no Jordan block arises for any $N \ge 3$, and that one does at $N = 2$; closed
# forms of the eigenvectors, those of the extended matrix included; how a polynomial identity proves
# them for all frequencies at once; and when other vertex masks converge.
#
# - A. Ball, D. Storry, "Conditions for tangent plane continuity over recursively generated B-spline
#   surfaces", ACM Transactions on Graphics 7 (1988).
# - U. Reif, "A unified approach to subdivision algorithms near extraordinary vertices", Computer
#   Aided Geometric Design 12 (1995): why the subdominant pair decides about the tangent plane.
# - J. Stam, "Exact evaluation of Catmull-Clark subdivision surfaces at arbitrary parameter values",
#   SIGGRAPH 1998: the eigenvectors of the extended matrix.
# - E. Jury, "Theory and application of the z-transform method", Wiley 1964: quadratics whose roots
#   are inside the unit circle.

# %%
from sympy import (
    QQ,
    Matrix,
    Rational,
    chebyshevt_poly,
    chebyshevu_poly,
    cos,
    degree,
    expand,
    factor,
    gcd,
    pi,
    rem,
    simplify,
    solve,
    sqrt,
    symbols,
)
from sympy.polys.matrices import DomainMatrix

from limitsurf.exact.matrices import subdivision_matrix
from limitsurf.scheme.catmull_clark import CATMULL_CLARK
from limitsurf.scheme.sector import Sector

N, s = symbols("N s", positive=True)
lam, mu = symbols("lambda mu")

# %% [markdown]
# ## 1. The eigenvalues of the ring
#
# [subdivision_matrix](subdivision_matrix.py) derives, for a wave of frequency $f = 1, \dots, N - 1$
# and $s = \cos(\pi f / N)$, the block
#
# $$
# \begin{pmatrix} \frac{1 + s^2}{4} & \frac{s}{8} \\ \frac{s}{2} & \frac{1}{4} \end{pmatrix},
# $$
#
# and for $f = 0$ a block with eigenvalue 1. Their characteristic polynomials, without that 1, are
#
# $$
# \lambda^2 - \frac{2 + s^2}{4} \, \lambda + \frac{1}{16}
# \qquad \text{and} \qquad
# \mu^2 - \frac{3N - 7}{4N} \, \mu + \frac{N - 3}{16N} .
# $$

# %%
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

# %% [markdown]
# The product of the two roots of the first is $1/16$, so they are a fourth of a number and of its
# inverse. Both are perfect squares,
#
# $$
# \lambda_\pm = \left( \frac{\sqrt{4 + s^2} \pm s}{4} \right)^2,
# $$
#
# which is $e^{\pm 2x} / 4$ with $2 \, \sinh(x) = s$. So $\lambda_+$ grows with $s$ and $\lambda_-$
# falls:
#
# $$
# \begin{array}{ll}
# s = 0: & \lambda_- = \lambda_+ = \frac{1}{4}, \\
# 0 < s < 1: & \frac{1}{16} < \frac{3 - \sqrt{5}}{8} < \lambda_- < \frac{1}{4} < \lambda_+
#   < \frac{3 + \sqrt{5}}{8} < 1 .
# \end{array}
# $$

# %%
upper, lower = ((sqrt(4 + s**2) + s) / 4) ** 2, ((sqrt(4 + s**2) - s) / 4) ** 2
for root in (upper, lower):
    assert expand(ring.subs(lam, root)) == 0
assert simplify(upper.diff(s) - 2 * upper / sqrt(4 + s**2)) == 0  # positive
assert expand(upper.subs(s, 1)) == (3 + sqrt(5)) / 8
assert expand(lower.subs(s, 1)) == (3 - sqrt(5)) / 8
assert Rational(1, 16) < (3 - sqrt(5)) / 8

# %% [markdown]
# The second polynomial has the discriminant
#
# $$
# \frac{5 (N - 3)^2 + 4}{16 N^2} :
# $$
#
# two different real roots, for $N \ge 3$ not negative as their sum and product are not, and neither
# is 1. At $N = 3$ they are $0$ and $1/6$.

# %%
discriminant = ((3 * N - 7) / (4 * N)) ** 2 - (N - 3) / (4 * N)
assert simplify(discriminant - (5 * (N - 3) ** 2 + 4) / (16 * N**2)) == 0
assert simplify(centre.subs(mu, 1) - 5 * (N + 5) / (16 * N)) == 0
assert set(solve(centre.subs(N, 3), mu)) == {0, Rational(1, 6)}

# %% [markdown]
# ## 2. The subdominant pair
#
# *Claim*: for every $N \ge 3$ the largest eigenvalue below 1 is $\lambda = \lambda_+$ at $f = 1$
# and $f = N - 1$, that of the cosine and the sine wave that go around once, and all others are
# smaller in modulus.
#
# *Other frequencies*: $\left| s \right| = \left| \cos(\pi f / N) \right|$ is largest at $f = 1$ and
# $N - 1$, and $\lambda_+$ grows. All $\lambda_-$ and the outer eigenvalues $1/8, \dots, 1/64$ are
# at most $1/4$. And $\lambda$ is at least its value at $N = 3$, $(9 + \sqrt{17}) / 32 > 2/5$:

# %%
smallest = upper.subs(s, Rational(1, 2))
assert expand(smallest - (9 + sqrt(17)) / 32) == 0
assert smallest > Rational(2, 5)

# %% [markdown]
# *Frequency 0*: both roots of the second polynomial are below $\lambda$ if $\lambda$ lies right of
# their mean, $(3N - 7) / (8N) < 3/8 < \lambda$, and if the polynomial is positive there. Modulo
# $\lambda$'s own equation it is, at $\mu = \lambda$,
#
# $$
# \frac{1}{4} \left( \lambda \left( \frac{7}{N} - (1 - s^2) \right) - \frac{3}{4N} \right) .
# $$

# %%
at_lambda = rem(expand(centre.subs(mu, lam)), ring, lam)
assert simplify(4 * at_lambda - (lam * (7 / N - (1 - s**2)) - 3 / (4 * N))) == 0

# %% [markdown]
# Here $1 - s^2 = \sin(\pi / N)^2 \le (\pi / N)^2 \le \pi^2 / (3N)$ for $N \ge 3$. So $4N$ times it
# is at least
#
# $$
# \frac{2}{5} \left( 7 - \frac{\pi^2}{3} \right) - \frac{3}{4} > 0,
# $$
#
# which proves the claim.

# %%
assert Rational(2, 5) * (7 - pi**2 / 3) - Rational(3, 4) > 0

# %% [markdown]
# Numbers, to compare with other programs:

# %%
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

# %% [markdown]
# $N = 2$ is outside the claim: the ring has $1$, $1/4$ twice ($f = 1$, $s = 0$), $1/8$ and $-1/4$.
# The $-1/4$ ties with the pair in modulus, so in general the normal swings forever and has no
# limit.

# %%
assert set(solve(centre.subs(N, 2), mu)) == {Rational(1, 8), -Rational(1, 4)}
assert set(solve(ring.subs(s, 0), lam)) == {Rational(1, 4)}

# %% [markdown]
# ## 3. The outer points
#
# The seven outer points of a face refine by knot insertion
# ([subdivision_matrix](subdivision_matrix.py), section 4).

# %%
OUTER = [(3, 0), (3, 1), (3, 2), (3, 3), (2, 3), (1, 3), (0, 3)]
LINES = {
    0: {0: Rational(1, 2), 1: Rational(1, 2)},
    1: {0: Rational(1, 8), 1: Rational(3, 4), 2: Rational(1, 8)},
    2: {1: Rational(1, 2), 2: Rational(1, 2)},
    3: {1: Rational(1, 8), 2: Rational(3, 4), 3: Rational(1, 8)},
}
rows = [{(a, b): p * q for a, p in LINES[i].items() for b, q in LINES[j].items()} for i, j in OUTER]
outer_block = Matrix(7, 7, lambda i, k: rows[i].get(OUTER[k], 0))

# %% [markdown]
# Its left eigenvectors are differences along the two outer sides; $1/8$ has the curve mask
# $(1, 4, 1)$. They are the rows of $W^{-1}$, with the eigenvalues $d$; the columns of $W$ are the
# right eigenvectors.

# %%
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
W = W_inverse.inv()
W

# %% [markdown]
# The whole matrix is
#
# $$
# \begin{pmatrix} A_r & 0 \\ A_{or} & A_o \end{pmatrix},
# $$
#
# $A_r$ the ring, $A_o$ the outer block, $A_{or}$ how the outer points hang on the ring. An
# eigenvector $r$ of $A_r$ with eigenvalue $\lambda$ becomes one of the whole, $(r, x)$, if
#
# $$
# A_{or} \, r + A_o \, x = \lambda x, \qquad \text{that is,} \quad x = W g, \quad
# g_m = \frac{(W^{-1} A_{or} \, r)_m}{\lambda - d_m} .
# $$
#
# Where $\lambda = d_m$ the numerator must vanish (then $g_m$ is free, say 0), or there is no such
# $x$ and the whole matrix has a Jordan block: the condition to be checked at every coincidence.


# %%
def numerators(values):
    coupling = [sum(w * values.get(k, 0) for k, w in row.items()) for row in rows]
    return W_inverse * Matrix(coupling)


# %% [markdown]
# ## 4. Coincidences
#
# Between waves and outer eigenvalues: $s^2 \le 1$ leaves one. It needs $\cos(\pi f / N)^2 = 1/2$,
# so $N = 4m$ and $f = m$ (or $N - m$).

# %%
assert {value: solve(ring.subs(lam, value), s**2) for value in set(d)} == {
    Rational(1, 8): [Rational(1, 2)],
    Rational(1, 16): [Rational(9, 4)],
    Rational(1, 32): [Rational(49, 8)],
    Rational(1, 64): [Rational(225, 16)],
}

# %% [markdown]
# Between frequency 0 and outer eigenvalues: two, at whole numbers $N$.

# %%
assert {value: solve(centre.subs(mu, value), N) for value in set(d)} == {
    Rational(1, 8): [2],
    Rational(1, 16): [4],
    Rational(1, 32): [Rational(136, 41)],
    Rational(1, 64): [Rational(656, 209)],
}

# %% [markdown]
# Eigenvalue 1 meets none. Among themselves, eigenvalues of the ring meet only across frequencies or
# between cosine and sine, which are different vectors. So the ring is diagonalisable for every $N$.
#
# ## 5. Eigenvectors of the waves
#
# $(E, F) = (4\lambda - 1, \; 2s)$ solves the block of a wave (its second row by sight), for
# $s \ne 0$.

# %%
E, F = 4 * lam - 1, 2 * s
first, second = (block - lam * Matrix.eye(2)) * Matrix([E, F])
assert rem(expand(first), ring, lam) == 0
assert expand(second) == 0

# %% [markdown]
# On the ring $e_j$ is $E$ times a wave at $(j - \frac12)\theta$ and $f_j$ is $F$ times the wave at
# $j\theta$, with $\theta = 2\pi f / N$, so that $s = \cos(\theta / 2)$. All values are polynomials
# in $s$, those of the sine after division by $\sin(\theta / 2)$:

# %%
double, triple = 2 * s**2 - 1, 4 * s**3 - 3 * s  # cos theta, cos(3 theta / 2)
cosine = {(1, 1): 0, (2, 1): E * s, (2, 2): F, (1, 2): E * s}
cosine |= {(0, 2): F * double, (0, 1): E * triple, (1, 0): E * triple, (2, 0): F * double}
sine = {(1, 1): 0, (2, 1): -E, (2, 2): 0, (1, 2): E}
sine |= {(0, 2): 2 * s * F, (0, 1): E * (4 * s**2 - 1)}
sine |= {(1, 0): -E * (4 * s**2 - 1), (2, 0): -2 * s * F}

# %% [markdown]
# The numerators, modulo $\lambda$'s own equation, are four polynomials, times what the symmetry
# demands: with
#
# $$
# \begin{array}{ll}
# n_8 = \frac{1}{4} \left( 8 \lambda s^2 + 44 \lambda + 10 s^2 - 11 \right), &
# n_{16} = \frac{1}{4} \left( 4 \lambda + 5 \right), \\
# n_{32} = \frac{1}{16} \left( 8 \lambda s^2 - 28 \lambda + 10 s^2 + 7 \right), &
# n_{64} = \frac{1}{8} \left( 4 \lambda s^2 - 12 \lambda + 5 s^2 + 18 \right)
# \end{array}
# $$
#
# they are, in the order of the rows of $W^{-1}$,
#
# $$
# \begin{array}{ll}
# \text{cosine:} & s n_8, \; s n_8, \; s (1 - s^2) n_{16}, \; -s (1 - s^2) n_{16}, \; s n_{32}, \;
#   s n_{32}, \; s n_{64}, \\
# \text{sine:} & -n_8, \; n_8, \; s^2 n_{16}, \; s^2 n_{16}, \; -n_{32}, \; n_{32}, \; 0 .
# \end{array}
# $$


# %%
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

# %% [markdown]
# The condition at the coincidence $s^2 = 1/2$, $\lambda = 1/8$: $n_8$ vanishes. No Jordan block.

# %%
assert n8.subs({lam: Rational(1, 8), s: sqrt(Rational(1, 2))}) == 0

# %% [markdown]
# More is true: modulo $\lambda$'s own equation $n_8$ is a multiple of $\lambda - \frac18$,
#
# $$
# n_8 = \left( 88 \lambda - 20 s^2 - 22 \right) \left( \lambda - \tfrac18 \right),
# $$
#
# so $g$ is a polynomial in $\lambda$ and $s$ there, and the eigenvector passes through the
# coincidence smoothly.

# %%
assert reduced((88 * lam - 20 * s**2 - 22) * (lam - Rational(1, 8)) - n8) == 0

# %% [markdown]
# At $f = N/2$ the wave has $s = 0$, $\lambda = 1/4$: the sine on the $e_j$ alone, the cosine on the
# $f_j$ alone. No outer eigenvalue is $1/4$.
#
# ## 6. Eigenvectors of frequency 0
#
# The cross product of the last two rows of the block minus $\mu$,
#
# $$
# (C, E, F) = \left( 16 \mu^2 - 12 \mu + 1, \; 6 \mu - 1, \; 4 \mu + 1 \right);
# $$
#
# it does not vanish, as $6\mu - 1$ and $4\mu + 1$ have no common root.

# %%
C, E, F = 16 * mu**2 - 12 * mu + 1, 6 * mu - 1, 4 * mu + 1
residual = (centre_block - mu * Matrix.eye(3)) * Matrix([C, E, F])
assert expand(residual[1]) == expand(residual[2]) == 0
assert simplify(residual[0] - 16 * (1 - mu) * centre) == 0

same = {(1, 1): C} | dict.fromkeys([(2, 1), (1, 2), (0, 1), (1, 0)], E)
same |= dict.fromkeys([(2, 2), (0, 2), (2, 0)], F)
at_8, again_at_8, at_16, again_at_16, *_ = (
    simplify(rem(expand(got), centre, mu)) for got in numerators(same)
)

# %% [markdown]
# $N = 4$, $\mu = 1/16$: the numerator is zero for every $N$ and $\mu$, since these left vectors
# take the difference of two points whose neighbours on the ring are alike. No Jordan block.

# %%
assert at_16 == again_at_16 == 0

# %% [markdown]
# $N = 2$, $\mu = 1/8$: the numerator is not zero. The whole matrix of valence 2 has $1/8$ three
# times (once from the ring, twice from outside), only two eigenvectors for it, and one Jordan block
# of size two.

# %%
assert simplify(at_8 - (102 * N * mu - 7 * N - 56 * mu + 6) / (4 * N)) == 0
assert simplify(again_at_8 - at_8) == 0
assert at_8.subs({N: 2, mu: Rational(1, 8)}) == Rational(21, 16)

# %% [markdown]
# So the matrix is diagonalisable for every $N \ge 3$ and not at $N = 2$. The same, counted by ranks
# in the package's own matrices: the dimensions of the kernels of $A - \frac18$ and of its square.

# %%
for n, dimensions in {2: (2, 3), 3: (2, 2), 4: (4, 4), 5: (2, 2), 8: (4, 4), 12: (4, 4)}.items():
    built = subdivision_matrix(CATMULL_CLARK, Sector("interior", n))
    A = Matrix(built.size, built.size, lambda i, k, rows=built.rows: Rational(rows[i].get(k, 0)))
    shifted = DomainMatrix.from_Matrix(A - Matrix.eye(built.size) / 8).convert_to(QQ)
    assert tuple(built.size - power.rank() for power in (shifted, shifted**2)) == dimensions

# %% [markdown]
# ## 7. All frequencies at once
#
# Points of the ring are at multiples of $\theta / 2$, and with $s = \cos(\theta / 2)$ their waves
# are Chebyshev polynomials,
#
# $$
# \cos\left(\frac{k\theta}{2}\right) = T_k(s), \qquad
# \sin\left(\frac{k\theta}{2}\right) = \sin\left(\frac{\theta}{2}\right) U_{k-1}(s), \qquad
# T_{k-1} + T_{k+1} = 2 s \, T_k, \quad U_{k-1} + U_{k+1} = 2 s \, U_k .
# $$
#
# So the eigenvectors of section 5 are polynomials in $\lambda$ and $s$, and so is what
# $A v - \lambda v$ leaves. If that vanishes modulo $\lambda$'s equation and modulo a polynomial in
# $s$ that is zero at $\cos(\pi f / N)$, it is zero for all these frequencies $f$. For odd and for
# even $f$, $0 < f < N$, such polynomials are
#
# $$
# \gcd(T_N + 1, \, U_{N-1}) \qquad \text{and} \qquad \gcd(T_N - 1, \, U_{N-1}) :
# $$
#
# at $s = \cos(\pi f / N)$ there is $T_N = \cos(\pi f) = (-1)^f$, and these $N - 1$ places are all
# roots of $U_{N-1}$, each simple. Going around the ring once more changes nothing: $T_{k+2N}$ is
# $T_k$ there.

# %%
for n in range(2, 13):
    for parity in (0, 1):
        wanted = [f for f in range(1, n) if f % 2 == parity]
        nodes = gcd(chebyshevt_poly(n, s) - (-1) ** parity, chebyshevu_poly(n - 1, s))
        assert degree(nodes, s) == len(wanted)
        assert all(abs(nodes.subs(s, cos(pi * f / n).evalf(30))) < 1e-20 for f in wanted)
        for k in range(4):
            turn = chebyshevt_poly(k + 2 * n, s) - chebyshevt_poly(k, s)
            assert not wanted or rem(turn, nodes, s) == 0
for k in range(1, 9):
    for polynomial in (chebyshevt_poly, chebyshevu_poly):
        around = polynomial(k - 1, s) + polynomial(k + 1, s) - 2 * s * polynomial(k, s)
        assert expand(around) == 0

# %% [markdown]
# ## 8. Other masks
#
# Let another scheme of the kind differ in the vertex mask alone: in all the weight $a$ on the
# neighbours, $b$ on the new face points and $1 - a - b$ on the vertex. (Catmull and Clark have
# $a = b = 1 / N$.) Waves do not notice. Frequency 0 has the eigenvalue 1 and two more, with the sum
# $\sigma$ and the product $\pi_0$:

# %%
a, b = symbols("a b")
own = 1 - a - b
other = Matrix([[own + b / 4, a + b / 2, b / 4], *centre_block.tolist()[1:]])
assert other.subs({a: 1 / N, b: 1 / N}).applyfunc(simplify) == centre_block.applyfunc(simplify)
total, product = expand(other.trace() - 1), expand(other.det())
assert expand((other - Matrix.eye(3)).det()) == 0
Matrix([total, product])

# %% [markdown]
# Refinement converges if both are smaller than 1 in modulus, and that is (Jury 1964) if
#
# $$
# \left| \pi_0 \right| < 1 \qquad \text{and} \qquad \left| \sigma \right| < 1 + \pi_0 .
# $$
#
# For a complex pair, $\pi_0$ is the square of the modulus, and
# $\left| \sigma \right| < 2 \sqrt{\pi_0} \le 1 + \pi_0$ anyway. For real $\mu_1$, $\mu_2$ the
# second condition says that $q(x) = x^2 - \sigma x + \pi_0$ is positive at $1$ and at $-1$. So is
# then
#
# $$
# q(1) \, q(-1) = (1 - \mu_1^2)(1 - \mu_2^2) :
# $$
#
# both are inside or both outside of $[-1, 1]$, but outside the first condition fails. Conversely,
# if both are inside, $q(\pm 1) = (1 \mp \mu_1)(1 \mp \mu_2) > 0$.

# %%
first, second, x = symbols("mu_1 mu_2 x")
q = expand((x - first) * (x - second))
assert expand(q.subs(x, 1) * q.subs(x, -1) - (1 - first**2) * (1 - second**2)) == 0
for a_value in range(-8, 25, 3):
    for b_value in range(-8, 25, 3):
        values = {a: Rational(a_value, 8), b: Rational(b_value, 8)}
        sigma, pi_0 = total.subs(values), product.subs(values)
        if abs(pi_0) == 1 or abs(sigma) == 1 + pi_0:
            continue  # on the border: a root of modulus 1
        roots = [(sigma + sign * sqrt(sigma**2 - 4 * pi_0)) / 2 for sign in (1, -1)]
        inside = all(abs(complex(root)) < 1 for root in roots)
        assert inside == (abs(pi_0) < 1 and abs(sigma) < 1 + pi_0)
