"""Independent oracles for Loop's limit surfaces: naive, exact, sharing no code with `src`.

As in `oracles_creases`, whose cages, sharpness and walk are used here: the rules are typed by hand
from papers, a limit point is found by walking into the child that holds (u, v) until that is an
ordinary patch, here one of the quartic box spline, and no eigenvector of a face's matrix is known.

Numbers are Fractions.  Loop's weights of 1987 are rational at the valences 1, 2, 3, 4 and 6;
elsewhere the cosine in them is rounded to ``bits`` binary digits, and so are the points of every
step that such a weight has a part in, as fractions of one: results are then as if computed with
that many digits after the point.  Derivatives at 2^-n from a vertex want about 3 n of them.
(`refine` by itself takes float64 points, too.)

Triangles have corner 0 at (u, v) = (0, 0), corner 1 at (1, 0), corner 2 at (0, 1).  One step makes
four of each, in this order: child k = 0, 1, 2 is (corner k, midpoint of the next edge, midpoint of
the previous edge), child 3 in the middle has the midpoints opposite to the corners 0, 1, 2: its own
parameters are (1 - 2 u, 1 - 2 v).  New vertices: those of the vertices, then of the edges,
ascending pairs in lexicographic order.

References
----------
[L]   Loop, Smooth subdivision surfaces based on triangles, thesis, University of Utah 1987
[HDW] Hoppe, DeRose, Duchamp, Halstead, Jin, McDonald, Schweitzer, Stuetzle, Piecewise smooth
      surface reconstruction, SIGGRAPH 1994
[W]   Warren, Weimer, Subdivision methods for geometric design, Morgan Kaufmann 2001
[S]   Stam, Evaluation of Loop subdivision surfaces, SIGGRAPH 1998 course notes (CD), 1999
"""

import functools
import itertools
import math
from collections import Counter
from fractions import Fraction
from typing import NamedTuple

import mpmath
from oracles import (
    CASES,
    Stencil,
    _apply,
    _combine,
    _cross,
    _edge,
    _integer_rows,
    _Net,
    _unit,
    rational,
)
from oracles_creases import (
    _blend,
    _corners,
    _cut_out,
    _incidence,
    _other,
    _solve,
    blended_vertex_point,
    crease_share,
    decayed,
    start,
)

CORNERS = ((0, 0), (1, 0), (0, 1))  # (u, v) of a triangle's corners
BITS = 600

# Volume inside the surface of the tetrahedron of edge 1 is this over the root of 2: Hakenberg,
# Reif, Schaefer, Warren, Volume enclosed by subdivision surfaces, viXra:1405.0012.
TETRAHEDRON_VOLUME = Fraction(44192429513855101, 6865302375425894400)


# --- masks ----------------------------------------------------------------------------------------


@functools.cache
def cosine(n, f=1, bits=BITS):
    """cos(2 pi f / n) as a Fraction, rounded to ``bits`` digits unless it is rational."""
    with mpmath.workprec(bits + 20):
        x = mpmath.cospi(mpmath.mpf(2 * f) / n)
        if x * 2 == mpmath.nint(x * 2):  # Niven: no others are rational
            return Fraction(int(x * 2), 2)
        return Fraction(int(mpmath.nint(mpmath.ldexp(x, bits))), 2**bits)


@functools.cache
def loop_weight(n, bits=BITS):
    """[L]: weight of each of n neighbours in the point of an interior vertex."""
    return (Fraction(5, 8) - (Fraction(3, 8) + cosine(n, 1, bits) / 4) ** 2) / n


def warren_weight(n, bits=BITS):
    """[W]: 3/16 for three neighbours, 3/(8 n) for any other number."""
    return Fraction(3, 16) if n == 3 else Fraction(3, 8 * n)


