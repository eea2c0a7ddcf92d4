"""The rings of crease and corner sectors, of darts, pendants and flaps: dense eigenbases.

**Crease and corner sectors** of k faces. The vertex and the ends ``e_0`` and ``e_k`` follow the
curve through them, whatever the faces do. Where these three vanish, the rest is the odd part of a
smooth ring of valence 2 k: the sines ``e_j ~ sin(j theta)``, ``f_j ~ sin((j + 1/2) theta)`` with
``theta = pi m / k``. An eigenvector of the curve extends into the faces unless a sine mode has the
same eigenvalue and takes part in it; then it heads a Jordan chain that ends in that mode.

**Darts** split by the reflection at the sharp edge. The odd part is that of a smooth ring. The
even part has the eigenvalues of a rational matrix of size N + 2 without a closed form, all simple;
from N = 6 on two of them can be complex. They are computed in float64 and refined by Newton's
method for all eigenvectors at once, which doubles the digits with every step.

**Pendants and flaps** are cones and corners whose vertex is carried by a crease beside them. It and
the middle ``m`` of its neighbours there have the eigenvalues 1 and, in Catmull-Clark, 1/4. The
eigenvectors of the cone or corner stay; the other one of the curve is extended to them, unless an
eigenvector of the same eigenvalue takes part in it: then it heads a Jordan chain that ends there.

Derived in ``derivations/sectors.py``.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from limitsurf.exact.eigenpairs import eigenpairs
from limitsurf.exact.fixed import Fixed, Precision, UnsupportedSpectrum, reduced
from limitsurf.exact.matrices import SubdivisionMatrix, subdivision_matrix
from limitsurf.exact.ring import (
    boundary_limit_mask,
    centre_block,
    centre_mask,
    ring_generators,
    wave_modes,
)
from limitsurf.exact.wide import dart_limit
from limitsurf.scheme.scheme import Scheme
from limitsurf.scheme.sector import Sector


@dataclass(frozen=True, eq=False)
class DenseModes:
    """The eigenbasis of a ring as matrices.

    Attributes
    ----------
    values : list of mpf or mpc
        Eigenvalues. A complex pair a +- ib belongs to two real columns x, y with
        ``A x = a x - b y`` and ``A y = b x + a y``.
    labels : list of (int, int)
        To order equal eigenvalues by.
    heads : dict
        {end: head} of the Jordan chains, ``A V[head] = value V[head] + V[end]``.
    right, inverse : (ring, ring)
        Right eigenvectors as columns, left ones as rows.
    """

    values: list[Any]
    labels: list[tuple[int, int]]
    heads: dict[int, int]
    right: Fixed
    inverse: Fixed

    def right_rows(self, points: Any) -> dict[int, Fixed]:
        """Values of all eigenvectors at some points of the ring: {point: (modes,)}."""
        return {k: self.right[k] for k in points}

    def left(self) -> Fixed:
        """Left eigenvectors as rows, (ring, ring)."""
        return self.inverse


def open_ring(scheme: Scheme, matrix: SubdivisionMatrix, at: Precision) -> DenseModes:
    """The ring of a crease or corner sector."""
    size, faces = matrix.sector.ring, matrix.sector.faces
    frequencies, waves, right, left = _sines(scheme, 2 * faces, size, at)
    left = 2 * left  # sums over the sector are half of those over a ring of twice its faces
    rows = matrix.rows
    curve, inner = [0, 1, size - 1], list(range(2, size - 1))
    # eigenvectors of the curve: constant, odd and even about the middle of the sector
    own, beside, half = rows[0][0], rows[0].get(1, Fraction(0)), rows[1][1]
    slope = 2 * beside / (half - 1)
    one, zero = Fraction(1), Fraction(0)
    vectors = [[one, one, one], [zero, one, -one], [slope, one, one]]
    values = [Fraction(1), half, own + half - 1]
    basis = at.to_fixed([[Fraction(vector[i]) for vector in vectors] for i in range(3)])
    dual = [[Fraction(vector[i]) for vector in vectors] + _unit(i) for i in range(3)]
    inverse = at.to_fixed([row[3:] for row in reduced(dual)])
    # what the curve's eigenvectors bring to the other points, in sine modes
    brought = at.to_fixed(
        [[sum(rows[p].get(c, 0) * v for c, v in zip(curve, y, strict=True)) for y in vectors]
         for p in inner]
    ).reshape(len(inner), 3)  # fmt: skip
    coupling = at.product(left[:, inner], brought)
    heads: dict[int, int] = {}
    gaps = [[at.to_mpf(value) - wave for value in values] for wave in waves]
    for m, row in enumerate(gaps):
        met = [y for y in (1, 2) if abs(row[y]) < at.equal and not at.is_noise(coupling[m, y])]
        if len(met) > 1:
            raise UnsupportedSpectrum("a Jordan block with two heads")
        for y in met:
            heads[3 + m] = y
            scale = coupling[m, y]
            right[:, m] = right[:, m] * scale >> at.bits
            left[m] = (left[m] << at.bits) // scale
            coupling[m] = (coupling[m] << at.bits) // scale
    extent = np.zeros_like(coupling)
    extent[:, 0] = left[:, inner].sum(axis=1)
    for m, row in enumerate(gaps):
        for y in (1, 2):
            if abs(row[y]) > at.equal:
                extent[m, y] = (int(coupling[m, y]) << at.bits) // int(at.to_fixed([row[y]])[0])
    full = np.zeros((size, size), dtype=object)
    full[:, 3:] = right
    full[:, :3] = at.product(right, extent)
    full[curve, :3] = basis
    full[:, 0] = 1 << at.bits
    dense = np.zeros((size, size), dtype=object)
    dense[3:] = left
    dense[:3, curve] = inverse
    dense[3:, curve] = -at.product(extent, inverse)
    labels = [(0, 0), (0, 1), (0, 2), *((f, k) for k, f in enumerate(frequencies))]
    return DenseModes([*map(at.to_mpf, values), *waves], labels, heads, full, dense)


def dart_ring(scheme: Scheme, matrix: SubdivisionMatrix, at: Precision) -> DenseModes:
    """The ring of a dart."""
    size, faces = matrix.sector.ring, matrix.sector.faces
    frequencies, waves, right, left = _sines(scheme, faces, size, at)
    alike = mirrored(matrix.sector)
    try:
        values, even, dual, pairs = eigenpairs(folded(matrix, alike), at)
    except (ZeroDivisionError, np.linalg.LinAlgError):
        raise _double(faces) from None
    _normalise(even, dual, pairs, at)
    # the first right vector is constant
    dual[0] = dual[0] * even[0, 0] >> at.bits
    even[:, 0] = 1 << at.bits
    full = np.zeros((size, size), dtype=object)
    dense = np.zeros((size, size), dtype=object)
    n = len(alike)
    full[:, n:], dense[n:] = right, left
    for k, orbit in enumerate(alike):
        full[orbit, :n] = even[k]
        dense[:n, orbit] = (dual[:, k] // len(orbit))[:, None]
    labels = [(0, k) for k in range(n)] + [(f, k) for k, f in enumerate(frequencies)]
    return DenseModes([*values, *waves], labels, {}, full, dense)


def carried_ring(matrix: SubdivisionMatrix, still: Any, at: Precision) -> DenseModes:
    """The ring of a pendant or flap, from the eigenbasis `still` of that whose vertex stays."""
    size = matrix.sector.ring
    n = size - 1
    known, left = still.right_rows(range(n)), still.left().copy()
    value, slope, rest = curve_mode(matrix)
    # with v = c + slope t and m = c + t the vector (c, e_0, ...) has modes z with
    # z' = J z + pull t and t' = value t
    Jordan = at.to_fixed([at.mp.re(x) for x in still.values])
    pull = (Jordan * left[:, 0] >> at.bits) - left[:, 0]
    for end, head in still.heads.items():
        pull[end] += left[head, 0]
    pull = pull * slope.numerator // slope.denominator
    right = np.zeros((size, size), dtype=object)
    right[:n, :n] = np.stack([known[k] for k in range(n)])
    extent = np.zeros(n, dtype=object)
    heads = dict(still.heads)
    ends = {head: end for end, head in heads.items()}
    for k in sorted(range(n), key=lambda k: k not in ends):
        over = pull[k] + (extent[still.heads[k]] if k in still.heads else 0)
        gap = at.to_mpf(value) - still.values[k]
        if abs(gap) > at.equal:
            extent[k] = (int(over) << at.bits) // int(at.to_fixed([gap])[0])
        elif not at.is_noise(over):
            if k in ends or k in still.heads or n in heads.values():
                raise UnsupportedSpectrum("a Jordan block of more than two eigenvectors")
            heads[k] = n
            right[:n, k] = right[:n, k] * over >> at.bits
            left[k] = (left[k] << at.bits) // over
    inverse = np.zeros((size, size), dtype=object)
    inverse[:n, :n] = left
    # c = v + rest (m - v), t = (m - v) / (1 - slope)
    apex, turn = left[:, 0].copy(), at.to_fixed([1 / (1 - slope)])[0]
    across = (apex * rest.numerator // rest.denominator) - (extent * turn >> at.bits)
    inverse[:n, 0], inverse[:n, n] = apex - across, across
    inverse[n, 0], inverse[n, n] = -turn, turn
    right[n, :n] = right[0, :n]
    right[:n, n] = at.product(right[:n, :n], extent)
    right[0, n], right[n, n] = at.to_fixed([slope])[0], 1 << at.bits
    labels = [*still.labels, (0, 3)]
    return DenseModes([*still.values, at.to_mpf(value)], labels, heads, right, inverse)


def curve_mode(matrix: SubdivisionMatrix) -> tuple[Fraction, Fraction, Fraction]:
    """Of the curve that carries a vertex v, in terms of it and of m.

    The second eigenvalue, what v is in its eigenvector where m is 1, the weight of m in the limit.
    """
    own, back = matrix.rows[0][0], matrix.rows[matrix.sector.ring - 1][0]
    slope = (own - 1) / back
    return own - back, slope, slope / (slope - 1)


def limit_weights(scheme: Scheme, sector: Sector) -> list[Fraction]:
    """Exact weights of the points of a ring in the limit of its vertex, (ring,)."""
    weights = [Fraction(0)] * sector.ring
    if sector.lattice.dual:  # a circulant
        weights = [Fraction(1, sector.faces)] * sector.faces
    elif sector.kind in ("corner", "cone"):
        weights[0] = Fraction(1)
    elif sector.kind == "crease":
        weights[0], weights[1] = boundary_limit_mask(scheme)
        weights[-1] = weights[1]
    elif sector.carried:
        *_, weights[-1] = curve_mode(subdivision_matrix(scheme, sector))
        weights[0] = 1 - weights[-1]
    elif sector.kind == "dart":
        weights = dart_limit(scheme, sector.faces)
    else:
        block = smooth_centre(scheme, sector.faces)
        own, *around = centre_mask(sector.faces, block)
        weights = [own, *around * sector.faces]
    return weights


def smooth_centre(scheme: Scheme, faces: int) -> list[list[Any]]:
    """The block of frequency 0 of a smooth vertex; at the cost of one of a few faces."""
    if scheme.has_own_spokes(faces):
        return centre_block(subdivision_matrix(scheme, scheme.sector("interior", faces)))
    # the vertex aside, those of other rings are the same
    _, *block = centre_block(subdivision_matrix(scheme, scheme.sector("cone", 8)))
    own, neighbour, *around = scheme.vertex_mask(faces)
    first = [own, faces * neighbour, *(Fraction(0) for _ in around)]
    for weight, row in zip(around, block[1:], strict=True):  # new face points
        first = [x + faces * weight * y for x, y in zip(first, row, strict=True)]
    return [first, *block]


def _sines(
    scheme: Scheme, valence: int, size: int, at: Precision
) -> tuple[list[int], list[Any], Fixed, Fixed]:
    """Sine modes of a smooth ring that are odd about its edge 0.

    Frequencies and eigenvalues; values at the first `size` points of the ring, right (size, modes)
    and left (modes, size), which are inverse in a sum over the whole ring.
    """
    orbits = scheme.lattice.orbits
    generators = ring_generators(subdivision_matrix(scheme, scheme.sector("cone", 8)))
    # at half the valence the sine vanishes at the edges, not at the faces: there it is a cosine
    # about the diagonal of face 0
    modes = [
        mode
        for mode in wave_modes(generators, valence, orbits, at)
        if mode.parity == (2 * mode.frequency != valence)
    ]
    frequency = np.array([mode.frequency for mode in modes], dtype=np.int64)
    sine = at.to_fixed([at.mp.sinpi(at.mp.mpf(k) / valence) for k in range(2 * valence)])
    right = np.zeros((size, len(modes)), dtype=object)
    left = np.zeros((len(modes), size), dtype=object)
    face, orbit = np.divmod(np.arange(size - 1), len(orbits))
    steps = 2 * face + np.array(orbits)[orbit] - orbits[0]  # from edge 0, in halves of a face
    for k, mode in enumerate(modes):
        wave = sine[steps * frequency[k] % (2 * valence)]
        for profile, target in ((mode.right, right[:, k]), (mode.left, left[k])):
            target[1:] = wave * at.to_fixed(profile)[1 + orbit] >> at.bits
    return frequency.tolist(), [mode.eigenvalue for mode in modes], right, left


def mirrored(sector: Sector) -> list[list[int]]:
    """Points of a closed ring that a reflection at its edge 0 exchanges, each once."""
    faces, stride, pairs = sector.faces, len(sector.lattice.orbits), [[0]]
    for orbit in range(stride):
        # face corner j comes between edges j and j + 1
        images = {j: (-j - orbit) % faces for j in range(faces)}
        ends = [sorted({j, images[j]}) for j in range(faces) if j <= images[j]]
        pairs += [[1 + orbit + stride * j for j in both] for both in ends]
    return pairs


def folded(matrix: SubdivisionMatrix, alike: list[list[int]]) -> list[list[Fraction]]:
    """The matrix on ring points that are equal within each orbit."""
    zero = Fraction(0)
    return [
        [sum((matrix.rows[row[0]].get(c, zero) for c in column), zero) for column in alike]
        for row in alike
    ]


def _double(faces: int) -> UnsupportedSpectrum:
    """The error that says of which dart two eigenvalues are equal."""
    return UnsupportedSpectrum(
        f"a dart of {faces} faces has an eigenvalue twice, which is not supported; "
        f"change the scheme's vertex({faces})"
    )


def _normalise(X: Fixed, inverse: Fixed, pairs: list[int], at: Precision) -> None:
    """Scale columns and rows, so that nothing depends on where the iteration began.

    The first entry that is not 0, that of the end of the sharp edge before that of the vertex,
    becomes 1.
    """
    places = (1, 0, *range(2, len(X)))
    paired = {k for p in pairs for k in (p, p + 1)}
    for k in set(range(len(X))) - paired:
        scale = next(int(X[i, k]) for i in places if not at.is_noise(X[i, k]))
        X[:, k], inverse[k] = (X[:, k] << at.bits) // scale, inverse[k] * scale >> at.bits
    for k in pairs:
        x, y = X[:, k].copy(), X[:, k + 1].copy()
        r, s = inverse[k].copy(), inverse[k + 1].copy()
        i = next(i for i in places if not (at.is_noise(x[i]) and at.is_noise(y[i])))
        c, d = int(x[i]), int(y[i])
        norm = c * c + d * d
        X[:, k], X[:, k + 1] = (
            ((x * c + y * d) << at.bits) // norm,
            ((y * c - x * d) << at.bits) // norm,
        )
        inverse[k], inverse[k + 1] = (r * c + s * d) >> at.bits, (s * c - r * d) >> at.bits


def _unit(i: int) -> list[Fraction]:
    return [Fraction(i == j) for j in range(3)]
