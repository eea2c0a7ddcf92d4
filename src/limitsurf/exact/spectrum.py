"""Eigenbasis of a subdivision matrix around an interior vertex, to any number of digits.

The ring part of the matrix is block circulant. With angles measured from the diagonal of face 0,
edge neighbour ``j`` at ``(j - 1/2) theta`` and face corner ``j`` at ``j theta``, where
``theta = 2 pi f / N``, the cosine and the sine mode of frequency ``f`` are each mapped by the same
real 2 x 2 block; frequency 0 has a 3 x 3 block with the vertex itself. The seven outer points add
a rational block below. So

    V = [[R, 0], [W G, W]],    V^-1 = [[R^-1, 0], [-G R^-1, W^-1]]

where ``R`` holds the Fourier modes, ``W`` the rational eigenvectors of the outer block with
eigenvalues ``d``, and ``G[m, k] = (W^-1 A_or R)[m, k] / (lambda_k - d_m)``. Where an eigenvalue
of the ring meets one of the outer block, that entry is 0 if the numerator vanishes too (N = 4 m,
eigenvalue 1/8); otherwise (N = 2, eigenvalue 1/8) ring mode k heads a Jordan chain that ends in
the outer eigenvector, and V^-1 A V = J has a 1 there.
``derivations/subdivision_matrix.py`` and ``derivations/eigenstructure.py`` derive all of it.

Numbers are integers in units of ``2**-BITS`` (about 96 digits): deterministic on every machine,
and fast enough that valence 360 takes seconds.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import lcm
from typing import Any

import mpmath
import numpy as np
from mpmath.libmp import to_fixed as fixed_point

from limitsurf.exact.matrices import SubdivisionMatrix, subdivision_matrix
from limitsurf.exact.scheme import Scheme

BITS = 320
# a context of our own: the precision of mpmath.mp belongs to the user, in all threads at once
mp = mpmath.MPContext()
mp.prec = BITS + 64
# Two computed eigenvalues, or a numerator and zero, that agree to this are equal: 60 of 96 digits
EQUAL = mp.mpf(10) ** -60

Fixed = np.ndarray[Any, np.dtype[np.object_]]


class UnsupportedSpectrum(ValueError):
    """Masks that do not converge, complex eigenvalues, or Jordan blocks that are not handled."""


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


@dataclass(frozen=True)
class Spectrum:
    """Jordan basis of ``A`` in units of ``2**-BITS``, in a form that grows with N, not N^2.

    Attributes
    ----------
    matrix : SubdivisionMatrix
    modes : list of Mode
        The ``2 N + 1`` eigenvectors of the ring; after them come the seven outer ones.
    G : (7, 2 N + 1)
    W, Winv : (7, 7)
        As in the module's formula.
    order : list of int, (K,)
        Modes, then outer eigenvectors, by decreasing modulus of their eigenvalue.
    eigenvalues : list of mpf, (K,)
        In that order.
    chains : list of int
        The indices k with ``A V[:, k] = eigenvalues[k] V[:, k] + V[:, k - 1]``.
    pieces : (3, 16, K)
        B-spline control points of the eigenfunctions on the regular pieces.
    smooth : bool
        Whether a tangent plane exists at the vertex: a positive double subdominant eigenvalue of
        frequency 1, larger than the modulus of all that follow.
    """

    matrix: SubdivisionMatrix
    modes: list[Mode]
    G: Fixed
    W: Fixed
    Winv: Fixed
    order: list[int]
    eigenvalues: list[Any]
    chains: list[int]
    pieces: Fixed
    smooth: bool


def outer_eigenbasis(
    block: list[list[Fraction]],
) -> tuple[list[Fraction], list[list[Fraction]], list[list[Fraction]]]:
    """Rational eigenvalues d, eigenvectors W (columns) and W^-1 of the outer 7 x 7 block.

    The outer points are refined by regular rules, so the candidates are the products of the
    eigenvalues 1/2^k of univariate cubic knot insertion.
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
    reduced = _reduced([row + [Fraction(i == j) for j in range(size)] for i, row in enumerate(W)])
    return values, W, [row[size:] for row in reduced]


def null_space(matrix: list[list[Fraction]]) -> list[list[Fraction]]:
    """Basis of the null space of a rational matrix, in reduced echelon form."""
    columns = len(matrix[0])
    reduced = [row for row in _reduced(matrix) if any(row)]
    pivots = [next(j for j, x in enumerate(row) if x) for row in reduced]
    basis = []
    for free in sorted(set(range(columns)) - set(pivots)):
        vector = [Fraction(j == free) for j in range(columns)]
        for row, pivot in zip(reduced, pivots, strict=True):
            vector[pivot] = -row[free]
        basis.append(vector)
    return basis


