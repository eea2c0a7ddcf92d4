"""The demo and its bundled cage."""

import sys

import make_demo_cage
import numpy as np
import pytest
from click.testing import CliRunner

import limitsurf as ls
from limitsurf.shell.cli.commands import main
from limitsurf.shell.plot import picture


def demo(folder, *options):
    arguments = ["demo", "-o", str(folder), "--queries", "1000", *options]
    return CliRunner().invoke(main, arguments)


@pytest.fixture(scope="module")
def cage():
    return ls.read(make_demo_cage.FILE)


def test_the_cage_is_the_generated_one():
    assert make_demo_cage.FILE.read_bytes() == make_demo_cage.text().encode("ascii")


def test_the_cage_has_something_of_everything(cage):
    assert set(cage.sizes) == {3, 4, 5, 6}
    assert set(cage.vertex_faces[~cage.boundary_vertex]) == {3, 4, 5, 8, 16}
    assert cage.boundary_edge.sum() == 4
    # A sphere, and a sphere with one handle and one hole: 2 + (2 - 2 - 1).
    assert cage.n_vertices - cage.n_edges + cage.n_faces == 1
    assert np.unique(cage.points.round(4), axis=0).shape == cage.points.shape
    np.testing.assert_array_equal(cage.points.round(4), cage.points)


def test_demo(cage, tmp_path, monkeypatch):
    monkeypatch.setattr(picture, "POLYGONS", 10_000)
    folder = tmp_path / "new" / "folder"
    result = demo(folder)
    assert result.exit_code == 0, result.output
    for text in ["queries a second", "refined once", "limit error", "rounding alone"]:
        assert text in result.output
    for name in ["demo_results.npz", "demo.png"]:
        assert str(folder / name) in result.output.splitlines()
    assert sorted(path.name for path in folder.iterdir()) == ["demo.png", "demo_results.npz"]
    surface = ls.LimitSurface(cage)
    with np.load(folder / "demo_results.npz") as found:
        where = found["face"], found["u"], found["v"]
        assert len(where[0]) == 1000
        np.testing.assert_allclose(found["position"], surface.evaluate(*where), atol=1e-13)
        np.testing.assert_allclose(found["du"], surface.evaluate(*where, nu=(1, 0)), atol=1e-13)
        np.testing.assert_allclose(found["dv"], surface.evaluate(*where, nu=(0, 1)), atol=1e-13)
        np.testing.assert_allclose(found["normal"], surface.normal(*where), atol=1e-13)
        assert all(np.isfinite(found[name]).all() for name in found.files)


def test_demo_without_pyvista_lacks_the_picture_only(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    result = demo(tmp_path)
    assert result.exit_code == 0
    assert "pip install" in result.output
    assert [path.name for path in tmp_path.iterdir()] == ["demo_results.npz"]


def test_demo_fails_when_the_refiner_disagrees(tmp_path, monkeypatch):
    def shaken(surface, levels):
        table = np.zeros(levels, dtype=[("level", int), ("limit_error", float)])
        table["limit_error"] = 1e-6
        return table

    monkeypatch.setattr(ls, "validate", shaken)
    monkeypatch.setattr(ls, "plot", lambda *_: None)
    result = demo(tmp_path)
    assert result.exit_code == 1
    assert "MORE than rounding" in result.output


def test_demo_in_a_bad_place(tmp_path):
    (tmp_path / "file").write_text("")
    for place in [tmp_path / "file", tmp_path / "file" / "folder"]:
        result = demo(place)
        assert result.exit_code == 2
        assert result.output.startswith("limitsurf: error: ")
        assert len(result.output.splitlines()) == 1
