"""Measure the library on cages, in turn with OpenSubdiv in the same run; prints JSON.

    python tests/bench/bench.py --opensubdiv ./opensubdiv_peer > bench.json
    python tests/bench/report.py bench.json

A cage is a file, or the N of a closed N x N quad torus with 5 % extraordinary vertices (310 gives
98,636 faces, 987 gives 999,885); or pole:N, N quads around a vertex and as many around them, or
prism:N, two N-gons and N quads. After loop: a cage is cut into triangles and subdivided by Loop.
The shapes in OpenSubdiv's folder regression/shapes are files, too.

Each cage is measured in a process of its own, on one thread, by compiled kernels whatever the size
of a call. ``opensubdiv_peer.cpp`` says how the other side is built; it gets the same cage and the
same queries through files, waits while this side is timed, and then does the same job by each of
its ways: so both meet the same load of the machine. Every figure is the least of some rounds, in
processor time, which other users of the machine disturb least; the median is given beside it, and
the least time on the clock. First use is measured in new processes, with kernels in the cache on
disk and without. If the package adobe-lagrange is installed, it refines, too.
"""

from __future__ import annotations

import importlib.util
import inspect
import json
import multiprocessing
import os
import platform
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

import limitsurf as ls

CAGES = ["310", "987", "loop:220", "pole:100", "pole:1000", "prism:100", "prism:1000"]
HEAVY = {"grid", "weights,", "uv,", "set-up", "refined"}  # before which room is made
LARGE = 300_000  # faces of cages for which it is
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
    seconds: float
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
    clock: Callable[[], float] = time.process_time


@dataclass
class Times:
    """Seconds of processor and of wall clock that runs of a job took."""

    cpu: list[float] = field(default_factory=list)
    wall: list[float] = field(default_factory=list)

    def add(self, cpu: float, wall: float) -> Times:
        self.cpu.append(cpu)
        self.wall.append(wall)
        return self

    def figures(self, items: float, shown: str = "cpu") -> dict[str, Any]:
        """Nanoseconds per item; `ns` is the least, and of the processor unless said otherwise."""
        ns = np.array([self.cpu, self.wall]) / items * 1e9
        (least, wall), (median, wall_median) = ns.min(axis=1), np.median(ns, axis=1)
        if shown == "wall":
            least, median = wall, wall_median
        return {"ns": least, "median": median, "wall": wall, "runs": len(self.cpu)}


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


def with_uv(mesh: ls.Mesh) -> ls.Mesh:
    """A cage without texture coordinates with some: a chart of each quarter of the faces."""
    chart = np.arange(mesh.n_faces) * 4 // mesh.n_faces
    pairs = np.repeat(chart, mesh.sizes) * mesh.n_vertices + mesh.indices
    used, places = np.unique(pairs, return_inverse=True)
    values = mesh.points[used % mesh.n_vertices, :2]
    return bare(mesh, {"uv": (values, places, "corners_plus1")})


def pole(n: int) -> ls.Mesh:
    """A vertex with n quads around it, and n x 2 more around these; open."""
    turn = np.arange(2 * n) * np.pi / n
    ring = np.arange(2 * n)
    circle = np.stack([np.cos(turn), np.sin(turn), 0.1 * np.cos(3 * turn)], axis=-1)
    points = np.concatenate([[[0.0, 0.0, 0.3]], circle, 2 * circle])
    even, next_one, last = ring[::2], np.roll(ring, -1), np.roll(ring, 1)
    inner = np.stack([0 * even, 1 + last[::2], 1 + even, 1 + next_one[::2]], axis=-1)
    outer = np.stack([1 + ring, 1 + 2 * n + ring, 1 + 2 * n + next_one, 1 + next_one], axis=-1)
    return ls.Mesh(points, np.concatenate([inner, outer]))


def prism(n: int) -> ls.Mesh:
    """Two faces of n sides, and n quads between them."""
    turn, ring = np.arange(n) * 2 * np.pi / n, np.arange(n)
    circle = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=-1)
    points = np.concatenate([circle, circle + np.array([0, 0, 1])])
    quads = np.stack([ring, np.roll(ring, -1), n + np.roll(ring, -1), n + ring], axis=-1)
    sides = np.concatenate([[n, n], np.full(n, 4)])
    return ls.Mesh(points, (sides, np.concatenate([ring[::-1], n + ring, quads.ravel()])))


