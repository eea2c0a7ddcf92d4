"""The command that writes a cage in another format, or its surface as a part of a CAD system."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import click

import limitsurf as ls
from limitsurf.shell import files, terminal
from limitsurf.shell.cli.own import OF_SCHEME, SCHEME
from limitsurf.shell.cli.program import (
    PATH,
    Cage,
    from_option,
    json_option,
    merge_option,
    mesh_suffix,
    prim_option,
    report,
    select_option,
    strict_option,
    time_option,
    to_option,
    write_mesh,
)

_UNITS = ("mm", "cm", "m", "km", "um", "in", "ft")


@click.command()
@click.argument("source", metavar="IN", type=PATH)
@click.argument("output", metavar="OUT", type=PATH)
@from_option
@to_option
@prim_option
@time_option
@merge_option
@select_option
@strict_option
@click.option(
    "--scheme", type=SCHEME, metavar="NAME", help=f"For CAD: {OF_SCHEME} Else as the cage says."
)
@click.option(
    "--tolerance",
    type=float,
    metavar="LENGTH",
    help="For CAD: how far faces may be from the surface: a proved bound.",
)
@click.option(
    "--poles",
    type=click.Choice(["g0", "g1"]),
    help="For CAD: whether faces around poles share tangent planes (g1); g0.",
)
@click.option("--unit", type=click.Choice(_UNITS), help="For CAD: what the numbers are; mm.")
@click.option("--solid", is_flag=True, help="For CAD: refuse what is not closed.")
@click.option("--check", is_flag=True, help="For CAD: read the file again before it is one.")
@json_option
def convert(
    *,
    source: str,
    output: str,
    from_: str | None,
    to: str | None,
    select: Sequence[str],
    scheme: str | ls.Scheme | None,
    tolerance: float | None,
    poles: str | None,
    unit: str | None,
    solid: bool,
    check: bool,
    as_json: bool,
    **asked: Any,
) -> None:
    """Read a cage in one format, write it in another, or its surface as STEP, IGES or BREP.

    \b
    Example:
      limitsurf convert cage.obj cage.ply
      limitsurf convert - copy.obj < cage.obj
      limitsurf convert cage.obj part.step --tolerance 1e-3

    Either may be -, the standard input or output, in OBJ unless --from or --to says otherwise. What
    the new format has no place for is refused or said in a warning.

    A surface becomes a solid, or a shell where it is open, of B-spline faces: needs the extra cad.

    Keys of --json: output, vertices, edges, faces. Of a surface: output, faces, exact (how many are
    the surface to rounding), deviation (at most), angle (of normals, at most, in degrees).
    """
    from limitsurf.shell.io.formats import CAD

    suffix = to or os.path.splitext(output)[1].lower()
    said = {
        "--scheme": scheme, "--tolerance": tolerance, "--poles": poles, "--unit": unit,
        "--solid": solid or None, "--check": check or None,
    }  # fmt: skip
    given = [name for name, value in said.items() if value is not None]
    if suffix not in CAD:
        if given:
            raise click.UsageError(f"{given[0]} is of files of CAD systems alone: {' '.join(CAD)}")
        mesh_suffix(output, to, as_json)
        mesh = Cage(source, from_, {}, asked, select).read()
        counts = {"vertices": mesh.n_vertices, "edges": mesh.n_edges, "faces": mesh.n_faces}
        write_mesh(output, to, mesh, as_json, **counts)
        return
    if output == "-":
        raise click.UsageError(f"{suffix} is written to a file: name one")
    files.check_target(output)
    surface = Cage(source, from_, {"scheme": scheme}, asked, select).surface()
    with terminal.working("making faces"):
        faces = ls.bspline_faces(surface, tolerance=tolerance, poles=poles or "g0")
    with terminal.working("writing"):
        options: dict[str, Any] = {"suffix": suffix, "unit": unit or "mm", "check": check}
        options["solid"] = solid or None
        if to is None:
            ls.write(output, faces, **options)
        else:
            with files.replacing(output) as file:
                ls.write(file, faces, **options)
    deviation, angle = (float(x.max(initial=0)) for x in (faces.deviation, faces.angle))
    facts = {"exact": int(faces.exact.sum()), "deviation": deviation, "angle": angle}
    report(output, as_json, faces=len(faces), **facts)
    if not as_json:
        terminal.say(
            f"{facts['exact']} of them are the surface to rounding; all are within "
            f"{deviation:.3g}, their normals within {angle:.3g} degrees"
        )
