"""Compiling in a process of its own while NumPy answers, and what is said of it.

Nothing here imports Numba: a process that will not use kernels must not wait for it.
"""

from __future__ import annotations

import os
import subprocess
import sys
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from limitsurf import disk_cache

VARIABLE = "LIMITSURF_BACKGROUND"  # 0: no process is ever started
MARK = "ready-"  # how the names of files begin that say that all kernels for something are there
# modules here that are not compiled
_PLAIN = ("__init__", "background", "locks", "rationals", "reference")
_MODULE = "limitsurf.compiling"  # what the process runs
_process: list[subprocess.Popen[bytes]] = []  # at most one in the life of this process
_said: set[str] = set()


@cache
def folder() -> str:
    """Where kernels are in the cache: machine code depends on all of them, as they hold others."""
    sources = sorted(Path(__file__).parent.glob("*.py"))
    parts = [source.read_bytes() for source in sources if source.stem not in _PLAIN]
    tag = str(sys.implementation.cache_tag).encode()
    return f"kernels/{sha256(b''.join([*parts, tag])).hexdigest()[:16]}"


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


def busy() -> bool:
    """Whether a process, whoever started it, compiles in the background."""
    return disk_cache.claimed(lock()) or any(process.poll() is None for process in _process)


def begin(what: str) -> bool:
    """Have kernels compiled, first those for this; False where nothing would come of it.

    That is where no process may be started, where its results could not be kept, or if one has been
    started before and has ended.
    """
    if not busy():
        allowed = os.environ.get(VARIABLE) != "0" and not _process and _is_python()
        if not allowed or not disk_cache.writable(folder()):
            return False
        try:
            _process.append(_started(what))
        except OSError:  # as where there is no memory for another process
            return False
    say("kernels are compiled in the background, once on this machine; NumPy answers until then")
    return True


def _is_python() -> bool:
    """Whether `sys.executable` runs modules: in programs that embed Python it is the program."""
    name = Path(sys.executable or "").name.lower()
    return name.startswith(("python", "pypy")) and not getattr(sys, "frozen", False)


def _started(what: str) -> subprocess.Popen[bytes]:
    """A process that hears no signals of this one's terminal, and outlives it."""
    paths = [os.path.abspath(path) for path in sys.path]
    here = {
        "PYTHONPATH": os.pathsep.join(paths),
        "LIMITSURF_CACHE_DIR": str(disk_cache.cache_directory().absolute()),
    }
    apart: dict[str, Any] = {"start_new_session": True}
    if sys.platform == "win32":
        flags = subprocess.DETACHED_PROCESS | subprocess.CREATE_NEW_PROCESS_GROUP
        apart = {"creationflags": flags | subprocess.IDLE_PRIORITY_CLASS}
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", _MODULE, what],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        cwd=os.path.abspath(os.sep),
        env=os.environ | here,
        **apart,
    )
    return process


def say(text: str) -> None:
    """Tell a person at a terminal, once."""
    if text in _said or sys.stderr is None or not sys.stderr.isatty():
        return
    _said.add(text)
    print(f"limitsurf: {text}", file=sys.stderr)
