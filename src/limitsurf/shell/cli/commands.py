"""The command line, ``limitsurf``. Every command is one call of the public API and its report."""

from __future__ import annotations

import os
import sys
import warnings
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import click

import limitsurf as ls
from limitsurf import memory
from limitsurf.shell import files, terminal
from limitsurf.shell.cli import curves, places
from limitsurf.shell.cli.analysis import spectrum as spectrum_command
from limitsurf.shell.cli.convert import convert
from limitsurf.shell.cli.fitting import fit
from limitsurf.shell.cli.interpolating import interpolate
from limitsurf.shell.cli.measures import measure
from limitsurf.shell.cli.modes import modes
from limitsurf.shell.cli.offsets import offset
from limitsurf.shell.cli.own import OF_SCHEME, SCHEME
from limitsurf.shell.cli.program import (
    PATH,
    Cage,
    Program,
    answers_option,
    json_option,
    mesh_suffix,
    output_option,
    reads_cage,
    report,
    to_option,
    workers_option,
    write_mesh,
)
from limitsurf.shell.cli.rays import intersect

MANY = 2**63 - 1


@click.group(
    cls=Program,
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
      limitsurf refine cage.obj -o - | limitsurf tessellate - -n 4 -o fine.ply

    A CAGE is a file, in OBJ or USD, which hold sharpness too, or in PLY, OFF, STL, VTP, VTU, VTK,
    glTF, 3MF or DAE; or - for the standard input. A face in a query is a limit face: a quad is one;
    another polygon is as many as it has corners, in their order. Every u and v is in [0, 1].

    Exit codes: 0, done; 1, the answer is no (validate, demo), or the reader of a pipe went away; 2,
    bad input or usage, with one line on the standard error; 130 after Ctrl-C, 143 after SIGTERM.
    Files appear whole or not at all.
    """
    if context.invoked_subcommand is None:
        terminal.say(context.get_help())


@main.command()
@reads_cage
@json_option
def info(cage: Cage, as_json: bool) -> None:
    """Say what a cage is made of, what is irregular and why.

    \b
    Example:
      limitsurf info cage.obj
      limitsurf info cage.obj --json

    Keys of --json: cage; vertices, unused_vertices, edges, boundary_edges, apart_edges (which lie
    on another one of the boundary), nonmanifold_edges, faces, components, closed; face_sizes,
    valences, boundary_faces, nonmanifold_faces (how often which number of corners, or of faces at a
    vertex, occurs); creases, corners (number, infinite, least, most); holes; channels (of each name
    values, numbers, interpolation); face_data (names); scheme, units (metres), up (as the cage
    says, else null); schemes (of each mesh in a USD file, if they
    differ, else null); rules (of each that the scheme has value, by_default); limit_faces; patches
    (how many limit faces are covered how); special_corners (kind, faces, patches); no_surface (why
    there is none, else null).
    """
    from limitsurf.shell.cli import facts
    from limitsurf.shell.io.parts import MIXED

    mesh = cage.read()
    schemes = cage.schemes() if mesh.scheme == MIXED else None
    with terminal.working("building the surface"):
        found = facts.cage_facts(mesh, cage.rules, schemes)
    if as_json:
        terminal.say_json({"cage": cage.path, **found})
    else:
        terminal.say_table(facts.told(found))


@main.command()
@reads_cage
@click.option(
    "--queries",
    type=PATH,
    metavar="FILE",
    help="CSV, NPZ, NPY, Parquet or Zarr of face, u, v; - reads CSV.",
)
@click.option("--grid", type=click.IntRange(1, MANY), metavar="N", help="N x N per limit face.")
@click.option(
    "--random", type=click.IntRange(0, MANY), metavar="N", help="N on random limit faces."
)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="For --random.")
@click.option(
    "--order", type=click.IntRange(0, 20), default=0, help="Derivatives up to this order as well."
)
@click.option("--normals", is_flag=True, help="Unit normals as well.")
@click.option(
    "--channel",
    "channels",
    metavar="NAME",
    multiple=True,
    help="A face-varying channel, such as uv, as well; may be given several times.",
)
@answers_option
@workers_option
@click.option(
    "--scheduler", metavar="ADDRESS", help="Evaluate on the Dask cluster of this scheduler."
)
@json_option
def evaluate(
    *,
    cage: Cage,
    queries: str | None,
    grid: int | None,
    random: int | None,
    seed: int,
    order: int,
    normals: bool,
    channels: tuple[str, ...],
    output: str,
    workers: int,
    scheduler: str | None,
    as_json: bool,
) -> None:
    """Evaluate positions, derivatives, normals and channels.

    \b
    Example:
      limitsurf evaluate cage.obj --random 1000 --order 1 --normals -o answers.npz
      limitsurf evaluate cage.obj --queries answers.npz -o again.csv
      limitsurf evaluate cage.obj --grid 2 --json

    Columns of CSV and Parquet are face, u, v, x, y, z, then derivatives x_u, y_u, z_u, x_v, ... and
    normals n_x, n_y, n_z. Arrays of NPZ and Zarr and fields of NPY are face, u, v, position, du,
    dv, duu, duv, dvv, ... and normal. Values and derivatives of a channel "st" are the arrays st,
    st_du, ... and the columns st_0, st_1, st_du_0, ...

    A grid takes the centres of N x N equal cells, u first, so that no two of its points coincide.

    Queries and answers stream: files may be larger than memory. Queries in Parquet may also be a
    directory of such files, or a quoted pattern: --queries "part.*.parquet". With --scheduler,
    workers read and write shared files themselves, Parquet as a directory of parts.

    With --json, answers on the standard output are one object in each line, of the same names as
    arrays; with -o FILE there is one object: output, answers (their number), limit_faces.
    """
    from limitsurf.shell import cluster
    from limitsurf.shell.io import answers as targets
    from limitsurf.shell.io import queries as sources

    if sum(given is not None for given in (queries, grid, random)) != 1:
        raise click.UsageError("need one of --queries, --grid and --random")
    if queries == "-" == cage.path:
        raise click.UsageError("cage and queries cannot both be on the standard input")
    to_file = output != "-"
    if to_file:
        targets.check_target(output, as_folder=scheduler is not None)
    with ExitStack() as stack:
        asked = None if queries is None else stack.enter_context(sources.reading(queries))
        if scheduler is not None and not (
            asked and asked.rows and output.endswith((".parquet", ".zarr"))
        ):
            raise click.UsageError(
                "workers of a cluster read and write files themselves: --scheduler needs --queries "
                "in NPY, Parquet or Zarr, and an --output in Parquet or Zarr"
            )
        surface = cage.surface(channels)
        faces, lattice = len(surface.limit_faces), surface.topology.lattice
        if grid is not None:
            asked = sources.grid_queries(faces, grid, lattice)
        elif random is not None:
            asked = sources.random_queries(faces, random, seed, lattice)
        assert asked is not None
        threads = workers if scheduler is None else 1
        question = targets.Question(order, normals, channels, threads)
        on_screen = not to_file and sys.stdout is not None and sys.stdout.isatty()
        if to_file:  # a byte for each number, at the very least
            files.check_room(output, (asked.total or 0) * (6 + 3 * order + 3 * normals))
        count = 0
        with terminal.counting("evaluating", asked.total, on_screen) as done:
            if scheduler is not None:
                cluster.evaluate(scheduler, surface, asked, question, output, done)
                count = asked.total or 0
            else:
                with targets.writing(output if to_file else None, asked.total, as_json) as write:
                    for answers in targets.answered(surface, asked.batches, question):
                        write(answers)
                        count += len(answers["face"])
                        done(len(answers["face"]))
        if as_json and to_file:
            report(output, as_json, answers=count, limit_faces=faces)


main.add_command(intersect)


@main.command()
@reads_cage
@click.option(
    "-n",
    "n",
    type=click.IntRange(1, MANY),
    metavar="N",
    help="N x N polygons per limit face; 8 if no tolerance is given.",
)
@click.option(
    "--chord",
    type=float,
    metavar="LENGTH",
    help="How far the surface may be from the polygons, in the units of the cage: a proved bound.",
)
@click.option(
    "--angle",
    type=float,
    metavar="DEGREES",
    help="How far normals of triangles, and between those of their corners, may be from the "
    "surface's: a proved bound.",
)
@click.option("--edge", type=float, metavar="LENGTH", help="Longest edge of a triangle.")
@click.option(
    "--max-triangles",
    type=click.IntRange(1, MANY),
    metavar="N",
    help="Make no more than so many, or fail before any is made.",
)
@output_option
@to_option
@click.option(
    "--normals/--no-normals",
    default=None,
    help="Unit normals, two at creases; by default where the format has a place.",
)
@click.option(
    "--channel",
    "channels",
    metavar="NAME",
    multiple=True,
    help="A face-varying channel as well; all that the format has a place for are included anyway.",
)
@workers_option
@json_option
def tessellate(
    *,
    cage: Cage,
    n: int | None,
    chord: float | None,
    angle: float | None,
    edge: float | None,
    max_triangles: int | None,
    output: str,
    to: str | None,
    normals: bool | None,
    channels: tuple[str, ...],
    workers: int,
    as_json: bool,
) -> None:
    """Write the surface as polygons, N x N per limit face or to a tolerance, welded.

    \b
    Example:
      limitsurf tessellate cage.obj -n 4 -o fine.obj
      limitsurf tessellate cage.obj --chord 0.001 -o fine.stl
      limitsurf tessellate cage.obj -n 4 | limitsurf info -

    All vertices lie on the surface, and no edge is open that is closed in the cage. USD and files
    of VTK hold all channels; other formats texture coordinates at most: the channel uv, or else st,
    or else the only one of two numbers. Others are left out with a warning.

    Keys of --json: output, vertices, faces, triangles, limit_faces, n, chord_error and angle_error
    (null where they are not known), normals, channels.
    """
    from limitsurf.shell.io.formats import WITH_NORMALS

    suffix = mesh_suffix(output, to, as_json)
    if normals and suffix not in WITH_NORMALS:
        raise click.UsageError(f"{suffix} has no place for normals: say --no-normals")
    normals = suffix in WITH_NORMALS if normals is None else normals
    surface = cage.surface(channels)
    channels = _with_others(surface, channels, suffix)
    with terminal.working("tessellating"):
        made = ls.tessellate(
            surface, n, chord=chord, angle=angle, edge=edge, max_triangles=max_triangles,
            normals=normals, channels=channels, workers=workers,
        )  # fmt: skip
    write_mesh(
        output,
        to,
        made,
        as_json,
        vertices=len(made.points),
        faces=len(made.sizes),
        triangles=int((made.sizes - 2).sum()),
        limit_faces=len(surface.limit_faces),
        n=8 if n is None and made.chord_error is None else n,
        chord_error=made.chord_error,
        angle_error=made.angle_error,
        normals=normals,
        channels=channels,
    )


def _with_others(
    surface: ls.LimitSurface, channels: tuple[str, ...], suffix: str
) -> tuple[str, ...]:
    """The channels that were asked for, and others that a format holds; a warning of the rest."""
    from limitsurf.shell.io.formats import WITH_CHANNELS, WITH_UV
    from limitsurf.shell.io.polygons import known_channels, texture

    held = {texture(surface.mesh)} if suffix in WITH_UV else set()
    found, lost = [], []
    for name in surface.mesh.channels:
        if name in channels:
            continue
        if suffix in WITH_CHANNELS or name in held:
            found.append(name)
        else:
            lost.append(f"channel {name!r}")
    if lost:
        text = f"a file of type {suffix} cannot hold everything, left out: {', '.join(lost)}"
        warnings.warn(text, stacklevel=1)
    return (*known_channels(surface, found), *channels)


main.add_command(places.closest)
main.add_command(curves.section)
main.add_command(places.sample)
main.add_command(interpolate)
main.add_command(fit)


@main.command()
@reads_cage
@click.option(
    "--levels", type=click.IntRange(0, 99), default=1, show_default=True, help="How often."
)
@click.option("--limit", is_flag=True, help="Move vertices to their limit positions.")
@output_option
@to_option
@json_option
def refine(
    cage: Cage, levels: int, limit: bool, output: str, to: str | None, as_json: bool
) -> None:
    """Subdivide a cage into a finer one of the same surface.

    \b
    Example:
      limitsurf refine cage.obj --levels 2 -o fine.obj
      limitsurf refine cage.obj | limitsurf validate -

    Creases, corners, holes and channels are carried on. With --limit, vertices lie on the surface;
    those without a limit stay.

    Keys of --json: output, vertices, edges, faces, levels, limit.
    """
    import numpy as np

    mesh_suffix(output, to, as_json)
    mesh = cage.read()
    with terminal.working("refining"):
        fine = ls.refined(mesh, levels, **cage.rules)
        if limit:
            places = fine.limit_points
            fine = fine.with_points(np.where(np.isnan(places), fine.points, places))
    counts = {"vertices": fine.n_vertices, "edges": fine.n_edges, "faces": fine.n_faces}
    write_mesh(output, to, fine, as_json, **counts, levels=levels, limit=limit)


@main.command()
@reads_cage
@click.option(
    "--levels", type=click.IntRange(1, 99), default=4, show_default=True, help="Refinements."
)
@click.option("--channel", metavar="NAME", help="A channel, such as uv, instead of the points.")
@workers_option
@json_option
@click.pass_context
def validate(
    context: click.Context,
    *,
    cage: Cage,
    levels: int,
    channel: str | None,
    workers: int,
    as_json: bool,
) -> None:
    """Compare the surface with recursive refinement.

    \b
    Example:
      limitsurf validate cage.obj --levels 3

    At each level, every vertex of the refined cage is compared with the surface at its (face, u,
    v): where it is (error, and the order at which it shrinks), and where its limit mask moves it
    (limit error, which is rounding alone). Exits with 1 if the latter is more than rounding.

    Keys of --json: cage, agrees, levels (a list of objects: level, error, order, limit_error).
    """
    surface = cage.surface(() if channel is None else (channel,))
    with terminal.working("refining"):
        table = ls.validate(surface, levels, channel=channel, workers=workers)
    right = ls.agrees(surface, table, channel=channel)
    if as_json:
        rows = terminal.validation_rows(table)
        terminal.say_json({"cage": cage.path, "agrees": right, "levels": rows})
    else:
        terminal.say_validation(table)
    if not right:
        click.echo("limitsurf: the limit error is more than rounding", err=True)
        context.exit(1)


main.add_command(measure)
main.add_command(modes)


@main.command()
@click.option("--valence", type=click.IntRange(2), metavar="N", help="Of a smooth vertex.")
@click.option(
    "--kind",
    type=click.Choice(["interior", "crease", "corner", "dart", "cone", "flap", "pendant"]),
    help="What is at the vertex, with --faces.",
)
@click.option("--faces", type=click.IntRange(1), metavar="K", help="How many faces there are.")
@click.option(
    "--position",
    type=click.IntRange(0),
    default=0,
    metavar="P",
    help="From which face of a sector it is seen.",
)
@click.option(
    "--scheme",
    type=SCHEME,
    metavar="NAME",
    default="catmull-clark",
    show_default=True,
    help=OF_SCHEME,
)
@click.option(
    "--digits",
    type=click.IntRange(1, 1000),
    default=10,
    show_default=True,
    metavar="D",
    help="Significant digits of decimals.",
)
@click.option("--exact", is_flag=True, help="Closed forms also where they are long.")
@click.option("--latex", is_flag=True, help="LaTeX arrays, for math mode.")
@json_option
def basis(
    *,
    valence: int | None,
    kind: str | None,
    faces: int | None,
    position: int,
    scheme: str | ls.Scheme,
    digits: int,
    exact: bool,
    latex: bool,
    as_json: bool,
) -> None:
    """Say the spectrum around a vertex: eigenvalues, masks, growth.

    \b
    Example:
      limitsurf basis --valence 5
      limitsurf basis --kind crease --faces 3 --exact
      limitsurf basis --valence 3 --digits 30 --latex

    \b
    Kinds of vertices:
      interior   smooth, amid faces; the same as --valence
      crease     on a boundary or sharp crease, the faces on one side
      corner     sharp, the faces between two sharp edges
      dart       the end of a sharp crease, all faces around
      cone       sharp, amid smooth faces
      flap       as a corner, but carried by a crease that does not bound it
      pendant    as a cone, but carried by a crease

    Each eigenvalue is told with how often it occurs, the sizes of its Jordan blocks if there are
    others than 1, and the block of the matrix that it is of: a Fourier frequency around a smooth
    vertex, the sharp curve or a wave beside it, or the outer points. Masks are of the vertex, its
    edge neighbours e and the opposite corners f of its faces, counter-clockwise, and where it is
    carried of the point m halfway between its neighbours on that crease.

    Keys of --json: scheme, paper, kind, faces, position, control_points; eigenvalues (real,
    imaginary, multiplicity, jordan, from, decimal, exact); growth (l1, l2, l3, the eigenvalues
    after 1; the factors first_derivatives, second_derivatives, curvature, normals); limit_mask and
    tangent_masks (point, decimal, exact). With --latex also latex beside exact.
    """
    from limitsurf.shell.cli import spectrum

    if (valence is None) == (faces is None):
        raise click.UsageError("need either --valence N, or --kind KIND with --faces K")
    if valence is not None and kind not in (None, "interior"):
        raise click.UsageError(f"--valence is of a smooth vertex; for a {kind} say --faces")
    with terminal.working("deriving"):
        found = ls.eigenbasis(
            scheme, valence, kind=kind or "interior", faces=faces, position=position
        )
        facts = spectrum.spectrum_facts(found, digits, latex)
    if as_json:
        terminal.say_json(facts)
    elif latex:
        terminal.say(spectrum.in_latex(facts, exact))
    else:
        spectrum.say(facts, exact)


main.add_command(spectrum_command)


@main.command()
@reads_cage
@click.option(
    "-o",
    "--output",
    type=PATH,
    metavar="FILE",
    help="A .png to write, or an .html to turn in a browser; without, a window opens.",
)
@click.option(
    "-n",
    "n",
    type=click.IntRange(1, MANY),
    metavar="N",
    help="N x N polygons drawn per limit face.",
)
@click.option("--quads", type=click.IntRange(1, MANY), hidden=True, help="Another name of -n.")
@click.option("--cage/--no-cage", "wires", default=None, help="Draw the cage.")
@click.option("--curves/--no-curves", default=None, help="Draw the edges of the limit faces.")
@click.option("--poles/--no-poles", default=None, help="Mark extraordinary points.")
@click.option("--normals", is_flag=True, help="Draw normals.")
@click.option("--axes", is_flag=True, help="Draw a box with numbers around.")
@click.option("--scale-bar", is_flag=True, help="Draw a bar of a round length.")
@click.option("--dark", is_flag=True, help="Draw on a dark ground.")
@click.option(
    "--isolines",
    type=click.IntRange(0, 1000),
    metavar="N",
    help="Draw N lines of constant u, and N of constant v, within each limit face.",
)
@click.option(
    "--scalars",
    type=click.Choice(["mean", "gaussian", "k1", "k2", "zebra"]),
    help="Colour the surface by a curvature, or by reflection lines.",
)
@click.option("--limits", type=(float, float), metavar="LOW HIGH", help="The range of the colours.")
@click.option("--cmap", metavar="NAME", help="The colours of scalars, by Matplotlib's names.")
@click.option("--label", metavar="TEXT", help="What the colour bar says.")
@click.option("--channel", metavar="NAME", help="Draw a channel, such as uv, in its own space.")
@click.option("--color", metavar="COLOR", help="Of the surface, #rrggbb or a name.")
@click.option(
    "--up",
    type=click.Choice(["x", "y", "z"]),
    help="The axis that points up in the picture; by default as the cage says, else z.",
)
@click.option(
    "--view",
    metavar="VIEW",
    callback=lambda _, __, view: _direction(view),
    help="From where to look: front, back, left, right, top, bottom, iso, or as 1,-2,0.5. The "
    "front is from +z if y is up, else from -y.",
)
@click.option(
    "--size",
    type=(click.IntRange(1, 8192), click.IntRange(1, 8192)),
    default=(1600, 1200),
    show_default=True,
    metavar="W H",
    help="In pixels.",
)
@workers_option
@json_option
def plot(
    *,
    cage: Cage,
    output: str | None,
    n: int | None,
    quads: int | None,
    wires: bool | None,
    channel: str | None,
    size: tuple[int, int],
    as_json: bool,
    **options: Any,
) -> None:
    """Draw the surface, its cage and its extraordinary points.

    \b
    Example:
      limitsurf plot cage.obj -o picture.png
      limitsurf plot cage.obj -o curvature.png --scalars mean --no-cage

    Creases are drawn as thick edges of the cage.

    Keys of --json: output (null for a window), width, height, limit_faces.
    """
    from limitsurf.shell.plot import picture

    picture.check_target(output, None, picture.SceneDrawing.suffixes)
    surface = cage.surface(() if channel is None else (channel,))
    faces = len(surface.limit_faces)
    given = {name: value for name, value in options.items() if value is not None}
    with terminal.working("drawing"):
        ls.plot(
            surface, output, n=n or quads, cage=wires, channel=channel, window_size=size, **given
        )
    report(output, as_json, width=size[0], height=size[1], limit_faces=faces)


def _direction(view: str | None) -> str | tuple[float, ...] | None:
    """A name, or numbers with commas between them."""
    if view is None or "," not in view:
        return view
    try:
        return tuple(map(float, view.split(",")))
    except ValueError:
        raise click.BadParameter(f"{view!r} is no direction such as 1,-2,0.5") from None


main.add_command(convert)
main.add_command(offset)


@main.command()
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, readable=False),
    default=Path("limitsurf-demo"),
    show_default=True,
    metavar="DIR",
    help="Where results and picture go.",
)
@click.option(
    "--queries",
    type=click.IntRange(1, MANY),
    default=1_000_000,
    show_default=True,
    metavar="N",
    help="How many random ones.",
)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Of chance.")
@json_option
@click.pass_context
def demo(context: click.Context, output: Path, queries: int, seed: int, as_json: bool) -> None:
    """Evaluate a bundled cage at random, check it against the refiner, draw it.

    \b
    Example:
      limitsurf demo --queries 20000 -o results

    On a new machine NumPy answers first, while kernels are compiled in the background; the same
    queries again, at the end, show how fast these are.

    Keys of --json: agrees, output (the files written), limit_faces, queries, seconds of the first
    use and steady_seconds, position_gap and normal_gap (the largest differences on the once refined
    cage), levels (as of validate).
    """
    from limitsurf.shell.cli.demo import run

    memory.refuse_beyond(queries, 400, "queries")
    facts = run(output, queries, seed, quiet=as_json)
    if as_json:
        terminal.say_json(facts)
    if not facts["agrees"]:
        context.exit(1)


@main.command()
@click.option(
    "--dir", "directory", type=PATH, metavar="DIR", help="Where, instead of the usual cache."
)
@json_option
def precompile(directory: str | None, as_json: bool) -> None:
    """Compile all kernels ahead, for processes to come.

    \b
    Example:
      limitsurf precompile
      limitsurf precompile --json

    This takes two minutes of one processor, once for each version and kind of processor. DIR is
    made if need be, for all to read; processes use it where LIMITSURF_CACHE_DIR names it.

    Keys of --json: directory, kernels, bytes, seconds.
    """
    from time import perf_counter

    from limitsurf.compiling import kept_kernels

    start = perf_counter()
    with terminal.working("compiling kernels"):
        place, sizes = kept_kernels(directory)
    seconds = perf_counter() - start
    facts = {"directory": place, "kernels": len(sizes), "bytes": sum(sizes), "seconds": seconds}
    if as_json:
        terminal.say_json(facts)
    else:
        size = sum(sizes) / 1e6
        terminal.say(f"{len(sizes)} kernels, {size:.1f} MB, in {place} ({seconds:.1f} s)")


@main.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]), required=False)
def completion(shell: str | None) -> None:
    """Print the script that lets a shell complete commands, options and files.

    \b
    Example:
      limitsurf completion bash
      limitsurf completion fish

    \b
    To install it, once:
      bash   echo 'eval "$(limitsurf completion bash)"' >> ~/.bashrc
      zsh    echo 'eval "$(limitsurf completion zsh)"' >> ~/.zshrc
      fish   limitsurf completion fish > ~/.config/fish/completions/limitsurf.fish

    Without a name it is for the shell of $SHELL.
    """
    from click.shell_completion import get_completion_class

    name = shell or os.path.basename(os.environ.get("SHELL", ""))
    kind = get_completion_class(name)
    if kind is None:
        raise click.UsageError(f"no completion for the shell {name!r}: say bash, zsh or fish")
    terminal.say(kind(main, {}, "limitsurf", "_LIMITSURF_COMPLETE").source())
