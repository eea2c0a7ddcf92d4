"""The command line: what it prints, what it writes, and how it fails."""

import inspect
import io
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import warnings
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import zarr
import zoo
from click.testing import CliRunner
from command_line import PROGRAM, facts, fail, pipeline, run, succeed
from mpmath import mp

import limitsurf as ls
from limitsurf.scheme.lattice import QUADS
from limitsurf.shell.cli.commands import main
from limitsurf.shell.io import answers, queries


@pytest.fixture
def cage(tmp_path):
    """A prism over a pentagon: n-gons, and quads between vertices of valence 3."""
    path = tmp_path / "prism.obj"
    ls.write(path, ls.Mesh(*zoo.prism(5)))
    return path


@pytest.fixture
def surface(cage):
    return ls.LimitSurface(ls.read(cage))


def table(text):
    """CSV as a structured array."""
    return np.genfromtxt(io.StringIO(text), delimiter=",", names=True, deletechars="")


def same(found, expected):
    """Equal but for the last bits, which may depend on what is evaluated together."""
    np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-14)


def columns(values, *names):
    return np.stack([values[name] for name in names], axis=-1)


# ------------------------------------------------------------------ the program


@pytest.mark.parametrize("arguments", [["-h"], ["--help"], []])
def test_help(arguments):
    output = succeed(*arguments)
    for command in main.commands:
        assert command in output


