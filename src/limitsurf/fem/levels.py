"""The cages of spaces: refined, cut down to what has influence, extended beyond boundaries."""

from __future__ import annotations

import warnings
from typing import Any, Literal, TypeAlias

import numpy as np

from limitsurf.cage.mesh import Mesh
from limitsurf.fem.ends import Rim, described, refusal, trimmed, with_ghosts
from limitsurf.options import Rules
from limitsurf.refine import refined

Ends: TypeAlias = Literal["free", "natural"]


def begun(mesh: Mesh, ends: Ends) -> tuple[Mesh, Any]:
    """A cage without what has no influence, and with ghost faces where its ends are free.

    Also the matrix from the vertices of the one that was given.
    """
    rules = Rules.resolve(mesh)
    found, operator = trimmed(mesh, rules)
    if ends == "free" and not found.is_closed and refusal(rules.scheme) is None:
        rim = Rim.of(found, rules)
        which = _whole_loops(found, rim)
        if which.any():
            found, more = with_ghosts(found, rim, which)
            operator = more if operator is None else more @ operator
    return found, operator


def refined_once(mesh: Mesh, ends: Ends) -> tuple[Mesh, Any]:
    """The cage of a space of one level more, and the matrix to it."""
    whole, operator = refined(mesh, 1, operator=True)
    fine, more = begun(whole, ends)
    return fine, operator if more is None else more @ operator


def _whole_loops(mesh: Mesh, rim: Rim) -> Any:
    """Sides on boundaries of which each vertex is regular."""
    bad = np.zeros(mesh.n_vertices, dtype=bool)
    bad[rim.irregular] = True
    broken = np.zeros(int(rim.loop.max(initial=-1)) + 1, dtype=bool)
    for corners in (rim.sides, mesh.next_corner[rim.sides]):
        broken[rim.loop[bad[mesh.indices[corners]]]] = True
    return ~broken[rim.loop]


def warn_of_natural_ends(mesh: Mesh, stacklevel: int) -> None:
    """Say once where ends that should be free are natural ones in the end."""
    rules = Rules.resolve(mesh)
    if mesh.is_closed or rules.scheme.local:
        return
    rim = Rim.of(mesh, rules)
    if not len(rim.sides):
        return
    loops = len(np.unique(rim.loop))
    why = refusal(rules.scheme) or f"{len(rim.irregular)} boundary vertices: {described(mesh, rim)}"
    warnings.warn(
        f'ends="free" falls back on natural ends along {loops} '
        f"boundar{'y' if loops == 1 else 'ies'}, where functions converge slower: {why}",
        UserWarning,
        stacklevel=stacklevel,
    )
