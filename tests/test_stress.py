"""Many callers at once, forked processes, and arrays of every kind: answers stay what they are."""

import itertools
import os
import pickle
import subprocess
import sys
import textwrap
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import zoo

import limitsurf as ls
from limitsurf.engine.packing import CHUNK

THREADS = 8
both_ways = pytest.mark.parametrize("kernels", [True, False], ids=["compiled", "numpy"])


@pytest.fixture(autouse=True)
def _kernels_or_numpy(request, use):
    """Compiled kernels for calls of any size, or none, as the test says; else the former."""
    use("kernels" not in request.fixturenames or request.getfixturevalue("kernels"))


def cage(name="holes"):
    points, faces, tags = zoo.TAGGED[name]()
    uv = np.random.default_rng(0).random((len(points), 2)), np.concatenate(faces), "corners_only"
    return ls.Mesh(np.asarray(points, dtype=float), faces, channels={"uv": uv}, **tags)


def queries(surface, n, seed=1):
    """Some of them close to corners, on edges, and without a value."""
    rng = np.random.default_rng(seed)
    u, v = rng.random((2, n)) ** rng.choice([1, 20], n)
    u[::7] = 0
    v[::11] = np.nan
    return rng.integers(len(surface.limit_faces), size=n), u, v


def same(one, other):
    return np.array_equal(one, other, equal_nan=True)


def answers(surface, query, workers=1):
    """Of all kinds, as a list of arrays."""
    W = surface.weights(*query, nu=(0, 1), workers=workers)
    return [
        surface.evaluate(*query, workers=workers),
        surface.evaluate(*query, nu=(1, 1), workers=workers),
        surface.evaluate(*query, channel="uv", workers=workers),
        *surface.jet(*query, workers=workers).values(),
        surface.normal(*query, workers=workers),
        W.data,
        W.indices,
        W.indptr,
    ]


# --- Threads


@both_ways
def test_callers_at_the_same_time(kernels):
    """Of a surface that nobody has used before: what it keeps may be made more than once."""
    mesh = cage()
    query = queries(ls.LimitSurface(mesh), 1000)
    serial = answers(ls.LimitSurface(mesh), query)
    for _ in range(3):
        surface, barrier = ls.LimitSurface(mesh), threading.Barrier(THREADS)

        def call(k, surface=surface, barrier=barrier):
            barrier.wait()
            return answers(surface, query, workers=1 + k % 3)

        with ThreadPoolExecutor(THREADS) as pool:
            for found in pool.map(call, range(THREADS)):
                assert all(same(x, y) for x, y in zip(found, serial, strict=True))


@both_ways
def test_surfaces_made_and_moved_by_many_callers(kernels):
    """Each has points, or a surface, of its own; patches and tables are shared."""
    mesh = cage()
    surface = ls.LimitSurface(mesh)
    query = queries(surface, 1000)
    moved = [mesh.points * (k + 1) for k in range(THREADS)]
    serial = [answers(ls.LimitSurface(mesh.with_points(points)), query) for points in moved]
    barrier = threading.Barrier(THREADS)

    def call(k):
        barrier.wait()
        found = []
        for j in range(3):
            if j == 2:
                other = pickle.loads(pickle.dumps(surface)).with_points(moved[k])
            elif (j + k) % 2:
                other = surface.with_points(moved[k])
            else:
                other = ls.LimitSurface(mesh.with_points(moved[k]))
            found.append(answers(other, query, workers=2))
        return found

    with ThreadPoolExecutor(THREADS) as pool:
        for k, several in enumerate(pool.map(call, range(THREADS))):
            for found in several:
                assert all(same(x, y) for x, y in zip(found, serial[k], strict=True))
    assert (surface.points == mesh.points).all()


def test_many_chunks_in_many_threads():
    surface = ls.LimitSurface(cage())
    query = queries(surface, 3 * CHUNK + 5)
    serial = surface.evaluate(*query)
    with ThreadPoolExecutor(THREADS) as pool:
        calls = [pool.submit(surface.evaluate, *query, workers=1 + k % 4) for k in range(THREADS)]
        assert all(same(call.result(), serial) for call in calls)


def test_errors_in_threads():
    """One caller's mistake is not another's, and a pool of workers survives it."""
    surface = ls.LimitSurface(cage())
    good, bad = queries(surface, 2 * CHUNK), queries(surface, 2 * CHUNK)
    bad[0][-1] = len(surface.limit_faces)
    serial = surface.evaluate(*good)
    with ThreadPoolExecutor(THREADS) as pool:
        calls = [
            pool.submit(surface.evaluate, *(bad if k % 2 else good), workers=2)
            for k in range(THREADS)
        ]
        for k, call in enumerate(calls):
            if k % 2:
                with pytest.raises(IndexError, match=f"at index {2 * CHUNK - 1}"):
                    call.result()
            else:
                assert same(call.result(), serial)


