"""The cage: its connectivity against naive loops, all ways to give it and to get it wrong."""

import copy
import itertools
import math
import pickle
from fractions import Fraction

import mpmath
import numpy as np
import pytest
import sympy
import zoo
from hypothesis import given
from hypothesis import strategies as st

import limitsurf as ls
from limitsurf.mesh import Mesh, MeshError

TRIANGLE = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
INTERPOLATIONS = ["none", "corners_only", "corners_plus1", "corners_plus2", "boundaries", "all"]
CONNECTIVITY = [
    "offsets",
    "corner_face",
    "next_corner",
    "previous_corner",
    "edges",
    "corner_edge",
    "edge_corners",
    "boundary_edge",
    "nonmanifold_edge",
    "edge_faces",
    "separate",
    "twin",
    "boundary_vertex",
    "nonmanifold_vertex",
    "vertex_faces",
    "ring_offsets",
    "ring_position",
    "ring_corners",
]


def square(**tags):
    """Two triangles and a quad: vertices 0 to 4, faces 0 to 2."""
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0]]
    return Mesh(points, [[0, 1, 2], [0, 2, 3], [1, 4, 5, 2]], **tags)


# --- Connectivity


def naive_edges(faces):
    """The half-edges of each edge, {(a, b, k): [h]}; k > 0 on those that have one of their own.

    That is where a face has run along the same pair before, or from a vertex to itself.
    """
    edges, h = {}, 0
    for face in faces:
        before = set()
        for a, b in zoo.half_edges([face]):
            pair = min(a, b), max(a, b)
            own = a == b or pair in before
            before.add(pair)
            edges.setdefault((*pair, (h + 1) * own), []).append(h)
            h += 1
    return dict(sorted(edges.items()))


def assert_connectivity(mesh, faces):
    """Every array of the mesh is what loops over the faces give."""
    corners = [(f, k) for f, face in enumerate(faces) for k in range(len(face))]
    number = {corner: h for h, corner in enumerate(corners)}
    n = len(corners)
    assert (mesh.n_faces, mesh.n_corners) == (len(faces), n)
    assert mesh.sizes.tolist() == [len(face) for face in faces]
    assert mesh.indices.tolist() == [v for face in faces for v in face]
    assert mesh.faces.tolist() == faces
    assert mesh.offsets.tolist() == [number[f, 0] for f in range(len(faces))] + [n]
    assert mesh.corner_face.tolist() == [f for f, _ in corners]
    following = [number[f, (k + 1) % len(faces[f])] for f, k in corners]
    preceding = [number[f, (k - 1) % len(faces[f])] for f, k in corners]
    assert mesh.next_corner.tolist() == following
    assert mesh.previous_corner.tolist() == preceding

    half_edges, edges = zoo.half_edges(faces), naive_edges(faces)
    assert mesh.n_edges == len(edges)
    assert mesh.edges.tolist() == [[a, b] for a, b, _ in edges]
    edge_of = {h: e for e, users in enumerate(edges.values()) for h in users}
    assert mesh.corner_edge.tolist() == [edge_of[h] for h in range(n)]
    again = {(a, b) for a, b, k in edges if k}
    assert mesh.separate.tolist() == [list(edges)[edge_of[h]][2] > 0 for h in range(n)]
    manifold = [
        len(users) == 2 and half_edges[users[0]] == half_edges[users[1]][::-1] and pair not in again
        for (*pair, _), users in edges.items()
        for pair in [tuple(pair)]
    ]
    twin = [-1] * n
    for one, other in (users for users, good in zip(edges.values(), manifold, strict=True) if good):
        twin[one], twin[other] = other, one
    assert mesh.twin.tolist() == twin
    assert mesh.edge_corners.tolist() == [
        users if good else [users[0], -1]
        for users, good in zip(edges.values(), manifold, strict=True)
    ]
    assert mesh.edge_faces.tolist() == [len(users) for users in edges.values()]
    alone = [len(users) == 1 for users in edges.values()]
    assert mesh.boundary_edge.tolist() == alone
    nonmanifold = [
        not (good or one) or (a, b) in again
        for (a, b, _), good, one in zip(edges, manifold, alone, strict=True)
    ]
    assert mesh.nonmanifold_edge.tolist() == nonmanifold
    pairs = [(a, b) for a, b, _ in edges]
    assert mesh.edge_numbers(mesh.edges).tolist() == [pairs.index(pair) for pair in pairs]

    boundary, odd = (
        {v for edge, yes in zip(edges, which, strict=True) if yes for v in edge[:2]}
        for which in (alone, nonmanifold)
    )
    assert mesh.boundary_vertex.tolist() == [v in boundary for v in range(mesh.n_vertices)]
    fans = []
    for v in range(mesh.n_vertices):
        own = [h for h in range(n) if half_edges[h][0] == v]
        assert mesh.vertex_faces[v] == len(own)
        around = []
        while rest := sorted(set(own) - set(itertools.chain(*around))):
            first = rest[0]
            while twin[first] >= 0 and following[twin[first]] != rest[0]:
                first = following[twin[first]]
            closed = twin[first] >= 0
            around.append([rest[0] if closed else first])
            while (h := twin[preceding[around[-1][-1]]]) not in (-1, around[-1][0]):
                around[-1].append(h)
            assert (h == -1) == (not closed)
        around.sort()
        fans += [(v, fan) for fan in around]
        ring = mesh.ring_corners[mesh.ring_offsets[v] : mesh.ring_offsets[v + 1]].tolist()
        assert ring == [h for fan in around for h in fan]
        assert sorted(ring) == own
        assert mesh.ring_position[ring].tolist() == list(range(len(ring)))
        assert mesh.nonmanifold_vertex[v] == (v in odd or len(around) > 1)
    assert mesh.ring_offsets[-1] == n
    assert mesh.fans.vertex.tolist() == [v for v, _ in fans]
    assert mesh.fans.sizes.tolist() == [len(fan) for _, fan in fans]
    assert mesh.fans.closed.tolist() == [twin[fan[0]] >= 0 for _, fan in fans]
    assert mesh.fans.corners.tolist() == [h for _, fan in fans for h in fan]
    assert mesh.fans.offsets.tolist() == [0, *itertools.accumulate(len(fan) for _, fan in fans)]
    for k, (_, fan) in enumerate(fans):
        assert mesh.fans.fan[fan].tolist() == [k] * len(fan)
        assert mesh.fans.position[fan].tolist() == list(range(len(fan)))


