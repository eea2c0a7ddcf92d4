"""The command `interpolate`: a cage whose limit passes through points."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, get_args

import click
import numpy as np

import limitsurf as ls
from limitsurf.cad.fairness import ENERGIES
from limitsurf.shell import terminal
from limitsurf.shell.cli.program import (
    PATH,
    Cage,
    json_option,
    mesh_suffix,
    output_option,
    reads_cage,
    to_option,
    write_mesh,
)

if TYPE_CHECKING:
    from limitsurf.cad.fairness import Energy

Answer = Literal["auto", "yes", "no"]

REFINE: dict[str, Literal["auto"] | bool] = {"auto": "auto", "yes": True, "no": False}
AT = ("face", "u", "v")


@click.command()
@reads_cage
@click.argument("points", type=PATH, required=False)
@click.option("--places", is_flag=True, help="Rows of POINTS are face,u,v,x,y,z; else x,y,z.")
@click.option(
    "--fairness", type=click.Choice(ENERGIES), help="By which surfaces are compared; plates."
)
@click.option(
    "--weight",
    type=click.FloatRange(0),
    default=None,
    metavar="W",
    help="Of points that are only to be near; else the limit passes through them.",
)
@click.option(
    "--refine",
    type=click.Choice(get_args(Answer)),
    default="auto",
    show_default=True,
    help="The cage first, once; auto, where points determine none without.",
)
@output_option
@to_option
@json_option
def interpolate(
    *,
    cage: Cage,
    points: str | None,
    places: bool,
    fairness: Energy | None,
    weight: float | None,
    refine: str,
    output: str,
    to: str | None,
    as_json: bool,
) -> None:
    """Find the fairest cage whose surface passes through points.

    \b
    Example:
      limitsurf interpolate cage.obj -o through.obj
      limitsurf interpolate cage.obj --refine yes | limitsurf info -
      limitsurf sample cage.obj -n 5 -o places.csv
      limitsurf interpolate cage.obj places.csv --places -o near.obj

    POINTS are rows of x,y,z in CSV, NPY or NPZ, one for each vertex of the cage, in their order;
    without, those of the cage itself. With --places they are rows of face,u,v,x,y,z, of any number.
    Where the limits of vertices depend on each other, as those of a cube do, the cage is refined
    once: its own vertices come first then.

    Keys of --json: output, vertices, faces, levels (how often the cage was refined), residual (the
    largest distance from a point, in sizes of the cage), rank, conditions, condition.
    """
    from limitsurf.shell.io.points import AXES, batches

    mesh_suffix(output, to, as_json)
    if places and points is None:
        raise click.UsageError("--places says what POINTS are: name a file of them")
    if points == "-" == cage.path:
        raise click.UsageError("cage and points cannot both be on the standard input")
    surface = cage.surface()
    given: dict[str, Any] = {}
    if points is not None:
        rows = np.concatenate(list(batches(points, (*AT, *AXES) if places else AXES)))
        given["points"] = rows[:, -3:]
        if places:
            face = rows[:, 0]
            bad = np.flatnonzero(face != np.rint(face))
            if len(bad):
                raise ValueError(f"{points}: face {face[bad[0]]} of row {bad[0]} is no integer")
            given["places"] = face.astype(np.int64), rows[:, 1], rows[:, 2]
    with terminal.working("interpolating"):
        found = ls.interpolate(
            surface, fairness=fairness, weights=weight, refine=REFINE[refine], **given
        )
    mesh = found.mesh
    names = "levels", "residual", "rank", "conditions", "condition"
    facts = {name: getattr(found, name) for name in names}
    if not np.isfinite(found.condition):
        facts["condition"] = None
    write_mesh(output, to, mesh, as_json, vertices=mesh.n_vertices, faces=mesh.n_faces, **facts)
