"""Independent oracles for Catmull-Clark limit surfaces: naive, exact, sharing no code with `src`.

Everything here is typed by hand from papers, runs on plain lists and dicts, and knows no
eigenvector of the extended subdivision matrix.  A limit point is found as a reader of Catmull and
Clark (1978) would find it: cut out the faces around the queried one, refine, walk into the child
that holds (u, v), and repeat until that child is an ordinary bicubic B-spline patch.  All numbers
on that walk are integers over one common denominator, so the result is exact at any depth; there
is no tolerance to choose.

Meshes are a list of points (tuples of any number of channels) and a list of faces
(counter-clockwise vertex lists).  ``mode`` is the treatment of boundaries, "edge_and_corner" or
"edge_only".  Limit faces follow Ptex: a quad is one, an n-gon is n consecutive ones, limit face k
with its (0, 0) at the polygon's corner k, u towards corner k + 1, v towards corner k - 1, the face
centre at (1, 1).

References
----------
[CC]   Catmull, Clark, Recursively generated B-spline surfaces on arbitrary topological meshes,
       Computer-Aided Design 10 (1978)
[HKD]  Halstead, Kass, DeRose, Efficient, fair interpolation using Catmull-Clark surfaces,
       SIGGRAPH 1993
[DKT]  DeRose, Kass, Truong, Subdivision surfaces in character animation, SIGGRAPH 1998
[S]    Stam, Exact evaluation of Catmull-Clark subdivision surfaces at arbitrary parameter values,
       SIGGRAPH 1998
[BS]   Ball, Storry, Conditions for tangent plane continuity over recursively generated B-spline
       surfaces, ACM Transactions on Graphics 7 (1988)
[HRSW] Hakenberg, Reif, Schaefer, Warren, Volume enclosed by subdivision surfaces, viXra:1405.0012
"""

import functools
import itertools
import math
import numbers
import operator
import random
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import mpmath
import numpy as np
from scipy.interpolate import BSpline

MODES = ("edge_and_corner", "edge_only")

CACHED = 10000  # neighbourhoods, which is more than the tests of one file meet

CASES = Path(__file__).resolve().parents[2] / "shared" / "reference" / "cases"


# --- numbers from papers --------------------------------------------------------------------------

CUBE_POINTS = [tuple(Fraction(x) for x in p) for p in itertools.product((0, 1), repeat=3)]
CUBE_FACES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]

# Limits of the closed unit cube, by the masks of [HKD].
CUBE_CORNER = Fraction(1, 4)  # the corner (0, 0, 0) goes to (1/4, 1/4, 1/4)
CUBE_FACE_CENTRE = Fraction(13, 162)  # depth of a face's centre below that face
CUBE_EDGE_MIDPOINT = Fraction(253, 1296)  # depth of an edge's midpoint below both of its faces
CUBE_VOLUME = "0.32755237908737308784808321763218401296212587910825"  # [HRSW]
CUBE_AREA = "2.2993965862338"

# Subdominant eigenvalue of the 1-ring, by valence: [BS].
SUBDOMINANT = {
    3: 0.4100970508005519,
    5: 0.5499883545182972,
    6: 0.5796823261022109,
    7: 0.5985102834817406,
    8: 0.6111165266945380,
    10: 0.6263412675469543,
    50: 0.6533541152143524,
}


def ring_eigenvalues(N):
    """The 2 N + 1 eigenvalues of the 1-ring matrix, in mpf, by Fourier frequency: [BS], [S].

    Returns ``{0: [1, a, b], f: [p, q], ...}`` for f = 1 .. N - 1, the larger one first in each
    pair.  The seven of the outer ring are `OUTER_EIGENVALUES`.
    """
    root = mpmath.sqrt(mpmath.mpf(49 - 30 * N + 5 * N * N))
    values = {0: [mpmath.mpf(1), (3 * N - 7 + root) / (8 * N), (3 * N - 7 - root) / (8 * N)]}
    for f in range(1, N):
        c = mpmath.cos(2 * mpmath.pi * f / N)
        s = abs(mpmath.cos(mpmath.pi * f / N))
        root = s * mpmath.sqrt(2 * (9 + c))
        values[f] = [(5 + c + root) / 16, (5 + c - root) / 16]
    return values


OUTER_EIGENVALUES = [Fraction(1, d) for d in (64, 8, 8, 16, 16, 32, 32)]


def limit_mask(N):
    """Limit of an interior vertex among quads, (vertex, each edge, each diagonal): [HKD]."""
    total = N * (N + 5)
    return Fraction(N * N, total), Fraction(4, total), Fraction(1, total)


