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
"""Principal curvatures and directions from derivatives, without cancellation.

After do Carmo (1976) and Stam (1998).

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Curvature from derivatives
#
# Given the derivatives $X_u, X_v, X_{uu}, X_{uv}, X_{vv}$ of a surface in space at a regular point,
# that is where $X_u \times X_v \ne 0$, this document proves
#
# 1. formulas for the principal curvatures $k_1 \ge k_2$, their unit directions $d_1, d_2$, and the
#    mean and Gaussian curvature, without the cancellation in $\sqrt{H^2 - K}$;
# 2. that they belong to the surface and not to its parameters, so that scaled derivatives do, and
#    what their scale does to the curvature;
# 3. how to form the normal components of second derivatives near an extraordinary vertex, where
#    the derivatives themselves are almost tangential;
# 4. the same in coordinates that fall by different powers, which is how the library does it.
#
# All of it is symbolic and holds for any surface.
#
# - M. P. do Carmo, "Differential geometry of curves and surfaces", Prentice-Hall 1976, chapter 3.
# - J. Stam, "Exact evaluation of Catmull-Clark subdivision surfaces at arbitrary parameter values",
#   SIGGRAPH 1998: derivatives near extraordinary vertices.

# %%
from itertools import combinations

from sympy import (
    Matrix,
    cos,
    expand,
    factor,
    simplify,
    sin,
    sqrt,
    symbols,
)

u, v = symbols("u v", real=True)

# %% [markdown]
# ## 1. The second fundamental form by determinants
#
# With $W = \left|X_u \times X_v\right|$ and $n = X_u \times X_v / W$ the two fundamental forms are
#
# $$ I = \begin{pmatrix} E & F \\ F & G \end{pmatrix}
#      = \begin{pmatrix} X_u X_u & X_u X_v \\ X_u X_v & X_v X_v \end{pmatrix}, \qquad
#    \mathit{II} = \begin{pmatrix} L & M \\ M & N \end{pmatrix}
#      = \begin{pmatrix} n X_{uu} & n X_{uv} \\ n X_{uv} & n X_{vv} \end{pmatrix} . $$
#
# A curve in the surface with velocity $a X_u + b X_v$ has an acceleration whose normal component is
# $L a^2 + 2 M a b + N b^2$, whatever $a'$ and $b'$ are, since their terms are tangential. So at
# unit speed the normal curvature in a direction is the quotient of the two forms. It is positive
# where the surface bends towards $n$: a sphere of radius $r$ with its normal outwards has $-1/r$.
#
# As $n X_{uu} = \det(X_u, X_v, X_{uu}) / W$, the second form is known from three determinants:
#
# $$ \delta_{uu} = \det(X_u, X_v, X_{uu}), \quad \delta_{uv} = \det(X_u, X_v, X_{uv}), \quad
#    \delta_{vv} = \det(X_u, X_v, X_{vv}), \qquad \mathit{II} = \frac1W
#    \begin{pmatrix} \delta_{uu} & \delta_{uv} \\ \delta_{uv} & \delta_{vv} \end{pmatrix} . $$

# %%
Xu, Xv, Xuu, Xuv, Xvv = (
    Matrix(symbols(f"{name}:3", real=True)) for name in ("p", "q", "r", "s", "t")
)


def determinant(a, b, c):
    return a.cross(b).dot(c)


a, b, da, db = symbols("a b da db", real=True)
acceleration = a**2 * Xuu + 2 * a * b * Xuv + b**2 * Xvv + da * Xu + db * Xv
d_uu, d_uv, d_vv = (determinant(Xu, Xv, second) for second in (Xuu, Xuv, Xvv))
seen = determinant(Xu, Xv, acceleration)
assert expand(seen - (d_uu * a**2 + 2 * d_uv * a * b + d_vv * b**2)) == 0
# Lagrange: W^2 = E G - F^2
assert expand(Xu.cross(Xv).dot(Xu.cross(Xv)) - (Xu.dot(Xu) * Xv.dot(Xv) - Xu.dot(Xv) ** 2)) == 0

# %% [markdown]
# ## 2. The shape operator in an orthonormal frame
#
# Take $e_1 = X_u / \sqrt E$ and $e_2 = n \times e_1$. In this frame the derivatives are the columns
# of $J$, and the normal curvature of a unit vector $x$ is $x^T S x$ with a *symmetric* matrix $S$:
#
# $$ J = \begin{pmatrix} \sqrt E & F / \sqrt E \\ 0 & W / \sqrt E \end{pmatrix}, \quad
#    J^T J = I, \qquad S = J^{-T}\, \mathit{II}\, J^{-1} , $$
#
# $$ S_{11} = \frac{L}{E}, \qquad S_{12} = \frac{E M - F L}{E W}, \qquad
#    S_{22} = \frac{E^2 N - 2 E F M + F^2 L}{E W^2} . $$
#
# $k_1 \ge k_2$ are its eigenvalues. Trace and determinant are the familiar formulas,
#
# $$ k_1 + k_2 = 2 H = \frac{E N - 2 F M + G L}{W^2}, \qquad k_1 k_2 = K = \frac{L N - M^2}{W^2} .$$

# %%
E, W = symbols("E W", positive=True)
F, L, M, N = symbols("F L M N", real=True)
G = (W**2 + F**2) / E
J = Matrix([[sqrt(E), F / sqrt(E)], [0, W / sqrt(E)]])
assert simplify(J.T * J - Matrix([[E, F], [F, G]])) == Matrix.zeros(2, 2)
S = simplify(J.inv().T * Matrix([[L, M], [M, N]]) * J.inv())
S11, S12, S22 = L / E, (E * M - F * L) / (E * W), (E**2 * N - 2 * E * F * M + F**2 * L) / (E * W**2)
assert simplify(S - Matrix([[S11, S12], [S12, S22]])) == Matrix.zeros(2, 2)
mean, gaussian = (E * N - 2 * F * M + G * L) / (2 * W**2), (L * N - M**2) / W**2
assert simplify(S11 + S22 - 2 * mean) == 0
assert simplify(S11 * S22 - S12**2 - gaussian) == 0

# %% [markdown]
# The entries of $J$ belong to the frame: $X_u = \sqrt E e_1$, and $X_v$ has the components
# $X_v e_1 = F / \sqrt E$ and $X_v e_2 = W / \sqrt E$, for
# $e_2 W \sqrt E = (X_u \times X_v) \times X_u$.

# %%
assert expand(Xv.dot(Xu.cross(Xv).cross(Xu)) - Xu.cross(Xv).dot(Xu.cross(Xv))) == 0
assert expand(Xu.dot(Xu.cross(Xv).cross(Xu))) == 0

# %% [markdown]
# Eigenvalues of a symmetric matrix of two rows: with $D = (S_{11} - S_{22}) / 2$ and
# $R = \sqrt{D^2 + S_{12}^2}$, which is what $\sqrt{H^2 - K}$ is without its cancellation,
#
# $$ k_1 = H + R, \qquad k_2 = H - R . $$
#
# The direction of $k_1$ is $(R + D, S_{12})$, and also $(S_{12}, R - D)$. One of $R + D$ and
# $R - D$ is a sum of two numbers that are not negative: for $D \ge 0$ take the first, else the
# second. Neither is zero unless $R = 0$, an umbilic, where every direction is principal. The
# other direction is at right angles: $d_2 = n \times d_1$, so that $(d_1, d_2, n)$ is right-handed.

# %%
D, s12, H = symbols("D s12 H", real=True)
R = sqrt(D**2 + s12**2)
shape = Matrix([[H + D, s12], [s12, H - D]])
for direction in (Matrix([R + D, s12]), Matrix([s12, R - D])):
    assert simplify(shape * direction - (H + R) * direction) == Matrix.zeros(2, 1)
    turned = Matrix([-direction[1], direction[0]])
    assert simplify(shape * turned - (H - R) * turned) == Matrix.zeros(2, 1)

# %% [markdown]
# The library takes the same direction by its angle $\theta$ to $e_1$: with $D = R \cos 2 \theta$
# and $S_{12} = R \sin 2 \theta$ it is $(\cos \theta, \sin \theta)$. And of $H \pm R$ it takes the
# larger by modulus, a sum without cancellation; the other one is $K$ divided by it.

# %%
theta, spread = symbols("theta R", positive=True)
by_angle = {D: spread * cos(2 * theta), s12: spread * sin(2 * theta)}
direction = Matrix([cos(theta), sin(theta)])
error = shape.subs(by_angle) * direction - (H + spread) * direction
assert error.applyfunc(lambda entry: simplify(entry.expand(trig=True))) == Matrix.zeros(2, 1)
assert expand((H + R) * (H - R) - shape.det()) == 0

# %% [markdown]
# In determinants, as $(L, M, N) = (\delta_{uu}, \delta_{uv}, \delta_{vv}) / W$, no unit vector is
# needed at all:
#
# $$ H = \frac{E \delta_{vv} - 2 F \delta_{uv} + G \delta_{uu}}{2 W^3}, \qquad
#    K = \frac{\delta_{uu} \delta_{vv} - \delta_{uv}^2}{W^4} . $$
#
# These are invariant under an exchange of $u$ and $v$ (up to the sign of $n$), and need no frame.

# %%
assert simplify(mean.subs({L: L / W, M: M / W, N: N / W}) * W - mean) == 0
assert simplify(gaussian.subs({L: L / W, M: M / W, N: N / W}) * W**2 - gaussian) == 0

# %% [markdown]
# As a check against the definition of the shape operator, $dn = -S\,dX$: on a torus, in parameters
# that are not orthogonal, $n_u$ and $n_v$ are $-S$ of $X_u$ and $X_v$, and the curvatures are those
# of the books, $1/r$ (inwards) and $\cos u / (R_0 + r \cos u)$.

# %%
radius, tube = symbols("R_0 r", positive=True)
phi = u + v  # skew parameters
ring = radius + tube * cos(u)
torus = Matrix([ring * cos(phi), ring * sin(phi), tube * sin(u)])
inwards = -Matrix([cos(u) * cos(phi), cos(u) * sin(phi), sin(u)])
# by its symmetry the point at phi = 0 will do
first, second, turning = (
    derivative.subs(v, -u)
    for derivative in (
        torus.jacobian([u, v]),
        torus.diff(u).jacobian([u, v]).row_join(torus.diff(v, 2)),
        inwards.jacobian([u, v]),
    )
)
inwards = inwards.subs(v, -u)
W_torus = tube * ring
cross = first[:, 0].cross(first[:, 1])
assert simplify(cross - W_torus * inwards) == Matrix.zeros(3, 1)
forms = {E: first[:, 0].dot(first[:, 0]), F: first[:, 0].dot(first[:, 1]), W: W_torus}
forms |= {letter: inwards.dot(second[:, k]) for k, letter in enumerate((L, M, N))}
forms = {letter: simplify(value) for letter, value in forms.items()}
k_tube, k_around = 1 / tube, cos(u) / ring
assert simplify(mean.subs(forms) - (k_tube + k_around) / 2) == 0
assert simplify(gaussian.subs(forms) - k_tube * k_around) == 0
one, two = (Matrix([[x, y], [y, z]]).subs(forms) for x, y, z in ((E, F, G), (L, M, N)))
assert simplify(one - first.T * first) == Matrix.zeros(2, 2)
# turning = -first one^-1 two, without the inverse
assert simplify(first.T * turning + two) == Matrix.zeros(2, 2)
assert simplify(inwards.T * turning) == Matrix.zeros(1, 2)

# %% [markdown]
# ## 3. Other parameters
#
# Let $(u, v)$ be functions of $(s, t)$ with Jacobian $A$, not zero. Then
# $(X_s, X_t) = (X_u, X_v) A$, and second derivatives are $A^T (\cdot) A$ of the old ones plus
# combinations of $X_u$ and $X_v$, which determinants with $X_u$ and $X_v$ do not see. So
#
# $$ I' = A^T I A, \qquad
#    \begin{pmatrix} \delta_{ss} & \delta_{st} \\ \delta_{st} & \delta_{tt} \end{pmatrix} =
#    \det A \; A^T \begin{pmatrix} \delta_{uu} & \delta_{uv} \\ \delta_{uv} & \delta_{vv}
#    \end{pmatrix} A, \qquad W' = \left|\det A\right|\, W , $$
#
# for the most general second-order change of parameters:

# %%
A = Matrix(2, 2, symbols("a_us a_ut a_vs a_vt", real=True))
(us, ut), (vs, vt) = A.tolist()
uss, ust, utt, vss, vst, vtt = symbols("u_ss u_st u_tt v_ss v_st v_tt", real=True)
Xs, Xt = us * Xu + vs * Xv, ut * Xu + vt * Xv


def second_derivative(first_u, first_v, second_u, second_v, du, dv):
    result = first_u * second_u * Xuu + (first_u * second_v + first_v * second_u) * Xuv
    return result + first_v * second_v * Xvv + du * Xu + dv * Xv


changed = [
    second_derivative(us, vs, us, vs, uss, vss),
    second_derivative(us, vs, ut, vt, ust, vst),
    second_derivative(ut, vt, ut, vt, utt, vtt),
]
expected = A.det() * A.T * Matrix([[d_uu, d_uv], [d_uv, d_vv]]) * A
for derivative, (i, j) in zip(changed, ((0, 0), (0, 1), (1, 1)), strict=True):
    assert expand(determinant(Xs, Xt, derivative) - expected[i, j]) == 0

# %% [markdown]
# Hence $I'^{-1} \mathit{II}' = \pm A^{-1} (I^{-1} \mathit{II}) A$ with the sign of $\det A$: the
# same eigenvalues, and the same eigenvectors in space, as $(X_s, X_t) A^{-1} = (X_u, X_v)$. A
# change that keeps the orientation changes neither curvatures nor directions; one that reverses it
# turns $n$ over and with it all signs.
#
# **Scaled derivatives.** Let the true derivatives be $\alpha$ times the first and $\beta$ times the
# second ones that are at hand, $\alpha, \beta > 0$. Frame and directions do not change and
#
# $$ k = \frac{\beta}{\alpha^2}\, \tilde k . $$
#
# A halving of the parameters, $u = \sigma / 2^n$, has $\alpha = 2^n$ and $\beta = 4^n$: a factor 1,
# as it must. So derivatives in the parameters of a small piece may be used as they are, and powers
# $\alpha$, $\beta$ that no float can hold never arise; only the quotient counts. Likewise a surface
# of $c$ times the size has $\alpha = \beta = c$ and curvatures $1 / c$ times as large.

# %%
alpha, beta = symbols("alpha beta", positive=True)
scaled = {E: alpha**2 * E, F: alpha**2 * F, W: alpha**2 * W}
scaled |= {L: beta * L, M: beta * M, N: beta * N}
for entry in (S11, S12, S22):
    assert simplify(entry.subs(scaled, simultaneous=True) - beta / alpha**2 * entry) == 0

# %% [markdown]
# ## 4. Normal components of second derivatives near an extraordinary vertex
#
# There the surface is a sum over eigenfunctions, $X = \sum_i \varphi_i P_i$ (the powers of the
# eigenvalues are in the $\varphi_i$ here; [eigenfunctions](eigenfunctions.py)), and a determinant
# of derivatives is a sum over triples (Cauchy and Binet):
#
# $$ \det(X_u, X_v, X_{uu}) = \sum_{i<j<k}
#    \begin{vmatrix} \varphi_{i,u} & \varphi_{i,v} & \varphi_{i,uu} \\
#                    \varphi_{j,u} & \varphi_{j,v} & \varphi_{j,uu} \\
#                    \varphi_{k,u} & \varphi_{k,v} & \varphi_{k,uu} \end{vmatrix}
#    \det(P_i, P_j, P_k) , $$
#
# here for five eigenfunctions, with $x_i, y_i, z_i$ for the derivatives:

# %%
count = 5
x, y, z = (symbols(f"{name}:{count}") for name in "xyz")
P = Matrix(3, count, lambda i, k: symbols(f"P_{i}{k}"))
whole = (P * Matrix([x, y, z]).T).det(method="berkowitz")
triples = sum(
    Matrix([[x[i], y[i], z[i]] for i in triple]).det() * P.extract(range(3), triple).det()
    for triple in combinations(range(count), 3)
)
assert expand(whole - triples) == 0

# %% [markdown]
# All three indices differ. If the first two fall like $\lambda^n$ and the next like $\mu^n$ with
# $\mu < \lambda$, the sum is of the order of $\lambda^{2n} \mu^n$; but each of the three vectors
# is of the order of $\lambda^n$, and a determinant of rounded vectors has errors of the order of
# $\varepsilon \lambda^{3n}$. The part of order $\lambda^{3n}$ is zero by algebra: it must be left
# out, not computed. Write
#
# $$ X_u = a_u b + A_u c + r_u, \qquad X_v = a_v b + A_v c + r_v, \qquad
#    X_{uu} = a_w b + A_w c + r_w $$
#
# with the coefficients $b, c$ of the two leading eigenfunctions, scalars $a, A$ (their
# derivatives), and the rests $r$. Then the determinant is
#
# $$ (b \times c) \big( (a_u A_v - a_v A_u) r_w + (a_v A_w - a_w A_v) r_u
#    + (a_w A_u - a_u A_w) r_v \big) $$
#
# $$ {} + b \, (a_u\, r_v \times r_w + a_v\, r_w \times r_u + a_w\, r_u \times r_v) $$
#
# $$ {} + c \, (A_u\, r_v \times r_w + A_v\, r_w \times r_u + A_w\, r_u \times r_v)
#    + \det(r_u, r_v, r_w) , $$
#
# in which every term has the size that it should have. If only one eigenfunction leads, take
# $c = 0$, $A = 0$. The normal itself is formed in the same way:
#
# $$ X_u \times X_v = (a_u A_v - a_v A_u)\, b \times c + b \times (a_u r_v - a_v r_u)
#    + c \times (A_u r_v - A_v r_u) + r_u \times r_v . $$

# %%
b_, c_, *rests = (Matrix(symbols(f"{name}:3")) for name in ("b", "c", "ru", "rv", "rw"))
small, large = symbols("a_u a_v a_w"), symbols("A_u A_v A_w")
vectors = [p * b_ + q * c_ + r for p, q, r in zip(small, large, rests, strict=True)]
cyclic = [(0, 1, 2), (1, 2, 0), (2, 0, 1)]
by_parts = determinant(*rests)
by_parts += b_.cross(c_).dot(
    sum(
        ((small[i] * large[j] - small[j] * large[i]) * rests[k] for i, j, k in cyclic),
        Matrix.zeros(3, 1),
    )
)
for lead, factors in ((b_, small), (c_, large)):
    products = (factors[i] * rests[j].cross(rests[k]) for i, j, k in cyclic)
    by_parts += lead.dot(sum(products, Matrix.zeros(3, 1)))
assert expand(determinant(*vectors) - by_parts) == 0

by_parts = (small[0] * large[1] - small[1] * large[0]) * b_.cross(c_) + rests[0].cross(rests[1])
for lead, factors in ((b_, small), (c_, large)):
    by_parts += lead.cross(factors[0] * rests[1] - factors[1] * rests[0])
assert (vectors[0].cross(vectors[1]) - by_parts).expand() == Matrix.zeros(3, 1)

# %% [markdown]
# ## 5. The same for a graph
#
# The last check ties the formulas to the best known special case, by other means. Over its tangent
# plane a surface is a graph $z = (p x^2 + 2 q x y + r y^2) / 2$ to second order, and its curvatures
# at the origin are the eigenvalues of $\begin{pmatrix} p & q \\ q & r \end{pmatrix}$. In any
# parameters, here $x$ and $y$ general quadratic functions of $u$ and $v$ whose Jacobian at the
# origin is positive, the formulas of part 2 say the same. The sum and the product of the
# eigenvalues:

# %%
p, q, r = symbols("p q r", real=True)
xu, xv, yu, yv, *bends = symbols("x_u x_v y_u y_v b:6", real=True)
squares = (u**2 / 2, u * v, v**2 / 2)
x_of = xu * u + xv * v + sum(k * w for k, w in zip(bends[:3], squares, strict=True))
y_of = yu * u + yv * v + sum(k * w for k, w in zip(bends[3:], squares, strict=True))
height = (p * x_of**2 + 2 * q * x_of * y_of + r * y_of**2) / 2
graph = Matrix([x_of, y_of, height])
origin = {u: 0, v: 0}
gu, gv = (graph.diff(x).subs(origin) for x in (u, v))
orders = ((u, u), (u, v), (v, v))
g_uu, g_uv, g_vv = (determinant(gu, gv, graph.diff(*order).subs(origin)) for order in orders)
area = xu * yv - xv * yu
e, f, g = gu.dot(gu), gu.dot(gv), gv.dot(gv)
assert expand(e * g - f**2 - area**2) == 0
assert simplify((e * g_vv - 2 * f * g_uv + g * g_uu) / area**3 - (p + r)) == 0
assert factor(g_uu * g_vv - g_uv**2) / area**4 - factor(p * r - q**2) == 0

# %% [markdown]
# ## 6. Coordinates with units of their own
#
# Another way to keep the sizes of part 4 apart, which the library takes (`basis.eigen_curvatures`):
# choose orthonormal axes with $b$ along the first and $c$ in the plane of the first two. The three
# coordinates of the surface then begin with different eigenfunctions and fall by different powers
# $a_1, a_2, h$ on the way to the vertex. Let all derivatives be known in these units,
#
# $$ X_u = (a_1 u_1, a_2 u_2, h u_3), \qquad X_{uu} = (a_1 w_1, a_2 w_2, h w_3) , $$
#
# and so on. A determinant of three such vectors is $a_1 a_2 h$ times that of the numbers, without a
# sum of different powers; nor is there one in the components of a cross product. With $\hat l$,
# $\hat m$, $\hat n$ for the determinants of the numbers, $\hat E = E / a_1^2$,
# $\hat W = W / \left|a_1 a_2\right|$ and $q = F / E$,
#
# $$ S_{11} = \frac{h}{a_1^2} \frac{\hat l}{\hat W \hat E}, \qquad
#    S_{12} = \frac{h}{a_1 a_2} \frac{\hat m - q \hat l}{\hat W^2}, \qquad
#    S_{22} = \frac{h}{a_2^2} \frac{\hat E (\hat n - 2 q \hat m + q^2 \hat l)}{\hat W^3} $$
#
# (for $a_1 a_2 > 0$; else $S_{11}$ and $S_{22}$ change their signs, and $S_{12}$ does not). For the
# differences to be harmless $X_u$ should be the longer of the two first derivatives,
# $\left|q\right| \le 1$; otherwise the parameters are turned by a quarter, $(s, t) = (v, -u)$ (part
# 3).

# %%
units = symbols("a_1 a_2 h", nonzero=True, real=True)
scale = Matrix.diag(*units)
hats = [determinant(Xu, Xv, second) for second in (Xuu, Xuv, Xvv)]
for hat, second in zip(hats, (Xuu, Xuv, Xvv), strict=True):
    assert expand(determinant(scale * Xu, scale * Xv, scale * second) - scale.det() * hat) == 0
a1, a2, h = units
crossed = (scale * Xu).cross(scale * Xv)
areas = Matrix([a2 * h, a1 * h, a1 * a2])
assert (crossed - areas.multiply_elementwise(Xu.cross(Xv))).expand() == Matrix.zeros(3, 1)

e_hat, w_hat, sign = symbols("E_hat W_hat sign", positive=True)
slope, l_hat, m_hat, n_hat = symbols("q l_hat m_hat n_hat", real=True)
known = {E: a1**2 * e_hat, W: sign * a1 * a2 * w_hat, F: slope * a1**2 * e_hat}
parts = (l_hat, m_hat, n_hat)
# L = det / W, and sign^2 = 1
known |= {x: h / (sign * w_hat) * hat for x, hat in zip((L, M, N), parts, strict=True)}
wanted = (
    h / a1**2 * l_hat / (w_hat * e_hat) / sign,
    h / (a1 * a2) * (m_hat - slope * l_hat) / w_hat**2 / sign**2,
    h / a2**2 * e_hat * (n_hat - 2 * slope * m_hat + slope**2 * l_hat) / w_hat**3 / sign**3,
)
for entry, value in zip((S11, S12, S22), wanted, strict=True):
    assert simplify(entry.subs(known, simultaneous=True) - value) == 0

turned = {"l": determinant(Xv, -Xu, Xvv), "m": -determinant(Xv, -Xu, Xuv)}
turned["n"] = determinant(Xv, -Xu, Xuu)
assert [expand(turned["l"] - hats[2]), expand(turned["m"] + hats[1])] == [0, 0]
assert expand(turned["n"] - hats[0]) == 0
