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
"""Faces as Bezier patches: changes of basis, turns, and bounds of what remains at a corner.

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Bezier patches
#
# A limit face is a countable set of polynomial pieces: regular patches, strips, and around each
# special corner three pieces to each ring $n = 0, 1, 2, \dots$, as
# [eigenfunctions](eigenfunctions.py) has it. For quads and for triangles this document derives
#
# 1. Bernstein coefficients from the control points of a spline, and from powers;
# 2. those of a patch that is turned against its limit face, and where its cells lie;
# 3. that the limit beyond any ring lies in the convex hull of refined control points, reflections
#    at sharp sides included;
# 4. a bound for masks that are no convex combinations;
# 5. that a regular patch is a special corner, too, whose eigenfunctions are the monomials.
#
# - G. Farin, "Curves and Surfaces for CAGD", 5th edition, 2002: Bernstein polynomials, hulls.

# %%
from fractions import Fraction
from itertools import product
from math import factorial, log

import numpy as np
from sympy import Matrix, Poly, Rational, binomial, expand, ff, symbols

from limitsurf import tables
from limitsurf._kernels.reference import spline_weights
from limitsurf.engine.monomials import monomials as corner_basis
from limitsurf.numbers import RATIONAL
from limitsurf.pieces import bernstein, weights
from limitsurf.scheme.bilinear import BILINEAR, LINEAR
from limitsurf.scheme.catmull_clark import CATMULL_CLARK
from limitsurf.scheme.doo_sabin import DOO_SABIN
from limitsurf.scheme.loop import LOOP

s, t, u, v = symbols("s t u v")
B = [binomial(3, i) * t**i * (1 - t) ** (3 - i) for i in range(4)]

# %% [markdown]
# ## 1. Changes of basis
#
# The power $t^k$ has the Bernstein coefficients $\binom{i}{k} / \binom{3}{k}$, and the cubic
# B-spline piece with control points $p_0, \dots, p_3$ has
#
# $$\tfrac16 (p_0 + 4 p_1 + p_2), \quad \tfrac13 (2 p_1 + p_2), \quad \tfrac13 (p_1 + 2 p_2),
# \quad \tfrac16 (p_1 + 4 p_2 + p_3).$$

# %%
powers = Matrix(4, 4, lambda i, k: binomial(i, k) / binomial(3, k))
for k in range(4):
    assert expand(sum(powers[i, k] * B[i] for i in range(4)) - t**k) == 0

controls = Matrix([[1, 4, 1, 0], [0, 4, 2, 0], [0, 2, 4, 0], [0, 1, 4, 1]]) / 6
spline = [(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3]
for k in range(4):
    assert expand(sum(controls[i, k] * B[i] for i in range(4)) - spline[k] / 6) == 0
for x in (Fraction(0), Fraction(2, 7), Fraction(1)):
    found = spline_weights(RATIONAL.array([x]), 3)[0]
    assert list(found) == [(p / 6).subs(t, Rational(x.numerator, x.denominator)) for p in spline]

# %% [markdown]
# The library has both as tensor products, row $4 i + j$ for $B_i(u) B_j(v)$, column $4 j + i$ for
# control point or power $i$ along $u$ and $j$ along $v$.

# %%
matrices = bernstein.Bernstein.of(CATMULL_CLARK, exact=True)
for i, j, k, m in product(range(4), repeat=4):
    assert matrices.from_controls[4 * i + j, 4 * m + k] == controls[i, k] * controls[j, m]
    assert matrices.from_powers[4 * i + j, 4 * m + k] == powers[i, k] * powers[j, m]

# %% [markdown]
# On triangles the Bernstein polynomials of degree $d$ are, with $r = 1 - s - t$,
#
# $$B_{ij} = \frac{d!}{i!\, j!\, (d - i - j)!} s^i t^j r^{d - i - j}, \qquad i + j \le d.$$
#
# With $x^{\underline k} = x (x - 1) \cdots (x - k + 1)$ the power $s^k t^m$ is $s^k t^m$ times
# $(s + t + r)^{d - k - m}$, whose coefficient at $s^i t^j$ over that in $B_{ij}$ is
# $i^{\underline k} j^{\underline m} / d^{\underline{k + m}}$. In squares the denominator is
# $d^{\underline k} d^{\underline m}$, since there both are lines.

# %%
triangles, loop = bernstein.Bernstein.of(LOOP, exact=True), LOOP.spline
places = [(int(i), int(j)) for i, j in triangles.exponents]
assert places == [(i, j) for j in range(5) for i in range(5 - j)] == list(loop.exponents)
b = {
    (i, j): Rational(24, factorial(i) * factorial(j) * factorial(4 - i - j))
    * s**i
    * t**j
    * (1 - s - t) ** (4 - i - j)
    for i, j in places
}
for column, (k, m) in enumerate(places):
    share = [ff(i, k) * ff(j, m) / Rational(ff(4, k + m)) for i, j in places]
    assert share == [Rational(x.numerator, x.denominator) for x in triangles.from_powers[:, column]]
    total = sum(x * b[place] for x, place in zip(share, places, strict=True))
    assert Poly(total - s**k * t**m, s, t).is_zero

# %% [markdown]
# The quartic box spline has these from its polynomials; none is negative, and each row sums to one.
# Corner 0 is the limit of a regular vertex, half of it and 1/12 of each neighbour.

# %%
for column in range(12):
    monomials = sum(loop.pieces[n][column] * s**i * t**j for n, (i, j) in enumerate(places))
    form = sum(x * b[p] for x, p in zip(triangles.from_controls[:, column], places, strict=True))
    assert Poly(monomials - form, s, t).is_zero
assert (triangles.from_controls >= 0).all()
assert (triangles.from_controls.sum(axis=1) == 1).all()
corner = dict(zip(loop.template, triangles.from_controls[0], strict=True))
assert corner[1, 1] == Fraction(1, 2)
assert sorted(corner.values()) == [0] * 5 + [Fraction(1, 12)] * 6 + [Fraction(1, 2)]

# %% [markdown]
# ## 2. Turns
#
# A patch turned by one corner has $s = v$, $t = 1 - u$; by two $s = 1 - u$, $t = 1 - v$; by three
# $s = 1 - v$, $t = u$. Since $B_i(1 - t) = B_{3 - i}(t)$, turns permute coefficients.

# %%
coefficients = Matrix(4, 4, symbols("c:16"))
whole = sum(coefficients[i, j] * B[i].subs(t, s) * B[j] for i, j in product(range(4), repeat=2))
for turn, (x, y) in enumerate([(u, v), (v, 1 - u), (1 - u, 1 - v), (1 - v, u)]):
    order = matrices.turned[turn]
    same = sum(
        coefficients[int(order[4 * i + j])] * B[i].subs(t, u) * B[j].subs(t, v)
        for i, j in product(range(4), repeat=2)
    )
    assert expand(whole.subs({s: x, t: y}, simultaneous=True) - same) == 0
    # the rectangle at (1/2, 0) of size 1/2 by 1/4 in (s, t)
    square = np.array([[[0.5, 0.0]]]), np.array([[[0.5, 0.25]]])
    placed = bernstein.turned_cells(CATMULL_CLARK.lattice, *square, np.array([turn]))
    origin, size = (x[0, 0] for x in placed)
    least, most = (
        dict(zip((u, v), map(Rational, z), strict=True)) for z in (origin, origin + size)
    )
    assert {x.subs(least), x.subs(most)} == {Rational(1, 2), 1}
    assert {y.subs(least), y.subs(most)} == {0, Rational(1, 4)}

# %% [markdown]
# A triangle turned by one corner has $s = v$, $t = 1 - u - v$, by two $s = 1 - u - v$, $t = u$:
# that permutes $s$, $t$, $r$, and so the exponents of $B_{ij}$. A cell of it, at
# $(s, t) = o + h\, (S, T)$ with $(S, T)$ in the triangle too, has the same size $h$ in $(u, v)$ and
# begins at another of its corners. The piece in the middle lies at
# $(s, t) = \frac12 (1 - S, 1 - T)$: its size is negative, as half a turn is a factor of $-1$, and
# its corners are turned by the same permutation. So is a patch in the middle of a split face, which
# lies at $(u, v) = o - h\, (s, t)$: no coefficient moves.

# %%
letters = dict(zip(places, symbols("c:15"), strict=True))
whole = sum(letters[place] * b[place] for place in places)
for turn, (x, y) in enumerate([(u, v), (v, 1 - u - v), (1 - u - v, u)]):
    order = [letters[places[n]] for n in triangles.turned[turn]]
    same = sum(x * b[place] for x, place in zip(order, places, strict=True)).subs({s: u, t: v})
    assert Poly(whole.subs({s: x, t: y}, simultaneous=True) - same, u, v).is_zero
    for place, h in (((0.5, 0.0), 0.5), ((0.5, 0.5), -0.5), ((0.25, 0.125), 0.125)):
        cell = np.array([[place]]), np.array([[[h, h]]])
        found = bernstein.turned_cells(LOOP.lattice, *cell, np.array([turn]))
        origin, size = (x[0, 0] for x in found)
        assert (size == h).all()
        # in (u, v) corner k of the cell is corner k - turn of that in (s, t)
        corners = np.array(LOOP.lattice.corners)
        before = np.roll(np.array(place) + h * corners, turn, axis=0)
        after = [{u: p, v: q} for p, q in origin + size * corners]
        found = [[float(x.subs(at)), float(y.subs(at))] for at in after]
        assert np.array_equal(found, before)

# %% [markdown]
# ## 3. Convex hulls
#
# Let $C_n = A^n C$ be the control points around a corner after $n$ halvings, and $P C_n$ the
# Bernstein coefficients of ring $n$. If no entry of $A$ and $P$ is negative, their rows, which sum
# to one, are convex combinations: ring $m \ge n$ has the coefficients $P A^{m - n} C_n$ in the
# convex hull of the rows of $C_n$, and so have its points. The limit of the vertex is one of
# their limits. What remains beyond ring $n - 1$ is therefore in the hull of $C_n$; and in that of
# $P C_n, \dots, P C_{n + 3}$ and $C_{n + 4}$, which is hardly larger than the surface there, since
# $C_{n + 4}$, which reaches beyond it, has shrunk by $\lambda^4$.
#
# $P$ is not negative though a control point beyond a sharp side is a reflection,
# $p_0 = 2 p_1 - p_2$: the coefficients become $p_1$, $\frac13 (2 p_1 + p_2)$,
# $\frac13 (p_1 + 2 p_2)$ and $\frac16 (p_1 + 4 p_2 + p_3)$.

# %%
p1, p2, p3 = symbols("p1:4")
reflected = controls * Matrix([2 * p1 - p2, p1, p2, p3])
wanted = [p1, (2 * p1 + p2) / 3, (p1 + 2 * p2) / 3, (p1 + 4 * p2 + p3) / 6]
assert [expand(x) for x in reflected] == [expand(x) for x in wanted]

# %% [markdown]
# Beyond a sharp side of triangles the control point is $a + b - c$ for the triangle $(a, b, c)$
# with the side $(a, b)$. None of the coefficients is negative with these either.

# %%
grid = {place: n for n, place in enumerate(loop.template)}
reflected = np.array([[Fraction(int(m == n)) for n in grid.values()] for m in grid.values()])
for i, j in grid:
    if j == 0:
        row = [LOOP.lattice.reflection[n][0] for n in range(3)]
        near = [grid[i + x, j + y] for _, (x, y) in LOOP.lattice.reflection]
        assert (row, near) == ([1, 1, -1], [grid[i, 1], grid[i - 1, 1], grid[i - 1, 2]])
        reflected[grid[i, j]] = reflected[near[0]] + reflected[near[1]] - reflected[near[2]]
assert (triangles.from_controls @ reflected >= 0).all()

# %% [markdown]
# That is looked up in the matrices of every kind of corner: here for those of up to six faces.
# Around five faces the weights of Loop are not rational. Rounded ones do as well for a bound in
# float64: what rounding them does is less than that of one more sum, which the bound allows for.

# %%
for scheme, kind, faces in product((CATMULL_CLARK, LOOP), tables.KINDS, range(2, 7)):
    for position in range(1 if scheme.sector(kind, faces).alike else faces):
        table = tables.rational_table(scheme, scheme.sector(kind, faces, position), rounded=True)
        rows = weights.hull_weights(scheme, table, 0, False)
        assert rows is not None  # none is negative, exactly
        assert (rows >= 0).all()
        assert (abs(rows.sum(axis=1) - 1) < 1e-14).all()

# %% [markdown]
# ## 4. Other masks
#
# With negative weights at the vertex there is the sum over eigenfunctions $\varphi_k$: on ring $m$
# a point differs from the limit of the vertex by $\sum_k \varphi_k\, (J^m c)_k$ with $k \ge 1$. Let
# $f_k$ be the largest Bernstein coefficient of $\varphi_k$ on the first ring, in size. The entries
# of $J^m$ are, in size, $\lambda^m$ on the diagonal, which falls with $m$; for complex pairs both
# of $\lambda^m$ times a cosine or sine, so that $f_k + f_{k + 1}$ bounds both; and
# $m \lambda^{m - 1}$ beside it in Jordan blocks, which as a function of real $m$ has its maximum at
# $m = -1 / \ln \lambda$ and falls from there on. So over all $m \ge n$ it is at most its value at
# $\max(n, -1 / \ln \lambda)$.

# %%
for rate, n in product((0.25, 0.5, 0.9), (0, 1, 3, 20)):
    m = max(n, -1 / log(rate))
    assert max(k * rate ** (k - 1) for k in range(n, 400)) <= m * rate ** (m - 1) * (1 + 1e-12)

rings = [(CATMULL_CLARK, *x) for x in (("interior", 5), ("corner", 2), ("dart", 2))]
rings += [(LOOP, *x) for x in (("interior", 5), ("interior", 3), ("crease", 4))]
for scheme, kind, faces in rings:
    table = tables.eigen_table(scheme, scheme.sector(kind, faces))
    found = np.abs(weights.ring_functions(table, 12).reshape(12, -1, table.size - 1))
    for n in (0, 2):
        most = found[n:].max(axis=(0, 1))
        assert (most <= weights.most_beyond(table, n) * (1 + 1e-12)).all()

# %% [markdown]
# ## 5. Monomials
#
# Let a regular patch be seen as a special corner: by its corner 0, in rings of pieces. The
# polynomial $s^i t^j$ is multiplied by $2^{-(i + j)}$ when $s$ and $t$ are halved: monomials are
# eigenfunctions, and the rows of `Spline.pieces`, which give their coefficients from the control
# points, are left eigenvectors of a step; where there are as many monomials as control points (not
# under Loop's, 15 and 12) they are a basis. On a piece with its origin at $(a, b)$ of its size,
# turned or not, a monomial at half the size is
#
# $$
# \left( \frac{a \pm S}{2} \right)^i \left( \frac{b \pm T}{2} \right)^j .
# $$
#
# So compiled kernels that evaluate eigenfunctions of some degrees know all splines of these
# degrees, whose weights they need not have.

# %%
for scheme in (DOO_SABIN, BILINEAR, LINEAR, CATMULL_CLARK):
    spline, lattice, basis = scheme.spline, scheme.lattice, corner_basis(scheme)
    exponents = sorted(spline.exponents, key=lambda powers: (sum(powers), powers[1]))
    assert basis.rates[0].tolist() == [0.5 ** sum(nu) for nu in exponents]
    S, T = symbols("S T")
    for k, piece in enumerate(lattice.pieces):
        sign = -1 if piece.turned else 1
        x, y = ((origin + sign * z) / 2 for origin, z in zip(piece.origin, (S, T), strict=True))
        for column, (i, j) in enumerate(exponents):
            found = Poly(x**i * y**j, S, T)
            own = [float(found.coeff_monomial(S**p * T**q)) for p, q in spline.exponents]
            assert basis.pieces[k][:, column].tolist() == own
    # the coefficients from the control points: no others give the polynomial of the patch
    place = [spline.exponents.index(nu) for nu in exponents]
    assert (basis.ring.left == np.array(spline.pieces, dtype=float)[place]).all()
    assert np.linalg.matrix_rank(basis.ring.left) == len(exponents) == basis.size
    # a step multiplies them by the eigenvalues: control points of the child at corner 0
    A = np.zeros((basis.size, basis.size))
    for row, point in enumerate(spline.template):
        for (i, j), weight in spline.stencil((point[0] - 1, point[1] - 1)).items():
            A[row, spline.template.index((1 + i, 1 + j))] = weight
    assert np.allclose(basis.ring.left @ A, basis.rates[0][:, None] * basis.ring.left, atol=1e-15)
