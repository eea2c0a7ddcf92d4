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
"""The scheme of Kobbelt: one step and two, limits, tangent planes, and where to stop.

After Kobbelt (2000).

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # The sqrt(3) scheme of Kobbelt
#
# Spectra of one step and of two around a vertex, for symbolic valence, in the interior and on
# boundaries; limit and tangent masks; around which vertices there is a tangent plane; that the
# limit on a regular mesh is $C^2$, and after how many steps a quadratic tells all of it.
#
# - L. Kobbelt, "$\sqrt 3$-subdivision", SIGGRAPH 2000: the masks.
# - U. Reif, "A unified approach to subdivision algorithms near extraordinary vertices", 1995.
# - J. Peters, U. Reif, "Subdivision Surfaces", Springer 2008, chapter 5.

# %%
from fractions import Fraction
from itertools import product

import numpy as np
from sympy import I, Matrix, Rational, Symbol, cos, exp, pi, simplify, sin, symbols

import limitsurf as ls
from limitsurf.engine.ground import Ground
from limitsurf.engine.surroundings import PARTS
from limitsurf.engine.ternary import STEPS, kinds_of, quadratic
from limitsurf.numbers import RATIONAL
from limitsurf.refine.turning import across, curve_limit
from limitsurf.rules import Rules
from limitsurf.scheme.sqrt3 import SQRT3
from limitsurf.spectra.stepwise import characteristic_map

N, f, k, j = symbols("N f k j", positive=True)
RULES = Rules.resolve(ls.Mesh([[0.0], [1], [2]], [[0, 1, 2]]), "sqrt3")

# %% [markdown]
# ## 1. One step
#
# The ring after a step are the middles of the faces, $q_i = (v + p_i + p_{i+1})/3$. Waves
# $p_i = e^{2 \pi \mathrm i f i / N}$ that are not constant do not move the vertex: they become
# $\frac23 \cos(\pi f/N)$ as large, and turn by $\pi f / N$.

# %%
one = (1 + exp(2 * pi * I * f / N)) / 3
assert simplify((one - Rational(2, 3) * cos(pi * f / N) * exp(pi * I * f / N)).rewrite(exp)) == 0

# %% [markdown]
# Of what is constant around, $(v, p)$, there remain the eigenvalues 1 and $\frac23 - \alpha$. The
# mask, $\alpha = (4 - 2 \cos(2 \pi / N))/9$, makes the latter the square of that of $f = 1$.

# %%
a = Symbol("alpha")
mean = Matrix([[1 - a, a], [Rational(1, 3), Rational(2, 3)]])
assert set(mean.eigenvals()) == {1, Rational(2, 3) - a}
alpha = (4 - 2 * cos(2 * pi / N)) / 9
assert simplify(Rational(2, 3) - alpha - (Rational(2, 3) * cos(pi / N)) ** 2) == 0
assert all(simplify(SQRT3.share_at(n) - alpha.subs(N, n)) == 0 for n in (3, 4, 5, 6, 7, 50))

# %% [markdown]
# The left eigenvector of 1 is the limit mask: $1 - \beta$ of the vertex, $\beta / N$ of each
# neighbour. Those of $f = 1$ are cosines and sines once around, the tangent masks.

# %%
beta = 3 * a / (1 + 3 * a)
assert simplify(Matrix([[1 - beta, beta]]) * mean - Matrix([[1 - beta, beta]])) == Matrix([[0, 0]])

# %% [markdown]
# ## 2. Two steps
#
# Two steps turn back: the edges' first thirds, $(v + q_{i-1} + q_i)/3 + \ldots$, lie on the edges.
# Where the vertex rests in the first step, as on boundaries, they are
# $(5 v + p_{i-1} + 2 p_i + p_{i+1})/9$, so that waves have $(2 + 2 \cos(2 \pi f/N))/9$ in either
# case, real and positive, and $f$ and $-f$ in pairs.

# %%
two = (exp(-2 * pi * I * f / N) + 2 + exp(2 * pi * I * f / N)) / 9
turn_back = exp(-2 * pi * I * f / N)
assert simplify((two - one**2 * turn_back).rewrite(exp)) == 0
assert simplify((two - Rational(4, 9) * cos(pi * f / N) ** 2).rewrite(exp)) == 0

# %% [markdown]
# ## 3. Tangent planes in the interior
#
# From $N = 3$ on $f = \pm 1$ leads: $\lambda = \frac23 \cos(\pi/N)$ of one step is larger than
# $\lambda^2$ and than $\frac23 \cos(2 \pi/N)$. At $N = 2$ all these vanish, and there is no tangent
# plane. The outer ring brings nothing larger. That the characteristic map is regular is shown in 7.


# %%
def begins(faces, boundary, closed):
    """The cage around a vertex, its kinds, and the kind of its first face, seen from there."""
    turns = np.arange(faces + (not closed)) * (2 if closed else 1) * np.pi / faces
    points = np.vstack([[0, 0], np.stack([np.cos(turns), np.sin(turns)], 1)])
    last = [(i + 1) % faces + 1 if closed else i + 2 for i in range(faces)]
    mesh = ls.Mesh(points, [[0, i + 1, last[i]] for i in range(faces)])
    ground = Ground(mesh, Rules.resolve(mesh, "sqrt3", boundary))
    tiny, none = np.array([1e-9]), np.array([0])
    return ground.kinds, int(ground.begin(none, none, tiny, tiny)[0][0])


def spectrum(kinds, kind):
    return sorted(np.abs(np.linalg.eigvals(kinds.map(kind, 0)[0])), reverse=True)


for n in (3, 4, 5, 7, 8, 9, 12, 20, 50):
    kinds, kind = begins(n, None, True)
    found = spectrum(kinds, kind)
    assert np.allclose(found[:2], 4 / 9 * np.cos(np.pi / n) ** 2)
    second = max(4 / 9 * np.cos(2 * np.pi / n) ** 2, found[0] ** 2, 0.0411)
    assert found[2] < second + 1e-6
    assert found[2] < found[1] - 1e-4

# %% [markdown]
# ## 4. Boundaries
#
# Around a boundary vertex of $k$ faces the ends of the ring are on the curve, whose masks 4 19 4
# and 1 16 10 (over 27) are knot insertion for cubic B-splines. The curve has the eigenvalues 1,
# $\frac13$ and $\frac19$; waves that vanish at both ends are kept by the spokes, with
# $\frac49 \cos^2(\pi j/2k)$, $j = 1 \ldots k - 1$.

# %%
even = Matrix([[19, 8], [16, 11]]) / 27
assert set(even.eigenvals()) == {1, Rational(1, 9)}
assert Rational(10 - 1, 27) == Rational(1, 3)
limit = Matrix([[Rational(2, 3), Rational(1, 3)]])
assert limit * even == limit
assert curve_limit(RULES, RATIONAL) == Fraction(1, 6)
i = Symbol("i", integer=True)
wave = [sin(pi * j * (i + d) / k) for d in (-1, 0, 1)]
spoke = (wave[0] + 2 * wave[1] + wave[2]) / 9
assert (
    simplify((spoke - Rational(4, 9) * cos(pi * j / (2 * k)) ** 2 * wave[1]).expand(trig=True)) == 0
)

# %% [markdown]
# A tangent plane needs one vector along the curve, $\frac13$, and one across, $j = 1$: so for
# $k = 2 \ldots 5$. At $k = 6$ the second wave ties with the curve, $\frac49 \cos^2 30^\circ =
# \frac13$, and from $k = 7$ on it leads: the limit of normals depends on the direction of approach.
# With one face the curve bounds both sides, and across is its even mode, $\frac19$.
# Of corners that stay, both ends have $\frac13$; the first wave is less for one face and two.

# %%
for faces in range(1, 9):
    first, second = (4 / 9 * np.cos(np.pi * m / (2 * faces)) ** 2 for m in (1, 2))
    kinds, kind = begins(faces, "edge_only", False)
    found = spectrum(kinds, kind)
    if faces == 1:
        assert np.allclose(found[:2], [1 / 3, 1 / 9])
    elif faces <= 5:
        assert np.allclose(found[:2], sorted([1 / 3, first], reverse=True))
        assert found[2] < found[1] - 1e-3
    else:
        assert second > 1 / 3 - 1e-12
        assert np.allclose(found[0], first)
    if 2 <= faces <= 5:
        mask = across(RULES, faces)
        v, p, last = mask[0], mask[1:-1], mask[-1]
        rows = np.zeros((faces + 2, faces + 2))
        rows[0, [0, 1, -1]] = np.array([19, 4, 4]) / 27
        rows[1, [0, 1, -1]] = np.array([16, 10, 1]) / 27
        rows[-1, [0, 1, -1]] = np.array([16, 1, 10]) / 27
        for s in range(2, faces + 1):
            rows[s, [0, s - 1, s, s + 1]] = np.array([5, 1, 2, 1]) / 9
        assert np.allclose(mask @ rows, first * mask)
for faces, fixed in ((1, [1 / 3, 1 / 3]), (2, [1 / 3, 1 / 3, 2 / 9]), (3, [1 / 3] * 3)):
    waves = [4 / 9 * np.cos(np.pi * m / (2 * faces)) ** 2 for m in range(1, faces)]
    assert np.allclose([1 / 3, 1 / 3, *waves][:3], fixed)

# %% [markdown]
# ## 5. The regular limit is C2
#
# The limit on a triangle amid regular vertices depends on the 27 of its two rings, and nine
# matrices take these to those of its thirds. Quadratics become quadratics, so that what is left of
# 27 numbers less the quadratic through six of them is multiplied by smaller matrices. All 6561
# products of four of these have row sums below $9^{-4}$: second derivatives converge, uniformly and
# to continuous ones. In integers, with nothing rounded. (A product has the spectral radius
# $18^{-1}$ for each factor, so that second derivatives are Hölder continuous to 0.64 at most. They
# exist, but hang on the last digits of parameters, and `evaluate` gives NaN.)

# %%
kinds = kinds_of(RULES)
kinds.parts(0)
maps = [np.rint(row * 324).astype(np.int64) for row in kinds._rows[0]]
assert all(np.abs(m / 324 - row).max() < 1e-14 for m, row in zip(maps, kinds._rows[0], strict=True))
assert all((m.sum(axis=1) == 324).all() for m in maps)


# %%
def places():
    """Where the vertices of the regular neighbourhood are, from its corner 0, in lattice steps."""
    size = 8
    points = [[x - size // 2, y - size // 2] for x in range(size + 1) for y in range(size + 1)]
    corner = [(size + 1) * x + y for x in range(size) for y in range(size)]
    up = [(c, c + size + 1, c + 1) for c in corner]
    down = [(c + size + 2, c + 1, c + size + 1) for c in corner]
    faces = [face for both in zip(up, down, strict=True) for face in both]
    mesh = ls.Mesh(np.array(points, float), faces)
    ground = Ground(mesh, RULES)
    middle = np.array([2 * (size * (size // 2) + size // 2)])
    vertices = ground.begin(middle, middle * 0, np.array([0.2]), np.array([0.3]))[1][0]
    return np.rint(mesh.points[vertices]).astype(int)


at = places()
assert len(at) == 27
monomials = np.stack(
    [at[:, 0] ** p * at[:, 1] ** q for p, q in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))], 1
)
base = [
    next(n for n, x in enumerate(at.tolist()) if x == y)
    for y in ([0, 0], [1, 0], [0, 1], [1, 1], [-1, 1], [1, -1])
]
rest = [n for n in range(27) if n not in base]
through = monomials[rest] @ np.linalg.inv(monomials[base].astype(float))
whole = np.rint(through).astype(np.int64)
assert np.abs(whole - through).max() < 1e-9
left = np.zeros((21, 27), dtype=np.int64)
left[np.arange(21), rest] = 1
left[:, base] -= whole
inside = np.zeros((27, 21), dtype=np.int64)
inside[rest, np.arange(21)] = 1
smaller = [left @ m @ inside for m in maps]
assert all((left @ m == b @ left).all() for m, b in zip(maps, smaller, strict=True))

# %%
words, norms = [np.eye(21, dtype=np.int64)], [Fraction(1)]
for length in range(1, 5):
    words = [word @ b for word in words for b in smaller]
    norms.append(Fraction(int(max(np.abs(word).sum(axis=1).max() for word in words)), 324**length))
assert norms[4] * 9**4 < 1

# %% [markdown]
# ## 6. Where to stop
#
# After $n$ steps the quadratic of `quadratic`, which has the limit, the first derivatives and what
# quadratics have of second ones at corner 0, differs from the limit by what quadratics do not have:
# at most the sum of what one more step changes, $c$, over all that follow. That is below rounding
# errors of positions after `STEPS[0]`, of first derivatives, which are $3^n$ as large, after
# `STEPS[1]`. Errors are relative to what the vertices near differ from quadratics.


# %%
def rows_of(s, t, which):
    row = np.zeros(27)
    row[1:7] = quadratic(np.array([s]), np.array([t]))[which][0]
    row[0] = (which == 0) - row.sum()
    return row


change = [0.0, 0.0]
for (x, y, sign), m in zip(PARTS, maps, strict=True):
    for s, t in product(np.linspace(0, 1, 9), repeat=2):
        if s + t > 1:
            continue
        u, v = (x + sign * s) / 3, (y + sign * t) / 3
        finer = rows_of(s, t, 0) @ (m / 324) - rows_of(u, v, 0)
        assert np.abs(finer @ monomials).max() < 1e-12
        change[0] = max(change[0], np.abs(finer[rest]).sum())
        for which in (1, 2):
            finer = 3 * sign * rows_of(s, t, which) @ (m / 324) - rows_of(u, v, which)
            assert np.abs(finer @ monomials).max() < 1e-12
            change[1] = max(change[1], np.abs(finer[rest]).sum())


def shrinks(n, growth):
    """What products of n matrices and more add up to, times a power for each."""
    quarter = float(norms[4]) * growth**4
    each = [float(norms[m]) * growth**m for m in range(4)]
    return quarter ** (n // 4) * sum(each) / (1 - quarter) * max(1.0, each[n % 4] if n % 4 else 1.0)


assert change[0] < 1
assert change[1] < 3
assert change[0] * shrinks(STEPS[0], 1) < 2.0**-60
assert change[1] * shrinks(STEPS[1], 3) < 4e-14

# %% [markdown]
# ## 7. The characteristic map
#
# Its control points are the right eigenvectors of the subdominant pair. All of its pieces but those
# next to the vertex, cut often enough, have derivatives that are linear up to the bound of 6.,
# which is 3.6 for what the points around have beside quadratics: so the Jacobian is positive all
# over a ring, and by thirds of it everywhere, and directions say that the map goes around once. The
# same is done for butterfly schemes in [stepwise](stepwise.py), and for any valence by
# `spectral_analysis`.

# %%
assert change[1] * shrinks(0, 3) < 3.6
for n in (3, 4, 5, 7, 8, 9, 12, 20, 50):
    assert characteristic_map(SQRT3, n, 1) == (True, 1.0), n

# %% [markdown]
# ## 8. Beside boundaries
#
# The middle of a face at a boundary has five neighbours after the first step, and takes the mask of
# that valence. So linear functions are kept along boundaries, but not across: at thirds of edges
# the first row is at $\frac13$, at middles of faces not.

# %%
q = Rational(1, 3)
five = alpha.subs(N, 5)
neighbours = (0 + 0 + 1 + 2 * Rational(2, 3)) / Rational(5)
moved = (1 - five) * q + five * neighbours
assert simplify(moved - q) != 0
assert (5 * 0 + 0 + 2 * 1 + 1) == 3

# %% [markdown]
# Hence derivatives across boundaries have no limit at them: from one scale to the next they repeat,
# as the surface is the same at all scales. Those along a boundary are of the B-spline; and tangent
# planes have a limit. There `evaluate` gives NaN, and `normal` does not.
