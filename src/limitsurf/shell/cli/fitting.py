"""The command `fit`: a cage whose limit is near the points of a scan."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click
import numpy as np

import limitsurf as ls
from limitsurf.cad.fairness import ENERGIES
from limitsurf.cad.levenberg import LOSSES
from limitsurf.shell import terminal
from limitsurf.shell.cli.program import (
    PATH,
    Cage,
    json_option,
    mesh_suffix,
    output_option,
    reads_cage,
    to_option,
    workers_option,
    write_mesh,
)

if TYPE_CHECKING:
    from limitsurf.cad.fairness import Energy
    from limitsurf.cad.levenberg import Loss


@click.command()
@reads_cage
@click.argument("scan", type=PATH)
@click.option("--refine", is_flag=True, help="Refine parts whose error is above the tolerance.")
@click.option(
    "--tolerance",
    type=click.FloatRange(0, min_open=True),
    metavar="D",
    help="An error that is small enough; with --refine by default 1e-4 of the size.",
)
@click.option("--loss", type=click.Choice(LOSSES), default="linear", show_default=True,
              help="How distances count: all but linear make little of outliers.")  # fmt: skip
@click.option("--scale", type=float, metavar="D", help="From which distance on a loss counts less.")
@click.option("--fairness", type=click.Choice(ENERGIES), help="Which energy smooths; plates.")
@click.option("--smoothing", type=click.FloatRange(0), metavar="W", help="How much; 0, if it can.")
@click.option("--detect", is_flag=True, help="Keep boundary and creases to the points'.")
@click.option(
    "--max-iterations", type=click.IntRange(0), default=50, show_default=True, help="Steps."
)
@output_option
@to_option
@workers_option
@json_option
def fit(
    *,
    cage: Cage,
    scan: str,
    refine: bool,
    tolerance: float | None,
    loss: Loss,
    scale: float | None,
    fairness: Energy | None,
    smoothing: float | None,
    detect: bool,
    max_iterations: int,
    output: str,
    to: str | None,
    workers: int,
    as_json: bool,
) -> None:
    """Move the vertices of a cage so that its surface is near the points of a scan.

    \b
    Example:
      limitsurf sample cage.obj -n 2000 -o scan.csv
      limitsurf fit cage.obj scan.csv -o fitted.obj
      limitsurf fit cage.obj scan.csv --refine --tolerance 0.01 --loss huber -o fine.obj

    SCAN is CSV, NPY or NPZ of x, y, z; PLY, with or without faces, whose normals say which side of
    a wall is meant; or a mesh of any other format, of which the vertices are taken. The cage must
    have the shape roughly, in the same place.

    Keys of --json: output, vertices, faces, points (their number), steps, levels (how often parts
    were refined, at most), rms (the error at the start and after each step), max (the largest
    distance of a point), converged.
    """
    from limitsurf.shell.io import scans

    mesh_suffix(output, to, as_json)
    if scan == "-" == cage.path:
        raise click.UsageError("cage and scan cannot both be on the standard input")
    surface = cage.surface()
    points, normals = scans.read(scan)
    with terminal.working("fitting"):
        found = ls.fit(
            surface, points, normals=normals, edges="detect" if detect else "auto",
            fairness=fairness, smoothing=smoothing, loss=loss, scale=scale, tolerance=tolerance,
            refine="auto" if refine else None, max_iterations=max_iterations, workers=workers,
        )  # fmt: skip
    mesh = found.mesh
    facts = {
        "points": len(points),
        "steps": len(found.history) - 1,
        "levels": int(found.levels.max()),
        "rms": found.history.tolist(),
        "max": float(np.nanmax(found.error)),
        "converged": found.converged,
    }
    write_mesh(output, to, mesh, as_json, vertices=mesh.n_vertices, faces=mesh.n_faces, **facts)