@pytest.mark.parametrize("command", ["", *main.commands])
def test_every_command_has_help_with_examples_that_work(command, cage, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cage.rename("cage.obj")
    Path("rays.csv").write_text("0,0,5,0,0,-1\n")
    help = succeed(*command.split(), "--help")
    examples = re.findall(r"^    (limitsurf .*)", help, re.MULTILINE)
    assert examples
    for example in examples:
        pipeline(example)


@pytest.mark.parametrize(
    ("command", "call", "names"),
    [
        ("tessellate", ls.tessellate, {"n": "n"}),
        ("closest", ls.closest_point, {"max_distance": "max_distance"}),
        ("sample", ls.sample, {"method": "method"}),
        ("fit", ls.fit, {name: name for name in ("loss", "scale", "tolerance", "max_iterations")}),
        ("refine", ls.refined, {"levels": "levels"}),
        ("interpolate", ls.interpolate, {"fairness": "fairness", "refine": "refine"}),
        ("validate", ls.validate, {"levels": "levels"}),
        ("validate", ls.plot_convergence, {"levels": "levels"}),
        ("basis", ls.eigenbasis, {"scheme": "scheme", "position": "position"}),
        ("basis", ls.plot_characteristic_map, {"scheme": "scheme"}),
        ("basis", ls.plot_eigenfunctions, {"scheme": "scheme"}),
        ("info", ls.LimitSurface, {name: name for name in ("scheme", "boundary", "creasing")}),
        ("plot", ls.plot, {"n": "n", "wires": "cage", "size": "window_size"}),
    ],
)
def test_defaults_are_those_of_the_library(command, call, names):
    parameters = inspect.signature(call).parameters
    options = {option.name: option.default for option in main.commands[command].params}
    # click has a sign of its own for an option without a default
    given = {name: None if "UNSET" in repr(x) else x for name, x in options.items()}
    for option, argument in names.items():
        assert given[option] == parameters[argument].default


def test_options_say_what_they_are_for():
    for name, command in main.commands.items():
        for option in command.params:
            assert option.param_type_name == "argument" or option.help, (name, option.name)


def test_version():
    assert succeed("--version") == f"limitsurf {ls.__version__}\n"


@pytest.mark.parametrize("arguments", [["paint"], ["--loud"], ["info"], ["info", "a", "b"]])
def test_bad_usage_is_one_line(arguments):
    fail(*arguments)


def test_defects_are_not_dressed_up_as_errors_of_the_user(cage, monkeypatch):
    monkeypatch.setattr(ls, "validate", lambda *_, **__: {}["bug"])
    assert isinstance(run("validate", cage).exception, KeyError)


def test_warnings_are_one_line(cage):
    cage.write_text(cage.read_text() + "frobnicate 1 2\n")
    result = run("info", cage)
    assert result.exit_code == 0
    (line,) = [k for k in result.output.splitlines() if "frobnicate" in k]
    assert line.startswith("limitsurf: warning: ")


# ------------------------------------------------------------------ cages of every kind

CAGES = {
    "semi-sharp": (zoo.cube, {"creases": {(0, 1): 1.3, (0, 4): 0.2}, "corners": {7: 2.5}}),
    "chaikin": (zoo.cube, {"creases": {(0, 1): 3, (0, 4): 0.7}, "creasing": "chaikin"}),
    "dart": (zoo.cube, {"creases": {(0, 1): np.inf}, "holes": [2]}),
    "loose": (lambda: zoo.grid(4, 4), {"boundary": "none"}),
    "many_faces": (lambda: zoo.disk(7), {"boundary": "edge_only", "triangles": "smooth"}),
    "fin": (lambda: zoo.NONMANIFOLD["fin"][:2], {}),
    "bow_tie": (lambda: zoo.NONMANIFOLD["bow_tie"][:2], {"creases": {(0, 2): 4}}),
}


@pytest.mark.parametrize("suffix", [".obj", ".usda"])
@pytest.mark.parametrize("name", CAGES)
def test_cages_of_every_kind(name, suffix, tmp_path):
    make, tags = CAGES[name]
    points, faces = make()
    flat = np.asarray(points, dtype=float)
    solid = np.pad(flat, ((0, 0), (0, 3 - flat.shape[1])))
    path = tmp_path / f"cage{suffix}"
    ls.write(path, ls.Mesh(solid, faces, **tags))
    assert "limit faces" in succeed("info", path)
    surface = ls.LimitSurface(ls.read(path))
    found = table(succeed("evaluate", path, "--grid", 3, "--normals", "--order", 1))
    where = found["face"].astype(int), found["u"], found["v"]
    same(columns(found, "x", "y", "z"), surface.evaluate(*where))
    same(columns(found, "x_u", "y_u", "z_u"), surface.evaluate(*where, nu=(1, 0)))
    same(columns(found, "n_x", "n_y", "n_z"), surface.normal(*where))
    _, *rows = succeed("validate", path, "--levels", 2).splitlines()
    assert all(float(row.split()[-1]) < 1e-13 for row in rows)
    picture = tmp_path / "a.png"
    succeed("plot", path, "-o", picture, "--size", 80, 60, "-n", 3)
    assert picture.read_bytes().startswith(b"\x89PNG")


# ------------------------------------------------------------------ info


def told(output):
    return dict(line.strip().split("   ", 1) for line in output.splitlines() if "   " in line)


def test_info(cage):
    found = {name: value.strip() for name, value in told(succeed("info", cage)).items()}
    assert found["vertices"] == "10"
    assert found["edges"] == "15"
    assert found["faces"] == "7"
    assert found["components"] == "1, closed"
    assert found["corners of faces"] == "4 (5 times), 5 (2)"
    assert found["valences inside"] == "3 (10 times)"
    assert found["limit faces"] == "15"
    assert found["boundary"] == "edge_and_corner, by default"
    assert sum(int(found[name]) for name in found if name.startswith(("one ", "split"))) == 15
    assert found["special corners of patches"] == "valence 3 (30), valence 5 (10)"


def test_info_of_an_open_cage_with_tags(tmp_path):
    path = tmp_path / "grid.obj"
    points, faces = zoo.with_unused(zoo.disjoint(zoo.grid(2, 2), zoo.grid(2, 1)), at=0)
    mesh = ls.Mesh(
        np.pad(np.asarray(points, float)[:, :2], ((0, 0), (0, 1))),
        faces,
        creases={(faces[0][1], faces[0][2]): 0.5, (faces[0][2], faces[0][3]): np.inf},
        corners={int(faces[0][0]): 3.0},
        holes=[1],
        boundary="edge_only",
        channels={"uv": (np.eye(2), [0, 1] * 12, "boundaries")},
    )
    ls.write(path, mesh)
    found = {name: value.strip() for name, value in told(succeed("info", path)).items()}
    expected = {
        "vertices": "16, 1 of them in no face",
        "edges": "19, 14 of them on the boundary",
        "components": "2, open",
        "faces at boundary vertices": "1 (8 times), 2 (6)",
        "creases": "2, sharpness 0.5, 1 infinite",
        "corners": "1, sharpness 3",
        "holes": "1",
        "channel uv": "2 values, boundaries",
        "scheme": "catmull-clark, by default",
        "boundary": "edge_only",
        "creasing": "uniform, by default",
        "no limit (holes)": "1",
    }
    assert expected.items() <= found.items()
    found = told(succeed("info", path, "--boundary", "none"))
    assert found["boundary"].strip() == "none"
    assert found["  no limit (holes)".strip()].strip() == "6"


def test_info_of_strips_and_sectors(tmp_path):
    path = tmp_path / "ridge.obj"
    points, faces = zoo.grid(8, 8)
    row = [int(v) for v in np.arange(81).reshape(9, 9)[4]]
    creases = dict.fromkeys(pairwise(row), 2.5)
    solid = np.pad(np.asarray(points, float)[:, :2], ((0, 0), (0, 1)))
    ls.write(path, ls.Mesh(solid, faces, creases=creases))
    found = {name: value.strip() for name, value in told(succeed("info", path)).items()}
    assert found["creases"] == "8, sharpness 2.5"
    assert int(found["one strip along a semi-sharp crease"]) > 0
    ls.write(path, ls.Mesh(solid, faces, creases=dict.fromkeys(creases, np.inf)))
    found = {name: value.strip() for name, value in told(succeed("info", path)).items()}
    assert found["creases"] == "8, infinite"
    assert found["one regular patch"] == "64"
    assert "special corners of patches" not in found
    ls.write(path, ls.Mesh(solid, faces, creases=dict.fromkeys(pairwise(row[:5]), 12)))
    found = {name: value.strip() for name, value in told(succeed("info", path)).items()}
    assert found["special corners of patches"] == "dart of 4 faces (4)"


def test_info_of_what_is_not_manifold(tmp_path):
    path = tmp_path / "fin.obj"
    ls.write(path, ls.Mesh(*zoo.NONMANIFOLD["fin"][:2]))
    found = {name: value.strip() for name, value in told(succeed("info", path)).items()}
    assert found["edges"] == "17, 12 of them on the boundary, 2 of them not manifold"
    assert found["faces at vertices that are not manifold"] == "3 (2 times), 6 (1)"


def test_info_of_a_scheme_that_is_not_known(tmp_path):
    path = tmp_path / "kobbelt.obj"
    ls.write(path, ls.Mesh(*zoo.tetrahedron(), scheme="kobbelt"))
    found = told(succeed("info", path))
    assert found["vertices"].strip() == "4"
    assert "'kobbelt'" in found["limit surface"]
    assert "'kobbelt'" in fail("evaluate", path, "--grid", 1)


def test_bilinear(tmp_path):
    """Every command, with the scheme of the file and with one that is asked for."""
    path, out = tmp_path / "cage.obj", tmp_path / "out.obj"
    ls.write(path, ls.Mesh(*zoo.tetrahedron(), scheme="bilinear"))
    rows = succeed("evaluate", path, "--grid", 3, "--order", 2, "--normals").splitlines()
    assert len(rows) == 1 + 12 * 9
    assert succeed("evaluate", path, "--grid", 3) != succeed(
        "evaluate", path, "--grid", 3, "--scheme", "catmull-clark"
    )
    succeed("tessellate", path, "-n", 2, "-o", out)
    assert ls.read(out).n_faces == 12 * 4
    succeed("refine", path, "-o", out)
    assert np.array_equal(ls.read(out).points[:4], ls.read(path).points)
    for scheme in "bilinear", "linear":
        succeed("validate", path, "--scheme", scheme)
        assert f"'{scheme}' has no eigenbases" in fail("basis", "--scheme", scheme, "--valence", 5)
    assert told(succeed("info", path, "--scheme", "linear"))["limit faces"].strip() == "4"


def test_triangles(tmp_path):
    path, out = tmp_path / "loop.obj", tmp_path / "out.obj"
    ls.write(path, ls.Mesh(*zoo.tetrahedron(), scheme="loop"))
    assert told(succeed("info", path))["limit faces"].strip() == "4"
    for asked, number in (("--grid", 3), 36), (("--random", 50), 50):
        rows = np.loadtxt(succeed("evaluate", path, *asked).splitlines(), delimiter=",", skiprows=1)
        face, u, v, *xyz = rows.T
        assert len(rows) == number
        assert (u + v < 1).all()
        there = ls.LimitSurface(ls.read(path)).evaluate(face.astype(int), u, v)
        assert np.array_equal(np.stack(xyz, axis=1), there)
    assert len({(u, v) for u, v in zip(u.tolist(), v.tolist(), strict=True)}) == 50
    succeed("tessellate", path, "-n", 3, "-o", out)
    assert (ls.read(out).sizes == 3).all()
    assert ls.read(out).n_faces == 36
    succeed("validate", path, "--workers", 2)
    ls.write(path, ls.Mesh(*zoo.cube(), scheme="loop"))
    assert "face 0" in fail("tessellate", path, "-o", out)


def test_info_as_json(cage, tmp_path):
    found = facts("info", cage)
    assert found["cage"] == str(cage)
    assert (found["vertices"], found["edges"], found["faces"]) == (10, 15, 7)
    assert found["closed"] is True
    assert found["face_sizes"] == {"4": 5, "5": 2}
    assert found["valences"] == {"3": 10}
    assert found["rules"]["boundary"] == {"value": "edge_and_corner", "by_default": True}
    assert sum(found["patches"].values()) == found["limit_faces"] == 15
    assert {"kind": "interior", "faces": 5, "patches": 10} in found["special_corners"]
    assert found["no_surface"] is None
    path = tmp_path / "sharp.obj"
    creases = {(0, 1): 0.5, (1, 3): np.inf}
    ls.write(path, ls.Mesh(*zoo.cube(), creases=creases, scheme="kobbelt"))
    other = facts("info", path)
    assert other.keys() == found.keys()
    assert other["creases"] == {"number": 2, "infinite": 1, "least": 0.5, "most": 0.5}
    assert "'kobbelt'" in other["no_surface"]
    assert other["limit_faces"] is None


def test_keys_of_json_are_documented(cage, tmp_path):
    target = tmp_path / "a.obj"
    for command, arguments in {
        "info": [cage],
        "validate": [cage, "--levels", 1],
        "measure": [cage],
        "modes": [cage, "-k", 3, "--levels", 1, "-o", tmp_path / "a.vtu"],
        "basis": ["--valence", 3],
        "spectrum": ["--valence", 3],
        "tessellate": [cage, "-n", 2, "-o", target],
        "refine": [cage, "-o", target],
        "section": [cage, "-o", tmp_path / "a.csv"],
        "interpolate": [cage, "-o", target],
        "convert": [cage, target],
        "offset": [cage, "-d", 0.05, "-o", target],
        "plot": [cage, "-o", tmp_path / "a.png", "--size", 60, 40, "-n", 2],
        "demo": ["-o", tmp_path, "--queries", 1000],
        "evaluate": [cage, "--grid", 2, "-o", tmp_path / "a.npy"],
        "sample": [cage, "-n", 20, "--method", "blue_noise", "-o", tmp_path / "b.csv"],
        "closest": [cage, "--points", tmp_path / "b.csv", "-o", tmp_path / "c.npz"],
        "fit": [cage, tmp_path / "b.csv", "--smoothing", 1e-6, "-o", target],
    }.items():
        help = " ".join(succeed(command, "--help").split())
        _, _, documented = re.split("(Keys of|With) --json", help)
        for key in facts(command, *arguments):
            assert re.search(rf"\b{key}\b", documented), (command, key)


def test_rules_are_options(tmp_path):
    path = tmp_path / "grid.obj"
    ls.write(path, ls.Mesh(*zoo.tetrahedron()))
    options = ["--boundary", "edge_only", "--creasing", "chaikin", "--triangles", "smooth"]
    rules = facts("info", path, *options, "--scheme", "catmull-clark")["rules"]
    assert {name: rule["value"] for name, rule in rules.items()} == {
        "scheme": "catmull-clark",
        "boundary": "edge_only",
        "creasing": "chaikin",
        "triangles": "smooth",
    }
    # where all edges have one mask there is nothing to choose
    assert list(facts("info", path, "--scheme", "loop")["rules"]) == [*rules][:3]
    assert "triangles" not in told(succeed("info", path, "--scheme", "loop"))
    assert not any(rule["by_default"] for rule in rules.values())
    smooth = ls.LimitSurface(ls.read(path), triangles="smooth")
    found = table(succeed("evaluate", path, "--grid", 2, "--triangles", "smooth"))
    where = found["face"].astype(int), found["u"], found["v"]
    same(columns(found, "x", "y", "z"), smooth.evaluate(*where))
    assert "'loup'" in fail("evaluate", path, "--grid", 1, "--scheme", "loup")


# ------------------------------------------------------------------ evaluate


def test_grid_to_stdout(cage, surface):
    found = table(succeed("evaluate", cage, "--grid", 3, "--normals", "--order", 2))
    face, u, v = found["face"].astype(int), found["u"], found["v"]
    assert len(found) == 15 * 9
    assert set(u) == set(v) == {1 / 6, 1 / 2, 5 / 6}
    jet = surface.jet(face, u, v, order=2)
    names = {(0, 0): "", (1, 0): "_u", (0, 1): "_v", (2, 0): "_uu", (1, 1): "_uv", (0, 2): "_vv"}
    for nu, name in names.items():
        same(columns(found, *(c + name for c in "xyz")), jet[nu])
    same(columns(found, "n_x", "n_y", "n_z"), surface.normal(face, u, v))
    assert len(found.dtype.names) == 3 + 6 * 3 + 3


FORMATS = ["a.csv", "a.npz", "a.npy", "a.parquet", "a.zarr"]


def arrays_in(path):
    """Arrays of a NPZ, NPY or Zarr file, columns of a CSV or Parquet file, by name."""
    if path.suffix == ".zarr":
        return {name: array[:] for name, array in zarr.open_group(path, mode="r").arrays()}
    if path.suffix == ".parquet":
        content = pq.read_table(path)
        return {name: content[name].to_numpy() for name in content.column_names}
    if path.suffix == ".csv":
        content = table(path.read_text())
        return {name: np.atleast_1d(content[name]) for name in content.dtype.names}
    content = np.load(path)
    names = content.dtype.names if path.suffix == ".npy" else content.files
    return {name: content[name] for name in names}


def same_arrays(found, expected):
    assert found.keys() == expected.keys()
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values)


