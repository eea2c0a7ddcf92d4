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
"""Loop's scheme at creases, corners, cones and darts: spectra, Jordan blocks, phantoms, normals.

After Hoppe et al. (1994), Schweitzer (1996), Biermann, Levin and Zorin (2000).

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Loop's scheme on sharp edges
#
# The rings at vertices on creases and boundaries, at corners, cones and darts, for any number of
# faces: spectra in closed form, the Jordan blocks among them, limit positions; for which sectors
# phantom points are exact, and no others; which vertices have a limit normal, and its masks.
#
# - H. Hoppe et al., "Piecewise smooth surface reconstruction", SIGGRAPH 1994: the rules, and masks
#   of tangents.
# - J. Schweitzer, "Analysis and application of subdivision surfaces", thesis, University of
#   Washington 1996: spectra of sectors.
# - H. Biermann, A. Levin, D. Zorin, "Piecewise smooth subdivision surfaces with normal control",
#   SIGGRAPH 2000: other rules, and their masks.

# %%
from itertools import product
from math import cos as float_cos
from math import pi as PI
from math import sin as float_sin

from sympy import (
    QQ,
    Matrix,
    Poly,
    Rational,
    Symbol,
    cos,
    cot,
    expand,
    pi,
    simplify,
    sin,
    solve,
    sqrt,
    symbols,
)
from sympy.polys.matrices import DomainMatrix

HALF, FOURTH, EIGHTH, SIXTEENTH = (Rational(1, 2**n) for n in (1, 2, 3, 4))
STEPS = (1, 0), (0, 1), (-1, 1), (-1, 0), (0, -1), (1, -1)

# %% [markdown]
# ## 1. The rings
#
# Around a vertex $v$ stand $e_0, e_1, \dots$ counter-clockwise; face $j$ is $(v, e_j, e_{j+1})$.
# Four kinds of corner:
#
# - *crease*: $k$ faces between two sharp edges, with $e_0, \dots, e_k$; $v$ moves by
#   $\frac18, \frac34, \frac18$. A smooth boundary is this, for the faces on its one side;
# - *corner*: the same, and $v$ stays;
# - *cone*: a whole ring of $k$ faces without a sharp edge, and $v$ stays;
# - *dart*: a whole ring with one sharp edge $e_0$; $v$ moves by the smooth rule.


# %%
def loop_weight(n):
    return (Rational(5, 8) - (Rational(3, 8) + cos(2 * pi / n) / 4) ** 2) / n


def ring_matrix(kind, k):
    size = k + 2 if kind in ("crease", "corner") else k + 1
    last = size - 2  # of the e_j
    A = Matrix.zeros(size, size)
    for j in range(last + 1):
        sharp = (j == 0 and kind != "cone") or (j == last and kind in ("crease", "corner"))
        if sharp:
            A[1 + j, 0] = A[1 + j, 1 + j] = HALF
        else:
            A[1 + j, 0] += 3 * EIGHTH
            A[1 + j, 1 + j] += 3 * EIGHTH
            A[1 + j, 1 + (j + 1) % (last + 1)] += EIGHTH
            A[1 + j, 1 + (j - 1) % (last + 1)] += EIGHTH
    match kind:
        case "crease":
            A[0, 0], A[0, 1], A[0, size - 1] = 6 * EIGHTH, EIGHTH, EIGHTH
        case "dart":
            weight = loop_weight(k)
            A[0, :] = Matrix([[1 - k * weight, *[weight] * k]])
        case _:
            A[0, 0] = 1
    return A


ring_matrix("crease", 3)

# %% [markdown]
# ## 2. Spectra
#
# *Odd part.* Vectors with $v = e_0 = e_k = 0$ are carried into each other. The block of
# $e_1, \dots, e_{k-1}$ has $\frac38$ on the diagonal and $\frac18$ beside it; its eigenvectors are
# sines,
#
# $$
# e_j = \sin \frac{\pi m j}{k}, \qquad
# \mu_m = \frac38 + \frac14 \cos \frac{\pi m}{k}, \qquad m = 1, \dots, k - 1,
# $$
#
# all different. It is the odd part of a smooth vertex of valence $2k$.
#
# *Curve.* The points $v, e_0, e_k$ move by themselves: with $1, \frac12, \frac14$ on a crease,
# $1, \frac12, \frac12$ at a corner.
#
# *Cones.* Waves as at a smooth vertex, $\frac38 + \frac14 \cos \frac{2 \pi f}{k}$ for
# $f = 1, \dots, k - 1$, and $1, \frac58$ for $f = 0$: more than the waves.
#
# *Darts.* Vectors with $v = e_0 = 0$, $e_j = -e_{k-j}$: sines of $2 \pi f j / k$, with the waves'
# eigenvalues. The rest, the even part, is to be had from its characteristic polynomial.

# %%
x, t = symbols("x t")
added = sin(x - t) + sin(x + t) - 2 * cos(t) * sin(x)
assert expand(added, trig=True) == 0
for k in range(1, 7):
    waves = [Rational(3, 8) + cos(pi * m / k) / 4 for m in range(1, k)]
    for kind, curve in (("crease", [1, HALF, FOURTH]), ("corner", [1, HALF, HALF])):
        lam = Symbol("lambda")
        found = ring_matrix(kind, k).charpoly(lam).as_expr()
        product_of = 1
        for value in (*curve, *waves):
            product_of *= lam - value
        assert simplify(expand(found - product_of)) == 0
assert ring_matrix("cone", 3).eigenvals() == {1: 1, Rational(5, 8): 1, FOURTH: 2}

# %% [markdown]
# ## 3. Jordan blocks of the rings
#
# A curve's eigenvector goes on to the $e_j$ inside as a solution of the odd block's equation, which
# exists unless the curve's eigenvalue is one of the $\mu_m$. $\mu_m = \frac12$ is
# $\cos \frac{\pi m}{k} = \frac12$, $m = k / 3$; $\mu_m = \frac14$ is $m = 2k/3$.
#
# The reflection $j \to k - j$ takes sine $m$ to itself if $m$ is odd and to its negative if $m$ is
# even; parts of different kind do not meet.
#
# - *Crease, $\frac12$*: $e_0 = -e_k$, odd under the reflection. It meets sine $k / 3$ if that is
#   even: a Jordan block exactly for $k = 6, 12, 18, \dots$ At $k = 3, 9, \dots$ the eigenvalue is
#   double, and there is none.
# - *Crease, $\frac14$*: $e_0 = e_k = -2 v$, even, while $2k/3$ is an even $m$: no block.
# - *Corner, $\frac12$*: both kinds, one meets the sine: a Jordan block exactly for
#   $k = 3, 6, 9, \dots$
#
# That they do not only meet but make a block: the boundary's part in the equation is
# $\frac18 e_0$ at $j = 1$ and $\frac18 e_k$ at $j = k - 1$, whose product with sine $m$ is
# $\frac18 (e_0 + (-1)^{m+1} e_k) \sin \frac{\pi m}{k}$ (with $v = 0$ at $\frac12$): not zero.


# %%
def exact_rank(matrix):
    return DomainMatrix.from_Matrix(matrix).convert_to(QQ).rank()


def defect(A, value):
    """By how much the kernel of the square of A - value exceeds its own."""
    B = A - value * Matrix.eye(A.rows)
    return exact_rank(B) - exact_rank(B * B)


for k in range(1, 20):
    crease, corner = ring_matrix("crease", k), ring_matrix("corner", k)
    assert [defect(crease, value) for value in (1, HALF, FOURTH)] == [0, k % 6 == 0, 0]
    assert [defect(corner, value) for value in (1, HALF, FOURTH)] == [0, k % 3 == 0, 0]
    assert k < 3 or not any(defect(ring_matrix("cone", k), value) for value in (1, Rational(5, 8)))

# %% [markdown]
# ## 4. The points of a face
#
# Face $(v, e_i, e_{i+1})$ depends on the ring and on neighbours of $e_i$ and $e_{i+1}$: with the
# places of [loop_eigenstructure](loop_eigenstructure.py), section 2, on $(2, 0), (1, 1), (0, 2)$,
# and on $(2, -1)$ and $(-1, 2)$ unless they are beyond a sharp edge. Where they are, the corner
# $e_i$ is on that edge and has three faces there, so that $(1, -1)$ and $(2, -1)$ are phantoms
# ([masks_box_spline](masks_box_spline.py), section 6). The outer block is triangular; its
# eigenvalues are $\frac18$ for $(2, -1), (1, 1), (-1, 2)$, and for $(2, 0)$ and $(0, 2)$ they are
# $\frac1{16}$, or $\frac18$ on a sharp edge.
#
# The ring's eigenvalues are neither: $\mu_m > \frac18$, and $\frac18$ would be $m = k$. So for
# creases and corners the Jordan blocks of section 3 are all; for cones a wave $-1$ meets $\frac18$
# as it does at smooth vertices, without a block. For darts the squarefree part of the
# characteristic polynomial, put into the matrix, gives zero where there is no block:


# %%
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
    ends = dict.fromkeys(((p, q), (p + x, q + y)), 3 * EIGHTH)
    return ends | dict.fromkeys(sides, EIGHTH)


def face_matrix(kind, k, i):
    """One step on the ring and the outer points of face i."""
    ring = ring_matrix(kind, k)
    open_ring = kind in ("crease", "corner")
    n = ring.rows
    before = i == 0 and kind != "cone"  # is (v, e_i) sharp, and (v, e_(i+1))
    after = i == k - 1 and kind != "cone"
    outer = [(2, 0), (1, 1), (0, 2)]
    outer += [] if before else [(2, -1)]
    outer += [] if after else [(-1, 2)]
    size = n + len(outer)

    def unit(j):
        return Matrix([[int(j == m) for m in range(size)]])

    def e(j):
        return unit(1 + (j if open_ring else j % k))

    form = {(0, 0): unit(0), (1, 0): e(i), (0, 1): e(i + 1)}
    form |= {place: unit(n + m) for m, place in enumerate(outer)}
    if before:
        form[1, -1] = form[0, 0] + form[1, 0] - form[0, 1]
        form[2, -1] = form[1, 0] + form[2, 0] - form[1, 1]
    else:
        form[1, -1] = e(i - 1)
    if after:
        form[-1, 1] = form[0, 0] + form[0, 1] - form[1, 0]
        form[-1, 2] = form[0, 1] + form[0, 2] - form[1, 1]
    else:
        form[-1, 1] = e(i + 2)
    rows = [Matrix.hstack(ring, Matrix.zeros(n, len(outer)))]
    for place in outer:
        rows.append(sum((w * form[p] for p, w in regular(place).items()), Matrix.zeros(1, size)))
    return Matrix.vstack(*rows)


def diagonalisable(A):
    lam = Symbol("lambda")
    polynomial = Poly(A.charpoly(lam).as_expr(), lam, domain=QQ)
    exact = DomainMatrix.from_Matrix(A).convert_to(QQ)
    total, one = exact * 0, DomainMatrix.eye(A.rows, QQ)
    for c in polynomial.sqf_part().all_coeffs():
        total = total * exact + one * QQ.from_sympy(c)
    return total.is_zero_matrix


assert face_matrix("crease", 1, 0).shape == (6, 6)
assert face_matrix("crease", 4, 1).shape == (11, 11)
for k, i in ((1, 0), (2, 0), (3, 0), (4, 1), (6, 0), (6, 2)):
    for kind, every in (("crease", 6), ("corner", 3)):
        A = face_matrix(kind, k, i)
        values = (HALF, FOURTH, EIGHTH, SIXTEENTH)
        assert [defect(A, value) for value in values] == [k % every == 0, 0, 0, 0]
for n, i in ((3, 0), (3, 1), (4, 0), (4, 1), (6, 0), (6, 2), (6, 5)):
    assert diagonalisable(face_matrix("dart", n, i))
for n in (3, 4, 6):
    assert diagonalisable(face_matrix("cone", n, 0))

# %% [markdown]
# ## 5. Phantom points
#
# When is such a face a piece of the quartic box spline, of twelve control points of which some are
# phantoms? Then refinement acts on the polynomial's Taylor coefficients at the vertex: all
# eigenvalues that the face sees are powers of $\frac12$, and there is no Jordan block. From $k = 2$
# on there is a $\mu_1$, from $\frac38$ to $\frac58$; the one power in between is $\frac12$, for
# $\cos \frac{\pi}{k} = \frac12$. So beside $k = 1$ only $k = 3$ is left, and there a corner has a
# Jordan block. The others are:
#
# - *Crease, $k = 3$*: parallelograms, $v + e_0 - e_1$ and $v + e_3 - e_2$.
# - *Crease, $k = 1$*: $v + e_0 - e_1$ and $v + e_1 - e_0$ beyond the two edges, and opposite to
#   $e_0$ and to $e_1$ the points $e_1$ and $e_0$ themselves.
# - *Corner, $k = 1$*: the same beyond the edges, and opposite $2 v - e_0$ and $2 v - e_1$.
# - *$k = 2$*, the ordinary corner of a triangulated grid: none.

# %%
point, first, second = symbols("v e_0 e_1")
for kind, opposite in (
    ("crease", (second, first)),
    ("corner", (2 * point - first, 2 * point - second)),
):
    ring = [first, second, point + second - first, *opposite, point + first - second]
    new_v = Rational(5, 8) * point + sum(ring) / 16
    new = [
        Rational(3, 8) * (point + e) + (ring[j - 1] + ring[j - 5]) / 8 for j, e in enumerate(ring)
    ]
    expected = list(ring_matrix(kind, 1) * Matrix([point, first, second]))
    assert all(expand(a - b) == 0 for a, b in zip((new_v, *new[:2]), expected, strict=True))
    follow = dict(zip((point, first, second), expected, strict=True))
    again = [e.subs(follow, simultaneous=True) for e in ring]
    assert all(expand(a - b) == 0 for a, b in zip(new, again, strict=True))

assert [k for k in range(2, 40) if cos(pi / k) == HALF] == [3]

# %% [markdown]
# ## 6. Limit positions
#
# On a crease that of the cubic curve, $\frac16 e_0 + \frac23 v + \frac16 e_k$; corners and cones
# stay. At a dart the left eigenvector of 1 has, with weight 1 for $v$ and the smooth weight
# $\beta$,
#
# $$
# w_j = \frac{8 \beta}{3} \left( 1 - \frac{r^j + r^{N - j}}{1 + r^N} \right), \quad
# 0 < j < N, \qquad w_0 = 2 \beta + \frac{w_1 + w_{N-1}}{4}, \qquad r = \frac{5 - \sqrt{21}}{2},
# $$
#
# to be divided by the sum: $5 w_j = w_{j-1} + w_{j+1} + 8 \beta$, where the sharp edge gives
# nothing to its neighbours.

# %%
left = Matrix([[4, 1, *[0] * 3, 1]]) / 6
assert left * ring_matrix("crease", 4) == left
r = (5 - sqrt(21)) / 2
for n in (2, 3, 4, 6):
    weight = loop_weight(n)
    inner = [8 * weight / 3 * (1 - (r**j + r ** (n - j)) / (1 + r**n)) for j in range(1, n)]
    left = Matrix([[1, 2 * weight + (inner[0] + inner[-1]) / 4, *inner]])
    assert (left * ring_matrix("dart", n) - left).applyfunc(simplify).is_zero_matrix

# %% [markdown]
# ## 7. Limit normals
#
# Around the vertex the surface is a sum over eigenfunctions, and the normal comes from the two that
# lead, if their Jacobian keeps its sign all the way round the sector. Which two?
#
# *Crease.* The curve's tangent has $\frac12$, and across it the sines have $\mu_1 > \mu_2 > \dots$
#
# - $k = 1$: no sine. Next to the tangent is the curve's own $\frac14$.
# - $k = 2, 3, 4, 5$: tangent and sine 1, as $\mu_2 < \frac12$.
# - $k = 6$: $\mu_2 = \frac12$, in one Jordan block with the tangent, at whose end it stands: at
#   $2^{-n}$ the tangent's function has grown by $2 n \kappa$ times sine 2.
# - $k \ge 7$: $\mu_2 > \frac12$. Inside the sector the normal is that of sines 1 and 2, but both
#   vanish along the curve: there it is that of sine 1 and the tangent. No limit.
#
# *Corner.* Both edges have $\frac12$.
#
# - $k = 1, 2$: the two edges, as $\mu_1 < \frac12$.
# - $k = 3$: $\mu_1 = \frac12$, in one Jordan block with the sum of the edges.
# - $k \ge 4$: $\mu_1 > \frac12$. Along each edge the normal is that of sine 1 and of this edge. No
#   limit.
#
# So there is a limit normal for crease and boundary sectors of $k \le 6$ and corners of $k \le 3$,
# always at a right angle to the tangent of the curve (to those of both edges). For $k = 6$ and
# $k = 3$ normals come to it like $1 / n$ only.

# %%
mu = {k: [3 / 8 + float_cos(PI * m / k) / 4 for m in range(1, k)] for k in range(2, 40)}
assert [k for k in mu if k > 2 and mu[k][1] < HALF - 1e-9] == [3, 4, 5]
assert [k for k in mu if k > 2 and abs(mu[k][1] - HALF) < 1e-9] == [6]
assert [k for k in mu if mu[k][0] < HALF - 1e-9] == [2]
assert [k for k in mu if abs(mu[k][0] - HALF) < 1e-9] == [3]

# %% [markdown]
# The Jacobians, in floating point. An eigenfunction on the ring goes on to the second ring, $a_j$
# beyond $e_j$ and $b_j$ beyond edge $e_j e_{j+1}$, by solving one equation each; on the three
# children of a face away from the vertex ([masks_box_spline](masks_box_spline.py), section 4) it is
# a quartic. In barycentric coordinates a Jacobian is a form of degree 6: if no coefficient is
# negative, it is positive inside.


# %%
def forms():
    """{place: {exponents: coefficient}} of the twelve polynomials."""
    corner = {(4, 0, 0): 6, (3, 1, 0): 24, (3, 0, 1): 24, (2, 2, 0): 24, (2, 1, 1): 60}
    corner |= {(2, 0, 2): 24, (1, 3, 0): 8, (1, 2, 1): 36, (1, 1, 2): 36, (1, 0, 3): 8}
    corner |= {(0, 4, 0): 1, (0, 3, 1): 6, (0, 2, 2): 12, (0, 1, 3): 6, (0, 0, 4): 1}
    across = {(4, 0, 0): 1, (3, 1, 0): 6, (2, 2, 0): 12, (1, 3, 0): 6, (0, 4, 0): 1}
    across |= {(3, 0, 1): 2, (2, 1, 1): 6, (1, 2, 1): 6, (0, 3, 1): 2}
    beyond = {(4, 0, 0): 1, (3, 1, 0): 2}
    found = {}
    for k, (a, b) in enumerate(((0, 0), (1, 0), (0, 1))):
        step = [(a + STEPS[2 * k + j - 6][0], b + STEPS[2 * k + j - 6][1]) for j in range(6)]
        next_, last = (k + 1) % 3, (k + 2) % 3
        for place, form, order in (
            ((a, b), corner, (k, next_, last)),
            (step[5], across, (k, next_, last)),
            (step[4], beyond, (k, next_, last)),
            (step[3], beyond, (k, last, next_)),
        ):
            found[place] = {
                tuple(key[order.index(axis)] for axis in range(3)): c / 12
                for key, c in form.items()
            }
    return found


FORMS = forms()


def continued(ring, value, chain=None):
    """(v, e, a, b) of an eigenvector of the ring; ``chain``: what a step adds to value times it."""
    v, *e = ring
    k = len(e) - 1
    _, _, add_a, add_b = chain or (0, [], [0] * (k + 1), [0] * k)
    b = [(3 / 8 * (e[j] + e[j + 1]) + v / 8 - add_b[j]) / (value - 1 / 8) for j in range(k)]
    a = []
    for j in range(k + 1):
        if j in (0, k):
            a.append((3 / 4 * e[j] + v / 8 - add_a[j]) / (value - 1 / 8))
        else:
            around = v + e[j - 1] + e[j + 1] + b[j - 1] + b[j]
            a.append((5 / 8 * e[j] + around / 16 - add_a[j]) / (value - 1 / 16))
    return v, e, a, b


def face_net(function, i):
    v, e, a, b = function
    k = len(e) - 1
    net = {(0, 0): v, (1, 0): e[i], (0, 1): e[i + 1], (2, 0): a[i], (1, 1): b[i], (0, 2): a[i + 1]}
    net[1, -1] = e[i - 1] if i else v + e[0] - e[1]
    net[2, -1] = b[i - 1] if i else e[0] + a[0] - b[0]
    net[-1, 1] = e[i + 2] if i < k - 1 else v + e[k] - e[k - 1]
    net[-1, 2] = b[i + 1] if i < k - 1 else e[k] + a[k] - b[k - 1]
    return net


def pieces(function, value, chain=None):
    """On all faces and on children 1, 2, 3 of each: {exponents: coefficient}."""
    for i in range(len(function[1]) - 1):
        net = face_net(function, i)
        add = face_net(chain, i) if chain else dict.fromkeys(net, 0)
        fine = {place: value * net[place] + add[place] for place in net}  # the ring among them
        for (a, b), sign in (((1, 0), 1), ((0, 1), 1), ((1, 1), -1)):
            total = {}
            for (x, y), form in FORMS.items():
                k = a + sign * x, b + sign * y
                if k not in fine:
                    fine[k] = sum(float(w) * net[p] for p, w in regular(k).items())
                for key, c in form.items():
                    total[key] = total.get(key, 0) + c * fine[k]
            yield total


def derivative(form, axis):
    total = {}
    for key, c in form.items():
        for variable, sign in ((axis, 1), (0, -1)):
            if key[variable]:
                less = tuple(n - (m == variable) for m, n in enumerate(key))
                total[less] = total.get(less, 0) + sign * c * key[variable]
    return total


def jacobians(f, g):
    """All coefficients of the Jacobians of two functions, given by their pieces."""
    found = []
    for p, q in zip(f, g, strict=True):
        total = {}
        for axes, sign in (((1, 2), 1), ((2, 1), -1)):
            one, two = derivative(p, axes[0]), derivative(q, axes[1])
            for (key, c), (other, d) in product(one.items(), two.items()):
                both = tuple(m + n for m, n in zip(key, other, strict=True))
                total[both] = total.get(both, 0) + sign * c * d
        found += total.values()
    return found


def sine(k, m):
    value = 3 / 8 + float_cos(PI * m / k) / 4
    inside = [float_sin(PI * m * j / k) for j in range(1, k)]
    return continued([0, 0, *inside, 0], value), value


def from_curve(k, v, first, last, value, chain=None):
    """The curve's eigenvector (v, e_0, e_k), continued to the ring and beyond."""
    A = ring_matrix("crease", k)
    B = (A - value * Matrix.eye(k + 2))[2 : k + 1, :]
    right = -B[:, 0] * v - B[:, 1] * first - B[:, k + 1] * last
    if chain:
        right += Matrix(chain[1][1:k])
    inside = []
    if k > 1:
        M = B[:, 2 : k + 1]
        # symmetric; where it is singular, any solution will do
        inside = list(M.pinv() * right if M.det() == 0 else M.LUsolve(right))
    ring = [float(c) for c in (v, first, *inside, last)]
    return continued(ring, float(value), chain)


