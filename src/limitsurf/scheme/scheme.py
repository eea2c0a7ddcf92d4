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

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from fractions import Fraction
from functools import lru_cache, partial
from itertools import islice
from typing import Any, Self

from limitsurf.scheme.lattice import QUADS, TRIANGLES, Child, Lattice
from limitsurf.scheme.masks import (
    MaskValues,
    Still,
    Weight,
    Weights,
    advice_on,
    alike,
    as_mask,
    checked_name,
    is_iterable,
    mean_of_corners,
    regular_masks,
    regular_shape,
    shown,
    too_large,
    travels,
)
from limitsurf.scheme.sector import KINDS, Sector
from limitsurf.scheme.spline import BICUBIC, BILINEAR, LINEAR, QUARTIC, Spline

# what regular faces become, the first of each lattice if nothing is said
_SPLINES = {
    "bicubic": (QUADS, BICUBIC),
    "bilinear": (QUADS, BILINEAR),
    "quartic": (TRIANGLES, QUARTIC),
    "linear": (TRIANGLES, LINEAR),
}


@dataclass(frozen=True, init=False)
class Scheme:
    """Masks of a primal subdivision scheme.

    Of quads, or of triangles; where all is regular it makes a spline. Nothing but the masks of
    vertices has to be given: all others are then those of the spline. `DualScheme` is for schemes
    that cut corners.

    Parameters
    ----------
    name : str
        What the scheme is called in messages, tables and files; none of `limitsurf.schemes`.
    vertex : callable, N -> numbers, or mapping {N: numbers}
        Weights in the vertex point of an interior vertex of valence ``N``: of the vertex, of each
        edge neighbour and, of quads, of each adjacent face point. Fractions, or real algebraic
        numbers of sympy. A mapping lacks the regular valence at will; it is what travels best to
        other processes. Only splines of degree 1 need none.
    face : callable, n -> n Fractions, or mapping, optional
        Weights of the corners of a face of ``n`` corners in its face point; of triangles None.
        They are all alike, as a face has no first corner: by default ``1 / n`` each.
    edge : (Fraction, Fraction), optional
        Weight of each end point, and of each adjacent face point, in an edge point; without face
        points of each opposite corner. Or a callable: the valences of both ends -> the weights of
        the first end, of the second, and of what lies across; with the valences exchanged it gives
        the first two exchanged, as no end is the first. Ends that are sharp or on boundaries count
        as regular. Where a regular end meets another, these are the *spokes* of that vertex, by
        which waves around it, the tangent plane and saddles among them, are scaled. A surface with
        spokes of its own is evaluated by NumPy; it has no Bezier patches and no queries that stand
        on them, and at ends of sharp creases, and vertices of more than 64 faces, none at all.
    boundary_edge : Fraction, optional
        Weight of each end point in the edge point of a boundary edge.
    boundary_vertex : (Fraction, Fraction), optional
        Weight of the vertex, and of each boundary neighbour, in a smooth boundary's vertex point.
    paper : str, optional
        Where the masks are published.
    smooth_triangle : Fraction, optional
        Under the triangle rule "smooth", what a triangle contributes instead of ``edge[1]`` to the
        common weight of the two face points in an edge point, the mean of its two faces'
        contributions; the end points share the rest. None if there is no such rule.
    lattice : {"quads", "triangles"}
        What regular faces are. By default those that the `spline` is of, or else quads.
    spline : {"bicubic", "bilinear", "quartic", "linear"}, optional
        What the scheme makes of a regular lattice: of quads the bicubic B-spline, by default, or
        that of degree 1; of triangles the quartic box spline, by default, or that of degree 1.

    Raises
    ------
    ValueError
        When the name is that of a scheme of the library; when a mask, of a `face` or `vertex` when
        it is first needed, raises, has floats or the wrong number of weights, does not sum to one,
        is not symmetric, or changes from call to call; when the masks of a regular vertex are not
        those of the `spline`; and, as `UnsupportedSpectrum` where a smooth vertex or a dart of so
        many faces is first used, when refinement there does not converge (an eigenvalue other than
        1 has modulus 1 or more) or, at a smooth vertex, the pair that outweighs all else is complex
        or negative. Errors name scheme, mask, valence, what was found and what is needed.

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

    Tables are kept by the values of the masks, whatever the name. A pickle, as processes and
    clusters send it, holds functions of modules by name, and of all others (those of scripts and
    notebooks, lambdas) their values at valences to 32 and at those that were asked for.

    Examples
    --------
    >>> from fractions import Fraction as F
    >>> import limitsurf as ls
    >>> plain = ls.Scheme("plain", vertex=lambda N: (F(1, 2), F(1, 4 * N), F(1, 4 * N)))
    >>> [str(weight) for weight in plain.vertex_mask(5)]
    ['1/2', '1/20', '1/20']
    >>> even = ls.Scheme("even", lattice="triangles", vertex={5: (F(1, 2), F(1, 10))})
    >>> [str(weight) for weight in even.vertex_mask(6)]
    ['5/8', '1/16']
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

    def __init__(
        self,
        name: str,
        *,
        vertex: Callable[[int], Weights] | Mapping[int, Weights] | None = None,
        face: Callable[[int], Sequence[Weight]] | Mapping[int, Weights] | None = None,
        edge: Sequence[Fraction] | Callable[[int, int], Weights] | None = None,
        boundary_edge: Fraction | None = None,
        boundary_vertex: Sequence[Fraction] | None = None,
        paper: str = "not published",
        smooth_triangle: Fraction | None = None,
        lattice: Lattice | str | None = None,
        spline: Spline | str | None = None,
    ) -> None:
        found, piece = regular_shape(name, lattice, spline, _SPLINES)
        own_face, own_edge, own_vertex, (half,), curve = regular_masks(found, piece)
        if face is None and found.face_points:
            face = mean_of_corners
        if vertex is None and len(piece.template) == found.face_size:
            vertex = Still(own_vertex)
        elif vertex is None:
            needed = (
                "(vertex, neighbour, face point)" if found.face_points else "(vertex, neighbour)"
            )
            raise ValueError(
                f"scheme {name!r}: vertex is missing: a function of the valence N, or a mapping "
                f"{{N: {needed}}}"
            )
        masks = {
            "name": checked_name(name),
            "face": as_mask(name, face, found.face_size, own_face),
            "edge": own_edge if edge is None else edge,
            "vertex": as_mask(name, vertex, found.valence, own_vertex),
            "boundary_edge": half if boundary_edge is None else boundary_edge,
            "boundary_vertex": curve if boundary_vertex is None else boundary_vertex,
            "paper": paper,
            "smooth_triangle": smooth_triangle,
            "lattice": found,
            "spline": piece,
        }
        if smooth_triangle is not None and not isinstance(smooth_triangle, (Fraction, int)):
            raise ValueError(
                f"scheme {name!r}: smooth_triangle is {advice_on(smooth_triangle, False)}"
            )
        self.__dict__.update(masks)
        self.__post_init__()

    def __post_init__(self) -> None:
        # tuples of Fractions, whatever sequences and integers were given
        set_field = partial(object.__setattr__, self)
        self.__dict__["_asked"] = {}
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
        needed = regular_masks(self.lattice, self.spline)
        for (mask, got), need in zip(own.items(), needed, strict=True):
            if tuple(got) != need:
                raise ValueError(
                    f"scheme {self.name!r}: {mask} is ({', '.join(map(str, got))}), "
                    f"but the {self.spline.name} needs ({', '.join(map(str, need))})"
                )

    @property
    def _asked(self) -> dict[tuple[str, tuple[int, ...]], Any] | None:
        """What masks were at each valence; None if they may change."""
        return self.__dict__.get("_asked")

    def __copy__(self) -> Self:
        # not checked as a new scheme is, and its masks may be others from then on
        made = object.__new__(type(self))
        made.__dict__.update(self._given())
        return made

    def __deepcopy__(self, memo: Any) -> Self:
        return self

    def __getstate__(self) -> dict[str, Any]:
        state = self._given()
        for mask in ("face", "edge", "vertex", "corner"):
            function = state.get(mask)
            if callable(function) and not travels(function):
                state[mask] = self._values_of(mask, function)
        return state

    def _given(self) -> dict[str, Any]:
        """The fields that are the scheme's own, not its class's."""
        own = vars(self)
        return {x.name: own[x.name] for x in fields(self) if x.name in own}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _asked={})

    def _values_of(self, mask: str, function: Callable[..., Any]) -> MaskValues:
        """A mask by its values at valences that are likely to be met, and those that were."""
        every: list[tuple[int, ...]] = [(n,) for n in range(2 if mask == "vertex" else 3, 33)]
        if mask == "edge":
            every = [(a, b) for a in range(2, 17) for b in range(2, 17)]
            regular = self.lattice.valence
            every += [at for n in range(2, 33) for at in ((n, regular), (regular, n))]
        asked = [at for which, at in self._asked or () if which == mask]
        values = {}
        for at in dict.fromkeys(asked + every):
            try:
                values[at] = tuple(self._ask(mask, function, *at))
            except ValueError:  # it is not told until it is needed
                if at in asked:
                    raise
        return MaskValues(tuple(values.items()), travelled=True)

    def _ask(self, mask: str, function: Callable[..., Any], *at: int) -> Any:
        """What a mask is at some valence, which must be what it was before."""
        told = f"scheme {self.name!r}: {mask}{at if len(at) > 1 else f'({at[0]})'}"
        asked = self._asked
        try:
            got = again = function(*at)
            if asked is not None and (mask, at) not in asked:
                again = function(*at)
        except (Exception, SystemExit) as error:
            if isinstance(function, MaskValues):
                raise ValueError(f"{told} {function.missing(at)}") from None
            raise ValueError(f"{told} raised {type(error).__name__}: {error}") from error
        if asked is None:
            return got
        got, again = (tuple(islice(x, max(3, *at) + 1)) if is_iterable(x) else x
                      for x in (got, again))  # fmt: skip
        before = asked.setdefault((mask, at), again)
        if not alike(before, got):
            raise ValueError(
                f"{told} is {shown(got)}, but was {shown(before)} when it was asked before; a "
                "mask must depend on its valence alone"
            )
        return got

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
        if self.face is None:
            return ()
        weights = self._check(f"face({n})", self._ask("face", self.face, n), (1,) * n)
        if self._asked is not None and len(set(weights)) > 1:
            raise ValueError(
                f"scheme {self.name!r}: face({n}) is {shown(weights)}; a face has no first corner: "
                f"all {n} weights must be alike, 1/{n}"
            )
        return weights

    def edge_mask(self, first: int, second: int) -> Weights:
        """Weights in an interior edge point, by the valences of its ends: of each, and across."""
        if not callable(self.edge):
            return self.edge[0], *self.edge
        ends, found = [(first, second), (second, first)], []
        for pair in ends:
            name = f"edge({pair[0]}, {pair[1]})"
            got = self._ask("edge", self.edge, *pair)
            found.append(self._check(name, got, (1, 1, 2), algebraic=True))
        (one, other, across), turned = found
        if first == second and not _equal(one, other):
            raise ValueError(
                f"scheme {self.name!r}: edge{ends[0]} is ({', '.join(map(str, found[0]))}); an "
                "edge has no first end: between equal valences the first two weights must be alike"
            )
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

    def has_own_spokes(self, valence: int) -> bool:
        """Whether edges from a vertex of that valence to regular ones have masks of their own.

        What is next to the vertex is then no piece of the spline until it is refined once more:
        ``derivations/spokes.py``.
        """
        if not callable(self.edge):
            return False
        regular = self.lattice.valence
        return self.edge_mask(valence, regular) != self.edge_mask(regular, regular)

    def pieces_of(self, sector: Sector) -> tuple[Child, ...]:
        """The pieces of the spline around a special corner, of half the face or of a quarter."""
        fine = sector.kind == "interior" and self.has_own_spokes(sector.faces)
        return self.lattice.fine_pieces if fine else self.lattice.pieces

    @property
    def regular_edge(self) -> tuple[Fraction, Fraction]:
        """Weight of each end, and of what lies across, where both ends are regular."""
        _, end, across = self.edge_mask(self.lattice.valence, self.lattice.valence)
        return end, across

    def vertex_mask(self, valence: int) -> Weights:
        """Weights of an interior vertex, of each edge neighbour, of each face point if any."""
        counts, name = (1, *(valence for _ in self.lattice.orbits)), f"vertex({valence})"
        got = self._ask("vertex", self.vertex, valence)
        weights = self._check(name, got, counts, algebraic=True)
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
        if not hasattr(weights, "__len__") or len(weights) != len(counts):
            raise ValueError(
                f"scheme {self.name!r}: {mask} must be {len(counts)} Fractions, got "
                f"{shown(weights)}"
            )
        for k, w in enumerate(weights):
            if not is_exact(w) or not (algebraic or isinstance(w, (Fraction, int))):
                raise ValueError(
                    f"scheme {self.name!r}: {mask} must be {len(counts)} Fractions, got "
                    f"{shown(weights)}: weight {k} is {advice_on(w, algebraic)}"
                )
        total: Any = sum((w * c for w, c in zip(weights, counts, strict=True)), Fraction(0))
        if not _equal(total, 1):
            raise ValueError(f"scheme {self.name!r}: {mask} sums to {total}, not to 1")
        return tuple(map(exact_weight, weights))


def _is_algebraic(weight: Any) -> bool:
    """Whether it is a real algebraic number of sympy, which is not imported to know that."""
    return hasattr(weight, "is_algebraic") and _is_real_algebraic(weight)


@lru_cache(maxsize=4096)
def _is_real_algebraic(number: Any) -> bool:
    if not number.is_number or number.is_Float or number.is_finite is False:
        return False
    if number.is_real is None or number.is_algebraic is None:  # sympy does not see it
        value = number.evalf(30)
        return bool(value.is_real and value.is_finite) and _made_of_algebraic(number)
    return bool(number.is_algebraic and number.is_real)


def _made_of_algebraic(number: Any) -> bool:
    """Whether it is made by sums, products and rational powers of such that sympy sees."""
    if number.is_algebraic:
        return True
    parts = number.args
    if number.is_Pow:
        parts = number.args[:1] if number.args[1].is_Rational else ()
    elif not (number.is_Add or number.is_Mul):
        return False
    return bool(parts) and all(map(_made_of_algebraic, parts))


def is_exact(weight: Any) -> bool:
    """Whether it is a Fraction, an integer or a real algebraic number of sympy, not too large."""
    if isinstance(weight, (Fraction, int)):
        return not isinstance(weight, bool) and not too_large(weight)
    return _is_algebraic(weight) and not too_large(weight)


@lru_cache(maxsize=4096)
def _equal(one: Weight, other: Weight) -> bool:
    if one == other:
        return True
    apart = one - other
    if not _is_algebraic(apart):
        return False
    # to as many digits as all else is decided by
    return bool(abs(apart.evalf(80)) < 10**-60)


def exact_weight(weight: Any) -> Weight:
    """A Fraction if it is rational."""
    if not _is_algebraic(weight):
        return Fraction(weight)
    return Fraction(int(weight.p), int(weight.q)) if weight.is_Rational else weight
