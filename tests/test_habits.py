"""What people try first: maps from the cage to the surface, meshes where surfaces are, welding."""

import numpy as np
import pytest
import zoo
import zoo_triangles

import limitsurf as ls

BOX = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
PLACES = [[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)]


def box_apart():
    """A box of which each face has four vertices of its own."""
    corners = np.array(PLACES)[np.ravel(BOX)]
    return corners, np.arange(24).reshape(6, 4)


CAGES = {
    "cube": ls.Mesh(PLACES, BOX),
    "mixed": ls.Mesh(
        [[0, 0], [1, 0], [1, 1], [0, 1], [2, 0], [2, 1]], [[0, 1, 2, 3], [1, 4, 5, 2]]
    ),
    "prism": ls.Mesh(*zoo.ZOO["prism_7"]()),
    "triangles": ls.Mesh(*zoo_triangles.ZOO["octahedron"](), scheme="loop"),
}


@pytest.mark.parametrize("name", CAGES)
def test_vertices_and_edges_are_found_on_the_surface(name):
    """Control points put where the faces meet: limits are those of the refined mesh."""
    mesh = CAGES[name]
    surface = ls.LimitSurface(mesh)
    fine = ls.refined(mesh, 1)
    at = surface.evaluate(*surface.limit_faces.at_vertex(np.arange(mesh.n_vertices)))
    np.testing.assert_allclose(at, fine.limit_points[: mesh.n_vertices], atol=1e-14)
    middle = surface.evaluate(*surface.limit_faces.at_edge(mesh.edges))
    n_faces = mesh.n_faces if fine.sizes.max() == 4 else 0
    rest = fine.limit_points[mesh.n_vertices :]
    # edge points are the last where there are points of faces, else all
    both = [rest[: mesh.n_edges], rest[n_faces : n_faces + mesh.n_edges]]
    assert min(np.abs(middle - points).max() for points in both) < 1e-14
    for t in (0.0, 0.25, 0.75, 1.0):
        one = surface.evaluate(*surface.limit_faces.at_edge(mesh.edges, t))
        other = surface.evaluate(*surface.limit_faces.at_edge(mesh.edges[:, ::-1], 1 - t))
        np.testing.assert_allclose(one, other, atol=1e-14)
    ends = surface.evaluate(*surface.limit_faces.at_edge(mesh.edges, 0))
    np.testing.assert_allclose(ends, at[mesh.edges[:, 0]], atol=1e-14)
    corner = np.arange(mesh.n_corners) - mesh.offsets[mesh.corner_face]
    found = surface.evaluate(*surface.limit_faces.at_corner(mesh.corner_face, corner))
    np.testing.assert_allclose(found, at[mesh.indices], atol=1e-14)


def test_holes_are_passed_over():
    mesh = ls.Mesh(PLACES, BOX, holes=[0, 2])
    surface = ls.LimitSurface(mesh)
    assert surface.limit_faces.at_vertex(0)[0] == 4
    face, _u, _v = surface.limit_faces.at_edge(mesh.edges)
    assert (~np.isin(face, [0, 2]))[~np.isin(mesh.edges, [0, 1]).all(axis=1)].all()
    assert np.isnan(surface.evaluate(*surface.limit_faces.at_edge([0, 1]))).all()


def test_maps_say_what_is_wrong():
    faces = ls.LimitSurface(ls.Mesh([*PLACES, [5, 5, 5]], BOX)).limit_faces
    for call, error, text in (
        (lambda: faces.at_vertex(9), IndexError, "vertex 9 is out of range, need 0 to 8"),
        (lambda: faces.at_vertex([0, 8]), ValueError, "vertex 8 is of no face"),
        (lambda: faces.at_vertex(0.5), TypeError, "vertex must be integers"),
        (lambda: faces.at_corner(1, 4), IndexError, "face 1 has corners 0 to 3, got 4"),
        (lambda: faces.at_corner(-1, 0), IndexError, "face -1 is out of range"),
        (lambda: faces.at_edge([0, 7]), ValueError, "no edge between vertices 0 and 7"),
        (lambda: faces.at_edge([0, 1, 2]), ValueError, r"shape \(3,\), need two vertices"),
        (lambda: faces.at_edge([0, 1], 1.5), ValueError, r"t must be in \[0, 1\]"),
    ):
        with pytest.raises(error, match=text):
            call()


