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
"""Sharpness: blended rules, chaikin creasing, the strips of semi-sharp creases, smooth triangles.

After DeRose, Kass and Truong (1998), Chaikin (1974) and Niessner, Loop and Greiner (2012).

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Sharpness
#
# The rules of `limitsurf/exact/creases.py` are definitions, taken from DeRose, Kass and Truong in
# the form that OpenSubdiv and USD gave them. This document derives what follows from them and what
# the library computes with:
#
# 1. vertex points as shares of three masks, and how they depend on the sharpness;
# 2. "chaikin" creasing: sharpness along a crease is a quadratic B-spline, lowered by 1 a level;
# 3. the pieces of a strip, twice continuously differentiable, and affine in the fraction of the
#    sharpness;
# 4. how round a semi-sharp edge is: a radius of the order of $2^{-s}$;
# 5. the triangle rule "smooth".
#
# The surface beside sharp and semi-sharp creases is derived in [creases](creases.py), what is left
# after isolation in [isolation](isolation.py). Parts 2 to 4 are symbolic; part 1 is compared with
# the library for all combinations of some sharpnesses.
#
# - T. DeRose, M. Kass, T. Truong, "Subdivision surfaces in character animation", SIGGRAPH 1998:
#   semi-sharp creases and the averaging of sharpness along them.
# - G. Chaikin, "An algorithm for high-speed curve generation", Computer Graphics and Image
#   Processing 3 (1974): corner cutting; R. Riesenfeld, "On Chaikin's algorithm", ibid. 4 (1975).
# - M. Niessner, C. Loop, G. Greiner, "Efficient evaluation of semi-smooth creases in Catmull-Clark
#   subdivision surfaces", Eurographics 2012 short papers: strips across a semi-sharp crease.

# %%
from fractions import Fraction
from itertools import pairwise, product

import numpy as np
from sympy import Matrix, Rational, binomial, expand, symbols

import limitsurf as ls
from limitsurf.exact.creases import CHAIKIN, strip_pieces
from limitsurf.patches import STRIP
from limitsurf.scheme.catmull_clark import CATMULL_CLARK

HALF, EIGHTH = Rational(1, 2), Rational(1, 8)
t, w = symbols("t w")

# %% [markdown]
# ## 1. Shares of three masks
#
# A vertex point is made by one of three masks: the smooth one $\mathcal S$, that of a crease along
# two edges to $a$ and $b$, $\mathcal K = (6 v + a + b) / 8$, and the corner $\mathcal C = v$. Where
# the children of the vertex follow another mask than itself, the point is
#
# $$ w\, \mathcal M_{\text{parent}} + (1 - w)\, \mathcal M_{\text{child}}, $$
#
# $w$ the mean, at most 1, of the sharpnesses that fall to zero. What is smooth stays so, so the
# masks can only go from corner to crease to smooth. The library stores the shares of $\mathcal S$
# and $\mathcal C$, and for each sharp edge the share of the crease mask that runs along it, each of
# the two edges bringing half of that mask, $3/8\, v + 1/8\, a$:
#
# | parent, child | $\mathcal S$ | $\mathcal C$ | along the edges |
# |---|---|---|---|
# | the same | 1 or 0 | 0 or 1 | 1 on both, if crease |
# | crease, smooth | $1 - w$ | 0 | $w$ on both |
# | corner, smooth | $1 - w$ | $w$ | 0 |
# | corner, crease | 0 | $w$ | $1 - w$ on the two that stay |
#
# In each row the weights of all points add up to 1, as $\mathcal S + \mathcal C$ and half of
# the last column do. Compared with the library: all combinations of these sharpnesses on the edges
# and on the vertex itself, around vertices of valence 3 and 4, in Fractions:


# %%
def star(n):
    """Quads around vertex 0; edge neighbours are 1, 3, 5 ..."""
    return [[0, 1 + 2 * j, 2 + 2 * j, 1 + 2 * ((j + 1) % n)] for j in range(n)]


def point_by_words(n, own, edges):
    """Weights of the vertex point of a star, by the definition."""

    def mask(own_, edges_):
        sharp = [j for j in range(n) if edges_[j] > 0]
        row = [Fraction(0)] * (2 * n + 1)
        if own_ > 0 or len(sharp) > 2:
            row[0] = Fraction(1)
        elif len(sharp) == 2:
            row[0] = Fraction(3, 4)
            for j in sharp:
                row[1 + 2 * j] = Fraction(1, 8)
        else:  # smooth, or a dart
            row[0] = 1 - Fraction(7, 4 * n)
            for j in range(n):
                row[1 + 2 * j], row[2 + 2 * j] = Fraction(3, 2 * n * n), Fraction(1, 4 * n * n)
        return row

    later = [max(s - 1, 0) for s in edges]
    parent, child = mask(own, edges), mask(max(own - 1, 0), later)
    falling = [s for s in (own, *edges) if 0 < s <= 1]
    share = min(sum(falling) / len(falling), 1) if falling else 1
    return [share * p + (1 - share) * c for p, c in zip(parent, child, strict=True)]


VALUES = [Fraction(0), Fraction(1, 3), Fraction(1), Fraction(5, 2)]
CASES = [(3, own, edges) for own in VALUES for edges in product(VALUES, repeat=3)]
CASES += [(4, Fraction(0), edges) for edges in product(VALUES[1:], repeat=4)]
for n, own, edges in CASES:
    points = [[Fraction(0)]] * (2 * n + 1)
    creases = {(0, 1 + 2 * j): s for j, s in enumerate(edges)}
    mesh = ls.Mesh(points, star(n), creases=creases, corners={0: own})
    _, operator = ls.refined(mesh, operator=True)
    assert operator.toarray()[0].tolist() == point_by_words(n, own, edges)

# %% [markdown]
# **Continuity.** A crease of one sharpness $s$ along two edges has $w = \min(1, s)$ at each level,
# with $s - 1$ at the next. At $s = 1$ the formulas for $s < 1$ and $s > 1$ agree: a full step, then
# smooth ones. So the surface depends continuously on $s$, and between whole numbers the masks are
# affine in it. Where three and more edges of different sharpness meet, the rule itself is not
# continuous: with sharpnesses $5$, $0.6$ and $\varepsilon$ it is a corner that becomes a dart,
# $w = (0.6 + \varepsilon) / 2$; with $\varepsilon = 0$ a crease that becomes a dart, $w = 0.6$:

# %%
three = point_by_words(3, 0, (Fraction(5), Fraction(3, 5), Fraction(1, 10**9)))
two = point_by_words(3, 0, (Fraction(5), Fraction(3, 5), Fraction(0)))
assert abs(three[0] - two[0]) > Fraction(1, 100)
for s in (Fraction(1) - Fraction(1, 10**9), Fraction(1) + Fraction(1, 10**9)):
    near, at_one = (point_by_words(3, 0, (x, x, Fraction(0))) for x in (s, Fraction(1)))
    assert max(abs(a - b) for a, b in zip(near, at_one, strict=True)) < Fraction(1, 10**8)

# %% [markdown]
# An *edge point* of sharpness $s < 1$ is $s$ times the midpoint and $1 - s$ times the smooth one,
# unless both halves stay sharp, when it is the midpoint. Under "uniform" the halves have
# $s - 1 \le 0$, and this never happens; under "chaikin" it can.
#
# ## 2. Chaikin creasing
#
# Let sharpnesses $s_i$ follow each other along a crease. The halves of edge $i$ get
#
# $$ \tfrac34 s_i + \tfrac14 s_{i-1} - 1, \qquad \tfrac34 s_i + \tfrac14 s_{i+1} - 1 $$
#
# (not below 0; at an end with no other semi-sharp edge, $s_i - 1$; with several others, their mean
# in place of $s_{i \pm 1}$). But for the $-1$ that is Chaikin's corner cutting: knot insertion for
# uniform quadratic B-splines, whose two-scale weights are $\binom3k / 4$.

# %%


def b_spline(degree):
    """Polynomial pieces of the uniform B-spline with knots 0, 1, ... (Cox and de Boor)."""
    if degree == 0:
        return [Rational(1)]
    lower = b_spline(degree - 1)
    rising = [*(t * piece / degree for piece in lower), 0]
    falling = [0, *((degree + 1 - t) * piece.subs(t, t - 1) / degree for piece in lower)]
    return [expand(a + b) for a, b in zip(rising, falling, strict=True)]


pieces = b_spline(2)
weights = [binomial(3, k) / 4 for k in range(4)]
for half in range(6):
    finer = sum(
        weights[k] * pieces[half - k].subs(t, 2 * t - k) for k in range(4) if 0 <= half - k < 3
    )
    assert expand(pieces[half // 2] - finer) == 0
# new control points by parity: c'_{2i} = w_0 c_i + w_2 c_{i-1}, c'_{2i+1} = w_1 c_i + w_3 c_{i-1}
assert (weights[0], weights[2]) == tuple(reversed([Rational(x) for x in CHAIKIN]))
assert (weights[1], weights[3]) == tuple(Rational(x) for x in CHAIKIN)

# %% [markdown]
# Taking 1 away commutes with averages whose weights add up to 1. So as long as nothing along the
# crease reaches 0,
#
# $$ s^{(m)} = \text{Chaikin}^m(s) - m , $$
#
# control points of the quadratic B-spline with control points $s_i$: the sharpness that is felt at
# a place of the crease is the value of that spline there. Averages do not exceed the largest, so
#
# $$ \max s^{(m)} \le \max(\max s - m, 0) , $$
#
# whatever meets at the vertices, and after $\lceil \max s \rceil$ levels nothing is semi-sharp:
# [isolation](isolation.py), part 5. Where all are equal it is the uniform rule. Means of three
# numbers are not binary fractions, and rules change where a sharpness becomes 0, so the library
# averages in Fractions. Checked on the middle line of a grid, whose first and last edge have a free
# end:

# %%
LENGTH, SHARP = 5, [Fraction(x, 2) for x in (5, 9, 3, 4, 12)]
grid = [
    [3 * i + j, 3 * i + j + 3, 3 * i + j + 4, 3 * i + j + 1] for i in range(LENGTH) for j in (0, 1)
]
line = [3 * i + 1 for i in range(LENGTH + 1)]
# boundaries are sharp: the ends of the line are corners of three sharp edges, and stay so
tags = dict(zip(pairwise(line), SHARP, strict=True))
mesh = ls.Mesh([[Fraction(0)]] * (3 * LENGTH + 3), grid, creases=tags, creasing="chaikin")
expected = SHARP
for level in (1, 2, 3):
    ends = [expected[0], *expected, expected[-1]]
    expected = [
        max(Fraction(3, 4) * ends[i] + Fraction(1, 4) * ends[i + step] - 1, Fraction(0))
        for i in range(1, len(ends) - 1)
        for step in (-1, 1)
    ]
    edges, sharpness = ls.refined(mesh, levels=level).creases
    found = [Fraction(s) for s in sharpness if 0 < s < 10]
    assert sorted(found) == sorted(s for s in expected if s > 0)

# %% [markdown]
# ## 3. Strips
#
# By [creases](creases.py) (part 3) a face beside a straight semi-sharp crease of sharpness $s$,
# depth $d = \lceil s \rceil$, is a product: uniform along, and across a spline with the $d + 1$
# pieces $[1/2, 1], [1/4, 1/2], \ldots, [0, 2^{-d}]$. Piece $i \le d$ hangs on rows $1 \ldots 4$ of
# the five rows after $i$ steps, the last one on rows $0 \ldots 3$ after $d$ steps. A step is the
# matrix
#
# $$ Z_w = \begin{pmatrix}
#    \frac12 & \frac12 & 0 & 0 \\
#    \frac{1 - w}8 & \frac{6 + 2 w}8 & \frac{1 - w}8 & 0 \\
#    0 & \frac12 & \frac12 & 0 \\
#    0 & \frac18 & \frac68 & \frac18 \\
#    0 & 0 & \frac12 & \frac12
#    \end{pmatrix} $$
#
# with $w = 1$ in all steps but the last, where $w = s - (d - 1)$. The library's tables are these
# polynomials, for symbolic $w$ by their values at 0 and 1, since they are affine in $w$:

# %%
cubic = [(1 - t) ** 3 / 6, (3 * t**3 - 6 * t**2 + 4) / 6]
cubic += [weight.subs(t, 1 - t) for weight in reversed(cubic)]
cubic = Matrix([[expand(weight) for weight in cubic]])


def step(share):
    return Matrix(
        [
            [HALF, HALF, 0, 0],
            [(1 - share) * EIGHTH, (6 + 2 * share) * EIGHTH, (1 - share) * EIGHTH, 0],
            [0, HALF, HALF, 0],
            [0, EIGHTH, 6 * EIGHTH, EIGHTH],
            [0, 0, HALF, HALF],
        ]
    )


def strip(depth):
    """Rows of polynomials in the piece's own parameter, the last step with share w."""
    rows, found = Matrix.eye(4), []
    for k in range(depth):
        five = step(w if k == depth - 1 else 1) * rows
        found.append((cubic * five[1:, :]).expand())
        rows = five[:4, :]
    return [*found, (cubic * rows).expand()]


