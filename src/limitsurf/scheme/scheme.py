"""A subdivision scheme as a value: its lattice, its spline, and its masks as exact numbers.

A primal scheme computes, in this order,

* if its lattice has face points, a *face point* for every face of ``n`` corners:
  ``sum(face(n)[i] * corner[i])``;
* an *edge point* for every interior edge: ``edge[0] * (a + b) + edge[1] * (p + q)``, where ``a, b``
  are its end points and ``p, q`` the face points of its two faces, or, where there are none, the
  opposite corners of its two triangles;
* a *vertex point* for every interior vertex of valence ``N``: ``vertex(N)[0]`` times itself, plus
  ``vertex(N)[1]`` times each of its ``N`` edge neighbours, plus, if there are any, ``vertex(N)[2]``
  times each of the ``N`` face points around it;
* on boundaries and creases, ``boundary_edge`` times each end point, and ``boundary_vertex[0]``
  times the vertex plus ``boundary_vertex[1]`` times each of its two neighbours there (which of
  these applies where, and how they blend, is told in ``exact/creases.py``).

Everything else in the library (matrices, spectra, refinement, evaluation) is derived from these.
Weights are Fractions; those of a vertex or an edge may be algebraic numbers, as sympy has them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import Any, TypeAlias

from limitsurf.scheme.lattice import QUADS, Lattice
from limitsurf.scheme.sector import KINDS, Sector
from limitsurf.scheme.spline import BICUBIC, Spline

# a Fraction, or an algebraic number of sympy
Weight: TypeAlias = Any
Weights: TypeAlias = tuple[Weight, ...]


@dataclass(frozen=True)
class Scheme:
    """Masks of a primal subdivision scheme.

    If nothing else is said it is of quads, and generalises the bicubic B-spline.

    Parameters
    ----------
    name : str
        What the scheme is called in messages, tables and files.
    face : callable, n -> n rationals, or None
        Weights of the corners of a face of ``n`` corners in its face point; None if there is none.
    edge : (Fraction, Fraction)
        Weight of each end point, and of each adjacent face point, in an edge point; without face
        points of each opposite corner. Or a callable: the valences of both ends -> the weights of
        the first end, of the second, and of what lies across; with the valences exchanged it gives
        the first two exchanged, as no end is the first. `LimitSurface` wants these to be
        those of regular edges wherever one end is regular; `refined` takes any.
    vertex : callable, N -> 3 rationals
        Weights of the vertex, of each edge neighbour and of each adjacent face point, if there are
        any, in the vertex point of an interior vertex of valence ``N``.
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
    lattice : Lattice, optional
        How regular faces lie together, and what a step makes of them.
    spline : Spline, optional
        What the scheme makes of a regular lattice.

    Raises
    ------
    ValueError
        When a mask is not rational or does not sum to one (a `face` or `vertex` mask: when it is
        first needed), when the masks of a regular vertex are not those of the `spline`,
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
    face: Callable[[int], tuple[Fraction, ...]] | None
    edge: tuple[Fraction, Fraction] | Callable[[int, int], Weights]
    vertex: Callable[[int], Weights]
    boundary_edge: Fraction
    boundary_vertex: tuple[Fraction, Fraction]
    paper: str
    smooth_triangle: Fraction | None = None
    lattice: Lattice = QUADS
    spline: Spline = BICUBIC

    def __post_init__(self) -> None:
        # tuples of Fractions, whatever sequences and integers were given
        set_field = partial(object.__setattr__, self)
        if not callable(self.edge):
            set_field("edge", self._check("edge", self.edge, (2, 2)))
        set_field("boundary_edge", self._check("boundary_edge", (self.boundary_edge,), (2,))[0])
        set_field("boundary_vertex", self._check("boundary_vertex", self.boundary_vertex, (1, 2)))
        size, valence = self.lattice.face_size, self.lattice.valence
        own: dict[str, Weights] = {
            f"face({size})": self.face_mask(size),
            "edge": self.regular_edge,
            f"vertex({valence})": self.vertex_mask(valence),
            "boundary_edge": (self.boundary_edge,),
            "boundary_vertex": self.boundary_vertex,
        }
        for (mask, got), needed in zip(own.items(), self._regular_masks(), strict=True):
            if tuple(got) != needed:
                raise ValueError(
                    f"scheme {self.name!r}: {mask} is ({', '.join(map(str, got))}), "
                    f"but the {self.spline.name} needs ({', '.join(map(str, needed))})"
                )

    def _regular_masks(self) -> tuple[tuple[Fraction, ...], ...]:
        """Those of the spline (``derivations/masks_bicubic.py``), in the order of the checks."""
        star, stride = self.lattice.star, len(self.lattice.orbits)
        vertex, edge = self.spline.stencil((0, 0)), self.spline.stencil((1, 0))
        face = self.spline.stencil((1, 1)) if self.lattice.face_points else {}
        zero = Fraction(0)
        unit = face.get((0, 0), Fraction(1))  # of a corner in what stands for its face
        across, near = edge.get(star[stride], zero) / unit, vertex.get(star[0], zero)
        # corners beyond the neighbours come with face points, which bring neighbours too
        around = [vertex.get(place, zero) / unit for place in star[1:stride]]
        near -= 2 * unit * sum(around)
        own = 1 - self.lattice.valence * (near + sum(around))
        curve, middle = self.spline.curve_stencil(0), self.spline.curve_stencil(1)
        return (
            tuple(face.values()),
            ((1 - 2 * across) / 2, across),
            (own, near, *around),
            (middle[0],),
            (curve[0], curve.get(1, zero)),
        )

    @property
    def local(self) -> bool:
        """Whether limit faces depend on their own corners alone: no vertex is special, no edge."""
        return len(self.spline.template) == self.lattice.face_size

    @property
    def has_pieces(self) -> bool:
        """Whether limit faces are made of polynomial pieces, those of the spline."""
        return True

    @property
    def turns_edges(self) -> bool:
        """Whether two steps cut edges into three, and one makes faces across edges."""
        return False

    @property
    def has_creases(self) -> bool:
        """Whether there are rules for sharp edges and vertices."""
        return True

    def face_mask(self, n: int) -> tuple[Fraction, ...]:
        """Weights of the ``n`` corners of a face in its face point, shape (n,); else (0,)."""
        return () if self.face is None else self._check(f"face({n})", self.face(n), (1,) * n)

    def edge_mask(self, first: int, second: int) -> Weights:
        """Weights in an interior edge point, by the valences of its ends: of each, and across."""
        if not callable(self.edge):
            return self.edge[0], *self.edge
        ends, found = [(first, second), (second, first)], []
        for pair in ends:
            name = f"edge({pair[0]}, {pair[1]})"
            found.append(self._check(name, self.edge(*pair), (1, 1, 2), algebraic=True))
        (one, other, across), turned = found
        if not all(map(_equal, turned, (other, one, across))):
            told = (
                f"edge{e} is ({', '.join(map(str, w))})" for e, w in zip(ends, found, strict=True)
            )
            raise ValueError(
                f"scheme {self.name!r}: {' and '.join(told)}; an edge has no first end: where "
                "the valences are exchanged, the first two weights must be exchanged, too"
            )
        half = Fraction(1, 2)
        self._check_local(f"edge({first}, {second})", found[0], (half, half, 0))
        return found[0]

    def check_spokes(self, valence: int) -> None:
        """Refuse edges from a vertex of that valence to regular ones with masks of their own.

        What is next to the vertex is then no piece of the spline, however often it is refined.
        """
        regular = self.lattice.valence
        needed = self.edge_mask(regular, regular)
        for ends in ((valence, regular), (regular, valence)):
            if (got := self.edge_mask(*ends)) != needed:
                raise ValueError(
                    f"scheme {self.name!r}: edge{ends} is ({', '.join(map(str, got))}); such a "
                    "scheme can be refined, but a surface needs the mask of regular edges, "
                    f"({', '.join(map(str, needed))}), wherever one end is regular"
                )

    @property
    def regular_edge(self) -> tuple[Fraction, Fraction]:
        """Weight of each end, and of what lies across, where both ends are regular."""
        _, end, across = self.edge_mask(self.lattice.valence, self.lattice.valence)
        return end, across

    def vertex_mask(self, valence: int) -> Weights:
        """Weights of an interior vertex, of each edge neighbour, of each face point if any."""
        counts, name = (1, *(valence for _ in self.lattice.orbits)), f"vertex({valence})"
        weights = self._check(name, self.vertex(valence), counts, algebraic=True)
        self._check_local(name, weights, (1, *(0 for _ in self.lattice.orbits)))
        return weights

    def _check_local(self, mask: str, got: Weights, needed: Weights) -> None:
        """Refuse another mask than that of regular meshes where all faces are regular pieces."""
        if self.local and not all(map(_equal, got, needed)):
            raise ValueError(
                f"scheme {self.name!r}: {mask} is ({', '.join(map(str, got))}), but the "
                f"{self.spline.name} needs ({', '.join(map(str, needed))}) at every valence"
            )

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of special corners that there are rules for."""
        return KINDS

    def sector(self, kind: str, faces: int, position: int = 0) -> Sector:
        """A special corner of this scheme's lattice."""
        return Sector(kind, faces, position, self.lattice)

    def __hash__(self) -> int:
        # equal schemes have equal names; masks of Fractions are slow to hash
        return hash(self.name)

    def key(self, valence: int | None) -> dict[str, Any]:
        """All that a subdivision matrix depends on; `valence` if that of a smooth vertex does."""
        size, regular = self.lattice.face_size, self.lattice.valence
        masks: dict[str, Weights] = {
            "edge": self.regular_edge,
            f"vertex({regular})": self.vertex_mask(regular),
            "boundary": (self.boundary_edge, *self.boundary_vertex),
        }
        if self.face is not None:
            masks[f"face({size})"] = self.face_mask(size)
        if valence is not None:
            masks[f"vertex({valence})"] = self.vertex_mask(valence)
        if callable(self.edge) and valence is not None:
            masks["edges"] = self.edge_mask(valence, regular)
        return {"scheme": self.name, "masks": {k: [str(w) for w in v] for k, v in masks.items()}}

    def _check(
        self, mask: str, weights: Weights, counts: tuple[int, ...], algebraic: bool = False
    ) -> Weights:
        """Return `weights`, which must be exact numbers whose sum, with multiplicities, is one."""
        if (
            not hasattr(weights, "__len__")
            or len(weights) != len(counts)
            or not all(
                isinstance(w, (Fraction, int)) or (algebraic and _is_algebraic(w)) for w in weights
            )
        ):
            raise ValueError(
                f"scheme {self.name!r}: {mask} must be {len(counts)} Fractions, got {weights!r}"
            )
        total: Any = sum((w * c for w, c in zip(weights, counts, strict=True)), Fraction(0))
        if not _equal(total, 1):
            raise ValueError(f"scheme {self.name!r}: {mask} sums to {total}, not to 1")
        return tuple(map(exact_weight, weights))


def _is_algebraic(weight: Any) -> bool:
    """Whether it is a real algebraic number of sympy, which is not imported to know that."""
    return bool(getattr(weight, "is_algebraic", False)) and weight.is_real is not False


def _equal(one: Weight, other: Weight) -> bool:
    return bool(one == other or (_is_algebraic(one - other) and (one - other).expand() == 0))


def exact_weight(weight: Any) -> Weight:
    """A Fraction if it is rational."""
    if not _is_algebraic(weight):
        return Fraction(weight)
    return Fraction(int(weight.p), int(weight.q)) if weight.is_Rational else weight
