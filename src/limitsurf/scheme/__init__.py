"""Schemes as declared facts: lattice, spline, masks, papers; and those that have a name.

A scheme is registered here and nowhere else.
"""

from __future__ import annotations

from limitsurf.scheme.catmull_clark import CATMULL_CLARK
from limitsurf.scheme.doo_sabin import DOO_SABIN
from limitsurf.scheme.loop import LOOP
from limitsurf.scheme.scheme import Scheme

SCHEMES = {scheme.name: scheme for scheme in (CATMULL_CLARK, LOOP, DOO_SABIN)}
# what else files call a scheme, and what that means
_OTHERS = {
    "none": "the cage is a mere mesh of polygons, which is not to be subdivided",
    "mixed": "the cage is of meshes with several schemes",
    "bilinear": "it is not there yet",
}


def find_scheme(scheme: str | Scheme) -> Scheme:
    """Return the scheme of that name, or the scheme itself.

    ValueError when there is none of that name, TypeError for what is no name.
    """
    if isinstance(scheme, Scheme):
        return scheme
    if not isinstance(scheme, str):
        known = f"the name of one ({', '.join(sorted(SCHEMES))}) or a Scheme"
        raise TypeError(f"scheme: got {scheme!r}, need {known}")
    if scheme not in SCHEMES:
        text = f"unknown scheme {scheme!r}; known: {', '.join(sorted(SCHEMES))}"
        if scheme in _OTHERS:
            advice = f'to subdivide it all the same, say scheme="{CATMULL_CLARK.name}"'
            text += f" ({_OTHERS[scheme]}; {advice})"
        raise ValueError(text)
    return SCHEMES[scheme]
