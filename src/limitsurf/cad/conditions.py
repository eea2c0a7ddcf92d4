"""Conditions on a cage at one level of refinement, and cages that meet them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.caching import cached_property
from limitsurf.cad import solving
from limitsurf.cad.fairing import SPRING, centred, sprung
from limitsurf.cad.fairness import Energy, fairness
from limitsurf.cad.interpolation import Wanted
from limitsurf.cad.rows import Level

Array = NDArray[Any]

MISSED = 1e-9  # of the size: what conditions that depend on others may be missed by


class Conditions:
    """What is wanted of a cage, as rows over its vertices, or over their coordinates in turn.

    Attributes
    ----------
    level : Level
    coupled : bool
        Whether rows are over coordinates, as those of normals are.
    condition : float
        Set by `solved`.
    rank : int
        Set by `solved`.
    """

    def __init__(self, asked: Wanted, level: Level, energy: Energy | None) -> None:
        self.asked, self.level, self.energy = asked, level, energy
        self.turned = np.flatnonzero(~np.isnan(asked.normals[:, 0]))
        self.coupled = len(self.turned) > 0
        cage = asked.level.mesh.points
        flat, self.centre = centred(cage)
        self.start = flat if level.operator is None else level.operator @ flat
        fixed = np.zeros(len(self.start), dtype=bool)
        if level.operator is not None:  # of what depends on fixed vertices alone
            fixed[:] = (abs(level.operator) @ (~asked.fixed).astype(float)) == 0
        fixed[: len(asked.fixed)] |= asked.fixed
        self.width = 3 if self.coupled else 1
        self._fixed = np.repeat(fixed, self.width)
        self.condition, self.rank = 1.0, 0

    def finer(self) -> Conditions:
        """The same conditions on a cage that is refined once more."""
        return Conditions(self.asked, self.level.finer(), self.energy)

    @property
    def count(self) -> int:
        """How many rows there are."""
        return int(self.rows[0].shape[0])

    @cached_property
    def limits(self) -> Any:
        """Rows (m, n) onto the limits at all places."""
        return self.level.limits()

    @cached_property
    def tangents(self) -> Any:
        """Rows (2 k, n) onto tangents at the places that have a normal, all first ones first."""
        rows, known = self.level.chosen(self.turned).tangents()
        bad = self.turned[~known]
        if len(bad):
            raise ValueError(
                f"no limit normal exists at {self.asked.named(int(bad[0]))} (and at "
                f"{len(bad) - 1} more): leave theirs NaN"
            )
        return rows

    def _chosen(self, which: Array) -> tuple[Any, Array]:
        """Rows of some points, then of their normals, and what these are to be."""
        from scipy.sparse import csr_array, eye_array, kron, vstack

        asked, rows = self.asked, self.limits[which]
        targets = asked.points[which] - self.centre
        if not self.coupled:
            return rows, targets
        rows = kron(rows, eye_array(3), format="csr")
        here = np.isin(self.turned, which)
        place = np.flatnonzero(np.tile(here, 2))
        normals = np.tile(asked.normals[self.turned], (2, 1))[place]
        found = self.tangents[place]
        own = np.repeat(normals, np.diff(found.indptr), axis=0)
        columns = 3 * found.indices[:, None].astype(np.int64) + np.arange(3)
        shape = len(place), rows.shape[1]
        more = csr_array(
            ((found.data[:, None] * own).ravel(), columns.ravel(), 3 * found.indptr), shape=shape
        )
        zeros = np.zeros((len(place), 1))
        return vstack([rows, more], format="csr"), np.concatenate([targets.reshape(-1, 1), zeros])

    @cached_property
    def rows(self) -> tuple[Any, Array]:
        """Of what is to be met, over all unknowns, and what they are to be."""
        return self._chosen(self.asked.conditions)

    @cached_property
    def _free(self) -> tuple[Any, Array]:
        """The same over those that are free."""
        rows, targets = self.rows
        if not self._fixed.any():
            return rows, targets
        flat = self.start.reshape(len(self._fixed), -1)
        known = rows[:, self._fixed] @ flat[self._fixed]
        return rows[:, ~self._fixed], targets - known

    def solved(self) -> Array | None:
        """The points (n, d) of the cage; None where conditions depend on each other, or nearly."""
        rows, targets = self._free
        m, n = rows.shape
        self.rank = m
        direct = None
        if m == n and self.asked.hard.all():
            direct, self.condition = solving.square(rows)
        else:
            self.condition = solving.condition(rows)
        if not self.condition <= solving.SINGULAR:
            self.rank = solving.rank(rows)
            if self.rank < n or m == n:
                return None
            # more than enough, which one cage may meet all the same
            self.condition = solving.condition(rows.T.tocsr())
            found = self.fairest()
            return found if self.missed(found)[1] <= MISSED * self.asked.size else None
        return self._whole(direct(targets)) if direct is not None else self.fairest()

    def fairest(self) -> Array:
        """The points (n, d) of the fairest cage that meets the conditions, or nearly does.

        Where this leaves a choice, the one that moves least.
        """
        from scipy.sparse import diags_array, eye_array, kron

        form = fairness(self.level.surface, self.energy)
        if self.coupled:
            form = kron(form, eye_array(3), format="csr")
        flat = self.start.reshape(len(self._fixed), -1)
        load = np.zeros_like(flat)
        soft = np.flatnonzero(~self.asked.hard)
        if len(soft):
            near, targets = self._chosen(soft)
            weights = np.repeat(self.asked.weights[soft], self.width)
            if self.coupled:
                own = self.turned[np.isin(self.turned, soft)]
                weights = np.concatenate([weights, np.tile(self.asked.weights[own], 2)])
            across = near.T @ diags_array(weights)
            form, load = form + across @ near, across @ targets
        total, scale = sprung(form, np.zeros(len(flat)))
        load = scale * load + SPRING * flat
        fixed, free = self._fixed, ~self._fixed
        if fixed.any():
            load = load[free] - total[free][:, fixed] @ flat[fixed]
            total = total[free][:, free]
        return self._whole(solving.minimum(total, load, *self._free))

    def _whole(self, found: Array) -> Array:
        """Points with those that are fixed."""
        total = np.array(self.start.reshape(len(self._fixed), -1))
        total[~self._fixed] = found
        return total.reshape(self.start.shape)

    def placed(self, found: Array) -> Array:
        """Points (n, d) as those of the cage are; fixed ones to the last digit."""
        points = self.level.mesh.points
        fixed = self._fixed.reshape(len(found), -1)[:, :1]
        total = np.where(fixed, points.reshape(found.shape), found + self.centre)
        return total.reshape(points.shape)

    def reason(self) -> str:
        """Why conditions are not met as they are."""
        rows, _ = self._free
        m, n = rows.shape
        return (
            f"{m} conditions on {n} unknowns depend on each other (rank {self.rank}, condition "
            f"{self.condition:.2g})"
        )

    def missed(self, found: Array) -> tuple[int, float]:
        """The row that is missed most by points (n, d), and by how much."""
        rows, targets = self.rows
        away = np.abs(rows @ found.reshape(len(self._fixed), -1) - targets).max(axis=1)
        worst = int(np.argmax(away))
        return worst, float(away[worst])

    def refuse_missed(self, found: Array, reason: str) -> None:
        """Refuse a cage that does not meet its conditions."""
        worst, missed = self.missed(found)
        if missed <= MISSED * self.asked.size:
            return
        which = self.asked.conditions
        points = len(which) * self.width
        if worst < points:
            place = which[worst // self.width]
        else:
            own = self.turned[np.isin(self.turned, which)]
            place = own[(worst - points) % len(own)]
        raise ValueError(
            f"{reason} and contradict each other: the limit misses what is asked at "
            f"{self.asked.named(int(place))} by {missed:.3g}; leave points out, give finite "
            "weights, or refine more"
        )

    def errors(self, found: Array) -> tuple[Array, Array]:
        """Distances of limits from points, and angles to normals, (m,) each."""
        asked = self.asked
        away = _lengths(self.limits @ found - (asked.points - self.centre))
        angles = np.full(len(away), np.nan)
        if self.coupled:
            tangents = self.tangents @ found
            largest = np.abs(tangents).max(axis=1, keepdims=True)
            first, second = np.split(tangents / np.where(largest > 0, largest, 1), 2)
            cross, normal = np.cross(first, second), asked.normals[self.turned]
            size = np.linalg.norm(cross, axis=1)
            across = np.linalg.norm(np.cross(cross, normal), axis=1)
            angle = np.arctan2(across, (cross * normal).sum(axis=1))
            angles[self.turned] = np.where(size > 0, angle, np.nan)
        return away, angles


def _lengths(vectors: Array) -> Array:
    """Lengths (m,) of vectors (m, d), of any size."""
    largest = np.abs(vectors).max(axis=1, initial=0)
    scaled = vectors / np.where(largest > 0, largest, 1)[:, None]
    return np.asarray(largest * np.sqrt((scaled**2).sum(axis=1)))
