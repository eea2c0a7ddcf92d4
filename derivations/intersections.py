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
"""Where two surfaces meet: cones of normals that are apart, and slices.

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Where two surfaces meet
#
# Cells of two surfaces are parted in pairs until the curve in which a pair meets is a graph over
# one direction. This document derives
#
# 1. how far the normals of a cell are from one of them;
# 2. when there is no loop in a pair, and each plane across a direction meets the curve once;
# 3. why curves are whole then.
#
# - T. W. Sederberg and R. J. Meyers, "Loop detection in surface patch intersections", Computer
#   Aided Geometric Design 5 (1988), 161-171: if no normal of one patch is parallel to one of the
#   other there is no closed loop.

# %%
import numpy as np
from sympy import Matrix, cos, simplify, symbols

rng = np.random.default_rng(1)

# %% [markdown]
# ## 1. Normals of a cell
#
# Let $m_s, m_t$ be the means of the coefficients of $x_s$ and $x_t$, $n$ the unit normal of their
# plane, and $D$ the $2 \times 3$ matrix of vectors in it with $D (m_s, m_t) = 1$. In the
# coordinates $D x$, the rows of $A = (D x_s, D x_t)$ are off those of the identity by
# $\epsilon_s$ and $\epsilon_t$ at most, and $x_s \cdot n$, $x_t \cdot n$ are $z_s$ and $z_t$ at
# most in size: all are at most what coefficients say, as means of these. If $\epsilon^2 =
# \epsilon_s^2 + \epsilon_t^2 < 1$, $A$ has an inverse of norm $1 / (1 - \epsilon)$ at most; so
# the cell is a graph over its plane, over a convex domain of $(s, t)$ once (the map to $D x$ is
# off the identity by less than a contraction), and the gradient of this graph in the coordinates
# is $A^{-1}$ times $(x_s \cdot n, x_t \cdot n)$. Lengths change by $\lVert D \rVert$, at most its
# Frobenius norm. The angle $\alpha$ between $n$ and any normal of the cell has the gradient as
# its tangent:
#
# $$\tan \alpha \le \lVert D \rVert_F \, \sqrt{z_s^2 + z_t^2} / (1 - \epsilon).$$

# %%
for _ in range(200):
    means = rng.normal(size=(2, 3))
    normal = np.cross(*means)
    normal /= np.linalg.norm(normal)
    dual = np.linalg.solve(means @ means.T, means)
    assert np.allclose(dual @ means.T, np.eye(2))
    found = means + 0.1 * rng.normal(size=(50, 2, 3))  # derivatives at 50 places
    along = found @ dual.T - np.eye(2)
    bend = np.sqrt((along**2).sum(axis=2).max(axis=0).sum())
    if bend >= 1:
        continue
    rise = np.sqrt((np.abs(found @ normal).max(axis=0) ** 2).sum())
    most = np.linalg.norm(dual) * rise / (1 - bend)
    other = np.cross(found[:, 0], found[:, 1])
    across = np.linalg.norm(np.cross(other, normal), axis=1)
    assert (across <= most * (other @ normal) * (1 + 1e-12)).all()

# %% [markdown]
# ## 2. No loop
#
# Let the normals of one cell be within $\alpha$ of a unit vector $n$, those of the other within
# $\beta$ of $m$, and the lines of $n$ and $m$ have the angle $\theta \le \pi / 2$. A curve in
# which they meet has the tangent $n' \times m'$, and by Lagrange's identity
#
# $$(n' \times m') \cdot (n \times m) = (n' \cdot n)(m' \cdot m) - (n' \cdot m)(m' \cdot n).$$
#
# The first product is $\cos \alpha \cos \beta$ at least, the second $\cos(\theta - \alpha)
# \cos(\theta - \beta)$ at most in size. If $\alpha + \beta < \theta$, then $\beta < \theta -
# \alpha$ and $\alpha < \theta - \beta$, so the first is larger: all tangents go one way along $n
# \times m$, and a curve that comes back to where it began does not exist.
#
# A plane across $d = n \times m$ meets this curve once at most. For let $p$ and $q$ be places of
# both cells in such a plane. By section 1 the step between any two places of a cell, not only a
# small one, is within $\alpha$ of the plane across $n$: along $n$ it is $\lvert z \rvert \,
# \lvert \Delta (s, t) \rvert$ at most, and $\lvert \Delta (s, t) \rvert \le \lvert \Delta D x
# \rvert / (1 - \epsilon)$, as the domain of $(s, t)$ is convex. So $q - p$, which is across $d$,
# is within $\alpha$ of the line across $n$ and $d$, and within $\beta$ of that across $m$ and
# $d$. But these have the angle $\theta > \alpha + \beta$.

# %%
vectors = [Matrix(symbols(f"{name}:3")) for name in "abcd"]
a, b, c, d = vectors
lagrange = a.cross(b).dot(c.cross(d)) - (a.dot(c) * b.dot(d) - a.dot(d) * b.dot(c))
assert simplify(lagrange.expand()) == 0

# the sign, at the least favourable normals: in the plane of n and m
theta, alpha, beta = symbols("theta alpha beta", positive=True)
least = cos(alpha) * cos(beta) - cos(theta - alpha) * cos(theta - beta)
assert simplify(least.subs(beta, theta - alpha)) == 0  # none is left where cones touch


def within(axis, angle, count):
    """Unit vectors at most so far from an axis."""
    off = np.cross(axis, rng.normal(size=(count, 3)))
    off /= np.linalg.norm(off, axis=1)[:, None]
    turn = angle * rng.random((count, 1))
    return np.cos(turn) * axis + np.sin(turn) * off


for _ in range(200):
    n, m = rng.normal(size=(2, 3))
    n, m = n / np.linalg.norm(n), m / np.linalg.norm(m)
    between = np.arccos(abs(n @ m))
    share = rng.random()
    one = within(n, share * between * 0.999, 100)
    two = within(m, (1 - share) * between * 0.999, 100)
    assert (np.cross(one[:, None], two) @ np.cross(n, m) > 0).all()
    # a step across d is not near both planes: near that across n it is far from that across m
    way = np.cross(n, m) / np.linalg.norm(np.cross(n, m))
    turns = np.linspace(0, np.pi, 500)[:, None]
    step = np.cos(turns) * n + np.sin(turns) * np.cross(way, n)
    near = np.abs(step @ n) <= np.sin(share * between)
    assert (np.abs(step @ m)[near] >= np.sin((1 - share) * between) - 1e-9).all()

# %% [markdown]
# ## 3. Whole curves
#
# So each part of a curve in a pair begins and ends on a side of one of both cells. Places where a
# side $c(x)$ meets the other cell $y(s, t)$ are zeros of $c(x) - y(s, t)$: in the unit of mean
# derivatives its Jacobian is the identity but for $\epsilon$, and where $\epsilon < 1$ there is
# one zero at most, as differences $F(p) - F(q)$ are off $p - q$ by less than their size. What is
# not so is halved. Places in the order of $d$ part the curve; of two that are next to each other,
# the plane half way between either meets the curve inside both cells, and the curve joins them,
# or it does not. Between them no side is crossed, so one plane tells for all.
#
# Cells beside each other both have what runs along their common side: it is taken once. Places
# are told apart by distances larger than rounding, and so are places beside sides from those on
# them.

# %%
for _ in range(200):
    # F = p + g with a Jacobian of g that is 0.9 at most: F does not take a value twice
    slope = rng.normal(size=(3, 3))
    slope *= 0.9 / np.linalg.norm(slope)
    p, q = rng.normal(size=(2, 3))
    image = p - q + slope @ (np.sin(p) - np.sin(q))
    assert np.linalg.norm(image) >= (1 - 0.9) * np.linalg.norm(p - q) * (1 - 1e-12)
