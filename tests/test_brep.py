"""Solids, their files, and back: judged by OpenCASCADE itself, exact volumes and counting."""

import warnings
from pathlib import Path

import numpy as np
import pytest
from command_line import facts, fail
from scipy.spatial import cKDTree

import limitsurf as ls
from limitsurf.cad import opencascade
from limitsurf.cad.brep import made
from limitsurf.cad.opencascade import module, parts_of

SHARED = Path(__file__).resolve().parents[2] / "shared" / "cages"
CUBE = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
QUADS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
CUBE_VOLUME = 0.32755237908737  # of the limit surface, by exact rational arithmetic
KINDS = ("Solid", "Shell", "Face", "Edge", "Vertex")


def cube(scale=1.0, shift=0.0, turned=False):
    faces = [face[::-1] for face in QUADS] if turned else QUADS
    return np.array(CUBE) * scale + shift, np.array(faces)


def together(*meshes, **tags):
    first = np.cumsum([0, *(len(points) for points, _ in meshes)])
    points = np.concatenate([points for points, _ in meshes])
    faces = np.concatenate([f + k for (_, f), k in zip(meshes, first, strict=False)])
    return ls.LimitSurface(ls.Mesh(points, faces, **tags))


def torus(m=6, n=5):
    i, j = (x.ravel() for x in np.meshgrid(range(m), range(n), indexing="ij"))
    a, b = 2 * np.pi * i / m, 2 * np.pi * j / n
    points = [(3 + np.cos(b)) * np.cos(a), (3 + np.cos(b)) * np.sin(a), np.sin(b)]
    next_i, next_j = (i + 1) % m, (j + 1) % n
    faces = [i * n + j, next_i * n + j, next_i * n + next_j, i * n + next_j]
    return ls.Mesh(np.stack(points, axis=1), np.stack(faces, axis=1))


def counted(shape):
    """How many different parts of each kind a shape has."""
    return {kind: len({hash(part) for part in parts_of(shape, kind)}) for kind in KINDS}


def is_valid(shape):
    return module("BRepCheck").BRepCheck_Analyzer(shape).IsValid()


def volume(shape):
    found = module("GProp").GProp_GProps()
    module("BRepGProp").BRepGProp.VolumeProperties_s(shape, found, 1e-9)
    return found.Mass()


def box(low, high):
    point = module("gp").gp_Pnt
    return module("BRepPrimAPI").BRepPrimAPI_MakeBox(point(*low), point(*high)).Shape()


def test_cube_is_a_solid_with_shared_edges():
    shape = ls.to_brep(ls.LimitSurface(ls.Mesh(CUBE, QUADS)))
    assert counted(shape) == {"Solid": 1, "Shell": 1, "Face": 6, "Edge": 12, "Vertex": 8}
    assert is_valid(shape)
    assert volume(shape) == pytest.approx(CUBE_VOLUME, rel=1e-7)


@pytest.mark.parametrize("turned", [False, True])
def test_outside_is_outside(turned):
    shape = ls.to_brep(together(cube(turned=turned)))
    assert volume(shape) == pytest.approx(CUBE_VOLUME, rel=1e-7)
    classifier = module("BRepClass3d").BRepClass3d_SolidClassifier(shape)
    classifier.PerformInfinitePoint(1e-7)
    assert classifier.State() == module("TopAbs").TopAbs_State.TopAbs_OUT


@pytest.mark.parametrize("turned", [False, True])
def test_voids_are_inner_shells_and_bodies_in_them_solids(turned):
    inner = [cube(scale, (1 - scale) / 2, turned) for scale in (0.5, 0.2)]
    shape = ls.to_brep(together(inner[1], cube(), inner[0], cube(shift=5.0)))
    solids = list(parts_of(shape, "Solid"))
    assert is_valid(shape)
    assert [counted(solid)["Shell"] for solid in solids] == [1, 2, 1]
    volumes = [x * CUBE_VOLUME for x in (0.2**3, 1 - 0.5**3, 1)]
    assert [volume(solid) for solid in solids] == pytest.approx(volumes, rel=1e-7)


