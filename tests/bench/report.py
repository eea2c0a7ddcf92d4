"""Print what ``bench.py`` found as Markdown tables, or write them into the pages that show them.

    python tests/bench/report.py bench.json
    python tests/bench/report.py bench.json other_processor.json --write

Every job of every cage is shown, whoever was faster. Of several files the first gives times, and
all together the range of the ratios.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import click

ROOT = Path(__file__).resolve().parents[2]
BEGIN, END = "<!-- made by tests/bench/report.py -->", "<!-- end of what is made -->"
ORDERS = {
    "": "",
    "P": ": positions",
    "+d1": ": first derivatives too",
    "+d2": ": second derivatives too",
    "+d3": ": third derivatives too",
    "normal": ": positions and unit normals",
}
# job and order of what the README shows of the first torus
FEW = [
    ("random", "P"),
    ("random", "+d1"),
    ("random", "+d2"),
    ("sorted", "+d1"),
    ("irregular sorted", "+d1"),
    ("grid 8 x 8", "normal"),
    ("1,000 in a call", "+d1"),
    ("one query in a call", "P"),
    ("weights, create", "P"),
    ("weights, create", "+d1"),
    ("weights, apply", "P"),
    ("set-up", ""),
    ("new points", ""),
    ("set-up with uv", ""),
    ("uv, random", "P"),
    ("refined L2", ""),
    ("refined L1 with uv", ""),
    ("refined L1, operator", ""),
    ("refined L1, points", ""),
    ("refined L1, limit points and normals", ""),
]

Cage = dict[str, Any]
Key = tuple[str, str]  # job and order


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    lines = [heads, ["---"] * len(heads), *rows]
    return ["| " + " | ".join(cells) + " |" for cells in lines]


def time(ns: float) -> str:
    """Two or three digits and a unit."""
    for unit, size in (("s", 1e9), ("ms", 1e6), ("us", 1e3)):
        if ns >= 0.9995 * size:
            return f"{ns / size:.3g} {unit}"
    return f"{ns:.3g} ns"


def times(ratio: float) -> str:
    return f"{ratio:.0f}" if ratio >= 9.95 else f"{ratio:.1f}" if ratio >= 0.95 else f"{ratio:.2g}"


def theirs(row: dict[str, Any], figure: str = "ns") -> float | None:
    """OpenSubdiv's time by the fastest of its ways."""
    return min((way[figure] for way in row["opensubdiv"].values()), default=None)


def ratios(rows: Sequence[dict[str, Any]]) -> list[float]:
    """How many times faster than OpenSubdiv, by the least and by the median of times."""
    return [
        other / row[figure]
        for row in rows
        for figure in ("ns", "median")
        if (other := theirs(row, figure)) is not None
    ]


def cell(rows: Sequence[dict[str, Any]]) -> str:
    """Range of ratios, in bold where OpenSubdiv may be faster, and both times."""
    if not rows:
        return ""
    found, other = ratios(rows), theirs(rows[0])
    if other is None:
        return f"{time(rows[0]['ns'])} : -"
    low, high = times(min(found)), times(max(found))
    between = low if low == high else f"{low} to {high}"
    mark = "**" if min(found) < 1 else ""
    return f"{mark}{between}{mark} ({time(rows[0]['ns'])} : {time(other)})"


def label(job: str, order: str, per: str) -> str:
    return f"{job}{ORDERS[order]}" + (f", per {per}" if per != "query" else "")


def by_key(cage: Cage) -> dict[Key, dict[str, Any]]:
    return {(row["job"], row["order"]): row for row in cage["rows"]}


def high_valence(cage: Cage) -> bool:
    return ":" in cage["cage"]