def _reduced(matrix: list[list[Fraction]]) -> list[list[Fraction]]:
    """Reduced row echelon form."""
    rows = [list(row) for row in matrix]
    done = 0
    for column in range(len(rows[0])):
        pivot = next((i for i in range(done, len(rows)) if rows[i][column]), None)
        if pivot is None:
            continue
        rows[done], rows[pivot] = rows[pivot], rows[done]
        rows[done] = [x / rows[done][column] for x in rows[done]]
        for i, row in enumerate(rows):
            if i != done and row[column]:
                rows[i] = [x - row[column] * y for x, y in zip(row, rows[done], strict=True)]
        done += 1
        if done == len(rows):
            break
    return rows


def ring_generators(matrix: SubdivisionMatrix) -> dict[str, dict[int, Fraction]]:
    """Coefficients of the edge row and the face row by their shift j along the ring.

    ``ee[j]``: of ``e_j`` in the new ``e_0``; ``ef``: of ``f_j`` in it; ``fe``, ``ff``: in the new
    ``f_0``; ``centre``: the 3 x 3 block of frequency 0 by (row, column).
    """
    n = matrix.valence
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
        raise UnsupportedSpectrum(
            f"the masks of valence {valence} do not converge: an eigenvalue other than 1 has "
            f"modulus >= 1 (sum {total} and product {product} of the two of frequency 0)"
        )


def limit_mask(matrix: SubdivisionMatrix) -> tuple[Fraction, Fraction, Fraction]:
    """Weights of the vertex, of each edge neighbour and face corner in the limit position.

    The left eigenvector of eigenvalue 1, an exact rational (Halstead, Kass and DeRose 1993,
    appendix A; derivations/limit_masks.py).
    """
    block = centre_block(matrix)
    _check_convergence(matrix.valence, block)
    transposed = [[block[j][i] - (i == j) for j in range(3)] for i in range(3)]
    (mask,) = null_space(transposed)
    total = sum(mask)
    n = matrix.valence
    return mask[0] / total, mask[1] / total / n, mask[2] / total / n


def ring_modes(matrix: SubdivisionMatrix) -> list[Mode]:
    """All ``2 N + 1`` eigenvectors of the ring."""
    n = matrix.valence
    generators = ring_generators(matrix)
    modes = _centre_modes(matrix)
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
    _check_convergence(matrix.valence, block)
    trace, determinant = centre_quadratic(block)
    square = trace * trace - 4 * determinant
    if square <= 0:
        raise UnsupportedSpectrum(f"frequency 0 of valence {matrix.valence} has no real eigenbasis")
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
    n = matrix.valence
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


def spectrum(scheme: Scheme, valence: int) -> Spectrum:
    """Derive the eigenbasis of `scheme` around an interior vertex of `valence`.

    Raises
    ------
    UnsupportedSpectrum
        When the masks give complex eigenvalues or a defective matrix.
    """
    matrix = subdivision_matrix(scheme, valence)
    size, ring = matrix.size, 2 * valence + 1
    modes = ring_modes(matrix)
    values, outer, outer_inverse = outer_eigenbasis(
        [[row.get(ring + j, Fraction(0)) for j in range(7)] for row in matrix.rows[ring:size]]
    )
    eigenvalues = [mode.eigenvalue for mode in modes] + [to_mpf(d) for d in values]
    # the few ring points that outer points and pieces depend on
    wanted = sorted({k for piece in matrix.pieces for k in piece})
    sources = [*matrix.rows[ring:size], *(matrix.rows[k] for k in wanted if k >= size)]
    touched = {c for row in sources for c in row if c < ring} | {k for k in wanted if k < ring}
    R = _ring_rows(modes, valence, "right", sorted(touched))
    # numerators of G, (7, modes): sparse rational rows times R, then the small W^-1
    coupling = np.stack([_combine(row, R, len(modes)) for row in matrix.rows[ring:size]])
    gaps = [[mode.eigenvalue - to_mpf(d) for mode in modes] for d in values]
    W, Winv, heads = _chained(to_fixed(outer), to_fixed(outer_inverse), coupling, gaps)
    numerator = _product(Winv, coupling)
    G = np.zeros_like(numerator)
    for m, row in enumerate(gaps):
        for k, gap in enumerate(row):
            if abs(gap) > EQUAL:
                G[m, k] = (int(numerator[m, k]) << BITS) // int(fixed_point(gap._mpf_, BITS))
    order = sorted(range(size), key=lambda k: _rank(eigenvalues, modes, heads, k))
    chains = sorted(order.index(k) for k in heads.values())
    eigenvalues = [eigenvalues[k] for k in order]
    smooth = (
        [modes[k].frequency if k < ring else None for k in order[1:3]] == [1, 1]
        and eigenvalues[1] == eigenvalues[2] > 0
        and abs(eigenvalues[3]) < eigenvalues[1] - EQUAL
    )
    rows = {k: np.concatenate([row, np.zeros(7, dtype=object)])[order] for k, row in R.items()}
    below = np.concatenate([_product(W, G), W], axis=1)[:, order]
    rows |= {ring + k: row for k, row in enumerate(below)}
    # refined control points of every eigenvector: A V = V J gives the first K rows
    J = to_fixed(eigenvalues)
    refined = {}
    for k in wanted:
        if k < size:
            refined[k] = rows[k] * J >> BITS
            refined[k][chains] += rows[k][[i - 1 for i in chains]]
        else:
            refined[k] = _combine(matrix.rows[k], rows, size)
    pieces = np.stack([np.stack([refined[k] for k in piece]) for piece in matrix.pieces])
    return Spectrum(matrix, modes, G, W, Winv, order, eigenvalues, chains, pieces, smooth)