@pytest.mark.parametrize("name", zoo.ZOO)
def test_connectivity_of_the_zoo(name):
    points, faces = zoo.ZOO[name]()
    mesh = Mesh(points, faces)
    assert_connectivity(mesh, faces)
    assert not mesh.nonmanifold_vertex.any()


@pytest.mark.parametrize("name", zoo.NONMANIFOLD)
def test_nonmanifold_cages(name):
    """They are cages like others; what is odd about them is told by edge and vertex."""
    points, faces, edges, vertices = zoo.NONMANIFOLD[name]
    mesh = Mesh(points, faces)
    assert_connectivity(mesh, faces)
    assert list(map(tuple, mesh.edges[mesh.nonmanifold_edge].tolist())) == edges
    assert np.flatnonzero(mesh.nonmanifold_vertex).tolist() == vertices
    assert not zoo.is_manifold(faces)


@given(zoo.cages(operations=[*zoo.OPERATIONS, zoo.insert_vertex]))
def test_connectivity_of_random_cages(cage):
    points, faces = cage
    mesh = Mesh(points, faces)
    assert_connectivity(mesh, faces)
    assert np.array_equal(mesh.points, points)
    assert zoo.is_manifold(faces)


@given(zoo.cages(max_steps=3), st.data())
def test_random_changes_of_faces(cage, data):
    """Whatever comes out, non-manifold or of repeated vertices, is told as it is."""
    points, faces = cage
    for _ in range(data.draw(st.integers(1, 3))):
        face = data.draw(st.integers(0, len(faces) - 1))
        corner = data.draw(st.integers(0, len(faces[face]) - 1))
        faces[face][corner] = data.draw(st.integers(0, len(points) - 1))
    mesh = Mesh(points, faces)
    assert_connectivity(mesh, faces)
    assert mesh.nonmanifold_vertex.any() == (not zoo.is_manifold(faces))


@given(st.lists(st.lists(st.integers(0, 5), min_size=3, max_size=6), min_size=1, max_size=6))
def test_connectivity_of_any_faces(faces):
    assert_connectivity(Mesh(np.zeros((6, 3)), faces), faces)


def test_a_pole_of_thousands():
    n = 5000
    faces = [[0, 1 + i, 1 + (i + 1) % n] for i in range(n)]
    mesh = Mesh(np.zeros((n + 1, 3)), faces)
    assert mesh.vertex_faces[0] == n
    assert mesh.corner_face[mesh.ring_corners[:n]].tolist() == [*range(n)]
    assert not mesh.nonmanifold_vertex.any()
    torn = Mesh(np.zeros((n + 1, 3)), [*faces[1:2000], *faces[2001:]])
    assert np.flatnonzero(torn.nonmanifold_vertex).tolist() == [0]
    assert torn.fans.sizes[torn.fans.vertex == 0].tolist() == [1999, 2999]
    assert not torn.fans.closed.any()
    assert torn.corner_face[torn.ring_corners[: n - 2]].tolist() == [*range(n - 2)]


def test_regular_torus_of_many_faces():
    n = 100
    vertex = np.arange(n * n).reshape(n, n)
    around = [vertex, np.roll(vertex, -1, 0), np.roll(vertex, (-1, -1), (0, 1))]
    faces = np.stack([*around, np.roll(vertex, -1, 1)], axis=-1).reshape(-1, 4)
    mesh = Mesh(np.zeros((n * n, 3)), faces)
    assert (mesh.vertex_faces == 4).all()
    assert mesh.n_edges == 2 * n * n
    ring = mesh.ring_corners.reshape(-1, 4)
    assert (mesh.twin[mesh.previous_corner[ring]] == np.roll(ring, -1, axis=1)).all()


# --- Ways to give points and faces


def test_faces_array_and_list_of_faces():
    points, faces = zoo.cube()
    mesh = Mesh(points, np.array(faces, dtype=np.int32))
    assert mesh.faces.tolist() == mesh.uniform.tolist() == faces
    assert mesh.points[mesh.faces].shape == mesh.points[mesh.uniform].shape == (6, 4, 3)
    points, faces = zoo.prism(5)
    mesh = Mesh(points, faces)
    assert mesh.uniform is None
    assert [len(face) for face in mesh.faces] == [5, 5, 4, 4, 4, 4, 4]
    assert [face.tolist() for face in mesh.faces] == mesh.faces.tolist() == faces


