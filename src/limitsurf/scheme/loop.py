"""The scheme of Loop, with his weights and with Warren's: masks, and the papers they come from.

Interior rules after Loop, "Smooth subdivision surfaces based on triangles", Master's thesis,
University of Utah 1987: an edge point is 3/8 of each end and 1/8 of each opposite corner; a vertex
of valence ``N`` keeps ``1 - a``, and its neighbours share ``a``, which is 5/8 less the square of
``3/8 + cos(2 pi / N) / 4``: by Niven's theorem rational at N = 2, 3, 4 and 6 alone.
With Warren's weights ("Subdivision methods for geometric design", manuscript, Rice University 1995)
neighbours share 3/8, and 9/16 at valence 3: always rational.
Boundaries and creases after Hoppe and others, "Piecewise smooth surface reconstruction", SIGGRAPH
1994: the cubic B-spline.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

from limitsurf.scheme.lattice import TRIANGLES
from limitsurf.scheme.scheme import Scheme
from limitsurf.scheme.spline import QUARTIC

_COSINES = {2: Fraction(-1), 3: Fraction(-1, 2), 4: Fraction(0), 6: Fraction(1, 2)}


def _vertex(valence: int) -> tuple[Any, Any]:
    cosine: Any = _COSINES.get(valence)
    if cosine is None:
        import sympy

        cosine = sympy.cos(2 * sympy.pi / valence)
    share = Fraction(5, 8) - (Fraction(3, 8) + cosine / 4) ** 2
    return 1 - share, share / valence


def _warren(valence: int) -> tuple[Fraction, Fraction]:
    share = Fraction(9, 16) if valence == 3 else Fraction(3, 8)
    return 1 - share, share / valence


LOOP = Scheme(
    name="loop",
    face=None,
    edge=(Fraction(3, 8), Fraction(1, 8)),
    vertex=_vertex,
    boundary_edge=Fraction(1, 2),
    boundary_vertex=(Fraction(3, 4), Fraction(1, 8)),
    paper="Loop 1987; Hoppe et al. 1994 (boundaries and creases)",
    lattice=TRIANGLES,
    spline=QUARTIC,
)
LOOP_WARREN = replace(
    LOOP,
    name="loop-warren",
    vertex=_warren,
    paper="Loop 1987; Warren 1995 (vertices); Hoppe et al. 1994 (boundaries and creases)",
)
