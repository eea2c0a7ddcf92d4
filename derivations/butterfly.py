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
"""The butterfly schemes: masks, spectra, where surfaces are C1, and how they are evaluated.

After Dyn, Levin and Gregory (1990) and Zorin, Schroeder and Sweldens (1996).

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # The butterfly schemes
#
# The stencil of regular edges and that of boundaries follow from the polynomials they keep. The
# regular matrix has $1/4$ sevenfold, with a Jordan block of size 3: first derivatives converge
# like $n^2 2^{-n}$, and there are no second ones. Off the plane of a triangle, what surrounds it
# falls like $n^2 4^{-n}$, so that derivatives are sums without cancellation. The modified masks
# are those with given eigenvalues; of the original ones, and of boundaries, spectra say where
# there are normals.
#
# - N. Dyn, D. Levin, J. Gregory, "A butterfly subdivision scheme for surface interpolation with
#   tension control", ACM Transactions on Graphics 9 (1990): the stencil.
# - N. Dyn, D. Levin, J. Gregory, "A 4-point interpolatory subdivision scheme for curve design",
#   Computer Aided Geometric Design 4 (1987): boundaries.
# - D. Zorin, P. Schroeder, W. Sweldens, "Interpolating subdivision for meshes with arbitrary
#   topology", SIGGRAPH 1996: the masks at extraordinary vertices.
# - U. Reif, "A unified approach to subdivision algorithms near extraordinary vertices", Computer
#   Aided Geometric Design 12 (1995): where limits are C1.

# %%
from fractions import Fraction
from itertools import product

import numpy as np
from sympy import QQ, solve, symbols
from sympy.polys.matrices import DomainMatrix

from limitsurf import numbers, schemes
from limitsurf.engine.interpolating import Path
from limitsurf.options import Rules
from limitsurf.refine.local_steps import LocalSteps, local_steps
from limitsurf.refine.neighbourhoods import REGULAR
from limitsurf.scheme.butterfly import BUTTERFLY, MODIFIED_BUTTERFLY


def steps_of(name: str, number: numbers.NumberType) -> LocalSteps:
    """Steps under a scheme of that name."""
    return local_steps(Rules(schemes[name], "edge_and_corner", "uniform", "catmull-clark"), number)


# %% [markdown]
# ## 1. The stencils
#
# In units of half an edge, from the middle of an edge, along both directions of the lattice: its
# ends, the corners across, the wings. With one weight for each of the three sorts, polynomials up
# to degree 3 are kept by one choice alone, which is that of the paper with $w = 1/16$; so are
# those along a line by the four-point scheme. Quartics are kept by neither.

# %%
ends, across, wings = symbols("ends across wings")
places = {
    ends: [(-1, 0), (1, 0)],
    across: [(-1, 2), (1, -2)],
    wings: [(1, 2), (-1, -2), (-3, 2), (3, -2)],
}
conditions = [
    sum(weight * p**i * q**j for weight, at in places.items() for p, q in at)
    - (1 if (i, j) == (0, 0) else 0)
    for i, j in product(range(4), repeat=2)
    if i + j <= 3
]
(found,) = solve(conditions, [ends, across, wings], dict=True)
masks = {w: Fraction(str(found[w])) for w in (ends, across, wings)}
assert tuple(masks.values()) == (BUTTERFLY.ends, BUTTERFLY.across, BUTTERFLY.wings)
assert masks[across] == -2 * masks[wings] == Fraction(1, 8)

near, far = symbols("near far")
line = [2 * near + 2 * far - 1, 2 * near + 2 * 9 * far]  # of 1 and of x^2, at -3, -1, 1, 3
curve = solve(line, [near, far])
assert tuple(Fraction(str(curve[w])) for w in (near, far)) == BUTTERFLY.curve

assert sum(found[w] * p**4 for w, at in places.items() for p, _ in at) != 0
assert sum(curve[w] * 2 * p**4 for w, p in ((near, 1), (far, 3))) != 0

# %% [markdown]
# ## 2. The regular matrix
#
# On the 27 points around a triangle, those of the faces that touch its neighbours. All weights
# are rational, so is the matrix of the child at corner 0, and ranks tell what blocks there are:
# the nullity of $(A - 1/4)^j$ is 3, 6, 7, so that $1/4$ is met seven times, in blocks of size 3,
# 2 and 2.

# %%
exact = steps_of("butterfly", numbers.RATIONAL)
step = exact.kinds.expanded(REGULAR).steps[0]
A = DomainMatrix([[QQ(w.numerator, w.denominator) for w in row] for row in step], (27, 27), QQ)
one = DomainMatrix.eye(27, QQ)
assert [27 - (A - one).rank(), 27 - (A - one * QQ(1, 2)).rank()] == [1, 2]
B = A - one * QQ(1, 4)
nullity = [27 - (B**j).rank() for j in range(1, 5)]
assert nullity == [3, 6, 7, 7]
values = np.linalg.eigvals(step.astype(float))
values = values[np.argsort(-np.abs(values))]
assert np.abs(values[:3] - [1, 0.5, 0.5]).max() < 1e-9
assert np.abs(values[10:]).max() < 0.19

# %% [markdown]
# ## 3. Derivatives
#
# Of the points around a triangle, take its corner 0 away, and then the plane through its corners:
# sides $s$ and a rest $r$. As the scheme keeps what is linear, a step, doubled, has blocks
#
# $$s' = \pm s + Q r, \qquad r' = B r,$$
#
# exactly, for each of the four children. $B$ is twice a matrix with eigenvalues up to $1/4$: $r$
# falls like $n^2 2^{-n}$, and after all steps to a vertex the side tends to $s + \sum_n Q B^n r$,
# which is $s + Q (1 - B)^{-1} r$. That is the derivative; of a cubic over the lattice it is the
# cubic's.

# %%
for c in range(4):
    _, matrix = exact.step(REGULAR, c)
    sign = -1 if c == 3 else 1
    assert (matrix[:2, :2] == sign * np.eye(2, dtype=int)).all()
    assert (matrix[2:, :2] == 0).all()
    rest = np.abs(np.linalg.eigvals(matrix[2:, 2:].astype(float))).max()
    assert abs(rest - 0.5) < 1e-4
places_of = exact.kinds.known[REGULAR].places
assert places_of is not None
for k, (u, v) in enumerate(((0, 0), (1, 0), (0, 1))):
    rows_of = exact.corner(REGULAR, k).derivatives @ exact.differences(REGULAR)
    for i, j in product(range(4), repeat=2):
        if i + j > 3:
            continue
        points = [Fraction(int(p)) ** i * Fraction(int(q)) ** j for p, q in places_of]
        along = [rows_of[n] @ np.array([p - points[0] for p in points[1:]]) for n in range(2)]
        assert along[0] == (i * u ** (i - 1) * v**j if i else 0)
        assert along[1] == (j * u**i * v ** (j - 1) if j else 0)

# %% [markdown]
# ## 4. The modified masks
#
# At a vertex of valence $N$ the new neighbours are $3/4$ of it and a circulant of the old ones.
# The eigenvalue of frequency $f$ of that circulant is what the mask has as its Fourier
# coefficient: $1/4$ at 0, $1/2$ at 1, $1/4$ at 2, and 0 beyond. So $1/2$ is subdominant at every
# valence, from frequency 1, the next is $1/4$: as where the scheme is regular. At $N = 4$
# frequency 2 is met once, at $N = 3$ not at all.

# %%
for N in (3, 4, 5, 7, 8, 9, 12):
    mask = MODIFIED_BUTTERFLY.spoke_mask(N)
    assert mask is not None
    assert mask[0] == Fraction(3, 4)
    weights = [float(w) for w in mask[1:]]
    turns = 2 * np.pi * np.arange(N) / N
    waves = [np.cos(f * turns) @ weights for f in range(N // 2 + 1)]
    wanted = [1 / 4, 1 / 2, 1 / 4, *[0] * N][: N // 2 + 1]
    assert np.abs(np.array(waves) - wanted).max() < 1e-14

# %% [markdown]
# ## 5. The original masks at extraordinary vertices
#
# Around the vertex: neighbours $a_j$, then $c_j$ between $a_j$ and $a_{j+1}$, and $b_j$ behind
# $a_j$. With $\theta = 2 \pi f / N$, and $c_j$ counted at half angles, the eight-point stencil
# has blocks
#
# $$a' = \left(\tfrac12 + \tfrac14 \cos\theta - \tfrac18 \cos 2\theta\right) a
# - \tfrac18 \cos\tfrac\theta2\, c, \qquad b' = a,$$
#
# $$c' = \left(\cos\tfrac\theta2 - \tfrac18 \cos\tfrac{3\theta}2\right) a
# - \tfrac18 \cos\tfrac\theta2\, b + \tfrac18 c$$
#
# at frequencies other than 0. At $N = 3$ frequencies 0 and 1 tie at $1/4$, and there is no
# tangent plane; from $N = 4$ to 7 frequency 1 leads; from 8 on frequency 2 or a higher one, so
# that the surface goes around the vertex more than once.


# %%
def blocks(N: int, f: int) -> np.ndarray:
    """What a step does to waves of a frequency: a, b and c."""
    t = 2 * np.pi * f / N
    half = np.cos(t / 2)
    return np.array(
        [
            [1 / 2 + np.cos(t) / 4 - np.cos(2 * t) / 8, 0, -half / 8],
            [1, 0, 0],
            [half - np.cos(3 * t / 2) / 8, -half / 8, 1 / 8],
        ]
    )


def leading(N: int) -> list[float]:
    """The largest eigenvalue of each frequency from 1 to N / 2."""
    return [np.abs(np.linalg.eigvals(blocks(N, f))).max() for f in range(1, N // 2 + 1)]


assert abs(leading(3)[0] - 0.25) < 1e-4  # a Jordan block
for N in range(4, 8):
    assert np.argmax(leading(N)) == 0
for N in range(8, 51):
    assert np.argmax(leading(N)) > 0
assert abs(leading(6)[0] - 0.5) < 1e-12

# %% [markdown]
# The matrices that evaluate have the same, and only there normals.


# %%
def wheel(N: int, k: int | None = None) -> list[tuple[int, int, int]]:
    """Faces around a vertex of valence N in three rings, of k sectors of it if that is given."""
    number: dict[tuple[int, int, int], int] = {}

    def at(r: int, s: int, t: int) -> int:
        if r == 0:
            s = t = 0
        if t == r and r:
            s, t = s + 1, 0
        return number.setdefault((r, s if k else s % N, t), len(number))

    faces = []
    for s, r in product(range(k or N), range(1, 4)):
        for t in range(r):
            faces.append((at(r - 1, s, t), at(r, s, t), at(r, s, t + 1)))
            if t < r - 1:
                faces.append((at(r - 1, s, t), at(r, s, t + 1), at(r - 1, s, t + 1)))
    return faces


def settled(name: str, faces: list[tuple[int, int, int]]) -> tuple[np.ndarray, bool]:
    """Eigenvalues of the matrix at corner 0 of the first face, and whether there is a normal."""
    from limitsurf import Mesh

    steps = steps_of(name, numbers.FLOAT64)
    mesh = Mesh(np.zeros((1 + max(map(max, faces)), 0)), faces)
    kind = int(steps.kinds.of(mesh, np.array([0]))[0][0])
    for _ in range(6):
        kind = steps.child(kind, 0)
    found = np.linalg.eigvals(steps.step(kind, 0)[1]) / 2
    normal = steps.corner(kind, 0).normal
    return found[np.argsort(-np.abs(found))], not np.isnan(normal).any()


for N in (3, 4, 5, 6, 7, 8, 9, 12, 20, 50):
    found, normal = settled("butterfly", wheel(N))
    assert abs(abs(found[0]) - max(*leading(N), 0.25)) < 1e-4
    assert normal == (4 <= N <= 7)
    found, normal = settled("modified-butterfly", wheel(N))
    assert np.abs(np.abs(found[:3]) - [0.5, 0.5, 0.25]).max() < 1e-4
    assert normal

# %% [markdown]
# ## 6. Boundaries
#
# Ends on a boundary have no mask of their own: both schemes are the same there. Along the
# boundary the four-point scheme has $1/2$, with $1/4$ next; what leads away from it, by the
# number $k$ of faces: of $k = 3$ the boundary of a regular lattice, $1/2$ too; of 2 the
# eigenvalue of frequency 1 at $N = 4$, less than $1/2$; of 1 a chain of two at $1/4$, so that
# normals come to their limit like $1/n$. From $k = 4$ on the two that lead do not make a fan that
# goes once from one side to the other: there is no normal at the vertex.

# %%
for name in ("butterfly", "modified-butterfly"):
    for k in range(1, 13):
        found, normal = settled(name, wheel(2 * k, k))
        assert normal == (k <= 3), k
        if k == 1:
            assert np.abs(found[:3] - [0.5, 0.25, 0.25]).max() < 1e-4
        if k == 2:
            assert abs(found[0] - 0.5) < 1e-9
            assert abs(found[1] - leading(4)[0]) < 1e-9
        if k == 3:
            assert np.abs(found[:2] - 0.5).max() < 1e-9

# %% [markdown]
# ## 7. Parameters without rounding
#
# A triangle is halved by doubling two of the three barycentric coordinates and taking 1 from one
# of them, and in its middle by $1 - 2x$ and $2y - (1 - 2x)$, where $x \ge y$ are those that are
# known: there $1/4 \le x \le 1/2$ and $2 y \ge 1 - 2 x$, so that all of these are floating-point
# numbers. Compared with Fractions, to the end:

# %%
rng = np.random.default_rng(0)
u, v = rng.random((2, 400)) * 2.0 ** -rng.integers(0, 60, (2, 400))
inside = u + v <= 1
u, v = u[inside], v[inside]
path = Path(steps_of("butterfly", numbers.FLOAT64), u, v)
whole = Path(exact, *(np.array([Fraction(a) for a in b], dtype=object) for b in (u, v)))
every = np.arange(len(u))
for _ in range(150):
    one, other = path._halved(every), whole._halved(every)
    assert (one == other).all()
    assert all(Fraction(a) == b for a, b in zip(path._x.tolist(), whole._x, strict=True))
    assert all(Fraction(a) == b for a, b in zip(path._y.tolist(), whole._y, strict=True))
assert path._done().all()
