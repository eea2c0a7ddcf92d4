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
"""Fairness energies: on polynomial pieces, and around special corners.

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Fairness energies
#
# The energy of order $m$ of a function on a face is the integral of the squares of all its
# derivatives of that order, by orthogonal coordinates. It is quadratic in the control points; this
# document derives
#
# 1. coordinates in which it does not matter at which corner a face begins;
# 2. what halving does to it, and its matrix on a polynomial piece;
# 3. why second derivatives by the parameters are not square integrable at poles, and coordinates
#    by which they are;
# 4. the sum over all rings around a special corner;
# 5. what has no energy.
#
# - M. Halstead, M. Kass and T. DeRose, "Efficient, fair interpolation using Catmull-Clark
#   surfaces", SIGGRAPH 1993: sections 5 and 6, where the sum over rings is one of a geometric
#   series.
# - J. Peters and U. Reif, "Subdivision Surfaces", Springer 2008: the characteristic map.

# %%
from itertools import product
from math import comb, prod

import numpy as np
from sympy import Matrix, diff, expand, integrate, simplify, sqrt, symbols

import limitsurf as ls
from limitsurf.cad.fairness import _terms, around, cell_form, metric
from limitsurf.scheme.catmull_clark import CATMULL_CLARK
from limitsurf.scheme.lattice import QUADS, TRIANGLES
from limitsurf.scheme.loop import LOOP

u, v = symbols("u v")

# %% [markdown]
# ## 1. Turns
#
# A turn of the domain maps $(s, t)$ to $(u, v) = b + s\,a_1 + t\,a_2$, and an inverse metric $g$ of
# $(s, t)$ to $A\,g\,A^T$, with the columns $a_1, a_2$ of $A$. The mean of $A A^T$ over all turns is
# one that no turn changes. Of squares it is the unit matrix; of triangles, with determinant 1,
#
# $$
# g = \frac{1}{\sqrt3} \begin{pmatrix} 2 & -1 \\ -1 & 2 \end{pmatrix} :
# $$
#
# that of an equilateral triangle of area $\frac12$.

# %%
for lattice, expected in (
    (QUADS, Matrix([[1, 0], [0, 1]])),
    (TRIANGLES, Matrix([[2, -1], [-1, 2]])),
):
    turns = [Matrix([along, across]).T for _, along, across in lattice.turns]
    mean = sum((A * A.T for A in turns), Matrix.zeros(2))
    g = mean / sqrt(mean.det())
    assert all(simplify(A * g * A.T - g) == Matrix.zeros(2) for A in turns)
    assert simplify(g - expected / sqrt(expected.det())) == Matrix.zeros(2)
    assert np.abs(np.array(g, dtype=float) - metric(lattice)).max() < 1e-15

# %% [markdown]
# The energy of order $m$ is the integral of $g^{ij} g^{kl} \cdots f_{ik\ldots} f_{jl\ldots}$. Of a
# square that is $f_u^2 + f_v^2$, $f_{uu}^2 + 2 f_{uv}^2 + f_{vv}^2$ and
# $f_{uuu}^2 + 3 f_{uuv}^2 + 3 f_{uvv}^2 + f_{vvv}^2$.

# %%
assert _terms(QUADS, 3) == {
    ((3, 0), (3, 0)): 1, ((2, 1), (2, 1)): 3, ((1, 2), (1, 2)): 3, ((0, 3), (0, 3)): 1
}  # fmt: skip
cubic = (1 + 2 * u - v) ** 3 + u * v**2
x = u, v


def energy_density(f, g, m):
    """The sum of g^ij g^kl .. f_ik.. f_jl.., of m pairs."""
    if m == 0:
        return f**2
    total = 0
    for one in product((0, 1), repeat=m):
        for other in product((0, 1), repeat=m):
            weight = prod(g[i, j] for i, j in zip(one, other, strict=True))
            total += weight * diff(f, *(x[i] for i in one)) * diff(f, *(x[j] for j in other))
    return total


for lattice, g in (
    (QUADS, Matrix([[1, 0], [0, 1]])),
    (TRIANGLES, Matrix([[2, -1], [-1, 2]]) / sqrt(3)),
):
    for (p, q), (a, b), (c, d) in lattice.turns:
        turn = {u: p + a * u + c * v, v: q + b * u + d * v}
        turned = cubic.subs(turn, simultaneous=True)
        for m in (1, 2):
            here = energy_density(cubic, g, m).subs(turn, simultaneous=True)
            assert expand(here - energy_density(turned, g, m)) == 0

# %% [markdown]
# ## 2. Pieces
#
# At half the size derivatives of order $m$ are $2^m$ times as large, and the area a fourth: the
# energy is $4^{m - 1}$ times as large. On a piece that is polynomial it is a quadratic form of its
# Bernstein coefficients, by integrals of products of powers.

# %%
for scheme, inner in ((CATMULL_CLARK, (v, 0, 1)), (LOOP, (v, 0, 1 - u))):
    quads = scheme is CATMULL_CLARK
    exponents = np.array(scheme.spline.exponents)[:, :: -1 if quads else 1]
    c, d = np.random.default_rng(0).integers(-3, 4, len(exponents)), int(exponents.max())
    f = 0
    for weight, (i, j) in zip(c.tolist(), exponents.tolist(), strict=True):
        if quads:
            first, second = (comb(d, k) * y**k * (1 - y) ** (d - k) for k, y in ((i, u), (j, v)))
            f += weight * first * second
        else:
            factor = comb(d, i + j) * comb(i + j, j)
            f += weight * factor * u**i * v**j * (1 - u - v) ** (d - i - j)
    g = Matrix([[1, 0], [0, 1]]) if quads else Matrix([[2, -1], [-1, 2]]) / sqrt(3)
    density = expand(energy_density(f, g, 2))
    exact = float(integrate(integrate(density, inner), (u, 0, 1)))
    form = cell_form(scheme, 2, (1.0, 1.0))
    assert abs(c @ form @ c / exact - 1) < 1e-12
    for m in (1, 2, 3):
        half, whole = (cell_form(scheme, m, (size, size)) for size in (0.5, 1.0))
        assert np.abs(half - 4.0 ** (m - 1) * whole).max() < 1e-12 * np.abs(half).max()

# %% [markdown]
# ## 3. Poles
#
# An eigenfunction of eigenvalue $\mu$ is $\mu^n$ times as large on ring $n$, which is $2^{-n}$
# times as large as ring 0. By the parameters its energy of order $m$ is $(4^{m - 1} \mu^2)^n$ times
# that on ring 0. Second derivatives of those of the subdominant eigenvalue $\lambda > \frac12$,
# which are not 0 at valences from 5 on (of triangles from 7 on), make it infinite; by Doo and
# Sabin's scheme $\lambda = \frac12$, and all rings have the same.
#
# In the coordinates of the characteristic map $\chi$, a ring is $\lambda^n$ times as large, and the
# factor is $(\lambda^{2 - 2m} \mu^2)^n$; functions linear in $\chi$ have no second derivatives. For
# $m = 2$ it is less than 1 for all other $\mu < \lambda$. For $m = 3$ it is $(\mu /
# \lambda^2)^{2n}$, of which curvature that is unbounded makes a divergent sum: with the factor
# $\lvert \chi \rvert^2$ that becomes $(\mu / \lambda)^{2n}$. Maps are taken of the area that the
# face has in its parameters; at valence 4 they are these.

# %%
for scheme, regular in (("catmull-clark", 4), ("loop", 6), ("doo-sabin", 4)):
    for valence in range(3, 13):
        first, second, mu = np.abs(ls.eigenbasis(scheme, valence=valence).float64.rates[0, 1:4])
        assert first == second
        grows = 4 * first**2 > 1 + 1e-12
        assert grows == (valence > regular and scheme != "doo-sabin")
        assert mu < first  # by chi, second derivatives are square integrable
        if valence > regular and scheme != "doo-sabin":
            assert mu > first**2  # but third ones are not

# %% [markdown]
# ## 4. All rings
#
# Let $G_0$ be the energies of pairs of eigenfunctions on ring 0, by quadrature of rational
# functions with 14 Gauss points in each direction, and $P = \lambda^{1 - m} J$ (for $m = 3$ with
# the weight: $\lambda^{-1} J$) what a step makes of eigencoefficients, with the Jordan matrix $J$,
# whose rows and columns of functions without energy are left out. All rings have
#
# $$
# G = \sum_n (P^T)^n G_0 P^n , \qquad G = G_0 + P^T G\,P .
# $$
#
# With $S_k$ the sum of the first $2^k$ terms, $S_{k + 1} = S_k + (P^T)^{2^k} S_k P^{2^k}$: ten
# steps sum a thousand rings. Where there is no characteristic map of one eigenvalue, ring $n$
# counts $4^{(1 - m) n}$ times, which leaves $P = J$; all eigenvalues but the first are below 1.

# %%
for scheme, valence in (("catmull-clark", 3), ("catmull-clark", 7), ("loop", 5), ("doo-sabin", 5)):
    table = ls.eigenbasis(scheme, valence=valence).float64
    rate, V = float(table.rates[0, 1]), table.V
    for m in (1, 2, 3)[: 2 if scheme == "doo-sabin" else 3]:
        G = V.T @ around(table, m) @ V
        P = table.J * rate ** (1 - min(m, 2))
        none = [0, 1, 2][: 1 if m == 1 else 3]
        P[none], P[:, none] = 0, 0
        first = G - P.T @ G @ P  # of ring 0: positive
        assert np.linalg.eigvalsh((first + first.T) / 2)[0] > -1e-9 * np.abs(G).max()
        assert np.abs(G[none]).max() < 1e-9 * np.abs(G).max()

# %% [markdown]
# ## 5. What has no energy
#
# Constants, so that rows sum to 0. Of "thin_plate" on a regular grid with a boundary, $u$ and $v$
# too, which the rules of boundaries continue; of "variation", $u v$ besides, whose third
# derivatives are 0, while these rules let $u^2$ have no second derivative across the boundary. Of a
# closed cage no other function is without energy, for it would be linear everywhere; but on a cube
# the function of 1 and -1 by turns [vanishes](elements.py#2-functions-that-vanish), and has none.

# %%
n = 6
points = [[i, j] for i in range(n) for j in range(n)]
quads = [
    [n * i + j, n * i + n + j, n * i + n + j + 1, n * i + j + 1]
    for i in range(n - 1)
    for j in range(n - 1)
]
grid = ls.LimitSurface(ls.Mesh(points, quads))
p, q = np.array(points, dtype=float).T
for energy, free in (("membrane", 1), ("thin_plate", 3), ("variation", 4)):
    E = ls.fairness(grid, energy).toarray()
    sizes = np.linalg.eigvalsh(E)
    assert sizes[free - 1] < 1e-12 * sizes[-1] < sizes[free]
    for f in (1 + 0 * p, p, q, p * q)[:free]:
        assert np.abs(E @ f).max() < 1e-11
signs = np.array([1, -1, -1, 1, -1, 1, 1, -1.0])
corners = [[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)]
sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
E = ls.fairness(ls.LimitSurface(ls.Mesh(corners, sides)))
assert np.abs(E @ signs).max() < 1e-13
