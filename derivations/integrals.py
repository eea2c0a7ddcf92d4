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
"""Integrals over limit surfaces: moments of bodies, sums over rings, and their tails.

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Integrals
#
# Around a special corner a limit face is infinitely many rings of polynomial pieces, whose control
# points are $P A^n C$ ([eigenfunctions](eigenfunctions.py)). This document derives
#
# 1. moments of a body as integrals of polynomials over its surface;
# 2. their sum over all rings from the first ones, without an eigenvalue;
# 3. how fast rings fall, for areas and for second derivatives;
# 4. weights of the last rings that stand for all beyond.
#
# - L. F. Richardson, "The approximate arithmetical solution by finite differences of physical
#   problems involving differential equations", Phil. Trans. R. Soc. A 210, 1911: elimination of
#   known powers.

# %%
from fractions import Fraction
from math import comb, prod

import numpy as np
from sympy import Matrix, Rational, diff, eye, integrate, kronecker_product, simplify, symbols

from limitsurf import tables
from limitsurf.integrals.rational import annihilator, ring_weights
from limitsurf.integrals.tails import ratios, tail
from limitsurf.scheme.catmull_clark import CATMULL_CLARK
from limitsurf.scheme.loop import LOOP

# %% [markdown]
# ## 1. Moments of a body
#
# A function $f$ that is homogeneous of degree $d$ has $\nabla \cdot (x f) = (3 + d) f$. So the
# integral of $f$ over a body is that of $f\, x \cdot n / (3 + d)$ over its surface, and with
# $w = x \cdot (x_s \times x_t)$ volume, first and second moments are
#
# $$\frac13 \int w, \qquad \frac14 \int x\, w, \qquad \frac15 \int x x^\top w.$$
#
# On positions of degree $d$ in each parameter, a product of $k$ of them of which one is derived by
# $s$ has degree $k d - 1$ in $s$: Gauss rules of $\lceil k d / 2 \rceil$ points have it exactly. On
# triangles both derivatives lower the total degree, and the Jacobian of the blow-up adds one.

# %%
x, y, z = symbols("x y z")
for f, degree in ((1, 0), (x, 1), (x * y, 2)):
    assert simplify(sum(diff(f * a, a) for a in (x, y, z)) - (3 + degree) * f) == 0
s, t = symbols("s t")
corner = [Matrix(p) for p in ((0, 0, 0), (1, 0, 0), (0, 2, 0), (0, 0, 3))]
found = [0, 0]
for i, j, k in ((0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)):
    place = corner[i] + s * (corner[j] - corner[i]) + t * (corner[k] - corner[i])
    w = place.dot(place.diff(s).cross(place.diff(t)))
    for order, g in enumerate((w / 3, place[0] * w / 4)):
        found[order] += integrate(g, (t, 0, 1 - s), (s, 0, 1))
assert found == [1, Rational(1, 4)]

# %% [markdown]
# ## 2. All rings from the first ones
#
# Relative to the limit of the corner the control points are $A^n y$. Let $c$ be the minimal
# polynomial of $A$ there, reversed, so that $c(z)$ is the product of $1 - l z$ over eigenvalues
# $l$, multiple ones where there are Jordan blocks. An integral $F_n$ of degree $p$ in the control
# points is linear in the symmetric power of order $p$ of its companion matrix, to the power $n$; by
# Cayley and Hamilton it satisfies the recurrence of $q(z) = \prod (1 - r z)$ over all products $r$
# of $p$ eigenvalues, $M = \binom{\deg c + p - 1}{p}$ of them. So $q(z) \sum F_n z^n$ is a
# polynomial of degree below $M$, and at $z = 1$
#
# $$\sum_{n = 0}^\infty F_n = \sum_{n < M} F_n \, \frac{q_0 + \dots + q_{M - 1 - n}}{q(1)}.$$
#
# Sums of powers of the products come from those of the eigenvalues (complete symmetric
# polynomials), and $q$ from these (Newton's identities): all rational. It is the solution of the
# Stein equation $S = y^{\otimes p} + A^{\otimes p} S$, here for a Jordan block.

# %%
block = Matrix([[Rational(1, 2), 1], [0, Rational(1, 2)]])
start = Matrix([1, 3])
total = (eye(8) - kronecker_product(block, block, block)).inv() * kronecker_product(
    start, start, start
)


def weights_of(roots: list[Fraction], degree: int) -> list[Fraction]:
    """Weights of the first rings, from the products themselves."""
    products = [Fraction(1)]
    for combination in _combinations(roots, degree):
        r = prod(combination, start=Fraction(1))
        products = [a - r * b for a, b in zip([*products, 0], [0, *products], strict=True)]
    size, whole = len(products) - 1, sum(products)
    return [sum(products[: size - n], start=Fraction(0)) / whole for n in range(size)]


def _combinations(roots: list[Fraction], degree: int) -> list[tuple[Fraction, ...]]:
    from itertools import combinations_with_replacement

    return list(combinations_with_replacement(roots, degree))


half = Fraction(1, 2)
sums = [0] * 8
for n, weight in enumerate(weights_of([half, half], 3)):
    ring = block**n * start
    power = kronecker_product(ring, ring, ring)
    sums = [
        a + Rational(weight.numerator, weight.denominator) * b
        for a, b in zip(sums, power, strict=True)
    ]
assert Matrix(sums) == total

# %% [markdown]
# Loop's scheme at valence 3 has the eigenvalues 1/4, 1/8 and 1/16, the last one in a Jordan block.
# Weights are exact for powers of products of two.

# %%
table = tables.rational_table(LOOP, LOOP.sector("interior", 3))
reversed_polynomial, first = annihilator(table)
assert first == 0
for r in (4, 8, 16):
    assert sum(c * r**k for k, c in enumerate(reversed_polynomial)) == 0
assert sum(k * c * 16 ** (k - 1) for k, c in enumerate(reversed_polynomial)) == 0
assert len(ring_weights(table, 3)) == comb(len(reversed_polynomial) + 1, 3)
for r in (Fraction(1, 16), Fraction(1, 64), Fraction(1, 4) * Fraction(1, 16)):
    seen = sum(w * r**n for n, w in enumerate(ring_weights(table, 2)))
    assert seen == 1 / (1 - r)

# %% [markdown]
# ## 3. How fast rings fall
#
# With $x = \sum_k l_k^n \phi_k m_k$ on ring $n$, normals are sums of $(l_i l_j)^n$, $i < j$. The
# largest is $(\lambda_1 \lambda_2)^n$, and the area element is that times a power series in the
# quotients of the others by it. Second derivatives on the surface are those of the function that
# the surface is over its tangent plane, in coordinates $\lambda^n (\xi, \eta)$, of the order of
# $\mu^n / \lambda^{2n}$ with the largest other eigenvalue. Their squares times the area fall as
# $(\mu / \lambda)^{2n}$.

# %%
for valence, area, bent in ((3, 0.1681, 0.1653), (5, 0.3025, 0.3821), (8, 0.3733, 0.6689)):
    eigen = tables.eigen_table(CATMULL_CLARK, CATMULL_CLARK.sector("interior", valence))
    a, b, m = np.abs(eigen.rates[0, 1:4])
    for kind, expected, formula in (("metric", area, a * b), ("curvature", bent, (m / a) ** 2)):
        assert np.isclose(ratios(eigen, kind)[0], formula)
        assert abs(formula - expected) < 1e-3

# %% [markdown]
# ## 4. Tails
#
# If $F_n = \sum_i c_i r_i^n$, rings from $R$ on add up to $\sum_i c_i r_i^R / (1 - r_i)$. Weights
# $v_j$ of the rings $R - K + j$, $0 \le j < K$, give that for $K$ of the ratios if
#
# $$\sum_j v_j r^j = \frac{r^K}{1 - r},$$
#
# which has one solution, for powers of different numbers are independent (Vandermonde). Another
# ratio $r$ leaves $r^{R - K} (r^K / (1 - r) - \sum_j v_j r^j)$.

# %%
eigen = tables.eigen_table(CATMULL_CLARK, CATMULL_CLARK.sector("interior", 5))
made = tail(eigen, "metric", 1e-12)
count = len(made.factors)
for r in ratios(eigen, "metric"):
    error = abs(made.factors @ r ** np.arange(count) * (1 - r) - 1)
    assert error < made.accuracy + 1e-15
assert made.accuracy <= 1e-12
