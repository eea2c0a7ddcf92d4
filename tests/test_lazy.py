"""Dask arrays of queries: answers are those of NumPy arrays, lazily, wherever they are computed."""

import pickle
import subprocess
import sys
from fractions import Fraction

import dask
import dask.array as da
import numpy as np
import pytest
import zoo

import limitsurf as ls
from limitsurf import lazy

N = 1000


@pytest.fixture(autouse=True)
def scheduler():
    with dask.config.set(scheduler="threads", num_workers=2):
        yield


@pytest.fixture(scope="module")
def surface():
    """A prism over a pentagon with a channel."""
    points, faces = zoo.prism(5)
    rng = np.random.default_rng(0)
    uv = rng.random((9, 2)), rng.integers(9, size=30), "corners_only"
    return ls.LimitSurface(ls.Mesh(np.asarray(points, float), faces, channels={"uv": uv}))


@pytest.fixture(scope="module")
def queries(surface):
    rng = np.random.default_rng(1)
    return rng.integers(len(surface.limit_faces), size=N), rng.random(N), rng.random(N)


def same(found, expected):
    """Equal but for the last bits, which may depend on what is evaluated together."""
    np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize(
    ("method", "options"),
    [
        ("evaluate", {}),
        ("evaluate", {"nu": (1, 1)}),
        ("evaluate", {"channel": "uv"}),
        ("jet", {"order": 2}),
        ("jet", {"order": 1, "channel": "uv"}),
        ("tangents", {}),
        ("normal", {}),
    ],
)
def test_answers_are_those_of_arrays(method, options, surface, queries):
    ask = getattr(surface, method)
    expected = ask(*queries, **options)
    found = ask(*map(da.from_array, queries, (N, 300, 170)), **options)
    assert type(found) is (da.Array if isinstance(expected, np.ndarray) else type(expected))
    if isinstance(expected, dict):
        assert list(found) == list(expected)
        found, expected = tuple(found.values()), tuple(expected.values())
    if isinstance(expected, np.ndarray):
        found, expected = (found,), (expected,)
    for lazily, eagerly in zip(found, expected, strict=True):
        assert isinstance(lazily, da.Array)
        assert lazily.shape == eagerly.shape
        assert lazily.dtype == eagerly.dtype
        assert lazily.numblocks == (9, 1)  # cut where any of the arguments is
    for answer, eagerly in zip(dask.compute(*found), expected, strict=True):
        same(answer, eagerly)


def test_queries_broadcast(surface, queries):
    face, u, v = queries
    for where in [
        (da.from_array(face[:20], 7)[:, None], u[:6], 0.5),
        (3, da.from_array(u[:, None], 100), list(v[:3])),
        (face[:5].astype(np.uint8), 0.25, da.from_array(v[:5].astype(np.float32), 2)),
        (da.asarray(3), 0.5, 0.5),
        (da.zeros((4, 0), dtype=int), 0.5, 0.5),
        (face[:1], da.from_array(u, 100), v[:1]),
        (da.from_array(face[:24].reshape(2, 3, 4), 2), u[:4], v[0]),
    ]:
        found = surface.evaluate(*where)
        expected = surface.evaluate(*(np.asarray(x) for x in where))
        assert found.shape == expected.shape
        same(found.compute(), expected)


def test_points_of_any_shape(surface, queries):
    chunked = [da.from_array(x, 300) for x in queries]
    for shape in [(), (1,), (2, 2)]:
        other = surface.with_points(np.random.default_rng(2).random((10, *shape)))
        found = other.evaluate(*chunked)
        assert found.shape == (N, *shape)
        same(found.compute(), other.evaluate(*queries))
        _, across = other.tangents(*chunked)
        same(across.compute(), other.tangents(*queries)[1])