def cut_up(mesh: ls.Mesh) -> ls.Mesh:
    """Triangles for Loop: those from the first corner of each face to its other edges."""
    later = np.arange(mesh.n_corners) - np.repeat(mesh.offsets[:-1], mesh.sizes)
    second = np.flatnonzero((later > 0) & (later < np.repeat(mesh.sizes, mesh.sizes) - 1))
    corners = np.stack([second - later[second], second, second + 1], axis=-1)
    tags = {"creases": mesh.creases, "corners": mesh.corners, "boundary": mesh.boundary}
    channels = {name: (x[0], x[1][corners.ravel()], x[2]) for name, x in mesh.channels.items()}
    return ls.Mesh(mesh.points, mesh.indices[corners], scheme="loop", channels=channels, **tags)


def cage(word: str) -> ls.Mesh:
    """The cage that a word of the command line names, with texture coordinates."""
    kind, _, rest = word.rpartition(":")
    if kind.startswith("loop"):
        return cut_up(cage(word.removeprefix("loop:")))
    if kind in ("pole", "prism"):
        return with_uv({"pole": pole, "prism": prism}[kind](int(rest)))
    if word.isdecimal():
        return with_uv(torus(int(word)))
    path = Path(word)
    if path.suffix == ".h":  # OBJ in a string of C++
        lines = re.findall(r'^"(.*)\\n"', path.read_text(), re.MULTILINE)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "shape.obj"
            path.write_text("\n".join(lines))
            mesh = ls.read(path)
    else:
        mesh = ls.read(path)
    return bare(mesh, mesh.channels) if "uv" in mesh.channels else with_uv(mesh)


def bare(mesh: ls.Mesh, channels: Any = None) -> ls.Mesh:
    """The same points, faces, sharpness and rules, without holes, and with nothing cached."""
    return ls.Mesh(
        mesh.points,
        (mesh.sizes, mesh.indices),
        creases=mesh.creases,
        corners=mesh.corners,
        scheme=mesh.scheme,
        boundary=mesh.boundary,
        channels=channels,
    )


def sides(mesh: ls.Mesh) -> int:
    """How many a face has that is one limit face."""
    return 3 if mesh.scheme == "loop" else 4


def odd_vertices(mesh: ls.Mesh) -> Array:
    """Around which the surface is no plain spline: poles, sharp vertices, corners of n-gons."""
    inside, n = {4: (4, 2), 3: (6, 3)}[sides(mesh)], sides(mesh)
    odd: Array = mesh.vertex_faces != np.where(mesh.boundary_vertex, inside[1], inside[0])
    odd[mesh.creases[0]] = odd[mesh.corners[0]] = True
    odd[mesh.indices[np.repeat(mesh.sizes != n, mesh.sizes)]] = True
    return odd


def draw(mesh: ls.Mesh, faces: Array, n: int, seed: int) -> Queries:
    """Random places on some limit faces, in random order."""
    rng = np.random.default_rng(seed)
    return (rng.choice(faces, n), *inside(mesh, *rng.random((2, n))))


def inside(mesh: ls.Mesh, u: Array, v: Array) -> tuple[Array, Array]:
    """Places in a square as they are, or folded into the triangle that is half of it."""
    beyond = (u + v > 1) & (sides(mesh) == 3)
    return np.where(beyond, 1 - u, u), np.where(beyond, 1 - v, v)


def by_face(queries: Queries) -> Queries:
    order = np.argsort(queries[0], kind="stable")
    face, u, v = queries
    return face[order], u[order], v[order]


# The jobs


def pin() -> None:
    """Have compiled kernels do everything in this process, whatever the size of a call."""
    os.environ["LIMITSURF_ENGINE"] = "compiled"
    ls.precompile()


def first_result(surface: ls.LimitSurface) -> None:
    """One result, for which a surface prepares all that others need."""
    surface.jet(0, 0.3, 0.3, order=1)


def ready(mesh: ls.Mesh) -> ls.LimitSurface:
    """A surface made from points and faces that has its first result."""
    surface = ls.LimitSurface(bare(mesh))
    first_result(surface)
    return surface


