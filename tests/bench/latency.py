"""Measure how long calls of few queries take, in microseconds; prints JSON, or a Markdown table.

    python tests/bench/latency.py > latency.json
    python tests/bench/latency.py --table

Queries are scattered over a torus of 260 quads with 13 extraordinary vertices: one in plain
numbers, on a regular and on a special face, and 1 to 10,000 in arrays, of which the most are also
written to the arrays of an earlier answer (``out=``). Each figure is the best of many runs in wall
time, once what is to be loaded is. Beside them stands SciPy: a call of a tensor product of cubic
B-splines of three channels by ``NdBSpline``, and of a curve by ``BSpline``.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import click
import numpy as np
from scipy.interpolate import BSpline, NdBSpline

import limitsurf as ls

sys.path.insert(0, str(Path(__file__).parent))
import bench

SIZES = 1, 10, 100, 1_000, 10_000
CALLS = "evaluate", "jet", "normal"


def best(call: Callable[[], Any], runs: int) -> float:
    """Microseconds of one call: the least of some runs, each long enough for the clock."""
    call()
    begin, times = perf_counter(), 1
    call()
    times = max(1, int(2e-3 / max(perf_counter() - begin, 1e-7)))
    found = []
    for _ in range(runs):
        begin = perf_counter()
        for _ in range(times):
            call()
        found.append((perf_counter() - begin) / times)
    return round(1e6 * min(found), 2)


def of_engine(mesh: ls.Mesh, engine: Any, sizes: tuple[int, ...], runs: int) -> list[Any]:
    """Rows of one engine: a call, how many queries on which faces, and microseconds."""
    surface = ls.LimitSurface(mesh, engine=engine)
    codes = surface.patches.codes[: len(surface.limit_faces)]
    special = surface.patches.kind[codes] > 1
    places = {"regular": int(np.flatnonzero(~special)[0]), "special": int(special.argmax())}
    rows: list[Any] = []
    for name in CALLS:
        call = getattr(surface, name)
        for where, face in places.items():
            rows.append([name, f"1, {where}", best(partial(call, face, 0.3, 0.4), runs)])
        for n in sizes:
            at = bench.draw(mesh, np.arange(len(surface.limit_faces)), n, seed=n)
            rows.append([name, str(n), best(partial(call, *at), runs)])
        asked, made = f"{sizes[-1]}, out=", call(*at)
        rows.append([name, asked, best(partial(call, *at, out=made), runs)])
    return rows


def of_scipy(sizes: tuple[int, ...], runs: int) -> list[Any]:
    """Rows of cubic B-splines."""
    g = np.random.default_rng(0)
    knots = np.arange(16.0)
    curve = BSpline(knots, g.random((12, 3)), 3)
    patch = NdBSpline((knots, knots), g.random((12, 12, 3)), 3)
    rows: list[Any] = []
    for n in sizes:
        u, v = g.uniform(3, 12, size=(2, n))
        both = np.stack([u, v], axis=1)
        rows.append(["BSpline", str(n), best(partial(curve, u), runs)])
        rows.append(["NdBSpline", str(n), best(partial(patch, both), runs)])
    return rows


def table(figures: dict[str, Any]) -> str:
    """Calls by queries, of each engine and of SciPy."""
    columns = list(dict.fromkeys(q for rows in figures["rows"].values() for _, q, _ in rows))
    lines = [["microseconds a call", *columns], ["---"] * (len(columns) + 1)]
    for engine, rows in figures["rows"].items():
        for name in dict.fromkeys(name for name, *_ in rows):
            found = {q: f"{t:,.1f}" if t < 100 else f"{t:,.0f}" for n, q, t in rows if n == name}
            lines.append([f"`{name}`, {engine}", *(found.get(q, "") for q in columns)])
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--runs", default=50, show_default=True, help="runs of which the best counts")
@click.option("--most", default=SIZES[-1], show_default=True, help="most queries in a call")
@click.option("--table", "markdown", is_flag=True, help="print a Markdown table, not JSON")
def main(runs: int, most: int, markdown: bool) -> None:
    """Measure calls of few queries."""
    sizes = tuple(n for n in SIZES if n <= most)
    mesh = bench.torus(16)
    rows = {engine: of_engine(mesh, engine, sizes, runs) for engine in ("compiled", "reference")}
    rows["SciPy"] = of_scipy(sizes, runs)
    figures = {"machine": bench.machine(), "rows": rows}
    click.echo(table(figures) if markdown else json.dumps(figures, indent=1))


if __name__ == "__main__":
    main()
