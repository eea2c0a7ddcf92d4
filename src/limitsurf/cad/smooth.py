"""Cells around poles that share tangent planes along their common edges: caps of bicubic pieces.

``derivations/g1_caps.py`` derives them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import comb
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cad.poles import Poles
from limitsurf.pieces.beyond import Beyond
from limitsurf.query.chords import length
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_DEGREE = 3
# by how much a spoke's second derivative and a twist move the coefficients of pieces
_SPOKE, _TWIST = 2 / 8**2, 1 / 36**2
_ROUNDED = 2.0**-49  # of the size of a surface, by which control points may be off


@dataclass(frozen=True, eq=False)
class SmoothCaps:
    """Caps at special corners, (r,) of those that were asked for.

    Attributes
    ----------
    there : (r,) bool
        Whether there is one.
    ring : (r, 3, 16, 3)
        Bernstein coefficients of the outer pieces of the cell at each corner, as `Beyond.cells` has
        those of the limit, relative to the limit of the corner.
    inner : (r, 16, 3)
        Of the piece at the corner, half as wide as the cell.
    edge : (r,)
        Bounds of the angles between normals on both sides of the edge that begins at the corner,
        with control points rounded; 0 where there is no cap.
    """

    there: Array
    ring: Array
    inner: Array
    edge: Array


class Fans:
    """The special corners around each pole that a cap can be made of.

    Attributes
    ----------
    rows : list of (k, N) int
        Numbers of corners in the order of `Poles`, counter-clockwise, of poles of N faces.
    normals : list of (k, 3)
    without : int
        How many poles have none.
    """

    def __init__(self, surface: LimitSurface, poles: Poles, beyond: Beyond) -> None:
        self.rows: list[Array] = []
        self.normals: list[Array] = []
        n, lattice = len(poles.face), surface.topology.lattice
        number, which = np.unique(poles.pole, return_inverse=True)
        self.without = len(number)
        spline = surface.topology.rules.scheme.spline
        bicubic = not lattice.sloped and np.max(spline.exponents) == _DEGREE
        if not n or not bicubic or surface.points.shape[1] != 3:
            return
        which = which.ravel()
        good = np.ones(len(number), dtype=bool)
        following = _following(surface, poles)
        bad = (following < 0) | ~beyond.interior(np.arange(n))
        good[which[bad]] = False
        count = np.bincount(which, minlength=len(number))
        good &= count >= 3
        first = np.full(len(number), -1)
        first[which[::-1]] = np.arange(n)[::-1]
        for faces in np.unique(count[good]).tolist():
            at = first[good & (count == faces)]
            fan = [at]
            for _ in range(faces - 1):
                fan.append(following[fan[-1]])
            rows = np.stack(fan, axis=1)
            whole = (following[rows[:, -1]] == at) & (np.diff(np.sort(rows)) > 0).all(axis=1)
            u, v = np.array(lattice.corners, dtype=float)[poles.corner[rows[:, 0]]].T
            normal = surface.normal(poles.face[rows[:, 0]], u, v)
            here = whole & np.isfinite(normal).all(axis=1)
            self.rows.append(rows[here])
            self.normals.append(normal[here])
            self.without -= int(here.sum())

    def of(self, which: Array, n: int) -> Iterator[tuple[Array, Array]]:
        """Those of which all of some corners (r,) of n are: places among these, and normals."""
        place = np.full(n, -1)
        place[which] = np.arange(len(which))
        for rows, normals in zip(self.rows, self.normals, strict=True):
            at = place[rows]
            here = (at >= 0).all(axis=1)
            if here.any():
                yield at[here], normals[here]


def _following(surface: LimitSurface, poles: Poles) -> Array:
    """The corner (r,) of the next face around each one's pole, counter-clockwise; -1 if none."""
    mesh, ends = surface.mesh, surface.limit_faces
    row = np.full((len(ends), 4), -1)
    row[poles.face, poles.corner] = np.arange(len(poles.face))
    face = ends.face[poles.face]
    half, middle = ends.corner[poles.face] >= 0, poles.corner != 0
    middle &= half
    first = mesh.offsets[face]
    own = first + np.where(half, ends.corner[poles.face], poles.corner)
    beside = mesh.twin[mesh.previous_corner[own]]
    beside = np.where(middle, mesh.next_corner[own], beside)
    known = beside >= 0
    beside = np.maximum(beside, 0)
    other = mesh.corner_face[beside]
    k = beside - mesh.offsets[other]
    start = ends.first[other]
    split = ends.corner[start] >= 0
    there = np.where(split, start + k, start)
    corner = np.where(middle, 2, np.where(split, 0, k % 4))
    return np.asarray(np.where(known, row[there, corner], -1))


