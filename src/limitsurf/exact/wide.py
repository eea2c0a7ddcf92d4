"""Left eigenvectors around special corners of many faces, in closed form.

With the weights ``c`` of a corner in a face point, ``a`` and ``b`` of an end and of a face point in
an edge point, and ``n`` and ``m`` of an edge neighbour and of a new face point in a vertex point,
a left eigenvector (x at the vertex, y_j at the edges, z_j at the faces) of eigenvalue l obeys

    l z_j = c t_j,    l y_j = a y_j + c (t_(j-1) + t_j) + n x,
    t_j = z_j + b (y_j + y_(j+1)) + m x

where edges are smooth. Where faces have no points, b is the weight of an opposite corner, and

    l y_j = a y_j + b (y_(j-1) + y_(j+1)) + n x .

Without the z_j and t_j both are a recurrence of second order with constant coefficients for the
y_j: waves, and at a dart, whose sharp edge y_0 takes nothing from what lies across it, a sum of two
that vanishes on both of its sides. Derived in ``derivations/wide_rings.py``.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.scheme.scheme import Scheme

Array = NDArray[Any]

# Special corners of more faces have no eigen tables, their rings are refined: tables of all
# positions, and copies of the ring in all patches, cost the square of this number. What compiled
# kernels keep of a patch ends here too.
MOST_FACES = 64

_SAMPLES = 24  # of angles from which waves are sought that are slower than one around
_SAME = 1e-9  # of eigenvalues in float64, against differences that decide nothing


@dataclass(frozen=True)
class Weights:
    """Weights of the masks at and around a special corner, exact or float64.

    Attributes
    ----------
    corner
        Of each corner in a face point; 0 if there is none.
    end, face
        Of each end, and of each face point or else opposite corner, in an edge point.
    half
        Of each end in the point of a sharp edge.
    own, edge, around
        Of the vertex itself, its edge neighbours and the new face points, if it is smooth; the last
        is 0 if there is none.
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
        half, beside, none = scheme.boundary_edge, scheme.boundary_vertex[1], Fraction(0)
        corner, *_ = *scheme.face_mask(scheme.lattice.face_size), none
        own, edge, around, *_ = *scheme.vertex_mask(faces), none
        masks = corner, *scheme.regular_edge, half, own, edge, around, beside
        return cls(*(masks if exact else map(float, masks)))

    def centre(self, faces: int) -> list[list[Any]]:
        """The block of frequency 0 of a smooth vertex on (vertex, edges, faces if they count)."""
        c, a, b = self.corner, self.end, self.face
        if not c:
            return [[self.own, faces * self.edge], [a, a + 2 * b]]
        share = faces * self.around * c
        return [
            [self.own + share, faces * self.edge + 2 * share, share],
            [a + 2 * b * c, a + 4 * b * c, 2 * b * c],
            [c, 2 * c, c],
        ]


def dart_limit(scheme: Scheme, faces: int) -> list[Any]:
    """Exact weights of the points of a dart's ring in the limit of its vertex, (ring,)."""
    w = Weights.of(scheme, faces, exact=True)
    p, g, k = _recurrence(w, Fraction(1))
    scale = k / g / (p - 2)
    near = _fading(p, faces)
    y = [scale * (1 - x) for x in near]  # 0 and `faces` are the sharp edge
    if not w.corner:
        y[0] = (w.face * (y[1] + y[-2]) + w.edge) / (1 - w.half)
        mask = [Fraction(1), *y[:faces]]
    else:
        t = [(w.face * (y[j] + y[j + 1]) + w.around) / (1 - w.corner) for j in range(faces)]
        y[0] = (w.corner * (t[-1] + t[0]) + w.edge) / (1 - w.half)
        mask = [Fraction(1)]
        for j in range(faces):
            mask += [y[j], w.corner * t[j]]
    total = sum(mask)
    return [x / total for x in mask]


def _fading(p: Fraction, faces: int) -> list[Fraction]:
    """Solution of ``x_(j-1) + x_(j+1) = p x_j`` that is 1 at both sides of the sharp edge."""
    # solutions 0 and 1 there: sines of an imaginary argument
    sines = [Fraction(0), Fraction(1)]
    for _ in range(faces - 1):
        sines.append(p * sines[-1] - sines[-2])
    return [(x + y) / sines[-1] for x, y in zip(sines, sines[::-1], strict=True)]


