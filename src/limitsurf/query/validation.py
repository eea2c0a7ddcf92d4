"""How far the closed form is from recursive refinement."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf import numbers
from limitsurf._kernels import reference as kernels
from limitsurf.cage.checks import checked_integer
from limitsurf.html import Report
from limitsurf.patches import neighbourhood, squares
from limitsurf.refine import RefinedMesh, dual, refined, refuse_levels
from limitsurf.surface import LimitSurface
from limitsurf.topology import first_limit_face

Array: TypeAlias = NDArray[Any]


def validate(
    surface: LimitSurface, levels: int = 4, *, channel: str | None = None, workers: int = 1
) -> NDArray[np.void]:
    """Compare the closed form with recursive refinement, level by level.

    Every refined vertex has a parent (limit face, u, v). The refined points themselves approach
    the surface there; moved to their limits by limit masks they lie on it, up to rounding.

    Parameters
    ----------
    surface : LimitSurface
        Of float64 points. Memory and time grow by four with every level.
    levels : int
        How many levels to refine, at least 1.
    channel : str, optional
        A face-varying channel of the mesh, to compare instead of the points.
    workers : int
        Threads, as for `LimitSurface.evaluate`.

    Returns
    -------
    structured ndarray, (levels,), which notebooks show as a table
        Fields ``level`` (1, 2, ...), ``error``, the largest distance of a refined vertex from the
        surface at its parent parameters; ``order``, the observed order of convergence
        ``log2(error[level - 1] / error[level])``, where level 0 is the cage, under "sqrt3" by
        logarithms to the base of its step, the square root of 3; ``limit_error``, the
        largest distance of the vertices moved to their limit. Vertices without a limit are left
        out; NaN if there are none with one. The order is 2 where the surface is regular. Next to
        an extraordinary vertex of subdominant eigenvalue lambda, parents follow the parameters,
        not the points, and the error falls by lambda: the order tends to log2(1 / lambda), 1.29 at
        valence 3, 0.86 at 5, 0.61 as the valence grows.

    Raises
    ------
    ValueError
        For levels that are not an integer >= 1, or a channel that the mesh does not have.
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
    levels = checked_integer("levels", levels, 1)
    if not isinstance(surface, LimitSurface):
        raise TypeError(f"validate needs a LimitSurface, got {type(surface).__name__}")
    surface = surface.of_channel(channel)
    if numbers.type_of(surface.points).exact:
        raise TypeError("distances need square roots: give float64 points")
    table = np.zeros(
        levels,
        dtype=[("level", np.int64), ("error", float), ("order", float), ("limit_error", float)],
    )
    refuse_levels(surface.mesh, levels)
    # centred: the refiner rounds to the size of the coordinates
    used = surface.mesh.indices[0]
    surface = surface.with_points(surface.points - surface.points[used])
    mesh = refined(surface.mesh, 0, **surface.rules)
    errors = [_distance(mesh.points, surface, mesh, workers)]
    step = 3**0.5 if surface.rules["scheme"].turns_edges else 2
    # one level at a time; parameters are those of the cage's limit faces all along
    for level in range(1, levels + 1):
        mesh = refined(surface.mesh, level, **surface.rules)
        errors.append(_distance(mesh.points, surface, mesh, workers))
        table["limit_error"][level - 1] = _distance(mesh.limit_points, surface, mesh, workers)
    table["level"] = np.arange(1, levels + 1)
    table["error"] = errors[1:]
    with np.errstate(divide="ignore", invalid="ignore"):
        table["order"] = np.log(np.array(errors[:-1]) / errors[1:]) / np.log(step)
    return table.view(Report)


ROUNDING = 1e-12  # of the largest coordinate; what refinement adds up stays far below


def agrees(surface: LimitSurface, table: NDArray[Any], *, channel: str | None = None) -> bool:
    """Whether the limit errors in a table of `validate`, of a `channel` if so, are rounding alone.

    Where no vertex has a limit, nothing disagrees.

    Examples
    --------
    >>> import limitsurf as ls
    >>> surface = ls.LimitSurface(ls.Mesh([[0, 0], [1, 0], [1, 1], [0, 2]], [[0, 1, 2, 3]]))
    >>> ls.agrees(surface, ls.validate(surface, 2))
    True
    """
    mesh = surface.of_channel(channel).mesh
    points = mesh.points[mesh.indices]
    return not table["limit_error"].max() > ROUNDING * np.abs(points).max()


