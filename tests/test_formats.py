"""Cages and tessellations through the files of others, and what is broken, at every suffix."""

import base64
import builtins
import io
import json
import os
import random
import re
import resource
import struct
import subprocess
import sys
import threading
import tracemalloc
import warnings
import zipfile
from contextlib import nullcontext
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import zoo

import limitsurf as ls
from limitsurf import memory
from limitsurf.shell import files
from limitsurf.shell.io import apart, formats, ply

POLYGONS = [".obj", ".ply", ".off", ".usd", ".usda", ".usdc", ".vtp", ".vtu", ".vtk"]
TRIANGLES = [".stl", ".glb", ".gltf", ".3mf", ".dae"]
SINGLE = {".stl", ".glb", ".gltf", ".dae", ".usd", ".usda", ".usdc"}
MIXED = ls.Mesh(*zoo.carved(zoo.prism(9), 7, 12))
# of these warnings there are tests of their own
pytestmark = [
    pytest.mark.filterwarnings("ignore:.* holds triangles only"),
    pytest.mark.filterwarnings("ignore:.* a cage has no place for all, left out"),
]
# few lines of text, of which most are needed
CUBE = ls.Mesh(*zoo.cube())


def with_uv(mesh, seed=0):
    """Every corner has a value of its own, in single precision, but a few share one."""
    g = np.random.default_rng(seed)
    values = g.random((mesh.n_corners, 2)).astype(np.float32).astype(float)
    rows = np.arange(mesh.n_corners)
    rows[3::7] = rows[2::7][: len(rows[3::7])]
    return ls.Mesh(
        mesh.points,
        (mesh.sizes, mesh.indices),
        channels={"uv": (values, rows, "corners_plus1")},
    )


SEAMS = with_uv(CUBE)
CREASED = ls.Mesh(
    *zoo.cube(),
    creases=dict.fromkeys([(4, 5), (5, 7), (6, 7), (4, 6)], np.inf),
    channels=SEAMS.channels,
)
PIECES = ls.tessellate(ls.LimitSurface(CREASED), 3, channels=["uv"])


def uv_of_corners(mesh):
    values, rows, _ = mesh.channels["uv"]
    return values[rows]


def tolerance(suffix):
    return 1e-6 if suffix in SINGLE else 1e-7 if suffix == ".3mf" else 0


def test_every_suffix_is_documented():
    assert set(POLYGONS) | set(TRIANGLES) == set(formats.WRITABLE)
    assert set(formats.READABLE) == {*formats.WRITABLE, ".usdz", ".msh"}
    for suffixes, call in ((*formats.READABLE, ".3dm"), ls.read), (formats.WRITABLE, ls.write):
        listed = re.findall(r"(?m)^    ``(\..*?)``  ", call.__doc__)
        assert sorted(" ".join(listed).split()) == sorted(suffixes)


# --- Round trips


@pytest.mark.parametrize("suffix", POLYGONS)
@pytest.mark.parametrize("mesh", [CUBE, MIXED, ls.Mesh(*zoo.grid(3, 4))], ids=["cube", "mixed", ""])
def test_polygons_come_back(tmp_path, suffix, mesh):
    path = tmp_path / f"cage{suffix}"
    ls.write(path, mesh)
    again = ls.read(path)
    assert np.array_equal(again.sizes, mesh.sizes)
    assert np.array_equal(again.indices, mesh.indices)
    assert np.abs(again.points - mesh.points).max() <= tolerance(suffix)
    assert not again.channels
    assert os.listdir(tmp_path) == [path.name]


@pytest.mark.parametrize("suffix", [s for s in POLYGONS if s in formats.WITH_UV])
@pytest.mark.parametrize("mesh", [SEAMS, with_uv(MIXED)], ids=["cube", "mixed"])
def test_seams_come_back(tmp_path, suffix, mesh):
    path = tmp_path / f"cage{suffix}"
    ls.write(path, mesh)
    again = ls.read(path)
    assert np.array_equal(again.indices, mesh.indices)
    assert again.n_vertices == mesh.n_vertices
    assert np.array_equal(uv_of_corners(again), uv_of_corners(mesh))
    assert again.channels["uv"][2] == "corners_plus1"


@pytest.mark.parametrize("suffix", TRIANGLES)
@pytest.mark.parametrize("mesh", [SEAMS, with_uv(MIXED)], ids=["cube", "mixed"])
@pytest.mark.filterwarnings("ignore:.*cannot hold everything.*channel 'uv'")
def test_triangles_come_back(tmp_path, suffix, mesh):
    path = tmp_path / f"cage{suffix}"
    ls.write(path, mesh)
    again = ls.read(path)
    assert again.n_vertices == mesh.n_vertices
    triangles = ls.to_trimesh(ls.Mesh(mesh.points, (mesh.sizes, mesh.indices))).faces
    points = mesh.points[triangles.ravel()]
    assert np.abs(again.points[again.indices] - points).max() <= tolerance(suffix)
    assert ("uv" in again.channels) == (suffix in formats.WITH_UV)
    if again.channels:
        found = np.concatenate([again.points[again.indices], uv_of_corners(again)], axis=1)
        wanted = np.concatenate([mesh.points[mesh.indices], uv_of_corners(mesh)], axis=1)
        gap = np.abs(found[:, None] - wanted).max(axis=2)
        assert gap.min(axis=1).max() < 1e-5
        assert gap.min(axis=0).max() < 1e-5


@pytest.mark.parametrize("suffix", [*POLYGONS, *TRIANGLES])
@pytest.mark.filterwarnings("ignore:.*cannot hold everything.*channel 'uv'")
def test_tessellations_come_back(tmp_path, suffix):
    path = tmp_path / f"pieces{suffix}"
    ls.write(path, PIECES)
    again = ls.read(path)
    assert again.n_vertices == len(PIECES.points)
    corners = PIECES.indices if suffix in POLYGONS else PIECES.indices[PIECES.triangles.ravel()]
    gap = np.abs(again.points[again.indices] - PIECES.points[corners]).max()
    assert gap <= max(tolerance(suffix), 1e-7 * (suffix == ".3mf"))
    if suffix in formats.WITH_UV:
        values, rows = PIECES.channels["uv"]
        rows = rows if suffix in POLYGONS else rows[PIECES.triangles.ravel()]
        assert np.abs(uv_of_corners(again) - values[rows]).max() < 1e-6


@pytest.mark.parametrize("suffix", [".ply", ".vtp", ".vtu", ".vtk", ".obj", ".stl"])
@pytest.mark.filterwarnings("ignore:.*cannot hold everything.*channel 'uv'")
def test_pyvista_reads_them(tmp_path, suffix):
    import pyvista

    path = tmp_path / f"pieces{suffix}"
    ls.write(path, PIECES)
    found = pyvista.read(path)
    if suffix == ".stl":
        assert found.n_cells == len(PIECES.triangles)
        return
    assert found.n_cells == len(PIECES.sizes)
    split = PIECES.split()
    normals = np.asarray(found.point_data[{".ply": "Normals"}.get(suffix, "Normals")])
    texture = pyvista.convert_array(found.GetPointData().GetTCoords())
    if suffix == ".obj":
        # VTK splits by itself
        assert found.n_points >= len(split.points)
    else:
        assert np.abs(found.points - split.points).max() < 1e-6
        assert np.abs(normals - split.normals).max() < 1e-6
        assert np.abs(texture - split.channels["uv"][0]).max() < 1e-6
    assert np.allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-6)


@pytest.mark.parametrize("suffix", [".ply", ".off", ".stl", ".glb", ".gltf", ".3mf", ".obj"])
@pytest.mark.filterwarnings("ignore:.*cannot hold everything.*channel 'uv'")
def test_trimesh_reads_them(tmp_path, suffix):
    import trimesh

    path = tmp_path / f"pieces{suffix}"
    ls.write(path, PIECES)
    found = trimesh.load_mesh(path, process=False)
    split = PIECES.split()
    assert len(found.faces) == len(PIECES.triangles)
    if suffix in (".glb", ".gltf", ".ply"):
        assert np.abs(found.vertices - split.points).max() < 1e-6
        assert np.abs(found.visual.uv - split.channels["uv"][0]).max() < 1e-6
    if suffix in (".glb", ".gltf"):
        # what load_mesh computes afresh
        (found,) = trimesh.load_scene(path, process=False).geometry.values()
        assert np.abs(found.vertex_normals - split.normals).max() < 1e-5


def test_text_of_a_tessellation(tmp_path):
    path = tmp_path / "pieces.obj"
    ls.write(path, PIECES)
    lines = [line.split() for line in path.read_text().splitlines() if line]
    by_word = {word: [x[1:] for x in lines if x[0] == word] for word in ("v", "vt", "vn", "f")}
    assert np.array_equal(np.array(by_word["v"], dtype=float), PIECES.points)
    assert np.array_equal(np.array(by_word["vn"], dtype=float), PIECES.normals)
    values, rows = PIECES.channels["uv"]
    assert np.array_equal(np.array(by_word["vt"], dtype=float), values)
    corners = np.array([c.split("/") for f in by_word["f"] for c in f], dtype=int) - 1
    assert np.array_equal(corners.T, [PIECES.indices, rows, PIECES.normal_indices])
    assert [len(f) for f in by_word["f"]] == PIECES.sizes.tolist()
    plain = ls.tessellate(ls.LimitSurface(CUBE), 1)
    ls.write(path, plain)
    assert re.search(r"(?m)^f \d+//\d+ \d+//\d+ \d+//\d+ \d+//\d+$", path.read_text())
    ls.write(path, ls.tessellate(ls.LimitSurface(CUBE), 1, normals=False))
    assert re.search(r"(?m)^f \d+ \d+ \d+ \d+$", path.read_text())
    assert "vn" not in path.read_text()


def test_missing_normals_are_those_around(tmp_path):
    points, faces, tags = zoo.TAGGED["dart_2"]()
    found = ls.tessellate(ls.LimitSurface(ls.Mesh(points, faces, **tags)), 3)
    missing = np.isnan(found.normals).any(axis=1)
    assert missing.any()
    path = tmp_path / "dart.obj"
    ls.write(path, found)
    written = re.findall(r"(?m)^vn (\S+) (\S+) (\S+)$", path.read_text())
    normals = np.array(written, dtype=float)
    assert np.array_equal(normals[~missing], found.normals[~missing])
    assert np.allclose(np.linalg.norm(normals, axis=1), 1)
    triangles = found.indices[found.triangles]
    a, b, c = found.points[triangles].transpose(1, 0, 2)
    at = missing[found.normal_indices[found.triangles]]
    (row,) = np.flatnonzero(missing)
    around = np.cross(b - a, c - a)[at.any(axis=1)].sum(axis=0)
    assert np.allclose(normals[row], around / np.linalg.norm(around))
    assert np.isnan(found.normals[row]).all()


@pytest.mark.parametrize("scale", [1e160, 1e-200])
def test_missing_normals_of_any_size(scale):
    points, faces, tags = zoo.TAGGED["dart_2"]()
    scale = 2.0 ** np.round(np.log2(scale))
    surfaces = [ls.LimitSurface(ls.Mesh(points * s, faces, **tags)) for s in (1, scale)]
    usual, found = (ls.tessellate(surface, 3) for surface in surfaces)
    assert np.isnan(found.normals).any()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.array_equal(found.triangles, usual.triangles)
        normals = ls.to_trimesh(found).vertex_normals
    assert np.allclose(normals, ls.to_trimesh(usual).vertex_normals, atol=1e-12)


def test_normals_of_a_usd_file(tmp_path):
    from pxr import Usd, UsdGeom

    path = tmp_path / "pieces.usda"
    ls.write(path, PIECES)
    stage = Usd.Stage.Open(str(path))
    geom = UsdGeom.Mesh(stage.GetPrimAtPath("/mesh"))
    assert geom.GetNormalsInterpolation() == "faceVarying"
    assert geom.GetSubdivisionSchemeAttr().Get() == "none"
    wanted = PIECES.normals[PIECES.normal_indices]
    assert np.abs(np.array(geom.GetNormalsAttr().Get()) - wanted).max() < 1e-6


