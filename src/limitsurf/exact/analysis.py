"""What a spectrum says of a special corner: whether there is a limit, and a limit normal.

**Limits.** Refinement converges for all control points if 1 is a simple eigenvalue and all others
are smaller in modulus. Masks differ from regular ones at smooth vertices and darts only. There,
with r the weights of the ring in the vertex point and B the matrix of the ring while the vertex
stays, the eigenvalues that B has not are the zeros of ``(l - 1) (1 + r (l - B)^-1 1)``, and those
of B are smaller than 1.

**Normals.** After n halvings the eigenfunction of value l comes with ``l^n``, at the head of a
Jordan chain that of its end with ``n l^n``. There is a normal if two single modes of positive
value outweigh all others, the minor of their derivatives has one sign on all faces, and they go
around the vertex once: their coefficients span the tangent plane (Reif 1995).

Derived in ``derivations/analysis.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from math import comb, lcm
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.caching import cached_property
from limitsurf.exact.fixed import (
    EQUAL,
    UnsupportedSpectrum,
    diverging,
    in_words,
    mp,
    named,
    to_mpf,
)
from limitsurf.exact.matrices import subdivision_matrix
from limitsurf.exact.ring import centre_block, check_centre
from limitsurf.exact.sectors import folded, mirrored
from limitsurf.exact.wide import MOST_FACES, Weights, dart_factor, wide_dart_values
from limitsurf.scheme.lattice import Lattice, Place
from limitsurf.scheme.scheme import Scheme
from limitsurf.scheme.sector import Sector

Array = NDArray[Any]

_FLOAT = 1e-6  # eigenvalues in float64 are right to this, if there are no worse than double ones
_STEPS = 30  # of a secant, which converges in ten but at double zeros
_HALVINGS = 12  # of a piece on which the sign of a minor is sought


# --- limits ---------------------------------------------------------------------------------------


@lru_cache(maxsize=256)
def check_convergence(scheme: Scheme, kind: str, faces: int) -> None:
    """Raise `UnsupportedSpectrum` where the masks around a special corner have no limit."""
    if scheme.lattice.dual:
        return  # `spectrum` looks at all eigenvalues
    with named(scheme.name):
        if kind in ("interior", "dart") and scheme.has_own_spokes(faces):
            _check_spokes(scheme, Sector(kind, faces, lattice=scheme.lattice))
        elif kind == "interior":
            check_centre(faces, Weights.of(scheme, faces, exact=True).centre(faces))
        elif kind == "dart":
            value = _dart_excess(scheme, Weights.of(scheme, faces, exact=True), faces)
            if value is not None:
                raise diverging(Sector(kind, faces).place, faces, value)


def _check_spokes(scheme: Scheme, sector: Sector) -> None:
    """The same of a vertex that has masks of its own for its edges: `check_convergence`."""
    if sector.kind == "dart" or sector.faces > MOST_FACES:
        raise UnsupportedSpectrum(
            f"at {sector.place} edges have masks of their own: such a scheme can be refined, but "
            "has surfaces only where these are at smooth vertices of at most "
            f"{MOST_FACES} faces; give edges of other vertices the mask of regular ones"
        )
    matrix = subdivision_matrix(scheme, sector)
    check_centre(sector.faces, centre_block(matrix))
    ring = np.zeros((sector.ring, sector.ring))
    for i, row in enumerate(matrix.rows[: sector.ring]):
        for k, w in row.items():
            ring[i, k] = to_mpf(w)  # of few different sympy numbers, each known already
    values = np.linalg.eigvals(ring)
    values = np.delete(values, np.abs(values - 1).argmin())
    largest = values[np.abs(values).argmax()]
    if abs(largest) > 1 - _FLOAT**2:
        raise diverging(sector.place, sector.faces, largest, "edge and vertex")


def check_dominant(scheme: Scheme, sector: Sector, values: Sequence[Any]) -> None:
    """Raise `UnsupportedSpectrum` where a complex or negative pair follows 1 at a smooth vertex.

    `values` are all but 1, by decreasing modulus. If none of the two or more largest is positive,
    surfaces turn for ever on the way to the vertex.
    """
    largest = [x for x in values if abs(values[0]) - abs(x) < EQUAL]
    positive = [x for x in largest if not hasattr(x, "_mpc_") and x > -EQUAL]
    if sector.kind != "interior" or positive or len(largest) < 2:
        return
    what = "complex" if hasattr(largest[0], "_mpc_") else "negative"
    mask = "corner" if scheme.lattice.dual else "vertex"
    raise UnsupportedSpectrum(
        f"at {sector.place} the pair of eigenvalues that outweighs all but 1 is {what}, "
        f"{in_words(largest[0])}, need a positive pair; change the scheme's {mask}({sector.faces})"
    )


@lru_cache(maxsize=256)
def _dart_excess(scheme: Scheme, weights: Weights, faces: int) -> Any:
    """An eigenvalue of a dart beside the simple 1 that has modulus 1 or more; else None."""
    found = slow_dart_values(scheme, weights, faces, 1 - _FLOAT)
    return next((x for x, error in found if abs(x) + error > 1 - EQUAL), None)


def slow_dart_values(
    scheme: Scheme, weights: Weights, faces: int, least: float
) -> list[tuple[Any, Any]]:
    """Eigenvalues of a dart but one 1 of more than that modulus, of those that the masks change.

    Found in float64, refined, and each with a bound of its error.
    """
    if faces > MOST_FACES:
        values = wide_dart_values(weights, faces)
    else:
        matrix = subdivision_matrix(scheme, scheme.sector("dart", faces))
        even = np.array(folded(matrix, mirrored(matrix.sector)), dtype=float)
        values = np.linalg.eigvals(even)
        values = np.delete(values, np.abs(values - 1).argmin())
    near = values[np.abs(values) > least]
    exact = Weights(*map(to_mpf, vars(weights).values()))
    return [
        _zero(lambda x: dart_factor(exact, faces, x, mp.sqrt), complex(x)) for x in near.tolist()
    ]


def _zero(function: Callable[[Any], Any], start: complex) -> tuple[Any, Any]:
    """A zero of an analytic function near the start, by secants, and a bound of its error."""
    here = mp.mpf(start.real) if abs(start.imag) < _FLOAT else mp.mpc(start)
    before = here * (1 + mp.mpf(10) ** -12)
    low, high = function(before), function(here)
    for _ in range(_STEPS):
        if low == high:
            break
        before, here = here, here - high * (here - before) / (high - low)
        if abs(here - before) < EQUAL:
            return here, EQUAL / 2
        low, high = high, function(here)
    return mp.mpmathify(start), _FLOAT


# --- normals --------------------------------------------------------------------------------------


def leading_pair(
    values: Sequence[Any], outer: Collection[Any], heads: Mapping[int, int], absent: Collection[int]
) -> tuple[tuple[int, ...], bool]:
    """The two modes of a ring that outweigh all others on the way to the vertex, or none.

    Also whether they do so where the functions of the ends of their chains are 0.

    Parameters
    ----------
    values : eigenvalues of the ring, of which the first is 1
    outer : those of the outer points
    heads : {end: head} of Jordan chains
    absent : modes that no control points have
    """
    first_heads = set(heads.values())
    ends = {head: end for end, head in heads.items()}

    def weight(k: int) -> tuple[Any, bool]:
        return mp.nint(abs(values[k]) / EQUAL), k in first_heads

    modes = [k for k in range(1, len(values)) if k not in absent]
    modes.sort(key=lambda k: (-weight(k)[0], k not in first_heads))
    first = modes[0]
    # of a chain the end has the same function as the head: no plane, and a lower weight
    others = [k for k in modes[1:] if k != ends.get(first)]
    if not others:
        return (), False
    second, *rest = others
    least = [(mp.nint(abs(x) / EQUAL), False) for x in outer]
    alone = all(weight(second) > rival for rival in [*map(weight, rest), *least])
    rest = [k for k in rest if k != ends.get(second)]
    without = all(weight(second)[0] > rival[0] for rival in [*map(weight, rest), *least])
    positive = all(isinstance(values[k], mp.mpf) and values[k] > EQUAL for k in (first, second))
    return ((first, second) if alone and positive else ()), without


def minor_sign(scheme: Scheme, functions: Array) -> int | None:
    """The sign of the minor of two eigenfunctions on all faces; 0 if there is none, None if unsure.

    Parameters
    ----------
    scheme : whose pieces these are
    functions : (F, pieces, monomials, 2 or 4) of int
        Coefficients on the pieces of faces, as in `Spline.exponents`; if there are four, the last
        two are those of the modes themselves, of which the first two have the ends of chains.
    """
    form = _minors(scheme.lattice, scheme.spline.exponents)
    net = form.minor(functions[..., 0], functions[..., 1])
    middle = net[0, 1].sum()
    sign = (middle > 0) - (middle < 0)
    net = sign * net
    noise = int(mp.mpf(int(np.abs(net).max())) * EQUAL)
    net[np.abs(net) <= noise] = 0
    second = None
    if functions.shape[-1] > 2:
        second = sign * form.minor(functions[..., 2], functions[..., 3])
    sure = True
    for face, piece in np.ndindex(net.shape[:2]):
        here = net[face, piece]
        if second is not None and form.is_beside_zero(here, second[face, piece], noise):
            continue
        positive = form.is_positive(here, noise, _HALVINGS)
        if positive is False:
            return 0
        sure = sure and positive is True
    return sign if sure else None


def winding(scheme: Scheme, functions: Array, turns: int) -> float:
    """How often two functions, as those of `minor_sign`, go around 0 on closed faces.

    NaN where they pass through 0. `turns` faces are like each of these.
    """
    return _minors(scheme.lattice, scheme.spline.exponents).angle(functions) * turns


def orientation(scheme: Scheme, functions: Array, closed: bool, turns: int) -> int:
    """The sign of the minor of two eigenfunctions that are regular around a vertex, else 0.

    `functions` as in `minor_sign`, `turns` as in `winding`; `closed`, whether the faces surround
    the vertex, which the functions then must go around once.
    """
    sign = minor_sign(scheme, functions)
    if not sign:
        return 0
    return sign if not closed or abs(winding(scheme, functions, turns) - sign) < 0.25 else 0


@lru_cache(maxsize=8)
def _minors(lattice: Lattice, exponents: tuple[Place, ...]) -> Minors:
    return Minors(lattice, exponents)


class Minors:
    """Minors ``f_S g_T - f_T g_S`` of functions on a domain, by their Bernstein coefficients.

    These are integers (..., places). A place (i, j) counts steps along the edges, from (0, 0) on;
    as exponents, places are those of the monomials of the minors too.
    """

    def __init__(self, lattice: Lattice, exponents: tuple[Place, ...]) -> None:
        self._lattice, self._exponents = lattice, exponents
        # tensor products have a degree in each direction, others one in both
        self._tensor = lattice.face_size == 4
        degrees = [max(p) if self._tensor else sum(p) for p in exponents]
        self.degree = 2 * max(degrees) - (1 if self._tensor else 2)
        grid = range(self.degree + 1)
        self.places = [(i, j) for i in grid for j in grid if self._tensor or i + j <= self.degree]
        self._change = np.array([[self._share(p, q) for q in self.places] for p in self.places])
        self._change = self._change.astype(object)
        # of the corners, and of all places on each side
        i, j = self.degree * np.array(lattice.corners).T
        self._corners = [self.places.index(corner) for corner in zip(i, j, strict=True)]
        i, j = np.array(self.places).T
        self._sides = [a * self.degree + b * i + c * j == 0 for a, b, c in lattice.edges]

    def _whole(self, powers: Place) -> int:
        """The factor of a monomial in the Bernstein polynomial of the same exponents."""
        i, j = powers
        return comb(self.degree, i) * comb(self.degree - (0 if self._tensor else i), j)

    def _share(self, place: Place, powers: Place) -> int:
        """The Bernstein coefficient at a place of a monomial, times `_unit`."""
        (a, b), (i, j) = place, powers
        return comb(a, i) * comb(b, j) * (self._unit // self._whole(powers))

    @cached_property
    def _unit(self) -> int:
        return lcm(*map(self._whole, self.places))

    @cached_property
    def _halves(self) -> list[Array]:
        """Coefficients on each child from those on the domain, times `_scale`."""
        # monomials from Bernstein coefficients, by differences
        inverse = [
            [
                self._whole((i, j)) * (-1) ** (i + j + a + b) * comb(i, a) * comb(j, b)
                for a, b in self.places
            ]
            for i, j in self.places
        ]
        top = 2 * self.degree
        halves = []
        for child in self._lattice.children:
            # S = (x + side s) / 2, T = (y + side t) / 2, times 2^top
            (x, y), side = child.origin, -1 if child.turned else 1
            moved = [
                [
                    comb(i, a) * x ** max(i - a, 0) * comb(j, b) * y ** max(j - b, 0)
                    * side ** (a + b) << (top - i - j)
                    for i, j in self.places
                ]
                for a, b in self.places
            ]  # fmt: skip
            whole = self._change @ np.array(moved, object) @ np.array(inverse, object)
            halves.append(whole * self._scale // (self._unit << top))
        return halves

    @property
    def _scale(self) -> int:
        # means of two in each step of de Casteljau's scheme
        return 1 << self.degree * (2 if self._tensor else 1)

    def minor(self, f: Array, g: Array) -> Array:
        """Coefficients, times a number, of the minor of functions (..., monomials)."""
        power = np.zeros((*f.shape[:-1], len(self.places)), dtype=f.dtype)
        at = {place: k for k, place in enumerate(self.places)}
        for p, (a, b) in enumerate(self._exponents):
            for q, (c, d) in enumerate(self._exponents):
                if weight := a * d - b * c:
                    power[..., at[a + c - 1, b + d - 1]] += weight * f[..., p] * g[..., q]
        return np.asarray(power @ self._change.astype(f.dtype).T)

    def is_positive(self, net: Array, noise: int, halvings: int) -> bool | None:
        """Whether a polynomial is positive on a piece, of coefficients (places,).

        None if so many halvings do not decide it on the first part that is not known to be.
        """
        if (net > noise).all():
            return True
        if (net[self._corners] <= noise).any():
            return False
        if halvings == 0:
            return None
        for half in self._halves:
            positive = self.is_positive(half @ net, noise * self._scale, halvings - 1)
            if not positive:
                return positive
        return True

    def is_beside_zero(self, net: Array, head: Array, noise: int) -> bool:
        """Whether a minor is positive but on sides where it is 0, and there the lesser one is."""
        inside = np.ones(len(net), dtype=bool)
        for side in self._sides:
            if not net[side].any():
                inside[side] = False
        return bool((net[inside] > noise).all() and (inside.all() or (head > noise).all()))

    def angle(self, functions: Array) -> float:
        """The angle that two functions sweep on faces from side to side, in whole turns."""
        exponents = self._exponents
        size = int(np.abs(functions).max())
        parts = (functions[..., :2] / size).astype(float)  # (F, pieces, monomials, 2)
        swept = 0.0
        # along the far sides: from each corner of the face to the middle, and on to the next one
        for start, end in pairwise(self._lattice.corners[1:]):
            sides = _bernstein_along(start, end, exponents)
            for piece in self._along(start, end, parts.shape[1]):
                x, y = np.moveaxis(sides @ parts[:, piece], -1, 0)
                swept += sum(map(_swept, x + 1j * y))
        return swept / (2 * np.pi)

    def _along(self, start: Place, end: Place, count: int) -> list[int]:
        """The pieces, of so many, along a far side from corner to corner."""
        pieces, children = (
            [child.origin for child in x] for x in (self._lattice.pieces, self._lattice.children)
        )
        ends = (start, end)
        if count == len(pieces):
            return [pieces.index(corner) for corner in ends]
        return [
            len(children) * pieces.index(corner) + children.index(part)
            for corner in ends
            for part in ends
        ]


def _bernstein_along(start: Place, end: Place, exponents: tuple[Place, ...]) -> Array:
    """Bernstein coefficients, on the segment between two corners, of monomials (places, all)."""
    degree = max(i + j for i, j in exponents)
    rows = []
    for i, j in exponents:
        # S^i T^j = (s + (s' - s) x)^i (t + (t' - t) x)^j
        powers = np.polynomial.Polynomial([start[0], end[0] - start[0]]) ** i
        powers *= np.polynomial.Polynomial([start[1], end[1] - start[1]]) ** j
        coefficients = powers.coef
        rows.append(
            [
                sum(comb(k, m) / comb(degree, m) * c for m, c in enumerate(coefficients[: k + 1]))
                for k in range(degree + 1)
            ]
        )
    return np.array(rows, dtype=float).T


def _swept(curve: Array, halvings: int = _HALVINGS) -> float:
    """The angle around 0 that a curve of complex Bernstein coefficients sweeps; NaN if unsure.

    Coefficients in a half plane without 0 hold all of it there: then its ends tell.
    """
    ahead = curve / curve[0] if curve[0] else curve
    middle = np.conj(ahead[0] + ahead[-1] / abs(ahead[-1]) if ahead[-1] else 0)
    if ((ahead * middle).real > _FLOAT * np.abs(ahead).max() * abs(middle)).all():
        return float(np.angle(ahead[-1]))
    if halvings == 0:
        return float("nan")
    first, last, rest = [curve[0]], [curve[-1]], curve
    while len(rest) > 1:
        rest = (rest[1:] + rest[:-1]) / 2
        first.append(rest[0])
        last.append(rest[-1])
    halves = (np.array(first), np.array(last[::-1]))
    return sum(_swept(half, halvings - 1) for half in halves)


# --- curvature ------------------------------------------------------------------------------------


def curvature_rank(value: Any, second: Any) -> int:
    """Whether ``|value| / second^2`` is above 1, 1, or below: 1, 0 or -1, to 60 digits."""
    excess = mp.nint((abs(value) - abs(second) ** 2) / EQUAL)
    return int(mp.sign(excess))