def test_boundaries_are_chains():
    square = ls.Mesh(np.zeros((9, 3)), [[0, 1, 4, 3], [1, 2, 5, 4], [3, 4, 7, 6], [4, 5, 8, 7]])
    assert [chain.tolist() for chain in square.boundary_chains] == [[0, 1, 2, 5, 8, 7, 6, 3, 0]]
    assert ls.Mesh(PLACES, BOX).boundary_chains == ()
    # a tube has two; two squares at one vertex have one each; walls on an edge of three faces
    tube = ls.Mesh(PLACES, BOX[2:]).boundary_chains
    assert sorted(sorted(chain[:-1].tolist()) for chain in tube) == [[0, 1, 2, 3], [4, 5, 6, 7]]
    assert all(chain[0] == chain[-1] for chain in tube)
    bow = ls.Mesh(np.zeros((7, 3)), [[0, 1, 2, 3], [2, 4, 5, 6]]).boundary_chains
    assert [chain.tolist() for chain in bow] == [[0, 1, 2, 3, 0], [2, 4, 5, 6, 2]]
    book = ls.Mesh(np.zeros((5, 3)), [[0, 1, 2], [0, 1, 3], [0, 1, 4]]).boundary_chains
    assert sorted(chain.tolist() for chain in book) == [[1, 2, 0], [1, 3, 0], [1, 4, 0]]
    # four walls of a tetrahedron, and once more: every edge has four faces
    walls = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]]
    assert ls.Mesh(np.eye(4), [*walls, *walls]).boundary_chains == ()


@pytest.mark.parametrize("name", ["grid_3x3", "carved_cube_1"])
def test_chains_have_all_boundary_edges_once(name):
    mesh = ls.Mesh(*zoo.ZOO[name]()[:2])
    found = [np.sort(np.stack([c[:-1], c[1:]], axis=1), axis=1) for c in mesh.boundary_chains]
    edges = np.concatenate([*found, np.zeros((0, 2), np.int64)])
    expected = mesh.edges[mesh.boundary_edge]
    assert sorted(edges.tolist()) == sorted(expected.tolist())


def test_meshes_know_whether_they_are_closed_and_manifold():
    assert ls.Mesh(PLACES, BOX).is_closed
    assert ls.Mesh(PLACES, BOX).is_manifold
    assert not ls.Mesh(PLACES, BOX[1:]).is_closed
    assert ls.Mesh(PLACES, BOX[1:]).is_manifold
    assert not ls.Mesh(np.zeros((7, 3)), [[0, 1, 2, 3], [2, 4, 5, 6]]).is_manifold


def test_a_face_beyond_64_bits_is_out_of_range():
    surface = ls.LimitSurface(CAGES["cube"])
    for call in (surface.evaluate, surface.jet, surface.normal, surface.weights, surface.curvature):
        with pytest.raises(IndexError, match=f"{10**30} is out of range"):
            call(10**30, 0.1, 0.2)
        with pytest.raises(IndexError, match=f"{-(10**30)} at index 1 is out of range"):
            call([0, -(10**30)], 0.1, 0.2)
    with pytest.raises(TypeError, match="faces must be integers"):
        surface.evaluate([None], 0.1, 0.2)


@pytest.mark.parametrize("workers", [0, -2, True, 1.5])
def test_workers_are_a_number_or_all(workers):
    with pytest.raises(ValueError, match="positive integer, or -1 for all"):
        ls.LimitSurface(CAGES["cube"]).evaluate([0], 0.1, 0.2, workers=workers)


