"""What a person sees on a terminal: tables, progress, and errors and warnings in one line."""

from __future__ import annotations

import errno
import io
import json
import logging
import os
import re
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from types import FrameType
from typing import TYPE_CHECKING, Any, TextIO

import click
import numpy as np
from numpy.typing import NDArray

from limitsurf.shell import files

if TYPE_CHECKING:
    from rich.console import Console

# of the library that commands have by the same name
OPTIONS = ("boundary", "creasing", "prim", "scheme", "triangles")
STANDARD_OUTPUT = "standard output"
GRACE = 1.0  # seconds


def sentence(error: BaseException) -> str:
    """An error as one line."""
    text = str(error)
    if isinstance(error, OSError) and error.strerror:
        text = error.strerror if error.filename is None else f"{error.filename}: {error.strerror}"
    elif isinstance(error, click.ClickException):
        text = error.format_message()
    elif isinstance(error, MemoryError):
        text = f"not enough memory. {text}"
    return as_options(" ".join(text.split())) or type(error).__name__


def as_options(text: str) -> str:
    """A message of the library, in which options are named as on the command line.

    Examples
    --------
    >>> from limitsurf.shell.terminal import as_options
    >>> as_options('say scheme="catmull-clark", or read a part, prim="/a"')
    'say --scheme catmull-clark, or read a part, --prim /a'
    """
    return re.sub(rf'\b({"|".join(OPTIONS)})="([^"\s]*)"', r"--\1 \2", text)


@contextmanager
def warnings_in_one_line() -> Iterator[None]:
    """Say warnings as this program, without the place in its source."""

    def say_warning(message: Warning | str, *_: Any, **__: Any) -> None:
        text = as_options(" ".join(str(message).split()))
        click.echo(f"limitsurf: warning: {text}", err=True)

    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        warnings.showwarning = say_warning
        yield


# ---------------------------------------------------------------------------- streams, signals


@contextmanager
def orderly() -> Iterator[None]:
    """Let the process meet its end, and its streams, as programs on a command line do.

    SIGTERM and SIGHUP become a `SystemExit` with 128 plus their number, so that temporary files go
    with it. Python handles signals between its own steps alone: where a library is amid a long one
    of its own, the process ends all the same, after `GRACE`, without those files. What a library
    swallows of this, being in a callback, comes once more. What the standard output cannot encode
    is escaped. Descriptors 0 to 2, if closed, are occupied: else the next file opened would be
    written as the standard output. Matplotlib's notes on its cache of fonts, which a new machine
    fills and a full disk cannot hold, concern nobody.
    """
    logging.getLogger("matplotlib.font_manager").setLevel(logging.ERROR)
    _occupy_descriptors()
    if reconfigure := getattr(sys.stdout, "reconfigure", None):
        reconfigure(errors="backslashreplace")
    noticed = threading.Event()
    handlers = _usual_handlers()

    def end(number: int, frame: FrameType | None) -> None:
        while frame is not None and os.name == "posix":
            if frame.f_code.co_filename.startswith("<frozen importlib"):
                return  # libraries crash if one of their modules fails: left to the watch
            frame = frame.f_back
        noticed.set()
        if number == signal.SIGINT:
            raise KeyboardInterrupt
        raise SystemExit(128 + number)

    def notice(lost: Any) -> None:
        number: int | None = None
        if issubclass(lost.exc_type, KeyboardInterrupt):
            number = signal.SIGINT
        if issubclass(lost.exc_type, SystemExit) and isinstance(lost.exc_value.code, int):
            number = next((n for n in handlers if lost.exc_value.code == 128 + n), None)
        if number is not None and hasattr(signal, "pthread_kill"):
            again = threading.main_thread().ident, number
            threading.Timer(0.1, signal.pthread_kill, again).start()
        else:
            before(lost)

    before, sys.unraisablehook = sys.unraisablehook, notice
    for number in handlers:
        signal.signal(number, end)
    try:
        with _watched(noticed, handlers):
            yield
    finally:
        sys.unraisablehook = before
        for number, handler in handlers.items():
            signal.signal(number, handler)


def _occupy_descriptors() -> None:
    """Open those of descriptors 0 to 2 that are closed, on nothing."""
    for standard in range(3):
        try:
            os.fstat(standard)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number


def _usual_handlers() -> dict[int, Any]:
    """The handlers of signals that end a process, of those that nobody has changed.

    There are none outside of the main thread, where they cannot be set.
    """
    if threading.current_thread() is not threading.main_thread():
        return {}
    names = ("SIGTERM", "SIGHUP", "SIGINT")
    caught = [getattr(signal, name) for name in names if hasattr(signal, name)]
    usual = (signal.SIG_DFL, signal.default_int_handler)
    return {n: signal.getsignal(n) for n in caught if signal.getsignal(n) in usual}


