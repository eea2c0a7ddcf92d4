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
# # Near a pole
#
# A pole, or extraordinary vertex, is one with other than four faces. The surface is smooth there:
# it has a tangent plane. Yet its derivatives grow without bound or vanish on the way to the pole,
# and its curvature seldom has a limit. This notebook shows all of that, at any distance down to
# 1e-300, and why the normals survive.

# %%
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

import limitsurf as ls

# %% [markdown]
# ## A pole to look at
#
# The cage is a rosette of N quads around vertex 0, each of which is at the pole with its corner 0,
# and a second ring around them. It is a hill with a random part, so that nothing is there by
# symmetry.


# %%
def rosette(valence: int) -> ls.LimitSurface:
    """A disk around vertex 0: N quads at the pole, and another ring of quads outside of them."""
    rng = np.random.default_rng(valence)
    k = np.arange(valence)
    points = [(0.0, 0.0, 0.0)]
    number = {(0, 0, 0): 0}  # by sector, and steps along its first edge and the next one
    for s in k:
        for i, j in ((1, 0), (2, 0), (1, 1), (2, 1), (1, 2), (2, 2)):
            angle = 2 * np.pi * (s + np.arctan2(j, i) * 2 / np.pi) / valence
            number[int(s), i, j] = len(points)
            points.append((np.hypot(i, j) * np.cos(angle), np.hypot(i, j) * np.sin(angle), 0.0))
    for s in k:
        for j in (1, 2):  # the second edge of a sector is the first one of the next
            number[int(s), 0, j] = number[int((s + 1) % valence), j, 0]
        number[int(s), 0, 0] = 0
    cells = [(s, i, j) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1)) for s in k]
    corners = ((0, 0), (1, 0), (1, 1), (0, 1))
    faces = [[number[int(s), i + a, j + b] for a, b in corners] for s, i, j in cells]
    place = np.array(points)
    place[:, 2] = rng.normal(scale=0.02, size=len(points)) - 0.12 * (place**2).sum(axis=1)
    return ls.LimitSurface(ls.Mesh(place, faces))


five = rosette(5)
ls.plot(five, cage=False, window_size=(700, 450))

# %% [markdown]
# ## Derivatives
#
# Walk from the middle of face 0 to its corner at the pole, and halve the distance at each step. The
# parametrisation stretches: at five faces the first derivatives grow by the same factor at each
# step, and the second ones by twice that.

# %%
n = np.arange(1, 1000)
steps = 0.5**n  # down to 2^-999, some 1e-301
jet = five.jet(0, steps[:400], steps[:400], order=2)
speed = np.linalg.norm(jet[1, 0], axis=-1)
bend = np.linalg.norm(jet[2, 0], axis=-1)
for k in (1, 3, 10, 30, 100, 300):
    print(f"2^-{k:<4} first: {speed[k] / speed[k - 1]:.6f}  second: {bend[k] / bend[k - 1]:.6f}")

# %% [markdown]
# The factors are eigenvalues. One halving of the distance is one step of refinement. It scales the
# surface around the pole by the *subdominant eigenvalue* $\lambda$ of the subdivision matrix, and
# the parameters by 1/2. So a first derivative is scaled by $2 \lambda$, a second one by
# $4 \lambda$. At valence 4, where $\lambda = 1/2$, first derivatives just stay, and this part has
# no second ones: it is linear in u and v. Valence 3 has a smaller $\lambda$, and they vanish; from
# 5 on it is larger, and they grow.


# %%
def subdominant(valence: int) -> tuple[float, float]:
    """The eigenvalue lambda of the tangent plane, and mu, the next one."""
    values = ls.eigenbasis("catmull-clark", valence=valence).float64.eigenvalues
    return float(values[1]), float(values[3])


for valence in (3, 4, 5, 6, 33):
    speed = np.linalg.norm(rosette(valence).evaluate(0, steps, steps, nu=(1, 0)), axis=-1)
    lam, mu = subdominant(valence)
    print(f"{valence:3}  2 lambda = {2 * lam:.9f}  seen {speed[-1] / speed[-2]:.9f}")
    assert np.isclose(speed[-1] / speed[-2], 2 * lam, rtol=1e-7)

