"""Masks as arrays of the number type that is asked for."""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np

from limitsurf.exact.creases import CHAIKIN, INFINITE
from limitsurf.exact.wide import MOST_FACES
from limitsurf.numbers import FLOAT64, NumberType
from limitsurf.scheme.dual import DualScheme
from limitsurf.scheme.lattice import Lattice
from limitsurf.scheme.scheme import Scheme
from limitsurf.scheme.sector import Sector
from limitsurf.tables.cache import eigen_table, warn_once
from limitsurf.tables.records import Array, RingMasks, StripTables


def strip_tables(scheme: Scheme, sharpness: Array, number: NumberType) -> StripTables:
    """Pieces of the splines across creases of the given sharpnesses, each in (0, INFINITE)."""
    depth = np.array([-(-s // 1) for s in sharpness], dtype=np.int64)
    share = sharpness - (depth - 1)
    share = number.array([Fraction(s) for s in share.tolist()])
    first = np.cumsum(depth + 1) - depth - 1
    pieces = np.zeros((int((depth + 1).sum()), 4, 4), dtype=number.dtype)
    for level in np.unique(depth).tolist():
        smooth, sharp = _strip_ends(scheme, level, number)
        here = np.flatnonzero(depth == level)
        found = smooth + share[here, None] * (sharp - smooth)
        place = first[here, None] + np.arange(level + 1)
        pieces[place] = found.reshape(len(here), level + 1, 4, 4)
    return StripTables(first, depth, pieces)


@lru_cache(maxsize=64)
def _strip_ends(scheme: Scheme, depth: int, number: NumberType) -> tuple[Array, Array]:
    """The pieces at shares 0 and 1 of the last step, (16 (depth + 1),) each, read-only."""
    from limitsurf.exact.creases import strip_pieces

    ends = []
    for share in (Fraction(0), Fraction(1)):
        pieces = strip_pieces(scheme, depth, share)
        end = number.array([x for piece in pieces for row in piece for x in row])
        end.flags.writeable = False
        ends.append(end)
    return ends[0], ends[1]


def strips_of(scheme: Scheme, sharpness: Array, number: NumberType) -> tuple[StripTables, Array]:
    """Splines across the creases of strips of some sharpness, and which of them each strip has.

    Of dual schemes all are those of a quad amid others.
    """
    if isinstance(scheme, DualScheme):
        from limitsurf.exact.dual import center_pieces

        one, pieces = np.ones(1, dtype=np.int64), center_pieces(scheme)
        shape = len(pieces), len(pieces[0]), len(pieces[0][0])
        flat = number.array([w for piece in pieces for row in piece for w in row])
        which = np.zeros(len(sharpness), dtype=np.int64)
        return StripTables(0 * one, one, flat.reshape(shape), both=True), which
    distinct, which = np.unique(sharpness, return_inverse=True)
    return strip_tables(scheme, distinct, number), which


@lru_cache(maxsize=4096)
def _face_mask(scheme: Scheme, corners: int) -> tuple[Fraction, ...]:
    return tuple(scheme.face_mask(corners))


@lru_cache(maxsize=4096)
def _vertex_mask(scheme: Scheme, valence: int) -> tuple[Fraction, ...]:
    return tuple(scheme.vertex_mask(valence))


def corner_weights(scheme: Scheme, sizes: Array, number: NumberType) -> Array:
    """Weight of every face corner in its face point, (sum of sizes,)."""
    unique, kind = np.unique(sizes, return_inverse=True)
    table = number.array([w for n in unique.tolist() for w in _face_mask(scheme, n)])
    # row starts of the masks in `table`, of the faces in the result
    mask_start = np.concatenate([[0], np.cumsum(unique)[:-1]])
    position = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    return np.asarray(table[np.repeat(mask_start[kind], sizes) + position])


def vertex_weights(scheme: Scheme, valences: Array, number: NumberType) -> Array:
    """Weights of interior vertices, their edge neighbours, their face points if any, (n, 3 or 2).

    Raises a TypeError where weights are irrational, but numbers exact.
    """
    unique, kind = np.unique(valences, return_inverse=True)
    table = number.array([w for n in unique.tolist() for w in _vertex_mask(scheme, n)])
    return np.asarray(table.reshape(-1, 1 + len(scheme.lattice.orbits))[kind])


@lru_cache(maxsize=256)
def limit_mask(scheme: Scheme, kind: str, faces: int, number: NumberType) -> Array:
    """Weights of the ring in the limit position of its vertex, (ring,).

    Raises a ValueError, `UnsupportedSpectrum`, for masks that do not converge there.
    """
    from limitsurf.exact.analysis import check_convergence
    from limitsurf.exact.sectors import limit_weights
    from limitsurf.exact.wide import rounded_dart_limit

    check_convergence(scheme, kind, faces)
    if kind == "dart" and faces > MOST_FACES and not number.exact:
        edges, around = rounded_dart_limit(scheme, faces)
        mask = np.empty(scheme.sector(kind, faces).ring)
        mask[0] = 1 - edges.sum() - around.sum()
        of_edges, of_corners = orbits(scheme.lattice)
        mask[of_edges], mask[of_corners] = edges, around
    else:
        mask = _array(limit_weights(scheme, scheme.sector(kind, faces)), number)
    mask.flags.writeable = False
    return mask


def _array(weights: list[Fraction], number: NumberType) -> Array:
    """Numbers of a list; objects that are in it many times are converted once."""
    distinct = {id(w): w for w in weights}
    known = dict(zip(distinct, number.array([*distinct.values()]).tolist(), strict=True))
    return number.array([known[id(w)] for w in weights])


def orbits(lattice: Lattice) -> tuple[slice, slice]:
    """Where in a ring the edge neighbours are, and the corners beyond them, if any."""
    stride = len(lattice.orbits)
    return slice(1, None, stride), slice(2, None, stride) if stride > 1 else slice(0)


@lru_cache(maxsize=256)
def normal_masks(scheme: Scheme, kind: str, faces: int) -> Array:
    """Weights of the ring in the vectors of `EigenTable.normal_pairs`, (2 or 0, 2, ring).

    Around more than `MOST_FACES` faces, in the two vectors of `RingMasks.waves`, twice.
    """
    sector = scheme.sector(kind, faces)
    if is_shared(sector):
        rings = ring_masks(scheme, kind, faces)
        both = np.zeros((2 * rings.has_normal, 2, sector.ring))
        if rings.has_normal:
            of_edges, of_corners = orbits(scheme.lattice)
            both[:, :, of_edges], both[:, :, of_corners] = rings.waves
        both[:, :, 0] = -both.sum(axis=2)
    else:
        table = eigen_table(scheme, sector)
        both = table.left_vectors(table.normal_pairs.ravel())[:, : sector.ring]
        both = both.reshape(-1, 2, sector.ring)
    both.flags.writeable = False
    return both


def collapsed_masks(scheme: Scheme, kind: str, faces: int) -> Array:
    """Weights of the ring where sharp edges are points: e_0 or e_k coincide with v, (4, 2, ring).

    Pairs of vectors whose cross product points along the limit normal where both edges are points
    (waves 2 and 1), where the first is, and where the second is (those in corners with a single
    wave); 0 where there is no normal, and where none is sought: around more than `MOST_FACES`
    faces. Then ``e_0 - v`` and ``e_k - v``, which tell. Derived in
    ``derivations/limit_normals.py``, section 8, and ``derivations/loop_sectors.py``, section 7.
    """
    sector = scheme.sector(kind, faces)
    masks = np.zeros((4, 2, sector.ring))
    if not sector.open or sector.carried or is_shared(sector):
        return masks
    table = eigen_table(scheme, sector)
    masks[3, [0, 1], [1, -1]], masks[3, :, 0] = 1, -1
    # modes of the ring: three of the curve, then waves by frequency, in quads two each but the last
    first_two = np.arange(3, sector.ring, len(sector.lattice.orbits))[:2]
    if not len(first_two):
        return masks
    waves = [int(np.flatnonzero(table.order == mode)[0]) for mode in first_two]
    # each positive beside the first edge
    sign = np.sign(table.pieces[0, scheme.spline.exponents.index((0, 1)), waves])
    first, *second = table.left_vectors(np.array(waves))[:, : sector.ring] * sign[:, None]
    if second:
        masks[0] = second[0], first
    elif kind == "corner":
        masks[1], masks[2] = (first, masks[3, 1]), (masks[3, 0], first)
    return masks


def is_shared(sector: Sector) -> bool:
    """Whether the patches around a special corner share its ring, for which there is no table."""
    return sector.faces > MOST_FACES and not sector.carried and not sector.lattice.dual


@lru_cache(maxsize=16)
def ring_masks(scheme: Scheme, kind: str, faces: int) -> RingMasks:
    """Return the masks around a special corner of many faces.

    Raises a ValueError, `UnsupportedSpectrum`, for masks that do not converge there.
    """
    from limitsurf.exact.wide import Weights, slowest_waves

    weights = Weights.of(scheme, faces)
    limit = limit_mask(scheme, kind, faces, FLOAT64)
    waves = slowest_waves(scheme, kind, faces)
    for array in waves:
        array.flags.writeable = False
    sector = scheme.sector(kind, faces)
    of_edges, of_corners = orbits(scheme.lattice)
    limits = limit[of_edges], limit[of_corners]
    made = RingMasks(sector, scheme.spline, weights, limits, waves)
    if not made.has_normal:
        warn_once(scheme, sector)
    return made


def edge_weights(scheme: Scheme, first: Array, second: Array, number: NumberType) -> Array:
    """Weights in edge points of the first ends, the second, and what lies across, (n, 3).

    By the valences of both ends (n,). Raises a TypeError where weights are irrational, but numbers
    exact.
    """
    most = int(max(first.max(initial=0), second.max(initial=0))) + 1
    unique, kind = np.unique(first * most + second, return_inverse=True)
    table = [w for key in unique.tolist() for w in scheme.edge_mask(*divmod(key, most))]
    return np.asarray(number.array(table).reshape(-1, 3)[kind])


@lru_cache(maxsize=256)
def rule_weights(scheme: Scheme, number: NumberType) -> tuple[Array, Array, Array]:
    """Edge mask (2,), boundary edge mask (1,), boundary vertex mask (2,), all read-only."""
    edge, half = number.array(list(scheme.regular_edge)), number.array([scheme.boundary_edge])
    vertex = number.array(list(scheme.boundary_vertex))
    for mask in (edge, half, vertex):
        mask.flags.writeable = False
    return edge, half, vertex


@lru_cache(maxsize=256)
def edge_face_weights(scheme: Scheme, smooth_triangles: bool, number: NumberType) -> Array:
    """What a triangle and what another face contributes to the face weight of its edges, (2,).

    Read-only.
    """
    face = scheme.regular_edge[1]
    triangle = scheme.smooth_triangle if smooth_triangles else None
    weights = number.array([face if triangle is None else triangle, face])
    weights.flags.writeable = False
    return weights


def chaikin_weights(number: NumberType) -> Array:
    """Shares of an edge's own sharpness and of the others' mean, (2,)."""
    return number.array(list(CHAIKIN))


def is_infinite(sharpness: Array) -> Array:
    """Whether sharpness never falls, elementwise."""
    return np.asarray(sharpness >= INFINITE, dtype=bool)


def has_spokes(scheme: Any, valence: int) -> bool:
    """Whether edges of an interior vertex of that valence have a mask of their own."""
    return scheme.spoke_mask(valence) is not None


@lru_cache(maxsize=256)
def spoke_weights(scheme: Any, valence: int, number: NumberType) -> Array:
    """The mask of edges of an interior vertex, (valence + 1,); a TypeError where irrational."""
    mask = scheme.spoke_mask(valence)
    if number.exact and not all(isinstance(w, Fraction) for w in mask):
        raise TypeError(f"the masks of scheme {scheme.name!r} are irrational at valence {valence}")
    own, *around = (w if number.exact else float(w) for w in mask[: valence // 2 + 2])
    found = number.array([own, *around, *around[(valence - 1) // 2 : 0 : -1]])
    found.flags.writeable = False
    return found


@lru_cache(maxsize=64)
def interpolating_weights(scheme: Any, number: NumberType) -> tuple[Any, ...]:
    """Weights of ends, across, wings, and of the near and the far vertices of a curve."""
    near, far = scheme.curve
    return tuple(number.array([scheme.ends, scheme.across, scheme.wings, near, far]))


def shares(scheme: Any, valences: Array, number: NumberType) -> Array:
    """What neighbours share in new points of interior vertices of these valences, (n,).

    Raises a TypeError where that is irrational, but numbers exact.
    """
    unique, kind = np.unique(valences, return_inverse=True)
    found = [_share(scheme, n, number.exact) for n in unique.tolist()]
    return np.asarray(number.array(found)[kind.reshape(-1)])


@lru_cache(maxsize=1024)
def _share(scheme: Any, valence: int, exact: bool) -> Any:
    share = scheme.share_at(valence)
    if exact and not isinstance(share, Fraction):
        raise TypeError(f"the mask of scheme {scheme.name!r} at valence {valence} is irrational")
    return share if exact else float(share)


def curve_weights(scheme: Any, number: NumberType) -> tuple[Array, Array]:
    """Masks of boundary vertices, and of the points at thirds of boundary edges."""
    return number.array(scheme.boundary_vertex), number.array(scheme.boundary_third)
