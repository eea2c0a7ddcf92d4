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
"""Rays: cells that are hit once at most, double roots, and what crossings say of the inside.

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Rays
#
# A ray $p + t d$ meets a [Bezier patch](pieces.py) $x(s, t)$ where two linear functions vanish that
# vanish on the ray. Let $d_3$ be the largest coordinate of $d$. The shear
#
# $$ X = x_1 - p_1 - \frac{d_1}{d_3} (x_3 - p_3), \qquad
#    Y = x_2 - p_2 - \frac{d_2}{d_3} (x_3 - p_3) $$
#
# takes the ray to $X = Y = 0$, and coefficients to coefficients: $F = (X, Y)$ is a map of two
# parameters to two coordinates, in Bernstein form as $x$ is, of which the zeros are sought. This
# document derives
#
# 1. when a cell has one zero at most, and that Newton's method then finds it or says there is none;
# 2. what a double root is, and to what accuracy it is known;
# 3. why crossings with any one direction say how often a closed surface goes around a point.
#
# - R. Krawczyk, "Newton-Algorithmen zur Bestimmung von Nullstellen mit Fehlerschranken", Computing
#   4, 1969: Newton's method where derivatives are near one matrix.
# - J. Milnor, "Topology from the Differentiable Viewpoint", 1965: degrees.

# %%
import numpy as np
from sympy import Matrix, Rational, diff, simplify, solve, sqrt, symbols

from limitsurf.query.crossings import NEAR, SLACK
from limitsurf.query.polynomials import Form
from limitsurf.scheme.lattice import QUADS, TRIANGLES

p, d, x = (Matrix(symbols(f"{name}1:4")) for name in "pdx")
k = symbols("k")
plane = [x[i] - p[i] - d[i] / d[2] * (x[2] - p[2]) for i in (0, 1)]
for f in plane:
    assert simplify(f.subs(dict(zip(x, p + k * d, strict=True)))) == 0

# %% [markdown]
# ## 1. One zero
#
# Let $J$ be the derivative of $F$, multiplied by the inverse of its mean so that it is near the
# identity, and $\lvert J - I \rvert \le \rho$ on the whole domain, which is convex. For two places
# $a, b$ the mean $\bar J$ of $J$ on the way from one to the other is as near, and
# $F(b) - F(a) = \bar J (b - a)$. So
#
# $$ \lvert F(b) - F(a) - (b - a) \rvert \le \rho \lvert b - a \rvert : $$
#
# for $\rho < 1$ no two places have the same value. Let $b$ be the zero. A step of Newton's method
# from $a$ ends at $a - J(a)^{-1} F(a)$, and what it is off is
#
# $$ b - a + J(a)^{-1} F(a) = J(a)^{-1} (J(a) - \bar J) (b - a), $$
#
# at most $2 \rho / (1 - \rho)$ times what it was before. The nearest place of the domain is no
# farther from $b$. So for $\rho < 1/3$ the method comes to $b$ from anywhere in the domain though
# it is kept inside, faster and faster; where it ends at no zero there is none.

# %%
rho = Rational(NEAR).limit_denominator(100)
assert 2 * rho / (1 - rho) < 1

# %% [markdown]
# The square of the Frobenius norm is a convex function of a matrix. $F_s$ and $F_t$ are in the
# hulls of their coefficients, so the largest of $\lvert F_s - e_1 \rvert^2$ at the coefficients of
# $F_s$ and the same of $F_t$ sum to a bound of $\rho^2$. Halving a cell halves what derivatives
# differ by, so that every zero at which $J$ is regular lies in such a cell in the end.

# %%
rng = np.random.default_rng(0)
for lattice, degree in ((QUADS, 3), (TRIANGLES, 4)):
    form = Form.of(lattice, degree)
    places = rng.random((200, 2))
    if lattice is TRIANGLES:
        places = np.where(places.sum(axis=1, keepdims=True) > 1, 1 - places, places)
    values = form.values(*places.T, 1)
    for _ in range(200):
        size = 0.02 * rng.random()
        net = form.exponents / degree - rng.random(2) + size * rng.normal(size=(form.size, 2))
        slopes = form.derivatives[1:3] @ net - np.eye(2)[:, None]
        bound = (slopes**2).sum(axis=2).max(axis=1).sum()
        own = values @ net
        assert ((own[:, 1:] - np.eye(2)) ** 2).sum(axis=(1, 2)).max() <= bound + 1e-12
        if bound > NEAR**2:
            continue
        gap, far = own[1:, 0] - own[:-1, 0], places[1:] - places[:-1]
        lengths = [np.sqrt((y**2).sum(axis=1)) for y in (gap - far, far)]
        assert (lengths[0] <= np.sqrt(bound) * lengths[1] + 1e-12).all()

# %% [markdown]
# Two other tests say sooner that a cell has no zero: all coefficients of $X$, of $Y$, or of a
# combination of both, are on one side of zero.
#
# ## 2. Double roots
#
# Where a ray touches a surface $J$ is singular. Let the surface be $z = \kappa y^2 / 2$ beside the
# ray $z = h$ along $y$. The roots $y = \pm \sqrt{2 h / \kappa}$ come together and vanish as $h$
# falls through zero: one place stands for two hits, of which one enters and one leaves, and a small
# motion of the ray makes it two or none. It is reported once, with multiplicity 2. Rounding moves
# rays by up to $\delta$, so the place of such a root is known to $\sqrt{2 \delta / \kappa}$ alone,
# and roots that are nearer to each other than twice that are not told apart.

# %%
y, h, kappa = symbols("y h kappa", positive=True)
roots = solve(kappa * y**2 / 2 - h, y)
assert roots == [sqrt(2) * sqrt(h) / sqrt(kappa)]
assert diff(kappa * y**2 / 2, y).subs(y, 0) == 0
assert np.sqrt(2 * SLACK) < 2.0**-16

# %% [markdown]
# On an edge of two faces, or at a vertex, hits with both sides are one such root.
#
# ## 3. Inside
#
# Let $q$ be a point beside a closed surface with consistent orientation. The directions
# $(x - q) / \lvert x - q \rvert$ map the surface to the sphere, and so many times as it covers the
# sphere, that map's *degree*, the surface goes around $q$. It can be counted at any direction $d$
# that is no value where the map is singular: each place with this direction, a crossing of the ray
# from $q$, counts $+1$ or $-1$ by whether orientation is kept, as the surface is seen from behind
# or from the front there. The count does not depend on $d$: on the way from one direction to
# another crossings move, and where they come or go they do so in pairs of both signs, at
# silhouettes, the double roots of 2; what passes over an edge goes from one face to the next, as
# every edge is passed once each way. At an edge, at a silhouette or a pole the sign is in doubt by
# rounding. Such directions are few, and another one has the same count: so it is taken.
#
# The sign is that of the determinant of the direction and both derivatives, which the shear leaves
# as it is but for the sign of $d_3$:

# %%
du, dv = (Matrix(symbols(f"{name}1:4")) for name in "uv")
slope = [d[i] / d[2] for i in (0, 1)]
two = Matrix([[w[i] - slope[i] * w[2] for i in (0, 1)] for w in (du, dv)])
assert simplify(Matrix.hstack(d, du, dv).det() - d[2] * two.det()) == 0

# %% [markdown]
# Triangulated balls that overlap themselves say the same: crossings of any direction sum to the
# solid angles of all triangles over $4 \pi$ (A. van Oosterom, J. Strackee 1983), a whole number.

# %%
octahedron = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
faces = [[a, b, 4] for a, b in ((0, 2), (2, 1), (1, 3), (3, 0))]
faces += [[b, a, 5] for a, b, _ in faces]
counts = set()
for _ in range(200):
    points = octahedron + rng.normal(size=(6, 3))
    a, b, c = (points[np.array(faces)] - 0.3 * rng.normal(size=3)).swapaxes(0, 1)
    volume = (a * np.cross(b, c)).sum(axis=1)
    la, lb, lc = (np.sqrt((z**2).sum(axis=1)) for z in (a, b, c))
    below = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    turns = np.arctan2(volume, below).sum() / (2 * np.pi)
    for way in rng.normal(size=(4, 3)):
        inside = np.stack([np.cross(i, j) @ way for i, j in ((a, b), (b, c), (c, a))])
        front, back = (inside > 0).all(axis=0), (inside < 0).all(axis=0)
        ahead = np.where(front | back, volume * np.sign(inside[0]) > 0, False)
        assert abs(front[ahead].sum() - back[ahead].sum() - turns) < 1e-9
    counts.add(round(turns))
assert {-1, 0, 1} <= counts
