"""Both engines, who of them answers, and what a warm query calls."""

import os
import pickle
import sys
from fractions import Fraction
from typing import Any

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
    bent = surface.curvature(*query)
    directions = [d[..., None] * d[..., None, :] for d in (bent.d1, bent.d2)]  # whatever the sign
    parts = [*surface.jet(*query).values(), surface.normal(*query), *bent[:2], *bent[4:]]
    return [*parts, *directions, *surface.tangents(*query), surface.weights(*query).toarray()]


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


FUNCTIONS = {
    "bezier_patches": lambda surface, **k: ls.bezier_patches(surface, depth=3, **k).points,
    "validate": lambda surface, **k: ls.validate(surface, 2, **k)["limit_error"],
    "agrees": lambda surface, channel=None, workers=1: ls.agrees(
        surface, ls.validate(surface, 1, channel=channel), channel=channel
    ),
    "refinement_gap": lambda surface, **k: ls.refinement_gap(surface, *queries(surface), **k),
    "plot_convergence": lambda surface, **k: (
        ls.plot_convergence(surface, levels=2, off_screen=True, window_size=(160, 120), **k).image
    ),
    "plot": lambda surface, **k: (
        ls.plot(
            surface, n=3, isolines=1, normals=True, off_screen=True, window_size=(160, 120), **k
        ).image
    ),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_channels_and_workers_in_every_function(name):
    rng, mesh = np.random.default_rng(0), mesh_of("carved_cube_1")
    uv = rng.random((80, 2)), rng.integers(80, size=mesh.n_corners), "corners_plus1"
    tagged = {x: getattr(mesh, x) for x in ("creases", "corners", "holes")}
    faces = mesh.sizes, mesh.indices
    surface = ls.LimitSurface(ls.Mesh(mesh.points, faces, **tagged, channels={"uv": uv}))
    function = FUNCTIONS[name]
    for options, asked in (({}, surface), ({"channel": "uv"}, surface.of_channel("uv"))):
        # (a picture of texture coordinates shows more than a surface of them)
        wanted = np.asarray(function(surface, **options) if name == "plot" else function(asked))
        for workers in (2, -1):
            assert np.array_equal(function(surface, **options, workers=workers), wanted)
    with pytest.raises(ValueError, match="no channel 'd'"):
        function(surface, channel="d")
    if name != "agrees":
        with pytest.raises(ValueError, match="workers must be a positive integer"):
            function(surface, workers=0)


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
    most = (10, 10) if engine == "compiled" else (40, 20)
    assert len(special) <= most[0], special
    assert len(regular) <= most[1], regular
    assert not {"exact", "scheme"} & {*special, *regular}


# --- Single queries, and arrays for results


def answered(function, *arguments, **options):
    """Bytes of what a function returns, or its error."""
    try:
        found = function(*arguments, **options)
    except Exception as error:
        return type(error), str(error)
    parts = found.values() if isinstance(found, dict) else [found]
    return [(x.shape, np.asarray(x).tobytes()) for x in parts]


@pytest.mark.parametrize("engine", ["reference", "compiled"])
@pytest.mark.parametrize("name", ["cube", "carved_cube_1", "tetrahedron"])
def test_a_place_in_plain_numbers_is_one_in_arrays(name, engine):
    """The same digits, types, holes, NaN and errors."""
    surface = ls.LimitSurface(mesh_of(name), engine=engine)
    n = len(surface.limit_faces)
    faces = [
        0,
        n - 1,
        np.int64(2),
        n,
        -1,
        np.int64(-7),
        2**62,
        2**70,
        10**400,
        True,
        1.0,
        np.int8(1),
    ]
    reals = [0.3, np.float64(1.0), 0.0, 1e-300, float("nan"), -np.inf, 1.5, 1, np.float32(0.1)]
    places = [(f, u, v) for f in faces for u, v in ((0.3, 0.4),)]
    places += [(f, u, v) for f in (0, n - 1) for u in reals for v in (0.4, 0.0, 1.0)]
    with np.errstate(invalid="ignore"):
        for place in places:
            arrays = [np.asarray(x) for x in place]
            for ask in (surface.evaluate, surface.jet, surface.normal):
                assert answered(ask, *place) == answered(ask, *arrays), (place, ask)
            assert answered(surface.evaluate, *place, nu=(3, 0)) == answered(
                surface.evaluate, *arrays, nu=(3, 0)
            )
    for workers in (0, True, 1.0, 2):
        assert answered(surface.evaluate, 0, 0.3, 0.4, workers=workers) == answered(
            surface.evaluate, np.asarray(0), 0.3, 0.4, workers=workers
        )


LAYOUTS = {
    "contiguous": lambda shape: np.empty(shape),
    "part": lambda shape: np.empty((*shape[:-1], shape[-1] + 2))[..., 1:-1],
    "backwards": lambda shape: np.empty(shape)[::-1],
    "columns": lambda shape: np.empty(shape[::-1]).T,
    "unaligned": lambda shape: (
        np.empty(8 * np.prod(shape) + 1, np.uint8)[1:].view(float).reshape(shape)
    ),
}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("engine", ["reference", "compiled"])
def test_results_are_written_where_they_are_wanted(engine, layout, monkeypatch):
    """Whatever the layout; the same digits, in chunks and threads, on grids, for channels."""
    monkeypatch.setattr("limitsurf.engine.packing.CHUNK", 64)
    mesh = mesh_of("carved_cube_1")
    uv = np.random.default_rng(0).random((80, 2)), np.arange(mesh.n_corners) % 80, "all"
    surface = ls.LimitSurface(ls.Mesh(mesh.points, mesh.faces, channels={"uv": uv}), engine=engine)
    face, u, v = queries(surface, 200)
    u[3] = np.nan
    grid = np.arange(len(surface.limit_faces))[:, None], u[5:10], v[5:10]
    make = LAYOUTS[layout]
    for query in ((face, u, v), (face[::2], 0.5, v[::2]), grid, (3, 0.3, 0.4)):
        for workers in (1, 2):
            for ask, options in [
                (surface.evaluate, {"nu": (0, 1)}),
                (surface.evaluate, {"nu": (3, 1)}),
                (surface.evaluate, {"channel": "uv"}),
                (surface.normal, {}),
            ]:
                wanted = ask(*query, **options, workers=workers)
                out = make(wanted.shape)
                assert ask(*query, **options, workers=workers, out=out) is out
                assert out.tobytes() == wanted.tobytes()
            wanted = surface.jet(*query)
            several = {nu: make(x.shape) for nu, x in reversed(wanted.items())}
            assert surface.jet(*query, workers=workers, out=several) is several
            assert all(several[nu].tobytes() == x.tobytes() for nu, x in wanted.items())
            # what an earlier answer was is taken again
            again = surface.jet(*(np.zeros_like(x) for x in np.broadcast_arrays(*query)))
            assert surface.jet(*query, workers=workers, out=again) is again
            assert all(np.array_equal(again[nu], x, True) for nu, x in wanted.items())


@pytest.mark.parametrize("engine", ["reference", "compiled"])
def test_results_may_take_the_place_of_what_was_asked(engine, monkeypatch):
    monkeypatch.setattr("limitsurf.engine.packing.CHUNK", 16)
    points, faces = zoo.cube()
    mesh = ls.Mesh(np.asarray(points, float)[:, 0], faces)
    surface = ls.LimitSurface(mesh, engine=engine)
    face, u, v = queries(surface, 100)
    wanted = surface.evaluate(face, u, v)
    room = np.concatenate([v, u])
    # every result is written to where a later u is read
    found = surface.evaluate(face, room[100:], v, out=room[90:190])
    assert np.array_equal(found, wanted)


def test_bad_places_for_results():
    mesh = mesh_of("cube")
    surface = ls.LimitSurface(mesh)
    fixed, half = np.empty((2, 3)), Fraction(1, 2)
    fixed.flags.writeable = False
    query: Any = ([0, 1], 0.5, 0.5)
    place: Any
    for place, error, what in [
        (
            np.empty((3, 3)),
            ValueError,
            r"out must have the shape of the result, \(2, 3\), got \(3, 3\)",
        ),
        (np.empty((2, 3), np.float32), TypeError, "out must be an array of float64, got float32"),
        (np.empty((2, 3), ">f8"), TypeError, "out must be an array of float64, got >f8"),
        ([[0.0] * 3] * 2, TypeError, "out must be an array of float64, got list"),
        (np.ma.zeros((2, 3)), TypeError, "got MaskedArray"),
        (fixed, ValueError, "out is read-only"),
    ]:
        for ask in (surface.evaluate, surface.normal):
            with pytest.raises(error, match=what):
                ask(*query, out=place)
    with pytest.raises(TypeError, match="takes results in float64, and exact numbers have none"):
        surface.evaluate([0, 1], half, half, out=np.empty((2, 3)))
    made = surface.jet(*query, order=1)
    for place, error, what in [
        (np.empty((3, 2, 3)), TypeError, "out must be a dict of arrays"),
        ({(0, 0): made[0, 0]}, ValueError, r"out has no array for the derivative \(1, 0\)"),
        ({**made, (2, 0): made[0, 0]}, ValueError, r"out has an array for \(2, 0\)"),
        ({**made, (0, 1): fixed}, ValueError, r"out\[\(0, 1\)\] is read-only"),
    ]:
        with pytest.raises(error, match=what):
            surface.jet(*query, order=1, out=place)
    large = np.empty((4, 3))
    parts = {(0, 0): large[:2], (1, 0): large[1:3], (0, 1): np.empty((2, 3))}
    with pytest.raises(ValueError, match=r"out\[\(0, 0\)\] and out\[\(1, 0\)\] share memory"):
        surface.jet(*query, order=1, out=parts)
    same = np.lib.stride_tricks.as_strided(np.empty(3), (2, 3), (0, 8))
    with pytest.raises(ValueError, match="out has the same numbers in several places"):
        surface.evaluate(*query, out=same)
    # one beside the other, and one between the others
    beside = np.empty((2, 9))
    out = {nu: beside[:, 3 * k : 3 * k + 3] for k, nu in enumerate(made)}
    assert surface.jet(*query, order=1, out=out) is out
    assert all(np.array_equal(out[nu], x) for nu, x in surface.jet(*query, order=1).items())
    with pytest.raises(IndexError, match="limit face 9 at index 1 is out of range"):
        surface.evaluate([0, 9], 0.5, 0.5, out=np.empty((2, 3)))


def test_blocks_keep_their_arrays_and_are_made_again_elsewhere():
    numba = pytest.importorskip("numba")
    from limitsurf._kernels.blocks import Block

    line, square = numba.float64[::1], numba.float64[:, ::1]
    array = np.arange(6.0).reshape(2, 3)
    kept = sys.getrefcount(array)
    block = Block([(numba.int64, square), (line,)], (5, array), (array[0],))
    assert sys.getrefcount(array) > kept
    assert block.words.reshape(-1, 5)[1].tolist() == [array.ctypes.data, 2, 3, 0, 0]
    again = pickle.loads(pickle.dumps(block))
    assert again.words[5] != block.words[5]
    assert again.words.reshape(-1, 5)[:, 1:].tolist() == block.words.reshape(-1, 5)[:, 1:].tolist()
    for wrong in (array.T, array.astype(np.float32), array[0]):
        with pytest.raises(TypeError, match="field 0 of a block must be a contiguous array"):
            Block([(square,)], (wrong,))
    with pytest.raises(TypeError):
        Block([(numba.int64,)], (2.5,))


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