def polynomials(piece):
    """Its four polynomials from coefficients of powers."""
    return Matrix([[t**i for i in range(4)]]) * Matrix(
        [[Rational(x) for x in row] for row in piece]
    )


for depth in range(1, 11):
    smooth, sharp = (strip_pieces(CATMULL_CLARK, depth, Fraction(share)) for share in (0, 1))
    for derived, low, high in zip(strip(depth), smooth, sharp, strict=True):
        low, high = polynomials(low), polynomials(high)
        assert (derived - low - w * (high - low)).expand() == Matrix.zeros(1, 4)

# %% [markdown]
# The pieces join with two continuous derivatives: neighbouring ones share the three rows around
# their common knot, up to knot insertion away from the crease. And at the crease itself the last
# piece is an ordinary spline, and so is its mirror image on the other side, on the same rows
# $0, 1, 2$: **a surface with a straight semi-sharp crease is twice continuously differentiable
# everywhere.** Symbolically in $w$, derivatives with respect to the parameter of the face:

# %%
for depth in range(1, 7):
    joined = strip(depth)
    widths = [Rational(1, 2**k) for k in range(1, depth + 1)] + [Rational(1, 2**depth)]
    for outer, inner, wide, narrow in zip(joined, joined[1:], widths, widths[1:], strict=False):
        for order in range(3):
            there = outer.diff(t, order).subs(t, 0) / wide**order
            here = inner.diff(t, order).subs(t, 1) / narrow**order
            assert (there - here).expand() == Matrix.zeros(1, 4)

