"""Left eigenvectors around special corners of many faces, in closed form.

With the weights ``c`` of a corner in a face point, ``a`` and ``b`` of an end and of a face point in
an edge point, and ``n`` and ``m`` of an edge neighbour and of a new face point in a vertex point,
a left eigenvector (x at the vertex, y_j at the edges, z_j at the faces) of eigenvalue l obeys

    l z_j = c t_j,    l y_j = a y_j + c (t_(j-1) + t_j) + n x,
    t_j = z_j + b (y_j + y_(j+1)) + m x

where edges are smooth. Without the z_j and t_j that is a recurrence of second order with constant
coefficients for the y_j: waves, and at a dart, whose sharp edge y_0 takes nothing from faces, a sum
of two that vanishes on both of its sides. Derived in ``derivations/wide_rings.py``.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.scheme.scheme import Scheme

Array = NDArray[Any]

_SAMPLES = 24  # of angles from which waves are sought that are slower than one around
_SAME = 1e-9  # of eigenvalues in float64, against differences that decide nothing


@dataclass(frozen=True)
class Weights:
    """Weights of the masks at and around a special corner, exact or float64.

    Attributes
    ----------
    corner
        Of each corner in a face point.
    end, face
        Of each end, and of each face point, in an edge point.
    half
        Of each end in the point of a sharp edge.
    own, edge, around
        Of the vertex itself, its edge neighbours and the new face points, if it is smooth.
    beside
        Of each neighbour along a sharp curve.
    """

    corner: Any
    end: Any
    face: Any
    half: Any
    own: Any
    edge: Any
    around: Any
    beside: Any

    @classmethod
    def of(cls, scheme: Scheme, faces: int, exact: bool = False) -> Weights:
        """Those of a scheme, at a vertex amid so many faces."""
        half, beside = scheme.boundary_edge, scheme.boundary_vertex[1]
        (corner, *_), vertex = scheme.face_mask(4), scheme.vertex_mask(faces)
        masks = corner, *scheme.regular_edge, half, *vertex, beside
        return cls(*(masks if exact else map(float, masks)))

    def centre(self, faces: int) -> list[list[Any]]:
        """The 3 x 3 block of frequency 0 of a smooth vertex on (vertex, edges, faces)."""
        c, a, b = self.corner, self.end, self.face
        share = faces * self.around * c
        return [
            [self.own + share, faces * self.edge + 2 * share, share],
            [a + 2 * b * c, a + 4 * b * c, 2 * b * c],
            [c, 2 * c, c],
        ]


def dart_limit(scheme: Scheme, faces: int) -> list[Any]:
    """Exact weights of the points of a dart's ring in the limit of its vertex, (ring,)."""
    if not scheme.lattice.face_points:
        return _triangular_dart_limit(scheme, faces)
    w = Weights.of(scheme, faces, exact=True)
    g, k = _recurrence(w, Fraction(1))
    p = (1 - w.end - 2 * g) / g
    near = _fading(p, faces)
    y = [k / g / (p - 2) * (1 - x) for x in near]  # 0 and `faces` are the sharp edge
    t = [(w.face * (y[j] + y[j + 1]) + w.around) / (1 - w.corner) for j in range(faces)]
    y[0] = (w.corner * (t[-1] + t[0]) + w.edge) / (1 - w.half)
    mask = [Fraction(1)]
    for j in range(faces):
        mask += [y[j], w.corner * t[j]]
    total = sum(mask)
    return [x / total for x in mask]


def _triangular_dart_limit(scheme: Scheme, faces: int) -> list[Any]:
    """Weights of the points of a dart's ring where edges alone make the recurrence, (ring,).

    It is ``y_j = a y_j + b (y_(j-1) + y_(j+1)) + n x``, with the weight b of an opposite corner in
    an edge point.
    """
    (end, across), (_, edge) = scheme.regular_edge, scheme.vertex_mask(faces)
    p = (1 - end) / across
    y = [(1 - x) / (p - 2) / across for x in _fading(p, faces)]  # of n = 1
    y[0] = (across * (y[1] + y[faces - 1]) + 1) / (1 - scheme.boundary_edge)
    mask = [Fraction(1), *(edge * x for x in y[:faces])]
    total = 1 + edge * sum(y[:faces])
    return [x / total for x in mask]


