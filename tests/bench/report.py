"""Print what ``bench.py`` found as a Markdown table of ratios.

python tests/bench/report.py bench.json
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

import click

# label, job, order, and the way of OpenSubdiv to compare with, if not the fastest one
ROWS = [
    ("random queries: positions", "random", "P", None),
    ("and first derivatives", "random", "+d1", None),
    ("and second derivatives", "random", "+d2", None),
    ("positions and unit normals", "random", "normal", None),
    ("sorted queries, first derivatives", "sorted", "+d1", None),
    ("irregular faces only, random, first derivatives", "irregular random", "+d1", None),
    ("irregular faces only, sorted, first derivatives", "irregular sorted", "+d1", None),
    ("8 x 8 positions and normals per face", "grid 8 x 8", "normal", None),
    ("weights, against limit stencils", "weights, create", "P", "stencils, create"),
    ("weights, against those of ready surfaces", "weights, create", "P", "bfr weights, create"),
    ("weights times points", "weights, apply", "P", None),
    ("set-up, from faces to the first result", "set-up", "", None),
    ("new points, to the first result", "new points", "", None),
    ("refined once, mesh and points", "refined L1", "", None),
    ("twice", "refined L2", "", None),
    ("three times", "refined L3", "", None),
    ("refined once, points by the operator", "refined L1, points", "", None),
    ("twice", "refined L2, points", "", None),
    ("three times", "refined L3, points", "", None),
]

Table = dict[tuple[str, str], dict[str, Any]]  # rows of a cage by job and order


def line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def ratio(ours: float, theirs: float) -> str:
    """How many times faster, in two digits."""
    times = theirs / ours
    return f"{times:.0f}" if times >= 9.95 else f"{times:.1f}" if times >= 0.95 else f"{times:.2f}"


def ratios(row: dict[str, Any] | None, way: str | None) -> str:
    """Times faster than OpenSubdiv, and in brackets than NumPy."""
    if row is None:
        return ""
    theirs = row.get("opensubdiv_ns", {})
    chosen = [ns for name, ns in theirs.items() if way in (None, name)]
    cell = ratio(row["ns"], min(chosen)) if chosen else "-"
    return cell + (f" ({ratio(row['ns'], row['numpy_ns'])})" if "numpy_ns" in row else "")


def quotient(table: Table, one: str, other: str) -> str:
    found = table.get((one, "+d1")), table.get((other, "+d1"))
    return f"{found[0]['ns'] / found[1]['ns']:.2f}" if found[0] and found[1] else ""


def lagrange(cage: dict[str, Any]) -> str:
    rows = [row for row in cage["rows"] if "lagrange_ns" in row]
    return ", ".join(ratio(row["ns"], row["lagrange_ns"]) for row in rows)


def memory(cage: dict[str, Any]) -> str:
    used = cage["bytes of memory"]
    theirs = used.get("per face, Bfr precached")
    return f"{used['per face']:.0f}" + (f" ({theirs:.0f})" if theirs else "")


def report(figures: dict[str, Any]) -> str:
    cages = figures["cages"]
    tables: list[Table] = [
        {(row["job"], row["order"]): row for row in cage["rows"]} for cage in cages
    ]
    deep = [quotient(table, "u = v = 1e-300", "u = v = 0.3") for table in tables]
    workers = [quotient(table, "random, workers=1", "random, workers=2") for table in tables]
    rows = [
        *(
            (label, [ratios(t.get((job, order)), way) for t in tables])
            for label, job, order, way in ROWS
        ),
        ("refined 1, 2, ... times, against adobe-lagrange", [lagrange(cage) for cage in cages]),
        ("cost at u = v = 1e-300, times that at 0.3", deep),
        ("two workers against one", workers),
        (
            "first set-up, ns per face",
            [f"{cage['first set-up, ns per face']:.0f}" for cage in cages],
        ),
        ("bytes per face of a ready surface (Bfr's)", [memory(cage) for cage in cages]),
    ]
    here, cold = figures["machine"], figures["cold start, seconds"]
    heads = [f"{cage['cage']}: {cage['faces']:,} faces" for cage in cages]
    return "\n".join(
        [
            line(["times faster than OpenSubdiv (than plain NumPy)", *heads]),
            line(["---"] * (1 + len(heads))),
            *(line([label, *cells]) for label, cells in rows if any(cells)),
            "",
            f"{here['processor']}, {here['cores']} cores, one thread but for workers; Python "
            f"{here['python']}, NumPy {here['numpy']}, Numba {here['numba']}. From `import` to the "
            f"first 1,000 results on a cube: {cold['from import']:.2f} s.",
        ]
    )


@click.command()
@click.argument("file", type=click.File())
def main(file: Any) -> None:
    """Print the ratios in FILE, JSON by bench.py, as a Markdown table."""
    click.echo(report(json.load(file)))


if __name__ == "__main__":
    main()
