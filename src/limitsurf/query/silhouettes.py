"""Curves on a surface that its normals decide: silhouettes and isophotes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf.engine.protocol import threads
from limitsurf.integrals.checks import refuse_turned
from limitsurf.query.borders import Borders
from limitsurf.query.index import Cells, checked_surface
from limitsurf.query.normals import Angle, Facing, OfNormals
from limitsurf.query.sections import Curves, clipped, traced, vector
from limitsurf.surface import LimitSurface

Array = NDArray[Any]


def silhouette(
    surface: LimitSurface,
    view: ArrayLike,
    *,
    perspective: bool = False,
    tolerance: float | None = None,
    channel: str | None = None,
    workers: int = 1,
) -> Curves:
    """The curves along which a surface turns away from who looks at it: all, hidden ones too.

    They are where normals are perpendicular to the line of sight, and the parts of sharp edges of
    which one side is seen from the front and the other from behind.

    Parameters
    ----------
    surface : LimitSurface
        Of float64 points, (n_vertices, 3).
    view : (3,) array_like
        The direction towards a viewer who is far away, of any length; with `perspective` the eye.
    perspective : bool
        Whether `view` is a point.
    tolerance : float, optional
        How far polylines may be from the curves, in the units of the points. By default 1e-4 of the
        longest side of the surface's box.
    channel : str, optional
        A face-varying channel of three columns, taken instead of the points.
    workers : int
        Threads, as for `LimitSurface.evaluate`; answers do not depend on it.

    Returns
    -------
    Curves
        What faces the viewer is on their left, seen from the side of the surface's normals. Their
        `value` is 0.

    Raises
    ------
    TypeError
        For what is not a surface, a surface of exact points, a tolerance that is not a number.
    ValueError
        For a view that is not three finite numbers, a direction of length 0, a tolerance that is
        not above 0.
    MemoryError
        At once, for more points than there is memory for.

    Notes
    -----
    The silhouette is the border, on the surface, of what is seen from behind. On each cell it is
    the zero set of a polynomial, ``(d/ds x d/dt) . view``, traced as that of `section` is: no loop
    is missed, however small. On surfaces without boundary all curves are closed, but for those that
    meet, at saddles or in corners of sharp edges: there they end. On others they end at boundaries.
    Boundaries themselves are not silhouettes.

    A curve that goes through a special vertex has it as a point if the limit normal there is
    perpendicular to the view up to rounding. Where no limit normal exists, as at cones, it is known
    up to rings of 2^-40 of a face, and goes on through the vertex.

    Of the schemes of degree 1, "linear" and "bilinear", all edges are sharp: of flat faces the
    silhouette is made of edges. ``derivations/silhouettes.py`` derives all this.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> ball = ls.LimitSurface(ls.Mesh(points, quads))
    >>> found = ls.silhouette(ball, [0, 0, 1])
    >>> normal = ball.normal(found.face, found.u, found.v)
    >>> found.closed.tolist(), bool((abs(normal[:, 2]) < 1e-12).all())
    ([True], True)
    """
    surface = checked_surface(surface, channel)
    toward = vector("view", view)
    if not (perspective or toward.any()):
        raise ValueError("view must not be of length 0; an eye takes perspective=True")
    cells = Cells.of(surface, threads(workers))
    toward = clipped(np.ldexp(toward, cells.power)) if perspective else _unit(toward)
    return _found(surface, cells, Facing(cells, toward, perspective), tolerance, workers)


def isophote(
    surface: LimitSurface,
    light: ArrayLike,
    angle: float,
    *,
    tolerance: float | None = None,
    channel: str | None = None,
    workers: int = 1,
) -> Curves:
    """The curves on a surface along which its normals have an angle from a direction.

    They show how light falls on a surface, and so how smooth it is: they break where tangents do,
    and have kinks where curvature jumps.

    Parameters
    ----------
    surface : LimitSurface
        Of float64 points, (n_vertices, 3).
    light : (3,) array_like
        The direction towards the light, of any length.
    angle : float
        In degrees, between 0 and 180, exclusive; at 90 the curves are `silhouette`.
    tolerance : float, optional
        How far polylines may be from the curves, in the units of the points. By default 1e-4 of the
        longest side of the surface's box.
    channel : str, optional
        A face-varying channel of three columns, taken instead of the points.
    workers : int
        Threads, as for `LimitSurface.evaluate`; answers do not depend on it.

    Returns
    -------
    Curves
        What is nearer to the light than the angle is on their left, seen from the side of the
        surface's normals. Their `value` is the angle.

    Raises
    ------
    TypeError, ValueError, MemoryError
        As `silhouette` does; for an angle that is not between 0 and 180; for one other than 90 on a
        surface whose faces are not consistently oriented, with the first edge that says so.

    Notes
    -----
    Each is a border: of what is darker. So parts of sharp edges that have a lighter and a darker
    side belong to them. What is at the angle all over, as a flat face may be, counts as lighter.
    The loops around places that face the light are found down to angles of about 0.01 degrees.
    They are the zero set of a polynomial, ``(n . light)^2 - cos(angle)^2 n . n`` with
    ``n = d/ds x d/dt``, less those of its curves on which ``n . light`` has the other sign:
    ``derivations/silhouettes.py``.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> ball = ls.LimitSurface(ls.Mesh(points, quads))
    >>> found = ls.isophote(ball, [0, 0, 1], 60)
    >>> normal = ball.normal(found.face, found.u, found.v)
    >>> found.closed.tolist(), bool((abs(normal[:, 2] - 0.5) < 1e-12).all())
    ([True], True)
    """
    surface = checked_surface(surface, channel)
    toward = vector("light", light)
    if not toward.any():
        raise ValueError("light must not be of length 0")
    degrees = float(angle)
    if not 0 < degrees < 180:
        raise ValueError(f"angle must be between 0 and 180 degrees, exclusive, got {angle!r}")
    if degrees != 90:
        refuse_turned(surface, "an angle other than 90 needs")
    cells = Cells.of(surface, threads(workers))
    toward = _unit(toward)
    scalar: OfNormals
    if degrees == 90:
        scalar = Facing(cells, toward, False)
    else:
        cosine = float(np.sin(np.radians(90 - degrees)))
        scalar = Angle(cells, toward * np.sign(cosine), abs(cosine))
    curves = _found(surface, cells, scalar, tolerance, workers, degrees > 90)
    curves.value[:] = degrees
    return curves


def _unit(direction: Array) -> Array:
    scaled = np.ldexp(direction, -int(np.frexp(np.abs(direction).max())[1]))
    return np.asarray(scaled / np.sqrt((scaled**2).sum()))


def _found(
    surface: LimitSurface, cells: Cells, scalar: OfNormals, tolerance: float | None,
    workers: int, turned: bool = False,
) -> Curves:  # fmt: skip
    borders = Borders(surface)
    return traced(
        surface, cells, scalar, np.zeros(1), tolerance, workers,
        adjacency=borders.adjacency,
        finish=lambda network: borders.finish(network, cells, scalar, turned),
    )[1]  # fmt: skip
