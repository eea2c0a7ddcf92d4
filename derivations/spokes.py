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
"""Masks of their own at the edges of a vertex: what they scale, and where the spline begins.

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Spokes
#
# The edges at a vertex, its *spokes*, can have another mask than regular edges have. Here: by what
# waves around the vertex are scaled then; where the surface is made of pieces of the spline; and
# masks of triangles by which curvature is bounded.
#
# - C. Loop, "Bounded curvature triangle mesh subdivision with the convex hull property", The Visual
#   Computer 18, 2002: curvature is bounded if all eigenvalues after the subdominant pair are at
#   most its square.

# %%
from sympy import I, Rational, cos, exp, expand, pi, simplify, symbols

from limitsurf.scheme.lattice import QUADS, TRIANGLES, Lattice, Place

# %% [markdown]
# ## 1. What spokes scale
#
# Let the point of a spoke be $a$ of the vertex, $b$ of the far end and $c$ of each of
# the two points across. On values $w^j$ around it, with $w = e^{2 \pi i f / N}$, and 0 at the
# vertex, a step gives the factor $b + 2 c \cos(2 \pi f / N)$. The mask of the vertex has no part in
# it.

# %%
a, b, c, angle = symbols("a b c theta", real=True)
wave = exp(I * angle)
factor = b + c * (wave + 1 / wave)
assert simplify((factor - b - 2 * c * cos(angle)).rewrite(cos)) == 0

# %% [markdown]
# At frequency 0 the block on vertex and neighbours is $((m, 1 - m), (a, 1 - a))$, with $m$ what the
# vertex keeps: its eigenvalues are 1 and $m - a$.

# %%
m, x = symbols("m x")
block = (m - x) * (1 - a - x) - a * (1 - m)
assert expand(block - (1 - x) * (m - a - x)) == 0

# %% [markdown]
# ## 2. Where the spline begins
#
# Points at distance 1 from the vertex, in edges of some level, come from spokes; those of the next
# step at half that distance, too. A face is a piece of the spline if no spoke has a part in any
# refinement of its control points, that is if the vertex is not one of them: then spokes are
# outside of the triangles or quads between its control points, and remain so. Of the faces that one
# step makes of a face at the vertex none is so; of those that two steps make all twelve are, that
# are not in the first step's face at the vertex.


# %%
def template(lattice: Lattice, origin: Place, turned: bool) -> set[Place]:
    """Control points of a face, as places from the vertex on, in its own size."""
    side = -1 if turned else 1
    return {(origin[0] + side * (i - 1), origin[1] + side * (j - 1)) for i, j in lattice.template}


for lattice in (QUADS, TRIANGLES):
    with_vertex = [(0, 0) in template(lattice, x.origin, x.turned) for x in lattice.pieces]
    assert all(with_vertex)
    assert len(lattice.fine_pieces) == 12
    for piece in lattice.fine_pieces:
        assert (0, 0) not in template(lattice, piece.origin, piece.turned)

# %% [markdown]
# In quads the mask of faces is the same everywhere, and the farthest of the three, whose control
# point the vertex is only across a face, would be a piece of the spline already; it is cut like the
# others.
#
# ## 3. Bounded curvature
#
# With $\lambda$ for frequency 1 and $\lambda^2$ for frequency 2 the mask is known, and all
# frequencies from 2 on lie between $\lambda^2$ and that of $\theta = \pi$, which is
# $b - 2 c$. It is not below $-\lambda^2$ if
# $(1 + \lambda) / (1 - \lambda) \geq (1 + c_1) / (c_1 - c_2)$, with
# $c_f = \cos(2 \pi f / N)$.

# %%
size, c1, c2 = symbols("lambda c_1 c_2", positive=True)
across = size * (1 - size) / (c1 - c2) / 2
far = size - 2 * across * c1
assert simplify(far + 2 * across * c1 - size) == 0
assert simplify(far + 2 * across * c2 - size**2) == 0
ratio = (1 + c1) / (c1 - c2)
gap = (far - 2 * across + size**2) / (size * (1 - size))
assert simplify(gap - ((1 + size) / (1 - size) - ratio)) == 0

# %% [markdown]
# At $N = 6$ and $\lambda = 1/2$ it is the mask of Loop, 3/8 and 1/8, and 1/2 is enough up to
# $N = 9$.

# %%
at_six = {size: Rational(1, 2), c1: Rational(1, 2), c2: -Rational(1, 2)}
assert (far.subs(at_six), across.subs(at_six)) == (Rational(3, 8), Rational(1, 8))
for n in range(4, 14):
    first, second = (cos(2 * pi * f / n) for f in (1, 2))
    enough = bool((3 - ratio.subs({c1: first, c2: second})).evalf(30) >= 0)
    assert enough == (n <= 9)
