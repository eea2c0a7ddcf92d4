"""What integrals ask of a surface, of its limit faces and of a tolerance."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf import numbers
from limitsurf.engine.protocol import Request
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_LEAST = 1e-15  # relative: float64 does not tell more


def checked(surface: Any, what: str, channel: str | None = None) -> LimitSurface:
    """A surface with points in space, or that of one of its channels."""
    if not isinstance(surface, LimitSurface):
        raise TypeError(f"{what} needs a LimitSurface, got {type(surface).__name__}")
    found = surface.of_channel(channel)
    if found.points.shape[1:] != (3,):
        raise ValueError(f"{what} needs points of shape (n_vertices, 3), got {found.points.shape}")
    return found


def is_exact(surface: LimitSurface) -> bool:
    """Whether points are Fractions."""
    return numbers.type_of(surface.points).exact


def refuse_open(surface: LimitSurface, who_needs: str) -> None:
    """Refuse a surface that bounds no body: with an edge that is not passed once each way.

    Raises
    ------
    ValueError
        With the first such edge, after what begins the message, such as "the volume needs".
    """
    mesh, known = surface.mesh, surface.patches.with_limit
    if not known.any():
        raise ValueError(f"{who_needs} a closed surface, but no face has a limit")
    balance, sides = _passed(surface)
    bad = np.flatnonzero(balance != 0)
    if not len(bad):
        return
    sides = sides[bad[0]]
    a, b = sorted(mesh.edges[bad[0]].tolist())
    on = (
        "has a face on one side only (holes and faces without a limit count as none)"
        if sides == 1
        else "is passed the same way by faces on both sides"
        if sides == 2
        else f"of {sides} faces is passed more often one way than the other"
    )
    more = f", and {len(bad) - 1} more edges are like it" if len(bad) > 1 else ""
    raise ValueError(
        f"{who_needs} a closed surface whose faces are consistently oriented, but the edge of "
        f"vertices {a} and {b} {on}{more}: close it, or turn faces over"
    )


def refuse_turned(surface: LimitSurface, who_needs: str) -> None:
    """Refuse a surface some faces of which are turned over beside their neighbours.

    Raises
    ------
    ValueError
        With the first edge that two faces pass the same way, after what begins the message.
    """
    balance, sides = _passed(surface)
    bad = np.flatnonzero((sides == 2) & (balance != 0))
    if len(bad):
        a, b = sorted(surface.mesh.edges[bad[0]].tolist())
        more = f", and {len(bad) - 1} more edges are like it" if len(bad) > 1 else ""
        raise ValueError(
            f"{who_needs} faces that are consistently oriented, but the edge of vertices {a} and "
            f"{b} is passed the same way by faces on both sides{more}: turn faces over"
        )


def _passed(surface: LimitSurface) -> tuple[Array, Array]:
    """How often edges are passed by faces with limits, one way less the other, and both, (E,)."""
    mesh, known = surface.mesh, surface.patches.with_limit
    whole = np.ones(mesh.n_faces, dtype=bool)
    whole[surface.limit_faces.face[~known]] = False
    corner = np.flatnonzero(whole[mesh.corner_face])
    start, end = mesh.indices[corner], mesh.indices[mesh.next_corner[corner]]
    edge, forward = mesh.corner_edge[corner], np.where(start < end, 1, -1)
    n = mesh.n_edges
    return np.bincount(edge, forward, minlength=n), np.bincount(edge, minlength=n)


def chosen_faces(surface: LimitSurface, face: ArrayLike | None) -> Array:
    """Limit faces (F,) that are asked for, all by default."""
    n = len(surface.limit_faces)
    if face is None:
        return np.arange(n)
    request = Request.of(np.ravel(np.asarray(face)), 0.0, 0.0, False, 1)
    request.check(n, surface.topology.lattice)
    return request.face.astype(np.int64)


def refuse_exact(what: str) -> None:
    """Refuse Fractions where there are roots."""
    raise TypeError(
        f"the {what} needs square roots, which Fractions do not have: give float64 points; "
        "volume, and centroid and inertia of the body, know Fractions"
    )


def check_rtol(rtol: Any) -> None:
    """Refuse a relative tolerance that float64 cannot reach, or that says nothing."""
    if not isinstance(rtol, (int, float, np.floating)) or not _LEAST <= rtol < 1:
        raise ValueError(f"rtol must be a number from {_LEAST} to below 1, got {rtol!r}")
