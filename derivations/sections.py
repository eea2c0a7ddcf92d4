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
"""Sections and contours: when a level set is a graph, how far polylines are, what joins cells.

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Sections and contours
#
# On a [Bezier cell](pieces.py) with coordinates $s, t$ the height above a plane is a polynomial
# $f(s, t)$: its coefficients are the heights of the control points. So are other functions whose
# contours are sought, as [the squared distance](closest.py#1-squared-distances). This document
# derives
#
# 1. when the set $f = 0$ in a cell is a graph, so that no loop hides in it;
# 2. how many points such a graph takes to be within a tolerance;
# 3. why curves of neighbouring cells fit, and end nowhere;
# 4. which border remains where $f$ vanishes on lines or on whole cells.
#
# - G. Farin, "Curves and Surfaces for CAGD", 5th edition, 2002: Bernstein polynomials, hulls.
# - S. Plantinga, G. Vegter, "Isotopic approximation of implicit curves and surfaces", Symposium on
#   Geometry Processing 2004: cells with a direction of growth suffice for the topology.

# %%
import itertools

import numpy as np
from sympy import Function, Rational, Symbol, diff, simplify, solve, symbols

from limitsurf.query.polynomials import Form
from limitsurf.scheme.lattice import QUADS, TRIANGLES

# %% [markdown]
# ## 1. Graphs
#
# If all coefficients of $f$ are of one sign, $f$ has no zero in the cell: Bernstein polynomials are
# not negative there, and sum to one. If those of $f_t$ are positive, $f$ grows along every line of
# constant $s$, and has at most one zero on it: the set $f = 0$ is a graph $t(s)$ over those $s$ at
# which it is not positive at the lower end and not negative at the upper. So it has no closed loop
# and no branch, and all its parts begin and end on sides of the cell. Sorted by $s$, these places
# begin a part and end it by turns.
#
# Each side is crossed at most once if $f$ is of one sign on it, or monotone. Coefficients of
# derivatives are linear in those of $f$, and bound them. As an example, a circle inside of one
# cell, of which the sides do not tell: quarters of quarters are graphs.

# %%
rng = np.random.default_rng(1)
for lattice, degree in itertools.product((QUADS, TRIANGLES), (2, 3, 4)):
    form = Form.of(lattice, degree)
    values = rng.normal(size=form.size)
    spot = rng.random((2, 50)) / 2
    f = form.values(*spot) @ values  # value, d/ds, d/dt, ... at places in the cell
    for k in (1, 2):
        own = form.derivatives[k] @ values
        assert (own.min() <= f[:, k]).all()
        assert (f[:, k] <= own.max()).all()

form = Form.of(QUADS, 2)
x, y = (form.exponents / 2).T
# the circle of radius 1/4 about the middle, by its control values (blossoms of squares)
square = {0.0: 0.0, 0.5: 0.0, 1.0: 1.0}
circle = np.array([square[a] - a + square[b] - b for a, b in zip(x, y, strict=True)]) + 7 / 16
assert circle.min() < 0 < circle.max()
assert (circle[form.edges] > 0).any(axis=1).all()  # sides say nothing of the loop
cells, graphs = [circle], 0
for _ in range(6):
    parts = [half @ c for c in cells for half in form.halves[0]]
    parts = [half @ c for c in parts for half in form.halves[1]]
    parts = [c for c in parts if c.min() <= 0 <= c.max()]
    slopes = [[form.derivatives[k] @ c for k in (1, 2)] for c in parts]
    plain = [any(d.min() > 0 or d.max() < 0 for d in slope) for slope in slopes]
    graphs += sum(plain)
    cells = [c for c, done in zip(parts, plain, strict=True) if not done]
assert not cells
assert graphs > 4

# %% [markdown]
# ## 2. How far polylines are
#
# Along a graph $t(s)$ the derivatives of $f(s, t(s)) = 0$ vanish:

# %%
s = Symbol("s")
graph, f = Function("t")(s), Function("f")
a, b = symbols("a b")
first, second = (diff(f(s, graph), s, k) for k in (1, 2))
slope, bend = symbols("slope bend")
names = {
    "s": diff(f(a, b), a), "t": diff(f(a, b), b), "ss": diff(f(a, b), a, 2),
    "st": diff(f(a, b), a, b), "tt": diff(f(a, b), b, 2),
}  # fmt: skip
for g in (a**2 * b + b**3 + a * b, a**3 + 2 * a * b + 5 * b):  # any function will do
    at = {n: d.subs(f(a, b), g).doit() for n, d in names.items()}
    one = diff(g.subs({a: s, b: graph}), s).subs(diff(graph, s), slope).subs(graph, b).subs(s, a)
    assert simplify(solve(one, slope)[0] + at["s"] / at["t"]) == 0
    two = diff(g.subs({a: s, b: graph}), s, 2)
    two = two.subs(diff(graph, s, 2), bend).subs(diff(graph, s), slope).subs(graph, b).subs(s, a)
    expected = -(at["ss"] + 2 * at["st"] * slope + at["tt"] * slope**2) / at["t"]
    assert simplify(solve(two, bend)[0] - expected) == 0

# %% [markdown]
# So $t' = -f_s / f_t$ and $t'' = -(f_{ss} + 2 f_{st} t' + f_{tt} t'^2) / f_t$. With $m > 0$ the
# least coefficient of $f_t$ in size, and the largest of the others, $\lvert t' \rvert \le r = M_s /
# m$ and $\lvert t'' \rvert \le (M_{ss} + 2 M_{st} r + M_{tt} r^2) / m$, everywhere in the cell. The
# curve in space is $c(s) = x(s, t(s))$ with
#
# $$c'' = x_{ss} + 2 x_{st} t' + x_{tt} t'^2 + x_t t'',$$
#
# which is bounded alike by the lengths of the coefficients of derivatives of $x$, by $B$. A chord
# over $h = \Delta s$ is off by what has this second derivative and vanishes at both ends, at most
# $B h^2 / 8$: that of the parabola.

# %%
h, B = symbols("h B", positive=True)
parabola = B * s * (h - s) / 2
assert diff(parabola, s, 2) == -B
assert parabola.subs(s, 0) == parabola.subs(s, h) == 0
assert simplify(parabola.subs(s, h / 2) - B * h**2 / 8) == 0

# %% [markdown]
# A cell is left as it is when few points are enough by this bound, or more would be needed anyway
# because $f_t$ is about constant in it.
#
# ## 3. What joins cells
#
# Cells are not of one size: sides of small ones are parts of those of large ones. All ends of sides
# on a line part it into segments. Each such end has one sign, taken once, whichever cells it is a
# corner of, and a segment is crossed where the signs of its ends differ, in one place, found once.
# So what enters a cell is what leaves its neighbour. Around a cell signs change an even number of
# times, whatever they are, also where rounding has decided them: what begins in a cell ends there.

# %%
for signs in itertools.product((False, True), repeat=7):
    assert sum(p != q for p, q in zip(signs, signs[1:] + signs[:1], strict=True)) % 2 == 0

# %% [markdown]
# So on a surface without boundary a curve ends nowhere. What is undecided when the function is
# within rounding of 0 all over a cell, as at a saddle or at a special corner, is joined by its
# sides: what enters neighbours of this kind meets in one place, if it is more than two.
#
# ## 4. Borders
#
# Where $f$ is 0 on lines or cells, zero has no order of multiplicity that float64 could tell. So
# signs are those of $f + \varepsilon$, with $\varepsilon$ some rounding: the level set is the
# border of $f < 0$, a set of curves again. Cells with $f \ge 0$ have no part of it, also if $f$ is
# 0 all over. In cells with $f \le 0$ it runs along those sides on which $f$ is 0, if the cell
# beyond is not of the same kind. A saddle of value 0 is parted by $\varepsilon$, into hyperbolas
# that are about $\sqrt{\varepsilon}$ away from it; so cells are left undecided at a multiple of
# $\varepsilon$, before they are as small as that.

# %%
epsilon = symbols("epsilon", positive=True)
u = symbols("u", real=True)
nearest = solve(u**2 - epsilon, u)  # of u^2 - v^2 + epsilon = 0 on the axis v = ...
assert max(nearest, key=lambda r: r.subs(epsilon, 1)) == epsilon ** Rational(1, 2)