def set_up(mesh: ls.Mesh, surface: ls.LimitSurface) -> Iterator[Job]:
    ways = "topology + bfr precache", "topology + far adaptive and patch table"
    yield Job("set-up", "", "face", mesh.n_faces, partial(ready, mesh), ways)
    points = mesh.points[::-1].copy()

    def moved() -> None:
        first_result(surface.with_points(points))

    yield Job("new points", "", "face", mesh.n_faces, moved, ("bfr new points", "far new points"))


def with_out(method: Callable[..., Array], *queries: Any, **words: Any) -> Callable[[], Any] | None:
    """A call that writes into an array which is there already, where methods take one."""
    if "out" not in inspect.signature(method).parameters:
        return None
    result = method(*queries, **words)
    return (
        partial(method, *queries, **words, out=result) if isinstance(result, np.ndarray) else None
    )


def scattered(surface: ls.LimitSurface, name: str, queries: Queries) -> Iterator[Job]:
    n = len(queries[0])
    ways: tuple[str, ...] = f"bfr {name}", f"far {name}"
    if name.endswith("random"):
        ways = *ways, f"bfr {name}, visited by face"

    def normals() -> Any:
        return surface.evaluate(*queries), surface.normal(*queries)

    for number, order in enumerate(("P", "+d1", "+d2")):
        yield Job(name, order, "query", n, partial(surface.jet, *queries, order=number), ways)
    if name == "random":
        yield Job(name, "normal", "query", n, normals, ways)
        into = with_out(surface.evaluate, *queries)
        if into:
            yield Job("random, evaluate(out=)", "P", "query", n, into, ways)


def alone(surface: ls.LimitSurface, queries: Queries) -> Iterator[Job]:
    """What OpenSubdiv has no call for."""
    n = len(queries[0])
    yield Job("tangents", "", "query", n, partial(surface.tangents, *queries))
    yield Job("curvature", "", "query", n, partial(surface.curvature, *queries))
    yield Job("random", "+d3", "query", n, partial(surface.jet, *queries, order=3))


def small_calls(surface: ls.LimitSurface, queries: Queries) -> Iterator[Job]:
    """The first thousand queries, one in a call and all in one; there each is a call of C++."""
    places = list(zip(*(x[:1000].tolist() for x in queries), strict=True))
    thousand = tuple(x[:1000] for x in queries)

    def normals(*place: Any) -> Any:
        return surface.evaluate(*place), surface.normal(*place)

    orders: dict[str, Callable[..., Any]] = {
        "P": surface.evaluate,
        "+d1": partial(surface.jet, order=1),
        "normal": normals,
    }
    for order, method in orders.items():

        def one_by_one(method: Callable[..., Any]) -> None:
            for place in places:
                method(*place)

        ways, n = ("bfr thousand", "far thousand"), len(places)
        yield Job("one query in a call", order, "query", n, partial(one_by_one, method), ways)
        yield Job("1,000 in a call", order, "query", n, partial(method, *thousand), ways)


def of_channel(mesh: ls.Mesh, queries: Queries) -> Iterator[Job]:
    """Texture coordinates: set up beside a ready surface, and evaluated."""
    surface, n = ls.LimitSurface(mesh), len(queries[0])
    first_result(surface)

    def both() -> None:
        surface = ls.LimitSurface(bare(mesh, mesh.channels))
        first_result(surface)
        surface.jet(0, 0.3, 0.3, order=1, channel="uv")

    bfr, far = "bfr precache", "far adaptive and patch table"
    ways: tuple[str, ...] = (
        f"topology + {bfr} + bfr uv precache",
        f"topology + {far} + far uv adaptive and patch table",
    )
    yield Job("set-up with uv", "", "face", mesh.n_faces, both, ways)
    for number, order in enumerate(("P", "+d1")):
        run = partial(surface.jet, *queries, order=number, channel="uv")
        ways = "bfr uv random", "far uv random", "bfr uv random, visited by face"
        yield Job("uv, random", order, "query", n, run, ways)


