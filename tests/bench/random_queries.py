"""Measure set-up and random queries on a large cage; prints JSON.

    python tests/bench/random_queries.py [N] [QUERIES]

The cage is a closed N x N quad torus in which some cells are inset twice, which gives about 5 %
extraordinary vertices (N = 310: 100,000 faces). Beside each figure stands the time that a plain
loop-free alternative takes in the same run: refining once, which gives one point per vertex.
"""

import json
import resource
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import limitsurf as ls
from limitsurf.patches import STRIP


def cage(n: int, seed: int = 0) -> ls.Mesh:
    """A noisy torus of n x n quads, some of them inset twice."""
    rng = np.random.default_rng(seed)
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    a, b = 2 * np.pi * i / n, 2 * np.pi * j / n
    r = 1 + 0.3 / n * rng.standard_normal((n, n))
    points = np.stack(
        [(3 + r * np.cos(b)) * np.cos(a), (3 + r * np.cos(b)) * np.sin(a), r * np.sin(b)], -1
    )
    points = points.reshape(-1, 3)
    corner = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    faces = ((i[..., None] + corner[:, 0]) % n * n + (j[..., None] + corner[:, 1]) % n).reshape(
        -1, 4
    )
    for share in (0.0056, 0.001):
        chosen = rng.choice(len(faces), int(share * n * n), replace=False)
        old = faces[chosen]
        centre = points[old].mean(axis=1, keepdims=True)
        new = len(points) + np.arange(old.size).reshape(-1, 4)
        points = np.concatenate([points, (centre + 0.5 * (points[old] - centre)).reshape(-1, 3)])
        faces[chosen] = new
        sides = [
            np.stack([old[:, k], old[:, k - 3], new[:, k - 3], new[:, k]], -1) for k in range(4)
        ]
        faces = np.concatenate([faces, *sides])
    return ls.Mesh(points, faces)


def seconds(job: Callable[[], Any], runs: int = 3) -> float:
    """Best time of some runs."""
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        job()
        times.append(time.perf_counter() - start)
    return min(times)


def main() -> None:
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 310
    queries = int(sys.argv[2]) if len(sys.argv) > 2 else 1_000_000
    mesh = cage(n)
    rng = np.random.default_rng(1)
    surface = ls.LimitSurface(mesh)
    face = rng.integers(len(surface.limit_faces), size=queries)
    u, v = rng.random((2, queries))
    pole = np.flatnonzero(surface.patches.kind[surface.patches.codes.clip(0)] > STRIP)[:1]
    some = 100_000
    figures = {
        "faces": mesh.n_faces,
        "queries": queries,
        "seconds": {
            "Mesh and LimitSurface": seconds(
                lambda: ls.LimitSurface(ls.Mesh(mesh.points, mesh.faces))
            ),
            "refined, one level": seconds(lambda: ls.refined(mesh)),
            "evaluate": seconds(lambda: surface.evaluate(face, u, v)),
            "jet, order 1": seconds(lambda: surface.jet(face, u, v, order=1)),
            "normal": seconds(lambda: surface.normal(face, u, v)),
            "weights": seconds(lambda: surface.weights(face, u, v)),
        },
        "ratio of u = 1e-300 to u = 0.3 beside a pole": seconds(
            lambda: surface.jet(pole, np.full(some, 1e-300), 0.0, order=1)
        )
        / seconds(lambda: surface.jet(pole, np.full(some, 0.3), 0.0, order=1)),
        "peak memory, GiB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
    }
    print(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
