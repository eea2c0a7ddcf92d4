"""Faces around vertices between boundaries and sharp creases, and what is beyond these.

A cage is parted there: what is on one side of a crease has copies of its vertices, beside which
there are ghost faces, as there are beyond boundaries (`ends`). Where the faces between two such
edges are not those of a spline, there is nothing beyond them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.mesh import Mesh
from limitsurf.options import Rules
from limitsurf.scheme.lattice import Lattice
from limitsurf.tables.masks import is_infinite

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Sectors:
    """Which faces of a mesh stay together around vertices when it is cut along sharp edges.

    Attributes
    ----------
    copy : (n_corners,) int
        Which copy of its vertex a corner has: the first of each is the vertex by its number.
    vertex : (n_copies,) int
        Of which vertex copies are.
    size : (n_copies,) int
        Faces at regular ones on a rim: 1 at a sharp corner, else 2 quads or 3 triangles; 0
        elsewhere.
    irregular : (n_copies,) bool
        Those on a rim beyond which nothing is.
    creased : (n_vertices,) bool
        Vertices of creases along which the mesh is cut.
    sides : (n,) int
        Half-edges of faces with a limit on rims.
    """

    copy: Array
    vertex: Array
    size: Array
    irregular: Array
    creased: Array
    sides: Array

    @classmethod
    def of(cls, mesh: Mesh, rules: Rules, creases: bool = True) -> Sectors:
        """Those of a mesh, cut along its infinitely sharp creases or along its boundaries alone.

        Functions on triangles are quartic along creases, and have no common phantom points there.
        """
        lattice = rules.scheme.lattice
        creases = creases and lattice.face_size == 4
        edges, sharpness = mesh.creases
        number = mesh.edge_numbers(edges)
        sharp = is_infinite(sharpness) & np.asarray(creases)
        rim_edge = np.array(mesh.boundary_edge | mesh.nonmanifold_edge)
        crease = np.zeros(mesh.n_edges, dtype=bool)
        crease[number[sharp]] = True
        crease &= ~rim_edge
        other = np.zeros(mesh.n_edges, dtype=bool)
        other[number[~sharp & (sharpness > 0)]] = True
        other &= ~rim_edge
        rim_edge |= crease
        limit = ~rules.without_limit(mesh)
        on_rim = rim_edge[mesh.corner_edge] | (mesh.twin < 0)
        copy, vertex = _copies(mesh, on_rim)
        sides = np.flatnonzero(on_rim & limit[mesh.corner_face])
        ends = mesh.edges[rim_edge]
        count = np.bincount(ends.ravel(), minlength=mesh.n_vertices)
        pointed, spoilt = _tags(mesh, rules)
        spoilt[mesh.edges[other]] = True
        spoilt |= mesh.nonmanifold_vertex
        pointed |= count > 2
        size = np.bincount(copy, minlength=len(vertex))
        good = np.bincount(copy, on_rim, minlength=len(vertex)) == 1
        bad = ~(limit & (mesh.sizes == lattice.face_size))[mesh.corner_face]
        good &= np.bincount(copy, bad, minlength=len(vertex)) == 0
        good &= ~spoilt[vertex] & (count[vertex] > 1)
        good &= np.where(pointed[vertex], size == 1, size == straight(lattice))
        there = np.zeros(len(vertex), dtype=bool)
        there[copy[sides]] = there[copy[mesh.next_corner[sides]]] = True
        creased = np.zeros(mesh.n_vertices, dtype=bool)
        creased[mesh.edges[crease]] = True
        return cls(copy, vertex, np.where(good & there, size, 0), there & ~good, creased, sides)


def straight(lattice: Lattice) -> int:
    """How many faces there are at a regular vertex of a boundary: half of those at one inside."""
    return lattice.valence // 2


def _copies(mesh: Mesh, on_rim: Array) -> tuple[Array, Array]:
    """Which copy of its vertex each corner has, and of which vertices copies are."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    here = np.flatnonzero(~on_rim)
    other = mesh.next_corner[mesh.twin[here]]
    n = mesh.n_corners
    joined = coo_array((np.ones(len(here), np.int8), (here, other)), shape=(n, n))
    label = connected_components(joined, directed=False)[1]
    _, first = np.unique(label, return_index=True)
    vertex = mesh.indices[first]
    order = np.lexsort((first, vertex))
    again = np.zeros(len(order), dtype=bool)
    again[1:] = vertex[order][1:] == vertex[order][:-1]
    number = vertex.copy()
    number[order[again]] = mesh.n_vertices + np.arange(again.sum())
    return number[label], np.concatenate([np.arange(mesh.n_vertices), vertex[order[again]]])


def _tags(mesh: Mesh, rules: Rules) -> tuple[Array, Array]:
    """Vertices (n_vertices,) that are sharp corners of their own, and those on the way to it."""
    vertices, sharpness = mesh.corners
    pointed, spoilt = np.zeros((2, mesh.n_vertices), dtype=bool)
    infinite = is_infinite(sharpness)
    pointed[vertices[infinite]] = True
    spoilt[vertices[~infinite & (sharpness > 0)]] = True
    if rules.boundary == "edge_and_corner":
        pointed |= mesh.boundary_vertex & (mesh.vertex_faces == 1)
    spoilt &= ~pointed
    return pointed, spoilt
