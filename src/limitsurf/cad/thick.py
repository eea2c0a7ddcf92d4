"""Cages of what is between a surface and its offset: thick solids."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cad.offset import offset
from limitsurf.cad.offset_cage import OffsetCage, named_rules
from limitsurf.cage.mesh import Mesh
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_SHARP = 10.0


def thickened(
    surface: LimitSurface,
    distance: float,
    *,
    tolerance: float | None = None,
    levels: int = 3,
    channel: str | None = None,
    workers: int = 1,
) -> Mesh:
    """A cage of the solid between a surface and its offset, closed by walls along open edges.

    Parameters
    ----------
    surface : LimitSurface
        Of float64 points (n_vertices, 3).
    distance : float
        As for `offset`; not 0.
    tolerance, levels
        As for `OffsetSurface.fit`, by which the offset is made; so are creases.
    channel : str, optional
        A face-varying channel of three columns instead of the points.
    workers : int
        Threads among which queries are divided.

    Returns
    -------
    Mesh
        Vertices of the surface's cage (refined as often as the tolerance asks), then those of the
        offset in the same order; faces of both, one of them turned over, so that normals are
        outwards, then walls. Open edges are infinitely sharp: the surface is the limit of its part
        of the cage, exactly. Around a closed surface there is a void, or the solid is within it.

    Raises
    ------
    ValueError
        For distance 0, holes, non-manifold edges, and open cages of schemes without creases, whose
        walls would be rounded off; and as `offset`.

    Notes
    -----
    In schemes of quadrilaterals walls are ruled, by straight lines between both rims. That nothing
    intersects is not checked: `OffsetSurface.folds` tells. The volume of the solid is
    d A - d^2 M + d^3 K / 3 with the area A, and the integrals M and K of the mean and of the
    Gaussian curvature, by Steiner's formula (``derivations/offsets.py``).

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> plate = ls.thickened(ls.LimitSurface(square), 0.25)
    >>> plate.is_closed, round(ls.volume(ls.LimitSurface(plate)), 9)
    (True, 0.25)
    """
    made = offset(surface, distance, tolerance=tolerance, channel=channel, workers=workers)
    surface = made.surface
    if not distance:
        raise ValueError("distance must not be 0: there is nothing between a surface and itself")
    mesh = surface.mesh
    if len(mesh.holes):
        raise ValueError(f"no solid of a cage with holes: face {mesh.holes[0]} is the first")
    if mesh.nonmanifold_edge.any():
        ends = mesh.edges[np.argmax(mesh.nonmanifold_edge)].tolist()
        raise ValueError(f"no solid of a cage with non-manifold edges: {ends} is the first")
    _refuse_walls(surface)
    fitted = made.fit(levels=levels)
    return _closed(fitted, surface, distance)


def _refuse_walls(surface: LimitSurface) -> None:
    """Complain of open cages whose walls would not be sharp."""
    mesh, scheme = surface.mesh, surface.topology.rules.scheme
    if not mesh.boundary_edge.any():
        return
    if surface.topology.lattice.dual:
        raise ValueError(
            f"{scheme.name} has no sharp creases for walls: thicken a closed cage, or one of "
            "another scheme"
        )
    if surface.rules["boundary"] == "none":
        raise ValueError('faces at open edges have no limit with boundary="none": use another rule')


def _closed(fitted: OffsetCage, surface: LimitSurface, distance: float) -> Mesh:
    """Both cages and walls between their rims."""
    base, other = fitted.base, fitted.mesh
    n = base.n_vertices
    low, high = (0, n) if distance > 0 else (n, 0)  # sheets whose normals point in and out
    following = base.offsets[base.corner_face] + base.sizes[base.corner_face] - 1
    back = following - (np.arange(base.n_corners) - base.offsets[base.corner_face])
    upper, lower = base.indices + high, base.indices[back] + low
    rim = np.flatnonzero(base.boundary_edge[base.corner_edge])
    a, b = base.indices[rim], base.indices[base.next_corner[rim]]
    walls = np.stack([b + high, a + high, a + low, b + low], axis=1)
    if surface.topology.lattice.sloped:
        walls = walls[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    sizes = [base.sizes, base.sizes, np.full(len(walls), walls.shape[1])]
    faces = np.concatenate(sizes), np.concatenate([upper, lower, walls.ravel()])
    edges, sharpness = base.creases
    tagged, sharp = base.corners
    single = base.boundary_vertex & (base.vertex_faces == 1)
    single &= surface.rules["boundary"] == "edge_and_corner"
    single[tagged[np.asarray(sharp, dtype=float) >= _SHARP]] = True
    upright = np.flatnonzero(single & base.boundary_vertex)
    rims = np.sort(np.stack([a, b], axis=1), axis=1)
    inner = ~base.boundary_edge[base.edge_numbers(edges)] if len(edges) else np.zeros(0, dtype=bool)
    kept = edges[inner]
    infinite = [np.full(k, np.inf) for k in (len(rims), len(rims), len(upright))]
    both = np.stack([upright, upright + n], axis=1)
    creases = (
        np.concatenate([kept, kept + n, rims, rims + n, both]),
        np.concatenate([np.tile(np.asarray(sharpness, dtype=float)[inner], 2), *infinite]),
    )
    corners = np.concatenate([tagged, tagged + n]), np.tile(np.asarray(sharp, dtype=float), 2)
    points = np.concatenate([base.points, other.points])
    tags: dict[str, Any] = {"creases": creases, "corners": corners, "units": base.units}
    tags["up"] = base.up
    return Mesh(points, faces, **tags, **named_rules(surface))