@pytest.mark.parametrize("suffix", formats.WRITABLE)
@pytest.mark.filterwarnings("ignore:.*cannot hold everything.*channel 'uv'")
def test_pipes(tmp_path, suffix):
    stream = io.BytesIO()
    ls.write(stream, PIECES, suffix=suffix.upper())
    assert not stream.closed
    stream.seek(0)
    again = ls.read(stream, suffix=suffix)
    ls.write(tmp_path / f"pieces{suffix}", PIECES)
    assert again == ls.read(tmp_path / f"pieces{suffix}")


def test_names_of_pipes(tmp_path):
    with open(os.devnull, "rb") as nothing:
        for given, name in (io.BytesIO(b"ply"), "<stdin>"), (nothing, os.devnull):
            with pytest.raises(ls.MeshError, match=f"^{name}: "):
                ls.read(given, suffix=".ply")
    with pytest.raises(ValueError, match=r"<stdin>: unknown suffix '', need one of .obj, "):
        ls.read(io.BytesIO(b""))
    with pytest.raises(ValueError, match=r"<stdout>: unknown suffix '.x', need one of .obj, "):
        ls.write(io.BytesIO(), CUBE, suffix=".x")
    with pytest.raises(TypeError, match="need a path or an open binary file, got int"):
        ls.read(3)
    for suffix in ".off", ".usda", ".usdc":
        ls.write(tmp_path / "cube.dat", CUBE, suffix=suffix)
        mesh = ls.read(tmp_path / "cube.dat", suffix=suffix)
        assert np.array_equal(mesh.points, CUBE.points)
        assert mesh.n_faces == 6


# --- What is lost


@pytest.mark.parametrize("suffix", [".ply", ".off", ".stl", ".vtp", ".glb"])
def test_what_is_left_out_is_named(tmp_path, suffix):
    channels = {"colour": (np.zeros((1, 3)), np.zeros(24, int), "all")}
    mesh = ls.Mesh(
        *zoo.cube(), creases={(0, 1): 2}, holes=[1], boundary="edge_only", channels=channels
    )
    path = tmp_path / f"cage{suffix}"
    with pytest.warns(UserWarning, match="cannot hold everything") as caught:
        ls.write(path, mesh)
    assert caught[0].filename == __file__
    text = f"{path}: a file of type {suffix} cannot hold everything, left out: "
    assert str(caught[0].message) == f"{text}creases, holes, channel 'colour', boundary"


def everything():
    """A cage and a tessellation that hold all that such can."""
    points, faces = zoo.cube()
    uv, rows = np.random.default_rng(0).random((24, 2)), np.arange(24)
    uv[4:8] = np.nan
    cage = ls.Mesh(
        [*points, [9, 9, 9]],
        faces,
        creases={(0, 1): 2},
        corners={3: 1.5},
        holes=[2],
        scheme="loop",
        boundary="none",
        creasing="chaikin",
        triangles="smooth",
        channels={"map": (uv, rows, "all"), "colour": (np.eye(3), rows % 3, "all")},
        units=0.0254,
        up="z",
    )
    smooth = ls.Mesh(points, faces, channels=cage.channels, units=0.0254, up="z")
    return cage, ls.tessellate(ls.LimitSurface(smooth), 2, channels=["map", "colour"])


@pytest.mark.parametrize("suffix", formats.WRITABLE)
@pytest.mark.parametrize("number", [0, 1], ids=["cage", "tessellation"])
def test_all_is_kept_or_named(tmp_path, suffix, number):
    """Whatever an object holds comes back from a file, or a warning names it."""
    x, path = everything()[number], tmp_path / f"x{suffix}"
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        ls.write(path, x)
        written = len(caught)
        y = ls.read(path)
    assert {warning.filename for warning in caught} == {__file__} or not caught
    said = " ".join(str(warning.message) for warning in caught)

    def corners(mesh, name):
        values, rows = mesh.channels[name][:2]
        return values[rows]

    kept = {
        "holds triangles only": np.array_equal(y.sizes, x.sizes),
        "units": y.units == x.units or suffix in formats.MEASURES,
        "up axis": y.up == x.up or suffix in formats.MEASURES,
        # files of VTK hold it, and a cage that is read says so
        "channel 'colour'": "colour" in y.channels or "left out: of points colour" in said,
    }
    maps = [name for name in y.channels if y.channels[name][0].shape[1:] == (2,)]
    kept["channel 'map'"] = "map" in maps
    if maps:
        got = np.isnan(corners(y, maps[0])).any(axis=1).mean()
        kept["zeros"] = np.isclose(got, np.isnan(corners(x, "map")).any(axis=1).mean())
    if number == 0:
        for name in ("scheme", "boundary", "creasing", "triangles", "holes"):
            kept[name] = np.array_equal(getattr(y, name), getattr(x, name))
        kept["creases"] = np.array_equal(y.creases[0], x.creases[0])
        kept["corners"] = np.array_equal(y.corners[0], x.corners[0])
        kept["vertices of no face"] = (y.vertex_faces == 0).any()
        if maps and y.channels[maps[0]][2] != "all":
            kept["the interpolation of channel 'map'"] = False
    elif suffix in TRIANGLES:
        kept.pop("holds triangles only")  # the surface stays
    missing = [words for words, there in kept.items() if not there and words not in said]
    assert not missing, said
    if number == 1 and suffix not in formats.WITH_NORMALS:
        assert "normals" in " ".join(str(warning.message) for warning in caught[:written])


@pytest.mark.parametrize("suffix", TRIANGLES)
def test_faces_that_are_cut_are_counted(tmp_path, suffix):
    path = tmp_path / f"x{suffix}"
    with pytest.warns(UserWarning, match="triangles only") as caught:
        ls.write(path, MIXED)
    (warning,) = caught
    assert warning.filename == __file__
    cut = f"faces of more than 3 corners, {(MIXED.sizes > 3).sum()} of {MIXED.n_faces}, are cut"
    text = f"{path}: a file of type {suffix} holds triangles only: {cut}, which changes the limit"
    assert str(warning.message) == f"{text} surface of the cage"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ls.write(path, ls.Mesh(*zoo.tetrahedron()))
        ls.write(path, ls.tessellate(ls.LimitSurface(CUBE), 2, normals=False))


@pytest.mark.parametrize("suffix", sorted(SINGLE))
@pytest.mark.parametrize(("scale", "offset"), [(1, 1e12), (1e-300, 0), (1e-10, 0.4)])
def test_points_that_become_equal_are_counted(tmp_path, suffix, scale, offset):
    path, points = tmp_path / f"x{suffix}", zoo.tetrahedron()[0]
    mesh = ls.Mesh(scale * points + offset, zoo.tetrahedron()[1])
    rounding = f"rounded as in a file of type {suffix}: .obj, .ply and .vtp keep float64"
    for x in mesh, ls.tessellate(ls.LimitSurface(mesh), 1, normals=False):
        with pytest.warns(UserWarning, match="become equal") as caught:
            ls.write(path, x)
        assert [warning.filename for warning in caught] == [__file__]
        count = "3 of 4" if x is mesh else r"\d+ of \d+"
        text = rf"^{re.escape(str(path))}: {count} distinct points become equal to others, "
        assert re.search(text + re.escape(rounding) + "$", str(caught[0].message))


@pytest.mark.parametrize("suffix", sorted({*formats.WRITABLE} - SINGLE))
def test_points_that_stay_distinct(tmp_path, suffix):
    path, points = tmp_path / f"x{suffix}", zoo.tetrahedron()[0]
    mesh = ls.Mesh(1e-10 * points + 0.4, zoo.tetrahedron()[1])
    ls.write(path, mesh)
    assert np.array_equal(ls.read(path).points, mesh.points)


def test_points_that_are_equal_but_for_rounding(tmp_path):
    """One ulp is a distance between points of a cage, and none between those of a surface."""
    points, faces = zoo.tetrahedron()
    twice = np.concatenate([points, np.nextafter(points, 2)])
    mesh = ls.Mesh(twice, np.concatenate([faces, np.add(faces, 4)]))
    with pytest.warns(UserWarning, match="4 of 8 distinct points become equal"):
        ls.write(tmp_path / "x.stl", mesh)
    points, faces, tags = zoo.TAGGED["mixed_pillow"]()
    pillow = ls.tessellate(ls.LimitSurface(ls.Mesh(points, faces, **tags)), 8)
    rounded = np.unique(pillow.points.astype(np.float32), axis=0)
    assert len(rounded) < len(np.unique(pillow.points, axis=0))
    with pytest.warns(UserWarning, match="left out: normals$"):
        ls.write(tmp_path / "x.stl", pillow)


@pytest.mark.parametrize("suffix", [".ply", ".vtp", ".glb"])
def test_texture_coordinates_of_usd(tmp_path, suffix):
    mesh = ls.Mesh(*zoo.cube(), channels={"st": SEAMS.channels["uv"]})
    ls.write(tmp_path / f"st{suffix}", mesh)
    ls.write(tmp_path / f"uv{suffix}", SEAMS)
    assert ls.read(tmp_path / f"st{suffix}") == ls.read(tmp_path / f"uv{suffix}")


def test_too_large(tmp_path):
    mesh = CUBE.with_points(CUBE.points * 1e200)
    for suffix in (".stl", ".glb", ".3mf"):
        with pytest.raises(ValueError, match=rf"x\{suffix}: a coordinate is beyond float32"):
            ls.write(tmp_path / f"x{suffix}", mesh)
    for suffix in (".ply", ".off", ".vtp", ".vtk"):
        ls.write(tmp_path / f"y{suffix}", mesh)
        assert ls.read(tmp_path / f"y{suffix}") == mesh
    assert len(os.listdir(tmp_path)) == 4


@pytest.mark.parametrize("suffix", formats.WRITABLE)
def test_what_cannot_be_written(tmp_path, suffix):
    path = tmp_path / f"x{suffix}"
    flat = ls.Mesh(zoo.cube()[0][:, :2], zoo.cube()[1])
    nothing = ls.tessellate(ls.LimitSurface(ls.Mesh(*zoo.grid(1, 1), holes=[0])), 2)
    with pytest.raises(ValueError, match=rf"x\{suffix}: got points of shape \(8, 2\), need"):
        ls.write(path, flat)
    with pytest.raises(ValueError, match=rf"x\{suffix}: the tessellation has no polygon"):
        ls.write(path, nothing)
    with pytest.raises(TypeError, match="need a Mesh or a Tessellation, got list"):
        ls.write(path, [1, 2])
    assert os.listdir(tmp_path) == []


# --- Broken files


def samples(folder):
    """Bytes of good files by name, in all the ways that each format has."""
    import pyvista

    found = {}
    for suffix in formats.READABLE:
        if suffix in formats.WRITABLE and suffix not in formats.USD:
            for name, x in ("quads", CUBE), ("seams", SEAMS), ("pieces", PIECES):
                path = Path(folder, f"{name}{suffix}")
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    ls.write(path, x)
                found[path.name] = path.read_bytes()
    dataset = pyvista.PolyData(CUBE.points, np.insert(CUBE.faces, 0, 4, axis=1).ravel())
    for suffix in (".ply", ".stl", ".vtp", ".vtk"):
        path = Path(folder, f"text{suffix}")
        dataset.save(path, binary=False)
        found[path.name] = path.read_bytes()
    dataset.cast_to_unstructured_grid().save(Path(folder, "raw.vtu"))
    found["raw.vtu"] = Path(folder, "raw.vtu").read_bytes()
    return found


def broken(data, seed):
    """Bytes with some changed, cut off, left out or put in."""
    g = random.Random(seed)
    data, change = bytearray(data), seed % 4
    at = g.randrange(len(data))
    if change == 0:
        del data[at:]
    elif change == 1:
        for _ in range(g.randrange(1, 10)):
            data[g.randrange(len(data))] = g.randrange(256)
    elif change == 2:
        for _ in range(g.randrange(1, 4)):
            data[g.randrange(min(len(data), 900))] = g.choice(b'0123456789-. \n<>"=e')
    else:
        data[at : at + g.randrange(50)] = data[: g.randrange(100)]
    return bytes(data)


def read_broken(folder, first, last):
    """Read broken files of all kinds: cages, or MeshErrors that name the file; else the error."""
    for name, data in samples(folder).items():
        path = Path(folder, f"broken{Path(name).suffix}")
        # the readers of libraries are started anew for each
        seeds = range(first, last if path.suffix in formats.PLAIN else first + 2)
        for seed in seeds:
            path.write_bytes(broken(data, seed))
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", message=rf"{re.escape(str(path))}[,:] ")
                try:
                    ls.read(path)
                except Exception as error:
                    if not isinstance(error, ls.MeshError) or str(path) not in str(error):
                        raise AssertionError(name, seed) from error


