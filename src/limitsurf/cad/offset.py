"""Offsets of limit surfaces: what is a distance away along the normals, evaluated exactly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf import html
from limitsurf.cad.folds import Folds, folds_of
from limitsurf.cad.offset_cage import OffsetCage, offset_cage
from limitsurf.cad.offset_faces import OffsetFaces, offset_faces
from limitsurf.engine.protocol import threads
from limitsurf.surface import Curvature, LimitSurface

Array = NDArray[Any]


@dataclass(frozen=True, eq=False, repr=False)
class OffsetSurface:
    """What is a distance away from a limit surface along its normals, made by `offset`.

    Places are those of the surface: limit faces, and (u, v) there. A point is p + d n, with the
    point p of the surface, its unit normal n and the distance d; positive ones are on the side of
    the normals. Along sharp creases each face has the normal of its own side: the two sides of an
    offset do not meet there.

    Attributes
    ----------
    surface : LimitSurface
        What it is an offset of; of the channel, if one was asked for.
    distance : float
    tolerance : float, or None
        How far B-spline faces and cages may be from it, where they are not asked for another.
    workers : int
        Threads among which queries are divided.

    Notes
    -----
    With the principal curvatures k1, k2 of the surface (positive where it bends towards its
    normal) and their directions d1, d2, the offset has the derivatives
    (1 - d k1) (w . d1) d1 + (1 - d k2) (w . d2) d2, where w is one of the surface's (Weingarten),
    and the curvatures k / (1 - d k), to the same normal and in the same directions. A factor
    1 - d k is negative where the surface bends towards the offset more than a sphere of radius
    abs(d) does: there the offset folds back, and its derivatives are left-handed about the normal.

    NaN where the surface has no normal, and of derivatives where it has no curvature: so at poles
    of valence 5 and more, where that diverges. Derived in ``derivations/offsets.py``; Farouki,
    "The approximation of non-degenerate offset surfaces", CAGD 1986.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> cube = ls.LimitSurface(ls.Mesh(points, quads))
    >>> ls.offset(cube, 0.1)
    <OffsetSurface at 0.1 of 6 limit faces>
    """

    surface: LimitSurface
    distance: float
    tolerance: float | None = None
    workers: int = 1

    def __repr__(self) -> str:
        n = len(self.surface.limit_faces)
        return f"<{type(self).__name__} at {self.distance:g} of {n} limit faces>"

    def _repr_html_(self) -> str:
        known = {"distance": self.distance, "limit faces": len(self.surface.limit_faces)}
        return html.facts(type(self).__name__, {**known, "tolerance": self.tolerance})

    def evaluate(
        self, face: ArrayLike, u: ArrayLike, v: ArrayLike, *, nu: tuple[int, int] = (0, 0)
    ) -> Array:
        """Points (..., 3), or their first derivatives; arguments as `LimitSurface.evaluate`.

        Parameters
        ----------
        face, u, v : array_like
            Places on the surface; they broadcast.
        nu : (int, int)
            (0, 0), (1, 0) or (0, 1).

        Raises
        ------
        IndexError, TypeError, ValueError
            As of the surface; a ValueError for higher derivatives.

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
        >>> off = ls.offset(ls.LimitSurface(square), 0.5)
        >>> off.evaluate(0, 0.25, 0.5).round(12).tolist()
        [0.25, 0.5, 0.5]
        >>> abs(off.evaluate(0, 0.25, 0.5, nu=(1, 0))).round(12).tolist()
        [1.0, 0.0, 0.0]
        """
        orders = {(0, 0), (1, 0), (0, 1)}
        if tuple(nu) not in orders:
            raise ValueError(
                f"an offset has derivatives of order 0 and 1, (0, 0), (1, 0) and (0, 1), got {nu}"
            )
        return self.jet(face, u, v, order=sum(nu))[nu[0], nu[1]]

    def jet(
        self, face: ArrayLike, u: ArrayLike, v: ArrayLike, *, order: int = 1
    ) -> dict[tuple[int, int], Array]:
        """Points and first derivatives, as {(i, j): array}, of order 0 or 1.

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
        >>> sorted(ls.offset(ls.LimitSurface(square), 0.5).jet(0, 0.25, 0.5))
        [(0, 0), (0, 1), (1, 0)]
        """
        if order not in (0, 1):
            raise ValueError(f"an offset has derivatives of order 0 and 1, got order {order}")
        known = self.surface.jet(face, u, v, order=order, workers=self.workers)
        normal = self.surface.normal(face, u, v, workers=self.workers)
        found = {(0, 0): np.asarray(known[0, 0] + self.distance * normal)}
        if order:
            bent = self.surface.curvature(face, u, v, workers=self.workers)
            for nu in ((1, 0), (0, 1)):
                found[nu] = _carried(known[nu], bent, self.distance)
        return found

    def normal(self, face: ArrayLike, u: ArrayLike, v: ArrayLike) -> Array:
        """Unit normals (..., 3): those of the surface at the same places.

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
        >>> abs(ls.offset(ls.LimitSurface(square), 0.5).normal(0, 0.25, 0.5)).tolist()
        [0.0, 0.0, 1.0]
        """
        return np.asarray(self.surface.normal(face, u, v, workers=self.workers))

    def tangents(self, face: ArrayLike, u: ArrayLike, v: ArrayLike) -> tuple[Array, Array]:
        """Unit directions of d/du and d/dv (..., 3); NaN where these vanish or are NaN.

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
        >>> off = ls.offset(ls.LimitSurface(square), 1)
        >>> [abs(t).round(12).tolist() for t in off.tangents(0, 1, 0.5)]
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
        """
        known = self.surface.tangents(face, u, v, workers=self.workers)
        bent = self.surface.curvature(face, u, v, workers=self.workers)
        with np.errstate(invalid="ignore", divide="ignore"):
            both = (_carried(t, bent, self.distance) for t in known)
            along, across = (t / np.linalg.norm(t, axis=-1, keepdims=True) for t in both)
        return along, across

    def curvature(self, face: ArrayLike, u: ArrayLike, v: ArrayLike) -> Curvature:
        """Curvatures k / (1 - d k) of principal ones k of the surface, as its `curvature`.

        They are about `normal`; `k1` >= `k2`. Where 1 - d k = 0 they are infinite; where k is, it
        is -1 / d.

        Examples
        --------
        A saddle whose curvatures are 1 and -1 has, at distance 1/2, curvatures 2 and -2/3:

        >>> import limitsurf as ls
        >>> grid = [[x, y, (x * x - y * y) / 2] for x in range(-2, 3) for y in range(-2, 3)]
        >>> faces = [[5 * i + j, 5 * i + j + 5, 5 * i + j + 6, 5 * i + j + 1]
        ...          for i in range(4) for j in range(4)]
        >>> saddle = ls.offset(ls.LimitSurface(ls.Mesh(grid, faces)), 0.5)
        >>> bent = saddle.curvature(5, 1.0, 1.0)
        >>> round(float(bent.k1), 9), round(float(bent.k2), 9)
        (2.0, -0.666666667)
        """
        known = self.surface.curvature(face, u, v, workers=self.workers)
        k1, k2 = (_offset_curvature(k, self.distance) for k in (known.k1, known.k2))
        turned = k1 < k2
        d1 = np.where(turned[..., None], known.d2, known.d1)
        d2 = np.where(turned[..., None], -known.d1, known.d2)
        with np.errstate(invalid="ignore", over="ignore"):
            k1, k2 = np.where(turned, k2, k1)[()], np.where(turned, k1, k2)[()]
            return Curvature(k1, k2, d1, d2, (k1 + k2) / 2, k1 * k2)

    def folds(self, *, samples: int = 8) -> Folds:
        """Where it folds back, and where it comes nearer to the surface than its distance.

        Parameters
        ----------
        samples : int
            Places along each side of a limit face; the least factors are sought from the best of
            these.

        Returns
        -------
        Folds
            Found, not proved: what lies between samples and is smaller may be missed.

        Examples
        --------
        >>> import limitsurf as ls
        >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
        >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4],
        ...          [1, 5, 7, 3]]
        >>> cube = ls.LimitSurface(ls.Mesh(points, quads))
        >>> ls.offset(cube, 0.1).folds().any, ls.offset(cube, -0.6).folds().any
        (False, True)
        """
        return folds_of(self.surface, self.distance, samples, self.workers)

    def bspline_faces(self, *, tolerance: float | None = None) -> OffsetFaces:
        """Clamped B-spline faces within a tolerance; `to_brep` and `write` take them.

        Parameters
        ----------
        tolerance : float, optional
            How far faces may be from the offset, as `OffsetFaces.along_normal` measures it, with a
            margin of half as much again; else that of the offset, else 1e-4 of the size of the
            surface.

        Returns
        -------
        OffsetFaces

        Raises
        ------
        ValueError
            Along sharp creases, where sides of an offset do not meet, and at vertices without a
            normal: the first of these. A tolerance that is not reached.

        Examples
        --------
        >>> import limitsurf as ls
        >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
        >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4],
        ...          [1, 5, 7, 3]]
        >>> cube = ls.LimitSurface(ls.Mesh(points, quads))
        >>> bool(ls.offset(cube, 0.1).bspline_faces(tolerance=1e-3).deviation.max() < 1e-3)
        True
        """
        wanted = self.tolerance if tolerance is None else tolerance
        return offset_faces(self.surface, self.distance, wanted, self.workers)

    def fit(self, *, tolerance: float | None = None, levels: int = 3) -> OffsetCage:
        """A cage of the same topology, or refined, whose limit is near it.

        Parameters
        ----------
        tolerance : float, optional
            The cage is refined until it is met, at most `levels` times; by default it is not, and
            has the faces of the surface's own cage.
        levels : int

        Returns
        -------
        OffsetCage
            With the deviations that were found, whether the tolerance was met or not.

        Notes
        -----
        Least squares at interior places of all limit faces, of the distance along the normals and,
        a thousandth as much, across them. Creases stay, and are mitred: beyond them the offsets of
        both sides go on until they meet.

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
        >>> ls.offset(ls.LimitSurface(square), 0.5).fit().mesh.points.round(9).tolist()[2]
        [1.0, 1.0, 0.5]
        """
        wanted = self.tolerance if tolerance is None else tolerance
        return offset_cage(self.surface, self.distance, wanted, levels, self.workers)


def offset(
    surface: LimitSurface,
    distance: float,
    *,
    tolerance: float | None = None,
    channel: str | None = None,
    workers: int = 1,
) -> OffsetSurface:
    """What is a distance away from a limit surface along its normals.

    Parameters
    ----------
    surface : LimitSurface
        Of float64 points (n_vertices, 3).
    distance : float
        In the unit of the points, positive on the side of the normals; 0 is the surface.
    tolerance : float, optional
        How far its B-spline faces and cages may be from it.
    channel : str, optional
        A face-varying channel of three columns instead of the points.
    workers : int
        Threads among which queries are divided, -1 for one to each processor.

    Returns
    -------
    OffsetSurface
        With `evaluate`, `jet`, `normal`, `tangents` and `curvature`, which are exact; `folds`,
        `bspline_faces` and `fit`.

    Raises
    ------
    TypeError
        For what is no surface, a distance that is no number, or exact points.
    ValueError
        For a distance that is not finite, a tolerance that is not positive, points of another
        shape.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> ls.offset(ls.LimitSurface(square), -0.25).evaluate(0, 0.5, 0.5).round(12).tolist()
    [0.5, 0.5, -0.25]
    """
    if not isinstance(surface, LimitSurface):
        raise TypeError(f"offset needs a LimitSurface, got {type(surface).__name__}")
    given: dict[str, Any] = {"distance": distance}
    if tolerance is not None:
        given["tolerance"] = tolerance
    for name, x in given.items():
        if isinstance(x, (bool, str)) or np.ndim(x) or np.asarray(x).dtype.kind not in "iuf":
            raise TypeError(f"{name} must be a number, got {x!r}")
    if not np.isfinite(distance):
        raise ValueError(f"distance must be finite, got {distance}")
    if tolerance is not None and not 0 < tolerance < np.inf:
        raise ValueError(f"tolerance must be positive and finite, got {tolerance}")
    threads(workers)
    found = surface.of_channel(channel)
    if found.points.ndim != 2 or found.points.shape[1] != 3:
        raise ValueError(f"offset needs points of shape (n, 3), got {found.points.shape}")
    if found.points.dtype != np.float64:
        raise TypeError("offset needs square roots, which exact points do not have: give float64")
    return OffsetSurface(found, float(distance), tolerance, workers)


def _carried(w: Array, bent: Curvature, distance: float) -> Array:
    """Derivatives (..., 3) of the offset from those of the surface."""
    with np.errstate(invalid="ignore", over="ignore"):
        found = np.zeros(np.shape(w))
        for k, d in ((bent.k1, bent.d1), (bent.k2, bent.d2)):
            along = (w * d).sum(axis=-1)
            found = found + ((1 - distance * np.asarray(k)) * along)[..., None] * d
        # flat points have no directions, and need none
        flat = (np.asarray(bent.k1) == 0) & (np.asarray(bent.k2) == 0)
        return np.asarray(np.where(flat[..., None], w, found))


def _offset_curvature(k: Any, distance: float) -> Array:
    """Curvature of the offset where the surface has k."""
    k = np.asarray(k, dtype=float)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        found = k / (1 - distance * k)
        if distance:
            found = np.where(np.isinf(k), -1 / distance, found)
    return np.asarray(found)
