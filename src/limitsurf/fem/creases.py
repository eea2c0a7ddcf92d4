"""Infinitely sharp creases within thin shells: where they are, and what keeps their angles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.fem.grading import Grading
from limitsurf.fem.phantoms import Phantoms
from limitsurf.fem.supports import tangents, turning
from limitsurf.tables.masks import is_infinite

if TYPE_CHECKING:
    from limitsurf.cage.mesh import Mesh
    from limitsurf.fem.space import Space
    from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_ALONG = 4  # Gauss points along creases that keep their angle
_PENALTY = 10.0


@dataclass(frozen=True, eq=False)
class Hinges:
    """Pieces of creases, each within a side of one face and a side of another.

    Attributes
    ----------
    corners : (n, 2) int
        At which these sides begin.
    begin, share : (n, 2)
        A piece runs along the first side from begin on, by so much of the side; along the other
        too if `same`, otherwise from the end of its part there to the beginning.
    same : (n,) bool
        Whether both faces go along the edge in one direction.
    """

    corners: Array
    begin: Array
    share: Array
    same: Array

    def at(self, t: float) -> tuple[Array, Array]:
        """How far along both sides is what is at t of each piece."""
        other = np.where(self.same, t, 1 - t)
        one = self.begin[:, 0] + self.share[:, 0] * t
        return one, self.begin[:, 1] + self.share[:, 1] * other


def hinges(space: Space) -> Hinges:
    """The infinitely sharp creases within the surface of a space."""
    base, grading = space.refined_surface, space.grading
    corners = _creases(base)
    start = base.mesh.indices[corners]
    same = start[:, 0] == start[:, 1]
    if isinstance(grading, Grading):
        return _graded(grading, corners, same)
    if isinstance(grading, Phantoms):
        corners = grading.placed(corners)
    shape = corners.shape
    return Hinges(corners, np.zeros(shape), np.ones(shape), same)


def _creases(surface: LimitSurface) -> Array:
    """Both sides (k, 2), by their corners, of infinitely sharp creases between faces."""
    mesh: Mesh = surface.mesh
    whole = surface.patches.with_limit[surface.limit_faces.first]
    edges, sharpness = mesh.creases
    corners = mesh.edge_corners[mesh.edge_numbers(edges)]
    within = (corners >= 0).all(axis=1) & whole[mesh.corner_face[corners]].all(axis=1)
    return np.asarray(corners[within & is_infinite(sharpness)])


def _graded(grading: Grading, corners: Array, same: Array) -> Hinges:
    """Of sides in parts: each piece is the side of one face, within that of one across."""
    of, part, level = grading.sides
    here = np.flatnonzero(np.isin(of, corners))
    deepest = int(level[here].max(initial=0))
    unit = 1 << deepest
    order = here[np.lexsort((part[here] << (deepest - level[here]), of[here]))]
    key = of[order] * (2 * unit) + (part[order] << (deepest - level[order]))
    length = 1 << (deepest - level[order])
    found = []
    for k in range(2):  # the sides that pieces are, of those that are not coarser than others
        row = np.full(int(of.max(initial=-1)) + 2, -1)
        row[corners[:, k]] = np.arange(len(corners))
        mine = np.flatnonzero(row[of[order]] >= 0)
        crease = row[of[order[mine]]]
        first = key[mine] - of[order[mine]] * (2 * unit)
        turned = ~same[crease]
        across = np.where(turned, unit - first - length[mine], first)
        place = corners[crease, 1 - k] * (2 * unit) + across
        other = np.searchsorted(key, place, side="right") - 1
        kept = length[mine] + (k == 1) <= length[other]  # those of one size once
        mine, other, across, crease = (x[kept] for x in (mine, other, across, crease))
        begin = across - (key[other] - corners[crease, 1 - k] * (2 * unit))
        pair = np.stack([order[mine], order[other]], axis=1)
        starts = np.stack([np.zeros(len(mine)), begin / length[other]], axis=1)
        shares = np.stack([np.ones(len(mine)), length[mine] / length[other]], axis=1)
        turn = slice(None, None, 1 - 2 * k)
        found.append((pair[:, turn], starts[:, turn], shares[:, turn], same[crease]))
    return Hinges(*(np.concatenate(x) for x in zip(*found, strict=True)))


def held(space: Space, creases: Hinges, plane: Array, thickness: Array) -> Any:
    """The stiffness of creases that keep their angle, of moduli and thickness of limit faces."""
    from scipy.sparse import diags_array

    surface, corners = space.surface, creases.corners
    mesh = surface.mesh
    face = surface.limit_faces.first[mesh.corner_face[corners]]  # (k, 2)
    size = _across(space, corners).mean(axis=1)
    slender = (thickness[face] / size[:, None]) ** 2
    stiff = (plane[face] * slender).min(axis=1) / 12
    x, weights = np.polynomial.legendre.leggauss(_ALONG)
    signs = diags_array(np.where(creases.same, 1.0, -1.0))
    total: Any = 0
    for t, weight in zip((x + 1) / 2, weights / 2, strict=True):
        here, there = creases.at(t)
        one, along = turning(space, corners[:, 0], here)
        other, _ = turning(space, corners[:, 1], there)
        length = np.sqrt((along * along).sum(axis=1)) * creases.share[:, 0]
        apart = diags_array(size) @ (one - signs @ other)
        total = total + apart.T @ diags_array(_PENALTY * stiff * weight * length / size) @ apart
    return (total + total.T) / 2


def _across(space: Space, corners: Array) -> Array:
    """How far it is across faces (k, 2) from the middle of a side: area by its length."""
    du, dv, along, unit = tangents(space, corners.ravel(), 0.25)
    area = np.linalg.norm(np.cross(du, dv), axis=1)
    found = area / np.linalg.norm(along, axis=1) * unit[:, 0]
    return np.asarray(found).reshape(corners.shape)