def _fading(p: Fraction, faces: int) -> list[Fraction]:
    """Solution of ``x_(j-1) + x_(j+1) = p x_j`` that is 1 at both sides of the sharp edge."""
    # solutions 0 and 1 there: sines of an imaginary argument
    sines = [Fraction(0), Fraction(1)]
    for _ in range(faces - 1):
        sines.append(p * sines[-1] - sines[-2])
    return [(x + y) / sines[-1] for x, y in zip(sines, sines[::-1], strict=True)]


def _recurrence(w: Weights, value: Any) -> tuple[Any, Any]:
    """G and k in ``(value - a - 2 g) y_j - g (y_(j-1) + y_(j+1)) = k x``."""
    rest = 1 - w.corner / value
    return w.corner * w.face / rest, w.edge + 2 * w.corner * w.around / rest


def rounded_dart_limit(scheme: Scheme, faces: int) -> tuple[Array, Array]:
    """The same in float64, to some ulp: weights of the edge neighbours and face corners."""
    w = Weights.of(scheme, faces)
    g, k = _recurrence(w, 1.0)
    p = (1 - w.end - 2 * g) / g
    root = 2 / (p + np.sqrt(p * p - 4))
    j = np.arange(faces + 1)
    with np.errstate(under="ignore"):
        near = (root**j + root ** (faces - j)) / (1 + root**faces)
    x, y, z = _dart_vector(w, 1.0, k / g / (p - 2) * (1 - near), 1.0)
    total = x + y.sum() + z.sum()
    return y / total, z / total


def _dart_vector(w: Weights, value: float, y: Array, x: float) -> tuple[float, Array, Array]:
    """Vertex, edges (n,) and faces (n,) of a left vector; from y (n + 1,), 0 at the sharp edge."""
    y = y.copy()
    y[0] = y[-1] = 0
    t = (w.face * (y[:-1] + y[1:]) + w.around * x) / (1 - w.corner / value)
    y[0] = (w.corner * (t[-1] + t[0]) + w.edge * x) / (value - w.half)
    return x, y[:-1], w.corner / value * t


def slowest_waves(scheme: Scheme, kind: str, faces: int) -> tuple[Array, Array]:
    """Left eigenvectors of the eigenvalues below 1 that are largest: (n, edges) and (n, faces).

    Their scale is some positive number. At a smooth vertex the cosine and the sine that go around
    once, counted from edge 0; at a dart the even and the odd one; at a cone the one that is the
    same all around, and in a sector the sine that vanishes at its ends. At a smooth vertex and a
    dart where these are not the slowest ones there are none.
    """
    w = Weights.of(scheme, faces)
    if kind == "cone":
        value, face = _wave(w, 1.0)
        return np.ones((1, faces)), np.full((1, faces), face)
    if kind in ("crease", "corner"):
        angle = np.pi / (2 * faces)  # half of that of a face
        value, face = _wave(w, np.cos(angle))
        edges, around = _sines(2 * np.arange(faces + 1), faces), _sines(_odd(faces), faces)
        _set_ends(w, kind, value, edges, face * around)
        return edges[None], face * around[None]
    value, face = _wave(w, np.cos(np.pi / faces))
    sines = _sines(4 * np.arange(faces), faces), face * _sines(2 * _odd(faces), faces)
    if kind == "interior":
        if _largest(w.centre(faces)) >= value:
            return np.zeros((0, faces)), np.zeros((0, faces))
        cosines = _cosines(4 * np.arange(faces), faces), face * _cosines(2 * _odd(faces), faces)
    else:
        even = _slowest_even(w, faces)
        if even is None:
            return np.zeros((0, faces)), np.zeros((0, faces))
        cosines = even
    both = zip(cosines, sines, strict=True)
    edges, around = (np.stack(pair) for pair in both)
    return edges, around


