"""Output files that appear whole or not at all, and the formats of queries and answers."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import IO, Any

SUFFIXES = (".csv", ".npz", ".npy", ".parquet", ".zarr")


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
    name = os.path.realpath(os.fspath(path))
    if os.path.exists(name) and not os.path.isfile(name):
        with open(name, mode, **text) as file:
            yield file
        return
    folder, base = os.path.split(name)
    temporary = os.path.join(folder, f".{base}.{secrets.token_hex(8)}")
    try:
        file = open(temporary, mode.replace("w", "x"), **text)  # noqa: SIM115
    except OSError as error:
        raise type(error)(error.errno, error.strerror, os.fspath(path)) from None
    try:
        with file:
            yield file
        if os.path.exists(name):
            shutil.copymode(name, temporary)
        os.replace(temporary, name)
    except BaseException:
        if os.path.exists(temporary):
            os.remove(temporary)
        raise


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
    folder, base = os.path.split(name)
    temporary, old = (os.path.join(folder, f".{base}.{secrets.token_hex(8)}") for _ in range(2))
    try:
        os.mkdir(temporary)
    except OSError as error:
        raise type(error)(error.errno, error.strerror, os.fspath(path)) from None
    try:
        yield temporary
        if os.path.lexists(name):
            os.rename(name, old)
        os.rename(temporary, name)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        if os.path.lexists(old) and not os.path.lexists(name):
            os.rename(old, name)
        raise
    shutil.rmtree(old, ignore_errors=True)
