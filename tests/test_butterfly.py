"""The butterfly schemes, which interpolate and have no polynomial pieces."""

import dataclasses
import json
import pickle
from fractions import Fraction as F
from typing import Any

import command_line
import numpy as np
import oracles
import oracles_butterfly
import pytest
import zoo_triangles
from mpmath import mp

import limitsurf as ls

SCHEMES = ["butterfly", "modified-butterfly"]
REFERENCE = oracles.CASES.parent / "schemes"
CAGES = ["icosahedron", "crowded", "grid_4x4", "fan_3", "fan_7", "bipyramid_12", "triangle"]
schemes = pytest.mark.parametrize("scheme", SCHEMES)


def cage(name):
    points, faces = zoo_triangles.ZOO[name]()
    random = np.random.default_rng(len(points)).integers(-64, 65, (len(points), 3))
    return random / 64 + np.array(points, dtype=float), faces


def wheel(N, rings=2):
    """A disc of N sectors around one vertex, the others of valence 6."""
    turn = 2 * np.pi / N * np.arange(N + 1)
    spoke = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    spoke[N] = spoke[0]
    number, points = {(0, 0, 0): 0}, [(0.0, 0.0)]
    for r in range(1, rings + 1):
        for s in range(N):
            for t in range(r):
                number[r, s, t] = len(points)
                points.append(tuple((r - t) * spoke[s] + t * spoke[s + 1]))

    def at(r, s, t):
        return number[(r, (s + 1) % N, 0) if t == r and r else (r, s if r else 0, t)]

    faces = []
    for r in range(1, rings + 1):
        for s in range(N):
            for t in range(r):
                faces.append((at(r - 1, s, t), at(r, s, t), at(r, s, t + 1)))
                if t < r - 1:
                    faces.append((at(r - 1, s, t), at(r, s, t + 1), at(r - 1, s, t + 1)))
    return points, faces


def sector(k, rings=2):
    """The first k sectors of a wheel: a boundary vertex of k faces."""
    N = max(2 * k, 6)
    points, faces = wheel(N, rings)
    middle = [np.mean([points[v] for v in face], axis=0) for face in faces]
    angle = [np.arctan2(y, x) % (2 * np.pi) * N / (2 * np.pi) for x, y in middle]
    faces = [face for face, a in zip(faces, angle, strict=True) if a < k]
    used = sorted({v for face in faces for v in face})
    number = {v: i for i, v in enumerate(used)}
    return [points[v] for v in used], [[number[v] for v in face] for face in faces]


def bumpy(flat, seed=0):
    """A cage over the plane with heights."""
    points, faces = flat
    height = np.random.default_rng(seed).integers(-32, 33, len(points)) / 64
    return ls.Mesh(np.column_stack([points, height]), faces)


def queries(n_faces, n, seed=0):
    rng = np.random.default_rng(seed)
    face, (u, v) = rng.integers(0, n_faces, n), rng.random((2, n))
    over = u + v > 1
    u[over], v[over] = 1 - u[over], 1 - v[over]
    u[: n // 2] *= 1e-9
    v[: n // 2] *= 1e-9
    return face, u, v


def largest_error(scheme, name, n=2):
    """Of positions, over the size of the cage, and of derivatives, over the larger one's."""
    points, faces = cage(name)
    surface = ls.LimitSurface(ls.Mesh(points, faces), scheme=scheme)
    naive = oracles_butterfly.Surface(
        points.tolist(), faces, "modified" in surface.rules["scheme"].name
    )
    errors = []
    for f, u, v in zip(*(x.tolist() for x in queries(len(faces), n)), strict=True):
        needed = np.array([[float(x) for x in row] for row in naive.evaluate(f, u, v, more=75)])
        jet = surface.jet(f, u, v, order=1)
        size = np.abs(needed[1:]).max()
        errors.append(np.abs(jet[0, 0] - needed[0]).max() / np.ptp(points))
        errors += [np.abs(jet[nu] - x).max() / size for nu, x in
                   zip(((1, 0), (0, 1)), needed[1:], strict=True)]  # fmt: skip
    return max(errors)


@pytest.mark.parametrize("name", CAGES)
@schemes
def test_values_are_the_oracles(scheme, name):
    assert largest_error(scheme, name) <= 3e-15


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"ends": F(7, 16), "across": F(3, 16)}, "icosahedron"),
        ({"across": F(1, 16), "wings": F(-1, 32)}, "icosahedron"),
        ({"curve": (F(17, 32), F(-1, 32))}, "fan_3"),
        ({"spokes": None}, "icosahedron"),
    ],
    ids=lambda x: ", ".join(x) if isinstance(x, dict) else x,
)
def test_wicked_masks_are_seen(change, name):
    scheme = dataclasses.replace(ls.schemes["modified-butterfly"], **change)
    assert largest_error(scheme, name, 1) > 1e-4


