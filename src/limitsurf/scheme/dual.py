"""Dual schemes: their points belong to faces, of which each step cuts the corners.

A dual scheme refines a mesh as a primal one of quads does, into one square for each corner of each
face; but what it moves about are points of the faces: that of a child takes ``mask(n)`` of the n
faces around the corner where it is, from its own parent on, counter-clockwise. The cage itself has
points at vertices: the first step takes, for the child at a corner of an n-gon, ``mask(n)`` of the
n corners, from that one on. So the faces of one level are the vertices of the next: it cuts the
corners of the n-gons that the points form, around faces, edges and vertices of the cage alike.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache
from math import lcm
from typing import Any

from limitsurf.scheme.lattice import DUAL_QUADS, Lattice
from limitsurf.scheme.masks import (
    Weight,
    Weights,
    advice_on,
    as_mask,
    checked_name,
    is_iterable,
    regular_shape,
    shown,
)
from limitsurf.scheme.scheme import Scheme, exact_weight, is_exact
from limitsurf.scheme.sector import Sector
from limitsurf.scheme.spline import BIQUADRATIC, Spline

# cosines of multiples of 1/2, 1/3, 1/4 and 1/6 of a turn: all that are rational
_COSINES = {
    Fraction(0): Fraction(1),
    Fraction(1, 6): Fraction(1, 2),
    Fraction(1, 4): Fraction(0),
    Fraction(1, 3): Fraction(-1, 2),
    Fraction(1, 2): Fraction(-1),
}
_SPLINES = {"biquadratic": (DUAL_QUADS, BIQUADRATIC)}
_DIGITS = 60  # to which irrational weights are looked at
_GATHERED = 7  # least corners of a polygon that `Sector.gathered` tells by fewer numbers


@dataclass(frozen=True)
class Waves:
    """Masks by what they do to waves: all but the slowest are scaled alike.

    The new point at a corner is `own` times it, `once` times the part of the polygon that turns
    once around the middle, and the rest of the mean.
    """

    own: Fraction
    once: Fraction

    def __call__(self, n: int) -> Weights:
        """Weights of the corners of an n-gon."""
        unit = lcm(self.own.denominator, self.once.denominator)
        mean, wave = int(unit * (1 - self.own)), int(2 * unit * self.once)
        half = [(mean + wave * cosine(Fraction(j, n))) / (unit * n) for j in range(n // 2 + 1)]
        return half[0] + self.own, *half[1:], *half[(n - 1) // 2 : 0 : -1]


@dataclass(frozen=True, init=False)
class DualScheme(Scheme):
    """Masks of a dual subdivision scheme, which cuts corners, as that of Doo and Sabin.

    Each step makes, for each corner of each polygon, a point near it; these points form the
    polygons of the next step, around faces, edges and vertices. Around regular vertices that is the
    biquadratic B-spline.

    Parameters
    ----------
    name : str
        What the scheme is called in messages, tables and files; none of `limitsurf.schemes`.
    corner : callable, n -> n numbers, or mapping {n: n numbers}
        Weights of the corners of an n-gon in the new point at one of them, from that one on,
        counter-clockwise: Fractions, or real algebraic numbers of sympy; the same clockwise. A
        mapping lacks 4 at will; it is what travels best to other processes.
    paper : str, optional
        Where the masks are published.
    lattice, spline : optional
        There is one of each: "dual_quads" and "biquadratic".

    Raises
    ------
    ValueError
        As for `Scheme`: for a name of the library's, and masks that raise, have floats or the wrong
        number of weights, do not sum to one, are not symmetric, change from call to call, are not
        those of the spline at 4, or have no limit.

    Warns
    -----
    UserWarning
        Once for each n at which limits exist, but no tangent plane: there the surface is not C1,
        and normals in the middle of the polygon are NaN.

    Notes
    -----
    On waves of frequency f around an n-gon, a step has the eigenvalue ``sum_j w_j cos(2 pi f j /
    n)``: a mask is made from n // 2 + 1 numbers, of which the first is 1; the second is that of
    the tangent plane, 1/2 in the scheme of Doo and Sabin, the others less. Boundaries go by
    reflection, which those with 1/2 there keep (``derivations/doo_sabin.py``).

    Examples
    --------
    >>> from fractions import Fraction as F
    >>> import limitsurf as ls
    >>> mine = ls.DualScheme("mine", corner={3: (F(2, 3), F(1, 6), F(1, 6))})
    >>> [str(weight) for weight in mine.mask(4)]
    ['9/16', '3/16', '1/16', '3/16']
    >>> ls.spectral_analysis(mine, valence=3).subdominant
    (0.5, 0.5)
    """

    corner: Callable[[int], Weights]  # type: ignore[misc]
    face: None = field(default=None, init=False)
    edge: tuple[Fraction, Fraction] = field(default=(Fraction(0), Fraction(0)), init=False)
    vertex: Any = field(default=None, init=False)
    boundary_edge: Fraction = field(default=Fraction(0), init=False)
    boundary_vertex: tuple[Fraction, Fraction] = field(
        default=(Fraction(0), Fraction(0)), init=False
    )
    smooth_triangle: None = field(default=None, init=False)
    lattice: Lattice = DUAL_QUADS
    spline: Spline = BIQUADRATIC

    def __init__(
        self,
        name: str,
        *,
        corner: Callable[[int], Weights] | Mapping[int, Weights],
        paper: str = "not published",
        lattice: Lattice | str | None = None,
        spline: Spline | str | None = None,
    ) -> None:
        found, piece = regular_shape(name, lattice, spline, _SPLINES)
        masks = {
            "name": checked_name(name),
            "corner": as_mask(name, corner, 4, _regular_mask(found, piece)),
            "paper": paper,
            "lattice": found,
            "spline": piece,
        }
        self.__dict__.update(masks)
        self.__post_init__()

    def __post_init__(self) -> None:
        self.__dict__["_asked"] = {}
        got, needed = self.mask(4), _regular_mask(self.lattice, self.spline)
        if got != needed:
            raise ValueError(
                f"scheme {self.name!r}: corner(4) is ({', '.join(map(str, got))}), "
                f"but the {self.spline.name} needs ({', '.join(map(str, needed))})"
            )

    def mask(self, n: int) -> Weights:
        """Weights of the corners of an n-gon in the new point at one of them, from that one on."""
        if isinstance(self.corner, Waves):
            return _of_waves(self.corner, n)
        got = self._ask("corner", self.corner, n)
        return _checked(self.name, n, tuple(got) if is_iterable(got) else got)

    def rim(self, k: int) -> Weights:
        """Ratios r_j, from 1 to -1, that tell where a boundary vertex of k faces has its mirrors.

        With c and d the points of the boundary curve before and after the vertex, what is beyond
        the boundary is the j-th of its faces' points mirrored at ``(c + d + r_j (c - d)) / 2``.
        Every step keeps these reflections if cosines once around the vertex have the eigenvalue
        1/2 (``derivations/doo_sabin.py``).
        """
        if k == 1:
            return Fraction(1), Fraction(-1)
        edge = cosine(Fraction(1, 4 * k))
        ratios = (cosine(Fraction(2 * j + 1, 4 * k)) / edge for j in range(k))
        return tuple(map(exact_weight, ratios))

    def is_rational(self, n: int) -> bool:
        """Whether that mask is."""
        return all(isinstance(w, Fraction) for w in self.mask(n))

    @property
    def waves(self) -> Waves | None:
        """What masks do to waves, if all but the slowest are scaled alike."""
        return self.corner if isinstance(self.corner, Waves) else None

    def gathers(self, n: int) -> bool:
        """Whether a limit face at an n-gon depends on few numbers, not on all its corners."""
        return self.waves is not None and n >= _GATHERED

    @property
    def has_creases(self) -> bool:
        """Whether there are rules for sharp edges and vertices."""
        return False

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of special corners that there are rules for: smooth ones."""
        return ("interior",)

    def sector(self, kind: str, faces: int, position: int = 0) -> Sector:
        """A special corner of this scheme's lattice: it has no others than smooth ones."""
        if kind != "interior":
            raise ValueError(
                f"scheme {self.name!r} has no rule for sharp edges and vertices: what is around a "
                f"vertex is of kind 'interior', got {kind!r}"
            )
        return Sector(kind, faces, position, self.lattice)

    def has_own_spokes(self, valence: int) -> bool:
        """No edge has a mask of its own."""
        return False

    def __hash__(self) -> int:
        return hash(self.name)

    def key(self, valence: int | None, gathered: bool = False) -> dict[str, Any]:
        """All that a subdivision matrix depends on."""
        if gathered and self.waves is not None:
            shares = [str(self.waves.own), str(self.waves.once)]
            return self.key(None) | {"gathered": shares}
        sizes = (4, valence) if valence is not None else (4,)
        masks = {f"corner({n})": list(_texts(self.mask(n))) for n in sizes}
        return {"scheme": self.name, "masks": masks}


