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
"""Koiter's thin shells on a limit surface: strains, moduli, and what benchmarks come to.

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Thin shells
#
# A thin shell is a surface $x(\theta^1, \theta^2)$ with a thickness $h$. Loads move its points by
# $u$; in Koiter's linear model what is stored is
#
# $$W(u) = \frac12 \int \frac{E h}{1 - \nu^2}\, H^{\alpha\beta\gamma\delta}
# \varepsilon_{\alpha\beta} \varepsilon_{\gamma\delta} + \frac{E h^3}{12 (1 - \nu^2)}\,
# H^{\alpha\beta\gamma\delta} \kappa_{\alpha\beta} \kappa_{\gamma\delta}\; dA,$$
#
# with the membrane strains $\varepsilon$, half the change of the metric, and the bending strains
# $\kappa$, the change of the second fundamental form with the opposite sign, both to first order
# in $u$, and plane stress.
#
# - W. T. Koiter, "On the nonlinear theory of thin elastic shells", Proceedings of the Koninklijke
#   Nederlandse Akademie van Wetenschappen B 69 (1966).
# - F. Cirak, M. Ortiz, P. Schroeder, "Subdivision surfaces: a new paradigm for thin-shell
#   finite-element analysis", International Journal for Numerical Methods in Engineering 47 (2000).

# %%
import numpy as np
from sympy import Matrix, Rational, cos, diff, expand, lambdify, simplify, sin, sqrt, symbols, zeros

# %% [markdown]
# ## 1. Strains
#
# With $a_\alpha = x_{,\alpha}$, $J = |a_1 \times a_2|$ and $n = a_1 \times a_2 / J$,
#
# $$\varepsilon_{\alpha\beta} = \tfrac12 (a_\alpha \cdot u_{,\beta} + a_\beta \cdot u_{,\alpha}),$$
#
# and, from $\delta (a_1 \times a_2) = u_{,1} \times a_2 + a_1 \times u_{,2}$, of which the part
# along $n$ changes $J$ alone,
#
# $$\kappa_{\alpha\beta} = -n \cdot u_{,\alpha\beta} + u_{,1} \cdot p_{\alpha\beta}
# + u_{,2} \cdot q_{\alpha\beta},$$
#
# $$p_{\alpha\beta} = \tfrac1J \bigl(x_{,\alpha\beta} \times a_2
# + (n \cdot x_{,\alpha\beta})\, a_2 \times n\bigr), \qquad
# q_{\alpha\beta} = \tfrac1J \bigl(a_1 \times x_{,\alpha\beta}
# + (n \cdot x_{,\alpha\beta})\, n \times a_1\bigr).$$


# %%
def normal(a1: Matrix, a2: Matrix) -> tuple[Matrix, object]:
    """Unit normal and area element."""
    across = a1.cross(a2)
    J = sqrt(across.dot(across))
    return across / J, J


def membrane(a: list[Matrix], u: list[Matrix]) -> Matrix:
    """The membrane strains from first derivatives of surface and displacement."""
    return Matrix(2, 2, lambda i, j: (a[i].dot(u[j]) + a[j].dot(u[i])) / 2)


def bending(a: list[Matrix], x2: dict, u: list[Matrix], u2: dict) -> Matrix:
    """The bending strains."""
    n, J = normal(*a)

    def one(i: int, j: int) -> object:
        second = x2[i, j]
        p = (second.cross(a[1]) + n.dot(second) * a[1].cross(n)) / J
        q = (a[0].cross(second) + n.dot(second) * n.cross(a[0])) / J
        return -n.dot(u2[i, j]) + u[0].dot(p) + u[1].dot(q)

    return Matrix(2, 2, one)


def derivatives(f: Matrix, parameters: tuple) -> tuple[list[Matrix], dict]:
    """First and second derivatives of a vector."""
    first = [diff(f, t) for t in parameters]
    second = {(i, j): diff(f, s, t) for i, s in enumerate(parameters)
              for j, t in enumerate(parameters)}  # fmt: skip
    return first, second


s, t, eps = symbols("s t epsilon", real=True)
x = Matrix([s + s * t / 3, t - s**2 / 2 + t**3 / 5, s**2 * t + s * t**2 - t / 4])
u = Matrix([t**2 - s / 7, s**2 * t + t, s**3 / 2 - s * t])
place = {s: Rational(1, 3), t: Rational(1, 2)}


def numbers(f: Matrix) -> tuple[list[Matrix], dict]:
    """Derivatives at the place, rational numbers."""
    first, second = derivatives(f, (s, t))
    return [z.subs(place) for z in first], {k: z.subs(place) for k, z in second.items()}


a, x2 = numbers(x)
d, u2 = numbers(u)
moved = [p + eps * q for p, q in zip(a, d, strict=True)]
metric = Matrix(2, 2, lambda i, j: moved[i].dot(moved[j]))
change = metric.diff(eps).subs(eps, 0) / 2
assert (change - membrane(a, d)).expand() == zeros(2)
n, _ = normal(*moved)
form = Matrix(2, 2, lambda i, j: n.dot(x2[i, j] + eps * u2[i, j]))
change = -form.diff(eps).subs(eps, 0)
assert (change - bending(a, x2, d, u2)).applyfunc(simplify) == zeros(2)

# %% [markdown]
# Rigid motions have no strains, whatever the surface: six of them, and no seventh is asked for.

# %%
still, still2 = numbers(Matrix(symbols("w1:4")).cross(x) + Matrix(symbols("c1:4")))
assert membrane(a, still).applyfunc(expand) == zeros(2)
assert bending(a, x2, still, still2).applyfunc(simplify) == zeros(2)

# %% [markdown]
# ## 2. Any coordinates do
#
# Both strains are tensors, though $u_{,\alpha\beta} \cdot n$ alone is none: in other parameters
# $\xi$ they are those of $\theta$, times $\partial\theta / \partial\xi$ on both sides. So the
# energy may be had in any coordinates. Around a special corner those of its characteristic map do:
# derivatives by $(u, v)$ grow there like $(4 \lambda)^n$, and their normal part, like $(4 \mu)^n$,
# would come out as a difference of larger numbers.

# %%
p, q = symbols("p q", real=True)
other = {s: Rational(1, 3) + p + p * q - q**2, t: Rational(1, 2) - q / 2 + p**2}
x_there, u_there = (f.subs(other, simultaneous=True) for f in (x, u))
zero = {p: 0, q: 0}
first, second = derivatives(x_there, (p, q))
A, X2 = [z.subs(zero) for z in first], {k: z.subs(zero) for k, z in second.items()}
first, second = derivatives(u_there, (p, q))
D, U2 = [z.subs(zero) for z in first], {k: z.subs(zero) for k, z in second.items()}
turn = Matrix(2, 2, lambda i, j: diff(list(other.values())[i], (p, q)[j]).subs(zero))
assert (turn.T * membrane(a, d) * turn - membrane(A, D)).applyfunc(simplify) == zeros(2)
gap = turn.T * bending(a, x2, d, u2) * turn * turn.det() / abs(turn.det()) - bending(A, X2, D, U2)
assert gap.applyfunc(simplify) == zeros(2)  # the normal turns with the parameters

# %% [markdown]
# ## 3. Moduli
#
# With the inverse metric $a^{\alpha\beta}$, plane stress is $H^{\alpha\beta\gamma\delta} = \nu
# a^{\alpha\beta} a^{\gamma\delta} + \frac{1 - \nu}2 (a^{\alpha\gamma} a^{\beta\delta} +
# a^{\alpha\delta} a^{\beta\gamma})$. On $(\varepsilon_{11}, \varepsilon_{22}, 2 \varepsilon_{12})$
# it is the matrix below.

# %%
m11, m12, m22, nu = symbols("m11 m12 m22 nu")
inverse = Matrix([[m11, m12], [m12, m22]])
e11, e22, e12 = symbols("e11 e22 e12")
strain = Matrix([[e11, e12], [e12, e22]])
full = sum(
    (nu * inverse[i, j] * inverse[k, el]
     + (1 - nu) / 2 * (inverse[i, k] * inverse[j, el] + inverse[i, el] * inverse[j, k]))
    * strain[i, j] * strain[k, el]
    for i in range(2) for j in range(2) for k in range(2) for el in range(2)
)  # fmt: skip
H = Matrix([
    [m11**2, nu * m11 * m22 + (1 - nu) * m12**2, m11 * m12],
    [nu * m11 * m22 + (1 - nu) * m12**2, m22**2, m22 * m12],
    [m11 * m12, m22 * m12, ((1 - nu) * m11 * m22 + (1 + nu) * m12**2) / 2],
])  # fmt: skip
three = Matrix([e11, e22, 2 * e12])
assert expand(full - (three.T * H * three)[0]) == 0

# %% [markdown]
# ## 4. The pinched cylinder
#
# Radius 300, length 600, thickness 3, $E = 3 \cdot 10^6$, $\nu = 0.3$, two opposite unit forces in
# the middle, rigid diaphragms at both ends. Displacements are double Fourier series of which each
# term is a problem of three unknowns: along the axis $U \cos m\varphi \cos kz$, around it
# $V \sin m\varphi \sin kz$, outwards $W \cos m\varphi \sin kz$, $k = j \pi / 600$.

# %%
R, k, m = symbols("R k m", positive=True)
phi, z = symbols("phi z", real=True)
radial, around, along = (
    Matrix([cos(phi), sin(phi), 0]), Matrix([-sin(phi), cos(phi), 0]), Matrix([0, 0, 1]),
)  # fmt: skip
cylinder = R * radial + z * along
waves = (
    cos(m * phi) * cos(k * z) * along, sin(m * phi) * sin(k * z) * around,
    cos(m * phi) * sin(k * z) * radial,
)  # fmt: skip
shapes = (cos(m * phi) * sin(k * z), cos(m * phi) * sin(k * z), sin(m * phi) * cos(k * z))
a, x2 = derivatives(cylinder, (phi, z))
a = [simplify(c) for c in a]
stretch, bend = zeros(3, 3), zeros(3, 3)
for column, wave in enumerate(waves):
    d, u2 = derivatives(wave, (phi, z))
    for rows, tensor in ((stretch, membrane(a, d)), (bend, bending(a, x2, d, u2))):
        for row, (i, j) in enumerate(((0, 0), (1, 1), (0, 1))):
            # in physical components: the metric is R^2, 1
            physical = tensor[i, j] / R ** ((i == 0) + (j == 0)) * (1 + (i != j))
            rows[row, column] = simplify(physical / shapes[row])
assert stretch == Matrix([[0, m / R, 1 / R], [-k, 0, 0], [-m / R, k, 0]])
assert bend == Matrix([
    [0, 2 * m / R**2, (m**2 + 1) / R**2], [0, 0, k**2], [0, 2 * k / R, 2 * k * m / R],
])  # fmt: skip

# %% [markdown]
# Odd $m$ and even $j$ are not loaded. The sum converges as the square of the number of terms, so
# that of half as many terms tells what is missing.


# %%
def deflection(terms: int) -> float:
    """Under the load, by so many terms in each direction."""
    radius, length, thickness, young, poisson = 300.0, 600.0, 3.0, 3e6, 0.3
    around, along = np.meshgrid(
        2.0 * np.arange(terms), (2 * np.arange(terms) + 1) * np.pi / length, indexing="ij"
    )
    moduli = np.array([[1, poisson, 0], [poisson, 1, 0], [0, 0, (1 - poisson) / 2]])
    stiff = np.zeros((terms, terms, 3, 3))
    plane = young * thickness / (1 - poisson**2)
    for matrix, modulus in ((stretch, plane), (bend, plane * thickness**2 / 12)):
        rows = np.zeros((terms, terms, 3, 3))
        for place, term in np.ndenumerate(np.array(matrix)):
            values = {R: radius, k: along, m: around}
            rows[:, :, *place] = _at(term, values)
        stiff += modulus * np.einsum("xyia,ij,xyjb->xyab", rows, moduli, rows)
    # squares of the waves over the cylinder; without waves around it nothing turns
    stiff *= np.where(around == 0, 2, 1)[:, :, None, None] * np.pi * radius * length / 2
    stiff[0, :, 1, 1] = 1
    force = np.zeros((terms, terms, 3, 1))
    force[:, :, 2, 0] = 2 * np.sin(along * length / 2)
    return float((np.linalg.solve(stiff, force) * force)[:, :, 2, 0].sum() / 2)


def _at(term: object, values: dict) -> object:
    return lambdify(tuple(values), term)(*values.values())


assert abs(deflection(80) - 1.8259e-5) < 5e-10
assert abs((4 * deflection(320) - deflection(160)) / 3 - 1.8281952e-5) < 1e-11

# %% [markdown]
# The limit is $1.828195 \cdot 10^{-5}$. The $1.8248 \cdot 10^{-5}$ of many papers is not the answer
# of these equations, but what a series that was cut off came to.
#
# ## 5. Creases
#
# An infinitely sharp crease is a hinge: what is stored near it does not depend on the angle between
# its sides. Let $t$ be the unit tangent of the crease, and $c = n \times t$ on each side, with the
# normal of that side. By $\delta n = -(n \cdot u_{,\alpha}) a^\alpha$ a side turns about $t$ by
# $-n \cdot \partial u / \partial c$, in a rigid motion by the share of $t$ in the rotation,
# equally on both sides. So the difference of both sides, squared, with a modulus and along the
# crease, is what a stiff crease stores: nothing in rigid motions.

# %%
turning, tangent = (Matrix(symbols(f"{name}1:4")) for name in "wt")
side = Matrix(symbols("n1:4"))
turn = -side.dot(turning.cross(side.cross(tangent)))
# the normal is a unit vector, and orthogonal to the tangent
share = turning.dot(tangent) * side.dot(side) - turning.dot(side) * side.dot(tangent)
assert expand(turn + share) == 0