@pytest.mark.parametrize("batch", [queries.BATCH, 13])
def test_files_hold_the_same_in_every_format(batch, cage, surface, tmp_path, monkeypatch):
    monkeypatch.setattr(queries, "BATCH", batch)
    command = ["evaluate", cage, "--random", 50, "--order", 1, "--normals", "-o"]
    for name in FORMATS:
        assert succeed(*command, tmp_path / name) == ""
    csv, npz, npy, parquet, store = (arrays_in(tmp_path / name) for name in FORMATS)
    assert list(npz) == ["face", "u", "v", "position", "du", "dv", "normal"]
    assert npz["face"].dtype == store["face"].dtype == parquet["face"].dtype == np.int64
    assert list(npy) == list(npz)
    assert list(parquet) == list(csv)
    same_arrays(npy, npz)
    same_arrays(store, npz)
    same_arrays(parquet, csv)
    np.testing.assert_array_equal(columns(csv, "x", "y", "z"), npz["position"])
    np.testing.assert_array_equal(columns(csv, "x_v", "y_v", "z_v"), npz["dv"])
    where = npz["face"], npz["u"], npz["v"]
    same(npz["position"], surface.evaluate(*where))
    same(npz["du"], surface.evaluate(*where, nu=(1, 0)))
    same(npz["normal"], surface.normal(*where))


@pytest.fixture
def painted(tmp_path):
    """A cube with two channels: texture coordinates with seams, and one number."""
    path = tmp_path / "painted.usda"
    rng = np.random.default_rng(0)
    channels = {
        "st": (rng.random((14, 2)).astype(np.float32), rng.integers(14, size=24), "none"),
        "heat": (rng.random(8).astype(np.float32), rng.integers(8, size=24), "none"),
    }
    ls.write(path, ls.Mesh(*zoo.cube(), channels=channels))
    return path


def test_channels(painted, tmp_path):
    command = ["evaluate", painted, "--random", 9, "--order", 1]
    for name in ["a.csv", "a.npz", "a.npy"]:
        succeed(*command, "--channel", "st", "--channel", "heat", "-o", tmp_path / name)
    surface = ls.LimitSurface(ls.read(painted))
    rows = np.load(tmp_path / "a.npy")
    names = ["face", "u", "v", "position", "du", "dv"]
    names += ["st", "st_du", "st_dv", "heat", "heat_du", "heat_dv"]
    with np.load(tmp_path / "a.npz") as arrays:
        assert arrays.files == list(rows.dtype.names) == names
        where = arrays["face"], arrays["u"], arrays["v"]
        for name in ["st", "heat"]:
            for nu, suffix in {(0, 0): "", (1, 0): "_du", (0, 1): "_dv"}.items():
                expected = surface.evaluate(*where, nu=nu, channel=name)
                same(arrays[name + suffix], expected)
                np.testing.assert_array_equal(rows[name + suffix], arrays[name + suffix])
        text = table((tmp_path / "a.csv").read_text())
        np.testing.assert_array_equal(columns(text, "st_du_0", "st_du_1"), arrays["st_du"])
        np.testing.assert_array_equal(text["heat_0"], arrays["heat"])
    head = succeed("evaluate", painted, "--random", 0, "--channel", "st", "--channel", "st")
    assert head == "face,u,v,x,y,z,st_0,st_1\n"


def test_answers_as_json_lines(painted, tmp_path):
    options = ["--order", 1, "--normals", "--channel", "st"]
    queries = ["--queries", "-"]
    text = "face,u,v\n0,0.25,0.5\n5,1,nan\n"
    lines = succeed("evaluate", painted, *queries, *options, "--json", stdin=text).splitlines()
    first, second = map(json.loads, lines)
    where = 0, 0.25, 0.5
    surface = ls.LimitSurface(ls.read(painted))
    assert list(first) == [
        "face",
        "u",
        "v",
        "position",
        "du",
        "dv",
        "normal",
        "st",
        "st_du",
        "st_dv",
    ]
    assert [first[name] for name in ("face", "u", "v")] == list(where)
    same(first["position"], surface.evaluate(*where))
    same(first["normal"], surface.normal(*where))
    same(first["st_dv"], surface.evaluate(*where, nu=(0, 1), channel="st"))
    assert second["v"] is None
    assert second["position"] == [None] * 3
    target = tmp_path / "a.npy"
    assert facts("evaluate", painted, "--grid", 2, "-o", target) == {
        "output": str(target),
        "answers": 24,
        "limit_faces": 6,
    }
    assert len(np.load(target)) == 24


def test_channels_that_cannot_be(painted, cage, tmp_path):
    assert "'uv'; it has 'heat', 'st'" in fail("evaluate", painted, "--grid", 1, "--channel", "uv")
    assert "it has none" in fail("plot", cage, "-o", tmp_path / "a.png", "--channel", "uv")
    mesh = ls.read(painted)
    values, rows, mode = mesh.channels["st"]
    for names in [["du"], ["normal"], ["uv", "uv_du"]]:
        channels = dict.fromkeys(names, (values, rows, mode))
        ls.write(painted, ls.Mesh(mesh.points, mesh.faces, channels=channels))
        options = [option for name in names for option in ("--channel", name)]
        message = fail("evaluate", painted, "--grid", 1, "--order", 1, *options)
        assert f"other answers named {names[-1]!r}" in message


def test_a_seed_repeats_itself(cage):
    first, again, other = (
        succeed("evaluate", cage, "--random", 5, "--seed", seed) for seed in (1, 1, 2)
    )
    assert first == again != other


@pytest.mark.parametrize("faces", [1, 10, 3 << 20, 3 << 33])
def test_random_queries_are_one_stream(faces, monkeypatch):
    """Whatever the batches: as if all faces, all u and all v had been drawn at once."""
    monkeypatch.setattr(queries, "BATCH", 7)
    batches = list(queries.random_queries(faces, 40, 3, QUADS).batches)
    rng = np.random.default_rng(3)
    for name, expected in [
        ("face", rng.integers(faces, size=40)),
        ("u", rng.random(40)),
        ("v", rng.random(40)),
    ]:
        found = np.concatenate([getattr(batch, name) for batch in batches])
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize(
    "text",
    [
        "face,u,v\n3,0.25,1\n0,0,0.1\n",
        "3,0.25,1\n0,0,0.1",
        '# a comment\n\n "V" , x, Face,u\r\n1,note,3,0.25 # another\r\n\r\n0.1,,0,0\r\n',
        "\ufeffface,u,v\n3,2.5e-1,1.0\n+0,0.,.1\n",
        "face,u,v\n\n# a\n\n\n3,0.25,1\n# b\n\n\n\n0,0,0.1\n\n\n\n",
    ],
)
@pytest.mark.parametrize("batch", [queries.BATCH, 2])
def test_queries_as_csv(batch, text, cage, surface, tmp_path, monkeypatch):
    monkeypatch.setattr(queries, "BATCH", batch)
    path = tmp_path / "q.csv"
    path.write_bytes(text.encode())
    expected = surface.evaluate([3, 0], [0.25, 0.0], [1.0, 0.1])
    for found in [
        succeed("evaluate", cage, "--queries", path),
        succeed("evaluate", cage, "--queries", "-", stdin=text.lstrip("\ufeff")),
    ]:
        same(columns(table(found), "x", "y", "z"), expected)