def smooth_caps(beyond: Beyond, fans: Fans, which: Array, ring: Array) -> SmoothCaps:
    """Caps of corners (r,), in cells that begin at a ring (r,) of what `Beyond` has.

    Corners of one pole have the same ring. The limit's points are about 1 in size, or less.
    """
    n = len(which)
    cells = np.zeros((n, 3, 16, beyond.limits.shape[1]))
    inner = np.zeros((n, 16, cells.shape[-1]))
    there, edge = np.zeros(n, dtype=bool), np.zeros(n)
    order = _orders()
    for at, normal in fans.of(which, len(beyond)):
        flat = at.ravel()
        known = order[beyond.corner(which[flat])][:, None, :, None]
        limit = beyond.cells(which[flat], ring[flat]).points
        own = np.take_along_axis(limit, known, axis=2).reshape(*at.shape, 3, 4, 4, 3)
        made, middle, bound = _cap(own, normal)
        both = np.concatenate([made, middle[:, :, None]], axis=2).reshape(-1, 4, 16, 3)
        back = np.empty_like(both)
        np.put_along_axis(back, np.broadcast_to(known, both.shape), both, axis=2)
        keep = np.repeat(bound.max(axis=1) < np.pi, at.shape[1])
        cells[flat[keep]], inner[flat[keep]] = back[keep, :3], back[keep, 3]
        there[flat[keep]], edge[flat[keep]] = True, bound.ravel()[keep]
    return SmoothCaps(there, cells, inner, edge)


def _orders() -> Array:
    """By corner of a square, the coefficients as they are counted from there, (4, 16).

    First along the side to the next corner, then along that to the previous one.
    """
    i, j = np.divmod(np.arange(16), 4)
    places = (i, j), (3 - j, i), (3 - i, 3 - j), (j, 3 - i)
    return np.stack([4 * a + b for a, b in places])


def _cap(limit: Array, normal: Array) -> tuple[Array, Array, Array]:
    """Pieces of caps from those of the limit (k, N, 3, 4, 4, 3), counted from the pole.

    Those around, the one at the pole, and bounds of angles across spokes (k, N): pi where a cap
    folds. Spoke m lies along the first axis of face m, and along the second of the one before.
    """
    n = limit.shape[1]
    cosine = np.cos(2 * np.pi / n)
    one, far, two = (limit[:, :, k] for k in range(3))
    spoke, along = one[:, :, 0, 0], 6 * (one[:, :, 1, 0] - one[:, :, 0, 0])
    # half of the difference of both sides' derivatives across, which add up to 0 there
    beside = _before(two)
    step = 3 * (one[:, :, 0, 1] - one[:, :, 0, 0] - beside[:, :, 1, 0] + beside[:, :, 0, 0])
    slope = 3 * (one[:, :, 1, 1] - one[:, :, 1, 0] - beside[:, :, 1, 1] + beside[:, :, 0, 1])
    slope = 6 * slope - 6 * step
    tangent = _tangents(4 * spoke - along, normal)
    bend = 4 * spoke + along - 3 * tangent
    twist = 2 * (step - _after(tangent)) - 2 * (_after(step) + tangent)
    twist -= 4 * (far[:, :, 0, 0] - spoke - _after(spoke))
    bend, twist = _agreeing(tangent, bend, twist, cosine)
    end, speed = tangent / 2 + bend / 8, tangent + bend / 2
    row = np.stack([np.zeros_like(end), tangent / 6, end - speed / 6, end], axis=2)
    even = cosine * np.stack([tangent, speed / 3, 0 * end, 0 * end], axis=2)
    start = (_after(tangent) - _before(tangent)) / 2
    turn = (twist - _before(twist)) / 12
    odd = np.stack([start, start + turn, step - slope / 6, step], axis=2)
    around, inner = limit.copy(), np.empty_like(one)
    corner = far[:, :, :2, :2]
    low = 2 * corner[:, :, :1] - corner[:, :, 1:]
    both = np.concatenate([low, corner[:, :, :1]], axis=2)
    inner[:, :, 2:, 3] = both[:, :, :, 0]
    inner[:, :, 2:, 2] = 2 * both[:, :, :, 0] - both[:, :, :, 1]
    second = row + (even + odd) / 6
    other, beyond = _after(row), _after(row + (even - odd) / 6)
    for k, (a, b) in enumerate(((row, second), (other, beyond))):
        for net, here in ((inner, None), (around[:, :, 2 * k], 0)):
            flipped = net.swapaxes(2, 3) if k else net
            for line, values in enumerate((a, b)):
                if here is None:
                    flipped[:, :, :, line] = values
                else:
                    flipped[:, :, 0, line] = values[:, :, 3]
                    flipped[:, :, 1, line] = 2 * values[:, :, 3] - values[:, :, 2]
    return around, inner, _across(around, inner, normal, cosine)


