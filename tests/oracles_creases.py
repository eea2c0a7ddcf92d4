"""Independent oracles for tagged Catmull-Clark cages: naive, exact, sharing no code with `src`.

Creases and corners of any sharpness, darts, holes, all boundary modes, both creasing methods, the
smooth triangle rule, non-manifold edges and vertices.  As in `oracles`, whose conventions hold
here too: the rules are typed by hand, sharpness and weights are Fractions, and a limit point is
found by walking into the children that hold (u, v) until one of them is an ordinary bicubic patch.

A sharpness of 10 and more is infinite, here always `INF`.  Rules of [DKT], except these, which are
conventions of OpenSubdiv: the blend between the rules before and after a sharpness has run out,
the sharpness of non-manifold edges and vertices, the weights of the smooth triangle rule, and
holes.  Chaikin creasing is that of [DKT] for two edges of a crease, with the mean of all others
where more of them meet.

References
----------
[CC]  Catmull, Clark, Recursively generated B-spline surfaces on arbitrary topological meshes,
      Computer-Aided Design 10 (1978)
[HKD] Halstead, Kass, DeRose, Efficient, fair interpolation using Catmull-Clark surfaces,
      SIGGRAPH 1993
[DKT] DeRose, Kass, Truong, Subdivision surfaces in character animation, SIGGRAPH 1998
"""

import functools
import itertools
import math
from collections import Counter, defaultdict
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from fractions import Fraction
from types import MappingProxyType
from typing import NamedTuple

import mpmath
from oracles import (
    CACHED,
    CORNERS,
    Stencil,
    _apply,
    _combine,
    _cross,
    _edge,
    _exact_integers,
    _integer_rows,
    _sides,
    _square,
    _unit,
    limit_faces,
    limit_mask,
    rational,
    spline_form,
)
from oracles import _Net as _PlainNet

INF = math.inf
BOUNDARIES = ("none", "edge_only", "edge_and_corner")
CREASINGS = ("uniform", "chaikin")
TRIANGLES = ("catmull-clark", "smooth")
NOTHING: Mapping = MappingProxyType({})


class Cage(NamedTuple):
    """A tagged mesh; points are tuples of any number type, or linear forms.

    ``sides`` marks a cage that is explicit, as it leaves `start` and `refine`: ``creases`` then
    holds every edge and ``corners`` every vertex, with the sharpness that boundaries and
    non-manifold parts have been given, ``holes`` all faces without a limit, and ``sides`` the edges
    of every face.  An edge is an ascending pair; where a face runs along a pair twice, or from a
    vertex to itself, there are further edges (a, b, 1), (a, b, 2), ... of that pair.
    """

    points: list
    faces: list
    creases: Mapping = NOTHING
    corners: Mapping = NOTHING
    holes: Collection = frozenset()
    boundary: str = "edge_and_corner"
    creasing: str = "uniform"
    triangles: str = "catmull-clark"
    sides: list | None = None


# --- what happens once, on the cage itself --------------------------------------------------------


def start(cage):
    """The cage with its sharpness made explicit; one that is explicit already comes back as is."""
    if cage.sides is not None:
        return cage
    _check(cage)
    faces = [list(map(int, face)) for face in cage.faces]
    sides, repeated = _find_edges(faces)
    creases = dict.fromkeys(sorted(set(itertools.chain(*sides))), Fraction(0))
    corners = dict.fromkeys(range(len(cage.points)), Fraction(0))
    size = len(creases), len(corners)
    creases |= {_edge(a, b): _sharpness(s) for (a, b), s in cage.creases.items()}
    corners |= {v: _sharpness(s) for v, s in cage.corners.items()}
    if (len(creases), len(corners)) != size:
        raise ValueError("a crease is no edge, or a corner no vertex")
    edge_faces, vertex_edges, vertex_faces = _incidence(faces, sides)
    lone = {edge for edge, around in edge_faces.items() if len(around) == 1}

    holes = set(cage.holes)
    if cage.boundary == "none":
        rim = {v for edge in lone if creases[edge] < INF for v in edge[:2]}
        holes |= {f for f, face in enumerate(faces) if rim & set(face)}

    starts = itertools.chain(*(zip(*pair, strict=True) for pair in zip(sides, faces, strict=True)))
    runs = Counter(starts).items()
    twisted = {edge for (edge, _), n in runs if n > 1}  # so are all edges of more than two faces
    wild = repeated | twisted
    creases |= dict.fromkeys(wild | lone, INF)

    for v in corners:
        edges, around = vertex_edges[v], vertex_faces[v]
        n_wild, n_lone = len(wild & set(edges)), len(lone & set(edges))
        passed = n_wild == 2 and n_lone == 0 and len(around) > len(edges)  # by a crease with fins
        wild_vertex = n_wild > 0 or _count_fans(v, around, faces, sides) != 1
        cut = cage.boundary == "edge_and_corner" and (len(around), len(edges)) == (1, 2)
        if cut or (wild_vertex and not passed):
            corners[v] = INF
    points = _exact_integers(cage.points)
    return cage._replace(
        points=points, faces=faces, creases=creases, corners=corners, holes=holes, sides=sides
    )


