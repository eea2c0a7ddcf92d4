"""Queries, in batches, from files and generators: no more than a batch of them is in memory."""

from __future__ import annotations

import errno
import os
import re
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from glob import escape, glob, has_magic
from io import TextIOWrapper
from itertools import accumulate, chain, islice, pairwise
from typing import IO, Any, NoReturn, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf.scheme.lattice import Lattice
from limitsurf.shell import terminal
from limitsurf.shell.files import checked_suffix, needed, opened

Array: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]

NAMES = ("face", "u", "v")
BATCH = 1 << 18  # queries, or lines of CSV


@dataclass(frozen=True)
class Batch:
    """Some consecutive queries, face, u, v, all (n,), and where they come from."""

    face: IntArray
    u: Array
    v: Array
    name: str = ""
    first: int = 0  # row of the first of them in the whole input, or line of the first of `lines`
    lines: Sequence[str] = ()  # of CSV

    def place(self, k: int) -> str:
        """Where query k is from, for an error."""
        if not self.lines:
            return f"{self.name}: row {self.first + k}"
        with_query = (i for i, line in enumerate(self.lines) if _content(line))
        return f"{self.name}: line {self.first + next(islice(with_query, k, None))}"

    def checked(self, faces: int) -> Batch:
        """These queries, if all lie on one of so many limit faces; u and v may be NaN or infinite.

        Raises
        ------
        IndexError, ValueError
            With the place of the first that does not.
        """
        bad = (self.face < 0) | (self.face >= faces)
        if bad.any():
            k = int(bad.argmax())
            raise IndexError(
                f"{self.place(k)}: limit face {self.face[k]} is out of range: "
                f"there are {faces}, 0 to {faces - 1}"
            )
        for name, x in (("u", self.u), ("v", self.v)):
            bad = np.isfinite(x) & ((x < 0) | (x > 1))
            if bad.any():
                k = int(bad.argmax())
                raise ValueError(f"{self.place(k)}: {name} = {x[k]} is outside [0, 1]")
        return self


NOTHING = Batch(np.empty(0, np.int64), np.empty(0), np.empty(0))


@dataclass(frozen=True)
class Queries:
    """Batches of queries, at least one, and how many queries there are, if that is known.

    From a file of which any process can read a part, `rows(start, stop)` does so.
    """

    batches: Iterable[Batch]
    total: int | None
    rows: Callable[[int, int], Batch] | None = None


class Column(Protocol):
    """What an array has that is used of it. Slices are taken in order."""

    @property
    def shape(self) -> tuple[int, ...]:
        """As that of an array."""
        ...

    @property
    def dtype(self) -> Any:
        """As that of an array."""
        ...

    def __getitem__(self, rows: slice, /) -> Any: ...


Columns: TypeAlias = Mapping[str, Column]


@contextmanager
def reading(path: str | os.PathLike[str]) -> Iterator[Queries]:
    """Read queries from a file, while the context lasts.

    Parameters
    ----------
    path : str or os.PathLike
        ``.csv``: comma-separated lines of face, u, v, or any columns under a header that names
        these three; empty lines and comments after ``#`` are skipped. ``.npz``: arrays face, u and
        v of shape (n,). ``.npy``: an array of shape (n, 3), or a structured one with these fields.
        ``.parquet``: columns of these names, in a file, in all such files below a directory, or in
        those that a pattern with ``*`` matches, part.2 before part.10. ``.zarr``: a group of arrays
        as in ``.npz``, or one array of shape (n, 3). "-" is CSV from the standard input.

    Yields
    ------
    Queries

    Raises
    ------
    ValueError
        An unknown suffix, or a file that is not as described; the message names the file and the
        first bad line, or the row, counted from 0 over the whole input. What is wrong in a batch is
        raised when it is reached. Ranges are not checked here.
    OSError
        A file that cannot be read.
    ImportError
        Without PyArrow or Zarr, if it is needed.
    """
    name = os.fspath(path)
    if name == "-":
        yield _from_csv("standard input", terminal.standard_input())
        return
    suffix = checked_suffix(name)
    with ExitStack() as stack:
        if suffix == ".parquet":
            yield _from_parquet(name)
        elif suffix == ".zarr":
            yield _from_columns(name, _zarr_columns(name), _zarr_columns)
        elif suffix == ".csv":
            text = TextIOWrapper(stack.enter_context(opened(name)), encoding="utf-8")
            yield _from_csv(name, text)
        else:
            file = stack.enter_context(opened(name))
            again = None
            with _understood(name, "NumPy"):
                if file.read(2) == b"PK":
                    columns = _npz_columns(name, file, stack)
                else:
                    columns, again = _npy_columns(name), _npy_columns
            yield _from_columns(name, columns, again)


