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
"""Loop's matrix around a vertex of any valence: eigenvalues, masks, one Jordan block, curvature.

After Loop (1987), Stam (1999) and Warren and Weimer (2001).

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Loop's scheme around an extraordinary vertex
#
# For symbolic valence $N$: the matrix of one refinement on the ring, its eigenvalues and the limit
# masks; its extension to the $N + 6$ control points of a face; where ring and outer points share an
# eigenvalue, and the only place where that makes a Jordan block; what follows for derivatives and
# curvature.
#
# - C. Loop, "Smooth subdivision surfaces based on triangles", thesis, University of Utah 1987.
# - J. Stam, "Evaluation of Loop subdivision surfaces", SIGGRAPH course notes 1999: the control
#   points of a face, and the outer block.
# - J. Warren, H. Weimer, "Subdivision methods for geometric design", Morgan Kaufmann 2001: other
#   weights.

# %%

from sympy import (
    QQ,
    Matrix,
    Rational,
    Symbol,
    cos,
    diff,
    expand,
    factor,
    pi,
    simplify,
    symbols,
)
from sympy.polys.matrices import DomainMatrix

EIGHTH, SIXTEENTH = Rational(1, 8), Rational(1, 16)

# %% [markdown]
# ## 1. The ring
#
# A vertex $v$ with neighbours $e_0, \dots, e_{N-1}$ moves with weight $\beta$ for each neighbour,
# and the new neighbours are edge points:
#
# $$
# v' = (1 - N \beta) \, v + \beta \sum_j e_j, \qquad
# e_j' = \frac38 (v + e_j) + \frac18 (e_{j-1} + e_{j+1}) .
# $$
#
# On a wave $e_j = \omega^j$ with $\omega^N = 1$, $\omega \ne 1$ and $v = 0$ both rules multiply by
# one number: $v'$ stays zero, and $e_j$ is multiplied by
#
# $$
# \frac38 + \frac{\omega + \omega^{-1}}{8} = \frac38 + \frac14 \cos \frac{2 \pi f}{N},
# \qquad f = 1, \dots, N - 1 .
# $$

# %%
omega = Symbol("omega")
for j in range(5):
    new_edge = Rational(3, 8) * omega**j + (omega ** (j - 1) + omega ** (j + 1)) / 8
    assert expand(new_edge - omega**j * (Rational(3, 8) + (omega + 1 / omega) / 8)) == 0

# %% [markdown]
# On constants, $e_j = e$, there is a block of $v$ and $e$, with the eigenvalues 1 and
# $\frac58 - N \beta$. Its left eigenvector for 1 is the mask of the limit,
#
# $$
# (1 - N \chi) \, v + \chi \sum_j e_j, \qquad \chi = \frac{1}{N + \frac{3}{8 \beta}} .
# $$

# %%
N, beta, lam = symbols("N beta lambda", positive=True)
block = Matrix([[1 - N * beta, N * beta], [Rational(3, 8), Rational(5, 8)]])
found = (lam - 1) * (lam - Rational(5, 8) + N * beta)
assert expand((block - lam * Matrix.eye(2)).det() - found) == 0
chi = 1 / (N + 3 / (8 * beta))
mask = Matrix([[1 - N * chi, N * chi]])
assert (mask * block - mask).applyfunc(simplify).is_zero_matrix

# %% [markdown]
# Loop's weights are made so that the second is the square of the largest wave,
#
# $$
# \lambda = \frac38 + \frac14 \cos \frac{2 \pi}{N}, \qquad \frac58 - N \beta_N = \lambda^2,
# $$
#
# Warren's make it $\frac14$, and $\frac1{16}$ at $N = 3$, where both agree. The eigenvalues of a
# frequency are single: the ring's matrix has no Jordan block. The largest below 1 is $\lambda$, of
# $f = 1$ and $f = N - 1$; the cosine and sine of these waves are the masks of two tangents,
#
# $$
# \sum_j \cos \left( \frac{2 \pi j}{N} \right) e_j, \qquad
# \sum_j \sin \left( \frac{2 \pi j}{N} \right) e_j,
# $$
#
# because the block of the $e_j$ is symmetric, and $v$ has weight 0 in them. (At $N = 2$ there is
# one wave, with the eigenvalue $\frac18$, and no tangent plane.)


# %%
def subdominant(n):
    return Rational(3, 8) + cos(2 * pi / n) / 4


def loop_weight(n):
    return (Rational(5, 8) - subdominant(n) ** 2) / n


def warren_weight(n):
    return Rational(3, 16) if n == 3 else Rational(3, 8 * n)


assert loop_weight(3) == warren_weight(3)
assert loop_weight(6) == warren_weight(6) == SIXTEENTH
assert [subdominant(n) for n in (2, 3, 4, 6)] == [EIGHTH, 2 * EIGHTH, 3 * EIGHTH, 4 * EIGHTH]
assert all(Rational(5, 8) - n * warren_weight(n) == Rational(1, 4) for n in range(4, 20))
assert Rational(5, 8) - 3 * warren_weight(3) == SIXTEENTH
limits = [1 / (n + 3 / (8 * loop_weight(n))) for n in (3, 6)]
assert limits == [Rational(1, 5), Rational(1, 12)]

# %% [markdown]
# ## 2. The points of a face
#
# The face $v, e_0, e_1$ has regular corners $e_0$ and $e_1$. Its limit depends on the ring of $v$
# and on five more neighbours of the other two corners: $N + 6$ control points. With the places
# $(a, b)$ that they would have on a regular mesh, $d_2 = (0, 1)$ drawn to the upper right:
#
# ```
#              (-1,2) --- (0,2)
#              /    \     /    \
#        e_2=(-1,1) -- e_1 --- (1,1)
#            .    \   /   \    /   \
#              .    v ---- e_0 --- (2,0)
#                .   \    /   \    /
#             e_(N-1)=(1,-1) -- (2,-1)
# ```
#
# One step gives the $N + 6$ control points of the child at $v$, and six points beyond them,
# $N + 12$ in all, from which the other three children have twelve each
# ([masks_box_spline](masks_box_spline.py), section 4).

# %%
STEPS = (1, 0), (0, 1), (-1, 1), (-1, 0), (0, -1), (1, -1)
OUTER = (2, -1), (2, 0), (1, 1), (0, 2), (-1, 2)
BEYOND = (3, -1), (3, 0), (2, 1), (1, 2), (0, 3), (-1, 3)
CORNERS = (0, 0), (1, 0), (0, 1)
CONTROLS = {(a + x, b + y) for a, b in CORNERS for x, y in (*STEPS, (0, 0))}
KNOWN = {(0, 0), (1, 0), (0, 1), (-1, 1), (1, -1), *OUTER}  # of the ring, those that count

children = [((1, 0), 1), ((0, 1), 1), ((1, 1), -1)]
needed = {(a + s * x, b + s * y) for (a, b), s in children for x, y in CONTROLS}
assert needed - KNOWN == set(BEYOND)


def regular(k):
    """{old place: weight} for the new point k of a regular mesh."""
    a, b = k
    if a % 2 == b % 2 == 0:
        c = a // 2, b // 2
        around = [(c[0] + x, c[1] + y) for x, y in STEPS]
        return {c: Rational(5, 8)} | dict.fromkeys(around, SIXTEENTH)
    i = {(1, 0): 0, (0, 1): 1, (1, 1): 2}[a % 2, b % 2]
    x, y = STEPS[i]
    p, q = (a - x) // 2, (b - y) // 2
    sides = [(p + STEPS[m][0], q + STEPS[m][1]) for m in (i - 1, i + 1)]
    ends = dict.fromkeys(((p, q), (p + x, q + y)), Rational(3, 8))
    return ends | dict.fromkeys(sides, EIGHTH)


def face_matrix(n, weight, rows=OUTER):
    """One step on v, e_0 .. e_(N-1) and `OUTER`: the new ring, then the new points ``rows``."""
    column = {(0, 0): 0, (1, 0): 1, (0, 1): 2, (-1, 1): 1 + 2 % n, (1, -1): n}
    column |= {place: n + 1 + i for i, place in enumerate(OUTER)}
    A = Matrix.zeros(n + 1 + len(rows), n + 6)
    A[0, : n + 1] = Matrix([[1 - n * weight, *[weight] * n]])
    for i in range(n):
        for at, share in ((0, 3), (1 + i, 3), (1 + (i + 1) % n, 1), (1 + (i - 1) % n, 1)):
            A[1 + i, at] += share * EIGHTH
    for i, place in enumerate(rows):
        for old, share in regular(place).items():
            A[n + 1 + i, column[old]] += share
    return A


assert all(set(regular(place)) <= KNOWN for place in (*OUTER, *BEYOND))
assert face_matrix(5, warren_weight(5), OUTER + BEYOND).shape == (17, 11)

# %% [markdown]
# The outer points see five points of the ring and themselves; the block of the outer points is
# triangular, in the order edges first, with the eigenvalues $\frac18$ three times and $\frac1{16}$
# twice, and has no Jordan block.

# %%
ALL = face_matrix(7, warren_weight(7))
outer = ALL[8:, 8:]
assert outer.eigenvals() == {EIGHTH: 3, SIXTEENTH: 2}
assert (outer - EIGHTH * Matrix.eye(5)).rank() == 2
assert (outer - SIXTEENTH * Matrix.eye(5)).rank() == 3
coupling = Matrix.hstack(*(ALL[8:, i] for i in (0, 7, 1, 2, 3)))  # v, e_(N-1), e_0, e_1, e_2
Matrix.hstack(coupling, outer) * 16

# %% [markdown]
# ## 3. Where eigenvalues meet
#
# An eigenvector $R$ of the ring, of value $\mu$, goes on to the outer points as the solution $x$ of
# $(A_{oo} - \mu) \, x = -A_{or} R$. There is one unless $\mu$ is $\frac18$ or $\frac1{16}$.
#
# *At* $\frac18$. A wave has it if $\cos \frac{2 \pi f}{N} = -1$: for even $N$ and $f = N / 2$,
# where $e_j = (-1)^j$. The equation has a solution: no Jordan block. (For $\lambda^2 = \frac18$ the
# cosine would be $\sqrt 2 - \frac32 = -0.086$, between $N = 3$ and $N = 4$.)
#
# *At* $\frac1{16}$. A wave would need $\cos = -\frac54$. $\lambda^2 = \frac1{16}$ is
# $\lambda = \frac14$: $N = 3$, where $v = -\frac32 e$. The equation has no solution: a Jordan block
# of two.

# %%
mode = Matrix([0, -1, 1, -1, 1])
right = -coupling * mode
singular = outer - EIGHTH * Matrix.eye(5)
assert Matrix.hstack(singular, right).rank() == singular.rank()

mode = Matrix([Rational(-3, 2), 1, 1, 1, 1])
assert block.subs({N: 3, beta: loop_weight(3)}) * Matrix(mode[:2]) == Matrix(mode[:2]) / 16
right = -coupling * mode
singular = outer - SIXTEENTH * Matrix.eye(5)
assert Matrix.hstack(singular, right).rank() == singular.rank() + 1

# %% [markdown]
# So *the only defective matrix is that of $N = 3$*, of both weights. (Warren's $\frac14$ meets
# waves at $N = 3 m$, of another frequency; and $\lambda^2$ may meet waves: no matter.) Ranks, in
# fractions, say the same:


# %%
def exact_rank(matrix):
    return DomainMatrix.from_Matrix(matrix).convert_to(QQ).rank()


def defect(A, value):
    """By how much the kernel of the square of A - value exceeds its own."""
    B = A - value * Matrix.eye(A.rows)
    return exact_rank(B) - exact_rank(B * B)


for n in range(2, 14):
    A = face_matrix(n, warren_weight(n))
    found = [defect(A, value) for value in (EIGHTH, SIXTEENTH, Rational(1, 4), Rational(1, 2))]
    assert found == ([0, 1, 0, 0] if n == 3 else [0, 0, 0, 0])
for n in (2, 4, 6):
    A = face_matrix(n, loop_weight(n))
    assert not any(defect(A, value) for value in (EIGHTH, SIXTEENTH, subdominant(n) ** 2))

# %% [markdown]
# ## 4. Derivatives and curvature
#
# At $2^{-n}$ from the vertex the part of an eigenvalue $\mu$ in derivatives of order $k$ is
# $(2^k \mu)^n$ times what it is at $n = 0$. First derivatives scale with $2 \lambda$, which is
# below 1 for $N \le 5$ and above it for $N \ge 7$: they vanish or diverge.
#
# Distances shrink with $\lambda$. Curvature is second derivatives over squares of first ones: with
# $\mu$ the largest eigenvalue after $\lambda$, it scales with $\mu / \lambda^2$. Of the waves the
# next is $f = 2$, which differs from $f = N - 1$ from $N = 4$ on. With $c = \cos \frac{2 \pi}{N}$,
#
# $$
# \frac38 + \frac{2 c^2 - 1}{4} - \lambda^2 = \frac{28 c^2 - 12 c - 1}{64}
# = \frac{(2 c - 1)(14 c + 1)}{64},
# $$
#
# which is negative for $N = 4, 5$, zero for $N = 6$, positive from $N = 7$ on. The outer points'
# $\frac18$ is below $\lambda^2$ for $N \ge 4$, but above it at $N = 3$. So with Loop's weights,
# which have $\lambda^2$ itself for $f = 0$:
#
# - $N = 4, 5, 6$: $\mu = \lambda^2$, bounded curvature;
# - $N \ge 7$: $\mu > \lambda^2$ is that of $f = 2$: unbounded;
# - $N = 3$: $\mu = \frac18$ of the *outer* points, $\lambda^2 = \frac1{16}$: unbounded like $2^n$.
#   As distances are $r = 4^{-n}$, this is $1 / \sqrt r$. The ring alone would have said: bounded,
#   but for a factor $n$ of the Jordan block.
#
# With Warren's weights $f = 0$ has $\frac14$, more than $\lambda^2$ also at $N = 4$ and $N = 5$.

# %%
c = Symbol("c")
square = (Rational(3, 8) + c / 4) ** 2
assert factor(Rational(3, 8) + (2 * c**2 - 1) / 4 - square) == (2 * c - 1) * (14 * c + 1) / 64

bounded = []
for n in range(3, 60):
    size = float(subdominant(n)) ** 2
    second = 3 / 8 + float(cos(4 * pi / n)) / 4 if n > 3 else 0.0
    largest = max(size, second, 1 / 8)
    if largest < size + 1e-12:
        bounded.append(n)
    assert (second > size + 1e-4) == (n >= 7)
    assert (2 * float(subdominant(n)) < 1 - 1e-9) == (n <= 5)
    if 4 <= n <= 6:
        assert (size < 1 / 4 - 1e-4) == (n < 6)  # Warren's
assert bounded == [4, 5, 6]

# %% [markdown]
# That the outer points do bend the surface at $N = 3$ has to be seen: an eigenvector of $\frac18$
# that is zero on the ring, as a height over the characteristic map $(x, y)$, the waves of
# $\lambda = \frac14$. On a piece of the face its second derivatives with respect to $(x, y)$ are
# not zero: here, for all three of them, at the middle of child 3.

# %%
u, v = symbols("u v")
w = 1 - u - v


def corner_weight(x, y, z):
    last = y**4 + 6 * y**3 * z + 12 * y**2 * z**2 + 6 * y * z**3 + z**4
    middle = 4 * x * (2 * y**3 + 9 * y**2 * z + 9 * y * z**2 + 2 * z**3)
    first = 24 * x**3 * (y + z) + x**2 * (24 * y**2 + 60 * y * z + 24 * z**2)
    return (6 * x**4 + first + middle + last) / 12


def across_weight(x, y, z):
    square = x**4 + 6 * x**3 * y + 12 * x**2 * y**2 + 6 * x * y**3 + y**4
    return (square + 2 * z * (x + y) ** 3) / 12


def beyond_weight(x, y, z):
    return (x**4 + 2 * x**3 * y) / 12


WEIGHTS = {}
for k, (a, b) in enumerate(CORNERS):
    x, y, z = ((w, u, v) * 2)[k : k + 3]
    step = [(a + STEPS[2 * k + m - 6][0], b + STEPS[2 * k + m - 6][1]) for m in range(6)]
    WEIGHTS[a, b] = corner_weight(x, y, z)
    WEIGHTS |= {step[5]: across_weight(x, y, z)}
    WEIGHTS |= {step[4]: beyond_weight(x, y, z), step[3]: beyond_weight(x, z, y)}
assert expand(sum(WEIGHTS.values())) == 1
assert expand(sum(a * p for (a, _), p in WEIGHTS.items()) - u) == 0

A = face_matrix(3, loop_weight(3))
big = face_matrix(3, loop_weight(3), OUTER + BEYOND)
places = [(0, 0), (1, 0), (0, 1), (-1, 1), *OUTER, *BEYOND]


def on_child_3(vector):
    fine = dict(zip(places, big * vector, strict=True))
    fine[1, -1] = fine[-1, 1]  # N = 3: one point
    return expand(sum(p * fine[1 - a, 1 - b] for (a, b), p in WEIGHTS.items()))


def eigenvectors(value):
    return (A - value * Matrix.eye(9)).nullspace()


waves = eigenvectors(Rational(1, 4))
assert len(waves) == 2
heights = [vector for vector in eigenvectors(EIGHTH) if Matrix(vector[:4]).is_zero_matrix]
assert len(heights) == 3
x, y = map(on_child_3, waves)
J = Matrix([[diff(f, t) for t in (u, v)] for f in (x, y)])
curved = 0
for height in map(on_child_3, heights):
    middle = {u: Rational(1, 3), v: Rational(1, 3)}
    slope = (Matrix([[diff(height, u), diff(height, v)]]) * J.inv()).subs(middle)
    H = Matrix(2, 2, lambda i, j, f=height: diff(f, (u, v)[i], (u, v)[j]))
    for f, share in zip((x, y), slope, strict=True):
        H -= share * Matrix(2, 2, lambda i, j, f=f: diff(f, (u, v)[i], (u, v)[j]))
    curved += not H.subs(middle).is_zero_matrix
assert curved == 3
