"""What there is to say of the spectrum around a special corner: eigenvalues, masks, growth."""

from __future__ import annotations

from typing import Any, TypeAlias

from limitsurf.shell import terminal
from limitsurf.spectra import Eigenbasis

Facts: TypeAlias = dict[str, Any]

SHORT = 100  # characters of a closed form that are shown unless all are wanted
GROWTH = {  # what is said of it, and its formula
    "first_derivatives": ("first derivatives", "2 l1"),
    "second_derivatives": ("second derivatives", "4 l1, or 4 l3 if l1 = 1/2"),
    "curvature": ("curvature", "l3 / l2^2"),
    "normals": ("distance of normals from their limit", "l3 / l2"),
}


def spectrum_facts(basis: Eigenbasis, digits: int, latex: bool = False) -> Facts:
    """Facts of an eigenbasis by name, as the help of ``limitsurf basis`` lists them.

    Examples
    --------
    >>> import limitsurf as ls
    >>> from limitsurf.shell.cli.spectrum import spectrum_facts
    >>> facts = spectrum_facts(ls.eigenbasis("catmull-clark", valence=3), digits=5)
    >>> facts["eigenvalues"][1]["decimal"], facts["eigenvalues"][1]["multiplicity"]
    ('0.41010', 2)
    >>> facts["limit_mask"][0]["exact"], round(facts["growth"]["first_derivatives"], 3)
    ('3/8', 0.82)
    """
    sector = basis.sector
    facts: Facts = {
        "scheme": basis.scheme.name,
        "paper": basis.scheme.paper,
        "kind": sector.kind,
        "faces": sector.faces,
        "position": sector.position,
        "control_points": sector.size,
        "eigenvalues": [],
        "growth": _growth(basis),
        "limit_mask": _mask(basis, basis.exact.limit_mask, digits, latex),
        "tangent_masks": [_mask(basis, m, digits, latex) for m in basis.exact.tangent_masks],
    }
    for group in basis.groups:
        value = basis.exact.eigenvalues[group.places[0]]
        real, imaginary = map(float, value.evalf(20).as_real_imag())
        facts["eigenvalues"].append(
            {
                "real": real,
                "imaginary": imaginary,
                "multiplicity": len(group.places),
                "jordan": list(group.jordan),
                "from": list(group.origins),
                **_number(value, digits, latex),
            }
        )
    return facts


def _number(value: Any, digits: int, latex: bool) -> Facts:
    """A sympy expression as decimals and as it is."""
    real, imaginary = (str(part) for part in value.evalf(digits).as_real_imag())
    sign = "" if imaginary.startswith("-") else "+"
    decimal = real if imaginary == "0" else f"{real}{sign}{imaginary}i"
    facts = {"decimal": decimal, "exact": str(value)}
    if latex:
        facts["latex"] = value._repr_latex_().strip("$").removeprefix(r"\displaystyle ")
    return facts


def _points(basis: Eigenbasis) -> list[str]:
    """The points of the ring by name."""
    if basis.sector.lattice.dual:
        return [f"w{k}" for k in range(basis.sector.ring)]
    carried, orbits = basis.sector.carried, len(basis.sector.lattice.orbits)
    around = range(basis.sector.ring - carried - 1)
    names = (f"{'ef'[k % orbits]}{k // orbits}" for k in around)
    return ["vertex", *names, *["m"] * carried]


def _mask(basis: Eigenbasis, mask: tuple[Any, ...], digits: int, latex: bool) -> list[Facts]:
    """The weights of a mask; those of the outer points are 0."""
    points = _points(basis)
    return [
        {"point": name, **_number(weight, digits, latex)}
        for name, weight in zip(points, mask[: len(points)], strict=True)
    ]


def _growth(basis: Eigenbasis) -> Facts:
    """The eigenvalues after 1, and what grows by them."""
    values = basis.float64.rates[0, 1:4]
    return {"l1": float(values[0]), "l2": float(values[1]), "l3": float(values[2])} | basis.growth


