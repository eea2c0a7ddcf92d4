"""What there is to say of a cage and of its limit surface: counts, and why patches are special."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import prod
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

import limitsurf as ls
from limitsurf.cage.mesh import Mesh
from limitsurf.shell import terminal
from limitsurf.shell.io.merge import apart
from limitsurf.tables import is_infinite

Facts: TypeAlias = dict[str, Any]


def cage_facts(
    mesh: Mesh, rules: Mapping[str, Any], schemes: Mapping[str, str] | None = None
) -> Facts:
    """Facts of a cage, and of its surface under rules for `LimitSurface`, by name.

    The cage may be of several meshes, by name, which have schemes of their own.

    Numbers, and dictionaries of numbers; the names are those that the help of ``limitsurf info``
    lists, always all of them, None where there is nothing to say.

    Examples
    --------
    >>> import limitsurf as ls
    >>> from limitsurf.shell.cli.facts import cage_facts
    >>> facts = cage_facts(ls.Mesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]]), {})
    >>> facts["vertices"], facts["closed"], facts["limit_faces"], facts["special_corners"]
    (3, False, 3, [{'kind': 'interior', 'faces': 3, 'patches': 3}])
    """
    facts: Facts = {
        **_counts_of(mesh),
        "creases": _sharpness(mesh.creases[1]),
        "corners": _sharpness(mesh.corners[1]),
        "holes": len(mesh.holes),
        "channels": {
            name: {
                "values": len(values),
                "numbers": prod(values.shape[1:]),
                "interpolation": interpolation,
            }
            for name, (values, _, interpolation) in mesh.channels.items()
        },
        "face_data": list(mesh.face_data),
        "scheme": mesh.scheme if mesh.scheme is None else getattr(mesh.scheme, "name", mesh.scheme),
        "schemes": schemes,
        "units": mesh.units,
        "up": mesh.up,
        "rules": None,
        "limit_faces": None,
        "patches": None,
        "special_corners": None,
        "no_surface": None,
    }
    try:
        surface = ls.LimitSurface(mesh, **rules)
    except ValueError as error:
        if any(rules.values()):
            raise
        facts["no_surface"] = terminal.sentence(error)
        return facts
    in_force = {**surface.rules, "scheme": surface.rules["scheme"].name}
    if surface.rules["scheme"].smooth_triangle is None:
        del in_force["triangles"]  # a choice between two masks, of which the scheme has one
    facts["rules"] = {
        name: {
            "value": value,
            "by_default": getattr(mesh, name) is None and rules.get(name) is None,
        }
        for name, value in in_force.items()
    }
    facts["limit_faces"] = len(surface.limit_faces)
    if not surface.rules["scheme"].has_pieces:
        return facts
    facts["patches"] = dict(surface.patches.summary())
    facts["special_corners"] = [
        {"kind": kind, "faces": faces, "patches": number}
        for kind, faces, number in surface.patches.special_corners()
    ]
    return facts


def _counts_of(mesh: Mesh) -> Facts:
    """How much there is of what a cage is made of."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    used = mesh.vertex_faces > 0
    start, end = mesh.edges.T
    links = coo_array((np.ones(mesh.n_edges), (start, end)), shape=(mesh.n_vertices,) * 2)
    odd = mesh.nonmanifold_vertex
    return {
        "vertices": mesh.n_vertices,
        "unused_vertices": int((~used).sum()),
        "edges": mesh.n_edges,
        "boundary_edges": int(mesh.boundary_edge.sum()),
        "apart_edges": apart(mesh),
        "nonmanifold_edges": int(mesh.nonmanifold_edge.sum()),
        "faces": mesh.n_faces,
        "components": len(np.unique(connected_components(links)[1][used])),
        "closed": mesh.is_closed,
        "face_sizes": _counts(mesh.sizes),
        "valences": _counts(mesh.vertex_faces[used & ~mesh.boundary_vertex & ~odd]),
        "boundary_faces": _counts(mesh.vertex_faces[mesh.boundary_vertex & ~odd]),
        "nonmanifold_faces": _counts(mesh.vertex_faces[odd]),
    }


