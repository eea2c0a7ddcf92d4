"""Rows of numbers, such as points in space, in batches from files, of which one is in memory."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, islice

import numpy as np
from numpy.typing import NDArray

from limitsurf.shell import terminal
from limitsurf.shell.files import opened

AXES = ("x", "y", "z")
BATCH = 1 << 16  # rows
SUFFIXES = (".csv", ".npy", ".npz")
_WORDS = {3: "three", 6: "six"}

Array = NDArray[np.float64]


def batches(path: str, names: Sequence[str] = AXES) -> Iterator[Array]:
    """Rows (n, k) of numbers from a file, some at a time; at least one batch, which may be empty.

    Parameters
    ----------
    path : str
        ``.csv``: comma-separated lines of k numbers, under names or not, or any columns under a
        header that has all of `names`; empty lines and comments after ``#`` are skipped. ``.npy``:
        an array of shape (n, k), or one with fields of these names, or, of three, ``position`` of
        three numbers. ``.npz``: arrays of these names. "-" is CSV from the standard input.
    names : sequence of str
        Of the k columns.

    Raises
    ------
    ValueError
        For an unknown suffix, or a file that is not as described, with its first bad line.
    OSError
        For a file that cannot be read.
    """
    if path == "-":
        yield from _from_csv("standard input", terminal.standard_input(), names)
        return
    suffix = os.path.splitext(path)[1].lower()
    if suffix not in SUFFIXES:
        need = ", ".join(SUFFIXES)
        raise ValueError(f"{path}: unknown suffix {suffix!r} of rows, need one of {need}")
    with opened(path) as file:
        if suffix == ".csv":
            lines = (line.decode("utf-8", "replace") for line in file)
            yield from _from_csv(path, lines, names)
            return
        try:
            known = np.load(file, allow_pickle=False)
            if suffix == ".npz":
                inside = {name: known[name] for name in ("position", *names) if name in known.files}
            elif known.dtype.names:
                inside = {name: known[name] for name in known.dtype.names}
            else:
                inside = {"position": known}
        except (ValueError, EOFError, AttributeError, zipfile.BadZipFile) as error:
            # NumPy takes whatever it does not know for a pickle, and says how to load that
            why = "" if "pickle" in str(error) else f" ({error})"
            raise ValueError(f"{path}: no NumPy file of numbers{why}") from None
    rows = inside.get("position")
    if rows is None:
        listed = f"{', '.join(names[:-1])} and {names[-1]}"
        if missing := [name for name in names if name not in inside]:
            more = ", or position" if len(names) == len(AXES) else ""
            raise ValueError(f"{path}: {missing[0]!r} is missing, need {listed}{more}")
        shapes = [np.shape(inside[name]) for name in names]
        if len(set(shapes)) > 1:
            raise ValueError(f"{path}: {listed} must be of one shape, got {shapes}")
        rows = np.stack([inside[name] for name in names], axis=-1)
    if rows.ndim != 2 or rows.shape[1] != len(names) or rows.dtype.kind not in "iuf":
        need = f"(n, {len(names)})"
        got = f"got {rows.dtype} of shape {rows.shape}"
        raise ValueError(f"{path}: need numbers of shape {need}, {got}")
    for start in range(0, max(len(rows), 1), BATCH):
        yield rows[start : start + BATCH].astype(float)


def _from_csv(name: str, file: Iterable[str], names: Sequence[str]) -> Iterator[Array]:
    lines, start, first = iter(file), 0, ""
    for first in lines:
        start += 1
        if _content(first):
            break
    else:
        raise ValueError(f"{name}: empty, need lines of {','.join(names)}")
    cells = [cell.strip().strip('"').lower() for cell in _content(first).split(",")]
    columns, rest = list(range(len(names))), lines
    if set(names) <= set(cells):
        columns = [cells.index(each) for each in names]
        start += 1
    elif len(cells) != len(names):
        need = f"need {','.join(names)} or a header with these names"
        raise ValueError(f"{name}: line {start}: {need}, got {first.strip()!r}")
    elif any(map(_is_number, cells)):
        rest = chain([first], lines)
    else:  # other names
        start += 1
    found = False
    while some := list(islice(rest, BATCH)):
        full = [(start + k, line) for k, line in enumerate(some) if _content(line)]
        start += len(some)
        if full:
            found = True
            yield np.array([_numbers(name, k, line, columns, names) for k, line in full])
    if not found:
        yield np.zeros((0, len(names)))


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _content(line: str) -> str:
    return line.removeprefix("\ufeff").partition("#")[0].strip()


def _numbers(name: str, k: int, line: str, columns: list[int], names: Sequence[str]) -> list[float]:
    """The numbers in line k."""
    cells = _content(line).split(",")
    try:
        return [float(cells[column]) for column in columns]
    except (ValueError, IndexError):
        need = f"need {_WORDS.get(len(names), len(names))} numbers for {', '.join(names)}"
        raise ValueError(f"{name}: line {k}: {need}, got {line.strip()[:40]!r}") from None