@schemes
@pytest.mark.parametrize("name", CAGES)
def test_refined_is_naively_refined(scheme, name):
    points, faces = cage(name)
    mesh = ls.Mesh(points, faces)
    fine, R = ls.refined(mesh, 2, scheme=scheme, operator=True)
    naive = oracles_butterfly.Surface(points.tolist(), faces, "modified" in scheme).mesh
    once, names = oracles_butterfly.refined(naive, "modified" in scheme)
    middle = ls.refined(mesh, 1, scheme=scheme)
    number = {v: v for v in range(mesh.n_vertices)}
    number |= {frozenset(e): mesh.n_vertices + k for k, e in enumerate(mesh.edges.tolist())}
    assert set(names) == set(number)
    for what, k in names.items():
        assert np.abs(middle.points[number[what]] - np.array(once.points[k], float)).max() < 3e-15
    twice, _ = oracles_butterfly.refined(once, "modified" in scheme)
    rows = np.array(sorted([float(x) for x in p] for p in twice.points.values()))
    order = np.lexsort(fine.points.T[::-1])
    assert np.abs(np.sort(fine.points, axis=0) - np.sort(rows, axis=0)).max() < 5e-15
    assert len(order) == len(rows)
    assert np.abs(R @ points - fine.points).max() < 5e-15
    assert np.array_equal(fine.points[: len(points)], points)
    assert np.array_equal(fine.limit_points, fine.points)
    used = fine.parent_face, fine.parent_u, fine.parent_v
    found = ls.LimitSurface(mesh, scheme=scheme).evaluate(*used)
    assert np.abs(found - fine.points).max() < 1e-14


@schemes
def test_cubics_are_kept_and_quartics_are_not(scheme):
    n = 7
    places = [(F(i), F(j)) for j in range(n) for i in range(n)]
    faces = [
        t
        for j in range(n - 1)
        for i in range(n - 1)
        for t in ([n * j + i, n * j + i + 1, n * (j + 1) + i],
                  [n * (j + 1) + i + 1, n * (j + 1) + i, n * j + i + 1])
    ]  # fmt: skip
    wanted = [(lambda x, y, a=a, b=b: x**a * y**b) for a in range(4) for b in range(4 - a)]
    values = [[x, y, *(f(x, y) for f in wanted), x**4] for x, y in places]
    mesh = ls.Mesh(np.array(values, dtype=object), faces)
    fine = ls.refined(mesh, 1, scheme=scheme)
    inner = [p for p in fine.points if all(2 <= c <= n - 3 for c in p[:2])]
    assert len(inner) == 25
    for x, y, *rest, quartic in inner:
        assert rest == [f(x, y) for f in wanted]
        assert (quartic == x**4) == (x.denominator == 1)
    surface, middle = ls.LimitSurface(mesh, scheme=scheme), 2 * (2 * (n - 1) + 4) - 12
    middle = 2 * ((n - 1) * 3 + 3)
    found = surface.evaluate(middle, F(3, 8), F(1, 4))
    x, y = F(27, 8), F(13, 4)
    assert list(found[:-1]) == [x, y, *(f(x, y) for f in wanted)]
    du = surface.evaluate(middle, F(3, 8), F(1, 4), nu=(1, 0))
    assert list(du[:4]) == [1, 0, 0, 0]


def test_vtk_refines_closed_meshes_alike():
    pyvista = pytest.importorskip("pyvista")
    ball = pyvista.Sphere(theta_resolution=12, phi_resolution=8).clean()
    theirs = ball.subdivide(1, "butterfly").points
    own = ls.refined(ls.from_pyvista(ball), 1, scheme="modified-butterfly").points
    assert len(own) == len(theirs)
    apart = np.linalg.norm(own[:, None] - theirs, axis=2).min(axis=1)
    assert apart.max() < 1e-7  # VTK has them in single precision


