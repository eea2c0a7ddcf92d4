"""Limit positions and normals of vertices by masks, after as many levels as sharpness lasts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import _kernels, numbers, tables
from limitsurf._kernels import reference as kernels
from limitsurf.cage.mesh import Mesh
from limitsurf.refine.operators import entries, identity, sparse_operator, stacked
from limitsurf.refine.rings import Rings
from limitsurf.refine.stages import irrational, refined_values, refinement_stages
from limitsurf.rules import PENDING, Rules, Sectors, Sharpness
from limitsurf.topology import MeshPart, child_halves, child_mesh, vertex_numbers

Array = NDArray[Any]


def limit_points(sharpness: Sharpness, rules: Rules, points: Array, wanted: Array) -> Array:
    """Limits of the `wanted` (n_vertices,) bool vertices of regular faces, NaN elsewhere."""
    lattice = rules.scheme.lattice
    sectors = Sectors.of(sharpness, lattice)
    vertex = sectors.fans.vertex
    result = np.full_like(points, np.nan)
    for kind, faces, fans in sectors.groups(np.flatnonzero(wanted[vertex] & (sectors.kind >= 0))):
        own = points[vertex[fans]]
        step = np.zeros_like(own)
        try:
            mask = tables.limit_mask(rules.scheme, kind, faces, sharpness.number)
        except TypeError:
            what = f"vertex {vertex_numbers(sharpness.mesh)[vertex[fans[0]]]} has {faces} faces"
            raise TypeError(irrational(what, rules)) from None
        mask = _of_ring(mask, rules, kind, faces)
        ring = sectors.ring(kind, faces, fans)[:, 1:]
        if faces > tables.MOST_FACES:
            step = (mask[1:, None] * (points[ring] - own[:, None])).sum(axis=1)
        else:
            for weight, beside in zip(mask[1:], ring.T, strict=True):
                step = step + weight * (points[beside] - own)
        result[vertex[fans]] = own + step
    # where something is semi-sharp, the limit is that after one more refinement
    pending = np.zeros(len(wanted), dtype=bool)
    pending[vertex[sectors.kind == PENDING]] = True
    pending &= wanted
    if pending.any():
        near = MeshPart.of(sharpness.mesh, sharpness.neighbours(pending[sharpness.mesh.indices]))
        inner = sharpness.part(near)
        compiled = not numbers.type_of(points).exact and _kernels.compiled(near.mesh.n_corners, 5)
        finer = refined_values(near.mesh, rules, inner, points[near.vertices], compiled)
        later = np.zeros(len(finer), dtype=bool)
        later[: near.mesh.n_vertices] = pending[near.vertices]
        names = np.full(len(finer), -1)
        names[: near.mesh.n_vertices] = vertex_numbers(near.mesh)
        inner = inner.children(child_mesh(near.mesh, names, lattice), lattice)
        limits = limit_points(inner, rules, finer, later)
        result[pending] = limits[later]
    return result


def _of_ring(mask: Array, rules: Rules, kind: str, faces: int) -> Array:
    """A mask as weights of what `Sectors.ring` gives, where the last point is the middle of two."""
    carried = rules.scheme.sector(kind, faces).carried
    return np.append(mask[:-1], [mask[-1] / 2] * 2) if carried else mask


def limit_rows(rules: Rules, kind: str, faces: int) -> Array:
    """The mask of the limit position over the ring, for a `sector_operator` of one row a fan."""
    mask = tables.limit_mask(rules.scheme, kind, faces, numbers.FLOAT64)
    return _of_ring(mask, rules, kind, faces)[None]


def sector_operator(
    sharpness: Sharpness,
    rules: Rules,
    wanted: Array,
    masks: Callable[[Rules, str, int], Array],
    count: int,
) -> Any:
    """Operator (count n_fans, n_vertices) on differences from a vertex, in regular faces.

    It applies the `masks` (count or 0, ring) of the sector of each fan of the `Sectors`, to all
    fans the first, then to all fans the second; those that are not `wanted` (n_fans,) bool have no
    entries.
    """
    mesh, lattice = sharpness.mesh, rules.scheme.lattice
    sectors, n = Sectors.of(sharpness, lattice), len(wanted)
    parts = [(np.zeros(0, int), np.zeros(0, int), np.zeros(0))]
    for kind, faces, fans in sectors.groups(np.flatnonzero(wanted & (sectors.kind >= 0))):
        ring = sectors.ring(kind, faces, fans)
        for which, mask in enumerate(masks(rules, kind, faces)):
            used = np.flatnonzero(mask != 0)
            values = np.broadcast_to(mask[used], (len(fans), len(used)))
            row = np.repeat(which * n + fans, len(used))
            parts.append((row, ring[:, used].ravel(), values.ravel()))
    # where something is semi-sharp, the limit is that after one more refinement
    pending = np.flatnonzero(wanted & (sectors.kind == PENDING))
    for rings in Rings.of(sectors, rules, pending):
        weights = rings.rows(masks(rules, "interior", rings.edges.shape[1]))
        vector, i, k = np.nonzero(weights)
        parts.append((vector * n + rings.fans[i], rings.vertices[i, k], weights[vector, i, k]))
        pending = np.setdiff1d(pending, rings.fans)
    if len(pending):
        near = MeshPart.of(mesh, sharpness.neighbours(np.isin(sectors.fans.fan, pending)))
        inner = sharpness.part(near)
        faces_stage, stage = refinement_stages(near.mesh, rules, inner, numbers.FLOAT64)
        later = inner.children(child_mesh(near.mesh, np.zeros(stage.shape[0]), lattice), lattice)
        first = np.searchsorted(near.corners, sectors.fans.corners[sectors.fans.offsets[pending]])
        child_fans = Sectors.of(later, lattice).fans
        fan = np.full(len(child_fans.vertex), -1)
        fan[child_fans.fan[child_halves(near.mesh.connectivity, first, lattice)[0]]] = pending
        both = stacked([identity(near.mesh.n_vertices, numbers.FLOAT64), faces_stage])
        finer = sector_operator(later, rules, fan >= 0, masks, count)
        rows, columns, values = entries((finer @ stage) @ both)
        k, row = np.divmod(rows, len(fan))
        parts.append((k * n + fan[row], near.vertices[columns], values))
    rows, columns, values = (np.concatenate(x) for x in zip(*parts, strict=True))
    return sparse_operator(rows, columns, values, (count * n, mesh.n_vertices))


def _normal_rows(rules: Rules, kind: str, faces: int) -> Array:
    """Two pairs of vectors, (4 or 0, ring)."""
    pairs = tables.normal_masks(rules.scheme, kind, faces)
    return pairs.reshape(-1, pairs.shape[2])


def _collapsed_rows(rules: Rules, kind: str, faces: int) -> Array:
    """Four pairs of vectors, (8, ring)."""
    pairs = tables.collapsed_masks(rules.scheme, kind, faces)
    return pairs.reshape(-1, pairs.shape[2])


def limit_normals(
    sharpness: Sharpness, rules: Rules, points: Array, errors: Array, wanted: Array
) -> Array:
    """Limit normals by corner, (n_corners, 3), at the `wanted` vertices of regular faces.

    `errors` (n_vertices,) bound those of the points, in units of `NOISE`.
    """
    fans = Sectors.of(sharpness, rules.scheme.lattice).fans

    def vectors(
        some: Array, masks: Callable[[Rules, str, int], Array], count: int
    ) -> list[tuple[Array, Array, Array]]:
        chosen = np.zeros(len(fans.vertex), dtype=bool)
        chosen[some] = True
        operator = sector_operator(sharpness, rules, chosen, masks, count)
        own = np.tile(fans.vertex, count)
        vector, size, error = _from_own(operator, points, errors, own)
        each = vector, kernels.NOISE * (size + error), kernels.NOISE * error
        parts = ([part[some] for part in np.split(x, count)] for x in each)
        return list(zip(*parts, strict=True))

    def crossed(found: list[tuple[Array, Array, Array]], k: int, rows: Array) -> Array:
        (a, noise, _), (b, other, _) = ([x[rows] for x in found[j]] for j in (2 * k, 2 * k + 1))
        return kernels.unit_normals(a, b, (noise, other))

    result = np.full((len(fans.vertex), 3), np.nan)
    some = np.flatnonzero(wanted[fans.vertex])
    found = vectors(some, _normal_rows, 4)
    # the second where the first pair is dependent
    for k in range(2):
        rows = np.flatnonzero(np.isnan(result[some, 0]))
        result[some[rows]] = crossed(found, k, rows)
    lost = some[np.isnan(result[some, 0])]
    if len(lost):
        found = vectors(lost, _collapsed_rows, 8)
        first, second = ((np.abs(found[j][0]) <= found[j][2]).all(axis=1) for j in (6, 7))
        for k, case in enumerate((first & second, first & ~second, second & ~first)):
            result[lost[case]] = crossed(found, k, np.asarray(case))
    return np.asarray(result[fans.fan])


def face_normals(mesh: Mesh, points: Array, errors: Array) -> Array:
    """Normals at the corners of regular faces, (n_corners, 3), which depend on these faces alone.

    Where the points of an edge at a corner coincide, those of a quad are limits all the same.
    """
    size = mesh.connectivity.uniform_size
    corner = mesh.indices.reshape(-1, size)

    def step(start: int, end: int) -> tuple[Array, Array, Array]:
        """From one corner on to another: vectors, their noise, and whether they are 0."""
        a, b = (np.roll(corner, -k, axis=1).ravel() for k in (start, end))
        found, error = points[b] - points[a], errors[a] + errors[b]
        largest = np.abs(found).max(axis=1)
        noise = kernels.NOISE * error
        return found, (kernels.NOISE * largest + noise)[:, None], largest <= noise

    out, back, along, across = step(0, 1), step(0, -1), step(1, 2), step(-1, -2)
    result = kernels.unit_normals(out[0], back[0], (out[1], back[1]))
    if size == 3:
        return result
    for lost, a, b in ((out[2], across, back), (back[2], out, along)):
        found = kernels.unit_normals(a[0][lost], b[0][lost], (a[1][lost], b[1][lost]))
        result[lost] = np.where((out[2] & back[2])[lost, None], np.nan, found)
    return result


def _from_own(
    operator: Any, points: Array, errors: Array, own: Array
) -> tuple[Array, Array, Array]:
    """Each row of an operator applied to differences from a point of its own, (rows, d).

    Also the size of what is added up, and what errors of the points do to it, both (rows, 1).
    """
    result = np.zeros((operator.shape[0], points.shape[1] + 2))
    used = np.diff(operator.indptr) > 0
    starts, columns = operator.indptr[np.concatenate([used, [True]])], operator.indices
    if len(columns):
        near, weights = np.repeat(own[used], np.diff(starts)), np.abs(operator.data)
        steps = points[columns] - points[near] + 0.0  # no -0
        sizes = kernels.largest(steps)[:, 0]
        steps *= operator.data[:, None]
        result[used, :-2] = np.add.reduceat(steps, starts[:-1], axis=0)
        for k, terms in ((-2, sizes), (-1, errors[columns] + errors[near])):
            result[used, k] = np.add.reduceat(weights * terms, starts[:-1])
    return result[:, :-2], result[:, -2:-1], result[:, -1:]