def limit_mask(n, weight=loop_weight, bits=BITS):
    """Limit of an interior vertex, (vertex, each neighbour): [L]."""
    each = 1 / (Fraction(3, 8) / weight(n, bits) + n)
    return 1 - n * each, each


def tangent_masks(n):
    """Two tangents of an interior vertex, in mpf: weights of the neighbours, counter-clockwise.

    The first points along edge 0; the cross product is the normal: [HDW].
    """
    turn = mpmath.mpf(2) / n
    return [mpmath.cospi(turn * i) for i in range(n)], [mpmath.sinpi(turn * i) for i in range(n)]


def dart_mask(n, weight=loop_weight, bits=BITS):
    """Limit of a dart: n + 1 weights, of the vertex and its neighbours, first along the crease.

    The left eigenvector of eigenvalue 1 of what `refine` does there.
    """
    each = weight(n, bits)
    rows = [[1 - n * each] + [each] * n]
    for i in range(n):
        row = [Fraction(3, 8)] + [Fraction(0)] * n
        row[1 + i] += Fraction(3, 8)
        row[1 + (i + 1) % n] += Fraction(1, 8)
        row[1 + (i - 1) % n] += Fraction(1, 8)
        rows.append(row)
    rows[1] = [Fraction(1, 2), Fraction(1, 2)] + [Fraction(0)] * (n - 1)
    columns = [[row[j] - (i == j) for i, row in enumerate(rows)] for j in range(n + 1)]
    # The equations add up to zero.  One makes way for the sum of the weights.
    columns[-1] = [Fraction(1)] * (n + 1)
    return _solve(columns, [Fraction(0)] * n + [Fraction(1)])


# --- one step of the rules ------------------------------------------------------------------------


def refine(cage, weight=loop_weight, bits=BITS):
    """One step: an explicit `Cage`, numbered as the head of this file says.

    Smooth edges 3/8 3/8 1/8 1/8, smooth vertices and darts by ``weight``, [L]; sharp edges 1/2 1/2,
    creases 1/8 3/4 1/8, corners stay, [HDW]; sharpness as in `oracles_creases`.
    """
    if any(len(face) != 3 for face in cage.faces):
        raise ValueError("a face is no triangle")
    cage = start(cage)
    points, faces = cage.points, cage.faces
    edge_faces, vertex_edges, _ = _incidence(faces, cage.sides)
    halves, vertices = decayed(cage, vertex_edges)

    def edge_point(edge):
        share, ends = crease_share(cage, edge, halves), [points[v] for v in edge[:2]]
        crease = _combine([(1, p) for p in ends], 2)
        if share == 1:
            return crease
        around = edge_faces[edge]  # one on the rim of a cut-out, where the point is not used
        across = [faces[f][(cage.sides[f].index(edge) + 2) % 3] for f in around]
        terms = [(3, p) for p in ends] + [(1, points[v]) for v in across]
        return _blend(share, crease, _combine(terms, 6 + len(across)))

    def vertex_point(v, rule, sharp):
        """The point of v by a rule, the crease running along the two edges ``sharp``."""
        if rule == "corner":
            return points[v]
        if rule == "crease":
            return _combine([(6, points[v]), *((1, points[_other(e, v)]) for e in sharp)], 8)
        n = len(vertex_edges[v])
        each = weight(n, bits)
        terms = [(each, points[_other(edge, v)]) for edge in vertex_edges[v]]
        return _combine([(1 - n * each, points[v]), *terms], 1)

    vertex_points = [
        blended_vertex_point(cage, v, vertex_edges[v], halves, vertices, vertex_point)
        for v in range(len(points))
    ]
    edge_id = {edge: len(points) + e for e, edge in enumerate(edge_faces)}
    creases, children, sides, inner = {}, [], [], Counter()

    def half(edge, v, last):
        """The new edge at the end v of an edge; if that has v twice, at its last or first end."""
        new = (v, edge_id[edge], 1) if last and edge[0] == edge[1] else (v, edge_id[edge])
        creases[new] = halves[edge, v]
        return new

    def across(a, b):
        """A new edge inside a face; two faces of the same vertices have each its own."""
        pair = _edge(a, b)
        new = (*pair, inner[pair]) if inner[pair] else pair
        inner[pair] += 1
        creases[new] = Fraction(0)
        return new

    for face, edges in zip(faces, cage.sides, strict=True):
        middle = [edge_id[edge] for edge in edges]
        cuts = [across(middle[k], middle[k - 1]) for k in range(3)]
        for k, v in enumerate(face):
            children.append([v, middle[k], middle[k - 1]])
            sides.append([half(edges[k], v, False), cuts[k], half(edges[k - 1], v, True)])
        children.append([middle[1], middle[2], middle[0]])
        sides.append([cuts[2], cuts[0], cuts[1]])
    new_points = vertex_points + [edge_point(edge) for edge in edge_faces]
    new_corners = vertices | dict.fromkeys(range(len(points), len(new_points)), Fraction(0))
    return cage._replace(
        points=new_points,
        faces=children,
        creases=creases,
        corners=new_corners,
        holes={4 * f + k for f in cage.holes for k in range(4)},
        sides=sides,
    )


