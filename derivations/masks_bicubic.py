"""The Catmull-Clark masks are knot insertion for bicubic B-splines, carried over to any mesh.

Papers
    E. Catmull, J. Clark, "Recursively generated B-spline surfaces on arbitrary topological
    meshes", Computer-Aided Design 10 (1978): the interior rules.
    T. DeRose, M. Kass, T. Truong, "Subdivision surfaces in character animation", SIGGRAPH 1998:
    the boundary rules.

Run this file: it says nothing unless an assertion fails.
"""

from fractions import Fraction
from itertools import product

from sympy import Rational, Symbol, binomial, expand, symbols

from limitsurf.exact.catmull_clark import CATMULL_CLARK

# 1. One variable: the two-scale relation
# ---------------------------------------
# The uniform cubic B-spline N has knots 0, 1, 2, 3, 4. Cox and de Boor's recursion gives its
# polynomial pieces, piece i on [i, i + 1].

t = Symbol("t")


def b_spline(degree):
    if degree == 0:
        return [Rational(1)]
    lower = b_spline(degree - 1)
    rising = [*(t * piece / degree for piece in lower), 0]
    falling = [0, *((degree + 1 - t) * piece.subs(t, t - 1) / degree for piece in lower)]
    return [expand(a + b) for a, b in zip(rising, falling, strict=True)]


pieces = b_spline(3)
assert pieces[0] == t**3 / 6

# It is a combination of its own half-size copies, with binomial weights:
#
#     N(t) = sum_k w_k N(2 t - k),    w = (1, 4, 6, 4, 1) / 8,
#
# checked on each of the eight half intervals [h/2, (h+1)/2].

w = [binomial(4, k) / 8 for k in range(5)]

