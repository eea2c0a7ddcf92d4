"""Bezier extraction: against numbers typed from the paper, and rows of weights at places."""

from fractions import Fraction
from math import comb, factorial

import numpy as np
import pytest
import zoo

import limitsurf as ls

TRIANGLES = [name for name in ls.schemes.with_pieces if ls.schemes[name].lattice.face_size == 3]
# of a uniform cubic spline amid others: Borden, Scott, Evans and Hughes (2011), section 4
CUBIC = [[1, 0, 0, 0], [4, 4, 2, 1], [1, 2, 4, 4], [0, 0, 0, 1]]


def surface_of(scheme, **options):
    points, faces = zoo.bipyramid(5) if scheme in TRIANGLES else zoo.prism(5)
    return ls.LimitSurface(ls.Mesh(np.asarray(points, float), faces, **options), scheme=scheme)


def bernstein(extraction, s, t):
    """All polynomials (n, q), by their formulas."""
    d = extraction.degree
    if extraction.tensor:
        return np.array([
            comb(d, i) * s**i * (1 - s) ** (d - i) * comb(d, j) * t**j * (1 - t) ** (d - j)
            for i, j in extraction.exponents.tolist()
        ])  # fmt: skip
    return np.array([
        factorial(d) / (factorial(i) * factorial(j) * factorial(d - i - j))
        * s**i * t**j * (1 - s - t) ** (d - i - j)
        for i, j in extraction.exponents.tolist()
    ])  # fmt: skip


def test_regular_operators_are_those_of_the_paper():
    """Exactly, for the middle one of 3 x 3 quads of a grid: products of two uniform splines."""
    points, faces = zoo.grid(3, 3)
    exact = np.array([[Fraction(int(x)) for x in p] for p in np.asarray(points)[:, :2]])
    surface = ls.LimitSurface(ls.Mesh(exact, faces))
    inner = ((exact > 0) & (exact < 3)).all(axis=1)
    (middle,) = [k for k, face in enumerate(faces) if inner[list(face)].all()]
    found = ls.bezier_extraction(surface, face=middle)
    assert (len(found), found.operators.shape, found.n_controls) == (1, (16, 16), 16)
    assert all(isinstance(x, Fraction) for x in found.operators.flat)
    along = [exact[faces[middle][k]] - exact[faces[middle][0]] for k in (1, 3)]
    for vertex, row in zip(found.controls.tolist(), found.operators, strict=True):
        a, b = ((exact[vertex] - exact[faces[middle][0]]) @ e + 1 for e in along)
        wanted = [Fraction(CUBIC[int(a)][i] * CUBIC[int(b)][j], 36) for i, j in found.exponents]
        assert row.tolist() == wanted


CREASED = {"creases": {(0, 1): 1.5, (2, 3): np.inf}, "holes": [6]}


@pytest.mark.parametrize(
    ("scheme", "tags"),
    [*((name, {}) for name in ls.schemes.with_pieces), ("catmull-clark", CREASED)],
)
def test_elements_have_the_weights_of_the_surface(scheme, tags):
    """At random places, in rings around special corners too; and they cover all but the rest."""
    surface = surface_of(scheme, **tags)
    found = ls.bezier_extraction(surface, depth=4)
    rng = np.random.default_rng(0)
    s, t = rng.random((2, len(found))) / 2
    u, v = (found.origin + found.size * np.stack([s, t], axis=1)).T
    own = np.zeros((len(found), found.n_controls))
    for elements, controls, operators in found.blocks():
        values = np.einsum("ekn,ne->ek", operators, bernstein(found, s[elements], t[elements]))
        own[elements[:, None], controls] = values
    wanted = surface.weights(found.face, u, v).toarray()
    assert np.abs(own - wanted).max() < 1e-13
    area = np.bincount(found.face, abs(np.prod(found.size, axis=1)))
    area += np.bincount(found.rest.face, abs(np.prod(found.rest.size, axis=1)), len(area))
    assert np.array_equal(area, surface.patches.with_limit[: len(area)])
    inside = np.diff(found.controls) <= 0  # they ascend, within each element
    assert set(np.flatnonzero(inside) + 1) <= set(found.offsets.tolist())


