"""What is installed: a source distribution, a wheel made of it, and that where nothing else is."""

import json
import os
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from contextlib import chdir
from pathlib import Path

import pytest
from hatchling.build import build_sdist, build_wheel
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Made of the source distribution, without a network: hatchling is there."""
    folder = tmp_path_factory.mktemp("dist")
    with chdir(ROOT):
        source = build_sdist(str(folder))
    with tarfile.open(folder / source) as archive:
        archive.extractall(folder, filter="data")
    with chdir(folder / source.removesuffix(".tar.gz")):
        return folder / build_wheel(str(folder))


def test_the_wheel_holds_the_package_and_no_more(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    package = ROOT / "src" / "limitsurf"
    own = {
        path.relative_to(ROOT / "src").as_posix()
        for path in package.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    others = {name for name in names if ".dist-info/" in name}
    assert names - others == own
    assert "limitsurf/py.typed" in own
    assert any(name.startswith("limitsurf/_data/") for name in own)
    assert any(name.endswith("/licenses/LICENSE") for name in others)


def test_it_runs_where_nothing_else_of_it_is(wheel, tmp_path):
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path)  # all that installing a pure wheel does, but for the script
    cage = ROOT / "notebooks" / "site" / "cage.obj"
    code = f"""
import limitsurf, sys, runpy
print(limitsurf.__file__)
sys.argv = ["limitsurf", "info", {str(cage)!r}, "--json"]
runpy.run_module("limitsurf", run_name="__main__")
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    where, facts = done.stdout.split("\n", 1)
    assert Path(where).is_relative_to(tmp_path)
    assert json.loads(facts)["faces"] == 18


def test_extras_name_what_they_need():
    extras = PROJECT["optional-dependencies"]
    named = {name for name in extras if name not in ("docs", "test")}
    (everything,) = extras["all"]
    assert Requirement(everything).extras == named - {"all"}
    bounds = [Requirement(text) for group in extras.values() for text in group]
    for requirement in [*bounds, *map(Requirement, PROJECT["dependencies"])]:
        assert requirement.name == "limitsurf" or ">=" in str(requirement.specifier)


def test_pythons_that_are_named_begin_with_the_lowest():
    before = "Programming Language :: Python :: 3."
    named = [
        int(text.removeprefix(before)) for text in PROJECT["classifiers"] if text.startswith(before)
    ]
    assert named == list(range(11, 11 + len(named)))
    assert PROJECT["requires-python"] == ">=3.11"