def _find_edges(faces):
    """The edges of every face, and those of a pair that has more than one or is a vertex twice."""
    sides, n_edges, repeated = [], Counter(), set()
    for face in faces:
        sides.append([])
        for a, b in itertools.starmap(_edge, _sides(face)):
            edge, again = (a, b), a == b or (a, b) in sides[-1]
            if n_edges[a, b] == 0 or again:
                edge = (a, b, n_edges[a, b]) if n_edges[a, b] else (a, b)
                n_edges[a, b] += 1
            if again:
                repeated |= {(a, b), edge}
            sides[-1].append(edge)
    return sides, repeated


def _incidence(faces, sides):
    """Dicts edge -> faces, in sorted order, vertex -> edges, vertex -> faces."""
    edge_faces, vertex_edges, vertex_faces = defaultdict(list), defaultdict(list), defaultdict(list)
    for f, (face, edges) in enumerate(zip(faces, sides, strict=True)):
        for v, edge in zip(face, edges, strict=True):
            edge_faces[edge].append(f)
            vertex_faces[v].append(f)
    edge_faces = {edge: edge_faces[edge] for edge in sorted(edge_faces)}
    for edge in edge_faces:
        for v in edge[:2]:
            vertex_edges[v].append(edge)
    return edge_faces, vertex_edges, vertex_faces


def _check(cage):
    known = {"boundary": BOUNDARIES, "creasing": CREASINGS, "triangles": TRIANGLES}
    for name, values in known.items():
        if getattr(cage, name) not in values:
            raise ValueError(f"got {name} {getattr(cage, name)!r}, need one of {values}")


def _sharpness(s):
    """Zero, a Fraction below 10, or infinity."""
    if not s >= 0:
        raise ValueError(f"got sharpness {s}, need one in [0, inf]")
    return INF if s >= 10 else rational(s)


def _count_fans(v, around, faces, sides):
    """How many pieces the corners of faces at a vertex make, joined across the edges at it."""
    fans = []
    for f in sorted(set(around)):
        for i, w in enumerate(faces[f]):
            if w == v:
                place = {sides[f][i], sides[f][i - 1]}
                apart = [fan for fan in fans if not fan & place]
                fans = [*apart, place.union(*(fan for fan in fans if fan & place))]
    return len(fans)


# --- sharpness, whatever the scheme ---------------------------------------------------------------


def decayed(cage, vertex_edges):
    """What is left after a step: of the half of an edge at its end v, {(edge, v)}; of {v}."""

    def left(edge, v):
        s = cage.creases[edge]
        if s == 0 or s == INF:
            return s
        if cage.creasing == "chaikin":
            around = [cage.creases[e] for e in vertex_edges[v] if e != edge]
            others = [other for other in around if 0 < other < INF]
            if others:
                s = Fraction(3, 4) * s + Fraction(1, 4) * (sum(others) / len(others))
        return max(s - 1, Fraction(0))

    halves = {(edge, v): left(edge, v) for edge in cage.creases for v in edge[:2]}
    vertices = {v: s if s == INF else max(s - 1, Fraction(0)) for v, s in cage.corners.items()}
    return halves, vertices