# crease, k = 1: the curve's 1/2 and 1/4
tangent = from_curve(1, 0, 1, -1, HALF)
bend = from_curve(1, Rational(-1, 2), 1, 1, FOURTH)
assert min(jacobians(pieces(tangent, 0.5), pieces(bend, 0.25))) > 0.1
# creases, k = 2 .. 5: tangent and sine 1
for k in range(2, 6):
    tangent = from_curve(k, 0, 1, -1, HALF)
    assert min(jacobians(pieces(tangent, 0.5), pieces(*sine(k, 1)))) > 0.1
# corners, k = 1, 2: the difference of the edges and their sum
for k in (1, 2):
    difference, total = from_curve(k, 0, 1, -1, HALF), from_curve(k, 0, 1, 1, HALF)
    assert min(jacobians(pieces(difference, 0.5), pieces(total, 0.5))) > 0.1

# %% [markdown]
# *Crease of six.* The chain: $(A - \frac12) \, g = \kappa \, s$ with the tangent $g$,
# $e_0 = 1 = -e_6$, and sine 2, $s$. From the product with $s$,
# $\kappa = \frac{2}{k} \cdot \frac{2}{8} \sin \frac{\pi}{3} = \frac{\sqrt 3}{24}$. The Jacobian of
# $s$ and sine 1 is zero along the curve and positive elsewhere, that of $g + c \, s$ and sine 1
# positive everywhere for large $c$; and $c$ grows with $2 n \kappa$. So the normal tends to that of
# tangent and sine 1, and the sine's own coefficient is in it with a share of $1 / n$.
#
# *Corner of three.* $(A - \frac12) \, g = \kappa \, s$ with the sum of the edges $g$,
# $e_0 = e_3 = 1$, and sine 1: $\kappa = \frac{\sqrt 3}{12}$. The Jacobian of the edges' difference
# and $s$ is positive everywhere.