def refine_times(cage, levels, weight=loop_weight, bits=BITS):
    """`refine`, ``levels`` times."""
    cage = start(cage)
    for _ in range(levels):
        cage = refine(cage, weight, bits)
    return cage


def refined_parameters(n_faces, levels):
    """(face, (u, v) of its three corners) for each face refined ``levels`` times."""
    result = [(f, [tuple(map(Fraction, corner)) for corner in CORNERS]) for f in range(n_faces)]
    for _ in range(levels):
        finer = []
        for f, p in result:
            m = [tuple((x + y) / 2 for x, y in zip(p[k], p[k - 2], strict=True)) for k in range(3)]
            finer += [(f, [p[k], m[k], m[k - 1]]) for k in range(3)] + [(f, [m[1], m[2], m[0]])]
        result = finer
    return result


# --- the regular patch ----------------------------------------------------------------------------

# Control points of the triangle (0, 0), (1, 0), (0, 1) on the lattice where a vertex (a, b) has the
# neighbours (a + x, b + y), counter-clockwise:
STEPS = ((1, 0), (0, 1), (-1, 1), (-1, 0), (0, -1), (1, -1))

# The quartic box spline by barycentric coordinates: {exponents: coefficient}, over 12; [S].
_CORNER = {(4, 0, 0): 6, (3, 1, 0): 24, (3, 0, 1): 24, (2, 2, 0): 24, (2, 1, 1): 60, (2, 0, 2): 24}
_CORNER |= {(1, 3, 0): 8, (1, 2, 1): 36, (1, 1, 2): 36, (1, 0, 3): 8}
_CORNER |= {(0, 4, 0): 1, (0, 3, 1): 6, (0, 2, 2): 12, (0, 1, 3): 6, (0, 0, 4): 1}
_ACROSS = {(4, 0, 0): 1, (3, 1, 0): 6, (2, 2, 0): 12, (1, 3, 0): 6, (0, 4, 0): 1}  # the third edge
_ACROSS |= {(3, 0, 1): 2, (2, 1, 1): 6, (1, 2, 1): 6, (0, 3, 1): 2}
_OUTER = {(4, 0, 0): 1, (3, 1, 0): 2}  # beyond the first corner, on the side of the second


def _controls():
    """{place: (polynomial, which of the coordinates is its first, second, third)}."""
    controls = {}
    for k in range(3):
        x, y = CORNERS[k]
        # Of the neighbours of corner k, 2 k and 2 k + 1 on are the target's other corners.
        step = [(x + STEPS[2 * k + j - 6][0], y + STEPS[2 * k + j - 6][1]) for j in range(6)]
        after, before = (k + 1) % 3, (k + 2) % 3
        controls[x, y] = _CORNER, (k, after, before)
        controls[step[5]] = _ACROSS, (k, after, before)
        controls[step[4]] = _OUTER, (k, after, before)
        controls[step[3]] = _OUTER, (k, before, after)
    return controls


