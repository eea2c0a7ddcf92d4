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
"""The limit at the centre of an n-gon, in points of the cage.

After Catmull and Clark (1978) and Halstead, Kass and DeRose (1993).

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # The centre of an n-gon
#
# The $n$ limit faces of an $n$-gon meet at its centre, $(u, v) = (1, 1)$ in each of them. One
# refinement makes the centre an interior vertex of valence $n$ ([isolation](isolation.py)), and a
# limit mask ([limit_masks](limit_masks.py)) takes it to the limit. This document composes the two,
# for symbolic $n$ and any surroundings:
#
# $$ X_{\text{centre}} = \frac{(n + 3)\, F + \bar G + \bar V}{n + 5} $$
#
# with $F$ the mean of the corners of the $n$-gon, $\bar G$ the mean over its edges of the mean of
# the corners of the face across, and $\bar V$ the mean of the vertex points of its corners. It
# then gives the weight of every point of the cage, the tangents, and what changes along sharp
# edges.
#
# - E. Catmull, J. Clark, "Recursively generated B-spline surfaces on arbitrary topological meshes",
#   Computer-Aided Design 10 (1978): the masks of one refinement.
# - M. Halstead, M. Kass, T. DeRose, "Efficient, fair interpolation using Catmull-Clark surfaces",
#   SIGGRAPH 1993: limit masks of position and tangents.

# %%
from fractions import Fraction

import mpmath
import numpy as np
from sympy import Rational, Symbol, cos, expand, pi, simplify, symbols

import limitsurf as ls
from limitsurf.scheme.catmull_clark import CATMULL_CLARK

n = Symbol("n", positive=True)

# %% [markdown]
# ## 1. Position
#
# The corners are $v_0 \ldots v_{n-1}$; across the edge from $v_i$ to $v_{i+1}$ lies a face of $m_i$
# corners with the mean $G_i$; $N_i$ faces meet at $v_i$. One refinement makes
#
# - the face point $F = \frac1n \sum v_i$;
# - edge points $e_i = (v_i + v_{i+1} + F + G_i) / 4$;
# - vertex points $v_i'$: $(N_i - 2) / N_i$ of $v_i$ and $1 / N_i^2$ of each neighbour and of each
#   face point around.
#
# Around $F$ these are the ring $e_0, v_1', e_1, v_2', \ldots$ of valence $n$, whose limit is
# $(n^2 F + 4 \sum e_i + \sum v_i') / (n (n + 5))$. And each corner is in two edges, so
#
# $$ 4 \sum e_i = 2 \sum v_i + n F + \sum G_i = 3 n F + n \bar G . $$
#
# All that is needed of the surroundings are two sums:

# %%
F, G_mean, V_mean = symbols("F G V")
corners = n * F
four_edges = 2 * corners + n * F + n * G_mean
limit = (n**2 * F + four_edges + n * V_mean) / (n * (n + 5))
assert simplify(limit - ((n + 3) * F + G_mean + V_mean) / (n + 5)) == 0
assert simplify(limit.subs({F: 1, G_mean: 1, V_mean: 1}) - 1) == 0

# %% [markdown]
# The masks are those of the library:

# %%
assert CATMULL_CLARK.edge == (Fraction(1, 4), Fraction(1, 4))
for k in range(3, 12):
    assert CATMULL_CLARK.face_mask(k) == (Fraction(1, k),) * k
    assert CATMULL_CLARK.vertex_mask(k) == (1 - Fraction(2, k), *[Fraction(1, k * k)] * 2)

# %% [markdown]
# **Weights.** For a vertex $w$ of the cage,
#
# $$ n (n + 5)\, \omega(w) = (n + 3)\, [w \text{ is a corner}] + \sum_i \frac{[w \in G_i]}{m_i}
#    + \sum_i \Big( \frac{N_i - 2}{N_i} [w = v_i] + \frac{1}{N_i^2} \Big( [w \sim v_i]
#    + \sum_{\varphi \ni v_i, w} \frac1{\left|\varphi\right|} \Big) \Big) , $$
#
# where $w \sim v_i$ are the ends of an edge, $\varphi$ are the faces that hold both, and $[\,]$ is
# 1 or 0. In the simplest surroundings, quads across all edges and one valence $N$ at all corners, a
# corner has, collected,
#
# $$ n (n + 5)\, \omega = n + 3 + \frac12 + \frac{N - 2}N
#    + \frac1{N^2} \Big( 3 + \frac{N + 1}{4} \Big) : $$
#
# in the bracket, 2 as the neighbour of two other corners, 1 from the $n$-gon as one of $\varphi$
# for all $n$ corners, a quarter for each of its own $N - 1$ quads, and two more quarters for those
# that it shares with the next corners.


# %%
def weights(faces, face):
    """Weights of all vertices in the limit at the centre of a face, by the formula above."""
    count, corners_ = len(face), set(face)
    edges = {frozenset(pair) for f in faces for pair in zip(f, f[1:] + f[:1], strict=True)}
    total = {w: Fraction(0) for f in faces for w in f}
    for w in face:
        total[w] += count + 3
    for pair in zip(face, face[1:] + face[:1], strict=True):
        (across,) = (f for f in faces if f != face and set(pair) <= set(f))
        for w in across:
            total[w] += Fraction(1, len(across))
    for v in corners_:
        around = [f for f in faces if v in f]
        N = len(around)
        total[v] += Fraction(N - 2, N)
        for edge in edges:
            if v in edge:
                (w,) = edge - {v}
                total[w] += Fraction(1, N * N)
        for f in around:
            for w in f:
                total[w] += Fraction(1, N * N * len(f))
    return [total[w] / (count * (count + 5)) for w in sorted(total)]


# %% [markdown]
# ## 2. Against the library
#
# Prisms have quads around the $n$-gon and valence 3; antiprisms triangles and valence 4; a prism
# with a roof has other valences at its corners; a prism of which one side is cut into two triangles
# has unequal neighbours and valences. For $n = 3, 5, 6, 7, 12$ the weights are those of the library
# in Fractions, in all $n$ limit faces of the $n$-gon. (The library knows no formula for a centre:
# it refines once and evaluates a patch.)


# %%
def prism(k):
    return [
        [*range(k)][::-1],
        [*range(k, 2 * k)],
        *([i, (i + 1) % k, k + (i + 1) % k, k + i] for i in range(k)),
    ]


def antiprism(k):
    sides = ([[i, (i + 1) % k, k + i], [(i + 1) % k, k + (i + 1) % k, k + i]] for i in range(k))
    return [[*range(k)][::-1], [*range(k, 2 * k)], *(face for pair in sides for face in pair)]


def with_roof(k):
    bottom, _, *sides = prism(k)
    return [bottom, *sides, *([k + i, k + (i + 1) % k, 2 * k] for i in range(k))]


def cut(k):
    bottom, top, (a, b, c, d), *sides = prism(k)
    return [bottom, top, [a, b, c], [a, c, d], *sides]


def built(faces):
    count = 1 + max(map(max, faces))
    points = [[Fraction((7 * k * k + a * k + 3) % 23) for a in range(3)] for k in range(count)]
    return ls.Mesh(points, faces)


ONE = Fraction(1)
N = Symbol("N", positive=True)
collected = n + 3 + Rational(1, 2) + (N - 2) / N + (3 + (N + 1) / 4) / N**2
for k in (3, 5, 6, 7, 12):
    corner = collected.subs({n: k, N: 3}) / (k * (k + 5))
    assert {Rational(w) for w in weights(prism(k), prism(k)[0])[:k]} == {corner}
    for faces in (prism(k), antiprism(k), with_roof(k), cut(k)):
        expected = weights(faces, faces[0])
        surface = ls.LimitSurface(built(faces))
        assert sum(expected) == 1
        for row in surface.weights(range(k), ONE, ONE).toarray():
            assert row.tolist() == expected

# %% [markdown]
# And against recursion: the vertex at the centre after one refinement of the mesh and 40 more of
# its ring. It approaches the limit like the powers of the eigenvalue of frequency 0, at most 0.42
# here.


# %%
def refined_ring(ring, k):
    """One step around a vertex of valence k: the vertex, e_0, f_0, e_1, f_1, ..."""
    v, e, f = ring[0], ring[1::2], ring[2::2]
    new_f = [(v + e[j] + f[j] + e[(j + 1) % k]) / 4 for j in range(k)]
    new_e = [(v + e[j] + new_f[j - 1] + new_f[j]) / 4 for j in range(k)]
    new_v = (v * (k - 2) + (sum(e) + sum(new_f)) / k) / k
    return [new_v, *(x for pair in zip(new_e, new_f, strict=True) for x in pair)]


for k in (3, 5, 6, 7):
    faces = cut(k)
    mesh = built(faces)
    fine = ls.refined(mesh)
    centre = mesh.n_vertices + len(mesh.edges)  # of face 0
    spokes = [face for face in fine.faces.tolist() if centre in face]
    # faces of the ring in order, each from the edge point on which the last one ended
    order = [spokes.pop()]
    while spokes:
        end = order[-1][(order[-1].index(centre) + 3) % 4]
        (following,) = (f for f in spokes if f[(f.index(centre) + 1) % 4] == end)
        spokes.remove(following)
        order.append(following)
    picks = [face[(face.index(centre) + step) % 4] for face in order for step in (1, 2)]
    ring = [fine.points[i, 0] for i in (centre, *picks)]
    wanted = sum(w * x for w, x in zip(weights(faces, faces[0]), mesh.points[:, 0], strict=True))
    for _ in range(40):
        ring = refined_ring([float(x) for x in ring], k)
    assert abs(ring[0] - wanted) < 1e-9

# %% [markdown]
# ## 3. Quads
#
# A quad amid quads with four faces at each corner is a bicubic patch, and its centre has the
# weights $(1, 23, 23, 1) / 48$ in both directions: those of the formula.

# %%
cubic = [Rational(w, 48) for w in (1, 23, 23, 1)]
grid = [
    [4 * j + i, 4 * j + i + 1, 4 * j + i + 5, 4 * j + i + 4] for j in range(3) for i in range(3)
]
found = weights(grid, grid[4])
assert [Rational(w) for w in found] == [a * b for b in cubic for a in cubic]

# %% [markdown]
# ## 4. Tangents
#
# With $c_j = \cos(2 \pi j / n)$ the limit masks of tangents are
# $\sum_j A_n c_j e_j + (c_j + c_{j+1}) f_j$,
# $A_n = 1 + \cos \frac{2 \pi}n + \cos \frac\pi n \sqrt{2 (9 + \cos \frac{2 \pi}n)}$
# ([limit_masks](limit_masks.py)), along the edge to $e_0$. Here $f_j = v_{j+1}'$. As
# $\sum c_j = 0$, $F$ drops out, and with the sum shifted by one in its last part
#
# $$ t_k = \sum_j \cos \frac{2 \pi (j - k)}{n} \Big( \frac{A_n}{4} (v_j + v_{j+1} + G_j)
#    + v_j' + v_{j+1}' \Big) $$
#
# is the direction from the centre to the midpoint of edge $k$; $t_k \times t_{k+1}$ is along the
# normal. Collected for $n = 3, 5, 6$ with symbols for all points:

# %%
for k in (3, 5, 6):
    v, w, g = (symbols(f"{name}:{k}") for name in ("v", "w", "g"))  # w for the vertex points
    centre_point, big = symbols("F A")
    turns = [cos(2 * pi * j / k) for j in range(k)]
    e = [(v[j] + v[(j + 1) % k] + centre_point + g[j]) / 4 for j in range(k)]
    mask = sum(
        big * turns[j] * e[j] + (turns[j] + turns[(j + 1) % k]) * w[(j + 1) % k] for j in range(k)
    )
    collected = sum(
        turns[j] * (big / 4 * (v[j] + v[(j + 1) % k] + g[j]) + w[j] + w[(j + 1) % k])
        for j in range(k)
    )
    assert simplify(expand(mask - collected)) == 0

# %% [markdown]
# In limit face $k$ the side $u = 1$ runs from the midpoint of edge $k$ to the centre, the side
# $v = 1$ from that of edge $k - 1$: at $(1, 1)$, $\partial_v$ is along $-t_k$ and $\partial_u$
# along $-t_{k-1}$. Compared with the library, to rounding:


# %%
def tangent(mesh, face, k):
    """Unit vector from the centre of a face towards the midpoint of its edge k."""
    points, faces = mesh.points.astype(float), mesh.faces.tolist()
    moved = ls.refined(mesh).points[: mesh.n_vertices].astype(float)
    count = len(face)
    turn = [float(mpmath.cospi(mpmath.mpf(2 * (j - k)) / count)) for j in range(count)]
    once, half = (float(mpmath.cospi(mpmath.mpf(x) / count)) for x in (2, 1))
    big = 1 + once + half * (2 * (9 + once)) ** 0.5
    total = np.zeros(3)
    for j, pair in enumerate(zip(face, face[1:] + face[:1], strict=True)):
        (across,) = (f for f in faces if f != face and set(pair) <= set(f))
        pair = list(pair)
        total += turn[j] * (big / 4 * (points[pair].sum(axis=0) + points[across].mean(axis=0)))
        total += turn[j] * moved[pair].sum(axis=0)
    return total / np.sqrt(total @ total)


for k in (3, 5, 6, 7):
    faces = cut(k)
    mesh = built(faces)
    surface = ls.LimitSurface(mesh.with_points(mesh.points.astype(float)))
    for i in range(k):
        along, across = surface.tangents(i, 1.0, 1.0)
        assert np.abs(across + tangent(mesh, faces[0], i)).max() < 1e-12
        assert np.abs(along + tangent(mesh, faces[0], i - 1)).max() < 1e-12

# %% [markdown]
# ## 5. Sharp edges
#
# If edge $i$ is on a boundary or infinitely sharp, its point is $(v_i + v_{i+1}) / 2$. This is
# $(v_i + v_{i+1} + F + G_i) / 4$ with the reflected mean
#
# $$ G_i = v_i + v_{i+1} - F , $$
#
# and an edge of sharpness $s < 1$ has the mean of both, weighted by $s$. Vertex points follow the
# rules of their vertices; the formulas for position and tangents do not ask which. (The triangle
# rule "smooth" has other edge points, and is not covered.) Checked on a pentagon that has no
# neighbours at all, under "edge_only" (vertex points $(v_{i-1} + 6 v_i + v_{i+1}) / 8$): there
# $\bar G = 2 F - F$ and $\bar V = F$, so that the limit is $F$. And on a prism with one side sharp:

# %%
v_i, v_j = symbols("v_i v_j")
assert expand((v_i + v_j + F + (v_i + v_j - F)) / 4 - (v_i + v_j) / 2) == 0
alone = ls.LimitSurface(built([[0, 1, 2, 3, 4]]), boundary="edge_only")
assert alone.evaluate(0, ONE, ONE).tolist() == (sum(alone.points) / 5).tolist()

for sharpness in (Fraction(1, 3), Fraction(10)):
    mesh = built(prism(5))
    face = prism(5)[0]
    tagged = ls.Mesh(mesh.points, prism(5), creases={(face[0], face[1]): sharpness})
    moved = ls.refined(tagged).points[:10]
    P, share = mesh.points, min(sharpness, ONE)
    mean = sum(P[face]) / 5
    across = []
    for j in range(5):
        a, b = face[j], face[(j + 1) % 5]
        (other,) = (f for f in prism(5) if f != face and {a, b} <= set(f))
        across.append(sum(P[other]) / len(other))
    across[0] = (1 - share) * across[0] + share * (P[face[0]] + P[face[1]] - mean)
    expected = (8 * mean + sum(across) / 5 + sum(moved[face]) / 5) / 10
    assert ls.LimitSurface(tagged).evaluate(2, ONE, ONE).tolist() == expected.tolist()
