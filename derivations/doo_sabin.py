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
"""Doo and Sabin's scheme: masks, the matrix around any polygon, and what lies beyond boundaries.

After Doo and Sabin (1978).

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # The scheme of Doo and Sabin
#
# The masks on a regular mesh are knot insertion for biquadratic B-splines; their eigenvalues around
# an $n$-gon, for symbolic $n$; the $n + 5$ control points of a face, and the two Jordan blocks that
# there are from $n = 5$ on; that the points beyond a boundary stay reflections at its curve; eleven
# numbers that tell of a face at any polygon what the $n + 5$ points do; and quads amid others as
# four pieces of the spline over the vertices themselves.
#
# - D. Doo, M. Sabin, "Behaviour of recursive division surfaces near extraordinary points",
#   Computer-Aided Design 10 (1978): the weights.
# - G. Chaikin, "An algorithm for high speed curve generation", 1974: the curve.

# %%
from dataclasses import replace
from itertools import product

import numpy as np
from sympy import (
    Matrix,
    Rational,
    Symbol,
    cos,
    diag,
    diff,
    expand,
    eye,
    factor,
    pi,
    simplify,
    sin,
    symbols,
    sympify,
)

from limitsurf.exact.dual import center_pieces
from limitsurf.exact.matrices import subdivision_matrix
from limitsurf.scheme.doo_sabin import DOO_SABIN

HALF, QUARTER = Rational(1, 2), Rational(1, 4)

# %% [markdown]
# ## 1. Masks
#
# The quadratic B-spline of three knot intervals is $\frac14 (1, 3, 3, 1)$ of those of half the
# size: $(1 + z)^3 = 1 + 3 z + 3 z^2 + z^3$. So a new point has $\frac34$ of the nearer and
# $\frac14$ of the farther of two old ones, on curves (Chaikin), and in both directions of a square
#
# $$
# \frac1{16} (9, 3, 1, 3)
# $$
#
# of its corners, from the nearest one around. The mask of an $n$-gon,
#
# $$
# \alpha_j = \frac{\delta_j}{4} + \frac{3 + 2 \cos (2 \pi j / n)}{4 n} ,
# $$
#
# is that at $n = 4$; and rational for $n = 2, 3, 4, 6$ alone.


# %%
def alpha(j, n):
    own = QUARTER if j % n == 0 else 0
    return own + (3 + 2 * cos(2 * pi * Rational(j, n))) / (4 * n)


z = Symbol("z")
assert expand((1 + z) ** 3 / 4 - (1 + 3 * z + 3 * z**2 + z**3) / 4) == 0
along = {0: 3 * QUARTER, 1: QUARTER}
square = [(0, 0), (1, 0), (1, 1), (0, 1)]
assert [alpha(j, 4) for j in range(4)] == [along[x] * along[y] for x, y in square]
assert [alpha(j, 3) for j in range(3)] == [Rational(2, 3), Rational(1, 6), Rational(1, 6)]
assert all(simplify(sum(alpha(j, n) for j in range(n))) == 1 for n in (2, 3, 4, 5, 6, 8))

# %% [markdown]
# ## 2. The ring
#
# The points of an $n$-gon are mapped by a circulant. With $\zeta = e^{2 \pi i / n}$, the wave
# $x_j = \zeta^{f j}$ is multiplied by
#
# $$
# \sum_j \alpha_j \zeta^{f j} = \frac14 + \frac1{4 n} \sum_j
# \left( 3 \, \zeta^{f j} + \zeta^{(f + 1) j} + \zeta^{(f - 1) j} \right) ,
# $$
#
# where $\sum_j \zeta^{m j}$ is $n$ if $n$ divides $m$, and else $(\zeta^{m n} - 1) / (\zeta^m - 1)
# = 0$. So for every $n \ge 3$ the eigenvalues are
#
# $$
# 1 \ (f = 0), \qquad \frac12 \ (f = 1, n - 1), \qquad \frac14 \ \text{for all others} :
# $$
#
# $\lambda = \frac12$ does not depend on $n$. At $n = 2$, where $f = 1$ is $f = -1$, the second is
# $\frac34$: a position, but one wave and no tangent plane. The matrix is symmetric: the limit of
# the polygon is the mean of its points, and its tangents are $\sum_j \cos (2 \pi j / n) \, x_j$ and
# $\sum_j \sin (2 \pi j / n) \, x_j$.


# %%
def whole(m, n):
    """The sum of all powers of zeta to the m."""
    return n if m % n == 0 else 0


def eigenvalue(f, n):
    return QUARTER + Rational(3 * whole(f, n) + whole(f + 1, n) + whole(f - 1, n), 4 * n)


w = Symbol("w")
for n in range(2, 9):
    assert expand(sum(w**j for j in range(n)) * (w - 1) - (w**n - 1)) == 0
for n in range(3, 40):
    found = [eigenvalue(f, n) for f in range(n)]
    assert found == [1, HALF, *[QUARTER] * (n - 3), HALF]
assert [eigenvalue(f, 2) for f in range(2)] == [1, 3 * QUARTER]
for n, f in product((3, 4, 5, 6, 8), range(3)):
    summed = sum(alpha(j, n) * cos(2 * pi * Rational(f * j, n)) for j in range(n))
    assert abs((summed - eigenvalue(f, n)).evalf(40)) < 1e-35

# %% [markdown]
# ## 3. The points of a face
#
# Points lie in the middle of squares. The limit on a square with the $n$-gon $w_0 \dots w_{n - 1}$
# around its corner, itself $w_0$, and regular corners else depends on that ring and on five more:
#
# ```
#     (0,2) --- (1,2) --- (2,2)
#       |         |         |
#      w_1  ---  w_0  --- (2,1)
#       :         |         |
#       : ...   w_(n-1) - (2,0)
# ```
#
# One step makes the same of half the size. The outer block is regular; of its eigenvalues
# $\frac14, \frac14, \frac18, \frac18, \frac1{16}$, the products of those $1, \frac12, \frac14$ of
# curves that have at least one $\frac14$, none has a Jordan block.

# %%
RING = {(1, 1): 0, (0, 1): 1, (1, 0): -1}  # of the ring those that count, by steps around
OUTER = [(2, 0), (2, 1), (2, 2), (1, 2), (0, 2)]


def regular(place):
    """{old place: weight} of a new point; place (1, 1) holds the child at the corner."""
    each = []
    for x in place:
        near = (x + 1) // 2
        far = near + (1 if (x + 1) % 2 else -1)
        each.append({near: 3 * QUARTER, far: QUARTER})
    return {(a, b): p * q for a, p in each[0].items() for b, q in each[1].items()}


outer = Matrix(5, 5, lambda i, j: regular(OUTER[i]).get(OUTER[j], 0))
assert outer.eigenvals() == {QUARTER: 2, Rational(1, 8): 2, Rational(1, 16): 1}
assert outer.is_diagonalizable()
coupling = Matrix(5, 3, lambda i, j: regular(OUTER[i]).get(list(RING)[j], 0))
assert all(set(regular(place)) <= {*RING, *OUTER} for place in OUTER)
Matrix.hstack(coupling, outer) * 16

# %% [markdown]
# ## 4. Two Jordan blocks
#
# A vector $R$ of the ring of value $\frac14$ goes on to the outer points where $(A_{oo} - \frac14)
# \, x = - A_{or} R$ has a solution: where the two left eigenvectors of $A_{oo}$ for $\frac14$
# vanish on $A_{or} R$. With $w_0 = 1$ and $w_{\pm 1} = c$ for a cosine, $w_0 = 0$ and
# $w_{\pm 1} = \pm s$ for a sine they are one number each, the same up to a sign: multiples of

# %%
c, s = symbols("c s")
left = (outer.T - QUARTER * Matrix.eye(5)).nullspace()
even = [factor((row.T * coupling * Matrix([1, c, c]))[0]) for row in left]
odd = [factor((row.T * coupling * Matrix([0, s, -s]))[0]) for row in left]
assert len(left) == 2
assert all(simplify(x / (1 + c)).is_number and x != 0 for x in even)
assert all(simplify(x / s).is_number and x != 0 for x in odd)
even, odd

# %% [markdown]
# $1 + c$ and $s$. Of the frequencies $f = 2, \dots$ only $f = n / 2$, which has no sine, makes them
# vanish. So at $n = 3$, without such a frequency, and at $n = 4$, where $f = 2$ is $n / 2$, the
# matrix has a basis of eigenvectors; from $n = 5$ on there are two Jordan blocks of two, an even
# and an odd one: all other vectors of value $\frac14$ can be had from differences in which $1 + c$,
# or $s$, cancels. Ranks, in exact numbers at $n = 3, 4, 6$, say the same.


# %%
def extended(n):
    A = Matrix.zeros(n + 5, n + 5)
    for i, j in product(range(n), repeat=2):
        A[i, j] = alpha((j - i) % n, n)
    column = {place: step % n for place, step in RING.items()}
    column |= {place: n + k for k, place in enumerate(OUTER)}
    for k, place in enumerate(OUTER):
        for old, weight in regular(place).items():
            A[n + k, column[old]] += weight
    return A


for n, blocks in ((3, 0), (4, 0), (6, 2)):
    shifted = extended(n) - QUARTER * Matrix.eye(n + 5)
    assert (n + 5) - shifted.rank() == n - 3 + 2 - blocks
    assert shifted.rank() - (shifted * shifted).rank() == blocks
    assert (shifted * shifted).rank() == (shifted**3).rank()

# %% [markdown]
# First derivatives scale with $(2 \lambda)^m = 1$ on the way to the corner: they stay bounded, but
# for $n \ne 4$ have no limit. Curvature scales with $\frac14 / \lambda^2 = 1$: bounded at
# $n = 3, 4$; from $n = 5$ on, with the Jordan blocks, it grows like the number $m$ of halvings,
# that is like $\log (1 / r)$.
#
# ## 5. Boundaries
#
# Let $w_0, \dots, w_{k - 1}$ be the points of a boundary vertex in its $k$ faces after one step,
# and $c$, $d$ Chaikin's points on its two boundary edges, beside the first and the last face. The
# points beyond are
#
# $$
# g_j = 2 m_j - w_j, \qquad m_j = \frac{c + d}{2} + \frac{c - d}{2} \,
# \frac{\cos \theta_j}{\cos \theta_0}, \qquad \theta_j = \frac{(2 j + 1) \pi}{2 k} ,
# $$
#
# and the vertex has the $2 k$-gon $w_0 \dots w_{k - 1}, g_{k - 1} \dots g_0$. Its points are at the
# angles $\theta_0, \theta_1, \dots, \theta_{2 k - 1}$, and $w_j$ and $g_j$ at opposite ones. So
# what is even about $\theta = 0$ in the polygon, $(w_j + g_j) / 2$, is a wave of frequency 0 and
# one of frequency 1, and nothing else. One step multiplies them by 1 and by $\frac12$, and what is
# odd stays odd: the new points are reflections again, at
#
# $$
# m_j' = \frac{c + d}{2} + \frac{c - d}{4} \frac{\cos \theta_j}{\cos \theta_0} ,
# $$
#
# which is made of $c' = \frac34 c + \frac14 d$ and $d' = \frac14 c + \frac34 d$: Chaikin's points
# of the next step. ($m_0 = c$ and $m_{k - 1} = d$.) In the limit what is odd vanishes on the
# boundary, and the curve is Chaikin's, the quadratic B-spline of the boundary polygon, whatever the
# faces.

# %%
C, D = symbols("c d")
for k in range(2, 6):
    theta = [(2 * j + 1) * pi / (2 * k) for j in range(2 * k)]
    ws = symbols(f"w0:{k}")
    ratio = [cos(t) / cos(theta[0]) for t in theta]
    middle = [(C + D) / 2 + (C - D) / 2 * r for r in ratio]
    polygon = [*ws, *(2 * middle[j] - ws[j] for j in range(k - 1, -1, -1))]
    new = [sum(alpha((j - i) % (2 * k), 2 * k) * polygon[j] for j in range(2 * k))
           for i in range(2 * k)]  # fmt: skip
    turned = {C: 3 * C / 4 + D / 4, D: C / 4 + 3 * D / 4}
    assert simplify(middle[0] - C) == simplify(middle[k - 1] - D) == 0
    for j in range(k):
        gap = expand(new[j] + new[2 * k - 1 - j] - 2 * middle[j].subs(turned, simultaneous=True))
        assert all(abs(gap.coeff(x).evalf(40)) < 1e-35 for x in (C, D, *ws))

# %% [markdown]
# The quad of a boundary edge, between two vertices with Chaikin's points $c$ and $e$ on it, is
# closed by the reflections of its ends: $w, w^*, 2 e - w^*, 2 c - w$. New pairs are reflections at
# $\frac34 c + \frac14 e$, Chaikin's again.
#
# Amid *one* face $\cos \theta_0 = 0$. The vertex has the quad $w, g_1, x, g_0$ with $g_0 = 2 c - w$
# and $g_1 = 2 d - w$. With $x = w$ new pairs are reflections at $\frac34 c + \frac14 d$, as before.
# With $x = 4 v - w - g_0 - g_1$, so that the limit, the mean of the four, is $v$, they are
# reflections at $(c + v) / 2$: the curve ends in $v$.

# %%
W, Wstar, E, V = symbols("w wstar e v")


def step(quad):
    return [expand(sum(alpha((j - i) % 4, 4) * quad[j] for j in range(4))) for i in range(4)]


new = step([W, Wstar, 2 * E - Wstar, 2 * C - W])
assert expand(new[0] + new[3] - 2 * (3 * C / 4 + E / 4)) == 0
assert expand(new[1] + new[2] - 2 * (3 * E / 4 + C / 4)) == 0

first, last = 2 * C - W, 2 * D - W
new = step([W, last, W, first])
assert expand(new[0] + new[3] - 2 * (3 * C / 4 + D / 4)) == 0
assert expand(new[0] + new[1] - 2 * (C / 4 + 3 * D / 4)) == 0
assert expand(new[0] - new[2]) == 0
quad = [W, last, 4 * V - W - first - last, first]
new = step(quad)
assert expand(sum(quad) - 4 * V) == expand(sum(new) - 4 * V) == 0
assert expand(new[0] + new[3] - 2 * (C + V) / 2) == 0
assert expand(new[0] + new[1] - 2 * (D + V) / 2) == 0

# %% [markdown]
# On a grid the points beyond are what the first step makes of vertices $2 p - q$ beyond a boundary
# vertex $p$, with $q$ inside it: both continue the spline by reflection.

# %%
a, b, p, q, r, t = symbols("a b p q r t")  # three boundary vertices a, p, b, and inside q, r, t
inside = [Rational(9, 16) * p + Rational(3, 16) * (x + q) + Rational(1, 16) * y
          for x, y in ((a, t), (b, r))]  # fmt: skip
beyond = [x.subs({q: 2 * p - q, t: 2 * a - t, r: 2 * b - r}, simultaneous=True) for x in inside]
for x, y, end in zip(inside, beyond, (a, b), strict=True):
    assert expand(x + y - 2 * (3 * p / 4 + end / 4)) == 0

# %% [markdown]
# ## 6. Gathered rings
#
# All waves but the slowest are multiplied by $\frac14$. So with the mean $m$ of the points $p_j$ of
# a ring, and with
#
# $$
# X_k = \frac2n \sum_i \cos \frac{2 \pi (i - k)}{n} \, p_i , \qquad
# Y_k = \frac2n \sum_i \sin \frac{2 \pi (i - k)}{n} \, p_i ,
# $$
#
# of which all others are turns, $X_{k \pm 1} = X_k \cos \theta \pm Y_k \sin \theta$ with $\theta =
# 2 \pi / n$, a new point is
#
# $$
# p_k' = \tfrac14 p_k + \tfrac34 m + \tfrac14 X_k , \qquad m' = m, \qquad X_k' = \tfrac12 X_k, \quad
# Y_k' = \tfrac12 Y_k :
# $$
#
# of the ring a face depends on $p_k$ and its two neighbours, $m$, $X_k$ and $Y_k$:
# six points, if the last two are $m + X_k$ and $m + Y_k$. With the five others beside these there
# are eleven, at any $n$; the step is a matrix of them whose entries are the same but for $\cos
# \theta$ and $\sin \theta$. Its ring has the eigenvalues $1, \frac12, \frac12, \frac14, \frac14,
# \frac14$, with the vectors below.


# %%
for n in (5, 7, 8):
    points = symbols(f"p0:{n}")
    theta = [2 * pi * Rational(i, n) for i in range(n)]
    mean = sum(points) / n
    X = [2 * sum(cos(theta[(i - k) % n]) * points[i] for i in range(n)) / n for k in range(n)]
    Y = [2 * sum(sin(theta[(i - k) % n]) * points[i] for i in range(n)) / n for k in range(n)]

    def gap(x, of=points):
        return max(abs(expand(x).coeff(p).evalf(40)) for p in of)

    new = [sum(alpha((i - k) % n, n) * points[i] for i in range(n)) for k in range(n)]
    later = dict(zip(points, new, strict=True))
    for k in range(n):
        assert gap(new[k] - (points[k] + 3 * mean + X[k]) / 4) < 1e-35
        assert gap(X[(k + 1) % n] - X[k] * cos(theta[1]) - Y[k] * sin(theta[1])) < 1e-35
    for whole_, share in ((mean, 1), (X[0], HALF), (Y[0], HALF)):
        assert gap(whole_.subs(later, simultaneous=True) - share * whole_) < 1e-35

co, si = symbols("co si")
ring = Matrix([  # p_0, p_1, p_-1, m, m + X, m + Y
    [QUARTER, 0, 0, HALF, QUARTER, 0],
    [0, QUARTER, 0, (3 - co - si) / 4, co / 4, si / 4],
    [0, 0, QUARTER, (3 - co + si) / 4, co / 4, -si / 4],
    [0, 0, 0, 1, 0, 0],
    [0, 0, 0, HALF, HALF, 0],
    [0, 0, 0, HALF, 0, HALF],
])  # fmt: skip
vectors = Matrix([
    [1, 1, 0, 1, 0, 0], [1, co, si, 0, 1, 1], [1, co, -si, 0, 1, -1],
    [1, 0, 0, 0, 0, 0], [1, 1, 0, 0, 0, 0], [1, 0, 1, 0, 0, 0],
])  # fmt: skip
left = Matrix([
    [0, 0, 0, 1, 0, 0], [0, 0, 0, -1, 1, 0], [0, 0, 0, -1, 0, 1],
    [1, 0, 0, 0, -1, 0], [0, HALF, HALF, co - 1, -co, 0], [0, HALF, -HALF, si, 0, -si],
])  # fmt: skip
values = diag(1, HALF, HALF, QUARTER, QUARTER, QUARTER)
assert (ring * vectors - vectors * values).expand().is_zero_matrix
assert (left * vectors - eye(6)).expand().is_zero_matrix

waves = DOO_SABIN.waves
for n in (7, 12, 360):
    sector = replace(DOO_SABIN.sector("interior", n), gathered=True)
    matrix = subdivision_matrix(DOO_SABIN, sector)
    here = ring.subs({co: cos(2 * pi / n), si: sin(2 * pi / n)})
    for k, row in enumerate(matrix.rows[:6]):
        gaps = (abs((sympify(row.get(j, 0)) - here[k, j]).evalf(40)) for j in range(6))
        assert max(gaps) < 1e-35

# %% [markdown]
# That the limits agree: of random points around a polygon, of which both sets of control points are
# formed, the eleven are after any number of steps what they should be of the $n + 5$. Then so are
# all patches, which are splines over them.

# %%
rng = np.random.default_rng(0)
for n in (7, 10):
    full = subdivision_matrix(DOO_SABIN, DOO_SABIN.sector("interior", n), float)
    sector = replace(DOO_SABIN.sector("interior", n), gathered=True)
    few = subdivision_matrix(DOO_SABIN, sector, float)

    def dense(matrix):
        found = np.zeros((matrix.size, matrix.size))
        for k, row in enumerate(matrix.rows[: matrix.size]):
            found[k, list(row)] = list(row.values())
        return found

    def gathered(x, n=n):
        turn = np.exp(2j * np.pi * np.arange(n) / n)
        wave, middle = 2 / n * (turn @ x[:n]), x[:n].mean()
        own = [x[0], x[1], x[n - 1], middle, middle + wave.real, middle + wave.imag]
        return np.concatenate([own, x[n:]])

    x = rng.normal(size=n + 5)
    y = gathered(x)
    for _ in range(5):
        x, y = dense(full) @ x, dense(few) @ y
        assert abs(gathered(x) - y).max() < 1e-14

# %% [markdown]
# ## 7. Quads amid others
#
# Around a quad whose vertices all are amid four quads the points of the first step are a part of a
# regular lattice: the limit is the biquadratic B-spline of the vertices. Its knots are in the
# middle of edges: along the quad, between the second and the third of four vertices, it is
# quadratic up to $\frac12$, with the weights $\frac12 (\frac12 - t)^2, \frac34 - t^2, \frac12
# (\frac12 + t)^2, 0$, and from there on the mirror image.

# %%
lower = [(HALF - t) ** 2 / 2, 3 * QUARTER - t**2, (HALF + t) ** 2 / 2, 0]
assert expand(lower[0] + lower[1] + lower[2]) == 1
upper = [sympify(weight).subs(t, 1 - t) for weight in lower[::-1]]
for order in range(2):
    for one, other in zip(lower, upper, strict=True):
        assert diff(one, t, order).subs(t, HALF) == diff(other, t, order).subs(t, HALF)
# Chaikin's points, and the piece of the quadratic B-spline between three of them
points = symbols("v0:4")
chaikin = [
    (3 * points[a] + points[b]) / 4 for a, b in ((0, 1), (1, 0), (1, 2), (2, 1), (2, 3), (3, 2))
]
T = symbols("T")
piece = [(1 - T) ** 2 / 2, HALF + T * (1 - T), T**2 / 2]
first = sum(weight * x for weight, x in zip(piece, chaikin[1:4], strict=True)).subs(T, 2 * t)
assert expand(first - sum(w * x for w, x in zip(lower, points, strict=True))) == 0
# what the library has: coefficients of the powers of T, the second half first
for half, weights in zip(center_pieces(DOO_SABIN), (upper, lower), strict=True):
    start = HALF if weights is upper else 0
    for k, weight in enumerate(weights):
        near = expand(sympify(weight).subs(t, start + T / 2))
        assert [near.coeff(T, j) for j in range(3)] == [Rational(row[k]) for row in half]

# %% [markdown]
# ## 8. At which frequencies curvature has a logarithm
#
# Around a polygon of the points $p_s$ let $a_s$ and $b_{s+1}$ be the points across the edge from
# $p_s$ to $p_{s+1}$, and $c_s$ that across the corner $p_s$. A step takes $\frac1{16} (9, 3, 3, 1)$
# of the quads $p_s, p_{s+1}, a_s, b_{s+1}$ and $p_s, a_s, b_s, c_s$, and for waves
# $e^{2 \pi i f s / n}$, $w = e^{2 \pi i f / n}$, this extended step is the block below. Its outer
# part has the eigenvalues $\frac14, \frac18, \frac1{16}$ at every frequency, $\frac14 = \lambda^2$
# with the left eigenvector $(1, w, 0)$. Where the ring has $\frac14$ too, for $2 \le f \le n / 2$,
# there is a Jordan block if the coupling $\frac34 (1 + w)$ is not zero, so at all of these
# frequencies but $f = n / 2$. There curvature grows like the number of halvings, $\log (1 / r)$,
# and it is bounded for $n = 3, 4$.

# %%
w, mu = symbols("w mu", nonzero=True)
sixteenth = Rational(1, 16)
extended = sixteenth * Matrix(
    [
        [16 * mu, 0, 0, 0],  # p
        [9 + 3 * w, 3, w, 0],  # a
        [9 + 3 / w, 1 / w, 3, 0],  # b
        [9, 3, 3, 1],  # c
    ]
)
outer_part = extended[1:, 1:]
assert outer_part.eigenvals() == {QUARTER: 1, QUARTER / 2: 1, sixteenth: 1}
slow = Matrix([[1, w, 0]])
assert expand(slow * outer_part - QUARTER * slow) == Matrix.zeros(1, 3)
assert expand((slow * extended[1:, 0])[0] - 3 * QUARTER * (1 + w)) == 0
equal_values = extended.subs(mu, QUARTER) - QUARTER * eye(4)
assert equal_values.subs(w, -1).rank() == 2  # two eigenvectors
for other_wave in (1, Rational(3, 5) + Rational(4, 5) * sympify("I")):
    assert equal_values.subs(w, other_wave).applyfunc(expand).rank() == 3
