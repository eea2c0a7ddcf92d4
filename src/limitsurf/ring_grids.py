"""The control points of single patches at special corners whose rings are refined.

A patch follows the ring that it shares with 4 x 4 places (i, j) of the lattice, of which a scheme
of triangles uses ten: all but few of its refined points, at 5 x 5 places, are made by the rules of
the spline from these (``derivations/wide_rings.py``). Arrays count places by j, then i; where there
is no point they are 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf import basis
from limitsurf._kernels import reference as kernels
from limitsurf.numbers import FLOAT64, RATIONAL

if TYPE_CHECKING:
    from limitsurf.scheme.lattice import Lattice, Place
    from limitsurf.scheme.spline import Spline
    from limitsurf.tables import RingMasks

Array = NDArray[Any]
Order: TypeAlias = tuple[int, int]

# where what is beyond a sharp side is reflected at it: targets i, and sources (n, terms)
Reflection: TypeAlias = tuple[Array, Array, Array, Array]


@dataclass(frozen=True, eq=False)
class Layout:
    """Places around corner 0 of a lattice, as indices (j, i).

    Attributes
    ----------
    edges, faces : (array, array)
        Of the edge neighbours p - 1 to p + 2 of a face p, and of face corners p - 1 to p + 1, which
        triangles have not.
    outer : (array, array)
        Of the control points beyond the ring.
    pieces : (array, array)
        Of the control points of the regular pieces among refined ones, (pieces, K) each.
    made : (m,)
        Which of the 25 refined points are made from the control points by the rules of the spline;
        the others are points of the next ring, or none.
    step : (m, 16)
        Weights of the control points in them.
    reflection : Reflection
        At the side along u; with i and j exchanged at that along v.
    """

    edges: tuple[Array, Array]
    faces: tuple[Array, Array]
    outer: tuple[Array, Array]
    pieces: tuple[Array, Array]
    made: Array
    step: Array
    reflection: Reflection

    @classmethod
    def of(cls, masks: RingMasks) -> Layout:
        """That of a scheme's lattice."""
        return _layout(masks.sector.lattice, masks.spline)

    def reflect(self, points: Array, side: Array) -> None:
        """Set what is beyond the sides along u of some patches, (A, J, I, d)."""
        target, j, i, factors = (x[self._within(points)] for x in self.reflection)
        found = points[side][:, j, i]
        points[np.flatnonzero(side)[:, None], 0, target] = (factors[..., None] * found).sum(axis=2)

    def fold(self, weights: Array, side: Array) -> None:
        """Give weights (q, J, I) of what is beyond such sides to what it is reflected from."""
        target, j, i, factors = (x[self._within(weights)] for x in self.reflection)
        where = np.flatnonzero(side)[:, None, None]
        share = weights[side, 0][:, target, None] * factors
        np.add.at(weights, (where, j, i), share)
        weights[side, 0] = 0

    def _within(self, array: Array) -> Array:
        return np.asarray(self.reflection[0] < array.shape[2])


