"""An independent oracle for Doo and Sabin's limit surfaces: naive, exact, no code of `src`.

The mask is typed from the paper, and so is what lies beyond boundaries from its definition:

[DS]  Doo, Sabin, Behaviour of recursive division surfaces near extraordinary points, 1978: of an
      n-gon, the point at corner i has weights 1/4 + 5/(4 n) of that corner and
      (3 + 2 cos(2 pi (i - j) / n)) / (4 n) of corner j.

With w_0 .. w_(k-1) the points of a boundary vertex v in its faces, counter-clockwise, and c, d
Chaikin's points 3/4 v + 1/4 of its neighbours on the boundary edges of the first and last face, the
face of v is w_0 .. w_(k-1), g_(k-1) .. g_0 with g_j = 2 m_j - w_j and
m_j = (c + d)/2 + (c - d)/2 cos(pi (2 j + 1)/(2 k)) / cos(pi/(2 k)). Amid one face it is w, g_1, x,
g_0 with x = w under "edge_only", and 4 v - w - g_0 - g_1 otherwise. All later steps are ordinary.

A limit point is found by walking: a *star* is a point with the four faces around it, which are all
that determines the surface on the square between their middles. While one of them is no quad, the
star is refined and the walk goes on in the quarter that holds (u, v); then the nine points around
are those of a biquadratic B-spline.

Numbers are Fractions; cosines that are irrational are rounded to `BITS` binary digits, and so are
the points of every step.
"""

import functools
import itertools
import operator
from fractions import Fraction
from typing import NamedTuple

import mpmath

BITS = 1000
CUBE_VOLUME = Fraction(6241, 9920)  # inside the limit of the unit cube
SQUARE = ((0, 0), (1, 0), (1, 1), (0, 1))
DEEPEST = 1200


@functools.cache
def cosine(turns):
    """cos(2 pi turns) as a Fraction, rounded unless it is rational."""
    with mpmath.workprec(BITS + 20):
        x = mpmath.cospi(mpmath.mpf(2 * turns.numerator) / turns.denominator)
        if abs(2 * x - mpmath.nint(2 * x)) < mpmath.mpf(2) ** -BITS:
            return Fraction(int(mpmath.nint(2 * x)), 2)
        return Fraction(int(mpmath.nint(mpmath.ldexp(x, BITS))), 2**BITS)


@functools.cache
def mask(n):
    """[DS], from the corner itself on."""
    weights = [(3 + 2 * cosine(Fraction(j, n))) / (4 * n) for j in range(n)]
    weights[0] += Fraction(1, 4)
    return weights


def combined(weights, points):
    """A sum of points; rounded to `BITS` binary digits where there are more."""
    return combinations([weights], points)[0]