def test_columns_of_data_frames(surface, queries):
    """Their arrays do not know the sizes of their chunks."""
    import dask.dataframe as dd
    import pandas as pd

    frame = dd.from_pandas(pd.DataFrame(dict(zip("fuv", queries, strict=True))), npartitions=3)
    face, u, v = (frame[name].values for name in "fuv")
    same(surface.normal(face, u, v).compute(), surface.normal(*queries))
    same(surface.evaluate(face, u, 0.5).compute(), surface.evaluate(*queries[:2], 0.5))
    with pytest.raises(IndexError, match="in the chunk that begins at"):
        surface.evaluate(face + 10, u, v).compute()


def test_exact_numbers(surface):
    u = da.from_array(np.array([Fraction(1, 3), Fraction(1, 2)], dtype=object), 1)
    found = surface.evaluate(da.from_array([0, 12], 1), u, 0)
    assert found.dtype == object
    expected = surface.evaluate([0, 12], u.compute(), 0)
    assert found.compute().tolist() == expected.tolist()
    assert isinstance(expected[0, 0], Fraction)


def test_nothing_is_evaluated_before_it_is_computed(surface, queries, monkeypatch):
    evaluated = []
    jet = ls.LimitSurface.jet

    def counted(self, face, *others, **options):
        if not lazy.is_lazy(face):
            evaluated.append(len(face))
        return jet(self, face, *others, **options)

    monkeypatch.setattr(ls.LimitSurface, "jet", counted)
    found = surface.jet(*(da.from_array(x, 250) for x in queries), order=1)
    assert evaluated == [1]  # one query, to know how answers look
    dask.compute(found)
    assert evaluated == [1, 250, 250, 250, 250]  # all derivatives in one pass


