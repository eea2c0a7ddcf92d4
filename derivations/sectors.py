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
"""Crease and corner sectors, cones, darts and what a crease carries: spectra and limit positions.

After Hoppe et al. (1994), Schweitzer (1996), DeRose, Kass and Truong (1998), and Zorin and
Kristjansson (2002).

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Crease and corner sectors, cones and darts
#
# The spectra of the rings at vertices on sharp edges, for any number of faces; which eigenvalues
# have Jordan blocks, and the chains in closed form; the limit positions of all kinds, that of a
# dart by Fibonacci and Lucas numbers; that the outer points of a face add no Jordan block; how
# eigenvectors of darts are had in exact numbers and in digits; and rings that are carried along by
# a crease that does not bound them.
#
# - H. Hoppe et al., "Piecewise smooth surface reconstruction", SIGGRAPH 1994: kinds of corners.
# - T. DeRose, M. Kass, T. Truong, "Subdivision surfaces in character animation", SIGGRAPH 1998:
#   their rules for Catmull-Clark, used here as they stand.
# - J. Schweitzer, "Analysis and application of subdivision surfaces", thesis, University of
#   Washington 1996; D. Zorin, D. Kristjansson, "Evaluation of piecewise smooth subdivision
#   surfaces", The Visual Computer 18 (2002): spectra of sectors.

# %%
from sympy import (
    QQ,
    Matrix,
    Poly,
    Rational,
    Symbol,
    cancel,
    cos,
    diag,
    expand,
    fibonacci,
    lucas,
    pi,
    simplify,
    sin,
    solve,
    sqrt,
    symbols,
)
from sympy.polys.matrices import DomainMatrix

from limitsurf.exact.matrices import subdivision_matrix
from limitsurf.scheme.catmull_clark import CATMULL_CLARK
from limitsurf.scheme.sector import Sector

HALF, FOURTH, EIGHTH, SIXTEENTH = (Rational(1, 2**n) for n in (1, 2, 3, 4))
lam = Symbol("lambda")

# %% [markdown]
# ## 1. The rings
#
# Around a vertex $v$ stand $e_0, f_0, e_1, f_1, \dots$ counter-clockwise; face $j$ is
# $(v, e_j, f_j, e_{j+1})$, and all its edges but those named below are smooth. Four kinds of
# corner:
#
# - *crease*: $k$ faces between two sharp edges $e_0$ and $e_k$; $v$ moves by the crease rule. A
#   smooth boundary is this, for the faces on its one side;
# - *corner*: the same, and $v$ stays;
# - *cone*: a whole ring of $k$ faces without a sharp edge, and $v$ stays: a sharp vertex;
# - *dart*: a whole ring with one sharp edge $e_0$; $v$ moves by the smooth rule.
#
# (A sharp vertex with one sharp edge is a corner whose $e_0$ and $e_k$ are one point: both move to
# the middle of the same edge.) With "smooth" for comparison:

# %%
SECTORS = ("crease", "corner")


def ring_matrix(kind, k):
    size = 2 * k + (2 if kind in SECTORS else 1)
    one = [Matrix([[int(i == j) for j in range(size)]]) for i in range(size)]
    v, e, f = one[0], one[1::2], one[2::2]
    new_f = [(v + e[j] + f[j] + e[(j + 1) % len(e)]) / 4 for j in range(k)]
    new_e = [(v + e[j] + new_f[j - 1] + new_f[j % k]) / 4 for j in range(len(e))]
    for j in {"crease": (0, k), "corner": (0, k), "dart": (0,)}.get(kind, ()):
        new_e[j] = (v + e[j]) / 2
    match kind:
        case "corner" | "cone":
            new_v = v
        case "crease":
            new_v = (6 * v + e[0] + e[k]) / 8
        case "dart" | "smooth":
            ring = sum(e + new_f, Matrix.zeros(1, size))
            new_v = Rational(k - 2, k) * v + ring / k**2
    rows = [new_v, new_e[0]]
    for j in range(k):
        rows += [new_f[j], *new_e[j + 1 : j + 2]]
    return Matrix.vstack(*rows)


def exact(matrix):
    return DomainMatrix.from_Matrix(matrix).convert_to(QQ)


def kernels(matrix, value):
    """Dimensions of the kernels of matrix - value, of its square and of its cube."""
    first = exact(matrix - value * Matrix.eye(matrix.rows))
    powers = first, first * first, first * first * first
    return [matrix.rows - power.rank() for power in powers]


ring_matrix("crease", 2)

# %% [markdown]
# ## 2. One recurrence
#
# Take an eigenvector of value $\lambda$. The rows of two neighbouring faces and of the edge between
# them say, if $\lambda \ne \frac14$,
#
# $$
# \begin{split}
# f_j &= \frac{v + e_j + e_{j+1}}{4 \lambda - 1}, \\
# e_{j-1} + e_{j+1} &= \left( 16 \lambda + \frac{1}{\lambda} - 10 \right) e_j
#   + \left( \frac{1}{\lambda} - 6 \right) v .
# \end{split}
# $$

# %%
v, before, here, after = symbols("v e_before e e_after")
f_before, f_after = ((v + here + other) / (4 * lam - 1) for other in (before, after))
faces = [(v + here + f + other) / 4 for f, other in ((f_before, before), (f_after, after))]
assert all(cancel(new - lam * f) == 0 for new, f in zip(faces, (f_before, f_after), strict=True))
edge_row = (v + here + sum(faces)) / 4 - lam * here
recurrence = before + after - (16 * lam + 1 / lam - 10) * here - (1 / lam - 6) * v
assert cancel(edge_row - lam / (4 * (4 * lam - 1)) * recurrence) == 0

# %% [markdown]
# At $\lambda = \frac14$ the $f_j$ are not given by the $e_j$, and the same rows say
#
# $$
# e_{j+1} = -e_j - v, \qquad f_j = -f_{j-1} - 4 v .
# $$

# %%
f_before, f_after = symbols("f_before f_after")
faces = [(v + here + f + other) / 4 for f, other in ((f_before, before), (f_after, after))]
rows = [new - f / 4 for new, f in zip(faces, (f_before, f_after), strict=True)]
rows.append((v + here + sum(faces)) / 4 - here / 4)
assert solve(rows, [before, after, f_after], dict=True) == [
    {before: -here - v, after: -here - v, f_after: -f_before - 4 * v}
]

# %% [markdown]
# ## 3. Crease and corner sectors: eigenvalues
#
# $v$, $e_0$ and $e_k$ look at nothing else: the matrix is block triangular, the curve first.

# %%
curve = {
    "crease": Matrix([[6, 1, 1], [4, 4, 0], [4, 0, 4]]) / 8,
    "corner": Matrix([[2, 0, 0], [1, 1, 0], [1, 0, 1]]) / 2,
}
RIGHT = Matrix([[1, 0, -1], [1, 1, 2], [1, -1, 2]])
assert curve["crease"] * RIGHT == RIGHT * diag(1, HALF, FOURTH)
LEFT = Matrix([[4, 1, 1], [0, 3, -3], [-2, 1, 1]]) / 6
assert Matrix.eye(3) == LEFT * RIGHT
CORNER = Matrix([[1, 0, 0], [1, 1, 0], [1, 0, 1]])
assert curve["corner"] * CORNER == CORNER * diag(1, HALF, HALF)

# %% [markdown]
# So the spectrum has $1, \frac12, \frac14$ for a crease and $1, \frac12, \frac12$ for a corner, and
# the limit of the vertex is the curve's: $(4v + e_0 + e_k) / 6$ on a crease, $v$ at a corner.
#
# The interior has $v = e_0 = e_k = 0$. The recurrence is
# $e_{j-1} + e_{j+1} = 2 \, \cos(\theta) \, e_j$: sines,
#
# $$
# \begin{split}
# & e_j = E \, \sin(j\theta), \qquad f_j = F \, \sin\left((j + \tfrac12)\theta\right), \qquad
#   \theta = \frac{\pi m}{k}, \quad m = 1, \dots, k, \\
# & \lambda^2 - \frac{2 + a^2}{4} \, \lambda + \frac{1}{16} = 0, \qquad
#   a = \cos\left(\frac{\theta}{2}\right),
# \end{split}
# $$
#
# with $(E, F) = (4\lambda - 1, \; 2a)$, two values for each $m < k$, and for $m = k$ ($a = 0$,
# where only the $f_j$ are left) the value $\frac14$ once: $2k - 1$ eigenvectors of $2k - 1$ points.
# It is the part of the smooth ring of valence $2k$ ([subdivision_matrix](subdivision_matrix.py),
# section 2) that is odd about the line of the crease.

# %%
j, theta, a = symbols("j theta a", real=True)
pair = lam**2 - (2 + a**2) / 4 * lam + SIXTEENTH
cos_theta = (16 * lam + 1 / lam - 10) / 2
assert expand(pair.subs(a**2, (1 + cos_theta) / 2)) == 0
two_e = sin(j * theta) + sin((j + 1) * theta)
assert simplify(two_e - 2 * cos(theta / 2) * sin((j + HALF) * theta)) == 0

for k in range(1, 7):
    smooth, ring = ring_matrix("smooth", 2 * k), ring_matrix("crease", k)
    interior = [i for i in range(2 * k + 2) if i not in (0, 1, 2 * k + 1)]
    odd = Matrix.zeros(4 * k + 1, 2 * k - 1)
    for column, i in enumerate(interior):
        odd[i, column], odd[4 * k + 2 - i, column] = 1, -1
    assert smooth * odd == odd * ring.extract(interior, interior)

# %% [markdown]
# $a$ falls from $m = 1$ to $m = k$. With $2 \, \sinh(x) = a$ the two values are $e^{2x} / 4$ and
# $e^{-2x} / 4$ ([eigenstructure](eigenstructure.py), section 1): one above $\frac14$, falling with
# $m$, one below, rising. So the interior has no value twice, and is diagonalisable.
#
# ## 4. Jordan blocks
#
# What the curve shares with the interior: never $1$; $\frac14$ always, from $m = k$ (a crease alone
# has it in the curve); and $\frac12$, if $a^2 = \frac12$, $\theta = \pi / 2$, so $m = k/2$ and $k$
# is even.

# %%
assert solve(pair.subs(lam, HALF), a**2) == [HALF]
assert solve(pair.subs(lam, FOURTH), a**2) == [0]
assert solve(pair.subs(lam, 1), a**2) == [Rational(9, 4)]

# %% [markdown]
# Count the eigenvectors, for any $k$:
#
# - $\lambda = \frac12$. The curve says $v = 0$, the recurrence $e_{j+2} = -e_j$: $e_0$ and $e_1$
#   give all. At a corner they are free: two eigenvectors. On a crease $e_k = -e_0$. For odd $k$
#   that fixes $e_1$: one eigenvector. For $k = 2, 6, 10, \dots$ it always holds: two. For
#   $k = 4, 8, 12, \dots$ it says $e_0 = 0$: one.
# - $\lambda = \frac14$. On a crease $(v, e_0, e_k) = t \, (-1, 2, 2)$, and $e_{j+1} = t - e_j$ goes
#   $2t, -t, 2t, -t, \dots$ For even $k$ it arrives at $e_k = 2t$: $t$ and $f_0$ are free, two
#   eigenvectors. For odd $k$ only $t = 0$ does: one. At a corner $v = e_0 = 0$, and $f_0$ is free:
#   one.
#
# And the multiplicities: $\frac12$ has one (crease) or two (corner) from the curve and one more for
# even $k$; $\frac14$ has two on a crease and one at a corner. The difference is one Jordan block of
# size two:
#
# | sector | Jordan block of size two |
# | --- | --- |
# | crease, $k$ odd | at $\frac14$ |
# | crease, $k = 2, 6, 10, \dots$ | none |
# | crease, $k = 4, 8, 12, \dots$ | at $\frac12$ |
# | corner, $k$ odd | none |
# | corner, $k$ even | at $\frac12$ |

# %%
assert recurrence.subs({v: 0, lam: HALF}) == before + after


def blocks(kind, k):
    """Values with a Jordan block of size two."""
    if kind == "corner":
        return {HALF} if k % 2 == 0 else set()
    return {FOURTH} if k % 2 else {HALF} if k % 4 == 0 else set()


for kind in SECTORS:
    for k in range(1, 14):
        ring = ring_matrix(kind, k)
        assert kernels(ring, 1) == [1, 1, 1]
        for value in (HALF, FOURTH):
            first, second, third = kernels(ring, value)
            multiplicity = curve[kind].eigenvals().get(value, 0) + (value == FOURTH or k % 2 == 0)
            assert second == third == multiplicity
            assert second - first == (value in blocks(kind, k))

# %% [markdown]
# The chains in closed form: $(A - \lambda) \, g = c \, p$, with $p$ in the interior. At
# $\lambda = \frac12$, with $c = 1 / (3k)$,
#
# $$
# \begin{array}{ll}
# p: & v = 0, \quad e_j = \sin\left(\frac{j\pi}{2}\right), \quad f_j = e_j + e_{j+1}, \\
# g: & v = 0, \quad e_j = \left(1 - \frac{2j}{k}\right) \, \cos\left(\frac{j\pi}{2}\right), \quad
#   f_j = e_j + e_{j+1} - 4c \, (f_j \text{ of } p),
# \end{array}
# $$
#
# and at $\lambda = \frac14$, with $c = 3 / (4k)$,
#
# $$
# \begin{array}{ll}
# p: & v = 0, \quad e_j = 0, \quad f_j = (-1)^j, \\
# g: & v = -1, \quad e_j = \frac12 \left( 1 + 3 (-1)^j \left(1 - \frac{2j}{k}\right) \right), \quad
#   f_j = 2 .
# \end{array}
# $$

# %%
WAVE = [0, 1, 0, -1]  # sin(j pi / 2); cos(j pi / 2) is the next one


def chain(value, k):
    p, g = [0], [0] if value == HALF else [-1]
    c = Rational(1, 3 * k) if value == HALF else Rational(3, 4 * k)
    for j in range(k + 1):
        if value == HALF:
            p += [WAVE[j % 4], WAVE[j % 4] + WAVE[(j + 1) % 4]]
            e, following = ((1 - Rational(2 * i, k)) * WAVE[(i + 1) % 4] for i in (j, j + 1))
            g += [e, e + following - 4 * c * p[-1]]
        else:
            p += [0, (-1) ** j]
            g += [(1 + 3 * (-1) ** j * (1 - Rational(2 * j, k))) / 2, 2]
    return c, Matrix(p[:-1]), Matrix(g[:-1])


for kind in SECTORS:
    for k in range(1, 14):
        for value in blocks(kind, k):
            shifted = ring_matrix(kind, k) - value * Matrix.eye(2 * k + 2)
            c, p, g = chain(value, k)
            assert shifted * g == c * p
            assert shifted * p == Matrix.zeros(2 * k + 2, 1)

# %% [markdown]
# Powers: no block is larger than two, and by induction
#
# $$
# J = \begin{pmatrix} \lambda & 1 \\ 0 & \lambda \end{pmatrix}, \qquad
# J^n = \begin{pmatrix} \lambda^n & n \lambda^{n-1} \\ 0 & \lambda^n \end{pmatrix},
# $$
#
# so that $A^n g = \lambda^n g + n \lambda^{n-1} c \, p$: along a chain things shrink like
# $n \lambda^n$.

# %%
n = Symbol("n", integer=True, positive=True)
J = Matrix([[lam, 1], [0, lam]])
power = Matrix([[lam**n, n * lam ** (n - 1)], [0, lam**n]])
assert power.subs(n, 1) == J
assert simplify(power * J - power.subs(n, n + 1)) == Matrix.zeros(2, 2)

# %% [markdown]
# ## 5. Cones
#
# $v$ stays, and its limit is itself. With $v = 0$ all waves around the ring are eigenvectors, those
# of frequency 0 included: $\theta = 2\pi f / k$, $f = 0, \dots, k - 1$. For $f > 0$ they are those
# of the smooth ring; $f = 0$ has $a = 1$ and the values $(3 \pm \sqrt{5}) / 8$,

# %%
assert set(solve(pair.subs(a, 1), lam)) == {(3 - sqrt(5)) / 8, (3 + sqrt(5)) / 8}

# %% [markdown]
# and its upper value, 0.654, is larger than that of any other frequency, at every valence. Each
# wave has two different values ($a = 0$ one, once), so there are no Jordan blocks. The waves
# against the matrix itself: both characteristic polynomials at $\lambda = 1/7$ and $2/3$.

# %%
for k in range(2, 8):
    for value in (Rational(1, 7), Rational(2, 3)):
        waves = 1 - value
        for f in range(k):
            waves *= pair.subs({lam: value, a: cos(f * pi / k)})
        whole = exact(ring_matrix("cone", k) - value * Matrix.eye(2 * k + 1)).det()
        assert abs((Rational(whole.numerator, whole.denominator) - waves).evalf(60)) < 10**-50

# %% [markdown]
# ## 6. Darts
#
# The ring is symmetric about its sharp edge $e_0$. The odd waves are zero there and notice nothing:
# those of the smooth ring, sines with $\theta = 2\pi m / N$, $0 < m < N/2$, and for even $N$ the
# value $\frac14$ once. The even part has the other $N + 2$ dimensions. From the row of $e_0$,
#
# $$
# e_0 = \frac{v}{2\lambda - 1},
# $$
#
# and from there the recurrence goes around symmetrically; the row of $v$ is the equation for
# $\lambda$. No closed roots; but the characteristic polynomial is rational, and tells all:


# %%
def even_part(ring):
    """On v, e_0, f_0, e_1, ..., halfway around."""
    size = ring.rows
    half = (size + 3) // 2
    fold = Matrix.zeros(size, half)
    for i in range(size):
        fold[i, i if i < half else size + 1 - i] = 1
    assert ring * fold == fold * (ring * fold)[:half, :]
    return (ring * fold)[:half, :]


def even_polynomial(n):
    return Poly(exact(even_part(ring_matrix("dart", n))).charpoly(), lam, domain=QQ)


for n in range(2, 22):
    polynomial = even_polynomial(n)
    assert polynomial.degree() == n + 2
    assert polynomial.is_sqf

    # Not all its roots are real: here one pair is complex, for most darts of 6 faces and more.
    pairs = 0 if n < 6 or n == 20 else 1
    assert polynomial.count_roots() == n + 2 - 2 * pairs

    # Its rational roots are few.
    rational = {Rational(1)} | {HALF for _ in range(n % 4 == 0)}
    rational |= {3: {Rational(0), Rational(1, 6)}, 4: {FOURTH}}.get(n, set())
    assert set(polynomial.ground_roots()) == rational

even_polynomial(3).as_expr().factor()

# %% [markdown]
# All roots are simple (the polynomial is square free), so the even part has no Jordan blocks; nor
# has the odd part, whose waves have different values. What the two share, such as $\frac12$ where 4
# divides $N$, has one even and one odd eigenvector. The ring of a dart is diagonalisable, over the
# complex numbers: the pair is a block of two in the real Jordan form. It is not among the largest
# values ([limit_normals](limit_normals.py), section 4).
#
# The limit of the vertex is closed. A left eigenvector of value 1 has $N^2$ on $v$, and with $z_j$
# on the $e_j$, but $z_0 = z_N = 0$ (an edge point $e_0$ tells the others nothing), and $y_j$ on the
# $f_j$,
#
# $$
# 12 y_j = 4 + z_j + z_{j+1}, \qquad z_{j-1} + z_{j+1} = 7 z_j - 20 .
# $$
#
# $z_j = 4$ is a solution; the homogeneous ones are powers of $(7 \pm 3 \sqrt{5}) / 2$, the fourth
# power of the golden ratio and its inverse. So with Fibonacci and Lucas numbers, $L_{-n} = L_n$ for
# even $n$, the mask is
#
# $$
# \begin{array}{ll}
# v: & N^2, \\
# e_0: & 10 \, F_{2N} / L_{2N}, \\
# e_j: & 4 \left( 1 - L_{2N - 4j} / L_{2N} \right), \\
# f_j: & 1 - L_{2N - 4j - 2} / L_{2N},
# \end{array}
# $$
#
# divided by the sum of its weights, $N (N + 5) - 4 F_{2N} / L_{2N}$. (The smooth mask is $N^2$, 4,
# 1 over $N (N + 5)$.)

# %%
N = Symbol("N", positive=True)
z_before, z_here, z_after, y_before, y_here = symbols("z_before z z_after y_before y")
column_f = N**2 / (4 * N**2) + (z_here + z_after) / 16 + y_here / 4
assert solve(column_f - y_here, y_here) == [(4 + z_here + z_after) / 12]
column_e = 3 * N**2 / (2 * N**2) + 3 * z_here / 8 + (z_before + z_after) / 16
column_e += (8 + z_before + 2 * z_here + z_after) / 48
assert expand(12 * (z_here - column_e) - (7 * z_here - 20 - z_before - z_after)) == 0


def dart_mask(n):
    def ratio(index):
        return lucas(abs(index)) / lucas(2 * n)

    mask = [n**2]
    for j in range(n):
        mask += [4 * (1 - ratio(2 * n - 4 * j)), 1 - ratio(2 * n - 4 * j - 2)]
    ends = fibonacci(2 * n) / lucas(2 * n)
    mask[1] = 10 * ends
    assert sum(mask) == n * (n + 5) - 4 * ends
    return Matrix([mask])


for n in range(2, 22):
    assert exact(dart_mask(n)) * exact(ring_matrix("dart", n)) == exact(dart_mask(n))

dart_mask(4)

# %% [markdown]
# ## 7. The points of a face
#
# The limit on face $i$ hangs on the ring and on the outer points of
# [subdivision_matrix](subdivision_matrix.py), section 4. On the grid of the face, $(1, 1)$ being
# $v$, $(2, 1)$ $e_i$, $(2, 2)$ $f_i$ and $(1, 2)$ $e_{i+1}$, they refine by products of lines,
# except at a sharp edge. If $e_i$ is sharp, line $(\cdot, 1)$ is a crease: across it its new points
# are its old ones, and nothing is needed beyond: no line $(\cdot, 0)$. Likewise line $(1, \cdot)$
# if $e_{i+1}$ is sharp.

# %%
OUTER = [(3, 0), (3, 1), (3, 2), (3, 3), (2, 3), (1, 3), (0, 3)]
LINES = {  # new line: weights of old lines
    0: {0: HALF, 1: HALF},
    1: {0: EIGHTH, 1: 6 * EIGHTH, 2: EIGHTH},
    2: {1: HALF, 2: HALF},
    3: {1: EIGHTH, 2: 6 * EIGHTH, 3: EIGHTH},
}


def grid_row(place, creases=(False, False)):
    first, second = (
        {1: Rational(1)} if crease and line == 1 else LINES[line]
        for line, crease in zip(place, creases, strict=True)
    )
    return {(x, y): r * s for x, r in first.items() for y, s in second.items()}


def extended_matrix(kind, k, i):
    ring = ring_matrix(kind, k)
    around, sectors = 2 * k, kind in SECTORS
    low = kind != "cone" and i == 0
    left = kind != "cone" and i == k - 1

    def point(turn):
        return 1 + (2 * i + turn if sectors else (2 * i + turn) % around)

    at = {(1, 1): 0, (2, 1): point(0), (2, 2): point(1), (1, 2): point(2)}
    if not left:
        at |= {(0, 2): point(3), (0, 1): point(4)}
    if not low:
        at |= {(2, 0): point(-1), (1, 0): point(-2)}
    outer = [(x, y) for x, y in OUTER if (x or not left) and (y or not low)]
    at |= {place: ring.rows + m for m, place in enumerate(outer)}
    whole = diag(ring, Matrix.zeros(len(outer)))
    for place in outer:
        for old, weight in grid_row(place, (left, low)).items():
            whole[at[place], at[old]] += weight
    return whole, len(outer)


# %% [markdown]
# The values of the outer points are $\frac18$ and $\frac1{16}$ twice, $\frac1{64}$, and
# $\frac1{32}$ twice, or once for a face with one sharp edge at $v$, or never with two. They have as
# many eigenvectors.

# %%
OUTER_VALUES = (EIGHTH, SIXTEENTH, SIXTEENTH / 2, SIXTEENTH / 4)
for kind, k, i, times in (
    ("cone", 3, 0, 2),
    ("crease", 3, 1, 2),
    ("crease", 3, 2, 1),
    ("dart", 3, 0, 1),
    ("crease", 1, 0, 0),
):
    whole, count = extended_matrix(kind, k, i)
    outer = whole[-count:, -count:]
    for value, multiplicity in zip(OUTER_VALUES, (2, 2, times, 1), strict=True):
        assert kernels(outer, value) == [multiplicity] * 3

# %% [markdown]
# *Claim*: the outer points add no Jordan block, at no face of no kind. A vector of the ring with a
# value that no outer point has extends in one way, chains included. What remains is a value common
# to both. The curve and the cone's waves of frequency 0 have none, other waves only $\frac18$, the
# partner of $\frac12$:

# %%
assert [solve(pair.subs(lam, value), a**2) for value in OUTER_VALUES] == [
    [HALF],
    [Rational(9, 4)],
    [Rational(49, 8)],
    [Rational(225, 16)],
]

# %% [markdown]
# The even part of a dart has none, at any $N$. The row of $v$ says, with $S$ the sum of all $e_j$,
#
# $$
# (6\lambda - 1) \, S = \left( (4\lambda - 1)(\lambda - 1) N^2 + (7\lambda - 2) N \right) v .
# $$

# %%
S = Symbol("S")
sum_f = (N * v + 2 * S) / (4 * lam - 1)
row = (1 - 7 / (4 * N)) * v + 3 * S / (2 * N**2) + sum_f / (4 * N**2) - lam * v
demanded = (6 * lam - 1) * S - ((4 * lam - 1) * (lam - 1) * N**2 + (7 * lam - 2) * N) * v
assert cancel(row * N**2 * (4 * lam - 1) - demanded) == 0

# %% [markdown]
# The recurrence has the constant solution $e_j = \rho v$; $d_j = e_j - \rho v$, which starts with
# $d_0 = v / (2\lambda - 1) - \rho v$, is a wave symmetric about $N/2$. Below $\frac18$ it is
# hyperbolic, and with $\cosh(t)$ in the place of $\cos(\theta)$ it adds up to
# $d_0 \, T \, \coth(t/2)$, $T = \tanh(N t / 2)$. ($v = 0$ leaves nothing.) What is demanded is
# linear in $T$, and of one sign for $0 < T \le 1$:

# %%
rho = (6 * lam - 1) / (16 * lam**2 - 12 * lam + 1)
assert cancel(recurrence.subs({before: rho, here: rho, after: rho, v: 1})) == 0
T = Symbol("T")
for value in OUTER_VALUES[1:]:
    cosh = cos_theta.subs(lam, value)
    wave_sum = (1 / (2 * lam - 1) - rho) * T * sqrt((cosh + 1) / (cosh - 1))
    form = expand(demanded.subs({S: rho * N + wave_sum, v: 1}).subs(lam, value))
    assert max(root for end in (0, 1) for root in solve(form.subs(T, end), N)) < 10
    for count in range(2, 11):
        start, end = (form.subs({N: count, T: end}) for end in (0, 1))
        assert start * end > 0 or (start == 0 != end)

# %% [markdown]
# At $\frac18$ it has period 4, $(d_0, d_1, -d_0, -d_1)$, with $d_0 = -\frac73 v$. Symmetry,
# $d_N = d_0$ and $d_{N-1} = d_1$, leaves for $N = 4m$ the sum 0, for $4m + 1$ the sum $d_0$, for
# $4m + 3$ the sum $-d_0$ and for $4m + 2$ only $v = 0$, then with sum $d_1 = S = 0$. The others
# would need an $N$ that is not of their form, or not whole:

# %%
at_eighth = demanded.subs({lam: EIGHTH, v: 1})
assert (1 / (2 * lam - 1) - rho).subs(lam, EIGHTH) == Rational(-7, 3)
assert solve(at_eighth.subs(S, N), N) == [2]  # not 4 m
for wave_sum in (Rational(-7, 3), Rational(7, 3)):
    assert not any(root.is_integer for root in solve(at_eighth.subs(S, N + wave_sum), N))

# %% [markdown]
# So $\frac18$ in the waves is left, at even $k$ and at $N = 4m$.
#
# There $v = 0$, $e_{j+2} = -e_j$ and $f_j = -2 (e_j + e_{j+1})$. As in
# [eigenstructure](eigenstructure.py), section 3, the left outer eigenvectors of $\frac18$ must not
# see the wave. Away from sharp edges they are $(1, 4, 1)$ along the outer sides; at a sharp edge
# the side's is the end point of the crease alone, which hangs on $v$ and its neighbour on the
# crease, both zero.

# %%
x, y = symbols("e_i e_i+1")
wave = {(1, 1): 0, (2, 1): x, (1, 2): y, (0, 1): -x, (1, 0): -y}
wave |= {(2, 2): -2 * (x + y), (0, 2): -2 * (y - x), (2, 0): -2 * (x - y)}
for side in (((3, 0), (3, 1), (3, 2)), ((0, 3), (1, 3), (2, 3))):
    seen = (
        mask * weight * wave.get(old, 0)
        for mask, place in zip((1, 4, 1), side, strict=True)
        for old, weight in grid_row(place).items()
    )
    assert expand(sum(seen)) == 0

# %% [markdown]
# So the law of section 4 is the law of the whole matrix. By ranks, at every face:

# %%
for kind, sizes in (
    ("crease", range(1, 9)),
    ("corner", range(1, 9)),
    ("dart", range(3, 9)),
    ("cone", range(2, 9)),
):
    for k in sizes:
        for i in range(k):
            whole, _ = extended_matrix(kind, k, i)
            defective = blocks(kind, k) if kind in SECTORS else set()
            for value in (HALF, FOURTH, *OUTER_VALUES):
                first, second, third = kernels(whole, value)
                assert second == third == first + (value in defective)

# %% [markdown]
# ## 8. The even part of a dart
#
# Its eigenvalues have no closed form. In exact numbers its eigenvectors are polynomials in the
# eigenvalue. Let $p(x) = \det(x - M) = \sum_k c_k x^k$ have simple roots and the degree $m$, and
# let $B(x) = \sum_k B_k x^k$ be the adjugate of $x - M$: by Horner's scheme $B_{m-1} = I$ and
# $B_{k-1} = M B_k + c_k I$. From
#
# $$
# (x - M) \, B(x) = B(x) \, (x - M) = p(x) \, I, \qquad \operatorname{tr} B(x) = p'(x)
# $$
#
# the columns of $B(\lambda)$ are right eigenvectors, its rows are left ones, and as each eigenvalue
# has but one of each, $B(\lambda) = p'(\lambda) \, r \, l$ with $l \, r = 1$: the left eigenvector
# that belongs to a column is a row over $p'(\lambda)$. A residual that vanishes modulo an
# irreducible factor of $p$ vanishes at all its roots.


# %%
def adjugate(M):
    """Of lambda - M."""
    coefficients = Poly(exact(M).charpoly(), lam, domain=QQ).all_coeffs()
    step = total = Matrix.eye(M.rows)
    for c in coefficients[1:-1]:
        step = M * step + c * Matrix.eye(M.rows)
        total = lam * total + step
    return total.applyfunc(expand)


def polynomials(matrix):
    return DomainMatrix.from_Matrix(matrix).convert_to(QQ[lam])


for n in (3, 6):
    M, p = even_part(ring_matrix("dart", n)), even_polynomial(n)
    one, B = Matrix.eye(n + 2), polynomials(adjugate(M))
    assert polynomials(lam * one - M) * B == polynomials(p.as_expr() * one)
    slope = p.diff().as_expr()
    assert expand(B.to_Matrix().trace() - slope) == 0
    # B B = p' B at the roots: the product of a column and a row whose product is p'
    for x in (B * B - polynomials(slope * one) * B).to_Matrix():
        assert Poly(x, lam, domain=QQ).rem(p) == 0

# %% [markdown]
# If two roots are complex and all others real (section 6 has found no other case), their sum and
# their product follow from two coefficients of $p$, and with modulus $r$ and argument $\alpha$
# powers are $r^n \cos(n\alpha) \pm i \, r^n \sin(n\alpha)$. For the eigenvector $x + i y$ of
# $a + i b$
#
# $$
# A x = a x - b y, \qquad A y = b x + a y .
# $$
#
# An outer point of eigenvalue $d$ follows (section 3 of [eigenstructure](eigenstructure.py)) by two
# equations instead of one, with the numerators $g$ and $h$ and $c = a - d$:
#
# $$
# \begin{pmatrix} G_x & G_y \end{pmatrix} \begin{pmatrix} c & b \\ -b & c \end{pmatrix} =
# \begin{pmatrix} g & h \end{pmatrix}, \qquad
# G_x = \frac{g c + h b}{c^2 + b^2}, \quad G_y = \frac{h c - g b}{c^2 + b^2} .
# $$

# %%
b, c, d, g, h = symbols("b c d g h")
turn = Matrix([[c, b], [-b, c]])
pair_of_two = Matrix([[g * c + h * b, h * c - g * b]]) / (c**2 + b**2)
assert simplify(pair_of_two * turn - Matrix([[g, h]])) == Matrix.zeros(1, 2)

# %% [markdown]
# In digits all eigenvectors are found at once. Let $Z$ be approximate ones in float64, $x$ what is
# known of one by now, $\lambda$ of its eigenvalue, and $r = A x - \lambda x$ its residual. With
# $d = Z^{-1} r$ the next ones are
#
# $$
# \lambda' = \lambda + d_j, \qquad x' = x + \sum_{i \ne j} \frac{d_i}{\lambda - \lambda_i} z_i .
# $$
#
# Were $Z$ and all $\lambda_i$ true and $x = z_j + \varepsilon$, that would leave nothing of first
# order in $\varepsilon$: with $\varepsilon = \sum e_i z_i$ and $\lambda = \lambda_j + \delta$ is
# $d_i = (\lambda_i - \lambda) \, e_i$, and $d_j = -\delta \, (1 + e_j)$. As $Z$ is true to some
# sixteen digits, so many are added each time, less those of the quotients of close eigenvalues. All
# digits are needed of $r$ alone, which costs little where $A$ is sparse.

# %%
e, delta = symbols("e:3"), symbols("delta")
J = diag(*symbols("J:3"))
j = 1  # in the basis of true eigenvectors
x = Matrix(3, 1, lambda i, _: e[i] + int(i == j))
value = J[j, j] + delta
r = J * x - value * x
later = x + Matrix(3, 1, lambda i, _: r[i] / (value - J[i, i]) if i != j else 0)
assert simplify(later - Matrix(3, 1, lambda i, _: (1 + e[j]) * int(i == j))) == Matrix.zeros(3, 1)
assert expand(value + r[j] - J[j, j] + delta * e[j]) == 0

# %% [markdown]
# ## 9. Pendants and flaps
#
# Through a vertex $v$ runs a crease of edges of three and more faces each, from $p_1$ to $p_2$. Not
# all faces at $v$ need lie between these two edges. A *pendant* is a whole ring of $k$ faces
# without a sharp edge, a cone but for $v$; a *flap* begins and ends at one of the two edges, a
# corner with $e_0 = e_k = p_1$ but for $v$. Both are carried along by a curve that they do not
# contain. Of its three points they need but two: with $m = (p_1 + p_2) / 2$
#
# $$
# v' = \frac{6v + p_1 + p_2}{8} = \frac{3v + m}{4}, \qquad m' = \frac{v + m}{2},
# $$
#
# with the eigenvalues $1$ and $\frac14$; the $\frac12$ of $p_1 - p_2$ has no part in $v$. So one
# more point, $m$, makes the ring closed, and in $c = (2v + m) / 3$, which stays, and
# $t = \frac23 (m - v)$, $t' = t/4$, it is the cone or corner about $c$ that $t$ stirs:
# $v = c - t/2$. The spectrum is that of the cone or corner, and one $\frac14$. The limit of $v$ is
# $c$.


# %%
def carried_matrix(still, k):
    ring = ring_matrix(still, k)
    last = ring.rows
    whole = diag(ring, HALF)
    whole[0, 0], whole[0, last], whole[last, 0] = 3 * FOURTH, FOURTH, HALF
    return whole


crease = curve["crease"]
middle = Matrix([[1, 0, 0], [0, HALF, HALF]])
pair_of_curve = carried_matrix("cone", 2).extract([0, -1], [0, -1])
assert middle * crease == pair_of_curve * middle
c, t = Matrix([[2, 1]]) / 3, Matrix([[-2, 2]]) / 3
assert c * pair_of_curve == c
assert t * pair_of_curve == t / 4
assert Matrix([[1, 0]]) == c - t / 2

# %% [markdown]
# The eigenvector of $\frac14$ has $v = -1$, $m = 2$, and the rows of section 2,
# $e_{j+1} = 1 - e_j$ and $f_j = 4 - f_{j-1}$. In a pendant $e_j = \frac12$, $f_j = 2$ is a solution
# for every $k$: *no Jordan block*. In a flap the rows of $e_0$ and $e_k$ say
# $(v + e_0) / 2 = e_0 / 4$, so $e_0 = e_k = 2$: the ring of $p_1$ and $p_2$ alike, the very vector
# of a crease of $k$ faces. So, as there, it exists for even $k$; for odd $k$ *it heads a Jordan
# chain at* $\frac14$, the one of section 4. With that of the corner at $\frac12$ for even $k$ there
# is one block of size two in every flap.

# %%
for k in range(2, 14):
    pendant = carried_matrix("cone", k)
    vector = Matrix([-1, *[HALF, 2] * k, 2])
    assert pendant * vector == vector / 4
    for value in (HALF, FOURTH):
        first, second, third = kernels(pendant, value)
        assert (
            first
            == second
            == third
            == kernels(ring_matrix("cone", k), value)[0] + (value == FOURTH)
        )
for k in range(1, 14):
    flap = carried_matrix("corner", k)
    if k % 2:
        scale, p, g = chain(FOURTH, k)
        p, g = p.col_join(Matrix([0])), g.col_join(Matrix([2]))
        assert (flap - FOURTH * Matrix.eye(2 * k + 3)) * g == scale * p
    for value in (HALF, FOURTH):
        first, second, third = kernels(flap, value)
        multiplicity = kernels(ring_matrix("corner", k), value)[2] + (value == FOURTH)
        assert second == third == multiplicity
        assert second - first == (value == (FOURTH if k % 2 else HALF))

# %% [markdown]
# An outer point has no eigenvalue $\frac14$ (section 7): nothing is added there.
#
# ## 10. The matrices of the package

# %%
for kind, sizes in (
    ("crease", range(1, 6)),
    ("corner", range(1, 6)),
    ("dart", range(2, 6)),
    ("cone", range(3, 6)),
):
    for k in sizes:
        for i in range(k if kind != "cone" else 1):
            whole, _ = extended_matrix(kind, k, i)
            built = subdivision_matrix(CATMULL_CLARK, Sector(kind, k, i))
            assert whole.rows == built.size
            for row, derived in zip(built.rows, whole.tolist(), strict=False):
                assert {c: Rational(w) for c, w in row.items()} == {
                    c: w for c, w in enumerate(derived) if w
                }

for kind, still, sizes in (("pendant", "cone", range(2, 6)), ("flap", "corner", range(1, 6))):
    for k in sizes:
        for i in range(k if kind == "flap" else 1):
            whole, _ = extended_matrix(still, k, i)
            carried = carried_matrix(still, k)
            last = carried.rows - 1
            built = subdivision_matrix(CATMULL_CLARK, Sector(kind, k, i))
            assert whole.rows + 1 == built.size
            for number, row in enumerate(built.rows[: built.size]):
                derived = (
                    carried.row(number)
                    if number <= last
                    else whole.row(number - 1).col_insert(last, Matrix([0]))
                )
                assert {c: Rational(w) for c, w in row.items()} == {
                    c: w for c, w in enumerate(derived) if w
                }
