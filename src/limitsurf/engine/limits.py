"""Normals that are limits: at and beside sides of limit faces along which derivatives vanish."""

from __future__ import annotations

from math import factorial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels import reference as kernels
from limitsurf.caching import cached_property
from limitsurf.engine.groups import CHUNK
from limitsurf.engine.kinds import Group
from limitsurf.engine.protocol import Request
from limitsurf.engine.topology import Topology
from limitsurf.mesh import Mesh
from limitsurf.refine import refined
from limitsurf.values import Values

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
        of sides that are points.
        """
        lost = np.isnan(normals[:, 0])
        if not lost.any():
            return
        some, topology = request.flat(lost), self._topology
        face, u, v = some.face, some.u, some.v
        at = np.isfinite(u) & np.isfinite(v) & (topology.patches.codes[face] != -1)
        away = np.where(topology.sharp_sides[face].T, [v, 1 - u, 1 - v, u], np.inf)
        side, nearest = away.argmin(axis=0), away.min(axis=0)
        at &= nearest < _BESIDE
        corner = at & ((u == 0) | (u == 1)) & ((v == 0) | (v == 1))
        found = np.full((len(face), 3), np.nan)
        if corner.any():
            which = np.where(v[corner] == 0, u[corner], 3 - u[corner]).astype(int)
            found[corner] = self._corner_normals[face[corner], which]
        here = np.flatnonzero(at & ~corner)
        face, side, nearest = face[here].astype(np.int64, copy=False), side[here], nearest[here]
        u = np.choose(side, [u[here], 1.0, u[here], 0.0])
        v = np.choose(side, [0.0, v[here], 1.0, v[here]])
        limits = np.full((len(here), 3), np.nan)
        for start in range(0, len(here), CHUNK):
            part = slice(start, start + CHUNK)
            for g in topology.groups.part(face[part], u[part], v[part], 64)[1]:
                given = side[part][g.query], nearest[part][g.query]
                limits[start + g.query] = self._at_side(g, *given)
        found[here] = limits
        normals[lost] = found

    def _at_side(self, g: Group, side: Array, away: Array) -> Array:
        """Limits (q, 3) of normals towards sides of limit faces on which derivatives vanish.

        Queries of a group on the sides v = 0, u = 1, v = 1, u = 0, of numbers `side` 0 to 3 (q,),
        of which the normal is wanted so far `away` (q,) from the side; NaN where there is none.
        Derived in ``derivations/limit_normals.py``, section 8.
        """
        jets = g.kind.jets(self._values, g)
        if jets is None:
            return np.full((len(g.query), 3), np.nan)
        found, error, exponent = jets
        # x along the side, y away from it
        along_v, back = side % 2 == 1, (side == 1) | (side == 2)
        found = np.where(along_v[:, None, None, None], found.swapaxes(1, 2), found)
        error = np.where(along_v[:, None, None], error.swapaxes(1, 2), error)
        found[:, :, 1::2] *= np.where(back, -1, 1)[:, None, None, None]
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
        normals = kernels.unit_normals(along, across, (noise, other))
        return normals * np.where((side == 2) | (side == 3), -1, 1)[:, None]

    @cached_property
    def _corner_normals(self) -> Array:
        """Limit normals at the corners (0, 0), (1, 0), (1, 1), (0, 1) of limit faces, (n, 4, 3)."""
        mesh, faces = self._mesh, self._topology.limit_faces
        quads = bool((mesh.sizes == 4).all())
        fine = refined(mesh, 0 if quads else 1, **vars(self._topology.rules))
        normals: Array = fine.limit_normals.reshape(-1, 4, 3)
        if quads:
            return normals
        child = mesh.offsets[faces.face] + np.maximum(faces.corner, 0)
        result: Array = normals[child]
        quad = np.flatnonzero(mesh.sizes[faces.face] == 4)
        result[quad] = normals[child[quad, None] + np.arange(4), 0]
        return result
