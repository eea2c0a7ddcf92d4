"""Queries answered on a Dask cluster, whose workers read and write the files themselves."""

from __future__ import annotations

import os
import re
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from limitsurf.shell.files import checked_suffix, needed, replacing_folder
from limitsurf.shell.io.answers import Parquet, Question, Zarr, answered
from limitsurf.shell.io.queries import BATCH, Batch, Queries, spans

if TYPE_CHECKING:
    from limitsurf.surface import LimitSurface

TASK = 4 * BATCH  # queries of a task; whole chunks of a Zarr array
WAIT = 10  # seconds, for a scheduler and its first worker


def evaluate(
    address: str,
    surface: LimitSurface,
    queries: Queries,
    question: Question,
    path: str | os.PathLike[str],
    done: Callable[[int], None],
) -> None:
    """Answer queries on the cluster of a scheduler, into a directory that appears whole or not.

    Each worker receives the surface once. Workers see the same files under the same names as this
    process. Parquet is written as one file, part.000000.parquet, ..., for each `TASK` of queries.

    Raises
    ------
    IndexError, ValueError
        For a query out of range; the first such of all tasks.
    OSError
        Without an answer from the scheduler, or for files that a worker does not see.
    ImportError
        Without Dask.
    """
    rows, total = queries.rows, queries.total
    assert rows is not None
    assert total is not None
    with _client(address) as client, replacing_folder(path) as folder:
        if checked_suffix(path) == ".zarr":
            (sample,) = answered(surface, [rows(0, min(1, total))], question)
            Zarr(folder, total).make(sample)
        shared = client.scatter([surface, rows], hash=False)
        ahead = 2 * sum(client.nthreads().values())
        asked: deque[Any] = deque()
        try:
            for k, (start, stop) in enumerate(spans(total, TASK)):
                task = question, folder, k, start, stop
                asked.append(client.submit(_answer, *shared, *task, pure=False))
                if len(asked) > ahead:
                    done(asked.popleft().result())
            while asked:
                done(asked.popleft().result())
        finally:
            client.gather(list(asked), errors="skip")  # nobody shall write to what is removed


def _answer(
    surface: LimitSurface,
    rows: Callable[[int, int], Batch],
    question: Question,
    folder: str,
    k: int,
    start: int,
    stop: int,
) -> int:
    """Answer task k, of some rows, and say how many they are, on a worker."""
    for answers in answered(surface, [rows(start, stop)], question):
        if os.path.exists(os.path.join(folder, "zarr.json")):
            Zarr(folder, mode="r+").put(answers, start)
        else:
            name = os.path.join(folder, f"part.{k:06}.parquet")
            with open(name, "wb") as file, Parquet(file) as write:
                write(answers)
    return stop - start


@contextmanager
def _client(address: str) -> Iterator[Any]:
    distributed = needed("distributed", "a cluster")
    if not re.search(r":\d+$", address):
        raise ValueError(
            f"{address}: need the address of a Dask scheduler, such as tcp://127.0.0.1:8786"
        )
    with distributed.Client(address, timeout=WAIT, set_as_default=False) as client:
        client.wait_for_workers(1, timeout=WAIT)
        yield client
