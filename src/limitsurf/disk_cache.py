"""Files that later processes read again: tables, and compiled kernels, which are code.

Whoever may change such a file decides what these processes compute and run. So a file is read
only where nobody but the user, root and the owner of the installed package could have written or
replaced it: they own the file and every directory on the way to it, which neither group nor world
may write. Above the cache directory those with the sticky bit may be written too, as ``/tmp`` is.
A cache that is not trusted is neither read nor written. Windows has no such modes: there all of
this is left to the place, by default one in the user's profile.

Nothing here raises an error or waits because of what is found on disk: what cannot be read is
computed again and replaced, what cannot be kept or trusted is said once in a warning.
"""

from __future__ import annotations

import errno
import hashlib
import io
import json
import os
import platform
import stat
import tempfile
import time
import warnings
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from math import prod
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[Any]
# arrays of a file: type, shape, where -1 is any length, and the range of indices
Formats: TypeAlias = dict[str, tuple[str, tuple[int, ...], range | None]]

_OTHERS = stat.S_IWGRP | stat.S_IWOTH
# a symbolic link or a pipe in the place of a file is neither followed nor waited for
_FLAGS = os.O_RDONLY
for _flag in ("O_NOFOLLOW", "O_NONBLOCK", "O_NOCTTY", "O_CLOEXEC", "O_BINARY"):
    _FLAGS |= getattr(os, _flag, 0)


def cache_directory() -> Path:
    """The cache directory: ``LIMITSURF_CACHE_DIR``, else the user's; OSError if there is none."""
    named = os.environ.get("LIMITSURF_CACHE_DIR")
    if named:
        return Path(named)
    import platformdirs

    try:
        return Path(platformdirs.user_cache_dir("limitsurf"))
    except RuntimeError as error:  # as in containers, for users whom these do not know
        raise FileNotFoundError(errno.ENOENT, "no home directory") from error


def read(name: str, most: int) -> bytes | None:
    """Return what a file in the cache holds; None if there is none, or none to be trusted.

    A file of more than `most` bytes is none of ours.
    """
    what = "the cache"
    try:
        directory = cache_directory()
        what, path = f"the cache in {directory}", directory / name
        _check_place(path.parent, directory)
        what = f"{path} in the cache"
        if not stat.S_ISREG(os.lstat(path).st_mode):  # opening a device may do something
            return None
        with open(os.open(path, _FLAGS), "rb") as file:
            found = os.fstat(file.fileno())
            if not stat.S_ISREG(found.st_mode) or found.st_size > most:
                return None
            _check_one(path, found)
            return file.read(most)
    except _UntrustedError as reason:
        _warn_once(f"{what} is not used: {reason}")
    except OSError:  # not there, or not ours to read
        pass
    return None


def write(name: str, content: bytes) -> None:
    """Write a file in the cache, making directories on the way; a warning says why if it cannot be.

    New directories are the user's alone; those inside the cache are open to whom it is open.
    """
    what = "the cache"
    try:
        directory = cache_directory()
        what = f"the cache in {directory}"
        replace(_place(name), content)
    except _UntrustedError as reason:
        _warn_once(f"{what} is not used: {reason}")
    except OSError as error:
        _warn_once(f"nothing can be kept in {what} ({error.strerror or error})")


def _place(name: str) -> Path:
    """Where a file is to be in the cache, in a directory that is made and trusted."""
    directory = cache_directory()
    path = directory / name
    _make(directory, 0o700)
    _check_place(directory, directory)
    _make(path.parent, stat.S_IMODE(os.stat(directory).st_mode) & 0o755)
    _check_place(path.parent, directory)
    return path


def make_for_all(directory: Path) -> None:
    """Make a cache directory that all may read, unless it is there."""
    with suppress(_UntrustedError):  # of which `write` will warn
        _make(directory, 0o755)


def there(name: str) -> bool:
    """Whether a file is in the cache, whatever it holds."""
    try:
        return (cache_directory() / name).is_file()
    except OSError:
        return False


def replace(path: Path, content: bytes) -> None:
    """Write a file under a temporary name and rename it, so that no reader sees half of it."""
    with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".tmp", delete=False) as file:
        try:
            file.write(content)
            file.close()
            os.chmod(file.name, 0o644)
            os.replace(file.name, path)
        except BaseException:
            file.close()
            Path(file.name).unlink(missing_ok=True)
            raise


