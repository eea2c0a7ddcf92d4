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
# # Your own cage
#
# Cages come from elsewhere: from a library, a modelling program, a file. This notebook brings some
# in, shows what can go wrong on the way, and takes surfaces back out.

# %%
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pyvista
import trimesh
from PIL import Image

import limitsurf as ls

folder = TemporaryDirectory()
here = Path(folder.name)


def row(*surfaces: ls.LimitSurface, up: str = "z") -> Image.Image:
    """Pictures side by side."""
    pictures = [ls.plot(surface, up=up, window_size=(450, 380)) for surface in surfaces]
    return Image.fromarray(np.concatenate([np.asarray(x) for x in pictures], axis=1))


# %% [markdown]
# ## From PyVista
#
# `ls.from_pyvista` takes the polygons of a PyVista dataset, of any size. Look at what comes out: a
# mesh says how many faces of which size it has, how many vertices of which valence, and how many of
# them are on a boundary.

# %%
barrel = pyvista.Cylinder(resolution=12, direction=(0, 0, 1))
apart = ls.from_pyvista(barrel, merge=False)
apart

# %% [markdown]
# All of its vertices are on a boundary. A cylinder has none. But PyVista gives each end of it
# points of its own, so that they can have normals of their own: its faces only touch. `merge=True`
# joins points that are in one place, and a number those that are as close. Texture coordinates,
# which this dataset has, become a channel with seams; by default points are joined where there
# are some.

# %%
joined = ls.from_pyvista(barrel, merge=True)
joined

# %%
row(ls.LimitSurface(apart), ls.LimitSurface(joined))

# %% [markdown]
# The ends are polygons of twelve corners. Each counts as twelve limit faces, one at each corner,
# which meet at its centre.

# %%
surface = ls.LimitSurface(joined)
assert len(surface.limit_faces) == 12 + 2 * 12
surface.limit_faces.face

# %% [markdown]
# ## From trimesh
#
# A `trimesh.Trimesh` has triangles only. It merges points by itself, unless it is told not to;
# `merge=True` does so here.

# %%
box = trimesh.creation.box()
print(ls.from_trimesh(box))
box.unmerge_vertices()
print(ls.from_trimesh(box))
print(ls.from_trimesh(box, merge=True))

# %% [markdown]
# ## Triangles or quads?
#
# Catmull-Clark likes quads. Triangles are no error: each becomes three limit faces. But the surface
# feels each edge, also the diagonals that some program has drawn. Here is a box of six quads, the
# same one cut into triangles, and that with smoother rules for triangles.

# %%
quads = ls.from_pyvista(pyvista.Cube(), merge=True)
cut = ls.from_trimesh(box, merge=True)
row(*(ls.LimitSurface(cage) for cage in (quads, cut)), ls.LimitSurface(cut, triangles="smooth"))

# %% [markdown]
# The quads keep the symmetry of the box: all its corners go to the same distance from the middle.
# Those of the triangles do not, since some have four edges and some have five.


# %%
def corner_distances(surface: ls.LimitSurface) -> np.ndarray:
    """Distances of the limits of the vertices from the middle of the box, each of them once."""
    limits = ls.refined(surface.mesh, 0, **surface.rules).limit_points
    return np.unique(np.linalg.norm(limits - surface.points.mean(axis=0), axis=1).round(9))


for name, surface in {
    "quads": ls.LimitSurface(quads),
    "triangles": ls.LimitSurface(cut),
    "triangles, smooth": ls.LimitSurface(cut, triangles="smooth"),
}.items():
    print(
        f"{name:18} {len(surface.limit_faces)} limit faces, corners at", corner_distances(surface)
    )

# %% [markdown]
# So bring quads where there are quads. STL and glTF files have triangles only; OBJ, PLY, USD and
# those of VTK keep polygons.
#
# ## An OBJ file from Blender
#
# This is a house as Blender's exporter writes it: with comments, a name, a group, materials,
# texture coordinates, normals, and a loose edge. Its walls are quads, its gables pentagons, and Y
# points up.

# %%
text = """\
# Blender 4.2.0
# www.blender.org
mtllib house.mtl
o House
v 1.000000 0.000000 1.500000
v 1.000000 0.000000 -1.500000
v -1.000000 0.000000 -1.500000
v -1.000000 0.000000 1.500000
v 1.000000 1.200000 1.500000
v 1.000000 1.200000 -1.500000
v -1.000000 1.200000 -1.500000
v -1.000000 1.200000 1.500000
v 0.000000 2.000000 1.500000
v 0.000000 2.000000 -1.500000
vn -0.0000 -1.0000 -0.0000
vn 1.0000 -0.0000 -0.0000
vn -1.0000 -0.0000 -0.0000
vn 0.6247 0.7809 -0.0000
vn -0.6247 0.7809 -0.0000
vn -0.0000 -0.0000 1.0000
vn -0.0000 -0.0000 -1.0000
vt 0.000000 0.000000
vt 1.000000 0.000000
vt 1.000000 1.000000
vt 0.500000 1.500000
vt 0.000000 1.000000
s 0
usemtl Walls
f 1/1/1 4/2/1 3/3/1 2/5/1
f 1/1/2 2/2/2 6/3/2 5/5/2
f 3/1/3 4/2/3 8/3/3 7/5/3
g gables
f 4/1/6 1/2/6 5/3/6 9/4/6 8/5/6
f 2/1/7 3/2/7 7/3/7 10/4/7 6/5/7
s 1
usemtl Roof
f 5/1/4 6/2/4 10/3/4 9/5/4
f 7/1/5 8/2/5 9/3/5 10/5/5
l 9 10
"""
(here / "house.obj").write_text(text)
house = ls.read(here / "house.obj")
house

