"""Chains of the sharp edges of a surface: its boundaries and creases as curves."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from limitsurf.cad.feet import SharpEdges
from limitsurf.surface import LimitSurface

Array = NDArray[Any]
Kind = Literal["boundary", "crease"]


class Chains:
    """Boundaries of a surface, then its infinitely sharp creases, as curves.

    Curves end where one side, or more than two, of the same kind end.

    Attributes
    ----------
    offsets : (n + 1,) int64
        Sides of curve k are those from ``offsets[k]`` to ``offsets[k + 1]``, exclusive.
    closed : (n,) bool
    """

    def __init__(self, surface: LimitSurface, kind: Kind | None) -> None:
        self._surface, self._edges = surface, SharpEdges(surface)
        edges = self._edges
        wanted = {None: 3, "boundary": 1, "crease": 2}[kind]
        which = edges.of_kind(wanted)
        which = which[np.argsort(~edges.on_boundary[which], kind="stable")]
        # (a boundary and a crease that meet go on by themselves)
        crease = ~edges.on_boundary[which, None]
        node = np.unique(2 * edges.nodes[which] + crease, return_inverse=True)[1].reshape(-1, 2)
        passed = np.bincount(node.ravel())[node] == 2
        order, first = _in_order(node, passed)
        node, passed = node[order], passed[order]
        # what a side shares with the one before it, which two sides may share twice
        before, through = np.roll(node, 1, axis=0), np.roll(passed, 1, axis=0)
        ends_there = through[:, 1] & (before[:, 1:] == node).any(axis=1)
        joint = np.where(ends_there, before[:, 1], before[:, 0])
        turned = node[:, 0] != joint
        self.offsets = np.append(np.flatnonzero(first), len(order))
        start, last = self.offsets[:-1], self.offsets[1:] - 1
        following = np.minimum(start + 1, last)
        turned[start] = (start < last) & (node[start, 1] != joint[following])
        self._which, self._turned = which[order], turned
        at = turned.astype(np.int64)
        self.closed = node[start, at[start]] == node[last, 1 - at[last]]

    def __len__(self) -> int:
        return len(self.closed)

    def points(self, curve: int, each: int) -> Array:
        """So many points along each side of a curve, and its end."""
        here = slice(self.offsets[curve], self.offsets[curve + 1])
        t = np.arange(each) / each
        at = np.where(self._turned[here, None], 1 - t, t)
        which = np.repeat(self._which[here], each)
        which, at = np.append(which, which[-1]), np.append(at, 1.0 - self._turned[here][-1])
        places = self._edges.places(which, at)
        found = self._surface.evaluate(places.face, places.u, places.v)
        if self.closed[curve]:
            found[-1] = found[0]
        return np.asarray(found)


def _in_order(node: Array, passed: Array) -> tuple[Array, Array]:
    """Sides (k,) in the order of chains, and whether each is the first of its chain.

    `node` (k, 2) is where they begin and end, `passed` (k, 2) whether just two do so there.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components, depth_first_order

    count = len(node)
    side = np.repeat(np.arange(count), 2)[passed.ravel()]
    pairs = side[np.argsort(node[passed], kind="stable")].reshape(-1, 2)
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, label = connected_components(links, directed=False)
    # begin with a side that ends a chain, where there is one
    preferred = np.lexsort([np.arange(count), passed.all(axis=1), label])
    starts = preferred[np.unique(label[preferred], return_index=True)[1]]
    # one more node, from which all chains are visited in one go
    i = np.concatenate([pairs[:, 0], pairs[:, 1], np.full(len(starts), count)])
    j = np.concatenate([pairs[:, 1], pairs[:, 0], starts])
    graph = coo_array((np.ones(len(i)), (i, j)), shape=(count + 1, count + 1)).tocsr()
    order = depth_first_order(graph, count, return_predecessors=False)[1:]
    chain = label[order]
    rank = np.empty(len(starts), dtype=np.int64)
    rank[np.argsort(starts)] = np.arange(len(starts))
    order = order[np.argsort(rank[chain], kind="stable")]
    return order, np.diff(label[order], prepend=-1) != 0
