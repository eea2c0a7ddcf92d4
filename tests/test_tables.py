"""Tables: right numbers, byte-stable files, and a cache that never believes what it should not."""

import copy
import dataclasses
import hashlib
import io
import json
import os
import pickle
import subprocess
import sys
import zipfile
from fractions import Fraction as F
from pathlib import Path

import mpmath
import numpy as np
import oracles
import oracles_loop
import platformdirs
import pytest

import limitsurf as ls
from limitsurf import disk_cache, tables
from limitsurf.exact.fixed import BITS
from limitsurf.exact.spectrum import dense_basis, spectrum
from limitsurf.numbers import FLOAT64
from limitsurf.scheme.loop import LOOP
from limitsurf.scheme.sector import Sector

CATMULL_CLARK = tables.SCHEMES["catmull-clark"]
ARRAYS = [field.name for field in dataclasses.fields(tables.EigenTable) if field.type == "Array"]
STORED = ["eigenvalues" if name == "rates" else name for name in ARRAYS]  # in files
RINGS = {
    kind: [field.name for field in dataclasses.fields(kind)]
    for kind in (tables.FourierRing, tables.DenseRing)
}
PACKAGE = Path(tables.__file__).parents[1]


def lazy_vertex(valence):
    """Less weight on the neighbours, at valences other than 4."""
    share = F(1, valence**2) if valence == 4 else F(3, 4 * valence**2)
    return 1 - 2 * valence * share, share, share


LAZY = dataclasses.replace(CATMULL_CLARK, name="lazy", vertex=lazy_vertex)


def smooth(N):
    return Sector("interior", N)


