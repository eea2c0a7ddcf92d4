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
"""Samples by area: rejection, rings around special corners, and elimination in rounds.

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Samples by area
#
# On a [Bezier patch](pieces.py) $x(s, t)$ there is $J = \lvert x_s \times x_t \rvert$ of area to an
# area of parameters. This document derives
#
# 1. how places are drawn by area from bounds of $J$ alone;
# 2. bounds of $J$ on all the rings around a special corner;
# 3. why samples may be eliminated many at a time.
#
# - C. Yuksel, "Sample elimination for generating Poisson disk sample sets", Computer Graphics Forum
#   34, 2015: section 3.

# %%
from fractions import Fraction

import numpy as np
from sympy import Rational, integrate, simplify, symbols

from limitsurf.basis import on_rings
from limitsurf.pieces.bernstein import Bernstein
from limitsurf.query.density import _minors
from limitsurf.query.polynomials import Form, products
from limitsurf.scheme.catmull_clark import CATMULL_CLARK
from limitsurf.scheme.lattice import QUADS
from limitsurf.scheme.loop import LOOP
from limitsurf.scheme.sector import Sector
from limitsurf.tables import eigen_table

s, t = symbols("s t")

# %% [markdown]
# ## 1. Rejection
#
# Piece $k$, of an area $D$ of parameters, has a bound $M_k \ge J_k$. Let it be drawn with
# probability $M_k / \sum M$, a place in it evenly, and the place be kept with probability
# $J_k / M_k$. Then a place has the density
#
# $$
# \frac{M_k}{\sum M} \cdot \frac1D \cdot \frac{J_k(s, t)}{M_k} = \frac{J_k(s, t)}{D \sum M} :
# $$
#
# in proportion to $J$, with the same factor in all pieces, and the bounds are no longer in it. One
# of $D \sum M / A$ places is kept, where $A$ is the area of the surface. So bounds need not be
# good, but where they are not they waste; halves of a piece have better ones, as $J$ is continuous.
#
# Here with two pieces, and $J$ a polynomial: the share of those kept is that of areas.

# %%
density = [1 + s * t, 2 - s]
bounds = [Rational(3), Rational(5, 2)]
kept = [
    bound / sum(bounds) * integrate(integrate(J / bound, (s, 0, 1)), (t, 0, 1))
    for J, bound in zip(density, bounds, strict=True)
]
area = [integrate(integrate(J, (s, 0, 1)), (t, 0, 1)) for J in density]
assert [simplify(k / sum(kept) - a / sum(area)) for k, a in zip(kept, area, strict=True)] == [0, 0]

# %% [markdown]
# A bound of $J$ is the greatest length of a coefficient of $x_s \times x_t$, which is a polynomial
# of twice the degree; its coefficients are [means of products](closest.py#1-squared-distances) of
# those of $x_s$ and $x_t$. Another one is the greatest length of those of $x_s$ times that of
# those of $x_t$.

# %%
rng = np.random.default_rng(1)
form, control = Form.of(QUADS, 3), rng.normal(size=(16, 3))
a, b = form.derivatives[1] @ control, form.derivatives[2] @ control
cross = np.cross(a[:, None], b[None]).reshape(256, 3)
most = np.sqrt(((products(QUADS, 3).T @ cross) ** 2).sum(axis=1)).max()
places = rng.random((2, 500))
du, dv = np.moveaxis(form.values(*places)[:, 1:3] @ control, 1, 0)
J = np.sqrt((np.cross(du, dv) ** 2).sum(axis=1))
assert J.max() <= most + 1e-12
assert J.max() <= np.sqrt((a**2).sum(axis=1)).max() * np.sqrt((b**2).sum(axis=1)).max()

# %% [markdown]
# ## 2. Rings
#
# Around a special corner $x$ is a sum $\sum_k c_k f_k$ of [eigenfunctions](eigenfunctions.py),
# which become those of ring $n$ by $J^n$, the power of their Jordan matrix. With the minors
# $\left| f, g \right| = f_s g_t - f_t g_s$,
#
# $$
# x_s \times x_t = \sum_{k < l} \left| f_k, f_l \right| c_k \times c_l ,
# \qquad
# \lvert x_s \times x_t \rvert \le \sum_{k < l} G_{k l} \lvert c_k \times c_l \rvert
# $$
#
# where $G_{k l}$ is the greatest coefficient of the minor, in size. A ring that is long and
# thin has small products $c_k \times c_l$, where bounds by the lengths of $x_s$ and $x_t$ would be
# too large by as much. As the minors are bilinear, those of ring $n$ are at most $P^T G P$, with
# $P$ the entries of $J^n$ by size; powers of a rotation in it count as blocks of ones. In size,
# entries of $P$ are $\lvert \lambda \rvert^n$, or $n \lvert \lambda \rvert^{n - 1}$ in Jordan
# blocks. So with $q$ the product of the two largest eigenvalues after 1, all of this falls by $q$
# or faster from ring to ring, if there are no blocks. Where there are, two factors
# $(n + 1) / n$ come with $q$, and $q' = (1 + 3 q) / 4$ holds from the ring on at which
# $(1 + 1 / n)^2 q \le q'$; those before are looked at one by one.
#
# Ring $n$, then, is drawn with probability $(1 - q) q^n$ and one of its $p$ pieces evenly: as if it
# were a piece with the bound $M q^n$, where the tail is one of the weight $p M / (1 - q)$.

# %%
q, p, M = symbols("q p M", positive=True)
n = symbols("n", integer=True, nonnegative=True)
weight = p * M / (1 - q)
assert simplify(weight * (1 - q) * q**n / p - M * q**n) == 0

# %% [markdown]
# The bounds hold on all rings, with blocks (a crease of three faces and corners of two) and
# without, for squares and triangles. They are compared with minors at places of the rings.

# %%
kinds = [("interior", 3), ("interior", 5), ("crease", 3), ("corner", 2), ("dart", 4)]
for scheme in (CATMULL_CLARK, LOOP):
    form = Form.of(scheme.lattice, int(np.max(scheme.spline.exponents)))
    for kind, faces in kinds:
        table = eigen_table(scheme, Sector(kind, faces, 0, scheme.lattice))
        i, j, most, rate = _minors(form, table, 2)
        assert 0 < rate < 1
        bound = most.max(axis=0)
        x, y = rng.dirichlet([1, 1, 1], 40)[:, :2].T  # in squares and triangles alike
        first = Bernstein.of(scheme, False).from_powers @ table.pieces[:, :, 1:]
        slopes = np.einsum("qdn,cnk->dcqk", form.values(x, y)[:, 1:3], first)
        flat = slopes.reshape(-1, first.shape[2])
        for level in range(2, 12):
            du, dv = on_rings(table, flat, np.full(len(flat), level)).reshape(slopes.shape)
            minor = np.abs(du[..., i] * dv[..., j] - dv[..., i] * du[..., j]).max(axis=(0, 1))
            assert (minor <= bound * rate ** (level - 2) * (1 + 1e-9) + 1e-15).all()

# %% [markdown]
# ## 3. Elimination
#
# Yuksel gives each sample the sum of weights of its neighbours, which fall with their distance and
# are 0 beyond $2 r$, and takes the sample of the largest sum away, again and again: sums of its
# neighbours become less by its weight. So sums only fall, and those at which samples go do not
# rise. A sample whose sum is larger than those of all its neighbours stays so until it goes: none
# of them can go before it, and what goes elsewhere only lets theirs fall. Its own does not change
# in the meantime. So such samples may go in any order, all at once too, and the sum of each when it
# goes is the one at which it would have gone: sorted by these, largest first, is the order of
# taking them one by one. Rounds end when as many are to go as have gone with sums no less than any
# that is left.
#
# Here on a small graph, whatever the order of those that may go:

# %%
weights = {}
for one in range(7):
    for other in range(one):
        if rng.random() < 0.5:
            weights[one, other] = weights[other, one] = Fraction(int(rng.integers(1, 99)), 100)


def removed(choose):
    """Samples by the sums at which they go, of those that `choose` lets go among all that may."""
    left, gone = set(range(7)), []
    while left:
        sums = {k: sum(weights.get((k, m), 0) for m in left if m != k) for k in left}
        key = {k: (sums[k], -k) for k in left}
        may = [k for k in left if all(key[k] > key[m] for m in left if (k, m) in weights)]
        for k in choose(sorted(may, key=key.get, reverse=True)):
            gone.append((*key[k], k))
            left.remove(k)
    return [k for *_, k in sorted(gone, reverse=True)]


one_by_one = removed(lambda may: may[:1])
assert one_by_one == removed(lambda may: may) == removed(lambda may: may[-1:])
assert one_by_one == removed(lambda may: may[len(may) // 2 :])
