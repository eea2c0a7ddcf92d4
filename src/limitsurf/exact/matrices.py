"""Subdivision matrices around special corners, built from the masks.

A `Sector` is what the faces at a vertex form between infinitely sharp edges. The control points
that determine the limit on one of its quads (Stam 1998, section 3) are numbered

* 0: the vertex; ``1 + 2 j`` and ``2 + 2 j``: its edge neighbour ``e_j`` and the opposite corner
  ``f_j`` of its face ``j``, counter-clockwise, in open sectors then ``e_k``, and where the vertex
  is carried by a crease beside the sector last ``m``, halfway between its neighbours on that
  crease: the ring;
* then the outer points at the grid positions `Sector.outer`.

Grid positions ``(i, j)`` count points along u and v; the quad, face p of the sector, lies between
(1, 1), the vertex, and (2, 2)::

    j=3   (0,3)---(1,3)---(2,3)---(3,3)
            |       |       |       |
    j=2  f_p+1 -- e_p+1 -- f_p ---(3,2)
            |       |  quad |       |
    j=1  e_p+2 ---- 0 ---- e_p ---(3,1)
            :       |       |       |
            :    e_p-1 -- f_p-1 --(3,0)

Where the edge along u (or v) is sharp, what lies beyond it has no influence, and the points with
j = 0 (i = 0) are left out. One step of refinement gives the same configuration at half the size,
and more points beyond it (`Sector.beyond`), from which the three regular pieces of the quad take
their 16 control points; those beyond a sharp edge are reflections at it.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any

from limitsurf.caching import cached_property
from limitsurf.exact.scheme import Scheme

KINDS = ("cone", "corner", "crease", "dart", "interior", "flap", "pendant")
_OUTER = ((3, 0), (3, 1), (3, 2), (3, 3), (2, 3), (1, 3), (0, 3))
_BEYOND = ((4, 0), (4, 1), (4, 2), (4, 3), (4, 4), (3, 4), (2, 4), (1, 4), (0, 4))
# lower left grid position of the 4 x 4 control points of each piece: (s > 1/2, t < 1/2), both
# above, (s < 1/2, t > 1/2)
PIECES = ((1, 0), (1, 1), (0, 1))

Row = dict[int, Fraction]
Place = tuple[int, int]


@dataclass(frozen=True)
class Sector:
    """A special corner: what surrounds a vertex, and which of its faces is looked at.

    Attributes
    ----------
    kind : str
        "interior", a smooth vertex; "cone", a sharp one amid smooth faces; "dart", the end of one
        sharp edge, which is ``e_0``; "crease" and "corner", the faces between two sharp edges
        ``e_0`` and ``e_k`` at a vertex that follows the curve through them, or stays; "pendant" and
        "flap", a cone and a corner whose vertex, instead of staying, is carried by a crease that
        does not bound them: of a flap ``e_0`` and ``e_k`` are one edge of that crease.
    faces : int
        Their number, N or k.
    position : int
        The face looked at, 0 to ``faces - 1``; 0 for interior vertices, cones and pendants, whose
        faces are all alike.
    """

    kind: str
    faces: int
    position: int = 0

    def __post_init__(self) -> None:
        least = 1 if self.open else 2
        if self.kind not in KINDS:
            raise ValueError(f"kind must be one of {', '.join(KINDS)}, got {self.kind!r}")
        if self.faces < least:
            what = "the valence of an interior vertex" if least == 2 else "the number of faces"
            raise ValueError(f"{what} is at least {least}, got {self.faces}")
        last = 0 if self.alike else self.faces - 1
        if not 0 <= self.position <= last:
            raise ValueError(f"position must be 0 to {last}, got {self.position}")

    @property
    def open(self) -> bool:
        """Whether the ring has two ends."""
        return self.kind in ("crease", "corner", "flap")

    @property
    def alike(self) -> bool:
        """Whether all faces see the same."""
        return self.kind in ("interior", "cone", "pendant")

    @property
    def carried(self) -> bool:
        """Whether the vertex follows a crease that does not bound the sector."""
        return self.kind in ("flap", "pendant")

    @property
    def takes_vertex_mask(self) -> bool:
        """Whether the vertex follows the scheme's mask of a smooth vertex of so many faces."""
        return self.kind in ("interior", "dart")

    @property
    def place(self) -> str:
        """What and where it is, in words."""
        if self.kind == "interior":
            return f"interior valence {self.faces}"
        return f"a {self.kind} of {self.faces} faces" + (
            f", face {self.position}" if self.position else ""
        )

    @property
    def still(self) -> Sector:
        """The cone or corner that a pendant or flap would be if its vertex stayed."""
        return Sector("corner" if self.open else "cone", self.faces, self.position)

    @property
    def sharp_sides(self) -> tuple[bool, bool]:
        """Whether the edges along u and along v are sharp."""
        ends = self.open or self.kind == "dart"
        return ends and self.position == 0, ends and self.position == self.faces - 1

    @property
    def ring(self) -> int:
        """Number of points of the ring."""
        return 2 * self.faces + 1 + self.open + self.carried

    def _kept(self, places: tuple[Place, ...]) -> tuple[Place, ...]:
        along_u, along_v = self.sharp_sides
        return tuple((i, j) for i, j in places if (j or not along_u) and (i or not along_v))

    @cached_property
    def outer(self) -> tuple[Place, ...]:
        """Grid positions of the outer control points."""
        return self._kept(_OUTER)

    @cached_property
    def beyond(self) -> tuple[Place, ...]:
        """Grid positions of the refined points that are no refined control points."""
        return self._kept(_BEYOND)

    @property
    def size(self) -> int:
        """Number K of control points."""
        return self.ring + len(self.outer)


