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
from math import comb
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.exact.fixed import EQUAL, diverging, mp, to_mpf
from limitsurf.exact.matrices import subdivision_matrix
from limitsurf.exact.ring import centre_mask
from limitsurf.exact.sectors import folded, mirrored
from limitsurf.exact.wide import Weights, dart_factor, wide_dart_values
from limitsurf.scheme.scheme import Scheme
from limitsurf.scheme.sector import Sector

Array = NDArray[Any]

_FLOAT = 1e-6  # eigenvalues in float64 are right to this, if there are no worse than double ones
_MOST_DENSE = 64  # faces of darts whose matrix is solved as it is
_STEPS = 30  # of a secant, which converges in ten but at double zeros
_HALVINGS = 12  # of a piece on which the sign of a minor is sought
# of a polynomial of degree 5: ten times the Bernstein coefficients from those of powers
_BERNSTEIN = np.array(
    [[10 * comb(i, k) // comb(5, k) for k in range(6)] for i in range(6)], dtype=object
)
# 32 times the Bernstein coefficients on either half
_HALVES = [
    np.array([[comb(i, k) << (5 - i) if k <= i else 0 for k in range(6)] for i in range(6)], object)
]
_HALVES.append(_HALVES[0][::-1, ::-1])


# --- limits ---------------------------------------------------------------------------------------


def check_convergence(scheme: Scheme, kind: str, faces: int) -> None:
    """Raise `UnsupportedSpectrum` where the masks around a special corner have no limit."""
    if not scheme.lattice.face_points:  # their whole spectrum is looked at
        return
    if kind == "interior":
        centre_mask(faces, Weights.of(scheme, faces, exact=True).centre(faces))
    elif kind == "dart":
        value = _dart_excess(scheme, Weights.of(scheme, faces, exact=True), faces)
        if value is not None:
            raise diverging(Sector(kind, faces).place, faces, value)


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
    if faces > _MOST_DENSE:
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


def orientation(functions: Array, closed: bool, turns: int) -> int:
    """The sign of the minor of two eigenfunctions that are regular around a vertex, else 0.

    Parameters
    ----------
    functions : (F, 3, 16, 2 or 4) of int
        Power coefficients ``4 j + i`` on the pieces of faces; if there are four, the last
        two are those of the modes themselves, of which the first two have the ends of chains.
    closed : whether the faces surround the vertex
    turns : how many faces are like each of these
    """
    net = minor(functions[..., 0], functions[..., 1])
    middle = net[0, 1].sum()
    sign = (middle > 0) - (middle < 0)
    net = sign * net
    noise = int(mp.mpf(int(np.abs(net).max())) * EQUAL)
    net[np.abs(net) <= noise] = 0
    second = sign * minor(functions[..., 2], functions[..., 3]) if functions.shape[-1] > 2 else None
    for face, piece in np.ndindex(net.shape[:2]):
        here = net[face, piece]
        beside = second is not None and _beside_zero(here, second[face, piece], noise)
        if not beside and not _positive(here, noise, _HALVINGS):
            return 0
    return sign if not closed or abs(_angle(functions) * turns - sign) < 0.25 else 0


def minor(f: Array, g: Array) -> Array:
    """Bernstein coefficients of ``f_S g_T - f_T g_S``, times 100: (..., 6, 6) from (..., 16)."""
    f, g = (x.reshape(*x.shape[:-1], 4, 4) for x in (f, g))
    power = np.zeros((*f.shape[:-2], 6, 6), dtype=f.dtype)
    for a in range(4):
        for b in range(4):
            for c in range(4):
                for d in range(4):
                    # S^b T^a and S^d T^c
                    weight = b * c - a * d
                    if weight:
                        power[..., a + c - 1, b + d - 1] += weight * f[..., a, b] * g[..., c, d]
    change = _BERNSTEIN.astype(f.dtype)
    return np.asarray(change @ power @ change.T)


def _positive(net: Array, noise: int, halvings: int) -> bool:
    """Whether a polynomial is positive on a piece, from its Bernstein coefficients (6, 6)."""
    if (net > noise).all():
        return True
    if halvings == 0 or (net[[0, 0, -1, -1], [0, -1, 0, -1]] <= noise).any():
        return False
    return all(
        _positive(across @ net @ along.T, noise << 10, halvings - 1)
        for across in _HALVES
        for along in _HALVES
    )


def _beside_zero(net: Array, head: Array, noise: int) -> bool:
    """Whether a minor is positive but on sides, where it is zero and the lesser one positive."""
    inside = np.ones((6, 6), dtype=bool)
    for side in (np.s_[0], np.s_[-1], np.s_[:, 0], np.s_[:, -1]):
        if not net[side].any():
            inside[side] = False
    return bool((net[inside] > noise).all() and (inside.all() or (head > noise).all()))


def _angle(functions: Array) -> float:
    """The angle that two functions sweep on faces from side to side, in whole turns."""
    powers = [(1, 0), (1, 1), (0, 1)]  # S and T at the far corners of the three pieces
    weights = np.array([[S**i * T**j for j in range(4) for i in range(4)] for S, T in powers])
    size = int(np.abs(functions).max())
    parts = (functions[..., :2] / size).astype(float)
    x, y = np.einsum("pc,fpcd->dfp", weights, parts)
    place = x + 1j * y  # (F, 3)
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = np.angle(place[:, 1:] / place[:, :-1])
    return float(turn.sum() / (2 * np.pi))  # NaN where both are 0
