"""The ring around a smooth or a conical vertex: its eigenbasis by Fourier modes.

The ring part of the subdivision matrix is block circulant. With angles measured from the diagonal
of face 0, edge neighbour ``j`` at ``(j - 1/2) theta`` and face corner ``j`` at ``j theta``, where
``theta = 2 pi f / N``, the cosine and the sine mode of frequency ``f`` are each mapped by the same
real 2 x 2 block; frequency 0 has a 3 x 3 block with the vertex itself. Derived in
``derivations/eigenstructure.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np

from limitsurf.exact.fixed import (
    BITS,
    EQUAL,
    Fixed,
    UnsupportedSpectrum,
    diverging,
    mp,
    null_space,
    to_fixed,
    to_mpf,
)
from limitsurf.exact.matrices import SubdivisionMatrix
from limitsurf.exact.scheme import Scheme


@dataclass(frozen=True)
class Mode:
    """One eigenvector of the ring: its Fourier frequency, parity, eigenvalue and two profiles.

    ``right`` and ``left`` are the values at (the vertex, the edge neighbours, the face corners)
    before the cosine (``parity`` 0) or sine (``parity`` 1) factor; ``left`` includes the norm.
    """

    frequency: int
    parity: int
    eigenvalue: Any
    right: tuple[Any, Any, Any]
    left: tuple[Any, Any, Any]


def ring_generators(matrix: SubdivisionMatrix) -> dict[str, dict[int, Fraction]]:
    """Coefficients of the edge row and the face row by their shift j along the ring.

    ``ee[j]``: of ``e_j`` in the new ``e_0``; ``ef``: of ``f_j`` in it; ``fe``, ``ff``: in the new
    ``f_0``; ``centre``: the 3 x 3 block of frequency 0 by (row, column).
    """
    n = matrix.sector.faces
    generators: dict[str, dict[int, Fraction]] = {"ee": {}, "ef": {}, "fe": {}, "ff": {}}
    for row, name in ((1, "e"), (2, "f")):
        for column, weight in matrix.rows[row].items():
            if 0 < column <= 2 * n:
                shift, kind = divmod(column - 1, 2)
                shift = (shift + n // 2) % n - n // 2
                generators[name + "ef"[kind]][shift] = weight
    for j in range(1, n):
        for row in (1, 2):
            turned = {
                c if c == 0 else (c - 1 + 2 * j) % (2 * n) + 1: w
                for c, w in matrix.rows[row].items()
            }
            if turned != matrix.rows[row + 2 * j]:
                raise UnsupportedSpectrum("the masks do not have the symmetry of the ring")
    return generators


def centre_block(matrix: SubdivisionMatrix) -> list[list[Fraction]]:
    """The 3 x 3 block of frequency 0 on (vertex, edge neighbours, face corners)."""
    block = []
    for row in matrix.rows[:3]:
        sums = [Fraction(0)] * 3
        for column, weight in row.items():
            sums[0 if column == 0 else 2 - column % 2] += weight
        block.append(sums)
    return block


def _check_convergence(valence: int, block: list[list[Fraction]]) -> None:
    """Both eigenvalues of frequency 0 other than 1 must lie inside the unit circle (Jury 1964).

    The others are those of regular masks: smaller than 1.
    """
    total, product = centre_quadratic(block)
    if not (abs(product) < 1 and abs(total) < 1 + product):
        root = mp.sqrt(to_mpf(total * total - 4 * product))
        roots = [(to_mpf(total) + sign * root) / 2 for sign in (1, -1)]
        raise diverging(f"interior valence {valence}", valence, max(roots, key=abs))


def limit_mask(matrix: SubdivisionMatrix) -> tuple[Fraction, Fraction, Fraction]:
    """Weights of the vertex, of each edge neighbour and face corner in the limit position.

    The left eigenvector of eigenvalue 1, an exact rational (Halstead, Kass and DeRose 1993,
    appendix A; derivations/limit_masks.py).
    """
    return centre_mask(matrix.sector.faces, centre_block(matrix))


def centre_mask(faces: int, block: list[list[Fraction]]) -> tuple[Fraction, Fraction, Fraction]:
    """The same from the block of frequency 0 of so many faces."""
    _check_convergence(faces, block)
    transposed = [[block[j][i] - (i == j) for j in range(3)] for i in range(3)]
    (mask,) = null_space(transposed)
    total = sum(mask)
    return mask[0] / total, mask[1] / total / faces, mask[2] / total / faces


def ring_modes(matrix: SubdivisionMatrix) -> list[Mode]:
    """All ``2 N + 1`` eigenvectors of the ring."""
    return _centre_modes(matrix) + wave_modes(ring_generators(matrix), matrix.sector.faces)


def wave_modes(generators: dict[str, dict[int, Fraction]], n: int) -> list[Mode]:
    """The eigenvectors of positive frequency of a ring of n faces, by frequency."""
    modes = []
    for frequency in range(1, n // 2 + 1):
        angle = mp.mpf(2 * frequency) / n  # in units of pi

        def entry(name: str, offset: Fraction, angle: Any = angle) -> Any:
            return mp.fsum(
                to_mpf(w) * mp.cospi(angle * to_mpf(shift + offset))
                for shift, w in generators[name].items()
            )

        half = Fraction(1, 2)
        ee, ff = entry("ee", Fraction(0)), entry("ff", Fraction(0))
        ef, fe = entry("ef", half), entry("fe", -half)
        if 2 * frequency == n:
            # every face corner lies on a node of the sine, every edge neighbour of the cosine
            norm = mp.mpf(1) / n
            modes.append(Mode(frequency, 0, ff, (0, 0, 1), (0, 0, norm)))
            modes.append(Mode(frequency, 1, ee, (0, 1, 0), (0, norm, 0)))
            continue
        square = (ee - ff) ** 2 + 4 * ef * fe
        root = mp.sqrt(square)
        high, low = (ee + ff + root) / 2, (ee + ff - root) / 2
        right = [((x - ff) / fe, mp.mpf(1)) for x in (high, low)]
        determinant = right[0][0] * right[1][1] - right[1][0] * right[0][1]
        norm = 2 / (n * determinant)
        left = (
            (norm * right[1][1], -norm * right[1][0]),
            (-norm * right[0][1], norm * right[0][0]),
        )
        for eigenvalue, (e, f), (p, q) in zip((high, low), right, left, strict=True):
            modes += [
                Mode(frequency, parity, eigenvalue, (0, e, f), (0, p, q)) for parity in (0, 1)
            ]
    return modes


def _centre_modes(matrix: SubdivisionMatrix) -> list[Mode]:
    """The three eigenvectors of frequency 0: eigenvalue 1 and the roots of a rational quadratic."""
    block = centre_block(matrix)
    _check_convergence(matrix.sector.faces, block)
    trace, determinant = centre_quadratic(block)
    square = trace * trace - 4 * determinant
    if square <= 0:
        valence = matrix.sector.faces
        raise UnsupportedSpectrum(f"frequency 0 of valence {valence} has no real eigenbasis")
    root = mp.sqrt(to_mpf(square))
    # the larger root first, the other through the product: exactly zero where it is zero
    large = (to_mpf(trace) + (root if trace >= 0 else -root)) / 2
    values = [mp.mpf(1), *sorted((large, to_mpf(determinant) / large), reverse=True)]
    right = mp.matrix(3, 3)
    for k, value in enumerate(values):
        (a, b, c), (d, e, f) = (
            [to_mpf(x) - value * (i == j) for j, x in enumerate(block[i])] for i in (1, 2)
        )
        vector = [b * f - c * e, c * d - a * f, a * e - b * d]
        scale = vector[2] if abs(vector[2]) > EQUAL else max(vector, key=abs)
        for i in range(3):
            right[i, k] = vector[i] / scale
    left = _inverse(right)
    n = matrix.sector.faces
    return [
        Mode(
            0,
            0,
            value,
            (right[0, k], right[1, k], right[2, k]),
            (left[k, 0], left[k, 1] / n, left[k, 2] / n),
        )
        for k, value in enumerate(values)
    ]


def _inverse(matrix: Any) -> Any:
    """Inverse of a 3 x 3 matrix by cofactors; mpmath's own changes the precision it works in."""
    cofactors = mp.matrix(3, 3)
    for i in range(3):
        for j in range(3):
            a, b, c, d = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            cofactors[j, i] = matrix[a, c] * matrix[b, d] - matrix[a, d] * matrix[b, c]
    determinant = sum(matrix[0, k] * cofactors[k, 0] for k in range(3))
    return cofactors / determinant


