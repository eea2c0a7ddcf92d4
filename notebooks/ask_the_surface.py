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
# # Ask the surface
#
# Evaluation answers what is at a (face, u, v). This notebook asks the other way round: how far away
# is the surface, and where on it are places that nobody names? All answers are on the limit surface
# itself, none on triangles near it.

# %%
import matplotlib.pyplot as plt
import numpy as np

import limitsurf as ls

points = [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
sharp = {(0, 4): np.inf, (4, 6): np.inf, (6, 2): np.inf, (2, 0): np.inf}
surface = ls.LimitSurface(ls.Mesh(points, quads, creases=sharp))

# %% [markdown]
# ## A signed distance field
#
# The cage is a cube with a sharp edge around its bottom. `closest_point` gives the nearest place of
# the surface for each point of a plane through it; with `signed=True` distances are negative
# inside. The surface itself is where they are 0, the black line. Around the sharp edge lines of
# equal distance are round outside, and have a corner inside.

# %%
n = 81
x, z = np.meshgrid(np.linspace(-1.6, 1.6, n), np.linspace(-1.6, 1.6, n))
plane = np.stack([x, np.full_like(x, 0.1), z], axis=-1)
found = ls.closest_point(surface, plane, signed=True)

figure, axes = plt.subplots(figsize=(5.5, 5))
levels = np.linspace(-0.8, 1.2, 21)
colours = axes.contourf(x, z, found.distance, levels, cmap="RdBu_r", vmin=-1, vmax=1, extend="both")
axes.contour(x, z, found.distance, [0.0], colors="black")
axes.set_aspect("equal")
axes.set_xlabel("x")
axes.set_ylabel("z")
figure.colorbar(colours, label="signed distance")
plt.show()

# %% [markdown]
# What is found is a place, with (face, u, v): distances are those to points of the surface, along
# its normals where it is smooth.

# %%
gap = np.sqrt(((plane - found.point) ** 2).sum(axis=-1))
assert np.allclose(gap, np.abs(found.distance), rtol=0, atol=1e-14)

# %% [markdown]
# ## Samples
#
# Random places, evenly by area, and as many that keep a distance from each other. From above:

# %%
even = ls.sample(surface, 1500, rng=1)
apart = ls.sample(surface, 1500, method="blue_noise", rng=1)

figure, both = plt.subplots(1, 2, figsize=(9, 4.5))
for axes, samples, title in zip(both, (even, apart), ("area", "blue_noise"), strict=True):
    above = samples.point[samples.normal[:, 2] > 0.3]
    axes.scatter(*above.T[:2], s=5)
    axes.set_aspect("equal")
    axes.set_title(title)
plt.show()
apart

# %% [markdown]
# A mean over samples by area is a mean over the surface: here of the height. Its error shrinks with
# the root of the number of samples.

# %%
height = ls.sample(surface, 20000, rng=2).point[:, 2]
print(f"{height.mean():.3f} +- {height.std() / np.sqrt(len(height)):.3f}")

# %% [markdown]
# ## What others draw
#
# Games draw patches that are near the surface. How near, as a proved bound, and what was found:

# %%
smooth = ls.LimitSurface(ls.Mesh(points, quads))
for kind in ("acc", "gregory"):
    for level in range(3):
        error = ls.approximate(smooth, kind, levels=level).error(smooth)
        most, seen = error.parametric.max(), error.parametric_found.max()
        angle = np.degrees(error.angle_found.max())
        print(f"{kind:8} {level} levels: at most {most:.1e}, seen {seen:.1e}, {angle:.2f} degrees")