def cosine(turns: Fraction) -> Weight:
    """The cosine of so many turns: a Fraction where it is rational, else as sympy has it."""
    turns = min(turns % 1, -turns % 1)
    if turns in _COSINES:
        return _COSINES[turns]
    import sympy

    return sympy.cos(2 * sympy.pi * sympy.Rational(turns.numerator, turns.denominator))


def _regular_mask(lattice: Lattice, spline: Spline) -> Weights:
    """That of a quad, as the spline has it."""
    near = spline.stencil((0, 0))
    return tuple(near[place] for place in lattice.star)


@lru_cache(maxsize=1024)
def _of_waves(waves: Waves, n: int) -> Weights:
    return waves(n)


@lru_cache(maxsize=1024)
def _checked(name: str, n: int, weights: Any) -> Weights:
    """A mask, which must be n exact numbers whose sum is one, the same in both directions."""
    told = f"scheme {name!r}: corner({n})"
    if not isinstance(weights, tuple) or len(weights) != n:
        raise ValueError(f"{told} must be {n} exact numbers of sum 1, got {shown(weights)}")
    for k, w in enumerate(weights):
        if not is_exact(w):
            raise ValueError(
                f"{told} must be {n} exact numbers of sum 1, got {shown(weights)}: weight {k} is "
                f"{advice_on(w, algebraic=True)}"
            )
    rational = all(isinstance(w, (Fraction, int)) for w in weights)
    total = sum(weights) if rational else sum(_number(w) for w in weights)
    if not abs(total - 1) * 10 ** (_DIGITS - 5) < 1:
        raise ValueError(
            f"{told} must be {n} exact numbers of sum 1, got {shown(weights)}, of sum {total}"
        )
    if weights[1:] != weights[:0:-1]:
        raise ValueError(f"{told} is not symmetric: {shown(weights)}")
    return tuple(map(exact_weight, weights))


@lru_cache(maxsize=256)
def _texts(mask: Weights) -> tuple[str, ...]:
    """A mask in words; half of it says all."""
    half = [str(w) for w in mask[: len(mask) // 2 + 1]]
    return *half, *half[(len(mask) - 1) // 2 : 0 : -1]


def _number(weight: Any) -> Any:
    import sympy

    return sympy.sympify(weight).evalf(_DIGITS)