def test_broken_files_end_nothing(tmp_path):
    """In a process of its own: a reader that fails would end this one."""
    code = "import sys, test_formats; test_formats.read_broken(sys.argv[1], 0, 40)"
    tests = Path(__file__).parent
    command = [sys.executable, "-W", "error", "-c", code, str(tmp_path)]
    done = subprocess.run(command, cwd=tests, capture_output=True, text=True, timeout=600)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.parametrize(
    "suffix", [s for s in formats.READABLE if s not in (*formats.USD, ".usdz")]
)
@pytest.mark.parametrize(
    "content",
    [b"", b"\0" * 500, np.random.default_rng(0).bytes(500), b"# hello\n" * 9, b"{}", b"<a/>"],
)
def test_noise(tmp_path, suffix, content):
    path = tmp_path / f"noise{suffix}"
    path.write_bytes(content)
    with pytest.raises(ls.MeshError, match=re.escape(str(path))):
        ls.read(path)
    if content == b"" and suffix != ".obj":
        with pytest.raises(ls.MeshError, match=r"noise.*: the file is empty$"):
            ls.read(path)


@pytest.mark.parametrize("suffix", [".ply", ".off", ".stl", ".vtp", ".vtu", ".vtk", *TRIANGLES[1:]])
def test_truncated_files(tmp_path, suffix):
    good, path = tmp_path / f"good{suffix}", tmp_path / f"cut{suffix}"
    ls.write(good, CUBE)
    data = good.read_bytes()
    for part in (0.02, 0.3, 0.6, 0.95):
        path.write_bytes(data[: int(part * len(data))])
        with pytest.raises(ls.MeshError, match=re.escape(str(path))):
            ls.read(path)


@pytest.mark.parametrize("suffix", formats.READABLE)
def test_no_file(tmp_path, suffix):
    path = tmp_path / f"none{suffix}"
    with pytest.raises(FileNotFoundError, match=re.escape(str(path))):
        ls.read(path)
    path.mkdir()
    with pytest.raises(IsADirectoryError, match=re.escape(str(path))):
        ls.read(path)
    if suffix in formats.WRITABLE:
        with pytest.raises(IsADirectoryError, match=re.escape(str(path))):
            ls.write(path, CUBE)
        missing = tmp_path / "no" / f"folder{suffix}"
        with pytest.raises(FileNotFoundError, match=re.escape(str(missing))):
            ls.write(missing, CUBE)


@pytest.fixture
def nobody():
    """Somebody without permission, even if the tests are run by root."""
    before = os.geteuid()
    if before == 0:
        os.seteuid(65534)
    yield
    if before == 0:
        os.seteuid(0)


@pytest.mark.parametrize("suffix", formats.WRITABLE)
def test_no_permission(tmp_path, request, suffix):
    path = tmp_path / f"x{suffix}"
    ls.write(path, CUBE)
    path.chmod(0)
    tmp_path.chmod(0o500)
    request.getfixturevalue("nobody")
    with pytest.raises(PermissionError, match=re.escape(str(path))):
        ls.read(path)
    with pytest.raises(PermissionError, match=re.escape(str(path))):
        ls.write(path, CUBE)


@pytest.mark.parametrize("suffix", formats.WRITABLE)
@pytest.mark.filterwarnings("ignore:.*cannot hold everything.*channel 'uv'")
def test_a_full_disk(tmp_path, suffix):
    """No file may grow beyond 1000 bytes: nothing is left behind, and what was there stays."""
    path = tmp_path / f"x{suffix}"
    path.write_text("old")
    ls.write(io.BytesIO(), PIECES, suffix=suffix)  # loads whatever is loaded on first use
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        with pytest.raises(OSError, match=re.escape(str(path))):
            ls.write(path, PIECES)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert os.listdir(tmp_path) == [path.name]
    assert path.read_text() == "old"


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no such device")
@pytest.mark.parametrize("suffix", formats.WRITABLE)
@pytest.mark.filterwarnings("ignore:.*cannot hold everything.*channel 'uv'")
def test_a_full_device(suffix):
    with pytest.raises(OSError, match="No space left on device: '/dev/full'"):
        ls.write("/dev/full", PIECES, suffix=suffix)
    with (
        pytest.raises(OSError, match="No space left on device: '/dev/full'"),
        open("/dev/full", "wb", buffering=0) as file,
    ):
        ls.write(file, PIECES, suffix=suffix)


