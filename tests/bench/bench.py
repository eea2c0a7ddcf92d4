"""Measure the library on cages, beside NumPy and other programs in the same run; prints JSON.

    python tests/bench/bench.py cage.obj 310 987 --opensubdiv ./opensubdiv_peer > bench.json
    python tests/bench/report.py bench.json

A cage is a file, or the N of a closed N x N quad torus with 5 % extraordinary vertices (310 gives
98,636 faces, 987 gives 999,885). Each is measured in a process of its own, on one thread, in CPU
time, which other users of the machine disturb least; every figure is the best of some runs after a
first one that warms up. The plain NumPy path does each job once. ``opensubdiv_peer.cpp`` says how
the other side is built; it gets the same cage and the same queries through files. If the package
adobe-lagrange is installed, it refines, too.
"""

from __future__ import annotations

import importlib.util
import inspect
import json
import math
import multiprocessing
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

import limitsurf as ls
from limitsurf import _kernels

Array = NDArray[Any]
Queries = tuple[Array, Array, Array]  # limit face, u, v

ONE_THREAD = dict.fromkeys(
    ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"], "1"
)


@dataclass
class Options:
    """How much to measure; as on the command line."""

    queries: int
    samples: int
    grid_faces: int
    levels: int
    max_faces: int
    runs: int
    numpy: bool
    only: tuple[str, ...]
    opensubdiv: Path | None


@dataclass
class Job:
    """Something to time: `run` does as many items as `items` says, each what `per` names."""

    name: str
    order: str  # "P", "+d1" with first derivatives, "+d2" with the second, "normal"; or ""
    per: str
    items: int
    run: Callable[[], Any]
    ways: tuple[str, ...] = ()  # of OpenSubdiv to do the same; the times of "one + other" add up
    numpy: bool = True  # whether to ask the NumPy path, too
    clock: Callable[[], float] = time.process_time


# Cages and queries


def torus(n: int, seed: int = 0) -> ls.Mesh:
    """A noisy torus of n x n quads; 0.66 % of the cells are inset, some of these twice."""
    rng = np.random.default_rng(seed)
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    a, b = 2 * np.pi * i / n, 2 * np.pi * j / n
    r = 1 + 0.05 * np.sin(9 * a) * np.cos(7 * b) + 0.3 / n * rng.standard_normal((n, n))
    points = np.stack(
        [(3 + r * np.cos(b)) * np.cos(a), (3 + r * np.cos(b)) * np.sin(a), r * np.sin(b)], -1
    ).reshape(-1, 3)
    corner = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    faces = (i[..., None] + corner[:, 0]) % n * n + (j[..., None] + corner[:, 1]) % n
    faces = faces.reshape(-1, 4)
    for share in (0.0066 * 0.85, 0.0066 * 0.15):
        chosen = rng.choice(len(faces), int(share * n * n), replace=False)
        old = faces[chosen]
        corners = points[old]
        centre = corners.mean(axis=1, keepdims=True)
        normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        # up to 0.4 times the side of the cell
        height = 0.4 * rng.random((len(old), 1)) / np.sqrt(np.linalg.norm(normal, axis=1))[:, None]
        inner = (corners + centre) / 2 + (height * normal)[:, None]
        new = len(points) + np.arange(old.size).reshape(-1, 4)
        points = np.concatenate([points, inner.reshape(-1, 3)])
        faces[chosen] = new
        sides = [
            np.stack([old[:, k], old[:, k - 3], new[:, k - 3], new[:, k]], -1) for k in range(4)
        ]
        faces = np.concatenate([faces, *sides])
    return ls.Mesh(points, faces)


def bare(mesh: ls.Mesh) -> ls.Mesh:
    """The same points, faces and sharpness, without holes and channels, and with nothing cached."""
    return ls.Mesh(
        mesh.points,
        (mesh.sizes, mesh.indices),
        creases=mesh.creases,
        corners=mesh.corners,
        boundary=mesh.boundary,
    )