# %% [markdown]
# At the pole itself a derivative is its limit, if it has one: 0 at valence 3. Where it has none it
# is NaN. There is no number that could stand in for it.

# %%
for valence in (3, 4, 5):
    print(valence, rosette(valence).evaluate(0, 0.0, 0.0, nu=(1, 0)))

# %% [markdown]
# ## Normals
#
# Two vectors that grow by the same factor keep their cross product in direction. Unit normals
# converge, and at the pole they have a value.

# %%
normals = five.normal(0, steps, steps)
at_pole = five.normal(0, 0.0, 0.0)
assert not np.isnan(at_pole).any()
at_pole, normals[50]

# %% [markdown]
# How fast do they come? What the tangent plane leaves out belongs to the next eigenvalue $\mu$, and
# it shrinks against the tangents as $(\mu / \lambda)^n$. Here are the angles to the normal at the
# pole, and the predicted slopes as dotted lines. The larger the valence is, the slower it goes: at
# 33 faces the normal at a distance of 1e-100 is not yet that of the pole.


# %%
def angle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The angle between unit vectors, in degrees, precise also where it is small."""
    found: np.ndarray = 2 * np.degrees(np.arcsin(np.linalg.norm(a - b, axis=-1) / 2))
    return found


figure, panel = plt.subplots(figsize=(7, 4), layout="constrained")
for valence in (3, 5, 8, 33):
    surface = rosette(valence)
    angles = angle(surface.normal(0, steps, steps), surface.normal(0, 0.0, 0.0))
    lam, mu = subdominant(valence)
    (line,) = panel.semilogy(n, angles, label=f"valence {valence}")
    at = (angles < 1e-3).argmax()
    slope = angles[at] * (mu / lam) ** (n - n[at])
    panel.semilogy(n, slope, ":", color=line.get_color())
panel.set(xlabel="halvings of the distance", ylabel="degrees", ylim=(1e-13, 90), xlim=(0, 600))
panel.set_title("angle between the normal and that of the pole")
panel.legend()
plt.show()

# %%
surface = rosette(33)
angles = angle(surface.normal(0, steps, steps), surface.normal(0, 0.0, 0.0))
lam, mu = subdominant(33)
assert np.isclose(angles[400] / angles[399], mu / lam, rtol=1e-3)
print(f"mu / lambda = {mu / lam:.5f}; at 1e-100 the normal is {angles[331]:.4f} degrees away")

# %% [markdown]
# So the pole's normal is no answer for a point nearby, and neither is a product of tiny or huge
# derivatives, which leaves the range of float64. `normal` takes the scale $\lambda^n$ out before it
# multiplies anything.

# %%
tiny = 1e-300
surface = rosette(3)
along, across = (surface.evaluate(0, tiny, tiny, nu=nu) for nu in ((1, 0), (0, 1)))
print("a product of derivatives:", np.cross(along, across) ** 2)
print("normal:                  ", surface.normal(0, tiny, tiny))

# %% [markdown]
# ## Curvature
#
# Heights over the tangent plane shrink as $\mu^n$, distances in it as $\lambda^n$. A curvature is a
# height over a distance squared: it changes by $\mu / \lambda^2$ at each halving. At valence 4 that
# is 1, since $\mu = 1/4$. At any other valence it is not: at 3 the curvature vanishes, if slowly,
# and from 5 on it grows.

# %%
figure, panel = plt.subplots(figsize=(7, 4), layout="constrained")
for valence in (3, 4, 5, 8):
    found = rosette(valence).curvature(0, steps[:400], steps[:400])
    largest = np.maximum(np.abs(found.k1), np.abs(found.k2))
    lam, mu = subdominant(valence)
    panel.semilogy(n[:400], largest, label=f"valence {valence}")
    print(f"{valence:3}  mu / lambda^2 = {mu / lam**2:.6f}  seen {largest[399] / largest[398]:.6f}")
    assert np.isclose(largest[399] / largest[398], mu / lam**2, rtol=1e-6)
panel.set(xlabel="halvings of the distance", title="largest principal curvature, in absolute value")
panel.legend()
plt.show()

# %% [markdown]
# The growth is slow, since it is measured in halvings: at five faces the curvature is tenfold only
# after 20 of them, a million times closer. Here is a pole of eight faces from above. The Gaussian
# curvature changes from sector to sector, however close one looks. Zebra stripes follow the
# normals, and pass the pole without a gap.

# %%
eight = rosette(8)
shown: dict[str, Any] = {"view": "top", "cage": False, "curves": False, "window_size": (600, 450)}
images = [ls.plot(eight, scalars=scalars, **shown) for scalars in ("gaussian", "zebra")]
Image.fromarray(np.concatenate([np.asarray(image) for image in images], axis=1))

# %% [markdown]
# ## What goes wrong elsewhere
#
# Three shortcuts are common. The first is to keep `u` and `v` away from the corner, by 1e-6, say.
# It moves the point by the order of $\lambda^{20}$ of the cage, and the derivatives are those of
# another place.

# %%
eps, near = 1e-6, 1e-12
there, clamped = (five.evaluate(0, x, x) for x in (near, eps))
print("position off by ", np.linalg.norm(there - clamped))
there, clamped = (five.evaluate(0, x, x, nu=(1, 0)) for x in (near, eps))
print("derivative", np.linalg.norm(there), "taken for", np.linalg.norm(clamped))
print("normal off by   ", angle(five.normal(0, near, near), five.normal(0, eps, eps)), "degrees")

# %% [markdown]
# The second is finite differences. Their step has to be shorter than the distance to the pole, and
# then rounding takes over.

# %%
near = 1e-200
exact = five.evaluate(0, near, near, nu=(1, 0))
for h in (1e-10, 1e-100, 1e-200):
    difference = (five.evaluate(0, near + h, near) - five.evaluate(0, near, near)) / h
    print(f"h = {h:g}: off by {np.linalg.norm(difference - exact) / np.linalg.norm(exact):.2%}")

# %% [markdown]
# The third is to end the recursion with a patch that only looks like the limit. OpenSubdiv ends
# faces at extraordinary vertices in Gregory patches. On a cube, at its default settings, these are
# 3e-3 of the size away from the limit, their normals half a degree, and second derivatives are off
# by 88 %. For pictures that is enough.
#
# ## Where there is no normal
#
# Smooth vertices of three and more faces always have a normal. At a boundary or a crease that is
# not so. With five and more faces between two sharp edges the normal near the vertex depends on the
# direction in which one came. So it is NaN at the vertex, and exact next to it.


# %%
def fan(faces: int) -> ls.LimitSurface:
    """Half of a wavy disk: some quads around vertex 0, which is on the boundary."""
    angle = np.linspace(0, np.pi, 2 * faces + 1)
    outer = np.stack([np.cos(angle), np.sin(angle), 0.5 * np.sin(2 * angle)], axis=1)
    quads = [(0, 2 * j + 1, 2 * j + 2, 2 * j + 3) for j in range(faces)]
    return ls.LimitSurface(ls.Mesh([(0, 0, 0), *outer], quads))


for faces in (3, 5):
    surface = fan(faces)
    print(f"{faces} faces: at the vertex    ", surface.normal(0, 0.0, 0.0).round(6))
    for turn in (0.0, 0.25, 0.5):
        u, v = (1e-200 * wave(turn * np.pi) for wave in (np.cos, np.sin))
        print(f"         at 1e-200, {turn * 90:4.1f} deg", surface.normal(0, u, v).round(6))

# %% [markdown]
# The reason is in the spectrum. A crease has its own tangent, of eigenvalue 1/2. With five faces
# two eigenvalues are larger than that. Their eigenvectors are zero on the crease, which is points
# 0, 1 and 11 of the ring: they prevail inside of the faces, and have no say along the crease.

# %%
basis = ls.eigenbasis("catmull-clark", kind="crease", faces=5)
assert np.allclose(basis.float64.V[[0, 1, 11], 1:3], 0)
assert len(basis.float64.tangent_masks) == 0
basis.float64.eigenvalues[:4]

# %% [markdown]
# The notebook on [creases](creases.py) has the pictures, the [tour of the
# eigenbasis](eigenbasis.py) the spectra, and the table in `help(ls.LimitSurface)` the growth at
# each kind of vertex. Why derivatives and curvature grow so is derived in
# [scaling](../derivations/scaling.py), which normals exist in [limit
# normals](../derivations/limit_normals.py).
