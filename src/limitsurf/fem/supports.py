"""Supports of thin shells: linear conditions on displacements, and what they leave free.

Conditions are rows over the components of all unknowns. They are made independent and solved for
as many components, which the others then determine: nothing is penalised, and matrices of what
is left stay symmetric.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf.fem.checks import power_of_two, reals
from limitsurf.fem.grading import Grading
from limitsurf.fem.parents import traced_sides
from limitsurf.fem.phantoms import Phantoms

if TYPE_CHECKING:
    from limitsurf.fem.space import Space
    from limitsurf.surface import LimitSurface

Array = NDArray[Any]
Where: TypeAlias = Callable[[Array], ArrayLike]

_AXES = {"x": 0, "y": 1, "z": 2}
# how much smaller than the largest a diagonal entry of a triangle is that stands for a condition
# which others imply; entries of solutions below are rounding
_DEPENDENT, _NOTHING = 1e-10, 1e-13
_NAMED = 6  # motions in messages
_HELD = 1e-9  # how much of a motion, by which what is farthest moves by 1, is nothing


@dataclass(frozen=True, eq=False)
class Support:
    """Conditions on displacements, made by the functions of this module.

    Attributes
    ----------
    kind : str
        "fixed", "clamped", "symmetric", "at" or "rigid modes".
    """

    kind: str
    edges: Array | None = None
    where: Where | None = None
    components: tuple[int, ...] = (0, 1, 2)
    plane: tuple[Array, Array] | None = None
    places: tuple[Array, Array, Array] | None = None


def fixed(
    edges: ArrayLike | None = None,
    components: Sequence[int | str] = (0, 1, 2),
    *,
    where: Where | None = None,
) -> Support:
    """Components of displacements are zero along edges.

    Parameters
    ----------
    edges : (k, 2) array_like of int, optional
        Edges of the cage on which the space was built, as pairs of vertices; boundary edges and
        creases. All boundary edges by default.
    components : sequence of 0, 1, 2, "x", "y" or "z"
    where : callable, optional
        Instead of `edges`: which boundary edges of the space's surface, told by three points of
        each: ``where(points)`` gets (m, 3) positions and returns (m,) booleans; edges of which all
        three are chosen are meant.

    Returns
    -------
    Support

    Examples
    --------
    >>> from limitsurf.fem.supports import fixed
    >>> fixed(where=lambda x: x[:, 0] < 1e-9, components="z").components
    (2,)
    """
    return Support("fixed", *_edges(edges, where), _components(components))


def clamped(edges: ArrayLike | None = None, *, where: Where | None = None) -> Support:
    """Displacements are zero along edges, and the shell does not turn about them.

    Parameters
    ----------
    edges, where
        As of `fixed`.

    Returns
    -------
    Support

    Notes
    -----
    On triangles ("loop") functions for which this holds all along an edge have no second
    derivatives across it either, with free ends as with natural ones: solutions converge slower.

    Examples
    --------
    >>> from limitsurf.fem.supports import clamped
    >>> clamped([[0, 1], [1, 2]]).edges.tolist()
    [[0, 1], [1, 2]]
    """
    return Support("clamped", *_edges(edges, where))


def symmetric(
    plane: str | tuple[ArrayLike, ArrayLike],
    *,
    edges: ArrayLike | None = None,
    where: Where | None = None,
) -> Support:
    """Edges are in a plane of symmetry: displacements stay in it, the shell does not turn about it.

    Parameters
    ----------
    plane : "x", "y" or "z", or (origin, normal)
        Whose normal is that axis, through the origin; or a point of it and its normal.
    edges, where
        As of `fixed`; by default all boundary edges that are in the plane, to 1e-9 of the size.

    Returns
    -------
    Support

    Raises
    ------
    ValueError
        For an axis that is none, or a normal without a direction.

    Examples
    --------
    >>> from limitsurf.fem.supports import symmetric
    >>> symmetric("y").plane[1].tolist()
    [0.0, 1.0, 0.0]
    """
    if isinstance(plane, str):
        if plane not in _AXES:
            raise ValueError(f"plane must be x, y or z, or (origin, normal), got {plane!r}")
        origin, normal = np.zeros(3), np.eye(3)[_AXES[plane]]
    else:
        if not isinstance(plane, (tuple, list)) or len(plane) != 2:
            raise ValueError(f"plane must be x, y or z, or (origin, normal), got {plane!r}")
        origin, normal = (reals("plane", x) for x in plane)
        if origin.shape != (3,) or normal.shape != (3,):
            raise ValueError("plane: origin and normal must be points of 3 numbers each")
        if not np.isfinite(origin).all() or not np.isfinite(normal).all() or not normal.any():
            raise ValueError(
                f"plane: origin {origin.tolist()} and normal {normal.tolist()} must be finite, "
                "and the normal not 0"
            )
        normal = normal / np.abs(normal).max()
        normal = normal / np.linalg.norm(normal)
    return Support("symmetric", *_edges(edges, where), plane=(origin, normal))


def at(
    face: ArrayLike, u: ArrayLike, v: ArrayLike, components: Sequence[int | str] = (0, 1, 2)
) -> Support:
    """Components of displacements are zero at places.

    Parameters
    ----------
    face, u, v : array_like
        Limit faces of the space's surface, and parameters; they broadcast.
    components : sequence of 0, 1, 2, "x", "y" or "z"

    Returns
    -------
    Support

    Examples
    --------
    >>> from limitsurf.fem.supports import at
    >>> at(3, [0.0, 1.0], 0.5, "xy").components
    (0, 1)
    """
    given = [np.asarray(face), reals("u", u), reals("v", v)]
    try:
        places = np.broadcast_arrays(*given)
    except ValueError:
        shapes = ", ".join(str(x.shape) for x in given)
        raise ValueError(f"face, u and v must broadcast, got shapes {shapes}") from None
    flat = tuple(x.ravel() for x in places)
    return Support("at", components=_components(components), places=(flat[0], flat[1], flat[2]))


def rigid_modes_removed() -> Support:
    """Rigid motions that other supports leave are stopped at single unknowns, as many as there are.

    Only loads that balance may be borne so: `ThinShell.solve` says if they do not.

    Returns
    -------
    Support

    Examples
    --------
    >>> from limitsurf.fem.supports import rigid_modes_removed
    >>> rigid_modes_removed().kind
    'rigid modes'
    """
    return Support("rigid modes")


def _edges(edges: ArrayLike | None, where: Where | None) -> tuple[Array | None, Where | None]:
    if edges is not None and where is not None:
        raise ValueError("give edges or where, not both")
    if where is not None and not callable(where):
        raise TypeError(f"where must be a function of points, got {type(where).__name__}")
    if edges is None:
        return None, where
    try:
        found = np.asarray(edges)
    except ValueError:  # rows of different lengths
        found = np.zeros(0)
    if found.ndim != 2 or found.shape[1] != 2 or found.dtype.kind not in "iu":
        raise ValueError(
            f"edges: got {found.dtype} of shape {found.shape}, need integers (k, 2), pairs of "
            "vertices"
        )
    return found, None


def _components(given: Sequence[int | str]) -> tuple[int, ...]:
    if not isinstance(given, (Sequence, np.ndarray)):
        raise TypeError(
            f"components must be a sequence, such as (2,) or 'z', got {type(given).__name__}"
        )
    found = [_AXES.get(x, x) if isinstance(x, str) else x for x in given]
    for x in found:
        if x not in (0, 1, 2) or isinstance(x, bool):
            raise ValueError(f"components must be of 0, 1, 2 or x, y, z, got {x!r}")
    if not found:
        raise ValueError("components: got none, need some of 0, 1, 2 or x, y, z")
    return tuple(sorted({int(x) for x in found}))


# --- Conditions as rows


def conditions(space: Space, supports: Sequence[Support]) -> Any:
    """Rows (m, 3 n) over the components of all unknowns, some of which may follow from others."""
    from scipy.sparse import csr_array, vstack

    found = [csr_array((0, 3 * space.n))]
    for one in supports:
        if not isinstance(one, Support):
            raise TypeError(
                f"supports are made by limitsurf.fem.supports, got {type(one).__name__}"
            )
        if one.kind == "rigid modes":
            continue
        if one.kind == "at":
            assert one.places is not None
            rows = values_at(space, *one.places, "at")
            found += [_component(rows, k) for k in one.components]
            continue
        corners, ends = _sides(space, one)
        along = space.surface.limit_faces.along
        # enough for a polynomial along each side
        each = np.linspace(0, 1, space.surface.topology.rules.scheme.spline.degree + 1)
        value = space.rows(*along(corners[:, None], each))
        if one.plane is None:
            found += [_component(value, k) for k in one.components]
        else:
            found.append(_along(value, np.broadcast_to(one.plane[1], (value.shape[0], 3))))
        if one.kind != "fixed":
            found.append(turning(space, *_enough_turns(space, corners, ends, value))[0])
    return vstack(found, format="csr")


def values_at(space: Space, face: ArrayLike, u: ArrayLike, v: ArrayLike, what: str) -> Any:
    """Rows of values at places (k,), a ValueError where there are none."""
    rows: Any = space.surface.weights(face, u, v)
    bad = np.flatnonzero(~np.isfinite(rows.data))
    if len(bad):
        k = int(np.searchsorted(rows.indptr, bad[0], side="right")) - 1
        raise ValueError(
            f"{what}: there is no point at place {k}, (face, u, v) = "
            f"({np.ravel(face)[k]}, {np.ravel(u)[k]}, {np.ravel(v)[k]}): u and v must be numbers, "
            "and the limit face must have a limit"
        )
    return rows if space.grading is None else rows @ space.extraction


def _component(rows: Any, k: int) -> Any:
    """Rows over unknowns as rows over component k of theirs."""
    from scipy.sparse import csr_array

    shape = rows.shape[0], 3 * rows.shape[1]
    return csr_array((rows.data, 3 * rows.indices.astype(np.int64) + k, rows.indptr), shape=shape)


def _along(rows: Any, directions: Array) -> Any:
    """Of the share of displacements in a direction (m, 3) for each row."""
    from scipy.sparse import csr_array

    count = np.diff(rows.indptr)
    data = rows.data[:, None] * np.repeat(directions, count, axis=0)
    column = 3 * rows.indices.astype(np.int64)[:, None] + np.arange(3)
    shape = rows.shape[0], 3 * rows.shape[1]
    return csr_array((data.ravel(), column.ravel(), 3 * rows.indptr.astype(np.int64)), shape=shape)


def tangents(space: Space, corners: Array, t: ArrayLike) -> tuple[Array, Array, Array, Array]:
    """Derivatives (k, 3) by u, by v and along sides by t, and the units (k, 1) that they are in.

    At t along the sides that begin at corners of the mesh.
    """
    side = space.surface.limit_faces.along
    jet = space.surface.jet(*side(corners, t), order=1)
    du, dv = jet[1, 0], jet[0, 1]
    unit = power_of_two(np.stack([du, dv], axis=1), (1, 2))[:, 0]
    du, dv = du / unit, dv / unit
    # two places on one side of the middle of an edge, for in n-gons its halves are of two faces
    low = np.where(np.asarray(t) <= 0.5, 0.0, 0.75)
    (_, u0, v0), (_, u1, v1) = side(corners, low), side(corners, low + 0.25)
    return du, dv, 4 * ((u1 - u0)[:, None] * du + (v1 - v0)[:, None] * dv), unit


def turning(space: Space, corners: Array, t: ArrayLike) -> tuple[Any, Array]:
    """Rows of how far the shell turns about sides from corners of the mesh on, at t along each.

    By ``-n . du/dc``, where c is across (``derivations/thin_shells.py``, 5); rows of zeros where
    there is no normal. Also the derivatives (k, 3) of the surface along the sides by t.
    """
    rows, shares, n, along = _across(space, corners, t)
    return _along(rows[0], shares[0] * -n) + _along(rows[1], shares[1] * -n), along


def _across(space: Space, corners: Array, t: ArrayLike) -> tuple[list[Any], Array, Array, Array]:
    """Derivatives of functions across sides from corners of the mesh on, at t along each.

    Rows of those by u and by v, and how much of each (2, k, 1) there is; normals (k, 3), and what
    the surface has along the sides by t.
    """
    surface = space.surface
    face, u, v = surface.limit_faces.along(corners, t)
    n = surface.normal(face, u, v)
    du, dv, along, unit = tangents(space, corners, t)
    with np.errstate(invalid="ignore", divide="ignore"):
        across = np.cross(n, along / np.linalg.norm(along, axis=1, keepdims=True))
        e, f, g = (np.einsum("ij,ij->i", a, b) for a, b in ((du, du), (du, dv), (dv, dv)))
        p, q = (np.einsum("ij,ij->i", across, a) for a in (du, dv))
        shares = (np.stack([g * p - f * q, e * q - f * p]) / (e * g - f * f))[:, :, None] / unit
    known = np.isfinite(shares * n).all(axis=(0, 2))
    shares, n = np.where(known[:, None], shares, 0), np.where(known[:, None], n, 0)
    rows = surface.weights(face, u, v, nu=[(1, 0), (0, 1)])
    for row in rows:  # of vertices without derivatives
        row.data[~np.isfinite(row.data)] = 0
    rows = [row @ space.extraction for row in rows] if space.grading is not None else rows
    return rows, shares, n, along * unit


def _enough_turns(space: Space, corners: Array, ends: Array, value: Any) -> tuple[Array, Array]:
    """At which places (k,), t along sides, turns are to be held so that they are all along.

    As many as a spline along these edges has coefficients: more would hold it still. In graded
    spaces, where levels meet, as many as there are derivatives across of functions that are 0 on
    the edges, whose values have the rows `value`; which, QR with pivoting tells (Sommariva and
    Vianello, "Computing approximate Fekete points by QR factorizations of Vandermonde matrices",
    Comput. Math. Appl. 57, 2009).
    """
    from scipy.sparse import diags_array

    first, last = corners[ends[:, 0]], corners[ends[:, 1]]
    place = np.concatenate([corners, corners, first, last])
    count = len(corners), len(corners), len(first), len(last)
    t = np.repeat([0.0, 1.0, 0.25, 0.75], count)
    grading = space.grading
    if not isinstance(grading, Grading) or not np.ptp(
        grading.level[space.surface.mesh.corner_face[corners]]
    ):
        return place, t
    rows, shares, _, _ = _across(space, place, t)
    found = sum(diags_array(x.ravel()) @ row for x, row in zip(shares, rows, strict=True))
    # a copy: SciPy may sort entries of what it is given in place, which rows of components share
    kept = _independent_rows((found @ null_space(value.copy())).tocsr())
    return place[kept], t[kept]


def _sides(space: Space, support: Support) -> tuple[Array, Array]:
    """Corners of the space's mesh that sides begin at, and at which ends (k, 2) a spline ends."""
    grading = space.grading
    surface = space.surface if isinstance(grading, Grading) else space.refined_surface
    mesh = surface.mesh
    if surface.topology.lattice.dual:
        raise ValueError(
            f"edges have no place on surfaces of scheme {surface.topology.rules.scheme.name!r}: "
            "support places by limitsurf.fem.supports.at"
        )
    whole = surface.patches.with_limit[surface.limit_faces.first]
    if support.edges is not None:
        corners = traced_sides(space, support.edges)
        if isinstance(grading, Grading):
            corners = np.flatnonzero(np.isin(grading.sides[0], corners))
    else:
        both = mesh.edge_corners
        there = (both >= 0) & whole[mesh.corner_face[both]]
        corners = both[(there.sum(axis=1) == 1)[:, None] & there]
        if isinstance(grading, Grading):
            corners = corners[grading.rim[corners]]
        if support.where is not None:
            corners = corners[_chosen(surface, corners, support.where)]
        elif support.plane is not None:
            origin, normal = support.plane
            near = 1e-9 * float(np.ptp(surface.points, axis=0).max(initial=0))
            points = surface.evaluate(*surface.limit_faces.along(corners[:, None], [0, 0.5, 1]))
            corners = corners[(np.abs((points - origin) @ normal) <= near).all(axis=1)]
    if not len(corners):
        what = "no boundary edge" if support.edges is None else "no edge"
        raise ValueError(f"{support.kind}: {what} of the surface is meant")
    ends = np.stack([mesh.indices[corners], mesh.indices[mesh.next_corner[corners]]], axis=1)
    n = mesh.n_vertices
    faces = np.bincount(mesh.indices[whole[mesh.corner_face]], minlength=n)
    last = (np.bincount(ends.ravel(), minlength=n) != 2) | (faces == 1)
    last[mesh.corners[0]] = True
    if isinstance(grading, Phantoms):
        return grading.placed(corners), last[ends]
    return corners, last[ends]