@lru_cache(maxsize=8)
def _layout(lattice: Lattice, spline: Spline) -> Layout:
    stride = len(lattice.orbits)
    ring = {step: place for step, place in lattice.ring if -stride <= step <= 2 * stride}
    edges = [ring[step] for step in range(-stride, 2 * stride + 1, stride)]
    faces = [ring[step] for step in range(-stride + 1, 2 * stride, stride)] * (stride > 1)
    # what a step makes of them, but for those that other faces have a part in
    known = {(1, 1), *edges, *faces, *lattice.outer}
    made = sorted(5 * j + i for i, j in {*edges[1:-1], *faces, *lattice.outer, *lattice.beyond})
    step = np.zeros((len(made), 4, 4))
    for row, place in zip(step, made, strict=True):
        for (x, y), weight in spline.stencil((place % 5 - 1, place // 5 - 1)).items():
            assert (1 + x, 1 + y) in known
            row[1 + y, 1 + x] = weight
    taken = [[piece.place(near) for near in spline.template] for piece in lattice.pieces]
    lost = sorted(i for i, j in {place for places in taken for place in places} if j == 0)
    sources = np.array([[(j, i + x) for _, (x, j) in lattice.reflection] for i in lost])
    factors = np.array([[w for w, _ in lattice.reflection]] * len(lost), dtype=float)
    reflection = np.array(lost), sources[..., 0], sources[..., 1], factors
    around = _indices(edges), _indices(faces), _indices(lattice.outer), _indices(taken)
    return Layout(*around, np.array(made), step.reshape(-1, 16), reflection)


def _indices(places: list[Place] | tuple[Place, ...] | list[list[Place]]) -> tuple[Array, Array]:
    found = np.array(places if places else np.zeros((0, 2)), dtype=np.int64)
    return found[..., 1], found[..., 0]


def beside(masks: RingMasks, position: Array) -> tuple[Array, Array]:
    """The edges p - 1 to p + 2 and the faces p - 1 to p + 1 of faces p, (A, 4) and (A, 3).

    No faces where there are no corners beyond the edges.
    """
    faces, corners = masks.sector.faces, 3 * (len(masks.sector.lattice.orbits) > 1)
    edge = position[:, None] + np.arange(-1, 3)
    face = edge[:, :corners]
    if masks.sector.open:  # beyond sharp sides there is nothing: any will do
        return edge.clip(0, faces), face.clip(0, faces - 1)
    return edge % faces, face % faces


def sharp_sides(masks: RingMasks, position: Array) -> tuple[Array, Array]:
    """Whether the edges along u and along v of faces are sharp, (A,) each."""
    sector = masks.sector
    ends = sector.open or sector.kind == "dart"
    return ends & (position == 0), ends & (position == sector.faces - 1)


def _line(masks: RingMasks) -> Array:
    """Refined points of a sharp line of 4 control points: edge, vertex, edge, vertex, edge."""
    half, along = masks.weights.half, masks.weights.beside
    line = np.zeros((5, 4))
    for k in range(5):
        weights = [along, 1 - 2 * along, along] if k % 2 else [half, half]
        line[k, k // 2 : k // 2 + len(weights)] = weights
    return line


def first(
    masks: RingMasks, edges: Array, faces: Array, outer: Array, ring: Array, position: Array
) -> Array:
    """4 x 4 control points (A, 4, 4, d) of patches, relative to the vertex.

    From the points of rings, (R, d, edges) and (R, d, faces), of which each patch has number `ring`
    (A,), and outer ones (A, n, d).
    """
    layout, every = Layout.of(masks), ring[:, None]
    grid = np.zeros((len(position), 4, 4, outer.shape[2]))
    grid[:, *layout.outer] = outer
    edge, face = beside(masks, position)
    grid[:, *layout.edges] = edges[every, :, edge]
    grid[:, *layout.faces] = faces[every, :, face]
    for side, points in _sides(masks, position, grid):
        layout.reflect(points, side)
    return grid


def _sides(masks: RingMasks, position: Array, grid: Array) -> Iterator[tuple[Array, Array]]:
    """Which patches have a sharp side along u, and along v, and points (A, J, I, ...) from it."""
    yield from zip(sharp_sides(masks, position), (grid, grid.swapaxes(1, 2)), strict=True)


def refined(
    masks: RingMasks, position: Array, grid: Array, edges: Array, ring: Array, step: Array,
    shift: Array,
) -> Array:  # fmt: skip
    """5 x 5 refined points (A, 5, 5, d) of patches, from their rings after this step.

    `edges` (R, d, edges) of these, of which each patch has number `ring` (A,); `step` (A, d) and
    `shift` (A,) are those of a `Ring`, by patch.
    """
    layout, (A, *_, d) = Layout.of(masks), grid.shape
    made = np.matmul(layout.step, grid.reshape(A, 16, d)) - step[:, None]
    flat = np.zeros((A, 25, d))
    flat[:, layout.made] = kernels.scale_by_two(made, -shift[:, None, None])
    fine = flat.reshape(A, 5, 5, d)
    edge = beside(masks, position)[0]
    (first_j, *_, last_j), (first_i, *_, last_i) = layout.edges
    fine[:, first_j, first_i] = edges[ring, :, edge[:, 0]]
    fine[:, last_j, last_i] = edges[ring, :, edge[:, -1]]
    # sharp sides refine by themselves: what they fall by may be much less than the faces
    line = _line(masks)
    before = _sides(masks, position, grid)
    for (side, points), (_, on) in zip(_sides(masks, position, fine), before, strict=True):
        own = np.matmul(line, on[side, 1]) - step[side][:, None]
        own = kernels.scale_by_two(own, -shift[side][:, None, None])
        points[side, 1, 1:] = own[:, 1:]
        points[side, 1, 1] = 0
        layout.reflect(points, side)
    return fine


def coarser(masks: RingMasks, position: Array, fine: Array, edges: Array) -> tuple[Array, Array]:
    """`refined`, transposed: weights (q, 4, 4), and the sums of those of refined points, (q,).

    From the weights of refined points, (q, 5, 5). Those of points of the ring are added to its
    `edges` (q, edges), and do not count.
    """
    layout, fine, every = Layout.of(masks), fine.copy(), np.arange(len(position))
    for side, points in _sides(masks, position, fine):
        layout.fold(points, side)
    edge = beside(masks, position)[0]
    for k in (0, -1):
        place = layout.edges[0][k], layout.edges[1][k]
        edges[every, edge[:, k]] += fine[:, *place]
        fine[:, *place] = 0
    fine[:, 1, 1] = 0
    grid = fine.reshape(-1, 25)[:, layout.made] @ layout.step
    return grid.reshape(-1, 4, 4), fine.sum(axis=(1, 2))


def gathered(masks: RingMasks, position: Array, grid: Array, edges: Array, faces: Array) -> Array:
    """`first`, transposed: weights of outer points (q, n), from those (q, 4, 4).

    Those of the ring are added to its `edges` and `faces`, (q, edges) and (q, faces).
    """
    layout, every = Layout.of(masks), np.arange(len(position))
    for side, points in _sides(masks, position, grid):
        layout.fold(points, side)
    parts = (edges, layout.edges), (faces, layout.faces)
    for (part, places), near in zip(parts, beside(masks, position), strict=True):
        for k, place in enumerate(near.T):
            part[every, place] += grid[:, places[0][k], places[1][k]]
    return np.asarray(grid[:, *layout.outer])


# ---------------------------------------------------------------- weights in pieces


def weights(masks: RingMasks, local: basis.CornerPlace, sharp: Array, nu: Order) -> Array:
    """Weights (n, K) of the control points of pieces, with or without `sharp` sides, (2, n)."""
    lattice, spline = masks.sector.lattice, masks.spline
    if spline.cubic:
        across, along = kernels.cubic_weights(local.T, nu[1]), kernels.cubic_weights(local.S, nu[0])
        across[sharp[0]] = reflected(local.T[sharp[0]], nu[1])
        along[sharp[1]] = reflected(local.S[sharp[1]], nu[0])
        return np.asarray((across[:, :, None] * along[:, None, :]).reshape(len(along), 16))
    found = basis.regular_weights(spline, FLOAT64)(local.S, local.T, nu)
    for axis, side in enumerate(sharp):
        exponents, coefficients = _folded(lattice, spline, nu, axis)
        if len(exponents) and side.any():
            terms = kernels.barycentric_monomials(local.S[side], local.T[side], exponents)
            found[side] = terms @ coefficients
    turned = np.array([piece.turned for piece in lattice.pieces])[local.piece]
    return np.where((turned & (sum(nu) % 2 == 1))[:, None], -found, found)


@lru_cache(maxsize=256)
def _folded(lattice: Lattice, spline: Spline, nu: Order, axis: int) -> tuple[Any, Array]:
    """Those of `basis.barycentric`, where what is beyond a side is reflected at it.

    Its weights are given to what it comes from, exactly: on the side itself nothing is left of the
    points inside, however much larger they are.
    """
    exponents, exact = basis.barycentric(spline, nu, RATIONAL)
    if not len(exponents):
        return exponents, exact
    exact, places = exact.copy(), [place[:: 1 - 2 * axis] for place in spline.template]
    for k, (i, j) in enumerate(places):
        if j == 0:
            for factor, (x, y) in lattice.reflection:
                exact[:, places.index((i + x, y))] += factor * exact[:, k]
            exact[:, k] = Fraction(0)
    return exponents, exact.astype(float)


def on_sides(masks: RingMasks) -> tuple[Array, Array]:
    """Which control points of a piece are on the side t = 0, and on s = 0."""
    i, j = np.array(masks.spline.template).T
    return np.flatnonzero(j == 1), np.flatnonzero(i == 1)


def sharp_pieces(masks: RingMasks, position: Array, local: basis.CornerPlace) -> Array:
    """Whether the sides t = 0 and s = 0 of the pieces that hold queries are sharp, (2, n)."""
    sides = np.stack(sharp_sides(masks, position))
    own = [[basis.side_piece(masks.sector.lattice, axis)] for axis in (0, 1)]
    return np.asarray(sides & (local.piece == np.array(own)))


def reflected(x: Array, order: int) -> Array:
    """Weights (n, 4) like `kernels.cubic_weights`, of points of which the first is a reflection.

    That is ``2 p1 - p2``. Its weight is given to these, so that nothing is left of p2 at x = 0,
    where p1 can be smaller by any factor.
    """
    found = kernels.cubic_weights(x, order)
    powers = kernels.monomials(x, 3)
    inner, factor = np.zeros_like(x), 1
    for k in range(order, 4):
        start = kernels.cubic_weights(np.zeros(1), k)[0]
        inner += (start[2] - start[0]) / factor * powers[:, k - order]
        factor *= k - order + 1
    found[:, 2] = inner
    found[:, 1] = (order == 0) - inner - found[:, 3]
    found[:, 0] = 0
    return np.asarray(found)
