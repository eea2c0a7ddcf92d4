"""Frozen tables with provenance, in memory and on disk: the only door from `exact` to the rest.

An `EigenTable` holds the Jordan basis of a subdivision matrix in float64, each number rounded
from 96 digits; a `RationalTable` holds the matrix itself as integers over one denominator. Masks
come out as arrays of the number type that is asked for.

Eigen tables are looked up in memory, among those shipped with the package, then in a per-user
cache directory (``LIMITSURF_CACHE_DIR``, else the platform's), and derived when none has them. A
file is a zip archive of ``.npy`` arrays and the full key: scheme, kind, valence, masks evaluated
there, format version. It is read without unpickling or evaluating anything, and only where nobody
else could have written it (``disk_cache.py``); and believed if key, digest, shapes, types and
ranges of indices are right, and if the numbers are those of the subdivision matrix. Otherwise it is
derived again and replaced.

``python -m limitsurf.tables [DIRECTORY]`` writes the shipped tables.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from math import lcm
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import disk_cache
from limitsurf._kernels import reference as kernels
from limitsurf.caching import cached_property
from limitsurf.disk_cache import Formats
from limitsurf.exact.catmull_clark import CATMULL_CLARK
from limitsurf.exact.creases import CHAIKIN, POWERS
from limitsurf.exact.creases import INFINITE as INFINITE
from limitsurf.exact.matrices import KINDS as KINDS
from limitsurf.exact.matrices import Sector as Sector
from limitsurf.exact.matrices import subdivision_matrix
from limitsurf.exact.scheme import Scheme

if TYPE_CHECKING:
    from limitsurf.exact.matrices import SubdivisionMatrix
    from limitsurf.exact.ring import FourierRing as FourierModes
    from limitsurf.exact.wide import Weights

FORMAT = 2
SHIPPED = Path(__file__).parent / "_data" / "tables"
SHIPPED_SECTORS = (
    *(Sector("interior", n) for n in range(2, 17)),
    *(Sector("cone", n) for n in range(3, 7)),
    *(
        Sector(kind, n, p)
        for kind, most in (("crease", 6), ("corner", 5), ("dart", 5))
        for n in range(3 if kind == "dart" else 1, most + 1)
        for p in range(n)
    ),
)
# Special corners of more faces have no eigen tables, their rings are refined (`RingMasks`): tables
# of all positions, and copies of the ring in all patches, cost the square of this number. What
# compiled kernels keep of a patch ends here too.
MOST_FACES = 64
_FOURIER = ("interior", "cone")  # kinds whose ring is that of all its rotations
SCHEMES = {scheme.name: scheme for scheme in (CATMULL_CLARK,)}
# what else files call a scheme, and what that means
_OTHERS = {
    "none": "the cage is a mere mesh of polygons, which is not to be subdivided",
    "mixed": "the cage is of meshes with several schemes",
    "loop": "it is not there yet",
    "bilinear": "it is not there yet",
}

Array = NDArray[Any]


def find_scheme(scheme: str | Scheme) -> Scheme:
    """Return the scheme of that name, or the scheme itself; ValueError when there is none."""
    if isinstance(scheme, Scheme):
        return scheme
    if not isinstance(scheme, str) or scheme not in SCHEMES:
        text = f"unknown scheme {scheme!r}; known: {', '.join(sorted(SCHEMES))}"
        if isinstance(scheme, str) and scheme in _OTHERS:
            advice = f'to subdivide it all the same, say scheme="{CATMULL_CLARK.name}"'
            text += f" ({_OTHERS[scheme]}; {advice})"
        raise ValueError(text)
    return SCHEMES[scheme]


@dataclass(frozen=True, eq=False)
class FourierRing:
    """Coefficients of ring points in the Fourier modes around a smooth or conical vertex.

    Attributes
    ----------
    frequency, parity : (2 N + 1,)
        Fourier frequency of each mode of the ring; 0 for cosines, 1 for sines.
    left : (2 N + 1, 3)
        Weights of the vertex, the edge neighbours and the face corners in the coefficient of each
        mode, but for the cosine or sine.
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
        parts = sizes[:, 0], sizes[:, 1::2].sum(axis=1), sizes[:, 2::2].sum(axis=1)
        return np.asarray(np.stack(parts, axis=1) @ np.abs(self.left.T))

    def weights(self, rows: Array) -> Array:
        """Weights (Q, ring) of the points from those of the coefficients (Q, ring)."""
        waves = self.frequency, self.parity, self.left, self.half_turn
        return kernels.ring_weights(rows, *waves, len(self.frequency) // 2)


@dataclass(frozen=True, eq=False)
class DenseRing:
    """The same for sectors and darts: left eigenvectors as rows, (ring, ring)."""

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


@dataclass(frozen=True, eq=False)
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
    pieces : (3, 16, K)
        Eigenfunctions on the three regular pieces of the quad: coefficient ``4 j + i`` is that of
        ``S^i T^j``.
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

    def __reduce__(self) -> tuple[Any, ...]:
        # travels to other processes as what it was made from
        return eigen_table, (self.scheme, self.sector)

    @cached_property
    def _dense(self) -> tuple[Array, Array]:
        from limitsurf.exact.spectrum import dense_basis, spectrum

        V, Vinv = map(_rounded, dense_basis(spectrum(self.scheme, self.sector)))
        return V, Vinv

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
        table = rational_table(self.scheme, self.sector)
        A = np.zeros((self.size, self.size))
        square = table.rows < self.size
        weights = table.numerators[square] / table.denominator
        A[table.rows[square], table.columns[square]] = weights
        A.flags.writeable = False
        return A

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
        ring = self.sector.ring
        modes = self.ring.sizes(sizes[:, :ring])
        outer = sizes[:, ring:] @ np.abs(self.outer.T) + modes @ np.abs(self.links.T)
        return np.asarray(np.concatenate([modes, outer], axis=1)[:, self.order])

    def left_vectors(self, which: Array) -> Array:
        """Left eigenvectors of some modes of the ring, (n, K)."""
        modes = self.order[which]
        vectors = self.ring.weights(np.eye(self.sector.ring)[modes])
        return np.concatenate([vectors, np.zeros((len(modes), len(self.outer)))], axis=1)


_memory: dict[str, Any] = {}


def eigen_table(scheme: Scheme, sector: Sector) -> EigenTable:
    """Return the float64 eigenbasis of `scheme` around a special corner.

    Raises a ValueError, `UnsupportedSpectrum`, for masks that do not converge there.
    """
    text = json.dumps(_key(scheme, sector), sort_keys=True)
    if text not in _memory:
        made, cached = _assembled(scheme, sector)
        if cached and not _holds(made):
            made, _ = _assembled(scheme, sector, derived=True)
        if sector.kind not in _FOURIER:
            _memory.setdefault(_ring_text(scheme, sector), made.ring)
        _memory.setdefault(text, made)
    table: EigenTable = _memory[text]
    return table


def _assembled(scheme: Scheme, sector: Sector, derived: bool = False) -> tuple[EigenTable, bool]:
    """A table, and whether part of it is from the cache; all of it derived anew if `derived`."""
    key, formats = _key(scheme, sector), _table_formats(sector)
    arrays, cached = _stored(key, formats, lambda: _derive(scheme, sector), derived)
    ring: FourierRing | DenseRing | None
    if sector.kind in _FOURIER:
        ring = FourierRing(**{name: arrays.pop(name) for name in _ring_formats(sector)})
    else:  # all positions of a sector share it
        ring = _memory.get(_ring_text(scheme, sector))
    if ring is None:
        key, formats = _ring_key(scheme, sector), _ring_formats(sector)
        left, more = _stored(key, formats, lambda: _derive_ring(scheme, sector), derived)
        ring, cached = DenseRing(**left), cached or more
    known, rates = MappingProxyType(_key(scheme, sector)), arrays.pop("eigenvalues")
    return EigenTable(scheme, sector, known, ring, rates, **arrays), cached


def _ring_key(scheme: Scheme, sector: Sector) -> dict[str, Any]:
    return _key(scheme, Sector(sector.kind, sector.faces)) | {"position": "all"}


def _ring_text(scheme: Scheme, sector: Sector) -> str:
    return json.dumps(_ring_key(scheme, sector), sort_keys=True)


def _key(scheme: Scheme, sector: Sector) -> dict[str, Any]:
    smooth = sector.faces if sector.kind in ("interior", "dart") else None
    place = {"kind": sector.kind, "faces": sector.faces, "position": sector.position}
    return {"format": FORMAT, **place, **scheme.key(smooth)}


def _stored(
    key: dict[str, Any], formats: Formats, derive: Callable[[], dict[str, Array]], derived: bool
) -> tuple[dict[str, Array], bool]:
    """Arrays that belong to a key, read-only: shipped, cached, or derived and then cached.

    Also whether they are from the cache. If `derived`, no file is believed.
    """
    name, arrays, cached = _file_name(key), None, False
    if not derived:
        with suppress(OSError):  # not shipped
            arrays = disk_cache.decoded((SHIPPED / name).read_bytes(), key, formats)
    if not derived and arrays is None:
        content = disk_cache.read(name, disk_cache.most_bytes(formats))
        arrays = None if content is None else disk_cache.decoded(content, key, formats)
        cached = arrays is not None
    if arrays is None:
        arrays = derive()
        disk_cache.write(name, disk_cache.encoded(arrays, key, formats))
    for array in arrays.values():
        array.flags.writeable = False
    return arrays, cached


def write_shipped(directory: Path) -> list[Path]:
    """Write the tables that ship with the package into `directory`; return their paths."""
    directory.mkdir(parents=True, exist_ok=True)
    paths = []
    for sector in SHIPPED_SECTORS:
        tables = [(_key(CATMULL_CLARK, sector), _table_formats(sector), _derive)]
        if sector.kind not in _FOURIER and sector.position == 0:
            key = {**tables[0][0], "position": "all"}
            tables.append((key, _ring_formats(sector), _derive_ring))
        for key, formats, derive in tables:
            path = directory / _file_name(key)
            disk_cache.replace(
                path, disk_cache.encoded(derive(CATMULL_CLARK, sector), key, formats)
            )
            paths.append(path)
    return paths


def _file_name(key: dict[str, Any]) -> str:
    text = json.dumps(key, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:32] + ".npz"


def _derive(scheme: Scheme, sector: Sector) -> dict[str, Array]:
    """Derive a table and round it to float64."""
    from limitsurf.exact.fixed import mp
    from limitsurf.exact.ring import FourierRing as FourierModes
    from limitsurf.exact.spectrum import spectrum

    result = spectrum(scheme, sector)
    values = [mp.sign(x) * abs(x) if isinstance(x, mp.mpf) else abs(x) for x in result.eigenvalues]
    high = [float(x) for x in values]
    arrays = {
        "eigenvalues": np.array([high, [float(x - h) for x, h in zip(values, high, strict=True)]]),
        "pieces": _rounded(result.pieces),
        "chains": np.array(result.chains, dtype=np.int64),
        "pairs": np.array(result.pairs, dtype=np.int64),
        "angles": np.array([float(mp.arg(result.eigenvalues[k])) for k in result.pairs]),
        "normal": np.array(result.normal, dtype=np.int64),
        "links": _rounded(result.G),
        "outer": _rounded(result.Winv),
        "order": np.array(result.order),
    }
    if isinstance(result.ring, FourierModes):
        arrays |= _fourier_arrays(result.ring)
    return arrays


def _derive_ring(scheme: Scheme, sector: Sector) -> dict[str, Array]:
    from limitsurf.exact.spectrum import ring_basis

    return {"left": _rounded(ring_basis(scheme, sector).left())}


def _fourier_arrays(ring: FourierModes) -> dict[str, Array]:
    from limitsurf.exact.fixed import mp, to_fixed

    turn = [mp.mpf(f) / ring.faces for f in range(ring.faces // 2 + 1)]
    return {
        "frequency": np.array([mode.frequency for mode in ring.modes]),
        "parity": np.array([mode.parity for mode in ring.modes]),
        "left": _rounded(to_fixed([mode.left for mode in ring.modes])),
        "half_turn": np.array([[float(wave(x)) for x in turn] for wave in (mp.cospi, mp.sinpi)]),
    }


def _rounded(fixed: Array) -> Array:
    """Numbers of `exact.spectrum` in float64; true division of integers rounds correctly.

    What is left of an exact zero after rounding to 96 digits is zero again.
    """
    from limitsurf.exact.fixed import BITS

    unit, noise = 1 << BITS, 1 << 32
    numbers = [x / unit if abs(x) > noise else 0.0 for x in fixed.ravel()]
    array = np.array(numbers, dtype=float).reshape(fixed.shape)
    array.flags.writeable = False
    return array


def _table_formats(sector: Sector) -> Formats:
    """The arrays of a table."""
    size, ring, outer = sector.size, sector.ring, len(sector.outer)
    formats: Formats = {
        "eigenvalues": ("<f8", (2, size), None),
        "pieces": ("<f8", (3, 16, size), None),
        "chains": ("<i8", (-1,), range(2, size)),
        "pairs": ("<i8", (-1,), range(1, size - 1)),
        "angles": ("<f8", (-1,), None),
        "normal": ("<i8", (-1,), range(1, size)),
        "links": ("<f8", (outer, ring), None),
        "outer": ("<f8", (outer, outer), None),
        "order": ("<i8", (size,), range(size)),
    }
    return formats | (_ring_formats(sector) if sector.kind in _FOURIER else {})


def _ring_formats(sector: Sector) -> Formats:
    """The arrays of a ring."""
    ring = sector.ring
    if sector.kind not in _FOURIER:
        return {"left": ("<f8", (ring, ring), None)}
    return {
        "frequency": ("<i8", (ring,), range(sector.faces // 2 + 1)),
        "parity": ("<i8", (ring,), range(2)),
        "left": ("<f8", (ring, 3), None),
        "half_turn": ("<f8", (2, sector.faces // 2 + 1), None),
    }


def _holds(table: EigenTable) -> bool:
    """Whether a table is that of its subdivision matrix.

    What is evaluated n steps from the corner is ``P J^n V^-1`` times the control points, with the
    pieces P. That is right for all n if ``V^-1 A = J V^-1``, and if ``P V^-1 = C``, the pieces
    after one step of refinement: then it is ``C A^n``. Both are tried on four sets of control
    points, all of them 1, whose weights sum to one, and three random ones; so a wrong number shows
    if it matters by more than a few hundred roundings, about 1e-13 of the control points.
    """
    if not _is_ordered(table):
        return False
    matrix = subdivision_matrix(table.scheme, table.sector, float)
    size, before = table.size, np.random.default_rng(0).normal(size=(table.size, 4))
    before[:, 0] = 1
    columns = np.array([k for row in matrix.rows for k in row])
    weights = np.array([x for row in matrix.rows for x in row.values()])
    starts = np.cumsum([0, *map(len, matrix.rows)])[:-1]
    refined = np.add.reduceat(weights[:, None] * before[columns], starts)
    modes, after = table.coefficients(np.array([before, refined[:size]]))
    expected = table.rates[0][:, None] * modes
    expected[table.chains - 1] += modes[table.chains]
    first = table.pairs
    x, y = modes[first], modes[first + 1]
    a, b = (table.rates[0, first] * [np.cos(table.angles), np.sin(table.angles)])[..., None]
    expected[first], expected[first + 1] = a * x + b * y, a * y - b * x
    change = np.array(POWERS, dtype=float)
    control = refined[np.array(matrix.pieces)].reshape(3, 4, 4, 4)
    pieces = np.einsum("aj,bi,pjid->pabd", change, change, control).reshape(3, 16, 4)
    rounding = np.finfo(float).eps * (100 + size)
    wrong = abs(after - expected).max() > rounding * abs(modes).max()
    most = (abs(table.pieces) @ abs(modes)).max()
    return not wrong and bool(abs(table.pieces @ modes - pieces).max() <= rounding * most)


def _is_ordered(table: EigenTable) -> bool:
    """Whether the indices of a table, each of which is in its range, make sense together."""
    high, low = abs(table.rates)
    chains, normal = table.chains, table.normal
    paired = np.concatenate([table.pairs, table.pairs + 1])
    if (
        any(len(np.unique(x)) < len(x) for x in (table.order, chains, paired))
        or len(table.pairs) != len(table.angles)
        or (np.diff(high) > 0).any()
        or (low > np.spacing(high) / 2).any()
    ):
        return False
    if isinstance(table.ring, FourierRing):
        half = np.pi * np.arange(table.sector.faces // 2 + 1) / table.sector.faces
        if abs(table.ring.half_turn - [np.cos(half), np.sin(half)]).max() > 1e-15:
            return False
    if not normal.size:
        return True
    # the two modes that fall most slowly, ends of chains apart, as a right-handed pair
    slowest = np.setdiff1d(np.arange(1, table.size), chains - 1)[:2]
    if normal.shape != (2,) or not np.array_equal(np.sort(normal), slowest):
        return False
    if (table.order[table.normal_pairs] >= table.sector.ring).any():
        return False
    powers, slopes = [1, 0.5, 0.25, 0.125], [0, 1, 1, 0.75]  # at the middle of the diagonal piece
    f = table.pieces[1][:, table.normal_pairs[1]].reshape(4, 4, 2)
    ds, dt = np.einsum("jik,j,i->k", f, powers, slopes), np.einsum("jik,j,i->k", f, slopes, powers)
    return bool(ds[0] * dt[1] > ds[1] * dt[0])


@dataclass(frozen=True, eq=False)
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
    pieces : (3, 16)
        Rows that are the control points of the three regular pieces, index ``4 j + i``.
    limit_mask : (K,) of Fraction
        Weights of the control points in the limit.
    """

    sector: Sector
    n_rows: int
    rows: Array
    columns: Array
    numerators: Array
    denominator: int
    pieces: Array
    limit_mask: Array

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


def rational_table(scheme: Scheme, sector: Sector) -> RationalTable:
    """Return the exact refinement step of `scheme` around a special corner."""
    return _rational_table(subdivision_matrix(scheme, sector), scheme)


@lru_cache(maxsize=64)
def _rational_table(matrix: SubdivisionMatrix, scheme: Scheme) -> RationalTable:
    entries = sorted((c, r, w) for r, row in enumerate(matrix.rows) for c, w in row.items())
    denominator = lcm(*(w.denominator for _, _, w in entries))
    numerators = np.empty(len(entries), dtype=object)
    numerators[:] = [int(w * denominator) for _, _, w in entries]
    columns, rows = np.array([(c, r) for c, r, _ in entries]).T
    pieces, sector = np.array(matrix.pieces), matrix.sector
    mask = np.full(sector.size, Fraction(0), dtype=object)
    mask[: sector.ring] = limit_mask(scheme, sector.kind, sector.faces, object)
    count = len(matrix.rows)
    return RationalTable(sector, count, rows, columns, numerators, denominator, pieces, mask)


@dataclass(frozen=True, eq=False)
class StripTables:
    """Splines across semi-sharp creases, for several sharpnesses.

    Attributes
    ----------
    first, depth : (n,) int
        First piece of each sharpness, and its halvings towards the crease.
    pieces : (sum of depth + 1, 4, 4)
        Coefficients of the powers of the piece's parameter for the four rows of control points
        across the crease, of which the second is on it; float64 or exact.
    """

    first: Array
    depth: Array
    pieces: Array


def strip_tables(scheme: Scheme, sharpness: Array, dtype: Any) -> StripTables:
    """Pieces of the splines across creases of the given sharpnesses, each in (0, INFINITE)."""
    from limitsurf.exact.creases import strip_pieces

    depth = np.array([-(-s // 1) for s in sharpness], dtype=np.int64)
    share = sharpness - (depth - 1)
    share = _numbers([Fraction(s) for s in share.tolist()], dtype)
    first = np.cumsum(depth + 1) - depth - 1
    pieces = np.zeros((int((depth + 1).sum()), 4, 4), dtype=dtype)
    for level in np.unique(depth).tolist():
        smooth, sharp = (
            _numbers([x for p in strip_pieces(scheme, level, w) for row in p for x in row], dtype)
            for w in (Fraction(0), Fraction(1))
        )
        here = np.flatnonzero(depth == level)
        found = smooth + share[here, None] * (sharp - smooth)
        place = first[here, None] + np.arange(level + 1)
        pieces[place] = found.reshape(len(here), level + 1, 4, 4)
    return StripTables(first, depth, pieces)


@lru_cache(maxsize=4096)
def _face_mask(scheme: Scheme, corners: int) -> tuple[Fraction, ...]:
    return tuple(scheme.face_mask(corners))


@lru_cache(maxsize=4096)
def _vertex_mask(scheme: Scheme, valence: int) -> tuple[Fraction, ...]:
    return tuple(scheme.vertex_mask(valence))


def corner_weights(scheme: Scheme, sizes: Array, dtype: Any) -> Array:
    """Weight of every face corner in its face point, (sum of sizes,)."""
    unique, kind = np.unique(sizes, return_inverse=True)
    table = _numbers([w for n in unique.tolist() for w in _face_mask(scheme, n)], dtype)
    # row starts of the masks in `table`, of the faces in the result
    mask_start = np.concatenate([[0], np.cumsum(unique)[:-1]])
    position = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    return np.asarray(table[np.repeat(mask_start[kind], sizes) + position])


def vertex_weights(scheme: Scheme, valences: Array, dtype: Any) -> Array:
    """Weights of interior vertices, their edge neighbours, their face points, (n, 3)."""
    unique, kind = np.unique(valences, return_inverse=True)
    table = _numbers([w for n in unique.tolist() for w in _vertex_mask(scheme, n)], dtype)
    return np.asarray(table.reshape(-1, 3)[kind])


def limit_mask(scheme: Scheme, kind: str, faces: int, dtype: Any) -> Array:
    """Weights of the ring in the limit position of its vertex, (ring,)."""
    from limitsurf.exact.sectors import limit_weights
    from limitsurf.exact.wide import rounded_dart_limit

    if kind == "dart" and faces > MOST_FACES and dtype != object:
        edges, around = rounded_dart_limit(scheme, faces)
        own = 1 - edges.sum() - around.sum()
        return np.concatenate([[own], np.stack([edges, around], axis=1).ravel()])
    return _numbers(limit_weights(scheme, Sector(kind, faces)), dtype)


def normal_masks(scheme: Scheme, kind: str, faces: int) -> Array:
    """Weights of the ring in the vectors of `EigenTable.normal_pairs`, (2 or 0, 2, ring).

    Around more than `MOST_FACES` faces, in the two vectors of `RingMasks.waves`, twice.
    """
    sector = Sector(kind, faces)
    if is_shared(sector):
        rings = ring_masks(scheme, kind, faces)
        both = np.zeros((2 * rings.has_normal, 2, sector.ring))
        both[:, :, 1::2], both[:, :, 2::2] = rings.waves if rings.has_normal else (0, 0)
        both[:, :, 0] = -both.sum(axis=2)
        return both
    table = eigen_table(scheme, sector)
    masks = table.left_vectors(table.normal_pairs.ravel())[:, : sector.ring]
    return masks.reshape(-1, 2, sector.ring)


def collapsed_masks(scheme: Scheme, kind: str, faces: int) -> Array:
    """Weights of the ring where sharp edges are points: e_0 or e_k coincide with v, (4, 2, ring).

    Pairs of vectors whose cross product points along the limit normal where both edges are points
    (waves 2 and 1), where the first is, and where the second is (those in corners of one face); 0
    where there is no normal, and around more than `MOST_FACES` faces, where none is sought. Then
    ``e_0 - v`` and ``e_k - v``, which tell. Derived in ``derivations/limit_normals.py``, section 8.
    """
    sector = Sector(kind, faces)
    masks = np.zeros((4, 2, sector.ring))
    if not sector.open or sector.carried or is_shared(sector):
        return masks
    table = eigen_table(scheme, sector)
    masks[3, [0, 1], [1, -1]], masks[3, :, 0] = 1, -1
    # modes of the ring: three of the curve, then waves by frequency, two each but for the last
    waves = [int(np.flatnonzero(table.order == 1 + 2 * m)[0]) for m in range(1, min(faces, 2) + 1)]
    # each positive beside the first edge
    sign = np.sign(table.pieces[0, 4, waves])
    first, *second = table.left_vectors(np.array(waves))[:, : sector.ring] * sign[:, None]
    if second:
        masks[0] = second[0], first
    elif kind == "corner":
        masks[1], masks[2] = (first, masks[3, 1]), (masks[3, 0], first)
    return masks


def is_shared(sector: Sector) -> bool:
    """Whether the patches around a special corner share its ring, for which there is no table."""
    return sector.faces > MOST_FACES and not sector.carried


@dataclass(frozen=True, eq=False)
class RingMasks:
    """Float64 masks around a special corner of many faces: what its rings are refined by.

    Attributes
    ----------
    sector : Sector
    weights : Weights
        Those of face, edge and vertex points.
    limit : ((edges,), (faces,))
        Weights of the edge neighbours and face corners in the limit of the vertex.
    waves : ((n, edges), (n, faces))
        The left eigenvectors that fall most slowly, up to positive factors.
    """

    sector: Sector
    weights: Weights
    limit: tuple[Array, Array]
    waves: tuple[Array, Array]

    @property
    def has_normal(self) -> bool:
        """Whether general points have a limit normal there, the cross product of two waves."""
        return len(self.waves[0]) == 2


@lru_cache(maxsize=16)
def ring_masks(scheme: Scheme, kind: str, faces: int) -> RingMasks:
    """Return the masks around a special corner of many faces.

    Raises a ValueError, `UnsupportedSpectrum`, for masks that do not converge there.
    """
    from limitsurf.exact.wide import Weights, slowest_waves

    weights = Weights.of(scheme, faces)
    limit = limit_mask(scheme, kind, faces, float)
    waves = slowest_waves(scheme, kind, faces)
    for array in (limit, *waves):
        array.flags.writeable = False
    return RingMasks(Sector(kind, faces), weights, (limit[1::2], limit[2::2]), waves)


def one(dtype: Any) -> Array:
    """The weight 1, (1,)."""
    return _numbers([Fraction(1)], dtype)


def rule_weights(scheme: Scheme, dtype: Any) -> tuple[Array, Array, Array]:
    """Edge mask (2,), boundary edge mask (1,), boundary vertex mask (2,)."""
    return (
        _numbers(list(scheme.edge), dtype),
        _numbers([scheme.boundary_edge], dtype),
        _numbers(list(scheme.boundary_vertex), dtype),
    )


def edge_face_weights(scheme: Scheme, smooth_triangles: bool, dtype: Any) -> Array:
    """What a triangle and what another face contributes to the face weight of its edges, (2,)."""
    face = scheme.edge[1]
    triangle = scheme.smooth_triangle if smooth_triangles else None
    return _numbers([face if triangle is None else triangle, face], dtype)


def chaikin_weights(dtype: Any) -> Array:
    """Shares of an edge's own sharpness and of the others' mean, (2,)."""
    return _numbers(list(CHAIKIN), dtype)


def is_infinite(sharpness: Array) -> Array:
    """Whether sharpness never falls, elementwise."""
    return np.asarray(sharpness >= INFINITE, dtype=bool)


def _numbers(values: list[Fraction], dtype: Any) -> Array:
    """Fractions in an object array, or float64 correctly rounded."""
    array = np.empty(len(values), dtype=object)
    array[:] = values
    return array if dtype == object else array.astype(float)


if __name__ == "__main__":
    for written in write_shipped(Path(sys.argv[1]) if len(sys.argv) > 1 else SHIPPED):
        print(written)
