"""Eigenfunctions of a dual scheme around the middle of a polygon, as limit surfaces of cages.

The points around a polygon and those beside them form a cage of faces: the polygon, a quad across
each of its edges, and one at each of its corners. An eigenvector of a step is a cage whose limit on
the polygon is an eigenfunction, at half the parameters; it is put together from what the table of
one face has.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.mesh import Mesh
from limitsurf.exact.dual import ring_waves
from limitsurf.spectra.basis import eigenbasis
from limitsurf.spectra.fan import Fan
from limitsurf.surface import LimitSurface
from limitsurf.tables import grid_index

if TYPE_CHECKING:
    from limitsurf.scheme.scheme import Scheme
    from limitsurf.spectra.basis import Eigenbasis

Array: TypeAlias = NDArray[Any]


@dataclass(frozen=True)
class _Sectors:
    """A limit surface on the sectors of a polygon, whose middle is at the corner 0 of each."""

    surface: LimitSurface
    faces: int

    def evaluate(self, face: Any, u: Any, v: Any) -> Array:
        """Positions, as `LimitSurface.evaluate`."""
        lattice = self.surface.limit_faces
        face, u, v = np.broadcast_arrays(face, 1 - np.asarray(u, float), 1 - np.asarray(v, float))
        if lattice.corner[0] < 0:  # one quad, of four parts
            turns = self.surface.rules["scheme"].lattice.turns
            base, along, across = np.array([turns[k] for k in face.flat]).swapaxes(0, 1)
            places = base + (along * u.reshape(-1, 1) + across * v.reshape(-1, 1)) / 2
            face, (u, v) = 0 * face, (x.reshape(face.shape) for x in places.T)
        return np.asarray(self.surface.evaluate(face, u, v))


class DualFan(Fan):
    """The points around a polygon: k sectors of 4, of which point (0, 0) is a corner of it.

    Axis s, along which sector s has its u, leads from the middle across the edge before corner s.
    """

    def __init__(self, basis: Eigenbasis) -> None:
        self.basis, self.scheme, self.kind = basis, basis.scheme, "interior"
        self.faces = faces = basis.sector.faces
        self.place, self.lattice = basis.sector.place, basis.sector.lattice
        self.corners = self.lattice.corners
        self._own = [(i, j) for i in range(2) for j in range(2)]
        self.number = number = np.arange(4 * faces).reshape(faces, 2, 2)
        before = np.roll(number, 1, axis=0)
        across = [number[:, 0, 0], before[:, 0, 0], before[:, 0, 1], number[:, 1, 0]]
        beside = [number[:, 0, 0], number[:, 1, 0], number[:, 1, 1], number[:, 0, 1]]
        self._polygons = [number[:, 0, 0].tolist()]
        for polygons in (across, beside):
            self._polygons += np.stack(polygons, axis=1).tolist()
        self.size = 4 * faces

    def surface(self, values: Array) -> LimitSurface:
        """The limit surface of values (M, ...), on the polygon."""
        holes = range(1, len(self._polygons))
        mesh = Mesh(values, self._polygons, holes=holes, boundary="none")
        return LimitSurface(mesh, scheme=self.scheme)

    def limit(self, values: Array) -> Any:
        """What evaluates that with the middle of the polygon at corner 0 of the sectors."""
        return _Sectors(self.surface(values), self.faces)

    def _near(self, more: list[tuple[int, int]]) -> tuple[Array, Array]:
        """The vectors of the table at the points of a sector, (2, 2, K), and at some more."""
        at, places = grid_index(self.basis.sector), [*self._own, *more]
        rows = self.basis.float64.right_rows([at[1 + i, 1 + j] for i, j in places])
        return rows[:4].reshape(2, 2, -1), rows[4:]

    def _waves(self) -> Iterator[tuple[float, int, int, Array]]:
        """Eigenfunctions that do not vanish on the ring: as those of `Fan`, with values (N, 2, 2).

        The table has cosines and sines from the first corner on, half a sector from the first axis.
        """
        table, (near, _) = self.basis.float64, self._near([])
        place, n = np.argsort(table.order), self.faces
        for mode, (f, parity) in enumerate(ring_waves(n)):
            k, paired = place[mode], 0 < 2 * f < n  # the sine follows its cosine
            if parity:
                continue
            turn = np.pi * f / n * (1 + 2 * np.arange(n))[:, None, None]
            sine = near[..., place[mode + 1]] if paired else 0 * near[..., k]
            even = np.cos(turn) * near[..., k] - np.sin(turn) * sine
            odd = np.sin(turn) * near[..., k] + np.cos(turn) * sine
            eigenvalue = float(table.rates[0, k])
            if paired or f == 0:
                yield eigenvalue, f, 0, even
            if f:
                yield eigenvalue, f, 1, odd

    def _outer_waves(self) -> Iterator[tuple[float, int, int, Array]]:
        """Those that vanish on the ring: waves of what is of one axis, or of one sector."""
        table, (near, beyond) = self.basis.float64, self._near([(1, -1)])
        n, s = self.faces, np.arange(self.faces)[:, None, None]
        for k in np.flatnonzero(table.order >= self.basis.sector.ring):
            here, eigenvalue = near[..., k], float(table.rates[0, k])
            if here[0, 1]:  # of the other axis of this sector
                continue
            sign = np.sign(beyond[0, k] * here[1, 0])
            for f, sine in ring_waves(n):
                wave = (np.cos, np.sin)[sine]
                first, middle, last = (wave(np.pi * f / n * (2 * s + x)) for x in range(3))
                values = first * here + sign * last * here.T if sign else middle * here
                if np.abs(values).max() > 1e-9:
                    yield eigenvalue, f, sine ^ int(sign < 0), values
                elif 2 * f == n:  # of a cosine between there is nothing, but of the sine
                    other = np.sin(np.pi * f / n * (2 * s + 1)) * here
                    yield eigenvalue, f, 1, other

    def _smooth_map(self) -> Array:
        """The characteristic map: corners of the polygon are those of a regular one."""
        slowest = self.basis.float64.rates[0, self.basis.float64.normal[0]]
        x, y = (
            self._joined(near) for value, f, _, near in self._waves() if (value, f) == (slowest, 1)
        )
        corner, half = self.number[0, 0, 0], np.pi / self.faces
        return np.stack([x / x[corner] * math.cos(half), y / y[corner] * math.sin(half)], axis=1)


def fan_of(scheme: str | Scheme, kind: str, faces: int) -> Fan:
    """The fan of a vertex, or of a polygon of a dual scheme."""
    basis = eigenbasis(scheme, kind=kind, faces=faces)
    return DualFan(basis) if basis.sector.lattice.dual else Fan(scheme, kind, faces)