# %%
def scaled(function, factor):
    return tuple([factor * c for c in part] if isinstance(part, list) else 0 for part in function)


def combined(f, g, c):
    return tuple(
        [x + c * y for x, y in zip(p, q, strict=True)] if isinstance(p, list) else p + c * q
        for p, q in zip(f, g, strict=True)
    )


def close(ring, found, value, chain):
    """Whether a step does value times the vector plus the chain."""
    A = ring.applyfunc(float)
    vector, add = (Matrix([f[0], *f[1]]) for f in (found, chain))
    return max(map(abs, A * vector - value * vector - add)) < 1e-12


two, _ = sine(6, 2)
chain = scaled(two, float(sqrt(3) / 24))
inside = [1 / 4, -1 / 4, 0, 1 / 4, -1 / 4]
g = continued([0, 1, *inside, -1], 0.5, chain)
assert close(ring_matrix("crease", 6), g, 0.5, chain)
one = list(pieces(*sine(6, 1)))
assert min(jacobians(pieces(two, 0.5), one)) > -1e-12
assert min(jacobians(pieces(combined(g, two, 4), 0.5, chain), one)) > 0.1

wave, _ = sine(3, 1)
chain = scaled(wave, float(sqrt(3) / 12))
g = continued([0, 1, 0, 0, 1], 0.5, chain)
assert close(ring_matrix("corner", 3), g, 0.5, chain)
difference = from_curve(3, 0, 1, -1, HALF)
assert min(jacobians(pieces(difference, 0.5), pieces(wave, 0.5))) > 0.1

