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
"""Special corners of many faces: rings that are refined, and left eigenvectors without matrices.

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Special corners of many faces
#
# Around a vertex of $N$ faces there are $N$ patches of $2N + 8$ control points each, and open
# sectors and darts have a matrix for each of their faces: eigenbases cost $N^2$. The ring that all
# the patches share costs $N$ a step. Here: the step, and how a patch follows it with few control
# points of its own; where a patch deep inside may begin; why rings of many faces keep their digits
# however often they are refined; and the few left eigenvectors that directions at the vertex itself
# need, as solutions of a recurrence.
#
# - J. Stam, "Exact evaluation of Catmull-Clark subdivision surfaces at arbitrary parameter values",
#   SIGGRAPH 1998: the control points of a face and its three regular pieces.

# %%
from fractions import Fraction
from itertools import product

import numpy as np
from sympy import Matrix, Rational, cos, expand, sqrt, symbols

from limitsurf.exact.matrices import grid_index, subdivision_matrix
from limitsurf.exact.sectors import folded, limit_weights, mirrored
from limitsurf.exact.wide import Weights, dart_limit, rounded_dart_limit, slowest_waves
from limitsurf.scheme.catmull_clark import CATMULL_CLARK
from limitsurf.scheme.loop import LOOP
from limitsurf.scheme.sector import Sector
from limitsurf.scheme.spline import QUARTIC

# %% [markdown]
# ## 1. A patch that follows its ring
#
# Of the $5 \times 5$ refined points that the pieces of a face and its next $4 \times 4$ control
# points come from, all but four are made by regular rules from the $4 \times 4$ control points
# before: by knot insertion, with the lines
#
# $$
# \left( \tfrac12, \tfrac12, 0, 0 \right), \left( \tfrac18, \tfrac34, \tfrac18, 0 \right),
# \left( 0, \tfrac12, \tfrac12, 0 \right), \left( 0, \tfrac18, \tfrac34, \tfrac18 \right),
# \left( 0, 0, \tfrac12, \tfrac12 \right)
# $$
#
# in both directions. Of these four, $(0, 0)$ is in no piece, and the vertex $(1, 1)$ and the edge
# points $(1, 0)$ and $(0, 1)$ are points of the next ring. Beside a sharp edge the same holds with
# what is beyond it reflected, and nothing then is needed from the ring but the vertex and, on the
# other side, one edge point. Checked for all faces of sectors of all kinds.

# %%
h, e, t = Fraction(1, 2), Fraction(1, 8), Fraction(3, 4)
LINES = [{0: h, 1: h}, {0: e, 1: t, 2: e}, {1: h, 2: h}, {1: e, 2: t, 3: e}, {2: h, 3: h}]


def added(*terms):
    total = {}
    for weight, row in terms:
        for column, value in row.items():
            total[column] = total.get(column, 0) + weight * value
    return {column: value for column, value in total.items() if value}


def grid_of(sector, rows):
    """Rows of the grid positions of a face, with reflections at its sharp sides."""
    along_u, along_v = sector.sharp_sides
    grid = {place: rows[k] for place, k in grid_index(sector).items() if k < len(rows)}
    for i in range(5) if along_u else ():
        if (i, 2) in grid:
            grid[i, 0] = added((2, grid[i, 1]), (-1, grid[i, 2]))
    for j in range(5) if along_v else ():
        if (2, j) in grid:
            grid[0, j] = added((2, grid[1, j]), (-1, grid[2, j]))
    return grid


SECTORS = [
    Sector(kind, n, p)
    for kind in ("interior", "cone", "crease", "corner", "dart")
    for n in (5, 6)
    for p in range(1 if kind in ("interior", "cone") else n)
]
for sector in SECTORS:
    matrix = subdivision_matrix(CATMULL_CLARK, sector)
    before = grid_of(sector, [{k: Fraction(1)} for k in range(sector.size)])
    after = grid_of(sector, matrix.rows[: sector.size + len(sector.beyond)])
    for (i, j), row in after.items():
        if (i, j) not in [(0, 0), (1, 1), (1, 0), (0, 1)]:
            terms = [
                (p * q, before[a, b]) for a, p in LINES[i].items() for b, q in LINES[j].items()
            ]
            assert added(*terms) == row, (sector, i, j)

# %% [markdown]
# ## 2. Outer points forget
#
# The outer points drive nothing: what they begin with is seen, $n$ steps later, through powers of
# the block $A_o$ alone, whose eigenvalues are $1/8$ and less. With its left eigenvectors as the
# rows of $W^{-1}$ ([eigenstructure, 3](eigenstructure.py#3-the-outer-points)) the row sums of
# $\left| A_o^n \right| \, 8^n$ never exceed those of $\left| W \right| \left| W^{-1} \right|$,
# which are $107/3 < 2^6$, and each ring brings to them no more than its own size. So they may all
# stand at the vertex $40$ steps before the ring that is wanted, if what they began with, and every
# earlier ring, less three binary digits for each step since, is $80$ digits below that ring: of
# some thousand rings that is less than $2^{-63}$ of it in all. Rings fall by no more than $0.655$ a
# step, $0.61$ digits: $40$ steps leave $95$ of their $120$. Where degenerate control points make a
# ring fall faster, its patches begin at the cage.

# %%
OUTER = [(3, 0), (3, 1), (3, 2), (3, 3), (2, 3), (1, 3), (0, 3)]
A_o = Matrix(
    7,
    7,
    lambda m, k: LINES[OUTER[m][0]].get(OUTER[k][0], 0) * LINES[OUTER[m][1]].get(OUTER[k][1], 0),
)
LEFT = Matrix(
    [
        [1, 4, 1, 0, 0, 0, 0],
        [0, 0, 0, 0, 1, 4, 1],
        [-1, 0, 1, 0, 0, 0, 0],
        [0, 0, 0, 0, -1, 0, 1],
        [1, -2, 1, 0, 0, 0, 0],
        [0, 0, 0, 0, 1, -2, 1],
        [1, -3, 3, -1, 3, -3, 1],
    ]
)
d = [Rational(1, k) for k in (8, 8, 16, 16, 32, 32, 64)]
assert LEFT * A_o == Matrix.diag(*d) * LEFT
W = LEFT.inv()
bound = W.applyfunc(abs) * LEFT.applyfunc(abs)
assert max(sum(bound.row(k)) for k in range(7)) == Rational(107, 3)
assert 40 * 3 - 40 * np.log2(1 / 0.654) > 95
assert 80 - 6 - np.log2(1075) - 1 > 62.9

# %% [markdown]
# ## 3. Rings of many faces keep their digits
#
# Each step rounds relative to the largest coordinate of the ring, which falls like the largest
# eigenvalue $\lambda_1$ that occurs. A direction that falls faster loses, by the last step before
# $2^{-1074}$, as many digits as $(\lambda_2 / \lambda_1)^{1074}$ has. What spans the tangent plane
# does not: it is a double eigenvalue at smooth vertices. The sines of a sector of $k$ faces have
# $s = \cos(\pi m / (2k))$, and with $s = 2 \, \sinh(x)$, $\lambda = e^{2x} / 4$
# ([eigenstructure, 1](eigenstructure.py#1-the-eigenvalues-of-the-ring)) from $65$ faces on the
# second of them is still a third of the first after all steps; a dart has the first sine of
# $N$ faces, and an even wave between the first and the second; around a cone it is the wave that is
# the same everywhere, and the one that goes around once.


# %%
def value(s):
    return ((np.sqrt(4 + s * s) + s) / 4) ** 2


for faces in range(65, 1000):
    assert (value(np.cos(np.pi / faces)) / value(np.cos(np.pi / 2 / faces))) ** 1074 > 0.33
    assert (value(np.cos(np.pi / faces)) / value(1.0)) ** 1074 > 0.3
    assert (value(np.cos(1.5 * np.pi / faces)) / value(np.cos(np.pi / faces))) ** 1074 > 0.2

# %% [markdown]
# A curve, a boundary or a crease, falls by a half alone, and loses $400$ binary digits to its
# faces. But its points follow from each other: the vertex stands at 0, the others are halved, less
# the step of the vertex which is a share of them. So they have digits of their own, and nothing
# else may be added to them: beside them, where the first row of control points is a reflection, its
# weight is given to the two rows that it comes from,
#
# $$
# b_0 (2 p_1 - p_2) + b_1 p_1 + b_2 p_2 + b_3 p_3 =
# (b_1 + 2 b_0) \, p_1 + (b_2 - b_0) \, p_2 + b_3 p_3, \qquad b_2 - b_0 = T - \tfrac13 T^3,
# $$
#
# which is nothing on the curve itself, $T = 0$, however much larger $p_2$ is.

# %%
T = symbols("T")
b0, b2 = (1 - T) ** 3 / 6, (1 + 3 * T + 3 * T**2 - 3 * T**3) / 6
assert expand(b2 - b0 - (T - T**3 / 3)) == 0

# %% [markdown]
# ## 4. Left eigenvectors by a recurrence
#
# With the weights $c$ of a corner in a face point, $a$ and $b$ of an end and a face point in an
# edge point, $n$ and $m$ of an edge neighbour and a new face point in a vertex point, let a left
# eigenvector be $x$ at the vertex, $y_j$ at $e_j$ and $z_j$ at $f_j$, and $t_j$ what reaches the
# new face point $j$ in all. By columns, where edges are smooth,
#
# $$
# \lambda z_j = c \, t_j, \quad \lambda y_j = a \, y_j + c \, (t_{j-1} + t_j) + n x, \quad
# t_j = z_j + b \, (y_j + y_{j+1}) + m x .
# $$
#
# Without $z_j$ and $t_j$, and with $g = b c / (1 - c / \lambda)$, that is
#
# $$
# (\lambda - a - 2g) \, y_j - g \, (y_{j-1} + y_{j+1}) = k x, \qquad
# k = n + \frac{2 c m}{1 - c / \lambda} .
# $$

# %%
lam, a, b, c, n, m, x, before, here, later = symbols("lambda a b c n m x y_- y y_+")
t_before = (b * (before + here) + m * x) / (1 - c / lam)
t_here = (b * (here + later) + m * x) / (1 - c / lam)
column = lam * here - a * here - c * (t_before + t_here) - n * x
g, k = b * c / (1 - c / lam), n + 2 * c * m / (1 - c / lam)
wanted = (lam - a - 2 * g) * here - g * (before + later) - k * x
assert expand((column - wanted) * (1 - c / lam)) == 0

# %% [markdown]
# Where faces have no points, as in triangles, $b$ is the weight of an opposite corner in an edge
# point, and by columns
#
# $$ \lambda y_j = a \, y_j + b \, (y_{j-1} + y_{j+1}) + n x , $$
#
# the same recurrence with $\lambda - a$, $g = b$ and $k = n$.
#
# Solutions are waves $\cos(j \kappa)$ and $\sin(j \kappa)$ with
# $2 \, \cos(\kappa) = (\lambda - a - 2g) / g$, and a constant that $x$ brings. With the weights of
# Catmull and Clark, $\lambda = e^{2x} / 4$ belongs to $\kappa = \theta$, the angle of the wave
# around a smooth vertex:

# %%
s = symbols("s", positive=True)
root = ((sqrt(4 + s**2) + s) / 4) ** 2
quarter = Rational(1, 4)
g_cc = quarter**2 / (1 - quarter / root)
double = (root - quarter - 2 * g_cc) / g_cc
for point in (Rational(1, 3), Rational(9, 10), cos(1)):
    assert abs((double - 2 * (2 * s**2 - 1)).subs(s, point).evalf(40)) < Rational(1, 10**35)

# %% [markdown]
# The slowest waves of rings of many faces, checked to be left eigenvectors of the matrices, of
# quads and of triangles:

# %%
for scheme, kind, faces in product(
    (CATMULL_CLARK, LOOP), ("interior", "cone", "crease", "corner", "dart"), (10, 16, 33)
):
    matrix = subdivision_matrix(scheme, scheme.sector(kind, faces))
    size, stride = matrix.sector.ring, len(scheme.lattice.orbits)
    A = np.array([[float(matrix.rows[i].get(k, 0)) for k in range(size)] for i in range(size)])
    for edges, around in zip(*slowest_waves(scheme, kind, faces), strict=True):
        left = np.zeros(size)
        left[1::stride] = edges
        left[2::2] = around if stride == 2 else left[2::2]
        left[0] = -left.sum()
        image = left @ A
        ratio = (image @ left) / (left @ left)
        assert np.abs(image - ratio * left).max() < 1e-14 * np.abs(left).max()
        assert ratio > (0.59 if scheme is CATMULL_CLARK else 0.53)

# %% [markdown]
# ## 5. Darts
#
# The sharp edge $e_0$ takes nothing from faces, so that $y_0$ is missing in $t_{-1}$ and $t_0$: the
# recurrence holds for $j = 1, \dots, N - 1$ with $0$ in the place of $y_0 = y_N$, and
# $(\lambda - \frac12) \, y_0 = c \, (t_{-1} + t_0) + n x$ comes afterwards. For $\lambda = 1$ it is
# $7 y_j - y_{j-1} - y_{j+1} = C$, with the solution
#
# $$
# y_j = \frac{C}{5} \left( 1 - \frac{S_j + S_{N-j}}{S_N} \right), \qquad
# S_0 = 0, \; S_1 = 1, \; S_{j+1} = 7 S_j - S_{j-1},
# $$
#
# the limit mask of a dart of any number of faces (the $S_j$ are every fourth Fibonacci number over
# 3, [sectors, 6](sectors.py#6-darts)). The same as from the matrices:

# %%
for faces in range(2, 12):
    matrix = subdivision_matrix(CATMULL_CLARK, Sector("dart", faces))
    mask = dart_limit(CATMULL_CLARK, faces)
    image = [
        sum(mask[i] * matrix.rows[i].get(k, 0) for i in range(len(mask))) for k in range(len(mask))
    ]
    assert sum(mask) == 1
    assert image == mask == limit_weights(CATMULL_CLARK, Sector("dart", faces))
    for exact, rounded in zip(
        (mask[1::2], mask[2::2]), rounded_dart_limit(CATMULL_CLARK, faces), strict=True
    ):
        assert np.abs(np.array(exact, dtype=float) - rounded).max() < 1e-16

# %% [markdown]
# For the even waves $y_j$ is $1 - \cos((j - N/2) \kappa) / \cos(N \kappa / 2)$ times
# $k x / (\lambda - a - 4g)$, and the column of the vertex is an equation for $\kappa$ alone. Its
# root between $2 \pi / N$, the first wave around a smooth vertex, and $3 \pi / N$ is the largest
# even eigenvalue below 1; the one of the first sine, which is odd, is larger.

# %%
for faces in (9, 20, 66, 120):
    matrix = subdivision_matrix(CATMULL_CLARK, Sector("dart", faces))
    block = np.array(folded(matrix, mirrored(matrix.sector)), dtype=float)
    values = np.sort(np.linalg.eigvals(block).real)[::-1]
    edges, around = slowest_waves(CATMULL_CLARK, "dart", faces)
    w = Weights.of(CATMULL_CLARK, faces)
    # what reaches the face point 0 from the even wave is its z_0 times the eigenvalue over c
    x = -edges[0].sum() - around[0].sum()
    reached = around[0, 0] + w.face * edges[0, 1] + w.around * x
    found = w.corner * reached / around[0, 0]
    assert abs(found - values[1]) < 1e-13
    assert values[1] < value(np.cos(np.pi / faces))
    assert values[1] > value(np.cos(1.5 * np.pi / faces))

# %% [markdown]
# ## 6. Triangles
#
# Of triangles a patch follows its ring with ten control points: the vertex, $e_{p-1}$ to $e_{p+2}$,
# and the five beyond these. All refined points that its pieces and the next ten points come from
# are made from them by the regular rules, $\left( \frac38, \frac38, \frac18, \frac18 \right)$ along
# edges, and $\frac58$ and six times $\frac1{16}$ at vertices, but for the vertex and the points
# $e_{p-1}$ and $e_{p+2}$ of the next ring. Beside a sharp edge what is beyond it is again
# reflected: $p_{i, 0} = p_{i, 1} + p_{i-1, 1} - p_{i-1, 2}$.

# %%
STAR = [(1, 0), (0, 1), (-1, 1), (-1, 0), (0, -1), (1, -1)]


def regular_rule(i, j):
    """Weights of a refined point of a regular triangulation, by places."""
    x, y = 1 + (i - 1) // 2, 1 + (j - 1) // 2
    odd = (i - 1) % 2, (j - 1) % 2
    if odd == (0, 0):
        return {(x, y): Fraction(5, 8)} | {(x + a, y + b): Fraction(1, 16) for a, b in STAR}
    if odd == (1, 1):
        ends, far = [(x + 1, y), (x, y + 1)], [(x, y), (x + 1, y + 1)]
    elif odd == (1, 0):
        ends, far = [(x, y), (x + 1, y)], [(x, y + 1), (x + 1, y - 1)]
    else:
        ends, far = [(x, y), (x, y + 1)], [(x + 1, y), (x - 1, y + 1)]
    return dict.fromkeys(ends, Fraction(3, 8)) | dict.fromkeys(far, Fraction(1, 8))


def triangles_of(sector, rows):
    """Rows of the places of a triangle, with reflections at its sharp sides."""
    grid = {place: rows[k] for place, k in grid_index(sector).items() if k < len(rows)}
    for swap, sharp in enumerate(sector.sharp_sides):
        for i in range(2, 5) if sharp else ():
            places = [(i, 0), (i, 1), (i - 1, 1), (i - 1, 2)]
            beyond, *near = (x[::-1] for x in places) if swap else places
            if all(x in grid for x in near):
                terms = zip((1, 1, -1), (grid[x] for x in near), strict=True)
                grid[beyond] = added(*terms)
    return grid


for kind, faces in product(("interior", "cone", "crease", "corner", "dart"), (5, 7)):
    for p in range(1 if kind in ("interior", "cone") else faces):
        sector = LOOP.sector(kind, faces, p)
        matrix = subdivision_matrix(LOOP, sector)
        before = triangles_of(sector, [{k: Fraction(1)} for k in range(sector.size)])
        after = triangles_of(sector, matrix.rows[: sector.size + len(sector.beyond)])
        assert len(before) >= 10
        for (i, j), row in after.items():
            if (i, j) not in [(1, 1), (2, 0), (0, 2)]:
                terms = [(w, before[place]) for place, w in regular_rule(i, j).items()]
                assert added(*terms) == row, (sector, i, j)

# %% [markdown]
# The five outer points drive nothing either: their block has $1/8$ three times and $1/16$ twice,
# and with its left eigenvectors the row sums of $\left| W \right| \left| W^{-1} \right|$ are $5$
# at most. Rings of more than $64$ triangles fall by more than $0.62$, so that
# patches may begin as many steps before as in quads.

# %%
OUTER = [(3, 0), (3, 1), (2, 2), (1, 3), (0, 3)]
A_o = Matrix(5, 5, lambda m, k: Rational(regular_rule(*OUTER[m]).get(OUTER[k], 0)))
W, D = A_o.diagonalize()
assert sorted(D[k, k] for k in range(5)) == [Rational(1, 16)] * 2 + [Rational(1, 8)] * 3
bound = W.applyfunc(abs) * W.inv().applyfunc(abs)
assert max(sum(bound.row(k)) for k in range(5)) == 5
assert 40 * 3 - 40 * np.log2(1 / 0.622) > 92

# %% [markdown]
# The slowest waves have $\lambda = \frac38 + \frac14 \cos\kappa$, with the same $\kappa$ as in
# quads ([3](wide_rings.py#3-rings-of-many-faces-keep-their-digits)): rings of triangles lose no
# more than five binary digits.


# %%
def loop_value(kappa):
    return 3 / 8 + np.cos(kappa) / 4


for faces in range(65, 1000):
    turn = 2 * np.pi / faces
    assert (loop_value(turn) / loop_value(turn / 2)) ** 1074 > 0.2
    assert (loop_value(turn) / loop_value(0)) ** 1074 > 0.1
    assert (loop_value(1.5 * turn) / loop_value(turn)) ** 1074 > 0.05
    assert loop_value(1.5 * turn) > 0.622

# %% [markdown]
# On a curve, $t = 0$, points inside have weights of their own and the opposite ones from
# reflections. Where what is beyond the curve is given to what it comes from, exactly, none of them
# is left in the terms without $t$, and so none in the value.

# %%
for powers, row in zip(QUARTIC.exponents, QUARTIC.pieces, strict=True):
    own = dict(zip(QUARTIC.template, row, strict=True))
    for i, j in QUARTIC.template:
        if j == 0:
            weight = own.pop((i, 0))
            for place, factor in (((i, 1), 1), ((i - 1, 1), 1), ((i - 1, 2), -1)):
                own[place] += factor * weight
    if powers[1] == 0:
        assert not any(w for (_, j), w in own.items() if j > 1)