@pytest.mark.skipif(not REFERENCE.is_dir(), reason="no reference numbers here")
def test_reference_numbers():
    cages = json.loads((REFERENCE / "butterfly_cages.json").read_text("utf-8"))
    rows = np.load(REFERENCE / "butterfly.npz")
    for case in np.unique(rows["case"]).tolist():
        given, here = cages[case], rows["case"] == case
        mesh = ls.Mesh(given["points"], given["faces"])
        surface = ls.LimitSurface(mesh, scheme="modified-butterfly")
        asked = [rows[name][here] for name in ("face", "u", "v")]
        size = np.ptp(mesh.points)
        assert np.abs(surface.evaluate(*asked) - rows["P"][here]).max() <= 1e-15 * size
        du, dv = rows["du"][here], rows["dv"][here]
        known = ~np.isnan(du[:, 0])
        largest = np.abs(np.concatenate([du, dv], axis=1)[known]).max(axis=1)[:, None]
        for nu, needed in (((1, 0), du), ((0, 1), dv)):
            found = surface.evaluate(*asked, nu=nu)
            assert (np.abs(found - needed)[known] <= 1e-13 * largest).all()
        assert np.abs(surface.normal(*asked) - rows["normal"][here])[known].max() < 1e-13
        vertex = rows["vertex"][rows["vcase"] == case]
        if len(vertex):
            found = surface.normal(*surface.limit_faces.at_vertex(vertex))
            assert np.abs(found - rows["vnormal"][rows["vcase"] == case]).max() < 1e-13


def deep_normal(mesh, modified, more):
    """A normal at corner 0 of face 0, from sides of triangles after many steps."""
    naive = oracles_butterfly.Surface(mesh.points.tolist(), mesh.faces, modified)
    _, a, b = naive.evaluate(0, 0, 0, more=more)
    with mp.workdps(oracles_butterfly.DIGITS):
        cross = [a[k - 2] * b[k - 1] - a[k - 1] * b[k - 2] for k in range(3)]
        size = mp.sqrt(sum(x * x for x in cross))
        return np.array([float(x / size) for x in cross])


@pytest.mark.parametrize("N", [3, 4, 5, 7, 8, 9, 12, 30, 50])
@schemes
def test_normals_of_vertices_are_those_of_waves_around(scheme, N):
    """By cosines and sines on the ring after a step; NaN where the original scheme is not C1."""
    mesh = bumpy(wheel(N))
    surface = ls.LimitSurface(mesh, scheme=scheme)
    found = surface.normal(0, 0.0, 0.0)
    fine = ls.refined(mesh, 1, scheme=scheme)
    place = {tuple(sorted(e)): mesh.n_vertices + k for k, e in enumerate(mesh.edges.tolist())}
    ring = fine.points[[place[0, 1 + j] for j in range(N)]]
    turn = 2 * np.pi / N * np.arange(N)
    cross = np.cross(np.cos(turn) @ ring, np.sin(turn) @ ring)
    smooth = scheme == "modified-butterfly" or 4 <= N <= 7
    if not smooth:
        assert np.isnan(found).all()
        assert np.isnan(ls.refined(mesh, 0, scheme=scheme).limit_normals[0]).all()
        return
    if scheme == "butterfly":  # which sees more than one ring
        cross = deep_normal(mesh, False, 230 if N == 7 else 70)
    assert np.abs(found - cross / np.linalg.norm(cross)).max() < 1e-12
    for level in (0, 1, 2):
        level_normals = ls.refined(mesh, level, scheme=scheme).limit_normals
        assert np.abs(level_normals[0] - found).max() < 1e-12
    # what is far too near to be told from the vertex has a normal of its own, close to it
    near = surface.normal(0, [1e-300, 3e-300], [1e-300, 0])
    assert np.abs(near - found).max() < 1e-6


@pytest.mark.parametrize("N", [3, 5, 8])
def test_next_to_a_vertex_surfaces_repeat(N):
    """Halving by halving: the modified scheme has the subdominant eigenvalue 1/2."""
    surface = ls.LimitSurface(bumpy(wheel(N)), scheme="modified-butterfly")
    u, v = 0.7109375, 0.1416015625
    deep, deeper = (np.ldexp([u, v], -k) for k in (60, 1000))
    origin = surface.evaluate(0, 0, 0)
    for nu in ((1, 0), (0, 1)):
        one, other = (surface.evaluate(0, *place, nu=nu) for place in (deep, deeper))
        assert np.abs(one - other).max() < 1e-12 * np.abs(one).max()
    assert np.abs(surface.evaluate(0, *deeper) - origin).max() < 1e-300
    assert np.isnan(surface.evaluate(0, 0, 0, nu=(1, 0))).all()
    along, across = surface.tangents(0, 0, 0)
    needed = surface.evaluate(0, 1e-300, 0, nu=(1, 0))
    assert np.abs(along - needed / np.linalg.norm(needed)).max() < 1e-12
    assert abs(np.linalg.norm(across) - 1) < 1e-15


