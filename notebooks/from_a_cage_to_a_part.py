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
# # A part, from a cage to a STEP file and a report
#
# A lever with a bore: modelled as a cage, handed to CAD as a solid of B-spline faces. How far is
# the file from the surface that was meant? The report at the end says it, of all faces and all
# edges. This takes `pip install "limitsurf[cad,plot]"`. Units are mm.

# %%
import warnings
from itertools import pairwise
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.BRepGProp import BRepGProp
from OCP.GProp import GProp_GProps

import limitsurf as ls

# %% [markdown]
# ## The cage
#
# Cubes of 10 mm, whose outer sides are the faces: a ring of eight with an arm of three, and a knob
# at its end. The edges around the bore are sharp; all others become round.

# %%
ring = [(x, y, 0) for x in range(3) for y in range(3) if (x, y) != (1, 1)]
cells = [*ring, (3, 1, 0), (4, 1, 0), (5, 1, 0), (5, 1, 1)]
axes = np.eye(3, dtype=int)
quads = []
for cell in cells:
    for k in range(3):
        i, j = axes[(k + 1) % 3], axes[(k + 2) % 3]
        above, below = cell + axes[k], cell - axes[k]
        if tuple(above) not in cells:
            quads.append([above, above + i, above + i + j, above + j])
        if tuple(below) not in cells:
            quads.append([cell, cell + j, cell + i + j, cell + i])

points, corners = np.unique(np.reshape(quads, (-1, 3)), axis=0, return_inverse=True)
number = {tuple(point): k for k, point in enumerate(points.tolist())}
around = [(1, 1), (2, 1), (2, 2), (1, 2), (1, 1)]
creases = {(number[*a, z], number[*b, z]): np.inf for z in (0, 1) for a, b in pairwise(around)}
mesh = ls.Mesh(10.0 * points, corners.reshape(-1, 4), creases=creases)
surface = ls.LimitSurface(mesh)
assert mesh.is_closed
ls.plot(surface, view=(-1, -2, 1.6), window_size=(1000, 640))

# %% [markdown]
# ## Faces for CAD
#
# A limit face is a B-spline face with knots that come closer towards each pole. It is the limit
# itself, but for one small cell at the pole; the tolerance says how far it may be there, and it is
# proved. Where all is regular, limit faces are merged into larger ones, here but a few.
#
# `poles="g1"` makes faces around smooth poles share their tangent planes. A warning counts those
# that cannot: here the corners of the sharp edges, four on either side of the lever.

# %%
faces = ls.bspline_faces(surface, tolerance=1e-3, poles="g1")
warnings.filterwarnings("ignore", "8 poles of 28 cannot share tangent planes")  # said once
merged = len(faces.counts)
print(f"{mesh.n_faces} faces of the cage, {merged} for CAD, {faces.exact.sum()} of them exact")
assert merged < mesh.n_faces
assert faces.deviation.max() <= 1e-3

# %% [markdown]
# The numbers of control points say where the poles are: a face with none has a few, one with four
# poles hundreds.

# %%
size = np.empty(mesh.n_faces)
size[faces.limit_faces] = np.repeat(faces.counts.prod(axis=1), faces.grid.prod(axis=1))
ls.plot(
    surface,
    scalars=lambda face, u, v: size[face],
    cmap="viridis",
    label="control points",
    cage=False,
    curves=True,
    view=(-1, -2, 1.6),
    window_size=(1000, 640),
)

# %% [markdown]
# ## The solid, and the file
#
# Faces that meet share their edges and vertices, as the cage says; nothing is sewn. OpenCASCADE can
# say whether it takes this for a valid solid, and how large it is. `ls.volume` integrates the limit
# surface and knows nothing of splines.

# %%
solid = ls.to_brep(faces, solid=True)
assert BRepCheck_Analyzer(solid).IsValid()
properties = GProp_GProps()
BRepGProp.VolumeProperties_s(solid, properties, 1e-9)
volumes = float(ls.volume(surface)), properties.Mass()
print("volume, of the limit and by OpenCASCADE: {:.4f}, {:.4f} mm3".format(*volumes))
assert np.isclose(volumes[0], volumes[1], rtol=1e-6)

# %% [markdown]
# With `check=True` the file is read again before it appears, and is an error if it is not valid.

# %%
ls.write("lever.step", surface, tolerance=1e-3, poles="g1", check=True)
print(f"{Path('lever.step').stat().st_size / 1e3:.0f} kB")

# %% [markdown]
# ## Back again
#
# What does somebody get who opens the file? `ls.read_brep` reads its faces, `ls.compare` measures
# the distances between them and the limit surface, both ways, at many places of each face.

# %%
back = ls.read_brep("lever.step")
found = ls.compare(surface, back)
print(back, found, f"names: {', '.join(back.names[:3])}, ...", sep="\n")
assert len(back.names) == merged
assert found.largest <= 1e-3

# %% [markdown]
# ## The report
#
# Distances and angles to the limit surface, and what is between neighbours: gaps and jumps of the
# normal along *all* edges between limit faces. Bounds are proved, not sampled. At sharp edges the
# surface itself has two normals: there is no jump to speak of.

# %%
tolerances = [1e-1, 1e-2, 1e-3]
tried = {
    poles: [ls.bspline_faces(surface, tolerance=t, poles=poles) for t in tolerances]
    for poles in ("g0", "g1")
}
reports = {poles: [ls.deviation(surface, x) for x in made] for poles, made in tried.items()}
rows = [
    ("from the limit, parametric (mm)", "parametric", 1.0),
    ("from the limit, along the normal (mm)", "along_normal", 1.0),
    ("angle to its normal (degrees)", "angle", 180 / np.pi),
    ("gaps along edges (mm)", "gap", 1.0),
    ("angles across smooth edges (degrees)", "edge_angle", 180 / np.pi),
]
print(f"{'at most, with poles=':40} {'g0':>9} {'g1':>9}")
for title, name, unit in rows:
    g0, g1 = (unit * np.nanmax(getattr(report[-1], name)) for report in reports.values())
    print(f"{title:40} {g0:9.1e} {g1:9.1e}")

assert all(report[-1].gap.max() < 1e-12 for report in reports.values())

# %% [markdown]
# What does a smaller tolerance cost? Some knots at each pole. Without `poles="g1"` angles across
# edges fall with it, but stay visible in reflections; with it they are small from the beginning.

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.8), layout="constrained")
for (poles, made), marker in zip(tried.items(), "os", strict=True):
    angles = [np.rad2deg(np.nanmax(report.edge_angle)) for report in reports[poles]]
    left.loglog(tolerances, [len(x.points) for x in made], marker=marker, label=poles)
    right.loglog(tolerances, angles, marker=marker, label=poles)
for axis, label in ((left, "control points"), (right, "angles across edges, at most (degrees)")):
    axis.set_xlabel("tolerance (mm)")
    axis.set_ylabel(label)
    axis.set_xticks(tolerances)
    axis.invert_xaxis()
    axis.grid(alpha=0.3)
    axis.legend(title="poles", frameon=False)
plt.show()
