"""The command `intersect`: rays from a file or the command line, and what they hit."""

from __future__ import annotations

from typing import Any

import click
import numpy as np

import limitsurf as ls
from limitsurf.shell import terminal
from limitsurf.shell.cli.program import (
    PATH,
    Cage,
    answers_option,
    json_option,
    reads_cage,
    report,
    workers_option,
)

NAMES = ("x", "y", "z", "dx", "dy", "dz")


@click.command()
@reads_cage
@click.option(
    "--ray",
    "given",
    type=float,
    nargs=6,
    multiple=True,
    metavar="X Y Z DX DY DZ",
    help="Origin and direction of a ray; may be given several times.",
)
@click.option("--rays", type=PATH, metavar="FILE", help="CSV, NPY or NPZ of such rows; - is CSV.")
@click.option("--t-min", type=float, default=0.0, show_default=True, help="Where rays begin.")
@click.option("--t-max", type=float, default=float("inf"), show_default=True, help="And end.")
@click.option("--all", "every", is_flag=True, help="All hits of each ray, not only the first.")
@answers_option
@workers_option
@json_option
def intersect(
    *,
    cage: Cage,
    given: tuple[tuple[float, ...], ...],
    rays: str | None,
    t_min: float,
    t_max: float,
    every: bool,
    output: str,
    workers: int,
    as_json: bool,
) -> None:
    """Find where rays hit the surface.

    \b
    Example:
      limitsurf intersect cage.obj --ray 0 0 5 0 0 -1
      limitsurf intersect cage.obj --rays rays.csv --all -o hits.npz

    Rows are x, y, z of origins, then of directions, which need not be of length 1: t counts them.
    CSV may have a line of names above; among other columns they are x, y, z, dx, dy, dz.

    Columns of CSV and Parquet are face, u, v, ray (the number of the row), t, x, y, z and the
    normal n_x, n_y, n_z; with --all also multiplicity, 2 where a ray touches. Arrays of NPZ and
    fields of NPY are face, u, v, ray, t, position, normal. Rays that hit nothing have no rows.
    """
    from limitsurf.shell.io import answers as targets
    from limitsurf.shell.io.points import batches

    if (rays is None) == (not given):
        raise click.UsageError("need rays: either --ray X Y Z DX DY DZ or --rays FILE")
    if rays == "-" == cage.path:
        raise click.UsageError("cage and rays cannot both be on the standard input")
    to_file = output != "-"
    if to_file:
        targets.check_target(output)
    rows = np.array(given) if rays is None else np.concatenate(list(batches(rays, NAMES)))
    surface = cage.surface()
    options: dict[str, Any] = {"t_min": t_min, "t_max": t_max, "workers": workers}
    start, way = rows[:, :3], rows[:, 3:]
    extra = {}
    with terminal.working("following rays"):
        if every:
            all_hits = ls.intersect_all(surface, start, way, **options)
            number = np.repeat(np.arange(len(rows)), np.diff(all_hits.offsets))
            found: ls.RayHits | ls.AllRayHits = all_hits
            extra["multiplicity"], keep = all_hits.multiplicity, np.arange(len(number))
        else:
            found = ls.intersect(surface, start, way, **options)
            number = keep = np.flatnonzero(found.hit)
    places = {name: getattr(found, name)[keep] for name in ("face", "u", "v")}
    hits = {**places, "ray": number, "t": found.t[keep], **extra}
    hits |= {"position": found.point[keep], "normal": found.normal[keep]}
    with targets.writing(output if to_file else None, len(number), as_json) as write:
        write(hits)
    if as_json and to_file:
        report(output, as_json, rays=len(rows), hits=len(number))
