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
"""Caps of bicubic pieces around a pole that share tangent planes, and how free they are.

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Caps that share tangent planes
#
# [Spline faces](spline_faces.py) are the limit but for one cell at each special corner. There all
# faces around a pole have the same edges, but not the same normals along them. Here cells of four
# bicubic pieces, $C^1$ with each other and with the exact ring around, that have.
#
# - J. Peters, J. Fan, "On the complexity of smooth spline surfaces from quad meshes", Computer
#   Aided Geometric Design 27 (2010): bicubic splines with two inner knots an edge, one double, do.
#   Here knots where cells end may be double as well, and one inner knot is enough.
#
# ## 1. One double knot an edge
#
# Let $N$ faces with the cell $[0, 1]^2$ each have the pole at $(0, 0)$. Spoke $m$ is the side
# $f_m(t, 0) = f_{m-1}(0, t) = b(t)$. Both faces share tangent planes along it if
#
# $$\partial_v f_m(t, 0) + \partial_u f_{m-1}(0, t) = c(t)\, b'(t). \qquad (1)$$
#
# At the pole, where tangents $t_m$ along spokes are an affine regular $N$-gon, $c(0) = 2 \cos(2
# \pi/N)$. At $t = 1$ the ring around is $C^1$ across the spoke, and its cross derivatives have the
# sum 0: so $c(1) = 0$, and, since twists have the sum 0 too, $c'(1) = 0$.
#
# With a double knot at $1/2$ let
#
# $$c(t) = 2 \cos(2\pi/N)\, (1 - 2 t)^2 \text{ up to } 1/2, \quad 0 \text{ beyond.}$$
#
# It is $C^1$. Where it is not 0, $b$ is to be quadratic, so that $c\, b'$ is cubic as both
# derivatives in (1) are; beyond, $b$ is any cubic. At 1/2 the right side of (1) and its derivative
# are 0 from both sides, whatever $b$ does there: $b$ is $C^1$ only.

# %%
import numpy as np
from sympy import Matrix, Rational, cos, expand, pi, simplify, symbols, zeros

x, k = symbols("x k")
half = Rational(1, 2)
fade = 2 * k * (1 - 2 * x) ** 2  # k is the cosine
assert fade.subs(x, half) == 0
assert fade.diff(x).subs(x, half) == 0

# %% [markdown]
# ## 2. What is free
#
# A piece has as many coefficients as there are values, derivatives and twists at its corners. With
# tangent $t$ and second derivative $s$ of a spoke at the pole,
#
# $$b(x) = t x + s x^2 / 2, \quad b(1/2) = t/2 + s/8, \quad b'(1/2) = t + s/2.$$
#
# The derivatives across are $c\, b'/2 \pm e$ with any $e$: at the pole $e = (t_{m+1} - t_{m-1})/2$,
# and $e' = (\tau_m - \tau_{m-1})/2$ with twists $\tau$; at 1/2 and 1 those of the limit. What
# remains of (1) is its derivative at the pole, $2 \cos(2\pi/N) = 2 k$:
#
# $$\tau_m + \tau_{m-1} = 2 k\, (s_m - 4 t_m). \qquad (2)$$
#
# For odd $N$ twists follow from $s$; for even $N$ the alternating sum of the right side has to be
# 0, and that of twists is free. Both are met at once, and twists do not grow for large odd $N$, if
# $s$ and $\tau$ are the nearest that satisfy (2) to what the limit suggests: with the discrete
# Fourier transform a pair of numbers on a line, for each frequency.
#
# The coefficients of the derivatives across, on $[0, 1/2]$, are those below.

# %%
t, s, e0, turn, step, slope = symbols("t s e0 turn step slope")  # one component
y = symbols("y")  # 2 x


def curve(coefficients):
    """A cubic on [0, 1/2]."""
    one, two, three, four = coefficients
    return (one * (1 - y) ** 3 + 3 * two * y * (1 - y) ** 2 + 3 * three * y**2 * (1 - y)
            + four * y**3).subs(y, 2 * x)  # fmt: skip


spoke = t * x + s * x**2 / 2
end, speed = t / 2 + s / 8, t + s / 2
assert expand(curve([0, t / 6, end - speed / 6, end]) - spoke) == 0
even = curve([k * t, k * speed / 3, 0, 0])
assert expand(even - fade * spoke.diff(x) / 2) == 0
odd = curve([e0, e0 + turn / 6, step - slope / 6, step])
assert [expand(odd.diff(x, n).subs(x, at)) for at in (0, half) for n in (0, 1)] == [
    e0, turn, step, slope,
]  # fmt: skip
# (1) is an identity, and its derivative at the pole is (2)
assert expand((even + odd) + (even - odd) - fade * spoke.diff(x)) == 0
assert expand(2 * even.diff(x).subs(x, 0) - 2 * k * (s - 4 * t)) == 0

# %% [markdown]
# Tangents: $t_{m+1} + t_{m-1} = 2 k t_m$ for $t_m = a \cos(2\pi m/N) + b \sin(2\pi m/N)$, and so
# their alternating sum is 0 for even $N > 2$. They span the tangent plane of the limit. At $N = 2$
# they are on a line, and there is no cap.

# %%
for n in (3, 5, 6, 8):
    for m in range(n):
        angle = 2 * pi / n
        for wave in (lambda z: cos(z), lambda z: cos(z - pi / 2)):
            left = wave(angle * (m + 1)) + wave(angle * (m - 1))
            assert simplify(left - 2 * cos(angle) * wave(angle * m)) == 0

# %% [markdown]
# ## 3. A whole cap, in rational numbers
#
# $N = 6$, where $k = 1/2$: from any data that satisfy (2), two neighbours and their pieces beyond
# 1/2. The tangent planes are the same along the whole spoke, and pieces are $C^1$.

# %%
rng = np.random.default_rng(0)


def any_vector():
    """Three small rational numbers."""
    return Matrix([Rational(int(z), 7) for z in rng.integers(-20, 20, 3)])


N, cosine = 6, half
first, second = any_vector(), any_vector()
tangents = [first, second]
while len(tangents) < N:
    tangents.append(2 * cosine * tangents[-1] - tangents[-2])
assert 2 * cosine * tangents[-1] - tangents[-2] == first
bends = [any_vector() for _ in range(N)]
off = sum(((-1) ** m * bends[m] for m in range(N)), zeros(3, 1))
bends[0] -= off
twists = [any_vector()]
for m in range(1, N):
    twists.append(2 * cosine * (bends[m] - 4 * tangents[m]) - twists[-1])
assert twists[-1] + twists[0] == 2 * cosine * (bends[0] - 4 * tangents[0])
ends, rates = any_vector(), any_vector()
for m in range(N):
    own, bend = tangents[m], bends[m]
    after, before = tangents[(m + 1) % N], tangents[m - 1]
    line = own * x + bend * x**2 / 2
    share = (fade.subs(k, cosine) * line.diff(x)) / 2
    values = {
        e0: (after - before) / 2,
        turn: (twists[m] - twists[m - 1]) / 2,
        step: ends,
        slope: rates,
    }
    rest = Matrix([odd.subs({name: value[d] for name, value in values.items()}) for d in range(3)])
    one, other = share + rest, share - rest
    assert (one.subs(x, 0) - after).expand() == zeros(3, 1)
    assert (other.subs(x, 0) - before).expand() == zeros(3, 1)
    assert (one.diff(x).subs(x, 0) - twists[m]).expand() == zeros(3, 1)
    assert (other.diff(x).subs(x, 0) - twists[m - 1]).expand() == zeros(3, 1)
    assert expand(Matrix.hstack(line.diff(x), one, other).det()) == 0
    # with what goes on beyond, where both have the sum 0
    assert [(one.diff(x, q) + other.diff(x, q)).subs(x, half).expand() for q in (0, 1)] == [
        zeros(3, 1), zeros(3, 1),
    ]  # fmt: skip

# %% [markdown]
# ## 4. What rounding does
#
# With $R$ for what remains of (1), normals on both sides are $b' \times d$ and $b' \times d - b'
# \times R$: the sine of the angle between them is at most $|b'||R| / |b' \times d|$. Control points
# that are off by $\delta$ move differences of two, six times of which are derivatives, by $12
# \delta$, and so $R$ by no more than $4 \cdot 12 \delta$, as $|c| \le 2$. The coefficients of
# $(b' \times d) \cdot n$ are a lower bound of its length; where one is not positive, the cap may
# fold, and is not taken. Sizes in cells are like $\lambda^K$, and so the angle is like $\delta /
# \lambda^K$: rounding, not $(\mu/\lambda)^K$.

# %%
from limitsurf import LimitSurface, Mesh, bspline_faces

points = [[a, b, c] for a in (0, 1) for b in (0, 1) for c in (0, 1)]
quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
cube = LimitSurface(Mesh(points, quads))
at = np.linspace(0, 1, 1001)
for depth in (2, 6, 10):
    faces = bspline_faces(cube, depth=depth, poles="g1")
    bound = faces.cap_errors[1].edge.max()
    # the edge from vertex 0 to vertex 1 is the first of face 0, and the last of face 2
    left, right = faces.normal(0, at, 0 * at), faces.normal(2, 0 * at, at)
    assert np.abs(left - right).max() <= bound + 1e-13 < 1e-7
