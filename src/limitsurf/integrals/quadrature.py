"""Points and weights on limit faces, the same for whatever is integrated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf import html, memory, tables
from limitsurf.cage.checks import checked_integer
from limitsurf.engine.places import Places
from limitsurf.integrals.checks import check_rtol, chosen_faces, is_exact
from limitsurf.integrals.rules import Rule
from limitsurf.integrals.tails import KINDS, Kind, Tail, ratios, tail
from limitsurf.numbers import FLOAT64
from limitsurf.patches import STRIP
from limitsurf.pieces import cover
from limitsurf.pieces.cover import Cover, Group
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_POINTS = 64  # per direction, at most


@dataclass(frozen=True, eq=False, repr=False)
class Quadrature:
    """Points on limit faces and their weights, made by `quadrature`.

    The integral of a function over the parameters of limit faces is about the sum of its values at
    the points times `weights`; over the surface, values are to be multiplied by the area element
    ``|x_u x x_v|`` first.

    Attributes
    ----------
    face : (n,) int64
        Limit faces, those of a face together.
    u, v : (n,) float64
    weights : (n,) float64
        With respect to u and v. Some in the last rings around special corners stand for all that
        is beyond, and may be negative.
    offsets : (F + 1,) int64
        Where the points of each face that was asked for begin, and end.
    places : Places
        The same in patches: ``patch``, ``ring``, ``s`` and ``t``. Around special corners (s, t) is
        that of ring 0, ``2 ** ring`` times as far from the corner, and has all its digits.
    accuracy : float
        Of the rings: the largest relative error that their tails leave, of general points; inf
        where the integral is infinite.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> q = ls.quadrature(ls.LimitSurface(square), points=2)
    >>> q, q.weights.tolist()
    (Quadrature(4 points on 1 face), [0.25, 0.25, 0.25, 0.25])
    """

    face: NDArray[np.int64]
    u: NDArray[np.float64]
    v: NDArray[np.float64]
    weights: NDArray[np.float64]
    offsets: NDArray[np.int64]
    places: Places
    accuracy: float

    def __len__(self) -> int:
        return len(self.face)

    def _repr_html_(self) -> str:
        columns = {name: getattr(self, name) for name in ("face", "u", "v", "weights")}
        return html.table(columns, repr(self))

    def __repr__(self) -> str:
        n = len(self.offsets) - 1
        return f"Quadrature({len(self)} points on {n} face{'s' * (n != 1)})"


def quadrature(
    surface: LimitSurface,
    *,
    points: int = 4,
    rtol: float = 1e-12,
    face: ArrayLike | None = None,
    integrand: Kind = "metric",
    channel: str | None = None,
) -> Quadrature:
    """Points and weights on limit faces: Gauss rules on polynomial pieces, and rings with a tail.

    Each piece of a limit face has ``points ** 2`` points: of squares exact for polynomials of
    degree ``2 points - 1`` in each parameter, of triangles for those of total degree
    ``2 points - 2``. No piece goes across a line where pieces meet, so that n-gons and semi-sharp
    creases cost no digits. Around a special corner there are rings of three pieces, as many as its
    eigenvalues ask for; the last ones are weighted so that they stand for all beyond. Weights do
    not depend on the points of the cage.

    Parameters
    ----------
    surface : LimitSurface
    points : int
        Per direction in each piece, 1 to 64.
    rtol : float
        Up to which relative error rings are followed, at least 1e-15. That of the pieces depends on
        `points` and on how smooth the integrand is in a piece; `area` and others choose themselves.
    face : array_like of int, optional
        Limit faces, any number in any order; all by default. Those without a limit have no points.
    integrand : {"metric", "polynomial", "curvature"}
        What is integrated, which tells how fast rings fall: functions of position, normal and area
        element, or of first derivatives on the surface ("metric", default); polynomials in
        positions and their derivatives by u and v ("polynomial"), such as mass and stiffness in
        parameters; products of two second derivatives on the surface ("curvature").
    channel : str, optional
        A face-varying channel, whose pieces are taken instead of those of the points.

    Returns
    -------
    Quadrature

    Raises
    ------
    IndexError
        For a face out of range.
    TypeError
        For exact points: the places of Gauss rules are irrational.
    ValueError
        For points, an rtol or an integrand out of range.
    MemoryError
        At once, for more points than there is memory for.

    Notes
    -----
    With the two largest eigenvalues a and b after 1, and m the next, ring n is of the order of
    ``(a b)^n`` for "metric", and of ``(m / b)^(2 n)`` for "curvature" where a = b: in
    Catmull-Clark's scheme 0.17 and 0.17 at valence 3, 0.30 and 0.38 at 5, 0.40 and 0.83 at 12. Up
    to four ratios are eliminated (``derivations/integrals.py``), which leaves 9, 13 and 19 rings
    for "metric", and 11, 17 and 66 for "curvature", to the default `rtol`. There are at most 100;
    where these do not do, `Quadrature.accuracy` tells what they reach: 3e-8 at valence 20.
    Around sharp corners of several faces, also where parts of a cage touch in a vertex, "curvature"
    is infinite in general: there are 40 rings, and the accuracy is inf.

    Examples
    --------
    >>> import numpy as np
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> surface = ls.LimitSurface(square)
    >>> q = ls.quadrature(surface)
    >>> jet = surface.jet(q.face, q.u, q.v, order=1)
    >>> element = np.linalg.norm(np.cross(jet[1, 0], jet[0, 1]), axis=1)
    >>> round(float(q.weights @ element), 12)
    2.0
    """
    if not isinstance(surface, LimitSurface):
        raise TypeError(f"quadrature needs a LimitSurface, got {type(surface).__name__}")
    surface = surface.of_channel(channel)
    if checked_integer("points", points, 1) > _POINTS:
        raise ValueError(f"points must be 1 to {_POINTS} per direction, got {points}")
    check_rtol(rtol)
    if integrand not in KINDS:
        raise ValueError(f"integrand must be one of {', '.join(KINDS)}, got {integrand!r}")
    if is_exact(surface):
        raise TypeError(
            "the points of Gauss rules are irrational: give float64 points; volume, and centroid "
            "and inertia of the body, know Fractions"
        )
    faces = chosen_faces(surface, face)
    return _made(surface, faces, Rule.of(surface.topology.rules.scheme, points), integrand, rtol)


def refuse_infinite(surface: LimitSurface) -> None:
    """Refuse corners around which squares of second derivatives grow from ring to ring."""
    patches, scheme = surface.patches, surface.topology.rules.scheme
    covered = Cover.of(patches, np.flatnonzero(patches.with_limit))
    kind = patches.kind[covered.patch]
    for one in np.unique(kind[kind > STRIP]).tolist():
        sector = patches.sectors[one]
        if sector is None or one in patches.rings:
            continue
        if ratios(tables.eigen_table(scheme, sector), "curvature")[0] > 1 + 1e-9:
            faces = np.flatnonzero(patches.with_limit)
            face = int(faces[covered.owner[np.flatnonzero(kind == one)[0]]])
            raise ValueError(
                f"energies of second derivatives are infinite around a corner of limit face {face} "
                f"that is {sector.place}, towards which the surface narrows to a line: make it "
                "smooth, or part the cage there, as by ls.selected"
            )


def _made(
    surface: LimitSurface, faces: Array, rule: Rule, integrand: Kind, rtol: float
) -> Quadrature:
    """The rule on the pieces of limit faces."""
    patches, scheme = surface.patches, surface.topology.rules.scheme
    covered = Cover.of(patches, faces)
    kind = patches.kind[covered.patch]
    tails: dict[int, Tail] = {}
    for one in np.unique(kind[kind > STRIP]).tolist():
        sector = patches.sectors[one]
        assert sector is not None
        if one in patches.rings:  # more faces than there are tables for change little
            sector = scheme.sector(sector.kind, tables.MOST_FACES)
        tails[one] = tail(tables.eigen_table(scheme, sector), integrand, rtol)
    counts = np.zeros(max([*tails, STRIP]) + 1, dtype=np.int64)
    counts[[*tails]] = [len(x.factors) for x in tails.values()]
    strips = tables.strips_of(scheme, patches.sharpness, FLOAT64)
    n, groups = cover.grouped(patches, covered, counts[kind], *strips)
    each = len(rule.weights)
    memory.refuse_beyond(n * each, 72, "points of a rule", "choose fewer points, or faces")
    owner, ring, patch = np.empty((3, n), dtype=np.int64)
    u, v, s, t, weights = np.empty((5, n, each))
    for g in groups:
        cells = g.cells
        owner[cells] = covered.owner[g.members][:, None]
        patch[cells] = covered.patch[g.members][:, None]
        x, y = (
            g.origin[:, k, None] + g.size[:, k, None] * z for k, z in enumerate((rule.s, rule.t))
        )
        level, factor = np.zeros(len(x), dtype=np.int64), np.ones(len(x))
        if g.kind > STRIP:
            level = np.repeat(np.arange(g.count), len(x) // max(g.count, 1))
            factor = tails[g.kind].factors[level]
        own = factor * np.abs(g.size.prod(axis=1))
        weights[cells] = np.ldexp(
            (own[:, None] * rule.weights)[None], -2 * covered.level[g.members][:, None, None]
        )
        u[cells], v[cells] = _in_faces(patches.lattice, covered, g, x, y)
        if g.kind in patches.rings:  # without an eigenbasis: as (s, t) itself
            level = 0 * level
        ring[cells], s[cells], t[cells] = level, *(np.ldexp(z, level[:, None]) for z in (x, y))
    count = each * np.bincount(owner, minlength=len(faces))
    offsets = np.concatenate([[0], np.cumsum(count)])
    places = Places(np.repeat(patch, each), np.repeat(ring, each), s.ravel(), t.ravel())
    accuracy = max((x.accuracy for x in tails.values()), default=0.0)
    flat = u.ravel(), v.ravel(), weights.ravel()
    return Quadrature(np.repeat(faces[owner], each), *flat, offsets, places, accuracy)


def _in_faces(lattice: Any, covered: Cover, g: Group, s: Array, t: Array) -> tuple[Array, Array]:
    """Places (c, Q) of patches as those of their limit faces, (P, c, Q) each."""
    turns = np.array(lattice.turns, dtype=float)[g.turn]  # (P, 3, 2)
    base, along, across = (turns[:, k, :, None, None] for k in range(3))
    place = base + along * s + across * t  # (P, 2, c, Q)
    here = g.members
    sign, corner = covered.sign[here], covered.place[here]
    place = corner[:, :, None, None] + sign[:, None, None, None] * place
    place = np.ldexp(place, -covered.level[here][:, None, None, None])
    return place[:, 0], place[:, 1]