def _make(directory: Path, mode: int) -> None:
    """Make a directory and those above it, where others cannot put theirs in its place."""
    if directory.is_dir():
        return
    _make(directory.parent, mode)
    _check_place(directory.parent, directory)
    try:
        directory.mkdir(mode)
        os.chmod(directory, mode)  # whatever masks the process has for its other files
    except FileExistsError:  # another process was sooner, or something is in the way
        if not directory.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR)) from None


# --- locks ----------------------------------------------------------------------------------------


@contextmanager
def alone(name: str, patience: float) -> Iterator[bool]:
    """Hold the lock of this name in the cache, if it can be had within so many seconds.

    Whether it is held is what the context gives; where nothing can be kept it never is. It is a
    file, and what one leaves behind that ended without removing it is nobody's.
    """
    try:
        path, end = _place(name), time.monotonic() + patience
    except (OSError, _UntrustedError):
        yield False
        return
    held = _take(path)
    while not held and time.monotonic() < end and path.exists():
        time.sleep(_STEP)
        held = _is_left(path) and _take(path)
    try:
        yield held
    finally:
        if held:
            _held.discard(path)
            with suppress(OSError):
                if _owner(path)[0] == str(os.getpid()):
                    path.unlink()


def claimed(name: str) -> bool:
    """Whether another process holds the lock of this name."""
    try:
        directory = cache_directory()
        path = directory / name
        _check_place(path.parent, directory)
        return path.exists() and not _is_left(path)
    except (OSError, _UntrustedError):
        return False


def renew() -> None:
    """Say that who holds locks goes on."""
    for path in tuple(_held):
        with suppress(OSError):
            os.utime(path)


def writable(name: str) -> bool:
    """Whether files can be kept in a directory of the cache, which is made."""
    try:
        place = _place(f"{name}/file").parent
        return os.access(place, os.W_OK | os.X_OK)
    except (OSError, _UntrustedError):
        return False


# seconds after which a lock is nobody's: of another machine, which is to renew it, and of this one
_LEFT, _EVER = 300.0, 86400.0
_STEP = 0.02  # between two looks at a lock
_held: set[Path] = set()


def _take(path: Path) -> bool:
    """Make the file of a lock, unless another process has."""
    if _is_left(path):
        with suppress(OSError):
            path.unlink()
    try:
        with open(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644), "w") as file:
            file.write(f"{os.getpid()} {platform.node()}")
    except OSError:  # there, or no place for it
        return False
    _held.add(path)
    return True


def _owner(path: Path) -> tuple[str, str]:
    """The number of the process that made a lock, and its machine."""
    with open(os.open(path, _FLAGS), "rb") as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise ValueError
        pid, _, host = file.read(300).decode().partition(" ")
    return pid, host


def _is_left(path: Path) -> bool:
    """Whether who made a lock has ended, or has had it for too long."""
    try:
        pid, host = _owner(path)
        age = time.time() - path.stat().st_mtime
    except (OSError, ValueError):
        return False
    if os.name != "posix" or host != platform.node() or not pid.isdigit():
        return age > _LEFT
    if age > _EVER:
        return True
    if int(pid) == os.getpid():  # of one before, with the same number
        return path not in _held
    try:
        os.kill(int(pid), 0)
    except (ProcessLookupError, OverflowError):
        return True
    except OSError:  # another user's
        pass
    return False


# --- trust ----------------------------------------------------------------------------------------


class _UntrustedError(Exception):
    """Says which file or directory others could have changed, and what to do about it."""


def _check_place(directory: Path, top: Path) -> None:
    """Raise `_UntrustedError` if others could change what is in a directory of the cache `top`."""
    os.stat(directory)  # links in a circle end here
    _check(directory.absolute(), 1 + len(directory.parts) - len(top.parts))


def _check(path: Path, inside: int) -> None:
    """Refuse a directory that others could change, by all steps on the way to it.

    So many of the last are the cache. Steps are taken from the root down, so that nobody can change
    what has been checked.
    """
    if path != path.parent:
        _check(path.parent, inside - 1)
    found = os.lstat(path)
    _check_one(path, found, shared=inside <= 0)
    if stat.S_ISLNK(found.st_mode):
        _check(path.parent / os.readlink(path), min(inside, 1))


