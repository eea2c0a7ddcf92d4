"""Both engines, who of them answers, and what a warm query calls."""

import os
import pickle
import sys
from fractions import Fraction

import numpy as np
import pytest
import zoo
import zoo_triangles

import limitsurf as ls
from limitsurf.engine.choice import VARIABLE
from limitsurf.engine.places import Places
from limitsurf.patches import STRIP
from limitsurf.scheme.catmull_clark import CATMULL_CLARK
from limitsurf.scheme.loop import LOOP

HOME = os.path.dirname(ls.__file__)
ORDERS = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]
CAGES = ["cube", "prism_7", "sphere_8", "carved_cube_1", "crossing_rings_2.5", "local_cage_33"]


def mesh_of(name):
    points, faces, tags = (*zoo.ZOO[name](), {}) if name in zoo.ZOO else zoo.TAGGED[name]()
    return ls.Mesh(np.asarray(zoo.random_points(len(points), name), dtype=float), faces, **tags)


def queries(surface, n=40, seed=0):
    rng = np.random.default_rng(seed)
    u, v = rng.random((2, n))
    u[:10], v[5:15] = u[:10] * 1e-6, v[5:15] * 1e-3
    return rng.integers(len(surface.limit_faces), size=n), u, v


def all_answers(surface, *query):
    parts = [*surface.jet(*query).values(), surface.normal(*query), *surface.curvature(*query)]
    return [*parts, *surface.tangents(*query), surface.weights(*query).toarray()]


@pytest.mark.parametrize("name", CAGES)
def test_both_give_the_same_to_rounding(name):
    mesh = mesh_of(name)
    reference, compiled = (ls.LimitSurface(mesh, engine=x) for x in ("reference", "compiled"))
    query = queries(reference)
    for found, wanted in zip(
        all_answers(compiled, *query), all_answers(reference, *query), strict=True
    ):
        # far from flat, and at 1e-6 from vertices second derivatives are large
        scale = np.abs(wanted).max(axis=tuple(range(1, wanted.ndim)), keepdims=True)
        assert (np.isnan(found) == np.isnan(wanted)).all()
        assert (np.nan_to_num(np.abs(found - wanted)) <= 1e-9 * np.nan_to_num(scale) + 1e-13).all()


@pytest.mark.parametrize("engine", ["reference", "compiled"])
def test_a_fixed_engine_gives_the_same_digits_every_time(engine, use):
    surface = ls.LimitSurface(mesh_of("carved_cube_1"), engine=engine)
    query = queries(surface)
    together, normals, rows = (
        f(*query) for f in (surface.evaluate, surface.normal, surface.weights)
    )
    alone = [surface.evaluate(*(x[k] for x in query)) for k in range(len(together))]
    assert np.allclose(together, alone, rtol=0, atol=2e-15)
    if engine == "compiled":  # also whatever else is in the call
        assert np.array_equal(together, alone)
    # whatever else was compiled, or is
    for kernels in (True, False):
        use(kernels)
        other = ls.LimitSurface(mesh_of("carved_cube_1"), engine=engine)
        for found in (surface, surface.with_points(surface.points), other):
            assert found.evaluate(*query).tobytes() == together.tobytes()
            assert found.normal(*query).tobytes() == normals.tobytes()
            assert (found.weights(*query) != rows).nnz == 0


def test_which_engine_answers(monkeypatch):
    mesh = mesh_of("cube")
    monkeypatch.delenv(VARIABLE, raising=False)
    assert ls.LimitSurface(mesh).engine == "auto"
    monkeypatch.setenv(VARIABLE, "compiled")
    surface = ls.LimitSurface(mesh)
    assert surface.engine == "compiled"
    assert ls.LimitSurface(mesh, engine="reference").engine == "reference"
    # points and processes keep it, exact numbers have but one
    assert surface.with_points(2 * surface.points).engine == "compiled"
    monkeypatch.setenv(VARIABLE, "reference")
    assert pickle.loads(pickle.dumps(surface)).engine == "compiled"
    assert surface.evaluate(0, Fraction(1, 3), 0).dtype == object
    with pytest.raises(ValueError, match="engine must be one of 'auto', 'reference', 'compiled'"):
        ls.LimitSurface(mesh, engine="fast")
    monkeypatch.setenv(VARIABLE, "fast")
    with pytest.raises(ValueError, match=r"variable LIMITSURF_ENGINE must be one of .* got 'fast'"):
        ls.LimitSurface(mesh)


