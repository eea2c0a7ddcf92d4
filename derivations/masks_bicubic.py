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
"""The Catmull-Clark masks are knot insertion for bicubic B-splines, carried over to any mesh.

After Catmull and Clark (1978); boundaries after DeRose, Kass and Truong (1998).

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # The masks of Catmull and Clark
#
# On a regular mesh the masks are knot insertion for uniform bicubic B-splines. Carried over to any
# mesh, two choices are in them: how the corners of an $n$-gon share, and how the valence $N$
# enters. On boundaries they are knot insertion for cubic curves; where two faces meet at a boundary
# vertex, or one at a fixed corner, the surface inside is still a bicubic spline: that of the mesh
# continued by reflections.
#
# - E. Catmull, J. Clark, "Recursively generated B-spline surfaces on arbitrary topological meshes",
#   Computer-Aided Design 10 (1978): the interior rules.
# - T. DeRose, M. Kass, T. Truong, "Subdivision surfaces in character animation", SIGGRAPH 1998: the
#   boundary rules.

# %%
from fractions import Fraction
from itertools import product

from sympy import Matrix, Rational, Symbol, binomial, expand, symbols

from limitsurf._kernels.reference import cubic_weights
from limitsurf.numbers import RATIONAL
from limitsurf.scheme.catmull_clark import CATMULL_CLARK

# %% [markdown]
# ## 1. One variable: the two-scale relation
#
# The uniform cubic B-spline $B_3$ has the knots 0, 1, 2, 3, 4. The recursion of Cox and de Boor,
#
# $$
# B_d(t) = \frac{t}{d} \, B_{d-1}(t) + \frac{d + 1 - t}{d} \, B_{d-1}(t - 1),
# $$
#
# gives its polynomial pieces, piece $i$ on $[i, i + 1]$.

# %%
t = Symbol("t")


def b_spline(degree):
    if degree == 0:
        return [Rational(1)]
    lower = b_spline(degree - 1)
    rising = [*(t * piece / degree for piece in lower), 0]
    falling = [0, *((degree + 1 - t) * piece.subs(t, t - 1) / degree for piece in lower)]
    return [expand(a + b) for a, b in zip(rising, falling, strict=True)]


pieces = b_spline(3)
assert pieces[0] == t**3 / 6
Matrix(pieces)

# %% [markdown]
# It is a combination of its own half-size copies, with binomial weights:
#
# $$
# B_3(t) = \sum_{k=0}^{4} w_k \, B_3(2 t - k), \qquad w_k = \frac{1}{8} \binom{4}{k},
# $$
#
# checked on each of the eight half intervals $[h/2, (h+1)/2]$.

# %%
w = [binomial(4, k) / 8 for k in range(5)]

for half in range(8):
    refined = sum(w[k] * pieces[half - k].subs(t, 2 * t - k) for k in range(5) if 0 <= half - k < 4)
    assert expand(pieces[half // 2] - refined) == 0

# %% [markdown]
# So a curve with control points $c_j$ has, for knots half as far apart, the control points
# $c'_i = \sum_j w_{i - 2j} \, c_j$. Near an old control point ($i$ even) and at the middle of an
# edge ($i$ odd) these are
#
# $$
# c'_{2j} = \frac{c_{j-1} + 6 c_j + c_{j+1}}{8}, \qquad c'_{2j+1} = \frac{c_j + c_{j+1}}{2} .
# $$

# %%
even = {-1: w[4], 0: w[2], 1: w[0]}
odd = {0: w[3], 1: w[1]}
assert even == {-1: Rational(1, 8), 0: Rational(3, 4), 1: Rational(1, 8)}
assert odd == {0: Rational(1, 2), 1: Rational(1, 2)}

# %% [markdown]
# On one knot interval the curve is the sum of four control points with polynomial weights, piece
# $3 - k$ of $B_3$ for control point $k$. With $\bar t = 1 - t$ they and their derivatives are
#
# $$
# \begin{array}{lcccc}
# & c_0 & c_1 & c_2 & c_3 \\
# 6 \times \text{weight:} & \bar t^3 & 1 + 3 \bar t (1 + t \bar t) & 1 + 3 t (1 + t \bar t) & t^3 \\
# 2 \times \text{first:} & -\bar t^2 & -t (1 + 3 \bar t) & \bar t (1 + 3 t) & t^2 \\
# \text{second:} & \bar t & 3 t - 2 & 1 - 3 t & t
# \end{array}
# $$
#
# The weights themselves are sums of products of non-negative numbers: nothing cancels
# ([arithmetic](arithmetic.py), section 6, has them by recurrence, for any degree).

# %%
segment = Matrix([pieces[3 - k].subs(t, t + 3 - k) for k in range(4)]).applyfunc(expand)
back = 1 - t
values = Matrix([back**3, 1 + 3 * back * (1 + t * back), 1 + 3 * t * (1 + t * back), t**3]) / 6
slopes = Matrix([-(back**2), -t * (1 + 3 * back), back * (1 + 3 * t), t**2]) / 2
assert segment == values.applyfunc(expand)
assert segment.diff(t) == slopes.applyfunc(expand)
assert segment.diff(t, 2) == Matrix([back, 3 * t - 2, 1 - 3 * t, t])

# %% [markdown]
# As a matrix, powers of $t$ by rows and control points by columns:

# %%
POWERS = Matrix([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6
assert Matrix([[1, t, t**2, t**3]]) * POWERS == segment.T
POWERS

# %% [markdown]
# ## 2. Two variables: the three masks of a regular mesh
#
# A bicubic surface inserts knots in both directions, so its weights are products.

# %%
c = {(i, j): Symbol(f"c{i}{j}") for i, j in product(range(4), repeat=2)}


def inserted(along_u, along_v, i, j, points=c):
    return sum(a * b * points[i + k, j + m] for k, a in along_u.items() for m, b in along_v.items())


# %% [markdown]
# *Face point*: both directions halve. It is the mean of the four corners.


# %%
def face_point(i, j, points=c):
    return (points[i, j] + points[i + 1, j] + points[i + 1, j + 1] + points[i, j + 1]) / 4


assert expand(inserted(odd, odd, 1, 1) - face_point(1, 1)) == 0

# %% [markdown]
# *Edge point*: the mean of the two ends and of the two new face points.

# %%
edge_point = (c[1, 1] + c[2, 1] + face_point(1, 0) + face_point(1, 1)) / 4
assert expand(inserted(odd, even, 1, 1) - edge_point) == 0

# %% [markdown]
# *Vertex point*: $Q / 4 + R / 2 + S / 4$, with $Q$ the mean of the four new face points, $R$ that
# of the four edge midpoints, and $S$ the vertex itself.

# %%
S = c[1, 1]
neighbours = [c[2, 1], c[1, 2], c[0, 1], c[1, 0]]
faces = [face_point(i, j) for i, j in product((0, 1), repeat=2)]
Q = sum(faces) / 4
R = sum((S + e) / 2 for e in neighbours) / 4
assert expand(inserted(even, even, 1, 1) - (Q / 4 + R / 2 + S / 4)) == 0

# %% [markdown]
# ## 3. Any mesh
#
# Catmull and Clark keep the words and change the numbers. The face point of an $n$-gon is the mean
# of its $n$ corners; the edge point stays; a vertex where $N$ faces meet moves to
#
# $$
# \frac{Q + 2 R + (N - 3) \, S}{N},
# $$
#
# which is the bicubic rule at $N = 4$. Two choices are in it, and a test that looks at regular
# meshes alone sees neither: how the $n$ corners share, and how $N$ enters. As $R = S / 2 + m / 2$,
# where $m$ is the mean of the neighbours, the weights of the vertex, of each neighbour and of each
# new face point are
#
# $$
# \frac{N - 2}{N}, \qquad \frac{1}{N^2}, \qquad \frac{1}{N^2} .
# $$

# %%
N = Symbol("N", positive=True)
q, neighbour_mean, s = symbols("q m s")
rule = (q + 2 * (s / 2 + neighbour_mean / 2) + (N - 3) * s) / N
own, each_neighbour, each_face = (N - 2) / N, 1 / N**2, 1 / N**2
assert expand(rule - (own * s + each_neighbour * N * neighbour_mean + each_face * N * q)) == 0
assert expand(own + N * each_neighbour + N * each_face) == 1

# %% [markdown]
# Where all the faces around are quadrilaterals, and after one step they are, the mask on the old
# vertices has the weights
#
# $$
# 1 - \frac{7}{4 N}, \qquad \frac{3}{2 N^2}, \qquad \frac{1}{4 N^2}
# $$
#
# for the vertex, each edge neighbour and each opposite corner: each face point hands a quarter to
# the vertex, to two neighbours and to the opposite corner.

# %%
assert expand(own + N * each_face / 4 - (1 - 7 / (4 * N))) == 0
assert expand(each_neighbour + 2 * each_face / 4 - 3 / (2 * N**2)) == 0

# %% [markdown]
# ## 4. Boundaries
#
# A boundary is a cubic B-spline curve of its own control points: the masks of section 1. Is it
# still a bicubic spline inside? Continue a regular mesh by a row of phantom points, each the
# reflection $2 b - i$ of an inner point $i$ at a boundary point $b$. Knot insertion on the
# continued mesh gives the boundary its own curve's rule, and phantoms that are again reflections:
# the argument repeats at every level.

# %%
b = [Symbol(f"b{k}") for k in range(3)]
inner = [Symbol(f"i{k}") for k in range(3)]
mesh = {(k, 1): b[k] for k in range(3)} | {(k, 2): inner[k] for k in range(3)}
mesh |= {(k, 0): 2 * b[k] - inner[k] for k in range(3)}

for along, k in ((even, 1), (odd, 0)):
    new_boundary = inserted(along, even, k, 1, mesh)
    new_inner = inserted(along, odd, k, 1, mesh)
    new_phantom = inserted(along, odd, k, 0, mesh)
    assert expand(new_boundary - sum(a * b[k + m] for m, a in along.items())) == 0
    assert expand(new_phantom - (2 * new_boundary - new_inner)) == 0

# %% [markdown]
# So wherever two faces meet at a boundary vertex the limit is the spline of the continued mesh: it
# ends on the boundary's curve, by the weights $(1, 4, 1) / 6$ across, with a second derivative
# across, $(1, -2, 1)$, of zero.

# %%
phantom, middle, first = mesh[1, 0], mesh[1, 1], mesh[1, 2]
assert expand((phantom + 4 * middle + first) / 6 - b[1]) == 0
assert expand(phantom - 2 * middle + first) == 0

# %% [markdown]
# At a vertex of one face two boundaries meet, and the phantom beyond it is a reflection in both
# directions, in either order. The points are the corner $p$, its neighbours $x$ and $y$, and the
# opposite corner $o$ of the face.

# %%
p, x, y, o = symbols("p x y o")
mesh = {(1, 1): p, (2, 1): x, (1, 2): y, (2, 2): o}
mesh |= {(0, 1): 2 * p - x, (0, 2): 2 * y - o, (1, 0): 2 * p - y, (2, 0): 2 * x - o}
mesh[0, 0] = 2 * mesh[0, 1] - mesh[0, 2]
assert expand(mesh[0, 0] - (2 * mesh[1, 0] - mesh[2, 0])) == 0
expand(mesh[0, 0])

# %% [markdown]
# Knot insertion leaves the corner where it is. That is the rule of the mode "edge_and_corner";
# under "edge_only" the corner moves to $(x + 6 p + y) / 8$, which no reflection gives, and such a
# vertex is extraordinary ([creases](creases.py), section 2). Its neighbours follow the boundary
# curves, and reflect again.

# %%
assert expand(inserted(even, even, 1, 1, mesh) - p) == 0
assert expand(inserted(odd, even, 1, 1, mesh) - (p + x) / 2) == 0
assert expand(inserted(odd, even, 0, 1, mesh) - (2 * p - (p + x) / 2)) == 0
assert (x + 6 * p + y) / 8 != p

# %% [markdown]
# ## 5. The masks of the package

# %%
places = RATIONAL.array([Fraction(k, 7) for k in range(8)])
for order in range(5):
    for place, found in zip(places, cubic_weights(places, order), strict=True):
        assert list(segment.diff(t, order).subs(t, Rational(place))) == list(map(Rational, found))

assert CATMULL_CLARK.edge == (Fraction(1, 4), Fraction(1, 4))
assert CATMULL_CLARK.boundary_edge == Fraction(odd[0].p, odd[0].q)
assert CATMULL_CLARK.boundary_vertex == (Fraction(3, 4), Fraction(1, 8))
for n in range(3, 20):
    assert CATMULL_CLARK.face_mask(n) == (Fraction(1, n),) * n
for n in range(2, 70):
    derived = [weight.subs(N, n) for weight in (own, each_neighbour, each_face)]
    assert CATMULL_CLARK.vertex_mask(n) == tuple(Fraction(d.p, d.q) for d in derived)
