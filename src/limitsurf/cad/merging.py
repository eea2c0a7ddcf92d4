"""Rectangles of limit faces as one spline face each.

Special corners are at corners of rectangles: knots are graded towards these, as many as the
deepest takes on each line. Across semi-sharp creases faces are smooth after as many steps, and
knots of their strips are those of the whole row.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cad import nets
from limitsurf.cad.knot_lines import apart, within
from limitsurf.cad.poles import Depths
from limitsurf.cad.rectangles import Rectangles, rectangles
from limitsurf.cad.splines import unturned
from limitsurf.patches import REGULAR, STRIP
from limitsurf.pieces.cells import BezierPatches, BezierRest
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_FACES, _GRADED = 1 << 16, 1 << 13  # at once
_SHARP = 9.999  # edges of 10 and more are sharp for ever


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
    exact : bool
        Whether they have no special corners.
    """

    cells: Array
    turns: Array
    grid: tuple[int, int]
    knots: tuple[Array, Array]
    points: Array
    exact: bool = True


def whole_faces(surface: LimitSurface) -> Array:
    """Limit faces (n_limit_faces,) with a limit that are faces of the mesh."""
    return np.asarray((surface.limit_faces.corner < 0) & surface.patches.with_limit)


def _regular(surface: LimitSurface) -> Array:
    """Limit faces (n_limit_faces,) amid regular vertices."""
    table, n = surface.topology.patches, len(surface.limit_faces)
    code = table.codes[:n]
    kind = table.kind[np.maximum(code, 0)] if len(table.kind) else np.zeros(n, dtype=np.int32)
    # in dual schemes the pieces are quarters of regular ones
    return np.asarray((code >= 0) & (kind == (STRIP if table.lattice.dual else REGULAR)))


def merged_faces(
    surface: LimitSurface, faces: Array, depths: Depths, workers: int
) -> Iterator[Merged]:
    """Splines over rectangles of more than one of some limit faces, and over regular ones."""
    mesh = surface.mesh
    sharp = np.zeros(mesh.n_edges, dtype=bool)
    ends, sharpness = mesh.creases
    if len(sharpness):
        # across edges that are sharp for some steps, faces are smooth after these
        most = 0 if surface.topology.lattice.dual else _SHARP
        tagged = np.asarray(sharpness, dtype=float) > most
        sharp[mesh.edge_numbers(ends)[tagged]] = True
    own = np.zeros(len(surface.limit_faces), dtype=bool)
    own[faces] = True
    found = rectangles(surface, own, sharp, depths.each >= 0)
    size = found.grid.prod(axis=1)
    first = np.cumsum(size) - size
    regular = np.logical_and.reduceat(_regular(surface)[found.faces], first) if len(size) else size
    shapes, which = np.unique(found.grid, axis=0, return_inverse=True)
    for k, (a, b) in enumerate(shapes.tolist()):
        alike = np.flatnonzero(which.ravel() == k)
        step = max(1, _FACES // (a * b))
        some = alike[regular[alike]]
        for start in range(0, len(some), step):
            rows = first[some[start : start + step], None] + np.arange(a * b)
            yield _one_size(depths, found, rows, (a, b), workers)
        some = alike[~regular[alike]] if a * b > 1 else alike[:0]
        step = max(1, _GRADED // (a * b))
        for start in range(0, len(some), step):
            rows = first[some[start : start + step], None] + np.arange(a * b)
            yield from _graded(surface, found, rows, (a, b), depths, workers)


def _graded(
    surface: LimitSurface,
    found: Rectangles,
    rows: Array,
    grid: tuple[int, int],
    depths: Depths,
    workers: int,
) -> Iterator[Merged]:
    """Splines over rectangles (m, l) with other lines than those between limit faces."""
    cells, turns = found.faces[rows], found.turns[rows]
    pieces, limits = _side_by_side(surface, cells, turns, grid, depths, workers)
    n, d = len(pieces.exponents), surface.points.shape[1]
    points = pieces.points.reshape(-1, n, d)
    none = np.zeros(len(pieces.rest), dtype=bool)
    for whole in nets.alike(pieces, np.arange(len(rows)), none):
        for box in apart(whole, grid, pieces.degree):
            cut, inside = within(whole, grid, box)
            m, c = cut.cells.shape
            known = points[cut.cells].reshape(m, c * n, d)
            known = np.concatenate([known, limits[cut.rest]], axis=1)
            flat = known.swapaxes(0, 1).reshape(-1, m * d)
            made = nets.net(cut, surface.topology.lattice, pieces.degree) @ flat
            u, v = (nets.clamped(x, pieces.degree) for x in nets.breaks(cut))
            net = made.reshape(-1, m, d).swapaxes(0, 1)
            own, ways = (x[cut.faces[:, None], inside] for x in (cells, turns))
            shape = box[1] - box[0], box[3] - box[2]
            yield Merged(own, ways, shape, (u, v), net, len(cut.corner) == 0)


def _side_by_side(
    surface: LimitSurface,
    cells: Array,
    turns: Array,
    grid: tuple[int, int],
    depths: Depths,
    workers: int,
) -> tuple[BezierPatches, Array]:
    """Pieces of limit faces (m, l) as of rectangles, in order, and the limits of what remains."""
    flat, turn = cells.ravel(), turns.ravel()
    parts = list(depths.pieces(flat, workers))
    corner = np.array(surface.topology.lattice.corners)
    at = np.concatenate([x.rest.origin + x.rest.size * corner[x.rest.corner] for x in parts])
    face, other = (
        np.concatenate([x.face for x in some]) for some in (parts, [x.rest for x in parts])
    )
    limits = np.asarray(surface.evaluate(other, *at.T))
    order = np.argsort(flat)
    base = np.stack(np.divmod(np.arange(len(flat)) % cells.shape[1], grid[1]), axis=1)

    def placed(face: Array, some: list[Any]) -> tuple[Array, Array, Array, Array, Array]:
        where = order[np.searchsorted(flat[order], face)]
        origin, size = (np.concatenate([getattr(x, k) for x in some]) for k in ("origin", "size"))
        low, extent = unturned(origin, size, turn[where])
        low += base[where]
        row = where // cells.shape[1]
        by = np.lexsort([low[:, 1], low[:, 0], row])
        return by, row[by], low[by], extent[by], where[by]

    by, row, low, extent, where = placed(face, parts)
    points = np.concatenate([x.points for x in parts])[by]
    points = _turned(points, turn[where])
    over, row_, low_, extent_, where_ = placed(other, [x.rest for x in parts])
    last = (np.concatenate([x.rest.corner for x in parts])[over] - turn[where_]) % 4
    rest = BezierRest(row_, last, low_, extent_, low_, low_)
    found = replace(parts[0], face=row, origin=low, size=extent, points=points, rest=rest)
    return found, limits[over]


def _one_size(
    depths: Depths, found: Rectangles, rows: Array, grid: tuple[int, int], workers: int
) -> Merged:
    cells, turns = found.faces[rows], found.turns[rows]
    flat = cells.ravel()
    (pieces,) = depths.pieces(flat, workers)
    degree, d = pieces.degree, pieces.points.shape[-1]
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
        # in dual schemes polynomials end between the sides of faces, which are no knots within
        kept = (line != np.floor(line)) | (line == 0) | (line == count) | (side == 1)
        knots.append(nets.clamped(line[kept], degree))
        lines.append(nets.line(line[kept], line, degree))
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
