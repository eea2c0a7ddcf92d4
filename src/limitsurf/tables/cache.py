"""Eigen tables in memory, among those shipped with the package, on disk, or derived.

They are looked up in this order; those on disk in a per-user cache directory
(``LIMITSURF_CACHE_DIR``, else the platform's). A file is a zip archive of ``.npy`` arrays and the
full key: scheme, kind, valence, masks evaluated there, format version. It is read without
unpickling or evaluating anything, and only where nobody else could have written it
(``disk_cache.py``); and believed if key, digest, shapes, types and ranges of indices are right, and
if the numbers are those of the subdivision matrix. Otherwise it is derived again and replaced.
"""

from __future__ import annotations

import copyreg
import hashlib
import json
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from itertools import product
from math import lcm
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from limitsurf import disk_cache
from limitsurf.cage.checks import users_level
from limitsurf.disk_cache import Formats
from limitsurf.exact.matrices import subdivision_matrix
from limitsurf.scheme import SCHEMES, SHIPPED_SCHEMES
from limitsurf.scheme.dual import DualScheme
from limitsurf.scheme.scheme import Scheme
from limitsurf.scheme.sector import Sector
from limitsurf.tables.records import (
    Array,
    DenseRing,
    EigenTable,
    FourierRing,
    RationalTable,
    rounded,
)

if TYPE_CHECKING:
    from limitsurf.exact.matrices import SubdivisionMatrix
    from limitsurf.exact.ring import FourierModes

FORMAT = 2
SHIPPED = Path(__file__).parent.parent / "_data" / "tables"
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
        if not sector.fourier:
            _memory.setdefault(_ring_text(scheme, sector), made.ring)
        _memory.setdefault(text, made)
        if not made.normal.size:
            warn_once(scheme, sector)
    table: EigenTable = _memory[text]
    return table


_warned: set[str] = set()  # rings that the user has been warned of


def warn_once(scheme: Scheme, sector: Sector) -> None:
    """Say that a user's masks give no tangent plane, where they are what could give one."""
    ring = _ring_text(scheme, sector)
    own = sector.takes_vertex_mask and scheme not in SCHEMES.values()
    if own and ring not in _warned:
        _warned.add(ring)
        mask = f"{'corner' if scheme.lattice.dual else 'vertex'}({sector.faces}) decides"
        if not scheme.lattice.dual and scheme.has_own_spokes(sector.faces):
            mask = f"edge and {mask.removesuffix('s')}"
        warnings.warn(
            f"scheme {scheme.name!r} converges at {sector.place}, but has no tangent plane there: "
            f"its surfaces are not C1, and normals at these vertices are NaN; "
            f"{mask} (see limitsurf.{type(scheme).__name__})",
            UserWarning,
            stacklevel=users_level(),
        )


# a table travels to other processes as what it was made from
copyreg.pickle(EigenTable, lambda table: (eigen_table, (table.scheme, table.sector)))


def _assembled(scheme: Scheme, sector: Sector, derived: bool = False) -> tuple[EigenTable, bool]:
    """A table, and whether part of it is from the cache; all of it derived anew if `derived`."""
    key, formats = _key(scheme, sector), _table_formats(scheme, sector)
    arrays, cached = _stored(key, formats, lambda: _derive(scheme, sector), derived)
    ring: FourierRing | DenseRing | None
    if sector.fourier:
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
    return _key(scheme, replace(sector, position=0)) | {"position": "all"}


def _ring_text(scheme: Scheme, sector: Sector) -> str:
    return json.dumps(_ring_key(scheme, sector), sort_keys=True)


def _key(scheme: Scheme, sector: Sector) -> dict[str, Any]:
    smooth = sector.faces if sector.takes_vertex_mask else None
    place = {"kind": sector.kind, "faces": sector.faces, "position": sector.position}
    if isinstance(scheme, DualScheme):
        return {"format": FORMAT, **place, **scheme.key(smooth, sector.gathered)}
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
    for scheme, like in product(SHIPPED_SCHEMES, SHIPPED_SECTORS):
        if like.kind not in scheme.kinds:
            continue
        sector = scheme.sector(like.kind, like.faces, like.position)
        tables = [(_key(scheme, sector), _table_formats(scheme, sector), _derive)]
        if not sector.fourier and sector.position == 0:
            key = {**tables[0][0], "position": "all"}
            tables.append((key, _ring_formats(sector), _derive_ring))
        for key, formats, derive in tables:
            path = directory / _file_name(key)
            disk_cache.replace(path, disk_cache.encoded(derive(scheme, sector), key, formats))
            paths.append(path)
    return paths


def _file_name(key: dict[str, Any]) -> str:
    text = json.dumps(key, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:32] + ".npz"


def _derive(scheme: Scheme, sector: Sector) -> dict[str, Array]:
    """Derive a table and round it to float64."""
    from limitsurf.exact.fixed import mp
    from limitsurf.exact.ring import FourierModes
    from limitsurf.exact.spectrum import spectrum

    result = spectrum(scheme, sector)
    values = [mp.sign(x) * abs(x) if isinstance(x, mp.mpf) else abs(x) for x in result.eigenvalues]
    high = [float(x) for x in values]
    arrays = {
        "eigenvalues": np.array([high, [float(x - h) for x, h in zip(values, high, strict=True)]]),
        "pieces": rounded(result.pieces),
        "chains": np.array(result.chains, dtype=np.int64),
        "pairs": np.array(result.pairs, dtype=np.int64),
        "angles": np.array([float(mp.arg(result.eigenvalues[k])) for k in result.pairs]),
        "normal": np.array(result.normal, dtype=np.int64),
        "links": rounded(result.G),
        "outer": rounded(result.Winv),
        "order": np.array(result.order),
    }
    if isinstance(result.ring, FourierModes):
        arrays |= _fourier_arrays(result.ring)
    return arrays


