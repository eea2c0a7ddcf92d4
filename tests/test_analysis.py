"""Which special corners have limits and normals, of any masks, against naive refinement in floats.

The oracle builds the cage around a vertex and refines it face by face, in float64, knowing nothing
of spectra; the normals of the faces are those of the limit, or flip, or depend on the direction.
"""

import dataclasses
import random
import warnings
from fractions import Fraction as F

import numpy as np
import pytest

import limitsurf as ls
from limitsurf import tables
from limitsurf.exact.analysis import check_convergence, orientation
from limitsurf.exact.fixed import UnsupportedSpectrum
from limitsurf.exact.spectrum import ring_normal
from limitsurf.scheme.lattice import TRIANGLES
from limitsurf.scheme.loop import LOOP
from limitsurf.tables import Sector

CATMULL_CLARK = tables.SCHEMES["catmull-clark"]
REGULAR = F(1, 2), F(1, 16), F(1, 16)


def own(own, neighbours, name="own"):
    """A scheme whose vertices, but for valence 4, have these weights of their own and of the sum of
    their neighbours."""

    def vertex(N):
        return REGULAR if N == 4 else (own, neighbours / N, (1 - own - neighbours) / N)

    return ls.Scheme(
        name,
        face=lambda n: (F(1, n),) * n,
        edge=(F(1, 4),) * 2,
        vertex=vertex,
        boundary_edge=F(1, 2),
        boundary_vertex=(F(3, 4), F(1, 8)),
        paper="none",
    )


def own_loop(own):
    """Loop's scheme, but that vertices, except of valence 6, keep that weight of their own."""

    def vertex(N):
        return (F(5, 8), F(1, 16)) if N == 6 else (own, (1 - own) / N)

    return dataclasses.replace(LOOP, name="own", vertex=vertex)


def wild(a, lattice="quads"):
    return own_loop(F(a)) if lattice == "triangles" else own(F(a), (1 - F(a)) / 2)


def at_random(rng, lattice, least, most):
    """A scheme with a vertex mask between least and most, in hundredths."""
    if lattice == "triangles":
        return own_loop(F(rng.randint(*least), 100))
    return own(F(rng.randint(*least), 100), F(rng.randint(*most), 100))


def fan(kind, n, seed=0, layers=3):
    """A cage around a vertex of n faces, the face of each sector first, and its tags."""
    turn = 2 * np.pi * np.arange(n) / n
    axis = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    number, points, faces = {(0, 0, 0): 0}, [np.zeros(2)], []
    for s in range(n):
        for i in range(1, layers + 1):
            for j in range(layers + 1):
                number[s, i, j] = len(points)
                points.append(i * axis[s] + j * axis[(s + 1) % n])

    def vertex(s, i, j):
        s %= n
        if i == 0:
            return 0 if j == 0 else number[(s + 1) % n, j, 0]
        return number[s, i, j]

    for i in range(layers):
        for j in range(layers):
            for s in range(n):
                faces.append([vertex(s, i + a, j + b) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))])
    height = np.random.default_rng(seed).normal(size=(len(points), 1)) * 0.2
    creases = {}
    if kind == "dart":
        creases = {(vertex(0, i, 0), vertex(0, i + 1, 0)): np.inf for i in range(layers)}
    return ls.Mesh(np.concatenate([points, height], axis=1), faces, creases=creases)


def naive_ring(scheme, kind, n):
    """One step of refinement on v, e_0, f_0 if any, e_1, ..., written down from the masks."""
    if scheme.lattice is TRIANGLES:
        own, edge = map(float, scheme.vertex_mask(n))
        v, *e = np.eye(n + 1)
        A = [(3 * v + 3 * e[j]) / 8 + (e[j - 1] + e[(j + 1) % n]) / 8 for j in range(n)]
        if kind == "dart":
            A[0] = (v + e[0]) / 2
        return np.array([own * v + edge * np.sum(e, axis=0), *A])
    own, edge, face = map(float, scheme.vertex_mask(n))
    A = np.zeros((2 * n + 1, 2 * n + 1))
    points = np.eye(2 * n + 1)
    v, e, f = points[0], points[1::2], points[2::2]
    new = [(v + e[j] + f[j] + e[(j + 1) % n]) / 4 for j in range(n)]
    A[0] = own * v + edge * np.sum(e, axis=0) + face * np.sum(new, axis=0)
    for j in range(n):
        A[1 + 2 * j] = (v + e[j] + new[j - 1] + new[j]) / 4
        A[2 + 2 * j] = new[j]
    if kind == "dart":
        A[1] = (v + e[0]) / 2
    return A