CONTROLS = _controls()


@functools.cache
def box_spline_polynomials(nu=(0, 0)):
    """{place: {(i, j): coefficient of u^i v^j}}: a derivative of the weight of each control point.

    The barycentric coordinates are 1 - u - v, u, v.
    """
    polynomials = {}
    for place, (form, order) in CONTROLS.items():
        total = Counter()
        for exponents, coefficient in form.items():
            power = dict(zip(order, exponents, strict=True))
            n = power[0]
            for i in range(n + 1):  # (1 - u - v)^n
                for j in range(n + 1 - i):
                    multinomial = math.comb(n, i) * math.comb(n - i, j)
                    sign = (-1) ** (i + j)
                    total[power[1] + i, power[2] + j] += sign * multinomial * coefficient
        polynomials[place] = {
            (i - nu[0], j - nu[1]): Fraction(c * math.perm(i, nu[0]) * math.perm(j, nu[1]), 12)
            for (i, j), c in total.items()
            if c and i >= nu[0] and j >= nu[1]
        }
    return polynomials


def box_spline_weights(u, v, nu=(0, 0)):
    """{place: weight} of the twelve control points of a regular triangle, or a derivative."""
    return {
        place: sum((c * u**i * v**j for (i, j), c in p.items()), Fraction(0))
        for place, p in box_spline_polynomials(nu).items()
    }


# --- the limit by descent -------------------------------------------------------------------------


def _regular(corner):
    if corner.rule == "crease":  # else the other edge of the crease is elsewhere
        shaped = not corner.closed and not corner.looped and len(corner.sector) == 3
    else:
        shaped = corner.rule == "smooth" and len(corner.sector) == 6
    return corner.settled and shaped


@functools.lru_cache(maxsize=4096)
def _control_net(local):
    """Control points {place: Stencil} if the target is a regular patch, or None.

    Beyond a sharp edge stand phantom points, a + b - c for its triangle (a, b, c).
    """
    corners = _corners(local)
    if not all(map(_regular, corners)):
        return None
    points = {v: Stencil({v: Fraction(1)}) for v in range(len(local.corners))}
    net = {}
    for k, corner in enumerate(corners):
        sector = corner.sector
        before = next(i for i, (f, j) in enumerate(sector) if (f, j) == (0, k))
        ring = [points[local.faces[f][(i + 1) % 3]] for f, i in sector]
        if corner.rule == "crease":
            f, i = sector[-1]
            ring.append(points[local.faces[f][i - 1]])
            here = points[corner.vertex]
            ring += [here + ring[3] + -1 * ring[2], here + ring[0] + -1 * ring[1]]
        x, y = CORNERS[k]
        net[x, y] = points[corner.vertex]
        for j, point in enumerate(ring):
            a, b = STEPS[(2 * k + j - before) % 6]
            net.setdefault((x + a, y + b), point)
    return net


@functools.lru_cache(maxsize=4096)
def _step(local, child, weight, bits):
    """Refine a neighbourhood and cut out that of child ``child`` of its target.

    Returns (the child's neighbourhood, integer rows from the old points to the new, their
    denominator).  Children 0, 1, 2 are turned so that u and v keep their directions.
    """
    forms = [(Stencil({v: Fraction(1)}),) for v in range(len(local.corners))]
    fine = refine(local.cage(forms), weight, bits)
    vertex_faces = _incidence(fine.faces, fine.sides)[2]
    finer, vertices = _cut_out(fine, vertex_faces, child, -child % 3)
    return finer, *_integer_rows([fine.points[v][0] for v in vertices])


