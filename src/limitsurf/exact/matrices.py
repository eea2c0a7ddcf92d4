r"""Subdivision matrices around special corners, built from the masks.

Control points are those of a `Sector`. The face that is looked at, number p, has the vertex at the
place (1, 1) of the lattice. In quads::

    j=3   (0,3)---(1,3)---(2,3)---(3,3)
            |       |       |       |
    j=2  f_p+1 -- e_p+1 -- f_p ---(3,2)
            |       |  quad |       |
    j=1  e_p+2 ---- 0 ---- e_p ---(3,1)
            :       |       |       |
            :    e_p-1 -- f_p-1 --(3,0)

and in triangles::

    j=3   (0,3)---(1,3)
            |   \   |   \
    j=2  e_p+2 -- e_p+1 --(2,2)
            :   \   |face\   |   \
    j=1     :.......0 ---- e_p ---(3,1)
                    :   \   |   \   |
                    :.... e_p-1 --(3,0)

Of a dual scheme each of the faces drawn has a point, those around the vertex from number p on::

            |       |       |
    j=2   (0,2)---(1,2)---(2,2)
            |       |       |
    j=1    w_1 --- w_0 ---(2,1)
            :       |       |
    j=0     : ... w_-1 ---(2,0)

Where the edge along u (or v) is sharp, what lies beyond it has no influence, and the points with
j = 0 (i = 0) are left out. One step of refinement gives the same configuration at half the size,
and more points beyond it (`Sector.beyond`), from which the regular pieces of the face take their
control points; those beyond a sharp edge are reflections at it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from typing import Any

from limitsurf.caching import cached_property
from limitsurf.scheme.dual import DualScheme, Waves, cosine
from limitsurf.scheme.lattice import Place
from limitsurf.scheme.scheme import Scheme
from limitsurf.scheme.sector import Sector
from limitsurf.scheme.spline import Spline

# weights by point: Fractions, in the row of the vertex perhaps algebraic numbers of sympy
Row = dict[int, Any]


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
        (pieces, points): the rows that are the control points of each regular piece, in the order
        of the lattice's `pieces` and `template`.
    """

    sector: Sector
    rows: tuple[Row, ...]
    pieces: tuple[tuple[int, ...], ...]

    @property
    def size(self) -> int:
        """Number K of control points."""
        return self.sector.size


def grid_index(sector: Sector) -> dict[Place, int]:
    """Map places to control points, those beyond included; the ring's on three faces at most."""
    lattice, (along_u, along_v) = sector.lattice, sector.sharp_sides
    stride, at, first = len(lattice.orbits), {(1, 1): 0}, int(not lattice.dual)
    for step, place in lattice.ring:
        if (step >= 0 or not along_u) and (step <= stride or not along_v):
            turn = stride * sector.position + step
            if sector.gathered:
                turn %= 3
            at[place] = first + (turn if sector.open else turn % (stride * sector.faces))
    places = sector.outer + sector.beyond
    return at | {place: sector.ring + k for k, place in enumerate(places)}


def subdivision_matrix(scheme: Scheme, sector: Sector, number: Any = Fraction) -> SubdivisionMatrix:
    """Build the matrix of one refinement step around a special corner, exactly or in floats.

    The local cage is refined by the scheme's own rules; nothing but its connectivity is typed.
    See ``derivations/subdivision_matrix.py`` and ``derivations/sectors.py``.
    """
    if sector.lattice is not scheme.lattice:
        raise ValueError(
            f"scheme {scheme.name!r} is of {scheme.lattice.name}, not of {sector.lattice.name}"
        )
    # a scheme's masks are code: what is cached depends on their values
    if isinstance(scheme, DualScheme):
        ring = scheme.waves if sector.gathered else scheme.mask(sector.faces)
        return _dual(scheme, sector, number, ring)
    regular, smooth = scheme.lattice.valence, sector.takes_vertex_mask
    masks = {
        "face": scheme.face_mask(scheme.lattice.face_size),
        "edge": scheme.edge_mask(regular, regular),
        # of edges at the vertex, from it
        "spoke": scheme.edge_mask(sector.faces if smooth else regular, regular),
        "regular": scheme.vertex_mask(regular),
        "own": scheme.vertex_mask(sector.faces) if smooth else (),
        "curve": (scheme.boundary_edge, *scheme.boundary_vertex),
    }
    exact = number is Fraction
    values = tuple(tuple(w if exact else number(w) for w in mask) for mask in masks.values())
    built = _built(sector, number, values)
    fine = scheme.pieces_of(sector) != scheme.lattice.pieces
    return _finer(built, scheme.spline, number) if fine else built


