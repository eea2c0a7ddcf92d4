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
"""Silhouettes and isophotes: normals as polynomials, at poles and across sharp edges.

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Silhouettes and isophotes
#
# A surface $x(s, t)$ turns away from a viewer in the direction $w$ where $n \cdot w = 0$. Its unit
# normals are no polynomials, but $n = x_s \times x_t$ is one, on each [Bezier cell](pieces.py). So
# such curves are level sets of polynomials, traced as [sections](sections.py) are. This document
# derives
#
# 1. the polynomials, their degrees, and which of their zeros are meant;
# 2. what remains of them at a special corner, where $n$ tends to zero or to infinity;
# 3. why curves are whole at sharp edges, where normals jump;
# 4. how cells of high degree are halved without rounding.
#
# - J. Stam, "Exact evaluation of Catmull-Clark subdivision surfaces at arbitrary parameter values",
#   SIGGRAPH 1998: eigenfunctions.
# - L. Ramshaw, "Blossoming: a connect-the-dots approach to splines", 1987.

# %%
import itertools
from fractions import Fraction

import numpy as np
from sympy import Poly, expand, sqrt, symbols

from limitsurf import LimitSurface, Mesh
from limitsurf.pieces import bernstein
from limitsurf.query.index import Cells
from limitsurf.query.normals import Facing
from limitsurf.query.polynomials import Form
from limitsurf.scheme.lattice import QUADS, TRIANGLES

# %% [markdown]
# ## 1. Polynomials
#
# If $x$ is of degree $d$, in each parameter or in all, $n$ is of degree $2 d$ at most, and with an
# eye $e$ also $n \cdot (e - x)$, of degree $3 d$. As a determinant it does not depend on the
# lengths of derivatives: $n$ changes by a positive factor when parameters do, and signs not at all.
#
# For an angle $\theta$ between the normal and a unit vector $l$, less than 90 degrees, with
# $c = \cos \theta$,
#
# $$g = (n \cdot l)^2 - c^2 \, n \cdot n = (n \cdot l - c \lvert n \rvert)
#   (n \cdot l + c \lvert n \rvert)$$
#
# is of degree $4 d$. It is zero where $n \cdot l = c \lvert n \rvert$, as is meant, or
# $-c \lvert n \rvert$. On these curves $n \cdot l$ has one sign and the other, so they meet nowhere
# but where $n = 0$: whole pieces of what is traced are kept, by that sign. On those that are kept
# $g$ grows to where it is lighter.

# %%
a, b, c = symbols("a b c", positive=True)
length = sqrt(a**2 + b**2)  # of n, with a = n . l
assert expand((a - c * length) * (a + c * length) - (a**2 - c**2 * (a**2 + b**2))) == 0

# %% [markdown]
# As an example, the graph of $a x^2 + b y^2 + c x y$ has the normal $(-f_x, -f_y, 1)$. Its
# silhouettes from afar lie in planes, for $n \cdot w$ is linear; from an eye $e$ too, for by
# Euler's theorem $n \cdot (e - x) = e_z + f(x) - e_x f_x - e_y f_y$, and at $f = z$ that is
# linear. Under light from above isophotes are ellipses, $f_x^2 + f_y^2 = \tan^2 \theta$.

# %%
x, y, e1, e2, e3 = symbols("x y e1 e2 e3", real=True)
f = a * x**2 + b * y**2 + c * x * y
fx, fy = f.diff(x), f.diff(y)
value = -fx * (e1 - x) - fy * (e2 - y) + (e3 - f)
assert expand(value - (e3 + f - e1 * fx - e2 * fy)) == 0
assert Poly(expand(value - f), x, y).total_degree() == 1

# %% [markdown]
# ## 2. At special corners
#
# Around a special corner $x = x_0 + \sum_k \lambda_k^n \, m_k \, \varphi_k(s, t)$ on ring $n$. With
# $m_1, m_2$ those of the two leading eigenfunctions, of which the limit normal is made, and $r$ the
# rest,
#
# $$x_s \times x_t = (\lambda_1 \lambda_2)^n \left( J \; m_1 \times m_2 + R_n \right), \quad
#   J = \varphi_{1,s} \varphi_{2,t} - \varphi_{2,s} \varphi_{1,t}.$$
#
# $J$ is the determinant of the characteristic map, the same on every ring and positive if that map
# is regular: so are its Bernstein coefficients. If the derivatives of the leading part, scaled, are
# $1$ at most, and those of the rest $\rho_n$ at most, then $\lvert R_n \rvert \le 2 \rho_n +
# \rho_n^2$, and $\rho_n$ falls as $(\lambda_3 / \lambda_2)^n$. So the sign of $n \cdot w$ is that
# of $(m_1 \times m_2) \cdot w$ from some ring on, if that is not zero: what remains has no part of
# the silhouette. If it is zero, the curves go into the vertex. Both are seen without any normal
# being divided by its length, which goes as $(2 \lambda)^{2n}$.

# %%
p1, p2, q1, q2 = np.random.default_rng(0).normal(size=(4, 3))
leading, rest = np.stack([p1, p2]), 0.1 * np.stack([q1, q2])
leading /= np.linalg.norm(leading, axis=1).max()
off = np.cross(*(leading + rest)) - np.cross(*leading)
rho = np.linalg.norm(rest, axis=1).max()
assert np.linalg.norm(off) <= 2 * rho + rho**2

spin = 2 * np.pi * np.arange(5) / 5
star = np.concatenate([[[0, 0, 1]], np.stack([np.cos(spin), np.sin(spin), 0 * spin], axis=1)])
outer = np.stack([2 * np.cos(spin + 0.6), 2 * np.sin(spin + 0.6), -1 + 0 * spin], axis=1)
faces = [[0, 1 + k, 6 + k, 1 + (k + 1) % 5] for k in range(5)]
pole = LimitSurface(Mesh(np.concatenate([star, outer]), faces))
cells = Cells.of(pole)
which = np.flatnonzero(cells.beyond.is_smooth)
for w in ((0.0, 0.0, 1.0), (0.3, 0.2, 1.0), (1.0, 0.0, 0.1)):
    facing = Facing(cells, np.array(w) / np.linalg.norm(w), False)
    corner = facing.at_corners(which)
    sure = np.zeros(len(which), dtype=bool)
    for ring in range(20):
        rings = np.full(len(which), ring)
        sure |= np.abs(corner) > facing.reach(which, rings)
        found = facing.of_rings(which, rings, cells.beyond.cells(which, rings))
        assert (np.sign(found[sure]) == np.sign(corner[sure])[:, None, None]).all()
    assert sure.all()

# %% [markdown]
# In float64 the differences of points that make $x_s$ are off by roundings of their size, $\delta$,
# and $n$ by $\delta (\lvert x_s \rvert + \lvert x_t \rvert)$. Cells are scaled so that this is
# about a rounding of $1$. On rings $\delta$ is relative to the corner, and falls with them.
#
# ## 3. Sharp edges
#
# Across a sharp edge $n \cdot w$ jumps. The silhouette is the border of the set where it is
# negative, so it has the parts of the edge of which one strand is negative and the other not. Each
# strand has a sign that changes where the curves on its side end. With the sets of these places on
# both strands, the parts between are of the border or not by turns, and each place is an end of one
# curve and one part. So nothing ends there. At a vertex each sector between sharp edges has curves
# that go into it: these, and the parts of edges that begin there, are even in number.

# %%
for changes in itertools.product(("one", "other", None), repeat=5):
    for first in itertools.product((False, True), repeat=2):
        signs, degree = list(first), []
        for change in changes:
            before = signs[0] != signs[1]
            if change is not None:
                which_one = ("one", "other").index(change)
                signs[which_one] = not signs[which_one]
            after = signs[0] != signs[1]
            # parts of the edge at this place, and the curve that ends here
            degree.append(before + after + (change is not None))
        assert all(k % 2 == 0 for k in degree)

for sectors in range(1, 5):
    # signs at both edges of each sector; curves inside of it change them
    for signs in itertools.product((False, True), repeat=2 * sectors):
        curves = sum(signs[2 * k] != signs[2 * k + 1] for k in range(sectors))
        edges = sum(signs[2 * k + 1] != signs[(2 * k + 2) % (2 * sectors)] for k in range(sectors))
        assert (curves + edges) % 2 == 0

# %% [markdown]
# ## 4. Halves of high degree
#
# Coefficient $(i, j)$ of a part of a triangle is the blossom at $i$ times one of its corners, $j$
# times another and $d - i - j$ times the last. With barycentric coordinates $(X, Y, Z)$ of these
# places, the weight of a coefficient in it is that of its monomial in the product of the $d$ linear
# forms. If the part is a half these are multiples of powers of $1/2$, and float64 has them exactly,
# where the solution of a linear system at degree 12 is off by $10^{-9}$.

# %%
for lattice, degree in ((QUADS, 6), (TRIANGLES, 8)):
    form = Form.of(lattice, degree)
    assert (form.halves * 4.0**degree == np.round(form.halves * 4.0**degree)).all()
    spot = np.array([[0.25, 0.125], [0.5, 0.375]])
    values = np.random.default_rng(1).integers(-9, 9, form.size)
    for way, half in itertools.product(range(len(form.frames)), (0, 1)):
        frame = form.frames[way, half]
        exact = [[Fraction(x) for x in row] for row in form.halves[way, half].tolist()]
        part = [sum(m * int(v) for m, v in zip(row, values, strict=True)) for row in exact]
        there = frame[0] + spot @ frame[1:]
        one = bernstein.polynomials(form.exponents, *spot.T) @ np.array(part, dtype=float)
        other = bernstein.polynomials(form.exponents, *there.T) @ values
        assert np.abs(one - other).max() < 1e-12
