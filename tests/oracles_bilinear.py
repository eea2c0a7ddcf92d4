"""Independent oracles for schemes that only cut faces: bilinear on quads, linear on triangles.

The formulas are typed by hand, for Fractions. Whatever is sharp or on a boundary changes nothing:
OpenSubdiv has one mask for edges and one for vertices (``sdc/bilinearScheme.h``), and makes no
holes at boundaries (``far/topologyRefinerFactory.cpp``). Faces, parameters and new vertices are
numbered as in `oracles` and `oracles_loop`.
"""

import functools
import math
from fractions import Fraction


def mean(points):
    return tuple(sum(x) / Fraction(len(points)) for x in zip(*points, strict=True))


def total(terms):
    """The sum of points times factors."""
    return tuple(sum(f * x for f, x in zip(*column, strict=True)) for column in (
        ([f for f, _ in terms], xs) for xs in zip(*(p for _, p in terms), strict=True)
    ))  # fmt: skip


class Flat:
    """A cage whose faces are cut into pieces with weights of their corners; holes are NaN."""

    def __init__(self, cage, cut, weights):
        self.weights = weights
        self.pieces = []
        for f, face in enumerate(cage.faces):
            points = [cage.points[v] for v in face]
            self.pieces += [(f in cage.holes, piece) for piece in cut(points)]

    def evaluate(self, face, u, v, nu=(0, 0)):
        hole, points = self.pieces[face]
        if hole:
            return (math.nan,) * len(points[0])
        return total(list(zip(self.weights(Fraction(u), Fraction(v), nu), points, strict=True)))


def at_centre(p):
    """A polygon in quads, one at each corner; a quad as it is."""
    n = len(p)
    if n == 4:
        return [p]
    return [[p[k], mean([p[k], p[(k + 1) % n]]), mean(p), mean([p[k - 1], p[k]])] for k in range(n)]


def of_quad(u, v, nu):
    one = Fraction(1)
    return {
        (0, 0): [(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v],
        (1, 0): [v - 1, 1 - v, v, -v],
        (0, 1): [u - 1, -u, u, 1 - u],
        (1, 1): [one, -one, one, -one],
    }.get(nu, [0 * one] * 4)


def of_triangle(u, v, nu):
    one, zero = Fraction(1), Fraction(0)
    return {
        (0, 0): [1 - u - v, u, v],
        (1, 0): [-one, one, zero],
        (0, 1): [-one, zero, one],
    }.get(nu, [zero] * 3)


BilinearSurface = functools.partial(Flat, cut=at_centre, weights=of_quad)
LinearSurface = functools.partial(Flat, cut=lambda p: [p], weights=of_triangle)


def _with_edges(cage):
    """Points of vertices and edges, and the number of the point of each edge, by its ends."""
    pairs = sorted({tuple(sorted((f[i - 1], f[i]))) for f in cage.faces for i in range(len(f))})
    number = {pair: len(cage.points) + k for k, pair in enumerate(pairs)}
    points = [*cage.points, *(mean([cage.points[a], cage.points[b]]) for a, b in pairs)]
    sides = [
        [number[tuple(sorted((f[k], f[(k + 1) % len(f)])))] for k in range(len(f))]
        for f in cage.faces
    ]
    return points, sides


def refine_bilinear(cage):
    points, sides = _with_edges(cage)
    faces, holes, centre = [], set(), len(points)
    for f, (face, middle) in enumerate(zip(cage.faces, sides, strict=True)):
        points.append(mean([cage.points[v] for v in face]))
        for k, v in enumerate(face):
            holes |= {len(faces)} if f in cage.holes else set()
            faces.append([v, middle[k], centre + f, middle[k - 1]])
    return cage._replace(points=points, faces=faces, holes=holes)


def refine_linear(cage):
    points, sides = _with_edges(cage)
    faces = []
    for face, m in zip(cage.faces, sides, strict=True):
        faces += [[v, m[k], m[k - 1]] for k, v in enumerate(face)] + [[m[1], m[2], m[0]]]
    holes = {4 * f + k for f in cage.holes for k in range(4)}
    return cage._replace(points=points, faces=faces, holes=holes)
