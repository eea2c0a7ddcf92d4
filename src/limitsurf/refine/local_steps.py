"""Steps on differences of points around a triangle, and what they tend to at its corners.

What surrounds a triangle is given as differences ``z`` from its corner 0, with the corners first:
``z[0]`` and ``z[1]`` are the sides along u and v. Where the points are part of a lattice whose
straight lines are kept, the rest is what they are off the plane of the triangle: that falls like
4^-n, up to powers of n, while sides fall like 2^-n, and derivatives are found without cancellation.
Differences are doubled with each step. Derived in ``derivations/butterfly.py``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels import reference as kernels
from limitsurf.cage.mesh import Mesh
from limitsurf.numbers import FLOAT64, NumberType
from limitsurf.refine.neighbourhoods import Kinds
from limitsurf.rules import Rules

Array = NDArray[Any]

# eigenvalues that differ by less are taken for equal: those of long Jordan chains are found to
# fewer digits, and none of those that decide are closer
_APART = 1e-4
_CHUNK = 1 << 14  # vertices that are looked at at once
_ENOUGH = 64  # steps after which the kind of what is at a corner has settled


@dataclass(frozen=True)
class CornerRows:
    """What differences around a triangle say of the limit at one of its corners.

    Attributes
    ----------
    derivatives : (2, n)
        Rows of the derivatives in u and v; 0 where they vanish towards the vertex, NaN where there
        is no limit.
    tangents : (2, n)
        Rows of their directions; NaN where there is none.
    normal : (2, n)
        Rows of vectors whose cross product is a normal; NaN where there is none.
    """

    derivatives: Array
    tangents: Array
    normal: Array


class LocalSteps:
    """Steps by kinds of neighbourhoods, in one type of numbers."""

    def __init__(self, kinds: Kinds) -> None:
        self.kinds, self.number = kinds, kinds.number
        self._steps: dict[tuple[int, int], tuple[Array, Array]] = {}
        self.operations: Any = None  # what is made of several of them, see the engine
        self._corners: dict[tuple[int, int], CornerRows] = {}

    def size(self, kinds: Array) -> int:
        """The most differences of some kinds."""
        found = (self.kinds.known[kind].n_points - 1 for kind in np.unique(kinds).tolist())
        return max(found, default=0)

    def child(self, kind: int, c: int) -> int:
        """The kind of a child."""
        return int(self.kinds.expanded(kind).children[c])

    def differences(self, kind: int, back: bool = False) -> Array:
        """``z`` from plain differences from point 0, or `back`: (n_points - 1,) squared."""
        one, number = self.kinds.expanded(kind), self.number
        n = one.n_points - 1
        matrix = number.full((n, n), number.zero)
        matrix[np.arange(n), np.arange(n)] = number.one
        if one.affine and one.places is not None:
            places = number.array(one.places[3:])
            matrix[2:, :2] = places if back else -places
        return matrix

    def step(self, kind: int, c: int) -> tuple[Array, Array]:
        """Row of the corner 0 of a child, and matrix of its doubled differences, over ``z``."""
        found = self._steps.get((kind, c))
        if found is not None:
            return found
        one = self.kinds.expanded(kind)
        points, back = one.steps[c][:, 1:], self.differences(kind, back=True)
        inner = self.kinds.expanded(int(one.children[c]))
        own = self.differences(int(one.children[c]))
        matrix = 2 * own @ ((points[1:] - points[0]) @ back)
        if one.affine and inner.affine:
            matrix[2:, :2] = self.number.zero  # but for rounding it is
        self._steps[kind, c] = found = points[0] @ back, matrix
        return found

    def corner(self, kind: int, k: int) -> CornerRows:
        """What there is at corner k of the triangle."""
        found = self._corners.get((kind, k))
        if found is None:
            path, here = [], kind
            for _ in range(_ENOUGH):
                below = self.child(here, k)
                if below == here:
                    break
                path.append(here)
                here = below
            settled = self._settled(here, k)
            rows = [settled.derivatives, settled.tangents, settled.normal]
            for above in reversed(path):
                matrix = self.step(above, k)[1]
                rows = [row @ matrix for row in rows]
            self._corners[kind, k] = found = CornerRows(*rows)
        return found

    def _settled(self, kind: int, k: int) -> CornerRows:
        """The same of a kind whose child at that corner is of this kind, too."""
        _, matrix = self.step(kind, k)
        n, number = len(matrix), self.number
        if self.kinds.expanded(kind).affine:
            # d = (e, r) with r = e Q + r B: the sum of what each step adds
            Q, B = matrix[:2, 2:], matrix[2:, 2:]
            unit = number.full((2, n), number.zero)
            unit[[0, 1], [0, 1]] = number.one
            one = number.full((n - 2, n - 2), number.zero)
            one[np.arange(n - 2), np.arange(n - 2)] = number.one
            unit[:, 2:] = _solved((one - B).T, Q.T, number.exact).T
            return CornerRows(unit, unit, unit)
        nan = np.full((2, n), np.nan, dtype=number.dtype)
        if number.exact:
            return CornerRows(nan, nan, nan)
        largest = np.abs(np.linalg.eigvals(matrix)).max()
        derivatives = np.zeros((2, n)) if largest < 1 - _APART else nan
        return CornerRows(derivatives, *self._limits(kind, k, matrix))

    def _limits(self, kind: int, k: int, matrix: Array) -> tuple[Array, Array]:
        """Rows of directions, and of a normal, by the two leading eigenvalues."""
        nan = np.full((2, len(matrix)), np.nan)
        values = np.linalg.eigvals(matrix)
        values = values[np.argsort(-np.abs(values))]
        first, second = values[:2].real
        if second <= 0 or (np.abs(values[:2].imag) > _APART).any():
            return nan, nan
        pair = _leading_pair(matrix, values)
        if pair is None:
            return nan, nan
        right, left = pair
        sign = self._orientation(kind, k, right)
        normal = nan if sign == 0 else left * np.array([[1.0], [sign]])
        if second > first * (1 - _APART):
            once = np.abs(left @ matrix @ right - first * np.eye(2)).max() < _APART
            return (right[:2] @ left if once else nan), normal
        # the larger one leads, but where a side has no part in it
        parts = right[:2]
        lead = np.abs(parts[:, 0]) > _APART * np.abs(parts).max()
        tangents = np.where(lead[:, None], parts[:, :1] * left[0], parts[:, 1:] * left[1])
        return tangents, normal

    def _orientation(self, kind: int, k: int, right: Array) -> int:
        """The sign of a normal; 0 if the two functions do not go around the vertex once."""
        faces = self.kinds.known[kind].faces
        points = np.concatenate([np.zeros((1, 2)), self.differences(kind, back=True) @ right])
        row, place = np.nonzero(faces == k)
        a, b = (points[faces[row, (place + j) % 3]] - points[k] for j in (1, 2))
        area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        angles = np.arctan2(area, (a * b).sum(axis=1))
        if not ((area > 0).all() or (area < 0).all()):
            return 0
        return int(np.sign(area[0])) if abs(angles.sum()) < 2 * np.pi + 1e-6 else 0


def _leading_pair(matrix: Array, values: Array) -> tuple[Array, Array] | None:
    """The two vectors that lead after many steps, (n, 2), and their rows (2, n), or None.

    Those of the two largest eigenvalues, the larger one first; where the second heads a Jordan
    chain of two, the end of that chain. `values` are the eigenvalues by decreasing modulus.
    """
    sizes = np.abs(values)
    tied = sizes[2] > sizes[1] * (1 - _APART)
    count = 3 if tied else 2
    if len(sizes) > count and sizes[count] > sizes[count - 1] * (1 - _APART):
        return None
    right, left = _leading(matrix, count), _leading(matrix.T, count).T
    left = np.linalg.solve(left @ right, left)
    if sizes[1] > sizes[0] * (1 - _APART):
        return None if tied else (right, left)
    first, second = values[0].real, values[1:count].real.mean()
    inner, one = left @ matrix @ right, np.eye(count)
    # both of rank 1: what remains of the first alone, and of the second, or of its chain
    step = inner - second * one
    others = step, (inner - first * one) @ (step if tied else one)
    columns, rows = [], []
    for part, factor in zip(others, (1, -1), strict=True):
        u, size, v = np.linalg.svd(part @ step if tied and factor > 0 else part)
        if size[1] > _APART * size[0] or size[0] < _APART:
            return None
        columns.append(factor * u[:, 0])
        rows.append(v[0])
    return right @ np.array(columns).T, np.array(rows) @ left


def _leading(matrix: Array, count: int) -> Array:
    """A basis of what belongs to the largest eigenvalues, (n, count)."""
    from scipy.linalg import schur

    sizes = np.sort(np.abs(np.linalg.eigvals(matrix)))[::-1]
    least = (sizes[count - 1] + sizes[count]) / 2
    _, vectors, _ = schur(matrix, sort=lambda x, y=0.0: np.hypot(x, y) > least)
    return np.asarray(vectors[:, :count])


def _solved(matrix: Array, right: Array, exact: bool) -> Array:
    """The solution of linear equations."""
    if not exact:
        return np.linalg.solve(matrix, right)
    n = len(matrix)
    rows = np.concatenate([matrix, right], axis=1)
    for k in range(n):
        pivot = k + int(np.flatnonzero(rows[k:, k] != 0)[0])
        rows[[k, pivot]] = rows[[pivot, k]]
        rows[k] = rows[k] / rows[k, k]
        for other in np.flatnonzero(rows[:, k] != 0).tolist():
            if other != k:
                rows[other] = rows[other] - rows[other, k] * rows[k]
    return rows[:, n:]


def local_steps(rules: Rules, number: NumberType) -> LocalSteps:
    """Steps under a scheme; no option makes a difference."""
    return _local_steps(Rules(rules.scheme, "edge_and_corner", "uniform", "catmull-clark"), number)


@lru_cache(maxsize=64)
def _local_steps(rules: Rules, number: NumberType) -> LocalSteps:
    return LocalSteps(Kinds(rules, number))


def limit_normals(mesh: Mesh, rules: Rules, points: Array, errors: Array) -> Array:
    """Limit normals by corner, (n_corners, 3), of vertices that stay where they are.

    `errors` (n_vertices,) bound those of the points, in units of `NOISE`.
    """
    steps, fans = local_steps(rules, FLOAT64), mesh.fans
    corner = fans.corners[fans.offsets[:-1]]
    result = np.full((len(corner), 3), np.nan)
    for start in range(0, len(corner), _CHUNK):
        some = corner[start : start + _CHUNK]
        kinds, starts, found = steps.kinds.of(mesh, some)
        for kind in np.unique(kinds).tolist():
            here = np.flatnonzero(kinds == kind)
            rows = steps.corner(kind, 0).normal @ steps.differences(kind)
            ids = found[starts[here][:, None] + np.arange(rows.shape[1] + 1)]
            near = points[ids[:, 1:]] - points[ids[:, :1]]
            vectors = np.einsum("rn,qnd->rqd", rows, near)
            sizes = np.abs(near).max(axis=2) + errors[ids[:, 1:]] + errors[ids[:, :1]]
            noise = kernels.NOISE * (np.abs(rows) @ sizes.T)[:, :, None]
            along, across = vectors
            result[start + here] = kernels.unit_normals(along, across, (noise[0], noise[1]))
    return np.asarray(result[fans.fan])
