"""Sharpness: which mask a point takes, and how masks blend, near creases and corners.

Facts of DeRose, Kass and Truong, "Subdivision surfaces in character animation", SIGGRAPH 1998, in
the form that OpenSubdiv and USD gave them; derived in ``derivations/creases.py``.

A sharpness lies in [0, inf]; from `INFINITE` on it never falls. Each refinement lowers it by 1.
The rule of a vertex follows from its own sharpness and from how many edges at it are sharp:

======================  ==================  =====================================================
vertex                  sharp edges at it   rule, and its mask
======================  ==================  =====================================================
of sharpness 0          0                   smooth: the vertex mask of the scheme
of sharpness 0          1                   dart: the same
of sharpness 0          2                   crease: the cubic B-spline along the two edges
of sharpness 0          3 or more           corner: it stays
of positive sharpness   any number          corner: it stays
======================  ==================  =====================================================

An edge point is smooth at sharpness 0 and the midpoint from 1 on.

**Transitions.** Where the children of a vertex have another rule, its point is a blend: w times the
point by its own rule, 1 - w times that by the rule of its child, with w the mean, at most 1, of the
sharpnesses (of the vertex and of the edges at it) that fall to 0. An edge point of sharpness s < 1
is s times the midpoint and 1 - s times the smooth one, unless both halves of the edge stay sharp.

**What is infinitely sharp without being tagged.** Boundary edges; non-manifold edges (three or more
faces, or two that run along it the same way); under "edge_and_corner" vertices of one face; and
non-manifold vertices (at the end of a non-manifold edge, or whose faces are not one fan) but for
those in the middle of a fin: exactly two non-manifold edges, no boundary edge and more faces than
edges; not all faces there need lie between the two. Vertices are so sharpened in the cage alone;
midpoints of non-manifold edges are on a crease.

**Creasing.** "uniform": sharpness falls by 1. "chaikin": at each end of a semi-sharp edge, if other
semi-sharp edges meet there, 3/4 of its own sharpness and 1/4 of their mean, less 1.
"""

from __future__ import annotations

from fractions import Fraction

from limitsurf.scheme.scheme import Scheme

INFINITE = 10
CHAIKIN = (Fraction(3, 4), Fraction(1, 4))

Matrix = tuple[tuple[Fraction, ...], ...]


def strip_pieces(scheme: Scheme, depth: int, share: Fraction) -> tuple[Matrix, ...]:
    """The spline across a semi-sharp crease that goes straight on, piece by piece.

    Of four rows of control points the second is on the crease. Refinement gives five, the second
    of which is on it again, with a sharpness less by 1: the last four belong to the upper half,
    which is an ordinary spline; the first four to the lower one, refined again while it is sharp.
    The pieces are affine in the share of the sharp mask in the last step.

    Parameters
    ----------
    scheme : Scheme
    depth : int
        How often it is refined, the sharpness rounded up.
    share : Fraction
        The sharpness before the last step, in [0, 1].

    Returns
    -------
    tuple of (4, 4) matrices
        Coefficients of the powers of the parameter in each piece by row of control points: the
        upper halves, from the first refinement on, then what is left next to the crease.
    """
    half, (own, beside) = scheme.boundary_edge, scheme.boundary_vertex
    zero = Fraction(0)
    rows: Matrix = tuple(tuple(Fraction(i == j) for j in range(4)) for i in range(4))
    pieces = []
    for k in range(depth):
        w = share if k == depth - 1 else Fraction(1)
        on = ((1 - w) * beside, (1 - w) * own + w, (1 - w) * beside, zero)
        step = (
            (half, half, zero, zero),
            on,
            (zero, half, half, zero),
            (zero, beside, own, beside),
            (zero, zero, half, half),
        )
        refined = _product(step, rows)
        pieces.append(_product(scheme.spline.curve, refined[1:]))
        rows = refined[:4]
    return (*pieces, _product(scheme.spline.curve, rows))


def _product(left: Matrix, right: Matrix) -> Matrix:
    columns = tuple(zip(*right, strict=True))
    return tuple(
        tuple(sum((a * b for a, b in zip(row, c, strict=True)), Fraction(0)) for c in columns)
        for row in left
    )
