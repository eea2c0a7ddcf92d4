"""Files: pipes that are waited for, output that appears whole or not at all, suffixes."""

from __future__ import annotations

import errno
import os
import secrets
import shutil
import stat
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from typing import IO, Any, TypeAlias

from limitsurf import memory

Path: TypeAlias = str | os.PathLike[str]

SUFFIXES = (".csv", ".npz", ".npy", ".parquet", ".zarr")
PATIENCE = 20  # seconds for which a pipe may have no writer
FULL = {errno.ENOSPC, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC)}  # said of writing only


def checked_suffix(path: str | os.PathLike[str]) -> str:
    """The suffix of a file of queries or answers; ValueError if it is another."""
    suffix = os.path.splitext(os.fspath(path).rstrip(os.sep))[1].lower()
    if suffix not in SUFFIXES:
        need = ", ".join(SUFFIXES)
        raise ValueError(f"{os.fspath(path)}: unknown suffix {suffix!r}, need one of {need}")
    return suffix


def needed(module: str, what: str) -> Any:
    """A module of the extra `dask`; ImportError that says how to install it."""
    try:
        return import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise ImportError(
            f'{package} is needed for {what}: pip install "limitsurf[dask]"'
        ) from error


def opened(path: Path) -> IO[bytes]:
    """A file open for reading, which may be a pipe that somebody writes to.

    Raises
    ------
    OSError
        A file that cannot be read, or a pipe that nobody opens for writing within `PATIENCE`.
    """
    if not (os.path.exists(path) and stat.S_ISFIFO(os.stat(path).st_mode)):
        return open(path, "rb")
    found: list[IO[bytes]] = []
    failed: list[OSError] = []

    def wait() -> None:
        try:
            found.append(open(path, "rb"))  # noqa: SIM115
        except OSError as error:
            failed.append(error)

    waiting = threading.Thread(target=wait, daemon=True)
    waiting.start()
    waiting.join(PATIENCE)
    if waiting.is_alive():
        with suppress(OSError):
            os.close(os.open(path, os.O_WRONLY | os.O_NONBLOCK))  # which ends the wait
            waiting.join(1)
        for file in found:
            file.close()
        text = f"nobody has opened this pipe for writing in {PATIENCE} s"
        raise TimeoutError(errno.ETIMEDOUT, text, os.fspath(path))
    if failed:
        raise failed[0]
    return found[0]


def blocks(file: IO[bytes], name: str) -> Iterator[bytes]:
    """The content of a file, which is not to fill the memory where nobody knows its end."""
    with suppress(AttributeError, OSError, ValueError):
        if stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            yield file.read()
            return
    total, limit = 0, memory.available() / 4
    while block := file.read(1 << 20):
        total += len(block)
        if total > limit:
            raise MemoryError(
                f"{name}: has no end after {total} bytes, a quarter of the memory available: "
                "save it as a file, or read less"
            )
        yield block


def check_target(path: str | os.PathLike[str]) -> None:
    """Refuse early, by an OSError, what `replacing` would refuse at the end of all work."""
    if os.path.isdir(path):
        raise IsADirectoryError(errno.EISDIR, "Is a directory", os.fspath(path))
    if not _is_device(path):
        check_folder(os.path.dirname(os.path.realpath(path)))


def check_room(path: str | os.PathLike[str], size: int) -> None:
    """Refuse early, by an OSError, a file of at least so many bytes that finds no room."""
    if _is_device(path):
        return
    free = shutil.disk_usage(os.path.dirname(os.path.realpath(path))).free
    if size > free:
        text = f"needs more than {size:.2g} bytes, and {free:.2g} are free: ask for less"
        raise OSError(errno.ENOSPC, text, os.fspath(path))


def check_folder(folder: str) -> None:
    """Refuse, by an OSError, a directory in which no file can be made."""
    if not os.path.isdir(folder):
        raise FileNotFoundError(errno.ENOENT, "No such directory", folder)
    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, "No permission to write in this directory", folder)


