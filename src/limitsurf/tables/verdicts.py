"""What exact spectra say of the surface around a special corner, as plain numbers.

Decided in `exact`, to 60 digits, and kept in memory: whether the characteristic map is regular and
injective, and by what curvature is multiplied as the distance from the corner is halved.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from limitsurf.scheme.scheme import Scheme
from limitsurf.scheme.sector import Sector

if TYPE_CHECKING:
    from limitsurf.exact.spectrum import Spectrum


@dataclass(frozen=True)
class CurvatureMode:
    """What outweighs all other modes of one frequency in the curvature.

    Attributes
    ----------
    frequency : int or None
        Of the Fourier waves around the vertex; None where there are none.
    eigenvalue : float
        The largest that this frequency has beside the constant and the subdominant pair, mu; of a
        complex pair its modulus.
    rate : float
        ``|mu| / l^2``, by which curvature is multiplied as parameters are halved; l is the
        subdominant eigenvalue, of a pair the lesser.
    above : int
        1, 0 or -1: whether the rate is above 1, 1 or below; decided to 60 digits.
    logarithm : bool
        Whether mu heads a Jordan chain, which brings a factor of the number of halvings.
    outer : bool
        Whether mu is of the outer points, which the ring does not see.
    leads : bool
        Whether no other frequency has a larger mu, or one of that size with a logarithm.
    """

    frequency: int | None
    eigenvalue: float
    rate: float
    above: int
    logarithm: bool
    outer: bool
    leads: bool


@dataclass(frozen=True)
class Verdicts:
    """What the spectrum of a special corner decides.

    Attributes
    ----------
    pair : (float, float) or ()
        The two eigenvalues that outweigh all others, if there are such.
    regular : bool or None
        Whether the minor of their eigenfunctions has one sign on all faces; None if there is no
        pair, or the bounds of it do not decide.
    turns : float or None
        How often these go around the vertex, on closed faces.
    curvature : tuple of CurvatureMode
        By frequency, the least first.
    exact : bool
        Whether curvature has these rates for control points in general position; else they are
        bounds of them.
    """

    pair: tuple[float, ...]
    regular: bool | None
    turns: float | None
    curvature: tuple[CurvatureMode, ...]
    exact: bool


@lru_cache(maxsize=256)
def verdicts_of(scheme: Scheme, sector: Sector) -> Verdicts:
    """Return what the exact spectrum of `scheme` decides around a special corner.

    Raises a ValueError, `UnsupportedSpectrum`, for masks that do not converge there.
    """
    from limitsurf.exact.analysis import minor_sign, winding
    from limitsurf.exact.spectrum import leading_functions, spectrum

    found = spectrum(scheme, sector)
    modes, functions, turns = leading_functions(scheme, sector)
    if not modes:
        return Verdicts((), None, None, (), False)
    sign = minor_sign(scheme, functions)
    around = None if sector.open else winding(scheme, functions, turns)
    pair = [found.order.index(k) for k in modes]
    l1, l2 = sorted((found.eigenvalues[k] for k in pair), reverse=True)
    # the orders are exact if both functions fall alike, and without chains
    exact = l1 - l2 < found.at.equal and not {*pair} & ({*found.chains} | _ends(found))
    regular = None if sign is None else sign != 0
    curvature = tuple(_by_frequency(found, sector, pair, l2))
    return Verdicts((float(l1), float(l2)), regular, around, curvature, exact)


def _ends(found: Spectrum) -> set[int]:
    return {k - 1 for k in found.chains}


def _by_frequency(
    found: Spectrum, sector: Sector, pair: list[int], second: Any
) -> Iterator[CurvatureMode]:
    """The mode of each frequency that outweighs its others in the curvature."""
    from limitsurf.exact.analysis import curvature_rank

    waves = sector.kind in ("interior", "cone") and not sector.gathered
    chained = _chained_frequencies(found, sector)
    best: dict[int | None, tuple[Any, bool, int]] = {}
    for k, value in enumerate(found.eigenvalues):
        if k == 0 or k in pair:
            continue
        mode = found.order[k]
        every: Iterable[int | None] = [None]
        if waves and mode >= sector.ring:
            # what vanishes on the ring is there on each face, so at all frequencies
            every = range(sector.faces // 2 + 1)
        elif waves:
            every = [_frequency(found, sector, mode)]
        for f in every:
            rank = found.at.mp.nint(abs(value) / found.at.equal), k in chained.get(f, ())
            if f not in best or rank > best[f][:2]:
                best[f] = (*rank, k)
    first = max((rank[:2] for rank in best.values()), default=None)
    for f, (size, head, k) in sorted(best.items(), key=lambda x: x[0] or 0):
        value = found.eigenvalues[k]
        rate = float(abs(value) / second**2)
        of = float(abs(value) if isinstance(value, found.at.mp.mpc) else value)
        above = curvature_rank(value, second)
        outer, leads = found.order[k] >= sector.ring, (size, head) == first
        yield CurvatureMode(f, of, rate, above, head, outer, leads)


def _frequency(found: Spectrum, sector: Sector, mode: int) -> int:
    """The Fourier frequency of a mode of the ring."""
    if sector.lattice.dual:
        return int(found.ring.waves[mode][0])  # type: ignore[union-attr]
    return int(found.ring.modes[mode].frequency)  # type: ignore[union-attr]


def _chained_frequencies(found: Spectrum, sector: Sector) -> dict[int | None, set[int]]:
    """Modes that head Jordan chains, by frequency; all of them under None."""
    heads: dict[int | None, set[int]] = {None: set(found.chains)}
    if sector.kind not in ("interior", "cone") or sector.gathered:
        return heads
    place = {mode: k for k, mode in enumerate(found.order)}
    ring = [k for k in found.chains if found.order[k] < sector.ring]
    # waves from which a head is taken away are coupled to its end as it is
    taken = getattr(found.ring, "taken", {})
    for k in [*ring, *(place[m] for m, (first, _) in taken.items() if place[first] in ring)]:
        heads.setdefault(_frequency(found, sector, found.order[k]), set()).add(k)
    return heads
