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
"""Fits: distances of points from a surface as functions of its cage, to second order.

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Fits
#
# A surface $s(u; P) = w(u) P$ is linear in its control points $P$. A point $x$ has its foot at
# $u^*(P)$, where $D(u, P) = \tfrac12 \lvert x - s(u; P) \rvert^2$ is least, and
# $F(P) = D(u^*(P), P)$ is half of its squared distance. This document derives
#
# 1. the gradient of $F$, in which the foot stays where it is;
# 2. its second derivatives: tangent planes, what curvature leaves of directions along the surface,
#    and what a step of Gauss and Newton leaves out;
# 3. the same of feet that a boundary or a crease holds;
# 4. why damped steps go down, and end quadratically where all distances vanish;
# 5. which second derivatives to leave out near the end, and a second step;
# 6. what robust losses change.
#
# - W. Wang, H. Pottmann, Y. Liu, "Fitting B-spline curves to point clouds by curvature-based
#   squared distance minimization", ACM Transactions on Graphics 25, 2006: sections 3 and 4.
# - H. Pottmann, M. Hofer, "Geometry of the squared distance function to curves and surfaces",
#   Visualization and Mathematics III, 2003: equation 9.
# - J. Nocedal, S. Wright, "Numerical Optimization", 2nd edition, 2006: chapter 10.

# %%
from itertools import pairwise

import numpy as np
from sympy import Matrix, Rational, diff, eye, simplify, solve, symbols, zeros

# %% [markdown]
# ## 1. The gradient
#
# At the foot $D_u = 0$, so that $dF/dP = D_P + D_u\, du^*/dP = D_P = -w^T r$ with $r = x - s$: what
# the foot does in the meantime does not count. A curve in the plane shows it, with a foot that is
# known in closed form: $s = (u, P)$, a line at the height $P$ with the slope $Q$.

# %%
u, P, Q, a, b = symbols("u P Q a b", real=True)
D = ((a - u) ** 2 + (b - P - Q * u) ** 2) / 2
foot = solve(diff(D, u), u)[0]
F = simplify(D.subs(u, foot))
for parameter in (P, Q):
    assert simplify(diff(F, parameter) - diff(D, parameter).subs(u, foot)) == 0

# %% [markdown]
# ## 2. Second derivatives
#
# $D_u(u^*(P), P) = 0$ says that $du^*/dP = -D_{uu}^{-1} D_{uP}$, so
#
# $$F_{PP} = D_{PP} - D_{Pu} D_{uu}^{-1} D_{uP},$$
#
# $$D_{PP} = w^T w \otimes 1, \quad D_{uu} = J^T J - r \cdot s_{uu} = A, \quad
# D_{Pu} = w^T \otimes J - w_u^T \otimes r.$$
#
# The second term of $D_{Pu}$ says how the surface turns at the foot. Without it the second
# derivative is $w^T w \otimes M$ with $M = 1 - J A^{-1} J^T$. In unit steps along the principal
# directions $d_i$, of curvatures $k_i$, and with $r = d\,n$, $A$ is diagonal with $1 - d\,k_i$:

# %%
d, k1, k2 = symbols("d k1 k2", real=True)
J = Matrix([[1, 0], [0, 1], [0, 0]])
A = Matrix([[1 - d * k1, 0], [0, 1 - d * k2]])
M = simplify(eye(3) - J * A.inv() * J.T)
for i, k in enumerate((k1, k2)):
    assert simplify(M[i, i] - (-d * k) / (1 - d * k)) == 0
assert M[2, 2] == 1
assert M[0, 1] == M[0, 2] == M[1, 2] == 0

# %% [markdown]
# So $M = n n^T + \sum c_i\, d_i d_i^T$ with $c_i = -d k_i / (1 - d k_i)$, which is Pottmann and
# Hofer's $d / (d - \rho_i)$ with radii $\rho_i = 1 / k_i$. A foot is a minimum, so $1 - d k_i > 0$.
# Where the surface is curved away from the point, $d k_i < 0$, $c_i = |d| / (|d| + |\rho_i|)$ is
# between 0 (the tangent plane alone) and 1 (the distance from the foot itself). Where it is curved
# towards the point, $c_i < 0$: taken as 0, so that $M$ stays positive semidefinite.

# %%
rho = symbols("rho", nonzero=True)
assert simplify((-d / rho) / (1 - d / rho) - d / (d - rho)) == 0
size, radius = symbols("size radius", positive=True)
assert simplify((size / radius) / (1 + size / radius) - size / (size + radius)) == 0

# %% [markdown]
# What is left out is of the order of $r$. The circle $s = R\,(\cos u, \sin u)$ about a centre $p$
# has $F = (|x - p| - R)^2 / 2$: second derivatives by $p$ are those of $M$, with nothing left out,
# as the circle turns nowhere when it is moved ($w_u = 0$).

# %%
x, p, R = symbols("x p R", positive=True)
q = symbols("q", real=True)
distance = ((x - p) ** 2 + q**2) ** Rational(1, 2)
exact = (distance - R) ** 2 / 2
along = diff(exact, p, 2).subs(q, 0)
across = diff(exact, q, 2).subs(q, 0)
gap = x - p - R  # outside, where the circle is curved away: k = -1 / R for the outer normal
values = {x: 5, p: 1, R: 3}
assert along.subs(values) == 1
assert across.subs(values) == ((gap / R) / (1 + gap / R)).subs(values) == Rational(1, 4)

# %% [markdown]
# ## 3. Boundaries, creases and corners
#
# A foot on a sharp edge moves along it alone: $J$ is its unit tangent $t$, and
# $M = 1 - t t^T / (1 - r \cdot \kappa)$ with the vector of curvature $\kappa$, of which
# $1 - t t^T$ is kept. A foot at a corner does not move: $M = 1$. A foot is held if something of
# $r$ is along the surface: $r = d\,n$ else.

# %%
t = Matrix([Rational(3, 5), 0, Rational(4, 5)])
curve = symbols("c", real=True)
held = eye(3) - t * t.T
assert held * held == held
assert held * t == zeros(3, 1)
assert held.rank() == 2

# %% [markdown]
# ## 4. Steps
#
# A step $\delta$ solves $(H + \mu\,\mathrm{diag}\,H)\,\delta = -\nabla F$ with
# $H = \sum w^T w \otimes M$, which is positive definite for $\mu > 0$: $\delta$ goes down, and for
# $\mu$ large enough $F$ falls. It is promised to fall by
# $-2\,\delta \cdot \nabla F - \delta^T H \delta$ (of twice $F$); what of that came is how $\mu$ is
# chosen for the next step. If all distances vanish at the end, $M = n n^T$ there, and what $H$
# lacks vanishes too, so that steps converge quadratically as $\mu$ goes to 0. An example: a
# parabola $y = P_0 + P_1 u + P_2 u^2$, and points of another.


# %%
def feet(P, points):
    """Parameters of the nearest places, by Newton's method."""
    at = points[:, 0].copy()
    for _ in range(60):
        y, slope, bend = P[0] + P[1] * at + P[2] * at**2, P[1] + 2 * P[2] * at, 2 * P[2]
        g = (at - points[:, 0]) + (y - points[:, 1]) * slope
        at -= g / (1 + slope**2 + np.maximum((y - points[:, 1]) * bend, 0))
    return at