def crease_share(cage, edge, halves):
    """How much of the sharp mask is in an edge's point; the rest is the smooth one's."""
    s = cage.creases[edge]
    lasting = s > 0 and all(halves[edge, v] > 0 for v in edge[:2])
    return Fraction(1) if s >= 1 or lasting else s


def blended_vertex_point(cage, v, edges, halves, vertices, vertex_point):
    """The point of v by its rules before and after the step.

    ``vertex_point(v, rule, sharp)`` gives it by one of them, the crease running along the two edges
    ``sharp``; ``edges`` are those at v.
    """
    before = [edge for edge in edges if cage.creases[edge] > 0]
    after = [edge for edge in before if halves[edge, v] > 0]
    sharpness = cage.corners[v]
    parent, child = vertex_rule(sharpness, len(before)), vertex_rule(vertices[v], len(after))
    point = vertex_point(v, parent, before)
    if parent == child:
        return point
    vanished = [cage.creases[edge] for edge in before if edge not in after]
    if sharpness > 0 and vertices[v] == 0:
        vanished.append(sharpness)
    w = min(sum(vanished) / len(vanished), 1)
    return _blend(w, point, vertex_point(v, child, after))


def vertex_rule(sharpness, n_sharp_edges):
    """The rule of a vertex: [DKT], appendix A."""
    if sharpness > 0 or n_sharp_edges > 2:
        return "corner"
    return ("smooth", "dart", "crease")[n_sharp_edges]


# --- one step of the rules ------------------------------------------------------------------------


def refine(cage):
    """One step: an explicit `Cage`, with vertices and faces in the order of `oracles.refine`."""
    cage = start(cage)
    points, faces = cage.points, cage.faces
    edge_faces, vertex_edges, vertex_faces = _incidence(faces, cage.sides)

    halves, vertices = decayed(cage, vertex_edges)
    face_points = [_combine([(1, points[v]) for v in face], len(face)) for face in faces]

    def edge_point(edge):
        share = crease_share(cage, edge, halves)
        ends, sides = [points[v] for v in edge[:2]], edge_faces[edge]
        crease = _combine([(1, p) for p in ends], 2)
        if share == 1:
            return crease
        # Two sides wherever this counts: an edge of another number is sharp, except on the rim of
        # a cut-out, where the point is not used.
        around = ends + [face_points[f] for f in sides]
        smooth = _combine([(1, p) for p in around], len(around))
        if cage.triangles == "smooth" and any(len(faces[f]) == 3 for f in sides):
            heavy = [Fraction(47, 100) if len(faces[f]) == 3 else Fraction(1, 4) for f in sides]
            w = sum(heavy) / len(sides)
            terms = [(Fraction(1, 2) - w, p) for p in ends]
            smooth = _combine(terms + [(w, face_points[f]) for f in sides], 1)
        return _blend(share, crease, smooth)

    def vertex_point(v, rule, sharp):
        """The point of v by a rule, the crease running along the two edges ``sharp``."""
        S = points[v]
        if rule == "corner":
            return S
        if rule == "crease":
            return _combine([(6, S), *((1, points[_other(edge, v)]) for edge in sharp)], 8)
        edges, n = vertex_edges[v], len(vertex_faces[v])
        Q = _combine([(1, face_points[f]) for f in vertex_faces[v]], n)
        midpoints = [_combine([(1, S), (1, points[_other(edge, v)])], 2) for edge in edges]
        R = _combine([(1, m) for m in midpoints], len(edges))
        return _combine([(1, Q), (2, R), (n - 3, S)], n)

    vertex_points = [
        blended_vertex_point(cage, v, vertex_edges[v], halves, vertices, vertex_point)
        for v in range(len(points))
    ]
    edge_points = [edge_point(edge) for edge in edge_faces]

    edge_id = {edge: len(points) + e for e, edge in enumerate(edge_faces)}
    new_creases, children, sides = {}, [], []

    def half(edge, v, last):
        """The new edge at the end v of an edge; if that has v twice, at its last or first end."""
        new = (v, edge_id[edge], 1) if last and edge[0] == edge[1] else (v, edge_id[edge])
        new_creases[new] = halves[edge, v]
        return new

    for f, (face, edges) in enumerate(zip(faces, cage.sides, strict=True)):
        middle = [edge_id[edge] for edge in edges]
        centre = len(points) + len(edge_faces) + f
        new_creases |= dict.fromkeys(((m, centre) for m in middle), Fraction(0))
        for k, v in enumerate(face):
            children.append([v, middle[k], centre, middle[k - 1]])
            inner = (middle[k], centre), (middle[k - 1], centre)
            sides.append([half(edges[k], v, False), *inner, half(edges[k - 1], v, True)])
    first = list(itertools.accumulate(map(len, faces), initial=0))
    new_points = vertex_points + edge_points + face_points
    new_corners = vertices | dict.fromkeys(range(len(points), len(new_points)), Fraction(0))
    return cage._replace(
        points=new_points,
        faces=children,
        creases=new_creases,
        corners=new_corners,
        holes={c for f in cage.holes for c in range(first[f], first[f + 1])},
        sides=sides,
    )