def gridded(surface: ls.LimitSurface, faces: int) -> Iterator[Job]:
    """Positions and normals at the middles of 8 x 8 cells of each limit face."""
    n = min(faces, len(surface.limit_faces))
    cells = (np.arange(8) + 0.5) / 8
    queries: Any = np.arange(n)[:, None, None], cells[:, None], cells
    if sides(surface.mesh) == 3:
        queries = np.arange(n)[:, None, None], *inside(surface.mesh, cells[:, None], cells)

    def normals() -> Any:
        return surface.evaluate(*queries), surface.normal(*queries)

    ways = "bfr grid 8 x 8", "far grid 8 x 8"
    yield Job("grid 8 x 8", "normal", "query", 64 * n, normals, ways)


def several(surface: ls.LimitSurface, queries: Queries, nus: list[tuple[int, int]]) -> list[Any]:
    """Weights of some orders."""
    found: list[Any] = surface.weights(*queries, nu=nus)
    return found


def weighted(surface: ls.LimitSurface, queries: Queries) -> Iterator[Job]:
    n, points = len(queries[0]), surface.points
    several(surface, tuple(x[:1] for x in queries), [(0, 0)])  # what is made once for a surface
    for order, nus in (("P", [(0, 0)]), ("+d1", [(0, 0), (1, 0), (0, 1)])):

        def apply(operators: list[Any]) -> list[Any]:
            return [operator @ points for operator in operators]

        create = partial(several, surface, queries, nus)
        ways: tuple[str, ...] = ("stencils, create", "bfr weights, create")
        yield Job("weights, create", order, "query", n, create, ways)
        ways = ("stencils, apply",)
        yield Job("weights, apply", order, "query", n, partial(apply, create()), ways)


def near_and_far(surface: ls.LimitSurface, odd: Array, n: int) -> Iterator[Job]:
    """First derivatives in faces whose first corner is odd, in their midst and all but there."""
    mesh = surface.mesh
    first = mesh.indices[mesh.offsets[:-1]]
    faces = np.flatnonzero((mesh.sizes == sides(mesh)) & odd[first])
    if len(faces):
        face = np.random.default_rng(3).choice(surface.limit_faces.first[faces], n)
        for depth in (0.3, 1e-300):
            at = np.full(n, depth)
            run = partial(surface.jet, face, at, at, order=1)
            yield Job(f"u = v = {depth}", "+d1", "query", n, run)


def shared_out(surface: ls.LimitSurface, queries: Queries) -> Iterator[Job]:
    for workers in (1, 2):
        run = partial(surface.jet, *queries, order=1, workers=workers)
        name, n = f"random, workers={workers}", len(queries[0])
        yield Job(name, "+d1", "query", n, run, clock=time.perf_counter)


def refining(mesh: ls.Mesh, options: Options) -> Iterator[Job]:
    """Refined meshes, operators, points, limits; and texture coordinates beside points."""
    with_channel, mesh = mesh, bare(mesh)
    for level in range(1, options.levels + 1):
        n = mesh.n_corners * 4 ** (level - 1) * (4 if sides(mesh) == 3 else 3) // 3
        if n > options.max_faces:
            return
        name, theirs = f"refined L{level}", f"uniform L{level}"

        def fine(mesh: ls.Mesh, level: int) -> Any:
            fine = ls.refined(mesh, level)
            return fine.points, fine.indices, [fine.channels[name][0] for name in fine.channels]

        yield Job(name, "", "output face", n, partial(fine, mesh, level), (theirs,))
        if n > options.max_faces / 4:
            continue
        run: Callable[[], Any] = partial(fine, with_channel, level)
        yield Job(f"{name} with uv", "", "output face", n, run, (f"{theirs} with uv",))
        run = partial(ls.refined, mesh, level, operator=True)
        yield Job(f"{name}, operator", "", "output face", n, run, (f"{theirs}, operator",))
        known, operator = ls.refined(mesh, level, operator=True)
        ways = f"{theirs}, points", f"{theirs}, stencils"
        run = partial(operator.__matmul__, mesh.points)
        yield Job(f"{name}, points", "", "output face", n, run, ways)

        def limits(known: Any, normals: bool) -> Any:
            fine = known.with_points(known.points)  # forgets limits that are already known
            return fine.limit_points, fine.limit_normals if normals else None

        for normals, what in ((False, "limit points"), (True, "limit points and normals")):
            run, ways = partial(limits, known, normals), (f"{theirs}, {what}",)
            yield Job(f"{name}, {what}", "", "output face", n, run, ways)


