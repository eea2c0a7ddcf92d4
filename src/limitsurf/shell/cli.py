"""The command line, ``limitsurf``. Every command is one call of the public API and its report."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
import numpy as np

import limitsurf as ls
from limitsurf.mesh import BOUNDARY
from limitsurf.shell import terminal
from limitsurf.shell.plot import COLOR

if TYPE_CHECKING:
    from limitsurf.mesh import Mesh
    from limitsurf.surface import LimitSurface

Command = TypeVar("Command", bound=Callable[..., Any])

# What a user can cause; anything else is a defect of the program and shows its traceback.
ERRORS = (ValueError, OSError, IndexError, NotImplementedError, ImportError, MemoryError)


class _Program(click.Group):
    """Errors in one line with exit code 2; 130 after Ctrl-C, 1 when the reader goes away."""

    def main(self, *args: Any, **extra: Any) -> Any:
        try:
            with terminal.warnings_in_one_line():
                code = super().main(*args, **{**extra, "standalone_mode": False})
        except click.Abort:
            code = 130
        except (click.ClickException, *ERRORS) as error:
            click.echo(f"limitsurf: error: {terminal.sentence(error)}", err=True)
            code = 2
        if not extra.get("standalone_mode", True):
            return code
        raise SystemExit(code)


@click.group(
    cls=_Program,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 96},
)
@click.version_option(ls.__version__, message="limitsurf %(version)s")
@click.pass_context
def main(context: click.Context) -> None:
    """Exact limit surfaces of control cages, at any (face, u, v).

    A CAGE is an OBJ file. A face in a query is a limit face: a quad is one; another polygon is as
    many as it has corners, in their order. Every u and v is in [0, 1].
    """
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


def _on_cage(command: Command) -> Command:
    cage = click.argument("cage", type=click.Path(path_type=Path))
    boundary = click.option(
        "--boundary",
        type=click.Choice([name for name in BOUNDARY if name]),
        help="What a boundary does; by default as the cage says, else edge_and_corner.",
    )
    return cage(boundary(command))


def _surface(cage: Path, boundary: str | None) -> LimitSurface:
    mesh = ls.read(cage)
    with terminal.working("building the surface"):
        return ls.LimitSurface(mesh, boundary=boundary)


@main.command()
@_on_cage
def info(cage: Path, boundary: str | None) -> None:
    """Say what a cage is made of, what is irregular and why."""
    mesh = ls.read(cage)
    terminal.say_table(_facts(mesh, boundary))


def _facts(mesh: Mesh, boundary: str | None) -> Iterator[tuple[str, str]]:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    used = mesh.vertex_faces > 0
    start, end = mesh.edges.T
    links = coo_array((np.ones(mesh.n_edges), (start, end)), shape=(mesh.n_vertices,) * 2)
    parts = len(np.unique(connected_components(links)[1][used]))
    border = int(mesh.boundary_edge.sum())
    unused = int(np.sum(~used))
    yield "vertices", f"{mesh.n_vertices}" + (f", {unused} of them in no face" if unused else "")
    yield "edges", f"{mesh.n_edges}" + (f", {border} of them on the boundary" if border else "")
    yield "faces", f"{mesh.n_faces}"
    yield "components", f"{parts}, {'open' if border else 'closed'}"
    yield "corners of faces", terminal.histogram(mesh.sizes)
    interior = used & ~mesh.boundary_vertex
    if interior.any():
        yield "valences inside", terminal.histogram(mesh.vertex_faces[interior])
    if border:
        yield (
            "faces at boundary vertices",
            terminal.histogram(mesh.vertex_faces[mesh.boundary_vertex]),
        )
    for name in ("creases", "corners"):
        if count := len(getattr(mesh, name)[1]):
            values = getattr(mesh, name)[1]
            yield name, f"{count}, sharpness {min(values):g} to {max(values):g}"
    if len(mesh.holes):
        yield "holes", f"{len(mesh.holes)}"
    for name in ("scheme", "boundary", "creasing", "triangles"):
        if (value := getattr(mesh, name)) is not None:
            yield name, f"{value}"
    for name, (values, _, interpolation) in mesh.channels.items():
        yield f"channel {name}", f"{len(values)} values, {interpolation}"
    try:
        surface = ls.LimitSurface(mesh, boundary=boundary)
    except NotImplementedError as error:
        yield "limit surface", f"not supported yet: {terminal.sentence(error)}"
        return
    yield "limit faces", f"{len(surface.limit_faces)}"
    for reason, count in surface.patches.summary():
        yield f"  {reason}", f"{count}"


@main.command()
@_on_cage
@click.option("--queries", metavar="FILE", help="CSV, NPZ or NPY of face, u, v; - reads CSV.")
@click.option("--grid", type=click.IntRange(1), metavar="N", help="N x N per limit face.")
@click.option("--random", type=click.IntRange(0), metavar="N", help="N on random limit faces.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="For --random.")
@click.option(
    "--order", type=click.IntRange(0), default=0, help="Derivatives up to this order as well."
)
@click.option("--normals", is_flag=True, help="Unit normals as well.")
@click.option("-o", "--output", metavar="FILE", help=".csv, .npz or .npy; CSV to stdout without.")
def evaluate(
    cage: Path,
    boundary: str | None,
    queries: str | None,
    grid: int | None,
    random: int | None,
    seed: int,
    order: int,
    normals: bool,
    output: str | None,
) -> None:
    """Evaluate positions, derivatives and normals.

    Columns of CSV are face, u, v, x, y, z, then derivatives x_u, y_u, z_u, x_v, ... and normals
    n_x, n_y, n_z. Arrays of NPZ and fields of NPY are face, u, v, position, du, dv, duu, duv, dvv,
    ... and normal.

    A grid takes the centres of N x N equal cells, u first, so that no two of its points coincide.
    """
    from limitsurf.shell import queries as files

    if sum(given is not None for given in (queries, grid, random)) != 1:
        raise click.UsageError("need one of --queries, --grid and --random")
    if output is not None:
        files.check_target(output)
    asked = None if queries is None else files.read_queries(queries)
    surface = _surface(cage, boundary)
    faces = len(surface.limit_faces)
    if grid is not None:
        asked = files.grid_queries(faces, grid)
    elif random is not None:
        asked = files.random_queries(faces, random, seed)
    assert asked is not None
    try:
        with terminal.counting("evaluating", len(asked[0])) as done:
            answers = files.evaluate(surface, asked, order, normals, done)
    except (IndexError, ValueError) as error:
        raise ValueError(f"{queries}: {error}") from None
    files.write_answers(output, answers)


@main.command()
@_on_cage
@click.option("--levels", type=click.IntRange(1), default=4, show_default=True)
@click.pass_context
def validate(context: click.Context, cage: Path, boundary: str | None, levels: int) -> None:
    """Compare the surface with recursive refinement.

    At each level, every vertex of the refined cage is compared with the surface at its (face, u,
    v): where it is (error, and the order at which it shrinks), and where its limit mask moves it
    (limit error, which is rounding alone). Exits with 1 if the latter is more than rounding.
    """
    surface = _surface(cage, boundary)
    with terminal.working("refining"):
        table = ls.validate(surface, levels)
    if not terminal.say_validation(surface, table):
        click.echo("limitsurf: the limit error is more than rounding", err=True)
        context.exit(1)


@main.command()
@_on_cage
@click.option("-o", "--output", metavar="FILE", help="A .png to write; without, a window opens.")
@click.option("--quads", type=click.IntRange(1), metavar="N", help="N x N drawn per limit face.")
@click.option("--cage/--no-cage", "wires", default=None, help="Draw the cage.")
@click.option("--curves/--no-curves", default=None, help="Draw the edges of the limit faces.")
@click.option("--poles/--no-poles", default=True, help="Mark extraordinary points.")
@click.option("--normals", is_flag=True, help="Draw normals.")
@click.option("--color", default=COLOR, show_default=True, help="Of the surface, or a name.")
@click.option("--up", type=click.Choice(["x", "y", "z"]), default="z", show_default=True)
@click.option(
    "--size",
    type=(click.IntRange(1), click.IntRange(1)),
    default=(1600, 1200),
    show_default=True,
    metavar="W H",
    help="In pixels.",
)
def plot(
    cage: Path,
    boundary: str | None,
    output: str | None,
    quads: int | None,
    wires: bool | None,
    curves: bool | None,
    poles: bool,
    normals: bool,
    color: str,
    up: str,
    size: tuple[int, int],
) -> None:
    """Draw the surface, its cage and its extraordinary points."""
    surface = _surface(cage, boundary)
    with terminal.working("drawing"):
        ls.plot(
            surface,
            output,
            n=quads,
            cage=wires,
            curves=curves,
            poles=poles,
            normals=normals,
            color=color,
            up=up,
            window_size=size,
        )
    if output is not None:
        click.echo(output)


@main.command()
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    default=Path("limitsurf-demo"),
    show_default=True,
    metavar="DIR",
    help="Where results and picture go.",
)
@click.option("--queries", type=click.IntRange(1), default=1_000_000, show_default=True)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
@click.pass_context
def demo(context: click.Context, output: Path, queries: int, seed: int) -> None:
    """Evaluate a bundled cage at random, check it against the refiner, draw it."""
    from limitsurf.shell.demo import run

    if not run(output, queries, seed):
        context.exit(1)
