"""The measurements run, and say what they should; they are timed elsewhere."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from limitsurf.scheme import SCHEMES

BENCH = Path(__file__).parent / "bench"


def run(script: str, words: str) -> str:
    command = [sys.executable, BENCH / script, *words.split()]
    said: str = subprocess.check_output(command, text=True, timeout=600)
    return said


@pytest.mark.long
def test_every_job_runs_and_is_reported(tmp_path: Path) -> None:
    small = "--queries 100 --samples 10 --grid-faces 2 --levels 1 --runs 1"
    printed = run("bench.py", f"16 {small}")
    figures = json.loads(printed)
    assert {"processor", "cores", "python", "numpy", "numba"} <= figures["machine"].keys()
    assert figures["cold start, seconds"].keys() == {"from import", "whole process"}
    (cage,) = figures["cages"]
    assert cage["faces"] == 260
    assert cage["irregular limit faces"] == 13
    assert {"per face", "peak of all jobs"} <= cage["bytes of memory"].keys()
    jobs = {(row["job"], row["order"]) for row in cage["rows"]}
    kinds = ("random", "sorted", "irregular random", "irregular sorted")
    assert {(kind, order) for kind in kinds for order in ("P", "+d1", "+d2")} <= jobs
    single = {"set-up", "new points", "refined L1", "refined L1, operator", "refined L1, points"}
    assert {(job, "") for job in single} <= jobs
    assert {("grid 8 x 8", "normal"), ("random, workers=2", "+d1")} <= jobs
    assert {("u = v = 0.3", "+d1"), ("u = v = 1e-300", "+d1")} <= jobs
    for row in cage["rows"]:
        assert row["ns"] > 0
        assert row.get("numpy_ns", 1) > 0
    found = tmp_path / "bench.json"
    found.write_text(printed)
    table = run("report.py", str(found))
    assert "16: 260 faces" in table
    assert "| random queries: positions | - (" in table
    assert figures["machine"]["processor"] in table


def test_jobs_can_be_chosen() -> None:
    words = "8 --queries 100 --only set-up --only random --no-numpy --runs 1"
    (cage,) = json.loads(run("bench.py", words))["cages"]
    names = {row["job"] for row in cage["rows"]}
    assert names == {"set-up", "random", "random, workers=1", "random, workers=2"}
    assert not any("numpy_ns" in row for row in cage["rows"])


def test_errors_are_measured() -> None:
    figures = json.loads(run("accuracy.py", "--samples 1"))
    for scheme in SCHEMES:  # of every one that is registered there are figures
        valences = {row["valence"] for row in figures["rows"] if row["scheme"] == scheme}
        assert valences >= {3, 4, 5}, scheme
    for row in figures["rows"]:
        errors = [x for x in row.values() if isinstance(x, float)]
        assert len(errors) == 5
        assert max(errors) < 1e-12
    table = run("accuracy.py", "--samples 1 --table").splitlines()
    assert len(table) == 2 + len(figures["rows"])


def test_latency_is_measured() -> None:
    figures = json.loads(run("latency.py", "--runs 1 --most 10"))
    assert figures["rows"].keys() == {"compiled", "reference", "SciPy"}
    for engine in ("compiled", "reference"):
        rows = {(name, asked): time for name, asked, time in figures["rows"][engine]}
        for name in ("evaluate", "jet", "normal"):
            assert rows[name, "1, special"] > 0
            assert rows[name, "10, out="] > 0
