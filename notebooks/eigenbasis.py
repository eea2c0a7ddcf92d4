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
# # A tour of the eigenbasis
#
# Around a vertex of N faces, one step of refinement is a matrix. All that this library evaluates
# there comes from its eigenvalues and eigenvectors. `ls.eigenbasis` derives them from the masks,
# exactly, and this notebook looks at them, valence by valence. The proofs are in the derivations on
# [smooth vertices](../derivations/eigenstructure.py) and on [sectors](../derivations/sectors.py).

# %%
import matplotlib.pyplot as plt
import numpy as np
import sympy
from PIL import Image
from sympy.polys.matrices import DomainMatrix

import limitsurf as ls

# %% [markdown]
# ## A matrix and its powers
#
# A quad with a vertex of N faces at its corner depends on $K = 2 N + 8$ control points: the vertex,
# the $2 N$ points around it, and seven more. Refined, the K points around the same vertex are
# $A\,p$. Their weights are rational numbers; here are those of the vertex itself at valence 3.

# %%
basis = ls.eigenbasis("catmull-clark", valence=3)
assert basis.exact.A.shape == (14, 14)
basis.exact.A[0, :]

# %% [markdown]
# `exact` has sympy expressions and `float64` the same numbers, rounded from 96 digits. The columns
# of `V` are the eigenvectors: $A V = V J$, where $J$ is diagonal, or nearly so. `residual` is
# $A V - V J$. That it is zero is proved, not rounded.

# %%
assert basis.exact.residual.is_zero_matrix
assert np.abs(basis.float64.residual).max() < 1e-15
assert np.allclose(basis.float64.V @ basis.float64.Vinv, np.eye(14), atol=1e-14)
basis

# %% [markdown]
# This is what Stam's method rests on: $A^n = V J^n V^{-1}$. The powers of a diagonal matrix cost
# nothing, and so any point is at hand, however many refinements away.

# %%
table = basis.float64
power = table.V @ np.diag(table.eigenvalues**40) @ table.Vinv
assert np.allclose(power, np.linalg.matrix_power(table.A, 40), atol=1e-14)

# %% [markdown]
# ## Eigenvalue 1
#
# One eigenvalue is 1, and all others are smaller. So in the end only its part is left: the limit
# point. Its left eigenvector is the mask that finds it. For the vertex, an edge neighbour and an
# opposite corner the weights are proportional to $N^2 : 4 : 1$.

# %%
for valence in (3, 4, 5, 6):
    mask = ls.eigenbasis("catmull-clark", valence=valence).exact.limit_mask
    assert list(mask[:3]) == [
        x / sympy.Integer(valence * (valence + 5)) for x in (valence**2, 4, 1)
    ]
    print(valence, mask[:3])

# %% [markdown]
# ## Valence 4: the regular case
#
# With four faces the surface is a bicubic spline, and the eigenvalues are powers of 1/2. They
# belong to the monomials $u^i v^j$, which shrink by $2^{-i-j}$ when u and v are halved: one of
# degree 0, two of degree 1, three of degree 2, four of degree 3, and so on to $u^3 v^3$.

# %%
monomials = [sympy.Rational(1, 2) ** (i + j) for i in range(4) for j in range(4)]
assert sorted(monomials, reverse=True) == list(ls.eigenbasis("catmull-clark", 4).exact.eigenvalues)

# %% [markdown]
# ## Valence by valence
#
# At other valences the eigenvalues are these.

# %%
for valence in (3, 4, 5, 6, 7, 8):
    values, counts = np.unique(
        ls.eigenbasis("catmull-clark", valence=valence).float64.eigenvalues, return_counts=True
    )
    spectrum = zip(values[::-1], counts[::-1], strict=True)
    print(valence, "  ".join(f"{v:.4f}" + (f" x{c}" if c > 1 else "") for v, c in spectrum))

