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

# %% tags=["remove-cell"]
"""Spectra and characteristic maps of schemes without polynomial pieces.

Of Dyn, Levin and Gregory (1990), Zorin, Schroeder and Sweldens (1996), Kobbelt (2000).

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # What is decided of schemes that have no polynomials
#
# Around a vertex a step keeps waves, so that spectra, with all Jordan chains, are those of small
# matrices. The characteristic map has no Bernstein coefficients, but bounds: on a triangle amid
# regular vertices its derivatives are known up to what the points around are off a plane, or off a
# quadratic. That vanishes as triangles are cut; so the sign of the Jacobian, and how often the map
# goes around, are decided, and with them where surfaces are $C^1$.
#
# - U. Reif, "A unified approach to subdivision algorithms near extraordinary vertices", Computer
#   Aided Geometric Design 12 (1995): $C^1$ by a map that is regular and injective.
# - J. Peters, U. Reif, "Subdivision Surfaces", Springer 2008, chapters 4 and 5.

# %%
from fractions import Fraction

import numpy as np

import limitsurf as ls
from limitsurf import numbers, schemes
from limitsurf.exact.waves import wave_spectrum
from limitsurf.options import Rules
from limitsurf.refine.local_steps import local_steps
from limitsurf.spectra.stepwise import BUTTERFLY, characteristic_map

# %% [markdown]
# ## 1. Waves
#
# Vertices $(r, s, t)$: in ring $r$, sector $s$, and the $t$-th from its first spoke on, at the
# angle $s + t/r$ in sectors. A step makes new ones by the same rule in each sector. If old ones are
# $z_{rt} \, \omega^{s + t/r}$, with $\omega = e^{2 \pi \mathrm i f / N}$, new ones are $z'_{rt} \,
# \omega^{\sigma + s + t/r}$, where $\sigma$ is the angle between the new first spoke and the old
# one: 0, or $\frac12$ where the step turns edges. So $z' = M_f z$, and all eigenvalues are those of
# $M_0, \ldots, M_{N-1}$, of which $M_{N-f}$ is the conjugate of $M_f$. Three rings are made of
# three; and of the largest eigenvalues the matrices that evaluate, of what surrounds one face, have
# the same.


# %%
def of_a_face(name: str, N: int) -> np.ndarray:
    """Moduli of the eigenvalues at a corner of valence N, by the matrix of one face."""
    from limitsurf.spectra.stepwise import pieces_of

    pieces = pieces_of(schemes[name], N)
    _, own, _ = pieces.map(pieces.kind, 0)
    return np.sort(np.abs(np.linalg.eigvals(own)))[::-1]


for name, power in (("butterfly", 1), ("modified-butterfly", 1), ("sqrt3", 2)):
    for N in (3, 4, 5, 6, 7, 9, 12):
        waves = [
            abs(complex(wave.value)) ** power
            for wave in wave_spectrum(schemes[name], N).waves[1:]
            for _ in range(sum(wave.jordan) * (1 if 2 * wave.frequency in (0, N) else 2))
        ]
        found = of_a_face(name, N)
        count = sum(x > 0.07 for x in found)
        # chains of three are found to a third of the digits
        assert np.abs(np.sort(waves)[::-1][:count] - found[:count]).max() < 2e-4, (name, N)

# %% [markdown]
# The regular butterfly matrix has $\frac14$ seven times, in blocks of 3, 2 and 2: one of three from
# what is constant around, two of two from $f = \pm 2$. At vertices with masks of their own there is
# no chain at $\frac14$. But each new vertex amid others is regular: curvature is unbounded, like
# $\log$ or more, next to each of them, whatever the matrix of an old vertex has.

# %%
regular = wave_spectrum(schemes["butterfly"], 6).waves
quarter = [wave for wave in regular if abs(wave.value - 0.25) < 1e-60]
assert [(wave.frequency, wave.jordan) for wave in quarter] == [(0, (3,)), (2, (2,))]
for N in (3, 4, 5, 7, 8, 12):
    quarter = [
        w
        for w in wave_spectrum(schemes["modified-butterfly"], N).waves
        if abs(w.value - 0.25) < 1e-60
    ]
    assert quarter
    assert all(w.jordan == (1,) for w in quarter)

# %% [markdown]
# ## 2. Bounds of derivatives, of butterfly schemes
#
# On a triangle amid regular vertices let $s$ be its sides, along u and along v, and $r$ what the 24
# other points are off its plane; a step to a child, doubled, is $s' = \pm s + Q_c r$, $r' = B_c r$
# ([butterfly](butterfly.py), section 3). A derivative anywhere is $s + \ell r$ with
#
# $$\ell = \sum_n \pm Q B \cdots B, \qquad \ell = Q_w \pm \ell' B_w$$
#
# after words $w$ of eight steps. So if
#
# $$g \ge \lvert Q_w \rvert + g\,\lvert B_w \rvert$$
#
# for all 65,536 words, entry by entry, then $\lvert \ell \rvert \le g$: that holds for the sum of
# the first $8 n$ steps by induction on $n$, and they converge. All entries are multiples of a power
# of two that floating-point numbers hold exactly.

# %%
steps = local_steps(
    Rules(schemes["butterfly"], "edge_and_corner", "uniform", "catmull-clark"), numbers.FLOAT64
)
children = [steps.step(0, c)[1] for c in range(4)]
assert all((m * 16 == np.rint(m * 16)).all() for m in children)
Q, B = (np.array([m[rows, 2:] for m in children]) for rows in (slice(2), slice(2, None)))
sign = np.array([1.0, 1, 1, -1])
g = BUTTERFLY / 100


def longer(words: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    """Signs, Q and B of words with one more step."""
    signs, along, rest = words
    new = np.einsum("cij,wjk->wcik", Q, rest) * (signs[:, None] * sign)[:, :, None, None]
    rest = np.einsum("cij,wjk->wcik", B, rest)
    along = along[:, None] + new
    return (signs[:, None] * sign).ravel(), along.reshape(-1, 2, 24), rest.reshape(-1, 24, 24)


words = np.ones(1), np.zeros((1, 2, 24)), np.eye(24)[None]
for _ in range(4):
    words = longer(words)
for k in range(len(words[0])):
    some = tuple(x[k : k + 1] for x in words)
    for _ in range(4):
        some = longer(some)
    _, along, rest = some
    bound = np.abs(along) + np.einsum("ai,wij->waj", g, np.abs(rest))
    assert (bound < g - 1e-9).all()

# %% [markdown]
# Of $\sqrt 3$ the same is in [sqrt3](sqrt3.py), section 6: derivatives are those of a quadratic, up
# to 3.6 times what the 27 points are off one.
#
# ## 3. Whether maps are regular, and how often they go around
#
# The points of the map are the waves that lead. A triangle at the vertex is a copy of the whole, so
# the others of a face are looked at, of one face, as the faces are alike. Those that are not amid
# regular vertices yet are cut. Of each other one both derivatives are in boxes: where the product
# of intervals has one sign the Jacobian has it; else it is cut. If two signs are met the map is not
# regular.
#
# The image of a triangle is in the box of a corner and of what derivatives add. Along the far side
# of a face such boxes are in circles that do not contain 0, and two that meet are in a half plane:
# their directions turn by less than half a turn from each to the next, and all these turns add up
# to the angle of the face. That is $2 \pi f / N$ and whole turns, so it is known exactly.
# Where pairs of a higher frequency lead, the map is regular, and goes around more than once: at
# butterfly vertices of 8 faces and more.

# %%
for name in ("butterfly", "modified-butterfly", "sqrt3"):
    for N in (3, 4, 5, 6, 7, 8, 9, 12, 16):
        if (name, N) != ("butterfly", 3):
            f = wave_spectrum(schemes[name], N).waves[1].frequency
            assert characteristic_map(schemes[name], N, f) == (True, f)
            assert f == 1 or (name == "butterfly" and N >= 8)
    assert name == "butterfly" or characteristic_map(schemes[name], 50, 1) == (True, 1)

# %% [markdown]
# So the verdicts: modified butterfly surfaces and those of $\sqrt 3$ are $C^1$ at each valence from
# 3 on that was tried, others of butterfly at 4 to 7. Curvature of $\sqrt 3$ is bounded at
# $N = 4, 5, 6$; at 3 outer points have the largest eigenvalue, and from 7 on frequency 2 does.

# %%
for N in (3, 4, 5, 6, 7, 8, 9, 12, 16):
    assert ls.spectral_analysis("modified-butterfly", N).c1
    assert ls.spectral_analysis("butterfly", N).c1 == (4 <= N <= 7)
    found = ls.spectral_analysis("sqrt3", N)
    assert found.c1
    assert found.curvature is not None
    assert (found.curvature.behaviour == "bounded") == (N in (4, 5, 6))
    lead = [mode for mode in found.curvature.by_frequency if mode.leads]
    assert N > 3 or lead[0].outer
    assert N < 7 or [mode.frequency for mode in lead] == [2]

# %% [markdown]
# ## 4. How far a vertex has influence
#
# A step of butterfly reaches $\frac32$ edges, to the middles whose wing the vertex is; what is
# there then reaches half as far. Two steps of $\sqrt 3$ reach $\frac53$, and a third of it each
# further two.

# %%
assert sum(Fraction(3, 2) / 2**k for k in range(60)) > 3 - Fraction(1, 2**50)
assert sum(Fraction(5, 3) / 3**k for k in range(60)) > Fraction(5, 2) - Fraction(1, 2**50)
size = 9
lattice = np.array([[x, y, 0.0] for x in range(size) for y in range(size)])
corner = np.array([size * x + y for x in range(size - 1) for y in range(size - 1)])
up = np.stack([corner, corner + size, corner + 1], axis=1)
down = np.stack([corner + size + 1, corner + 1, corner + size], axis=1)
lattice[40, 2] = 1
mesh = ls.Mesh(lattice, np.concatenate([up, down]))
for name, levels, reach in (
    ("butterfly", 1, 3 / 2),
    ("butterfly", 2, 9 / 4),
    ("sqrt3", 2, 5 / 3),
    ("sqrt3", 4, 20 / 9),
):
    fine = ls.refined(mesh, levels, scheme=name)
    there = np.flatnonzero(fine.points[:, 2])
    u, v = fine.parent_u[there], fine.parent_v[there]
    faces = mesh.indices.reshape(-1, 3)[fine.parent_face[there]]
    a, b, c = lattice[faces, :2].transpose(1, 0, 2)
    x, y = (a + (b - a) * u[:, None] + (c - a) * v[:, None] - 4).T
    assert abs(np.max([np.abs(x), np.abs(y), np.abs(x + y)]) - reach) < 1e-12