@pytest.mark.parametrize("workers", ["a", None, [1], 0])
def test_every_query_says_what_workers_are(workers):
    surface, at, way = ls.LimitSurface(CAGES["cube"]), [[0.1, 0.2, 0.3]], [[0.0, 0, 1]]
    calls = [
        lambda: ls.closest_point(surface, at, workers=workers),
        lambda: ls.feet(surface, at, within=1, workers=workers),
        lambda: ls.intersect(surface, at, way, workers=workers),
        lambda: ls.intersect_all(surface, at, way, workers=workers),
        lambda: ls.occluded(surface, at, way, workers=workers),
        lambda: ls.contains(surface, at, workers=workers),
        lambda: ls.bounds(surface, workers=workers),
        lambda: ls.sample(surface, 4, workers=workers),
        lambda: ls.section(surface, at[0], way[0], workers=workers),
        lambda: ls.tessellate(surface, 2, workers=workers),
        lambda: ls.tessellate(surface, chord=0.1, workers=workers),
        lambda: ls.levels_of_detail(surface, [0.1], workers=workers),
        lambda: ls.approximate(surface, "acc", workers=workers),
        lambda: ls.SurfaceIndex(surface, workers=workers),
    ]
    for call in calls:
        with pytest.raises(ValueError, match="positive integer, or -1 for all"):
            call()


def test_the_module_lists_public_names_alone():
    assert dir(ls) == sorted([*ls.__all__, "__version__"])


def test_messages_are_about_what_was_given():
    with pytest.raises(TypeError, match=r"scheme: got 5, need the name of one"):
        ls.eigenbasis(5)
    surface = ls.LimitSurface(CAGES["cube"])
    tessellation = ls.tessellate(surface, 2)
    with pytest.raises(TypeError, match=r"need a LimitSurface or a Mesh, got Tessellation; draw"):
        ls.plot(tessellation)
    with pytest.raises(TypeError, match=r"its cage is surface.mesh, polygons on it are"):
        ls.write("never.obj", surface)
    with pytest.raises(ValueError, match="n is for a LimitSurface, got Mesh"):
        ls.to_pyvista(CAGES["cube"], n=3)
    with pytest.raises(TypeError, match=r"got str; limitsurf\.read\('a\.obj'\) is one"):
        ls.LimitSurface("a.obj")


def test_tables_say_what_they_are_of():
    basis = ls.eigenbasis("catmull-clark", valence=5)
    for table in (basis, basis.exact, basis.float64, basis.in_digits(20)):
        assert len(repr(table)) < 200
        assert "18 control points" in repr(table)
    assert "a crease of 3 faces" in repr(ls.eigenbasis("loop", kind="crease", faces=3).exact)


def test_surfaces_become_polygons_of_other_libraries():
    surface = ls.LimitSurface(CAGES["cube"])
    assert ls.to_pyvista(surface, n=3).n_cells == 6 * 9
    assert ls.to_pyvista(surface).n_cells == 6 * 64
    assert len(ls.to_trimesh(surface, n=2).faces) == 6 * 4 * 2


def test_a_mesh_is_drawn_as_its_surface():
    size = (160, 120)
    mesh, surface = CAGES["cube"], ls.LimitSurface(CAGES["cube"])
    one = ls.plot(mesh, off_screen=True, window_size=size).image
    assert (one == ls.plot(surface, off_screen=True, window_size=size).image).all()


def test_tables_of_pandas_are_meshes():
    pandas = pytest.importorskip("pandas")
    points = pandas.DataFrame(PLACES, columns=["x", "y", "z"])
    faces = pandas.DataFrame(BOX, columns=list("abcd"))
    assert ls.Mesh(points, faces) == ls.Mesh(PLACES, BOX)


# ---------------------------------------------------------------- welding


def test_equal_vertices_are_joined():
    points, faces = box_apart()
    found = ls.merged(ls.Mesh(points, faces))
    assert (found.n_vertices, found.n_edges, found.is_closed) == (8, 12, True)
    assert ls.merged(found) is found
    assert (found.points[found.indices] == points).all()


