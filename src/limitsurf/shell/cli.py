"""The command line, ``limitsurf``. Every command is one call of the public API and its report."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
import numpy as np

import limitsurf as ls
from limitsurf.mesh import BOUNDARY
from limitsurf.shell import terminal
from limitsurf.shell.plot import COLOR

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from limitsurf.mesh import Mesh
    from limitsurf.surface import LimitSurface

Command = TypeVar("Command", bound=Callable[..., Any])

# What a user can cause; anything else is a defect of the program and shows its traceback.
ERRORS = (ValueError, OSError, IndexError, ImportError, MemoryError)


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

    \b
    Example:
      limitsurf info cage.obj
      limitsurf evaluate --help

    A CAGE is an OBJ or USD file. A face in a query is a limit face: a quad is one; another polygon
    is as many as it has corners, in their order. Every u and v is in [0, 1].
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


def _surface(cage: Path, boundary: str | None, channels: tuple[str, ...] = ()) -> LimitSurface:
    mesh = ls.read(cage)
    for name in channels:
        if name not in mesh.channels:
            known = ", ".join(map(repr, mesh.channels)) or "none"
            raise click.UsageError(f"the cage has no channel {name!r}; it has {known}")
    with terminal.working("building the surface"):
        return ls.LimitSurface(mesh, boundary=boundary)


@main.command()
@_on_cage
def info(cage: Path, boundary: str | None) -> None:
    """Say what a cage is made of, what is irregular and why.

    \b
    Example:
      limitsurf info cage.obj
    """
    mesh = ls.read(cage)
    with terminal.working("building the surface"):
        facts = list(_facts(mesh, boundary))
    terminal.say_table(facts)


def _facts(mesh: Mesh, boundary: str | None) -> Iterator[tuple[str, str]]:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    used = mesh.vertex_faces > 0
    start, end = mesh.edges.T
    links = coo_array((np.ones(mesh.n_edges), (start, end)), shape=(mesh.n_vertices,) * 2)
    parts = len(np.unique(connected_components(links)[1][used]))
    border, unused = mesh.boundary_edge.any(), ~used
    yield "vertices", _parts(mesh.n_vertices, {"in no face": unused})
    on_edges = {"on the boundary": mesh.boundary_edge, "not manifold": mesh.nonmanifold_edge}
    yield "edges", _parts(mesh.n_edges, on_edges)
    yield "faces", f"{mesh.n_faces}"
    yield "components", f"{parts}, {'open' if border else 'closed'}"
    yield "corners of faces", terminal.histogram(mesh.sizes)
    odd = mesh.nonmanifold_vertex
    for name, where in (
        ("valences inside", used & ~mesh.boundary_vertex & ~odd),
        ("faces at boundary vertices", mesh.boundary_vertex & ~odd),
        ("faces at vertices that are not manifold", odd),
    ):
        if where.any():
            yield name, terminal.histogram(mesh.vertex_faces[where])
    for name, sharpness in (("creases", mesh.creases[1]), ("corners", mesh.corners[1])):
        if len(sharpness):
            yield name, terminal.sharpness(sharpness)
    if len(mesh.holes):
        yield "holes", f"{len(mesh.holes)}"
    for name, (values, _, interpolation) in mesh.channels.items():
        yield f"channel {name}", f"{len(values)} values, {interpolation}"
    try:
        surface = ls.LimitSurface(mesh, boundary=boundary)
    except ValueError as error:
        yield "limit surface", f"none: {terminal.sentence(error)}"
        return
    rules = {**surface.rules, "scheme": surface.rules["scheme"].name}
    for name, value in rules.items():
        chosen = getattr(mesh, name) is not None or (name == "boundary" and boundary is not None)
        yield name, value if chosen else f"{value}, by default"
    yield "limit faces", f"{len(surface.limit_faces)}"
    for reason, count in surface.patches.summary():
        yield f"  {reason}", f"{count}"
    if corners := _special_corners(surface):
        yield "special corners of patches", corners


def _special_corners(surface: LimitSurface) -> str:
    """What surrounds the special corners of patches, and of how many."""
    patches = surface.patches
    counts: Counter[tuple[bool, str, int]] = Counter()
    for sector, number in zip(patches.sectors, np.bincount(patches.kind).tolist(), strict=False):
        if sector is not None:
            counts[sector.kind != "interior", sector.kind, sector.faces] += number
    return ", ".join(
        f"{f'{kind} of {faces} faces' if sharp else f'valence {faces}'} ({number})"
        for (sharp, kind, faces), number in sorted(counts.items())
    ).replace(" 1 faces", " 1 face")


def _parts(total: int, which: dict[str, NDArray[np.bool_]]) -> str:
    """A number, and how many of them are something else than usual."""
    found = [f"{np.sum(those)} of them {what}" for what, those in which.items() if those.any()]
    return ", ".join([f"{total}", *found])


@main.command()
@_on_cage
@click.option(
    "--queries", metavar="FILE", help="CSV, NPZ, NPY, Parquet or Zarr of face, u, v; - reads CSV."
)
@click.option("--grid", type=click.IntRange(1), metavar="N", help="N x N per limit face.")
@click.option("--random", type=click.IntRange(0), metavar="N", help="N on random limit faces.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="For --random.")
@click.option(
    "--order", type=click.IntRange(0), default=0, help="Derivatives up to this order as well."
)
@click.option("--normals", is_flag=True, help="Unit normals as well.")
@click.option(
    "--channel",
    "channels",
    metavar="NAME",
    multiple=True,
    help="A face-varying channel, such as uv, as well; may be given several times.",
)
@click.option(
    "-o",
    "--output",
    metavar="FILE",
    help=".csv, .npz, .npy, .parquet or .zarr; CSV to stdout without.",
)
@click.option(
    "--workers",
    type=click.IntRange(-1),
    default=-1,
    metavar="N",
    help="Threads; by default one for each processor.",
)
@click.option(
    "--scheduler", metavar="ADDRESS", help="Evaluate on the Dask cluster of this scheduler."
)
def evaluate(
    cage: Path,
    boundary: str | None,
    queries: str | None,
    grid: int | None,
    random: int | None,
    seed: int,
    order: int,
    normals: bool,
    channels: tuple[str, ...],
    output: str | None,
    workers: int,
    scheduler: str | None,
) -> None:
    """Evaluate positions, derivatives, normals and channels.

    \b
    Example:
      limitsurf evaluate cage.obj --random 1000 --order 1 --normals -o answers.npz
      limitsurf evaluate cage.obj --queries answers.npz -o again.csv

    Columns of CSV and Parquet are face, u, v, x, y, z, then derivatives x_u, y_u, z_u, x_v, ... and
    normals n_x, n_y, n_z. Arrays of NPZ and Zarr and fields of NPY are face, u, v, position, du,
    dv, duu, duv, dvv, ... and normal. Values and derivatives of a channel "st" are the arrays st,
    st_du, ... and the columns st_0, st_1, st_du_0, ...

    A grid takes the centres of N x N equal cells, u first, so that no two of its points coincide.

    Queries and answers stream: files may be larger than memory. Queries in Parquet may also be a
    directory of such files, or a quoted pattern: --queries "part.*.parquet". With --scheduler,
    workers read and write shared files themselves, Parquet as a directory of parts.
    """
    from limitsurf.shell import answers as files
    from limitsurf.shell import cluster
    from limitsurf.shell import queries as sources

    if sum(given is not None for given in (queries, grid, random)) != 1:
        raise click.UsageError("need one of --queries, --grid and --random")
    if output is not None:
        files.check_target(output, as_folder=scheduler is not None)
    with ExitStack() as stack:
        asked = None if queries is None else stack.enter_context(sources.reading(queries))
        if scheduler is not None and not (
            asked and asked.rows and output and output.endswith((".parquet", ".zarr"))
        ):
            raise click.UsageError(
                "workers of a cluster read and write files themselves: --scheduler needs --queries "
                "in NPY, Parquet or Zarr, and an --output in Parquet or Zarr"
            )
        surface = _surface(cage, boundary, channels)
        faces = len(surface.limit_faces)
        if grid is not None:
            asked = sources.grid_queries(faces, grid)
        elif random is not None:
            asked = sources.random_queries(faces, random, seed)
        assert asked is not None
        threads = workers if scheduler is None else 1
        question = files.Question(order, normals, channels, threads)
        on_screen = output is None and sys.stdout.isatty()
        done = stack.enter_context(terminal.counting("evaluating", asked.total, on_screen))
        if scheduler is not None and output is not None:
            cluster.evaluate(scheduler, surface, asked, question, output, done)
            return
        write = stack.enter_context(files.writing(output, asked.total))
        for answers in files.answered(surface, asked.batches, question):
            write(answers)
            done(len(answers["face"]))


@main.command()
@_on_cage
@click.option("--levels", type=click.IntRange(1), default=4, show_default=True)
@click.pass_context
def validate(context: click.Context, cage: Path, boundary: str | None, levels: int) -> None:
    """Compare the surface with recursive refinement.

    \b
    Example:
      limitsurf validate cage.obj --levels 3

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
@click.option("--channel", metavar="NAME", help="Draw a channel, such as uv, in its own space.")
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
    channel: str | None,
    color: str,
    up: str,
    size: tuple[int, int],
) -> None:
    """Draw the surface, its cage and its extraordinary points.

    \b
    Example:
      limitsurf plot cage.obj -o picture.png

    Creases are drawn as thick edges of the cage.
    """
    surface = _surface(cage, boundary, () if channel is None else (channel,))
    with terminal.working("drawing"):
        ls.plot(
            surface,
            output,
            n=quads,
            cage=wires,
            curves=curves,
            poles=poles,
            normals=normals,
            channel=channel,
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
    """Evaluate a bundled cage at random, check it against the refiner, draw it.

    \b
    Example:
      limitsurf demo --queries 100000 -o results
    """
    from limitsurf.shell.demo import run

    if not run(output, queries, seed):
        context.exit(1)