@lru_cache(maxsize=256)
def _dual(
    scheme: DualScheme, sector: Sector, number: Any, mask: tuple[Any, ...] | Waves
) -> SubdivisionMatrix:
    """Points of faces: the ring by the mask of its vertex, all others by that of the spline."""
    lattice, at, n = sector.lattice, grid_index(sector), sector.faces
    if isinstance(mask, Waves):
        rows = _gathered(mask, n, number)
    else:
        weights = [w if number is Fraction else number(w) for w in mask]
        rows = [
            {j: weights[(j - k) % n] for j in range(n) if weights[(j - k) % n]} for k in range(n)
        ]
    for i, j in sector.outer + sector.beyond:
        near = scheme.spline.stencil((i - 1, j - 1))
        row = {at[1 + x, 1 + y]: w for (x, y), w in near.items()}
        rows.append({k: w if number is Fraction else number(w) for k, w in sorted(row.items())})
    taken = [[piece.place(near) for near in lattice.template] for piece in lattice.pieces]
    return SubdivisionMatrix(sector, tuple(rows), tuple(tuple(at[p] for p in x) for x in taken))


def _gathered(waves: Waves, n: int, number: Any) -> list[Row]:
    """The points of a gathered ring."""
    cos, sin = cosine(Fraction(1, n)), cosine(Fraction(1, 4) - Fraction(1, n))
    own, once = waves.own, waves.once
    rows: list[Row] = []
    for k, (x, y) in enumerate(((1, 0), (cos, sin), (cos, -sin))):
        mean = 1 - own - once * x - once * y
        rows.append({k: own, 3: mean, 4: once * x, 5: once * y})
    rows += [{3: Fraction(1)}, *({3: 1 - own - once, k: own + once} for k in (4, 5))]
    exact = number is Fraction
    return [{k: w if exact else number(w) for k, w in row.items() if w} for row in rows]


@lru_cache(maxsize=256)
def _built(sector: Sector, number: Any, values: tuple[tuple[Any, ...], ...]) -> SubdivisionMatrix:
    lattice, cage = sector.lattice, _LocalCage(sector, number, *values)
    rows = list(_ring_rows(replace(sector, position=0), number, values))
    rows += [cage.point(place) for place in sector.outer + sector.beyond]
    # beyond a sharp edge along u, and, with i and j exchanged, along v
    taken = [[piece.place(near) for near in lattice.template] for piece in lattice.pieces]
    at = cage.at
    for swap, sharp in enumerate(sector.sharp_sides):
        lost = {_exchanged(place, swap) for places in taken for place in places if sharp}
        for i, j in sorted(place for place in lost if place[1] == 0):
            near = [_exchanged((i + x, j + y), swap) for _, (x, y) in lattice.reflection]
            terms = [(w, rows[at[p]]) for (w, _), p in zip(lattice.reflection, near, strict=True)]
            at[_exchanged((i, j), swap)] = len(rows)
            rows.append(cage.combined(terms))
    pieces = tuple(tuple(at[place] for place in places) for places in taken)
    return SubdivisionMatrix(sector, tuple(rows), pieces)


@lru_cache(maxsize=64)
def _ring_rows(sector: Sector, number: Any, values: tuple[tuple[Any, ...], ...]) -> tuple[Row, ...]:
    """Those of the ring, the same from whichever face they are looked at."""
    return tuple(_LocalCage(sector, number, *values).ring_points())