def eigen_table(scheme, N):
    return tables.eigen_table(scheme, smooth(N))


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache directory, and a memory that holds no table."""
    directory = tmp_path / "cache"
    monkeypatch.setenv("LIMITSURF_CACHE_DIR", str(directory))
    forget(monkeypatch)
    return directory


def forget(monkeypatch):
    """Be as a new process."""
    monkeypatch.setattr(tables.cache, "_memory", {})


def start(code, *arguments, **environment):
    """A new Python process, with warnings as errors."""
    return subprocess.Popen(
        [sys.executable, "-W", "error", *code, *map(str, arguments)],
        text=True,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=os.environ | environment,
    )


def result(process):
    """What it prints; it must end well and silently."""
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    assert not err
    return out


def run(code, *arguments, **environment):
    return result(start(["-c", code], *arguments, **environment))


def files(directory):
    """Content by name of all that is in a directory, also in folders below."""
    return {
        path.relative_to(directory).as_posix(): path.read_bytes()
        for path in directory.rglob("*")
        if path.is_file()
    }


def same(a, b):
    names = RINGS[type(b.ring)]
    return (
        all(np.array_equal(getattr(a, name), getattr(b, name)) for name in ARRAYS)
        and all(np.array_equal(getattr(a.ring, name), getattr(b.ring, name)) for name in names)
        and (a.sector, a.provenance) == (b.sector, b.provenance)
    )


def stored(directory):
    """The one file in the cache."""
    (path,) = directory.iterdir()
    return path


# --- the numbers ----------------------------------------------------------------------------------


def nearest(values):
    """Fixed-point numbers correctly rounded, through Fraction."""
    flat = [float(F(int(x), 1 << BITS)) for x in values.ravel()]
    return settled(np.array(flat).reshape(values.shape))


def settled(array):
    """Zero where nothing but the last digits are left of a zero."""
    return np.where(abs(array) < 1e-80, 0, array)


@pytest.mark.parametrize("scheme", [CATMULL_CLARK, LAZY], ids=lambda s: s.name)
@pytest.mark.parametrize("N", [2, 3, 5, 8, 17])
def test_tables_are_the_spectrum_correctly_rounded(scheme, N):
    table, exact = eigen_table(scheme, N), spectrum(scheme, smooth(N))
    size = 2 * N + 8
    assert table.size == size
    for array, needed in zip((table.V, table.Vinv), dense_basis(exact), strict=True):
        assert np.array_equal(settled(array), nearest(needed))
    assert np.array_equal(settled(table.pieces), nearest(exact.pieces))
    assert np.array_equal(settled(table.links), nearest(exact.G))
    assert np.array_equal(settled(table.outer), nearest(exact.Winv))
    modes = exact.ring.modes
    left = np.array([[float(x) for x in mode.left] for mode in modes])
    assert np.array_equal(settled(table.ring.left), settled(left))
    assert table.ring.frequency.tolist() == [mode.frequency for mode in modes]
    assert table.ring.parity.tolist() == [mode.parity for mode in modes]
    assert table.order.tolist() == exact.order
    assert table.pieces.shape == (3, 16, size)
    with mpmath.workprec(BITS):
        high = [float(x) for x in exact.eigenvalues]
        low = [float(x - h) for x, h in zip(exact.eigenvalues, high, strict=True)]
    assert table.rates.tolist() == [high, low]
    assert table.chains.tolist() == exact.chains
    assert table.normal.tolist() == list(exact.normal)
    assert not table.pairs.size
    assert not table.angles.size


@pytest.mark.parametrize("N", [2, 3, 4, 5, 12, 17, 33])
def test_float_basis(N):
    table = eigen_table(CATMULL_CLARK, N)
    assert abs(table.residual).max() < 1e-13
    assert abs(table.V @ table.Vinv - np.eye(table.size)).max() < 1e-13
    vertex, edge, diagonal = map(float, oracles.limit_mask(N))
    limit_mask = np.array([vertex, *[edge, diagonal] * N, *[0.0] * 7])
    assert abs(table.limit_mask - limit_mask).max() < 1e-16
    assert table.tangent_masks.shape == ((2, table.size) if N > 2 else (0, table.size))
    assert table.tangent_masks == pytest.approx(table.Vinv[1:3][: 2 * (N > 2)], abs=1e-15)
    assert table.A.sum(axis=1) == pytest.approx(np.ones(table.size), abs=1e-15)
    jordan = np.diag(table.rates[0])
    if N == 2:
        jordan[4, 5] = 1
    assert np.array_equal(table.J, jordan)


@pytest.mark.parametrize("N", [2, 3, 5, 8, 33])
def test_modes_are_the_left_eigenvectors(N):
    """The stored modes put together: rows of [[R^-1, 0], [-G R^-1, W^-1]]."""
    table = eigen_table(CATMULL_CLARK, N)
    half = np.pi * np.arange(N // 2 + 1) / N
    ring = table.ring
    assert ring.half_turn == pytest.approx(np.array([np.cos(half), np.sin(half)]), abs=1e-15)
    points = np.arange(2 * N)  # e_0, f_0, e_1, ... at angles of -1, 0, 1, ... half turns
    angle = np.pi / N * (points - 1) * ring.frequency[:, None]
    waves = np.where(ring.parity[:, None] == 1, np.sin(angle), np.cos(angle))
    left = np.hstack([ring.left[:, :1], waves * ring.left[:, 1 + points % 2]])
    below = np.hstack([-table.links @ left, table.outer])
    rows = np.vstack([np.hstack([left, np.zeros((2 * N + 1, 7))]), below])[table.order]
    assert abs(rows - table.Vinv).max() < 1e-13
    # what the ring makes of them: coefficients of points, and weights of the points in them
    data = np.random.default_rng(N).normal(size=(2, 2 * N + 1, 3))
    assert ring.coefficients(data) == pytest.approx(left @ data, abs=1e-12)
    assert ring.weights(data[..., 0]) == pytest.approx(data[..., 0] @ left, abs=1e-12)


@pytest.mark.parametrize("N", [3, 5, 17])
def test_no_noise_where_a_number_is_zero(N):
    """A zero is rounded to zero, not to what the last of the digits leave of it."""
    table = eigen_table(CATMULL_CLARK, N)
    for name in ("V", "Vinv", "pieces", "left", "half_turn", "links", "outer"):
        array = getattr(table, name, None)
        array = getattr(table.ring, name) if array is None else array
        noise = array[(array != 0) & (abs(array) < 1e-80)]
        assert not noise.size, name


@pytest.mark.parametrize("N", [2, 5])
def test_tables_are_read_only(N):
    table = eigen_table(CATMULL_CLARK, N)
    names = [*ARRAYS, "V", "Vinv", "J", "A"]
    assert [name for name in names if getattr(table, name).flags.writeable] == []
    for name in RINGS[type(table.ring)]:
        assert not getattr(table.ring, name).flags.writeable, name
    with pytest.raises(dataclasses.FrozenInstanceError):
        table.pieces = None


def test_tables_travel_between_processes():
    """As pickles, which surfaces are made of too."""
    table = eigen_table(CATMULL_CLARK, 5)
    for other in (pickle.loads(pickle.dumps(table)), copy.deepcopy(table)):
        assert same(other, table)
    basis = pickle.loads(pickle.dumps(ls.eigenbasis("catmull-clark", valence=5)))
    assert same(basis.float64, table)


def test_rational_table_is_the_matrix():
    table = tables.rational_table(CATMULL_CLARK, smooth(5))
    assert all(isinstance(x, int) for x in table.numerators)
    dense = np.zeros((27, 18), dtype=object)
    dense[table.rows, table.columns] = table.numerators * F(1, table.denominator)
    assert (dense.sum(axis=1) == 1).all()
    vertex = [1 - F(7, 20), *[F(3, 50), F(1, 100)] * 5, *[0] * 7]
    assert dense[0].tolist() == vertex
    vertex, edge, diagonal = oracles.limit_mask(5)
    assert table.limit_mask.tolist() == [vertex, *[edge, diagonal] * 5, *[0] * 7]
    assert tables.rational_table(CATMULL_CLARK, smooth(5)) is table


def test_a_valence_of_hundreds(cache, monkeypatch):
    """Fourier blocks: 728 control points take seconds."""
    table = eigen_table(CATMULL_CLARK, 360)
    with mpmath.workdps(50):
        ring = [x for values in oracles.ring_eigenvalues(360).values() for x in values]
        needed = sorted(map(float, [*ring, *oracles.OUTER_EIGENVALUES]))
    assert sorted(table.rates[0]) == pytest.approx(needed, rel=1e-15)
    assert table.limit_mask[:3] == pytest.approx([*map(float, oracles.limit_mask(360))], rel=1e-13)
    assert (table.pieces[:, 0, 0] == 1).all()
    assert not table.pieces[:, 1:, 0].any()
    assert stored(cache).stat().st_size < 1e6
    assert table.normal.tolist() == [1, 2]
    forget(monkeypatch)
    assert same(eigen_table(CATMULL_CLARK, 360), table)


# --- shipped tables -------------------------------------------------------------------------------


def test_shipped_tables_are_what_the_generator_writes(tmp_path):
    shipped = files(PACKAGE / "_data" / "tables")
    count = 0
    for scheme in tables.SHIPPED_SCHEMES:
        own = [s for s in tables.SHIPPED_SECTORS if s.kind in scheme.kinds]
        dense = (s for s in own if scheme.lattice.dual or s.open or s.kind == "dart")
        count += len(own) + len({(s.kind, s.faces) for s in dense})
    assert len(shipped) == count
    assert {smooth(N) for N in range(2, 17)} < {*tables.SHIPPED_SECTORS}
    assert sum(map(len, shipped.values())) < 2e6
    printed = result(start(["-m", "limitsurf.tables"], tmp_path / "new" / "folder")).split()
    assert sorted(Path(line).name for line in printed) == sorted(shipped)
    assert files(tmp_path / "new" / "folder") == shipped


def test_shipped_tables_need_neither_symbols_nor_digits_nor_a_cache(cache):
    code = """if True:
        import sys
        import numpy as np
        import limitsurf as ls
        from limitsurf.tables import SCHEMES, SHIPPED_SCHEMES, SHIPPED_SECTORS, eigen_table
        for sector in SHIPPED_SECTORS:
            eigen_table(SCHEMES["catmull-clark"], sector)
        points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
        quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
        surface = ls.LimitSurface(ls.Mesh(points, quads))
        surface.jet(np.arange(6), 0.25, 0.0)
        surface.normal(0, 0.0, 0.0)
        print(*sys.modules)
        for scheme in SHIPPED_SCHEMES:
            for s in SHIPPED_SECTORS:
                if s.kind in scheme.kinds:
                    eigen_table(scheme, scheme.sector(s.kind, s.faces, s.position))
    """
    modules = run(code).split()
    assert "limitsurf.tables" in modules
    assert not {"sympy", "mpmath"}.intersection(modules)
    assert not cache.exists()


def test_shipped_table_that_is_damaged_is_not_believed(cache, tmp_path, monkeypatch):
    monkeypatch.setattr(tables.cache, "SHIPPED", tmp_path)
    for name, content in files(PACKAGE / "_data" / "tables").items():
        damaged = bytearray(content)
        damaged[len(content) // 2] ^= 1
        (tmp_path / name).write_bytes(damaged)
    for sector, count in ((smooth(5), 1), (Sector("crease", 3, 1), 2), (Sector("dart", 4, 0), 2)):
        known = {path.name for path in cache.iterdir()} if cache.exists() else set()
        table = tables.eigen_table(CATMULL_CLARK, sector)
        new = {name: content for name, content in files(cache).items() if name not in known}
        assert len(new) == count
        shipped = files(PACKAGE / "_data" / "tables")
        assert new == {name: shipped[name] for name in new}
        forget(monkeypatch)
        assert same(tables.eigen_table(CATMULL_CLARK, sector), table)


# --- the cache ------------------------------------------------------------------------------------

COLD = """if True:
    import hashlib, sys
    from limitsurf.tables import SCHEMES, Sector, eigen_table
    table = eigen_table(SCHEMES["catmull-clark"], Sector("interior", 37))
    assert abs(table.limit_mask.sum() - 1) < 1e-14
    arrays = [table.rates, table.pieces, table.ring.left, table.links, table.outer]
    print(hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest())
    print("derived" if "mpmath" in sys.modules else "read", "sympy" in sys.modules)
