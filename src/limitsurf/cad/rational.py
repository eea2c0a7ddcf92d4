"""Rational splines of any degrees, in one or two directions, evaluated together to any order."""

from __future__ import annotations

from math import comb
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_PLACES = 1 << 14  # at once


def functions(
    knots: Array, first: Array, count: Array, degree: int, x: Array, order: int
) -> tuple[Array, list[Array]]:
    """The first function (Q,) that counts at x, and derivatives (Q, degree + 1) up to an order.

    The knots of each place begin at `first` (Q,), and are of `count` (Q,) functions. At a knot it
    is the piece above, at the end the last one, that counts.
    """
    low, high = np.full(len(x), degree), count.copy()
    while (high - low > 1).any():
        middle = (low + high) // 2
        above = x >= knots[first + middle]
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    # what is at the end, after knots that are there several times, is in the last piece with length
    while (empty := (knots[first + low + 1] <= knots[first + low]) & (low > degree)).any():
        low = low - empty
    at, found = first + low, []
    for nu in range(order + 1):
        values = np.ones((len(x), 1))
        if nu > degree:
            found.append(np.zeros((len(x), degree + 1)))
            continue
        for k in range(1, degree + 1):
            right = knots[at[:, None] + np.arange(1, k + 1)]
            left = knots[at[:, None] + np.arange(1 - k, 1)]
            share = values / (right - left)
            values = np.zeros((len(x), k + 1))
            if k > degree - nu:
                values[:, :-1] = -k * share
                values[:, 1:] += k * share
            else:
                values[:, :-1] = (right - x[:, None]) * share
                values[:, 1:] += (x[:, None] - left) * share
        found.append(values)
    return low - degree, found


def jets(faces: Any, face: Array, u: Array, v: Array, order: int) -> dict[tuple[int, int], Array]:
    """Derivatives (Q, 3) by orders, of checked places (Q,) of `SplineFaces`."""
    orders = [(i, j) for total in range(order + 1) for i, j in _of_total(total)]
    found = {nu: np.full((len(face), 3), np.nan) for nu in orders}
    kinds, which = np.unique(faces.degree, axis=0, return_inverse=True)
    for k, (p, q) in enumerate(kinds.tolist()):
        here = np.flatnonzero(which.ravel()[face] == k)
        for start in range(0, len(here), _PLACES):
            some = here[start : start + _PLACES]
            homogeneous = _homogeneous(faces, face[some], u[some], v[some], (p, q), order)
            for nu, value in _divided(homogeneous, orders).items():
                found[nu][some] = value
    return found


def _homogeneous(
    faces: Any, face: Array, u: Array, v: Array, degree: tuple[int, int], order: int
) -> dict[tuple[int, int], Array]:
    """Derivatives (Q, 4) of weighted points and weights."""
    first_u, first_v, first = faces.firsts
    count = faces.counts[face]
    (p, q) = degree
    i, along = functions(faces.knots_u, first_u[face], count[:, 0], p, u, order)
    j, across = functions(faces.knots_v, first_v[face], count[:, 1], q, v, order)
    rows = first[face, None] + (i[:, None] + np.arange(p + 1)) * count[:, 1, None] + j[:, None]
    rows = rows[:, :, None] + np.arange(q + 1)
    weight = faces.weights[rows]
    net = np.concatenate([faces.points[rows] * weight[..., None], weight[..., None]], axis=-1)
    return {
        (a, b): np.einsum("qi,qj,qijk->qk", along[a], across[b], net)
        for total in range(order + 1)
        for a, b in _of_total(total)
    }


def _divided(
    homogeneous: dict[tuple[int, int], Array], orders: list[tuple[int, int]]
) -> dict[tuple[int, int], Array]:
    """Derivatives of the quotient (Piegl and Tiller, The NURBS Book, 1997, eq. 4.20)."""
    weight = homogeneous[0, 0][:, 3:]
    found: dict[tuple[int, int], Array] = {}
    for k, m in orders:
        value = homogeneous[k, m][:, :3].copy()
        for i in range(k + 1):
            for j in range(m + 1):
                if i or j:
                    times = comb(k, i) * comb(m, j)
                    value -= times * homogeneous[i, j][:, 3:] * found[k - i, m - j]
        found[k, m] = value / weight
    return found


def _of_total(total: int) -> list[tuple[int, int]]:
    return [(total - j, j) for j in range(total + 1)]


def along_curves(
    degree: Array, counts: Array, knots: Array, points: Array, weights: Array, share: Array
) -> Array:
    """Points (C, k, 2) of curves in a plane, at shares (k,) of their parameters."""
    length = counts + degree + 1
    first_knot, first = np.cumsum(length) - length, np.cumsum(counts) - counts
    low, high = knots[first_knot + degree], knots[first_knot + counts]
    x = low[:, None] + (high - low)[:, None] * share
    x[:, share == 1] = high[:, None]
    found = np.empty((*x.shape, 2))
    for p in np.unique(degree).tolist():
        here = np.flatnonzero(degree == p)
        owner = np.repeat(here, len(share))
        begin, (values,) = functions(knots, first_knot[owner], counts[owner], p, x[here].ravel(), 0)
        rows = (first[owner] + begin)[:, None] + np.arange(p + 1)
        heavy = values * weights[rows]
        value = np.einsum("qi,qik->qk", heavy, points[rows]) / heavy.sum(axis=1)[:, None]
        found[here] = value.reshape(len(here), len(share), 2)
    return found
