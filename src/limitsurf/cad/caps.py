"""How far cells at special corners of spline faces are from the limit: proved, and found.

``derivations/spline_faces.py`` has the bounds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cad import nets
from limitsurf.cad.poles import Poles
from limitsurf.cad.smooth import Fans, SmoothCaps, smooth_caps
from limitsurf.pieces import bernstein
from limitsurf.pieces.beyond import Beyond
from limitsurf.query import cones
from limitsurf.query.angles import between
from limitsurf.query.chords import length
from limitsurf.query.polynomials import Form
from limitsurf.scheme.lattice import Lattice
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

# rings inside each cell that are compared one by one: after so many it is seen whether the bound of
# what remains is larger than the others
_EVERY, _MOST_RINGS = 8, 64
# how often pieces are cut in halves until bounds are within a factor of what is found there
_SPLIT, _NEAR = 4, 1.5
_FLOOR = np.array([2.0**-44, 2.0**-44, 2.0**-26])  # of the size of a surface, and radians
_PIECES = 1024  # at once
_ROUNDED = 2.0**-49  # of the size of a surface, by which control points may be off
_SMALL = 256  # cells at once
_SLACK = 1 + 2.0**-40


@dataclass(frozen=True, eq=False)
class CapErrors:
    """Largest differences in cells at special corners, (r,) each, in the order of `Poles`.

    Attributes
    ----------
    parametric, along_normal, angle : (r,)
        Bounds; pi where there is none of the angle.
    parametric_found, along_normal_found, angle_found : (r,)
        The largest at places that were looked at.
    edge : (r,)
        Bounds of the angles across the side that begins at the corner, of cells that share tangent
        planes; NaN of others.
    """

    parametric: Array
    along_normal: Array
    angle: Array
    parametric_found: Array
    along_normal_found: Array
    angle_found: Array
    edge: Array


class Caps:
    """Cells at the special corners of a surface.

    Parameters
    ----------
    surface : LimitSurface
        Of points (n_vertices, d).
    poles : Poles
    smooth : bool
        Whether they share tangent planes around poles where that can be.

    Attributes
    ----------
    fans : Fans, or None
    """

    def __init__(self, surface: LimitSurface, poles: Poles, smooth: bool = False) -> None:
        topology, every = surface.topology, np.arange(len(surface.limit_faces))
        self._lattice = topology.lattice
        used = surface.mesh.indices
        size = np.abs(surface.points[used]).max(initial=0)
        self._power = -int(np.frexp(size)[1]) if np.isfinite(size) else 0
        points: Array = np.zeros(surface.points.shape)
        points[used] = np.ldexp(surface.points[used], self._power)
        self._start = poles.least - 1
        depth = np.full(len(every), self._start) - poles.half
        known = topology.patches, topology.rules.scheme
        self._beyond = Beyond(known[0], known[1], points, every, depth)
        degree = int(np.max(topology.rules.scheme.spline.exponents))
        self._form = Form.of(self._lattice, degree)
        self.fans = Fans(surface, poles, self._beyond) if smooth else None
        self._normals: cones.Poles | None = None
        self._in_space = points.shape[1:] == (3,)

    def smooth(self, which: Array, depth: Array) -> SmoothCaps | None:
        """Caps that share tangent planes, in cells of such depths; whole poles. In true size."""
        found = self._smooth(which, depth)
        if found is None:
            return None
        ring, inner = (np.ldexp(x, -self._power) for x in (found.ring, found.inner))
        return replace(found, ring=ring, inner=inner)

    def _smooth(self, which: Array, depth: Array) -> SmoothCaps | None:
        if self.fans is None:
            return None
        return smooth_caps(self._beyond, self.fans, which, depth - self._start)

    def errors(self, which: Array, depth: Array, normals: bool = True) -> CapErrors:
        """Errors of some, (r,), with cells of such depths.

        With smooth ones, of all corners of poles together.
        """
        found, smooth = np.zeros((6, len(which))), self._smooth(which, depth)
        normals = normals and self._in_space
        found[[1, 2, 4, 5]] = 0.0 if normals else np.nan
        if normals and self._normals is None:
            self._normals = cones.Poles(self._beyond, self._lattice, self._form)
        for start in range(0, len(which), _SMALL):
            some = slice(start, start + _SMALL)
            known = None
            if smooth is not None:
                known = smooth.there[some], smooth.ring[some], smooth.inner[some]
            found[:, some] = self._some(which[some], depth[some] - self._start, normals, known)
        found[:2] += 2.0**-46
        back = np.array([True, True, False] * 2)
        found[back] = np.ldexp(found[back], -self._power)
        found[[0, 1, 2]] *= _SLACK
        found[2] = np.minimum(found[2], np.pi)
        edge = np.full(len(which), np.nan)
        if smooth is not None:
            edge[smooth.there] = smooth.edge[smooth.there]
        return CapErrors(*found, *edge[None])

    def _some(
        self, which: Array, ring: Array, normals: bool, smooth: tuple[Array, ...] | None
    ) -> Array:
        """The same, (6, r), of cells that begin at a ring (r,) of what `Beyond` has."""
        beyond, form = self._beyond, self._form
        before = beyond.cells(which, ring - 1).points
        net = self._turned(_cap, which, before.reshape(len(which), -1, before.shape[-1]))
        found, last = np.zeros((6, len(which))), np.zeros((3, len(which)))
        active = np.arange(len(which))
        for inner in range(_MOST_RINGS):
            some, at = which[active], ring[active] + inner
            limit, own = beyond.cells(some, at).points, self._turned(_parts, some, net)
            # derivatives of the cell are moved by rounding of its own control points
            moved = _ROUNDED * form.degree * 0.5**inner
            own = own.reshape(limit.shape)
            if smooth is not None and inner == 0:
                own[smooth[0]] = smooth[1][smooth[0]]
            found[:, active] = self._ring(found[:, active], limit, own, moved, normals)
            net = self._turned(_last, some, net)
            if smooth is not None and inner == 0:
                net[smooth[0]] = smooth[2][smooth[0]]
            if inner % _EVERY == _EVERY - 1:
                moved = _ROUNDED * form.degree * 0.5 ** (inner + 1)
                last[:, active] = self._remaining(some, at + 1, net, moved, normals)
                # what is far below all else need not be known better
                far = last[:, active] > np.maximum(found[:3, active], _FLOOR[:, None])
                going = far.any(axis=0) if normals else far[0]
                active, net = active[going], net[going]
                if not len(active):
                    break
        np.maximum(found[:3], last, out=found[:3])
        return found

    def _ring(self, found: Array, limit: Array, own: Array, moved: float, normals: bool) -> Array:
        """Errors (6, r), of a ring of pieces (r, c, n, d) and those that were found before.

        Pieces of which bounds are far from what is found are cut in halves.
        """
        form, found = self._form, found.copy()
        owner = np.repeat(np.arange(limit.shape[0]), limit.shape[1])
        limit, own = (x.reshape(-1, form.size, x.shape[-1]) for x in (limit, own))
        split = bernstein.children(self._lattice, form.exponents)[1]
        known = np.full((3, len(owner)), np.inf)
        for step in range(_SPLIT + 1):
            errors = np.concatenate([
                self._compared(limit[k : k + _PIECES], own[k : k + _PIECES], moved, normals)
                for k in range(0, len(limit), _PIECES)
            ], axis=1)  # fmt: skip
            for k in range(3):
                np.maximum.at(found[3 + k], owner, errors[3 + k])
            helped = errors[:3] < 0.8 * known
            errors[:3] = known = np.minimum(errors[:3], known)  # rounding counts for more in parts
            near = np.maximum(found[3:, owner], _FLOOR[:, None]) * _NEAR
            bad = (errors[:3] > np.maximum(near, found[:3, owner])) & helped & (step < _SPLIT)
            bad = bad.any(axis=0) if normals else bad[0]
            for k in range(3):
                np.maximum.at(found[k], owner[~bad], errors[k, ~bad])
            if not bad.any():
                break
            owner, known = (np.repeat(x[..., bad], len(split), axis=-1) for x in (owner, known))
            limit, own = (
                np.matmul(split, x[bad][:, None]).reshape(-1, form.size, x.shape[-1])
                for x in (limit, own)
            )
        return found

    def _turned(self, matrix: Callable[..., Array], which: Array, net: Array) -> Array:
        """Matrices for each turn times coefficients (r, n, d), by the turn of each."""
        turn = self._beyond.corner(which)
        every = np.stack([matrix(self._lattice, self._form.degree, k)
                          for k in range(self._lattice.face_size)])  # fmt: skip
        known = every[turn]
        return np.asarray(np.matmul(known, net[:, None] if known.ndim == 4 else net))

    def _compared(self, limit: Array, own: Array, moved: float, normals: bool) -> Array:
        """Errors (6, L) of pieces (L, n, d) that should be the limit's.

        Numbers are relative to the limit of a corner, and so is what rounding takes from them, but
        for that of the control points themselves, by which derivatives are `moved`.
        """
        form, found = self._form, np.zeros((6, len(limit)))
        step = limit - own
        far = np.sqrt((step**2).sum(axis=2))
        found[0], found[3] = far.max(axis=1), far[:, form.corners].max(axis=1)
        if not normals:
            return found
        normal_form, pairs = cones.normal_form(self._lattice, form.degree)
        truth, off = cones.crossed(form, pairs, np.ldexp(limit, -_scale(limit)[:, None, None]))
        scale = _scale(own)
        scaled = np.ldexp(own, -scale[:, None, None])
        other, noise = cones.crossed(form, pairs, scaled)
        slack = 4 * form.degree * np.ldexp(moved, -scale) * length(scaled).max(axis=1)
        found[2], axis, wide = between(truth, off, other, noise, slack)
        with np.errstate(invalid="ignore", divide="ignore"):
            along = np.abs(np.matmul(step, axis[:, :, None])[:, :, 0]).max(axis=1)
            more = np.where(wide < np.pi / 2, along + 2 * np.sin(wide / 2) * found[0], found[0])
            found[1] = np.fmin(more, found[0])
            at = truth[:, normal_form.corners]
            at = at / length(at)[..., None]
            here = other[:, normal_form.corners]
            here = here / length(here)[..., None]
            found[4] = np.nan_to_num(np.abs((step[:, form.corners] * at).sum(2))).max(axis=1)
            angle = 2 * np.arctan2(length(at - here), length(at + here))
            found[5] = np.nan_to_num(angle).max(axis=1)
        return found

    def _remaining(
        self, which: Array, ring: Array, own: Array, moved: float, normals: bool
    ) -> Array:
        """Bounds (3, r) beyond a ring, where cells are `own` (r, n, d)."""
        found = np.zeros((3, len(which)))
        size = np.sqrt((own**2).sum(axis=2)).max(axis=1)
        if not normals or self._normals is None:
            far, _ = self._beyond.reach(which, ring, np.zeros((len(which), own.shape[2])))
            found[0] = far + size
            return found
        axis, narrow = self._normals.cones(which, ring)
        toward = np.nan_to_num(axis)
        far, along = self._beyond.reach(which, ring, toward)
        found[0] = far + size
        height = along + np.abs(np.matmul(own, toward[:, :, None])[:, :, 0]).max(axis=1)
        flat = height + 2 * np.sin(narrow / 2) * found[0]
        found[1] = np.where(narrow < np.pi / 2, np.minimum(flat, found[0]), found[0])
        pairs = cones.normal_form(self._lattice, self._form.degree)[1]
        scale = _scale(own)
        scaled = np.ldexp(own, -scale[:, None, None])
        other, noise = cones.crossed(self._form, pairs, scaled)
        slack = 4 * self._form.degree * np.ldexp(moved, -scale) * length(scaled).max(axis=1)
        found[2] = narrow + cones.cone(other, noise + slack, axis)
        return found


def _scale(net: Array) -> Array:
    """Powers of two (r,) of the sizes of control points (r, n, d)."""
    size = np.abs(net).max(axis=(1, 2), initial=0)
    return np.asarray(np.frexp(np.where(np.isfinite(size), size, 0.0))[1], dtype=np.int64)


@lru_cache(maxsize=64)
def _cells(lattice: Lattice, turn: int) -> tuple[Array, Array]:
    """Origins and sizes (c, 2) of the first ring of a square or triangle around a corner."""
    sign = np.array([-1 if piece.turned else 1 for piece in lattice.pieces])[:, None]
    origin = 0.5 * np.array([piece.origin for piece in lattice.pieces])[None]
    size = (0.5 * sign * np.ones(2))[None]
    one, other = bernstein.turned_cells(lattice, origin, size, np.array([turn]))
    return one[0], other[0]


@lru_cache(maxsize=64)
def _cap(lattice: Lattice, degree: int, turn: int) -> Array:
    """Coefficients (n, c * n) of the cell within a ring from those of its pieces."""
    origin, size = _cells(lattice, turn)
    none = np.zeros((1, 0), dtype=np.int64)
    half = np.full(2, 0.5)
    at = np.array(lattice.corners)[turn] * half
    known = none[0], none, none, origin, size, at[None], half[None], np.array([turn])
    return np.asarray(nets.caps(nets.Cut(*known), lattice, degree).toarray()[:, :-1])


@lru_cache(maxsize=64)
def _parts(lattice: Lattice, degree: int, turn: int) -> Array:
    """Coefficients (c, n, n) in the first ring of a square or triangle."""
    exponents = Form.of(lattice, degree).exponents
    return bernstein.blossoms(exponents, _frames(*_cells(lattice, turn)))


@lru_cache(maxsize=64)
def _last(lattice: Lattice, degree: int, turn: int) -> Array:
    """Coefficients (n, n) in what remains within the first ring."""
    origin, size = 0.5 * np.array(lattice.corners)[[turn]], np.full((1, 2), 0.5)
    return np.asarray(
        bernstein.blossoms(Form.of(lattice, degree).exponents, _frames(origin, size))[0]
    )


def _frames(origin: Array, size: Array) -> Array:
    found = np.zeros((len(origin), 3, 2))
    found[:, 0], found[:, 1, 0], found[:, 2, 1] = origin, size[:, 0], size[:, 1]
    return found


def depths_within(
    caps: Caps, poles: Poles, tolerance: float | None, angle: float | None, most: int
) -> Array:
    """The least depths (r,) found at which errors are within a tolerance, and an angle in radians.

    Of all faces around a pole together; 0 and more above the least, but no more than `most`.

    Raises
    ------
    ValueError
        Where `most` does not do, with the first such limit face.
    """
    _, which = np.unique(poles.pole, return_inverse=True)
    n = int(which.max(initial=-1)) + 1
    depth, pending = np.full(n, poles.least), np.arange(n)
    known, at = np.full(n, np.nan), np.zeros(n, dtype=np.int64)
    while len(pending):
        mask = np.zeros(n, dtype=bool)
        mask[pending] = True
        some = np.flatnonzero(mask[which])
        errors = caps.errors(some, depth[which[some]], angle is not None)
        over = np.zeros(n)
        for value, asked in ((errors.parametric, tolerance), (errors.angle, angle)):
            if asked is not None:
                if value is errors.angle:  # where tangent planes are shared, normals do not jump
                    value = np.where(np.isfinite(errors.edge), 0, value)
                np.maximum.at(over, which[some], np.where(np.isnan(value), 0, value) / asked)
        late = pending[over[pending] > 1]
        bad = late[depth[late] >= most]
        if len(bad):
            face = poles.face[np.flatnonzero(which == bad[0])[0]]
            raise ValueError(
                f"limit face {face} is not within what is asked with cells of 2^-{most} of an "
                "edge, and knots closer to each other are of no use: ask for less"
            )
        # no faster than at valence 3, until the rate is known
        with np.errstate(invalid="ignore", divide="ignore"):
            rate = np.log(known[late] / over[late]) / (depth[late] - at[late])
        rate = np.where((rate > 0.05) & (rate < 1), rate, 1.0)
        known[late], at[late] = over[late], depth[late]
        step = np.maximum(1, np.ceil(0.98 * np.log(over[late]) / rate)).astype(np.int64)
        depth[late] = np.minimum(depth[late] + step, most)
        pending = late
    return np.asarray(depth[which])