def odd_vertices(mesh: ls.Mesh) -> Array:
    """Around which the surface is no plain B-spline: poles, sharp vertices, corners of n-gons."""
    odd: Array = mesh.vertex_faces != np.where(mesh.boundary_vertex, 2, 4)
    odd[mesh.creases[0]] = odd[mesh.corners[0]] = True
    odd[mesh.indices[np.repeat(mesh.sizes != 4, mesh.sizes)]] = True
    return odd


def draw(faces: Array, n: int, seed: int) -> Queries:
    """Random places on some limit faces, in random order."""
    rng = np.random.default_rng(seed)
    return (rng.choice(faces, n), *rng.random((2, n)))


def by_face(queries: Queries) -> Queries:
    order = np.argsort(queries[0], kind="stable")
    face, u, v = queries
    return face[order], u[order], v[order]


# The jobs


@contextmanager
def numpy_only() -> Iterator[None]:
    """NumPy for all calls, for which else there are kernels."""
    before = _kernels.available, _kernels._spent
    _kernels.available, _kernels._spent = set(), -math.inf
    try:
        yield
    finally:
        _kernels.available, _kernels._spent = before


def ready(mesh: ls.Mesh) -> ls.LimitSurface:
    """A surface made from points and faces that has its first result."""
    surface = ls.LimitSurface(bare(mesh))
    surface.jet(0, 0.5, 0.5, order=1)
    return surface


def set_up(mesh: ls.Mesh, surface: ls.LimitSurface) -> Iterator[Job]:
    ways = "topology + bfr precache", "topology + far adaptive and patch table"
    yield Job("set-up", "", "face", mesh.n_faces, partial(ready, mesh), ways)
    points = mesh.points[::-1].copy()

    def moved() -> None:
        surface.with_points(points).jet(0, 0.5, 0.5, order=1)

    ways = "bfr new points", "far new points"
    yield Job("new points", "", "face", mesh.n_faces, moved, ways, numpy=False)


def scattered(surface: ls.LimitSurface, name: str, queries: Queries) -> Iterator[Job]:
    n = len(queries[0])
    ways: tuple[str, ...] = f"bfr {name}", f"far {name}"
    if name == "random":
        ways = *ways, "bfr random, visited by face"

    def normals() -> Any:
        return surface.evaluate(*queries), surface.normal(*queries)

    for number, order in enumerate(("P", "+d1", "+d2")):
        yield Job(name, order, "query", n, partial(surface.jet, *queries, order=number), ways)
    if name == "random":
        yield Job(name, "normal", "query", n, normals, ways)


def gridded(surface: ls.LimitSurface, faces: int) -> Iterator[Job]:
    """Positions and normals at the middles of 8 x 8 cells of each limit face."""
    n = min(faces, len(surface.limit_faces))
    cells = (np.arange(8) + 0.5) / 8
    queries = np.arange(n)[:, None, None], cells[:, None], cells

    def normals() -> Any:
        return surface.evaluate(*queries), surface.normal(*queries)

    ways = "bfr grid 8 x 8", "far grid 8 x 8"
    yield Job("grid 8 x 8", "normal", "query", 64 * n, normals, ways)


def weighted(surface: ls.LimitSurface, queries: Queries) -> Iterator[Job]:
    n, points = len(queries[0]), surface.points
    for order, nus in (("P", [(0, 0)]), ("+d1", [(0, 0), (1, 0), (0, 1)])):

        def create(nus: list[tuple[int, int]]) -> list[Any]:
            matrices: list[Any] = surface.weights(*queries, nu=nus)
            return matrices

        def apply(operators: list[Any]) -> list[Any]:
            return [operator @ points for operator in operators]

        ways: tuple[str, ...] = ("stencils, create", "bfr weights, create")
        yield Job("weights, create", order, "query", n, partial(create, nus), ways)
        operators = create(nus)
        ways = ("stencils, apply",)
        yield Job("weights, apply", order, "query", n, partial(apply, operators), ways, False)