def test_close_vertices_are_joined_in_chains_and_the_first_stays():
    points = np.array(
        [[0, 0], [1, 0], [1, 1], [0, 1], [1 + 1e-7, 0], [2, 0], [2, 1], [1, 1 - 1e-7]]
    )
    apart = ls.Mesh(points, [[0, 1, 2, 3], [4, 5, 6, 7]])
    assert ls.merged(apart, 1e-8) is apart
    found = ls.merged(apart, 1e-6)
    assert found.faces.tolist() == [[0, 1, 2, 3], [1, 4, 5, 2]]
    assert (found.points == points[[0, 1, 2, 3, 5, 6]]).all()
    chain = ls.Mesh([[0.0], [1], [2], [3], [4]], [[0, 1, 2], [2, 3, 4]])
    with pytest.raises(ls.MeshError, match="within 1 no face has 3 corners left"):
        ls.merged(chain, 1)


def test_tags_holes_and_channels_survive():
    points, faces = box_apart()
    uv = np.random.default_rng(0).random((24, 2))
    mesh = ls.Mesh(
        points,
        faces,
        creases={(0, 1): 2.0, (4, 5): 1.0, (8, 11): 3.0},
        corners={0: 1.0, 8: 4.0},
        holes=[3],
        channels={"uv": (uv, np.arange(24), "corners_plus1")},
        boundary="edge_only",
        units=0.01,
    )
    found = ls.merged(mesh)
    edges, sharp = found.creases
    ends = {
        tuple(sorted(map(tuple, found.points[e].tolist()))): s
        for e, s in zip(edges, sharp, strict=False)
    }
    expected = {}
    for (a, b), s in {(0, 1): 2.0, (4, 5): 1.0, (8, 11): 3.0}.items():
        key = tuple(sorted(map(tuple, points[[a, b]].tolist())))
        expected[key] = max(s, expected.get(key, 0))
    assert ends == expected
    assert found.corners[0].tolist() == [0]
    assert found.corners[1].tolist() == [4.0]
    assert found.holes.tolist() == [3]
    assert found.units == 0.01
    assert found.boundary == "edge_only"
    values, rows, how = found.channels["uv"]
    assert (values[rows] == uv).all()
    assert how == "corners_plus1"


def test_faces_that_collapse_are_told_of():
    points = [[0, 0], [1, 0], [1, 1], [0, 1], [1, 1 + 1e-9], [1 + 1e-9, 1]]
    mesh = ls.Mesh(points, [[0, 1, 2, 4, 3], [2, 4, 5]], holes=[1])
    with pytest.warns(UserWarning, match=r"corner|less than 3") as said:
        found = ls.merged(mesh, 1e-6)
    assert found.faces.tolist() == [[0, 1, 2, 3]]
    assert not len(found.holes)
    assert len(said) == 2


@pytest.mark.parametrize("merge", [-1, float("nan"), float("inf"), "yes"])
def test_what_is_no_distance_is_refused(merge):
    with pytest.raises(ValueError, match=r"merge: got .* need True or a distance"):
        ls.read("cage.obj", merge=merge)


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".off"])
def test_files_are_read_apart_with_a_warning_or_joined(tmp_path, suffix):
    path = tmp_path / f"box{suffix}"
    ls.write(path, ls.Mesh(*box_apart()))
    with pytest.warns(UserWarning, match="24 of 24 boundary edges lie on another one"):
        assert ls.read(path).n_vertices == 24
    assert ls.read(path, merge=True).n_vertices == ls.read(path, merge=1e-9).n_vertices == 8
    assert ls.read(path, merge=False).n_vertices == 24  # and no warning


