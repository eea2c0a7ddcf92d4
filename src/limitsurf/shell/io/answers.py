"""Answers to batches of queries, and files that take them one batch after the other."""

from __future__ import annotations

import errno
import io
import math
import os
import re
import shutil
import tempfile
import zipfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import IO, TYPE_CHECKING, Any, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf.shell import files, terminal
from limitsurf.shell.files import checked_suffix, needed, replacing, replacing_folder
from limitsurf.shell.io.queries import BATCH, NAMES, Batch

if TYPE_CHECKING:
    from limitsurf.surface import LimitSurface

Answers: TypeAlias = dict[str, NDArray[Any]]  # face, u, v (n,), then (n, channels) each
Write: TypeAlias = Callable[[Answers], None]

OWN = "face|[uv]|position|normal|d[uv]+"  # names of answers, which no channel can have
PLAIN = ("distance", "ray", "t", "multiplicity")  # of one number each
LINES = 1 << 14  # of CSV written at a time


@dataclass(frozen=True)
class Question:
    """What is asked of every query: derivatives up to an order, normals, channels.

    `workers` is how many threads are to answer.
    """

    order: int = 0
    normals: bool = False
    channels: Sequence[str] = ()
    workers: int = 1

    def __call__(self, surface: LimitSurface, face: Any, u: Any, v: Any) -> Answers:
        """Arrays by name: position, du, dv, duu, ..., normal; of channels uv, uv_du, ..."""
        jet = surface.jet(face, u, v, order=self.order, workers=self.workers)
        found = {_name(nu): values for nu, values in jet.items()}
        if self.normals:
            found["normal"] = surface.normal(face, u, v, workers=self.workers)
        for channel in dict.fromkeys(self.channels):
            jet = surface.jet(face, u, v, order=self.order, channel=channel, workers=self.workers)
            for nu, values in jet.items():
                name = f"{channel}_{_name(nu)}" if any(nu) else channel
                if name in found or re.fullmatch(OWN, name):
                    raise ValueError(f"channel {channel!r}: there are other answers named {name!r}")
                found[name] = values
        return found


def answered(
    surface: LimitSurface, queries: Iterable[Batch], question: Question
) -> Iterator[Answers]:
    """Queries with their answers, batch by batch.

    Raises
    ------
    IndexError, ValueError
        For a query out of range, when its batch is reached; it names the line or row.
    """
    for batch in queries:
        batch.checked(len(surface.limit_faces))
        where = {"face": batch.face, "u": batch.u, "v": batch.v}
        yield {**where, **question(surface, **where)}


@contextmanager
def writing(
    path: str | os.PathLike[str] | None, total: int | None = None, as_json: bool = False
) -> Iterator[Write]:
    """A function that writes batches of answers to a file, or else to the standard output.

    There they are CSV, or, `as_json`, objects of arrays named as in `Question`, one in each line.

    The file appears whole, when the context ends without an error, or not at all. NPZ and Zarr hold
    arrays, NPY fields named as in `Question`. The columns of CSV and Parquet are face, u, v, x, y,
    z, then x_u, y_u, z_u, x_v, ..., and n_x, n_y, n_z, and of a channel uv_0, uv_1, uv_du_0, ...;
    numbers in CSV are the shortest decimals that give the same float64. Where the number of queries
    is known, as `total`, NPY can go to a pipe.
    """
    suffix = ".csv" if path is None else checked_suffix(path)
    with ExitStack() as stack:
        if path is None and as_json:
            yield _json_lines
        elif path is None:
            yield _CSV(lambda text: terminal.say(text, nl=False))
        elif suffix == ".csv":
            yield _CSV(stack.enter_context(replacing(path, "w")).write)
        elif suffix == ".zarr":
            yield Zarr(stack.enter_context(replacing_folder(path)), total)
        elif suffix == ".parquet":
            yield stack.enter_context(Parquet(stack.enter_context(replacing(path))))
        else:
            file = stack.enter_context(replacing(path))
            write = _NPY(file, total) if suffix == ".npy" else _NPZ(file, total, stack)
            yield write
            write.finish()


def check_target(path: str | os.PathLike[str], as_folder: bool = False) -> None:
    """Refuse early what `writing`, or a cluster into a directory, would refuse at the end."""
    suffix = checked_suffix(path)
    name = os.path.realpath(path)
    if suffix == ".parquet":
        needed("pyarrow", "Parquet")
    if suffix == ".zarr":
        needed("zarr", "Zarr")
    if not (as_folder or suffix == ".zarr"):
        files.check_target(path)
        return
    files.check_folder(os.path.dirname(name))
    if os.path.lexists(name) and not _is_replaceable(name, suffix):
        raise FileExistsError(errno.EEXIST, "There is something else", os.fspath(path))


def _is_replaceable(name: str, suffix: str) -> bool:
    """Whether a path is a directory of nothing but answers."""
    if not os.path.isdir(name):
        return False
    inside = os.listdir(name)
    if suffix == ".parquet":
        return all(name.endswith(suffix) for name in inside)
    return not {"zarr.json", ".zgroup", ".zarray"}.isdisjoint(inside)


