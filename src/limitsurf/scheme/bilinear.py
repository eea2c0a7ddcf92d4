"""Schemes that only cut faces, those of polygons bilinear and of triangles linear: their masks.

Points of edges are midpoints, those of faces the means of their corners, and vertices stay, be they
on creases, boundaries or not. The limit is the cage itself, bilinear on quads: OpenSubdiv's scheme
of that name, "simple" in Blender. Other polygons are cut at their centres first, into a quad at
each corner. That nothing but its corners decides about a face follows from the splines; derived in
``derivations/masks_box_spline.py``, section 7.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

from limitsurf.scheme.lattice import TRIANGLES
from limitsurf.scheme.scheme import Scheme
from limitsurf.scheme.spline import BILINEAR as PRODUCT
from limitsurf.scheme.spline import LINEAR as HAT

_WHOLE, _NONE, _HALF = Fraction(1), Fraction(0), Fraction(1, 2)


def _face(n: int) -> tuple[Fraction, ...]:
    return (Fraction(1, n),) * n


def _vertex(valence: int) -> tuple[Fraction, ...]:
    return _WHOLE, _NONE, _NONE


def _vertex_of_triangles(valence: int) -> tuple[Fraction, ...]:
    return _WHOLE, _NONE


BILINEAR = Scheme(
    name="bilinear",
    face=_face,
    edge=(_HALF, _NONE),
    vertex=_vertex,
    boundary_edge=_HALF,
    boundary_vertex=(_WHOLE, _NONE),
    paper="Catmull and Clark 1978 (how polygons are cut); the B-spline of degree 1",
    spline=PRODUCT,
)
LINEAR = replace(
    BILINEAR,
    name="linear",
    face=None,
    vertex=_vertex_of_triangles,
    paper="the box spline of degree 1 (Courant 1943)",
    lattice=TRIANGLES,
    spline=HAT,
)
