"""The suite itself: one wrong mask or rule turns it red, in the refiner and in the surface.

The wrong masks (conftest.py) sum to one, so that partition of unity and affine invariance hold.
"all" and "edge" are wrong at regular vertices too, "extraordinary" at valence != 4 only, "ngon" at
faces of other than four corners only; "edge" is a mistake once seen in a well-known library.
"curve", "triangle", "chaikin" and the blends concern boundaries, creases and corners.
"""

import os
import re
import subprocess
import sys
from fractions import Fraction as F
from pathlib import Path

import pytest
import sympy

import limitsurf as ls
from limitsurf.scheme.catmull_clark import CATMULL_CLARK

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
