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
"""Sharp and semi-sharp creases: splines of fewer variables, phantom points, and strips.

After Hoppe et al. (1994), DeRose, Kass and Truong (1998) and Niessner, Loop and Greiner (2012).

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Sharp and semi-sharp creases
#
# Along an infinitely sharp crease the limit is a cubic spline curve of the crease's own points, and
# beside it the surface is a bicubic spline, continued by phantom points, in sectors of two faces
# and at corners of one, and nowhere else. Along a semi-sharp crease of sharpness $s$ that continues
# regularly it consists of $\lceil s \rceil + 1$ bicubic strips.
#
# - H. Hoppe et al., "Piecewise smooth surface reconstruction", SIGGRAPH 1994: sharp rules.
# - T. DeRose, M. Kass, T. Truong, "Subdivision surfaces in character animation", SIGGRAPH 1998:
#   semi-sharp creases, and their fractional sharpness.
# - M. Niessner, C. Loop, G. Greiner, "Efficient evaluation of semi-smooth creases in Catmull-Clark
#   subdivision surfaces", Eurographics 2012 short papers: strips across a semi-sharp crease.

# %%
from fractions import Fraction
from itertools import pairwise, product
from math import ceil, inf

from sympy import Matrix, Rational, Symbol, expand, kronecker_product, symbols

HALF, EIGHTH = Rational(1, 2), Rational(1, 8)

# %% [markdown]
# ## 1. Sharp: splines of one variable and of none
#
# Knot insertion for a uniform cubic B-spline curve ([masks_bicubic](masks_bicubic.py), section 1)
# makes of its control points

# %%
EVEN = {-1: EIGHTH, 0: 6 * EIGHTH, 1: EIGHTH}  # near an old control point
ODD = {0: HALF, 1: HALF}  # between two of them


def inserted(rule, points, i):
    return sum(weight * points[i + k] for k, weight in rule.items())


# %% [markdown]
# A sharp crease is a curve of the surface's own points and looks at nothing beside it: an edge
# becomes $(a + b) / 2$ and a vertex of two sharp edges $(a + 6v + b) / 8$. So the limit along it is
# the cubic B-spline of its polygon, exactly, whatever lies on either side. A corner (three or more
# sharp edges, or a sharp vertex) is a spline of no variable: it stays.
#
# A crease that runs into a corner $p$, next point $x$, ends there: continue its polygon by the
# reflection $2p - x$. Knot insertion leaves $p$ where it is and keeps the reflection, at every
# level; the limit curve starts at $p$ with derivative $x - p$ and second derivative 0.

# %%
p, x, y = symbols("p x y")
polygon = [2 * p - x, p, x, y]
new_p, new_x = inserted(EVEN, polygon, 1), inserted(ODD, polygon, 1)
assert expand(new_p - p) == 0
assert expand(inserted(ODD, polygon, 0) - (2 * new_p - new_x)) == 0
before, at, after = polygon[:3]
assert expand((before + 4 * at + after) / 6 - p) == 0
assert expand((after - before) / 2 - (x - p)) == 0
assert expand(before - 2 * at + after) == 0

# %% [markdown]
# ## 2. Phantom points
#
# Is a face beside a sharp crease a bicubic spline? The faces of a vertex between one crease edge
# and the next are a *sector*; nothing passes from one sector of a vertex to another but the points
# of the crease. In a sector of two faces continue the grid over the crease, row $b$, by reflections
# $2b - i$ of its inner row $i$; then the crease rules are knot insertion and phantoms stay
# phantoms:

# %%
b, inner = symbols("b:3"), symbols("i:3")
grid = {(k, 0): 2 * b[k] - inner[k] for k in range(3)}
grid |= {(k, 1): b[k] for k in range(3)} | {(k, 2): inner[k] for k in range(3)}


def grid_inserted(along, across, i, j, points=grid):
    return sum(r * s * points[i + k, j + m] for k, r in along.items() for m, s in across.items())


for along, k in ((EVEN, 1), (ODD, 0)):
    phantom, crease, inside = (
        grid_inserted(along, rule, k, j) for rule, j in ((ODD, 0), (EVEN, 1), (ODD, 1))
    )
    assert expand(crease - inserted(along, b, k)) == 0
    assert expand(phantom - (2 * crease - inside)) == 0

# %% [markdown]
# The other sector of the same vertex has phantoms of its own: two splines, one curve. A corner with
# one face in the sector is a reflection in both directions, with the phantom $4p - 2x - 2y + o$
# beyond it ($o$ is the opposite corner of the face):

# %%
o = Symbol("o")
grid = {(1, 1): p, (2, 1): x, (1, 2): y, (2, 2): o}
grid |= {(0, 1): 2 * p - x, (0, 2): 2 * y - o, (1, 0): 2 * p - y, (2, 0): 2 * x - o}
grid[0, 0] = 4 * p - 2 * x - 2 * y + o
assert expand(grid_inserted(EVEN, EVEN, 1, 1, grid) - p) == 0
assert expand(grid_inserted(ODD, EVEN, 1, 1, grid) - (p + x) / 2) == 0
assert expand(grid_inserted(EVEN, ODD, 1, 1, grid) - (p + y) / 2) == 0

# %% [markdown]
# Nowhere else. If a face is one bicubic polynomial, so are its eigenfunctions: an eigenvector of
# the ring, taken as control points, has a limit $g$ on the face with
# $g(u/2, v/2) = \lambda \, g(u, v)$. On polynomials halving multiplies $u^a v^b$ by $2^{-(a + b)}$:
# no other eigenvalues, and no Jordan blocks. So no choice of phantoms can be exact for
#
# - one face under the crease rule (a boundary corner in mode "edge_only"). Its ring, the points
#   $v$, $e_0$, $f_0$, $e_1$ in this order, has a Jordan block at $1/4$;
# - two faces at a sharp corner. The ring $v$, $e_0$, $f_0$, $e_1$, $f_1$, $e_2$ has one at $1/2$;
# - three faces and more. Their rings have an eigenvalue between $1/2$ and $1$
#   ([sectors](sectors.py), section 3).
#
# The dimensions of the kernels of the powers of $A - \lambda$:

# %%
one_face = Matrix([[6, 1, 0, 1], [4, 4, 0, 0], [2, 2, 2, 2], [4, 0, 0, 4]]) / 8
chain = one_face - Matrix.eye(4) / 4
assert [4 - (chain**power).rank() for power in (1, 2, 3)] == [1, 2, 2]

two_faces = (
    Matrix(
        [
            [16, 0, 0, 0, 0, 0],
            [8, 8, 0, 0, 0, 0],
            [4, 4, 4, 4, 0, 0],
            [6, 1, 1, 6, 1, 1],
            [4, 0, 0, 4, 4, 4],
            [8, 0, 0, 0, 0, 8],
        ]
    )
    / 16
)
chain = two_faces - Matrix.eye(6) / 2
assert [6 - (chain**power).rank() for power in (1, 2, 3)] == [2, 3, 3]

# %% [markdown]
# (An eigenfunction that vanished on the face would be no obstacle. These do not: the eigenvectors
# at the foot of the chains, and those of the largest eigenvalue between $1/2$ and $1$, have no
# points of opposite signs.) A dart, a vertex with one sharp edge, is no sector, and extraordinary
# at every valence, 4 included ([sectors](sectors.py), section 6).
#
# ## 3. Semi-sharp: the rule across
#
# An edge of sharpness $s > 0$ follows the sharp rules, its children have sharpness
# $\max(s - 1, 0)$, and the last step, $s < 1$, blends: $1 - s$ times the smooth mask plus $s$ times
# the sharp one. A vertex of two such edges does the same. So with $w = \min(1, s)$ each step is a
# blend, full while $s \ge 1$.
#
# Let a crease of one sharpness $s$ continue regularly: through vertices of valence 4, opposite edge
# to opposite edge. The smooth masks are products of knot insertion along and across, the sharp ones
# are knot insertion along times $(0, 1, 0)$ across. Hence the blend is a product, too, with the row
# of the crease across
#
# $$
# \frac{1 - w}{8} \, (1, 6, 1) + w \, (0, 1, 0) .
# $$

# %%
w = Symbol("w")
ACROSS = {-1: (1 - w) * EIGHTH, 0: (1 - w) * 6 * EIGHTH + w, 1: (1 - w) * EIGHTH}
mesh = {(i, j): Symbol(f"c{i}{j}") for i, j in product(range(3), repeat=2)}
for along, k in ((EVEN, 1), (ODD, 0)):
    smooth = grid_inserted(along, EVEN, k, 1, mesh)
    sharp = grid_inserted(along, {0: 1}, k, 1, mesh)
    blended = grid_inserted(along, ACROSS, k, 1, mesh)
    assert expand(blended - ((1 - w) * smooth + w * sharp)) == 0

# %% [markdown]
# "Chaikin" creasing takes 3/4 of an edge's sharpness and 1/4 of the mean of its neighbours' along
# the crease: with one sharpness, the same. For $s$ sharp steps the surface is hence a product of
# two univariate schemes: uniform cubic splines along, and across a scheme whose steps are uniform
# but for the row of the crease, and after $\lceil s \rceil$ steps uniform altogether.
#
# A face with the crease as its lower edge hangs on $4 \times 4$ points, rows $r_0, \dots, r_3$, the
# crease in $r_1$. One step makes five rows of them:

# %%
FOUR_TO_FIVE = Matrix(
    [
        [HALF, HALF, 0, 0],
        [ACROSS[-1], ACROSS[0], ACROSS[1], 0],  # the crease
        [0, HALF, HALF, 0],
        [0, EIGHTH, 6 * EIGHTH, EIGHTH],
        [0, 0, HALF, HALF],
    ]
)
assert list(FOUR_TO_FIVE * Matrix([1, 1, 1, 1])) == [1] * 5
FOUR_TO_FIVE

# %% [markdown]
# The upper half of the face hangs on the last four rows. The crease is the first of them, and the
# steps to come ask the rows $r'_1$ and $r'_2$ only for their mean: the row of the crease rule
# itself is not among the five. So the upper half is a uniform bicubic spline already, whatever $s$
# is. The lower half hangs on the first four rows, and is a face beside a crease of sharpness
# $s - 1$:
#
# - strip $i = 1, \dots, \lceil s \rceil$, $[2^{-i}, 2^{1-i}]$ of the face, hangs on the rows 1 to 4
#   of step $i$;
# - the last strip, $[0, 2^{-\lceil s \rceil}]$, hangs on the rows 0 to 3 of the last step;
#
# in all $\lceil s \rceil + 1$ uniform bicubic strips. Along the crease nothing is cut. (A face
# between two such creases is halved first; by the same argument each half sees the nearer crease
# alone.)


# %%
def steps(s):
    """Rows of step 1 ... ceil(s) on the four rows of the face."""
    lower, found = Matrix.eye(4), []
    while s > 0:
        found.append(FOUR_TO_FIVE.subs(w, min(1, s)) * lower)
        lower, s = found[-1][:4, :], s - 1
    return found


assert len(steps(Rational(47, 10))) == 5
assert len(steps(Rational(1))) == 1

# %% [markdown]
# Sharpness 0 and infinity are the ends of the family. With $w = 0$ the rows are knot insertion
# along. With $w = 1$ for ever the crease row never moves, and row 0 is drawn to its reflection, the
# phantom: its defect $r_0 - 2 r_1 + r_2$ halves at every step.

# %%
ALONG = FOUR_TO_FIVE.subs(w, 0)
assert Matrix([[4, 4, 0, 0], [1, 6, 1, 0], [0, 4, 4, 0], [0, 1, 6, 1], [0, 0, 4, 4]]) == 8 * ALONG
defect = Matrix([[1, -2, 1, 0]])
assert defect * FOUR_TO_FIVE[:4, :].subs(w, 1) == defect / 2

# %% [markdown]
# ## 4. The same by the rules in two dimensions
#
# A refiner for any mesh of quadrilaterals by the words of DeRose, Kass and Truong. It knows nothing
# of rows: points have names, a name is a place in the plane, and a new point is named by the mean
# of the old names, as it is made of the means of old points. A point is a tuple, its weights on the
# points of the first grid.


# %%
def mean(items):
    items = list(items)
    return tuple(sum(column) / len(items) for column in zip(*items, strict=True))


def blend(t, first, second):
    return tuple((1 - t) * c + t * d for c, d in zip(first, second, strict=True))


def refined(points, faces, sharpness):
    """New points by name, and the sharpness of new edges by the names of their ends."""
    around, beside = {}, {}
    for face in faces:
        for a, b in zip(face, face[1:] + face[:1], strict=True):
            around.setdefault(a, []).append(face)
            beside.setdefault(frozenset((a, b)), []).append(face)
    sharp = {e: sharpness.get(e, 0) if len(beside[e]) == 2 else inf for e in beside}
    face_point = {face: mean(points[name] for name in face) for face in faces}
    middle = {edge: mean(points[name] for name in edge) for edge in beside}

    def vertex_mask(name, edges, creases):
        v, n = points[name], len(around[name])
        if len(creases) > 2:
            return v
        if len(creases) == 2:
            return blend(Fraction(1, 2), v, mean(middle[edge] for edge in creases))
        parts = mean(face_point[face] for face in around[name]), mean(middle[e] for e in edges), v
        return tuple((q + 2 * r + (n - 3) * own) / n for q, r, own in zip(*parts, strict=True))

    new, new_sharpness = {mean(face): face_point[face] for face in faces}, {}
    for edge, its_faces in beside.items():
        smooth = blend(Fraction(1, 2), middle[edge], mean(face_point[face] for face in its_faces))
        new[mean(edge)] = blend(min(sharp[edge], 1), smooth, middle[edge])
        for name in edge:
            new_sharpness[frozenset((mean(edge), name))] = max(sharp[edge] - 1, 0)
    for name in around:
        edges = [edge for edge in beside if name in edge]
        before = [edge for edge in edges if sharp[edge] > 0]
        after = [edge for edge in edges if sharp[edge] > 1]
        ending = [sharp[edge] for edge in before if edge not in after]
        w = min(1, sum(ending) / len(ending)) if ending else 1
        masks = (vertex_mask(name, edges, creases) for creases in (after, before))
        new[name] = blend(w, *masks)
    return new, new_sharpness


def block(origin, step, count):
    """Names of count x count points, along x across, from the origin on."""
    return [
        [(origin[0] + i * step, origin[1] + j * step) for j in range(count)] for i in range(count)
    ]


def quads(names):
    return [
        (left[j], right[j], right[j + 1], left[j + 1])
        for left, right in pairwise(names)
        for j in range(len(left) - 1)
    ]


def rows_of(points, names):
    return Matrix([points[name] for column in names for name in column])


# %% [markdown]
# The face is $[0, 1]^2$, with the crease along its lower edge and beyond: the names are $(-1, -1)$
# to $(2, 2)$, the row of second coordinate 0 is sharp. At each step all $5 \times 5$ points must be
# those of the product; then so must those of the upper half one step on, where the crease is only
# near; then the same in the child at the crease, once the left one and once the right one, and one
# step longer than the crease lasts.

# %%
for s in (Fraction(3, 10), Fraction(1), Fraction(5, 2), Fraction(47, 10)):
    step, corner = Fraction(1), (Fraction(-1), Fraction(-1))
    names = block(corner, step, 4)
    flat = [name for column in names for name in column]
    points = {name: tuple(Fraction(name == other) for other in flat) for name in flat}
    sharpness = {frozenset(ends): s for ends in pairwise(column[1] for column in names)}
    along, across = Matrix.eye(4), Matrix.eye(4)
    for level in range(ceil(s) + 1):
        points, sharpness = refined(points, quads(names), sharpness)
        step, corner = step / 2, (corner[0] + step / 2, corner[1] + step / 2)
        along = ALONG * along
        across = FOUR_TO_FIVE.subs(w, min(1, max(s - level, 0))) * across
        assert rows_of(points, block(corner, step, 5)) == kronecker_product(along, across)
        assert level >= s or across == steps(s)[level]

        beyond, _ = refined(points, quads(block(corner, step, 5)), sharpness)
        upper = block((corner[0] + step / 2, corner[1] + 3 * step / 2), step / 2, 5)
        uniform = kronecker_product(ALONG * along[:4, :], ALONG * across[1:, :])
        assert rows_of(beyond, upper) == uniform

        right = level % 2
        corner = (corner[0] + right * step, corner[1])
        names = block(corner, step, 4)
        along, across = along[right : right + 4, :], across[:4, :]