@contextmanager
def _watched(noticed: threading.Event, numbers: Collection[int]) -> Iterator[None]:
    """End the process `GRACE` after a signal of these numbers that Python has not noticed."""
    if not numbers or os.name != "posix":
        yield
        return
    read, write = os.pipe()
    os.set_blocking(write, False)
    before = signal.set_wakeup_fd(write, warn_on_full_buffer=False)

    def watch() -> None:
        while number := os.read(read, 1)[0]:  # 0 is no signal, but the end of the watch
            if number in numbers and not noticed.wait(GRACE):
                files.remove_unfinished()
                os._exit(128 + number)
            noticed.clear()

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        os.write(write, b"\0")
        watcher.join()
        os.close(write)
        os.close(read)


@contextmanager
def standard_output() -> Iterator[TextIO]:
    """The standard output; errors of writing name it."""
    if sys.stdout is None:
        raise OSError(errno.EBADF, "It is closed", STANDARD_OUTPUT)
    try:
        sys.stdout.flush()
        yield sys.stdout
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        if error.filename is not None:
            raise
        # what is still to be written would fail again at the end
        sys.stdout = io.StringIO()
        raise OSError(error.errno, error.strerror, STANDARD_OUTPUT) from None


def standard_input() -> TextIO:
    """The standard input."""
    if sys.stdin is None:
        raise OSError(errno.EBADF, "It is closed", "standard input")
    return sys.stdin


def say(text: object = "", nl: bool = True) -> None:
    """Text on the standard output."""
    with standard_output():
        click.echo(text, nl=nl)


def say_json(value: Any) -> None:
    """A value as JSON on the standard output, NaN and infinity as null."""
    say(json.dumps(_plain(value), indent=2, allow_nan=False))


def say_json_lines(values: Iterable[Any]) -> None:
    """Several values as JSON on the standard output, one in each line."""
    lines = [json.dumps(_plain(value), allow_nan=False) + "\n" for value in values]
    say("".join(lines), nl=False)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int) else str(value)


# ------------------------------------------------------------------------------------ progress


def _console() -> Console | None:
    """The terminal at the standard error, if it can be written to in place."""
    if sys.stderr is None or not sys.stderr.isatty():
        return None
    if os.environ.get("TERM", "dumb") in ("", "dumb", "unknown") and os.name != "nt":
        return None
    from rich.console import Console

    return Console(stderr=True)


@contextmanager
def counting(text: str, total: int | None, quiet: bool = False) -> Iterator[Callable[[int], None]]:
    """A progress bar on stderr, unless it is to be quiet.

    The function that it gives takes how many more are done. Without a total the bar shows how many
    there are.
    """
    console = None if quiet else _console()
    if console is None:
        yield lambda _: None
        return
    from rich import progress

    columns = (
        progress.TextColumn("{task.description}"),
        progress.BarColumn(),
        progress.TextColumn("{task.completed:,.0f}"),
        progress.TimeElapsedColumn(),
        progress.TimeRemainingColumn(),
    )
    with progress.Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(text, total=total)
        yield lambda more: bar.advance(task, more)


@contextmanager
def working(text: str) -> Iterator[None]:
    """A sign of life on stderr while something takes its time."""
    console = _console()
    with nullcontext() if console is None else console.status(text):
        yield


# -------------------------------------------------------------------------------------- tables


def say_table(
    rows: Iterable[tuple[str, ...]],
    names: Iterable[str] | None = None,
    left: Collection[int] = (),
) -> None:
    """A table on stdout: under names, or else a list of facts.

    Under names, columns stand to the right but for those in `left`.
    """
    lines = list(rows)
    head = [] if names is None else [tuple(names)]
    widths = [max(map(len, column)) for column in zip(*head, *lines, strict=True)]
    pads = [str.ljust if not head or k in left else str.rjust for k in range(len(widths))]
    text = [
        "   ".join(
            pad(cell, width) for pad, cell, width in zip(pads, line, widths, strict=True)
        ).rstrip()
        for line in head + lines
    ]
    if head and "NO_COLOR" not in os.environ and os.environ.get("TERM", "dumb") != "dumb":
        text[0] = click.style(text[0], bold=True)
    say("\n".join(text))


def say_validation(table: NDArray[Any]) -> None:
    """The table that ``validate`` returns."""
    names = [name.replace("_", " ") for name in table.dtype.names or ()]
    say_table([tuple(map(_short, row)) for row in table.tolist()], names)


def validation_rows(table: NDArray[Any]) -> list[dict[str, Any]]:
    """The table that ``validate`` returns as objects, one for each level."""
    return [dict(zip(table.dtype.names or (), row, strict=True)) for row in table.tolist()]


def _short(value: float) -> str:
    if isinstance(value, int):
        return str(value)
    return "" if np.isnan(value) else f"{value:.3g}"


def histogram(values: NDArray[np.int64]) -> str:
    """How often each value occurs, such as "3 (8 times), 4 (20)"."""
    kinds, counts = np.unique(values, return_counts=True)
    return times(dict(zip(kinds.tolist(), counts.tolist(), strict=True)))


def times(counts: Mapping[Any, int]) -> str:
    """How often there is what, such as "3 (8 times), 4 (20)"."""
    first, *others = (f"{kind} ({count})" for kind, count in counts.items())
    return ", ".join([first.replace(")", " times)"), *others])
