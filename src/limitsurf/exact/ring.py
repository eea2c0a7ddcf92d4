"""The ring around a smooth or a conical vertex: its eigenbasis by Fourier modes.

The ring part of the subdivision matrix is block circulant. Its points lie on one or two orbits of
the rotations, the edge neighbours and in quads the face corners (`Lattice.orbits`). With angles
measured from the middle of face 0, edge neighbour ``j`` at ``(j - 1/2) theta`` and face corner
``j`` at ``j theta``, where ``theta = 2 pi f / N``, the cosine and the sine mode of frequency ``f``
are each mapped by the same real block, which is as large as there are orbits; that of frequency 0
has one more row, for the vertex itself. Derived in ``derivations/eigenstructure.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np

from limitsurf.exact.fixed import (
    STANDARD,
    Fixed,
    Precision,
    UnsupportedSpectrum,
    diverging,
    in_words,
    mp,
    null_space,
    to_mpf,
)
from limitsurf.exact.matrices import SubdivisionMatrix
from limitsurf.scheme.scheme import Scheme

Block = list[list[Any]]
# coefficients by shift along the ring, of (row, column) orbits
Generators = dict[tuple[int, int], dict[int, Fraction]]


@dataclass(frozen=True)
class Mode:
    """One eigenvector of the ring: its Fourier frequency, parity, eigenvalue and two profiles.

    ``right`` and ``left`` are the values at (the vertex, the edge neighbours, the face corners),
    or the first two of these, before the cosine (``parity`` 0) or sine (``parity`` 1) factor;
    ``left`` includes the norm.
    """

    frequency: int
    parity: int
    eigenvalue: Any
    right: tuple[Any, ...]
    left: tuple[Any, ...]


def ring_generators(matrix: SubdivisionMatrix) -> Generators:
    """Coefficients of the rows of the first face by their shift along the ring.

    ``[a, b][j]`` is that of point ``j`` of orbit b in the new point 0 of orbit a.
    """
    n, stride = matrix.sector.faces, len(matrix.sector.lattice.orbits)
    generators: Generators = {(a, b): {} for a in range(stride) for b in range(stride)}
    for a in range(stride):
        for column, weight in matrix.rows[1 + a].items():
            if 0 < column <= stride * n:
                shift, b = divmod(column - 1, stride)
                shift = (shift + n // 2) % n - n // 2
                generators[a, b][shift] = weight
    for j in range(1, n):
        for row in range(1, 1 + stride):
            turned = {
                c if c == 0 else (c - 1 + stride * j) % (stride * n) + 1: w
                for c, w in matrix.rows[row].items()
            }
            if turned != matrix.rows[row + stride * j]:
                raise UnsupportedSpectrum("the masks do not have the symmetry of the ring")
    return generators


def centre_block(matrix: SubdivisionMatrix) -> Block:
    """The block of frequency 0 on (vertex, edge neighbours, face corners)."""
    stride = len(matrix.sector.lattice.orbits)
    block = []
    for row in matrix.rows[: 1 + stride]:
        sums: list[Any] = [Fraction(0)] * (1 + stride)
        for column, weight in row.items():
            sums[0 if column == 0 else 1 + (column - 1) % stride] += weight
        block.append(sums)
    return block


def check_centre(valence: int, block: Block) -> None:
    """Both eigenvalues of frequency 0 other than 1 must lie inside the unit circle (Jury 1964).

    The others are those of regular masks: smaller than 1.
    """
    total, product = centre_quadratic(block)
    if not (abs(product) < 1 and abs(total) < 1 + product):
        root = mp.sqrt(to_mpf(total * total - 4 * product))
        roots = [(to_mpf(total) + sign * root) / 2 for sign in (1, -1)]
        raise diverging(f"interior valence {valence}", valence, max(roots, key=abs))


def smooth_limit(matrix: SubdivisionMatrix) -> tuple[Any, ...]:
    """Weights of the vertex, of each edge neighbour and face corner in the limit position.

    The left eigenvector of eigenvalue 1, as exact as the masks (Halstead, Kass and DeRose 1993,
    appendix A; derivations/limit_masks.py).
    """
    return centre_mask(matrix.sector.faces, centre_block(matrix))


def centre_mask(faces: int, block: Block) -> tuple[Any, ...]:
    """Weights of a vertex, each edge neighbour and face corner in its limit: `smooth_limit`.

    From the block of frequency 0 of so many faces.
    """
    check_centre(faces, block)
    size = len(block)
    shifted = [[x - int(i == j) for j, x in enumerate(row)] for i, row in enumerate(block)]
    # rows of the adjugate of a matrix of rank one less are left null vectors
    mask = [cofactor(shifted, j, 0) for j in range(size)]
    total = mask[0] + sum(mask[1:])
    weights = mask[0] / total, *(x / total / faces for x in mask[1:])
    return tuple(x if isinstance(x, Fraction) or _is_long(x) else x.radsimp() for x in weights)


def ring_modes(matrix: SubdivisionMatrix, at: Precision = STANDARD) -> list[Mode]:
    """All eigenvectors of the ring."""
    sector = matrix.sector
    return _centre_modes(matrix, at) + wave_modes(
        ring_generators(matrix), sector.faces, sector.lattice.orbits, at
    )


def wave_modes(
    generators: Generators, n: int, orbits: tuple[int, ...], at: Precision = STANDARD
) -> list[Mode]:
    """The eigenvectors of positive frequency of a ring of n faces, by frequency."""
    modes = []
    for frequency in range(1, n // 2 + 1):
        angle = at.mp.mpf(2 * frequency) / n  # in units of pi

        def entry(a: int, b: int, angle: Any = angle) -> Any:
            offset = Fraction(orbits[b] - orbits[a], 2)
            return at.mp.fsum(
                at.to_mpf(w) * at.mp.cospi(angle * at.to_mpf(shift + offset))
                for shift, w in generators[a, b].items()
            )

        block = [[entry(a, b) for b in range(len(orbits))] for a in range(len(orbits))]
        if 2 * frequency == n:
            # every face corner lies on a node of the sine, every edge neighbour of the cosine
            norm = at.mp.mpf(1) / n
            for parity, orbit in ((0, 1), (1, 0)):
                if orbit < len(orbits):
                    profile = [int(k == 1 + orbit) for k in range(1 + len(orbits))]
                    left = tuple(norm * x if x else 0 for x in profile)
                    mode = Mode(frequency, parity, block[orbit][orbit], tuple(profile), left)
                    modes.append(mode)
            continue
        for eigenvalue, right, left in _block_basis(block, at.mp.mpf(2) / n, at):
            modes += [Mode(frequency, parity, eigenvalue, right, left) for parity in (0, 1)]
    return modes


def _block_basis(
    block: Block, norm: Any, at: Precision
) -> list[tuple[Any, tuple[Any, ...], tuple[Any, ...]]]:
    """Eigenvalues of a block of positive frequency, right and left profiles."""
    if len(block) == 1:
        return [(block[0][0], (0, at.mp.mpf(1)), (0, norm))]
    (ee, ef), (fe, ff) = block
    square = (ee - ff) ** 2 + 4 * ef * fe
    root = at.mp.sqrt(square)
    high, low = (ee + ff + root) / 2, (ee + ff - root) / 2
    right = [((x - ff) / fe, at.mp.mpf(1)) for x in (high, low)]
    determinant = right[0][0] * right[1][1] - right[1][0] * right[0][1]
    norm = norm / determinant
    left = (
        (norm * right[1][1], -norm * right[1][0]),
        (-norm * right[0][1], norm * right[0][0]),
    )
    return [
        (value, (0, e, f), (0, p, q))
        for value, (e, f), (p, q) in zip((high, low), right, left, strict=True)
    ]


def _centre_modes(matrix: SubdivisionMatrix, at: Precision) -> list[Mode]:
    """The eigenvectors of frequency 0: eigenvalue 1 and the roots of an exact polynomial."""
    block, n = centre_block(matrix), matrix.sector.faces
    check_centre(n, block)
    size = len(block)
    trace, determinant = centre_quadratic(block)
    square = trace * trace - 4 * determinant
    if size == 3 and square <= 0:
        text = (
            f"frequency 0 of valence {n} has no real eigenbasis: its eigenvalues other than 1 are"
        )
        half, part = to_mpf(trace) / 2, mp.sqrt(-to_mpf(square)) / 2
        found = in_words(mp.mpc(half, part)) + ", and its conjugate"
        found = found if square else f"{in_words(half)} twice"
        raise UnsupportedSpectrum(
            f"{text} {found}, need two real ones; change the scheme's vertex({n})"
        )
    root = at.mp.sqrt(at.to_mpf(square))
    # the larger root first, the other through the product: exactly zero where it is zero
    large = (at.to_mpf(trace) + (root if trace >= 0 else -root)) / 2
    values = [large] if size == 2 else [large, at.to_mpf(determinant) / large]
    values = [at.mp.mpf(1), *sorted(values, reverse=True)]
    rounded = [[at.to_mpf(x) for x in row] for row in block]
    columns = []
    for value in values:
        # the row of the vertex depends on the others
        rows = [[x - value * (i == j) for j, x in enumerate(r)] for i, r in enumerate(rounded)]
        vector = [cofactor(rows, 0, j) for j in range(size)]
        scale = vector[-1] if abs(vector[-1]) > at.equal else max(vector, key=abs)
        columns.append([x / scale for x in vector])
    right = [list(row) for row in zip(*columns, strict=True)]
    whole = sum(right[0][j] * cofactor(right, 0, j) for j in range(size))
    left = [[cofactor(right, j, k) / whole for j in range(size)] for k in range(size)]
    return [
        Mode(0, 0, value, tuple(columns[k]), (left[k][0], *(x / n for x in left[k][1:])))
        for k, value in enumerate(values)
    ]


def cofactor(matrix: Block, row: int, column: int) -> Any:
    """Cofactor of an entry of a 2 x 2 or 3 x 3 matrix."""
    if len(matrix) == 2:
        return (-1) ** (row + column) * matrix[1 - row][1 - column]
    a, b, c, d = (row + 1) % 3, (row + 2) % 3, (column + 1) % 3, (column + 2) % 3
    return matrix[a][c] * matrix[b][d] - matrix[a][d] * matrix[b][c]


def boundary_limit_mask(scheme: Scheme) -> tuple[Fraction, Fraction]:
    """Weights of a vertex and of each of its two neighbours in the limit of a boundary curve."""
    own, neighbour = scheme.boundary_vertex
    half = scheme.boundary_edge
    # left eigenvector of eigenvalue 1 of the curve's 2 x 2 block (vertex; both neighbours)
    (mask,) = null_space([[own - 1, half], [2 * neighbour, half - 1]])
    total = sum(mask)
    return mask[0] / total, mask[1] / total / 2


def _is_long(x: Any) -> bool:
    """Whether to write an algebraic number in another way would take for ever."""
    return bool(x.count_ops() > 50)


def centre_quadratic(block: Block) -> tuple[Any, Any]:
    """Sum and product of the two eigenvalues other than 1 of the block of frequency 0.

    Of a block with one orbit, which has one such eigenvalue, that and 0.
    """
    total = block[0][0] + block[1][1] - 1
    if len(block) == 2:
        short = hasattr(total, "expand") and not _is_long(total)
        return (total.expand() if short else total), Fraction(0)
    determinant = sum(x * cofactor(block, 0, j) for j, x in enumerate(block[0]))
    return total + block[2][2], determinant


def ring_rows(
    modes: list[Mode],
    n: int,
    orbits: tuple[int, ...],
    profile: str,
    rows: Sequence[int],
    at: Precision = STANDARD,
) -> dict[int, Fixed]:
    """Values of all modes at some points of the ring: {point: (modes,)}."""
    frequency = np.array([mode.frequency for mode in modes])
    parity = np.array([mode.parity for mode in modes], dtype=bool)
    turn = [at.mp.mpf(k) / n for k in range(2 * n)]
    cosine, sine = at.to_fixed([*map(at.mp.cospi, turn)]), at.to_fixed([*map(at.mp.sinpi, turn)])
    profiles = at.to_fixed([getattr(mode, profile) for mode in modes])
    result = {}
    for row in rows:
        # angle in units of pi / N per frequency
        face, orbit = divmod(row - 1, len(orbits)) if row else (0, -1)
        turns = (2 * face + orbits[orbit] if row else 0) * frequency % (2 * n)
        wave = np.where(parity, sine[turns], cosine[turns])
        result[row] = wave * profiles[:, 1 + orbit] >> at.bits
    return result


@dataclass(frozen=True, eq=False)
class FourierModes:
    """The eigenbasis of the ring of a smooth or conical vertex."""

    modes: list[Mode]
    faces: int
    orbits: tuple[int, ...]
    at: Precision = STANDARD

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
        return ring_rows(self.modes, self.faces, self.orbits, "right", points, self.at)

    def left(self) -> Fixed:
        """Left eigenvectors as rows, (ring, ring)."""
        every = range(len(self.orbits) * self.faces + 1)
        rows = ring_rows(self.modes, self.faces, self.orbits, "left", every, self.at)
        return np.stack([rows[k] for k in every], axis=1)


def fourier_ring(matrix: SubdivisionMatrix, at: Precision = STANDARD) -> FourierModes:
    """The ring of a matrix of kind "interior" or "cone"."""
    sector = matrix.sector
    return FourierModes(ring_modes(matrix, at), sector.faces, sector.lattice.orbits, at)
