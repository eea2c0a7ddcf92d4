"""Fast twins of the functions in ``neighbourhood.py``, for faces of four corners.

Control points of a face and around it have the index ``4 j + i``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.connectivity import read_only
from limitsurf.cage.mesh import Mesh
from limitsurf.scheme.lattice import Lattice

Array = NDArray[Any]


def fit(lattice: Lattice) -> bool:
    """Whether these functions are for that lattice."""
    return lattice.corners == ((0, 0), (1, 0), (1, 1), (0, 1))


def child_at(u: Array, v: Array) -> tuple[Array, Array, Array]:
    """Quarters ``i + 2 j`` that hold (u, v), of two the lower one, and the place in them, (Q,)."""
    i, j = u * 2 > 1, v * 2 > 1
    return i + 2 * j, u * 2 - i.astype(np.int64), v * 2 - j.astype(np.int64)


def templates(mesh: Mesh, twin: Array, numbers: Array, first: Array, start: Array) -> Array:
    """Control points of faces and around them, (n, 16), -1 where there are none.

    From the corner ``first + start`` on; `numbers` (n_corners,) are the control points of corners,
    `twin` (n_corners,) joins faces.
    """
    if mesh.connectivity.compiled:
        from limitsurf._kernels import connectivity

        return connectivity.grids(
            *read_only((numbers, mesh.connectivity.steps, twin, first, start))
        )
    corners = first[:, None] + (start[:, None] + np.arange(4)) % 4
    after, before = mesh.next_corner, mesh.previous_corner
    other = twin[corners]
    leaving = after[other]
    last = twin[leaving]
    grid = np.empty((len(first), 16), dtype=np.int32)
    grid[:, _OWN] = numbers[corners]
    grid[:, _ACROSS] = np.where(other < 0, -1, numbers[after[leaving]])
    grid[:, _BESIDE] = np.where(other < 0, -1, numbers[before[other]])
    grid[:, _BEYOND] = np.where((other < 0) | (last < 0), -1, numbers[before[last]])
    return grid


def reflections(
    grid: Array, twin: Array, first: Array, start: Array
) -> tuple[Array, Array, Array, Array]:
    """What lies beyond sharp sides, as combinations of what does not.

    Returns
    -------
    face, place : (m,) int
        Rows and columns of `grid`.
    columns, weights : (m, 4) int
        Control points and their weights, of which some are 0.
    """
    sides = first[:, None] + (start[:, None] + np.arange(4)) % 4
    rim = twin[sides] < 0  # (P, 4): side k, from corner k to k + 1, is on the boundary
    left, right = np.roll(rim, 1, axis=1), np.roll(rim, -1, axis=1)
    cases = [rim, rim, rim & ~left, rim & ~right, rim & left]
    face, case = np.nonzero(np.concatenate(cases, axis=1))
    return face, _TARGET[case], grid[face[:, None], _FROM[case]], _WEIGHTS[case]


# grid positions 4 j + i by side of the face: its corner, the points across it beside its two
# corners, that diagonally beyond its corner
_OWN = np.array([5, 6, 10, 9])
_ACROSS = np.array([1, 7, 14, 8])
_BESIDE = np.array([2, 11, 13, 4])
_BEYOND = np.array([0, 3, 15, 12])

# reflections at sides k on the boundary: both points across it, those beyond its first and its
# second corner where the next side there is not on the boundary, that beyond both; (20,), (20, 4)
_LEFT, _RIGHT, _FAR = (np.arange(4) + 3) % 4, (np.arange(4) + 1) % 4, (np.arange(4) + 2) % 4
_TARGET = np.concatenate([_ACROSS, _BESIDE, _BEYOND, _BEYOND[_RIGHT], _BEYOND])
_FROM = np.concatenate(
    [
        np.stack(terms, axis=1)
        for terms in (
            (_OWN, _OWN[_LEFT], _OWN, _OWN),
            (_OWN[_RIGHT], _OWN[_FAR], _OWN, _OWN),
            (_BESIDE[_LEFT], _ACROSS[_LEFT], _OWN, _OWN),
            (_ACROSS[_RIGHT], _BESIDE[_RIGHT], _OWN, _OWN),
            (_OWN, _OWN[_LEFT], _OWN[_RIGHT], _OWN[_FAR]),
        )
    ]
)
_WEIGHTS = np.repeat([[2, -1, 0, 0]] * 4 + [[4, -2, -2, 1]], 4, axis=0)
