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
"""Limit position, tangents and the scale of derivatives at an interior vertex of valence N.

After Halstead, Kass and DeRose (1993) and Stam (1998).

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Limit masks of a smooth vertex
#
# The limit position of a vertex of valence $N$, its two tangents and which of them is
# $\partial / \partial u$, for symbolic $N$; and how derivatives scale towards the vertex. In the
# end the masks are compared with 300 steps of refinement.
#
# - M. Halstead, M. Kass, T. DeRose, "Efficient, fair interpolation using Catmull-Clark surfaces",
#   SIGGRAPH 1993: the masks of position and tangents.
# - J. Stam, "Exact evaluation of Catmull-Clark subdivision surfaces at arbitrary parameter values",
#   SIGGRAPH 1998: eigenbasis functions, and how they scale.

# %%
from fractions import Fraction

import mpmath
from sympy import (
    Matrix,
    Rational,
    Symbol,
    cos,
    expand,
    factor,
    pi,
    simplify,
    sin,
    sqrt,
    symbols,
)

from limitsurf.exact.matrices import subdivision_matrix
from limitsurf.exact.ring import smooth_limit
from limitsurf.scheme.catmull_clark import CATMULL_CLARK
from limitsurf.scheme.sector import Sector

N, s = symbols("N s", positive=True)

# %% [markdown]
# ## 1. Position
#
# After $n$ steps the ring is $A^n P$. With the right eigenvectors $v_k$ of $A$ and the left ones
# $w_k$, scaled so that $w_k v_m = 1$ if $k = m$, else 0,
#
# $$
# A^n P = \sum_k \lambda_k^n \, v_k \, (w_k P) .
# $$
#
# Eigenvalue 1 belongs to the constant vector, and all others are smaller
# ([eigenstructure](eigenstructure.py), section 2): all points of the ring tend to $w_1 P$. Being
# symmetric, $w_1$ gives one weight to the vertex, one to each $e_j$ and one to each $f_j$; times
# their number these are a left eigenvector of the block of frequency 0
# ([subdivision_matrix](subdivision_matrix.py), section 2). The weights are
#
# $$
# \frac{1}{N (N + 5)} \left( N^2 C + 4 \sum_j e_j + \sum_j f_j \right),
# $$
#
# the mask of Halstead, Kass and DeRose.

# %%
centre_block = Matrix(
    [
        [1 - 7 / (4 * N), 3 / (2 * N), 1 / (4 * N)],
        [Rational(3, 8), Rational(1, 2), Rational(1, 8)],
        [Rational(1, 4), Rational(1, 2), Rational(1, 4)],
    ]
)
position = Matrix([[N**2, 4, 1]]) / (N * (N + 5))
summed = Matrix([[position[0], N * position[1], N * position[2]]])
assert simplify(summed * centre_block - summed) == Matrix.zeros(1, 3)
assert simplify(sum(summed) - 1) == 0

# %% [markdown]
# Outer points have no say, the whole matrix being block triangular with the ring first. At $N = 4$
# it is the B-spline mask $(1, 4, 1) / 6$ in both directions.

# %%
assert position.subs(N, 4) == Matrix([[16, 4, 1]]) / 36

# %% [markdown]
# ## 2. Tangents
#
# The next terms are those of $\lambda$, the largest eigenvalue below 1, with two eigenvectors: the
# cosine and the sine wave of frequency 1. So
#
# $$
# \frac{A^n P - \text{limit}}{\lambda^n} \;\to\; v_c \, (w_c P) + v_s \, (w_s P),
# $$
#
# and the two vectors $w_c P$, $w_s P$ span the tangent plane (if they are not parallel). With
# $s = \cos(\pi / N)$,
#
# $$
# \lambda = \frac{2 + s^2 + s \sqrt{4 + s^2}}{8},
# $$
#
# and a left eigenvector of the block of frequency 1 is
#
# $$
# (a, b) = \left( s + \sqrt{4 + s^2}, \; 1 \right) .
# $$

# %%
lam = (2 + s**2 + s * sqrt(4 + s**2)) / 8
block = Matrix([[Rational(1, 4) + s**2 / 4, s / 8], [s / 2, Rational(1, 4)]])
left = Matrix([[s + sqrt(4 + s**2), 1]])
assert simplify(left * block - lam * left) == Matrix.zeros(1, 2)

# %% [markdown]
# Hence $w_c$ has $a \, \cos((j - \frac12)\theta)$ on $e_j$ and $b \, \cos(j\theta)$ on $f_j$, with
# $\theta = 2\pi / N$ and angles from the diagonal of face 0.
#
# Halstead, Kass and DeRose measure angles from $e_0$, so that $f_j$ is at $(j + \frac12)\theta$,
# and write
#
# $$
# \sum_j A_N \, \cos\left(\frac{2\pi j}{N}\right) e_j
# + \left( \cos\left(\frac{2\pi j}{N}\right) + \cos\left(\frac{2\pi (j + 1)}{N}\right) \right) f_j,
# $$
#
# $$
# A_N = 1 + \cos\left(\frac{2\pi}{N}\right)
# + \cos\left(\frac{\pi}{N}\right) \sqrt{2 \left( 9 + \cos\left(\frac{2\pi}{N}\right) \right)} .
# $$
#
# The weights of the $f_j$ are $2 s \, \cos((j + \frac12)\theta)$. So $(A_N, 2 s)$ should be
# $2 s \, (a, b)$:

# %%
j, theta = symbols("j theta", real=True)
two_spokes = cos(j * theta) + cos((j + 1) * theta)
assert simplify(two_spokes - 2 * cos(theta / 2) * cos((j + Rational(1, 2)) * theta)) == 0

double = 2 * s**2 - 1  # cos(2 pi / N)
published = 1 + double + s * sqrt(factor(2 * (9 + double)))
assert expand(published - 2 * s * left[0]) == 0

# %% [markdown]
# ## 3. Which tangent is d/du
#
# The parameter $u$ runs along the edge to $e_0$. Reflect the ring in that edge: $e_j$ and $e_{-j}$
# change places, and so do $f_j$ and $f_{-1-j}$. The rules do not notice, so along this edge an odd
# eigenfunction is its own negative: zero. With angles from $e_0$, the sine wave is odd and the
# cosine wave even:

# %%
k = Symbol("k", integer=True)
assert sin(-k * theta) == -sin(k * theta)
assert simplify(sin((-1 - k + Rational(1, 2)) * theta) + sin((k + Rational(1, 2)) * theta)) == 0
assert simplify(cos((-1 - k + Rational(1, 2)) * theta) - cos((k + Rational(1, 2)) * theta)) == 0

# %% [markdown]
# So towards $e_0$ the surface leaves along the published mask with $e_0$ first, towards $e_1$ along
# the same mask turned by one. In waves from the diagonal these are
#
# $$
# \cos\left(\frac{\theta}{2}\right) w_c \mp \sin\left(\frac{\theta}{2}\right) w_s .
# $$

# %%
phase = (j - Rational(1, 2)) * theta
towards_0 = cos(theta / 2) * cos(phase) - sin(theta / 2) * sin(phase)
towards_1 = cos(theta / 2) * cos(phase) + sin(theta / 2) * sin(phase)
assert simplify(towards_0 - cos(j * theta)) == 0
assert simplify(towards_1 - cos((j - 1) * theta)) == 0

# %% [markdown]
# ## 4. By brute force
#
# 300 steps of the package's ring matrix on a random ring, with digits to spare and no eigenvector.
# The centre comes to the limit, the edge $e_0 - C$ to the tangent, the edges to the plane.


# %%
def dot(x, y):
    return mpmath.fsum(p * q for p, q in zip(x, y, strict=True))


def cross(x, y):
    return [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]]


def unit(x):
    return [p / mpmath.sqrt(dot(x, x)) for p in x]


def close(x, y, tolerance):
    return max(abs(p - q) for p, q in zip(x, y, strict=True)) < tolerance


mpmath.mp.dps = 200  # lambda^300 is down to 1e-116
for n in (3, 4, 5, 7):
    matrix = subdivision_matrix(CATMULL_CLARK, Sector("interior", n))
    count = 2 * n + 1
    A = mpmath.zeros(count)
    for i in range(count):
        for m, weight in matrix.rows[i].items():
            A[i, m] = mpmath.mpf(weight.numerator) / weight.denominator
    P = mpmath.matrix([[7 * i * i % 11, (3 * i + 5) % 7, i**3 % 13] for i in range(count)])
    ring = A**300 * P

    def combined(mask, P=P):
        return [mpmath.fsum(w * P[i, x] for i, w in enumerate(mask)) for x in range(3)]

    def tangent(turn, n=n):
        once, half = mpmath.cospi(mpmath.mpf(2) / n), mpmath.cospi(mpmath.mpf(1) / n)
        a_n = 1 + once + half * mpmath.sqrt(2 * (9 + once))
        turns = [mpmath.cospi(mpmath.mpf(2 * (i - turn)) / n) for i in range(n + 1)]
        mask = [w for i in range(n) for w in (a_n * turns[i], turns[i] + turns[i + 1])]
        return combined([0, *mask])

    weights = [n * n, *[4, 1] * n]
    assert close(ring[0, :], combined([mpmath.mpf(w) / (n * (n + 5)) for w in weights]), 1e-60)
    assert smooth_limit(matrix) == tuple(Fraction(w, n * (n + 5)) for w in (n * n, 4, 1))

    spokes = [[ring[i, x] - ring[0, x] for x in range(3)] for i in (1, 3)]
    # the next eigenvalue is below 0.8 lambda for these N, and 0.8^300 < 1e-29
    assert close(unit(spokes[0]), unit(tangent(0)), 1e-25)
    assert close(unit(spokes[1]), unit(tangent(1)), 1e-25)
    assert close(unit(cross(*spokes)), unit(cross(tangent(0), tangent(1))), 1e-25)

# %% [markdown]
# ## 5. The scale of derivatives
#
# An eigenvector of eigenvalue $\mu$, taken as control points, refines to $\mu$ times itself. So its
# limit, the eigenbasis function $g$, is its own copy at half the size (Stam 1998),
#
# $$
# g\left(\frac{u}{2}, \frac{v}{2}\right) = \mu \, g(u, v) .
# $$
#
# After $n$ halvings $g(u / 2^n) = \mu^n g(u)$, and by the chain rule a derivative of order $k$ at
# the smaller parameter is $(2^k \mu)^n$ times that at the larger.

# %%
u, mu = symbols("u mu", positive=True)
n = Symbol("n", integer=True, positive=True)
for k in range(4):
    for power in range(k, 6):  # any function: u^power stands for its Taylor terms
        g = u**power
        near = (mu**n * g.subs(u, 2**n * u)).diff(u, k)
        assert simplify(near - (2**k * mu) ** n * g.diff(u, k).subs(u, 2**n * u)) == 0

# %% [markdown]
# First derivatives follow $(2\lambda)^n$: they vanish where $\lambda < 1/2$, that is $N = 3$, are
# those of a spline at $N = 4$, and grow without bound for $N \ge 5$. The characteristic polynomial
# of the block says which: $1/2$ lies between its roots, so below $\lambda$, when $s^2 > 1/2$.

# %%
x = Symbol("x")
ring_polynomial = x**2 - (2 + s**2) / 4 * x + Rational(1, 16)
assert expand(ring_polynomial.subs(x, lam)) == 0
assert expand(ring_polynomial.subs(x, Rational(1, 2)) - (1 - 2 * s**2) / 16) == 0
assert cos(pi / 3) ** 2 < Rational(1, 2) == cos(pi / 4) ** 2 < cos(pi / 5) ** 2

# %% [markdown]
# Second derivatives follow $(4\lambda)^n$ and grow without bound for every $N$ but 4, where the
# vectors of $\lambda$ belong to linear functions.
#
# The unit normal feels no scale and tends to that of the vertex, but only as fast as the next
# eigenvalue $\mu$ falls behind: like $(\mu / \lambda)^n$. At a vertex of many faces $\mu$, of
# frequency 2, is close to $\lambda$: at the distance $2^{-332}$, about $10^{-100}$, from a vertex
# of valence 33 more than 1 % of that term is left.

# %%
mu_over_lambda = lam.subs(s, cos(2 * pi / 33)).evalf(30) / lam.subs(s, cos(pi / 33)).evalf(30)
assert Rational(1, 100) < mu_over_lambda**332 < Rational(1, 50)
mu_over_lambda**332