def _derive_ring(scheme: Scheme, sector: Sector) -> dict[str, Array]:
    from limitsurf.exact.spectrum import ring_basis

    return {"left": rounded(ring_basis(scheme, sector).left())}


def _fourier_arrays(ring: FourierModes) -> dict[str, Array]:
    from limitsurf.exact.fixed import mp, to_fixed

    turn = [mp.mpf(f) / ring.faces for f in range(ring.faces // 2 + 1)]
    return {
        "frequency": np.array([mode.frequency for mode in ring.modes]),
        "parity": np.array([mode.parity for mode in ring.modes]),
        "left": rounded(to_fixed([mode.left for mode in ring.modes])),
        "half_turn": np.array([[float(wave(x)) for x in turn] for wave in (mp.cospi, mp.sinpi)]),
    }


def _table_formats(scheme: Scheme, sector: Sector) -> Formats:
    """The arrays of a table."""
    pieces = len(scheme.pieces_of(sector)), len(scheme.spline.exponents)
    size, ring, outer = sector.size, sector.ring, len(sector.outer)
    formats: Formats = {
        "eigenvalues": ("<f8", (2, size), None),
        "pieces": ("<f8", (*pieces, size), None),
        "chains": ("<i8", (-1,), range(2, size)),
        "pairs": ("<i8", (-1,), range(1, size - 1)),
        "angles": ("<f8", (-1,), None),
        "normal": ("<i8", (-1,), range(1, size)),
        "links": ("<f8", (outer, ring), None),
        "outer": ("<f8", (outer, outer), None),
        "order": ("<i8", (size,), range(size)),
    }
    return formats | (_ring_formats(sector) if sector.fourier else {})


def _ring_formats(sector: Sector) -> Formats:
    """The arrays of a ring."""
    ring = sector.ring
    if not sector.fourier:
        return {"left": ("<f8", (ring, ring), None)}
    return {
        "frequency": ("<i8", (ring,), range(sector.faces // 2 + 1)),
        "parity": ("<i8", (ring,), range(2)),
        "left": ("<f8", (ring, 1 + len(sector.lattice.orbits)), None),
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
    pieces = np.array(table.scheme.spline.pieces, dtype=float) @ refined[np.array(matrix.pieces)]
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
        or high[1] >= 1
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
    # the two positive modes that fall most slowly, ends of chains apart, as a right-handed pair
    slowest = np.setdiff1d(np.arange(1, table.size), chains - 1)[:3]
    if normal.shape != (2,) or not np.array_equal(np.sort(normal), slowest[:2]):
        return False
    second, third = table.rates[:, slowest[1:]].T
    tied = np.array_equal(second, np.abs(third)) and not (
        slowest[1] in chains and slowest[2] not in chains
    )
    if tied or (table.rates[0, normal] <= 0).any() or np.isin(normal, paired).any():
        return False
    if (table.order[table.normal_pairs] >= table.sector.ring).any():
        return False
    # at the middle of the piece in the middle
    (s, t), (i, j) = table.scheme.spline.inside, np.array(table.scheme.spline.exponents).T
    f = table.pieces[1][:, table.normal_pairs[1]]
    ds, dt = (i * s ** (i - 1.0) * t**j) @ f, (j * s**i * t ** (j - 1.0)) @ f
    return bool(ds[0] * dt[1] > ds[1] * dt[0])


def rational_table(
    scheme: Scheme, sector: Sector, rounded: bool = False, vertex: int | None = None
) -> RationalTable:
    """Return the exact refinement step of `scheme` around a special corner.

    Raises a TypeError for irrational masks, which names the `vertex` if it is given; if `rounded`,
    they are taken as float64 has them.
    """
    matrix = subdivision_matrix(scheme, sector)
    if rounded and not all(isinstance(w, Fraction) for row in matrix.rows for w in row.values()):
        return _rational_table(subdivision_matrix(scheme, sector, _rational), scheme, True)
    try:
        return _rational_table(matrix, scheme, False)
    except TypeError as error:
        raise TypeError(f"{error}" if vertex is None else f"vertex {vertex}: {error}") from None


def _rational(weight: Any) -> Fraction:
    return weight if isinstance(weight, Fraction) else Fraction(float(weight))


@lru_cache(maxsize=64)
def _rational_table(matrix: SubdivisionMatrix, scheme: Scheme, rounded: bool) -> RationalTable:
    from limitsurf.exact.sectors import limit_weights

    entries = sorted((c, r, w) for r, row in enumerate(matrix.rows) for c, w in row.items())
    if not all(isinstance(w, Fraction) for _, _, w in entries):
        raise TypeError(
            f"the masks of scheme {scheme.name!r} are irrational at {matrix.sector.place}: no "
            "exact numbers there; give points, u and v as float64"
        )
    denominator = lcm(*(w.denominator for _, _, w in entries))
    numerators = np.empty(len(entries), dtype=object)
    numerators[:] = [int(w * denominator) for _, _, w in entries]
    columns, rows = np.array([(c, r) for c, r, _ in entries]).T
    pieces, sector = np.array(matrix.pieces), matrix.sector
    mask = np.full(0 if rounded else sector.size, Fraction(0), dtype=object)
    if not rounded:
        mask[: sector.ring] = limit_weights(scheme, sector)
    count = len(matrix.rows)
    return RationalTable(sector, count, rows, columns, numerators, denominator, pieces, mask)
