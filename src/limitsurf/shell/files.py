"""Output files that appear whole or not at all."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO, Any


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