@pytest.mark.parametrize("name", ["cube", "prism_7"])
def test_faces_are_one_sequence_whatever_their_sizes(name):
    points, faces = zoo.ZOO[name]()
    mesh = Mesh(points, faces)
    found = mesh.faces
    assert type(found) is ls.Faces
    assert len(found) == len(faces)
    for k in (0, -1, np.int32(3)):
        assert found[k].tolist() == faces[k]
    for key in (slice(1, 4), slice(None, None, -2), slice(5, 2)):
        assert found[key].tolist() == faces[key]
    assert found[[2, 0, 2]].tolist() == [faces[2], faces[0], faces[2]]
    assert found[mesh.sizes == 4].tolist() == [face for face in faces if len(face) == 4]
    assert list(map(list, found[[]])) == found[[]].tolist() == []
    assert (found + 10).tolist() == [[v + 10 for v in face] for face in faces]
    assert found == Mesh(points, faces).faces != found[::-1]
    both = np.concatenate([mesh.points, mesh.points + 5])
    joined = Mesh(both, [*found, *(found + mesh.n_vertices)])
    assert joined.faces[len(faces) :] == found + mesh.n_vertices
    for wrong in (len(faces), [0, len(faces)], np.array([[0]])):
        with pytest.raises(IndexError):
            found[wrong]


def test_faces_of_different_sizes_are_no_array():
    mesh = Mesh(*zoo.prism(5))
    with pytest.raises(ValueError, match=r"Faces\(\{4: 5, 5: 2\}\), .* use sizes and ind"):
        mesh.points[mesh.faces]
    assert np.array(mesh.faces[2:]).shape == (5, 4)


@pytest.mark.parametrize("name", ["cube", "prism_7"])
def test_all_ways_to_give_faces_are_the_same(name):
    points, faces = zoo.ZOO[name]()
    expected = Mesh(points, faces)
    sizes, indices = [len(face) for face in faces], [v for face in faces for v in face]
    ways = [
        tuple(map(tuple, faces)),
        [np.array(face, dtype=np.uint8) for face in faces],
        (sizes, indices),
        (np.array(sizes, dtype=np.int32), np.array(indices, dtype=np.uint64)),
        iter(faces),
        expected.faces,
        (expected.sizes, expected.indices),
        np.array([np.array(face) for face in faces] + [None], dtype=object)[:-1],
    ]
    for way in ways:
        assert Mesh(points, way) == expected
    if name == "cube":
        assert Mesh(points, np.array(faces)) == expected


def test_two_faces_are_not_a_pair():
    points = [[0, 0], [1, 0], [1, 1], [0, 1]]
    faces = [[0, 1, 2], [0, 2, 3]]
    assert Mesh(points, faces).faces.tolist() == faces
    assert Mesh(points, ((0, 1, 2), (0, 2, 3))).faces.tolist() == faces
    assert Mesh(points, ([3, 3], [0, 1, 2, 0, 2, 3])).faces.tolist() == faces


@pytest.mark.parametrize("dtype", [int, np.int8, np.uint64, np.float16, np.float32, float])
def test_numeric_points_become_float64(dtype):
    mesh = Mesh(np.array(TRIANGLE, dtype=dtype), [[0, 1, 2]])
    assert mesh.points.dtype == np.float64
    assert mesh.points.tolist() == TRIANGLE


@pytest.mark.parametrize("shape", [(3,), (3, 1), (3, 2), (3, 4), (3, 2, 5), (3, 0)])
def test_points_of_any_shape(shape):
    points = np.arange(math.prod(shape)).reshape(shape) / 8
    mesh = Mesh(points, [[0, 1, 2]])
    assert mesh.points.shape == shape
    assert np.array_equal(mesh.points, points)


@pytest.mark.parametrize(
    "number", [Fraction(1, 3), mpmath.mpf("0.1"), sympy.sqrt(2), 2**70, mpmath.iv.mpf([1, 2])]
)
def test_exact_points_are_kept(number):
    points = [[0, 0], [number, 0], [0, number]]
    mesh = Mesh(np.array(points, dtype=object), [[0, 1, 2]])
    assert mesh.points.dtype == object
    assert mesh.points[1, 0] is number
    assert mesh.with_points(np.array(points, dtype=object)).points[2, 1] is number


def test_lists_of_fractions_need_no_dtype():
    mesh = Mesh([[0, 0], [Fraction(1, 3), 0], [0, 1]], [[0, 1, 2]])
    assert mesh.points.tolist() == [[0, 0], [Fraction(1, 3), 0], [0, 1]]
    assert isinstance(mesh.points[1, 0], Fraction)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([[0, 0], [1j, 0], [0, 1]], "real numbers, got an array of complex128"),
        ([["a", "b"], ["c", "d"], ["e", "f"]], "real numbers, got an array of <U1"),
        ([[True, False], [False, False], [True, True]], "real numbers, got an array of bool"),
        ([[0, 0], [None, 0], [0, 1]], "real numbers, got None"),
        (np.array([[0, 0], [0, 1j], [0, 1]], dtype=object), "real numbers, got 1j"),
        (np.array([[0, 0], [0, "x"], [0, 1]], dtype=object), "real numbers, got 'x'"),
        (np.array([[0, 0], [0, True], [0, 1]], dtype=object), "real numbers, got True"),
    ],
)
def test_points_that_are_no_numbers(points, message):
    with pytest.raises(TypeError, match=message):
        Mesh(points, [[0, 1, 2]])


