"""Queries and answers as files: CSV, NPZ and NPY."""

from __future__ import annotations

import errno
import math
import os
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import IO, TYPE_CHECKING, Any, TypeAlias
from zipfile import BadZipFile

import click
import numpy as np
from numpy.typing import NDArray

from limitsurf.shell.files import replacing

if TYPE_CHECKING:
    from limitsurf.surface import LimitSurface

Array: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
Queries: TypeAlias = tuple[IntArray, Array, Array]  # face, u, v, all (n,)
Answers: TypeAlias = dict[str, NDArray[Any]]  # face, u, v (n,), then (n, channels) each

SUFFIXES = (".csv", ".npz", ".npy")
NAMES = ("face", "u", "v")
OWN = "face|[uv]|position|normal|d[uv]+"  # names of answers, which no channel can have
BATCH = 1 << 17  # queries between two signs of progress
LINES = 1 << 14  # of CSV written at a time


def read_queries(path: str | os.PathLike[str]) -> Queries:
    """Read queries from a file.

    Parameters
    ----------
    path : str or os.PathLike
        ``.csv``: comma-separated lines of face, u, v, or any columns under a header that names
        these three; empty lines and comments after ``#`` are skipped. ``.npz``: arrays face, u and
        v of shape (n,). ``.npy``: an array of shape (n, 3), or a structured one with these fields.
        "-" is CSV from the standard input.

    Returns
    -------
    face : ndarray of int64, shape (n,)
    u, v : ndarray of float64, shape (n,)

    Raises
    ------
    ValueError
        An unknown suffix, or a file that is not as described; the message names the file and the
        first bad line or row. Ranges are not checked here.
    OSError
        A file that cannot be read.
    """
    name = os.fspath(path)
    if name == "-":
        return _from_csv("standard input", sys.stdin.read())
    suffix = checked_suffix(name)
    with open(name, "rb") as file:
        if suffix == ".csv":
            try:
                return _from_csv(name, file.read().decode("utf-8-sig"))
            except UnicodeDecodeError:
                raise ValueError(f"{name}: no text, need lines of face,u,v") from None
        return _from_numpy(name, file)


def grid_queries(faces: int, n: int) -> Queries:
    """The centres of n x n equal cells of each limit face; no two of these points coincide."""
    at = (np.arange(n) + 0.5) / n
    face, u, v = np.broadcast_arrays(np.arange(faces)[:, None, None], at[:, None], at)
    return face.ravel(), u.ravel(), v.ravel()


def random_queries(faces: int, n: int, seed: int) -> Queries:
    """Uniform in limit face, u and v; the same for the same seed."""
    rng = np.random.default_rng(seed)
    return rng.integers(faces, size=n), rng.random(n), rng.random(n)


def evaluate(
    surface: LimitSurface,
    queries: Queries,
    order: int,
    normals: bool,
    done: Callable[[int], None],
    channels: Sequence[str] = (),
) -> Answers:
    """Positions, derivatives up to an order and normals, by name: position, du, dv, duu, ...

    Those of face-varying channels have the channel's name: uv, uv_du, ... ``done`` is told how many
    more queries have their answer.
    """
    face, u, v = queries
    answers: Answers = {"face": face, "u": u, "v": v}
    for start in range(0, max(len(face), 1), BATCH):
        part = slice(start, start + BATCH)
        try:
            jet = surface.jet(face[part], u[part], v[part], order=order)
        except (IndexError, ValueError):
            surface.jet(face, u, v, order=0)  # fails too, and counts from the first query of all
            raise
        found = {_name(nu): values for nu, values in jet.items()}
        if normals:
            found["normal"] = surface.normal(face[part], u[part], v[part])
        for channel in dict.fromkeys(channels):
            jet = surface.jet(face[part], u[part], v[part], order=order, channel=channel)
            for nu, values in jet.items():
                name = f"{channel}_{_name(nu)}" if any(nu) else channel
                if name in found or re.fullmatch(OWN, name):
                    raise ValueError(f"channel {channel!r}: there are other answers named {name!r}")
                found[name] = values
        for name, values in found.items():
            answers.setdefault(name, np.empty((len(face), *values.shape[1:])))[part] = values
        done(len(face[part]))
    return answers


def write_answers(path: str | os.PathLike[str] | None, answers: Answers) -> None:
    """Write answers to a file, which appears whole or not at all, or as CSV to the standard output.

    NPZ and NPY hold arrays and fields named as in ``evaluate``. The columns of CSV are face, u, v,
    x, y, z, then x_u, y_u, z_u, x_v, ..., and n_x, n_y, n_z, and of a channel uv_0, uv_1, uv_du_0,
    ...; numbers are the shortest decimals that give the same float64.
    """
    if path is None:
        for text in _csv(answers):
            click.echo(text, nl=False)
        return
    suffix = checked_suffix(path)
    with replacing(path, "w" if suffix == ".csv" else "wb") as file:
        if suffix == ".csv":
            file.writelines(_csv(answers))
        elif suffix == ".npz":
            np.savez(file, **answers)  # type: ignore[arg-type]
        else:
            np.save(file, _structured(answers))


def check_target(path: str | os.PathLike[str]) -> None:
    """Refuse early what ``write_answers`` would refuse when all is evaluated."""
    checked_suffix(path)
    folder = os.path.dirname(os.path.realpath(path))
    if not os.path.isdir(folder):
        raise FileNotFoundError(errno.ENOENT, "No such directory", folder)
    if os.path.isdir(path):
        raise IsADirectoryError(errno.EISDIR, "Is a directory", os.fspath(path))