@pytest.mark.parametrize(
    ("suffix", "module", "extra"),
    [
        (".vtp", "pyvista", "plot"),
        (".glb", "trimesh", "formats"),
        (".3mf", "networkx", "formats"),
        (".dae", "collada", "formats"),
        (".usda", "pxr", "usd"),
    ],
)
def test_a_library_that_is_missing(tmp_path, suffix, module, extra):
    path = tmp_path / f"x{suffix}"
    ls.write(path, CUBE)
    # modules that cannot be imported, before all others, here and in the process that reads
    fakes = tmp_path / "fakes"
    fakes.mkdir()
    for name in (module, "vtkmodules"):
        (fakes / f"{name}.py").write_text(f"raise ModuleNotFoundError('No module named {name}')")
    code = f"""
import sys
sys.path.insert(0, {str(fakes)!r})
import limitsurf as ls
cube = ls.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
target, source = {str(tmp_path / f"y{suffix}")!r}, {str(path)!r}
for call in (ls.write, target, cube), (ls.read, source):
    try:
        call[0](*call[1:])
    except ImportError as error:
        print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stderr == ""
    assert done.stdout.count(f'pip install "limitsurf[{extra}]"') == 2, done.stdout
    assert sorted(os.listdir(tmp_path)) == ["fakes", path.name]


# --- PLY

HEADER = """ply
format ascii 1.0
comment made by hand
obj_info nothing
element vertex 4
property float x
property float y
property uchar red
property float z
element face 2
property uchar flags
property list uchar int vertex_index
property list uchar float weights
element edge 1
property int vertex1
property int vertex2
end_header
"""
ROWS = "0 0 255 0\n1 0 255 0\n1 1 255 0\n0 1 0 0.5\n7 3 0 1 2 2 0.5 0.5\n7 4 0 1 2 3 0\n0 1\n"


def binary(order):
    word = {"<": "little", ">": "big"}[order]
    head = HEADER.replace("ascii", f"binary_{word}_endian").encode()
    vertices = [struct.pack(order + "ffBf", *row) for row in [(0, 0, 9, 0), (1, 0, 9, 0)]]
    vertices += [struct.pack(order + "ffBf", *row) for row in [(1, 1, 9, 0), (0, 1, 9, 0.5)]]
    faces = struct.pack(order + "BB3iB2f", 7, 3, 0, 1, 2, 2, 0.5, 0.5)
    faces += struct.pack(order + "BB4iB", 7, 4, 0, 1, 2, 3, 0)
    return head + b"".join(vertices) + faces + struct.pack(order + "ii", 0, 1)


@pytest.mark.parametrize(
    "data",
    [
        (HEADER + ROWS).encode(),
        (HEADER + ROWS).replace("\n", "\r\n").encode(),
        binary("<"),
        binary(">"),
    ],
)
def test_ways_to_write_ply(tmp_path, data):
    path = tmp_path / "x.ply"
    path.write_bytes(data)
    mesh = ls.read(path)
    assert mesh.points.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.5]]
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 1, 2, 3]]


def test_ply_of_many_faces_of_all_sizes(tmp_path):
    g = np.random.default_rng(0)
    sizes = g.integers(3, 300, 4000)
    mesh = ls.Mesh(g.random((500, 3)), (sizes, np.arange(sizes.sum()) * 7 % 500))
    path = tmp_path / "x.ply"
    ls.write(path, mesh)
    assert ls.read(path) == mesh


@pytest.mark.parametrize("block", [1, 7, 13, 14, 100, 1 << 12])
@pytest.mark.parametrize("text", [False, True])
def test_ply_of_many_blocks(tmp_path, monkeypatch, block, text):
    g = np.random.default_rng(block)
    sizes = g.integers(3, 9, 300)
    mesh = ls.Mesh(g.random((50, 3)), (sizes, np.arange(sizes.sum()) * 7 % 50))
    path = tmp_path / "x.ply"
    ls.write(path, mesh)
    if text:
        lines = path.read_bytes().partition(b"end_header\n")[0].decode().splitlines()
        lines[1] = "format ascii 1.0"
        lines += ["end_header", *(" ".join(map(repr, point)) for point in mesh.points.tolist())]
        lines += [" ".join(map(str, [len(face), *face.tolist()])) for face in mesh.faces]
        path.write_text("\n".join(lines))
    monkeypatch.setattr(ply, "_BLOCK", block)
    assert ls.read(path) == mesh
    data = path.read_bytes()
    for length in len(data) - 3, len(data) - 2000:
        path.write_bytes(data[:length])
        with pytest.raises(ls.MeshError, match="ends amid its 300 elements 'face': it is trunc"):
            ls.read(path)


def test_memory_of_a_ply_file(tmp_path):
    g = np.random.default_rng(0)
    sizes = g.integers(3, 5, 100_000)
    path = tmp_path / "x.ply"
    ls.write(path, ls.Mesh(g.random((500, 3)), (sizes, g.integers(0, 500, sizes.sum()))))
    data = path.read_bytes()
    tracemalloc.start()
    try:
        ply._Ply("x.ply", data)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 14 * len(data)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"plyx\n", "need 'ply' on the first line, this is no PLY file"),
        (b"ply\nformat ascii 1.0\n", "need a header that ends with 'end_header'"),
        (b"ply\nend_header\n", "need one of the formats binary_little_endian, "),
        (HEADER.replace("ascii 1.0", "ascii 2.0") + ROWS, "line 2: got 'format ascii 2.0', need"),
        (HEADER.replace("float x", "number x") + ROWS, "line 6: got 'property number x', need"),
        (HEADER.replace("face 2", "face -2") + ROWS, "line 10: got 'element face -2', need"),
        (HEADER.replace("float z", "float w") + ROWS, "need elements 'vertex' with the proper"),
        (
            HEADER.replace("vertex_index", "corners") + ROWS,
            "need elements 'face' or 'tristrips' with a",
        ),
        (HEADER + ROWS[:-20], "the file ends amid its 2 elements 'face': it is truncated"),
        (HEADER + ROWS.replace("0 1 2 3", "0 1 2 x"), "after the header: "),
        (HEADER + ROWS.replace("0 1 2 3", "0 1 2 4"), "face 1: vertex index 4 is out of range"),
        (HEADER + ROWS.replace("0 1 2 3", "0 1 2 .5"), "face 1: vertex index -1 is negative"),
        (HEADER + ROWS.replace("1 1 255", "nan 1 255"), "vertex 2: coordinate nan is not finite"),
        (HEADER + ROWS.replace("7 4 0", "7 -4 0"), "the file ends amid its 2 elements 'face'"),
        (HEADER.replace("face 2", "face 999999999999") + ROWS, "the file ends amid its 9999"),
        (HEADER.replace("vertex 4", "vertex 0") + ROWS, "the file ends amid its"),
        (binary("<")[:-9], "the file ends amid its 2 elements 'face': it is truncated"),
        (binary("<")[:-1], "the file ends amid its 1 elements 'edge': it is truncated"),
    ],
)
def test_broken_ply(tmp_path, data, message):
    path = tmp_path / "x.ply"
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    with pytest.raises(ls.MeshError) as caught:
        ls.read(path)
    assert str(caught.value).startswith(f"{path}: {message}")


# --- OFF

OFF = "0 0 0\n1 0 0 # a comment\n1 1 0 255 0 0\n\n0 1 0\n3 0 1 2\n4 0 1 2 3  0.5 0.5 0.5 1\n"


@pytest.mark.parametrize(
    "text",
    [
        "OFF\n4 2 5\n" + OFF,
        "OFF 4 2 5\n" + OFF,
        "# first\n\nOFF # x\n\n4 2\n" + OFF,
        "COFF\r\n4 2 0\r\n" + OFF.replace("\n", "\r\n"),
        "CNOFF\n4 2 0\n" + OFF + "anything\n",
        "4 2 0\n" + OFF,
        "OFF4 2 0\n" + OFF,
        "nOFF\n3\n4 2 0\n" + OFF,
        "nOFF 3 4 2 0\n" + OFF,
        "4OFF\n4 2 0\n0 0 0 1\n2 0 0 2\n2 2 0 2 255\n0 -1 0 -1\n" + OFF[OFF.index("3 0 1") :],
    ],
)
def test_ways_to_write_off(tmp_path, text):
    path = tmp_path / "x.off"
    path.write_bytes(text.encode())
    mesh = ls.read(path)
    assert mesh.points.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 1, 2, 3]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("OOFF\n1 1 1\n", ": need 'OFF' on the first line: this is no such file"),
        ("nOFF 4\n1 1 1\n", ": need points of three coordinates, got 'nOFF' of 4"),
        ("4OFF 1 1 1\n0 0 0\n3 0 0 0", ", line 2: got 3 numbers, need 4 coordinates"),
        ("OFF BINARY\n1 1 1\n1 1 1\n", ": the file ends amid its"),
        ("OFF BINARY\n1 1 1", ": need the numbers of vertices and faces after the"),
        ("OFF\n", ": need the numbers of vertices and faces after 'OFF'"),
        ("OFF 4\n", ": need the numbers of vertices and faces after 'OFF'"),
        ("OFF\n4 x\n", ", line 2: got 'x', need the numbers of vertices and faces"),
        ("OFF\n5 2 0\n" + OFF, ": need 5 lines of vertices and 2 of faces, got 6: the file is tr"),
        ("OFF\n4 2\n" + OFF.replace("0 1 0", "0 1"), ", line 7: got 2 numbers, need three coord"),
        ("OFF\n4 2\n" + OFF.replace("0 1 0", "0 1 z"), ", line 7: got 'z', need a finite number"),
        ("OFF\n4 2\n" + OFF.replace("4 0 1", "9 0 1"), ", line 9: got a face of size 9, need the"),
        ("OFF\n4 2\n" + OFF.replace("3 0 1", "-2 0 1"), ", line 8: got a face of size -2, need"),
        ("OFF\n4 1\n" + OFF.replace("3 0 1", "2 0 1"), ": need a face of 3 corners or more that"),
        ("OFF\n4 2\n" + OFF.replace("3 0 1", "3 0 .5"), ", line 8: got '.5', need a vertex"),
        ("OFF\n4 2\n" + OFF.replace("3 0 1", "3 0 4"), ": face 0: vertex index 4 is out of range"),
        ("OFF\n-4 2\n" + OFF, ": need -4 lines of vertices"),
    ],
)
def test_broken_off(tmp_path, text, message):
    path = tmp_path / "x.off"
    path.write_text(text)
    with pytest.raises(ls.MeshError) as caught:
        ls.read(path)
    assert str(caught.value).startswith(f"{path}{message}")


def binary_off(keyword, *more):
    """A square, with more numbers at each vertex."""
    head = struct.pack(">3i", 4, 1, 4)
    rows = [(0, 0, 0, *more), (1, 0, 0, *more), (1, 1, 0, *more), (0, 1, 0, *more)]
    vertices = b"".join(struct.pack(f">{len(row)}f", *row) for row in rows)
    return f"{keyword} BINARY\n".encode() + head + vertices + struct.pack(">6i", 4, 0, 1, 2, 3, 0)


@pytest.mark.parametrize(
    ("keyword", "more"),
    [
        ("OFF", ()),
        ("COFF", (0, 0, 0, 1)),
        ("NOFF", (0, 0, 1)),
        ("4OFF", (1,)),
        ("STCNOFF", (0, 0, 1, 0, 0, 0, 1, 0.5, 0.25)),
    ],
)
def test_binary_off(tmp_path, keyword, more):
    path, data = tmp_path / "x.off", binary_off(keyword, *more)
    path.write_bytes(data)
    mesh = ls.read(path)
    assert mesh.points.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert mesh.faces.tolist() == [[0, 1, 2, 3]]
    if "ST" in keyword:
        assert uv_of_corners(mesh).tolist() == [[0.5, 0.25]] * 4
    for length in range(len(data)):
        path.write_bytes(data[:length])
        with pytest.raises(ls.MeshError, match=r"x\.off: "):
            ls.read(path)


# --- Strips, corners repeated, attributes that do not fit


STRIPS = (
    "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\n"
    "property float z\nelement tristrips 2\nproperty list int int vertex_indices\nend_header\n"
    "0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 2 0\n1 2 0\n"
)


@pytest.mark.parametrize(
    ("lists", "faces"),
    [
        ("4 0 1 2 3\n0\n", [[0, 1, 2], [2, 1, 3]]),
        ("4 0 1 2 3\n4 2 3 4 5\n", [[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5]]),
        ("9 0 1 2 -1 2 3 4 5 -1\n2 0 1\n", [[0, 1, 2], [2, 3, 4], [4, 3, 5]]),
        ("8 0 1 2 2 3 3 4 5\n1 0\n", [[0, 1, 2], [4, 3, 5]]),
    ],
)
def test_strips_of_ply(tmp_path, lists, faces):
    """The second triangle of a strip, the fourth, ... are turned around; -1 begins a new one."""
    path = tmp_path / "x.ply"
    path.write_text(STRIPS + lists)
    assert ls.read(path).faces.tolist() == faces


WEDGES = HEADER.replace("float weights", "float texcoord")


def test_texture_coordinates_of_corners_of_ply(tmp_path):
    path = tmp_path / "x.ply"
    rows = ROWS.replace("2 0.5 0.5\n", "6 0 0 1 0 1 1\n").replace("1 2 3 0\n", "1 2 3 8 {}\n")
    path.write_text(WEDGES + rows.format("0 0 .5 0 .5 .5 0 .5"))
    found = uv_of_corners(ls.read(path)).tolist()
    assert found == [[0, 0], [1, 0], [1, 1], [0, 0], [0.5, 0], [0.5, 0.5], [0, 0.5]]
    for wrong in "0", "6 0 0 1 0 1 1":
        path.write_text(WEDGES + rows.replace("8 {}", wrong))
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            mesh = ls.read(path)
        text = "face 1: 1 of 2 faces without texture coordinates, which are NaN there"
        assert any(text in str(warning.message) for warning in caught)
        assert np.isnan(uv_of_corners(mesh)).all(axis=1).tolist() == [False] * 3 + [True] * 4
    with pytest.raises(
        ls.MeshError, match=r"x\.ply, face 1: got 6 texture coordinates, need 8, two"
    ):
        ls.read(path, strict=True)


BAD_POLYGONS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [np.nan, np.inf, 0]])


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".off", ".vtp", ".glb"])
def test_what_is_sound_of_polygons_is_read(tmp_path, suffix):
    """A corner twice in succession, a face of two corners, a point that is nowhere: in any file."""
    path, faces = tmp_path / f"x{suffix}", [[0, 1, 2, 2], [0, 2, 3, 0], [1, 2, 1]]
    if suffix == ".obj":
        text = "".join("v {} {} {}\n".format(*p) for p in BAD_POLYGONS)
        path.write_text(text + "".join(f"f {' '.join(str(v + 1) for v in f)}\n" for f in faces))
    elif suffix == ".off":
        text = "OFF\n5 3 0\n" + "".join("{} {} {}\n".format(*p) for p in BAD_POLYGONS)
        path.write_text(text + "".join(f"{len(f)} {' '.join(map(str, f))}\n" for f in faces))
    elif suffix == ".ply":
        text = STRIPS.replace("vertex 6", "vertex 5").replace("tristrips 2", "face 3")[:170]
        text = text.partition("end_header")[0] + "end_header\n"
        text += "".join("{} {} {}\n".format(*p) for p in BAD_POLYGONS)
        path.write_text(text + "".join(f"{len(f)} {' '.join(map(str, f))}\n" for f in faces))
    elif suffix == ".vtp":
        import pyvista

        pyvista.PolyData(BAD_POLYGONS, np.concatenate([[len(f), *f] for f in faces])).save(path)
    else:
        import trimesh

        faces = [[0, 1, 2], [0, 2, 3], [1, 2, 1]]
        mesh = trimesh.Trimesh(BAD_POLYGONS, faces, process=False)
        path.write_bytes(mesh.export(file_type="glb"))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        mesh = ls.read(path)
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert mesh.points[:4].tolist() == BAD_POLYGONS[:4].tolist()
    said = " ".join(str(warning.message) for warning in caught)
    assert "vertex 4 is not finite, but in no face: put where another one is" in said
    assert "1 of 3 faces with less than 3 corners that differ: left out" in said
    assert ("2 of 3 faces with a corner twice in succession" in said) == (suffix != ".glb")
    with pytest.raises(ls.MeshError, match=re.escape(str(path))):
        ls.read(path, strict=True)


LEGACY = (
    "# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\nPOINTS 4 float\n"
    "0 0 0\n1 0 0\n1 1 0\n0 1 0\n"
)


@pytest.mark.parametrize(
    ("text", "faces", "said"),
    [
        ("POLYGONS 1 5\n4 0 1 2 3\nTRIANGLE_STRIPS 1 5\n4 0 1 3 2\n", [4, 3, 3], None),
        ("POLYGONS 1 5\n4 0 1 2 3\nLINES 1 3\n2 0 1\n", [4], "lines (1)"),
        (
            "POLYGONS 1 5\n4 0 1 2 3\nPOINT_DATA 3\nSCALARS a float 1\nLOOKUP_TABLE default\n0 1\n",
            [4],
            "got attributes of points or cells that are truncated or broken: left out",
        ),
    ],
)
def test_legacy_vtk(tmp_path, text, faces, said):
    path = tmp_path / "x.vtk"
    path.write_text(LEGACY + text)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert ls.read(path).sizes.tolist() == faces
    assert [said in str(warning.message) for warning in caught] == [True] * (said is not None)
    assert {warning.filename for warning in caught} <= {__file__}


def test_attributes_of_vtk_that_do_not_fit(tmp_path):
    import pyvista

    path = tmp_path / "x.vtp"
    square = pyvista.PolyData(BAD_POLYGONS[:4], [4, 0, 1, 2, 3])
    square.point_data["warm"] = np.arange(4.0)
    square.save(path, binary=False)
    with pytest.warns(UserWarning, match="left out: of points warm$"):
        assert ls.read(path).n_faces == 1
    path.write_text(re.sub(r'(Name="warm"[^>]*>)[^<]*', r"\1 0 1 ", path.read_text()))
    with pytest.warns(UserWarning, match="attributes of points or cells that are truncated"):
        assert ls.read(path).n_faces == 1
    with pytest.raises(ls.MeshError, match=r"x\.vtp: got attributes"):
        ls.read(path, strict=True)


def test_objects_without_texture_coordinates(tmp_path):
    import trimesh

    one, other = trimesh.creation.box(), trimesh.creation.box()
    one.visual = trimesh.visual.TextureVisuals(uv=np.random.default_rng(0).random((8, 2)))
    other.apply_translation([3, 0, 0])
    with pytest.warns(UserWarning, match="12 of 24 faces without texture coordinates") as caught:
        mesh = ls.from_trimesh(trimesh.Scene([one, other]))
    assert caught[0].filename == __file__
    lacking = np.isnan(uv_of_corners(mesh)).all(axis=1)
    assert np.array_equal(lacking, mesh.points[mesh.indices][:, 0] > 1)
    (tmp_path / "x.glb").write_bytes(trimesh.Scene([one, other]).export(file_type="glb"))
    with pytest.warns(UserWarning, match="12 of 24 faces without texture coordinates"):
        ls.read(tmp_path / "x.glb")


# --- STL


def test_points_of_stl_are_joined(tmp_path):
    path = tmp_path / "x.stl"
    ls.write(path, ls.Mesh(*zoo.tetrahedron()))
    assert path.stat().st_size == 84 + 4 * 50
    mesh = ls.read(path)
    assert (mesh.n_vertices, mesh.n_edges, mesh.n_faces) == (4, 6, 4)
    facet = "facet normal 0 0 1\n outer loop\n{}endloop\nendfacet\n"
    corners = ["  vertex 0 0 0\n  vertex 1 0 0\n  vertex 0 1.0e0 0\n"]
    corners += ["  vertex 1 0 0\n  VERTEX 1 1 0\n  vertex 0 1 -0\n"]
    corners += ["  vertex 1 0 0\n  vertex 1 0 0\n  vertex 0 1 0\n"]  # no area
    path.write_text("solid a\n" + "".join(map(facet.format, corners)) + "endsolid a\n")
    with pytest.warns(UserWarning, match="1 of 3 faces with less than 3 corners that differ"):
        mesh = ls.read(path)
    assert mesh.points.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]
    assert mesh.faces.tolist() == [[0, 1, 2], [1, 3, 2]]
    path.write_text(path.read_text().replace("1.0e0", "one"))
    with pytest.raises(ls.MeshError, match=r"x\.stl: trimesh cannot read it"):
        ls.read(path)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"solid a\nendsolid a\n", "need at least one triangle, got none$"),
        (b"solid a\n outer loop\n vertex 0 0 0\n", "need 'endsolid' at the end: .* truncated"),
        (b"solid a\nendsolid a\nsolid b\n vertex 0 0 0\n", "need 'endsolid' .* truncated"),
        (b"solid", "need 'endsolid' at the end: the file is truncated"),
        (bytes(84), "need at least one triangle, got none$"),
        (
            bytes(80) + b"\2\0\0\0" + bytes(50),
            "a binary header promises 2 triangles, 184 bytes, got 134: truncated, or no STL file",
        ),
        (
            b"solid".ljust(80) + b"\1\0\0\0" + bytes(51),
            "a binary header promises 1 triangles, 134 bytes, got 135: this is no STL file",
        ),
        (bytes(50), "need a header of 84 bytes, got 50: truncated, or no STL file"),
        (b"x" * 200, "this is no STL file: need 'solid' at the start of a text, or"),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n" * 9, "this is no STL file: need 'solid'"),
    ],
)
def test_broken_stl(tmp_path, data, message):
    path = tmp_path / "x.stl"
    path.write_bytes(data)
    with pytest.raises(ls.MeshError, match=rf"^{re.escape(str(path))}: {message}"):
        ls.read(path)


# --- VTK


@pytest.mark.parametrize("suffix", [".vtp", ".vtu", ".vtk"])
def test_vtk_files_hold_all_channels_of_a_tessellation(tmp_path, suffix):
    import pyvista

    points, faces = zoo.cube()
    corners = np.ravel(faces)
    linear = np.asarray(points, float) @ np.diag([1, 2, 3]) + 1
    channels = {"uv": (linear[:, :2], corners, "none"), "warm": (linear[:, 0], corners, "none"),
                "push": (linear, corners, "none")}  # fmt: skip
    surface = ls.LimitSurface(ls.Mesh(points, faces, channels=channels))
    path = tmp_path / f"x{suffix}"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ls.write(path, ls.tessellate(surface, 3, channels=channels))
    for found in (pyvista.read(path), ls.to_pyvista(surface, n=3)):
        expected = found.points @ np.diag([1, 2, 3]) + 1
        assert np.allclose(found.point_data["push"], expected, atol=1e-12)
        assert np.allclose(found.point_data["warm"], expected[:, 0], atol=1e-12)
        assert np.allclose(found.point_data["uv"], expected[:, :2], atol=1e-6)


def test_what_vtk_files_may_hold(tmp_path):
    import pyvista

    path = tmp_path / "x.vtu"
    pyvista.ImageData(dimensions=(2, 2, 2)).cast_to_unstructured_grid().save(path)
    text = (
        r"x\.vtu: need cells of types triangle, polygon, quad, triangle strip, pixel, got some of "
        r"type voxel: of .*"
    )
    with pytest.raises(ls.MeshError, match=text + r"dataset\.extract_surface\(\) is the skin"):
        ls.read(path)
    path = tmp_path / "x.vtk"
    pyvista.ImageData(dimensions=(2, 2, 2)).save(path)
    with pytest.raises(ls.MeshError, match=r"x\.vtk: need polygons, got Structured"):
        ls.read(path)
    pyvista.PolyData(np.eye(4)[:, :3], strips=[4, 0, 1, 2, 3]).save(path)
    assert ls.read(path).faces.tolist() == [[0, 1, 2], [2, 1, 3]]
    pyvista.PolyData(np.eye(3)).save(path)
    with pytest.raises(ls.MeshError, match=r"x\.vtk: need at least one polygon, got none"):
        ls.read(path)


def test_pyvista_of_a_tessellation():
    split = PIECES.split()
    found = ls.to_pyvista(PIECES)
    assert (found.n_points, found.n_cells) == (len(split.points), len(split.sizes))
    assert np.array_equal(found.points, split.points)
    assert np.array_equal(found.active_normals, split.normals)
    assert np.allclose(found.active_texture_coordinates, split.channels["uv"][0])
    bare = ls.to_pyvista(ls.tessellate(ls.LimitSurface(CUBE), 2, normals=False))
    assert list(bare.point_data) == []
    with pytest.raises(TypeError, match="got str"):
        ls.to_pyvista("x")


# --- What else the libraries read

SHAPE = """Shape { geometry IndexedFaceSet {
  coord Coordinate { point [ 0 0 0, 1 0 0, 1 1 0, 0 1 0 ] }
  coordIndex [ 0 1 2 3 -1 ]
} }
"""
MOVED = f"Transform {{ translation 5 0 0 children [ {SHAPE} ] }}\n"
XAML = """<Viewport3D xmlns="http://schemas.microsoft.com/winfx/2006/xaml/presentation">
<ModelVisual3D><ModelVisual3D.Content><GeometryModel3D><GeometryModel3D.Geometry>
<MeshGeometry3D Positions="0,0,0 1,0,0 1,1,0 0,1,0" TriangleIndices="0 1 2 0 2 3"
 Normals="0,0,1 0,0,1 0,0,1 0,0,1"/>
