"""Cages whose limit passes through points, with normals: of all, that of the fairest surface."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf import html
from limitsurf.cad.conditions import Conditions
from limitsurf.cad.fairing import as_surface
from limitsurf.cad.fairness import Energy, checked_energy
from limitsurf.cad.interpolation import Wanted, wanted
from limitsurf.cage.checks import checked_integer
from limitsurf.cage.mesh import Mesh
from limitsurf.surface import LimitSurface

Array = NDArray[Any]
Refine: TypeAlias = bool | int | Literal["auto"]

_MOST = 3  # refinements


@dataclass(frozen=True, eq=False, repr=False)
class Interpolation:
    """A cage whose limit passes through points, made by `interpolate`.

    Attributes
    ----------
    mesh : Mesh
        The cage. If it was refined, the vertices of the one that was given come first, in their
        order; else it has its faces and tags.
    levels : int
        How often it was refined.
    errors : (m,) float64
        How far the limit is from each point; NaN for vertices that were left out: fixed ones, those
        without a limit, and of weight 0.
    residual : float
        The largest of those that were to be 0, relative to the size of the points.
    normal_errors : (m,) float64
        Angles in radians to the normals that were asked for; NaN where none was.
    rank : int
        Conditions that count: of points that are to be passed through, or with normals of their
        coordinates and two for each normal. Fewer than `conditions` if some depend on others.
    conditions : int
    condition : float
        The largest singular value of the conditions over the smallest, to about 1 in 100: by how
        much the cage may move more than the points. inf, or a large number, if `rank` is less.

    Examples
    --------
    >>> import limitsurf as ls
    >>> tetrahedron = ls.Mesh(
    ...     [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
    ...     [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]],
    ... )
    >>> ls.interpolate(tetrahedron)
    Interpolation(4 vertices, 4 conditions of rank 4, condition 4.5)
    """

    mesh: Mesh
    levels: int
    errors: NDArray[np.float64]
    residual: float
    normal_errors: NDArray[np.float64]
    rank: int
    conditions: int
    condition: float

    def __repr__(self) -> str:
        refined = f", refined {_times(self.levels)}" if self.levels else ""
        return (
            f"Interpolation({self.mesh.n_vertices} vertices{refined}, {self.conditions} conditions "
            f"of rank {self.rank}, condition {self.condition:.3g})"
        )

    def _repr_html_(self) -> str:
        names = ("levels", "residual", "rank", "conditions", "condition")
        return html.facts(repr(self), {name: f"{getattr(self, name):.6g}" for name in names})


def interpolate(
    mesh: Mesh | LimitSurface,
    points: ArrayLike | None = None,
    *,
    vertices: ArrayLike | None = None,
    places: tuple[ArrayLike, ArrayLike, ArrayLike] | None = None,
    normals: ArrayLike | None = None,
    fairness: Energy | None = None,
    weights: ArrayLike | None = None,
    fixed: ArrayLike | None = None,
    refine: Refine = "auto",
) -> Interpolation:
    """A cage whose limit passes through points, at vertices or anywhere, with normals if asked.

    Of all such cages it is that of the fairest surface. By default the limit passes through the
    vertices of the cage themselves.

    Parameters
    ----------
    mesh : Mesh or LimitSurface
        Faces and tags, which stay, and points of float64 with any number of channels.
    points : (m, ...) array_like, optional
        One for each vertex, for each of `vertices`, or for each of `places`. By default those of
        the cage.
    vertices : array_like of int or bool, optional
        At which the limit is to pass through the points; all by default.
    places : (face, u, v), optional
        Where else it is to pass through them: limit faces and parameters, of (m,) each.
    normals : (m, 3) array_like, optional
        Of any length; NaN where none is asked for. At creases that of the side of the vertex's
        first face, or of the face that `places` name.
    fairness : {"membrane", "thin_plate", "variation"}, optional
        The energy by which surfaces are compared, see `ls.fairness`.
    weights : float or (m,) array_like, optional
        inf for points that the limit is to pass through (default). With finite ones the sum of the
        squares of distances, times weights, and of the energy is least. 0 leaves a point out.
    fixed : array_like of int or bool, optional
        Vertices of the cage that stay where they are; in a refined cage where refinement puts them.
        The limit is not asked to pass through these unless `vertices` says so. Parts of the cage
        that no point is on are fixed, too.
    refine : {"auto", True, False} or int
        Whether the cage is refined first, or how often, which gives more freedom; "auto" where the
        conditions have no solution, or none that is stable, without it.

    Returns
    -------
    Interpolation
        ``mesh``, and how well it does: ``errors``, ``residual``, ``rank``, ``condition``.

    Raises
    ------
    TypeError
        For exact points.
    IndexError, ValueError
        For what is not finite or of another shape, vertices and places that there are not, or that
        have no limit or no normal, points of one place that differ; where the points determine no
        cage without refinement and ``refine=False``; where no cage passes through them after it; to
        refine in schemes whose vertices do not stay ("doo-sabin").

    Warns
    -----
    UserWarning
        Where "auto" refined, and why; where conditions depend on others even so, and the cage is
        that which moves least; where a normal came out reversed.

    Notes
    -----
    Limits at the vertices of a cage may depend on each other: on a cube those of the vertices, with
    signs by turns, add up to 0, so that general points have no cage, and some have many; so they do
    on prisms of 4, 6, 8, .. sides. After one refinement they never do. From a condition of 1e4 on
    they count as dependent.

    Where there are as many points as vertices no choice is left to fairness, and vertices may move
    by more than the size of the cage: say ``refine=True`` for a fairer surface. Matrices are
    factored, as sparse ones, and residuals are those of rounding.

    Halstead, Kass and DeRose, "Efficient, fair interpolation using Catmull-Clark surfaces",
    SIGGRAPH 1993; ``derivations/interpolation.py``.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> found = ls.interpolate(ls.Mesh(points, quads), refine=True)
    >>> found
    Interpolation(26 vertices, refined once, 8 conditions of rank 8, condition 1.53)
    >>> bool(abs(ls.refined(found.mesh, 0).limit_points[:8] - points).max() < 1e-14)
    True
    """
    surface = as_surface(mesh, "interpolate")
    if fairness is not None:
        checked_energy(fairness)
    asked = wanted(surface, points, vertices, places, normals, weights, fixed)
    least, most = _levels(refine, surface, asked)
    conditions, reason = Conditions(asked, asked.level, fairness), ""
    for count in range(most + 1):
        if count:
            conditions = conditions.finer()
        if count < least:
            continue
        found = conditions.solved()
        if found is not None:
            if reason:
                text = f"{reason}: the cage was refined {_times(count)}"
                warnings.warn(text, UserWarning, stacklevel=2)
            return _record(surface, conditions, found, count)
        reason = conditions.reason()
    if not most:
        advice = "give finite weights"
        if not surface.topology.lattice.dual:
            advice = 'say refine="auto" or True, give finite weights'
        raise ValueError(f"{reason}: {advice}, or leave points out")
    found = conditions.fairest()
    conditions.refuse_missed(found, reason)
    text = f"{reason}, even though the cage was refined {_times(most)}: they are met all the same"
    warnings.warn(text, UserWarning, stacklevel=2)
    return _record(surface, conditions, found, most)


def _levels(refine: Refine, surface: LimitSurface, asked: Wanted) -> tuple[int, int]:
    """How often the cage is refined at least and at most."""
    dual = surface.topology.lattice.dual
    if isinstance(refine, str):
        if refine != "auto":
            raise ValueError(f'refine must be "auto", True, False or a number, got {refine!r}')
        normals = not np.isnan(asked.normals).all()
        return 0, 0 if dual else 1 + normals
    count = int(refine) if isinstance(refine, bool | np.bool_) else refine
    count = checked_integer("refine", count, 0)
    if count > _MOST:
        raise ValueError(f"refine must be at most {_MOST} times, got {count}")
    if dual and count:
        raise ValueError(
            "cages of scheme "
            f"{surface.topology.rules.scheme.name!r} have other vertices once they are refined, so "
            "that those of the cage do not come first: say refine=False"
        )
    return count, count


def _record(
    surface: LimitSurface, conditions: Conditions, found: Array, count: int
) -> Interpolation:
    """The record of a cage, with a warning of normals that are reversed."""
    asked = conditions.asked
    errors, angles = np.full((2, asked.given), np.nan)
    errors[asked.number], angles[asked.number] = conditions.errors(found)
    bad = np.flatnonzero(angles > np.pi / 2)
    if len(bad):
        text = f"normal {bad[0]} (and {len(bad) - 1} more) came out reversed"
        warnings.warn(f"{text}: the surface folds there", UserWarning, stacklevel=3)
    mesh = surface.mesh if not count else conditions.level.mesh
    tail = surface.mesh.points.shape[1:]
    hard = errors[asked.number[asked.hard]]
    return Interpolation(
        mesh.with_points((found + conditions.centre).reshape(-1, *tail)),
        count,
        errors,
        float(hard.max(initial=0) / asked.size) if asked.size else float(hard.max(initial=0)),
        angles,
        conditions.rank,
        conditions.count,
        conditions.condition,
    )


def _times(count: int) -> str:
    return {1: "once", 2: "twice"}.get(count, f"{count} times")
