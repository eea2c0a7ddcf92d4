"""Measure errors against exact rational arithmetic that shares no code with the library.

    python tests/bench/accuracy.py > accuracy.json
    python tests/bench/accuracy.py --table
    python tests/bench/accuracy.py --table --known accuracy.json

Around a vertex of each valence, in a cage of random points in [-1, 1]^3, surfaces of each scheme
are evaluated at random (u, v) whose distance from the vertex is 1 to 1/2 of a given power of two
(the larger of u and v, or in triangles their sum), and compared with ``tests/oracles.py``,
``tests/oracles_loop.py`` and ``tests/oracles_doo_sabin.py``: naive refinement in Fractions, then
roots in 200 digits. Where weights are irrational, these and the points have 2000 binary digits
after the point. Largest errors: of positions relative to the extent of the cage; of derivatives
relative to the largest one of their order; of unit normals as lengths; of curvatures relative to
the larger principal one.
"""

from __future__ import annotations

import json
import random
import sys
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple, TextIO

import click
import mpmath
import numpy as np

import limitsurf as ls

sys.path.insert(0, str(Path(__file__).parents[1]))
import oracles
import oracles_doo_sabin
import oracles_loop
import zoo
import zoo_triangles
from oracles_creases import Cage

BITS = 2000  # at 2^-300 from a vertex derivatives take some 900 of them, roots 660
ORDERS = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]
NAMES = ["position", "first derivative", "second derivative", "normal", "curvature"]
mpmath.mp.dps = 200  # of nearly tangential derivatives more than 100 digits cancel


class Kind(NamedTuple):
    """What the surfaces of a scheme are compared with, and where they are evaluated."""

    cage: Callable[[int], tuple[Any, list[list[int]]]]  # around vertex 0, of a valence
    exact: Callable[[Any, list[list[int]]], Any]
    faces: int  # of which one in so many has vertex 0, at its corner 0
    place: Callable[[float, float], tuple[float, float]]  # from a distance and a share, both <= 1


def of_triangles(valence: int) -> tuple[Any, list[list[int]]]:
    """Random points around a vertex; the faces around it have limits whatever comes beyond."""
    points, faces = zoo_triangles.disc(valence)
    return zoo.random_points(len(points), valence), faces


def by_loop(weight: Callable[..., Fraction]) -> Callable[[Any, list[list[int]]], Any]:
    """Loop's surface by naive refinement, with such weights of vertices."""

    def surface(points: Any, faces: list[list[int]]) -> oracles_loop.LoopSurface:
        exact = [tuple(map(Fraction, point)) for point in points.tolist()]
        return oracles_loop.LoopSurface(Cage(exact, faces), weight, bits=BITS)

    return surface


def in_triangle(far: float, near: float) -> tuple[float, float]:
    """The place at that distance and share."""
    return far * (1 - near), far * near


def by_doo_sabin(points: Any, faces: list[list[int]]) -> oracles_doo_sabin.DooSabinSurface:
    """Doo and Sabin's surface by naive refinement."""
    exact = [tuple(map(Fraction, point)) for point in points.tolist()]
    return oracles_doo_sabin.DooSabinSurface(Cage(exact, faces))


KINDS = {
    "catmull-clark": Kind(
        lambda valence: zoo.local_cage(valence, seed=valence),
        oracles.ExactSurface,
        4,
        lambda far, near: (far, near),
    ),
    "doo-sabin": Kind(
        lambda valence: zoo.local_cage(valence, seed=valence),
        by_doo_sabin,
        4,
        lambda far, near: (far, near),
    ),
    "loop": Kind(of_triangles, by_loop(oracles_loop.loop_weight), 1, in_triangle),
    "loop-warren": Kind(of_triangles, by_loop(oracles_loop.warren_weight), 1, in_triangle),
}