def test_channels_in_every_query():
    points, faces = zoo.cube()
    rng = np.random.default_rng(0)
    values, corners = rng.random((30, 3)), rng.integers(30, size=24)
    mesh = ls.Mesh(np.asarray(points, float), faces, channels={"c": (values, corners, "all")})
    surface = ls.LimitSurface(mesh)
    own, query = surface.of_channel("c"), queries(surface)
    for name in ("evaluate", "jet", "tangents", "normal", "curvature"):
        found, wanted = (getattr(s, name)(*query, **k) for s, k in
                         ((surface, {"channel": "c", "workers": 2}), (own, {})))  # fmt: skip
        if isinstance(found, dict):
            found, wanted = tuple(found.values()), tuple(wanted.values())
        assert np.array_equal(np.ravel(found[0]), np.ravel(wanted[0]), equal_nan=True), name
    W = surface.weights(*query, channel="c", workers=2)
    assert W.shape == (40, 30)
    assert np.allclose(W @ values, surface.evaluate(*query, channel="c"), atol=1e-14, rtol=0)
    exact = surface.weights(0, Fraction(1, 3), Fraction(1, 5), channel="c")
    assert np.allclose(
        (exact @ values)[0].astype(float), own.evaluate(0, 1 / 3, 0.2), atol=1e-14, rtol=0
    )
    with pytest.raises(ValueError, match="no channel 'd'"):
        surface.normal(0, 0.5, 0.5, channel="d")


def test_surfaces_of_other_points_share_all_but_these():
    surface = ls.LimitSurface(mesh_of("prism_7"))
    other = surface.with_points(surface.points + 1)
    assert other._topology is surface._topology
    assert other.patches is surface.patches
    assert other._answers is not surface._answers
    assert surface._topology.mesh.points.shape[1] == 0


def walked(surface, face):
    """Files of ours whose functions a warm query calls, one for each call."""
    for _ in range(3):
        surface.evaluate(face, 0.3, 0.4)
    calls = []

    def see(frame, event, arg):
        if event == "call" and frame.f_code.co_filename.startswith(HOME):
            calls.append(os.path.relpath(frame.f_code.co_filename, HOME).split(os.sep)[0])

    before = sys.getprofile()
    sys.setprofile(see)
    surface.evaluate(face, 0.3, 0.4)
    sys.setprofile(before)
    return calls


@pytest.mark.parametrize("engine", ["auto", "reference", "compiled"])
def test_how_many_functions_a_warm_query_calls(engine):
    """None that derives, and few in all."""
    grid = ls.Mesh(*zoo.grid(3, 3))
    special = walked(ls.LimitSurface(mesh_of("cube"), engine=engine), 0)
    regular = walked(ls.LimitSurface(grid, engine=engine), 4)
    assert len(special) <= 40, special
    assert len(regular) <= 20, regular
    assert not {"exact", "scheme"} & {*special, *regular}


# --- Places


PLACES = {
    CATMULL_CLARK: [(1, 0.25), (0.75, 0.75), (0.5, 1), (0.625, 0), (0.3, 0.2), (0, 0.0625)],
    LOOP: [(1, 0), (0.75, 0.25), (0.5, 0.5), (0.625, 0), (0.3, 0.2), (0, 0.0625)],
}


def surface_of(name):
    """Of quads, or of triangles where that is what the name is of."""
    if name in zoo.ZOO:
        return ls.LimitSurface(mesh_of(name))
    points, faces = zoo_triangles.ZOO[name]()
    return ls.LimitSurface(ls.Mesh(np.asarray(points, dtype=float), faces), scheme=LOOP)


def whole_patches(surface):
    """Patches that are limit faces as they are: which, and these."""
    patches = surface.patches
    face = np.flatnonzero(patches.codes[: len(surface.limit_faces)] >= 0)
    patch = patches.codes[face]
    return patch[patches.turn[patch] == 0], face[patches.turn[patch] == 0]


def at_rings(surface, patch, face, ring):
    """Places and the same as queries."""
    places = np.array(PLACES[surface.rules["scheme"]])
    s, t = np.tile(places, (len(patch), 1)).T
    patch, face = np.repeat(patch, len(places)), np.repeat(face, len(places))
    ring = np.full(len(patch), ring)
    return Places(patch, ring, s, t), (face, np.ldexp(s, -ring), np.ldexp(t, -ring))


