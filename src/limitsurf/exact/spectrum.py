"""Eigenbasis of a subdivision matrix around a special corner, to any number of digits.

The outer points add a rational block below that of the ring. So

    V = [[R, 0], [W G, W]],    V^-1 = [[R^-1, 0], [-G R^-1, W^-1]]

where ``R`` holds the eigenvectors of the ring (``exact/ring.py``, ``exact/sectors.py``), ``W`` the
rational eigenvectors of the outer block with eigenvalues ``d``, and
``G[m, k] = (W^-1 A_or R)[m, k] / (lambda_k - d_m)``, less ``G[m, end]`` above the bar where ring
vector k heads a Jordan chain. Where an eigenvalue of the ring meets one of the outer block, that
entry is 0 if the numerator vanishes too (smooth vertices of valence 4 m, eigenvalue 1/8); otherwise
(smooth valence 2) ring vector k heads a Jordan chain that ends in the outer eigenvector.
``derivations/subdivision_matrix.py``, ``derivations/eigenstructure.py`` and
``derivations/sectors.py`` derive all of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from math import lcm
from typing import Any, TypeAlias

import numpy as np

from limitsurf.exact.analysis import (
    check_convergence,
    check_dominant,
    leading_pair,
    orientation,
)
from limitsurf.exact.dual import DualModes, dual_ring
from limitsurf.exact.fixed import (
    BITS,
    STANDARD,
    Fixed,
    Precision,
    UnsupportedSpectrum,
    diverging,
    named,
    null_space,
    reduced,
    to_mpf,
)
from limitsurf.exact.matrices import SubdivisionMatrix, subdivision_matrix
from limitsurf.exact.ring import FourierModes, fourier_ring
from limitsurf.exact.sectors import DenseModes, carried_ring, dart_ring, open_ring
from limitsurf.scheme.scheme import Scheme
from limitsurf.scheme.sector import Sector
from limitsurf.scheme.spline import Spline

Ring: TypeAlias = FourierModes | DenseModes | DualModes


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Real Jordan basis of ``A``, in fixed numbers.

    Attributes
    ----------
    matrix : SubdivisionMatrix
    ring : FourierModes, DenseModes or DualModes
        The eigenvectors of the ring; after them come the outer ones.
    G : (outer, ring)
    W, Winv : (outer, outer)
        As in the module's formula.
    order : list of int, (K,)
        Ring, then outer eigenvectors, by decreasing modulus of their eigenvalue.
    eigenvalues : list of mpf or mpc, (K,)
        In that order.
    chains : list of int
        The indices k with ``A V[:, k] = eigenvalues[k] V[:, k] + V[:, k - 1]``.
    pairs : list of int
        The indices k of eigenvalues a + ib, followed by a - ib, whose real columns x and y are
        mapped to ``a x - b y`` and ``b x + a y``.
    pieces : (pieces, coefficients, K)
        The eigenfunctions on the regular pieces of the face as polynomials: coefficients of the
        monomials in the order of `Spline.exponents`.
    normal : tuple of int
        Two indices such that the limit normal at the vertex points along the cross product of
        their coefficients; empty where general control points have no limit normal.
    at : Precision
        What the numbers are.
    """

    matrix: SubdivisionMatrix
    ring: Ring
    G: Fixed
    W: Fixed
    Winv: Fixed
    order: list[int]
    eigenvalues: list[Any]
    chains: list[int]
    pairs: list[int]
    pieces: Fixed
    normal: tuple[int, ...]
    at: Precision

    def right_rows(self, points: Sequence[int]) -> Fixed:
        """Values of all right eigenvectors at some control points, (n, K)."""
        n, size = self.matrix.sector.ring, self.matrix.size
        rows = self.ring.right_rows([k for k in points if k < n])
        found = np.zeros((len(points), size), dtype=object)
        for row, k in zip(found, points, strict=True):
            if k < n:
                row[:n] = rows[k]
            else:
                row[:n] = self.at.product(self.W[k - n], self.G)
                row[n:] = self.W[k - n]
        return found[:, self.order]


@lru_cache(maxsize=64)
def outer_eigenbasis(
    block: tuple[tuple[Fraction, ...], ...],
) -> tuple[list[Fraction], list[list[Fraction]], list[list[Fraction]]]:
    """Rational eigenvalues d, eigenvectors W (columns) and W^-1 of the outer block.

    The outer points are refined by regular rules, so the candidates are the eigenvalues 1/2^k of
    the spline: in quads the products of those of univariate cubic knot insertion.
    """
    size = len(block)
    values: list[Fraction] = []
    columns: list[list[Fraction]] = []
    for k in range(7):
        value = Fraction(1, 2**k)
        shifted = [[x - value * (i == j) for j, x in enumerate(r)] for i, r in enumerate(block)]
        for vector in null_space(shifted):
            values.append(value)
            columns.append(vector)
    if len(values) != size:
        raise UnsupportedSpectrum("the outer block of the subdivision matrix is defective")
    W = [[columns[j][i] for j in range(size)] for i in range(size)]
    solved = reduced([row + [Fraction(i == j) for j in range(size)] for i, row in enumerate(W)])
    return values, W, [row[size:] for row in solved]


