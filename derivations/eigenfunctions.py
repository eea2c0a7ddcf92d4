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
"""The eigenfunctions of a face with one extraordinary corner, as bicubic pieces.

After Stam (1998) and Ramshaw (1989).

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Eigenfunctions
#
# A quad whose corner 0 is an extraordinary vertex of valence $N$ is not a polynomial patch, but
# three quarters of it are, and three quarters of what is left, and so on. This document derives
#
# 1. Stam's extended matrix $\bar A$, his picking matrices and the three regular pieces;
# 2. the *halving identity*, from which the scaling of eigenfunctions follows, Jordan blocks
#    included;
# 3. that every such surface is twice continuously differentiable away from the corner;
# 4. the eigenfunctions of the outer block: they are the seven monomials with $u^3$ or $v^3$;
# 5. that the $2 N + 8$ eigenfunctions of a face are linearly independent, for every $N \ge 3$;
# 6. that $X(u, v) = \sum_k \varphi_k(u, v)\, (w_k C)$, the formula by which the library evaluates;
# 7. how the eigenvectors of the faces around a vertex join to those of its two-ring.
#
# The matrix itself is derived in [subdivision_matrix](subdivision_matrix.py), its eigenvectors in
# [eigenstructure](eigenstructure.py), those of sharp corners in [sectors](sectors.py). Here the
# matrices come from the library's masks.
#
# - J. Stam, "Exact evaluation of Catmull-Clark subdivision surfaces at arbitrary parameter values",
#   SIGGRAPH 1998: extended and picking matrices, eigenbasis functions, their scaling.
# - L. Ramshaw, "Blossoms are polar forms", Computer Aided Geometric Design 6 (1989): control points
#   of a polynomial.

# %%
from fractions import Fraction
from itertools import combinations, product
from math import prod

import numpy as np
from sympy import QQ, Matrix, Rational, expand, sqrt, symbols
from sympy.polys.matrices import DomainMatrix

import limitsurf as ls
from limitsurf.exact.matrices import grid_index, subdivision_matrix
from limitsurf.scheme.catmull_clark import CATMULL_CLARK
from limitsurf.scheme.lattice import QUADS
from limitsurf.scheme.sector import Sector

S, T, t = symbols("S T t")

# %% [markdown]
# ## 1. The three regular pieces
#
# The limit on the face hangs on $K = 2 N + 8$ control points $C$: the ring of the vertex and seven
# outer points (drawn in [subdivision_matrix](subdivision_matrix.py)). One refinement gives $K$
# points $A C$ around the same vertex at half the size and, with nine more beyond them, $K + 9$
# points $\bar A C$. On the refined grid, places $(i, j)$ with $(1, 1)$ at the vertex and two grid
# steps along the face, three squares of $4 \times 4$ places do not touch the special place
# $(0, 0)$:
#
# $$ (1, 0) + \{0 \ldots 3\}^2, \quad (1, 1) + \{0 \ldots 3\}^2, \quad (0, 1) + \{0 \ldots 3\}^2. $$
#
# Picking these 16 points out of $\bar A C$ is multiplication by a picking matrix $P_1, P_2, P_3$,
# and each square is the net of a bicubic B-spline patch. The inner cell of the square at $(x, y)$
# lies between the places $(x + 1, y + 1)$ and $(x + 2, y + 2)$, which are the parameters
# $x / 2, y / 2$ to $(x + 1) / 2, (y + 1) / 2$: the face but for its quarter at the vertex.
#
# $$ X(u, v) = b(S, T)^T P_k \bar A\, C, \qquad S = 2 u - x, \quad T = 2 v - y . $$
#
# In the quarter that is left the surface is that of the control points $A C$, at $(2 u, 2 v)$.
# So with $n$ the number of halvings that bring the larger parameter into $(1/2, 1]$,
#
# $$ X(u, v) = b(S, T)^T P_k \bar A A^n C, \qquad 2^{-n-1} < \max(u, v) \le 2^{-n} . \qquad (1) $$

# %%
cubic = [(1 - t) ** 3 / 6, (3 * t**3 - 6 * t**2 + 4) / 6]
cubic += [weight.subs(t, 1 - t) for weight in reversed(cubic)]
assert expand(sum(cubic) - 1) == 0
# index 4 j + i: i along u, j along v
b = Matrix([cubic[i].subs(t, S) * cubic[j].subs(t, T) for j, i in product(range(4), repeat=2)])


class Corner:
    """A and its extension in exact rationals, where the places are, and the pieces."""

    def __init__(self, kind, faces, position=0):
        self.sector = Sector(kind, faces, position)
        matrix = subdivision_matrix(CATMULL_CLARK, self.sector)
        self.size, self.pieces, self.at = matrix.size, matrix.pieces, grid_index(self.sector)
        entries = [[Rational(row.get(k, 0)) for k in range(self.size)] for row in matrix.rows]
        self.extended = Matrix(entries)
        self.A = self.extended[: self.size, :]

    def net(self, k, C):
        """The 16 control points of piece k of the control points C."""
        return self.extended.extract(self.pieces[k], range(self.size)) * C

    def surface(self, k, C):
        """Piece k as a polynomial in S and T."""
        return expand((b.T * self.net(k, C))[0])


def rational(matrix):
    return DomainMatrix.from_Matrix(matrix).convert_to(QQ)


PIECES = tuple(piece.origin for piece in QUADS.pieces)
assert PIECES == ((1, 0), (1, 1), (0, 1))
for faces in (3, 4, 5, 12):
    corner = Corner("interior", faces)
    assert corner.extended.shape == (2 * faces + 17, 2 * faces + 8)
    for (x, y), piece in zip(PIECES, corner.pieces, strict=True):
        places = [(x + i, y + j) for j, i in product(range(4), repeat=2)]
        assert list(piece) == [corner.at[place] for place in places]

# %% [markdown]
# At $N = 4$ nothing is extraordinary: the face is one bicubic patch, with the point $f_2$ in the
# place $(0, 0)$, and (1) must be that patch, for any control points:

# %%
four = Corner("interior", 4)
places = {**{k: place for place, k in four.at.items()}, 6: (0, 0)}
C = Matrix(symbols("c:16"))
for k, (x, y) in enumerate(PIECES):
    whole = {S: (S + x) / 2, T: (T + y) / 2}  # the parameters of the face
    patch = sum(
        C[k] * cubic[i].subs(t, whole[S]) * cubic[j].subs(t, whole[T])
        for k, (i, j) in places.items()
        if k < 16
    )
    assert expand(four.surface(k, C) - patch) == 0

# %% [markdown]
# ## 2. Halving
#
# Write $X_C$ for the surface of the control points $C$. Halving both parameters of a point keeps
# its piece and its $S$ and $T$ and raises $n$ by one. So (1) says
#
# $$ X_C(u / 2, v / 2) = X_{A C}(u, v) \qquad \text{for all } (u, v) \ne (0, 0) . \qquad (2) $$
#
# The eigenfunction $\varphi_k$ is the surface whose control points are the eigenvector $V_k$. As
# $X_C$ is linear in $C$, what $A$ does to the vectors, halving does to the functions:
#
# $$ A V_k = \lambda_k V_k \;\Rightarrow\; \varphi_k(u/2, v/2) = \lambda_k \varphi_k(u, v),
#    \qquad \text{on } \Omega^n:\;
#    \varphi_k(u, v) = \lambda_k^n\, b(S, T)^T P \bar A V_k . $$
#
# In a Jordan block $A V_k = \lambda V_k + V_{k-1}$, and
#
# $$ \varphi_k(u/2, v/2) = \lambda \varphi_k(u, v) + \varphi_{k-1}(u, v), \qquad
#    \varphi_k(u / 2^n, v / 2^n) = \lambda^n \varphi_k + n \lambda^{n-1} \varphi_{k-1} . $$
#
# A complex pair $\lambda = \rho e^{\pm i \omega}$ with real vectors $x, y$, $A x = a x - b y$ and
# $A y = b x + a y$, $\lambda = a + i b$, turns: $x + i y$ is an eigenvector of $a + i b$, so
# $\varphi_x(u / 2^n) + i \varphi_y(u / 2^n) = \rho^n e^{i n \omega} (\varphi_x + i \varphi_y)$.
#
# An instance of each kind is in part 6. Here is a Jordan block in rationals, the crease of one face
# at $\lambda = 1/4$ ([sectors](sectors.py)): on all three pieces, one halving on,

# %%
one_face = Corner("crease", 1)
shifted = one_face.A - Matrix.eye(one_face.size) / 4
(head,) = (x for x in (shifted**2).nullspace() if any(shifted * x))
end = shifted * head
assert not any(shifted * end)
for k in range(3):
    halved = one_face.surface(k, one_face.A * head)
    assert expand(halved - one_face.surface(k, head) / 4 - one_face.surface(k, end)) == 0
    assert one_face.surface(k, end) != 0

# %% [markdown]
# ## 3. Twice continuously differentiable, but at the corner
#
# The three pieces of one level are parts of one net, hence joined as any bicubic B-spline is. What
# is to be shown is that the pieces of level $n + 1$ continue those of level $n$ across
# $u = 2^{-n-1}$ (and, by symmetry, $v = 2^{-n-1}$).
#
# A cubic B-spline has a value and two derivatives at a knot that depend on the three control
# points $p, q, r$ around it. They are the same from both sides; and they do not change when knots
# are inserted half way, which makes $(p + q) / 2, (p + 6 q + r) / 8, (q + r) / 2$ of the three:

# %%
p, q, r, s = symbols("p q r s")


def at_knot(points, end, spacing):
    """Value, first and second derivative at an end of the piece with these four points."""
    piece = sum(x * w for x, w in zip(points, cubic, strict=True))
    return [expand(piece.diff(t, k).subs(t, end) / spacing**k) for k in range(3)]


from_right = at_knot((p, q, r, s), 0, 1)
from_left = at_knot((s, p, q, r), 1, 1)
inserted = ((p + q) / 2, (p + 6 * q + r) / 8, (q + r) / 2)
assert from_right == from_left
assert from_right == at_knot((*inserted, s), 0, Rational(1, 2))
assert from_right == at_knot((s, *inserted), 1, Rational(1, 2))

# %% [markdown]
# The line $u = 1/2$ is line 2 of the refined grid and, one refinement later, line 3. So it remains
# to see that the lines 2, 3, 4 of the finer grid come from the lines 1, 2, 3 of the coarser one by
# knot insertion, in both directions, on the places $j = 0 \ldots 4$: the outer and the farther
# points are made so ([subdivision_matrix](subdivision_matrix.py), part 4), and those of line 2 are
# the edge point and two face points next to the vertex. No weight depends on $N$, and $(0, 0)$ is
# not asked for. Compared with the library's rows for $N = 3 \ldots 12$:

# %%
LINES = {  # new line: weights of old lines
    0: {0: Rational(1, 2), 1: Rational(1, 2)},
    1: {0: Rational(1, 8), 1: Rational(3, 4), 2: Rational(1, 8)},
    2: {1: Rational(1, 2), 2: Rational(1, 2)},
    3: {1: Rational(1, 8), 2: Rational(3, 4), 3: Rational(1, 8)},
    4: {2: Rational(1, 2), 3: Rational(1, 2)},
}
for faces in range(3, 13):
    corner = Corner("interior", faces)
    for i, j in product((2, 3, 4), range(5)):
        for first, second in ((i, j), (j, i)):
            row = Matrix.zeros(1, corner.size)
            for (x, w), (y, z) in product(LINES[first].items(), LINES[second].items()):
                row[corner.at[x, y]] += w * z
            assert row == corner.extended[corner.at[first, second], :]

# %% [markdown]
# The same argument joins the face to its neighbours along its edges: both are cut along the edge at
# the same parameters, and the points on the edge and beside it are the same for both.
#
# ## 4. The outer block: monomials
#
# The eigenvectors of the outer block vanish on the ring. Which functions are they? The control
# points of a polynomial are values of its polar form at three consecutive knots; around $[0, 1]$,
# point $i$ belongs to the knots $i - 2, i - 1, i$. For $u^3$ the polar form is the product:
#
# $$ u^3: \; 0, 0, 0, 6, \qquad u^2: \; \tfrac23, -\tfrac13, \tfrac23, \tfrac{11}3, \qquad
#    u: \; -1, 0, 1, 2, \qquad 1: \; 1, 1, 1, 1 . $$

# %%
POINTS = [
    [Rational(sum(map(prod, subsets)), len(subsets)) for subsets in found]
    for found in (
        [list(combinations((i - 2, i - 1, i), degree)) for i in range(4)] for degree in range(4)
    )
]
assert POINTS[3] == [0, 0, 0, 6]
for degree, values in enumerate(POINTS):
    assert expand(sum(x * w for x, w in zip(values, cubic, strict=True)) - t**degree) == 0

# %% [markdown]
# So $u^3$ has points on line 3 alone, and $u^3 v^j$ vanishes at all places $(i, j)$ with $i \le 2$:
# it does not touch the ring, nor the place $(0, 0)$ that only $N = 4$ has. The seven monomials with
# $u^3$ or $v^3$ are therefore surfaces of the outer points, at every valence. Halving multiplies
# $u^a v^b$ by $2^{-a-b}$, which gives the seven eigenvalues of the outer block:
#
# $$ \tfrac18: u^3, v^3, \quad \tfrac1{16}: u^3 v, u v^3, \quad
#    \tfrac1{32}: u^3 v^2, u^2 v^3, \quad \tfrac1{64}: u^3 v^3 . $$
#
# Hence they are *pure powers*, the same for every $N$, infinitely differentiable, and flat at the
# vertex: all that is extraordinary is in the eigenvectors of the ring. Checked on the library's
# matrices, which know $N$ only through rows of the ring:

# %%
CUBES = [(a, b) for a, b in product(range(4), repeat=2) if 3 in (a, b)]
assert len(CUBES) == 7


def monomial(corner, a, b):
    """Control points of u^a v^b, which has no points on the ring."""
    C = Matrix.zeros(corner.size, 1)
    for i, j in corner.sector.outer:
        C[corner.at[i, j]] = POINTS[a][i] * POINTS[b][j]
    return C


for faces in (3, 4, 5, 8):
    corner = Corner("interior", faces)
    found = [monomial(corner, *powers) for powers in CUBES]
    assert rational(Matrix.hstack(*found)).rank() == 7
    for (a, b_), C in zip(CUBES, found, strict=True):
        assert C / 2 ** (a + b_) == corner.A * C
        for k, (x, y) in enumerate(PIECES):
            wanted = ((S + x) / 2) ** a * ((T + y) / 2) ** b_
            assert expand(corner.surface(k, C) - wanted) == 0

# %% [markdown]
# At $N = 4$ all 16 monomials are eigenfunctions, and there are 16: those of the ring are the nine
# $u^a v^b$ with $a, b \le 2$, of eigenvalues $1, 1/2, 1/2, 1/4, 1/4, 1/4, 1/8, 1/8, 1/16$.
#
# A sharp edge along $v = 0$ takes the points $(i, 0)$ away, and reflects: second derivatives
# across vanish there. Then $u^3 v^2$ is no surface of that kind, and $1/32$ is left once, as
# [sectors](sectors.py) counts:

# %%
crease = Corner("crease", 3)
assert crease.sector.sharp_sides == (True, False)
for a, b_ in CUBES:
    C = monomial(crease, a, b_)
    same = all(
        expand(crease.surface(k, C) - ((S + x) / 2) ** a * ((T + y) / 2) ** b_) == 0
        for k, (x, y) in enumerate(PIECES)
    )
    assert same == (b_ != 2)
    assert (C / 2 ** (a + b_) == crease.A * C) == same

# %% [markdown]
# ## 5. Linear independence
#
# Claim: for every $N \ge 3$ the $2 N + 8$ eigenfunctions are linearly independent on the face.
#
# **Different eigenvalues.** Let $\sum c_k \varphi_k = 0$. By (2) also
# $\sum c_k \lambda_k^m \varphi_k = 0$ for all $m$, on the whole face. A Vandermonde matrix of
# different eigenvalues is invertible, so the sum over each eigenvalue vanishes by itself. That is
# the eigenfunction of *one* eigenvector $V$, with that eigenvalue $\lambda$.
#
# **One eigenvalue, not zero.** Let the eigenfunction of $V$ vanish. B-splines are linearly
# independent on a cell, so the control points of the three pieces vanish. These are all places of
# the refined grid but $(0, 0)$, and those with $i, j \le 3$ are $\lambda$ times the points of $V$
# itself:

# %%
seen = {(x + i, y + j) for x, y in PIECES for i, j in product(range(4), repeat=2)}
assert seen == set(product(range(5), repeat=2)) - {(0, 0)}

# %% [markdown]
# So $V$ vanishes at the outer points, at the vertex, and on the ring at $e_0, e_1, e_2, e_{N-1}$
# and $f_0, f_1, f_{N-1}$. Along the rest of the ring an eigenvector obeys the recurrence of
# [sectors](sectors.py), part 2, with $c$ for the vertex:
#
# $$ e_{j+1} = (16 \lambda + \tfrac1\lambda - 10)\, e_j - e_{j-1} + (\tfrac1\lambda - 6)\, c,
#    \qquad f_j = \frac{c + e_j + e_{j+1}}{4 \lambda - 1}, $$
#
# and for $\lambda = 1/4$: $e_{j+1} = -e_j - c$, $f_j = -f_{j-1} - 4 c$. All is zero, $V = 0$.
#
# **Eigenvalue zero** occurs at $N = 3$ alone, once ([eigenstructure](eigenstructure.py): the
# product of the two roots of frequency 0 is $(N - 3) / (16 N)$, all other eigenvalues are
# positive). Its eigenfunction lives on the first three pieces alone, and is not zero there. (The
# ranks of other matrices are checked for $N = 4 \ldots 12$.)

# %%
three = Corner("interior", 3)
nothing = rational(three.A).nullspace().to_Matrix().T
assert nothing.shape == (14, 1)
assert any(three.surface(k, nothing) != 0 for k in range(3))
for faces in range(4, 13):
    assert rational(Corner("interior", faces).A).rank() == 2 * faces + 8

# %% [markdown]
# ## 6. The surface as a sum over eigenfunctions
#
# With $V = (V_1 \ldots V_K)$, $J$ its Jordan matrix, diagonal for $N \ge 3$
# ([eigenstructure](eigenstructure.py)), and $w_k$ the rows of $V^{-1}$: $C = \sum_k V_k (w_k C)$.
# As $X_C$ is linear in $C$,
#
# $$ X_C(u, v) = \sum_k \varphi_k(u, v)\, (w_k C)
#    = b(S, T)^T P \bar A\, V J^n V^{-1} C . \qquad (3) $$
#
# The vector of a left eigenvector $w_k$ is what the control points have of $\varphi_k$; that of
# eigenvalue 1 is the limit of the vertex, $\varphi_1 = 1$.
#
# Exactly, for $N = 3$: eigenvalues and real eigenvectors are in $\mathbb Q(\sqrt{17})$, and (3)
# must have the rational matrices $\bar A A^n$ of (1), here for $n = 0, 1, 2, 7$; with $0^0 = 1$ for
# the eigenvalue 0.

# %%
FIELD = QQ.algebraic_field(sqrt(17))
A, extended = (rational(x).convert_to(FIELD) for x in (three.A, three.extended))
low, high = ((9 + sign * sqrt(17)) / 32 for sign in (-1, 1))
values = {1: 1, high: 2, Rational(1, 6): 1, low: 2, 0: 1}
values |= {Rational(1, 4 << k): 2 for k in (1, 2, 3)} | {Rational(1, 64): 1}
columns, eigenvalues = [], []
for value, multiplicity in values.items():
    shift = DomainMatrix.eye(three.size, FIELD) * FIELD.from_sympy(Rational(0) + value)
    kernel = (A - shift).nullspace()
    assert kernel.shape[0] == multiplicity
    columns.append(kernel.transpose())
    eigenvalues += [FIELD.from_sympy(Rational(0) + value)] * multiplicity
V = columns[0].hstack(*columns[1:])
left = V.inv()
for n in (0, 1, 2, 7):
    power = DomainMatrix.diag([x**n if n else FIELD.one for x in eigenvalues], FIELD)
    assert extended * V * power * left == extended * A**n

# %% [markdown]
# And (1) against the library's evaluation of Fractions on a mesh, for $N = 3$ and $5$: $N$ sectors
# of $2 \times 2$ quads around the vertex, with integers as points and parameters without a pattern.


# %%
def mesh_around(n):
    """Mesh of Fractions, and the vertices that are the control points of the face of each sector.

    Vertices go by (sector, steps along its first edge, steps along the other).
    """
    names = {}

    def vertex(sector, i, j):
        if i == 0:
            sector, i, j = (sector + 1, j, 0) if j else (0, 0, 0)
        return names.setdefault((sector % n, i, j), len(names))

    cells = [(0, 0), (1, 0), (1, 1), (0, 1)]
    faces = [
        [vertex(sector, i + x, j + y) for x, y in cells] for sector in range(n) for i, j in cells
    ]
    ring = [(0, 0, 0), *((k, 1, j) for k in range(n) for j in (0, 1))]
    points = [
        [Fraction((7 * k * k + axis * k + 3) % 23) for axis in range(3)] for k in names.values()
    ]
    own = [[((s + k) % n, i, j) if i else (0, 0, 0) for k, i, j in ring + OUTER] for s in range(n)]
    return ls.Mesh(points, faces), names, own


OUTER = [(-1, 1, 2), (0, 2, 0), (0, 2, 1), (0, 2, 2), (0, 1, 2), (1, 2, 0), (1, 2, 1)]


QUERIES = [
    (Fraction(5, 7), Fraction(2, 9)),
    (Fraction(3, 35), Fraction(1, 11)),
    (Fraction(1, 99), Fraction(1, 7)),
]


def place_of(u, v):
    """Level, piece, S and T."""
    level = 0
    while max(u, v) <= Fraction(1, 2):
        u, v, level = 2 * u, 2 * v, level + 1
    x, y = int(2 * u > 1), int(2 * v > 1)
    return level, PIECES.index((x, y)), 2 * u - x, 2 * v - y


for faces in (3, 5):
    corner, (mesh, names, own) = Corner("interior", faces), mesh_around(faces)
    C = Matrix([[Rational(x) for x in mesh.points[names[place]]] for place in own[0]])
    for u, v in QUERIES:
        level, k, s_, t_ = place_of(u, v)
        weights = b.subs({S: Rational(s_), T: Rational(t_)})
        found = (weights.T * corner.net(k, corner.A**level * C)).tolist()[0]
        assert found == [Rational(x) for x in ls.LimitSurface(mesh).evaluate(0, u, v)]

# %% [markdown]
# ## 7. The two-ring of a vertex
#
# The $6 N + 1$ points of the $2 \times 2$ quads of all $N$ sectors are refined to $6 N + 1$ points
# of the same kind, by a matrix $B$. What is refined at the control points of one of the $N$ faces
# depends on these alone, by its own $A$:

# %%
for faces in (3, 5):
    corner, (mesh, names, own) = Corner("interior", faces), mesh_around(faces)
    fine, step = ls.refined(mesh, operator=True)
    step = step.toarray()
    # parameters of a refined vertex on the face of a sector, which is limit face 4 s
    places = zip(fine.parent_face.tolist(), fine.parent_u, fine.parent_v, strict=True)
    seen = {place: k for k, place in enumerate(places)}

    def refined_row(sector, i, j, faces=faces, seen=seen, step=step):
        u, v = Fraction(i, 2), Fraction(j, 2)
        # a point on an edge is told of with one of its two faces
        found = [seen.get((4 * sector, u, v))]
        if j == 0:
            found.append(seen.get((4 * ((sector - 1) % faces), v, u)))
        if i == 0:
            found += [seen.get((4 * s, 0, 0)) for s in range(faces)]
        return step[next(k for k in found if k is not None)]

    for control in own:
        columns = [names[place] for place in control]
        for row, place in enumerate(control):
            weights = refined_row(*place)
            assert [Rational(x) for x in weights[columns]] == list(corner.A[row, :])
            assert not np.delete(weights, columns).any()

# %% [markdown]
# So an eigenvector of $B$ is on the control points of each face an eigenvector of $A$ of the same
# eigenvalue, or zero; and vectors of all faces that agree where they meet are one of $B$.
#
# *Those of the ring.* A vector $r$ of the ring, of eigenvalue $\lambda$, continues to the outer
# points of a face by $(\lambda - A_{oo})\, o = A_{or}\, r$, $A_{oo}$ being the block of the outer
# points. Both faces at an edge see the same: by what is asserted below, the three points beyond an
# edge, one on it and one on either side, hang on themselves and on six points of the ring, alike
# for both. At $\lambda = 1/8$, for $N = 4 m$, the solution is that without a part of the outer
# eigenvectors, of which those three points tell as well. On a ring turned by one face, the face
# has what its neighbour had: outer points turn like cosines and sines of the ring.
#
# *Those that vanish on the ring.* The three points beyond an edge are refined without the other
# outer ones, and the far corner of a face hangs on itself and on those beyond its two edges. By
# part 4 the three have the functions $u^3, u^3 v, u^3 v^2$, with $u$ along the edge and $v$ across
# it: functions on both sides, even, odd and even. And $u^3 v^3$ belongs to one face alone, as it
# and its first two derivatives vanish on its edges. $N$ edges and $N$ faces have $3 N + N$ of
# them, with $2 N + 1$ of the ring all $6 N + 1$.

# %%
for faces in (3, 4, 5, 8):
    corner = Corner("interior", faces)
    first = [corner.at[place] for place in ((3, 0), (3, 1), (3, 2))]
    last = [corner.at[i, j] for j, i in ((3, 0), (3, 1), (3, 2))]
    far, ring = corner.at[3, 3], range(2 * faces + 1)
    for near, other in ((first, last), (last, first)):
        assert corner.A.extract(near, [*other, far]).is_zero_matrix
        # of the ring: the vertex, the edge's end, and what is on both sides of that edge
        touched = {k for k in ring for row in near if corner.A[row, k]}
        assert len(touched) == 6
    # mirrored at the edge they are refined alike
    assert corner.A.extract(first, first) == corner.A.extract(first[::-1], first[::-1])
    for b_, sign in ((0, 1), (1, -1), (2, 1)):
        C = monomial(corner, 3, b_)
        assert C[first[0]] == sign * C[first[2]]
        assert all(C[k] == 0 for k in last)
    assert all(monomial(corner, 3, 3)[k] == 0 for k in [*first, *last])
