"""Functions at points of a quadrature, which near corners other than (0, 0) u and v cannot tell.

At a corner (1, 1) of a face 1 - 2^-54 is 1, so that ring 54 cannot be asked for through (u, v). The
same faces with their corners turned have this one at (0, 0).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.mesh import CHOICES, Mesh
from limitsurf.engine.protocol import Order
from limitsurf.pieces.cover import Cover
from limitsurf.surface import LimitSurface

if TYPE_CHECKING:
    from limitsurf.integrals.quadrature import Quadrature

Array = NDArray[Any]

_DEEP = 16  # from this ring on u and v have few digits of their distance from a corner


def weights_nearby(
    surface: LimitSurface, q: Quadrature, at: Array, orders: Sequence[Order]
) -> Iterator[tuple[Array, list[Any]]]:
    """Which of some points are that near to corners, and matrices of derivatives of these."""
    rows = np.flatnonzero(q.places.ring[at] >= _DEEP)
    rows = rows[surface.limit_faces.corner[q.face[at[rows]]] < 0]
    if not len(rows):
        return
    deep = at[rows]
    corners = np.array(surface.topology.lattice.corners, dtype=float)
    place = np.stack([q.u[deep], q.v[deep]], axis=1)
    corner = np.argmin(((place[:, None] - corners) ** 2).sum(axis=2), axis=1)
    away = _from_corners(surface, q, deep)
    for k in np.unique(corner[corner > 0]).tolist():
        here = corner == k
        sides = np.stack([corners[(k + 1) % len(corners)], corners[k - 1]]) - corners[k]
        matrix = np.linalg.inv(sides)  # (u, v) from the corner @ matrix: along both sides
        u, v = (away[here] @ matrix).T
        some = _turned(surface, k).weights(q.face[deep[here]], u, v, nu=list(orders))
        yield rows[here], [_combined(nu, orders, some, matrix) for nu in orders]


def _from_corners(surface: LimitSurface, q: Quadrature, deep: Array) -> Array:
    """How far (m, 2) in u and v points are from the corner that they are near, to all digits."""
    patches = surface.patches
    faces = np.unique(q.face[deep])
    covered = Cover.of(patches, faces)
    n = int(max(covered.patch.max(), q.places.patch[deep].max())) + 1
    key = covered.owner * n + covered.patch
    order = np.argsort(key)
    own = np.searchsorted(faces, q.face[deep]) * n + q.places.patch[deep]
    row = order[np.searchsorted(key, own, sorter=order)]
    turns = np.array(patches.lattice.turns, dtype=float)[patches.turn[q.places.patch[deep]]]
    s, t = q.places.s[deep, None], q.places.t[deep, None]
    away = covered.sign[row][:, None] * (turns[:, 1] * s + turns[:, 2] * t)
    return np.asarray(np.ldexp(away, -(covered.level[row] + q.places.ring[deep])[:, None]))


def _turned(surface: LimitSurface, k: int) -> LimitSurface:
    """The same surface, whose faces that are not split begin with their corner k."""
    mesh = surface.mesh
    whole = mesh.sizes[mesh.corner_face] == surface.topology.lattice.face_size
    own = np.arange(mesh.n_corners) - mesh.offsets[mesh.corner_face]
    size = mesh.sizes[mesh.corner_face]
    place = mesh.offsets[mesh.corner_face] + np.where(whole, (own + k) % size, own)
    found = Mesh(
        mesh.points,
        (mesh.sizes, mesh.indices[place]),
        creases=mesh.creases,
        corners=mesh.corners,
        holes=mesh.holes,
        **{name: getattr(mesh, name) for name in CHOICES},
    )
    return LimitSurface(found, **surface.rules, engine=surface.engine)


def _combined(nu: Order, orders: Sequence[Order], some: Any, matrix: Array) -> Any:
    """A derivative by u and v from those along both sides of a corner."""
    factors = np.ones(1)
    for count, row in zip(nu, matrix, strict=True):
        for _ in range(count):  # (a D_1 + b D_2) by itself, in powers of D_2
            factors = np.convolve(factors, row)
    total = some[0].copy()  # all are on one pattern
    total.data[:] = 0
    for power, factor in enumerate(factors.tolist()):
        if factor:
            total.data += factor * some[list(orders).index((sum(nu) - power, power))].data
    return total