# %% [markdown]
# The last seven points have the eigenvalues 1/8, 1/16 and 1/32, each twice, and 1/64, at each
# valence. The others belong to waves around the vertex. A wave of $f$ periods has two eigenvalues,
# the roots of a quadratic, and they depend on $f / N$ alone: with $c = \cos(2 \pi f / N)$ and
# $s = \cos(\pi f / N)$ they are
#
# $$\frac{5 + c \pm s \sqrt{18 + 2 c}}{16}.$$
#
# Each is there twice, as a cosine and as a sine. So valence 6 has, at $f = 2$, the eigenvalues that
# valence 3 has at $f = 1$. Frequency 0 has a formula of its own.

# %%
at_three, at_six = (
    [*dict.fromkeys(ls.eigenbasis("catmull-clark", valence=valence).exact.eigenvalues)]
    for valence in (3, 6)
)
f, N = 1, 3
c, s = sympy.cos(2 * sympy.pi * f / N), sympy.cos(sympy.pi * f / N)
pair = [sympy.expand((5 + c + sign * s * sympy.sqrt(18 + 2 * c)) / 16) for sign in (1, -1)]
assert set(pair) <= {*map(sympy.expand, at_three)} & {*map(sympy.expand, at_six)}
pair

# %% [markdown]
# ## Three numbers
#
# The largest eigenvalue below 1 is that of $f = 1$, the *subdominant* one, $\lambda$. It is there
# twice: the tangent plane shrinks by it at each step. The next one is $\mu$. It belongs to $f = 0$
# at valence 3, and to $f = 2$ from 5 on: in the end the surface is bent like a saddle there. What
# one sees of a surface near the vertex follows from the two.

# %%
valences = np.arange(3, 41)
spectra = [ls.eigenbasis("catmull-clark", valence=int(N)).float64.eigenvalues for N in valences]
lam, mu = np.array([spectrum[[1, 3]] for spectrum in spectra]).T
cup = (3 * valences - 7 + np.sqrt(5 * valences**2 - 30 * valences + 49)) / (8 * valences)
assert np.isclose(mu[0], cup[0])
assert (mu[2:] > cup[2:] + 1e-3).all()

figure, panels = plt.subplots(1, 2, figsize=(11, 3.6), layout="constrained")
panels[0].plot(valences, lam, ".-", label=r"$\lambda$")
panels[0].plot(valences, mu, ".-", label=r"$\mu$")
panels[1].plot(valences, 2 * lam, ".-", label=r"$2 \lambda$, first derivatives")
panels[1].plot(valences, mu / lam**2, ".-", label=r"$\mu / \lambda^2$, curvature")
panels[1].plot(valences, mu / lam, ".-", label=r"$\mu / \lambda$, angle to the normal at the pole")
panels[1].axhline(1, color="0.7", zorder=0)
panels[0].set_title("eigenvalues")
panels[1].set_title("factors per halving of the distance")
for panel in panels:
    panel.set_xlabel("valence")
    panel.legend()
plt.show()

# %% [markdown]
# - $2 \lambda$ is the factor by which first derivatives change when the distance to the vertex is
#   halved: parameters shrink by 1/2, the surface by $\lambda$. Above 1 they grow without bound.
# - $\mu / \lambda^2$ is the factor of the curvature. It is 1 at valence 4 alone. At no other smooth
#   vertex does the curvature have a limit, but for valence 3, where the limit is 0.
# - $\mu / \lambda$ is the factor of the angle between normals and that at the vertex. It is below 1
#   at each valence, but it comes close to it.
#
# As the valence grows, $\lambda$ and $\mu$ tend to the same number.

# %%
limit = (6 + np.sqrt(20)) / 16
far = ls.eigenbasis("catmull-clark", valence=400).float64.eigenvalues
print(f"{limit:.6f}, at valence 400: {far[1]:.6f} and {far[3]:.6f}")
assert abs(far[1] - limit) < 1e-4

# %% [markdown]
# ## The characteristic map
#
# The two eigenvectors of $\lambda$, taken as coordinates in the plane, are a cage. Its limit is the
# *characteristic map*: what any surface looks like near the vertex, up to an affine map and parts
# that vanish faster. Rings around the vertex repeat, each $\lambda$ times the size of the one
# before.

