"""Boundary edges in the order in which one walks along them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from limitsurf.cage.faces import IntArray

if TYPE_CHECKING:
    from limitsurf.cage.connectivity import Connectivity


def boundary_chains(cage: Connectivity) -> tuple[IntArray, ...]:
    """Vertices along the boundary, one array a chain; see `Mesh.boundary_chains`.

    Half-edges without a twin are a permutation: each ends at an open fan, of which one other
    begins. Its cycles, ranked by pointer doubling, fall apart where an edge is not manifold.
    """
    rim = np.flatnonzero(cage.twin < 0)
    if not len(rim):
        return ()
    fans = cage.fans
    number = np.empty(cage.n_corners, np.int64)
    number[rim] = np.arange(len(rim))
    following = number[fans.corners[fans.offsets[fans.fan[cage.next_corner[rim]]]]]
    least, after, rank = np.arange(len(rim)), following, np.arange(len(rim))
    steps = len(rim).bit_length()
    for _ in range(steps):
        least, after = np.minimum(least, least[after]), after[after]
    preceding = np.empty_like(following)
    preceding[following] = np.arange(len(rim))
    # start open chains behind what is not manifold, closed ones at their first half-edge
    inner = cage.boundary_edge[cage.corner_edge[rim]]
    starts = inner & ~inner[preceding]
    broken = np.zeros(len(rim), dtype=bool)
    broken[least[starts]] = True
    starts |= (least == np.arange(len(rim))) & inner & ~broken
    back = np.where(starts, np.arange(len(rim)), preceding)
    rank = (back != np.arange(len(rim))).astype(np.int64)
    for _ in range(steps):
        rank, back = rank + rank[back], back[back]
    order = np.lexsort((rank, back))
    order = order[inner[order]]
    vertices = cage.indices[rim[order]]
    cut = np.flatnonzero(np.diff(back[order])) + 1
    last = order[np.append(cut, len(order)) - 1]
    ends = cage.indices[cage.next_corner[rim[last]]]
    found = np.split(vertices, cut)
    return tuple(np.append(chain, end) for chain, end in zip(found, ends, strict=True))
