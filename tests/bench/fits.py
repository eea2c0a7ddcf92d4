"""Measure fits of cages and curves, side by side with geomdl and FITPACK; prints JSON.

    python tests/bench/fits.py
    python tests/bench/fits.py --points 500 --grid 12

Times are of the processor, in seconds, of the second of two runs. A known cage (a torus, or a file)
is moved a little, and fitted to samples of its surface. A patch of 8 x 8 control points is fitted
to a grid of points of a wave: by limitsurf, whose nearest places are found, and by geomdl, if it is
installed, whose parameters are lengths along the grid; so are curves, by FITPACK (SciPy) too.
Distances are those from nearest places for all: of splines by Newton's method from a dense grid.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from time import process_time
from typing import Any

import click
import numpy as np
from scipy.interpolate import BSpline, NdBSpline, splev, splprep
from scipy.spatial import cKDTree

import limitsurf as ls

sys.path.insert(0, str(Path(__file__).parent))


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """What the second call returns, and its seconds."""
    call()
    begin = process_time()
    found = call()
    return found, round(process_time() - begin, 4)


def torus(n: int, m: int) -> ls.Mesh:
    """A torus of n by m quads."""
    a, b = np.meshgrid(2 * np.pi * np.arange(n) / n, 2 * np.pi * np.arange(m) / m, indexing="ij")
    ring = 2 + 0.8 * np.cos(b)
    points = np.stack([ring * np.cos(a), ring * np.sin(a), 0.8 * np.sin(b)], axis=-1)
    number = np.arange(n * m).reshape(n, m)
    east, north = np.roll(number, -1, axis=0), np.roll(number, -1, axis=1)
    quads = np.stack([number, east, np.roll(east, -1, axis=1), north], axis=-1)
    return ls.Mesh(points.reshape(-1, 3), quads.reshape(-1, 4))


def known_cage(mesh: ls.Mesh, count: int) -> dict[str, Any]:
    """A cage that is moved, and comes back."""
    surface = ls.LimitSurface(mesh, engine="compiled")
    size = float(np.ptp(mesh.points, axis=0).max())
    points = ls.sample(surface, count, rng=1).point
    noise = np.random.default_rng(2).normal(size=mesh.points.shape)
    start = surface.with_points(mesh.points + 0.01 * size * noise)
    found, seconds = timed(lambda: ls.fit(start, points))
    steps = len(found.history) - 1
    return {
        "vertices": mesh.n_vertices, "points": count, "steps": steps, "seconds": seconds,
        "seconds a step": round(seconds / max(steps, 1), 4),
        "rms of the size": (found.history / size).tolist(),
        "largest distance of the size": float(found.error.max()) / size,
    }  # fmt: skip


def wave(n: int) -> np.ndarray:
    """A grid of points (n, n, 3)."""
    x, y = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n), indexing="ij")
    return np.stack([x, y, 0.15 * np.sin(4 * x + y) * np.cos(3 * y)], axis=-1)


def distances(evaluate: Callable[[np.ndarray], Any], points: np.ndarray) -> np.ndarray:
    """Distances of points (n, 3) from a patch over the unit square, found on ever finer grids."""
    t = np.linspace(0, 1, 201)
    grid = np.stack(np.meshgrid(t, t, indexing="ij"), axis=-1).reshape(-1, 2)
    at = grid[cKDTree(evaluate(grid)).query(points)[1]]
    width = t[1]
    around = np.stack(np.meshgrid(*[np.linspace(-1, 1, 5)] * 2), axis=-1).reshape(-1, 2)
    for _ in range(30):
        near = np.clip(at[:, None] + width * around, 0, 1)
        gap = evaluate(near.reshape(-1, 2)).reshape(len(points), -1, 3) - points[:, None]
        size = (gap**2).sum(axis=2)
        best = size.argmin(axis=1)
        at, width = near[np.arange(len(at)), best], width * 0.6
    return np.asarray(np.sqrt(size.min(axis=1)))


def patch(n: int) -> list[dict[str, Any]]:
    """A single patch of 8 x 8 control points."""
    points, rows = wave(n), []
    flat = points.reshape(-1, 3)
    x, y = np.meshgrid(np.linspace(0, 1, 8), np.linspace(0, 1, 8), indexing="ij")
    start = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    number = np.arange(64).reshape(8, 8)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1)
    surface = ls.LimitSurface(ls.Mesh(start, quads.reshape(-1, 4)), engine="compiled")
    found, seconds = timed(lambda: ls.fit(surface, flat))
    away = found.error
    rows.append(row("limitsurf", seconds, away))
    try:
        from geomdl import fitting
    except ImportError:
        return rows
    given = flat.tolist()
    options = {"ctrlpts_size_u": 8, "ctrlpts_size_v": 8}
    other, seconds = timed(lambda: fitting.approximate_surface(given, n, n, 3, 3, **options))
    knots = np.array(other.knotvector_u), np.array(other.knotvector_v)
    spline = NdBSpline(knots, np.array(other.ctrlpts).reshape(8, 8, 3), 3)
    rows.append(row("geomdl", seconds, distances(spline, flat)))
    return rows


def curve(n: int) -> list[dict[str, Any]]:
    """Curves through the same points, with as many control points."""
    t = np.linspace(0, 6, n)
    points = np.stack([t, np.sin(t), 0.3 * t * np.cos(2 * t)], axis=1)
    found, seconds = timed(lambda: ls.fit_curve(points, tolerance=1e-3))
    count = len(found.points)

    def along(call: Callable[[np.ndarray], Any], low: float, high: float) -> np.ndarray:
        dense = np.asarray(call(np.linspace(low, high, 100 * n)))
        return np.asarray(cKDTree(dense).query(points)[0])

    knots, control = found[0]
    away = along(BSpline(knots, control, 3), *found.domain[0])
    rows = [{"control points": count, **row("limitsurf", seconds, away)}]
    smooth = 1e-12
    for smooth in np.logspace(-9, -1, 60):
        known, _ = splprep(points.T, s=smooth)
        if len(known[1][0]) <= count:
            break
    (known, _), seconds = timed(lambda: splprep(points.T, s=smooth))
    away = along(lambda x: np.transpose(splev(x, known)), 0, 1)
    rows.append({"control points": len(known[1][0]), **row("FITPACK", seconds, away)})
    try:
        from geomdl import fitting
    except ImportError:
        return rows
    given = points.tolist()
    other, seconds = timed(lambda: fitting.approximate_curve(given, 3, ctrlpts_size=count))
    spline = BSpline(np.array(other.knotvector), np.array(other.ctrlpts), 3)
    rows.append({"control points": count, **row("geomdl", seconds, along(spline, 0, 1))})
    return rows


def row(who: str, seconds: float, away: np.ndarray) -> dict[str, Any]:
    """What is said of one of them."""
    rms = float(np.sqrt((away**2).mean()))
    return {"who": who, "seconds": seconds, "rms": rms, "largest": float(away.max())}


@click.command()
@click.option("--cage", help="A file; by default a torus of 18 x 11 quads.")
@click.option("--points", default=20_000, show_default=True, help="For the known cage.")
@click.option("--grid", default=40, show_default=True, help="Points of the patch, each way.")
def main(cage: str | None, points: int, grid: int) -> None:
    """Print the figures as JSON."""
    mesh = torus(18, 11) if cage is None else ls.read(cage)
    found = {
        "known cage": known_cage(mesh, points),
        "patch": patch(grid),
        "curve": curve(10 * grid),
    }
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