"""


def test_a_valence_never_seen_is_derived_once_and_read_by_later_processes(cache):
    digest, *state = run(COLD, PYTHONHASHSEED="0").split()
    assert state == ["derived", "False"]
    path = stored(cache)
    content, status = path.read_bytes(), path.stat()
    assert run(COLD, PYTHONHASHSEED="1").split() == [digest, "read", "False"]
    assert path.read_bytes() == content
    assert path.stat().st_mtime_ns == status.st_mtime_ns
    # another process writes the same bytes
    path.unlink()
    assert run(COLD, PYTHONHASHSEED="2").split() == [digest, "derived", "False"]
    assert files(cache) == {path.name: content}


def test_memory_holds_one_table(cache):
    table = eigen_table(CATMULL_CLARK, 17)
    stored(cache).unlink()
    assert eigen_table(CATMULL_CLARK, 17) is table
    assert not list(cache.iterdir())


@pytest.mark.parametrize("named", [None, ""])
def test_default_directory_is_the_users(monkeypatch, tmp_path, named):
    if named is None:
        monkeypatch.delenv("LIMITSURF_CACHE_DIR", raising=False)
    else:
        monkeypatch.setenv("LIMITSURF_CACHE_DIR", named)
    monkeypatch.setattr(platformdirs, "user_cache_dir", lambda name: str(tmp_path / name))
    assert disk_cache.cache_directory() == tmp_path / "limitsurf"


def test_named_directory_is_made_with_its_parents(monkeypatch, tmp_path):
    forget(monkeypatch)
    monkeypatch.setenv("LIMITSURF_CACHE_DIR", str(tmp_path / "a" / "b"))
    eigen_table(LAZY, 3)
    assert len(files(tmp_path / "a" / "b")) == 1


def test_file_holds_its_key_and_plain_arrays(cache):
    table = eigen_table(LAZY, 3)
    with zipfile.ZipFile(stored(cache)) as archive:
        names = archive.namelist()
        header = json.loads(archive.read("key.json"))
        assert {member.date_time for member in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
    arrays = [*STORED, *RINGS[tables.FourierRing]]
    assert sorted(names) == sorted(["key.json", *(f"{name}.npy" for name in arrays)])
    assert header["key"] == {
        "format": tables.FORMAT,
        "kind": "interior",
        "faces": 3,
        "position": 0,
        "scheme": "lazy",
        "masks": {
            "face(4)": ["1/4"] * 4,
            "edge": ["1/4"] * 2,
            "vertex(4)": ["1/2", "1/16", "1/16"],
            "boundary": ["1/2", "3/4", "1/8"],
            "vertex(3)": ["1/2", "1/12", "1/12"],
        },
    }
    assert header["key"] == table.provenance
    with np.load(stored(cache), allow_pickle=False) as content:
        assert np.array_equal(content["pieces"], table.pieces)


def test_schemes_of_one_name_do_not_share_tables(cache, monkeypatch):
    other = dataclasses.replace(
        LAZY, vertex=lambda N: lazy_vertex(N) if N != 6 else CATMULL_CLARK.vertex(6)
    )
    assert other.name == LAZY.name
    first, second = eigen_table(LAZY, 6), eigen_table(other, 6)
    assert len(list(cache.iterdir())) == 2
    assert not np.array_equal(first.limit_mask, second.limit_mask)
    assert np.array_equal(second.pieces, eigen_table(CATMULL_CLARK, 6).pieces)
    forget(monkeypatch)  # from the files
    assert same(eigen_table(LAZY, 6), first)
    assert same(eigen_table(other, 6), second)
    # where their masks agree, they share
    eigen_table(LAZY, 5)
    eigen_table(other, 5)
    assert len(list(cache.iterdir())) == 3


def test_masks_are_asked_for_every_time(cache):
    """A scheme is code; of the same name and other masks there are other tables."""
    mask = CATMULL_CLARK.vertex
    scheme = dataclasses.replace(LAZY, vertex=lambda N: mask(N))
    before = eigen_table(scheme, 5)
    assert np.array_equal(before.pieces, eigen_table(CATMULL_CLARK, 5).pieces)
    mask = lazy_vertex
    with pytest.raises(ValueError, match=r"vertex\(5\) is .* but was .* asked before"):
        eigen_table(scheme, 5)
    scheme = dataclasses.replace(LAZY, vertex=lambda N: mask(N))
    after = eigen_table(scheme, 5)
    assert after is eigen_table(LAZY, 5)
    assert not np.array_equal(after.pieces, before.pieces)
    rational = tables.rational_table(scheme, smooth(5))
    lazy = tables.rational_table(LAZY, smooth(5))
    assert rational.limit_mask.tolist() == lazy.limit_mask.tolist()
    assert rational.numerators.tolist() == lazy.numerators.tolist()


def test_names_are_part_of_the_key(cache):
    """The same masks under another name: its own file, its own provenance."""
    renamed = dataclasses.replace(CATMULL_CLARK, name="renamed")
    table = eigen_table(renamed, 5)
    assert table.provenance["scheme"] == "renamed"
    assert len(list(cache.iterdir())) == 1


def test_tables_may_be_derived_in_many_threads(tmp_path):
    """Precision is not shared: every thread writes what a single one would."""
    code = """if True:
        import os, sys
        from concurrent.futures import ThreadPoolExecutor
        from limitsurf.tables import SCHEMES, Sector, eigen_table
        sys.setswitchinterval(1e-5)
        sectors = [Sector("interior", N) for N in range(17, 27)]
        sectors += [Sector(kind, 7, p) for kind in ("crease", "dart") for p in (0, 3)]
        with ThreadPoolExecutor(int(sys.argv[1])) as pool:
            list(pool.map(lambda sector: eigen_table(SCHEMES["catmull-clark"], sector), sectors))
        import mpmath
        print(mpmath.mp.prec)
    """
    one, many = tmp_path / "one", tmp_path / "many"
    assert int(run(code, 1, LIMITSURF_CACHE_DIR=str(one))) == 53
    precision = int(run(code, 8, LIMITSURF_CACHE_DIR=str(many)))
    assert len(files(one)) == 16
    assert files(many) == files(one)
    assert precision == 53


def test_many_processes_at_once_leave_one_good_file(cache):
    code = "input('ready')\n" + COLD
    processes = [start(["-c", code]) for _ in range(5)]
    for process in processes:
        assert process.stdout.read(5) == "ready"
    for process in processes:
        process.stdin.write("\n")
        process.stdin.flush()
    outputs = {result(process).split()[0] for process in processes}
    assert len(outputs) == 1
    path, content = stored(cache), stored(cache).read_bytes()
    path.unlink()
    eigen_table(CATMULL_CLARK, 37)  # alone
    assert files(cache) == {path.name: content}
    assert run(COLD).split()[1] == "read"


# --- files that are not to be believed ------------------------------------------------------------


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """A table, and the bytes of its file."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        forget(monkeypatch)
        directory = tmp_path_factory.mktemp("good")
        monkeypatch.setenv("LIMITSURF_CACHE_DIR", str(directory))
        table = eigen_table(LAZY, 3)
        return table, stored(directory).name, stored(directory).read_bytes()