def grid_queries(faces: int, n: int, lattice: Lattice) -> Queries:
    """The centres of n x n equal cells of each limit face; no two of these points coincide."""
    if faces * n * n >= 2**63:
        raise ValueError(f"a grid of {n} x {n} on {faces} limit faces has too many points")

    # of the cell at corner 0
    x, y = np.mean(lattice.corners, axis=0)

    def batches() -> Iterator[Batch]:
        for start, stop in spans(faces * n * n, BATCH):
            face, cell = np.divmod(np.arange(start, stop), n * n)
            i, j = np.divmod(cell, n)
            yield Batch(face, *_folded((i + x) / n, (j + y) / n, lattice))

    return Queries(batches(), faces * n * n)


def random_queries(faces: int, n: int, seed: int, lattice: Lattice) -> Queries:
    """Uniform in limit face, u and v; the same for the same seed, whatever the batches."""

    def batches() -> Iterator[Batch]:
        # one stream of random bits gives all faces, then all u, then all v
        for_face, for_u, for_v = (np.random.default_rng(seed) for _ in range(3))
        for start, stop in spans(n, BATCH):
            for_u.integers(faces, size=stop - start)
        for_v.bit_generator.state = for_u.bit_generator.state
        for_v.bit_generator.advance(n)  # type: ignore[attr-defined]
        for start, stop in spans(n, BATCH):
            size = stop - start
            face, u, v = for_face.integers(faces, size=size), for_u.random(size), for_v.random(size)
            yield Batch(face, *_folded(u, v, lattice))

    return Queries(batches(), n)


def _folded(u: Array, v: Array, lattice: Lattice) -> tuple[Array, Array]:
    """Places of the unit square, those beyond a triangle turned into it by half a turn."""
    beyond = (u + v > 1) & lattice.sloped
    return np.where(beyond, 1 - u, u), np.where(beyond, 1 - v, v)


def spans(total: int, size: int) -> Iterator[tuple[int, int]]:
    """Where batches of a size start and end; at least one."""
    for start in range(0, max(total, 1), size):
        yield start, min(start + size, total)


@contextmanager
def _understood(name: str, kind: str) -> Iterator[None]:
    """Say of what a library cannot read that it is no such file.

    Of a broken one a library can raise anything: NumPy reads headers as Python, for one.
    """
    try:
        yield
    except ImportError:
        raise
    except Exception as error:
        if str(error).startswith(f"{name}: "):
            raise
        said = " ".join(str(error).split())[:200] or type(error).__name__
        raise ValueError(f"{name}: no {kind} file of numbers ({said})") from None


# ---------------------------------------------------------------------------------------- CSV


def _from_csv(name: str, file: Iterable[str]) -> Queries:
    lines = iter(file)
    before: list[str] = []  # lines before the first query
    with _text(name):
        for line in lines:
            line = line.removeprefix("\ufeff") if not before else line
            before.append(line)
            if _content(line):
                break
        else:
            raise ValueError(f"{name}: empty, need lines of face,u,v")
    names = [cell.strip().strip('"').lower() for cell in _content(line).split(",")]
    if twice := [wanted for wanted in NAMES if names.count(wanted) > 1]:
        raise ValueError(
            f"{name}: line {len(before)}: there are {names.count(twice[0])} columns named "
            f"{twice[0]!r}, need one"
        )
    if set(NAMES) <= set(names):
        columns = [names.index(wanted) for wanted in NAMES]
        start, rest = len(before) + 1, lines
    elif len(names) == 3:
        columns = [0, 1, 2]
        start, rest = len(before), chain([line], lines)
    else:
        raise ValueError(
            f"{name}: line {len(before)}: need face,u,v or a header with these names,"
            f" got {_shortened(line)!r}"
        )
    return Queries(_csv_batches(name, rest, start, columns), None)


