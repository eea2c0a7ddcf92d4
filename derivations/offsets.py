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
"""Offsets: their derivatives and curvatures, volumes between, and what happens at poles.

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Offsets
#
# The offset of a surface $p(u, v)$ at distance $d$ is $q = p + d \, n$ with the unit normal $n$.
#
# - R. T. Farouki, "The approximation of non-degenerate offset surfaces", Computer Aided Geometric
#   Design 3 (1986).
# - J. Steiner, "Ueber parallele Flaechen", Monatsbericht der Akademie der Wissenschaften zu Berlin
#   (1840).
# - U. Reif, J. Peters, "Structural analysis of subdivision surfaces - a summary", in: Topics in
#   Multivariate Approximation and Interpolation (2006): curvature around extraordinary points.

# %%
from sympy import Matrix, Rational, cos, diff, integrate, log, pi, simplify, sin, sqrt, symbols

from limitsurf import eigenbasis

# %% [markdown]
# ## 1. Derivatives and curvatures
#
# At a point let the surface be a graph over its tangent plane along its principal directions,
# $z = (k_1 x^2 + k_2 y^2) / 2 + O(3)$: positive curvatures bend towards the normal. Then
# $n_x = -k_1 e_1$ and $n_y = -k_2 e_2$ (Weingarten), so that a derivative $w$ of the surface
# becomes $(1 - d k_1)(w \cdot e_1) \, e_1 + (1 - d k_2)(w \cdot e_2) \, e_2$.

# %%
x, y, d, k1, k2 = symbols("x y d k1 k2", real=True)
z = (k1 * x**2 + k2 * y**2) / 2
p = Matrix([x, y, z])
cross = diff(p, x).cross(diff(p, y))
normal = cross / sqrt(cross.dot(cross))
at = {x: 0, y: 0}
assert simplify(diff(normal, x).subs(at)) == Matrix([-k1, 0, 0])
assert simplify(diff(normal, y).subs(at)) == Matrix([0, -k2, 0])
q = p + d * normal
assert simplify(diff(q, x).subs(at)) == Matrix([1 - d * k1, 0, 0])
assert simplify(diff(q, y).subs(at)) == Matrix([0, 1 - d * k2, 0])

# %% [markdown]
# $n$ is a normal of the offset as well, and $n_x = -k q_x$ with $k = k_1 / (1 - d k_1)$: the
# curvature of the offset about $n$, in the same direction. It is monotonic in $k_1$ on each side of
# $1 / d$, infinite there, and tends to $-1 / d$ where $k_1$ is unbounded. With the one sign the
# other curvature may be passed by: then principal directions change places.

# %%
offset_k = k1 / (1 - d * k1)
assert simplify(diff(normal, x).subs(at) + offset_k * diff(q, x).subs(at)) == Matrix([0, 0, 0])
assert simplify(diff(offset_k, k1) - 1 / (1 - d * k1) ** 2) == 0
assert offset_k.subs({k1: -Rational(1, 2), d: 3}) == -Rational(1, 5)  # spheres of radius 2 and 5
assert (1 / offset_k).simplify().subs(1 / k1, 0).expand().coeff(d) == -1

# %% [markdown]
# ## 2. Volumes
#
# The area element at distance $t$ is $(1 - t k_1)(1 - t k_2) \, dA$. The volume between is the
# integral over $t$ from 0 to $d$ (Steiner): $d A - d^2 \int H + d^3 / 3 \int K$, with the mean and
# the Gaussian curvature $H = (k_1 + k_2) / 2$ and $K = k_1 k_2$, as long as nothing folds.

# %%
t = symbols("t", real=True)
between = integrate((1 - t * k1) * (1 - t * k2), (t, 0, d))
steiner = d - d**2 * (k1 + k2) / 2 + d**3 / 3 * k1 * k2
assert (between - steiner).expand() == 0
r = symbols("r", positive=True)
shell = Rational(4, 3) * pi * ((r + d) ** 3 - r**3)  # of a sphere, whose normals are outwards
assert (shell - 4 * pi * r**2 * steiner.subs({k1: -1 / r, k2: -1 / r})).expand() == 0

# %% [markdown]
# ## 3. At poles
#
# On ring $n$ around a pole distances are of the order $\lambda^n$ and heights above the tangent
# plane of the order $\mu^n$, with the subdominant eigenvalue $\lambda$ and the next one, $\mu$. At
# distance $\rho$ heights are $\rho^a$, $a = \log \mu / \log \lambda$, slopes $\rho^{a - 1}$ and
# curvatures $c \, \rho^{a - 2}$, or $(\mu / \lambda^2)^n$. From valence 5 on they diverge, slowly.

# %%
for valence in (3, 4, 5, 6, 8, 12):
    found = eigenbasis("catmull-clark", valence=valence).float64.eigenvalues
    values = sorted(abs(found), reverse=True)
    lam, mu = values[1], values[3]
    a = float(log(mu) / log(lam))
    assert (mu / lam**2 > 1 + 1e-9) == (valence > 4) == (a < 2 - 1e-9)
    assert a > 1

# %% [markdown]
# So $|d k| = s$ on a curve at the distance $\rho = (s / (c |d|))^{1 / (a - 2)}$ from the pole,
# which `Folds.radius` gives for $s = 1 / 2$: found on rings, and beyond these by this power.
# Within, on the convex side ($d k < 0$), the offset moves as $d \, \rho^{a - 1}$, which is larger
# than $\rho$ itself: it is *rounded off* as the sphere of radius $|d|$ about the pole is, with
# curvature $-1 / d$. There it is C1. On the other side $1 - d k$ passes 0, and the offset folds
# back near every such pole, however small $d$ is: within that radius it is but C0. The fold is of
# the order of $\rho$ wide, as $d \, c \, \rho^{a - 1} = \rho$ there, and $\rho^2 / d$ high. Half
# of $d$ has $2^{-1 / (2 - a)}$ of the radius.

# %%
rho, c, s, size = symbols("rho c s size", positive=True)
exponent = symbols("exponent", positive=True)
at_half = (s / (c * size)) ** (1 / (exponent - 2))
assert simplify(log(size * c * at_half ** (exponent - 2) / s).expand(force=True)) == 0
assert simplify((at_half.subs(size, size / 2) / at_half) / 2 ** (1 / (exponent - 2))) == 1

# %% [markdown]
# ## 4. Deviation of splines
#
# A point $p + d \, n + e$ with $e = e_n n + e_t$ is at the distance $\sqrt{(d + e_n)^2 + e_t^2}$
# from $p$, which differs from $|d|$ by at most $|e_n| + e_t^2 / (2 |d|)$, as the square root of a
# sum of squares grows by at most $e_t^2 / (2 (|d| + e_n))$ for $e_n \ge 0$.
# `OffsetFaces.along_normal` is that, to second order, or $|e|$ if that is less.

# %%
angle = symbols("angle", real=True)
distance = sqrt((size + rho * cos(angle)) ** 2 + rho**2 * sin(angle) ** 2)
series = distance.series(rho, 0, 3).removeO()
expected = size + rho * cos(angle) + rho**2 * sin(angle) ** 2 / (2 * size)
assert simplify(series - expected) == 0

# %% [markdown]
# ## 5. Bounds of that
#
# On a cell where the surface $p$ and the spline $q$ are polynomials, let $w = q - p = h \, n + t$
# with $t \perp n$. With $N = p_u \times p_v$, $E = p_u^2$, $F = p_u p_v$, $G = p_v^2$,
# $a = w \, p_u$ and $b = w \, p_v$,
#
# $$ t^2 = \frac{G a^2 - 2 F a b + E b^2}{|N|^2}, \qquad
#    |t| \le \frac{|a| |p_v| + |b| |p_u|}{|N|}, \qquad h^2 = w^2 - t^2. $$
#
# $a$, $b$, $w^2 - d^2$, and $N m$ for a fixed unit vector $m$, which $|N|$ is at least, are
# polynomials: their Bernstein coefficients bound them. If $l \le w^2 - d^2 \le g$ and $|t| \le T$,
# then $d^2 + l - T^2 \le h^2 \le d^2 + g$. Where the lower end is positive $h$ has one sign in the
# cell, which a corner tells; with that of $d$ it is within both roots of $d$.

# %%
pu, pv, wv = (Matrix(symbols(f"{name}1:4", real=True)) for name in ("r", "s", "w"))
cross = pu.cross(pv)
tangential = wv.dot(wv) - wv.dot(cross) ** 2 / cross.dot(cross)
first, mixed, second = pu.dot(pu), pu.dot(pv), pv.dot(pv)
a, b = wv.dot(pu), wv.dot(pv)
formula = (second * a**2 - 2 * mixed * a * b + first * b**2) / cross.dot(cross)
assert simplify(tangential - formula) == 0

# %% [markdown]
# In what remains at a pole, with the limit $l$, normals lie within an angle $\theta$ of $n_0$.
# With $z = w - d \, n_0$ the height is $h - d = z \, n - d (1 - n \, n_0)$, so that
# $|h - d| \le |z \, n_0| + 2 \sin(\theta / 2) |z| + |d| (1 - \cos \theta)$, and
# $1 - \cos \theta = 2 \sin^2(\theta / 2)$.

# %%
theta = symbols("theta", positive=True)
assert simplify(1 - cos(theta) - 2 * sin(theta / 2) ** 2) == 0