def refine_times(cage, levels):
    """`refine`, ``levels`` times."""
    cage = start(cage)
    for _ in range(levels):
        cage = refine(cage)
    return cage


def _other(edge, v):
    a, b = edge[:2]
    return a if b == v else b


def _blend(w, p, q):
    """w p + (1 - w) q."""
    return q if w == 0 else p if w == 1 else _combine([(w, p), (1 - w, q)], 1)


# --- neighbourhoods -------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Local:
    """A face, the target, with the faces and the sharpness around it, in local numbers.

    Equal ones are the same object, as `_local` makes them, which is quickly found in a cache.
    """

    faces: tuple  # the target first, begun where it is to begin
    sides: tuple  # the edges of the faces
    creases: tuple  # (edge, sharpness) for every edge
    corners: tuple  # sharpness by vertex
    rules: tuple  # creasing, triangles

    def cage(self, points):
        """The explicit cage that it is; without a name for boundaries, all of that being done."""
        creases, corners = dict(self.creases), dict(enumerate(self.corners))
        creasing, triangles = self.rules
        return Cage(
            points, self.faces, creases, corners, frozenset(), "", creasing, triangles, self.sides
        )


_local = functools.lru_cache(maxsize=CACHED)(_Local)


def _cut_out(cage, vertex_faces, f, turn=0):
    """(`_Local`, vertices by local number) of face f of an explicit cage, begun at corner ``turn``.

    One ring of faces holds all masks and, as sharpness only decays, all that "uniform" asks for.
    Under "chaikin" the sharpness at the far end of an edge at the target counts as well.  Faces on
    the rim have lost neighbours: their rules are wrong, and never used.  The numbers follow from
    the shape alone, so that equal neighbourhoods come out equal.
    """
    ids, taken = {}, []

    def take(g, i):
        taken.append((g, i))
        for v in cage.faces[g][i:] + cage.faces[g][:i]:
            ids.setdefault(v, len(ids))

    def numbers(g):
        return sorted(ids.get(w, INF) for w in cage.faces[g])

    def local_edge(edge):
        return *sorted((ids[edge[0]], ids[edge[1]])), *edge[2:]

    take(f, turn)
    for _ in range(1 if cage.creasing == "uniform" else 2):
        for v in list(ids):
            rest = set(vertex_faces[v]) - {g for g, _ in taken}
            while rest:
                rest.remove(g := min(rest, key=lambda g: (numbers(g), g)))
                take(g, cage.faces[g].index(v))
    faces = tuple(tuple(ids[v] for v in cage.faces[g][i:] + cage.faces[g][:i]) for g, i in taken)
    sides = tuple(tuple(map(local_edge, cage.sides[g][i:] + cage.sides[g][:i])) for g, i in taken)
    edges = dict.fromkeys(edge for g, _ in taken for edge in cage.sides[g])
    creases = tuple((local_edge(edge), cage.creases[edge]) for edge in edges)
    corners = tuple(cage.corners[v] for v in ids)
    return _local(faces, sides, creases, corners, (cage.creasing, cage.triangles)), list(ids)


