"""How far spline faces of offsets are from these, at most: bounds by Bernstein coefficients.

``derivations/offsets.py`` derives them, in its section 5.
"""

from __future__ import annotations

from math import comb
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cad.splines import Splines
from limitsurf.pieces import bernstein
from limitsurf.pieces.beyond import Beyond
from limitsurf.query import cones
from limitsurf.query.bezier import bezier_patches
from limitsurf.query.polynomials import Form, products
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

# times that cells are quartered where bounds are far from what is found, and where there are none
_SPLIT, _MOST_SPLIT = 3, 4
_NEAR = 1.5
_BLOCK = 4096  # cells at once
_ROUNDED = 2.0**-44  # of the size of a cell's points and of the distance
_RINGS = 24  # beyond the last knot, towards poles
_DEEPEST = 50


def bounds(surface: LimitSurface, faces: Array, net: Array, knots: Array, distance: float) -> Array:
    """Bounds (n,) of `OffsetFaces.along_normal`, inf where there is none.

    Parameters
    ----------
    surface : LimitSurface
        All of whose faces are squares.
    faces : (n,) int
        Limit faces.
    net : (n, count, count, 3)
        Control points of a bicubic spline to each, clamped over [0, 1].
    knots : (count + 4,)
        The same along u and v.
    distance : float
    """
    found = np.zeros(len(faces))
    lines = np.unique(knots)
    depth = -int(np.frexp(lines[1])[1]) + 1
    rings = min(depth + _RINGS, _DEEPEST)
    patches = bezier_patches(surface, face=faces, depth=rings)
    form = Form.of(surface.topology.lattice, 3)
    row = np.full(len(surface.limit_faces), -1)
    row[faces] = np.arange(len(faces))
    limit = patches.points.reshape(len(patches), -1, 3)
    limit = np.matmul(_elevation(patches.degree), limit)
    key = np.concatenate([patches.origin, patches.size], axis=1)
    kinds, number = np.unique(key, axis=0, return_inverse=True)
    for k, kind in enumerate(kinds):
        here = np.flatnonzero(number.reshape(-1) == k)
        frames, along, across = _cells(kind[:2], kind[2:], lines, knots)
        cut = bernstein.blossoms(form.exponents, frames)  # (q, 16, 16)
        step = max(1, _BLOCK // len(cut))
        for some in (here[i : i + step] for i in range(0, len(here), step)):
            own = np.einsum("qia,fabc,qjb->fqijc", along, net[row[patches.face[some]]], across)
            own = own.reshape(-1, form.size, 3)
            true = np.matmul(cut, limit[some][:, None]).reshape(-1, form.size, 3)
            owner = np.repeat(row[patches.face[some]], len(cut))
            _raise(found, owner, true, own, distance, form, surface)
    _rest(found, row, surface, faces, net, knots, distance, rings)
    return found


def _cells(origin: Array, size: Array, lines: Array, knots: Array) -> tuple[Array, Array, Array]:
    """Frames (q, 3, 2) in a piece of its cells between knots, and what nets make there."""
    spans = []
    for way in (0, 1):
        low, high = origin[way], origin[way] + size[way]
        inner = lines[(lines > low) & (lines < high)]
        spans.append(np.concatenate([[low], inner, [high]]))
    (u0, v0), (u1, v1) = (
        (x.ravel() for x in np.meshgrid(*ends, indexing="ij"))
        for ends in ([x[:-1] for x in spans], [x[1:] for x in spans])
    )
    local = (np.stack([u0, v0], axis=1) - origin) / size
    frames = np.zeros((len(u0), 3, 2))
    frames[:, 0] = local
    frames[:, 1, 0], frames[:, 2, 1] = (u1 - u0) / size[0], (v1 - v0) / size[1]
    return frames, _onto(knots, u0, u1), _onto(knots, v0, v1)


def _elevation(degree: int) -> Array:
    """Coefficients (16, (degree + 1)^2) of degree 3 in each direction from those of less."""
    x = np.arange(4) / 3
    line = np.linalg.solve(_basis(x, 3), _basis(x, degree))
    return np.kron(line, line)


def _basis(x: Array, degree: int) -> Array:
    """Bernstein polynomials (k, degree + 1)."""
    i = np.arange(degree + 1)
    ways = np.array([comb(degree, k) for k in range(degree + 1)])
    return np.asarray(ways * x[:, None] ** i * (1 - x[:, None]) ** (degree - i))


def _onto(knots: Array, low: Array, high: Array) -> Array:
    """Coefficients (q, 4, count) of a spline within a span of knots, on intervals in it."""
    count = len(knots) - 4
    x = (1 - np.cos(np.pi * (np.arange(4) + 0.5) / 4)) / 2
    at = (low[:, None] + (high - low)[:, None] * x).ravel()
    one = Splines.of(
        (3, 0), np.array([[count, 1]]), knots, np.array([0.0, 1.0]), np.eye(count)
    )  # fmt: skip
    none = np.zeros(len(at), dtype=np.int64)
    values = one.jet(none, at, np.zeros(len(at)), 0)[0].reshape(-1, 4, count)
    return np.asarray(np.matmul(np.linalg.inv(_basis(x, 3)), values))


def _raise(
    found: Array, owner: Array, true: Array, own: Array, d: float, form: Form, surface: LimitSurface
) -> None:
    """Raise bounds of faces to those of cells, which are quartered while they are coarse."""
    lattice = surface.topology.lattice
    split = bernstein.children(lattice, form.exponents)[1]
    for step in range(_MOST_SPLIT + 1):
        most, least = _compared(true, own, d, form, lattice)
        worst = np.maximum(found, 0)
        np.maximum.at(worst, owner, least)
        coarse = most > _NEAR * worst[owner]
        if step >= _SPLIT:
            coarse &= (most >= abs(d)) & (step < _MOST_SPLIT)
        np.maximum.at(found, owner[~coarse], most[~coarse])
        if not coarse.any():
            return
        owner = np.repeat(owner[coarse], len(split))
        true, own = (
            np.matmul(split, x[coarse][:, None]).reshape(-1, form.size, 3) for x in (true, own)
        )


def _compared(true: Array, own: Array, d: float, form: Form, lattice: Any) -> tuple[Array, Array]:
    """Bounds (L,) over cells (L, n, 3), and what is found at their corners."""
    w = own - true
    pairs = products(lattice, form.degree)
    du, dv = (np.matmul(form.derivatives[k], true) for k in (1, 2))

    def times(a: Array, b: Array) -> Array:
        return np.asarray(np.einsum("lac,lbc->lab", a, b).reshape(len(a), -1) @ pairs)

    size = np.maximum(np.abs(true).max(axis=(1, 2)), abs(d))
    noise = _ROUNDED * size
    excess = times(w, w) - d * d
    slack = noise * (2 * abs(d) + 4 * noise)
    high, low = excess.max(axis=1) + slack, excess.min(axis=1) - slack
    along_u, along_v = (np.sqrt((x**2).sum(axis=2)).max(axis=1) for x in (du, dv))
    product, crossing = cones.normal_form(lattice, form.degree)
    normal, lost = cones.crossed(form, crossing, true)
    axis = normal.mean(axis=1)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        axis = axis / np.sqrt((axis**2).sum(axis=1))[:, None]
        area = (normal * axis[:, None]).sum(axis=2).min(axis=1) - lost
        tilt = [
            np.abs(times(w, x)).max(axis=1) + noise * way
            for x, way in ((du, along_u), (dv, along_v))
        ]
        off = np.where(area > 0, (tilt[0] * along_v + tilt[1] * along_u) / area, np.inf)
        far, nearest = np.sqrt(np.maximum(d * d + high, 0)), d * d + low - off**2
        at = normal[:, product.corners]
        at = at / np.sqrt((at**2).sum(axis=2))[:, :, None]
        height = (w[:, form.corners] * at).sum(axis=2)
        right = (nearest > 0) & (height[:, 0] * d > 0)
        along = np.maximum(far - abs(d), abs(d) - np.sqrt(np.maximum(nearest, 0)))
        most = np.where(right, measure(along, off, d), far + abs(d))
        across = np.sqrt(np.maximum((w[:, form.corners] ** 2).sum(axis=2) - height**2, 0))
        least = measure(np.abs(height - d), across, d).max(axis=1)
    return np.nan_to_num(most, nan=np.inf), np.nan_to_num(least, nan=0.0)


def measure(along: Array, across: Array, d: float) -> Array:
    """What a difference along and across the normal is from an offset."""
    whole = np.hypot(along, across)
    return np.asarray(np.minimum(along + across**2 / (2 * abs(d)), whole) if d else whole)


def _rest(
    found: Array,
    row: Array,
    surface: LimitSurface,
    faces: Array,
    net: Array,
    knots: Array,
    d: float,
    rings: int,
) -> None:
    """Raise bounds of faces to those of what remains at poles."""
    topology, lattice = surface.topology, surface.topology.lattice
    depth = np.full(len(faces), rings)
    beyond = Beyond(topology.patches, topology.rules.scheme, surface.points, faces, depth)
    if not len(beyond):
        return
    rest = bezier_patches(surface, face=faces, depth=rings).rest
    every = np.arange(len(beyond))
    none = np.zeros(len(every), dtype=np.int64)
    own_form = Form.of(lattice, int(np.max(topology.rules.scheme.spline.exponents)))
    axis, wide = cones.Poles(beyond, lattice, own_form).cones(every, none)
    toward = np.nan_to_num(axis)
    far, along = beyond.reach(every, none, toward)
    low, high = rest.origin, rest.origin + rest.size
    onto = [_onto(knots, *np.sort([low[:, k], high[:, k]], axis=0)) for k in (0, 1)]
    own = np.einsum("qia,qabc,qjb->qijc", onto[0], net[row[rest.face]], onto[1])
    own = own.reshape(len(every), -1, 3) - (beyond.limits + d * toward)[:, None]
    away = np.sqrt((own**2).sum(axis=2)).max(axis=1) + far
    height = np.abs((own * toward[:, None]).sum(axis=2)).max(axis=1) + along
    turn = 2 * np.sin(np.minimum(wide, np.pi) / 2)
    # 1 - cos(wide) is half the square of turn
    off = abs(d) * turn + away
    most = measure(abs(d) * turn**2 / 2 + height + turn * away, off, d)
    noise = _ROUNDED * np.maximum(np.abs(surface.points[surface.mesh.indices]).max(), abs(d))
    np.maximum.at(found, row[rest.face], np.where(wide < np.pi / 2, most + noise, np.inf))
