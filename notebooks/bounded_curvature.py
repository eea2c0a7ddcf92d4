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
# # Bounded curvature
#
# By Loop's scheme the curvature of a surface grows without bound on the way to a vertex of three
# triangles, or of seven and more. Loop himself tuned it: "Bounded curvature triangle mesh
# subdivision with the convex hull property" (The Visual Computer 18, 2002) has other masks for the
# edges at such a vertex, so that no mode shrinks more slowly than the square of what the tangent
# plane shrinks by. His masks take in more of the ring; here the condition is met by masks of the
# same four points as Loop's of 1987, which is enough to see what it does.

# %%
from functools import cache
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import sympy as sp
from PIL import Image

import limitsurf as ls

# %% [markdown]
# ## Masks
#
# The point of an edge at the vertex takes `own` of the vertex, `far` of the other end and `across`
# of the two points across the edge. A wave of frequency f around N triangles is then scaled by
# `far + 2 across cos(2 pi f / N)`: say the first by $\lambda$ and the second by $\lambda^2$, and
# both weights are known. The waves between these and the last, of frequency N/2, are scaled by
# something in between. So it is enough that this is not below $-\lambda^2$: with $\lambda = 1/2$ up
# to N = 9, then with a larger one. The mask of the vertex gives $\lambda^2$ to frequency 0.


# %%
@cache
def masks(valence: int) -> tuple[Any, tuple[Any, Any, Any]]:
    """What the vertex keeps; weights of own, far and across."""
    if valence == 3:  # frequency 2 is 1, the other way round
        own, far, across, size = map(sp.Rational, ("5/16", "9/16", "1/16", "1/2"))
    else:
        first, second = (sp.cos(2 * sp.pi * f / valence) for f in (1, 2))
        ratio = (1 + first) / (first - second)
        size = sp.Rational(1, 2) if valence < 10 else (ratio - 1) / (ratio + 1)
        across = size * (1 - size) / (first - second) / 2
        far = size - 2 * across * first
        own = 1 - far - 2 * across
    return size**2 + own, (own, far, across)


def vertex(valence: int) -> tuple[Any, Any]:
    """Weights of a vertex, and of each neighbour."""
    kept, _ = masks(valence)
    return kept, (1 - kept) / valence


def edge(a: int, b: int) -> tuple[Any, Any, Any]:
    """Weights in the point of an edge, by the valences of its ends."""
    if (a == 6) == (b == 6):  # regular, or gone after one step
        a = b = 6
    _, (own, far, across) = masks(a if b == 6 else b)
    return (own, far, across) if b == 6 else (far, own, across)


tuned = ls.Scheme("tuned", lattice="triangles", vertex=vertex, edge=edge)
for n in (3, 4, 5, 6, 7, 8, 9, 10):
    kept, spoke = masks(n)
    assert all(weight >= 0 for weight in (kept, *spoke))  # a convex hull
    print(f"N = {n:2}: vertex {float(kept):.4f}, edge", *(f"{float(x):.4f}" for x in spoke))

# %% [markdown]
# ## Analysis
#
# At N = 6 that is the spline. Whether the surface is C1, and curvature bounded, is decided from the
# exact eigenvalues and from the Bernstein coefficients of the characteristic map.

# %%
valences = [3, 4, 5, 6, 7, 8, 9, 10]
for n in valences:
    mine, loops = (ls.spectral_analysis(name, valence=n) for name in (tuned, "loop"))
    print(f"N = {n:2}: C1 {mine.c1}; curvature {mine.curvature}; by Loop {loops.curvature}")
    assert mine.c1
    assert str(mine.curvature) == "bounded"

# %%
ls.plot_spectrum([tuned, "loop"], valences=valences, window_size=(1200, 600))

# %% [markdown]
# ## On the way to a vertex
#
# A hill over eight triangles, with random heights. The curvature of its surface in one direction,
# on the way to the vertex: by Loop's masks it grows as the spectrum says, by the others it stays.

