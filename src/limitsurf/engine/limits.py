"""Normals that are limits: at and beside sides of limit faces along which derivatives vanish."""

from __future__ import annotations

from math import factorial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import _kernels
from limitsurf._kernels import reference as kernels
from limitsurf.caching import cached_property
from limitsurf.cage.mesh import Mesh
from limitsurf.engine.groups import CHUNK
from limitsurf.engine.kinds import Group
from limitsurf.engine.protocol import Request, on_slope
from limitsurf.engine.topology import Topology
from limitsurf.refine import refined
from limitsurf.values import Values

if TYPE_CHECKING:
    from limitsurf.scheme.lattice import Lattice

Array = NDArray[Any]

# from a side: beyond, only directions that differ by rounding are in doubt
_BESIDE = 2.0**-10


class Limits:
    """Limits of normals on one set of points, those of `mesh`."""

    def __init__(self, topology: Topology, mesh: Mesh, values: Values) -> None:
        self._topology, self._mesh, self._values = topology, mesh, values

    def fill(self, request: Request, normals: Array) -> None:
        """Fill in normals (Q, 3) that are NaN at queries where they are limits all the same.

        At and beside sharp sides (boundaries are) along which derivatives vanish, and at vertices
        of sides that are points, on all of their faces.
        """
        lost = np.isnan(normals[:, 0])
        if not lost.any() or self._topology.lattice.dual:
            return
        some, topology = request.flat(lost), self._topology
        face, u, v = some.face, some.u, some.v
        at = np.isfinite(u) & np.isfinite(v) & (topology.patches.codes[face] != -1)
        lattice = topology.lattice
        # side k is where coordinate k + 1 is 0, and corner k where coordinate k is, too
        coordinates = np.array(kernels.coordinates(u, v, lattice.sides))
        beside = np.roll(coordinates, -1, axis=0)
        corners = (coordinates == 0) & (beside == 0) & topology.sharp_corners[face].T
        corner = at & corners.any(axis=0)
        away = np.where(topology.sharp_sides[face].T, beside, np.inf)
        side, nearest = away.argmin(axis=0), away.min(axis=0)
        at &= nearest < _BESIDE
        found = np.full((len(face), 3), np.nan)
        if corner.any():
            which = corners[:, corner].argmax(axis=0)
            found[corner] = self._corner_normals[face[corner], which]
        here = np.flatnonzero(at & ~corner)
        face, side, nearest = face[here].astype(np.int64, copy=False), side[here], nearest[here]
        u, v = _on_sides(u[here], v[here], side, lattice)
        limits = np.full((len(here), 3), np.nan)
        for start in range(0, len(here), CHUNK):
            part = slice(start, start + CHUNK)
            for g in topology.groups.by_kind(face[part], u[part], v[part], 64)[1]:
                given = side[part][g.query], nearest[part][g.query]
                limits[start + g.query] = self._at_side(g, *given)
        found[here] = limits
        normals[lost] = found

    def _at_side(self, g: Group, side: Array, away: Array) -> Array:
        """Limits (q, 3) of normals towards sides of limit faces on which derivatives vanish.

        Queries of a group on sides of some number (q,), each from a corner to the next, of which
        the normal is wanted so far `away` (q,) from the side; NaN where there is none. Derived in
        ``derivations/limit_normals.py``, section 8.
        """
        # x along the side, y away from it: as corner k sees the face; half a turn stays one
        size = self._topology.lattice.face_size
        turn = g.orientation % size
        jets = g.kind.jets(self._values, g, (turn - side) % size + (g.orientation - turn))
        if jets is None:
            return np.full((len(g.query), 3), np.nan)
        found, error, exponent = jets
        y = kernels.scale_by_two(away, exponent)
        parts = []
        for first in (found[:, 1:], error[:, 1:]), (found[:, :, 1:], error[:, :, 1:]):
            # polynomials in x, of which the first that are 0 everywhere are left out
            seen = (np.abs(first[0]).max(axis=3) > first[1]).any(axis=1)
            terms = np.cumsum(seen, axis=1) > 0
            power = np.cumsum(terms, axis=1) - 1
            scale = np.where(terms, y[:, None] ** np.maximum(power, 0), 0)
            scale /= [factorial(k) for k in range(terms.shape[1])]
            parts.append((first[0][:, 0] * scale[..., None]).sum(axis=1))
            parts.append((first[1][:, 0] * scale).sum(axis=1)[:, None])
        along, noise, across, other = parts
        return kernels.unit_normals(along, across, (noise, other))

    @cached_property
    def _corner_normals(self) -> Array:
        """Limit normals at the corners of limit faces, (n, corners, 3)."""
        mesh, faces = self._mesh, self._topology.limit_faces
        size = self._topology.lattice.face_size
        regular = bool((mesh.sizes == size).all())
        with _kernels.chosen(self._topology.choice):
            fine = refined(mesh, 0 if regular else 1, **vars(self._topology.rules))
            normals: Array = fine.limit_normals.reshape(-1, size, 3)
        if regular:
            return normals
        # a step makes a face for each corner
        child = mesh.offsets[faces.face] + np.maximum(faces.corner, 0)
        result: Array = normals[child]
        whole = np.flatnonzero(mesh.sizes[faces.face] == size)
        result[whole] = normals[child[whole, None] + np.arange(size), 0]
        return result


def _on_sides(u: Array, v: Array, side: Array, lattice: Lattice) -> tuple[Array, Array]:
    """Parameters (q,) put on the nearby sides of numbers `side` (q,)."""
    us, vs = [], []
    for a, b, c in lattice.edges:
        x, y = on_slope(u, v) if b and c else (u, v)
        us.append(x if c else -a / b + 0 * u)
        vs.append(y if b else -a / c + 0 * v)
    return np.choose(side, us), np.choose(side, vs)