# %% [markdown]
# *Edges that are points.* Where $e_0 = e_k = v$ nothing is left of the curve, and of $k \ge 3$
# faces sines 1 and 2 lead, be the vertex carried or not: $\mu_2 \ge \frac14$ is above $\mu_3$ and
# the outer points' $\frac18$, and the chain of $k = 6$ begins where the tangent is. The Jacobian of
# sine 2 and sine 1 is zero along the edges and positive elsewhere, for each $k$ that is tried here:
# the normal tends to that of the two, from all faces. Of two faces sine 1 alone is left, and the
# rest is up to outer points: no limit, but in a corner of which one edge is no point. There it is
# that of this edge and of sine 1.

# %%
for k in range(3, 13):
    found = jacobians(pieces(*sine(k, 2)), pieces(*sine(k, 1)))
    assert min(found) > -1e-12
    assert max(found) > 0.1
    assert mu[k][1] - max([1 / 8, *mu[k][2:]]) > 0.01
difference, total = from_curve(2, 0, 1, -1, HALF), from_curve(2, 0, 1, 1, HALF)
last = combined(total, difference, -1.0)  # twice what has e_2 alone
first = combined(total, difference, 1.0)
assert min(jacobians(pieces(*sine(2, 1)), pieces(last, 0.5))) > -1e-12
assert min(jacobians(pieces(first, 0.5), pieces(*sine(2, 1)))) > -1e-12

