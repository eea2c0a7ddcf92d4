"""What the spectrum of a scheme says of its surfaces around a special corner, at a glance."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from limitsurf import html
from limitsurf.scheme.scheme import Scheme
from limitsurf.scheme.sector import Sector
from limitsurf.scheme.stepwise import StepwiseScheme
from limitsurf.spectra.basis import Eigenbasis, chosen
from limitsurf.spectra.stepwise import Waves, waves_of
from limitsurf.tables import CurvatureMode, Verdicts, verdicts_of


@dataclass(frozen=True)
class AnalysedEigenvalue:
    """One eigenvalue of the extended subdivision matrix of a face.

    Attributes
    ----------
    value : float or complex
    multiplicity : int
        How often it occurs.
    jordan : tuple of int
        Sizes of its Jordan blocks, the largest first.
    origins : tuple of str
        What it belongs to: "frequency 1", "outer points", of sectors "curve" or "wave 1".
    """

    value: float | complex
    multiplicity: int
    jordan: tuple[int, ...]
    origins: tuple[str, ...]


@dataclass(frozen=True)
class CurvatureAnalysis:
    """How curvature behaves on the way to a special corner, of general control points.

    Attributes
    ----------
    behaviour : {"tends to 0", "bounded", "unbounded", "not decided"}
        "not decided" only where `exact` is False.
    rate : float
        By what curvature is multiplied as the parameters are halved, of "sqrt3" as they are
        divided by the square root of 3: the largest ``|mu| / l^2``, with the subdominant eigenvalue
        l and mu any other but 1; of butterfly schemes at least the 1 that new vertices have.
    power : float or None
        Curvature grows like ``r^-power`` with the distance r in space, 1/length; negative where it
        tends to 0. None where `exact` is False.
    logarithm : bool
        Whether a Jordan chain brings a factor ``log(1/r)`` besides.
    cups, saddles : bool or None
        Whether what is left of the shape close to the vertex has a part of frequency 0, cups, and
        of frequency 2, saddles; if not, it is outweighed there. None without Fourier frequencies.
    exact : bool
        Whether curvature is of that order for control points in general position; else, where the
        subdominant eigenvalues differ or head Jordan chains, the rate bounds it, up to powers of
        the number of halvings.
    by_frequency : tuple of CurvatureMode
        The same for each Fourier frequency apart: `frequency`, `eigenvalue`, `rate`, `above` (1,
        0, -1: the rate is above 1, 1, below), `logarithm`, `outer`, `leads`.
    """

    behaviour: str
    rate: float
    power: float | None
    logarithm: bool
    cups: bool | None
    saddles: bool | None
    exact: bool
    by_frequency: tuple[CurvatureMode, ...]

    def __str__(self) -> str:
        factor = " log(1/r)" if self.logarithm else ""
        if self.behaviour == "not decided":
            return f"not decided: times at most {self.rate:.4g} a halving"
        if self.behaviour == "bounded" or self.power is None:
            return self.behaviour
        power = f" r^{-self.power:.3g}" if self.power else ""
        return f"{self.behaviour}, like{power}{factor}"


@dataclass(frozen=True)
class SpectralAnalysis:
    """What the spectrum of a scheme decides of its surfaces around a special corner.

    Attributes
    ----------
    scheme : Scheme
    sector : Sector
    eigenvalues : tuple of AnalysedEigenvalue
        The different ones, by decreasing modulus.
    subdominant : tuple of float
        The two that outweigh all others but 1, the larger first; empty where none do.
    regular : bool or None
        Whether the Jacobian of the characteristic map has one sign on all faces, by its Bernstein
        coefficients, or bounds of derivatives. None where there is no such map, or where 12
        halvings do not decide.
    injective : bool or None
        Whether that map, if it is regular, goes around the vertex once. None where it is not
        regular, and on sectors with two ends, where this is not decided.
    c1 : bool or None
        Whether general control points have a surface with a tangent plane there: one limit of
        normals, and one sheet. None if `regular` is not decided.
    curvature : CurvatureAnalysis or None
        None where there is no tangent plane.
    control_points : int
        How many the surface depends on, on a face with this corner: K.
    support : float
        How far a control point has influence where the scheme is regular, in edges.
    shrinkage : float
        By what part of its offset a vertex of the cage that sticks out is drawn back in the limit:
        1 less its own weight in its limit position; 0 if the scheme interpolates it. Of dual
        schemes: 1 less the weight of each corner of the polygon in the limit of its middle.

    Examples
    --------
    >>> import limitsurf as ls
    >>> found = ls.spectral_analysis("catmull-clark", valence=4)
    >>> found.c1, found.subdominant, found.curvature.behaviour, found.support
    (True, (0.5, 0.5), 'bounded', 2.0)
    """

    scheme: Scheme
    sector: Sector
    eigenvalues: tuple[AnalysedEigenvalue, ...]
    subdominant: tuple[float, ...]
    regular: bool | None
    injective: bool | None
    c1: bool | None
    curvature: CurvatureAnalysis | None
    control_points: int
    support: float
    shrinkage: float

    def __str__(self) -> str:
        return "\n".join(f"{name}: {value}" for name, value in self.facts.items())

    def __repr__(self) -> str:
        facts = self.facts
        said = ", ".join(f"{name} {facts[name]}" for name in ("C1", "curvature"))
        return f"<SpectralAnalysis of {self.scheme.name} at {self.sector.place}: {said}>"

    @property
    def facts(self) -> dict[str, str]:
        """All that but the eigenvalues, in words, by name; "-" is not decided, or not there."""
        curvature = self.curvature
        return {
            "subdominant": ", ".join(f"{x:.6g}" for x in self.subdominant) or "none",
            "characteristic map regular": _word(self.regular),
            "characteristic map injective": _word(self.injective),
            "C1": _word(self.c1),
            "curvature": "-" if curvature is None else str(curvature),
            "cups survive": "-" if curvature is None else _word(curvature.cups),
            "saddles survive": "-" if curvature is None else _word(curvature.saddles),
            "control points": str(self.control_points),
            "support": f"{self.support:g} edges",
            "shrinkage": f"{self.shrinkage:.4g}",
        }

    def _repr_html_(self) -> str:
        title = f"{self.scheme.name} at {self.sector.place}"
        columns: dict[str, list[Any]] = {
            "eigenvalue": [f"{x.value:.6g}" for x in self.eigenvalues],
            "times": [x.multiplicity for x in self.eigenvalues],
            "Jordan blocks": [_blocks(x) for x in self.eigenvalues],
            "belongs to": [", ".join(x.origins) for x in self.eigenvalues],
        }
        return html.facts(title, self.facts) + html.table(columns)


def _word(value: bool | None) -> str:
    return {True: "yes", False: "no", None: "-"}[value]


def _blocks(eigenvalue: AnalysedEigenvalue) -> str:
    sizes = eigenvalue.jordan
    return " + ".join(map(str, sizes)) if sizes[0] > 1 else ""


def spectral_analysis(
    scheme: str | Scheme = "catmull-clark",
    valence: int | None = None,
    *,
    kind: str = "interior",
    faces: int | None = None,
    position: int = 0,
) -> SpectralAnalysis:
    """What a scheme's spectrum says of its surfaces around a special corner.

    Whether they are C1 there, and whether curvature is bounded, of control points in general
    position. Eigenvalues are compared to 60 digits; the sign of the Jacobian of the
    characteristic map is that of its Bernstein coefficients, or of bounds where limits are no
    polynomials, on pieces that are halved until they have one sign; nothing is sampled.

    Parameters
    ----------
    scheme, valence, kind, faces, position
        As in `eigenbasis`. Verdicts are the same for all positions, but eigenvalues of outer
        points, and so curvature, are those that the face at `position` sees.

    Returns
    -------
    SpectralAnalysis
        With `eigenvalues` (each `value`, `multiplicity`, `jordan`, `origins`), `subdominant`,
        `regular`, `injective`, `c1`, `curvature`, `control_points`, `support`, `shrinkage`.

    Raises
    ------
    ValueError
        As `eigenbasis`: for an unknown scheme or kind, too few faces, masks without a limit, or a
        scheme by which no vertex is special, as "bilinear"; and for other than smooth vertices
        under a scheme without polynomial pieces, as "sqrt3".

    Warns
    -----
    UserWarning
        When masks of your own have no tangent plane at a vertex, once each.

    Notes
    -----
    A surface is C1 at a vertex, for general control points, if the characteristic map of its
    subdominant pair is regular and injective (Reif 1995; Peters and Reif 1998). As the parameters
    are halved, curvature is multiplied by ``mu / l^2`` (Sabin 1991), of the *extended* matrix: mu
    can belong to points outside of the ring, as at valence 3 of Loop's scheme. Cups and saddles:
    Karciauskas, Peters, Reif (2004). The weights of a vertex in its limit: Halstead, Kass, DeRose
    (1993). Derived in ``derivations/scaling.py``, ``derivations/analysis.py`` and, without
    polynomials, ``derivations/stepwise.py``.

    Examples
    --------
    >>> import limitsurf as ls
    >>> found = ls.spectral_analysis("loop", valence=3)
    >>> found
    <SpectralAnalysis of loop at interior valence 3: C1 yes, curvature unbounded, like r^-0.5>
    >>> found.curvature.rate, found.regular, found.injective
    (2.0, True, True)
    >>> print(ls.spectral_analysis("doo-sabin", valence=5).curvature)
    unbounded, like log(1/r)
    """
    scheme, sector = chosen(scheme, valence, kind, faces, position)
    if not scheme.has_pieces:
        return _of_waves(scheme, sector)
    basis = Eigenbasis(scheme, sector)
    table, found = basis.float64, verdicts_of(basis.scheme, basis.sector)
    regular, undecided = found.regular, bool(found.pair) and found.regular is None
    injective = _injective(found)
    c1 = None if undecided else bool(len(table.normal))
    return SpectralAnalysis(
        basis.scheme,
        basis.sector,
        tuple(_eigenvalues(basis)),
        found.pair,
        regular,
        injective,
        c1,
        _curvature(found, basis.sector) if c1 else None,
        table.size,
        _support(basis.scheme),
        1 - float(table.limit_mask[0]),
    )


def _injective(found: Verdicts) -> bool | None:
    if not found.regular or found.turns is None:
        return None
    return abs(abs(found.turns) - 1) < 0.25


def _of_waves(scheme: Scheme, sector: Sector) -> SpectralAnalysis:
    """That of a scheme without polynomial pieces."""
    if sector.kind != "interior":
        raise ValueError(
            f"scheme {scheme.name!r}: spectra of schemes that are refined step by step are known "
            f"at smooth interior vertices, not of a {sector.kind}; its surfaces have the normals "
            "that ls.refined gives"
        )
    n = sector.faces
    waves = waves_of(scheme, n)
    found, injective = waves.verdicts, _injective(waves.verdicts)
    c1 = None if found.pair and found.regular is None else bool(found.regular and injective)
    curvature = _curvature(found, sector) if c1 else None
    if curvature is not None and not scheme.turns_edges:
        curvature = _with_chains(curvature, found.pair[0])
    return SpectralAnalysis(
        scheme, sector, tuple(_values(waves, n)), found.pair, found.regular, injective, c1,
        curvature, waves.size, _support(scheme), 1 - waves.own,
    )  # fmt: skip


def _values(waves: Waves, n: int) -> Iterator[AnalysedEigenvalue]:
    for value, some in waves.groups:
        sizes = [one.jordan * (1 if 2 * one.frequency in (0, n) else 2) for one in some]
        jordan = tuple(sorted((size for each in sizes for size in each), reverse=True))
        origins = [f"frequency {one.frequency}" for one in some]
        yield AnalysedEigenvalue(value, sum(jordan), jordan, tuple(dict.fromkeys(origins)))


def _with_chains(curvature: CurvatureAnalysis, second: float) -> CurvatureAnalysis:
    """The same where each new vertex has a chain that makes curvature unbounded, of power 0."""
    own = curvature.rate > 1 and curvature.behaviour == "unbounded"
    power = math.log(curvature.rate) / -math.log(second) if own else 0.0
    logarithm = curvature.logarithm if own else True
    rate = curvature.rate if own else 1.0
    return replace(
        curvature, behaviour="unbounded", rate=rate, power=power, logarithm=logarithm,
        cups=curvature.cups if own else None, saddles=curvature.saddles if own else None,
    )  # fmt: skip


def _eigenvalues(basis: Eigenbasis) -> Iterator[AnalysedEigenvalue]:
    values = basis.float64.eigenvalues
    for group in basis.groups:
        value = values[group.places[0]].item()
        yield AnalysedEigenvalue(value, len(group.places), group.jordan, group.origins)


def _curvature(found: Verdicts, sector: Sector) -> CurvatureAnalysis:
    lead = next(mode for mode in found.curvature if mode.leads)
    behaviour = {-1: "tends to 0", 0: "bounded", 1: "unbounded"}[lead.above]
    if lead.above == 0 and lead.logarithm:
        behaviour = "unbounded"
    if behaviour != "tends to 0" and not found.exact:
        behaviour = "not decided"
    power = None
    if found.exact:
        power = math.log(lead.rate) / -math.log(found.pair[0]) if lead.above and lead.rate else 0.0
    cups = saddles = None
    if lead.frequency is not None:
        leading = {mode.frequency for mode in found.curvature if mode.leads}
        # around few faces other frequencies look like 2
        alias = 2 % sector.faces
        cups, saddles = 0 in leading, min(alias, sector.faces - alias) in leading
    return CurvatureAnalysis(
        behaviour,
        lead.rate,
        power,
        lead.logarithm,
        cups,
        saddles,
        found.exact,
        found.curvature,
    )


def _support(scheme: Scheme) -> float:
    """How far a control point has influence on a regular grid, in edges.

    That of a B-spline of degree d is d + 1 intervals; of a box spline of three directions, each m
    times, m edges around, and its degree is 3 m - 2.
    """
    if isinstance(scheme, StepwiseScheme):
        return scheme.reach
    exponents = scheme.spline.exponents
    if scheme.lattice.face_size == 4:
        return (max(map(max, exponents)) + 1) / 2
    return (max(map(sum, exponents)) + 2) / 3