@pytest.mark.parametrize(
    "name", ["cube", "grid_3x3", "local_cage_5", "local_cage_33", "disk_7", "disc_5", "torus_3x4"]
)
def test_places_are_queries(name):
    surface = surface_of(name)
    patch, face = whole_patches(surface)
    special = surface.patches.kind[patch] > STRIP
    reference = surface._answers.reference
    for ring in (0, 3, 20):
        some = special | (ring == 0)
        places, query = at_rings(surface, patch[some], face[some], ring)
        found = reference.place_jets(places, ORDERS)
        for nu, value in found.derivatives.items():
            value = value * found.rate[:, None] ** ring
            if nu == (0, 0):
                value = found.origin + value
            wanted = np.ldexp(surface.evaluate(*query, nu=nu), -ring * sum(nu))
            assert np.abs(value - wanted).max(initial=0) < 2e-14
    if not special.all():
        with pytest.raises(ValueError, match="have rings"):
            reference.place_jets(at_rings(surface, patch, face, 1)[0], ORDERS)
    if special.any():  # where u and v would be 0
        deep, _ = at_rings(surface, patch[special], face[special], 10**6)
        far = reference.place_jets(deep, ORDERS)
        assert all(np.isfinite(x).all() and np.abs(x).max() > 0 for x in far.derivatives.values())


@pytest.mark.parametrize(
    ("name", "faces"), [("local_cage_3", 3), ("local_cage_5", 5), ("disc_4", 4), ("disc_8", 8)]
)
def test_characteristic_coordinates(name, faces):
    surface = surface_of(name)
    patches, reference = surface.patches, surface._answers.reference
    patch, face = whole_patches(surface)
    inner = [sector is not None and sector.kind == "interior" for sector in patches.sectors]
    special = np.flatnonzero(np.array(inner)[patches.kind[patch]])[:1]
    patch, face = patch[special], face[special]
    ids = patches.controls[patches.kind[patch[0]]][patches.row[patch[0]]]
    basis = ls.eigenbasis(surface.rules["scheme"], faces).float64
    plane = np.zeros_like(surface.points)[:, :2]
    plane[ids] = basis.V[:, basis.normal]
    chart = surface.with_points(plane)
    (lam, other, mu) = reference.corner_rates(patch)
    assert np.allclose([lam, other, mu], np.abs(basis.rates[0, 1:4])[:, None])
    for ring in (0, 2, 9):
        places, query = at_rings(surface, patch, face, ring)
        found = reference.characteristic_jets(places)
        a, b, m = found.rates
        f = {nu: np.ldexp(chart.evaluate(*query, nu=nu), -ring * sum(nu)) for nu in ORDERS}
        assert np.allclose(found.coordinates * [a**ring, b**ring], f[0, 0].T, atol=1e-15, rtol=0)
        first = found.tangents + found.first * np.stack([m / a, m / b])[..., None] ** ring
        second = found.second * (m / np.stack([a * a, a * b, b * b]))[..., None] ** ring
        for (i, j), axes in {(1, 0): [0], (0, 1): [1], (2, 0): [0, 0], (1, 1): [0, 1],
                             (0, 2): [1, 1]}.items():  # fmt: skip
            value = (f[i, j].T[..., None] * first).sum(axis=0)
            if i + j == 2:
                x, y = (f[[(1, 0), (0, 1)][k]] for k in axes)
                factors = (
                    x[:, 0] * y[:, 0],
                    x[:, 0] * y[:, 1] + x[:, 1] * y[:, 0],
                    x[:, 1] * y[:, 1],
                )
                value = value + (np.stack(factors)[..., None] * second).sum(axis=0)
            wanted = np.ldexp(surface.evaluate(*query, nu=(i, j)), -ring * (i + j))
            scale = np.abs(wanted).max()
            assert np.abs(value - wanted).max() < 1e-12 * scale, (ring, i, j)
    # at the corner itself d/dx and d/dy are the tangents, whatever the direction
    deep = reference.characteristic_jets(at_rings(surface, patch, face, 10**4)[0])
    assert np.isfinite(deep.first).all()
    assert np.ptp(deep.tangents, axis=1).max() == 0
