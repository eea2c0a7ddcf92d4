"""Eigenfunctions of subdivision around a vertex, as limit surfaces of cages of their own.

The two-ring of a vertex holds all control points of the faces around it, and one step of refinement
makes the two-ring of half the size from it. An eigenvector of that step is a cage whose limit is an
eigenfunction: exactly the same at half the parameters, times its eigenvalue. On the control points
of each face it is an eigenvector of the table of that face, from which it is put together here;
derived in ``derivations/eigenfunctions.py``, section 7.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.mesh import Mesh
from limitsurf.scheme.dual import DualScheme
from limitsurf.scheme.net import Net
from limitsurf.spectra.basis import eigenbasis
from limitsurf.surface import LimitSurface
from limitsurf.tables import EigenTable, FourierRing, Sector, eigen_table, grid_index

if TYPE_CHECKING:
    from limitsurf.scheme.scheme import Scheme

Array: TypeAlias = NDArray[Any]


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
    """The two-ring of a vertex: k sectors of 4 faces, the vertex at corner 0 of the inner ones.

    Sector s lies between axes s and s + 1; its point (i, j) is i steps along the one and j along
    the other. In triangles, i + j is at most 2, and what is beyond repeats (1, 1). Limit face s is
    the inner face of sector s, with u along axis s.

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
        sector = self.basis.sector
        self.place = sector.place
        self.lattice = sector.lattice
        self.corners = self.lattice.corners
        net = Net(self.lattice, 2)
        self._own = sorted(zip(*(x.tolist() for x in net.steps), strict=True))
        axes = faces + sector.open
        s = np.arange(faces)
        number = np.zeros((faces, 3, 3), dtype=np.int64)
        steps = np.arange(1, 3)
        number[:, 1:, 0] = 1 + 2 * s[:, None] + steps - 1
        number[:, 0, 1:] = 1 + 2 * ((s + 1) % axes)[:, None] + steps - 1
        inside = [place for place in self._own if 0 not in place]
        for k, (i, j) in enumerate(inside):
            number[:, i:, j:] = (1 + 2 * axes + len(inside) * s + k)[:, None, None]
        self.number = number  # (k, 3, 3)
        u, v = net.steps
        cells = number[:, u, v][:, net.cells]
        # inner faces first: their numbers are those of the sectors
        self._cells = np.concatenate([cells[:, 0], *cells[:, 1:]])
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

    def limit(self, values: Array) -> Any:
        """What evaluates that on the sectors, whose corner 0 is the vertex."""
        return self.surface(values)

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
            Around another vertex; where eigenvectors are missing, as they are at valence 2, and can
            be of a scheme of your own.
        """
        if self.kind != "interior":
            raise ValueError(f"modes are those of a smooth vertex, not of {self.place}")
        chains, found = self.basis.float64.chains, []
        if len(chains):
            raise ValueError(
                f"{self.basis.scheme.name} has no basis of eigenvectors at {self.place}: "
                f"{len(chains)} of {self.basis.float64.size} are missing"
            )
        for eigenvalue, f, sine, near in [*self._waves(), *self._outer_waves()]:
            values = self._joined(near)
            values /= values[np.argmax(np.abs(values).round(9))]
            found.append(Mode(eigenvalue, f, bool(sine), 0 < 2 * f < self.faces, values))
        return sorted(found, key=lambda m: (-round(abs(m.eigenvalue), 9), m.frequency, m.sine))

    def _joined(self, near: Array) -> Array:
        """Values (M,) from those at the points of the sectors, (k, 3, 3)."""
        values = np.empty(self.size)
        values[self.number] = near
        return values

    def _table(self, position: int) -> tuple[EigenTable, Array]:
        """The table of one face, and its vectors at the points of the sector, (3, 3, K)."""
        basis = eigenbasis(self.scheme, kind=self.kind, faces=self.faces, position=position)
        at = grid_index(basis.sector)
        points = ((i, j) if (i, j) in self._own else (1, 1) for i in range(3) for j in range(3))
        rows = basis.float64.right_rows([at[1 + i, 1 + j] for i, j in points])
        return basis.float64, rows.reshape(3, 3, -1)

    def _waves(self) -> Iterator[tuple[float, int, int, Array]]:
        """Eigenfunctions that do not vanish on the ring of a smooth vertex.

        Eigenvalue, frequency, whether it is odd about the first edge, values (N, 3, 3). The table
        has cosines and sines about the middle of the first face, half a face from that edge.
        """
        table, near = self._table(0)
        ring, N, place = table.ring, self.faces, np.argsort(table.order)
        assert isinstance(ring, FourierRing)
        for mode, (f, parity) in enumerate(zip(ring.frequency, ring.parity, strict=True)):
            k, eigenvalue = place[mode], float(table.rates[0, place[mode]])
            paired = 0 < 2 * f < N  # the sine follows its cosine
            if paired and parity:
                continue
            turn = np.pi * f / N * (1 + 2 * np.arange(N))[:, None, None]
            cosine = near[..., k] * (not parity)
            sine = near[..., place[mode + 1]] if paired else near[..., k] * parity
            even = np.cos(turn) * cosine - np.sin(turn) * sine
            odd = np.sin(turn) * cosine + np.cos(turn) * sine
            if paired or f == 0 or parity:
                yield eigenvalue, int(f), 0, even
            if paired or (f > 0 and not parity):
                yield eigenvalue, int(f), 1, odd

    def _outer_waves(self) -> Iterator[tuple[float, int, int, Array]]:
        """As `_waves`, those that vanish on the ring: waves of what is of one axis, or one face."""
        N, s = self.faces, np.arange(self.faces)[:, None, None]
        for eigenvalue, here, sign in self._outer():
            for f in range(N // 2 + 1):
                for sine, wave in enumerate((np.cos, np.sin)):
                    # of a sine in the middle of a wave, or of a cosine between, nothing is left
                    if (f == 0 and sine) or (2 * f == N and bool(sine) == bool(sign)):
                        continue
                    if sign:
                        first, last = (wave(2 * np.pi * f / N * x) for x in (s, s + 1))
                        values = first * here + sign * last * here.T
                        yield eigenvalue, f, sine ^ (sign < 0), values
                    else:
                        before, own, after = (wave(np.pi * f / N * (2 * s + x)) for x in (-1, 1, 3))
                        values = own * here
                        # an axis has something of the faces on both its sides
                        values[:, 1:, :1] += before * here[:1, 1:].T
                        values[:, :1, 1:] += after * here[1:, :1].T
                        yield eigenvalue, f, sine, values

    def _outer(self) -> Iterator[tuple[float, Array, int]]:
        """What vanishes on the ring, and is of the first axis or the first face alone.

        Its eigenvalue, its values (3, 3), and its sign when mirrored at the axis, 0 for the face.
        """
        table, near = self._table(0)
        at = grid_index(self.basis.sector)
        outer = np.flatnonzero(table.order >= self.basis.sector.ring)
        # across the first axis, across the other one
        beyond, far = table.right_rows([at[3, 0], at[0, 3]])
        mixed = outer[:0]
        if self.lattice.sloped:
            # functions of several faces have one eigenvalue: the sum that is of the first alone
            across = np.stack([near[1, 1], beyond, far])
            mixed = outer[across[:, outer].any(axis=0)]
            weights = np.linalg.solve(across[:, mixed], [1.0, 0.0, 0.0])
            yield float(table.rates[0, mixed[0]]), near[..., mixed] @ weights, 0
        for k in np.setdiff1d(outer, mixed):
            here, eigenvalue = near[..., k], float(table.rates[0, k])
            if here[0, 2] or here[1, 2]:  # of the other axis of this face
                continue
            of_axis = here[2, 0] or here[2, 1]
            mirrored = -1 if beyond[k] * here[2, 1] < 0 else 1
            yield eigenvalue, here, mirrored if of_axis else 0

    def characteristic_map(self) -> Array:
        """Control points (M, 2) of the characteristic map.

        The first edge of a smooth vertex points along x, the crease of a dart too; an open sector
        lies above the x axis, from right to left.

        Raises
        ------
        ValueError
            Where there is no tangent plane, or none of two eigenfunctions.
        """
        table = self.basis.float64
        if not len(table.normal) or self.basis.sector.carried:
            raise ValueError(f"there is no tangent plane at {self.place}, so no characteristic map")
        # heads of chains look like the eigenfunctions of their ends, towards the vertex
        pair = table.normal_pairs[1]
        first, second = table.rates[0, pair].tolist()
        if pair[0] == pair[1] or (first != second and np.isin(table.normal, table.chains).any()):
            raise ValueError(
                f"the tangent plane at {self.place} comes from a Jordan chain, not from "
                "two eigenfunctions: there is no characteristic map"
            )
        if self.kind == "interior":
            return self._smooth_map()
        space, numbers = np.empty((2, *self.number.shape)), table.order[pair]
        for p in range(self.faces):  # all positions have the same vectors of the ring
            own, near = self._table(p)
            space[:, p] = np.moveaxis(near[..., np.argsort(own.order)[numbers]], -1, 0)
        space = np.stack([self._joined(x) for x in space])
        even = _largest(space + np.stack([self.mirrored(x) for x in space]))
        odd = _largest(space - np.stack([self.mirrored(x) for x in space]))
        x, y = (odd, even) if self.basis.sector.open else (even, odd)
        # counter-clockwise, and as wide along both axes as it would be in the plane
        ring = self.number[:, 1, 0]
        if self.kind == "corner" and self.faces == 1:  # the first quadrant
            x, y = x / x[ring[0]], y / y[ring[0]]
            x, y = y + x, y - x
        inner = self.number[:, :2, :2]
        x, y = x / np.abs(x[inner]).max(), y / np.abs(y[inner]).max()
        return np.stack([x * np.sign(x[ring[0]]), y * np.sign(y[self.number[0, 1, 1]])], axis=1)

    def _smooth_map(self) -> Array:
        """The characteristic map of a smooth vertex, as wide along both axes as in the plane."""
        slowest = self.basis.float64.rates[0, self.basis.float64.normal[0]]
        x, y = (
            self._joined(near) for value, f, _, near in self._waves() if (value, f) == (slowest, 1)
        )
        ring, turn = self.number[:, 1, 0], 2 * np.pi / self.faces
        return np.stack([x / x[ring[0]], y / y[ring[1]] * math.sin(turn)], axis=1)


def order_at(scheme: str | Scheme, kind: str, faces: int) -> float:
    """The order at which refined vertices around a vertex approach their limits.

    An eigenvector whose values are not those of its eigenfunction differs from them, after n
    refinements, by the n-th power of its eigenvalue.
    """
    slowest = 0.0
    alike = eigenbasis(scheme, kind=kind, faces=faces).sector.alike
    for position in range(1 if alike else faces):
        basis = eigenbasis(scheme, kind=kind, faces=faces, position=position)
        if isinstance(basis.scheme, DualScheme):
            slowest = max(slowest, _slowest_dual(basis.scheme, basis.sector))
            continue
        table, lattice, at = basis.float64, basis.scheme.lattice, grid_index(basis.sector)
        points = table.right_rows([at[1 + i, 1 + j] for i, j in lattice.corners])
        limits, bound = np.zeros_like(points), np.abs(points)
        limits[0, 0] = 1  # the constant alone does not vanish at the vertex
        origins, far = [piece.origin for piece in table.places], 2**table.halvings - 1
        for k, corner in enumerate(lattice.corners[1:], 1):  # as it is of the piece there
            powers = np.prod(np.power(corner, basis.scheme.spline.exponents), axis=1)
            piece = table.pieces[origins.index((far * corner[0], far * corner[1]))]
            limits[k], bound[k] = powers @ piece, bound[k] + powers @ np.abs(piece)
        # both were rounded once and added up
        rounding = np.finfo(float).eps * len(basis.scheme.spline.exponents)
        moves = (np.abs(points - limits) > rounding * bound).any(axis=0)
        slowest = max(slowest, float(np.abs(table.rates[0, moves]).max(initial=0.0)))
    return -math.log2(slowest)


def _slowest_dual(scheme: DualScheme, sector: Sector) -> float:
    """The largest eigenvalue of a vector whose value in a square is not that in its middle."""
    sector = replace(sector, gathered=scheme.gathers(sector.faces))
    table = eigen_table(scheme, sector)
    (value,) = table.right_rows([grid_index(sector)[1, 1]])
    piece = [child.origin for child in scheme.lattice.pieces].index((1, 1))
    limit = table.pieces[piece, scheme.spline.exponents.index((0, 0))]
    rounding = 16 * np.finfo(float).eps
    moves = np.abs(value - limit) > rounding * (np.abs(value) + np.abs(limit))
    moves[0] = False
    return float(np.abs(table.rates[0, moves]).max(initial=0.0))


def predicted_order(surface: LimitSurface) -> float:
    """The order at which `limitsurf.validate` sees a surface approached, once it is settled.

    It is that of the slowest of its vertices, at most 2.
    """
    # what a crease carries is like what stays: the eigenvalue that it adds is 1/4, of order 2
    found = (s.still if s.carried else s for s in surface.patches.sectors if s is not None)
    sectors = {(s.kind, s.faces) for s in found}
    scheme = surface.rules["scheme"]
    return min([2.0, *(order_at(scheme, kind, faces) for kind, faces in sectors)])


def _largest(vectors: Array) -> Array:
    return np.asarray(vectors[np.argmax(np.linalg.norm(vectors, axis=1))])