@pytest.mark.parametrize(("k", "smooth"), [(1, True), (2, True), (3, True), (4, False), (6, False)])
@schemes
def test_normals_on_boundaries(scheme, k, smooth):
    """By faces at the vertex; both schemes are the same there."""
    mesh = bumpy(sector(k))
    found = ls.LimitSurface(mesh, scheme=scheme).normal(0, 0.0, 0.0)
    assert np.isnan(found).any() != smooth
    if smooth:
        modified = "modified" in scheme
        if k == 1:  # errors fall like 1 / n
            one, two = (deep_normal(mesh, modified, n) for n in (60, 120))
            assert np.abs(found - (2 * two - one)).max() < 1e-4
            assert np.abs(found - two).max() > 1e-4
            return
        assert np.abs(found - deep_normal(mesh, modified, 75)).max() < 1e-12


@schemes
def test_differences_are_the_derivatives(scheme):
    mesh = bumpy(wheel(5))
    surface, h = ls.LimitSurface(mesh, scheme=scheme), 2.0**-24
    face, u, v = queries(len(mesh.faces), 30, 3)
    u, v = np.round(u * 2**16) / 2**17, np.round(v * 2**16) / 2**17
    for nu, step in (((1, 0), (h, 0)), ((0, 1), (0, h))):
        change = surface.evaluate(face, u + step[0], v + step[1]) - surface.evaluate(face, u, v)
        inside = (u > 0) & (v > 0)
        error = np.abs(change / h - surface.evaluate(face, u, v, nu=nu))[inside]
        assert error.max() < 1e-5


@schemes
def test_weights_are_what_evaluates(scheme):
    points, faces = cage("crowded")
    mesh = ls.Mesh(points, faces)
    surface, asked = ls.LimitSurface(mesh, scheme=scheme), queries(len(faces), 40)
    orders = [(0, 0), (1, 0), (0, 1), (1, 1)]
    for nu, W in zip(orders, surface.weights(*asked, nu=orders), strict=True):
        found = surface.evaluate(*asked, nu=nu)
        if nu == (1, 1):
            assert np.isnan(found).all()
            assert np.isnan(W @ points).all()
            continue
        assert np.abs(W @ points - found).max() < 1e-13 * (1 + np.abs(found).max())
        assert np.abs(W.sum(axis=1) - (nu == (0, 0))).max() < 1e-13
    assert np.isnan(surface.evaluate(*asked, nu=(0, 2))).all()
    one = [surface.evaluate(int(f), x, y) for f, x, y in zip(*asked, strict=True)]
    assert np.abs(np.array(one) - surface.evaluate(*asked)).max() < 1e-15
    far = surface.with_points(points + 1e6)
    rtol = 1e-8  # of points rounded to 1e-10
    np.testing.assert_allclose(
        far.evaluate(*asked, nu=(1, 0)), surface.evaluate(*asked, nu=(1, 0)), atol=rtol
    )


def test_exact_values():
    points, faces = zoo_triangles.ZOO["octahedron"]()
    exact = np.vectorize(F, otypes=[object])(np.array(points))
    surface = ls.LimitSurface(ls.Mesh(exact, faces), scheme="modified-butterfly")
    rounded = surface.with_points(exact.astype(float))
    for nu in ((0, 0), (1, 0), (0, 1)):
        found = surface.evaluate(0, F(3, 8), F(5, 16), nu=nu)
        assert all(isinstance(x, F) for x in found)
        assert np.abs(found.astype(float) - rounded.evaluate(0, 3 / 8, 5 / 16, nu=nu)).max() < 1e-15
    W = surface.weights(0, F(3, 8), F(5, 16))
    assert ((W @ exact)[0] == surface.evaluate(0, F(3, 8), F(5, 16))).all()
    with pytest.raises(ValueError, match=r"u = 1/3.*powers of two"):
        surface.evaluate(0, F(1, 3), F(1, 4))
    points, faces = zoo_triangles.ZOO["icosahedron"]()
    exact = np.vectorize(F, otypes=[object])(np.array(points))
    with pytest.raises(TypeError, match=r"vertex 0 has valence 5, where .* irrational"):
        ls.refined(ls.Mesh(exact, faces), 1, scheme="modified-butterfly")
    assert ls.refined(ls.Mesh(exact, faces), 1, scheme="butterfly").points.dtype == object


