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
"""Approximate patches: masks of bicubic and of Gregory patches, and bounds of how far they are.

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Approximate patches
#
# One patch to a quad, near a Catmull-Clark surface. This document derives
#
# 1. masks of a patch's corners and of what is next to them;
# 2. tangents along an edge that both patches there agree on the plane of;
# 3. the points inside Gregory patches;
# 4. bounds of how far patches are from the limit;
# 5. bounds of the angles between their normals, and where these are largest.
#
# - C. Loop, S. Schaefer, "Approximating Catmull-Clark subdivision surfaces with bicubic patches",
#   ACM Transactions on Graphics 27, 2008.
# - C. Loop, S. Schaefer, T. Ni, I. Castano, "Approximating subdivision surfaces with Gregory
#   patches for hardware tessellation", ACM Transactions on Graphics 28, 2009.

# %%
import numpy as np
from sympy import Rational, cos, expand, pi, simplify, sqrt, symbols

from limitsurf.query.polynomials import Form, line_values
from limitsurf.scheme.lattice import QUADS

# %% [markdown]
# ## 1. Corners, and what is next to them
#
# Around a vertex $v$ of $n$ faces are the ends $e_j$ of its edges and the opposite corners $f_j$ of
# its faces. A regular face has the Bezier points of its bicubic B-spline. With $n$ for 4, so that
# weights still sum to one, their masks are
#
# $$
# \frac{n^2 v + \sum (4 e_j + f_j)}{n (n + 5)}, \quad
# \frac{2 n v + 4 e_0 + 2 (e_1 + e_{-1}) + f_0 + f_{-1}}{2 (n + 5)}, \quad
# \frac{n v + 2 (e_0 + e_1) + f_0}{n + 5}
# $$
#
# at the corner, towards $e_0$, and inside face $0$. The first is the limit of the vertex for all
# $n$. The two inside on both sides of an edge have the one on it for their middle.


# %%
def mask(n, *terms):
    """Weights of v, e and f of a ring, from (index or None, weight) of each of the three."""
    v, e, f = {0: 0}, dict.fromkeys(range(n), 0), dict.fromkeys(range(n), 0)
    for what, k, weight in terms:
        {"v": v, "e": e, "f": f}[what][0 if what == "v" else k % n] += weight
    return np.array([*v.values(), *e.values(), *f.values()], dtype=object)


def bicubic_masks(n):
    every = [("e", k, 4) for k in range(n)] + [("f", k, 1) for k in range(n)]
    corner = mask(n, ("v", 0, n * n), *every) * Rational(1, n * (n + 5))
    edge = mask(n, ("v", 0, 2 * n), ("e", 0, 4), ("e", 1, 2), ("e", -1, 2), ("f", 0, 1),
                ("f", -1, 1)) * Rational(1, 2 * (n + 5))  # fmt: skip
    inside = [mask(n, ("v", 0, n), ("e", k, 2), ("e", k + 1, 2), ("f", k, 1)) * Rational(1, n + 5)
              for k in (0, -1)]  # fmt: skip
    return corner, edge, *inside


for n in (3, 4, 5, 8):
    corner, edge, inside, other = bicubic_masks(n)
    assert all(sum(x) == 1 for x in (corner, edge, inside, other))
    assert [expand(x) for x in inside + other - 2 * edge] == [0] * (2 * n + 1)
    # the first is that of the refined ring too, so of its limit
    quarter = Rational(1, 4)
    ring = [mask(n, ("v", 0, 1))] + [mask(n, (what, k, 1)) for what in "ef" for k in range(n)]
    v, e, f = ring[0], ring[1 : n + 1], ring[n + 1 :]
    faces = [quarter * (v + e[k] + e[(k + 1) % n] + f[k]) for k in range(n)]
    edges = [quarter * (v + e[k] + faces[k] + faces[k - 1]) for k in range(n)]
    vertex = Rational(n - 2, n) * v + (sum(e) + sum(faces)) * Rational(1, n * n)
    finer = np.array([vertex, *edges, *faces])
    assert (corner @ finer == corner).all()

# %% [markdown]
# The tangent of the limit towards $e_0$, by its mask in closed form, is a sum over the ring of
#
# $$
# \left( \frac1n + \frac{c}{n \sqrt{4 + c^2}} \right) \cos \frac{2 \pi j}{n} \; e_j +
# \frac{1}{n \sqrt{4 + c^2}} \cos \frac{(2 j + 1) \pi}{n} \; f_j, \qquad c = \cos \frac{\pi}{n}
# $$
#
# which is the derivative at $n = 4$; and Loop et al. write the same with middles $m_j$ of edges and
# of faces $c_j$, and $\sigma = 1 / \sqrt{4 + c^2}$,
#
# $$
# q = \frac2n \sum_j (1 - \sigma c) \cos \frac{2 \pi j}{n} \; m_j +
# 2 \sigma \cos \frac{(2 j + 1) \pi}{n} \; c_j .
# $$
#
# They are the same vector: a face's middle has a quarter of each of two $e$ and of $f$.

# %%
for n in (3, 4, 5, 8):
    c = cos(pi / n)
    sigma = 1 / sqrt(4 + c**2)
    for j in range(n):
        e = (1 - sigma * c) * cos(2 * pi * j / n) / 2
        e += 2 * sigma * (cos((2 * j + 1) * pi / n) + cos((2 * j - 1) * pi / n)) / 4
        f = 2 * sigma * cos((2 * j + 1) * pi / n) / 4
        first = (1 + c * sigma) * cos(2 * pi * j / n) / n
        second = sigma * cos((2 * j + 1) * pi / n) / n
        assert abs((2 * e / n - first).evalf(30)) < 1e-25
        assert abs((2 * f / n - second).evalf(30)) < 1e-25

# %% [markdown]
# ## 2. Tangents across an edge
#
# Along an edge between vertices of $n$ and $m$ faces, at $x = 0$ and $1$, let $t(x)$ be the tangent
# along it, of degree 2 with the Bezier points $t_0, t_1, t_2$. The tangents $a(x)$ and $b(x)$
# across it on both sides are to satisfy
#
# $$
# a(x) + b(x) = 2 \left( (1 - x) \cos \frac{2 \pi}{n} - x \cos \frac{2 \pi}{m} \right) t(x) ,
# $$
#
# as tangents at vertices do: those at $\pm 2 \pi / n$ from an edge add up to
# $2 \cos (2 \pi / n)$ times that of the edge. Then all three are in one plane. So $a$ is half of
# the right side plus a vector $w(x)$, and $b$ half of it minus $w$. The Bezier points of that half
# are, with $C = \cos (2 \pi / n)$ and $D = \cos (2 \pi / m)$,
# $C t_0$, $(2 C t_1 - D t_0) / 3$, $(C t_2 - 2 D t_1) / 3$ and $-D t_2$.

# %%
x, C, D, t0, t1, t2 = symbols("x C D t0 t1 t2")
tangent = (1 - x) ** 2 * t0 + 2 * x * (1 - x) * t1 + x**2 * t2
points = C * t0, (2 * C * t1 - D * t0) / 3, (C * t2 - 2 * D * t1) / 3, -D * t2
cubic = sum(
    count * x**k * (1 - x) ** (3 - k) * p
    for k, (count, p) in enumerate(zip((1, 3, 3, 1), points, strict=True))
)
assert expand(cubic - ((1 - x) * C - x * D) * tangent) == 0

# %% [markdown]
# Loop and Schaefer take $w_1 = 3 (b_{11} - b_{10})$, the difference of the patch's own points. It
# changes its sign from side to side, as the two inside have $b_{10}$ for their middle. Loop et al.
# have $w_1 = \frac13 (m_1 - m_{-1}) + \frac23 (c_0 - c_{-1})$, which does too, and is the same at
# $n = 4$.

# %%
for n in (3, 4, 5):
    corner, edge, inside, other = bicubic_masks(n)
    one = 3 * (inside - edge)
    half = Rational(1, 2)
    quarter = Rational(1, 4)
    faces = {
        k: mask(n, ("v", 0, quarter), ("e", k, quarter), ("e", k + 1, quarter), ("f", k, quarter))
        for k in (0, -1)
    }
    two = (mask(n, ("e", 1, half)) - mask(n, ("e", -1, half))) / 3
    two = two + Rational(2, 3) * (faces[0] - faces[-1])
    same = [expand(a - b) for a, b in zip(one, two, strict=True)]
    assert (same == [0] * (2 * n + 1)) == (n == 4)
    assert [expand(a - Rational(n + 5, 9) ** -1 * b) for a, b in zip(one, two, strict=True)] == [
        0
    ] * (2 * n + 1)

# %% [markdown]
# ## 3. Gregory patches
#
# They have derivatives for their tangents: the point next to the corner along an edge is
# $e = p + \frac23 \lambda q$, with the eigenvalue $\lambda$ of the tangent plane for $\frac12$, and
# $3 (f - e)$ must be the $a_1$ of section 2, with $t_0 = 3 (e - p)$ and $t_1 = 3 (e' - e)$, if $e'$
# is the next point along the edge:
#
# $$
# f = \frac13 \left( D p + (3 - 2 C - D) e + 2 C e' + w_1 \right) .
# $$
#
# Each corner has two such, one for each of its edges. In a Gregory patch that on the edge along $u$
# has the weight $a / (a + b)$ and the other $b / (a + b)$, where $a$ and $b$ are the distances from
# the corner along $u$ and along $v$: on each edge one of them is left, to first order.

# %%
p, e, ahead, w = symbols("p e ahead w")
f = (D * p + (3 - 2 * C - D) * e + 2 * C * ahead + w) / 3
assert expand(3 * (f - e) - ((2 * C * 3 * (ahead - e) - D * 3 * (e - p)) / 3 + w)) == 0

a, b = symbols("a b", positive=True)
share = a / (a + b)
# next to the edge b = 0 the weight b^1 of the points inside is left, and the share is 1 there
assert share.subs(b, 0) == 1
assert simplify((b * share).diff(b).subs(b, 0)) == 1
assert simplify((b * share).diff(a).subs(b, 0)) == 0

# %% [markdown]
# ## 4. How far patches are
#
# On a cell on which the limit is a polynomial, so is the difference of a bicubic patch: it is no
# longer than its longest Bernstein coefficient. Of a Gregory patch the points inside are
# $g + \tau h$, where $g$ is the middle of two and $h$ half of their difference, $\lvert \tau \rvert
# \le 1$. So it is no farther from the bicubic patch with $g$ than
# $\sum B_{ij} \lvert h_{ij} \rvert$, a polynomial again, which is less than its largest coefficient
# on the cell. Beyond the last ring around a special corner the limit is in a box, the patch in the
# hull of its points there, and no two points of two boxes are farther apart than their far sides.
# What is found at places bounds from below.

# %%
rng = np.random.default_rng(2)
form = Form.of(QUADS, 3)
i, j = form.exponents.T
control, h = rng.normal(size=(4, 4, 3)), rng.normal(size=(4, 4, 3))
h[[0, 3]], h[:, [0, 3]] = 0, 0
frame = np.array([[[0.25, 0.5], [0.25, 0], [0, 0.5]]])
(part,) = form.part(frame)
middle, most = part @ control[i, j], part @ np.sqrt((h[i, j] ** 2).sum(axis=1))
bound = np.sqrt((middle**2).sum(axis=1)).max() + most.max()
s, t = 0.25 + 0.25 * rng.random(400), 0.5 + 0.5 * rng.random(400)
weights = line_values(3, s)[:, :, None] * line_values(3, t)[:, None]
tau = rng.uniform(-1, 1, (400, 4, 4, 1))
found = np.einsum("qij,qijd->qd", weights, control + tau * h)
assert np.sqrt((found**2).sum(axis=1)).max() <= bound

# %% [markdown]
# ## 5. How far normals are
#
# On a part of a face let $C = f_s \times f_t$ be that of the limit and $P$ that of the patch, or of
# its fields of tangents: polynomials of the same degree, with $C$ in a cone of half angle $\omega$
# around $a$. For any $\kappa > 0$ let $D = P - \kappa C$. With the unit vector $n$ of $C$
#
# $$
# |n \times P| = |n \times D| \le |a \times D| + |n - a| |D|, \quad
# |n - a| \le 2 \sin (\omega / 2),
# $$
#
# and $|P| \ge P \cdot a$, so that the angle is at most $\arcsin$ of what coefficients say of
# $(|a \times D| + 2 \sin (\omega / 2) |D|) / \min (P \cdot a)$. Beyond the last ring the limit is
# in a cone around its normal at the corner (``derivations/tessellation.py``), the patch in another.
#
# In Gregory patches the points inside are $g + \tau h$ with $\tau = (a - b) / (a + b)$ of the
# distances $a, b$ from the corner. They add $(B' \tau + B \tau') h$ to derivatives. In a box of $a$
# and $b$, $\tau$ is between its values at two corners, since it grows with $a$ and falls with $b$;
# and $\partial \tau / \partial a = 2 b / (a + b)^2$ falls with $a$, and in $b$ is largest at
# $b = a$. With the middles of both for them that is a polynomial, and what is left is bounded. At
# the corner itself $s\, t \cdot 2 t / (s + t)^2 \le t / 2$ bounds $B_{11} \tau'$ by
# $\frac92 t (1 - t)^2 (1 - s)^2$.

# %%
s, t = symbols("s t", positive=True)
slope = 2 * b / (a + b) ** 2
assert simplify(((a - b) / (a + b)).diff(a) - slope) == 0
assert simplify(slope.diff(b) * (a + b) ** 3 - 2 * (a - b)) == 0
# t / 2 - s t 2 t / (s + t)^2 is a square over a square
assert simplify((t / 2 - 2 * s * t**2 / (s + t) ** 2) * (s + t) ** 2 - t * (s - t) ** 2 / 2) == 0
# that in Bernstein polynomials, as `_fall` has it
cubic = [1, 3, 3, 1]
bernstein = [[c * x**k * (1 - x) ** (3 - k) for k, c in enumerate(cubic)] for x in (s, t)]
most = (Rational(3, 2) * bernstein[0][0] + Rational(1, 2) * bernstein[0][1]) * bernstein[1][1]
assert expand(most - Rational(9, 2) * t * (1 - t) ** 2 * (1 - s) ** 2) == 0

# %% [markdown]
# The normals of Loop and Schaefer's patches themselves are those of the limit at regular vertices
# alone. At others $b_{10}$ and $b_{01}$ are not on tangents of the limit, as its mask is not the
# left eigenvector of section 1; the fields of tangents are there for that. So the largest angle is
# often at the very corner, and falls steeply beside it, for the normals of the limit tend to the
# last one like a power of the distance that is far below 1. It depends on the grid what one finds.
# On the bitorus of G+Smo (200 quads) the angle is 7.216 degrees at a corner of 5 faces, 6.87 at
# (0.001, 0.001) from it, 5.81 at (0.01, 0.01) and 4.66 at (1/32, 1/32): the 5.8 degrees that are
# quoted for it are those of places that keep 0.01 away from corners, and no bound. The bound is
# 7.98. The fields of tangents are 3.92 degrees off at most there, bounded by 4.18; the distance is
# 3.58e-3 of the longest side. At the corners of a cube all is symmetric, and the angle is 0.

# %%
for n in (3, 5, 8):
    _, edge, *_ = bicubic_masks(n)
    corner = bicubic_masks(n)[0]
    out = np.array([float(x) for x in edge - corner])
    # waves of the ring that the tangent has no part of: cos (4 pi j / n) is one from 5 faces on
    second = sum(out[1 + k] * np.exp(4j * np.pi * k / n) for k in range(n))
    assert (abs(second) < 1e-12) == (n == 3) or n == 3
    first = 1 / n + float(cos(pi / n)) / n / float(sqrt(4 + cos(pi / n) ** 2))
    tangent = [first * np.cos(2 * np.pi * k / n) for k in range(n)]
    assert abs(sum(x * np.exp(4j * np.pi * k / n) for k, x in enumerate(tangent))) < 1e-12 or n == 3
