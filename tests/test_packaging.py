"""What is installed: a source distribution, a wheel made of it, and that where nothing else is."""

import json
import os
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def run(*command, **options):
    done = subprocess.run(
        list(map(str, command)), capture_output=True, text=True, timeout=300, **options
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Made of the source distribution, without a network: hatchling is there."""
    folder = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", folder, cwd=ROOT)
    (source,) = folder.glob("*.tar.gz")
    with tarfile.open(source) as archive:
        archive.extractall(folder, filter="data")
    run(
        *(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder),
        cwd=folder / source.name.removesuffix(".tar.gz"),
    )
    (found,) = folder.glob("*.whl")
    return found


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
    """Dependencies are those of this environment; its other packages' .pth files do not count."""
    run(sys.executable, "-m", "venv", "--without-pip", tmp_path / "env")
    (library,) = (tmp_path / "env").glob("**/site-packages")
    (library / "dependencies.pth").write_text(
        "\n".join(path for path in sys.path if path.endswith("site-packages"))
    )
    python = min((tmp_path / "env").glob("*/python*"))  # bin/python, or Scripts/python.exe
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(library)  # all that installing a pure wheel does, but for the script
    code = "import limitsurf; print(limitsurf.__file__)"
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    where = run(python, "-c", code, cwd=tmp_path, env=environment)
    assert Path(where.strip()).is_relative_to(library)
    cage = ROOT / "notebooks" / "site" / "cage.obj"
    command = (python, "-m", "limitsurf", "info", cage, "--json")
    facts = json.loads(run(*command, cwd=tmp_path, env=environment))
    assert facts["faces"] == 18


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
