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
# # One cage, all schemes
#
# A scheme is a rule by which a cage is refined. This notebook takes one cage, of triangles, as all
# schemes know what to do with these, and shows what each that has a name makes of it. One word is
# changed from picture to picture.

# %%
import numpy as np
from PIL import Image, ImageDraw

import limitsurf as ls

print(ls.schemes)

# %% [markdown]
# ## The cage
#
# An icosahedron with a tip that is pulled out, and points that are not quite where symmetry would
# have them. All of its vertices have valence 5.

# %%
k = np.arange(5)
angle = 2 * np.pi * k / 5
lower, upper = (
    np.stack([np.cos(angle + turn), np.sin(angle + turn), z + 0 * angle], axis=1)
    for turn, z in ((0, -0.6), (np.pi / 5, 0.4))
)
points = np.concatenate([lower, upper, [[0, 0, -1.1], [0.2, 0, 1.6]]])
points += np.random.default_rng(1).normal(scale=0.06, size=points.shape)
after = (k + 1) % 5
faces = np.concatenate(
    [
        np.stack([k, after, 5 + k], axis=1),
        np.stack([after, 5 + after, 5 + k], axis=1),
        np.stack([after, k, 10 + 0 * k], axis=1),
        np.stack([5 + k, 5 + after, 11 + 0 * k], axis=1),
    ]
)
cage = ls.Mesh(points, faces)


def surfaces(mesh: ls.Mesh) -> dict[str, ls.LimitSurface]:
    """The limit surfaces of a cage by all schemes that take it; the others say why they do not."""
    found = {}
    for name in ls.schemes.with_pieces:
        try:
            found[name] = ls.LimitSurface(mesh, scheme=name)
        except ValueError as error:
            print(error)
    return found


def gallery(every: dict[str, ls.LimitSurface]) -> Image.Image:
    """Pictures of surfaces, side by side, with their names."""
    pictures = []
    for name, surface in every.items():
        picture = Image.fromarray(np.asarray(ls.plot(surface, window_size=(300, 330))))
        ImageDraw.Draw(picture).text((12, 10), name, fill="black")
        pictures.append(np.asarray(picture))
    if len(pictures) % 3:
        pictures += [np.full_like(pictures[0], 255)] * (3 - len(pictures) % 3)
    rows = [np.concatenate(pictures[i : i + 3], axis=1) for i in range(0, len(pictures), 3)]
    return Image.fromarray(np.concatenate(rows))


shown = surfaces(cage)
gallery(shown)

# %% [markdown]
# By the scheme of Loop triangles stay triangles, whatever weights its vertices have: at valence 5
# Warren's differ from his by little. By that of Catmull and Clark each is cut into three quads
# first. The bilinear and the linear scheme cut and do not round: the surface is the cage.
#
# ## Where a vertex goes
#
# The same vertex has a limit position in each of them. It is a mean of the points around it, whose
# weights are the scheme's.

# %%
for name, surface in shown.items():
    tip = int(surface.limit_faces.first[15])  # of face 15 the tip is the last corner
    whole = surface.limit_faces.corner[tip] < 0  # or cut, into a limit face for each corner
    place = (tip, 0.0, 1.0) if whole else (tip + 2, 0.0, 0.0)
    weights = surface.weights(*place).toarray()[0]
    print(f"{name:14} the tip keeps {weights[11]:.4f}, its neighbours {weights[5]:.4f} each")
    assert np.isclose(weights.sum(), 1)
    assert np.allclose(weights @ points, surface.evaluate(*place), atol=1e-14)

# %% [markdown]
# ## How it comes there
#
# Recursive refinement ends where evaluation is at once. How fast is a matter of the scheme, and of
# its poles. The bilinear and the linear one are there from the start.

# %%
for name, surface in shown.items():
    table = ls.validate(surface, 4)
    print(f"{name:14} gap after 1, ..., 4 levels:", *(f"{x:9.1e}" for x in table["error"]))
    assert ls.agrees(surface, table)

# %% [markdown]
# ## Poles
#
# What happens at a pole is decided by the eigenvalues of one step around it. The subdominant one,
# lambda, is the size of its neighbourhood after a step, against that before: 1/2 where the scheme
# is regular. Schemes that do not round have no poles.

# %%
for name in ls.schemes.with_pieces:
    try:
        bases = [ls.eigenbasis(name, valence=n) for n in range(3, 9)]
    except ValueError as error:
        print(f"{name:14} {error}")
        continue
    values = [abs(basis.float64.eigenvalues[1]) for basis in bases]
    print(f"{name:14} lambda at 3, ..., 8 faces:", *(f"{x:.3f}" for x in values))

# %% [markdown]
# ## A crease
#
# Edges around the upper rim, of sharpness 2.5. Schemes that have no rule for sharp edges refuse
# them by name; those that do not round do not see them.

# %%
rim = {(int(5 + a), int(5 + b)): 2.5 for a, b in zip(k, after, strict=True)}
gallery(surfaces(ls.Mesh(points, faces, creases=rim)))
