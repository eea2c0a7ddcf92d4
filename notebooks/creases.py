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
# # Creases
#
# A Catmull-Clark surface is smooth wherever nobody asks for an edge. Edges and vertices of its cage
# can be given a sharpness, from 0 (none) to infinity; a cage can have boundaries, holes and parts
# that are no manifold. This notebook shows what each of them does to the surface, which tangents
# and normals are left, and that none of it costs exactness.

# %%
from fractions import Fraction
from itertools import pairwise
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

import limitsurf as ls


def row(*images: object) -> Image.Image:
    """Pictures side by side."""
    return Image.fromarray(np.concatenate([np.asarray(image) for image in images], axis=1))


# %% [markdown]
# ## From smooth to sharp
#
# A cube, and a crease of sharpness `s` around its top. Refinement treats an edge of sharpness `s`
# as a sharp one, and its halves as edges of sharpness `s - 1`; once nothing is left, it is smooth.
# A remainder below 1 blends the two rules. So `s` is, roughly, how many steps the edge lasts. Here
# it is 0, 0.5 and 1, then 2, 4 and infinite.

# %%
ring = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
points = np.array([(x, y, z) for z in (-1, 1) for x, y in ring], dtype=float)
sides = [(k, (k + 1) % 4, (k + 1) % 4 + 4, k + 4) for k in range(4)]
cube = [(0, 3, 2, 1), (4, 5, 6, 7), *sides]
rim = [(4, 5), (5, 6), (6, 7), (7, 4)]


def creased(s: float) -> ls.LimitSurface:
    """The surface of the cube with sharpness `s` around the top."""
    return ls.LimitSurface(ls.Mesh(points, cube, creases=dict.fromkeys(rim, s)))


def picture(surface: ls.LimitSurface, **options: object) -> ls.Picture:
    """A small picture."""
    shown: dict[str, Any] = {"window_size": (400, 300), "poles": False, "n": 16, **options}
    drawn: ls.Picture = ls.plot(surface, **shown)
    return drawn


row(*(picture(creased(s)) for s in (0, 0.5, 1)))

# %%
row(*(picture(creased(s)) for s in (2, 4, np.inf)))

# %% [markdown]
# Where the sharpness is finite the surface is smooth after all: normals from both sides of the rim
# agree, on face 1 above and face 2 at the side. Only an infinite one leaves an edge, and there each
# side keeps its own normal, in the face that is asked.

# %%
for s in (0, 1, 4, np.inf):
    # the middle of edge (4, 5): the first side of face 1, the third of face 2
    above, beside = creased(s).normal(1, 0.5, 0), creased(s).normal(2, 0.5, 1)
    angle = np.degrees(np.arccos(np.clip(above @ beside, -1, 1)))
    print(f"s = {s:<4} the two normals are {angle:.4f} degrees apart")

# %% [markdown]
# An infinitely sharp edge is a curve that the faces have no say in: the cubic B-spline of its own
# polygon. In fractions that is an equality.

# %%
t = Fraction(3, 7)
spline = [(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3]
polygon = points[[7, 4, 5, 6]].astype(int).astype(object)
on_curve = sum(w * p for w, p in zip(spline, polygon, strict=True)) / 6
on_surface = creased(np.inf).evaluate(1, t, Fraction(0))
assert (on_curve == on_surface).all()
on_surface

# %% [markdown]
# ## A dart
#
# A crease may end inside of the surface. Its end is a dart: the edge fades into a smooth surface.
# A hill with a crease along half of its top line, all along it, and along half of it again, but
# with a sharp vertex at the end: there it does not fade.


# %%
def net(size: int) -> tuple[np.ndarray, np.ndarray]:
    """Faces of a net of size x size quads, and the vertices of its middle line."""
    number = np.arange((size + 1) ** 2).reshape(size + 1, size + 1)
    corners = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    return np.stack(corners, axis=-1).reshape(-1, 4), number[size // 2]


quads, middle = net(6)
y, x = np.mgrid[-3:4, -3:4]
hill = np.stack([-y, x, 3 * np.exp(-0.5 * np.abs(y)) - 0.1 * x**2], axis=-1).reshape(-1, 3)
edges = list(pairwise(middle.tolist()))
all_along, half = dict.fromkeys(edges, np.inf), dict.fromkeys(edges[:3], np.inf)
end = edges[2][1]

dart = ls.LimitSurface(ls.Mesh(hill, quads, creases=half))
ridge = ls.LimitSurface(ls.Mesh(hill, quads, creases=all_along))
corner = ls.LimitSurface(ls.Mesh(hill, quads, creases=half, corners={end: np.inf}))
row(*(picture(surface, cage=False, curves=False) for surface in (dart, ridge, corner)))

# %% [markdown]
# At the dart all four faces have the same normal. One edge before it, the two faces on each side of
# the crease have one of their own.


# %%
def normals_at(surface: ls.LimitSurface, vertex: int) -> np.ndarray:
    """Normals at a vertex, by all the faces around it."""
    face, corner = np.nonzero(quads == vertex)
    u, v = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])[corner].T
    return np.array(surface.normal(face, u, v)).round(6)


