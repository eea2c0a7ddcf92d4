"""The cache on disk: whom it trusts, what it survives, and compiled kernels in it."""

import errno
import os
import pickle
import socket
import stat
import subprocess
import sys
import tempfile
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs
import pytest

import limitsurf as ls
from limitsurf import disk_cache
from limitsurf._kernels import jit
from limitsurf.tables import SCHEMES, Sector

posix = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="needs owners and modes of files")
CONTENT = b"content"


@pytest.fixture
def top(tmp_path, monkeypatch):
    """A cache directory that is not there yet, in a process that has said nothing."""
    directory = tmp_path / "above" / "cache"
    monkeypatch.setenv("LIMITSURF_CACHE_DIR", str(directory))
    monkeypatch.setattr(disk_cache, "_said", [])
    return directory


def read(top, name="file"):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LIMITSURF_CACHE_DIR", str(top))
        return disk_cache.read(name, 100)


def write(top, name="file", content=CONTENT):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LIMITSURF_CACHE_DIR", str(top))
        disk_cache.write(name, content)


def warned(*words):
    return pytest.warns(RuntimeWarning, match="(?s)" + ".*".join(words))


# --- whom it trusts -------------------------------------------------------------------------------


@posix
def test_what_is_written_is_read_and_the_users_alone(top):
    assert read(top) is None
    write(top, "kernels/1/file")
    assert read(top, "kernels/1/file") == CONTENT
    for made in (top.parent, top, top / "kernels", top / "kernels" / "1"):
        assert stat.S_IMODE(made.stat().st_mode) == 0o700
    assert [path.name for path in (top / "kernels" / "1").iterdir()] == ["file"]


@posix
def test_directories_in_a_cache_for_many_are_for_many(top):
    top.mkdir(parents=True)
    top.chmod(0o755)
    write(top, "kernels/file")
    assert stat.S_IMODE((top / "kernels").stat().st_mode) == 0o755
    assert stat.S_IMODE((top / "kernels" / "file").stat().st_mode) == 0o644


@posix
@pytest.mark.parametrize(
    ("where", "mode", "who"),
    [
        (".", 0o777, "everybody"),
        (".", 0o1777, "everybody"),
        (".", 0o770, "the group"),
        (".", 0o702, "everybody"),
        ("kernels", 0o775, "the group"),
        ("..", 0o777, "everybody"),
        ("..", 0o775, "the group"),
    ],
)
def test_directories_that_others_may_write(top, where, mode, who):
    write(top, "kernels/file")
    place = {".": top, "..": top.parent}.get(where, top / where)
    place.chmod(mode)
    with warned("is not used", who, f"{mode:04o}", "go-w", "LIMITSURF_CACHE_DIR") as record:
        assert read(top, "kernels/file") is None
        write(top, "kernels/file", b"other")
    assert str(place) in str(record[0].message)
    assert len(record) == 1
    assert (top / "kernels" / "file").read_bytes() == CONTENT  # not written either
    place.chmod(0o755)
    assert read(top, "kernels/file") == CONTENT


@posix
def test_nothing_is_made_where_others_may_write(top):
    top.mkdir(parents=True)
    top.chmod(0o777)
    with warned("everybody"):
        write(top, "kernels/file")
    top.parent.chmod(0o777)
    write(top.parent / "more", "file")
    assert not list(top.iterdir())
    assert list(top.parent.iterdir()) == [top]


@posix
def test_directories_above_with_the_sticky_bit(top):
    """As ``/tmp``, where each has what is theirs."""
    write(top)
    top.parent.chmod(0o1777)
    assert read(top) == CONTENT


@posix
@pytest.mark.parametrize("mode", [0o666, 0o664, 0o646])
def test_files_that_others_may_write_are_replaced(top, mode):
    write(top)
    (top / "file").chmod(mode)
    with warned("file in the cache is not used", f"{mode:04o}"):
        assert read(top) is None
    write(top)
    assert read(top) == CONTENT


@posix
def test_owners(top, monkeypatch):
    """The user, root, and who installed the package."""
    write(top)
    me = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: me + 1000)
    monkeypatch.setattr(disk_cache, "_package_owner", lambda: me)
    assert read(top) == CONTENT
    if me:
        monkeypatch.setattr(disk_cache, "_package_owner", lambda: 0)
        with warned(f"belongs to user {me}, who is neither you \\({me + 1000}\\), nor root"):
            assert read(top) is None


