"""Patches of splines of low degree for kernels: polynomials around their corner 0.

A piece of a spline is a special corner like others: its eigenfunctions are the monomials
``s^i t^j``, with the eigenvalues ``2^-(i + j)``, and its coefficients in them are what
`Spline.pieces` says. So kernels that know eigenfunctions of some degrees know splines of these
degrees, though they have none of their weights.

Four pieces of a product spline of degree d that are the children of a face are one, too: beside
the polynomial of the child at corner 0, in halves of whose size the others are seen, there are
the truncated powers ``(2 s - 1)_+^d (2 t)^j``, ``(2 s)^i (2 t - 1)_+^d`` and ``(2 s - 1)_+^d
(2 t - 1)_+^d``. They are 0 from the first halving on: eigenfunctions with the eigenvalue 0.
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
from limitsurf.tables import DenseRing, EigenTable

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
    """The eigenbasis of a regular patch around its corner 0, or of four that are one face.

    The monomials come first, by their degrees. Control points are in the order of the template;
    those of four patches by j, then i.
    """

    @property
    def unit(self) -> float:
        """The size of a patch at corner 0 whose parameters the monomials are of."""
        return 1.0 if self.size == len(self.scheme.spline.exponents) else 0.5

    def corner(self, nu: Vector) -> Array:
        """Weights (K - 1,) of all coefficients but the first in a derivative at the corner."""
        result = np.zeros(self.size - 1)
        exponents = _exponents(self.scheme.spline)[1:]
        if nu in exponents:
            factor = perm(nu[0], nu[0]) * perm(nu[1], nu[1])
            result[exponents.index(nu)] = factor / self.unit ** sum(nu)
        return result


@lru_cache(maxsize=64)
def monomials(scheme: Scheme) -> Monomials:
    """The basis of the regular patches of a scheme."""
    spline = scheme.spline
    exponents = _exponents(spline)
    order = [spline.exponents.index(powers) for powers in exponents]
    left = np.array(spline.pieces, dtype=float)[order]
    return _made(scheme, left, _extended(scheme, 0.5), [0.5 ** sum(nu) for nu in exponents])


@lru_cache(maxsize=64)
def truncated_powers(scheme: Scheme) -> Monomials:
    """The basis of the four regular patches of a split face of a product spline."""
    spline, children = scheme.spline, scheme.lattice.pieces
    d, exponents, known = spline.degree, _exponents(spline), spline.exponents
    rows = {
        origin: _spread(np.array(spline.pieces, dtype=float), d, origin)
        for origin in ((0, 0), (1, 0), (0, 1), (1, 1))
    }
    order, corner = [known.index(powers) for powers in exponents], rows[0, 0]
    left = [*corner[order]]
    values = [0.5 ** sum(nu) for nu in exponents]
    pieces = np.zeros((len(children), len(known), (d + 2) ** 2))
    pieces[:, :, : len(exponents)] = _extended(scheme, 1.0)
    for axis, origin in enumerate(((1, 0), (0, 1))):
        for power in range(d + 1):
            here = known.index(((d, power), (power, d))[axis])
            for k, child in enumerate(children):
                if not child.origin[axis]:
                    continue
                for x, share in enumerate(_shifted(child.origin[1 - axis], power)):
                    own = known.index(((d, x), (x, d))[axis])
                    pieces[k, own, len(left)] = share
            left.append(rows[origin][here] - corner[here])
    last = known.index((d, d))
    (k,) = (k for k, child in enumerate(children) if child.origin == (1, 1))
    pieces[k, last, len(left)] = 1
    left.append(rows[1, 1][last] - rows[1, 0][last] - rows[0, 1][last] + corner[last])
    values += [0.0] * (len(left) - len(values))
    return _made(scheme, np.array(left), pieces, values)


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


def _extended(scheme: Scheme, unit: float) -> Array:
    """Monomials as polynomials on the pieces, of that size, (pieces, exponents, monomials)."""
    spline, pieces = scheme.spline, scheme.lattice.pieces
    exponents = _exponents(spline)
    result = np.zeros((len(pieces), len(exponents), len(exponents)))
    for k, piece in enumerate(pieces):
        sign = -1 if piece.turned else 1
        for column, (i, j) in enumerate(exponents):
            for x, first in enumerate(_shifted(piece.origin[0], i)):
                for y, second in enumerate(_shifted(piece.origin[1], j)):
                    share = first * second * sign ** (x + y) * unit ** (i + j)
                    result[k, spline.exponents.index((x, y)), column] = share
    return result


def _spread(rows: Array, degree: int, origin: Vector) -> Array:
    """Rows over the control points of a child as such over those of all four."""
    n, (a, b) = degree + 1, origin
    result = np.zeros((len(rows), n + 1, n + 1))
    result[:, b : b + n, a : a + n] = rows.reshape(-1, n, n)
    return result.reshape(len(rows), -1)


@dataclass(frozen=True)
class Cover:
    """Patches as kernels are to have them, of kinds that they know.

    Attributes
    ----------
    splines : bool
        Whether regular patches are evaluated as splines: those of the `PatchTable` are as they are.
    codes, kind, row, turn : (n,)
        As in a `PatchTable`, but that four patches may be one more, whose kind and row they have.
    controls : list of (patches, K)
        Control points by kind.
    tables : list of EigenTable, or None
        Eigenbases by kind.
    """

    splines: bool
    codes: Array
    kind: Array
    row: Array
    turn: Array
    controls: Sequence[Array]
    tables: Sequence[EigenTable | None]

    @classmethod
    def of(cls, patches: PatchTable, tables: Sequence[EigenTable | None], scheme: Scheme) -> Cover:
        """Those of the patches of a scheme whose special corners have these tables."""
        codes, controls = patches.codes, patches.controls
        own = patches.kind, patches.row, patches.turn
        if holding(scheme.spline).directions == scheme.spline.directions:
            return cls(True, codes, *own, controls, tables)
        kind, row, turn = (x.astype(np.int64) for x in own)
        first, codes = len(tables), codes.copy()
        kind[kind == REGULAR] = first
        splines = [x[:0] for x in controls[: STRIP + 1]]
        if not scheme.spline.is_product:
            own_controls = [*splines, *controls[STRIP + 1 :], controls[REGULAR]]
            return cls(False, codes, kind, row, turn, own_controls, [*tables, monomials(scheme)])
        faces, parts, grids = _faces_of_four(patches, scheme)
        codes[faces] = len(kind) + np.arange(len(faces))
        kind[parts], row[parts] = first + 1, np.arange(len(faces))[:, None]
        rest = kind == first
        regular, row[rest] = controls[REGULAR][row[rest]], np.arange(rest.sum())
        return cls(
            False,
            codes,
            np.concatenate([kind, np.full(len(faces), first + 1)]),
            np.concatenate([row, np.arange(len(faces))]),
            np.concatenate([turn, np.zeros(len(faces), dtype=np.int64)]),
            [*splines, *controls[STRIP + 1 :], regular, grids],
            [*tables, monomials(scheme), truncated_powers(scheme)],
        )


def _faces_of_four(patches: PatchTable, scheme: Scheme) -> tuple[Array, Array, Array]:
    """Split limit faces (n,) of four regular patches, these (n, 4), and their control points.

    (n, (d + 2)^2), by j, then i.
    """
    lattice, n = scheme.lattice, scheme.spline.degree + 1
    codes = patches.codes.astype(np.int64)
    face = np.flatnonzero(codes[: patches.n_limit_faces] <= -2)
    parts = codes[(patches.n_limit_faces + 4 * (-2 - codes[face]))[:, None] + np.arange(4)]
    whole = (parts >= 0).all(axis=1)
    whole[whole] = (
        (patches.kind[parts[whole]] == REGULAR) & (patches.turn[parts[whole]] == 0)
    ).all(axis=1)
    face, parts = face[whole], parts[whole]
    own = patches.controls[REGULAR][patches.row[parts]].reshape(len(face), 4, n, n)
    grid = np.empty((len(face), n + 1, n + 1), dtype=own.dtype)
    places = [
        (slot, np.s_[:, b : b + n, a : a + n])
        for slot, (a, b) in zip(lattice.parts, (x.origin for x in lattice.children), strict=True)
    ]
    for slot, place in places:
        grid[place] = own[:, slot]
    same = np.ones(len(face), dtype=bool)
    for slot, place in places:
        same &= (grid[place] == own[:, slot]).all(axis=(1, 2))
    return face[same], parts[same], grid[same].reshape(-1, (n + 1) ** 2)
