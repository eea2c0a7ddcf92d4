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
# # Sampling and fitting
#
# Queries are arrays, and so are answers. A surface is linear in its control points, so that it is
# also a sparse matrix. This notebook scatters points evenly over a surface, fits a surface to a
# noisy scan, and moves a cage.

# %%
import numpy as np
from scipy.sparse import csr_array, vstack
from scipy.sparse.linalg import lsqr

import limitsurf as ls

# %% [markdown]
# ## Arrays and broadcasting
#
# The cage is an L of three cubes. It has 14 quads, and each of them is a limit face.

# %%
outline = [(0, 0), (1, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2), (0, 1)]
points = np.array([(x, y, z) for z in (0, 1) for x, y in outline], dtype=float)
floor = [(0, 1, 4, 7), (1, 2, 3, 4), (7, 4, 5, 6)]
below = [face[::-1] for face in floor]
above = [tuple(k + 8 for k in face) for face in floor]
sides = [(k, (k + 1) % 8, (k + 1) % 8 + 8, k + 8) for k in range(8)]
surface = ls.LimitSurface(ls.Mesh(points, below + above + sides))
surface

# %% [markdown]
# `face`, `u` and `v` broadcast. One face and many parameters, many faces and one place in each, or
# a grid on every face: the shape of the answer is the shape of the query, and then that of a point.

# %%
every = np.arange(len(surface.limit_faces))
grid = np.linspace(0, 1, 5)
print(surface.evaluate(0, grid, 0.5).shape)
print(surface.evaluate(every, 0.5, 0.5).shape)
print(surface.evaluate(every[:, None, None], grid[:, None], grid).shape)

# %% [markdown]
# Points need not be places. A cage of 16 numbers, one for each vertex, gives a function on the
# surface: `with_points` takes the same faces, and prepares nothing again.

# %%
heat = surface.with_points(np.arange(16.0))
heat.evaluate(0, grid, 0.5)

# %% [markdown]
# ## Samples of equal density
#
# Parameters chosen evenly are not even on the surface: faces have different areas, and they are
# stretched. What is stretched is known exactly. The area of a small patch `du dv` is the length of
# the cross product of the two first derivatives.


