"""What a cage is asked to pass through: checks of the input, and rows at each level."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf.caching import cached_property
from limitsurf.cad.fairing import chosen_vertices
from limitsurf.cad.rows import Level, at_vertices, has_limit
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

CONTRADICTION = 1e-10  # of the size: hard points of one place that are farther apart


@dataclass(frozen=True, eq=False)
class Wanted:
    """Points at places, with normals and weights.

    Attributes
    ----------
    level : Level
        The places on the cage that was given.
    vertices : (m,) int or None
        Of which vertices these are, if they are of vertices.
    points : (m, d)
    normals : (m, 3)
        Of length 1; NaN where none is asked for.
    weights : (m,)
        inf where the limit is to pass through the point.
    size : float
        The longest edge of the box of the points and the cage.
    fixed : (n_vertices,) bool
    number : (m,) int
        Which of the points that were given these are.
    given : int
        How many these were.
    """

    level: Level
    vertices: Array | None
    points: Array
    normals: Array
    weights: Array
    size: float
    fixed: Array
    number: Array
    given: int

    def named(self, k: int) -> str:
        """A place as messages call it."""
        if self.vertices is not None:
            return f"vertex {self.vertices[k]}"
        return f"place {k}, ({self.level.face[k]}, {self.level.u[k]:.6g}, {self.level.v[k]:.6g})"

    @property
    def hard(self) -> Array:
        """Which points the limit is to pass through, (m,) bool."""
        return np.isinf(self.weights)

    @cached_property
    def conditions(self) -> Array:
        """Those of them that are of different places; a ValueError if others say otherwise."""
        hard, level = np.flatnonzero(self.hard), self.level
        key = np.stack([level.face, level.u, level.v])[:, hard]
        _, first, same = np.unique(key, axis=1, return_index=True, return_inverse=True)
        same = same.ravel()
        if len(first) == len(same):
            return hard
        one = hard[first[same]]  # of each place the first
        apart = np.abs(self.points[hard] - self.points[one]).max(axis=1)
        turned = np.abs(self.normals[hard] - self.normals[one]).max(axis=1)
        none = np.isnan(self.normals[:, 0])
        turned[none[hard] != none[one]] = 1
        for what, bad in (
            ("points", apart > CONTRADICTION * self.size),
            ("normals", turned > CONTRADICTION),
        ):
            if bad.any():
                i, k = (int(self.number[x[bad][0]]) for x in (one, hard))
                raise ValueError(
                    f"{what} {i} and {k} are both of {self.named(int(one[bad][0]))}, but differ: "
                    "leave one out, or give finite weights, by which the limit comes between"
                )
        return hard[np.sort(first)]


def wanted(
    surface: LimitSurface,
    points: ArrayLike | None,
    vertices: ArrayLike | None,
    places: Any,
    normals: ArrayLike | None,
    weights: ArrayLike | None,
    fixed: ArrayLike | None,
) -> Wanted:
    """The input of `interpolate`, after checks."""
    mesh = surface.mesh
    n = mesh.n_vertices
    kept = np.zeros(n, dtype=bool)
    kept[chosen_vertices("fixed", fixed, n)] = True
    which = None
    if places is not None:
        if vertices is not None:
            raise ValueError("give vertices or places, not both")
        if points is None:
            raise ValueError("places need points, one for each")
        level = _at_places(surface, places)
    else:
        which = np.arange(n) if vertices is None else chosen_vertices("vertices", vertices, n)
        level = at_vertices(surface).chosen(which)
    m, tail = len(level.face), mesh.points.shape[1:]
    points = mesh.points[which] if points is None else _finite("points", points, (m, *tail))
    flat, own = (np.reshape(x, (len(x), int(np.prod(tail)))) for x in (points, mesh.points))
    unit, pull = _unit(normals, m, tail), _weights(weights, m)
    use = level.face >= 0
    if vertices is None and places is None:
        use &= ~kept
    elif not use.all():
        assert which is not None
        raise ValueError(
            f"vertices: vertex {which[~use][0]} (and {(~use).sum() - 1} more) has no limit"
        )
    use &= pull > 0
    if not use.any():
        raise ValueError("there is no point to pass through: give one at least")
    level = level.chosen(use)
    if use.sum() < mesh.n_vertices:
        kept |= ~_parts_with(surface, level.face)
    return Wanted(
        level,
        None if which is None else which[use],
        flat[use],
        unit[use],
        pull[use],
        _extent(np.concatenate([own, flat])),
        kept,
        np.flatnonzero(use),
        m,
    )


def _extent(points: Array) -> float:
    """The longest edge of the box of points (n, d), whose coordinates are finite."""
    half = float((points.max(axis=0) / 2 - points.min(axis=0) / 2).max(initial=0))
    if half > np.finfo(float).max / 2**8:
        raise ValueError(
            f"points and cage are twice {half:.3g} across, too near the end of float64: scale them "
            "down"
        )
    return 2 * half


def _parts_with(surface: LimitSurface, face: Array) -> Array:
    """Vertices of the parts of the cage that have one of these limit faces, (n_vertices,) bool."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    mesh = surface.mesh
    n, m = mesh.n_vertices, mesh.n_corners
    ends = mesh.indices, mesh.indices[mesh.next_corner]
    count, part = connected_components(csr_array((np.ones(m), ends), shape=(n, n)), directed=False)
    found = np.zeros(count, dtype=bool)
    first = mesh.offsets[surface.limit_faces.face[face]]
    found[part[mesh.indices[first]]] = True
    return np.asarray(found[part])


