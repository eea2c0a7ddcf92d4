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
"""How derivatives, normals and curvature behave on the way to a special vertex.

After Reif (1995), Peters and Reif (1998), Sabin (1991) and Karciauskas, Peters, Reif (2004).

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # The scale of derivatives, normals and curvature
#
# Around a smooth vertex of valence $N$ let $\lambda$ be the subdominant eigenvalue (a pair, of
# frequency 1) and $\mu$ the next smaller one. After $n$ halvings of the distance to the vertex this
# document proves, for every $N \ge 3$ and control points in general position:
#
# | | scale | $N = 3$ | $N = 4$ | $N \ge 5$ |
# |---|---|---|---|---|
# | first derivatives | $(2 \lambda)^n$ | tend to 0 | have a limit | grow without bound |
# | second derivatives | $(4 \lambda)^n$, at $N = 4$ $(4 \mu)^n$ | grow | have a limit | grow |
# | unit normal, distance from its limit | $(\mu / \lambda)^n$ | tends to 0 | to 0 | to 0 |
# | curvature | $(\mu / \lambda^2)^n$ | tends to 0 | has a limit | grows without bound |
# | $\mu$ belongs to | | frequency 0 | 0 and 2 | frequency 2 |
#
# All inequalities are proved for every $N$, including that the characteristic map is regular
# (part 2), by a rational parametrisation of the spectrum. Part 7 does the same for boundaries,
# creases, corners, cones and darts, whose numbers are checked kind by kind.
#
# Used from other documents: the spectrum ([eigenstructure](eigenstructure.py)), eigenfunctions and
# their halving ([eigenfunctions](eigenfunctions.py)), curvature ([curvature](curvature.py)), Jordan
# blocks ([sectors](sectors.py)).
#
# - U. Reif, "A unified approach to subdivision algorithms near extraordinary vertices", Computer
#   Aided Geometric Design 12 (1995): the characteristic map.
# - J. Peters, U. Reif, "Analysis of algorithms generalizing B-spline subdivision", SIAM Journal on
#   Numerical Analysis 35 (1998): that of Catmull and Clark is regular.
# - M. Sabin, "Cubic recursive division with bounded curvature", Curves and Surfaces (1991): the
#   role of $\mu / \lambda^2$.
# - K. Karciauskas, J. Peters, U. Reif, "Shape characterization of subdivision surfaces - case
#   studies", Computer Aided Geometric Design 21 (2004): cups and saddles.

# %%
from itertools import pairwise
from math import comb

from mpmath import cospi, fdot, matrix, mp, mpf, polyroots, zeros
from mpmath import sqrt as root
from sympy import (
    QQ,
    Matrix,
    Poly,
    Rational,
    Symbol,
    cos,
    expand,
    factor,
    pi,
    rem,
    simplify,
    solve,
    sqrt,
    symbols,
)
from sympy.polys.fields import field
from sympy.polys.matrices import DomainMatrix

from limitsurf.exact.matrices import grid_index, subdivision_matrix
from limitsurf.scheme.catmull_clark import CATMULL_CLARK
from limitsurf.scheme.sector import Sector

# %% [markdown]
# ## 1. One parameter for all valences
#
# [eigenstructure](eigenstructure.py) derives that $\lambda$ belongs to the waves of frequency 1,
# with $s = \cos(\pi / N)$ and
#
# $$ \lambda^2 - \frac{2 + s^2}{4} \lambda + \frac1{16} = 0 . $$
#
# With $s = \tau - 1/\tau$ its roots are $\tau^2 / 4$ and $1 / (4 \tau^2)$. So for $\tau > 1$
#
# $$ \lambda = \frac{\tau^2}{4}, \qquad s = \tau - \frac1\tau , $$
#
# both growing with $\tau$: all valences are points of a rational curve, from
# $\tau = (1 + \sqrt{17}) / 4$ at $N = 3$ over $\sqrt 2$ at $N = 4$ towards the golden ratio.
# Whatever holds for $5/4 \le \tau \le 13/8$ holds for every $N \ge 3$.

# %%
tau = Symbol("tau", positive=True)
lam, s = tau**2 / 4, tau - 1 / tau
x = Symbol("x")
ring_polynomial = x**2 - (2 + s**2) / 4 * x + Rational(1, 16)
assert expand(ring_polynomial - (x - lam) * (x - 1 / (4 * tau**2))) == 0
at_3, at_4, at_infinity = (1 + sqrt(17)) / 4, sqrt(2), (1 + sqrt(5)) / 2
for place, value in ((at_3, cos(pi / 3)), (at_4, cos(pi / 4)), (at_infinity, 1)):
    assert simplify(s.subs(tau, place) - value) == 0
assert Rational(5, 4) < at_3 < at_4 < at_infinity < Rational(13, 8)

# %% [markdown]
# ## 2. The characteristic map is regular
#
# Let $x$ and $y$ be the eigenfunctions of the cosine and the sine wave of frequency 1. The map
# $(u, v) \mapsto (x, y)$, around all $N$ faces, is the characteristic map. Claim: its Jacobian
# $x_u y_v - x_v y_u$ is positive everywhere but at the vertex, for every $N \ge 3$ (Peters and
# Reif).
#
# By the halving identity it suffices to look at the three pieces of one face, by rotation at one
# face, and by reflection in its diagonal at two of the pieces. The ring of both waves is in
# [eigenstructure](eigenstructure.py), the sine divided by $\sin(\pi / N)$; outer points follow from
# the eigenvalue equation; all of it is rational in $\tau$. On a piece the Jacobian is a polynomial
# of degree 5 in each parameter, whose 36 Bernstein coefficients are rational functions of $\tau$.
# If they have neither zero nor pole between 5/4 and 13/8 (Sturm's theorem counts them), and are
# positive at 5/4, they are positive for all $N$, and so is the Jacobian.

# %%
RATIONAL, T = field("tau", QQ)
LINES = [{0: 4, 1: 4}, {0: 1, 1: 6, 2: 1}, {1: 4, 2: 4}, {1: 1, 2: 6, 3: 1}, {2: 4, 3: 4}]
OUTER = [(3, 0), (3, 1), (3, 2), (3, 3), (2, 3), (1, 3), (0, 3)]
BEYOND = [(4, 0), (4, 1), (4, 2), (4, 3), (4, 4), (3, 4), (2, 4), (1, 4), (0, 4)]


def insertion(place):
    """Weights of the places of a grid in a refined one (subdivision_matrix.py)."""
    first, second = (LINES[line] for line in place)
    return {(i, j): QQ(a * b, 64) for i, a in first.items() for j, b in second.items()}


def bezier(net):
    """Bezier points of one piece of a bicubic spline, from its 4 x 4 control points."""
    for _ in range(2):
        columns = zip(*net, strict=True)
        net = [
            [(a + 4 * b + c) / 6, (2 * b + c) / 3, (b + 2 * c) / 3, (b + 4 * c + d) / 6]
            for a, b, c, d in columns
        ]
    return net


def pieces(ring, value):
    """The first two pieces of the eigenfunction of a vector on the ring."""
    rows = [insertion(place) for place in OUTER]
    block = [
        [value * (old == place) - row.get(old, 0) for old in OUTER]
        for place, row in zip(OUTER, rows, strict=True)
    ]
    brought = [[sum(row[old] * ring[old] for old in row if old in ring)] for row in rows]
    domain = RATIONAL.to_domain()
    outer = DomainMatrix(block, (7, 7), domain).lu_solve(DomainMatrix(brought, (7, 1), domain))
    points = ring | {place: found for place, (found,) in zip(OUTER, outer.to_list(), strict=True)}
    new = {place: value * point for place, point in points.items()}
    for place in BEYOND:
        new[place] = sum(w * points[old] for old, w in insertion(place).items())
    return [
        bezier([[new[i + k, j + m] for m in range(4)] for k in range(4)])
        for i, j in ((1, 0), (1, 1))
    ]


def differences(net):
    """Bezier points of the derivatives along u and v, up to the factor 3."""
    along_v = [[b - a for a, b in pairwise(row)] for row in net]
    along_u = [[b - a for a, b in zip(*rows, strict=True)] for rows in pairwise(net)]
    return along_u, along_v


def times(first, second):
    """Bernstein coefficients of a product, up to positive factors."""
    m, n, p, q = (len(x) - 1 for x in (first, second, first[0], second[0]))
    result = [[0] * (p + q + 1) for _ in range(m + n + 1)]
    for i, row in enumerate(first):
        for j, a in enumerate(row):
            for k, other in enumerate(second):
                for r, b in enumerate(other):
                    result[i + k][j + r] += (
                        comb(m, i) * comb(p, j) * comb(n, k) * comb(q, r) * a * b
                    )
    return result


def positive(function):
    """Whether a rational function is positive for all tau from 5/4 to 13/8."""
    low, high = Rational(5, 4), Rational(13, 8)
    parts = [Poly(part.as_expr(tau), tau) for part in (function.numer, function.denom)]
    sign = parts[0].eval(low) * parts[1].eval(low)
    return sign > 0 and not any(part.count_roots(low, high) for part in parts)


# %% [markdown]
# The rings, with $E = 4 \lambda - 1$ and $F = 2 s$: $e_j = E \cos((j - 1/2) \theta)$ and
# $f_j = F \cos(j \theta)$, $\theta = 2 \pi / N$, and sines; $(1, 1)$ is the vertex, $(2, 1) = e_0$,
# $(2, 2) = f_0$, $(1, 2) = e_1$.

# %%
S = T - 1 / T
E, F, once, thrice = T**2 - 1, 2 * S, 2 * S**2 - 1, 4 * S**3 - 3 * S
cosine = {(1, 1): T - T, (2, 1): E * S, (2, 2): F, (1, 2): E * S}
cosine |= {(0, 2): F * once, (0, 1): E * thrice, (1, 0): E * thrice, (2, 0): F * once}
sine = {(1, 1): T - T, (2, 1): -E, (2, 2): T - T, (1, 2): E}
sine |= {(0, 2): 2 * S * F, (0, 1): E * (4 * S**2 - 1)}
sine |= {(1, 0): -E * (4 * S**2 - 1), (2, 0): -2 * S * F}
for first, second in zip(pieces(cosine, T**2 / 4), pieces(sine, T**2 / 4), strict=True):
    (x_u, x_v), (y_u, y_v) = differences(first), differences(second)
    for row, other in zip(times(x_u, y_v), times(x_v, y_u), strict=True):
        assert all(positive(a - b) for a, b in zip(row, other, strict=True))

# %% [markdown]
# ## 3. First derivatives
#
# Let $\varphi_k$ be the eigenfunctions of a face, $P_k$ the coefficients of the surface in them and
# $p = (u, v)$ a point of the three pieces. With $\varphi_k(p / 2^n) = \lambda_k^n \varphi_k(p)$ and
# the chain rule,
#
# $$ \partial_u^i \partial_v^j X (p / 2^n) = \sum_k (2^{i + j} \lambda_k)^n\,
#    \partial_u^i \partial_v^j \varphi_k(p)\, P_k . \qquad (1) $$
#
# For first derivatives the pair $\lambda$ leads:
#
# $$ X_u = (2 \lambda)^n (x_u P_1 + y_u P_2) + O((2 \mu)^n) . $$
#
# Let $P_1$ and $P_2$ be independent. As $(x_u, y_u) \ne 0$ by part 2, the bracket is never zero,
# and on three closed pieces its length lies between two positive constants. So $\left|X_u\right|$
# is of the order of $(2 \lambda)^n$ exactly, from whatever direction, and so is $\left|X_v\right|$.
# Now $2 \lambda = \tau^2 / 2$ grows with $N$ and is 1 at $\tau = \sqrt 2$:
#
# $$ 2 \lambda < 1 \;(N = 3), \qquad 2 \lambda = 1 \;(N = 4), \qquad 2 \lambda > 1 \;(N \ge 5) . $$

# %%
assert (2 * lam).diff(tau).is_positive
assert s.diff(tau).is_positive
assert (2 * lam).subs(tau, at_4) == 1
numbers = {n: (2 * lam).subs(tau, (cos(pi / n) + sqrt(cos(pi / n) ** 2 + 4)) / 2) for n in (3, 5)}
assert simplify(numbers[3] - (9 + sqrt(17)) / 16) == 0
assert numbers[3] < 1 < numbers[5]
assert simplify((2 * lam).subs(tau, at_infinity) - (3 + sqrt(5)) / 4) == 0  # 1.309

# %% [markdown]
# ## 4. Second derivatives
#
# By (1) they are $(4 \lambda)^n (x_{uu} P_1 + y_{uu} P_2)$ and so on, and $4 \lambda = \tau^2 > 1$
# for every $N$. If all second derivatives of $x$ were zero, $x$ would be $a + b u + c v$, and
# halving, which multiplies $x$ by $\lambda$, would say $a = 0$ and $\lambda = 1/2$. So for
# $N \ne 4$ they are not all zero and second derivatives grow like $(4 \lambda)^n$ (from some
# direction of approach; others may be spared): at $N = 3$, where the first vanish, too.
#
# At $N = 4$, $x$ and $y$ are linear; $\mu = 1/4$ is next and $4 \mu = 1$: the second derivatives of
# a bicubic polynomial.
#
# ## 5. Which eigenvalue is next
#
# Candidates are: frequency 0, with the roots of
# $\mu^2 - \frac{3 N - 7}{4 N} \mu + \frac{N - 3}{16 N}$; the other frequencies, $\lambda_+(f)$ and
# $\lambda_-(f)$; the outer block, at most $1/8$. By [eigenstructure](eigenstructure.py),
# $\lambda_+(f)$ grows with $\left|\cos(\pi f / N)\right|$ from $1/4$ on, and all $\lambda_-$ are at
# most $1/4$, $1/16 \cdot 1/\lambda_+$.
#
# **$N = 3$**: there are frequencies 0 and 1 only. $1/6$ of frequency 0 is larger than
# $\lambda_-(1) = (9 - \sqrt{17}) / 32 = 0.152$. So $\mu = 1/6$, a cup.
#
# **$N = 4$**: $1/4$ once from frequency 0 and twice from frequency 2, whose cosine is 0;
# $\lambda_- = 1/8$.
#
# **$N \ge 5$**: $\mu = \lambda_+(2)$, twice, a saddle; it is at least its value at $N = 5$, above
# $1/4$. Frequency 0 must be shown to be smaller. Let $q$ be its quadratic. Modulo the equation of
# $m = \lambda_+(2)$, with $\sigma = \sin(2 \pi / N)$,
#
# $$ 4 N q(m) = m\, (7 - N \sigma^2) - \tfrac34 . $$
#
# If that is positive and $m$ lies right of the middle $(3 N - 7) / (8 N)$ of the roots of $q$, both
# are below $m$.
#
# - $N = 5, 6, 7$: in numbers.
# - $N \ge 8$: $\cos(2 \pi / N)^2 \ge 1/2$, so $m \ge 1/2 > 3/8$, and
#   $N \sigma^2 \le 4 \pi^2 / N \le \pi^2 / 2$, so that
#   $4 N q(m) \ge \frac12 (7 - \pi^2 / 2) - \frac34 > 0$.

# %%
N, m, sigma = symbols("N m sigma", positive=True)
quadratic = x**2 - (3 * N - 7) / (4 * N) * x + (N - 3) / (16 * N)
wave = m**2 - (2 + 1 - sigma**2) / 4 * m + Rational(1, 16)
reduced = rem(expand(4 * N * quadratic.subs(x, m)), expand(4 * N * wave), m)
assert expand(reduced - (m * (7 - N * sigma**2) - Rational(3, 4))) == 0


def upper(cosine):
    return ((cosine + sqrt(4 + cosine**2)) / 4) ** 2


assert set(solve(quadratic.subs(N, 3), x)) == {0, Rational(1, 6)}
assert (9 - sqrt(17)) / 32 < Rational(1, 6)
assert set(solve(quadratic.subs(N, 4), x)) == {Rational(1, 4), Rational(1, 16)}
for n in (5, 6, 7):
    value, height = upper(cos(2 * pi / n)), 1 - cos(2 * pi / n) ** 2
    assert value > Rational(1, 4)
    assert value > Rational(3 * n - 7, 8 * n)
    assert (value * (7 - n * height) - Rational(3, 4)).evalf(30) > Rational(1, 20)
assert expand(upper(sqrt(Rational(1, 2)))) == Rational(1, 2)
assert (7 - pi**2 / 2) / 2 - Rational(3, 4) > 0

# %% [markdown]
# *Shape.* For $N \ge 5$ the height over the tangent plane that counts near the vertex is a wave of
# frequency 2, up in two opposite directions and down between them, whatever the control points
# (in general position) are: close enough, the surface looks like a saddle even if its cage is a
# cup. At $N = 3$ it is a cup. See Karciauskas, Peters and Reif.
#
# ## 6. Normal and curvature
#
# Let $P_1$ and $P_2$ be independent, take the vertex as origin and write points of space as
# $\xi P_1 + \eta P_2 + \zeta n_0$, with $n_0$ the unit vector along $P_1 \times P_2$. On the pieces
# of level $n$, with $z$ a sum of the eigenfunctions of $\mu$, each times the component of its $P_k$
# along $n_0$,
#
# $$ \xi = \lambda^n (x + O((\mu / \lambda)^n)), \qquad
#    \eta = \lambda^n (y + O((\mu / \lambda)^n)), \qquad
#    \zeta = \mu^n (z + O((\mu' / \mu)^n)) , $$
#
# where $\mu' < \mu$ is the next eigenvalue and the errors include two derivatives: all functions
# are finite sums of fixed bicubic pieces. By part 2 $(x, y)$ can serve as parameters, so close to
# the vertex $(\xi, \eta) / \lambda^n$ can, and the surface is a graph over its tangent plane,
#
# $$ \zeta = \mu^n\, h(\xi / \lambda^n, \eta / \lambda^n) + \ldots, \qquad h(x(p), y(p)) = z(p) . $$
#
# Its slope is $(\mu / \lambda)^n \nabla h$, its second derivatives are
# $(\mu / \lambda^2)^n \nabla^2 h$:
#
# - **Normals.** The slope tends to zero: unit normals converge to $n_0$, like $(\mu / \lambda)^n$,
#   and not faster, except where $\nabla h = 0$.
# - **Curvature.** Where the slope is small, curvature is the matrix of second derivatives in
#   orthonormal coordinates ([curvature](curvature.py), part 5), up to $1 + O(\text{slope})$. So it
#   is of the order of $(\mu / \lambda^2)^n$. The powers of 2 of the parameters have cancelled.
#
# And $\nabla^2 h$ is not zero everywhere: else, around the vertex, $z = a + b x + c y$. Halving
# turns this into $\mu z = a + \lambda b x + \lambda c y$, so $a = b = c = 0$ and $z = 0$; but
# eigenfunctions are independent ([eigenfunctions](eigenfunctions.py), part 5).
#
# **The quotient.** $\mu / \lambda^2$ is
#
# - $N = 3$: $\frac16 \big/ \lambda^2 = 0.99100 < 1$. Curvature tends to zero, very slowly: to one
#   half after 77 halvings. The limit point is a flat point.
# - $N = 4$: $\frac14 \big/ \frac14 = 1$.
# - $N \ge 5$: larger than 1, and curvature is unbounded, for every $N$. To see this let
#   $t = 4 \lambda = \tau^2$ and $c = \cos(2 \pi / N) = 2 s^2 - 1$. As $\mu = e^{2 y} / 4$ with
#   $2 \sinh y = c$, the claim $\mu > \lambda^2$ says $e^{y} > t / 2$, and since $\sinh$ grows,
#   $c > t / 2 - 2 / t$. But
#
# $$ c - \Big( \frac t2 - \frac2t \Big) = 2 t + \frac2t - 5 - \frac t2 + \frac2t
#    = \frac{(3 t - 4)(t - 2)}{2 t} , $$
#
#   which is positive if and only if $t > 2$ (as $t > 4/3$), that is $\lambda > 1/2$, $N \ge 5$.

# %%
t = Symbol("t", positive=True)
c = expand(2 * s**2 - 1)
assert expand(c - (2 * t + 2 / t - 5).subs(t, tau**2)) == 0
assert factor(2 * t + 2 / t - 5 - (t / 2 - 2 / t)) == (t - 2) * (3 * t - 4) / (2 * t)
grown = t**2 / 4  # e^(2 y) if mu were lambda^2
assert simplify((sqrt(grown) - 1 / sqrt(grown)) - (t / 2 - 2 / t)) == 0

flat = Rational(1, 6) / lam.subs(tau, at_3) ** 2
assert flat < 1
assert abs(flat.evalf(20) - Rational("0.99100")) < Rational(1, 10**5)
assert (flat**76).evalf(30) > Rational(1, 2) > (flat**77).evalf(30)
for n, digits in ((5, "1.1244"), (6, "1.2204"), (8, "1.3388"), (50, "1.5225")):
    quotient = upper(cos(2 * pi / n)) / upper(cos(pi / n)) ** 2
    assert abs(quotient.evalf(20) - Rational(digits)) < Rational(1, 10**4)
assert expand(upper(1) * (6 - 2 * sqrt(5))) == 1  # the limit of many faces: 1.5279

# %% [markdown]
# ## 7. Boundaries, creases, corners, cones and darts
#
# Let $\lambda_1 \ge \lambda_2$ belong to the two eigenfunctions $x, y$ whose minor leads
# ([limit_normals](limit_normals.py)), $\lambda_3$ be the next, all by modulus. Then
# $\xi = \lambda_1^n x$, $\eta = \lambda_2^n y$, $\zeta = \lambda_3^n z$ up to smaller terms, and
# for the graph
#
# $$ \zeta = \lambda_3^n\, h(\xi / \lambda_1^n, \eta / \lambda_2^n) $$
#
# the second derivatives are of the orders $(\lambda_3 / \lambda_1^2)^n$,
# $(\lambda_3 / \lambda_1 \lambda_2)^n$ and $(\lambda_3 / \lambda_2^2)^n$. The last is the largest:
# curvature is $O((\lambda_3 / \lambda_2^2)^n)$, where the minor does not vanish, up to powers of
# $n$ in Jordan blocks. First derivatives are $O((2 \lambda_1)^n)$; second ones
# $O((4 \lambda_1)^n)$, but if $\lambda_1 = 1/2$ belongs to linear functions alone,
# $O((4 \lambda_3)^n)$, or $(4 \lambda_2)^n$ if that is larger and not linear.
#
# **Jordan blocks.** On a chain $A V_g = \lambda V_g + V_p$ ([eigenfunctions](eigenfunctions.py),
# part 2)
#
# $$ \lambda^n \Big( \big( \varphi_g + \tfrac n\lambda \varphi_p \big) P_g + \varphi_p P_p \Big), $$
#
# so what is $(2^k \lambda)^n$ elsewhere becomes $n (2^k \lambda)^n$, in the direction of $P_g$.
# Blocks are at $1/4$ for creases of odd $k$, at $1/2$ for creases of $k = 4 m$ faces and corners of
# even $k$ ([sectors](sectors.py)). At a corner of two faces all is $1/2$, and first derivatives
# grow like $n$; at a crease of one face second derivatives grow like $n (4 \cdot 1/4)^n = n$; at a
# crease of four the normal needs $1 / n$ to arrive, as $\lambda_3 = \lambda_2$ and the chain
# decides by its factor $n$.

# %%
lead, n = symbols("lambda n", positive=True)
g, p, P_g, P_p = symbols("phi_g phi_p P_g P_p")
block = Matrix([[lead**n, n * lead ** (n - 1)], [0, lead**n]])
expansion = (Matrix([[p, g]]) * block * Matrix([P_p, P_g]))[0]
assert simplify(expansion - lead**n * ((g + n / lead * p) * P_g + p * P_p)) == 0

# %% [markdown]
# The numbers of the table in the documentation of `LimitSurface`, from the eigenvalues of the
# library's matrices: kind, faces, $\lambda_1, \lambda_2, \lambda_3$ (up to sign), then the bases of
# the powers of first derivatives, second derivatives and curvature; 1 stands for bounded, for a
# limit, or for a power of $n$.

# %%
mp.dps = 40
TABLE = """
    interior 2  0.250 0.250 0.250   0.50 1     4
    interior 3  0.410 0.410 0.167   0.82 1.64  0.991
    interior 4  0.500 0.500 0.250   1    1     1
    interior 5  0.550 0.550 0.340   1.10 2.20  1.12
    crease   1  0.500 0.250 0.250   1    1     4
    crease   2  0.500 0.500 0.250   1    1     1
    crease   3  0.580 0.500 0.410   1.16 2.32  1.64
    crease   4  0.611 0.500 0.500   1.22 2.44  2
    crease   5  0.626 0.550 0.500   1.25 2.51  1.65
    corner   1  0.500 0.500 0.250   1    1     1
    corner   2  0.500 0.500 0.500   1    2     2
    corner   3  0.580 0.500 0.500   1.16 2.32  2
    dart     2  0.388 0.281 0.250   0.78 1.55  3.16
    dart     3  0.462 0.410 0.225   0.92 1.85  1.34
    dart     4  0.500 0.500 0.320   1    1.28  1.28
    dart     5  0.550 0.526 0.392   1.10 2.20  1.41
    cone     2  0.655 0.250 0.250   1.31 2.62  4
    cone     3  0.655 0.410 0.410   1.31 2.62  2.44
