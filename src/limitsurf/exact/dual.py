"""The ring around a vertex of a dual scheme: its eigenbasis by Fourier modes.

The ring part of the subdivision matrix is a circulant with a symmetric mask: cosines and sines of
frequency f have the eigenvalue ``sum_j mask[j] cos(2 pi f j / n)``. Where several of one parity
have one eigenvalue, which the outer points have too, one of them heads a Jordan chain; a multiple
of it is taken away from the others, which then have no part in that. Derived in
``derivations/doo_sabin.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from limitsurf.exact.fixed import STANDARD, Fixed, Precision
from limitsurf.exact.matrices import SubdivisionMatrix


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
        Which frequency and parity they are.
    right : (ring, ring) fixed
        Cosines and sines as columns, times `taken`.
    taken : {mode: (mode that is taken away from it, how often)}
    at : Precision
    """

    values: list[Any]
    labels: list[tuple[int, int]]
    waves: list[tuple[int, int]]
    right: Fixed
    taken: dict[int, tuple[int, Any]]
    at: Precision

    heads: ClassVar[dict[int, int]] = {}

    def right_rows(self, points: Sequence[int]) -> dict[int, Fixed]:
        """Values of all eigenvectors at some points of the ring: {point: (modes,)}."""
        return {k: self.right[k] for k in points}

    def left(self) -> Fixed:
        """Left eigenvectors as rows, (ring, ring)."""
        n = len(self.right)
        waves = wave_columns(n, self.waves, self.at)
        norm = np.array([norm_of(n, f) for f, _ in self.waves], dtype=object)
        left = waves.T * norm[:, None] // n
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
    n, size = matrix.sector.faces, matrix.size
    waves = ring_waves(n)
    right, labels = wave_columns(n, waves, at), list(waves)
    mask = at.to_fixed([matrix.rows[0].get(k, 0) for k in range(n)])
    cosines = wave_columns(n, [(f, 0) for f, _ in waves], at)
    values = [at.mp.mpf(int(x)) / (1 << at.bits) for x in mask.dot(cosines) >> at.bits]
    values[0] = at.mp.mpf(1)
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
    return DualModes(values, labels, waves, right, taken, at)