@functools.lru_cache(maxsize=CACHED)
def _step(local, child):
    """Refine a neighbourhood and cut out that of child ``child`` of its target.

    Returns (the child's neighbourhood, integer rows from the old points to the new, their
    denominator).  Children of quads are turned so that u and v keep their directions; child k of
    an n-gon keeps its own, as limit face k.
    """
    fine = refine(local.cage([(Stencil({v: Fraction(1)}),) for v in range(len(local.corners))]))
    vertex_faces = _incidence(fine.faces, fine.sides)[2]
    turn = -child % 4 if len(local.faces[0]) == 4 else 0
    finer, vertices = _cut_out(fine, vertex_faces, child, turn)  # children of the target come first
    return finer, *_integer_rows([fine.points[v][0] for v in vertices])


class _Corner(NamedTuple):
    """A corner of the target; its sector is the faces up to the infinitely sharp edges."""

    vertex: int
    rule: str
    settled: bool  # no sharpness is still to run out
    quads: bool  # the sector has no other faces
    sector: list  # (face, position of the vertex), counter-clockwise
    closed: bool  # the sector goes all the way round; it then begins at the target
    looped: bool  # it begins and ends at one edge
    sharp: list  # the other ends of the sharp edges

    @property
    def regular(self):
        if self.rule == "crease" and self.looped:  # the other edge of the crease is elsewhere
            return False
        shape = (self.rule, self.closed, len(self.sector))
        regular = [("smooth", True, 4), ("crease", False, 2), ("corner", False, 1)]
        return self.settled and self.quads and shape in regular


@functools.lru_cache(maxsize=CACHED)
def _corners(local):
    creases, faces, sides = dict(local.creases), local.faces, local.sides
    edge_faces = _incidence(faces, sides)[0]

    def neighbour(place, turn):
        """The next place in the sector, counter-clockwise (turn -1) or clockwise (0), or None.

        An edge that is not infinitely sharp has two faces, one along each direction.
        """
        f, i = place
        edge = sides[f][i + turn]
        if creases[edge] == INF:
            return None
        (g,) = set(edge_faces[edge]) - {f}
        return g, (sides[g].index(edge) + turn + 1) % len(faces[g])

    corners = []
    for k, v in enumerate(faces[0]):
        sector = [(0, k)]
        while (place := neighbour(sector[-1], -1)) not in (sector[0], None):
            sector.append(place)
        closed = place is not None
        while not closed and (place := neighbour(sector[0], 0)) is not None:
            sector.insert(0, place)
        at = [(_other(edge, v), s) for edge, s in creases.items() if v in edge[:2]]
        sharp = [w for w, s in at if s > 0]
        settled = all(s in (0, INF) for s in (local.corners[v], *(s for _, s in at)))
        rule = vertex_rule(local.corners[v], len(sharp))
        quads = all(len(faces[f]) == 4 for f, _ in sector)
        (first, i), (last, j) = sector[0], sector[-1]
        looped = sides[first][i] == sides[last][j - 1]
        corners.append(_Corner(v, rule, settled, quads, sector, closed, looped, sharp))
    return corners


@functools.lru_cache(maxsize=CACHED)
def _control_grid(local):
    """Control points {(a, b): Stencil}, a, b = -1 .. 2, if the target is a regular patch, or None.

    Beyond an infinitely sharp edge stand phantom points, reflections 2 on - inner.
    """
    corners, creases = _corners(local), dict(local.creases)
    if not all(corner.regular for corner in corners):
        return None
    grid = {}
    for k, corner in enumerate(corners):
        (x, y), (nx, ny) = CORNERS[k], CORNERS[(k + 1) % 4]
        before = corner.sector.index((0, k))
        for turns, (f, i) in enumerate(corner.sector, start=-before):
            dx, dy = nx - x, ny - y  # along the target's edge out of the vertex, then turned
            for _ in range(turns % 4):
                dx, dy = -dy, dx
            places = [(x, y), (x + dx, y + dy), (x + dx - dy, y + dy + dx), (x - dy, y + dx)]
            for j, place in enumerate(places):
                grid[place] = Stencil({local.faces[f][(i + j) % 4]: Fraction(1)})
    lines = [(1, -1, 0, 1), (0, 2, 1, 0), (1, 2, 1, 0), (0, -1, 0, 1)]  # axis; beyond, on, within
    sharp = [line for line, e in zip(lines, local.sides[0], strict=True) if creases[e] == INF]
    # The corners of the grid last: their reflections may be of phantom points.
    for along, (axis, *line) in itertools.product(((0, 1), (-1, 2)), sharp):
        for c in along:
            beyond, on, within = ((c, x) if axis else (x, c) for x in line)
            grid.setdefault(beyond, 2 * grid[on] + -1 * grid[within])
    return grid


