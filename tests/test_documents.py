"""Every code block of the README and of the site's pages is run, page by page, in its order.

Python blocks with prompts are doctests, others are run as they are; a page has one namespace. Shell
blocks are run line by line in a temporary folder with the cage of the site, and those that install
something are checked for their form. Cells of notebooks are run where the site is built.
"""

import doctest
import os
import re
import shlex
import shutil
import subprocess
import sysconfig
from pathlib import Path

import pytest

import limitsurf

ROOT = Path(__file__).resolve().parents[1]
SITE = ROOT / "notebooks" / "site"
PAGES = [
    ROOT / "README.md",
    *sorted(path for path in SITE.rglob("*.md") if "_copied" not in path.parts),
]
BLOCK = re.compile(r"^(`{3,}) *(\S*)[^\n]*\n(.*?)^\1 *$", re.MULTILINE | re.DOTALL)
RUN = {"python", "sh", "console"}
# Languages that are not code, and directives of the site.
SHOWN = {"", "text", "bibtex"}
INSTALL = re.compile(
    r'(python3 -m venv \.venv && )?\.venv/bin/pip install -q( -e)? "\.\[\w+(,\w+)*\]"'
    r"( && \.venv/bin/(limitsurf \w+|python -m (pytest|sphinx -W -q notebooks/site build/site)))?"
)
ACTIVATE = re.compile(r"source \.venv/bin/activate")
BENCHMARK = re.compile(r"\.venv/bin/(pip install -q [\w-]+|python (tests/bench/\w+\.py) .*)")
DOCUMENT = re.compile(
    r'\.venv/bin/pip install -q -e "\.\[docs\]" && '
    r"\.venv/bin/python -m sphinx -W -q notebooks/site build/site"
)
CHECKED = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
# The folder of an image: here it is the suite's cache, where others need what is compiled as well.
IMAGE = "/opt/limitsurf-cache"
COMPILING = SITE / "howto" / "deployment.md"
LONG = {COMPILING, SITE / "howto" / "command_line.md"}


def blocks(page):
    """Language, text and line of each fenced block of a page."""
    text = page.read_text(encoding="utf-8")
    for match in BLOCK.finditer(text):
        yield match[2], match[3], text.count("\n", 0, match.start()) + 1


def run_shell(text, where):
    """Commands of a block, one after the other; what a console shows after them is compared."""
    scripts = sysconfig.get_path("scripts")
    environment = os.environ | {
        "PATH": os.pathsep.join([scripts, os.environ["PATH"]]),
        "NO_COLOR": "1",
        "COLUMNS": "100",
        "PYTHONIOENCODING": "utf-8",
    }
    console = text.startswith("$ ")
    commands = re.split(r"^\$ ", text, flags=re.MULTILINE)[1:] if console else [text]
    for command in commands:
        command, expected = command.replace(IMAGE, os.environ["LIMITSURF_CACHE_DIR"]), ""
        if console:
            command, _, expected = command.partition("\n")
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", command],
            cwd=where,
            env=environment,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            timeout=600,
        )
        assert done.returncode == 0, f"{command}\nended with {done.returncode}:\n{done.stdout}"
        if expected:
            same = doctest.OutputChecker().check_output(expected, done.stdout, CHECKED)
            assert same, f"{command}\nprinted:\n{done.stdout}\nexpected:\n{expected}"


def check_form(text):
    """Whether all commands of a block install something, or measure with a program in the clone."""
    for command in filter(None, text.splitlines()):
        if not any(form.fullmatch(command) for form in (INSTALL, ACTIVATE, BENCHMARK, DOCUMENT)):
            return False
        for name in shlex.split(command):
            if name.startswith("tests/"):
                assert (ROOT / name).exists(), name
    return True


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=[pytest.mark.long] * (page in LONG)) for page in PAGES],
    ids=lambda page: str(page.relative_to(ROOT)),
)
def test_every_block_runs(page, tmp_path, monkeypatch, capsys):
    for name in ("cage.obj", "box.msh", "blender.usda", "blender.obj", "blender.glb"):
        shutil.copy(SITE / name, tmp_path)
    monkeypatch.chdir(tmp_path)
    parser, runner = doctest.DocTestParser(), doctest.DocTestRunner(optionflags=CHECKED)
    names = {"__name__": "__main__"}
    for language, text, line in blocks(page):
        where = f"{page.name}, line {line}"
        if language == "python" and ">>>" in text:
            test = parser.get_doctest(text, names, where, str(page), line)
            runner.run(test, clear_globs=False)
            names = test.globs
            assert not runner.summarize(verbose=False).failed, capsys.readouterr().out
        elif language == "python":
            exec(compile(text, where, "exec"), names)
        elif language in RUN:
            if not check_form(text):
                run_shell(text, tmp_path)
        else:
            assert language in SHOWN or language.startswith("{"), f"{where}: {language}"


def test_pages_were_found():
    assert len(PAGES) > 10
    assert sum(language in RUN for page in PAGES for language, _, _ in blocks(page)) > 30
    assert IMAGE in COMPILING.read_text("utf-8")
    assert {*PAGES} >= LONG


def test_the_reference_has_every_public_name():
    listed = re.findall(r"^   (\w+)$", (SITE / "api.md").read_text("utf-8"), re.MULTILINE)
    assert sorted(listed) == sorted(limitsurf.__all__)