# %% [markdown]
# Points and faces are read, and the texture coordinates, as a channel. Everything else is passed
# over: names and groups, materials, smoothing groups, loose edges. So are the normals: a limit
# surface has its own.

# %%
row(ls.LimitSurface(house), up="y")

# %%
surface = ls.LimitSurface(house)
surface.evaluate(0, 0.25, 0.5, channel="uv")

# %% [markdown]
# Edges can stay sharp. An OBJ file has no place for that, but for OpenSubdiv's tags, which
# `ls.write` writes and `ls.read` reads. In Python they are an argument of the mesh: here for the
# floor, and for the ridge of the roof, a little.

# %%
floor = dict.fromkeys([(0, 1), (1, 2), (2, 3), (3, 0)], np.inf)
tags = {**floor, (8, 9): 2.0}
creased = ls.Mesh(house.points, (house.sizes, house.indices), creases=tags, channels=house.channels)
ls.write(here / "creased.obj", creased)
assert ls.read(here / "creased.obj") == creased
row(ls.LimitSurface(creased), up="y")

# %% [markdown]
# ## What is refused
#
# A broken cage is an error that says where and why. So is a broken file, which says in which line.

# %%
square = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
not_finite = [*square[:3], (0, np.nan, 0)]
broken: list[tuple[Any, Any, dict[str, Any]]] = [
    (square, [(0, 1, 2, 4)], {}),
    (square, [(0, 1, 2, 3), (0, 1)], {}),
    (not_finite, [(0, 1, 2, 3)], {}),
    (square, [(0, 1, 2, 3)], {"creases": {(0, 2): 1}}),
    (square, [(0, 1, 2, 3)], {"corners": {3: -1}}),
]
for points, faces, sharp in broken:
    try:
        ls.Mesh(points, faces, **sharp)
    except ls.MeshError as error:
        print(error)

# %%
for bad in (
    text.replace("f 1/1/2", "f 11/1/2"),
    text.replace("0.000000 2.000000 1.5", "0 2,0 1.5"),
):
    (here / "bad.obj").write_text(bad)
    try:
        ls.read(here / "bad.obj")
    except ls.MeshError as error:
        print(str(error).replace(f"{here}/", ""))

# %% [markdown]
# Much else is not broken. There may be boundaries, holes, parts that are not connected, edges with
# three faces, vertices where two fans of faces touch, faces that are turned around: each has a
# limit. Whether it is the one that was meant, a look at the mesh tells, and a picture.

# %%
flag = [*square, (0.5, 0, 1), (0.5, 1, 1), (2, 0, 0.5), (2, 1, 0.5)]
pages = ls.Mesh(flag, [(0, 1, 2, 3), (1, 2, 5, 4), (1, 6, 7, 2)])
pages

# %%
ls.plot(ls.LimitSurface(pages), view=(-0.6, -1, 0.4), window_size=(450, 380))

# %% [markdown]
# On a terminal, `limitsurf info house.obj` says the same of a file, and `limitsurf plot house.obj`
# shows it.
#
# ## Out again
#
# `ls.tessellate` cuts each limit face into n times n polygons, with points and normals of the limit
# surface. Neighbours share their points, also where a quad meets a face of five corners, so that
# the result is as closed as the cage.

# %%
fine = ls.tessellate(ls.LimitSurface(creased), 8, channels=["uv"])
fine

# %% [markdown]
# `ls.write` writes it in the format that the suffix names. STL has no place for texture
# coordinates: it would leave them out, and say so.

# %%
for suffix in (".obj", ".ply", ".glb", ".vtp"):
    ls.write(here / f"fine{suffix}", fine)
ls.write(here / "fine.stl", ls.tessellate(ls.LimitSurface(creased), 8))
for file in sorted(here.glob("fine.*")):
    print(f"{file.name} {file.stat().st_size:9,} bytes")

# %% [markdown]
# Or it goes on without a file. At creases and seams it has several points in one place, one for
# each normal; a plain cut of the house has none, and trimesh finds it closed.

# %%
smooth = ls.LimitSurface(house)
for n in (1, 4, 16):
    closed = ls.to_trimesh(ls.tessellate(smooth, n))
    assert closed.is_watertight
    print(f"n = {n:2}: {len(closed.faces):5} triangles, volume {closed.volume:.6f}")

# %%
dataset = ls.to_pyvista(ls.tessellate(smooth, 16))
print(dataset.n_cells, dataset.array_names, f"area {dataset.area:.6f}")

# %% [markdown]
# The cage itself goes the same ways.

# %%
print(ls.to_trimesh(house).faces.shape)
assert ls.from_pyvista(ls.to_pyvista(joined)).sizes.tolist() == joined.sizes.tolist()
