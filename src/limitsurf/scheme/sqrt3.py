"""The scheme of Kobbelt: its masks, and the paper they come from.

After Kobbelt, "sqrt(3)-subdivision", SIGGRAPH 2000: a step makes the mean of each triangle; the
neighbours of an interior vertex of valence N share ``(4 - 2 cos(2 pi / N)) / 9`` in its new point,
by Niven's theorem rational at N = 2, 3, 4 and 6 alone; and the old edges are turned. Boundaries are
touched in each second step alone, which cuts them into three: the cubic B-spline.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import ClassVar

from limitsurf.scheme.dual import cosine
from limitsurf.scheme.masks import Weight, Weights
from limitsurf.scheme.scheme import exact_weight
from limitsurf.scheme.stepwise import StepwiseScheme


@dataclass(frozen=True, kw_only=True)
class TurningScheme(StepwiseScheme):
    """Masks of a scheme of triangles that makes middles of faces and turns edges.

    Parameters
    ----------
    share : callable, N -> number
        What the neighbours of an interior vertex of valence N have together in its new point.
    boundary_vertex : (Fraction, Fraction)
        Of a boundary vertex, and of each of its neighbours there, in its point after two steps.
    boundary_third : (Fraction, Fraction, Fraction)
        Of the vertex that is near, of the other end of the edge, and of the neighbour beyond, in
        the point at a third of a boundary edge after two steps.
    """

    # 5/3 after two steps, a third as much more after each two
    reach: ClassVar[float] = 2.5
    share: Callable[[int], Weight]
    boundary_vertex: tuple[Fraction, Fraction]
    boundary_third: Weights

    def __post_init__(self) -> None:
        own, beside = self.boundary_vertex
        sums = {
            "boundary_vertex": own + 2 * beside,
            "boundary_third": sum(self.boundary_third),
        }
        for name, total in sums.items():
            if total != 1:
                raise ValueError(f"scheme {self.name!r}: {name} sums to {total}, not to 1")

    def __hash__(self) -> int:
        return hash(self.name)

    @property
    def turns_edges(self) -> bool:
        """Whether two steps cut edges into three, and one makes faces across edges."""
        return True

    def share_at(self, valence: int) -> Weight:
        """What the neighbours of an interior vertex have in its new point, checked."""
        found = self.share(valence)
        self._check(f"share({valence})", (1 - found, found), (1, 1), algebraic=True)
        return exact_weight(found)


def _share(valence: int) -> Weight:
    return (4 - 2 * cosine(Fraction(1, valence))) / 9


SQRT3 = TurningScheme(
    name="sqrt3",
    share=_share,
    boundary_vertex=(Fraction(19, 27), Fraction(4, 27)),
    boundary_third=(Fraction(16, 27), Fraction(10, 27), Fraction(1, 27)),
    paper="Kobbelt 2000",
)