# %% [markdown]
# ## 8. Masks across a crease
#
# The coefficient of sine 1 is a left eigenvector: $\sin \frac{\pi j}{k}$ on $e_j$ inside, $y$ on
# $e_0$ and $e_k$, $z$ on $v$, with
#
# $$
# \left( \mu_1 - \frac12 \right) y = \frac{1}{8} \left( \sin \frac{\pi}{k} + z \right), \qquad
# \left( \mu_1 - \frac34 \right) z = y + \frac38 \cot \frac{\pi}{2 k} .
# $$
#
# For $k = 2$ that is $e_1 - v$, for $k = 3$ the regular $2 (e_1 + e_2) - e_0 - e_3 - 2 v$, up to a
# factor; for $k = 1$ take the bend $e_0 + e_1 - 2 v$. Hoppe et al. have the same for these three.
# From $k = 4$ on, their masks and those of Biermann, Levin and Zorin,
# $\sin \theta \, (e_0 + e_k) + (2 \cos \theta - 2) \sum \sin (j \theta) \, e_j$ with
# $\theta = \frac{\pi}{k}$, are left eigenvectors of other rules.


# %%
def across_mask(k):
    theta = pi / k
    value = Rational(3, 8) + cos(theta) / 4
    y, z = symbols("y z")
    equations = [
        (value - HALF) * y - (sin(theta) + z) / 8,
        (value - 3 * FOURTH) * z - y - 3 * EIGHTH * cot(theta / 2),
    ]
    found = solve(equations, [y, z], dict=True)[0]
    inside = [sin(theta * j) for j in range(1, k)]
    return Matrix([[found[z], found[y], *inside, found[y]]]), value