NEEDS_PIECES = {
    "bezier_patches": lambda s: ls.bezier_patches(s),
    "bounds": lambda s: ls.bounds(s),
    "area": lambda s: ls.area(s),
    "quadrature": lambda s: ls.quadrature(s),
    "closest_point": lambda s: ls.closest_point(s, [[0.0, 0.0, 2.0]]),
    "intersect": lambda s: ls.intersect(s, [[0.0, 0.0, 2.0]], [[0.0, 0.0, -1.0]]),
    "section": lambda s: ls.section(s, [0, 0, 0], [0, 0, 1]),
    "sample": lambda s: ls.sample(s, 10),
    "tessellate": lambda s: ls.tessellate(s, chord=0.01),
    "Space": lambda s: ls.Space(s),
    "curvature": lambda s: s.curvature(0, 0.25, 0.25),
    "patches": lambda s: s.patches,
    "eigenbasis": lambda s: ls.eigenbasis(s.rules["scheme"], valence=5),
}


@pytest.mark.parametrize("what", NEEDS_PIECES)
@schemes
def test_what_needs_pieces_is_refused(scheme, what):
    points, faces = zoo_triangles.ZOO["octahedron"]()
    surface = ls.LimitSurface(ls.Mesh(points, faces), scheme=scheme)
    with pytest.raises(ValueError, match=rf"scheme '{scheme}' .*no polynomial pieces.*evaluate"):
        NEEDS_PIECES[what](surface)


@schemes
def test_what_needs_none_works(scheme, tmp_path):
    points, faces = zoo_triangles.ZOO["octahedron"]()
    uv = np.random.default_rng(0).random((3 * len(faces), 2))
    channel = {"uv": (uv, np.arange(3 * len(faces)), "corners_plus1")}
    mesh = ls.Mesh(points, faces, channels=channel, scheme=scheme)
    surface = ls.LimitSurface(mesh)
    copy = pickle.loads(pickle.dumps(surface))
    asked = queries(len(faces), 20)
    assert np.array_equal(copy.evaluate(*asked), surface.evaluate(*asked))
    assert np.array_equal(surface.evaluate(*asked, workers=2), surface.evaluate(*asked))
    fine = ls.refined(mesh, 2)
    made = ls.tessellate(surface, 4)
    assert len(made.faces) == len(fine.faces) == 16 * len(faces)
    one, other = (x[np.lexsort(x.round(9).T)] for x in (made.points, fine.points))
    assert np.abs(one - other).max() < 1e-14
    values = surface.evaluate(0, [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], channel="uv")
    assert np.array_equal(values, uv[:3])
    assert ls.validate(surface, 3)["error"].max() < 1e-14
    ls.write(tmp_path / "cage.obj", mesh)
    assert ls.read(tmp_path / "cage.obj").scheme == scheme
    nan = surface.evaluate([0, 1], [np.nan, 0.25], 0.25)
    assert np.isnan(nan[0]).all()
    assert not np.isnan(nan[1]).any()


@schemes
def test_bad_cages(scheme):
    points = np.eye(3)[[0, 1, 2, 0]] + np.arange(4)[:, None]
    with pytest.raises(ls.MeshError, match="no rule for creases"):
        ls.LimitSurface(ls.Mesh(points, [[0, 1, 2]], creases={(0, 1): 2}), scheme=scheme)
    with pytest.raises(ls.MeshError, match="is of triangles: face 0 has 4 corners"):
        ls.LimitSurface(ls.Mesh(points, [[0, 1, 2, 3]]), scheme=scheme)
    with pytest.raises(ls.MeshError, match=r"face 1 has a vertex twice \(0, 2, 2\)"):
        ls.LimitSurface(ls.Mesh(points, [[0, 1, 2], [0, 2, 2]]), scheme=scheme)
    uv = {"uv": (np.eye(3), [0, 1, 2], "all")}
    flat = ls.LimitSurface(ls.Mesh(points, [[0, 1, 2]], channels=uv), scheme=scheme)
    with pytest.raises(ValueError, match="no rule for channel 'uv'"):
        flat.evaluate(0, 0.25, 0.25, channel="uv")


