"""Bezier cells of VTK: ordered as VTK says, and where VTK puts them when it cuts them up."""

import warnings

import numpy as np
import pytest
import zoo

import limitsurf as ls
from limitsurf.pieces.bernstein import is_tensor
from limitsurf.shell.io import vtk_bezier

TRIANGLES = [name for name in ls.schemes.with_pieces if ls.schemes[name].lattice.face_size == 3]


def surface_of(scheme, **options):
    """Five faces at two vertices, without symmetry."""
    points, faces = zoo.bipyramid(5) if scheme in TRIANGLES else zoo.prism(5)
    points = np.asarray(points, float)
    points = points + np.random.default_rng(3).uniform(-0.1, 0.1, points.shape)
    return ls.LimitSurface(ls.Mesh(points, faces, **options), scheme=scheme)


def exponents(degree, tensor):
    if tensor:
        return np.array([(i, j) for i in range(degree + 1) for j in range(degree + 1)])
    return np.array([(i, j) for j in range(degree + 1) for i in range(degree + 1 - j)])


@pytest.mark.parametrize("degree", [1, 2, 3, 4, 5])
def test_points_are_in_the_order_of_vtk(degree):
    from vtkmodules.vtkCommonDataModel import vtkHigherOrderQuadrilateral, vtkHigherOrderTriangle

    places = exponents(degree, True)
    assert is_tensor(places)
    own = places[vtk_bezier.point_order(places)]
    at = [vtkHigherOrderQuadrilateral.PointIndexFromIJK(*p, [degree, degree]) for p in own.tolist()]
    assert at == list(range(len(own)))
    places = exponents(degree, False)
    own = places[vtk_bezier.point_order(places)]
    for k, (i, j) in enumerate(own.tolist()):
        bary = [0, 0, 0]
        vtkHigherOrderTriangle.BarycentricIndex(k, bary, degree)
        assert bary == [i, j, degree - i - j]


def evaluated(grid, cell, s, t):
    """Where VTK has the places (s, t) of a cell, by its own basis, and the basis there."""
    from vtkmodules.vtkCommonCore import reference

    one = grid.GetCell(cell)
    place, weights = [0.0] * 3, [0.0] * one.GetNumberOfPoints()
    one.EvaluateLocation(reference(0), [s, t, 0.0], place, weights)
    return np.array(place), np.array(weights)


CREASED = {"creases": {(0, 1): 1.5, (2, 3): np.inf}}


@pytest.mark.parametrize(
    ("scheme", "tags"),
    [*((name, {}) for name in ls.schemes.with_pieces), ("catmull-clark", CREASED)],
)
def test_vtk_evaluates_cells_as_the_surface(scheme, tags, tmp_path):
    import pyvista

    path = tmp_path / "x.vtu"
    ls.to_pyvista(surface_of(scheme, **tags), bezier=True, depth=3).save(path)
    text = path.read_bytes()
    assert b'RationalWeights="RationalWeights"' in text
    assert b'HigherOrderDegrees="HigherOrderDegrees"' in text
    grid, surface = pyvista.read(path), surface_of(scheme, **tags)
    face, origin, size, bound = (grid.cell_data[x] for x in ("face", "origin", "size", "deviation"))
    assert set(grid.celltypes) == {76 if scheme in TRIANGLES else 77}
    rng = np.random.default_rng(0)
    found, places = [], []
    for cell in range(grid.n_cells):
        s, t = rng.random(2) / 2
        found.append(evaluated(grid, cell, s, t)[0])
        places.append(origin[cell] + size[cell] * [s, t])
    gap = np.linalg.norm(found - surface.evaluate(face, *np.transpose(places)), axis=1)
    assert gap[bound == 0].max() < 1e-13
    assert (gap <= bound + 1e-13).all()
    covered = np.bincount(face, np.prod(abs(size), axis=1))  # (n-gons are cut like quads)
    assert np.allclose(covered, 1)
    if (bound > 0).any():
        deeper = ls.to_pyvista(surface, bezier=True, depth=8).cell_data["deviation"]
        assert deeper.max() < bound.max() / 4


@pytest.mark.parametrize("name", ["catmull-clark", "loop"])
def test_a_solution_on_bezier_cells(name):
    """VTK tessellates: each point is where the function has what VTK says of it."""
    surface = surface_of(name)
    space = ls.Space(surface, levels=1)
    values = np.random.default_rng(1).normal(size=(space.n, 2))
    grid = ls.to_pyvista(space.function(values, channel="two"), bezier=True, depth=2)
    cut = grid.extract_surface(nonlinear_subdivision=1, algorithm="dataset_surface")
    bound = grid.cell_data["deviation"].max()
    assert cut.n_points > grid.n_cells
    found = ls.closest_point(space.surface, np.asarray(cut.points, float))
    assert found.distance.max() < bound + 1e-6
    exact = np.flatnonzero(grid.cell_data["deviation"] == 0)[:40]
    for cell in exact.tolist():
        _, weights = evaluated(grid, cell, 0.3, 0.2)
        own = weights @ grid.point_data["two"][grid.get_cell(cell).point_ids]
        u, v = grid.cell_data["origin"][cell] + grid.cell_data["size"][cell] * [0.3, 0.2]
        expected = space.function(values).evaluate(grid.cell_data["face"][cell], u, v)
        assert np.allclose(own, expected, atol=1e-12)


def test_channels_with_seams_are_left_out_by_name():
    """A seam around each face, sharp, cuts a channel where points are not cut."""
    points, faces = zoo.grid(3, 3)
    corners = np.ravel(faces)
    values = np.random.default_rng(0).random((len(corners), 2))
    channels = {"uv": (values, np.arange(len(corners)), "none"),
                "warm": (np.asarray(points, float)[:, 0], corners, "corners_only")}  # fmt: skip
    mesh = ls.Mesh(points, faces, channels=channels)
    with pytest.warns(UserWarning, match="left out: channel 'uv'") as caught:
        grid = ls.to_pyvista(ls.LimitSurface(mesh), bezier=True)
    assert caught[0].filename == __file__
    assert "uv" not in grid.point_data
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ls.to_pyvista(ls.LimitSurface(ls.Mesh(points, faces)), bezier=True)
    assert np.allclose(grid.point_data["warm"], grid.points[:, 0], atol=1e-13)


def test_bad_arguments_of_bezier_cells():
    surface = ls.LimitSurface(ls.Mesh(*zoo.cube()))
    for given, text in (
        ({"n": 3, "bezier": True}, "n is for polygons"),
        ({"depth": 3}, "bezier=True"),
        ({"bezier": True, "depth": 99}, "depth must be 0 to 52"),
    ):
        with pytest.raises(ValueError, match=text):
            ls.to_pyvista(surface, **given)
    with pytest.raises(ValueError, match="bezier is for a LimitSurface, got Mesh"):
        ls.to_pyvista(surface.mesh, bezier=True)
    with pytest.raises(ValueError, match="need \\(n_vertices, 3\\)"):
        ls.to_pyvista(surface.with_points(surface.points[:, :2]), bezier=True)
    holes = ls.Mesh(*zoo.cube(), holes=list(range(6)))
    with pytest.raises(ValueError, match="no face has a limit"):
        ls.to_pyvista(ls.LimitSurface(holes), bezier=True)