def check_replaced(cache, good, content):
    """A file of this content yields the right table, and the right file."""
    table, name, right = good
    cache.mkdir()
    (cache / name).write_bytes(content)
    assert same(eigen_table(LAZY, 3), table)
    assert files(cache) == {name: right}


def zipped(members, compression=zipfile.ZIP_STORED):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compression) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return buffer.getvalue()


def unzipped(content):
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def with_member(content, name, member):
    """The file with another member and the digest that goes with it."""
    members = unzipped(content) | {name: member}
    arrays = b"".join(members[key] for key in members if key != "key.json")
    header = json.loads(members["key.json"]) | {"sha256": hashlib.sha256(arrays).hexdigest()}
    members["key.json"] = json.dumps(header, sort_keys=True, indent=1).encode()
    return zipped(members)


def npy(array, **options):
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, array, **options)
    return buffer.getvalue()


def regions(content):
    """Offsets in every part of the zip file: local headers, names, contents, directory, its end."""
    found = {}
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        for member in archive.infolist():
            name = member.filename
            if name not in ("key.json", "pieces.npy", "order.npy"):
                continue
            start = member.header_offset
            data = start + 30 + len(name)
            found |= {f"{name} local {k}": start + k for k in (0, 4, 6, 8, 10, 14, 18, 22, 26, 28)}
            found[f"{name} local name"] = start + 30
            spread = range(0, member.file_size, max(1, member.file_size // 4))
            found |= {f"{name} content {k}": data + k for k in spread}
            found[f"{name} content end"] = data + member.file_size - 1
            central = content.index(name.encode(), archive.start_dir) - 46
            steps = (0, 4, 6, 8, 10, 12, 16, 20, 24, 28, 30, 32, 34, 36, 38, 42, 46)
            found |= {f"{name} directory {k}": central + k for k in steps}
    found |= {f"anywhere {k}": k for k in range(0, len(content), 101)}
    end = content.rindex(b"PK\x05\x06")
    found |= {f"end {k}": end + k for k in (0, 4, 8, 10, 12, 16, 20)}
    return found


def test_a_flipped_bit_anywhere_is_noticed(cache, good, monkeypatch):
    table, name, right = good
    cache.mkdir()
    arrays = {stored: getattr(table, name) for stored, name in zip(STORED, ARRAYS, strict=True)}
    arrays |= {name: getattr(table.ring, name) for name in RINGS[tables.FourierRing]}
    monkeypatch.setattr(tables.cache, "_derive", lambda *_: dict(arrays))
    wrong = {}
    for region, offset in regions(right).items():
        for bit in (0, 3, 6):
            content = bytearray(right)
            content[offset] ^= 1 << bit
            (cache / name).write_bytes(content)
            tables.cache._memory.clear()
            try:
                assert same(eigen_table(LAZY, 3), table)
                if files(cache) != {name: right}:
                    wrong[region, bit] = "not replaced"
            except Exception as error:
                wrong[region, bit] = f"{type(error).__name__}: {error}"
    assert not wrong


@pytest.mark.parametrize("length", [0, 1, 21, 22, 100, 500, 5000, 0.5, 0.9, -1000, -100, -22, -1])
def test_truncated_file_is_replaced(cache, good, length):
    content = good[2]
    if isinstance(length, float):
        length = int(length * len(content))
    check_replaced(cache, good, content[:length])


def test_lengthened_file_is_replaced(cache, good):
    check_replaced(cache, good, good[2] + b"more")


@pytest.mark.parametrize(
    "foreign",
    [
        pytest.param(lambda right: b"not a table\n" * 100, id="text"),
        pytest.param(lambda right: bytes(len(right)), id="zeros"),
        pytest.param(lambda right: b"#!/bin/sh\n" + right, id="something before"),
        pytest.param(lambda right: zipped({}), id="empty archive"),
        pytest.param(lambda right: zipped({"a.txt": "b"}), id="other members"),
        pytest.param(lambda right: zipped({"key.json": b"[1, 2]"}), id="key is a list"),
        pytest.param(lambda right: zipped({"key.json": b"\xff\xfe{"}), id="key is not UTF-8"),
        pytest.param(lambda right: zipped({"key.json": b"[" * 100_000}), id="key is deep"),
        pytest.param(lambda right: zipped({"key.json": b"9" * 9_000}), id="key is long"),
        pytest.param(
            lambda right: zipped(unzipped(right) | {"outer.npy": b"\x93NUMPY"}),
            id="member cut short",
        ),
        pytest.param(
            lambda right: zipped({k: v for k, v in unzipped(right).items() if k != "outer.npy"}),
            id="member missing",
        ),
        pytest.param(lambda right: zipped(unzipped(right), zipfile.ZIP_DEFLATED), id="compressed"),
        pytest.param(lambda right: damaged(right, zipfile.ZIP_DEFLATED), id="bad deflate"),
        pytest.param(lambda right: damaged(right, zipfile.ZIP_LZMA), id="bad lzma"),
        pytest.param(lambda right: damaged(right, zipfile.ZIP_BZIP2), id="bad bzip2"),
        pytest.param(
            lambda right: zipped(unzipped(right) | {"outer.npy": npy(np.eye(7))}),
            id="another digest",
        ),
        pytest.param(
            lambda right: with_member(right, "outer.npy", npy(np.eye(6))), id="another shape"
        ),
        pytest.param(
            lambda right: with_member(right, "outer.npy", npy(np.eye(7, dtype="f4"))),
            id="another type",
        ),
        pytest.param(
            lambda right: with_member(right, "outer.npy", npy(np.full((7, 7), np.nan))), id="NaN"
        ),
        pytest.param(
            lambda right: with_member(right, "outer.npy", b"\x93NUMPY\x01\x00\x10\x00" + b"(" * 16),
            id="header is nonsense",
        ),
        pytest.param(
            lambda right: with_member(
                right,
                "outer.npy",
                npy(np.eye(7)).replace(b"(7, 7), }    ", b"(7, 10**9), }"),
            ),
            id="header is an expression",
        ),
        pytest.param(
            lambda right: with_member(
                right,
                "outer.npy",
                npy(np.eye(7)).replace(b"(7, 7), }         ", b"(99999999999999,)}"),
            ),
            id="header claims more than there is",
        ),
    ],
)
def test_foreign_file_is_replaced(cache, good, foreign):
    content = foreign(good[2])
    assert content != good[2]
    check_replaced(cache, good, content)


def damaged(content, compression):
    """A compressed archive whose compressed bytes are wrong."""
    content = bytearray(zipped(unzipped(content), compression))
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        for member in archive.infolist():
            begin = member.header_offset + 30 + len(member.filename)
            for k in range(begin + 12, begin + member.compress_size):
                content[k] ^= 0xFF
    return bytes(content)


@pytest.mark.parametrize(
    "change",
    [
        {"faces": 5},
        {"position": 1},
        {"format": 1},
        {"scheme": "other"},
        {"kind": "crease"},
        {"masks": {}},
    ],
    ids=str,
)
def test_file_of_another_key_under_this_name_is_replaced(cache, good, change):
    members = unzipped(good[2])
    header = json.loads(members["key.json"])
    header["key"] |= change
    members["key.json"] = json.dumps(header, sort_keys=True, indent=1).encode()
    check_replaced(cache, good, zipped(members))


@pytest.mark.parametrize(
    "name", sorted({*STORED, *RINGS[tables.FourierRing]} - {"chains", "pairs", "angles"})
)
def test_wrong_number_with_the_right_digest_is_replaced(cache, good, name):
    """Off by a thousandth, which no digest of the file tells."""
    right = good[2]
    array = np.lib.format.read_array(io.BytesIO(unzipped(right)[name + ".npy"]))
    wrong = array[::-1].copy() if array.dtype.kind == "i" else array
    if array.dtype.kind == "f":
        wrong.flat[np.argmax(abs(wrong))] *= 1.001
    check_replaced(cache, good, with_member(right, name + ".npy", npy(wrong)))


@pytest.mark.parametrize("index", [10**9, -1, -(2**63)])
@pytest.mark.parametrize("name", ["chains", "pairs", "normal", "order", "frequency", "parity"])
def test_index_out_of_range_is_replaced(cache, good, name, index):
    array = np.lib.format.read_array(io.BytesIO(unzipped(good[2])[name + ".npy"]))
    wrong = np.append(array[1:], index)
    check_replaced(cache, good, with_member(good[2], name + ".npy", npy(wrong)))


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        pytest.param("order", np.zeros(15, dtype=int), id="indices twice"),
        pytest.param("chains", np.array([5]), id="a chain too many"),
        pytest.param("pairs", np.array([3]), id="a pair without its angle"),
        pytest.param("normal", np.array([1]), id="one vector for a normal"),
        pytest.param("normal", np.array([1, 3]), id="another vector"),
    ],
)
def test_indices_that_make_no_sense_are_replaced(cache, good, name, wrong):
    check_replaced(cache, good, with_member(good[2], name + ".npy", npy(wrong)))


