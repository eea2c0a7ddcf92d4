"""Volume, centre of mass and inertia of the body inside, or of the surface itself; its area."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf import numbers
from limitsurf.engine.protocol import threads
from limitsurf.integrals.cells import Cells
from limitsurf.integrals.checks import (
    check_rtol,
    checked,
    chosen_faces,
    is_exact,
    refuse_exact,
    refuse_open,
)
from limitsurf.integrals.moments import Moments, float_moments
from limitsurf.integrals.rational import exact_moments
from limitsurf.integrals.sums import sample, surface_integrals
from limitsurf.surface import LimitSurface

Array = NDArray[Any]
Of: TypeAlias = Literal["body", "surface"]

_RTOL = 1e-12
_NOTHING = 2.0**-44  # of the sizes that are added up, below which a volume is rounding


def area(
    surface: LimitSurface,
    *,
    face: ArrayLike | None = None,
    rtol: float = _RTOL,
    channel: str | None = None,
    workers: int = 1,
) -> float:
    """The area of the limit surface, or of some of its limit faces.

    Parameters
    ----------
    surface : LimitSurface
        Of float64 points (n_vertices, 3).
    face : array_like of int, optional
        Limit faces; each counts as often as it is named. All by default. Those without a limit
        (holes) have no area.
    rtol : float
        How large the error may be, relative to the area; at least 1e-15.
    channel : str, optional
        A face-varying channel of three columns, to measure instead of the points.
    workers : int
        Threads, as for `LimitSurface.evaluate`.

    Returns
    -------
    float

    Raises
    ------
    IndexError
        For a face out of range.
    TypeError
        For exact points, of whose areas there are square roots.
    ValueError
        For points that are not finite or not in space, and for an `rtol` out of range.

    Warns
    -----
    RuntimeWarning
        With the accuracy that was reached, if it is not `rtol`: faces of a flat surface that fold
        over have a kink in the midst of their area.

    Notes
    -----
    Polynomial pieces are integrated by two Gauss rules, and split until these agree. Around a
    special corner ring n is of the order of ``(a b)^n``, with the two largest eigenvalues a and b
    after 1; rings are added until they are below the tolerance (``derivations/integrals.py``).

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> round(ls.area(ls.LimitSurface(square)), 12)
    2.0
    """
    surface = checked(surface, "area", channel)
    total, cells = _over_surface(
        surface, "area", lambda x, _: np.ones((len(x), 1)), 1, face, rtol, workers
    )
    return float(_unscaled(total[0], -2 * cells.power))


def volume(
    surface: LimitSurface,
    *,
    rtol: float = _RTOL,
    channel: str | None = None,
    workers: int = 1,
) -> float | Fraction:
    """The volume inside a closed limit surface, negative if its faces are seen from inside.

    Parameters
    ----------
    surface : LimitSurface
        Closed, its faces consistently oriented: counter-clockwise as seen from outside.
    rtol : float
        Accepted for the sake of `area`: the volume is exact to rounding, whatever it is.
    channel : str, optional
        A face-varying channel of three columns, to measure instead of the points.
    workers : int
        Threads, as for `LimitSurface.evaluate`.

    Returns
    -------
    float, or Fraction
        Parts of the body that the surface winds around twice count twice.

    Raises
    ------
    TypeError
        For Fractions with more than 8 faces around a special corner, or irrational masks.
    ValueError
        If the surface has a boundary (holes count as such) or faces that are not consistently
        oriented, with the first such edge; for points that are not finite or not in space.

    Notes
    -----
    By the divergence theorem the volume is an integral of polynomials over the pieces of the
    surface, which Gauss rules have exactly. Infinitely many rings around a special corner are added
    in float64 until what remains is below 2^-60 of the first. Of Fractions their sum is known in
    closed form, for the integrals satisfy a linear recurrence. The length of that grows with the
    cube of the number of faces: half a minute for a cube, of valence 3
    (``derivations/integrals.py``).

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> cube = ls.LimitSurface(ls.Mesh(points, quads))
    >>> round(ls.volume(cube), 12)
    0.327552379087
    """
    surface = checked(surface, "volume", channel)
    moments, _, power = _of_body(surface, "volume", 0, rtol, workers)
    found: float | Fraction = _unscaled(moments.volume, -3 * power)
    return found


def centroid(
    surface: LimitSurface,
    *,
    of: Of = "body",
    rtol: float = _RTOL,
    channel: str | None = None,
    workers: int = 1,
) -> Array:
    """The centre of mass of the body inside a closed limit surface, or of the surface itself.

    Parameters
    ----------
    surface : LimitSurface
        Closed and consistently oriented, for a body.
    of : {"body", "surface"}
        What mass is spread over evenly.
    rtol : float
        How large errors may be, relative to the size of the surface.
    channel : str, optional
        A face-varying channel of three columns, to measure instead of the points.
    workers : int
        Threads, as for `LimitSurface.evaluate`.

    Returns
    -------
    array, (3,)
        float64, or Fractions if the points are (of a body).

    Raises
    ------
    TypeError
        For Fractions as `volume` does, and for those of a surface.
    ValueError
        As `volume` does, for a body; for a body without volume, or a surface without area.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> cube = ls.LimitSurface(ls.Mesh(points, quads))
    >>> ls.centroid(cube).round(12).tolist()
    [0.5, 0.5, 0.5]
    """
    surface = checked(surface, "centroid", channel)
    moments, origin, power = _moments(surface, "centroid", of, 1, rtol, workers)
    return origin + _scaled(_middle(moments, of), -power)


def inertia(
    surface: LimitSurface,
    *,
    of: Of = "body",
    about: ArrayLike | None = None,
    rtol: float = _RTOL,
    channel: str | None = None,
    workers: int = 1,
) -> Array:
    """The inertia tensor of the body inside a closed limit surface, or of the surface itself.

    Of mass 1 per unit of volume, or of area: the integral of ``(r . r) 1 - r r^T``, where r is the
    position relative to the centre of mass, or to another point.

    Parameters
    ----------
    surface : LimitSurface
        Closed and consistently oriented, for a body.
    of : {"body", "surface"}
        What mass is spread over evenly.
    about : (3,) array_like, optional
        The point that r is relative to; the `centroid` by default.
    rtol : float
        How large errors may be, relative to the largest entry.
    channel : str, optional
        A face-varying channel of three columns, to measure instead of the points.
    workers : int
        Threads, as for `LimitSurface.evaluate`.

    Returns
    -------
    array, (3, 3)
        Symmetric; float64, or Fractions if the points are (of a body).

    Raises
    ------
    TypeError
        For Fractions as `volume` does, and for those of a surface.
    ValueError
        As `centroid` does, and for an `about` that is no point.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> box = ls.LimitSurface(ls.Mesh(points, quads), scheme="bilinear")
    >>> ls.inertia(box).round(12).diagonal().tolist()  # of a unit cube: 1/6
    [0.166666666667, 0.166666666667, 0.166666666667]
    """
    surface = checked(surface, "inertia", channel)
    moments, origin, power = _moments(surface, "inertia", of, 2, rtol, workers)
    middle = _middle(moments, of)
    second = moments.second - moments.volume * np.multiply.outer(middle, middle)
    second = (second + second.T) / 2
    if about is not None:
        away = middle - _scaled(_point(about, is_exact(surface)) - origin, power)
        second = second + moments.volume * np.multiply.outer(away, away)
    own = np.trace(second) * np.identity(3, dtype=int) - second
    return _scaled(own, -(5 if of == "body" else 4) * power)


def integrate(
    surface: LimitSurface,
    f: Callable[[Array, Array], ArrayLike],
    *,
    face: ArrayLike | None = None,
    rtol: float = _RTOL,
    channel: str | None = None,
    workers: int = 1,
) -> Any:
    """The integral of a function over the limit surface, or over some of its limit faces.

    Parameters
    ----------
    surface : LimitSurface
        Of float64 points (n_vertices, 3).
    f : callable
        ``f(points, normals)`` gives numbers (n,), or arrays (n, ...), at points (n, 3) of the
        surface, from these and unit normals there. It may be called in several threads at once if
        `workers` says so.
    face : array_like of int, optional
        Limit faces, as for `area`.
    rtol : float
        How large the error of each number may be, relative to the integral of its absolute value.
    channel : str, optional
        A face-varying channel of three columns, to measure instead of the points.
    workers : int
        Threads, as for `LimitSurface.evaluate`.

    Returns
    -------
    float, or array (...) of float64

    Raises
    ------
    IndexError, TypeError
        As `area` does; also if `f` gives complex numbers or what are no numbers.
    ValueError
        As `area` does; if what `f` gives has another length, or is not finite.

    Warns
    -----
    RuntimeWarning
        With the accuracy that was reached, if it is not `rtol`: where `f` is not smooth.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> surface = ls.LimitSurface(square)
    >>> round(ls.integrate(surface, lambda points, normals: points[:, 0] * normals[:, 2]), 12)
    0.5
    """
    surface = checked(surface, "integral", channel)
    cells = _cells(surface, "integral", face, rtol, workers)

    def values(x: Array, normal: Array) -> Array:
        points = cells.origin + np.ldexp(x, -cells.power)
        found = np.asarray(f(points, normal))
        if found.dtype.kind not in "biuf":
            raise TypeError(f"f must give real numbers, got an array of {found.dtype}")
        if found.shape[:1] != (len(x),):
            raise ValueError(
                f"f must give an array ({len(x)}, ...) at {len(x)} points, got one of shape "
                f"{found.shape}"
            )
        if not np.isfinite(found).all():
            bad = np.flatnonzero(~np.isfinite(found.reshape(len(x), -1)).all(axis=1))[0]
            raise ValueError(f"f must give finite numbers, but does not at {points[bad].tolist()}")
        return found.astype(float)

    shape = values(*sample(cells)).shape[1:]
    size = int(np.prod(shape))
    total, _ = surface_integrals(
        cells, lambda x, n: values(x, n).reshape(len(x), size), size, rtol, threads(workers)
    )
    with np.errstate(over="ignore"):
        total = np.ldexp(total, -2 * cells.power).reshape(shape)
    return total if shape else float(total)


def _cells(
    surface: LimitSurface, what: str, face: ArrayLike | None, rtol: float, workers: int
) -> Cells:
    """The cells of limit faces, after checks."""
    check_rtol(rtol)
    if is_exact(surface):
        refuse_exact(what)
    return Cells(surface, chosen_faces(surface, face), threads(workers))


def _over_surface(
    surface: LimitSurface,
    what: str,
    f: Callable[[Array, Array], Array],
    width: int,
    face: ArrayLike | None,
    rtol: float,
    workers: int,
) -> tuple[Array, Cells]:
    """Integrals (k,) over limit faces in the scale of their cells, and these."""
    cells = _cells(surface, what, face, rtol, workers)
    return surface_integrals(cells, f, width, rtol, threads(workers))[0], cells


def _moments(
    surface: LimitSurface, what: str, of: Of, order: int, rtol: float, workers: int
) -> tuple[Moments, Array, int]:
    """Moments of a body or surface about a point and scaled by a power of two; both of these."""
    if of == "body":
        return _of_body(surface, what, order, rtol, workers)
    if of != "surface":
        raise ValueError(f'of must be "body" or "surface", got {of!r}')

    def powers(x: Array, _: Array) -> Array:
        both = (x[:, :, None] * x[:, None]).reshape(-1, 9)
        return np.concatenate([np.ones((len(x), 1)), x, both], axis=1)

    total, cells = _over_surface(surface, what, powers, 13, None, rtol, workers)
    return (
        Moments(total[0], total[1:4], total[4:].reshape(3, 3), total[0]),
        cells.origin,
        cells.power,
    )


def _of_body(
    surface: LimitSurface, what: str, order: int, rtol: float, workers: int
) -> tuple[Moments, Array, int]:
    """Moments of the body inside about a point and scaled by a power of two; both of these."""
    check_rtol(rtol)
    count = threads(workers)
    refuse_open(surface, f"the {what} needs")
    if is_exact(surface):
        return exact_moments(surface, order), np.full(3, Fraction(0)), 0
    cells = Cells(surface, np.arange(len(surface.limit_faces)), count)
    return float_moments(cells, order, count), cells.origin, cells.power


def _point(about: ArrayLike, exact: bool) -> Array:
    """A point (3,) of float64, or of Fractions."""
    try:
        place = np.asarray(about)
        place = np.asarray(place.astype(float) if not exact else numbers.RATIONAL.array(place))
    except (TypeError, ValueError, OverflowError):
        place = np.zeros(0)
    if place.shape != (3,) or (not exact and not np.isfinite(place).all()):
        raise ValueError(f"about must be a finite point (3,), got {about!r}")
    return place


def _middle(moments: Moments, of: Of) -> Array:
    """The centre of mass."""
    if abs(moments.volume) <= (
        0 if isinstance(moments.size, Fraction) else _NOTHING * moments.size
    ):
        what = "the body inside has no volume" if of == "body" else "the surface has no area"
        raise ValueError(f"{what}, and so no centre of mass")
    return np.asarray(moments.first / moments.volume)


def _unscaled(value: Any, power: int) -> Any:
    """A number times a power of two; inf beyond the range of float64."""
    if isinstance(value, Fraction):
        return value * Fraction(2) ** power
    return float(_scaled(np.asarray(value), power))


def _scaled(values: Array, power: int) -> Array:
    """Numbers times a power of two; inf beyond the range of float64."""
    flat = numbers.type_of(values).scaled(values.ravel(), np.full(values.size, power))
    return np.asarray(flat.reshape(values.shape))
