"""The commands that find places: closest and sample."""

import json

import numpy as np
import pytest
import zoo
from command_line import facts, fail, succeed
from test_cli import arrays_in, table

import limitsurf as ls
from limitsurf.shell.io import points


@pytest.fixture
def cage(tmp_path):
    path = tmp_path / "prism.obj"
    ls.write(path, ls.Mesh(*zoo.prism(5)))
    return path


@pytest.mark.parametrize("suffix", [".csv", ".npy", ".npz", ".parquet", ".zarr"])
@pytest.mark.parametrize("method", ["area", "blue_noise"])
def test_samples_are_those_of_the_library(suffix, method, cage, tmp_path):
    target = tmp_path / f"samples{suffix}"
    said = facts(
        "sample", cage, "-n", 40, "--method", method, "--seed", 3, "-o", target, "--json"
    )  # fmt: skip
    surface = ls.LimitSurface(ls.read(cage))
    expected = ls.sample(surface, 40, method=method, rng=3)
    found = arrays_in(target)
    assert (found["face"] == expected.face).all()
    assert (found["u"] == expected.u).all()
    if suffix in (".csv", ".parquet"):
        assert list(found) == ["face", "u", "v", "x", "y", "z", "n_x", "n_y", "n_z"]
        assert found["y"] == pytest.approx(expected.point[:, 1], abs=1e-13)
    else:
        assert set(found) == {"face", "u", "v", "position", "normal"}
        assert found["position"] == pytest.approx(expected.point, abs=1e-13)
    assert said["samples"] == 40
    assert said["spacing"] == (expected.spacing and pytest.approx(expected.spacing))


@pytest.mark.parametrize("kind", ["csv", "header", "stdin", "npy", "fields", "npz", "axes"])
def test_closest_reads_points_of_every_kind(kind, cage, tmp_path, monkeypatch):
    monkeypatch.setattr(points, "BATCH", 3)
    surface = ls.LimitSurface(ls.read(cage))
    asked = np.random.default_rng(1).uniform(-1, 1, (7, 3))
    lines = "\n".join(",".join(map(repr, x)) for x in asked.tolist())
    stdin, path = None, tmp_path / f"points.{kind}"
    if kind == "stdin":
        stdin, path = "# some points\n\n" + lines, "-"
    elif kind == "csv":
        path.write_text("\ufeff" + lines + "\n\n", encoding="utf-8")
    elif kind == "header":
        path = tmp_path / "points.csv"
        rows = "\n".join(f"7,{line},0" for line in lines.splitlines())
        path.write_text("id,X,y,z,w\n" + rows)
    elif kind == "npy":
        np.save(path, asked)
    elif kind == "fields":
        path = tmp_path / "points.npy"
        np.save(path, np.array(list(map(tuple, asked)), dtype=[(x, float) for x in "xyz"]))
    elif kind == "npz":
        np.savez(path, position=asked, other=3)
    else:
        path = tmp_path / "points.npz"
        np.savez(path, x=asked[:, 0], y=asked[:, 1], z=asked[:, 2])
    found = table(succeed("closest", cage, "--points", path, "--signed", stdin=stdin))
    expected = ls.closest_point(surface, asked, signed=True)
    assert found["face"].tolist() == expected.face.tolist()
    assert found["distance"] == pytest.approx(expected.distance, abs=1e-13)
    assert found["n_z"] == pytest.approx(expected.normal[:, 2], abs=1e-9)


def test_what_is_too_far_and_json(cage, tmp_path):
    options = ["closest", cage, "--points", "-", "--max-distance", 1]
    text = "0,0,9\nnan,0,0\n"
    found = table(succeed(*options, stdin=text))
    assert found["face"].tolist() == [-1, -1]
    assert np.isinf(found["distance"]).tolist() == [True, False]
    first, _ = map(json.loads, succeed(*options, "--json", stdin=text).splitlines())
    assert first["face"] == -1
    target = tmp_path / "a.npy"
    said = facts(*options, "-o", target, "--json", stdin=text)
    assert (said["answers"], said["found"]) == (2, 0)
    assert np.load(target)["distance"].shape == (2,)
    nothing = table(succeed("closest", cage, "--points", "-", stdin="x,y,z\n"))
    assert nothing.shape == (0,)
    assert table(succeed("sample", cage, "-n", 0)).shape == (0,)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "standard input: empty, need lines of x,y,z"),
        ("1,2\n", "line 1: need x,y,z or a header with these names, got '1,2'"),
        ("x,y,z\n1,2,3\n1,b,3\n", "line 3: need three numbers for x, y, z, got '1,b,3'"),
    ],
)
def test_bad_points_are_named(text, said, cage):
    assert said in fail("closest", cage, "--points", "-", stdin=text)


def test_bad_calls_are_one_line(cage, tmp_path):
    plane, flat = tmp_path / "plane.obj", tmp_path / "flat.obj"
    ls.write(plane, ls.Mesh(*zoo.grid(1, 1)))
    ls.write(flat, ls.Mesh(np.zeros((4, 3)), [[0, 1, 2, 3]]))
    assert "edge" in fail("closest", plane, "--points", "-", "--signed", stdin="0,0,0\n")
    assert "both be on the standard input" in fail("closest", "-", "--points", "-")
    assert "unknown suffix '.txt' of rows" in fail("closest", cage, "--points", "a.txt")
    np.save(tmp_path / "a.npy", np.zeros((2, 2)))
    assert "need numbers of shape (n, 3)" in fail("closest", cage, "--points", tmp_path / "a.npy")
    (tmp_path / "b.npy").write_text("no")
    text = fail("closest", cage, "--points", tmp_path / "b.npy")
    assert "no NumPy file" in text
    assert "pickle" not in text
    np.savez(tmp_path / "c.npz", x=[1, 2], y=[1, 2], z=[1])
    text = fail("closest", cage, "--points", tmp_path / "c.npz")
    assert "c.npz: x, y and z must be of one shape, got [(2,), (2,), (1,)]" in text
    assert "the surface has no area" in fail("sample", flat, "-n", 3)