def tangent_masks(N):
    """Two tangents of an interior vertex among quads, in mpf: [HKD].

    Returns ``(edges1, diagonals1), (edges2, diagonals2)``, each a list of N weights; the vertex
    has weight 0.  Diagonal i is that of the quad between edges i and i + 1, counter-clockwise.  The
    first mask is even and points along edge 0, the second is the first turned by a quarter; their
    cross product is the normal.
    """
    turn = 2 * mpmath.pi / N
    A = 1 + mpmath.cos(turn)
    A += mpmath.cos(mpmath.pi / N) * mpmath.sqrt(2 * (9 + mpmath.cos(turn)))
    return tuple(
        (
            [A * wave(turn * i) for i in range(N)],
            [wave(turn * i) + wave(turn * (i + 1)) for i in range(N)],
        )
        for wave in (mpmath.cos, mpmath.sin)
    )


# --- the naive refiner ----------------------------------------------------------------------------


def _combine(terms, divisor):
    """sum(weight * point) / divisor over (weight, point) pairs, channel by channel.

    Weights are integers or Fractions. Sums of Fractions are reduced once, at their end.
    """
    weights, points = zip(*terms, strict=True)
    totals = []
    for xs in zip(*points, strict=True):
        if all(type(x) is Fraction for x in xs):
            numerators, D = _over_one_denominator(xs)
            total = sum(map(operator.mul, weights, numerators))
            totals.append(Fraction(total, D * divisor))
        elif type(xs[0]) is Stencil:
            totals.append(Stencil.sum(weights, xs, divisor))
        else:
            scaled = map(operator.mul, weights, xs)
            totals.append(functools.reduce(operator.add, scaled) / divisor)
    return tuple(totals)


