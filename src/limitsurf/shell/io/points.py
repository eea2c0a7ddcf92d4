"""Points in space, in batches, from files: no more than a batch of them is in memory."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterable, Iterator
from itertools import chain, islice

import numpy as np
from numpy.typing import NDArray

from limitsurf.shell import terminal
from limitsurf.shell.files import opened

AXES = ("x", "y", "z")
BATCH = 1 << 16  # points
SUFFIXES = (".csv", ".npy", ".npz")

Array = NDArray[np.float64]


def batches(path: str) -> Iterator[Array]:
    """Points (n, 3) from a file, some at a time; at least one batch, which may be empty.

    Parameters
    ----------
    path : str
        ``.csv``: comma-separated lines of x, y, z, or any columns under a header that names these
        three; empty lines and comments after ``#`` are skipped. ``.npy``: an array of shape
        (n, 3), or one with fields x, y, z, or position of three numbers. ``.npz``: arrays of these
        names. "-" is CSV from the standard input.

    Raises
    ------
    ValueError
        For an unknown suffix, or a file that is not as described, with its first bad line.
    OSError
        For a file that cannot be read.
    """
    if path == "-":
        yield from _from_csv("standard input", terminal.standard_input())
        return
    suffix = os.path.splitext(path)[1].lower()
    if suffix not in SUFFIXES:
        need = ", ".join(SUFFIXES)
        raise ValueError(f"{path}: unknown suffix {suffix!r} of points, need one of {need}")
    with opened(path) as file:
        if suffix == ".csv":
            lines = (line.decode("utf-8", "replace") for line in file)
            yield from _from_csv(path, lines)
            return
        try:
            known = np.load(file, allow_pickle=False)
            if suffix == ".npz":
                inside = {name: known[name] for name in ("position", *AXES) if name in known.files}
            elif known.dtype.names:
                inside = {name: known[name] for name in known.dtype.names}
            else:
                inside = {"position": known}
        except (ValueError, EOFError, AttributeError, zipfile.BadZipFile) as error:
            # NumPy takes whatever it does not know for a pickle, and says how to load that
            why = "" if "pickle" in str(error) else f" ({error})"
            raise ValueError(f"{path}: no NumPy file of numbers{why}") from None
    points = inside.get("position")
    if points is None:
        if missing := [axis for axis in AXES if axis not in inside]:
            raise ValueError(f"{path}: {missing[0]!r} is missing, need x, y and z, or position")
        shapes = [np.shape(inside[axis]) for axis in AXES]
        if len(set(shapes)) > 1:
            raise ValueError(f"{path}: x, y and z must be of one shape, got {shapes}")
        points = np.stack([inside[axis] for axis in AXES], axis=-1)
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "iuf":
        raise ValueError(
            f"{path}: need numbers of shape (n, 3), got {points.dtype} of shape {points.shape}"
        )
    for start in range(0, max(len(points), 1), BATCH):
        yield points[start : start + BATCH].astype(float)


def _from_csv(name: str, file: Iterable[str]) -> Iterator[Array]:
    lines, start, first = iter(file), 0, ""
    for first in lines:
        start += 1
        if _content(first):
            break
    else:
        raise ValueError(f"{name}: empty, need lines of x,y,z")
    names = [cell.strip().strip('"').lower() for cell in _content(first).split(",")]
    if set(AXES) <= set(names):
        columns, rest = [names.index(axis) for axis in AXES], lines
        start += 1
    elif len(names) == 3:
        columns, rest = [0, 1, 2], chain([first], lines)
    else:
        raise ValueError(
            f"{name}: line {start}: need x,y,z or a header with these names, got {first.strip()!r}"
        )
    found = False
    while some := list(islice(rest, BATCH)):
        full = [(start + k, line) for k, line in enumerate(some) if _content(line)]
        start += len(some)
        if full:
            found = True
            yield np.array([_numbers(name, k, line, columns) for k, line in full])
    if not found:
        yield np.zeros((0, 3))


def _content(line: str) -> str:
    return line.removeprefix("\ufeff").partition("#")[0].strip()


def _numbers(name: str, k: int, line: str, columns: list[int]) -> list[float]:
    """The numbers in line k."""
    cells = _content(line).split(",")
    try:
        return [float(cells[column]) for column in columns]
    except (ValueError, IndexError):
        raise ValueError(
            f"{name}: line {k}: need three numbers for x, y, z, got {line.strip()[:40]!r}"
        ) from None
