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

# %% [markdown]
# # A vertex mask from a wish
#
# What makes a scheme good at a vertex is a few numbers, eigenvalues of one step around it. This
# notebook goes the other way: it begins with a wish for one of them, derives the mask that grants
# it, and takes that through analysis and evaluation. The wish: *of frequency 0, which makes cups
# and bowls, the mode is to shrink by the square of what the tangent plane shrinks by*. Then the
# surface is a paraboloid to it, and its curvature neither fades nor blows up.

# %%
from typing import Any

import numpy as np
import sympy as sp

import limitsurf as ls

# %% [markdown]
# ## What is there
#
# In the scheme of Catmull and Clark it is not so. Here is by what curvature of frequency 0 is
# multiplied as one comes half as near: below 1 cups fade, above 1 they get sharper.


# %%
def of_frequency(scheme: Any, valence: int, frequency: int) -> Any:
    """What outweighs all other modes of a frequency in the curvature."""
    curvature = ls.spectral_analysis(scheme, valence=valence).curvature
    assert curvature is not None  # there is a tangent plane
    return next(mode for mode in curvature.by_frequency if mode.frequency == frequency)


valences = [3, 5, 6, 7, 8, 9]
for n in valences:
    print(f"N = {n}: times {of_frequency('catmull-clark', n, 0).rate:.4f}")

# %% [markdown]
# ## The block of frequency 0
#
# Let all edge neighbours of the vertex be in one place, and all corners beyond them in another one:
# a step maps three points to three points. A face point is a quarter of each corner, an edge point
# a quarter of its ends and of its two face points, the vertex point $\alpha$ of itself, $\beta$ of
# its neighbours and $\gamma = 1 - \alpha - \beta$ of the face points, all N of them together.

# %%
alpha, beta, mu = sp.symbols("alpha beta mu")
v, e, f = (sp.Matrix([row]) for row in sp.eye(3).tolist())
face = (v + 2 * e + f) / 4
edge = (v + e + 2 * face) / 4
vertex = alpha * v + beta * e + (1 - alpha - beta) * face
block = sp.Matrix.vstack(vertex, edge, face)
block

# %% [markdown]
# One eigenvalue is 1, as all rows sum to one. The others are the zeros of a quadratic polynomial:

# %%
polynomial = sp.factor(block.charpoly(mu).as_expr())
quadratic = sp.expand(sp.cancel(polynomial / (mu - 1)))
quadratic

# %% [markdown]
# It is linear in the weights: for each $\mu$ there is a mask. Two weights are one too many, so
# neighbours and face points share evenly what the vertex does not keep, as Catmull and Clark have
# it.

# %%
(kept,) = sp.solve(quadratic.subs(beta, (1 - alpha) / 2), alpha)
kept = sp.factor(kept)
kept

# %% [markdown]
# ## The wish
#
# The tangent plane is of frequency 1, and does not feel the mask of the vertex. Its eigenvalue is
# known in closed form; at N = 4 it is 1/2, and the mask must be that of the spline, 1/2 for the
# vertex.

# %%
N = sp.symbols("N", positive=True)
c, s = sp.cos(2 * sp.pi / N), sp.cos(sp.pi / N)
plane = (5 + c + s * sp.sqrt(18 + 2 * c)) / 16
assert plane.subs(N, 4).simplify() == sp.Rational(1, 2)
assert kept.subs(mu, sp.Rational(1, 4)) == sp.Rational(1, 2)


def mask(valence: int) -> tuple[Any, Any, Any]:
    """Weights of a vertex, of each neighbour and of each face point."""
    own = sp.Rational(1, 2) if valence == 4 else kept.subs(mu, plane.subs(N, valence) ** 2)
    rest = (1 - own) / (2 * valence)
    return own, rest, rest


for n in valences:
    print(f"N = {n}: the vertex keeps {float(mask(n)[0]):.4f}, not {(n - 2) / n:.4f}")

# %% [markdown]
# ## The scheme
#
# The mask is all that is new. The library derives the rest, and says whether the wish is granted;
# it compares to 60 digits.

# %%
scheme = ls.Scheme("even cups", vertex=mask)
for n in valences:
    mode, found = of_frequency(scheme, n, 0), ls.spectral_analysis(scheme, valence=n)
    assert mode.above == 0
    assert found.c1
    saddles = found.facts["saddles survive"]
    print(f"N = {n}: cups times {mode.rate:.12f}, saddles survive: {saddles}")

# %%
ls.plot_spectrum([scheme, "catmull-clark"], valences=valences, window_size=(1200, 600))

# %% [markdown]
# Saddles are of frequency 2, which does not feel the mask either: from N = 5 on they still grow.
# What helps there are masks of edges: [bounded curvature](bounded_curvature.py).
#
# ## The surface
#
# Points on a paraboloid, around a vertex of five quads. With the new mask the bowl is left as it
# is; by Catmull and Clark its curvature changes all the way to the vertex.

# %%
k = np.arange(5)
places, number = [(0.0, 0.0)], {}
for sector in k:
    first, second = (2 * np.pi * (sector + t) / 5 for t in (0, 1))
    for i, j in ((a, b) for a in range(1, 5) for b in range(4)):
        number[int(sector), i, j] = len(places)
        places.append((
            i * np.cos(first) + j * np.cos(second), i * np.sin(first) + j * np.sin(second)
        ))  # fmt: skip


def at(sector: int, i: int, j: int) -> int:
    """The vertex so many steps along both edges of a sector."""
    if i == 0:
        return 0 if j == 0 else number[(sector + 1) % 5, j, 0]
    return number[sector, i, j]


faces = [
    [at(int(q), i + a, j + b) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
    for i in range(3)
    for j in range(3)
    for q in k
]
x, y = np.array(places).T
cage = ls.Mesh(np.stack([x, y, -0.1 * (x**2 + y**2)], axis=1), faces)
distance = 2.0 ** -np.arange(0, 40, 5)
for name in (scheme, "catmull-clark"):
    surface = ls.LimitSurface(cage, scheme=name)
    curvature = surface.curvature(0, distance / 2, distance / 4)
    print("mean curvature on the way:", *(f"{value:8.4f}" for value in np.abs(curvature.mean)))
