"""The command line given bad input: one clear line, the right exit code, no half files."""

import ctypes
import errno
import io
import json
import os
import pty
import random
import shlex
import shutil
import signal
import subprocess
import sys
import threading
import time
import zipfile
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as arrow
import pytest
import zoo
from command_line import PROGRAM, facts, fail, in_one_process, run, succeed
from pyarrow import parquet

import limitsurf as ls
from limitsurf import __main__
from limitsurf.shell import files
from limitsurf.shell.cli.commands import main
from limitsurf.shell.cli.program import ERRORS
from limitsurf.shell.io import answers, formats, queries

# every command that takes a cage, and what it writes; CAGE and OUT are put in their places
READING = {
    "info": ["info", "CAGE"],
    "evaluate": ["evaluate", "CAGE", "--grid", "2", "-o", "OUT.npy"],
    "tessellate": ["tessellate", "CAGE", "-n", "2", "-o", "OUT.ply"],
    "refine": ["refine", "CAGE", "-o", "OUT.obj"],
    "validate": ["validate", "CAGE", "--levels", "1"],
    "plot": ["plot", "CAGE", "-o", "OUT.png", "--size", "60", "40", "-n", "2"],
    "convert": ["convert", "CAGE", "OUT.obj"],
}
WRITING = [name for name, words in READING.items() if any("OUT" in word for word in words)]
# commands that say something on the standard output
SAYING = {
    "help": ["--help"],
    "info": ["info", "CAGE"],
    "info json": ["info", "CAGE", "--json"],
    "evaluate": ["evaluate", "CAGE", "--random", "5000"],
    "evaluate json": ["evaluate", "CAGE", "--random", "5000", "--json"],
    "tessellate": ["tessellate", "CAGE", "-n", "20"],
    "tessellate ply": ["tessellate", "CAGE", "-n", "20", "--to", "ply"],
    "refine": ["refine", "CAGE", "--levels", "4"],
    "validate": ["validate", "CAGE", "--levels", "1"],
    "basis": ["basis", "--valence", "5"],
    "spectrum": ["spectrum", "--valence", "3-5"],
    "convert": ["convert", "CAGE", "-"],
    "completion": ["completion", "fish"],
}


def filled(words, cage, out="out"):
    return [word.replace("CAGE", str(cage)).replace("OUT", str(out)) for word in words]


@pytest.fixture
def cage(tmp_path):
    path = tmp_path / "prism.obj"
    ls.write(path, ls.Mesh(*zoo.prism(5)))
    return path


@pytest.fixture
def untouched(tmp_path):
    """A directory in which nothing may change."""
    folder = tmp_path / "out"
    folder.mkdir()
    yield folder
    assert list(folder.iterdir()) == []


# ------------------------------------------------------------------ cages that are none