def naive_verdict(scheme, kind, n):
    """Whether refinement converges; None where floats cannot tell."""
    power, growth = naive_ring(scheme, kind, n), 0.0
    for _ in range(11):  # squared each time
        size = np.abs(power).max()
        growth, power = 2 * (growth + np.log(size)), (power / size) @ (power / size)
    if growth / 2048 > 0.02:
        return False
    spread = np.ptp(np.linalg.matrix_power(naive_ring(scheme, kind, n), 2048), axis=0).max()
    return True if spread < 1e-6 else None


def naive_plane(scheme, kind, n, steps=300):
    """Whether areas between neighbours on the ring turn to one side; None where it is unclear."""
    A = naive_ring(scheme, kind, n)
    *_, second, third = np.sort(np.abs(np.linalg.eigvals(A)))[-4:-1][::-1]
    if 1e-9 < second - third < 0.02 * second:
        return None  # slow
    ring = np.random.default_rng(n).normal(size=(len(A), 3))
    before = np.zeros(3)
    for _ in range(steps):
        ring = A @ (ring - ring[0])
        ring = (ring - ring[0]) / np.abs(ring - ring[0]).max()
        flat = np.concatenate([ring[1:], np.zeros((1, 3))])  # two neighbours have no third width
        _, width, height = np.linalg.svd(flat, compute_uv=False)
        if width < 1e-6:
            break
        area = np.cross(ring[1:], np.roll(ring[1:], -1, axis=0))
        area /= np.linalg.norm(area, axis=1)[:, None]
        least = min((area @ area[0]).min(), area[0] @ before) if before.any() else -1
        before = area[0]
        if height < 1e-4 * width and least > 0.999:
            return True
    return False if least < 0 else None


# --- the library against refinement ---------------------------------------------------------------


LATTICES = pytest.mark.parametrize("lattice", ["quads", "triangles"])


@pytest.mark.parametrize("kind", ["interior", "dart"])
@LATTICES
@pytest.mark.parametrize("seed", range(2))
def test_convergence_is_that_of_naive_refinement(kind, lattice, seed):
    rng = random.Random(f"{kind} {seed}")
    seen = set()
    for _ in range(25):
        n = rng.choice([2, 3, 5, 6, 7, 9, 13, 66, 70])
        scheme = at_random(rng, lattice, (-250, 250), (-400, 400))
        expected = naive_verdict(scheme, kind, n)
        if expected is None:
            continue
        seen.add(expected)
        if expected:
            check_convergence(scheme, kind, n)
            continue
        with pytest.raises(UnsupportedSpectrum, match=rf"do not converge at .*\b{n}\b"):
            check_convergence(scheme, kind, n)
    assert seen == {True, False}


@pytest.mark.parametrize("kind", ["interior", "dart"])
@LATTICES
@pytest.mark.parametrize("n", [3, 5, 70])
def test_eigenvalues_on_the_unit_circle_are_told_apart(kind, lattice, n):
    """The weight at which an eigenvalue is exactly -1, and 10^-30 on either side of it."""
    at = critical(kind, n) if lattice == "quads" else critical_loop(kind, n)
    for change, converges in ((F(1, 10**30), True), (-F(1, 10**30), False)):
        scheme = wild(at + change, lattice)
        if converges:
            check_convergence(scheme, kind, n)
        else:
            with pytest.raises(UnsupportedSpectrum, match="-1"):
                check_convergence(scheme, kind, n)
    with pytest.raises(UnsupportedSpectrum, match="-1"):
        check_convergence(wild(at, lattice), kind, n)


def critical_loop(kind, n):
    """As `critical`, of triangles: -e_j = 3/8 (1 + e_j) + 1/8 (e_(j-1) + e_(j+1))."""
    rows = [{j: F(11), (j - 1) % n: F(1), (j + 1) % n: F(1), n: F(-3)} for j in range(n)]
    if kind == "dart":
        rows[0] = {0: F(3), n: F(-1)}
    mean = sum(solved(rows)) / n
    return (-1 - mean) / (1 - mean)


