"""How many rings a rule needs around a special corner, and what their tail is.

The integral over ring n is a sum of powers ``c r^n`` of known ratios r. Rings from R on are
replaced by a combination of the K before them that is exact for K ratios: weights v_j with ``sum of
v_j r^j = r^K / (1 - r)``, Richardson's elimination (``derivations/integrals.py``).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from limitsurf.tables import EigenTable

Array = NDArray[Any]
Kind: TypeAlias = Literal["polynomial", "metric", "curvature"]

KINDS: tuple[Kind, ...] = get_args(Kind)
_MOST = 100  # rings
# of integrals that are infinite: further in, second derivatives of constants, which are rounding,
# grow by 4 from ring to ring, and other corners than (0, 0) cannot be told from places near them
_ENDLESS = 40
_ELIMINATED = 4
_APART = 0.97  # of two ratios that are eliminated, the quotient at most
_LEADING = 12  # eigenvalues of which products are ratios
_SMALL = 1e-5  # such ratios are gone after three rings
_EPS = np.finfo(float).eps


@dataclass(frozen=True, eq=False)
class Tail:
    """Factors (R,) of the weights in rings 0 to R - 1, and the relative error that is left."""

    factors: Array
    accuracy: float


@lru_cache(maxsize=1024)
def tail(table: EigenTable, integrand: Kind, rtol: float) -> Tail:
    """That with the fewest rings around a special corner."""
    r = ratios(table, integrand)
    if r[0] >= 1:  # the integral is infinite, or decays slower than any power
        return Tail(np.ones(_ENDLESS), np.inf)
    best = Tail(np.ones(_MOST), float(r[0] ** _MOST))
    for k in range(_ELIMINATED + 1):
        found = _with(r, k, rtol)
        if found is not None and (
            len(found.factors) < len(best.factors) or best.accuracy > max(rtol, found.accuracy)
        ):
            best = found
    return best


def ratios(table: EigenTable, integrand: Kind) -> Array:
    """Ratios of integrals over rings, of general points, falling.

    With eigenvalues a and b, the largest after 1, normals consist of products of two, the metric of
    ``a b`` times powers of those over ``a b``, times products of two functions, which are of 1 and
    all eigenvalues; mass and stiffness in the parameters are of products too, or of a fourth of
    them. Second derivatives on the surface are ``m / b^2`` for all others m.
    """
    moduli = np.abs(table.rates[0, 1 : 1 + _LEADING])
    a, b = moduli[:2]
    pair = np.multiply.outer(moduli, moduli)
    normals = pair[np.triu_indices(len(moduli), 1)]
    if integrand == "polynomial":
        one = np.concatenate([[1.0], moduli])
        mass, volume = np.multiply.outer(one, one).ravel() / 4, np.multiply.outer(normals, one)
        found = np.concatenate([pair.ravel(), mass, volume.ravel()])
    else:
        more = np.concatenate([[1.0], normals[normals < a * b * (1 - 1e-9)] / (a * b)])
        products = np.multiply.outer(np.multiply.outer(more, more).ravel(), more).ravel()
        lead = np.array([a * b])
        if integrand == "curvature":
            rest = moduli[2:]
            lead = np.multiply.outer(rest, rest).ravel() * (a * b) / b**4
        else:
            one = np.concatenate([[1.0], moduli])
            products = _products(_products(products, one), one)
        found = np.multiply.outer(lead, products).ravel()
    found = np.sort(np.unique(np.round(found[found > 1e-18], 15)))[::-1]
    return np.asarray(found)


def _products(some: Array, others: Array) -> Array:
    """Products that are different, but for those that are too small beside the largest."""
    found = np.unique(np.round(np.multiply.outer(some, others), 15))
    return np.asarray(found[found > _SMALL * found[-1]])


def _with(r: Array, k: int, rtol: float) -> Tail | None:
    """With k ratios eliminated; None if digits are lost, or there are not so many."""
    chosen: list[float] = []
    for x in r.tolist():
        if len(chosen) == k:
            break
        if not chosen or x < _APART * chosen[-1]:
            chosen.append(x)
    if len(chosen) < k:
        return None
    known = np.array(chosen)
    powers = np.arange(k)
    v = np.linalg.solve(known[:, None] ** powers, known**k / (1 - known)) if k else np.zeros(0)
    left = np.abs(r**k / (1 - r) - (r[:, None] ** powers) @ v) * (1 - r)
    # ratios that are eliminated leave rounding
    left = np.maximum(left, 4 * _EPS * np.abs(v).sum())
    with np.errstate(divide="ignore"):
        more = np.ceil(np.log(rtol / left) / np.log(r))
    count = k + int(np.clip(more.max(), 1, _MOST - k))
    error = float((left * r ** (count - k)).max())
    factors = np.ones(count)
    factors[count - k :] += v
    return Tail(factors, error)