@lru_cache(maxsize=256)
def _finer(matrix: SubdivisionMatrix, spline: Spline, number: Any) -> SubdivisionMatrix:
    """With the pieces of a second step, and more rows, of the control points that they have.

    Points of edges at the vertex come from the ring, all others by the masks of the spline from the
    control points of the piece of the first step that they lie in.
    """
    lattice, at, n = matrix.sector.lattice, grid_index(matrix.sector), matrix.sector.ring
    first, rows, known, pieces = matrix.rows, [*matrix.rows], dict[Place, int](), []

    def combined(terms: list[tuple[Any, Row]]) -> Row:
        total: Row = {}
        for weight, row in terms:
            for column, value in row.items():
                total[column] = total.get(column, 0) + weight * value
        return dict(sorted(total.items()))

    def point(place: Place, local: Place, near: tuple[int, ...]) -> int:
        """The row of a point by its place around the vertex, and in its piece."""
        if place not in known:
            if at.get(place, n) < n:
                terms = [(w, first[k]) for k, w in first[at[place]].items()]
            else:
                points = dict(zip(lattice.template, near, strict=True))
                mask = spline.stencil((local[0] - 1, local[1] - 1))
                terms = [
                    (w if number is Fraction else number(w), first[points[1 + i, 1 + j]])
                    for (i, j), w in mask.items()
                ]
            known[place] = len(rows)
            rows.append(combined(terms))
        return known[place]

    for piece, near in zip(lattice.pieces, matrix.pieces, strict=True):
        side, (x, y) = -1 if piece.turned else 1, piece.origin
        for child in lattice.children:
            taken = []
            for i, j in map(child.place, lattice.template):
                moved = 2 * (x + (side < 0)) + side * i, 2 * (y + (side < 0)) + side * j
                taken.append(point(moved, (i, j), near))
            pieces.append(tuple(taken))
    return SubdivisionMatrix(matrix.sector, tuple(rows), tuple(pieces))


def _exchanged(place: Place, swap: int) -> Place:
    """The place, or with swap that across the diagonal."""
    return place[::-1] if swap else place


