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
"""Finite elements on limit surfaces: ghosts, dependent functions, orders, graded spaces.

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Finite elements on limit surfaces
#
# The basis functions of a cage are finite elements on its limit surface. This document derives
#
# 1. ghost faces: beyond regular boundaries the limit is that of a larger cage, whose outer vertices
#    are reflections, whatever is further inside;
# 2. that basis functions can be linearly dependent;
# 3. how fast functions are approximated at poles;
# 4. which functions of several levels make one space, and what that does at poles;
# 5. how the error of a solution is told without knowing it.
#
# - F. Cirak, M. Ortiz, P. Schröder, "Subdivision surfaces: a new paradigm for thin-shell
#   finite-element analysis", Int. J. Numer. Meth. Engng 47, 2000: ghost vertices.
# - U. Reif, J. Peters, *Subdivision Surfaces*, Springer 2008, chapters 4 and 5: rings, subdominant
#   eigenvalue, why curvature asks for the eigenvalue $\lambda^2$.
# - R. Kraft, *Adaptive und linear unabhängige Multilevel B-Splines*, Stuttgart 1998: the selection.
# - C. Giannelli, B. Jüttler, H. Speleers, "THB-splines: the truncated basis for hierarchical
#   splines", Comput. Aided Geom. Design 29, 2012; X. Wei, Y. Zhang, T. Hughes, M. Scott, "Truncated
#   hierarchical Catmull-Clark subdivision", Comput. Methods Appl. Mech. Engrg 291, 2015.
# - R. Verfürth, *A Posteriori Error Estimation Techniques for Finite Element Methods*, Oxford 2013.

# %%
import numpy as np
from sympy import Rational, Symbol, expand, symbols

import limitsurf as ls

# %% [markdown]
# ## 1. Ghost faces
#
# Masks of Catmull and Clark are those of [bicubic splines](masks_bicubic.py). Let $b$ be a boundary
# vertex between two quads, $b_-$ and $b_+$ its neighbours on the boundary, $i_-, i, i_+$ those in
# the next row. With $g = 2 b - i$ beyond each of them the boundary is in the midst of quads.

# %%
row = b_, b, b1 = symbols("b_- b b_+")
inner = i_, i, i1 = symbols("i_- i i_+")
ghost = g_, g, g1 = [2 * x - y for x, y in zip(row, inner, strict=True)]


def face(*corners):
    return sum(corners) / 4


def edge(a, c, *faces):
    return (a + c + sum(faces)) / 4


def vertex(v, edges, diagonals):
    return Rational(9, 16) * v + Rational(3, 32) * sum(edges) + Rational(1, 64) * sum(diagonals)


# %% [markdown]
# One step by the masks inside moves the vertices of the boundary as its own rules do, and leaves
# reflections what they were: of face points at the midpoint of their edge, of edge points at the
# new vertex. The masks of these ask for no valence, so that $i$ may be extraordinary; and what they
# use is at $b$ and its two faces, so that it does not matter what is further inside.

# %%
new = vertex(b, [b_, b1, i, g], [i_, i1, g_, g1])
assert expand(new - (b_ + 6 * b + b1) / 8) == 0
inside, outside = face(b, b1, i1, i), face(b, b1, g1, g)
assert expand(inside + outside - (b + b1)) == 0
assert expand(edge(b, b1, inside, outside) - (b + b1) / 2) == 0
across = edge(b, i, face(b_, b, i, i_), inside)
beyond = edge(b, g, face(b_, b, g, g_), outside)
assert expand(across + beyond - 2 * new) == 0

# %% [markdown]
# The new face points stand beyond the new edge points of the boundary, at $(b + b_+) / 2$, the new
# edge points beyond the new vertex: that is the same picture at half the size.
#
# At a sharp corner $c$ of one quad $(c, p, d, q)$ the ghosts are $2 c - q$ and $2 c - p$ beyond its
# edges and $4 c - 2 p - 2 q + d$ beyond the vertex.

# %%
c, p, d, q = symbols("c p d q")
past_q, past_p, diagonal = 2 * c - q, 2 * c - p, 4 * c - 2 * p - 2 * q + d
past_qp, past_pq = 2 * p - d, 2 * q - d  # beyond p across its edge, and beyond q
corner = vertex(c, [p, q, past_q, past_p], [d, past_qp, past_pq, diagonal])
assert expand(corner - c) == 0
own = face(c, p, d, q)
faces = {"q": face(c, p, past_q, past_qp), "p": face(c, q, past_p, past_pq)}
last = face(c, past_q, past_p, diagonal)
new_p, new_q = edge(c, p, own, faces["q"]), edge(c, q, own, faces["p"])
assert expand(new_p - (c + p) / 2) == 0
assert expand(new_q - (c + q) / 2) == 0
assert expand(edge(c, past_q, faces["q"], last) - (2 * c - new_q)) == 0
assert expand(last - (4 * c - 2 * new_p - 2 * new_q + own)) == 0

# %% [markdown]
# So at every level, and in the limit, both cages have the same faces. Beside other boundary
# vertices there are no such points ([creases](creases.py)): `extended` refuses these, and spaces
# are natural there.
#
# As functions of their own ghosts span what the boundary rules leave out. On the line across the
# boundary the second derivative there is $g - 2 b + i$, 0 for reflections: a function $f$ is
# approximated in the last cell of size $h$ to $O(h^2 f'')$ and not $O(h^4)$. On a strip of width
# $h$ that is an error in $L^2$ of order $h^{2.5}$, in $H^1$ of order $h^{1.5}$.

# %%
x, h = Symbol("x"), Symbol("h", positive=True)
pieces = [  # cubic B-splines over the knots -1, 0, 1 at x in [0, h]
    (1 - x / h) ** 3 / 6,
    Rational(2, 3) - (x / h) ** 2 + (x / h) ** 3 / 2,
    Rational(1, 6) + (x / h + (x / h) ** 2 - (x / h) ** 3) / 2,
    (x / h) ** 3 / 6,
]
line = sum(k * n for k, n in zip((g, b, i, Symbol("j")), pieces, strict=True))
assert expand(line.diff(x, 2).subs(x, 0)) == 0

# %% [markdown]
# Where a boundary has a vertex that is not regular, ghosts elsewhere still are free, if those on
# which faces at this vertex depend are reflections. On a face beside them, over $[0, 1]^2$ with the
# vertex far to the right, a free ghost at the left end of its sixteen control points has weights
# $u^3 / 6$ of the distance $u$ from the edge to the next face: they vanish there with two
# derivatives, so that functions stay smooth.

# %%
far = pieces[3].subs(x, h)
assert [pieces[3].diff(x, k).subs(x, 0) for k in range(3)] == [0, 0, 0]
assert far == Rational(1, 6)

# %% [markdown]
# An infinitely sharp crease is a boundary of what is on either side, where both have one value. Let
# $b$ be a control point of one side there, $i$ inside and $g = 2 b - i + d$ beyond. The curve of
# the crease is a cubic spline with control points $s = (i + 4 b + g) / 6 = b + d / 6$: it is the
# same for both sides if $s$ is, whatever $d$ on each. Unknowns are $s$ for both sides, and for each
# of them $2 s - i + d$, which is a point like others, since constants have equal unknowns.

# %%
bend = Symbol("d")
beyond = 2 * b - i + bend
assert expand((i + 4 * b + beyond) / 6 - (b + bend / 6)) == 0

# %% [markdown]
# Where creases meet in a sharp corner $c$ of a face $(c, p, e, q)$, with $d_p$ and $d_q$ of the
# ghosts beyond $c$ along $p$ and along $q$, and $D$ the last ghost, the curve along $p$ begins with
# control points $s_{-1}$ and $s_0$, its second difference is $\delta_p$, and the value $v$ at the
# corner is $s_0 + \delta_p / 6$. Given $v$, $\delta_p$ and $\delta_q$, which faces share, a face
# has one more, $c$; $d_p$, $d_q$ and $D$ follow.

# %%
v, dp, dq, last = symbols("v delta_p delta_q D")
c, p, e, q, rp, rq = symbols("c p e q r_p r_q")  # r: ghosts of p beyond c p, and of q beyond c q
along_q, along_p = 6 * (v - c) - dp, 6 * (v - c) - dq  # deviations d_q and d_p
ghost_q, ghost_p = 2 * c - q + along_q, 2 * c - p + along_p
total = last + 4 * ghost_p + rq + 4 * (ghost_q + 4 * c + q) + rp + 4 * p + e
(found,) = [36 * v - (total - last)]
for ghosts, middle, ends in (
    ((found, ghost_p, rq), (ghost_q, c, q), (rp, p, e)),  # along p, from before c to p
    ((found, ghost_q, rp), (ghost_p, c, p), (rq, q, e)),
):
    curve = [(k[0] + 4 * k[1] + k[2]) / 6 for k in (ghosts, middle, ends)]
    delta = dp if ends[1] == p else dq
    assert expand(curve[0] - 2 * curve[1] + curve[2] - delta) == 0
    assert expand(curve[1] + delta / 6 - v) == 0

# %% [markdown]
# A cube with all edges sharp has 8 values, $2 \cdot 12$ differences and one point for each of 24
# corners: 56 functions, as many as continuous ones of six faces of $4 \times 4$ functions.

# %%
assert 8 + 2 * 12 + 24 == (8 + 12 * 2) + 6 * (16 - 12)

# %% [markdown]
# ### Triangles
#
# Loop's rules are those of the quartic box spline. Beyond a side from $b$ to $b_+$ of a triangle
# $(b, b_+, i)$ let the ghost be $g = b + b_+ - i$. At a boundary vertex of three triangles that
# makes six around it, and the masks inside do what the rules of boundaries do.


# %%
def box_vertex(v, around):
    return Rational(5, 8) * v + sum(around) / 16


def box_edge(a, c, *opposite):
    return Rational(3, 8) * (a + c) + sum(opposite) / 8


before, behind = b_ + b - i_, b + b1 - i  # beyond the sides b_ b, of (b_, b, i_), and b b_+
new = box_vertex(b, [b_, b1, i_, i, before, behind])
assert expand(new - (b_ + 6 * b + b1) / 8) == 0
middle = box_edge(b, b1, i, behind)
assert expand(middle - (b + b1) / 2) == 0
within, outside = box_edge(b, i, b1, i_), box_edge(b, behind, b1, before)
assert expand(outside - (new + middle - within)) == 0

# %% [markdown]
# At a sharp corner $c$ of one triangle $(c, p, q)$ these are $c + p - q$ and $c + q - p$; two more
# make six: $2 c - p$ and $2 c - q$.

# %%
c, p, q = symbols("c p q")
past_p, past_q, of_p, of_q = c + p - q, c + q - p, 2 * c - p, 2 * c - q
assert expand(box_vertex(c, [p, q, past_q, of_p, of_q, past_p]) - c) == 0
new_p, new_q = box_edge(c, p, q, past_p), box_edge(c, q, p, past_q)
assert expand(new_p - (c + p) / 2) == 0
assert expand(new_q - (c + q) / 2) == 0
assert expand(box_edge(c, past_p, p, of_q) - (c + new_p - new_q)) == 0
assert expand(box_edge(c, past_q, q, of_p) - (c + new_q - new_p)) == 0
assert expand(box_edge(c, of_p, past_q, of_q) - (2 * c - new_p)) == 0
assert expand(box_edge(c, of_q, past_p, of_p) - (2 * c - new_q)) == 0

# %% [markdown]
# A sharp corner of two triangles $(c, p, m)$ and $(c, m, q)$ has no such points: the value at $c$
# asks for the sixth $4 c - 2 p - 2 q + m$ beside $c + p - m$ and $c + q - m$, and then the next
# step's ghosts are no reflections unless $c + m = p + q$.

# %%
m = Symbol("m")
past_p, past_q, sixth = c + p - m, c + q - m, 4 * c - 2 * p - 2 * q + m
assert expand(box_vertex(c, [p, m, q, past_p, past_q, sixth]) - c) == 0
off = box_edge(c, past_p, p, sixth) - (c + (c + p) / 2 - box_edge(c, m, p, q))
assert expand(off - (c + m - p - q) / 8) == 0

# %% [markdown]
# A ghost at one of the three places $g$ has influence on faces at $b$ and $b_+$ alone, so that it
# is free if no face there is natural. Along creases the functions of both sides are one on a
# boundary whose trace has two unknowns a side, of $b$ and of $i + g$; these are not parted.
#
# ### Dual schemes
#
# Doo and Sabin's functions are biquadratic, and belong to corners of faces. On the line across a
# boundary at $b$ the piece next to it is $((1/2 - t)^2 g + (3/2 - 2 t^2) b + (1/2 + t)^2 i) / 2$
# for $t \in [0, 1/2]$: with $g = 2 b - i$ its value at the boundary is $b$ and its second
# derivative 0. One step makes these points vertices of the finer cage, whose limit ends inside its
# faces: from level 1 on they are unknowns, and ends are free, whatever is asked for.

# %%
t = Symbol("t")
half = Rational(1, 2)
piece = ((half - t) ** 2 * g + (3 * half - 2 * t**2) * b + (half + t) ** 2 * i) / 2
assert expand(piece.subs(t, 0) - b) == 0
assert expand(piece.diff(t, 2)) == 0

# %% [markdown]
# ## 2. Functions that vanish
#
# Around a vertex of valence 3 the subdivision matrix has the eigenvalue 0
# ([eigenstructure](eigenstructure.py)). If all vertices are such and no cycle is odd, as on a cube,
# then $1$ and $-1$ by turns vanish after one step. A mass matrix over that cage is singular; over
# the refined one it is not.

# %%
points = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
cube = ls.Mesh(points, quads)
_, step = ls.refined(cube, operator=True)
by_turns = (-1.0) ** points.sum(axis=1)
assert abs(step @ by_turns).max() < 1e-15
surface = ls.LimitSurface(cube)
for levels, rank in ((0, 7), (1, 26)):
    mass = ls.Space(surface, levels=levels).mass().toarray()
    assert np.linalg.matrix_rank(mass, tol=1e-12) == rank

# %% [markdown]
# ## 3. Orders at poles
#
# In coordinates $y$ of the characteristic map around a pole, ring $n$ is $\lambda^n$ times ring 0.
# In them the surface is smooth enough that a smooth function has an expansion in powers: constants
# and linear ones are among the eigenfunctions, of eigenvalues 1 and $\lambda$. A quadratic one is
# $\lambda^{2 n}$ times itself from ring 0 to ring $n$; among eigenfunctions it could be of
# eigenvalue $\lambda^2$ alone, which at a pole there is not:

# %%
rate = {}
for n in (3, *range(5, 21)):
    values = np.abs(np.asarray(ls.eigenbasis("catmull-clark", valence=n).float64.eigenvalues))
    rate[n] = np.sort(values)[-2]
    assert abs(values - rate[n] ** 2).min() > 1e-3
regular = np.abs(np.asarray(ls.eigenbasis("catmull-clark", valence=4).float64.eigenvalues))
assert abs(regular - 0.5**2).min() < 1e-12

# %% [markdown]
# After $k$ refinements ring $n \le k$ has cells of $2^{-(k - n)}$ of its own size, where quadratics
# of $y$ are as any smooth function of the parameters. Relative to their size, $\lambda^{2 n}$, they
# are approximated to $16^{-(k - n)}$, with derivatives to $8^{-(k - n)}$ and $4^{-(k - n)}$, and
# what is within ring $k$ is as the last term. A derivative divides by $\lambda^n$, an area is
# $\lambda^{2 n}$, so that errors are, squared,
#
# $$ \sum_{n \le k} \lambda^{2 n (3 - m)}\, 4^{-(4 - m)(k - n)}, \qquad m = 0, 1, 2 $$
#
# for $L^2$, $H^1$ and second derivatives: sums of powers, of which the last or the first term
# prevails. Orders are the smaller one of $4 - m$ and $(3 - m) \log_2 1/\lambda$; of the largest
# error it is $2 \log_2 1/\lambda$.


# %%
def order(n, m):
    return min(4 - m, (3 - m) * np.log2(1 / rate[n]))


def measured(n, m, k):
    """The order between levels k and k + 1 of the sum."""

    def total(k):
        ring = np.arange(k + 1)
        return (rate[n] ** (2 * (3 - m) * ring) * 4.0 ** (-(4 - m) * (k - ring))).sum()

    return np.log2(total(k) / total(k + 1)) / 2


for n in rate:
    for m in range(3):
        assert abs(measured(n, m, 60) - order(n, m)) < 2e-2
table = {
    3: (3.86, 2.57, 1.29),
    5: (2.59, 1.73, 0.86),
    8: (2.13, 1.42, 0.71),
    12: (1.97, 1.31, 0.66),
}
for n, known in table.items():
    assert np.allclose([order(n, m) for m in range(3)], known, atol=6e-3)

# %% [markdown]
# These are orders in the end. Cells far from the pole have errors of the full order with constants
# of their own, which prevail at first. At valence 3 an eigenvalue, $1/6$, is that near to
# $\lambda^2 = 0.168$ that the pole shows late.

# %%
three = np.abs(np.asarray(ls.eigenbasis("catmull-clark", valence=3).float64.eigenvalues))
assert abs(three - rate[3] ** 2).min() < 2e-3

# %% [markdown]
# ## 4. Graded spaces
#
# Let $\Omega_0 \supset \Omega_1 \supset \dots$ be parts of the surface, $\Omega_0$ all of it,
# $\Omega_k$ made of faces of level $k - 1$. Kraft takes of the functions of level $k$ those whose
# support is in $\Omega_k$ but not in $\Omega_{k + 1}$. A function that is dropped, since its
# support is in $\Omega_{k + 1}$, is a sum of functions of level $k + 1$ with supports in its own,
# which are taken or dropped in their turn: so all coarse functions remain in the space.
#
# Truncated functions span the same. Whenever a coarse function is written in the next level, its
# coefficients at functions with supports in $\Omega_{k + 1}$ are set to 0. Then they add up to 1,
# and a function of level 0, the surface itself among them, has as coefficients at functions of
# level $k$ what refinement gives there: on faces outside $\Omega_{k + 1}$ nothing else acts.
#
# On the line, with cubic splines on $[0, 16)$ around a circle and $\Omega_1 = [0, 8)$:

# %%
n, end = 16, 8
step = np.zeros((2 * n, n))  # the function i has the support [i - 2, i + 2]; finer ones half of it
for i in range(n):
    for d, mask in zip(range(-2, 3), (1, 4, 6, 4, 1), strict=True):
        step[(2 * i + d) % (2 * n), i] = mask / 8
dropped = np.array([2 <= i <= end - 2 for i in range(n)])
inside = np.array([1 <= i / 2 <= end - 1 for i in range(2 * n)])
kraft = np.concatenate([step[:, ~dropped], np.eye(2 * n)[:, inside]], axis=1)
truncated = np.concatenate(
    [np.where(inside[:, None], 0, step[:, ~dropped]), np.eye(2 * n)[:, inside]], axis=1
)
rank = np.linalg.matrix_rank
assert rank(kraft) == rank(truncated) == kraft.shape[1] == (~dropped).sum() + inside.sum()
assert rank(np.concatenate([kraft, truncated], axis=1)) == rank(kraft)
assert rank(np.concatenate([kraft, step], axis=1)) == rank(kraft)  # coarse ones are there
assert (truncated.sum(axis=1) == 1).all()
x = np.random.default_rng(0).normal(size=n)
kept = np.concatenate([x[~dropped], (step @ x)[inside]])
assert np.allclose(truncated @ kept, step @ x)

# %% [markdown]
# Around a vertex of $n$ faces $1 + n\, k (k + 1)$ vertices are within $k$ layers. With three layers
# refined, six finer ones, fine functions within four layers are taken, and coarse ones within one
# dropped. Two poles of valence 8 and sixteen of valence 3 among 3,074 vertices:

# %%


def within(n, k):
    return 1 + n * k * (k + 1)


added = {n: within(n, 4) - within(n, 1) for n in (3, 8)}
assert 3074 + 2 * added[8] + 16 * added[3] == 4226

# %% [markdown]
# Three layers help by a factor and not by an order: from ring $k$ on each ring has as many cells
# across, and with those of a constant relative error what is within ring $k$ still is of the order
# $\lambda^{(3 - m) k}$. To regain the order rings near $k$ need smaller cells than those inside.
# With cells of $h_n$ of ring $n$ in size, squared errors are sums of
# $\lambda^{2 n (3 - m)} h_n^{2 (4 - m)}$ and unknowns are sums of $h_n^{-2}$. Errors are least at a
# given number where $h_n^{2 (4 - m) + 2} \lambda^{2 n (3 - m)}$ is the same for each ring: then
# numbers fall geometrically from ring to ring, and errors are as $N^{-(4 - m) / 2}$, at every
# valence.

# %%
for valence in (5, 8, 20):
    for m in range(3):
        ring, ratio = np.arange(1000), rate[valence] ** (3 - m)
        found = []
        for size in (1e-2, 1e-3):
            h = np.minimum(size * ratio ** (-ring / (5 - m)), 1)
            found.append([(h**-2).sum(), np.sqrt((ratio ** (2 * ring) * h ** (8 - 2 * m)).sum())])
        (n0, e0), (n1, e1) = found
        assert abs(np.log(e0 / e1) / np.log(n1 / n0) - (4 - m) / 2) < 0.11

# %% [markdown]
# ## 5. An indicator of errors
#
# Let $a(u, v) = \int c\, u v + \nabla u \nabla v = \int f v$ for all $v$, and the same for $u_h$
# and all $v_h$ of the space; $e = u - u_h$. Functions have one tangent plane across edges:
# integration by parts over faces leaves no jumps, and
#
# $$ a(e, v) = a(e, v - v_h) = \sum_F \int_F (f - c\, u_h + \Delta u_h) (v - v_h)
#    \le C \sum_F h_F\, \lVert f - c\, u_h + \Delta u_h \rVert_F\, \lVert v \rVert_{H^1} $$
#
# with $v_h$ near to $v$. That there are no jumps between levels either: stiffness times
# coefficients is minus the integral of the Laplacian with each function.

# %%
k = np.arange(48).reshape(8, 6)
right, up = np.roll(k, -1, axis=0), np.roll(k, -1, axis=1)
faces = np.stack([k, right, np.roll(right, -1, axis=1), up], axis=-1).reshape(-1, 4)
a, b = 2 * np.pi * (k // 6).ravel() / 8, 2 * np.pi * (k % 6).ravel() / 6
ring = np.stack([(2 + np.cos(b)) * np.cos(a), (2 + np.cos(b)) * np.sin(a), np.sin(b)], axis=1)
space = ls.Space(ls.LimitSurface(ls.Mesh(ring, faces)), where=np.arange(48) == 0)
assert space.n > 48
q = ls.quadrature(space.surface, points=16)
basis, at = space.basis(q), space.geometry(q)
c = np.random.default_rng(1).normal(size=space.n)
d = {nu: basis.weights(nu) @ c for nu in basis.orders}
second = np.stack([d[2, 0], d[1, 1], d[1, 1], d[0, 2]], axis=1).reshape(-1, 2, 2)
first = np.stack([d[1, 0], d[0, 1]], axis=1)
hessian = second - np.einsum("ncab,nc->nab", at.christoffel, first)
laplacian = np.einsum("nab,nab->n", at.inverse, hessian)
known = -(basis.weights().T @ (q.weights * at.area * laplacian))
assert abs(space.stiffness(quadrature=q) @ c - known).max() < 1e-9 * abs(known).max()
