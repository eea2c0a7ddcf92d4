"""The project keeps its own rules: style, types, rooms, documents, packaging."""

import ast
import inspect
import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

import limitsurf

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "src" / "limitsurf"
MODULES = sorted(SOURCE.rglob("*.py"))
DERIVATIONS = sorted((ROOT / "derivations").glob("*.py"))
LINT_IMPORTS = Path(sysconfig.get_path("scripts")) / "lint-imports"

# what users get wrong, and mypy says
WRONG = {
    "surface.evaluate(0, 0.5, 0.5, (1, 0))": 'No overload variant of "evaluate"',
    "ls.LimitSurface(mesh, boundary='corner')": "incompatible type \"Literal['corner']\"",
    "ls.refined(mesh, operator=True).points": 'has no attribute "points"',
}


def by_name(path: Path) -> str:
    return str(path.relative_to(ROOT))


def run(*command: str | Path) -> str:
    """Run a command at the root of the project; what it printed, and a failed test if it fails."""
    done = subprocess.run(
        command,
        cwd=ROOT,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env=os.environ | {"NO_COLOR": "1", "PYTHONIOENCODING": "utf-8"},
    )
    assert done.returncode == 0, f"{done.args} ended with {done.returncode}:\n{done.stdout}"
    return done.stdout


@pytest.mark.parametrize(
    "command",
    [
        pytest.param([sys.executable, "-m", "ruff", "check"], id="ruff-check"),
        pytest.param([sys.executable, "-m", "ruff", "format", "--check"], id="ruff-format"),
        pytest.param([sys.executable, "-m", "mypy"], id="mypy-strict", marks=pytest.mark.long),
        pytest.param([LINT_IMPORTS, "--no-cache"], id="import-contract"),
    ],
)
def test_style_types_and_rooms(command: list[str | Path]) -> None:
    run(*command)


@pytest.mark.long
def test_types_are_what_a_user_is_told(tmp_path: Path) -> None:
    """The installed package, as `py.typed` has it, seen by a script that knows no more."""
    script = ROOT / "tests" / "users_script.py"
    run(sys.executable, "-W", "error", script)
    (tmp_path / "mypy.ini").write_text("[mypy]\n")
    wrong = tmp_path / "wrong.py"
    wrong.write_text("\n".join([script.read_text(encoding="utf-8"), *WRONG]), encoding="utf-8")
    options = ["--config-file", tmp_path / "mypy.ini", "--cache-dir", ROOT / ".mypy_cache" / "user"]
    command = [sys.executable, "-m", "mypy", "--strict", "--hide-error-context", *options]
    said = subprocess.run([*command, script, wrong], cwd=tmp_path, text=True, capture_output=True)
    errors = [line for line in said.stdout.splitlines() if ": error: " in line]
    assert len(errors) == len(WRONG), said.stdout
    for error, expected in zip(errors, WRONG.values(), strict=True):
        assert error.startswith("wrong.py:")
        assert expected in error


@pytest.mark.long
@pytest.mark.parametrize("path", DERIVATIONS, ids=by_name)
def test_derivation_holds(path: Path) -> None:
    run(sys.executable, "-W", "error", ROOT / "tests" / "run_derivation.py", path)


def test_documents_were_found() -> None:
    assert DERIVATIONS


def test_import_is_light() -> None:
    heavy = {"click", "mpmath", "numba", "pyvista", "rich", "scipy", "sympy", "trimesh"}
    loaded = run(sys.executable, "-c", "import limitsurf, sys; print(*sys.modules)").split()
    assert "limitsurf" in loaded
    assert not heavy.intersection(loaded)


@pytest.mark.parametrize("path", MODULES, ids=by_name)
def test_module_says_what_it_is(path: Path) -> None:
    assert ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize("name", limitsurf.__all__)
def test_export_is_documented_with_an_example(name: str) -> None:
    assert name in dir(limitsurf)
    documentation = getattr(limitsurf, name).__doc__
    assert documentation
    assert ">>>" in documentation  # the doctests of src run it


@pytest.mark.parametrize("name", ["evaluate", "jet", "tangents", "normal", "curvature", "weights"])
def test_queries_are_called_alike(name: str) -> None:
    parameters = inspect.signature(getattr(limitsurf.LimitSurface, name)).parameters
    named = {x.name for x in parameters.values() if x.kind is x.KEYWORD_ONLY}
    assert [*parameters][:4] == ["self", "face", "u", "v"]
    assert named == {*parameters} - {"self", "face", "u", "v"} >= {"channel", "workers"}


ASKING = [
    name for name in limitsurf.__all__
    if inspect.isfunction(getattr(limitsurf, name))
    and next(iter(inspect.signature(getattr(limitsurf, name)).parameters), "").startswith("surface")
]  # fmt: skip
# two ask no query, two take channels beside the points, one is of points alone
CALLED = {
    "agrees": {"channel"},
    "approximate": {"workers"},
    "levels_of_detail": {"channels", "workers"},
    "quadrature": {"channel"},
    "tessellate": {"channels", "workers"},
}


@pytest.mark.parametrize("name", ASKING)
def test_functions_of_surfaces_are_called_like_queries(name: str) -> None:
    parameters = inspect.signature(getattr(limitsurf, name)).parameters.values()
    named = {x.name for x in parameters if x.kind is x.KEYWORD_ONLY}
    assert named >= CALLED.get(name, {"channel", "workers"})


def test_functions_of_surfaces_were_found() -> None:
    assert {*CALLED, "bezier_patches", "plot", "refinement_gap", "validate"} <= {*ASKING}


def test_unknown_export_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = limitsurf.no_such_name
