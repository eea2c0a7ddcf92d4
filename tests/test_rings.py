"""Special corners of many faces, whose rings are refined instead of having eigenbases."""

import itertools

import numpy as np
import oracles_creases
import oracles_loop
import pytest
import zoo_triangles

import limitsurf as ls
from limitsurf import rings, tables
from limitsurf._kernels import evaluation
from limitsurf.numbers import FLOAT64, RATIONAL

KINDS = ("interior", "cone", "crease", "corner", "dart")
MANY = tables.MOST_FACES + 1
ORDERS = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (0, 3), (4, 0)]


def around(kind, faces, scale=1):
    """Faces 0 to `faces` - 1 in turn around vertex 0, and two rings of quads around these."""
    open_ring = kind in ("crease", "corner")
    sides = 2 * faces
    columns = sides + open_ring
    angle = (np.pi if open_ring else 2 * np.pi) * np.arange(columns) / sides
    waves = np.cos(5 * angle) / 4
    rings = [np.array([[0, 0, 0.5]])]
    rings += [np.stack([r * np.cos(angle), r * np.sin(angle), waves], axis=1) for r in (1, 2, 3)]
    points = np.concatenate(rings)
    points += np.random.default_rng(faces).normal(size=points.shape) / faces / 4

    def at(r, j):
        return 1 + r * columns + j % columns

    j = np.arange(faces)
    quads = [np.stack([0 * j, at(0, 2 * j), at(0, 2 * j + 1), at(0, 2 * j + 2)], axis=1)]
    j = np.arange(sides)
    for r in (0, 1):
        quads.append(np.stack([at(r, j), at(r + 1, j), at(r + 1, j + 1), at(r, j + 1)], axis=1))
    tags = {}
    if kind in ("cone", "corner"):
        tags["corners"] = {0: np.inf}
    if kind == "dart":
        spoke = [0, at(0, 0), at(1, 0), at(2, 0)]
        tags["creases"] = dict.fromkeys(itertools.pairwise(spoke), np.inf)
    return ls.Mesh(scale * points, np.concatenate(quads), **tags)


