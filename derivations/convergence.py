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
"""How fast recursive refinement comes to its limit: order 2, and less at extraordinary vertices.

After Stam (1998) and Peters and Reif (2008).

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # The order of convergence
#
# After $m$ refinements each vertex of the mesh has a place $(u, v)$ on its limit face. How far is
# the vertex from the surface at that place? This document proves, for smooth meshes of quads and
# control points in general position:
#
# - where the surface is regular the gap falls like $4^{-m}$: order 2;
# - at an extraordinary vertex of valence $N$ it falls like $\lambda^m$, the subdominant eigenvalue,
#   on the vertices next to it, and these have the largest gap of all: order $\log_2 (1 / \lambda)$,
#   for every $N \ge 3$ but 4;
# - the extraordinary vertex itself comes like $\mu_0^m$, with the eigenvalue of frequency 0 after
#   1;
# - that gap is a shift within the surface: the distance of the vertices from the surface as a set
#   falls like $\mu^m$.
#
# The spectrum is in [eigenstructure](eigenstructure.py), eigenfunctions are in
# [eigenfunctions](eigenfunctions.py), the parameter $\tau$ and $\mu$ in [scaling](scaling.py).
#
# - J. Stam, "Exact evaluation of Catmull-Clark subdivision surfaces at arbitrary parameter values",
#   SIGGRAPH 1998: the limit in closed form.
# - J. Peters, U. Reif, "Subdivision surfaces", Springer 2008, chapter 8: distance of control meshes
#   from their limit.

# %%
from mpmath import cospi, log, mp, mpf, zeros
from mpmath import matrix as mp_matrix
from mpmath import sqrt as root
from sympy import QQ, Poly, Rational, expand, factor_list, symbols
from sympy.polys.fields import field
from sympy.polys.matrices import DomainMatrix

from limitsurf.exact.matrices import grid_index, subdivision_matrix
from limitsurf.scheme.catmull_clark import CATMULL_CLARK
from limitsurf.scheme.sector import Sector

# %% [markdown]
# ## 1. Regular places
#
# A vertex $p$ of a regular net lies on its surface but for second differences. With
# $\delta_u^2, \delta_v^2$ those along both grid lines and $\delta_u^2 \delta_v^2$ their product,
# the limit mask $(1, 4, 1) / 6$ in both directions says
#
# $$ X - p = \tfrac16 \delta_u^2 + \tfrac16 \delta_v^2 + \tfrac1{36} \delta_u^2 \delta_v^2 . $$
#
# After $m$ refinements the net has the spacing $2^{-m}$; second differences of the control points
# are values of second derivatives of a spline, times $4^{-m}$ (that of a uniform cubic at a knot
# is the second difference itself, in units of the spacing). So the gap is
# $\frac{4^{-m}}6 (X_{uu} + X_{vv}) + O(16^{-m})$: order 2, unless the sum vanishes.

# %%
grid = [symbols(f"p{i}_:3") for i in range(3)]
mask = [Rational(w, 6) for w in (1, 4, 1)]
difference = [1, -2, 1]


def masked(along, across):
    return sum(along[i] * across[j] * grid[i][j] for i in range(3) for j in range(3))


one = [0, 1, 0]
limit = masked(mask, mask)
parts = masked(difference, one) / 6 + masked(one, difference) / 6
parts += masked(difference, difference) / 36
assert expand(limit - grid[1][1] - parts) == 0

# %% [markdown]
# ## 2. Next to an extraordinary vertex
#
# By the halving identity, in a patch with control points $C = \sum_k V_k c_k$, the neighbour $e_0$
# of the vertex after $m$ refinements is $\sum_k \lambda_k^m V_k(e_0)\, c_k$, at the place
# $(2^{-m}, 0)$, where the surface is $\sum_k \lambda_k^m \varphi_k(1, 0)\, c_k$. So
#
# $$ \text{gap} = \sum_k \lambda_k^m\, \big( V_k(e_0) - \varphi_k(1, 0) \big)\, c_k ; $$
#
# for the constant vector the bracket is 0; of the others $\lambda$ leads, if its bracket is not
# zero. As $e_0$ is a regular vertex, $\varphi(1, 0)$ is its limit by the mask of section 1, on the
# places $(1 \ldots 3) \times (0 \ldots 2)$ of the face. For the cosine wave of frequency 1 all of
# this is rational in $\tau$ (eigenvectors and parameter as in [scaling](scaling.py), parts 1 and
# 2). The bracket has the factor $\tau^2 - 2$, which vanishes at $N = 4$, and no other zero between
# $5/4$ and $13/8$: the gap is of the order of $\lambda^m$ for every $N \ge 3$ but 4.

# %%
RATIONAL, T = field("tau", QQ)
LINES = [{0: 4, 1: 4}, {0: 1, 1: 6, 2: 1}, {1: 4, 2: 4}, {1: 1, 2: 6, 3: 1}]
OUTER = [(3, 0), (3, 1), (3, 2), (3, 3), (2, 3), (1, 3), (0, 3)]


def insertion(place):
    first, second = (LINES[line] for line in place)
    return {(i, j): QQ(a * b, 64) for i, a in first.items() for j, b in second.items()}


def with_outer(ring, value):
    """The eigenvector of the whole matrix that a vector on the ring gives."""
    rows = [insertion(place) for place in OUTER]
    block = [
        [value * (old == place) - row.get(old, 0) for old in OUTER]
        for place, row in zip(OUTER, rows, strict=True)
    ]
    brought = [[sum(row[old] * ring[old] for old in row if old in ring)] for row in rows]
    domain = RATIONAL.to_domain()
    outer = DomainMatrix(block, (7, 7), domain).lu_solve(DomainMatrix(brought, (7, 1), domain))
    return ring | {place: found for place, (found,) in zip(OUTER, outer.to_list(), strict=True)}


S = T - 1 / T
E, F, once, thrice = T**2 - 1, 2 * S, 2 * S**2 - 1, 4 * S**3 - 3 * S
cosine = {(1, 1): T - T, (2, 1): E * S, (2, 2): F, (1, 2): E * S}
cosine |= {(0, 2): F * once, (0, 1): E * thrice, (1, 0): E * thrice, (2, 0): F * once}
vector = with_outer(cosine, T**2 / 4)
weights = [QQ(1, 6), QQ(4, 6), QQ(1, 6)]
value = sum(weights[i] * weights[j] * vector[1 + i, j] for i in range(3) for j in range(3))
gap = vector[2, 1] - value
tau = symbols("tau")
numerator, denominator = (Poly(part.as_expr(tau), tau) for part in (gap.numer, gap.denom))
assert Poly(tau**2 - 2, tau) in [found for found, _ in factor_list(numerator)[1]]
rest = numerator.quo(Poly(tau**2 - 2, tau))
for polynomial in (rest, denominator):
    assert polynomial.count_roots(Rational(5, 4), Rational(13, 8)) == 0

# %% [markdown]
# **The largest gap.** Vertices at a distance of $2^{-k}$ from the extraordinary one, $k \le m$,
# have been regular for $m - k$ refinements. By halving $k$ times and section 1 their gap is
# $O(\lambda^k\, 4^{-(m - k)})$. As $\lambda > 2/5 > 1/4$, this is largest at $k = m$, next to the
# vertex: so the largest gap of all is of the order of $\lambda^m$.
#
# The observed order is therefore $\log_2 (1 / \lambda)$: 1.29 at $N = 3$, 0.86 at $N = 5$, and 0.61
# in the limit of many faces. At $N = 4$ it is 2.

# %%
mp.dps = 60


def eigenvalue(cosine):
    return (cosine + root(4 + cosine**2)) ** 2 / 16


for cosine_, digits in ((cospi(mpf(1) / 3), "1.29"), (cospi(mpf(1) / 5), "0.86"), (1, "0.61")):
    assert abs(log(1 / eigenvalue(cosine_), 2) - mpf(digits)) < mpf("0.005")

# %% [markdown]
# ## 3. The extraordinary vertex itself
#
# There $\varphi_k = 0$ for all but the constant, and $V_k$ is zero at the vertex for all waves of
# positive frequency. So its gap is $\mu_0^m$ times a constant (and a smaller term), with the larger
# root $\mu_0$ of frequency 0: $1/6$ at $N = 3$, an order of 2.58; $0.322$ at $N = 5$, an order of
# 1.63. It comes faster than its neighbours.
#
# ## 4. Distance from the surface as a set
#
# The gap of order $\lambda^m$ is a combination of the two coefficients that span the tangent plane:
# a shift within it. In the coordinates of [scaling](scaling.py), part 6, a vertex next to the
# extraordinary one is at $(\xi, \eta, \zeta)$ of sizes $\lambda^m, \lambda^m, \mu^m$, and the
# surface is the graph $\zeta = \mu^m h(\xi / \lambda^m, \eta / \lambda^m)$. So the vertex is off
# the surface by $O(\mu^m)$, $\mu$ the next eigenvalue: $1/6$ at $N = 3$, $0.340$ at $N = 5$. What
# is slow is the parametrisation of the net, not its shape.
#
# At boundaries, creases, corners, cones and darts $\lambda_1$ takes the place of $\lambda$ as an
# upper bound, times $m$ in a Jordan block ([sectors](sectors.py)).
#
# ## 5. By brute force
#
# Refined control points without a pattern, by the library's rows: the gap of $e_0$, which must have
# the quotient $\lambda$, of the vertex ($\mu_0$), and the component of the gap of $e_0$ along the
# limit normal ($\mu$), after 400 steps, for $N = 3, 5, 7$. (At $N = 8$ the wave of frequency 2 has
# the eigenvalue 1/2, and its bracket is 0, as that of $\lambda$ is at $N = 4$.)


# %%
def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def tangent(ring, n, turn):
    """Limit of a tangent (limit_masks.py)."""
    once = cospi(mpf(2) / n)
    big = 1 + once + cospi(mpf(1) / n) * root(2 * (9 + once))
    turns = [cospi(mpf(2 * (j - turn)) / n) for j in range(n + 1)]
    total = zeros(1, 3)
    for j in range(n):
        total += big * turns[j] * ring[1 + 2 * j] + (turns[j] + turns[j + 1]) * ring[2 + 2 * j]
    return total


mp.dps = 400
for valence, next_one in ((3, mpf(1) / 6), (5, None), (7, None)):
    sector = Sector("interior", valence)
    built, at = subdivision_matrix(CATMULL_CLARK, sector), grid_index(sector)
    A = zeros(built.size, built.size)
    for i in range(built.size):
        for k, weight in built.rows[i].items():
            A[i, k] = mpf(weight.numerator) / weight.denominator
    C = mp_matrix([[7 * k * k % 11, (3 * k + 5) % 7, k**3 % 13] for k in range(built.size)])
    ring = [C[k, :] for k in range(2 * valence + 1)]
    centre = valence**2 * ring[0] + sum((4 * e for e in ring[1::2]), zeros(1, 3))
    centre = (centre + sum(ring[2::2], zeros(1, 3))) / (valence * (valence + 5))
    normal = cross(*(tangent(ring, valence, turn) for turn in (0, 1)))
    C = A**400 * C
    gaps, own = [], []
    for _ in range(2):
        point = zeros(1, 3)
        for i in range(3):
            for j in range(3):
                weight = mpf((1, 4, 1)[i] * (1, 4, 1)[j]) / 36
                point += weight * C[at[1 + i, j], :]
        gaps.append(C[at[2, 1], :] - point)
        own.append(C[0, :] - centre)
        C = A * C
    lam = eigenvalue(cospi(mpf(1) / valence))
    mu = next_one or eigenvalue(cospi(mpf(2) / valence))
    n = mpf(valence)
    mu_0 = (3 * n - 7 + root(49 - 30 * n + 5 * n * n)) / (8 * n)
    assert abs(gaps[1][0] / gaps[0][0] / lam - 1) < 1e-8
    assert abs(own[1][0] / own[0][0] / mu_0 - 1) < 1e-8
    heights = [sum(x * y for x, y in zip(gap_, normal, strict=True)) for gap_ in gaps]
    assert abs(heights[1] / heights[0] / mu - 1) < 1e-8
