"""What a person sees on a terminal: tables, progress, and errors and warnings in one line."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import click


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

    def say(message: Warning | str, *_: Any) -> None:
        click.echo(f"limitsurf: warning: {' '.join(str(message).split())}", err=True)

    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        warnings.showwarning = say
        yield


@contextmanager
def counting(text: str, total: int) -> Iterator[Callable[[int], None]]:
    """A progress bar on stderr; the function takes how many more are done."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(text, total=total)
        yield lambda more: progress.advance(task, more)


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


def say_table(columns: list[str], rows: Iterable[Iterable[str]]) -> None:
    """A table on stdout, numbers to the right; without names of columns a list of facts."""
    from rich.console import Console
    from rich.table import Table

    named = any(columns)
    table = Table(box=None, show_header=named, pad_edge=False, padding=(0, 2 if named else 3, 0, 0))
    for name in columns:
        table.add_column(name, justify="right" if named else "left", overflow="fold")
    for row in rows:
        table.add_row(*row)
    # A file or a pipe has no width to fold at.
    Console(highlight=False, width=None if sys.stdout.isatty() else 1000).print(table)
