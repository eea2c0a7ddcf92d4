"""Commands that find places of a surface: nearest ones, and samples."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import click

import limitsurf as ls
from limitsurf.shell import files, terminal
from limitsurf.shell.cli.program import (
    PATH,
    Cage,
    answers_option,
    json_option,
    reads_cage,
    report,
    workers_option,
)

if TYPE_CHECKING:
    from limitsurf.query.samples import Method

MANY = 2**63 - 1
METHODS = ("area", "parameter", "blue_noise")


@click.command()
@reads_cage
@click.option(
    "--points",
    type=PATH,
    required=True,
    metavar="FILE",
    help="CSV, NPY or NPZ of x, y, z; - reads CSV.",
)
@click.option("--signed", is_flag=True, help="Distances are negative inside; for closed surfaces.")
@click.option(
    "--max-distance",
    type=click.FloatRange(0),
    default=float("inf"),
    metavar="D",
    help="Seek nothing farther away.",
)
@answers_option
@workers_option
@json_option
def closest(
    *,
    cage: Cage,
    points: str,
    signed: bool,
    max_distance: float,
    output: str,
    workers: int,
    as_json: bool,
) -> None:
    """Find the places of the surface that are nearest to points.

    \b
    Example:
      limitsurf sample cage.obj -n 100 -o samples.csv
      limitsurf closest cage.obj --points samples.csv -o feet.npz

    Columns of CSV and Parquet are face, u, v, then x, y, z of the place, its distance, and the
    normal n_x, n_y, n_z there; arrays of NPZ and Zarr and fields of NPY are face, u, v, position,
    distance and normal. Where nothing is within --max-distance the face is -1, the distance inf.

    Points in CSV are lines of x,y,z, or columns of these names among others; in NPY an array
    (n, 3), or fields x, y, z or position; in NPZ arrays of these names.

    With --json, answers on the standard output are one object in each line, of the same names as
    arrays; with -o FILE there is one object: output, answers (their number), found (how many places
    are within --max-distance), limit_faces.
    """
    from limitsurf.shell.io import answers as targets
    from limitsurf.shell.io.points import batches

    if points == "-" == cage.path:
        raise click.UsageError("cage and points cannot both be on the standard input")
    to_file = output != "-"
    if to_file:
        targets.check_target(output)
    surface = cage.surface()
    count = known = 0
    on_screen = not to_file and sys.stdout is not None and sys.stdout.isatty()
    with (
        terminal.counting("searching", None, on_screen) as done,
        targets.writing(output if to_file else None, None, as_json) as write,
    ):
        for some in batches(points):
            found = ls.closest_point(
                surface, some, signed=signed, max_distance=max_distance, workers=workers
            )
            write(
                {
                    "face": found.face,
                    "u": found.u,
                    "v": found.v,
                    "position": found.point,
                    "distance": found.distance,
                    "normal": found.normal,
                }
            )
            count += len(some)
            known += int((found.face >= 0).sum())
            done(len(some))
    if as_json and to_file:
        faces = len(surface.limit_faces)
        report(output, as_json, answers=count, found=known, limit_faces=faces)


@click.command()
@reads_cage
@click.option(
    "-n", "n", type=click.IntRange(0, MANY), required=True, metavar="N", help="How many samples."
)
@click.option(
    "--method",
    type=click.Choice(METHODS),
    default="area",
    show_default=True,
    help="Evenly by area, by limit face and (u, v), or by area at distances.",
)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Of chance.")
@answers_option
@workers_option
@json_option
def sample(
    *,
    cage: Cage,
    n: int,
    method: Method,
    seed: int,
    output: str,
    workers: int,
    as_json: bool,
) -> None:
    """Draw random places of the surface.

    \b
    Example:
      limitsurf sample cage.obj -n 1000 -o samples.npz
      limitsurf sample cage.obj -n 200 --method blue_noise --seed 3 -o even.csv
      limitsurf evaluate cage.obj --queries even.csv --order 1 -o answers.npz

    Columns of CSV and Parquet are face, u, v, then x, y, z and the normal n_x, n_y, n_z; arrays of
    NPZ and Zarr and fields of NPY are face, u, v, position and normal. The same seed gives the same
    samples.

    With --json, samples on the standard output are one object in each line, of the same names as
    arrays; with -o FILE there is one object: output, samples (their number), method, seed, spacing
    (of blue_noise the smallest distance of two samples, else null), limit_faces.
    """
    from limitsurf.shell.io import answers as targets

    to_file = output != "-"
    if to_file:
        targets.check_target(output)
        files.check_room(output, 12 * n)
    surface = cage.surface()
    with terminal.working("drawing samples"):
        found = ls.sample(surface, n, method=method, rng=seed, workers=workers)
    with targets.writing(output if to_file else None, n, as_json) as write:
        write(
            {
                "face": found.face,
                "u": found.u,
                "v": found.v,
                "position": found.point,
                "normal": found.normal,
            }
        )
    if as_json and to_file:
        facts = {"samples": len(found), "method": method, "seed": seed, "spacing": found.spacing}
        report(output, as_json, **facts, limit_faces=len(surface.limit_faces))