SECTORS = [Sector("crease", 7, 3), Sector("corner", 6, 0), Sector("dart", 7, 6), Sector("cone", 9)]
SECTORS += [smooth(17), smooth(20)]


@pytest.mark.parametrize("sector", SECTORS, ids=str)
def test_any_wrong_file_of_a_sector_is_replaced(cache, monkeypatch, sector):
    """The ring that all positions share is one of its own."""
    right = tables.eigen_table(CATMULL_CLARK, sector)
    content = files(cache)
    random = np.random.default_rng(0)
    monkeypatch.setattr(tables.cache, "_derive", derived := counted(tables.cache._derive))
    for name, good in content.items():
        for array in sorted(set(unzipped(good)) - {"key.json"}):
            wrong = np.lib.format.read_array(io.BytesIO(unzipped(good)[array]))
            if wrong.dtype.kind == "i" or not wrong.size:
                continue
            # low parts of eigenvalues differ by less than any check can tell
            some = wrong[0] if array == "eigenvalues.npy" else wrong
            place = tuple(random.choice(np.argwhere(abs(some) > abs(some).max() / 100)))
            some[place] *= 1.001
            (cache / name).write_bytes(with_member(good, array, npy(wrong)))
            forget(monkeypatch)
            assert same(tables.eigen_table(CATMULL_CLARK, sector), right), array
            assert files(cache) == content, array
    forget(monkeypatch)
    before = len(derived.calls)
    assert same(tables.eigen_table(CATMULL_CLARK, sector), right)
    assert len(derived.calls) == before  # a right one is believed


