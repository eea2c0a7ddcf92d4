"""Spectra of schemes without polynomial pieces around a smooth vertex, by frequencies.

A step is the same for all sectors around the vertex, so that waves stay waves: what is ``z_s`` in
sector s as ``exp(2 pi i f s / N)`` becomes a multiple of itself. Each frequency f has a small
matrix, of one number for each vertex of a sector in three rings, and the vertex at f = 0. Angles
are counted by where vertices are in their sectors, those of new ones by where they lie between old
ones: so a step that turns the mesh has matrices without that turn. Numbers have 96 digits. Derived
in ``derivations/stepwise.py``.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

from limitsurf.exact.fixed import EQUAL, diverging, mp, to_mpf
from limitsurf.scheme.scheme import Scheme

Vertex = tuple[int, int, int]  # ring, sector, and which of the vertices from its first spoke on
Weights = dict[Vertex, Any]

_RINGS = 3  # of new vertices; these are made of three rings of old ones
_CLUSTER = mp.mpf(10) ** -20  # eigenvalues of chains of n are found to an n-th of all digits


class Wave(NamedTuple):
    """An eigenvalue of one frequency, with those that are equal to it there.

    Attributes
    ----------
    value : mpf or mpc
    frequency : int
    jordan : tuple of int
        Sizes of its blocks, the largest first.
    outer : bool
        Whether it is none of the least rings that are made of themselves.
    """

    value: Any
    frequency: int
    jordan: tuple[int, ...]
    outer: bool


class WaveSpectrum(NamedTuple):
    """All waves around a vertex of one valence.

    Attributes
    ----------
    waves : tuple of Wave
        By decreasing modulus; frequencies from 0 to half the valence, of which all but 0 and that
        half are met twice.
    own : mpf
        The weight of the vertex in its limit.
    """

    waves: tuple[Wave, ...]
    own: Any


@lru_cache(maxsize=256)
def wave_spectrum(scheme: Scheme, valence: int) -> WaveSpectrum:
    """The spectrum at an interior vertex.

    Raises `UnsupportedSpectrum` where masks do not converge.
    """
    step = _Step(scheme, valence)
    found, own = [], None
    for f in range(valence // 2 + 1):
        matrix = step.matrix(f)
        if f == 0:
            own = _limit(matrix)
        inner = _eigenvalues(matrix[: step.inner(f), : step.inner(f)])
        for value, sizes in _blocks(matrix):
            outer = all(abs(value - x) > _CLUSTER for x in inner)
            found.append(Wave(value, f, sizes, outer))
    found.sort(key=lambda wave: (-mp.nint(abs(wave.value) / EQUAL), wave.frequency))
    ones = [wave for wave in found if abs(wave.value) > 1 - EQUAL]
    if len(ones) > 1 or ones[0].jordan != (1,):
        raise diverging("an interior vertex", valence, ones[-1].value)
    return WaveSpectrum(tuple(found), own)


class _Step:
    """What a step makes of the rings around a vertex."""

    def __init__(self, scheme: Scheme, valence: int) -> None:
        self._scheme, self._valence = scheme, valence
        self.orbits = [(r, t) for r in range(1, _RINGS + 1) for t in range(r)]
        turns = scheme.turns_edges
        self._shift = mp.mpf(1) / 2 if turns else mp.mpf(0)
        made = self._turned if turns else self._halved
        self._rows = {(r, 0, t): made(r, t) for r, t in self.orbits}
        self._centre = self._vertex_mask((0, 0, 0)) if turns else {(0, 0, 0): mp.mpf(1)}

    def inner(self, f: int) -> int:
        """How many numbers of a frequency are of the least rings that are made of themselves."""
        for ring in range(1, _RINGS + 1):
            rows = [row for (r, _, _), row in self._rows.items() if r <= ring]
            if all(vertex[0] <= ring for row in rows for vertex in row):
                break
        return ring * (ring + 1) // 2 + (f == 0)

    def matrix(self, f: int) -> Any:
        """The matrix of a frequency; at 0 the first number is that of the vertex."""
        first = 1 if f == 0 else 0
        place = {orbit: first + k for k, orbit in enumerate(self.orbits)}
        found = mp.zeros(first + len(self.orbits))
        rows = [(place[r, t], (r, 0, t), row) for (r, _, t), row in self._rows.items()]
        if f == 0:
            rows.append((0, (0, 0, 0), self._centre))
        for k, (r, s, t), row in rows:
            angle = (self._shift + s + mp.mpf(t) / r) if r else mp.mpf(0)
            for (q, sector, number), weight in row.items():
                if q == 0:
                    if f == 0:
                        found[k, 0] += weight
                    continue
                way = 2 * f * (sector + mp.mpf(number) / q - angle) / self._valence
                found[k, place[q, number]] += weight * mp.expjpi(way)
        return found

    # ------------------------------------------------------------------------- where vertices are

    def _at(self, sector: int, x: int, y: int) -> Vertex:
        """The vertex at ``x a + y b`` from the vertex, between the spokes a and b of a sector."""
        r = x + y
        if r == 0:
            return 0, 0, 0
        if x == 0:
            sector, y = sector + 1, 0
        return r, sector % self._valence, y

    def _neighbours(self, vertex: Vertex) -> list[Vertex]:
        """The neighbours, counter-clockwise; those of the middle vertex from the first spoke on."""
        r, s, t = vertex
        if r == 0:
            return [(1, sector, 0) for sector in range(self._valence)]
        x, y = r - t, t
        ways = [(1, 0), (0, 1), (-1, 1), (-1, 0), (0, -1), (1, -1)]
        return [self._moved(s, x, y, *way) for way in ways]

    def _moved(self, s: int, x: int, y: int, dx: int, dy: int) -> Vertex:
        """The vertex at ``(x, y) + (dx, dy)`` of a sector, which it may leave by a step."""
        x, y = x + dx, y + dy
        if y < 0:  # into the sector before, whose second spoke is the first one here
            return self._at((s - 1) % self._valence, -y, x + y)
        if x < 0:
            return self._at((s + 1) % self._valence, x + y, -x)
        return self._at(s, x, y)

    def _across(self, p: Vertex, q: Vertex) -> tuple[Vertex, Vertex]:
        """The corners opposite to an edge, to its left and to its right."""
        around = self._neighbours(p)
        k = around.index(q)
        return around[(k + 1) % len(around)], around[k - 1]

    # ------------------------------------------------------------------------- edges are halved

    def _halved(self, r: int, t: int) -> Weights:
        """Weights of the vertex at half of ``(r - t, t)``: an old one, or the middle of an edge."""
        x, y = r - t, t
        low, high = (x // 2, y // 2), (x - x // 2, y - y // 2)
        if low == high:
            return {self._at(0, *low): mp.mpf(1)}
        if x % 2 and y % 2:  # the edge across
            low, high = (low[0], high[1]), (high[0], low[1])
        return self._edge(self._at(0, *low), self._at(0, *high))

    def _edge(self, p: Vertex, q: Vertex) -> Weights:
        """The mask of an edge; the mean of both where both ends have one of their own."""
        scheme: Any = self._scheme
        found: Weights = {}
        masks = [(self._spokes(end), end, other) for end, other in ((p, q), (q, p))]
        own = [(mask, end, other) for mask, end, other in masks if mask is not None]
        for mask, end, other in own:
            around = self._neighbours(end)
            k = around.index(other)
            _add(found, end, mask[0] / len(own))
            for j, weight in enumerate(mask[1:]):
                _add(found, around[(k + j) % len(around)], weight / len(own))
        if own:
            return found
        left, right = self._across(p, q)
        wings = [self._across(*side) for side in ((p, left), (left, q), (q, right), (right, p))]
        for vertices, weight in (
            ((p, q), scheme.ends),
            ((left, right), scheme.across),
            (tuple(_other(pair, (p, q)) for pair in wings), scheme.wings),
        ):
            for vertex in vertices:
                _add(found, vertex, to_mpf(weight))
        return found

    def _spokes(self, vertex: Vertex) -> list[Any] | None:
        scheme: Any = self._scheme
        mask = scheme.spoke_mask(self._valence if vertex[0] == 0 else 6)
        return None if mask is None else [to_mpf(weight) for weight in mask]

    # ------------------------------------------------------------------------- edges are turned

    def _turned(self, r: int, t: int) -> Weights:
        """Weights of ``(r - t) m + t n``, where m and n are the middles of two faces in turn.

        In spokes a, b, c these are ``(a + b) / 3`` and ``(b + c) / 3``; the spoke between divides
        what is in the one face's sector from what is in the other's.
        """
        i, j = r - t, t
        sector, x, y = (0, i - j, i + 2 * j) if i >= j else (1, 2 * i + j, j - i)
        low, high = x // 3, y // 3
        if x % 3 == 0:
            return self._vertex_mask(self._at(sector, low, high))
        if x % 3 == 1:
            corners = [(low, high), (low + 1, high), (low, high + 1)]
        else:
            corners = [(low + 1, high + 1), (low, high + 1), (low + 1, high)]
        return {self._at(sector, *corner): mp.mpf(1) / 3 for corner in corners}

    def _vertex_mask(self, vertex: Vertex) -> Weights:
        scheme: Any = self._scheme
        around = self._neighbours(vertex)
        share = to_mpf(scheme.share_at(len(around)))
        found: Weights = {vertex: 1 - share}
        for other in around:
            _add(found, other, share / len(around))
        return found


def _add(weights: Weights, vertex: Vertex, weight: Any) -> None:
    weights[vertex] = weights.get(vertex, mp.mpf(0)) + weight


def _other(pair: tuple[Vertex, Vertex], ends: tuple[Vertex, Vertex]) -> Vertex:
    """That of two corners opposite to a side which is not an end of the edge beside it."""
    return pair[0] if pair[1] in ends else pair[1]


def _eigenvalues(matrix: Any) -> list[Any]:
    if matrix.rows == 1:
        return [matrix[0, 0]]
    return list(mp.eig(matrix, left=False, right=False))


def _blocks(matrix: Any) -> Iterator[tuple[Any, tuple[int, ...]]]:
    """Eigenvalues with the sizes of their Jordan blocks, the largest first."""
    values = _eigenvalues(matrix)
    n = matrix.rows
    while values:
        first = values[0]
        near = [x for x in values if abs(x - first) < _CLUSTER]
        values = [x for x in values if abs(x - first) >= _CLUSTER]
        # what is lost by chains is so by turns, and the mean has all digits
        value = sum(near) / len(near)
        if abs(mp.im(value)) < EQUAL:
            value = mp.re(value)
        if len(near) == 1:
            yield value, (1,)
            continue
        power, nullities = mp.eye(n), [0]
        while nullities[-1] < len(near):
            power = power * (matrix - value * mp.eye(n))
            sizes = mp.svd_c(power, compute_uv=False)
            nullities.append(sum(1 for size in sizes if size < EQUAL))
        # how many blocks there are of at least each size
        longer = [b - a for a, b in pairwise(nullities)] + [0]
        sizes = [k + 1 for k in range(len(longer) - 1) for _ in range(longer[k] - longer[k + 1])]
        yield (value, tuple(sorted(sizes, reverse=True)))


def _limit(matrix: Any) -> Any:
    """The weight of the vertex in its limit: of the left eigenvector of 1."""
    n = matrix.rows
    # rows sum to 1, as do the weights: one condition for the other
    system = (matrix - mp.eye(n)).T
    right = mp.zeros(n, 1)
    for k in range(n):
        system[n - 1, k] = 1
    right[n - 1] = 1
    return mp.re(mp.lu_solve(system, right)[0])
