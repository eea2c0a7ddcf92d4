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
"""Closest points: squared distances in Bernstein form, cells of one foot, and sides.

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Closest points
#
# On a [Bezier patch](pieces.py) $x(s, t)$ the squared distance $D = \lvert x - q \rvert^2$ from a
# point $q$ is a polynomial. This document derives
#
# 1. its Bernstein coefficients, and that the least of them bounds it from below;
# 2. when a cell has its foot on a side, or one foot at all;
# 3. on which side of a closed surface a point is, by its foot;
# 4. what compiled kernels decide, 5. why feet in slivers are moved once more, and 6. when a foot
#    says by itself that nothing in its cell is nearer.
#
# - G. Farin, "Curves and Surfaces for CAGD", 5th edition, 2002: Bernstein polynomials, hulls.
# - J. A. Baerentzen, H. Aanaes, "Signed distance computation using the angle weighted
#   pseudonormal", IEEE Transactions on Visualization and Computer Graphics 11, 2005.

# %%
from itertools import product
from math import factorial

import numpy as np
from sympy import Poly, Rational, binomial, symbols

from limitsurf.query.polynomials import Form, products
from limitsurf.scheme.lattice import QUADS, TRIANGLES

s, t = symbols("s t")


def bernstein(lattice, degree):
    """Bernstein polynomials by their exponents."""
    found = {}
    for i, j in Form.of(lattice, degree).exponents.tolist():
        if lattice is QUADS:
            count = binomial(degree, i) * binomial(degree, j)
            rest = (1 - s) ** (degree - i) * (1 - t) ** (degree - j)
        else:
            k = degree - i - j
            count = Rational(factorial(degree), factorial(i) * factorial(j) * factorial(k))
            rest = (1 - s - t) ** k
        found[i, j] = count * s**i * t**j * rest
    return found


# %% [markdown]
# ## 1. Squared distances
#
# With $B_a$ of degree $d$ the product $B_a B_b$ is a multiple $w_a w_b / w_{a + b}$ of the one
# polynomial of degree $2 d$ that has the same powers, where $w$ are the integers that they begin
# with. So coefficient $c$ of $D$ is the sum of these multiples of $(x_a - q) \cdot (x_b - q)$ over
# $a + b = c$. They are positive, and sum to one, as $1 \cdot 1 = 1$ says: a mean. On the domain all
# $B_c \ge 0$ sum to one, and $D$ is nowhere less than its least coefficient. At corners of the
# domain coefficients are values.

# %%
for lattice, degree in ((QUADS, 2), (TRIANGLES, 2)):
    one, twice = bernstein(lattice, degree), bernstein(lattice, 2 * degree)
    means = products(lattice, degree).reshape(len(one), len(one), len(twice))
    for (m, a), (n, b) in product(enumerate(one), enumerate(one)):
        c = (a[0] + b[0], a[1] + b[1])
        k = list(twice).index(c)
        share = Poly(one[a] * one[b], s, t).coeff_monomial(s ** c[0] * t ** c[1])
        share /= Poly(twice[c], s, t).coeff_monomial(s ** c[0] * t ** c[1])
        assert Poly(one[a] * one[b] - share * twice[c], s, t).is_zero
        assert abs(means[m, n, k] - share) < 1e-15
        assert np.count_nonzero(means[m, n]) == 1
for lattice, degree in ((QUADS, 3), (TRIANGLES, 4)):
    means = products(lattice, degree)
    assert (means >= 0).all()
    assert np.allclose(means.sum(axis=0), 1, rtol=0, atol=1e-15)

# %% [markdown]
# Relative to a point $x_0$ of the cell, with $y = x - x_0$ and $w = x_0 - q$, it is
# $D = \lvert w \rvert^2 + y \cdot (y + 2 w)$: what tells places of a small cell apart is not
# swamped by how far the cell is. Rounding of $D$ is of the order of $\epsilon$ times the size of
# the cell squared, so that a distance of its root, $10^{-8}$ of the size, is lost in it:
# coefficients decide only of cells that are at least a quarter of their size away, and Newton's
# method, on $x$ itself, of those that are nearer.
#
# ## 2. One foot
#
# Derivatives have coefficients of the same degree, by integers. If those of a derivative along a
# direction into the domain are nowhere negative, $D$ does not fall on the way in from that side:
# it is least on the side. If those of $D_{ss}$ and $D_{tt}$ are at least $a, c > 0$, and those of
# $D_{st}$ at most $b$ in size with $b^2 < a c$, then $D_{ss} D_{tt} > D_{st}^2$ on the whole
# domain: $D$ is convex, and has one least place there, inside or on its sides.

# %%
for lattice, degree in ((QUADS, 2), (QUADS, 3), (TRIANGLES, 3), (TRIANGLES, 4)):
    basis, form = list(bernstein(lattice, degree).values()), Form.of(lattice, degree)
    assert (form.derivatives == np.round(form.derivatives)).all()
    for matrix, variable in zip(form.derivatives[1:3], (s, t), strict=True):
        for column, polynomial in enumerate(basis):
            found = sum(int(x) * y for x, y in zip(matrix[:, column], basis, strict=True))
            assert Poly(found - polynomial.diff(variable), s, t).is_zero

# %% [markdown]
# ## 3. Sides
#
# Let $p$ be the foot of $q$ on a closed surface. Inside a face $q - p$ is along the normal, and its
# sign tells the side. At a vertex let the surface be a cone near by, of triangles with unit
# normals $n_i$ and angles $\alpha_i$ at $p$, and $V$ what is inside of it in a small ball of radius
# $r$. The integral of the constant vector field $q - p$ over the boundary of $V$ is zero. Its flat
# part is $\frac{r^2}{2} \sum \alpha_i n_i \cdot (q - p)$. Its round part is the integral of
# $q - p$ times the outward direction. If $q$ is outside, no direction of $V$ comes nearer to it
# than $p$: none has a positive product with $q - p$, the round part is negative, and
# $\sum \alpha_i n_i$ has a positive product. Inside, the same holds of what is outside, with all
# signs turned. On an edge both angles are $\pi$, and the sum of both normals does.

# %%
generator = np.random.default_rng(0)
tried = 0
for _ in range(300):
    # a cone over a polygon, up and down; a direction with which no way out of it has an acute angle
    turns = np.sort(generator.uniform(0, 2 * np.pi, 5))
    heights = generator.uniform(-0.3, 1.5, 5)
    arms = np.stack([np.cos(turns), np.sin(turns), -heights], axis=1)
    if np.diff(turns, append=turns[0] + 2 * np.pi).max() > 2:
        continue
    after = np.roll(arms, -1, axis=0)
    normals = np.cross(arms, after)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    lengths = np.linalg.norm(arms, axis=1) * np.linalg.norm(after, axis=1)
    angles = np.arccos((arms * after).sum(axis=1) / lengths)
    total = angles @ normals
    for way in [0, 0, 1] + 0.4 * generator.normal(size=(40, 3)):
        if (arms @ way <= 0).all():
            # the graph of the cone is below what is outside: a point above the vertex is there
            tried += 1
            assert way[2] > 0
            assert total @ way > 0
assert tried > 50

# %% [markdown]
# ## 4. What kernels decide
#
# Kernels take derivatives of their own lower degrees: of degree $n$, those of $D_s$ are $n$ times
# first differences of coefficients, those of $D_{ss}$ $n (n - 1)$ times second ones, and those of
# $D_{st}$ $n^2$ times mixed ones on squares, $n (n - 1)$ times on triangles: more by $n / (n - 1)$.
# Elevated to degree $n$ they are means of these, so bounds hold all the more.
#
# A convex $D$ is least at a corner of a convex polygon if it does not fall along either side there,
# as every way into the polygon is between both. Where it does, one of these sides, or the inside,
# is the way on.

# %%
rng = np.random.default_rng(1)
for lattice, degree in ((QUADS, 4), (TRIANGLES, 4)):
    form = Form.of(lattice, degree)
    d = rng.normal(size=form.size)
    number = {tuple(place): k for k, place in enumerate(form.exponents.tolist())}
    twice = degree**2 if lattice is QUADS else degree * (degree - 1)
    for row, times, steps in (
        (1, degree, {(1, 0): 1, (0, 0): -1}),
        (3, degree * (degree - 1), {(2, 0): 1, (1, 0): -2, (0, 0): 1}),
        (4, twice, {(1, 1): 1, (1, 0): -1, (0, 1): -1, (0, 0): 1}),
    ):
        own = [
            times * sum(c * d[number[i + x, j + y]] for (x, y), c in steps.items())
            for i, j in number
            if all((i + x, j + y) in number for x, y in steps)
        ]
        elevated = form.derivatives[row] @ d
        assert elevated.min() >= min(own) - 1e-9
        assert elevated.max() <= max(own) + 1e-9

# %% [markdown]
# ## 5. Slivers
#
# Let $x_t = x_s + \epsilon b$ with $b$ across $x_s$. Second derivatives of $D$ are near a matrix of
# determinant $\epsilon^2$, of which rounding leaves nothing where $\epsilon$ is 1e-8; and a foot
# that is held on a side moves by $r$ along $x_s$ where the other parameter is held $r$ off. So feet
# are moved along one parameter at a time at last: that is least squares with one unknown each, and
# needs no determinant. Residuals $x - q$ are known to rounding of points, not of squares.

# %%
a, b = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
epsilon, u, v = 1e-6, 0.0, 1e-13
point = u * a + v * (a + epsilon * b)
s_, t_ = 1e-11, 0.0  # where Newton's method may end
for _ in range(4):
    for way, axis in ((a, 0), (a + epsilon * b, 1)):
        gap = s_ * a + t_ * (a + epsilon * b) - point
        step = -(gap @ way) / (way @ way)
        s_, t_ = (max(s_ + step, 0.0), t_) if axis == 0 else (s_, max(t_ + step, 0.0))
assert np.linalg.norm(s_ * a + t_ * (a + epsilon * b) - point) < 1e-18

# %% [markdown]
# ## 6. One foot and how a cell bends
#
# Take parameters $y = R (s, t)$ where the mean derivative is $Q R$, and columns of $Q$ orthonormal.
# If derivatives to $y$ are within $\delta < 1$ of their mean, a chord between two places that are
# $\Delta$ apart is at least $(1 - \delta) \lvert \Delta \rvert$ long, since it is a mean of
# derivatives times $\Delta$; and it is within $K \lvert \Delta \rvert^2 / 2$ of the derivative
# at its start times $\Delta$ if second derivatives along unit vectors are at most $K$. Let $w$ be
# from $q$ to a place from which half of $D$ falls by at most $g$ for a unit of $y$. From
# $D = \lvert w + c \rvert^2$ with the chord $c$,
#
# $$D - \lvert w \rvert^2 = 2 w \cdot c + \lvert c \rvert^2
#   \ge \bigl((1 - \delta)^2 - K \lvert w \rvert\bigr) \lvert \Delta \rvert^2
#   - 2 g \lvert \Delta \rvert,$$
#
# which is nowhere less than $- g^2$ divided by the bracket. So if that is not small, and $g$ is
# rounding, nothing in the cell is nearer: whatever else it holds, and without coefficients of $D$.

# %%
rng = np.random.default_rng(3)
form = Form.of(QUADS, 3)
flat = np.column_stack([form.exponents / 3, np.zeros(form.size)])
for _ in range(20):
    x = flat + 0.03 * rng.normal(size=flat.shape)
    every = form.derivatives[1:] @ x  # (5, n, 3)
    mean = every[:2].mean(axis=1)
    inverse = np.linalg.inv(np.linalg.qr(mean.T)[1])
    first = np.einsum("ikd,ia->akd", every[:2], inverse)
    delta = np.sqrt(((first - first.mean(axis=1)[:, None]) ** 2).sum(axis=2).max(axis=1).sum())
    second = np.array([[every[2], every[3]], [every[3], every[4]]])
    second = np.einsum("ia,ijkd,jb->abkd", inverse, second, inverse)
    bend = np.sqrt((second**2).sum(axis=3).max(axis=2).sum())
    assert delta < 1
    at = form.values(np.array([0.4]), np.array([0.6]))[0] @ x
    normal = np.cross(at[1], at[2])
    w = 0.99 * (1 - delta) ** 2 / bend * normal / np.linalg.norm(normal)
    u, v = (y.ravel() for y in np.meshgrid(*2 * [np.linspace(0, 1, 41)]))
    near = form.values(u, v, 0)[:, 0] @ x
    assert np.linalg.norm(near - (at[0] - w), axis=1).min() >= np.linalg.norm(w) * (1 - 1e-12)
