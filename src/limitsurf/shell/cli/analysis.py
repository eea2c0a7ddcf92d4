"""The command that compares what spectra say of schemes, valence by valence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

import limitsurf as ls
from limitsurf.shell import terminal
from limitsurf.shell.cli.own import OF_SCHEME, SCHEME
from limitsurf.shell.cli.program import json_option
from limitsurf.spectra import SpectralAnalysis

MOST = 1000  # faces around a vertex


class Numbers(click.ParamType):  # type: ignore[type-arg]
    """Numbers and ranges of them, such as ``3-6,8``."""

    name = "numbers"

    def convert(self, value: Any, param: Any, ctx: Any) -> list[int]:
        """The numbers, in the order that they are given in."""
        found: list[int] = []
        for part in str(value).split(","):
            first, dash, last = part.partition("-")
            if not first.isdecimal() or (dash and not last.isdecimal()):
                self.fail(f"{value!r} is no number or range, as in 5, 3-12 or 3-6,8", param, ctx)
            low, high = int(first), int(last or first)
            if high < low or not 1 <= low <= high <= MOST:
                self.fail(f"{part!r} is no range within 1 to {MOST:,}", param, ctx)
            found += range(low, high + 1)
        return found


@click.command()
@click.option(
    "--scheme",
    "schemes",
    type=SCHEME,
    metavar="NAME",
    multiple=True,
    default=("catmull-clark",),
    show_default=True,
    help=f"{OF_SCHEME} May be given several times.",
)
@click.option(
    "--valence",
    type=Numbers(),
    metavar="N",
    help="Of smooth vertices: 5, 3-12 or 3-6,8; 3-12 if nothing is said.",
)
@click.option(
    "--kind",
    type=click.Choice(["interior", "crease", "corner", "dart", "cone", "flap", "pendant"]),
    help="What is at the vertex, with --faces; see limitsurf basis --help.",
)
@click.option("--faces", type=Numbers(), metavar="K", help="How many faces there are, as N.")
@click.option(
    "--plot",
    "picture",
    type=click.Path(dir_okay=False),
    metavar="FILE",
    help="Draw it, of smooth vertices: .svg, .pdf, .png, .jpg or .webp.",
)
@json_option
def spectrum(
    *,
    schemes: tuple[str | ls.Scheme, ...],
    valence: list[int] | None,
    kind: str | None,
    faces: list[int] | None,
    picture: str | None,
    as_json: bool,
) -> None:
    """Say what spectra decide: C1 or not, curvature bounded or not.

    \b
    Example:
      limitsurf spectrum --scheme loop --valence 3-12
      limitsurf spectrum --scheme loop --scheme doo-sabin --valence 3-6,8
      limitsurf spectrum --kind crease --faces 1-4 --json
      limitsurf spectrum --scheme loop --scheme doo-sabin --plot spectrum.svg

    A row for each scheme and number of faces, of control points in general position: the
    subdominant eigenvalue; whether the Jacobian of the characteristic map has one sign, and the map
    is injective, so that the surface is C1; by what curvature is multiplied as the parameters are
    halved, and how it grows with the distance r; whether cups and saddles survive next to the
    vertex; and by what part a vertex of the cage that sticks out is drawn back. A dash is what is
    not decided, or not there.

    Keys of --json: rows, each with scheme, kind, faces; subdominant, regular, injective, c1;
    curvature (behaviour, rate, power, logarithm, cups, saddles, exact, by_frequency; null without
    tangent plane); control_points, support, shrinkage; eigenvalues (real, imaginary, multiplicity,
    jordan, from).
    """
    if valence is not None and faces is not None:
        raise click.UsageError("need either --valence N, or --kind KIND with --faces K")
    if valence is not None and kind not in (None, "interior"):
        raise click.UsageError(f"--valence is of a smooth vertex; for a {kind} say --faces")
    if kind not in (None, "interior") and faces is None:
        raise click.UsageError(f"for a {kind} say --faces K")
    numbers = valence or faces or list(range(3, 13))
    if picture is not None:
        if kind not in (None, "interior"):
            raise click.UsageError(f"--plot is of smooth vertices, not of a {kind}")
        ls.plot_spectrum(schemes, Path(picture), valences=numbers)
    with terminal.working("deriving"):
        found = [
            ls.spectral_analysis(scheme, kind=kind or "interior", faces=n)
            for scheme in schemes
            for n in numbers
        ]
    if as_json:
        terminal.say_json({"rows": [_facts(one) for one in found]})
        return
    heads = ("scheme", "faces", "subdominant", "regular", "injective", "C1", "rate", "curvature")
    terminal.say_table(
        map(_row, found),
        (*heads, "cups", "saddles", "shrinkage"),
        left=(0, 2, 3, 4, 5, 7, 8, 9),
    )


def _row(found: SpectralAnalysis) -> tuple[str, ...]:
    facts, curvature = found.facts, found.curvature
    return (
        found.scheme.name,
        str(found.sector.faces),
        ", ".join(dict.fromkeys(f"{x:.6f}" for x in found.subdominant)) or "none",
        *(facts[f"characteristic map {name}"] for name in ("regular", "injective")),
        facts["C1"],
        "-" if curvature is None else f"{curvature.rate:.4f}",
        *(facts[name] for name in ("curvature", "cups survive", "saddles survive")),
        f"{found.shrinkage:.4f}",
    )


def _facts(found: SpectralAnalysis) -> dict[str, Any]:
    facts: dict[str, Any] = {
        "scheme": found.scheme.name,
        "kind": found.sector.kind,
        "faces": found.sector.faces,
        "subdominant": list(found.subdominant),
        "curvature": None,
    }
    names = ("regular", "injective", "c1", "control_points", "support", "shrinkage")
    facts |= {name: getattr(found, name) for name in names}
    if found.curvature is not None:
        modes = [vars(mode) for mode in found.curvature.by_frequency]
        facts["curvature"] = vars(found.curvature) | {"by_frequency": modes}
    facts["eigenvalues"] = [
        {
            "real": x.value.real,
            "imaginary": x.value.imag,
            "multiplicity": x.multiplicity,
            "jordan": list(x.jordan),
            "from": list(x.origins),
        }
        for x in found.eigenvalues
    ]
    return facts