def _recurrence(w: Weights, value: Any) -> tuple[Any, Any, Any]:
    """P, g and k in ``p y_j - y_(j-1) - y_(j+1) = k / g x``."""
    if not w.corner:
        return (value - w.end) / w.face, w.face, w.edge
    rest = 1 - w.corner / value
    g, k = w.corner * w.face / rest, w.edge + 2 * w.corner * w.around / rest
    return (value - w.end - 2 * g) / g, g, k


def rounded_dart_limit(scheme: Scheme, faces: int) -> tuple[Array, Array]:
    """Weights of edge neighbours and of face corners, if any, in the limit of a dart's vertex.

    Those of `dart_limit` in float64, to some ulp, at a cost that hardly grows with the faces.
    """
    w = Weights.of(scheme, faces)
    p, g, k = _recurrence(w, 1.0)
    root = 2 / (p + np.sqrt(p * p - 4))
    j = np.arange(faces + 1)
    with np.errstate(under="ignore"):
        near = (root**j + root ** (faces - j)) / (1 + root**faces)
    x, y, z = _dart_vector(w, 1.0, k / g / (p - 2) * (1 - near), 1.0)
    total = x + y.sum() + z.sum()
    return y / total, z / total


def _dart_vector(w: Weights, value: float, y: Array, x: float) -> tuple[float, Array, Array]:
    """Vertex, edges (n,) and faces (n or 0,) of a left vector.

    From y (n + 1,), whose first and last are of the sharp edge, and ignored.
    """
    y = y.copy()
    y[0] = y[-1] = 0
    if not w.corner:
        y[0] = (w.face * (y[1] + y[-2]) + w.edge * x) / (value - w.half)
        return x, y[:-1], y[:0]
    t = (w.face * (y[:-1] + y[1:]) + w.around * x) / (1 - w.corner / value)
    y[0] = (w.corner * (t[-1] + t[0]) + w.edge * x) / (value - w.half)
    return x, y[:-1], w.corner / value * t


def slowest_waves(scheme: Scheme, kind: str, faces: int) -> tuple[Array, Array]:
    """Left eigenvectors of the eigenvalues below 1 that are largest: (n, edges) and (n, faces).

    Where faces have no corners beyond the edges, (n, edges) and (n, 0).
    Their scale is some positive number. At a smooth vertex the cosine and the sine that go around
    once, counted from edge 0; at a dart the even and the odd one; at a cone the one that is the
    same all around, and in a sector the sine that vanishes at its ends. At a smooth vertex and a
    dart where these are not the slowest ones there are none.
    """
    w = Weights.of(scheme, faces)
    corners = np.arange(faces if w.corner else 0)
    if kind == "cone":
        _, face = _wave(w, 1.0)
        return np.ones((1, faces)), np.full((1, len(corners)), face)
    if kind in ("crease", "corner"):
        angle = np.pi / (2 * faces)  # half of that of a face
        value, face = _wave(w, np.cos(angle))
        edges, around = _sines(2 * np.arange(faces + 1), faces), _sines(1 + 2 * corners, faces)
        _set_ends(w, kind, value, edges, face * around)
        return edges[None], face * around[None]
    value, face = _wave(w, np.cos(np.pi / faces))
    sines = _sines(4 * np.arange(faces), faces), face * _sines(2 + 4 * corners, faces)
    if kind == "interior":
        if _largest(w.centre(faces)) >= value:
            return np.zeros((0, faces)), np.zeros((0, len(corners)))
        cosines = _cosines(4 * np.arange(faces), faces), face * _cosines(2 + 4 * corners, faces)
    else:
        even = _slowest_even(w, faces)
        if even is None:
            return np.zeros((0, faces)), np.zeros((0, len(corners)))
        cosines = even
    both = zip(cosines, sines, strict=True)
    edges, around = (np.stack(pair) for pair in both)
    return edges, around