def _over_one_denominator(fractions):
    """Integers, and what all of them are to be divided by."""
    D = math.lcm(*(x.denominator for x in fractions))
    return [x.numerator * (D // x.denominator) for x in fractions], D


def _edge(a, b):
    return (a, b) if a < b else (b, a)


def _sides(face):
    return list(zip(face, face[1:] + face[:1], strict=True))


def _incidence(faces):
    """Dicts edge -> faces, vertex -> edges, vertex -> faces; edges ascending, in sorted order."""
    edge_faces, vertex_edges, vertex_faces = {}, {}, {}
    for f, face in enumerate(faces):
        for a, b in _sides(face):
            edge_faces.setdefault(_edge(a, b), []).append(f)
            vertex_faces.setdefault(a, []).append(f)
    edge_faces = {edge: edge_faces[edge] for edge in sorted(edge_faces)}
    for edge in edge_faces:
        for v in edge:
            vertex_edges.setdefault(v, []).append(edge)
    return edge_faces, vertex_edges, vertex_faces


def _check_mode(mode):
    if mode not in MODES:
        raise ValueError(f"got mode {mode!r}, need one of {MODES}")


def _exact_integers(points):
    """Points with integers turned into Fractions, so that dividing them stays exact."""
    return [
        tuple(Fraction(int(x)) if isinstance(x, numbers.Integral) else x for x in p) for p in points
    ]


def refine(points, faces, mode="edge_and_corner"):
    """One step of Catmull-Clark on any number type that has +, integer * and / by an integer.

    Interior rules of [CC]: face point F = mean of the corners; edge point = mean of the two ends
    and the two face points; a vertex of valence n goes to (Q + 2 R + (n - 3) S) / n, Q the mean of
    its face points, R the mean of the midpoints of its edges, S itself.  Boundary rules of [DKT]:
    midpoint, and (1, 6, 1) / 8 along the boundary; a vertex with one face stays where it is under
    "edge_and_corner".  Unused vertices are kept.

    New vertices: those of the vertices, then of the edges (ascending pairs in lexicographic
    order), then of the faces.  The children of a face come in the order of its corners; a child is
    (corner, midpoint of the next edge, face point, midpoint of the previous edge).
    """
    _check_mode(mode)
    points, faces = _exact_integers(points), [list(map(int, face)) for face in faces]
    edge_faces, vertex_edges, vertex_faces = _incidence(faces)

    face_points = [_combine([(1, points[v]) for v in face], len(face)) for face in faces]

    edge_points = []
    for (a, b), sides in edge_faces.items():
        ends = [(1, points[a]), (1, points[b])]
        if len(sides) == 2:
            edge_points.append(_combine(ends + [(1, face_points[f]) for f in sides], 4))
        else:
            edge_points.append(_combine(ends, 2))

    vertex_points = []
    for v, S in enumerate(points):
        edges = vertex_edges.get(v, [])
        boundary = [edge for edge in edges if len(edge_faces[edge]) == 1]
        n = len(vertex_faces.get(v, []))
        if n == 0 or (boundary and n == 1 and mode == "edge_and_corner"):
            vertex_points.append(S)
        elif boundary:
            along = [(1, points[a if b == v else b]) for a, b in boundary]
            vertex_points.append(_combine([(6, S), *along], 8))
        else:
            Q = _combine([(1, face_points[f]) for f in vertex_faces[v]], n)
            midpoints = [_combine([(1, points[a]), (1, points[b])], 2) for a, b in edges]
            R = _combine([(1, m) for m in midpoints], n)
            vertex_points.append(_combine([(1, Q), (2, R), (n - 3, S)], n))

    edge_id = {edge: len(points) + e for e, edge in enumerate(edge_faces)}
    children = []
    for f, face in enumerate(faces):
        middle = [edge_id[_edge(a, b)] for a, b in _sides(face)]
        centre = len(points) + len(edge_faces) + f
        children += [[v, middle[k], centre, middle[k - 1]] for k, v in enumerate(face)]
    return vertex_points + edge_points + face_points, children


def refine_times(points, faces, levels, mode="edge_and_corner"):
    """`refine`, ``levels`` times."""
    for _ in range(levels):
        points, faces = refine(points, faces, mode)
    return points, faces


def limit_positions(points, faces, mode="edge_and_corner"):
    """Every vertex moved to its limit; all faces at interior vertices must be quads.

    Interior: the mask of [HKD].  Boundary: (1, 4, 1) / 6, the limit of a cubic B-spline curve
    ([DKT]); a vertex with one face stays under "edge_and_corner".  Unused vertices stay.
    """
    _check_mode(mode)
    points, faces = _exact_integers(points), [list(map(int, face)) for face in faces]
    edge_faces, vertex_edges, vertex_faces = _incidence(faces)
    limits = []
    for v, S in enumerate(points):
        edges = vertex_edges.get(v, [])
        boundary = [edge for edge in edges if len(edge_faces[edge]) == 1]
        n = len(vertex_faces.get(v, []))
        if n == 0 or (boundary and n == 1 and mode == "edge_and_corner"):
            limits.append(S)
        elif boundary:
            along = [(1, points[a if b == v else b]) for a, b in boundary]
            limits.append(_combine([(4, S), *along], 6))
        else:
            around = [faces[f] for f in vertex_faces[v]]
            if any(len(face) != 4 for face in around):
                raise ValueError(f"vertex {v} touches a face that is no quad: refine once first")
            terms = [(n * n, S)]
            terms += [(4, points[a if b == v else b]) for a, b in edges]
            terms += [(1, points[face[(face.index(v) + 2) % 4]]) for face in around]
            limits.append(_combine(terms, n * (n + 5)))
    return limits


def limit_faces(faces):
    """Ptex numbering: the list of (face, corner), corner -1 for a quad."""
    return [
        (f, k)
        for f, face in enumerate(faces)
        for k in ([-1] if len(face) == 4 else range(len(face)))
    ]


def refined_parameters(faces, levels):
    """(limit face, (u, v) of its four corners) for each face refined ``levels`` >= 1 times."""
    if levels < 1:
        raise ValueError(f"got levels {levels}, need at least 1")
    half = Fraction(1, 2)

    def children(corners):
        middle = [
            tuple(half * (a + b) for a, b in zip(p, q, strict=True)) for p, q in _sides(corners)
        ]
        centre = tuple(sum(c) / 4 for c in zip(*corners, strict=True))
        return [[p, middle[k], centre, middle[k - 1]] for k, p in enumerate(corners)]

    square = [tuple(map(Fraction, c)) for c in CORNERS]
    result = []
    for i, (_, k) in enumerate(limit_faces(faces)):
        result += [(i, c) for c in (children(square) if k == -1 else [square])]
    for _ in range(levels - 1):
        result = [(i, c) for i, corners in result for c in children(corners)]
    return result


# --- the exact limit by descent -------------------------------------------------------------------

CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))  # (u, v) of a quad's corners