class Report:
    """All that some files say; cages of the first one, each with its like of the others."""

    def __init__(self, files: Sequence[dict[str, Any]]) -> None:
        self.files = files
        self.cages = files[0]["cages"]

    def like(self, cage: Cage) -> list[dict[Key, dict[str, Any]]]:
        """Rows by job of this cage, one for each file that has it."""
        same = [
            other
            for figures in self.files
            for other in figures["cages"]
            if (other["cage"], other["scheme"]) == (cage["cage"], cage["scheme"])
        ]
        return [by_key(other) for other in same]

    def rows(self, cage: Cage, key: Key) -> list[dict[str, Any]]:
        return [rows[key] for rows in self.like(cage) if key in rows]

    def jobs(self, cages: Sequence[Cage]) -> list[str]:
        """The table of these cages: every job of any of them."""
        if not cages:
            return []
        names = {key: row["per"] for cage in cages for key, row in by_key(cage).items()}
        heads = [f"{cage['cage']}: {cage['faces']:,} faces" for cage in cages]
        body = [
            [label(*key, per), *(cell(self.rows(cage, key)) for cage in cages)]
            for key, per in names.items()
        ]
        body += [["bytes of a ready surface per face", *map(memory, cages)]]
        if any("lagrange" in row for cage in cages for row in cage["rows"]):
            body += [["refined, times faster than adobe-lagrange", *map(lagrange, cages)]]
        return table(["limitsurf : OpenSubdiv", *heads], body)

    def score(self) -> str:
        """In how many comparisons who is ahead."""
        found = [ratios(self.rows(cage, key)) for cage in self.cages for key in by_key(cage)]
        compared = [x for x in found if x]
        ahead, behind = sum(min(x) > 1 for x in compared), sum(max(x) < 1 for x in compared)
        return (
            f"Of {len(compared)} comparisons, limitsurf is ahead in {ahead} and OpenSubdiv in "
            f"{behind}; the rest are even."
        )

    def machines(self) -> str:
        """Where it was measured."""
        texts = [
            f"{here['processor']} ({here['cores']} cores, Python {here['python']}, NumPy "
            f"{here['numpy']}, Numba {here['numba']}, {here['date']}, load {here['load']:.1f})"
            for here in (figures["machine"] for figures in self.files)
        ]
        return f"Measured on {'; '.join(texts)}."

    def first_use(self) -> list[str]:
        """Seconds of new processes."""
        found = self.files[0].get("first use, seconds")
        if not found:
            return []
        heads = {"filled": "kernels on disk", "empty": "nothing on disk"}
        kinds = [kind for kind in ("filled", "empty", "opensubdiv") if kind in found]
        body = [
            [f"{int(n):,}", *(time(found[kind][n] * 1e9) for kind in kinds)]
            for n in found["filled"]
        ]
        spent = found["precompile"]
        return [
            "### A new process",
            "",
            "From `import` to the last of so many positions with first derivatives on a cube; of "
            "OpenSubdiv the whole process.",
            "",
            *table(["queries", *(heads.get(kind, "OpenSubdiv") for kind in kinds)], body),
            "",
            f"`ls.precompile()` with nothing on disk takes {spent['wall']:.0f} s, "
            f"{spent['cpu']:.0f} s of processor time.",
        ]

    def page(self) -> str:
        """All tables."""
        plain = [cage for cage in self.cages if not high_valence(cage)]
        groups = {
            "Catmull-Clark": [cage for cage in plain if cage["scheme"] == "catmull-clark"],
            "Loop": [cage for cage in plain if cage["scheme"] == "loop"],
            "High valence": [cage for cage in self.cages if high_valence(cage)],
        }
        parts = [self.score(), "", self.machines(), ""]
        for title, cages in groups.items():
            if cages:
                parts += [f"### {title}", "", *self.jobs(cages), ""]
        return "\n".join([*parts, *self.first_use()]).rstrip()

    def few(self) -> str:
        """What the README shows: the lower of all ratios."""
        cage = next((cage for cage in self.cages if cage["cage"].isdecimal()), self.cages[0])
        body = []
        for key in FEW:
            rows = self.rows(cage, key)
            other = theirs(rows[0]) if rows else None
            if other is not None:
                least, name = min(ratios(rows)), label(*key, rows[0]["per"])
                body.append([name, time(rows[0]["ns"]), time(other), times(least)])
        heads = [f"on a cage of {cage['faces']:,} faces", "limitsurf", "OpenSubdiv 3.6"]
        return "\n".join([*table([*heads, "at least times faster"], body), "", self.score()])


def memory(cage: Cage) -> str:
    used = cage["bytes of memory"]
    precached = used.get("per face, Bfr precached")
    return f"{used['per face']:.0f}" + (f" : {precached:.0f}" if precached else "")


def lagrange(cage: Cage) -> str:
    rows = [row for row in cage["rows"] if "lagrange" in row]
    return ", ".join(times(row["lagrange"] / row["ns"]) for row in rows)


def write(path: Path, made: str) -> None:
    """Put `made` between the marks of a page."""
    text = path.read_text("utf-8")
    parts = re.split(f"({re.escape(BEGIN)}|{re.escape(END)})", text)
    if len(parts) != 5:
        raise click.ClickException(f"{path}: need {BEGIN} and {END}, once each")
    parts[2] = f"\n\n{made}\n\n"
    path.write_text("".join(parts), "utf-8")


@click.command()
@click.argument("files", nargs=-1, required=True, type=click.File())
@click.option("--write", "into_pages", is_flag=True, help="Into the README and the page on speed.")
def main(files: Sequence[Any], into_pages: bool) -> None:
    """Print tables of FILES, JSON by bench.py, each of another processor."""
    report = Report([json.load(file) for file in files])
    if into_pages:
        write(ROOT / "notebooks" / "site" / "speed.md", report.page())
        write(ROOT / "README.md", report.few())
    else:
        click.echo(report.page())


if __name__ == "__main__":
    main()
