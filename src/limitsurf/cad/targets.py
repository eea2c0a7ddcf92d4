"""What a cage is fitted to: points that were given, or samples of a surface and its sharp edges."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cad.features import crease_points
from limitsurf.cad.feet import SharpEdges
from limitsurf.cage.mesh import Mesh
from limitsurf.fem.checks import reals
from limitsurf.query.index import checked_surface
from limitsurf.query.samples import sample
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

KINDS = {"": 0, "boundary": 1, "crease": 2}
ANY = 3  # a boundary or a crease
_AROUND = 24  # neighbours that say whether a point is at the end of a sheet
_GAP = np.deg2rad(160)  # without a neighbour: of 24 in a plane at random one in 30 000 has it
_EACH = 5  # samples along an edge of the cage, at least
_SAMPLES = 20_000


@dataclass(frozen=True)
class Target:
    """Points (n, 3), weights (n,) or None, normals (n, 3) or None, and kinds (n,)."""

    points: Array
    weights: Array | None
    normals: Array | None
    kinds: Array

    told: bool  # whether somebody said on which edges points are
    detect: bool = False  # whether sharp edges of the points are to be found

    @classmethod
    def of(cls, points: Any, normals: Any, weights: Any, edges: Any, rng: Any) -> Target:
        """What `fit` is given, checked."""
        if isinstance(points, (Mesh, LimitSurface)):
            named = {"normals": normals, "weights": weights}
            if extra := [name for name, value in named.items() if value is not None]:
                raise ValueError(
                    f"{extra[0]} are of points: to a surface its own samples are fitted"
                )
            return cls._of_surface(points, edges, rng)
        found = _columns("points", points, 3)
        if not len(found):
            raise ValueError("points must be one or more, got none")
        n = len(found)
        finite = np.asarray(np.isfinite(found).all(axis=1))
        if not finite.any():
            raise ValueError(f"points must be finite, got {n} of which none is")
        if weights is not None:
            weights = reals("weights", weights)
            if weights.shape != (n,):
                raise ValueError(
                    f"weights must be of shape ({n},), one for each point, got {weights.shape}"
                )
            wrong = np.flatnonzero(~(weights >= 0) | np.isinf(weights))
            if len(wrong):
                raise ValueError(
                    f"weights must be finite and >= 0, got {weights[wrong[0]]} of point {wrong[0]}"
                )
            if not weights[finite].any():
                raise ValueError("weights must not all be 0")
        if normals is not None:
            normals = _columns("normals", normals, 3)
            if len(normals) != n:
                raise ValueError(
                    f"normals must be of shape ({n}, 3), one for each point, got {normals.shape}"
                )
            normals = np.nan_to_num(normals, posinf=0, neginf=0)
        return cls(
            found,
            weights,
            normals,
            _kinds(found, finite, edges),
            not isinstance(edges, str),
            isinstance(edges, str) and edges == "detect",
        )

    @classmethod
    def _of_surface(cls, given: Mesh | LimitSurface, edges: Any, rng: Any) -> Target:
        surface = checked_surface(LimitSurface(given) if isinstance(given, Mesh) else given)
        if edges is not None and not (isinstance(edges, str) and edges == "auto"):
            raise ValueError(
                "edges are of points: of a surface they are known; give None to leave them out"
            )
        found = sample(surface, _SAMPLES, rng=rng)
        points, kinds = [found.point], [np.zeros(len(found), dtype=np.int64)]
        normals = [found.normal]
        sharp = SharpEdges(surface)
        if edges is not None and len(sharp):
            count = max(_EACH, round(np.sqrt(len(found) / len(surface.limit_faces))))
            which = np.repeat(np.arange(len(sharp)), count)
            at = sharp.places(which, np.tile(np.linspace(0, 1, count), len(sharp)))
            points.append(surface.evaluate(at.face, at.u, at.v))
            kinds.append(np.where(sharp.on_boundary[which], 1, 2))
            normals.append(np.zeros((len(which), 3)))
        return cls(
            np.concatenate(points), None, np.nan_to_num(np.concatenate(normals)),
            np.concatenate(kinds), False,
        )  # fmt: skip

    def some(self, which: Array) -> Target:
        """Those of some points."""
        return replace(
            self,
            points=self.points[which],
            weights=None if self.weights is None else self.weights[which],
            normals=None if self.normals is None else self.normals[which],
            kinds=self.kinds[which],
        )

    def with_creases(self, scaled: Array) -> Target | None:
        """With places on sharp edges of the points added; None if there are none.

        `scaled` (n, 3) are the points at about unit size, which the places are in, too.
        """
        found = crease_points(scaled, self.normals)
        m = len(found)
        if not m:
            return None
        weights, normals = self.weights, self.normals
        return replace(
            self,
            points=np.concatenate([scaled, found]),
            weights=None if weights is None else np.append(weights, np.full(m, weights.mean())),
            normals=None if normals is None else np.concatenate([normals, np.zeros((m, 3))]),
            kinds=np.append(self.kinds, np.full(m, KINDS["crease"])),
        )

    def on_edges_of(self, surface: LimitSurface) -> Target:
        """The same, if a surface has such edges; where nobody asked for them, without these."""
        if not self.kinds.any():
            return self
        sharp = SharpEdges(surface)
        there = np.array([True, *(len(sharp.of_kind(kind)) > 0 for kind in (1, 2, 3))])
        wrong = np.flatnonzero(~there[self.kinds])
        if not len(wrong):
            return self
        if not self.told:
            return replace(self, kinds=np.where(there[self.kinds], self.kinds, 0))
        what = {1: "boundary", 2: "sharp crease", 3: "boundary or sharp crease"}
        raise ValueError(
            f"edges: point {wrong[0]} is on a {what[int(self.kinds[wrong[0]])]}, "
            "but the surface of the cage has none"
        )


def _columns(name: str, given: Any, width: int) -> Array:
    found = reals(name, given)
    if found.ndim != 2 or found.shape[1] != width:
        raise ValueError(f"{name} must be of shape (n, {width}), got {found.shape}")
    return found


def _kinds(points: Array, finite: Array, edges: Any) -> Array:
    """On which edges points are, (n,)."""
    n = len(points)
    found = np.zeros(n, dtype=np.int64)
    if edges is None or (isinstance(edges, str) and edges == "auto"):
        return found
    if isinstance(edges, str):
        if edges != "detect":
            raise ValueError(f"edges must be 'auto', 'detect', None or an array, got {edges!r}")
        found[finite] = np.where(detected(points[finite]), KINDS["boundary"], 0)
        return found
    given = np.asarray(edges)
    if given.shape != (n,):
        raise ValueError(f"edges must be of shape ({n},), one for each point, got {given.shape}")
    if given.dtype.kind == "b":
        return np.where(given, ANY, 0)
    if given.dtype.kind in "UO":
        wrong = np.flatnonzero(~np.isin(given.astype(str), list(KINDS)))
        if len(wrong):
            known = ", ".join(map(repr, KINDS))
            raise ValueError(
                f"edges of points must be one of {known}, got {str(given[wrong[0]])!r} of point "
                f"{wrong[0]}"
            )
        for name, kind in KINDS.items():
            found[given.astype(str) == name] = kind
        return found
    raise TypeError(f"edges must be truth values or texts, got an array of {given.dtype}")


def detected(points: Array) -> Array:
    """Which points (n, 3) of a sheet are at its end: some angle without a neighbour is so wide.

    Angles are those of the 24 nearest neighbours in the plane that fits them best.
    """
    from scipy.spatial import cKDTree

    n = len(points)
    k = min(_AROUND + 1, n)
    if k < 4:
        return np.zeros(n, dtype=bool)
    _, near = cKDTree(points).query(points, k=k)
    around = points[near] - points[near].mean(axis=1, keepdims=True)
    _, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))
    from_here = points[near[:, 1:]] - points[:, None]
    x, y = (np.einsum("nkd,nd->nk", from_here, axes[:, :, axis]) for axis in (1, 2))
    angle = np.sort(np.arctan2(y, x), axis=1)
    gaps = np.diff(angle, axis=1, append=angle[:, :1] + 2 * np.pi)
    return np.asarray(gaps.max(axis=1) > _GAP)