# %%
points, number = [(0.0, 0.0)], {}
corners = [(q, i, j) for q in range(8) for i in range(1, 5) for j in range(5 - i)]
for q, i, j in corners:
    number[q, i, j] = len(points)
    first, second = np.pi * q / 4, np.pi * (q + 1) / 4
    points.append((
        i * np.cos(first) + j * np.cos(second), i * np.sin(first) + j * np.sin(second)
    ))  # fmt: skip


def at(q: int, i: int, j: int) -> int:
    """The vertex so many steps along both edges of a sector."""
    if i == 0:
        return 0 if j == 0 else number[(q + 1) % 8, j, 0]
    return number[q, i, j]


cells = [(q, i, j) for q in range(8) for i in range(4) for j in range(4 - i)]
faces = [[at(q, i, j), at(q, i + 1, j), at(q, i, j + 1)] for q, i, j in cells]
faces += [[at(q, i + 1, j + 1), at(q, i, j + 1), at(q, i + 1, j)] for q, i, j in cells if i + j < 3]
x, y = np.array(points).T
height = np.random.default_rng(3).normal(scale=0.12, size=len(x)) - 0.06 * (x**2 + y**2)
cage = ls.Mesh(np.stack([x, y, height], axis=1), faces)
surfaces = {name: ls.LimitSurface(cage, scheme=name) for name in (tuned, "loop")}
distance = 2.0 ** -np.arange(1, 60)
figure, axes = plt.subplots(figsize=(7, 4))
for name, surface in surfaces.items():
    found = surface.curvature(0, 0.6 * distance, 0.3 * distance)
    axes.loglog(distance, np.abs(found.k2), "o-", ms=3, label=str(getattr(name, "name", name)))
axes.set_xlabel("distance in parameters")
axes.set_ylabel("|k2|")
_ = axes.legend()

# %%
largest = [np.abs(s.curvature(0, 0.6 * distance, 0.3 * distance).k2) for s in surfaces.values()]
assert largest[0][-1] < 10 * largest[0][0]
unbounded = ls.spectral_analysis("loop", valence=8).curvature
assert unbounded is not None  # there is a tangent plane
rate = unbounded.rate
assert np.isclose(largest[1][-1] / largest[1][-2], rate, rtol=1e-3)
print(
    f"a halving multiplies it by {largest[1][-1] / largest[1][-2]:.4f}; mu / lambda^2 = {rate:.4f}"
)

# %% [markdown]
# ## Stripes
#
# Zebra stripes are reflections: where curvature blows up they turn sharply. The tuned surface is
# on the left.

# %%
shown: dict[str, Any] = {"cage": False, "curves": False, "poles": False, "window_size": (500, 450)}
images = [np.asarray(ls.plot(s, scalars="zebra", **shown)) for s in surfaces.values()]
Image.fromarray(np.concatenate(images, axis=1))

# %% [markdown]
# And in numbers: by how much normals turn over one ring of parameters, from distance 2^-n to the
# next. Both surfaces are C1: normals have a limit. On the tuned surface they come to it as those
# of a surface with curvature do.

# %%
ring = np.arange(1, 30)
for name, surface in surfaces.items():
    normal = surface.normal(0, 0.6 * 2.0**-ring, 0.3 * 2.0**-ring)
    turn = np.linalg.norm(np.diff(normal, axis=0), axis=1)
    print(
        f"{getattr(name, 'name', name):6} each turn is {turn[-1] / turn[-2]:.4f} of the one before"
    )

# %% [markdown]
# ## The price
#
# Curvature is bounded, but a vertex that sticks out is drawn back more or less than by Loop:

# %%
for n in valences:
    both = [ls.spectral_analysis(name, valence=n).shrinkage for name in (tuned, "loop")]
    print(f"N = {n:2}: tuned {both[0]:.3f}, Loop {both[1]:.3f}")

# %% [markdown]
# And surfaces with masks of their own at the edges of a vertex are answered by NumPy, without
# compiled kernels and without Bezier patches. The page on schemes of your own says what is checked,
# and what there is.