truth, guess = np.array([0.3, -0.2, 0.5]), np.array([0.5, 0.0, 0.3])
grid = np.linspace(-1, 1, 15)
points = np.stack([grid, truth[0] + truth[1] * grid + truth[2] * grid**2], axis=1)
errors = [np.abs(guess - truth).max()]
for _ in range(7):
    at = feet(guess, points)
    w = np.stack([at**0, at, at**2], axis=1)
    slope = guess[1] + 2 * guess[2] * at
    normal = np.stack([-slope, np.ones(len(at))], axis=1) / np.sqrt(1 + slope**2)[:, None]
    r = points - np.stack([at, w @ guess], axis=1)
    rows = w * normal[:, 1:]  # (P moves y alone)
    guess = guess + np.linalg.solve(rows.T @ rows, rows.T @ (r * normal).sum(axis=1))
    errors.append(np.abs(guess - truth).max())
for before, after in pairwise(errors[1:]):
    assert after < 1.5 * before**2 + 1e-14
assert errors[-1] < 1e-14

# %% [markdown]
# Where the cage can slide within its surface the limit is a set of cages, and $H$ is singular on
# it. What is needed then is that the distance from that set is bounded by the error, and that what
# is added falls like the square of the error, or at least like the error (Yamashita and Fukushima,
# "On the rate of convergence of the Levenberg-Marquardt method", Computing Supplement 15, 2001,
# theorem 2.1). A constant $\mu$ leaves a factor $\mu / (\mu + \lambda)$ a step in a direction of
# the eigenvalue $\lambda$: hence no floor for $\mu$ above rounding, and an energy that is added
# where points do not tell everything is added in proportion to the mean square of the distances.
# The parabola again, whose first coefficient is a sum of two unknowns, one of them weak:

# %%
spread = np.array([[1.0, 1e-4, 0, 0, 0], [0, 0, 1, 0, 0], [0, 0, 0, 1, 1e-3]])
energy = np.diag([1.0, 2, 1, 1, 3])


def course(added, steps):
    """Distances, as root of the mean square, of steps with so much of an energy added."""
    x, found = np.array([0.5, 0.1, 0.0, 0.3, 0.2]), []
    for _ in range(steps):
        P = spread @ x
        at = feet(P, points)
        w = np.stack([at**0, at, at**2], axis=1)
        normal = np.stack([-(P[1] + 2 * P[2] * at), np.ones(len(at))], axis=1)
        normal /= np.sqrt((normal**2).sum(axis=1))[:, None]
        gap = ((points - np.stack([at, w @ P], axis=1)) * normal).sum(axis=1)
        found.append(np.sqrt((gap**2).mean()))
        rows, share = w * normal[:, 1:] @ spread, added(found[-1])
        H = rows.T @ rows + len(points) * share * energy
        x = x + np.linalg.solve(H, rows.T @ gap - len(points) * share * energy @ x)
    return found


vanishing, kept = course(lambda rms: max(1e-2 * rms**2, 1e-15), 8), course(lambda rms: 1e-4, 8)
assert vanishing[-1] < 1e-12 < 1e-6 < kept[-1]
for before, after in pairwise(vanishing[2:]):
    assert after < 5 * before**2 + 1e-13

# %% [markdown]
# ## 5. Two second derivatives, and a second step
#
# What $H$ lacks is of the order of $r$, and so are the $c_i$ of section 2. Far away they help. But
# once $r$ is small they are but one of two terms of that order, and always positive: in a direction
# in which the cage slides almost within its surface, of an eigenvalue $\lambda < |r|\,|k|$ of the
# rest, they are a damping that falls no faster than the error, and steps converge linearly. So
# below $10^{-4}$ of the size, $M = n n^T$.
#
# Such directions are weak, and the valley along them is bent: a step $\delta$ there leaves
# $\tfrac12 d''$ in the strong ones, with $d''$ the second derivative of the distances along
# $\delta$. That is what the distances after the step have beside $d + d'$, and a second solution of
# the same equations takes it away (Transtrum and Sethna, "Improvements to the Levenberg-Marquardt
# algorithm for nonlinear least-squares minimization", 2012, section 5: geodesic acceleration). Only
# if both are together better than the first alone, and the second is not the longer one, is it
# taken. An example with a valley of width 1 and slope $10^{-3}$:


# %%
def valley(second):
    """Steps until the residual is below rounding, with or without second ones."""
    x, damping = np.array([1.0, 1.0]), 1e-3

    def residual(x):
        return np.array([x[0] - x[1] ** 2, 1e-3 * x[1]])

    for count in range(200):
        r, derivative = residual(x), np.array([[1, -2 * x[1]], [0, 1e-3]])
        if np.abs(r).max() < 1e-14:
            return count
        H = derivative.T @ derivative
        while True:
            damped = H + damping * np.diag(np.diag(H))
            step = -np.linalg.solve(damped, derivative.T @ r)
            trials = [x + step]
            if second:
                bend = residual(x + step) - r - derivative @ step
                more = -np.linalg.solve(damped, derivative.T @ bend)
                if np.abs(more).max() < 0.75 * np.abs(step).max():
                    trials.append(x + step + more)
            best = min(trials, key=lambda y: (residual(y) ** 2).sum())
            if (residual(best) ** 2).sum() < (r**2).sum():
                x, damping = best, max(damping / 10, 1e-15)
                break
            damping *= 4
    return 200


assert valley(second=True) < 0.7 * valley(second=False)

# %% [markdown]
# ## 6. Losses
#
# With $\varrho(z)$ of $z = (|r| / \sigma)^2$, as in SciPy, $\sigma^2 \varrho / 2$ has the gradient
# $-\varrho'(z)\, w^T r$: each point counts $\varrho'$ times. The second derivative of $\varrho$
# is negative or 0 in all losses that are offered, and left out, which keeps $H$ definite.

# %%
z = symbols("z", positive=True)
for loss, slope in {
    2 * ((1 + z) ** Rational(1, 2) - 1): 1 / (1 + z) ** Rational(1, 2),
    2 * z ** Rational(1, 2) - 1: 1 / z ** Rational(1, 2),
}.items():
    assert simplify(diff(loss, z) - slope) == 0
    assert diff(loss, z, 2).subs(z, 3) < 0