# --- Processes

FORK = """
import multiprocessing, os, signal, sys, threading, time
import numpy as np
import limitsurf as ls
from limitsurf import _kernels

def result(surface, query, workers):
    values = [surface.evaluate(*query, workers=workers), surface.normal(*query, workers=workers)]
    return [*values, surface.weights(*query, workers=workers).data]

def check(expected, workers):
    found = result(surface, query, workers)
    return all(np.array_equal(x, y) for x, y in zip(found, expected))

ls.precompile()
points = np.random.default_rng(0).random((8, 3))
quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
surface = ls.LimitSurface(ls.Mesh(points, quads))
rng = np.random.default_rng(1)
query = rng.integers(6, size=70000), *rng.random((2, 70000))

def fork(work):
    pid = os.fork()
    if not pid:
        signal.alarm(120)  # a child that hangs ends; one that must compile takes its time
        code = 1
        try:
            code = 0 if work() else 2
        finally:
            os._exit(code)
    return pid

def ended(pid):
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
"""


def run(script, seconds=900):
    """A process of its own, as forks of one with threads are not for that of the tests."""
    script = FORK + textwrap.dedent(script)
    command = [sys.executable, "-W", "ignore::DeprecationWarning", "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, timeout=seconds, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout.split()


needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="forks")


@needs_fork
def test_forks():
    """Before kernels are loaded, after they have run in threads, and by multiprocessing."""
    found = run(
        """
        early = fork(lambda: len(result(surface, query, 2)) == 3)
        expected = result(surface, query, 2)
        late = [fork(lambda k=k: check(expected, k)) for k in (1, 2)]
        print(ended(early), *map(ended, late))
        with multiprocessing.get_context("fork").Pool(2) as pool:
            print(*pool.starmap(check, [(expected, 1), (expected, 2)]))
        """
    )
    assert found == ["0", "0", "0", "True", "True"]


@needs_fork
def test_forks_while_others_evaluate():
    """Also while kernels are being compiled or loaded, which holds a lock."""
    found = run(
        """
        stop = threading.Event()
        begun = threading.Event()

        def busy():
            while not stop.is_set():
                begun.set()
                result(surface, query, 2)

        threads = [threading.Thread(target=busy) for _ in range(2)]
        for thread in threads:
            thread.start()
        begun.wait()
        codes = []
        for k in range(6):
            codes.append(ended(fork(lambda k=k: len(result(surface, query, 1 + k % 2)) == 3)))
            time.sleep(0.05)
        stop.set()
        for thread in threads:
            thread.join()
        expected = result(surface, query, 1)
        codes.append(ended(fork(lambda: check(expected, 2))))
        print(*codes)
        """
    )
    assert found == ["0"] * 7


# --- Arrays


def layouts(x):
    """The same numbers, laid out otherwise."""
    wide = np.zeros((*x.shape, 3), dtype=x.dtype)
    wide[..., 1] = x
    locked = x.copy()
    locked.flags.writeable = False
    backwards = x[::-1].copy()[::-1]
    return {
        "strided": wide[..., 1],
        "read-only": locked,
        "Fortran": np.asfortranarray(x),
        "backwards": backwards,
        "big-endian": x.astype(x.dtype.newbyteorder(">")),
        "list": x.tolist(),
        "subclass": x.view(np.ma.MaskedArray).view(np.ndarray),
    }


@both_ways
def test_layouts(kernels, tmp_path):
    surface = ls.LimitSurface(cage())
    query = [x.reshape(30, 20) for x in queries(surface, 600)]
    expected = surface.evaluate(*query), surface.normal(*query), surface.weights(*query).toarray()
    for k, x in enumerate(query):
        np.save(tmp_path / f"{k}.npy", x)
    mapped = [np.load(tmp_path / f"{k}.npy", mmap_mode="r") for k in range(3)]
    kinds = [layouts(x) for x in query]
    variants = [mapped, *([kind[name] for kind in kinds] for name in kinds[0])]
    # and one of them alone
    variants += [[kinds[0]["strided"], query[1], mapped[2]], [query[0], kinds[1]["list"], query[2]]]
    for given in variants:
        for workers in (1, 2):
            assert same(surface.evaluate(*given, workers=workers), expected[0])
            assert same(surface.normal(*given, workers=workers), expected[1])
            assert same(surface.weights(*given, workers=workers).toarray(), expected[2])
    assert same(surface.evaluate(*(x.T for x in query)), expected[0].transpose(1, 0, 2))