def near_and_far(surface: ls.LimitSurface, odd: Array, n: int) -> Iterator[Job]:
    """First derivatives in faces whose first corner is odd, in their midst and all but there."""
    mesh = surface.mesh
    faces = np.flatnonzero((mesh.sizes == 4) & odd[mesh.indices[mesh.offsets[:-1]]])
    if len(faces):
        face = np.random.default_rng(3).choice(surface.limit_faces.first[faces], n)
        for depth in (0.3, 1e-300):
            at = np.full(n, depth)
            run = partial(surface.jet, face, at, at, order=1)
            yield Job(f"u = v = {depth}", "+d1", "query", n, run)


def shared_out(surface: ls.LimitSurface, queries: Queries) -> Iterator[Job]:
    if "workers" in inspect.signature(surface.jet).parameters:
        for workers in (1, 2):
            run = partial(surface.jet, *queries, order=1, workers=workers)
            name = f"random, workers={workers}"
            n, clock = len(queries[0]), time.perf_counter
            yield Job(name, "+d1", "query", n, run, numpy=False, clock=clock)


def refining(mesh: ls.Mesh, options: Options) -> Iterator[Job]:
    for level in range(1, options.levels + 1):
        n = mesh.n_corners * 4 ** (level - 1)
        if n > options.max_faces:
            return
        name, theirs = f"refined L{level}", f"uniform L{level}"
        moderate = n <= options.max_faces / 4

        def fine(level: int) -> Any:
            fine = ls.refined(mesh, level)
            return fine.points, fine.indices

        ways: tuple[str, ...] = (f"{theirs}, topology and points",)
        yield Job(name, "", "output face", n, partial(fine, level), ways, moderate)
        if not moderate:
            continue

        def both(level: int) -> Any:
            return ls.refined(mesh, level, operator=True)

        def apply(operator: Any) -> Any:
            return operator @ mesh.points

        def limits(fine: Any) -> Any:
            fine = fine.with_points(fine.points)  # forgets limits that are already known
            return fine.limit_points, fine.limit_normals

        ways = (f"{theirs}, topology + {theirs}, stencils, create",)
        yield Job(f"{name}, operator", "", "output face", n, partial(both, level), ways)
        known, operator = both(level)
        ways = f"{theirs}, points", f"{theirs}, stencils, apply"
        run: Callable[[], Any] = partial(apply, operator)
        yield Job(f"{name}, points", "", "output face", n, run, ways, False)
        ways = (f"{theirs}, limit positions and tangents",)
        yield Job(f"{name}, limits", "", "output face", n, partial(limits, known), ways)


# Timing


def seconds(
    run: Callable[[], Any], runs: int, clock: Callable[[], float] = time.process_time
) -> float:
    """Best time of some runs."""
    times = []
    for _ in range(runs):
        start = clock()
        run()
        times.append(clock() - start)
    return min(times)


def timed(job: Job, options: Options) -> dict[str, Any]:
    if options.runs > 1:
        job.run()
    ns = seconds(job.run, options.runs, job.clock) / job.items * 1e9
    row = {"job": job.name, "order": job.order, "per": job.per, "items": job.items, "ns": ns}
    if options.numpy and job.numpy:
        with numpy_only():
            row["numpy_ns"] = seconds(job.run, 1) / job.items * 1e9
    say(f"  {job.name} {job.order}: {ns:.4g} ns per {job.per}")
    return row


def say(message: str) -> None:
    click.echo(message, err=True)