def test_points_of_no_shape():
    with pytest.raises(MeshError, match=r"^coordinates do not form an array: "):
        Mesh([[0, 0], [1], [2, 3]], [[0, 1, 2]])
    with pytest.raises(
        MeshError, match=r"^need at least one vertex, got coordinates of shape \(\)"
    ):
        Mesh(3.0, [[0, 1, 2]])


def test_floats_among_exact_points_are_checked():
    points = np.array([[Fraction(1, 3), 0.5], [1, np.float64("inf")], [0, 0]], dtype=object)
    for one in points, points[:, 1]:
        with pytest.raises(MeshError, match=r"^vertex 1: coordinate inf is not finite$"):
            Mesh(one, [[0, 1, 2]])


@pytest.mark.parametrize(
    ("faces", "error", "message"),
    [
        (np.array([[0.0, 1.0, 2.0]]), TypeError, "must be integers, got float64 such as 0.0"),
        ([[0, 1, 2.5]], TypeError, "must be integers, got float64"),
        ([[False, True, True]], TypeError, "must be integers, got bool"),
        ([["0", "1", "2"]], TypeError, "must be integers, got <U1"),
        ([[0, 1, None]], TypeError, "must be integers, got object"),
        ([[0, 1, 10**30]], MeshError, "faces: got 10+, which is beyond any"),
        ([[0, 1, -(10**30)]], MeshError, "faces: got -10+, which is beyond any"),
        (([3], np.array([0, 1, 2**64 - 1], np.uint64)), MeshError, "got 18446744073709551615,"),
        (([3, 2**64], [0, 1, 2]), MeshError, "face sizes: got 18446744073709551616, which"),
        # sums that wrap around to the number of indices
        (([2**62] * 4 + [3], [0, 1, 2]), MeshError, "face 0 has 4611686018427387904 corners, of 3"),
        ((np.full(2**3, 2**61), []), MeshError, "face 0 has 2305843009213693952 corners, of 0"),
        (([4, -1, 0], [0, 1, 2]), MeshError, "face 1 has -1 corners.*; 1 more"),
        ([0, 1, 2], TypeError, "list of index sequences or a pair"),
        (7, TypeError, "list of index sequences or a pair"),
        (None, TypeError, "list of index sequences or a pair"),
        (np.array([0, 1, 2]), MeshError, r"got an array of shape \(3,\), need \(n_faces, k\)"),
        ([[[0, 1, 2]]], MeshError, "got sequences nested deeper"),
        ([[0, 1, [2]]], MeshError, "do not form an array"),
        (([3], [0, 1]), MeshError, "face 0 has 3 corners, of 2 indices"),
        (([3], [0, 1, 2, 0]), MeshError, r"sum\(sizes\) = 3, len\(indices\) = 4; need two 1-d"),
        (([[3]], [0, 1, 2]), MeshError, r"got shapes \(1, 1\) and \(3,\)"),
        (([3.0], [0, 1, 2]), TypeError, "face sizes must be integers, got float64"),
        (([4, -1], [0, 1, 2]), MeshError, "face 1 has -1 corners, need at least 3"),
        (([], []), MeshError, "at least one face"),
    ],
)
def test_faces_that_are_none(faces, error, message):
    with pytest.raises(error, match=message):
        Mesh(TRIANGLE, faces)


@pytest.mark.parametrize(
    ("tags", "error", "message"),
    [
        ({"creases": {(0, 2**64): 1}}, MeshError, "vertices of creases: got 18446744073709551616"),
        ({"creases": {(2**62, 2**62 + 1): 1}}, MeshError, "the mesh has no such edge"),
        ({"creases": ([[0, 1]], 5)}, MeshError, r"got sharpness of shape \(\), need \(1,\)"),
        ({"corners": {2**63: 1}}, MeshError, "vertices of corners: got 9223372036854775808"),
        ({"corners": ([0], 2.0)}, MeshError, r"got sharpness of shape \(\)"),
        ({"holes": [2**64]}, MeshError, "holes: got 18446744073709551616"),
        ({"holes": np.array([2**64 - 1], np.uint64)}, MeshError, "holes: got 18446744073709551615"),
        ({"channels": [1]}, TypeError, "channels: need a mapping, got list"),
        ({"channels": {"a": ([1.0], [0, 0, 2**64], "all")}}, MeshError, "'a': face_indices: got 1"),
    ],
)
def test_numbers_that_are_not_believed(tags, error, message):
    with pytest.raises(error, match=message):
        Mesh(TRIANGLE, [[0, 1, 2]], **tags)


@pytest.mark.parametrize("name", zoo.BAD)
def test_bad_cages_are_named(name):
    points, faces, message = zoo.BAD[name]
    with pytest.raises(MeshError) as caught:
        Mesh(points, faces)
    assert message in str(caught.value)
    assert isinstance(caught.value, ValueError)