@dataclass(frozen=True, eq=False)
class SubdivisionMatrix:
    """One step of refinement around a special corner, as sparse rational rows.

    Attributes
    ----------
    sector : Sector
    rows : tuple of dict
        Rows over K columns: the refined configuration, then the points beyond it, then their
        reflections. The first K rows are the square subdivision matrix A.
    pieces : tuple of tuple of int
        (3, 16): the rows that are the control points of each regular piece, index ``4 j + i`` for
        the ``i``-th along u and ``j``-th along v.
    """

    sector: Sector
    rows: tuple[Row, ...]
    pieces: tuple[tuple[int, ...], ...]

    @property
    def size(self) -> int:
        """Number K of control points."""
        return self.sector.size


def grid_index(sector: Sector) -> dict[Place, int]:
    """Map grid position to control point, those beyond included; (0, 0) has none at valence 4."""
    p, n = sector.position, sector.faces

    def e(j: int) -> int:
        return 1 + 2 * (j if sector.open else j % n)

    def f(j: int) -> int:
        return 2 + 2 * (j % n)

    ring = {(1, 1): 0, (2, 1): e(p), (2, 2): f(p), (1, 2): e(p + 1)}
    along_u, along_v = sector.sharp_sides
    if not along_u:
        ring |= {(1, 0): e(p - 1), (2, 0): f(p - 1)}
    if not along_v:
        ring |= {(0, 2): f(p + 1), (0, 1): e(p + 2)}
    places = sector.outer + sector.beyond
    return ring | {place: sector.ring + k for k, place in enumerate(places)}


def subdivision_matrix(scheme: Scheme, sector: Sector, number: Any = Fraction) -> SubdivisionMatrix:
    """Build the matrix of one refinement step around a special corner, in Fractions or floats.

    The local cage is refined by the scheme's own rules; nothing but its connectivity is typed.
    See ``derivations/subdivision_matrix.py`` and ``derivations/sectors.py``.
    """
    # a scheme's masks are code: what is cached depends on their values
    own: tuple[Fraction, ...] = (Fraction(1), Fraction(0), Fraction(0))
    if sector.takes_vertex_mask:
        own = scheme.vertex_mask(sector.faces)
    curve = (scheme.boundary_edge, *scheme.boundary_vertex)
    masks = scheme.face_mask(4), scheme.edge, scheme.vertex_mask(4), own, curve
    return _built(sector, number, *(tuple(map(number, mask)) for mask in masks))