def _set_ends(w: Weights, kind: str, value: float, edges: Array, around: Array) -> None:
    """Fill in both ends of the symmetric left eigenvector of a sector; they are 0 before."""
    across = around * value if w.corner else w.face * edges[1:]  # of the edge points beside it
    end = across[0]
    if kind == "crease":
        # (value - half) y = end + beside x,  (value - own) x = rest + 2 half y
        rest = w.end * edges.sum() + (across.sum() if w.corner else 0)
        own = value - (1 - 2 * w.beside)
        end = end * own + w.beside * rest
        edges[[0, -1]] = end / (own * (value - w.half) - 2 * w.half * w.beside)
    else:
        edges[[0, -1]] = end / (value - w.half)


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
    if not w.corner:
        return w.end + w.face * (4 * s * s - 2), 0.0
    ee, ef = w.end + 4 * w.face * w.corner * s * s, 2 * w.face * w.corner * s
    fe, ff = 2 * w.corner * s, w.corner
    value = (ee + ff + np.sqrt((ee - ff) ** 2 + 4 * ef * fe)) / 2
    return value, (value - ee) / fe


def _largest(block: list[list[float]]) -> float:
    """The largest modulus of the eigenvalues other than 1."""
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
        _, g, k = _recurrence(w, value)
        x = np.cos(faces / 2 * angle)
        # by (p - 2) g, where p = 2 cos(angle)
        scale = k / (-4 * g * np.sin(angle / 2) ** 2)
        return value, *_dart_vector(w, value, scale * (x - np.cos(offset * angle)), x)

    def residual(angle: float) -> float:
        value, x, y, z = vector(angle)
        rest = (value * z).sum() + w.end * y[1:].sum() + w.half * y[0] + w.own * x
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
    along = y @ _cosines(4 * np.arange(faces), faces)
    along += z @ _cosines(2 + 4 * np.arange(len(z)), faces)
    return y / along, z / along


def dart_factor(w: Weights, faces: int, value: Any, root: Any) -> Any:
    """``1 + r (l - B)^-1 1`` of a dart, in whatever numbers, of which `root` is the root.

    r are the weights of the ring in the vertex point, B is the matrix of the ring while the vertex
    stays.
    """
    p, g, _ = _recurrence(w, value)
    rest = value - w.corner
    # constant, but for what the sharp edge adds on either side
    constant = (1 + 2 * w.corner * w.face / rest) / (g * (p - 2))
    fall = _fall(p, root)
    spread = (1 + fall) / (1 - fall) * (1 - fall**faces) / (1 + fall**faces)
    edges = faces * constant + (1 / (value - w.half) - constant) * spread
    if not w.corner:
        return 1 + w.edge * edges
    around = (faces + 2 * w.corner * edges) / rest
    return 1 + (w.edge + 2 * w.around * w.corner) * edges + w.around * w.corner * around


def wide_dart_values(w: Weights, faces: int) -> Array:
    """Zeros of `dart_factor`, in float64, as if the sides of the sharp edge were far apart.

    Away from the eigenvalues of waves, where what one side adds has vanished on the other; there
    the factor is X + Y root(p + 2) / root(p - 2), with rational X and Y.
    """
    x = np.polynomial.Polynomial([0, 1])
    c, b, m, half = float(w.corner), float(w.face), float(w.around), x - float(w.half)
    # multiples of p - 2 and p + 2; of X and Y, times `half`
    if c:
        rest = x - c
        high, unit = (x - float(w.end)) * rest, c * b * x
        low = high - 4 * unit
        seen = (float(w.edge) + 2 * m * c) * rest + 2 * m * c * c
        raised = rest + 2 * b * c
        even = (rest * low + faces * (seen * raised + m * c * low)) * half
        jump = seen * (low - half * raised)
    else:
        high, unit, low = x - float(w.end) + 2 * b, b * x**0, x - float(w.end) - 2 * b
        even = (low + faces * float(w.edge)) * half
        jump = float(w.edge) * (low - half)
    found: Any = (even**2 * low - jump**2 * high).roots().astype(complex)
    # squaring adds the zeros of X - Y root(p + 2) / root(p - 2)
    fall = _fall(high(found) / unit(found) - 2, np.sqrt)
    left, right = even(found), jump(found) * (1 + fall) / (1 - fall)
    return np.asarray(found[np.abs(left + right) < np.abs(left - right)])


def _fall(p: Any, root: Any) -> Any:
    """The solution of modulus below 1 of ``x + 1 / x = p``."""
    one = (p - root(p * p - 4)) / 2
    return np.where(np.abs(one) < 1, one, 1 / one)[()]
