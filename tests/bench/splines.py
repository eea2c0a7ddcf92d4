"""Measure B-spline faces, beside what OpenCASCADE fits to the same faces; prints JSON.

    python tests/bench/splines.py cage.obj > splines.json

Processor time, the least of some runs. Sizes are numbers of control points, distances at the same
parameters and along the normal, relative to the size of the surface, at random places of all faces.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

import click
import numpy as np

import limitsurf as ls


def timed(job: Callable[[], Any], runs: int) -> tuple[float, Any]:
    """The least processor time, and what the job gives."""
    job()
    times = []
    for _ in range(runs):
        start = time.process_time()
        found = job()
        times.append(time.process_time() - start)
    return min(times), found


def errors(
    surface: ls.LimitSurface, there: Callable[..., np.ndarray], face: np.ndarray, count: int
) -> dict[str, float]:
    """The largest distances at places, relative to the size."""
    rng = np.random.default_rng(0)
    which, u, v = rng.choice(face, count), *rng.random((2, count))
    step = there(which, u, v) - surface.evaluate(which, u, v)
    along = np.abs((step * surface.normal(which, u, v)).sum(axis=1))
    size = float(np.ptp(surface.points, axis=0).max())
    return {
        "parametric": float(np.linalg.norm(step, axis=1).max()) / size,
        "along_normal": float(np.nanmax(along)) / size,
    }


def ours(surface: ls.LimitSurface, depth: int, merge: bool, runs: int) -> dict[str, Any]:
    """Our own faces."""
    seconds, faces = timed(lambda: ls.bspline_faces(surface, depth=depth, merge=merge), runs)
    start = time.process_time()
    found = ls.deviation(surface, faces)
    size = float(np.ptp(surface.points, axis=0).max())
    bounds = {
        name: float(np.nanmax(getattr(found, name), initial=0)) / size
        for name in (
            "parametric", "parametric_found", "along_normal", "along_normal_found", "gap",
            "gap_found",
        )
    }  # fmt: skip
    degrees = {
        name: float(np.degrees(np.nanmax(getattr(found, name), initial=0)))
        for name in ("angle", "angle_found", "edge_angle", "edge_angle_found")
    }
    return {
        "depth": depth, "merge": merge, "seconds": seconds, "faces": len(faces),
        "exact": int(faces.exact.sum()), "control_points": len(faces.points),
        "deviation_seconds": time.process_time() - start, **bounds, **degrees,
    }  # fmt: skip


def opencascade(
    surface: ls.LimitSurface, places: int, tolerance: float, count: int
) -> dict[str, Any]:
    """OpenCASCADE's fit of `places` times as many samples of each limit face."""
    from OCP.GeomAbs import GeomAbs_C2
    from OCP.GeomAPI import GeomAPI_PointsToBSplineSurface
    from OCP.gp import gp_Pnt

    try:
        from OCP.collections import Array2_gp_Pnt as Points
    except ImportError:  # before version 8
        from OCP.TColgp import TColgp_Array2OfPnt as Points

    size = float(np.ptp(surface.points, axis=0).max())
    t = np.linspace(0, 1, places)
    u, v = np.meshgrid(t, t, indexing="ij")
    start, made = time.process_time(), []
    for face in range(len(surface.limit_faces)):
        samples = surface.evaluate(face, u, v)
        array = Points(1, places, 1, places)
        for i, j in np.ndindex(places, places):
            array.SetValue(i + 1, j + 1, gp_Pnt(*samples[i, j].tolist()))
        fit = GeomAPI_PointsToBSplineSurface(array, 3, 8, GeomAbs_C2, tolerance * size)
        made.append(fit.Surface())
    seconds = time.process_time() - start

    def there(face: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        found = []
        for k, x, y in zip(face.tolist(), u.tolist(), v.tolist(), strict=True):
            low, high, down, up = made[k].Bounds()
            point = made[k].Value(low + x * (high - low), down + y * (up - down))
            found.append([point.X(), point.Y(), point.Z()])
        return np.array(found)

    every = np.arange(len(made))
    return {
        "samples": places**2, "tolerance": tolerance, "seconds": seconds, "faces": len(made),
        "control_points": sum(x.NbUPoles() * x.NbVPoles() for x in made),
        **errors(surface, there, every, count),
    }  # fmt: skip


@click.command()
@click.argument("path")
@click.option("--depth", default=8)
@click.option("--runs", default=5)
@click.option("--places", default=17, help="Samples along each side of a face for OpenCASCADE.")
@click.option("--tolerance", default=1e-5, help="For OpenCASCADE, relative to the size.")
@click.option("--count", default=20000, help="Random places.")
def main(path: str, depth: int, runs: int, places: int, tolerance: float, count: int) -> None:
    """Measure the spline faces of a cage of quads."""
    surface = ls.LimitSurface(ls.read(path))
    report: dict[str, Any] = {
        "cage": path.rpartition("/")[2],
        "limit_faces": len(surface.limit_faces),
        "ours": [ours(surface, depth, merge, runs) for merge in (False, True)],
    }
    try:
        report["opencascade"] = opencascade(surface, places, tolerance, count)
    except ImportError as error:
        report["opencascade"] = str(error)
    print(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