def _check_one(path: Path, found: os.stat_result, shared: bool = False) -> None:
    """Raise `_UntrustedError` if one who is not trusted owns a file or directory, or may write it.

    If `shared`, all may write a directory such as ``/tmp``, where each has what is theirs.
    """
    if not hasattr(os, "geteuid"):
        return
    trusted = {os.geteuid(), 0, _package_owner()}
    if shared and _is_unmapped():
        trusted.add(_UNMAPPED)
    if found.st_uid not in trusted:
        raise _UntrustedError(
            f"{path} belongs to user {found.st_uid}, who is neither you ({os.geteuid()}), nor root,"
            " nor the owner of the installed package"
        )
    mode = stat.S_IMODE(found.st_mode)
    sticky = shared and mode & stat.S_ISVTX
    if mode & _OTHERS and not sticky and not stat.S_ISLNK(found.st_mode):
        who = "everybody" if mode & stat.S_IWOTH else "the group"
        raise _UntrustedError(
            f"{who} may write {path} (mode {mode:04o}, owner {found.st_uid}); "
            f"'chmod go-w {path}' takes that away"
        )


@lru_cache(maxsize=1)
def _package_owner() -> int:
    """The owner of the installed package, who could change its code as well."""
    try:
        return os.stat(__file__).st_uid
    except OSError:  # not a file of its own
        return 0


_UNMAPPED = 65534


@lru_cache(maxsize=1)
def _is_unmapped() -> bool:
    """Whether this user stands for all whom a container does not know, root of the host too.

    As the owner of ``/`` or ``/home`` it is no reason to do without a cache: who could put another
    directory in the place of the user's could not make it belong to the user.
    """
    try:
        lines = Path("/proc/self/uid_map").read_text().splitlines()
    except OSError:
        return False
    ranges = [tuple(map(int, line.split())) for line in lines]
    return not any(first <= _UNMAPPED < first + count for first, _, count in ranges)


_said: list[str] = []  # what the user has been warned of, one thing in a process


def _warn_once(what: str) -> None:
    if not _said:
        _said.append(what)
        warnings.warn(
            f"{what}. What is not in a cache, each process derives and compiles anew; "
            "LIMITSURF_CACHE_DIR names another place",
            RuntimeWarning,
            stacklevel=4,
        )


# --- arrays ---------------------------------------------------------------------------------------


def encoded(arrays: dict[str, Array], key: dict[str, Any], formats: Formats) -> bytes:
    """The bytes of a file of arrays: the same for the same arrays, everywhere."""
    members = {}
    for name, (kind, *_) in formats.items():
        buffer = io.BytesIO()
        array = np.asarray(arrays[name], dtype=kind, order="C")
        np.lib.format.write_array(buffer, array, version=(1, 0), allow_pickle=False)
        members[name + ".npy"] = buffer.getvalue()
    digest = hashlib.sha256(b"".join(members.values())).hexdigest()
    header = json.dumps({"key": key, "sha256": digest}, sort_keys=True, indent=1)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, content in {"key.json": header.encode(), **members}.items():
            member = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            member.create_system = 3
            archive.writestr(member, content)
    return buffer.getvalue()


def decoded(content: bytes, key: dict[str, Any], formats: Formats) -> dict[str, Array] | None:
    """The arrays of a file; None when it is not exactly what it should be."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            if any(member.compress_type != zipfile.ZIP_STORED for member in archive.infolist()):
                return None
            arrays = {
                name: np.lib.format.read_array(
                    io.BytesIO(archive.read(name + ".npy")), allow_pickle=False
                )
                for name in formats
            }
    except Exception:  # whatever a broken or foreign file makes the readers raise
        return None
    for name, (kind, shape, indices) in formats.items():
        array = arrays[name]
        if array.dtype.str != kind or not np.isfinite(array).all():
            return None
        if array.ndim != len(shape) or any(
            n not in (-1, m) for n, m in zip(shape, array.shape, strict=True)
        ):
            return None
        if indices is not None and not ((array >= indices.start) & (array < indices.stop)).all():
            return None
    # the key, the digest and all that a zip archive has room for
    return arrays if encoded(arrays, key, formats) == content else None


def most_bytes(formats: Formats) -> int:
    """More than a file of such arrays has."""
    shapes = [shape for _, shape, _ in formats.values()]
    longest = max(n for shape in shapes for n in shape)
    numbers = sum(prod(n if n >= 0 else longest for n in shape) for shape in shapes)
    return 8 * numbers + 1000 * len(shapes) + 100_000
