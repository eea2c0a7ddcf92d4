"""The scheme of Doo and Sabin: its masks, and the paper they come from.

After Doo and Sabin, "Behaviour of recursive division surfaces near extraordinary points",
Computer-Aided Design 10 (1978): the new point at a corner of an n-gon has the share
``(3 + 2 cos(2 pi j / n)) / (4 n)`` of the corner j steps on, and 1/4 more of the corner itself: by
Niven's theorem rational at n = 2, 3, 4 and 6 alone. That is 1/4 of the corner, 1/4 of what turns
once, and the rest of the mean. On a regular lattice it is the biquadratic B-spline. Boundaries are
continued by points beyond them (``derivations/doo_sabin.py``).
"""

from fractions import Fraction

from limitsurf.scheme.dual import DualScheme, Waves

DOO_SABIN = DualScheme(
    name="doo-sabin",
    corner=Waves(own=Fraction(1, 4), once=Fraction(1, 4)),
    paper="Doo and Sabin 1978",
)