def counted(function):
    calls = []

    def call(*arguments):
        calls.append(arguments)
        return function(*arguments)

    vars(call)["calls"] = calls
    return call


def test_good_file_of_another_table_under_this_name_is_replaced(cache, good, tmp_path):
    other = dataclasses.replace(LAZY, vertex=CATMULL_CLARK.vertex)
    table = eigen_table(other, 3)
    content = stored(cache).read_bytes()
    assert table.provenance["scheme"] == good[0].provenance["scheme"]
    stored(cache).unlink()
    cache.rmdir()
    check_replaced(cache, good, content)


class Bomb:
    """Leaves a trace when it is unpickled."""

    def __init__(self, trace):
        self.trace = trace

    def __reduce__(self):
        return Path.touch, (self.trace,)


@pytest.mark.parametrize("member", ["outer.npy", "chains.npy", "key.json"])
def test_pickles_are_never_loaded(cache, good, tmp_path, member):
    trace = tmp_path / "trace"
    objects = np.empty((7, 7), dtype=object)
    objects[:] = Bomb(trace)
    payload = npy(objects, allow_pickle=True)
    np.lib.format.read_array(io.BytesIO(payload), allow_pickle=True)
    assert trace.exists()  # it would go off
    trace.unlink()
    if member == "key.json":
        content = zipped(unzipped(good[2]) | {member: pickle.dumps(Bomb(trace))})
    else:
        content = with_member(good[2], member, payload)
    check_replaced(cache, good, content)
    assert not trace.exists()