@both_ways
def test_types_of_faces_and_parameters(kernels):
    surface = ls.LimitSurface(cage())
    face, u, v = queries(surface, 600)
    face = face % 100
    expected = surface.evaluate(face, u, v)
    for kind in (np.int8, np.uint8, np.int16, np.int32, np.uint32, np.uint64, ">i4", ">u8"):
        assert same(surface.evaluate(face.astype(kind), u, v), expected)
    small = u.astype(np.float32), v.astype(np.float32)
    exact = [x.astype(float) for x in small]
    for some in (small, (small[0], exact[1]), [x.astype(">f4") for x in small]):
        assert same(surface.evaluate(face, *some), surface.evaluate(face, *exact))
    half = [x.astype(np.float16) for x in small]
    halves = [x.astype(float) for x in half]
    assert same(surface.evaluate(face, *half), surface.evaluate(face, *halves))
    whole = np.round(u).astype(int)
    for kind in (int, np.uint8, np.int32):
        found = surface.evaluate(face, whole.astype(kind), v)
        assert same(found, surface.evaluate(face, whole.astype(float), v))
    for wrong in (face.astype(float), face > 3, face.astype(str)):
        with pytest.raises(TypeError, match="faces must be integers"):
            surface.evaluate(wrong, u, v)
    with pytest.raises(TypeError, match="u must be real numbers"):
        surface.evaluate(face, u + 0j, v)


@both_ways
def test_faces_beyond_any_integer(kernels):
    """What does not fit into int64 is out of range, as other numbers are."""
    surface = ls.LimitSurface(cage())
    n = len(surface.limit_faces)
    for value, kind in [(2**64 - 1, np.uint64), (2**63, np.uint64), (2**63 - 1, np.int64),
                        (-(2**63), np.int64), (2**32, np.int64), (n, np.uint16),
                        (-1, np.int8)]:  # fmt: skip
        face = np.zeros(9, dtype=kind)
        face[5] = value
        for call in (surface.evaluate, surface.normal, surface.weights, surface.jet):
            with pytest.raises(IndexError, match=f"limit face {value} at index 5 is out of range"):
                call(face, 0.5, 0.5)


@both_ways
def test_points_of_any_type(kernels):
    """They are computed with in float64."""
    mesh = cage()
    query = queries(ls.LimitSurface(mesh), 300)
    for kind in (np.float32, np.float16, ">f8", np.int16):
        points = (100 * mesh.points).astype(kind)
        found = answers(ls.LimitSurface(mesh.with_points(points)), query)
        expected = answers(ls.LimitSurface(mesh.with_points(points.astype(float))), query)
        assert all(same(x, y) for x, y in zip(found, expected, strict=True))
        assert found[0].dtype == float
    strided = np.repeat(mesh.points, 2, axis=1)[:, ::2]
    for points in (np.asfortranarray(mesh.points), strided, mesh.points.tolist()):
        found = answers(ls.LimitSurface(mesh.with_points(points)), query)
        expected = answers(ls.LimitSurface(mesh), query)
        assert all(same(x, y) for x, y in zip(found, expected, strict=True))


@both_ways
def test_inputs_are_left_alone(kernels):
    surface = ls.LimitSurface(cage())
    query = queries(surface, 500)
    copies = [x.copy() for x in query]
    first = answers(surface, query)
    assert all(same(x, y) for x, y in zip(query, copies, strict=True))
    # and results are the caller's: writing into one changes no later one
    for x in answers(surface, query):
        x[...] = 7
    assert all(same(x, y) for x, y in zip(answers(surface, query), first, strict=True))


@both_ways
@pytest.mark.parametrize("shape", [(0,), (3, 0), (0, 5, 2)])
def test_no_queries(shape, kernels):
    surface = ls.LimitSurface(cage())
    empty = np.zeros(shape)
    for workers in (1, 2, -1):
        assert surface.evaluate(0, empty, 0.5, workers=workers).shape == (*shape, 3)
        assert surface.evaluate(empty.astype(int), 0.5, 0.5, nu=(1, 0)).shape == (*shape, 3)
        assert surface.evaluate(0, empty, 0.5, channel="uv", workers=workers).shape == (*shape, 2)
        assert surface.normal(0, empty, 0.5, workers=workers).shape == (*shape, 3)
        assert surface.jet(0, empty, 0.5, workers=workers)[1, 1].shape == (*shape, 3)
        assert surface.weights(0, empty, 0.5, workers=workers).shape == (0, surface.mesh.n_vertices)


