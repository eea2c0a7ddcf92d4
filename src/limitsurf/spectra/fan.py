"""Eigenfunctions of subdivision around a vertex, as limit surfaces of cages of their own.

The two-ring of a vertex holds all control points of the faces around it, and one step of refinement
makes the two-ring of half the size from it. An eigenvector of that step is a cage whose limit is an
eigenfunction: exactly the same at half the parameters, times its eigenvalue.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf.mesh import Mesh
from limitsurf.refine import refined
from limitsurf.spectra.basis import eigenbasis
from limitsurf.surface import LimitSurface

if TYPE_CHECKING:
    from limitsurf.scheme.scheme import Scheme

Array: TypeAlias = NDArray[Any]

_SAME = 1e-9  # eigenvalues this close are one


@dataclass(frozen=True)
class Mode:
    """An eigenfunction around a smooth vertex.

    Attributes
    ----------
    eigenvalue : float
    frequency : int
        Waves once around the vertex.
    sine : bool
        Whether it changes its sign when mirrored at the first edge.
    paired : bool
        Whether there is another of this eigenvalue and frequency, turned by a quarter of a wave.
    values : (M,)
        At the vertices of the fan.
    """

    eigenvalue: float
    frequency: int
    sine: bool
    paired: bool
    values: Array


class Fan:
    """The two-ring of a vertex: k sectors of 2 x 2 faces, the vertex at corner 0 of the inner ones.

    Sector s lies between axes s and s + 1; its point (i, j) is i steps along the one and j along
    the other. Limit face s is the inner face of sector s, with u along axis s.

    Examples
    --------
    >>> from limitsurf.spectra.fan import Fan
    >>> fan = Fan("catmull-clark", "interior", 5)
    >>> x, y = fan.characteristic_map().T
    >>> surface = fan.surface(x)
    >>> ratio = surface.evaluate(0, 0.25, 0.5) / surface.evaluate(0, 0.5, 1.0)
    >>> print(f"{ratio:.6f}")
    0.549988
    """

    def __init__(self, scheme: str | Scheme, kind: str, faces: int) -> None:
        self.scheme, self.kind, self.faces = scheme, kind, faces
        self.basis = eigenbasis(scheme, kind=kind, faces=faces)  # checks all three
        self.place = self.basis.sector.place
        is_open = kind in ("crease", "corner")
        axes = faces + is_open
        s = np.arange(faces)
        number = np.zeros((faces, 3, 3), dtype=np.int64)
        steps = np.arange(1, 3)
        number[:, 1:, 0] = 1 + 2 * s[:, None] + steps - 1
        number[:, 0, 1:] = 1 + 2 * ((s + 1) % axes)[:, None] + steps - 1
        number[:, 1:, 1:] = 1 + 2 * axes + np.arange(4 * faces).reshape(faces, 2, 2)
        self.number = number  # (k, 3, 3)
        quads = [number[:, :-1, :-1], number[:, 1:, :-1], number[:, 1:, 1:], number[:, :-1, 1:]]
        cells = np.stack(quads, axis=-1).reshape(faces, 4, 4)
        # inner faces first: their numbers are those of the sectors
        self._cells = np.concatenate([cells[:, 0], cells[:, 1:].reshape(-1, 4)])
        self._tags: dict[str, Any] = {"boundary": "edge_only"}
        if kind == "dart":
            ray = [0, *number[0, 1:, 0].tolist()]
            self._tags["creases"] = dict.fromkeys(pairwise(ray), math.inf)
        if kind in ("corner", "cone"):
            self._tags["corners"] = {0: math.inf}
        self.size = int(number.max()) + 1

    def surface(self, values: Array) -> LimitSurface:
        """The limit surface of values (M, ...), on the inner faces."""
        holes = range(self.faces, len(self._cells))
        return LimitSurface(
            Mesh(values, self._cells, holes=holes, **self._tags), scheme=self.scheme
        )

    def operator(self) -> Array:
        """One step of refinement, (M, M)."""
        cage = Mesh(np.zeros((self.size, 1)), self._cells, **self._tags)
        fine, rows = refined(cage, scheme=self.scheme, operator=True)
        child = np.asarray(fine.faces)[: 4 * self.faces].reshape(self.faces, 4, 4)
        at = np.empty_like(self.number)  # fine vertices
        corners = [[(0, 0), (1, 0), (1, 1), (0, 1)], [(2, 0), (2, 1), (1, 1), (1, 0)]]
        corners += [[(2, 2), (1, 2), (1, 1), (2, 1)], [(0, 2), (0, 1), (1, 1), (1, 2)]]
        for k, places in enumerate(corners):
            for corner, (i, j) in enumerate(places):
                at[:, i, j] = child[:, k, corner]
        origin = np.empty(self.size, dtype=np.int64)
        origin[self.number] = at
        return np.asarray(rows.toarray()[origin])

    def mirrored(self, values: Array) -> Array:
        """Values (M,) reflected: at the first axis, or in open fans at the bisector."""
        found = np.empty_like(values)
        last = self.faces - 1
        found[self.number[np.arange(last, -1, -1)]] = values[self.number.transpose(0, 2, 1)]
        return found

    def modes(self) -> list[Mode]:
        """All eigenfunctions around a smooth vertex, by decreasing modulus of the eigenvalue.

        Raises
        ------
        ValueError
            Around another vertex; where eigenvalues are complex or eigenvectors are missing, as
            they can be of a scheme of your own.
        """
        if self.kind != "interior":
            raise ValueError(f"modes are those of a smooth vertex, not of {self.place}")
        N, step, found = self.faces, self.operator(), []
        sectors = self.number[:, 1:].reshape(N, 6)  # all but the vertex
        for f in range(N // 2 + 1):  # sectors are alike: each wave has a block of its own
            angle = 2 * np.pi * f / N * np.arange(N)
            waves = np.zeros((self.size, 6, 2))
            for k in range(6):
                waves[sectors[:, k], k] = np.stack([np.cos(angle), np.sin(angle)], axis=1)
            all_waves = waves.reshape(self.size, 12)
            if f == 0:
                all_waves = np.concatenate([all_waves, np.eye(self.size, 1)], axis=1)
            swapped = self.mirrored(all_waves)
            for sine, part in enumerate((all_waves + swapped, all_waves - swapped)):
                left, sizes, _ = np.linalg.svd(part, full_matrices=False)
                base = left[:, sizes > _SAME]  # (M, 3 or so), orthonormal
                for eigenvalue, vector in self._eigenvectors(base.T @ step @ base):
                    values = base @ vector
                    values /= values[np.argmax(np.abs(values).round(9))]
                    found.append(Mode(eigenvalue, f, bool(sine), 0 < 2 * f < N, values))
        return sorted(found, key=lambda m: (-round(abs(m.eigenvalue), 9), m.frequency, m.sine))

    def order(self) -> float:
        """The order at which refined vertices around the vertex approach their limits.

        An eigenvector whose values are not those of its eigenfunction differs from them, after n
        refinements, by the n-th power of its eigenvalue.
        """
        step, ends = self.operator(), np.array([0.0, 1.0])
        alike = self.kind in ("interior", "cone")  # sectors, of which one is enough
        near = self.number[: 1 if alike else None, :2, :2]  # (k, 2, 2)
        limits = self.surface(np.zeros(self.size)).weights(
            np.arange(len(near))[:, None, None], ends[:, None], ends
        )
        gaps = np.eye(self.size)[near.ravel()] - limits.toarray()  # (4 k, M)
        blocks = [(step, gaps)]
        if alike:
            sectors = self.number[:, 1:].reshape(self.faces, 6)  # all but the vertex
            rows = np.concatenate([step[[0, *sectors[0]]], gaps])  # (11, M)
            waves = np.fft.rfft(rows[:, sectors], axis=1)  # (11, N // 2 + 1, 6)
            constant = np.concatenate([rows[:, :1], waves[:, 0].real], axis=1)
            blocks = [(constant[:7], constant[7:])]
            blocks += [(wave[1:7], wave[7:]) for wave in waves.swapaxes(0, 1)[1:]]
        slowest = 0.0
        for matrix, gap in blocks:
            eigenvalues, vectors = np.linalg.eig(matrix)
            moves = np.abs(gap @ vectors).max(axis=0) > 1e-6
            slowest = max(slowest, float(np.abs(eigenvalues[moves]).max(initial=0.0)))
        return -math.log2(slowest)

    def characteristic_map(self) -> Array:
        """Control points (M, 2) of the characteristic map.

        The first edge of a smooth vertex points along x, the crease of a dart too; an open sector
        lies above the x axis, from right to left.

        Raises
        ------
        ValueError
            Where there is no tangent plane.
        """
        table = self.basis.float64
        if not len(table.normal):
            raise ValueError(f"there is no tangent plane at {self.place}, so no characteristic map")
        step = self.operator()
        first, second = table.rates[0, table.normal].tolist()
        if abs(first - second) > _SAME and np.isin(table.normal, table.chains).any():
            raise ValueError(
                f"the tangent plane at {self.place} comes from a Jordan chain, not from "
                "two eigenfunctions: there is no characteristic map"
            )
        if abs(first - second) < _SAME:
            space = self._kernel(step, first, 2)
        else:
            space = np.concatenate([self._kernel(step, x, 1) for x in (first, second)])
        even = _largest(space + np.stack([self.mirrored(x) for x in space]))
        odd = _largest(space - np.stack([self.mirrored(x) for x in space]))
        x, y = (odd, even) if self.kind in ("crease", "corner") else (even, odd)
        # counter-clockwise, and as wide along both axes as it would be in the plane
        ring = self.number[:, 1, 0]
        if self.kind == "interior":
            turn = 2 * np.pi / self.faces
            return np.stack([x / x[ring[0]], y / y[ring[1]] * math.sin(turn)], axis=1)
        if self.kind == "corner" and self.faces == 1:  # the first quadrant
            x, y = x / x[ring[0]], y / y[ring[0]]
            x, y = y + x, y - x
        inner = self.number[:, :2, :2]
        x, y = x / np.abs(x[inner]).max(), y / np.abs(y[inner]).max()
        return np.stack([x * np.sign(x[ring[0]]), y * np.sign(y[self.number[0, 1, 1]])], axis=1)

    def _eigenvectors(self, matrix: Array) -> list[tuple[float, Array]]:
        """Real eigenvalues of a small matrix, each with one of its eigenvectors."""
        eigenvalues = np.linalg.eigvals(matrix)
        if len(matrix) and np.abs(eigenvalues.imag).max() > _SAME:
            raise ValueError(
                f"{self.basis.scheme.name} has complex eigenvalues at {self.place}, or "
                "too few eigenvectors; eigenfunctions need real ones, and all of them"
            )
        ordered = np.sort(eigenvalues.real)
        first = np.flatnonzero(np.diff(ordered, prepend=-np.inf) > 1e-6)
        found = []
        for group in np.split(ordered, first[1:]):
            _, sizes, vectors = np.linalg.svd(matrix - group.mean() * np.eye(len(matrix)))
            some = [k for k in range(-len(group), 0) if sizes[k] < _SAME]
            found += [(float(group.mean()), vectors[k]) for k in some]
        if len(found) < len(matrix):
            raise ValueError(
                f"{self.basis.scheme.name} has no basis of eigenvectors at {self.place}: "
                f"in one block {len(found)} of {len(matrix)}"
            )
        return found

    def _kernel(self, step: Array, eigenvalue: float, count: int) -> Array:
        """Eigenvectors (count, M) of one eigenvalue of the table."""
        _, sizes, vectors = np.linalg.svd(step - eigenvalue * np.eye(self.size))
        if not sizes[-count] < _SAME:
            raise ValueError(
                f"{self.basis.scheme.name} has fewer than {count} eigenfunctions of eigenvalue "
                f"{eigenvalue:.6g} at {self.place}: there is no characteristic map"
            )
        return np.asarray(vectors[-count:])


def predicted_order(surface: LimitSurface) -> float:
    """The order at which `limitsurf.validate` sees a surface approached, once it is settled.

    It is that of the slowest of its vertices, at most 2.
    """
    # what a crease carries is like what stays: the eigenvalue that it adds is 1/4, of order 2
    found = (s.still if s.carried else s for s in surface.patches.sectors if s is not None)
    sectors = {(s.kind, s.faces) for s in found}
    scheme = surface.rules["scheme"]
    return min([2.0, *(Fan(scheme, kind, faces).order() for kind, faces in sectors)])


def _largest(vectors: Array) -> Array:
    return np.asarray(vectors[np.argmax(np.linalg.norm(vectors, axis=1))])
