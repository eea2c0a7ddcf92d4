"""The scheme of Doo and Sabin: its masks, and the paper they come from.

After Doo and Sabin, "Behaviour of recursive division surfaces near extraordinary points",
Computer-Aided Design 10 (1978): the new point at a corner of an n-gon has the share
``(3 + 2 cos(2 pi j / n)) / (4 n)`` of the corner j steps on, and 1/4 more of the corner itself: by
Niven's theorem rational at n = 2, 3, 4 and 6 alone. On a regular lattice that is the biquadratic
B-spline. Boundaries are continued by points beyond them (``derivations/doo_sabin.py``).
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from limitsurf.scheme.dual import DualScheme, cosine


def _corner(n: int) -> tuple[Any, ...]:
    half = [(3 + 2 * cosine(Fraction(j, n))) / (4 * n) for j in range(n // 2 + 1)]
    return half[0] + Fraction(1, 4), *half[1:], *half[(n - 1) // 2 : 0 : -1]


DOO_SABIN = DualScheme(
    name="doo-sabin",
    corner=_corner,
    paper="Doo and Sabin 1978",
)
