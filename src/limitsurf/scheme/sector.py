"""Special corners: what surrounds a vertex between infinitely sharp edges, and how it is numbered.

A `Sector` is what the faces at a vertex form between infinitely sharp edges. The control points
that determine the limit on one of its faces (Stam 1998, section 3; Stam 1999) are

* 0: the vertex; then for each face ``j``, counter-clockwise, its edge neighbour ``e_j`` and, in
  quads, the opposite corner ``f_j``; in open sectors then ``e_k``, and where the vertex is carried
  by a crease beside the sector last ``m``, halfway between its neighbours on that crease: the ring;
* then the outer points at the places `Sector.outer` of the lattice.

In a dual lattice the ring has no point for the vertex, but one for each face around it, from the
face that is looked at on. Or it is *gathered*: of those faces the point of that which is looked at,
of the next and of that before, then the mean of all, and this plus what turns once around it, as it
is there and a quarter of a turn on.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from limitsurf.caching import cached_property
from limitsurf.scheme.lattice import QUADS, Lattice, Place

KINDS = ("cone", "corner", "crease", "dart", "interior", "flap", "pendant")


@dataclass(frozen=True)
class Sector:
    """A special corner: what surrounds a vertex, and which of its faces is looked at.

    Attributes
    ----------
    kind : str
        "interior", a smooth vertex; "cone", a sharp one amid smooth faces; "dart", the end of one
        sharp edge, which is ``e_0``; "crease" and "corner", the faces between two sharp edges
        ``e_0`` and ``e_k`` at a vertex that follows the curve through them, or stays; "pendant" and
        "flap", a cone and a corner whose vertex, instead of staying, is carried by a crease that
        does not bound them: of a flap ``e_0`` and ``e_k`` are one edge of that crease.
    faces : int
        Their number, N or k.
    position : int
        The face looked at, 0 to ``faces - 1``; 0 for interior vertices, cones and pendants, whose
        faces are all alike.
    lattice : Lattice
        What the faces are.
    gathered : bool
        Whether the ring is; so it is of few numbers, however many faces there are.
    """

    kind: str
    faces: int
    position: int = 0
    lattice: Lattice = field(default=QUADS, repr=False)
    gathered: bool = False

    def __post_init__(self) -> None:
        least = 1 if self.open else 2
        if self.kind not in KINDS:
            raise ValueError(f"kind must be one of {', '.join(KINDS)}, got {self.kind!r}")
        if self.faces < least:
            what = "the valence of an interior vertex" if least == 2 else "the number of faces"
            raise ValueError(f"{what} is at least {least}, got {self.faces}")
        last = 0 if self.alike else self.faces - 1
        if not 0 <= self.position <= last:
            raise ValueError(f"position must be 0 to {last}, got {self.position}")

    @property
    def open(self) -> bool:
        """Whether the ring has two ends."""
        return self.kind in ("crease", "corner", "flap")

    @property
    def alike(self) -> bool:
        """Whether all faces see the same."""
        return self.kind in ("interior", "cone", "pendant")

    @property
    def carried(self) -> bool:
        """Whether the vertex follows a crease that does not bound the sector."""
        return self.kind in ("flap", "pendant")

    @property
    def takes_vertex_mask(self) -> bool:
        """Whether the vertex follows the scheme's mask of a smooth vertex of so many faces."""
        return self.kind in ("interior", "dart")

    @property
    def place(self) -> str:
        """What and where it is, in words."""
        if self.kind == "interior":
            return f"interior valence {self.faces}"
        return f"a {self.kind} of {self.faces} faces" + (
            f", face {self.position}" if self.position else ""
        )

    @property
    def still(self) -> Sector:
        """The cone or corner that a pendant or flap would be if its vertex stayed."""
        return replace(self, kind="corner" if self.open else "cone")

    @property
    def sharp_sides(self) -> tuple[bool, bool]:
        """Whether the edges along u and along v are sharp."""
        ends = self.open or self.kind == "dart"
        return ends and self.position == 0, ends and self.position == self.faces - 1

    @property
    def ring(self) -> int:
        """Number of points of the ring."""
        if self.gathered:
            return 6
        own = not self.lattice.dual
        return len(self.lattice.orbits) * self.faces + own + self.open + self.carried

    @property
    def fourier(self) -> bool:
        """Whether the ring has an eigenbasis of cosines and sines, as is."""
        return self.kind in ("interior", "cone") and not self.lattice.dual

    def _kept(self, places: tuple[Place, ...]) -> tuple[Place, ...]:
        along_u, along_v = self.sharp_sides
        return tuple((i, j) for i, j in places if (j or not along_u) and (i or not along_v))

    @cached_property
    def outer(self) -> tuple[Place, ...]:
        """Grid positions of the outer control points."""
        return self._kept(self.lattice.outer)

    @cached_property
    def beyond(self) -> tuple[Place, ...]:
        """Grid positions of the refined points that are no refined control points."""
        return self._kept(self.lattice.beyond)

    @property
    def size(self) -> int:
        """Number K of control points."""
        return self.ring + len(self.outer)
