"""The cages of spaces: refined, cut down to what has influence, extended beyond boundaries."""

from __future__ import annotations

import warnings
from typing import Any, Literal, TypeAlias

import numpy as np

from limitsurf.cage.mesh import Mesh
from limitsurf.fem.ends import Rim, described, refusal, trimmed, with_ghosts
from limitsurf.fem.phantoms import Phantoms
from limitsurf.fem.sectors import Sectors
from limitsurf.options import Rules
from limitsurf.refine import refined, refuse_levels

Ends: TypeAlias = Literal["free", "natural"]


class Levels:
    """A cage and the refined one whose vertices are those of a space.

    Where all boundaries are regular and creases part nothing, their ghosts are faces of the cages.
    Otherwise, if they are to be `parted`, cages are without ghosts, and `phantoms` has these;
    else boundaries with a vertex that is not regular are natural as a whole.
    """

    def __init__(self, mesh: Mesh, levels: int, ends: Ends, parted: bool) -> None:
        refuse_levels(mesh, levels)  # each by itself would tell of one level
        self.levels, self.ends = levels, ends
        self.parted = parted and ends == "free" and _has_parts(mesh)
        self.coarsest, self.begin = _begun(mesh, "natural" if self.parted else ends)
        self.finest = self.coarsest
        for _ in range(levels):
            self.finest, _ = self._refined(self.finest)

    def _refined(self, mesh: Mesh) -> tuple[Mesh, Any]:
        """The cage of one level more, and the matrix to it."""
        whole: Mesh
        whole, operator = refined(mesh, 1, operator=True)
        if self.parted:
            whole = whole.with_tags(face_data={"child": np.arange(whole.n_faces)})
        fine, more = _begun(whole, "natural" if self.parted else self.ends)
        return fine, operator if more is None else more @ operator

    def phantoms(self) -> Phantoms | None:
        """Those beyond the finest cage, if it has parts."""
        if not self.parted:
            return None
        found = _phantoms(self.finest)
        return None if found.trivial else found

    def operator(self, mesh: Mesh | None, levels: int) -> Any:
        """The matrix from the vertices of a cage, or of the one that was given, to the finest."""
        from scipy.sparse import eye_array

        begin = self.begin if mesh is None else None
        mesh = self.coarsest if mesh is None else mesh
        total = eye_array(mesh.n_vertices, format="csr") if begin is None else begin
        for _ in range(levels):
            mesh, step = self._refined(mesh)
            total = step @ total
        return total.tocsr()

    def prolongation(self, mesh: Mesh, levels: int) -> Any:
        """The matrix from the functions of a cage of so many levels less to those of the finest."""
        from scipy.sparse import eye_array

        if not self.parted:
            return self.operator(mesh, levels)
        coarse = _phantoms(mesh)
        total = eye_array(coarse.n, format="csr")
        for _ in range(levels):
            mesh, step = self._refined(mesh)
            fine = _phantoms(mesh)
            total = coarse.next_from(fine, step) @ total
            coarse = fine
        return total.tocsr()

    def warn_of_natural_ends(self, stacklevel: int) -> None:
        """Say once where ends that should be free are natural ones in the end."""
        mesh = self.finest
        rules = Rules.resolve(mesh)
        free = rules.scheme.lattice.dual and self.levels > 0  # points beyond are vertices then
        if mesh.is_closed or rules.scheme.local or free:
            return
        rim = Rim.of(mesh, rules)
        if self.parted:
            sectors = Sectors.of(mesh, rules)
            bad = np.unique(sectors.vertex[sectors.irregular])
            bad = bad[mesh.boundary_vertex[bad]]
            if not len(bad):
                return
            text = f"at {len(bad)} boundary {'vertices' if len(bad) > 1 else 'vertex'}"
            why = described(mesh, bad)
        elif not len(rim.sides):
            return
        else:
            loops = len(np.unique(rim.loop))
            text = f"along {loops} boundar{'y' if loops == 1 else 'ies'}"
            why = refusal(rules.scheme) or (
                f"{len(rim.irregular)} boundary vertices: {described(mesh, rim.irregular)}"
            )
        warnings.warn(
            f'ends="free" falls back on natural ends {text}, where functions converge slower: '
            f"{why}",
            UserWarning,
            stacklevel=stacklevel,
        )


def _phantoms(mesh: Mesh) -> Phantoms:
    return Phantoms(mesh, Sectors.of(mesh, Rules.resolve(mesh)))


def _has_parts(mesh: Mesh) -> bool:
    """Whether there are boundary vertices that are not regular, or creases that part a cage."""
    rules = Rules.resolve(mesh)
    mesh, _ = trimmed(mesh, rules)
    if refusal(rules.scheme) is not None or (mesh.is_closed and not len(mesh.creases[0])):
        return False
    sectors = Sectors.of(mesh, rules)
    odd = sectors.vertex[sectors.irregular]
    free = sectors.vertex[sectors.size > 0]
    return bool(mesh.boundary_vertex[odd].any() or sectors.creased[free].any())


def _begun(mesh: Mesh, ends: Ends) -> tuple[Mesh, Any]:
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


def _whole_loops(mesh: Mesh, rim: Rim) -> Any:
    """Sides on boundaries of which each vertex is regular."""
    bad = np.zeros(mesh.n_vertices, dtype=bool)
    bad[rim.irregular] = True
    broken = np.zeros(int(rim.loop.max(initial=-1)) + 1, dtype=bool)
    for corners in (rim.sides, mesh.next_corner[rim.sides]):
        broken[rim.loop[bad[mesh.indices[corners]]]] = True
    return ~broken[rim.loop]