def combinations(rows, points):
    """Sums of the same points, one for each row of weights: all are rounded if any number is."""
    columns = list(zip(*points, strict=True))
    values = itertools.chain(*rows, *columns)
    if all(isinstance(x, int) or x.denominator.bit_length() <= BITS // 2 for x in values):
        return [tuple(sum(map(operator.mul, row, column)) for column in columns) for row in rows]
    columns = [list(map(whole, column)) for column in columns]
    found = []
    for row in rows:
        scaled = list(map(whole, row))
        sums = (sum(map(operator.mul, scaled, column)) for column in columns)
        found.append(tuple(Fraction(x >> BITS, 2**BITS) for x in sums))
    return found


def whole(x):
    """A number in units of 2^-BITS."""
    return (x.numerator << BITS) // x.denominator


def corner_points(face, places):
    """The new points at these corners of a face, a list of points."""
    weights = mask(len(face))
    return combinations([weights[-i:] + weights[:-i] for i in places], face)


# --- meshes ---------------------------------------------------------------------------------------


class Fan(NamedTuple):
    """Faces around a vertex, counter-clockwise: their corners (face, place), whether all around."""

    vertex: int
    corners: list
    closed: bool


def directed(faces):
    """{(a, b): (face, place)} of the half-edges that have exactly one of their kind."""
    found, seen = {}, {}
    for f, face in enumerate(faces):
        for k, a in enumerate(face):
            b = face[(k + 1) % len(face)]
            seen.setdefault(frozenset((a, b)), []).append((a, b))
            found[a, b] = f, k
    joined = {}
    for pairs in seen.values():
        if len(pairs) == 2 and pairs[0] == pairs[1][::-1]:
            joined |= {pair: found[pair] for pair in pairs}
    return joined


def fans_of(faces):
    """All fans, by vertex and first corner."""
    half = directed(faces)

    def left(corner):
        f, k = corner
        face = faces[f]
        return half.get((face[k], face[k - 1])) if (face[k - 1], face[k]) in half else None

    def right(corner):
        f, k = corner
        face = faces[f]
        pair = face[(k + 1) % len(face)], face[k]
        if pair not in half:
            return None
        g, m = half[pair]
        return g, (m + 1) % len(faces[g])

    found, done = [], set()
    for start in [(f, k) for f, face in enumerate(faces) for k in range(len(face))]:
        if start in done:
            continue
        first, closed = start, False
        while (before := right(first)) is not None:
            first = before
            if first == start:
                closed = True
                break
        corners = [first]
        while (after := left(corners[-1])) is not None and after != first:
            corners.append(after)
        done |= set(corners)
        found.append(Fan(faces[start[0]][start[1]], corners, closed))
    return sorted(found, key=lambda fan: (fan.vertex, fan.corners[0]))


def first_step(cage):
    """Points by corner (face, place), and what is beyond each boundary fan, by its number."""
    faces = [list(map(int, face)) for face in cage.faces]
    inner = {}
    for f, face in enumerate(faces):
        points = [cage.points[v] for v in face]
        inner |= {(f, k): x for k, x in enumerate(corner_points(points, range(len(face))))}
    beyond = {}
    for number, fan in enumerate(fans_of(faces)):
        if fan.closed or cage.boundary == "none":
            continue
        v, k = cage.points[fan.vertex], len(fan.corners)
        (f, i), (g, m) = fan.corners[0], fan.corners[-1]
        c, d = (
            combined([Fraction(3, 4), Fraction(1, 4)], [v, cage.points[w]])
            for w in (faces[f][(i + 1) % len(faces[f])], faces[g][m - 1])
        )
        w = [inner[corner] for corner in fan.corners]
        half = Fraction(1, 2)
        if k == 1:
            last, first = (combined([2, -1], [p, w[0]]) for p in (d, c))
            across = w[0]
            if cage.boundary == "edge_and_corner":
                across = combined([4, -1, -1, -1], [v, w[0], first, last])
            beyond[number] = [last, across, first]
            continue
        mirrored = []
        for j in range(k):
            r = cosine(Fraction(2 * j + 1, 4 * k)) / cosine(Fraction(1, 4 * k))
            m_j = combined([half + r / 2, half - r / 2], [c, d])
            mirrored.append(combined([2, -1], [m_j, w[j]]))
        beyond[number] = mirrored[::-1]
    return inner, beyond


def refine(cage):
    """One step: the points at corners, then those beyond; faces of faces, of edges, of vertices.

    The boundary of what comes out has no limit.
    """
    faces = [list(map(int, face)) for face in cage.faces]
    inner, beyond = first_step(cage)
    fans, half = fans_of(faces), directed(faces)
    number = {corner: k for k, corner in enumerate(inner)}
    points = list(inner.values())
    mirrors = {}
    for k, more in beyond.items():
        mirrors[k] = list(range(len(points), len(points) + len(more)))
        points += more
    first = {fan.corners[0]: k for k, fan in enumerate(fans)}
    last = {fan.corners[-1]: k for k, fan in enumerate(fans)}
    result = [[number[f, k] for k in range(len(face))] for f, face in enumerate(faces)]
    for f, face in enumerate(faces):
        for k, a in enumerate(face):
            after = (k + 1) % len(face)
            b = face[after]
            if (a, b) in half:
                g, m = half[b, a]
                if (g, m) > (f, k):
                    far = g, (m + 1) % len(faces[g])
                    result.append([number[f, k], number[far], number[g, m], number[f, after]])
            elif beyond:
                one, other = mirrors[first[f, k]][-1], mirrors[last[f, after]][0]
                result.append([number[f, k], one, other, number[f, after]])
    for k, fan in enumerate(fans):
        if fan.closed or beyond:
            result.append([number[c] for c in fan.corners] + mirrors.get(k, []))
    return cage._replace(points=points, faces=result, boundary="none", sides=None)


# --- limits ---------------------------------------------------------------------------------------


class Star(NamedTuple):
    """A point with the faces around it, counter-clockwise; each is a list of points from it on.

    The square between the middles of these faces has the first one's at its corner `turn` of the
    domain; it is at (x, y) there, of that size.
    """

    faces: list
    turn: int
    x: Fraction
    y: Fraction
    size: Fraction


def child(star, u, v):
    """The star of the quarter that holds (u, v); on lines that nearer (0, 0)."""
    half = star.size / 2
    right, up = u > star.x + half, v > star.y + half
    corner = SQUARE.index((int(right), int(up)))
    j = (corner - star.turn) % 4
    own, before, after = star.faces[j], star.faces[j - 1], star.faces[(j + 1) % 4]
    face = corner_points(own, range(len(own)))
    along = [face[0], *corner_points(before, [0, len(before) - 1]), face[1]]
    beside, next_to_it = corner_points(after, [0, 1])
    back = [face[0], face[-1], next_to_it, beside]
    (opposite,) = corner_points(star.faces[(j + 2) % 4], [0])
    vertex = [face[0], beside, opposite, along[1]]
    # the middle of the star is its corner 0, the corner of the star its corner 2
    return Star([vertex, along, face, back], (corner + 2) % 4,
                star.x + half * right, star.y + half * up, half)  # fmt: skip


def spline(x, order):
    """Weights of a quadratic B-spline in x, or of its derivative."""
    return {
        0: [(1 - x) ** 2 / 2, Fraction(1, 2) + x * (1 - x), x * x / 2],
        1: [x - 1, 1 - 2 * x, x],
        2: [1, -2, 1],
    }.get(order, [0, 0, 0])


class DooSabinSurface:
    """Limits of a cage at (limit face, u, v), numbered and oriented as for Catmull and Clark."""

    def __init__(self, cage):
        self.faces = [list(map(int, face)) for face in cage.faces]
        self.cage, self.fans, self.half = cage, fans_of(self.faces), directed(self.faces)
        self.inner, self.beyond = first_step(cage)
        self.walked = {}  # stars that were met, by the one that they are of and where they are
        self.fan = {corner: k for k, fan in enumerate(self.fans) for corner in fan.corners}
        self.limit_faces = []
        for f, face in enumerate(self.faces):
            whole = len(face) == 4
            self.limit_faces += [
                (f, None if whole else k) for k in range(1 if whole else len(face))
            ]

    def star(self, f, k):
        """That of a point of the first step."""
        face = self.faces[f]
        fan = self.fans[self.fan[f, k]]
        around = [self.inner[c] for c in fan.corners] + self.beyond.get(self.fan[f, k], [])
        at = fan.corners.index((f, k))
        vertex = around[at:] + around[:at]
        own = [self.inner[f, (k + j) % len(face)] for j in range(len(face))]
        sides = []
        for place, start in ((k, 0), ((k - 1) % len(face), 1)):
            after = (place + 1) % len(face)
            a, b = face[place], face[after]
            if (a, b) in self.half:
                g, m = self.half[b, a]
                far = self.inner[g, (m + 1) % len(self.faces[g])], self.inner[g, m]
            else:
                far = (self.beyond[self.fan[f, place]][-1], self.beyond[self.fan[f, after]][0])
            quad = [self.inner[f, place], *far, self.inner[f, after]]
            sides.append(quad if start == 0 else quad[3:] + quad[:3])
        return vertex, sides[0], own, sides[1]

    def evaluate(self, limit_face, u, v, nu=(0, 0)):
        """A position or derivative; NaN without a limit, and for derivatives at vertices."""
        u, v = Fraction(u), Fraction(v)
        f, k = self.limit_faces[limit_face]
        nothing = [float("nan")] * len(self.cage.points[0])
        if f in self.cage.holes:
            return nothing
        x, y, size, turn = Fraction(0), Fraction(0), Fraction(1), 0
        if k is None:
            size /= 2
            right, up = u > size, v > size
            k = turn = SQUARE.index((int(right), int(up)))
            x, y = size * right, size * up
        if self.cage.boundary == "none" and not self.fans[self.fan[f, k]].closed:
            return nothing
        star = self.walked.setdefault((f, k, turn), Star(list(self.star(f, k)), turn, x, y, size))
        for _ in range(DEEPEST):
            if all(len(face) == 4 for face in star.faces):
                return self._regular(star, u, v, nu)
            s, t = (u - star.x) / star.size, (v - star.y) / star.size
            if (s, t) in SQUARE:
                face = star.faces[(SQUARE.index((s, t)) - star.turn) % 4]
                if len(face) != 4:
                    mean = combined([Fraction(1, len(face))] * len(face), face)
                    return nothing if any(nu) else mean
            place = f, k, star.x, star.y, star.size, u > star.x + star.size / 2
            place = *place, v > star.y + star.size / 2
            if place not in self.walked:
                self.walked[place] = child(star, u, v)
            star = self.walked[place]
        raise ValueError("too near a vertex")

    @staticmethod
    def _regular(star, u, v, nu):
        lower_left, lower_right, upper_right, upper_left = (
            star.faces[(k - star.turn) % 4] for k in range(4)
        )
        grid = [
            [lower_left[2], lower_left[3], lower_right[2]],
            [lower_left[1], lower_left[0], lower_right[3]],
            [upper_left[2], upper_right[3], upper_right[2]],
        ]
        along, across = (
            spline((x - start) / star.size, order)
            for x, start, order in ((u, star.x, nu[0]), (v, star.y, nu[1]))
        )
        scale = 1 / star.size ** sum(nu)
        weights = [a * b * scale for b in across for a in along]
        return combined(weights, [p for row in grid for p in row])
