"""Schemes of users in commands: of modules and of files, and what is wrong with them."""

import json
import sys
from importlib import import_module

import numpy as np
import pytest
import zoo
from command_line import facts, fail, run, succeed

import limitsurf as ls

FILE = """
from dataclasses import dataclass
from fractions import Fraction as F
import limitsurf as ls
from kept_beside_mine import HALF

print("is run")

@dataclass
class Kept:
    weight: F

    def __call__(self, N):
        return self.weight, (1 - self.weight) / (2 * N), (1 - self.weight) / (2 * N)

calm = ls.Scheme("calm", vertex=Kept(HALF))
corners = ls.DualScheme("corners", corner={5: (F(1, 2), F(1, 5), F(1, 20), F(1, 20), F(1, 5))})
wild = ls.Scheme("wild", vertex=lambda N: (F(1, 2), F(1, 16), F(1, 16)) if N == 4
    else (F(-9), F(5, N), F(5, N)))
class schemes:
    inner = calm
number = 3
"""


@pytest.fixture
def here(tmp_path, monkeypatch):
    (tmp_path / "mine.py").write_text(FILE)
    (tmp_path / "kept_beside_mine.py").write_text(
        "from fractions import Fraction\nHALF = Fraction(1, 2)\n"
    )
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    for name in ("mine", "kept_beside_mine"):
        sys.modules.pop(name, None)


@pytest.fixture
def calm(here, monkeypatch):
    monkeypatch.syspath_prepend(str(here))
    return import_module("mine").calm


@pytest.mark.parametrize("home", ["mine.py", "./mine.py", "mine"])
def test_schemes_of_files_and_modules(home, here, calm, capsys):
    sys.modules.pop("mine")
    path = list(sys.path)
    result = run("spectrum", "--scheme", f"{home}:calm", "--valence", "5,6", "--json")
    assert result.exit_code == 0, result.output
    assert result.stderr == "is run\n"  # nor does it spoil the JSON
    assert sys.path == path
    assert not [name for name in sys.modules if name.startswith("limitsurf_scheme_of")]
    rows = json.loads(result.stdout)["rows"]
    for row, n in zip(rows, (5, 6), strict=True):
        found = ls.spectral_analysis(calm, valence=n)
        assert row["scheme"] == "calm"
        assert row["subdominant"] == list(found.subdominant)
        assert row["curvature"]["rate"] == found.curvature.rate


def test_every_command_takes_them(here, calm):
    cage = here / "cage.obj"
    ls.write(cage, ls.Mesh(*zoo.cube()))
    own = "--scheme", "mine:calm"  # imported already: prints no more
    assert facts("basis", *own, "--valence", 5)["scheme"] == "calm"
    assert facts("info", cage, *own)["rules"]["scheme"]["value"] == "calm"
    surface = ls.LimitSurface(ls.read(cage), scheme=calm)
    told = json.loads(succeed("evaluate", cage, *own, "--grid", 1, "--json").splitlines()[0])
    place = told["face"], told["u"], told["v"]
    # digits depend on how many queries there are, by an ulp or two
    assert abs(np.array(told["position"]) - surface.evaluate(*place)).max() < 1e-15
    for command in ("refine", "tessellate"):
        told = run(command, cage, *own, "-o", here / f"{command}.obj")
        assert told.exit_code == 0, told.output
        # refined cages have the scheme, which no file holds
        assert ("left out: scheme 'calm'" in told.stderr) == (command == "refine")
    fine = ls.read(here / "refine.obj")
    assert abs(fine.points - ls.refined(ls.read(cage), 1, scheme=calm).points).max() < 1e-15
    succeed("validate", cage, *own)
    assert succeed("spectrum", "--scheme", "mine:corners", "--scheme", "loop", "--valence", 5)


@pytest.mark.parametrize(
    ("given", "parts"),
    [
        ("mine.py", ["say which scheme", "mine.py:NAME"]),
        ("mine.py:", ["need a name"]),
        (":calm", ["need a name"]),
        ("none.py:calm", ["there is no file none.py"]),
        ("mine:calm", ["no module 'mine'", "mine.py:NAME"]),
        ("no.such.module:calm", ["no module 'no'"]),
        ("my scheme:calm", ["neither a module nor a file"]),
        ("mine.txt/x:calm", ["neither a module nor a file"]),
        ("raises.py:calm", ["raises.py, line 2, raised ZeroDivisionError"]),
        ("leaves.py:calm", ["raised SystemExit: 3"]),
        ("broken.py:calm", ["raised SyntaxError"]),
        ("needs.py:calm", ["raised ModuleNotFoundError", "nowhere_at_all"]),
        ("refused.py:calm", ["line 3, raised ValueError", "'loop'"]),
        ("quiet.py:calm", ["has no 'calm'", "one, other"]),
        ("quiet.py:number", ["of type int", "ls.Scheme", "one, other"]),
        ("quiet.py:function", ["of type function", "ls.Scheme"]),
    ],
)
def test_what_is_wrong_is_said(given, parts, here):
    files = {
        "raises": "x = 1\nx / 0\n",
        "leaves": "import sys\nsys.exit(3)\n",
        "broken": "def\n",
        "needs": "import nowhere_at_all\n",
        "refused": "import limitsurf as ls\n\nls.Scheme('loop', vertex={5: 1})",
        "quiet": "import limitsurf as ls\none = ls.Scheme('one', spline='bilinear')\nother = one\n"
        "number = 3\ndef function(): return one\n",
    }
    for name, text in files.items():
        (here / f"{name}.py").write_text(text)
    told = fail("spectrum", "--scheme", given, "--valence", 5)
    assert "--scheme" in told
    for part in parts:
        assert part in told, told


def test_nothing_is_run_but_what_a_colon_names(here):
    for name in ("calm", "mine", "loup"):
        (here / f"{name}.py").write_text("raise SystemExit('was run')\n")
        assert f"'{name}'" in fail("spectrum", "--scheme", name)
    cage = here / "cage.obj"
    # nor what a cage says
    ls.write(cage, ls.Mesh(*zoo.cube(), scheme="loup"))
    cage.write_text(cage.read_text().replace("loup", "mine.py:calm"))
    told = run("evaluate", cage, "--grid", 1)
    assert told.exit_code == 2
    assert "unknown scheme 'mine.py:calm'" in told.output


def test_masks_without_a_limit_are_refused_as_in_python(here):
    told = run("spectrum", "--scheme", "mine.py:wild", "--valence", 5)
    assert told.exit_code == 2
    assert "scheme 'wild'" in told.stderr
    assert "valence 5" in told.stderr


@pytest.mark.parametrize("suffix", [".obj", ".ply"])
def test_files_leave_out_what_has_no_name(suffix, here, calm):
    mesh = ls.Mesh(*zoo.cube(), scheme=calm)
    with pytest.warns(UserWarning, match="left out: scheme 'calm', which is your own") as told:
        ls.write(here / f"cage{suffix}", mesh)
    assert len(told) == 1
    again = ls.read(here / f"cage{suffix}")
    assert again.scheme is None
    assert np.array_equal(again.points, mesh.points)


def test_values_of_the_library_have_names_in_files(here):
    cage = here / "cage.obj"
    ls.write(cage, ls.Mesh(*zoo.tetrahedron(), scheme=ls.schemes["loop"]))
    assert ls.read(cage).scheme == "loop"
