"""Cages of spline faces that are regular parts of a limit surface."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.spatial import cKDTree

from limitsurf.cage.mesh import Mesh
from limitsurf.surface import LimitSurface

Array = NDArray[Any]
Faces = Any  # SplineFaces, which call this

_SAME = 1e-9  # of the size: points that are one
_EVEN = 1e-9  # of a span: knots that are evenly spaced
_DEGREE = 3
# of the 16 points of a cell the corners, and the 2 points beyond each side, against the corners
_CORNERS = np.array([[1, 1], [2, 1], [2, 2], [1, 2]])
_BEYOND = np.array([
    [[1, 0], [2, 0]], [[3, 1], [3, 2]], [[2, 3], [1, 3]], [[0, 2], [0, 1]],
])  # fmt: skip


def cage_of(faces: Faces) -> Mesh:
    """The cage whose limit surface faces are; see `SplineFaces.to_mesh`."""
    _refuse(faces)
    spans = faces.counts - _DEGREE
    nets, cell_face, place = _cells(faces, spans)  # (c, 4, 4, 3), (c,), (c, 2)
    size = float(np.ptp(faces.points, axis=0).max())
    corners = nets[:, _CORNERS[:, 0], _CORNERS[:, 1]]
    order = np.where(faces.reversed[cell_face, None], [0, 3, 2, 1], [0, 1, 2, 3])
    around = np.take_along_axis(corners, order[..., None], axis=1)
    points, indices = _welded(around.reshape(-1, 3), _SAME * size)
    quads = indices.reshape(-1, 4)
    mesh = Mesh(points, quads, units=faces.units)
    beyond = nets[:, _BEYOND[..., 0], _BEYOND[..., 1]]  # (c, 4, 2, 3)
    sides = np.where(faces.reversed[cell_face, None], [3, 2, 1, 0], [0, 1, 2, 3])
    beyond = np.take_along_axis(beyond, sides[..., None, None], axis=1)
    turned = faces.reversed[cell_face][:, None, None, None]
    beyond = np.where(turned, beyond[:, :, ::-1], beyond).reshape(-1, 2, 3)
    creases = _creases(mesh, beyond, 1e3 * _SAME * size)
    if len(creases):
        mesh = mesh.with_tags(creases=(creases, np.full(len(creases), np.inf)))
    _confirm(faces, mesh, cell_face, place, size)
    return mesh


def _named(faces: Faces, face: int) -> str:
    return f"face {face}" + (f" ({faces.names[face]!r})" if faces.names[face] else "")


def _refuse(faces: Faces) -> None:
    """Refuse what no regular limit face is.

    Raises
    ------
    ValueError
        Naming the first such face, and how many there are.
    """

    def refuse(bad: Array, text: str) -> None:
        which = np.flatnonzero(bad)
        if len(which):
            more = f", and {len(which) - 1} more like it" if len(which) > 1 else ""
            raise ValueError(f"no cage: {_named(faces, int(which[0]))} {text}{more}")

    degree = faces.degree
    refuse((degree != _DEGREE).any(axis=1), "is not of degree 3 in both directions")
    refuse(~faces.untrimmed, "has trims")
    sizes = faces.counts.prod(axis=1)
    first = faces.firsts[2]
    heavy = np.maximum.reduceat(faces.weights, first) != np.minimum.reduceat(faces.weights, first)
    refuse(heavy, "is rational")
    for axis, knots in enumerate((faces.knots_u, faces.knots_v)):
        count = faces.counts[:, axis]
        length = count + _DEGREE + 1
        owner = np.repeat(np.arange(len(sizes)), length)
        step = np.arange(len(owner)) - np.repeat(faces.firsts[axis], length) - _DEGREE
        spans = count - _DEGREE
        low = knots[faces.firsts[axis] + _DEGREE]
        high = knots[faces.firsts[axis] + count]
        even = low[owner] + (high - low)[owner] * np.clip(step / spans[owner], 0, 1)
        off = np.abs(knots - even) > _EVEN * ((high - low) / spans)[owner]
        uneven = np.bincount(owner[off], minlength=len(sizes)) > 0
        refuse(
            uneven,
            "has knots that are not uniform: it is no limit face amid regular vertices, "
            "and only near one beside a special one",
        )
        box = np.abs(faces.domain[:, axis] - np.stack([low, high], axis=1)).max(axis=1)
        refuse(box > _EVEN * (high - low), "is a part of its surface")


def _cells(faces: Faces, spans: Array) -> tuple[Array, Array, Array]:
    """The 4 x 4 points of each cell of all faces, in the basis of uniform knots; face and place."""
    nets, owner, place = [], [], []
    kinds, which = np.unique(spans, axis=0, return_inverse=True)
    for k, (m, n) in enumerate(kinds.tolist()):
        here = np.flatnonzero(which.ravel() == k)
        size = (m + _DEGREE) * (n + _DEGREE)
        rows = faces.firsts[2][here, None] + np.arange(size)
        net = faces.points[rows].reshape(len(here), m + _DEGREE, n + _DEGREE, 3)
        net = np.einsum("ai,bj,fijk->fabk", _unclamped(m), _unclamped(n), net)
        i, j = (x.ravel() for x in np.meshgrid(np.arange(m), np.arange(n), indexing="ij"))
        four = np.arange(4)
        cells = net[:, (i[:, None] + four)[:, :, None], (j[:, None] + four)[:, None]]
        nets.append(cells.reshape(-1, 4, 4, 3))
        owner.append(np.repeat(here, m * n))
        place.append(np.tile(np.stack([i, j], axis=1), (len(here), 1)))
    face = np.concatenate(owner)
    order = np.argsort(face, kind="stable")
    return np.concatenate(nets)[order], face[order], np.concatenate(place)[order]


def _unclamped(spans: int) -> Array:
    """Control points for uniform knots of those for clamped ones, as a matrix."""
    clamped = np.concatenate([np.zeros(3), np.arange(spans + 1.0), np.full(3, float(spans))])
    uniform = np.arange(-3.0, spans + 4)
    inner = np.arange(spans)[:, None] + np.array([0.2, 0.4, 0.6, 0.8])
    # as many places as points, some in each span
    at = np.concatenate([[0.0], inner.ravel(), [float(spans)]])
    bases = (BSpline.design_matrix(at, knots, 3).toarray() for knots in (uniform, clamped))
    one, two = bases
    return np.asarray(np.linalg.lstsq(one, two, rcond=None)[0])


def _welded(points: Array, within: float) -> tuple[Array, Array]:
    """Points in order of their first use, and which of them each is."""
    tree = cKDTree(points)
    first = np.arange(len(points))
    pairs = tree.query_pairs(within, output_type="ndarray")
    np.minimum.at(first, pairs.max(axis=1), pairs.min(axis=1))
    first = first[first]
    kept, number = np.unique(first, return_inverse=True)
    return points[kept], number


def _creases(mesh: Mesh, beyond: Array, within: float) -> Array:
    """Edges across which faces do not go on as their neighbours do, (c, 2)."""
    half = np.flatnonzero(mesh.twin >= 0)
    twin = mesh.twin[half]
    # across from a half-edge from a to b are its neighbour's other two corners, by a and by b
    by_a = mesh.indices[mesh.next_corner[mesh.next_corner[twin]]]
    by_b = mesh.indices[mesh.previous_corner[twin]]
    across = np.stack([mesh.points[by_a], mesh.points[by_b]], axis=1)
    off = np.linalg.norm(beyond[half] - across, axis=2).max(axis=1)
    return np.asarray(mesh.edges[np.unique(mesh.corner_edge[half[off > within]])])


def _confirm(faces: Faces, mesh: Mesh, face: Array, place: Array, size: float) -> None:
    """Refuse a cage whose limit is something else.

    Raises
    ------
    ValueError
        Naming the first face that differs, and by how much.
    """
    surface = LimitSurface(mesh)
    x = np.arange(4) / 3
    u, v = (a.ravel() for a in np.meshgrid(x, x, indexing="ij"))
    low = faces.domain[face, :, 0]
    step = (faces.domain[face, :, 1] - low) / (faces.counts - _DEGREE)[face]
    at = low[:, None] + step[:, None] * (place[:, None] + np.stack([u, v], axis=1))
    at = np.minimum(at, faces.domain[face, None, :, 1])
    there = faces.evaluate(face[:, None], at[..., 0], at[..., 1])
    turned = faces.reversed[face, None]
    s, t = np.where(turned, v, u), np.where(turned, u, v)
    limit = surface.evaluate(np.arange(len(face))[:, None], s, t)
    off = np.linalg.norm(limit - there, axis=2).max(axis=1)
    bad = np.flatnonzero(~(off <= _SAME * size))
    if len(bad):
        more = f", and {len(bad) - 1} more like it" if len(bad) > 1 else ""
        raise ValueError(
            f"no cage: {_named(faces, int(face[bad[0]]))} is {off[bad[0]]:.2g} from the limit "
            f"surface of the cage that its control points are{more}"
        )
