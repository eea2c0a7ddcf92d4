"""What `ls.spectral_analysis` decides, against papers, masks made for it, and long refinement."""

import re
from fractions import Fraction as F
from pathlib import Path

import numpy as np
import pytest
from test_analysis import own, own_loop

import limitsurf as ls
from limitsurf.exact.analysis import minor_sign, winding
from limitsurf.refine.neighbourhoods import lattice_places
from limitsurf.scheme.doo_sabin import DOO_SABIN
from limitsurf.scheme.dual import DualScheme
from limitsurf.spectra import stepwise

CATMULL_CLARK, LOOP = ls.schemes["catmull-clark"], ls.schemes["loop"]
PAGE = Path(__file__).parent.parent / "notebooks" / "site" / "howto" / "schemes.md"


# Loop (1987) bounds curvature at 4, 5, 6; Sabin (1991), Peters and Reif (1998) and Karciauskas,
# Peters and Reif (2004) for Catmull and Clark; Doo-Sabin after derivations/doo_sabin.py
@pytest.mark.parametrize(
    ("scheme", "behaviours"),
    [
        ("loop", {3: "unbounded", 4: "bounded", 5: "bounded", 6: "bounded", 7: "unbounded"}),
        ("loop", dict.fromkeys([8, 9], "unbounded")),
        ("catmull-clark", {3: "tends to 0", 4: "bounded", 5: "unbounded", 6: "unbounded"}),
        ("catmull-clark", dict.fromkeys([7, 12, 30], "unbounded")),
        ("loop-warren", {3: "unbounded", 4: "unbounded", 5: "unbounded", 6: "bounded"}),
        (
            "doo-sabin",
            {3: "bounded", 4: "bounded", 5: "unbounded", 6: "unbounded", 12: "unbounded"},
        ),
    ],
)
def test_curvature_is_bounded_where_papers_say_so(scheme, behaviours):
    for valence, behaviour in behaviours.items():
        found = ls.spectral_analysis(scheme, valence=valence)
        assert (found.c1, found.regular, found.injective) == (True, True, True)
        assert found.curvature.behaviour == behaviour, valence
        assert found.curvature.exact
        # but by a chain, boundedness is that of the quotient
        assert found.curvature.logarithm == (scheme == "doo-sabin" and valence >= 5)


def test_the_outer_eigenvalue_decides_at_valence_3_of_loop():
    curvature = ls.spectral_analysis("loop", valence=3).curvature
    assert (curvature.rate, curvature.power) == (2, 0.5)
    assert [(m.frequency, m.eigenvalue, m.outer) for m in curvature.by_frequency] == [
        (0, 1 / 8, True),
        (1, 1 / 8, True),
    ]


def test_cups_and_saddles_of_catmull_clark():
    """Karciauskas, Peters, Reif (2004): cups at 3, both at 4, saddles beyond."""
    shapes = {3: (True, False), 4: (True, True), 5: (False, True), 9: (False, True)}
    for valence, shape in shapes.items():
        curvature = ls.spectral_analysis(valence=valence).curvature
        assert (curvature.cups, curvature.saddles) == shape
    # mu / lambda^2 as derivations/scaling.py has it
    for valence, rate in ((3, 0.99100), (5, 1.1244), (6, 1.2204), (8, 1.3388), (50, 1.5225)):
        assert ls.spectral_analysis(valence=valence).curvature.rate == pytest.approx(rate, abs=5e-5)


def test_blocks_of_doo_sabin_are_at_frequencies_between_2_and_half():
    for n in (5, 6, 7, 8):
        found = ls.spectral_analysis("doo-sabin", valence=n)
        assert str(found.curvature) == "unbounded, like log(1/r)"
        heads = {m.frequency for m in found.curvature.by_frequency if m.logarithm}
        assert heads == {f for f in range(2, n) if 2 * f < n}
        (quarter,) = (x for x in found.eigenvalues if x.value == 0.25)
        assert quarter.jordan == (2, 2, *[1] * (n - 5))
    assert all(max(x.jordan) == 1 for x in ls.spectral_analysis("doo-sabin", valence=4).eigenvalues)


@pytest.mark.parametrize("scheme", ["catmull-clark", "loop", "loop-warren", "doo-sabin"])
def test_valence_2_has_no_normal(scheme):
    found = ls.spectral_analysis(scheme, valence=2)
    assert (found.c1, found.subdominant, found.regular, found.curvature) == (False, (), None, None)


@pytest.mark.parametrize("scheme", ["bilinear", "linear"])
def test_schemes_without_special_vertices_are_refused(scheme):
    with pytest.raises(ValueError, match=f"'{scheme}' has no eigenbases"):
        ls.spectral_analysis(scheme, valence=5)