def test_culprits():
    for name, face in (("two_corners", 1), ("one_corner", 0), ("out_of_range", 1)):
        with pytest.raises(MeshError) as caught:
            Mesh(zoo.SIX, zoo.BAD[name][1])
        assert caught.value.culprits == (("face", face),)
    with pytest.raises(MeshError) as caught:
        square(creases={(5, 0): 1})
    assert caught.value.culprits == (("crease", (5, 0)),)
    with pytest.raises(MeshError) as caught:
        square(corners=([3], [-1.0]))
    assert pickle.loads(pickle.dumps(caught.value)).culprits == (("corner", 3),)


# --- Tags


def test_tags_are_put_in_order():
    mesh = square(
        creases={(5, 2): 1, (2, 0): 0.5, (1, 0): math.inf},
        corners={4: 2, 1: 10},
        holes=[2, 0],
        scheme="catmull-clark",
        boundary="edge_only",
        creasing="chaikin",
        triangles="smooth",
    )
    assert mesh.creases[0].tolist() == [[0, 1], [0, 2], [2, 5]]
    assert mesh.creases[1].tolist() == [math.inf, 0.5, 1]
    assert mesh.corners[0].tolist() == [1, 4]
    assert mesh.corners[1].tolist() == [10, 2]
    assert mesh.creases[1].dtype == mesh.corners[1].dtype == np.float64
    assert mesh.holes.tolist() == [0, 2]
    assert mesh.scheme == "catmull-clark"
    assert (mesh.boundary, mesh.creasing, mesh.triangles) == ("edge_only", "chaikin", "smooth")
    pairs = square(
        creases=(np.array([[0, 1], [2, 5], [0, 2]]), [math.inf, 1, 0.5]),
        corners=([1, 4], np.array([10, 2], dtype=np.float32)),
        holes=np.array([0, 2], dtype=np.uint8),
        scheme="catmull-clark",
        boundary="edge_only",
        creasing="chaikin",
        triangles="smooth",
    )
    assert pairs == mesh


@pytest.mark.parametrize("empty", [None, {}, ([], []), (np.zeros((0, 2), dtype=int), np.zeros(0))])
def test_no_tags(empty):
    mesh = square(creases=empty, corners=None if isinstance(empty, tuple) else empty, holes=[])
    assert mesh == square()
    edges, sharpness = mesh.creases
    assert (edges.shape, sharpness.shape) == ((0, 2), (0,))
    vertices, sharpness = mesh.corners
    assert (vertices.shape, sharpness.shape, mesh.holes.shape) == ((0,), (0,), (0,))
    assert edges.dtype == vertices.dtype == mesh.holes.dtype == np.int64
    assert (mesh.scheme, mesh.boundary, mesh.creasing, mesh.triangles) == (None,) * 4
    assert dict(mesh.channels) == {}


def test_exact_sharpness_is_kept():
    mesh = square(creases={(0, 1): Fraction(1, 3)}, corners={0: Fraction(7, 2), 1: 2})
    assert mesh.creases[1].tolist() == [Fraction(1, 3)]
    assert mesh.corners[1].dtype == object
    assert mesh.corners[1].tolist() == [Fraction(7, 2), 2]


def test_scheme_is_kept_as_it_is():
    scheme = object()
    assert square(scheme=scheme).scheme is scheme


