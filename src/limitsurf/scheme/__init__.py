"""Schemes as declared facts: lattice, spline, masks, papers; and those that have a name.

A scheme is registered here and nowhere else.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from limitsurf.scheme.bilinear import BILINEAR, LINEAR
from limitsurf.scheme.butterfly import BUTTERFLY, MODIFIED_BUTTERFLY
from limitsurf.scheme.catmull_clark import CATMULL_CLARK
from limitsurf.scheme.doo_sabin import DOO_SABIN
from limitsurf.scheme.loop import LOOP, LOOP_WARREN
from limitsurf.scheme.masks import reserve
from limitsurf.scheme.scheme import Scheme
from limitsurf.scheme.sqrt3 import SQRT3


class Schemes(Mapping[str, Scheme]):
    """The schemes that have a name, by it.

    A name can be given wherever a scheme is expected, and stands in files; so can a value, as those
    that are here are, and any that you make yourself: see `Scheme`.

    Examples
    --------
    >>> import limitsurf as ls
    >>> ls.schemes["loop"].paper
    'Loop 1987; Hoppe et al. 1994 (boundaries and creases)'
    >>> print(ls.schemes)
    catmull-clark  quads      Catmull and Clark 1978; DeRose, Kass and Truong 1998 (boundaries)
    loop           triangles  Loop 1987; Hoppe et al. 1994 (boundaries and creases)
    ...
    >>> "no-such-scheme" in ls.schemes
    False
    """

    def __init__(self, *known: Scheme) -> None:
        self._known = {scheme.name: scheme for scheme in known}

    def __getitem__(self, name: str) -> Scheme:
        return self._known[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._known)

    def __len__(self) -> int:
        return len(self._known)

    @property
    def with_pieces(self) -> Schemes:
        """Those whose limit faces are made of polynomial pieces, which many functions need.

        Examples
        --------
        >>> import limitsurf as ls
        >>> "loop" in ls.schemes.with_pieces, "butterfly" in ls.schemes.with_pieces
        (True, False)
        """
        return Schemes(*(scheme for scheme in self.values() if scheme.has_pieces))

    def __repr__(self) -> str:
        rows = [(scheme.name, scheme.lattice.name, scheme.paper) for scheme in self.values()]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)][:2]
        return "\n".join(
            f"{name:{widths[0]}}  {faces:{widths[1]}}  {paper}" for name, faces, paper in rows
        )


SCHEMES = Schemes(
    *(CATMULL_CLARK, LOOP, LOOP_WARREN, DOO_SABIN, BILINEAR, LINEAR),
    *(BUTTERFLY, MODIFIED_BUTTERFLY, SQRT3),
)
schemes = SCHEMES  # to users
# those whose tables ship with the package
SHIPPED_SCHEMES = CATMULL_CLARK, LOOP, DOO_SABIN
# what else files call a scheme, and what that means
_OTHERS = {
    "none": "the cage is a mere mesh of polygons, which is not to be subdivided",
    "mixed": "the cage is of meshes with several schemes",
}
reserve([*SCHEMES, *_OTHERS])


def find_scheme(scheme: str | Scheme) -> Scheme:
    """Return the scheme of that name, or the scheme itself.

    ValueError when there is none of that name, TypeError for what is no name.
    """
    if isinstance(scheme, Scheme):
        return scheme
    if not isinstance(scheme, str):
        known = f"the name of one ({', '.join(SCHEMES)}) or a Scheme"
        raise TypeError(f"scheme: got {scheme!r}, need {known}")
    if scheme not in SCHEMES:
        text = f"unknown scheme {scheme!r}; known: {', '.join(SCHEMES)}"
        if scheme in _OTHERS:
            advice = f'to subdivide it all the same, say scheme="{CATMULL_CLARK.name}"'
            text += f" ({_OTHERS[scheme]}; {advice})"
        raise ValueError(text)
    return SCHEMES[scheme]
