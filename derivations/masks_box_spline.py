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
"""Loop's masks are those of the quartic box spline of three directions, carried over to any mesh.

After Loop (1987); its polynomial pieces after Stam (1999); boundaries after Hoppe et al. (1994).

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # The masks of Loop
#
# On a regular mesh of triangles Loop's masks are knot insertion for a quartic box spline. Its
# pieces come from one truncated power, its masks from one product. Carried over to any mesh, one
# choice is in them: how the valence $N$ enters. On boundaries they are knot insertion for cubic
# curves, and where three faces meet at a boundary vertex the surface inside is the box spline of
# the mesh continued by parallelograms.
#
# - C. Loop, "Smooth subdivision surfaces based on triangles", thesis, University of Utah 1987: the
#   masks.
# - J. Warren, H. Weimer, "Subdivision methods for geometric design", Morgan Kaufmann 2001: other
#   weights.
# - H. Hoppe et al., "Piecewise smooth surface reconstruction", SIGGRAPH 1994: boundaries.
# - J. Stam, "Evaluation of Loop subdivision surfaces", SIGGRAPH course notes 1999: the twelve
#   polynomials.

# %%
from functools import cache
from itertools import product
from math import comb

from sympy import Matrix, Poly, Rational, Symbol, cancel, cos, expand, integrate, pi, rem, symbols

u, v, s = symbols("u v s")

# %% [markdown]
# ## 1. From one truncated power to twelve polynomials
#
# The vertices of the regular mesh are the integer points $(a, b)$, its edges run along
#
# $$
# d_1 = (1, 0), \qquad d_2 = (0, 1), \qquad d_3 = (-1, 1),
# $$
#
# and the triangle in question is $(0, 0), (1, 0), (0, 1)$. The box spline $M$ is the density of a
# sum of six steps, two along each direction, of random lengths between 0 and 1. Let the lengths
# range over $[0, \infty)$ instead: the two steps along $d$ together have length $t$ with density
# $t$. As $d_2 = d_1 + d_3$ and $(u, v) = (u + v) \, d_1 + v \, d_3$, this *truncated power* is
#
# $$
# T(u, v) = \int_0^{\min(x, y)} s \, (x - s) \, (y - s) \, ds, \qquad x = u + v, \quad y = v,
# $$
#
# where $x, y \ge 0$, and zero elsewhere. It has two pieces, one on each side of $d_2$.

# %%
x, y = u + v, v
PIECES = [expand(integrate(s * (x - s) * (y - s), (s, 0, end))) for end in (x, y)]  # u < 0, u > 0
assert PIECES[1] == expand(y**3 * (2 * x - y) / 12)

# %% [markdown]
# A length between 0 and 1 is one beyond 0 less one beyond 1, so
#
# $$
# M(p) = \sum_{i,j,k=0}^{2} (-1)^{i+j+k} \binom2i \binom2j \binom2k \,
#   T(p - i d_1 - j d_2 - k d_3),
# $$
#
# with its centre at $d_1 + d_2 + d_3 = (0, 2)$. On a triangle each $T$ is one polynomial, told by
# the triangle's centroid.

# %%
DIRECTIONS = (1, 0), (0, 1), (-1, 1)
TRIANGLE = Rational(1, 3), Rational(1, 3)


@cache
def shifted(piece, i, j):
    return Poly(PIECES[piece].subs({u: u - i, v: v - j}, simultaneous=True), u, v)


def box_spline(a, b, centroid=TRIANGLE):
    """The polynomial in u, v, on a triangle, of the box spline with its centre at (a, b)."""
    total = Poly(0, u, v)
    for counts in product(range(3), repeat=3):
        i, j, k = counts
        weight = (-1) ** (i + j + k) * comb(2, i) * comb(2, j) * comb(2, k)
        at = a + i - k, b - 2 + j + k
        cu, cv = centroid[0] - at[0], centroid[1] - at[1]
        if cu + cv > 0 and cv > 0:
            total += weight * shifted(bool(cu > 0), *at)
    return total.as_expr()


AROUND = list(product(range(-3, 5), repeat=2))
weights = {place: box_spline(*place) for place in AROUND}
weights = {place: polynomial for place, polynomial in weights.items() if polynomial != 0}
sorted(weights)

# %% [markdown]
# Twelve vertices have a share in the triangle: its corners and all their neighbours.

# %%
CORNERS = (0, 0), (1, 0), (0, 1)
STEPS = (1, 0), (0, 1), (-1, 1), (-1, 0), (0, -1), (1, -1)
near = {(a + i, b + j) for a, b in CORNERS for i, j in (*STEPS, (0, 0))}
assert set(weights) == near
assert len(near) == 12
assert all(Poly(p, u, v).total_degree() == 4 for p in weights.values())

# %% [markdown]
# In barycentric coordinates $(w, u, v)$, $w = 1 - u - v$, there are three kinds of them, and all
# coefficients are positive. With $x, y, z$ for the coordinates in the order that is said,
#
# $$
# \begin{split}
# \text{corner } x: \quad 12 M &= 6 x^4 + 24 x^3 (y + z) + x^2 (24 y^2 + 60 y z + 24 z^2)
#   + 4 x (2 y^3 + 9 y^2 z + 9 y z^2 + 2 z^3) \\
#   & \quad + y^4 + 6 y^3 z + 12 y^2 z^2 + 6 y z^3 + z^4, \\
# \text{across the edge } x y: \quad 12 M &= x^4 + 6 x^3 y + 12 x^2 y^2 + 6 x y^3 + y^4
#   + 2 z (x^3 + 3 x^2 y + 3 x y^2 + y^3), \\
# \text{beyond corner } x, \text{ on the side of } y: \quad 12 M &= x^4 + 2 x^3 y .
# \end{split}
# $$


# %%
def corner(x, y, z):
    last = y**4 + 6 * y**3 * z + 12 * y**2 * z**2 + 6 * y * z**3 + z**4
    middle = 4 * x * (2 * y**3 + 9 * y**2 * z + 9 * y * z**2 + 2 * z**3)
    return (
        6 * x**4 + 24 * x**3 * (y + z) + x**2 * (24 * y**2 + 60 * y * z + 24 * z**2) + middle + last
    )


def across(x, y, z):
    return x**4 + 6 * x**3 * y + 12 * x**2 * y**2 + 6 * x * y**3 + y**4 + 2 * z * (x + y) ** 3


def beyond(x, y, z):
    return x**4 + 2 * x**3 * y


w = 1 - u - v
EXPECTED = {
    (0, 0): corner(w, u, v),
    (1, 0): corner(u, v, w),
    (0, 1): corner(v, w, u),
    (1, -1): across(w, u, v),
    (1, 1): across(u, v, w),
    (-1, 1): across(v, w, u),
    (0, -1): beyond(w, u, v),
    (-1, 0): beyond(w, v, u),
    (2, 0): beyond(u, v, w),
    (2, -1): beyond(u, w, v),
    (-1, 2): beyond(v, w, u),
    (0, 2): beyond(v, u, w),
}
assert all(expand(12 * weights[place] - EXPECTED[place]) == 0 for place in near)

# %% [markdown]
# ## 2. Planes, and two continuous derivatives
#
# The weights sum to one, and a flat mesh gives its own plane: with control points $(a, b)$ the
# surface is $(u, v)$.

# %%
assert expand(sum(weights.values())) == 1
assert expand(sum(a * p for (a, _), p in weights.items())) == u
assert expand(sum(b * p for (_, b), p in weights.items())) == v

# %% [markdown]
# Across each edge of the triangle $M$ has two continuous derivatives: what its polynomial changes
# by is a multiple of $l^3$, with $l = 0$ the edge. (Third derivatives jump.)

# %%
third = Rational(1, 3)
OVER = {u: (-third, 2 * third), v: (2 * third, -third), w: (2 * third, 2 * third)}
for line, centroid in OVER.items():
    jumps = [expand(box_spline(*place, centroid) - box_spline(*place)) for place in AROUND]
    assert all(rem(jump, expand(line**3), u) == 0 for jump in jumps if line is not v)
    assert all(rem(jump, line**3, v) == 0 for jump in jumps if line is v)
    assert any(jump != 0 for jump in jumps)

# %% [markdown]
# At a vertex of the mesh the limit and the first derivatives are
#
# $$
# P = \frac{6 c + \sum_j e_j}{12}, \qquad
# P_u = \frac{2 (e_0 - e_3) + (e_5 - e_2) + (e_1 - e_4)}{6},
# $$
#
# $e_0, \dots, e_5$ being the neighbours in the order of `STEPS`.

# %%
at_vertex = {place: p.subs({u: 0, v: 0}) for place, p in weights.items()}
assert at_vertex[0, 0] == Rational(1, 2)
assert all(at_vertex[step] == Rational(1, 12) for step in STEPS)
slopes = {place: p.diff(u).subs({u: 0, v: 0}) for place, p in weights.items()}
assert [6 * slopes[step] for step in STEPS] == [2, 1, -1, -2, -1, 1]

# %% [markdown]
# ## 3. The masks
#
# A random length in $[0, 1]$ is one in $[0, \frac12]$, with $\frac12$ added or not. So $M$ is a sum
# of its half-size copies with the weights of a product over the six steps,
#
# $$
# M(p) = \sum_k c_k \, M(2 p - k), \qquad
# \sum_k c_k z^k = \frac{4}{2^6} \, (1 + z^{d_1})^2 (1 + z^{d_2})^2 (1 + z^{d_3})^2,
# $$
#
# (the 4 is the area of a copy's unit in that of the copy). The sixteen-fold weights, centred:

# %%
MASK = {}
for counts in product(range(3), repeat=3):
    k = tuple(sum(n * d[axis] for n, d in zip(counts, DIRECTIONS, strict=True)) for axis in (0, 1))
    MASK[k[0], k[1] - 2] = MASK.get((k[0], k[1] - 2), 0) + comb(2, counts[0]) * comb(
        2, counts[1]
    ) * comb(2, counts[2])
[[MASK.get((a, b), 0) for a in range(-2, 3)] for b in range(-2, 3)]

# %% [markdown]
# A new point $k$ takes $c_{k - 2j}$ of the old point $j$. Near an old vertex ($k$ even) that is
# $\frac{10}{16}$ of it and $\frac{1}{16}$ of each neighbour; at the middle of an edge $\frac38$ of
# its ends and $\frac18$ of the two points across.


# %%
def masks(k):
    """{old place: weight} for the new point k."""
    found = {}
    for a, b in product(range(-3, 4), repeat=2):
        weight = MASK.get((k[0] - 2 * a, k[1] - 2 * b), 0)
        if weight:
            found[a, b] = Rational(weight, 16)
    return found


assert masks((0, 0)) == {(0, 0): Rational(5, 8)} | dict.fromkeys(STEPS, Rational(1, 16))
for i, end in enumerate(STEPS):
    ends = dict.fromkeys(((0, 0), end), Rational(3, 8))
    assert masks(end) == ends | dict.fromkeys((STEPS[i - 1], STEPS[i - 5]), Rational(1, 8))

# %% [markdown]
# ## 4. Four children
#
# A triangle splits in four. On the new mesh, with coordinates twice as large, they are
#
# $$
# (0, 0), (1, 0), (0, 1); \quad (1, 0), (2, 0), (1, 1); \quad (0, 1), (1, 1), (0, 2); \quad
# (1, 1), (0, 1), (1, 0),
# $$
#
# the last one turned by half, so that its corners are the midpoints opposite to the corners of the
# parent. Parameters of the children are $(2u, 2v)$, $(2u - 1, 2v)$, $(2u, 2v - 1)$ and
# $(1 - 2u, 1 - 2v)$; control point $(a, b)$ of a child is the new point $(a, b)$, $(a + 1, b)$,
# $(a, b + 1)$ or $(1 - a, 1 - b)$. The polynomials of the parent are those of each child, with the
# masks:

# %%
CHILDREN = [((0, 0), 1), ((1, 0), 1), ((0, 1), 1), ((1, 1), -1)]
for (a, b), sign in CHILDREN:
    inside = {u: sign * (2 * u - a), v: sign * (2 * v - b)}
    total = dict.fromkeys(near, 0)
    for i, j in near:
        child = weights[i, j].subs(inside, simultaneous=True)
        for place, share in masks((a + sign * i, b + sign * j)).items():
            total[place] += share * child
    assert all(expand(total[place] - weights[place]) == 0 for place in near)

# %% [markdown]
# A triangle may begin at any of its corners. With corner 1 first, the corners are 1, 2, 0, and its
# parameters are those of the point's barycentric coordinates in that order: $(u, v)$ becomes
# $(v, 1 - u - v)$. A turn is an affine map, and derivatives mix: if $(s, t) = (v, 1 - u - v)$, then
#
# $$
# \frac{\partial}{\partial u} = -\frac{\partial}{\partial t}, \qquad
# \frac{\partial}{\partial v} = \frac{\partial}{\partial s} - \frac{\partial}{\partial t},
# $$
#
# and three turns are none. Control points turn with the places, by the affine map that carries the
# corners.

# %%
turned_parameters = {u: v, v: w}
for place, polynomial in weights.items():
    a, b = place
    new = b, 1 - a - b  # as parameters
    assert expand(polynomial - weights[new].subs(turned_parameters, simultaneous=True)) == 0
turn = [[0, -1], [1, -1]]  # rows: d/du and d/dv in terms of d/ds and d/dt
for place in near:
    f = weights[place]
    composed = f.subs(turned_parameters, simultaneous=True)
    for row, variable in zip(turn, (u, v), strict=True):
        mixed = sum(c * f.diff(x) for c, x in zip(row, (u, v), strict=True))
        assert (
            expand(composed.diff(variable) - mixed.subs(turned_parameters, simultaneous=True)) == 0
        )

# %% [markdown]
# ## 5. Any mesh
#
# Loop keeps the edge's mask and lets the vertex of valence $N$ move to
#
# $$
# (1 - N \beta_N) \, c + \beta_N \sum_j e_j, \qquad
# \beta_N = \frac1N \left( \frac58 - \left( \frac38 + \frac14 \cos\frac{2 \pi}{N} \right)^2 \right).
# $$
#
# Warren takes $\beta_3 = \frac{3}{16}$ and $\beta_N = \frac{3}{8 N}$ else. Both are $\frac1{16}$ at
# $N = 6$. By Niven's theorem a rational multiple of $\pi$ has a rational cosine at multiples of
# $\frac{\pi}{3}$ and $\frac{\pi}{2}$ alone, so that Loop's weights are rational for
# $N = 1, 2, 3, 4, 6$ and for no others: for a rational weight $\frac38 + \frac14 \cos$ would have a
# rational square, and
#
# $$
# \left( \frac38 + \frac14 c \right)^2 = \frac{11}{64} + \frac{3}{16} c + \frac{1}{32} \cos 2 x
# , \qquad c = \cos x, \quad x = \frac{2 \pi}{N} .
# $$
#
# If that is rational, $c$ is of degree two at most; such cosines belong to $N = 5, 8, 10, 12$
# besides those named, where it is not rational.

# %%
c = Symbol("c")
square = Rational(11, 64) + 3 * c / 16 + (2 * c**2 - 1) / 32
assert expand((Rational(3, 8) + c / 4) ** 2 - square) == 0


def loop_weight(n):
    return (Rational(5, 8) - (Rational(3, 8) + cos(2 * pi / n) / 4) ** 2) / n


assert [loop_weight(n) for n in (2, 3)] == [Rational(39, 128), Rational(3, 16)]
assert [loop_weight(n) for n in (4, 6)] == [Rational(31, 256), Rational(1, 16)]
assert Rational(3, 8 * 6) == loop_weight(6)
assert all(expand(loop_weight(n)).is_rational is False for n in (5, 8, 10, 12))

# %% [markdown]
# ## 6. Boundaries
#
# A boundary edge is halved, a boundary vertex moves by $\frac18, \frac34, \frac18$: knot insertion
# for cubic curves ([masks_bicubic](masks_bicubic.py), section 1). Is the surface still a box spline
# inside? Continue a regular mesh beyond its boundary by parallelograms: the phantom beyond an edge
# $a b$ whose triangle has the third corner $i$ is $a + b - i$. The masks of the regular mesh then
# give the boundary its curve's rule, and phantoms that are again such: the argument repeats. At
# every vertex of the boundary three faces meet.

# %%
rows = {(a, b): Symbol(f"q{a + 3}{b}") for a, b in product(range(-3, 4), range(3))}
rows |= {(a, -1): rows[a, 0] + rows[a - 1, 0] - rows[a - 1, 1] for a in range(-2, 4)}


def new_point(k):
    return expand(sum(share * rows[place] for place, share in masks(k).items()))


assert new_point((0, 0)) == expand((rows[-1, 0] + 6 * rows[0, 0] + rows[1, 0]) / 8)
assert new_point((1, 0)) == expand((rows[0, 0] + rows[1, 0]) / 2)
for a in (0, 1):  # beyond both kinds of new edges
    parallelogram = new_point((a, 0)) + new_point((a - 1, 0)) - new_point((a - 1, 1))
    assert expand(new_point((a, -1)) - parallelogram) == 0

# %% [markdown]
# The triangle at the boundary then ends on the cubic curve of the boundary, whatever is inside.

# %%
b = [rows[a, 0] for a in range(-1, 3)]
edge = expand(sum(p.subs(v, 0) * rows[place] for place, p in weights.items()))
cubic = (1 - u) ** 3 * b[0] + (4 - 6 * u**2 + 3 * u**3) * b[1]
cubic += (1 + 3 * u + 3 * u**2 - 3 * u**3) * b[2] + u**3 * b[3]
assert expand(edge - cubic / 6) == 0

# %% [markdown]
# ## 7. Splines of degree 1
#
# Fewer steps along the same directions: two along each edge of a square make the product of two
# hats, one along each of $d_1, d_2, d_3$ a hat over the six triangles around a vertex. The masks
# are one product again, $2^{2 - n} \prod (1 + z^r)$: vertices stay, edges are halved, and a square
# has a point in its middle. A face has its corners for control points and no others. That is a
# scheme for any mesh: its children cover the same bilinear quad, or the same plane triangle, with
# parameters that are those of section 4.


# %%
def product_masks(directions):
    """Shares of the control points, by the parity of a refined point's place."""
    sums = {(0, 0): Rational(4, 2 ** len(directions))}
    for x, y in directions:
        moved = {(a + x, b + y): share for (a, b), share in sums.items()}
        sums = {k: sums.get(k, 0) + moved.get(k, 0) for k in sums.keys() | moved.keys()}
    found = {}
    for (a, b), share in sums.items():
        found.setdefault((a % 2, b % 2), []).append(share)
    return {parity: sorted(shares) for parity, shares in found.items()}


