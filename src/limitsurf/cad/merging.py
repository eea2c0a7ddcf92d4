"""Rectangles of regular limit faces as one spline face each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cad import nets
from limitsurf.cad.rectangles import Rectangles, rectangles
from limitsurf.patches import REGULAR, STRIP
from limitsurf.query.bezier import bezier_patches
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_FACES = 1 << 16  # at once


@dataclass(frozen=True, eq=False)
class Merged:
    """Spline faces over rectangles of limit faces that are alike.

    Attributes
    ----------
    cells, turns : (m, l) int
        Limit faces, those along v one after the other, and their corners at low u and low v.
    grid : (int, int)
    knots : (array, array)
    points : (m, nu * nv, d)
    """

    cells: Array
    turns: Array
    grid: tuple[int, int]
    knots: tuple[Array, Array]
    points: Array


def regular_faces(surface: LimitSurface) -> Array:
    """Limit faces (n_limit_faces,) amid regular vertices, over faces of the mesh."""
    table, n = surface.topology.patches, len(surface.limit_faces)
    code = table.codes[:n]
    found = (code >= 0) & (surface.limit_faces.corner < 0)
    kind = table.kind[np.maximum(code, 0)] if len(table.kind) else np.zeros(n, dtype=np.int32)
    # in dual schemes the pieces are quarters of regular ones
    return np.asarray(found & (kind == (STRIP if table.lattice.dual else REGULAR)))


def merged_faces(surface: LimitSurface, regular: Array, workers: int) -> Iterator[Merged]:
    """Splines over rectangles of regular limit faces, of those of one size at a time."""
    mesh = surface.mesh
    sharp = np.zeros(mesh.n_edges, dtype=bool)
    ends, sharpness = mesh.creases
    if len(sharpness):
        tagged = np.asarray(sharpness, dtype=float) > 0
        sharp[mesh.edge_numbers(ends)[tagged]] = True
    found = rectangles(surface, regular, sharp)
    size = found.grid.prod(axis=1)
    first = np.cumsum(size) - size
    shapes, which = np.unique(found.grid, axis=0, return_inverse=True)
    for k, (a, b) in enumerate(shapes.tolist()):
        alike = np.flatnonzero(which.ravel() == k)
        step = max(1, _FACES // (a * b))
        for start in range(0, len(alike), step):
            rows = first[alike[start : start + step], None] + np.arange(a * b)
            yield _one_size(surface, found, rows, (a, b), workers)


def _one_size(
    surface: LimitSurface, found: Rectangles, rows: Array, grid: tuple[int, int], workers: int
) -> Merged:
    cells, turns = found.faces[rows], found.turns[rows]
    flat = cells.ravel()
    pieces = bezier_patches(surface, face=flat, depth=0, workers=workers)
    degree, d = pieces.degree, surface.points.shape[1]
    each = len(pieces) // len(flat)
    side = round(each**0.5)
    # by cell along u, coefficient there, and the same along v
    known = pieces.points.reshape(len(flat), each, degree + 1, degree + 1, d)
    place = np.rint(pieces.origin.reshape(len(flat), each, 2)[0] * side).astype(np.int64)
    order = np.argsort(place[:, 0] * side + place[:, 1])
    width = side * (degree + 1)
    known = known[:, order].reshape(len(flat), side, side, degree + 1, degree + 1, d)
    known = known.transpose(0, 1, 3, 2, 4, 5).reshape(len(flat), width, width, d)
    known = _turned(known, turns.ravel())
    (a, b), m = grid, len(rows)
    shape = m, a, b, side, degree + 1, side, degree + 1, d
    known = known.reshape(shape).transpose(0, 1, 3, 4, 2, 5, 6, 7)
    known = known.reshape(m, a * side, degree + 1, b * side, degree + 1, d)
    knots, lines = [], []
    for count in grid:
        line = np.arange(count * side + 1) / side
        knots.append(nets.clamped(line, degree))
        lines.append(nets.line(line, degree))
    (one, along), (other, across) = lines
    half = np.einsum("ip,nipjqd->nijqd", along, known[:, one])
    net = np.einsum("jq,nijqd->nijd", across, half[:, :, other])
    return Merged(cells, turns, grid, (knots[0], knots[1]), net.reshape(m, -1, d))


def _turned(known: Array, turn: Array) -> Array:
    """Coefficients (n, w, w, d) by u and v from corner `turn` on."""
    found = known.copy()
    for k in range(1, 4):
        here = np.flatnonzero(turn == k)
        some = known[here]
        found[here] = (
            some[:, ::-1].swapaxes(1, 2) if k == 1
            else some[:, ::-1, ::-1] if k == 2
            else some.swapaxes(1, 2)[:, ::-1]
        )  # fmt: skip
    return found