for k in range(2, 7):
    left, value = across_mask(k)
    residual = left * ring_matrix("crease", k) - value * left
    assert all(abs(complex(c)) < 1e-12 for c in residual.evalf(30))
    theta = pi / k
    inside = [(2 * cos(theta) - 2) * sin(theta * j) for j in range(1, k)]
    published = Matrix([[0, sin(theta), *inside, sin(theta)]])
    residual = published * ring_matrix("crease", k) - value * published
    assert k < 4 or max(abs(complex(c)) for c in residual.evalf()) > 1e-2
assert across_mask(2)[0] == Matrix([[-1, 0, 1, 0]])
assert (across_mask(3)[0] * 4 / sqrt(3)).applyfunc(simplify) == Matrix([[-2, -1, 2, 2, -1]])
bend = Matrix([[-2, 1, 1]])
assert bend * ring_matrix("crease", 1) == bend / 4

# %% [markdown]
# ## 9. Darts
#
# The two functions that lead are an even one and sine 1, $f = 1$ of the odd part; they make the
# normal, which exists if their Jacobian keeps its sign. In floating point, for $N = 3, \dots, 9$: a
# dart's faces are those of a sector of $N$ faces whose $e_0$ and $e_N$ are one point.

# %%
for n in range(3, 10):
    weight = (5 / 8 - (3 / 8 + float_cos(2 * PI / n) / 4) ** 2) / n
    half = n // 2
    size = half + 2  # the even part, by v, e_0, ..., e_half
    M = [[0.0] * size for _ in range(size)]
    M[0][0] = 1 - n * weight
    M[1][0] = M[1][1] = 0.5
    for j in range(n):
        M[0][1 + min(j, n - j)] += weight
    for j in range(1, half + 1):
        M[1 + j][0] += 3 / 8
        M[1 + j][1 + j] += 3 / 8
        for other in (j - 1, j + 1):
            M[1 + j][1 + min(other, n - other)] += 1 / 8
    # 1 is the largest, of constants: powers of what is left without the limit find the next
    even = [0.0, *(float_cos(PI * j / half) for j in range(half + 1))]
    for _ in range(400):
        even = [sum(m * c for m, c in zip(row, even, strict=True)) for row in M]
        limit = even
        for _ in range(60):
            limit = [sum(m * c for m, c in zip(row, limit, strict=True)) for row in M]
        even = [c - limit[0] for c in even]
        value = even[1]
        even = [c / value for c in even]
    step = [sum(m * c for m, c in zip(row, even, strict=True)) for row in M]
    value = step[1]
    assert max(abs(a - value * b) for a, b in zip(step, even, strict=True)) < 1e-9
    even_ring = [even[0], *(even[1 + min(j, n - j)] for j in range(n + 1))]
    assert even_ring[1] == even_ring[-1]
    one = 3 / 8 + float_cos(2 * PI / n) / 4
    two = 3 / 8 + float_cos(4 * PI / n) / 4
    assert value > two + 1e-2
    odd = continued([0, *(float_sin(2 * PI * j / n) for j in range(n)), 0], one)
    found = jacobians(pieces(continued(even_ring, value), value), pieces(odd, one))
    assert min(found) > 0.01