</GeometryModel3D.Geometry></GeometryModel3D></ModelVisual3D.Content></ModelVisual3D>
</Viewport3D>"""


def test_scenes_of_vrml(tmp_path):
    path = tmp_path / "x.WRL"
    path.write_text("#VRML V2.0 utf8\n" + SHAPE + MOVED)
    mesh = ls.read(path)
    assert mesh.faces.tolist() == [[0, 1, 2, 3], [4, 5, 6, 7]]
    assert np.array_equal(mesh.points[4:], mesh.points[:4] + np.array([5, 0, 0]))
    path.rename(tmp_path / "plain")
    assert ls.read(str(tmp_path / "plain"), suffix=".wrl") == mesh
    for part in (70, 200, 240, -3):
        path.write_text(("#VRML V2.0 utf8\n" + SHAPE + MOVED)[:part])
        with pytest.raises(ls.MeshError, match=r"x\.WRL: truncated or broken: VTK "):
            ls.read(path)
    path.write_text("#VRML V2.0 utf8\n" + MOVED.replace("translation 5 0 0", "scale -1 1 1"))
    with pytest.raises(ls.MeshError, match=r"x\.WRL: an object is mirrored"):
        ls.read(path)


def test_scenes_of_3ds(tmp_path):
    def chunk(number, content):
        return struct.pack("<HI", number, len(content) + 6) + content

    path = tmp_path / "x.3ds"
    points, triangles = np.eye(4, 3, -1), [(0, 2, 1, 7), (0, 1, 3, 7), (1, 2, 3, 7), (2, 0, 3, 7)]
    content = chunk(0x4110, struct.pack("<H12f", 4, *points.ravel()))
    content += chunk(0x4120, struct.pack("<H16H", 4, *np.ravel(triangles)))
    content = chunk(0x3D3D, chunk(0x4000, b"name\0" + chunk(0x4100, content)))
    data = chunk(0x4D4D, chunk(2, struct.pack("<I", 3)) + content)
    path.write_bytes(data)
    mesh = ls.read(path)
    assert (mesh.n_vertices, mesh.n_edges, mesh.n_faces) == (4, 6, 4)
    assert np.isclose(np.linalg.det(mesh.points[mesh.uniform]).sum(), 1)
    for part in (1, 50, len(data) - 20):
        path.write_bytes(data[:part])
        with pytest.raises(ls.MeshError, match=r"x\.3ds: truncated"):
            ls.read(path)


def test_files_of_facets(tmp_path):
    path = tmp_path / "x.g"
    text = "1 4 1 4\n1 1\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n1 2 3 -4\n"
    path.write_text(text)
    assert ls.read(path).faces.tolist() == [[0, 1, 2, 3]]
    path.write_text(text[:20])
    with pytest.raises(ls.MeshError, match=r"x\.g: PyVista cannot read it, truncated or broken: "):
        ls.read(path)


def test_blocks_become_one_mesh(tmp_path):
    import pyvista
    from vtkmodules.vtkIOHDF import vtkHDFWriter

    cube, flat = pyvista.Cube().clean(), np.meshgrid([0.0, 1, 2], [0.0, 1, 2], [0.0])
    cube.clear_data()
    moved, grid = cube.translate([3, 0, 0]), pyvista.StructuredGrid(*flat)
    path = tmp_path / "x.vtm"
    pyvista.MultiBlock([cube, None, pyvista.MultiBlock([moved, grid])]).save(path)
    mesh = ls.read(path)
    assert (mesh.n_vertices, mesh.n_faces) == (8 + 8 + 9, 6 + 6 + 4)
    assert np.array_equal(mesh.points[8:16], mesh.points[:8] + np.array([3, 0, 0]))
    assert not mesh.channels
    (tmp_path / "x" / "x_0.vtp").unlink()
    with pytest.raises(ls.MeshError, match=r"x\.vtm: .*truncated or broken"):
        ls.read(path)
    writer, path = vtkHDFWriter(), tmp_path / "x.vtkhdf"
    writer.SetInputData(cube)
    writer.SetFileName(str(path))
    writer.Write()
    assert ls.read(path) == ls.from_pyvista(cube)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(ls.MeshError, match=r"x\.vtkhdf: .*truncated or broken"):
        ls.read(path)


def test_images_and_volumes_are_no_cages(tmp_path):
    import pyvista
    from PIL import Image

    path = tmp_path / "x.png"
    Image.new("RGB", (4, 4)).save(path)
    with pytest.raises(ls.MeshError, match=r"x\.png: need polygons, got ImageData$"):
        ls.read(path)
    path = tmp_path / "x.vts"
    pyvista.StructuredGrid(*np.meshgrid([0.0, 1], [0.0, 1], [0.0, 1])).save(path)
    with pytest.raises(ls.MeshError, match=r"x\.vts: need cells .* type hexahedron: .* the skin"):
        ls.read(path)


@pytest.mark.parametrize("suffix", [".xaml", ".zae"])
def test_what_else_trimesh_reads(tmp_path, suffix):
    path = tmp_path / f"x{suffix}"
    if suffix == ".xaml":
        path.write_text(XAML)
        assert ls.read(path).faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    else:
        ls.write(tmp_path / "x.dae", CUBE)
        with zipfile.ZipFile(path, "w") as archive:
            archive.write(tmp_path / "x.dae", "x.dae")
        assert ls.read(path) == ls.read(tmp_path / "x.dae")
    with open(path, "rb") as file:
        assert ls.read(file, suffix=suffix) == ls.read(path)
    for content in path.read_bytes()[:-200], b"\0" * 99:
        path.write_bytes(content)
        with pytest.raises(
            ls.MeshError, match=rf"x\{suffix}: (trimesh|pycollada) cannot read it, truncated"
        ):
            ls.read(path)


def archive_of(size, method):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method) as archive, archive.open("x.dae", "w") as member:
        for _ in range(size >> 20):
            member.write(bytes(1 << 20))
    return file.getvalue()


@pytest.mark.parametrize("suffix", [".3mf", ".zae", ".3dxml"])
def test_archives_that_would_fill_the_memory(tmp_path, suffix):
    path = tmp_path / f"x{suffix}"
    size = 1 << 28
    data = archive_of(size, zipfile.ZIP_DEFLATED)
    path.write_bytes(data)
    limit = 64 * len(data) + (1 << 26)
    need = (
        f"^{re.escape(str(path))}: an archive of {len(data)} bytes that holds {size}, need {limit}"
    )
    with pytest.raises(ls.MeshError, match=need):
        ls.read(path)
    # one that tells less than it holds
    path.write_bytes(data.replace(struct.pack("<I", size), struct.pack("<I", 1000)))
    with pytest.raises(
        ls.MeshError, match=rf"x\{suffix}: (trimesh|pycollada) cannot .* broken: BadZipFile"
    ):
        ls.read(path)
    path.write_bytes(archive_of(1 << 20, zipfile.ZIP_LZMA))
    with pytest.raises(
        ls.MeshError, match=rf"x\{suffix}: got 'x\.dae' compressed by method 14, need"
    ):
        ls.read(path)


def gltf(nodes, uri):
    """A glTF file of one triangle, as text; its first node is the scene."""
    views = [{"buffer": 0, "byteOffset": 0, "byteLength": 36}]
    views.append({"buffer": 0, "byteOffset": 36, "byteLength": 6})
    corners = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}
    accessors = [corners, {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"}]
    return json.dumps(
        {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": nodes,
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
            "accessors": [corners | {"min": [0, 0, 0], "max": [1, 1, 0]}, accessors[1]],
            "bufferViews": views,
            "buffers": [{"byteLength": 42, "uri": uri}],
        }
    )


TRIANGLE = np.eye(3, dtype=np.float32).tobytes() + np.arange(3, dtype=np.uint16).tobytes()
INLINE = "data:application/octet-stream;base64," + base64.b64encode(TRIANGLE).decode()
SQUARE = """def Mesh "m" {
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
}
"""
DOUBLED = "".join(
    f'def Xform "a{i + 1}" {{\ndef "x" (references = </a{i}>) {{}}\n'
    f'def "y" (references = </a{i}>) {{}}\n}}\n'
    for i in range(20)
)
# files that ask for more memory or time than is in proportion to them
GREEDY = {
    "expo.usda": f'#usda 1.0\ndef Xform "a0" {{\n{SQUARE}}}\n{DOUBLED}',
    "deep.gltf": gltf([{"children": [i + 1]} for i in range(40_000)] + [{"mesh": 0}], INLINE),
    "vast.vtk": "# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\nPOINTS 99999999999 float\n"
    "0 0 0 1 0 0 1 1 0 0 1 0\nPOLYGONS 1 5\n4 0 1 2 3\n",
}


# a process of its own: a child begins with the largest size that its parent ever had
READ = """
import resource, sys
import limitsurf as ls
from limitsurf.shell.io import apart

