"""Which patches cover limit faces, and where: the tree of splits walked down, all faces at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.patches import REGULAR, STRIP, PatchTable
from limitsurf.pieces import bernstein
from limitsurf.tables import StripTables

if TYPE_CHECKING:
    from limitsurf.scheme.lattice import Child, Lattice

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Cover:
    """Patches of limit faces, those of a face together, by v and then by u.

    Attributes
    ----------
    owner : (P,) int64
        Place among the faces asked for.
    patch : (P,) int
    level : (P,) int64
        Halvings from limit face to the cell of the patch.
    place : (P, 2) int64
        Corner 0 of the cell along u and along v, in its own size.
    sign : (P,) int64
        -1 for cells that are turned by half a turn, as middle ones of triangles; else 1.
    """

    owner: Array
    patch: Array
    level: Array
    place: Array
    sign: Array

    @classmethod
    def of(cls, patches: PatchTable, faces: Array) -> Cover:
        """The patches of some limit faces; those without a limit have none."""
        patches.check_pieces()
        owner, code = np.arange(len(faces)), patches.codes[faces]
        if (code >= 0).all():  # as most are in most cages
            none = np.zeros((len(faces), 2), dtype=np.int64)
            return cls(owner, code, none[:, 0], none, np.ones(len(faces), dtype=np.int64))
        place, level, found = np.zeros((len(faces), 2), dtype=np.int64), 0, []
        sign = np.ones(len(faces), dtype=np.int64)
        lattice = patches.lattice
        children = [lattice.children[k] for k in np.argsort(lattice.parts)]
        origins, signs = np.array([x.origin for x in children]), _signs(children)
        while True:
            done = code >= 0
            depth = np.full(int(done.sum()), level)
            found.append((owner[done], code[done], depth, place[done], sign[done]))
            split = code <= -2
            if not split.any():
                break
            first = patches.n_limit_faces + len(children) * (-2 - code[split].astype(np.int64))
            code = patches.codes[(first[:, None] + np.arange(len(children))).ravel()]
            owner = np.repeat(owner[split], len(children))
            steps = sign[split, None, None] * origins
            place = (2 * place[split][:, None] + steps).reshape(-1, 2)
            sign = (sign[split, None] * signs).ravel()
            level += 1
        arrays = [np.concatenate(x) for x in zip(*found, strict=True)]
        if level:
            owner, _, depth, place, _ = arrays
            u, v = np.ldexp(place, -depth[:, None]).T
            order = np.lexsort((u, v, owner))
            arrays = [x[order] for x in arrays]
        return cls(*arrays)


@dataclass(frozen=True, eq=False)
class Group:
    """Patches that are cut alike.

    Attributes
    ----------
    kind : int
    members : (P,) int
        Places in the cover.
    rows : (P,) int
        Rows in the control table of the kind.
    turn : (P,) int
    count : int
        Rings of special patches, halvings of strips towards the crease.
    origin, size : (c, 2)
        Their cells in (s, t); sizes of cells that are turned by half a turn are negative.
    first : (P,) int
        The first cell of each; the others follow it.
    """

    kind: int
    members: Array
    rows: Array
    turn: Array
    count: int
    origin: Array
    size: Array
    first: Array

    @property
    def cells(self) -> Array:
        """Numbers of the cells, (P, c)."""
        return np.asarray(self.first[:, None] + np.arange(len(self.origin)))


def grouped(
    patches: PatchTable, cover: Cover, rings: Array, strips: StripTables, which: Array
) -> tuple[int, list[Group]]:
    """The number of cells, and patches by kind and the way they are cut.

    `rings` (P,) is how many there are to be around special corners; `which` of `strips` each strip
    has.
    """
    lattice = patches.lattice
    kind, row = patches.kind[cover.patch], patches.row[cover.patch]
    turn = patches.turn[cover.patch].astype(np.int64)
    count = np.where(kind > STRIP, rings, 0)
    across = np.flatnonzero(kind == STRIP)
    count[across] = strips.depth[which[row[across]]]
    n_cells = np.where(kind > STRIP, len(lattice.pieces) * count, 1 + count)
    n_cells[across] **= 1 + strips.both
    end = np.cumsum(n_cells)
    first = end - n_cells
    groups = []
    for one in np.flatnonzero(np.bincount(kind)).tolist():
        alike = np.flatnonzero(kind == one)
        for n in np.flatnonzero(np.bincount(count[alike])).tolist():
            here = alike[count[alike] == n]
            cells = _cells(lattice, one, n)
            if one == STRIP and strips.both:
                size = np.full((4, 2), 0.5)
                cells = size * [[0, 0], [1, 0], [0, 1], [1, 1]], size
            groups.append(Group(one, here, row[here], turn[here], n, *cells, first[here]))
    return int(end[-1]) if len(end) else 0, groups


def _cells(lattice: Lattice, kind: int, count: int) -> tuple[Array, Array]:
    """Origins and signed sizes (c, 2) of the cells of a patch, in (s, t)."""
    if kind == REGULAR:
        return np.zeros((1, 2)), np.ones((1, 2))
    half = np.ldexp(1.0, -np.arange(1, count + 1))  # of each ring, or upper half
    if kind > STRIP:
        pieces = lattice.pieces
        size = np.repeat(half, len(pieces))[:, None]
        origin = np.tile([piece.origin for piece in pieces], (count, 1))
        sign = np.tile(_signs(pieces), count)[:, None]
        return origin * size, np.tile(sign * size, (1, 2))
    below = np.append(half, 0.0)
    size = np.stack([np.ones(count + 1), np.append(half, np.ldexp(1.0, -count))], axis=1)
    return np.stack([np.zeros(count + 1), below], axis=1), size


def _signs(children: Sequence[Child]) -> Array:
    """-1 for those that are turned by half a turn, else 1, (n,)."""
    return np.where([child.turned for child in children], -1, 1)


def placed(
    lattice: Lattice, cover: Cover, group: Group, origin: Array, size: Array
) -> tuple[Array, Array]:
    """Origins and signed sizes (P, c, 2) in limit faces of cells (c, 2) in (s, t) of patches."""
    shape = len(group.members), *origin.shape
    origin, size = (np.broadcast_to(x, shape) for x in (origin, size))
    origin, size = bernstein.turned_cells(lattice, origin, size, group.turn)
    if not cover.level.any():
        return origin, size
    here = group.members
    down, sign = -cover.level[here][:, None, None], cover.sign[here][:, None, None]
    origin = np.ldexp(cover.place[here][:, None] + sign * origin, down)
    return origin, np.ldexp(sign * size, down)