KINDS = ["npz", "packed", "columns", "rows", "fortran", "integers"]
KINDS += ["parquet", "folder", "pattern", "group", "array"]


@pytest.mark.parametrize("kind", KINDS)
def test_queries_as_numbers(kind, cage, surface, tmp_path, monkeypatch):
    monkeypatch.setattr(queries, "BATCH", 3)
    rng = np.random.default_rng(0)
    face = rng.integers(15, size=20).astype(np.uint8)
    u, v = rng.random(20).astype(np.float32), rng.random(20)
    if kind == "integers":
        u, v = rng.integers(2, size=(2, 20))
    rows = np.stack([face, u, v], axis=1)
    path = tmp_path / "q.npy"
    if kind in ("npz", "packed"):
        path = tmp_path / "q.npz"
        save = np.savez if kind == "npz" else np.savez_compressed
        save(path, v=v, u=u, face=face, other=np.array(["text", "text"]))
    elif kind == "columns":
        structured = np.zeros(20, dtype=[("v", float), ("face", np.uint8), ("u", np.float32)])
        structured["face"], structured["u"], structured["v"] = face, u, v
        np.save(path, structured)
    elif kind in ("rows", "integers", "fortran"):
        np.save(path, np.asfortranarray(rows) if kind == "fortran" else rows)
    elif kind == "array":
        path = tmp_path / "q.zarr"
        zarr.create_array(path, data=rows, chunks=(7, 2))
    elif kind == "group":
        path = tmp_path / "q.zarr"
        group = zarr.open_group(path, mode="w")
        for name, values in [("face", face), ("u", u), ("v", v)]:
            group.create_array(name, data=values, chunks=(7,))
    elif kind == "parquet":
        path = tmp_path / "q.parquet"
        pq.write_table(pa.table({"v": v, "other": face, "u": u, "face": face}), path)
    else:
        folder = tmp_path / "q.parquet"
        folder.mkdir()
        for k in range(20):
            part = slice(k, k + 1)
            columns_of_part = {"face": face[part], "u": u[part], "v": v[part]}
            pq.write_table(pa.table(columns_of_part), folder / f"part.{k}.parquet")
        path = folder if kind == "folder" else folder / "part.*.parquet"
    found = table(succeed("evaluate", cage, "--queries", path))
    np.testing.assert_array_equal(found["face"], face)
    same(columns(found, "x", "y", "z"), surface.evaluate(face, u.astype(float), v.astype(float)))


@pytest.mark.parametrize("name", FORMATS)
def test_answers_are_queries(name, cage, tmp_path):
    first, again = tmp_path / name, tmp_path / f"again{name}"
    succeed("evaluate", cage, "--random", 7, "-o", first)
    succeed("evaluate", cage, "--queries", first, "-o", again)
    same_arrays(arrays_in(again), arrays_in(first))
    if first.is_file():
        assert first.read_bytes() == again.read_bytes()
    succeed("evaluate", cage, "--queries", first, "--normals", "-o", first)  # in place
    assert len(arrays_in(first)) > len(arrays_in(again))


@pytest.mark.parametrize("name", FORMATS)
def test_no_queries_no_answers(name, cage, tmp_path):
    assert succeed("evaluate", cage, "--random", 0) == "face,u,v,x,y,z\n"
    assert succeed("evaluate", cage, "--queries", "-", stdin="face,u,v\n") == "face,u,v,x,y,z\n"
    first, again = tmp_path / name, tmp_path / f"again{name}"
    succeed("evaluate", cage, "--random", 0, "--normals", "-o", first)
    succeed("evaluate", cage, "--queries", first, "--normals", "-o", again)
    if name == "a.csv":
        assert first.read_text() == again.read_text() == "face,u,v,x,y,z,n_x,n_y,n_z\n"
        return
    same_arrays(arrays_in(again), arrays_in(first))
    assert {len(values) for values in arrays_in(first).values()} == {0}


def test_nan_queries_get_nan_answers(cage):
    found = table(succeed("evaluate", cage, "--queries", "-", stdin="0,nan,0\n0,0.5,inf\n0,0,0\n"))
    assert np.isnan(found["x"]).tolist() == [True, True, False]


def test_batches_do_not_show(cage, tmp_path, monkeypatch):
    command = ["evaluate", cage, "--grid", 2, "--order", 1, "--normals"]
    whole = table(succeed(*command))
    monkeypatch.setattr(queries, "BATCH", 7)
    monkeypatch.setattr(answers, "LINES", 5)
    pieces = table(succeed(*command))
    for name in whole.dtype.names:
        same(pieces[name], whole[name])


@pytest.mark.parametrize("suffix", [".csv", ".npy", ".npz", ".parquet", ".zarr"])
@pytest.mark.parametrize("wrong", ["face", "u", "v"])
def test_a_bad_query_is_named_by_its_place_in_all(suffix, wrong, cage, tmp_path, monkeypatch):
    monkeypatch.setattr(queries, "BATCH", 7)
    rows = {"face": np.zeros(40, int), "u": np.zeros(40), "v": np.zeros(40)}
    rows[wrong][33] = 15
    path, place = tmp_path / f"q{suffix}", "row 33"
    if suffix == ".csv":
        text = "".join(f"{f},{u},{v}\n" for f, u, v in zip(*rows.values(), strict=True))
        path.write_text("# queries\nface,u,v\n\n" + text.replace("\n", "\n# between\n"))
        place = f"line {4 + 2 * 33}"
    elif suffix == ".npy":
        np.save(path, np.stack([*rows.values()], axis=1))
    elif suffix == ".npz":
        np.savez(path, **rows)
    elif suffix == ".parquet":
        pq.write_table(pa.table(rows), path, row_group_size=11)
    else:
        group = zarr.open_group(path, mode="w")
        for name, values in rows.items():
            group.create_array(name, data=values)
    before = sorted(tmp_path.iterdir())
    for target in FORMATS:
        message = fail("evaluate", cage, "--queries", path, "-o", tmp_path / target)
        assert message.startswith(f"{path}: {place}: ")
        assert "15" in message
    assert sorted(tmp_path.iterdir()) == before


def test_memory_holds_batches_not_files(cage, tmp_path):
    """Answers to a million queries are 48 MB, which no step may add."""
    script = f"""
import resource
from limitsurf.shell.io import queries
from limitsurf.shell.cli.commands import main

queries.BATCH = 1 << 14
def peak(*options):
    main(["evaluate", {str(cage)!r}, *options], standalone_mode=False)
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024  # MB

for suffix in ["npz", "npy", "parquet", "zarr"]:
    peak("--random", "50000", "-o", f"small.{{suffix}}")
    start = peak("--queries", f"small.{{suffix}}", "-o", "again.npz")
for name, options in {{
    "large.npz": ["--random", "1000000"],
    "large.parquet": ["--queries", "large.npz"],
    "large.zarr": ["--queries", "large.parquet"],
    "large.npy": ["--queries", "large.zarr"],
}}.items():
    more = peak(*options, "-o", name) - start
    assert more < 30, f"{{more}} MB more for {{name}}"
"""
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True)
    assert done.returncode == 0, done.stderr