for path in sys.argv[1:]:
    try:
        ls.read(path)
        print(path, "is read")
    except ls.MeshError as error:
        print(error)
apart._end_servers()
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere sizes are in other units")
def test_memory_and_time_are_in_proportion_to_a_file(tmp_path):
    paths = [tmp_path / name for name in GREEDY]
    for path in paths:
        path.write_text(GREEDY[path.name])
    command = [sys.executable, "-c", READ, *map(str, paths)]
    environment = os.environ | {apart.SCALE: "0.5"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert not done.returncode, done.stderr
    *messages, taken = done.stdout.splitlines()
    for path, message in zip(paths, messages, strict=True):
        assert message.startswith(f"{path}: ")
    assert int(taken) < 1 << 20  # kB, of the largest child


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no such pipes")
@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.gltf", gltf([{"mesh": 0}], "pipe.usda")),
        ("a.usda", '#usda 1.0\ndef Xform "a" (references = @pipe.usda@) {}\n'),
        ("pipe.usda", None),
    ],
)
def test_pipes_that_nobody_writes_to(name, text, tmp_path, monkeypatch):
    monkeypatch.setattr(files, "PATIENCE", 0.2)
    os.mkfifo(tmp_path / "pipe.usda")
    if text is None:
        with pytest.raises(TimeoutError, match="nobody has opened this pipe"):
            ls.read(tmp_path / name)
        return
    (tmp_path / name).write_text(text)
    with pytest.raises(ls.MeshError, match=r"refers to .*pipe\.usda, a pipe or a device: need"):
        ls.read(tmp_path / name)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no such pipes")
@pytest.mark.parametrize("suffix", [".off", ".usda"])
def test_pipes_by_name(suffix, tmp_path):
    ls.write(tmp_path / f"cube{suffix}", CUBE)
    pipe = tmp_path / f"pipe{suffix}"
    os.mkfifo(pipe)
    data = (tmp_path / f"cube{suffix}").read_bytes()
    writer = threading.Thread(target=pipe.write_bytes, args=[data], daemon=True)
    writer.start()
    assert ls.read(pipe).n_faces == 6


def test_what_has_no_end_is_not_read_to_the_end(monkeypatch):
    monkeypatch.setattr(memory, "available", lambda: 1 << 24)
    with open("/dev/zero", "rb") as endless, pytest.raises(MemoryError, match="has no end"):
        ls.read(endless, suffix=".off")


def answers(kind):
    """What a process of its own is to hand over."""
    if kind == "mesh":
        return tagged_cube()
    warnings.warn("a warning", RuntimeWarning, stacklevel=1)
    if kind == "os":
        raise FileNotFoundError(2, "No such file", "x.bin")
    if kind == "memory":
        raise MemoryError
    if kind == "end":
        os.kill(os.getpid(), 9)
    if kind == "mesh error":
        ls.Mesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 7]])
    raise UnicodeDecodeError("utf-8", b"\xff", 0, 1, "bad")


def tagged_cube():
    return ls.Mesh(
        CUBE.points,
        (CUBE.sizes, CUBE.indices),
        creases={(0, 1): 2.5},
        corners={3: 1},
        holes=[2],
        scheme="loop",
        boundary="none",
        creasing="chaikin",
        triangles="smooth",
        channels={"a": (np.arange(3.0), CUBE.indices % 3, "all"), "st": SEAMS.channels["uv"]},
    )


@pytest.mark.parametrize(
    ("kind", "error", "message"),
    [
        ("os", FileNotFoundError, "No such file"),
        (
            "memory",
            ls.MeshError,
            r"^name: .*more than .* MiB of memory, the limit for 10 bytes",
        ),
        ("end", ls.MeshError, r"^name: truncated or broken: .* signal 9"),
        ("mesh error", ls.MeshError, "vertex index 7 is out of range"),
        ("text", ValueError, "codec can't decode"),
    ],
)
def test_what_another_process_hands_over(kind, error, message, monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parent))

    def handed(kind):
        return apart.read_apart("name", 10, "test_formats:answers", kind)

    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        with pytest.raises(error, match=message) as caught:
            handed(kind)
    if kind in ("os", "text"):
        assert [(item.category, str(item.message)) for item in said] == [
            (RuntimeWarning, "a warning")
        ]
    if kind == "os":
        assert (caught.value.errno, caught.value.filename) == (2, "x.bin")
    if kind == "mesh error":
        assert caught.value.culprits == (("face", 0),)
        assert handed("mesh") == tagged_cube()


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere every child loads by itself")
def test_what_is_loaded_once_reads_many_files(tmp_path, monkeypatch):
    monkeypatch.setattr(apart._Server, "known", {})
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    path = tmp_path / "a.stl"
    ls.write(path, ls.tessellate(ls.LimitSurface(CUBE), 2, normals=False))

    def servers():
        return list(apart._Server.known.values())

    expected = ls.read(path)
    (first,) = servers()
    monkeypatch.chdir(tmp_path)
    assert ls.read("a.stl") == expected
    library = formats._READERS["trimesh"][1]
    with pytest.raises(ls.MeshError, match="signal 9"):
        apart.read_apart("name", 10, "test_formats:answers", "end", modules=library)
    assert first in servers()
    with first.lock:  # as if another thread were reading
        assert ls.read(path) == expected
    first.process.kill()
    first.process.wait()
    assert ls.read(path) == expected
    assert first not in servers()
    later = servers()
    for server in later:
        server.link.close()  # as if it had waited long enough
        assert server.process.wait(timeout=60) is not None
    assert ls.read(path) == expected
    for server in servers():
        server.end()


@pytest.mark.parametrize("given", ["0", "-1", "nan", "x"])
def test_limits_that_are_none(given, tmp_path, monkeypatch):
    ls.write(tmp_path / "a.usda", CUBE)
    monkeypatch.setenv(apart.SCALE, given)
    with pytest.raises(ValueError, match=f"{apart.SCALE} must be a number > 0, got '{given}'"):
        ls.read(tmp_path / "a.usda")


@pytest.mark.parametrize("suffix", [".wrl", ".facet", ".vtkhdf", ".case", ".xaml", ".zae", ".png"])
@pytest.mark.parametrize("content", [b"", b"\0" * 500, b"# hello\n" * 9])
def test_noise_in_other_formats(tmp_path, capfd, suffix, content):
    path = tmp_path / f"noise{suffix}"
    with pytest.raises(FileNotFoundError, match=re.escape(str(path))):
        ls.read(path)
    path.write_bytes(content)
    with pytest.raises(ls.MeshError, match=f"^{re.escape(str(path))}: "):
        ls.read(path)
    assert capfd.readouterr() == ("", "")


def test_what_needs_a_path(tmp_path):
    text = r": files of type \.wrl are read from a path, not from a pipe"
    with pytest.raises(ValueError, match="<stdin>" + text):
        ls.read(io.BytesIO(b"#VRML V2.0 utf8\n" + SHAPE.encode()), suffix=".wrl")


@pytest.mark.parametrize(
    ("suffix", "module"),
    [(".wrl", "pyvista.core.utilities.reader"), (".xaml", "trimesh.exchange.load")],
)
def test_other_formats_without_their_library(tmp_path, monkeypatch, suffix, module):
    path = tmp_path / f"x{suffix}"
    path.write_text(XAML)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ValueError, match=rf"x\{suffix}: unknown suffix .* PyVista reads$"):
        ls.read(path)


# --- trimesh


def test_trimesh_keeps_everything():
    import trimesh

    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    uv = np.arange(12).reshape(6, 2) / 12
    visual = trimesh.visual.TextureVisuals(uv=uv)
    given = trimesh.Trimesh(points, [[0, 1, 2], [3, 4, 5]], visual=visual, process=False)
    mesh = ls.from_trimesh(given, boundary="edge_only", creases={(0, 1): 2})
    assert mesh.boundary == "edge_only"
    assert np.array_equal(mesh.points, points)
    assert mesh.faces.tolist() == [[0, 1, 2], [3, 4, 5]]
    assert np.array_equal(uv_of_corners(mesh), uv)
    joined = ls.from_trimesh(given, merge=True)
    assert joined.faces.tolist() == [[0, 1, 2], [1, 3, 2]]
    assert np.array_equal(uv_of_corners(joined), uv)
    assert not ls.from_trimesh(trimesh.creation.box()).channels
    with pytest.raises(TypeError, match=r"need a trimesh\.Trimesh or Scene, got list"):
        ls.from_trimesh([])
    with pytest.raises(ls.MeshError, match="at least one"):
        ls.from_trimesh(trimesh.Scene())


def test_scenes_become_one_mesh(tmp_path):
    import trimesh

    scene, box = trimesh.Scene(), trimesh.creation.box()
    scene.add_geometry(box, node_name="a", transform=np.diag([1.0, 1, 1, 1]))
    moved = trimesh.transformations.translation_matrix([5, 0, 0]) @ np.diag([-2.0, 2, 2, 1])
    scene.graph.update("b", matrix=moved, geometry=next(iter(scene.geometry)))
    scene.add_geometry(trimesh.PointCloud(np.eye(3)))
    path = tmp_path / "scene.glb"
    scene.export(path)
    for mesh in ls.from_trimesh(scene, merge=True), ls.read(path):
        assert (mesh.n_vertices, mesh.n_faces) == (16, 24)
        assert not mesh.nonmanifold_edge.any()
        assert not mesh.boundary_edge.any()
        triangles = mesh.points[mesh.uniform]
        volume = np.linalg.det(triangles).sum() / 6
        assert np.isclose(volume, 1 + 8)
        assert np.isclose(mesh.points.max(), 6)
        assert np.array_equal(
            mesh.face_data["object"] == "b", mesh.points[mesh.uniform][:, :, 0].min(axis=1) > 2
        )


BLENDER = Path(__file__).parents[1] / "notebooks" / "site"


def test_blender_draws_the_limit_of_what_it_exports():
    """Vertices that Blender 4.2 made of two cages, and their export to USD, as the page says."""
    pytest.importorskip("pxr")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        cage = ls.read(BLENDER / "blender.usda")
        made = ls.read(Path(__file__).parent / "blender.ply")
    assert any("cornerSharpnesses: got 4, need 1" in str(x.message) for x in caught)
    assert (cage.n_faces, made.n_faces, made.n_vertices) == (14, 240, 244)
    edges, c = cage.creases
    corner = int(np.flatnonzero((cage.points == -1).all(axis=1))[0])
    sharpness = np.where(c < 10, 10 * c**2, c)
    tags = {"corners": {corner: 10}, "boundary": "edge_only"}
    meant = ls.Mesh(cage.points, cage.faces, creases=(edges, sharpness), **tags)
    found = ls.closest_point(ls.LimitSurface(meant), made.points)
    assert np.abs(found.distance).max() < 1e-6