class _LocalCage:
    """The points that a step makes around a special corner, as rows over the control points.

    Those of the ring are named by their numbers, the others by places: where few faces surround the
    vertex one point can have several.
    """

    def __init__(self, sector: Sector, number: Any, *masks: tuple[Any, ...]) -> None:
        self.sector, self.lattice, self.number = sector, sector.lattice, number
        self.face, self.edge, self.spoke, self.regular, self.own, self.curve = masks
        self.at = grid_index(sector)
        self.ring_faces = [self._ring_face(j) for j in range(sector.faces)]

    @cached_property
    def ring_face_points(self) -> list[Row]:
        """The points of the faces of the ring, if faces have any."""
        return [self.sum_of(self.face, c) for c in self.ring_faces if self.face]

    def combined(self, terms: list[tuple[Any, Row]]) -> Row:
        """A sum of rows."""
        total: Row = {}
        for weight, row in terms:
            for column, value in row.items():
                term = weight * value
                total[column] = total[column] + term if column in total else term
        return {column: value for column, value in sorted(total.items()) if value}

    def sum_of(self, weights: tuple[Any, ...], points: list[int]) -> Row:
        """A sum of control points."""
        row: Row = {}
        for k, weight in zip(points, weights, strict=True):
            row[k] = row[k] + weight if k in row else weight
        return {k: row[k] for k in sorted(row) if row[k]}

    # ---------------------------------------------------------------- the ring

    def ring_points(self) -> list[Row]:
        """The vertex, then the points of its edges and faces, then of the crease beside it."""
        sector, half = self.sector, self.curve[0]
        rows = [self._own_point()]
        for j in range(sector.faces + sector.open):
            edge = self.ring_faces[j][1] if j < sector.faces else self.ring_faces[-1][-1]
            first = j == 0 and (sector.open or sector.kind == "dart")
            if first or j == sector.faces:
                rows.append(self.sum_of((half, half), [0, edge]))
            else:
                first_end, second_end, across = self.spoke
                rows.append(
                    self.combined(
                        [
                            (self.number(1), self.sum_of((first_end, second_end), [0, edge])),
                            (across, self._across_spoke(j - 1, 1)),
                            (across, self._across_spoke(j, -1)),
                        ]
                    )
                )
            rows += self.ring_face_points[j : j + 1]
        if sector.carried:
            rows.append(self.sum_of((half, half), [0, sector.ring - 1]))
        return rows

    def _ring_face(self, j: int) -> list[int]:
        """Corners of face j of the ring."""
        stride = len(self.lattice.orbits)
        around = stride * self.sector.faces + self.sector.open
        return [0, *(1 + (stride * j + k) % around for k in range(stride + 1))]

    def _across_spoke(self, j: int, corner: int) -> Row:
        """What face j has across an edge at the vertex: its face point, or a corner."""
        if self.face:
            return self.ring_face_points[j]
        return {self.ring_faces[j][corner]: self.number(1)}

    def _own_point(self) -> Row:
        """The point of the vertex."""
        sector, (_, kept, beside) = self.sector, self.curve
        if sector.carried:
            return self.sum_of((kept, 2 * beside), [0, sector.ring - 1])
        if sector.kind == "crease":
            return self.sum_of((kept, beside, beside), [0, 1, sector.ring - 1])
        if sector.kind in ("corner", "cone"):
            return {0: self.number(1)}
        neighbours = [corners[1] for corners in self.ring_faces]
        return self._vertex_point(self.own, 0, neighbours, self.ring_face_points)

    # ---------------------------------------------------------------- elsewhere

    def point(self, place: Place) -> Row:
        """The point of the element at a refined place."""
        element = self.lattice.parents(place)
        points = [self.at[corner] for corner in element]
        for swap, sharp in enumerate(self.sector.sharp_sides):
            if sharp and all(_exchanged(corner, swap)[1] == 1 for corner in element):
                (i, j), (half, kept, beside) = _exchanged(element[0], swap), self.curve
                if len(element) == 2:
                    return self.sum_of((half, half), points)
                ends = [self.at[_exchanged((k, j), swap)] for k in (i - 1, i + 1)]
                return self.sum_of((kept, beside, beside), [*points, *ends])
        if len(element) > 2:
            return self.sum_of(self.face, points)
        faces = self._faces(element)
        if len(element) == 1:
            star = self.lattice.star[:: len(self.lattice.orbits)]
            ((i, j),) = element
            near = [self.at[i + x, j + y] for x, y in star]
            around = [self.sum_of(self.face, corners) for corners in faces if self.face]
            return self._vertex_point(self.regular, points[0], near, around)
        first, second, across = self.edge
        terms = [(self.number(1), self.sum_of((first, second), points))]
        for corners in faces:
            mask = self.face or (self.number(1),)
            far = corners if self.face else [k for k in corners if k not in points]
            terms.append((across, self.sum_of(mask, far)))
        return self.combined(terms)

    def _faces(self, element: tuple[Place, ...]) -> list[list[int]]:
        """Corners of the faces that have all corners of an element."""
        i, j = element[0]
        return [
            [self.at[place] for place in places]
            for cell in self.lattice.cells
            for x, y in cell
            if {*element} <= {*(places := [(i - x + a, j - y + b) for a, b in cell])}
        ]

    def _vertex_point(
        self, mask: tuple[Any, ...], v: int, neighbours: list[int], face_points: list[Row]
    ) -> Row:
        own, neighbour, *around = mask
        row = self.sum_of((own, *(neighbour for _ in neighbours)), [v, *neighbours])
        return self.combined(
            [(self.number(1), row), *((w, point) for w in around for point in face_points)]
        )