"""


def exact(kind, faces, position=0):
    """A, its extension and the pieces, as rationals."""
    built = subdivision_matrix(CATMULL_CLARK, Sector(kind, faces, position))
    entries = [[QQ(row.get(k, 0)) for k in range(built.size)] for row in built.rows]
    extended = DomainMatrix(entries, (len(entries), built.size), QQ)
    return extended[: built.size, :], extended, built.pieces


def moduli(kind, faces):
    """Eigenvalues of A by modulus, with multiplicities, without the 1."""
    characteristic = Poly(exact(kind, faces)[0].charpoly(), x, domain=QQ)
    found = []
    for irreducible, times_ in characteristic.factor_list()[1]:
        roots = polyroots([mpf(c.p) / c.q for c in irreducible.all_coeffs()], maxsteps=200)
        found += [abs(value) for value in roots] * times_
    return sorted(found, reverse=True)[1:]


def linear(kind, faces):
    """Whether all eigenfunctions of the eigenvalue 1/2 are linear, on each face."""
    for position in range(1 if kind in ("interior", "cone") else faces):
        A, extended, pieces_ = exact(kind, faces, position)
        kernel = (A - DomainMatrix.eye(A.shape[0], QQ) * QQ(1, 2)).nullspace().transpose()
        for piece in pieces_:
            for column in (
                (extended.extract(piece, range(A.shape[0])) * kernel).transpose().to_list()
            ):
                net = [column[4 * j : 4 * j + 4] for j in range(4)]
                rows = [[b - a for a, b in pairwise(row)] for row in net]
                across = [[b - a for a, b in zip(*two, strict=True)] for two in pairwise(net)]
                # a bicubic spline is linear where its first differences are constant
                if any(len({value for row in d for value in row}) > 1 for d in (rows, across)):
                    return False
    return True


for kind, faces, *numbers in map(str.split, TABLE.split("\n")[1:-1]):
    one, two, three = moduli(kind, int(faces))[:3]
    second = 4 * one
    if abs(one - 0.5) < 1e-20 and linear(kind, int(faces)):
        second = 4 * (three if abs(two - 0.5) < 1e-20 else two)
    elif abs(one - 0.5) < 1e-20:
        assert (kind, faces) == ("corner", "2")  # the only kind whose 1/2 is not linear
    for number, value in zip(
        numbers, (one, two, three, 2 * one, second, three / two**2), strict=True
    ):
        digits = len(number.partition(".")[2])
        assert abs(value - mpf(number)) <= mpf(10) ** -max(digits, 2) / 2 + mpf(10) ** -30

# %% [markdown]
# ## 8. At the vertex itself
#
# Which derivatives have a value at the vertex? By (1) a derivative of order $k > 0$ is, at the
# point $p$ of the three pieces and $n$ halvings on, a sum of terms
# $(2^k \lambda_i)^n\, \partial \varphi_i(p)\, P_i$ whose $P_i$ are independent of each other. So it
# has a limit for all control points if and only if each term has, and there are these cases:
#
# - all $\left|2^k \lambda_i\right| < 1$: the limit is 0, from everywhere;
# - along the side $v = 0$, a derivative by $u$ alone asks only for the eigenfunctions that are seen
#   there, $\partial_u^k \varphi_i(u, 0) \ne 0$. Each must have $\left|2^k \lambda_i\right| < 1$
#   (its term vanishes in the limit), or $2^k \lambda_i = 1$ and $\partial_u^k \varphi_i$ constant
#   on the side (its term does not depend on $n$, nor on $p$). The limit is the sum of the latter;
# - the head of a Jordan chain brings $n (2^k \lambda)^n$ with the function of its end: where that
#   is seen on the side, $\left|2^k \lambda\right| < 1$ is needed.
#
# This is what the library decides by; otherwise the derivative is NaN. On a sharp edge the surface
# is a cubic spline curve, whose eigenfunctions on the side are $1, u, u^2, u^3$ with eigenvalues
# $1, 1/2, 1/4, 1/8$, so all three derivatives by $u$ exist there. At a smooth vertex of $N = 3$
# first derivatives are 0; second ones do not exist, as $4 \lambda = 1.64$. For $N \ge 5$ not even
# first ones do. In the eigenfunctions of a crease of three faces, exactly:

# %%
A, extended, pieces_ = exact("crease", 3, 0)
basis = Matrix([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6
for degree in (1, 2, 3):
    shifted = A - DomainMatrix.eye(A.shape[0], QQ) * QQ(1, 2**degree)
    chain = shifted * shifted if degree == 2 else shifted  # 1/4 has a chain, whose end is not seen
    power = Matrix(Poly((x + 1) ** degree, x).all_coeffs()[::-1] + [0] * (3 - degree))
    sides = []
    for vector in chain.nullspace().to_list():
        column = DomainMatrix([[value] for value in vector], (A.shape[0], 1), QQ)
        net = (extended.extract(pieces_[0], range(A.shape[0])) * column).to_Matrix()
        # on T = 0 of the first piece, u = (S + 1) / 2: powers of S
        sides.append(basis * Matrix([(net[i] + 4 * net[4 + i] + net[8 + i]) / 6 for i in range(4)]))
    assert any(any(side) for side in sides)
    assert all(Matrix.hstack(side, power).rank() == 1 for side in sides)

# %% [markdown]
# **In rationals**, without eigenvectors of other eigenvalues: let the row $w$ give the derivative
# at the far end $(1, 0)$ of the side. Then $w\, (2^k A)^n$ gives it at $(2^{-n}, 0)$, and where the
# limit exists for general points it is $w \Pi$, with the projector onto the eigenspace of $2^{-k}$,
#
# $$ \Pi = R\, (L R)^{-1} L , $$
#
# from right and left eigenvectors of that one rational eigenvalue: parts of smaller eigenvalues
# vanish in the limit, those of larger ones are not in $w$. At $N = 4$ this must be the derivative
# of the B-spline at its knot, $(-1, 0, 1) / 2$ along and $(1, 4, 1) / 6$ across:

# %%
A, extended, pieces_ = exact("interior", 4)
size = A.shape[0]
ahead, level = [Rational(w, 2) for w in (0, -1, 0, 1)], [Rational(w, 6) for w in (1, 4, 1, 0)]
# d/du = 2 d/dS on the first piece at S = 1, T = 0
row = Matrix([[2 * level[j] * ahead[i] for j in range(4) for i in range(4)]])
row = row * extended.extract(pieces_[0], range(size)).to_Matrix()
shifted = A - DomainMatrix.eye(size, QQ) * QQ(1, 2)
R = shifted.nullspace().transpose().to_Matrix()
L = shifted.transpose().nullspace().to_Matrix()
limit = row * R * (L * R).inv() * L
built = grid_index(Sector("interior", 4)) | {(0, 0): 6}
wanted = Matrix.zeros(1, size)
for i, slope_ in enumerate((-1, 0, 1)):
    for j, weight in enumerate((1, 4, 1)):
        wanted[built[i, j]] = Rational(slope_ * weight, 12)
assert limit == wanted

# %% [markdown]
# ## 9. By brute force
#
# Curvature and normal after 400 and more refinements of points without a pattern, by the library's
# rows and without eigenvectors, at the corner $u = 1/2$, $v = 0$ of the first piece. Successive
# curvatures must have the quotient $\mu / \lambda^2$, successive changes of the normal
# $\mu / \lambda$. (So many, because the eigenvalue after $\mu$ is only a little smaller.)


# %%
def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def unit(a):
    length = root(fdot(a, a))
    return [c / length for c in a]


VALUE, SLOPE, BEND = ([mpf(w) / 6 for w in row] for row in ((1, 4, 1), (-3, 0, 3), (6, -12, 6)))


def curvature_and_normal(net):
    """The larger curvature by modulus, and the unit normal, at the first corner of a net."""

    def derivative(along, across):
        return [
            sum(across[j] * along[i] * net[4 * j + i, c] for j in range(3) for i in range(3))
            for c in range(3)
        ]

    du, dv = derivative(SLOPE, VALUE), derivative(VALUE, SLOPE)
    normal = cross(du, dv)
    area = root(fdot(normal, normal))
    duu, duv, dvv = (
        fdot(normal, derivative(*masks)) / area
        for masks in ((BEND, VALUE), (SLOPE, SLOPE), (VALUE, BEND))
    )
    e, f, g_ = fdot(du, du), fdot(du, dv), fdot(dv, dv)
    mean = (e * dvv - 2 * f * duv + g_ * duu) / (2 * area**2)
    gaussian = (duu * dvv - duv**2) / area**2
    return abs(mean) + root(mean**2 - gaussian), [c / area for c in normal]


def ring_of(quotient):
    return (quotient + root(4 + quotient**2)) ** 2 / 16


mp.dps = 400  # mu^400 is down to 1e-311
for valence, mu in ((3, mpf(1) / 6), (5, None), (8, None)):
    A, extended, pieces_ = exact("interior", valence)
    mu = mu or ring_of(cospi(mpf(2) / valence))
    value = ring_of(cospi(mpf(1) / valence))
    one, whole = (zeros(*M.shape) for M in (A, extended))
    for M, target in ((A, one), (extended, whole)):
        for (i, k), entry in M.to_dok().items():
            target[i, k] = mpf(int(entry.numerator)) / int(entry.denominator)
    C = matrix([[7 * k * k % 11, (3 * k + 5) % 7, k**3 % 13] for k in range(A.shape[0])])
    nets, C = [], one**400 * C
    for _ in range(3):
        points = whole * C
        nets.append(matrix([list(points[k, :]) for k in pieces_[0]]))
        C = one * C
    (k1, n1), (k2, n2), (k3, n3) = map(curvature_and_normal, nets)
    assert abs(k2 / k1 / (mu / value**2) - 1) < 1e-8
    steps_of_normal = [
        root(sum((p - q) ** 2 for p, q in zip(*two, strict=True))) for two in ((n1, n2), (n2, n3))
    ]
    assert abs(steps_of_normal[1] / steps_of_normal[0] / (mu / value) - 1) < 1e-8