BAD = {
    "none.obj": (None, "No such file"),
    "empty.obj": (b"", "need at least one vertex"),
    "blank.obj": (b"\n\n# nothing\n", "need at least one vertex"),
    "noise.obj": (bytes(range(256)) * 20, "line 1"),
    "range.obj": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "line 4"),
    "nan.obj": (b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "line 1"),
    "empty.usda": (b"", ""),
    "noise.usda": (bytes(range(256)) * 20, ""),
    "cut.usda": (b'#usda 1.0\ndef Mesh "cage"\n{\n    int[] faceVertexCounts = [4', ""),
    "noise.usdc": (b"PXR-USDC" + bytes(range(256)) * 20, ""),
    "empty.usdz": (b"", ""),
    "cage.xyzzy": (b"v 0 0 0\n", "'.xyzzy'"),
    "cage": (b"v 0 0 0\n", "unknown suffix ''; name the format with --from"),
    "folder": (Path, "Is a directory"),
    "folder.obj": (Path, "Is a directory"),
    "folder.ply": (Path, "Is a directory"),
    "dangling.obj": (os.symlink, "No such file"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_cages(name, tmp_path, untouched):
    content, expected = BAD[name]
    path = tmp_path / name
    if content is Path:
        path.mkdir()
    elif content is os.symlink:
        path.symlink_to("nowhere.obj")
    elif content is not None:
        path.write_bytes(content)
    for words in READING.values():
        message = fail(*filled(words, path, untouched / "out"))
        assert str(path) in message
        assert expected in message


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """A cage in every format that can be written."""
    folder = tmp_path_factory.mktemp("good")
    for suffix in sorted(formats.WRITABLE):
        ls.write(folder / f"cage{suffix}", ls.Mesh(*zoo.tetrahedron()))
    return folder


@pytest.mark.parametrize("suffix", sorted(formats.READABLE))
def test_bad_files_of_every_format(suffix, good, tmp_path, capfd):
    contents = {"empty": b"", "noise": bytes(range(1, 256)) * 20}
    if suffix in formats.WRITABLE:
        whole = (good / f"cage{suffix}").read_bytes()
        contents |= {"cut": whole[: len(whole) // 2], "head": whole[:7]}
    for name, content in contents.items():
        path = tmp_path / f"{name}{suffix}"
        path.write_bytes(content)
        assert str(path) in fail("info", path)
    assert "none" in fail("info", tmp_path / f"none{suffix}")
    # nor do libraries say anything beside that
    assert capfd.readouterr() == ("", "")


def npy(header, body=b""):
    text = header.encode()
    text += b" " * (64 - (11 + len(text)) % 64) + b"\n"
    return b"\x93NUMPY\x01\0" + len(text).to_bytes(2, "little") + text + body


def whole_queries(suffix):
    """The bytes of three good queries."""
    face, u = np.arange(3), np.linspace(0, 1, 3)
    file = io.BytesIO()
    if suffix == ".npy":
        np.save(file, np.stack([face, u, u], axis=1))
    elif suffix == ".npz":
        np.savez(file, face=face, u=u, v=u)
    elif suffix == ".csv":
        file.write(b"face,u,v\n0,0.5,0.5\n# nothing\n1,0.25,1\n")
    else:
        parquet.write_table(arrow.table({"face": face, "u": u, "v": u}), file)
    return file.getvalue()


@pytest.mark.parametrize(
    "header",
    [
        "{'descr': '<f8', 'fortran_order': False, 'shape': (True, 3)}",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (1, 3)",
        ",{'descr': '<f8', 'fortran_order': False, 'shape': (1, 3)}",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999999999999999, 3)}",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (9999999999, 3)}",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (-1, 3)}",
        "(" * 3000,
    ],
)
@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_headers_of_queries_that_are_none(header, suffix, cage, tmp_path):
    path, data = tmp_path / f"q{suffix}", npy(header, bytes(24))
    path.write_bytes(data)
    if suffix == ".npz":
        with zipfile.ZipFile(path, "w") as archive:
            for name in ("face", "u", "v"):
                archive.writestr(f"{name}.npy", data.replace(b", 3)", b",)"))
    assert str(path) in fail("evaluate", cage, "--queries", path)


@pytest.mark.parametrize("suffix", [".npy", ".npz", ".csv", ".parquet"])
def test_broken_queries_are_errors_of_the_user(suffix, tmp_path):
    whole, path = whole_queries(suffix), tmp_path / f"q{suffix}"
    inserted = [b"9" * 30, b"(", b"{", b"True", b"\xff" * 8, b"\0" * 8, b",,", b"1e400", b"'"]
    for seed in range(300):
        chance, data = random.Random(seed), bytearray(whole)
        at = chance.randrange(len(data))
        if seed % 3 == 0:
            del data[at:]
        elif seed % 3 == 1:
            for _ in range(chance.randrange(1, 6)):
                data[chance.randrange(len(data))] = chance.randrange(256)
        else:
            data[at:at] = chance.choice(inserted)
        path.write_bytes(data)
        with suppress(*ERRORS), queries.reading(path) as found:
            for batch in found.batches:
                batch.checked(3)