def test_boundary_option(tmp_path):
    path = tmp_path / "grid.obj"
    points, faces = zoo.grid(3, 3)
    ls.write(path, ls.Mesh(np.resize(np.asarray(points, float), (16, 3)), faces))
    found = table(succeed("evaluate", path, "--grid", 1, "--boundary", "none"))
    assert np.isnan(found["x"]).sum() == 8
    found = table(succeed("evaluate", path, "--grid", 1))
    assert not np.isnan(found["x"]).any()
    fail("info", path, "--boundary", "sideways")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "empty"),
        ("# nothing\n\n", "empty"),
        ("u,v\n0,0\n", "line 1"),
        ("0,0\n", "line 1"),
        ("face,u,v\n0,0,0\n0,one,0\n", "line 3"),
        ("\n0,0,0\n\n0.5,0,0\n", "line 4"),
        ("0,0,0\n0,0\n", "line 2"),
        ("0,0,0\n99999999999999999999,0,0\n", "line 2"),
        ("0,0,0\n0,0,\n", "line 2"),
        ("0;0;0\n", "line 1"),
        ("0,0,0\n15,0,0\n", "15"),
        ("0,0,0\n-1,0,0\n", "-1"),
        ("0,2,0\n", "2"),
        ("0,0,-1e-9\n", "-1e-09"),
    ],
)
def test_bad_csv(text, expected, cage, tmp_path):
    path = tmp_path / "q.csv"
    path.write_text(text)
    message = fail("evaluate", cage, "--queries", path)
    assert "q.csv" in message
    assert expected in message


def test_bad_query_files(cage, tmp_path):
    def message(name, content=None):
        if isinstance(content, bytes):
            (tmp_path / name).write_bytes(content)
        elif isinstance(content, dict):
            np.savez(tmp_path / name, **content)
        elif content is not None:
            np.save(tmp_path / name, content, allow_pickle=True)
        text = fail("evaluate", cage, "--queries", tmp_path / name)
        assert name in text
        return text

    noise = bytes(range(256)) * 9
    ones = np.ones(2)
    message("none.csv")
    message("none.npy")
    message("q.txt", b"0,0,0\n")
    message("noise.csv", noise)
    message("noise.npy", noise)
    message("noise.npz", noise)
    message("empty.npy", b"")
    message("empty.npz", b"")
    (tmp_path / "folder.npy").mkdir()
    message("folder.npy")
    message("object.npy", np.array([[0, 0, None]], dtype=object))
    assert "shape" in message("flat.npy", np.zeros(3))
    assert "shape" in message("wide.npy", np.zeros((2, 4)))
    assert "row 1" in message("half.npy", np.array([[0, 0, 0], [0.5, 0, 0]]))
    assert "row 0" in message("nan.npy", np.array([[np.nan, 0, 0]]))
    assert "'v'" in message("short.npz", {"face": ones, "u": ones})
    assert "(3,)" in message("ragged.npz", {"face": ones, "u": ones, "v": np.ones(3)})
    assert "numbers" in message("text.npz", {"face": ones, "u": ones, "v": np.array(["a", "b"])})
    assert "numbers" in message("complex.npy", np.zeros((2, 3), complex))

    ones, text = np.ones(2000), np.full(2000, "a")
    np.save(tmp_path / "q.npy", np.ones((2000, 3)))
    np.savez(tmp_path / "q.npz", face=ones, u=ones, v=ones)
    np.savez_compressed(tmp_path / "packed.npz", face=ones, u=ones, v=ones)
    pq.write_table(pa.table({"face": ones, "u": ones, "v": ones}), tmp_path / "q.parquet")
    for name in ["q.npy", "q.npz", "packed.npz", "q.parquet"]:
        content = (tmp_path / name).read_bytes()
        for size in [1, 100, len(content) // 2, len(content) - 1]:
            message(f"short{size}{name}", content[:size])
    flipped = bytearray((tmp_path / "q.npz").read_bytes())
    flipped[10_000] ^= 255
    assert "CRC" in message("flipped.npz", bytes(flipped))

    def parquet(name, **arrays):
        pq.write_table(pa.table(arrays), tmp_path / name)
        return message(name)

    message("none.parquet")
    (tmp_path / "folder.parquet").mkdir()
    assert "no Parquet files" in message("folder.parquet")
    assert "no Parquet files" in message("*?.parquet/x*.parquet")
    message("noise.parquet", noise)
    assert "'v'" in parquet("short.parquet", face=ones, u=ones)
    assert "string" in parquet("text.parquet", face=ones, u=ones, v=text)
    assert "bool" in parquet("bool.parquet", face=ones, u=ones, v=ones > 0)
    assert "row 1:" in parquet("null.parquet", face=[1, None], u=[0, 1], v=[0, 1])

    def store(name, **arrays):
        group = zarr.open_group(tmp_path / name, mode="w")
        for key, values in arrays.items():
            group.create_array(key, data=values)
        return message(name)

    message("none.zarr")
    (tmp_path / "folder.zarr").mkdir()
    message("folder.zarr")
    message("noise.zarr", noise)
    assert "'u'" in store("short.zarr", face=ones, v=ones)
    assert "(3,)" in store("ragged.zarr", face=ones, u=np.ones(3), v=ones)
    assert "shape" in store("deep.zarr", face=ones, u=np.ones((2000, 1)), v=ones)
    assert "bool" in store("bool.zarr", face=ones, u=ones > 0, v=ones)
    zarr.create_array(tmp_path / "flat.zarr", data=ones)
    assert "shape" in message("flat.zarr")


@pytest.mark.parametrize(
    "options",
    [
        [],
        ["--grid", 2, "--random", 3],
        ["--grid", 0],
        ["--random", -1],
        ["--grid", "two"],
        ["--grid", 1, "--order", -1],
        ["--grid", 1, "--seed", -1],
        ["--grid", 1, "-o", "a.txt"],
        ["--grid", 1, "-o", "a"],
    ],
)
def test_bad_options_of_evaluate(options, cage):
    fail("evaluate", cage, *options)


def test_outputs_that_cannot_be_written(cage, tmp_path):
    (tmp_path / "folder.csv").mkdir()
    assert "nowhere" in fail("evaluate", cage, "--grid", 1, "-o", tmp_path / "nowhere" / "a.csv")
    assert "folder.csv" in fail("evaluate", cage, "--grid", 1, "-o", tmp_path / "folder.csv")
    assert "nowhere" in fail("plot", cage, "-o", tmp_path / "nowhere" / "a.png", "--size", 9, 9)


@pytest.mark.parametrize("name", FORMATS)
def test_an_output_appears_whole_or_not_at_all(name, cage, tmp_path, monkeypatch):
    path = tmp_path / name
    succeed("evaluate", cage, "--random", 3, "-o", path)
    precious, before = arrays_in(path), sorted(tmp_path.rglob("*"))
    monkeypatch.setattr(queries, "BATCH", 7)
    evaluate, calls = answers.Question.__call__, []

    def fails_at_last(self, surface, face, u, v):
        calls.append(face)
        return evaluate(self, surface, face, u, v) if len(calls) < 3 else 1 / 0

    monkeypatch.setattr(answers.Question, "__call__", fails_at_last)
    result = run("evaluate", cage, "--grid", 2, "-o", path)
    assert isinstance(result.exception, ZeroDivisionError)
    assert len(calls) == 3
    same_arrays(arrays_in(path), precious)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("name", ["a.npy", "a.npz", "a.parquet"])
def test_pipes_take_every_format(name, cage, tmp_path):
    path = tmp_path / name
    os.mkfifo(path)
    with (tmp_path / f"copy{name}").open("wb") as copy:
        reader = subprocess.Popen(["cat", path], stdout=copy)
        succeed("evaluate", cage, "--random", 20, "-o", path)
        assert reader.wait(timeout=60) == 0
    succeed("evaluate", cage, "--random", 20, "-o", tmp_path / f"file{name}")
    same_arrays(arrays_in(tmp_path / f"copy{name}"), arrays_in(tmp_path / f"file{name}"))


def test_only_zarr_directories_are_replaced(cage, tmp_path):
    folder = tmp_path / "photos.zarr"
    folder.mkdir()
    (folder / "holiday.jpg").write_text("precious")
    assert "something else" in fail("evaluate", cage, "--grid", 1, "-o", folder)
    assert (folder / "holiday.jpg").exists()


@pytest.mark.parametrize(("module", "name"), [("pyarrow", "a.parquet"), ("zarr", "a.zarr")])
def test_without_the_extra(module, name, cage, tmp_path, monkeypatch):
    for loaded in [loaded for loaded in sys.modules if loaded.split(".")[0] == module]:
        monkeypatch.setitem(sys.modules, loaded, None)
    monkeypatch.setitem(sys.modules, module, None)
    for options in [["--queries", tmp_path / name], ["--grid", 1, "-o", tmp_path / name]]:
        message = fail("evaluate", cage, *options)
        assert f"{module} is needed" in message
        assert 'pip install "limitsurf[dask]"' in message
    succeed("evaluate", cage, "--grid", 1, "-o", tmp_path / "a.npy")


def test_schedulers_that_are_none(cage, tmp_path, monkeypatch):
    np.save(tmp_path / "q.npy", np.zeros((2, 3)))
    options = ["--queries", tmp_path / "q.npy", "-o", tmp_path / "a.zarr", "--scheduler"]
    assert "tcp://" in fail("evaluate", cage, *options, "nonsense")
    monkeypatch.setitem(sys.modules, "distributed", None)
    message = fail("evaluate", cage, *options, "tcp://127.0.0.1:1")
    assert 'distributed is needed for a cluster: pip install "limitsurf[dask]"' in message
    for others in [["--grid", 1], options[:2], [*options[:3], "a.csv"]]:
        message = fail("evaluate", cage, *others, "--scheduler", "tcp://127.0.0.1:1")
        assert "--scheduler needs" in message
    (tmp_path / "a.parquet").mkdir()
    (tmp_path / "a.parquet" / "mine.txt").write_text("precious")
    options[3] = tmp_path / "a.parquet"
    assert "something else" in fail("evaluate", cage, *options, "tcp://127.0.0.1:1")


def test_a_pipe_is_written_not_replaced(cage, tmp_path):
    path = tmp_path / "a.csv"
    os.mkfifo(path)
    reader = subprocess.Popen(["cat", path], stdout=subprocess.PIPE, text=True)
    succeed("evaluate", cage, "--grid", 1, "-o", path)
    assert reader.communicate(timeout=60)[0] == succeed("evaluate", cage, "--grid", 1)
    assert path.is_fifo()


# ------------------------------------------------------------------ meshes


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".stl", ".vtp", ".glb", ".usda"])
def test_tessellate(suffix, cage, surface, tmp_path):
    path = tmp_path / f"fine{suffix}"
    assert succeed("tessellate", cage, "-n", 3, "-o", path).startswith(str(path))
    expected = ls.tessellate(surface, 3)
    fine = ls.read(path)
    area = {
        name: polygon_area(*mesh)
        for name, mesh in {
            "expected": (expected.points, expected.sizes, expected.indices),
            "found": (fine.points, fine.sizes, fine.indices),
        }.items()
    }
    assert area["found"] == pytest.approx(area["expected"], rel=1e-2)


