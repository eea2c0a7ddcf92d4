"""The demo: a million exact queries on a cage of our own, checked, saved and drawn."""

from __future__ import annotations

from importlib.resources import as_file, files
from pathlib import Path
from time import perf_counter, sleep
from typing import Any, TypeAlias

import click
import numpy as np

import limitsurf as ls
from limitsurf import _kernels
from limitsurf._kernels import background
from limitsurf.shell import terminal
from limitsurf.shell.io import answers, queries

Batch: TypeAlias = dict[str, Any]  # answers to some queries, arrays by name

LEVELS = 3
PATIENCE = 120.0  # seconds that compiling in the background may take
REFINER = f"""
The recursive refiner, {LEVELS} levels: each refined vertex against the surface at its (face, u, v),
where it is (error: it approaches the surface, slower next to poles) and where its limit mask moves
it (limit error: it lies on the surface, up to rounding).
"""


def run(folder: Path, n: int, seed: int, quiet: bool = False) -> dict[str, Any]:
    """Run the demo, report on stdout unless it is to be quiet, and return the facts by name.

    Writes ``demo_results.npz`` (face, u, v, position, du, dv and normal of ``n`` random queries)
    and ``demo.png`` to ``folder``, which is made if need be. The fact "agrees" is whether the
    refiner agrees up to rounding.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with as_file(files("limitsurf") / "_data" / "demo.obj") as path:
        mesh = ls.read(path)
    start = perf_counter()
    with terminal.working("building the surface"):
        surface = ls.LimitSurface(mesh)
    built = perf_counter() - start
    start = perf_counter()
    found = _answers(surface, n, seed)
    took = perf_counter() - start
    by = _who(surface)
    inside = mesh.vertex_faces[~mesh.boundary_vertex]
    lines = [
        ("cage", f"{mesh.n_vertices} vertices, {mesh.n_faces} faces: an octopus with a pearl"),
        ("corners of faces", terminal.histogram(mesh.sizes)),
        ("valences inside", terminal.histogram(inside)),
        ("surface", f"{len(surface.limit_faces)} limit faces, built in {built:.2f} s"),
        ("queries", f"{n:,} random (face, u, v), seed {seed}"),
        ("answers", "position, both first derivatives, unit normal"),
        ("first use", f"{took:.2f} s, {n / took:,.0f} queries a second, {by}"),
    ]
    if not quiet:
        terminal.say_table(lines)
    checked = _checked(surface, found, n, quiet)
    written = _files(surface, found, n, folder)
    steady = _steady(surface, n, seed, quiet)
    if not quiet:
        terminal.say("\n".join(written))
    counts = {"limit_faces": len(surface.limit_faces), "queries": n, "seconds": took}
    counts["steady_seconds"] = steady
    return {"agrees": checked.pop("agrees"), "output": written, **counts, **checked}


def _who(surface: ls.LimitSurface) -> str:
    """Who answers."""
    if surface.topology.shape in _kernels.available:
        return "by compiled kernels"
    return "by NumPy" + " while kernels are compiled" * background.busy()


def _steady(surface: ls.LimitSurface, n: int, seed: int, quiet: bool) -> float:
    """Seconds for the same queries again, when what compiles kernels for them has done so."""
    shape, end = surface.topology.shape, perf_counter() + PATIENCE
    if shape:
        _kernels.answer(shape, 0.5)  # as long as loading them takes
    with terminal.working("compiling kernels, once on this machine"):
        while shape and background.busy() and perf_counter() < end:
            if _kernels.answer(shape, 0):
                break
            sleep(0.1)
    start = perf_counter()
    _answers(surface, n, seed)
    took = perf_counter() - start
    if not quiet:
        rate = f"{took:.2f} s, {n / took:,.0f} queries a second, {_who(surface)}"
        terminal.say(f"The same queries again, as a process that goes on has it: {rate}.\n")
    return took


def _answers(surface: ls.LimitSurface, n: int, seed: int) -> list[Batch]:
    """Position, first derivatives and normal of random queries, batch by batch."""
    faces = len(surface.limit_faces)
    asked, found = queries.random_queries(faces, n, seed, surface.topology.lattice).batches, []
    with terminal.counting("evaluating", n) as done:
        for batch in answers.answered(surface, asked, answers.Question(order=1, normals=True)):
            found.append(batch)
            done(len(batch["face"]))
    return found


def _checked(surface: ls.LimitSurface, found: list[Batch], n: int, quiet: bool) -> dict[str, Any]:
    """What two checks find, told unless it is to be quiet."""
    with terminal.working("checking every query on the once refined cage"):
        where = [np.concatenate([batch[name] for batch in found]) for name in queries.NAMES]
        position, normal = ls.refinement_gap(surface, *where)
    if not quiet:
        terminal.say(
            f"\nThe same {n:,} queries on the cage refined once, in other patches: positions differ"
            f"\nby at most {position:.1e}, unit normals by {normal:.1e}."
        )
        terminal.say(REFINER)
    with terminal.working("refining"):
        table = ls.validate(surface, LEVELS)
    right = ls.agrees(surface, table)
    if not quiet:
        terminal.say_validation(table)
        terminal.say(f"The limit error is {'rounding alone' if right else 'MORE than rounding'}.\n")
    gaps = {"position_gap": position, "normal_gap": normal}
    return {"agrees": right, **gaps, "levels": terminal.validation_rows(table)}


def _files(surface: ls.LimitSurface, found: list[Batch], n: int, folder: Path) -> list[str]:
    """Write answers and picture; their paths."""
    results, picture = folder / "demo_results.npz", folder / "demo.png"
    with answers.writing(results, n) as write:
        for batch in found:
            write(batch)
    written = [str(results)]
    try:
        with terminal.working("drawing"):
            ls.plot(surface, picture)
        written.append(str(picture))
    except ImportError as error:
        click.echo(f"no picture: {terminal.sentence(error)}", err=True)
    return written
