"""Volume and moments of the body inside, as sums over polynomial pieces.

By the divergence theorem, with ``w = x . (x_s x x_t)`` for positions x of the surface, a body has
the volume ``sum w / 3``, first moments ``sum x w / 4`` and second ones ``sum x x^T w / 5``. These
are integrals of polynomials over cells, of which there are infinitely many rings at special
corners. Ring n is of the order of ``(a b)^n``, with the two largest eigenvalues a and b after 1, so
that rings end where what remains is far below rounding (``derivations/integrals.py``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.engine.packing import over_chunks
from limitsurf.integrals.cells import Cells, over_rings
from limitsurf.integrals.rules import Rule, moments_rule
from limitsurf.integrals.sums import cross

Array = NDArray[Any]

_AT_ONCE = 1 << 18  # points of rules in memory at once
NEGLIGIBLE = 2.0**-60  # part of the first rings below which no more rings are added


@dataclass
class Moments:
    """Integrals of a body: volume, first moments (3,), second ones (3, 3).

    `size` is the sum of the absolute values that the volume is a sum of, which tells what rounding
    leaves of it.
    """

    volume: Any
    first: Array
    second: Array
    size: Any


def float_moments(cells: Cells, order: int, workers: int) -> Moments:
    """Moments up to an order, about the origin of the cells and in their scale."""
    rule = moments_rule(cells.scheme, 3 + order)
    step = max(_AT_ONCE // len(rule.weights), 1)
    parts: list[Array] = []

    def regular(some: slice) -> Array:
        return np.asarray(_integrals(rule, cells.points[some], order)[0].sum(axis=0))

    def corners(some: slice) -> Array:
        return corner_sums(cells, np.arange(some.start, some.stop), rule, order)

    parts += over_chunks(len(cells.points), workers, regular, step)
    parts += over_chunks(len(cells.beyond), workers, corners, max(step // 4, 1))
    total = np.sum(parts, axis=0) if parts else np.zeros(14)
    return Moments(total[0] / 3, total[1:4] / 4, total[4:13].reshape(3, 3) / 5, total[13] / 3)


def _integrals(rule: Rule, points: Array, order: int) -> tuple[Array, Array]:
    """Integrals (C, 14) over cells: w, x w, x x^T w, |w|; and of |x_s| |x_t|, (C,)."""
    x, s, t = rule.jets(points)
    w = (x * cross(s, t)).sum(axis=2) * rule.weights
    found = np.zeros((len(points), 14))
    found[:, 0], found[:, 13] = w.sum(axis=1), np.abs(w).sum(axis=1)
    if order:
        found[:, 1:4] = np.matmul(w[:, None], x)[:, 0]
    if order > 1:
        found[:, 4:13] = np.matmul((x * w[..., None]).swapaxes(1, 2), x).reshape(-1, 9)
    size = np.sqrt((s * s).sum(axis=2) * (t * t).sum(axis=2)) @ rule.weights
    return found, size


def corner_sums(cells: Cells, which: Array, rule: Rule, order: int) -> Array:
    """Sums (14,) over all rings around some corners."""
    beyond, total = cells.beyond, np.zeros(14)

    def visit(which: Array, points: Array) -> Array:
        count, each = points.shape[:2]
        points = points + beyond.limits[which][:, None, None]
        sums, size = _integrals(rule, points.reshape(count * each, *points.shape[2:]), order)
        total[:] += sums.sum(axis=0)
        return np.asarray(size.reshape(count, each).sum(axis=1))

    over_rings(beyond, which, visit, NEGLIGIBLE)
    return total
