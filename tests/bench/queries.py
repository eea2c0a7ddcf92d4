"""Measure closest points and rays, in microseconds of processor time each; prints JSON.

    python tests/bench/queries.py CAGE.obj ... > queries.json

Points are on a surface, within 1 % of its size of it, and anywhere in its box; rays go between
points of the box. Beside the limit surface stand trimesh, Open3D and libigl, those that are
installed, asked of a tessellation of 16 x 16 quads to a limit face; ``off`` is by how much their
distances differ, of the size, at most. Each is asked once before, so that what is built is there.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from time import process_time
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

import limitsurf as ls

Array = NDArray[Any]
Call = Callable[[Array], Array]  # distances of points
Rays = Callable[[Array, Array], Array]  # t of rays; inf where nothing is hit


def of_trimesh(points: Array, triangles: Array) -> tuple[Call, Rays]:
    """Trimesh's queries of triangles; it needs rtree."""
    import_module("rtree")
    trimesh = import_module("trimesh")
    mesh = trimesh.Trimesh(points, triangles, process=False)

    def first(origins: Array, ways: Array) -> Array:
        found = np.full(len(origins), np.inf)
        at, ray, _ = mesh.ray.intersects_location(origins, ways)
        t = ((at - origins[ray]) * ways[ray]).sum(axis=1) / (ways[ray] ** 2).sum(axis=1)
        np.minimum.at(found, ray, t)
        return found

    return lambda x: np.asarray(trimesh.proximity.closest_point(mesh, x)[1]), first


def of_open3d(points: Array, triangles: Array) -> tuple[Call, Rays]:
    """Open3D's queries of triangles, in single precision."""
    open3d = import_module("open3d")
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(points.astype(np.float32), triangles.astype(np.uint32))

    def first(origins: Array, ways: Array) -> Array:
        rays = np.concatenate([origins, ways], axis=1).astype(np.float32)
        return np.asarray(scene.cast_rays(rays, nthreads=1)["t_hit"].numpy())

    def distances(x: Array) -> Array:
        return np.asarray(scene.compute_distance(x.astype(np.float32), nthreads=1).numpy())

    return distances, first


def of_libigl(points: Array, triangles: Array) -> tuple[Call, None]:
    """Distances by libigl, from a hierarchy of boxes that is built anew for each call."""
    igl = import_module("igl")
    return lambda x: np.sqrt(igl.point_mesh_squared_distance(x, points, triangles)[0]), None


PEERS: dict[str, Callable[[Array, Array], tuple[Call, Rays | None]]] = {
    "trimesh": of_trimesh,
    "open3d": of_open3d,
    "libigl": of_libigl,
}


def timed(call: Callable[..., Array], *arguments: Array) -> tuple[Array, float]:
    """What a call gives, and microseconds for each of what it was asked."""
    call(*arguments)
    begin = process_time()
    found = call(*arguments)
    return found, round((process_time() - begin) / len(arguments[0]) * 1e6, 2)


def jobs(mesh: ls.Mesh, surface: ls.LimitSurface, n: int) -> dict[str, tuple[Array, ...]]:
    """Points and rays that are asked for."""
    rng = np.random.default_rng(0)
    faces, (u, v) = rng.integers(0, len(surface.limit_faces), n), rng.random((2, n))
    if surface.topology.lattice.sloped:
        u, v = np.where(u + v > 1, [1 - v, 1 - u], [u, v])
    on, low, span = surface.evaluate(faces, u, v), mesh.points.min(axis=0), np.ptp(mesh.points, 0)
    near = on + rng.normal(size=on.shape) * 0.01 * span.max() / np.sqrt(3)
    one, other, box = low + rng.random((3, n, 3)) * span
    return {"on": (on,), "near": (near,), "box": (box,), "first hit": (one, other - one)}


def rows(path: Path, n: int, peers: tuple[str, ...]) -> Iterator[dict[str, Any]]:
    """Figures of one cage."""
    mesh = ls.read(path)
    surface = ls.LimitSurface(mesh, engine="compiled")
    size = float(np.ptp(mesh.points, axis=0).max())
    fine = ls.tessellate(surface, 16, normals=False)
    asked = jobs(mesh, surface, n)
    own: tuple[Call, Rays] = (
        lambda x: ls.closest_point(surface, x).distance,
        lambda *x: ls.intersect(surface, *x).t,
    )
    truth = {}
    for name, job in asked.items():
        truth[name], us = timed(own[len(job) - 1], *job)
        yield {"cage": path.stem, "job": name, "by": "limitsurf", "us": us}
    for peer in peers:
        try:
            calls = PEERS[peer](fine.points, fine.indices[fine.triangles])
        except ImportError:
            continue
        for name, job in asked.items():
            call = calls[len(job) - 1]
            if call is None:
                continue
            few = tuple(x[: n // 20 + 1] for x in job) if peer == "trimesh" else job
            found, us = timed(call, *few)
            true = truth[name][: len(found)]
            both = np.isfinite(found) & np.isfinite(true)
            off = np.abs(found[both] - true[both]).max(initial=0)
            off = float(off / (1 if len(job) == 2 else size))
            yield {"cage": path.stem, "job": name, "by": peer, "us": us, "off": off}


@click.command()
@click.argument("cages", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--queries", default=20_000, help="Points, and rays, of each kind.")
@click.option("--peer", "peers", multiple=True, default=tuple(PEERS), help="Ask these if there.")
def main(cages: tuple[Path, ...], queries: int, peers: tuple[str, ...]) -> None:
    """Measure and print."""
    print(json.dumps([row for path in cages for row in rows(path, queries, peers)], indent=1))


if __name__ == "__main__":
    main()