class Stencil(Mapping):
    """A linear form {vertex: Fraction}: the number type that turns `refine` into its own matrix.

    It holds integers over a common denominator.
    """

    def __init__(self, weights=()):
        weights = dict(weights)
        numerators, self.denominator = _over_one_denominator(weights.values())
        self.numerators = dict(zip(weights, numerators, strict=True))

    @classmethod
    def over(cls, numerators, denominator):
        self = cls.__new__(cls)
        self.numerators, self.denominator = numerators, denominator
        return self

    @classmethod
    def sum(cls, weights, stencils, divisor=1):
        """sum(weight * stencil) / divisor, for integers and Fractions as weights."""
        weights, D = _over_one_denominator(weights)
        common = math.lcm(*(x.denominator for x in stencils))
        total = {}
        for weight, x in zip(weights, stencils, strict=True):
            scale = weight * (common // x.denominator)
            for v, w in x.numerators.items():
                total[v] = total.get(v, 0) + scale * w
        return cls.over(total, common * D * divisor)

    def __getitem__(self, v):
        return Fraction(self.numerators[v], self.denominator)

    def __iter__(self):
        return iter(self.numerators)

    def __len__(self):
        return len(self.numerators)

    def __add__(self, other):
        return Stencil.sum((1, 1), (self, other))

    def __rmul__(self, factor):
        return Stencil.sum((factor,), (self,))

    def __truediv__(self, divisor):
        return Stencil.over(self.numerators, self.denominator * divisor)


def _fan(faces, around, v, start):
    """The faces at v, counter-clockwise, as (face, position of v), and whether they close.

    The list begins at face ``start`` if v is interior, otherwise at the face whose side out of v
    is a boundary edge.
    """
    place = {f: faces[f].index(v) for f in around}
    successor = {f: faces[f][(i + 1) % len(faces[f])] for f, i in place.items()}
    predecessor = {f: faces[f][i - 1] for f, i in place.items()}
    leaving = {a: f for f, a in successor.items()}  # the face with the side v -> a
    arriving = {a: f for f, a in predecessor.items()}  # the face with the side a -> v

    first, interior = start, True
    while (clockwise := arriving.get(successor[first])) != start:
        if clockwise is None:
            interior = False
            break
        first = clockwise
    if interior:
        first = start
    fan = [first]
    while (f := leaving.get(predecessor[fan[-1]])) not in (first, None):
        fan.append(f)
    return [(f, place[f]) for f in fan], interior


def _neighbourhood(faces, vertex_faces, target):
    """All that the limit over face ``target`` depends on: (local faces, vertices).

    ``target`` is a face's vertices, begun anywhere.  The faces kept are those that share a vertex
    with it.  Their other vertices may thereby lose faces, but no rule that counts ever asks for
    those.  Local faces are tuples of local ids, the target first, numbered by a walk around its
    corners: neighbourhoods of the same shape get the same tuple.
    """
    start = next(f for f in vertex_faces[target[0]] if tuple(target[:2]) in _sides(faces[f]))
    ids = {v: i for i, v in enumerate(target)}
    local, seen = [tuple(ids.values())], {start}
    for v in target:
        for f, i in _fan(faces, vertex_faces[v], v, start)[0]:
            if f not in seen:
                seen.add(f)
                turned = faces[f][i:] + faces[f][:i]
                local.append(tuple(ids.setdefault(w, len(ids)) for w in turned))
    return tuple(local), list(ids)


def _integer_rows(stencils):
    """Linear forms as [(pick these, times these integers)], and their common denominator."""
    shared = [math.gcd(row.denominator, *row.numerators.values()) for row in stencils]
    D = math.lcm(*(row.denominator // g for row, g in zip(stencils, shared, strict=True)))
    rows = []
    for row, g in zip(stencils, shared, strict=True):
        scale = D // (row.denominator // g)
        rows.append((tuple(row), [w // g * scale for w in row.numerators.values()]))
    return rows, D


def _apply(rows, columns):
    """Integer rows times integer columns: one column per channel, in and out."""
    return [
        [sum(map(operator.mul, weights, [x[i] for i in picked])) for picked, weights in rows]
        for x in columns
    ]


@functools.lru_cache(maxsize=CACHED)
def _step(local, child, mode):
    """Refine a neighbourhood and cut out that of child ``child`` of its target.

    Returns (the child's neighbourhood, integer rows from the old points to the new, their
    denominator).  Children of quads are turned so that u and v keep their directions; child k of
    an n-gon keeps its own, as limit face k.
    """
    n_vertices = 1 + max(map(max, local))
    forms = [(Stencil({v: Fraction(1)}),) for v in range(n_vertices)]
    fine, children = refine(forms, local, mode)
    target = children[child]  # the target face is face 0: its children come first
    if len(local[0]) == 4:
        target = target[-child:] + target[:-child]
    finer, vertices = _neighbourhood(children, _incidence(children)[2], target)
    return finer, *_integer_rows([fine[v][0] for v in vertices])


class _Corner(NamedTuple):
    """A corner of the target of a neighbourhood, by local vertex ids."""

    vertex: int
    interior: bool
    quads: bool  # all faces around it are quads
    ends: list  # of its edges, counter-clockwise; if interior, the target's next corner is first
    diagonals: list  # opposite vertices of its quads, the first between ends 0 and 1
    faces: int

    def regular(self, mode):
        if self.interior:
            return self.faces == 4
        return self.faces == 2 or (self.faces == 1 and mode == "edge_and_corner")


@functools.lru_cache(maxsize=CACHED)
def _corners(local):
    faces = [list(face) for face in local]
    vertex_faces = _incidence(faces)[2]
    corners = []
    for v in local[0]:
        fan, interior = _fan(faces, vertex_faces[v], v, 0)
        ends = [faces[f][(i + 1) % len(faces[f])] for f, i in fan]
        if not interior:
            f, i = fan[-1]
            ends.append(faces[f][i - 1])
        quads = all(len(faces[f]) == 4 for f, _ in fan)
        diagonals = [faces[f][(i + 2) % 4] for f, i in fan] if quads else []
        corners.append(_Corner(v, interior, quads, ends, diagonals, len(fan)))
    return corners


@functools.lru_cache(maxsize=CACHED)
def _control_grid(local, mode):
    """Control points {(a, b): Stencil}, a, b = -1 .. 2, if the target is a regular patch, or None.

    Beyond a boundary stand phantom points, reflections 2 P0 - P1: the patch then follows the
    boundary curve of [DKT], its second derivative across the boundary is zero, and it passes
    through a one-face corner.
    """
    if not all(c.quads and c.regular(mode) for c in _corners(local)):
        return None
    faces = [list(face) for face in local]
    vertex_faces = _incidence(faces)[2]
    grid = {}
    for k, v in enumerate(local[0]):
        (x, y), (nx, ny) = CORNERS[k], CORNERS[(k + 1) % 4]
        e = (nx - x, ny - y)  # lattice direction of the target's edge out of v
        fan = [f for f, _ in _fan(faces, vertex_faces[v], v, 0)[0]]
        for turns, f in enumerate(fan, start=-fan.index(0)):
            i = faces[f].index(v)
            p = e
            for _ in range(turns % 4):
                p = (-p[1], p[0])
            q = (-p[1], p[0])
            lattice = [(x, y), (x + p[0], y + p[1])]
            lattice += [(x + p[0] + q[0], y + p[1] + q[1]), (x + q[0], y + q[1])]
            for j, ab in enumerate(lattice):
                grid[ab] = Stencil({faces[f][(i + j) % 4]: Fraction(1)})
    real, ends = set(grid), ((-1, 0, 1), (2, 1, 0))  # beyond, at and before a boundary
    for (a, a0, a1), b in itertools.product(ends, (0, 1)):
        grid.setdefault((a, b), 2 * grid[a0, b] + -1 * grid[a1, b])
        grid.setdefault((b, a), 2 * grid[b, a0] + -1 * grid[b, a1])
    for (a, a0, a1), (b, b0, b1) in itertools.product(ends, ends):
        if (a0, b) in real:  # the boundary runs along v here, otherwise along u or both ways
            grid.setdefault((a, b), 2 * grid[a0, b] + -1 * grid[a1, b])
        else:
            grid.setdefault((a, b), 2 * grid[a, b0] + -1 * grid[a, b1])
    return grid


CUBICS = ((1, -3, 3, -1), (4, 0, -6, 3), (1, 3, 3, -3), (0, 0, 0, 1))  # of 1, t, t^2, t^3, times 6


def cubic_weights(t, order=0):
    """The four uniform cubic B-splines on [0, 1], or their derivatives, exactly."""
    numerators, D = _cubics(Fraction(t), order)
    return [Fraction(x, D) for x in numerators]


def _cubics(t, order):
    """`cubic_weights` as integers over a common denominator."""
    p, q = t.numerator, t.denominator
    powers = [
        math.perm(k, order) * p ** (k - order) * q ** (3 - k) if k >= order else 0 for k in range(4)
    ]
    return [sum(map(operator.mul, row, powers)) for row in CUBICS], 6 * q ** max(3 - order, 0)


def spline_form(grid, s, t, nu, level=0):
    """A derivative at (s, t) of the patch of a control grid, seen from ``level`` halvings above."""
    (wu, du), (wv, dv) = _cubics(s, nu[0]), _cubics(t, nu[1])
    scale = 2 ** (level * sum(nu))
    weights = [scale * wu[a + 1] * wv[b + 1] for a, b in grid]
    return Stencil.sum(weights, grid.values(), du * dv)


def _square(p, q, level):
    """Which of 2^level parts of [0, 1] holds p / q, the first of two, and q times where in it."""
    a = max(0, -((-p << level) // q) - 1)
    return a, (p << level) - a * q


def rational(x):
    """The exact value of an int, float, numpy scalar, Fraction or mpf, as a Fraction."""
    if isinstance(x, mpmath.mpf):
        p, q = mpmath.libmp.to_rational(x._mpf_)
        return Fraction(int(p), int(q))
    if isinstance(x, numbers.Rational):
        return Fraction(int(x.numerator), int(x.denominator))
    return Fraction(float(x)) if isinstance(x, (float, np.floating)) else Fraction(x)


class _Net(NamedTuple):
    """A neighbourhood with its points: integers by channel, over a common denominator."""

    local: tuple
    columns: list
    denominator: int
    trail: tuple | None  # (rows, denominator, the coarser net's trail) that made the points

    def child(self, k, mode):
        local, rows, D = _step(self.local, k, mode)
        trail = (rows, D, self.trail)
        return _Net(local, _apply(rows, self.columns), self.denominator * D, trail)

    def combined(self, stencil):
        """The values of a linear form, one Fraction per channel."""
        rows, D = _integer_rows([stencil])
        return tuple(Fraction(x, D * self.denominator) for (x,) in _apply(rows, self.columns))

    def pulled_back(self, stencil):
        """The same form on the points of the first net of the trail, {local vertex: Fraction}."""
        ((picked, weights),), denominator = _integer_rows([stencil])
        form, trail = dict(zip(picked, weights, strict=True)), self.trail
        while trail is not None:
            rows, D, trail = trail
            coarse = {}
            for i, w in form.items():
                for j, x in zip(*rows[i], strict=True):
                    coarse[j] = coarse.get(j, 0) + w * x
            form, denominator = coarse, denominator * D
        return {i: Fraction(w, denominator) for i, w in form.items() if w}


class ExactSurface:
    """The limit surface of a cage in exact rational arithmetic.

    Coordinates may be anything `rational` takes.  Queries take a limit face and u, v, any such
    numbers, and return Fractions.  The last irregular neighbourhood of each walk is remembered, so
    that many queries close to one extraordinary vertex share their descent.  Without points (None)
    only `weights` makes sense.
    """

    def __init__(self, points, faces, mode="edge_and_corner"):
        _check_mode(mode)
        self.points = points
        self.faces = [list(map(int, face)) for face in faces]
        self.mode = mode
        self.limit_faces = limit_faces(self.faces)
        self._vertex_faces = _incidence(self.faces)[2]
        self._visited = {}  # limit face -> {(level, column, row) of a dyadic square: its net}

    def _neighbourhood(self, limit_face):
        face, _ = self.limit_faces[limit_face]
        return _neighbourhood(self.faces, self._vertex_faces, self.faces[face])

    def _start(self, limit_face):
        """The net of a limit face."""
        local, vertices = self._neighbourhood(limit_face)
        columns = []
        if self.points is not None:
            columns = zip(*([rational(x) for x in self.points[v]] for v in vertices), strict=True)
            columns = [list(x) for x in columns]
        D = math.lcm(*(x.denominator for column in columns for x in column))
        net = _Net(local, [[int(x * D) for x in column] for column in columns], D, None)
        corner = self.limit_faces[limit_face][1]
        return net if corner == -1 else net.child(corner, self.mode)

    def _descend(self, limit_face, u, v):
        """(net, level, s, t, corner): the net that (u, v) ends in, at (s, t) of its target.

        ``corner`` is None for a regular patch; otherwise (u, v) sits on an irregular corner of the
        target, and it is the index of that corner.  On a line between two pieces the walk takes
        the one nearer the face's corner 0.
        """
        u, v = rational(u), rational(v)
        if not (0 <= u <= 1 and 0 <= v <= 1):
            raise ValueError(f"got (u, v) = ({u}, {v}), need both in [0, 1]")
        (pu, qu), (pv, qv) = u.as_integer_ratio(), v.as_integer_ratio()

        def square(level):
            return level, _square(pu, qu, level)[0], _square(pv, qv, level)[0]

        visited = self._visited.setdefault(limit_face, {})
        if not visited:
            visited[square(0)] = self._start(limit_face)
        deepest = max(key for key in visited if key == square(key[0]))
        net, level = visited[deepest], deepest[0]
        while True:
            (a, s), (b, t) = _square(pu, qu, level), _square(pv, qv, level)
            if _control_grid(net.local, self.mode) is not None:
                return net, level, Fraction(s, qu), Fraction(t, qv), None
            visited[level, a, b] = net
            if s in (0, qu) and t in (0, qv):
                r = CORNERS.index((s // qu, t // qv))
                corner = _corners(net.local)[r]
                if corner.quads and not corner.regular(self.mode):
                    return net, level, Fraction(s, qu), Fraction(t, qv), r
            if level - 1 > deepest[0]:
                del visited[square(level - 1)]
            net = net.child(CORNERS.index((int(2 * s > qu), int(2 * t > qv))), self.mode)
            level += 1

    def _stencil(self, net, level, s, t, r, nu):
        """The derivative ``nu`` as a linear form on the net's points; None stands for NaN."""
        if r is None:
            return spline_form(_control_grid(net.local, self.mode), s, t, nu, level)
        corner = _corners(net.local)[r]
        if any(nu):
            # First derivatives scale as (2 lambda)^n; lambda = 1/4 and 0.41 at valences 2 and 3.
            vanishes = corner.interior and corner.faces < 4 and sum(nu) == 1
            return Stencil({corner.vertex: Fraction(0)}) if vanishes else None
        if corner.interior:
            centre, edge, diagonal = limit_mask(corner.faces)
            terms = [(corner.vertex, centre), *((i, edge) for i in corner.ends)]
            terms += [(i, diagonal) for i in corner.diagonals]
        else:
            sides = corner.ends[0], corner.ends[-1]
            terms = [(corner.vertex, Fraction(4, 6)), *((i, Fraction(1, 6)) for i in sides)]
        # At valence 2 both faces may have the same diagonal.
        return functools.reduce(operator.add, (Stencil({i: w}) for i, w in terms))

    def evaluate(self, limit_face, u, v, nu=(0, 0)):
        """Position or derivative: Fractions, or NaN for a derivative at an irregular vertex.

        First derivatives are zero at interior vertices of valence 2 and 3.  At irregular boundary
        vertices NaN means that this oracle knows no derivative.
        """
        net, *where = self._descend(limit_face, u, v)
        stencil = self._stencil(net, *where, nu=nu)
        return (math.nan,) * len(net.columns) if stencil is None else net.combined(stencil)

    def weights(self, limit_face, u, v, nu=(0, 0)):
        """The same as a linear form on the cage, {vertex: Fraction}, or None in place of NaN."""
        net, *where = self._descend(limit_face, u, v)
        stencil = self._stencil(net, *where, nu=nu)
        if stencil is None:
            return None
        _, vertices = self._neighbourhood(limit_face)
        return {vertices[i]: w for i, w in net.pulled_back(stencil).items()}

    def tangents(self, limit_face, u, v, digits=50):
        """Unit directions of d/du and d/dv in mpf; their limits at an extraordinary vertex.

        NaN where a derivative vanishes or no limit is known: at irregular boundary vertices and at
        valence 2.
        """
        with mpmath.workdps(digits + 20):
            return tuple(_unit(x) for x in self._tangents(limit_face, u, v))

    def normal(self, limit_face, u, v, digits=50):
        """Unit normal d/du x d/dv at that very (u, v), in mpf; NaN as for `tangents`."""
        with mpmath.workdps(digits + 20):
            return _unit(_cross(*self._tangents(limit_face, u, v)))

    def _tangents(self, limit_face, u, v):
        """Vectors along d/du and d/dv, of any length: Fractions, at extraordinary vertices mpf."""
        net, _, s, t, r = self._descend(limit_face, u, v)
        if r is None:  # the level only scales them
            return tuple(
                net.combined(self._stencil(net, 0, s, t, None, nu)) for nu in ((1, 0), (0, 1))
            )
        corner = _corners(net.local)[r]
        if not corner.interior or corner.faces == 2:
            return ((mpmath.nan,) * len(net.columns),) * 2
        # Relative to the vertex, exactly, so that a cage far from the origin loses nothing.
        ring = [
            [[x[i] - x[corner.vertex] for x in net.columns] for i in ids]
            for ids in (corner.ends, corner.diagonals)
        ]
        even, odd = (
            [
                sum(
                    w * p[c]
                    for ws, ps in zip(mask, ring, strict=True)
                    for w, p in zip(ws, ps, strict=True)
                )
                for c in range(len(net.columns))
            ]
            for mask in tangent_masks(corner.faces)
        )
        turn = 2 * mpmath.pi / corner.faces
        ahead = even  # towards the target's next corner, and towards its previous one
        back = [mpmath.cos(turn) * a + mpmath.sin(turn) * b for a, b in zip(even, odd, strict=True)]
        minus_ahead, minus_back = ([-x for x in d] for d in (ahead, back))
        by_corner = [(ahead, back), (minus_back, ahead), (minus_ahead, minus_back)]
        return [*by_corner, (back, minus_ahead)][r]


def _to_mpf(x):
    return mpmath.mpf(x.numerator) / x.denominator if isinstance(x, Fraction) else mpmath.mpf(x)


def _cross(a, b):
    return [a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)]


def _unit(a):
    a = [_to_mpf(x) for x in a]
    length = mpmath.sqrt(sum(x * x for x in a))
    return tuple(x / length if length else mpmath.nan for x in a)


def exact_limit(points, faces, limit_face, u, v, nu=(0, 0), mode="edge_and_corner"):
    """Position or derivative ``nu``, a tuple of Fractions: see `ExactSurface.evaluate`."""
    return ExactSurface(points, faces, mode).evaluate(limit_face, u, v, nu)


def exact_weights(faces, limit_face, u, v, nu=(0, 0), mode="edge_and_corner"):
    """Weights on the cage's vertices, {vertex: Fraction}: see `ExactSurface.weights`."""
    return ExactSurface(None, faces, mode).weights(limit_face, u, v, nu)


def exact_tangents(points, faces, limit_face, u, v, digits=50, mode="edge_and_corner"):
    """Unit tangents along u and v, mpf: see `ExactSurface.tangents`."""
    return ExactSurface(points, faces, mode).tangents(limit_face, u, v, digits)


def exact_normal(points, faces, limit_face, u, v, digits=50, mode="edge_and_corner"):
    """Unit normal, mpf: see `ExactSurface.normal`."""
    return ExactSurface(points, faces, mode).normal(limit_face, u, v, digits)


# --- regular grids --------------------------------------------------------------------------------


def grid_faces(n, m, periodic=(False, False)):
    """Quads of an n x m grid of vertices i * m + j, in that order too; u along i, v along j."""
    rows, columns = n - (not periodic[0]), m - (not periodic[1])

    def vertex(i, j):
        return i % n * m + j % m

    return [
        [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)]
        for i in range(rows)
        for j in range(columns)
    ]


def bspline_oracle(grid, i, j, u, v, nu=(0, 0), periodic=(False, False)):
    """Scipy's bicubic B-spline over faces (i, j) of a grid of control points (n, m, ...).

    ``i, j, u, v`` are 1-d arrays; the result has shape (queries, ...).  Open ends are extended by
    reflection.  Each face uses its own polynomial, so that third derivatives at its ends are those
    from within.
    """
    grid = np.asarray(grid, dtype=float)
    for axis in (0, 1):
        P = np.moveaxis(grid, axis, 0)
        if periodic[axis]:
            P = np.concatenate([P[-1:], P, P[:2]])
        else:
            P = np.concatenate([2 * P[:1] - P[1:2], P, 2 * P[-1:] - P[-2:-1]])
        grid = np.moveaxis(P, 0, axis)
    cubic = BSpline(np.arange(-3.0, 5.0), np.eye(4), 3)  # its four splines on [0, 1]
    wu, wv = cubic(np.asarray(u, float), nu[0]), cubic(np.asarray(v, float), nu[1])  # (queries, 4)
    four = np.arange(4)
    i, j = (np.asarray(x)[:, None] + four for x in (i, j))
    patches = grid[i[:, :, None], j[:, None, :]]  # (queries, 4, 4, ...)
    return np.einsum("qa,qb,qab...->q...", wu, wv, patches)


# --- cages ----------------------------------------------------------------------------------------


def local_cage(N, seed=0, corner=0):
    """A random open cage around one extraordinary vertex of valence N >= 2: (points, faces).

    Vertex 0 is the extraordinary one; faces 0 .. N - 1 are the quads around it, counter-clockwise,
    and 3 N quads surround those, so that the limit over the N inner faces is that of any closed
    mesh that contains them.  Every other vertex is regular, also the boundary under
    "edge_and_corner".  Vertex 0 is corner ``corner`` of its faces.  Coordinates are Fractions over
    256, exact as floats.
    """
    rng = random.Random(f"{N} {seed}")
    ids = {}  # (sector, a, b) -> vertex; in sector i, a runs along edge i and b along edge i + 1

    def vertex(i, a, b):
        if a == b == 0:
            i = 0
        elif a == 0:
            i, a, b = i + 1, b, 0
        return ids.setdefault((i % N, a, b), len(ids))

    inner, outer = [], []
    vertex(0, 0, 0)
    for i in range(N):
        for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)):
            quad = [vertex(i, a + x, b + y) for x, y in CORNERS]
            (outer if a or b else inner).append(quad)
    faces = [quad[-corner:] + quad[:-corner] for quad in inner] + outer
    points = []
    for i, a, b in ids:
        angle = 2 * math.pi * (i + (b / (a + b) if b else 0)) / N
        radius = math.hypot(a, b)
        planar = (radius * math.cos(angle), radius * math.sin(angle), 0.0)
        points.append(tuple(Fraction(round(256 * x) + rng.randint(-96, 96), 256) for x in planar))
    return points, faces


class Case(NamedTuple):
    """Reference numbers on a cage whose ``face`` has its extraordinary vertex at ``corners[0]``."""

    valence: int
    points: np.ndarray  # (K, 3)
    faces: list
    face: int  # index of the target; its vertices are turned to `corners`
    corners: list
    uv: np.ndarray  # (Q, 2)
    kind: np.ndarray  # (Q,): 0 random, 1 dyadic, 2 close to the extraordinary vertex
    P: np.ndarray  # (Q, 3), as are the derivatives
    Pu: np.ndarray
    Pv: np.ndarray


def reference_cases(folder=CASES):
    """The Catmull-Clark cases of the folder, {valence: Case}, or None where there is no folder."""
    if not folder.is_dir():
        return None
    cases = {}
    for path in sorted(folder.glob("cc_N*.npz")):
        with np.load(path) as data:
            faces, face = data["faces"].tolist(), int(data["target_face"])
            corners = data["corners"].tolist()
            if sorted(faces[face]) != sorted(corners):
                raise ValueError(
                    f"{path.name}: face {face} is {faces[face]}, corners are {corners}"
                )
            faces[face] = corners
            numbers_ = (data[name] for name in ("uv", "kind", "P_true", "Pu_true", "Pv_true"))
            case = Case(int(data["N"]), data["verts"], faces, face, corners, *numbers_)
        cases[case.valence] = case
    return cases
