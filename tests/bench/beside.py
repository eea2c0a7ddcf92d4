"""Compare schemes with each other, and Loop's refinement with other programs; prints JSON.

    python tests/bench/beside.py 310 > beside.json

The cage is the N x N torus of ``bench.py`` with 5 % extraordinary vertices, for Loop cut into
triangles. Loop's refinement stands beside that of trimesh, libigl and Open3D, those that are
installed. One thread, compiled kernels, processor time: the least of some rounds, in which all take
turns. Nanoseconds a query, and a face of the set-up, from faces to the first position; bytes a face
of a surface that is ready, without the points and faces that it was made of; seconds a refinement.
"""

from __future__ import annotations

import json
import time
import tracemalloc
from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any

import click
import numpy as np
from bench import Queries, bare, cut_up, draw, odd_vertices, torus
from numpy.typing import NDArray

import limitsurf as ls

Array = NDArray[Any]


def least(jobs: dict[str, Callable[[], Any]], runs: int) -> dict[str, float]:
    """The least processor time of each job, in rounds."""
    found = dict.fromkeys(jobs, float("inf"))
    for job in jobs.values():
        job()
    for _ in range(runs):
        for name, job in jobs.items():
            start = time.process_time()
            job()
            found[name] = min(found[name], time.process_time() - start)
    return found


def jet(surface: ls.LimitSurface, queries: Queries) -> Callable[[], Any]:
    """Positions and first derivatives."""
    return lambda: surface.jet(*queries, order=1)


def of_scheme(scheme: str, mesh: ls.Mesh, count: int) -> dict[str, Callable[[], Any]]:
    """Queries of one surface."""
    surface = ls.LimitSurface(mesh, scheme=scheme, engine="compiled")
    odd = np.logical_or.reduceat(odd_vertices(mesh)[mesh.indices], mesh.offsets[:-1])
    chosen = {"random": np.arange(mesh.n_faces), "irregular": np.flatnonzero(odd)}
    chosen["regular"] = np.flatnonzero(~odd)
    jobs = {
        f"{scheme}: {name}": jet(surface, draw(mesh, faces, count, 1))
        for name, faces in chosen.items()
    }
    # corners of faces, all at one of its extraordinary vertices
    corner = odd_vertices(mesh)[mesh.indices].reshape(mesh.n_faces, -1)
    face = np.resize(np.flatnonzero(corner[:, 0]), count)
    for u in (0.3, 0.1, 1e-300):
        u, v = np.full((2, count), u)
        jobs[f"{scheme}: u = {u[0]:g}"] = jet(surface, (face, u, v))
    return jobs


def ready(scheme: str, mesh: ls.Mesh) -> ls.LimitSurface:
    """From faces to the first position."""
    surface = ls.LimitSurface(bare(mesh), scheme=scheme, engine="compiled")
    surface.evaluate(0, 0.3, 0.3)
    return surface


def kept(scheme: str, mesh: ls.Mesh) -> float:
    """Bytes per face of a surface that is ready for first derivatives."""
    tracemalloc.start()
    surface = ready(scheme, mesh)
    surface.jet(0, 0.3, 0.3, order=1)
    size = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    return (size - mesh.points.nbytes - mesh.indices.nbytes) / mesh.n_faces


def of_peers(points: Array, faces: Array) -> dict[str, Callable[[], Any]]:
    """One step of Loop's by each of the other programs that is installed."""

    def of_trimesh() -> Callable[[], Any]:
        remesh = import_module("trimesh.remesh")
        return lambda: remesh.subdivide_loop(points, faces, iterations=1)

    def of_libigl() -> Callable[[], Any]:
        igl = import_module("igl")
        return lambda: igl.loop(points, faces, 1)

    def of_open3d() -> Callable[[], Any]:
        geometry, utility = map(import_module, ("open3d.geometry", "open3d.utility"))
        mesh = geometry.TriangleMesh(
            utility.Vector3dVector(points.copy()),
            utility.Vector3iVector(faces.astype(np.int32).copy()),
        )
        return lambda: mesh.subdivide_loop(number_of_iterations=1)

    found: dict[str, Callable[[], Any]] = {}
    for name, peer in (("trimesh", of_trimesh), ("libigl", of_libigl), ("open3d", of_open3d)):
        try:
            found[f"{name}: refined once"] = peer()
        except ImportError:
            continue
    return found


@click.command()
@click.argument("size", type=int, default=310)
@click.option("--runs", default=5)
@click.option("--queries", default=200_000)
def main(size: int, runs: int, queries: int) -> None:
    """Print figures of a cage of SIZE x SIZE quads."""
    quads = torus(size)
    triangles = cut_up(quads)
    cages = {"catmull-clark": quads, "loop": triangles, "doo-sabin": quads}
    jobs = {}
    for scheme, mesh in cages.items():
        jobs |= of_scheme(scheme, mesh, queries)
    found = {name: 1e9 * x / queries for name, x in least(jobs, runs).items()}
    building = {scheme: partial(ready, scheme, mesh) for scheme, mesh in cages.items()}
    for scheme, seconds in least(building, runs).items():
        found[f"{scheme}: set-up"] = 1e9 * seconds / cages[scheme].n_faces
        found[f"{scheme}: bytes"] = kept(scheme, cages[scheme])

    def refined() -> Any:
        fine = ls.refined(bare(triangles), 1, scheme="loop")
        return fine.points, fine.indices

    refining: dict[str, Callable[[], Any]] = {"loop: refined once": refined}
    refining |= of_peers(triangles.points, np.asarray(triangles.uniform))
    found |= least(refining, min(runs, 5))
    sizes = {"quads": quads.n_faces, "triangles": triangles.n_faces}
    print(json.dumps(sizes | {"times": found}, indent=1))


if __name__ == "__main__":
    main()
