"""A subdivision scheme as a value: its masks, stated once as exact rationals.

A primal quadrilateral scheme computes, in this order,

* a *face point* for every face of ``n`` corners: ``sum(face(n)[i] * corner[i])``;
* an *edge point* for every interior edge: ``edge[0] * (a + b) + edge[1] * (p + q)``, where ``a, b``
  are its end points and ``p, q`` the face points of its two faces;
* a *vertex point* for every interior vertex of valence ``N``: ``vertex(N)[0]`` times itself, plus
  ``vertex(N)[1]`` times each of its ``N`` edge neighbours, plus ``vertex(N)[2]`` times each of the
  ``N`` face points around it;
* on boundaries and creases, ``boundary_edge`` times each end point, and ``boundary_vertex[0]``
  times the vertex plus ``boundary_vertex[1]`` times each of its two neighbours there (which of
  these applies where, and how they blend, is told in ``exact/creases.py``).

Everything else in the library (matrices, spectra, refinement, evaluation) is derived from these.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import Any


@dataclass(frozen=True)
class Scheme:
    """Masks of a primal quadrilateral subdivision scheme that generalises the bicubic B-spline.

    Parameters
    ----------
    name : str
        What the scheme is called in messages, tables and files.
    face : callable, n -> n rationals
        Weights of the corners of a face of ``n`` corners in its face point.
    edge : (Fraction, Fraction)
        Weight of each end point, and of each adjacent face point, in an edge point.
    vertex : callable, N -> 3 rationals
        Weights of the vertex, of each edge neighbour and of each adjacent face point in the vertex
        point of an interior vertex of valence ``N``.
    boundary_edge : Fraction
        Weight of each end point in the edge point of a boundary edge.
    boundary_vertex : (Fraction, Fraction)
        Weight of the vertex, and of each boundary neighbour, in a smooth boundary's vertex point.
    paper : str
        Where the masks are published.
    smooth_triangle : Fraction, optional
        Under the triangle rule "smooth", what a triangle contributes instead of ``edge[1]`` to the
        common weight of the two face points in an edge point, the mean of its two faces'
        contributions; the end points share the rest. None if there is no such rule.

    Raises
    ------
    ValueError
        When a mask is not rational or does not sum to one (a `face` or `vertex` mask: when it is
        first needed), when the masks of a regular vertex are not those of the bicubic B-spline,
        and, as `UnsupportedSpectrum` where a smooth vertex or a dart of so many faces is first
        used, when refinement there does not converge (an eigenvalue other than 1 has modulus 1 or
        more) or, at a smooth vertex, has complex eigenvalues of frequency 0.

    Warns
    -----
    UserWarning
        Once for each number of faces at which limits exist, but no tangent plane: there the surface
        is not C1, and normals at the vertex are NaN.

    Notes
    -----
    There is a tangent plane where two single eigenvalues are real, positive and larger in modulus
    than all that follow, and the map by their eigenfunctions is regular and goes around the vertex
    once (Reif 1995). Both this and convergence are decided from the spectrum of each ring, in exact
    numbers or to 60 digits; derived in ``derivations/analysis.py``.

    Examples
    --------
    >>> from fractions import Fraction
    >>> import limitsurf as ls
    >>> plain = ls.Scheme(
    ...     "plain", face=lambda n: (Fraction(1, n),) * n, edge=(Fraction(1, 4), Fraction(1, 4)),
    ...     vertex=lambda N: (Fraction(1, 2), Fraction(1, 4 * N), Fraction(1, 4 * N)),
    ...     boundary_edge=Fraction(1, 2), boundary_vertex=(Fraction(3, 4), Fraction(1, 8)),
    ...     paper="an example")
    >>> [str(weight) for weight in plain.vertex_mask(5)]
    ['1/2', '1/20', '1/20']
    """

    name: str
    face: Callable[[int], tuple[Fraction, ...]]
    edge: tuple[Fraction, Fraction]
    vertex: Callable[[int], tuple[Fraction, Fraction, Fraction]]
    boundary_edge: Fraction
    boundary_vertex: tuple[Fraction, Fraction]
    paper: str
    smooth_triangle: Fraction | None = None

    def __post_init__(self) -> None:
        # tuples of Fractions, whatever sequences and integers were given
        set_field = partial(object.__setattr__, self)
        set_field("edge", self._check("edge", self.edge, (2, 2)))
        set_field("boundary_edge", self._check("boundary_edge", (self.boundary_edge,), (2,))[0])
        set_field("boundary_vertex", self._check("boundary_vertex", self.boundary_vertex, (1, 2)))
        # knot insertion for the uniform bicubic B-spline (derivations/masks_bicubic.py)
        quarter = Fraction(1, 4)
        regular = {
            "face(4)": (self.face_mask(4), (quarter,) * 4),
            "edge": (self.edge, (quarter, quarter)),
            "vertex(4)": (self.vertex_mask(4), (quarter * 2, quarter / 4, quarter / 4)),
            "boundary_edge": ((self.boundary_edge,), (quarter * 2,)),
            "boundary_vertex": (self.boundary_vertex, (quarter * 3, quarter / 2)),
        }
        for mask, (got, needed) in regular.items():
            if tuple(got) != needed:
                raise ValueError(
                    f"scheme {self.name!r}: {mask} is ({', '.join(map(str, got))}), "
                    f"but the bicubic B-spline needs ({', '.join(map(str, needed))})"
                )

    def face_mask(self, n: int) -> tuple[Fraction, ...]:
        """Weights of the ``n`` corners of a face in its face point, shape (n,)."""
        return self._check(f"face({n})", self.face(n), (1,) * n)

    def vertex_mask(self, valence: int) -> tuple[Fraction, ...]:
        """Weights of an interior vertex, of each edge neighbour, of each face point, shape (3,)."""
        return self._check(f"vertex({valence})", self.vertex(valence), (1, valence, valence))

    def __hash__(self) -> int:
        # equal schemes have equal names; masks of Fractions are slow to hash
        return hash(self.name)

    def key(self, valence: int | None) -> dict[str, Any]:
        """All that a subdivision matrix depends on; `valence` if that of a smooth vertex does."""
        masks = {
            "face(4)": self.face_mask(4),
            "edge": self.edge,
            "vertex(4)": self.vertex_mask(4),
            "boundary": (self.boundary_edge, *self.boundary_vertex),
        }
        if valence is not None:
            masks[f"vertex({valence})"] = self.vertex_mask(valence)
        return {"scheme": self.name, "masks": {k: [str(w) for w in v] for k, v in masks.items()}}

    def _check(
        self, mask: str, weights: tuple[Fraction, ...], counts: tuple[int, ...]
    ) -> tuple[Fraction, ...]:
        """Return `weights`, which must be rationals whose sum, with multiplicities, is one."""
        if len(weights) != len(counts) or not all(isinstance(w, (Fraction, int)) for w in weights):
            raise ValueError(
                f"scheme {self.name!r}: {mask} must be {len(counts)} Fractions, got {weights!r}"
            )
        total = sum((w * c for w, c in zip(weights, counts, strict=True)), Fraction(0))
        if total != 1:
            raise ValueError(f"scheme {self.name!r}: {mask} sums to {total}, not to 1")
        return tuple(Fraction(w) for w in weights)