def _at_places(surface: LimitSurface, places: Any) -> Level:
    """Places that are given, after checks."""
    try:
        face, u, v = places
    except (TypeError, ValueError):
        raise ValueError(
            "places must be (face, u, v): limit faces, and parameters in them, (m,) each"
        ) from None
    try:
        face, u, v = (np.ravel(x) for x in np.broadcast_arrays(face, u, v))
    except ValueError:
        raise ValueError("places: face, u and v must be of one shape, (m,)") from None
    surface.evaluate(face, u, v)  # complains of what is no place
    u, v = np.asarray(u, dtype=float), np.asarray(v, dtype=float)
    bad = np.flatnonzero(np.isnan(u) | np.isnan(v) | ~has_limit(surface, face))
    if len(bad):
        raise ValueError(
            f"places: the surface has no limit at place {bad[0]} (and at {len(bad) - 1} more)"
        )
    return Level(surface, None, np.asarray(face, dtype=np.int64), u, v)


def _finite(name: str, given: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Numbers of a shape, all finite."""
    found = np.asarray(given)
    if found.dtype.kind not in "biuf":
        raise TypeError(f"{name} must be real numbers, float64, got an array of {found.dtype}")
    if found.shape != shape:
        raise ValueError(f"{name} must be of shape {shape}, one for each place, got {found.shape}")
    flat = found.reshape(len(found), int(np.prod(shape[1:]))).astype(float)
    bad = np.flatnonzero(~np.isfinite(flat).all(axis=1))
    if len(bad):
        raise ValueError(f"{name}: number {bad[0]} (and {len(bad) - 1} more) is not finite")
    return found.astype(float)


def _unit(normals: ArrayLike | None, m: int, tail: tuple[int, ...]) -> Array:
    """Normals of length 1; NaN where none is asked for."""
    if normals is None:
        return np.full((m, 3), np.nan)
    if tail != (3,):
        raise ValueError(f"normals need points of shape (n, 3), but those of the cage are {tail}")
    found = np.asarray(normals)
    if found.dtype.kind not in "biuf" or found.shape != (m, 3):
        raise ValueError(
            f"normals must be ({m}, 3) real numbers, one for each point, NaN where none is asked "
            f"for; got {found.dtype} of shape {found.shape}"
        )
    found = found.astype(float)
    none = np.isnan(found).all(axis=1)
    largest = np.abs(found).max(axis=1)
    bad = np.flatnonzero(~none & ~((largest > 0) & (largest < np.inf)))
    if len(bad):
        raise ValueError(
            f"normal {bad[0]} (and {len(bad) - 1} more) has no direction: got {found[bad[0]]}"
        )
    found = found / largest[:, None]
    return np.asarray(found / np.linalg.norm(found, axis=1)[:, None])


def _weights(weights: ArrayLike | None, m: int) -> Array:
    found = np.asarray(np.inf if weights is None else weights, dtype=float)
    if found.shape not in ((), (m,)):
        raise ValueError(
            f"weights must be one number, or ({m},), one for each point, got shape {found.shape}"
        )
    found = np.broadcast_to(found, m)
    bad = np.flatnonzero(~(found >= 0))
    if len(bad):
        raise ValueError(f"weights must not be below 0 or NaN, got {found[bad[0]]} at {bad[0]}")
    return found
