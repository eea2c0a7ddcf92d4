"""The ring around a vertex of a dual scheme: its eigenbasis by Fourier modes.

The ring part of the subdivision matrix is a circulant with a symmetric mask: cosines and sines of
frequency f have the eigenvalue ``sum_j mask[j] cos(2 pi f j / n)``. Where several are one, which is
also one of the outer points, any basis of theirs will do; the one that is taken lets as few as can
be head Jordan chains. Derived in ``derivations/doo_sabin.py``.
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
        Frequency and parity of each, 0 for cosines and 1 for sines, to order equal ones by.
    right : (ring, ring) fixed
        Right eigenvectors as columns: orthogonal, of the lengths of the cosines and sines.
    at : Precision
    """

    values: list[Any]
    labels: list[tuple[int, int]]
    right: Fixed
    at: Precision

    heads: ClassVar[dict[int, int]] = {}

    def right_rows(self, points: Sequence[int]) -> dict[int, Fixed]:
        """Values of all eigenvectors at some points of the ring: {point: (modes,)}."""
        return {k: self.right[k] for k in points}

    def left(self) -> Fixed:
        """Left eigenvectors as rows, (ring, ring)."""
        n = len(self.right)
        double = np.array([1 if 2 * f in (0, n) else 2 for f, _ in self.labels], dtype=object)
        return np.asarray(self.right.T * double[:, None] // n)


def dual_ring(
    matrix: SubdivisionMatrix, outer: tuple[list[Any], list[list[Any]]], at: Precision = STANDARD
) -> DualModes:
    """The ring of a matrix of a dual scheme; `outer` has eigenvalues and left vectors of the rest.

    Those outer vectors of one eigenvalue that a ring mode of the same is coupled to are its chain.
    """
    n = matrix.sector.faces
    turn = [at.mp.mpf(2 * k) / n for k in range(n)]
    cosine, sine = at.to_fixed([*map(at.mp.cospi, turn)]), at.to_fixed([*map(at.mp.sinpi, turn)])
    mask = at.to_fixed([matrix.rows[0].get(k, 0) for k in range(n)])
    every = np.arange(n)
    labels = [(f, p) for f in range(n // 2 + 1) for p in range(1 if 2 * f in (0, n) else 2)]
    waves = [(sine if p else cosine)[f * every % n] for f, p in labels]
    right = np.stack(waves, axis=1)
    unit = 1 << at.bits
    sums = [int((mask * cosine[f * every % n]).sum()) >> at.bits for f, _ in labels]
    values = [at.mp.mpf(x) / unit for x in sums]
    values[0] = at.mp.mpf(1)
    # coupling of the modes to the left outer vectors
    others, left = outer
    size = matrix.size
    rows = [at.combine(row, dict(enumerate(right)), n) for row in matrix.rows[n:size]]
    coupled = at.product(at.to_fixed(left), np.stack(rows))
    for value in dict.fromkeys(others):
        of = [m for m, x in enumerate(others) if x == value]
        near = at.to_mpf(value)
        for parity in range(2):
            same = [
                k for k, x in enumerate(values)
                if abs(x - near) < at.equal and labels[k][1] == parity
            ]  # fmt: skip
            if len(same) > 1:
                right[:, same] = _gathered(right[:, same], coupled[np.ix_(of, same)], at)
    return DualModes(values, labels, right, at)


def _gathered(vectors: Fixed, coupled: Fixed, at: Precision) -> Fixed:
    """Orthogonal vectors (n, k) turned such that the first alone is coupled.

    All of one parity about the diagonal of the face, of which outer vectors have one combination
    that they are coupled to: the rows (m, k) of `coupled` are multiples of one.
    """
    row = max(coupled, key=lambda row: max(abs(x) for x in row))
    if at.is_noise(max(abs(x) for x in row)):
        return vectors
    # lengths differ where a frequency is half of n: to unit vectors and back
    square = [int((v * v).sum()) >> at.bits for v in vectors.T]
    length = [at.mp.sqrt(at.mp.mpf(x) / (1 << at.bits)) for x in square]
    scaled = [at.mp.mpf(int(x)) / s for x, s in zip(row, length, strict=True)]
    total = at.mp.sqrt(at.mp.fsum(x * x for x in scaled))
    # the reflection I - factor axis axis^T takes the first unit vector to that row
    axis = [x / total for x in scaled]
    axis[0] += 1 if axis[0] > 0 else -1
    factor = 2 / at.mp.fsum(x * x for x in axis)
    along = [x / s for x, s in zip(axis, length, strict=True)]
    back = [factor * x * s for x, s in zip(axis, length, strict=True)]
    moved = vectors.dot(at.to_fixed(along)) >> at.bits
    return np.asarray(vectors - (np.outer(moved, at.to_fixed(back)) >> at.bits))