def test_columns_of_one_name(cage, tmp_path):
    path = tmp_path / "q.csv"
    path.write_text("face,u,v,u\n0,0.5,0.5,0.1\n")
    assert "line 1: there are 2 columns named 'u', need one" in fail(
        "evaluate", cage, "--queries", path
    )


@pytest.mark.parametrize("command", READING)
def test_bad_standard_input(command, untouched):
    words = filled(READING[command], "-", untouched / "out")
    assert "<stdin>: need at least one vertex" in fail(*words, stdin=b"")
    assert "line 1" in fail(*words, stdin=bytes(range(256)))
    fail(*words, "--from", "usda", stdin=b"noise")
    assert "'.xyzzy'" in fail(*words, "--from", "xyzzy", stdin=b"v 0 0 0\n")


def test_cage_and_queries_cannot_share_a_stream():
    assert "both" in fail("evaluate", "-", "--queries", "-", stdin=b"v 0 0 0\n")


@pytest.mark.skipif(os.name != "posix", reason="needs permissions")
@pytest.mark.parametrize("command", READING)
def test_cages_that_may_not_be_read(command, cage, untouched, monkeypatch):
    open_ = io.open

    def refuse(path, *arguments, **options):
        if os.fspath(path) == str(cage) if not isinstance(path, int) else False:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), path)
        return open_(path, *arguments, **options)

    if os.geteuid() == 0:  # who may read everything
        monkeypatch.setattr("builtins.open", refuse)
    cage.chmod(0)
    assert f"{cage}: Permission denied" in fail(*filled(READING[command], cage, untouched / "out"))


