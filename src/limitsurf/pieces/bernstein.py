"""The Bernstein form of polynomial pieces, on squares and on triangles.

Control points of a regular patch, powers of a piece's parameters and turns of the domain all come
as matrices onto Bernstein coefficients; the rest of the room multiplies by them and knows neither
the degree nor the number of corners.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from math import comb, perm
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import numbers
from limitsurf._kernels import reference as kernels

if TYPE_CHECKING:
    from limitsurf.scheme.lattice import Lattice
    from limitsurf.scheme.scheme import Scheme
    from limitsurf.scheme.spline import Spline

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Bernstein:
    """Matrices onto the n Bernstein coefficients of a piece, in float64 or exact.

    A coefficient lies at ``(i, j) / degree`` in the domain.

    Attributes
    ----------
    exponents : (n, 2) int
        i and j of each coefficient: by i, then j, in squares; by j, then i, in triangles.
    shape : (degree + 1, degree + 1) or (n,)
        Of the coefficients as they are handed out.
    from_controls : (n, K)
        From the control points of a regular patch.
    from_powers : (n, n)
        From the coefficients of the powers of its parameters, in the order of `Spline.exponents`.
    turned : (corners, n) int
        Which coefficients of patches turned by so many corners are those of the domain.
    near : int
        The control point of a regular patch at its corner (0, 0).
    """

    exponents: Array
    shape: tuple[int, ...]
    from_controls: Array
    from_powers: Array
    turned: Array
    near: int

    @classmethod
    @lru_cache(maxsize=64)
    def of(cls, scheme: Scheme, exact: bool) -> Bernstein:
        """That of a scheme's pieces."""
        spline = scheme.spline
        exponents = np.array(spline.exponents)
        degree = int(exponents.max())
        shape: tuple[int, ...] = exponents.shape[:1]
        if spline.is_product:
            exponents, shape = exponents[:, ::-1], (degree + 1, degree + 1)
            controls, powers = (_tensor(x, x) for x in _lines(spline, exact))
        else:
            powers = _powers(exponents, lambda i, j: perm(degree, i + j))
            controls = powers @ np.array(spline.pieces)
            if not exact:
                controls, powers = controls.astype(float), powers.astype(float)
        turned = _turns(scheme.lattice, exponents, degree)
        return cls(exponents, shape, controls, powers, turned, spline.template.index((1, 1)))

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return len(self.exponents)


def is_tensor(exponents: Array) -> bool:
    """Whether these are the exponents of products of polynomials in s and in t."""
    return bool(len(exponents) == (exponents.max() + 1) ** 2)


def polynomials(exponents: Array, s: Array, t: Array) -> Array:
    """Values (Q, n) of Bernstein polynomials at (s, t), arrays (Q,) of any type of numbers."""
    degree, (i, j), number = int(exponents.max()), exponents.T, numbers.type_of(s)
    if is_tensor(exponents):
        count = number.array([comb(degree, k) for k in range(degree + 1)])
        along, across = (
            count * kernels.monomials(x, degree) * kernels.monomials(1 - x, degree)[:, ::-1]
            for x in (s, t)
        )
        return np.asarray(along[:, i] * across[:, j])
    count = number.array([comb(degree, k) * comb(k, m) for k, m in zip(i + j, j, strict=True)])
    first, second, rest = (kernels.monomials(x, degree) for x in (s, t, 1 - s - t))
    return np.asarray(count * first[:, i] * second[:, j] * rest[:, degree - i - j])


def parts(exponents: Array, frames: Array) -> Array:
    """Onto the coefficients in parts of the domain, (Q, n, n), of frames (Q, 3, 2).

    A frame has the part's corner 0, its s and its t.
    """
    s, t = exponents.T / exponents.max()
    at = frames[:, :1] + s[:, None] * frames[:, 1:2] + t[:, None] * frames[:, 2:]
    there = polynomials(exponents, *at.reshape(-1, 2).T)
    own = polynomials(exponents, s, t)
    return np.linalg.solve(own, there.reshape(len(frames), len(exponents), len(exponents)))


def children(lattice: Lattice, exponents: Array) -> tuple[Array, Array]:
    """Frames (c, 3, 2) of the children of the domain, and exactly what `parts` says of them."""
    return _children(lattice, tuple(map(tuple, exponents.tolist())))


@lru_cache(maxsize=64)
def _children(lattice: Lattice, exponents: tuple[tuple[int, int], ...]) -> tuple[Array, Array]:
    frames = np.zeros((len(lattice.children), 3, 2))
    for k, child in enumerate(lattice.children):
        sign = -1 if child.turned else 1
        frames[k] = [child.origin, (sign, 0), (0, sign)]
    frames = frames / 2
    found = frames, blossoms(np.array(exponents), frames)
    for array in found:
        array.flags.writeable = False
    return found