@lru_cache(maxsize=256)
def _built(
    sector: Sector,
    number: Any,
    corner_weights: tuple[Fraction, ...],
    edge: tuple[Fraction, ...],
    regular: tuple[Fraction, ...],
    special: tuple[Fraction, ...],
    curve: tuple[Fraction, ...],
) -> SubdivisionMatrix:
    at = grid_index(sector)
    n = sector.faces
    along_u, along_v = sector.sharp_sides
    zero = number(0)

    def quad(i: int, j: int) -> tuple[int, ...]:
        return at[i, j], at[i + 1, j], at[i + 1, j + 1], at[i, j + 1]

    last = n + 1 if sector.open else n
    ring_faces = [(0, 1 + 2 * j, 2 + 2 * j, 1 + 2 * ((j + 1) % last)) for j in range(n)]
    beside_u = () if along_u else ((2, 0),)
    beside_v = () if along_v else ((0, 2),)
    outer_faces = {place: quad(*place) for place in (*beside_u, (2, 1), (2, 2), (1, 2), *beside_v)}
    faces = ring_faces + list(outer_faces.values())
    face_of_edge: dict[frozenset[int], list[int]] = {}
    faces_of_vertex: dict[int, list[int]] = {}
    for k, face in enumerate(faces):
        for corner, after in zip(face, face[1:] + face[:1], strict=True):
            face_of_edge.setdefault(frozenset((corner, after)), []).append(k)
            faces_of_vertex.setdefault(corner, []).append(k)
    # sharp edges: both ends of an open ring, that of a dart, and what continues them
    sharp = {frozenset((0, 1)), frozenset((0, 1 + 2 * n))} if sector.open else set()
    if sector.kind == "dart":
        sharp = {frozenset((0, 1))}
    sharp |= {frozenset((at[2, 1], at[3, 1]))} if along_u else set()
    sharp |= {frozenset((at[1, 2], at[1, 3]))} if along_v else set()

    def combine(*terms: tuple[Fraction, Row]) -> Row:
        total: Row = {}
        for weight, row in terms:
            for column, value in row.items():
                total[column] = total.get(column, zero) + weight * value
        return {column: value for column, value in sorted(total.items()) if value}

    one = [{k: number(1)} for k in range(sector.size)]
    face_points = [
        combine(*((w, one[v]) for w, v in zip(corner_weights, face, strict=True))) for face in faces
    ]

    def edge_point(a: int, b: int) -> Row:
        if frozenset((a, b)) in sharp:
            return combine((curve[0], one[a]), (curve[0], one[b]))
        ends, across = edge
        p, q = face_of_edge[frozenset((a, b))]
        return combine(
            (ends, one[a]), (ends, one[b]), (across, face_points[p]), (across, face_points[q])
        )

    def on_curve(v: int) -> Row:
        neighbours = sorted({k for ends in sharp if v in ends for k in ends} - {v})
        return combine((curve[1], one[v]), *((curve[2], one[k]) for k in neighbours))

    def vertex_point(v: int, mask: tuple[Fraction, ...]) -> Row:
        own, neighbour, around = mask
        neighbours = sorted({k for ends in face_of_edge if v in ends for k in ends} - {v})
        return combine(
            (own, one[v]),
            *((neighbour, one[k]) for k in neighbours),
            *((around, face_points[k]) for k in faces_of_vertex[v]),
        )

    # refined points by refined grid position: vertex points at the corners of the quad, edge
    # points between grid neighbours, face points in the quads between
    e, f = at[2, 1], at[1, 2]
    refined = {
        (3, 1): on_curve(e) if along_u else vertex_point(e, regular),
        (3, 3): vertex_point(at[2, 2], regular),
        (1, 3): on_curve(f) if along_v else vertex_point(f, regular),
    }
    for place, (near, far) in {
        (3, 0): ((2, 0), (2, 1)),
        (3, 2): ((2, 1), (2, 2)),
        (2, 3): ((1, 2), (2, 2)),
        (0, 3): ((0, 2), (1, 2)),
        (4, 1): ((2, 1), (3, 1)),
        (4, 3): ((2, 2), (3, 2)),
        (3, 4): ((2, 2), (2, 3)),
        (1, 4): ((1, 2), (1, 3)),
    }.items():
        if near in at:
            refined[place] = edge_point(at[near], at[far])
    for (i, j), face in outer_faces.items():
        refined[2 * i, 2 * j] = face_points[faces.index(face)]

    middle = sector.ring - 1
    if sector.carried:
        rows = [combine((curve[1], one[0]), (2 * curve[2], one[middle]))]
    else:
        rows = [on_curve(0) if sector.kind == "crease" else vertex_point(0, special)]
    for j in range(n):
        rows += [edge_point(0, 1 + 2 * j), face_points[j]]
    if sector.open:
        rows.append(edge_point(0, 1 + 2 * n))
    if sector.carried:
        rows.append(combine((curve[0], one[0]), (curve[0], one[middle])))
    rows += [refined[place] for place in sector.outer + sector.beyond]
    for side, places in (
        (along_u, [((i, 0), (i, 1), (i, 2)) for i in range(1, 5)]),
        (along_v, [((0, j), (1, j), (2, j)) for j in range(1, 5)]),
    ):
        for place, on, inner in places if side else ():
            at[place] = len(rows)
            rows.append(combine((number(2), rows[at[on]]), (number(-1), rows[at[inner]])))
    pieces = tuple(
        tuple(at[i + di, j + dj] for dj in range(4) for di in range(4)) for i, j in PIECES
    )
    return SubdivisionMatrix(sector, tuple(rows), pieces)
