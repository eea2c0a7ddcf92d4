"""Control points of all patches, made from those of the cage; what rounding did to them."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels import reference as kernels
from limitsurf.caching import cached_property
from limitsurf.patches import PatchTable, SharedRings
from limitsurf.rings import RingValues

if TYPE_CHECKING:
    from limitsurf.tables import RingMasks

Array = NDArray[Any]


class Values:
    """Control points from the points of the cage, float64 (n_vertices, d).

    The points are multiplied by 2 ** `balance` before anything is added up.
    """

    def __init__(self, patches: PatchTable, points: Array) -> None:
        self._patches = patches
        self.balance = kernels.balance(points)
        self._points = np.ldexp(points, self.balance) if self.balance else points
        self.channels = points.shape[1]
        self._rings: dict[SharedRings, RingValues] = {}

    def around(self, masks: RingMasks, shared: SharedRings, outer: Array) -> RingValues:
        """Values around the shared rings of a kind of patches with these outer control points."""
        if shared not in self._rings:
            found = RingValues(masks, shared, outer, *self.control_points)
            self._rings.setdefault(shared, found)
        return self._rings[shared]

    @cached_property
    def control_points(self) -> tuple[Array, Array]:
        """All control points as unevaluated sums high + low, both (n_points, d).

        Those of deep patches are close to each other, and their differences have all digits.
        """
        patches, done = self._patches, len(self._points)
        high, low = np.zeros((2, patches.n_points, self._points.shape[1]))
        high[:done] = self._points
        for operator in patches.extras:
            first = operator.indices[operator.indptr[:-1]]
            rows = operator.indptr, operator.indices, operator.data
            step = kernels.differences(*rows, high, low, first)
            new = slice(done, done + operator.shape[0])
            high[new], error = kernels.two_sum(high[first], step)
            low[new] = low[first] + error
            done = new.stop
        return high, low

    @cached_property
    def errors(self) -> Array:
        """Bounds (n_points, d) of what rounding did to control points, in units of `NOISE`."""
        return kernels.errors(self._patches.extras, *self.control_points)

    def differences(self, ids: Array, base: int) -> tuple[Array, Array, Array]:
        """A control point of each patch, high and low (P, d), and all relative to it (P, K, d)."""
        (high, low), first = self.control_points, ids[:, base]
        origin = high[first]
        points = np.take(high, ids, axis=0, mode="clip")  # (not to be checked: faster)
        flat = points.reshape(len(ids), -1)
        # (arrays whose last axis is long are fast)
        flat -= np.take(origin, repeated(*ids.shape[1:], origin.shape[1]), axis=1, mode="clip")
        if self._patches.extras:
            extra = (ids >= len(self._points)).any(axis=1)
            points[extra] += low[ids[extra]] - low[first[extra], None]
        return origin, low[first], points

    def sizes(self, points: Array, ids: Array) -> Array:
        """Sizes (P, K) of control points `ids` relative to one of them, their errors included."""
        return np.asarray((np.abs(points) + self.errors[ids]).max(axis=2, initial=0))


def exact_control_points(patches: PatchTable, points: Array) -> Array:
    """All control points in Fractions (n_points, d), from those of the cage."""
    for operator in patches.extras:
        points = np.concatenate([points, operator @ points])
    return points


@lru_cache(maxsize=256)
def repeated(n: int, d: int) -> Array:
    """Places of the values of d columns, n times: (n d,)."""
    return np.tile(np.arange(d), n)
