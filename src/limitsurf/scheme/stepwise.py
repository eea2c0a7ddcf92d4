"""Schemes whose regular pieces are no polynomials: they have masks, and no spline.

Their limits are what refinement tends to: evaluated by steps towards the place, not by pieces. That
refuses, in one place and by name, whatever stands on polynomials: to ask for the spline is an
error.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache
from typing import Any, ClassVar

from limitsurf.scheme.lattice import TRIANGLES, Lattice
from limitsurf.scheme.scheme import Scheme

_DIGITS = 50  # to which irrational weights are looked at


class _NoSpline:
    """What stands for the spline of a scheme that has none."""

    def __get__(self, scheme: Scheme | None, owner: type | None = None) -> Any:
        if scheme is None:
            return self
        raise ValueError(
            f"scheme {scheme.name!r} is refined step by step and has no polynomial pieces, which "
            "this needs: evaluate, jet up to order 1, tangents, normal and weights know it, and so "
            "do refined, tessellate by numbers of segments, and plot; for all else take a scheme "
            "of ls.schemes.with_pieces, or a mesh of ls.refined"
        )


@dataclass(frozen=True, kw_only=True)
class StepwiseScheme(Scheme):
    """A scheme without polynomial pieces: what is common to all of these.

    Parameters
    ----------
    name : str
    paper : str
    lattice : Lattice, optional
        How regular faces lie together, and what a step makes of them.

    Attributes
    ----------
    reach : float
        How far a vertex has influence where the scheme is regular, in edges.
    """

    reach: ClassVar[float]
    face: None = field(default=None, init=False)
    edge: tuple[Fraction, Fraction] = field(default=(Fraction(0), Fraction(0)), init=False)
    vertex: Any = field(default=None, init=False)
    boundary_edge: Fraction = field(default=Fraction(0), init=False)
    boundary_vertex: tuple[Fraction, Fraction] = field(
        default=(Fraction(0), Fraction(0)), init=False
    )
    smooth_triangle: None = field(default=None, init=False)
    lattice: Lattice = TRIANGLES
    spline: Any = field(default=_NoSpline(), init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Masks are checked by each kind of such schemes."""

    @property
    def has_pieces(self) -> bool:
        """Whether limit faces are made of polynomial pieces."""
        return False

    @property
    def has_creases(self) -> bool:
        """Whether there are rules for sharp edges and vertices."""
        return False

    @property
    def local(self) -> bool:
        """Whether limit faces depend on their own corners alone."""
        return False

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of special corners that there are rules for: smooth ones."""
        return ("interior",)

    def __hash__(self) -> int:
        return hash(self.name)

    def check_spokes(self, valence: int) -> None:
        """No regular pieces lie next to a vertex."""

    def key(self, valence: int | None) -> dict[str, Any]:
        """There are no tables of such schemes."""
        return {"scheme": self.name, "spline": self.spline}


@dataclass(frozen=True, kw_only=True)
class InterpolatingScheme(StepwiseScheme):
    """Masks of a scheme of triangles that keeps its vertices, and makes points of edges.

    Parameters
    ----------
    ends, across, wings : Fraction
        Weights in the point of an edge of each of its ends, of each corner that lies opposite to
        it, and of each corner beyond these, opposite to the four other edges of its two triangles.
    curve : (Fraction, Fraction)
        On boundaries: of each end, and of each next vertex along the boundary.
    spokes : callable, N -> N + 1 numbers or None, optional
        Weights of an interior vertex of valence N in the points of its edges, then of its
        neighbours, counter-clockwise from the other end of the edge on; None where its edges are
        like others. An edge between two such vertices takes the mean of both.
    """

    # 3/2 after a step, as far as the wings of an edge are, and half as much more after each
    reach: ClassVar[float] = 3.0
    ends: Fraction
    across: Fraction
    wings: Fraction
    curve: tuple[Fraction, Fraction]
    spokes: Callable[[int], tuple[Any, ...] | None] | None = None

    def __post_init__(self) -> None:
        sums = {
            "ends, across and wings": 2 * (self.ends + self.across + 2 * self.wings),
            "curve": 2 * sum(self.curve),
        }
        for name, total in sums.items():
            if total != 1:
                raise ValueError(f"scheme {self.name!r}: {name} sum to {total}, not to 1")

    def __hash__(self) -> int:
        return hash(self.name)

    def spoke_mask(self, valence: int) -> tuple[Any, ...] | None:
        """Weights around an interior vertex in the point of one of its edges, if it has its own.

        Of the vertex, then of its neighbours from the other end of the edge on.
        """
        return None if self.spokes is None else _checked(self.name, self.spokes, valence)


@lru_cache(maxsize=1024)
def _checked(
    name: str, spokes: Callable[[int], tuple[Any, ...] | None], valence: int
) -> tuple[Any, ...] | None:
    """A mask of edges of a vertex: exact numbers whose sum is one, the same in both directions."""
    found = spokes(valence)
    if found is None:
        return None
    if found[2:] != found[:1:-1]:
        raise ValueError(f"scheme {name!r}: spokes({valence}) is not symmetric: {found!r}")
    rational = all(isinstance(w, (Fraction, int)) for w in found)
    half = [w if rational else _digits(w) for w in found[: valence // 2 + 2]]
    total = half[0] + half[1] + 2 * sum(half[2:]) - (half[-1] if valence % 2 == 0 else 0)
    if len(found) != valence + 1 or not abs(total - 1) * 10**_DIGITS < 1:
        raise ValueError(
            f"scheme {name!r}: spokes({valence}) must be {valence + 1} exact numbers of sum 1, "
            f"got {found!r}"
        )
    return tuple(Fraction(w) if isinstance(w, int) else w for w in found)


def _digits(weight: Any) -> Any:
    import sympy

    return sympy.sympify(weight).evalf(_DIGITS + 5)