# %%
ls.plot_characteristic_map(valence=5, window_size=(700, 600))

# %%
maps = [ls.plot_characteristic_map(valence=N, window_size=(420, 420)) for N in (3, 4, 8)]
Image.fromarray(np.concatenate([np.asarray(x) for x in maps], axis=1))

# %% [markdown]
# If no two places of the faces come to the same point, and its Jacobian is positive, then the
# surface has a tangent plane at the vertex (Reif 1995). `pieces` has the eigenfunctions as bicubic
# polynomials on three quarters of the face; the fourth is a copy of all, $\lambda$ times the size.
# On a grid the Jacobian is as it should be; the derivation on [scaling](../derivations/scaling.py)
# proves it for each valence.

# %%
S, T = np.meshgrid(*[np.linspace(0, 1, 41)] * 2, indexing="ij")
for valence in (3, 5, 8, 50):
    pieces = ls.eigenbasis("catmull-clark", valence=valence).float64.pieces
    x, y = pieces[..., 1:3].reshape(3, 4, 4, 2).transpose(3, 2, 1, 0)  # (4, 4, 3), powers of S, T
    of_S, of_T = (
        [
            np.polynomial.polynomial.polyval2d(S, T, np.polynomial.polynomial.polyder(c, axis=axis))
            for c in (x, y)
        ]
        for axis in (0, 1)
    )
    jacobian = of_S[0] * of_T[1] - of_S[1] * of_T[0]
    print(valence, np.abs(jacobian).min(), np.abs(jacobian).max())
    assert (jacobian > 0).all() or (jacobian < 0).all()

# %% [markdown]
# ## Eigenfunctions
#
# Each eigenvector is a cage of heights, and its limit is an eigenfunction: halving u and v
# multiplies it by its eigenvalue. The first is the constant 1. Two are the characteristic map. Then
# come saddle and cup.

# %%
ls.plot_eigenfunctions(valence=5, window_size=(1200, 700))

# %% [markdown]
# ## Valence 3, and an eigenvalue 0
#
# At valence 3 one of the eigenvalues of frequency 0 is 0. Its part is gone after one step of
# refinement: its eigenfunction is zero on the quarter of the face next to the vertex, and not zero
# on the other three. In the picture the middle is flat.

# %%
three = ls.eigenbasis("catmull-clark", valence=3)
assert three.exact.eigenvalues[-1] == 0
assert (three.exact.A * three.exact.V[:, -1]).is_zero_matrix
vanishing = three.float64.pieces[..., -1]  # (3 pieces, 16 coefficients)
assert (np.abs(vanishing).max(axis=1) > 0).all()
three.exact.V[:, -1].T

# %%
ls.plot_eigenfunctions(valence=3, which=-1, window_size=(700, 450))

# %% [markdown]
# ## Coincidences
#
# At N = 4, 8, 12, ... one of the waves has $f / N = 1/4$, as at valence 4. One of its eigenvalues
# is 1/8, which the outer points have as well. Equal eigenvalues can spoil a basis of eigenvectors.
# Here they do not: 1/8 has as many independent eigenvectors as it is times there.


# %%
def independent(basis: ls.Eigenbasis, value: sympy.Rational) -> tuple[int, int]:
    """How many times an eigenvalue is there, and its number of independent eigenvectors."""
    size = basis.float64.size
    shifted = basis.exact.A - value * sympy.eye(size)
    rank = DomainMatrix.from_Matrix(shifted).to_field().rank()
    return list(basis.exact.eigenvalues).count(value), size - rank


eighth = sympy.Rational(1, 8)
for valence in (3, 4, 5, 8, 12, 16):
    basis = ls.eigenbasis("catmull-clark", valence=valence)
    times, vectors = independent(basis, eighth)
    assert times == vectors
    print(f"valence {valence:2}: 1/8 is there {times} times, with {vectors} eigenvectors")

