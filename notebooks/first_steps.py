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
# # First steps
#
# A Catmull-Clark surface is what a cage of polygons becomes when it is refined forever.
# `limitsurf` does not refine: it knows the limit in closed form and evaluates it at any point of
# any face.

# %%
from fractions import Fraction
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
from IPython.display import Image

import limitsurf as ls

# %% [markdown]
# ## A cage
#
# A cage is an array of points and a list of faces, each with its corners counter-clockwise seen
# from outside. Here is an L of three cubes: eight points around its outline, below and above.

# %%
outline = [(0, 0), (1, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2), (0, 1)]
points = np.array([(x, y, z) for z in (0, 1) for x, y in outline], dtype=float)

floor = [(0, 1, 4, 7), (1, 2, 3, 4), (7, 4, 5, 6)]
below = [face[::-1] for face in floor]
above = [tuple(k + 8 for k in face) for face in floor]
sides = [(k, (k + 1) % 8, (k + 1) % 8 + 8, k + 8) for k in range(8)]

mesh = ls.Mesh(points, below + above + sides)
mesh

# %% [markdown]
# Most of its points have three or four faces around them. Two have five: the ends of the inner
# edge, 4 and 12. There, classic software stops being exact.

# %%
np.flatnonzero(mesh.vertex_faces == 5)

# %% [markdown]
# Cages are usually files. `ls.write` and `ls.read` speak OBJ.

# %%
here = Path(mkdtemp())
ls.write(here / "el.obj", mesh)
mesh = ls.read(here / "el.obj")

# %% [markdown]
# ## Points of the surface
#
# A point is asked for by face, `u` and `v`. A quad's corners 0, 1, 2, 3 are at (0, 0), (1, 0),
# (1, 1) and (0, 1). Arrays broadcast, as everywhere in NumPy.

# %%
surface = ls.LimitSurface(mesh)
surface.evaluate(0, 0.5, 0.5)

# %%
face = np.arange(len(surface.limit_faces))[:, None, None]
u, v = np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 1, 9), indexing="ij")
surface.evaluate(face, u, v).shape

# %% [markdown]
# ## Derivatives and normals
#
# Derivatives of any order are with respect to `(u, v)`; `jet` returns all of them up to an order
# at once.

# %%
across = surface.evaluate(0, 0.25, 0.75, nu=(1, 1))
jet = surface.jet(0, 0.25, 0.75, order=2)
assert np.allclose(jet[1, 1], across)
jet

# %% [markdown]
# Unit normals are exact everywhere, also at a point with five faces. Face 3 is the first one
# above, and the third of its corners, (1, 1), is point 12.

# %%
surface.normal(3, 1.0, 1.0)

# %% [markdown]
# The derivatives themselves have no limit there: with five faces they grow without bound, by a
# factor `2 * 0.54998...` each time the distance is halved. So at the point itself they are NaN,
# and right next to it they are numbers, at any distance.

# %%
assert np.isnan(surface.evaluate(3, 1.0, 1.0, nu=(1, 0))).all()
steps = 0.5 ** np.arange(10, 15)
speed = np.linalg.norm(surface.evaluate(3, 1 - steps, 1 - steps, nu=(1, 0)), axis=-1)
speed[1:] / speed[:-1]

# %% [markdown]
# ## Weights
#
# Every value is a weighted sum of the points of the cage. `weights` is that sum, a sparse matrix
# with a row for each query: for fitting, for moving the cage, for gradients.

# %%
rng = np.random.default_rng(1)
faces, a, b = rng.integers(len(surface.limit_faces), size=1000), rng.random(1000), rng.random(1000)
W = surface.weights(faces, a, b)
assert np.allclose(W @ mesh.points, surface.evaluate(faces, a, b))
W.shape

# %% [markdown]
# New points on the same faces need no new preparation.

# %%
taller = surface.with_points(mesh.points * [1, 1, 3])
assert np.allclose(taller.evaluate(faces, a, b), surface.evaluate(faces, a, b) * [1, 1, 3])

# %% [markdown]
# ## Is it true?
#
# Do not believe it: refine. `validate` refines the cage level by level and measures how far the
# refined points are from the surface. At first the distance falls fourfold with each level, order
# 2; then the largest distance is next to the points of five faces, where refinement gains only a
# factor 0.55 a level, order 0.86. In the last column the refined points are moved to their own
# limit first: what remains is rounding.

# %%
report = ls.validate(surface, levels=6)
assert report["order"][1] > 1.9
assert 0.8 < report["order"][-1] < 1.1
assert report["limit_error"].max() < 1e-14
report

# %% [markdown]
# Or ask for exact numbers. With fractions in, fractions come out: the corner of a cube goes to
# (1/4, 1/4, 1/4), and the middle of its face to 13/162 below the face.

# %%
corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]).astype(object)
quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
cube = ls.LimitSurface(ls.Mesh(corners, quads))
half = Fraction(1, 2)
corner, middle = cube.evaluate(0, Fraction(0), Fraction(0)), cube.evaluate(0, half, half)
assert [*corner] == [Fraction(1, 4)] * 3
assert middle[0] == Fraction(13, 162)
middle

# %% [markdown]
# ## Why it works
#
# Around a point with `N` faces one step of refinement is a matrix, and `n` steps are its `n`-th
# power. In the basis of its eigenvectors a power costs nothing. `eigenbasis` shows it, exactly.

# %%
basis = ls.eigenbasis("catmull-clark", valence=5)
basis

# %% [markdown]
# The second and third eigenvalues are those that the derivatives above felt, and the left
# eigenvector of eigenvalue 1 is the weights of the limit point: 25 for the point itself, 4 for
# each neighbour, 1 for each opposite corner, over 50.

# %%
basis.exact.eigenvalues[1], basis.float64.eigenvalues[0, 1]

# %%
basis.exact.limit_mask

# %% [markdown]
# ## A picture

# %%
picture = here / "el.png"
ls.plot(surface, off_screen=True, screenshot=picture)
Image(filename=picture)