def critical(kind, n):
    """The weight of a vertex at which refinement has the eigenvalue -1: where v = 1 goes to -1.

    With v alternating e and f follow from their own rows, and the row of the vertex is affine.
    """
    size = 2 * n  # e_0, f_0, e_1, ...: (x + 1) u = -(column of v), rows of regular masks
    rows = [[F(0)] * (size + 1) for _ in range(size)]

    def face_row(j):
        row = [F(0)] * (size + 1)
        for k in (2 * (j % n), 2 * (j % n) + 1, 2 * ((j + 1) % n)):
            row[k] += F(1, 4)
        row[-1] += F(1, 4)  # v
        return row

    for j in range(n):
        rows[2 * j + 1] = face_row(j)
        if kind == "dart" and j == 0:
            rows[0][0], rows[0][-1] = F(1, 2), F(1, 2)
            continue
        both = zip(face_row(j - 1), face_row(j), strict=True)
        row = [(x + y) / 4 for x, y in both]
        row[2 * j] += F(1, 4)
        row[-1] += F(1, 4)
        rows[2 * j] = row
    # (A_uu + 1) u = -A_uv, by Gauss in Fractions
    system = []
    for i, row in enumerate(rows):
        row[i] += 1
        system.append({k: x for k, x in enumerate([*row[:-1], -row[-1]]) if x})
    u = solved(system)
    new_faces = [sum(w * x for w, x in zip(face_row(j), [*u, F(1)], strict=True)) for j in range(n)]
    mean = (sum(u[::2]) + sum(new_faces)) / n / 2
    # a + (1 - a) mean = -1
    return (-1 - mean) / (1 - mean)


def solved(rows):
    """The solution of sparse rows {column: weight}; column n has the right-hand sides."""
    n = len(rows)
    for k in range(n):
        pivot = rows[k].pop(k)  # the matrix is far from singular
        rows[k] = {c: x / pivot for c, x in rows[k].items()}
        for i, row in enumerate(rows):
            if i != k and k in row:
                factor = row.pop(k)
                for c, x in rows[k].items():
                    row[c] = row.get(c, F(0)) - factor * x
    return [row.get(n, F(0)) for row in rows]


@pytest.mark.parametrize("kind", ["interior", "dart"])
@LATTICES
@pytest.mark.parametrize("seed", range(2))
def test_normals_are_those_of_naive_refinement(kind, lattice, seed):
    rng = random.Random(f"normals {kind} {seed}")
    seen = set()
    for _ in range(14):
        n = rng.choice([2, 3, 5, 6, 7, 66])
        scheme = at_random(rng, lattice, (-90, 95), (-150, 250))
        try:
            check_convergence(scheme, kind, n)
            found = bool(normal_of(scheme, kind, n))
        except UnsupportedSpectrum:
            continue  # no limit, or more complex eigenvalues than are handled
        expected = naive_plane(scheme, kind, n)
        assert expected in (None, found), (n, scheme.vertex_mask(n))
        seen.add(expected)
    assert {True, False} <= seen


def normal_of(scheme, kind, n):
    if n <= tables.MOST_FACES:
        return ring_normal(scheme, kind, n)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return tables.ring_masks(scheme, kind, n).has_normal


def documented():
    """Rows of the table in the docstring of LimitSurface: kind, faces, numbers as text."""
    kinds = {"smooth,": "interior"} | {k: k for k in ("crease", "corner", "dart", "cone")}
    rows = []
    for line in ls.LimitSurface.__doc__.splitlines():
        words = line.split()
        if len(words) > 6 and words[0] in kinds and any(w.isdigit() for w in words[:4]):
            count = next(int(w) for w in words[:4] if w.isdigit())
            rest = line.split(str(count), 1)[1].removeprefix(" faces").removeprefix(" face")
            rows.append((kinds[words[0]], count, rest.split(maxsplit=6)))
    return rows


def test_the_documented_table_is_what_the_analysis_finds():
    rows = documented()
    assert len(rows) == 18
    for kind, faces, (*values, _, _, curvature, normal) in rows:
        table = tables.eigen_table(CATMULL_CLARK, Sector(kind, faces))
        assert table.rates[0, 1:4].round(3).tolist() == [float(x) for x in values], (kind, faces)
        growth = table.growth
        if curvature.endswith("^n"):
            assert float(curvature[:-2]) == pytest.approx(growth["curvature"], rel=5e-3)
        if curvature == "limit":
            assert growth["curvature"] == 1
        assert (growth["normals"] is None) == (normal == "none")
        assert ("1 / n" in normal) == (growth["normals"] == 1)


@pytest.mark.parametrize(
    ("kind", "with_normal"),
    [
        ("interior", range(3, 10)),
        ("crease", range(1, 5)),
        ("corner", range(1, 3)),
        ("dart", range(3, 10)),
        ("cone", ()),
        ("flap", ()),
        ("pendant", ()),
    ],
)
def test_catmull_clark_has_normals_where_it_is_known_to(kind, with_normal):
    least = 1 if Sector(kind, 2).open else 2
    found = [k for k in range(least, 10) if ring_normal(CATMULL_CLARK, kind, k)]
    assert found == [*with_normal]