def places(faces):
    """Queries at a vertex, on its edges and between, near and far."""
    side = [0, 0, 0, 0, 0.25, 1, 1e-9, 1e-30]
    other = [0, 0.3, 1e-9, 1e-30, 0, 0.5, 1e-9, 3e-30]
    face = np.array([0, 1, faces // 2, faces - 1])[:, None]
    inside = np.array([[0.3, 0.7], [1e-5, 1e-4]]).T
    u, v = np.concatenate([[side, other], inside], axis=1)
    return tuple(x.ravel() for x in np.broadcast_arrays(face, u, v))


def relative(found, wanted):
    """The largest error, by the size of the vector that it is in."""
    assert np.array_equal(np.isnan(found), np.isnan(wanted))
    found, wanted = np.nan_to_num(found), np.nan_to_num(wanted)
    size = np.abs(wanted).max(axis=1, keepdims=True)
    return (np.abs(found - wanted) / np.where(size > 0, size, 1)).max()


@pytest.mark.parametrize("kind", KINDS)
def test_against_rational_numbers(kind):
    mesh = around(kind, MANY)
    face, u, v = (x[::3] for x in places(MANY))
    surface = ls.LimitSurface(mesh)
    assert surface.patches.rings
    exact = ls.LimitSurface(mesh.with_points(RATIONAL.array(mesh.points)))
    for nu in ORDERS:
        wanted = exact.evaluate(face, u, v, nu=nu).astype(float)
        assert relative(surface.evaluate(face, u, v, nu=nu), wanted) < 1e-12
        assert relative(surface.weights(face, u, v, nu=nu) @ mesh.points, wanted) < 1e-12


def halved(level, count, seed=0):
    """Parameters (count,) of which level + 1 halvings lead to a regular piece."""
    both = np.random.default_rng(seed).random((2, count))
    both[0] += 1
    both[:, 1::2] = both[::-1, 1::2]
    return both / 2.0 ** (level + 1)


@pytest.mark.parametrize("kind", KINDS)
def test_kernels_against_rational_numbers(kind):
    """Some levels are kept for kernels, of sharp sides fewer; the others are the reference's."""
    mesh = around(kind, MANY)
    surface = ls.LimitSurface(mesh, engine="compiled")
    exact = ls.LimitSurface(mesh.with_points(RATIONAL.array(mesh.points)))
    face = np.array([0, 1, MANY // 2, MANY - 1])
    for level in (0, 3, 5, 12):
        u, v = halved(level, len(face), level)
        v[0] = u[-1] = 0
        for nu in ORDERS[:6]:
            wanted = exact.evaluate(face, u, v, nu=nu).astype(float)
            error = np.abs(surface.evaluate(face, u, v, nu=nu) - wanted).max(axis=1)
            size = np.abs(wanted).max(axis=1)
            bound = 1e-12 * np.maximum(size, 1e-3 * size.max()) if any(nu) else 1e-14
            assert (error <= bound).all()


@pytest.mark.parametrize(
    ("kind", "columns"),
    [("interior", 6), ("hole", 3), ("crowd", 3), ("dart", 3), ("crease", 1), ("polygon", 3)],
)
def test_kernels_against_the_reference(kind, columns):
    """Also where not all faces around a corner are patches that share its ring."""
    mesh = polygon(MANY, 0.3) if kind == "polygon" else around("interior", MANY)
    if kind in KINDS:
        mesh = around(kind, MANY)
    if kind == "hole":
        mesh = ls.Mesh(mesh.points, mesh.uniform, holes=[5, 6, 20])
    if kind == "crowd":
        mesh = ls.Mesh(mesh.points, mesh.uniform, corners={5: np.inf, 60: 1.5})
    mesh = mesh.with_points(np.tile(mesh.points, 2)[:, :columns])
    compiled, reference = (ls.LimitSurface(mesh, engine=x) for x in ("compiled", "reference"))
    face = np.arange(MANY)
    for level in (0, 2, 6, 14, 300):
        u, v = halved(level, MANY)
        if kind == "polygon":
            u, v = 1 - u, 1 - v
        given = compiled.jet(face, u, v, order=2), reference.jet(face, u, v, order=2)
        for nu, wanted in given[1].items():
            assert np.array_equal(np.isnan(given[0][nu]), np.isnan(wanted))
            size = np.nanmax(np.abs(wanted), initial=0)
            assert np.allclose(given[0][nu], wanted, rtol=0, atol=2e-14 * size, equal_nan=True)
        if columns == 3:
            normal = compiled.normal(face, u, v), reference.normal(face, u, v)
            assert np.allclose(*normal, rtol=0, atol=1e-11, equal_nan=True)
    at = float(kind == "polygon")
    for nu in ((0, 0), (1, 0)):
        both = (x.evaluate(face, at, at, nu=nu) for x in (compiled, reference))
        assert np.allclose(*both, rtol=0, atol=1e-15, equal_nan=True)


@pytest.mark.parametrize("kind", KINDS)
def test_against_the_oracle(kind):
    mesh = around(kind, MANY)
    faces = mesh.indices.reshape(-1, 4).tolist()
    creases = {
        tuple(sorted(pair)): s
        for pair, s in zip(*map(np.ndarray.tolist, mesh.creases), strict=True)
    }
    corners = dict(zip(*map(np.ndarray.tolist, mesh.corners), strict=True))
    cage = oracles_creases.Cage(mesh.points.tolist(), faces, creases=creases, corners=corners)
    oracle = oracles_creases.TaggedSurface(cage)
    surface = ls.LimitSurface(mesh)
    for face in (0, MANY - 1):
        for u, v in ((0.25, 0.5), (0.0, 0.125)):
            wanted = np.array(oracle.evaluate(face, u, v), dtype=float)
            assert np.abs(surface.evaluate(face, u, v) - wanted).max() < 1e-14


@pytest.mark.parametrize("kind", KINDS)
def test_against_eigenbases(kind, monkeypatch):
    mesh = around(kind, 12)
    face, u, v = places(12)
    shallow = (np.maximum(u, v) > 1e-6) | (u + v == 0)
    face, u, v = face[shallow], u[shallow], v[shallow]
    answers = []
    for most in (tables.MOST_FACES, 8):
        for module in (tables, tables.masks):
            monkeypatch.setattr(module, "MOST_FACES", most)
        surface = ls.LimitSurface(mesh)
        assert bool(surface.patches.rings) == (most == 8)
        curvature = surface.curvature(face, u, v)
        found = [surface.normal(face, u, v), *surface.tangents(face, u, v)]
        found += [curvature.k1[:, None], curvature.k2[:, None]]
        found += [surface.evaluate(face, u, v, nu=nu) for nu in ORDERS]
        fine = ls.refined(mesh)
        answers.append([*found, fine.limit_points[:1], fine.limit_normals[:48]])
    for wanted, found in zip(*answers, strict=True):
        assert relative(found, wanted) < 1e-11


@pytest.mark.parametrize("kind", KINDS)
def test_far_down(kind):
    faces = 100
    mesh = around(kind, faces)
    surface = ls.LimitSurface(mesh)
    face = np.array([0, 3, faces // 2, faces - 1])[:, None]
    down = 0.5 ** np.array([30, 200, 500, 900, 1070])
    normal = surface.normal(face, 0.75 * down, 0.5 * down)
    assert np.allclose(np.linalg.norm(normal, axis=-1), 1, atol=1e-14)
    # neighbouring levels: the normal turns by no more than the ratio of two eigenvalues lets it
    after = surface.normal(face, 0.375 * down, 0.25 * down)
    assert (np.abs(normal - after) < 0.05).all()
    # wherever a query begins, and whatever else is asked for
    again = [surface.normal(int(face[1, 0]), 0.75 * x, 0.5 * x) for x in down]
    assert np.allclose(again, normal[1], atol=1e-13, rtol=0)
    limit = surface.evaluate(0, 0, 0)
    assert np.allclose(surface.evaluate(face[:2], down[1:], down[1:]), limit, atol=1e-15)


def test_outer_points_are_forgotten_only_where_rings_are_larger(monkeypatch):
    mesh = around("interior", MANY)
    query = 0, 2.0**-60, 0.75 * 2.0**-60
    near = ls.LimitSurface(mesh)
    found = [near.evaluate(*query, nu=nu) for nu in ORDERS[:6]]
    monkeypatch.setattr(rings, "_WINDOW", 1 << 20)
    whole = ls.LimitSurface(mesh)
    for nu, x in zip(ORDERS, found, strict=False):
        assert np.allclose(whole.evaluate(*query, nu=nu), x, rtol=1e-13, atol=0)
    monkeypatch.undo()
    # a ring of coinciding points: what there is comes from the outer points alone
    points = mesh.points.copy()
    points[: 1 + 2 * MANY] = points[0]
    flat = ls.LimitSurface(mesh.with_points(points))
    exact = ls.LimitSurface(mesh.with_points(RATIONAL.array(points)))
    for nu in ((1, 0), (2, 0)):
        wanted = exact.evaluate(*query, nu=nu).astype(float)
        assert wanted.any()
        assert np.allclose(flat.evaluate(*query, nu=nu), wanted, rtol=1e-12, atol=0)


def polygon(n, height=0.0):
    angle = 2 * np.pi * np.arange(n) / n
    points = np.stack([np.cos(angle), np.sin(angle), height * np.cos(3 * angle)], axis=1)
    return ls.Mesh(points, (np.array([n]), np.arange(n)))


def test_polygon_of_many_corners():
    n = 800
    surface = ls.LimitSurface(polygon(n))
    face = np.arange(n)
    u, v = np.array([1.0, 0.75, 1 - 1e-9, 0.0]), np.array([1.0, 0.875, 1 - 1e-9, 0.5])
    points = surface.evaluate(face[:, None], u, v)
    assert not points[..., 2].any()
    # turned by a corner
    c, s = np.cos(2 * np.pi / n), np.sin(2 * np.pi / n)
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    assert np.allclose(points[:-1] @ turn, points[1:], atol=1e-14, rtol=0)
    assert np.abs(points[:, 0]).max() < 1e-15
    assert np.allclose(surface.normal(face[:, None], u, v), [0, 0, 1], atol=1e-12)
    # moved by an affine map
    bent = ls.LimitSurface(polygon(n, 0.2))
    A = np.array([[2, 1, 0], [0, 1, -3], [0.5, 0, 1]])
    moved = bent.with_points(bent.points @ A + 7)
    found, wanted = moved.evaluate(face, 0.6, 0.9), bent.evaluate(face, 0.6, 0.9) @ A + 7
    assert np.allclose(found, wanted, atol=2e-14, rtol=0)
    fine = ls.tessellate(bent, 1)
    assert np.isfinite(fine.points).all()


def numbers(surface):
    """How many numbers the patches and what is evaluated with them take."""
    patches, values = surface.patches, surface._answers.reference.values
    count = sum(x.size for x in patches.controls) + sum(x.nnz for x in patches.extras)
    count += sum(x.points.size + x.ring.size for x in patches.rings.values())
    for found in values._rings.values():
        parts = [found._first, *found._kept.steps.values()]
        count += sum(x.edges.size + x.faces.size for x in parts)
    return count


@pytest.mark.parametrize("kind", [*KINDS, "polygon"])
def test_memory_is_linear(kind):
    made = polygon if kind == "polygon" else lambda n: around(kind, n)
    counts = []
    for n in (250, 500):
        surface = ls.LimitSurface(made(n))
        surface.normal(np.arange(n), 0.75, 0.75)
        counts.append(numbers(surface))
    assert counts[1] < 2.1 * counts[0]


def test_memory_of_kernels_is_linear():
    sizes = []
    for n in (500, 1000):
        surface = ls.LimitSurface(polygon(n, 0.2), engine="compiled")
        surface.evaluate(np.arange(n), 0.75, 0.75)
        sizes.append(sum(x.nbytes for x in surface._answers.compiled._points))
    assert sizes[1] < 2.1 * sizes[0]
    assert sizes[1] < 6500 * n


@pytest.mark.parametrize("kind", ["interior", "dart"])
def test_kernels_isolate_as_far_as_queries_ask(kind):
    mesh, t = around(kind, MANY), 0.75 * 0.5 ** np.arange(14.0)
    t[-1] = 0
    whole, other = (ls.LimitSurface(mesh, engine="compiled") for _ in range(2))
    wanted = whole.jet(0, t, t, order=2)
    for k, x in [*enumerate(t)][::-1]:  # from the corner on
        found = other.jet([0], x, x, order=2)
        for nu, rows in wanted.items():
            assert np.array_equal(found[nu][0], rows[k], equal_nan=True)
    again = other.with_points(mesh.points)
    isolated, near = again._answers.compiled._isolated, MANY + 1
    ready = []
    for face, x in ((near, 0.5), (0, 0.75), (0, 0.15), (0, 0.4), (0, 1e-9)):
        found = again.evaluate(face, x, x)
        assert np.array_equal(found, whole.evaluate(face, x, x))
        ready.append(isolated._kinds[:, evaluation.READY].max())
    assert ready == [0, 0, 2, 2, 2]  # far below what is kept NumPy answers, as before


def triangles(kind, faces):
    """Faces 0 to `faces` - 1 in turn around vertex 0, and a ring of triangles around these."""
    points, indices = zoo_triangles.rings(faces, open_at=kind in ("crease", "corner"))
    points = points + np.random.default_rng(faces).normal(size=points.shape) / faces / 8
    points[:, 2] += np.cos(5 * np.arctan2(points[:, 1], points[:, 0])) / 4
    tags = {}
    if kind in ("cone", "corner"):
        tags["corners"] = {0: np.inf}
    if kind == "dart":
        tags["creases"] = dict.fromkeys([(0, 1), (1, 1 + faces)], np.inf)
    return ls.Mesh(points, np.array(indices), **tags)


def corner_places(faces):
    """`places` that are in triangles."""
    face, u, v = places(faces)
    inside = u + v <= 1
    return face[inside], u[inside], v[inside]


@pytest.mark.parametrize("kind", KINDS)
def test_triangles_against_rational_numbers(kind):
    """All masks of Warren's are rational."""
    mesh = triangles(kind, MANY)
    face, u, v = (x[::2] for x in corner_places(MANY))
    surface = ls.LimitSurface(mesh, scheme="loop-warren")
    assert surface.patches.rings
    exact = ls.LimitSurface(mesh.with_points(RATIONAL.array(mesh.points)), scheme="loop-warren")
    for nu in ORDERS:
        wanted = exact.evaluate(face, u, v, nu=nu).astype(float)
        assert relative(surface.evaluate(face, u, v, nu=nu), wanted) < 1e-12
        assert relative(surface.weights(face, u, v, nu=nu) @ mesh.points, wanted) < 1e-12


@pytest.mark.parametrize("kind", KINDS)
def test_triangles_against_the_oracle(kind):
    mesh = triangles(kind, MANY)
    creases = {
        tuple(sorted(pair)): s
        for pair, s in zip(*map(np.ndarray.tolist, mesh.creases), strict=True)
    }
    corners = dict(zip(*map(np.ndarray.tolist, mesh.corners), strict=True))
    faces = mesh.uniform.tolist()
    cage = oracles_creases.Cage(mesh.points.tolist(), faces, creases=creases, corners=corners)
    oracle = oracles_loop.LoopSurface(cage)
    surface = ls.LimitSurface(mesh, scheme="loop")
    for face in (0, MANY - 1):
        for u, v in ((0.3, 0.25), (0.01, 0), (0, 2e-4), (0.001, 0.002)):
            for nu in ((0, 0), (1, 0), (0, 1), (1, 1)):
                wanted = np.array([oracle.evaluate(face, u, v, nu)], dtype=float)
                assert relative(surface.evaluate([face], u, v, nu=nu), wanted) < 1e-12
            normal = np.array(oracle.normal(face, u, v), dtype=float)
            assert np.allclose(surface.normal(face, u, v), normal, atol=1e-12, rtol=0)


@pytest.mark.parametrize("kind", KINDS)
def test_triangles_against_eigenbases(kind, monkeypatch):
    mesh = triangles(kind, 12)
    face, u, v = corner_places(12)
    shallow = (np.maximum(u, v) > 1e-6) | (u + v == 0)
    face, u, v = face[shallow], u[shallow], v[shallow]
    answers = []
    for most in (tables.MOST_FACES, 8):
        for module in (tables, tables.masks):
            monkeypatch.setattr(module, "MOST_FACES", most)
        surface = ls.LimitSurface(mesh, scheme="loop")
        assert bool(surface.patches.rings) == (most == 8)
        curvature = surface.curvature(face, u, v)
        found = [surface.normal(face, u, v), *surface.tangents(face, u, v)]
        found += [curvature.k1[:, None], curvature.k2[:, None]]
        jet = [surface.evaluate(face, u, v, nu=nu) for nu in ORDERS]
        pieces = ls.bezier_patches(surface, face=[0, 11], depth=3).points.reshape(-1, 3)
        fine = ls.refined(mesh, scheme="loop")
        answers.append([*found, fine.limit_points[:1], fine.limit_normals[:36], pieces, *jet])
    for wanted, found in zip(*(x[: -len(ORDERS)] for x in answers), strict=True):
        assert relative(found, wanted) < 1e-11
    for wanted, found in zip(*(x[-len(ORDERS) :] for x in answers), strict=True):
        assert np.array_equal(np.isnan(found), np.isnan(wanted))
        # beside a sharp side next to nothing can be left of what is large on the same ring
        size = np.abs(np.nan_to_num(wanted)).max(axis=1).reshape(4, -1)
        size = np.maximum(size, 1e-3 * size.max(axis=0)).ravel()
        assert (np.abs(np.nan_to_num(found - wanted)).max(axis=1) <= 1e-12 * size).all()


@pytest.mark.parametrize("kind", KINDS)
def test_triangles_far_down(kind):
    faces = 100
    surface = ls.LimitSurface(triangles(kind, faces), scheme="loop")
    face = np.array([0, 3, faces // 2, faces - 1])[:, None]
    down = 0.5 ** np.array([30, 200, 500, 900, 1070])
    normal = surface.normal(face, 0.75 * down, 0.25 * down)
    assert np.allclose(np.linalg.norm(normal, axis=-1), 1, atol=1e-14)
    after = surface.normal(face, 0.375 * down, 0.125 * down)
    assert (np.abs(normal - after) < 0.05).all()
    # along sharp sides, whose points fall faster than those of the faces
    ends = surface.tangents(face[[0, 3]], 0.75 * down, 0.0), surface.tangents(face[3], 0, down)
    if kind in ("crease", "corner"):
        along = ends[0][0][0], ends[1][1]
        for tangent in along:
            assert np.allclose(tangent, tangent[:1], atol=1e-8)


@pytest.mark.parametrize("kind", KINDS)
def test_memory_of_triangles_is_linear(kind):
    counts = []
    for n in (250, 500):
        surface = ls.LimitSurface(triangles(kind, n), scheme="loop-warren")
        surface.normal(np.arange(n), 0.25, 0.5)
        counts.append(numbers(surface))
    assert counts[1] < 2.1 * counts[0]


def test_limits_of_refined_meshes():
    for kind in KINDS:
        mesh = around(kind, MANY)
        surface, fine = ls.LimitSurface(mesh), ls.refined(mesh)
        assert np.allclose(fine.limit_points[0], surface.evaluate(0, 0, 0), atol=1e-15, rtol=0)
        # the first corner of child 0 of face 0
        normal = surface.normal(0, 0, 0)
        assert np.allclose(fine.limit_normals[0], normal, atol=1e-13, equal_nan=True)
        assert np.isnan(normal).all() == (kind not in ("interior", "dart"))


def test_rows_of_mixed_cages(use):
    mesh = around("interior", MANY)
    face = np.arange(mesh.n_faces)
    u, v = np.random.default_rng(0).random((2, len(face)))
    u[3] = np.nan
    surface = ls.LimitSurface(mesh)
    wanted = surface.weights(face, u, v, nu=(1, 0))
    use(True)
    found = surface.weights(face, u, v, nu=(1, 0))
    assert found.shape == wanted.shape
    assert np.allclose(found.toarray(), wanted.toarray(), atol=1e-13, equal_nan=True)
    answer = surface.evaluate(face, u, v)
    use(False)
    assert np.allclose(answer, surface.evaluate(face, u, v), atol=1e-14, equal_nan=True)
    with pytest.raises(IndexError, match="out of range"):
        surface.weights(len(face), 0.5, 0.5)


def test_dart_masks_of_many_faces():
    for faces in (MANY, 200):
        exact = tables.limit_mask(tables.SCHEMES["catmull-clark"], "dart", faces, RATIONAL)
        found = tables.limit_mask(tables.SCHEMES["catmull-clark"], "dart", faces, FLOAT64)
        assert np.abs(found - exact.astype(float)).max() < 1e-16


def test_masks_that_do_not_converge_are_refused():
    from fractions import Fraction

    plain = tables.SCHEMES["catmull-clark"]

    def vertex(n):
        return plain.vertex(n) if n < 60 else (Fraction(-2), Fraction(3, n), Fraction(0))

    wild = ls.Scheme("wild", vertex=vertex)
    with pytest.raises(ValueError, match="do not converge"):
        ls.LimitSurface(around("interior", MANY), scheme=wild)
