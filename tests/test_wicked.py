"""The suite itself: one wrong mask or rule turns it red, in the refiner and in the surface.

The wrong masks (conftest.py) sum to one, so that partition of unity and affine invariance hold.
"all" and "edge" are wrong at regular vertices too, "extraordinary" at valence != 4 only, "ngon" at
faces of other than four corners only; "edge" is a mistake once seen in a well-known library.
"curve", "triangle", "chaikin" and the blends concern boundaries, creases and corners.
"""

import copy
import os
import re
import subprocess
import sys
import warnings
from fractions import Fraction as F
from pathlib import Path

import pytest
import sympy
import test_every_scheme

import limitsurf as ls
from limitsurf.scheme.catmull_clark import CATMULL_CLARK
from limitsurf.scheme.doo_sabin import DOO_SABIN

TESTS = Path(__file__).parent

OPTIONS = ["-q", "--tb=short", "--numprocesses=0", "-p", "no:cacheprovider"]

# a few tests of each file that together look at every rule
SELECTED = {
    "test_refine.py": "test_refined_is_naively_refined and (cube or carved_torus)",
    "test_surface.py": "test_regular or test_exact_on_the_zoo and (sphere_8 or disk_7)",
    "test_creases.py": "(test_refined_is_naively_refined or test_exact_on_the_zoo) and "
    "(ring_sharp or chaikin_row or smooth_open_triangles or crossed_grid_0.3 or cone_5_0.3)",
}


