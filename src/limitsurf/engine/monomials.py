"""Patches of splines of low degree for kernels: polynomials around their corner 0.

A piece of a spline is a special corner like others: its eigenfunctions are the monomials
``s^i t^j``, with the eigenvalues ``2^-(i + j)``, and its coefficients in them are what
`Spline.pieces` says (``derivations/pieces.py``). So kernels that know eigenfunctions of some
degrees know splines of these degrees, though they have none of their weights.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import comb, perm
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.patches import REGULAR, STRIP, PatchTable
from limitsurf.scheme.scheme import Scheme
from limitsurf.scheme.sector import Sector
from limitsurf.scheme.spline import BICUBIC, QUARTIC, Spline, Vector
from limitsurf.tables import DenseRing, EigenTable, StripTables

Array = NDArray[Any]


def holding(spline: Spline) -> Spline:
    """The spline with kernels, if there is one, whose pieces have all monomials of this one's.

    Examples
    --------
    >>> from limitsurf.engine.monomials import holding
    >>> from limitsurf.scheme.spline import BIQUADRATIC
    >>> holding(BIQUADRATIC).name
    'bicubic B-spline'
    """
    own = Counter(spline.directions)
    return next((x for x in (BICUBIC, QUARTIC) if own <= Counter(x.directions)), spline)


class Monomials(EigenTable):
    """The eigenbasis of a regular patch around its corner 0: the monomials, by their degrees.

    Control points are in the order of the template.
    """

    def corner(self, nu: Vector) -> Array:
        """Weights (K - 1,) of all coefficients but the first in a derivative at the corner."""
        result = np.zeros(self.size - 1)
        exponents = _exponents(self.scheme.spline)[1:]
        if nu in exponents:
            result[exponents.index(nu)] = perm(nu[0], nu[0]) * perm(nu[1], nu[1])
        return result


@lru_cache(maxsize=64)
def monomials(scheme: Scheme) -> Monomials:
    """The basis of the regular patches of a scheme."""
    spline = scheme.spline
    exponents = _exponents(spline)
    order = [spline.exponents.index(powers) for powers in exponents]
    left = np.array(spline.pieces, dtype=float)[order]
    return _made(scheme, left, _extended(scheme), [0.5 ** sum(nu) for nu in exponents])


def _made(scheme: Scheme, left: Array, pieces: Array, values: Sequence[float]) -> Monomials:
    size, none = len(left), np.zeros(0, dtype=np.int64)
    return Monomials(
        scheme=scheme,
        sector=Sector("interior", scheme.lattice.valence, 0, scheme.lattice),
        provenance={},
        ring=DenseRing(left),
        rates=np.array([values, [0.0] * size]),
        pieces=pieces,
        chains=none,
        pairs=none,
        angles=np.zeros(0),
        normal=np.array([1, 2]),
        links=np.zeros((0, size)),
        outer=np.zeros((0, 0)),
        order=np.arange(size),
    )


def _exponents(spline: Spline) -> list[Vector]:
    """Exponents of monomials by degree; of the first, s comes first."""
    return sorted(spline.exponents, key=lambda powers: (sum(powers), powers[1]))


def _shifted(start: int, power: int) -> list[int]:
    """Coefficients of ``(start + x)^power``."""
    return [comb(power, x) * start ** (power - x) for x in range(power + 1)]


def _extended(scheme: Scheme) -> Array:
    """Monomials as polynomials on the pieces, of half the size, (pieces, exponents, monomials)."""
    spline, pieces = scheme.spline, scheme.lattice.pieces
    exponents = _exponents(spline)
    result = np.zeros((len(pieces), len(exponents), len(exponents)))
    for k, piece in enumerate(pieces):
        sign = -1 if piece.turned else 1
        for column, (i, j) in enumerate(exponents):
            for x, first in enumerate(_shifted(piece.origin[0], i)):
                for y, second in enumerate(_shifted(piece.origin[1], j)):
                    share = first * second * sign ** (x + y) * 0.5 ** (i + j)
                    result[k, spline.exponents.index((x, y)), column] = share
    return result


def polynomials(spline: Spline, strips: StripTables, degrees: Sequence[int]) -> Array:
    """Coefficients of monomials of the pieces of splines, (pieces, monomials, control points).

    Of regular ones, then of strips; or, where there are such splines both ways, of these by halves
    along s, fastest, then along t. Monomials have these degrees in s beside each power of t.
    """
    across = np.array(strips.pieces, dtype=float)
    whole = [(i, j) for j, most in enumerate(degrees) for i in range(most + 1)]
    rows = [spline.exponents.index(powers) for powers in whole]
    regular = np.array(spline.pieces, dtype=float)[None, rows]
    if not across.size:
        return regular
    across = np.pad(across, ((0, 0), (0, 4 - across.shape[1]), (0, 0)))
    along = np.array(spline.curve, dtype=float)[None]
    if strips.both:
        regular, along = regular[:0], across
    both = np.einsum("pjy,qix->pqjiyx", across, along)
    return np.concatenate([regular, both.reshape(-1, *regular.shape[1:])])


@dataclass(frozen=True)
class Cover:
    """Patches as kernels are to have them, of kinds that they know.

    Attributes
    ----------
    splines : bool
        Whether regular patches are evaluated as splines: those of the `PatchTable` are as they are.
    kind : (n,)
        As in a `PatchTable`, but that quads of a dual scheme are what is regular.
    controls : list of (patches, K)
        Control points by kind.
    tables : list of EigenTable, or None
        Eigenbases by kind.
    """

    splines: bool
    kind: Array
    controls: Sequence[Array]
    tables: Sequence[EigenTable | None]

    @classmethod
    def of(cls, patches: PatchTable, tables: Sequence[EigenTable | None], scheme: Scheme) -> Cover:
        """Those of the patches of a scheme whose special corners have these tables."""
        controls = patches.controls
        if holding(scheme.spline).directions == scheme.spline.directions:
            return cls(True, patches.kind, controls, tables)
        kind = patches.kind.astype(np.int64)
        kind[kind == REGULAR] = len(tables)
        centers = controls[STRIP]  # of a dual scheme, else none
        kind[kind == STRIP] = REGULAR
        own = [centers, centers[:0], *controls[STRIP + 1 :], controls[REGULAR]]
        return cls(False, kind, own, [*tables, monomials(scheme)])
