"""Which functions live on which limit faces.

Most limit faces are one patch of vertices of the cage: all of one kind have the same weights at the
same parameters, so that one of them is evaluated for all. The others, split ones, those at sharp
edges and those of which functions meet themselves, are evaluated one by one.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import tables
from limitsurf.integrals.quadrature import quadrature
from limitsurf.patches import NO_LIMIT, REGULAR, STRIP
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_AT_ONCE = 1 << 12  # faces whose functions are looked up together


@dataclass(frozen=True, eq=False)
class Group:
    """Limit faces with equal numbers of functions.

    Attributes
    ----------
    faces : (F,) int
    controls : (F, C) int32
        Functions that do not vanish on each, all different.
    alike : bool
        Whether their weights are the same at the same parameters.
    special : hashable or None
        Of such faces with a special corner what their weights depend on: those of other surfaces
        with the same are theirs.
    """

    faces: Array
    controls: Array
    alike: bool
    special: Hashable = None


class Elements:
    """All limit faces of a surface that have a limit, in groups.

    If it is `complete` each vertex needs to have influence on one.

    Attributes
    ----------
    groups : list of Group
    group, row : (n_limit_faces,) int32
        In which group a limit face is, -1 without limit, and where in it.
    """

    def __init__(self, surface: LimitSurface, *, complete: bool = True) -> None:
        patches = surface.patches
        self.groups: list[Group] = []
        self.group = np.full(patches.n_limit_faces, -1, dtype=np.int32)
        self.row = np.zeros(patches.n_limit_faces, dtype=np.int32)
        code = patches.codes[: patches.n_limit_faces]
        whole = np.flatnonzero(code >= 0)
        kind, turn = patches.kind[code[whole]], patches.turn[code[whole]].astype(np.int64)
        key = kind * len(patches.lattice.corners) + turn
        for one in np.unique(key).tolist():
            self._add_alike(surface, code, whole[key == one])
        rest = np.flatnonzero((self.group < 0) & (code != NO_LIMIT))
        for start in range(0, len(rest), _AT_ONCE):
            self._add_others(surface, rest[start : start + _AT_ONCE])
        if complete:
            self._check(surface)

    def _add_alike(self, surface: LimitSurface, code: Array, faces: Array) -> None:
        """Add those of some faces of one kind and turn that have distinct vertices alone."""
        patches = surface.patches
        patch = code[faces]
        kind = int(patches.kind[patch[0]])
        sector = patches.sectors[kind]
        if kind != REGULAR and (sector is None or sector.kind != "interior"):
            return
        if kind in patches.rings or kind == STRIP:
            return
        controls = patches.controls[kind][patches.row[patch]]
        ascending = np.sort(controls, axis=1)
        good = (ascending[:, 1:] != ascending[:, :-1]).all(axis=1)
        good &= ascending[:, -1] < patches.n_vertices
        special = None
        if sector is not None:
            table = tables.eigen_table(surface.topology.rules.scheme, sector)
            special = table, int(patches.turn[patch[0]]), surface.engine
        self._add(faces[good], controls[good], True, special)

    def _add_others(self, surface: LimitSurface, faces: Array) -> None:
        """Add faces by the weights at some places in each of their pieces."""
        n = surface.mesh.n_vertices
        q = quadrature(surface, points=2, rtol=1e-2, face=faces)
        rows = surface.weights(q.face, q.u, q.v)
        of_point = np.repeat(np.arange(len(faces)), np.diff(q.offsets))
        key = np.repeat(of_point, np.diff(rows.indptr)) * n + rows.indices
        key = np.unique(key[rows.data != 0])
        owner, column = np.divmod(key, n)
        count = np.bincount(owner, minlength=len(faces))
        first = np.cumsum(count) - count
        for size in np.unique(count).tolist():
            here = np.flatnonzero(count == size)
            self._add(faces[here], column[first[here][:, None] + np.arange(size)], False)

    def _check(self, surface: LimitSurface) -> None:
        """Refuse functions that vanish on all faces."""
        used = np.zeros(surface.mesh.n_vertices, dtype=bool)
        for group in self.groups:
            used[group.controls] = True
        if not used.all():
            bad = np.flatnonzero(~used)
            raise ValueError(
                f"the function of vertex {bad[0]} (and of {len(bad) - 1} more) of the refined cage "
                "vanishes on all limit faces: it is of holes beyond sharp edges; leave these out "
                "of the cage, as by ls.selected"
            )

    def _add(self, faces: Array, controls: Array, alike: bool, special: Hashable = None) -> None:
        if len(faces):
            self.group[faces] = len(self.groups)
            self.row[faces] = np.arange(len(faces))
            self.groups.append(Group(faces, controls.astype(np.int32), alike, special))
