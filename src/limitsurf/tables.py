"""Frozen tables with provenance, in memory and on disk: the only door from `exact` to the rest.

An `EigenTable` holds the Jordan basis of a subdivision matrix in float64, each number rounded
from 96 digits; a `RationalTable` holds the matrix itself as integers over one denominator. Masks
come out as arrays of the number type that is asked for.

Eigen tables are looked up in memory, among those shipped with the package, then in a per-user
cache directory (``LIMITSURF_CACHE_DIR``, else the platform's), and derived when none has them. A
file is a zip archive of ``.npy`` arrays and the full key: scheme, kind, valence, masks evaluated
there, format version. It is read without unpickling or evaluating anything, and believed only if
key, digest, shapes and types are right; otherwise it is derived again and replaced.

``python -m limitsurf.tables [DIRECTORY]`` writes the shipped tables.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import sys
import tempfile
import warnings
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache
from math import lcm
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels import reference as kernels
from limitsurf.exact.catmull_clark import CATMULL_CLARK
from limitsurf.exact.scheme import Scheme

if TYPE_CHECKING:
    from limitsurf.exact.matrices import SubdivisionMatrix
    from limitsurf.exact.symbolic import SymbolicBasis

FORMAT = 1
SHIPPED = Path(__file__).parent / "_data" / "tables"
SHIPPED_VALENCES = tuple(range(2, 17))
SCHEMES = {scheme.name: scheme for scheme in (CATMULL_CLARK,)}

Array = NDArray[Any]


def find_scheme(scheme: str | Scheme) -> Scheme:
    """Return the scheme of that name, or the scheme itself; ValueError when there is none."""
    if isinstance(scheme, Scheme):
        return scheme
    if not isinstance(scheme, str) or scheme not in SCHEMES:
        raise ValueError(f"unknown scheme {scheme!r}; known: {', '.join(sorted(SCHEMES))}")
    return SCHEMES[scheme]


@dataclass(frozen=True, eq=False)
class EigenTable:
    """Jordan basis of the subdivision matrix around an interior vertex, in float64.

    Arrays are read-only; ``K = 2 * valence + 8`` control points as in ``exact/matrices.py``. What
    is stored grows with the valence, not with its square: the ring in its Fourier modes.

    Attributes
    ----------
    scheme : Scheme
        Whose table this is.
    provenance : dict
        Name, masks, kind, valence and format: everything that the numbers depend on.
    eigenvalues : (2, K)
        Unevaluated sums high + low. The first is 1; if `smooth`, the next two are the subdominant
        pair, even and odd about the diagonal of the face.
    pieces : (3, 16, K)
        B-spline control points of the eigenfunctions on the three regular pieces of the quad.
    chains : (c,)
        Indices k with ``A V[:, k] = eigenvalue[k] V[:, k] + V[:, k - 1]`` (for
        Catmull-Clark, at valence 2 only).
    smooth : bool
        Whether the surface has a tangent plane at the vertex for general control points.
    frequency, parity : (2 N + 1,)
        Fourier frequency of each mode of the ring; 0 for cosines, 1 for sines.
    left : (2 N + 1, 3)
        Weights of the vertex, the edge neighbours and the face corners in the coefficient of each
        mode, but for the cosine or sine.
    half_turn : (2, N // 2 + 1)
        Cosine and sine of pi f / N.
    links : (7, 2 N + 1)
        What each mode of the ring takes away from the coefficients of the outer eigenvectors.
    outer : (7, 7)
        Left eigenvectors of the outer block.
    order : (K,)
        Modes of the ring, then outer eigenvectors, by decreasing modulus of the eigenvalue.
    """

    scheme: Scheme
    provenance: Mapping[str, Any]
    eigenvalues: Array
    pieces: Array
    chains: Array
    smooth: bool
    frequency: Array
    parity: Array
    left: Array
    half_turn: Array
    links: Array
    outer: Array
    order: Array

    @property
    def valence(self) -> int:
        """Number N of faces around the vertex."""
        return int(self.provenance["valence"])

    @property
    def size(self) -> int:
        """Number K of control points."""
        return 2 * self.valence + 8

    def __reduce__(self) -> tuple[Any, ...]:
        # travels to other processes as what it was made from
        return eigen_table, (self.scheme, self.valence)

    @cached_property
    def _dense(self) -> tuple[Array, Array]:
        from limitsurf.exact.spectrum import dense_basis, spectrum

        V, Vinv = map(_rounded, dense_basis(spectrum(self.scheme, self.valence)))
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
    def J(self) -> Array:
        """Jordan matrix, (K, K)."""
        J = np.diag(self.eigenvalues[0])
        J[self.chains - 1, self.chains] = 1
        J.flags.writeable = False
        return J

    @cached_property
    def A(self) -> Array:
        """Subdivision matrix, (K, K)."""
        table = rational_table(self.scheme, self.valence)
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
        return np.asarray(self._left_vectors(slice(0, 1))[0])

    @property
    def tangent_masks(self) -> Array:
        """Weights of the subdominant components, even and odd about the diagonal, (2, K)."""
        return self._left_vectors(slice(1, 3))

    def _left_vectors(self, which: slice) -> Array:
        """Left eigenvectors of modes of the ring, (n, K)."""
        ring = 2 * self.valence + 1
        modes = self.order[which]
        waves = self.frequency, self.parity, self.left, self.half_turn, self.valence
        vectors = kernels.ring_weights(np.eye(ring)[modes], *waves)
        return np.concatenate([vectors, np.zeros((len(modes), 7))], axis=1)


_memory: dict[str, EigenTable] = {}


def eigen_table(scheme: Scheme, valence: int) -> EigenTable:
    """Return the float64 eigenbasis of `scheme` around an interior vertex of `valence` >= 2.

    Raises a ValueError, `UnsupportedSpectrum`, for masks that do not converge there.
    """
    key = _key(scheme, valence)
    text = json.dumps(key, sort_keys=True)
    if text in _memory:
        return _memory[text]
    name = _file_name(key)
    table = _load(SHIPPED / name, scheme, key)
    if table is None:
        directory = cache_directory()
        table = _load(directory / name, scheme, key)
        if table is None:
            table = _derive(scheme, valence, key)
            try:
                directory.mkdir(parents=True, exist_ok=True)
                _write(directory / name, _encode(table))
            except OSError as error:
                _warn_once(directory, error)
    return _memory.setdefault(text, table)


def _key(scheme: Scheme, valence: int) -> dict[str, Any]:
    return {"format": FORMAT, "kind": "interior", "valence": valence, **scheme.key(valence)}


def _file_name(key: dict[str, Any]) -> str:
    text = json.dumps(key, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:32] + ".npz"


def cache_directory() -> Path:
    """Where derived tables are kept: ``LIMITSURF_CACHE_DIR``, else the user's cache directory."""
    named = os.environ.get("LIMITSURF_CACHE_DIR")
    if named:
        return Path(named)
    import platformdirs

    return Path(platformdirs.user_cache_dir("limitsurf"))


def write_shipped(directory: Path) -> list[Path]:
    """Write the tables that ship with the package into `directory`; return their paths."""
    directory.mkdir(parents=True, exist_ok=True)
    paths = []
    for valence in SHIPPED_VALENCES:
        key = _key(CATMULL_CLARK, valence)
        path = directory / _file_name(key)
        _write(path, _encode(_derive(CATMULL_CLARK, valence, key)))
        paths.append(path)
    return paths


def _derive(scheme: Scheme, valence: int, key: dict[str, Any]) -> EigenTable:
    """Derive a table and round it to float64."""
    from limitsurf.exact.spectrum import mp, spectrum, to_fixed

    def split(values: list[Any]) -> Array:
        high = [float(x) for x in values]
        return np.array([high, [float(x - h) for x, h in zip(values, high, strict=True)]])

    result = spectrum(scheme, valence)
    turn = [mp.mpf(f) / valence for f in range(valence // 2 + 1)]
    half_turn = [[float(wave(x)) for x in turn] for wave in (mp.cospi, mp.sinpi)]
    return _frozen(
        scheme,
        key,
        {
            "eigenvalues": split(result.eigenvalues),
            "pieces": _rounded(result.pieces),
            "chains": np.array(result.chains, dtype=np.int64),
            "smooth": np.array(result.smooth),
            "frequency": np.array([mode.frequency for mode in result.modes]),
            "parity": np.array([mode.parity for mode in result.modes]),
            "left": _rounded(to_fixed([mode.left for mode in result.modes])),
            "half_turn": np.array(half_turn),
            "links": _rounded(result.G),
            "outer": _rounded(result.Winv),
            "order": np.array(result.order),
        },
    )


def _rounded(fixed: Array) -> Array:
    """Numbers of `exact.spectrum` in float64; true division of integers rounds correctly.

    What is left of an exact zero after rounding to 96 digits is zero again.
    """
    from limitsurf.exact.spectrum import BITS

    unit, noise = 1 << BITS, 1 << 32
    numbers = [x / unit if abs(x) > noise else 0.0 for x in fixed.ravel()]
    array = np.array(numbers, dtype=float).reshape(fixed.shape)
    array.flags.writeable = False
    return array


def _frozen(scheme: Scheme, key: dict[str, Any], arrays: dict[str, Array]) -> EigenTable:
    for array in arrays.values():
        array.flags.writeable = False
    smooth = bool(arrays["smooth"])
    rest = {name: array for name, array in arrays.items() if name != "smooth"}
    return EigenTable(scheme, MappingProxyType(key), **rest, smooth=smooth)


# the arrays of a table: type and, by valence, shape
_FORMATS: dict[str, tuple[str, Callable[[int], tuple[int, ...]]]] = {
    "eigenvalues": ("<f8", lambda n: (2, 2 * n + 8)),
    "pieces": ("<f8", lambda n: (3, 16, 2 * n + 8)),
    "chains": ("<i8", lambda n: (-1,)),  # of any length
    "smooth": ("|b1", lambda n: ()),
    "frequency": ("<i8", lambda n: (2 * n + 1,)),
    "parity": ("<i8", lambda n: (2 * n + 1,)),
    "left": ("<f8", lambda n: (2 * n + 1, 3)),
    "half_turn": ("<f8", lambda n: (2, n // 2 + 1)),
    "links": ("<f8", lambda n: (7, 2 * n + 1)),
    "outer": ("<f8", lambda n: (7, 7)),
    "order": ("<i8", lambda n: (2 * n + 8,)),
}


def _encode(table: EigenTable) -> bytes:
    """The bytes of a table's file: the same for the same table, everywhere."""
    members = {}
    for name, (kind, _) in _FORMATS.items():
        buffer = io.BytesIO()
        array = np.asarray(getattr(table, name), dtype=kind, order="C")
        np.lib.format.write_array(buffer, array, version=(1, 0), allow_pickle=False)
        members[name + ".npy"] = buffer.getvalue()
    digest = hashlib.sha256(b"".join(members.values())).hexdigest()
    header = json.dumps({"key": dict(table.provenance), "sha256": digest}, sort_keys=True, indent=1)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, content in {"key.json": header.encode(), **members}.items():
            member = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            member.create_system = 3
            archive.writestr(member, content)
    return buffer.getvalue()


def _load(path: Path, scheme: Scheme, key: dict[str, Any]) -> EigenTable | None:
    """Read a table; None when the file is not there, or is not exactly what it should be."""
    try:
        content = path.read_bytes()
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            arrays = {
                name: np.lib.format.read_array(
                    io.BytesIO(archive.read(name + ".npy")), allow_pickle=False
                )
                for name in _FORMATS
            }
    except Exception:  # whatever a broken or foreign file makes the readers raise
        return None
    for name, (kind, shape) in _FORMATS.items():
        array = arrays[name]
        if array.dtype.str != kind or not np.isfinite(array).all():
            return None
        if array.shape != shape(key["valence"]) and shape(key["valence"]) != (-1,):
            return None
    table = _frozen(scheme, key, arrays)
    # the key, the digest and all that a zip archive has room for
    return table if _encode(table) == content else None


def _write(path: Path, content: bytes) -> None:
    """Write a file under a temporary name and rename it, so that no reader sees half of it."""
    with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".tmp", delete=False) as file:
        try:
            file.write(content)
            file.close()
            os.chmod(file.name, 0o644)
            os.replace(file.name, path)
        except BaseException:
            file.close()
            Path(file.name).unlink(missing_ok=True)
            raise


@lru_cache(maxsize=1)
def _unwritable() -> list[Path]:
    """Cache directories that the user has been warned of."""
    return []


def _warn_once(directory: Path, error: OSError) -> None:
    if not _unwritable():
        _unwritable().append(directory)
        warnings.warn(
            f"tables cannot be kept in {directory} ({error.strerror or error}): each process "
            "derives them anew; LIMITSURF_CACHE_DIR names another place",
            RuntimeWarning,
            stacklevel=3,
        )


@dataclass(frozen=True, eq=False)
class RationalTable:
    """One refinement step around an interior vertex as sparse integers over one denominator.

    Attributes
    ----------
    valence : int
    rows, columns, numerators : (nnz,)
        Refined points from control points, (2 N + 17, 2 N + 8), sorted by column; the first
        ``2 N + 8`` rows are the matrix A. The numerators are Python integers.
    denominator : int
    pieces : (3, 16)
        Rows that are the control points of the three regular pieces, index ``4 j + i``.
    limit_mask : (3,) tuple of Fraction
        Weights of the vertex, of each edge neighbour and of each face corner in the limit.
    """

    valence: int
    rows: Array
    columns: Array
    numerators: Array
    denominator: int
    pieces: Array
    limit_mask: tuple[Fraction, Fraction, Fraction]


def rational_table(scheme: Scheme, valence: int) -> RationalTable:
    """Return the exact refinement step of `scheme` around an interior vertex of `valence`."""
    from limitsurf.exact.matrices import subdivision_matrix

    return _rational_table(subdivision_matrix(scheme, valence))


@lru_cache(maxsize=64)
def _rational_table(matrix: SubdivisionMatrix) -> RationalTable:
    from limitsurf.exact.spectrum import limit_mask

    entries = sorted((c, r, w) for r, row in enumerate(matrix.rows) for c, w in row.items())
    denominator = lcm(*(w.denominator for _, _, w in entries))
    numerators = np.empty(len(entries), dtype=object)
    numerators[:] = [int(w * denominator) for _, _, w in entries]
    columns, rows = np.array([(c, r) for c, r, _ in entries]).T
    pieces = np.array(matrix.pieces)
    mask = limit_mask(matrix)
    return RationalTable(matrix.valence, rows, columns, numerators, denominator, pieces, mask)


def corner_weights(scheme: Scheme, sizes: Array, dtype: Any) -> Array:
    """Weight of every face corner in its face point, (sum of sizes,)."""
    unique, kind = np.unique(sizes, return_inverse=True)
    table = _numbers([w for n in unique.tolist() for w in scheme.face_mask(n)], dtype)
    # row starts of the masks in `table`, of the faces in the result
    mask_start = np.concatenate([[0], np.cumsum(unique)[:-1]])
    position = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    return np.asarray(table[np.repeat(mask_start[kind], sizes) + position])


def vertex_weights(scheme: Scheme, valences: Array, dtype: Any) -> Array:
    """Weights of interior vertices, their edge neighbours, their face points, (n, 3)."""
    unique, kind = np.unique(valences, return_inverse=True)
    table = _numbers([w for n in unique.tolist() for w in scheme.vertex_mask(n)], dtype)
    return np.asarray(table.reshape(-1, 3)[kind])


def limit_weights(scheme: Scheme, valence: int, dtype: Any) -> Array:
    """Limit position of an interior vertex among quads: vertex, neighbour, face corner, (3,)."""
    return _numbers(list(rational_table(scheme, valence).limit_mask), dtype)


def boundary_limit_weights(scheme: Scheme, dtype: Any) -> Array:
    """Limit position on a smooth boundary curve: the vertex and each boundary neighbour, (2,)."""
    from limitsurf.exact.spectrum import boundary_limit_mask

    return _numbers(list(boundary_limit_mask(scheme)), dtype)


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


def _numbers(values: list[Fraction], dtype: Any) -> Array:
    """Fractions in an object array, or float64 correctly rounded."""
    array = np.empty(len(values), dtype=object)
    array[:] = values
    return array if dtype == object else array.astype(float)


class Eigenbasis:
    """Eigenstructure of a scheme around an interior vertex, exactly and in float64.

    Attributes
    ----------
    scheme, valence, provenance
        What it belongs to, and all that its numbers depend on.
    exact : SymbolicBasis
        sympy expressions, made on first use.
    float64 : EigenTable
        The same numbers rounded from 96 digits.

    Both have ``eigenvalues``, ``A``, ``V``, ``J``, ``Vinv``, ``residual`` (``A V - V J``),
    ``limit_mask`` and ``tangent_masks``.

    Examples
    --------
    >>> import limitsurf as ls
    >>> basis = ls.eigenbasis("catmull-clark", valence=3)
    >>> basis.exact.eigenvalues[1]
    sqrt(17)/32 + 9/32
    >>> basis.exact.residual.is_zero_matrix
    True
    """

    def __init__(self, scheme: Scheme, valence: int) -> None:
        self.scheme = scheme
        self.valence = valence
        self.float64 = eigen_table(scheme, valence)
        self.provenance = {**self.float64.provenance, "paper": scheme.paper}

    @cached_property
    def exact(self) -> SymbolicBasis:
        """The eigenbasis as sympy expressions."""
        from limitsurf.exact.symbolic import SymbolicBasis

        return SymbolicBasis(self.scheme, self.valence)

    def _distinct(self) -> list[tuple[float, int]]:
        values, counts = np.unique(self.float64.eigenvalues[0], return_counts=True)
        return sorted(zip(values.tolist(), counts.tolist(), strict=True), key=lambda p: -abs(p[0]))

    def __repr__(self) -> str:
        spectrum = ", ".join(
            f"{value:.6g}" + (f" (x{count})" if count > 1 else "")
            for value, count in self._distinct()[:6]
        )
        return (
            f"<Eigenbasis of {self.scheme.name} at interior valence {self.valence}: "
            f"{self.float64.size} control points, eigenvalues {spectrum}, ...>"
        )

    def _repr_latex_(self) -> str:
        import sympy

        counts: dict[Any, int] = {}
        for value in self.exact.eigenvalues:
            counts[value] = counts.get(value, 0) + 1
        terms = [
            sympy.latex(value) + (rf"\;(\times {count})" if count > 1 else "")
            for value, count in counts.items()
        ]
        return (
            rf"$\displaystyle \text{{{self.scheme.name}, }} N = {self.valence}: \quad "
            rf"\lambda \in \left\{{ {', '.join(terms)} \right\}}$"
        )


def eigenbasis(scheme: str | Scheme, valence: int) -> Eigenbasis:
    """Eigenvalues, eigenvectors and limit masks of a scheme around an interior vertex.

    The subdivision matrix acts on the ``K = 2 * valence + 8`` control points of a quad with one
    extraordinary corner (Stam 1998, section 3); their order is drawn in ``exact/matrices.py``.

    Parameters
    ----------
    scheme : str or Scheme
        A name such as "catmull-clark", or a scheme of your own.
    valence : int
        Number of faces around the vertex, at least 2.

    Returns
    -------
    Eigenbasis
        With `.exact` (sympy) and `.float64` (numpy), each holding `eigenvalues` (K,), `A`, `V`,
        `J`, `Vinv`, `residual` (K, K), `limit_mask` (K,) and `tangent_masks` (2, K).

    Raises
    ------
    ValueError
        For an unknown scheme, a valence below 2, or masks without a real Jordan basis.

    Notes
    -----
    Derived in ``derivations/eigenstructure.py``. Valence 2 has no tangent plane in general: the
    eigenvalue -1/4 ties with the subdominant 1/4; and its eigenvalue 1/8 has a Jordan block.

    Examples
    --------
    >>> import limitsurf as ls
    >>> basis = ls.eigenbasis("catmull-clark", valence=5)
    >>> basis
    <Eigenbasis of catmull-clark at interior valence 5: 18 control points, eigenvalues 1, ...>
    >>> print(basis.exact.eigenvalues[1].evalf(20))
    0.54998835451829717789
    """
    if not isinstance(valence, (int, np.integer)) or isinstance(valence, bool) or valence < 2:
        raise ValueError(f"the valence of an interior vertex is an integer >= 2, got {valence!r}")
    return Eigenbasis(find_scheme(scheme), int(valence))


if __name__ == "__main__":
    for written in write_shipped(Path(sys.argv[1]) if len(sys.argv) > 1 else SHIPPED):
        print(written)