def checked_suffix(path: str | os.PathLike[str]) -> str:
    suffix = os.path.splitext(os.fspath(path))[1].lower()
    if suffix not in SUFFIXES:
        need = ", ".join(SUFFIXES)
        raise ValueError(f"{os.fspath(path)}: unknown suffix {suffix!r}, need one of {need}")
    return suffix


def _from_csv(name: str, text: str) -> Queries:
    lines = text.splitlines()
    head = next((k for k, line in enumerate(lines) if _content(line)), None)
    if head is None:
        raise ValueError(f"{name}: empty, need lines of face,u,v")
    names = [cell.strip().strip('"').lower() for cell in _content(lines[head]).split(",")]
    if set(NAMES) <= set(names):
        columns = [names.index(wanted) for wanted in NAMES]
        head += 1
    elif len(names) == 3:
        columns = [0, 1, 2]
    else:
        raise ValueError(
            f"{name}: line {head + 1}: need face,u,v or a header with these names,"
            f" got {_shortened(lines[head])!r}"
        )
    if not any(_content(line) for line in lines[head:]):
        return np.empty(0, np.int64), np.empty(0), np.empty(0)
    kinds = [("face", np.int64), ("u", np.float64), ("v", np.float64)]
    try:
        table = np.loadtxt(lines[head:], dtype=kinds, delimiter=",", usecols=columns, ndmin=1)
    except ValueError as error:
        for k, line in enumerate(lines[head:], head + 1):
            if _content(line) and not _is_query(_content(line), columns):
                raise ValueError(
                    f"{name}: line {k}: need a whole number and two numbers for face, u, v,"
                    f" got {_shortened(line)!r}"
                ) from None
        raise ValueError(f"{name}: {error}") from None
    return table["face"].copy(), table["u"].copy(), table["v"].copy()


def _content(line: str) -> str:
    return line.partition("#")[0].strip()


def _is_query(line: str, columns: list[int]) -> bool:
    cells = line.split(",")
    try:
        face, u, v = (cells[k] for k in columns)
        np.int64(int(face)), float(u), float(v)
    except (IndexError, ValueError, OverflowError):
        return False
    return True


def _shortened(text: str) -> str:
    return text if len(text) <= 40 else text[:37] + "..."


def _from_numpy(name: str, file: IO[bytes]) -> Queries:
    try:
        content = np.load(file, allow_pickle=False)
        if isinstance(content, np.ndarray):
            named = content.dtype.names
            columns = {key: content[key] for key in named} if named else None
        else:
            columns = {key: content[key] for key in content.files if key in NAMES}
    except (ValueError, EOFError, OSError, BadZipFile) as error:
        raise ValueError(f"{name}: no NumPy file of numbers ({error})") from None
    if columns is None:
        if content.ndim != 2 or content.shape[1] != 3:
            raise ValueError(f"{name}: need shape (n, 3) for face, u, v, got {content.shape}")
        columns = dict(zip(NAMES, content.T, strict=True))
    if missing := [key for key in NAMES if key not in columns]:
        raise ValueError(f"{name}: {missing[0]!r} is missing, need face, u and v")
    face, u, v = (columns[key] for key in NAMES)
    if not face.ndim == u.ndim == v.ndim == 1 or not len(face) == len(u) == len(v):
        shapes = ", ".join(str(columns[key].shape) for key in NAMES)
        raise ValueError(f"{name}: face, u and v must be of one shape (n,), got {shapes}")
    if any(column.dtype.kind not in "iuf" for column in (face, u, v)):
        kinds = ", ".join(str(columns[key].dtype) for key in NAMES)
        raise ValueError(f"{name}: face, u and v must be numbers, got {kinds}")
    whole = (face >= -(2.0**63)) & (face < 2.0**63)
    if face.dtype.kind == "f":
        whole &= np.floor(face) == face
    if not whole.all():
        row = int(np.argmin(whole))
        raise ValueError(f"{name}: row {row}: face must be a whole number, got {face[row]}")
    return face.astype(np.int64), u.astype(np.float64), v.astype(np.float64)


def _name(nu: tuple[int, int]) -> str:
    return "d" + "u" * nu[0] + "v" * nu[1] if any(nu) else "position"


def _structured(answers: Answers) -> NDArray[Any]:
    fields = [(name, values.dtype, values.shape[1:]) for name, values in answers.items()]
    table = np.empty(len(answers["face"]), dtype=fields)
    for name, values in answers.items():
        table[name] = values
    return table


def _csv(answers: Answers) -> Iterator[str]:
    """Pieces of text. A list of tuples is one call to print, with the shortest digits; NumPy's own
    writer makes a call a line."""
    columns: dict[str, NDArray[Any]] = {name: answers[name] for name in NAMES}
    for name in [name for name in answers if name not in NAMES]:
        values = answers[name].reshape(len(answers[name]), math.prod(answers[name].shape[1:]))
        if re.fullmatch(OWN, name):
            pattern = {"position": "{}", "normal": "n_{}"}.get(name, "{}_" + name[1:])
            heads = [pattern.format(axis) for axis in "xyz"]
        else:
            heads = [f"{name}_{k}" for k in range(values.shape[1])]
        columns |= dict(zip(heads, values.T, strict=True))
    yield ",".join(columns) + "\n"
    kinds = [(name, values.dtype) for name, values in columns.items()]
    for start in range(0, len(answers["face"]), LINES):
        part = slice(start, start + LINES)
        table = np.empty(len(answers["face"][part]), dtype=kinds)
        for name, values in columns.items():
            table[name] = values[part]
        yield repr(table.tolist())[2:-2].replace("), (", "\n").replace(", ", ",") + "\n"