def on_refined(
    surface: LimitSurface, face: NDArray[Any], u: NDArray[Any], v: NDArray[Any]
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Queries of the once refined surface, that of ``refined(surface.mesh)``, for the same points.

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
        A derivative in u or v of a whole face is half as large there, and turned with its child.

    Examples
    --------
    >>> import numpy as np
    >>> import limitsurf as ls
    >>> from limitsurf.query import on_refined
    >>> surface = ls.LimitSurface(ls.Mesh([[0], [1], [1], [0]], [[0, 1, 2, 3]]))
    >>> [x.tolist() for x in on_refined(surface, np.array([0]), np.array([0.75]), np.array([0.25]))]
    [[1], [0.5], [0.5]]
    """
    mesh, limit_faces, lattice = surface.mesh, surface.limit_faces, surface.topology.lattice
    parent, corner = limit_faces.face[face], limit_faces.corner[face]
    if lattice.dual:
        return _on_dual(surface, mesh.offsets[parent], corner, u, v)
    flipped = np.zeros(len(face), dtype=bool) if lattice.flips else None
    part, s, t, _ = neighbourhood.child_at(lattice, u, v, flipped)
    child = np.argsort(lattice.parts)[part]
    more = len(lattice.children) - lattice.face_size  # children that are at no corner
    whole = corner < 0
    # a child at a corner has its own corner 0 there
    turn, sides = child % lattice.face_size, kernels.coordinates(s, t, lattice.sides)
    return (
        mesh.offsets[parent] + more * parent + np.where(whole, child, corner),
        np.where(whole, np.choose(turn, sides), u),
        np.where(whole, np.choose(turn, sides[1:] + sides[:1]), v),
    )


def _on_dual(
    surface: LimitSurface, first: Array, corner: Array, u: Array, v: Array
) -> tuple[Array, Array, Array]:
    """`on_refined` under a dual scheme: `first` are first corners of the faces of the cage.

    The square of a refined vertex is in four parts, one in each of the refined faces around it.
    """
    topology = surface.topology
    step = dual.Step.of(surface.mesh, topology.rules)
    sides, size = topology.lattice.sides, topology.lattice.face_size
    # of quads the quarters are squares, turned so that their corner 0 is at that of the quad
    part, s, t = squares.child_at(u, v)
    turn = np.where(corner < 0, np.array([0, 1, 3, 2])[part], 0)
    seen = kernels.coordinates(s, t, sides)
    x = np.where(corner < 0, np.choose(turn, seen), u)
    y = np.where(corner < 0, np.choose(turn, seen[1:] + seen[:1]), v)
    part, s, t = squares.child_at(x, y)
    role = np.array([0, 1, 3, 2])[part]
    vertex = first + np.where(corner < 0, turn, corner)
    there = step.corner_at[vertex, role]
    nowhere, there = there < 0, np.maximum(there, 0)  # around what has no limit
    # its corner 0 is in the middle of the square
    turned, seen = (role + 2) % size, kernels.coordinates(s, t, sides)
    s, t = np.choose(turned, seen), np.choose(turned, seen[1:] + seen[:1])
    fine = step.child(np.zeros(step.n_points))
    own, whole = fine.corner_face[there], fine.sizes[fine.corner_face[there]] == size
    place = there - fine.offsets[own]
    # in quads it is the quarter at that corner
    seen = kernels.coordinates(s / 2, t / 2, sides)
    back = -place % size
    x, y = np.choose(back, seen), np.choose(back, seen[1:] + seen[:1])
    limit = first_limit_face(fine, topology.lattice)[own] + np.where(whole, 0, place)
    x, s = (np.where(nowhere, np.nan, found) for found in (x, s))
    return limit, np.where(whole, x, s), np.where(whole, y, t)


_PORTION = 1 << 16  # queries that are in memory at once, with all that is compared


def refinement_gap(
    surface: LimitSurface,
    face: NDArray[Any],
    u: NDArray[Any],
    v: NDArray[Any],
    *,
    channel: str | None = None,
    workers: int = 1,
) -> tuple[float, float]:
    """Largest differences of positions and unit normals from those on the once refined cage.

    There the same places lie in other patches with other control points: that both agree checks
    evaluation against refinement at any (face, u, v), not at refined vertices alone. NaN on both
    sides agree; a NaN on one side alone gives NaN.

    Parameters
    ----------
    surface : LimitSurface
        Of float64 points.
    face, u, v : (Q,) arrays
        Queries as for `LimitSurface.evaluate`.
    channel, workers
        As for `LimitSurface.evaluate`.

    Returns
    -------
    position, normal : float
        The latter 0 if points, or the values of `channel`, are not of shape (n, 3): without normals
        there is nothing that differs.

    Examples
    --------
    >>> import numpy as np
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 1]], [[0, 1, 2, 3]])
    >>> query = np.array([0]), np.array([0.7]), np.ones(1)
    >>> max(ls.refinement_gap(ls.LimitSurface(square), *query)) < 1e-15
    True
    """
    fine = LimitSurface(refined(surface.mesh, **surface.rules))
    options: Any = {"channel": channel, "workers": workers}
    in_space = surface.of_channel(channel).points.shape[1:] == (3,)
    largest = np.zeros(1 + in_space)
    for start in range(0, len(face), _PORTION):
        part = slice(start, start + _PORTION)
        f, x, y = face[part], u[part], v[part]
        there = on_refined(surface, f, x, y)
        pairs = [(surface.evaluate(f, x, y, **options), fine.evaluate(*there, **options))]
        if in_space:
            pairs.append((surface.normal(f, x, y, **options), fine.normal(*there, **options)))
        gaps = [np.where(np.isnan(a) & np.isnan(b), 0, np.abs(a - b)) for a, b in pairs]
        # (a NaN stays)
        largest = np.maximum(largest, [gap.max(initial=0) for gap in gaps])
    return float(largest[0]), float(largest[1]) if in_space else 0.0


def _distance(
    points: NDArray[Any], surface: LimitSurface, mesh: RefinedMesh, workers: int
) -> float:
    """Largest distance of points (n_vertices, ...) from the surface at the parents of `mesh`."""
    place = mesh.parent_face >= 0
    parents = mesh.parent_face[place], mesh.parent_u[place], mesh.parent_v[place]
    gap = (points[place] - surface.evaluate(*parents, workers=workers)).reshape(
        int(place.sum()), -1
    )
    gap = gap[~np.isnan(gap).any(axis=1)]
    size = float(np.abs(gap).max(initial=0))  # squares of large gaps would overflow
    if not len(gap) or size == 0:
        return size if len(gap) else float("nan")
    return size * float(np.sqrt(((gap / size) ** 2).sum(axis=1).max()))