# Timing


def seconds(run: Callable[[], Any], runs: int) -> Times:
    """Of some runs."""
    times = Times()
    for _ in range(runs):
        cpu, wall = time.process_time(), time.perf_counter()
        run()
        times.add(time.process_time() - cpu, time.perf_counter() - wall)
    return times


def timed(job: Job, options: Options, peer: Peer | None) -> dict[str, Any]:
    """Both sides in turn: a round that warms up, and others until there are enough of them.

    What takes OpenSubdiv long it does but once, and so do both if it takes very long.
    """
    start = time.perf_counter()
    ours, theirs = Times(), {way: Times() for way in (job.ways if peer else ())}
    warms = options.runs > 1  # in the first round, which does not count
    for round_ in range(options.runs + warms):
        passed = time.perf_counter() - start
        if passed > options.seconds * (1 if round_ > warms else 10):
            break
        took = seconds(job.run, 1)
        ours = took if round_ == warms else ours.add(took.cpu[0], took.wall[0])
        for way, times in list(theirs.items()):
            if round_ == 1 and warms:
                if times.wall[0] > options.seconds:
                    continue
                times = theirs[way] = Times()
            found = peer.did(way, job.order) if peer else None
            if found is None:
                del theirs[way]
            else:
                times.add(*found)
    shown = "wall" if job.clock is time.perf_counter else "cpu"
    row: dict[str, Any] = {"job": job.name, "order": job.order, "per": job.per, "items": job.items}
    row |= ours.figures(job.items, shown)
    row["opensubdiv"] = {way: times.figures(job.items) for way, times in theirs.items()}
    best = min((x["ns"] for x in row["opensubdiv"].values()), default=np.nan)
    say(f"  {job.name} {job.order}: {row['ns']:.4g} ns per {job.per}; OpenSubdiv {best:.4g}")
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


class Peer:
    """OpenSubdiv's side for a cage: a process that does a job whenever it is asked to."""

    def __init__(
        self, program: Path, mesh: ls.Mesh, queries: dict[str, Queries], options: Options
    ) -> None:
        self._folder = tempfile.TemporaryDirectory()
        folder = self.folder = Path(self._folder.name)
        # what is default here is not for readers of OBJ files
        ls.write(folder / "cage.obj", bare(mesh, mesh.channels))
        words: list[Any] = [program, folder / "cage.obj"]
        for name, (face, u, v) in queries.items():
            records = np.empty(len(face), [("face", "<i4"), ("u", "<f8"), ("v", "<f8")])
            records["face"], records["u"], records["v"] = face, u, v
            records.tofile(folder / name)
            words += [f"--{name}", folder / name]
        words += ["--samples", options.samples, "--grid-faces", options.grid_faces]
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(list(map(str, words)), stdin=pipe, stdout=pipe, text=True)

    def __enter__(self) -> Peer:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()
        self._folder.cleanup()

    def ask(self, line: str) -> dict[str, Any]:
        """What it answers to a line; it ends by itself when nobody asks any more."""
        assert self._process.stdin
        assert self._process.stdout
        self._process.stdin.write(f"{line}\n")
        self._process.stdin.flush()
        said = self._process.stdout.readline()
        if not said:
            raise RuntimeError(f"OpenSubdiv's side ended when it was asked for {line!r}")
        answer: dict[str, Any] = json.loads(said)
        return answer

    def did(self, way: str, order: str) -> tuple[float, float] | None:
        """Seconds of processor and of clock for a job done so, or None if it cannot be."""
        cpu = wall = 0.0
        for part in way.split(" + "):
            answer = self.ask(f"{part} {order}".strip())
            if "error" in answer:
                say(f"  OpenSubdiv, {part} {order}: {answer['error']}")
                return None
            cpu, wall = cpu + answer["cpu"], wall + answer["wall"]
        return cpu, wall

    def jets(self) -> Array:
        """P, d/du, d/dv of the random queries, (n, 3, 3)."""
        self.ask(f"write {self.folder / 'P'}")
        return np.fromfile(self.folder / "P").reshape(-1, 3, 3)


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
    return lambda levels: min(seconds(partial(refine, num_levels=levels), min(runs, 2)).cpu)


