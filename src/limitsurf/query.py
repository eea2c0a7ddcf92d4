"""Questions asked of a surface: so far, whether recursive refinement converges to it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.refine import refined
from limitsurf.surface import LimitSurface


def validate(surface: LimitSurface, levels: int) -> NDArray[Any]:
    """Compare the closed form with recursive refinement, level by level.

    Every refined vertex has a parent (limit face, u, v). The refined points themselves approach
    the surface there; moved to their limits by limit masks they lie on it, up to rounding.

    Parameters
    ----------
    surface : LimitSurface
        Of float64 points. Memory and time grow by four with every level.
    levels : int
        How many levels to refine, at least 1.

    Returns
    -------
    structured ndarray, (levels,)
        Fields ``level`` (1, 2, ...), ``error``, the largest distance of a refined vertex from the
        surface at its parent parameters; ``order``, the observed order of convergence
        ``log2(error[level - 1] / error[level])``, where level 0 is the cage; ``limit_error``, the
        largest distance of the vertices moved to their limit. Vertices without a limit are left
        out; NaN if there are none with one. The order is 2 where the surface is regular. Next to
        an extraordinary vertex of subdominant eigenvalue lambda, parents follow the parameters,
        not the points, and the error falls by lambda: the order tends to log2(1 / lambda), 1.29 at
        valence 3, 0.86 at 5, 0.61 as the valence grows.

    Raises
    ------
    ValueError
        For levels that are not an integer >= 1.
    TypeError
        For a surface of exact numbers, whose distances need square roots.

    Examples
    --------
    >>> import limitsurf as ls
    >>> cube = ls.Mesh(
    ...     [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)],
    ...     [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    >>> table = ls.validate(ls.LimitSurface(cube), 3)
    >>> table["level"].tolist(), bool((table["limit_error"] < 1e-15).all())
    ([1, 2, 3], True)
    """
    if isinstance(levels, bool) or not isinstance(levels, (int, np.integer)) or levels < 1:
        raise ValueError(f"levels must be an integer >= 1, got {levels!r}")
    if not isinstance(surface, LimitSurface):
        raise TypeError(f"validate needs a LimitSurface, got {type(surface).__name__}")
    if surface.points.dtype == object:
        raise TypeError("distances need square roots: give float64 points")
    table = np.zeros(
        levels,
        dtype=[("level", np.int64), ("error", float), ("order", float), ("limit_error", float)],
    )
    # centred: the refiner rounds to the size of the coordinates
    used = surface.mesh.indices[0]
    surface = surface.with_points(surface.points - surface.points[used])
    mesh = refined(surface.mesh, 0, **surface.rules)
    errors = [_distance(mesh.points, surface, mesh)]
    # one level at a time; parameters are those of the cage's limit faces all along
    for level in range(1, levels + 1):
        mesh = refined(surface.mesh, level, **surface.rules)
        errors.append(_distance(mesh.points, surface, mesh))
        table["limit_error"][level - 1] = _distance(mesh.limit_points, surface, mesh)
    table["level"] = np.arange(1, levels + 1)
    table["error"] = errors[1:]
    with np.errstate(divide="ignore", invalid="ignore"):
        table["order"] = np.log2(np.array(errors[:-1]) / errors[1:])
    return table


def on_refined(
    surface: LimitSurface, face: NDArray[Any], u: NDArray[Any], v: NDArray[Any]
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """The same points as queries of the surface of ``refined(surface.mesh)``, once refined.

    There they lie in other patches with other control points: that both surfaces agree checks
    evaluation against refinement at any (face, u, v), not at refined vertices alone.

    Parameters
    ----------
    surface : LimitSurface
    face, u, v : (Q,) arrays
        Queries as for `LimitSurface.evaluate`.

    Returns
    -------
    face, u, v : (Q,) arrays
        A derivative in u or v of a quad is half as large there, and turned with its child.

    Examples
    --------
    >>> import numpy as np
    >>> import limitsurf as ls
    >>> from limitsurf.query import on_refined
    >>> surface = ls.LimitSurface(ls.Mesh([[0], [1], [1], [0]], [[0, 1, 2, 3]]))
    >>> [x.tolist() for x in on_refined(surface, np.array([0]), np.array([0.75]), np.array([0.25]))]
    [[1], [0.5], [0.5]]
    """
    mesh, limit_faces = surface.mesh, surface.limit_faces
    parent, corner = limit_faces.face[face], limit_faces.corner[face]
    high, above = u > 0.5, v > 0.5
    # quadrant of a quad: the corner it holds, where its child has corner 0
    quadrant = np.where(above, np.where(high, 2, 3), high.astype(int))
    s, t = 2 * u - high, 2 * v - above
    sides = [s, t, 1 - s, 1 - t]
    quad = corner < 0
    return (
        mesh.offsets[parent] + np.where(quad, quadrant, corner),
        np.where(quad, np.choose(quadrant, sides), u),
        np.where(quad, np.choose(quadrant, sides[1:] + sides[:1]), v),
    )


_PORTION = 1 << 16  # queries that are in memory at once, with all that is compared


def refinement_gap(
    surface: LimitSurface, face: NDArray[Any], u: NDArray[Any], v: NDArray[Any]
) -> tuple[float, float]:
    """Largest differences of positions and unit normals from those on the once refined cage.

    The arguments, and why this is a check, are as for `on_refined`; points of shape (n, 3). NaN on
    both sides agree; a NaN on one side alone gives NaN.

    Examples
    --------
    >>> import numpy as np
    >>> import limitsurf as ls
    >>> from limitsurf.query import refinement_gap
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 1]], [[0, 1, 2, 3]])
    >>> gaps = refinement_gap(ls.LimitSurface(square), np.array([0]), np.array([0.7]), np.ones(1))
    >>> max(gaps) < 1e-15
    True
    """
    fine = LimitSurface(refined(surface.mesh, **surface.rules))
    largest = np.zeros(2)
    for start in range(0, len(face), _PORTION):
        part = slice(start, start + _PORTION)
        f, x, y = face[part], u[part], v[part]
        there = on_refined(surface, f, x, y)
        pairs = (
            (surface.evaluate(f, x, y), fine.evaluate(*there)),
            (surface.normal(f, x, y), fine.normal(*there)),
        )
        gaps = [np.where(np.isnan(a) & np.isnan(b), 0, np.abs(a - b)) for a, b in pairs]
        # (a NaN stays)
        largest = np.maximum(largest, [gap.max(initial=0) for gap in gaps])
    return float(largest[0]), float(largest[1])


def _distance(points: NDArray[Any], surface: LimitSurface, mesh: Any) -> float:
    """Largest distance of points (n_vertices, ...) from the surface at the parents of `mesh`."""
    place = mesh.parent_face >= 0
    parents = mesh.parent_face[place], mesh.parent_u[place], mesh.parent_v[place]
    gap = (points[place] - surface.evaluate(*parents)).reshape(int(place.sum()), -1)
    gap = gap[~np.isnan(gap).any(axis=1)]
    size = float(np.abs(gap).max(initial=0))  # squares of large gaps would overflow
    if not len(gap) or size == 0:
        return size if len(gap) else float("nan")
    return size * float(np.sqrt(((gap / size) ** 2).sum(axis=1).max()))
