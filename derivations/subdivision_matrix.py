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
"""The subdivision matrix around an interior vertex of valence N, and its Fourier blocks.

After Doo and Sabin (1978), Ball and Storry (1988) and Stam (1998).

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # The subdivision matrix around a smooth vertex
#
# One refinement step acts linearly on the points around a vertex of valence $N$. For symbolic $N$
# this document splits the matrix of the ring into its Fourier blocks, of $2 \times 2$ numbers for
# each frequency, derives their eigenvalues, and extends the matrix to the $2N + 8$ control points
# of a face. The matrices that the package builds from the masks are the same.
#
# - D. Doo, M. Sabin, "Behaviour of recursive division surfaces near extraordinary points",
#   Computer-Aided Design 10 (1978): the matrix, and the Fourier transform that splits it.
# - A. Ball, D. Storry, "Conditions for tangent plane continuity over recursively generated B-spline
#   surfaces", ACM Transactions on Graphics 7 (1988): its eigenvalues.
# - J. Stam, "Exact evaluation of Catmull-Clark subdivision surfaces at arbitrary parameter values",
#   SIGGRAPH 1998: the extension to the $2N + 8$ control points of a face.

# %%
from fractions import Fraction

from sympy import (
    Matrix,
    Rational,
    Symbol,
    cos,
    det,
    exp,
    expand,
    pi,
    simplify,
    sin,
    sqrt,
    symbols,
    together,
)

from limitsurf.exact.matrices import subdivision_matrix
from limitsurf.scheme.catmull_clark import CATMULL_CLARK
from limitsurf.scheme.sector import Sector

# %% [markdown]
# ## 1. The ring
#
# A vertex $C$ of valence $N$, all its faces quadrilaterals, has the edge neighbours
# $e_0, \dots, e_{N-1}$, counter-clockwise, and its face $j$ is $(C, e_j, f_j, e_{j+1})$. One step
# gives the same picture at half the size (the masks: [masks_bicubic](masks_bicubic.py)):
#
# $$
# \begin{split}
# f'_j &= \frac{C + e_j + f_j + e_{j+1}}{4}, \\
# e'_j &= \frac{C + e_j + f'_{j-1} + f'_j}{4}, \\
# C' &= \frac{N - 2}{N} \, C + \frac{1}{N^2} \sum_j \left( e_j + f'_j \right) .
# \end{split}
# $$
#
# The matrix of this step on $(C, e_0, f_0, e_1, f_1, \dots)$, for a number $N$:


# %%
def ring_matrix(n):
    one = [[int(i == k) for k in range(2 * n + 1)] for i in range(2 * n + 1)]
    C, e, f = Matrix([one[0]]), [Matrix([r]) for r in one[1::2]], [Matrix([r]) for r in one[2::2]]
    zero = Matrix.zeros(1, 2 * n + 1)
    new_f = [(C + e[j] + f[j] + e[(j + 1) % n]) / 4 for j in range(n)]
    new_e = [(C + e[j] + new_f[j - 1] + new_f[j]) / 4 for j in range(n)]
    new_C = Rational(n - 2, n) * C + sum(e, zero) / n**2 + sum(new_f, zero) / n**2
    return Matrix.vstack(new_C, *(row for pair in zip(new_e, new_f, strict=True) for row in pair))


ring_matrix(3)

# %% [markdown]
# ## 2. Fourier blocks, for symbolic N
#
# Turning the ring by one face changes nothing, so waves along the ring stay waves. Angles are
# measured from the diagonal of face 0: $f_j$ is at $j\theta$, $e_j$ at $(j - \frac12)\theta$. Then
# the rules are symmetric about the diagonal, and cosine and sine waves do not mix. A wave of
# frequency $f = 1, \dots, N - 1$ has $\theta = 2 \pi f / N$. If
#
# $$
# e_j = E \, \cos\left((j - \tfrac12)\theta\right), \qquad f_j = F \, \cos(j\theta),
# $$
#
# or the same with sines, then with $c = \cos(\theta)$ and $s = \cos(\theta / 2)$ a step makes of
# the amplitudes
#
# $$
# \begin{pmatrix} E' \\ F' \end{pmatrix} =
# \begin{pmatrix} \frac{3 + c}{8} & \frac{s}{8} \\ \frac{s}{2} & \frac{1}{4} \end{pmatrix}
# \begin{pmatrix} E \\ F \end{pmatrix} .
# $$

# %%
j, E, F, theta = symbols("j E F theta", real=True)
c, s = cos(theta), cos(theta / 2)
block = Matrix([[Rational(3, 8) + c / 8, s / 8], [s / 2, Rational(1, 4)]])

for wave in (cos, sin):

    def edge(k, wave=wave):
        return E * wave((k - Rational(1, 2)) * theta)

    def corner(k, wave=wave):
        return F * wave(k * theta)

    def new_corner(k):
        return (edge(k) + corner(k) + edge(k + 1)) / 4

    new_edge = (edge(j) + new_corner(j - 1) + new_corner(j)) / 4
    E_new, F_new = block * Matrix([E, F])
    for error in (
        new_edge - E_new * wave((j - Rational(1, 2)) * theta),
        new_corner(j) - F_new * wave(j * theta),
    ):
        assert expand(error.rewrite(exp), power_base=False) == 0

# %% [markdown]
# The vertex takes no part: the sum of a wave over the ring is the real part of a geometric sum of
# $q^j$ with $q^N = 1$ and $q \ne 1$, which is zero; so $C' = 0$ if $C = 0$. Frequency 0 is $C$,
# with all $e_j$ equal and all $f_j$ equal, and has a $3 \times 3$ block on $(C, E, F)$:

# %%
N = Symbol("N", positive=True)
C = Symbol("C")
f_new = (C + 2 * E + F) / 4
e_new = (C + E + 2 * f_new) / 4
c_new = (N - 2) / N * C + E / N + f_new / N
centre = Matrix([c_new, e_new, f_new]).jacobian([C, E, F])
assert simplify(
    centre
    - Matrix(
        [
            [1 - 7 / (4 * N), 3 / (2 * N), 1 / (4 * N)],
            [Rational(3, 8), Rational(1, 2), Rational(1, 8)],
            [Rational(1, 4), Rational(1, 2), Rational(1, 4)],
        ]
    )
) == Matrix.zeros(3, 3)
centre.applyfunc(expand)

# %% [markdown]
# Nothing is lost: $f = 0$ has 3 dimensions; $f$ and $N - f$ give the same cosine and sine waves, so
# each $f$ with $0 < f < N/2$ has $2 + 2$ of them; and at $f = N/2$, where $s = 0$, only the sine
# lives on the $e_j$ and only the cosine on the $f_j$ (the other two vanish). In all
# $3 + 2(N - 1) = 2N + 1$.

# %%
for k in range(4):
    assert sin(k * pi) == 0
    assert cos((k - Rational(1, 2)) * pi) == 0

# %% [markdown]
# ## 3. Eigenvalues
#
# The block of a wave has trace $(5 + c)/8$ and determinant $1/16$, so that, with $c = 2 s^2 - 1$,
#
# $$
# \lambda = \frac{5 + c \pm s \sqrt{18 + 2c}}{16},
# $$
#
# and that of frequency 0 has the eigenvalue 1 and
#
# $$
# \lambda = \frac{3N - 7 \pm \sqrt{49 - 30N + 5N^2}}{8N} .
# $$

# %%
assert simplify(block.trace() - (5 + c) / 8) == 0
assert simplify(block.det() - Rational(1, 16)) == 0

lam, sigma = symbols("lambda sigma")
c_of = 2 * sigma**2 - 1
for sign in (1, -1):
    root = (5 + c_of + sign * sigma * sqrt(18 + 2 * c_of)) / 16
    assert expand(root**2 - (5 + c_of) / 8 * root + Rational(1, 16)) == 0

characteristic = together((centre - lam * Matrix.eye(3)).det())
for sign in (1, -1):
    root = (3 * N - 7 + sign * sqrt(49 - 30 * N + 5 * N**2)) / (8 * N)
    assert simplify(characteristic.subs(lam, root)) == 0
assert simplify(characteristic.subs(lam, 1)) == 0

# %% [markdown]
# The blocks against the matrix itself: both characteristic polynomials at $\lambda = 1/7$ and
# $2/3$, to 60 digits, for $N = 2, \dots, 9$.

# %%
for n in range(2, 10):
    for value in (Rational(1, 7), Rational(2, 3)):
        blocks = characteristic.subs({N: n, lam: value})
        for f in range(1, n):
            blocks *= value**2 - (5 + cos(2 * pi * f / n)) / 8 * value + Rational(1, 16)
        whole = det(ring_matrix(n) - value * Matrix.eye(2 * n + 1))
        assert abs((whole - blocks).evalf(60)) < Rational(1, 10**50)

# %% [markdown]
# ## 4. The points of a face
#
# The limit on face 0 (Stam's figure, a quad with one extraordinary corner) hangs on the ring and on
# seven more points, in all $2N + 8$. On the grid of the face, $(1, 1)$ being the vertex $C$ and
# $(2, 2)$ being $f_0$:
#
# ```text
# j=3   (0,3)---(1,3)---(2,3)---(3,3)
#         |       |       |       |
# j=2    f_1 ---- e_1 --- f_0 --(3,2)
#         |       |  face |       |
# j=1    e_2 ----- C ---- e_0 --(3,1)
#         :       |       |       |
#         :    e_{N-1}-f_{N-1}--(3,0)
# ```

# %%
OUTER = [(3, 0), (3, 1), (3, 2), (3, 3), (2, 3), (1, 3), (0, 3)]

# %% [markdown]
# The refined grid has $(1, 1)$ at $C$ again, and half the spacing: its odd lines are old lines, its
# even lines lie between. All outer points, and the nine beyond them that the three regular quarters
# of the face ask for, are made around vertices of valence 4. So they come from knot insertion
# ([masks_bicubic](masks_bicubic.py), section 1), a product of the weights of old lines in new ones,
# and the one grid point that exists only at $N = 4$, $(0, 0)$, takes no part.

# %%
LINES = {  # new line: weights of old lines
    0: {0: Rational(1, 2), 1: Rational(1, 2)},
    1: {0: Rational(1, 8), 1: Rational(3, 4), 2: Rational(1, 8)},
    2: {1: Rational(1, 2), 2: Rational(1, 2)},
    3: {1: Rational(1, 8), 2: Rational(3, 4), 3: Rational(1, 8)},
    4: {2: Rational(1, 2), 3: Rational(1, 2)},
}
BEYOND = [(4, 0), (4, 1), (4, 2), (4, 3), (4, 4), (3, 4), (2, 4), (1, 4), (0, 4)]


def grid_row(i, j):
    return {(a, b): p * q for a, p in LINES[i].items() for b, q in LINES[j].items()}


for place in OUTER + BEYOND:
    assert (0, 0) not in grid_row(*place)

# %% [markdown]
# The outer block, how the seven points refine among themselves, does not know $N$. Its eigenvalues
# are products of eigenvalues $2^{-k}$ of knot insertion, and it has as many eigenvectors.

# %%
outer_block = Matrix(7, 7, lambda i, k: grid_row(*OUTER[i]).get(OUTER[k], 0))
assert outer_block.eigenvals() == {
    Rational(1, 8): 2,
    Rational(1, 16): 2,
    Rational(1, 32): 2,
    Rational(1, 64): 1,
}
assert outer_block.is_diagonalizable()
outer_block

# %% [markdown]
# The whole matrix, ring first, is block triangular,
#
# $$
# \begin{pmatrix} A_r & 0 \\ A_{or} & A_o \end{pmatrix},
# $$
#
# with the ring $A_r$, the outer block $A_o$, and $A_{or}$, how the outer points hang on the ring.
# So its spectrum is that of the ring and these seven.
#
# ## 5. The matrices of the package


# %%
def extended_matrix(n):
    at = {(1, 1): 0, (2, 1): 1, (2, 2): 2, (1, 2): 3, (0, 2): 4}
    at |= {(0, 1): 1 + 4 % (2 * n), (1, 0): 2 * n - 1, (2, 0): 2 * n}
    at |= {place: 2 * n + 1 + k for k, place in enumerate(OUTER)}
    rows = Matrix.zeros(2 * n + 17, 2 * n + 8)
    rows[: 2 * n + 1, : 2 * n + 1] = ring_matrix(n)
    for k, place in enumerate(OUTER + BEYOND):
        for old, weight in grid_row(*place).items():
            rows[2 * n + 1 + k, at[old]] += weight
    return rows


for n in (2, 3, 4, 5, 6, 7, 8, 12, 33):
    built = subdivision_matrix(CATMULL_CLARK, Sector("interior", n)).rows
    derived = [
        {k: Fraction(int(w.p), int(w.q)) for k, w in enumerate(row) if w}
        for row in extended_matrix(n).tolist()
    ]
    assert list(map(dict, built)) == derived