# %%
def area_element(face: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Area of the surface per area of parameters."""
    jet = surface.jet(face, u, v, order=1)
    return np.asarray(np.linalg.norm(np.cross(jet[1, 0], jet[0, 1]), axis=-1))


# %% [markdown]
# So take many parameters, and keep each with a probability in proportion to its area element. Near
# vertices of five faces the element grows without bound, but so slowly that only few of the
# parameters are concerned: here the largest of 60,000 is the bound.

# %%
rng = np.random.default_rng(0)
face = rng.integers(len(every), size=60_000)
u, v = rng.random((2, 60_000))
area = area_element(face, u, v)
kept = rng.random(len(area)) * area.max() < area
face, u, v = face[kept], u[kept], v[kept]
samples = surface.evaluate(face, u, v)
len(samples)

# %% [markdown]
# Are they even? The share of samples on each face should be its share of the area. Gauss points
# know the areas without any chance.

# %%
at, weight = np.polynomial.legendre.leggauss(16)
at, weight = (at + 1) / 2, weight / 2
elements = area_element(every[:, None, None], at[:, None], at)
areas = np.einsum("fij,i,j->f", elements, weight, weight)
share = np.bincount(face, minlength=len(every)) / len(face)
expected = areas / areas.sum()
assert (np.abs(share - expected) < 5 * np.sqrt(expected / len(face))).all()
print(f"area {areas.sum():.6f}")
np.stack([share, expected])

# %% [markdown]
# The samples carry normals, and whatever else a scan would have.

# %%
normals = surface.normal(face, u, v)
assert np.allclose(np.linalg.norm(normals, axis=-1), 1)

# %% [markdown]
# ## A surface is a matrix
#
# `weights` has a row for each query and a column for each vertex of the cage. Times the points it
# is the surface, times anything else it is that on the surface. `nu` gives the weights of
# derivatives. A row has entries only for vertices near its face.

# %%
W: csr_array = surface.weights(face, u, v)
assert np.allclose(W @ points, samples)
assert np.allclose(W.sum(axis=1), 1)
print(W.shape, f"{W.nnz / W.shape[0]:.1f} entries a row")

# %% [markdown]
# ## A fit
#
# A scan of some object: 3,000 points with noise, spread over a torus with bumps. One part of it was
# hidden, and has no points. We look for the control points of a smooth surface that comes closest
# to the others.


# %%
def bumpy_torus(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Points of the object that was scanned, by two angles."""
    tube = 0.8 + 0.12 * np.cos(3 * a) * np.sin(2 * b)
    ring = 2 + tube * np.cos(b)
    return np.stack([ring * np.cos(a), ring * np.sin(a), tube * np.sin(b)], axis=-1)


noise = 0.02
angles = rng.uniform(0, 2 * np.pi, (2, 3000))
hidden = np.abs(angles - [[4.6], [1.0]]).max(axis=0) < 1.3
angles = angles[:, ~hidden]
scan = bumpy_torus(*angles) + rng.normal(scale=noise, size=(angles.shape[1], 3))
len(scan)

# %% [markdown]
# The cage is a torus of 12 times 8 quads. Where on it does a point of the scan belong? In general
# that is a search for the closest point. Here the angles tell: face (i, j) of the cage covers one
# twelfth of the way round, and one eighth of the tube.

# %%
n, m = 12, 8
a, b = np.meshgrid(2 * np.pi * np.arange(n) / n, 2 * np.pi * np.arange(m) / m, indexing="ij")
ring = 2 + 0.8 * np.cos(b)
start = np.stack([ring * np.cos(a), ring * np.sin(a), 0.8 * np.sin(b)], axis=-1).reshape(-1, 3)
number = np.arange(n * m).reshape(n, m)
east, north = np.roll(number, -1, axis=0), np.roll(number, -1, axis=1)
quads = np.stack([number, east, np.roll(east, -1, axis=1), north], axis=-1).reshape(-1, 4)
torus = ls.LimitSurface(ls.Mesh(start, quads))

place = angles / (2 * np.pi) * [[n], [m]]
whole = np.minimum(place.astype(int), [[n - 1], [m - 1]])
scan_face = number[whole[0], whole[1]]
scan_u, scan_v = place - whole
W = torus.weights(scan_face, scan_u, scan_v)

# %% [markdown]
# What is wanted are points `P` with `W @ P` close to the scan. That is linear least squares, one
# problem for each coordinate. The hidden part needs more: a second term asks that second
# derivatives be those of the plain torus from which the cage was taken, at nine places on each
# face. These are matrices as well, made by `weights` with `nu`.

# %%
third = np.array([1, 3, 5]) / 6
places = np.arange(n * m)[:, None, None], third[:, None], third
rows = torus.weights(*places, nu=[(2, 0), (1, 1), (0, 2)])
bending = vstack([scale * matrix for scale, matrix in zip((1, 2, 1), rows, strict=True)])
W.shape, bending.shape

# %% [markdown]
# How much should it count? With nothing at all the hidden part is loose. With too much, the bumps
# are flattened.


# %%
def fitted(fairness: float) -> np.ndarray:
    """Control points (n m, 3) that fit the scan."""
    matrix = csr_array(vstack([W, fairness * bending]))
    target = np.concatenate([scan, fairness * (bending @ start)])
    return np.stack([lsqr(matrix, x, atol=1e-10, btol=1e-10)[0] for x in target.T], axis=1)


def rms(difference: np.ndarray) -> float:
    """Root of the mean square of the lengths of vectors (..., 3)."""
    return float(np.sqrt((difference**2).sum(axis=-1).mean()))


def on_object(face: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Points of the object that belong to places on the cage."""
    i, j = np.divmod(face, m)
    return bumpy_torus((i + u) * 2 * np.pi / n, (j + v) * 2 * np.pi / m)


for fairness in (0, 0.01, 0.1, 1, 10):
    fit = torus.with_points(fitted(fairness))
    to_scan = rms(fit.evaluate(scan_face, scan_u, scan_v) - scan)
    to_object = rms(fit.evaluate(*places) - on_object(*places))
    print(f"{fairness:<5} from the scan {to_scan:.4f}, from all of the object {to_object:.4f}")

# %% [markdown]
# The distance from the scan is the noise, as it should be: $\sqrt{3}$ times 0.02. The distance from
# the object, which nobody told the fit, can be less than that, hidden part and all.

# %%
fit = torus.with_points(fitted(0.1))
assert rms(fit.evaluate(*places) - on_object(*places)) < noise * np.sqrt(3)
ls.plot(fit, view=(0.6, -1, 0.9), window_size=(800, 500))


# %% [markdown]
# Any function of the place can be shown in colours: here how far the fit is from the object. It is
# farthest where nothing was seen.


# %%
def distance(face: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Distance of the fit from the object."""
    return np.asarray(np.linalg.norm(fit.evaluate(face, u, v) - on_object(face, u, v), axis=-1))


ls.plot(
    fit,
    scalars=distance,
    label="distance",
    cage=False,
    view=(0.6, -1, 0.9),
    window_size=(800, 500),
)

# %% [markdown]
# ## A cage that moves
#
# In an animation faces stay and points move. `with_points` makes the surface of each frame, with
# nothing to prepare. With a matrix it is even less: one product for each frame.

# %%
W = fit.weights(*places)
for time in np.linspace(0, 1, 5):
    moved = fit.points * [1, 1, 1 + 0.5 * np.sin(2 * np.pi * time)]
    surface_now = fit.with_points(moved)
    assert surface_now.patches is fit.patches
    frame = surface_now.evaluate(*places)
    assert np.allclose(W @ moved, frame.reshape(-1, 3))
print(frame.shape)

# %% [markdown]
# ## Many queries
#
# From 100,000 queries in a call on, compiled kernels answer. They are compiled once on a machine,
# in the background, once on a machine; `ls.precompile()` does so at once.
# `workers=-1` divides the queries among all processors. The results are the same for any number of
# workers, to the last digit.

# %%
some = surface.evaluate(face[:1000], u[:1000], v[:1000], workers=1)
assert (some == surface.evaluate(face[:1000], u[:1000], v[:1000], workers=-1)).all()
