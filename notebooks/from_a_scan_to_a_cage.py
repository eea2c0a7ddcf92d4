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
# # From a scan to a cage
#
# A scanner gives points: many, noisy, some of them wrong. What one wants is a surface: smooth, of
# few numbers, to be edited, cut and handed on to CAD. Here is the way from the one to the other.
# The last step takes `pip install "limitsurf[cad,plot]"`.

# %%
import matplotlib.pyplot as plt
import numpy as np
from scipy.spatial import cKDTree

import limitsurf as ls

rng = np.random.default_rng(7)

# %% [markdown]
# ## The scan
#
# The object is a grip, given by a formula, so that what is found can be compared with the truth. It
# is no subdivision surface. 5000 points have noise of 0.1 mm, and one in fifty is somewhere else.


# %%
def grip(sphere: np.ndarray) -> np.ndarray:
    """Points of the object (mm) for directions."""
    x, y, z = np.moveaxis(sphere, -1, 0)
    waist = 1 - 0.3 * np.exp(-8 * (x - 0.15) ** 2) + 0.1 * x
    return np.stack([50 * x, 20 * y * waist, 16 * z * waist + 12 * x**2], axis=-1)


def directions(n: int) -> np.ndarray:
    """Random ones."""
    found = rng.standard_normal((n, 3))
    unit: np.ndarray = found / np.linalg.norm(found, axis=1, keepdims=True)
    return unit


noise = 0.1
truth = grip(directions(5000))
scan = truth + noise * rng.standard_normal(truth.shape)
wrong = rng.random(len(scan)) < 0.02
scan[wrong] += 5 * rng.standard_normal((wrong.sum(), 3))

# %% [markdown]
# ## The cage to start from
#
# Its surface must be near, roughly: here a cube, refined once and stretched to the scan. A cage
# from any modeller does as well. Its faces are the layout of the surface that is made.

# %%
cube = [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
start = ls.refined(ls.Mesh(cube, quads), 1)
start = start.with_points(grip(1.25 * start.points / np.linalg.norm(start.points, axis=1)[:, None]))
print(start)

# %% [markdown]
# ## The fit
#
# `loss="cauchy"` leaves wrong points alone; with `refine="auto"` parts are refined while their
# error is above the tolerance. Below the noise there is nothing to be found; of a point that is off
# by its noise this loss counts less than the square, hence 0.9.

# %%
found = ls.fit(start, scan, loss="cauchy", refine="auto", tolerance=0.9 * noise, max_iterations=12)
print(found, found.mesh, sep="\n")

# %% [markdown]
# How far is it from the truth, of which the fit knew nothing? The noise of many points averages
# out. Wrong points are still far away, and are not followed.

# %%
off = ls.closest_point(found.surface, grip(directions(4000))).distance
rms = np.sqrt((off**2).mean())
print(f"from the truth: {rms:.3f} mm (rms), {off.max():.3f} mm at most; noise: {noise} mm")
assert rms < noise / 2

figure, axis = plt.subplots(figsize=(7, 3.4), layout="constrained")
bins = np.geomspace(1e-3, 30, 60)
axis.hist([found.error[~wrong], found.error[wrong]], bins, stacked=True, label=["points", "wrong"])
axis.axvline(noise, color="black", linewidth=0.8, linestyle="--", label="noise")
axis.set(xscale="log", yscale="log", xlabel="distance from the surface (mm)", ylabel="points")
axis.legend(frameon=False)
plt.show()

# %% [markdown]
# ## Where is the error?
#
# Distances have a sign, outside or inside, and it tells noise from a shape that the cage cannot
# follow: noise cancels among neighbours. Here each place has the median of the forty points around
# it, of the cage as it was at first, and then of the one that was refined.


# %%
def misses(fit: ls.Fit) -> ls.Picture:
    """Draw signed distances of points, the median of forty at each place."""
    place = fit.face, fit.u, fit.v
    signed = ((fit.point - fit.surface.evaluate(*place)) * fit.surface.normal(*place)).sum(axis=1)
    tree = cKDTree(fit.point)

    def around(face: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        _, near = tree.query(fit.surface.evaluate(face, u, v), 40)
        median: np.ndarray = np.median(signed[near], axis=-1)
        return median

    return ls.plot(
        fit.surface,
        scalars=around,
        limits=(-0.3, 0.3),
        cmap="RdBu_r",
        label="points outside of the surface (mm)",
        cage=True,
        curves=False,
        poles=False,
        n=12,
        view=(0.4, -2, 1),
        window_size=(1000, 560),
    )


coarse = ls.fit(start, scan, loss="cauchy")
misses(coarse)

# %%
misses(found)

# %% [markdown]
# ## Sections
#
# Planes cut the surface; `ls.fit_curve` makes cubic B-splines of the cuts, within a tolerance and
# with few control points, for a drawing or a template.

# %%
figure, axis = plt.subplots(figsize=(6, 5), layout="constrained")
for x in (-30.0, 7.5, 35.0):
    curve = ls.fit_curve(ls.section(found.surface, [x, 0, 0], [1, 0, 0]), tolerance=0.01)
    _, control = curve[0]
    start_t, end_t = curve.domain[0]
    drawn = curve.evaluate(0, np.linspace(start_t, end_t, 400))
    (line,) = axis.plot(drawn[:, 1], drawn[:, 2], label=f"x = {x:g}, {len(control)} control points")
    axis.plot(control[:, 1], control[:, 2], ".:", color=line.get_color(), linewidth=0.8)
    assert curve.deviation.max() <= 0.01
axis.set(aspect="equal", xlabel="y (mm)", ylabel="z (mm)")
axis.legend(frameon=False, loc="upper left", bbox_to_anchor=(0, 1.3))
plt.show()

# %% [markdown]
# ## To CAD
#
# The surface is a solid of B-spline faces: see [a part from a cage](from_a_cage_to_a_part.py).

# %%
ls.write("grip.step", found.surface, tolerance=0.01, solid=True)
back = ls.read_brep("grip.step")
compared = ls.compare(found.surface, back, n=4)
print(back, compared, f"{ls.volume(found.surface) / 1e3:.2f} ml", sep="\n")
assert compared.largest <= 0.01