def _after(x: Array) -> Array:
    """Of each face or spoke, that of the next."""
    return np.roll(x, -1, axis=1)


def _before(x: Array) -> Array:
    return np.roll(x, 1, axis=1)


def _tangents(wanted: Array, normal: Array) -> Array:
    """Derivatives (k, N, 3) along spokes in the tangent plane: an affine regular N-gon, nearest."""
    n = wanted.shape[1]
    angle = 2 * np.pi * np.arange(n) / n
    turns = np.stack([np.cos(angle), np.sin(angle)])
    axes = 2 / n * np.einsum("an,knd->kad", turns, wanted)
    axes -= (axes * normal[:, None]).sum(axis=2, keepdims=True) * normal[:, None]
    return np.asarray(np.einsum("an,kad->knd", turns, axes))


def _agreeing(tangent: Array, bend: Array, twist: Array, cosine: float) -> tuple[Array, Array]:
    """Second derivatives of spokes, and twists, (k, N, 3), for which derivatives across agree.

    That is twist[m] + twist[m - 1] = 2 cosine (bend[m] - 4 tangent[m]); the nearest to those given.
    """
    n = tangent.shape[1]
    shift = 1 + np.exp(-2j * np.pi * np.arange(n) / n)[:, None]
    off = -2 * cosine * (4 * tangent - bend) - twist - _before(twist)
    weight = 4 * cosine**2 / _SPOKE + np.abs(shift) ** 2 / _TWIST
    share = np.fft.fft(off, axis=1) / weight
    bend = bend + np.fft.ifft(-2 * cosine * share, axis=1).real / _SPOKE
    twist = twist + np.fft.ifft(np.conj(shift) * share, axis=1).real / _TWIST
    return bend, twist


def _across(around: Array, inner: Array, normal: Array, cosine: float) -> Array:
    """Bounds of angles between normals on both sides of spokes (k, N); pi where they may fold."""
    found = np.zeros(inner.shape[:2])
    fade = np.array([2 * cosine, 0, 0])[:, None]
    pairs = ((inner, inner, fade), (around[:, :, 0], around[:, :, 2], 0 * fade))
    for one, two, c in pairs:
        along = 6 * np.diff(one[:, :, :, 0], axis=2)
        left = 6 * (one[:, :, :, 1] - one[:, :, :, 0])
        right = 6 * _before(two[:, :, 1] - two[:, :, 0])
        # what remains of the condition, of degree 4, and control points rounded
        sums = _raised(left + right) - _product(c * np.ones((*along.shape[:2], 3, 1)), along)
        off = length(sums).max(axis=2) + 48 * _ROUNDED
        normals = _product(along, left, cross=True)
        high = (normals * normal[:, None, None]).sum(axis=3).min(axis=2)
        size = length(along).max(axis=2)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = 2 * off * size / high
        bound = np.where((high > 0) & (share < 1), np.arcsin(np.clip(share, 0, 1)), np.pi)
        found = np.maximum(found, bound)
    return found


def _raised(x: Array) -> Array:
    """Coefficients of polynomials (..., 4, d) as those of degree 4."""
    share = np.arange(1, 4)[:, None] / 4
    middle = share * x[..., :-1, :] + (1 - share) * x[..., 1:, :]
    return np.concatenate([x[..., :1, :], middle, x[..., -1:, :]], axis=-2)


def _product(x: Array, y: Array, cross: bool = False) -> Array:
    """Coefficients of products of polynomials (..., m, d) and (..., n, d)."""
    m, n = x.shape[-2], y.shape[-2]
    shape = *y.shape[:-2], m + n - 1, y.shape[-1]
    found = np.zeros(shape)
    for i in range(m):
        for j in range(n):
            share = comb(m - 1, i) * comb(n - 1, j) / comb(m + n - 2, i + j)
            a, b = x[..., i, :], y[..., j, :]
            found[..., i + j, :] += share * (np.cross(a, b) if cross else a * b)
    return found