def blossoms(exponents: Array, frames: Array) -> Array:
    """The same as `parts`, exact where frames are halves; those of squares along their sides.

    Coefficient (i, j) of a part is the blossom at i times one corner, j times another and corner 0
    else. It takes the coefficients of the product of linear forms, one for each of these places.
    """
    degree = int(exponents.max())
    found = np.empty((len(frames), len(exponents), len(exponents)))
    for k, (origin, along, across) in enumerate(frames):
        if is_tensor(exponents):
            ends = zip(origin, origin + along + across, strict=True)
            lines = [_line_blossoms(degree, np.array([low, high])) for low, high in ends]
            found[k] = np.kron(*lines)
            continue
        corners = np.array([origin, origin + along, origin + across])
        known: dict[tuple[int, ...], Array] = {
            (0, 0, 0): np.eye(1, degree + 1) * np.eye(degree + 1, 1)
        }
        for a, b, c in np.ndindex(*(degree + 1,) * 3):
            if 0 < a + b + c <= degree:
                last = 2 if c else 1 if b else 0
                before = tuple(x - (axis == last) for axis, x in enumerate((a, b, c)))
                known[a, b, c] = _times(known[before], *corners[last])
        i, j = exponents.T
        rows = zip(degree - i - j, i, j, strict=True)
        found[k] = [known[tuple(map(int, row))][i, j] for row in rows]
    return found


def _line_blossoms(degree: int, ends: Array) -> Array:
    """Those of a part of a line, (degree + 1, degree + 1)."""
    rows = []
    for i in range(degree + 1):
        row = np.eye(degree + 1, 1)
        for x in np.repeat(ends, [degree - i, i]):
            row = _times(row, x, 0.0)
        rows.append(row[:, 0])
    return np.array(rows)


def _times(product: Array, x: float, y: float) -> Array:
    """Coefficients, by powers of X and Y, times ``x X + y Y + (1 - x - y)``."""
    found = (1 - x - y) * product
    found[1:] += x * product[:-1]
    found[:, 1:] += y * product[:, :-1]
    return np.asarray(found)


def strips(spline: Spline, across: Array) -> Array:
    """Bernstein coefficients (n, size, size) of strips from control points.

    `across` (n, degree + 1, degree + 1) are the splines across them, as in `StripTables.pieces`.
    """
    controls, powers = _lines(spline, numbers.type_of(across).exact)
    return _tensor(controls, powers @ across)


def centers(spline: Spline, pieces: Array) -> Array:
    """Bernstein coefficients (2, 2, size, 16) of the pieces of quads, by piece along t and along s.

    `pieces` (2, degree + 1, 4) are as in `StripTables.pieces`.
    """
    _, powers = _lines(spline, numbers.type_of(pieces).exact)
    lines = powers @ pieces
    return _tensor(lines, lines[:, None])


def turned_cells(lattice: Lattice, origin: Array, size: Array, turn: Array) -> tuple[Array, Array]:
    """Where cells of patches lie in the domain: origins and signed sizes, (P, c, 2).

    `turn` (P,) is the corner of the domain at which each patch has its corner 0; `origin` and
    `size` are those in the patch. The corner at a cell's origin is another one then.
    """
    if not turn.any():
        return origin, size
    origin, size = origin.copy(), size.copy()
    corners, n = np.array(lattice.corners), lattice.face_size
    for k, (base, along, across) in enumerate(lattice.turns):
        here = np.flatnonzero(turn == k)
        if k and len(here):
            # those that become corner 0 and its neighbours
            near = corners[(np.array([0, 1, -1]) - k) % n]
            near = origin[here, :, None] + size[here, :, None] * near
            near = base + near @ np.array([along, across])  # (p, c, 3, 2)
            origin[here] = near[:, :, 0]
            ends = near[:, :, [1, 2], [0, 1]]
            size[here] = ends - near[:, :, 0]
    return origin, size


@lru_cache(maxsize=64)
def _lines(spline: Spline, exact: bool) -> tuple[Array, Array]:
    """Bernstein coefficients of a curve from its control points and from powers, (d + 1, d + 1)."""
    curve = np.array(spline.curve)
    degree = len(curve) - 1
    line = np.stack([np.arange(degree + 1), np.zeros(degree + 1, dtype=np.int64)], axis=1)
    powers = _powers(line, lambda i, j: perm(degree, i))
    controls = powers @ curve
    return (controls, powers) if exact else (controls.astype(float), powers.astype(float))


def _powers(exponents: Array, most: Callable[[int, int], int]) -> Array:
    """Coefficients (n, n) of the powers of these exponents, exact.

    Those of ``s^i t^j`` are products of i and j factors, which fall by one from the exponents of
    the coefficient on; `most` is the product at the corner where they are 1.
    """
    both = exponents.tolist()
    return np.array(
        [[Fraction(perm(k, i) * perm(m, j), most(i, j)) for i, j in both] for k, m in both]
    )


def _tensor(along: Array, across: Array) -> Array:
    """Coefficients by i and j, in C order, from values of which the first index counts fastest."""
    both = along[..., :, None, None, :] * across[..., None, :, :, None]
    return np.asarray(both.reshape(*both.shape[:-4], along.shape[-2] ** 2, along.shape[-1] ** 2))


def _turns(lattice: Lattice, exponents: Array, degree: int) -> Array:
    """Which coefficient of a patch with corner 0 at corner k lies where one of the domain does."""
    number = {place: k for k, place in enumerate(map(tuple, exponents.tolist()))}
    sides = [a * degree + exponents @ (b, c) for a, b, c in lattice.sides]
    seen = zip(sides, [*sides[1:], sides[0]], strict=True)  # s and t from each corner
    return np.array([[number[s, t] for s, t in zip(*map(list, st), strict=True)] for st in seen])