def roots(jet: dict[tuple[int, int], Any]) -> tuple[list[Any], list[Any]]:
    """The unit normal, and mean and Gaussian curvature with the larger principal one."""
    x, y, xx, xy, yy = (
        [mpmath.mpf(c.numerator) / c.denominator for c in jet[k]] for k in ORDERS[1:]
    )
    cross = [x[k - 2] * y[k - 1] - x[k - 1] * y[k - 2] for k in range(3)]
    area = mpmath.norm(cross)
    normal = [c / area for c in cross]
    E, F, G = mpmath.fdot(x, x), mpmath.fdot(x, y), mpmath.fdot(y, y)
    L, M, N = (mpmath.fdot(normal, c) for c in (xx, xy, yy))
    mean = (E * N - 2 * F * M + G * L) / (2 * area**2)
    spread = mpmath.sqrt(mean**2 - (L * N - M * M) / area**2)
    return normal, [mean + spread, mean - spread]


def largest_errors(scheme: str, valence: int, halvings: int, samples: int) -> dict[str, float]:
    kind = KINDS[scheme]
    points, faces = kind.cage(valence)
    surface = ls.LimitSurface(ls.Mesh(points, faces), scheme=scheme)
    exact = kind.exact(points, faces)
    rng = random.Random(halvings)
    worst = dict.fromkeys(NAMES, 0.0)
    for _ in range(samples):
        face = kind.faces * rng.randrange(valence)
        far, near = kind.place(0.5 + rng.random() / 2, rng.random())
        u, v = (far, near) if rng.random() < 0.5 else (near, far)
        u, v = u * 2.0**-halvings, v * 2.0**-halvings
        truth = {nu: exact.evaluate(face, Fraction(u), Fraction(v), nu=nu) for nu in ORDERS}
        found = surface.jet(face, u, v, order=2)
        error = {
            nu: max(abs(float(Fraction(a) - b)) for a, b in zip(found[nu], truth[nu], strict=True))
            for nu in ORDERS
        }
        size = {nu: max(abs(float(c)) for c in truth[nu]) for nu in ORDERS}
        worst["position"] = max(worst["position"], error[0, 0] / 2)
        for order, name in ((1, NAMES[1]), (2, NAMES[2])):
            these = [nu for nu in ORDERS if sum(nu) == order]
            worst[name] = max(
                worst[name], max(error[k] for k in these) / max(size[k] for k in these)
            )
        normal, bent = roots(truth)
        gap = [
            mpmath.mpf(a) - b
            for a, b in zip(surface.normal(face, u, v).tolist(), normal, strict=True)
        ]
        worst["normal"] = max(worst["normal"], float(mpmath.norm(gap)))
        here = surface.curvature(face, u, v)
        wrong = max(
            abs(mpmath.mpf(float(here.k1)) - bent[0]), abs(mpmath.mpf(float(here.k2)) - bent[1])
        )
        worst["curvature"] = max(worst["curvature"], float(wrong / max(map(abs, bent))))
    return worst


@click.command()
@click.option("--samples", default=100, show_default=True, help="For each valence and distance.")
@click.option("--table", is_flag=True, help="Print Markdown instead of JSON.")
@click.option("--known", type=click.File(), help="JSON printed before, to measure nothing again.")
def main(samples: int, table: bool, known: TextIO | None) -> None:
    """Measure the library's errors at and far into extraordinary faces."""
    rows = (
        json.load(known)["rows"]
        if known
        else [
            {
                "scheme": name,
                "valence": n,
                "distance": f"2^-{k}",
                **largest_errors(name, n, k, samples),
            }
            for name in KINDS
            for n in (3, 4, 5, 7, 12, 40)
            for k in (0, 10, 100, 300)
        ]
    )
    if not table:
        click.echo(
            json.dumps({"numpy": np.__version__, "samples": samples, "rows": rows}, indent=1)
        )
        return
    heads = ["scheme", "valence", "distance"]
    click.echo(f"| {' | '.join([*heads, *NAMES])} |\n|{'---|' * (len(heads) + len(NAMES))}")
    for row in rows:
        errors = (f"{row[name]:.0e}" for name in NAMES)
        click.echo(f"| {' | '.join([*(str(row[name]) for name in heads), *errors])} |")


if __name__ == "__main__":
    main()