@pytest.mark.parametrize(
    ("tags", "error", "message"),
    [
        ({"creases": {(0, 4): 1, (3, 1): 2}}, MeshError, r"^crease \(0, 4\): .* no such edge; 1 m"),
        ({"creases": {(0, 6): 1}}, MeshError, r"^crease \(0, 6\): the mesh has no such edge$"),
        ({"creases": {(5, 5): 1}}, MeshError, r"^crease \(5, 5\): the mesh has no such edge$"),
        ({"creases": {(-1, 0): 1}}, MeshError, r"^crease \(-1, 0\): the mesh has no such edge$"),
        ({"creases": {(0, 1): 1, (1, 0): 1}}, MeshError, r"^crease \(1, 0\) is given more than o"),
        ({"creases": {(0, 1): -0.5}}, MeshError, r"^crease \(0, 1\): sharpness -0.5 is not in \["),
        ({"creases": {(0, 1): math.nan}}, MeshError, r"^crease \(0, 1\): sharpness nan is not in"),
        ({"creases": {(0, 1): Fraction(-1, 2)}}, MeshError, "sharpness -1/2 is not in"),
        ({"creases": {(0, 1): "1"}}, TypeError, "creases: sharpness must be real numbers, got <U1"),
        ({"creases": {(0, 1): True}}, TypeError, "creases: sharpness must be real numbers, got b"),
        ({"creases": {0: 1}}, MeshError, r"creases: got edges of shape \(1,\), need \(c, 2\)"),
        ({"creases": {(0, 1, 2): 1}}, MeshError, r"edges of shape \(1, 3\), need \(c, 2\)"),
        ({"creases": {(0, 1): 1, (0, 1, 2): 1}}, MeshError, "vertices of creases do not form"),
        ({"creases": {(0.0, 1.0): 1}}, TypeError, "vertices of creases must be integers, got flo"),
        ({"creases": ([[0, 1]], [1, 2])}, MeshError, r"sharpness of shape \(2,\), need \(1,\)"),
        ({"creases": ([], [1])}, MeshError, r"creases: got sharpness of shape \(1,\), need \(0,\)"),
        ({"creases": [[0, 1, 1]]}, TypeError, "creases: need a mapping or a pair of arrays, got l"),
        ({"corners": {6: 1, 7: 2}}, MeshError, "^corner 6 is out of range, need 0 to 5; 1 more"),
        ({"corners": {-1: 1}}, MeshError, "^corner -1 is out of range, need 0 to 5$"),
        ({"corners": ([1, 1], [1, 1])}, MeshError, "^corner 1 is given more than once$"),
        ({"corners": {1: -1}}, MeshError, r"^corner 1: sharpness -1.0 is not in \[0, inf\]$"),
        ({"corners": {1: math.nan}}, MeshError, "^corner 1: sharpness nan is not in"),
        ({"corners": {1.0: 2}}, TypeError, "vertices of corners must be integers, got float64"),
        ({"corners": {(1,): 2}}, MeshError, r"corners: got indices of shape \(1, 1\), need \(n,\)"),
        ({"corners": 3}, TypeError, "corners: need a mapping or a pair of arrays, got int"),
        ({"holes": [3]}, MeshError, "^hole 3 is out of range, need 0 to 2$"),
        ({"holes": [-1]}, MeshError, "^hole -1 is out of range, need 0 to 2$"),
        ({"holes": [1, 1]}, MeshError, "^hole 1 is given more than once$"),
        ({"holes": [True]}, TypeError, "holes must be integers, got bool"),
        ({"holes": 1}, MeshError, r"holes: got indices of shape \(\), need \(n,\)"),
        ({"boundary": "edges"}, ValueError, "boundary: got 'edges', need one of None, 'none', 'ed"),
        ({"creasing": "normal"}, ValueError, "creasing: got 'normal', need one of None, 'uniform"),
        ({"triangles": "loop"}, ValueError, "triangles: got 'loop', need one of None, 'catmull-c"),
    ],
)
def test_bad_tags(tags, error, message):
    with pytest.raises(error, match=message):
        square(**tags)


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_channels(interpolation):
    rows = [0, 1, 2, 0, 2, 3, 1, 4, 4, 2]
    values = np.arange(10.0).reshape(5, 2)
    mesh = square(channels={"uv": (values, rows, interpolation), "w": (range(5), rows, "all")})
    assert list(mesh.channels) == ["uv", "w"]
    got = mesh.channels["uv"]
    assert np.array_equal(got[0], values)
    assert (got[1].tolist(), got[2]) == (rows, interpolation)
    assert mesh.channels["w"][0].dtype == np.float64
    with pytest.raises(TypeError):
        mesh.channels["uv"] = got


@pytest.mark.parametrize(
    ("channel", "error", "message"),
    [
        (([[0, 0]], [0] * 9, "all"), MeshError, r"face_indices of shape \(9,\), need \(10,\)"),
        (([[0, 0]], [0] * 9 + [1], "all"), MeshError, "face 2 has index 1, need 0 to 0$"),
        (([[0, 0]], [0, -1] * 5, "all"), MeshError, "face 0 has index -1, need 0 to 0; 4 more"),
        (([[0, 0]], [0.5] * 10, "all"), TypeError, "face_indices must be integers, got float64"),
        (([[0, math.inf]], [0] * 10, "all"), MeshError, "row 0: coordinate inf is not finite"),
        (([], [0] * 10, "all"), MeshError, "^channel 'uv': need at least one row, got"),
        (([[0, 0]], [0] * 10, "some"), ValueError, "'uv': interpolation: got 'some', need one of"),
        (([[0, 0]], [0] * 10, None), ValueError, "'uv': interpolation: got None, need one of"),
        (([[0, 0]], [0] * 10), TypeError, r"'uv': need \(values, face_indices, interpolation\)"),
    ],
)
def test_bad_channels(channel, error, message):
    with pytest.raises(error, match=message):
        square(channels={"uv": channel})


# --- Behaviour as a value


def tagged():
    return square(
        creases={(0, 1): 2},
        corners={3: Fraction(1, 2)},
        holes=[1],
        boundary="none",
        channels={"uv": ([[0, 0], [1, 1]], [0, 1] * 5, "all")},
    )


def arrays(mesh):
    named = [mesh.points, mesh.sizes, mesh.indices, *mesh.creases, *mesh.corners, mesh.holes]
    channels = [array for channel in mesh.channels.values() for array in channel[:2]]
    return [*named, *channels, *mesh.faces, *(getattr(mesh, name) for name in CONNECTIVITY)]


def test_everything_is_read_only():
    mesh = tagged()
    for one in (
        mesh,
        pickle.loads(pickle.dumps(mesh)),
        copy.deepcopy(mesh),
        mesh.with_points(mesh.points),
    ):
        assert not any(array.flags.writeable for array in arrays(one))
    with pytest.raises(ValueError, match="read-only"):
        mesh.points[0] = 1


def test_input_is_copied_and_left_alone():
    points, faces = zoo.cube()
    faces = np.array(faces)
    values, rows = np.zeros((1, 2)), np.zeros(24, dtype=np.int64)
    mesh = Mesh(points, faces, channels={"uv": (values, rows, "all")})
    before = mesh.points.copy(), mesh.indices.copy()
    for array in points, faces, values, rows:
        array[:] = 0
    assert np.array_equal(mesh.points, before[0])
    assert np.array_equal(mesh.indices, before[1])