def child_of(u, v, flipped):
    """The child that holds (u, v), on lines between children that nearer the face's corner 0.

    ``flipped`` says that corner 0 is on the side of larger u and v, as it is in middle children.
    """
    if flipped:
        return 0 if 2 * (u + v) < 1 else 1 if 2 * u >= 1 else 2 if 2 * v >= 1 else 3
    return 0 if 2 * (u + v) <= 1 else 1 if 2 * u > 1 else 2 if 2 * v > 1 else 3


def in_child(u, v, child):
    """The parameters (u, v) of a triangle as those of its child."""
    if child == 3:
        return 1 - 2 * u, 1 - 2 * v
    x, y = CORNERS[child]
    return 2 * u - x, 2 * v - y


class _End(NamedTuple):
    """Where a walk ends: a net, its scale, parameters there, an irregular corner or None."""

    net: _Net
    scale: int  # of the net's parameters, as derivatives of the face's; negative if turned
    u: Fraction
    v: Fraction
    corner: int | None


class LoopSurface:
    """The limit surface of a tagged cage of triangles, in Fractions.

    Queries take a face and u, v, any numbers that `rational` takes; they return Fractions, or NaN
    on a hole.  On a line between two pieces of the surface, values are those of the piece nearer
    the face's corner 0, and at infinitely sharp edges those of the queried face.  Without points
    (None) only `weights` makes sense.
    """

    def __init__(self, cage, weight=loop_weight, bits=BITS):
        n = 1 + max(v for face in cage.faces for v in face)
        self.cage = start(cage if cage.points is not None else cage._replace(points=[()] * n))
        self.weight, self.bits = weight, bits
        self._vertex_faces = _incidence(self.cage.faces, self.cage.sides)[2]
        self._paths = {}  # face -> the nets of its last walk, each after the child it is

    def _start(self, face):
        local, vertices = _cut_out(self.cage, self._vertex_faces, face)
        columns = zip(*([rational(x) for x in self.cage.points[v]] for v in vertices), strict=True)
        columns = [list(x) for x in columns]
        D = math.lcm(*(x.denominator for column in columns for x in column))
        return _Net(local, [[int(x * D) for x in column] for column in columns], D, None)

    def _child(self, net, k):
        local, rows, D = _step(net.local, k, self.weight, self.bits)
        columns, denominator = _apply(rows, net.columns), net.denominator * D
        if D.bit_length() > self.bits:  # a rounded weight has a part in it
            columns = [[(x << self.bits) // denominator for x in column] for column in columns]
            denominator = 1 << self.bits
        return _Net(local, columns, denominator, (rows, D, net.trail))

    def _descend(self, face, u, v):
        """The `_End` of the walk towards (u, v)."""
        u, v = rational(u), rational(v)
        if not (u >= 0 and v >= 0 and u + v <= 1):
            raise ValueError(f"got (u, v) = ({u}, {v}), need u, v >= 0 and u + v <= 1")
        path = self._paths.setdefault(face, [])
        if not path:
            path.append((None, self._start(face)))
        scale = 1
        for level in itertools.count():
            net = path[level][1]
            if _control_net(net.local) is not None:
                return _End(net, scale, u, v, None)
            if (u, v) in CORNERS:
                r = CORNERS.index((u, v))
                corner = _corners(net.local)[r]
                if corner.settled and not _regular(corner):
                    return _End(net, scale, u, v, r)
            k = child_of(u, v, scale < 0)
            if level + 1 < len(path) and path[level + 1][0] != k:
                del path[level + 1 :]
            if level + 1 == len(path):
                path.append((k, self._child(net, k)))
            u, v = in_child(u, v, k)
            scale *= -2 if k == 3 else 2

    def _vertex_limit(self, local, r):
        """The limit of corner r of the target, as a linear form; it is settled."""
        corner = _corners(local)[r]
        ring, weights = [corner.vertex], [Fraction(1)]
        if corner.rule == "crease":
            ring, weights = ring + corner.sharp, [Fraction(4, 6), Fraction(1, 6), Fraction(1, 6)]
        elif corner.rule in ("smooth", "dart"):
            n = len(corner.sector)  # a dart's sector begins and ends at its sharp edge
            ring += [local.faces[f][(i + 1) % 3] for f, i in corner.sector]
            if corner.rule == "dart":
                weights = dart_mask(n, self.weight, self.bits)
            else:
                centre, each = limit_mask(n, self.weight, self.bits)
                weights = [centre] + [each] * n
        form = Stencil()
        for v, w in zip(ring, weights, strict=True):  # at valence 2 neighbours may be one
            form = form + Stencil({v: w})
        return form

    def _form(self, end, nu):
        """The derivative ``nu`` as a linear form on the last net's points, or None if not known."""
        if end.corner is not None:
            return None if any(nu) else self._vertex_limit(end.net.local, end.corner)
        form, scale = Stencil(), Fraction(end.scale) ** sum(nu)
        net = _control_net(end.net.local)
        for place, w in box_spline_weights(end.u, end.v, nu).items():
            form = form + (scale * w) * net[place]
        return form

    def evaluate(self, face, u, v, nu=(0, 0)):
        """Position or derivative: Fractions, or NaN.

        NaN on holes, and for derivatives at vertices that are not regular on the queried side:
        this oracle knows none there.
        """
        end = self._descend(face, u, v)
        form = self._form(end, nu)
        if form is None or face in self.cage.holes:
            return (math.nan,) * len(end.net.columns)
        return end.net.combined(form)

    def weights(self, face, u, v, nu=(0, 0)):
        """The same as a linear form on the cage, {vertex: Fraction}, or None in place of NaN."""
        end = self._descend(face, u, v)
        form = self._form(end, nu)
        if form is None or face in self.cage.holes:
            return None
        _, vertices = _cut_out(self.cage, self._vertex_faces, face)
        return {vertices[i]: w for i, w in end.net.pulled_back(form).items()}

    def normal(self, face, u, v, digits=50):
        """Unit normal d/du x d/dv at that very (u, v), in mpf, or its limit at a smooth vertex.

        NaN on holes, and at irregular vertices on sharp edges or of valence 2.
        """
        end = self._descend(face, u, v)
        with mpmath.workdps(digits + 20):
            if face in self.cage.holes:
                return (mpmath.nan,) * 3
            if end.corner is None:
                return _unit(_cross(*(self.evaluate(face, u, v, nu) for nu in ((1, 0), (0, 1)))))
            corner = _corners(end.net.local)[end.corner]
            n = len(corner.sector)
            if corner.rule != "smooth" or n == 2:
                return (mpmath.nan,) * 3
            ring = [end.net.local.faces[f][(i + 1) % 3] for f, i in corner.sector]
            tangents = [
                [
                    sum(w * (x[i] - x[corner.vertex]) for w, i in zip(mask, ring, strict=True))
                    for x in end.net.columns
                ]
                for mask in tangent_masks(n)
            ]
            return _unit(_cross(*tangents))


def reference_cases(folder=CASES):
    """The Loop cases of the folder, {valence: arrays by name}, or None where there is no folder.

    ``faces`` is a list whose target has been turned to begin at the extraordinary vertex.
    """
    import numpy as np

    if not folder.is_dir():
        return None
    cases = {}
    for path in sorted(folder.glob("loop_N*.npz")):
        with np.load(path) as data:
            case = {name: data[name] for name in data}
        faces, target = case["faces"].tolist(), int(case["target_face"])
        if sorted(faces[target]) != sorted(case["corners"].tolist()):
            raise ValueError(f"{path.name}: face {target} does not have the corners")
        faces[target] = case["corners"].tolist()
        cases[int(case["N"])] = case | {"faces": faces, "target_face": target}
    return cases