def run(files, *options):
    """Test files in a process of its own; the exit code and what was printed."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST_")}
    chosen = " or ".join(f"{file} and ({SELECTED[file]})" for file in files)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *files, "-k", chosen, *options, *OPTIONS],
        cwd=TESTS,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env=environment | {"NO_COLOR": "1", "COLUMNS": "200", "PYTHONIOENCODING": "utf-8"},
    )
    return done.returncode, done.stdout


def test_the_true_scheme_passes():
    code, printed = run(SELECTED, "-rp")
    assert code == 0, printed
    for file in SELECTED:
        assert len(re.findall(rf"^PASSED .*{file}::", printed, re.M)) >= 4


def assert_red(printed, tests):
    """Some of the chosen tests failed, each of those named in ``tests`` by an assertion."""
    for test in tests:
        assert re.search(rf"^FAILED .*{test}.* - (AssertionError|assert )", printed, re.M), printed
    assert re.search(r"^\d+ failed, \d+ passed", printed, re.M), printed
    assert " error" not in printed.splitlines()[-1]


@pytest.mark.parametrize("wicked", ["all", "edge", "extraordinary", "ngon"])
def test_a_wicked_mask_turns_the_suite_red(wicked):
    code, printed = run(["test_refine.py", "test_surface.py"], f"--wicked={wicked}")
    assert code == 1, printed
    assert_red(printed, ("test_refine.py", "test_surface.py"))


@pytest.mark.parametrize("wicked", ["curve", "triangle", "chaikin", "edge_blend", "vertex_blend"])
def test_a_wicked_rule_turns_the_suite_red(wicked):
    """Both in the refiner and in the surface; elsewhere it is not noticed."""
    code, printed = run(["test_creases.py"], f"--wicked={wicked}")
    assert code == 1, printed
    assert_red(printed, ("test_refined_is_naively_refined", "test_exact_on_the_zoo"))


def altered(**masks):
    """The Catmull-Clark scheme with other masks, checked as any scheme is."""
    facts = {name: getattr(CATMULL_CLARK, name) for name in ls.Scheme.__dataclass_fields__}
    return ls.Scheme(**facts | {"name": "altered"} | masks)


@pytest.mark.parametrize(
    ("masks", "complaint"),
    [
        ({"edge": (F(0), F(1, 2))}, r"edge is \(0, 1/2\), but .* needs \(1/4, 1/4\)"),
        ({"vertex": lambda N: (F(1, 3), F(1, 3) / N, F(1, 3) / N)}, r"vertex\(4\) is \(1/3, 1/12"),
        ({"face": lambda n: (F(2, n + 1), *[F(1, n + 1)] * (n - 1))}, r"face\(4\) is \(2/5, 1/5"),
        ({"boundary_edge": F(1, 3)}, r"boundary_edge sums to 2/3, not to 1"),
        ({"boundary_vertex": (F(1, 2), F(1, 4))}, r"boundary_vertex is \(1/2, 1/4\)"),
        ({"boundary_vertex": (F(3, 4), F(1, 4))}, r"boundary_vertex sums to 5/4, not to 1"),
        ({"edge": (F(1, 4), F(1, 8))}, r"edge sums to 3/4, not to 1"),
        ({"vertex": lambda N: (F(1, 2), F(1, 16), F(1, 8))}, r"vertex\(4\) sums to 5/4, not to 1"),
        ({"face": lambda n: (F(1, 5),) * n}, r"face\(4\) sums to 4/5, not to 1"),
        ({"edge": (0.25, 0.25)}, r"edge must be 2 Fractions, got \(0\.25, 0\.25\)"),
        ({"face": lambda n: (F(1),)}, r"face\(4\) must be 4 Fractions"),
    ],
)
def test_a_scheme_with_wrong_regular_masks_is_refused(masks, complaint):
    with pytest.raises(ValueError, match=f"'altered': {complaint}"):
        altered(**masks)


def test_wrong_masks_elsewhere_are_refused_when_needed():
    unbalanced = altered(vertex=lambda N: (F(1, 2), F(1, 16), F(1, 16)))
    assert unbalanced.vertex_mask(4) == (F(1, 2), F(1, 16), F(1, 16))
    with pytest.raises(ValueError, match=r"'altered': vertex\(3\) sums to 7/8, not to 1"):
        unbalanced.vertex_mask(3)
    points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    cube = ls.Mesh(points, quads)
    with pytest.raises(ValueError, match=r"vertex\(3\) sums to 7/8, not to 1"):
        ls.LimitSurface(cube, scheme=unbalanced)
    with pytest.raises(ValueError, match=r"vertex\(3\) sums to 7/8, not to 1"):
        ls.refined(cube, scheme=unbalanced)
    with pytest.raises(ValueError, match=r"face\(3\) sums to 3/4, not to 1"):
        ls.refined(TRIANGLE, scheme=altered(face=lambda n: (F(1, 4) if n > 2 else F(1),) * n))


@pytest.mark.parametrize("weights", [(1 - sympy.I / 2, sympy.I / 4, sympy.I / 4), None, 0.5])
def test_weights_that_are_no_real_numbers_are_refused(weights):
    strange = altered(vertex=lambda N: CATMULL_CLARK.vertex(4) if N == 4 else weights)
    with pytest.raises(ValueError, match=r"'altered': vertex\(2\) must be 3 Fractions, got"):
        strange.vertex_mask(2)


TRIANGLE = ls.Mesh([[F(0)], [F(3)], [F(6)]], [[0, 1, 2]])


def test_masks_are_asked_for_no_more_than_the_mesh_holds():
    """Faces have three corners and more, interior vertices two faces and more."""
    shares = {3: (F(1, 3),) * 3, 4: (F(1, 4),) * 4}
    scheme = altered(face=shares.__getitem__)
    assert ls.refined(TRIANGLE, scheme=scheme).points[-1].tolist() == [3]
    assert ls.LimitSurface(TRIANGLE, scheme=scheme).evaluate(0, 1, 1).tolist() == [3]


def test_schemes_are_told_apart_by_their_masks():
    """A scheme of the same name gets tables of its own, in memory and on disk."""
    stolen = altered(
        name="catmull-clark",
        vertex=lambda N: (
            F(N - 2, N) - F(N != 4, 20),
            F(1, N * N) + F(N != 4, 20 * N),
            F(1, N * N),
        ),
    )
    true, wrong = (ls.eigenbasis(scheme, 3).float64 for scheme in (CATMULL_CLARK, stolen))
    assert true.provenance != wrong.provenance
    assert abs(true.limit_mask[0] - 9 / 24) < 1e-15
    assert abs(wrong.limit_mask[0] - 9 / 24) > 1e-3
    points = [[F(x), F(y), F(z)] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    cube = ls.Mesh(points, quads)
    assert ls.LimitSurface(cube).evaluate(0, 0, 0).tolist() == [F(1, 4)] * 3
    assert ls.LimitSurface(cube, scheme=stolen).evaluate(0, 0, 0)[0] != F(1, 4)


def stolen(mask, valences=None):
    """A vertex mask that gives a sixteenth of itself to its neighbours, at some valences."""

    def wrong(n):
        own, each, *around = mask(n)
        share = F(1, 16) if valences is None or n in valences else F(0)
        return (own - share, each + share / n, *around)

    return wrong


def crowded(mask, sizes=None):
    """Another symmetric mask of polygons of some sizes."""

    def wrong(n):
        true = mask(n)
        return (F(2, n + 1), *[F(1, n + 1)] * (n - 1)) if sizes is None or n in sizes else true

    return wrong


def straight_rim(k):
    """Ratios in equal steps."""
    return tuple(F(k - 1 - 2 * j, k - 1) for j in range(k)) if k > 1 else (F(1), F(-1))


CURVE = (F(2, 3), F(1, 6))  # as in the limit
QUAD = test_every_scheme.KINDS["catmull-clark"].scheme
WARREN = test_every_scheme.KINDS["loop-warren"].scheme
LOOP = test_every_scheme.KINDS["loop"].scheme
# what is wrong, and a cage that shows it
WRONG = [
    ("catmull-clark", "vertex", stolen(QUAD.vertex, {3}), "cube"),
    ("catmull-clark", "vertex", stolen(QUAD.vertex, {4}), "carved_cube_1"),
    *((name, "vertex", stolen(scheme.vertex, valences), cage)
      for name, scheme in (("loop", LOOP), ("loop-warren", WARREN))
      for valences, cage in ((None, "octahedron"), ({5}, "icosahedron"), ({6}, "crowded"))),
    *((name, "edge", (F(1, 4), F(1, 4)), "octahedron") for name in ("loop", "loop-warren")),
    *((name, "boundary_vertex", CURVE, "fan_7") for name in ("loop", "loop-warren")),
    ("doo-sabin", "corner", crowded(DOO_SABIN.corner), "cube"),
    ("doo-sabin", "corner", crowded(DOO_SABIN.corner, {3}), "cube"),
    ("doo-sabin", "corner", crowded(DOO_SABIN.corner, {4}), "cube"),
    ("doo-sabin", "corner", crowded(DOO_SABIN.corner, {7}), "prism_7"),
    ("doo-sabin", "rim", straight_rim, "half_disk_5"),
    ("bilinear", "face", crowded(lambda n: (F(1, n),) * n, {7}), "prism_7"),
    ("bilinear", "edge", (F(1, 4), F(1, 4)), "cube"),
    ("bilinear", "boundary_vertex", (F(3, 4), F(1, 8)), "grid_3x3"),
    ("linear", "edge", (F(3, 8), F(1, 8)), "crowded"),
    ("linear", "boundary_vertex", (F(3, 4), F(1, 8)), "fan_7"),
]  # fmt: skip


# patches of degree 1 are their own corners
UNASKED = {("linear", "edge"), ("linear", "boundary_vertex"), ("bilinear", "edge"),
           ("bilinear", "boundary_vertex")}  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "mask", "wrong", "cage"),
    WRONG,
    ids=[f"{x[0]}-{x[1]}-{k}" for k, x in enumerate(WRONG)],
)
def test_a_wicked_mask_of_any_scheme_turns_the_suite_red(kind, mask, wrong, cage, monkeypatch):
    """In the refiner, and in the surface where that asks for the mask."""
    every = test_every_scheme
    known = every.KINDS[kind]
    # a copy is not checked as a new Scheme is
    scheme = copy.copy(known.scheme)
    object.__setattr__(scheme, mask, wrong)
    object.__setattr__(scheme, "name", f"wicked {kind}")
    monkeypatch.setitem(every.KINDS, kind, known._replace(scheme=scheme))
    every.surface.cache_clear()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of tangent planes that there are none
        with pytest.raises(AssertionError):
            every.test_refined_is_naively_refined(kind, cage)
        if (kind, mask) not in UNASKED:
            with pytest.raises((AssertionError, ValueError)):
                every.test_values_are_the_oracles(kind, cage, "reference")
    every.surface.cache_clear()


def test_every_registered_scheme_has_its_wicked_masks():
    assert {kind for kind, *_ in WRONG} >= ls.schemes.with_pieces.keys()