def test_names_that_begin_with_a_dash(cage, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cage.rename("-cage.obj")
    assert succeed("info", "./-cage.obj") == succeed("info", "--", "-cage.obj")
    assert "./-cage.obj" in fail("info", "-cage.obj")
    assert succeed("refine", "./-cage.obj", "-o", "-fine.obj").startswith("-fine.obj: ")
    assert os.path.exists("-fine.obj")


@pytest.mark.parametrize("name", ["höhle 柱.obj", "two words.obj", "a'b\"c$d.obj", "new\nline.obj"])
def test_unusual_names(name, cage, tmp_path):
    path = tmp_path / name
    cage.rename(path)
    assert facts("info", path)["cage"] == str(path)
    target = tmp_path / f"out {name}"
    assert facts("refine", path, "-o", target)["output"] == str(target)
    assert ls.read(target).n_faces == 30
    path.write_text("f 1 2 3\n")
    assert " ".join(str(path).split()) in fail("info", path)


# ------------------------------------------------------------------ outputs that cannot be


@pytest.mark.parametrize("command", WRITING)
def test_targets_are_refused_before_any_work(command, cage, tmp_path, monkeypatch):
    def work(*_, **__):
        raise AssertionError("the cage is read all the same")

    words = READING[command]
    (suffix,) = (word.removeprefix("OUT") for word in words if word.startswith("OUT"))
    folder = tmp_path / f"folder{suffix}"
    folder.mkdir()
    monkeypatch.setattr(ls, "read", work)

    assert "No such directory" in fail(*filled(words, cage, tmp_path / "nowhere" / "a"))
    assert "No such directory" in fail(*filled(words, cage, cage / "a"))  # below a file
    message = fail(*filled(words, cage, tmp_path / "folder"))
    assert f"{folder}: Is a directory" in message
    odd = [word.replace(f"OUT{suffix}", str(tmp_path / "a.xyzzy")) for word in words]
    assert "a.xyzzy" in fail(*filled(odd, cage))
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert "No permission to write" in fail(*filled(words, cage, tmp_path / "a"))


def test_answers_go_to_devices_without_permission_beside_them(cage, monkeypatch):
    monkeypatch.setattr(os, "access", lambda *_: False)
    files.check_target(os.devnull)
    with files.replacing(os.devnull) as file:
        file.write(b"gone")


def test_json_and_a_mesh_cannot_share_the_output(cage):
    for words in (["tessellate", cage], ["refine", cage], ["convert", cage, "-"]):
        assert "--json takes the standard output" in fail(*words, "--json")


FULL = """
import contextlib, io, json, os, resource, sys
from limitsurf.shell.cli.commands import main

found = []
before = sorted(os.listdir("."))
for arguments in json.loads(sys.argv[1]):
    with contextlib.redirect_stderr(io.StringIO()) as said:
        resource.setrlimit(resource.RLIMIT_FSIZE, (200, resource.RLIM_INFINITY))
        try:
            main(arguments)
        except SystemExit as end:
            code = end.code
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)
    left = sorted(set(os.listdir(".")) - set(before))
    found.append((arguments, code, said.getvalue(), left))
print(json.dumps(found))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="needs a limit to the size of files")
def test_no_half_files_on_a_full_disk(cage, tmp_path):
    """Files of a limited size fail as a full disk does: in the middle of writing."""
    outputs = [["tessellate", cage, "-o", f"a{suffix}"] for suffix in sorted(formats.WRITABLE)]
    outputs += [["evaluate", cage, "--grid", "9", "-o", f"a{end}"] for end in files.SUFFIXES]
    outputs += [filled(READING[name], cage, "b") for name in ("refine", "plot")]
    outputs += [["convert", cage, "b.obj"], ["refine", cage, "--to", "obj", "-o", "b.txt"]]
    outputs += [["plot", cage, "-o", "b.html"]]
    work = tmp_path / "work"
    work.mkdir()
    done = in_one_process(FULL, outputs, cwd=work)
    problems = []
    for arguments, code, said, left in json.loads(done.stdout):
        name = arguments[arguments.index("-o") + 1] if "-o" in arguments else arguments[-1]
        line = said.startswith("limitsurf: error: ") and said.endswith(": File too large\n")
        if not line or said.count("\n") > 1 or name not in said or (code, left) != (2, []):
            problems.append((arguments, code, said, left))
    assert problems == []


def test_a_disk_that_is_full_in_the_end(cage, tmp_path, untouched, monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "replace", refuse)
    for name in WRITING:
        message = fail(*filled(READING[name], cage, untouched / "a"))
        assert str(untouched / "a") in message
        assert "No space left" in message


# ------------------------------------------------------------------ numbers that cannot be


@pytest.mark.parametrize(
    "words",
    [
        ["tessellate", "CAGE", "-n", "100000000"],
        ["tessellate", "CAGE", "-n", "9" * 18],
        ["refine", "CAGE", "--levels", "40"],
        ["validate", "CAGE", "--levels", "40"],
        ["refine", "CAGE", "--levels", "30"],
        ["plot", "CAGE", "-o", "a.png", "-n", "10000000"],
    ],
)
def test_what_no_memory_holds_is_refused(words, cage):
    assert "GiB" in fail(*filled(words, cage))


@pytest.mark.parametrize(
    "words",
    [
        ["evaluate", "CAGE", "--grid", "9" * 50],
        ["evaluate", "CAGE", "--random", "9" * 50],
        ["evaluate", "CAGE", "--grid", "1", "--order", "1000"],
        ["evaluate", "CAGE", "--grid", str(2**62)],
        ["tessellate", "CAGE", "-n", "0"],
        ["tessellate", "CAGE", "-n", "9" * 500],
        ["plot", "CAGE", "-o", "a.png", "-n", "9" * 500],
        ["tessellate", "CAGE", "-n", "-3"],
        ["tessellate", "CAGE", "-n", "2.5"],
        ["refine", "CAGE", "--levels", "-1"],
        ["refine", "CAGE", "--levels", "1000"],
        ["validate", "CAGE", "--levels", "-1"],
        ["plot", "CAGE", "-o", "a.png", "--size", "100000", "100000"],
        ["plot", "CAGE", "-o", "a.png", "--isolines", "-1"],
        ["plot", "CAGE", "-o", "a.png", "--limits", "1"],
        ["plot", "CAGE", "-o", "a.png", "--scalars", "mean", "--limits", "2", "1"],
        ["plot", "CAGE", "-o", "a.png", "--view", "sideways"],
        ["plot", "CAGE", "-o", "a.png", "--view", "1,2"],
        ["plot", "CAGE", "-o", "a.png", "--view", "1,b,2"],
        ["plot", "CAGE", "-o", "a.png", "--scalars", "mean", "--cmap", "no such"],
        ["basis", "--valence", "-4"],
        ["demo", "--queries", "0"],
        ["demo", "--queries", "-1"],
    ],
)
def test_numbers_out_of_range(words, cage, untouched, monkeypatch):
    monkeypatch.chdir(untouched)
    fail(*filled(words, cage))


# ------------------------------------------------------------------ usage


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["tesselate"], "did you mean tessellate?"),
        (["evalaute", "a.obj"], "did you mean evaluate?"),
        (["INFO", "a.obj"], "did you mean info?"),
        (["cage.obj"], "limitsurf info cage.obj"),
        (["sub/cage.ply", "--grid", "3"], "limitsurf info sub/cage.ply"),
        (["xyzzy"], "limitsurf --help"),
        ([""], "limitsurf --help"),
        (["--loud"], "--loud"),
        (["info"], "CAGE"),
        (["info", "a.obj", "b.obj"], "b.obj"),
        (["info", "a.obj", "--jason"], "--json"),
        (["convert", "a.obj"], "OUT"),
        (["evaluate", "a.obj", "--grid"], "--grid"),
    ],
)
def test_bad_usage_is_one_line_with_a_remedy(words, expected):
    assert expected in fail(*words)


@pytest.mark.parametrize("command", main.commands)
def test_unknown_options_of_every_command(command):
    assert "--no-such-option" in fail(command, "--no-such-option")


# ------------------------------------------------------------------ the end of the process


@pytest.mark.parametrize("stage", ["read", "write"])
@pytest.mark.parametrize("command", READING)
def test_interrupts_leave_nothing(command, stage, cage, untouched, monkeypatch):
    words = filled(READING[command], cage, untouched / "out")
    called = []

    def interrupt(*_, **__):
        called.append(stage)
        raise KeyboardInterrupt

    if stage == "read":
        monkeypatch.setattr(ls, "read", interrupt)
    elif command in WRITING:
        monkeypatch.setattr(os, "replace", interrupt)  # all is written but for the name
    else:
        monkeypatch.setattr(ls, "LimitSurface", interrupt)
    result = run(*words)
    assert called
    assert (result.exit_code, result.output) == (130, ""), result.exception


@pytest.mark.parametrize(
    ("command", "work"),
    [
        ("tessellate", "tessellate"),
        ("refine", "refined"),
        ("validate", "validate"),
        ("plot", "plot"),
    ],
)
def test_interrupts_of_the_work(command, work, cage, untouched, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(ls, work, interrupt)
    result = run(*filled(READING[command], cage, untouched / "out"))
    assert (result.exit_code, result.output) == (130, ""), result.exception


def test_an_interrupt_between_answers(cage, untouched, monkeypatch):
    monkeypatch.setattr(
        answers.Question, "__call__", lambda *_, **__: signal.raise_signal(signal.SIGINT)
    )
    for name in ["a.csv", "a.npy", "a.npz", "a.parquet", "a.zarr"]:
        result = run("evaluate", cage, "--grid", 2, "-o", untouched / name)
        assert (result.exit_code, result.output) == (130, ""), result.exception


def test_interrupts_that_a_library_swallows_come_again(cage, untouched, monkeypatch):
    @ctypes.CFUNCTYPE(None)
    def callback():
        signal.raise_signal(signal.SIGINT)

    def work(*_, **__):
        callback()
        time.sleep(60)

    monkeypatch.setattr(answers.Question, "__call__", work)
    result = run("evaluate", cage, "--grid", 2, "-o", untouched / "a.npz")
    assert (result.exit_code, result.output) == (130, ""), result.exception


def test_interrupts_while_the_program_loads(monkeypatch):
    class Loading:
        def __getattr__(self, name):
            raise KeyboardInterrupt

    monkeypatch.setitem(sys.modules, "limitsurf.shell.cli.commands", Loading())
    with pytest.raises(SystemExit) as end:
        __main__.main()
    assert end.value.code == 130


@pytest.mark.skipif(os.name != "posix", reason="needs signals")
@pytest.mark.parametrize(("number", "code"), [("SIGTERM", 143), ("SIGHUP", 129)])
def test_termination_is_orderly(number, code, cage, untouched, monkeypatch):
    before = signal.getsignal(getattr(signal, number))
    end = getattr(signal, number)
    monkeypatch.setattr(answers.Question, "__call__", lambda *_, **__: signal.raise_signal(end))
    result = run("evaluate", cage, "--grid", 2, "-o", untouched / "a.npz")
    assert (result.exit_code, result.output) == (code, "")
    assert signal.getsignal(end) == before


@contextmanager
def killed_when_late(process):
    """End a process that is not done with in time, and with it the wait for what it does."""
    timer = threading.Timer(600, process.kill)
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


@pytest.mark.skipif(os.name != "posix", reason="needs signals")
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_while_the_input_is_awaited(number, code, untouched):
    command = [*PROGRAM, "refine", "-", "-o", "a.obj"]
    with subprocess.Popen(
        command,
        cwd=untouched,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        # a pipe holds 64 kB: once more is taken, the program reads
        with killed_when_late(process):
            process.stdin.write(b"# a comment\n" * 20_000)
            process.stdin.flush()
        process.send_signal(number)
        output, stderr = process.communicate(timeout=60)
    assert (process.returncode, output, stderr) == (code, b"", b"")


LONG = """
import sys
from limitsurf.shell import terminal
from limitsurf.shell.cli import commands as cli
from limitsurf.shell.io import answers
import numpy as np

terminal.GRACE = 0.2

def amid_a_library(*_, **__):
    print("begun", flush=True)
    np.linalg.svd(np.random.default_rng(0).random((6000, 6000)))

answers.Question.__call__ = amid_a_library
cli.main(sys.argv[1:])
"""


@pytest.mark.skipif(os.name != "posix", reason="needs signals")
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_amid_a_long_step_of_a_library(number, code, cage, untouched):
    command = [sys.executable, "-c", LONG, "evaluate", cage, "--grid", "2", "-o", "a.csv"]
    with (
        subprocess.Popen(
            command,
            cwd=untouched,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            preexec_fn=default_signals,
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
        ) as process,
        killed_when_late(process),
    ):
        assert process.stdout.readline() == b"begun\n"
        process.send_signal(number)
        begun = time.monotonic()
        _, stderr = process.communicate(timeout=60)
    assert (process.returncode, stderr) == (code, b"")
    assert time.monotonic() - begun < 20


def default_signals():
    """Let a child meet signals as usual, whoever ignores them around."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


CLOSED = """
import io, json, os, sys
from limitsurf.shell.cli.commands import main

codes = []
for arguments in json.loads(sys.argv[1]):
    read, write = os.pipe()
    os.close(read)
    sys.stdout = io.TextIOWrapper(io.BufferedWriter(io.FileIO(write, "w")), encoding="utf-8")
    try:
        main(arguments)
    except SystemExit as end:
        codes.append(end.code)
print(*codes, file=sys.__stdout__)
"""


@pytest.mark.skipif(os.name != "posix", reason="elsewhere pipes end otherwise")
def test_readers_that_go_away(cage):
    done = in_one_process(CLOSED, [filled(words, cage) for words in SAYING.values()])
    assert done.stderr == ""
    assert done.stdout.split() == ["1"] * len(SAYING)


@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")
@pytest.mark.parametrize(
    ("line", "code", "expected"),
    [
        ("LIMITSURF basis --valence 9 | head -1", 0, ""),
        ("LIMITSURF info prism.obj >&-", 2, "limitsurf: error: standard output: It is closed\n"),
        ("LIMITSURF refine prism.obj >&-", 2, "limitsurf: error: standard output: It is closed\n"),
        ("LIMITSURF evaluate prism.obj --grid 2 -o a.npy >&- 2>&-", 0, ""),
        ("LIMITSURF info - <&-", 2, "limitsurf: error: standard input: It is closed\n"),
        (
            "LIMITSURF evaluate prism.obj --queries - <&-",
            2,
            "limitsurf: error: standard input: It is closed\n",
        ),
        ("LIMITSURF info none.obj 2>&-", 2, ""),
        ("TERM= LIMITSURF info prism.obj", 0, ""),
        ("PYTHONIOENCODING=ascii LIMITSURF convert prism.obj ä.obj", 0, ""),
        ("PYTHONIOENCODING=ascii LC_ALL=C LIMITSURF info ö.obj", 2, None),
    ],
)
def test_unusual_streams(line, code, expected, cage):
    (cage.parent / "limitsurf").write_text(f'#!/bin/sh\nexec {shlex.join(PROGRAM)} "$@"\n')
    (cage.parent / "limitsurf").chmod(0o755)
    done = subprocess.run(
        ["bash", "-c", line.replace("LIMITSURF", "./limitsurf")],
        cwd=cage.parent,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == code
    if expected is None:
        assert done.stderr.startswith("limitsurf: error: ")
        assert len(done.stderr.splitlines()) == 1
    else:
        assert done.stderr == expected
    if code == 0 and "-o" not in line:
        assert done.stdout


# ------------------------------------------------------------------ terminals


def on_terminal(words, environment, **streams):
    """What the program writes to a terminal at some of its streams, and its exit code."""
    ours, theirs = pty.openpty()
    streams = dict.fromkeys(streams, theirs) | {}
    everything: dict[str, Any] = {
        "stdin": subprocess.DEVNULL,
        "stdout": subprocess.PIPE,
        "stderr": subprocess.PIPE,
    }
    with subprocess.Popen(
        [*PROGRAM, *words], **(everything | streams), env=os.environ | environment
    ) as process:
        os.close(theirs)
        text = b""
        with killed_when_late(process), suppress(OSError):  # how a terminal ends
            while part := os.read(ours, 1 << 16):
                text += part
        process.wait(timeout=60)
    os.close(ours)
    return text.decode(), process.returncode


@pytest.mark.skipif(sys.platform != "linux", reason="needs a terminal")
@pytest.mark.parametrize(
    ("environment", "shown"),
    [({"TERM": "xterm"}, True), ({"TERM": "dumb"}, False), ({"TERM": ""}, False)],
)
def test_progress_is_for_terminals(environment, shown, cage, tmp_path):
    words = ["evaluate", str(cage), "--random", "50000", "-o", str(tmp_path / "a.npy")]
    text, code = on_terminal(words, environment, stderr=True)
    assert code == 0
    assert ("evaluating" in text) == shown
    assert shown or text == ""


@pytest.mark.skipif(sys.platform != "linux", reason="needs a terminal")
def test_terminals_get_no_binary_files(cage):
    words = ["tessellate", str(cage), "-n", "2", "--to", "ply"]
    text, code = on_terminal(words, {}, stdout=True)
    assert (text, code) == ("", 2)


@pytest.mark.skipif(sys.platform != "linux", reason="needs a terminal")
def test_tables_without_colours(cage):
    text, code = on_terminal(["validate", str(cage), "--levels", "1"], {"NO_COLOR": "1"}, stdout=1)
    assert code == 0
    assert "limit error" in text
    assert "\x1b" not in text


@pytest.mark.parametrize("asked", [["--grid", "1000000000"], ["--random", "1000000000000000"]])
def test_answers_that_find_no_room_are_refused_at_once(asked, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ls.write("cage.obj", ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]]))
    text = fail("evaluate", "cage.obj", *asked, "-o", "a.npz")
    assert text.startswith("a.npz: needs more than")
    assert os.listdir() == ["cage.obj"]