def test_exact_elements_around_a_special_corner():
    points, faces = zoo.cube()
    exact = np.array([[Fraction(x) for x in p] for p in np.asarray(points).tolist()])
    surface = ls.LimitSurface(ls.Mesh(exact, faces))
    found = ls.bezier_extraction(surface, face=0, depth=2)
    s, t = Fraction(1, 3), Fraction(2, 5)
    values = found.operators @ bernstein(found, s, t)
    for e in range(len(found)):
        rows = slice(*found.offsets[e : e + 2])
        places = zip(found.origin[e], found.size[e], (s, t), strict=True)
        u, v = (Fraction(start) + Fraction(size) * x for start, size, x in places)
        wanted = surface.weights(found.face[e], u, v).toarray()[0]
        assert wanted[found.controls[rows]].tolist() == values[rows].tolist()
        assert values[rows].sum() == 1


def test_channels_and_workers():
    points, faces = zoo.prism(5)
    corners = np.concatenate(faces)
    uv = np.random.default_rng(0).random((len(corners), 2)), np.arange(len(corners)), "all"
    surface = ls.LimitSurface(ls.Mesh(np.asarray(points, float), faces, channels={"uv": uv}))
    found = ls.bezier_extraction(surface, channel="uv")
    assert found.n_controls == len(corners)
    e = 3
    rows = slice(*found.offsets[e : e + 2])
    own = bernstein(found, 0.5, 0.25) @ (found.operators[rows].T @ uv[0][found.controls[rows]])
    u, v = found.origin[e] + found.size[e] * [0.5, 0.25]
    assert np.allclose(own, surface.evaluate(found.face[e], u, v, channel="uv"), atol=1e-13)
    two = ls.bezier_extraction(surface, channel="uv", workers=2)
    assert np.array_equal(two.operators, found.operators)
    nothing = ls.bezier_extraction(surface, face=[])
    assert (len(nothing), nothing.blocks(), nothing.offsets.tolist()) == (0, [], [0])


def test_files_of_operators(tmp_path):
    path = tmp_path / "operators.npz"
    found = ls.bezier_extraction(surface_of("catmull-clark"), depth=3)
    ls.write(path, found)
    with np.load(path, allow_pickle=False) as arrays:
        assert set(arrays) == {
            "version", "degree", "tensor", "exponents", "n_controls", "face", "origin", "size",
            "offsets", "controls", "operators", "rest_face", "rest_corner", "rest_origin",
            "rest_size", "rest_lower", "rest_upper",
        }  # fmt: skip
        assert (arrays["version"], arrays["degree"], arrays["tensor"]) == (1, 3, True)
        for name in ("face", "origin", "size", "offsets", "controls", "operators", "exponents"):
            assert np.array_equal(arrays[name], getattr(found, name))
        assert np.array_equal(arrays["rest_upper"], found.rest.upper)
    with pytest.raises(TypeError, match=r"got BezierExtraction: operators are written as \.npz"):
        ls.write(tmp_path / "operators.obj", found)
    with pytest.raises(ValueError, match=r"unknown suffix '\.npz'"):
        ls.write(path, ls.Mesh(*zoo.cube()))
    points, faces = zoo.cube()
    exact = ls.Mesh(
        np.array([[Fraction(x) for x in p] for p in np.asarray(points).tolist()]), faces
    )
    operators = ls.bezier_extraction(ls.LimitSurface(exact), face=0, depth=1)
    with pytest.raises(ValueError, match="holds no Fractions"):
        ls.write(path, operators)
    with pytest.raises(TypeError, match="needs a LimitSurface, got Mesh"):
        ls.bezier_extraction(exact)
