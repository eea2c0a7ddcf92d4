"""Integrals over the surface itself, of smooth functions times its area: cells are split as needed.

Each cell is integrated by two rules. Where they differ by more than the tolerance, relative to the
cell or to its share in the whole, its four parts take its place. Around special corners rings are
cells like others, down to where what remains is far below the tolerance.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf.engine.packing import over_chunks
from limitsurf.integrals.cells import Cells, over_rings
from limitsurf.integrals.rules import Rule
from limitsurf.pieces.bernstein import Bernstein, children

if TYPE_CHECKING:
    from limitsurf.scheme.scheme import Scheme

Array = NDArray[Any]
# values (Q, k) at points (Q, 3) in the scale of the cells, with unit normals (Q, 3)
Integrand: TypeAlias = Callable[[Array, Array], Array]

_EPS = np.finfo(float).eps
_LESS, _MORE = 6, 9  # points per direction of the two rules
_AT_ONCE = 1 << 17  # points of rules in memory at once
_DEEPEST = 40  # halvings of cells
_FEW, _TIMES = 1 << 17, 8  # cells that may be tried, or so many times as there were at first
# where integrands jump, rules are wrong by up to some 15 times what they differ by
_MARGIN = 32


def surface_integrals(
    cells: Cells, f: Integrand, width: int, rtol: float, workers: int
) -> tuple[Array, Array]:
    """Integrals (k,) of a function of k values, and of its absolute values.

    In the scale of the cells. Warns where `rtol`, relative to the latter, has not been reached.
    """
    points, about = _all_cells(cells, rtol)
    total, size, missed = np.zeros(width), np.zeros(width), np.zeros(width)
    scale: Array | None = None
    tried = 0
    for depth in range(_DEEPEST + 1):
        value, absolute, gap = _both_rules(cells.scheme, points, about, f, width, workers)
        if scale is None:
            scale, count = absolute.sum(axis=0), max(len(points), 1)
        share = np.maximum(absolute, scale / count)
        enough = np.maximum(rtol / 4 * share, 16 * _EPS * absolute)
        good = np.asarray((gap <= enough).all(axis=1))
        tried += len(points)
        more = tried + 4 * np.count_nonzero(~good)
        last = depth == _DEEPEST or more > max(_FEW, _TIMES * count)
        if last and not good.all():
            missed = gap[~good].sum(axis=0)
            good = np.ones(len(good), dtype=bool)
        total, size = total + value[good].sum(axis=0), size + absolute[good].sum(axis=0)
        if good.all():
            break
        points, about = _split(cells.scheme, points[~good]), np.repeat(about[~good], 4, axis=0)
    if (missed > rtol * size).any():
        worst = _MARGIN * float((missed / np.where(size, size, 1)).max())
        warnings.warn(
            f"the integral is known to about {worst:.1e} only, not to rtol = {rtol:.1e}: the "
            "integrand is not smooth within faces",
            RuntimeWarning,
            stacklevel=4,
        )
    return total, size


def sample(cells: Cells) -> tuple[Array, Array]:
    """A point of some cells in their scale, and the unit normal there, (1, 3) each; 0 if none."""
    some, about = cells.points[:1], np.zeros((1, 3))
    if not len(some) and len(cells.beyond):
        first = np.zeros(1, dtype=np.int64)
        some, about = cells.beyond.cells(first, first).points[0, :1], cells.beyond.limits[:1]
    if not len(some):
        return np.zeros((0, 3)), np.zeros((0, 3))
    x, s, t = Rule.of(cells.scheme, 1).jets(some)
    normal = cross(s, t)[0]
    length = np.sqrt((normal * normal).sum())
    return x[0] + about, normal / length if length else np.array([[0.0, 0.0, 1.0]])


def _all_cells(cells: Cells, rtol: float) -> tuple[Array, Array]:
    """Bernstein coefficients (C, n, 3) of all cells, rings among them, and what they are about."""
    found, about = [cells.points], [np.zeros((len(cells.points), 3))]
    beyond, rule = cells.beyond, Rule.of(cells.scheme, 2)

    def visit(which: Array, points: Array) -> Array:
        count, each, n, _ = points.shape
        points = points.reshape(-1, n, 3)
        found.append(points)
        about.append(np.repeat(beyond.limits[which], each, axis=0))
        _, s, t = rule.jets(points)
        size = np.sqrt((s * s).sum(axis=2) * (t * t).sum(axis=2)) @ rule.weights
        return np.asarray(size.reshape(count, each).sum(axis=1))

    over_rings(beyond, np.arange(len(beyond)), visit, rtol / 64)
    return np.concatenate(found), np.concatenate(about)


def _both_rules(
    scheme: Scheme, points: Array, about: Array, f: Integrand, width: int, workers: int
) -> tuple[Array, Array, Array]:
    """Integrals over cells by the finer rule, of absolute values, and how far rules differ."""

    def work(some: slice) -> tuple[Array, Array, Array]:
        coarse, _ = _by_rule(Rule.of(scheme, _LESS), points[some], about[some], f, width)
        fine, absolute = _by_rule(Rule.of(scheme, _MORE), points[some], about[some], f, width)
        return fine, absolute, np.abs(fine - coarse)

    parts = list(over_chunks(len(points), workers, work, _AT_ONCE // _MORE**2))
    if not parts:
        nothing = np.zeros((0, width))
        return nothing, nothing, nothing
    fine, absolute, gap = (np.concatenate(x) for x in zip(*parts, strict=True))
    return fine, absolute, gap


def _by_rule(
    rule: Rule, points: Array, about: Array, f: Integrand, width: int
) -> tuple[Array, Array]:
    """Integrals (C, k) over cells (C, n, 3), and of absolute values."""
    x, s, t = rule.jets(points)
    normal = cross(s, t)
    area = np.sqrt((normal * normal).sum(axis=2))
    flat = area.ravel() > 0
    unit = normal.reshape(-1, 3)[flat] / area.ravel()[flat, None]
    values = np.zeros((len(flat), width))
    values[flat] = f((x + about[:, None]).reshape(-1, 3)[flat], unit)
    values = values.reshape(*area.shape, width) * (area * rule.weights)[:, :, None]
    return values.sum(axis=1), np.abs(values).sum(axis=1)


def cross(a: Array, b: Array) -> Array:
    """Cross products along the last axis; faster than NumPy's."""
    result = np.empty(a.shape)
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        result[..., k] = a[..., i] * b[..., j] - a[..., j] * b[..., i]
    return result


def _split(scheme: Scheme, points: Array) -> Array:
    """The four parts of cells (C, n, 3), (4 C, n, 3)."""
    parts = _parts(scheme)
    found = np.matmul(parts.reshape(-1, parts.shape[2]), points)
    return np.asarray(found.reshape(-1, *points.shape[1:]))


@lru_cache(maxsize=16)
def _parts(scheme: Scheme) -> Array:
    """Coefficients (4, n, n) of the parts of a cell from those of the cell."""
    return children(scheme.lattice, Bernstein.of(scheme, False).exponents)[1]
