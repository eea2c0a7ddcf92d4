"""Measure interpolation and fairness in seconds of processor time; prints JSON.

    python tests/bench/interpolation.py 1000 10000 100000 > interpolation.json

Cages are tori of about so many vertices, whose limit is to pass through all of them. Once as they
are, once refined for the fairest; also the matrix of the energy, and fair cages of noisy ones.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from math import isqrt
from time import process_time
from typing import Any

import click
import numpy as np

import limitsurf as ls


def torus(count: int) -> ls.Mesh:
    """About so many vertices of 4 quads each."""
    m = max(4, isqrt(count // 2))
    n = max(4, count // m)
    i, j = (x.ravel() for x in np.meshgrid(np.arange(m), np.arange(n), indexing="ij"))
    corners = [i * n + j, (i + 1) % m * n + j, (i + 1) % m * n + (j + 1) % n, i * n + (j + 1) % n]
    u, v = 2 * np.pi * i / m, 2 * np.pi * j / n
    points = [(3 + np.cos(v)) * np.cos(u), (3 + np.cos(v)) * np.sin(u), np.sin(v)]
    return ls.Mesh(np.stack(points, axis=1), np.stack(corners, axis=1))


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """What a call gives, and its seconds."""
    start = process_time()
    found = call()
    return found, process_time() - start


def rows(count: int, refined: bool) -> dict[str, Any]:
    """Figures of one cage; each call begins with a new one."""
    mesh = torus(count)
    found, seconds = timed(lambda: ls.interpolate(torus(count), refine=False))
    figures = {"interpolate": seconds, "residual": found.residual, "condition": found.condition}
    if refined:
        found, seconds = timed(lambda: ls.interpolate(torus(count), refine=True))
        figures |= {"refined": seconds, "residual, refined": found.residual}
    noise = 1e-3 * np.random.default_rng(0).normal(size=mesh.points.shape)
    rough = mesh.with_points(mesh.points + noise)
    _, figures["fairness"] = timed(lambda: ls.fairness(ls.LimitSurface(torus(count))))
    _, figures["fair"] = timed(lambda: ls.fair(rough, weights=1.0))
    return {"vertices": mesh.n_vertices, **figures}


@click.command()
@click.argument("counts", nargs=-1, type=click.IntRange(16), required=True)
@click.option("--refined", "most", type=int, default=20000, help="Refine cages up to this size.")
def main(counts: tuple[int, ...], most: int) -> None:
    """Measure and print."""
    rows(64, True)  # what is compiled and kept
    print(json.dumps([rows(count, count <= most) for count in counts], indent=1))


if __name__ == "__main__":
    main()