# %% [markdown]
# ## 10. Pendants and flaps
#
# What a crease carries that does not bound it ([sectors](sectors.py), section 9): a whole ring
# without a sharp edge, or a sector that begins and ends at one edge, whose vertex moves by
# $v' = (3 v + m) / 4$, with $m$ halfway between its neighbours on the crease, $m' = (v + m) / 2$.
# The spectrum is that of the cone or corner, and one $\frac14$. Its eigenvector has $v = -1$,
# $m = 2$, and beside a sharp edge $e = 2$. In a flap it is the vector of a crease of $k$ faces, in
# a pendant constant on the $e_j$: there is one for every $k$, and *no Jordan block at* $\frac14$.


# %%
def carried_matrix(still, k):
    A = ring_matrix(still, k)
    A = Matrix.vstack(Matrix.hstack(A, Matrix.zeros(A.rows, 1)), Matrix.zeros(1, A.rows + 1))
    A[0, 0], A[0, A.rows - 1] = 3 * FOURTH, FOURTH
    A[A.rows - 1, 0] = A[A.rows - 1, A.rows - 1] = HALF
    return A


for k in range(1, 14):
    flap = carried_matrix("corner", k)
    assert [defect(flap, value) for value in (1, HALF, FOURTH)] == [0, k % 3 == 0, 0]
    if k > 2:
        pendant = carried_matrix("cone", k)
        assert not any(defect(pendant, value) for value in (1, HALF, FOURTH, Rational(5, 8)))