@pytest.mark.parametrize("suffix", [".usda", ".obj", ".glb"])
def test_exports_of_blender_keep_names(suffix):
    pytest.importorskip({".usda": "pxr", ".glb": "trimesh"}.get(suffix, "numpy"))
    with warnings.catch_warnings(action="ignore"):
        cage = ls.read(BLENDER / f"blender{suffix}")
    assert cage.is_closed
    assert cage.n_vertices == 8 + 12
    prism = ls.selected(cage, {"object": "Prism"})
    assert prism.n_vertices == 12
    top = ls.selected(prism, {"material": "Brass"})
    upward = 1 if cage.up is None or cage.up == "y" else 2
    assert np.allclose(top.points[:, upward], top.points[0, upward])


def test_trimesh_of_a_tessellation():
    split = PIECES.split()
    found = ls.to_trimesh(PIECES)
    assert np.array_equal(found.vertices, split.points)
    assert np.array_equal(found.faces, split.indices[split.triangles])
    assert np.allclose(found.vertex_normals, split.normals, atol=1e-12)
    assert np.array_equal(found.visual.uv, split.channels["uv"][0])
    cage = ls.to_trimesh(MIXED)
    assert np.array_equal(cage.vertices, MIXED.points)
    assert len(cage.faces) == (MIXED.sizes - 2).sum()
    again = ls.from_trimesh(ls.to_trimesh(ls.Mesh(*zoo.tetrahedron())))
    assert again == ls.Mesh(*zoo.tetrahedron())


def test_buffers_beside_a_gltf_file(tmp_path):
    import trimesh

    path = tmp_path / "model.gltf"
    files = trimesh.creation.icosahedron().scene().export(file_type="gltf")
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    assert len(files) > 1
    assert ls.read(path).n_vertices == 12
    with pytest.raises(ls.MeshError, match="<stdin>: trimesh cannot read it"):
        ls.read(io.BytesIO(path.read_bytes()), suffix=".gltf")
    ls.write(tmp_path / "y.gltf", CUBE)
    assert sum(name.startswith("y") for name in os.listdir(tmp_path)) == 1


def gltf_of(corners, mode, kind, indices, place):
    """The glTF file of one primitive at corners (V, 3), as the name and bytes of several files.

    `kind` is the type of indices, of which there may be none; `place` where they are: inside of a
    binary file, in the text, or in a file of their own.
    """
    numbers = np.array([] if indices is None else indices, kind).tobytes()
    points = np.array(corners, np.float32).tobytes()
    primitive = {"attributes": {"POSITION": 0}, "mode": mode}
    views = [{"buffer": 0, "byteLength": len(points)}]
    accessors = [{"bufferView": 0, "componentType": 5126, "count": len(corners), "type": "VEC3"}]
    if indices is not None:
        primitive["indices"] = 1
        views.append({"buffer": 0, "byteOffset": len(points) - 4, "byteLength": len(numbers) + 4})
        accessors.append({"bufferView": 1, "byteOffset": 4, "count": len(indices)})
        accessors[1] |= {"type": "SCALAR", "componentType": 5121 + 2 * "BHxI".index(kind)}
    content = points + numbers
    content += bytes(-len(content) % 4)
    head = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(content)}],
    }
    if place == "binary":
        text = json.dumps(head).encode()
        text += b" " * (-len(text) % 4)
        size = 28 + len(text) + len(content)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        chunks += struct.pack("<I4s", len(content), b"BIN\0") + content
        return {"a.glb": struct.pack("<4sII", b"glTF", 2, size) + chunks}
    uri = "data:x;base64," + base64.b64encode(content).decode() if place == "text" else "a.bin"
    head["buffers"][0]["uri"] = uri
    return {"a.gltf": json.dumps(head).encode(), "a.bin": content}


@pytest.mark.parametrize("place", ["binary", "text", "beside"])
@pytest.mark.parametrize(("kind", "order"), [("B", range(5)), ("H", [4, 1, 2, 2, 0]), ("I", None)])
def test_fans_of_gltf(tmp_path, place, kind, order):
    """Triangles of the first vertex and two neighbours, but those that have a vertex twice."""
    corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [-1, 0, 0]]
    for name, content in gltf_of(corners, 6, kind, order, place).items():
        (tmp_path / name).write_bytes(content)
        first = next(iter(tmp_path.glob("a.gl*")))
    mesh = ls.read(first, strict=True)
    faces = [[4, 1, 2], [4, 2, 0]] if kind == "H" else [[0, 1, 2], [0, 2, 3], [0, 3, 4]]
    assert mesh.points[mesh.uniform].tolist() == np.array(corners, float)[faces].tolist()


def test_broken_fans_of_gltf(tmp_path):
    """They are named, and cost no triangles."""
    content = gltf_of(np.eye(3), 6, "H", [0, 1, 2], "text")["a.gltf"]
    head = json.loads(content)
    primitive = head["meshes"][0]["primitives"][0]
    head["meshes"][0]["primitives"] += [primitive | {"mode": 4}, primitive | {"indices": 7}]
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(head))
    with pytest.warns(UserWarning, match=r"left out: triangle fans$"):
        assert ls.read(path).n_faces == 2


def test_without_trimesh(monkeypatch):
    original = builtins.__import__

    def missing(name, *arguments, **keywords):
        if name == "trimesh":
            raise ImportError(name)
        return original(name, *arguments, **keywords)

    monkeypatch.setattr(builtins, "__import__", missing)
    monkeypatch.delitem(sys.modules, "trimesh", raising=False)
    with pytest.raises(ImportError, match=r'pip install "limitsurf\[formats\]"'):
        ls.to_trimesh(CUBE)
    with pytest.raises(ImportError, match=r'pip install "limitsurf\[formats\]"'):
        ls.from_trimesh(None)


# --- Units and axes


@pytest.mark.parametrize(
    ("suffix", "up", "metres"),
    [(".glb", "y", 1), (".gltf", "y", 1), (".dae", "y", 1), (".3mf", "z", 1e-3)],
)
def test_units_and_axes_of_formats_that_have_their_own(tmp_path, suffix, up, metres):
    """A tetrahedron of 1, 2 and 3 cm along x, y and the height, whatever axis is up."""
    points = {"z": np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3.0]])}
    points["y"] = points["z"][:, [0, 2, 1]] * [1, 1, -1]  # what is in front is at -y, and at +z
    faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]
    expected = sorted((points[up] * 0.01 / metres).tolist())
    path = tmp_path / f"cage{suffix}"
    for own in "y", "z":
        mesh = ls.Mesh(points[own], faces, units=0.01, up=own)
        ls.write(path, mesh)
        again = ls.read(path)
        assert (again.up, again.units) == (up, metres)
        assert np.allclose(sorted(again.points.tolist()), expected, rtol=1e-6, atol=1e-12)
        assert np.linalg.det(again.points[again.faces[1]] - again.points.mean(0)) > 0
        ls.write(path, ls.tessellate(ls.LimitSurface(mesh), 1, normals=False))
        assert np.abs(ls.read(path).points).max() < 3 * 0.01 / metres
    ls.write(path, ls.Mesh(points["z"], faces))  # nothing is known: it is taken to be right
    assert sorted(np.round(ls.read(path).points, 6).tolist()) == sorted(points["z"].tolist())


@pytest.mark.parametrize("suffix", [".ply", ".off", ".stl", ".vtp"])
def test_units_and_axes_that_have_no_place(tmp_path, suffix):
    mesh = ls.Mesh(np.eye(3), [[0, 1, 2]], units=0.01, up="z")
    with pytest.warns(UserWarning, match=r"left out: units \(0.01 m\), up axis \(z\)"):
        ls.write(tmp_path / f"cage{suffix}", mesh)


@pytest.mark.parametrize(("suffix", "gap"), [(".ply", np.nan), (".glb", 0), (".vtp", np.nan)])
def test_texture_coordinates_with_gaps(tmp_path, suffix, gap):
    uv = [[1, 2], [3, 4], [5, 6], [np.nan, np.nan]], [0, 1, 2, 3, 3, 3], "corners_plus1"
    mesh = ls.Mesh(np.eye(4, 3), [[0, 1, 2], [2, 1, 3]], channels={"uv": uv})
    zeros = pytest.warns(UserWarning, match="all faces or none: 1 of 2 faces without get zeros")
    with nullcontext() if np.isnan(gap) else zeros:
        ls.write(tmp_path / f"cage{suffix}", mesh)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of faces without, and of what trimesh adds
        values, rows, _ = ls.read(tmp_path / f"cage{suffix}").channels["uv"]
    np.testing.assert_array_equal(values[rows], [[1, 2], [3, 4], [5, 6], *[[gap, gap]] * 3])


def animated(tmp_path, sampler, values, *, path="weights", sparse=False, more=()):
    """A glTF file of a square whose morph lifts its first point by 2, or whose node moves."""
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    lifted = np.zeros((4, 3), np.float32)
    lifted[0, 2] = 2
    arrays = [square, np.array([0, 1, 2, 0, 2, 3], "<u4"), lifted]
    arrays += [np.array(sampler, np.float32), np.array(values, np.float32)]
    arrays += [np.array([0], "<u4"), lifted[:1]]
    content = b"".join(x.tobytes() for x in arrays)
    starts = np.cumsum([0, *(x.nbytes for x in arrays)]).tolist()
    width = {"weights": 1, "translation": 3, "rotation": 4}[path]
    kinds = ["VEC3", "SCALAR", "VEC3", "SCALAR", {1: "SCALAR", 3: "VEC3", 4: "VEC4"}[width]]
    accessors = [
        {"bufferView": i, "componentType": 5126, "count": x.size // int(k[-1:].replace("R", "1")),
         "type": k}
        for i, (k, x) in enumerate(zip(kinds, arrays, strict=False))
    ]  # fmt: skip
    accessors[1]["componentType"] = 5125
    if sparse:
        del accessors[2]["bufferView"]
        where = {"bufferView": 5, "componentType": 5125}
        accessors[2]["sparse"] = {"count": 1, "indices": where, "values": {"bufferView": 6}}
    primitive = {"attributes": {"POSITION": 0}, "indices": 1, "targets": [{"POSITION": 2}]}
    how = more[0] if more else "LINEAR"
    channels = [{"sampler": 0, "target": {"node": 0, "path": path}}]
    move = {"channels": channels, "samplers": [{"input": 3, "output": 4, "interpolation": how}]}
    head = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive], "weights": [0.25]}],
        "animations": [move, *([{**move, "name": "run"}] if len(more) > 1 else [])],
        "accessors": accessors,
        "bufferViews": [
            {"buffer": 0, "byteOffset": a, "byteLength": b - a} for a, b in pairwise(starts)
        ],
        "buffers": [{"byteLength": len(content), "uri": "data:x;base64,"}],
    }
    head["buffers"][0]["uri"] += base64.b64encode(content).decode()
    file = tmp_path / "a.gltf"
    file.write_text(json.dumps(head))
    return file


@pytest.mark.parametrize("sparse", [False, True])
def test_morphs_are_frames(tmp_path, sparse):
    path = animated(tmp_path, [0, 2, 3], [0, 1, 0.5], sparse=sparse)
    assert ls.read(path).points[:, 2].max() == 0.5  # by the weight at rest
    found = list(ls.frames(path))
    assert [time for time, _ in found] == [0, 2, 3]
    assert [points[:, 2].tolist() for _, points in found] == [
        [0, 0, 0, 0],
        [2, 0, 0, 0],
        [1, 0, 0, 0],
    ]
    ((_, between), (_, late)) = ls.frames(path, times=[0.5, 9])
    assert (between[0, 2], late[0, 2]) == (0.5, 1)
    surface = ls.LimitSurface(ls.read(path))
    assert surface.with_points(between).mesh.points[0, 2] == 0.5


