"""Subdivision matrices around an interior vertex, built from the masks.

The control points that determine the limit on a quad with one extraordinary corner (Stam 1998,
section 3) are numbered

* 0: the extraordinary vertex; ``1 + 2 j`` and ``2 + 2 j``: its edge neighbour ``e_j`` and the
  opposite corner ``f_j`` of its face ``j``, counter-clockwise, the quad itself being face 0;
* ``2 N + 1 ...  2 N + 7``: the outer points at the grid positions `OUTER`.

Grid positions ``(i, j)`` count points along u and v; the quad lies between (1, 1), the
extraordinary vertex, and (2, 2)::

    j=3   (0,3)---(1,3)---(2,3)---(3,3)
            |       |       |       |
    j=2    f_1 ---- e_1 --- f_0 --(3,2)
            |       |  quad |       |
    j=1    e_2 ---- 0 ---- e_0 ---(3,1)
            :       |       |       |
            :    e_{N-1}-f_{N-1}--(3,0)

One step of refinement gives the same configuration at half the size, and nine more points beyond
it (`BEYOND`), from which the three regular pieces of the quad take their 16 control points.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

from limitsurf.exact.scheme import Scheme

OUTER = ((3, 0), (3, 1), (3, 2), (3, 3), (2, 3), (1, 3), (0, 3))
BEYOND = ((4, 0), (4, 1), (4, 2), (4, 3), (4, 4), (3, 4), (2, 4), (1, 4), (0, 4))
# lower left grid position of the 4 x 4 control points of each piece: (s > 1/2, t < 1/2), both
# above, (s < 1/2, t > 1/2)
PIECES = ((1, 0), (1, 1), (0, 1))

Row = dict[int, Fraction]


@dataclass(frozen=True, eq=False)
class SubdivisionMatrix:
    """One step of refinement around an interior vertex, as sparse rational rows.

    Attributes
    ----------
    valence : int
        Number N of faces around the vertex.
    rows : tuple of dict
        ``2 N + 17`` rows over ``2 N + 8`` columns: the refined configuration, then the points
        `BEYOND` it. The first ``2 N + 8`` rows are the square subdivision matrix A.
    pieces : tuple of tuple of int
        (3, 16): the rows that are the control points of each regular piece, index ``4 j + i`` for
        the ``i``-th along u and ``j``-th along v.
    """

    valence: int
    rows: tuple[Row, ...]
    pieces: tuple[tuple[int, ...], ...]

    @property
    def size(self) -> int:
        """Number of control points, ``2 N + 8``."""
        return 2 * self.valence + 8


def grid_index(valence: int) -> dict[tuple[int, int], int]:
    """Map grid position to control point, `BEYOND` included; (0, 0) has none unless N = 4."""

    def e(j: int) -> int:
        return 1 + 2 * (j % valence)

    def f(j: int) -> int:
        return 2 + 2 * (j % valence)

    ring = {(1, 1): 0, (2, 1): e(0), (2, 2): f(0), (1, 2): e(1), (0, 2): f(1), (0, 1): e(2)}
    ring |= {(1, 0): e(-1), (2, 0): f(-1)}
    first = 2 * valence + 1
    return ring | {place: first + k for k, place in enumerate(OUTER + BEYOND)}


def subdivision_matrix(scheme: Scheme, valence: int) -> SubdivisionMatrix:
    """Build the matrix of one refinement step around an interior vertex of `valence` >= 2.

    The local cage is refined by the scheme's own rules; nothing but its connectivity is typed.
    See ``derivations/subdivision_matrix.py``.
    """
    if valence < 2:
        raise ValueError(f"the valence of an interior vertex is at least 2, got {valence}")
    # a scheme's masks are code: what is cached depends on their values
    vertex = {n: scheme.vertex_mask(n) for n in (4, valence)}
    return _built(valence, scheme.face_mask(4), scheme.edge, vertex[4], vertex[valence])


@lru_cache(maxsize=256)
def _built(
    valence: int,
    corner_weights: tuple[Fraction, ...],
    edge: tuple[Fraction, ...],
    regular: tuple[Fraction, ...],
    extraordinary: tuple[Fraction, ...],
) -> SubdivisionMatrix:
    at = grid_index(valence)

    def quad(i: int, j: int) -> tuple[int, ...]:
        return at[i, j], at[i + 1, j], at[i + 1, j + 1], at[i, j + 1]

    ring_faces = [(0, 1 + 2 * j, 2 + 2 * j, 1 + 2 * ((j + 1) % valence)) for j in range(valence)]
    outer_faces = {place: quad(*place) for place in ((2, 0), (2, 1), (2, 2), (1, 2), (0, 2))}
    faces = ring_faces + list(outer_faces.values())
    face_of_edge: dict[frozenset[int], list[int]] = {}
    faces_of_vertex: dict[int, list[int]] = {}
    for k, face in enumerate(faces):
        for corner, after in zip(face, face[1:] + face[:1], strict=True):
            face_of_edge.setdefault(frozenset((corner, after)), []).append(k)
            faces_of_vertex.setdefault(corner, []).append(k)

    def combine(*terms: tuple[Fraction, Row]) -> Row:
        total: Row = {}
        for weight, row in terms:
            for column, value in row.items():
                total[column] = total.get(column, Fraction(0)) + weight * value
        return {column: value for column, value in sorted(total.items()) if value}

    one = [{k: Fraction(1)} for k in range(2 * valence + 8)]
    face_points = [
        combine(*((w, one[v]) for w, v in zip(corner_weights, face, strict=True))) for face in faces
    ]

    def edge_point(a: int, b: int) -> Row:
        ends, across = edge
        p, q = face_of_edge[frozenset((a, b))]
        return combine(
            (ends, one[a]), (ends, one[b]), (across, face_points[p]), (across, face_points[q])
        )

    def vertex_point(v: int) -> Row:
        own, neighbour, around = regular if v else extraordinary
        neighbours = sorted({k for ends in face_of_edge if v in ends for k in ends} - {v})
        return combine(
            (own, one[v]),
            *((neighbour, one[k]) for k in neighbours),
            *((around, face_points[k]) for k in faces_of_vertex[v]),
        )

    # refined points by refined grid position: vertex points at the corners of the quad, edge
    # points between grid neighbours, face points in the quads between
    refined = {(3, 1): vertex_point(at[2, 1]), (3, 3): vertex_point(at[2, 2])}
    refined[1, 3] = vertex_point(at[1, 2])
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
        refined[place] = edge_point(at[near], at[far])
    for (i, j), face in outer_faces.items():
        refined[2 * i, 2 * j] = face_points[faces.index(face)]

    rows = [vertex_point(0)]
    for j in range(valence):
        rows += [edge_point(0, 1 + 2 * j), face_points[j]]
    rows += [refined[place] for place in OUTER + BEYOND]
    pieces = tuple(
        tuple(at[i + di, j + dj] for dj in range(4) for di in range(4)) for i, j in PIECES
    )
    return SubdivisionMatrix(valence, tuple(rows), pieces)
