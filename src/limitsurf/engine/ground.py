"""Where descents begin on a cage whose triangles are cut into nine: neighbourhoods of all places.

Triangles amid regular vertices have the regular neighbourhood. All others are cut into nine twice,
with what is around them: then at most one vertex near each part is special, and which of few
neighbourhoods it has follows from what is at the corners and sides of the triangle.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import numbers
from limitsurf.caching import cached_property
from limitsurf.cage.mesh import Mesh
from limitsurf.engine.surroundings import FIRST, Maps, Neighbourhood
from limitsurf.engine.ternary import Kinds, kinds_of, split
from limitsurf.refine import sparse_operator, stacked
from limitsurf.refine.thirds import Thirds
from limitsurf.rules import Rules
from limitsurf.topology import MeshPart

Array = NDArray[Any]


class Ground:
    """Starts of descents on a cage, and the vertices that their weights are of.

    These are those of the cage, then those of what is cut.
    """

    def __init__(self, mesh: Mesh, rules: Rules) -> None:
        self._mesh, self._rules = mesh, rules
        self._step = Thirds.of(mesh, rules)
        self.kinds: Kinds = kinds_of(rules)
        self._maps = Maps(mesh.twin).tables
        self.regular = self._plain()

    def _plain(self) -> Array:
        """Which faces have none but regular vertices near, (n_faces,) bool."""
        mesh, step = self._mesh, self._step
        plain = step.interior & (mesh.vertex_faces == 6)
        around = np.asarray(plain[mesh.indices].reshape(-1, 3).all(axis=1))
        near = plain.copy()
        near[mesh.indices[~around[mesh.corner_face]]] = False
        return np.asarray(near[mesh.indices].reshape(-1, 3).all(axis=1))

    # ---------------------------------------------------------------- what is cut

    @cached_property
    def _part(self) -> MeshPart:
        mesh = self._mesh
        near = np.zeros(mesh.n_vertices, dtype=bool)
        near[mesh.indices[~self.regular[mesh.corner_face]]] = True
        for _ in range(2):  # two rings of faces around
            some = np.asarray(near[mesh.indices].reshape(-1, 3).any(axis=1))
            near[mesh.indices[some[mesh.corner_face]]] = True
        return MeshPart.of(mesh, near[mesh.indices])

    @cached_property
    def _cut(self) -> tuple[Thirds, Thirds]:
        """Two cuts of the part."""
        part = self._part
        mesh = part.mesh
        first = Thirds.among(
            mesh.connectivity,
            self._step.interior[part.vertices],
            self._step.smooth[part.vertices],
        )
        return first, first.child

    @cached_property
    def _fine(self) -> tuple[Array, Array, Array]:
        """Half-edges' maps, vertices, and which stay, of what is cut."""
        fine = self._cut[1].child
        return Maps(fine.twin).tables, fine.mesh.indices, ~(fine.interior | fine.smooth)

    @cached_property
    def operator(self) -> Any:
        """All vertices as rows over those of the cage; float64."""
        n, number = self._mesh.n_vertices, numbers.FLOAT64
        every = np.arange(n)
        own = sparse_operator(every, every, np.ones(n), (n, n))
        if self.regular.all():
            return own
        vertices = self._part.vertices
        count = len(vertices)
        total = sparse_operator(np.arange(count), vertices, np.ones(count), (count, n))
        for step in self._cut:
            total = step.second(self._rules, number) @ (step.first(self._rules, number) @ total)
        return stacked([own, total])

    @cached_property
    def _codes(self) -> tuple[Array, Array]:
        """What is at each corner of the cage, and at the side from it on, by numbers."""
        mesh, step, fans = self._mesh, self._step, self._mesh.fans
        corner = mesh.indices
        fan = fans.fan
        place = np.where(fans.closed[fan], -1, fans.position)
        kept = step.interior[corner] | step.smooth[corner]
        rows = np.stack([fans.sizes[fan], place, kept], axis=1)
        at = np.unique(rows, axis=0, return_inverse=True)[1].reshape(-1)
        side = np.where(mesh.twin >= 0, 0, 1 + ~mesh.boundary_edge[mesh.corner_edge])
        return at, side

    @cached_property
    def _known(self) -> Array:
        """Kinds by half-edges of what is cut; -1 where nobody has asked."""
        return np.full(len(self._fine[1]), -1)

    # ---------------------------------------------------------------- places

    def begin(self, face: Array, turn: Array, s: Array, t: Array) -> tuple[Array, ...]:
        """Starts of places on faces seen from a corner: kinds, vertices, coordinates, scales.

        Returns kinds (Q,), vertices (Q, width) with zeros beyond their number, s, t, and by what
        these are larger, with a sign.
        """
        Q = len(face)
        kind, scale = np.zeros(Q, dtype=np.int64), np.ones(Q)
        side = 3 * face + turn
        cut = np.flatnonzero(~self.regular[face])
        ids: list[tuple[Array, Array]] = []
        plain = np.flatnonzero(self.regular[face])
        if len(plain):
            known = self.kinds.known[0]
            ids.append((plain, known.vertices(self._maps, self._mesh.indices, side[plain])))
        s, t = s.copy(), t.copy()
        if len(cut):
            fine, sign, code, s[cut], t[cut] = self._below(side[cut], s[cut], t[cut])
            kind[cut], scale[cut] = self._kinds(fine, code), 9 * sign
            maps, indices, _ = self._fine
            for one in np.unique(kind[cut]).tolist():
                here = np.flatnonzero(kind[cut] == one)
                found = self.kinds.known[one].vertices(maps, indices, fine[here])
                ids.append((cut[here], found + self._mesh.n_vertices))
        width = max((x.shape[1] for _, x in ids), default=1)
        vertices = np.zeros((Q, width), dtype=np.int64)
        for which, x in ids:
            vertices[which, : x.shape[1]] = x
        return kind, vertices, s, t, scale

    def _below(self, side: Array, s: Array, t: Array) -> tuple[Array, ...]:
        """Half-edges of what is cut, signs, what tells kinds, and coordinates there."""
        from limitsurf.engine.ternary import SIGN

        at, edge = self._codes
        face, turn = np.divmod(side, 3)
        fine = np.searchsorted(self._part.faces, face)
        first, s, t = split(s, t)
        second, s, t = split(s, t)
        sign = SIGN[first] * SIGN[second]
        corner = 3 * face + (turn + first) % 3
        before = 3 * face + (turn + first + 2) % 3
        code = np.where(first < 3, at[corner], edge[corner])
        code = np.where(first >= 6, 3 * code + edge[before], code)
        code = (code * 9 + first) * 9 + second
        for part in (first, second):
            fine = 9 * fine + 3 * (part // 3) + (part + turn) % 3
            turn = FIRST[part]
        return 3 * fine + turn, sign, code, s, t

    def _kinds(self, side: Array, code: Array) -> Array:
        """Kinds of half-edges of what is cut, equal where the codes are."""
        kinds = self._known[side]
        new = np.flatnonzero(kinds < 0)
        if len(new):
            maps, indices, stays = self._fine
            _, first, which = np.unique(code[new], return_index=True, return_inverse=True)
            found = [
                self.kinds.number(Neighbourhood.of(maps, indices, stays, one))
                for one in side[new[first]].tolist()
            ]
            kinds[new] = np.array(found)[which.reshape(-1)]
            self._known[side[new]] = kinds[new]
        return kinds