@posix
@pytest.mark.skipif(hasattr(os, "geteuid") and os.geteuid() != 0, reason="needs root")
@pytest.mark.parametrize("what", ["file", ".", "..", "link"])
def test_what_others_own(top, what):
    """An owner may write whatever the mode says; the target of their link is theirs to choose."""
    write(top)
    if what == "link":
        top.rename(top.parent / "real")
        top.symlink_to("real")
        assert read(top) == CONTENT
    place = {".": top, "..": top.parent, "link": top}.get(what, top / what)
    os.chown(place, 4321, -1, follow_symlinks=False)
    with warned(str(place), "belongs to user 4321"):
        assert read(top) is None


@posix
def test_links_to_directories_are_followed(top, tmp_path):
    write(tmp_path / "elsewhere" / "real")
    top.parent.mkdir()
    top.symlink_to(Path("..") / "elsewhere" / "link")
    (tmp_path / "elsewhere" / "link").symlink_to(tmp_path / "elsewhere" / "real")
    assert read(top) == CONTENT
    write(top, "other")
    assert read(top, "other") == CONTENT
    (tmp_path / "elsewhere").chmod(0o777)
    with warned("everybody", "elsewhere"):
        assert read(top) is None


@posix
def test_names_that_go_back_and_forth(top, monkeypatch):
    write(top)
    monkeypatch.chdir(top.parent)
    for name in (
        Path("cache"),
        Path("cache/../cache"),
        Path("../above/cache"),
        top / ".." / "cache",
    ):
        assert read(name) == CONTENT
    monkeypatch.chdir(top)
    assert read(Path(".")) == CONTENT


def test_links_in_a_circle(top):
    top.parent.mkdir()
    top.symlink_to(top.name)
    assert read(top) is None
    with warned("nothing can be kept"):
        write(top)


# --- what it survives -----------------------------------------------------------------------------


def in_the_way(path, kind):
    """Something else where a file of the cache was."""
    path.unlink()
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "socket":
        short = Path(tempfile.mkdtemp()) / "s"  # addresses have no room for long names
        with socket.socket(socket.AF_UNIX) as made:
            made.bind(str(short))
        short.rename(path)
        short.parent.rmdir()
    elif kind == "directory":
        path.mkdir()
    elif kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "circle":
        path.symlink_to(path)
    elif kind == "nowhere":
        path.symlink_to(path.parent / "nowhere")
    else:
        path.write_bytes(b"")
        os.truncate(path, 1 << 40)  # it takes no room on disk


KINDS = ["fifo", "socket", "device", "circle", "nowhere", "huge", "directory"]


@posix
@pytest.mark.parametrize("kind", KINDS)
def test_something_else_in_place_of_a_file(top, kind):
    write(top)
    try:
        in_the_way(top / "file", kind)
    except OSError as error:  # no file system of this kind has it
        pytest.skip(str(error))
    assert read(top) is None
    if kind == "directory":
        with warned("nothing can be kept"):
            write(top)
        return
    write(top)
    assert read(top) == CONTENT
    assert [path.name for path in top.iterdir()] == ["file"]


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO])
@pytest.mark.parametrize("step", ["NamedTemporaryFile", "replace"])
def test_disks_that_take_nothing(top, monkeypatch, number, step):
    write(top)

    def fail(*_, **options):
        raise OSError(number, os.strerror(number))

    with monkeypatch.context() as patch:
        patch.setattr(*((os, step) if step == "replace" else (tempfile, step)), fail)
        with warned("nothing can be kept", os.strerror(number)) as record:
            write(top, "other")
            write(top, "third")
    assert len(record) == 1
    assert [path.name for path in top.iterdir()] == ["file"]
    assert read(top) == CONTENT


def test_users_without_a_home(monkeypatch):
    """As those of containers may be."""

    def missing(_):
        raise RuntimeError("could not determine the home directory")

    monkeypatch.delenv("LIMITSURF_CACHE_DIR", raising=False)
    monkeypatch.setattr(disk_cache, "_said", [])
    monkeypatch.setattr(platformdirs, "user_cache_dir", missing)
    assert disk_cache.read("file", 100) is None
    with warned("nothing can be kept in the cache", "no home directory"):
        disk_cache.write("file", CONTENT)


# --- compiled kernels -----------------------------------------------------------------------------


def twice(values):
    total = 0.0
    for value in values:
        total += 2 * value
    return total


def loaded(values=None):
    """Whether a kernel comes from the cache in what could be a new process; it must be right."""
    values = np.arange(4.0) if values is None else values
    kernel: Any = jit.lean(twice)
    assert kernel(values) == 2 * values.sum()
    return sum(kernel.stats.cache_hits.values()) == 1


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """A cache with one kernel in it: the path inside, and the bytes."""
    top = tmp_path_factory.mktemp("compiled")
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setenv("LIMITSURF_CACHE_DIR", str(top))
        assert not loaded()
        assert loaded()
    (path,) = top.rglob("*.nbc")
    return path.relative_to(top), path.read_bytes()