def test_indices_are_int64():
    mesh = Mesh(zoo.cube()[0], np.array(zoo.cube()[1], dtype=np.uint8))
    integers = [mesh.sizes, mesh.indices, *(getattr(mesh, name) for name in CONNECTIVITY)]
    assert {array.dtype for array in integers} == {np.dtype(np.int64), np.dtype(bool)}


def test_with_points_shares_everything_else():
    mesh = tagged()
    other = mesh.with_points(np.arange(6.0))
    assert other.points.tolist() == [0, 1, 2, 3, 4, 5]
    assert mesh.points.shape == (6, 3)
    assert other.ring_corners is mesh.ring_corners
    assert other.creases is mesh.creases
    assert other != mesh
    assert other.with_points(mesh.points) == mesh
    late = Mesh._from_valid(mesh.points, mesh.sizes, mesh.indices)
    assert late.with_points(mesh.points).twin is late.twin


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((5, 3)), "^got 5 points, need 6, one for each vertex$"),
        (np.full((6, 3), np.nan), "^vertex 0: coordinate nan is not finite; 5 more like it$"),
    ],
)
def test_with_bad_points(points, message):
    with pytest.raises(MeshError, match=message):
        square().with_points(points)


def test_equality():
    assert square() == square()
    assert square() != "square"
    changes = [
        {"creases": {(0, 1): 1}},
        {"corners": {0: 1}},
        {"holes": [0]},
        {"scheme": "loop"},
        {"boundary": "none"},
        {"creasing": "uniform"},
        {"triangles": "smooth"},
        {"channels": {"uv": ([[0, 0]], [0] * 10, "all")}},
        {"channels": {"uv": ([[0, 1]], [0] * 10, "all")}},
        {"channels": {"uv": ([[0, 0]], [0] * 10, "none")}},
        {"channels": {"st": ([[0, 0]], [0] * 10, "all")}},
    ]
    meshes = [square(), *(square(**change) for change in changes)]
    for i, one in enumerate(meshes):
        assert [one == other for other in meshes] == [i == j for j in range(len(meshes))]
    exact = square().with_points(
        np.array([[Fraction(x) for x in p] for p in square().points.tolist()])
    )
    assert exact == square()
    with pytest.raises(TypeError, match="unhashable"):
        hash(square())


def test_pickle_and_copy():
    mesh = tagged()
    for other in pickle.loads(pickle.dumps(mesh)), copy.copy(mesh), copy.deepcopy(mesh):
        assert other == mesh
        assert np.array_equal(other.ring_corners, mesh.ring_corners)
        assert other.with_points(mesh.points) == mesh


def test_from_valid_in_a_subclass():
    class Refined(Mesh):
        parent: np.ndarray

    points, faces = zoo.prism(5)
    mesh = Mesh(points, faces)
    other = Refined._from_valid(
        points, mesh.sizes, mesh.indices, creases={(0, 1): 3}, boundary="edge_only"
    )
    other.parent = np.arange(3)
    assert isinstance(other, Refined)
    assert np.shares_memory(other.points, points)
    assert points.flags.writeable
    assert_connectivity(other, faces)
    assert other.creases[1].tolist() == [3]
    assert other.boundary == "edge_only"
    assert other.with_points(points).parent is other.parent
    assert pickle.loads(pickle.dumps(other.parent)).tolist() == [0, 1, 2]


def test_repr():
    assert repr(Mesh(*zoo.cube())) == (
        "Mesh(8 vertices, 12 edges, 6 faces {4: 6}, interior valences {3: 8})"
    )
    assert repr(tagged()) == (
        "Mesh(6 vertices, 8 edges, 3 faces {3: 2, 4: 1}, 6 boundary vertices, 1 crease, 1 corner, "
        "1 hole, boundary='none', channel 'uv')"
    )
    mesh = Mesh(*zoo.with_unused(zoo.single_face(3)), scheme="loop", corners={1: 1, 2: 1})
    assert repr(mesh) == (
        "Mesh(4 vertices, 3 edges, 1 face {3: 1}, 3 boundary vertices, 1 unused vertex, 2 corners, "
        "scheme='loop')"
    )
    assert repr(Mesh(*zoo.NONMANIFOLD["fin"][:2])) == (
        "Mesh(12 vertices, 17 edges, 6 faces {4: 6}, 11 boundary vertices, 3 non-manifold vertices)"
    )
    many = repr(Mesh(*zoo.disjoint(*(zoo.single_face(n) for n in range(3, 20)))))
    assert "17 faces {3: 1, 4: 1, 5: 1, 6: 1, 7: 1, 8: 1, 9: 1, 10: 1, ...}" in many


def test_connectivity_is_documented():
    for name in [*CONNECTIVITY, "faces"]:
        assert vars(Mesh)[name].__doc__


# --- The zoo itself


def test_zoo_is_exact_and_the_same_each_time():
    for name, make in zoo.ZOO.items():
        points, faces = make()
        again, faces_again = make()
        assert np.array_equal(points, again)
        assert faces == faces_again
        assert (points * zoo.UNIT == np.rint(points * zoo.UNIT)).all(), name
        assert zoo.is_manifold(faces), name


