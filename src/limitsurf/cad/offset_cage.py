"""Cages whose limit is near an offset of a surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import html
from limitsurf.cage.checks import checked_integer
from limitsurf.cage.mesh import Mesh
from limitsurf.refine import refined
from limitsurf.scheme import schemes
from limitsurf.surface import LimitSurface

Array = NDArray[Any]

_ACROSS = 1e-3  # weight of what a place is off across the normal
_STILL = 1e-9  # weight of moves that no place asks for


@dataclass(frozen=True, eq=False, repr=False)
class OffsetCage:
    """A cage whose limit is near an offset, made by `OffsetSurface.fit`.

    Attributes
    ----------
    mesh : Mesh
        The cage: that of the surface, refined `levels` times, with other points, and the scheme
        and rules of the surface as its tags.
    base : Mesh
        That of the surface, refined as often: vertices and faces are those of `mesh`.
    levels : int
    along_normal, parametric : float
        The largest differences to the offset at the same parameters, along its normal and as a
        whole, found at other places than those that were fitted. Along mitred creases the second
        is as large as mitres are.
    tolerance : float, or None
        What was asked for.
    met : bool
        Whether `along_normal` is within it, or there is none.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> ls.offset(ls.LimitSurface(square), 0.5).fit().met
    True
    """

    mesh: Mesh
    base: Mesh
    levels: int
    along_normal: float
    parametric: float
    tolerance: float | None
    met: bool

    def __repr__(self) -> str:
        n = self.mesh.n_vertices
        return f"{type(self).__name__}({n} vertices, within {self.along_normal:.3g})"

    def _repr_html_(self) -> str:
        names = ("levels", "along_normal", "parametric", "tolerance", "met")
        return html.facts(type(self).__name__, {name: getattr(self, name) for name in names})

    @property
    def surface(self) -> LimitSurface:
        """The limit surface of the cage."""
        return LimitSurface(self.mesh)


def offset_cage(
    known: LimitSurface, distance: float, tolerance: float | None, levels: int, workers: int
) -> OffsetCage:
    """That of an offset at a distance, refined at most so often."""
    levels = checked_integer("levels", levels, 0)
    mesh = _tagged(known.mesh, known)
    k = 0
    while True:
        surface = LimitSurface(mesh, engine=known.engine)
        moves = _moves(surface, distance, workers)
        cage = mesh.with_points(mesh.points + moves)
        along, whole = _off(surface, cage, distance, workers)
        met = tolerance is None or along <= tolerance
        if met or k == levels:
            return OffsetCage(cage, mesh, k, along, whole, tolerance, met)
        mesh, k = _tagged(refined(mesh, 1, **known.rules), known), k + 1


def _tagged(mesh: Mesh, surface: LimitSurface) -> Mesh:
    """A plain mesh of the surface's own scheme and rules."""
    names = ("creases", "corners", "holes", "face_data", "units", "up")
    tags = {name: getattr(mesh, name) for name in names}
    return Mesh(mesh.points, (mesh.sizes, mesh.indices), **tags, **named_rules(surface))


def named_rules(surface: LimitSurface) -> dict[str, Any]:
    """Its scheme and rules, with the scheme by its name if it is built in."""
    rules = surface.rules
    name = rules["scheme"].name
    if name in schemes and schemes[name] is rules["scheme"]:
        rules["scheme"] = name
    return rules


def _places(surface: LimitSurface, line: Array) -> tuple[Array, Array, Array]:
    """Places inside all limit faces."""
    faces = np.flatnonzero(surface.patches.with_limit)
    u, v = (x.ravel() for x in np.meshgrid(line, line, indexing="ij"))
    if surface.topology.lattice.sloped:
        v = v * (1 - u)
    face = np.repeat(faces, len(u))
    return face, np.tile(u, len(faces)), np.tile(v, len(faces))


def _rims(surface: LimitSurface) -> tuple[Array, Array, Array]:
    """Places on the edges of limit faces at open edges of the cage."""
    from limitsurf.cad.edges import places

    mesh, ends = surface.mesh, surface.limit_faces
    there = np.ones(mesh.n_faces, dtype=bool)
    there[ends.face[~surface.patches.with_limit]] = False
    half = np.flatnonzero(mesh.boundary_edge[mesh.corner_edge] & there[mesh.corner_face])
    s = np.tile((np.arange(6) + 0.5) / 6, (len(half), 1))
    face, u, v = places(surface, half, s)
    return face.ravel(), u.ravel(), v.ravel()


def _moves(surface: LimitSurface, distance: float, workers: int) -> Array:
    """Moves (n, 3) of control points: least squares of d n at many places."""
    from scipy.sparse import block_diag, csr_array, diags_array, hstack, vstack
    from scipy.sparse.linalg import splu

    inner = _places(surface, (np.polynomial.legendre.leggauss(4)[0] + 1) / 2)
    parts, loads = [], []
    n = surface.mesh.n_vertices
    for where, across in ((inner, _ACROSS), (_rims(surface), 1.0)):
        normal = surface.normal(*where, workers=workers)
        known = np.isfinite(normal).all(axis=1)
        normal, kept = normal[known], [x[known] for x in where]
        rows = csr_array(surface.weights(*kept, workers=workers))
        # along the normal, and across it by its three coordinates
        parts.append(hstack([diags_array(normal[:, c]) @ rows for c in range(3)]))
        loads.append(np.full(len(normal), distance))
        parts.append(across * block_diag([rows] * 3))
        loads.append(across * distance * normal.T.ravel())
    matrix = csr_array(vstack(parts))
    still = _STILL * diags_array(np.ones(3 * n))
    system = (matrix.T @ matrix + still).tocsc()
    found = splu(system).solve(matrix.T @ np.concatenate(loads))
    return np.asarray(found.reshape(3, n).T)


def _off(surface: LimitSurface, cage: Mesh, distance: float, workers: int) -> tuple[float, float]:
    """The largest differences between the limit of a cage and the offset."""
    where = _places(surface, np.array([0.02, 0.21, 0.43, 0.66, 0.98]))
    rims = _rims(surface)
    every = [np.concatenate(both) for both in zip(where, rims, strict=True)]
    normal = surface.normal(*every, workers=workers)
    made = surface.with_points(cage.points).evaluate(*every, workers=workers)
    away = made - surface.evaluate(*every, workers=workers) - distance * normal
    away, normal = (x[np.isfinite(normal).all(axis=1)] for x in (away, normal))
    along = np.abs((away * normal).sum(axis=1)).max(initial=0)
    return float(along), float(np.linalg.norm(away, axis=1).max(initial=0))
