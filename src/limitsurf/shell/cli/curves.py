"""Curves as text: rows of CSV, or lines in OBJ."""

from __future__ import annotations

import os
from typing import IO

import click
import numpy as np

import limitsurf as ls
from limitsurf.shell import files, terminal
from limitsurf.shell.cli.program import report


def check(output: str, to: str | None, as_json: bool) -> None:
    """Refuse a target that curves cannot be written to."""
    if as_json and output == "-":
        raise click.UsageError("--json needs the standard output: name a file, -o FILE")
    if output != "-":
        _format(output, to)
        files.check_target(output)


def _format(output: str, to: str | None) -> str:
    if to is not None:
        return to
    suffix = os.path.splitext(output)[1].lower()
    if suffix not in (".csv", ".obj"):
        raise click.UsageError(f"{output}: curves are written as .csv or .obj; or say --to")
    return suffix[1:]


def write(output: str, to: str | None, found: ls.Curves, as_json: bool, **facts: object) -> None:
    """Write curves to a file and report that, or to the standard output for -."""
    if output == "-":
        with terminal.standard_output() as out:
            _write(out, to or "csv", found)
        return
    with files.replacing(output, "w") as file:
        _write(file, _format(output, to), found)
    counts = {"curves": len(found), "closed": int(found.closed.sum()), "points": len(found.face)}
    report(output, as_json, **counts, **facts)


def _write(file: IO[str], kind: str, found: ls.Curves) -> None:
    if kind == "obj":
        np.savetxt(file, found.point, "v %.17g %.17g %.17g")
        for first, last, closed in zip(
            found.offsets[:-1].tolist(), found.offsets[1:].tolist(), found.closed, strict=True
        ):
            numbers = [*range(first + 1, last + 1), *([first + 1] if closed else [])]
            file.write(f"l {' '.join(map(str, numbers))}\n")
        return
    each = np.diff(found.offsets)
    columns = np.repeat(np.arange(len(each)), each), np.repeat(found.closed, each)
    table = np.column_stack([*columns, found.point, found.face, found.u, found.v])
    file.write("curve,closed,x,y,z,face,u,v\n")
    np.savetxt(file, table, "%d,%d,%.17g,%.17g,%.17g,%d,%.17g,%.17g")