for half in range(8):
    refined = sum(w[k] * pieces[half - k].subs(t, 2 * t - k) for k in range(5) if 0 <= half - k < 4)
    assert expand(pieces[half // 2] - refined) == 0

# So a curve with control points c_j has, for knots half as far apart, the control points
# c'_i = sum_j w_{i - 2j} c_j: of an old control point (even i) and of an edge (odd i)

even = {-1: w[4], 0: w[2], 1: w[0]}
odd = {0: w[3], 1: w[1]}
assert even == {-1: Rational(1, 8), 0: Rational(3, 4), 1: Rational(1, 8)}
assert odd == {0: Rational(1, 2), 1: Rational(1, 2)}

# 2. Two variables: the three masks of a regular mesh
# ---------------------------------------------------
# A bicubic surface inserts knots in both directions, so its weights are products.

c = {(i, j): Symbol(f"c{i}{j}") for i, j in product(range(4), repeat=2)}


def inserted(along_u, along_v, i, j, points=c):
    return sum(a * b * points[i + k, j + m] for k, a in along_u.items() for m, b in along_v.items())


# Face point: both directions halve. It is the mean of the four corners.


def face_point(i, j, points=c):
    return (points[i, j] + points[i + 1, j] + points[i + 1, j + 1] + points[i, j + 1]) / 4


assert expand(inserted(odd, odd, 1, 1) - face_point(1, 1)) == 0

# Edge point: the mean of the two ends and of the two new face points.

edge_point = (c[1, 1] + c[2, 1] + face_point(1, 0) + face_point(1, 1)) / 4
assert expand(inserted(odd, even, 1, 1) - edge_point) == 0

# Vertex point: Q / 4 + R / 2 + S / 4, with Q the mean of the four new face points, R that of the
# four edge midpoints, S the vertex itself.

S = c[1, 1]
neighbours = [c[2, 1], c[1, 2], c[0, 1], c[1, 0]]
faces = [face_point(i, j) for i, j in product((0, 1), repeat=2)]
Q = sum(faces) / 4
R = sum((S + e) / 2 for e in neighbours) / 4
assert expand(inserted(even, even, 1, 1) - (Q / 4 + R / 2 + S / 4)) == 0

# 3. Any mesh
# -----------
# Catmull and Clark keep the words and change the numbers. The face point of an n-gon is the mean of
# its n corners; the edge point stays; a vertex where N faces meet moves to
#
#     (Q + 2 R + (N - 3) S) / N,
#
# which is the bicubic rule at N = 4. Two choices are in it, and a test that looks at regular meshes
# alone sees neither: how the n corners share, and how N enters. With R = S / 2 + (mean of the
# neighbours) / 2, the weights of the vertex, of each neighbour and of each new face point are
# (N - 2) / N, 1 / N^2 and 1 / N^2.

N = Symbol("N", positive=True)
q, neighbour_mean, s = symbols("q m s")
rule = (q + 2 * (s / 2 + neighbour_mean / 2) + (N - 3) * s) / N
own, each_neighbour, each_face = (N - 2) / N, 1 / N**2, 1 / N**2
assert expand(rule - (own * s + each_neighbour * N * neighbour_mean + each_face * N * q)) == 0
assert expand(own + N * each_neighbour + N * each_face) == 1

# Where all the faces around are quadrilaterals, and after one step they are, the mask on the old
# vertices is 1 - 7 / (4 N), 3 / (2 N^2) for each edge neighbour and 1 / (4 N^2) for each opposite
# corner: each face point hands a quarter to the vertex, to two neighbours and to the corner.

assert expand(own + N * each_face / 4 - (1 - 7 / (4 * N))) == 0
assert expand(each_neighbour + 2 * each_face / 4 - 3 / (2 * N**2)) == 0

# 4. Boundaries
# -------------
# A boundary is a cubic B-spline curve of its own control points: the masks of section 1. Is it
# still a bicubic spline inside? Continue a regular mesh by a row of phantom points, each the
# reflection 2 b - i of an inner point i at a boundary point b. Knot insertion on the continued mesh

b = [Symbol(f"b{k}") for k in range(3)]
inner = [Symbol(f"i{k}") for k in range(3)]
mesh = {(k, 1): b[k] for k in range(3)} | {(k, 2): inner[k] for k in range(3)}
mesh |= {(k, 0): 2 * b[k] - inner[k] for k in range(3)}

for along, k in ((even, 1), (odd, 0)):
    new_boundary = inserted(along, even, k, 1, mesh)
    new_inner = inserted(along, odd, k, 1, mesh)
    new_phantom = inserted(along, odd, k, 0, mesh)
    # gives the boundary its own curve's rule,
    assert expand(new_boundary - sum(a * b[k + m] for m, a in along.items())) == 0
    # and phantoms that are again reflections: the argument repeats at every level.
    assert expand(new_phantom - (2 * new_boundary - new_inner)) == 0

# So wherever two faces meet at a boundary vertex the limit is the spline of the continued mesh: it
# ends on the boundary's curve, (1, 4, 1) / 6 across, with second derivative 1, -2, 1 across zero.

phantom, middle, first = mesh[1, 0], mesh[1, 1], mesh[1, 2]
assert expand((phantom + 4 * middle + first) / 6 - b[1]) == 0
assert expand(phantom - 2 * middle + first) == 0

# At a vertex of one face two boundaries meet, and the phantom beyond it is a reflection in both
# directions. Points: the corner p, its neighbours x and y, the opposite corner o of the face.

p, x, y, o = symbols("p x y o")
mesh = {(1, 1): p, (2, 1): x, (1, 2): y, (2, 2): o}
mesh |= {(0, 1): 2 * p - x, (0, 2): 2 * y - o, (1, 0): 2 * p - y, (2, 0): 2 * x - o}
mesh[0, 0] = 2 * mesh[0, 1] - mesh[0, 2]
assert expand(mesh[0, 0] - (2 * mesh[1, 0] - mesh[2, 0])) == 0  # either order

# Knot insertion leaves the corner where it is. That is the rule of the mode "edge_and_corner";
# under "edge_only" the corner moves to (x + 6 p + y) / 8, which no reflection gives, and such a
# vertex is extraordinary. Its neighbours follow the boundary curves, and reflect again.

assert expand(inserted(even, even, 1, 1, mesh) - p) == 0
assert expand(inserted(odd, even, 1, 1, mesh) - (p + x) / 2) == 0
assert expand(inserted(odd, even, 0, 1, mesh) - (2 * p - (p + x) / 2)) == 0
assert (x + 6 * p + y) / 8 != p

# 5. The masks of the package
# ---------------------------

assert CATMULL_CLARK.edge == (Fraction(1, 4), Fraction(1, 4))
assert CATMULL_CLARK.boundary_edge == Fraction(odd[0].p, odd[0].q)
assert CATMULL_CLARK.boundary_vertex == (Fraction(3, 4), Fraction(1, 8))
for n in range(3, 20):
    assert CATMULL_CLARK.face_mask(n) == (Fraction(1, n),) * n
for n in range(2, 70):
    derived = [weight.subs(N, n) for weight in (own, each_neighbour, each_face)]
    assert CATMULL_CLARK.vertex_mask(n) == tuple(Fraction(d.p, d.q) for d in derived)