@pytest.fixture
def kept(top, compiled):
    """The same at `top`: where the kernel is."""
    path, content = compiled
    disk_cache.write(str(path), content)
    return top / path


def test_kernels_are_kept_by_signature_and_name(top, kept):
    assert not loaded(np.arange(4))
    assert not loaded(np.arange(4.0)[::2])
    assert len(list(top.rglob("*.nbc"))) == 3
    assert loaded()
    assert loaded(np.arange(4))
    assert kept.name.startswith("test_disk_cache.twice-")
    assert [path for path in top.rglob("*") if path.is_file() and path.suffix != ".nbc"] == []


def test_kernels_of_one_name_are_told_apart(top):
    kernels = [jit.lean(eval(f"lambda x: x[0] + {k}")) for k in range(2)]
    assert [kernel(np.arange(4.0)) for kernel in kernels] == [0, 1]
    assert len(list(top.rglob("*.nbc"))) == 2


class Bomb:
    """Leaves a trace when it is unpickled."""

    def __init__(self, trace):
        self.trace = trace

    def __reduce__(self):
        return Path.touch, (self.trace,)


def signed(path, content):
    """With the digest that goes with it."""
    name = "/".join(path.parts[-3:])
    return sha256(name.encode() + content).digest() + content


DAMAGE = {
    "empty": lambda path, bomb: b"",
    "half a digest": lambda path, bomb: path.read_bytes()[:20],
    "digest alone": lambda path, bomb: path.read_bytes()[:32],
    "truncated": lambda path, bomb: path.read_bytes()[:3000],
    "zeroed": lambda path, bomb: bytes(5000),
    "zeroed start": lambda path, bomb: bytes(200) + path.read_bytes()[200:],
    "a bit": lambda path, bomb: path.read_bytes()[:-1] + bytes([path.read_bytes()[-1] ^ 1]),
    "longer": lambda path, bomb: path.read_bytes() + b"more",
    "foreign pickle": lambda path, bomb: bomb,
    "foreign pickle behind": lambda path, bomb: path.read_bytes()[:32] + bomb,
    "another kernel": lambda path, bomb: signed(path.with_name("other"), path.read_bytes()[32:]),
    "another object": lambda path, bomb: signed(path, pickle.dumps(7)),
    "a missing module": lambda path, bomb: signed(path, b"cnowhere\nx\n."),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_damaged_kernels_are_compiled_again_and_replaced(kept, tmp_path, damage):
    trace = tmp_path / "trace"
    kept.write_bytes(DAMAGE[damage](kept, pickle.dumps(Bomb(trace))))
    assert not loaded()
    assert not trace.exists()
    assert loaded()


@posix
@pytest.mark.parametrize("kind", KINDS)
def test_something_else_in_place_of_a_kernel(kept, kind):
    try:
        in_the_way(kept, kind)
    except OSError as error:
        pytest.skip(str(error))
    if kind == "directory":
        with warned("nothing can be kept"):
            assert not loaded()
    else:
        assert not loaded()
        assert loaded()


@posix
def test_kernels_of_a_cache_that_others_may_write(top, kept, tmp_path):
    """Code is taken from nobody, not even with the right digest."""
    kept.write_bytes(signed(kept, pickle.dumps(Bomb(tmp_path / "trace"))))
    top.chmod(0o777)
    with warned("is not used", "everybody") as record:
        assert not loaded()
        assert not loaded()
    assert len(record) == 1
    assert not (tmp_path / "trace").exists()


def test_kernels_on_a_disk_that_takes_nothing(top, kept, monkeypatch):
    """What is there is used, what is not is compiled; one warning says so."""

    def full(*_, **options):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(tempfile, "NamedTemporaryFile", full)
    assert loaded()
    with warned("nothing can be kept", "No space left") as record:
        assert not loaded(np.arange(4))
        ls.tables.eigen_table(SCHEMES["catmull-clark"], Sector("cone", 77))
    assert len(record) == 1


@pytest.mark.skipif(sys.platform == "win32", reason="needs /dev/null")
def test_evaluation_without_a_place_for_kernels():
    """In a new process, as users meet it: answers, and one warning."""
    code = """if True:
        import warnings
        import numpy as np
        from limitsurf._kernels import jit
        with warnings.catch_warnings(record=True) as record:
            warnings.simplefilter("always")
            for values in (np.arange(4), np.arange(4.0)):
                assert jit.lean(lambda x: x[0] + x[1])(values) == 1
        print([(w.category.__name__, "Not a directory" in str(w.message)) for w in record])
    """
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=300,
        env=os.environ | {"LIMITSURF_CACHE_DIR": "/dev/null/cache"},
        check=False,
    )
    assert (done.stdout, done.stderr) == ("[('RuntimeWarning', True)]\n", "")
