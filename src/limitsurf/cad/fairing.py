"""Cages made fair: vertices that are free move to where an energy of the surface is least."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf.cad.fairness import Energy, fairness
from limitsurf.cad.solving import minimum
from limitsurf.cage.mesh import Mesh
from limitsurf.integrals.checks import is_exact
from limitsurf.options import Rules
from limitsurf.scheme import schemes
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

# of the mean diagonal of a form: what holds vertices that nothing else does
SPRING = 1e-11


def fair(
    mesh: Mesh | LimitSurface,
    *,
    fixed: ArrayLike | None = None,
    energy: Energy | None = None,
    weights: ArrayLike | None = None,
    boundaries: bool = True,
    creases: bool = True,
) -> Mesh:
    """The cage of the fairest limit surface, of which some vertices stay where they are.

    Of all cages with these vertices it is that of least energy, see `fairness`; with `weights` of
    least energy and sum of the squares of what vertices move, times their weights.

    Parameters
    ----------
    mesh : Mesh or LimitSurface
        Of float64 points, with any number of channels.
    fixed : array_like of int or bool, optional
        Vertices that stay, by number or one bool for each.
    energy : {"membrane", "thin_plate", "variation"}, optional
        As for `fairness`.
    weights : float or (n_vertices,) array_like, optional
        How strongly vertices are held to where they are, from 0 on, inf for fixed ones; 0 by
        default. At w the energy of details of about ``w ** -1/4`` edges, by "thin_plate", is as
        strong as what holds them.
    boundaries, creases : bool
        Whether vertices on boundaries, and on creases and tagged as corners, are fixed too
        (default).

    Returns
    -------
    Mesh
        The same faces and tags with other points.

    Raises
    ------
    TypeError
        For exact points.
    IndexError, ValueError
        For vertices that there are not, weights below 0 or NaN, an energy that surfaces of the
        scheme have not, and where nothing is fixed in a part of the cage: that would shrink to a
        point.

    Notes
    -----
    Where the energy leaves a choice, as it does of the corners of a cube, vertices move least.
    Matrices are factored, as sparse ones: no iteration, the same digits each time
    (``derivations/interpolation.py``).

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[i, j, (i, j) == (2, 2)] for i in range(5) for j in range(5)]
    >>> quads = [
    ...     [5 * i + j, 5 * i + j + 5, 5 * i + j + 6, 5 * i + j + 1]
    ...     for i in range(4) for j in range(4)
    ... ]
    >>> bump = ls.Mesh(points, quads)
    >>> bool(abs(ls.fair(bump).points[:, 2]).max() < 1e-9)
    True
    >>> ls.fair(bump, weights=1).points[12, 2].round(3).item()
    0.273
    """
    surface = as_surface(mesh, "fair")
    cage = surface.mesh
    held = chosen_vertices("fixed", fixed, cage.n_vertices)
    kept = np.zeros(cage.n_vertices, dtype=bool)
    kept[held] = True
    if boundaries:
        kept[cage.edges[cage.boundary_edge]] = True
    if creases:
        kept[cage.creases[0].ravel()] = True
        kept[cage.corners[0]] = True
    pull = _checked_weights(weights, cage.n_vertices)
    kept |= np.isinf(pull)
    form = fairness(surface, energy)
    _refuse_loose(form, kept | (pull > 0))
    free = np.flatnonzero(~kept)
    if not len(free):
        return cage.with_points(cage.points)
    points, centre = centred(cage.points)
    pull = np.where(kept, 0, pull)
    total, scale = sprung(form, pull)
    load = (scale * pull + SPRING)[:, None] * points
    load = load[free] - total[free][:, kept] @ points[kept]
    found = points.copy()
    none = total[:0][:, free]
    found[free] = minimum(total[free][:, free], load, none, load[:0])
    return cage.with_points((found + centre).reshape(cage.points.shape))


def as_surface(mesh: Any, what: str) -> LimitSurface:
    """A surface of float64 points from a cage or itself, whose cage is tagged with its rules."""
    if isinstance(mesh, Mesh):
        mesh = LimitSurface(mesh)
    if not isinstance(mesh, LimitSurface):
        raise TypeError(f"{what} needs a Mesh or LimitSurface, got {type(mesh).__name__}")
    if is_exact(mesh):
        raise TypeError(
            f"{what} needs float64 points, got exact ones: it solves in float64; convert the "
            "points of the cage by astype(float)"
        )
    tagged = vars(Rules.resolve(mesh.mesh))
    other = {name: rule for name, rule in mesh.rules.items() if rule != tagged[name]}
    if not other:
        return mesh
    if "scheme" in other and schemes.get(other["scheme"].name) == other["scheme"]:
        other["scheme"] = other["scheme"].name  # which files can hold
    return LimitSurface(mesh.mesh.with_tags(**other), engine=mesh.engine)


def chosen_vertices(name: str, given: ArrayLike | None, n: int) -> NDArray[np.int64]:
    """Numbers of vertices, from numbers or one bool for each; in their order, repeated or not."""
    if given is None:
        return np.zeros(0, dtype=np.int64)
    found = np.asarray(given)
    if found.dtype == bool:
        if found.shape != (n,):
            raise ValueError(
                f"{name} must be numbers of vertices, or ({n},) booleans, one for each, got "
                f"booleans of shape {found.shape}"
            )
        return np.flatnonzero(found)
    if found.ndim != 1 or (found.size and found.dtype.kind not in "iu"):
        raise ValueError(
            f"{name} must be numbers of vertices, (m,) integers, or ({n},) booleans, got "
            f"{found.dtype} of shape {found.shape}"
        )
    found = found.astype(np.int64)
    bad = found[(found < 0) | (found >= n)]
    if len(bad):
        raise IndexError(
            f"{name}: vertex {bad[0]} (and {len(bad) - 1} more) is not one of the {n} of the cage"
        )
    return found


def centred(points: Array) -> tuple[Array, Array]:
    """Points (n, d) less the middle of their box, and that."""
    flat = points.reshape(len(points), -1)
    centre = flat.min(axis=0) / 2 + flat.max(axis=0) / 2
    return flat - centre, centre


def sprung(form: Any, pull: Array) -> tuple[Any, float]:
    """A form with weights and a weak spring at each vertex, of mean diagonal 1, and its factor."""
    from scipy.sparse import diags_array

    total = form + diags_array(pull)
    mean = float(total.diagonal().mean())
    scale = 1 / mean if mean > 0 else 1.0
    return (scale * total + diags_array(np.full(len(pull), SPRING))).tocsr(), scale


def _checked_weights(weights: ArrayLike | None, n: int) -> Array:
    found = np.asarray(0.0 if weights is None else weights, dtype=float)
    if found.shape not in ((), (n,)):
        raise ValueError(
            f"weights must be one number, or ({n},), one for each vertex, got shape {found.shape}"
        )
    found = np.broadcast_to(found, n)
    bad = np.flatnonzero(~(found >= 0))
    if len(bad):
        raise ValueError(f"weights must not be below 0 or NaN, got {found[bad[0]]} at {bad[0]}")
    return found


def _refuse_loose(form: Any, held: Array) -> None:
    """Refuse parts of the cage that nothing holds; vertices of no energy stay where they are."""
    from scipy.sparse.csgraph import connected_components

    count, part = connected_components(form != 0, directed=False)
    loose = np.ones(count, dtype=bool)
    loose[part[held]] = False
    loose[part[form.diagonal() <= 0]] = False
    bad = np.flatnonzero(loose[part])
    if len(bad):
        raise ValueError(
            f"nothing is fixed in the part of the cage of vertex {bad[0]} ({loose.sum()} parts of "
            f"{count}), which would shrink to a point: give fixed=, or weights= that hold vertices"
        )