def polygon_area(points, sizes, indices):
    """The area of polygons (that are almost flat)."""
    last = np.cumsum(sizes) - 1
    after = np.arange(len(indices)) + 1
    after[last] -= sizes
    face = np.repeat(np.arange(len(sizes)), sizes)
    wedge = np.zeros((len(sizes), 3))
    np.add.at(wedge, face, np.cross(points[indices], points[indices[after]]))
    return np.linalg.norm(wedge, axis=1).sum() / 2


@pytest.mark.parametrize(
    ("names", "suffix", "kept", "lost"),
    [
        (["st"], ".obj", "st", []),
        (["map"], ".ply", "map", []),
        (["st", "uv", "map"], ".obj", "uv", ["st", "map"]),
        (["a", "b"], ".obj", None, ["a", "b"]),
        (["uv"], ".off", None, ["uv"]),
    ],
)
def test_channels_of_a_tessellation(monkeypatch, tmp_path, names, suffix, kept, lost):
    """Texture coordinates by any name are written, and what is not is named."""
    points, faces = zoo.cube()
    rows = np.arange(24)
    channels = {name: (np.random.default_rng(0).random((24, 2)), rows, "all") for name in names}
    mesh, path = ls.Mesh(points, faces, channels=channels), tmp_path / f"fine{suffix}"
    monkeypatch.setattr(ls, "read", lambda *_, **__: mesh)
    done = CliRunner().invoke(main, ["tessellate", "cage.obj", "-n", "2", "-o", str(path)])
    assert done.exit_code == 0
    said = [
        word
        for word in names
        if f"left out: channel {word!r}" in done.stderr.replace(", channel", " left out: channel")
    ]
    assert said == lost
    monkeypatch.undo()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert list(ls.read(path).channels) == ([] if kept is None else ["uv"])


def test_tessellate_options(cage, tmp_path):
    path = tmp_path / "fine.obj"
    found = facts("tessellate", cage, "-n", 2, "-o", path)
    assert found["output"] == str(path)
    assert (found["faces"], found["limit_faces"], found["n"]) == (60, 15, 2)
    assert (found["normals"], found["channels"]) == (True, [])
    text = path.read_text()
    assert text.count("\nv ") == found["vertices"] - text.startswith("v ")
    assert "\nvn " in text
    assert "vn " not in succeed("tessellate", cage, "-n", 2, "--no-normals")
    assert succeed("tessellate", cage, "-n", 2) == text
    assert succeed("tessellate", cage, "-n", 2, "-o", "-", "--to", "OBJ") == text
    other = tmp_path / "fine.txt"
    succeed("tessellate", cage, "-n", 2, "-o", other, "--to", "obj")
    assert other.read_text() == text
    assert found["angle_error"] is None
    found = facts("tessellate", cage, "--chord", 1, "--angle", 60, "--no-normals", "-o", path)
    assert 0 < found["angle_error"] <= 60


def test_texture_coordinates_come_along(tmp_path):
    path = tmp_path / "painted.obj"
    uv = np.eye(2), [0, 1] * 12, "boundaries"
    ls.write(path, ls.Mesh(*zoo.cube(), channels={"uv": uv}))
    assert facts("tessellate", path, "-o", tmp_path / "a.obj")["channels"] == ["uv"]
    assert "\nvt " in (tmp_path / "a.obj").read_text()
    result = run("tessellate", path, "-o", tmp_path / "a.stl")
    assert result.exit_code == 0
    assert "type .stl cannot hold everything, left out: channel 'uv'" in result.stderr
    assert "'st'; it has 'uv'" in fail("tessellate", path, "--channel", "st").replace(
        "no channel ", ""
    )


def test_refine(cage, tmp_path):
    path = tmp_path / "fine.obj"
    found = facts("refine", cage, "--levels", 2, "-o", path)
    fine = ls.refined(ls.read(cage), 2)
    assert ls.read(path) == fine.with_points(fine.points)
    counts = {"vertices": fine.n_vertices, "edges": fine.n_edges, "faces": fine.n_faces}
    assert found == {"output": str(path), **counts, "levels": 2, "limit": False}
    assert succeed("refine", cage, "--levels", 2) == path.read_text()
    succeed("refine", cage, "--levels", 2, "--limit", "-o", path)
    np.testing.assert_array_equal(ls.read(path).points, fine.limit_points)
    assert "vertices" in succeed("refine", cage, "-o", path)


def test_refined_cages_keep_tags_and_rules(tmp_path):
    path, fine = tmp_path / "cage.obj", tmp_path / "fine.obj"
    creases = {(5, 6): 2.5, (6, 10): np.inf}
    ls.write(path, ls.Mesh(*zoo.grid(3, 3), creases=creases, corners={9: 3}, holes=[4]))
    succeed("refine", path, "-o", fine, "--boundary", "none", "--limit")
    found = ls.read(fine)
    expected = ls.refined(ls.read(path), boundary="none")
    assert found.boundary == "none"
    assert sorted(found.creases[1]) == sorted(expected.creases[1])
    np.testing.assert_array_equal(found.holes, expected.holes)
    lost = np.isnan(expected.limit_points)
    assert 0 < lost.sum() < lost.size
    np.testing.assert_array_equal(found.points[lost], expected.points[lost])
    np.testing.assert_array_equal(found.points[~lost], expected.limit_points[~lost])


@pytest.mark.parametrize("suffix", [".usda", ".ply", ".vtp", ".off"])
def test_convert(suffix, cage, tmp_path):
    there, back = tmp_path / f"cage{suffix}", tmp_path / "back.obj"
    found = facts("convert", cage, there)
    assert found == {"output": str(there), "vertices": 10, "edges": 15, "faces": 7}
    succeed("convert", there, back)
    mesh, expected = ls.read(back), ls.read(cage)
    np.testing.assert_allclose(mesh.points, expected.points, atol=1e-6)
    assert (mesh.n_faces, mesh.n_edges) == (7, 15)