def test_a_dataset_is_the_same_as_its_file(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    apart = ls.Mesh(
        *box_apart(),
        channels={
            "uv": (np.tile([[0, 0], [1, 0], [1, 1], [0, 1.0]], (6, 1)), np.arange(24), "all")
        },
    )
    shape = ls.to_pyvista(ls.tessellate(ls.LimitSurface(apart), 2, channels=["uv"]))
    path = tmp_path / "box.vtp"
    shape.save(path)
    one, other = ls.from_pyvista(shape), ls.read(path)
    assert one == other
    assert set(one.channels) == {"uv"}
    box = pyvista.Cube()
    assert ls.from_pyvista(box, merge=True).n_vertices == 8
    assert ls.from_pyvista(box, merge=False).n_vertices == box.n_points


def test_coincident_vertices_of_a_closed_cage_are_no_news(tmp_path, recwarn):
    mesh = ls.Mesh(PLACES, BOX)
    twice = ls.Mesh(np.concatenate([PLACES, PLACES]), [*BOX, *(np.array(BOX) + 8).tolist()])
    for name, cage in {"one": mesh, "two": twice}.items():
        ls.write(tmp_path / f"{name}.obj", cage)
        ls.read(tmp_path / f"{name}.obj")
    assert not len(recwarn)


# ---------------------------------------------------------------- data of faces


def painted():
    names = np.array(["lid", "lid", "side", "side", "", "side"])
    data = {"group": names, "material": np.array(["a b"] * 6), "number": np.arange(6)}
    return ls.Mesh(PLACES, BOX, face_data=data)


def test_data_of_faces_are_carried_along():
    mesh = painted()
    assert mesh.face_data["number"].tolist() == list(range(6))
    assert not mesh.face_data["number"].flags.writeable
    assert "face data 'group'" in repr(mesh)
    assert mesh != ls.Mesh(PLACES, BOX)
    moved = mesh.with_points(mesh.points * 2)
    assert moved.face_data["group"].tolist() == mesh.face_data["group"].tolist()
    fine = ls.refined(mesh, 2)
    assert fine.face_data["number"].tolist() == np.repeat(np.arange(6), 16).tolist()
    shown = ls.tessellate(ls.LimitSurface(mesh), 3)
    assert shown.face_data["group"].tolist() == np.repeat(mesh.face_data["group"], 9).tolist()


def test_data_of_faces_of_all_sizes_go_with_their_children():
    mixed = ls.Mesh(
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0]],
        [[0, 1, 2, 3], [1, 4, 2]],
        face_data={"n": [[4, 4], [3, 3]]},
    )
    fine = ls.refined(mixed, 1)
    assert fine.face_data["n"][:, 0].tolist() == [4] * 4 + [3] * 3
    assert ls.refined(mixed, 2).face_data["n"][:, 0].tolist() == [4] * 16 + [3] * 12
    shown = ls.tessellate(ls.LimitSurface(mixed), 2)
    centre = np.array([shown.points[face].mean(axis=0) for face in shown.faces])
    inside = ls.tessellate(ls.LimitSurface(mixed), 2).face_data["n"][:, 0] == 4
    assert (centre[inside, 0] < 1.01).all()
    triangles = ls.Mesh(*zoo_triangles.ZOO["octahedron"](), scheme="loop")
    triangles = ls.Mesh(
        triangles.points, triangles.uniform, scheme="loop", face_data={"n": np.arange(8)}
    )
    assert ls.refined(triangles, 2).face_data["n"].tolist() == np.repeat(np.arange(8), 16).tolist()


@pytest.mark.parametrize(
    ("data", "error", "text"),
    [
        ({"n": [1, 2]}, ls.MeshError, r"face_data 'n': got shape \(2,\), need \(6,\), a number"),
        ({"n": [["a", "b"]] * 6}, ls.MeshError, r"got shape \(6, 2\)"),
        ({"n": np.zeros((6, 0))}, ls.MeshError, r"got shape \(6, 0\)"),
        ({"n": [[1], [1, 2]] * 3}, ls.MeshError, "face_data 'n': values do not form an array"),
        ({"n": [None] * 6}, TypeError, "need numbers or texts"),
        ({"n": [b"a"] * 6}, TypeError, "need numbers or texts"),
        ({3: [1] * 6}, TypeError, "face_data: names must be texts, got 3"),
        ([1] * 6, TypeError, "face_data: need a mapping, got list"),
    ],
)
def test_data_that_are_not_of_faces_are_refused(data, error, text):
    with pytest.raises(error, match=text):
        ls.Mesh(PLACES, BOX, face_data=data)


