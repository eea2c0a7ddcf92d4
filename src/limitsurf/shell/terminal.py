"""What a person sees on a terminal: tables, progress, and errors and warnings in one line."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from limitsurf.surface import LimitSurface

ROUNDING = 1e-12  # of the largest coordinate; what refinement adds up stays far below


def sentence(error: BaseException) -> str:
    """An error as one line."""
    text = str(error)
    if isinstance(error, OSError) and error.strerror:
        text = error.strerror if error.filename is None else f"{error.filename}: {error.strerror}"
    elif isinstance(error, click.ClickException):
        text = error.format_message()
    return " ".join(text.split()) or type(error).__name__


@contextmanager
def warnings_in_one_line() -> Iterator[None]:
    """Say warnings as this program, without the place in its source."""

    def say(message: Warning | str, *_: Any, **__: Any) -> None:
        click.echo(f"limitsurf: warning: {' '.join(str(message).split())}", err=True)

    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        warnings.showwarning = say
        yield


@contextmanager
def counting(text: str, total: int | None, quiet: bool = False) -> Iterator[Callable[[int], None]]:
    """A progress bar on stderr, unless it is to be quiet; the function takes how many more are
    done. Without a total it shows how many are.
    """
    from rich import progress
    from rich.console import Console

    console = Console(stderr=True)
    columns = (
        progress.TextColumn("{task.description}"),
        progress.BarColumn(),
        progress.TextColumn("{task.completed:,.0f}"),
        progress.TimeElapsedColumn(),
        progress.TimeRemainingColumn(),
    )
    with progress.Progress(
        *columns, console=console, transient=True, disable=quiet or not console.is_terminal
    ) as bar:
        task = bar.add_task(text, total=total)
        yield lambda more: bar.advance(task, more)


@contextmanager
def working(text: str) -> Iterator[None]:
    """A sign of life on stderr while something takes its time."""
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal:
        yield
        return
    with console.status(text):
        yield


def say_table(rows: Iterable[tuple[str, ...]], names: Iterable[str] | None = None) -> None:
    """A table on stdout: numbers to the right under their names, or else a list of facts."""
    lines = list(rows)
    head = [] if names is None else [tuple(names)]
    widths = [max(map(len, column)) for column in zip(*head, *lines, strict=True)]
    for k, line in enumerate(head + lines):
        pad = str.rjust if head else str.ljust
        text = "   ".join(map(pad, line, widths)).rstrip()
        click.echo(click.style(text, bold=True) if head and k == 0 else text)


def say_validation(surface: LimitSurface, table: NDArray[Any]) -> bool:
    """The table that ``validate`` returns; whether its limit errors are rounding alone."""
    names = [name.replace("_", " ") for name in table.dtype.names or ()]
    say_table([tuple(map(_short, row)) for row in table.tolist()], names)
    points = surface.mesh.points[surface.mesh.indices]
    # NaN, where no vertex has a limit, is no disagreement.
    return not table["limit_error"].max() > ROUNDING * np.abs(points).max()


def _short(value: float) -> str:
    if isinstance(value, int):
        return str(value)
    return "" if np.isnan(value) else f"{value:.3g}"


def histogram(values: NDArray[np.int64]) -> str:
    """How often each value occurs, such as "3 (8 times), 4 (20)"."""
    kinds, counts = np.unique(values, return_counts=True)
    times = [f"{kind} ({count})" for kind, count in zip(kinds, counts, strict=True)]
    return ", ".join([times[0].replace(")", " times)"), *times[1:]])


def sharpness(values: NDArray[Any]) -> str:
    """How many there are, of which sharpness, such as "5, sharpness 0.5 to 2, 3 infinite"."""
    from limitsurf.tables import is_infinite

    finite = values[~is_infinite(values)]
    parts = [f"{len(values)}"]
    if len(finite):
        low, high = f"{finite.min():g}", f"{finite.max():g}"
        parts.append(f"sharpness {low}" + (f" to {high}" if high != low else ""))
    if len(finite) < len(values):
        parts.append(f"{len(values) - len(finite)} infinite" if len(finite) else "infinite")
    return ", ".join(parts)