def test_one_prim_of_many(tmp_path):
    from pxr import Usd, UsdGeom

    path = tmp_path / "two.usda"
    stage = Usd.Stage.CreateNew(str(path))
    for name, (points, faces) in {"cube": zoo.cube(), "tetra": zoo.tetrahedron()}.items():
        prim = UsdGeom.Mesh.Define(stage, f"/{name}")
        prim.CreatePointsAttr([tuple(map(float, point)) for point in points])
        prim.CreateFaceVertexCountsAttr([len(face) for face in faces])
        prim.CreateFaceVertexIndicesAttr([int(v) for face in faces for v in face])
    stage.Save()
    assert facts("info", path)["vertices"] == 12
    assert facts("info", path, "--prim", "/tetra")["vertices"] == 4
    assert facts("convert", path, tmp_path / "a.obj", "--prim", "/cube")["faces"] == 6
    assert "/none" in fail("info", path, "--prim", "/none")


# ------------------------------------------------------------------ pipes


def test_cages_come_from_the_standard_input(cage, tmp_path):
    text, command = cage.read_bytes(), list[Any]()
    for command in [
        ["info", "-"],
        ["evaluate", "-", "--grid", 1],
        ["validate", "-", "--levels", 1],
        ["tessellate", "-", "-n", 2],
        ["refine", "-"],
        ["convert", "-", "-"],
    ]:
        named = [cage if word == "-" else word for word in command]
        named[2:3] = ["-"] if command[0] == "convert" else named[2:3]
        assert succeed(*command, stdin=text) == succeed(*named), command
    succeed("plot", "-", "-o", tmp_path / "a.png", "--size", 60, 40, "-n", 2, stdin=text)


def test_other_formats_in_pipes(cage, tmp_path):
    for suffix in ["usda", ".ply"]:
        content = run("convert", cage, "-", "--to", suffix)
        assert (content.exit_code, content.stderr) == (0, "")
        found = facts("info", "-", "--from", suffix.upper(), stdin=content.stdout_bytes)
        assert (found["vertices"], found["faces"]) == (10, 7)
        odd = tmp_path / "cage.dat"
        odd.write_bytes(content.stdout_bytes)
        assert facts("info", odd, "--from", suffix)["faces"] == 7


@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")
def test_a_pipeline_of_a_shell(cage, tmp_path):
    (tmp_path / "limitsurf").write_text(f'#!/bin/sh\nexec {shlex.join(PROGRAM)} "$@"\n')
    (tmp_path / "limitsurf").chmod(0o755)
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
    line = f"limitsurf refine {cage} -o - | limitsurf tessellate - -n 4 -o fine.ply"
    done = subprocess.run(
        ["bash", "-o", "pipefail", "-c", line], cwd=tmp_path, env=environment, capture_output=True
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout == b"fine.ply: 482 vertices, 480 faces\n"


# ------------------------------------------------------------------ basis


@pytest.mark.parametrize(
    "options", [["--valence", 3], ["--valence", 4], ["--kind", "interior", "--faces", 3]]
)
def test_basis(options):
    found = facts("basis", *options, "--digits", 20)
    valence = found["faces"]
    basis = ls.eigenbasis("catmull-clark", valence=valence)
    assert found["control_points"] == 2 * valence + 8
    values = [value["real"] for value in found["eigenvalues"] for _ in range(value["multiplicity"])]
    assert sorted(values) == pytest.approx(sorted(basis.float64.eigenvalues), abs=1e-15)
    mask = [weight["decimal"] for weight in found["limit_mask"]]
    same(np.array(mask, float), basis.float64.limit_mask[: len(mask)])
    for weights, expected in zip(found["tangent_masks"], basis.float64.tangent_masks, strict=True):
        same([float(weight["decimal"]) for weight in weights], expected[: len(weights)])
    lam, mu = (found["growth"][name] for name in ("l1", "l3"))
    assert found["growth"]["first_derivatives"] == pytest.approx(2 * lam)
    assert found["growth"]["curvature"] == pytest.approx(mu / lam**2)


def test_basis_in_words():
    output = succeed("basis", "--valence", 3)
    for text in ["sqrt(17)/32 + 9/32", "0.4100970508", "frequency 1", "0.820194", "3/8"]:
        assert text in output
    assert re.search(r"0\.4100970508 +2 +frequency 1 ", output)
    output = succeed("basis", "--kind", "crease", "--faces", 4)
    assert re.search(r"0\.5000000000 +2 +2 +wave 2, curve +1/2\n", output)
    assert "crease of 4 faces\n" in output
    assert "crease of 1 face\n" in succeed("basis", "--kind", "crease", "--faces", 1)
    position = succeed("basis", "--kind", "corner", "--faces", 2, "--position", 1)
    assert "corner of 2 faces, seen from face 1\n" in position


def test_basis_of_complex_eigenvalues():
    found = facts("basis", "--kind", "dart", "--faces", 6, "--digits", 5)
    pair = [value for value in found["eigenvalues"] if value["imaginary"]]
    assert [value["decimal"] for value in pair] == ["0.34397+0.029918i", "0.34397-0.029918i"]


def test_jordan_blocks_of_a_basis():
    found = facts("basis", "--kind", "crease", "--faces", 4)
    (half,) = (value for value in found["eigenvalues"] if value["exact"] == "1/2")
    assert (half["multiplicity"], half["jordan"]) == (2, [2])
    found = facts("basis", "--valence", 2)
    (eighth,) = (value for value in found["eigenvalues"] if value["exact"] == "1/8")
    assert (eighth["multiplicity"], eighth["jordan"]) == (3, [2, 1])
    assert found["tangent_masks"] == []
    assert found["growth"]["normals"] is None


def test_long_closed_forms_are_for_those_who_ask():
    short, long = (
        succeed("basis", "--kind", "dart", "--faces", 6, *exact) for exact in ([], ["--exact"])
    )
    assert "CRootOf" not in short
    assert "CRootOf" in long
    assert len(long) > 2 * len(short)


def test_basis_in_latex():
    latex = succeed("basis", "--valence", 3, "--latex")
    assert r"\frac{\sqrt{17}}{32} + \frac{9}{32} & 0.4100970508 & 2 & \text{frequency 1}" in latex
    assert latex.count(r"\begin{array}") == latex.count(r"\end{array}") == 2
    assert succeed("basis", "--valence", 3, "--latex", "--exact").count(r"\begin{array}") == 4
    found = facts("basis", "--valence", 3, "--latex")
    assert found["eigenvalues"][1]["latex"] == r"\frac{\sqrt{17}}{32} + \frac{9}{32}"


def test_a_large_valence():
    found = facts("basis", "--valence", 50, "--digits", 30)
    assert sum(value["multiplicity"] for value in found["eigenvalues"]) == 108
    with mp.workdps(40):
        c, s = mp.cospi(mp.mpf(2) / 50), mp.cospi(mp.mpf(1) / 50)
        expected = mp.nstr((5 + c + s * mp.sqrt(18 + 2 * c)) / 16, 30)
    assert found["eigenvalues"][1]["decimal"] == expected


@pytest.mark.parametrize(
    "options",
    [
        [],
        ["--valence", 1],
        ["--valence", 3, "--faces", 3],
        ["--valence", 3, "--kind", "crease"],
        ["--kind", "crease"],
        ["--kind", "fold", "--faces", 3],
        ["--kind", "dart", "--faces", 1],
        ["--kind", "crease", "--faces", 3, "--position", 3],
        ["--valence", 3, "--scheme", "loup"],
        ["--valence", 3, "--digits", 0],
        ["--valence", "three"],
    ],
)
def test_bad_options_of_basis(options):
    fail("basis", *options)


# ------------------------------------------------------------------ completion


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_scripts(shell, monkeypatch):
    script = succeed("completion", shell)
    assert f"_LIMITSURF_COMPLETE={shell}_complete" in script
    monkeypatch.setenv("SHELL", f"/usr/bin/{shell}")
    assert succeed("completion") == script


def test_no_completion_for_other_shells(monkeypatch):
    fail("completion", "tcsh")
    monkeypatch.setenv("SHELL", "/bin/tcsh")
    assert "'tcsh'" in fail("completion")
    monkeypatch.delenv("SHELL")
    fail("completion")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("limitsurf ev", ["plain,evaluate"]),
        ("limitsurf evaluate --or", ["plain,--order"]),
        ("limitsurf evaluate cage.obj --boundary edge_o", ["plain,edge_only"]),
        ("limitsurf info ca", ["file,ca"]),
        ("limitsurf info - --from .usdz", ["plain,.usdz"]),
        ("limitsurf refine - --to .ob", ["plain,.obj"]),
        ("limitsurf tessellate cage.obj -o fi", ["file,fi"]),
    ],
)
def test_completion(words, expected, monkeypatch):
    monkeypatch.setenv("_LIMITSURF_COMPLETE", "bash_complete")
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(len(words.split()) - 1))
    assert succeed().splitlines() == expected