# --- limits at vertices ---------------------------------------------------------------------------


@functools.lru_cache(maxsize=256)
def ring_limit(n, sharp=frozenset()):
    """Limit of a vertex among n quads whose edges ``sharp``, out of 0 .. n - 1, are infinitely so.

    Returns 2 n + 1 Fractions, for the vertex, the ends of its edges, and the diagonals of its
    quads, the first between edges 0 and 1: the left eigenvector of eigenvalue 1 of the matrix that
    `refine` is on these points.
    """
    size, ends = 2 * n + 1, range(1, n + 1)
    faces = [[0, ends[i], n + 1 + i, ends[(i + 1) % n]] for i in range(n)]
    sides, _ = _find_edges(faces)
    edges = list(_incidence(faces, sides)[0])
    creases = dict.fromkeys(edges, 0) | {(0, ends[i]): INF for i in sharp}
    corners = dict.fromkeys(range(size), 0)
    forms = [(Stencil({v: Fraction(1)}),) for v in range(size)]
    fine = refine(Cage(forms, faces, creases, corners, sides=sides)).points
    ring = [0, *(size + edges.index((0, end)) for end in ends)]
    ring += range(size + len(edges), len(fine))
    columns = [[fine[i][0].get(v, Fraction(0)) for i in ring] for v in range(size)]
    for v, column in enumerate(columns):
        column[v] -= 1
    # The equations add up to zero.  One makes way for the sum of the weights.
    columns[-1] = [Fraction(1)] * size
    return _solve(columns, [Fraction(0)] * (size - 1) + [Fraction(1)])


def _solve(matrix, right):
    """The solution of a regular linear system, by Gauss and Jordan."""
    rows = [[*row, x] for row, x in zip(matrix, right, strict=True)]
    for k in range(len(rows)):
        p = next(i for i in range(k, len(rows)) if rows[i][k])
        rows[k], rows[p] = rows[p], rows[k]
        rows[k] = [x / rows[k][k] for x in rows[k]]
        for i, row in enumerate(rows):
            if i != k and row[k]:
                rows[i] = [x - row[k] * y if y else x for x, y in zip(row, rows[k], strict=True)]
    return [row[-1] for row in rows]


def _vertex_limit(local, r):
    """The limit of corner r of the target, as a linear form; it is settled."""
    corner = _corners(local)[r]
    ring, weights = [corner.vertex], [Fraction(1)]
    if corner.rule == "crease":
        ring, weights = ring + corner.sharp, [Fraction(4, 6), Fraction(1, 6), Fraction(1, 6)]
    elif corner.rule in ("smooth", "dart"):
        n = len(corner.sector)  # a dart's sector begins and ends at its sharp edge
        ring += [local.faces[f][(i + j) % 4] for j in (1, 2) for f, i in corner.sector]
        centre, edge, diagonal = limit_mask(n)
        weights = [centre] + [edge] * n + [diagonal] * n
        if corner.rule == "dart":
            weights = ring_limit(n, frozenset([0]))
    form = Stencil()
    for v, w in zip(ring, weights, strict=True):  # at valence 2, for one, two diagonals may be one
        form = form + Stencil({v: w})
    return form


# --- the exact limit by descent -------------------------------------------------------------------


class _Net(_PlainNet):
    """A neighbourhood with its points, ``local`` being a `_Local`."""

    def child(self, k):
        local, rows, D = _step(self.local, k)
        return _Net(local, _apply(rows, self.columns), self.denominator * D, (rows, D, self.trail))


