"""Compiling in a process of its own while NumPy answers, and what is said of it.

Nothing here imports Numba: a process that will not use kernels must not wait for it.
"""

from __future__ import annotations

import atexit
import importlib.util
import marshal
import os
import pkgutil
import subprocess
import sys
import threading
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any

from limitsurf import disk_cache

VARIABLE = "LIMITSURF_BACKGROUND"  # 0: no process is ever started
MARK = "ready-"  # how the names of files begin that say that all kernels for something are there
# modules here that are not compiled
_PLAIN = ("__init__", "background", "locks", "rationals", "reference")
_process: list[subprocess.Popen[bytes]] = []  # at most one in the life of this process
_said: set[str] = set()


def _sources() -> bytes:
    """What machine code depends on beside the processor: all kernels, as each holds others.

    As they are when this is imported: files may be others later, when an update has come. In
    programs without sources these are compiled ones, and if nothing is known a file is of one
    process.
    """
    parent = Path(__file__).parent
    sources = {path.stem: path.read_bytes() for path in sorted(parent.glob("*.py"))}
    for _, name, _ in () if sources else pkgutil.iter_modules([str(parent)]):
        spec = importlib.util.find_spec(f"{__package__}.{name}")
        code = spec and getattr(spec.loader, "get_code", lambda _: None)(spec.name)
        sources[name] = marshal.dumps(code) if code else b""
    parts = [content for name, content in sorted(sources.items()) if name not in _PLAIN]
    known = b"".join(parts) or os.urandom(16)
    return sha256(known + str(sys.implementation.cache_tag).encode()).digest()


_FOLDER = f"kernels/{_sources().hex()[:16]}"


def folder() -> str:
    """Where kernels are in the cache."""
    return _FOLDER


def lock() -> str:
    """The name of the file of whoever compiles in the background, one on a machine."""
    return f"{folder()}/background.lock"


def marked() -> bool:
    """Whether all kernels for something may be in the cache; Numba knows if they are."""
    try:
        names = os.listdir(disk_cache.cache_directory() / folder())
    except OSError:
        return False
    return any(name.startswith(MARK) for name in names)


def prepare() -> None:
    """Make the place where kernels are kept, before they are needed: it may be filled by then."""
    disk_cache.writable(folder())


def busy() -> bool:
    """Whether a process, whoever started it, compiles in the background."""
    return disk_cache.claimed(lock()) or any(process.poll() is None for process in _process)


def begin(what: str) -> bool:
    """Have kernels compiled, first those for this; False where nothing would come of it.

    That is where no process may be started, where its results could not be kept, or if one has been
    started before and has ended.
    """
    if not busy():
        forbidden = os.environ.get(VARIABLE, "").lower() in ("0", "false", "no", "off")
        allowed = not forbidden and not _process and _is_python()
        if not allowed or not disk_cache.writable(folder()):
            return False
        try:
            process = _started(what)
        except (OSError, ValueError):  # as where there is no memory for another process
            return False
        _process.append(process)
        threading.Thread(target=process.wait, daemon=True).start()  # so that it leaves nothing
        atexit.register(_leave, process)
    say("kernels are compiled in the background, once on this machine; NumPy answers until then")
    return True


def _is_python() -> bool:
    """Whether `sys.executable` runs modules: in programs that embed Python it is the program."""
    name = Path(sys.executable or "").name.lower()
    return name.startswith(("python", "pypy")) and not getattr(sys, "frozen", False)


# What the process runs. Where this one finds modules it looks for those only that are not Python's
# own, and never in the directory that happens to be the current one.
_CODE = """
import os, signal, sys
if hasattr(os, "nice"):
    os.nice(19)
what, *paths = sys.argv[1:]
sys.path += [path for path in paths if path not in sys.path]
signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # removing what is unfinished
from limitsurf import disk_cache
from limitsurf._kernels import background
with disk_cache.alone(background.lock(), 0) as alone:
    if alone:
        from limitsurf.compiling import compile_first
        compile_first(what)
"""


def _started(what: str) -> subprocess.Popen[bytes]:
    """A process that hears no signals of this one's terminal, and outlives it."""
    paths = [str(Path(__file__).parents[2])]
    paths += [path for path in sys.path if isinstance(path, str) and os.path.isabs(path)]
    apart: dict[str, Any] = {"start_new_session": True}
    if sys.platform == "win32":
        flags = subprocess.DETACHED_PROCESS | subprocess.CREATE_NEW_PROCESS_GROUP
        apart = {"creationflags": flags | subprocess.IDLE_PRIORITY_CLASS}
    return subprocess.Popen(
        [sys.executable, "-I", "-c", _CODE, what, *paths],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        cwd=os.path.abspath(os.sep),
        env=os.environ | {"LIMITSURF_CACHE_DIR": str(disk_cache.cache_directory().absolute())},
        **apart,
    )


def _leave(process: subprocess.Popen[bytes]) -> None:
    """Let a process be that goes on after this one, of which Python would warn."""
    if process.poll() is None:
        process.returncode = 0


def say(text: str) -> None:
    """Tell a person at a terminal, once."""
    if text in _said:
        return
    with suppress(Exception):  # whatever somebody has put in the place of a terminal
        if sys.stderr.isatty():
            _said.add(text)
            print(f"limitsurf: {text}", file=sys.stderr)
