"""The command that writes what is a distance away from a surface, as a cage or for CAD systems."""

from __future__ import annotations

import os
from typing import Any

import click
import numpy as np

import limitsurf as ls
from limitsurf.shell import files, terminal
from limitsurf.shell.cli.program import (
    Cage,
    json_option,
    mesh_suffix,
    output_option,
    reads_cage,
    report,
    to_option,
    workers_option,
    write_mesh,
)


@click.command()
@reads_cage
@click.option(
    "-d", "--distance", type=float, required=True, help="Positive on the side of the normals."
)
@click.option("--thick", is_flag=True, help="The solid between the surface and its offset.")
@click.option(
    "--tolerance", type=float, metavar="LENGTH", help="How far the result may be from the offset."
)
@click.option(
    "--levels",
    type=click.IntRange(0, 9),
    default=3,
    show_default=True,
    help="How often a cage may be refined for the tolerance.",
)
@output_option
@to_option
@workers_option
@json_option
def offset(
    *,
    cage: Cage,
    distance: float,
    thick: bool,
    tolerance: float | None,
    levels: int,
    output: str,
    to: str | None,
    workers: int,
    as_json: bool,
) -> None:
    """Write what is a distance away from the surface: a cage, or STEP, IGES or BREP.

    \b
    Example:
      limitsurf offset cage.obj -d 0.05 -o larger.obj
      limitsurf offset cage.obj -d -0.05 --thick --tolerance 1e-3 -o hollow.obj

    As a cage it is fitted, with the faces of the cage unless the tolerance asks for finer ones. For
    CAD it is made of B-spline faces, which needs the extra cad; solids of --thick are those of the
    fitted cage. Where the offset folds back, and near which poles, is said in lines of their own.

    Keys of --json: output, faces, deviation (from the offset, as found), singular (how many limit
    faces fold back), near (how many places come too near).
    """
    from limitsurf.shell.io.formats import CAD

    suffix = to or os.path.splitext(output)[1].lower()
    if suffix in CAD and output == "-":
        raise click.UsageError(f"{suffix} is written to a file: name one")
    if suffix in CAD:
        files.check_target(output)
    else:
        mesh_suffix(output, to, as_json)
    surface = cage.surface()
    made = ls.offset(surface, distance, tolerance=tolerance, workers=workers)
    with terminal.working("offsetting"):
        folds = made.folds()
        what, deviation = _made(made, suffix in CAD, thick, levels)
    facts: dict[str, Any] = {"deviation": deviation, "singular": len(folds.singular)}
    facts["near"] = len(folds.near_face)
    count = len(what) if suffix in CAD else what.n_faces
    if suffix not in CAD:
        write_mesh(output, to, what, as_json, faces=count, **facts)
    else:
        with terminal.working("writing"):
            if to is None:
                ls.write(output, what)
            else:
                with files.replacing(output) as file:
                    ls.write(file, what, suffix=suffix)
        report(output, as_json, faces=count, **facts)
    if as_json or output == "-":
        return
    if folds.any:
        terminal.say(
            f"the offset folds back on {facts['singular']} limit faces, and is too near to the "
            f"surface at {facts['near']} of the places tried"
        )
    if len(folds.pole):
        terminal.say(
            f"around {len(np.unique(folds.pole))} poles curvature diverges: within "
            f"{folds.radius.max():.3g} of them it is rounded off, or folds back"
        )


def _made(made: ls.OffsetSurface, cad: bool, thick: bool, levels: int) -> tuple[Any, float]:
    """What is to be written, and how far it is from the offset."""
    if cad and not thick:
        faces = made.bspline_faces()
        return faces, float(faces.deviation.max(initial=0))
    fitted = made.fit(levels=levels)
    if not thick:
        return fitted.mesh, fitted.along_normal
    how: dict[str, Any] = {"tolerance": made.tolerance, "levels": levels}
    solid = ls.thickened(made.surface, made.distance, workers=made.workers, **how)
    return ls.bspline_faces(ls.LimitSurface(solid)) if cad else solid, fitted.along_normal