# --- directories that cannot be written -----------------------------------------------------------


TROUBLE = """if True:
    import os, sys, warnings
    from limitsurf.tables import SCHEMES, Sector, eigen_table
    {trouble}
    with warnings.catch_warnings(record=True) as record:
        warnings.simplefilter("always")
        for sector in (Sector("interior", 17), Sector("crease", 9, 4), Sector("dart", 8, 0)):
            table = eigen_table(SCHEMES["catmull-clark"], sector)
            assert (table.pieces[:, :, 0] == [[1] + [0] * 15] * 3).all()
    for warning in record:
        print(warning.category.__name__, warning.message)
"""


def check_one_warning(output, *words):
    (line,) = output.splitlines()
    assert line.startswith("RuntimeWarning ")
    assert all(word in line for word in words)


def test_directory_below_a_file(tmp_path):
    (tmp_path / "file").write_text("in the way")
    directory = tmp_path / "file" / "cache"
    output = run(TROUBLE.format(trouble=""), LIMITSURF_CACHE_DIR=str(directory))
    check_one_warning(output, str(directory), "Not a directory")
    assert files(tmp_path) == {"file": b"in the way"}


def test_read_only_directory(cache):
    """One warning, although every attempt fails on a temporary file of another name."""
    cache.mkdir()
    trouble = """
    true_open = os.open
    def open(path, flags, *rest, **options):
        if flags & os.O_CREAT and "cache" in str(path):
            raise PermissionError(13, "Permission denied", path)
        return true_open(path, flags, *rest, **options)
    os.open = open
    """
    check_one_warning(run(TROUBLE.format(trouble=trouble)), str(cache), "Permission denied")
    assert not list(cache.iterdir())


def test_full_disk_leaves_nothing_behind(cache):
    trouble = """
    def replace(*_):
        raise OSError(28, "No space left on device")
    os.replace = replace
    """
    check_one_warning(run(TROUBLE.format(trouble=trouble)), str(cache), "No space left on device")
    assert not list(cache.iterdir())
    assert run(TROUBLE.format(trouble="")) == ""
    assert len(list(cache.iterdir())) == 5


def test_directories_in_the_place_of_the_files(cache):
    assert run(TROUBLE.format(trouble="")) == ""
    names = sorted(files(cache))
    for name in names:
        (cache / name).unlink()
        (cache / name).mkdir()
    check_one_warning(run(TROUBLE.format(trouble="")), str(cache), "directory")
    assert sorted(path.name for path in cache.iterdir()) == names
    assert not files(cache)


# --- the public call ------------------------------------------------------------------------------


@pytest.mark.parametrize("N", [2, 3, 4, 5, 8])
def test_eigenbasis(N):
    basis = ls.eigenbasis("catmull-clark", valence=N)
    size = 2 * N + 8
    for numbers in (basis.exact, basis.float64):
        for name in ("A", "V", "J", "Vinv", "residual"):
            assert getattr(numbers, name).shape == (size, size), name
        assert len(numbers.limit_mask) == size
        assert [len(mask) for mask in numbers.tangent_masks] == [size] * (2 if N > 2 else 0)
    assert len(basis.exact.eigenvalues) == size
    assert basis.float64 is eigen_table(CATMULL_CLARK, N)
    assert basis.exact.residual.is_zero_matrix
    assert basis.exact is basis.exact
    assert basis.valence == N
    assert basis.scheme is CATMULL_CLARK
    assert basis.sector == smooth(N)
    assert basis.provenance["kind"] == "interior"
    assert basis.provenance["faces"] == N
    assert basis.provenance["scheme"] == "catmull-clark"
    assert "Catmull and Clark 1978" in basis.provenance["paper"]


@pytest.mark.parametrize("N", [2, 3, 4, 8])
def test_exact_digits_are_those_of_the_fixed_point(N):
    basis = ls.eigenbasis("catmull-clark", valence=N)
    fixed, _ = dense_basis(spectrum(CATMULL_CLARK, smooth(N)))
    with mpmath.workdps(70):
        got = np.array(basis.exact.V.evalf(60).tolist(), dtype=object)
        for x, k in zip(got.ravel(), fixed.ravel(), strict=True):
            assert abs(mpmath.mpf(str(x)) - mpmath.mpf(int(k)) / 2**BITS) < 1e-55


