"""The command that cuts a surface; curves as text: rows of CSV, or lines in OBJ."""

from __future__ import annotations

import os
from typing import IO

import click
import numpy as np

import limitsurf as ls
from limitsurf.shell import files, terminal
from limitsurf.shell.cli.program import (
    Cage,
    json_option,
    output_option,
    reads_cage,
    report,
    workers_option,
)


@click.command()
@reads_cage
@click.option(
    "--origin",
    type=(float, float, float),
    metavar="X Y Z",
    help="A point of the plane; by default the middle of the cage's box.",
)
@click.option(
    "--normal",
    type=(float, float, float),
    default=(0, 0, 1),
    show_default=True,
    metavar="X Y Z",
    help="Perpendicular to the plane.",
)
@click.option(
    "--view",
    type=(float, float, float),
    metavar="X Y Z",
    help="Instead of a plane: the silhouette for a viewer far away in this direction.",
)
@click.option(
    "--eye",
    type=(float, float, float),
    metavar="X Y Z",
    help="Instead of a plane: the silhouette for an eye at this point.",
)
@click.option(
    "--tolerance",
    type=float,
    metavar="D",
    help="How far lines may be from the curves; by default 1e-4 of the size.",
)
@click.option(
    "--channel", metavar="NAME", help="A channel of three columns, instead of the points."
)
@output_option
@click.option("--to", type=click.Choice(["csv", "obj"]), help="The format, whatever the name.")
@workers_option
@json_option
def section(
    *,
    cage: Cage,
    origin: tuple[float, float, float] | None,
    normal: tuple[float, float, float],
    view: tuple[float, float, float] | None,
    eye: tuple[float, float, float] | None,
    tolerance: float | None,
    channel: str | None,
    output: str,
    to: str | None,
    workers: int,
    as_json: bool,
) -> None:
    """Cut the surface by a plane, or find its silhouette: curves as CSV or as lines in OBJ.

    \b
    Example:
      limitsurf section cage.obj --normal 0 0 1
      limitsurf section cage.obj --normal 1 2 0 --tolerance 1e-5 -o lines.obj
      limitsurf section cage.obj --view 1 -2 1.5 -o outline.csv

    All curves are found, however small, and each point is on the surface. Columns of CSV are the
    number of the curve, whether it is closed (1) or not (0), x, y, z, and the limit face, u and v.

    Keys of --json: output, curves, closed, points; origin, normal of a plane, else view or eye.
    """
    check(output, to, as_json)
    if (view is not None) + (eye is not None) + (origin is not None) > 1:
        raise click.UsageError("give one of --origin, of a plane, --view and --eye")
    surface = cage.surface([channel] if channel else ())
    seen = eye if view is None else view
    if seen is not None:
        with terminal.working("searching"):
            found = ls.silhouette(
                surface, seen, perspective=view is None, tolerance=tolerance, channel=channel,
                workers=workers,
            )  # fmt: skip
        write(output, to, found, as_json, **{"eye" if view is None else "view": list(seen)})
        return
    known = surface.of_channel(channel).points
    if origin is None:
        origin = tuple((known.min(axis=0) / 2 + known.max(axis=0) / 2).tolist())
    with terminal.working("cutting"):
        found = ls.section(
            surface, origin, normal, tolerance=tolerance, channel=channel, workers=workers
        )
    write(output, to, found, as_json, origin=list(origin), normal=list(normal))


def check(output: str, to: str | None, as_json: bool) -> None:
    """Refuse a target that curves cannot be written to."""
    if as_json and output == "-":
        raise click.UsageError("--json needs the standard output: name a file, -o FILE")
    if output != "-":
        _format(output, to)
        files.check_target(output)


def _format(output: str, to: str | None) -> str:
    if to is not None:
        return to
    suffix = os.path.splitext(output)[1].lower()
    if suffix not in (".csv", ".obj"):
        raise click.UsageError(f"{output}: curves are written as .csv or .obj; or say --to")
    return suffix[1:]


def write(output: str, to: str | None, found: ls.Curves, as_json: bool, **facts: object) -> None:
    """Write curves to a file and report that, or to the standard output for -."""
    if output == "-":
        with terminal.standard_output() as out:
            _write(out, to or "csv", found)
        return
    with files.replacing(output, "w") as file:
        _write(file, _format(output, to), found)
    counts = {"curves": len(found), "closed": int(found.closed.sum()), "points": len(found.face)}
    report(output, as_json, **counts, **facts)


def _write(file: IO[str], kind: str, found: ls.Curves) -> None:
    if kind == "obj":
        np.savetxt(file, found.point, "v %.17g %.17g %.17g")
        for first, last, closed in zip(
            found.offsets[:-1].tolist(), found.offsets[1:].tolist(), found.closed, strict=True
        ):
            numbers = [*range(first + 1, last + 1), *([first + 1] if closed else [])]
            file.write(f"l {' '.join(map(str, numbers))}\n")
        return
    each = np.diff(found.offsets)
    columns = np.repeat(np.arange(len(each)), each), np.repeat(found.closed, each)
    table = np.column_stack([*columns, found.point, found.face, found.u, found.v])
    file.write("curve,closed,x,y,z,face,u,v\n")
    np.savetxt(file, table, "%d,%d,%.17g,%.17g,%.17g,%d,%.17g,%.17g")
