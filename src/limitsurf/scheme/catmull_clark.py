"""The Catmull-Clark scheme: its masks, and the papers they come from.

Interior rules after Catmull and Clark, "Recursively generated B-spline surfaces on arbitrary
topological meshes", Computer-Aided Design 10 (1978): with ``Q`` the mean of the face points and
``R`` the mean of the edge midpoints around a vertex ``S`` of valence ``N``, the vertex point is
``(Q + 2 R + (N - 3) S) / N``. Writing ``R = S / 2 + mean(neighbours) / 2`` gives the mask below.
Boundary rules after DeRose, Kass and Truong, "Subdivision surfaces in character animation",
SIGGRAPH 1998, section 3. Derived in ``derivations/masks_bicubic.py``. The weight of triangles under
the rule "smooth" is OpenSubdiv's.
"""

from __future__ import annotations

from fractions import Fraction

from limitsurf.scheme.scheme import Scheme


def _face(n: int) -> tuple[Fraction, ...]:
    return (Fraction(1, n),) * n


def _vertex(valence: int) -> tuple[Fraction, Fraction, Fraction]:
    share = Fraction(1, valence * valence)
    return Fraction(valence - 2, valence), share, share


CATMULL_CLARK = Scheme(
    name="catmull-clark",
    face=_face,
    edge=(Fraction(1, 4), Fraction(1, 4)),
    vertex=_vertex,
    boundary_edge=Fraction(1, 2),
    boundary_vertex=(Fraction(3, 4), Fraction(1, 8)),
    paper="Catmull and Clark 1978; DeRose, Kass and Truong 1998 (boundaries)",
    smooth_triangle=Fraction(47, 100),
)