def _counts(values: NDArray[np.int64]) -> dict[int, int]:
    kinds, counts = np.unique(values, return_counts=True)
    return dict(zip(kinds.tolist(), counts.tolist(), strict=True))


def _sharpness(values: NDArray[Any]) -> Facts:
    finite = values[~is_infinite(values)]
    return {
        "number": len(values),
        "infinite": len(values) - len(finite),
        "least": float(finite.min()) if len(finite) else None,
        "most": float(finite.max()) if len(finite) else None,
    }


def told(facts: Facts) -> Iterator[tuple[str, str]]:
    """The facts of a cage as lines of a table."""
    yield "vertices", _with_some(facts["vertices"], {"in no face": facts["unused_vertices"]})
    on = {
        "on the boundary": facts["boundary_edges"],
        "on another without being joined": facts["apart_edges"],
        "not manifold": facts["nonmanifold_edges"],
    }
    yield "edges", _with_some(facts["edges"], on)
    yield "faces", f"{facts['faces']}"
    yield "components", f"{facts['components']}, {'closed' if facts['closed'] else 'open'}"
    for name, key in (
        ("corners of faces", "face_sizes"),
        ("valences inside", "valences"),
        ("faces at boundary vertices", "boundary_faces"),
        ("faces at vertices that are not manifold", "nonmanifold_faces"),
    ):
        if facts[key]:
            yield name, terminal.times(facts[key])
    for name in ("creases", "corners"):
        if facts[name]["number"]:
            yield name, _told_sharpness(**facts[name])
    if facts["holes"]:
        yield "holes", f"{facts['holes']}"
    for name, channel in facts["channels"].items():
        yield f"channel {name}", f"{channel['values']} values, {channel['interpolation']}"
    if facts["face_data"]:
        yield "data of faces", ", ".join(facts["face_data"])
    for name, scheme in (facts["schemes"] or {}).items():
        yield f"scheme of {name}", scheme
    if facts["units"] is not None:
        yield "units", f"{facts['units']:g} m"
    if facts["up"] is not None:
        yield "up axis", facts["up"]
    yield from _told_surface(facts)


def _told_surface(facts: Facts) -> Iterator[tuple[str, str]]:
    """The facts of a limit surface as lines of a table."""
    if facts["no_surface"] is not None:
        if facts["scheme"] is not None:
            yield "scheme", str(facts["scheme"])
        yield "limit surface", f"none: {facts['no_surface']}"
        return
    for name, rule in facts["rules"].items():
        yield name, f"{rule['value']}{', by default' if rule['by_default'] else ''}"
    yield "limit faces", f"{facts['limit_faces']}"
    for reason, count in (facts["patches"] or {}).items():
        yield f"  {reason}", f"{count}"
    if corners := facts["special_corners"]:
        yield "special corners of patches", ", ".join(_told_corner(**corner) for corner in corners)


def _with_some(total: int, some: Mapping[str, int]) -> str:
    """A number, and how many of them are something else than usual."""
    found = [f"{number} of them {what}" for what, number in some.items() if number]
    return ", ".join([f"{total}", *found])


def _told_sharpness(number: int, infinite: int, least: float | None, most: float | None) -> str:
    """How many there are, of which sharpness, such as "5, sharpness 0.5 to 2, 3 infinite"."""
    said = [f"{number}"]
    if least is not None:
        said.append(f"sharpness {least:g}" + (f" to {most:g}" if least != most else ""))
    if infinite:
        said.append(f"{infinite} infinite" if infinite < number else "infinite")
    return ", ".join(said)


def _told_corner(kind: str, faces: int, patches: int) -> str:
    if kind == "interior":
        return f"valence {faces} ({patches})"
    return f"{kind} of {faces} face{'' if faces == 1 else 's'} ({patches})"