def outer_modes(
    matrix: SubdivisionMatrix,
) -> tuple[list[Fraction], list[list[Fraction]], list[list[Fraction]]]:
    """Eigenvalues and eigenvectors of the outer points, as `outer_eigenbasis` has them."""
    n, size = matrix.sector.ring, matrix.size
    return outer_eigenbasis(
        tuple(tuple(row.get(j, Fraction(0)) for j in range(n, size)) for row in matrix.rows[n:size])
    )


@lru_cache(maxsize=8)
def _dense_ring(scheme: Scheme, kind: str, faces: int, at: Precision) -> DenseModes:
    """The ring of a sector, which all its positions share."""
    sector = scheme.sector(kind, faces)
    matrix = subdivision_matrix(scheme, sector)
    if sector.carried:
        return carried_ring(matrix, ring_basis(scheme, sector.still, at), at)
    return dart_ring(scheme, matrix, at) if kind == "dart" else open_ring(scheme, matrix, at)


@lru_cache(maxsize=8)
def _dual_ring(matrix: SubdivisionMatrix, at: Precision) -> DualModes:
    values, _, left = outer_modes(matrix)
    return dual_ring(matrix, (values, left), at)


def ring_basis(scheme: Scheme, sector: Sector, at: Precision = STANDARD) -> Ring:
    """Eigenbasis of the ring of a sector."""
    if sector.lattice.dual:
        return _dual_ring(subdivision_matrix(scheme, sector), at)
    if sector.kind in ("interior", "cone"):
        return fourier_ring(subdivision_matrix(scheme, sector), at)
    return _dense_ring(scheme, sector.kind, sector.faces, at)


def spectrum(scheme: Scheme, sector: Sector, bits: int = BITS) -> Spectrum:
    """Derive the eigenbasis of `scheme` around a special corner, to so many binary digits.

    Raises
    ------
    UnsupportedSpectrum
        When the masks do not converge, or give eigenvalues or Jordan blocks that are not handled.
    """
    with named(scheme.name):
        check_convergence(scheme, sector.kind, sector.faces)
        at = Precision.of(bits)
        ring = ring_basis(scheme, sector, at)
        result = _joined(scheme, subdivision_matrix(scheme, sector), ring, at)
        if abs(result.eigenvalues[1]) > 1 - at.equal:
            mask = "corner" if sector.lattice.dual else "vertex"
            raise diverging(sector.place, sector.faces, result.eigenvalues[1], mask)
        check_dominant(scheme, sector, result.eigenvalues[1:])
    normal = ring_normal(scheme, sector.kind, sector.faces, sector.gathered)
    normal = tuple(map(result.order.index, normal))
    return replace(result, normal=normal)


def _joined(
    scheme: Scheme, matrix: SubdivisionMatrix, ring: Any, at: Precision = STANDARD
) -> Spectrum:
    """The modes of a ring, all or some, and the outer eigenvectors; `normal` is still to come."""
    size, n = matrix.size, matrix.sector.ring
    ring_values = ring.values
    modes = len(ring_values)
    values, outer, outer_inverse = outer_modes(matrix)
    eigenvalues = ring_values + [at.to_mpf(d) for d in values]
    pairs = [k for k, x in enumerate(ring_values) if isinstance(x, at.mp.mpc) and x.imag > 0]
    # the few ring points that outer points and pieces depend on
    wanted = sorted({k for piece in matrix.pieces for k in piece})
    sources = [*matrix.rows[n:size], *(matrix.rows[k] for k in wanted if k >= size)]
    touched = {c for row in sources for c in row if c < n} | {k for k in wanted if k < n}
    R = ring.right_rows(sorted(touched))
    # numerators of G, (outer, ring): sparse rational rows times R, then the small W^-1
    coupling = np.stack([at.combine(row, R, modes) for row in matrix.rows[n:size]])
    apart = {d: [value - at.to_mpf(d) for value in ring_values] for d in set(values)}
    gaps = [apart[d] for d in values]
    W, Winv, outer_heads = _chained(
        at.to_fixed(outer), at.to_fixed(outer_inverse), coupling, gaps, at
    )
    G = _links(at.product(Winv, coupling), gaps, ring.heads, pairs, at)
    heads = {**ring.heads, **{modes + m: k for m, k in outer_heads.items()}}
    order = sorted(
        range(len(eigenvalues)), key=lambda k: _rank(eigenvalues, ring.labels, heads, k, at)
    )
    chains = sorted(order.index(k) for k in heads.values())
    pairs = sorted(order.index(k) for k in pairs)
    eigenvalues = [eigenvalues[k] for k in order]
    nothing = np.zeros(size - n, dtype=object)
    rows = {k: np.concatenate([row, nothing])[order] for k, row in R.items()}
    below = np.concatenate([at.product(W, G), W], axis=1)[:, order]
    rows |= {n + k: row for k, row in enumerate(below)}
    # refined control points of every eigenvector: A V = V J gives the first K rows
    J = at.to_fixed([at.mp.re(x) for x in eigenvalues])
    turns = at.to_fixed([eigenvalues[k].imag for k in pairs])
    refined = {}
    for k in wanted:
        if k < size:
            refined[k] = rows[k] * J >> at.bits
            refined[k][chains] += rows[k][[i - 1 for i in chains]]
            for i, turn in zip(pairs, turns, strict=True):
                refined[k][i] -= rows[k][i + 1] * turn >> at.bits
                refined[k][i + 1] += rows[k][i] * turn >> at.bits
        else:
            refined[k] = at.combine(matrix.rows[k], rows, len(order))
    control = np.stack([np.stack([refined[k] for k in piece]) for piece in matrix.pieces])
    pieces = _polynomials(scheme, control)
    return Spectrum(matrix, ring, G, W, Winv, order, eigenvalues, chains, pairs, pieces, (), at)