# %% [markdown]
# Two faces around a smooth vertex are another matter. There 1/8 has one eigenvector too few.

# %%
two = ls.eigenbasis("catmull-clark", valence=2)
times, vectors = independent(two, eighth)
assert (times, vectors) == (3, 2)
two.float64.eigenvalues

# %% [markdown]
# And the eigenvalue -1/4 is as large as the subdominant pair: a part of the surface changes its
# sign at each step, and the normals go to and fro for ever. At the vertex itself there is none.

# %%
tent = [(0, 0, 1), (1, 0, 0.5), (0, 1, 0), (-1, 0, 0), (0, -1, 0)]
pair_of_faces = ls.LimitSurface(ls.Mesh(tent, [(0, 1, 2, 3), (0, 3, 4, 1)]))
print(pair_of_faces.normal(0, 0.0, 0.0))
for n in range(50, 54):
    print(pair_of_faces.normal(0, 0.5**n, 0.7 * 0.5**n).round(6))

# %% [markdown]
# ## Creases and corners
#
# Faces between two sharp edges form a *sector*, with a matrix of its own: at a crease, or boundary,
# the vertex follows the curve; at a corner it stays. The eigenvalues inside of a crease sector of k
# faces are those of the sines at valence $2 k$: waves that are zero on the crease.

# %%
crease = ls.eigenbasis("catmull-clark", kind="crease", faces=3)
smooth = ls.eigenbasis("catmull-clark", valence=6)
print(crease.float64.eigenvalues.round(5))
for value in crease.float64.eigenvalues:
    assert np.isclose(smooth.float64.eigenvalues, value).any() or np.isclose(value, 0.5)

# %% [markdown]
# The eigenvalue 1/2 is the tangent of the curve. It may meet another 1/2 from inside, and then
# eigenvectors can run short. $J$ has a *Jordan block* instead: a 1 above the diagonal, and its
# powers have a term that grows with n.

# %%
four = ls.eigenbasis("catmull-clark", kind="crease", faces=4).exact
assert four.residual.is_zero_matrix
four.power(sympy.Symbol("n"))[:5, :5]

# %% [markdown]
# Such blocks are common. Here is where they are, for sectors of 1 to 12 faces.

# %%
for kind in ("crease", "corner"):
    for value in (0.5, 0.25):
        blocks = []
        for faces in range(1, 13):
            table = ls.eigenbasis("catmull-clark", kind=kind, faces=faces).float64
            if np.isclose(table.eigenvalues[table.chains], value).any():
                blocks.append(faces)
        print(f"{kind}: blocks of eigenvalue {value} with {blocks} faces")

# %% [markdown]
# ## Darts
#
# A dart is the end of a sharp edge amid smooth faces. Half of its modes, those that are zero on the
# edge, are the sines of a smooth vertex. The other half belongs to a polynomial whose degree grows
# with the number of faces. At three faces its roots are square roots; later, sympy keeps them as
# roots.

# %%
dart = ls.eigenbasis("catmull-clark", kind="dart", faces=3)
dart.exact.eigenvalues[:4]

# %%
for faces in (4, 5):
    print(ls.eigenbasis("catmull-clark", kind="dart", faces=faces).exact.eigenvalues[3])

# %% [markdown]
# The two eigenvalues of the tangent plane differ here. So the rings of the characteristic map
# shrink faster one way than the other. The sharp edge goes to the right.

# %%
ls.plot_characteristic_map(kind="dart", faces=5, window_size=(700, 600))

# %% [markdown]
# From six faces on two of them can be complex. Then $J$ holds a rotation.

# %%
turning = ls.eigenbasis("catmull-clark", kind="dart", faces=6).float64
first = turning.pairs[0]
assert np.isclose(np.linalg.eigvals(turning.A).imag.max(), turning.J[first, first + 1])
turning.J[first : first + 2, first : first + 2]

# %% [markdown]
# ## Where it comes from
#
# An eigenbasis knows what it was made from.

# %%
dart.provenance