# ------------------------------------------------------------------ validate, plot


def test_validate(cage):
    head, *rows = succeed("validate", cage, "--levels", 3).splitlines()
    assert head.split() == ["level", "error", "order", "limit", "error"]
    assert [row.split()[0] for row in rows] == ["1", "2", "3"]
    assert all(float(row.split()[-1]) < 1e-14 for row in rows)
    fail("validate", cage, "--levels", 0)


def test_validate_as_json(cage, tmp_path):
    found = facts("validate", cage, "--levels", 2)
    assert (found["cage"], found["agrees"]) == (str(cage), True)
    expected = ls.validate(ls.LimitSurface(ls.read(cage)), 2)
    for row, level in zip(found["levels"], expected, strict=True):
        assert row == {name: level[name] for name in expected.dtype.names}
    path = tmp_path / "grid.obj"
    solid = np.pad(np.asarray(zoo.grid(1, 1)[0], float)[:, :2], ((0, 0), (0, 1)))
    ls.write(path, ls.Mesh(solid, zoo.grid(1, 1)[1], boundary="none"))
    found = facts("validate", path, "--levels", 1)
    assert found["levels"][0]["error"] is None  # there is no surface


def test_validate_a_channel(painted):
    found = facts("validate", painted, "--levels", 1, "--channel", "st", "--workers", 2)
    surface = ls.LimitSurface(ls.read(painted))
    expected = ls.validate(surface, 1, channel="st")["error"][0]
    assert (found["agrees"], found["levels"][0]["error"]) == (True, expected)
    assert "it has 'heat', 'st'" in fail("validate", painted, "--channel", "uv")


def test_validate_fails_when_the_refiner_disagrees(cage, monkeypatch):
    validate = ls.validate

    def shaken(surface, levels, **options):
        found = validate(surface, levels, **options)
        found["limit_error"][-1] = 1e-9
        return found

    monkeypatch.setattr(ls, "validate", shaken)
    result = run("validate", cage)
    assert result.exit_code == 1
    assert "more than rounding" in result.output


def test_plot(cage, tmp_path):
    path = tmp_path / "a.png"
    options = ["--size", 80, 60, "--no-cage", "--no-curves", "--no-poles", "--normals"]
    output = succeed("plot", cage, "-o", path, *options, "--up", "y", "--color", "teal")
    assert str(path) in output
    assert path.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    "options",
    [
        ["--scalars", "gaussian", "--limits", -1, 2, "--cmap", "viridis", "--label", "curvature"],
        ["--scalars", "zebra", "--view", "top"],
        ["--isolines", 3, "--no-curves", "--view", "1,-2,0.5"],
    ],
)
def test_pictures_of_every_kind(options, cage, tmp_path):
    pictures = []
    for k, more in enumerate([[], options]):
        path = tmp_path / f"{k}.png"
        found = facts("plot", cage, "-o", path, "--size", 80, 60, "-n", 4, *more)
        assert found == {"output": str(path), "width": 80, "height": 60, "limit_faces": 15}
        pictures.append(path.read_bytes())
    assert pictures[0] != pictures[1]


def test_another_name_of_n_is_taken_but_not_shown(cage, tmp_path):
    pictures = []
    for name in ("-n", "--quads"):
        path = tmp_path / f"{name}.png"
        succeed("plot", cage, "-o", path, "--size", 80, 60, name, 2)
        pictures.append(path.read_bytes())
    assert pictures[0] == pictures[1]
    assert "--quads" not in succeed("plot", "--help")


def test_plot_as_a_page(cage, tmp_path):
    path = tmp_path / "a.html"
    assert succeed("plot", cage, "-o", path, "-n", 2) == f"{path}\n"
    assert "<html" in path.read_text()[:2000].lower()


def test_plot_of_a_channel(painted, tmp_path):
    pictures = []
    for k, options in enumerate([[], ["--channel", "st"]]):
        path = tmp_path / f"{k}.png"
        succeed("plot", painted, "-o", path, "--size", 80, 60, "-n", 4, *options)
        pictures.append(path.read_bytes())
    assert pictures[0] != pictures[1]
    assert "shape" in fail("plot", painted, "-o", tmp_path / "a.png", "--channel", "heat")


@pytest.mark.parametrize(
    "options",
    [
        ["-o", "a.gif"],
        ["-o", "a.png", "--size", 0, 9],
        ["-o", "a.png", "-n", 0],
        ["-o", "a.png", "--color", "no such color"],
        ["-o", "a.png", "--up", "w"],
    ],
)
def test_bad_options_of_plot(options, cage):
    fail("plot", cage, *options)


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there always is a window")
def test_plot_without_a_display(cage, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert "display" in fail("plot", cage)


def test_plot_without_pyvista(cage, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    assert "pip install" in fail("plot", cage, "-o", tmp_path / "a.png")


# ------------------------------------------------------------------ the process


def test_the_program_runs(cage):
    done = subprocess.run([*PROGRAM, "info", cage], capture_output=True, text=True, check=True)
    assert "limit faces" in done.stdout
    assert done.stderr == ""
    done = subprocess.run([*PROGRAM, "info", "nowhere.obj"], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "limitsurf: error: nowhere.obj: No such file or directory\n"


@pytest.mark.parametrize("n", [3, 50_000])
def test_a_reader_that_goes_away_is_no_drama(n, cage):
    command = [*PROGRAM, "evaluate", cage, "--random", str(n)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 1


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full")
def test_a_full_disk(cage):
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [*PROGRAM, "evaluate", cage, "--grid", "2"], stdout=full, stderr=subprocess.PIPE
        )
    assert done.returncode == 2
    expected = "limitsurf: error: standard output: No space left on device\n"
    assert done.stderr.decode() == expected


def test_interrupt(cage):
    command = [*PROGRAM, "evaluate", cage, "--random", "90000"]  # a few more would be compiled
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.readline()  # the answers have begun, and the pipe is soon full
        process.send_signal(signal.SIGINT)
        _, stderr = process.communicate(timeout=60)
    assert process.returncode == 130
    assert b"Traceback" not in stderr


def test_faces_are_selected(tmp_path):
    data = {"group": ["lid", "side", "lid", "a=b", "", ""], "material": ["oak"] * 2 + ["fir"] * 4}
    path, part = tmp_path / "cube.obj", tmp_path / "part.obj"
    cube = ls.Mesh(*zoo.cube())
    ls.write(path, cube.with_tags(face_data=data))
    for given, faces in [
        (["group=lid"], 2),
        (["group=lid", "group=a=b"], 3),
        (["group=lid", "material=fir"], 1),
        (["group="], 2),
    ]:
        options = [x for text in given for x in ("--select", text)]
        assert facts("info", path, *options)["faces"] == faces
    succeed("convert", path, part, "--select", "group=lid")
    assert ls.read(part).n_faces == 2
    for given, message in [
        ("group", "need NAME=VALUE"),
        ("group=top", "no face has group 'top': they have '', 'a=b', 'lid', 'side'"),
        ("colour=red", "there is no data of faces 'colour'"),
    ]:
        assert message in fail("info", path, "--select", given)


def test_faces_are_selected_by_numbers_and_truth(tmp_path, monkeypatch):
    data = {"id": [7, 2, 2, 0, 0, 0], "odd": np.arange(6) % 2 == 1, "heat": np.arange(6) / 10}
    cube = ls.Mesh(*zoo.cube(), face_data=data)
    monkeypatch.setattr("limitsurf.read", lambda *_, **__: cube)
    path = tmp_path / "cube.obj"
    for given, faces in [("id=2", 2), ("id=2.0", 2), ("odd=True", 3), ("odd=0", 3), ("heat=.3", 1)]:
        assert facts("info", path, "--select", given)["faces"] == faces
    assert "--select id: need a number, got 'two'" in fail("info", path, "--select", "id=two")
    assert "need true or false" in fail("info", path, "--select", "odd=yes")


def test_looks_of_pictures(tmp_path, monkeypatch):
    path, given = tmp_path / "cube.obj", []
    ls.write(path, ls.Mesh(*zoo.cube()))
    monkeypatch.setattr("limitsurf.plot", lambda *_, **options: given.append(options))
    looks = ("axes", "scale_bar", "dark")
    for flags in ((), ("--axes", "--dark"), ("--scale-bar",)):
        run("plot", path, "-o", tmp_path / "a.png", *flags)
    found = [{name for name in looks if options.get(name)} for options in given]
    assert found == [set(), {"axes", "dark"}, {"scale_bar"}]