@pytest.mark.parametrize(
    ("how", "values", "expected"),
    [
        ("STEP", [[0, 0, 0], [0, 0, 4]], 0),
        ("LINEAR", [[0, 0, 0], [0, 0, 4]], 1),
        # Hermite's cubic of values 0 and 4 and slopes 2 and 0: 4 (3/16 - 2/64) + 2 * 9/64
        ("CUBICSPLINE", [[0] * 3, [0] * 3, [0, 0, 2], [0] * 3, [0, 0, 4], [0] * 3], 0.90625),
    ],
)
def test_nodes_move(tmp_path, how, values, expected):
    path = animated(tmp_path, [1, 2], values, path="translation", more=(how, "run"))
    with pytest.warns(UserWarning, match="only the first animation is read, left out: run"):
        ((_, points),) = ls.frames(path, times=[1.25])
    assert points[1, 2] == pytest.approx(expected)


def test_nodes_turn_the_short_way(tmp_path):
    """From no turn to one by 90 degrees about z, whose quaternion has the other sign."""
    half = -np.sqrt(0.5)
    path = animated(tmp_path, [0, 1], [[0, 0, 0, 1], [0, 0, half, half]], path="rotation")
    ((_, points),) = ls.frames(path, times=[1 / 3])
    np.testing.assert_allclose(points[1], [np.cos(np.pi / 6), np.sin(np.pi / 6), 0], atol=1e-6)


def test_animations_that_are_broken(tmp_path):
    path = animated(tmp_path, [0, 1], [0, 1])
    text = path.read_text()
    path.write_text(text.replace('"input": 3', '"input": 33'))
    with pytest.raises(ls.MeshError, match=r"a\.gltf: its animation is broken: IndexError"):
        list(ls.frames(path))
    path.write_text(text.replace('"animations"', '"extras"'))
    assert [time for time, _ in ls.frames(path)] == [0]
    with pytest.raises(ValueError, match="only a USD file has some"):
        list(ls.frames(path, prim="/a"))


@pytest.mark.parametrize("binary", [False, True])
def test_gltf_1(tmp_path, binary):
    """Names in place of numbers, several meshes in a node, strides of accessors."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    rows = np.hstack([points, np.full((3, 1), 9, np.float32)])
    content = rows.tobytes() + np.array([0, 1, 2, 0], "<u2").tobytes()
    uri = "data:x;base64," + base64.b64encode(content).decode()
    primitive = {"attributes": {"POSITION": "p"}, "indices": "i", "material": "red"}
    name = "binary_glTF" if binary else "body"
    head = {
        "asset": {"version": "1.0"},
        "scene": "s",
        "scenes": {"s": {"nodes": ["top"]}},
        "nodes": {
            "top": {"children": ["low"], "translation": [0, 0, 5]},
            "low": {"meshes": ["m", "m"]},
        },
        "meshes": {"m": {"primitives": [primitive]}},
        "materials": {"red": {"values": {}}},
        "accessors": {
            "i": {"bufferView": "v", "byteOffset": 48, "componentType": 5123, "count": 3,
                  "type": "SCALAR"},
            "p": {"bufferView": "v", "byteOffset": 0, "byteStride": 16, "componentType": 5126,
                  "count": 3, "type": "VEC3"},
        },
        "bufferViews": {"v": {"buffer": name, "byteOffset": 0, "byteLength": len(content)}},
        "buffers": {name: {"byteLength": len(content), "uri": "data:," if binary else uri}},
    }  # fmt: skip
    path = tmp_path / ("a.glb" if binary else "a.gltf")
    text = json.dumps(head).encode()
    if binary:
        text += b" " * (-len(text) % 4)
        size = 20 + len(text) + len(content)
        text = struct.pack("<4s4I", b"glTF", 1, size, len(text), 0) + text + content
    path.write_bytes(text)
    mesh = ls.read(path)
    assert mesh.points.tolist() == [[0, 0, 5], [1, 0, 5], [0, 1, 5]]
    assert mesh.uniform.tolist() == [[0, 1, 2], [0, 1, 2]]


DAE = """<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="0.0254" name="inch"/><up_axis>Z_UP</up_axis></asset>
<library_geometries>
<geometry id="a" name="lid"><mesh>
<source id="p"><float_array id="q" count="18">0 0 0 1 0 0 1 1 0 0 1 0 2 0 0 2 1 0</float_array>
<technique_common><accessor source="#q" count="6" stride="3">
<param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
</accessor></technique_common></source>
<source id="t"><float_array id="r" count="4">0 0 1 0</float_array>
<technique_common><accessor source="#r" count="2" stride="2">
<param name="S" type="float"/><param name="T" type="float"/>
</accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<polygons count="2"><input semantic="VERTEX" source="#v" offset="0"/>
<input semantic="TEXCOORD" source="#t" offset="1"/>
<p>0 0 1 1 2 1 3 0</p><p>1 0 4 1 5 1</p></polygons>
<polylist count="1"><input semantic="VERTEX" source="#v" offset="0"/>
<vcount>3</vcount><p>1 5 2</p></polylist>
</mesh></geometry>
</library_geometries>
<library_visual_scenes><visual_scene id="s"><node><instance_geometry url="#a"/></node>
<node><matrix>-1 0 0 0 0 1 0 0 0 0 1 7 0 0 0 1</matrix><instance_geometry url="#a"/></node>
</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_polygons_of_collada(tmp_path, encoding):
    path = tmp_path / "a.dae"
    path.write_bytes(DAE.replace("utf-8", encoding).encode(encoding))
    with pytest.warns(UserWarning, match="2 of 6 faces without texture coordinates"):
        mesh = ls.read(path)
    assert mesh.faces.tolist() == [
        [0, 1, 2, 3], [1, 4, 5], [1, 5, 2], [6, 9, 8, 7], [7, 11, 10], [7, 8, 11],
    ]  # fmt: skip
    assert mesh.points[6:8].tolist() == [[0, 0, 7], [-1, 0, 7]]
    assert (mesh.units, mesh.up) == (0.0254, "z")
    uv = uv_of_corners(mesh)
    assert uv[:4, 0].tolist() == [0, 1, 1, 0]
    assert np.isnan(uv[7:10]).all()
    commas = DAE.replace("0 0 0 1 0 0 1 1 0", "0,0 0 0 1,0 -1,#IND 0 1 1 0", 1)
    broken = "<material id='m'/>"  # which names no effect
    commas = commas.replace("</asset>", f"</asset><library_materials>{broken}</library_materials>")
    path.write_bytes(commas.replace("-1,#IND", "0,0").encode())
    with pytest.warns(UserWarning, match="left out: materials|without texture"):
        again = ls.read(path)
    np.testing.assert_array_equal(again.points, mesh.points)
    path.write_bytes(DAE.replace("instance_geometry", "instance_light").encode())
    with pytest.raises(ls.MeshError, match="need at least one polygon in its scene"):
        ls.read(path)


MSH_2 = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
2
1 3 "rim"
2 7 "top side"
$EndPhysicalNames
$Nodes
6
10 0 0 0
20 1 0 0
30 1 1 0
40 0 1 0
5 2 0 0
99 7 7 7
$EndNodes
$Elements
4
1 1 2 3 1 10 20
2 3 2 7 1 10 20 30 40
3 2 3 8 1 0 20 5 30
4 9 2 7 1 20 5 30 99 99 99
$EndElements
"""
MSH_4 = """$MeshFormat
4.1 0 8
$EndMeshFormat
$Entities
1 0 2 0
1 0 0 0 0
1 0 0 0 1 1 0 1 -7 0
2 0 0 0 1 1 0 0 1 4
$EndEntities
$Nodes
2 6 5 99
2 1 0 5
10
20
30
40
5
0 0 0
1 0 0
1 1 0
0 1 0
2 0 0
2 2 1 1
99
7 7 7 0.5 0.5
$EndNodes
$Elements
2 2 1 2
2 1 3 1
1 10 20 30 40
2 2 2 1
2 20 5 30
$EndElements
"""


def binary_msh(version):
    """What the two texts above say, as Gmsh writes it in binary; of version 2 without the line."""
    xyz = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0]], float)
    tags, head = [10, 20, 30, 40, 5], f"$MeshFormat\n{version} 1 8\n".encode()
    head += struct.pack("<i", 1) + b"\n$EndMeshFormat\n"
    if version == "2.2":
        nodes = b"".join(struct.pack("<i3d", tag, *x) for tag, x in zip(tags, xyz, strict=True))
        faces = struct.pack("<3i7i", 3, 1, 2, 2, 7, 1, 10, 20, 30, 40)
        faces += struct.pack("<3i6i", 2, 1, 2, 3, 8, 1, 20, 5, 30)
        return (
            head + b"$Nodes\n5\n" + nodes + b"\n$EndNodes\n$Elements\n2\n" + faces
            + b"\n$EndElements\n"
        )  # fmt: skip
    surface = struct.pack("<i6dQiQ", 1, *[0.0] * 6, 1, 7, 0)
    entities = struct.pack("<4Q", 0, 0, 1, 0) + surface
    nodes = struct.pack("<4Q3iQ5Q", 1, 5, 5, 40, 2, 1, 0, 5, *tags) + xyz.tobytes()
    faces = struct.pack("<4Q3iQ5Q", 2, 2, 1, 2, 2, 1, 3, 1, 1, 10, 20, 30, 40)
    faces += struct.pack("<3iQ4Q", 2, 2, 2, 1, 2, 20, 5, 30)
    parts = {b"Entities": entities, b"Nodes": nodes, b"Elements": faces}
    return head + b"".join(
        b"$" + title + b"\n" + content + b"\n$End" + title + b"\n"
        for title, content in parts.items()
    )


@pytest.mark.parametrize(
    ("data", "groups"),
    [
        (MSH_2.encode(), ["top side", "8", "top side"]),
        (MSH_4.encode(), ["7", ""]),
        (binary_msh("2.2"), ["7", "8"]),
        (binary_msh("4.1"), ["7", ""]),
    ],
    ids=["text 2", "text 4", "binary 2", "binary 4"],
)
def test_gmsh(tmp_path, data, groups):
    path = tmp_path / "a.msh"
    path.write_bytes(data)
    mesh = ls.read(path)
    assert mesh.face_data["group"].tolist() == groups
    first, second = mesh.points[mesh.faces[0]], mesh.points[mesh.faces[1]]
    assert first.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert second.tolist() == [[1, 0, 0], [2, 0, 0], [1, 1, 0]]
    assert mesh.n_vertices == 5
    for length in range(40, len(data), 23):  # truncated anywhere
        path.write_bytes(data[:length])
        with pytest.raises(ls.MeshError, match=r"a\.msh"):
            ls.read(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("2.2 0 8", "1.0 0 8", "got version 1.0 of .msh, need 2.2 or 4.1: open it in Gmsh"),
        ("20 5 30\n4", "20 6 30\n4", "a face has node 6, which is not among its nodes"),
        ("2 3 2 7", "2 77 2 7", "truncated or broken: KeyError"),
        ("$MeshFormat", "$Mesh", r"need \$MeshFormat at the start"),
        ("10 20 30 40", "10 20 30", "an element of type 3 and 2 tags has 8 numbers"),
        ("10 0 0 0", "10 0 0 x", "truncated or broken: ValueError"),
    ],
)
def test_broken_msh(tmp_path, old, new, message):
    path = tmp_path / "a.msh"
    path.write_text(MSH_2.replace(old, new))
    with pytest.raises(ls.MeshError, match=message):
        ls.read(path)


def test_what_gmsh_has_besides(tmp_path):
    path = tmp_path / "a.msh"
    path.write_text(MSH_2)
    said = r"left out: lines \(1\), nodes between corners \(1 faces"
    with pytest.warns(UserWarning, match=said):
        ls.read(path, strict=True)
    a, b = MSH_2.index("2 3 2 7 1"), MSH_2.index("$EndElements")
    path.write_text(MSH_2[:a] + "5 4 2 7 1 10 20 30 40\n" + MSH_2[b:])
    with pytest.raises(
        ls.MeshError, match=r"found none; it has lines \(1\), tetrahedra \(1\): save"
    ):
        ls.read(path)


@pytest.mark.parametrize(
    ("suffix", "how"),
    [
        (".fbx", "Blender opens it"),
        (".stp", "a CAD kernel's faces .*read_brep"),
        (".med", "meshio convert"),
    ],
)
def test_formats_that_others_convert(suffix, how):
    with pytest.raises(ValueError, match=f"unknown suffix '{suffix}'.*; .*{how}"):
        ls.read(f"a{suffix}")
