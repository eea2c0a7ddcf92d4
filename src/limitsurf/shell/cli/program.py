"""What all commands share: how they fail, how they name cages and meshes, and how they report."""

from __future__ import annotations

import errno
import os
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, wraps
from io import BytesIO
from typing import IO, TYPE_CHECKING, Any, TypeVar

import click

import limitsurf as ls
from limitsurf.cage.mesh import BOUNDARY, CREASING, TRIANGLES
from limitsurf.shell import files, terminal
from limitsurf.shell.cli.own import OF_SCHEME, SCHEME

if TYPE_CHECKING:
    from limitsurf.cage.mesh import Mesh
    from limitsurf.query import Tessellation
    from limitsurf.surface import LimitSurface

Command = TypeVar("Command", bound=Callable[..., Any])

# What a user can cause; anything else is a defect of the program and shows its traceback.
ERRORS = (ValueError, OSError, IndexError, ImportError, MemoryError)
PATH = click.Path(readable=False)  # whether it can be read is seen when it is
DASHED = "limitsurf.dashed"  # of a context: files with names that begin with -
RULE = "By default as the cage says."
TEXT = (".obj", ".off", ".usda")  # suffixes of formats that a terminal can show


class Program(click.Group):
    """Errors in one line with exit code 2; 130 after Ctrl-C, 1 when the reader goes away."""

    def main(self, *args: Any, **extra: Any) -> Any:
        """Run a command, and end the process with its exit code."""
        options = {**extra, "prog_name": "limitsurf", "standalone_mode": False}
        try:
            with terminal.orderly(), terminal.warnings_in_one_line():
                code = super().main(*args, **options)
        except (click.Abort, KeyboardInterrupt):
            code = 130
        except (click.ClickException, *ERRORS) as error:
            click.echo(f"limitsurf: error: {terminal.sentence(error)}{_advice(error)}", err=True)
            code = 2
        if not extra.get("standalone_mode", True):
            return code
        raise SystemExit(code)

    def invoke(self, context: click.Context) -> Any:
        """Run a command, which Ctrl-C ends quietly."""
        try:
            return super().invoke(context)
        except KeyboardInterrupt:
            raise click.Abort from None  # where click would start a line

    def list_commands(self, context: click.Context) -> list[str]:
        """Names of commands, not by the alphabet, but as one meets them."""
        return list(self.commands)

    def resolve_command(
        self, context: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command of the first argument; if there is none, advice on what may be meant."""
        name = args[0]
        if name not in self.commands and not name.startswith("-"):
            from difflib import get_close_matches

            advice = "limitsurf --help lists all"
            if near := get_close_matches(name.lower(), self.commands, n=1):
                advice = f"did you mean {near[0]}?"
            elif os.path.exists(name) or os.path.splitext(name)[1]:
                advice = f"a command comes before a cage, as in: limitsurf info {name}"
            context.fail(f"there is no command {name!r}: {advice}")
        dashed = [word for word in args if word.startswith("-") and os.path.exists(word)]
        context.meta[DASHED] = dashed
        return super().resolve_command(context, args)


def _advice(error: BaseException) -> str:
    """What more to say of an option that is none, if it is the name of a file."""
    if isinstance(error, click.NoSuchOption) and error.ctx is not None:
        for name in error.ctx.meta.get(DASHED, ()):
            return f" For the file of this name, say ./{name}"
    return ""


@dataclass(frozen=True)
class Cage:
    """Where a cage is read from, and the rules it is subdivided by."""

    path: str
    suffix: str | None
    rules: Mapping[str, Any]  # for `LimitSurface` and `refined`
    asked: Mapping[str, Any]  # what else `ls.read` takes: prim, time, merge, strict
    chosen: Sequence[str] = ()  # faces, each as NAME=VALUE

    def read(self) -> Mesh:
        """The cage, or the faces of it that are chosen."""
        mesh = self._read()
        if not self.chosen:
            return mesh
        wanted: dict[str, list[Any]] = {}
        for name, value in (text.split("=", 1) for text in self.chosen):
            data = mesh.face_data.get(name)
            kind = "U" if data is None else data.dtype.kind
            wanted.setdefault(name, []).append(_value(name, value, kind))
        return ls.selected(mesh, wanted)

    def _read(self) -> Mesh:
        with terminal.working("reading the cage"), warnings.catch_warnings():
            for rule in (rule for rule, value in self.rules.items() if value is not None):
                # the choice is made: nothing is left to differ in
                warnings.filterwarnings("ignore", rf".*: its meshes differ in {rule}:", UserWarning)
            if self.path == "-":
                return ls.read(self._input, suffix=self.suffix or ".obj", **self.asked)
            if self.suffix is None:
                self._check_suffix()
            return ls.read(self.path, suffix=self.suffix, **self.asked)

    @cached_property
    def _input(self) -> IO[bytes]:
        """The standard input, in memory if it is one of those files that are read again."""
        from limitsurf.shell.io.formats import USD

        file: IO[bytes] = terminal.standard_input().buffer
        if self.suffix not in (*USD, ".usdz"):
            return file
        return BytesIO(b"".join(files.blocks(file, "<stdin>")))

    def schemes(self) -> dict[str, str] | None:
        """Once it is read: the scheme of each mesh of a USD file by its path; else None."""
        from limitsurf.shell.io.by_suffix import schemes
        from limitsurf.shell.io.formats import USD

        file: Any = self.path
        if (self.suffix or os.path.splitext(file)[1].lower()) not in (*USD, ".usdz"):
            return None
        if file == "-":
            file = self._input
            file.seek(0)
        asked = {name: self.asked[name] for name in ("prim", "time")}
        return schemes(file, suffix=self.suffix, **asked)

    def _check_suffix(self) -> None:
        """Say more than `ls.read` can, of a name that does not tell the format."""
        from limitsurf.shell.io.formats import READABLE, library

        suffix = os.path.splitext(self.path)[1].lower()
        if suffix in READABLE or not os.path.exists(self.path) or library(suffix):
            return
        if os.path.isdir(self.path):
            raise IsADirectoryError(errno.EISDIR, "Is a directory", self.path)
        known = " ".join(READABLE)
        raise click.UsageError(
            f"{self.path}: unknown suffix {suffix!r}; name the format with --from, one of {known}"
        )

    def surface(self, channels: Sequence[str] = ()) -> LimitSurface:
        """The surface of the cage, which must have these channels."""
        mesh = self.read()
        for name in channels:
            if name not in mesh.channels:
                known = ", ".join(map(repr, mesh.channels)) or "none"
                raise click.UsageError(f"the cage has no channel {name!r}; it has {known}")
        with terminal.working("building the surface"):
            return ls.LimitSurface(mesh, **self.rules)


def _value(name: str, text: str, kind: str) -> str | float:
    """What a text says, as one of data of faces: text, truth, or a number."""
    if kind == "U":
        return text
    if kind == "b" and text.lower() in ("true", "false"):
        return text.lower() == "true"
    for number in (int, float):
        with suppress(ValueError):
            return number(text)
    need = "true or false" if kind == "b" else "a number"
    raise click.UsageError(f"--select {name}: need {need}, got {text!r}") from None


def _assignments(_: click.Context, __: click.Parameter, given: Sequence[str]) -> Sequence[str]:
    """What is given, if each is of a name and a value."""
    for text in given:
        if "=" not in text:
            raise click.BadParameter(f"need NAME=VALUE, as in group=lid, got {text!r}")
    return given


def _normal_suffix(_: click.Context, __: click.Parameter, given: str | None) -> str | None:
    """A suffix as file names have it, from "ply", ".ply" or "PLY"."""
    return None if given is None else f".{given.lower().removeprefix('.')}"


def _readable(_: click.Context, __: click.Parameter, begun: str) -> list[str]:
    from limitsurf.shell.io.formats import READABLE

    return [suffix for suffix in READABLE if suffix.startswith(begun)]


def _writable(_: click.Context, __: click.Parameter, begun: str) -> list[str]:
    from limitsurf.shell.io.formats import WRITABLE

    return [suffix for suffix in WRITABLE if suffix.startswith(begun)]


from_option = click.option(
    "--from",
    "from_",
    metavar="SUFFIX",
    callback=_normal_suffix,
    shell_complete=_readable,
    help="The format of the cage, whatever its name; for - it is obj by default.",
)
to_option = click.option(
    "--to",
    metavar="SUFFIX",
    callback=_normal_suffix,
    shell_complete=_writable,
    help="The format to write, whatever the name; for - it is obj by default.",
)
prim_option = click.option(
    "--prim", metavar="PATH", help="Of a USD file, only the meshes at or below this prim."
)
time_option = click.option(
    "--time", type=float, metavar="T", help="Of a USD file, the frame; else the earliest."
)
merge_option = click.option(
    "--merge",
    type=click.FloatRange(0),
    metavar="D",
    help="Join vertices no farther apart than D; 0 joins equal ones.",
)
select_option = click.option(
    "--select",
    multiple=True,
    metavar="NAME=VALUE",
    callback=_assignments,
    help="Only faces whose data, such as group, object or material, are so; of one name any value.",
)
strict_option = click.option(
    "--strict", is_flag=True, help="Refuse a damaged cage, of which else is read what can be."
)
output_option = click.option(
    "-o",
    "--output",
    type=PATH,
    default="-",
    metavar="FILE",
    help="What to write, in the format of its suffix; - is the standard output, the default.",
)
answers_option = click.option(
    "-o",
    "--output",
    type=PATH,
    default="-",
    metavar="FILE",
    help=".csv, .npz, .npy, .parquet or .zarr; CSV to the standard output without.",
)
workers_option = click.option(
    "--workers",
    type=click.IntRange(-1),
    default=-1,
    metavar="N",
    help="Threads; by default one for each processor.",
)
json_option = click.option("--json", "as_json", is_flag=True, help="Say it as one JSON object.")


def reads_cage(command: Command) -> Command:
    """Arguments and options that say which cage; the command gets a `Cage` of them."""

    @wraps(command)
    def with_cage(
        *,
        cage: str,
        from_: str | None,
        prim: str | None,
        time: float | None,
        merge: float | None,
        select: Sequence[str],
        strict: bool,
        scheme: str | ls.Scheme | None,
        boundary: str | None,
        creasing: str | None,
        triangles: str | None,
        **others: Any,
    ) -> Any:
        names = ("scheme", "boundary", "creasing", "triangles")
        rules = dict(zip(names, (scheme, boundary, creasing, triangles), strict=True))
        asked = {"prim": prim, "time": time, "merge": merge, "strict": strict}
        return command(cage=Cage(cage, from_, rules, asked, select), **others)

    decorated: Any = with_cage
    for name, values, text in (
        ("triangles", TRIANGLES, "Edges of triangles are like others, or smoother."),
        ("creasing", CREASING, "How sharpness falls along semi-sharp creases."),
        ("boundary", BOUNDARY, "What a boundary does."),
    ):
        choice = click.Choice([value for value in values if value is not None])
        decorated = click.option(f"--{name}", type=choice, help=f"{text} {RULE}")(decorated)
    for option in (
        click.option("--scheme", type=SCHEME, metavar="NAME", help=f"{OF_SCHEME} {RULE}"),
        strict_option,
        select_option,
        merge_option,
        time_option,
        prim_option,
        from_option,
        click.argument("cage", type=PATH),
    ):
        decorated = option(decorated)
    return decorated  # type: ignore[no-any-return]


def mesh_suffix(output: str, to: str | None, as_json: bool) -> str:
    """The format of a mesh that is to be written; what could not be is refused at once."""
    from limitsurf.shell.io.formats import WRITABLE

    suffix = to or (".obj" if output == "-" else os.path.splitext(output)[1].lower())
    if output != "-":
        files.check_target(output)
    if suffix not in WRITABLE:
        known = " ".join(WRITABLE)
        raise click.UsageError(
            f"{output}: unknown suffix {suffix!r}; name the format with --to, one of {known}"
        )
    if output != "-":
        return suffix
    if as_json:
        raise click.UsageError(
            "--json takes the standard output: name a file for the mesh, -o FILE"
        )
    if suffix not in TEXT and sys.stdout is not None and sys.stdout.isatty():
        raise click.UsageError(f"{suffix} is no text for a terminal: name a file or a pipe")
    return suffix


def write_mesh(
    output: str, to: str | None, mesh: Mesh | Tessellation, as_json: bool, **facts: Any
) -> None:
    """Write a mesh, and report that but for the standard output."""
    if output == "-":
        with terminal.standard_output() as out:
            ls.write(out.buffer, mesh, suffix=to or ".obj")
        return
    try:
        with terminal.working("writing"):
            if to is None:
                ls.write(output, mesh)
            else:
                with files.replacing(output) as file:
                    ls.write(file, mesh, suffix=to)
    except OSError as error:
        if error.errno is None and output not in str(error):  # of a library
            raise OSError(f"{output}: {error}") from None
        raise
    report(output, as_json, **facts)


def report(output: str | None, as_json: bool, **facts: Any) -> None:
    """What was written where, as one object or as one line."""
    if as_json:
        terminal.say_json({"output": output, **facts})
    elif output is not None:
        counts = ", ".join(
            f"{value} {name}" for name, value in facts.items() if name in ("vertices", "faces")
        )
        terminal.say(f"{click.format_filename(output)}{': ' if counts else ''}{counts}")