def resident() -> float:
    """Bytes of memory in use now; NaN where the system does not say."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return float("nan")
    return float(pages * resource.getpagesize())


def peak() -> float:
    """Most bytes of memory that were in use."""
    unit = 1 if sys.platform == "darwin" else 1024
    return float(unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)


# Others


def opensubdiv(
    mesh: ls.Mesh, queries: dict[str, Queries], options: Options
) -> tuple[dict[str, float], Array]:
    """Nanoseconds by "job order", and P, d/du, d/dv of the random queries, (n, 3, 3)."""
    say("  OpenSubdiv")
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        ls.write(folder / "cage.obj", mesh)
        words = [options.opensubdiv, folder / "cage.obj", "--write", folder / "P"]
        for name, (face, u, v) in queries.items():
            records = np.empty(len(face), [("face", "<i4"), ("u", "<f8"), ("v", "<f8")])
            records["face"], records["u"], records["v"] = face, u, v
            records.tofile(folder / name)
            words += [f"--{name}", folder / name]
        for name in ("runs", "samples", "grid_faces", "levels", "max_faces"):
            words += [f"--{name.replace('_', '-')}", getattr(options, name)]
        printed = subprocess.run(
            [str(word) for word in words], check=True, stdout=subprocess.PIPE, text=True
        ).stdout
        values = np.fromfile(folder / "P").reshape(-1, 3, 3)
    figures: dict[str, float] = {}
    for line in map(json.loads, printed.splitlines()):
        if "job" in line:
            figures[f"{line['job']} {line['order']}".strip()] = line["ns"]
        else:
            figures |= line
    return figures, values


def peers(job: Job, figures: dict[str, float]) -> dict[str, float]:
    """Nanoseconds of each way in which OpenSubdiv did this job."""
    found = {}
    for way in job.ways:
        parts = [f"{part} {job.order}".strip() for part in way.split(" + ")]
        if all(part in figures for part in parts):
            found[way] = sum(figures[part] for part in parts)
    return found


def lagrange_refined(mesh: ls.Mesh, runs: int) -> Callable[[int], float] | None:
    """Time of adobe-lagrange, where it is installed, for some levels of the untagged cage."""
    if importlib.util.find_spec("lagrange") is None:
        return None
    import lagrange

    cage = lagrange.SurfaceMesh()
    cage.add_vertices(np.array(mesh.points))
    cage.add_hybrid(mesh.sizes.astype(np.uint32), mesh.indices.astype(np.uint32))
    scheme = lagrange.subdivision.SchemeType.CatmullClark
    refine = partial(lagrange.subdivision.subdivide_mesh, cage, scheme=scheme)
    return lambda levels: seconds(partial(refine, num_levels=levels), min(runs, 2))


COLD = """
import time
start = time.perf_counter()
import numpy as np
import limitsurf as ls
points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
surface = ls.LimitSurface(ls.Mesh(points, quads))
u, v = np.random.default_rng(0).random((2, 1000))
surface.jet(np.arange(1000) % 6, u, v, order=1)
print(time.perf_counter() - start)
"""


def cold_start(runs: int) -> dict[str, float]:
    """Seconds from `import` to a first thousand results on a cube, and of that whole process."""
    inside: list[float] = []

    def start() -> None:
        done = subprocess.run([sys.executable, "-c", COLD], check=True, stdout=subprocess.PIPE)
        inside.append(float(done.stdout))

    whole = seconds(start, runs, time.perf_counter)
    return {"from import": min(inside), "whole process": whole}


def machine() -> dict[str, Any]:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next(line.split(": ")[1] for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        model = platform.processor()
    return {
        "processor": model,
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0],
        "system": platform.platform(),
        "python": platform.python_version(),
    } | {name: version(name) for name in ("limitsurf", "numpy", "scipy", "numba")}


# One cage


def measured(name: str, options: Options) -> dict[str, Any]:
    """All figures of a cage; in a new process, for the sake of its memory."""
    mesh = torus(int(name)) if name.isdecimal() else bare(ls.read(Path(name)))
    say(f"{name}: {mesh.n_faces} faces")
    _kernels.load()
    _kernels.available.update(_kernels.KINDS)
    ready(torus(8))  # compiles what set-up needs, before memory is measured
    before, start = resident(), time.process_time()
    surface = ready(mesh)
    first = time.process_time() - start
    memory = {"per face": (resident() - before) / mesh.n_faces}
    memory["per face, peak of set-up"] = (peak() - before) / mesh.n_faces
    odd = odd_vertices(mesh)
    faces = surface.limit_faces.face
    irregular = np.logical_or.reduceat(odd[mesh.indices], mesh.offsets[:-1])[faces]
    queries = {"random": draw(np.arange(len(faces)), options.queries, 1)}
    if irregular.any():
        queries["irregular"] = draw(np.flatnonzero(irregular), options.queries, 2)

    def jobs() -> Iterator[Job]:
        yield from set_up(mesh, surface)
        for kind, places in queries.items():
            prefix = "" if kind == "random" else f"{kind} "
            yield from scattered(surface, f"{prefix}random", places)
            yield from scattered(surface, f"{prefix}sorted", by_face(places))
        yield from gridded(surface, options.grid_faces)
        face, u, v = (part[: options.samples] for part in queries["random"])
        yield from weighted(surface, (face, u, v))
        yield from near_and_far(surface, odd, options.samples)
        yield from shared_out(surface, queries["random"])
        yield from refining(mesh, options)

    done = []
    for job in jobs():
        if job.name.startswith(options.only or ""):
            done.append((replace(job, run=bool), timed(job, options)))
    figures: dict[str, Any] = {
        "cage": Path(name).stem,
        "faces": mesh.n_faces,
        "irregular limit faces": int(irregular.sum()),
        "first set-up, ns per face": first / mesh.n_faces * 1e9,
        "bytes of memory": memory | {"peak of all jobs": peak()},
        "rows": [row for _, row in done],
    }
    if options.opensubdiv:
        theirs, values = opensubdiv(mesh, queries, options)
        for job, row in done:
            row["opensubdiv_ns"] = peers(job, theirs)
        memory["per face, Bfr precached"] = theirs["bfr bytes per face"]
        figures["bytes of memory"] |= memory
        # on regular faces both are exact
        jet = surface.jet(*queries["random"], order=1)
        gap = np.abs(values - np.stack([jet[0, 0], jet[1, 0], jet[0, 1]], axis=1))
        gap[irregular[queries["random"][0]]] = 0
        figures["difference on regular faces"] = gap.max() / np.ptp(mesh.points, axis=0).max()
    refine = lagrange_refined(mesh, options.runs)
    levels = {f"refined L{n}": n for n in range(1, options.levels + 1)}
    for _, row in done:
        if refine and row["job"] in levels and row["items"] <= options.max_faces / 2:
            say(f"  adobe-lagrange: {row['job']}")
            row["lagrange_ns"] = refine(levels[row["job"]]) / row["items"] * 1e9
    return figures


@click.command()
@click.argument("cages", nargs=-1, required=True)
@click.option("--queries", default=1_000_000, show_default=True, help="How many.")
@click.option("--samples", default=100_000, show_default=True, help="That get weights.")
@click.option("--grid-faces", default=100_000, show_default=True, help="With 64 points each.")
@click.option("--levels", default=3, show_default=True, help="Of refinement, at most.")
@click.option("--max-faces", default=20_000_000, show_default=True, help="Of refined meshes.")
@click.option("--runs", default=5, show_default=True, help="Of which the best counts.")
@click.option("--numpy/--no-numpy", default=True, show_default=True, help="Time the NumPy path.")
@click.option("--only", multiple=True, help="Jobs whose name begins so; may be repeated.")
@click.option(
    "--opensubdiv",
    type=click.Path(exists=True, path_type=Path, resolve_path=True),
    help="The program made of opensubdiv_peer.cpp.",
)
@click.option("--huge", is_flag=True, help="Set up and evaluate ten million faces, too.")
def main(cages: Iterable[str], huge: bool, **chosen: Any) -> None:
    """Measure CAGES, each a file or the size N of a torus, and print JSON."""
    os.environ |= ONE_THREAD
    options = Options(**chosen)
    tasks = [(cage, options) for cage in cages]
    if huge:
        # a second surface would not fit
        tasks.append(
            ("3122", replace(options, runs=1, numpy=False, opensubdiv=None, only=("random",)))
        )
    figures: dict[str, Any] = {
        "machine": machine(),
        "cold start, seconds": cold_start(options.runs),
    }
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context, max_tasks_per_child=1) as pool:
        figures["cages"] = [pool.submit(measured, *task).result() for task in tasks]
    click.echo(json.dumps(figures, indent=1))


if __name__ == "__main__":
    main()
