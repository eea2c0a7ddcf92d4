"""The ring around a vertex of a dual scheme: its eigenbasis by Fourier modes.

The ring part of the subdivision matrix is a circulant with a symmetric mask: cosines and sines of
frequency f have the eigenvalue ``sum_j mask[j] cos(2 pi f j / n)``. Where several of one parity
have one eigenvalue, which the outer points have too, one of them heads a Jordan chain; a multiple
of it is taken away from the others, which then have no part in that. A gathered ring has the slow
waves alone, and of all others what they are at three points. Derived in
``derivations/doo_sabin.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar, TypeAlias

import numpy as np

from limitsurf.exact.fixed import STANDARD, Fixed, Precision
from limitsurf.exact.matrices import SubdivisionMatrix
from limitsurf.scheme.dual import DualScheme


def center_pieces(scheme: DualScheme) -> list[list[list[Fraction]]]:
    """The curve along a quad amid others: its halves, the second first, as `strip_pieces` has them.

    Coefficients of powers by vertices: that before the quad, its two, and that after it.
    """
    stencils = [scheme.spline.curve_stencil(2 + k) for k in range(4)]
    rows = [[row.get(k, Fraction(0)) for k in range(4)] for row in stencils]
    return [
        [
            [sum((w * row[k] for w, row in zip(power, near, strict=True)), Fraction(0))
             for k in range(4)]
            for power in scheme.spline.curve
        ]
        for near in (rows[1:], rows[:3])
    ]  # fmt: skip


@dataclass(frozen=True, eq=False)
class DualModes:
    """The eigenbasis of the ring of a vertex of a dual scheme.

    Attributes
    ----------
    values : list of mpf
        Eigenvalues, in the order of the modes.
    labels : list of (int, int)
        Frequency and parity of each, 0 for cosines and 1 for sines, to order equal ones by; that
        which heads a chain comes before those that it is taken away from.
    waves : list of (int, int)
        Which frequency and parity they are; in a gathered ring 2 and 3 are all that is faster.
    right : (ring, ring) fixed
        Right eigenvectors as columns: cosines and sines, times `taken`.
    taken : {mode: (mode that is taken away from it, how often)}
    at : Precision
    plain : callable
        What gives the rows of left eigenvectors, but for `taken`.
    """

    values: list[Any]
    labels: list[tuple[int, int]]
    waves: list[tuple[int, int]]
    right: Fixed
    taken: dict[int, tuple[int, Any]]
    at: Precision
    plain: Callable[[], Fixed]

    heads: ClassVar[dict[int, int]] = {}

    def right_rows(self, points: Sequence[int]) -> dict[int, Fixed]:
        """Values of all eigenvectors at some points of the ring: {point: (modes,)}."""
        return {k: self.right[k] for k in points}

    def left(self) -> Fixed:
        """Left eigenvectors as rows, (ring, ring)."""
        left = self.plain()
        found = left.copy()
        for k, (pivot, share) in self.taken.items():
            found[pivot] += int(share) * left[k] >> self.at.bits
        return np.asarray(found)


def wave_columns(n: int, waves: Sequence[tuple[int, int]], at: Precision) -> Fixed:
    """Cosines and sines of some frequencies at n points, as columns."""
    turn = [at.mp.mpf(2 * k) / n for k in range(n)]
    both = at.to_fixed([*map(at.mp.cospi, turn)]), at.to_fixed([*map(at.mp.sinpi, turn)])
    every = np.arange(n)
    return np.stack([both[parity][f * every % n] for f, parity in waves], axis=1)


def norm_of(n: int, frequency: int) -> int:
    """N over the square of the length of such a wave."""
    return 1 if 2 * frequency in (0, n) else 2


def ring_waves(n: int) -> list[tuple[int, int]]:
    """Frequencies and parities of all waves at n points."""
    return [(f, p) for f in range(n // 2 + 1) for p in range(norm_of(n, f))]


def dual_ring(
    matrix: SubdivisionMatrix, outer: tuple[list[Any], list[list[Any]]], at: Precision = STANDARD
) -> DualModes:
    """The ring of a matrix of a dual scheme.

    `outer` are the eigenvalues and the left eigenvectors of the outer block.
    """
    parts = _gathered_ring if matrix.sector.gathered else _plain_ring
    values, waves, right, plain = parts(matrix, at)
    labels = list(waves)
    taken = _taken(matrix, outer, values, waves, right, labels, at)
    return DualModes(values, labels, waves, right, taken, at, plain)


_Parts: TypeAlias = tuple[list[Any], list[tuple[int, int]], Fixed, Callable[[], Fixed]]


def _plain_ring(matrix: SubdivisionMatrix, at: Precision) -> _Parts:
    """Eigenvalues, waves, right eigenvectors, and what gives left ones, but for chains."""
    n = matrix.sector.faces
    waves = ring_waves(n)
    mask = at.to_fixed([matrix.rows[0].get(k, 0) for k in range(n)])
    cosines = wave_columns(n, [(f, 0) for f, _ in waves], at)
    values = [at.mp.mpf(int(x)) / (1 << at.bits) for x in mask.dot(cosines) >> at.bits]
    values[0] = at.mp.mpf(1)

    def left() -> Fixed:
        norm = np.array([norm_of(n, f) for f, _ in waves], dtype=object)
        return np.asarray(wave_columns(n, waves, at).T * norm[:, None] // n)

    return values, waves, wave_columns(n, waves, at), left


def _gathered_ring(matrix: SubdivisionMatrix, at: Precision) -> _Parts:
    """The same of a gathered ring: what is left of three points is faster than once around."""
    (own, once), turn = (at.to_mpf(matrix.rows[k][k]) for k in (0, 4)), at.mp.mpf(2)
    cos, sin = at.mp.cospi(turn / matrix.sector.faces), at.mp.sinpi(turn / matrix.sector.faces)
    waves = [(0, 0), (1, 0), (1, 1), (2, 0), (3, 0), (2, 1)]
    right = [
        [1, 1, 0, 1, 0, 0],
        [1, cos, sin, 0, 1, 1],
        [1, cos, -sin, 0, 1, -1],
        [1, 0, 0, 0, 0, 0],
        [1, 1, 0, 0, 0, 0],
        [1, 0, 1, 0, 0, 0],
    ]
    half = at.mp.mpf(1) / 2
    left = [
        [0, 0, 0, 1, 0, 0],
        [0, 0, 0, -1, 1, 0],
        [0, 0, 0, -1, 0, 1],
        [1, 0, 0, 0, -1, 0],
        [0, half, half, cos - 1, -cos, 0],
        [0, half, -half, sin, 0, -sin],
    ]
    values = [at.mp.mpf(1), once, once, own, own, own]
    return values, waves, at.to_fixed(right), lambda: at.to_fixed(left)


def _taken(
    matrix: SubdivisionMatrix,
    outer: tuple[list[Any], list[list[Any]]],
    values: list[Any],
    waves: list[tuple[int, int]],
    right: Fixed,
    labels: list[tuple[int, int]],
    at: Precision,
) -> dict[int, tuple[int, Any]]:
    """`DualModes.taken`, of modes whose right eigenvectors and labels change by it."""
    n, size = matrix.sector.ring, matrix.size
    # how the modes are coupled to the left outer vectors
    others, left = outer
    rows = [at.combine(row, dict(enumerate(right)), n) for row in matrix.rows[n:size]]
    coupled = at.product(at.to_fixed(left), np.stack(rows))
    taken: dict[int, tuple[int, Any]] = {}
    for value in dict.fromkeys(others):
        of, near = [m for m, x in enumerate(others) if x == value], at.to_mpf(value)
        for parity in range(2):
            same = [
                k
                for k, x in enumerate(values)
                if abs(x - near) < at.equal and waves[k][1] == parity
            ]
            part = coupled[np.ix_(of, same)]
            if len(same) < 2 or at.is_noise(max(abs(int(x)) for x in part.flat)):
                continue
            # of one parity all couplings are multiples of one
            row = max(part, key=lambda row: max(abs(x) for x in row))
            pivot = max(range(len(same)), key=lambda k: abs(row[k]))
            first = same[pivot]
            for k, x in zip(same, row, strict=True):
                share = (int(x) << at.bits) // int(row[pivot])
                if k != first and not at.is_noise(share):
                    taken[k] = first, share
                    right[:, k] -= share * right[:, first] >> at.bits
            labels[same[0]], labels[first] = labels[first], labels[same[0]]
    return taken
