"""Where queries lie around a special corner: ring, piece, and parameters in the piece."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels import reference as kernels

if TYPE_CHECKING:
    from limitsurf.scheme.lattice import Lattice

Array = NDArray[Any]


@dataclass(frozen=True)
class CornerPlace:
    """Where queries lie around a special corner; see `kernels.split_corner`.

    Attributes
    ----------
    level : (Q,)
        Number of halvings n, -1 at the corner itself.
    piece : (Q,)
        In the order of `Lattice.pieces`.
    S, T : (Q,)
        Parameters in the piece.
    halvings : int
        From the ring to the piece: 1, or 2 where pieces are `Lattice.fine_pieces`.
    """

    level: Array
    piece: Array
    S: Array
    T: Array
    halvings: int = 1

    @classmethod
    def of(
        cls, s: Array, t: Array, orientation: Array, lattice: Lattice, halvings: int = 1
    ) -> CornerPlace:
        """Locate (s, t) in patches of some `orientation` against their limit face."""
        # lines between pieces belong to the side nearer corner 0 of the limit face
        up_s, up_t, up = ups = _against(lattice)[:, orientation]
        if lattice.flips:
            found = cls(*kernels.split_flipped_corner(s, t, up_s, up_t, up))
        else:
            found = cls(*kernels.split_corner(s, t, up_s, up_t))
        return found._finer(lattice, ups) if halvings == 2 else found

    def _finer(self, lattice: Lattice, ups: Array) -> CornerPlace:
        """The places in the parts of the pieces."""
        # in pieces that are turned lines belong to the other side
        turned = np.array([piece.turned for piece in lattice.pieces])[self.piece]
        up_s, up_t, up = ups ^ turned
        S, T = 2 * self.S, 2 * self.T
        high_s, high_t = ((x > 1) | ((x == 1) & near) for x, near in ((S, up_s), (T, up_t)))
        corners = [child.origin for child in lattice.children]
        number = np.zeros(len(S), dtype=np.int64)
        if lattice.flips:
            middle = (S + T > 1) | ((S + T == 1) & up)
            number = np.where(high_s, 1, np.where(high_t, 2, np.where(middle, 3, 0)))
        else:
            for k, corner in enumerate(corners):
                number[(high_s == corner[0]) & (high_t == corner[1])] = k
        origin = np.array(corners).T[:, number]
        side = np.where(np.array([child.turned for child in lattice.children])[number], -1, 1)
        S, T = side * (S - origin[0]), side * (T - origin[1])
        return CornerPlace(self.level, len(corners) * self.piece + number, S, T, 2)

    @classmethod
    def at(cls, piece: int, S: float, T: float) -> CornerPlace:
        """One place in a piece at level 0."""
        return cls(np.array([0]), np.array([piece]), np.array([S]), np.array([T]))

    def __getitem__(self, here: Array) -> CornerPlace:
        """The places of some queries, by mask or index."""
        chosen = self.level[here], self.piece[here], self.S[here], self.T[here]
        return CornerPlace(*chosen, self.halvings)


@lru_cache(maxsize=16)
def _against(lattice: Lattice) -> Array:
    return np.array(lattice.against).T