# %% [markdown]
# **Under "chaikin".** A strip asks that the crease has the sharpness $s$ on the face's edge and on
# the edges before and after it, and that no other edge at its two ends is sharp. Is this enough, if
# farther edges have other sharpnesses? The half of the edge before that ends at the face gets
# $\frac34 s + \frac14 s - 1$, as do both halves of the face's own edge: $s - 1$, at every level.
# The other half may get another sharpness; it lies beyond the points that the next level needs, and
# enters only by the clause that an edge point is the midpoint if both halves stay sharp. For
# $s > 1$ it is the midpoint anyway, and for $s \le 1$ the half at the face falls to 0. So the
# product is that of the uniform rule. The library's strips against its limits of refined vertices,
# in Fractions:

# %%
count = 7
levels = [Fraction(1), Fraction(19, 2), *[Fraction(5, 2)] * 3, Fraction(1, 3), Fraction(7)]
grid = [
    [5 * i + k, 5 * i + k + 5, 5 * i + k + 6, 5 * i + k + 1] for i in range(count) for k in range(4)
]
points = [[Fraction((7 * k * k + a * k + 3) % 23) for a in range(3)] for k in range(5 * count + 5)]
line = [5 * i + 2 for i in range(count + 1)]
tags = dict(zip(pairwise(line), levels, strict=True))
for creasing in ("uniform", "chaikin"):
    mesh = ls.Mesh(points, grid, creases=tags, creasing=creasing)
    surface = ls.LimitSurface(mesh)
    beside = [4 * 3 + 1, 4 * 3 + 2]  # both faces at the middle edge
    patches = surface.patches
    assert patches.kind[patches.codes[beside]].tolist() == [STRIP, STRIP]
    fine = ls.refined(mesh, levels=2)
    inside = np.isin(fine.parent_face, beside)
    places = (x[inside] for x in (fine.parent_face, fine.parent_u, fine.parent_v))
    assert (fine.limit_points[inside] == surface.evaluate(*places)).all()

