"""Feet of points on a surface and on its sharp edges: sought, and followed as the surface moves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.query.closest import closest_point
from limitsurf.query.closest import feet as feet_of
from limitsurf.query.crossings import inside
from limitsurf.query.records import Rows
from limitsurf.query.tracing import Adjacency
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_STEPS = 6  # of Newton's method, at most
_SETTLED = 1e-7  # steps in (u, v) after which the next one, by its square, is rounding
_FLAT = 1e-6  # determinants, of the product of both second derivatives, that say nothing
_REACH = 0.5  # within which places on the same side are sought
_SEEDS = 16  # places on a side from which its feet are sought
_NEAREST = 6  # of these places that are tried


@dataclass(slots=True)
class Feet(Rows):
    """Places of a surface, (n,): limit face, u and v."""

    face: Array
    u: Array
    v: Array


def sought(surface: LimitSurface, points: Array, normals: Array | None, workers: int) -> Feet:
    """The places that are nearest to points (n, 3), of about unit size.

    With normals (n, 3) they are, where there are such within `_REACH`, places on the same side.
    """
    found = closest_point(surface, points, workers=workers)
    nearest = Feet(found.face, found.u, found.v)
    if normals is None:
        return nearest
    against = np.flatnonzero(_dot(found.normal, normals) < 0)
    if len(against):
        every = feet_of(surface, points[against], within=_REACH, workers=workers)
        owner = np.repeat(np.arange(len(against)), np.diff(every.offsets))
        fits = np.flatnonzero(_dot(every.normal, normals[against[owner]]) > 0)
        which, first = np.unique(owner[fits], return_index=True)
        at, to = fits[first], against[which]
        nearest.face[to], nearest.u[to], nearest.v[to] = every.face[at], every.u[at], every.v[at]
    return nearest


def followed(
    surface: LimitSurface, points: Array, normals: Array | None, feet: Feet, workers: int
) -> Feet:
    """Feet of points (n, 3) on a surface that has moved a little since they were at `feet`.

    Newton's method moves them within their limit faces. Those that would leave these, or do not
    settle, or are not nearer than where they started, are sought on the whole surface.
    """
    lattice = surface.topology.lattice
    u, v = feet.u.copy(), feet.v.copy()
    settled = np.zeros(len(u), dtype=bool)
    start, last = np.full((2, len(u)), np.inf)
    which = np.arange(len(u))
    for count in range(_STEPS):
        jet = surface.jet(feet.face[which], u[which], v[which], order=2, workers=workers)
        gap = points[which] - jet[0, 0]
        square = np.einsum("nd,nd->n", gap, gap)
        if not count:
            start[:] = square
        last[which] = square
        du, dv = _newton(jet, gap)
        on = inside(lattice, u[which] + du, v[which] + dv)
        stays = (np.abs(on[0] - u[which] - du) + np.abs(on[1] - v[which] - dv)) < _SETTLED
        which, du, dv = which[stays], du[stays], dv[stays]
        u[which], v[which] = on[0][stays], on[1][stays]
        done = np.maximum(np.abs(du), np.abs(dv)) < _SETTLED
        settled[which[done]] = True
        which = which[~done]
        if not len(which):
            break
    lost = np.flatnonzero(~(settled & (last <= start * (1 + 1e-9))))
    found = Feet(feet.face.copy(), u, v)
    if len(lost):
        again = sought(surface, points[lost], None if normals is None else normals[lost], workers)
        found.face[lost], found.u[lost], found.v[lost] = again.face, again.u, again.v
    return found


def _newton(jet: Any, gap: Array) -> tuple[Array, Array]:
    """Newton's step for the squared distance, Gauss's where that is not convex; NaN far beyond."""
    a, b = jet[1, 0], jet[0, 1]
    with np.errstate(all="ignore"):
        first = _dot(a, a), _dot(a, b), _dot(b, b)
        second = (_dot(gap, jet[nu]) for nu in ((2, 0), (1, 1), (0, 2)))
        p, q, r = (x - y for x, y in zip(first, second, strict=True))
        convex = (p > 0) & (p * r - q * q > _FLAT * np.abs(p * r))
        p, q, r = (np.where(convex, x, y) for x, y in zip((p, q, r), first, strict=True))
        g, h, det = _dot(gap, a), _dot(gap, b), p * r - q * q
        return (r * g - q * h) / det, (p * h - q * g) / det


def _dot(x: Array, y: Array) -> Array:
    return np.asarray(np.einsum("nd,nd->n", x, y))


class SharpEdges:
    """The sides of limit faces that stay sharp: boundaries and infinitely sharp creases.

    Attributes
    ----------
    face, side : (k,) int64
        Of an edge with several faces those of one of these.
    on_boundary : (k,) bool
    nodes : (k, 2) int64
        Where sides begin and end: vertices of the cage, or, of halves of edges of n-gons, the
        middle of an edge, as its number after those of all vertices.
    """

    def __init__(self, surface: LimitSurface) -> None:
        known, lattice = Adjacency.of(surface), surface.topology.lattice
        face, side = np.nonzero(surface.topology.sharp_sides)
        alive = surface.patches.with_limit[face]
        face, side = face[alive], side[alive]
        mesh, n = surface.mesh, lattice.face_size
        first, corner = mesh.offsets[known.face[face]], known.corner[face]
        # a part of an n-gon begins with half of the edge at its corner, and ends with half of the
        # edge before
        start = first + np.maximum(corner, 0)
        half = np.where(side == n - 1, mesh.previous_corner[start], start)
        half = np.where(corner < 0, first + side, half)
        edge = mesh.corner_edge[half]
        begins = np.where(corner < 0, -1, mesh.indices[start])
        _, one = np.unique(np.stack([edge, begins], axis=1), axis=0, return_index=True)
        one = _not_twice(edge, begins, one)
        self.face, self.side = face[one], side[one]
        whole, half, edge = corner[one] < 0, half[one], edge[one]
        tip, middle = mesh.indices[start[one]], mesh.n_vertices + edge
        ends = np.where(
            whole, mesh.indices[[half, mesh.next_corner[half]]],
            np.where(self.side == 0, [tip, middle], [middle, tip]),
        )  # fmt: skip
        self.nodes = ends.T
        self.on_boundary = np.asarray(mesh.boundary_edge[edge])
        ends = np.array(lattice.corners, dtype=float)
        self._from, self._way = ends, np.roll(ends, -1, axis=0) - ends

    def __len__(self) -> int:
        return len(self.face)

    def of_kind(self, kind: int) -> Array:
        """Numbers of boundaries (1), of creases (2), or of both (3)."""
        return np.flatnonzero(np.where(self.on_boundary, kind & 1, kind & 2))

    def places(self, which: Array, t: Array) -> Feet:
        """Places (n,) on sides, at t in [0, 1]."""
        side = self.side[which]
        u, v = (self._from[side] + t[:, None] * self._way[side]).T
        return Feet(self.face[which], u, v)

    def nearest(self, surface: LimitSurface, points: Array, which: Array) -> Feet:
        """The places of some sides that are nearest to points (n, 3)."""
        from scipy.spatial import cKDTree

        seeds = (np.arange(_SEEDS) + 0.5) / _SEEDS
        owner, at = np.repeat(which, _SEEDS), np.tile(seeds, len(which))
        tree = cKDTree(self._points(surface, owner, at))
        k = min(_NEAREST, len(owner))
        _, near = tree.query(points, k=k)
        near = np.reshape(near, (len(points), k)).ravel()
        t = self._feet(surface, owner[near], at[near], np.repeat(points, k, axis=0))
        gap = self._points(surface, owner[near], t) - np.repeat(points, k, axis=0)
        best = (gap**2).sum(axis=1).reshape(-1, k).argmin(axis=1) + k * np.arange(len(points))
        return self.places(owner[near][best], t[best])

    def _points(self, surface: LimitSurface, which: Array, t: Array) -> Array:
        feet = self.places(which, t)
        return surface.evaluate(feet.face, feet.u, feet.v)

    def _feet(self, surface: LimitSurface, which: Array, t: Array, points: Array) -> Array:
        """Where feet on sides end by Newton's method from t on, kept between the ends."""
        way = self._way[self.side[which]]
        t = t.copy()
        for _ in range(4 * _STEPS):
            feet = self.places(which, t)
            jet = surface.jet(feet.face, feet.u, feet.v, order=2)
            gap, x, y = points - jet[0, 0], way[:, :1], way[:, 1:]
            with np.errstate(all="ignore"):
                first = x * jet[1, 0] + y * jet[0, 1]
                second = x * x * jet[2, 0] + 2 * x * y * jet[1, 1] + y * y * jet[0, 2]
                slope, square = (gap * first).sum(axis=1), (first**2).sum(axis=1)
                bent = square - (gap * second).sum(axis=1)
                step = slope / np.where(bent > _FLAT * square, bent, square)
            step = np.clip(np.nan_to_num(step), -0.25, 0.25)
            new = np.clip(t + step, 0, 1)
            moved, t = np.abs(new - t).max(initial=0), new
            if moved < 1e-14:
                break
        return t


def _not_twice(edge: Array, begins: Array, one: Array) -> Array:
    """Sides of which no two are the same curve: a whole edge, or one half of it each."""
    whole = np.unique(edge[one][begins[one] < 0])
    return np.asarray(one[(begins[one] < 0) | ~np.isin(edge[one], whole)])
