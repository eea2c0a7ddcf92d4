"""The page that compares schemes: each number and each statement on it, recomputed.

Its own cells say how numbers are made; volumes are compared with those of exact integration.
"""

import re
from pathlib import Path

import numpy as np
import pytest

import limitsurf as ls

PAGE = Path(__file__).parent.parent / "notebooks" / "site" / "schemes_compared.md"
ROUNDING = ("catmull-clark", "loop", "loop-warren", "doo-sabin")


@pytest.fixture(scope="module")
def page():
    """What the first two cells of the page define."""
    cells = re.findall(
        r"^```\{code-cell\} ipython3\n(?::[^\n]*\n)?(.*?)^```$",
        PAGE.read_text("utf-8"),
        re.MULTILINE | re.DOTALL,
    )
    names = {"np": np, "ls": ls}
    exec(cells[1], names)
    return names


@pytest.fixture(scope="module")
def values(page):
    return {
        (name, scheme): page["measured"](surface, cage)
        for name, cage in page["cages"].items()
        for scheme, surface in page["surfaces"](cage).items()
    }


def test_every_scheme_is_measured(values):
    """On triangles all there are; on the cube all of polygons."""
    for scheme in ls.schemes:
        assert ("tetrahedron", scheme) in values
    assert {s for n, s in values if n == "cube"} >= {"catmull-clark", "doo-sabin", "bilinear"}


def test_the_table_is_recomputed(values):
    rows = re.findall(
        r"^\| (\w+) \| `([a-z-]+)` \| (\d.*) \|$", PAGE.read_text("utf-8"), re.MULTILINE
    )
    assert len(rows) == 9
    for name, scheme, cells in rows:
        assert cells == " | ".join(f"{x:.3f}" for x in values[name, scheme]), (name, scheme)


def test_volumes_are_those_of_exact_integration(page, values):
    for (name, scheme), (kept, *_) in values.items():
        if scheme in ROUNDING:
            surface = ls.LimitSurface(page["cages"][name], scheme=scheme)
            flat = ls.volume(ls.LimitSurface(page["cages"][name], scheme="bilinear"))
            assert kept == pytest.approx(abs(ls.volume(surface) / flat), abs=3e-3)


def test_what_is_said_of_cages(values):
    for name in ("cube", "tetrahedron", "octahedron"):
        of = {s: values[name, s] for s in ROUNDING if (name, s) in values}
        assert max(of, key=lambda s: of[s][2]) == "catmull-clark"
        assert max(of, key=lambda s: of[s][0]) == "doo-sabin"
        assert all(of["doo-sabin"][2] <= x[2] or s == "loop-warren" for s, x in of.items())
    for name in ("tetrahedron", "octahedron"):
        of = {s: values[name, s] for s in ROUNDING}
        assert min(of, key=lambda s: (of[s][0], s)) == "loop"
        assert values[name, "linear"][:2] == pytest.approx((1, 1))
        assert values[name, "bilinear"][:2] == pytest.approx((1, 1))
    assert values["tetrahedron", "loop"][0] == pytest.approx(0.04, abs=5e-3)
    assert values["tetrahedron", "loop"] == pytest.approx(values["tetrahedron", "loop-warren"])
    assert values["octahedron", "loop-warren"][1] > values["octahedron", "loop"][1] + 0.05


def test_what_is_said_of_vertices():
    found = {
        (s, n): ls.spectral_analysis(s, valence=n) for s in ROUNDING for n in (2, *range(3, 13))
    }
    for (scheme, n), one in found.items():
        assert one.c1 == (n > 2)
        if scheme == "doo-sabin" and n > 2:
            assert one.subdominant == (0.5, 0.5)
            assert one.curvature.logarithm == (n >= 5)
            assert one.curvature.rate == 1
        if scheme in ("loop", "catmull-clark") and n >= 7:
            assert (one.curvature.cups, one.curvature.saddles) == (False, True)
    behaviour = {key: one.curvature.behaviour for key, one in found.items() if one.curvature}
    assert [n for n in range(3, 13) if behaviour["loop", n] == "bounded"] == [4, 5, 6]
    assert [n for n in range(3, 13) if behaviour["catmull-clark", n] == "bounded"] == [4]
    assert behaviour["catmull-clark", 3] == "tends to 0"


def test_what_is_said_of_vertices_of_schemes_by_steps():
    for n in range(2, 13):
        sqrt3, modified, old = (
            ls.spectral_analysis(name, valence=n)
            for name in ("sqrt3", "modified-butterfly", "butterfly")
        )
        assert (sqrt3.c1, modified.c1, old.c1) == (n > 2, n > 2, 4 <= n <= 7)
        bounded = [x for x in (sqrt3, modified, old) if x.c1 and x.curvature.behaviour == "bounded"]
        assert bounded == ([sqrt3] if n in (4, 5, 6) else [])


def test_spectra_are_drawn(tmp_path):
    mine = ls.Scheme("mine", vertex=lambda N: ls.schemes["catmull-clark"].vertex(N))
    ls.plot_spectrum([mine, "loop"], tmp_path / "s.svg", valences=[3, 5])
    assert np.asarray(ls.plot_spectrum("loop", valences=[2, 3], off_screen=True)).ndim == 3
    text = (tmp_path / "s.svg").read_text("utf-8")
    assert "<svg" in text
    for wrong, complaint in (
        ({"valences": [1]}, "valences.0. must be an integer >= 2"),
        ({"valences": []}, "need a scheme and a valence"),
        ({"scheme": []}, "need a scheme and a valence"),
        ({"scheme": "bilinear"}, "has no eigenbases"),
        ({"scheme": ["loop", "nothing"]}, "unknown scheme 'nothing'"),
    ):
        with pytest.raises(ValueError, match=complaint):
            ls.plot_spectrum(**wrong, off_screen=True)