@pytest.mark.filterwarnings("ignore:scheme 'own' converges")
@pytest.mark.parametrize("lattice", ["quads", "triangles"])
def test_a_vertex_that_moves_too_little_is_not_c1(lattice):
    """Frequency 0 outweighs the pair: a single mode leads, and all surfaces end in a spike."""
    wicked = own_loop(F(99, 100)) if lattice == "triangles" else own(F(99, 100), F(1, 200))
    found = ls.spectral_analysis(wicked, valence=5)
    assert (found.c1, found.subdominant, found.curvature) == (False, (), None)
    assert found.eigenvalues[1].origins == ("frequency 0",)


def dual(values, n=6):
    """Doo and Sabin's scheme but for polygons of n = 6, whose waves have such eigenvalues."""
    cosine = (F(1), F(1, 2), F(-1, 2), F(-1), F(-1, 2), F(1, 2))

    def corner(m):
        if m != n:
            return DOO_SABIN.corner(m)
        waves = [values[min(f, n - f)] for f in range(n)]
        return tuple(sum(x * cosine[f * j % n] for f, x in enumerate(waves)) / n for j in range(n))

    return DualScheme(name="own", corner=corner, paper="none")


@pytest.mark.filterwarnings("ignore:scheme 'own' converges")
def test_a_characteristic_map_that_goes_around_twice_is_not_injective():
    """Its pair is of frequency 2: normals have a limit on each sheet, but there are two."""
    found = ls.spectral_analysis(dual((F(1), F(1, 4), F(1, 2), F(1, 8))), valence=6)
    assert found.subdominant == (0.5, 0.5)
    assert (found.regular, found.injective, found.c1) == (True, False, False)
    like = ls.spectral_analysis(dual((F(1), F(1, 2), F(1, 4), F(1, 4))), valence=6)
    assert (like.regular, like.injective, like.c1) == (True, True, True)
    # without a block at 1/4 curvature is bounded
    calm = ls.spectral_analysis(dual((F(1), F(1, 2), F(1, 5), F(1, 5))), valence=6)
    assert calm.curvature.behaviour == "bounded"


def test_winding_is_that_of_many_points_on_the_way():
    """Of curves that swing around 0 between two corners, where their ends do not tell."""
    spline = CATMULL_CLARK.spline
    origins = [piece.origin for piece in CATMULL_CLARK.lattice.pieces]
    rng, near = np.random.default_rng(3), 1 << 40
    for _ in range(20):
        found = rng.integers(-near, near, size=(1, 3, len(spline.exponents), 2)).astype(object)
        swept, t = 0.0, np.linspace(0, 1, 20001)
        for corner, s in [((1, 0), 0), ((1, 1), 0), ((1, 1), 1), ((0, 1), 1)]:
            at = (1 - t, 1 + 0 * t) if s else (1 + 0 * t, t)
            powers = np.array([at[0] ** i * at[1] ** j for i, j in spline.exponents])
            x, y = found[0, origins.index(corner)].astype(float).T @ powers
            swept += np.unwrap(np.angle(x + 1j * y))[-1] - np.angle(x[0] + 1j * y[0])
        assert winding(CATMULL_CLARK, found, 1) == pytest.approx(swept / (2 * np.pi), abs=1e-9)


def test_a_minor_of_both_signs_is_told_from_one_that_is_not_decided():
    """In S on all pieces: 1, of one sign; S - 1/2, of both; (S - 1/3)^2, which is 0 inside."""
    spline = LOOP.spline
    at = {place: k for k, place in enumerate(spline.exponents)}
    for powers, expected in (((1,), 1), ((-1, 2), 0), ((1, -6, 9), None)):
        functions = np.zeros((1, 4, len(at), 2), dtype=object)[:, : len(LOOP.lattice.pieces)]
        for k, x in enumerate(powers):  # f with f_S = the minor, and g = T
            functions[..., at[k + 1, 0], 0] = x * 6 // (k + 1) << 200
        functions[..., at[0, 1], 1] = 1 << 200
        assert minor_sign(LOOP, functions) == expected