normals_at(dart, end)

# %%
normals_at(dart, end - 1)

# %% [markdown]
# ## Boundaries
#
# Boundary edges are sharp. What boundary vertices do is a choice: "edge_and_corner" holds those of
# a single face where they are, "edge_only" lets them follow the curve as all others, and "none"
# takes the outermost faces only as a frame for the rest.

# %%
y, x = np.mgrid[-2:3, -2:3]
saddle = np.stack([x, y, 0.3 * (x**2 - y**2)], axis=-1).reshape(-1, 3)
patch = ls.Mesh(saddle, net(4)[0])
row(
    picture(ls.LimitSurface(patch, boundary="edge_and_corner"), n=24),
    picture(ls.LimitSurface(patch, boundary="edge_only"), n=24),
    picture(ls.LimitSurface(patch, boundary="none"), n=24),
)

# %% [markdown]
# ## Which normals exist
#
# The faces at a vertex that lie between two sharp edges form a *sector*. Every number of faces
# has a subdivision matrix of its own, and its eigenvectors tell whether all of the sector comes
# together in one tangent plane. `eigenbasis` knows the two vectors that span it, where it exists.

# %%
kinds = ("interior", "crease", "corner", "dart", "cone")
print("faces    " + "".join(f"{faces:5}" for faces in range(1, 10)))
for kind in kinds:
    first = 1 if kind in ("crease", "corner") else 2
    found = ["     "] * (first - 1)
    for faces in range(first, 10):
        basis = ls.eigenbasis("catmull-clark", kind=kind, faces=faces)
        found.append("  yes" if len(basis.float64.tangent_masks) else "    -")
    print(f"{kind:9}" + "".join(found))

# %% [markdown]
# A crease, or a boundary, needs four faces or fewer on a side, a sharp corner two or fewer; a cone,
# which is a sharp vertex amid smooth faces, never has a tangent plane. What happens instead shows
# in fans of `k` faces around a vertex of the boundary: the angle between the normals near it and
# the one on the boundary, by the direction in which one leaves the vertex.


# %%
def fan(k: int, opening: float, sharpness: float) -> ls.LimitSurface:
    """Part of a wavy disk: k faces around vertex 0, within an angle."""
    angle = np.linspace(0, opening, 2 * k + 1)
    waves = 0.5 * np.sin(2 * angle) + 0.2 * np.sin(angle)
    outer = np.stack([np.cos(angle), np.sin(angle), waves], axis=1)
    faces = [(0, 2 * j + 1, 2 * j + 2, 2 * j + 3) for j in range(k)]
    mesh = ls.Mesh(np.concatenate([np.zeros((1, 3)), outer]), faces, corners={0: sharpness})
    return ls.LimitSurface(mesh)