# %% [markdown]
# ## 4. How round
#
# Across the crease let the rows be $r_0$, $r_1$ (the crease), $r_2$, and
# $\Delta = r_0 - 2 r_1 + r_2$, which is zero only if the cage does not bend there. For a whole
# number $s = d$ of sharp steps $r_1$ stays and the neighbours come half as close each time, so
# $\Delta$ halves each time. The second derivative of a uniform cubic spline at a knot is $\Delta$,
# in the parameter of the piece, so in that of the face
#
# $$ \partial_t^2 X = 4^d \cdot 2^{-d} \Delta = 2^d \Delta \quad \text{at the crease}, $$
#
# while $\partial_t X$ stays bounded: the curvature across grows like $2^s$, the edge is rounded
# with a radius of the order of $2^{-s}$, over a width of the order of $2^{-s}$ to both sides. With
# a fraction the last step is a blend, and the factor depends on $w$ (and is $2^d$ at $w = 1$):

# %%
defect = Matrix([[1, -2, 1, 0]])
assert defect * step(1)[:4, :] == defect / 2
for depth in range(1, 7):
    bend = (strip(depth)[-1].diff(t, 2).subs(t, 0) * 4**depth).expand()
    factor = bend[0]
    assert bend == factor * defect
    assert factor.subs(w, 1) == 2**depth
    assert expand(factor - 2 ** (depth - 1) * (1 + w)) == 0