def _chosen(surface: LimitSurface, corners: Array, where: Where) -> Array:
    """Of which sides three points are all chosen."""
    points = surface.evaluate(*surface.limit_faces.along(corners[:, None], [0, 0.5, 1]))
    found = np.asarray(where(points.reshape(-1, 3)))
    if found.shape != (3 * len(corners),) or found.dtype != bool:
        raise ValueError(
            f"where must return {3 * len(corners)} booleans, one for each of so many points "
            f"(n, 3), got {found.dtype} of shape {found.shape}"
        )
    return np.asarray(found.reshape(-1, 3).all(axis=1))


# --- What is left


def null_space(rows: Any) -> Any:
    """A matrix (n, k) whose columns are all that rows (m, n) map to 0, with unit rows among them.

    Rows that share no unknowns with others are solved apart, by QR with pivoting.
    """
    from scipy.linalg import qr, solve_triangular
    from scipy.sparse import block_array, coo_array, eye_array
    from scipy.sparse.csgraph import connected_components

    rows = rows[np.asarray(abs(rows).sum(axis=1)) > 0]
    m, n = rows.shape
    if not m:
        return eye_array(n, format="csr")
    joined = block_array([[None, rows], [rows.T, None]], format="csr")
    label = connected_components(joined, directed=False)[1]
    # rows and unknowns of one part after the other; unknowns that no row has come alone
    by_row, by_unknown = (np.argsort(x, kind="stable") for x in (label[:m], label[m:]))
    of_row, of_unknown = label[:m][by_row], label[m:][by_unknown]
    free = np.ones(n, dtype=bool)
    found: list[tuple[Array, Array, Array]] = []
    entry = rows.tocoo()
    entries = np.argsort(label[entry.row], kind="stable")
    of_entry = label[entry.row][entries]
    place, column = np.argsort(by_row), np.argsort(by_unknown)
    for part in np.unique(of_row).tolist():
        (r0, r1), (c0, c1), (e0, e1) = (
            np.searchsorted(of, [part, part + 1]) for of in (of_row, of_unknown, of_entry)
        )
        columns, own = by_unknown[c0:c1], entries[e0:e1]
        dense = np.zeros((r1 - r0, c1 - c0))
        dense[place[entry.row[own]] - r0, column[entry.col[own]] - c0] = entry.data[own]
        dense /= np.linalg.norm(dense, axis=1, keepdims=True)
        r, pivot = qr(dense, mode="r", pivoting=True)
        rank = int(np.count_nonzero(np.abs(np.diag(r)) > _DEPENDENT * abs(r[0, 0])))
        solved = -solve_triangular(r[:rank, :rank], r[:rank, rank:])
        solved[np.abs(solved) < _NOTHING] = 0
        free[columns[pivot[:rank]]] = False
        i, j = np.nonzero(solved)
        found.append((columns[pivot[:rank]][i], columns[pivot[rank:]][j], solved[i, j]))
    kept = np.flatnonzero(free)
    row, column, value = (np.concatenate(x) for x in zip(*found, strict=True))
    number = np.cumsum(free) - 1
    data = np.concatenate([value, np.ones(len(kept))])
    places = np.concatenate([row, kept]), np.concatenate([number[column], number[kept]])
    return coo_array((data, places), shape=(n, len(kept))).tocsr()


