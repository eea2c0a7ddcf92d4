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
# # Refinement against the closed form
#
# Two ways lead to a limit surface. One refines the cage again and again. The other evaluates the
# limit in closed form. They must agree, and one can say in advance how fast. This notebook predicts
# the order of convergence from eigenvalues, and then measures it.

# %%
from fractions import Fraction

import numpy as np
from PIL import Image

import limitsurf as ls

# %% [markdown]
# ## Refining
#
# `ls.refined` applies the rules of Catmull and Clark to a cage: a new point for each face, each
# edge and each vertex. The refined cage has the same limit surface, and comes closer to it. Here is
# a body of ten quads with a pole of five faces above, and another one below, refined never, once
# and twice. (Each picture is fitted to its cage: it is the cages that shrink.)


# %%
def lantern(valence: int) -> ls.Mesh:
    """A zigzag belt of 2 N points around the z axis, and N quads above and below, to the poles."""
    k = np.arange(2 * valence)
    angle = k * np.pi / valence
    belt = np.stack([np.cos(angle), np.sin(angle), 0.3 * (-1.0) ** k], axis=1)
    around = [k, np.roll(k, -1), np.roll(k, -2)]
    above = np.stack([np.full_like(k, 2 * valence), *around], axis=1)[::2]
    below = np.stack([np.full_like(k, 2 * valence + 1), *around[::-1]], axis=1)[1::2]
    return ls.Mesh([*belt, (0, 0, 1), (0, 0, -1)], np.concatenate([above, below]))


mesh = lantern(5)
images = []
for levels in range(3):
    surface = ls.LimitSurface(ls.refined(mesh, levels))
    shown = ls.plot(surface, cage=True, curves=False, window_size=(500, 400))
    images.append(np.asarray(shown))
Image.fromarray(np.concatenate(images, axis=1))

# %% [markdown]
# ## How far is it?
#
# Each refined vertex has a *parent*, the place on the cage where it came to be: a face, `u` and
# `v`. So it can be compared with the point that the closed form has there.

# %%
surface = ls.LimitSurface(mesh)
fine = ls.refined(mesh, 3)
place = fine.parent_face, fine.parent_u, fine.parent_v
gap = np.linalg.norm(fine.points - surface.evaluate(*place), axis=1)
worst = gap.argmax()
print(
    f"{gap[worst]:.6f} at face {place[0][worst]}, (u, v) = ({place[1][worst]}, {place[2][worst]})"
)

# %% [markdown]
# `ls.validate` does this level by level. Its column `order` is the base-two logarithm of how much
# closer one more level comes.

# %%
report = ls.validate(surface, levels=3)
assert np.isclose(report["error"][2], gap.max(), rtol=1e-9)
report

# %% [markdown]
# ## Where all vertices are regular
#
# On a torus of quads each vertex has four faces. There the surface is a bicubic spline, the cage
# its control net, and a net of half the width is four times as close: the order is 2.


# %%
def torus(n: int, m: int) -> ls.Mesh:
    """A torus of n times m quads."""
    a, b = np.meshgrid(np.arange(n) * 2 * np.pi / n, np.arange(m) * 2 * np.pi / m, indexing="ij")
    ring = 2 + np.cos(b)
    points = np.stack([ring * np.cos(a), ring * np.sin(a), np.sin(b)], axis=-1).reshape(-1, 3)
    number = np.arange(n * m).reshape(n, m)
    east, north = np.roll(number, -1, axis=0), np.roll(number, -1, axis=1)
    corners = [number, east, np.roll(east, -1, axis=1), north]
    return ls.Mesh(points, np.stack(corners, axis=-1).reshape(-1, 4))


regular = ls.LimitSurface(torus(6, 4))
report = ls.validate(regular, levels=5)
assert abs(report["order"][-1] - 2) < 0.01
report

# %% [markdown]
# ## At a pole
#
# Around a vertex of N faces, one level of refinement is a matrix, the same at each level. Let the
# control points be a sum of its eigenvectors. Then each part of the sum shrinks by its own
# eigenvalue at each level, and so does the distance of that part from the limit.
#
# The eigenvectors are waves around the vertex, with $f = 0, 1, \dots, \lfloor N/2 \rfloor$ periods.
# A part of frequency $f$ has error $\lambda_f^n$ after $n$ levels: it has order
# $\log_2 (1 / \lambda_f)$. `ls.eigenbasis` knows the eigenvalues. The largest one for each
# frequency is this.


