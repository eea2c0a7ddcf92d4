"""The butterfly schemes: masks, and the papers they come from.

After Dyn, Levin and Gregory, "A butterfly subdivision scheme for surface interpolation with tension
control", ACM Transactions on Graphics 9 (1990), with w = 1/16: an edge point is 1/2 of each end,
2 w of each opposite corner, less w of each of the four corners beyond. Vertices stay.
The modified scheme, after Zorin, Schroeder and Sweldens, "Interpolating subdivision for meshes with
arbitrary topology", SIGGRAPH 1996, has masks of its own at edges of extraordinary vertices: 3/4 of
the vertex and, of its N neighbours from the other end on, ``(1/4 + cos(2 pi j / N) +
cos(4 pi j / N) / 2) / N``; at N = 3 and 4 special ones. They say nothing of N = 2, where edges are
like others here.
On boundaries both are the four-point scheme of Dyn, Levin and Gregory (1987); a corner that is
missing beyond the boundary edge (p, q) of the triangle (p, q, o) is p + q - o.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

from limitsurf.scheme.dual import cosine
from limitsurf.scheme.stepwise import InterpolatingScheme

_SPECIAL = {
    3: (Fraction(3, 4), Fraction(5, 12), Fraction(-1, 12), Fraction(-1, 12)),
    4: (Fraction(3, 4), Fraction(3, 8), Fraction(0), Fraction(-1, 8), Fraction(0)),
}


def _spokes(valence: int) -> tuple[Any, ...] | None:
    if valence in (2, 6):
        return None
    if valence in _SPECIAL:
        return _SPECIAL[valence]
    turns = [Fraction(j, valence) for j in range(valence)]
    around = ((Fraction(1, 4) + cosine(t) + cosine(2 * t) / 2) / valence for t in turns)
    return Fraction(3, 4), *around


BUTTERFLY = InterpolatingScheme(
    name="butterfly",
    ends=Fraction(1, 2),
    across=Fraction(1, 8),
    wings=Fraction(-1, 16),
    curve=(Fraction(9, 16), Fraction(-1, 16)),
    paper="Dyn, Levin and Gregory 1990; 1987 (boundaries)",
)
MODIFIED_BUTTERFLY = replace(
    BUTTERFLY,
    name="modified-butterfly",
    spokes=_spokes,
    paper="Zorin, Schroeder and Sweldens 1996; Dyn, Levin and Gregory 1987 (boundaries)",
)