SHAPES = [
    ((), (), ()),
    ((6, 1), (1, 7), ()),
    ((6, 1), (7,), (7,)),
    ((6, 1, 1), (7, 1), (5,)),
    ((1, 7), (6, 1), ()),
    ((7,), (6, 1), (6, 1)),
    ((6, 1), (6, 7), (7,)),
    ((6, 1), (6, 1), (7,)),
    ((6, 5, 1), (5, 8), (8,)),
    ((6, 5, 1, 1), (4, 5), ()),
    ((1, 1), (1, 7), (1,)),
    ((1,), (60,), (60,)),
    ((4, 4), (4, 4), ()),
    ((2, 1, 3), (2, 5, 1), (5, 3)),
]


@both_ways
@pytest.mark.parametrize(("face", "u", "v"), SHAPES)
def test_broadcasting(face, u, v, kernels):
    """Grids or not, results are those of single queries."""
    surface = ls.LimitSurface(cage())
    rng = np.random.default_rng(3)
    face = rng.integers(len(surface.limit_faces), size=face)
    u, v = rng.random(u), rng.random(v)
    full = np.broadcast_arrays(face, u, v)
    flat = [x.reshape(-1).copy() for x in full]
    shape = full[0].shape
    size = np.ptp(surface.points, axis=0).max()
    for nu in ((0, 0), (1, 0), (0, 1), (1, 1)):
        scale = np.maximum(1, np.abs(surface.weights(*flat, nu=nu)).sum(axis=1)) * size
        for workers in (1, 2):
            found = surface.evaluate(face, u, v, nu=nu, workers=workers)
            assert found.shape == (*shape, 3)
            error = np.abs(found.reshape(-1, 3) - surface.evaluate(*flat, nu=nu))
            assert np.nan_to_num(error.max(axis=1) / scale).max() <= 1e-13
            found = surface.jet(face, u, v, workers=workers)[nu].reshape(-1, 3)
            error = np.abs(found - surface.evaluate(*flat, nu=nu)).max(axis=1)
            assert np.nan_to_num(error / scale).max() <= 1e-13
    normals = surface.normal(face, u, v)
    assert normals.shape == (*shape, 3)
    expected = surface.normal(*flat)
    assert (np.isnan(normals.reshape(-1, 3)) == np.isnan(expected)).all()
    assert np.nanmax(np.abs(normals.reshape(-1, 3) - expected), initial=0) < 1e-11
    W = surface.weights(face, u, v)
    assert same(W.toarray(), surface.weights(*flat).toarray())


@pytest.mark.parametrize("what", ["face", "u", "v"])
def test_mistakes_in_the_last_chunk(what):
    """The first one is named, by its value and its index among all."""
    surface = ls.LimitSurface(cage())
    n = 2 * CHUNK + 77
    query = dict(zip(("face", "u", "v"), queries(surface, n), strict=True))
    query["u"], query["v"] = np.nan_to_num(query["u"]), np.nan_to_num(query["v"])
    wrong, kind = (999, IndexError) if what == "face" else (1.25, ValueError)
    query[what][[n - 5, n - 2]] = wrong
    text = rf"{wrong} at index {n - 5} \(1 more like it\)"
    calls = surface.evaluate, surface.normal, surface.weights, surface.jet
    for call, workers in itertools.product(calls, (1, 2)):
        with pytest.raises(kind, match=text):
            call(*query.values(), workers=workers)
    rows = {name: x[: 2 * CHUNK + 70].reshape(2, -1) for name, x in query.items()}
    rows[what][1, 11] = wrong
    with pytest.raises(kind, match=f"{wrong} at index 1, 11"):
        surface.evaluate(*rows.values(), workers=2)
    grid = {"face": np.arange(9)[:, None], "u": np.full(40, 0.5), "v": np.full(40, 0.25)}
    grid[what][-1] = wrong
    place = "8, 0" if what == "face" else "0, 39"
    with pytest.raises(kind, match=f"{wrong} at index {place} "):
        surface.evaluate(*grid.values())


def test_mistakes_come_before_results():
    """A face out of range counts even where the parameters give NaN; faces come first."""
    surface = ls.LimitSurface(cage())
    with pytest.raises(IndexError, match="limit face 999 at index 1"):
        surface.evaluate([0, 999], [2, np.nan], 0.5)
    with pytest.raises(ValueError, match="u = 2"):
        surface.evaluate([0, 1], [2, np.nan], [7, 0.5])
    with pytest.raises(ValueError, match=r"v = 7"):
        surface.evaluate([0, 1], [np.inf, np.nan], [7, 0.5])
