"""Sharp edges of clouds of points: places on them, from planes on both sides."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_AROUND = 16  # neighbours
# between normals of neighbours, given and estimated, from which on an edge is between
_TURN, _TURN_GUESSED = np.cos(np.deg2rad([30, 45]))
_LIKE = np.cos(np.deg2rad(15))  # of normals on one side
_LEAST = 3  # neighbours on either side


def crease_points(points: Array, normals: Array | None) -> Array:
    """Places (m, 3) on sharp edges of a cloud of points (n, 3), one for each point next to one.

    A point is next to an edge if normals of its nearest neighbours are 30 degrees apart from its
    own, or more; 45 where they are estimated. From there it goes straight to the line in which the
    mean planes of the neighbours on both sides meet. Normals are lines: signs do not matter, so
    that both sides of thin walls are no edge. Without normals they are those of planes through
    neighbours, of the flattest neighbourhood that a point is in.

    Parameters
    ----------
    points : (n, 3)
        Finite ones, of about unit size.
    normals : (n, 3) or None
        Rows of zeros say nothing.
    """
    from scipy.spatial import cKDTree

    k = min(_AROUND + 1, len(points))
    if k < 2 * _LEAST + 1:
        return np.zeros((0, 3))
    turn = _TURN_GUESSED if normals is None else _TURN
    far, near = cKDTree(points).query(points, k=k)
    if normals is None:
        own = _flattest(points, near)
    else:
        size = np.sqrt((normals**2).sum(axis=1, keepdims=True))
        own = normals / np.where(size > 0, size, 1)
    around = own[near]
    known = (around**2).sum(axis=2) > 0.5
    likeness = np.where(known, np.abs(np.einsum("nkd,nd->nk", around, own)), 1.0)
    other = likeness.argmin(axis=1)
    which = np.flatnonzero(known[:, 0] & (likeness.min(axis=1) < turn))
    if not len(which):
        return np.zeros((0, 3))
    around, known, start = around[which], known[which], points[which]
    ways = np.stack([own[which], around[np.arange(len(which)), other[which]]])
    signed = np.einsum("nkd,snd->snk", around, ways)
    side = (np.abs(signed) > _LIKE) & known
    share = side / np.maximum(side.sum(axis=2, keepdims=True), 1)
    ways = np.einsum("snk,nkd->snd", share * np.sign(signed), around)
    ways /= np.maximum(np.sqrt((ways**2).sum(axis=2, keepdims=True)), 1e-300)
    centre = np.einsum("snk,nkd->snd", share, points[near[which]] - start[:, None])
    height = (centre * ways).sum(axis=2)
    cosine = (ways[0] * ways[1]).sum(axis=1)
    with np.errstate(all="ignore"):
        a = (height[0] - cosine * height[1]) / (1 - cosine**2)
        b = (height[1] - cosine * height[0]) / (1 - cosine**2)
        move = a[:, None] * ways[0] + b[:, None] * ways[1]
        keep = np.sqrt((move**2).sum(axis=1)) <= far[which, -1]
    keep &= (side.sum(axis=2) >= _LEAST).all(axis=0)
    return np.asarray((start + move)[keep])


def _flattest(points: Array, near: Array) -> Array:
    """Unit normals (n, 3) of planes through neighbours (n, k): of the flattest, of all of these."""
    around = points[near] - points[near].mean(axis=1, keepdims=True)
    values, ways = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))
    rough = values[:, 0] / np.maximum(values[:, 2], 1e-300)
    best = rough[near].argmin(axis=1)
    return np.asarray(ways[near[np.arange(len(near)), best], :, 0])