def test_eigenbasis_prints_itself():
    assert repr(ls.eigenbasis("catmull-clark", valence=3)) == (
        "<Eigenbasis of catmull-clark at interior valence 3: 14 control points, "
        "eigenvalues 1, 0.410097 (x2), 0.166667, 0.152403 (x2), 0.125 (x2), 0.0625 (x2), ...>"
    )
    for N in (2, 3, 5):
        text = ls.eigenbasis("catmull-clark", valence=N)._repr_latex_()
        assert text.startswith("$")
        assert text.endswith("$")
        assert f"interior valence {N}" in text
        assert text.count("{") == text.count("}")
    assert r"\sqrt{17}" in ls.eigenbasis("catmull-clark", valence=3)._repr_latex_()


def test_eigenbasis_counts_a_repeated_eigenvalue_once():
    """Equal eigenvalues are equal also where rounding made them differ."""
    for N in range(2, 17):
        text = repr(ls.eigenbasis("catmull-clark", valence=N))
        shown = text.split("eigenvalues ")[1].split(", ")
        values = [term.split(" ")[0] for term in shown]
        assert len(set(values)) == len(values), text


def test_eigenbasis_takes_a_scheme_and_numpy_integers():
    basis = ls.eigenbasis(LAZY, valence=np.int64(5))
    assert basis.scheme is LAZY
    assert type(basis.valence) is int
    assert basis.exact.residual.is_zero_matrix
    assert same(basis.float64, eigen_table(LAZY, 5))


@pytest.mark.parametrize("valence", [1, 0, -3, 2.5, 5.0, True, "5", F(5)])
def test_eigenbasis_refuses_other_valences(valence):
    integer = type(valence) is int
    needed = "valence of an interior vertex is at least 2" if integer else "is an integer"
    with pytest.raises(ValueError, match=f"{needed}, got ") as caught:
        ls.eigenbasis("catmull-clark", valence=valence)
    assert repr(valence) in str(caught.value)


@pytest.mark.parametrize("scheme", ["kobbelt", "", None, 7])
def test_eigenbasis_refuses_unknown_schemes(scheme):
    error = ValueError if isinstance(scheme, str) else TypeError
    with pytest.raises(error, match=r"(unknown scheme|scheme: got) .*catmull-clark") as caught:
        ls.eigenbasis(scheme, valence=5)
    assert repr(scheme) in str(caught.value)


# ------------------------------------------------------------------ triangles around a vertex


def loop_ring(kind, n):
    """One step of Loop's rules on a vertex and its neighbours, as Hoppe and others have them."""
    v, *e = np.eye(n + 1 + (kind in ("crease", "corner")))
    sharp = {"dart": [0], "crease": [0, n], "corner": [0, n]}.get(kind, [])
    own, each = 1.0, 0.0
    if kind in ("interior", "dart"):
        each = float(oracles_loop.loop_weight(n, bits=100))
        own = 1 - n * each
    new = [own * v + each * np.sum(e, axis=0)]
    if kind == "crease":
        new = [(6 * v + e[0] + e[n]) / 8]
    for j in range(len(e)):
        beside = e[j - 1] + e[(j + 1) % len(e)]
        new.append((v + e[j]) / 2 if j in sharp else (3 * v + 3 * e[j] + beside) / 8)
    return np.array(new)


@pytest.mark.parametrize("kind", ["interior", "cone", "crease", "corner", "dart"])
def test_masks_of_rings_of_many_triangles(kind):
    n = 70
    step, masks = loop_ring(kind, n), tables.ring_masks(LOOP, kind, n)
    assert [x.shape[-1] for x in (*masks.limit, *masks.waves)] == [len(step) - 1, 0] * 2
    limit = tables.limit_mask(LOOP, kind, n, FLOAT64)
    np.testing.assert_allclose(limit @ step, limit, rtol=0, atol=1e-15)
    assert limit.sum() == pytest.approx(1, abs=1e-15)
    assert np.array_equal(limit[1:], masks.limit[0])
    values = np.sort(np.abs(np.linalg.eigvals(step)))[::-1][1:]
    for left in masks.waves[0]:
        left = np.concatenate([[-left.sum()], left])
        after = left @ step
        value = after @ left / (left @ left)
        np.testing.assert_allclose(after, value * left, rtol=0, atol=1e-13 * np.abs(left).max())
        assert np.abs(values[: len(masks.waves[0])] - value).min() < 1e-12
    assert masks.has_normal == (kind in ("interior", "dart"))
    pairs = tables.normal_masks(LOOP, kind, n)
    assert pairs.shape == (2 * masks.has_normal, 2, len(step))
    if masks.has_normal:  # of a flat ring, counter-clockwise
        turn = 2 * np.pi * np.arange(n) / n
        ring = np.concatenate([[[0, 0]], np.stack([np.cos(turn), np.sin(turn)], axis=1)])
        assert (np.linalg.det(pairs @ ring) > 0).all()


def test_limits_at_many_triangles_are_the_known_ones():
    n, number = 70, FLOAT64
    own, each = map(float, oracles_loop.limit_mask(n, bits=100))
    smooth = tables.limit_mask(LOOP, "interior", n, number)
    np.testing.assert_allclose(smooth, [own] + [each] * n, rtol=1e-14)
    dart = [float(x) for x in oracles_loop.dart_mask(n, bits=100)]
    np.testing.assert_allclose(tables.limit_mask(LOOP, "dart", n, number), dart, rtol=0, atol=1e-15)
    first, second = tables.ring_masks(LOOP, "interior", n).waves[0]
    cosines, sines = (np.array(x, dtype=float) for x in oracles_loop.tangent_masks(n))
    np.testing.assert_allclose([first, second], [cosines, sines], rtol=0, atol=1e-15)