# %%
def slowest(valence: int) -> np.ndarray:
    """The largest eigenvalue below 1 of each frequency 0, ..., floor(N / 2)."""
    f = np.arange(valence // 2 + 1)
    c, s = np.cos(2 * np.pi * f / valence), np.cos(np.pi * f / valence)
    values: np.ndarray = (5 + c + s * np.sqrt(18 + 2 * c)) / 16
    values[0] = (3 * valence - 7 + np.sqrt(5 * valence**2 - 30 * valence + 49)) / (8 * valence)
    return values


for valence in (3, 5, 6, 7, 9):
    table = ls.eigenbasis("catmull-clark", valence=valence).float64.eigenvalues
    assert all(np.isclose(table, value, rtol=1e-13).any() for value in slowest(valence))
    print(valence, slowest(valence).round(5), "orders", -np.log2(slowest(valence)).round(3))

# %% [markdown]
# Now for the measurement. A fan of N quads carries one number at each vertex, in place of three
# coordinates: a wave of frequency $f$. The order is that of the largest gap among the pole and its
# neighbours, which are those of the refined vertices with `u` and `v` of $2^{-n}$ or less.


# %%
def wave(valence: int, f: int) -> ls.LimitSurface:
    """A fan of N quads around vertex 0, with a wave of f periods around it."""
    k = np.arange(2 * valence)
    heights = np.where(k % 2, np.sqrt(2), 1) * np.cos(np.pi * f * k / valence)
    faces = [(0, 2 * i + 1, 2 * i + 2, (2 * i + 2) % (2 * valence) + 1) for i in range(valence)]
    middle = 1.5 if f == 0 else 0.0
    return ls.LimitSurface(ls.Mesh(np.append(middle, heights)[:, None], faces))


def gap_at_pole(surface: ls.LimitSurface, levels: int) -> float:
    """The largest gap among the pole, which is corner 0 of each face, and its neighbours."""
    fine = ls.refined(surface.mesh, levels)
    near = np.maximum(fine.parent_u, fine.parent_v) <= 0.5**levels
    place = fine.parent_face[near], fine.parent_u[near], fine.parent_v[near]
    return float(np.abs(fine.points[near] - surface.evaluate(*place)).max())


print("  N  f  predicted   observed at levels 3 to 6")
for valence in (3, 5, 6, 7):
    for f, value in enumerate(slowest(valence)[:3]):
        gaps = [gap_at_pole(wave(valence, f), levels) for levels in range(2, 7)]
        observed = np.log2(np.divide(gaps[:-1], gaps[1:]))
        print(f"{valence:3}{f:3}{-np.log2(value):11.3f}  ", observed.round(3))
        assert abs(observed[-1] + np.log2(value)) < 0.1

# %% [markdown]
# Frequency 1 is the slowest at each valence: it is the order that one sees at a pole in the end,
# 1.29 at valence 3, 0.86 at 5, and less at higher ones. But its waves are the tangent plane itself:
# the points need not be off the surface at all. Here is a flat fan. All refined points are in the
# plane, and so is the limit; they are merely not where their parents say.

# %%
k = np.arange(10)
radius = np.where(k % 2, np.sqrt(2), 1)
star = np.stack([radius * np.cos(np.pi * k / 5), radius * np.sin(np.pi * k / 5), 0 * k], axis=1)
flat = ls.LimitSurface(wave(5, 1).mesh.with_points([(0, 0, 0), *star]))
fine = ls.refined(flat.mesh, 6)
gap = fine.points - flat.evaluate(fine.parent_face, fine.parent_u, fine.parent_v)
assert (gap[:, 2] == 0).all()
print("in the plane:", np.linalg.norm(gap, axis=1).max(), " across it:", np.abs(gap[:, 2]).max())

# %% [markdown]
# ## All of it together
#
# A shape in space has all frequencies at once. What is seen first is the largest part, and what is
# seen in the end is the slowest one. In these flat lanterns it comes to the fore at level 5 where
# the pole has five faces, and at level 4 where it has eight; at valence 3 it is still hidden behind
# the regular part.


# %%
def flattened(valence: int) -> ls.Mesh:
    """A lantern of less height."""
    mesh = lantern(valence)
    return mesh.with_points(mesh.points * [1, 1, 0.3])


shapes = {"regular (torus)": regular} | {
    f"valence {valence}": ls.LimitSurface(flattened(valence)) for valence in (3, 5, 8)
}
ls.plot_convergence(shapes, levels=5, window_size=(900, 620))

# %% [markdown]
# At the pole itself only frequency 0 is left: all other waves are zero there.

# %%
surface = shapes["valence 8"]
pole = surface.mesh.n_vertices - 2
limit = surface.evaluate(0, 0.0, 0.0)
height = [ls.refined(surface.mesh, n).points[pole, 2] - limit[2] for n in range(1, 6)]
ratio = np.divide(height[1:], height[:-1])
assert abs(ratio[-1] / slowest(8)[0] - 1) < 1e-2
ratio, slowest(8)[0]

# %% [markdown]
# ## Moved to the limit
#
# A refined vertex need not be taken as it is. A mask, the left eigenvector of eigenvalue 1, gives
# its limit. Moved there, the refined points are on the surface at once, at each level: what is left
# is rounding.

# %%
for name, surface in shapes.items():
    report = ls.validate(surface, levels=4)
    assert report["limit_error"].max() < 1e-14
    print(f"{name:16}", report["limit_error"])

# %% [markdown]
# In fractions nothing is rounded, and the two are equal.

# %%
numbers = (lantern(5).points * 8).astype(int).astype(object)
exact = ls.LimitSurface(lantern(5).with_points(numbers))
fine = ls.refined(exact.mesh, 2)
u, v = (np.vectorize(Fraction, otypes=[object])(x) for x in (fine.parent_u, fine.parent_v))
assert (exact.evaluate(fine.parent_face, u, v) == fine.limit_points).all()
print(len(fine.limit_points), "points, all equal; one of them is", fine.limit_points[20])

# %% [markdown]
# ## What it means
#
# Each level has four times as many faces. At order 2, a hundred times closer means a hundred times
# as many faces; at order 0.86, that of a pole of five faces, it means 43,000 times as many.
# Refining the neighbourhood of poles alone is cheaper, but each digit still takes
# $\log_2 (10) / 0.86 = 3.9$ levels. The closed form has all digits at once, next to a pole as well
# as far away from it.

# %%
for order in (2, -np.log2(slowest(5)[1])):
    print(f"order {order:.2f}: {4 ** (np.log2(100) / order):,.0f} times as many faces")
