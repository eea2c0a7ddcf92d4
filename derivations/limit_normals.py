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
"""Limit normals at creases, corners, cones and darts: which exist, their masks, how fast they come.

After Reif (1995), DeRose, Kass and Truong (1998) and Biermann, Levin and Zorin (2000).

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Limit normals on sharp edges
#
# At which vertices on sharp edges unit normals have a limit, and at which it depends on the
# direction of approach; the masks of the two vectors whose cross product it is; how fast normals
# come to it; and how derivatives scale. Signs of minors are proved in interval arithmetic, by
# Bernstein coefficients.
#
# - U. Reif, "A unified approach to subdivision algorithms near extraordinary vertices", Computer
#   Aided Geometric Design 12 (1995): normals from eigenfunctions, and the sign of their minor.
# - T. DeRose, M. Kass, T. Truong, "Subdivision surfaces in character animation", SIGGRAPH 1998: the
#   rules, used here as they stand.
# - H. Biermann, A. Levin, D. Zorin, "Piecewise smooth subdivision surfaces with normal control",
#   SIGGRAPH 2000: modified rules, and the tangent masks that belong to them.

# %%
from itertools import pairwise
from math import comb, factorial

from mpmath import (
    atan2,
    cospi,
    degrees,
    fdot,
    iv,
    lu_solve,
    matrix,
    mp,
    mpf,
    norm,
    polyroots,
    sign,
    sinpi,
    sqrt,
)
from sympy import QQ, Matrix, Poly, Rational, Symbol, expand, symbols
from sympy.polys.matrices import DomainMatrix

iv.dps = mp.dps = 50

# %% [markdown]
# ## 1. Minors
#
# Let $\varphi_i$ be the eigenfunctions of a face with $v$ at $(0, 0)$, $\lambda_i$ their values and
# $P_i$ the left eigenvectors applied to the control points, so that
#
# $$
# f(x / 2^n) = \sum_i \lambda_i^n \, \varphi_i(x) \, P_i .
# $$
#
# The normal is, up to a factor,
#
# $$
# \begin{split}
# f_u \times f_v &= 4^n \sum_{i < j} (\lambda_i \lambda_j)^n \, m_{ij}(x) \, (P_i \times P_j), \\
# m_{ij} &= \frac{\partial \varphi_i}{\partial u} \frac{\partial \varphi_j}{\partial v}
#   - \frac{\partial \varphi_i}{\partial v} \frac{\partial \varphi_j}{\partial u},
# \end{split}
# $$
#
# for $x$ in the face but not in its quarter at $v$. Suppose one pair beats all others. If its minor
# $m_{ij}$ has one sign at all $x$ of all faces, unit normals tend to that of $P_i \times P_j$.
# Where it vanishes other pairs speak, and they tend to nothing. A chain
# $(A - \lambda) \, g = c \, p$ ([sectors](sectors.py), section 4) adds the terms
#
# $$
# \lambda^n \left( \left( \varphi_g + \frac{n c}{\lambda} \, \varphi_p \right) P_g
#   + \varphi_p P_p \right) :
# $$
#
# the slowest function is $\varphi_p$, but its vector is $P_g$.
#
# An eigenvector on the ring determines its outer points and the three bicubic quarters of the face
# away from $v$. If the Bernstein coefficients of a minor are positive, so is the minor. They are
# computed in intervals of 50 digits, so that a sign is a proof. Weights of lines are integers over
# 8.

# %%
OUTER = [(3, 0), (3, 1), (3, 2), (3, 3), (2, 3), (1, 3), (0, 3)]
BEYOND = [(4, 0), (4, 1), (4, 2), (4, 3), (4, 4), (3, 4), (2, 4), (1, 4), (0, 4)]
LINES = [{0: 4, 1: 4}, {0: 1, 1: 6, 2: 1}, {1: 4, 2: 4}, {1: 1, 2: 6, 3: 1}, {2: 4, 3: 4}]


class Face:
    """Face i of a ring: where its points are, and how those outside of the ring refine."""

    def __init__(self, kind, k, i):
        self.low, self.left = i == 0, i == k - 1  # these edges are sharp
        turns = {(2, 1): 0, (2, 2): 1, (1, 2): 2, (0, 2): 3, (0, 1): 4, (2, 0): -1, (1, 0): -2}
        period = 2 * k if kind == "dart" else 4 * k  # a sector does not close
        self.ring = {(1, 1): 0}
        self.ring |= {q: 1 + (2 * i + turns[q]) % period for q in self.on_side(turns)}
        self.outer, self.beyond = self.on_side(OUTER), self.on_side(BEYOND)

    def on_side(self, places):
        return [(x, y) for x, y in places if (x or not self.left) and (y or not self.low)]

    def weights(self, place):
        """Integers over 64."""
        x, y = place
        first = {1: 8} if self.left and x == 1 else LINES[x]
        second = {1: 8} if self.low and y == 1 else LINES[y]
        return {(a, b): p * q for a, p in first.items() for b, q in second.items()}

    def refined(self, points, places):
        rows = {place: self.weights(place).items() for place in places}
        return {q: sum(w * points.get(old, 0) for old, w in rows[q]) / 64 for q in places}

    def eigenvector(self, ring, value, foot=None):
        """Ring and outer points; of a chain, if foot is c times the points of p."""
        points = {place: ring[index] for place, index in self.ring.items()}
        seen, count = self.refined(points, self.outer), len(self.outer)
        block, right = iv.matrix(count), iv.matrix(count, 1)
        for m, place in enumerate(self.outer):
            for old, weight in self.weights(place).items():
                if old in self.outer:
                    block[m, self.outer.index(old)] = iv.mpf(weight) / 64
            block[m, m] -= value
            right[m] = (foot[place] if foot else 0) - seen[place]
        return points | dict(zip(self.outer, iv.lu_solve(block, right), strict=True))

    def quarters(self, old, new):
        """Bezier points of the three quarters away from v, from two levels of points."""
        new = new | self.refined(old, self.beyond)
        for m in range(1, 5):
            if self.low:
                new[m, 0] = 2 * new[m, 1] - new[m, 2]
            if self.left:
                new[0, m] = 2 * new[1, m] - new[2, m]
        return [
            bezier([[new[x + i, y + j] for j in range(4)] for i in range(4)])
            for x, y in ((1, 0), (1, 1), (0, 1))
        ]

    def eigenfunction(self, ring, value, foot=None):
        old = self.eigenvector(ring, value, foot)
        return self.quarters(old, {q: value * p + (foot[q] if foot else 0) for q, p in old.items()})


def transposed(net):
    return list(map(list, zip(*net, strict=True)))


def bezier(net):
    """Bezier points of one piece of a bicubic spline, from its 4 x 4 control points."""
    for _ in range(2):
        a, b, c, d = net
        columns = zip(a, b, c, d, strict=True)
        rows = [
            [(p + 4 * q + r) / 6, (2 * q + r) / 3, (q + 2 * r) / 3, (q + 4 * r + s) / 6]
            for p, q, r, s in columns
        ]
        net = rows
    return net


def derivatives(net):
    """Along u and v, up to the factor 3."""
    along_v = [[q - p for p, q in pairwise(row)] for row in net]
    along_u = [[q - p for p, q in pairwise(row)] for row in transposed(net)]
    return transposed(along_u), along_v


def times(first, second):
    """Bernstein coefficients of a product, up to positive factors."""
    m, n = (len(net) - 1 for net in (first, second))
    p, q = (len(net[0]) - 1 for net in (first, second))
    result = [[0] * (p + q + 1) for _ in range(m + n + 1)]
    for i, row in enumerate(first):
        for j, a in enumerate(row):
            for x, other in enumerate(second):
                for y, b in enumerate(other):
                    factor = comb(m, i) * comb(p, j) * comb(n, x) * comb(q, y)
                    result[i + x][j + y] += factor * a * b
    return result


def minor(phi, psi):
    """Bernstein coefficients of phi_u psi_v - phi_v psi_u on the three quarters."""
    for first, second in zip(phi, psi, strict=True):
        (a_u, a_v), (b_u, b_v) = derivatives(first), derivatives(second)
        for row, other in zip(times(a_u, b_v), times(a_v, b_u), strict=True):
            yield from (p - q for p, q in zip(row, other, strict=True))


def positive(minors):
    return all(m > 0 for m in minors)


# %% [markdown]
# ## 2. Sectors with a limit normal
#
# The candidates: $T$, the wave across the curve, of value $\frac12$; on a crease its vector is
# $(e_0 - e_k) / 2$, the tangent of the curve. And the interior waves, of which that of $m = 1$ has
# the largest value ([sectors](sectors.py), section 3), here above $\frac14$:


# %%
def wave(k, m):
    """Ring of the interior wave of k faces, v = 0, and its value."""
    angle, a = iv.pi * m / k, iv.cos(iv.pi * m / (2 * k))
    value = (a + iv.sqrt(4 + a * a)) ** 2 / 16
    ring = [iv.mpf(0)]
    for j in range(k + 1):
        e = (4 * value - 1) * iv.sin(j * angle) if m * j % k else iv.mpf(0)
        ring += [e, 2 * a * iv.sin((2 * j + 1) * angle / 2)]
    return ring[:-1], value


def intervals(*numbers):
    return [iv.mpf(number.p) / number.q for number in map(Rational, numbers)]


def minors(kind, k, first, second):
    for i in range(k):
        face = Face(kind, k, i)
        yield minor(face.eigenfunction(*first), face.eigenfunction(*second))


HALF, FOURTH = intervals("1/2", "1/4")

# %% [markdown]
# *Crease, $k = 2$ and $3$.* $T$ has $e_{j+2} = -e_j$ and $f_j = e_j + e_{j+1}$. The value of the
# wave 1 is $\frac12$ (the spline of two faces) or 0.580, all others are smaller. The pair ($T$,
# wave 1) has a positive minor: the normal tends to $T \times P_1$.

# %%
two = intervals(0, 1, 1, 0, -1, -1), HALF
three = intervals(0, 1, 2, 1, 0, -1, -2, -1), HALF
for k, tangent in ((2, two), (3, three)):
    for signs in minors("crease", k, tangent, wave(k, 1)):
        assert positive(signs)

# %% [markdown]
# *Crease, $k = 4$.* Wave 1 has 0.611. At $\frac12$ is the chain from $T$ to the wave $m = 2$, with
# $c = 1/12$ and $g$ as in [sectors](sectors.py), section 4: after $n$ steps the function that comes
# with $T$ is $\varphi_g + \frac{n}{6} \varphi_p$. On the crease $p$ vanishes, inside it wins. So
# the minors of ($g$, wave 1) and ($p$, wave 1) must both be positive where the other may vanish;
# ($p$, wave 1) is zero on the creases alone, and ($g$, wave 1) is positive on all of the faces
# there. Again $T \times P_1$, but by $1/n$: the rest, ($p$, wave 1) with the vector
# $P_2 \times P_1$, is only $n/6$ times smaller.

# %%
p_ring = intervals(0, 0, 1, 1, 1, 0, -1, -1, -1, 0)
g_ring = intervals(0, 1, "2/3", 0, "-1/3", 0, "1/3", 0, "-2/3", -1)


def chain(face, g, p, value, c):
    """Eigenfunctions of p and g."""
    foot = {place: c * point for place, point in face.eigenvector(p, value).items()}
    return face.eigenfunction(p, value), face.eigenfunction(g, value, foot)


for i in range(2):  # the other two are their mirror images
    face = Face("crease", 4, i)
    phi_1 = face.eigenfunction(*wave(4, 1))
    phi_p, phi_g = chain(face, g_ring, p_ring, HALF, *intervals("1/12"))
    signs = list(minor(phi_p, phi_1))
    if i == 0:
        # the coefficients on the crease, where both functions are zero along u
        assert all(abs(signs.pop(m)) < 1e-40 for m in range(30, -1, -6))
        assert positive(minor(phi_g, phi_1))
    assert positive(signs)

# %% [markdown]
# *Crease, $k = 1$*: the crease rule at a vertex of one face. $T$ has $\frac12$; all that is left is
# $\frac14$, a chain from the even vector of the curve, with $Q = (e_0 + e_1 - 2v) / 6$, to the
# point $f_0$ alone, with $c = \frac34$. So the normal tends to $T \times Q$, the plane in which the
# boundary curve bends, by $1/n$. Only if that is zero, on a boundary that is straight there, it is
# $T \times P$, with $P = f_0 - (e_0 + e_1) / 2$, the vector of $p$.

# %%
face = Face("crease", 1, 0)
phi_t = face.eigenfunction(intervals(0, 1, 0, -1), HALF)
phi_p, phi_g = chain(face, intervals(-1, 2, 2, 2), intervals(0, 0, 1, 0), FOURTH, *intervals("3/4"))
assert positive(minor(phi_t, phi_p))

# %% [markdown]
# *Corner, $k = 1$*: a spline ([creases](creases.py), section 2). Value $\frac12$ has the vectors
# $S_0 = e_0 - v$ and $S_k = e_k - v$ of the two curves, and the normal is that of $S_0 \times S_1$.

# %%
face = Face("corner", 1, 0)
phi_0, phi_k = (face.eigenfunction(intervals(*ring), HALF) for ring in ((0, 1, 1, 0), (0, 0, 1, 1)))
assert positive(minor(phi_0, phi_k))

# %% [markdown]
# *Corner, $k = 2$.* All is $\frac12$: $d$ (odd) with $(S_0 - S_2) / 2$, and a chain from $g$ (even)
# with $(S_0 + S_2) / 2$ to the wave $p$. The pair $(d, p)$ has a positive minor and the vector
#
# $$
# \frac{(S_0 - S_2) \times (S_0 + S_2)}{4} = \frac{S_0 \times S_2}{2} .
# $$
#
# So the normal is that of $S_0 \times S_2$, by $1/n$. On a crease that runs straight through its
# corner, $S_2 = -t S_0$ with $t > 0$, this is zero, and what remains, without $n$, is
#
# $$
# \left( \frac{1 + t}{2} \, m_{dp} + \frac{1 - t}{2} \, m_{gp} \right) S_0 \times P, \qquad
# P = \frac{12 e_1 + 3 f_0 + 3 f_1 - e_0 - e_2 - 16 v}{18},
# $$
#
# with $P$ the vector of $p$. As $m_{dp}$ is at least $\left| m_{gp} \right|$, it is positive.

# %%
for i in range(2):
    face = Face("corner", 2, i)
    phi_d = face.eigenfunction(*two)
    even = intervals(0, 1, "1/3", 0, "1/3", 1)
    phi_p, phi_g = chain(face, even, intervals(0, 0, 1, 1, 1, 0), HALF, *intervals("1/6"))
    assert positive(minor(phi_d, phi_p))
    both = zip(minor(phi_d, phi_p), minor(phi_g, phi_p), strict=True)
    assert all(d - abs(g) > -1e-40 for d, g in both)

# %% [markdown]
# The vectors of $p$, checked: they do not see the other vectors of their chains, nor $T$, $d$ and
# 1.

# %%
for mask, p_ring, others in (
    ([0, -9, 18, -9], [0, 0, 1, 0], ([1] * 4, [0, 1, 0, -1], [-1, 2, 2, 2])),
    (
        [-16, -1, 3, 12, 3, -1],
        [0, 0, 1, 1, 1, 0],
        ([1] * 6, [0, 1, 1, 0, -1, -1], [0, 3, 1, 0, 1, 3]),
    ),
):
    assert fdot(mask, p_ring) == 18
    assert all(fdot(mask, other) == 0 for other in others)

# %% [markdown]
# ## 3. The masks
#
# On a crease $T = (e_0 - e_k) / 2$, and $P_1$ is a left eigenvector. In the interior it is that of
# the smooth ring ([limit_masks](limit_masks.py), section 2), $A \, \sin(j\theta)$ on $e_j$ and
# $\sin((j + \frac12)\theta)$ on $f_j$, with $\theta = \pi / k$, $a = \cos(\theta / 2)$ and
# $A = a + \sqrt{4 + a^2}$. With $y$ on $e_0$ and $e_k$ and $w$ on $v$ the columns of $e_0$ and of
# $v$ say
#
# $$
# \begin{split}
# \left(\lambda - \tfrac12\right) y &= \frac{w}{8} + K, \qquad
#   K = \frac{A \, \sin(\theta)}{16} + \frac{\sin(\theta / 2)}{4}, \\
# \left(\lambda - \tfrac34\right) w &= y + S, \qquad
#   S = \frac{3 A \, \cot(\theta / 2)}{8} + \frac{1}{4 \, \sin(\theta / 2)},
# \end{split}
# $$
#
# $S$ being $\frac38$ of all weights of the $e_j$ and $\frac14$ of those of the $f_j$. So
#
# $$
# w = \frac{K + \left(\lambda - \frac12\right) S}
#   {(\lambda - 1) \left(\lambda - \frac14\right)}, \qquad
# y = \left(\lambda - \tfrac34\right) w - S .
# $$


# %%
def interior_mask(k):
    a, half = cospi(mpf(1) / (2 * k)), sinpi(mpf(1) / (2 * k))
    A, value = a + sqrt(4 + a * a), (a + sqrt(4 + a * a)) ** 2 / 16
    K = A * sinpi(mpf(1) / k) / 16 + half / 4
    S = 3 * A * a / half / 8 + 1 / (4 * half)
    w = (K + (value - mpf(1) / 2) * S) / ((value - 1) * (value - mpf(1) / 4))
    y = (value - mpf(3) / 4) * w - S
    mask = [w]
    for j in range(k + 1):
        e = A * sinpi(mpf(j) / k) if 0 < j < k else y
        mask += [e, sinpi((j + mpf(1) / 2) / k)]
    return mask[:-1], value


def refined_ring(kind, k, ring):
    v, e, f = ring[0], ring[1::2], ring[2::2]
    new_f = [(v + e[j] + f[j] + e[(j + 1) % len(e)]) / 4 for j in range(k)]
    new_e = [(v + e[j] + new_f[j - 1] + new_f[j % k]) / 4 for j in range(len(e))]
    for j in {"crease": (0, k), "corner": (0, k), "dart": (0,)}[kind]:
        new_e[j] = (v + e[j]) / 2
    if kind == "crease":
        v = (6 * v + e[0] + e[k]) / 8
    if kind == "dart":
        v = (v * (k - 2) + (sum(e) + sum(new_f)) / k) / k
    ring = [v, new_e[0]]
    for j in range(k):
        ring += [new_f[j], *new_e[j + 1 : j + 2]]
    return ring


def close(x, y, tolerance):
    return all(abs(p - q) < tolerance for p, q in zip(x, y, strict=True))


def units(size):
    return [[mpf(i == j) for j in range(size)] for i in range(size)]


for k in range(2, 14):
    mask, value = interior_mask(k)
    columns = [fdot(mask, refined_ring("crease", k, one)) for one in units(2 * k + 2)]
    assert close(columns, [value * weight for weight in mask], 1e-45)

# %% [markdown]
# The published masks (Biermann, Levin and Zorin 2000) are $T$ and
#
# $$
# \begin{array}{ll}
# v: & 4 R \, (\cos(\theta) - 1), \\
# e_0, e_k: & -R \, (1 + 2 \, \cos(\theta)), \\
# e_j: & 4 \, \sin(j\theta), \\
# f_j: & \sin(j\theta) + \sin((j + 1)\theta),
# \end{array}
# $$
#
# with $R = (1 + \cos(\theta)) / \sin(\theta)$ (and over $k \, (3 + \cos(\theta))$). They belong to
# an edge rule that depends on $k$. At $k = 2$ that is the plain rule, and the mask is $P_1$; at
# $k = 3$ and 4 it is no left eigenvector of the plain rules.


# %%
def published_mask(k):
    cosine, sine = cospi(mpf(1) / k), sinpi(mpf(1) / k)
    R = (1 + cosine) / sine
    mask = [4 * R * (cosine - 1)]
    for j in range(k + 1):
        here, after = sinpi(mpf(j) / k), sinpi(mpf(j + 1) / k)
        mask += [4 * here if 0 < j < k else -R * (1 + 2 * cosine), here + after]
    return mask[:-1]


for k in (2, 3, 4):
    mask, _ = interior_mask(k)
    published = published_mask(k)
    assert abs(sum(published)) < 1e-45
    assert close([m * published[2] / mask[2] for m in mask], published, 1e-45) == (k == 2)

# %% [markdown]
# ## 4. Darts
#
# Waves odd about the sharp edge are those of the smooth ring; that of $m = 1$ has the value $L_o$,
# with $\theta = 2\pi / N$. Even ones start with $v = (2\lambda - 1) \, e_0$ and follow the
# recurrence of [sectors](sectors.py), section 2; the largest value below 1 is $L_e$. The pair
# (even, odd) has a positive minor, and for $N \ge 3$ beats all others: so a dart has one limit
# normal for all its faces, that of $P_e \times P_o$. It feels the two scales $L_e$ and $L_o$: at
# $N = 3$ the even one is larger, at $N = 4$ both are $\frac12$, for $N \ge 5$ the odd one is
# larger. The two by $N$ are shown below.

# %%
x = Symbol("x")


def dart_values(n):
    """L_e as an interval that holds one root, and all other even roots but 1 by their moduli."""
    size = 2 * n + 1
    rows = [refined_ring("dart", n, one) for one in Matrix.eye(size).tolist()]
    fold = {i: min(i, size + 1 - i) if i else 0 for i in range(size)}
    even_part = Matrix.zeros(n + 2, n + 2)
    for column, row in enumerate(rows):
        for i in range(n + 2):
            even_part[i, fold[column]] += row[i]
    polynomial = Poly(DomainMatrix.from_Matrix(even_part).convert_to(QQ).charpoly(), x, domain=QQ)
    coefficients = [mpf(c.p) / c.q for c in polynomial.all_coeffs()]
    one, even, *others = sorted(
        polyroots(coefficients, maxsteps=500, extraprec=500), key=lambda root: -abs(root)
    )
    assert abs(one - 1) < 1e-40
    centre = Rational(int(even.real * 10**40), 10**40)
    ends = centre - Rational(1, 10**39), centre + Rational(1, 10**39)
    assert polynomial.count_roots(*ends) == 1
    low, high = intervals(*ends)
    return iv.mpf([low.a, high.b]), [abs(root) for root in others]


def even_wave(n, value):
    """By the recurrence, from the edge or face opposite to the sharp edge on."""
    rho = (6 * value - 1) / (16 * value**2 - 12 * value + 1)
    twice_cosine = 16 * value + 1 / value - 10
    d = [iv.mpf(2), twice_cosine] if n % 2 == 0 else [iv.mpf(1), iv.mpf(1)]
    while len(d) <= n // 2 + n % 2:
        d.append(twice_cosine * d[-1] - d[-2])
    e = {}
    for m, point in enumerate(d):
        e[n // 2 + m] = e[(n + 1) // 2 - m] = point
    # d_0 = e_0 - rho v, with v = (2 value - 1) e_0; scaled so that e_0 - v = 2 - 2 value > 0
    scale = (1 - rho * (2 * value - 1)) / e[0]
    v = 2 * value - 1
    ring = [v]
    e = [e[j] * scale + rho * v for j in range(n + 1)]
    for j in range(n):
        ring += [e[j], (v + e[j] + e[j + 1]) / (4 * value - 1)]
    return ring


scales = {}
for n in range(3, 13):
    even, others = dart_values(n)
    odd_ring, odd = wave(n, 2)
    odd_ring, even_ring = odd_ring[: 2 * n + 1], even_wave(n, even)
    for ring, value in ((odd_ring, odd), (even_ring, even)):
        assert close(refined_ring("dart", n, ring), [value * point for point in ring], 1e-30)
    _, next_odd = wave(n, 4) if n > 4 else (None, FOURTH)
    assert min(even.a, odd.a) > max(*others, next_odd.b)
    assert abs(even - odd) < 1e-35 if n == 4 else (even > odd) == (n == 3)
    scales[n] = [round(float(mpf(value.mid)), 6) for value in (even, odd)]
    for i in range((n + 1) // 2):  # the others are their mirror images
        face = Face("dart", n, i)
        phi_e = face.eigenfunction(even_ring, even)
        assert positive(minor(phi_e, face.eigenfunction(odd_ring, odd)))
scales

# %% [markdown]
# $N = 2$: the even values 0.388 and -0.281 beat the odd one, $\frac14$. Their pair wins, with a
# sign that changes at every step: no limit.

# %%
even, others = dart_values(2)
assert max(others) > 0.28 > FOURTH

# %% [markdown]
# ## 5. No limit normal
#
# On a crease all interior waves are zero, and so is their derivative along it. There the derivative
# along it is that of the curve, $T$ on a crease, $S_0$ and $S_k$ at a corner, and the derivative
# across follows the wave 1: its points inside the sector are positive, for every $k$, and so are
# the outer ones, positive combinations of them; on the crease $\partial \varphi / \partial v$ is a
# spline of the row beside it, hence positive. So along the creases the normal tends to
# $T \times P_1$, or to $S_0 \times P_1$ on one side and $P_1 \times S_k$ on the other side of a
# corner.
#
# - *Corners of $k \ge 3$*: the value of the wave 1 beats the $\frac12$ of $S_0$ and $S_k$. These
#   two limits are both there, and different.
# - *Creases of $k \ge 5$*: the value of the wave 2 beats $\frac12$, too, and inside the pair of the
#   waves 1 and 2 wins: $P_1 \times P_2$ where its minor is not zero. It is not zero everywhere:
#   about the middle of the sector $\varphi_1$ is even and $\varphi_2$ odd, and zero there. If the
#   minor vanished, $\varphi_2$ would be constant along the level lines of $\varphi_1$, which cross
#   the middle (on it $\varphi_1$ tends to zero towards $v$, and is not zero): so it would be zero,
#   with all its control points.
# - *Cones*: the wave of frequency 0 has one function and the largest value. It is in all the pairs
#   that win, (0, cosine) and (0, sine) of frequency 1: $P_0 \times (m_{0c} P_c + m_{0s} P_s)$ turns
#   with the direction of approach, as on a cone.
# - *Pendants and flaps* ([sectors](sectors.py), section 9) have one function more, of the value
#   $\frac14$. A pendant is no better off than a cone. In a flap $e_0 = e_k$, so that $S_0 = S_k$:
#   for $k \ge 3$ the limits $S_0 \times P_1$ and $P_1 \times S_k$ along its two sides are opposite.
#   For $k = 2$ both functions of the value $\frac12$ that are left are even about the middle of the
#   sector, and the normals on its two faces are opposite.
#
# The value of the wave $m$ beats $\frac12$ if $\cos(m\pi / (2k))^2 > \frac12$, that is $m < k/2$.

# %%
for k in range(2, 14):
    for m in range(1, k):
        _, value = wave(k, m)
        assert 2 * m == k or (value > HALF) == (2 * m < k)


# %% [markdown]
# ## 6. The scale of derivatives
#
# As in [limit_masks](limit_masks.py), section 5, first derivatives follow $(2\lambda)^n$ at the
# distance $2^{-n}$, second ones $(4\lambda)^n$, times $n$ along a chain. $\lambda_1$ is the value
# of the wave 1, which grows with $k$:
#
# | vertex | normal at $v$ | first derivatives |
# | --- | --- | --- |
# | crease, $k = 1$ | $T \times Q$ | bounded: $T$ along $u$, $-T$ along $v$, $n / 2^n$ across |
# | crease, $k = 2$ | $T \times P_1$ | bounded (spline) |
# | crease, $k = 3$ | $T \times P_1$ | $(2\lambda_1)^n = 1.16^n$ across, $T$ along the crease |
# | crease, $k = 4$ | $T \times P_1$ | $(2\lambda_1)^n = 1.22^n$ across, $T$ along the crease |
# | crease, $k \ge 5$ | none | $(2\lambda_1)^n$, to $1.31^n$ |
# | corner, $k = 1$ | $S_0 \times S_1$ | bounded (spline) |
# | corner, $k = 2$ | $S_0 \times S_2$ | $n$ |
# | corner, $k \ge 3$ | none | $(2\lambda_1)^n$ |
# | cone, pendant | none | $(2\lambda_0)^n = 1.31^n$ at every valence, 4 included |
# | flap | none | as a corner |
# | dart, $N = 2$ | none | $0.78^n$: they vanish |
# | dart, $N = 3$ | $P_e \times P_o$ | $0.92^n$ and $0.82^n$: they vanish |
# | dart, $N = 4$ | $P_e \times P_o$ | bounded |
# | dart, $N = 5$ | $P_e \times P_o$ | $(2L_e)^n = 1.05^n$ and $(2L_o)^n = 1.10^n$ |
# | dart, $N \ge 6$ | $P_e \times P_o$ | $(2L_e)^n$ and $(2L_o)^n$, to $1.31^n$ |
#
# On a crease itself the derivative along it is that of the curve in every sector: $T$ at $v$, and
# at a corner $S_0$ or $S_k$. Second derivatives are bounded in the splines alone; at a crease of
# $k = 1$ they grow like $n$, at a dart of $N = 4$ like $1.28^n$.

# %%
for number, expected in (
    (2 * wave(3, 1)[1], "1.159"),
    (2 * wave(4, 1)[1], "1.222"),
    ((3 + iv.sqrt(5)) / 4, "1.309"),  # the limit of many faces, and the cone
    (2 * dart_values(2)[0], "0.776"),
    (2 * dart_values(3)[0], "0.924"),
    (2 * wave(3, 2)[1], "0.820"),
    (2 * dart_values(5)[0], "1.053"),
    (2 * wave(5, 2)[1], "1.100"),
    (4 * iv.mpf(dart_values(4)[1][0]), "1.279"),
):
    assert abs(number - iv.mpf(expected)) < iv.mpf("0.0005")

# %% [markdown]
# ## 7. By brute force
#
# Steps of the rules themselves, on a ring and outer points without a pattern; the normals at the
# corners of the three quarters of each face, from the first to the middle one.


# %%
def cross(p, q):
    return [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]


def angle(p, q):
    """In degrees; exact to rounding for small angles."""
    p, q = ([c / norm(r) for c in r] for r in (p, q))
    sine, cosine = norm(cross(p, q)), fdot(p, q)
    return degrees(atan2(sine, cosine))


def combined(mask, ring):
    return [fdot(mask, [point[c] for point in ring]) for c in range(3)]


def difference(p, q):
    return [a - b for a, b in zip(p, q, strict=True)]


def points(count, seed=0):
    return [
        [mpf(7 * i * i % 11), mpf((3 * i + 5) % 7), mpf((i + seed) ** 3 % 13)] for i in range(count)
    ]


def normals(kind, k, ring, steps):
    """After so many steps, by face, quarter and corner of the quarter."""
    found = {}
    for i in range((k + 1) // 2):
        face = Face(kind, k, i)
        nets, outer_points = [], points(len(face.outer), i)
        for c in range(3):
            inner = [point[c] for point in ring]
            outer = dict(zip(face.outer, (point[c] for point in outer_points), strict=True))
            for _ in range(steps):
                old = outer | {place: inner[index] for place, index in face.ring.items()}
                outer, inner = face.refined(old, face.outer), refined_ring(kind, k, inner)
            new = outer | {place: inner[index] for place, index in face.ring.items()}
            nets.append(face.quarters(old, new))
        for quarter, coordinates in enumerate(zip(*nets, strict=True)):
            both = [derivatives(net) for net in coordinates]
            for a, b in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
                f_u, f_v = ([along[side][a][b] for along in both] for side in (0, 1))
                found[i, quarter, a, b] = cross(f_u, f_v)
    return found


# %% [markdown]
# *Crease, $k = 2$ and $3$, and corner, $k = 1$*: at once.

# %%
mp.dps = 150
for k in (2, 3):
    ring = points(2 * k + 2)
    normal = cross(difference(ring[1], ring[-1]), combined(interior_mask(k)[0], ring))
    assert all(angle(n, normal) < 1e-12 for n in normals("crease", k, ring, 200).values())

ring = points(4)
normal = cross(difference(ring[1], ring[0]), difference(ring[3], ring[0]))
assert all(angle(n, normal) < 1e-12 for n in normals("corner", 1, ring, 200).values())

# %% [markdown]
# *Crease, $k = 1$ and $4$, and corner, $k = 2$*: like $1/n$.

# %%
for kind, k in (("crease", 1), ("crease", 4), ("corner", 2)):
    ring = points(2 * k + 2)
    first, last = difference(ring[1], ring[0]), difference(ring[-1], ring[0])
    normal = {
        ("crease", 1): cross(
            difference(first, last), [p + q for p, q in zip(first, last, strict=True)]
        ),
        ("crease", 4): cross(difference(first, last), combined(interior_mask(4)[0], ring)),
        ("corner", 2): cross(first, last),
    }[kind, k]
    farther, nearer = (
        max(angle(n, normal) for n in normals(kind, k, ring, steps).values()) for steps in (80, 160)
    )
    assert 1.8 < farther / nearer < 2.2
    assert nearer < 10

# %% [markdown]
# *The published masks*, on a ring of a paraboloid, half a turn wide: off by 3.9 and 7.7 degrees.

# %%
for k, expected in ((2, 0), (3, "3.903"), (4, "7.695")):
    ring = [[mpf(0)] * 3]
    for j in range(2 * k + 1):
        height = mpf(1 + j % 2)
        along = [sqrt(height) * turn(mpf(j) / (2 * k)) for turn in (cospi, sinpi)]
        ring.append([*along, height])
    T = difference(ring[1], ring[-1])
    right, published = (
        cross(T, combined(mask, ring)) for mask in (interior_mask(k)[0], published_mask(k))
    )
    assert abs(angle(right, published) - mpf(expected)) < 0.0005

# %% [markdown]
# *Darts.* $P_e$ by one step of inverse iteration, with the sign that sees $e_0 - v > 0$.

# %%
for n in (3, 4, 7):
    size, ring = 2 * n + 1, points(2 * n + 1)
    value = dart_values(n)[0].b
    shifted = matrix([refined_ring("dart", n, one) for one in units(size)])
    for i in range(size):
        shifted[i, i] -= mpf(value)
    left = lu_solve(shifted, matrix(list(range(1, size + 1))))
    positive_wave = [mpf(point.mid) for point in even_wave(n, value)]
    even = [sign(fdot(left, positive_wave)) * weight for weight in left]
    a, odd = cospi(mpf(1) / n), [mpf(0)]
    for j in range(n):
        odd += [(a + sqrt(4 + a * a)) * sinpi(mpf(2 * j) / n), sinpi(mpf(2 * j + 1) / n)]
    normal = cross(combined(even, ring), combined(odd, ring))
    assert all(angle(m, normal) < 1e-12 for m in normals("dart", n, ring, 200).values())

# %% [markdown]
# *No limit.* Creases of five faces: $T \times P_1$ on the crease, and degrees away from it in the
# middle, there still at right angles to $P_1$. Corners of three: the normal is at right angles to
# $S_0$ on one crease and, by turning the ring over, to $S_3$ on the other, but not to both.

# %%
ring = points(12)
P_1 = combined(interior_mask(5)[0], ring)
normal = cross(difference(ring[1], ring[-1]), P_1)
found = normals("crease", 5, ring, 200)
assert angle(found[0, 0, 0, 0], normal) < 1e-8
assert angle(found[2, 1, 0, 0], normal) > 5
assert abs(angle(found[2, 1, 0, 0], P_1) - 90) < 1e-8

ring = points(8)
for turned in (ring, ring[:1] + ring[:0:-1]):
    normal = normals("corner", 3, turned, 200)[0, 0, 0, 0]
    assert abs(angle(normal, difference(turned[1], turned[0])) - 90) < 1e-8
    assert abs(angle(normal, difference(turned[-1], turned[0])) - 90) > 5

# %% [markdown]
# ## 8. Edges along which derivatives vanish
#
# Beside a side $y = 0$ of a face, $x$ along it and $y$ inwards, the surface is
# $\sum_j \frac{y^j}{j!} S_j(x)$. Let $S_p'$ be the first of the $S_j'$ that is not zero for all
# $x$, and $S_{q+1}$ the first of $S_1, S_2, \ldots$ Then
#
# $$
# f_x \times f_y = y^{p+q} \left( \frac{S_p' \times S_{q+1}}{p! \, q!} + O(y) \right) ,
# $$
#
# so from inside the normal tends to $S_p' \times S_{q+1}$ wherever that is not zero. Where the
# points of a boundary or crease coincide ($p = 1$, $q = 0$) it is $f_{xy} \times f_y$; where the
# row beside a boundary repeats it ($q = 2$, as $f_{yy}$ is zero on boundaries)
# $f_x \times f_{yyy}$.

# %%
X, Y, *S = symbols("x y a:12")
for gone, p, q in (((0,), 1, 0), ((1, 2), 0, 2), ((1,), 0, 1)):
    parts = [(Matrix(S[3 * j : 3 * j + 3]) + X * Matrix(S[j : j + 3])) for j in range(4)]
    parts = [part * int(j not in gone) for j, part in enumerate(parts)]
    f = sum((parts[j] * Y**j / factorial(j) for j in range(4)), Matrix([0, 0, 0]))
    normal = f.diff(X).cross(f.diff(Y))
    limit = parts[p].diff(X).cross(parts[q + 1]) / (factorial(p) * factorial(q))
    for component, expected in zip(normal, limit, strict=True):
        powers = Poly(component, Y)
        assert all(powers.coeff_monomial(Y**k) == 0 for k in range(p + q))
        assert expand(powers.coeff_monomial(Y ** (p + q)) - expected) == 0

# %% [markdown]
# On a smooth edge the face on the other side counts as well. There $y < 0$, and if $p + q$ is odd
# its limit is the opposite one, as derivatives of first and second order are continuous: the
# surface is folded, as where a polygon is glued to its own back ($f_y = 0$, $p = 0$, $q = 1$), and
# has no normal. A reflection $M$ that maps the net onto itself, $f(x, -y) = M f(x, y)$, takes the
# normal of one side to that of the other, since for $\det M = -1$
#
# $$
# M a \times (-M b) = M (a \times b) :
# $$
#
# they agree where the normal lies in the mirror plane, and there alone.

# %%
a, b = Matrix(S[:3]), Matrix(S[3:6])
mirror = Matrix.diag(1, 1, -1)
assert (mirror * a).cross(-mirror * b).expand() == (mirror * a.cross(b)).expand()

# %% [markdown]
# *At a vertex* whose sharp edges are points on both sides, $e_0 = e_k = v$, only the waves are
# left. Of these the pair (1, 2) wins. Its minor is negative but on the edges, where all minors
# vanish, and this one of first order: so the normal tends to $P_2 \times P_1$, for each $k \ge 2$
# that is tried here. In a corner of one face, where
# $f = u S_0 + v S_1 + u v P$ is what matters, it is $P \times S_1$ if $S_0$ is zero, and
# $S_0 \times P$ if $S_1$ is.

# %%
for k in range(2, 9):
    # for k = 2 the surface is a spline, with v and uv
    second = wave(k, 2) if k > 2 else (intervals(0, 0, 1, 0, -1, 0), FOURTH)
    for i in range(k):
        face = Face("crease", k, i)
        both = zip(face.eigenfunction(*wave(k, 1)), face.eigenfunction(*second), strict=True)
        for quarter, (one, other) in enumerate(both):
            net = list(minor([one], [other]))
            edge = [*range(0, 36, 6)] if face.low and quarter == 0 else []
            edge += range(6) if face.left and quarter == 2 else []
            assert all(abs(net[m]) < 1e-40 for m in edge)
            assert positive(-m for j, m in enumerate(net) if j not in edge)
