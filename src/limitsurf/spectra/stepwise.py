"""What spectra say of schemes without polynomial pieces: waves, and characteristic maps by bounds.

The characteristic map of such a scheme has no Bernstein coefficients. But a triangle amid regular
vertices has derivatives that differ from known numbers by no more than bounds times what is not
linear, or not quadratic, of the points around it, which vanishes as triangles are cut. So signs of
Jacobians and directions are decided, as those of polynomials are. Derived in
``derivations/stepwise.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.mesh import Mesh
from limitsurf.engine.ground import Ground
from limitsurf.engine.ternary import ORIGIN, SIGN, Kinds, kinds_of, quadratic
from limitsurf.exact.analysis import curvature_rank
from limitsurf.exact.fixed import EQUAL, mp
from limitsurf.exact.waves import Wave, wave_spectrum
from limitsurf.numbers import FLOAT64
from limitsurf.refine.local_steps import local_steps
from limitsurf.refine.neighbourhoods import lattice_places
from limitsurf.rules import Rules
from limitsurf.scheme.scheme import Scheme
from limitsurf.tables import CurvatureMode, Verdicts
from limitsurf.topology import child_mesh

Array = NDArray[Any]

_CUTS = 12  # of triangles whose sign is not decided
_MOST = 1 << 16  # of these at a time
_NOISE = 1e-9  # of the size of the map, far above rounding errors

# By how much derivatives of butterfly limits on a triangle differ from its sides for each of the 24
# points off its plane, at most, in hundredths: along u, and along v
BUTTERFLY = np.reshape(
    [
     93, 97, 64, 63, 64, 67, 97, 63, 93, 13, 38, 39, 12, 37, 24, 11, 12, 25, 39, 25, 38, 11, 37, 13,
     63, 67, 63, 93, 93, 97, 97, 64, 64, 11, 25, 25, 11, 37, 37, 13, 13, 38, 38, 39, 39, 12, 24, 12,
    ],
    (2, 24),
)  # fmt: skip
# of sqrt(3): what all steps after one change in the derivatives of a quadratic, at most, for what
# is no quadratic in the 27 points
_SQRT3 = 3.6


class _Halved:
    """Triangles that are cut into four."""

    parts = 4
    origins = np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) / 2
    signs = np.array([1, 1, 1, -1]) / 2

    def __init__(self, scheme: Scheme, valence: int) -> None:
        rules = Rules(scheme, "edge_and_corner", "uniform", "catmull-clark")
        self._steps = local_steps(rules, FLOAT64)
        mesh = _disk(valence)
        for _ in range(2):
            mesh = child_mesh(mesh, np.zeros((mesh.n_vertices + mesh.n_edges, 0)), scheme.lattice)
        first = np.flatnonzero(mesh.indices == 0)[:1]
        self.kind = int(self._steps.kinds.of(mesh, first)[0][0])
        while (below := self._steps.child(self.kind, 0)) != self.kind:
            self.kind = below
        self.size = self._steps.kinds.known[self.kind].n_points

    def map(self, kind: int, part: int) -> tuple[int, Array, Array]:
        """The kind of a part, its differences and first point over those of the whole."""
        one = self._steps.kinds.expanded(kind)
        rows = one.steps[part]
        return int(one.children[part]), rows[1:, 1:] - rows[:1, 1:], rows[0, 1:]

    def regular(self, steps: Array) -> tuple[Array, Array]:
        """Derivatives (n, 2, 2) of regular pieces, of both coordinates, and bounds of errors."""
        off = self._steps.differences(0) @ steps
        return off[:, :2], np.einsum("aj,njd->nad", BUTTERFLY / 100, np.abs(off[:, 2:]))

    def limit(self, steps: Array) -> Array:
        """Where corner 0 goes, less the first point."""
        return np.zeros((len(steps), 2))


class _Turned:
    """Triangles that two steps cut into nine."""

    parts = 9
    origins = ORIGIN / 3
    signs = SIGN / 3

    def __init__(self, scheme: Scheme, valence: int) -> None:
        rules = Rules(scheme, "edge_and_corner", "uniform", "catmull-clark")
        self._kinds = kinds_of(rules)
        tiny, none = np.array([1e-9]), np.array([0])
        self.kind = int(Ground(_disk(valence), rules).begin(none, none, tiny, tiny)[0][0])
        self.size = self._kinds.known[self.kind].size

    def map(self, kind: int, part: int) -> tuple[int, Array, Array]:
        """See `_Halved`."""
        return self._kinds.parts(kind)[part], *self._kinds.map(kind, part)

    def regular(self, steps: Array) -> tuple[Array, Array]:
        """See `_Halved`."""
        corners = np.array([[0.0, 0], [1, 0], [0, 1]])
        _, *rows = quadratic(*corners.T)
        found = np.einsum("akj,njd->akdn", np.array(rows), steps[:, :6]).transpose(3, 0, 1, 2)
        low, high = found.min(axis=2), found.max(axis=2)
        off = np.abs(_off_quadratics(self._kinds) @ steps).max(axis=1)  # (n, 2)
        return (low + high) / 2, (high - low) / 2 + _SQRT3 * off[:, None]

    def limit(self, steps: Array) -> Array:
        """See `_Halved`."""
        return np.asarray(steps[:, :6].sum(axis=1) / 12)


@lru_cache(maxsize=1)
def _off_quadratics(kinds: Kinds) -> Array:
    """What differences around a regular triangle have beside the quadratic through six points."""
    one = kinds.known[0]
    places = lattice_places(one.faces, one.size)
    assert places is not None
    x, y = places.T
    monomials = np.stack([x**0, x, y, x * x, x * y, y * y], axis=1)
    six = [[0, 0], [1, 0], [0, 1], [1, 1], [-1, 1], [1, -1]]
    base = [int(np.flatnonzero((places == place).all(axis=1))[0]) for place in six]
    through = np.rint(monomials @ np.linalg.inv(monomials[base].astype(float)))
    matrix = np.eye(one.size)
    matrix[:, base] -= through
    return np.asarray(matrix[:, 1:])


def _disk(valence: int) -> Mesh:
    """Triangles around a vertex."""
    ring = np.arange(valence)
    faces = np.stack([np.zeros_like(ring), ring + 1, (ring + 1) % valence + 1], axis=1)
    return Mesh(np.zeros((valence + 1, 0)), faces)


class Waves(NamedTuple):
    """What is known of a smooth vertex.

    Attributes
    ----------
    groups : list of (eigenvalue, waves)
        The different eigenvalues, by decreasing modulus, and what belongs to each.
    verdicts : Verdicts
    size : int
        The number of points that a face with this corner depends on.
    own : float
        The weight of the vertex in its limit.
    """

    groups: list[tuple[float | complex, list[Wave]]]
    verdicts: Verdicts
    size: int
    own: float


@lru_cache(maxsize=256)
def waves_of(scheme: Scheme, valence: int) -> Waves:
    """What the spectrum at a smooth vertex decides.

    Raises a ValueError, `UnsupportedSpectrum`, for masks that do not converge there.
    """
    found = wave_spectrum(scheme, valence)
    rest = found.waves[1:]
    first = rest[0]
    # a pair of waves that go around in both directions, and nothing else of that size
    pair = (
        0 < 2 * first.frequency < valence
        and first.jordan == (1,)
        and isinstance(first.value, mp.mpf)
        and first.value > EQUAL
        and abs(rest[1].value) < first.value - EQUAL
    )
    regular, turns, curvature = None, None, list[CurvatureMode]()
    if pair:
        regular, turns = characteristic_map(scheme, valence, first.frequency)
        curvature = list(_by_frequency(rest[1:], first.value))
    values = (float(first.value),) * 2 if pair else ()
    verdicts = Verdicts(values, regular, turns, tuple(curvature), exact=bool(pair))
    return Waves(_groups(found.waves), verdicts, pieces_of(scheme, valence).size, float(found.own))


def _groups(waves: tuple[Wave, ...]) -> list[tuple[float | complex, list[Wave]]]:
    groups: list[tuple[Any, list[Wave]]] = []
    for wave in waves:
        same = [some for value, some in groups if abs(value - wave.value) < EQUAL]
        if same:
            same[0].append(wave)
        else:
            groups.append((wave.value, [wave]))
    return [(complex(v) if isinstance(v, mp.mpc) else float(v), some) for v, some in groups]


def _by_frequency(waves: tuple[Wave, ...], second: Any) -> Iterator[CurvatureMode]:
    """The wave of each frequency that outweighs its others in the curvature."""

    def weight(wave: Wave) -> tuple[Any, bool]:
        return mp.nint(abs(wave.value) / EQUAL), wave.jordan[0] > 1

    most = max(map(weight, waves))
    for f in sorted({wave.frequency for wave in waves}):
        wave = max((one for one in waves if one.frequency == f), key=weight)
        complex_ = isinstance(wave.value, mp.mpc)
        yield CurvatureMode(
            f,
            float(abs(wave.value) if complex_ else wave.value),
            float(abs(wave.value) / second**2),
            curvature_rank(wave.value, second),
            wave.jordan[0] > 1,
            wave.outer,
            weight(wave) == most,
        )


@lru_cache(maxsize=64)
def pieces_of(scheme: Scheme, valence: int) -> _Halved | _Turned:
    """How triangles at a vertex of that valence are cut."""
    return (_Turned if scheme.turns_edges else _Halved)(scheme, valence)


@dataclass
class _Pieces:
    """Triangles of one kind.

    Attributes
    ----------
    kind : int
    steps : (n, m, 2)
        Differences of the points around from the first, of the characteristic map.
    first : (n, 2)
        The first point.
    origin : (n, 2)
        Where corner 0 is in the face at the vertex.
    scale : (n,)
        Of the sides; negative if the triangle is turned by half a turn.
    """

    kind: int
    steps: Array
    first: Array
    origin: Array
    scale: Array

    def cut(self, how: _Halved | _Turned, parts: range) -> Iterator[_Pieces]:
        """Their parts, of each number."""
        for part in parts:
            kind, own, shift = how.map(self.kind, part)
            origin = self.origin + self.scale[:, None] * how.origins[part]
            first = self.first + np.einsum("m,nmd->nd", shift, self.steps)
            yield _Pieces(kind, own @ self.steps, first, origin, self.scale * how.signs[part])

    def some(self, which: Array) -> _Pieces:
        """Those."""
        rest = (x[which] for x in (self.steps, self.first, self.origin, self.scale))
        return _Pieces(self.kind, *rest)

    def bounds(self, how: _Halved | _Turned) -> tuple[Array, Array]:
        """The signs of Jacobians (n,), 0 where they are not known, and the images: circles (n, 3).

        Of both derivatives there are intervals for each coordinate.
        """
        middle, error = how.regular(self.steps)
        error = error + _NOISE * np.abs(middle).max(axis=(1, 2), keepdims=True)
        ends = np.stack([middle - error, middle + error])  # (2, n, derivative, coordinate)
        one, other = (
            (ends[:, None, :, 0, i] * ends[None, :, :, 1, 1 - i]).reshape(4, -1) for i in (0, 1)
        )
        low = one.min(axis=0) - other.max(axis=0)
        high = one.max(axis=0) - other.min(axis=0)
        low_at = np.minimum(ends[0].min(axis=1), 0)
        high_at = np.maximum(ends[1].max(axis=1), 0)
        centre = self.first + how.limit(self.steps) + (low_at + high_at) / 2
        radius = np.linalg.norm(high_at - low_at, axis=1) / 2
        sign = np.where(low > 0, 1, np.where(high < 0, -1, 0))
        return sign, np.concatenate([centre, radius[:, None]], axis=1)


def characteristic_map(scheme: Scheme, valence: int, frequency: int) -> tuple[bool | None, float]:
    """Whether the map of a pair of waves is regular, and how often it goes around the vertex.

    None and NaN where that is not decided.
    """
    how = pieces_of(scheme, valence)
    _, own, _ = how.map(how.kind, 0)
    values, vectors = np.linalg.eig(own)
    which = np.argsort(-np.abs(values))[:2]
    both = np.hstack([vectors[:, which].real, vectors[:, which].imag])
    plane = np.linalg.svd(both, full_matrices=False)[0][:, :2]
    turn = 2 * np.pi * frequency / valence
    plane = plane @ np.linalg.inv(plane[:2]) @ [[1, 0], [np.cos(turn), np.sin(turn)]]
    whole = _Pieces(how.kind, plane[None], np.zeros((1, 2)), np.zeros((1, 2)), np.ones(1))
    pieces = list(whole.cut(how, range(1, how.parts)))
    signs: set[int] = set()
    rim: list[Array] = []  # (place along the far side, direction, half of an angle around it)
    for _ in range(_CUTS):
        later: list[_Pieces] = []
        for one in pieces:
            rest = one
            if one.kind == 0:
                sign, images = one.bounds(how)
                done, found = _directions(one, images)
                done &= sign != 0
                signs |= {*sign[sign != 0].tolist()}
                rim += [found[done[found[:, 0].astype(int)], 1:]]
                rest = one.some(~done)
            if len(signs) > 1:
                return False, math.nan
            if len(rest.first):
                later += rest.cut(how, range(how.parts))
        if not later:
            return True, _turns(np.concatenate(rim), valence, turn)
        if sum(len(one.first) for one in later) > _MOST:
            break
        pieces = _joined(later)
    return None, math.nan


def _directions(pieces: _Pieces, images: Array) -> tuple[Array, Array]:
    """Which pieces are done as to directions from 0, and those of the far side.

    These are (which, place along the side, direction, half of an angle around it).
    """
    corners = pieces.origin[:, None] + pieces.scale[:, None, None] * np.array(
        [[0, 0], [1, 0], [0, 1]]
    )
    on = np.abs(corners.sum(axis=2) - 1) < 1e-9
    far = np.flatnonzero(on.sum(axis=1) == 2)
    centre, radius = images[far, :2], images[far, 2]
    with np.errstate(invalid="ignore", divide="ignore"):
        wide = radius / np.linalg.norm(centre, axis=1)
    known = wide < 0.5
    done = np.ones(len(pieces.first), dtype=bool)
    done[far[~known]] = False
    place = (corners[far, :, 1] * on[far]).sum(axis=1) / 2
    angle = np.arctan2(centre[:, 1], centre[:, 0])
    half = np.arcsin(np.where(known, wide, 0))
    return done, np.stack([far, place, angle, half], axis=1)[known]


def _turns(rim: Array, valence: int, turn: float) -> float:
    """How often a map goes around, by directions along the far side of one face.

    From one piece to the next they turn by less than half a turn, and in all by `turn`, up to whole
    turns.
    """
    _, angle, half = rim[np.argsort(rim[:, 0])].T
    swept = float(np.sum((np.diff(angle) + np.pi) % (2 * np.pi) - np.pi))
    whole = round((swept - turn) / (2 * np.pi))
    assert abs(swept - turn - 2 * np.pi * whole) <= half[0] + half[-1] + 1e-6
    return valence * (turn / (2 * np.pi) + whole)


def _joined(pieces: list[_Pieces]) -> list[_Pieces]:
    """Those of one kind together."""
    kinds = {one.kind: [other for other in pieces if other.kind == one.kind] for one in pieces}
    return [
        _Pieces(
            kind, *(
                np.concatenate([getattr(one, name) for one in some])
                for name in ("steps", "first", "origin", "scale")
            ),
        )
        for kind, some in kinds.items()
    ]  # fmt: skip