def dense_basis(spectrum: Spectrum) -> tuple[Fixed, Fixed]:
    """V, right eigenvectors as columns, and V^-1, left ones as rows, both (K, K)."""
    n, size = spectrum.matrix.valence, spectrum.matrix.size
    ring = 2 * n + 1
    V = np.zeros((size, size), dtype=object)
    Vinv = np.zeros((size, size), dtype=object)
    for name, target in (("right", V), ("left", Vinv.T)):
        rows = _ring_rows(spectrum.modes, n, name, list(range(ring)))
        target[:ring, :ring] = np.stack([rows[k] for k in range(ring)])
    V[ring:, :ring] = _product(spectrum.W, spectrum.G)
    Vinv[ring:, :ring] = -_product(spectrum.G, Vinv[:ring, :ring])
    V[ring:, ring:], Vinv[ring:, ring:] = spectrum.W, spectrum.Winv
    return V[:, spectrum.order], Vinv[spectrum.order]


def _chained(
    W: Fixed, Winv: Fixed, coupling: Fixed, gaps: list[list[Any]]
) -> tuple[Fixed, Fixed, dict[int, int]]:
    """Rotate W within its eigenspaces so that every Jordan chain ends in one of its columns.

    Also returns {column of W: ring mode that heads its chain}.
    """
    heads: dict[int, int] = {}
    for k in range(coupling.shape[1]):
        places = [m for m in range(len(gaps)) if abs(gaps[m][k]) < EQUAL]
        g = {m: sum(a * b for a, b in zip(Winv[m], coupling[:, k], strict=True)) for m in places}
        g = {m: value >> BITS for m, value in g.items() if abs(value) >> (BITS + BITS // 2)}
        if not g:
            continue
        end = max(set(g) - set(heads), key=lambda m: abs(g[m]), default=None)
        if end is None:
            raise UnsupportedSpectrum("a Jordan block of more than two eigenvectors")
        W, Winv = W.copy(), Winv.copy()
        W[:, end] = sum(W[:, m] * value for m, value in g.items()) >> BITS
        Winv[end] = (Winv[end] << BITS) // g[end]
        for m in set(g) - {end}:
            Winv[m] = Winv[m] - (Winv[end] * g[m] >> BITS)
        heads[end] = k
    return W, Winv, heads


def _rank(
    eigenvalues: list[Any], modes: list[Mode], heads: dict[int, int], k: int
) -> tuple[Any, ...]:
    """Sort key: decreasing modulus to 60 digits, positive first, then frequency and parity.

    The end of a Jordan chain comes right before its head.
    """
    value = mp.nint(eigenvalues[k] / EQUAL)
    mode = heads.get(k - len(modes), k)
    outer = mode >= len(modes)
    place = (len(modes), mode) if outer else (modes[mode].frequency, modes[mode].parity)
    return (-abs(value), -value, *place, mode == k)


def to_mpf(x: Fraction) -> Any:
    return mp.mpf(x.numerator) / x.denominator


def to_fixed(values: Any) -> Fixed:
    """Integers nearest below the values, in units of 2**-BITS, in an object array."""

    def one(x: Any) -> int:
        if isinstance(x, Fraction):
            return (x.numerator << BITS) // x.denominator
        return int(fixed_point(mp.mpf(x)._mpf_, BITS))

    array = np.array(values, dtype=object)
    flat = [one(x) for x in array.ravel()]
    result = np.empty(len(flat), dtype=object)
    result[:] = flat
    return np.asarray(result.reshape(array.shape))


def _ring_rows(modes: list[Mode], n: int, profile: str, rows: list[int]) -> dict[int, Fixed]:
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


def _product(left: Fixed, right: Fixed) -> Fixed:
    return np.asarray(left.dot(right) >> BITS)


def _combine(row: dict[int, Fraction], vectors: dict[int, Fixed], length: int) -> Fixed:
    """Sparse rational row times those vectors that there are, (length,)."""
    items = [(k, w) for k, w in row.items() if k in vectors]
    scale = lcm(*(w.denominator for _, w in items))
    total = np.zeros(length, dtype=object)
    for k, w in items:
        total += int(w * scale) * vectors[k]
    return np.asarray(total // scale)