def _set_ends(w: Weights, kind: str, value: float, edges: Array, around: Array) -> None:
    """Fill in both ends of the symmetric left eigenvector of a sector; they are 0 before."""
    t = around * value / w.corner
    end = w.corner * t[0]
    if kind == "crease":
        # (value - half) y = end + beside x,  (value - own) x = rest + 2 half y
        rest = w.corner * t.sum() + w.end * edges.sum()
        own = value - (1 - 2 * w.beside)
        end = end * own + w.beside * rest
        edges[[0, -1]] = end / (own * (value - w.half) - 2 * w.half * w.beside)
    else:
        edges[[0, -1]] = end / (value - w.half)


def _odd(faces: int) -> Array:
    return 1 + 2 * np.arange(faces)


def _sines(quarter: Array, faces: int) -> Array:
    """Sines of pi / 2 / faces times integers."""
    return _cosines(quarter - faces, faces)


def _cosines(quarter: Array, faces: int) -> Array:
    """Cosines of pi / 2 / faces times integers, exactly 0 and symmetric where they should be."""
    turn = np.abs(quarter) % (4 * faces)
    turn = np.minimum(turn, 4 * faces - turn)  # in [0, pi]
    below = np.minimum(turn, 2 * faces - turn)  # in [-pi / 2, pi / 2]: up to pi / 2
    size = np.where(
        2 * below > faces,
        np.sin(np.pi / 2 * ((faces - below) / faces)),
        np.cos(np.pi / 2 * (below / faces)),
    )
    return np.asarray(np.where(turn > faces, -size, size))


def _wave(w: Weights, s: float) -> tuple[float, float]:
    """The larger eigenvalue of waves with that cosine of half the angle of a face.

    Also the amplitude of its left eigenvector at the faces, that at the edges being 1.
    """
    ee, ef = w.end + 4 * w.face * w.corner * s * s, 2 * w.face * w.corner * s
    fe, ff = 2 * w.corner * s, w.corner
    value = (ee + ff + np.sqrt((ee - ff) ** 2 + 4 * ef * fe)) / 2
    return value, (value - ee) / fe


def _largest(block: list[list[float]]) -> float:
    """The larger modulus of the two eigenvalues other than 1."""
    values = np.linalg.eigvals(np.array(block))
    return float(np.sort(np.abs(np.delete(values, np.abs(values - 1).argmin())))[-1])


