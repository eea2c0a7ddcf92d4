"""The measurements run, and say what they should; they are timed elsewhere."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from limitsurf.scheme import SCHEMES

BENCH = Path(__file__).parent / "bench"


def run(script: str, words: str) -> str:
    command = [sys.executable, BENCH / script, *words.split()]
    said: str = subprocess.check_output(command, text=True, timeout=600)
    return said


SMALL = "--queries 100 --samples 10 --grid-faces 2 --levels 1 --runs 1 --no-first-use"


@pytest.mark.long
def test_every_job_runs_and_is_reported(tmp_path: Path) -> None:
    printed = run("bench.py", f"16 loop:8 pole:5 prism:7 {SMALL}")
    figures = json.loads(printed)
    assert {"processor", "cores", "python", "numpy", "numba"} <= figures["machine"].keys()
    torus, loop, pole, prism = figures["cages"]
    assert [cage["faces"] for cage in figures["cages"]] == [260, 128, 15, 9]
    assert torus["irregular limit faces"] == 13
    assert [cage["scheme"] for cage in (torus, loop, pole)] == [
        "catmull-clark",
        "loop",
        "catmull-clark",
    ]
    assert pole["irregular limit faces"] == 15
    assert prism["irregular limit faces"] == 21
    assert {"per face", "peak of all jobs"} <= torus["bytes of memory"].keys()
    jobs = {(row["job"], row["order"]) for row in torus["rows"]}
    kinds = ("random", "sorted", "irregular random", "irregular sorted")
    assert {(kind, order) for kind in kinds for order in ("P", "+d1", "+d2")} <= jobs
    after = ("", " with uv", ", operator", ", points", ", limit points")
    single = {"set-up", "new points", "set-up with uv", *(f"refined L1{name}" for name in after)}
    assert {(job, "") for job in (*single, "tangents", "curvature")} <= jobs
    calls = ("one query in a call", "1,000 in a call")
    assert {(job, order) for job in calls for order in ("P", "+d1", "normal")} <= jobs
    assert {("grid 8 x 8", "normal"), ("random, workers=2", "+d1"), ("uv, random", "+d1")} <= jobs
    assert {("u = v = 0.3", "+d1"), ("u = v = 1e-300", "+d1")} <= jobs
    for row in (row for cage in figures["cages"] for row in cage["rows"]):
        assert 0 < row["ns"] <= row["median"]
    found = tmp_path / "bench.json"
    found.write_text(printed)
    table = run("report.py", str(found))
    assert "16: 260 faces" in table
    assert figures["machine"]["processor"] in table


def test_schemes_are_compared() -> None:
    times = json.loads(run("beside.py", "16 --runs 1 --queries 100"))["times"]
    kinds = ("random", "irregular", "regular", "u = 0.3", "u = 1e-300")
    schemes = ("catmull-clark", "loop", "doo-sabin")
    assert {f"{scheme}: {kind}" for scheme in schemes for kind in kinds} < times.keys()
    assert min(times.values()) > 0


def test_jobs_can_be_chosen() -> None:
    words = f"8 {SMALL} --only set-up --only random"
    (cage,) = json.loads(run("bench.py", words))["cages"]
    names = {row["job"].split(",")[0] for row in cage["rows"]}
    assert names == {"set-up", "set-up with uv", "random"}


def test_losses_are_shown_and_the_lower_ratio_is_told(tmp_path: Path) -> None:
    times = {"random": (10.0, 20.0), "sorted": (10.0, 5.0)}
    files = []
    for number, factor in enumerate((1, 2)):
        rows: list[dict[str, Any]] = [
            {"job": job, "order": "P", "per": "query", "ns": factor * ours, "median": factor * ours}
            | {"opensubdiv": {"a": {"ns": theirs, "median": theirs}, "b": {"ns": 99, "median": 99}}}
            for job, (ours, theirs) in times.items()
        ]
        cage = {"cage": "310", "scheme": "catmull-clark", "faces": 7, "rows": rows}
        figures = {
            "machine": dict.fromkeys(
                ["processor", "cores", "python", "numpy", "numba", "date"], "x"
            ),
            "cages": [cage | {"bytes of memory": {"per face": 1.0}}],
        }
        figures["machine"]["load"] = 0.0
        files.append(tmp_path / f"{number}.json")
        files[-1].write_text(json.dumps(figures))
    table = run("report.py", " ".join(map(str, files)))
    assert "| random: positions | 1.0 to 2.0 (10 ns : 20 ns) |" in table
    assert "| sorted: positions | **0.25 to 0.5** (10 ns : 5 ns) |" in table
    assert "limitsurf is ahead in 0 and OpenSubdiv in 1" in table


@pytest.mark.parametrize("page", ["README.md", "notebooks/site/speed.md"])
def test_pages_have_room_for_what_is_made(page: str) -> None:
    text = (BENCH.parents[1] / page).read_text("utf-8")
    marks = "<!-- made by tests/bench/report.py -->", "<!-- end of what is made -->"
    assert [text.count(mark) for mark in marks] == [1, 1]
    assert marks[0] in (BENCH / "report.py").read_text("utf-8")


@pytest.mark.long
def test_errors_are_measured(tmp_path: Path) -> None:
    printed = run("accuracy.py", "--samples 1")
    figures = json.loads(printed)
    # of every one that is registered there are figures, if it has special corners
    for scheme in (name for name, scheme in SCHEMES.with_pieces.items() if not scheme.local):
        valences = {row["valence"] for row in figures["rows"] if row["scheme"] == scheme}
        assert valences >= {3, 4, 5}, scheme
    for row in figures["rows"]:
        errors = [x for x in row.values() if isinstance(x, float)]
        assert len(errors) == 5
        assert max(errors) < 1e-12
    found = tmp_path / "accuracy.json"
    found.write_text(printed)
    table = run("accuracy.py", f"--table --known {found}").splitlines()
    assert len(table) == 2 + len(figures["rows"])


def test_latency_is_measured() -> None:
    figures = json.loads(run("latency.py", "--runs 1 --most 10"))
    assert figures["rows"].keys() == {"compiled", "reference", "SciPy"}
    for engine in ("compiled", "reference"):
        rows = {(name, asked): time for name, asked, time in figures["rows"][engine]}
        for name in ("evaluate", "jet", "normal"):
            assert rows[name, "1, special"] > 0
            assert rows[name, "10, out="] > 0


def test_queries_are_measured() -> None:
    cage = Path(__file__).parents[1] / "notebooks" / "site" / "cage.obj"
    rows = json.loads(run("queries.py", f"{cage} --queries 40 --peer libigl"))
    own = {row["job"]: row["us"] for row in rows if row["by"] == "limitsurf"}
    assert own.keys() == {"on", "near", "box", "first hit"}
    assert min(own.values()) > 0
    for row in rows:
        assert row.get("off", 0) < 0.02


def test_interpolation_is_measured() -> None:
    (small, large) = json.loads(run("interpolation.py", "40 200 --refined 50"))
    assert small["vertices"] == 40
    for row in (small, large):
        assert row["residual"] < 1e-14
        assert row["condition"] < 10
        assert min(row[name] for name in ("interpolate", "fairness", "fair")) > 0
    assert "refined" in small
    assert "refined" not in large


def test_fits_are_compared() -> None:
    found = json.loads(run("fits.py", "--points 500 --grid 12"))
    # of a torus that slides within itself, from fewer points than its vertices have coordinates
    history = found["known cage"]["rms of the size"]
    assert history[-1] < 1e-4 * history[0]
    assert {"limitsurf", "FITPACK"} <= {row["who"] for row in found["curve"]}
    assert found["patch"][0]["rms"] < 0.01


@pytest.mark.long
def test_spline_faces_are_measured(tmp_path: Path) -> None:
    cage = tmp_path / "cube.obj"
    corners = "".join(f"v {x} {y} {z}\n" for x in (0, 1) for y in (0, 1) for z in (0, 1))
    cage.write_text(corners + "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n")
    found = json.loads(run("splines.py", f"{cage} --depth 4 --runs 1 --places 5 --count 100"))
    assert [one["faces"] for one in found["ours"]] == [6, 6]
    assert isinstance(found["opencascade"], str) or found["opencascade"]["faces"] == 6