def test_names_of_faces_come_back_from_obj(tmp_path):
    path, mesh = tmp_path / "box.obj", painted()
    with pytest.warns(UserWarning, match=r"left out: data of faces 'number'$"):
        ls.write(path, mesh)
    again = ls.read(path)
    assert set(again.face_data) == {"group", "material"}
    for name, values in again.face_data.items():
        assert values.tolist() == mesh.face_data[name].tolist()
    path.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\no it\ng a  b\nf 1 2 3\ng\nf 3 2 1")
    found = ls.read(path).face_data
    assert found["object"].tolist() == ["", "it", "it"]
    assert found["group"].tolist() == ["", "a b", ""]
    path.write_bytes("v 0 0 0\nv 1 0 0\nv 1 1 0\ng Stra\u00dfe\nf 1 2 3\n".encode("latin-1"))
    assert ls.read(path).face_data["group"].tolist() == ["Stra\u00dfe"]
    wrong = ls.Mesh(PLACES, BOX, face_data={"group": ["a\nf 1 2 3"] * 6})
    with pytest.raises(ValueError, match=r"group .* of face 0: an OBJ file holds names"):
        ls.write(path, wrong)
    assert ls.read(path).n_faces == 1


@pytest.mark.parametrize("suffix", [".vtp", ".vtu", ".vtk"])
def test_data_of_faces_come_back_from_vtk(tmp_path, suffix):
    path, mesh = tmp_path / f"box{suffix}", painted()
    ls.write(path, mesh)
    again = ls.read(path)
    assert {n: x.tolist() for n, x in again.face_data.items()} == {
        name: values.tolist() for name, values in mesh.face_data.items()
    }


def test_data_of_cells_come_from_pyvista():
    pyvista = pytest.importorskip("pyvista")
    data = ls.to_pyvista(painted())
    assert ls.from_pyvista(data).face_data["group"].tolist()[:3] == ["lid", "lid", "side"]
    strips = pyvista.PolyData(
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [5, 0, 0], [5, 1, 0.0]]),
        faces=[3, 1, 4, 5],
        strips=[4, 0, 1, 2, 3],
        lines=[2, 0, 1],
    )
    strips.cell_data["n"] = [10, 20, 30]  # of the line, the triangle and the strip
    assert ls.from_pyvista(strips).face_data["n"].tolist() == [20, 30, 30]


def test_faces_that_are_left_out_take_their_data_along():
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 0], [0, 1, 0]]
    mesh = ls.Mesh(points, [[1, 2, 3], [0, 1, 2], [0, 3, 4]], face_data={"n": [7, 8, 9]})
    with pytest.warns(UserWarning, match="less than 3 corners"):
        assert ls.merged(mesh).face_data["n"].tolist() == [8, 9]


# ---------------------------------------------------------------- creases


@pytest.mark.parametrize("scale", [1e-200, 1.0, 1e150])
def test_creases_by_angle(scale):
    """A roof of 60 degrees on a box, at any size: counted by hand."""
    high = 0.5 * 3**0.5
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0, high], [0.5, 1, high]]
    faces = [[3, 2, 1, 0], [0, 1, 4], [2, 3, 5], [1, 2, 5, 4], [3, 0, 4, 5]]
    roof = ls.Mesh(np.array(points) * scale, faces)
    assert len(ls.creases_by_angle(roof, 89)[0]) == 9
    assert len(ls.creases_by_angle(roof, 91)[0]) == 3  # all but the edges of the gables
    assert not len(ls.creases_by_angle(roof, 121)[0])
    flat = roof.with_points(roof.points * [1, 1, 0])
    assert ls.creases_by_angle(flat, 170, sharpness=2)[1].tolist() == [2.0, 2.0]


