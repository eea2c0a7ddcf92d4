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
"""Interpolation: where limits depend on each other, and how the fairest cage is found.

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Interpolation
#
# The limits at the vertices of a cage are $A\,x$, with a sparse matrix $A$ of masks. This document
# derives
#
# 1. where $A$ is singular, exactly;
# 2. its smallest singular value on some cages;
# 3. why one refinement always helps;
# 4. how the fairest cage is found without pivoting;
# 5. how ranks are counted.
#
# - M. Halstead, M. Kass and T. DeRose, "Efficient, fair interpolation using Catmull-Clark
#   surfaces", SIGGRAPH 1993.
# - R. J. Vanderbei, "Symmetric quasidefinite matrices", SIAM J. Optim. 5, 1995.

# %%
from fractions import Fraction

import numpy as np
from scipy.sparse import csr_array, eye_array
from sympy import Matrix, Rational, cos, pi, simplify

import limitsurf as ls
from limitsurf.cad import solving


def limits(faces, n):
    """The matrix of limits at vertices, exact: limits of the unit vectors."""
    unit = np.array([[Fraction(i == j) for j in range(n)] for i in range(n)], dtype=object)
    return ls.refined(ls.Mesh(unit, faces), 0).limit_points


def prism(k):
    """Faces of a prism of k sides; vertices of the floor first."""
    sides = [[i, (i + 1) % k, k + (i + 1) % k, k + i] for i in range(k)]
    return [list(range(k))[::-1], list(range(k, 2 * k)), *sides]


# %% [markdown]
# ## 1. Where limits depend on each other
#
# By Catmull and Clark's masks the limit of a vertex of valence $N$ is
#
# $$
# \frac{N}{N + 5} v + \frac{4}{N (N + 5)} \sum_j e_j + \frac{1}{N (N + 5)} \sum_j f_j
# $$
#
# with the neighbours $e_j$ and the opposite corners $f_j$, if its faces are quads. Let a cage have
# the values 1 and -1 by turns. After one step all face points are 0, if all faces have even numbers
# of corners; so are all edge points, between ends of different signs; and the vertex point is
# $\frac{N - 3}{N} v$, which is 0 at valence 3. So the limit is 0 everywhere on cubes, and on prisms
# of even numbers of sides. There is one such function for each part of a cage.

# %%
for k in (4, 6, 8, 12):
    A = limits(prism(k), 2 * k)
    signs = [(-1) ** (i + j) for j in (0, 1) for i in range(k)]
    assert not any((A @ np.array(signs, dtype=object)).tolist())
    if k < 8:
        exact = Matrix(
            2 * k, 2 * k, lambda i, j, A=A: Rational(A[i, j].numerator, A[i, j].denominator)
        )
        assert exact.rank() == 2 * k - 1
for k in (3, 5):  # of odd ones they do not
    A = limits(prism(k), 2 * k)
    exact = Matrix(2 * k, 2 * k, lambda i, j, A=A: Rational(A[i, j].numerator, A[i, j].denominator))
    assert exact.rank() == 2 * k

# %% [markdown]
# A point of the limit at vertex $i$, then, has $\sum_i \pm x_i = 0$, which general points have not;
# and where they have, as the corners of the cube, cages are many.
#
# ## 2. Singular values
#
# On a torus of $m$ times $n$ quads $A$ is a product of two circulant matrices, of the mask
# $\frac16, \frac46, \frac16$ each: its eigenvalues are products of
# $\frac{2 + \cos 2 \pi k / m}{3}$, and the smallest is $\frac19$ where $m$ and $n$ are even. On the
# tetrahedron and the octahedron it is $\frac29$.

# %%
m, n = 4, 6
torus = [
    [i * n + j, (i + 1) % m * n + j, (i + 1) % m * n + (j + 1) % n, i * n + (j + 1) % n]
    for i in range(m)
    for j in range(n)
]
A = limits(torus, m * n).astype(float)
line = [[(2 + cos(2 * pi * k / size)) / 3 for k in range(size)] for size in (m, n)]
assert simplify(min(line[0]) * min(line[1]) - Rational(1, 9)) == 0
expected = np.sort([float(a * b) for a in line[0] for b in line[1]])
assert np.abs(np.linalg.svd(A, compute_uv=False)[::-1] - expected).max() < 1e-14

tetrahedron = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]
octahedron = [
    [0, 2, 4],
    [2, 1, 4],
    [1, 3, 4],
    [3, 0, 4],
    [2, 0, 5],
    [1, 2, 5],
    [3, 1, 5],
    [0, 3, 5],
]
for faces, size in ((tetrahedron, 4), (octahedron, 6)):
    A = limits(faces, size)
    exact = Matrix(size, size, lambda i, j, A=A: Rational(A[i, j].numerator, A[i, j].denominator))
    assert exact == exact.T
    assert min(abs(value) for value in exact.eigenvals()) == Rational(2, 9)

# %% [markdown]
# ## 3. After one refinement
#
# Neighbours of a vertex of the cage are then points of edges and of faces, and no longer other
# vertices of the cage: among their own columns, rows of limits at these are diagonal, with the
# masks' own weights, such as $\frac{N}{N + 5}$, which are positive. So the rows are independent,
# whatever the cage is, and the smallest singular value is no less than the smallest of these
# weights.

# %%
for k in (3, 4, 7):
    fine = ls.refined(ls.Mesh(np.zeros((2 * k, 1)), prism(k)), 1)
    own = limits(fine.faces, fine.n_vertices)[: 2 * k, : 2 * k]
    assert (own == np.diag([Fraction(3, 8)] * (2 * k))).all()

# %% [markdown]
# ## 4. The fairest cage
#
# With the energy $\frac12 x^T K x - b^T x$, of $K$ positive definite, and conditions $C x = p$, the
# least is where
#
# $$
# \begin{pmatrix} K & C^T \\ C & -d \end{pmatrix}
# \begin{pmatrix} x \\ y \end{pmatrix} = \begin{pmatrix} b \\ p \end{pmatrix}
# $$
#
# with $d = 0$. With $d > 0$ the matrix is quasi-definite: in every order of elimination pivots are
# not 0, and an order that keeps factors sparse will do. Its solution for what is left, added to
# what there is, leaves $\frac{d}{d + s}$ times as much of conditions, where $s$ is an eigenvalue of
# $C K^{-1} C^T$: with $d = 10^{-9}$ two or three times are enough.
#
# Energies leave constants free, and what [vanishes](fairness.py#5-what-has-no-energy): springs of
# $10^{-11}$ of the mean of the diagonal hold vertices to where they were.

# %%
rng = np.random.default_rng(0)
B, C = rng.normal(size=(12, 12)), rng.normal(size=(5, 12))
K, b, p = B @ B.T + np.eye(12), rng.normal(size=12), rng.normal(size=5)
d, left, x, y = 1e-3, [], np.zeros(12), np.zeros(5)
whole = np.block([[K, C.T], [C, -d * np.eye(5)]])
for _ in range(3):
    step = np.linalg.solve(whole, np.concatenate([b - K @ x - C.T @ y, p - C @ x]))
    x, y = x + step[:12], y + step[12:]
    left.append(p - C @ x)
s, modes = np.linalg.eigh(C @ np.linalg.solve(K, C.T))
assert np.allclose(modes.T @ left[2], d / (d + s) * (modes.T @ left[1]), rtol=1e-6, atol=1e-15)
exact = np.linalg.solve(np.block([[K, C.T], [C, np.zeros((5, 5))]]), np.concatenate([b, p]))[:12]
found = solving.minimum(csr_array(K), b[:, None], csr_array(C), p[:, None])[:, 0]
assert np.abs(found - exact).max() < 1e-12

# %% [markdown]
# ## 5. Ranks
#
# By Sylvester's law of inertia, elimination without pivoting has as many negative pivots as the
# matrix has negative eigenvalues. Of
#
# $$
# \begin{pmatrix} 1 & C^T \\ C & t \end{pmatrix}
# $$
#
# what elimination of the first block leaves is $t - C C^T$: it has as many as $C$ has singular
# values above $\sqrt t$.

# %%
faces = prism(40)
A = csr_array(limits(faces, 80).astype(float))
t = 1e-12
pivots = np.linalg.eigvalsh(np.block([[np.eye(80), A.toarray().T], [A.toarray(), t * np.eye(80)]]))
assert (pivots < 0).sum() == 79 == solving.rank(A)
assert solving.rank(csr_array(A + 0.1 * eye_array(80))) == 80
assert solving.condition(A) > solving.SINGULAR
