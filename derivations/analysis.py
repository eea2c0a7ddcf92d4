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
"""Which vertices have limits and normals, whatever the masks: what their spectra must fulfil.

After Reif (1995) and Peters and Reif (2008).

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Limits and normals of any masks
#
# For the masks of a user, at smooth vertices and darts of any number of faces: when refinement has
# a limit, and when unit normals have one. Other rings take no mask of a user's own. For Catmull
# and Clark's masks the criterion gives the table of `LimitSurface`, which is asserted at the end.
#
# - U. Reif, "A unified approach to subdivision algorithms near extraordinary vertices", Computer
#   Aided Geometric Design 12 (1995): regular and injective characteristic maps.
# - J. Peters, U. Reif, "Subdivision Surfaces", Springer 2008: the same for general spectra.
# - E. Jury, "Theory and Application of the z-Transform Method", 1964: roots inside a circle.

# %%
import re
from fractions import Fraction

import numpy as np
from mpmath import mp
from mpmath import sqrt as root
from sympy import Matrix, Rational, Symbol, cancel, expand, simplify, sqrt, symbols

from limitsurf import LimitSurface
from limitsurf.exact.spectrum import ring_normal
from limitsurf.exact.wide import Weights, dart_factor, wide_dart_values
from limitsurf.scheme.catmull_clark import CATMULL_CLARK
from limitsurf.scheme.loop import LOOP
from limitsurf.tables import Sector, eigen_table

mp.dps = 40
lam = Symbol("lambda")

# %% [markdown]
# ## 1. What the vertex mask changes
#
# The vertex takes $a$ of itself, $n$ of each edge neighbour and $m$ of each new face point, so on
# the ring $n + \frac{m}{2}$ of each $e_j$ and $\frac{m}{4}$ of each $f_j$. Let $r$ be these,
# $B$ the matrix of the ring without the vertex and $b$ its column of the vertex. All rows sum to
# one, so $b = (I - B) \, 1$ and the vertex has $1 - r 1$ of itself. The determinant of
#
# $$
# \begin{pmatrix} \lambda - 1 + r 1 & -r \\ -b & \lambda - B \end{pmatrix}
# $$
#
# is that of $\lambda - B$ times $\lambda - 1 + r 1 - r (\lambda - B)^{-1} b$, and with
# $(\lambda - B)^{-1} (I - B) \, 1 = 1 - (\lambda - 1) (\lambda - B)^{-1} 1$ this is
# $(\lambda - 1) \, T$,
#
# $$
# T(\lambda) = 1 + r \, (\lambda - B)^{-1} \, 1 .
# $$


# %%
def ring_matrix(kind, N, mask):
    """Of v, e_0, f_0, e_1, ... around a smooth vertex or a dart."""
    own, n, m = mask
    one = [Matrix([[int(i == j) for j in range(2 * N + 1)]]) for i in range(2 * N + 1)]
    v, e, f = one[0], one[1::2], one[2::2]
    new = [(v + e[j] + f[j] + e[(j + 1) % N]) / 4 for j in range(N)]
    edges = [(v + e[j] + new[j - 1] + new[j]) / 4 for j in range(N)]
    if kind == "dart":
        edges[0] = (v + e[0]) / 2
    rows = [own * v + n * sum(e, 0 * v) + m * sum(new, 0 * v)]
    for j in range(N):
        rows += [edges[j], new[j]]
    return Matrix.vstack(*rows)


for kind in ("smooth", "dart"):
    for N in (2, 3):
        edge, face = Rational(1, 7), Rational(-2, 5)  # as good as any
        ring = ring_matrix(kind, N, (1 - N * (edge + face), edge, face))
        assert all(sum(ring.row(i)) == 1 for i in range(2 * N + 1))
        B, r = ring[1:, 1:], ring[0, 1:]
        for k in range(2 * N + 2):  # polynomials of degree 2 N + 1
            value = Rational(k + 10, 7)
            free = value * Matrix.eye(2 * N) - B
            T = 1 + (r * free.LUsolve(Matrix.ones(2 * N, 1)))[0]
            whole = value * Matrix.eye(2 * N + 1) - ring
            assert whole.det() == free.det() * (value - 1) * T

# %% [markdown]
# The eigenvalues of $B$ are those of waves around a vertex that stays, in
# [sectors](sectors.py), sections 3 and 5, and $\frac12$ at the end of the dart: none is larger than
# $(3 + \sqrt5) / 8 = 0.6545$. So *refinement has a limit if and only if $T$ has no zero of modulus
# 1 or more*: a zero at 1 is a second eigenvalue 1.
#
# ## 2. Closed forms
#
# $x = (\lambda - B)^{-1} 1$ obeys the rows of the regular masks, with 1 on the right-hand side. As
# in [sectors](sectors.py), section 2, $f_j = (4 + e_j + e_{j+1}) / (4\lambda - 1)$, and the $e_j$
# follow a recurrence, with a constant solution $\rho$ and
# $w + \frac1w = 16\lambda + \frac1\lambda - 10$ for what is added to it. A smooth vertex has
# $e_j = \rho$, a dart $e_0 = 1 / (\lambda - \frac12)$ and
#
# $$
# e_j = \rho + (e_0 - \rho) \frac{w^j + w^{N-j}}{1 + w^N}, \qquad
# \sum_j e_j = N \rho + (e_0 - \rho) \, \frac{1 + w}{1 - w} \, \frac{1 - w^N}{1 + w^N} .
# $$

# %%
before, here, after = symbols("e_before e e_after")
new = [lam * (4 + here + other) / (4 * lam - 1) - 1 for other in (before, after)]
edge_row = here / 4 + sum(new) / 4 + 1 - lam * here
factor = lam / (4 * (4 * lam - 1))
rho = (8 * lam - 1) / (16 * lam**2 - 12 * lam + 1) * 2
recurrence = before + after - (16 * lam + 1 / lam - 10) * here
assert cancel(edge_row.subs({before: rho, here: rho, after: rho})) == 0
assert cancel(edge_row - factor * (recurrence - recurrence.subs(
    {before: rho, here: rho, after: rho}
))) == 0  # fmt: skip


def weights(N, own, neighbours):
    """Of the package, with masks of a vertex of its own."""
    known = Weights.of(CATMULL_CLARK, N, exact=True)
    masks = {"own": own, "edge": neighbours / N, "around": (1 - own - neighbours) / N}
    return Weights(**{**vars(known), **masks})


def number(x):
    return mp.mpf(x.numerator) / x.denominator


def solved_factor(w, N, value):
    """T from its definition."""
    mask = [Rational(x.numerator, x.denominator) for x in (w.own, w.edge, w.around)]
    ring = ring_matrix("dart", N, mask)
    B = mp.matrix(ring[1:, 1:].applyfunc(float).tolist())  # all weights are sums of 2^-k
    x = mp.lu_solve(value * mp.eye(2 * N) - B, mp.ones(2 * N, 1))
    return 1 + sum(number(ring[0, k + 1]) * x[k] for k in range(2 * N))


def in_digits(w):
    return Weights(*map(number, vars(w).values()))


for N in (2, 3, 5, 8):
    w = weights(N, Fraction(-2, 3), Fraction(1, 5))
    for value in (mp.mpf("1.3"), mp.mpf("-0.7"), mp.mpc("0.4", "-0.9")):
        closed = dart_factor(in_digits(w), N, value, root)
        assert abs(closed - solved_factor(w, N, value)) < 1e-30

# %% [markdown]
# Triangles have no face points: with the weight $a = \frac38$ of an end and $b = \frac18$ of an
# opposite corner $(\lambda - a) \, e_j - b \, (e_{j-1} + e_{j+1}) = 1$, and so
# $w + \frac1w = (\lambda - a) / b$, $\rho = 1 / (\lambda - a - 2 b)$, and
# $T = 1 + n \sum_j e_j$. The eigenvalues of $B$ are $a + 2 b \cos \kappa \le \frac58$, and
# $\frac12$.

# %%
for N in (3, 5, 8):
    known = Weights.of(LOOP, 6, exact=True)
    w = Weights(**{**vars(known), "own": Fraction(-2, 3), "edge": Fraction(5, 3) / N})
    for value in (mp.mpf("1.3"), mp.mpf("-0.7"), mp.mpc("0.4", "-0.9")):
        B = mp.matrix(N, N)
        for j in range(N):
            B[j, j] += mp.mpf(3) / 8
            for near in (j - 1, (j + 1) % N):
                B[j, near] += mp.mpf(1) / 8
        for j in range(N):
            B[0, j] = mp.mpf(j == 0) / 2
        x = mp.lu_solve(value * mp.eye(N) - B, mp.ones(N, 1))
        solved = 1 + number(w.edge) * sum(x)
        assert abs(dart_factor(in_digits(w), N, value, root) - solved) < 1e-30

# %% [markdown]
# In quads, on the unit circle $\left|16 \lambda + \frac1\lambda - 10\right|$ is least at 1, where
# it is 7, so $\left|w\right| \le (7 - 3 \sqrt5) / 2 = 0.146$ there and outside. Of 65 and more
# faces $w^N$ is below $10^{-54}$. Without it $T = X + Y q$ with rational $X$ and $Y$ and
#
# $$
# q = \frac{1 + w}{1 - w}, \qquad q^2 = \frac{p + 2}{p - 2}, \qquad p = w + \frac1w,
# $$
#
# and its zeros are among those of a polynomial, $X^2 (p - 2) = Y^2 (p + 2)$, whose degree does not
# depend on $N$. In triangles $\left|8 \lambda - 3\right| \ge 5$ there, and $w^N$ is below
# $10^{-44}$.

# %%
c = Symbol("c", real=True)  # cosine of the angle of a point of the circle
square = (17 * c - 10) ** 2 + 225 * (1 - c**2)
assert simplify(square.diff(c).subs(c, 1)) < 0
assert square.diff(c, 2).is_positive
assert square.subs(c, 1) == 49
w, p = symbols("w p")
assert cancel(((1 + w) / (1 - w)) ** 2 - ((p + 2) / (p - 2)).subs(p, w + 1 / w)) == 0
assert ((7 - 3 * sqrt(5)) / 2) ** 65 < Rational(1, 10**54)

for own_weight in (Fraction(-9, 10), Fraction(-1, 2), Fraction(3)):
    w = weights(70, own_weight, (1 - own_weight) / 2)
    (value,) = (x.real for x in wide_dart_values(w, 70) if abs(x) > 0.66)
    assert abs(dart_factor(in_digits(w), 70, mp.mpf(value), root)) < 1e-10

# %% [markdown]
# *Examples.* A vertex of valence 5 that takes $a$ of itself and shares the rest evenly, at the end
# of a sharp edge: with $a = -\frac12$ the largest eigenvalue after 1 is $-0.695$, with
# $a = -\frac9{10}$ it is $-1.043$, and there is no limit.

# %%
for own_weight, expected in ((Fraction(-1, 2), "-0.695"), (Fraction(-9, 10), "-1.043")):
    w = in_digits(weights(5, own_weight, (1 - own_weight) / 2))
    found = mp.findroot(lambda x, w=w: dart_factor(w, 5, x, root), mp.mpf(expected))
    assert abs(found - mp.mpf(expected)) < 5e-4

# %% [markdown]
# ## 3. Normals
#
# By [limit_normals](limit_normals.py), section 1, the normals of the $n$-th ring are those of
# $\sum_{i<j} (\lambda_i \lambda_j)^n \, m_{ij} \, (P_i \times P_j)$. One pair outweighs all others
# if and only if its second value is larger in modulus than the third one. Three things can still
# spoil the limit:
#
# - a negative or complex value of the two: the sign of $(\lambda_1 \lambda_2)^n$ alternates, or the
#   pair turns;
# - a minor that changes its sign, on any face;
# - a map that goes around the vertex several times, which is not injective.
#
# At the head $g$ of a Jordan chain with the end $p$ the weight is $n \lambda^n$ instead, with the
# function of the end: of equal moduli heads outweigh others, and a head does not compete with its
# own end. Where $\varphi_p$ is zero, along sharp edges, the weight is that of $g$ without $n$. If
# another mode has it as well, normals there are others: in a corner of four faces $g$, of
# $(S_0 - S_4) / 2$, and the even mode, of $(S_0 + S_4) / 2$, both have $\frac12$, and along an edge
# it is the sum that counts, $S_0$. On a crease of four faces there is no other: the limit is there.

# %%
for kind, others in (("corner", 1), ("crease", 0)):
    table = eigen_table(CATMULL_CLARK, Sector(kind, 4))
    at_half = set(np.flatnonzero(table.rates[0] == 0.5).tolist())
    chained = {k for head in table.chains.tolist() for k in (head, head - 1)}
    assert len(at_half & chained) == 2
    assert len(at_half - chained) == others

# %% [markdown]
# At smooth vertices and darts the mask can add eigenvalues by $T$, everything else is that of the
# regular masks. So a smooth vertex has a normal exactly where the two values of frequency 0 are
# smaller than those of frequency 1, whose minor [scaling](scaling.py), section 2, shows to be
# positive for all $N \ge 3$.
#
# Signs of minors are found from Bernstein coefficients in integers, of 96 digits, on pieces that
# are halved until all are positive or one of a corner is not. In quads a minor of bicubic functions
# has degree 5 in each direction; in triangles one of quartic functions has degree 6.
#
# ## 4. Catmull and Clark
#
# The table of `LimitSurface`, row by row: eigenvalues, growth, and where there is a normal.

# %%
ROW = re.compile(
    r"(smooth, valence|\w+ of) (\d+)(?: faces?)? +(\S+) +(\S+) +(\S+) +.* (\S+) +(none|yes.*)"
)
rows = 0
for line in map(str.strip, (LimitSurface.__doc__ or "").splitlines()):
    if not (match := ROW.fullmatch(line)) or "  " not in line:
        continue
    what, faces, *values = match.group(1, 2, 3, 4, 5)
    kind = "interior" if what.startswith("smooth") else what.split()[0]
    table = eigen_table(CATMULL_CLARK, Sector(kind, int(faces)))
    assert table.rates[0, 1:4].round(3).tolist() == [float(x) for x in values]
    pair = ring_normal(CATMULL_CLARK, kind, int(faces))
    assert (match[7] == "none") == (not pair)
    assert ("1 / n" in match[7]) == (table.growth["normals"] == 1)
    if match[6].endswith("^n"):
        assert abs(float(match[6][:-2]) / (table.growth["curvature"] or 0) - 1) < 0.005
    rows += 1
assert rows == 18

# %% [markdown]
# And for more faces than it has rows for:

# %%
for kind, least, expected in (
    ("interior", 2, range(3, 10)),
    ("crease", 1, range(1, 5)),
    ("corner", 1, range(1, 3)),
    ("dart", 2, range(3, 10)),
    ("cone", 2, ()),
    ("flap", 1, ()),
    ("pendant", 2, ()),
):
    found = [k for k in range(least, 10) if ring_normal(CATMULL_CLARK, kind, k)]
    assert found == list(expected)

# %% [markdown]
# ## 5. Which eigenvalues are equal
#
# Jordan blocks, and which vectors the outer points have besides, hang on whether eigenvalues of
# different blocks are equal. They are computed to 96 digits and taken as equal if 60 agree. That is
# no guess where waves meet the rational eigenvalues $d = 2^{-k}$, $k \le 6$, of curves and outer
# points. The block of a wave with cosine $c = \cos(2 \pi f / N)$ has the determinant
# $D(d, c) = \alpha + \beta c$ at $d$, linear in $c$. So $d$ is an eigenvalue only if
# $c = -\alpha / \beta$, which is rational: by Niven's theorem $0$, $\pm \frac12$ or $\pm 1$, if it
# is a cosine of a rational part of the circle at all. In both lattices it is one of these, or no
# cosine, for all $d$:

# %%
c = Symbol("c")
NIVEN = {Rational(x, 2) for x in (-2, -1, 0, 1, 2)}
least = Rational(1)
for scheme in (CATMULL_CLARK, LOOP):
    w = Weights.of(scheme, scheme.lattice.valence, exact=True)
    corner, end, face = (Rational(x.numerator, x.denominator) for x in (w.corner, w.end, w.face))
    for k in range(7):
        d = Rational(1, 2**k)
        waves = end + 2 * face * c - d
        if corner:
            square = (1 + c) / 2  # of the cosine of half the angle
            waves = (end + 4 * face * corner * square - d) * (corner - d)
            waves -= 4 * face * corner**2 * square
        alpha, beta = waves.subs(c, 0), waves.diff(c)
        assert expand(alpha + beta * c - waves) == 0
        if beta:
            at = -alpha / beta
            assert at in NIVEN or abs(at) > 1
            least = min(least, abs(beta), abs(beta) * (abs(at) - 1) if abs(at) > 1 else least)
        else:
            assert alpha
            least = min(least, abs(alpha))
assert least >= Rational(1, 512)

# %% [markdown]
# And if they are not equal, they are far apart. Angles of $c$ and of a value of Niven's are
# multiples of $2 \pi / 12 N$, half their sum and half their difference of $\pi / 12 N$, whose sines
# are at least $1 / 6 N$ unless they vanish. So the product
# $\left|c - c_0\right| = 2 \left|\sin \, \sin\right|$ is at least $1 / 18 N^2$, and as the other
# eigenvalue of the block is less than 1 from $d$,
# $\left|\lambda - d\right| \ge \left|D\right| \ge 1 / (512 \cdot 18 N^2)$: for a million faces
# $10^{-17}$, where 60 digits decide.
#
# The eigenvalues that a vertex mask adds are roots of rational polynomials, whose values at $d$ are
# fractions: not zero, they are at least one over their denominator, which for masks of less than a
# dozen digits is far from $10^{60}$.

# %%
for N in (3, 5, 7, 12, 97):
    for f in range(1, N // 2 + 1):
        for niven in NIVEN:
            gap = abs(mp.cos(2 * mp.pi * f / N) - mp.mpf(niven.p) / niven.q)
            assert gap < mp.mpf(10) ** -35 or gap >= mp.mpf(1) / (18 * N**2)
