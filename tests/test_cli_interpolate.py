"""The command interpolate."""

import numpy as np
import pytest
import zoo
from command_line import facts, fail, succeed

import limitsurf as ls
from limitsurf.cad import fairness
from limitsurf.shell.cli import interpolating


@pytest.fixture
def cage(tmp_path):
    path = tmp_path / "prism.obj"
    ls.write(path, ls.Mesh(*zoo.prism(5), creases={(0, 1): 2.0}))
    return path


def test_energies_are_those_of_the_library():
    assert interpolating.ENERGIES == fairness.ENERGIES


def limits(path, count=10):
    return ls.refined(ls.read(path), 0).limit_points[:count]


@pytest.mark.parametrize("refine", ["no", "yes"])
@pytest.mark.parametrize("suffix", [".csv", ".npy", None])
def test_limits_pass_through_points(suffix, refine, cage, tmp_path):
    target, mesh = tmp_path / "through.obj", ls.read(cage)
    points, given = mesh.points, []
    if suffix:
        points = 1.1 * points
        given = [tmp_path / f"points{suffix}"]
        if suffix == ".csv":
            np.savetxt(given[0], points, delimiter=",", fmt="%.17g")
        else:
            np.save(given[0], points)
    said = facts("interpolate", cage, *given, "--refine", refine, "-o", target)
    assert np.abs(limits(target) - points).max() < 1e-13
    assert said["levels"] == (refine == "yes")
    assert said["rank"] == said["conditions"] == 10
    assert said["residual"] < 1e-14
    assert said["condition"] < 100
    expected = ls.interpolate(mesh, points, refine=refine == "yes").mesh
    assert np.abs(ls.read(target).points - expected.points).max() < 1e-12
    assert said["vertices"] == expected.n_vertices


def test_places(cage, tmp_path):
    places, target = tmp_path / "places.csv", tmp_path / "near.obj"
    succeed("sample", cage, "-n", 5, "-o", places)
    rows = np.genfromtxt(places, delimiter=",", names=True)
    where = rows["face"].astype(int), rows["u"], rows["v"]
    points = np.stack([rows[x] for x in "xyz"], axis=1)
    facts("interpolate", cage, places, "--places", "-o", target)
    assert np.abs(ls.LimitSurface(ls.read(target)).evaluate(*where) - points).max() < 1e-12
    options = ["--weight", 3, "--fairness", "membrane", "-o", target]
    facts("interpolate", cage, places, "--places", *options)
    expected = ls.interpolate(
        ls.read(cage), points, places=where, weights=3.0, fairness="membrane"
    ).mesh
    assert np.abs(ls.read(target).points - expected.points).max() < 1e-9


def test_bad_input(cage, tmp_path):
    cube = tmp_path / "cube.obj"
    ls.write(cube, ls.Mesh(*zoo.cube()))
    assert "rank 7" in fail("interpolate", cube, "--refine", "no", "-o", tmp_path / "a.obj")
    assert "need" in fail("interpolate", cage, "-", stdin="1,2\n")
    assert "shape (10, 3)" in fail("interpolate", cage, "-", stdin="1,2,3\n")
    assert "name a file of them" in fail("interpolate", cage, "--places")
    assert "both be on the standard input" in fail("interpolate", "-", "-")
    text = fail("interpolate", cage, "-", "--places", stdin="0.5,0,0,1,1,1\n")
    assert "face 0.5 of row 0 is no integer" in text
    assert not (tmp_path / "a.obj").exists()
