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
"""How float64 gets the digits: coefficients, powers, scales, differences.

After Stam (1998), de Boor (1978) and Sterbenz (1974).

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Floating-point arithmetic without loss
#
# The other documents derive what is to be computed. This one derives the forms in which float64
# computes it, and why these keep the digits:
#
# 1. coefficients of a ring in its waves, by a discrete Fourier transform;
# 2. coefficients in the eigenvectors of the whole matrix, by blocks;
# 3. powers of an eigenvalue that is no float;
# 4. scales that no float holds, taken out;
# 5. points relative to one of them;
# 6. B-spline weights as sums of products of numbers that are not negative;
# 7. parameters around a corner, without rounding where it would matter.
#
# Identities are symbolic. Bounds of rounding errors hold for IEEE 754 double precision,
# $\varepsilon = 2^{-53}$, as long as nothing underflows; those marked so are checked at examples.
#
# - J. Stam, "Exact evaluation of Catmull-Clark subdivision surfaces at arbitrary parameter values",
#   SIGGRAPH 1998: coefficients, and the picture of powers.
# - C. de Boor, "A practical guide to splines", Springer 1978, chapter X: B-splines by recurrence.
# - P. Sterbenz, "Floating-point computation", Prentice-Hall 1974: differences that are exact.

# %%
from fractions import Fraction
from random import Random

import numpy as np
from mpmath import mp, mpf
from sympy import I, Matrix, Rational, Symbol, cos, diag, exp, expand, simplify, sin, symbols

from limitsurf import numbers
from limitsurf._kernels import reference as kernels
from limitsurf.exact.fixed import BITS, product
from limitsurf.exact.matrices import subdivision_matrix
from limitsurf.exact.ring import fourier_ring
from limitsurf.scheme.catmull_clark import CATMULL_CLARK
from limitsurf.scheme.sector import Sector
from limitsurf.tables import eigen_table

EPS = Fraction(1, 2**53)

# %% [markdown]
# ## 1. Coefficients of the ring
#
# The eigenvectors of a ring ([subdivision_matrix](subdivision_matrix.py), section 2) have the
# values $e\, \chi((j - \frac12) \theta)$ at the edge neighbours and $f\, \chi(j \theta)$ at the
# face corners, $\chi$ the cosine or the sine, $\theta = 2 \pi \nu / N$. Waves are orthogonal: a
# product of two is half a sum of waves of the frequencies $\nu + \nu'$ and $\nu - \nu'$, whose sum
# over the ring vanishes unless $N$ divides the frequency. So for $0 < \nu, \nu' < N / 2$
#
# $$ \sum_j \chi_\nu \chi'_{\nu'} = \frac N2 \text{ if they are the same wave, else } 0 , $$
#
# and $N$ for the one of two waves of frequency $N / 2$ that is not zero. Hence the coefficients of
# a wave in the edge neighbours and face corners are $\frac2N \sum E_j \chi$ and
# $\frac2N \sum F_j \chi$, and those in the two eigenvectors of the wave follow by inverting
# $2 \times 2$ numbers:
#
# $$ Q = \begin{pmatrix} e_1 & e_2 \\ f_1 & f_2 \end{pmatrix}, \qquad
#    \frac2N Q^{-1} = \frac{2}{N (e_1 f_2 - e_2 f_1)}
#    \begin{pmatrix} f_2 & -e_2 \\ -f_1 & e_1 \end{pmatrix} . $$
#
# All sums are real and imaginary parts of one Fourier transform of the ring each, turned by half
# an angle for the edge neighbours:
#
# $$ e^{i \theta / 2} \sum_j E_j e^{-i j \theta} = \sum_j E_j \cos((j - \tfrac12) \theta)
#    - i \sum_j E_j \sin((j - \tfrac12) \theta) . $$

# %%
j, theta, e_1, e_2, f_1, f_2 = symbols("j theta e_1 e_2 f_1 f_2", real=True)
turned = exp(I * theta / 2) * exp(-I * j * theta)
parts = cos((j - Rational(1, 2)) * theta) - I * sin((j - Rational(1, 2)) * theta)
assert expand(turned - parts.rewrite(exp), power_base=False) == 0
profiles = Matrix([[e_1, e_2], [f_1, f_2]])
inverse = Matrix([[f_2, -e_2], [-f_1, e_1]]) / (e_1 * f_2 - e_2 * f_1)
assert simplify(profiles * inverse) == Matrix.eye(2)

# %% [markdown]
# The library's right and left eigenvectors of the ring, in numbers of 96 digits: their product is
# 1. And the float64 transform gives the coefficients of these left eigenvectors, for
#    $N = 3, 4, 7, 12$.

# %%
for faces in (3, 4, 7, 12):
    sector = Sector("interior", faces)
    ring = fourier_ring(subdivision_matrix(CATMULL_CLARK, sector))
    points = range(2 * faces + 1)
    right = np.stack([ring.right_rows(points)[k] for k in points])
    unit = product(ring.left(), right)
    for i in points:
        for k in points:
            assert abs(unit[i, k] - ((i == k) << BITS)) < 1 << (BITS - 280)
    random = Random(faces)
    values = np.array([[[random.uniform(-1, 1)] for _ in points]])
    found = eigen_table(CATMULL_CLARK, sector).ring.coefficients(values)[0, :, 0]
    for k, row in enumerate(ring.left()):
        exact = sum(
            Fraction(int(x), 1 << BITS) * Fraction(y)
            for x, y in zip(row, values[0, :, 0], strict=True)
        )
        assert abs(Fraction(found[k]) - exact) < 100 * EPS

# %% [markdown]
# ## 2. Coefficients in all eigenvectors
#
# The matrix is $A = \begin{pmatrix} A_r & 0 \\ B & D \end{pmatrix}$, ring first. With
# $A_r R = R \Lambda$ and $D W = W d$, the eigenvectors are
# $V = \begin{pmatrix} R & 0 \\ W G & W \end{pmatrix}$ if
#
# $$ W^{-1} B R + d\, G = G \Lambda, \qquad G_{mk} = \frac{(W^{-1} B R)_{mk}}{\lambda_k - d_m}, $$
#
# and if $\Lambda$ has a 1 above the diagonal in column $k$, $(W^{-1} B R)_{mk} - G_{m, k-1}$ takes
# the place of the numerator. The inverse needs no elimination:
#
# $$ V^{-1} = \begin{pmatrix} R^{-1} & 0 \\ -G R^{-1} & W^{-1} \end{pmatrix} : $$
#
# coefficients of the ring first (by section 1), then $W^{-1}$ of the outer points less $G$ times
# these. The cost is that of a Fourier transform and of seven rows.

# %%
R, W, G = (Matrix(2, 2, symbols(f"{name}:4")) for name in "rwg")
zero = Matrix.zeros(2, 2)
V = Matrix.vstack(R.row_join(zero), (W * G).row_join(W))
inverse = Matrix.vstack(R.inv().row_join(zero), (-G * R.inv()).row_join(W.inv()))
assert simplify(V * inverse) == Matrix.eye(4)

# G from its equation, for two values and for a block of two
l_1, l_2, d_1, d_2 = symbols("lambda_1 lambda_2 d_1 d_2")
brought = Matrix(2, 2, symbols("b:4"))
outer = diag(d_1, d_2)
for values in (diag(l_1, l_2), Matrix([[l_1, 1], [0, l_1]])):
    G = Matrix.zeros(2, 2)
    for m in range(2):
        for k in range(2):
            chained = G[m, k - 1] * values[k - 1, k] if k else 0
            G[m, k] = (brought[m, k] - chained) / (values[k, k] - outer[m, m])
    assert simplify(brought + outer * G - G * values) == zero

# %% [markdown]
# ## 3. Powers
#
# An eigenvalue is no float. Rounding it to $h$ costs up to $\varepsilon$, and $n \varepsilon$ in
# its $n$-th power: at $n = 1074$, the level of the smallest positive float, 13 of 16 digits would
# be left. So it is kept as $h + l$, and
#
# $$ (h + l)^n = h^n (1 + \delta)^n, \qquad \delta = l / h, \qquad
#    \left|\delta\right| \le \varepsilon, $$
#
# $$ 0 \le (1 + \delta)^n - (1 + n \delta) \le \frac{n^2 \delta^2}{2} e^{n \left|\delta\right|} : $$
#
# the factor $1 + n \delta$ leaves a relative error of $2 \cdot 10^{-26}$ at $n = 1074$; what
# remains is the rounding of $h^n$ itself. The bound follows from the binomial series,
# $\binom nk \le n^2 / 2 \cdot n^{k-2} / (k-2)!$ for $k \ge 2$. At such $n$ a power may be too small
# for a float. With $h = m 2^k$, $m^2 \in [1/2, 2)$, mantissa and exponent are powers of their own:
# $m^{1100}$ lies between $10^{-166}$ and $10^{166}$.

# %%
n, k = symbols("n k", positive=True, integer=True)
for count in (2, 3, 10, 1074):
    for order in range(2, min(count, 12) + 1):
        binomial = Fraction(1)
        bound = Fraction(count**2, 2)
        for i in range(order):
            binomial *= Fraction(count - i, i + 1)
        for i in range(order - 2):
            bound *= Fraction(count, i + 1)
        assert binomial <= bound
assert Fraction(1074) ** 2 * EPS**2 < Fraction(2, 10**26)
assert Fraction(1, 2) ** 550 > Fraction(1, 10**166)
assert 2**550 < 10**166

# %% [markdown]
# The library's powers at examples: the subdominant eigenvalues of $N = 3, 5, 50$, to 4 ulp, at up
# to $n = 1074$, against 60 digits. With $h$ alone the last one would be off by hundreds of ulp.

# %%
mp.dps = 60
lost = 0
for faces in (3, 5, 50):
    high, low = eigen_table(CATMULL_CLARK, Sector("interior", faces)).rates[:, 1].tolist()
    s = mp.cospi(mpf(1) / faces)
    value = (s + mp.sqrt(4 + s * s)) ** 2 / 16
    for power in (1, 2, 53, 500, 1074):
        mantissa, exponent = kernels.scaled_power(high, low, np.array([power]))
        exact = value**power
        found = mpf(float(mantissa[0])) * mpf(2) ** int(exponent[0])
        assert abs(found / exact - 1) < 4 * mpf(2) ** -53
        lost = max(lost, abs(mpf(high) ** power / exact - 1) * 2**53)
assert lost > 100

# %% [markdown]
# ## 4. Scales
#
# After $n$ halvings a derivative of order $k$ in the parameters of the face is
#
# $$ 2^{k (n + 1)} \sum_i \lambda_i^n\, \partial^k \varphi_i(S, T)\, c_i , $$
#
# as $S = 2^{n+1} u - x$ ([eigenfunctions](eigenfunctions.py), section 1). With $\lambda$ the first
# eigenvalue whose coefficient $c_i$ is not zero,
#
# $$ \sum_i \lambda_i^n \varphi_i c_i = \lambda^n \Big( \varphi\, c
#    + \sum_i (\lambda_i / \lambda)^n \varphi_i c_i \Big) : $$
#
# all quotients are at most 1 in modulus, so nothing overflows; a term that underflows is smaller
# than the first by more than a float can show. The factor $2^{k (n+1)} \lambda^n$ is a mantissa and
# an integer exponent (section 3) and is applied at the very end: the result overflows or vanishes
# only if it is itself beyond the range. Directions and normals do not need the factor at all, and
# curvature needs quotients of such factors alone ([scaling](scaling.py), section 6).
#
# In $f_u \times f_v$ the leading coefficient alone would appear with itself, $c \times c = 0$, in
# rounded numbers the largest term of all. With $f_u = a c + p$, $f_v = b c + q$ it is left out:

# %%
a, b = symbols("a b")
c, p, q = (Matrix(symbols(f"{name}:3")) for name in "cpq")
assert (
    (a * c + p).cross(b * c + q) - c.cross(a * q - b * p) - p.cross(q)
).expand() == Matrix.zeros(3, 1)

# %% [markdown]
# ## 5. Differences
#
# Weights $\omega_i$ of a position add up to 1, those of a derivative to 0, so with any point $p_0$
#
# $$ \sum_i \omega_i p_i = p_0 + \sum_i \omega_i (p_i - p_0), \qquad
#    \sum_i \omega_i p_i = \sum_i \omega_i (p_i - p_0) . $$
#
# With $p_0$ a control point nearby, the rounding errors of the sums are of the order of
# $\varepsilon \sum \left|\omega_i\right|\, \left|p_i - p_0\right|$: of the size of the local cage,
# and not of its distance from the origin. Derivatives and normals do not feel that distance at all.
# In the eigenbasis it is the same: the constant vector $V_1 = (1, \ldots, 1)$ is an eigenvector, so
# left eigenvectors of the others have $w_k V_1 = 0$, and their coefficients do not change when the
# points are moved.

# %%
for faces in (3, 5, 8):
    sector = Sector("interior", faces)
    ring = fourier_ring(subdivision_matrix(CATMULL_CLARK, sector))
    sums = [sum(int(x) for x in row) for row in ring.left()]
    constant = [k for k, value in enumerate(ring.values) if value == 1]
    for k, total in enumerate(sums):
        # modes are scaled so that the constant is 1 at the ring
        assert abs(total - ((k in constant) << BITS)) < 1 << (BITS - 280)

# %% [markdown]
# ## 6. B-spline weights
#
# The weights of the $p + 1$ control points of a uniform B-spline piece of degree $p$,
# $0 \le t \le 1$, from those of degree $p - 1$: point $k$ of the lower degree hands
#
# $$ \frac{k + 1 - t}{p} \text{ to point } k, \qquad
#    \frac{p - 1 - k + t}{p} \text{ to point } k + 1 . $$
#
# All factors are at least 0 on $[0, 1]$: sums of products of such numbers, in which relative errors
# grow by an $\varepsilon$ for each operation and never by cancellation. (The power basis would
# cancel near $t = 1$.) Factors add up to 1, so the weights do. For the derivative, weights are
# differences of neighbouring ones of degree $p - 1$: that is a spline of differences of control
# points.

# %%
t = Symbol("t")


def lower_weights(degree):
    weights = [Rational(1)]
    for p_ in range(1, degree + 1):
        raised = [0] * (p_ + 1)
        for i, weight in enumerate(weights):
            up, down = (i + 1 - t) / p_, (p_ - 1 - i + t) / p_
            assert up.subs(t, 1) >= 0
            assert down.subs(t, 0) >= 0
            assert expand(up + down) == 1
            raised[i] += up * weight
            raised[i + 1] += down * weight
        weights = raised
    return [expand(weight) for weight in weights]


cubic = [(1 - t) ** 3 / 6, (3 * t**3 - 6 * t**2 + 4) / 6]
cubic += [weight.subs(t, 1 - t) for weight in reversed(cubic)]
for found, wanted in zip(lower_weights(3), cubic, strict=True):
    assert expand(found - wanted) == 0
for order in (1, 2, 3):
    weights = lower_weights(3 - order)
    for _ in range(order):
        weights = [low - high for low, high in zip([0, *weights], [*weights, 0], strict=True)]
    for found, wanted in zip(weights, cubic, strict=True):
        assert expand(found - wanted.diff(t, order)) == 0

# %% [markdown]
# For all floats $t$ in an example the library's weights are within 8 ulp of the exact ones, however
# small these are:

# %%
random = Random(1)
places = [random.random() ** power for power in (1, 5, 40) for _ in range(50)]
places += [1 - x for x in places[:100]]
found = kernels.cubic_weights(np.array(places), 0)
exact = kernels.cubic_weights(numbers.RATIONAL.array(places), 0)
for row, wanted in zip(found.tolist(), exact.tolist(), strict=True):
    for x, y in zip(row, wanted, strict=True):
        assert abs(Fraction(x) - y) <= 8 * EPS * y

# %% [markdown]
# ## 7. Parameters around a corner
#
# Going to a quadrant, or halving towards a corner, is $u \to 2 u$ or $u \to 2 u - 1$ for
# $u \ge 1/2$. Doubling changes an exponent only; and $2 u - 1$ of a float $2 u$ in $[1, 2]$ is a
# multiple of the same unit and not larger: a float (Sterbenz). So all these steps are exact at any
# depth.
#
# A patch that is turned asks for $1 - u$ ([isolation](isolation.py), section 6). It is exact for
# $u \ge 1/2$, that is in the half that has the special corner, where the distance to it must keep
# all its digits. For $u < 1/2$ it is rounded to a multiple of $2^{-54}$, far from the corner, an
# error of the size of $\varepsilon$ in a parameter of the size of 1, where the surface is smooth.

# %%
for power in (1, 2, 10, 50):
    for _ in range(100):
        u = random.random() ** power
        high = 0.5 + u / 2  # any float in [1/2, 1]
        assert Fraction(2 * high - 1) == 2 * Fraction(high) - 1
        assert Fraction(1 - high) == 1 - Fraction(high)
        assert abs(Fraction(1 - u) - (1 - Fraction(u))) <= Fraction(1, 2**54)
        corner = kernels.split_corner(*np.array([[u], [u / 3]]), *np.zeros((2, 1), dtype=bool))
        level, piece, S, T = (x[0] for x in corner)
        x, y = [(1, 0), (1, 1), (0, 1)][piece]
        assert Fraction(float(S)) == Fraction(u) * 2 ** (int(level) + 1) - x
        assert Fraction(float(T)) == Fraction(u / 3) * 2 ** (int(level) + 1) - y
