"""Limit faces as Bezier patches: the public call of the room `pieces`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from numpy.typing import ArrayLike

from limitsurf import numbers
from limitsurf.cage.checks import checked_integer
from limitsurf.engine.packing import one_by_one
from limitsurf.engine.protocol import threads
from limitsurf.integrals.checks import chosen_faces
from limitsurf.pieces.cells import BezierPatches as BezierPatches
from limitsurf.pieces.cells import BezierRest as BezierRest
from limitsurf.pieces.cells import cut
from limitsurf.refine import over_values
from limitsurf.surface import LimitSurface

_DEPTH = 8
_DEEPEST = 52  # beyond it, float64 cannot tell the cells at u = 1 apart


def bezier_patches(
    surface: LimitSurface,
    *,
    face: ArrayLike | None = None,
    depth: int | None = None,
    weights: bool = False,
    channel: str | None = None,
    workers: int = 1,
) -> BezierPatches:
    """Limit faces as Bezier patches: polynomial pieces that are the surface itself.

    A limit face amid regular vertices is one patch: by Catmull-Clark's scheme a square of degree 3
    in each direction, by Loop's a triangle of degree 4; by "bilinear" and "linear", of degree 1, it
    is one everywhere. Others are cut where pieces
    meet: into the faces of refined n-gons and around crowded extraordinary vertices, of quads into
    strips along semi-sharp creases, and towards each special corner into rings of three squares or
    triangles, each half the size of the one before. There the pieces go on for ever: what is beyond
    the last ring is named, with bounds.

    Parameters
    ----------
    surface : LimitSurface
    face : array_like of int, optional
        Limit faces, any number of them in any order; all by default. Those without a limit (holes)
        have no patches.
    depth : int, optional
        How many rings there are around each special corner of a face, 0 to 52; 8 by default. They
        are counted from the edges of the cage: on a limit face of an n-gon, whose sides are half
        edges, there is one less, and as many less as a face is split, so that what remains at a
        vertex is of one size on all of its faces.
    weights : bool
        Whether to give the coefficients also as sparse rows over the vertices of the cage; with
        `channel` over its values, ``surface.mesh.channels[channel][0]``.
    channel : str, optional
        A face-varying channel of the mesh, to give the patches of instead of the points.
    workers : int
        Threads, as for `LimitSurface.evaluate`, among which float64 patches are divided.

    Returns
    -------
    BezierPatches
        Arrays with a row to each patch, in the order of `face`, those of a limit face together;
        float64, or Fractions if the points are exact. ``rest`` has what remains.

    Raises
    ------
    IndexError
        For a face out of range.
    TypeError
        For faces that are not integers.
    ValueError
        For a depth out of range, or a channel that the mesh does not have.
    MemoryError
        At once, for more patches than there is memory for.

    Notes
    -----
    At a place in a patch its polynomial is ``surface.evaluate`` at that (u, v): exactly for
    Fractions; for float64 within 1e-14 of the size of the cage around it and some last digits. So
    neighbours meet, and what is inside the convex hull of a patch's points holds the patch.

    Around a special corner the pieces are those of Stam, "Exact evaluation of Catmull-Clark
    subdivision surfaces at arbitrary parameter values", SIGGRAPH 1998, and "Evaluation of Loop
    subdivision surfaces", SIGGRAPH course notes 1999. The change of basis, and the bound of what
    remains, are derived in ``derivations/pieces.py``.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> cube = ls.LimitSurface(ls.Mesh(points, quads))
    >>> patches = ls.bezier_patches(cube, face=0, depth=5)
    >>> len(patches), patches.points.shape  # the face is split, and each corner is special
    (48, (48, 4, 4, 3))
    >>> patches.rest
    BezierRest(4 cells)
    >>> float(patches.rest.size.max())
    0.03125
    """
    if not isinstance(surface, LimitSurface):
        raise TypeError(f"bezier_patches needs a LimitSurface, got {type(surface).__name__}")
    depth = _DEPTH if depth is None else checked_integer("depth", depth, 0)
    if depth > _DEEPEST:
        raise ValueError(
            f"depth must be 0 to {_DEEPEST}, got {depth}: beyond it float64 cannot tell "
            "the u and v of patches apart"
        )
    faces, found = chosen_faces(surface, face), surface.of_channel(channel)
    exact = numbers.type_of(found.points).exact
    # the sides of limit faces of n-gons are half edges
    rings: Any = depth - (surface.limit_faces.corner[faces] >= 0)
    topology = found.topology
    patches = topology.exact_groups.patches if exact else topology.patches
    points = numbers.type_of(found.points).array(found.points)
    divided = one_by_one(threads(workers))
    made = cut(patches, topology.rules.scheme, points, faces, rings, weights, divided)
    if channel is None or made.weights is None:
        return made
    rows = over_values(made.weights, found.mesh, surface.mesh.channels[channel])
    return replace(made, weights=rows)