def _csv_batches(name: str, rest: Iterator[str], start: int, columns: list[int]) -> Iterator[Batch]:
    """Batches of what is in the lines from number `start` on."""
    kinds = [("face", np.int64), ("u", np.float64), ("v", np.float64)]
    found = False
    while True:
        with _text(name):
            lines = list(islice(rest, BATCH))
        if not lines:
            break
        if any(map(_content, lines)):
            found = True
            try:
                table = np.loadtxt(lines, dtype=kinds, delimiter=",", usecols=columns, ndmin=1)
            except ValueError as error:
                for k, line in enumerate(lines, start):
                    if _content(line) and not _is_query(_content(line), columns):
                        raise ValueError(
                            f"{name}: line {k}: need a whole number and two numbers for face, u, v,"
                            f" got {_shortened(line)!r}"
                        ) from None
                raise ValueError(f"{name}: {error}") from None
            face, u, v = (table[key].copy() for key in NAMES)
            yield Batch(face, u, v, name, start, lines)
        start += len(lines)
    if not found:
        yield NOTHING


@contextmanager
def _text(name: str) -> Iterator[None]:
    try:
        yield
    except UnicodeDecodeError:
        raise ValueError(f"{name}: no text, need lines of face,u,v") from None


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
    text = text.rstrip("\r\n")
    return text if len(text) <= 40 else text[:37] + "..."


# ------------------------------------------------------------------------- columns of numbers


def _from_columns(
    name: str, columns: Columns, again: Callable[[str], Columns] | None = None
) -> Queries:
    """Queries from columns, and by rows if the columns can be had again from the name alone."""
    _refuse_missing(name, columns)
    face, u, v = (columns[key] for key in NAMES)
    if any(len(x.shape) != 1 for x in (face, u, v)) or not face.shape == u.shape == v.shape:
        shapes = ", ".join(str(columns[key].shape) for key in NAMES)
        raise ValueError(f"{name}: face, u and v must be of one shape (n,), got {shapes}")
    kinds = [columns[key].dtype for key in NAMES]
    if any(kind.kind not in "iuf" for kind in kinds):
        _refuse_kinds(name, kinds)
    (total,) = face.shape
    return Queries(
        (_rows(name, columns, *span) for span in spans(total, BATCH)),
        total,
        None if again is None else partial(_rows_again, again, os.path.abspath(name)),
    )


def _rows(name: str, columns: Columns, start: int, stop: int) -> Batch:
    with _understood(name, "whole"):
        found = [columns[key][start:stop] for key in NAMES]
    return _converted(name, start, *found)


def _rows_again(again: Callable[[str], Columns], name: str, start: int, stop: int) -> Batch:
    return _rows(name, again(name), start, stop)


def _refuse_missing(name: str, columns: Iterable[str]) -> None:
    found = list(columns)
    if missing := [key for key in NAMES if key not in found]:
        raise ValueError(f"{name}: {missing[0]!r} is missing, need face, u and v")
    if twice := [key for key in NAMES if found.count(key) > 1]:
        raise ValueError(f"{name}: there are several columns named {twice[0]!r}, need one")


def _refuse_kinds(name: str, kinds: Iterable[Any]) -> NoReturn:
    raise ValueError(f"{name}: face, u and v must be numbers, got {', '.join(map(str, kinds))}")


def _converted(name: str, first: int, face: Any, u: Any, v: Any) -> Batch:
    whole = (face >= -(2.0**63)) & (face < 2.0**63)
    if face.dtype.kind == "f":
        whole &= np.floor(face) == face
    if not whole.all():
        k = int(np.argmin(whole))
        raise ValueError(f"{name}: row {first + k}: face must be a whole number, got {face[k]}")
    return Batch(
        face.astype(np.int64), u.astype(np.float64), v.astype(np.float64), name=name, first=first
    )


def _npz_columns(name: str, file: IO[bytes], stack: ExitStack) -> Columns:
    archive = stack.enter_context(zipfile.ZipFile(file))
    inside = [key for key in NAMES if f"{key}.npy" in archive.namelist()]
    return {key: _Member(name, archive, f"{key}.npy", stack) for key in inside}


def _npy_columns(name: str) -> Columns:
    content = np.lib.format.open_memmap(name, mode="r")
    if named := content.dtype.names:
        return {key: content[key] for key in named}
    return _three_columns(name, content)


def _three_columns(name: str, content: Any) -> Columns:
    if len(content.shape) != 2 or content.shape[1] != 3:
        raise ValueError(f"{name}: need shape (n, 3) for face, u, v, got {content.shape}")
    return {key: _Nth(content, k) for k, key in enumerate(NAMES)}


class _Nth:
    """Column k of an array (n, 3) that may be in a file."""

    def __init__(self, whole: Any, k: int) -> None:
        self.whole, self.k = whole, k
        self.shape, self.dtype = whole.shape[:1], whole.dtype

    def __getitem__(self, rows: slice) -> Any:
        return self.whole[rows, self.k]


