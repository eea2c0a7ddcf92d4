"""Which patches cover limit faces, and where: the tree of splits walked down, all faces at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.patches import REGULAR, STRIP, PatchTable
from limitsurf.pieces import bernstein
from limitsurf.tables import StripTables

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
        Halvings from limit face to patch.
    place : (P, 2) int64
        Number of the patch along u and along v, in its own size.
    """

    owner: Array
    patch: Array
    level: Array
    place: Array

    @classmethod
    def of(cls, patches: PatchTable, faces: Array) -> Cover:
        """The patches of some limit faces; those without a limit have none."""
        owner, code = np.arange(len(faces)), patches.codes[faces]
        if (code >= 0).all():  # as most are in most cages
            none = np.zeros((len(faces), 2), dtype=np.int64)
            return cls(owner, code, none[:, 0], none)
        place, level, found = np.zeros((len(faces), 2), dtype=np.int64), 0, []
        quadrants = np.array([(0, 0), (1, 0), (0, 1), (1, 1)])
        while True:
            done = code >= 0
            found.append((owner[done], code[done], np.full(int(done.sum()), level), place[done]))
            split = code <= -2
            if not split.any():
                break
            first = patches.n_limit_faces + bernstein.CORNERS * (-2 - code[split].astype(np.int64))
            code = patches.codes[(first[:, None] + np.arange(len(quadrants))).ravel()]
            owner = np.repeat(owner[split], len(quadrants))
            place = (2 * place[split][:, None] + quadrants).reshape(-1, 2)
            level += 1
        owner, patch, depth, place = (np.concatenate(x) for x in zip(*found, strict=True))
        if level:
            u, v = np.ldexp(place, -depth[:, None]).T
            order = np.lexsort((u, v, owner))
            owner, patch, depth, place = (x[order] for x in (owner, patch, depth, place))
        return cls(owner, patch, depth, place)


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
        Their cells in (s, t).
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
    kind, row = patches.kind[cover.patch], patches.row[cover.patch]
    turn = patches.turn[cover.patch].astype(np.int64)
    count = np.where(kind > STRIP, rings, 0)
    across = np.flatnonzero(kind == STRIP)
    count[across] = strips.depth[which[row[across]]]
    n_cells = np.where(kind > STRIP, len(bernstein.PIECES) * count, 1 + count)
    end = np.cumsum(n_cells)
    first = end - n_cells
    groups = []
    for one in np.flatnonzero(np.bincount(kind)).tolist():
        alike = np.flatnonzero(kind == one)
        for n in np.flatnonzero(np.bincount(count[alike])).tolist():
            here = alike[count[alike] == n]
            groups.append(Group(one, here, row[here], turn[here], n, *_cells(one, n), first[here]))
    return int(end[-1]) if len(end) else 0, groups


def _cells(kind: int, count: int) -> tuple[Array, Array]:
    """Origins and sizes (c, 2) of the cells of a patch, in (s, t)."""
    if kind == REGULAR:
        return np.zeros((1, 2)), np.ones((1, 2))
    half = np.ldexp(1.0, -np.arange(1, count + 1))  # of each ring, or upper half
    if kind > STRIP:
        size = np.repeat(half, len(bernstein.PIECES))[:, None]
        return np.tile(bernstein.PIECES, (count, 1)) * size, np.tile(size, (1, 2))
    below = np.append(half, 0.0)
    size = np.stack([np.ones(count + 1), np.append(half, np.ldexp(1.0, -count))], axis=1)
    return np.stack([np.zeros(count + 1), below], axis=1), size


def placed(cover: Cover, group: Group, origin: Array, size: Array) -> tuple[Array, Array]:
    """Origins and sizes (P, c, 2) in limit faces of rectangles (c, 2) in (s, t) of patches."""
    shape = len(group.members), len(origin)
    turn = np.broadcast_to(group.turn[:, None], shape)
    origin, size = (np.broadcast_to(x, (*shape, 2)) for x in (origin, size))
    origin, size = bernstein.turned_squares(origin, size, turn)
    if not cover.level.any():
        return origin, size
    down = -cover.level[group.members][:, None, None]
    origin = np.ldexp(cover.place[group.members][:, None] + origin, down)
    return origin, np.ldexp(size, down)
