"""The most lines of which none cross: independent sets of graphs that are mostly bipartite."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import (
    breadth_first_order,
    connected_components,
    maximum_bipartite_matching,
)

Array = NDArray[Any]


def independent(place: Array, line: Array, wanted: Array) -> Array:
    """As many of some lines as share no place with each other, (n,) bool.

    Lines of two directions cross each other only, so that by Koenig's theorem the most of them are
    what a largest matching of crossings leaves. Where lines come around to cross one of their own
    direction, or themselves, the shortest are taken first, which may be fewer.

    Parameters
    ----------
    place, line : (k,) int
        Places, and the lines that pass them.
    wanted : (n,) bool
        The lines that are to choose from.

    Notes
    -----
    H. Imai, T. Asano, "Efficient algorithms for geometric graph search problems", SIAM Journal on
    Computing 15 (1986), and W. Lipski and others, "On two-dimensional data organization II",
    Fundamenta Informaticae 2 (1979), for rectilinear polygons;
    ``derivations/spline_faces.py``.
    """
    n = len(wanted)
    one, other = _crossings(place, line)
    odd = np.zeros(n, dtype=bool)
    odd[one[one == other]] = True  # lines that cross themselves are taken last
    pairs = np.stack([one, other])[:, (one != other) & ~odd[one] & ~odd[other]]
    colour, even = _colours(n, pairs)
    good = wanted & even & ~odd
    found = _most(n, pairs[:, good[pairs[0]]], colour, good)
    hit = np.zeros(n, dtype=bool)
    for a, b in ((one, other), (other, one)):
        hit[b[found[a]]] = True
    size = np.bincount(line, minlength=n)
    return found | _shortest(n, one, other, wanted & ~found & ~hit, size)


def _crossings(place: Array, line: Array) -> tuple[Array, Array]:
    """Pairs of lines that share a place; a line that passes one twice crosses itself."""
    order = np.lexsort([line, place])
    place, line = place[order], line[order]
    pairs, step = [np.zeros((2, 0), dtype=np.int64)], 1
    while True:
        here = np.flatnonzero(place[step:] == place[:-step]) if step < len(place) else place[:0]
        if not len(here):
            break
        pairs.append(np.stack([line[here], line[here + step]]))
        step += 1
    one, other = np.unique(np.concatenate(pairs, axis=1), axis=1)
    return one, other


def _colours(n: int, pairs: Array) -> tuple[Array, Array]:
    """Colours (n,) of which crossing lines have different ones, and whether there are such."""
    one, other = pairs
    rows, columns = np.concatenate([one, one + n]), np.concatenate([other + n, other])
    graph = coo_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(2 * n, 2 * n))
    label = connected_components(graph, directed=False)[1].reshape(2, n)
    return label[0] > label[1], label[0] != label[1]


def _most(n: int, pairs: Array, colour: Array, good: Array) -> Array:
    """A largest independent set of those that are good, whose crossings have two colours."""
    turned = np.where(colour[pairs[0]], pairs[::-1], pairs)
    if not turned.shape[1]:
        return good
    data = np.ones(turned.shape[1], dtype=np.int8)
    graph = csr_array((data, (turned[0], turned[1])), shape=(n, n))
    match = maximum_bipartite_matching(graph, perm_type="column")  # of each row
    left, right = good & ~colour, good & colour
    source = np.flatnonzero(left & (match < 0))
    paired = np.flatnonzero(match >= 0)
    # ways from lines without a partner: to those they cross, and from these to their partners
    rows = np.concatenate([turned[0], n + match[paired], np.full(len(source), 2 * n)])
    columns = np.concatenate([n + turned[1], paired, source])
    ways = csr_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=[2 * n + 1] * 2)
    reached = np.zeros(2 * n + 1, dtype=bool)
    reached[breadth_first_order(ways, 2 * n, return_predecessors=False)] = True
    return np.asarray((left & reached[:n]) | (right & ~reached[n : 2 * n]))


def _shortest(n: int, one: Array, other: Array, wanted: Array, size: Array) -> Array:
    """Of lines that are wanted, those that cross none that is shorter and taken."""
    rank = np.empty(n, dtype=np.int64)
    rank[np.lexsort([np.arange(n), size])] = np.arange(n)
    found, pending = np.zeros(n, dtype=bool), wanted.copy()
    apart = one != other
    one, other = one[apart], other[apart]
    while pending.any():
        both = pending[one] & pending[other]
        beaten = np.zeros(n, dtype=bool)
        beaten[np.where(rank[one] > rank[other], one, other)[both]] = True
        chosen = pending & ~beaten
        found |= chosen
        pending &= ~chosen
        for a, b in ((one, other), (other, one)):
            pending[b[chosen[a]]] = False
    return found
