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
# # From a cage to stresses
#
# A vessel under pressure: how far does it swell, and where is it stressed most? The cage that a
# designer draws is all that the analysis needs. No mesh is generated, and the geometry stays
# exactly what it is, however fine the solution becomes. Units are mm, N and MPa.

# %%
from dataclasses import replace
from pathlib import Path

import numpy as np

import limitsurf as ls
from limitsurf.fem.supports import rigid_modes_removed

# %% [markdown]
# ## The cage
#
# A piece of pipe in the shape of a T, of seven cubes of 100 mm: their outer sides are the faces.
# Around the branch there are four vertices with five faces, and at the ends twelve with three.

# %%
cells = [(x, 0, 0) for x in (-2, -1, 0, 1, 2)] + [(0, 0, 1), (0, 0, 2)]
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
mesh = ls.Mesh(100.0 * points - 50, corners.reshape(-1, 4))
surface = ls.LimitSurface(mesh)
ls.plot(surface, cage=True, window_size=(800, 600))

# %% [markdown]
# Closed, and turned outwards: the volume inside is positive.

# %%
print(mesh, f"{ls.volume(surface) / 1e6:.3f} litres, {ls.area(surface) / 1e4:.1f} dm2", sep="\n")
assert mesh.is_closed

# %% [markdown]
# ## The space
#
# The functions of the analysis are those of the cage, refined. Each level has four times as many;
# the surface is the same at each.

# %%
space = ls.Space(surface, levels=2)
assert np.isclose(ls.area(space.surface), ls.area(surface), rtol=1e-9)
space

# %% [markdown]
# ## The shell
#
# A thin shell is a space, two moduli and a thickness: here steel of 8 mm. A pressure of 2 MPa from
# inside acts along the normals. Nothing holds the vessel, and nothing needs to: the loads balance,
# so that it is enough to take rigid motions out.


# %%
def vessel(space: ls.Space) -> ls.ThinShell:
    """Of steel."""
    return ls.ThinShell(space, young=210e3, poisson=0.3, thickness=8.0)


pressure = 2.0
shell = vessel(space)
load = shell.load(pressure=pressure)
assert np.allclose(load.sum(axis=0), 0, atol=1e-6)
found = shell.solve(load, rigid_modes_removed())
found

# %% [markdown]
# ## Displacements
#
# They are a function on the surface, to evaluate at any place. What does the pressure do? It makes
# room. So the energy that is stored must be half the pressure times what the volume has grown by.

# %%
swollen, shrunk = (ls.volume(found.deformed(scale)) for scale in (1, -1))
growth = (swollen - shrunk) / 2  # products of two displacements cancel
print(f"grown by {growth / 1e3:.3f} ml, energy {found.energy:.4f} N mm")
assert np.isclose(found.energy, pressure * growth / 2, rtol=1e-6)

# %% [markdown]
# ## Stresses
#
# They are tensors in space, at any place and height: -1 is the inner side of the shell, 1 the outer
# one. Here is one number of them, after von Mises, on the side where it is larger. Stresses come
# from second derivatives, which have no limit where five faces meet: there we look a little beside.


# %%
def mises(solution: ls.ShellSolution, face: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The stress after von Mises, the larger one of both sides of the shell."""
    u, v = np.clip(u, 0.02, 0.98), np.clip(v, 0.02, 0.98)
    sides = []
    for height in (-1.0, 1.0):
        s = solution.shell.stresses(solution.coefficients, face, u, v, height=height)
        trace = np.trace(s, axis1=-2, axis2=-1)
        sides.append(np.sqrt(1.5 * (s**2).sum(axis=(-2, -1)) - 0.5 * trace**2))
    larger: np.ndarray = np.maximum(*sides)
    return larger


# %% [markdown]
# Is the space fine enough? Coarse ones are too stiff. Ask more of them until answers settle: the
# energy, which grows with each level, and the largest stress.

# %%
energies = []
for levels in (1, 2, 3):
    finer = vessel(ls.Space(surface, levels=levels))
    found = finer.solve(finer.load(pressure=pressure), rigid_modes_removed())
    every = np.arange(len(found.shell.space.surface.limit_faces))[:, None]
    stress = mises(
        found, every, np.array([0.25, 0.75, 0.25, 0.75]), np.array([0.25, 0.25, 0.75, 0.75])
    )
    energies.append(found.energy)
    print(f"{finer.space.n:5} functions: {found.energy:7.1f} N mm, {stress.max():6.1f} MPa")

assert energies[0] < energies[1] < energies[2] < 1.01 * energies[1]

# %% [markdown]
# The last of them, moved by 500 times its displacements. The pipe bears the pressure like a ring,
# which pulls; where the branch comes off the ring is cut, and what pulled in it bends the shell
# instead.

# %%
ls.plot(
    found.deformed(500),
    scalars=lambda face, u, v: mises(found, face, u, v),
    label="stress (MPa)",
    n=4,
    cage=False,
    curves=False,
    poles=False,
    window_size=(800, 600),
)

# %% [markdown]
# ## To other programs
#
# Files of VTK hold all channels of a tessellation. ParaView shows them, and warps by displacements.

# %%
fine = ls.tessellate(found.shell.space.surface, 4)
place = fine.face, fine.u, fine.v
fields = {"displacement": found.displacement.evaluate(*place), "mises": mises(found, *place)}
fine = replace(fine, channels={name: (values, fine.indices) for name, values in fields.items()})
ls.write("vessel.vtu", fine)
fine, f"{Path('vessel.vtu').stat().st_size / 1e6:.1f} MB"