def boundary_limit_mask(scheme: Scheme) -> tuple[Fraction, Fraction]:
    """Weights of a vertex and of each of its two neighbours in the limit of a boundary curve."""
    own, neighbour = scheme.boundary_vertex
    half = scheme.boundary_edge
    # left eigenvector of eigenvalue 1 of the curve's 2 x 2 block (vertex; both neighbours)
    (mask,) = null_space([[own - 1, half], [2 * neighbour, half - 1]])
    total = sum(mask)
    return mask[0] / total, mask[1] / total / 2


def centre_quadratic(block: list[list[Fraction]]) -> tuple[Fraction, Fraction]:
    """Sum and product of the two eigenvalues other than 1 of the block of frequency 0."""
    (a, b, c), (d, e, f), (g, h, i) = block
    return a + e + i - 1, a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)


def ring_rows(modes: list[Mode], n: int, profile: str, rows: Sequence[int]) -> dict[int, Fixed]:
    """Values of all modes at some points of the ring: {point: (modes,)}."""
    frequency = np.array([mode.frequency for mode in modes])
    parity = np.array([mode.parity for mode in modes], dtype=bool)
    turn = [mp.mpf(k) / n for k in range(2 * n)]
    cosine, sine = to_fixed([*map(mp.cospi, turn)]), to_fixed([*map(mp.sinpi, turn)])
    profiles = to_fixed([getattr(mode, profile) for mode in modes])
    result = {}
    for row in rows:
        # angle in units of pi / N per frequency: the vertex 0, edges 2 j - 1, faces 2 j
        turns = (row - 2 if row else 0) * frequency % (2 * n)
        wave = np.where(parity, sine[turns], cosine[turns])
        result[row] = wave * profiles[:, (2 - row % 2 if row else 0)] >> BITS
    return result


@dataclass(frozen=True, eq=False)
class FourierRing:
    """The eigenbasis of the ring of a smooth or conical vertex."""

    modes: list[Mode]
    faces: int

    @property
    def values(self) -> list[Any]:
        """Eigenvalues, in the order of the modes."""
        return [mode.eigenvalue for mode in self.modes]

    @property
    def labels(self) -> list[tuple[int, int]]:
        """Frequency and parity, to order equal eigenvalues by."""
        return [(mode.frequency, mode.parity) for mode in self.modes]

    heads: ClassVar[dict[int, int]] = {}

    def right_rows(self, points: Sequence[int]) -> dict[int, Fixed]:
        """Values of all eigenvectors at some points of the ring: {point: (modes,)}."""
        return ring_rows(self.modes, self.faces, "right", points)

    def left(self) -> Fixed:
        """Left eigenvectors as rows, (ring, ring)."""
        every = range(2 * self.faces + 1)
        rows = ring_rows(self.modes, self.faces, "left", every)
        return np.stack([rows[k] for k in every], axis=1)


def fourier_ring(matrix: SubdivisionMatrix) -> FourierRing:
    """The ring of a matrix of kind "interior" or "cone"."""
    return FourierRing(ring_modes(matrix), matrix.sector.faces)