def test_support_is_where_a_point_has_influence():
    for name, radius in (("catmull-clark", 2), ("loop", 2), ("loop-warren", 2), ("doo-sabin", 1.5)):
        assert ls.spectral_analysis(name, valence=4).support == radius
    n = 9
    points = np.zeros((n * n, 1))
    points[n * n // 2] = 1
    corner = [i * n + j for i in range(n - 1) for j in range(n - 1)]
    faces = [[k, k + n, k + n + 1, k + 1] for k in corner]
    u = np.linspace(0.05, 0.95, 10)
    for name, radius in (("catmull-clark", 2), ("doo-sabin", 1.5)):
        surface = ls.LimitSurface(ls.Mesh(np.repeat(points, 3, axis=1), faces), scheme=name)
        row = (n - 1) * (n // 2) + np.arange(n - 1)  # faces from the middle in one direction
        limit = [surface.evaluate(int(surface.limit_faces.first[f]), 1e-3, u)[:, 0] for f in row]
        reach = max(f + x - n // 2 for f, value in enumerate(limit) for x in u[value > 1e-12])
        assert radius - 0.11 < reach < radius


def test_shrinkage_is_what_limit_masks_say():
    """Catmull and Clark: N / (N + 5) (Halstead, Kass, DeRose 1993); Doo and Sabin: means."""
    for n in (3, 4, 7):
        assert ls.spectral_analysis(valence=n).shrinkage == pytest.approx(5 / (n + 5), abs=1e-15)
        assert ls.spectral_analysis("doo-sabin", n).shrinkage == pytest.approx(1 - 1 / n, abs=1e-15)
    assert ls.spectral_analysis("loop", 6).shrinkage == 0.5
    assert ls.spectral_analysis(kind="corner", faces=1).shrinkage == 0


def test_sectors_have_verdicts_where_they_are_decided():
    regular = ls.spectral_analysis(kind="crease", faces=2)
    assert (regular.c1, regular.curvature.behaviour, regular.injective) == (True, "bounded", None)
    cut = ls.spectral_analysis(kind="crease", faces=3).curvature
    assert (cut.behaviour, cut.power, cut.exact, cut.cups) == ("not decided", None, False, None)
    assert not ls.spectral_analysis(kind="crease", faces=5).c1
    dart = ls.spectral_analysis(kind="dart", faces=6)
    assert any(isinstance(x.value, complex) and x.value.imag for x in dart.eigenvalues)
    assert ls.spectral_analysis(kind="dart", faces=3).injective is True


def test_what_is_shown():
    found = ls.spectral_analysis("loop", valence=7)
    assert repr(found) == (
        "<SpectralAnalysis of loop at interior valence 7: "
        "C1 yes, curvature unbounded, like r^-0.197>"
    )
    assert "saddles survive: yes" in str(found)
    shown = found._repr_html_()
    assert "frequency 2" in shown
    assert "unbounded, like r^-0.197" in shown
    with pytest.raises(AttributeError):
        found.c1 = False


# after Kobbelt (2000): frequency f has (2/3) cos(pi f / N), what is constant lambda^2; outer points
# have 0.2025... at each valence, by the matrix of all points below
@pytest.mark.parametrize("n", [3, 4, 5, 6, 7, 8, 12])
def test_waves_of_sqrt3(n):
    found = ls.spectral_analysis("sqrt3", valence=n)
    waves = 2 / 3 * np.cos(np.pi * np.arange(1, n // 2 + 1) / n)
    assert (found.c1, found.regular, found.injective) == (True, True, True)
    assert found.subdominant == pytest.approx((waves[0],) * 2, abs=1e-15)
    values = {x.value: x for x in found.eigenvalues}
    near = {w: min(values, key=lambda x: abs(x - w)) for w in (*waves, waves[0] ** 2)}
    assert all(abs(w - x) < 1e-15 for w, x in near.items())
    assert "frequency 0" in values[near[waves[0] ** 2]].origins
    assert found.eigenvalues[0].value == 1
    alpha = (4 - 2 * np.cos(2 * np.pi / n)) / 9
    assert found.shrinkage == pytest.approx(3 * alpha / (1 + 3 * alpha), abs=1e-14)
    rate = max(waves[1] / waves[0] ** 2 if n > 3 else 0, 1, 0.20254174 / waves[0] ** 2)
    assert found.curvature.rate == pytest.approx(rate, abs=1e-7)
    lead = next(mode for mode in found.curvature.by_frequency if mode.leads)
    assert lead.outer == (n == 3)
    assert found.curvature.behaviour == ("bounded" if n in (4, 5, 6) else "unbounded")


def test_waves_of_butterfly():
    """Dyn, Levin, Gregory (1990): no tangent plane at 3; more than one turn from 8 on."""
    for n in (2, 3, 4, 7, 8):
        assert ls.spectral_analysis("butterfly", valence=n).c1 == (4 <= n <= 7)
    twice = ls.spectral_analysis("butterfly", valence=8)
    assert (twice.regular, twice.injective, twice.curvature) == (True, False, None)
    regular = ls.spectral_analysis("butterfly", valence=6)
    (quarter,) = [x for x in regular.eigenvalues if x.value == 0.25]
    assert (quarter.multiplicity, quarter.jordan) == (7, (3, 2, 2))
    assert quarter.origins == ("frequency 0", "frequency 2")
    assert regular.curvature.logarithm


def test_waves_of_modified_butterfly():
    """Zorin, Schroeder, Sweldens (1996): 1/2 from frequency 1, then 1/4 at 0 and 2."""
    for n in (3, 4, 5, 7, 9):
        found = ls.spectral_analysis("modified-butterfly", valence=n)
        assert (found.c1, found.subdominant, found.shrinkage) == (True, (0.5, 0.5), 0)
        quarter = found.eigenvalues[2]
        assert (quarter.value, max(quarter.jordan)) == (0.25, 1)
        assert quarter.multiplicity == {3: 1, 4: 2}.get(n, 3)
        assert found.curvature.behaviour == "unbounded"


@pytest.mark.parametrize("name", ["butterfly", "modified-butterfly", "sqrt3"])
def test_all_waves_are_the_eigenvalues_of_a_matrix_of_points(name):
    """A disk refined by the public call: one matrix of the points of three rings."""
    n, rings = 5, 5 if name == "sqrt3" else 4
    number = {}

    def at(r, s, t):
        r, s, t = (0, 0, 0) if r == 0 else (r, (s + t // r) % n, t % r)
        return number.setdefault((r, s, t), len(number))

    faces = []
    for s in range(n):
        for r in range(1, rings + 1):
            for t in range(r):
                faces.append((at(r - 1, s, t), at(r, s, t), at(r, s, t + 1)))
                if t < r - 1:
                    faces.append((at(r - 1, s, t), at(r, s, t + 1), at(r - 1, s, t + 1)))
    mesh = ls.Mesh(np.zeros((len(number), 3)), faces)
    steps = 2 if name == "sqrt3" else 1
    fine, R = ls.refined(mesh, steps, scheme=name, operator=True)
    # each new vertex by where it is: its ring is that of its parent, times two or three
    scale = 3 if steps == 2 else 2
    place = {}
    keys = {k: key for key, k in number.items()}
    for row in range(fine.n_vertices):
        a, b, c = (keys[v] for v in mesh.faces[fine.parent_face[row]])
        u, v = fine.parent_u[row], fine.parent_v[row]
        where = sum(
            w * r * np.exp(2j * np.pi * s / n)
            + w * t * (np.exp(2j * np.pi * (s + 1) / n) - np.exp(2j * np.pi * s / n))
            for w, (r, s, t) in ((1 - u - v, a), (u, b), (v, c))
        )
        place[complex(np.round(scale * where, 6) + 0)] = row
    spots = {
        key: complex(
            np.round(
                r * np.exp(2j * np.pi * s / n)
                + t * (np.exp(2j * np.pi * (s + 1) / n) - np.exp(2j * np.pi * s / n)),
                6,
            )
            + 0
        )
        for key, k in number.items()
        for r, s, t in [key]
        if r <= 3
    }
    rows = [place[spot] for spot in spots.values()]
    columns = [number[key] for key in spots]
    matrix = R[rows][:, columns].toarray()
    assert np.abs(matrix.sum(axis=1) - 1).max() < 1e-14
    values = np.linalg.eigvals(matrix)
    found = ls.spectral_analysis(name, valence=n).eigenvalues
    expected = [x.value**steps for x in found for _ in range(x.multiplicity)]
    assert len(expected) == len(values) == 31
    for power in range(1, 6):  # sums of powers, since chains have few digits
        assert (values**power).sum() == pytest.approx(np.sum(np.power(expected, power)), abs=1e-12)


def test_spectra_of_steps_are_refused_off_smooth_vertices():
    with pytest.raises(
        ValueError, match="'sqrt3': spectra of schemes that are refined step by step"
    ):
        ls.spectral_analysis("sqrt3", kind="crease", faces=3)


def test_a_map_that_folds_is_told():
    whole = stepwise.pieces_of(ls.schemes["sqrt3"], 5)
    pieces = stepwise._Pieces(
        0, np.zeros((1, 26, 2)), np.zeros((1, 2)), np.zeros((1, 2)), np.ones(1)
    )
    places = lattice_places(whole._kinds.known[0].faces, 27)[1:].astype(float)
    pieces.steps[0] = places * [1, -1]
    assert pieces.bounds(whole)[0].tolist() == [-1]
    pieces.steps[0] = np.stack([places[:, 0], places[:, 0] * places[:, 1]], axis=1)
    assert pieces.bounds(whole)[0].tolist() == [0]


def test_the_table_of_the_page_is_recomputed():
    rows = re.findall(
        r"^\| `([a-z0-9-]+)` \| (\d+) \| (.*) \|$", PAGE.read_text("utf-8"), re.MULTILINE
    )
    assert {name for name, *_ in rows} == {n for n, s in ls.schemes.items() if not s.local}
    for name, valence, cells in rows:
        facts = ls.spectral_analysis(name, valence=int(valence)).facts
        names = ("C1", "curvature", "cups survive", "saddles survive", "shrinkage")
        assert cells.split(" | ") == [facts[key] for key in names], (name, valence)
