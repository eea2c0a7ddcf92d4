"""Queries by kind of patch: each group lies in patches that are evaluated alike."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels import reference as kernels
from limitsurf.caching import cached_property
from limitsurf.engine.kinds import Corners, Group, Kind, Regular, Rings, Strip
from limitsurf.numbers import NumberType
from limitsurf.patches import REGULAR, STRIP, PatchTable
from limitsurf.tables import EigenTable, StripTables, eigen_table, ring_masks

if TYPE_CHECKING:
    from limitsurf.scheme.scheme import Scheme

Array = NDArray[Any]

# queries handled at once, and control values gathered at once: what stays in cache and in memory
CHUNK = 1 << 16
_GATHER = 1 << 22


class Groups:
    """Queries by kind of patch, for numbers of one type.

    Shared by surfaces of one topology. What the kinds need is looked up when they are first asked
    for, once.
    """

    def __init__(self, patches: PatchTable, scheme: Scheme, number: NumberType) -> None:
        self.patches = patches
        self.number = number
        self._scheme = scheme

    @cached_property
    def tables(self) -> list[EigenTable | None]:
        """The tables of kinds that have eigenbases; refuses masks that do not converge."""
        rings, scheme = self.patches.rings, self._scheme
        return [
            None if sector is None or kind in rings else eigen_table(scheme, sector)
            for kind, sector in enumerate(self.patches.sectors)
        ]

    @cached_property
    def kinds(self) -> list[Kind]:
        """All kinds of patches, by number."""
        patches, scheme = self.patches, self._scheme
        found: list[Kind] = []
        for kind, (sector, table) in enumerate(zip(patches.sectors, self.tables, strict=True)):
            controls, own = patches.controls[kind], (self.number, scheme)
            if kind == REGULAR:
                found.append(Regular(controls, *own))
            elif kind == STRIP:
                found.append(Strip(controls, *own, patches.sharpness))
            elif table is not None:
                found.append(Corners(controls, *own, table))
            else:
                assert sector is not None
                masks = ring_masks(scheme, sector.kind, sector.faces)
                found.append(Rings(controls, *own, patches.rings[kind], masks))
        return found

    @property
    def strips(self) -> tuple[StripTables, Array]:
        """Splines across the creases of strips, and which of them each strip has."""
        strip = self.kinds[STRIP]
        assert isinstance(strip, Strip)
        return strip.tables

    def by_kind(
        self, face: Array, u: Array, v: Array, width: int = 1, dense: bool = True
    ) -> tuple[Array, list[Group]]:
        """Queries (Q,) of a chunk without a value (NaN), and the others by kind of patch.

        No group gathers too much for `width` numbers a control point; those of shared rings count
        if `dense`.
        """
        patches, lattice = self.patches, self._scheme.lattice
        finite = self.number.finite(u) & self.number.finite(v)
        finite &= patches.codes[face] != -1
        defined, undefined = finite.nonzero()[0], (~finite).nonzero()[0]
        patch, s, t, depth, flipped = patches.locate(face[defined], u[defined], v[defined])
        if patch.min(initial=0) < 0:  # parts of limit faces without a limit
            lost = patch < 0
            undefined, defined = np.append(undefined, defined[lost]), defined[~lost]
            patch, s, t, depth = patch[~lost], s[~lost], t[~lost], depth[~lost]
            flipped = None if flipped is None else flipped[~lost]
        kinds, groups = patches.kind[patch], []
        for which in np.unique(kinds).tolist():
            here = (kinds == which).nonzero()[0]
            kind, turn, x, y = self.kinds[which], patches.turn[patch[here]], s[here], t[here]
            if turn.any():
                sides = kernels.coordinates(x, y, lattice.sides)
                x, y = np.choose(turn, sides), np.choose(turn, sides[1:] + sides[:1])
            if flipped is not None:
                turn = turn + lattice.face_size * flipped[here]
            group = Group(kind, defined[here], patches.row[patch[here]], x, y, depth[here], turn)
            step = max(1, _GATHER // max(kind.widths[dense] * width, 1))
            groups += [group] if len(here) <= step else _cut(group, step)
        return undefined, groups


def _cut(g: Group, step: int) -> list[Group]:
    """A group in parts of so many queries."""
    parts = (slice(start, start + step) for start in range(0, len(g.query), step))
    return [
        Group(g.kind, *(x[part] for x in (g.query, g.row, g.s, g.t, g.depth, g.orientation)))
        for part in parts
    ]