def test_flat_grids_and_boundaries_have_no_creases():
    grid = ls.Mesh([[x, y] for y in range(3) for x in range(3)], [[0, 1, 4, 3], [1, 2, 5, 4]])
    assert ls.creases_by_angle(grid, 0)[0].tolist() == []
    with pytest.raises(ValueError, match=r"degrees must be in \[0, 180\]"):
        ls.creases_by_angle(grid, float("nan"))


def test_other_tags_leave_the_rest():
    mesh = painted().with_tags(creases={(0, 1): 2.0}, scheme="catmull-clark")
    assert mesh.face_data["number"].tolist() == list(range(6))
    assert mesh.connectivity is mesh.with_tags(corners={1: 1}).connectivity
    assert mesh.with_tags(creases=None) == painted().with_tags(scheme="catmull-clark")
    with pytest.raises(TypeError, match="got 'crease', need one of creases"):
        mesh.with_tags(crease={(0, 1): 2.0})
    with pytest.raises(ls.MeshError, match="no such edge"):
        mesh.with_tags(creases={(0, 7): 2.0})


def test_data_of_faces_go_with_dual_schemes():
    mesh = painted().with_tags(scheme="doo-sabin")
    assert ls.refined(mesh, 0).face_data["number"].tolist() == list(range(6))
    fine = ls.refined(mesh, 1)
    found = fine.face_data["number"]
    assert found[:6].tolist() == list(range(6))
    # each other face takes after a face that has its first vertex
    first = fine.indices[fine.offsets[:-1]]
    assert (found == mesh.corner_face[first]).all()


def test_texts_of_pandas_are_texts():
    given = np.array(list("aabbcc"), dtype=object)
    assert ls.Mesh(PLACES, BOX, face_data={"n": given}).face_data["n"].dtype.kind == "U"


def test_usd_keeps_data_of_faces(tmp_path):
    pytest.importorskip("pxr")
    ls.write(tmp_path / "box.usda", painted())
    found = ls.read(tmp_path / "box.usda").face_data
    assert found.keys() == painted().face_data.keys()
    for name, values in painted().face_data.items():
        assert (found[name] == values).all()


def test_names_that_take_the_memory_are_left_out(tmp_path):
    path = tmp_path / "long.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\ng " + "x" * 5000 + "\n" + "f 1 2 3\n" * 20000)
    with pytest.warns(UserWarning, match=r"line 4: got the group .* of 5000 letters"):
        assert not ls.read(path).face_data


def test_crowds_are_refused_at_once():
    rng = np.random.default_rng(0)
    crowd = ls.Mesh(rng.random((300_000, 3)) * 1e-3, [[0, 1, 2]])
    with pytest.raises(MemoryError, match="choose a smaller tolerance"):
        ls.merged(crowd, 1.0)
    assert ls.merged(ls.Mesh(*box_apart()), True).n_vertices == 8


def test_channels_without_a_rule_are_left_out_of_files(tmp_path):
    mesh = ls.Mesh(
        PLACES, BOX, scheme="doo-sabin",
        channels={"uv": (np.zeros((1, 2)), np.zeros(24, int), "corners_plus1")},
    )  # fmt: skip
    with pytest.warns(UserWarning, match="left out: scheme 'doo-sabin' has no rule for channel"):
        assert ls.to_trimesh(ls.LimitSurface(mesh), n=1).vertices.shape[1] == 3


def test_given_data_and_holes_go_with_the_faces_of_a_dataset():
    pyvista = pytest.importorskip("pyvista")
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    data = pyvista.PolyData(points, [3, 0, 0, 1, 3, 0, 1, 2, 3, 0, 2, 3])
    with pytest.warns(UserWarning, match="less than 3 corners"):
        mesh = ls.from_pyvista(data, face_data={"n": [7, 8, 9]}, holes=[1])
    assert mesh.face_data["n"].tolist() == [8, 9]
    assert mesh.holes.tolist() == [0]
    with pytest.raises(ls.MeshError, match=r"face_data .n."):
        ls.from_pyvista(data, face_data={"n": [7]})
    assert ls.from_pyvista(data.extract_cells([1, 2]), face_data=None).n_faces == 2