def test_zoo_has_all_kinds():
    meshes = [Mesh(*make()) for make in zoo.ZOO.values()]
    interior = [set(m.vertex_faces[~m.boundary_vertex & (m.vertex_faces > 0)]) for m in meshes]
    assert set.union(*interior) >= {2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 33, 64}
    assert set().union(*(set(m.sizes.tolist()) for m in meshes)) >= {3, 4, 5, 6, 7, 8, 12}
    closed = [not m.boundary_edge.any() for m in meshes]
    assert 15 < sum(closed) < len(meshes) - 15
    regular = [zoo.has_regular_boundary(make()[1]) for make in zoo.ZOO.values()]
    assert 5 <= len(regular) - sum(regular) < len(regular) / 2
    assert not zoo.has_regular_boundary(zoo.grid(1, 1)[1], "edge_only")
    assert zoo.has_regular_boundary(zoo.cylinder(4, 2)[1], "edge_only")


@given(zoo.cages(keep=zoo.has_regular_boundary))
def test_cages_with_a_regular_boundary(cage):
    mesh = Mesh(*cage)
    assert set(mesh.vertex_faces[mesh.boundary_vertex]) <= {1, 2}


MASKED = [
    ("points", 5, "coordinates: the entry at index 1, 2 is masked"),
    ("faces", 6, "vertex indices of faces: the entry at index 1, 2 is masked"),
    ("face", 1, "vertices of face 0: the entry at index 1 is masked"),
    ("sharpness", 0, "sharpness of creases: the entry at index 0 is masked"),
    ("corners", 1, "vertices of corners: the entry at index 1 is masked"),
    ("holes", 0, "holes: the entry at index 0 is masked"),
]


@pytest.mark.parametrize(("what", "place", "match"), MASKED, ids=[x[0] for x in MASKED])
def test_nothing_is_masked(what, place, match):
    points, faces = map(np.asarray, zoo.cube())

    def given(name, values):
        values = np.ma.array(values)
        if name == what:
            values[np.unravel_index(place, values.shape)] = np.ma.masked
        return values

    rows = given("faces", faces)
    cage = given("points", points), [given("face", rows[0]), *faces[1:]] if what == "face" else rows
    tags = {
        "creases": ([[0, 1]], given("sharpness", [1.0])),
        "corners": (given("corners", [0, 1]), [1.0, 1.0]),
        "holes": given("holes", [0, 1]),
    }
    with pytest.raises(MeshError, match=match):
        Mesh(*cage, **tags)
    assert Mesh(np.ma.array(points), np.ma.array(faces)).n_faces == 6


# --- Units, axes and gaps


def test_units_and_up_are_carried():
    mesh = ls.Mesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]], units=1, up="z")
    assert (mesh.units, mesh.up) == (1.0, "z")
    assert "units=1.0, up='z'" in repr(mesh)
    copies = [mesh.with_points(mesh.points), pickle.loads(pickle.dumps(mesh)), copy.copy(mesh)]
    assert all(each == mesh for each in copies)
    for other in {"units": 1}, {"up": "z"}, {"units": 2, "up": "z"}, {"units": 1, "up": "y"}:
        assert ls.Mesh(mesh.points, mesh.faces, **other) != mesh
    fine = ls.refined(mesh, 1)
    assert (fine.units, fine.up) == (1.0, "z")
    plain = ls.Mesh(mesh.points, mesh.faces)
    assert (plain.units, plain.up) == (None, None)


@pytest.mark.parametrize("units", [0, -1, math.nan, math.inf, "m", True, [1], 1j])
def test_units_that_are_none(units):
    with pytest.raises(ValueError, match=r"units: got .*, need a positive number of metres"):
        ls.Mesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]], units=units)


@pytest.mark.parametrize("up", ["x", "Y", 1, ""])
def test_axes_that_are_none(up):
    with pytest.raises(ValueError, match=r"up: got .*, need one of None, 'y', 'z'"):
        ls.Mesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]], up=up)


@pytest.mark.parametrize("kind", [float, object])
def test_gaps_in_channels(kind):
    """Values may be NaN, but neither infinite, nor may points be either."""
    points, faces = [[0, 0], [1, 0], [1, 1], [0, 1], [2, 0], [2, 1]], [[0, 1, 2, 3], [1, 4, 5, 2]]
    rows = [0, 1, 2, 3, 4, 4, 4, 4]

    def channels(last):
        return {"st": (np.array([0, 1, 2, 3, last], dtype=kind), rows, "corners_plus1")}

    mesh = ls.Mesh(points, faces, channels=channels(math.nan))
    assert mesh == ls.Mesh(points, faces, channels=channels(math.nan))
    assert mesh != ls.Mesh(points, faces, channels=channels(3))
    with pytest.raises(ls.MeshError, match="channel 'st': row 4: coordinate inf is not finite"):
        ls.Mesh(points, faces, channels=channels(math.inf))
    if kind is float:
        found = ls.LimitSurface(mesh).evaluate([0, 1], 0.5, 0.5, channel="st")
        assert np.isnan(found).tolist() == [False, True]
        fine = ls.refined(mesh, 1)
        values, where, _ = fine.channels["st"]
        assert np.isnan(values[where]).reshape(8, 4).tolist() == [[i > 3] * 4 for i in range(8)]