COLD = """
import sys, time
start = time.perf_counter()
import numpy as np
import limitsurf as ls
points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
surface, n = ls.LimitSurface(ls.Mesh(points, quads)), int(sys.argv[1])
u, v = np.random.default_rng(0).random((2, n))
surface.jet(np.arange(n) % 6, u, v, order=1)
print(time.perf_counter() - start)
"""


def cold(n: int, folder: str) -> float:
    """Seconds from `import` to n positions and derivatives on a cube, in a new process."""
    here = {name: x for name, x in os.environ.items() if not name.startswith("LIMITSURF_")}
    here["LIMITSURF_CACHE_DIR"] = folder
    words = [sys.executable, "-c", COLD, str(n)]
    done = subprocess.run(words, check=True, stdout=subprocess.PIPE, env=here)
    return float(done.stdout)


def wait(folder: str) -> None:
    """Until nobody works any more for a cache that is to be deleted, or two minutes."""
    mine = f"LIMITSURF_CACHE_DIR={folder}".encode()
    for _ in range(240):
        users = 0
        for environment in Path("/proc").glob("[0-9]*/environ"):
            with suppress(OSError):
                users += mine in environment.read_bytes().split(b"\0")
        if not users:
            return
        time.sleep(0.5)


def fresh(options: Options) -> dict[str, Any]:
    """Seconds of new processes, with all kernels in the cache on disk and with none."""
    say("first use")
    numbers = [n for n in (1, 1000, 100_000, 1_000_000) if n <= max(1000, options.queries)]
    found: dict[str, Any] = {"empty": {}, "filled": {}}
    for n in numbers:
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
            found["empty"][str(n)] = cold(n, folder)
            wait(folder)
            say(f"  {n} queries, nothing compiled: {found['empty'][str(n)]:.3g} s")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        words = [sys.executable, "-c", "import limitsurf as ls; ls.precompile()"]
        before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        subprocess.run(words, check=True, env=os.environ | {"LIMITSURF_CACHE_DIR": folder})
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
        found["precompile"] = {"cpu": cpu, "wall": time.perf_counter() - start}
        for n in numbers:
            found["filled"][str(n)] = min(cold(n, folder) for _ in range(min(options.runs, 3)))
            say(f"  {n} queries, all compiled: {found['filled'][str(n)]:.3g} s")
    if options.opensubdiv:
        cube = prism(4)
        found["opensubdiv"] = {}
        for n in numbers:
            places = draw(cube, np.arange(6), n, 0)

            def start_and_answer(places: Queries = places) -> None:
                assert options.opensubdiv
                with Peer(options.opensubdiv, cube, {"random": places}, options) as peer:
                    peer.ask("bfr random +d1")

            found["opensubdiv"][str(n)] = min(seconds(start_and_answer, options.runs).wall)
    return found


def machine() -> dict[str, Any]:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next(line.split(": ")[1] for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        model = platform.processor()
    return {
        "processor": model,
        "date": time.strftime("%Y-%m-%d"),
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0],
        "system": platform.platform(),
        "python": platform.python_version(),
    } | {name: version(name) for name in ("limitsurf", "numpy", "scipy", "numba")}


# One cage