def _slowest_even(w: Weights, faces: int) -> tuple[Array, Array] | None:
    """The slowest left eigenvector of a dart that is even about its sharp edge: edges, faces.

    None if it is not that wave alone that goes around about once: masks can add one that goes
    around less, or eigenvalues of no wave that are as large as its own.
    """
    from scipy.optimize import brentq

    offset = np.arange(faces + 1) - faces / 2

    def vector(angle: float) -> tuple[float, float, Array, Array]:
        # scaled by a cosine that can be 0
        value, _ = _wave(w, np.cos(angle / 2))
        g, k = _recurrence(w, value)
        x = np.cos(faces / 2 * angle)
        # (p - 2) g, where p g = value - a - 2 g and p = 2 cos(angle)
        scale = k / (-4 * g * np.sin(angle / 2) ** 2)
        return value, *_dart_vector(w, value, scale * (x - np.cos(offset * angle)), x)

    def residual(angle: float) -> float:
        value, x, y, z = vector(angle)
        t = value / w.corner * z
        rest = w.corner * t.sum() + w.end * y[1:].sum() + w.half * y[0] + w.own * x
        return float(value * x - rest)

    angles = np.linspace(0, 3 * np.pi / faces, _SAMPLES + 1)[1:]
    signs = np.sign([residual(angle) for angle in angles])
    changes = np.flatnonzero(signs[1:] != signs[:-1])
    turn = int(changes[0] + 1) * 3 // _SAMPLES if len(changes) == 1 else 0  # in units of pi
    if turn == 0:
        return None
    least, most = turn * np.pi / faces, (turn + 1) * np.pi / faces
    angle = brentq(residual, least, most, xtol=1e-300, rtol=8 * np.finfo(float).eps)
    slowest = _wave(w, np.cos(max(angle / 2, np.pi / faces)))[0]
    # positive ones beyond all waves change the sign of what is 1 at infinity
    band = _wave(w, 1.0)[0]
    beyond = band + (1 - band) * 0.5 ** np.arange(1, _SAMPLES)
    if min(dart_factor(w, faces, x, np.sqrt) for x in beyond) <= 0:
        return None
    others = wide_dart_values(w, faces)
    others = others[(np.abs(others.imag) > _SAME) | (others.real < 0)]
    if (np.abs(others) > slowest - _SAME).any():
        return None
    _, _, y, z = vector(angle)
    # positive for a flat ring with the sharp edge along x
    along = y @ _cosines(4 * np.arange(faces), faces) + z @ _cosines(2 * _odd(faces), faces)
    return y / along, z / along


def dart_factor(w: Weights, faces: int, value: Any, root: Any) -> Any:
    """``1 + r (l - B)^-1 1`` of a dart, in whatever numbers, of which `root` is the root.

    r are the weights of the ring in the vertex point, B is the matrix of the ring while the vertex
    stays.
    """
    rest = value - w.corner
    g = value * w.corner * w.face / rest
    p = (value - w.end) / g - 2
    # constant, but for what the sharp edge adds on either side
    constant = (1 + 2 * w.corner * w.face / rest) / (g * (p - 2))
    fall = _fall(p, root)
    spread = (1 + fall) / (1 - fall) * (1 - fall**faces) / (1 + fall**faces)
    edges = faces * constant + (1 / (value - w.half) - constant) * spread
    around = (faces + 2 * w.corner * edges) / rest
    return 1 + (w.edge + 2 * w.around * w.corner) * edges + w.around * w.corner * around


def wide_dart_values(w: Weights, faces: int) -> Array:
    """Zeros of `dart_factor`, in float64, as if the sides of the sharp edge were far apart.

    Away from the eigenvalues of waves, where what one side adds has vanished on the other; there
    the factor is X + Y root(p + 2) / root(p - 2), with rational X and Y.
    """
    x = np.polynomial.Polynomial([0, 1])
    c, b, m = float(w.corner), float(w.face), float(w.around)
    rest = x - c
    low = (x - float(w.end)) * rest - 4 * c * b * x  # (p - 2) l b c
    seen = (float(w.edge) + 2 * m * c) * rest + 2 * m * c * c
    raised = rest + 2 * b * c
    even = rest * low + faces * (seen * raised + m * c * low)
    jump = seen * (low - (x - float(w.half)) * raised)
    both = even**2 * (x - float(w.half)) ** 2 * low - jump**2 * (x - float(w.end)) * rest
    found: Any = both.roots().astype(complex)
    # squaring adds the zeros of X - Y root(p + 2) / root(p - 2)
    fall = _fall((found - float(w.end)) * rest(found) / (c * b * found) - 2, np.sqrt)
    left = even(found) * (found - float(w.half))
    right = jump(found) * (1 + fall) / (1 - fall)
    return np.asarray(found[np.abs(left + right) < np.abs(left - right)])


def _fall(p: Any, root: Any) -> Any:
    """The solution of modulus below 1 of ``x + 1 / x = p``."""
    one = (p - root(p * p - 4)) / 2
    return np.where(np.abs(one) < 1, one, 1 / one)[()]