class _NPY:
    """Rows of one array, whose number is put into the header in the end."""

    def __init__(self, file: IO[bytes], total: int | None = None) -> None:
        self.file, self.promised, self.rows = file, total or 0, 0
        self.head = b""

    def __call__(self, answers: Answers) -> None:
        fields = [(name, values.dtype, values.shape[1:]) for name, values in answers.items()]
        table = np.empty(len(answers["face"]), dtype=fields)
        for name, values in answers.items():
            table[name] = values
        self.append(table)

    def append(self, values: NDArray[Any]) -> None:
        """Write rows behind those that there are."""
        if not self.head:
            head = io.BytesIO()
            np.lib.format.write_array(head, values[:0], allow_pickle=False)
            self.head = head.getvalue()
            self.file.write(self._header(self.promised))
        if values.size:
            self.file.write(np.ascontiguousarray(values).view(np.uint8).data)
        self.rows += len(values)

    def finish(self) -> None:
        """Write the number of rows, once it is known."""
        if self.rows != self.promised:
            self.file.seek(0)
            self.file.write(self._header(self.rows))

    def _header(self, rows: int) -> bytes:
        """Of an array with so many rows; NumPy leaves spaces before the end for the digits."""
        before, shape, after = self.head.rpartition(b"'shape': (0,")
        number = b"%d" % rows
        return before + shape[:-2] + number + b"," + after[: -len(number)] + b"\n"


class _NPZ:
    """Arrays, each in a file without a name until all are whole."""

    def __init__(self, file: IO[bytes], total: int | None, stack: ExitStack) -> None:
        self.file, self.total, self.stack = file, total, stack
        # where there is room for the archive, there should be for its parts
        self.folder = os.path.dirname(file.name) if os.path.isfile(file.name) else None
        self.arrays: dict[str, _NPY] = {}

    def __call__(self, answers: Answers) -> None:
        for name, values in answers.items():
            if name not in self.arrays:
                file = tempfile.TemporaryFile(dir=self.folder)  # noqa: SIM115
                self.arrays[name] = _NPY(self.stack.enter_context(file), self.total)
            self.arrays[name].append(values)

    def finish(self) -> None:
        """Write the archive of all arrays."""
        with zipfile.ZipFile(self.file, "w") as archive:
            for name, array in self.arrays.items():
                array.finish()
                array.file.seek(0)
                info = zipfile.ZipInfo(f"{name}.npy")  # of the same date, always
                with archive.open(info, "w", force_zip64=True) as member:
                    shutil.copyfileobj(array.file, member, 1 << 20)


class Zarr:
    """A group of arrays in a directory, of `total` rows, or as many as come."""

    def __init__(self, path: str, total: int | None = None, mode: str = "w") -> None:
        self.group = needed("zarr", "Zarr").open_group(path, mode=mode)
        self.total, self.rows = total or 0, 0

    def __call__(self, answers: Answers) -> None:
        """Write a batch."""
        if self.rows == 0:
            self.make(answers)
        self.put(answers, self.rows)
        self.rows += len(answers["face"])

    def make(self, answers: Answers) -> None:
        """Arrays for such answers."""
        for name, values in answers.items():
            shape = values.shape[1:]
            self.group.create_array(
                name, shape=(self.total, *shape), chunks=(BATCH, *shape), dtype=values.dtype
            )

    def put(self, answers: Answers, start: int) -> None:
        """Write rows from one on; at once only where chunks differ."""
        stop = start + len(answers["face"])
        for name, values in answers.items():
            array = self.group[name]
            if array.shape[0] < stop:
                array.resize((stop, *values.shape[1:]))
            array[start:stop] = values


class Parquet:
    """A table in a file, a group of rows a batch."""

    def __init__(self, file: IO[bytes]) -> None:
        self.file = file
        self.writer: Any = None

    def __call__(self, answers: Answers) -> None:
        """Write a batch."""
        arrow, parquet = (needed(name, "Parquet") for name in ("pyarrow", "pyarrow.parquet"))
        table = arrow.table({k: np.ascontiguousarray(x) for k, x in _columns(answers).items()})
        if self.writer is None:
            # few numbers come twice
            self.writer = parquet.ParquetWriter(self.file, table.schema, use_dictionary=False)
        self.writer.write_table(table)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self.writer is not None:
            self.writer.close()


class _CSV:
    """Lines, under a line of names."""

    def __init__(self, write: Callable[[str], Any]) -> None:
        self.write, self.begun = write, False

    def __call__(self, answers: Answers) -> None:
        columns = _columns(answers)
        if not self.begun:
            self.write(",".join(columns) + "\n")
            self.begun = True
        # a list of tuples is one call to print, with the shortest digits; NumPy's own writer makes
        # a call a line
        kinds = [(name, values.dtype) for name, values in columns.items()]
        for start in range(0, len(answers["face"]), LINES):
            rows = slice(start, start + LINES)
            table = np.empty(len(answers["face"][rows]), dtype=kinds)
            for name, values in columns.items():
                table[name] = values[rows]
            self.write(repr(table.tolist())[2:-2].replace("), (", "\n").replace(", ", ",") + "\n")


def _json_lines(answers: Answers) -> None:
    """Objects on the standard output, one in each line."""
    for start in range(0, len(answers["face"]), LINES):
        columns = (values[start : start + LINES].tolist() for values in answers.values())
        terminal.say_json_lines(
            dict(zip(answers, row, strict=True)) for row in zip(*columns, strict=True)
        )


def _columns(answers: Answers) -> dict[str, NDArray[Any]]:
    """Columns of numbers, (n,) each, by name."""
    columns = {name: answers[name] for name in NAMES}
    for name in [name for name in answers if name not in NAMES]:
        if name in PLAIN and answers[name].ndim == 1:
            columns[name] = answers[name]
            continue
        values = answers[name].reshape(len(answers[name]), math.prod(answers[name].shape[1:]))
        if re.fullmatch(OWN, name):
            pattern = {"position": "{}", "normal": "n_{}"}.get(name, "{}_" + name[1:])
            heads = [pattern.format(axis) for axis in "xyz"]
        else:
            heads = [f"{name}_{k}" for k in range(values.shape[1])]
        columns |= dict(zip(heads, values.T, strict=True))
    return columns


def _name(nu: tuple[int, int]) -> str:
    return "d" + "u" * nu[0] + "v" * nu[1] if any(nu) else "position"