@pytest.mark.parametrize(
    "faces",
    [[[0, 1, 2], [2, 1, 0]], [[0, 1, 2], [1, 0, 3], [0, 1, 4]], [[0, 1, 2], [0, 3, 4]],
     [[2, 0, 1], [2, 1, 3], [2, 3, 0], [0, 3, 1]], [[0, 1, 2], [1, 0, 3], [2, 1, 4], [0, 2, 4]]],
    ids=["pillow", "book", "bow_tie", "tetrahedron", "open"],
)  # fmt: skip
@schemes
def test_odd_cages_are_their_refinements(scheme, faces):
    points = np.random.default_rng(5).random((5, 3))
    mesh = ls.Mesh(points, faces)
    fine = ls.refined(mesh, 3, scheme=scheme)
    used = np.flatnonzero(fine.parent_face >= 0)
    asked = (x[used] for x in (fine.parent_face, fine.parent_u, fine.parent_v))
    found = ls.LimitSurface(mesh, scheme=scheme).evaluate(*asked)
    assert np.abs(found - fine.points[used]).max() < 1e-14


@pytest.mark.parametrize("N", range(2, 51))
def test_masks_of_every_valence_are_those_of_the_papers(N):
    known: Any = ls.schemes["modified-butterfly"]
    mask = known.spoke_mask(N)
    if N in (2, 6):  # edges there are like others
        assert mask is None
        return
    needed = [0.75, *map(float, oracles_butterfly.ring_weights(N))]
    assert np.abs(np.array(mask, dtype=float) - needed).max() < 1e-16


@schemes
def test_vertices_amid_two_faces_have_no_mask_of_their_own(scheme):
    """Each edge of two triangles back to back: 1/2 - 1/8 of each end, 1/4 of the third corner."""
    points = np.random.default_rng(7).random((3, 3))
    fine = ls.refined(ls.Mesh(points, [[0, 1, 2], [2, 1, 0]]), 1, scheme=scheme)
    needed = [3 / 8 * (p + q) + o / 4 for p, q, o in points[[[0, 1, 2], [1, 2, 0], [2, 0, 1]]]]
    found = sorted(fine.points[3:].tolist())
    assert np.abs(np.array(found) - np.array(sorted(x.tolist() for x in needed))).max() < 1e-15
    surface = ls.LimitSurface(ls.Mesh(points, [[0, 1, 2], [2, 1, 0]]), scheme=scheme)
    assert np.isnan(surface.normal(0, 0.0, 0.0)).all()


@pytest.mark.parametrize(
    ("spokes", "text"),
    [
        (lambda N: (F(3, 4),) * (N + 1), r"spokes\(5\) must be 6 exact numbers of sum 1"),
        (lambda N: (F(1, 2), F(1, 2), F(1, 8), *(F(0),) * (N - 3), F(-1, 8)), "not symmetric"),
    ],
)
def test_broken_masks_are_refused(spokes, text):
    known: Any = ls.schemes["modified-butterfly"]
    scheme = dataclasses.replace(known, name="mine", spokes=spokes)
    points, faces = cage("icosahedron")
    with pytest.raises(ValueError, match=rf"'mine'.*{text}"):
        ls.refined(ls.Mesh(points, faces), 1, scheme=scheme)
    with pytest.raises(ValueError, match="curve sum to 2"):
        dataclasses.replace(known, curve=(F(1), F(0)))


@schemes
def test_commands(scheme, tmp_path):
    path, out = tmp_path / "cage.obj", tmp_path / "out.obj"
    ls.write(path, ls.Mesh(*zoo_triangles.ZOO["octahedron"](), scheme=scheme))
    told = command_line.succeed("info", path)
    assert scheme in told
    assert "patches" not in told
    rows = command_line.succeed("evaluate", path, "--grid", 3, "--order", 1, "--normals")
    assert len(rows.splitlines()) == 1 + 8 * 9
    command_line.succeed("refine", path, "-o", out)
    assert np.array_equal(ls.read(out).points[:6], ls.read(path).points)
    command_line.succeed("tessellate", path, "-n", 2, "-o", out)
    assert ls.read(out).n_faces == 8 * 4
    command_line.succeed("validate", path)
    assert f"'{scheme}'" in command_line.fail("measure", path)
