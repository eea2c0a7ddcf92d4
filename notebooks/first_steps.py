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
# Take a few polygons. Refine them: cut each into smaller ones, and move the new points towards the
# average of their neighbours. Refine again, and again. In the end there is a smooth surface, the
# *limit surface* of the polygons, and they are its *cage*. Modelling programs make smooth shapes
# so, by rules that Catmull and Clark found in 1978.
#
# Most of them refine a few times and stop. `limitsurf` does not refine: it knows the limit in
# closed form, and evaluates it at any place. This notebook makes a surface, looks at it, and asks
# it questions.

# %%
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

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
# ## Its surface, and a picture
#
# The picture has the cage as thin lines, and on the surface the curves that its edges become. Dots
# are points where the number of faces is not four.

# %%
surface = ls.LimitSurface(mesh)
picture = ls.plot(surface, view=(1, 0.4, 0.8), window_size=(800, 550))
picture

# %% [markdown]
# In a notebook, or in a browser, it can be turned with the mouse.

# %%
picture.interactive(height=420)

# %% [markdown]
# ## Points
#
# A point of the surface is asked for by face, `u` and `v`. The corners 0, 1, 2, 3 of a quad are at
# (0, 0), (1, 0), (1, 1) and (0, 1), and its middle is at (0.5, 0.5). (A face of n corners, n other
# than 4, counts as n faces, one at each corner. This cage has none.)

# %%
surface.evaluate(0, 0.5, 0.5)

# %% [markdown]
# Arrays broadcast, as everywhere in NumPy: here is a grid of 9 times 9 points on each of the 14
# faces.

# %%
face = np.arange(len(surface.limit_faces))[:, None, None]
grid = np.linspace(0, 1, 9)
surface.evaluate(face, grid[:, None], grid).shape

# %% [markdown]
# ## Derivatives and normals
#
# Derivatives of any order are with respect to `(u, v)`. `jet` has all of them up to an order at
# once.

# %%
jet = surface.jet(0, 0.25, 0.75, order=2)
assert np.allclose(jet[1, 1], surface.evaluate(0, 0.25, 0.75, nu=(1, 1)))
jet

# %% [markdown]
# The normal is the unit vector across both first derivatives. `curvature` has the principal
# curvatures, their directions, and what follows from them.

# %%
across = np.cross(jet[1, 0], jet[0, 1])
assert np.allclose(surface.normal(0, 0.25, 0.75), across / np.linalg.norm(across))
surface.normal(0, 0.25, 0.75)

# %%
bent = surface.curvature(0, 0.25, 0.75)
assert np.isclose(bent.gaussian, bent.k1 * bent.k2)
print(bent.k1, bent.k2)

# %% [markdown]
# `ls.plot` can colour the surface by it: red where it is bent like a ball, blue where it is bent
# like a saddle.

# %%
ls.plot(surface, scalars="gaussian", cage=False, view=(1, 0.4, 0.8), window_size=(800, 500))

# %% [markdown]
# ## Where it gets interesting
#
# Most points of this cage have three or four faces around them. Two have five: the ends of the
# inner edge, 4 and 12. Where the number is not four, the vertex is called *extraordinary*, or a
# *pole*. There the surface is no spline, and many programs only come close to it.

# %%
np.flatnonzero(mesh.vertex_faces == 5)

# %% [markdown]
# Here unit normals are as exact as anywhere. Face 3 is the first one above, and the third of its
# corners, (1, 1), is point 12.

# %%
surface.normal(3, 1.0, 1.0)

# %% [markdown]
# The derivatives themselves have no limit there: with five faces they grow without bound, by a
# factor $2 \lambda = 1.09998$ each time the distance is halved. So at the point itself they are
# NaN, and right next to it they are numbers, at any distance.

# %%
assert np.isnan(surface.evaluate(3, 1.0, 1.0, nu=(1, 0))).all()
steps = 0.5 ** np.arange(20, 25)
speed = np.linalg.norm(surface.evaluate(3, 1 - steps, 1 - steps, nu=(1, 0)), axis=-1)
speed[1:] / speed[:-1]

# %% [markdown]
# ## Weights
#
# Each value is a weighted sum of the points of the cage. `weights` is that sum, a sparse matrix
# with a row for each query: for fitting, for moving the cage, for gradients.

# %%
rng = np.random.default_rng(1)
faces = rng.integers(len(surface.limit_faces), size=1000)
u, v = rng.random((2, 1000))
W = surface.weights(faces, u, v)
assert np.allclose(W @ mesh.points, surface.evaluate(faces, u, v))
W.shape

# %% [markdown]
# New points on the same faces need no new preparation.

# %%
taller = surface.with_points(mesh.points * [1, 1, 3])
assert np.allclose(taller.evaluate(faces, u, v), surface.evaluate(faces, u, v) * [1, 1, 3])

# %% [markdown]
# ## Files
#
# `ls.read` and `ls.write` speak OBJ and other formats. `ls.tessellate` cuts the surface into
# polygons for programs that know no subdivision: here 8 by 8 to a face, with exact points and
# normals. `ls.plot` writes pictures, and pages that turn in a browser.

# %%
folder = TemporaryDirectory()
here = Path(folder.name)
ls.write(here / "el.obj", mesh)
assert ls.read(here / "el.obj") == mesh

fine = ls.tessellate(surface, 8)
ls.write(here / "fine.ply", fine)
ls.plot(surface, here / "el.png")
ls.plot(surface, here / "el.html")
for file in sorted(here.iterdir()):
    print(f"{file.name:10} {file.stat().st_size:9,} bytes")

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
# Around a point with N faces one step of refinement is a matrix, and n steps are its n-th power. In
# the basis of its eigenvectors a power costs nothing. Jos Stam found this way in 1998. `eigenbasis`
# shows it, exactly.

# %%
basis = ls.eigenbasis("catmull-clark", valence=5)
basis

# %% [markdown]
# The second and third eigenvalues are the $\lambda$ that the derivatives above felt, and the left
# eigenvector of eigenvalue 1 is the weights of the limit point: 25 for the point itself, 4 for each
# neighbour, 1 for each opposite corner, over 50.

# %%
assert np.isclose(2 * basis.float64.eigenvalues[1], speed[-1] / speed[-2], rtol=1e-4)
basis.float64.eigenvalues[:4]

# %%
basis.exact.limit_mask

# %% [markdown]
# ## From here
#
# - [Your own cage](your_own_cage.py): from other libraries and programs, and surfaces back to them.
# - [Creases](creases.py): edges and vertices that stay sharp, boundaries, texture coordinates.
# - [Sampling and fitting](sampling_and_fitting.py): arrays, weights, a fit to a scan.
# - [Near a pole](near_a_pole.py), [refinement against the closed form](convergence.py) and [a tour
#   of the eigenbasis](eigenbasis.py): the mathematics, and how to check it.