def measured(word: str, options: Options) -> dict[str, Any]:
    """All figures of a cage; in a new process, for the sake of its memory."""
    pin()
    if word.startswith(("pole:", "prism:")):
        few = {"queries": min(options.queries, 20_000), "samples": min(options.samples, 2_000)}
        options = replace(options, **few)
    with_channel = cage(word)
    mesh = bare(with_channel)
    say(f"{word}: {mesh.n_faces} faces")
    ready(cut_up(torus(8)) if sides(mesh) == 3 else torus(8))  # before memory is measured
    before, start = resident(), time.process_time()
    surface = ready(mesh)
    first = time.process_time() - start
    memory = {"per face": (resident() - before) / mesh.n_faces}
    memory["per face, peak of set-up"] = (peak() - before) / mesh.n_faces
    odd = odd_vertices(mesh)
    faces = surface.limit_faces.face
    irregular = np.logical_or.reduceat(odd[mesh.indices], mesh.offsets[:-1])[faces]
    queries = {"random": draw(mesh, np.arange(len(faces)), options.queries, 1)}
    if 0 < irregular.sum() < len(irregular):
        queries["irregular"] = draw(mesh, np.flatnonzero(irregular), options.queries, 2)
    figures: dict[str, Any] = {
        "cage": Path(word.removeprefix("loop:")).stem.removeprefix("catmark_"),
        "scheme": mesh.scheme or "catmull-clark",
        "faces": mesh.n_faces,
        "irregular limit faces": int(irregular.sum()),
        "first set-up, ns per face": first / mesh.n_faces * 1e9,
        "bytes of memory": memory,
    }

    def jobs() -> Iterator[Job]:
        yield from set_up(mesh, surface)
        for kind, places in queries.items():
            prefix = "" if kind == "random" else f"{kind} "
            yield from scattered(surface, f"{prefix}random", places)
            yield from scattered(surface, f"{prefix}sorted", by_face(places))
        yield from gridded(surface, options.grid_faces)
        face, u, v = (part[: options.samples] for part in queries["random"])
        yield from alone(surface, (face, u, v))
        yield from small_calls(surface, queries["random"])
        yield from weighted(surface, (face, u, v))
        yield from near_and_far(surface, odd, options.samples)
        yield from shared_out(surface, queries["random"])
        yield from of_channel(with_channel, queries["random"])
        yield from refining(with_channel, options)

    with ExitStack() as stack:
        peer = None
        if options.opensubdiv:
            peer = stack.enter_context(Peer(options.opensubdiv, with_channel, queries, options))
            memory["per face, Bfr precached"] = peer.ask("bytes")["bytes"]
            # on regular faces both are exact
            jet = surface.jet(*queries["random"], order=1)
            gap = np.abs(peer.jets() - np.stack([jet[0, 0], jet[1, 0], jet[0, 1]], axis=1))
            gap[irregular[queries["random"][0]]] = 0
            figures["difference on regular faces"] = gap.max() / np.ptp(mesh.points, axis=0).max()
        family, rows = "", []
        for job in jobs():
            if not job.name.startswith(options.only or ""):
                continue
            changed = family != (family := job.name.split()[0])
            if peer and changed and family in HEAVY and mesh.n_faces > LARGE:
                peer.ask("drop")
            rows.append(timed(job, options, peer))
    memory["peak of all jobs"] = peak()
    refine = lagrange_refined(mesh, options.runs) if mesh.scheme != "loop" else None
    levels = {f"refined L{n}": n for n in range(1, options.levels + 1)}
    for row in rows:
        if refine and row["job"] in levels and row["items"] <= options.max_faces / 20:
            say(f"  adobe-lagrange: {row['job']}")
            row["lagrange"] = refine(levels[row["job"]]) / row["items"] * 1e9
    return figures | {"rows": rows}


@click.command()
@click.argument("cages", nargs=-1)
@click.option("--queries", default=500_000, show_default=True, help="How many.")
@click.option("--samples", default=100_000, show_default=True, help="That get weights.")
@click.option("--grid-faces", default=20_000, show_default=True, help="With 64 points each.")
@click.option("--levels", default=2, show_default=True, help="Of refinement, at most.")
@click.option("--max-faces", default=20_000_000, show_default=True, help="Of refined meshes.")
@click.option("--runs", default=5, show_default=True, help="Rounds of a job, at most.")
@click.option("--seconds", default=1.0, show_default=True, help="After which no round begins.")
@click.option("--only", multiple=True, help="Jobs whose name begins so; may be repeated.")
@click.option("--first-use/--no-first-use", default=True, show_default=True, help="Of processes.")
@click.option(
    "--opensubdiv",
    type=click.Path(exists=True, path_type=Path, resolve_path=True),
    help="The program made of opensubdiv_peer.cpp.",
)
def main(cages: tuple[str, ...], first_use: bool, **chosen: Any) -> None:
    """Measure CAGES (see above; all of the page on speed but the car), and print JSON."""
    os.environ |= ONE_THREAD
    options = Options(**chosen)
    figures: dict[str, Any] = {"machine": machine()}
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context, max_tasks_per_child=1) as pool:
        cages = cages or CAGES
        figures["cages"] = [pool.submit(measured, word, options).result() for word in cages]
    if first_use:
        figures["first use, seconds"] = fresh(options)
    click.echo(json.dumps(figures, indent=1))


if __name__ == "__main__":
    main()
