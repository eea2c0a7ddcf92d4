"""Frozen tables: read-only arrays, and whose they are.

An `EigenTable` holds the Jordan basis of a subdivision matrix in float64, each number rounded
from 96 digits; a `RationalTable` holds the matrix itself as integers over one denominator.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels import reference as kernels
from limitsurf.caching import cached_property
from limitsurf.exact.matrices import SubdivisionMatrix, subdivision_matrix
from limitsurf.scheme.lattice import Child
from limitsurf.scheme.scheme import Scheme
from limitsurf.scheme.sector import Sector
from limitsurf.scheme.spline import Spline

if TYPE_CHECKING:
    from limitsurf.exact.wide import Weights

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class FourierRing:
    """Coefficients of ring points in the Fourier modes around a smooth or conical vertex.

    Attributes
    ----------
    frequency, parity : (ring,)
        Fourier frequency of each mode of the ring; 0 for cosines, 1 for sines.
    left : (ring, 3 or 2)
        Weights of the vertex, the edge neighbours and the face corners, if there are any, in the
        coefficient of each mode, but for the cosine or sine.
    half_turn : (2, N // 2 + 1)
        Cosine and sine of pi f / N.
    """

    frequency: Array
    parity: Array
    left: Array
    half_turn: Array

    def coefficients(self, points: Array) -> Array:
        """Coefficients (P, ring, d) of ring points (P, ring, d)."""
        waves = self.frequency, self.parity, self.left, self.half_turn
        return kernels.ring_coefficients(points, *waves)

    def sizes(self, sizes: Array) -> Array:
        """Sizes (P, ring) of what is added up to coefficients, from those of points (P, ring)."""
        stride = self.left.shape[1] - 1
        parts = [sizes[:, 0], *(sizes[:, k::stride].sum(axis=1) for k in range(1, 1 + stride))]
        return np.asarray(np.stack(parts, axis=1) @ np.abs(self.left.T))

    def weights(self, rows: Array) -> Array:
        """Weights (Q, ring) of the points from those of the coefficients (Q, ring)."""
        waves = self.frequency, self.parity, self.left, self.half_turn
        valence = (len(self.frequency) - 1) // (self.left.shape[1] - 1)
        return kernels.ring_weights(rows, *waves, valence)


@dataclass(frozen=True, eq=False)
class DenseRing:
    """Coefficients of ring points in the eigenvectors of a sector or dart.

    Attributes
    ----------
    left : (ring, ring)
        Left eigenvectors as rows.
    """

    left: Array

    def coefficients(self, points: Array) -> Array:
        """Coefficients (P, ring, d) of ring points (P, ring, d)."""
        return np.asarray(np.matmul(self.left, points))

    def sizes(self, sizes: Array) -> Array:
        """Sizes (P, ring) of what is added up to coefficients, from those of points (P, ring)."""
        return np.asarray(sizes @ np.abs(self.left.T))

    def weights(self, rows: Array) -> Array:
        """Weights (Q, ring) of the points from those of the coefficients (Q, ring)."""
        return np.asarray(rows @ self.left)


@dataclass(frozen=True, eq=False, repr=False)
class EigenTable:
    """Real Jordan basis of the subdivision matrix around a special corner, in float64.

    Arrays are read-only; K control points as in ``exact/matrices.py``.

    Attributes
    ----------
    scheme : Scheme
        Whose table this is.
    sector : Sector
        What surrounds the corner.
    provenance : dict
        Name, masks, sector and format: everything that the numbers depend on.
    ring : FourierRing or DenseRing
        Left eigenvectors of the ring.
    rates : (2, K)
        By what a halving scales each eigenfunction: the eigenvalue, but the modulus of complex
        pairs (at darts). Unevaluated sums high + low; the first is 1, and moduli fall.
    pieces : (3, 16 or 15, K)
        Eigenfunctions on the three regular pieces of the face: coefficients of the monomials in
        the order of `Spline.exponents`, in quads of ``S^i T^j`` at ``4 j + i``. Where edges at the
        vertex have masks of their own, on the twelve pieces of these.
    chains : (c,)
        Indices k with ``A V[:, k] = eigenvalue[k] V[:, k] + V[:, k - 1]``.
    pairs, angles : (p,)
        Indices k of complex pairs k, k + 1, and the arguments of the first of each.
    normal : (2,) or (0,)
        Coefficients whose cross product points along the limit normal at the corner, if general
        control points have one there.
    links : (outer, ring)
        What each mode of the ring takes away from the coefficients of the outer eigenvectors.
    outer : (outer, outer)
        Left eigenvectors of the outer block.
    order : (K,)
        Modes of the ring, then outer eigenvectors, by decreasing modulus of the eigenvalue.
    """

    scheme: Scheme
    sector: Sector
    provenance: Mapping[str, Any]
    ring: FourierRing | DenseRing
    rates: Array
    pieces: Array
    chains: Array
    pairs: Array
    angles: Array
    normal: Array
    links: Array
    outer: Array
    order: Array

    @property
    def size(self) -> int:
        """Number K of control points."""
        return len(self.order)

    @property
    def places(self) -> tuple[Child, ...]:
        """Where the pieces lie, by their number; see `halvings`."""
        lattice = self.sector.lattice
        return lattice.fine_pieces if self.halvings == 2 else lattice.pieces

    @property
    def halvings(self) -> int:
        """How many steps lead from the face to a piece: 1, or 2 where these are finer."""
        return 1 if len(self.pieces) == len(self.sector.lattice.pieces) else 2

    @cached_property
    def _dense(self) -> tuple[Array, Array]:
        from limitsurf.exact.spectrum import dense_basis, spectrum

        V, Vinv = map(rounded, dense_basis(spectrum(self.scheme, self.sector)))
        return V, Vinv

    def right_rows(self, points: Sequence[int]) -> Array:
        """Values of all right eigenvectors at some control points, (n, K); derived each time."""
        from limitsurf.exact.spectrum import spectrum

        return rounded(spectrum(self.scheme, self.sector).right_rows(points))

    @property
    def V(self) -> Array:
        """Right eigenvectors as columns, (K, K); derived when first asked for."""
        return self._dense[0]

    @property
    def Vinv(self) -> Array:
        """Left eigenvectors as rows, (K, K); derived when first asked for."""
        return self._dense[1]

    @cached_property
    def eigenvalues(self) -> Array:
        """Eigenvalues by decreasing modulus, (K,); complex if there are complex pairs."""
        values: Array = self.rates[0]
        if len(self.pairs):
            values = values.astype(complex)
            turn = np.exp(1j * self.angles)
            values[self.pairs] *= turn
            values[self.pairs + 1] *= turn.conj()
        values.flags.writeable = False
        return values

    @cached_property
    def J(self) -> Array:
        """Real Jordan matrix, (K, K): a pair a +- ib is the block [[a, b], [-b, a]]."""
        J = np.diag(self.rates[0])
        J[self.chains - 1, self.chains] = 1
        for k, angle in zip(self.pairs.tolist(), self.angles.tolist(), strict=True):
            turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
            J[k : k + 2, k : k + 2] = self.rates[0, k] * turn
        J.flags.writeable = False
        return J

    @cached_property
    def A(self) -> Array:
        """Subdivision matrix, (K, K)."""
        A = self._refinement(range(self.size))
        A.flags.writeable = False
        return A

    @property
    def refined(self) -> Array:
        """Control points of the regular pieces from those around the corner, (3, points, K)."""
        return np.stack([self._refinement(piece) for piece in self._matrix.pieces])

    @property
    def _matrix(self) -> SubdivisionMatrix:
        return subdivision_matrix(self.scheme, self.sector)

    def _refinement(self, which: Sequence[int]) -> Array:
        """Some of the refined points as rows over the control points, (n, K)."""
        rows, result = self._matrix.rows, np.zeros((len(which), self.size))
        for i, refined in enumerate(which):
            for k, weight in rows[refined].items():
                result[i, k] = float(weight)
        return result

    def __repr__(self) -> str:
        what = f"{self.scheme.name} at {self.sector.place}"
        return f"<EigenTable of {what}: {self.size} control points>"

    @property
    def residual(self) -> Array:
        """``A V - V J`` in float64, (K, K): rounding only."""
        return np.asarray(self.A @ self.V - self.V @ self.J)

    @property
    def limit_mask(self) -> Array:
        """Weights of the control points in the limit position of the vertex, (K,)."""
        return np.asarray(self.left_vectors(np.zeros(1, dtype=np.int64))[0])

    @property
    def tangent_masks(self) -> Array:
        """Weights of two vectors whose cross product is along the limit normal, (2, K) or (0, K).

        At a smooth vertex the subdominant components, even and odd about the diagonal of the face.
        """
        return self.left_vectors(self.normal)

    @property
    def growth(self) -> dict[str, float | None]:
        """By what things are multiplied in general as the distance from the vertex is halved.

        First derivatives by 2 l1, with the eigenvalues l1, l2, l3 after 1; second ones by 4 l1, or
        4 l3 if l1 is 1/2; curvature by ``l3 / l2^2``; the distance of normals from their limit by
        ``l3 / l2``, None if they have none (``derivations/scaling.py``).
        """
        l1, l2, l3 = map(float, np.abs(self.rates[0, 1:4]))
        return {
            "first_derivatives": 2 * l1,
            "second_derivatives": 4 * (l3 if l1 == 0.5 else l1),
            "curvature": l3 / l2**2 if l2 else float("nan"),
            "normals": l3 / l2 if len(self.normal) else None,
        }

    @property
    def has_bounded_curvature(self) -> bool:
        """Whether the curvature of general points stays bounded towards the vertex."""
        slowest = np.setdiff1d(np.arange(1, self.size), self.chains - 1)[1:3]
        l2, l3 = np.abs(self.rates[0, slowest])
        grows = l3 > l2 * l2 or (l3 == l2 * l2 and slowest[1] in self.chains)
        return bool(len(self.normal)) and not grows

    @cached_property
    def normal_pairs(self) -> Array:
        """Pairs of coefficients whose cross products point along the limit normal, (2 or 0, 2).

        The second pair serves where the first product is 0: there the head of a Jordan chain has
        no part in the points (as in a straight crease through a corner of two faces), and its end
        comes in its place.
        """
        ends = np.where(np.isin(self.normal, self.chains), self.normal - 1, self.normal)
        return np.array([self.normal, ends]).reshape(-1, 2)

    def coefficients(self, points: Array) -> Array:
        """Coefficients V^-1 C of control points (P, K, d) in the eigenbasis, (P, K, d)."""
        ring = self.links.shape[1]
        modes = self.ring.coefficients(points[:, :ring])
        outer = np.matmul(self.outer, points[:, ring:]) - np.matmul(self.links, modes)
        return np.asarray(np.concatenate([modes, outer], axis=1)[:, self.order])

    def coefficient_sizes(self, sizes: Array) -> Array:
        """Sizes (P, K) of what adds up to these coefficients, from those of the points (P, K)."""
        ring = self.links.shape[1]
        modes = self.ring.sizes(sizes[:, :ring])
        outer = sizes[:, ring:] @ np.abs(self.outer.T) + modes @ np.abs(self.links.T)
        return np.asarray(np.concatenate([modes, outer], axis=1)[:, self.order])

    def left_vectors(self, which: Array) -> Array:
        """Left eigenvectors of some modes of the ring, (n, K)."""
        modes = self.order[which]
        vectors = self.ring.weights(np.eye(self.sector.ring)[modes])
        return np.concatenate([vectors, np.zeros((len(modes), len(self.outer)))], axis=1)


@dataclass(frozen=True, eq=False, repr=False)
class EigenNumbers:
    """Real Jordan basis of the subdivision matrix around a special corner, to any digits.

    Numbers are `mpmath.mpf` or `mpc` in object arrays, in the order of `EigenTable`; K control
    points as in ``exact/matrices.py``.

    Attributes
    ----------
    digits : int
        Decimal digits after the point that are right, at least.
    eigenvalues : (K,)
    A, V, J, Vinv : (K, K)
        Subdivision matrix, right eigenvectors as columns, Jordan matrix, left ones as rows.
    tangent_masks : (2, K) or (0, K)
        Weights of two vectors whose cross product is along the limit normal at the vertex.
    """

    digits: int
    eigenvalues: Array
    A: Array
    V: Array
    J: Array
    Vinv: Array
    tangent_masks: Array

    @property
    def limit_mask(self) -> Array:
        """Weights of the control points in the limit position of the vertex, (K,)."""
        return np.asarray(self.Vinv[0])

    def __repr__(self) -> str:
        return f"<EigenNumbers to {self.digits} digits: {len(self.A)} control points>"

    @property
    def residual(self) -> Array:
        """``A V - V J``, (K, K): rounding only, to the precision that mpmath has at the time."""
        return np.asarray(self.A @ self.V - self.V @ self.J)


@lru_cache(maxsize=8)
def eigen_numbers(scheme: Scheme, sector: Sector, digits: int) -> EigenNumbers:
    """Derive the eigenbasis of `scheme` around a special corner to so many digits."""
    import mpmath
    from mpmath.libmp import from_man_exp

    from limitsurf.exact.fixed import BITS
    from limitsurf.exact.spectrum import dense_basis, spectrum

    # darts lose the most: up to 32 bits; what is decided is decided to 60 digits at least
    bits = max(BITS, digits * 10 // 3 + 64)
    result = spectrum(scheme, sector, bits)

    def number(x: Any) -> Any:  # of any precision, whatever that of the user's context
        return mpmath.mp.make_mpf(from_man_exp(int(x), -bits) if abs(x) > 1 << 32 else (0, 0, 0, 0))

    def own(x: Any) -> Any:
        return mpmath.mp.make_mpc(x._mpc_) if hasattr(x, "_mpc_") else mpmath.mp.make_mpf(x._mpf_)

    V, Vinv = (np.vectorize(number, otypes=[object])(x) for x in dense_basis(result))
    A, J = np.full((2, *V.shape), mpmath.mpf(0), dtype=object)
    for i, row in enumerate(result.matrix.rows[: result.matrix.size]):
        for k, weight in row.items():
            A[i, k] = own(result.at.to_mpf(weight))
    values = np.array([own(x) for x in result.eigenvalues] + [None], dtype=object)[:-1]
    np.fill_diagonal(J, [x.real for x in values])
    for k in result.chains:
        J[k - 1, k] = mpmath.mpf(1)
    for k in result.pairs:
        # (a minus would round to the precision of the context)
        J[k, k + 1], J[k + 1, k] = values[k].imag, values[k + 1].imag
    made = EigenNumbers(digits, values, A, V, J, Vinv, Vinv[list(result.normal)])
    for array in (values, A, V, J, Vinv, made.tangent_masks):
        array.flags.writeable = False
    return made


@dataclass(frozen=True, eq=False, repr=False)
class RationalTable:
    """One refinement step around a special corner as sparse integers over one denominator.

    Attributes
    ----------
    sector : Sector
    n_rows : int
        Number of refined points: the control points, then more that the pieces take.
    rows, columns, numerators : (nnz,)
        Refined points from control points, (n_rows, K), sorted by column; the first K rows are the
        matrix A. The numerators are Python integers.
    denominator : int
    pieces : (3, 16 or 12)
        Rows that are the control points of the three regular pieces, in the order of the lattice's
        template, in quads ``4 j + i``.
    limit_mask : (K,) of Fraction
        Weights of the control points in the limit; (0,) if irrational masks have been rounded.
    """

    sector: Sector
    n_rows: int
    rows: Array
    columns: Array
    numerators: Array
    denominator: int
    pieces: Array
    limit_mask: Array

    @property
    def places(self) -> tuple[Child, ...]:
        """Where the pieces lie, by their number."""
        lattice = self.sector.lattice
        fine = len(self.pieces) > len(lattice.pieces)
        return lattice.fine_pieces if fine else lattice.pieces

    def __repr__(self) -> str:
        return f"<RationalTable of {self.sector.place}: {self.sector.size} control points>"

    def projected(self, row: Array, eigenvalue: Fraction) -> Array:
        """The part of a row (K,) in the space of left eigenvectors of a semisimple eigenvalue."""
        from limitsurf.exact.fixed import null_space, reduced

        size = self.sector.size
        A = [[Fraction(0)] * size for _ in range(size)]
        square = self.rows < size
        for i, j, x in zip(
            self.rows[square], self.columns[square], self.numerators[square], strict=True
        ):
            A[i][j] += Fraction(x, self.denominator)
        for k in range(size):
            A[k][k] -= eigenvalue
        right = np.array(null_space(A), dtype=object)
        left = np.array(null_space([list(column) for column in zip(*A, strict=True)]), dtype=object)
        # row = x left + rest with rest . right = 0
        gram = [[*g, h] for g, h in zip((right @ left.T).tolist(), right @ row, strict=True)]
        part = np.array([solved[-1] for solved in reduced(gram)], dtype=object)
        return np.asarray(part @ left)


@dataclass(frozen=True, eq=False)
class StripTables:
    """Splines across semi-sharp creases, for several sharpnesses.

    Attributes
    ----------
    first, depth : (n,) int
        First piece of each sharpness, and its halvings towards the crease.
    pieces : (sum of depth + 1, powers, 4)
        Coefficients of the powers of the piece's parameter for the four rows of control points
        across the crease, of which the second is on it; float64 or exact.
    both : bool
        Whether they are such splines along it, too: quads of a dual scheme, in four pieces.
    """

    first: Array
    depth: Array
    pieces: Array
    both: bool = False


@dataclass(frozen=True, eq=False)
class RingMasks:
    """Float64 masks around a special corner of many faces: what its rings are refined by.

    Attributes
    ----------
    sector : Sector
    spline : Spline
        What regular pieces are.
    weights : Weights
        Those of face, edge and vertex points.
    limit : ((edges,), (corners,))
        Weights of the edge neighbours in the limit of the vertex, and of the face corners beyond
        them, as many as faces; none in triangles.
    waves : ((n, edges), (n, corners))
        The left eigenvectors that fall most slowly, up to positive factors.
    """

    sector: Sector
    spline: Spline
    weights: Weights
    limit: tuple[Array, Array]
    waves: tuple[Array, Array]

    @property
    def has_normal(self) -> bool:
        """Whether general points have a limit normal there, the cross product of two waves."""
        return len(self.waves[0]) == 2


def rounded(fixed: Array) -> Array:
    """Numbers of `exact.spectrum` in float64; true division of integers rounds correctly.

    What is left of an exact zero after rounding to 96 digits is zero again.
    """
    from limitsurf.exact.fixed import BITS

    unit, noise = 1 << BITS, 1 << 32
    numbers = [x / unit if abs(x) > noise else 0.0 for x in fixed.ravel()]
    array = np.array(numbers, dtype=float).reshape(fixed.shape)
    array.flags.writeable = False
    return array