def _links(
    numerator: Fixed,
    gaps: list[list[Any]],
    heads: dict[int, int],
    pairs: list[int],
    at: Precision,
) -> Fixed:
    """The matrix G, (outer, ring)."""
    G = np.zeros_like(numerator)
    ends = {head: end for end, head in heads.items()}
    paired = {k for p in pairs for k in (p, p + 1)}
    least = int(at.to_fixed([at.equal])[0])
    single = [k for k in range(numerator.shape[1]) if k not in paired]
    fixed: dict[int, Fixed] = {}  # rows are shared
    for m, row in enumerate(gaps):
        if id(row) not in fixed:
            known = [1 if k in paired else x for k, x in enumerate(row)]
            fixed[id(row)] = at.to_fixed(known)
        gap = fixed[id(row)]
        for k in sorted(single, key=lambda k: k in ends):
            over = numerator[m, k] - (G[m, ends[k]] if k in ends else 0)
            if abs(gap[k]) > least:
                G[m, k] = (int(over) << at.bits) // int(gap[k])
            elif k in ends:
                raise UnsupportedSpectrum("a Jordan block of more than two eigenvectors")
        for p in pairs:
            # (g_p, g_p+1) (J - d) = numerators, J = [[a, b], [-b, a]]
            x, y = at.to_fixed([row[p].real, row[p].imag])
            norm = x * x + y * y
            g, h = numerator[m, p], numerator[m, p + 1]
            G[m, p], G[m, p + 1] = (
                ((g * x + h * y) << at.bits) // norm,
                ((h * x - g * y) << at.bits) // norm,
            )
    return G