def around(surface: ls.LimitSurface, depth: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions, from 0 to k, at distance 2^-depth, and the angles of the normals in degrees."""
    k = len(surface.limit_faces)
    turn = np.linspace(0, 1, 51)
    u, v = np.cos(turn * np.pi / 2) * 0.5**depth, np.sin(turn * np.pi / 2) * 0.5**depth
    normals = np.array(surface.normal(np.arange(k)[:, None], u, v)).reshape(-1, 3)
    sine = np.linalg.norm(np.cross(normals, normals[0]), axis=1)
    angles = np.degrees(np.arctan2(sine, normals @ normals[0]))
    return (np.arange(k)[:, None] + turn).ravel(), angles


three, four, six = (fan(k, np.pi, 0) for k in (3, 4, 6))
cases = {
    "boundary, 3 faces": three,
    "boundary, 4 faces": four,
    "boundary, 6 faces": six,
    "corner, 3 faces": fan(3, 2.0, np.inf),
}
figure, panels = plt.subplots(1, 4, figsize=(13, 3), sharey=True, layout="constrained")
for panel, (title, case) in zip(panels, cases.items(), strict=True):
    for depth in (2, 5, 20, 200, 1000):
        panel.plot(*around(case, depth), label=f"$2^{{-{depth}}}$")
    panel.set(title=title, xlabel="direction, in faces")
panels[0].set_ylabel("angle of the normal, in degrees")
figure.legend(*panels[0].get_legend_handles_labels(), title="distance", loc="outside right center")
plt.show()

# %% [markdown]
# With three faces all directions agree in the end. With four they do, too, but only as one over the
# number of halvings. With six the normals inside agree in the end, and so do those along the two
# sides of the boundary, but not with each other. At the corner the normal turns all the way from
# one side to the other, at every distance. So at these two vertices it is NaN; next to them, as
# close as float64 comes, it is that of the point asked for.

# %%
assert around(three, 1000)[1].max() < 1e-6
assert around(four, 500)[1].max() > 1.9 * around(four, 1000)[1].max()
assert around(six, 1000)[1].max() > 5
assert np.isnan(six.normal(0, 0.0, 0.0)).all()
for surface in (four, six):
    print(surface.normal(0, 0.0, 0.0), "at the vertex")
    print(surface.normal(0, 1e-300, 1e-300), "next to it")

# %% [markdown]
# The table in the documentation of `ls.LimitSurface` has, for each kind of vertex, how fast normals
# come to their limits, and how derivatives and curvature grow on the way.
#
# ## Is it true?
#
# Refinement is the judge, as always. In fractions every refined point, moved to its limit, is equal
# to the surface at its (face, u, v): at creases of sharpness 5/2 and 1/3 that meet a sharp one at a
# corner of the cube. In floats the difference is rounding.

# %%
some = {(4, 5): Fraction(5, 2), (5, 6): Fraction(1, 3), (5, 1): np.inf}
exact = ls.LimitSurface(ls.Mesh(points.astype(int).astype(object), cube, creases=some))
fine = ls.refined(exact.mesh, levels=2)
u, v = (np.vectorize(Fraction, otypes=[object])(x) for x in (fine.parent_u, fine.parent_v))
assert (exact.evaluate(fine.parent_face, u, v) == fine.limit_points).all()
len(fine.points), exact.evaluate(1, Fraction(1, 3), Fraction(0))

# %%
report = ls.validate(ls.LimitSurface(ls.Mesh(points, cube, creases=some)), levels=5)
assert report["limit_error"].max() < 1e-14
report

# %% [markdown]
# ## What it costs
#
# Along a crease that goes straight on, a face is no tree of ever smaller patches: across the
# crease the surface is a spline of `ceil(s) + 1` strips, along it an ordinary one, and so a face
# beside it stays one patch whatever the sharpness. Only where the crease ends, bends or meets
# another one its faces are split, `ceil(s)` times.

# %%
plane, middle = net(40)
line = list(pairwise(middle[5:36].tolist()))
for s in (0, 0.5, 2, 4, 8):
    sheet = ls.LimitSurface(ls.Mesh(np.zeros((41**2, 3)), plane, creases=dict.fromkeys(line, s)))
    print(f"s = {s:<4}", dict(sheet.patches.summary()), "of", sheet.patches.n_points, "points")

# %% [markdown]
# ## A seam
#
# Texture coordinates are a second mesh over the same faces: where two faces disagree about an edge
# it has a seam, and each side a boundary. Here is the cube unfolded into a cross. The channel is
# evaluated in the same way as the points, by its name.

# %%
cells = [[(0, 1), (0, 0), (1, 0), (1, 1)], [(0, 2), (1, 2), (1, 3), (0, 3)]]
cells += [[(k, 1), (k + 1, 1), (k + 1, 2), (k, 2)] for k in range(4)]
uv, rows = np.unique(np.reshape(cells, (-1, 2)), axis=0, return_inverse=True)
painted = ls.LimitSurface(ls.Mesh(points, cube, channels={"uv": (uv, rows.ravel(), "none")}))

# the edge (6, 7) has face 1 above, and face 4 at the side: one place, two values
for face, at in ((1, (0.25, 1.0)), (4, (0.75, 1.0))):
    print(face, painted.evaluate(face, *at), painted.evaluate(face, *at, channel="uv"))

# %% [markdown]
# How stiff the outlines of its islands are is the channel's interpolation: "none" rounds them as
# "edge_only" rounds a boundary, "corners_only" keeps their corners, "all" keeps all of it straight.

# %%
layouts = []
for mode in ("none", "corners_only", "all"):
    channels = {"uv": (uv, rows.ravel(), mode)}
    layouts.append(picture(ls.LimitSurface(ls.Mesh(points, cube, channels=channels)), channel="uv"))
row(*layouts)

# %% [markdown]
# All of this can be kept in files, `ls.write("cage.usda", mesh)`: in those of USD, or in OBJ files
# with the tags of OpenSubdiv.
