"""Eigenbases of special corners, for those who study them: exact expressions and float64 tables."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from limitsurf import html
from limitsurf.caching import cached_property
from limitsurf.cage.checks import checked_integer
from limitsurf.scheme.scheme import Scheme
from limitsurf.scheme.sector import Sector
from limitsurf.tables import EigenNumbers, FourierRing, eigen_numbers, eigen_table, find_scheme

if TYPE_CHECKING:
    from limitsurf.exact.symbolic import SymbolicBasis
    from limitsurf.exact.symbolic_dual import DualBasis
    from limitsurf.exact.symbolic_sectors import SectorBasis


@dataclass(frozen=True)
class EigenvalueGroup:
    """What there is to say of one eigenvalue.

    Attributes
    ----------
    places : tuple of int
        Its indices among the eigenvalues of the basis, as often as it occurs.
    jordan : tuple of int
        Sizes of its Jordan blocks, the largest first.
    origins : tuple of str
        Which blocks of the subdivision matrix it belongs to, such as "frequency 1".
    """

    places: tuple[int, ...]
    jordan: tuple[int, ...]
    origins: tuple[str, ...]


class Eigenbasis:
    """Eigenstructure of a scheme around a special corner, exactly and in float64.

    Attributes
    ----------
    scheme, sector, provenance
        What it belongs to, and all that its numbers depend on.
    exact : SymbolicBasis
        sympy expressions, made on first use.
    float64 : EigenTable
        The same numbers rounded from 96 digits.

    Both have ``eigenvalues``, ``A``, ``V``, ``J``, ``Vinv``, ``residual`` (``A V - V J``),
    ``limit_mask`` and ``tangent_masks``; so has `in_digits`, in as many digits as are wanted.

    Examples
    --------
    >>> import limitsurf as ls
    >>> basis = ls.eigenbasis("catmull-clark", valence=3)
    >>> basis.exact.eigenvalues[1]
    sqrt(17)/32 + 9/32
    >>> basis.exact.residual.is_zero_matrix
    True
    """

    def __init__(self, scheme: Scheme, sector: Sector) -> None:
        if scheme.local:
            raise ValueError(
                f"scheme {scheme.name!r} has no eigenbases: its limit faces depend on their own "
                "corners alone, whatever is around them, and no vertex is special"
            )
        self.scheme = scheme
        self.sector = sector
        self.float64 = eigen_table(scheme, sector)
        self.provenance = {**self.float64.provenance, "paper": scheme.paper}

    @property
    def valence(self) -> int:
        """Number of faces around the vertex, or in the sector."""
        return self.sector.faces

    @cached_property
    def exact(self) -> SymbolicBasis | SectorBasis | DualBasis:
        """The eigenbasis as sympy expressions."""
        if self.sector.lattice.dual:
            from limitsurf.exact.symbolic_dual import DualBasis

            return DualBasis(self.scheme, self.sector)
        if self.sector.kind == "interior":
            from limitsurf.exact.symbolic import SymbolicBasis

            return SymbolicBasis(self.scheme, self.sector.faces)
        from limitsurf.exact.symbolic_sectors import SectorBasis

        return SectorBasis(self.scheme, self.sector)

    def in_digits(self, digits: int) -> EigenNumbers:
        """The eigenbasis to so many decimal digits, as mpmath numbers.

        Parameters
        ----------
        digits : int
            How many digits after the point are right, at least 1.

        Returns
        -------
        EigenNumbers
            With `eigenvalues`, `A`, `V`, `J`, `Vinv`, `residual`, `limit_mask` and `tangent_masks`
            in the order of `.float64`, as object arrays.

        Raises
        ------
        ValueError
            When `digits` is no integer of at least 1.

        Examples
        --------
        >>> import limitsurf as ls
        >>> from mpmath import nstr
        >>> print(nstr(ls.eigenbasis(valence=5).in_digits(200).eigenvalues[1], 30))
        0.549988354518297177894305358956
        """
        return eigen_numbers(self.scheme, self.sector, checked_integer("digits", digits, 1))

    @property
    def has_tangent_plane(self) -> bool:
        """Whether general control points have a limit normal at the vertex."""
        return len(self.float64.normal) > 0

    @property
    def has_bounded_curvature(self) -> bool:
        """Whether the curvature of general control points stays bounded towards the vertex."""
        return self.float64.has_bounded_curvature

    @property
    def growth(self) -> dict[str, float | None]:
        """By what things are multiplied in general as the distance from the vertex is halved.

        Keys: "first_derivatives", "second_derivatives", "curvature", and "normals", the distance of
        normals from their limit, None where they have none.

        Examples
        --------
        >>> import limitsurf as ls
        >>> round(ls.eigenbasis("catmull-clark", valence=5).growth["first_derivatives"], 3)
        1.1
        """
        return self.float64.growth

    @cached_property
    def groups(self) -> list[EigenvalueGroup]:
        """The different eigenvalues, by decreasing modulus; of a complex pair both apart."""
        table, groups = self.float64, dict[tuple[float, int], list[int]]()
        pairs, chains = set(table.pairs.tolist()), set(table.chains.tolist())
        for k, size in enumerate(table.rates[0].tolist()):
            # of a complex pair it is the modulus
            groups.setdefault((size, (k in pairs) - (k - 1 in pairs)), []).append(k)
        found = []
        for places in groups.values():
            sizes: list[int] = []
            for k in places:
                if k in chains:
                    sizes[-1] += 1
                else:
                    sizes.append(1)
            origins = dict.fromkeys(map(self._origin, places))
            jordan = tuple(sorted(sizes, reverse=True))
            found.append(EigenvalueGroup(tuple(places), jordan, tuple(origins)))
        return found

    def _origin(self, k: int) -> str:
        """Which block of the subdivision matrix an eigenvalue belongs to."""
        table, sector = self.float64, self.sector
        mode = int(table.order[k])
        if mode >= sector.ring:
            return "outer points"
        if sector.lattice.dual:
            from limitsurf.exact.dual import ring_waves

            return f"frequency {ring_waves(sector.faces)[mode][0]}"
        if isinstance(table.ring, FourierRing):
            return f"frequency {table.ring.frequency[mode]}"
        if sector.carried and mode == sector.ring - 1:
            return "curve"
        orbits, faces = len(sector.lattice.orbits), sector.faces
        if (
            sector.kind == "pendant"
        ):  # of a wave cosine and sine, for each orbit; of frequency 0 v too
            return f"frequency {(mode - 1 - orbits) // (2 * orbits) + 1}"
        # vectors of the curve, or those even about the dart's edge; then waves, one for each orbit
        even = 2 + faces // 2 + (orbits - 1) * ((faces + 1) // 2)
        first, name = (3, "curve") if sector.open else (even, "even part")
        return name if mode < first else f"wave {(mode - first) // orbits + 1}"

    def _distinct(self) -> list[tuple[float, int]]:
        values, counts = np.unique(self.float64.rates[0], return_counts=True)
        return sorted(zip(values.tolist(), counts.tolist(), strict=True), key=lambda p: -abs(p[0]))

    def __repr__(self) -> str:
        spectrum = ", ".join(
            f"{value:.6g}" + (f" (x{count})" if count > 1 else "")
            for value, count in self._distinct()[:6]
        )
        return (
            f"<Eigenbasis of {self.scheme.name} at {self.sector.place}: "
            f"{self.float64.size} control points, eigenvalues {spectrum}, ...>"
        )

    def _repr_html_(self) -> str:
        groups = self.groups
        sizes = [float(self.float64.rates[0][group.places[0]]) for group in groups]
        columns: dict[str, list[Any]] = {
            "size of eigenvalue": sizes,
            "times": [len(group.places) for group in groups],
            "belongs to": [", ".join(group.origins) for group in groups],
        }
        title = f"{self.scheme.name} at {self.sector.place}: {self.float64.size} control points"
        return html.table(columns, title)

    def _repr_latex_(self) -> str:
        import sympy

        counts: dict[Any, int] = {}
        for value in self.exact.eigenvalues:
            counts[value] = counts.get(value, 0) + 1
        terms = [
            sympy.latex(value) + (rf"\;(\times {count})" if count > 1 else "")
            for value, count in counts.items()
        ]
        return (
            rf"$\displaystyle \text{{{self.scheme.name}, {self.sector.place}}}: \quad "
            rf"\lambda \in \left\{{ {', '.join(terms)} \right\}}$"
        )


def eigenbasis(
    scheme: str | Scheme = "catmull-clark",
    valence: int | None = None,
    *,
    kind: str = "interior",
    faces: int | None = None,
    position: int = 0,
) -> Eigenbasis:
    """Eigenvalues, eigenvectors and limit masks of a scheme around a special corner.

    The subdivision matrix acts on the K control points of a quad with one special corner (Stam
    1998, section 3); their order is drawn in ``exact/matrices.py``.

    Parameters
    ----------
    scheme : str or Scheme
        A name such as "catmull-clark", or a scheme of your own.
    valence : int, optional
        Number of faces around a smooth interior vertex, at least 2.
    kind : {"interior", "crease", "corner", "dart", "cone", "flap", "pendant"}
        What the corner is: "crease", a vertex on a boundary or sharp crease; "corner", a sharp
        vertex between two sharp edges; "dart", the end of a sharp crease; "cone", a sharp vertex
        amid smooth faces; "flap" and "pendant", a corner and a cone whose vertex is carried by a
        crease that does not bound them, as they are at non-manifold edges.
    faces : int, optional
        Instead of `valence`: number of faces of the sector, at least 1 for "crease", "corner" and
        "flap", which lie on one side of the sharp edges, else at least 2.
    position : int
        Which face of a crease, corner, flap or dart is looked at, counter-clockwise from a sharp
        edge.

    Returns
    -------
    Eigenbasis
        With `.exact` (sympy) and `.float64` (numpy), each holding `eigenvalues` (K,), `A`, `V`,
        `J`, `Vinv`, `residual` (K, K), `limit_mask` (K,) and `tangent_masks` (2, K), which is
        empty where there is no tangent plane.

    Raises
    ------
    ValueError
        For an unknown scheme or kind, too few faces, a position out of range, masks without a
        Jordan basis of the kind that is handled, or a scheme by which no vertex is special, as
        "bilinear".

    Notes
    -----
    Derived in ``derivations/eigenstructure.py`` and ``derivations/sectors.py``. Smooth valence 2
    has no tangent plane in general: the eigenvalue -1/4 ties with the subdominant 1/4; and its
    eigenvalue 1/8 has a Jordan block. So have creases at 1/4 for odd numbers of faces and at 1/2
    for multiples of four, corners and flaps at 1/2 for even numbers, flaps at 1/4 for odd ones.
    Darts of 6 and more faces can have one pair of complex eigenvalues: there ``J`` has a rotation,
    and ``eigenvalues`` of `.float64` is complex.

    Examples
    --------
    >>> import limitsurf as ls
    >>> basis = ls.eigenbasis("catmull-clark", valence=5)
    >>> basis
    <Eigenbasis of catmull-clark at interior valence 5: 18 control points, eigenvalues 1, ...>
    >>> print(basis.exact.eigenvalues[1].evalf(20))
    0.54998835451829717789
    >>> ls.eigenbasis("catmull-clark", kind="crease", faces=4).float64.eigenvalues[:4]
    array([1.        , 0.61111653, 0.5       , 0.5       ])
    """
    return Eigenbasis(*chosen(scheme, valence, kind, faces, position))


def chosen(
    scheme: str | Scheme, valence: int | None, kind: str, faces: int | None, position: int
) -> tuple[Scheme, Sector]:
    """The scheme and the special corner that arguments of `eigenbasis` are of."""
    scheme = find_scheme(scheme)
    number = faces if valence is None else valence
    if (valence is None) == (faces is None):
        raise ValueError(f"give either valence or faces, got {valence!r} and {faces!r}")
    for name, value in (("number of faces", number), ("position", position)):
        if not isinstance(value, (int, np.integer)) or isinstance(value, bool):
            raise ValueError(f"the {name} is an integer, got {value!r}")
    assert number is not None
    return scheme, scheme.sector(kind, int(number), int(position))