class TaggedSurface:
    """The limit surface of a tagged cage in exact rational arithmetic.

    Queries take a limit face and u, v, any numbers that `rational` takes; they return Fractions, or
    NaN on a hole.  On a line between two pieces of the surface, the values are those of the piece
    nearer the face's corner 0, and at infinitely sharp edges those of the queried face.  Without
    points (None) only `weights` makes sense.
    """

    def __init__(self, cage):
        n = 1 + max(v for face in cage.faces for v in face)
        self.cage = start(cage if cage.points is not None else cage._replace(points=[()] * n))
        self.limit_faces = limit_faces(self.cage.faces)
        self._vertex_faces = _incidence(self.cage.faces, self.cage.sides)[2]
        self._paths = {}  # limit face -> the nets of its last walk, each with its dyadic square

    def _cut_out(self, limit_face):
        return _cut_out(self.cage, self._vertex_faces, self.limit_faces[limit_face][0])

    def _start(self, limit_face):
        """The net of a limit face."""
        local, vertices = self._cut_out(limit_face)
        columns = zip(*([rational(x) for x in self.cage.points[v]] for v in vertices), strict=True)
        columns = [list(x) for x in columns]
        D = math.lcm(*(x.denominator for column in columns for x in column))
        net = _Net(local, [[int(x * D) for x in column] for column in columns], D, None)
        corner = self.limit_faces[limit_face][1]
        return net if corner == -1 else net.child(corner)

    def _descend(self, limit_face, u, v):
        """(net, level, s, t, corner): the net that (u, v) ends in, at (s, t) of its target.

        ``corner`` is None for a regular patch; otherwise (u, v) sits on that corner of the target,
        and the limit there is known.
        """
        u, v = rational(u), rational(v)
        if not (0 <= u <= 1 and 0 <= v <= 1):
            raise ValueError(f"got (u, v) = ({u}, {v}), need both in [0, 1]")
        (pu, qu), (pv, qv) = u.as_integer_ratio(), v.as_integer_ratio()
        if limit_face not in self._paths:
            self._paths[limit_face] = [((0, 0), self._start(limit_face))]
        path = self._paths[limit_face]
        for level in itertools.count():
            (a, s), (b, t) = _square(pu, qu, level), _square(pv, qv, level)
            square = a, b
            if level < len(path) and path[level][0] != square:
                del path[level:]
            if level == len(path):
                path.append((square, path[-1][1].child(CORNERS.index((a % 2, b % 2)))))
            net = path[level][1]
            if _control_grid(net.local) is not None:
                return net, level, Fraction(s, qu), Fraction(t, qv), None
            if s in (0, qu) and t in (0, qv):
                r = CORNERS.index((s // qu, t // qv))
                corner = _corners(net.local)[r]
                known = corner.settled and (corner.quads or corner.rule in ("crease", "corner"))
                if known and not corner.regular:
                    return net, level, Fraction(s, qu), Fraction(t, qv), r

    def _stencil(self, limit_face, u, v, nu):
        """(net, the derivative ``nu`` as a linear form on its points, or None if not known)."""
        net, level, s, t, r = self._descend(limit_face, u, v)
        if r is not None:
            return net, None if any(nu) else _vertex_limit(net.local, r)
        return net, spline_form(_control_grid(net.local), s, t, nu, level)

    def evaluate(self, limit_face, u, v, nu=(0, 0)):
        """Position or derivative: Fractions, or NaN.

        NaN on holes, and for derivatives at vertices that are not regular on the queried side:
        this oracle knows none there.
        """
        net, form = self._stencil(limit_face, u, v, nu)
        if form is None or self.limit_faces[limit_face][0] in self.cage.holes:
            return (math.nan,) * len(net.columns)
        return net.combined(form)

    def weights(self, limit_face, u, v, nu=(0, 0)):
        """The same as a linear form on the cage, {vertex: Fraction}, or None in place of NaN."""
        net, form = self._stencil(limit_face, u, v, nu)
        if form is None or self.limit_faces[limit_face][0] in self.cage.holes:
            return None
        _, vertices = self._cut_out(limit_face)
        return {vertices[i]: w for i, w in net.pulled_back(form).items()}

    def normal(self, limit_face, u, v, digits=50):
        """Unit normal d/du x d/dv at that very (u, v), in mpf; NaN where `evaluate` gives NaN."""
        tangents = [self.evaluate(limit_face, u, v, nu) for nu in ((1, 0), (0, 1))]
        with mpmath.workdps(digits + 20):
            return _unit(_cross(*tangents))