def _independent_rows(rows: Any) -> Array:
    """As many rows of a sparse matrix as are independent, those that tell most apart first."""
    from scipy.linalg import qr
    from scipy.sparse.csgraph import connected_components

    size = np.sqrt(np.asarray((rows * rows).sum(axis=1)).ravel())
    there = np.flatnonzero(size > _NOTHING * size.max(initial=0))
    part = connected_components(abs(rows[there]) @ abs(rows[there]).T, directed=False)[1]
    found = []
    for one in np.split(there[np.argsort(part, kind="stable")], np.cumsum(np.bincount(part))[:-1]):
        some = rows[one]
        columns, inverse = np.unique(some.indices, return_inverse=True)
        dense = np.zeros((len(columns), len(one)))
        column = np.repeat(np.arange(len(one)), np.diff(some.indptr))
        dense[inverse, column] = some.data / size[one][column]
        r, pivot = qr(dense, mode="r", pivoting=True)
        rank = np.count_nonzero(np.abs(np.diag(r)) > _DEPENDENT * abs(r[0, 0]))
        found.append(one[pivot[:rank]])
    return np.concatenate([np.zeros(0, dtype=np.int64), *found])


def rigid_motions(space: Space) -> Any:
    """Coefficients (3 n, 6 parts) of the motions of each connected part: three along, three about.

    Sparse. Turns are about the middle of a part, by as much as moves what is farthest by 1.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    points = space.points
    count, part = connected_components(space.mass(), directed=False)
    size = np.bincount(part, minlength=count)
    middle = np.stack([np.bincount(part, x, minlength=count) / size for x in points.T], axis=1)
    away = points - middle[part]
    length = np.zeros(count)
    np.maximum.at(length, part, np.linalg.norm(away, axis=1))
    away /= np.where(length > 0, length, 1)[part, None]
    along = np.broadcast_to(np.eye(3), (space.n, 3, 3))
    about = np.stack([np.cross(axis, away) for axis in np.eye(3)], axis=2)
    found = np.concatenate([along, about], axis=2)  # (n, 3, 6)
    row = np.broadcast_to(np.arange(3 * space.n).reshape(-1, 3, 1), found.shape)
    column = np.broadcast_to(6 * part[:, None, None] + np.arange(6), found.shape)
    there = found != 0
    shape = 3 * space.n, 6 * count
    return coo_array((found[there], (row[there], column[there])), shape=shape).tocsr()


def motions_left(held: Any) -> Any:
    """Which motions (6 parts, q) rows (m, 6 parts) allow: sparse, those of a part together.

    Each row is of one part.
    """
    from scipy.sparse import csr_array

    held = held.tocsr()
    held.eliminate_zeros()
    parts = held.shape[1] // 6
    entry = held.tocoo()
    part, column = np.divmod(entry.col, 6)
    rows, first = np.unique(entry.row, return_index=True)
    owner = part[first]
    count = np.bincount(owner, minlength=parts)
    order = np.argsort(owner, kind="stable")
    within = np.empty(len(rows), dtype=np.int64)
    within[order] = np.arange(len(rows)) - (np.cumsum(count) - count)[owner[order]]
    turns = np.broadcast_to(np.eye(6), (parts, 6, 6)).copy()
    kept = np.zeros((parts, 6), dtype=bool)
    size = 8 << np.ceil(np.log2(np.maximum(count, 8) / 8)).astype(np.int64)
    for one in np.unique(size).tolist():  # parts of like numbers of rows at once
        here = np.flatnonzero(size == one)
        number = np.full(parts, -1)
        number[here] = np.arange(len(here))
        mine = np.flatnonzero(number[part] >= 0)
        dense = np.zeros((len(here), one, 6))
        place = within[np.searchsorted(rows, entry.row[mine])]
        dense[number[part[mine]], place, column[mine]] = entry.data[mine]
        _, s, turns[here] = np.linalg.svd(dense, full_matrices=False)
        kept[here] = s <= _HELD
    which, k = np.nonzero(kept)
    row = 6 * which[:, None] + np.arange(6)
    pointer = 6 * np.arange(len(which) + 1)
    found = csr_array(
        (turns[which, k].ravel(), row.ravel(), pointer), shape=(len(which), 6 * parts)
    )
    return found.T.tocsr()


def independent(motions: Any) -> Array:
    """As many components of unknowns as there are motions (3 n, q), which tell these apart.

    Motions of one part are together; parts share no unknowns.
    """
    from scipy.linalg import qr
    from scipy.sparse.csgraph import connected_components

    wide = motions.tocsr()
    joined = abs(wide).T @ abs(wide)
    part = connected_components(joined, directed=False)[1]
    by_column = wide.tocsc()
    found = []
    for one in np.split(np.argsort(part, kind="stable"), np.cumsum(np.bincount(part))[:-1]):
        some = by_column[:, one]
        rows = np.unique(some.indices)
        dense = np.zeros((len(rows), len(one)))
        column = np.repeat(np.arange(len(one)), np.diff(some.indptr))
        dense[np.searchsorted(rows, some.indices), column] = some.data
        found.append(rows[qr(dense.T, mode="r", pivoting=True)[1][: len(one)]])
    return np.concatenate(found)


def described(motions: Any) -> str:
    """What motions (6 parts, q) of `rigid_motions` are, in words, simple ones first."""
    kinds = [f"{what} {axis}" for what in ("moves along", "turns about") for axis in "xyz"]
    parts, total = motions.shape[0] // 6, motions.shape[1]
    columns = motions.tocsc()
    part = columns.indices[columns.indptr[:-1]] // 6
    enough = columns[:, np.flatnonzero(part <= np.sort(part)[min(_NAMED, total) - 1])]
    names = []
    for k in np.sort(independent(enough)).tolist():
        names.append(kinds[k % 6] + (f" of part {k // 6}" if parts > 1 else ""))
    more = total - len(names[:_NAMED])
    return ", ".join(names[:_NAMED] + ([f"and {more} more"] if more > 0 else []))