# --- what a user sees -----------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["interior", "dart"])
@pytest.mark.parametrize("n", [5, 70])
def test_masks_without_a_limit_are_refused(kind, n):
    mesh, scheme = fan(kind, n), wild(F(-11, 10))
    what = rf"interior valence {n}" if kind == "interior" else rf"a dart of {n} faces"
    match = rf"do not converge at {what}: .* -1\.\d+; change the scheme's vertex\({n}\)"
    with pytest.raises(ValueError, match=match):
        ls.LimitSurface(mesh, scheme=scheme).evaluate(0, 0.4, 0.3)
    with pytest.raises(ValueError, match=match):
        ls.refined(mesh, scheme=scheme).limit_points  # noqa: B018
    if n < 64:
        exact = mesh.with_points(np.vectorize(F, otypes=[object])(mesh.points))
        with pytest.raises(ValueError, match=match):
            ls.refined(exact, scheme=scheme).limit_points  # noqa: B018
        with pytest.raises(ValueError, match=match):
            ls.eigenbasis(scheme, kind=kind, faces=n)
    ls.refined(mesh, 2, scheme=scheme)  # a finite number of steps needs no limit


@pytest.mark.parametrize("kind", ["interior", "dart"])
@pytest.mark.parametrize("n", [5, 70])
def test_masks_without_a_tangent_plane_are_warned_of_once(kind, n, monkeypatch):
    monkeypatch.setattr(tables.cache, "_memory", {})
    monkeypatch.setattr(tables.cache, "_warned", set())
    tables.ring_masks.cache_clear()
    mesh, scheme = fan(kind, n), wild(F(-3, 4))
    with pytest.warns(
        UserWarning, match=rf"'own' converges at .*\b{n}\b.* no tangent plane"
    ) as said:
        surface = ls.LimitSurface(mesh, scheme=scheme)
    normals = surface.normal(np.arange(n), 0.0, 0.0)  # warns no more
    assert len(said) == 1
    assert said[0].filename == __file__
    assert np.isnan(normals).all()
    fine = ls.refined(mesh, scheme=scheme)  # warns no more
    at = fine.indices == 0
    assert at.sum() == n
    assert np.isnan(fine.limit_normals[at]).all()
    assert np.isfinite(fine.limit_points[0]).all()
    assert np.allclose(fine.limit_points[0], surface.evaluate(0, 0.0, 0.0), atol=1e-13)
    assert np.isfinite(surface.normal(np.arange(n), 0.3, 0.2)).all()


def test_catmull_clark_never_warns():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for kind, faces in (("interior", 2), ("dart", 2), ("cone", 3), ("crease", 6)):
            tables.cache.warn_once(CATMULL_CLARK, Sector(kind, faces))


@pytest.mark.parametrize(
    ("kind", "with_normal"),
    [
        ("interior", range(3, 9)),
        ("crease", range(1, 6)),
        ("corner", range(1, 4)),
        ("dart", range(3, 9)),
        ("cone", ()),
        ("flap", ()),
        ("pendant", ()),
    ],
)
def test_loop_has_normals_where_two_waves_or_a_curve_are_slowest(kind, with_normal):
    """Waves of a sector of k faces have 3/8 + cos(m pi / k) / 4, a curve has 1/2.

    On creases the wave m = 1 and the curve go before m = 2 up to k = 5; at sharp corners, where
    the curve has 1/2 twice, m = 1 is no slower than that up to k = 3.
    """
    least = 1 if Sector(kind, 2).open else 2
    found = [k for k in range(least, 9) if ring_normal(LOOP, kind, k)]
    assert found == [*with_normal]


@pytest.mark.parametrize("scheme", [CATMULL_CLARK, LOOP], ids=lambda scheme: scheme.name)
def test_a_minor_of_either_sign_is_seen_inside_of_pieces(scheme):
    """S, and 2 T less a bump: the minor is 2 less its slope, negative amid a piece if steep."""
    at = scheme.spline.exponents.index
    for steepness, sign in ((6, 0), (4, 0), (3, 1), (-3, 1)):
        functions = np.zeros((1, 3, len(scheme.spline.exponents), 2), dtype=object)
        functions[:, :, at((1, 0)), 0], functions[:, :, at((0, 1)), 1] = 3 << 60, 6 << 60
        # slope in T: 2 steepness (1 - T) T
        functions[:, :, at((0, 2)), 1] = -3 * steepness << 60
        functions[:, :, at((0, 3)), 1] = 2 * steepness << 60
        assert orientation(scheme, functions, False, 1) == sign
        assert orientation(scheme, functions[..., ::-1], False, 1) == -sign
