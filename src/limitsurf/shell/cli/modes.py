"""The command that finds how a surface sounds: eigenmodes of the Laplace-Beltrami operator."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import click
import numpy as np

import limitsurf as ls
from limitsurf.shell import files, terminal
from limitsurf.shell.cli.program import (
    PATH,
    Cage,
    json_option,
    reads_cage,
    workers_option,
    write_mesh,
)

if TYPE_CHECKING:
    from limitsurf.fem.modes import Eigenmodes
    from limitsurf.fem.space import Space
    from limitsurf.query import Tessellation

_ZERO = 1e-9  # part of the largest eigenvalue that is told as 0


@click.command()
@reads_cage
@click.option(
    "-k", "k", type=click.IntRange(1), default=12, show_default=True, help="How many modes."
)
@click.option(
    "--levels",
    type=click.IntRange(0, 99),
    default=2,
    show_default=True,
    help="How often the cage is refined for the functions.",
)
@click.option(
    "--ends",
    type=click.Choice(["free", "natural"]),
    default="free",
    show_default=True,
    help="Functions beyond boundaries are free, or follow the boundary rules of the surface.",
)
@click.option(
    "-n",
    "n",
    type=click.IntRange(1),
    default=4,
    show_default=True,
    metavar="N",
    help="N x N polygons per limit face of the refined cage, for the file.",
)
@click.option(
    "-o",
    "--output",
    type=PATH,
    metavar="FILE",
    help="A file to write, .vtu, .vtp, .vtk or USD: polygons with the modes as fields on points.",
)
@workers_option
@json_option
def modes(
    *,
    cage: Cage,
    k: int,
    levels: int,
    ends: Literal["free", "natural"],
    n: int,
    output: str | None,
    workers: int,
    as_json: bool,
) -> None:
    """Find eigenvalues and eigenmodes of the Laplace-Beltrami operator on the surface.

    \b
    Example:
      limitsurf modes cage.obj -k 12 -o modes.vtu
      limitsurf modes cage.obj -k 4 --levels 1 --json

    Zeros and all copies of multiple eigenvalues are among them, in ascending order, of the unit 1 /
    length^2; frequencies are their square roots. At boundaries normal derivatives vanish. Each
    refinement adds functions, and eigenvalues fall towards those of the surface.

    Fields of the file are mode_0, mode_1, ...; integrals of their squares over the surface are 1.

    Keys of --json: output (null without a file), unknowns, levels, ends, eigenvalues; with a file
    also vertices and faces.
    """
    if output is not None:
        _check(output)
    surface = cage.surface()
    with terminal.working("finding modes"):
        space = ls.Space(surface, levels=levels, ends=ends)
        found = ls.eigenmodes(space, k, workers=workers)
    values = found.eigenvalues
    facts = {"unknowns": space.n, "levels": levels, "ends": ends, "eigenvalues": values.tolist()}
    if not as_json:
        shown = np.where(abs(values) < _ZERO * abs(values).max(), 0, values)
        rows = [
            (str(i), f"{x:.9g}", f"{np.sqrt(max(x, 0)):.9g}") for i, x in enumerate(shown.tolist())
        ]
        terminal.say_table(rows, ("mode", "eigenvalue", "frequency"))
    if output is not None:
        with terminal.working("tessellating"):
            made = _painted(space, found, n, workers)
        facts |= {"vertices": len(made.points), "faces": len(made.sizes)}
        write_mesh(output, None, made, as_json, **facts)
    elif as_json:
        terminal.say_json({"output": None, **facts})


def _check(output: str) -> None:
    """Refuse a target that modes cannot be written to."""
    from limitsurf.shell.io.formats import WITH_CHANNELS

    suffix = os.path.splitext(output)[1].lower()
    if suffix not in WITH_CHANNELS:
        known = " ".join(WITH_CHANNELS)
        raise click.UsageError(f"{output}: modes are written to files of type {known}")
    files.check_target(output)


def _painted(space: Space, found: Eigenmodes, n: int, workers: int) -> Tessellation:
    """Polygons on the surface with the modes as channels."""
    made = ls.tessellate(space.surface, n, workers=workers)
    values = space.function(found.modes).evaluate(made.face, made.u, made.v, workers=workers)
    channels = {f"mode_{i}": (column, made.indices) for i, column in enumerate(values.T)}
    return replace(made, channels=channels)