def test_the_surface_is_in_the_graph_once(surface, queries):
    first = surface.evaluate(*(da.from_array(x, 10) for x in queries))
    again = surface.normal(*(da.from_array(x, 25) for x in queries))
    graph = dict(dask.optimize(first)[0].dask)
    size = len(pickle.dumps(surface))
    assert sum(len(pickle.dumps(task)) > size // 2 for task in graph.values()) == 1
    names = [
        {name for name in answer.dask if str(name).startswith("limit-surface-")}
        for answer in (first, again)
    ]
    assert names[0] == names[1]
    assert len(names[0]) == 1
    other = surface.with_points(surface.points).evaluate(da.zeros(1, dtype=int), 0, 0)
    assert not names[0] & set(other.dask)


def test_surfaces_travel_light(surface, queries):
    """What was computed on the way is left behind."""
    whole = ls.LimitSurface(surface.mesh)
    size = len(pickle.dumps(whole))
    expected = whole.normal(*queries), whole.evaluate(*queries, channel="uv")
    whole.evaluate(*queries, nu=(3, 0))
    whole.evaluate([0], [Fraction(1, 3)], 0)
    content = pickle.dumps(whole)
    assert len(content) == pytest.approx(size, rel=0.01)
    other = pickle.loads(content)
    assert other.mesh == whole.mesh
    assert len(other.limit_faces) == len(whole.limit_faces)
    same(other.normal(*queries), expected[0])
    same(other.evaluate(*queries, channel="uv"), expected[1])


def test_surfaces_come_and_go(surface):
    before = len(lazy._names)
    answer = surface.with_points(surface.points * 2).evaluate(da.zeros(1, dtype=int), 0, 0)
    assert len(lazy._names) == before + 1
    del answer
    assert len(lazy._names) == before


def test_bad_calls_raise_at_once(surface):
    face, u = da.zeros(10, dtype=int, chunks=5), da.zeros(10, chunks=5)
    for error, message, call in [
        (ValueError, "two integers", lambda: surface.evaluate(face, u, u, nu=(1,))),
        (ValueError, "'st'", lambda: surface.evaluate(face, u, u, channel="st")),
        (ValueError, "order", lambda: surface.jet(face, u, u, order=-1)),
        (TypeError, "faces must be integers", lambda: surface.evaluate(u, u, u)),
        (TypeError, "u must be real", lambda: surface.normal(face, u.astype(complex), u)),
        (ValueError, r"\(10,\).*\(3,\)|broadcast", lambda: surface.evaluate(face, u, u[:3])),
        (ValueError, "normal", lambda: surface.with_points(np.ones(10)).normal(face, u, u)),
        (ValueError, "two integers", lambda: surface.weights(face, u, u, nu=[(1, 0), (1,)])),
    ]:
        with pytest.raises(error, match=message):
            call()


@pytest.mark.parametrize("channel", [None, "uv"])
def test_weights(surface, channel):
    """Blocks are sparse, rows in C order, those of several orders on one pattern."""
    rng = np.random.default_rng(0)
    face, u, v = rng.integers(len(surface.limit_faces), size=(5, 1)), *rng.random((2, 5, 6))
    orders, options = [(0, 0), (0, 1), (2, 0)], {"channel": channel, "workers": 2}
    wanted = surface.weights(face, u, v, nu=orders, **options)
    rows = surface.weights(
        da.from_array(face, 2), da.from_array(u, (2, 3)), v, nu=orders, **options
    )
    for lazy_matrix, matrix in zip(rows, wanted, strict=True):
        assert lazy_matrix.shape == matrix.shape
        assert lazy_matrix.numblocks[0] > 1
        same(lazy_matrix.compute().toarray(), matrix.toarray())
    blocks = dask.compute(*(matrix.blocks[0] for matrix in rows), scheduler="threads")
    assert all(block.format == "csr" for block in blocks)
    one = surface.weights(da.from_array(face, 2), u, v, nu=(0, 1), **options)
    same(one.compute().toarray(), wanted[1].toarray())
    bad = surface.weights(da.from_array(np.array([0, 0, 99]), 2), 0.5, 0.5)
    with pytest.raises(IndexError, match=r"chunk that begins at \[2\]: limit face 99"):
        bad.compute()


def test_weights_of_exact_numbers(surface):
    third = np.array([Fraction(1, 3)])
    with pytest.raises(TypeError, match="exact numbers take no Dask"):
        surface.weights(0, da.from_array(third, 1), da.from_array(third, 1))


def test_queries_out_of_range_say_where(surface):
    face = np.zeros((6, 6), dtype=int)
    face[4, 5] = 99
    found = surface.evaluate(da.from_array(face, 3), 0.5, 0.5)
    with pytest.raises(IndexError, match=r"begins at \[3, 3\]: limit face 99 at index 1, 2"):
        found.compute()
    u = da.from_array(np.array([0, 1, 2, 3]), 2)
    with pytest.raises(ValueError, match=r"begins at \[2\]: u = 2.* at index 0 \(1 more"):
        surface.normal(0, u, 0).compute()
    with pytest.raises(ValueError, match="in the chunk: u = "):
        surface.normal(0, da.asarray(3.0), 0).compute()


def test_dask_is_not_imported_for_arrays():
    script = """
import sys
import limitsurf as ls
surface = ls.LimitSurface(ls.Mesh([[0], [1], [1], [0]], [[0, 1, 2, 3]]))
surface.evaluate(0, 0, 0)
assert not {"dask", "distributed", "pandas", "pyarrow", "zarr"} & set(sys.modules)
"""
    subprocess.run([sys.executable, "-c", script], check=True)


CLUSTER = """
import os
import dask, dask.array as da, numpy as np, limitsurf as ls, pyarrow as pa, zarr
import pyarrow.parquet as pq
from dask.distributed import Client, LocalCluster
from limitsurf.shell import cluster as cluster_files
from limitsurf.shell.io import answers
from limitsurf.shell.cli.commands import main

def watch():
    restored = ls.LimitSurface.__setstate__
    def counted(self, state):
        ls.received += 1
        restored(self, state)
    ls.received = 0
    ls.LimitSurface.__setstate__ = counted

def received():
    number, ls.received = ls.received, 0
    return number

if __name__ == "__main__":
    mesh = ls.read("cage.obj")
    surface = ls.LimitSurface(mesh)
    rng = np.random.default_rng(0)
    where = rng.integers(len(surface.limit_faces), size=3000), rng.random(3000), rng.random(3000)
    queries = [da.from_array(x, 100) for x in where]
    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, host="127.0.0.1",
        dashboard_address=None, silence_logs="CRITICAL",
    ) as cluster, Client(cluster) as client:
        client.run(watch)
        jet, normal = dask.compute(surface.jet(*queries, order=1), surface.normal(*queries))
        assert max(client.run(received).values()) == 1
        for nu, expected in surface.jet(*where, order=1).items():
            np.testing.assert_allclose(jet[nu], expected, rtol=1e-13, atol=1e-13)
        np.testing.assert_allclose(normal, surface.normal(*where), rtol=1e-13, atol=1e-13)
        try:
            surface.evaluate(queries[0] + 8, *queries[1:]).compute()
        except IndexError as error:
            assert "in the chunk that begins at" in str(error)
        else:
            raise AssertionError("a face out of range is answered")
        client.run(received)

        cluster_files.TASK, answers.BATCH = 800, 100
        rows = np.stack(where, axis=1)
        np.save("q.npy", rows)
        zarr.create_array("q.zarr", data=rows, chunks=(170, 3))
        os.mkdir("q.parquet")
        for k, part in enumerate(np.split(rows, [1234, 1235])):
            columns = dict(zip(["face", "u", "v"], part.T))
            pq.write_table(pa.table(columns), f"q.parquet/{k}.parquet", row_group_size=500)
        command = ["evaluate", "cage.obj", "--normals", "--order", "1", "--queries"]
        near = ["--scheduler", cluster.scheduler_address]
        main([*command, "q.npy", "-o", "here.parquet"], standalone_mode=False)
        main([*command, "q.npy", "-o", "here.zarr"], standalone_mode=False)
        for suffix in ["npy", "zarr", "parquet"]:
            client.run(received)
            for name in ["far.parquet", "far.zarr"]:
                options = [f"q.{suffix}", "-o", name, *near]
                assert main([*command, *options], standalone_mode=False) is None
            # once each time at most: a busy machine leaves all to one worker
            assert 1 <= max(client.run(received).values()) <= 2
            far, here = (pq.read_table(f"{name}.parquet").to_pandas() for name in ["far", "here"])
            assert list(far) == list(here)
            np.testing.assert_allclose(far, here, rtol=1e-13, atol=1e-13)
            far, here = (zarr.open_group(f"{name}.zarr", mode="r") for name in ["far", "here"])
            assert sorted(far) == sorted(here)
            for name in here:
                assert far[name].shape == here[name].shape
                np.testing.assert_allclose(far[name][:], here[name][:], rtol=1e-13, atol=1e-13)
        np.save("none.npy", rows[:0])
        for name in ["none.parquet", "none.zarr"]:
            assert main([*command, "none.npy", "-o", name, *near], standalone_mode=False) is None
        assert pq.read_table("none.parquet").schema == pq.read_table("here.parquet").schema
        before = sorted(os.listdir())
        rows[[2345, 2987], 0] = 8
        np.save("q.npy", rows)
        for name in ["far.parquet", "new.zarr"]:
            assert main([*command, "q.npy", "-o", name, *near], standalone_mode=False) == 2
        assert sorted(os.listdir()) == before
        assert len(os.listdir("far.parquet")) == 4
"""


def test_a_cluster_of_processes(tmp_path):
    """In a process of its own, which may leave what it likes behind."""
    ls.write(tmp_path / "cage.obj", ls.Mesh(*zoo.cube()))
    (tmp_path / "cluster.py").write_text(CLUSTER)
    done = subprocess.run(
        [sys.executable, "cluster.py"], cwd=tmp_path, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stderr.splitlines() if line.startswith("limitsurf: error: ")]
    assert len(lines) == 2
    for line in lines:
        assert "q.npy: row 2345: limit face 8 is out of range" in line


def test_there_is_no_place_for_answers_that_are_computed_later(surface, queries):
    face, u, v = queries
    for ask in (surface.evaluate, surface.normal):
        with pytest.raises(TypeError, match="out takes no answers to Dask arrays"):
            ask(face, da.from_array(u), v, out=np.empty((N, 3)))
