"""Lattices: how the regular faces of a scheme lie together, and how one step splits them.

A lattice is the plane of integer *places* ``(i, j)``, points counted along u and v, with the faces
between them. The face that is looked at has its corner 0 at (1, 1), with u and v along (1, 0) and
(0, 1), so that no place around it is negative. Refined places count points at half the distance,
again with corner 0 at (1, 1): the refined place of ``(i, j)`` is ``(2 i - 1, 2 j - 1)``.

::

    quads                               triangles

    (0,2)---(1,2)---(2,2)               (0,2)---(1,2)---(2,2)
      |       |       |                      /    \\  /    \
      |       |  face |                     /      \\/ face \
    (0,1)---(1,1)---(2,1)               (0,1)---(1,1)---(2,1)

Numbers in and out of a domain's maps may be of any type, arrays included.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from limitsurf.caching import cached_property

Place = tuple[int, int]


@dataclass(frozen=True)
class Child:
    """One of the faces that a step makes of a face: ``(u, v) = (origin +- (s, t)) / ratio``.

    Attributes
    ----------
    origin : (int, int)
        Refined place of its corner 0, from that of the face.
    turned : bool
        Whether it is turned by half a turn, as the middle one of a triangle.
    """

    origin: Place
    turned: bool = False

    def place(self, near: Place) -> Place:
        """Refined place of what is at some place near the child, whose corner 0 is at (1, 1)."""
        (i, j), (x, y) = near, self.origin
        return (x + 2 - i, y + 2 - j) if self.turned else (x + i, y + j)


@dataclass(frozen=True, eq=False)
class Lattice:
    """The regular faces of a scheme, and what one step makes of them.

    Attributes
    ----------
    name : str
        What the faces are called.
    corners : tuple of places
        Corners of the domain, counter-clockwise, corner 0 at (0, 0).
    cells : tuple of tuples of places
        The faces of which translates fill the plane, the domain first.
    star : tuple of places
        The points around a point, counter-clockwise, from that along u on: those of one face, in
        the order of `orbits`, then those of the next.
    orbits : tuple of int
        The points that each face brings to the ring of a vertex: their angle from the middle of
        that face, in halves of the angle between two edges. Edge neighbours come first.
    children : tuple of Child
        The faces that a step makes of one: those at its corners, in their order, then others.
    face_points : bool
        Whether a step makes points of faces, which then stand for a face in the points of its
        edges and vertices; otherwise that is what lies across an edge, and nothing at vertices.
    reflection : tuple of (int, place)
        The point beyond a smooth edge along u as a sum of points on and inside it: what continues
        the spline there. Places are relative to the point's own.
    dual : bool
        Whether points belong to faces, not to vertices: each face has one, which is at its place,
        and a step makes one for each of its children, at the corners of the face. The `star` are
        then the faces around a vertex, from the face itself on.
    ratio : int
        How many times smaller a step makes edges.
    """

    name: str
    corners: tuple[Place, ...]
    cells: tuple[tuple[Place, ...], ...]
    star: tuple[Place, ...]
    orbits: tuple[int, ...]
    children: tuple[Child, ...]
    face_points: bool
    reflection: tuple[tuple[int, Place], ...]
    dual: bool = False
    ratio: int = 2

    def __reduce__(self) -> str:
        # there is one of each: a pickle holds its name in this module
        return self.name.upper()

    def __repr__(self) -> str:
        return f"<lattice of {self.name}>"

    @property
    def face_size(self) -> int:
        """Corners of a regular face."""
        return len(self.corners)

    @property
    def valence(self) -> int:
        """Faces around a regular vertex."""
        return len(self.star) // len(self.orbits)

    # ---------------------------------------------------------------- the domain

    @cached_property
    def turns(self) -> tuple[tuple[Place, Place, Place], ...]:
        """(origin, along s, along t) of the domain as seen from each of its corners.

        ``(u, v) = origin + s * along_s + t * along_t``: s towards the next corner, t towards the
        one before. Derivatives turn by the same matrix.
        """
        n = len(self.corners)
        frames = []
        for k, (x, y) in enumerate(self.corners):
            (a, b), (c, d) = self.corners[(k + 1) % n], self.corners[k - 1]
            frames.append(((x, y), (a - x, b - y), (c - x, d - y)))
        return tuple(frames)

    @cached_property
    def edges(self) -> tuple[tuple[int, int, int], ...]:
        """(a, b, c) of each edge, from corner k to the next: ``a + b u + c v >= 0`` inside."""
        # the area between the edge and what is told of
        return tuple((x * q - y * p, -q, p) for (x, y), (p, q), _ in self.turns)

    @cached_property
    def sides(self) -> tuple[tuple[int, int, int], ...]:
        """(a, b, c) of the coordinates: as seen from corner k, s is number k and t the next."""
        return self.edges[-1:] + self.edges[:-1]

    @cached_property
    def sloped(self) -> bool:
        """Whether u and v end where u + v is 1, not each by itself."""
        return any(b and c for _, b, c in self.sides)

    @cached_property
    def flips(self) -> bool:
        """Whether there are children that are turned by half a turn."""
        return any(child.turned for child in self.children)

    @cached_property
    def gradients(self) -> tuple[tuple[Place, Place], ...]:
        """Gradients in (u, v) of s and of t, by orientation.

        Orientations are the turns, then, if there are `flips`, these on faces turned by half a
        turn: what is at corner k there has orientation ``k + face_size``.
        """
        n = len(self.sides)
        gradients = [(b, c) for _, b, c in self.sides]
        turns = [(gradients[k], gradients[(k + 1) % n]) for k in range(n)]
        flipped = [((-a, -b), (-c, -d)) for (a, b), (c, d) in turns if self.flips]
        return (*turns, *flipped)

    @cached_property
    def against(self) -> tuple[tuple[bool, bool, bool], ...]:
        """Whether s, t and s + t grow towards corner 0 of the domain, by orientation."""
        return tuple((a + b < 0, c + d < 0, a + b + c + d < 0) for (a, b), (c, d) in self.gradients)

    def turned(self, nu: Place) -> dict[Place, tuple[int, ...]]:
        """A derivative in (u, v) as a sum of those in (s, t): their factors by orientation.

        Where no two derivatives mix, as in quads, one factor of each orientation is not 0.
        """
        return _turned(self.gradients, nu)

    @cached_property
    def parts(self) -> tuple[int, ...]:
        """Numbers of the children as parts of a face: in quads ``i + 2 j`` by place."""
        every = range(len(self.children))
        if self.flips:
            return tuple(every)
        return tuple(i + self.ratio * j for i, j in (child.origin for child in self.children))

    def extrapolated(self, place: Place) -> tuple[int, ...]:
        """Weights of the corners in the (bi)linear surface through them, by place from corner 0."""
        u, v = place
        if self.sloped:
            return 1 - u - v, u, v
        return (1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v

    # ---------------------------------------------------------------- places

    @cached_property
    def template(self) -> tuple[Place, ...]:
        """Places of all points of the faces that touch the face, by j, then i."""
        if self.dual:
            return tuple((i, j) for j in range(3) for i in range(3))
        face = {(i + 1, j + 1) for i, j in self.corners}
        touching = (
            translated
            for x in range(3)
            for y in range(3)
            for cell in self.cells
            if face & (translated := {(x + i, y + j) for i, j in cell})
        )
        return tuple(sorted(set().union(*touching), key=lambda place: place[::-1]))

    @property
    def pieces(self) -> tuple[Child, ...]:
        """The children that are regular if corner 0 alone is special."""
        return self.children[1:]

    @cached_property
    def fine_pieces(self) -> tuple[Child, ...]:
        """The children of the pieces, in their order: ``(u, v) = (origin +- (s, t)) / 4``."""
        return tuple(
            Child(
                (2 * piece.origin[0] + side * i, 2 * piece.origin[1] + side * j),
                piece.turned != child.turned,
            )
            for piece in self.pieces
            for side in (-1 if piece.turned else 1,)
            for child in self.children
            for i, j in (child.origin,)
        )

    @cached_property
    def ring(self) -> tuple[tuple[int, Place], ...]:
        """Places of the ring of corner 0 on its three faces nearest to the face.

        With steps around it from the neighbour along u on, which may be negative.
        """
        stride, size = len(self.orbits), len(self.star)
        steps = range(-stride, 2 * stride + 1)
        near = [self.star[k % size] for k in steps]
        return tuple((k, (1 + i, 1 + j)) for k, (i, j) in zip(steps, near, strict=True))

    @cached_property
    def outer(self) -> tuple[Place, ...]:
        """Places of the template beyond the ring of corner 0, counter-clockwise."""
        near = {(1, 1), *((1 + i, 1 + j) for i, j in self.star)}
        # (of a dual lattice, (1, 1) is the first of the star)
        return tuple(sorted(set(self.template) - near, key=_clockwise, reverse=True))

    @cached_property
    def beyond(self) -> tuple[Place, ...]:
        """Refined places that the pieces take beyond the template, counter-clockwise."""
        taken = {piece.place(near) for piece in self.pieces for near in self.template}
        return tuple(sorted(taken - set(self.template), key=_clockwise, reverse=True))

    @cached_property
    def _elements(self) -> dict[Place, tuple[Place, ...]]:
        """Corners of a vertex, of edges, of a face, by twice their mean."""
        n = len(self.corners)
        elements: list[tuple[Place, ...]] = [(self.corners[0],)]
        elements += [(self.corners[k], self.corners[(k + 1) % n]) for k in range(n)]
        elements += [self.corners] * self.face_points
        return {
            (2 * sum(i for i, _ in e) // len(e), 2 * sum(j for _, j in e) // len(e)): e
            for e in elements
        }

    def parents(self, refined: Place) -> tuple[Place, ...]:
        """Places of the corners whose vertex, edge or face has its point at a refined place."""
        i, j = refined[0] - 1, refined[1] - 1
        element = self._elements[i % 2, j % 2]
        return tuple((1 + i // 2 + x, 1 + j // 2 + y) for x, y in element)


@lru_cache(maxsize=256)
def _turned(gradients: tuple[tuple[Place, Place], ...], nu: Place) -> dict[Place, tuple[int, ...]]:
    total, columns = sum(nu), []
    for along, across in gradients:
        # d/du and d/dv as polynomials in d/ds: coefficients by its power, the rest is d/dt
        product = [1]
        for axis in (0,) * nu[0] + (1,) * nu[1]:
            near, far = along[axis], across[axis]
            more = [0, *product]
            product = [far * x + near * y for x, y in zip([*product, 0], more, strict=True)]
        columns.append(product)
    rows = zip(*columns, strict=True)
    return {(k, total - k): row for k, row in enumerate(rows) if any(row)}


def _clockwise(place: Place) -> int:
    return place[0] - place[1]


_SQUARE = ((0, 0), (1, 0), (1, 1), (0, 1))
QUADS = Lattice(
    name="quads",
    corners=_SQUARE,
    cells=(_SQUARE,),
    star=((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)),
    orbits=(-1, 0),
    children=tuple(Child(corner) for corner in _SQUARE),
    face_points=True,
    reflection=((2, (0, 1)), (-1, (0, 2))),
)

# the squares that a step makes of any polygons, with points in the middle of squares
DUAL_QUADS = Lattice(
    name="dual_quads",
    corners=_SQUARE,
    cells=(_SQUARE,),
    star=((0, 0), (-1, 0), (-1, -1), (0, -1)),
    orbits=(0,),
    children=QUADS.children,
    face_points=True,
    reflection=(),
    dual=True,
)

_TRIANGLE = ((0, 0), (1, 0), (0, 1))
TRIANGLES = Lattice(
    name="triangles",
    corners=_TRIANGLE,
    cells=(_TRIANGLE, ((1, 1), (0, 1), (1, 0))),
    star=((1, 0), (0, 1), (-1, 1), (-1, 0), (0, -1), (1, -1)),
    orbits=(-1,),
    children=(Child((0, 0)), Child((1, 0)), Child((0, 1)), Child((1, 1), turned=True)),
    face_points=False,
    reflection=((1, (0, 1)), (1, (-1, 1)), (-1, (-1, 2))),
)
