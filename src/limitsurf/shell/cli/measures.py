"""The command that measures a surface and the body inside."""

from __future__ import annotations

from typing import Any

import click

import limitsurf as ls
from limitsurf.shell import terminal
from limitsurf.shell.cli.program import Cage, json_option, reads_cage, workers_option


@click.command()
@reads_cage
@click.option(
    "--rtol", type=float, default=1e-12, show_default=True, help="Relative error of the area."
)
@workers_option
@json_option
def measure(*, cage: Cage, rtol: float, workers: int, as_json: bool) -> None:
    """Say the area of the surface, and volume, centroid and inertia of the body inside.

    \b
    Example:
      limitsurf measure cage.obj
      limitsurf measure cage.obj --json

    Inertia is about the centroid, of mass 1 per unit of volume. Of a surface that is not closed
    there are area, centroid and inertia of the surface itself, of mass 1 per unit of area.

    Keys of --json: cage; area; volume (null if the surface is not closed); of (what has the next
    two: body or surface); centroid (x, y, z); inertia (3 rows of 3 numbers); no_volume (why there
    is none, else null).
    """
    surface = cage.surface()
    no_volume, volume, of = None, None, "body"
    with terminal.working("measuring"):
        area = ls.area(surface, rtol=rtol, workers=workers)
        try:
            volume = ls.volume(surface, workers=workers)
        except ValueError as error:
            no_volume, of = str(error), "surface"
        given: dict[str, Any] = {"of": of, "workers": workers}
        centroid, inertia = ls.centroid(surface, **given), ls.inertia(surface, **given)
    found = {"area": area, "volume": volume, "of": of, "centroid": centroid.tolist()}
    found |= {"inertia": inertia.tolist(), "no_volume": no_volume}
    if as_json:
        terminal.say_json({"cage": cage.path, **found})
        return
    told = [("area", f"{area:.12g}"), ("volume", "none" if volume is None else f"{volume:.12g}")]
    told.append((f"centroid of the {of}", " ".join(f"{x:.12g}" for x in centroid)))
    for name, row in zip((f"inertia of the {of}", "", ""), inertia, strict=True):
        told.append((name, " ".join(f"{x:.12g}" for x in row)))
    if no_volume is not None:
        told.append(("no volume", no_volume))
    terminal.say_table(told)
