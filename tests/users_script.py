"""A script as a user writes it: mypy says of its calls what is asserted, and so do the arrays.

It is checked as it stands, strictly and from outside, by `test_project`.
"""

from fractions import Fraction
from typing import Any, assert_type

import numpy as np
from numpy.typing import NDArray

import limitsurf as ls

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Fractions = NDArray[np.object_]

ring = [(0, 0), (1, 0), (1, 1), (0, 1)]
quads = [[3, 2, 1, 0], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
mesh = ls.Mesh(
    [(x, y, z) for z in (0, 1) for x, y in ring],
    quads,
    creases={(0, 1): 2.5, (1, 2): Fraction(3, 2)},
    boundary="edge_only",
    channels={"uv": ([[0.0, 0], [1, 0], [1, 1], [0, 1]], 6 * [0, 1, 2, 3], "corners_plus1")},
)
assert_type(mesh.faces, ls.Faces)
assert_type(mesh.faces[0], Ints)
assert_type(mesh.uniform, Ints | None)
assert_type(mesh.sizes, Ints)
assert_type([mesh.points[face] for face in mesh.faces], list[NDArray[Any]])
assert_type(ls.Mesh(mesh.points, mesh.faces).with_points(mesh.points), ls.Mesh)

surface = ls.LimitSurface(mesh, creasing="chaikin", engine="reference")
face, u = np.arange(6)[:, None], np.linspace(0, 1, 5)
points = surface.evaluate(face, u, 0.5)
normals = surface.normal(0, [0.25, 0.5], 1, channel=None, workers=2)
jet = surface.jet(face, u, u, order=1)
bend = surface.curvature(face, u, 0.5)
assert_type(points, Floats)
assert_type(normals, Floats)
assert_type(jet[1, 0], Floats)
assert_type(surface.tangents(face, u, u), tuple[Floats, Floats])
assert_type(bend.k1, Floats)
assert_type(surface.limit_faces.face, Ints)
for floats in (points, normals, jet[1, 0], *surface.tangents(face, u, u), bend.k1, bend.d1):
    assert floats.dtype == np.float64

# exact numbers, by themselves, in lists, and among others
third = Fraction(1, 3)
exact = surface.evaluate(0, third, 0.5, nu=(1, 0))
assert_type(exact, Fractions)
assert_type(surface.evaluate([0, 1], [third, third], 0), Fractions)
thirds: Fractions = np.array([third, 0.5])
assert_type(surface.evaluate(0, thirds, 0.5), Fractions)
assert_type(surface.evaluate(0, [[third, 0.5], [1, np.float64(0)]], u[:2]), NDArray[Any])
assert_type(surface.jet(0, third, third), dict[tuple[int, int], Fractions])
assert_type(surface.weights(0, third, third), ls.ExactOperator)
assert_type(surface.weights(0, third, third, nu=[(0, 0), (1, 0)]), list[ls.ExactOperator])
slopes = surface.weights(face, u, u, nu=[(1, 0), (0, 1)])
assert slopes[0].indices is slopes[1].indices
assert exact.dtype == surface.evaluate(0, [[third, 0.5], [1, 0]], 0.5).dtype == object
rational = ls.Mesh([[0, third], [1, 0.5], [1, 1], [0, Fraction(1)]], [[0, 1, 2, 3]])
assert rational.points.dtype == object

fine, R = ls.refined(mesh, 2, operator=True, boundary="none")
assert_type(fine, ls.RefinedMesh)
assert_type(ls.refined(mesh), ls.RefinedMesh)
assert_type(fine.parent_face, Ints)
assert_type(fine.parent_u, Floats)
assert_type(fine.limit_normals, Floats)

pieces = ls.tessellate(surface, 4, channels=["uv"])
assert_type(pieces, ls.Tessellation)
assert_type(pieces.uniform, Ints | None)
assert_type(pieces.triangles, Ints)
errors: Floats = ls.validate(surface, 2, channel="uv")["error"]
cells = ls.bezier_patches(surface, face=[0, 1], channel="uv", workers=2)
assert_type(cells, ls.BezierPatches)
assert cells.evaluate([[third, 0.5], [0, 1]], 0).dtype == object
assert_type(ls.eigenbasis(valence=5), ls.Eigenbasis)
