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
"""Limit faces as B-spline faces: control points, what is free at a pole, and how far that is off.

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Limit faces as B-spline faces
#
# A limit face consists of polynomial pieces, and of infinitely many of them towards special
# corners. A clamped tensor product spline with knots at the lines between them is the face itself,
# but for one cell at each special corner, in which one control point is free.
#
# - L. Ramshaw, "Blossoming: a connect-the-dots approach to splines", DEC SRC report 19 (1987).
# - J. Peters, J. Fan, "On the complexity of smooth spline surfaces from quad meshes", Computer
#   Aided Geometric Design 27 (2010): what a spline takes that is smooth at poles as well.

# %%
from itertools import combinations
from math import comb

import numpy as np
from sympy import Rational, diff, expand, linsolve, symbols

from limitsurf import LimitSurface, Mesh, bspline_faces
from limitsurf.cad.nets import clamped, line, square_of_triangle

# %% [markdown]
# ## 1. Control points are blossoms
#
# The blossom $F$ of a polynomial $f$ of degree $p$ is symmetric, affine in each of $p$ arguments,
# and $F(x, \dots, x) = f(x)$. The control points of a spline with knots $t_i$ are $d_i =
# F_k(t_{i+1}, \dots, t_{i+p})$, with $F_k$ of the piece on any interval $[t_k, t_{k+1}]$ of the
# support, $i \le k \le i + p$.
#
# It does not matter which, where knots are simple and the spline is $C^{p-1}$: neighbouring pieces
# differ by a multiple of $(x - t)^p$, whose blossom is the product of $a - t$ over all arguments
# $a$, and one of these is $t$ itself wherever both pieces are in the support.

# %%
t, a, b, c, x = symbols("t a b c x")
difference = expand((x - t) ** 3)
blossom = (a - t) * (b - t) * (c - t)
assert expand(blossom.subs({a: x, b: x, c: x}) - difference) == 0
assert blossom.subs(b, t) == 0
for p in (1, 2, 3, 4):
    for i in range(4):
        own, support = set(range(i + 1, i + p + 1)), range(i, i + p + 1)
        assert all(set(range(j + 1, k + 1)) <= own for j, k in combinations(support, 2))

# %% [markdown]
# With Bernstein coefficients $b_l$ of a piece on $[o, o + s]$, and $x_k = (a_k - o) / s$,
#
# $$F(a_1, \dots, a_p) = \sum_l b_l\, e_l, \qquad
# \sum_l e_l z^l = \prod_k (1 - x_k + x_k z).$$
#
# The sum of $|e_l|$ is at most $\prod (|1 - x_k| + |x_k|)$, which is what rounding grows by: the
# piece is taken for which it is least. Where knots are graded by halves that is no more than 9
# along a line.

# %%
for depth in range(3, 20):
    half = 0.5 ** np.arange(depth, -1, -1)
    graded = np.concatenate([[0], half, 2 - half[-2::-1], [2]])
    knots = clamped(graded, 3)
    chosen, weights = line(graded, graded, 3)
    assert np.abs(weights.sum(axis=1) - 1).max() < 1e-12
    assert np.abs(weights).sum(axis=1).max() <= 9
    # they give back x^3, of which the blossom is the product of knots
    low, high = graded[chosen], graded[chosen + 1]
    cubes = np.stack([low**3, low**2 * high, low * high**2, high**3], axis=1)
    products = np.array([knots[k + 1 : k + 4].prod() for k in range(len(chosen))])
    assert np.abs((weights * cubes).sum(axis=1) - products).max() < 1e-13

# %% [markdown]
# ## 2. One point is free at a special corner
#
# Let pieces end at the cell $[0, h]^2$ at a corner. Control point $(i, j)$ has the support $[t_i,
# t_{i+p+1}] \times [t_j, t_{j+p+1}]$, and with clamped ends that of $(0, 0)$ is $[0, h]^2$ and no
# other's is within it. So all but one follow from the exact pieces, and that one is set to the
# limit of the corner.
#
# Along an edge from there the spline's curve is then the one that has its value and $p - 1$
# derivatives in common with the exact curve at $h$, and the limit at 0: $p + 1$ conditions for a
# polynomial of degree $p$. They ask nothing of the faces beside the edge. So faces on both sides
# have the same edge curve, if $h$ is the same for both: depths are counted in edges of the cage,
# not in parts of faces that may be split differently.
#
# Where another corner of the face has smaller cells, its lines go on through this one. The cell
# stays one polynomial, and control points that no other piece gives are blossoms of it.

# %%
h = symbols("h", positive=True)
for p in (2, 3, 4):
    unknown = symbols(f"c0:{p + 1}")
    curve = sum(k * x**m for m, k in enumerate(unknown))
    truth = symbols(f"f0:{p + 1}")
    conditions = [curve.diff(x, m).subs(x, h) - truth[m] for m in range(p)]
    conditions.append(curve.subs(x, 0) - truth[p])
    (solution,) = linsolve(conditions, unknown)
    assert not set(unknown) & set().union(*(value.free_symbols for value in solution))

# %% [markdown]
# ## 3. Triangles
#
# Pieces of triangles end along lines of three directions, which no tensor product spline has: each
# piece is a face of its own. A polynomial of total degree $p$ is one of degree $(p, p)$ over the
# square, whose coefficient $(k, m)$ is the mean of blossoms over all ways to pair $k$ ones and $p -
# k$ zeros along $u$ with $m$ ones along $v$; a pair $(1, 1)$ is $(1, 0) + (0, 1) - (0, 0)$, in
# which the blossom is affine.

# %%
u, v = symbols("u v")
for p in (1, 2, 4):
    matrix = square_of_triangle(p)
    places = [(i, j) for j in range(p + 1) for i in range(p + 1 - j)]
    for column, (i, j) in enumerate(places):
        rest = p - i - j
        bernstein = comb(p, i) * comb(p - i, j) * u**i * v**j * (1 - u - v) ** rest
        square = sum(
            Rational(matrix[k * (p + 1) + m, column]).limit_denominator(1000)
            * comb(p, k) * u**k * (1 - u) ** (p - k) * comb(p, m) * v**m * (1 - v) ** (p - m)
            for k in range(p + 1) for m in range(p + 1)
        )  # fmt: skip
        assert expand(bernstein - square) == 0

# %% [markdown]
# The cell at a special corner of a triangle is a quartic with 15 coefficients, in rows by their
# distance from the corner. The three rows that are farthest are those of the piece across the
# opposite side, gone on: so it is $C^2$ there. The two coefficients next to the corner are those of
# the pieces beside it, gone on along their edges alone; the last is the limit. On the sides of the
# cell rows two to four agree with the same: at the end of a side all pieces have the derivatives up
# to order 2 in common, and these determine three coefficients from there.
#
# ## 4. How far the cell is off
#
# Both the cell's polynomial and the limit on each piece of each ring in it are polynomials of the
# same degree: their difference is bounded by its Bernstein coefficients, on halves where that is
# far from what is found. It is computed relative to the limit of the corner, so that no digits are
# lost. From some ring on, the limit is within a distance of the corner that eigenvalues give, the
# polynomial within the hull of its coefficients, and their difference within the sum, which falls
# with each ring.
#
# The part of a difference $d$ along a normal $n$ that is within an angle $\theta$ of an axis $a$ is
# bounded by $|d \cdot n| \le |d \cdot a| + |n - a||d|$, with $|n - a| \le 2 \sin(\theta/2)$. Angles
# between normals are bounded as in [approximate](approximate.py), and by the cone of the limit's
# normals from a ring on, and that of the polynomial there, beyond the last ring.
#
# Beyond the last ring, that cone holds the partial sums of eigenfunctions in the order of their
# eigenvalues ([tessellation](tessellation.py), section 7): it is near at high valence as well.
#
# Across an edge the limit is not asked. On each stretch between knots both sides have derivatives
# that are polynomials of degree $p$ in the parameter $t$ along the edge, one along it, one across;
# $p + 1$ values of each give Bernstein coefficients, their cross products coefficients of normals
# of degree $2 p$, and the angle between these two is bounded as above, on halves where that is far
# from the angle at the ends. Values of derivatives err by $2^{-47}$ times the largest control point
# over the shortest knot interval: a slope is a sum of $(p + 1)^2$ products of control points and
# weights, whose sizes add up to $2 p$ over the interval at most, and coefficients by as much as the
# rows of the inverse matrix have. Points relative to the first one of the face are taken, so that
# it does not matter how far from the origin they are.

# %%
for p in (2, 3, 4):
    weights = np.zeros(p + 1)
    for share in np.linspace(0, 1, 33):
        low = [comb(p - 1, k) * share**k * (1 - share) ** (p - 1 - k) for k in range(p)]
        weights = np.append(0, p * np.array(low)) - np.append(p * np.array(low), 0)
        assert np.abs(weights).sum() <= 2 * p + 1e-12

# %% [markdown]
# The surface is self-similar: the difference falls with each level like the subdominant eigenvalue
# $\lambda$, along the normal like $\mu$, the largest that is not in the tangent plane, and angles
# like $\mu/\lambda$. At valence 3, $\lambda = 0.410$, and at corners of a cube $\mu = 1/6$.

# %%
points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
cube = LimitSurface(Mesh(points, quads))
rng = np.random.default_rng(0)
errors, normals, angles = [], [], []
for depth in range(4, 10):
    faces = bspline_faces(cube, depth=depth)
    _, bounds = faces.cap_errors
    errors.append(bounds.parametric.max())
    normals.append(bounds.along_normal.max())
    angles.append(bounds.angle.max())
    s, r = rng.random((2, 4000)) * 0.5**depth
    step = faces.evaluate(0, s, r) - cube.evaluate(0, s, r)
    truth, other = cube.normal(0, s, r), faces.normal(0, s, r)
    assert np.linalg.norm(step, axis=1).max() <= errors[-1] < 1.2 * bounds.parametric_found.max()
    assert np.abs((step * truth).sum(axis=1)).max() <= normals[-1]
    assert np.arccos(np.clip((truth * other).sum(axis=1), -1, 1)).max() <= angles[-1] + 1e-7
rate = 0.41009702
assert np.allclose(np.divide(errors[1:], errors[:-1]), rate, atol=2e-3)
assert np.allclose(np.divide(normals[1:], normals[:-1]), 1 / 6, atol=1e-2)
assert np.allclose(np.divide(angles[1:], angles[:-1]), 1 / 6 / rate, atol=2e-2)

# %% [markdown]
# ## 5. How few rectangles there are
#
# Where the border of a region of regular faces has corners around one face ($V$ of them) and around
# three ($R$), $n$ rectangles that fill it have $4 n$ corners. Each of the first kind takes one,
# each of the second at least one: $n \ge (V + R) / 4$. A line from each of the latter makes
# rectangles of the region: it ends at a border or another line, with two more corners of
# rectangles, or at another such corner, with none. So lines between two of them come first. Around
# a disc $V = R + 4$.
#
# Each of $C$ lines that join two such corners, and cross none of each other, spares a rectangle.
# The most such lines are an independent set of the graph of crossings. Lines of two directions
# cross each other only, so that it is bipartite, and by König's theorem they are all lines but as
# many as a largest matching has pairs: H. Imai, T. Asano, "Efficient algorithms for geometric graph
# search problems", SIAM Journal on Computing 15 (1986). Around holes and poles lines of a mesh may
# come around to cross one of their own kind: colouring finds such parts of the graph, and there the
# shortest lines come first.
#
# Where a cut ends within the region, at a regular vertex straight on from a pole, four faces are
# around. The line straight on adds no corner where it begins, and two where it ends, or none at
# another such end: a line from pole to pole spares a rectangle as well.

# %%
reflex, chords = symbols("R C", integer=True)
convex = reflex + 4
ends = reflex - 2 * chords  # of lines, on sides
assert expand((convex + reflex + 2 * ends) / 4 - (reflex + 1 - chords)) == 0

# %% [markdown]
# ## 6. Why triangles are not merged
#
# Across a line of its mesh Loop's box spline is $C^2$ and no more: on both sides of the diagonal
# $u = v$ between two triangles quartics differ by $(u - v)^3$ times a linear polynomial. A tensor
# product spline is one polynomial between neighbouring knots, wherever these are, and the diagonal
# crosses such rectangles: it has no jump of $\partial^3 / \partial u^2 \partial v$ there, and
# the box spline has one, unless control points are special.

# %%
u, v, c, d, e = symbols("u v c d e")
step = (u - v) ** 3 * (c + d * u + e * v)
jump = expand(diff(step, u, 2, v).subs(v, u))
assert expand(jump + 6 * (c + (d + e) * u)) == 0