def _is_device(path: str | os.PathLike[str]) -> bool:
    """Whether there is something that is no regular file; its real path can be none at all."""
    return os.path.exists(path) and not os.path.isfile(path)


_unfinished: set[str] = set()  # files and directories that are to take the place of others


def remove_unfinished() -> None:
    """Remove what is being written, for a process that ends in the midst of it."""
    for path in list(_unfinished):
        _remove(path)


def _remove(path: str) -> None:
    if os.path.isdir(path):
        shutil.rmtree(path, ignore_errors=True)
    elif os.path.lexists(path):
        os.remove(path)


@contextmanager
def _temporary(path: str) -> Iterator[str]:
    """A name for something unfinished, which is gone when the block ends."""
    _unfinished.add(path)
    try:
        yield path
    finally:
        _remove(path)
        _unfinished.discard(path)


def _beside(path: str) -> str:
    """A name of its own for what is to take the place of a path, in the same directory."""
    folder, base = os.path.split(path)
    # a name can be as long as the system allows
    return os.path.join(folder, f".{base[:40]}.{secrets.token_hex(8)}")


@contextmanager
def _naming(path: str | os.PathLike[str], temporary: str) -> Iterator[None]:
    """Let errors of writing carry the path that the user knows."""
    try:
        yield
    except OSError as error:
        inside = isinstance(error.filename, str) and error.filename.startswith(temporary)
        if not inside and (error.filename is not None or error.errno not in FULL):
            raise
        raise type(error)(error.errno, error.strerror, os.fspath(path)) from None


@contextmanager
def replacing(path: str | os.PathLike[str], mode: str = "wb") -> Iterator[IO[Any]]:
    """Open a file for writing that takes the place of ``path`` once it is complete.

    It is written beside ``path`` under a name of its own and renamed when the block ends without
    an error, otherwise removed. Links are followed. What is no regular file (a pipe, a device) is
    written to directly. Text is UTF-8 with newlines as given.

    Parameters
    ----------
    path : str or os.PathLike
    mode : {"wb", "w"}

    Raises
    ------
    OSError
        A file that cannot be written; it carries ``path``, not the name used meanwhile.

    Examples
    --------
    >>> import os, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with replacing(os.path.join(folder, "a.txt"), "w") as file:
    ...         _ = file.write("whole")
    ...         print(os.path.exists(os.path.join(folder, "a.txt")))
    ...     os.listdir(folder)
    False
    ['a.txt']
    """
    text: dict[str, Any] = {} if "b" in mode else {"encoding": "utf-8", "newline": ""}
    if _is_device(path):
        with _naming(path, os.fspath(path)), open(path, mode, **text) as file:
            yield file
        return
    name = os.path.realpath(os.fspath(path))
    with _temporary(_beside(name)) as temporary, _naming(path, temporary):
        with open(temporary, mode.replace("w", "x"), **text) as file:
            yield file
        if os.path.exists(name):
            shutil.copymode(name, temporary)
        os.replace(temporary, name)


@contextmanager
def replacing_folder(path: str | os.PathLike[str]) -> Iterator[str]:
    """A new directory to fill, which takes the place of ``path`` once the block ends.

    It is beside ``path`` under a name of its own until then, and removed after an error.

    Raises
    ------
    OSError
        A directory that cannot be made or replaced; it carries ``path``.

    Examples
    --------
    >>> import os, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with replacing_folder(os.path.join(folder, "a")) as new:
    ...         os.mkdir(os.path.join(new, "b"))
    ...     os.listdir(os.path.join(folder, "a"))
    ['b']
    """
    name = os.path.realpath(os.fspath(path))
    old = _beside(name)
    with _temporary(_beside(name)) as temporary:
        try:
            with _naming(path, temporary):
                os.mkdir(temporary)
                yield temporary
                if os.path.lexists(name):
                    os.rename(name, old)
                os.rename(temporary, name)
        except BaseException:
            if os.path.lexists(old) and not os.path.lexists(name):
                os.rename(old, name)
            raise
    shutil.rmtree(old, ignore_errors=True)