def say(facts: Facts, exact: bool) -> None:
    """Facts of a spectrum as tables on stdout; long closed forms only if `exact`."""
    kind, faces, growth = facts["kind"], facts["faces"], facts["growth"]
    what = f"{kind} of {faces} face{'' if faces == 1 else 's'}"
    place = f", seen from face {facts['position']}" if facts["position"] else ""
    terminal.say_table(
        [
            ("scheme", f"{facts['scheme']}, {facts['paper']}"),
            ("vertex", f"smooth, valence {faces}" if kind == "interior" else what + place),
            ("control points", f"{facts['control_points']}"),
            ("tangent plane", "yes" if facts["tangent_masks"] else "none in general"),
            ("l1, l2, l3", ", ".join(f"{growth[name]:.6g}" for name in ("l1", "l2", "l3"))),
        ]
    )
    terminal.say("\nAs the distance from the vertex is halved, these are in general multiplied by")
    terminal.say_table(
        (f"  {name}", f"{growth[key]:.6g}", formula)
        for key, (name, formula) in GROWTH.items()
        if growth[key] is not None
    )
    terminal.say()
    names = ("eigenvalue", "times", "Jordan blocks", "of", "exact")
    rows = [
        (
            value["decimal"],
            str(value["multiplicity"]),
            "" if max(value["jordan"]) == 1 else " + ".join(map(str, value["jordan"])),
            ", ".join(value["from"]),
            _form(value["exact"], exact),
        )
        for value in facts["eigenvalues"]
    ]
    terminal.say_table(rows, names, left=(0, 2, 3, 4))
    terminal.say()
    masks = [facts["limit_mask"], *facts["tangent_masks"]]
    heads = ("point", "limit mask", "exact", "tangent mask", "tangent mask")[: len(masks) + 2]
    columns = [[weight["point"] for weight in masks[0]]]
    columns += [[weight["decimal"] for weight in mask] for mask in masks]
    columns.insert(2, [weight["exact"] for weight in masks[0]])
    terminal.say_table(zip(*columns, strict=True), heads, left=range(5))
    for mask in masks[1:] if exact else ():
        terminal.say()
        weights = [(weight["point"], weight["exact"]) for weight in mask]
        terminal.say_table(weights, ("point", "tangent mask"), left=(0, 1))


def _form(expression: str, whole: bool) -> str:
    return expression if whole or len(expression) <= SHORT else "..."


def in_latex(facts: Facts, exact: bool) -> str:
    """Eigenvalues and masks as LaTeX arrays for math mode; those of tangents only if `exact`."""
    masks = [facts["limit_mask"], *(facts["tangent_masks"] if exact else ())]
    return "\n\n".join(
        [
            _array(
                (r"\lambda", r"\text{decimal}", r"\text{multiplicity}", r"\text{of}"),
                [
                    (
                        value["latex"],
                        value["decimal"],
                        _multiplicity(value),
                        rf"\text{{{', '.join(value['from'])}}}",
                    )
                    for value in facts["eigenvalues"]
                ],
            ),
            *(
                _array(
                    (r"\text{point}", rf"\text{{{name} mask}}"),
                    [(_symbol(weight["point"]), weight["latex"]) for weight in mask],
                )
                for name, mask in zip(("limit", "tangent", "tangent"), masks, strict=False)
            ),
        ]
    )


def _array(names: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [" & ".join(row) for row in [names, *rows]]
    lines[0] += r" \\ \hline"
    body = " \\\\\n".join(lines[1:])
    return "\n".join([rf"\begin{{array}}{{{'l' * len(names)}}}", lines[0], body, r"\end{array}"])


def _multiplicity(value: Facts) -> str:
    blocks = [rf"J_{{{size}}}" for size in value["jordan"] if size > 1]
    return " ".join(
        [str(value["multiplicity"]), *([rf"\ ({', '.join(blocks)})"] if blocks else [])]
    )


def _symbol(point: str) -> str:
    return {"vertex": "v", "m": "m"}.get(point, f"{point[0]}_{{{point[1:]}}}")