HALF = Rational(1, 2)
# the centre of the first is a lattice point, that of the other halfway along d_2 twice
assert product_masks([(1, 0), (1, 0), (0, 1), (0, 1)]) == {
    (0, 0): [HALF / 2] * 4, (1, 0): [HALF] * 2, (0, 1): [HALF] * 2, (1, 1): [1]
}  # fmt: skip
assert product_masks([(1, 0), (0, 1), (-1, 1)]) == {
    (0, 0): [HALF] * 2, (1, 0): [HALF] * 2, (1, 1): [HALF] * 2, (0, 1): [1]
}  # fmt: skip

p0, p1, p2, p3 = symbols("p:4")


def bilinear(corners, x, y):
    a, b, c, d = corners
    return (1 - y) * ((1 - x) * a + x * b) + y * ((1 - x) * d + x * c)


def linear(corners, x, y):
    a, b, c = corners
    return (1 - x - y) * a + x * b + y * c


quad, triangle = (p0, p1, p2, p3), (p0, p1, p2)
middle, halves = sum(quad) / 4, [(quad[k] + quad[(k + 1) % 4]) / 2 for k in range(4)]
for k, (x, y) in enumerate([(0, 0), (1, 0), (1, 1), (0, 1)]):
    child = [quad[k], halves[k], middle, halves[k - 1]]
    child = child[-k:] + child[:-k]  # turned back: u and v keep their directions
    assert expand(bilinear(child, u, v) - bilinear(quad, (x + u) / 2, (y + v) / 2)) == 0
m = [(triangle[k] + triangle[(k + 1) % 3]) / 2 for k in range(3)]
for corners, place in (
    ((p0, m[0], m[2]), (u / 2, v / 2)),
    ((m[0], p1, m[1]), ((1 + u) / 2, v / 2)),
    ((m[2], m[1], p2), (u / 2, (1 + v) / 2)),
    ((m[1], m[2], m[0]), ((1 - u) / 2, (1 - v) / 2)),
):
    assert expand(linear(corners, u, v) - linear(triangle, *place)) == 0

# %% [markdown]
# Where two corners $a, b$ of a quad $a b c d$ are one point, derivatives along $u$ vanish there
# like $v$, and the normal has a limit, along $(c - d) \times (d - a)$, at all of that side.

# %%
a, b, c, d = (Matrix(symbols(f"{name}:3")) for name in "abcd")
x = bilinear((a, a, c, d), u, v)
cross = x.diff(u).cross(x.diff(v))
limit = (cross / v).applyfunc(lambda term: cancel(term).subs(v, 0))
assert (limit - (c - d).cross(d - a + u * (c - d))).applyfunc(expand).is_zero_matrix
assert (limit - (c - d).cross(d - a)).applyfunc(expand).is_zero_matrix