class _Member:
    """An array in a NPZ file, read from its beginning on."""

    def __init__(self, name: str, archive: zipfile.ZipFile, key: str, stack: ExitStack) -> None:
        self.file = stack.enter_context(archive.open(key))
        version = np.lib.format.read_magic(self.file)
        header = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }.get(version)
        if header is None:
            raise ValueError(f"{name}: {key} is of version {version}, need (1, 0) or (2, 0)")
        self.shape, _, self.dtype = header(self.file)

    def __getitem__(self, rows: slice) -> Any:
        size = (rows.stop - rows.start) * self.dtype.itemsize
        content = self.file.read(size)
        if len(content) != size:
            raise EOFError("it ends early")
        return np.frombuffer(content, self.dtype)


def _zarr_columns(name: str) -> Columns:
    zarr = needed("zarr", "Zarr")
    if not os.path.exists(name):
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), name)
    with _understood(name, "Zarr"):
        content = zarr.open(name, mode="r")
    if isinstance(content, zarr.Array):
        return _three_columns(name, content)
    return {key: content[key] for key in NAMES if key in content}


# ------------------------------------------------------------------------------------- Parquet


def _from_parquet(name: str) -> Queries:
    parquet, types = needed("pyarrow.parquet", "Parquet"), needed("pyarrow.types", "Parquet")
    paths, sizes = _parquet_paths(name), []
    for path in paths:
        with opened(path) as file, _understood(path, "Parquet"):
            content = parquet.ParquetFile(file)
            schema = content.schema_arrow
            _refuse_missing(path, schema.names)
            kinds = [schema.field(key).type for key in NAMES]
            if not all(types.is_integer(kind) or types.is_floating(kind) for kind in kinds):
                _refuse_kinds(path, kinds)
            sizes.append(content.metadata.num_rows)
    firsts = [0, *accumulate(sizes)]

    def batches() -> Iterator[Batch]:
        first = 0
        for path in paths:
            with opened(path) as file:
                tables = parquet.ParquetFile(file).iter_batches(BATCH, columns=list(NAMES))
                while True:
                    with _understood(path, "whole Parquet"):
                        table = next(tables, None)
                    if table is None:
                        break
                    found = (table[key].to_numpy(zero_copy_only=False) for key in NAMES)
                    yield _converted(name, first, *found)
                    first += table.num_rows
        if first == 0:
            yield NOTHING

    whole = [os.path.abspath(path) for path in paths]
    return Queries(batches(), firsts[-1], partial(_parquet_rows, name, whole, firsts))


def _parquet_rows(
    name: str, paths: Sequence[str], firsts: Sequence[int], start: int, stop: int
) -> Batch:
    """Some rows of all, from the groups of rows that have them; `firsts` is where files begin."""
    parquet = needed("pyarrow.parquet", "Parquet")
    found = [[NOTHING.face, NOTHING.u, NOTHING.v]]
    for path, (first, end) in zip(paths, pairwise(firsts), strict=True):
        if end <= start or first >= stop:
            continue
        with opened(path) as file, _understood(path, "whole Parquet"):
            content = parquet.ParquetFile(file)
            groups = range(content.num_row_groups)
            sizes = [content.metadata.row_group(k).num_rows for k in groups]
            bounds = list(pairwise(accumulate(sizes, initial=first)))
            inside = [k for k in groups if bounds[k][1] > start and bounds[k][0] < stop]
            table = content.read_row_groups(inside, columns=list(NAMES))
            begin = bounds[inside[0]][0]
            table = table.slice(max(start - begin, 0), min(stop, end) - max(start, begin))
            found.append([table[key].to_numpy() for key in NAMES])
    face, u, v = map(np.concatenate, zip(*found, strict=True))
    return _converted(name, start, face, u, v)


def _parquet_paths(name: str) -> list[str]:
    """The file, or the files in the directory, or those that match the pattern."""
    if os.path.isdir(name):
        paths = glob(os.path.join(escape(name), "**", "*.parquet"), recursive=True)
    elif has_magic(name) and not os.path.exists(name):
        paths = glob(name)
    else:
        return [name]
    if not paths:
        raise FileNotFoundError(errno.ENOENT, "There are no Parquet files", name)
    # text and numbers in turn, so that part.2 comes before part.10
    words = {path: re.split(r"(\d+)", path) for path in filter(os.path.isfile, paths)}
    return sorted(
        words, key=lambda path: [int(x) if k % 2 else x for k, x in enumerate(words[path])]
    )