def _polynomials(scheme: Scheme, control: Fixed) -> Fixed:
    """Coefficients (pieces, monomials, K) of patches from control points (pieces, points, K)."""
    integers, scale = _whole(scheme.spline)
    return np.stack([integers.dot(piece) // scale for piece in control])


@lru_cache(maxsize=16)
def _whole(spline: Spline) -> tuple[Fixed, int]:
    """The weights of pieces as integers over one denominator."""
    scale = lcm(*(w.denominator for row in spline.pieces for w in row))
    integers = [[int(w * scale) for w in row] for row in spline.pieces]
    return np.array(integers, dtype=object), scale


@lru_cache(maxsize=256)
def ring_normal(scheme: Scheme, kind: str, faces: int, gathered: bool = False) -> tuple[int, ...]:
    """Modes of the ring whose coefficients' cross product is along the limit normal, if any."""
    sector = replace(scheme.sector(kind, faces), gathered=gathered)
    pair, functions, turns = leading_functions(scheme, sector)
    if not pair:
        return ()
    found = orientation(scheme, functions, not sector.open, turns)
    return {1: pair, -1: pair[::-1]}.get(found, ())


def leading_functions(scheme: Scheme, sector: Sector) -> tuple[tuple[int, ...], Any, int]:
    """The two modes of the ring that outweigh all others, if any, and their functions on faces.

    These as `analysis.minor_sign` takes them; and how many faces are like each.
    """
    count = 1 if sector.alike else sector.faces
    # all faces but the outermost see the same, moved along the ring
    matrices = {
        p: subdivision_matrix(scheme, replace(sector, position=p))
        for p in {0, min(1, count - 1), count - 1}
    }
    ring = ring_basis(scheme, sector)
    outer = {to_mpf(d) for matrix in matrices.values() for d in outer_modes(matrix)[0]}
    pair, without = leading_pair(ring.values, outer, ring.heads, _absent(sector, ring))
    if not pair:
        return (), None, 1
    ends = {head: end for end, head in ring.heads.items()}
    shown = [ends.get(k, k) for k in pair]
    which = sorted({*pair, *shown})
    functions = []
    for p in range(count):
        near = p if p in matrices else 1
        turn = len(sector.lattice.orbits) * (p - near)
        part = _joined(scheme, matrices[near], _SelectedModes(ring, which, turn))
        modes = [*shown, *pair] if without and pair != tuple(shown) else shown
        functions.append(part.pieces[..., [part.order.index(which.index(k)) for k in modes]])
    return pair, np.stack(functions), sector.faces // count


def _absent(sector: Sector, ring: Ring) -> set[int]:
    """Modes that control points of a sector have not: both ends of a flap are one point."""
    if sector.kind != "flap":
        return set()
    left, last = ring.left().copy(), len(sector.lattice.orbits) * sector.faces + 1
    left[:, 1] += left[:, last]
    left[:, last] = 0
    size = [max(abs(x) for x in row) for row in left]
    return {k for k, x in enumerate(size) if x >> (STANDARD.bits // 2) == 0}


class _SelectedModes:
    """Some modes of a ring, which hold the ends of their chains, seen from so many points on."""

    def __init__(self, ring: Ring, which: list[int], turn: int) -> None:
        self._ring, self._which, self._turn = ring, which, turn
        self.values, self.labels = ([x[k] for k in which] for x in (ring.values, ring.labels))
        inside = [(end, head) for end, head in ring.heads.items() if head in which]
        self.heads = {which.index(end): which.index(head) for end, head in inside}

    def right_rows(self, points: Sequence[int]) -> dict[int, Fixed]:
        """Values of these eigenvectors at some points of the ring: {point: (modes,)}."""
        around = len(self._ring.values) - 1
        there = {k: (k - 1 + self._turn) % around + 1 if k and self._turn else k for k in points}
        rows = self._ring.right_rows(sorted(set(there.values())))
        return {k: rows[row][self._which] for k, row in there.items()}


def dense_basis(spectrum: Spectrum) -> tuple[Fixed, Fixed]:
    """V, right eigenvectors as columns, and V^-1, left ones as rows, both (K, K)."""
    n, size = spectrum.matrix.sector.ring, spectrum.matrix.size
    Vinv = np.zeros((size, size), dtype=object)
    Vinv[:n, :n] = spectrum.ring.left()
    Vinv[n:, :n] = -spectrum.at.product(spectrum.G, Vinv[:n, :n])
    Vinv[n:, n:] = spectrum.Winv
    return spectrum.right_rows(range(size)), Vinv[spectrum.order]


def _chained(
    W: Fixed, Winv: Fixed, coupling: Fixed, gaps: list[list[Any]], at: Precision
) -> tuple[Fixed, Fixed, dict[int, int]]:
    """Rotate W within its eigenspaces so that every Jordan chain ends in one of its columns.

    Also returns {column of W: ring mode that heads its chain}.
    """
    heads: dict[int, int] = {}
    for k in range(coupling.shape[1]):
        places = [m for m in range(len(gaps)) if abs(gaps[m][k]) < at.equal]
        g = {m: sum(a * b for a, b in zip(Winv[m], coupling[:, k], strict=True)) for m in places}
        g = {
            m: value >> at.bits for m, value in g.items() if abs(value) >> (at.bits + at.bits // 2)
        }
        if not g:
            continue
        end = max(set(g) - set(heads), key=lambda m: abs(g[m]), default=None)
        if end is None:
            raise UnsupportedSpectrum("a Jordan block of more than two eigenvectors")
        W, Winv = W.copy(), Winv.copy()
        W[:, end] = sum(W[:, m] * value for m, value in g.items()) >> at.bits
        Winv[end] = (Winv[end] << at.bits) // g[end]
        for m in set(g) - {end}:
            Winv[m] = Winv[m] - (Winv[end] * g[m] >> at.bits)
        heads[end] = k
    return W, Winv, heads


def _rank(
    eigenvalues: list[Any],
    labels: list[tuple[int, int]],
    heads: dict[int, int],
    k: int,
    at: Precision,
) -> tuple[Any, ...]:
    """Sort key: decreasing modulus to 60 digits, positive first, then as labelled.

    The end of a Jordan chain comes right before its head, complex pairs stay together.
    """
    value = eigenvalues[k]
    modulus = at.mp.nint(abs(value) / at.equal)
    sign = 0 if isinstance(value, at.mp.mpc) or value >= 0 else 1
    vector = heads.get(k, k)
    place = (0, labels[vector], 0) if vector < len(labels) else (1, (0, 0), vector)
    return (-modulus, sign, *place, vector == k)