# %% [markdown]
# So the factor is $2^{d-1} (1 + w)$: it goes linearly from one power of two to the next, and is
# continuous in $s$.
#
# ## 5. Triangles
#
# Under the triangle rule "smooth" an edge point at triangles is
#
# $$ \Big( \tfrac12 - f \Big) (a + b) + f\, (p + q), \qquad f = \tfrac12 (f_p + f_q), $$
#
# with $f_p = 0.47$ for a triangle and $0.25$ for other faces: the weights add up to 1, it is the
# usual mask if none of the faces is a triangle, and as all faces are quads after one refinement it
# acts once only. So limits and eigenvalues are what they are; only the first ring of points
# differs. The number 0.47 is OpenSubdiv's and has no derivation here. Compared with the library for
# an edge of two triangles, of a triangle and a quad, and of two quads:

# %%
assert CATMULL_CLARK.smooth_triangle == Fraction(47, 100)
faces = [[0, 1, 4, 3], [1, 2, 4], [2, 5, 4], [3, 4, 7, 6], [4, 5, 8, 7]]
mesh = ls.Mesh([[Fraction(0)]] * 9, faces, triangles="smooth")
_, operator = ls.refined(mesh, operator=True)
rows = operator.toarray()
for ends, (first, second) in (((2, 4), (1, 2)), ((1, 4), (0, 1)), ((3, 4), (0, 3))):
    shares = [Fraction(47, 100) if len(faces[k]) == 3 else Fraction(1, 4) for k in (first, second)]
    f = sum(shares) / 2
    expected = [Fraction(0)] * 9
    for end in ends:
        expected[end] += Fraction(1, 2) - f
    for k in (first, second):
        for corner in faces[k]:
            expected[corner] += f / len(faces[k])
    (number,) = mesh.edge_numbers(np.array([ends]))
    assert sum(expected) == 1
    assert rows[9 + number].tolist() == expected
