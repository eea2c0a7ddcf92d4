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
"""How far a surface is from the triangles between its points.

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Tessellation to a tolerance
#
# Let $x_0, x_1, x_2$ be the corners of a triangle of parameters, $X_i = f(x_i)$, and
# $x = \sum \lambda_i x_i$ a place in it, $\lambda_i \ge 0$, $\sum \lambda_i = 1$. How far is $f(x)$
# from the triangle $(X_0, X_1, X_2)$, at most?
#
# - D. Filip, R. Magedson, R. Markot, "Surface algorithms using bounds on derivatives", Computer
#   Aided Geometric Design 3 (1986).

# %%
from functools import partial
from itertools import combinations, permutations, product

import numpy as np
from sympy import Matrix, Rational, expand, simplify, symbols

from limitsurf import LimitSurface, Mesh, View
from limitsurf.pieces import bernstein
from limitsurf.query.chords import distance, triangles_error
from limitsurf.query.cones import Poles, Turning
from limitsurf.query.hulls import Hulls, on_triangle
from limitsurf.query.index import Cells
from limitsurf.query.polynomials import Form
from limitsurf.scheme.lattice import QUADS

# %% [markdown]
# ## 1. Second derivatives
#
# Taylor's formula from $x$ to each corner, with $\sum \lambda_i (x_i - x) = 0$, is
#
# $$\sum \lambda_i X_i - f(x) = \sum_i \lambda_i \int_0^1 (1 - \tau)\,
# f''(x + \tau (x_i - x))(x_i - x, x_i - x)\, d\tau.$$
#
# It needs first derivatives that are continuous and second ones that are bounded. If $f'' = H$ is
# constant the right side is $\frac12 \sum_i \lambda_i H(x_i - x, x_i - x)$, which the edges alone
# determine:
#
# $$\sum_i \lambda_i H(x_i - x, x_i - x) = \sum_{i < j} \lambda_i \lambda_j
# H(x_i - x_j, x_i - x_j).$$

# %%
l0, l1, a, b, c = symbols("l0 l1 a b c")
shares = [l0, l1, 1 - l0 - l1]
corners = [Matrix(symbols(f"s{i} t{i}")) for i in range(3)]
form = Matrix([[a, b], [b, c]])
inside = sum((w * p for w, p in zip(shares, corners, strict=True)), Matrix([0, 0]))


def squared(step: Matrix) -> object:
    """The form along a step, twice."""
    return (step.T * form * step)[0]


left = sum(w * squared(p - inside) for w, p in zip(shares, corners, strict=True))
right = sum(
    shares[i] * shares[j] * squared(corners[i] - corners[j]) for i, j in combinations(range(3), 2)
)
assert expand(left - right) == 0

# %% [markdown]
# ## 2. What differs from the mean
#
# In a part of a face with parameters $(s, t)$ let $H$ be any constant, and the second derivatives
# differ from it by at most $r_{ss}, r_{st}, r_{tt}$ (lengths of vectors): the largest difference of
# Bernstein coefficients, since their mean with weights that are not negative and sum to one is what
# is bounded. That adds at most $\frac12 \sum \lambda_i (r_{ss}\, \delta_i^2 + 2 r_{st}
# |\delta_i \epsilon_i| + r_{tt}\, \epsilon_i^2)$ with $x_i - x = (\delta_i, \epsilon_i)$. A mean of
# squares of deviations in an interval of length $w$ is at most $w^2 / 4$, and by Cauchy and Schwarz
# the mean of products at most $w h / 4$. So for a triangle in a box $w \times h$ it is at most
#
# $$\tfrac18 (r_{ss}\, w^2 + 2 r_{st}\, w h + r_{tt}\, h^2).$$

# %%
# the mean of squares: deviations from the mean of numbers between 0 and 1
m, x = symbols("m x")
# (x - m)^2 <= (1 - m)^2 x + m^2 (1 - x) on [0, 1], a parabola below its chord; of mean m (1 - m)
chord = (1 - m) ** 2 * x + m**2 * (1 - x)
assert expand(chord - (x - m) ** 2 - x * (1 - x)) == 0
assert expand(chord.subs(x, m) - m * (1 - m)) == 0
assert expand(Rational(1, 4) - m * (1 - m) - (m - Rational(1, 2)) ** 2) == 0

# %% [markdown]
# ## 3. Sliding along edges
#
# For constant $H$ let $h_{ij} = H(x_i - x_j, x_i - x_j)$, so that $f(x) = \sum \lambda_i X_i -
# \frac12 \sum_{i < j} \lambda_i \lambda_j h_{ij}$. Split $h_{ij} = \alpha_{ij} (X_j - X_i) +
# h'_{ij}$ with $|\alpha_{ij}| \le 2$. The first part moves the point within the triangle: the new
# share of corner $i$ is $\lambda_i (1 + \frac12 \sum_j \pm \alpha_{ij} \lambda_j)
# \ge \lambda_i (1 - \sum_{j \ne i} \lambda_j) \ge 0$, and the sum stays one. So the distance from
# the triangle is at most $\frac12 |\sum \lambda_i \lambda_j h'_{ij}|$: a surface that is flat, with
# straight edges, is at distance 0 however its parameters run. Best is the projection of $h_{ij}$
# onto the edge.

# %%
alpha = symbols("alpha01 alpha02 alpha12")
pairs = list(combinations(range(3), 2))
X = symbols("X0:3")
moved = sum(w * p for w, p in zip(shares, X, strict=True)) - Rational(1, 2) * sum(
    shares[i] * shares[j] * k * (X[j] - X[i]) for k, (i, j) in zip(alpha, pairs, strict=True)
)
new = [expand(moved).coeff(p) for p in X]
assert expand(sum(new) - 1) == 0
for sign in product((-2, 2), repeat=3):
    for i in range(3):
        share = simplify(new[i].subs(dict(zip(alpha, sign, strict=True))) / shares[i])
        least = 1 - sum(w for j, w in enumerate(shares) if j != i)
        for at in ((0, 0), (1, 0), (0, 1), (Rational(1, 3), Rational(1, 3))):
            where = dict(zip((l0, l1), at, strict=True))
            assert share.subs(where) >= least.subs(where) >= 0

# %% [markdown]
# ## 4. The largest sum
#
# The weights $w = (\lambda_0 \lambda_1, \lambda_1 \lambda_2, \lambda_2 \lambda_0)$ are not
# negative, two of them sum to $\lambda_i (1 - \lambda_i) \le \frac14$, and all to at most
# $\frac13$. The length of $\sum w_k h_k$ is convex in $w$, so it is largest at a vertex of the
# polytope of these inequalities: 0, $\frac14$ alone, and $(\frac16, \frac1{12}, \frac1{12})$, each
# in three ways. Half of it is then at most
# $\frac18 \max(|h_k|, \frac13 |h_k + h_0 + h_1 + h_2|)$.

# %%
third, quarter = Rational(1, 3), Rational(1, 4)
planes = [((1, 0, 0), 0), ((0, 1, 0), 0), ((0, 0, 1), 0), ((1, 1, 1), third)]
planes += [((1, 1, 0), quarter), ((0, 1, 1), quarter), ((1, 0, 1), quarter)]
vertices = set()
for three in combinations(planes, 3):
    matrix = Matrix([row for row, _ in three])
    if matrix.det() != 0:
        w = matrix.solve(Matrix([value for _, value in three]))
        below = all(sum(p * q for p, q in zip(row, w, strict=True)) <= v for row, v in planes[3:])
        if min(w) >= 0 and below:
            vertices.add(tuple(w))
sixth, twelfth = Rational(1, 6), Rational(1, 12)
wanted = {(0, 0, 0), *permutations((quarter, 0, 0)), *permutations((sixth, twelfth, twelfth))}
eighth = Rational(1, 8)
# (1/8, 1/8, 0) lies amid an edge: it is no vertex, but planes may meet there
assert vertices - wanted <= {*permutations((eighth, eighth, 0))}

# %% [markdown]
# All of that against a bicubic patch: `triangles_error` holds, and is no more than twice what is
# found.

# %%
form_ = Form.of(QUADS, 3)
rng = np.random.default_rng(0)
for bump in (0.02, 0.2):
    flat = np.column_stack([form_.exponents / 3, np.zeros(16)])
    points = flat + bump * rng.normal(size=flat.shape)
    second = (form_.derivatives[3:] @ points).reshape(3, 16, 3)
    middle = (second.min(axis=1) + second.max(axis=1)) / 2
    loose = np.sqrt(((second - middle[:, None]) ** 2).sum(axis=2)).max(axis=1)
    for at in (
        form_.ends[[0, 1, 2]],
        form_.ends[[1, 2, 3]],
        np.array([[0.5, 0.5], [1, 0], [1, 1]]),
    ):
        own = form_.values(*at.T, 0)[:, 0] @ points
        bound = triangles_error(middle, loose, at, own)
        w = rng.dirichlet((1, 1, 1), 2000)
        there = form_.values(*(w @ at).T, 0)[:, 0] @ points
        far = distance((there - own[0])[None], (own - own[0])[None])[0]
        assert far.max() <= bound

# %% [markdown]
# ## 5. Special corners
#
# Around a special corner second derivatives may grow without bounds. Distance from a triangle is
# a convex function, so on a piece of the surface over a part of the triangle it is at most its
# largest value at the Bernstein coefficients of that piece. A part at a special corner is two
# triangles that meet in the diagonal from the corner (one, if faces are triangles). Of the three
# cells of each ring the one across lies in both: its polynomial of degrees $d$ has degree $2 d$ on
# the triangles on either side of the diagonal. What remains after some rings is within a distance
# of the corner's limit (`pieces.beyond.Beyond.reach`), which is a corner of both triangles.

# %%
points = rng.normal(size=(16, 3))
_, whole = on_triangle(form_, form_.ends[[0, 1, 2]])
places = np.array([(i, j) for j in range(7) for i in range(7 - j)])
s, t = rng.dirichlet((1, 1, 1), 50)[:, 1:].T
triangular = bernstein.polynomials(places, s, t) @ (whole @ points)
# (s, t) from corner 0: to corner 1 = (1, 0) and to corner 2 = (1, 1)
square = form_.values(s + t, t, 0)[:, 0] @ points
assert abs(triangular - square).max() < 1e-10

# %% [markdown]
# ## 6. Normals
#
# On a part with one polynomial the cross product $C = f_s \times f_t$ is a polynomial too, of
# twice the degree, and a mean of its Bernstein coefficients with weights that are not negative.
# Vectors within an angle $\omega < 90°$ of a unit vector $m$ are a convex cone. So if all
# coefficients are within $\omega$ of the normal $m$ of a triangle, so are all normals over it.
#
# Between its corners $x_i$ a renderer takes the direction of $\sum \lambda_i n_i$ with
# $n_i = C_i / |C_i|$. It is in the same cone, hence at most $2 \omega$ off; and for small triangles
# much less. The direction of $\sum \lambda_i C_i$ is off by $\arcsin (E / \min |C|)$ at most, if
# $E$ is the bound of sections 1 and 2 for $C$ instead of $f$, without sliding, and $\min |C|$ at
# least the least coefficient along $m$. It is $\sum \lambda'_i n_i$ with weights in the
# proportion of $\lambda_i |C_i|$. Weights that are multiplied by numbers within a ratio $r$ shift
# at most $(\sqrt r - 1) / (\sqrt r + 1)$ of themselves, so the direction turns by
# $\arcsin$ of that times the largest $|n_i - n_j|$, over $\cos \omega$, by which both are long.

# %%
share, r = symbols("share r", positive=True)
moved_share = share * r / (share * r + 1 - share) - share
best_share = 1 / (1 + r ** Rational(1, 2))
assert simplify(moved_share.diff(share).subs(share, best_share)) == 0
most_moved = (r ** Rational(1, 2) - 1) / (r ** Rational(1, 2) + 1)
for value in (1, 2, 9, 100):
    gap = (moved_share.subs(share, best_share) - most_moved).subs(r, value)
    assert abs(float(gap)) < 1e-12

turning = Turning(QUADS, form_)
for bump in (0.01, 0.1):
    points = np.column_stack([form_.exponents / 3, np.zeros(16)]) + bump * rng.normal(size=(16, 3))
    at = np.array([[0.1, 0.0], [1.0, 0.2], [0.4, 0.9]])
    corner = form_.values(*at.T, 0)[:, 0] @ points
    (bound,) = turning.cut(points[None], np.zeros(1, dtype=int), at[None], corner[None])
    w = rng.dirichlet((1, 1, 1), 2000)
    both = np.vstack([w @ at, at])
    _, du, dv = np.moveaxis(form_.values(*both.T, 1) @ points, 1, 0)
    normal = np.cross(du, dv)
    normal /= np.sqrt((normal**2).sum(axis=1))[:, None]
    flat = np.cross(corner[1] - corner[0], corner[2] - corner[0])
    for other in (np.tile(flat, (2000, 1)), w @ normal[-3:]):
        sine = np.sqrt((np.cross(other, normal[:-3]) ** 2).sum(axis=1))
        assert np.arctan2(sine, (other * normal[:-3]).sum(axis=1)).max() <= bound

# %% [markdown]
# ## 7. Normals around special corners
#
# On ring $n$ the surface is $\sum_j \lambda_j^n q_j \varphi_j$ with eigenfunctions $\varphi_j$ on
# the first ring. Let $a$ and $b$ lead, and $J = \partial_s \varphi_a \partial_t \varphi_b -
# \partial_t \varphi_a \partial_s \varphi_b$ be of one sign with $|J| \ge J_0$ (its coefficients
# say so). Divided by $(\lambda_a \lambda_b)^n$ the cross product of derivatives is
# $(q_a \times q_b) J$ and what is made of others,
#
# $$|q_a| |\partial_s \varphi_a| R^b_t + R^b_s |q_a| |\partial_t \varphi_a| +
# |q_b| |\partial_s \varphi_b| R^a_t + R^a_s |q_b| |\partial_t \varphi_b| + R^a_s R^b_t, \quad
# R^x_y = \sum_{j \ne a, b} |q_j| |\partial_y \varphi_j| (|\lambda_j| / \lambda_x)^n$$
#
# at most. If all other $|\lambda_j|$ are smaller, that falls with $n$. So from ring $n$ on all
# normals are within $\arcsin$ of it over $|q_a \times q_b| J_0$ of the limit, that of
# $\pm q_a \times q_b$. It falls like $(|\lambda_3| / \lambda_2)^n$: curvature may be unbounded,
# normals still have a limit. Where the corner has none, or others fall as slowly, rings do not
# help, and where valence is high they help slowly. `tessellate` gives up there.
#
# Where valence is high that is far too much: sizes are summed of what has signs. Let $x_k =
# (\lambda_k / \lambda_2)^m$ be what eigenfunction $k$ falls by in $m$ rings more. If $1 > x_1 \ge
# x_2 \ge \dots \ge 0$, then $x_k$ are means of $(0, 0, \dots)$, $(1, 0, \dots)$, $(1, 1, 0,
# \dots)$ and so on, with weights $1 - x_1$, $x_1 - x_2$, ...: for whatever vectors $D_k$,
# $\sum x_k D_k$ is in the hull of the sums of the first few of them. That holds for all rings at
# once, as it takes only that eigenvalues are positive, without chains or complex pairs. $D_k$ are
# the coefficients of what $\varphi_k$ adds to the normals, $J_{ak} q_a \times q_k$ and
# $J_{bk} q_b \times q_k$; those of equal eigenvalues are one. The tangent of the angle from the
# limit normal is a convex function over a linear one, and so no larger than at one of these sums.
# The same with derivatives bounds products of two that are not leading. Of eigenfunctions those
# that matter most are summed so, what is left by sizes as above. Across the limit normal products
# of two tangents are no more than the size of one times the height of the other, twice: a plane's
# normals do not turn.

# %%
x1, x2, x3 = symbols("x1:4")
chain = [(1 - x1, (0, 0, 0)), (x1 - x2, (1, 0, 0)), (x2 - x3, (1, 1, 0)), (x3, (1, 1, 1))]
assert simplify(sum(w for w, _ in chain)) == 1
assert [simplify(sum(w * e[k] for w, e in chain)) for k in range(3)] == [x1, x2, x3]

# %%
for valence in (3, 5, 8, 24):
    spokes = np.arange(valence) * 2 * np.pi / valence
    ring = np.exp(1j * spokes)
    outer = (ring + np.roll(ring, -1)) * (1.0 if valence > 3 else 1.5)
    z = np.concatenate([[0], ring, outer])
    tip = np.column_stack([z.real, z.imag, 0.3 * (z.real**2 - 0.5 * z.imag * z.real)])
    k = np.arange(valence)
    quads = np.column_stack([0 * k, 1 + k, 1 + valence + k, 1 + (k + 1) % valence])
    surface = LimitSurface(Mesh(tip, quads, boundary="edge_and_corner"), engine="reference")
    cells = Cells(surface, 1, 0)
    which = np.flatnonzero(cells.beyond.is_smooth)[:1]
    leaf = len(cells.points) + which[0]
    for level in (3, 6):
        axis, wide = Poles(cells.beyond, cells.lattice, cells.form).cones(which, np.array([level]))
        near = cells.origin[leaf] + cells.size[leaf] * 0.5**level * rng.random((500, 2))
        normal = surface.normal(cells.face[leaf], *near.T)
        sine = np.sqrt((np.cross(normal, axis) ** 2).sum(axis=1))
        found = np.arctan2(sine, normal @ axis[0]).max()
        assert found <= wide[0] < 6 * found

# %% [markdown]
# ## 8. Pictures
#
# A camera at the origin looks along $z$; $p = (X, Y) / Z$ is where a point $P$ is in the picture.
# For $Q$ beside it, $E = P - Q$,
#
# $$p - q = \frac{1}{Z_Q} \left( E_{xy} - p\, E_z \right),$$
#
# the vector $E$ moved along the ray of $P$ into the plane of the picture, which makes it longer by
# $\sqrt{1 + |p|^2}$ at most. Let $w$ be the ray of the middle of a part, at $p_w$. Of $E$, what is
# across $w$ has a bound like that of section 3, with $h'$ across $w$; what is along it, $|E|$ at
# most, becomes $w_z (p_w - p)$. So $p - q$ is at most $1 / Z_Q$ times the smaller of
# $|E| \sqrt{1 + |p|^2}$ and $|E_\perp| \sqrt{1 + |p|^2} + |E| |p_w - p|$. Only $P$ need be seen:
# $|p|$ is at most that of a corner of the picture, and $Z_Q$ at least the least of the triangle's
# corners, or that of what is near less $|E|$.

# %%
X, Y, Z, U, V, W = symbols("X Y Z U V W")
for one, other in ((X, U), (Y, V)):
    gap = one / Z - other / W - ((one - other) - one / Z * (Z - W)) / W
    assert simplify(gap) == 0

sight = View((0, -4, 1), (0, 0, 0), field_of_view=50).scaled(0)
flat = np.column_stack([form_.exponents / 3 - 0.5, np.zeros(16)])
for seed in range(4):
    points = flat + 0.1 * np.random.default_rng(seed).normal(size=flat.shape)
    second = (form_.derivatives[3:] @ points).reshape(3, 16, 3)
    middle = (second.min(axis=1) + second.max(axis=1)) / 2
    loose = np.sqrt(((second - middle[:, None]) ** 2).sum(axis=2)).max(axis=1)
    at = form_.ends[[0, 1, 2]]
    own = form_.values(*at.T, 0)[:, 0] @ points
    known = middle[None], loose[None], at[None], own[None]
    (bound,) = sight.seen(own[None], triangles_error(*known), partial(triangles_error, *known))
    there = form_.values(*(rng.dirichlet((1, 1, 1), 2000) @ at).T, 0)[:, 0] @ points
    picture = [(x - sight.position) @ sight.axes.T for x in (there, own)]
    lifted = [np.column_stack([sight.focal * x[:, :2] / x[:, 2:], 0 * x[:, 0]]) for x in picture]
    far = distance((lifted[0] - lifted[1][0])[None], (lifted[1] - lifted[1][0])[None])
    assert far.max() <= bound

# %% [markdown]
# ## 9. Hulls on parts with one polynomial
#
# What is loose in section 2 is that second derivatives may differ from their mean in any direction,
# though most of that moves points along the triangle only. Where the bound of section 3 is up to 6
# times too large, the hulls of section 5 are asked as well: of the polynomial on the four quarters
# of the triangle. Those of a parabola touch it at its top. Places amid sides and of the middle come
# first: where one of these is too far, hulls are not needed.

# %%
hulls = Hulls(form_)
for bump in (0.01, 0.05):
    points = np.column_stack([form_.exponents / 3, np.zeros(16)]) + bump * rng.normal(size=(16, 3))
    at = np.array([[0.1, 0.0], [1.0, 0.2], [0.4, 0.9]])
    own = form_.values(*at.T, 0)[:, 0] @ points
    (bound,) = hulls.cut(points[None], at[None], own[None], np.inf)
    w = rng.dirichlet((1, 1, 1), 4000)
    there = form_.values(*(w @ at).T, 0)[:, 0] @ points
    far = distance((there - own[0])[None], (own - own[0])[None])[0].max()
    assert far <= bound < 1.6 * far
    assert hulls.whole(points[None], 0.5 * far)[0] == np.inf
    corners = points[form_.corners]
    (bound,) = hulls.whole(points[None], np.inf)
    for way in ((0, 1, 2), (0, 2, 3), (0, 1, 3), (1, 2, 3)):
        there = form_.values(*(w @ form_.ends[list(way)]).T, 0)[:, 0] @ points
        triangle = corners[list(way)]
        assert distance((there - triangle[0])[None], (triangle - triangle[0])[None]).max() <= bound
parabola = np.column_stack(
    [form_.exponents / 3, form_.exponents[:, 0] * (form_.exponents[:, 0] - 3)]
)
(bound,) = hulls.whole(parabola[None], np.inf)
top = np.abs(form_.values(np.array([0.5]), np.zeros(1), 0)[0, 0] @ parabola)[2]
assert abs(bound - top) < 0.1 * top