def test_n_gons_split_the_edges_of_their_neighbours():
    """A pyramid: a square, which is one face, and four triangles, which are three each."""
    points = [[0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 0], [0.5, 0.5, 1]]
    faces = [[0, 1, 2, 3], [1, 0, 4], [2, 1, 4], [3, 2, 4], [0, 3, 4]]
    shape = ls.to_brep(ls.LimitSurface(ls.Mesh(points, faces)))
    # vertices, middles of edges and of triangles; halves of 8 edges and 3 ways in each triangle
    assert counted(shape) == {
        "Solid": 1, "Shell": 1, "Face": 13, "Edge": 8 * 2 + 4 * 3, "Vertex": 5 + 8 + 4,
    }  # fmt: skip
    assert is_valid(shape)


@pytest.mark.parametrize("scheme", ls.schemes.with_pieces)
def test_every_scheme_makes_a_solid(scheme):
    octahedron = [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
    triangles = [
        [0, 1, 4],
        [1, 2, 4],
        [2, 3, 4],
        [3, 0, 4],
        [1, 0, 5],
        [2, 1, 5],
        [3, 2, 5],
        [0, 3, 5],
    ]
    has_triangles = ls.schemes[scheme].lattice.face_size == 3
    mesh = ls.Mesh(octahedron, triangles) if has_triangles else ls.Mesh(CUBE, QUADS)
    surface = ls.LimitSurface(mesh, scheme=scheme)
    shape = ls.to_brep(surface, depth=5, solid=True)
    found = counted(shape)
    assert found["Vertex"] - found["Edge"] + found["Face"] == 2
    assert is_valid(shape)
    assert volume(shape) == pytest.approx(ls.volume(surface), rel=1e-4)


def test_faces_that_share_tangent_planes_make_a_solid(tmp_path):
    surface = together(cube())
    shape = ls.to_brep(surface, depth=8, poles="g1", solid=True)
    assert is_valid(shape)
    assert volume(shape) == pytest.approx(ls.volume(surface), rel=1e-6)
    path = tmp_path / "cube.step"
    ls.write(path, surface, depth=8, poles="g1", check=True)
    assert len(ls.read_brep(path)) == 6


def test_open_parts_are_shells_and_say_where():
    square = together(([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.array([[0, 1, 2, 3]])))
    with pytest.warns(UserWarning, match="edge of vertices 0 and 1 of the cage is open"):
        shape = ls.to_brep(square)
    assert counted(shape) == {"Solid": 0, "Shell": 1, "Face": 1, "Edge": 4, "Vertex": 4}
    with pytest.raises(ValueError, match="edge of vertices 0 and 1 of the cage is open"):
        ls.to_brep(square, solid=True)
    assert counted(ls.to_brep(together(cube()), solid=False))["Solid"] == 0


def test_closed_bodies_that_share_an_edge_are_two_solids():
    """Of the edge that four faces have, each body has one of its own."""
    points, faces = cube()
    other = points + np.array([1.0, 1.0, 0])
    places, which = np.unique(np.concatenate([points, other]), axis=0, return_inverse=True)
    mesh = ls.Mesh(places, which.ravel()[np.concatenate([faces, faces + 8])])
    assert mesh.nonmanifold_edge.sum() == 1
    shape = ls.to_brep(ls.LimitSurface(mesh), solid=True)
    assert counted(shape) == {"Solid": 2, "Shell": 2, "Face": 12, "Edge": 24, "Vertex": 16}
    assert is_valid(shape)


def test_merged_faces_have_sides_of_several_edges():
    """The same surface as one face to each limit face; no vertex is left where two edges go on."""
    coarse = together(cube())
    surface = ls.LimitSurface(ls.Mesh((fine := ls.refined(coarse.mesh, 3)).points, fine.uniform))
    merged, each = (ls.to_brep(surface, merge=merge) for merge in (True, False))
    found = counted(merged)
    assert is_valid(merged)
    assert found["Face"] < counted(each)["Face"] == 384
    assert found["Vertex"] - found["Edge"] + found["Face"] == 2
    assert volume(merged) == pytest.approx(CUBE_VOLUME, rel=1e-7)
    assert volume(each) == pytest.approx(CUBE_VOLUME, rel=1e-7)


def test_three_sheets_at_an_edge_are_three_shells():
    points = [
        [0, 0, 0],
        [0, 0, 1],
        *([x, y, z] for x, y in ((1, 0), (-1, 1), (-1, -1)) for z in (0, 1)),
    ]
    mesh = ls.Mesh(points, [[0, 2, 3, 1], [0, 4, 5, 1], [0, 6, 7, 1]])
    shape = ls.to_brep(ls.LimitSurface(mesh), solid=False)
    assert counted(shape) == {"Solid": 0, "Shell": 3, "Face": 3, "Edge": 12, "Vertex": 12}
    assert is_valid(shape)


def test_sides_that_are_points_are_degenerate_edges():
    """A pole: four quadrilaterals with two corners at one place, which are two vertices."""
    ring = [[np.cos(a), np.sin(a), 0] for a in np.arange(4) * np.pi / 2]
    points = [*ring, *([[0, 0, 1]] * 4)]
    mesh = ls.Mesh(points, [[k, (k + 1) % 4, 4 + (k + 1) % 4, 4 + k] for k in range(4)])
    surface = ls.LimitSurface(mesh, boundary="edge_only")
    known = made(surface, False, "mm", channel=None, workers=1, merge=False)
    tool = module("BRep").BRep_Tool
    edges = list(parts_of(known.shape, "Edge"))
    assert sum(tool.Degenerated_s(edge) for edge in edges) == 4
    assert counted(known.shape)["Vertex"] == 5
    assert is_valid(known.shape)
    assert is_valid(ls.to_brep(surface, solid=False))


def test_faces_without_area_are_refused_by_name():
    points = [[x, 0, 0] for x in range(4)]
    surface = ls.LimitSurface(ls.Mesh(points, [[0, 1, 2, 3]]))
    with pytest.raises(ValueError, match="limit face 0, of face 0 of the cage, has no area"):
        ls.to_brep(surface, solid=False)


def test_all_faces_without_area_are_named_for_holes():
    path = SHARED / "catmark_nonman_edges.obj"
    if not path.exists():
        pytest.skip("the public cages are not here")
    mesh = ls.read(path)
    with pytest.raises(ValueError, match=r"with_tags\(holes=\[[\d, ]+\]\)") as said:
        ls.to_brep(ls.LimitSurface(mesh), solid=False)
    holes = [int(x) for x in str(said.value).rpartition("[")[2].partition("]")[0].split(",")]
    shape = ls.to_brep(ls.LimitSurface(mesh.with_tags(holes=holes)), solid=False)
    assert counted(shape)["Face"] > 60
    assert is_valid(shape)


def test_tolerances_are_what_edges_need():
    known = made(together(cube(1e3)), None, "mm", channel=None, workers=1)
    assert known.gap < 1e-12
    assert known.tolerance <= 1e-7
    small = made(together(cube(1e-3)), None, "mm", channel=None, workers=1)
    assert small.tolerance < 1e-11
    assert is_valid(small.shape)


def test_units_scale_shapes_to_millimetres():
    shape = ls.to_brep(together(cube()), unit="cm")
    assert volume(shape) == pytest.approx(1000 * CUBE_VOLUME, rel=1e-7)
    with pytest.raises(ValueError, match="unit"):
        ls.to_brep(together(cube()), unit="parsec")


def test_booleans_sections_and_fillets_succeed():
    solid = ls.to_brep(together(cube(10.0)))
    api = module("BRepAlgoAPI")
    half = api.BRepAlgoAPI_Cut(solid, box((5, -1, -1), (11, 11, 11)))
    assert half.IsDone()
    assert is_valid(half.Shape())
    assert volume(half.Shape()) == pytest.approx(500 * CUBE_VOLUME, rel=1e-6)
    plane = module("gp").gp_Pln(module("gp").gp_Pnt(5, 5, 5), module("gp").gp_Dir(0, 0, 1))
    cut = api.BRepAlgoAPI_Section(solid, plane)
    assert cut.IsDone()
    assert counted(cut.Shape())["Edge"] >= 4
    fillet = module("BRepFilletAPI").BRepFilletAPI_MakeFillet(half.Shape())
    surface_of, plane_name = module("BRep").BRep_Tool.Surface_s, "Geom_Plane"
    flat = [f for f in parts_of(half.Shape(), "Face") if type(surface_of(f)).__name__ == plane_name]
    for edge in parts_of(flat[0], "Edge"):
        fillet.Add(0.1, edge)
    fillet.Build()
    assert fillet.IsDone()
    assert volume(fillet.Shape()) < volume(half.Shape())


@pytest.mark.parametrize("kind", ["step", "iges", "brep"])
def test_files_keep_numbers_and_faces(tmp_path, kind, capfd):
    surface = ls.LimitSurface(torus())
    path = tmp_path / f"torus.{kind}"
    ls.write(path, surface, check=True, merge=False)
    assert capfd.readouterr() == ("", "")
    faces = ls.read_brep(path)
    assert (len(faces), int(faces.solid.max()), faces.untrimmed.all()) == (30, 0, True)
    assert [*tmp_path.iterdir()] == [path]
    # the same digits: control points of a regular face are those of its patch
    patches = ls.bezier_patches(surface).points.reshape(-1, 3)
    assert np.abs(np.sort(faces.points, axis=0) - np.sort(patches, axis=0)).max() < 1e-14
    if kind == "step":
        text = path.read_text()
        assert "SI_UNIT(.MILLI.,.METRE.)" in text
        assert "30 of" in text.partition("ENDSEC")[0]
        assert faces.names[:2] == ("face 0", "face 1")


@pytest.mark.parametrize(("kind", "unit", "factor"), [("step", "m", 1000), ("igs", "in", 25.4)])
def test_units_are_stated_and_numbers_stay(tmp_path, kind, unit, factor):
    path, surface = tmp_path / f"torus.{kind}", ls.LimitSurface(torus())
    ls.write(path, surface, unit=unit)
    own = np.ptp(ls.bspline_faces(surface).points, axis=0)
    assert np.ptp(ls.read_brep(path, unit=unit).points, axis=0) == pytest.approx(own, rel=1e-14)
    assert np.ptp(ls.read_brep(path).points, axis=0) == pytest.approx(own * factor, rel=1e-14)
    with pytest.raises(ValueError, match="state no unit"):
        ls.write(tmp_path / "cube.brep", together(cube()), unit=unit)


def test_colours_of_faces(tmp_path):
    data = {"paint": np.eye(3)[np.arange(30) % 3]}
    surface = ls.LimitSurface(torus().with_tags(face_data=data))
    ls.write(tmp_path / "torus.step", surface, merge=False, colors="paint")
    assert ls.read_brep(tmp_path / "torus.step").colors == pytest.approx(data["paint"], abs=1e-6)
    with pytest.raises(ValueError, match="no face data or channel 'other', there are 'paint'"):
        ls.write(tmp_path / "other.step", surface, colors="other")
    assert not (tmp_path / "other.step").exists()


@pytest.mark.parametrize("merge", [False, True])
def test_cage_to_step_to_cage(tmp_path, merge):
    mesh = torus()
    ls.write(tmp_path / "torus.step", ls.LimitSurface(mesh), merge=merge)
    faces = ls.read_brep(tmp_path / "torus.step")
    found = faces.to_mesh()
    assert (len(faces) < 30) == merge
    assert (found.n_vertices, found.n_faces, found.is_closed) == (30, 30, True)
    near, which = cKDTree(found.points).query(mesh.points)
    assert near.max() < 1e-13
    # the same faces with the same orientation, whichever corner is first
    own = np.argsort(which)[found.uniform]
    known = {tuple(np.roll(face, k)) for face in mesh.uniform.tolist() for k in range(4)}
    assert {tuple(face) for face in own.tolist()} <= known


def test_creases_come_back(tmp_path):
    """Two flat strips that meet at an edge, which is sharp; the border has corners."""
    points = [[x, y, abs(x)] for x in (-1, 0, 1) for y in range(3)]
    faces = [
        [3 * i + j, 3 * i + j + 3, 3 * i + j + 4, 3 * i + j + 1] for i in (0, 1) for j in (0, 1)
    ]
    mesh = ls.Mesh(points, faces, creases={(3, 4): np.inf, (4, 5): np.inf})
    ls.write(tmp_path / "bent.step", ls.LimitSurface(mesh), solid=False)
    found = ls.read_brep(tmp_path / "bent.step").to_mesh()
    assert len(found.creases[0]) == 2
    assert np.abs(found.points[found.creases[0]][..., 0]).max() < 1e-14


def test_what_is_no_regular_cage_is_refused_by_name(tmp_path):
    ls.write(tmp_path / "cube.brep", together(cube()), depth=4)
    with pytest.raises(ValueError, match=r"face 0 has knots that are not uniform.* 5 more like it"):
        ls.read_brep(tmp_path / "cube.brep").to_mesh()
    ls.write(tmp_path / "box.brep", box((0, 0, 0), (1, 2, 3)))
    with pytest.raises(ValueError, match="face 0 is not of degree 3"):
        ls.read_brep(tmp_path / "box.brep").to_mesh()


def test_shapes_of_others_are_rational_splines_with_trims(tmp_path):
    """A cylinder cut by a slanted box: points on it are 2 from its axis, and it has a hole."""
    cylinder = module("BRepPrimAPI").BRepPrimAPI_MakeCylinder(2.0, 5.0).Shape()
    cut = module("BRepAlgoAPI").BRepAlgoAPI_Cut(cylinder, box((0.5, -3, 1), (1, 3, 2))).Shape()
    ls.write(tmp_path / "cut.step", cut, check=True)
    faces = ls.read_brep(tmp_path / "cut.step")
    assert not faces.untrimmed.all()
    round_ = np.flatnonzero((faces.degree == [2, 1]).all(axis=1))
    low, high = np.moveaxis(faces.domain[round_], 2, 0)
    share = np.random.default_rng(0).random((2, 200, 1, 2))[0]
    at = low + share * (high - low)
    points = faces.evaluate(round_, at[..., 0], at[..., 1])
    assert np.hypot(points[..., 0], points[..., 1]) == pytest.approx(2, abs=1e-12)
    inside = faces.covers(round_, at[..., 0], at[..., 1])
    removed = (points[..., 0] > 0.5) & (points[..., 0] < 1) & (points[..., 2] > 1)
    assert np.mean(inside != ~(removed & (points[..., 2] < 2))) < 0.01
    normals = faces.normal(round_, at[..., 0], at[..., 1])
    outwards = points * [0.5, 0.5, 0]
    assert np.abs(normals - outwards).max() < 1e-12
    # derivatives against differences of positions
    jet = faces.jet(round_, at[..., 0], at[..., 1], order=2)
    step = 1e-4 * (high - low)[:, 0]
    u = np.clip(at[..., 0], low[:, 0] + step, high[:, 0] - step)
    jet = faces.jet(round_, u, at[..., 1], order=2)
    ends = [faces.evaluate(round_, u + s, at[..., 1]) for s in (-step, step)]
    slope = (ends[1] - ends[0]) / (2 * step[:, None])
    assert np.abs(jet[1, 0] - slope).max() < 1e-6


@pytest.mark.parametrize("kind", ["step", "igs", "brep"])
def test_broken_files_are_errors(tmp_path, kind):
    path = tmp_path / f"cube.{kind}"
    ls.write(path, box((0, 0, 0), (1, 2, 3)))
    whole = path.read_bytes()
    for content in (b"", b"nothing of the kind\n" * 50, whole[: len(whole) // 3]):
        path.write_bytes(content)
        with pytest.raises(ls.MeshError, match=f"cube.{kind}"):
            ls.read_brep(path)
    with pytest.raises(FileNotFoundError):
        ls.read_brep(tmp_path / f"other.{kind}")
    with pytest.raises(ValueError, match="read_brep"):
        ls.read(path)


def test_faces_that_are_lost_are_warned_of(tmp_path):
    path = tmp_path / "box.step"
    ls.write(path, box((0, 0, 0), (1, 2, 3)))
    lines = path.read_text().split("\n")
    first = next(k for k, line in enumerate(lines) if "= PLANE(" in line)
    path.write_text("\n".join([*lines[:first], *lines[first + 1 :]]))
    with pytest.warns(UserWarning, match=r"box.step: 1 of 6 faces are left out"):
        assert len(ls.read_brep(path)) == 5


def test_faces_that_are_lost_from_iges_are_warned_of(tmp_path):
    path = tmp_path / "box.igs"
    ls.write(path, ls.LimitSurface(ls.Mesh(CUBE, QUADS)))
    lines = path.read_text().split("\n")
    first = next(k for k, line in enumerate(lines) if line[72:73] == "P" and line[:4] == "128,")
    lines[first] = "128,0,0,3,3".ljust(64) + lines[first][64:]
    path.write_text("\n".join(lines))
    with pytest.warns(UserWarning, match=r"box.igs: 1 of 6 faces are left out"):
        assert len(ls.read_brep(path)) == 5


@pytest.mark.parametrize("kind", ["step", "igs", "brep"])
@pytest.mark.parametrize("name", ["new\nline", 'it\'s "so"; ENDSEC', "\u2603", "\udcff"])
def test_names_of_files_are_any(tmp_path, kind, name):
    path = tmp_path / f"{name}.{kind}"
    ls.write(path, box((0, 0, 0), (1, 2, 3)), check=True)
    assert len(ls.read_brep(path)) == 6


def _nan_channel():
    values = np.where(np.arange(24).reshape(8, 3) == 4, np.nan, CUBE)
    channels = {"other": (values, np.array(QUADS).ravel(), "none")}
    return ls.LimitSurface(ls.Mesh(CUBE, QUADS, channels=channels))


@pytest.mark.parametrize(
    ("surface", "how", "error", "says"),
    [
        (
            _nan_channel,
            {"channel": "other"},
            ValueError,
            "face 0 of the cage has a corner at .*nan",
        ),
        (lambda: together(cube(1e200)), {}, ValueError, "within 1e.99 mm"),
        (lambda: together(cube(), holes=range(6)), {}, ValueError, "needs a face"),
        (lambda: together(cube()), {"solid": "yes"}, TypeError, "solid must be True or False"),
        (lambda: together(cube()), {"merge": "no"}, TypeError, "merge must be True or False"),
        (lambda: together(cube()), {"check": 1}, TypeError, "check must be True or False"),
        (lambda: together(cube()), {"tolerance": "x"}, TypeError, "tolerance must be a number"),
        (lambda: together(cube()), {"colors": np.full((6, 3), np.nan)}, ValueError, "of face 0"),
        (lambda: together(cube()), {"unit": "inch"}, ValueError, "unit: got 'inch'"),
    ],
)
def test_what_is_refused_leaves_the_old_file(tmp_path, surface, how, error, says):
    path = tmp_path / "cube.step"
    path.write_bytes(b"precious")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(error, match=says):
            ls.write(path, surface(), **how)
    assert path.read_bytes() == b"precious"
    assert [*tmp_path.iterdir()] == [path]


def test_parts_below_what_readers_tell_apart(tmp_path):
    small = together(cube(1e-9))
    with pytest.warns(UserWarning, match="8.8e-10 mm large"):
        ls.write(tmp_path / "small.step", small, depth=3)
    ls.write(tmp_path / "metres.step", together(cube(1e-6)), depth=3, unit="m", check=True)


def test_options_of_solids_are_of_their_files_alone(tmp_path):
    with pytest.raises(TypeError, match="depth, unit: of files of CAD systems alone"):
        ls.write(tmp_path / "cube.obj", ls.Mesh(CUBE, QUADS), unit="m", depth=3)
    with pytest.raises(TypeError, match="depth: said of surfaces"):
        ls.write(tmp_path / "box.step", box((0, 0, 0), (1, 1, 1)), depth=3)
    with pytest.raises(TypeError, match="LimitSurface"):
        ls.write(tmp_path / "cube.step", ls.Mesh(CUBE, QUADS))
    assert not [*tmp_path.iterdir()]


def test_compare_finds_distances_both_ways():
    surface = ls.LimitSurface(torus())
    assert ls.compare(surface, ls.to_brep(surface), n=3).largest < 1e-12
    raised = surface.with_points(surface.points + np.array([0, 0, 0.01]))
    found = ls.compare(surface, ls.to_brep(raised), n=6)
    assert found.largest == pytest.approx(0.01, rel=0.02)
    # a ball within a larger one, in a cube of six flat sides
    flat = together(cube(2.0, -1.0), scheme="bilinear")
    ball = module("BRepPrimAPI").BRepPrimAPI_MakeSphere(1.0).Shape()
    found = ls.compare(flat, ball, n=9)
    there = found.faces.evaluate(found.shape_face, found.shape_u, found.shape_v)
    assert found.from_shape == pytest.approx(1 - np.abs(there).max(axis=1), abs=1e-12)
    corners = np.abs(flat.evaluate(found.face, found.u, found.v))
    assert found.from_surface == pytest.approx(np.linalg.norm(corners, axis=1) - 1, abs=1e-9)


def test_compare_finds_feet_on_faces_of_any_length():
    """Long merged faces beside small ones with many knots: the nearest known places are theirs."""
    mesh = ls.refined(ls.Mesh(*cube(2.0, -1.0)), 1)
    points = mesh.points * [25.0, 10.0, 8.0]
    points[:, 2] += 0.005 * points[:, 0] ** 2
    surface = ls.LimitSurface(ls.refined(mesh.with_points(points), 1))
    faces = ls.bspline_faces(surface, tolerance=0.05)
    assert faces.grid.prod(axis=1).max() > 3
    found = ls.compare(surface, ls.to_brep(faces), n=4)
    assert found.from_surface.max() <= faces.deviation.max()
    places = found.faces.evaluate(found.shape_face, found.shape_u, found.shape_v)
    limit = surface.evaluate(found.face, found.u, found.v)
    assert (found.from_surface <= cKDTree(places).query(limit)[0]).all()


def test_without_opencascade_the_extra_is_named(monkeypatch):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(opencascade, "import_module", missing)
    with pytest.raises(ImportError, match=r"limitsurf\[cad\]"):
        ls.to_brep(together(cube()))


def test_warnings_are_none_where_all_is_well(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ls.write(tmp_path / "torus.step", ls.LimitSurface(torus()))


@pytest.mark.parametrize("name", ["catmark_cube_creases1", "gismo_bitorus", "catmark_fan"])
def test_public_cages(name):
    path = SHARED / f"{name}.obj"
    if not path.exists():
        pytest.skip("the public cages are not here")
    surface = ls.LimitSurface(ls.read(path))
    is_closed = name != "catmark_fan"
    known = made(surface, is_closed, "mm", channel=None, workers=1)
    size = np.ptp(surface.points, axis=0).max()
    assert is_valid(known.shape)
    assert known.gap < 1e-14 * size
    assert bool(known.why_open) != is_closed
    if is_closed:
        assert volume(known.shape) == pytest.approx(ls.volume(surface), rel=1e-7)


def test_command_line_makes_a_part(tmp_path):
    cage, part = tmp_path / "cube.obj", tmp_path / "part.step"
    ls.write(cage, ls.Mesh(CUBE, QUADS))
    said = facts("convert", cage, part, "--unit", "cm")
    assert (said["output"], said["faces"], said["exact"]) == (str(part), 6, 0)
    assert 0 < said["deviation"] < 1e-5
    assert "CENTI" in part.read_text()
    assert len(ls.read_brep(part)) == 6
    text = fail("convert", cage, tmp_path / "cube.ply", "--tolerance", "1e-3")
    assert text.startswith("--tolerance is of files of CAD systems alone")
