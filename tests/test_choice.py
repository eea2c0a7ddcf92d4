"""Which engine answers when: by cost, by what is in the cache, and while kernels are compiled."""

import io
import os
import platform
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import zoo

import limitsurf as ls
from limitsurf import _kernels, disk_cache
from limitsurf._kernels import background
from limitsurf.engine import choice
from limitsurf.engine.compiled import Compiled
from limitsurf.engine.protocol import Request

TRUE = _kernels._pays  # which tests do without
posix = pytest.mark.skipif(os.name != "posix", reason="needs signals and owners")


@pytest.fixture
def policy(monkeypatch):
    """What decides outside of tests, in what could be a new process."""
    monkeypatch.delenv(_kernels.VARIABLE, raising=False)
    monkeypatch.setattr(_kernels, "_pays", TRUE)
    for name, value in (("_spent", 0.0), ("_next", {}), ("_AGAIN", 0.0)):
        monkeypatch.setattr(_kernels, name, value)
    monkeypatch.setattr(background, "_process", [])
    monkeypatch.setattr(background, "_said", set())


@pytest.fixture
def empty(policy, monkeypatch, tmp_path):
    """A cache with nothing in it."""
    monkeypatch.setenv("LIMITSURF_CACHE_DIR", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def cache(monkeypatch):
    """Kinds that are said to be in the cache, and those of which compiling has been begun."""
    found, begun = set(), []

    def begin(kind):
        begun.append(kind)
        return True

    monkeypatch.setattr(_kernels, "_read", lambda kind: kind in found and _kernels.load())
    monkeypatch.setattr(background, "begin", begin)
    return found, begun


def surface():
    points, faces = zoo.cube()
    return ls.LimitSurface(ls.Mesh(np.asarray(points, dtype=float), faces))


def asked(surface, size=1):
    """Who answers so many queries."""
    return surface._answers.engine(Request.of(0, np.full(size, 0.5), 0.5, False, 1), [(0, 0)])


def test_kernels_are_loaded_when_numpy_has_cost_as_much(policy, cache):
    cache[0].update(_kernels.KINDS)
    one = surface()
    calls = 0
    while asked(one) is one._answers.reference:
        calls += 1
    assert _kernels._LOADING / 2 < calls * choice._CALL <= _kernels._LOADING
    assert asked(one) is one._answers.compiled
    assert asked(surface()).__class__ is Compiled  # from one query on, of any surface
    assert "triangles" not in _kernels.available
    assert not cache[1]


def test_a_large_call_does_not_wait_for_more(policy, cache):
    cache[0].update(_kernels.KINDS)
    assert asked(surface(), 1_000_000).__class__ is Compiled


@pytest.mark.parametrize("engine", ["reference", "compiled"])
def test_engines_that_are_chosen_cost_nothing(policy, cache, engine):
    points, faces = zoo.cube()
    one = ls.LimitSurface(ls.Mesh(np.asarray(points, dtype=float), faces), engine=engine)
    for size in (1, 1_000_000):
        assert asked(one, size) is getattr(one._answers, engine)
    assert _kernels._spent == 0
    assert not cache[1]


def test_numpy_answers_until_kernels_are_in_the_cache(policy, cache):
    one = surface()
    assert asked(one, 100_000) is one._answers.reference
    assert not cache[1]
    _kernels._spent = _kernels._LOADING
    assert asked(one) is one._answers.reference
    assert set(cache[1]) == {"quads"}
    cache[0].add("quads")
    assert asked(one) is one._answers.compiled


def test_kernels_take_over_within_a_call(policy, cache, monkeypatch):
    monkeypatch.setattr(choice, "_PORTION", 1000)
    one, (u, v) = surface(), np.random.default_rng(0).random((2, 3500))
    face = np.arange(3500) % 6
    _kernels._spent = _kernels._LOADING
    asks = []

    def read(kind):
        asks.append(kind)
        return len(asks) > 3 and _kernels.load()

    monkeypatch.setattr(_kernels, "_read", read)
    found = one.evaluate(face, u, v)
    assert asks == ["quads"] * 4  # of all, and of three portions
    request = Request.of(face, u, v, False, 1)
    numpy, kernels = (
        engine.derivatives(request, [(0, 0)])[0]
        for engine in (one._answers.reference, one._answers.compiled)
    )
    assert np.allclose(found[:2000], numpy[:2000], rtol=0, atol=4e-16)
    assert (found[2000:] == kernels[2000:]).all()


@pytest.mark.parametrize("name", ["jet", "normal", "tangents", "curvature", "weights"])
def test_portions_are_the_whole(policy, cache, monkeypatch, name):
    one, (u, v) = surface(), np.random.default_rng(0).random((2, 35, 10))
    face = np.arange(35)[:, None] % 6
    whole = getattr(one, name)(face, u, v)
    monkeypatch.setattr(choice, "_PORTION", 100)
    parts = getattr(one, name)(face, u, v)
    if name == "weights":
        assert abs(whole - parts).max() < 1e-15
        return
    whole, parts = (
        list(x.values() if isinstance(x, dict) else x if isinstance(x, tuple) else [x])
        for x in (whole, parts)
    )
    for x, y in zip(whole, parts, strict=True):
        assert np.allclose(x, y, rtol=1e-12, atol=1e-12)
    with pytest.raises(ValueError, match=r"u = 2.0 at index 340 is outside"):
        one.evaluate(0, np.where(np.arange(350) == 340, 2.0, 0.5), 0.5)


def test_without_a_process_kernels_are_compiled_for_very_much(empty):
    """Tests start none."""
    one = surface()
    _kernels._spent = _kernels._LOADING
    assert asked(one) is one._answers.reference
    assert not background._process
    _kernels._spent = _kernels._COMPILING
    assert asked(one) is one._answers.compiled


def test_no_process_where_nothing_would_come_of_it(empty, monkeypatch):
    monkeypatch.delenv(background.VARIABLE)
    monkeypatch.setattr(background, "_started", lambda what: pytest.fail(what))
    for name, value in (("executable", "/usr/bin/blender"), ("executable", None)):
        with monkeypatch.context() as patch:
            patch.setattr(sys, name, value)
            assert not background.begin("quads")
    empty.write_bytes(b"")
    assert not background.begin("quads")


def test_one_process_on_a_machine(empty, monkeypatch):
    monkeypatch.delenv(background.VARIABLE)
    monkeypatch.setattr(background, "_started", lambda what: pytest.fail(what))
    disk_cache.write(f"{background.folder()}/file", b"")
    with disk_cache.alone(background.lock(), 0) as held:
        assert held
        assert background.busy()
        assert background.begin("quads")
    assert not background.busy()


def test_meshes_follow_the_same_rule(policy, cache):
    cache[0].add("meshes")
    assert not _kernels.compiled(1000)
    assert _kernels.compiled(10**8)
    assert _kernels.compiled(1)
    with _kernels.chosen("reference"):
        assert not _kernels.compiled(10**8)


def test_who_is_told(monkeypatch, capsys):
    monkeypatch.setattr(background, "_said", set())
    background.say("something")
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    for _ in range(2):
        background.say("something")
    assert capsys.readouterr().err == "limitsurf: something\n"
    monkeypatch.setattr(sys, "stderr", None)
    background.say("more")


# --- In new processes


def run(code, cache, **variables):
    """What a new process says."""
    env = os.environ | {"LIMITSURF_CACHE_DIR": str(cache)} | variables
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        capture_output=True,
        text=True,
        timeout=600,
        env=env,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout


SURFACE = """if True:
    import sys
    import numpy as np, limitsurf as ls
    from limitsurf import _kernels
    points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    surface = ls.LimitSurface(ls.Mesh(points, quads), engine={engine!r})
"""


def test_numba_that_is_disabled(tmp_path):
    """NumPy answers whatever is asked for."""
    for engine in ("auto", "compiled"):
        code = (
            SURFACE.format(engine=engine)
            + """
    ls.precompile()
    found = surface.evaluate(0, np.full(600_000, 0.5), 0.5)
    ls.refined(surface.mesh, 2)
    print(len(found), "numba" in sys.modules, _kernels.available)
"""
        )
        assert run(code, tmp_path, NUMBA_DISABLE_JIT="1") == "600000 False set()\n"
    assert not list(tmp_path.iterdir())


def test_small_work_loads_nothing(tmp_path):
    code = (
        SURFACE.format(engine="auto")
        + """
    for _ in range(100):
        surface.evaluate(0, 0.5, 0.5)
    surface.jet(0, np.full(10_000, 0.5), 0.5)
    print("numba" in sys.modules)
"""
    )
    assert run(code, tmp_path, **{background.VARIABLE: "1"}) == "False\n"
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_kernels_from_one_cache_are_kept_in_another(tmp_path):
    code = """if True:
    import os, sys
    from limitsurf import _kernels, compiling
    compiling.compile_kinds((_kernels.MESHES,))
    from limitsurf._kernels import jit
    os.environ["LIMITSURF_CACHE_DIR"] = sys.argv[1]
    before = jit.complete(_kernels.MESHES)
    compiling.compile_kinds((_kernels.MESHES,))
    print(before, jit.complete(_kernels.MESHES))
"""
    one, other = tmp_path / "one", tmp_path / "other"
    assert run(code.replace("sys.argv[1]", repr(str(other))), one) == "False True\n"
    files = [{path.name for path in (top / "kernels").rglob("*.nbc")} for top in (one, other)]
    assert files[0] == files[1] != set()
    assert all(path.stat().st_size > 1000 for path in (other / "kernels").rglob("*.nbc"))
    # both are read again
    assert run(code.replace("sys.argv[1]", repr(str(one))), other) == "True True\n"


# --- Locks


@pytest.fixture
def place(empty):
    disk_cache.write("kernels/file", b"")
    return empty / "kernels" / "lock"


def test_a_lock_is_held_by_one(place):
    with disk_cache.alone("kernels/lock", 0) as one:
        with disk_cache.alone("kernels/lock", 0) as other:
            assert (one, other) == (True, False)
        assert disk_cache.claimed("kernels/lock")
    assert not place.exists()
    assert not disk_cache.claimed("kernels/lock")


def test_who_waits_for_a_lock_goes_on_when_it_is_free(place):
    place.write_text(f"{os.getppid()} {platform.node()}")
    timer = threading.Timer(0.2, place.unlink)
    timer.start()
    start = time.monotonic()
    with disk_cache.alone("kernels/lock", 20):
        assert 0.1 < time.monotonic() - start < 10
    timer.join()


@posix
@pytest.mark.parametrize("left", ["ended", "before", "old"])
def test_what_is_left_of_a_lock_is_taken(place, left):
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    pid = {"ended": ended.pid, "before": os.getpid(), "old": 1}[left]
    place.write_text(f"{pid} {platform.node()}")
    if left == "old":
        assert disk_cache.claimed("kernels/lock")
        os.utime(place, (0, 0))
    assert not disk_cache.claimed("kernels/lock")
    with disk_cache.alone("kernels/lock", 0) as held:
        assert held
    assert not place.exists()


@pytest.mark.parametrize("text", ["", "no number", f"{2**100} elsewhere", "\0"])
def test_locks_of_others_are_waited_for_and_never_for_ever(place, text):
    place.write_text(text)
    start = time.monotonic()
    with disk_cache.alone("kernels/lock", 0.1) as held:
        assert not held
    assert 0.1 <= time.monotonic() - start < 10
    assert place.exists()


def test_no_lock_where_nothing_can_be_kept(monkeypatch, tmp_path):
    (tmp_path / "file").write_bytes(b"")
    for name in ("file", "file/below"):
        monkeypatch.setenv("LIMITSURF_CACHE_DIR", str(tmp_path / name))
        with disk_cache.alone("kernels/lock", 60) as held:
            assert not held
        assert not disk_cache.claimed("kernels/lock")
        assert not disk_cache.writable("kernels")


# --- What is found on the way


class Strange:
    """In the place of a terminal; it knows nothing but to write."""

    def write(self, text):
        raise OSError


def closed():
    stream = io.StringIO()
    stream.close()
    return stream


@pytest.mark.parametrize("stream", [lambda: None, Strange, closed])
def test_nothing_is_said_to_what_is_no_terminal(policy, monkeypatch, stream):
    monkeypatch.setattr(sys, "stderr", stream())
    for _ in range(2):
        background.say("text")


@pytest.mark.parametrize("content", [b"", b"\xff\xfe", b"x" * 40])
def test_damaged_marks_mark_nothing(empty, content, monkeypatch):
    from limitsurf._kernels import jit

    disk_cache.write("kernels/file", b"")
    monkeypatch.setattr(jit, "used", {"kernels/file": None})
    jit.mark("quads")
    assert jit.complete("quads")
    (mark,) = (empty / background.folder()).glob(f"{background.MARK}*")
    mark.write_bytes(content)
    assert background.marked()
    assert not jit.complete("quads")


@posix
def test_locks_that_are_none(place):
    os.mkfifo(place)
    assert disk_cache.claimed("kernels/lock")  # which is not waited for
    with disk_cache.alone("kernels/lock", 0.1) as held:
        assert not held
    place.unlink()
    place.write_text(f"{os.getppid()} {platform.node()}")
    assert disk_cache.claimed("kernels/lock")
    place.parent.chmod(0o777)
    assert not disk_cache.claimed("kernels/lock")  # anybody might have made it
    place.parent.chmod(0o755)


@posix
def test_locks_are_those_of_who_made_them(place):
    with disk_cache.alone("kernels/lock", 0) as held:
        assert held
        os.utime(place, (0, 0))
        disk_cache.renew()
        assert time.time() - place.stat().st_mtime < 60
        place.write_text(f"1 {platform.node()}")
    assert place.exists()


@pytest.mark.parametrize("folder", ["", ".", "lib", b"bytes"])
def test_modules_are_not_looked_for_where_a_process_happens_to_be(empty, monkeypatch, folder):
    started = []

    class Process:
        def __init__(self, command, **options):
            started.append(command)

        def wait(self):
            return 0

        poll = wait

    monkeypatch.setattr(sys, "path", [folder, *sys.path])
    monkeypatch.setattr(subprocess, "Popen", Process)
    monkeypatch.setenv(background.VARIABLE, "1")
    assert background.begin("quads")
    (command,) = started
    where = command.index("quads") + 1
    assert "-I" in command[:where]
    assert all(os.path.isabs(path) for path in command[where:])
    assert os.getcwd() not in command[where:] or os.getcwd() in sys.path


@pytest.mark.parametrize("word", ["0", "false", "No", "off"])
def test_processes_can_be_forbidden(empty, monkeypatch, word):
    monkeypatch.setattr(background, "_started", lambda what: pytest.fail(what))
    monkeypatch.setenv(background.VARIABLE, word)
    assert not background.begin("quads")


@posix
def test_a_cache_for_all_is_for_all(tmp_path):
    before = os.umask(0o077)
    try:
        disk_cache.make_for_all(tmp_path / "a" / "b")
    finally:
        os.umask(before)
    assert [(tmp_path / x).stat().st_mode & 0o777 for x in ("a", "a/b")] == [0o755] * 2


def test_refinement_knows_the_same_engines(monkeypatch):
    points, faces = zoo.cube()
    monkeypatch.setenv(_kernels.VARIABLE, "fast")
    with pytest.raises(ValueError, match="LIMITSURF_ENGINE must be one of 'auto'"):
        ls.refined(ls.Mesh(np.asarray(points, dtype=float), faces))


def test_what_kernels_do_not_know_loads_none(policy, cache):
    cache[0].update(_kernels.KINDS)
    for _ in range(3):
        surface().weights(np.zeros(10**4, int), 0.3, 0.4, nu=(3, 0))
    assert _kernels._spent < 0.1
